/* shape.h - skeletons that are not plain points, along the rays of a packet.
 *
 * A matrix maps packed coordinates to the space of the skeleton, where distances are measured; along the
 * mapped ray o' + t d' squared distances grow by |d'|^2 t^2. A line a b has three pieces: with u = b - a,
 * the projection of the ray on u passes 0 and 1 at the joints; beyond them the end point counts, between
 * them the distance to the infinite line, the parts of o' - a and d' at right angles to u.
 */
#ifndef BLOB_SHAPE_H
#define BLOB_SHAPE_H

#include "leaf.h"

typedef struct shape_vector {
    double x, y, z;
} shape_vector;

KERNEL_INLINE shape_vector shape_sub(shape_vector a, shape_vector b) {
    return (shape_vector){a.x - b.x, a.y - b.y, a.z - b.z};
}
KERNEL_INLINE shape_vector shape_along(shape_vector a, double t, shape_vector b) {
    return (shape_vector){a.x + t * b.x, a.y + t * b.y, a.z + t * b.z};
}
KERNEL_INLINE double shape_dot(shape_vector a, shape_vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static const double SHAPE_IDENTITY[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

KERNEL_INLINE const double *shape_matrix(const blob_scene *scene, const blob_shape *shape) {
    return shape->matrix >= 0 ? scene->matrices + 12 * (size_t)shape->matrix : SHAPE_IDENTITY;
}

KERNEL_INLINE shape_vector shape_map_direction(const double *m, shape_vector v) {
    return (shape_vector){m[0] * v.x + m[1] * v.y + m[2] * v.z, m[4] * v.x + m[5] * v.y + m[6] * v.z,
                          m[8] * v.x + m[9] * v.y + m[10] * v.z};
}
KERNEL_INLINE shape_vector shape_map_point(const double *m, shape_vector v) {
    const shape_vector r = shape_map_direction(m, v);
    return (shape_vector){r.x + m[3], r.y + m[7], r.z + m[11]};
}

/* How far a step of one packed unit can go in the space of the skeleton: the Frobenius norm. */
static double shape_stretch(const double *m) {
    double sum = 0.0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) sum += m[i] * m[i];
    return sqrt(sum);
}

/* Vectors of LANES rays. */
typedef struct shape_lanes {
    lane_real x, y, z;
} shape_lanes;

KERNEL_INLINE lane_real shape_dots(shape_lanes a, shape_lanes b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
KERNEL_INLINE shape_lanes shape_away(shape_lanes a, shape_vector b) {
    return (shape_lanes){a.x - b.x, a.y - b.y, a.z - b.z};
}
KERNEL_INLINE shape_lanes shape_past(shape_lanes a, lane_real t, shape_lanes b) {
    return (shape_lanes){a.x + t * b.x, a.y + t * b.y, a.z + t * b.z};
}
KERNEL_INLINE shape_lanes shape_map_lanes(const double *m, const double (*v)[LANES], double shift) {
    const lane_real x = lane_load(v[0]), y = lane_load(v[1]), z = lane_load(v[2]);
    return (shape_lanes){m[0] * x + m[1] * y + m[2] * z + shift * m[3], m[4] * x + m[5] * y + m[6] * z + shift * m[7],
                         m[8] * x + m[9] * y + m[10] * z + shift * m[11]};
}

/* |x + t d|^2 in closest-approach form: r2 + k (t - tau)^2, for LANES rays. */
typedef struct shape_piece {
    lane_real tau, r2, k;
} shape_piece;

KERNEL_INLINE shape_piece shape_quadratic(shape_lanes x, shape_lanes d, double scale) {
    const lane_real dd = shape_dots(d, d), zero = lane_all(0.0);
    const lane_mask moves = dd > 1e-300;
    const lane_real at = lane_select(moves, -shape_dots(x, d) / lane_select(moves, dd, lane_all(1.0)), zero);
    const shape_lanes p = shape_past(x, at, d);
    return (shape_piece){at, scale * shape_dots(p, p), lane_select(moves, scale * dd, zero)};
}

KERNEL_INLINE void shape_put(leaf_pieces *restrict p, int i, lane_mask other, shape_piece yes, shape_piece no) {
    lane_store(p->tau[i], lane_select(other, yes.tau, no.tau));
    lane_store(p->r2[i], lane_select(other, yes.r2, no.r2));
    lane_store(p->k[i], lane_select(other, yes.k, no.k));
}

static void shape_line_pieces(shape_vector a, shape_vector b, const double *m, double scale,
                              const packet_rays *restrict rays, leaf_pieces *restrict p) {
    const shape_vector u = shape_sub(b, a);
    const double uu = shape_dot(u, u), inverse = uu > 0.0 ? 1.0 / uu : 0.0;
    const lane_real far = lane_all(BLOB_INFINITY);
    const shape_lanes o = shape_map_lanes(m, rays->o, 1.0), d = shape_map_lanes(m, rays->d, 0.0);
    const shape_lanes xa = shape_away(o, a), along = {lane_all(u.x), lane_all(u.y), lane_all(u.z)};
    const lane_real du = shape_dots(d, along), xu = shape_dots(xa, along);
    const shape_piece end_a = shape_quadratic(xa, d, scale), end_b = shape_quadratic(shape_away(o, b), d, scale);
    const shape_piece side =
        shape_quadratic(shape_past(xa, -xu * inverse, along), shape_past(d, -du * inverse, along), scale);
    /* t where the projection passes 0 and 1; du == 0: always on one side, told by xu / uu */
    const lane_mask falling = du < 0.0, moves = (du > 0.0) | falling;
    const lane_real safe = lane_select(moves, du, lane_all(1.0));
    const lane_real at0 = lane_select(moves, -xu / safe, lane_select(xu < 0.0, far, -far));
    lane_real at1 = lane_select(moves, (uu - xu) / safe, lane_select(xu > uu, -far, far));
    if (!(uu > 0.0)) at1 = at0; /* zero length: both ends are the point, nothing between */
    shape_put(p, 0, falling, end_b, end_a);
    shape_put(p, 1, falling, side, side);
    shape_put(p, 2, falling, end_a, end_b);
    lane_store(p->first, lane_select(falling, at1, at0));
    lane_store(p->second, lane_select(falling, at0, at1));
    lane_store(p->bend, end_a.k);
}

static void shape_point_pieces(shape_vector a, const double *m, double scale, const packet_rays *restrict rays,
                               leaf_pieces *restrict p) {
    const shape_lanes o = shape_map_lanes(m, rays->o, 1.0), d = shape_map_lanes(m, rays->d, 0.0);
    const shape_piece only = shape_quadratic(shape_away(o, a), d, scale);
    for (int i = 0; i < 3; i++) shape_put(p, i, only.k > 0.0, only, only);
    lane_store(p->first, lane_all(-BLOB_INFINITY));
    lane_store(p->second, lane_all(BLOB_INFINITY));
    lane_store(p->bend, only.k);
}

/* Where r2 + k (t - tau)^2 < limit on [lo, hi] (grows [*enter, *exit]), and where it is least there. */
KERNEL_INLINE void shape_grow(const leaf_pieces *restrict p, int i, double limit, lane_real lo, lane_real hi,
                              lane_real *enter, lane_real *exit, lane_real *nearest_t, lane_real *nearest_s) {
    const lane_real tau = lane_load(p->tau[i]), r2 = lane_load(p->r2[i]), k = lane_load(p->k[i]);
    const lane_real inside = limit - r2, zero = lane_all(0.0);
    const lane_mask bends = k > 0.0;
    const lane_real half = lane_select(bends, lane_sqrt(lane_max(inside, zero) / lane_select(bends, k, lane_all(1.0))),
                                       lane_all(BLOB_INFINITY));
    const lane_real from = lane_max(tau - half, lo), to = lane_min(tau + half, hi);
    const lane_mask meets = (inside > 0.0) & (from <= to);
    *enter = lane_select(meets, lane_min(*enter, from), *enter);
    *exit = lane_select(meets, lane_max(*exit, to), *exit);
    const lane_real at = lane_min(lane_max(tau, lo), hi), value = r2 + k * (at - tau) * (at - tau);
    const lane_mask nearer = (lo <= hi) & (value < *nearest_s);
    *nearest_t = lane_select(nearer, at, *nearest_t);
    *nearest_s = lane_select(nearer, value, *nearest_s);
}

/* Fill a leaf for element e; 1 if a ray meets it between t and end. */
static int shape_meets(const blob_scene *scene, int32_t e, const packet_rays *restrict rays, const double *restrict t,
                       const double *restrict end, leaf *restrict f, leaf_pieces *restrict p) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    const double *m = shape_matrix(scene, shape);
    const shape_vector a = {scene->x[e], scene->y[e], scene->z[e]};
    const shape_vector b = {shape->b[0], shape->b[1], shape->b[2]};
    const double scale = scene->inverse_reach2[e];
    if (shape->kind == SHAPE_LINE) shape_line_pieces(a, b, m, scale, rays, p);
    else shape_point_pieces(a, m, scale, rays, p);
    const double limit = scene->support[e] * scene->support[e] * scale;
    const lane_real far = lane_all(BLOB_INFINITY), first = lane_load(p->first), second = lane_load(p->second);
    lane_real enter = far, leave = -far, nearest_t = lane_all(0.0), nearest_s = far;
    shape_grow(p, 0, limit, -far, first, &enter, &leave, &nearest_t, &nearest_s);
    shape_grow(p, 1, limit, first, second, &enter, &leave, &nearest_t, &nearest_s);
    shape_grow(p, 2, limit, second, far, &enter, &leave, &nearest_t, &nearest_s);
    const lane_real slack = 1e-14 * lane_load(rays->magnitude) + 1e-12 * lane_max(leave - enter, lane_all(0.0));
    enter -= slack;
    leave += slack;
    lane_store(f->enter, enter);
    lane_store(f->exit, leave);
    lane_store(p->nearest_t, nearest_t);
    lane_store(p->nearest_s, nearest_s);
    lane_store(f->tau, nearest_t);
    lane_store(f->r2, nearest_s);
    f->k = scale;
    f->rounding = 0.5 * sqrt(scale) * shape_stretch(m);
    return lane_any((enter < lane_load(end)) & (leave > lane_load(t)));
}

/* grad s / 2 = M^T (P' - nearest) / R^2 at o + t d. */
static void shape_toward(const blob_scene *scene, int32_t e, const packet_rays *restrict rays, const double *restrict t,
                         double (*restrict toward)[LANES]) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    const double *m = shape_matrix(scene, shape);
    const shape_vector a = {scene->x[e], scene->y[e], scene->z[e]};
    const shape_vector b = {shape->b[0], shape->b[1], shape->b[2]};
    const shape_vector u = shape->kind == SHAPE_LINE ? shape_sub(b, a) : (shape_vector){0.0, 0.0, 0.0};
    const double uu = shape_dot(u, u), scale = scene->inverse_reach2[e];
    LANE_LOOP(l) {
        const shape_vector at = {rays->o[0][l] + t[l] * rays->d[0][l], rays->o[1][l] + t[l] * rays->d[1][l],
                                 rays->o[2][l] + t[l] * rays->d[2][l]};
        const shape_vector x = shape_sub(shape_map_point(m, at), a);
        const double h = uu > 0.0 ? kernel_min(kernel_max(shape_dot(x, u) / (uu > 0.0 ? uu : 1.0), 0.0), 1.0) : 0.0;
        const shape_vector v = shape_along(x, -h, u);
        toward[0][l] = scale * (m[0] * v.x + m[4] * v.y + m[8] * v.z);
        toward[1][l] = scale * (m[1] * v.x + m[5] * v.y + m[9] * v.z);
        toward[2][l] = scale * (m[2] * v.x + m[6] * v.y + m[10] * v.z);
    }
}

#endif
