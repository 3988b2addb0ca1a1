/* mesh_polygon.h - the triangles of a brick's cells.
 *
 * Most cells are a case of the table. A cell with ambiguous faces asks the field about them; one that touches
 * finer bricks takes the sides that they see: split edges have a node in the middle, split faces are four. Its
 * vertices there belong to the finer bricks and are called by their edges (`foreign`).
 */
#ifndef BLOB_MESH_POLYGON_H
#define BLOB_MESH_POLYGON_H

#include "mesh_hide.h"

/* One cell: its place in the brick and what its vertices are called. */
typedef struct polygon_cell {
    int at[3];
    int32_t node[3];                /* finest units */
    uint16_t codes[CELL_VERTICES];  /* of triangles, by the names of mesh_cell.h */
    double place[CELL_VERTICES][3]; /* about where they are, packed */
    /* cells at finer bricks: the lattice of half cells */
    double value[27], shift[27][3];
    uint8_t inside[27], known[27];
} polygon_cell;

static int polygon_put(mesh_scratch *w, uint16_t a, uint16_t b, uint16_t c) {
    uint16_t *out = mesh_grown(&w->triangles, 3 * ((size_t)w->triangle_count + 1), sizeof *out);
    if (!out) return 0;
    out += 3 * (size_t)w->triangle_count++;
    out[0] = a, out[1] = b, out[2] = c;
    return 1;
}

/* A vertex of its own within a cell, on the surface: down the gradient from `at`. 0 when memory has run out. */
static int polygon_middle(mesh_scratch *w, const double *from, uint16_t *code) {
    const blob_mesher *m = w->mesher;
    double *out = mesh_grown(&w->vertices, (size_t)w->vertex_count + 1, 6 * sizeof *out);
    if (!out) return 0;
    double at[3] = {from[0], from[1], from[2]}, gradient[3] = {0.0, 0.0, 0.0};
    const double most = 0.25 * (double)w->unit * kernel_min(m->fine[0], kernel_min(m->fine[1], m->fine[2]));
    for (int round = 0; round < 60; round++) {
        leaf_point f;
        if (!mesh_at_point(w, at, &f)) return 0;
        double size2 = 0.0;
        for (int k = 0; k < 3; k++) gradient[k] = f.gradient[k][0], size2 += gradient[k] * gradient[k];
        if (fabs(f.value[0]) <= 0.125 * f.magnitude[0] || !(size2 > 0.0)) break;
        const double far = fabs(f.value[0]) / sqrt(size2), cut = far > most ? most / far : 1.0;
        if (far <= 1e-16 * m->magnitude) break;
        for (int k = 0; k < 3; k++) at[k] -= cut * f.value[0] / size2 * gradient[k];
    }
    mesh_put_vertex(m, at, gradient, out + 6 * (size_t)w->vertex_count);
    *code = (uint16_t)(MESH_EXTRA + w->brick->extra_count++);
    w->vertex_count++;
    return 1;
}

/* Triangles of all loops of a cell. */
static int polygon_close(mesh_scratch *w, const polygon_cell *cell, cell_loops *loops) {
    int8_t loop[CELL_LOOP];
    int from = 0;
    for (int n; (n = cell_take(loops, &from, loop)) > 0;) {
        if (n == 2) continue; /* both halves of one split edge: the cells on either side meet there */
        double at[CELL_LOOP][3], middle[3] = {0.0, 0.0, 0.0};
        uint8_t triangles[3 * CELL_SHORT];
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 3; k++) at[i][k] = cell->place[loop[i]][k], middle[k] += at[i][k] / n;
        const int count = cell_triangulate(loops, loop, n, at, triangles);
        for (int i = 0; i < count; i++)
            if (!polygon_put(w, cell->codes[loop[triangles[3 * i]]], cell->codes[loop[triangles[3 * i + 1]]],
                             cell->codes[loop[triangles[3 * i + 2]]]))
                return 0;
        if (count) continue;
        uint16_t centre;
        if (!polygon_middle(w, middle, &centre)) return 0;
        for (int i = 0; i < n; i++)
            if (!polygon_put(w, cell->codes[loop[(i + 1) % n]], cell->codes[loop[i]], centre)) return 0;
    }
    return 1;
}

/* ---- faces -------------------------------------------------------------------------------------------- */

/* Are the insides of an ambiguous face joined? The face lies across `axis`, from `low` (finest units) on, `size`
 * units wide; v: values at its corners (0, 0), (1, 0), (0, 1), (1, 1) along the next two axes. -1: no memory. */
static int polygon_joins(mesh_scratch *w, int axis, const int32_t *low, int32_t size, const double *v) {
    const blob_mesher *m = w->mesher;
    const double across = (v[0] - v[1]) + (v[3] - v[2]);
    double share[2] = {(v[0] - v[2]) / across, (v[0] - v[1]) / across}, at[3];
    for (int i = 0; i < 2; i++) share[i] = share[i] > 0.01 && share[i] < 0.99 ? share[i] : 0.5;
    at[axis] = mesh_coordinate(m, axis, low[axis]);
    for (int i = 0; i < 2; i++) {
        const int k = (axis + 1 + i) % 3;
        at[k] = mesh_coordinate(m, k, low[k]) + share[i] * (double)size * m->fine[k];
    }
    leaf_point f;
    if (!mesh_at_point(w, at, &f)) return -1;
    return mesh_is_inside(&f, 0);
}

static void polygon_start(const mesh_scratch *w, polygon_cell *cell, int number) {
    mesh_cell_place(number, cell->at);
    for (int k = 0; k < 3; k++) cell->node[k] = w->base[k] + cell->at[k] * w->unit;
}

static int polygon_corner(const polygon_cell *cell, int corner) {
    return mesh_node(cell->at[0] + (corner & 1), cell->at[1] + (corner >> 1 & 1), cell->at[2] + (corner >> 2));
}

/* About where an edge is crossed: linear between its ends. */
static void polygon_between(const double *a, const double *b, double u, double v, double *at) {
    const double share = fabs(u) + fabs(v) > 0.0 ? fabs(u) / (fabs(u) + fabs(v)) : 0.5;
    for (int k = 0; k < 3; k++) at[k] = a[k] + share * (b[k] - a[k]);
}

/* A cell with ambiguous faces, none of them at a finer brick. */
static int polygon_ambiguous(mesh_scratch *w, int number, int mask) {
    polygon_cell cell;
    polygon_start(w, &cell, number);
    int joins = 0;
    for (int f = 0; f < 6; f++) {
        if (!(w->mesher->cases[mask].ambiguous >> f & 1)) continue;
        const int axis = f >> 1, low = (f & 1) << axis, u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
        const int corners[4] = {low, low | u, low | v, low | u | v};
        int32_t at[3] = {cell.node[0], cell.node[1], cell.node[2]};
        double values[4];
        at[axis] += (f & 1) * w->unit;
        for (int i = 0; i < 4; i++) values[i] = w->value[polygon_corner(&cell, corners[i])];
        const int joined = polygon_joins(w, axis, at, w->unit, values);
        if (joined < 0) return 0;
        joins |= joined << f;
    }
    for (int e = 0; e < 12; e++) {
        const int a = polygon_corner(&cell, cell_edge_corner(e)), b = a + mesh_node_step(e >> 2);
        double from[3], to[3];
        mesh_node_at(w, a, from), mesh_node_at(w, b, to);
        polygon_between(from, to, w->value[a], w->value[b], cell.place[e]);
        cell.codes[e] = (uint16_t)((e >> 2) * MESH_NODE_COUNT + a);
    }
    cell_loops loops;
    cell_whole_loops(mask, joins, &loops);
    return polygon_close(w, &cell, &loops);
}

/* ---- cells at finer bricks ------------------------------------------------------------------------------- */

/* Does any brick around the part of the cell that is fixed along `fixed` axes (place 0 or 2 of the lattice; 1: not
 * fixed) lie deeper? */
static int polygon_is_split(const mesh_scratch *w, const polygon_cell *cell, const int *place) {
    int from[3], to[3];
    for (int k = 0; k < 3; k++) {
        const int at = cell->at[k] + place[k] / 2;
        from[k] = place[k] != 1 && at == 0 ? -1 : 0;
        to[k] = place[k] != 1 && at == MESH_CELLS;
    }
    for (int z = from[2]; z <= to[2]; z++)
        for (int y = from[1]; y <= to[1]; y++)
            for (int x = from[0]; x <= to[0]; x++)
                if (w->around[13 + x + 3 * y + 9 * z] == MESH_SPLIT) return 1;
    return 0;
}

/* Value, sign and shift of a node of the lattice. 0 when memory has run out. */
static int polygon_node(mesh_scratch *w, polygon_cell *cell, int node) {
    if (cell->known[node]) return 1;
    cell->known[node] = 1;
    const int place[3] = {node % 3, node / 3 % 3, node / 9};
    int32_t at[3];
    for (int k = 0; k < 3; k++) at[k] = cell->node[k] + place[k] * (w->unit / 2), cell->shift[node][k] = 0.0;
    cell->value[node] = -1.0, cell->inside[node] = 0;
    if (mesh_is_forced(w->mesher, at)) return 1;
    leaf_point f;
    if (!mesh_at_node(w, at, &f)) return 0;
    cell->value[node] = f.value[0];
    cell->inside[node] = (uint8_t)mesh_is_inside(&f, 0);
    mesh_warp(w->mesher, at, &f, 0, cell->shift[node]);
    return 1;
}

static void polygon_node_at(const mesh_scratch *w, const polygon_cell *cell, int node, double *at) {
    const int place[3] = {node % 3, node / 3 % 3, node / 9};
    for (int k = 0; k < 3; k++)
        at[k] = mesh_coordinate(w->mesher, k, cell->node[k] + place[k] * (w->unit / 2)) + cell->shift[node][k];
}

/* Names the edge from lattice node a to b: half a cell long, or a whole one. 0 when memory has run out. */
static int polygon_edge(mesh_scratch *w, polygon_cell *cell, int a, int b, int8_t *name) {
    const int low = a < b ? a : b, gap = (a < b ? b : a) - low;
    const int half = gap == 1 || gap == 3 || gap == 9, axis = gap <= 2 ? 0 : gap <= 6 ? 1 : 2;
    const int place[3] = {low % 3, low / 3 % 3, low / 9};
    double from[3], to[3];
    if (half) {
        *name = (int8_t)(27 * axis + low);
        mesh_edge *out = mesh_grown(&w->foreign, (size_t)w->foreign_count + 1, sizeof *out);
        if (!out) return 0;
        out += w->foreign_count;
        for (int k = 0; k < 3; k++) out->node[k] = cell->node[k] + place[k] * (w->unit / 2);
        out->axis = (int16_t)axis;
        out->level = (int16_t)(w->brick->level + 1);
        cell->codes[(int)*name] = (uint16_t)(MESH_FOREIGN + w->foreign_count++);
    } else {
        const int corner = (place[0] >> 1) | (place[1] >> 1) << 1 | (place[2] >> 1) << 2;
        *name = (int8_t)(CELL_WHOLE + cell_edge(corner, corner | 1 << axis));
        cell->codes[(int)*name] = (uint16_t)(axis * MESH_NODE_COUNT + polygon_corner(cell, corner));
    }
    polygon_node_at(w, cell, a, from), polygon_node_at(w, cell, b, to);
    polygon_between(from, to, cell->value[a], cell->value[b], cell->place[(int)*name]);
    return 1;
}

/* Adds a face through lattice nodes ring[0..n), counter-clockwise from outside. It lies across `axis`, with its
 * lowest corner at `low` (lattice), `size` half cells wide. 0 when memory has run out. */
static int polygon_face(mesh_scratch *w, polygon_cell *cell, cell_loops *loops, int number, const int *ring, int n,
                        int axis, int low, int size) {
    static const int step[3] = {1, 3, 9};
    cell_face face = {.count = n};
    int changes = 0;
    for (int i = 0; i < n; i++)
        if (!polygon_node(w, cell, ring[i])) return 0;
    for (int i = 0; i < n; i++) {
        const int next = ring[(i + 1) % n];
        face.inside[i] = cell->inside[ring[i]];
        if (cell->inside[ring[i]] == cell->inside[next]) continue;
        changes++;
        if (!polygon_edge(w, cell, ring[i], next, &face.vertex[i])) return 0;
    }
    if (changes > 2) {
        const int u = size * step[(axis + 1) % 3], v = size * step[(axis + 2) % 3];
        const int corners[4] = {low, low + u, low + v, low + u + v}, place[3] = {low % 3, low / 3 % 3, low / 9};
        double values[4] = {1.0, 0.0, 0.0, 1.0}; /* the middle, for faces with split edges */
        int32_t at[3];
        for (int k = 0; k < 3; k++) at[k] = cell->node[k] + place[k] * (w->unit / 2);
        for (int i = 0; i < 4 && n == 4; i++) values[i] = cell->value[corners[i]];
        face.joins = polygon_joins(w, axis, at, size * (w->unit / 2), values);
        if (face.joins < 0) return 0;
    }
    cell_add_face(loops, &face, number);
    return 1;
}

/* All faces of a cell at finer bricks. */
static int polygon_lattice_faces(mesh_scratch *w, polygon_cell *cell, cell_loops *loops) {
    static const int step[3] = {1, 3, 9};
    static const int ring[8][2] = {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
    for (int f = 0; f < 6; f++) {
        const int axis = f >> 1, side = f & 1, u = (axis + 1) % 3, v = (axis + 2) % 3, base = 2 * side * step[axis];
        int place[3], nodes[8], n = 0;
        place[axis] = 2 * side, place[u] = place[v] = 1;
        if (polygon_is_split(w, cell, place)) {
            for (int q = 0; q < 4; q++) {
                const int low = base + (q & 1) * step[u] + (q >> 1) * step[v];
                const int turn[4] = {low, low + step[u], low + step[u] + step[v], low + step[v]};
                for (int i = 0; i < 4; i++) nodes[i] = turn[side ? i : 3 - i];
                if (!polygon_face(w, cell, loops, 4 * f + q, nodes, 4, axis, low, 1)) return 0;
            }
            continue;
        }
        for (int i = 0; i < 8; i++) {
            const int *at = ring[side ? i : 7 - i];
            place[u] = at[0], place[v] = at[1];
            if (at[0] != 1 && at[1] != 1) nodes[n++] = base + at[0] * step[u] + at[1] * step[v];
            else if (polygon_is_split(w, cell, place)) nodes[n++] = base + at[0] * step[u] + at[1] * step[v];
        }
        if (!polygon_face(w, cell, loops, 4 * f, nodes, n, axis, base, 2)) return 0;
    }
    return 1;
}

static int polygon_is_lattice(const mesh_scratch *w, const polygon_cell *cell) {
    for (int e = 0; e < 12; e++) {
        const int axis = e >> 2, corner = cell_edge_corner(e);
        int place[3] = {2 * (corner & 1), corner & 2, corner >> 1 & 2};
        place[axis] = 1;
        if (polygon_is_split(w, cell, place)) return 1;
    }
    return 0;
}

static int polygon_lattice(mesh_scratch *w, polygon_cell *cell) {
    cell_loops loops;
    memset(cell->known, 0, sizeof cell->known);
    cell_clear(&loops);
    return polygon_lattice_faces(w, cell, &loops) && polygon_close(w, cell, &loops);
}

/* ---- the brick ----------------------------------------------------------------------------------------------- */

static int polygon_mask(const mesh_scratch *w, const polygon_cell *cell) {
    int mask = 0;
    for (int c = 0; c < 8; c++) mask |= w->inside[polygon_corner(cell, c)] << c;
    return mask;
}

/* Triangles of cell `number`. 0 when memory has run out. */
static int polygon_cell_triangles(mesh_scratch *w, int number, const polygon_cell *place, int mask) {
    const mesh_case *one = &w->mesher->cases[mask];
    if (one->ambiguous) return polygon_ambiguous(w, number, mask);
    for (int i = 0; i < one->count; i++) {
        uint16_t codes[3];
        for (int j = 0; j < 3; j++) {
            const int e = one->edge[3 * i + j];
            codes[j] = (uint16_t)((e >> 2) * MESH_NODE_COUNT + polygon_corner(place, cell_edge_corner(e)));
        }
        if (!polygon_put(w, codes[0], codes[1], codes[2])) return 0;
    }
    return 1;
}

/* What the cells of a brick may hide. A cell that is partly beyond the clip box is cut on purpose. 0 when memory has
 * run out. */
static int polygon_hidden(mesh_scratch *w) {
    mesh_brick *brick = w->brick;
    for (int block = 0; block < MESH_CELL_COUNT / 8; block++) {
        const int at[3] = {2 * (block % 4), 2 * (block / 4 % 4), 2 * (block / 16)};
        int asked = 0, inside[LANES];
        for (int l = 0; l < LANES; l++) {
            polygon_cell cell;
            const int number = at[0] + (l & 1) + MESH_CELLS * (at[1] + (l >> 1 & 1) + MESH_CELLS * (at[2] + (l >> 2)));
            if (w->state[number]) continue;
            polygon_start(w, &cell, number);
            inside[l] = polygon_mask(w, &cell);
            int cut = 0;
            for (int c = 0; c < 8 && w->at_clip; c++) cut |= w->forced[polygon_corner(&cell, c)];
            brick->cells++;
            brick->undecided += !cut && (inside[l] == 0 || inside[l] == 255);
            if (!cut && !w->plain[number]) asked |= 1 << l;
        }
        if (!asked) continue;
        const int found = hide_in_block(w, at, asked, inside);
        if (found < 0) return 0;
        brick->hidden += (uint32_t)found;
    }
    return 1;
}

/* Triangles of all cells. 0 when memory has run out. */
static int polygon_brick(mesh_scratch *w) {
    for (int number = 0; number < MESH_CELL_COUNT; number++) {
        if (w->state[number]) continue;
        polygon_cell cell;
        polygon_start(w, &cell, number);
        const int mask = polygon_mask(w, &cell);
        if (w->any_split && polygon_is_lattice(w, &cell)) {
            if (!polygon_lattice(w, &cell)) return 0;
        } else if (mask != 0 && mask != 255) {
            if (!polygon_cell_triangles(w, number, &cell, mask)) return 0;
        }
    }
    return 1;
}

#endif
