/* sum.h - the sandwich of search.h for what most surfaces are: one sum of points and lines, all with kernels of one
 * kind.
 *
 * Method, formulas and rounding bounds are those of search.h, leaf.h and kernel.h. What differs is that a team of
 * two packets is searched at once, so that one has work while the other waits for a result, that sums stay in
 * registers from leaf to leaf, and that the kind of kernel is a constant of every loop (what is written for built-in
 * kernels relies on them: they fall and are convex; user kernels have their own, by user.h). Whatever takes care, which
 * is what lies within rounding of the surface or does not converge at once, is left to search.h: rays in `left` start
 * afresh there. So nothing here ever grazes, and all that is decided here is proved.
 */
#ifndef BLOB_SUM_H
#define BLOB_SUM_H

#include <float.h>

#include "beam.h"
#include "leaf.h"

enum { SUM_TEAM = 2, SUM_ROUNDS = 40 };
#define SUM_EACH(h) _Pragma("GCC unroll 2") for (int h = 0; h < SUM_TEAM; h++)

static const double SUM_EPSILON = 8.0 * DBL_EPSILON; /* as SEARCH_EPSILON */
static const double SUM_LINE_ROUNDING = 0.87;        /* half of the root of 3, as shape_stretch */
static const double SUM_STEEP = 0x1p20;  /* falls that the place of the start does not matter to, in rounding bounds */
static const double SUM_PIN = 0.03;      /* half the width of brackets around guesses, in typical reaches */
static const double SUM_SLACK = 0x1p-24; /* of roots that bound crossings */

/* The three pieces of s(t) of a line along one packet (leaf.h), and its nearest place. */
typedef struct sum_pieces {
    lane_real tau[3], r2[3], side_k, first, second, nearest_t, nearest_s;
} sum_pieces;

/* A line along the rays of a team. */
typedef struct sum_line {
    sum_pieces of[SUM_TEAM];
    double along[3], length; /* unit direction */
} sum_line;

/* A point, or a line, along the rays of a team. */
typedef struct sum_leaf {
    lane_real tau[SUM_TEAM], r2[SUM_TEAM], enter[SUM_TEAM], exit[SUM_TEAM];
    double k, weight, rounding; /* as in leaf */
    double at[3];
    const blob_kernel *kernel;
    const blob_scene *scene;
    size_t line; /* SUM_NO_LINE: a point */
} sum_leaf;
static const size_t SUM_NO_LINE = (size_t)-1;

/* Grows as needed, reused from team to team. */
typedef struct sum_scratch {
    sum_leaf *leaves;
    sum_line *lines;
    size_t room, line_room;
} sum_scratch;

static void sum_scratch_free(sum_scratch *scratch) {
    free(scratch->leaves);
    free(scratch->lines);
}

/* One packet of a team. */
typedef struct sum_rays {
    lane_real o[3], d[3], magnitude;
    lane_real t, end;     /* still to be searched: (t, end] */
    lane_real sign;       /* +1 outside, -1 inside, 0 not known yet */
    lane_real step, ripe; /* next interval to try; width of a bracket at which monotony is tried */
    lane_real hit_t, normal[3];
    lane_bits searching, bracketed, hit, left;
    lane_bits on;     /* starts where the surface was hit */
    lane_bits pinned; /* enters behind `end`, at `pin`, if nothing is before that */
    lane_real pin;
    lane_mask evaluations, sandwiches, spans;
} sum_rays;

typedef struct sum_search {
    sum_rays rays[SUM_TEAM];
    const blob_scene *scene;
    sum_scratch *scratch;
    size_t leaf_count, line_count;
    int32_t kind;  /* KERNEL_* */
    int32_t lines; /* are there any? */
    double threshold, reach, tolerance;
    int any;   /* where a crossing is proved is not asked */
    int apart; /* rays that share nothing: those that are done are not to be looked for any longer */
    int out_of_memory;
} sum_search;

/* Intervals, places or masks, one per packet. */
typedef struct sum_reals {
    lane_real of[SUM_TEAM];
} sum_reals;
typedef struct sum_flags {
    lane_bits of[SUM_TEAM];
} sum_flags;

LANE_INLINE lane_bits sum_nowhere(void) { return lane_less(lane_all(1.0), lane_all(0.0)); }
LANE_INLINE int sum_some(sum_flags m) { return lane_some(lane_either(m.of[0], m.of[1])); }

/* ---- kernels ------------------------------------------------------------------------------------- */

/* phi, phi' and phi''. Where the last is left at 0, Halley's method becomes Newton's. */
typedef struct sum_jet {
    lane_real value, slope, bend;
} sum_jet;

LANE_INLINE int sum_is_polynomial(int id) { return id == KERNEL_SOFT2 || id == KERNEL_SOFT3 || id == KERNEL_WYVILL; }

LANE_INLINE sum_jet sum_kernel(int id, const sum_leaf *f, lane_real s) {
    if (sum_is_polynomial(id)) {
        const lane_real p = lane_max(1.0 - s, lane_all(0.0));
        if (id == KERNEL_SOFT2) return (sum_jet){p * p, -2.0 * p, lane_all(2.0)};
        if (id == KERNEL_SOFT3) return (sum_jet){p * p * p, -3.0 * (p * p), 6.0 * p};
        return (sum_jet){p * p * (5.0 + 4.0 * p) * (1.0 / 9.0), -p * (10.0 + 12.0 * p) * (1.0 / 9.0),
                         (10.0 + 24.0 * p) * (1.0 / 9.0)};
    }
    if (id == KERNEL_USER) {
        const user_jet jet = user_at(f->scene, f->kernel, s);
        return (sum_jet){jet.value, jet.slope, lane_all(0.0)};
    }
    LANE_ALIGN double at[LANES], value[LANES], slope[LANES];
    lane_store(at, s);
    LANE_SIMD(l) {
        const kernel_jet jet = kernel_value(id, NULL, f->kernel, at[l]);
        value[l] = jet.value;
        slope[l] = jet.slope;
    }
    return (sum_jet){lane_load(value), lane_load(slope), lane_all(0.0)};
}

/* The slope of the chord of phi over [lo, hi], `at_lo` being phi there. */
LANE_INLINE lane_real sum_chord(int id, const sum_leaf *f, lane_real lo, lane_real hi, sum_jet at_lo) {
    const lane_real zero = lane_all(0.0), gap = hi - lo;
    const lane_bits wide = lane_less(zero, gap);
    const lane_real divisor = lane_pick(wide, gap, lane_all(1.0));
    if (!sum_is_polynomial(id)) {
        const lane_real across = (sum_kernel(id, f, hi).value - at_lo.value) / divisor;
        return lane_pick(wide, across, at_lo.slope);
    }
    const lane_real p = lane_max(1.0 - lo, zero), q = 1.0 - hi;
    lane_real inside; /* both ends within the reach: closed form */
    if (id == KERNEL_SOFT2) inside = -(p + q);
    else if (id == KERNEL_SOFT3) inside = -(p * p + p * q + q * q);
    else inside = -(5.0 * (p + q) + 4.0 * (p * p + p * q + q * q)) * (1.0 / 9.0);
    const lane_bits out = lane_less(q, zero);
    return lane_some(out) ? lane_pick(out, -at_lo.value / divisor, inside) : inside;
}

/* sqrt(s) <= 1 within the support of finite kernels; the Gaussian reaches further. */
LANE_INLINE lane_real sum_reach(int id, lane_real s) {
    return id == KERNEL_GAUSS ? lane_max(s, lane_all(1.0)) : lane_all(1.0);
}

/* ---- evaluations --------------------------------------------------------------------------------- */

/* Does any ray of the team meet this leaf between a and b? */
LANE_INLINE int sum_touches(const sum_leaf *f, sum_reals a, sum_reals b) {
    sum_flags m;
    SUM_EACH(h) m.of[h] = lane_both(lane_less(f->enter[h], b.of[h]), lane_less(a.of[h], f->exit[h]));
    return sum_some(m);
}

/* Sums of more leaves than this are sums of halves: the rounding error of a plain sum grows with its length, and the
 * bound on it does not. */
enum { SUM_PLAIN = 64, SUM_FEW = 12 };

/* Which of the leaves [begin, end), SUM_PLAIN at most, any ray of the team meets between a and b, a bit each. Many are
 * asked beforehand, without a branch for each, as it is not to be predicted which are met; few on the way, `on_way`. */
LANE_INLINE uint64_t sum_touched(const sum_leaf *leaves, sum_reals a, sum_reals b, size_t begin, size_t end,
                                 int on_way) {
    uint64_t touched = 0;
    if (on_way) return ((uint64_t)1 << (end - begin)) - 1;
    for (size_t i = begin; i < end; i++) touched |= (uint64_t)(sum_touches(&leaves[i], a, b) != 0) << (i - begin);
    return touched;
}

/* Bernstein coefficients of the quadratics above and below the field, and what the rounding bound is made of. */
typedef struct sum_bounds {
    lane_real above[3], below[3], size;
} sum_bounds;

/* The two quadratics are each held as line coefficients times s, which is quadratic, and a constant. */
typedef struct sum_lines {
    lane_real above, above_a, above_m, above_b, below, below_a, below_m, below_b, size;
} sum_lines;

/* s on [a, b]: the values at both ends, the middle coefficients of quadratics below and above, the range, and s' at
 * both ends. As leaf_range_of. */
typedef struct sum_range {
    lane_real sa, sb, below, above, lo, hi, da, db;
} sum_range;

/* The piece of a line that t is in. */
typedef struct sum_piece {
    lane_real tau, r2, k;
} sum_piece;

LANE_INLINE sum_piece sum_piece_at(const sum_pieces *p, lane_real k, lane_bits before, lane_bits behind) {
    const lane_bits end = lane_either(before, behind);
    return (sum_piece){lane_pick(before, p->tau[0], lane_pick(behind, p->tau[2], p->tau[1])),
                       lane_pick(before, p->r2[0], lane_pick(behind, p->r2[2], p->r2[1])),
                       lane_pick(end, k, p->side_k)};
}
LANE_INLINE sum_piece sum_piece_of(const sum_pieces *p, double k, lane_real t) {
    return sum_piece_at(p, lane_all(k), lane_less(t, p->first), lane_less(p->second, t));
}

LANE_INLINE sum_range sum_range_of(const sum_pieces *p, double k, lane_real a, lane_real b) {
    const sum_piece at_a = sum_piece_of(p, k, a), at_b = sum_piece_of(p, k, b);
    const lane_real u = a - at_a.tau, v = b - at_b.tau, ku = at_a.k * u, kv = at_b.k * v, width = b - a;
    sum_range q = {.sa = lane_fma(ku, u, at_a.r2), .sb = lane_fma(kv, v, at_b.r2), .da = 2.0 * ku, .db = 2.0 * kv};
    const lane_bits before = lane_at_most(b, p->first), behind = lane_at_most(p->second, a);
    const lane_bits between = lane_both(lane_at_most(p->first, a), lane_at_most(b, p->second));
    const lane_bits single = lane_either(lane_either(before, behind), between);
    const sum_piece one = sum_piece_at(p, lane_all(k), before, lane_without(behind, before));
    const lane_real blossom = lane_fma(one.k * (a - one.tau), b - one.tau, one.r2), chord = 0.5 * (q.sa + q.sb);
    q.above = lane_pick(single, blossom, chord);
    q.below = lane_pick(single, blossom, chord - (0.5 * k) * width * width);
    q.hi = lane_max(q.sa, q.sb);
    const lane_bits within = lane_both(lane_less(a, p->nearest_t), lane_less(p->nearest_t, b));
    q.lo = lane_min(lane_pick(within, p->nearest_s, lane_min(q.sa, q.sb)), q.hi);
    return q;
}

/* One quadratic. */
LANE_INLINE sum_range sum_range_of_point(const sum_leaf *f, int h, lane_real a, lane_real b) {
    const lane_real zero = lane_all(0.0), tau = f->tau[h], r2 = f->r2[h], u = a - tau, v = b - tau;
    const lane_real ku = f->k * u, kv = f->k * v, middle = lane_fma(ku, v, r2);
    sum_range q = {.sa = lane_fma(ku, u, r2),
                   .sb = lane_fma(kv, v, r2),
                   .below = middle,
                   .above = middle,
                   .da = 2.0 * ku,
                   .db = 2.0 * kv};
    q.hi = lane_max(q.sa, q.sb);
    q.lo = lane_pick(lane_less(u * v, zero), r2, lane_min(q.sa, q.sb));
    return q;
}

LANE_INLINE sum_range sum_range_in(int lines, const sum_search *s, const sum_leaf *f, int h, lane_real a, lane_real b) {
    if (!lines || f->line == SUM_NO_LINE) return sum_range_of_point(f, h, a, b);
    return sum_range_of(&s->scratch->lines[f->line].of[h], f->k, a, b);
}

/* A user kernel's lines may rise or fall, and touch anywhere. */
static void sum_add_user_bounds(const sum_leaf *f, sum_range q, lane_real magnitude, sum_lines *restrict sum) {
    const lane_real sa = q.sa, sb = q.sb, lo = q.lo, hi = q.hi, zero = lane_all(0.0);
    const lane_real mid = lane_max(lane_min(lane_fma(lane_all(0.25), sa + sb, 0.5 * q.above), hi), lo);
    const user_line line = user_line_of(f->scene, f->kernel, lo, hi, mid);
    const lane_real w = lane_all(f->weight);
    const lane_real upper = w * line.upper_slope, lower = w * line.lower_slope;
    const lane_real upper_0 = lane_fma(w, line.upper_value, -upper * line.upper_at);
    const lane_real lower_0 = lane_fma(w, line.lower_value, -lower * line.lower_at);
    /* a falling line needs the quadratic below s for an upper bound, a rising one the one above */
    const lane_real um = lane_pick(lane_at_most(line.upper_slope, zero), q.below, q.above);
    const lane_real lm = lane_pick(lane_at_most(line.lower_slope, zero), q.above, q.below);
    const int swap = f->weight < 0.0;
    const lane_real above = swap ? lower : upper, below = swap ? upper : lower;
    sum->above += swap ? lower_0 : upper_0, sum->below += swap ? upper_0 : lower_0;
    sum->above_a = lane_fma(above, sa, sum->above_a), sum->below_a = lane_fma(below, sa, sum->below_a);
    sum->above_m = lane_fma(above, swap ? lm : um, sum->above_m);
    sum->below_m = lane_fma(below, swap ? um : lm, sum->below_m);
    sum->above_b = lane_fma(above, sb, sum->above_b), sum->below_b = lane_fma(below, sb, sum->below_b);
    const lane_real moved = lane_fma(lane_all(f->rounding), magnitude, lane_all(1.0));
    sum->size = lane_fma(lane_abs(w), lane_fma(line.steep, moved, line.top), sum->size);
}

LANE_INLINE void sum_add_bounds(int id, const sum_leaf *f, sum_range q, lane_real magnitude, sum_lines *restrict sum) {
    if (id == KERNEL_USER) {
        sum_add_user_bounds(f, q, magnitude, sum);
        return;
    }
    const lane_real sa = q.sa, sb = q.sb, lo = q.lo, hi = q.hi;
    const lane_real mid = lane_max(lane_min(lane_fma(lane_all(0.25), sa + sb, 0.5 * q.above), hi), lo);
    const sum_jet top = sum_kernel(id, f, lo), middle = sum_kernel(id, f, mid);
    const lane_real w = lane_all(f->weight);
    const lane_real upper = w * sum_chord(id, f, lo, hi, top), lower = w * middle.slope;
    const lane_real upper_0 = lane_fma(w, top.value, -upper * lo), lower_0 = lane_fma(w, middle.value, -lower * mid);
    if (f->weight >= 0.0) {
        sum->above += upper_0, sum->below += lower_0;
        sum->above_a = lane_fma(upper, sa, sum->above_a), sum->below_a = lane_fma(lower, sa, sum->below_a);
        sum->above_m = lane_fma(upper, q.below, sum->above_m), sum->below_m = lane_fma(lower, q.above, sum->below_m);
        sum->above_b = lane_fma(upper, sb, sum->above_b), sum->below_b = lane_fma(lower, sb, sum->below_b);
    } else {
        sum->above += lower_0, sum->below += upper_0;
        sum->above_a = lane_fma(lower, sa, sum->above_a), sum->below_a = lane_fma(upper, sa, sum->below_a);
        sum->above_m = lane_fma(lower, q.above, sum->above_m), sum->below_m = lane_fma(upper, q.below, sum->below_m);
        sum->above_b = lane_fma(lower, sb, sum->above_b), sum->below_b = lane_fma(upper, sb, sum->below_b);
    }
    const lane_real moved = lane_fma(lane_all(f->rounding), magnitude, sum_reach(id, hi));
    sum->size = lane_fma(lane_abs(w), lane_fma(-top.slope, moved, top.value), sum->size);
}

LANE_INLINE void sum_bounds_of(int id, int lines, const sum_search *restrict s, const sum_reals *at, size_t begin,
                               size_t end, sum_bounds *restrict result) {
    const sum_reals a = at[0], b = at[1];
    const lane_real zero = lane_all(0.0);
    const sum_lines nothing = {zero, zero, zero, zero, zero, zero, zero, zero, zero};
    sum_lines first = nothing, second = nothing;
    const lane_real magnitude[SUM_TEAM] = {s->rays[0].magnitude, s->rays[1].magnitude};
    const int on_way = end - begin <= SUM_FEW;
    for (uint64_t rest = sum_touched(s->scratch->leaves, a, b, begin, end, on_way); rest; rest &= rest - 1) {
        const sum_leaf *f = &s->scratch->leaves[begin + (size_t)__builtin_ctzll(rest)];
        if (on_way && !sum_touches(f, a, b)) continue;
        sum_add_bounds(id, f, sum_range_in(lines, s, f, 0, a.of[0], b.of[0]), magnitude[0], &first);
        sum_add_bounds(id, f, sum_range_in(lines, s, f, 1, a.of[1], b.of[1]), magnitude[1], &second);
    }
    const sum_lines *sums[SUM_TEAM] = {&first, &second};
    SUM_EACH(h) {
        const sum_lines *q = sums[h];
        result[h] = (sum_bounds){{q->above + q->above_a, q->above + q->above_m, q->above + q->above_b},
                                 {q->below + q->below_a, q->below + q->below_m, q->below + q->below_b},
                                 q->size};
    }
}

/* Range of the slope on an interval, values and slopes at its ends. */
typedef struct sum_slopes {
    lane_real least, most, value_a, value_b, slope_a, slope_b, size;
} sum_slopes;

/* The product of two intervals. */
static void sum_add_user_slopes(const sum_leaf *f, sum_range q, lane_real magnitude, sum_slopes *restrict sum) {
    const double w = f->weight;
    const lane_real da = q.da, db = q.db, sa = q.sa, sb = q.sb, lo = q.lo;
    user_jet jets[3];
    const user_hull hull = user_hull_of(f->scene, f->kernel, lo, sa, sb, jets);
    const lane_real x0 = hull.slope_lo * da, x1 = hull.slope_lo * db, x2 = hull.slope_hi * da, x3 = hull.slope_hi * db;
    const lane_real least = lane_min(lane_min(x0, x1), lane_min(x2, x3));
    const lane_real most = lane_max(lane_max(x0, x1), lane_max(x2, x3));
    sum->least += w * (w >= 0.0 ? least : most);
    sum->most += w * (w >= 0.0 ? most : least);
    sum->value_a += w * jets[1].value, sum->slope_a += w * jets[1].slope * da;
    sum->value_b += w * jets[2].value, sum->slope_b += w * jets[2].slope * db;
    const lane_real top = lane_max(lane_abs(hull.most), lane_abs(hull.least));
    const lane_real steep = lane_max(lane_abs(hull.slope_lo), lane_abs(hull.slope_hi));
    sum->size += fabs(w) * (top + steep * (1.0 + f->rounding * magnitude));
}

/* With phi' in [top, bottom] <= 0 and s' in [da, db], the product of the two is least at db and most at da. */
LANE_INLINE void sum_add_slopes(int id, const sum_leaf *f, sum_range q, lane_real magnitude, sum_slopes *restrict sum) {
    if (id == KERNEL_USER) {
        sum_add_user_slopes(f, q, magnitude, sum);
        return;
    }
    const double w = f->weight;
    const lane_real da = q.da, db = q.db, sa = q.sa, sb = q.sb, lo = q.lo, hi = q.hi;
    const sum_jet top = sum_kernel(id, f, lo), bottom = sum_kernel(id, f, hi);
    const lane_real least = lane_min(top.slope * db, bottom.slope * db);
    const lane_real most = lane_max(top.slope * da, bottom.slope * da);
    const sum_jet at_a = sum_kernel(id, f, sa), at_b = sum_kernel(id, f, sb);
    sum->least += w * (w >= 0.0 ? least : most);
    sum->most += w * (w >= 0.0 ? most : least);
    sum->value_a += w * at_a.value, sum->slope_a += w * at_a.slope * da;
    sum->value_b += w * at_b.value, sum->slope_b += w * at_b.slope * db;
    sum->size += fabs(w) * (top.value - top.slope * (sum_reach(id, hi) + f->rounding * magnitude));
}

LANE_INLINE void sum_slopes_of(int id, int lines, const sum_search *restrict s, const sum_reals *at, size_t begin,
                               size_t end, sum_slopes *restrict result) {
    const sum_reals a = at[0], b = at[1];
    const lane_real zero = lane_all(0.0);
    sum_slopes first = {zero, zero, zero, zero, zero, zero, zero}, second = first;
    const lane_real magnitude[SUM_TEAM] = {s->rays[0].magnitude, s->rays[1].magnitude};
    const int on_way = end - begin <= SUM_FEW;
    for (uint64_t rest = sum_touched(s->scratch->leaves, a, b, begin, end, on_way); rest; rest &= rest - 1) {
        const sum_leaf *f = &s->scratch->leaves[begin + (size_t)__builtin_ctzll(rest)];
        if (on_way && !sum_touches(f, a, b)) continue;
        sum_add_slopes(id, f, sum_range_in(lines, s, f, 0, a.of[0], b.of[0]), magnitude[0], &first);
        sum_add_slopes(id, f, sum_range_in(lines, s, f, 1, a.of[1], b.of[1]), magnitude[1], &second);
    }
    result[0] = first;
    result[1] = second;
}

/* The sum and its first two derivatives along the rays. */
LANE_INLINE sum_piece sum_piece_in(int lines, const sum_search *s, const sum_leaf *f, int h, lane_real t) {
    if (!lines || f->line == SUM_NO_LINE) return (sum_piece){f->tau[h], f->r2[h], lane_all(f->k)};
    return sum_piece_of(&s->scratch->lines[f->line].of[h], f->k, t);
}
LANE_INLINE const sum_line *sum_line_in(int lines, const sum_search *s, const sum_leaf *f) {
    return !lines || f->line == SUM_NO_LINE ? NULL : &s->scratch->lines[f->line];
}

LANE_INLINE void sum_add_along(int id, const sum_leaf *f, sum_piece p, lane_real t, sum_jet *restrict sum) {
    const lane_real u = t - p.tau, ku = p.k * u, w = lane_all(f->weight);
    const sum_jet jet = sum_kernel(id, f, lane_fma(ku, u, p.r2));
    const lane_real steep = (2.0 * w) * jet.slope, turn = (4.0 * w) * jet.bend;
    sum->value = lane_fma(w, jet.value, sum->value);
    sum->slope = lane_fma(steep, ku, sum->slope);
    sum->bend += lane_fma(turn, ku * ku, p.k * steep);
}

LANE_INLINE void sum_along_of(int id, int lines, const sum_search *restrict s, const sum_reals *at, size_t begin,
                              size_t end, sum_jet *restrict result) {
    const sum_reals t = at[0];
    const lane_real zero = lane_all(0.0);
    sum_jet first = {zero, zero, zero}, second = first;
    const int on_way = end - begin <= SUM_FEW;
    for (uint64_t rest = sum_touched(s->scratch->leaves, t, t, begin, end, on_way); rest; rest &= rest - 1) {
        const sum_leaf *f = &s->scratch->leaves[begin + (size_t)__builtin_ctzll(rest)];
        if (on_way && !sum_touches(f, t, t)) continue;
        sum_add_along(id, f, sum_piece_in(lines, s, f, 0, t.of[0]), t.of[0], &first);
        sum_add_along(id, f, sum_piece_in(lines, s, f, 1, t.of[1]), t.of[1], &second);
    }
    result[0] = first;
    result[1] = second;
}

/* Value, gradient, and what the rounding bound is made of. */
typedef struct sum_point {
    lane_real value, gradient[3], size;
} sum_point;

LANE_INLINE void sum_add_point(int id, const sum_leaf *f, sum_piece p, const sum_line *line, lane_real t,
                               const lane_real *P, lane_real magnitude, sum_point *restrict sum) {
    const lane_real u = t - p.tau, s = p.r2 + p.k * u * u;
    lane_real x[3] = {P[0] - f->at[0], P[1] - f->at[1], P[2] - f->at[2]};
    if (line) { /* from the nearest place of the line */
        const double *e = line->along;
        const lane_real way = lane_fma(lane_all(e[0]), x[0], lane_fma(lane_all(e[1]), x[1], e[2] * x[2]));
        const lane_real there = lane_min(lane_max(way, lane_all(0.0)), lane_all(line->length));
        for (int k = 0; k < 3; k++) x[k] -= there * e[k];
    }
    const sum_jet jet = sum_kernel(id, f, s);
    const lane_real steep = (2.0 * f->weight * f->k) * jet.slope;
    sum->value += f->weight * jet.value;
    for (int k = 0; k < 3; k++) sum->gradient[k] = lane_fma(steep, x[k], sum->gradient[k]);
    const lane_real top = id == KERNEL_USER ? lane_abs(jet.value) : jet.value;
    const lane_real fall = id == KERNEL_USER ? lane_abs(jet.slope) : -jet.slope;
    sum->size += fabs(f->weight) * (top + fall * (sum_reach(id, s) + f->rounding * magnitude));
}

LANE_INLINE void sum_point_of(int id, int lines, const sum_search *restrict s, const sum_reals *at, size_t begin,
                              size_t end, sum_point *restrict result) {
    const sum_reals t = at[0];
    const lane_real zero = lane_all(0.0);
    sum_point first = {zero, {zero, zero, zero}, zero}, second = first;
    lane_real P[SUM_TEAM][3];
    SUM_EACH(h) for (int k = 0; k < 3; k++) P[h][k] = s->rays[h].o[k] + t.of[h] * s->rays[h].d[k];
    const int on_way = end - begin <= SUM_FEW;
    for (uint64_t rest = sum_touched(s->scratch->leaves, t, t, begin, end, on_way); rest; rest &= rest - 1) {
        const sum_leaf *f = &s->scratch->leaves[begin + (size_t)__builtin_ctzll(rest)];
        if (on_way && !sum_touches(f, t, t)) continue;
        sum_add_point(id, f, sum_piece_in(lines, s, f, 0, t.of[0]), sum_line_in(lines, s, f), t.of[0], P[0],
                      s->rays[0].magnitude, &first);
        sum_add_point(id, f, sum_piece_in(lines, s, f, 1, t.of[1]), sum_line_in(lines, s, f), t.of[1], P[1],
                      s->rays[1].magnitude, &second);
    }
    result[0] = first;
    result[1] = second;
}

/* The kind of kernel becomes a constant; so does whether there are lines, where masks are bits: elsewhere compilers
 * take longer over that than it saves. */
#define SUM_CASE(ID, OF)                                                                                               \
    case ID:                                                                                                           \
        if (sizeof(lane_bits) == 1 && !s->lines) OF(ID, 0, s, at, begin, end, result);                                 \
        else OF(ID, 1, s, at, begin, end, result);                                                                     \
        break;
#define SUM_EVALUATE(NAME, OF, TYPE)                                                                                   \
    static void NAME##_of_some(const sum_search *restrict s, const sum_reals *at, size_t begin, size_t end,            \
                               TYPE *restrict result) {                                                                \
        if (end - begin > SUM_PLAIN) {                                                                                 \
            const size_t middle = begin + (end - begin) / 2;                                                           \
            TYPE rest[SUM_TEAM];                                                                                       \
            NAME##_of_some(s, at, begin, middle, result);                                                              \
            NAME##_of_some(s, at, middle, end, rest);                                                                  \
            sum_both((lane_real *)result, (const lane_real *)rest, sizeof rest / (sizeof(lane_real)));                 \
            return;                                                                                                    \
        }                                                                                                              \
        switch (s->kind) {                                                                                             \
            SUM_CASE(KERNEL_SOFT2, OF)                                                                                 \
            SUM_CASE(KERNEL_SOFT3, OF)                                                                                 \
            SUM_CASE(KERNEL_WYVILL, OF)                                                                                \
            SUM_CASE(KERNEL_GAUSS, OF)                                                                                 \
            SUM_CASE(KERNEL_GAUSS_C1, OF)                                                                              \
            SUM_CASE(KERNEL_METABALL, OF)                                                                              \
            SUM_CASE(KERNEL_USER, OF)                                                                                  \
            default: break;                                                                                            \
        }                                                                                                              \
    }                                                                                                                  \
    static void NAME(const sum_search *restrict s, const sum_reals *at, TYPE *restrict result) {                       \
        NAME##_of_some(s, at, 0, s->leaf_count, result);                                                               \
    }

static void sum_both(lane_real *restrict into, const lane_real *restrict more, size_t count) {
    for (size_t i = 0; i < count; i++) into[i] += more[i];
}

SUM_EVALUATE(sum_bounds_on, sum_bounds_of, sum_bounds)
SUM_EVALUATE(sum_slopes_on, sum_slopes_of, sum_slopes)
SUM_EVALUATE(sum_along, sum_along_of, sum_jet)
SUM_EVALUATE(sum_point_at, sum_point_of, sum_point)

/* Lanes at rest get an empty interval far away, so that no leaf is touched on their account. */
LANE_INLINE void sum_rest(sum_flags active, sum_reals *restrict a, sum_reals *restrict b) {
    const lane_real far = lane_all(BLOB_INFINITY);
    SUM_EACH(h) {
        a->of[h] = lane_pick(active.of[h], a->of[h], far);
        b->of[h] = lane_pick(active.of[h], b->of[h], -far);
    }
}

LANE_INLINE void sum_count(sum_search *restrict s, sum_flags which) {
    SUM_EACH(h) s->rays[h].evaluations -= lane_mask_of(which.of[h]);
}

/* These rays are for search.h. */
LANE_INLINE void sum_leave(sum_rays *restrict r, lane_bits which) {
    r->left = lane_either(r->left, which);
    r->searching = lane_without(r->searching, which);
}

LANE_INLINE lane_real sum_resolution(const sum_search *restrict s, lane_real t) {
    return 2.0 * DBL_EPSILON * (lane_abs(t) + 1e-3 * s->reach);
}

/* ---- leaves -------------------------------------------------------------------------------------- */

/* Room for one more; 0 when memory has run out. */
static int sum_reserve(void **data, size_t *room, size_t count, size_t size) {
    if (count < *room) return 1;
    const size_t more = 2 * *room + 64;
    void *fresh = aligned_alloc(64, more * size);
    if (!fresh) return 0;
    if (count) memcpy(fresh, *data, count * size);
    free(*data);
    *data = fresh;
    *room = more;
    return 1;
}

/* Closest approach of the rays of a packet to the line from c along e, and where they are within its support. Of rays
 * that never are, `enter` is behind `exit`. */
static lane_bits sum_meet_line(const sum_rays *r, const double *c, const double *e, double length, double k,
                               double support2, sum_pieces *restrict p, lane_real *enter, lane_real *exit) {
    const lane_real zero = lane_all(0.0), far = lane_all(BLOB_INFINITY), away = lane_all(1e300);
    lane_real x[3], xu = zero, du = zero;
    for (int i = 0; i < 3; i++) {
        x[i] = r->o[i] - c[i];
        xu = lane_fma(x[i], lane_all(e[i]), xu);
        du = lane_fma(r->d[i], lane_all(e[i]), du);
    }
    /* around the whole axis first */
    lane_real y[3], v[3], yv = zero, vv = zero, rho2 = zero;
    for (int i = 0; i < 3; i++) {
        y[i] = lane_fma(-xu, lane_all(e[i]), x[i]);
        v[i] = lane_fma(-du, lane_all(e[i]), r->d[i]);
        yv = lane_fma(y[i], v[i], yv);
        vv = lane_fma(v[i], v[i], vv);
    }
    const lane_bits moves = lane_less(lane_all(1e-300), vv);
    const lane_real pace = lane_pick(moves, vv, lane_all(1.0)), middle = lane_pick(moves, -yv / pace, zero);
    for (int i = 0; i < 3; i++) {
        const lane_real q = lane_fma(middle, v[i], y[i]);
        rho2 = lane_fma(q, q, rho2);
    }
    const lane_bits meets = lane_less(rho2, lane_all(support2));
    if (!lane_some(meets)) { /* far away all along: the other packet may meet it */
        *p = (sum_pieces){
            .tau = {zero, zero, zero}, .r2 = {away, away, away}, .first = far, .second = far, .nearest_s = away};
        return meets;
    }
    const lane_bits falling = lane_less(du, zero), steady = lane_at_most(lane_abs(du), zero);
    const lane_real safe = lane_pick(steady, lane_all(1.0), du);
    const lane_real at0 = lane_pick(steady, lane_pick(lane_less(xu, zero), far, -far), -xu / safe);
    const lane_real at1 =
        length > 0.0 ? lane_pick(steady, lane_pick(lane_less(lane_all(length), xu), -far, far), (length - xu) / safe)
                     : at0;
    const lane_real first = lane_pick(falling, at1, at0), second = lane_pick(falling, at0, at1);
    lane_real tau_a = zero, tau_b, rho2_a = zero, rho2_b = zero;
    for (int i = 0; i < 3; i++) tau_a = lane_fma(-x[i], r->d[i], tau_a);
    tau_b = lane_fma(lane_all(length), du, tau_a);
    for (int i = 0; i < 3; i++) {
        const lane_real a = lane_fma(tau_a, r->d[i], x[i]), b = lane_fma(tau_b, r->d[i], x[i] - length * e[i]);
        rho2_a = lane_fma(a, a, rho2_a);
        rho2_b = lane_fma(b, b, rho2_b);
    }
    p->tau[0] = lane_pick(falling, tau_b, tau_a), p->r2[0] = k * lane_pick(falling, rho2_b, rho2_a);
    p->tau[2] = lane_pick(falling, tau_a, tau_b), p->r2[2] = k * lane_pick(falling, rho2_a, rho2_b);
    p->tau[1] = middle, p->r2[1] = k * rho2, p->side_k = lane_pick(moves, k * vv, zero);
    p->first = first, p->second = second;
    /* within the support of each piece, and the least of s: the pieces join to a convex curve */
    const double limit = k * support2;
    const lane_real lo[3] = {-far, first, second}, hi[3] = {first, second, far};
    lane_real from = far, to = -far;
    p->nearest_t = zero, p->nearest_s = far;
    for (int i = 0; i < 3; i++) {
        const lane_real bend = i == 1 ? p->side_k : lane_all(k), inside = limit - p->r2[i];
        const lane_bits bends = lane_less(zero, bend), within = lane_less(zero, inside);
        const lane_real share = lane_max(inside, zero) * lane_inverse(lane_pick(bends, bend, lane_all(1.0)));
        const lane_real half = lane_pick(bends, lane_root_above(share), far);
        const lane_real begin = lane_max(p->tau[i] - half, lo[i]), end = lane_min(p->tau[i] + half, hi[i]);
        const lane_bits here = lane_both(within, lane_at_most(begin, end));
        from = lane_pick(here, lane_min(from, begin), from);
        to = lane_pick(here, lane_max(to, end), to);
        const lane_real at = lane_min(lane_max(p->tau[i], lo[i]), hi[i]), u = at - p->tau[i];
        const lane_real value = lane_fma(bend * u, u, p->r2[i]);
        const lane_bits nearer = lane_both(lane_at_most(lo[i], hi[i]), lane_less(value, p->nearest_s));
        p->nearest_t = lane_pick(nearer, at, p->nearest_t);
        p->nearest_s = lane_pick(nearer, value, p->nearest_s);
    }
    const lane_real slack = 1e-14 * r->magnitude + 1e-12 * lane_max(to - from, zero);
    *enter = from - slack;
    *exit = to + slack;
    return lane_both(lane_less(*enter, r->end), lane_less(r->t, *exit));
}

/* As sum_add, of a line. */
static void sum_add_line(sum_search *restrict s, int32_t e, sum_leaf *restrict f) {
    const blob_scene *scene = s->scene;
    void *data = s->scratch->lines;
    if (!sum_reserve(&data, &s->scratch->line_room, s->line_count, sizeof(sum_line))) {
        s->out_of_memory = 1;
        return;
    }
    sum_line *restrict line = s->scratch->lines = data;
    line += s->line_count;
    const double *b = scene->shapes[scene->shape[e]].b;
    const double c[3] = {scene->x[e], scene->y[e], scene->z[e]}, k = scene->inverse_reach2[e];
    const double support2 = scene->support[e] * scene->support[e];
    double length2 = 0.0;
    for (int i = 0; i < 3; i++) length2 += (b[i] - c[i]) * (b[i] - c[i]);
    line->length = sqrt(length2);
    for (int i = 0; i < 3; i++) line->along[i] = line->length > 0.0 ? (b[i] - c[i]) / line->length : 0.0;
    sum_flags meets;
    SUM_EACH(h) {
        f->enter[h] = lane_all(BLOB_INFINITY), f->exit[h] = -f->enter[h];
        meets.of[h] = sum_meet_line(&s->rays[h], c, line->along, line->length, k, support2, &line->of[h], &f->enter[h],
                                    &f->exit[h]);
    }
    if (!sum_some(meets)) return;
    f->k = k;
    f->weight = scene->weight[e];
    f->rounding = SUM_LINE_ROUNDING * sqrt(k);
    for (int i = 0; i < 3; i++) f->at[i] = c[i];
    f->kernel = &scene->kernels[scene->kernel[e]];
    f->scene = scene;
    f->line = s->line_count++;
    s->leaf_count++;
}

/* Closest approach of each ray to element e, kept where any ray is in its window. */
static void sum_add(sum_search *restrict s, int32_t e) {
    void *data = s->scratch->leaves;
    if (!sum_reserve(&data, &s->scratch->room, s->leaf_count, sizeof(sum_leaf))) {
        s->out_of_memory = 1;
        return;
    }
    s->scratch->leaves = data;
    if (s->lines && s->scene->shape[e] >= 0) {
        sum_add_line(s, e, &s->scratch->leaves[s->leaf_count]);
        return;
    }
    const blob_scene *scene = s->scene;
    sum_leaf *restrict f = &s->scratch->leaves[s->leaf_count];
    const double cx = scene->x[e], cy = scene->y[e], cz = scene->z[e], k = scene->inverse_reach2[e];
    const double support2 = scene->support[e] * scene->support[e];
    const lane_real far = lane_all(BLOB_INFINITY), zero = lane_all(0.0);
    sum_flags meets;
    lane_real rho2[SUM_TEAM];
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        const lane_real x = cx - r->o[0], y = cy - r->o[1], z = cz - r->o[2];
        const lane_real tau = lane_fma(x, r->d[0], lane_fma(y, r->d[1], z * r->d[2]));
        const lane_real px = lane_fma(-tau, r->d[0], x), py = lane_fma(-tau, r->d[1], y),
                        pz = lane_fma(-tau, r->d[2], z);
        rho2[h] = lane_fma(px, px, lane_fma(py, py, pz * pz));
        f->tau[h] = tau;
        meets.of[h] = lane_less(rho2[h], lane_all(support2));
    }
    if (!sum_some(meets)) return;
    sum_flags within;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        const lane_real inside = lane_pick(meets.of[h], support2 - rho2[h], zero);
        const lane_real half = lane_root_above(inside) * (1.0 + 1e-12) + 1e-14 * r->magnitude;
        f->r2[h] = rho2[h] * k;
        f->enter[h] = lane_pick(meets.of[h], f->tau[h] - half, far);
        f->exit[h] = lane_pick(meets.of[h], f->tau[h] + half, -far);
        within.of[h] = lane_both(lane_less(f->enter[h], r->end), lane_less(r->t, f->exit[h]));
    }
    if (!sum_some(within)) return;
    f->k = k;
    f->weight = scene->weight[e];
    f->rounding = 0.5 * sqrt(k);
    f->at[0] = cx, f->at[1] = cy, f->at[2] = cz;
    f->kernel = &scene->kernels[scene->kernel[e]];
    f->scene = scene;
    f->line = SUM_NO_LINE;
    s->leaf_count++;
}

/* Forget leaves that every ray has left behind. */
static void sum_forget(sum_search *restrict s) {
    sum_leaf *leaves = s->scratch->leaves;
    size_t kept = 0;
    for (size_t i = 0; i < s->leaf_count; i++) {
        sum_flags ahead;
        SUM_EACH(h) {
            const sum_rays *r = &s->rays[h];
            ahead.of[h] = lane_both(r->searching, lane_less(r->t, leaves[i].exit[h]));
        }
        if (!sum_some(ahead)) continue;
        if (kept != i) leaves[kept] = leaves[i];
        kept++;
    }
    s->leaf_count = kept;
}

/* ---- start --------------------------------------------------------------------------------------- */

/* Signs of lanes that start within E of the surface, by monotony. */
static void sum_start_on_surface(sum_search *restrict s, sum_flags unsure, const sum_reals *restrict limit) {
    sum_reals width;
    SUM_EACH(h) width.of[h] = lane_min(limit->of[h] - s->rays[h].t, lane_all(0.25 * s->reach));
    while (sum_some(unsure)) {
        sum_reals a, b;
        SUM_EACH(h) a.of[h] = s->rays[h].t, b.of[h] = a.of[h] + width.of[h];
        sum_rest(unsure, &a, &b);
        sum_slopes f[SUM_TEAM];
        sum_slopes_on(s, (const sum_reals[]){a, b}, f);
        sum_count(s, unsure);
        SUM_EACH(h) {
            sum_rays *r = &s->rays[h];
            const lane_real e = SUM_EPSILON * (f[h].size + fabs(s->threshold)), zero = lane_all(0.0);
            const lane_real value = f[h].value_b - s->threshold;
            const lane_bits leaves = lane_both(lane_less(f[h].most, zero), lane_less(value, -e));
            const lane_bits enters = lane_both(lane_less(zero, f[h].least), lane_less(e, value));
            const lane_bits told = lane_both(unsure.of[h], lane_either(leaves, enters));
            const lane_bits flat =
                lane_without(lane_both(unsure.of[h], lane_at_most(width.of[h], sum_resolution(s, r->t))), told);
            r->sign = lane_pick(told, lane_pick(leaves, lane_all(1.0), lane_all(-1.0)), r->sign);
            r->t = lane_pick(told, b.of[h], r->t);
            sum_leave(r, flat);
            unsure.of[h] = lane_without(unsure.of[h], lane_either(told, flat));
            width.of[h] = 0.5 * width.of[h];
        }
    }
}

/* Rays that start where the surface was hit, by one interval each: the quadratic above the field starts within rounding
 * of the threshold and is below it from there on, as far as it falls steeply enough. Gives those that this does not
 * tell. */
static sum_flags sum_start_outwards(sum_search *restrict s, sum_flags on, const sum_reals *restrict limit) {
    sum_reals a, b;
    SUM_EACH(h) a.of[h] = s->rays[h].t, b.of[h] = lane_min(limit->of[h], a.of[h] + 1.5 * s->reach);
    sum_rest(on, &a, &b);
    sum_bounds f[SUM_TEAM];
    sum_bounds_on(s, (const sum_reals[]){a, b}, f);
    sum_flags rest;
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        const double T = s->threshold;
        const lane_real e = SUM_EPSILON * (f[h].size + fabs(T));
        const lane_real u0 = f[h].above[0] - T + e, u1 = f[h].above[1] - T + e, u2 = f[h].above[2] - T + e;
        const lane_bits falls = lane_both(lane_less(u1, -SUM_STEEP * e), lane_less(u2, -SUM_STEEP * e));
        const lane_bits told = lane_both(on.of[h], lane_both(falls, lane_at_most(u0, 4.0 * e)));
        r->sign = lane_pick(told, lane_all(1.0), r->sign);
        r->t = lane_pick(told, b.of[h], r->t);
        rest.of[h] = lane_without(on.of[h], told);
    }
    return rest;
}

/* Is the field above or below the threshold where the rays start? */
static void sum_start(sum_search *restrict s, const sum_reals *restrict limit) {
    const lane_real zero = lane_all(0.0);
    sum_flags need, unsure;
    sum_reals a, b;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        const lane_bits open = lane_both(lane_at_most(r->sign, zero), lane_at_most(zero, r->sign));
        need.of[h] = lane_both(lane_both(r->searching, open), lane_less(r->t, limit->of[h]));
        a.of[h] = b.of[h] = r->t;
    }
    if (!sum_some(need)) return;
    SUM_EACH(h)
    unsure.of[h] = lane_both(need.of[h], s->rays[h].on), need.of[h] = lane_without(need.of[h], unsure.of[h]);
    if (sum_some(unsure)) {
        unsure = sum_start_outwards(s, unsure, limit);
        if (sum_some(unsure)) sum_start_on_surface(s, unsure, limit);
    }
    if (!sum_some(need)) return;
    sum_rest(need, &a, &b);
    sum_point f[SUM_TEAM];
    sum_point_at(s, &a, f);
    sum_count(s, need);
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        const lane_real value = f[h].value - s->threshold, e = SUM_EPSILON * (f[h].size + fabs(s->threshold));
        const lane_bits there = lane_less(zero, f[h].size);
        unsure.of[h] = lane_both(need.of[h], lane_both(lane_at_most(lane_abs(value), e), there));
        const lane_bits out = lane_either(lane_less(value, zero), lane_without(lane_at_most(value, zero), there));
        r->sign = lane_pick(need.of[h], lane_pick(out, lane_all(1.0), lane_all(-1.0)), r->sign);
    }
    if (sum_some(unsure)) sum_start_on_surface(s, unsure, limit);
}

/* ---- one step ------------------------------------------------------------------------------------ */

/* search_first_root, moved by `slack` of itself, which takes account of the coarse quotient and root. */
LANE_INLINE lane_real sum_first_root(lane_real c0, lane_real c1, lane_real c2, double slack) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0), none = lane_all(2.0);
    const lane_real A = c0 - 2.0 * c1 + c2, B = c1 - c0, D = B * B - A * c0;
    const lane_real root = lane_coarse_root(lane_max(D, zero));
    const lane_bits rising = lane_at_most(zero, B);
    const lane_real over = lane_pick(rising, -c0, root - B), under = lane_pick(rising, B + root, A);
    const lane_bits positive = lane_less(zero, under);
    const lane_real x = lane_coarse_quotient(over, lane_pick(positive, under, one)) * (1.0 + slack);
    const lane_bits there = lane_both(lane_at_most(zero, D), lane_both(positive, lane_at_most(x, one)));
    const lane_bits hull = lane_at_most(zero, lane_max(c1, c2));
    return lane_pick(lane_less(c0, zero), lane_pick(lane_both(there, hull), x, none), zero);
}

/* What the bounds f tell of the interval [from, to] of the lanes `on`. */
LANE_INLINE void sum_settle(const sum_search *restrict s, sum_rays *restrict r, const sum_bounds *restrict f,
                            lane_bits on, lane_real from, lane_real to) {
    const double T = s->threshold;
    const lane_real e = SUM_EPSILON * (f->size + fabs(T)), width = to - from;
    const lane_bits out = lane_less(lane_all(0.0), r->sign);
    lane_real u[3], v[3];
    _Pragma("GCC unroll 3") for (int i = 0; i < 3; i++) {
        const lane_real up = f->above[i] - T, down = f->below[i] - T;
        u[i] = lane_pick(out, up, -down) + e;
        v[i] = lane_pick(out, down, -up) - e;
    }
    const lane_real root_u = sum_first_root(u[0], u[1], u[2], -SUM_SLACK);
    const lane_real root_v = sum_first_root(v[0], v[1], v[2], SUM_SLACK);
    const lane_bits empty = lane_less(lane_all(1.0), root_u), crossing = lane_at_most(root_v, lane_all(1.0));
    const lane_real moved = lane_min(from + width * root_u, to);
    const lane_real found = lane_min(from + width * root_v, to);
    const lane_real resolution = sum_resolution(s, from);
    const lane_bits flat = lane_both(lane_at_most(lane_max(lane_max(u[0], u[1]), u[2]), 3.0 * e),
                                     lane_at_most(-3.0 * e, lane_min(lane_min(v[0], v[1]), v[2])));
    const lane_bits stuck =
        lane_without(lane_either(lane_at_most(width, resolution), flat), lane_either(empty, crossing));
    const lane_bits crosses = lane_both(on, crossing);
    const lane_real now = lane_pick(empty, to, moved), left = lane_pick(crossing, found, to) - now;
    const lane_bits shrunk = lane_both(crossing, lane_at_most(left, 0.5 * width));
    const lane_real next = lane_pick(empty, 2.0 * width, lane_pick(shrunk, left, 0.5 * left));
    r->bracketed = lane_either(r->bracketed, crosses);
    r->end = lane_pick(crosses, found, r->end);
    r->t = lane_pick(on, now, r->t);
    r->step = lane_pick(on, lane_max(next, 0.5 * resolution), r->step);
    r->evaluations -= lane_mask_of(on);
    r->sandwiches -= lane_mask_of(on);
    sum_leave(r, lane_both(on, stuck));
}

/* One interval per active lane. */
static void sum_step(sum_search *restrict s, sum_flags active, const sum_reals *restrict limit) {
    sum_reals a, b;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        a.of[h] = r->t;
        b.of[h] = lane_min(limit->of[h], r->t + r->step);
    }
    sum_rest(active, &a, &b);
    sum_bounds f[SUM_TEAM];
    sum_bounds_on(s, (const sum_reals[]){a, b}, f);
    SUM_EACH(h) sum_settle(s, &s->rays[h], &f[h], active.of[h], a.of[h], b.of[h]);
}

/* ---- finish -------------------------------------------------------------------------------------- */

/* Halley's method inside brackets [a, b] with F(a) < 0 < F(b) and F' > 0, and the normals at the end. A step that is
 * more than half of the last but one is not taken, the bracket is halved instead. The step after the next would be
 * about the next one times the square of its ratio to the last, or less: where that would not matter, the next is
 * the last. trusted: the step that was before, infinity for none. */
static void sum_polish(sum_search *restrict s, sum_flags hits, sum_reals a, sum_reals b, sum_reals trusted,
                       sum_reals *restrict t) {
    const lane_real far = lane_all(BLOB_INFINITY), one = lane_all(1.0), zero = lane_all(0.0);
    sum_flags on = hits;
    sum_reals last, last_but_one;
    SUM_EACH(h) last.of[h] = last_but_one.of[h] = b.of[h] - a.of[h];
    for (int round = 0; round < 200 && sum_some(on); round++) {
        sum_jet f[SUM_TEAM];
        sum_reals at;
        SUM_EACH(h) at.of[h] = lane_pick(on.of[h], t->of[h], far);
        sum_along(s, &at, f);
        sum_count(s, on);
        SUM_EACH(h) {
            const lane_real sign = s->rays[h].sign, now = t->of[h];
            const lane_real value = sign * (f[h].value - s->threshold), slope = sign * f[h].slope;
            const lane_bits before = lane_less(value, zero), rising = lane_less(zero, slope);
            const lane_real lo = lane_pick(before, now, a.of[h]), hi = lane_pick(before, b.of[h], now);
            const lane_real inverse = one / lane_pick(rising, slope, one), newton = value * inverse;
            const lane_real turn = 1.0 - 0.5 * newton * (sign * f[h].bend) * inverse;
            const lane_real halley = now - newton / lane_min(lane_max(turn, lane_all(0.5)), lane_all(2.0));
            const lane_bits between = lane_both(lane_at_most(lo, halley), lane_at_most(halley, hi));
            const lane_bits shorter = lane_at_most(lane_abs(halley - now), 0.5 * last_but_one.of[h]);
            const lane_bits inside = lane_both(rising, lane_both(between, shorter));
            const lane_real next = lane_pick(inside, halley, 0.5 * (lo + hi)), step = lane_abs(next - now);
            const lane_real enough =
                lane_max(2.0 * DBL_EPSILON * (lane_abs(next) + 1e-2 * s->reach), lane_all(s->tolerance));
            /* step * (step / trusted)^2 <= enough / 8 */
            const lane_bits settled = lane_both(
                inside, lane_both(lane_less(trusted.of[h], far),
                                  lane_at_most(step * step * step, 0.125 * enough * trusted.of[h] * trusted.of[h])));
            const lane_bits done = lane_either(lane_either(lane_at_most(step, enough), settled), lane_at_most(hi, lo));
            a.of[h] = lane_pick(on.of[h], lo, a.of[h]);
            b.of[h] = lane_pick(on.of[h], hi, b.of[h]);
            last_but_one.of[h] = last.of[h];
            last.of[h] = step;
            trusted.of[h] = lane_pick(inside, step, far);
            t->of[h] = lane_pick(on.of[h], next, now);
            on.of[h] = lane_without(on.of[h], done);
        }
    }
    sum_reals at;
    SUM_EACH(h) at.of[h] = lane_pick(hits.of[h], t->of[h], far);
    sum_point f[SUM_TEAM];
    sum_point_at(s, &at, f);
    sum_count(s, hits);
    SUM_EACH(h)
    for (int k = 0; k < 3; k++) s->rays[h].normal[k] = lane_pick(hits.of[h], f[h].gradient[k], s->rays[h].normal[k]);
}

/* Where F is about 0 between a and b: t as a cubic polynomial of F, through the values and slopes at both ends. */
LANE_INLINE lane_real sum_guess(lane_real a, lane_real b, lane_real fa, lane_real fb, lane_real slope_a,
                                lane_real slope_b) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    const lane_bits change = lane_both(lane_less(fa, zero), lane_less(zero, fb));
    const lane_real gap = lane_pick(change, fb - fa, one), x = lane_pick(change, -fa / gap, lane_all(0.5)), y = 1.0 - x;
    const lane_real linear = a + (b - a) * lane_pick(change, x, lane_pick(lane_at_most(fb, zero), one, zero));
    const lane_bits rising = lane_both(lane_less(zero, slope_a), lane_less(zero, slope_b));
    const lane_real p = lane_pick(rising, slope_a, one), q = lane_pick(rising, slope_b, one);
    const lane_real cubic = a + (b - a) * (x * x * (3.0 - 2.0 * x)) + gap * x * y * (y * q - x * p) / (p * q);
    const lane_bits good = lane_both(lane_both(change, rising), lane_both(lane_less(a, cubic), lane_less(cubic, b)));
    return lane_pick(good, cubic, linear);
}

/* Brackets narrow enough: prove that the slope has one sign, then polish. Those that fail get narrower. */
static void sum_finish(sum_search *restrict s, sum_flags ripe) {
    const lane_real zero = lane_all(0.0);
    sum_reals a, b, hit;
    SUM_EACH(h) a.of[h] = s->rays[h].t, b.of[h] = s->rays[h].end;
    sum_rest(ripe, &a, &b);
    sum_slopes f[SUM_TEAM];
    sum_slopes_on(s, (const sum_reals[]){a, b}, f);
    sum_count(s, ripe);
    sum_flags one;
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        const lane_real width = r->end - r->t;
        const lane_real least = lane_pick(lane_less(zero, r->sign), f[h].least, -f[h].most);
        one.of[h] = lane_both(ripe.of[h], lane_less(zero, least));
        const lane_bits not = lane_without(ripe.of[h], one.of[h]);
        sum_leave(r, lane_both(not, lane_at_most(width, sum_resolution(s, r->t))));
        r->ripe = lane_pick(not, 0.125 * width, r->ripe);
    }
    if (!sum_some(one)) return;
    SUM_EACH(h) {
        const lane_real sign = s->rays[h].sign;
        hit.of[h] = sum_guess(a.of[h], b.of[h], sign * (f[h].value_a - s->threshold),
                              sign * (f[h].value_b - s->threshold), sign * f[h].slope_a, sign * f[h].slope_b);
    }
    sum_polish(s, one, a, b, (sum_reals){{lane_all(BLOB_INFINITY), lane_all(BLOB_INFINITY)}}, &hit);
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        r->hit_t = lane_pick(one.of[h], hit.of[h], r->hit_t);
        r->hit = lane_either(r->hit, one.of[h]);
        r->searching = lane_without(r->searching, one.of[h]);
    }
}

/* Rays probably enter at `guess`: proves for which that is so, within a narrow bracket, and where. What lies before the
 * bracket is still to be searched, as far as all leaves up to `known` are in the packet. */
static void sum_pin(sum_search *restrict s, const sum_reals *restrict guess, double known) {
    sum_reals a, b, hit, trusted;
    sum_flags on;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        a.of[h] = guess->of[h] - SUM_PIN * s->reach, b.of[h] = guess->of[h] + SUM_PIN * s->reach;
        trusted.of[h] = lane_all(0.5 * SUM_PIN * s->reach);
        const lane_bits within =
            lane_both(lane_less(r->t, a.of[h]), lane_less(b.of[h], lane_min(r->end, lane_all(known))));
        on.of[h] = lane_both(lane_both(r->searching, lane_less(lane_all(0.0), r->sign)), within);
    }
    if (!sum_some(on)) return;
    sum_rest(on, &a, &b);
    sum_slopes f[SUM_TEAM];
    sum_slopes_on(s, (const sum_reals[]){a, b}, f);
    sum_count(s, on);
    SUM_EACH(h) {
        const lane_real e = SUM_EPSILON * (f[h].size + fabs(s->threshold));
        const lane_real fa = f[h].value_a - s->threshold, fb = f[h].value_b - s->threshold;
        const lane_bits enters = lane_both(lane_less(fa, -e), lane_less(e, fb));
        on.of[h] = lane_both(on.of[h], lane_both(enters, lane_less(lane_all(0.0), f[h].least)));
        hit.of[h] = sum_guess(a.of[h], b.of[h], fa, fb, f[h].slope_a, f[h].slope_b);
    }
    if (!sum_some(on)) return;
    sum_polish(s, on, a, b, trusted, &hit);
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        r->pinned = on.of[h];
        r->pin = hit.of[h];
        r->end = lane_pick(on.of[h], a.of[h], r->end);
    }
}

/* At the end of the search: nothing was before the pins. */
static void sum_unpin(sum_search *restrict s) {
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        const lane_bits hit = lane_without(r->pinned, lane_either(r->hit, r->left));
        r->hit_t = lane_pick(hit, r->pin, r->hit_t);
        r->hit = lane_either(r->hit, hit);
    }
}

/* ---- search -------------------------------------------------------------------------------------- */

/* Where the next leaf of each ray begins: at its t or before where it is in one. */
static sum_reals sum_next(const sum_search *restrict s) {
    const lane_real far = lane_all(BLOB_INFINITY);
    const sum_leaf *leaves = s->scratch->leaves;
    sum_reals next;
    SUM_EACH(h) next.of[h] = far;
    for (size_t i = 0; i < s->leaf_count; i++) SUM_EACH(h)
    next.of[h] = lane_min(next.of[h], lane_pick(lane_less(s->rays[h].t, leaves[i].exit[h]), leaves[i].enter[h], far));
    return next;
}

/* Rays with anything left before `limit`, brought to where the next leaf begins: between leaves the field is 0, and
 * nothing happens there unless 0 is on the wrong side. */
static sum_flags sum_active(sum_search *restrict s, const sum_reals *restrict limit) {
    sum_flags active, idle;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        active.of[h] = lane_both(r->searching, lane_less(r->t, limit->of[h]));
        const lane_bits right = lane_less(lane_all(0.0), r->sign * s->threshold);
        idle.of[h] = lane_without(lane_both(active.of[h], right), r->bracketed);
    }
    if (!sum_some(idle)) return active;
    const sum_reals next = sum_next(s);
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        r->t = lane_pick(idle.of[h], lane_max(r->t, lane_min(next.of[h], limit->of[h])), r->t);
        active.of[h] = lane_both(active.of[h], lane_less(r->t, limit->of[h]));
    }
    return active;
}

/* Do narrow brackets wait, for rays that have to go on behind `known`? */
LANE_INLINE int sum_waits(const sum_search *restrict s, double known) {
    sum_flags waits;
    if (s->apart) return 0;
    SUM_EACH(h) {
        const sum_rays *r = &s->rays[h];
        waits.of[h] = lane_both(lane_without(r->searching, r->bracketed), lane_less(lane_all(known), r->end));
    }
    return sum_some(waits);
}

/* Search up to `known`: every leaf that begins before it is in the packet. Narrow brackets wait for rays that have to
 * go on: all are finished together. */
static void sum_advance(sum_search *restrict s, double known) {
    sum_reals limit;
    SUM_EACH(h) limit.of[h] = lane_min(lane_all(known), s->rays[h].end);
    sum_start(s, &limit);
    for (int round = 0;; round++) {
        const sum_flags active = sum_active(s, &limit);
        sum_flags ripe, wide;
        SUM_EACH(h) {
            sum_rays *r = &s->rays[h];
            const lane_bits narrow = lane_at_most(r->end - r->t, lane_max(r->ripe, sum_resolution(s, r->t)));
            ripe.of[h] = lane_both(lane_both(active.of[h], r->bracketed), narrow);
            wide.of[h] = lane_without(active.of[h], ripe.of[h]);
        }
        if (round == SUM_ROUNDS) {
            SUM_EACH(h) sum_leave(&s->rays[h], active.of[h]);
            break;
        }
        if (sum_some(wide)) sum_step(s, wide, &limit);
        else if (sum_some(ripe) && !sum_waits(s, known)) sum_finish(s, ripe);
        else break;
        SUM_EACH(h) {
            sum_rays *r = &s->rays[h];
            const lane_bits found = lane_both(r->searching, r->bracketed);
            limit.of[h] = lane_pick(r->bracketed, r->end, limit.of[h]);
            if (s->any) {
                r->hit = lane_either(r->hit, found);
                r->searching = lane_without(r->searching, found);
            } else {
                sum_leave(r, lane_without(found, lane_less(r->t, r->end))); /* closed up without a proof of monotony */
            }
        }
    }
    SUM_EACH(h) {
        sum_rays *r = &s->rays[h];
        r->searching = lane_both(r->searching, lane_less(r->t, r->end));
    }
}

#endif
