/* set.h - skeletons known by their distance alone: triangles, meshes, solids.
 *
 * For any closed set, dist^2 along a line is k t^2 plus a concave function (k: the squared speed of the
 * mapped ray), so its values and slopes at a and b enclose it in between (engine.md, fact 3). With h = b - a,
 * u = (t - a) / h and the chord through both values,
 *
 *     chord - k h^2 u (1 - u)  <=  dist^2  <=  chord + (h (q'(a) - q'(b)) + k h^2) u (1 - u)
 *
 * (the tangent at a is above by u A - k h^2 u (1 - u), the one at b by (1 - u) B - k h^2 u (1 - u), with
 * A + B = h (q'(a) - q'(b)) + 2 k h^2, and min(u A, (1 - u) B) <= (A + B) u (1 - u)). For convex sets the
 * upper one is the chord. A solid has distance 0 inside; the side is told by the angle-weighted normal of
 * the nearest vertex, edge or face (Baerentzen and Aanaes, Signed distance computation using the angle
 * weighted pseudonormal, 2005).
 */
#ifndef BLOB_SET_H
#define BLOB_SET_H

#include <float.h>

#include "index.h"
#include "shape.h"

enum { SET_NONE, SET_CONVEX, SET_ANY };

/* Nearest point of a set: the vector from it to the query, and what it lies on. */
typedef struct set_nearest {
    shape_vector away;
    double distance2;
    int32_t triangle;
    int32_t feature; /* 0 to 2: corner, 3 to 5: edge (i, i + 1), 6: face */
} set_nearest;

/* Along a ray: relative squared distance and its slope. */
typedef struct set_jet {
    double s, slope;
} set_jet;

/* Nearest point on a b: x from a. Returns the parameter, clamped to [0, 1]. */
KERNEL_INLINE double set_on_segment(shape_vector x, shape_vector u) {
    const double uu = shape_dot(u, u), h = uu > 0.0 ? shape_dot(x, u) / (uu > 0.0 ? uu : 1.0) : 0.0;
    return kernel_min(kernel_max(h, 0.0), 1.0);
}

/* Nearest point of the triangle c[0] c[1] c[2], whatever its shape: the face where the query projects into
 * it (told by the signs against the three edges), else the nearest of the three edges. */
static set_nearest set_triangle(const shape_vector *c, shape_vector p) {
    set_nearest best = {.distance2 = DBL_MAX};
    const shape_vector u = shape_sub(c[1], c[0]), v = shape_sub(c[2], c[0]);
    const shape_vector n = {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    const double nn = shape_dot(n, n);
    int inside = nn > 0.0;
    for (int i = 0; i < 3; i++) {
        const shape_vector a = c[i], edge = shape_sub(c[(i + 1) % 3], a), x = shape_sub(p, a);
        const double h = set_on_segment(x, edge);
        const shape_vector away = shape_along(x, -h, edge);
        const double d2 = shape_dot(away, away);
        const shape_vector out = {edge.y * n.z - edge.z * n.y, edge.z * n.x - edge.x * n.z, edge.x * n.y - edge.y * n.x};
        inside &= shape_dot(x, out) <= 0.0;
        if (d2 < best.distance2)
            best = (set_nearest){away, d2, 0, h <= 0.0 ? i : h >= 1.0 ? (i + 1) % 3 : 3 + i};
    }
    if (inside) {
        const double height = shape_dot(shape_sub(p, c[0]), n);
        const double d2 = height * height / nn;
        if (d2 <= best.distance2) best = (set_nearest){shape_along((shape_vector){0, 0, 0}, height / nn, n), d2, 0, 6};
    }
    return best;
}

KERNEL_INLINE void set_corners(const blob_scene *scene, const blob_mesh *mesh, int32_t triangle, shape_vector *c) {
    const int32_t *ids = scene->mesh_triangles + 3 * ((size_t)mesh->triangle_begin + (size_t)triangle);
    for (int i = 0; i < 3; i++) {
        const double *v = scene->mesh_vertices + 3 * ((size_t)mesh->vertex_begin + (size_t)ids[i]);
        c[i] = (shape_vector){v[0], v[1], v[2]};
    }
}

/* Squared distance from p to the eight boxes of a node, from below. */
KERNEL_INLINE void set_boxes(const index_node *restrict node, shape_vector p, double *restrict d2) {
    const double q[3] = {p.x, p.y, p.z};
    for (int i = 0; i < INDEX_WIDTH; i++) d2[i] = 0.0;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < INDEX_WIDTH; i++) {
            const double below = (double)node->lo[k][i] - q[k], above = q[k] - (double)node->hi[k][i];
            const double gap = kernel_max(kernel_max(below, above), 0.0);
            d2[i] += gap * gap;
        }
    }
}

/* Nearest triangle of a mesh, by its tree of boxes, nearer children first. */
static set_nearest set_mesh(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector p) {
    const blob_mesh *mesh = &scene->meshes[m];
    const index_tree *tree = &index->mesh_trees[m];
    struct {
        double d2;
        int32_t child, count;
    } stack[INDEX_STACK];
    int top = 0;
    set_nearest best = {.distance2 = DBL_MAX};
    stack[top].d2 = 0.0, stack[top].child = tree->node_begin, stack[top++].count = 1;
    while (top > 0) {
        top--;
        if (stack[top].d2 > best.distance2) continue;
        const int32_t child = stack[top].child, count = stack[top].count;
        if (child >= 0) {
            const index_node *node = &index->nodes[child];
            double d2[INDEX_WIDTH];
            set_boxes(node, p, d2);
            const int bottom = top;
            for (int i = 0; i < INDEX_WIDTH; i++) {
                if (node->count[i] == 0 || d2[i] * (1.0 - 1e-14) > best.distance2) continue;
                int at = top++; /* the nearest on top */
                while (at > bottom && stack[at - 1].d2 < d2[i]) {
                    stack[at] = stack[at - 1];
                    at--;
                }
                stack[at].d2 = d2[i] * (1.0 - 1e-14), stack[at].child = node->child[i], stack[at].count = node->count[i];
            }
            continue;
        }
        for (int32_t i = ~child; i < ~child + count; i++) {
            const int32_t triangle = index->mesh_order[i];
            shape_vector c[3];
            set_corners(scene, mesh, triangle, c);
            set_nearest found = set_triangle(c, p);
            found.triangle = triangle;
            if (found.distance2 < best.distance2 || (found.distance2 == best.distance2 && triangle < best.triangle)) best = found;
        }
    }
    return best;
}

static shape_vector set_face_normal(const blob_scene *scene, const blob_mesh *mesh, int32_t triangle) {
    shape_vector c[3];
    set_corners(scene, mesh, triangle, c);
    const shape_vector u = shape_sub(c[1], c[0]), v = shape_sub(c[2], c[0]);
    const shape_vector n = {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    const double length = sqrt(shape_dot(n, n)), scale = length > 0.0 ? 1.0 / length : 0.0;
    return (shape_vector){n.x * scale, n.y * scale, n.z * scale};
}

/* Does the query lie inside the solid? Its nearest point is known. */
static int set_inside(const blob_scene *scene, const blob_mesh *mesh, const set_nearest *near) {
    const size_t at = 3 * ((size_t)mesh->triangle_begin + (size_t)near->triangle);
    shape_vector n;
    if (near->feature < 3) {
        const int32_t corner = scene->mesh_triangles[at + (size_t)near->feature];
        const double *v = scene->mesh_normals + 3 * ((size_t)mesh->vertex_begin + (size_t)corner);
        n = (shape_vector){v[0], v[1], v[2]};
    } else {
        n = set_face_normal(scene, mesh, near->triangle);
        if (near->feature < 6)
            n = shape_along(n, 1.0, set_face_normal(scene, mesh, scene->mesh_neighbors[at + (size_t)near->feature - 3]));
    }
    return shape_dot(near->away, n) <= 0.0;
}

static set_nearest set_find(const blob_scene *scene, const blob_index *index, int32_t e, shape_vector p) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    if (shape->kind == SHAPE_TRIANGLE) {
        const shape_vector c[3] = {{scene->x[e], scene->y[e], scene->z[e]},
                                   {shape->b[0], shape->b[1], shape->b[2]},
                                   {shape->c[0], shape->c[1], shape->c[2]}};
        return set_triangle(c, p);
    }
    const blob_mesh *mesh = &scene->meshes[shape->mesh];
    set_nearest near = set_mesh(scene, index, shape->mesh, p);
    if (mesh->solid && set_inside(scene, mesh, &near)) near.away = (shape_vector){0, 0, 0}, near.distance2 = 0.0;
    return near;
}

/* The mapped ray of lane l. */
KERNEL_INLINE void set_ray(const blob_scene *scene, const leaf *f, const packet_rays *restrict r, int l, shape_vector *o,
                           shape_vector *d) {
    const double *m = shape_matrix(scene, &scene->shapes[scene->shape[f->element]]);
    *o = shape_map_point(m, (shape_vector){r->o[0][l], r->o[1][l], r->o[2][l]});
    *d = shape_map_direction(m, (shape_vector){r->d[0][l], r->d[1][l], r->d[2][l]});
}

static set_jet set_at(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                      int l, double t) {
    shape_vector o, d;
    set_ray(scene, f, r, l, &o, &d);
    const set_nearest near = set_find(scene, index, f->element, shape_along(o, t, d));
    return (set_jet){f->k * near.distance2, 2.0 * f->k * shape_dot(near.away, d)};
}

/* A squared distance at which nothing is left of the density. */
KERNEL_INLINE double set_beyond(const blob_scene *scene, const leaf *f) {
    const double support = scene->support[f->element];
    return 4.0 * f->k * support * support;
}

/* The enclosure above for every lane whose interval touches the leaf. */
static void set_ranges(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                       const double *restrict from, const double *restrict to, leaf_range *restrict ranges) {
    const double away = set_beyond(scene, f);
    LANE_LOOP(l) {
        leaf_range *q = &ranges[l];
        if (!((f->enter[l] < to[l]) & (f->exit[l] > from[l]))) {
            *q = (leaf_range){away, away, away, away, away, away, away, 0.0, 0.0};
            continue;
        }
        shape_vector o, d;
        set_ray(scene, f, r, l, &o, &d);
        const set_jet a = set_at(scene, index, f, r, l, from[l]), b = set_at(scene, index, f, r, l, to[l]);
        const double h = to[l] - from[l], bend = f->k * shape_dot(d, d) * h * h, chord = 0.5 * (a.s + b.s);
        const double speed = sqrt(bend), ra = sqrt(a.s), rb = sqrt(b.s);
        const double near = kernel_max(0.5 * (ra + rb - speed), 0.0);
        q->sa = a.s;
        q->sb = b.s;
        q->middle_lo = chord - 0.5 * bend;
        q->lo = kernel_max(near * near, kernel_min(kernel_min(a.s, b.s), q->middle_lo));
        if (f->set == SET_CONVEX) {
            q->middle_hi = chord;
            q->hi = kernel_max(a.s, b.s);
            q->slope_lo = a.slope;
            q->slope_hi = b.slope;
            /* above both tangents: the value where they meet */
            const double fall = a.slope * h, rise = b.slope * h, turn = rise - fall;
            const double meet = a.slope >= 0.0 ? a.s : b.slope <= 0.0 ? b.s
                                : turn > 0.0   ? a.s + fall * kernel_min(kernel_max((a.s - b.s + rise) / turn, 0.0), 1.0)
                                               : 0.0;
            q->lo = kernel_max(q->lo, meet * (1.0 - 1e-14));
        } else {
            const double far = 0.5 * (ra + rb + speed);
            q->middle_hi = chord + 0.5 * kernel_max(h * (a.slope - b.slope) + bend, 0.0);
            q->hi = kernel_min(far * far, kernel_max(kernel_max(a.s, b.s), q->middle_hi));
            q->slope_lo = h > 0.0 ? b.slope - 2.0 * bend / h : b.slope;
            q->slope_hi = h > 0.0 ? a.slope + 2.0 * bend / h : a.slope;
        }
        q->lo = kernel_min(q->lo, kernel_min(a.s, b.s));
        q->hi = kernel_max(q->hi, kernel_max(a.s, b.s));
        q->mid = kernel_max(kernel_min(0.25 * (a.s + b.s) + 0.5 * q->middle_hi, q->hi), q->lo);
    }
}

/* grad s / 2 and s at o + t d. */
static void set_toward(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                       const double *restrict t, double (*restrict toward)[LANES], double *restrict s) {
    const double away = set_beyond(scene, f);
    const double *m = shape_matrix(scene, &scene->shapes[scene->shape[f->element]]);
    LANE_LOOP(l) {
        toward[0][l] = toward[1][l] = toward[2][l] = 0.0;
        s[l] = away;
        if (!((f->enter[l] < t[l]) & (f->exit[l] > t[l]))) continue;
        shape_vector o, d;
        set_ray(scene, f, r, l, &o, &d);
        const set_nearest near = set_find(scene, index, f->element, shape_along(o, t[l], d));
        const shape_vector v = near.away;
        s[l] = f->k * near.distance2;
        toward[0][l] = f->k * (m[0] * v.x + m[4] * v.y + m[8] * v.z);
        toward[1][l] = f->k * (m[1] * v.x + m[5] * v.y + m[9] * v.z);
        toward[2][l] = f->k * (m[2] * v.x + m[6] * v.y + m[10] * v.z);
    }
}

/* Fill a leaf for element e: it matters in its box. 1 if a ray meets it between t and end. */
static int set_meets(const blob_scene *scene, int32_t e, const packet_rays *restrict r, const double *restrict t,
                     const double *restrict end, leaf *restrict f) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    const blob_mesh *mesh = shape->kind == SHAPE_MESH ? &scene->meshes[shape->mesh] : NULL;
    f->set = !mesh || (mesh->solid && mesh->convex) ? SET_CONVEX : SET_ANY;
    f->k = scene->inverse_reach2[e];
    f->rounding = 0.5 * sqrt(f->k) * shape_stretch(shape_matrix(scene, shape));
    int any = 0;
    LANE_LOOP(l) {
        double enter = -BLOB_INFINITY, leave = BLOB_INFINITY;
        for (int k = 0; k < 3; k++) {
            const double grow = 1e-14 * r->magnitude[l], inverse = r->inverse[k][l];
            const double u = (shape->box[k] - grow - r->o[k][l]) * inverse;
            const double v = (shape->box[3 + k] + grow - r->o[k][l]) * inverse;
            enter = kernel_max(enter, kernel_min(u, v));
            leave = kernel_min(leave, kernel_max(u, v));
        }
        const int meets = enter < leave;
        f->enter[l] = meets ? enter : BLOB_INFINITY;
        f->exit[l] = meets ? leave : -BLOB_INFINITY;
        f->tau[l] = f->r2[l] = 0.0;
        any |= (f->enter[l] < end[l]) & (f->exit[l] > t[l]);
    }
    return any;
}

#endif
