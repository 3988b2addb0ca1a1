/* packet.h - LANES rays against one surface: the leaves they meet so far, and the field along them. */
#ifndef BLOB_PACKET_H
#define BLOB_PACKET_H

#include <stdlib.h>

#include "bernstein.h"
#include "index.h"
#include "joint.h"
#include "set.h"
#include "shape.h"
#include "tree.h"

/* Scratch memory of one thread; grows as needed and is reused from packet to packet. */
typedef struct packet_scratch {
    leaf *leaves;
    leaf_pieces *pieces;
    set_memory *memories; /* of meshes */
    size_t memory_room;
    int32_t *order; /* leaves in the order of the tree (trees only) */
    tree_step *steps;
    tree_open *path;
    void *stack; /* tree_stack_room of what is evaluated: bernstein_bounds at most */
    void *inner; /* the same of leaf_slopes, from which bounds of smooth nodes are made */
    size_t leaf_room, piece_room, order_room, step_room, path_room, stack_room, inner_room;
} packet_scratch;

typedef struct packet {
    const blob_scene *scene;
    const blob_index *index; /* for nearest points of meshes */
    const blob_surface *surface;
    packet_scratch *scratch;
    packet_rays rays;
    size_t leaf_count, piece_count, memory_count, step_count;
    int32_t depth; /* of the surface's tree; 0: one sum, no walk needed */
    int out_of_memory;
    LANE_ALIGN double t[LANES], end[LANES]; /* still to be searched: (t, end] */
} packet;

static void *packet_grown(void *old, size_t *room, size_t need, size_t size) {
    if (need <= *room) return old;
    size_t bigger = *room * 2 > need ? *room * 2 : need;
    if (bigger < 64) bigger = 64;
    void *fresh = aligned_alloc(64, (bigger * size + 63) / 64 * 64);
    if (!fresh) return NULL;
    if (old) memcpy(fresh, old, *room * size);
    free(old);
    *room = bigger;
    return fresh;
}

static void packet_scratch_free(packet_scratch *scratch) {
    free(scratch->leaves);
    free(scratch->pieces);
    free(scratch->memories);
    free(scratch->order);
    free(scratch->steps);
    free(scratch->path);
    free(scratch->stack);
    free(scratch->inner);
}

/* Room for one more leaf with pieces; 0 when memory has run out. */
static int packet_reserve(packet *restrict p) {
    packet_scratch *s = p->scratch;
    if (p->leaf_count + 1 > s->leaf_room) {
        leaf *leaves = packet_grown(s->leaves, &s->leaf_room, p->leaf_count + 1, sizeof *leaves);
        if (!leaves) return 0;
        s->leaves = leaves;
    }
    if (p->piece_count + 1 > s->piece_room) {
        leaf_pieces *pieces = packet_grown(s->pieces, &s->piece_room, p->piece_count + 1, sizeof *pieces);
        if (!pieces) return 0;
        s->pieces = pieces;
    }
    if (p->memory_count + 1 > s->memory_room) {
        set_memory *memories = packet_grown(s->memories, &s->memory_room, p->memory_count + 1, sizeof *memories);
        if (!memories) return 0;
        s->memories = memories;
    }
    return 1;
}

/* Does any ray of the packet meet this leaf between a and b? */
KERNEL_INLINE int packet_touches(const leaf *restrict f, const double *restrict a, const double *restrict b) {
    return lane_any((lane_load(f->enter) < lane_load(b)) & (lane_load(f->exit) > lane_load(a)));
}

/* Closest approach of each ray to element e, and where it is within reach; 1 if any ray is in its window. */
static int packet_add(packet *restrict p, int32_t e) {
    const blob_scene *scene = p->scene;
    const int32_t shape = scene->shape ? scene->shape[e] : -1;
    if (!packet_reserve(p)) {
        p->out_of_memory = 1;
        return 0;
    }
    leaf *restrict f = &p->scratch->leaves[p->leaf_count];
    int any = 0;
    if (shape < 0) {
        const double cx = scene->x[e], cy = scene->y[e], cz = scene->z[e];
        const double support = scene->support[e], support2 = support * support, k = scene->inverse_reach2[e];
        const packet_rays *restrict r = &p->rays;
        LANE_ALIGN double rho2[LANES];
        LANE_SIMD(l) {
            const double x = cx - r->o[0][l], y = cy - r->o[1][l], z = cz - r->o[2][l];
            const double tau = x * r->d[0][l] + y * r->d[1][l] + z * r->d[2][l];
            const double px = x - tau * r->d[0][l], py = y - tau * r->d[1][l], pz = z - tau * r->d[2][l];
            rho2[l] = px * px + py * py + pz * pz;
            f->tau[l] = tau;
        }
        const lane_real inside = support2 - lane_load(rho2), tau = lane_load(f->tau);
        const lane_mask meets = inside > 0.0;
        if (!lane_any(meets)) return 0;
        const lane_real half =
            lane_sqrt(lane_select(meets, inside, lane_all(0.0))) * (1.0 + 1e-12) + 1e-14 * lane_load(r->magnitude);
        lane_store(f->r2, lane_load(rho2) * k);
        lane_store(f->enter, lane_select(meets, tau - half, lane_all(BLOB_INFINITY)));
        lane_store(f->exit, lane_select(meets, tau + half, lane_all(-BLOB_INFINITY)));
        any = packet_touches(f, p->t, p->end);
        f->k = k;
        f->pieces = -1;
        f->set = SET_NONE;
        f->rounding = 0.5 * sqrt(k);
    } else if (scene->shapes[shape].kind >= SHAPE_TRIANGLE) {
        any = set_meets(scene, e, &p->rays, p->t, p->end, f);
        f->pieces = -1;
    } else {
        f->set = SET_NONE;
        any = shape_meets(scene, e, &p->rays, p->t, p->end, f, &p->scratch->pieces[p->piece_count]);
        f->pieces = (int32_t)p->piece_count;
    }
    if (!any) return 0;
    f->weight = scene->weight[e];
    f->kernel = scene->kernel[e];
    f->id = scene->kernels[f->kernel].id;
    f->element = e;
    p->leaf_count++;
    if (f->pieces >= 0) p->piece_count++;
    f->memory = -1;
    if (shape >= 0 && scene->shapes[shape].kind == SHAPE_MESH) {
        f->memory = (int32_t)p->memory_count++;
        set_forget(&p->scratch->memories[f->memory]);
    }
    return 1;
}

/* Forget leaves that every ray has left behind (pieces stay where they are). */
static void packet_forget(packet *restrict p) {
    leaf *leaves = p->scratch->leaves;
    const lane_real t = lane_load(p->t);
    const lane_mask ahead = t < lane_load(p->end);
    size_t kept = 0;
    for (size_t i = 0; i < p->leaf_count; i++) {
        if (!lane_any((lane_load(leaves[i].exit) > t) & ahead)) continue;
        if (kept != i) leaves[kept] = leaves[i];
        kept++;
    }
    p->leaf_count = kept;
}

/* Leaves are appended in the order they are found; a tree wants them in its own. */
static int packet_compare(const leaf *leaves, int32_t a, int32_t b) { return leaves[a].element < leaves[b].element; }

/* Shell sort: short lists, no allocation, no callback. */
static void packet_sort(const leaf *leaves, int32_t *order, size_t count) {
    static const size_t gaps[] = {88573, 29524, 9841, 3280, 1093, 364, 121, 40, 13, 4, 1};
    for (size_t g = 0; g < sizeof gaps / sizeof *gaps; g++) {
        const size_t gap = gaps[g];
        for (size_t i = gap; i < count; i++) {
            const int32_t item = order[i];
            size_t j = i;
            for (; j >= gap && packet_compare(leaves, item, order[j - gap]); j -= gap) order[j] = order[j - gap];
            order[j] = item;
        }
    }
}

/* After leaves were added or forgotten. 0 when memory has run out. */
static int packet_plan(packet *restrict p) {
    if (p->depth == 0) return 1;
    packet_scratch *s = p->scratch;
    int32_t *order = packet_grown(s->order, &s->order_room, p->leaf_count + 1, sizeof *order);
    if (!order) return 0;
    s->order = order;
    const int32_t nodes = p->surface->node_end - p->surface->node_begin;
    const size_t room = tree_plan_room(p->leaf_count, p->depth + 1, nodes);
    tree_step *steps = packet_grown(s->steps, &s->step_room, room, sizeof *steps);
    if (!steps) return 0;
    s->steps = steps;
    tree_open *path = packet_grown(s->path, &s->path_room, (size_t)p->depth, sizeof *path);
    if (!path) return 0;
    s->path = path;
    for (size_t i = 0; i < p->leaf_count; i++) order[i] = (int32_t)i;
    packet_sort(s->leaves, order, p->leaf_count);
    p->step_count = tree_plan(p->scene, s->leaves, order, p->leaf_count, path, steps);
    const size_t stack_room = tree_stack_room(steps, p->step_count, p->depth);
    void *stack = packet_grown(s->stack, &s->stack_room, stack_room, sizeof(bernstein_bounds)); /* the widest */
    if (!stack) return 0;
    s->stack = stack;
    void *inner = packet_grown(s->inner, &s->inner_room, stack_room, sizeof(leaf_slopes));
    if (!inner) return 0;
    s->inner = inner;
    return 1;
}

static set_memory *packet_memory(const packet *restrict p, const leaf *restrict f) {
    return f->memory >= 0 ? &p->scratch->memories[f->memory] : NULL;
}

/* The kernel is constant in each case, so that its formulas are inlined into the loop over lanes. */
#define PACKET_CASE(ID, ADD, given, pieces)                                                                            \
    case ID:                                                                                                           \
        ADD(ID, p->scene, &p->rays, f, pieces, given, a, b, sum);                                                      \
        break;
#define PACKET_BY_KERNEL(ADD, given, pieces)                                                                           \
    switch (f->id) {                                                                                                   \
        PACKET_CASE(KERNEL_SOFT2, ADD, given, pieces)                                                                  \
        PACKET_CASE(KERNEL_SOFT3, ADD, given, pieces)                                                                  \
        PACKET_CASE(KERNEL_WYVILL, ADD, given, pieces)                                                                 \
        PACKET_CASE(KERNEL_GAUSS, ADD, given, pieces)                                                                  \
        PACKET_CASE(KERNEL_GAUSS_C1, ADD, given, pieces)                                                               \
        PACKET_CASE(KERNEL_METABALL, ADD, given, pieces)                                                               \
        default: break;                                                                                                \
    }

/* Ranges and lines of leaves for which there are no inlined formulas. */
static leaf_given packet_given(const packet *restrict p, const leaf *restrict f, const double *restrict a,
                               const double *restrict b, leaf_ranges *restrict ranges, user_lines *restrict lines) {
    if (f->set != SET_NONE) set_ranges(p->scene, p->index, f, &p->rays, a, b, packet_memory(p, f), ranges);
    else leaf_fill_ranges(f, f->pieces >= 0 ? &p->scratch->pieces[f->pieces] : NULL, a, b, ranges);
    if (f->id != KERNEL_USER) return (leaf_given){ranges, NULL};
    user_bounds(p->scene, &p->scene->kernels[f->kernel], ranges->lo, ranges->hi, ranges->mid, lines);
    return (leaf_given){ranges, lines};
}

#define PACKET_LEAF(NAME, ADD, TYPE)                                                                                   \
    static void NAME(const packet *restrict p, const leaf *restrict f, const double *restrict a,                       \
                     const double *restrict b, TYPE *restrict sum) {                                                   \
        const leaf_given none = {NULL, NULL};                                                                          \
        if (f->set != SET_NONE || f->id == KERNEL_USER) {                                                              \
            leaf_ranges ranges;                                                                                        \
            user_lines lines;                                                                                          \
            const leaf_given given = packet_given(p, f, a, b, &ranges, &lines);                                        \
            if (given.lines) ADD(KERNEL_USER, p->scene, &p->rays, f, NULL, given, a, b, sum);                          \
            else PACKET_BY_KERNEL(ADD, ((leaf_given){&ranges, NULL}), NULL)                                            \
        } else if (f->pieces >= 0) {                                                                                   \
            const leaf_pieces *pieces = &p->scratch->pieces[f->pieces];                                                \
            PACKET_BY_KERNEL(ADD, none, pieces)                                                                        \
        } else {                                                                                                       \
            PACKET_BY_KERNEL(ADD, none, NULL)                                                                          \
        }                                                                                                              \
    }

PACKET_LEAF(packet_leaf_bounds, leaf_add_bounds, leaf_bounds)
PACKET_LEAF(packet_leaf_slopes, leaf_add_slopes, leaf_slopes)

/* Value and gradient of one leaf at t. */
KERNEL_INLINE void packet_point_of(int id, const packet *restrict p, const leaf *restrict f,
                                   const leaf_pieces *restrict pieces, const double *restrict t,
                                   leaf_point *restrict sum) {
    const blob_scene *scene = p->scene;
    const blob_kernel *kernel = &scene->kernels[f->kernel];
    const packet_rays *restrict r = &p->rays;
    const double w = f->weight, size = fabs(w);
    LANE_ALIGN double toward[3][LANES]; /* grad s / 2 = (P - nearest) / R^2, in packed coordinates */
    LANE_ALIGN double given[LANES];
    if (f->set != SET_NONE) {
        set_toward(scene, p->index, f, r, t, packet_memory(p, f), toward, given);
    } else if (pieces) {
        shape_toward(scene, f->element, r, t, toward);
    } else {
        const double c[3] = {scene->x[f->element], scene->y[f->element], scene->z[f->element]};
        for (int i = 0; i < 3; i++) LANE_SIMD(l) toward[i][l] = f->k * (r->o[i][l] + t[l] * r->d[i][l] - c[i]);
    }
    const double rounding = f->rounding;
    if (f->set == SET_NONE) {
        LANE_SIMD(l) {
            double slope;
            leaf_distance(f, pieces, l, t[l], &given[l], &slope);
        }
    }
    user_jet user = {0};
    LANE_ALIGN double values[LANES], slopes[LANES];
    if (id == KERNEL_USER) {
        user = user_at(scene, kernel, lane_load(given));
        lane_store(values, user.value);
        lane_store(slopes, user.slope);
    }
    LANE_SIMD(l) {
        const double s = given[l];
        const kernel_jet jet =
            id == KERNEL_USER ? (kernel_jet){values[l], slopes[l]} : kernel_value(id, scene, kernel, s);
        const double g = 2.0 * w * jet.slope;
        sum->value[l] += w * jet.value;
        sum->gradient[0][l] += g * toward[0][l];
        sum->gradient[1][l] += g * toward[1][l];
        sum->gradient[2][l] += g * toward[2][l];
        sum->magnitude[l] +=
            size * (fabs(jet.value) + fabs(jet.slope) * (leaf_reach_of(id, s) + rounding * r->magnitude[l]));
    }
}

static void packet_leaf_point(const packet *restrict p, const leaf *restrict f, const double *restrict t,
                              leaf_point *restrict sum) {
    const leaf_pieces *pieces = f->pieces >= 0 ? &p->scratch->pieces[f->pieces] : NULL;
#define PACKET_POINT_CASE(ID)                                                                                          \
    case ID: packet_point_of(ID, p, f, pieces, t, sum); break;
    switch (f->id) {
        PACKET_POINT_CASE(KERNEL_SOFT2)
        PACKET_POINT_CASE(KERNEL_SOFT3)
        PACKET_POINT_CASE(KERNEL_WYVILL)
        PACKET_POINT_CASE(KERNEL_GAUSS)
        PACKET_POINT_CASE(KERNEL_GAUSS_C1)
        PACKET_POINT_CASE(KERNEL_METABALL)
        default: packet_point_of(KERNEL_USER, p, f, pieces, t, sum); break;
    }
#undef PACKET_POINT_CASE
}

/* Longer sums are sums of halves: the rounding error of a plain sum grows with its length, the bound on it does not. */
enum { PACKET_PLAIN = 64 };

/* The three evaluations differ in content only: TYPE, its leaf function, and its join. What that does with smooth
 * nodes is told by JOIN_open, which tells such a node as a whole, if it can, else by JOIN_joint of its children. */
#define PACKET_SUM(NAME, TYPE, LEAF, JOIN)                                                                             \
    /* adds leaves [first, last), those of steps if there are any; more than PACKET_PLAIN by halves */                 \
    static void NAME##_sum(const packet *restrict p, const tree_step *restrict steps, const double *restrict a,        \
                           const double *restrict b, size_t first, size_t last, TYPE *restrict result) {               \
        if (last - first > PACKET_PLAIN) {                                                                             \
            const size_t middle = first + (last - first) / 2;                                                          \
            TYPE rest;                                                                                                 \
            LANE_CLEAR(&rest);                                                                                         \
            NAME##_sum(p, steps, a, b, first, middle, result);                                                         \
            NAME##_sum(p, steps, a, b, middle, last, &rest);                                                           \
            JOIN(OP_SUM, result, &rest);                                                                               \
            return;                                                                                                    \
        }                                                                                                              \
        for (size_t i = first; i < last; i++) {                                                                        \
            const leaf *f = &p->scratch->leaves[steps ? (size_t)steps[i].leaf : i];                                    \
            if (packet_touches(f, a, b)) LEAF(p, f, a, b, result);                                                     \
        }                                                                                                              \
    }
#define PACKET_STEPS(NAME, TYPE, LEAF, JOIN)                                                                           \
    /* steps [first, last); the result is left at the bottom of the stack. -1: there is none */                        \
    static int NAME##_steps(const packet *restrict p, const double *restrict a, const double *restrict b,              \
                            size_t first, size_t last, TYPE *stack) {                                                  \
        const leaf *leaves = p->scratch->leaves;                                                                       \
        int top = -1;                                                                                                  \
        for (size_t i = first; i < last; i++) {                                                                        \
            const tree_step *step = &p->scratch->steps[i];                                                             \
            TYPE child;                                                                                                \
            switch (step->what) {                                                                                      \
                case STEP_OPEN:                                                                                        \
                    top++;                                                                                             \
                    LANE_CLEAR(&stack[top]);                                                                           \
                    if (tree_is_joint(step->op) && JOIN##_open(p, i, a, b, &stack[top])) i = (size_t)step->leaf;       \
                    continue;                                                                                          \
                case STEP_CLOSE:                                                                                       \
                    if (tree_is_joint(step->op)) continue; /* waits for its joint */                                   \
                    top--;                                                                                             \
                    if (step->set) stack[top] = stack[top + 1];                                                        \
                    else JOIN(step->op, &stack[top], &stack[top + 1]);                                                 \
                    continue;                                                                                          \
                case STEP_JOINT:                                                                                       \
                    top -= step->leaf;                                                                                 \
                    JOIN##_joint(step->op, &stack[top + 1], step->leaf, a, b, &stack[top]);                            \
                    continue;                                                                                          \
                case STEP_LEAF: {                                                                                      \
                    if (step->op == OP_SUM) {                                                                          \
                        const size_t end = tree_run(p->scratch->steps, i, last);                                       \
                        NAME##_sum(p, p->scratch->steps, a, b, i, end, &stack[top]);                                   \
                        i = end - 1;                                                                                   \
                        continue;                                                                                      \
                    }                                                                                                  \
                    const leaf *f = &leaves[step->leaf];                                                               \
                    const int touches = packet_touches(f, a, b);                                                       \
                    if (tree_is_joint(step->op)) {                                                                     \
                        top++;                                                                                         \
                        LANE_CLEAR(&stack[top]);                                                                       \
                    }                                                                                                  \
                    if (step->set || tree_is_joint(step->op)) {                                                        \
                        if (touches) LEAF(p, f, a, b, &stack[top]);                                                    \
                        continue;                                                                                      \
                    }                                                                                                  \
                    LANE_CLEAR(&child);                                                                                \
                    if (touches) LEAF(p, f, a, b, &child);                                                             \
                    break;                                                                                             \
                }                                                                                                      \
                default: LANE_CLEAR(&child); break; /* STEP_ZERO */                                                    \
            }                                                                                                          \
            JOIN(step->op, &stack[top], &child);                                                                       \
        }                                                                                                              \
        return top;                                                                                                    \
    }
#define PACKET_EVALUATE(NAME, TYPE)                                                                                    \
    static void NAME(const packet *restrict p, const double *restrict a, const double *restrict b,                     \
                     TYPE *restrict result) {                                                                          \
        LANE_CLEAR(result);                                                                                            \
        if (p->depth == 0) NAME##_sum(p, NULL, a, b, 0, p->leaf_count, result);                                        \
        else if (NAME##_steps(p, a, b, 0, p->step_count, p->scratch->stack) >= 0)                                      \
            *result = *(const TYPE *)p->scratch->stack;                                                                \
    }

/* Slopes and points of smooth nodes are made of those of their children. */
#define tree_join_slopes_open(p, first, a, b, into) 0
#define tree_join_slopes_joint joint_slopes
#define tree_join_point_open(p, first, a, b, into) 0
#define tree_join_point_joint(op, children, count, a, b, into) joint_point(op, children, count, into)
#define PACKET_POINT(p, f, a, b, sum) packet_leaf_point(p, f, a, sum)
PACKET_SUM(packet_slopes, leaf_slopes, packet_leaf_slopes, tree_join_slopes)
PACKET_STEPS(packet_slopes, leaf_slopes, packet_leaf_slopes, tree_join_slopes)
PACKET_EVALUATE(packet_slopes, leaf_slopes)
PACKET_SUM(packet_point_on, leaf_point, PACKET_POINT, tree_join_point)
PACKET_STEPS(packet_point_on, leaf_point, PACKET_POINT, tree_join_point)
PACKET_EVALUATE(packet_point_on, leaf_point)

/* Bounds of the smooth node that step `first` opens, by the slopes of all below it. */
static int tree_join_bounds_open(const packet *restrict p, size_t first, const double *restrict a,
                                 const double *restrict b, leaf_bounds *restrict into) {
    leaf_slopes *stack = p->scratch->inner;
    packet_slopes_steps(p, a, b, first, (size_t)p->scratch->steps[first].leaf + 1, stack);
    joint_bounds(&stack[0], a, b, into);
    return 1;
}
#define tree_join_bounds_joint(op, children, count, a, b, into) (void)0
PACKET_SUM(packet_bounds, leaf_bounds, packet_leaf_bounds, tree_join_bounds)
PACKET_STEPS(packet_bounds, leaf_bounds, packet_leaf_bounds, tree_join_bounds)
PACKET_EVALUATE(packet_bounds, leaf_bounds)
static void packet_point(const packet *restrict p, const double *restrict t, leaf_point *restrict result) {
    packet_point_on(p, t, t, result);
}
#endif
