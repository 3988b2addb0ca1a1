/* user.h - user kernels for LANES numbers at a time: the piecewise polynomials of kernel.h, every piece
 * between the smallest and the largest s evaluated for all lanes and picked by s. On one piece chord and
 * tangent bound phi as they do for the built-in kernels (swapped where it is concave); across joints the
 * values at the ends and at the joints between do, since pieces are monotone. */
#ifndef BLOB_USER_H
#define BLOB_USER_H

#include "kernel.h"
#include "lane.h"

typedef struct user_jet {
    lane_real value, slope;
    lane_real piece; /* number of the piece; piece_count: beyond the reach */
} user_jet;

/* Lines as in kernel_lines, and the range of phi'. */
typedef struct user_lines {
    LANE_ALIGN double upper_value[LANES], upper_slope[LANES], upper_at[LANES];
    LANE_ALIGN double lower_value[LANES], lower_slope[LANES], lower_at[LANES];
    LANE_ALIGN double top[LANES], steep[LANES], slope_lo[LANES], slope_hi[LANES];
} user_lines;

/* kernel_piece_jet for LANES numbers. */
LANE_INLINE void user_piece_jet(const blob_piece *piece, lane_real s, lane_real r, lane_real *value, lane_real *slope) {
    const lane_real x =
        (lane_select(lane_all(piece->in_s ? 1.0 : -1.0) > 0.0, s, r) - piece->centre) * (1.0 / piece->half);
    lane_real v = lane_all(piece->coefficients[piece->degree]), d = lane_all(0.0);
    for (int32_t i = piece->degree - 1; i >= 0; i--) {
        d = d * x + v;
        v = v * x + piece->coefficients[i];
    }
    d *= 1.0 / piece->half;
    if (!piece->in_s) { /* kernel_slope_in_s */
        const int crease = piece->centre != 0.0 || (piece->degree >= 1 && piece->coefficients[1] != 0.0);
        const lane_real floor = lane_all(crease ? 1e-8 : 1e-300);
        const double at_0 = !crease && piece->degree >= 2 ? piece->coefficients[2] / (piece->half * piece->half) : 0.0;
        const lane_real in_s = d / (2.0 * lane_max(r, floor));
        d = lane_select(r > (crease ? -1.0 : 0.0), in_s, lane_all(at_0));
    }
    *value = v;
    *slope = d;
}

/* The smallest and the largest of the lanes; NaN counts for nothing. */
LANE_INLINE double user_least(lane_real s) {
    double least = BLOB_INFINITY;
    for (int l = 0; l < LANES; l++) least = s[l] < least ? s[l] : least;
    return least;
}
LANE_INLINE double user_most(lane_real s) {
    double most = -BLOB_INFINITY;
    for (int l = 0; l < LANES; l++) most = s[l] > most ? s[l] : most;
    return most;
}

/* Number of the piece that s lies in: the first that ends at s or behind, else the last one. */
static int32_t user_piece_of(const blob_scene *scene, const blob_kernel *kernel, double s) {
    const blob_piece *pieces = scene->pieces + kernel->first_piece;
    int32_t lo = 0, hi = kernel->piece_count - 1;
    while (lo < hi) {
        const int32_t middle = (lo + hi) / 2;
        if (s <= pieces[middle].s_hi) hi = middle;
        else lo = middle + 1;
    }
    return lo;
}

static user_jet user_at(const blob_scene *scene, const blob_kernel *kernel, lane_real s) {
    user_jet jet = {lane_all(0.0), lane_all(0.0), lane_all((double)kernel->piece_count)};
    const lane_real r = lane_sqrt(s);
    lane_mask left = s < 1.0;
    if (!lane_any(left)) return jet;
    for (int32_t i = user_piece_of(scene, kernel, user_least(s)); i < kernel->piece_count && lane_any(left); i++) {
        const blob_piece *piece = &scene->pieces[kernel->first_piece + i];
        const int last = i + 1 == kernel->piece_count;
        lane_mask here = left;
        if (!last) here &= s <= piece->s_hi;
        left &= ~here;
        if (!lane_any(here)) continue;
        lane_real value, slope;
        user_piece_jet(piece, s, r, &value, &slope);
        jet.value = lane_select(here, value, jet.value);
        jet.slope = lane_select(here, slope, jet.slope);
        jet.piece = lane_select(here, lane_all((double)i), jet.piece);
    }
    return jet;
}

/* Lines above and below phi on [lo, hi], lo <= mid <= hi. */
static void user_bounds(const blob_scene *scene, const blob_kernel *kernel, const double *at_lo, const double *at_hi,
                        const double *at_mid, user_lines *lines) {
    const lane_real lo = lane_load(at_lo), hi = lane_load(at_hi), mid = lane_load(at_mid), zero = lane_all(0.0);
    const user_jet u = user_at(scene, kernel, lo), v = user_at(scene, kernel, hi);
    const lane_mask one = (u.piece == v.piece) & (hi < 1.0), out = hi >= 1.0;
    const user_jet m = lane_any(one) ? user_at(scene, kernel, mid) : u; /* counts on one piece only */
    lane_real most = lane_max(u.value, v.value), least = lane_min(u.value, v.value);
    lane_real slope_lo = lane_min(u.slope, v.slope), slope_hi = lane_max(u.slope, v.slope);
    lane_mask concave = lane_all(0.0) != lane_all(0.0);
    const double furthest = user_most(hi);
    for (int32_t i = user_piece_of(scene, kernel, user_least(lo)); i < kernel->piece_count; i++) {
        const blob_piece *piece = &scene->pieces[kernel->first_piece + i];
        if (piece->convex < 0) concave |= u.piece == (double)i;
        if (!(furthest > piece->s_hi)) break;
        /* its right end, with the slopes on both sides; the last one ends at the reach */
        const lane_mask between = (lo < piece->s_hi) & (hi > piece->s_hi);
        most = lane_select(between & (most < piece->end_value_hi), lane_all(piece->end_value_hi), most);
        least = lane_select(between & (least > piece->end_value_lo), lane_all(piece->end_value_lo), least);
        slope_hi = lane_select(between & (slope_hi < piece->end_slope_hi), lane_all(piece->end_slope_hi), slope_hi);
        slope_lo = lane_select(between & (slope_lo > piece->end_slope_lo), lane_all(piece->end_slope_lo), slope_lo);
    }
    most = lane_select(out, lane_max(most, zero), most);
    least = lane_select(out, lane_min(least, zero), least);
    slope_hi = lane_select(out, lane_max(slope_hi, zero), slope_hi);
    slope_lo = lane_select(out, lane_min(slope_lo, zero), slope_lo);

    const lane_real gap = hi - lo;
    const lane_mask wide = gap > 0.0;
    const lane_real chord = lane_select(wide, (v.value - u.value) / lane_select(wide, gap, lane_all(1.0)), u.slope);
    /* the chord starts at lo, the tangent touches at mid; across joints both are constants */
    const lane_mask above = one & ~concave, below = one & concave;
    lane_store(lines->upper_value, lane_select(above, u.value, lane_select(below, m.value, most)));
    lane_store(lines->upper_slope, lane_select(above, chord, lane_select(below, m.slope, zero)));
    lane_store(lines->upper_at, lane_select(below, mid, lo));
    lane_store(lines->lower_value, lane_select(above, m.value, lane_select(below, u.value, least)));
    lane_store(lines->lower_slope, lane_select(above, m.slope, lane_select(below, chord, zero)));
    lane_store(lines->lower_at, lane_select(above, mid, lo));
    lane_store(lines->top, lane_max(lane_abs(most), lane_abs(least)));
    lane_store(lines->steep, lane_max(lane_abs(slope_lo), lane_abs(slope_hi)));
    lane_store(lines->slope_lo, slope_lo);
    lane_store(lines->slope_hi, slope_hi);
}

#endif
