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
 *
 * Over one vertex, edge or face dist^2 is one quadratic. What is nearest to one of them is convex where the set is, so
 * the same one at both ends is the one in between. Elsewhere dist^2 is below that of the nearest triangle and above
 * the least of all that can be the nearest; a ray that nearly touches a face needs no more steps for it.
 */
#ifndef BLOB_SET_H
#define BLOB_SET_H

#include <float.h>

#include "index.h"
#include "shape.h"

enum { SET_NONE, SET_CONVEX, SET_ANY };

/* What a nearest point lies on: 0 to 2 a corner, 3 to 5 the edge (i, i + 1), the face, or the query is inside a
 * solid. */
enum { SET_EDGE = 3, SET_FACE = 6, SET_INSIDE = 7 };

/* Nearest point of a set: the vector from it to the query, and what it lies on. */
typedef struct set_nearest {
    shape_vector away;
    double distance2;
    int32_t triangle;
    int32_t feature;
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
        const shape_vector out = {edge.y * n.z - edge.z * n.y, edge.z * n.x - edge.x * n.z,
                                  edge.x * n.y - edge.y * n.x};
        inside &= shape_dot(x, out) <= 0.0;
        if (d2 < best.distance2) best = (set_nearest){away, d2, 0, h <= 0.0 ? i : h >= 1.0 ? (i + 1) % 3 : 3 + i};
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

/* Squared distance from p to what is in the eight boxes and slabs of a node, from below. Below or above a slab by s,
 * the nearest point of the slab is p - s n, and what is in both is no nearer to p than the root of s^2 + |p - s n -
 * box|^2. */
KERNEL_INLINE void set_boxes(const blob_index *restrict index, int32_t number, shape_vector p, double *restrict d2) {
    const index_node *node = &index->nodes[number];
    const index_slab *slab = &index->mesh_slabs[number - index->mesh_node];
    const double slack = 1e-15 * (fabs(p.x) + fabs(p.y) + fabs(p.z));
    LANE_SIMD(i) {
        const double n[3] = {(double)slab->n[0][i], (double)slab->n[1][i], (double)slab->n[2][i]};
        const double height = n[0] * p.x + n[1] * p.y + n[2] * p.z;
        const double above = height - (double)slab->hi[i], below = (double)slab->lo[i] - height;
        const double s = kernel_max(kernel_max(above, below) - slack, 0.0), way = above > below ? s : -s;
        const double q[3] = {p.x - way * n[0], p.y - way * n[1], p.z - way * n[2]};
        double sum = s * s;
        for (int k = 0; k < 3; k++) {
            const double low = (double)node->lo[k][i] - q[k], high = q[k] - (double)node->hi[k][i];
            const double gap = kernel_max(kernel_max(low, high) - slack, 0.0);
            sum += gap * gap;
        }
        d2[i] = sum;
    }
}

/* Squared distance, the vector from the nearest point and (unless NULL) what that lies on, as set_triangle, for
 * LANES pairs of a triangle c[corner][axis] and a query p. */
LANE_INLINE void set_triangle_lanes(lane_real c[3][3], const lane_real *p, lane_real *away, lane_real *distance2,
                                    lane_real *feature) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    lane_real u[3], v[3], n[3], x[3];
    for (int k = 0; k < 3; k++) u[k] = c[1][k] - c[0][k], v[k] = c[2][k] - c[0][k];
    for (int k = 0; k < 3; k++) n[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
    const lane_real nn = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    const lane_mask proper = nn > 0.0;
    lane_mask inside = proper;
    *distance2 = lane_all(DBL_MAX);
    for (int i = 0; i < 3; i++) {
        lane_real e[3], far[3];
        for (int k = 0; k < 3; k++) e[k] = c[(i + 1) % 3][k] - c[i][k], x[k] = p[k] - c[i][k];
        const lane_real ee = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
        const lane_mask long_enough = ee > 0.0;
        const lane_real along = (x[0] * e[0] + x[1] * e[1] + x[2] * e[2]) / lane_select(long_enough, ee, one);
        const lane_real h = lane_select(long_enough, lane_min(lane_max(along, zero), one), zero);
        for (int k = 0; k < 3; k++) far[k] = x[k] - h * e[k];
        const lane_real d2 = far[0] * far[0] + far[1] * far[1] + far[2] * far[2];
        const lane_mask nearer = d2 < *distance2;
        for (int k = 0; k < 3; k++) away[k] = lane_select(nearer, far[k], away[k]);
        *distance2 = lane_select(nearer, d2, *distance2);
        if (feature) {
            const lane_real end = lane_select(h >= 1.0, lane_all((double)((i + 1) % 3)), lane_all((double)(3 + i)));
            *feature = lane_select(nearer, lane_select(h <= 0.0, lane_all((double)i), end), *feature);
        }
        lane_real out = zero;
        for (int k = 0; k < 3; k++) out += x[k] * (e[(k + 1) % 3] * n[(k + 2) % 3] - e[(k + 2) % 3] * n[(k + 1) % 3]);
        inside &= out <= 0.0;
    }
    lane_real height = zero;
    for (int k = 0; k < 3; k++) height += (p[k] - c[0][k]) * n[k];
    const lane_real share = height / lane_select(proper, nn, one), d2 = height * share;
    const lane_mask face = inside & (d2 <= *distance2);
    for (int k = 0; k < 3; k++) away[k] = lane_select(face, share * n[k], away[k]);
    *distance2 = lane_select(face, d2, *distance2);
    if (feature) *feature = lane_select(face, lane_all(6.0), *feature);
}

/* The better of `best` and one triangle, which of two at the same distance has the smaller number. */
static void set_try(const blob_scene *scene, const blob_mesh *mesh, int32_t triangle, shape_vector p,
                    set_nearest *best) {
    shape_vector c[3];
    set_corners(scene, mesh, triangle, c);
    set_nearest found = set_triangle(c, p);
    found.triangle = triangle;
    if (found.distance2 < best->distance2 || (found.distance2 == best->distance2 && triangle < best->triangle))
        *best = found;
}

/* Triangles that may be the nearest, with their distance but for rounding. */
enum { SET_TIES = 32 };
typedef struct set_ties {
    double distance2; /* the least, or a bound that nothing beyond is to be told of */
    int count;
    int32_t triangle[SET_TIES];
    double of[SET_TIES];
} set_ties;

/* As far as what is rounded in another order may be apart. */
KERNEL_INLINE double set_tied(double distance2) { return distance2 * (1.0 + 1e-12); }

/* Those that still are. */
static void set_drop(set_ties *ties) {
    int kept = 0;
    for (int i = 0; i < ties->count; i++) {
        if (ties->of[i] > set_tied(ties->distance2)) continue;
        ties->triangle[kept] = ties->triangle[i];
        ties->of[kept++] = ties->of[i];
    }
    ties->count = kept;
}

/* The nearest of them, compared one by one: which it is does not depend on where it was found. */
static void set_settle(const blob_scene *scene, const blob_mesh *mesh, shape_vector p, set_ties *ties,
                       set_nearest *best) {
    set_drop(ties);
    for (int i = 0; i < ties->count; i++) set_try(scene, mesh, ties->triangle[i], p, best);
    ties->count = 0;
}

/* A leaf of at most INDEX_WIDTH triangles, all at once; what room is left repeats the last. */
static void set_leaf(const blob_scene *scene, const blob_index *index, const blob_mesh *mesh, int32_t first,
                     int32_t count, shape_vector p, set_ties *ties, set_nearest *best) {
    lane_real c[3][3], away[3], d2;
    const lane_real query[3] = {lane_all(p.x), lane_all(p.y), lane_all(p.z)};
    const double *corners = index->mesh_corners + 9 * (size_t)first;
    for (int i = 0; i < 9; i++) c[i / 3][i % 3] = lane_load(corners + INDEX_WIDTH * i);
    away[0] = away[1] = away[2] = lane_all(0.0);
    set_triangle_lanes(c, query, away, &d2, NULL);
    if (!lane_any(d2 <= set_tied(ties->distance2))) return;
    for (int l = 0; l < count; l++) ties->distance2 = kernel_min(ties->distance2, d2[l]);
    if (ties->count > SET_TIES - INDEX_WIDTH) set_drop(ties);
    if (ties->count > SET_TIES - INDEX_WIDTH) set_settle(scene, mesh, p, ties, best);
    for (int l = 0; l < count; l++) {
        if (d2[l] > set_tied(ties->distance2)) continue;
        ties->triangle[ties->count] = index->mesh_order[first + l];
        ties->of[ties->count++] = d2[l];
    }
}

/* Nearest triangle of a mesh, by its tree of boxes, nearer children first; triangle -1 and distance2 = limit2 if none
 * is nearer than that. share: 1, or less where any triangle will do such that no other has less than that share of its
 * squared distance. */
static set_nearest set_mesh(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector p, double limit2,
                            double share) {
    const blob_mesh *mesh = &scene->meshes[m];
    const index_tree *tree = &index->mesh_trees[m];
    struct {
        double d2;
        int32_t child, count;
    } stack[INDEX_STACK];
    int top = 0;
    set_ties ties = {.distance2 = limit2, .count = 0};
    set_nearest best = {.distance2 = limit2, .triangle = -1};
    stack[top].d2 = 0.0, stack[top].child = tree->root, stack[top++].count = 1;
    while (top > 0) {
        top--;
        if (stack[top].d2 > share * ties.distance2) continue;
        const int32_t child = stack[top].child, count = stack[top].count;
        if (child < 0) {
            for (int32_t i = 0; i < count; i += INDEX_WIDTH)
                set_leaf(scene, index, mesh, ~child + i, count - i < INDEX_WIDTH ? count - i : INDEX_WIDTH, p, &ties,
                         &best);
            continue;
        }
        const index_node *node = &index->nodes[child];
        double d2[INDEX_WIDTH];
        set_boxes(index, child, p, d2);
        const int bottom = top;
        const double most = share * ties.distance2;
        unsigned near = 0; /* boxes of unused children are empty, and infinitely far */
        for (int i = 0; i < INDEX_WIDTH; i++) near |= (unsigned)(d2[i] * (1.0 - 1e-14) <= most) << i;
        for (; near; near &= near - 1) {
            const int i = __builtin_ctz(near);
            int at = top++; /* the nearest on top */
            while (at > bottom && stack[at - 1].d2 < d2[i]) {
                stack[at] = stack[at - 1];
                at--;
            }
            stack[at].d2 = d2[i] * (1.0 - 1e-14), stack[at].child = node->child[i], stack[at].count = node->count[i];
        }
    }
    set_settle(scene, mesh, p, &ties, &best);
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
            n = shape_along(n, 1.0,
                            set_face_normal(scene, mesh, scene->mesh_neighbors[at + (size_t)near->feature - 3]));
    }
    return shape_dot(near->away, n) <= 0.0;
}

/* Does the line from p on along an axis leave through a triangle (1), enter (-1), or neither? The two faces at an edge
 * decide by the same numbers, so that no line slips through between them. */
static int set_crossing(const shape_vector *c, const double *p, int axis) {
    double v[3][3], u[3], w[3], n[3]; /* the axis first */
    int turns = 0;
    for (int i = 0; i < 3; i++) {
        const double corner[3] = {c[i].x, c[i].y, c[i].z};
        for (int k = 0; k < 3; k++) v[i][k] = corner[(axis + k) % 3];
    }
    for (int i = 0; i < 3; i++) {
        const double *first = v[i], *second = v[(i + 1) % 3];
        const int up = first[1] <= p[1] && second[1] > p[1], down = second[1] <= p[1] && first[1] > p[1];
        const double *low = up ? first : second, *high = up ? second : first;
        if ((high[1] - low[1]) * (p[2] - low[2]) - (high[2] - low[2]) * (p[1] - low[1]) > 0.0) turns += up - down;
    }
    if (turns == 0) return 0;
    for (int k = 0; k < 3; k++) u[k] = v[1][k] - v[0][k], w[k] = v[2][k] - v[0][k];
    for (int k = 0; k < 3; k++) n[k] = u[(k + 1) % 3] * w[(k + 2) % 3] - u[(k + 2) % 3] * w[(k + 1) % 3];
    const double height = n[0] * (v[0][0] - p[0]) + n[1] * (v[0][1] - p[1]) + n[2] * (v[0][2] - p[2]);
    return turns * height > 0.0 ? turns : 0;
}

/* Is the winding number of a mesh about p, counted along an axis, above 0? */
static int set_wound(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector at, int axis) {
    const double xyz[3] = {at.x, at.y, at.z};
    const int other = (axis + 1) % 3, third = (axis + 2) % 3;
    const double p[3] = {xyz[axis], xyz[other], xyz[third]};
    int32_t child[INDEX_STACK], size[INDEX_STACK];
    int top = 0, number = 0;
    child[top] = index->mesh_trees[m].root, size[top++] = 1;
    while (top > 0) {
        const int32_t next = child[--top], n = size[top];
        for (int32_t i = 0; next < 0 && i < n; i++) {
            shape_vector c[3];
            set_corners(scene, &scene->meshes[m], index->mesh_order[~next + i], c);
            number += set_crossing(c, p, axis);
        }
        if (next < 0) continue;
        const index_node *node = &index->nodes[next];
        for (int i = 0; i < INDEX_WIDTH; i++) {
            const int meets = (double)node->hi[axis][i] >= p[0] && (double)node->lo[other][i] <= p[1] &&
                              (double)node->hi[other][i] >= p[1] && (double)node->lo[third][i] <= p[2] &&
                              (double)node->hi[third][i] >= p[2];
            if (node->count[i] != 0 && meets) child[top] = node->child[i], size[top++] = node->count[i];
        }
    }
    return number > 0;
}

/* Nearest point of the surface of element e. limit2: as for set_mesh; solids know none, or what lies deep inside would
 * count as outside. within2: something of a mesh is known to be no farther than that. */
static set_nearest set_surface(const blob_scene *scene, const blob_index *index, int32_t e, shape_vector p,
                               double limit2, double within2) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    if (shape->kind == SHAPE_TRIANGLE) {
        const shape_vector c[3] = {{scene->x[e], scene->y[e], scene->z[e]},
                                   {shape->b[0], shape->b[1], shape->b[2]},
                                   {shape->c[0], shape->c[1], shape->c[2]}};
        return set_triangle(c, p);
    }
    const double most = scene->meshes[shape->mesh].solid ? DBL_MAX : limit2;
    const set_nearest near = set_mesh(scene, index, shape->mesh, p, kernel_min(most, within2), 1.0);
    return near.triangle < 0 && within2 < most ? set_mesh(scene, index, shape->mesh, p, most, 1.0) : near;
}

/* The same of the element: a solid has no distance inside. What is nearest tells one that is inside; where parts of a
 * solid overlap one another, the nearest may be a wall of one of them within another, and its winding number is asked,
 * along two axes, lest rounding decide. outside: p is known to be. */
static set_nearest set_filled(const blob_scene *scene, const blob_index *index, int32_t e, shape_vector p, int outside,
                              set_nearest near) {
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    if (outside || shape->kind != SHAPE_MESH || near.triangle < 0) return near;
    const blob_mesh *mesh = &scene->meshes[shape->mesh];
    if (!mesh->solid) return near;
    const int overlaps = !mesh->convex;
    if (set_inside(scene, mesh, &near) ||
        (overlaps && set_wound(scene, index, shape->mesh, p, 0) && set_wound(scene, index, shape->mesh, p, 1)))
        near.away = (shape_vector){0, 0, 0}, near.distance2 = 0.0, near.feature = SET_INSIDE;
    return near;
}

KERNEL_INLINE double set_size(shape_vector p) { return fabs(p.x) + fabs(p.y) + fabs(p.z); }

/* Radius of a ball around p that is inside a solid as a whole, or 0. Deep inside much is about as near as the nearest;
 * anything about as near will do: it has a neighbourhood of its own that p can be moved to without crossing what is
 * nearest. */
static double set_depth(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector p, double within2) {
    const double share = 0.8, moved = 0.85; /* < sqrt(share) */
    const set_nearest some = set_mesh(scene, index, m, p, within2, share);
    const double distance = sqrt(some.distance2);
    if (some.triangle < 0 || distance <= 1e-6 * set_size(p)) return 0.0;
    const shape_vector close = shape_along(p, -moved, some.away);
    const double left = (1.0 - moved) * distance * (1.0 + 1e-6);
    const set_nearest near = set_mesh(scene, index, m, close, left * left, 1.0);
    return near.triangle >= 0 && set_inside(scene, &scene->meshes[m], &near) ? moved * distance : 0.0;
}

/* What was nearest where a mesh was last looked at along each ray, twice: intervals share their ends, neighbouring
 * rays their nearest triangles. */
typedef struct set_memory {
    LANE_ALIGN double t[2][LANES];       /* NaN: nothing yet */
    LANE_ALIGN double foot[2][3][LANES]; /* on the surface; far away: not known */
    LANE_ALIGN double ball[2][4][LANES]; /* middle and radius: no surface there, all inside a solid or, < 0, outside */
    set_nearest of[2][LANES];
} set_memory;

static void set_forget(set_memory *memory) {
    for (int slot = 0; slot < 2; slot++) {
        lane_store(memory->t[slot], lane_all(BLOB_NAN));
        for (int k = 0; k < 3; k++) lane_store(memory->foot[slot][k], lane_all(BLOB_INFINITY));
        for (int k = 0; k < 4; k++) lane_store(memory->ball[slot][k], lane_all(0.0));
    }
}

/* What lane l may ask: its own two slots, and this one of the lane before. */
enum { SET_SOURCES = 3 };
KERNEL_INLINE int set_slot(int source, int slot) { return source < 2 ? source : slot; }
KERNEL_INLINE int set_lane(int source, int l) { return source < 2 || l == 0 ? l : l - 1; }

/* No less than the squared distance of p from the surface: that from the points of it that are known. */
static double set_within(const set_memory *memory, int slot, int l, shape_vector p) {
    double least = BLOB_INFINITY;
    for (int i = 0; i < SET_SOURCES; i++) {
        const int from = set_slot(i, slot), lane = set_lane(i, l);
        const shape_vector foot = {memory->foot[from][0][lane], memory->foot[from][1][lane],
                                   memory->foot[from][2][lane]};
        const shape_vector away = shape_sub(p, foot);
        least = kernel_min(least, shape_dot(away, away));
    }
    const double within = sqrt(least) * (1.0 + 1e-9) + 1e-15 * set_size(p);
    return within * within;
}

/* Is p inside a solid (1) or outside (-1), as the balls that are known tell? 0: they do not. */
static int set_by_balls(const set_memory *memory, int slot, int l, shape_vector p) {
    for (int i = 0; i < SET_SOURCES; i++) {
        double ball[4];
        for (int k = 0; k < 4; k++) ball[k] = memory->ball[set_slot(i, slot)][k][set_lane(i, l)];
        const shape_vector away = shape_sub(p, (shape_vector){ball[0], ball[1], ball[2]});
        if (shape_dot(away, away) < ball[3] * ball[3] * (1.0 - 1e-9)) return ball[3] > 0.0 ? 1 : -1;
    }
    return 0;
}

static void set_keep_ball(set_memory *memory, int slot, int l, shape_vector p, double radius) {
    memory->ball[slot][0][l] = p.x, memory->ball[slot][1][l] = p.y, memory->ball[slot][2][l] = p.z;
    memory->ball[slot][3][l] = radius;
}

/* May p be inside, for all that is known? */
static int set_seems_inside(const set_memory *memory, int slot, int l) {
    int seen = 0;
    for (int i = 0; i < SET_SOURCES; i++) {
        const int from = set_slot(i, slot), lane = set_lane(i, l);
        if (isnan(memory->t[from][lane])) continue;
        if (memory->of[from][lane].feature == SET_INSIDE) return 1;
        seen = 1;
    }
    return !seen;
}

/* The nearest point of the mesh that element e is, from p = o + t d of lane l; to be known from `slot` next time. */
static set_nearest set_look(const blob_scene *scene, const blob_index *index, int32_t e, set_memory *memory, int slot,
                            int l, double t, shape_vector p, double limit2) {
    for (int i = 0; i < 2; i++) {
        const set_nearest known = memory->of[i][l];
        if (memory->t[i][l] != t || (known.triangle < 0 && known.distance2 < limit2)) continue;
        memory->t[slot][l] = t;
        memory->of[slot][l] = known;
        for (int k = 0; k < 3; k++) memory->foot[slot][k][l] = memory->foot[i][k][l];
        for (int k = 0; k < 4; k++) memory->ball[slot][k][l] = memory->ball[i][k][l];
        return known;
    }
    const int32_t m = scene->shapes[scene->shape[e]].mesh;
    const int solid = scene->meshes[m].solid, side = solid ? set_by_balls(memory, slot, l, p) : -1;
    const double within2 = set_within(memory, slot, l, p);
    const int tries = side == 0 && set_seems_inside(memory, slot, l);
    const double deep = tries ? set_depth(scene, index, m, p, kernel_min(within2, DBL_MAX)) : 0.0;
    set_nearest near = {.feature = SET_INSIDE};
    if (deep > 0.0) {
        set_keep_ball(memory, slot, l, p, deep);
    } else if (side <= 0) {
        near = set_surface(scene, index, e, p, limit2, within2);
        const double clear = sqrt(near.distance2);
        const shape_vector foot = shape_sub(p, near.away);
        if (near.triangle >= 0)
            memory->foot[slot][0][l] = foot.x, memory->foot[slot][1][l] = foot.y, memory->foot[slot][2][l] = foot.z;
        near = set_filled(scene, index, e, p, side < 0, near);
        if (solid) set_keep_ball(memory, slot, l, p, near.feature == SET_INSIDE ? clear : -clear);
    }
    memory->t[slot][l] = t;
    memory->of[slot][l] = near;
    return near;
}

/* The mapped ray of lane l. */
KERNEL_INLINE void set_ray(const blob_scene *scene, const leaf *f, const packet_rays *restrict r, int l,
                           shape_vector *o, shape_vector *d) {
    const double *m = shape_matrix(scene, &scene->shapes[scene->shape[f->element]]);
    *o = shape_map_point(m, (shape_vector){r->o[0][l], r->o[1][l], r->o[2][l]});
    *d = shape_map_direction(m, (shape_vector){r->d[0][l], r->d[1][l], r->d[2][l]});
}

static set_jet set_at(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                      int l, double t) {
    shape_vector o, d;
    set_ray(scene, f, r, l, &o, &d);
    const shape_vector p = shape_along(o, t, d);
    const set_nearest surface = set_surface(scene, index, f->element, p, DBL_MAX, DBL_MAX);
    const set_nearest near = set_filled(scene, index, f->element, p, 0, surface);
    return (set_jet){f->k * near.distance2, 2.0 * f->k * shape_dot(near.away, d)};
}

/* A squared distance at which nothing is left of the density. */
KERNEL_INLINE double set_beyond(const blob_scene *scene, const leaf *f) {
    const double support = scene->support[f->element];
    return 4.0 * f->k * support * support;
}

/* Where the query points o + t d of the lanes that touch the leaf are nearest; elsewhere out of its reach. */
typedef struct set_near {
    lane_real away[3], s, slope; /* away in the space of the skeleton */
    lane_real speed2;            /* |d'|^2 */
    lane_real feature;           /* of a triangle */
    set_nearest of[LANES];       /* in a mesh: what touches */
} set_near;

/* limit: what is further away than that, in the space of the skeleton, need not be told how far. memory, slot: of a
 * mesh. */
static set_near set_query(const blob_scene *scene, const blob_index *index, const leaf *f,
                          const packet_rays *restrict r, lane_real t, lane_mask touches, lane_real limit,
                          set_memory *memory, int slot) {
    const blob_shape *shape = &scene->shapes[scene->shape[f->element]];
    const double *m = shape_matrix(scene, shape);
    const lane_real zero = lane_all(0.0), at = lane_select(touches, t, zero);
    lane_real p[3], d[3], distance2 = zero;
    set_near near;
    near.speed2 = near.feature = zero;
    for (int k = 0; k < 3; k++) {
        d[k] = m[4 * k] * lane_load(r->d[0]) + m[4 * k + 1] * lane_load(r->d[1]) + m[4 * k + 2] * lane_load(r->d[2]);
        p[k] = m[4 * k] * lane_load(r->o[0]) + m[4 * k + 1] * lane_load(r->o[1]) + m[4 * k + 2] * lane_load(r->o[2]) +
               m[4 * k + 3] + at * d[k];
        near.away[k] = zero;
        near.speed2 += d[k] * d[k];
    }
    if (shape->kind == SHAPE_TRIANGLE) {
        const int32_t e = f->element;
        lane_real c[3][3] = {{lane_all(scene->x[e]), lane_all(scene->y[e]), lane_all(scene->z[e])},
                             {lane_all(shape->b[0]), lane_all(shape->b[1]), lane_all(shape->b[2])},
                             {lane_all(shape->c[0]), lane_all(shape->c[1]), lane_all(shape->c[2])}};
        set_triangle_lanes(c, p, near.away, &distance2, &near.feature);
    } else {
        LANE_LOOP(l) {
            if (!touches[l]) continue;
            const shape_vector q = {p[0][l], p[1][l], p[2][l]};
            near.of[l] = set_look(scene, index, f->element, memory, slot, l, t[l], q, limit[l] * limit[l]);
            near.away[0][l] = near.of[l].away.x;
            near.away[1][l] = near.of[l].away.y;
            near.away[2][l] = near.of[l].away.z;
            distance2[l] = near.of[l].distance2;
        }
    }
    near.s = lane_select(touches, f->k * distance2, lane_all(set_beyond(scene, f)));
    near.slope = 2.0 * f->k * (near.away[0] * d[0] + near.away[1] * d[1] + near.away[2] * d[2]);
    near.slope = lane_select(touches, near.slope, zero);
    return near;
}

/* ---- where dist^2 is one quadratic ------------------------------------------------------------------ */

/* Do two nearest points of a convex solid lie on one vertex, one edge, or in one plane? */
static int set_same_place(const blob_scene *scene, const blob_mesh *mesh, const set_nearest *a, const set_nearest *b) {
    const int edge_a = a->feature >= SET_EDGE && a->feature < SET_FACE,
              edge_b = b->feature >= SET_EDGE && b->feature < SET_FACE;
    if (a->triangle < 0 || b->triangle < 0 || edge_a != edge_b) return 0;
    if (a->feature >= SET_FACE || b->feature >= SET_FACE) {
        if (a->feature != b->feature) return 0;
        if (a->feature == SET_INSIDE || a->triangle == b->triangle) return 1;
        /* to the last bits, or the planes differ */
        const shape_vector n =
            shape_sub(set_face_normal(scene, mesh, a->triangle), set_face_normal(scene, mesh, b->triangle));
        return fabs(n.x) <= 4e-16 && fabs(n.y) <= 4e-16 && fabs(n.z) <= 4e-16;
    }
    const int32_t *u = scene->mesh_triangles + 3 * ((size_t)mesh->triangle_begin + (size_t)a->triangle);
    const int32_t *v = scene->mesh_triangles + 3 * ((size_t)mesh->triangle_begin + (size_t)b->triangle);
    if (!edge_a) return u[a->feature] == v[b->feature];
    const int32_t ua = u[a->feature - SET_EDGE], ub = u[(a->feature - SET_EDGE + 1) % 3];
    const int32_t va = v[b->feature - SET_EDGE], vb = v[(b->feature - SET_EDGE + 1) % 3];
    return (ua == va && ub == vb) || (ua == vb && ub == va);
}

/* Lanes whose interval lies over one feature of a convex set as a whole: what is nearest to one feature of it is
 * convex, too. */
static lane_mask set_over_one(const blob_scene *scene, const leaf *f, const set_near *a, const set_near *b,
                              lane_mask touches) {
    const blob_shape *shape = &scene->shapes[scene->shape[f->element]];
    if (shape->kind == SHAPE_TRIANGLE) return touches & (a->feature == b->feature);
    lane_mask one = touches;
    LANE_LOOP(l) {
        if (touches[l] && !set_same_place(scene, &scene->meshes[shape->mesh], &a->of[l], &b->of[l])) one[l] = 0;
    }
    return one;
}

/* The triangles that can be the nearest anywhere on an interval, for one ray: those no further from its middle than
 * `radius`. -1: more than there is room for. */
enum { SET_ROOM = 24 };
static int set_gather(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector p, double radius2,
                      int32_t *found) {
    const blob_mesh *mesh = &scene->meshes[m];
    int32_t child[INDEX_STACK], size[INDEX_STACK];
    int top = 0, count = 0;
    child[top] = index->mesh_trees[m].root, size[top++] = 1;
    while (top > 0) {
        const int32_t at = child[--top], n = size[top];
        if (at < 0) {
            for (int32_t i = 0; i < n; i++) {
                const int32_t triangle = index->mesh_order[~at + i];
                shape_vector c[3];
                set_corners(scene, mesh, triangle, c);
                if (set_triangle(c, p).distance2 > radius2) continue;
                if (count == SET_ROOM) return -1;
                found[count++] = triangle;
            }
            continue;
        }
        const index_node *node = &index->nodes[at];
        double d2[INDEX_WIDTH];
        set_boxes(index, at, p, d2);
        for (int i = 0; i < INDEX_WIDTH; i++)
            if (node->count[i] != 0 && d2[i] * (1.0 - 1e-14) <= radius2)
                child[top] = node->child[i], size[top++] = node->count[i];
    }
    return count;
}

/* Middle coefficients of quadratics around dist^2 of a mesh on an interval, by those of its triangles one by one:
 * dist^2 is below that of the nearest one and above the least coefficients of all that can be the nearest. p, q: the
 * ends; a, b: what is nearest there; bend = |q - p|^2. 0: nothing better is known. */
static int set_middle(const blob_scene *scene, const blob_index *index, int32_t m, shape_vector p, shape_vector q,
                      const set_nearest *a, const set_nearest *b, double bend, double *lo, double *hi) {
    const blob_mesh *mesh = &scene->meshes[m];
    const int few = mesh->triangle_end - mesh->triangle_begin <= SET_ROOM;
    if (a->triangle < 0 || b->triangle < 0 || a->feature == SET_INSIDE || b->feature == SET_INSIDE) return 0;
    if (!few && a->triangle != b->triangle) return 0;
    const double ra = sqrt(a->distance2), rb = sqrt(b->distance2), h = sqrt(bend);
    const double radius = (0.5 * (ra + rb) + h) * (1.0 + 1e-9);
    int32_t near[SET_ROOM];
    const shape_vector d = shape_sub(q, p);
    const int count = set_gather(scene, index, m, shape_along(p, 0.5, d), radius * radius, near);
    double least = DBL_MAX;
    for (int i = 0; i < count; i++) {
        shape_vector c[3];
        set_corners(scene, mesh, near[i], c);
        const set_nearest at_p = set_triangle(c, p), at_q = set_triangle(c, q);
        const int one = at_p.feature == at_q.feature;
        const double from_p = at_p.distance2 + shape_dot(at_p.away, d),
                     from_q = at_q.distance2 - shape_dot(at_q.away, d);
        const double middle = 0.5 * (from_p + from_q), chord = 0.5 * (at_p.distance2 + at_q.distance2);
        least = kernel_min(least, one ? middle : chord - 0.5 * bend);
        if (one && near[i] == a->triangle && near[i] == b->triangle) *hi = kernel_min(*hi, middle);
    }
    /* not above 0 all along: a solid's inside may lie there */
    if (count > 0 && (least > 0.0 || !mesh->solid)) *lo = kernel_max(*lo, least);
    return 1;
}

/* set_middle for every lane `on`. */
static void set_middles(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                        lane_real start, lane_real end, lane_mask on, const set_near *a, const set_near *b,
                        lane_real *middle_lo, lane_real *middle_hi) {
    const int32_t mesh = scene->shapes[scene->shape[f->element]].mesh;
    LANE_LOOP(l) {
        if (!on[l]) continue;
        shape_vector o, d;
        set_ray(scene, f, r, l, &o, &d);
        const double h = end[l] - start[l], bend = h * h * shape_dot(d, d);
        double lo = (*middle_lo)[l] / f->k, hi = (*middle_hi)[l] / f->k;
        const shape_vector p = shape_along(o, start[l], d), q = shape_along(o, end[l], d);
        if (!set_middle(scene, index, mesh, p, q, &a->of[l], &b->of[l], bend, &lo, &hi)) continue;
        (*middle_lo)[l] = kernel_max((*middle_lo)[l], lo * f->k);
        (*middle_hi)[l] = kernel_min((*middle_hi)[l], hi * f->k);
    }
}

/* The enclosure above for every lane whose interval touches the leaf. */
static void set_ranges(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                       const double *restrict from, const double *restrict to, set_memory *memory,
                       leaf_ranges *restrict q) {
    const lane_real start = lane_load(from), end = lane_load(to), zero = lane_all(0.0);
    const lane_mask touches = (lane_load(f->enter) < end) & (lane_load(f->exit) > start);
    const lane_real h = lane_select(touches, end - start, zero);
    /* where both ends are that far away, all between is beyond the support */
    const double stretch = 2.0 * f->rounding / sqrt(f->k);
    const lane_real limit = (scene->support[f->element] + 0.5 * stretch * h) * (1.0 + 1e-9);
    const set_near a = set_query(scene, index, f, r, start, touches, limit, memory, 0),
                   b = set_query(scene, index, f, r, end, touches, limit, memory, 1);
    const lane_real chord = 0.5 * (a.s + b.s);
    const lane_real bend = f->k * a.speed2 * h * h, speed = lane_sqrt(bend), ra = lane_sqrt(a.s), rb = lane_sqrt(b.s);
    const lane_real near = lane_max(0.5 * (ra + rb - speed), zero), far = 0.5 * (ra + rb + speed);
    const lane_real least = lane_min(a.s, b.s), most = lane_max(a.s, b.s);
    lane_real middle_lo = chord - 0.5 * bend;
    lane_real lo = lane_max(near * near, lane_min(least, middle_lo)), hi = most, middle_hi = chord;
    lane_real slope_lo = a.slope, slope_hi = b.slope;
    if (f->set == SET_CONVEX) {
        /* above both tangents: the value where they meet */
        const lane_real fall = a.slope * h, rise = b.slope * h, turn = rise - fall;
        const lane_mask turns = turn > 0.0;
        const lane_real at = (a.s - b.s + rise) / lane_select(turns, turn, lane_all(1.0));
        const lane_real inner = lane_select(turns, a.s + fall * lane_min(lane_max(at, zero), lane_all(1.0)), zero);
        const lane_real meet = lane_select(a.slope >= 0.0, a.s, lane_select(b.slope <= 0.0, b.s, inner));
        lo = lane_max(lo, meet * (1.0 - 1e-14));
        const lane_mask one = set_over_one(scene, f, &a, &b, touches);
        const lane_real middle = chord + 0.25 * (fall - rise);
        middle_lo = lane_select(one, middle, middle_lo);
        middle_hi = lane_select(one, middle, middle_hi);
    } else {
        const lane_mask moves = h > 0.0;
        const lane_real turn = lane_select(moves, 2.0 * bend / lane_select(moves, h, lane_all(1.0)), zero);
        middle_hi = chord + 0.5 * lane_max(h * (a.slope - b.slope) + bend, zero);
        /* wider ones meet many triangles, and mostly are decided by the bounds above */
        const lane_mask narrow = touches & moves & (64.0 * bend < (ra + rb) * (ra + rb));
        set_middles(scene, index, f, r, start, end, narrow, &a, &b, &middle_lo, &middle_hi);
        lo = lane_max(lo, lane_min(least, middle_lo));
        hi = lane_min(far * far, lane_max(most, middle_hi));
        slope_lo = b.slope - turn;
        slope_hi = a.slope + turn;
    }
    lo = lane_min(lo, least);
    hi = lane_max(hi, most);
    lane_store(q->sa, a.s);
    lane_store(q->sb, b.s);
    lane_store(q->middle_lo, middle_lo);
    lane_store(q->middle_hi, middle_hi);
    lane_store(q->lo, lo);
    lane_store(q->hi, hi);
    lane_store(q->mid, lane_max(lane_min(0.25 * (a.s + b.s) + 0.5 * middle_hi, hi), lo));
    lane_store(q->slope_lo, slope_lo);
    lane_store(q->slope_hi, slope_hi);
}

/* grad s / 2 and s at o + t d. */
static void set_toward(const blob_scene *scene, const blob_index *index, const leaf *f, const packet_rays *restrict r,
                       const double *restrict t, set_memory *memory, double (*restrict toward)[LANES],
                       double *restrict s) {
    const double *m = shape_matrix(scene, &scene->shapes[scene->shape[f->element]]);
    const lane_real at = lane_load(t);
    const lane_mask touches = (lane_load(f->enter) < at) & (lane_load(f->exit) > at);
    const lane_real limit = lane_all(scene->support[f->element] * (1.0 + 1e-9));
    const set_near near = set_query(scene, index, f, r, at, touches, limit, memory, 0);
    const lane_real zero = lane_all(0.0);
    for (int k = 0; k < 3; k++) {
        const lane_real back = f->k * (m[k] * near.away[0] + m[4 + k] * near.away[1] + m[8 + k] * near.away[2]);
        lane_store(toward[k], lane_select(touches, back, zero));
    }
    lane_store(s, near.s);
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
