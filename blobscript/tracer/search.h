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
 * A start within E of the surface is decided by where F goes: halve [t, t + w] until F(t + w) is beyond E, and on the
 * way there F' lets it come no farther than E to the other side (numerics.md, section 2, iv, where F' has one sign; at
 * a crease it may have two). Search from there. No epsilon in scene units.
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
    LANE_ALIGN double sign[LANES];                      /* +1 outside, -1 inside, 0 not known yet */
    LANE_ALIGN double step[LANES];                      /* next interval to try */
    LANE_ALIGN double ripe[LANES];                      /* width of a bracket at which monotony is tried */
    LANE_ALIGN double flat_from[LANES], flat_to[LANES]; /* the last stretch that could not be told from 0 */
    LANE_ALIGN double hit_t[LANES];
    LANE_ALIGN double normal[3][LANES];
    LANE_ALIGN lane_flag searching[LANES], bracketed[LANES], hit[LANES], grazed[LANES], from_start[LANES];
    LANE_ALIGN lane_flag closes[LANES]; /* the window ends with the ray's own t_max, which belongs to it */
    LANE_ALIGN int64_t evaluations[LANES], sandwiches[LANES], fallbacks[LANES];
    LANE_ALIGN int64_t spent[LANES]; /* sandwiches before this span */
    double reach;                    /* typical: the first step */
    int32_t strategy;                /* BLOB_SEARCH_* */
    double tolerance, stride;        /* of the query, packed; 0: the default of the strategy */
    const volatile int32_t *cancel;  /* may be NULL */
} search;

KERNEL_INLINE double search_rounding(const search *restrict s, double magnitude) {
    return SEARCH_EPSILON * (magnitude + fabs(s->threshold));
}

/* Width below which t cannot be told apart. */
KERNEL_INLINE double search_resolution(const search *restrict s, int l) {
    return 2.0 * DBL_EPSILON * (fabs(s->p.t[l]) + 1e-3 * s->reach);
}

static void search_count(search *restrict s, const lane_flag *restrict which) {
    LANE_SIMD(l) s->evaluations[l] -= which[l];
}

/* Lanes at rest get an empty interval far away, so that no leaf is touched on their account. */
static void search_rest(const search *restrict s, const lane_flag *restrict active, double *restrict a,
                        double *restrict b) {
    LANE_SIMD(l) {
        const double t = s->p.t[l], to = b[l];
        a[l] = active[l] ? t : BLOB_INFINITY;
        b[l] = active[l] ? to : -BLOB_INFINITY;
    }
}

/* ---- start ------------------------------------------------------------------------------- */

/* Signs of lanes that start within E, `rounding`, of the surface. */
static void search_start_on_surface(search *restrict s, lane_flag *restrict unsure, const double *restrict rounding,
                                    const double *restrict limit) {
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
            const double e = search_rounding(s, f.magnitude[l]);
            const double at_a = f.at_a[l] - s->threshold, at_b = f.at_b[l] - s->threshold;
            const double rise = width[l] * f.slope_hi[l], fall = width[l] * f.slope_lo[l];
            const int leaves = at_b < -e && (rise < 0.0 || at_a + rise <= rounding[l]);
            const int enters = at_b > e && (fall > 0.0 || at_a + fall >= -rounding[l]);
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
    LANE_ALIGN lane_flag need[LANES], unsure[LANES];
    lane_flag any = 0;
    LANE_LOOP(l) any |= need[l] = s->searching[l] && s->sign[l] == 0.0 && s->p.t[l] < limit[l] ? -1 : 0;
    if (!any) return;
    LANE_ALIGN double a[LANES], b[LANES], rounding[LANES];
    LANE_LOOP(l) b[l] = s->p.t[l];
    search_rest(s, need, a, b);
    leaf_point f;
    packet_point(&s->p, a, &f);
    search_count(s, need);
    any = 0;
    LANE_LOOP(l) {
        if (!need[l]) continue;
        const double value = f.value[l] - s->threshold;
        rounding[l] = search_rounding(s, f.magnitude[l]);
        unsure[l] = fabs(value) <= rounding[l] && f.magnitude[l] > 0.0 ? -1 : 0;
        s->sign[l] = value < 0.0 ? 1.0 : -1.0;
        if (value == 0.0 && f.magnitude[l] == 0.0) s->sign[l] = 1.0;
        any |= unsure[l];
    }
    LANE_LOOP(l) unsure[l] = need[l] ? unsure[l] : 0;
    if (any) search_start_on_surface(s, unsure, rounding, limit);
}

/* ---- one step ---------------------------------------------------------------------------- */

/* First root in [0, 1] of the quadratic with Bernstein coefficients c0 < 0, c1, c2; 2 if there is none.
 * With A = c0 - 2 c1 + c2, B = c1 - c0 and D = B^2 - A c0 it is -c0 / (B + sqrt D) = (sqrt D - B) / A: the
 * first form has no cancellation for B >= 0, the second none for B < 0. */
LANE_INLINE lane_real search_first_root(lane_real c0, lane_real c1, lane_real c2) {
    const lane_real A = c0 - 2.0 * c1 + c2, B = c1 - c0, D = B * B - A * c0;
    const lane_mask real = D >= 0.0, rising = B >= 0.0;
    const lane_real root = lane_sqrt(lane_select(real, D, lane_all(0.0)));
    const lane_real over = lane_select(rising, -c0, root - B), under = lane_select(rising, B + root, A);
    const lane_mask positive = under > 0.0;
    const lane_real x = over / lane_select(positive, under, lane_all(1.0));
    const lane_mask hull = (c1 >= 0.0) | (c2 >= 0.0);
    return lane_select(hull & real & positive & (x <= 1.0), x, lane_all(2.0));
}

/* Skip what lies before the next leaf; lanes whose window is done stop. */
static void search_skip_gaps(search *restrict s, const double *restrict limit, lane_flag *restrict active) {
    const leaf *leaves = s->p.scratch->leaves;
    const lane_real t = lane_load(s->p.t), end = lane_load(limit), far = lane_all(BLOB_INFINITY);
    lane_real next = far;
    for (size_t i = 0; i < s->p.leaf_count; i++) {
        const leaf *f = &leaves[i];
        next = lane_min(next, lane_select(lane_load(f->exit) > t, lane_load(f->enter), far));
    }
    /* between leaves the field is 0: nothing happens there unless 0 is on the wrong side */
    const lane_mask on = lane_load_mask(active);
    const lane_mask idle = on & ~lane_load_mask(s->bracketed) & (lane_load(s->sign) * s->threshold > 0.0);
    const lane_real now = lane_select(idle, lane_max(t, lane_min(next, end)), t);
    lane_store(s->p.t, now);
    lane_store_mask(active, on & (now < end));
}

/* What a look at the interval [from, to] told of the lanes `on`. */
typedef struct search_verdict {
    lane_mask on, empty, crossing, flat; /* flat: within rounding of 0 all along, to be skipped whole */
    lane_real from, to;
    lane_real moved;  /* not empty: nothing before it */
    lane_real found;  /* crossing: F > 0 there */
    lane_real longer; /* the next step, where nothing was there */
} search_verdict;

/* Intervals to look at: [t, t + step] of active lanes, cut at limit; empty ones far away for the others. */
LANE_INLINE search_verdict search_interval(const search *restrict s, const lane_flag *restrict active,
                                           const double *restrict limit) {
    search_verdict v;
    const lane_real t = lane_load(s->p.t), far = lane_all(BLOB_INFINITY);
    v.on = lane_load_mask(active);
    v.from = lane_select(v.on, t, far);
    v.to = lane_select(v.on, lane_min(lane_load(limit), t + lane_load(s->step)), -far);
    return v;
}

/* Go on behind the interval, or to a narrower one. */
LANE_INLINE void search_settle(search *restrict s, search_verdict v) {
    const lane_mask on = v.on;
    const lane_real from = v.from, to = v.to, width = to - from;
    const lane_real resolution = 2.0 * DBL_EPSILON * (lane_abs(from) + 1e-3 * s->reach);
    const lane_mask skip = on & ~v.empty & ~v.crossing & ((width <= resolution) | v.flat), behind = v.empty | skip;
    const lane_mask crosses = on & v.crossing;
    const lane_real now = lane_select(behind, to, v.moved), left = lane_select(v.crossing, v.found, to) - now;
    const lane_mask shrunk = v.crossing & (left <= 0.5 * width);
    const lane_real next = lane_select(behind, v.longer, lane_select(shrunk, left, 0.5 * left));
    /* what hangs together with a start on the surface is no graze */
    const lane_mask joined = lane_load(s->flat_to) == from;
    const lane_mask from_start = lane_load_mask(s->from_start) & (~on | joined);
    lane_store_mask(s->from_start, from_start);
    lane_store_mask(s->grazed, lane_load_mask(s->grazed) | (skip & ~from_start));
    lane_store_mask(s->bracketed, lane_load_mask(s->bracketed) | crosses);
    lane_store(s->flat_from, lane_select(skip & ~joined, from, lane_load(s->flat_from)));
    lane_store(s->flat_to, lane_select(skip, to, lane_load(s->flat_to)));
    lane_store(s->p.end, lane_select(crosses, v.found, lane_load(s->p.end)));
    lane_store(s->p.t, lane_select(on, now, lane_load(s->p.t)));
    lane_store(s->step, lane_select(on, lane_max(next, 0.5 * resolution), lane_load(s->step)));
    lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - on);
}

/* One interval per active lane, by quadratics. */
static void search_step(search *restrict s, const lane_flag *restrict active, const double *restrict limit) {
    LANE_ALIGN double interval_a[LANES], interval_b[LANES];
    search_verdict o = search_interval(s, active, limit);
    lane_store(interval_a, o.from);
    lane_store(interval_b, o.to);
    leaf_bounds f;
    packet_bounds(&s->p, interval_a, interval_b, &f);

    /* F <= u and F >= v on the interval, rounding included */
    const double T = s->threshold;
    const lane_real e = SEARCH_EPSILON * (lane_load(f.magnitude) + fabs(T)), width = o.to - o.from;
    const lane_mask out = lane_load(s->sign) > 0.0;
    lane_real u[3], v[3];
    for (int i = 0; i < 3; i++) {
        const lane_real up = lane_load(f.upper[i]) - T, down = lane_load(f.lower[i]) - T;
        u[i] = lane_select(out, up, -down) + e;
        v[i] = lane_select(out, down, -up) - e;
    }
    const lane_real none = lane_all(0.0);
    const lane_real root_u = lane_select(u[0] < 0.0, search_first_root(u[0], u[1], u[2]), none);
    const lane_real root_v = lane_select(v[0] < 0.0, search_first_root(v[0], v[1], v[2]), none);
    o.empty = root_u > 1.0;
    o.crossing = root_v <= 1.0;
    o.flat = (lane_max(lane_max(u[0], u[1]), u[2]) <= 3.0 * e) & (lane_min(lane_min(v[0], v[1]), v[2]) >= -3.0 * e);
    o.moved = lane_min(o.from + width * root_u * (1.0 - 4.0 * DBL_EPSILON), o.to);
    o.found = lane_min(o.from + width * root_v * (1.0 + 4.0 * DBL_EPSILON), o.to);
    o.longer = 2.0 * width;
    search_settle(s, o);
    lane_store_mask(s->sandwiches, lane_load_mask(s->sandwiches) - o.on);
}

/* ---- finish ------------------------------------------------------------------------------ */

/* Newton's method inside brackets [a, b] with F(a) < 0 < F(b) and F' > 0; also gives the normals. A step that is
 * more than half of the last but one is not taken, the bracket is halved instead: an exponential would be climbed
 * down by steps of one and the same length, and about a crease it may swing for ever. */
static void search_polish(search *restrict s, lane_mask on, lane_real a, lane_real b, lane_real *t) {
    const lane_real sign = lane_load(s->sign), dx = lane_load(s->p.rays.d[0]), dy = lane_load(s->p.rays.d[1]),
                    dz = lane_load(s->p.rays.d[2]), far = lane_all(BLOB_INFINITY);
    lane_real last = b - a, last_but_one = last;
    for (int round = 0; round < 200 && lane_any(on); round++) {
        LANE_ALIGN double at[LANES];
        const lane_real now = *t;
        lane_store(at, lane_select(on, now, far));
        leaf_point f;
        packet_point(&s->p, at, &f);
        lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - on);
        const lane_real gx = lane_load(f.gradient[0]), gy = lane_load(f.gradient[1]), gz = lane_load(f.gradient[2]);
        const lane_real value = sign * (lane_load(f.value) - s->threshold),
                        slope = sign * (gx * dx + gy * dy + gz * dz);
        const lane_mask before = value < 0.0;
        const lane_real lo = lane_select(before, now, a), hi = lane_select(before, b, now);
        const lane_mask rising = slope > 0.0;
        const lane_real newton = now - value / lane_select(rising, slope, lane_all(1.0));
        const lane_mask shorter = lane_abs(newton - now) <= 0.5 * last_but_one;
        const lane_mask inside = rising & shorter & (newton >= lo) & (newton <= hi);
        const lane_real next = lane_select(inside, newton, 0.5 * (lo + hi));
        const lane_real enough =
            lane_max(2.0 * DBL_EPSILON * (lane_abs(next) + 1e-2 * s->reach), lane_all(s->tolerance));
        const lane_mask done = (lane_abs(next - now) <= enough) | (hi <= lo);
        a = lane_select(on, lo, a);
        b = lane_select(on, hi, b);
        last_but_one = last;
        last = lane_abs(next - now);
        *t = lane_select(on, next, now);
        lane_store(s->normal[0], lane_select(on, gx, lane_load(s->normal[0])));
        lane_store(s->normal[1], lane_select(on, gy, lane_load(s->normal[1])));
        lane_store(s->normal[2], lane_select(on, gz, lane_load(s->normal[2])));
        on &= ~done;
    }
}

/* Brackets narrow enough: prove that the slope has one sign, then polish. Those that fail get narrower.
 * closed: nothing is left to narrow, the crossing is there. */
static void search_finish(search *restrict s, lane_mask ripe, int closed) {
    LANE_ALIGN double at_a[LANES], at_b[LANES];
    const lane_real t = lane_load(s->p.t), end = lane_load(s->p.end), far = lane_all(BLOB_INFINITY);
    /* where F was within rounding of 0 up to here, the root may lie anywhere in that stretch */
    const lane_real from = lane_select(lane_load(s->flat_to) == t, lane_load(s->flat_from), t);
    const lane_real a = lane_select(ripe, from, far), b = lane_select(ripe, end, -far);
    lane_store(at_a, a);
    lane_store(at_b, b);
    leaf_slopes f;
    packet_slopes(&s->p, at_a, at_b, &f);
    lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - ripe);
    const lane_real sign = lane_load(s->sign);
    const lane_real slope = lane_select(sign > 0.0, lane_load(f.slope_lo), -lane_load(f.slope_hi));
    const lane_real resolution = 2.0 * DBL_EPSILON * (lane_abs(t) + 1e-3 * s->reach);
    lane_mask one = ripe;
    if (!closed) one &= (slope > 0.0) | (end - t <= resolution);
    lane_store(s->ripe, lane_select(ripe & ~one, 0.125 * (end - t), lane_load(s->ripe)));
    if (!lane_any(one)) return;
    const lane_real fa = sign * (lane_load(f.at_a) - s->threshold), fb = sign * (lane_load(f.at_b) - s->threshold);
    const lane_mask change = (fa < 0.0) & (fb > 0.0);
    const lane_real share = lane_select(change, -fa / lane_select(change, fb - fa, lane_all(1.0)),
                                        lane_select(fb <= 0.0, lane_all(1.0), lane_all(0.0)));
    lane_real hit = a + share * (b - a);
    search_polish(s, one, a, b, &hit);
    lane_store(s->hit_t, lane_select(one, hit, lane_load(s->hit_t)));
    lane_store_mask(s->hit, lane_load_mask(s->hit) | one);
    lane_store_mask(s->searching, lane_load_mask(s->searching) & ~one);
}

/* Lanes whose window ends within the rounding bound of the surface: where F rises there and has come to 0 but
 * for what one evaluation is off (some sixteenth of the bound for intervals), t_max is the crossing. */
static void search_end(search *restrict s, lane_mask on) {
    LANE_ALIGN double at_a[LANES], at_b[LANES];
    const lane_real far = lane_all(BLOB_INFINITY), from = lane_load(s->flat_from), end = lane_load(s->p.end);
    const lane_real a = lane_select(on, from, far), b = lane_select(on, end, -far);
    lane_store(at_a, a);
    lane_store(at_b, b);
    leaf_slopes f;
    packet_slopes(&s->p, at_a, at_b, &f);
    lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - on);
    const lane_mask out = lane_load(s->sign) > 0.0;
    const lane_real value = lane_load(f.at_b) - s->threshold,
                    e = SEARCH_EPSILON * (lane_load(f.magnitude) + fabs(s->threshold));
    on &= lane_select(out, lane_load(f.slope_lo), -lane_load(f.slope_hi)) > 0.0;
    on &= lane_select(out, value, -value) >= -0.0625 * e;
    if (!lane_any(on)) return;
    lane_real hit = b;
    search_polish(s, on, a, b, &hit);
    lane_store(s->hit_t, lane_select(on, hit, lane_load(s->hit_t)));
    lane_store_mask(s->hit, lane_load_mask(s->hit) | on);
}

typedef void (*search_stepper)(search *restrict s, const lane_flag *restrict active, const double *restrict limit);

/* Search up to `known`: every leaf that begins before it is in the packet. */
LANE_INLINE void search_advance(search *restrict s, double known, search_stepper step) {
    LANE_ALIGN double limit[LANES];
    LANE_ALIGN lane_flag active[LANES];
    lane_store(limit, lane_min(lane_all(known), lane_load(s->p.end)));
    search_start(s, limit);
    lane_store_mask(s->spent, lane_load_mask(s->sandwiches));
    for (;;) {
        if (s->cancel && *s->cancel) { /* nothing that these rays say will be used */
            lane_store_mask(s->searching, (lane_mask){0});
            return;
        }
        const lane_mask searching = lane_load_mask(s->searching);
        lane_store_mask(active, searching & (lane_load(s->sign) != 0.0) & (lane_load(s->p.t) < lane_load(limit)));
        search_skip_gaps(s, limit, active);
        const lane_real t = lane_load(s->p.t), width = lane_load(s->p.end) - t;
        const lane_real resolution = 2.0 * DBL_EPSILON * (lane_abs(t) + 1e-3 * s->reach);
        const lane_mask narrow = width <= lane_max(lane_load(s->ripe), resolution);
        const lane_mask on = lane_load_mask(active), ripe = on & lane_load_mask(s->bracketed) & narrow,
                        wide = on & ~ripe;
        lane_store_mask(active, wide);
        if (lane_any(wide)) step(s, active, limit);
        else if (lane_any(ripe)) search_finish(s, ripe, 0);
        else break;
        /* brackets that closed up without a proof of monotony: the crossing is there */
        const lane_mask bracketed = lane_load_mask(s->bracketed);
        const lane_real end = lane_load(s->p.end);
        lane_store(limit, lane_select(bracketed, end, lane_load(limit)));
        const lane_mask closed = lane_load_mask(s->searching) & bracketed & (lane_load(s->p.t) >= end);
        if (lane_any(closed)) search_finish(s, closed, 1);
    }
    const lane_real t = lane_load(s->p.t);
    const lane_mask over = lane_load_mask(s->searching) & (t >= lane_load(s->p.end));
    const lane_mask touches =
        over & lane_load_mask(s->closes) & ~lane_load_mask(s->from_start) & (lane_load(s->flat_to) == t);
    if (lane_any(touches)) search_end(s, touches);
    lane_store_mask(s->searching, lane_load_mask(s->searching) & ~over);
}

#endif
