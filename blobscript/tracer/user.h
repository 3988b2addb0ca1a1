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

#include <float.h>

#include "kernel.h"
#include "lane.h"

typedef struct user_jet {
    lane_real value, slope;
} user_jet;

/* Where s lies: the run of its piece, and the sums over all joints before. */
typedef struct user_place {
    lane_real run, kinks, defects;
} user_place;

/* Lines above and below phi on an interval as in kernel_lines, and the range of phi'. */
typedef struct user_line {
    lane_real upper_value, upper_slope, upper_at, lower_value, lower_slope, lower_at;
    lane_real top, steep, slope_lo, slope_hi;
} user_line;

/* The same in memory. */
typedef struct user_lines {
    LANE_ALIGN double upper_value[LANES], upper_slope[LANES], upper_at[LANES];
    LANE_ALIGN double lower_value[LANES], lower_slope[LANES], lower_at[LANES];
    LANE_ALIGN double top[LANES], steep[LANES], slope_lo[LANES], slope_hi[LANES];
} user_lines;

/* Places are evaluated together, so that one has work while another waits for a result; one by one, where only some
 * of them lie in a piece of a degree above USER_LOW (below it, asking which would cost more). */
enum { USER_MOST = 3, USER_LOW = 5 };
#define USER_EACH(k, n) _Pragma("GCC unroll 3") for (int k = 0; k < (n); k++)

/* A place, its root and 1 / (2 root). */
typedef struct user_root {
    lane_real s, r, inverse;
} user_root;

LANE_INLINE user_root user_root_of(lane_real s, int wanted) {
    if (!wanted) return (user_root){s, s, s};
#if defined(__AVX512DQ__) /* Newton's method instead of waiting for a root and a quotient */
    const lane_real some = lane_max(s, lane_all(1e-300)), half = 0.5 * some;
    lane_real y = (lane_real)_mm512_rsqrt14_pd((__m512d)some);
    for (int i = 0; i < 2; i++) y = lane_fma(lane_fma(-half * y, y, lane_all(0.5)), y, y);
    const lane_real g = some * y, inverse = 0.5 * y;
    return (user_root){s, lane_fma(lane_fma(-g, g, some), inverse, g), inverse};
#else
    const lane_real r = lane_sqrt(s);
    return (user_root){s, r, 0.5 / lane_max(r, lane_all(1e-300))};
#endif
}

/* kernel_piece_jet for n times LANES numbers. */
LANE_INLINE void user_piece_jets(int n, const blob_piece *piece, const user_root *at, user_jet *jets) {
    const double inverse = 1.0 / piece->half, centre = piece->centre;
    lane_real x[USER_MOST], v[USER_MOST], d[USER_MOST];
    USER_EACH(k, n) {
        x[k] = ((piece->in_s ? at[k].s : at[k].r) - centre) * inverse;
        v[k] = lane_all(piece->coefficients[piece->degree]);
        d[k] = lane_all(0.0);
    }
    for (int32_t i = piece->degree - 1; i >= 0; i--) {
        const lane_real c = lane_all(piece->coefficients[i]);
        USER_EACH(k, n) {
            d[k] = lane_fma(d[k], x[k], v[k]);
            v[k] = lane_fma(v[k], x[k], c);
        }
    }
    USER_EACH(k, n) d[k] *= inverse;
    if (!piece->in_s) { /* kernel_slope_in_s */
        const int crease = centre != 0.0 || (piece->degree >= 1 && piece->coefficients[1] != 0.0);
        const double at_0 = !crease && piece->degree >= 2 ? piece->coefficients[2] * inverse * inverse : 0.0;
        USER_EACH(k, n) {
            const lane_real capped = lane_min(at[k].inverse, lane_all(0.5e8));
            const lane_bits away = lane_less(lane_all(0.0), at[k].s);
            if (crease) d[k] = d[k] * capped;
            else d[k] = lane_pick(away, d[k] * at[k].inverse, lane_all(at_0));
        }
    }
    USER_EACH(k, n) jets[k] = (user_jet){v[k], d[k]};
}

/* The smallest and the largest of the lanes; NaN counts for nothing. */
LANE_INLINE double user_least(lane_real s) {
#if defined(__AVX512DQ__)
    return _mm512_reduce_min_pd((__m512d)lane_min(s, lane_all(BLOB_INFINITY)));
#else
    double least = BLOB_INFINITY;
    for (int l = 0; l < LANES; l++) least = s[l] < least ? s[l] : least;
    return least;
#endif
}

/* Number of the first piece, of those from `first` on, that ends at s or behind. */
static int32_t user_piece_of(const blob_piece *pieces, int32_t first, int32_t count, double s) {
    int32_t lo = first, hi = count - 1;
    while (lo < hi) {
        const int32_t middle = (lo + hi) / 2;
        if (s <= pieces[middle].s_hi) hi = middle;
        else lo = middle + 1;
    }
    return lo;
}

/* Number of the piece that the smallest s lies in, or, of a few, the first one: looking for it costs more. */
LANE_INLINE int32_t user_first(const blob_piece *pieces, int32_t count, lane_real s) {
    return count <= 4 ? 0 : user_piece_of(pieces, 0, count, user_least(s));
}

/* Value and slope at n times LANES numbers, none below s[0]; `places` may be NULL. */
LANE_INLINE void user_found(int n, const blob_scene *scene, const blob_kernel *kernel, const lane_real *s,
                            user_jet *jets, user_place *places) {
    const blob_piece *pieces = &scene->pieces[kernel->first_piece], *end = &pieces[kernel->piece_count - 1];
    const lane_real zero = lane_all(0.0);
    lane_bits left[USER_MOST], any = lane_less(zero, zero);
    USER_EACH(k, n) {
        jets[k] = (user_jet){zero, zero};
        if (places)
            places[k] = (user_place){lane_all(end->joined ? (double)end->run : 0.0), lane_all(end->kinks),
                                     lane_all(end->defects)};
        left[k] = lane_less(s[k], lane_all(1.0));
        any = lane_either(any, left[k]);
    }
    if (!lane_some(any)) return;
    user_root at[USER_MOST];
    USER_EACH(k, n) at[k] = user_root_of(s[k], kernel->piece_count > 1 || !pieces->in_s);
    const blob_piece *piece = pieces + user_first(pieces, kernel->piece_count, s[0]);
    for (;;) {
        lane_bits here[USER_MOST];
        int wanted = 0;
        any = lane_less(zero, zero);
        USER_EACH(k, n) {
            here[k] = piece == end ? left[k] : lane_both(left[k], lane_at_most(s[k], lane_all(piece->s_hi)));
            left[k] = lane_without(left[k], here[k]);
            wanted += lane_some(here[k]);
            any = lane_either(any, left[k]);
        }
        if (wanted) {
            user_jet found[USER_MOST];
            USER_EACH(k, n) found[k] = jets[k];
            if (wanted == n || piece->degree <= USER_LOW) user_piece_jets(n, piece, at, found);
            else USER_EACH(k, n) if (lane_some(here[k])) user_piece_jets(1, piece, &at[k], &found[k]);
            const lane_real run = lane_all((double)piece->run);
            const lane_real kinks = lane_all(piece == pieces ? 0.0 : piece[-1].kinks);
            const lane_real defects = lane_all(piece == pieces ? 0.0 : piece[-1].defects);
            USER_EACH(k, n) {
                jets[k].value = lane_pick(here[k], found[k].value, jets[k].value);
                jets[k].slope = lane_pick(here[k], found[k].slope, jets[k].slope);
                if (!places) continue;
                places[k].run = lane_pick(here[k], run, places[k].run);
                places[k].kinks = lane_pick(here[k], kinks, places[k].kinks);
                places[k].defects = lane_pick(here[k], defects, places[k].defects);
            }
        }
        if (!lane_some(any)) return;
        piece++;
        if (wanted) continue;
        lane_real rest = lane_all(BLOB_INFINITY); /* nothing was here: there may be many such pieces */
        USER_EACH(k, n) rest = lane_pick(left[k], lane_min(rest, s[k]), rest);
        piece = pieces + user_piece_of(pieces, (int32_t)(piece - pieces), kernel->piece_count, user_least(rest));
    }
}

static user_jet user_at(const blob_scene *scene, const blob_kernel *kernel, lane_real s) {
    user_jet jet;
    user_found(1, scene, kernel, &s, &jet, NULL);
    return jet;
}

/* On lo < s <= hi, ranges of phi and phi', and by how much phi jumps in all at joints of runs. */
typedef struct user_hull {
    lane_real most, least, slope_lo, slope_hi, jumps;
} user_hull;

/* Widened by the joints of runs between lo and hi. */
static void user_cross(const blob_scene *scene, const blob_kernel *kernel, lane_real lo, lane_real hi,
                       user_hull *hull) {
    const blob_piece *pieces = &scene->pieces[kernel->first_piece];
    for (int32_t i = user_first(pieces, kernel->piece_count, lo); i < kernel->piece_count; i++) {
        const blob_piece *piece = &pieces[i];
        const lane_real at = lane_all(piece->s_hi);
        const lane_bits behind = lane_less(at, hi);
        if (!lane_some(behind)) break;
        if (piece->joined) continue;
        /* its right end, with the slopes on both sides; the last one ends at the reach */
        const lane_bits between = lane_both(lane_at_most(lo, at), behind);
        const lane_real most = lane_max(hull->most, lane_all(piece->end_value_hi));
        const lane_real least = lane_min(hull->least, lane_all(piece->end_value_lo));
        const lane_real slope_hi = lane_max(hull->slope_hi, lane_all(piece->end_slope_hi));
        const lane_real slope_lo = lane_min(hull->slope_lo, lane_all(piece->end_slope_lo));
        const lane_real jumps = hull->jumps + (piece->end_value_hi - piece->end_value_lo);
        hull->most = lane_pick(between, most, hull->most);
        hull->least = lane_pick(between, least, hull->least);
        hull->slope_hi = lane_pick(between, slope_hi, hull->slope_hi);
        hull->slope_lo = lane_pick(between, slope_lo, hull->slope_lo);
        hull->jumps = lane_pick(between, jumps, hull->jumps);
    }
}

/* On the interval that lo, its least, and its ends a and b span; `jets` are those at lo, a and b. */
LANE_INLINE user_hull user_hull_of(const blob_scene *scene, const blob_kernel *kernel, lane_real lo, lane_real a,
                                   lane_real b, user_jet *jets) {
    const lane_real at[3] = {lo, a, b};
    user_place places[3];
    user_found(3, scene, kernel, at, jets, places);
    const lane_bits last = lane_less(a, b);
    const lane_real hi = lane_pick(last, b, a), value = lane_pick(last, jets[2].value, jets[1].value);
    const lane_real slope = lane_pick(last, jets[2].slope, jets[1].slope);
    const lane_real run = lane_pick(last, places[2].run, places[1].run);
    const lane_real kinks = lane_pick(last, places[2].kinks, places[1].kinks) - places[0].kinks;
    const lane_real defects = lane_pick(last, places[2].defects, places[1].defects) - places[0].defects;
    user_hull hull = {lane_max(jets[0].value, value) + defects, lane_min(jets[0].value, value) - defects,
                      lane_min(jets[0].slope, slope) - kinks, lane_max(jets[0].slope, slope) + kinks, 2.0 * defects};
    const lane_bits across = lane_either(lane_less(run, places[0].run), lane_less(places[0].run, run));
    if (lane_some(across)) user_cross(scene, kernel, lo, hi, &hull);
    return hull;
}

/* Lines above and below phi on [lo, hi], lo <= mid <= hi. Across runs the slopes alone tell: where they lie in
 * [m, M] and the chord's is c, phi is no further from its chord than (hi - lo) (M - c) (c - m) / (M - m), since it
 * is within both (M - c) (s - lo) and (c - m) (hi - s), and likewise below. (At s < 1e-16 slopes are capped, see
 * kernel_slope_in_s.) On short intervals that is of second order, on long ones constants may be closer. */
LANE_INLINE user_line user_line_of(const blob_scene *scene, const blob_kernel *kernel, lane_real lo, lane_real hi,
                                   lane_real mid) {
    const lane_real zero = lane_all(0.0), unit = lane_all(1.0), at[3] = {lo, hi, mid};
    user_jet jets[3];
    user_place places[3];
    user_found(3, scene, kernel, at, jets, places);
    const user_jet u = jets[0], v = jets[1], m = jets[2];
    const user_place at_u = places[0], at_v = places[1], at_m = places[2];
    const lane_bits one = lane_both(lane_at_most(at_u.run, at_v.run), lane_at_most(at_v.run, at_u.run));
    const lane_bits concave = lane_less(at_u.run, zero);
    const lane_real kinks = at_v.kinks - at_u.kinks, defects = at_v.defects - at_u.defects;
    user_hull hull = {lane_max(u.value, v.value) + defects, lane_min(u.value, v.value) - defects,
                      lane_min(u.slope, v.slope) - kinks, lane_max(u.slope, v.slope) + kinks, 2.0 * defects};
    const lane_real gap = hi - lo, beyond = lane_max(hi - 1.0, zero);
    const lane_bits wide = lane_less(zero, gap);
    const lane_real chord = lane_pick(wide, (v.value - u.value) / lane_pick(wide, gap, unit), u.slope);
    const lane_real off_chord = 2.0 * (defects + kinks * beyond);
    const lane_real off_tangent = defects + (at_v.kinks - at_m.kinks) * beyond + (at_m.kinks - at_u.kinks) * (mid - lo);
    /* the chord starts at lo, the tangent touches at mid */
    const lane_real chord_value = lane_pick(concave, u.value - off_chord, u.value + off_chord);
    const lane_real tangent_value = lane_pick(concave, m.value + off_tangent, m.value - off_tangent);
    user_line line;
    line.upper_value = lane_pick(concave, tangent_value, chord_value);
    line.upper_slope = lane_pick(concave, m.slope, chord);
    line.upper_at = lane_pick(concave, mid, lo);
    line.lower_value = lane_pick(concave, chord_value, tangent_value);
    line.lower_slope = lane_pick(concave, chord, m.slope);
    line.lower_at = lane_pick(concave, lo, mid);
    const lane_bits across = lane_without(lane_at_most(zero, gap), one);
    if (lane_some(across)) {
        user_cross(scene, kernel, lo, hi, &hull);
        const lane_real up = lane_max(hull.slope_hi - chord, zero), down = lane_max(chord - hull.slope_lo, zero);
        const lane_real rounding = 4.0 * DBL_EPSILON * (lane_abs(u.value) + lane_abs(v.value));
        const lane_real off = gap * up * (down / lane_max(up + down, lane_all(DBL_MIN))) + 2.0 * hull.jumps + rounding;
        const lane_bits near =
            lane_both(lane_less(2.0 * off, hull.most - hull.least), lane_at_most(lane_all(1e-16), lo));
        const lane_real slope = lane_pick(near, chord, zero);
        line.upper_value = lane_pick(across, lane_pick(near, u.value + off, hull.most), line.upper_value);
        line.lower_value = lane_pick(across, lane_pick(near, u.value - off, hull.least), line.lower_value);
        line.upper_slope = lane_pick(across, slope, line.upper_slope);
        line.lower_slope = lane_pick(across, slope, line.lower_slope);
        line.upper_at = lane_pick(across, lo, line.upper_at);
        line.lower_at = lane_pick(across, lo, line.lower_at);
    }
    line.top = lane_max(lane_abs(hull.most), lane_abs(hull.least));
    line.steep = lane_max(lane_abs(hull.slope_lo), lane_abs(hull.slope_hi));
    line.slope_lo = hull.slope_lo;
    line.slope_hi = hull.slope_hi;
    return line;
}

/* The same, from and to memory. */
static void user_bounds(const blob_scene *scene, const blob_kernel *kernel, const double *at_lo, const double *at_hi,
                        const double *at_mid, user_lines *lines) {
    const user_line line = user_line_of(scene, kernel, lane_load(at_lo), lane_load(at_hi), lane_load(at_mid));
    lane_store(lines->upper_value, line.upper_value);
    lane_store(lines->upper_slope, line.upper_slope);
    lane_store(lines->upper_at, line.upper_at);
    lane_store(lines->lower_value, line.lower_value);
    lane_store(lines->lower_slope, line.lower_slope);
    lane_store(lines->lower_at, line.lower_at);
    lane_store(lines->top, line.top);
    lane_store(lines->steep, line.steep);
    lane_store(lines->slope_lo, line.slope_lo);
    lane_store(lines->slope_hi, line.slope_hi);
}

#endif
