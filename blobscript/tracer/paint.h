/* paint.h - materials blended at points: a sum blends by positive contribution, max and min take the
 * winner's, smooth ones blend by their shares (joint.h). Replays the packet's steps (tree.h) with materials for
 * content. */
#ifndef BLOB_PAINT_H
#define BLOB_PAINT_H

#include "packet.h"

/* An open node, or a finished child: `row` is the sum of share * material, `best` the material of the
 * largest contribution other than 0, for sums to which nothing contributes positively. Elements that are
 * in the packet for the sake of other lanes contribute 0, and must not show. */
typedef struct paint_mix {
    double value, share, best_value;
    double sum, scale; /* smooth nodes: sum of share * value, and the largest value; shares are relative to it */
    double row[BLOB_MATERIAL], best[BLOB_MATERIAL];
} paint_mix;

/* `value` and its row into a smooth node. */
static void paint_joint(int32_t op, paint_mix *restrict into, double value, const double *restrict row) {
    const double sense = joint_sense(op), f = sense * value;
    if (!(f > 0.0)) return;
    if (f > into->scale) {
        double shrink = 1.0;
        for (int i = 0; i < SHARPNESS; i++) shrink *= into->scale / f;
        into->share *= shrink;
        into->sum *= shrink;
        for (int i = 0; i < BLOB_MATERIAL; i++) into->row[i] *= shrink;
        into->scale = f;
    }
    double share = 1.0;
    for (int i = 0; i < SHARPNESS; i++) share *= f / into->scale;
    into->share += share;
    into->sum += share * f;
    for (int i = 0; i < BLOB_MATERIAL; i++) into->row[i] += share * row[i];
    into->value = sense * into->sum / into->share;
}

static void paint_join(int32_t op, int first, paint_mix *restrict into, double value, const double *restrict row) {
    const int wins = first || (op == OP_MAX ? value > into->value : value < into->value);
    if (value != 0.0 && value > into->best_value) {
        into->best_value = value;
        memcpy(into->best, row, sizeof into->best);
    }
    if (tree_is_joint(op)) {
        paint_joint(op, into, value, row);
    } else if (op == OP_SUM) {
        const double share = kernel_max(value, 0.0);
        into->value += value;
        into->share += share;
        for (int i = 0; i < BLOB_MATERIAL; i++) into->row[i] += share * row[i];
    } else if (wins) {
        into->value = value;
        into->share = 1.0;
        memcpy(into->row, row, sizeof into->row);
    }
}

static void paint_open(paint_mix *restrict mix, const double *restrict base) {
    memset(mix, 0, sizeof *mix);
    mix->best_value = -BLOB_INFINITY;
    memcpy(mix->best, base, sizeof mix->best);
}

static void paint_finish(const paint_mix *restrict mix, double *restrict row) {
    for (int i = 0; i < BLOB_MATERIAL; i++) row[i] = mix->share > 0.0 ? mix->row[i] / mix->share : mix->best[i];
}

static double paint_leaf_value(const packet *restrict p, const leaf *restrict f, int l) {
    const leaf_pieces *pieces = f->pieces >= 0 ? &p->scratch->pieces[f->pieces] : NULL;
    if (!(f->enter[l] < 0.0 && f->exit[l] > 0.0)) return 0.0;
    double s, slope;
    leaf_distance(f, pieces, l, 0.0, &s, &slope);
    if (f->set != SET_NONE) s = set_at(p->scene, p->index, f, &p->rays, l, 0.0).s;
    return f->weight * kernel_value(f->id, p->scene, &p->scene->kernels[f->kernel], s).value;
}

/* Lane l of a packet of points (rays without direction). stack has room for one more than the tree is deep. */
static void paint_lane(const packet *restrict p, int l, const double *restrict materials, paint_mix *restrict stack,
                       double *restrict out) {
    const blob_scene *scene = p->scene;
    const double *base = materials + (size_t)BLOB_MATERIAL * (size_t)p->surface->material;
    const leaf *leaves = p->scratch->leaves;
    paint_open(&stack[0], base);
    int top = p->depth == 0 ? 0 : -1;
    const size_t count = p->depth == 0 ? p->leaf_count : p->step_count;
    for (size_t i = 0; i < count; i++) {
        const tree_step flat = {STEP_LEAF, OP_SUM, i == 0, 0, (int32_t)i};
        const tree_step *step = p->depth == 0 ? &flat : &p->scratch->steps[i];
        double row[BLOB_MATERIAL], value = 0.0;
        const double *paint = base;
        if (step->what == STEP_JOINT) continue;
        if (step->what == STEP_OPEN) {
            paint_open(&stack[++top], base);
            continue;
        }
        if (step->what == STEP_LEAF) {
            const leaf *f = &leaves[step->leaf];
            const int32_t own = scene->paint[f->element];
            value = paint_leaf_value(p, f, l);
            if (own >= 0 && value != 0.0) paint = materials + (size_t)BLOB_MATERIAL * (size_t)own;
        } else if (step->what == STEP_CLOSE) {
            paint_finish(&stack[top], row);
            value = stack[top--].value;
            paint = row;
        }
        paint_join(step->op, step->set, &stack[top], value, paint);
    }
    paint_finish(&stack[0], out);
}

#endif
