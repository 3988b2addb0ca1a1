/* leaf.h - one element along a packet of rays: where it matters, and bounds of its density.
 *
 * Along the ray P(t) = o + t d, |d| = 1, the squared relative distance of a convex skeleton is piecewise
 * quadratic, s(t) = r2 + k (t - tau)^2, in closest-approach form (numerics.md, section 2): a point has one
 * piece, a line three (end, side, end). On [a, b] inside a piece the Bernstein coefficients of s are exact;
 * across a joint s is convex with s'' <= 2k, so it lies between its chord and chord - k (t - a)(b - t).
 * With the lines of kernel.h, linear in s, every density lies between two quadratics in t.
 *
 * All functions work on LANES rays in lock step; loops over lanes have no branches on data.
 */
#ifndef BLOB_LEAF_H
#define BLOB_LEAF_H

#include "kernel.h"
#include "lane.h"
#include "user.h"

/* Rays of a packet, packed coordinates; t is local (see ray setup in search.h). */
typedef struct packet_rays {
    LANE_ALIGN double o[3][LANES], d[3][LANES], inverse[3][LANES]; /* 1 / d, finite */
    LANE_ALIGN double magnitude[LANES];                            /* |coordinates| that rounding is relative to */
} packet_rays;

/* Pieces of s(t) for what is not a plain point; t < first: piece 0, t > second: piece 2, else 1. */
typedef struct leaf_pieces {
    LANE_ALIGN double tau[3][LANES], r2[3][LANES], k[3][LANES];
    LANE_ALIGN double first[LANES], second[LANES];
    LANE_ALIGN double bend[LANES];                        /* s'' <= 2 bend */
    LANE_ALIGN double nearest_t[LANES], nearest_s[LANES]; /* closest approach on the whole line */
} leaf_pieces;

/* An element that at least one ray of the packet meets. */
typedef struct leaf {
    LANE_ALIGN double tau[LANES], r2[LANES];
    LANE_ALIGN double enter[LANES], exit[LANES]; /* enter > exit: this ray never meets it */
    double k;                                    /* 1 / R^2 (points) */
    double rounding; /* how much coordinate rounding moves s / 2: 4 of the 8 eps in E, times sqrt(s) <= 1 / R */
    double weight;
    int32_t kernel; /* index into scene->kernels */
    int32_t id;     /* KERNEL_* */
    int32_t element;
    int32_t pieces; /* index of its leaf_pieces, -1: plain point or set */
    int32_t memory; /* index of the set_memory of a mesh, else -1 */
    int32_t set;    /* SET_*: known by its distance alone, see set.h */
} leaf;

/* Bernstein coefficients of the quadratics above and below the field on [a, b], and the sum that the
 * rounding bound E is made of (E = 8 eps * magnitude). */
typedef struct leaf_bounds {
    LANE_ALIGN double upper[3][LANES], lower[3][LANES], magnitude[LANES];
} leaf_bounds;

/* Ranges over [a, b] of value and slope dF/dt, and the values at both ends. */
typedef struct leaf_slopes {
    LANE_ALIGN double value_lo[LANES], value_hi[LANES], slope_lo[LANES], slope_hi[LANES];
    LANE_ALIGN double at_a[LANES], at_b[LANES], magnitude[LANES];
} leaf_slopes;

/* Value and gradient at one t per lane. */
typedef struct leaf_point {
    LANE_ALIGN double value[LANES], gradient[3][LANES], magnitude[LANES];
} leaf_point;

/* s and ds/dt at t. */
KERNEL_INLINE void leaf_distance(const leaf *restrict e, const leaf_pieces *restrict p, int l, double t, double *s,
                                 double *slope) {
    double tau = e->tau[l], r2 = e->r2[l], k = e->k;
    if (p) {
        const int before = t<p->first[l], behind = t> p->second[l];
        tau = before ? p->tau[0][l] : behind ? p->tau[2][l] : p->tau[1][l];
        r2 = before ? p->r2[0][l] : behind ? p->r2[2][l] : p->r2[1][l];
        k = before ? p->k[0][l] : behind ? p->k[2][l] : p->k[1][l];
    }
    const double u = t - tau;
    *s = r2 + k * u * u;
    *slope = 2.0 * k * u;
}

/* Range of s over [a, b] and the middle Bernstein coefficients of quadratics below and above it. */
typedef struct leaf_range {
    double sa, sb, middle_lo, middle_hi, lo, hi, mid;
    double slope_lo, slope_hi; /* range of ds/dt */
} leaf_range;

/* The same for LANES rays. */
typedef struct leaf_ranges {
    LANE_ALIGN double sa[LANES], sb[LANES], middle_lo[LANES], middle_hi[LANES], lo[LANES], hi[LANES], mid[LANES];
    LANE_ALIGN double slope_lo[LANES], slope_hi[LANES];
} leaf_ranges;

/* What is not told by formulas that are inlined: ranges of sets, lines of user kernels. Either may be NULL. */
typedef struct leaf_given {
    const leaf_ranges *ranges;
    const user_lines *lines;
} leaf_given;

KERNEL_INLINE leaf_range leaf_range_of(const leaf *restrict e, const leaf_pieces *restrict p, int l, double a,
                                       double b) {
    leaf_range q;
    if (!p) {
        const double u = a - e->tau[l], v = b - e->tau[l], r2 = e->r2[l], k = e->k;
        q.sa = r2 + k * u * u;
        q.sb = r2 + k * v * v;
        q.middle_lo = q.middle_hi = r2 + k * u * v;
        q.hi = kernel_max(q.sa, q.sb);
        q.lo = u * v < 0.0 ? r2 : kernel_min(q.sa, q.sb);
        q.slope_lo = 2.0 * k * u;
        q.slope_hi = 2.0 * k * v;
    } else {
        leaf_distance(e, p, l, a, &q.sa, &q.slope_lo); /* s is convex: s' rises */
        leaf_distance(e, p, l, b, &q.sb, &q.slope_hi);
        const double first = p->first[l], second = p->second[l];
        const int before = b <= first, behind = a >= second, between = a >= first && b <= second;
        const int single = before | behind | between;
        const double tau = before ? p->tau[0][l] : behind ? p->tau[2][l] : p->tau[1][l];
        const double r2 = before ? p->r2[0][l] : behind ? p->r2[2][l] : p->r2[1][l];
        const double k = before ? p->k[0][l] : behind ? p->k[2][l] : p->k[1][l];
        const double blossom = r2 + k * (a - tau) * (b - tau), chord = 0.5 * (q.sa + q.sb);
        q.middle_lo = single ? blossom : chord - 0.5 * p->bend[l] * (b - a) * (b - a);
        q.middle_hi = single ? blossom : chord;
        q.hi = kernel_max(q.sa, q.sb);
        q.lo = a < p->nearest_t[l] && b > p->nearest_t[l] ? p->nearest_s[l] : kernel_min(q.sa, q.sb);
        q.lo = kernel_min(q.lo, q.hi);
    }
    q.mid = kernel_max(kernel_min(0.25 * (q.sa + q.sb) + 0.5 * q.middle_hi, q.hi), q.lo);
    return q;
}

KERNEL_INLINE leaf_range leaf_ranges_at(const leaf_ranges *restrict q, int l) {
    return (leaf_range){q->sa[l], q->sb[l],  q->middle_lo[l], q->middle_hi[l], q->lo[l],
                        q->hi[l], q->mid[l], q->slope_lo[l],  q->slope_hi[l]};
}

static void leaf_fill_ranges(const leaf *restrict e, const leaf_pieces *restrict p, const double *restrict a,
                             const double *restrict b, leaf_ranges *restrict q) {
    LANE_SIMD(l) {
        const leaf_range one = leaf_range_of(e, p, l, a[l], b[l]);
        q->sa[l] = one.sa;
        q->sb[l] = one.sb;
        q->middle_lo[l] = one.middle_lo;
        q->middle_hi[l] = one.middle_hi;
        q->lo[l] = one.lo;
        q->hi[l] = one.hi;
        q->mid[l] = one.mid;
        q->slope_lo[l] = one.slope_lo;
        q->slope_hi[l] = one.slope_hi;
    }
}

KERNEL_INLINE kernel_lines leaf_lines_at(const user_lines *restrict k, int l) {
    return (kernel_lines){k->upper_value[l], k->upper_slope[l], k->upper_at[l], k->lower_value[l],
                          k->lower_slope[l], k->lower_at[l],    k->top[l],      k->steep[l]};
}

/* sqrt(s) <= 1 within the support of finite kernels; the Gaussian reaches further. */
KERNEL_INLINE double leaf_reach_of(int id, double s_hi) {
    return id == KERNEL_GAUSS ? kernel_max(s_hi, 1.0) : kernel_min(s_hi, 1.0);
}

/* Zeros, without a call. */
#define LANE_CLEAR(object)                                                                                             \
    do {                                                                                                               \
        double *restrict clear = (double *)(object);                                                                   \
        for (size_t number = 0; number < sizeof *(object) / sizeof(double); number++) clear[number] = 0.0;             \
    } while (0)

/* Add one element's bounds on [a, b]. */
KERNEL_INLINE void leaf_add_bounds(int id, const blob_scene *scene, const packet_rays *restrict rays,
                                   const leaf *restrict e, const leaf_pieces *restrict p, leaf_given given,
                                   const double *restrict a, const double *restrict b, leaf_bounds *restrict sum) {
    const blob_kernel *kernel = &scene->kernels[e->kernel];
    const double w = e->weight, size = fabs(w);
    double(*restrict up)[LANES] = w >= 0.0 ? sum->upper : sum->lower;
    double(*restrict down)[LANES] = w >= 0.0 ? sum->lower : sum->upper;
    LANE_SIMD(l) {
        const leaf_range q = given.ranges ? leaf_ranges_at(given.ranges, l) : leaf_range_of(e, p, l, a[l], b[l]);
        const kernel_lines k =
            given.lines ? leaf_lines_at(given.lines, l) : kernel_bounds(id, scene, kernel, q.lo, q.hi, q.mid);
        /* a falling line needs the quadratic below s for an upper bound, a rising one the one above */
        const double um = k.upper_slope <= 0.0 ? q.middle_lo : q.middle_hi;
        const double lm = k.lower_slope <= 0.0 ? q.middle_hi : q.middle_lo;
        const double u0 = k.upper_value - k.upper_slope * k.upper_at;
        const double l0 = k.lower_value - k.lower_slope * k.lower_at;
        up[0][l] += w * (u0 + k.upper_slope * q.sa);
        up[1][l] += w * (u0 + k.upper_slope * um);
        up[2][l] += w * (u0 + k.upper_slope * q.sb);
        down[0][l] += w * (l0 + k.lower_slope * q.sa);
        down[1][l] += w * (l0 + k.lower_slope * lm);
        down[2][l] += w * (l0 + k.lower_slope * q.sb);
        sum->magnitude[l] += size * (k.top + k.steep * (leaf_reach_of(id, q.hi) + e->rounding * rays->magnitude[l]));
    }
}

/* One element's ranges on [a, b]. */
KERNEL_INLINE void leaf_add_slopes(int id, const blob_scene *scene, const packet_rays *restrict rays,
                                   const leaf *restrict e, const leaf_pieces *restrict p, leaf_given given,
                                   const double *restrict a, const double *restrict b, leaf_slopes *restrict sum) {
    const blob_kernel *kernel = &scene->kernels[e->kernel];
    const double w = e->weight, size = fabs(w);
    LANE_ALIGN double ends[2][LANES];
    if (given.lines) {
        lane_store(ends[0], user_at(scene, kernel, lane_load(given.ranges->sa)).value);
        lane_store(ends[1], user_at(scene, kernel, lane_load(given.ranges->sb)).value);
    }
    LANE_SIMD(l) {
        const leaf_range q = given.ranges ? leaf_ranges_at(given.ranges, l) : leaf_range_of(e, p, l, a[l], b[l]);
        const double da = q.slope_lo, db = q.slope_hi;
        double top, bottom, least, steepest; /* range of phi and of phi' */
        if (given.lines) {
            const kernel_lines k = leaf_lines_at(given.lines, l);
            /* the lines' values at both ends: a hull that shrinks with the interval, or no max node could tell
               its children apart and no start on the surface would be decided */
            top = k.upper_value + kernel_max(k.upper_slope * (q.lo - k.upper_at), k.upper_slope * (q.hi - k.upper_at));
            bottom =
                k.lower_value + kernel_min(k.lower_slope * (q.lo - k.lower_at), k.lower_slope * (q.hi - k.lower_at));
            steepest = given.lines->slope_lo[l], least = given.lines->slope_hi[l];
        } else {
            const kernel_jet lo = kernel_value(id, scene, kernel, q.lo), hi = kernel_value(id, scene, kernel, q.hi);
            top = lo.value, bottom = hi.value;
            steepest = lo.slope, least = hi.slope;
        }
        const double fa = w * (given.lines ? ends[0][l] : kernel_value(id, scene, kernel, q.sa).value);
        const double fb = w * (given.lines ? ends[1][l] : kernel_value(id, scene, kernel, q.sb).value);
        /* F' = phi'(s) s': the product of two intervals */
        const double x0 = steepest * da, x1 = steepest * db, x2 = least * da, x3 = least * db;
        const double lo = kernel_min(kernel_min(x0, x1), kernel_min(x2, x3));
        const double hi = kernel_max(kernel_max(x0, x1), kernel_max(x2, x3));
        sum->slope_lo[l] += w >= 0.0 ? w * lo : w * hi;
        sum->slope_hi[l] += w >= 0.0 ? w * hi : w * lo;
        sum->value_lo[l] += w >= 0.0 ? w * bottom : w * top;
        sum->value_hi[l] += w >= 0.0 ? w * top : w * bottom;
        sum->at_a[l] += fa;
        sum->at_b[l] += fb;
        const double steep = kernel_max(fabs(steepest), fabs(least));
        sum->magnitude[l] += size * (kernel_max(fabs(top), fabs(bottom)) +
                                     steep * (leaf_reach_of(id, q.hi) + e->rounding * rays->magnitude[l]));
    }
}

#endif
