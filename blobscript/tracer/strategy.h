/* strategy.h - other ways to search along a ray than the sandwich of search.h.
 *
 *   interval    ranges of value and slope over an interval; halve what they cannot decide. Misses nothing.
 *   bernstein   coefficients of degree 6 (bernstein.h). Misses nothing. The sandwich falls back on it where it
 *               does not get on and large densities may cancel.
 *   segment     steps of -F / K with K the largest slope of F on the segment ahead; the next segment is half as
 *               long again as the step (Galin, Guerin, Paris and Peytavie, Segment tracing using local
 *               Lipschitz bounds, 2020)
 *   sphere      steps of -F / L with L the largest slope anywhere, global over the window: the sum of
 *               |w| max|D'| / R over the elements that touch it (Hart, Sphere tracing, 1996)
 *   march       a look at F every `step`, bisection between two looks of different sign
 *
 * Segment and sphere never pass a crossing, but stop where a step gets shorter than the tolerance and call that
 * a hit: wrong where a ray comes that near and passes, or where F is small and steep. Where a ray starts that near,
 * they go on by one tolerance at a time until they are away. March sees nothing thinner than its step.
 * `s->tolerance` and `s->stride` of 0 mean the defaults below.
 */
#ifndef BLOB_STRATEGY_H
#define BLOB_STRATEGY_H

#include "search.h"

/* In typical reaches: where segment and sphere stop, and how far march looks ahead. */
static const double STRATEGY_TOLERANCE = 1e-9, STRATEGY_STRIDE = 0.05;
/* Looks per ray and span after which sphere and segment leave the rest to the sandwich (a ray that runs along a
 * surface at a distance just above the tolerance takes a thousand million), and sandwiches per ray and span after
 * which Bernstein coefficients go on: all but a few in a million need fewer than 20. */
enum { STRATEGY_PATIENCE = 100000, STRATEGY_SANDWICHES = 24 };

/* ---- interval -------------------------------------------------------------------------------- */

/* The highest that F can be on an interval of width h, with values fa and fb at its ends and slopes in [least, most]:
 * where the steepest lines from both ends meet. */
LANE_INLINE lane_real interval_peak(lane_real fa, lane_real fb, lane_real h, lane_real least, lane_real most) {
    const lane_mask rising = least >= 0.0, falling = most <= 0.0;
    const lane_real gap = lane_select(rising | falling, lane_all(1.0), most - least);
    const lane_real x = lane_min(lane_max((fb - fa - least * h) / gap, lane_all(0.0)), h);
    const lane_real meet = lane_max(fa + most * x, fb - least * (h - x)) + 4.0 * DBL_EPSILON * (most - least) * h;
    return lane_select(rising, fb, lane_select(falling, fa, meet));
}

/* One interval per active lane. */
static void interval_step(search *restrict s, const lane_flag *restrict active, const double *restrict limit) {
    LANE_ALIGN double at_a[LANES], at_b[LANES];
    search_verdict v = search_interval(s, active, limit);
    lane_store(at_a, v.from);
    lane_store(at_b, v.to);
    leaf_slopes f;
    packet_slopes(&s->p, at_a, at_b, &f);

    const double T = s->threshold;
    const lane_real e = SEARCH_EPSILON * (lane_load(f.magnitude) + fabs(T));
    const lane_real sign = lane_load(s->sign), h = v.to - v.from;
    const lane_mask out = sign > 0.0;
    const lane_real lo = lane_select(out, lane_load(f.value_lo) - T, T - lane_load(f.value_hi));
    const lane_real hi = lane_select(out, lane_load(f.value_hi) - T, T - lane_load(f.value_lo));
    const lane_real least = lane_select(out, lane_load(f.slope_lo), -lane_load(f.slope_hi));
    const lane_real most = lane_select(out, lane_load(f.slope_hi), -lane_load(f.slope_lo));
    const lane_real fa = sign * (lane_load(f.at_a) - T), fb = sign * (lane_load(f.at_b) - T);
    const lane_real highest = lane_min(hi, interval_peak(fa, fb, h, least, most));
    const lane_real lowest = lane_max(lo, -interval_peak(-fa, -fb, h, -most, -least));

    v.empty = highest < -e;
    v.crossing = fb > e;
    v.flat = (highest <= 2.0 * e) & (lowest >= -2.0 * e);
    v.moved = v.from;
    v.found = v.to;
    v.longer = 2.0 * h;
    /* one crossing, known already: nothing to narrow */
    const lane_mask crosses = v.on & v.crossing & ~v.empty;
    lane_store(s->ripe, lane_select(crosses, lane_select(least > 0.0, h, 0.5 * h), lane_load(s->ripe)));
    search_settle(s, v);
}

/* ---- bernstein --------------------------------------------------------------------------------- */

static void bernstein_leaf(const packet *restrict p, const leaf *restrict f, const double *restrict a,
                           const double *restrict b, bernstein_bounds *restrict sum) {
    const leaf_pieces *pieces = f->pieces >= 0 ? &p->scratch->pieces[f->pieces] : NULL;
    if (bernstein_exact(f, pieces, a, b)) {
        switch (f->id) {
            case KERNEL_SOFT2: bernstein_add(KERNEL_SOFT2, &p->rays, f, pieces, a, b, sum); break;
            case KERNEL_SOFT3: bernstein_add(KERNEL_SOFT3, &p->rays, f, pieces, a, b, sum); break;
            default: bernstein_add(KERNEL_WYVILL, &p->rays, f, pieces, a, b, sum); break;
        }
        return;
    }
    leaf_bounds own;
    LANE_CLEAR(&own);
    packet_leaf_bounds(p, f, a, b, &own);
    bernstein_raise(&own, sum);
}

static int bernstein_join_open(const packet *restrict p, size_t first, const double *restrict a,
                               const double *restrict b, bernstein_bounds *restrict into) {
    leaf_bounds own;
    tree_join_bounds_open(p, first, a, b, &own);
    bernstein_raise(&own, into);
    return 1;
}
#define bernstein_join_joint(op, children, count, a, b, into) (void)0
PACKET_SUM(bernstein_of, bernstein_bounds, bernstein_leaf, bernstein_join)
PACKET_STEPS(bernstein_of, bernstein_bounds, bernstein_leaf, bernstein_join)
PACKET_EVALUATE(bernstein_of, bernstein_bounds)

LANE_INLINE lane_real bernstein_event(lane_real event, lane_real t, lane_real next) {
    return lane_select((event > t) & (event < next), event, next);
}

/* Where the next density behind t begins, ends or gets another quadratic, but `to` at the latest. What begins or ends
 * in the first part of the way is bounded like other kernels: many events close together cost one interval. */
static lane_real bernstein_until(const packet *restrict p, lane_real t, lane_real to) {
    const lane_real near = t + (to - t) * (1.0 / 64.0);
    for (size_t i = 0; i < p->leaf_count; i++) {
        const leaf *f = &p->scratch->leaves[i];
        if (f->set != SET_NONE || !bernstein_has(f->id)) continue;
        to = bernstein_event(lane_load(f->enter), near, to);
        to = bernstein_event(lane_load(f->exit), near, to);
        if (f->pieces < 0) continue;
        to = bernstein_event(lane_load(p->scratch->pieces[f->pieces].first), near, to);
        to = bernstein_event(lane_load(p->scratch->pieces[f->pieces].second), near, to);
    }
    return to;
}

/* Where the hull of the control points (i / 6, c[i]), c[0] < 0, first reaches 0: nothing of the polynomial does
 * before. 2 if it never does. */
static lane_real bernstein_first(const lane_real *c) {
    lane_real first = lane_all(2.0);
    for (int i = 1; i < BERNSTEIN_COUNT; i++) {
        for (int j = 0; j < i; j++) {
            const lane_mask rises = (c[j] < 0.0) & (c[i] >= 0.0);
            const lane_real share = -c[j] / lane_select(rises, c[i] - c[j], lane_all(1.0));
            const lane_real x = ((double)j + (double)(i - j) * share) * (1.0 / BERNSTEIN_DEGREE);
            first = lane_select(rises, lane_min(first, x), first);
        }
    }
    return first;
}

/* One interval per active lane. */
static void bernstein_step(search *restrict s, const lane_flag *restrict active, const double *restrict limit) {
    LANE_ALIGN double at_a[LANES], at_b[LANES];
    search_verdict o = search_interval(s, active, limit);
    const lane_real whole = o.to;
    o.to = lane_select(o.on, bernstein_until(&s->p, o.from, whole), whole);
    lane_store(at_a, o.from);
    lane_store(at_b, o.to);
    bernstein_bounds f;
    bernstein_of(&s->p, at_a, at_b, &f);

    const double T = s->threshold;
    const lane_real e = SEARCH_EPSILON * (lane_load(f.magnitude) + fabs(T)), width = o.to - o.from;
    const lane_mask out = lane_load(s->sign) > 0.0;
    lane_real u[BERNSTEIN_COUNT], v[BERNSTEIN_COUNT], highest = -lane_all(BLOB_INFINITY), lowest = -highest;
    for (int i = 0; i < BERNSTEIN_COUNT; i++) {
        const lane_real up = lane_load(f.upper[i]) - T, down = lane_load(f.lower[i]) - T;
        u[i] = lane_select(out, up, -down) + e;
        v[i] = lane_select(out, down, -up) - e;
        highest = lane_max(highest, u[i]);
        lowest = lane_min(lowest, v[i]);
    }
    const lane_real first = lane_select(u[0] < 0.0, bernstein_first(u), lane_all(0.0));
    const lane_real middle = ((v[0] + v[6]) + 6.0 * (v[1] + v[5]) + 15.0 * (v[2] + v[4]) + 20.0 * v[3]) / 64.0;
    const lane_mask half = middle > 0.0;
    o.empty = highest < 0.0;
    o.crossing = half | (v[6] > 0.0);
    o.flat = (highest <= 3.0 * e) & (lowest >= -3.0 * e);
    o.moved = lane_min(o.from + width * first * (1.0 - 16.0 * DBL_EPSILON), o.to);
    o.found = lane_select(half, lane_min(o.from + 0.5 * width, o.to), o.to);
    o.moved = lane_min(o.moved, o.found); /* rounding alone can exchange them */
    /* an interval that an event has cut short says nothing about how long the next may be */
    o.longer = lane_select(o.to < whole, lane_load(s->step), 2.0 * width);
    search_settle(s, o);
}

/* ---- sandwich ---------------------------------------------------------------------------------- */

/* Are there densities of both signs that Bernstein coefficients sum before they are bounded? */
static int sandwich_cancels(const packet *restrict p) {
    int above = 0, below = 0;
    for (size_t i = 0; i < p->leaf_count; i++) {
        const leaf *f = &p->scratch->leaves[i];
        if (f->set != SET_NONE || !bernstein_has(f->id)) continue;
        above |= f->weight > 0.0;
        below |= f->weight < 0.0;
    }
    return above & below;
}

/* The sandwich, as long as it gets on. */
static void sandwich_step(search *restrict s, const lane_flag *restrict active, const double *restrict limit) {
    const lane_mask on = lane_load_mask(active);
    const lane_mask stuck = on & (lane_load_mask(s->sandwiches) - lane_load_mask(s->spent) >= STRATEGY_SANDWICHES);
    if (!lane_any(stuck) || !sandwich_cancels(&s->p)) {
        search_step(s, active, limit);
        return;
    }
    lane_store_mask(s->fallbacks, lane_load_mask(s->fallbacks) - on);
    bernstein_step(s, active, limit);
}

/* ---- looks at places ------------------------------------------------------------------------------ */

/* F and its gradient at t (+inf where off). */
static lane_real strategy_look(search *restrict s, lane_mask on, lane_real t, leaf_point *restrict f) {
    LANE_ALIGN double at[LANES];
    lane_store(at, lane_select(on, t, lane_all(BLOB_INFINITY)));
    packet_point(&s->p, at, f);
    lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - on);
    return lane_load(s->sign) * (lane_load(f->value) - s->threshold);
}

/* Hits at t, where f was looked at. */
static void strategy_hit(search *restrict s, lane_mask on, lane_real t, const leaf_point *restrict f) {
    lane_store(s->hit_t, lane_select(on, t, lane_load(s->hit_t)));
    for (int k = 0; k < 3; k++)
        lane_store(s->normal[k], lane_select(on, lane_load(f->gradient[k]), lane_load(s->normal[k])));
    lane_store_mask(s->hit, lane_load_mask(s->hit) | on);
    lane_store_mask(s->searching, lane_load_mask(s->searching) & ~on);
}

/* Where the search stands: behind gaps, lanes with anything left before limit. */
static lane_mask strategy_active(search *restrict s, const double *restrict limit) {
    LANE_ALIGN lane_flag active[LANES];
    const lane_mask on =
        lane_load_mask(s->searching) & (lane_load(s->sign) != 0.0) & (lane_load(s->p.t) < lane_load(limit));
    lane_store_mask(active, on);
    search_skip_gaps(s, limit, active);
    return lane_load_mask(active);
}

LANE_INLINE lane_real strategy_resolution(const search *restrict s, lane_real t) {
    return 2.0 * DBL_EPSILON * (lane_abs(t) + 1e-3 * s->reach);
}

/* How near a step must end: never below what t can tell apart. */
LANE_INLINE lane_real strategy_tolerance(const search *restrict s, lane_real t, double standard) {
    return lane_max(lane_all(s->tolerance > 0.0 ? s->tolerance : standard), strategy_resolution(s, t));
}

static int strategy_cancelled(const search *restrict s) { return s->cancel && *s->cancel; }

/* From t, where F was looked at, on by a step, up to limit; a hit where that is too short. */
static void strategy_walk(search *restrict s, const double *restrict limit, lane_mask on, lane_real step, lane_real F,
                          const double *magnitude) {
    const lane_real t = lane_load(s->p.t), least = strategy_tolerance(s, t, STRATEGY_TOLERANCE * s->reach);
    const lane_mask away = lane_load_mask(s->from_start) == 0, small = step < least;
    lane_store_mask(s->from_start, lane_load_mask(s->from_start) & ~(on & ~small));
    const lane_real e = SEARCH_EPSILON * (lane_load(magnitude) + fabs(s->threshold));
    const lane_mask stops = on & ((F > e) | (away & small));
    const lane_real next = lane_min(t + lane_max(step, least), lane_load(limit));
    lane_store(s->p.t, lane_select(on & ~stops, next, t));
    if (!lane_any(stops)) return;
    leaf_point f;
    strategy_look(s, stops, t, &f);
    strategy_hit(s, stops, t, &f);
}

/* ---- sphere ---------------------------------------------------------------------------------------- */

/* How much steeper than an element the field may be: max and min of several fields are no steeper than their sum,
 * a smooth one is JOINT_STEEPEST times that at most. */
static double sphere_steepening(const blob_scene *scene, int32_t element) {
    double times = 1.0;
    for (int32_t n = scene->node[element]; n >= 0; n = scene->nodes[n].parent)
        if (tree_is_joint(scene->nodes[n].op)) times *= JOINT_STEEPEST;
    return times;
}

/* A bound of |F'| on [t, limit]. */
static lane_real sphere_bound(const search *restrict s, const double *restrict limit) {
    const lane_real t = lane_load(s->p.t), end = lane_load(limit), zero = lane_all(0.0);
    lane_real sum = zero;
    for (size_t i = 0; i < s->p.leaf_count; i++) {
        const leaf *f = &s->p.scratch->leaves[i];
        /* 2 rounding: stretch of its matrix / R */
        const lane_real steepest = lane_all(fabs(f->weight) * s->p.scene->kernels[f->kernel].lipschitz * 2.0 *
                                            f->rounding * sphere_steepening(s->p.scene, f->element));
        sum += lane_select((lane_load(f->enter) < end) & (lane_load(f->exit) > t), steepest, zero);
    }
    return sum * (1.0 + 1e-12);
}

static void sphere_advance(search *restrict s, const double *restrict limit) {
    const lane_real bound = sphere_bound(s, limit), far = lane_all(BLOB_INFINITY);
    for (int look = 0; look < STRATEGY_PATIENCE && !strategy_cancelled(s); look++) {
        const lane_mask on = strategy_active(s, limit);
        if (!lane_any(on)) return;
        leaf_point f;
        const lane_real F = strategy_look(s, on, lane_load(s->p.t), &f);
        const lane_mask sloped = bound > 0.0;
        strategy_walk(s, limit, on, lane_select(sloped, -F / lane_select(sloped, bound, lane_all(1.0)), far), F,
                      f.magnitude);
    }
}

/* ---- segment --------------------------------------------------------------------------------------- */

static void segment_advance(search *restrict s, const double *restrict limit) {
    LANE_ALIGN double at_a[LANES], at_b[LANES];
    for (int look = 0; look < STRATEGY_PATIENCE && !strategy_cancelled(s); look++) {
        const lane_mask on = strategy_active(s, limit);
        if (!lane_any(on)) return;
        const lane_real t = lane_load(s->p.t), far = lane_all(BLOB_INFINITY), sign = lane_load(s->sign);
        const lane_real end = lane_min(t + lane_load(s->step), lane_load(limit)), length = end - t;
        lane_store(at_a, lane_select(on, t, far));
        lane_store(at_b, lane_select(on, end, -far));
        leaf_slopes f;
        packet_slopes(&s->p, at_a, at_b, &f);
        lane_store_mask(s->evaluations, lane_load_mask(s->evaluations) - on);
        const lane_real F = sign * (lane_load(f.at_a) - s->threshold);
        const lane_real most = lane_select(sign > 0.0, lane_load(f.slope_hi), -lane_load(f.slope_lo));
        const lane_mask sloped = most > 0.0;
        const lane_real reach = lane_select(sloped, -F / lane_select(sloped, most, lane_all(1.0)), far);
        /* the end of the segment is no reason to stop */
        const lane_mask whole = reach >= length;
        const lane_real least = strategy_tolerance(s, t, STRATEGY_TOLERANCE * s->reach);
        const lane_real step = lane_select(whole, lane_max(length, least), reach);
        strategy_walk(s, limit, on, step, F, f.magnitude);
        const lane_real longer = lane_select(whole, 2.0 * lane_load(s->step), 1.5 * reach);
        lane_store(s->step, lane_select(on, lane_max(longer, least), lane_load(s->step)));
    }
}

/* ---- march ----------------------------------------------------------------------------------------- */

/* The crossing between a (before it) and b (behind it), from the near side. */
static void march_bisect(search *restrict s, lane_mask on, lane_real a, lane_real b) {
    const lane_real least = strategy_tolerance(s, lane_max(lane_abs(a), lane_abs(b)), 0.0);
    leaf_point f;
    for (lane_mask wide = on & (b - a > least); lane_any(wide); wide &= b - a > least) {
        const lane_real middle = 0.5 * (a + b);
        const lane_mask behind = strategy_look(s, wide, middle, &f) > 0.0;
        a = lane_select(wide & ~behind, middle, a);
        b = lane_select(wide & behind, middle, b);
    }
    strategy_look(s, on, a, &f);
    strategy_hit(s, on, a, &f);
}

/* Looks at the start, then every stride (gaps without elements are known to be empty), and where the window ends. */
static void march_advance(search *restrict s, const double *restrict limit) {
    const lane_real stride = lane_all(s->stride > 0.0 ? s->stride : STRATEGY_STRIDE * s->reach);
    while (!strategy_cancelled(s)) {
        const lane_real before = lane_load(s->p.t);
        lane_mask on = strategy_active(s, limit);
        /* a gap is left out by whole strides, so that the places stay where they are */
        const lane_real behind_gap = lane_load(s->p.t), end = lane_load(s->p.end);
        lane_real t = before;
        LANE_LOOP(l) t[l] += stride[l] * floor((behind_gap[l] - before[l]) / stride[l]);
        t = lane_select(behind_gap >= end, behind_gap, t);
        lane_store(s->p.t, t);
        const lane_real next = lane_min(t + lane_max(stride, strategy_resolution(s, t)), end);
        on &= next <= lane_load(limit); /* further on not every element is known yet */
        if (!lane_any(on)) return;
        leaf_point f;
        const lane_mask behind = on & (strategy_look(s, on, next, &f) > 0.0);
        lane_store(s->p.t, lane_select(on & ~behind, next, t));
        if (lane_any(behind)) march_bisect(s, behind, t, next);
    }
}

/* ---- all of them ------------------------------------------------------------------------------------ */

/* Rays whose window is over. Where it ends with t_max and F rises there to 0, but for what one evaluation is off,
 * t_max is the crossing (search_end). */
static void strategy_end(search *restrict s) {
    const lane_real t = lane_load(s->p.t);
    const lane_mask over = lane_load_mask(s->searching) & (t >= lane_load(s->p.end));
    const lane_mask closes = over & lane_load_mask(s->closes) & (lane_load(s->sign) != 0.0);
    if (lane_any(closes)) {
        leaf_point f;
        const lane_real F = strategy_look(s, closes, t, &f);
        const lane_real slope = lane_load(f.gradient[0]) * lane_load(s->p.rays.d[0]) +
                                lane_load(f.gradient[1]) * lane_load(s->p.rays.d[1]) +
                                lane_load(f.gradient[2]) * lane_load(s->p.rays.d[2]);
        const lane_real e = SEARCH_EPSILON * (lane_load(f.magnitude) + fabs(s->threshold));
        const lane_mask touches = closes & (F >= -0.0625 * e) & (lane_load(s->sign) * slope > 0.0);
        if (lane_any(touches)) strategy_hit(s, touches, t, &f);
    }
    lane_store_mask(s->searching, lane_load_mask(s->searching) & ~over);
}

/* Sphere, segment and march up to `known`. */
static void strategy_approach(search *restrict s, double known) {
    LANE_ALIGN double limit[LANES];
    lane_store(limit, lane_min(lane_all(known), lane_load(s->p.end)));
    search_start(s, limit);
    if (s->strategy == BLOB_SEARCH_MARCH) march_advance(s, limit);
    else if (s->strategy == BLOB_SEARCH_SPHERE) sphere_advance(s, limit);
    else segment_advance(s, limit);
    if (strategy_cancelled(s)) return;
    strategy_end(s);
    if (s->strategy == BLOB_SEARCH_MARCH) return;
    /* out of patience: the sandwich goes on */
    const lane_mask rest = lane_load_mask(s->searching) & (lane_load(s->p.t) < lane_load(limit));
    if (!lane_any(rest)) return;
    lane_store_mask(s->fallbacks, lane_load_mask(s->fallbacks) - rest);
    lane_store(s->step, lane_select(rest, lane_all(s->reach), lane_load(s->step)));
    search_advance(s, known, sandwich_step);
}

/* Search up to `known`: every leaf that begins before it is in the packet. */
static void strategy_advance(search *restrict s, double known) {
    switch (s->strategy) {
        case BLOB_SEARCH_SANDWICH: search_advance(s, known, sandwich_step); break;
        case BLOB_SEARCH_BERNSTEIN: search_advance(s, known, bernstein_step); break;
        case BLOB_SEARCH_INTERVAL: search_advance(s, known, interval_step); break;
        default: strategy_approach(s, known); break;
    }
}

#endif
