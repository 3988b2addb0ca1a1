/* joint.h - smooth maxima of what a node's children contribute.
 *
 * With f+ = max(f, 0), x = f+ / max f+ and m = SHARPNESS, a smooth maximum is the mean of the densities weighted by
 * their m-th powers (joints.py, which is the specification, says what that is good for):
 *
 *     L = sum f+^(m + 1) / sum f+^m = sum of w f+,    w = x^m / sum x^m
 *     dL/df = w + m k (f - L) = k ((m + 1) f - m L),  k = w / f = x^(m - 1) / (max f+ * sum x^m)
 *
 * A smooth minimum is the same of -f, negated. On an interval, ranges of all f give ranges of w, k and L, these the
 * range of L' = sum of dL/df f', and values at both ends with that range two quadratics around L:
 *
 *     |L - chord| <= h (max L' - min L') u (1 - u),   u = (t - a) / h
 *
 * since L lies below the steepest line from a and the flattest into b, whose distances from the chord, A and B, at
 * its other end add up to h (max L' - min L'), and min(A u, B (1 - u)) <= (A + B) u (1 - u).
 */
#ifndef BLOB_JOINT_H
#define BLOB_JOINT_H

#include <float.h>

#include "tree.h"

/* ORDER SHARPNESS: m, the same number in joints.py. */
enum { SHARPNESS = 8 };
/* Bounds of dL/df whatever the densities: (m + 1)^2 / (4 m) and -((m - 1) / m)^(m - 1), rounded outwards. */
static const double JOINT_STEEPEST = 2.532, JOINT_LEAST = -0.393;

/* x^(m - 1) */
LANE_INLINE lane_real joint_power(lane_real x) {
    const lane_real x2 = x * x, x4 = x2 * x2;
    return x4 * x2 * x;
}

LANE_INLINE lane_real joint_positive(lane_real f) { return lane_max(f, lane_all(0.0)); }

/* 1 where x is 0. */
LANE_INLINE lane_real joint_divisor(lane_real x) { return lane_select(x > 0.0, x, lane_all(1.0)); }

LANE_INLINE double joint_sense(int32_t op) { return op == OP_SMOOTH_MAX ? 1.0 : -1.0; }

static void joint_point(int32_t op, const leaf_point *children, int32_t count, leaf_point *into) {
    const double sense = joint_sense(op), m = (double)SHARPNESS;
    const lane_real zero = lane_all(0.0);
    lane_real top = zero, total = zero, sum = zero;
    for (int32_t i = 0; i < count; i++) top = lane_max(top, sense * lane_load(children[i].value));
    const lane_real scale = 1.0 / joint_divisor(top);
    for (int32_t i = 0; i < count; i++) {
        const lane_real x = joint_positive(sense * lane_load(children[i].value)) * scale, w = joint_power(x) * x;
        total += w;
        sum += w * x;
    }
    const lane_real share = 1.0 / joint_divisor(total), mean = sum * share, value = top * mean;
    lane_real gradient[3] = {zero, zero, zero}, magnitude = value;
    for (int32_t i = 0; i < count; i++) {
        const lane_real x = joint_positive(sense * lane_load(children[i].value)) * scale;
        const lane_real rate = joint_power(x) * ((m + 1.0) * x - m * mean) * share;
        for (int k = 0; k < 3; k++) gradient[k] += rate * lane_load(children[i].gradient[k]);
        magnitude += lane_abs(rate) * lane_load(children[i].magnitude);
    }
    lane_store(into->value, sense * value);
    for (int k = 0; k < 3; k++) lane_store(into->gradient[k], gradient[k]);
    lane_store(into->magnitude, magnitude);
}

/* Ranges over the interval, of one child or of the joint; densities with the sign of a smooth maximum. */
typedef struct joint_range {
    lane_real lo, hi;
} joint_range;

LANE_INLINE joint_range joint_child(const leaf_slopes *child, double sense) {
    const lane_real lo = lane_load(child->value_lo), hi = lane_load(child->value_hi);
    return sense > 0.0 ? (joint_range){joint_positive(lo), joint_positive(hi)}
                       : (joint_range){joint_positive(-hi), joint_positive(-lo)};
}

/* What all children together tell. */
typedef struct joint_whole {
    double rounding;       /* of sums, relative */
    lane_real scale;       /* 1 / the largest value possible */
    lane_real first, next; /* the two largest values possible */
    lane_real least, most; /* sum of x^m */
    joint_range value;     /* L, by shares */
    lane_real at_a, at_b;
} joint_whole;

/* The share of one child: x^m in [w.lo, w.hi], sums of all as in `all`; what is left of these without the child
 * may have cancelled. */
LANE_INLINE joint_range joint_share(const joint_whole *all, joint_range w) {
    const lane_real one = lane_all(1.0);
    const lane_real least = w.lo + joint_positive(all->most - w.hi) + all->rounding * all->most;
    const lane_real most = w.hi + joint_positive(all->least - w.lo - all->rounding * all->least);
    return (joint_range){w.lo / joint_divisor(least), lane_min(w.hi / joint_divisor(most), one)};
}

LANE_INLINE joint_range joint_weight(const joint_whole *all, joint_range f) {
    const lane_real lo = f.lo * all->scale, hi = f.hi * all->scale;
    return (joint_range){joint_power(lo) * lo, joint_power(hi) * hi};
}

static joint_whole joint_survey(const leaf_slopes *children, int32_t count, double sense) {
    const lane_real zero = lane_all(0.0);
    joint_whole all = {2.0 * DBL_EPSILON * (double)count, zero, zero, zero, zero, zero, {zero, zero}, zero, zero};
    for (int32_t i = 0; i < count; i++) {
        const lane_real hi = joint_child(&children[i], sense).hi;
        all.next = lane_max(all.next, lane_min(all.first, hi));
        all.first = lane_max(all.first, hi);
    }
    all.scale = 1.0 / joint_divisor(all.first);
    lane_real total_a = zero, total_b = zero, sum_a = zero, sum_b = zero;
    for (int32_t i = 0; i < count; i++) {
        const joint_range w = joint_weight(&all, joint_child(&children[i], sense));
        const lane_real xa = joint_positive(sense * lane_load(children[i].at_a)) * all.scale;
        const lane_real xb = joint_positive(sense * lane_load(children[i].at_b)) * all.scale;
        const lane_real wa = joint_power(xa) * xa, wb = joint_power(xb) * xb;
        all.least += w.lo;
        all.most += w.hi;
        total_a += wa, sum_a += wa * xa;
        total_b += wb, sum_b += wb * xb;
    }
    all.at_a = all.first * (sum_a / joint_divisor(total_a));
    all.at_b = all.first * (sum_b / joint_divisor(total_b));
    lane_real given = zero;
    for (int32_t i = 0; i < count; i++) {
        const joint_range f = joint_child(&children[i], sense);
        const lane_real share = joint_share(&all, joint_weight(&all, f)).lo;
        given += share;
        all.value.lo += share * f.lo;
        all.value.hi += share * f.hi;
    }
    all.value.hi = lane_min(all.value.hi + joint_positive(1.0 - given) * all.first, all.first);
    return all;
}

/* Range of dL/df. f - L is (1 - w) (f - the mean of the others), too. */
static joint_range joint_rate(const joint_whole *all, joint_range f) {
    const double m = (double)SHARPNESS;
    const lane_real zero = lane_all(0.0), one = lane_all(1.0), xl = f.lo * all->scale, xu = f.hi * all->scale;
    const lane_real power_lo = joint_power(xl), power_hi = joint_power(xu);
    const joint_range share = joint_share(all, (joint_range){power_lo * xl, power_hi * xu});
    const lane_mask known = all->least > 0.0, only = f.hi >= all->first;
    lane_real steep = lane_select(known, power_hi * all->scale / joint_divisor(all->least), lane_all(BLOB_INFINITY));
    steep = lane_select(f.lo > 0.0, lane_min(steep, share.hi / joint_divisor(f.lo)), steep);
    const lane_real flat = power_lo * all->scale / joint_divisor(all->most);
    const lane_real others = lane_select(only, all->next, all->first);
    const lane_real left_lo = joint_positive(one - share.hi), left_hi = one - share.lo;
    const lane_real down = f.lo - others;
    const lane_real above = lane_max(f.lo - all->value.hi, down * lane_select(down < 0.0, left_hi, left_lo));
    const lane_real below = lane_min(f.hi - all->value.lo, f.hi * left_hi);
    lane_real lo = share.lo + m * above * lane_select(above < 0.0, steep, flat);
    lane_real hi = share.hi + m * below * lane_select(below > 0.0, steep, flat);
    /* infinity times 0 is no number, and then no bound */
    lo = lane_select(lo > JOINT_LEAST, lo, lane_all(JOINT_LEAST));
    hi = lane_select(hi < JOINT_STEEPEST, hi, lane_all(JOINT_STEEPEST));
    const lane_mask felt = f.hi > 0.0;
    return (joint_range){lane_select(felt, lane_min(lo, hi), zero), lane_select(felt, lane_max(lo, hi), zero)};
}

static void joint_slopes(int32_t op, const leaf_slopes *children, int32_t count, const double *restrict a,
                         const double *restrict b, leaf_slopes *into) {
    const double sense = joint_sense(op);
    const lane_real zero = lane_all(0.0), start = lane_load(a), end = lane_load(b);
    const lane_real h = lane_select(end > start, end - start, zero);
    const joint_whole all = joint_survey(children, count, sense);
    lane_real slope_lo = zero, slope_hi = zero, magnitude = all.value.hi;
    for (int32_t i = 0; i < count; i++) {
        const joint_range rate = joint_rate(&all, joint_child(&children[i], sense));
        const lane_real lo = lane_load(children[i].slope_lo), hi = lane_load(children[i].slope_hi);
        const lane_real x0 = rate.lo * lo, x1 = rate.lo * hi, x2 = rate.hi * lo, x3 = rate.hi * hi;
        slope_lo += lane_min(lane_min(x0, x1), lane_min(x2, x3));
        slope_hi += lane_max(lane_max(x0, x1), lane_max(x2, x3));
        magnitude += lane_max(lane_abs(rate.lo), lane_abs(rate.hi)) * lane_load(children[i].magnitude);
    }
    /* the slopes are those of the field itself; the values still have the sign of a smooth maximum */
    const lane_real rise = joint_positive(sense * (sense > 0.0 ? slope_hi : slope_lo)) * h;
    const lane_real fall = joint_positive(-sense * (sense > 0.0 ? slope_lo : slope_hi)) * h;
    const lane_real highest = lane_min(lane_min(all.value.hi, all.at_a + rise), all.at_b + fall);
    const lane_real lowest = lane_max(lane_max(all.value.lo, all.at_a - fall), all.at_b - rise);
    const lane_real hi = lane_max(highest, lane_max(all.at_a, all.at_b));
    const lane_real lo = lane_min(lowest, lane_min(all.at_a, all.at_b));
    lane_store(into->value_lo, sense > 0.0 ? lo : -hi);
    lane_store(into->value_hi, sense > 0.0 ? hi : -lo);
    lane_store(into->slope_lo, slope_lo);
    lane_store(into->slope_hi, slope_hi);
    lane_store(into->at_a, sense * all.at_a);
    lane_store(into->at_b, sense * all.at_b);
    lane_store(into->magnitude, magnitude);
}

/* Quadratics around a joint from its slopes, or constants where these are nearer in the middle. */
static void joint_bounds(const leaf_slopes *of, const double *restrict a, const double *restrict b, leaf_bounds *into) {
    const lane_real zero = lane_all(0.0), start = lane_load(a), end = lane_load(b);
    const lane_real h = lane_select(end > start, end - start, zero), at_a = lane_load(of->at_a),
                    at_b = lane_load(of->at_b), chord = 0.5 * (at_a + at_b);
    const lane_real bend = 0.5 * h * (lane_load(of->slope_hi) - lane_load(of->slope_lo));
    const lane_real hi = lane_load(of->value_hi), lo = lane_load(of->value_lo);
    const lane_mask top = chord + 0.5 * bend > hi, bottom = chord - 0.5 * bend < lo;
    lane_store(into->upper[0], lane_select(top, hi, at_a));
    lane_store(into->upper[1], lane_select(top, hi, chord + bend));
    lane_store(into->upper[2], lane_select(top, hi, at_b));
    lane_store(into->lower[0], lane_select(bottom, lo, at_a));
    lane_store(into->lower[1], lane_select(bottom, lo, chord - bend));
    lane_store(into->lower[2], lane_select(bottom, lo, at_b));
    lane_store(into->magnitude, lane_load(of->magnitude));
}

#endif
