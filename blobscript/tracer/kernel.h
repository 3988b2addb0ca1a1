/* kernel.h - the kernels as functions of s = dist^2 / R^2, for one number at a time.
 *
 * Every built-in kernel phi(s) = D(sqrt(s)) falls and is convex in s >= 0, its zero extension past
 * s = 1 included. So on [s_lo, s_hi] it lies below its chord and above its tangent at any point:
 *
 *     phi(m) + phi'(m) (s - m)  <=  phi(s)  <=  phi(s_lo) + [phi; s_lo, s_hi] (s - s_lo)
 *
 * with the divided difference [phi; u, v] = (phi(v) - phi(u)) / (v - u) in closed form where there is
 * one. Written without branches on data so that loops over lanes vectorise.
 */
#ifndef BLOB_KERNEL_H
#define BLOB_KERNEL_H

#include <math.h>
#include <string.h>

#include "scene.h"

#define BLOB_INFINITY ((double)INFINITY)
#define BLOB_NAN ((double)NAN)

#define KERNEL_INLINE static inline __attribute__((always_inline))

/* Value and derivative in s. */
typedef struct kernel_jet {
    double value, slope;
} kernel_jet;

/* Lines above and below phi on [s_lo, s_hi]:  value + slope * (s - at). `steep` bounds |phi'| there. */
typedef struct kernel_lines {
    double upper_value, upper_slope, upper_at;
    double lower_value, lower_slope, lower_at;
    double top, steep;
} kernel_lines;

KERNEL_INLINE double kernel_max(double a, double b) { return a > b ? a : b; }
KERNEL_INLINE double kernel_min(double a, double b) { return a < b ? a : b; }

/* e^x for x <= 0, to 1 ulp; 0 below -700. Cody-Waite reduction, Taylor on |r| <= ln(2)/2. */
KERNEL_INLINE double kernel_exp(double x) {
    const double big = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer */
    const double clamped = x > -700.0 ? x : -700.0;
    const double shifted = clamped * 1.4426950408889634 + big;
    const double n = shifted - big;
    const double r = (clamped - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    double p = 1.0 / 6227020800.0;
    p = p * r + 1.0 / 479001600.0;
    p = p * r + 1.0 / 39916800.0;
    p = p * r + 1.0 / 3628800.0;
    p = p * r + 1.0 / 362880.0;
    p = p * r + 1.0 / 40320.0;
    p = p * r + 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = p * (r * r) + r + 1.0;
    int64_t bits;
    memcpy(&bits, &shifted, sizeof bits); /* low bits of `shifted` hold n */
    bits = (int64_t)((uint64_t)bits << 52);
    int64_t scaled;
    memcpy(&scaled, &p, sizeof scaled);
    scaled = (int64_t)((uint64_t)scaled + (uint64_t)bits);
    double result;
    memcpy(&result, &scaled, sizeof result);
    return x > -700.0 ? result : 0.0;
}

/* (e^x - 1 - x) e^-a for 0 <= x <= a: by its series where the subtraction would cancel. */
KERNEL_INLINE double kernel_c1_bump(double x, double s, double a, double tail) {
    double q = 1.0;
    for (int i = 17; i >= 3; i--) q = 1.0 + q * x / (double)i;
    const double series = tail * (0.5 * x * x) * q;
    const double direct = kernel_exp(-a * s) - tail * (1.0 + x);
    return x < 1.0 ? series : direct;
}

/* (e^x - 1) e^-a, likewise: minus the slope of the bump, over a. */
KERNEL_INLINE double kernel_c1_rise(double x, double s, double a, double tail) {
    double q = 1.0;
    for (int i = 17; i >= 2; i--) q = 1.0 + q * x / (double)i;
    const double direct = kernel_exp(-a * s) - tail;
    return x < 1.0 ? tail * x * q : direct;
}

/* dD/ds = D'(r) / (2 r). At the skeleton that is D''(0) / 2 if D'(0) = 0. Else (a crease) it has no bound, and
 * is taken at r = 1e-8 from there on: what that misses, |D'| 1e-8, is below the rounding it stands for, and
 * with no cap the rounding bound of every interval with the skeleton in it would be infinite. */
static inline double kernel_slope_in_s(const blob_piece *piece, double slope, double r) {
    const int crease = piece->centre != 0.0 || (piece->degree >= 1 && piece->coefficients[1] != 0.0);
    if (crease) return slope / (2.0 * kernel_max(r, 1e-8));
    if (r > 0.0) return slope / (2.0 * r);
    return piece->degree >= 2 ? piece->coefficients[2] / (piece->half * piece->half) : 0.0;
}

/* One piece of a user kernel and its slope in s, at s. */
static inline kernel_jet kernel_piece_jet(const blob_piece *piece, double s) {
    const double r = sqrt(s);
    const double x = ((piece->in_s ? s : r) - piece->centre) / piece->half;
    double value = piece->coefficients[piece->degree], slope = 0.0;
    for (int32_t i = piece->degree - 1; i >= 0; i--) {
        slope = slope * x + value;
        value = value * x + piece->coefficients[i];
    }
    slope /= piece->half;
    if (!piece->in_s) slope = kernel_slope_in_s(piece, slope, r);
    return (kernel_jet){value, slope};
}

static inline const blob_piece *kernel_piece_at(const blob_scene *scene, const blob_kernel *kernel, double s) {
    const blob_piece *piece = scene->pieces + kernel->first_piece;
    const blob_piece *last = piece + kernel->piece_count - 1;
    while (piece < last && s > piece->s_hi) piece++;
    return piece;
}

static inline kernel_jet kernel_user_jet(const blob_scene *scene, const blob_kernel *kernel, double s) {
    if (s >= 1.0) return (kernel_jet){0.0, 0.0};
    return kernel_piece_jet(kernel_piece_at(scene, kernel, s), s);
}

/* phi(s) and phi'(s). `id` is a constant at each call in a hot loop. */
KERNEL_INLINE kernel_jet kernel_value(int id, const blob_scene *scene, const blob_kernel *kernel, double s) {
    const double p = kernel_max(1.0 - s, 0.0);
    switch (id) {
        case KERNEL_SOFT2: return (kernel_jet){p * p, -2.0 * p};
        case KERNEL_SOFT3: return (kernel_jet){p * p * p, -3.0 * p * p};
        case KERNEL_WYVILL:
            return (kernel_jet){p * p * (5.0 + 4.0 * p) * (1.0 / 9.0), -p * (10.0 + 12.0 * p) * (1.0 / 9.0)};
        case KERNEL_GAUSS: {
            const double v = kernel_exp(-kernel->a * s);
            return (kernel_jet){v, -kernel->a * v};
        }
        case KERNEL_GAUSS_C1: {
            const double x = kernel->a * p, c = kernel->norm;
            const double inside = p > 0.0 ? c : 0.0;
            return (kernel_jet){inside * kernel_c1_bump(x, s, kernel->a, kernel->tail),
                                -inside * kernel->a * kernel_c1_rise(x, s, kernel->a, kernel->tail)};
        }
        case KERNEL_METABALL: {
            const double r = sqrt(s), q = kernel_max(1.0 - r, 0.0);
            const double safe = r > 0.3 ? r : 0.3;
            return s < 1.0 / 9.0 ? (kernel_jet){1.0 - 3.0 * s, -3.0} : (kernel_jet){1.5 * q * q, -1.5 * q / safe};
        }
        default: return kernel_user_jet(scene, kernel, s);
    }
}

/* Lines above and below phi on [s_lo, s_hi], s_lo <= s_mid <= s_hi, of a built-in kernel (others: user.h). */
KERNEL_INLINE kernel_lines kernel_bounds(int id, const blob_scene *scene, const blob_kernel *kernel, double s_lo,
                                         double s_hi, double s_mid) {
    const kernel_jet lo = kernel_value(id, scene, kernel, s_lo);
    const kernel_jet mid = kernel_value(id, scene, kernel, s_mid);
    double chord;
    if (id == KERNEL_SOFT2 || id == KERNEL_SOFT3 || id == KERNEL_WYVILL) {
        const double p = kernel_max(1.0 - s_lo, 0.0), q = 1.0 - s_hi;
        double inside; /* both ends within the reach: closed form */
        if (id == KERNEL_SOFT2) inside = -(p + q);
        else if (id == KERNEL_SOFT3) inside = -(p * p + p * q + q * q);
        else inside = -(5.0 * (p + q) + 4.0 * (p * p + p * q + q * q)) * (1.0 / 9.0);
        const double gap = s_hi - s_lo;
        const double across = -lo.value / (gap > 0.0 ? gap : 1.0);
        chord = q >= 0.0 ? inside : across;
    } else {
        const kernel_jet hi = kernel_value(id, scene, kernel, s_hi);
        const double gap = s_hi - s_lo;
        const double difference = (hi.value - lo.value) / (gap > 0.0 ? gap : 1.0);
        chord = gap > 0.0 ? difference : lo.slope;
    }
    return (kernel_lines){lo.value, chord, s_lo, mid.value, mid.slope, s_mid, lo.value, -lo.slope};
}

#endif
