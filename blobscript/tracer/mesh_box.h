/* mesh_box.h - the field over LANES boxes of one size at a time: proved enclosures of value and gradient.
 *
 * About the middle c of a box, at c + d with |d_i| <= half_i, the squared relative distance of a skeleton is
 *
 *     s(c + d) <= s(c) + grad s . d + k |M d|^2        (any closed set: dist^2 - |x|^2 is concave)
 *     s(c + d) >= s(c) + grad s . d                    (convex sets: dist^2 is convex)
 *
 * and with the lines of kernel.h above and below phi, linear in s, each density lies between two linear
 * functions of d. Sums of those keep what the elements' slopes cancel, so the enclosure of a sum is off by
 * O(half^2) only; max and min are taken of the ranges over the box. Beside them goes the plain enclosure by
 * the ranges of s, which is the better one of large boxes.
 */
#ifndef BLOB_MESH_BOX_H
#define BLOB_MESH_BOX_H

#include "joint.h"
#include "packet.h"

/* LANES boxes of a surface: middles in rays.o (rays without direction), half the sides in `half`. */
typedef struct box_lanes {
    const blob_scene *scene;
    const blob_index *index;
    const blob_surface *surface;
    packet_rays rays;
    double half[3];
    LANE_ALIGN double along[3][LANES]; /* for bounds of the gradient: a direction, of length 1 at most, to take besides
                                          the axes (0: none) */
    int32_t depth;                     /* of the surface's tree */
    int wanted; /* boxes whose bounds of the gradient are wanted, as bits: look closer where nearest points may jump */
} box_lanes;

/* Components of gradients: along the axes and along box_lanes.along. */
enum { BOX_ALONG = 3, BOX_WAYS };

/* One element over the boxes. */
typedef struct box_leaf {
    LANE_ALIGN double s[LANES], lo[LANES], hi[LANES], mid[LANES]; /* s at the middle, its range, a place in it */
    LANE_ALIGN double toward[BOX_WAYS][LANES];                    /* grad s / 2 at the middle */
    double spread;                                                /* k |M d|^2 is at most that */
    LANE_ALIGN double turn[BOX_WAYS][LANES];                      /* how far `toward` may be off in the box */
    double rounding;                                              /* as in leaf */
    int convex;
    int id;
} box_leaf;

/* Bounds of value: constant and slopes of linear functions above and below, and plain ranges. */
typedef struct box_bounds {
    LANE_ALIGN double upper[LANES], upper_slope[3][LANES], lower[LANES], lower_slope[3][LANES];
    LANE_ALIGN double lo[LANES], hi[LANES], magnitude[LANES];
} box_bounds;

/* Ranges of value and gradient. */
typedef struct box_slopes {
    LANE_ALIGN double lo[LANES], hi[LANES], slope_lo[BOX_WAYS][LANES], slope_hi[BOX_WAYS][LANES];
} box_slopes;

/* Memory of one thread for lists of elements. */
typedef struct box_scratch {
    tree_step *steps;
    tree_open *path;
    void *stack;           /* of box_bounds or box_slopes */
    leaf_slopes *children; /* of one joint */
    box_leaf *leaves;      /* of the last list, from bounds of value to those of the gradient; NULL: none are kept */
    size_t step_room, path_room, stack_room, child_room, leaf_room;
} box_scratch;

/* Longer lists are not kept. */
enum { BOX_KEPT = 1024 };

static void box_scratch_free(box_scratch *scratch) {
    free(scratch->steps);
    free(scratch->path);
    free(scratch->stack);
    free(scratch->children);
    free(scratch->leaves);
}

/* ---- one element ------------------------------------------------------------------------------ */

/* Sum of the squares of how far a box reaches along the rows of m. */
static double box_spread(const double *m, const double *half) {
    double sum = 0.0;
    for (int r = 0; r < 3; r++) {
        const double reach = fabs(m[4 * r]) * half[0] + fabs(m[4 * r + 1]) * half[1] + fabs(m[4 * r + 2]) * half[2];
        sum += reach * reach;
    }
    return sum;
}

static void box_point(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    const blob_scene *scene = p->scene;
    const double k = scene->inverse_reach2[e], c[3] = {scene->x[e], scene->y[e], scene->z[e]};
    LANE_SIMD(l) {
        double s = 0.0, lo = 0.0, hi = 0.0;
        for (int i = 0; i < 3; i++) {
            const double away = p->rays.o[i][l] - c[i], size = fabs(away);
            const double near = kernel_max(size - p->half[i], 0.0), far = size + p->half[i];
            f->toward[i][l] = k * away;
            s += away * away, lo += near * near, hi += far * far;
        }
        f->s[l] = k * s, f->lo[l] = k * lo, f->hi[l] = k * hi;
    }
    f->spread = k * (p->half[0] * p->half[0] + p->half[1] * p->half[1] + p->half[2] * p->half[2]);
    f->rounding = 0.5 * sqrt(k);
    f->convex = 1;
}

static void box_point_turn(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    const double k = p->scene->inverse_reach2[e];
    for (int i = 0; i < 3; i++) LANE_SIMD(l) f->turn[i][l] = k * p->half[i];
    LANE_SIMD(l) {
        double along = 0.0, turn = 0.0;
        for (int i = 0; i < 3; i++)
            along += p->along[i][l] * f->toward[i][l], turn += fabs(p->along[i][l]) * p->half[i];
        f->toward[BOX_ALONG][l] = along;
        f->turn[BOX_ALONG][l] = k * turn;
    }
}

/* Nothing is known about the direction of the nearest point of lane l. */
static void box_any_direction(box_leaf *restrict f, int l, double k, double stretch) {
    for (int i = 0; i < BOX_WAYS; i++) f->toward[i][l] = 0.0, f->turn[i][l] = sqrt(k * f->hi[l]) * stretch;
}

/* Most triangles that are asked for their directions. */
enum { BOX_TRIANGLES = 128 };

/* The hull of the directions to all triangles that may be the nearest somewhere in the box of lane l: those whose
 * distance from the middle exceeds the least by no more than the box's diagonal. 0: too many, or a solid at hand. */
static int box_directions(const box_lanes *restrict p, const blob_shape *shape, double k, const double *m, int l,
                          box_leaf *restrict f) {
    const blob_scene *scene = p->scene;
    const blob_mesh *mesh = &scene->meshes[shape->mesh];
    const shape_vector at = shape_map_point(m, (shape_vector){p->rays.o[0][l], p->rays.o[1][l], p->rays.o[2][l]});
    const double radius = sqrt(f->spread / k), near = sqrt(f->s[l] / k);
    if (mesh->solid && near <= radius * (1.0 + 1e-9)) return 0;
    const double limit = (near + 2.0 * radius) * (near + 2.0 * radius) * (1.0 + 1e-9);
    double lo[BOX_WAYS], hi[BOX_WAYS];
    for (int way = 0; way < BOX_WAYS; way++) lo[way] = BLOB_INFINITY, hi[way] = -BLOB_INFINITY;
    struct {
        int32_t child, count;
    } stack[INDEX_STACK];
    int top = 0, seen = 0;
    stack[top].child = p->index->mesh_trees[shape->mesh].root, stack[top++].count = 1;
    while (top > 0) {
        const int32_t child = stack[--top].child, count = stack[top].count;
        if (child >= 0) {
            const index_node *node = &p->index->nodes[child];
            double d2[INDEX_WIDTH];
            set_boxes(p->index, child, at, d2);
            for (int i = 0; i < INDEX_WIDTH; i++)
                if (node->count[i] && d2[i] * (1.0 - 1e-14) <= limit)
                    stack[top].child = node->child[i], stack[top++].count = node->count[i];
            continue;
        }
        for (int32_t i = 0; i < count; i++) {
            shape_vector c[3];
            if (++seen > BOX_TRIANGLES) return 0;
            set_corners(scene, mesh, p->index->mesh_order[~child + i], c);
            const set_nearest one = set_triangle(c, at);
            if (one.distance2 > limit) continue;
            const double v[3] = {one.away.x, one.away.y, one.away.z};
            double toward[BOX_WAYS] = {0.0};
            for (int axis = 0; axis < 3; axis++) {
                toward[axis] = k * (m[axis] * v[0] + m[4 + axis] * v[1] + m[8 + axis] * v[2]);
                toward[BOX_ALONG] += p->along[axis][l] * toward[axis];
            }
            for (int way = 0; way < BOX_WAYS; way++) {
                lo[way] = kernel_min(lo[way], toward[way]);
                hi[way] = kernel_max(hi[way], toward[way]);
            }
        }
    }
    for (int way = 0; way < BOX_WAYS; way++) {
        f->toward[way][l] = 0.5 * (lo[way] + hi[way]);
        f->turn[way][l] += 0.5 * (hi[way] - lo[way]) * (1.0 + 1e-12);
    }
    return lo[0] <= hi[0];
}

/* s and its gradient at the middles, by a query that sees as far as boxes with their middle there reach. */
static void box_toward(const box_lanes *restrict p, const leaf *restrict one, const double *m, box_leaf *restrict f) {
    const lane_real limit = lane_all((p->scene->support[one->element] + sqrt(f->spread / one->k)) * (1.0 + 1e-9));
    const lane_real zero = lane_all(0.0);
    set_memory memory;
    set_forget(&memory);
    const set_near near = set_query(p->scene, p->index, one, &p->rays, zero, zero == zero, limit, &memory, 0);
    for (int k = 0; k < 3; k++) {
        const lane_real toward = m[k] * near.away[0] + m[4 + k] * near.away[1] + m[8 + k] * near.away[2];
        lane_store(f->toward[k], one->k * toward);
    }
    lane_store(f->s, near.s);
}

/* How far `toward` may be off: x less its nearest point of a convex set has a symmetric Jacobian J between 0 and 1, so
 * with v = M u it changes along u by k v J M d, which lies within k (v . M d +- |v| |M d|) / 2. */
static void box_turn(const box_lanes *restrict p, double k, const double *m, double stretch, box_leaf *restrict f) {
    const double root = sqrt(f->spread);
    double square[3][3]; /* M^T M */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) square[i][j] = m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j];
    for (int i = 0; i < 3; i++) {
        double turn = sqrt(k * square[i][i]) * root;
        for (int j = 0; j < 3; j++) turn += k * fabs(square[i][j]) * p->half[j];
        LANE_SIMD(l) f->turn[i][l] = 0.5 * (1.0 + 1e-12) * turn;
    }
    LANE_SIMD(l) {
        double along = 0.0, turn = sqrt(k) * stretch * root;
        for (int i = 0; i < 3; i++) {
            double back = 0.0;
            for (int j = 0; j < 3; j++) back += square[i][j] * p->along[j][l];
            turn += k * fabs(back) * p->half[i];
            along += p->along[i][l] * f->toward[i][l];
        }
        f->toward[BOX_ALONG][l] = along;
        f->turn[BOX_ALONG][l] = 0.5 * (1.0 + 1e-12) * turn;
    }
}

/* Lines, triangles, meshes and whatever has a map: from the nearest point of the middle. */
static void box_shape(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    static const LANE_ALIGN double zero[LANES] = {0.0};
    const blob_scene *scene = p->scene;
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    const double *m = shape_matrix(scene, shape), k = scene->inverse_reach2[e];
    leaf one;
    one.element = e;
    f->spread = k * box_spread(m, p->half);
    if (shape->kind >= SHAPE_TRIANGLE) {
        set_meets(scene, e, &p->rays, zero, zero, &one);
        box_toward(p, &one, m, f);
        f->convex = one.set == SET_CONVEX;
    } else {
        leaf_pieces pieces;
        shape_meets(scene, e, &p->rays, zero, zero, &one, &pieces);
        shape_toward(scene, e, &p->rays, zero, f->toward);
        memcpy(f->s, one.r2, sizeof f->s);
        f->convex = 1;
    }
    f->rounding = one.rounding;
    const double root = sqrt(f->spread);
    LANE_SIMD(l) {
        double along = 0.0;
        for (int i = 0; i < 3; i++) along += 2.0 * fabs(f->toward[i][l]) * p->half[i];
        const double near = kernel_max(sqrt(f->s[l]) - root, 0.0);
        const double below = f->convex ? f->s[l] - along : 0.0;
        const double slack = 1e-13 * (f->s[l] + f->spread);
        f->lo[l] = kernel_max(kernel_max(near * near, below) - slack, 0.0);
        f->hi[l] = f->s[l] + along + f->spread + slack;
    }
}

static void box_shape_turn(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    const blob_shape *shape = &p->scene->shapes[p->scene->shape[e]];
    const double *m = shape_matrix(p->scene, shape), k = p->scene->inverse_reach2[e], stretch = shape_stretch(m);
    box_turn(p, k, m, stretch, f);
    for (int l = 0; l < LANES && !f->convex; l++)
        if (!(p->wanted >> l & 1) || !box_directions(p, shape, k, m, l, f)) box_any_direction(f, l, k, stretch);
}

/* Fills f; a bit for each box that the element matters in. */
static int box_element(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    const blob_scene *scene = p->scene;
    if (!scene->shape || scene->shape[e] < 0) box_point(p, e, f);
    else box_shape(p, e, f);
    const double limit = scene->support[e] * scene->support[e] * scene->inverse_reach2[e] * (1.0 + 1e-12);
    int matters = 0;
    LANE_LOOP(l) matters |= (f->lo[l] < limit) << l;
    LANE_SIMD(l) f->mid[l] = kernel_min(kernel_max(f->s[l], f->lo[l]), f->hi[l]);
    f->id = scene->kernels[scene->kernel[e]].id;
    return matters;
}

/* ---- bounds of value --------------------------------------------------------------------------- */

/* Lines above and below one density over each box: constant and slope in s, plain range, rounding. */
typedef struct box_lines {
    LANE_ALIGN double high[LANES], rise[LANES], low[LANES], fall[LANES], top[LANES], bottom[LANES], magnitude[LANES];
} box_lines;

KERNEL_INLINE void box_fill_lines(int id, const box_lanes *restrict p, int32_t e, const box_leaf *restrict f,
                                  const user_lines *restrict given, box_lines *restrict lines) {
    const blob_scene *scene = p->scene;
    const blob_kernel *kernel = &scene->kernels[scene->kernel[e]];
    const double limit = scene->support[e] * scene->support[e] * scene->inverse_reach2[e], spread = f->spread;
    LANE_SIMD(l) {
        const kernel_lines k =
            given ? leaf_lines_at(given, l) : kernel_bounds(id, scene, kernel, f->lo[l], f->hi[l], f->mid[l]);
        double top, bottom;
        if (given) {
            const double u = f->lo[l], v = f->hi[l];
            top = k.upper_value + kernel_max(k.upper_slope * (u - k.upper_at), k.upper_slope * (v - k.upper_at));
            bottom = k.lower_value + kernel_min(k.lower_slope * (u - k.lower_at), k.lower_slope * (v - k.lower_at));
        } else {
            top = k.upper_value;
            bottom = kernel_value(id, scene, kernel, f->hi[l]).value;
        }
        const double least = kernel_min(bottom, 0.0); /* what is cut off counts as 0 */
        lines->top[l] = top;
        lines->bottom[l] = f->hi[l] >= limit ? least : bottom;
        lines->rise[l] = k.upper_slope, lines->fall[l] = k.lower_slope;
        lines->high[l] =
            k.upper_value + k.upper_slope * (f->s[l] - k.upper_at) + kernel_max(k.upper_slope * spread, 0.0);
        lines->low[l] =
            k.lower_value + k.lower_slope * (f->s[l] - k.lower_at) + kernel_min(k.lower_slope * spread, 0.0);
        lines->magnitude[l] = k.top + k.steep * (leaf_reach_of(id, f->hi[l]) + f->rounding * p->rays.magnitude[l]);
    }
}

KERNEL_INLINE void box_add_bounds(int id, const box_lanes *restrict p, int32_t e, const box_leaf *restrict f,
                                  const user_lines *restrict given, box_bounds *restrict sum) {
    box_lines lines;
    box_fill_lines(id, p, e, f, given, &lines);
    const double w = p->scene->weight[e], size = fabs(w);
    const int falls = w < 0.0;
    const double *top = falls ? lines.bottom : lines.top, *bottom = falls ? lines.top : lines.bottom;
    const double *high = falls ? lines.low : lines.high, *low = falls ? lines.high : lines.low;
    const double *rise = falls ? lines.fall : lines.rise, *fall = falls ? lines.rise : lines.fall;
    if (!f->convex) high = top, low = bottom;
    LANE_SIMD(l) {
        sum->upper[l] += w * high[l], sum->lower[l] += w * low[l];
        sum->hi[l] += w * top[l], sum->lo[l] += w * bottom[l];
        sum->magnitude[l] += size * lines.magnitude[l];
    }
    for (int i = 0; i < 3 && f->convex; i++) {
        LANE_SIMD(l) {
            sum->upper_slope[i][l] += 2.0 * w * rise[l] * f->toward[i][l];
            sum->lower_slope[i][l] += 2.0 * w * fall[l] * f->toward[i][l];
        }
    }
}

#define BOX_CASE(ID, ADD)                                                                                              \
    case ID:                                                                                                           \
        ADD(ID, p, e, f, NULL, sum);                                                                                   \
        break;
#define BOX_BY_KERNEL(NAME, ADD, TYPE)                                                                                 \
    static void NAME(const box_lanes *restrict p, int32_t e, const box_leaf *restrict f, TYPE *restrict sum) {         \
        switch (f->id) {                                                                                               \
            BOX_CASE(KERNEL_SOFT2, ADD)                                                                                \
            BOX_CASE(KERNEL_SOFT3, ADD)                                                                                \
            BOX_CASE(KERNEL_WYVILL, ADD)                                                                               \
            BOX_CASE(KERNEL_GAUSS, ADD)                                                                                \
            BOX_CASE(KERNEL_GAUSS_C1, ADD)                                                                             \
            BOX_CASE(KERNEL_METABALL, ADD)                                                                             \
            default: {                                                                                                 \
                user_lines lines;                                                                                      \
                user_bounds(p->scene, &p->scene->kernels[p->scene->kernel[e]], f->lo, f->hi, f->mid, &lines);          \
                ADD(KERNEL_USER, p, e, f, &lines, sum);                                                                \
            }                                                                                                          \
        }                                                                                                              \
    }

BOX_BY_KERNEL(box_leaf_bounds, box_add_bounds, box_bounds)

/* The range over each box, of what the linear functions and the plain ranges say. */
static void box_close_bounds(const box_lanes *restrict p, box_bounds *restrict b) {
    LANE_SIMD(l) {
        double above = b->upper[l], below = b->lower[l];
        for (int i = 0; i < 3; i++) {
            above += fabs(b->upper_slope[i][l]) * p->half[i];
            below -= fabs(b->lower_slope[i][l]) * p->half[i];
            b->upper_slope[i][l] = b->lower_slope[i][l] = 0.0;
        }
        b->hi[l] = b->upper[l] = kernel_min(b->hi[l], above);
        b->lo[l] = b->lower[l] = kernel_max(b->lo[l], below);
    }
}

static void box_join_bounds(const box_lanes *restrict p, int32_t op, box_bounds *restrict into,
                            box_bounds *restrict child) {
    if (op == OP_SUM) {
        LANE_SIMD(l) {
            into->upper[l] += child->upper[l], into->lower[l] += child->lower[l];
            into->lo[l] += child->lo[l], into->hi[l] += child->hi[l];
            for (int i = 0; i < 3; i++) {
                into->upper_slope[i][l] += child->upper_slope[i][l];
                into->lower_slope[i][l] += child->lower_slope[i][l];
            }
            into->magnitude[l] += child->magnitude[l];
        }
        return;
    }
    box_close_bounds(p, into);
    box_close_bounds(p, child);
    LANE_SIMD(l) {
        const double lo = child->lo[l], hi = child->hi[l];
        into->lo[l] = op == OP_MAX ? kernel_max(into->lo[l], lo) : kernel_min(into->lo[l], lo);
        into->hi[l] = op == OP_MAX ? kernel_max(into->hi[l], hi) : kernel_min(into->hi[l], hi);
        into->lower[l] = into->lo[l];
        into->upper[l] = into->hi[l];
        into->magnitude[l] = kernel_max(into->magnitude[l], child->magnitude[l]);
    }
}

/* ---- bounds of the gradient ------------------------------------------------------------------------ */

KERNEL_INLINE void box_add_slopes(int id, const box_lanes *restrict p, int32_t e, const box_leaf *restrict f,
                                  const user_lines *restrict given, box_slopes *restrict sum) {
    const blob_scene *scene = p->scene;
    const blob_kernel *kernel = &scene->kernels[scene->kernel[e]];
    const double w = scene->weight[e];
    LANE_SIMD(l) {
        double top, bottom, steepest, least;
        if (given) {
            const kernel_lines k = leaf_lines_at(given, l);
            const double u = f->lo[l], v = f->hi[l];
            top = k.upper_value + kernel_max(k.upper_slope * (u - k.upper_at), k.upper_slope * (v - k.upper_at));
            bottom = k.lower_value + kernel_min(k.lower_slope * (u - k.lower_at), k.lower_slope * (v - k.lower_at));
            steepest = given->slope_lo[l], least = given->slope_hi[l];
        } else {
            const kernel_jet lo = kernel_value(id, scene, kernel, f->lo[l]);
            const kernel_jet hi = kernel_value(id, scene, kernel, f->hi[l]);
            top = lo.value, bottom = hi.value, steepest = lo.slope, least = hi.slope;
        }
        sum->lo[l] += w >= 0.0 ? w * bottom : w * top;
        sum->hi[l] += w >= 0.0 ? w * top : w * bottom;
        for (int i = 0; i < BOX_WAYS; i++) {
            const double a = 2.0 * w * (f->toward[i][l] - f->turn[i][l]),
                         b = 2.0 * w * (f->toward[i][l] + f->turn[i][l]);
            const double x0 = steepest * a, x1 = steepest * b, x2 = least * a, x3 = least * b;
            sum->slope_lo[i][l] += kernel_min(kernel_min(x0, x1), kernel_min(x2, x3));
            sum->slope_hi[i][l] += kernel_max(kernel_max(x0, x1), kernel_max(x2, x3));
        }
    }
}

BOX_BY_KERNEL(box_leaf_slopes, box_add_slopes, box_slopes)

static void box_join_slopes(const box_lanes *restrict p, int32_t op, box_slopes *restrict into,
                            const box_slopes *restrict child) {
    (void)p;
    const lane_real m0 = lane_load(into->lo), m1 = lane_load(into->hi);
    const lane_real c0 = lane_load(child->lo), c1 = lane_load(child->hi);
    if (op == OP_SUM) {
        for (int i = 0; i < BOX_WAYS; i++) {
            lane_store(into->slope_lo[i], lane_load(into->slope_lo[i]) + lane_load(child->slope_lo[i]));
            lane_store(into->slope_hi[i], lane_load(into->slope_hi[i]) + lane_load(child->slope_hi[i]));
        }
        lane_store(into->lo, m0 + c0);
        lane_store(into->hi, m1 + c1);
        return;
    }
    const lane_mask mine = op == OP_MAX ? m0 > c1 : m1 < c0, theirs = op == OP_MAX ? c0 > m1 : c1 < m0;
    for (int i = 0; i < BOX_WAYS; i++) {
        const lane_real a = lane_load(into->slope_lo[i]), b = lane_load(into->slope_hi[i]);
        const lane_real c = lane_load(child->slope_lo[i]), d = lane_load(child->slope_hi[i]);
        lane_store(into->slope_lo[i], lane_select(mine, a, lane_select(theirs, c, lane_min(a, c))));
        lane_store(into->slope_hi[i], lane_select(mine, b, lane_select(theirs, d, lane_max(b, d))));
    }
    lane_store(into->lo, op == OP_MAX ? lane_max(m0, c0) : lane_min(m0, c0));
    lane_store(into->hi, op == OP_MAX ? lane_max(m1, c1) : lane_min(m1, c1));
}

/* ---- smooth maxima (joint.h) ------------------------------------------------------------------------- */

static void box_joint_bounds(const box_lanes *restrict p, leaf_slopes *restrict of, int32_t op, int32_t count,
                             box_bounds *restrict children) {
    for (int32_t i = 0; i < count; i++) {
        box_close_bounds(p, &children[i]);
        LANE_CLEAR(&of[i]);
        memcpy(of[i].value_lo, children[i].lo, sizeof of[i].value_lo);
        memcpy(of[i].value_hi, children[i].hi, sizeof of[i].value_hi);
    }
    const double sense = joint_sense(op);
    const joint_whole all = joint_survey(of, count, sense);
    box_bounds *into = &children[0];
    lane_real magnitude = all.value.hi;
    for (int32_t i = 0; i < count; i++) magnitude += JOINT_STEEPEST * lane_load(children[i].magnitude);
    LANE_CLEAR(into);
    lane_store(into->lo, sense > 0.0 ? all.value.lo : -all.value.hi);
    lane_store(into->hi, sense > 0.0 ? all.value.hi : -all.value.lo);
    memcpy(into->lower, into->lo, sizeof into->lower);
    memcpy(into->upper, into->hi, sizeof into->upper);
    lane_store(into->magnitude, magnitude);
}

static void box_joint_slopes(const box_lanes *restrict p, leaf_slopes *restrict of, int32_t op, int32_t count,
                             box_slopes *restrict children) {
    (void)p;
    for (int32_t i = 0; i < count; i++) {
        LANE_CLEAR(&of[i]);
        memcpy(of[i].value_lo, children[i].lo, sizeof of[i].value_lo);
        memcpy(of[i].value_hi, children[i].hi, sizeof of[i].value_hi);
    }
    const double sense = joint_sense(op);
    const joint_whole all = joint_survey(of, count, sense);
    lane_real lo[BOX_WAYS], hi[BOX_WAYS];
    for (int k = 0; k < BOX_WAYS; k++) lo[k] = hi[k] = lane_all(0.0);
    for (int32_t i = 0; i < count; i++) {
        const joint_range rate = joint_rate(&all, joint_child(&of[i], sense));
        for (int k = 0; k < BOX_WAYS; k++) {
            const lane_real a = lane_load(children[i].slope_lo[k]), b = lane_load(children[i].slope_hi[k]);
            const lane_real x0 = rate.lo * a, x1 = rate.lo * b, x2 = rate.hi * a, x3 = rate.hi * b;
            lo[k] += lane_min(lane_min(x0, x1), lane_min(x2, x3));
            hi[k] += lane_max(lane_max(x0, x1), lane_max(x2, x3));
        }
    }
    box_slopes *into = &children[0];
    lane_store(into->lo, sense > 0.0 ? all.value.lo : -all.value.hi);
    lane_store(into->hi, sense > 0.0 ? all.value.hi : -all.value.lo);
    for (int k = 0; k < BOX_WAYS; k++) lane_store(into->slope_lo[k], lo[k]), lane_store(into->slope_hi[k], hi[k]);
}

/* ---- the whole field ---------------------------------------------------------------------------------- */

/* Keeps what is computed of the elements of the next list. 0 when memory has run out. */
static int box_keep(box_scratch *scratch, size_t count) {
    if (count > BOX_KEPT) {
        free(scratch->leaves);
        scratch->leaves = NULL, scratch->leaf_room = 0;
        return 1;
    }
    if (count <= scratch->leaf_room) return 1;
    box_leaf *fresh = aligned_alloc(64, BOX_KEPT * sizeof *fresh);
    if (!fresh) return 0;
    scratch->leaves = fresh, scratch->leaf_room = BOX_KEPT;
    return 1;
}

/* The walk through the tree for elements ids[0..count), in ascending order. 0 when memory has run out. */
static int box_plan(const box_lanes *p, box_scratch *scratch, const int32_t *ids, size_t count, size_t *step_count) {
    *step_count = 0;
    if (p->depth == 0) return 1;
    const size_t room = tree_plan_room(count, p->depth + 1, p->surface->node_end - p->surface->node_begin);
    tree_step *steps = packet_grown(scratch->steps, &scratch->step_room, room, sizeof *steps);
    if (!steps) return 0;
    scratch->steps = steps;
    tree_open *path = packet_grown(scratch->path, &scratch->path_room, (size_t)p->depth, sizeof *path);
    if (!path) return 0;
    scratch->path = path;
    *step_count = tree_plan_of(p->scene, ids, sizeof *ids, NULL, count, path, steps);
    const size_t deep = tree_stack_room(steps, *step_count, p->depth);
    const size_t widest = sizeof(box_bounds) > sizeof(box_slopes) ? sizeof(box_bounds) : sizeof(box_slopes);
    void *stack = packet_grown(scratch->stack, &scratch->stack_room, deep, widest);
    if (!stack) return 0;
    scratch->stack = stack;
    leaf_slopes *children = packet_grown(scratch->children, &scratch->child_room, deep, sizeof *children);
    if (!children) return 0;
    scratch->children = children;
    return 1;
}

/* What bounds of the gradient need besides. */
static void box_element_turn(const box_lanes *restrict p, int32_t e, box_leaf *restrict f) {
    if (!p->scene->shape || p->scene->shape[e] < 0) box_point_turn(p, e, f);
    else box_shape_turn(p, e, f);
}

/* Element number i of a list, for bounds of value. */
static int box_take(const box_lanes *restrict p, const box_scratch *restrict scratch, int32_t e, size_t i,
                    uint8_t *restrict matters, box_leaf *restrict f) {
    matters[i] = (uint8_t)box_element(p, e, f);
    if (matters[i] && scratch->leaves) scratch->leaves[i] = *f;
    return matters[i];
}

/* ... and, after those, of the gradient. */
static int box_take_turn(const box_lanes *restrict p, const box_scratch *restrict scratch, int32_t e, size_t i,
                         uint8_t *restrict matters, box_leaf *restrict f) {
    if (!matters[i]) return 0;
    if (scratch->leaves) *f = scratch->leaves[i];
    else box_element(p, e, f);
    box_element_turn(p, e, f);
    return 1;
}

/* Over the elements ids; matters: for each, a bit for each box it matters in, which bounds of value tell. Children of a
 * smooth maximum stay on the stack until STEP_JOINT. */
#define BOX_EVALUATE(NAME, TYPE, TAKE, LEAF, JOIN, JOINT)                                                              \
    static void NAME(const box_lanes *restrict p, const box_scratch *restrict scratch, const int32_t *restrict ids,    \
                     size_t count, size_t step_count, uint8_t *restrict matters, TYPE *restrict result) {              \
        LANE_CLEAR(result);                                                                                            \
        box_leaf f;                                                                                                    \
        if (p->depth == 0) {                                                                                           \
            for (size_t i = 0; i < count; i++) {                                                                       \
                if (TAKE(p, scratch, ids[i], i, matters, &f)) LEAF(p, ids[i], &f, result);                             \
            }                                                                                                          \
            return;                                                                                                    \
        }                                                                                                              \
        TYPE *stack = scratch->stack;                                                                                  \
        int top = -1;                                                                                                  \
        for (size_t i = 0; i < step_count; i++) {                                                                      \
            const tree_step *step = &scratch->steps[i];                                                                \
            TYPE child;                                                                                                \
            if (step->what == STEP_OPEN) {                                                                             \
                if (!tree_is_joint(step->op)) {                                                                        \
                    top++;                                                                                             \
                    LANE_CLEAR(&stack[top]);                                                                           \
                }                                                                                                      \
                continue;                                                                                              \
            }                                                                                                          \
            if (step->what == STEP_JOINT) {                                                                            \
                top -= step->leaf - 1;                                                                                 \
                JOINT(p, scratch->children, step->op, step->leaf, &stack[top]);                                        \
                continue;                                                                                              \
            }                                                                                                          \
            if (step->what == STEP_CLOSE) {                                                                            \
                if (tree_is_joint(step->op)) continue;                                                                 \
                top--;                                                                                                 \
                if (step->set) stack[top] = stack[top + 1];                                                            \
                else JOIN(p, step->op, &stack[top], &stack[top + 1]);                                                  \
                continue;                                                                                              \
            }                                                                                                          \
            LANE_CLEAR(&child);                                                                                        \
            if (step->what == STEP_LEAF) {                                                                             \
                const int32_t e = ids[step->leaf];                                                                     \
                if (TAKE(p, scratch, e, (size_t)step->leaf, matters, &f)) LEAF(p, e, &f, &child);                      \
            }                                                                                                          \
            if (tree_is_joint(step->op)) stack[++top] = child;                                                         \
            else if (step->set) stack[top] = child;                                                                    \
            else JOIN(p, step->op, &stack[top], &child);                                                               \
        }                                                                                                              \
        if (top >= 0) *result = stack[0];                                                                              \
    }

BOX_EVALUATE(box_bounds_of, box_bounds, box_take, box_leaf_bounds, box_join_bounds, box_joint_bounds)
BOX_EVALUATE(box_slopes_of, box_slopes, box_take_turn, box_leaf_slopes, box_join_slopes, box_joint_slopes)

#endif
