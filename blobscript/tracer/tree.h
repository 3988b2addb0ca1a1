/* tree.h - sums, maxima and minima of what the elements contribute.
 *
 * The leaves of a packet stand in the order of the surface's tree (depth first), so one walk with a
 * stack of open nodes combines them. What a node's absent children contribute is 0, which takes part in
 * max and min.
 *
 *   bounds   sum: coefficients add. max, above: the larger coefficient each; below: the child that is
 *            larger in the middle (min: mirrored)
 *   slopes   max: [max lo, max hi]; slope: hull over the children that can be the largest somewhere
 *   points   max: the larger value with its gradient
 *
 * Smooth maxima: joint.h.
 */
#ifndef BLOB_TREE_H
#define BLOB_TREE_H

#include "leaf.h"

KERNEL_INLINE double tree_middle(double c0, double c1, double c2) { return 0.25 * (c0 + c2) + 0.5 * c1; }

static void tree_join_bounds(int32_t op, leaf_bounds *restrict into, const leaf_bounds *restrict child) {
    if (op == OP_SUM) {
        LANE_SIMD(l) {
            for (int i = 0; i < 3; i++)
                into->upper[i][l] += child->upper[i][l], into->lower[i][l] += child->lower[i][l];
            into->magnitude[l] += child->magnitude[l];
        }
        return;
    }
    /* min is max with the roles of upper and lower, and the sense of comparisons, exchanged */
    double(*restrict hull)[LANES] = op == OP_MAX ? into->upper : into->lower;
    double(*restrict pick)[LANES] = op == OP_MAX ? into->lower : into->upper;
    const double(*restrict child_hull)[LANES] = op == OP_MAX ? child->upper : child->lower;
    const double(*restrict child_pick)[LANES] = op == OP_MAX ? child->lower : child->upper;
    const double sense = op == OP_MAX ? 1.0 : -1.0;
    LANE_SIMD(l) {
        for (int i = 0; i < 3; i++) {
            const double mine = hull[i][l], theirs = child_hull[i][l];
            hull[i][l] = sense * theirs > sense * mine ? theirs : mine;
        }
        const double mine = tree_middle(pick[0][l], pick[1][l], pick[2][l]);
        const double theirs = tree_middle(child_pick[0][l], child_pick[1][l], child_pick[2][l]);
        const int take = sense * theirs > sense * mine;
        for (int i = 0; i < 3; i++) pick[i][l] = take ? child_pick[i][l] : pick[i][l];
        into->magnitude[l] = kernel_max(into->magnitude[l], child->magnitude[l]);
    }
}

static void tree_join_slopes(int32_t op, leaf_slopes *restrict into, const leaf_slopes *restrict child) {
    LANE_SIMD(l) {
        if (op == OP_SUM) {
            into->value_lo[l] += child->value_lo[l];
            into->value_hi[l] += child->value_hi[l];
            into->slope_lo[l] += child->slope_lo[l];
            into->slope_hi[l] += child->slope_hi[l];
            into->at_a[l] += child->at_a[l];
            into->at_b[l] += child->at_b[l];
            into->magnitude[l] += child->magnitude[l];
            continue;
        }
        const double m0 = into->value_lo[l], m1 = into->value_hi[l], c0 = child->value_lo[l], c1 = child->value_hi[l];
        const int mine_only = op == OP_MAX ? m0 > c1 : m1 < c0, theirs_only = op == OP_MAX ? c0 > m1 : c1 < m0;
        const double hull_lo = kernel_min(into->slope_lo[l], child->slope_lo[l]);
        const double hull_hi = kernel_max(into->slope_hi[l], child->slope_hi[l]);
        into->slope_lo[l] = mine_only ? into->slope_lo[l] : theirs_only ? child->slope_lo[l] : hull_lo;
        into->slope_hi[l] = mine_only ? into->slope_hi[l] : theirs_only ? child->slope_hi[l] : hull_hi;
        into->value_lo[l] = op == OP_MAX ? kernel_max(m0, c0) : kernel_min(m0, c0);
        into->value_hi[l] = op == OP_MAX ? kernel_max(m1, c1) : kernel_min(m1, c1);
        into->at_a[l] =
            op == OP_MAX ? kernel_max(into->at_a[l], child->at_a[l]) : kernel_min(into->at_a[l], child->at_a[l]);
        into->at_b[l] =
            op == OP_MAX ? kernel_max(into->at_b[l], child->at_b[l]) : kernel_min(into->at_b[l], child->at_b[l]);
        into->magnitude[l] = kernel_max(into->magnitude[l], child->magnitude[l]);
    }
}

static void tree_join_point(int32_t op, leaf_point *restrict into, const leaf_point *restrict child) {
    LANE_SIMD(l) {
        const double mine = into->value[l], theirs = child->value[l];
        const int take = op == OP_MAX ? theirs > mine : theirs < mine;
        const int add = op == OP_SUM;
        into->value[l] = add ? mine + theirs : take ? theirs : mine;
        for (int i = 0; i < 3; i++) {
            const double g = into->gradient[i][l], h = child->gradient[i][l];
            into->gradient[i][l] = add ? g + h : take ? h : g;
        }
        into->magnitude[l] =
            add ? into->magnitude[l] + child->magnitude[l] : kernel_max(into->magnitude[l], child->magnitude[l]);
    }
}

/* The walk, written down once per list of leaves and replayed for every evaluation. */
enum { STEP_OPEN, STEP_LEAF, STEP_ZERO, STEP_CLOSE, STEP_JOINT };
typedef struct tree_step {
    uint8_t what; /* STEP_* */
    uint8_t op;   /* OP_* of the node that the step's result goes into */
    uint8_t set;  /* it is that node's first content: nothing to join with */
    uint8_t reserved;
    int32_t leaf; /* STEP_LEAF: index of the leaf. STEP_JOINT: how many children; STEP_OPEN of it: its index */
} tree_step;

/* Smooth nodes are no folds of two: their children stay on the stack, one above the other, until STEP_JOINT
 * makes one of them. What is 0 takes no part. */
KERNEL_INLINE int tree_is_joint(int32_t op) { return op == OP_SMOOTH_MAX || op == OP_SMOOTH_MIN; }

/* Room that tree_plan needs in a tree of so many nodes, nested in so many levels: every leaf opens and closes at most
 * `depth` nodes, and every node is opened and closed once. */
static size_t tree_plan_room(size_t leaves, int32_t depth, int32_t nodes) {
    const size_t by_leaves = (leaves + 1) * (4 * (size_t)depth + 5), by_nodes = leaves + 4 * (size_t)nodes + 5;
    return by_leaves < by_nodes ? by_leaves : by_nodes;
}

/* Room on the stack for the evaluation of a plan: open nodes, and what waits for its joint. */
static size_t tree_stack_room(const tree_step *steps, size_t count, int32_t depth) {
    size_t waiting = 0;
    for (size_t i = 0; i < count; i++) waiting += steps[i].what == STEP_JOINT ? (size_t)steps[i].leaf : 0;
    return (size_t)depth + 2 + waiting;
}

/* A node that a plan has opened: what it has seen of its children, and the step that opened it. */
typedef struct tree_open {
    int32_t node, seen;
    size_t step;
} tree_open;

/* Steps for `count` elements in ascending order: number i is what stands `order[i]` (NULL: i) times `stride` bytes
 * behind `elements`, and is called by that number. `path`: room for one node of each level. Returns how many steps
 * there are. */
static size_t tree_plan_of(const blob_scene *scene, const int32_t *elements, size_t stride, const int32_t *order,
                           size_t count, tree_open *path, tree_step *steps) {
    const blob_node *nodes = scene->nodes;
    int32_t open = -1, top = -1;
    size_t n = 0;
    for (size_t i = 0; i <= count; i++) {
        const int32_t number = i == count ? -1 : order ? order[i] : (int32_t)i;
        int32_t element = -1;
        if (i < count) memcpy(&element, (const char *)elements + stride * (size_t)number, sizeof element);
        while (open >= 0 && (element < nodes[open].element_begin || element >= nodes[open].element_end)) {
            const blob_node *node = &nodes[open];
            if (tree_is_joint(node->op)) {
                steps[path[top].step].leaf = (int32_t)n;
                steps[n++] = (tree_step){STEP_JOINT, (uint8_t)node->op, 0, 0, path[top].seen};
            } else if (path[top].seen < node->children)
                steps[n++] = (tree_step){STEP_ZERO, (uint8_t)node->op, 0, 0, -1};
            open = node->parent;
            top--;
            if (open < 0) break;
            steps[n++] = (tree_step){STEP_CLOSE, (uint8_t)nodes[open].op, path[top].seen++ == 0, 0, -1};
        }
        if (i == count) break;
        const int32_t last = nodes[scene->node[element]].depth;
        for (int32_t node = scene->node[element], level = last; level > top; node = nodes[node].parent, level--)
            path[level].node = node;
        while (top < last) {
            open = path[++top].node;
            path[top].seen = 0;
            path[top].step = n;
            steps[n++] = (tree_step){STEP_OPEN, (uint8_t)nodes[open].op, 0, 0, -1};
        }
        steps[n++] = (tree_step){STEP_LEAF, (uint8_t)nodes[open].op, path[top].seen++ == 0, 0, number};
    }
    return n;
}

/* Where the leaves of the sum that step `first` is one of are interrupted, `last` at the latest. */
static size_t tree_run(const tree_step *steps, size_t first, size_t last) {
    while (first < last && steps[first].what == STEP_LEAF && steps[first].op == OP_SUM) first++;
    return first;
}

/* Steps for leaves order[0..count) (sorted by element). */
static size_t tree_plan(const blob_scene *scene, const leaf *leaves, const int32_t *order, size_t count,
                        tree_open *path, tree_step *steps) {
    return tree_plan_of(scene, count ? &leaves[0].element : NULL, sizeof *leaves, order, count, path, steps);
}

#endif
