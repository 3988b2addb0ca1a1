/* mesh_brick.h - one brick: which of its cells matter, the field at their nodes, points on their edges.
 *
 * Nodes that lie within `warp` of the surface (a fiftieth of a cell) are moved that far away from it, along the
 * gradient, to the side that their sign says. So no two vertices of a mesh fall together, not even where the
 * field is exactly the threshold at nodes, and triangles have no edges of length nearly 0. What is within the
 * rounding bound of the threshold counts as inside.
 *
 * Each crossed edge gets the point where the field is the threshold, by Newton's method within a bracket.
 */
#ifndef BLOB_MESH_BRICK_H
#define BLOB_MESH_BRICK_H

#include "mesh_box.h"
#include "mesh_cell.h"

typedef struct mesh_growing {
    void *data;
    size_t room;
} mesh_growing;

/* Boxes of half the size, from those of half a brick down to the smallest that mesh_hides looks at. */
enum { MESH_FINEST = 16, /* of the latter, along a cell */ MESH_HALVINGS = 8 };

struct mesh_scratch {
    packet_scratch packet;
    box_scratch box;
    mesh_growing vertices, triangles, foreign, members, matters;
    /* the brick at hand */
    blob_mesher *mesher;
    mesh_brick *brick;
    packet p;
    int32_t unit, base[3]; /* cell and first node, finest units */
    uint8_t around[27];    /* states of the bricks around: 13 is this one */
    uint8_t any_split, at_clip;
    double value[MESH_NODE_COUNT], shift[MESH_NODE_COUNT][3]; /* field - threshold; how far a node was moved */
    uint8_t inside[MESH_NODE_COUNT], forced[MESH_NODE_COUNT], needed[MESH_NODE_COUNT];
    int8_t state[MESH_CELL_COUNT];  /* 1: proved inside, -1: outside, 0: neither */
    uint8_t plain[MESH_CELL_COUNT]; /* proved to have no extremum */
    uint32_t vertex_count, triangle_count, foreign_count;
};

static void *mesh_grown(mesh_growing *list, size_t need, size_t size) {
    if (need * size > list->room) {
        const size_t bytes = (need + need / 2 + 256) * size;
        void *fresh = realloc(list->data, bytes);
        if (!fresh) return NULL;
        list->data = fresh;
        list->room = bytes;
    }
    return list->data;
}

static inline int mesh_node(int x, int y, int z) { return x + MESH_NODES * (y + MESH_NODES * z); }
static inline void mesh_node_place(int node, int *at) {
    at[0] = node % MESH_NODES, at[1] = node / MESH_NODES % MESH_NODES, at[2] = node / (MESH_NODES * MESH_NODES);
}
static inline int mesh_node_step(int axis) { return axis == 0 ? 1 : axis == 1 ? MESH_NODES : MESH_NODES * MESH_NODES; }

/* Packed coordinate of a node. */
static inline double mesh_coordinate(const blob_mesher *m, int axis, int32_t node) {
    return m->lo[axis] + (double)node * m->fine[axis];
}

/* ---- the field at points -------------------------------------------------------------------------- */

/* A Gaussian is cut at its support for each lane by itself, so that a value does not depend on its neighbours. */
static void mesh_leaf_point(const packet *restrict p, const leaf *restrict f, const double *restrict t,
                            leaf_point *restrict sum) {
    if (f->id != KERNEL_GAUSS) {
        packet_leaf_point(p, f, t, sum);
        return;
    }
    leaf_point one;
    LANE_CLEAR(&one);
    packet_leaf_point(p, f, t, &one);
    LANE_SIMD(l) {
        const int here = (f->enter[l] < t[l]) & (f->exit[l] > t[l]);
        sum->value[l] += here ? one.value[l] : 0.0;
        sum->magnitude[l] += here ? one.magnitude[l] : 0.0;
        for (int i = 0; i < 3; i++) sum->gradient[i][l] += here ? one.gradient[i][l] : 0.0;
    }
}

#define MESH_POINT(p, f, a, b, sum) mesh_leaf_point(p, f, a, sum)
PACKET_SUM(mesh_point_on, leaf_point, MESH_POINT, tree_join_point)
PACKET_STEPS(mesh_point_on, leaf_point, MESH_POINT, tree_join_point)
PACKET_EVALUATE(mesh_point_on, leaf_point)

/* Field minus threshold, and its rounding bound in `magnitude`. */
static void mesh_evaluate(const mesh_scratch *w, const double *t, leaf_point *f) {
    mesh_point_on(&w->p, t, t, f);
    const double threshold = w->mesher->surface->threshold, size = fabs(threshold);
    LANE_SIMD(l) {
        f->value[l] -= threshold;
        f->magnitude[l] = 8.0 * DBL_EPSILON * (f->magnitude[l] + size);
    }
}

/* The leaves of the brick's elements along the rays in p. 0 when memory has run out. */
static int mesh_load(mesh_scratch *w) {
    packet *p = &w->p;
    p->leaf_count = p->piece_count = p->memory_count = p->step_count = 0;
    p->out_of_memory = 0;
    const int32_t *ids = w->mesher->pool.ids + w->brick->ids;
    for (uint32_t i = 0; i < w->brick->id_count; i++) packet_add(p, ids[i]);
    return !p->out_of_memory && packet_plan(p);
}

static void mesh_set_window(packet *p, double from, double to) { LANE_LOOP(l) p->t[l] = from, p->end[l] = to; }

/* Lane l: along x through the nodes (y, z). t is the distance from the grid's side. */
static void mesh_set_row(mesh_scratch *w, int l, int32_t y, int32_t z) {
    const blob_mesher *m = w->mesher;
    packet_rays *rays = &w->p.rays;
    rays->o[0][l] = m->lo[0], rays->o[1][l] = mesh_coordinate(m, 1, y), rays->o[2][l] = mesh_coordinate(m, 2, z);
    rays->d[0][l] = rays->inverse[0][l] = 1.0;
    for (int k = 1; k < 3; k++) rays->d[k][l] = 0.0, rays->inverse[k][l] = 1e300;
    rays->magnitude[l] = m->magnitude;
}

/* Lane l: a point, t = 0. */
static void mesh_set_point(mesh_scratch *w, int l, const double *at) {
    packet_rays *rays = &w->p.rays;
    for (int k = 0; k < 3; k++) rays->o[k][l] = at[k], rays->d[k][l] = 0.0, rays->inverse[k][l] = 1e300;
    rays->magnitude[l] = w->mesher->magnitude;
}

static const LANE_ALIGN double MESH_ZERO[LANES] = {0.0};

/* The field at one point, the same for every brick that asks. 0 when memory has run out. */
static int mesh_at_point(mesh_scratch *w, const double *at, leaf_point *f) {
    LANE_LOOP(l) mesh_set_point(w, l, at);
    mesh_set_window(&w->p, -DBL_MIN, DBL_MIN);
    if (!mesh_load(w)) return 0;
    mesh_evaluate(w, MESH_ZERO, f);
    return 1;
}

/* ... and at one node, in finest units. */
static int mesh_at_node(mesh_scratch *w, const int32_t *node, leaf_point *f) {
    LANE_ALIGN double t[LANES];
    LANE_LOOP(l) mesh_set_row(w, l, node[1], node[2]), t[l] = (double)node[0] * w->mesher->fine[0];
    mesh_set_window(&w->p, t[0] * (1.0 - 1e-12) - w->mesher->fine[0], t[0] * (1.0 + 1e-12) + w->mesher->fine[0]);
    if (!mesh_load(w)) return 0;
    mesh_evaluate(w, t, f);
    return 1;
}

static inline int mesh_is_inside(const leaf_point *f, int l) { return f->value[l] >= -f->magnitude[l]; }

static int mesh_is_forced(const blob_mesher *m, const int32_t *node) {
    if (!m->clip) return 0;
    for (int k = 0; k < 3; k++)
        if (node[k] < m->clip_first[k] || node[k] > m->clip_last[k]) return 1;
    return 0;
}

/* How far a node is moved: away from a surface nearer than `warp`. */
static void mesh_warp(const blob_mesher *m, const int32_t *node, const leaf_point *f, int l, double *shift) {
    double length2 = 0.0;
    for (int k = 0; k < 3; k++) shift[k] = 0.0, length2 += f->gradient[k][l] * f->gradient[k][l];
    const double length = sqrt(length2);
    if (!(fabs(f->value[l]) < m->warp * length)) return;
    if (m->clip)
        for (int k = 0; k < 3; k++)
            if (node[k] <= m->clip_first[k] || node[k] >= m->clip_last[k]) return;
    const double scale = (mesh_is_inside(f, l) ? m->warp : -m->warp) / length;
    for (int k = 0; k < 3; k++) shift[k] = scale * f->gradient[k][l];
}

/* ---- which cells matter ------------------------------------------------------------------------------ */

static void mesh_lanes(const mesh_scratch *w, box_lanes *lanes, double cells) {
    const blob_mesher *m = w->mesher;
    lanes->scene = m->scene;
    lanes->index = m->index;
    lanes->surface = m->surface;
    lanes->depth = m->depth;
    lanes->wanted = (1 << LANES) - 1;
    memset(lanes->along, 0, sizeof lanes->along);
    for (int k = 0; k < 3; k++) {
        lanes->half[k] = 0.5 * cells * (double)w->unit * m->fine[k] * (1.0 + 1e-12);
        LANE_LOOP(l) lanes->rays.d[k][l] = 0.0, lanes->rays.inverse[k][l] = 1e300;
    }
    LANE_LOOP(l) lanes->rays.magnitude[l] = m->magnitude;
}

/* What bounds say of a box: 1 inside, -1 outside, 0 neither. */
static int mesh_verdict(const blob_mesher *m, const box_bounds *b, int l) {
    const double t = m->surface->threshold, slack = 32.0 * DBL_EPSILON * (b->magnitude[l] + fabs(t));
    return b->lo[l] > t + slack ? 1 : b->hi[l] < t - slack ? -1 : 0;
}

/* Has the field a direction in which it rises or falls all over the box? */
static int mesh_is_plain(const box_slopes *g, int l) {
    for (int k = 0; k < BOX_WAYS; k++)
        if (g->slope_lo[k][l] > 0.0 || g->slope_hi[k][l] < 0.0) return 1;
    return 0;
}

/* The direction that is most likely one of these: to the middle of all gradients. */
static void mesh_middle_gradient(const box_slopes *g, int l, double *along) {
    double length2 = 0.0;
    for (int k = 0; k < 3; k++)
        along[k] = 0.5 * (g->slope_lo[k][l] + g->slope_hi[k][l]), length2 += along[k] * along[k];
    const double scale = length2 > 1e-200 && length2 < 1e200 ? (1.0 - 1e-12) / sqrt(length2) : 0.0;
    for (int k = 0; k < 3; k++) along[k] = scale > 0.0 ? scale * along[k] : 0.0;
}

/* The elements that are felt in a box: a part of the brick's own, at a depth of halving. */
typedef struct mesh_members {
    const int32_t *ids;
    size_t count;
    int depth; /* lists from here on may be overwritten */
} mesh_members;

static mesh_members mesh_all_members(const mesh_scratch *w) {
    return (mesh_members){w->mesher->pool.ids + w->brick->ids, w->brick->id_count, 0};
}

static uint8_t *mesh_matters(const mesh_scratch *w, const mesh_members *of) {
    return (uint8_t *)w->matters.data + (size_t)of->depth * w->brick->id_count;
}

/* Bounds over boxes; for each member, in mesh_matters, in which of them it is felt. keep: those of the gradient may be
 * asked for next. 0 when memory has run out. */
static int mesh_take_bounds(mesh_scratch *w, const box_lanes *lanes, const mesh_members *of, int keep, size_t *steps,
                            box_bounds *b) {
    if (!box_plan(lanes, &w->box, of->ids, of->count, steps)) return 0;
    if (!box_keep(&w->box, keep ? of->count : SIZE_MAX)) return 0;
    box_bounds_of(lanes, &w->box, of->ids, of->count, *steps, mesh_matters(w, of), b);
    box_close_bounds(lanes, b);
    return 1;
}

/* Bounds of the gradient over the boxes whose bounds were taken just before. */
static void mesh_take_slopes(mesh_scratch *w, const box_lanes *lanes, const mesh_members *of, size_t steps,
                             box_slopes *g) {
    box_slopes_of(lanes, &w->box, of->ids, of->count, steps, mesh_matters(w, of), g);
}

/* Those that are felt in box l. */
static mesh_members mesh_members_of(mesh_scratch *w, const mesh_members *of, int l) {
    const uint8_t *matters = mesh_matters(w, of);
    int32_t *ids = (int32_t *)w->members.data + (size_t)of->depth * w->brick->id_count;
    size_t count = 0;
    for (size_t i = 0; i < of->count; i++) {
        ids[count] = of->ids[i];
        count += matters[i] >> l & 1;
    }
    return (mesh_members){ids, count, of->depth + 1};
}

/* Middle of lane l's octant, of `size` cells, of the block at (x, y, z), counted in cells. */
static void mesh_set_octants(const mesh_scratch *w, box_lanes *lanes, const double *at, double size) {
    LANE_LOOP(l) {
        for (int k = 0; k < 3; k++)
            lanes->rays.o[k][l] = mesh_coordinate(w->mesher, k, w->base[k]) +
                                  (at[k] + size * ((double)(l >> k & 1) + 0.5)) * (double)w->unit * w->mesher->fine[k];
    }
}

/* States of the cells of a block of 2 * size cells, by its eight octants. 0 when memory has run out. */
static int mesh_cull(mesh_scratch *w, const int *at, int size, const mesh_members *of) {
    box_lanes lanes;
    box_bounds b;
    box_slopes g;
    const double corner[3] = {at[0], at[1], at[2]};
    mesh_lanes(w, &lanes, size);
    mesh_set_octants(w, &lanes, corner, size);
    size_t steps;
    if (!mesh_take_bounds(w, &lanes, of, size == 2, &steps, &b)) return 0;
    if (size == 2) mesh_take_slopes(w, &lanes, of, steps, &g);
    for (int l = 0; l < LANES; l++) {
        const int verdict = mesh_verdict(w->mesher, &b, l), plain = size == 2 && mesh_is_plain(&g, l);
        const int x = at[0] + (l & 1) * size, y = at[1] + (l >> 1 & 1) * size, z = at[2] + (l >> 2) * size;
        const int next[3] = {x, y, z};
        for (int c = 0; (verdict || size <= 2) && c < size * size * size; c++) {
            const int cell = x + c % size + MESH_CELLS * (y + c / size % size + MESH_CELLS * (z + c / (size * size)));
            w->state[cell] = (int8_t)verdict;
            if (size == 2) w->plain[cell] = (uint8_t)plain;
        }
        if (verdict || size == 1) continue;
        const mesh_members some = mesh_members_of(w, of, l);
        if (!mesh_cull(w, next, size / 2, &some)) return 0;
    }
    return 1;
}

/* ---- nodes ----------------------------------------------------------------------------------------------- */

static void mesh_cell_place(int cell, int *at) {
    at[0] = cell % MESH_CELLS, at[1] = cell / MESH_CELLS % MESH_CELLS, at[2] = cell / (MESH_CELLS * MESH_CELLS);
}

/* Signs that are proved, and which nodes have to be computed. */
static void mesh_mark_nodes(mesh_scratch *w) {
    memset(w->needed, 0, sizeof w->needed);
    memset(w->inside, 0, sizeof w->inside);
    memset(w->forced, 0, sizeof w->forced);
    memset(w->shift, 0, sizeof w->shift);
    for (int cell = 0; cell < MESH_CELL_COUNT; cell++) {
        if (w->state[cell] < 0) continue;
        uint8_t *marks = w->state[cell] == 0 ? w->needed : w->inside;
        int at[3];
        mesh_cell_place(cell, at);
        uint8_t *low = marks + mesh_node(at[0], at[1], at[2]);
        for (int c = 0; c < 8; c++) low[(c & 1) + MESH_NODES * ((c >> 1 & 1) + MESH_NODES * (c >> 2))] = 1;
    }
    if (!w->at_clip) return;
    for (int node = 0; node < MESH_NODE_COUNT; node++) {
        int at[3];
        mesh_node_place(node, at);
        const int32_t global[3] = {w->base[0] + at[0] * w->unit, w->base[1] + at[1] * w->unit,
                                   w->base[2] + at[2] * w->unit};
        if (!mesh_is_forced(w->mesher, global)) continue;
        w->forced[node] = 1;
        w->needed[node] = w->inside[node] = 0;
        w->value[node] = -1.0;
    }
}

/* The field at the nodes that need it, LANES rows at a time. */
static int mesh_sample(mesh_scratch *w) {
    const blob_mesher *m = w->mesher;
    const int rows = MESH_NODES * MESH_NODES;
    const double begin = (double)w->base[0] * m->fine[0], step = (double)w->unit * m->fine[0];
    for (int first = 0; first < rows; first += LANES) {
        int any = 0, row[LANES];
        LANE_LOOP(l) {
            row[l] = first + l < rows ? first + l : first;
            for (int x = 0; x < MESH_NODES; x++) any |= w->needed[x + MESH_NODES * row[l]];
        }
        if (!any) continue;
        LANE_LOOP(l)
        mesh_set_row(w, l, w->base[1] + row[l] % MESH_NODES * w->unit, w->base[2] + row[l] / MESH_NODES * w->unit);
        mesh_set_window(&w->p, begin - step, begin + (MESH_CELLS + 1) * step);
        if (!mesh_load(w)) return 0;
        for (int x = 0; x < MESH_NODES; x++) {
            any = 0;
            LANE_LOOP(l) any |= w->needed[x + MESH_NODES * row[l]];
            if (!any) continue;
            LANE_ALIGN double t[LANES];
            leaf_point f;
            LANE_LOOP(l) t[l] = (double)(w->base[0] + x * w->unit) * m->fine[0];
            mesh_evaluate(w, t, &f);
            for (int l = 0; l < LANES && first + l < rows; l++) {
                const int node = x + MESH_NODES * row[l];
                if (!w->needed[node]) continue;
                const int32_t at[3] = {w->base[0] + x * w->unit, w->base[1] + row[l] % MESH_NODES * w->unit,
                                       w->base[2] + row[l] / MESH_NODES * w->unit};
                w->value[node] = f.value[l];
                w->inside[node] = (uint8_t)mesh_is_inside(&f, l);
                mesh_warp(m, at, &f, l, w->shift[node]);
            }
        }
    }
    return 1;
}

/* Where a node is after all, packed. */
static void mesh_node_at(const mesh_scratch *w, int node, double *at) {
    int place[3];
    mesh_node_place(node, place);
    for (int k = 0; k < 3; k++)
        at[k] = mesh_coordinate(w->mesher, k, w->base[k] + place[k] * w->unit) + w->shift[node][k];
}

/* ---- edges --------------------------------------------------------------------------------------------------- */

/* Is an edge its brick's own, and an edge of no finer brick? */
static int mesh_owns(const mesh_scratch *w, int axis, const int *at) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const int u0 = at[u] == 0 ? -1 : 0, u1 = at[u] == MESH_CELLS, v0 = at[v] == 0 ? -1 : 0, v1 = at[v] == MESH_CELLS;
    const int step[3] = {1, 3, 9};
    for (int i = u0; i <= u1; i++) {
        for (int j = v0; j <= v1; j++) {
            const int state = w->around[13 + i * step[u] + j * step[v]];
            if (state == MESH_SPLIT || (state == MESH_LEAF && 3 * i + j > 0)) return 0;
        }
    }
    return 1;
}

static void mesh_put_vertex(const blob_mesher *m, const double *place, const double *gradient, double *vertex) {
    double largest = 0.0, length2 = 0.0;
    for (int k = 0; k < 3; k++) largest = kernel_max(largest, fabs(gradient[k]));
    for (int k = 0; k < 3; k++) {
        const double g = largest > 0.0 ? gradient[k] / largest : 0.0;
        length2 += g * g;
        vertex[k] = place[k] / m->scene->scale + m->scene->center[k];
        vertex[3 + k] = -g;
    }
    for (int k = 0; k < 3 && length2 > 0.0; k++) vertex[3 + k] /= sqrt(length2);
    if (!(length2 > 0.0)) vertex[3] = 0.0, vertex[4] = 0.0, vertex[5] = 1.0;
}

/* Crossed edges of LANES lanes: bracket, direction and what was found. */
typedef struct mesh_roots {
    LANE_ALIGN double t[LANES], a[LANES], b[LANES], sign[LANES], length[LANES];
    double gradient[LANES][3], residual[LANES];
    int done[LANES], cap[LANES]; /* cap: the end that lies on the clip box, 0 or 1; -1: none */
} mesh_roots;

/* The rays along edges codes[0..LANES). shifted: from and to where nodes were moved. */
static void mesh_set_edges(mesh_scratch *w, const uint16_t *codes, int shifted, mesh_roots *r) {
    const blob_mesher *m = w->mesher;
    packet *p = &w->p;
    LANE_LOOP(l) {
        const int axis = codes[l] / MESH_NODE_COUNT, node = codes[l] % MESH_NODE_COUNT;
        const int ends[2] = {node, node + mesh_node_step(axis)};
        double at[2][3], length2 = 0.0;
        r->cap[l] = -1;
        for (int i = 0; i < 2; i++) {
            mesh_node_at(w, ends[i], at[i]);
            for (int k = 0; k < 3 && !shifted; k++) at[i][k] -= w->shift[ends[i]][k];
            if (!w->forced[ends[i]]) continue;
            r->cap[l] = i;
            at[i][axis] = i == 0 ? m->clip_lo[axis] : m->clip_hi[axis];
        }
        for (int k = 0; k < 3; k++) length2 += (at[1][k] - at[0][k]) * (at[1][k] - at[0][k]);
        r->length[l] = sqrt(length2);
        for (int k = 0; k < 3; k++) {
            const double d = r->length[l] > 0.0 ? (at[1][k] - at[0][k]) / r->length[l] : k == axis;
            p->rays.o[k][l] = at[0][k];
            p->rays.d[k][l] = d;
            p->rays.inverse[k][l] = 1.0 / (fabs(d) > 1e-300 ? d : 1e-300);
        }
        p->rays.magnitude[l] = m->magnitude;
        p->t[l] = -1e-9 * r->length[l] - DBL_MIN;
        p->end[l] = r->length[l] * (1.0 + 1e-9) + DBL_MIN;
        const double u = fabs(w->value[ends[0]]), v = fabs(w->value[ends[1]]);
        const double share = r->cap[l] >= 0 ? (double)r->cap[l] : u + v > 0.0 ? u / (u + v) : 0.5;
        r->a[l] = 0.0, r->b[l] = r->length[l];
        r->t[l] = r->cap[l] >= 0 ? share * r->length[l] : kernel_min(kernel_max(share, 0.01), 0.99) * r->length[l];
        r->sign[l] = w->inside[ends[0]] ? -1.0 : 1.0; /* sign * field rises along the edge */
        r->done[l] = 0;
    }
}

/* One step of lane l from the field at t. 1 if it has arrived. */
static int mesh_root_step(const leaf_point *f, const packet *p, int l, int round, mesh_roots *r) {
    const double value = r->sign[l] * f->value[l];
    double slope = 0.0, size2 = 0.0;
    for (int k = 0; k < 3; k++) {
        r->gradient[l][k] = f->gradient[k][l];
        slope += r->sign[l] * f->gradient[k][l] * p->rays.d[k][l];
        size2 += f->gradient[k][l] * f->gradient[k][l];
    }
    r->residual[l] = fabs(value) / (sqrt(size2) > 0.0 ? sqrt(size2) : 1.0);
    if (round == 0 && r->cap[l] >= 0 && f->value[l] >= 0.0) { /* inside at the clip box: the cap */
        for (int k = 0; k < 3; k++) r->gradient[l][k] = (r->cap[l] ? -1.0 : 1.0) * p->rays.d[k][l];
        r->residual[l] = 0.0;
        return 1;
    }
    if (fabs(value) <= 0.125 * f->magnitude[l]) return 1;
    if (value < 0.0) r->a[l] = r->t[l];
    else r->b[l] = r->t[l];
    const double newton = r->t[l] - value / slope, half = 0.5 * (r->a[l] + r->b[l]);
    const int good = slope > 0.0 && newton > r->a[l] && newton < r->b[l] && (round < 6 || round % 2);
    const double next = good ? newton : half;
    if (fabs(next - r->t[l]) <= 1e-16 * r->length[l] || half <= r->a[l] || half >= r->b[l]) return 1;
    r->t[l] = next;
    return 0;
}

/* Vertices of up to LANES edges, at `out`. 0 when memory has run out. */
static int mesh_edge_vertices(mesh_scratch *w, const uint16_t *given, int count, int shifted, double *out) {
    const blob_mesher *m = w->mesher;
    const double good = 1e-13 * m->magnitude;
    uint16_t codes[LANES];
    mesh_roots r;
    LANE_LOOP(l) codes[l] = given[l < count ? l : 0];
    mesh_set_edges(w, codes, shifted, &r);
    if (!mesh_load(w)) return 0;
    for (int round = 0, busy = 1; busy && round < 120; round++) {
        leaf_point f;
        mesh_evaluate(w, r.t, &f);
        busy = 0;
        for (int l = 0; l < count; l++) {
            if (!r.done[l]) r.done[l] = mesh_root_step(&f, &w->p, l, round, &r);
            busy |= !r.done[l];
        }
    }
    for (int l = 0; l < count; l++) {
        double at[3];
        for (int k = 0; k < 3; k++) at[k] = w->p.rays.o[k][l] + r.t[l] * w->p.rays.d[k][l];
        if (r.cap[l] >= 0 && r.residual[l] == 0.0 && r.t[l] == (double)r.cap[l] * r.length[l])
            at[codes[l] / MESH_NODE_COUNT] = (r.cap[l] ? m->clip_hi : m->clip_lo)[codes[l] / MESH_NODE_COUNT];
        mesh_put_vertex(m, at, r.gradient[l], out + 6 * l);
    }
    /* a node was moved across another part of the surface: its edges from where it was */
    for (int l = 0; l < count && shifted; l++)
        if (r.residual[l] > good && !mesh_edge_vertices(w, codes + l, 1, 0, out + 6 * l)) return 0;
    return 1;
}

/* The crossed edges along an axis that are the brick's own: marked, and their codes from codes[count] on. */
static int mesh_crossed(mesh_scratch *w, int axis, uint16_t *codes, int count) {
    const int step = mesh_node_step(axis);
    for (int z = 0; z < MESH_NODES - (axis == 2); z++) {
        for (int y = 0; y < MESH_NODES - (axis == 1); y++) {
            const int first = mesh_node(0, y, z), length = MESH_NODES - (axis == 0);
            const uint8_t *row = w->inside + first;
            if (memcmp(row, row + step, (size_t)length) == 0) continue;
            for (int x = 0; x < length; x++) {
                const int at[3] = {x, y, z}, code = axis * MESH_NODE_COUNT + first + x;
                if (row[x] == row[x + step] || !mesh_owns(w, axis, at)) continue;
                w->brick->edges[code / 64] |= (uint64_t)1 << (code % 64);
                codes[count++] = (uint16_t)code;
            }
        }
    }
    return count;
}

/* All crossed edges of the brick's own. */
static int mesh_find_vertices(mesh_scratch *w) {
    uint16_t codes[MESH_EDGE_COUNT];
    int count = 0;
    memset(w->brick->edges, 0, sizeof w->brick->edges);
    for (int axis = 0; axis < 3; axis++) count = mesh_crossed(w, axis, codes, count);
    double *out = mesh_grown(&w->vertices, (size_t)count + LANES, 6 * sizeof *out);
    if (!out) return 0;
    for (int i = 0; i < count; i += LANES)
        if (!mesh_edge_vertices(w, codes + i, count - i < LANES ? count - i : LANES, 1, out + 6 * i)) return 0;
    w->vertex_count = (uint32_t)count;
    uint32_t before = 0;
    for (int i = 0; i < MESH_WORDS; i++) {
        w->brick->rank[i] = (uint16_t)before;
        before += (uint32_t)__builtin_popcountll(w->brick->edges[i]);
    }
    return 1;
}

#endif
