/* bernstein.h - bounds of degree 6: coefficients are summed before anything is bounded.
 *
 * A sum of quadratics of the sandwich cannot see that two large densities cancel. Kernels that are polynomials
 * in s of degree 3 at most are polynomials in t of degree 6 as long as s is one quadratic: on an interval
 * that no event (enter, exit, joint of two pieces) divides, their Bernstein coefficients are exact. With the blossom
 * s0 = s(a), s1 = r2 + k (a - tau)(b - tau), s2 = s(b) and p = 1 - s in Bernstein form,
 *
 *     soft2: p^2 * 1    soft3: p^2 * p    wyvill: p^2 * (5 + 4 p) / 9
 *
 * are products of coefficients that are not negative within the reach: nothing cancels on the way, and no power
 * of t is ever formed (numerics.md, section 2, i). Everything else takes part with the quadratics of the sandwich,
 * raised to degree 6; so upper and lower coefficients are kept apart.
 */
#ifndef BLOB_BERNSTEIN_H
#define BLOB_BERNSTEIN_H

#include "leaf.h"
#include "set.h"
#include "tree.h"

enum { BERNSTEIN_DEGREE = 6, BERNSTEIN_COUNT = BERNSTEIN_DEGREE + 1 };

/* Coefficients above and below the field on [a, b], and what E is made of. */
typedef struct bernstein_bounds {
    LANE_ALIGN double upper[BERNSTEIN_COUNT][LANES], lower[BERNSTEIN_COUNT][LANES], magnitude[LANES];
} bernstein_bounds;

KERNEL_INLINE int bernstein_has(int32_t id) { return id == KERNEL_SOFT2 || id == KERNEL_SOFT3 || id == KERNEL_WYVILL; }

/* c += w q r for q of degree 4 and r of degree 2: c_k C(6, k) = sum over i + j = k of C(4, i) q_i C(2, j) r_j. */
KERNEL_INLINE void bernstein_product(double w, const double *q, const double *r, double (*restrict c)[LANES], int l) {
    c[0][l] += w * (q[0] * r[0]);
    c[1][l] += w * ((4.0 * q[1] * r[0] + 2.0 * q[0] * r[1]) / 6.0);
    c[2][l] += w * ((6.0 * q[2] * r[0] + 8.0 * q[1] * r[1] + q[0] * r[2]) / 15.0);
    c[3][l] += w * ((4.0 * q[3] * r[0] + 12.0 * q[2] * r[1] + 4.0 * q[1] * r[2]) / 20.0);
    c[4][l] += w * ((q[4] * r[0] + 8.0 * q[3] * r[1] + 6.0 * q[2] * r[2]) / 15.0);
    c[5][l] += w * ((2.0 * q[4] * r[1] + 4.0 * q[3] * r[2]) / 6.0);
    c[6][l] += w * (q[4] * r[2]);
}

/* Are the coefficients exact for every lane that meets the leaf in [a, b]? */
static int bernstein_exact(const leaf *restrict e, const leaf_pieces *restrict p, const double *restrict a,
                           const double *restrict b) {
    if (e->set != SET_NONE || !bernstein_has(e->id)) return 0;
    const lane_real from = lane_load(a), to = lane_load(b), enter = lane_load(e->enter), leave = lane_load(e->exit);
    const lane_mask meets = (enter < to) & (leave > from);
    lane_mask within = (enter <= from) & (leave >= to);
    if (p) {
        const lane_real first = lane_load(p->first), second = lane_load(p->second);
        within &= (to <= first) | (from >= second) | ((from >= first) & (to <= second));
    }
    return !lane_any(meets & ~within);
}

/* Add one element of a polynomial kernel; bernstein_exact. */
KERNEL_INLINE void bernstein_add(int id, const packet_rays *restrict rays, const leaf *restrict e,
                                 const leaf_pieces *restrict p, const double *restrict a, const double *restrict b,
                                 bernstein_bounds *restrict sum) {
    const double w = e->weight, size = fabs(w);
    LANE_ALIGN double c[BERNSTEIN_COUNT][LANES] = {{0.0}}, magnitude[LANES];
    LANE_SIMD(l) {
        const leaf_range s = leaf_range_of(e, p, l, a[l], b[l]);
        const double p0 = 1.0 - s.sa, p1 = 1.0 - s.middle_lo, p2 = 1.0 - s.sb;
        const double q[5] = {p0 * p0, p0 * p1, (p0 * p2 + 2.0 * p1 * p1) / 3.0, p1 * p2, p2 * p2};
        const double u = id == KERNEL_SOFT2 ? 1.0 : id == KERNEL_SOFT3 ? 0.0 : 5.0 / 9.0;
        const double v = id == KERNEL_SOFT2 ? 0.0 : id == KERNEL_SOFT3 ? 1.0 : 4.0 / 9.0;
        const double r[3] = {u + v * p0, u + v * p1, u + v * p2};
        bernstein_product(w, q, r, c, l);
        const kernel_jet top = kernel_value(id, NULL, NULL, s.lo);
        magnitude[l] = size * (top.value - top.slope * (kernel_min(s.hi, 1.0) + e->rounding * rays->magnitude[l]));
    }
    /* lanes that do not meet it: 0 is exact, too */
    const lane_mask meets = (lane_load(e->enter) < lane_load(b)) & (lane_load(e->exit) > lane_load(a));
    const lane_real zero = lane_all(0.0);
    for (int i = 0; i < BERNSTEIN_COUNT; i++) {
        const lane_real part = lane_select(meets, lane_load(c[i]), zero);
        lane_store(sum->upper[i], lane_load(sum->upper[i]) + part);
        lane_store(sum->lower[i], lane_load(sum->lower[i]) + part);
    }
    lane_store(sum->magnitude, lane_load(sum->magnitude) + lane_select(meets, lane_load(magnitude), zero));
}

/* Add quadratics, raised to degree 6. */
static void bernstein_raise(const leaf_bounds *restrict f, bernstein_bounds *restrict sum) {
    static const double ones[5] = {1.0, 1.0, 1.0, 1.0, 1.0};
    LANE_SIMD(l) {
        const double up[3] = {f->upper[0][l], f->upper[1][l], f->upper[2][l]};
        const double down[3] = {f->lower[0][l], f->lower[1][l], f->lower[2][l]};
        bernstein_product(1.0, ones, up, sum->upper, l);
        bernstein_product(1.0, ones, down, sum->lower, l);
        sum->magnitude[l] += f->magnitude[l];
    }
}

KERNEL_INLINE double bernstein_middle(const double (*restrict c)[LANES], int l) {
    return ((c[0][l] + c[6][l]) + 6.0 * (c[1][l] + c[5][l]) + 15.0 * (c[2][l] + c[4][l]) + 20.0 * c[3][l]) / 64.0;
}

/* As tree_join_bounds. */
static void bernstein_join(int32_t op, bernstein_bounds *restrict into, const bernstein_bounds *restrict child) {
    if (op == OP_SUM) {
        LANE_SIMD(l) {
            for (int i = 0; i < BERNSTEIN_COUNT; i++)
                into->upper[i][l] += child->upper[i][l], into->lower[i][l] += child->lower[i][l];
            into->magnitude[l] += child->magnitude[l];
        }
        return;
    }
    double(*restrict hull)[LANES] = op == OP_MAX ? into->upper : into->lower;
    double(*restrict pick)[LANES] = op == OP_MAX ? into->lower : into->upper;
    const double(*restrict child_hull)[LANES] = op == OP_MAX ? child->upper : child->lower;
    const double(*restrict child_pick)[LANES] = op == OP_MAX ? child->lower : child->upper;
    const double sense = op == OP_MAX ? 1.0 : -1.0;
    LANE_SIMD(l) {
        const int take =
            sense * bernstein_middle(child_pick, l) > sense * bernstein_middle((const double(*)[LANES])pick, l);
        for (int i = 0; i < BERNSTEIN_COUNT; i++) {
            const double mine = hull[i][l], theirs = child_hull[i][l];
            hull[i][l] = sense * theirs > sense * mine ? theirs : mine;
            pick[i][l] = take ? child_pick[i][l] : pick[i][l];
        }
        into->magnitude[l] = kernel_max(into->magnitude[l], child->magnitude[l]);
    }
}

#endif
