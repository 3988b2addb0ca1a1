/* user.h - user kernels for LANES numbers at a time: the piecewise polynomials of kernel.h, every piece
 * between the smallest and the largest s evaluated for all lanes and picked by s.
 *
 * A run is a row of pieces that is convex, or concave, but for what rounding did at its joints (pack.py). On
 * one run chord and tangent bound phi as they do for the built-in kernels (swapped where it is concave); across
 * runs the values at the ends and at the joints of runs between do, since pieces are monotone. Where phi is
 * convex but for slopes that drop by k_j, and values that jump by d_j, at joints s_j, there is a convex psi with
 *     psi = phi and psi' = phi' at mid,    |phi - psi| <= sum d_j + sum k_j |s - s_j|  (joints between mid and s)
 * so the tangent at mid bounds phi but for sum d_j + sum k_j (mid - lo) over joints before mid and
 * sum d_j + sum k_j (hi - s_j) over those behind; and the chord of phi but for twice the sum, of all joints, of
 * d_j + k_j (hi - s_j). The sums over all joints before a piece are kept with it: `kinks` of k_j, `defects` of
 * d_j + k_j (1 - s_j), and differences of them give those between two places. */
#ifndef BLOB_USER_H
#define BLOB_USER_H

#include "kernel.h"
#include "lane.h"

typedef struct user_jet {
    lane_real value, slope;
} user_jet;

/* Where s lies: the run of its piece, and the sums over all joints before. */
typedef struct user_place {
    lane_real run, kinks, defects;
} user_place;

/* Lines as in kernel_lines, and the range of phi'. */
typedef struct user_lines {
    LANE_ALIGN double upper_value[LANES], upper_slope[LANES], upper_at[LANES];
    LANE_ALIGN double lower_value[LANES], lower_slope[LANES], lower_at[LANES];
    LANE_ALIGN double top[LANES], steep[LANES], slope_lo[LANES], slope_hi[LANES];
} user_lines;

/* kernel_piece_jet for LANES numbers. */
LANE_INLINE void user_piece_jet(const blob_piece *piece, lane_real s, lane_real *value, lane_real *slope) {
    const double inverse = 1.0 / piece->half;
    const lane_real r = piece->in_s ? s : lane_sqrt(s), x = (r - piece->centre) * inverse;
    lane_real v = lane_all(piece->coefficients[piece->degree]), d = lane_all(0.0);
    for (int32_t i = piece->degree - 1; i >= 0; i--) {
        d = d * x + v;
        v = v * x + piece->coefficients[i];
    }
    d *= inverse;
    if (!piece->in_s) { /* kernel_slope_in_s */
        const int crease = piece->centre != 0.0 || (piece->degree >= 1 && piece->coefficients[1] != 0.0);
        const lane_real floor = lane_all(crease ? 1e-8 : 1e-300);
        const double at_0 = !crease && piece->degree >= 2 ? piece->coefficients[2] * inverse * inverse : 0.0;
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

/* Number of the piece that the smallest s lies in. */
LANE_INLINE int32_t user_first(const blob_scene *scene, const blob_kernel *kernel, lane_real s) {
    return kernel->piece_count > 1 ? user_piece_of(scene, kernel, user_least(s)) : 0;
}

/* Value and slope; `place` may be NULL. */
LANE_INLINE user_jet user_found(const blob_scene *scene, const blob_kernel *kernel, lane_real s, user_place *place) {
    const blob_piece *pieces = &scene->pieces[kernel->first_piece], *end = &pieces[kernel->piece_count - 1];
    user_jet jet = {lane_all(0.0), lane_all(0.0)};
    if (place) {
        place->run = lane_all(end->joined ? (double)end->run : 0.0);
        place->kinks = lane_all(end->kinks);
        place->defects = lane_all(end->defects);
    }
    lane_mask left = s < 1.0;
    if (!lane_any(left)) return jet;
    for (int32_t i = user_first(scene, kernel, s); i < kernel->piece_count && lane_any(left); i++) {
        const blob_piece *piece = &pieces[i];
        lane_mask here = left;
        if (piece != end) here &= s <= piece->s_hi;
        left &= ~here;
        if (!lane_any(here)) continue;
        lane_real value, slope;
        user_piece_jet(piece, s, &value, &slope);
        jet.value = lane_select(here, value, jet.value);
        jet.slope = lane_select(here, slope, jet.slope);
        if (place) {
            place->run = lane_select(here, lane_all((double)piece->run), place->run);
            place->kinks = lane_select(here, lane_all(i > 0 ? piece[-1].kinks : 0.0), place->kinks);
            place->defects = lane_select(here, lane_all(i > 0 ? piece[-1].defects : 0.0), place->defects);
        }
    }
    return jet;
}

static user_jet user_at(const blob_scene *scene, const blob_kernel *kernel, lane_real s) {
    return user_found(scene, kernel, s, NULL);
}

static user_jet user_at_place(const blob_scene *scene, const blob_kernel *kernel, lane_real s, user_place *place) {
    return user_found(scene, kernel, s, place);
}

/* Ranges of phi and phi' on lo < s <= hi. */
typedef struct user_hull {
    lane_real most, least, slope_lo, slope_hi;
} user_hull;

/* Widened by the joints of runs between lo and hi. */
static void user_cross(const blob_scene *scene, const blob_kernel *kernel, lane_real lo, lane_real hi,
                       user_hull *hull) {
    const double furthest = user_most(hi);
    for (int32_t i = user_first(scene, kernel, lo); i < kernel->piece_count; i++) {
        const blob_piece *piece = &scene->pieces[kernel->first_piece + i];
        if (!(furthest > piece->s_hi)) break;
        if (piece->joined) continue;
        /* its right end, with the slopes on both sides; the last one ends at the reach */
        const lane_mask between = (lo <= piece->s_hi) & (hi > piece->s_hi);
        const lane_real most = lane_max(hull->most, lane_all(piece->end_value_hi));
        const lane_real least = lane_min(hull->least, lane_all(piece->end_value_lo));
        const lane_real slope_hi = lane_max(hull->slope_hi, lane_all(piece->end_slope_hi));
        const lane_real slope_lo = lane_min(hull->slope_lo, lane_all(piece->end_slope_lo));
        hull->most = lane_select(between, most, hull->most);
        hull->least = lane_select(between, least, hull->least);
        hull->slope_hi = lane_select(between, slope_hi, hull->slope_hi);
        hull->slope_lo = lane_select(between, slope_lo, hull->slope_lo);
    }
}

/* Lines above and below phi on [lo, hi], lo <= mid <= hi. */
static void user_bounds(const blob_scene *scene, const blob_kernel *kernel, const double *at_lo, const double *at_hi,
                        const double *at_mid, user_lines *lines) {
    const lane_real lo = lane_load(at_lo), hi = lane_load(at_hi), mid = lane_load(at_mid), zero = lane_all(0.0);
    user_place at_u, at_v, at_m;
    const user_jet u = user_at_place(scene, kernel, lo, &at_u), v = user_at_place(scene, kernel, hi, &at_v);
    const lane_mask one = at_u.run == at_v.run, concave = at_u.run < 0.0;
    at_m = at_u;
    const user_jet m = lane_any(one) ? user_at_place(scene, kernel, mid, &at_m) : u; /* counts on one run only */
    const lane_real kinks = at_v.kinks - at_u.kinks, defects = at_v.defects - at_u.defects;
    user_hull hull = {lane_max(u.value, v.value) + defects, lane_min(u.value, v.value) - defects,
                      lane_min(u.slope, v.slope) - kinks, lane_max(u.slope, v.slope) + kinks};
    if (lane_any(~one)) user_cross(scene, kernel, lo, hi, &hull);

    const lane_real gap = hi - lo, beyond = lane_max(hi - 1.0, zero);
    const lane_mask wide = gap > 0.0;
    const lane_real chord = lane_select(wide, (v.value - u.value) / lane_select(wide, gap, lane_all(1.0)), u.slope);
    const lane_real off_chord = 2.0 * (defects + kinks * beyond);
    const lane_real off_tangent = defects + (at_v.kinks - at_m.kinks) * beyond + (at_m.kinks - at_u.kinks) * (mid - lo);
    /* the chord starts at lo, the tangent touches at mid; across runs both are constants */
    const lane_mask above = one & ~concave, below = one & concave;
    lane_store(lines->upper_value,
               lane_select(above, u.value + off_chord, lane_select(below, m.value + off_tangent, hull.most)));
    lane_store(lines->upper_slope, lane_select(above, chord, lane_select(below, m.slope, zero)));
    lane_store(lines->upper_at, lane_select(below, mid, lo));
    lane_store(lines->lower_value,
               lane_select(above, m.value - off_tangent, lane_select(below, u.value - off_chord, hull.least)));
    lane_store(lines->lower_slope, lane_select(above, m.slope, lane_select(below, chord, zero)));
    lane_store(lines->lower_at, lane_select(above, mid, lo));
    lane_store(lines->top, lane_max(lane_abs(hull.most), lane_abs(hull.least)));
    lane_store(lines->steep, lane_max(lane_abs(hull.slope_lo), lane_abs(hull.slope_hi)));
    lane_store(lines->slope_lo, hull.slope_lo);
    lane_store(lines->slope_hi, hull.slope_hi);
}

#endif
