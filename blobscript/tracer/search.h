/* search.h - the sandwich: the first crossing of a surface along LANES rays, proved.
 *
 * With F = sign * (field - threshold), sign chosen so that F < 0 at the start, every step looks at one
 * interval [t, b] per ray and at two quadratics L <= F <= U on it (leaf.h, tree.h), with the rounding
 * bound E added to U and taken from L:
 *
 *   U < 0 on all of it       nothing there: go on behind b, with a longer step
 *   U < 0 at t               nothing before U's first root: move there
 *   L >= 0 somewhere at x    a crossing in (t, x]: this bracket replaces the rest of the ray
 *   otherwise                halve, the left half first
 *
 * Both gaps shrink with the square of the interval, so brackets shrink quadratically. Once the slope is
 * of one sign on a bracket it holds exactly one root and Newton's method, kept inside, finishes it.
 * Whatever cannot be told from 0 at the width of a rounding error is passed over and counted as a graze.
 * Nothing is ever called a miss because a counter ran out: every step either proves or halves.
 *
 * A start within E of the surface is decided by monotony: halve [t, t + w] until F' has one sign on it
 * and F(t + w) is beyond E; search from there (numerics.md, section 2, iv). No epsilon in scene units.
 */
#ifndef BLOB_SEARCH_H
#define BLOB_SEARCH_H

#include <float.h>

#include "beam.h"
#include "packet.h"

static const double SEARCH_EPSILON = 8.0 * DBL_EPSILON;

typedef struct search {
    packet p;
    double threshold;
    LANE_ALIGN double sign[LANES];    /* +1 outside, -1 inside, 0 not known yet */
    LANE_ALIGN double step[LANES];    /* next interval to try */
    LANE_ALIGN double ripe[LANES];    /* width of a bracket at which monotony is tried */
    LANE_ALIGN double flat_from[LANES], flat_to[LANES]; /* the last stretch that could not be told from 0 */
    LANE_ALIGN double hit_t[LANES];
    LANE_ALIGN double normal[3][LANES];
    int searching[LANES], bracketed[LANES], hit[LANES], grazed[LANES], from_start[LANES];
    int32_t evaluations[LANES], sandwiches[LANES], fallbacks[LANES];
    double reach; /* typical: the first step */
    int want_normal;
} search;

KERNEL_INLINE double search_rounding(const search *restrict s, double magnitude) {
    return SEARCH_EPSILON * (magnitude + fabs(s->threshold));
}

/* Width below which t cannot be told apart. */
KERNEL_INLINE double search_resolution(const search *restrict s, int l) {
    return 2.0 * DBL_EPSILON * (fabs(s->p.t[l]) + 1e-3 * s->reach);
}

static void search_count(search *restrict s, const int *restrict which) { LANE_LOOP(l) s->evaluations[l] += which[l]; }

/* Lanes at rest get an empty interval far away, so that no leaf is touched on their account. */
static void search_rest(const search *restrict s, const int *restrict active, double *restrict a, double *restrict b) {
    LANE_LOOP(l) {
        a[l] = active[l] ? s->p.t[l] : BLOB_INFINITY;
        b[l] = active[l] ? b[l] : -BLOB_INFINITY;
    }
}

/* ---- start ------------------------------------------------------------------------------- */

/* Signs of lanes that start within E of the surface. */
static void search_start_on_surface(search *restrict s, int *restrict unsure, const double *restrict limit) {
    LANE_ALIGN double width[LANES], a[LANES], b[LANES];
    LANE_LOOP(l) width[l] = kernel_min(limit[l] - s->p.t[l], s->reach);
    for (int left = 1; left;) {
        left = 0;
        LANE_LOOP(l) b[l] = s->p.t[l] + width[l];
        search_rest(s, unsure, a, b);
        leaf_slopes f;
        packet_slopes(&s->p, a, b, &f);
        search_count(s, unsure);
        LANE_LOOP(l) {
            if (!unsure[l]) continue;
            const double e = search_rounding(s, f.magnitude[l]), at_b = f.at_b[l] - s->threshold;
            const int leaves = f.slope_hi[l] < 0.0 && at_b < -e, enters = f.slope_lo[l] > 0.0 && at_b > e;
            const int flat = width[l] <= search_resolution(s, l);
            if (leaves || enters || flat) {
                /* flat: not to be told from the surface; take the side that the end is on */
                s->sign[l] = leaves || (flat && at_b <= 0.0) ? 1.0 : -1.0;
                s->p.t[l] = s->flat_from[l] = s->flat_to[l] = b[l];
                unsure[l] = 0;
            } else {
                width[l] *= 0.5;
                left = 1;
            }
        }
    }
}

/* Is the field above or below the threshold where the ray starts? */
static void search_start(search *restrict s, const double *restrict limit) {
    int need[LANES], unsure[LANES], any = 0;
    LANE_LOOP(l) any |= need[l] = s->searching[l] && s->sign[l] == 0.0 && s->p.t[l] < limit[l];
    if (!any) return;
    LANE_ALIGN double a[LANES], b[LANES];
    LANE_LOOP(l) b[l] = s->p.t[l];
    search_rest(s, need, a, b);
    leaf_point f;
    packet_point(&s->p, a, &f);
    search_count(s, need);
    any = 0;
    LANE_LOOP(l) {
        if (!need[l]) continue;
        const double value = f.value[l] - s->threshold, e = search_rounding(s, f.magnitude[l]);
        unsure[l] = fabs(value) <= e && f.magnitude[l] > 0.0;
        s->sign[l] = value < 0.0 ? 1.0 : -1.0;
        if (value == 0.0 && f.magnitude[l] == 0.0) s->sign[l] = 1.0;
        any |= unsure[l];
    }
    LANE_LOOP(l) unsure[l] = need[l] && unsure[l];
    if (any) search_start_on_surface(s, unsure, limit);
}

/* ---- one step ---------------------------------------------------------------------------- */

/* First root in [0, 1] of the quadratic with Bernstein coefficients c0 < 0, c1, c2; 2 if there is none.
 * With A = c0 - 2 c1 + c2, B = c1 - c0 and D = B^2 - A c0 it is -c0 / (B + sqrt D) = (sqrt D - B) / A: the
 * first form has no cancellation for B >= 0, the second none for B < 0. */
KERNEL_INLINE double search_first_root(double c0, double c1, double c2) {
    const double A = c0 - 2.0 * c1 + c2, B = c1 - c0, D = B * B - A * c0;
    const double root = sqrt(kernel_max(D, 0.0));
    const double over = B >= 0.0 ? -c0 : root - B, under = B >= 0.0 ? B + root : A;
    const double x = over / (under > 0.0 ? under : 1.0);
    const int hull = (c1 >= 0.0) | (c2 >= 0.0);
    return hull & (D >= 0.0) & (under > 0.0) & (x <= 1.0) ? x : 2.0;
}

/* Skip what lies before the next leaf; lanes whose window is done stop. */
static void search_skip_gaps(search *restrict s, const double *restrict limit, int *restrict active) {
    LANE_ALIGN double next[LANES];
    const leaf *leaves = s->p.scratch->leaves;
    LANE_LOOP(l) next[l] = BLOB_INFINITY;
    for (size_t i = 0; i < s->p.leaf_count; i++) {
        const leaf *restrict f = &leaves[i];
        LANE_LOOP(l) next[l] = f->exit[l] > s->p.t[l] ? kernel_min(next[l], f->enter[l]) : next[l];
    }
    LANE_LOOP(l) {
        /* between leaves the field is 0: nothing happens there unless 0 is on the wrong side */
        const int idle = s->sign[l] * s->threshold > 0.0;
        const double from = kernel_max(s->p.t[l], kernel_min(next[l], limit[l]));
        s->p.t[l] = active[l] & idle & !s->bracketed[l] ? from : s->p.t[l];
        active[l] = active[l] & (s->p.t[l] < limit[l]);
    }
}

/* One interval per active lane. */
static void search_step(search *restrict s, const int *restrict active, const double *restrict limit) {
    LANE_ALIGN double a[LANES], b[LANES], rest[LANES];
    LANE_LOOP(l) {
        rest[l] = s->bracketed[l] ? s->p.end[l] : limit[l];
        b[l] = kernel_min(rest[l], s->p.t[l] + s->step[l]);
        a[l] = s->p.t[l];
    }
    search_rest(s, active, a, b);
    leaf_bounds f;
    packet_bounds(&s->p, a, b, &f);
    const double T = s->threshold;
    LANE_LOOP(l) {
        const double e = search_rounding(s, f.magnitude[l]), sign = s->sign[l];
        double u[3], v[3];
        for (int i = 0; i < 3; i++) {
            const double up = f.upper[i][l] - T, down = f.lower[i][l] - T;
            u[i] = (sign > 0.0 ? up : -down) + e;
            v[i] = (sign > 0.0 ? down : -up) - e;
        }
        const double width = b[l] - a[l], resolution = search_resolution(s, l);
        const int negative = (u[0] < 0.0) & (u[1] < 0.0) & (u[2] < 0.0);
        const double root_u = u[0] < 0.0 ? search_first_root(u[0], u[1], u[2]) : 0.0;
        const double root_v = v[0] < 0.0 ? search_first_root(v[0], v[1], v[2]) : 0.0;
        const int empty = negative | (root_u > 1.0), crossing = root_v <= 1.0;
        /* within rounding of 0 all along: to be skipped whole */
        const int flat = (kernel_max(kernel_max(u[0], u[1]), u[2]) <= 3.0 * e) &
                         (kernel_min(kernel_min(v[0], v[1]), v[2]) >= -3.0 * e);
        const int tiny = !empty & !crossing & ((width <= resolution) | flat);
        const double moved = kernel_min(a[l] + width * kernel_min(root_u, 1.0) * (1.0 - 4.0 * DBL_EPSILON), b[l]);
        const double from = empty | tiny ? b[l] : moved;
        const double found = kernel_min(a[l] + width * kernel_min(root_v, 1.0) * (1.0 + 4.0 * DBL_EPSILON), b[l]);
        const double left = (crossing ? found : b[l]) - from;
        const int stalled = left > 0.5 * width;
        const int on = active[l];
        const int skip = on & tiny;
        /* what hangs together with a start on the surface is no graze */
        const int joined = s->flat_to[l] == a[l];
        s->from_start[l] &= joined;
        s->grazed[l] |= skip & !s->from_start[l];
        s->flat_from[l] = skip & !joined ? a[l] : s->flat_from[l];
        s->flat_to[l] = skip ? b[l] : s->flat_to[l];
        s->p.end[l] = on & crossing ? found : s->p.end[l];
        s->bracketed[l] |= on & crossing;
        s->p.t[l] = on ? from : s->p.t[l];
        const double next = empty | tiny ? 2.0 * width : crossing & !stalled ? left : 0.5 * left;
        s->step[l] = on ? kernel_max(next, 0.5 * resolution) : s->step[l];
        s->evaluations[l] += on;
        s->sandwiches[l] += on;
    }
}

/* ---- finish ------------------------------------------------------------------------------ */

static void search_take_hit(search *restrict s, int l, double t) {
    s->hit[l] = 1;
    s->hit_t[l] = t;
    s->searching[l] = 0;
}

/* Newton's method inside brackets [a, b] with F(a) < 0 < F(b) and F' > 0; also gives the normals. */
static void search_polish(search *restrict s, int *restrict which, double *restrict a, double *restrict b,
                          double *restrict t) {
    for (int round = 0; round < 60; round++) {
        LANE_ALIGN double at[LANES];
        LANE_LOOP(l) at[l] = which[l] ? t[l] : BLOB_INFINITY;
        leaf_point f;
        packet_point(&s->p, at, &f);
        search_count(s, which);
        int any = 0;
        LANE_LOOP(l) {
            const double value = s->sign[l] * (f.value[l] - s->threshold);
            const double slope = s->sign[l] * (f.gradient[0][l] * s->p.rays.d[0][l] + f.gradient[1][l] * s->p.rays.d[1][l] +
                                               f.gradient[2][l] * s->p.rays.d[2][l]);
            const double lo = value < 0.0 ? t[l] : a[l], hi = value < 0.0 ? b[l] : t[l];
            const double newton = t[l] - value / (slope != 0.0 ? slope : 1.0);
            const int inside = (slope > 0.0) & (newton >= lo) & (newton <= hi);
            const double next = inside ? newton : 0.5 * (lo + hi);
            const double change = fabs(next - t[l]);
            const int done = (change <= 2.0 * DBL_EPSILON * (fabs(next) + 1e-2 * s->reach)) | (hi <= lo) | (round > 50);
            const int on = which[l];
            if (on) {
                a[l] = lo;
                b[l] = hi;
                t[l] = next;
                for (int i = 0; i < 3; i++) s->normal[i][l] = f.gradient[i][l];
            }
            any |= on & !done;
            which[l] = on & !done;
        }
        if (!any) break;
    }
}

/* Brackets narrow enough: prove that the slope has one sign, then polish. Those that fail get narrower. */
static void search_finish(search *restrict s, int *restrict ripe, int closed) {
    LANE_ALIGN double a[LANES], b[LANES], t[LANES];
    LANE_LOOP(l) {
        /* where F was within rounding of 0 up to here, the root may lie anywhere in that stretch */
        const double from = s->flat_to[l] == s->p.t[l] ? s->flat_from[l] : s->p.t[l];
        a[l] = ripe[l] ? from : BLOB_INFINITY;
        b[l] = ripe[l] ? s->p.end[l] : -BLOB_INFINITY;
    }
    leaf_slopes f;
    packet_slopes(&s->p, a, b, &f);
    search_count(s, ripe);
    int good[LANES], any = 0;
    LANE_LOOP(l) {
        good[l] = 0;
        if (!ripe[l]) continue;
        const double width = b[l] - a[l], sign = s->sign[l];
        const double lo = sign > 0.0 ? f.slope_lo[l] : -f.slope_hi[l];
        if (lo > 0.0 || closed || s->p.end[l] - s->p.t[l] <= search_resolution(s, l)) {
            const double fa = sign * (f.at_a[l] - s->threshold), fb = sign * (f.at_b[l] - s->threshold);
            const double share = fa < 0.0 && fb > 0.0 ? -fa / (fb - fa) : fb <= 0.0 ? 1.0 : 0.0;
            t[l] = a[l] + share * width;
            good[l] = 1;
            any = 1;
        } else {
            s->ripe[l] = 0.125 * (s->p.end[l] - s->p.t[l]);
        }
    }
    if (!any) return;
    int which[LANES];
    LANE_LOOP(l) which[l] = good[l];
    search_polish(s, which, a, b, t);
    LANE_LOOP(l) if (good[l]) search_take_hit(s, l, t[l]);
}

/* Search up to `known`: every leaf that begins before it is in the packet. */
static void search_advance(search *restrict s, double known) {
    LANE_ALIGN double limit[LANES];
    int active[LANES];
    LANE_LOOP(l) limit[l] = kernel_min(known, s->p.end[l]);
    search_start(s, limit);
    for (;;) {
        int any = 0, ripe[LANES], any_ripe = 0, any_wide = 0;
        LANE_LOOP(l) active[l] = s->searching[l] & (s->sign[l] != 0.0) & (s->p.t[l] < limit[l]);
        search_skip_gaps(s, limit, active);
        LANE_LOOP(l) {
            any |= active[l];
            limit[l] = s->bracketed[l] ? s->p.end[l] : limit[l];
            ripe[l] = active[l] & s->bracketed[l] &
                      (s->p.end[l] - s->p.t[l] <= kernel_max(s->ripe[l], search_resolution(s, l)));
            any_ripe |= ripe[l];
            any_wide |= active[l] & !ripe[l];
        }
        if (!any) break;
        if (any_wide) {
            LANE_LOOP(l) active[l] &= !ripe[l];
            search_step(s, active, limit);
        } else if (any_ripe) {
            search_finish(s, ripe, 0);
        }
        LANE_LOOP(l) {
            limit[l] = s->bracketed[l] ? s->p.end[l] : limit[l];
        }
        /* brackets that closed up without a proof of monotony: the crossing is there */
        any_ripe = 0;
        LANE_LOOP(l) any_ripe |= ripe[l] = s->searching[l] & s->bracketed[l] & (s->p.t[l] >= s->p.end[l]);
        if (any_ripe) search_finish(s, ripe, 1);
    }
    LANE_LOOP(l) {
        if (s->searching[l] && s->p.t[l] >= s->p.end[l]) s->searching[l] = 0;
    }
}

#endif
