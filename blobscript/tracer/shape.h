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

/* |x + t d|^2 in closest-approach form. */
KERNEL_INLINE void shape_quadratic(shape_vector x, shape_vector d, double scale, double *tau, double *r2, double *k) {
    const double dd = shape_dot(d, d);
    const double at = dd > 1e-300 ? -shape_dot(x, d) / dd : 0.0;
    const shape_vector p = shape_along(x, at, d);
    *tau = at;
    *r2 = scale * shape_dot(p, p);
    *k = dd > 1e-300 ? scale * dd : 0.0;
}

/* Where r2 + k (t - tau)^2 < limit, cut to [lo, hi]; grows [*enter, *exit]. */
KERNEL_INLINE void shape_grow_window(double tau, double r2, double k, double limit, double lo, double hi, double *enter,
                                     double *exit) {
    const double inside = limit - r2;
    const double half = k > 0.0 ? sqrt(kernel_max(inside, 0.0) / (k > 0.0 ? k : 1.0)) : BLOB_INFINITY;
    const double from = kernel_max(tau - half, lo), to = kernel_min(tau + half, hi);
    const int meets = (inside > 0.0) & (from <= to);
    *enter = meets ? kernel_min(*enter, from) : *enter;
    *exit = meets ? kernel_max(*exit, to) : *exit;
}

/* Smallest value of one piece on [lo, hi]. */
KERNEL_INLINE void shape_grow_nearest(double tau, double r2, double k, double lo, double hi, double *t, double *s) {
    const double at = kernel_min(kernel_max(tau, lo), hi);
    const double value = r2 + k * (at - tau) * (at - tau);
    const int nearer = (lo <= hi) & (value < *s);
    *t = nearer ? at : *t;
    *s = nearer ? value : *s;
}

static void shape_line_pieces(shape_vector a, shape_vector b, const double *m, double scale,
                              const packet_rays *restrict rays, leaf_pieces *restrict p) {
    const shape_vector u = shape_sub(b, a);
    const double uu = shape_dot(u, u);
    LANE_LOOP(l) {
        const shape_vector o = shape_map_point(m, (shape_vector){rays->o[0][l], rays->o[1][l], rays->o[2][l]});
        const shape_vector d = shape_map_direction(m, (shape_vector){rays->d[0][l], rays->d[1][l], rays->d[2][l]});
        const shape_vector xa = shape_sub(o, a), xb = shape_sub(o, b);
        double tau_a, r2_a, k_a, tau_b, r2_b, k_b, tau, r2, k;
        shape_quadratic(xa, d, scale, &tau_a, &r2_a, &k_a);
        shape_quadratic(xb, d, scale, &tau_b, &r2_b, &k_b);
        const double inverse = uu > 0.0 ? 1.0 / uu : 0.0;
        const double du = shape_dot(d, u), xu = shape_dot(xa, u);
        shape_quadratic(shape_along(xa, -xu * inverse, u), shape_along(d, -du * inverse, u), scale, &tau, &r2, &k);
        /* t where the projection passes 0 and 1; du == 0: always on one side, told by xu / uu */
        const int rising = du > 0.0, falling = du < 0.0;
        const double safe = du != 0.0 ? du : 1.0;
        double at0 = -xu / safe, at1 = (uu - xu) / safe;
        at0 = rising | falling ? at0 : xu < 0.0 ? BLOB_INFINITY : -BLOB_INFINITY;
        at1 = rising | falling ? at1 : xu > uu ? -BLOB_INFINITY : BLOB_INFINITY;
        at1 = uu > 0.0 ? at1 : at0; /* zero length: both ends are the point, nothing between */
        at0 = uu > 0.0 ? at0 : at1;
        p->tau[0][l] = falling ? tau_b : tau_a;
        p->r2[0][l] = falling ? r2_b : r2_a;
        p->k[0][l] = falling ? k_b : k_a;
        p->tau[1][l] = tau;
        p->r2[1][l] = r2;
        p->k[1][l] = k;
        p->tau[2][l] = falling ? tau_a : tau_b;
        p->r2[2][l] = falling ? r2_a : r2_b;
        p->k[2][l] = falling ? k_a : k_b;
        p->first[l] = falling ? at1 : at0;
        p->second[l] = falling ? at0 : at1;
        p->bend[l] = k_a;
    }
}

static void shape_point_pieces(shape_vector a, const double *m, double scale, const packet_rays *restrict rays,
                               leaf_pieces *restrict p) {
    LANE_LOOP(l) {
        const shape_vector o = shape_map_point(m, (shape_vector){rays->o[0][l], rays->o[1][l], rays->o[2][l]});
        const shape_vector d = shape_map_direction(m, (shape_vector){rays->d[0][l], rays->d[1][l], rays->d[2][l]});
        double tau, r2, k;
        shape_quadratic(shape_sub(o, a), d, scale, &tau, &r2, &k);
        for (int i = 0; i < 3; i++) p->tau[i][l] = tau, p->r2[i][l] = r2, p->k[i][l] = k;
        p->first[l] = -BLOB_INFINITY;
        p->second[l] = BLOB_INFINITY;
        p->bend[l] = k;
    }
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
    int any = 0;
    LANE_LOOP(l) {
        double enter = BLOB_INFINITY, leave = -BLOB_INFINITY, nearest_t = 0.0, nearest_s = BLOB_INFINITY;
        const double cut[4] = {-BLOB_INFINITY, p->first[l], p->second[l], BLOB_INFINITY};
        for (int i = 0; i < 3; i++) {
            shape_grow_window(p->tau[i][l], p->r2[i][l], p->k[i][l], limit, cut[i], cut[i + 1], &enter, &leave);
            shape_grow_nearest(p->tau[i][l], p->r2[i][l], p->k[i][l], cut[i], cut[i + 1], &nearest_t, &nearest_s);
        }
        const double slack = 1e-14 * rays->magnitude[l] + 1e-12 * kernel_max(leave - enter, 0.0);
        f->enter[l] = enter - slack;
        f->exit[l] = leave + slack;
        p->nearest_t[l] = nearest_t;
        p->nearest_s[l] = nearest_s;
        f->tau[l] = nearest_t;
        f->r2[l] = nearest_s;
        any |= (f->enter[l] < end[l]) & (f->exit[l] > t[l]);
    }
    f->k = scale;
    f->rounding = 0.5 * sqrt(scale) * shape_stretch(m);
    return any;
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
