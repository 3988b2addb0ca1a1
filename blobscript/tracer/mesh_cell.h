/* mesh_cell.h - the triangles of one cell.
 *
 * Marching cubes by its loops instead of a list of cases: on each face of a cell, segments join the points where
 * the surface crosses the face's edges; they depend on the face alone, so that both cells at a face agree. The
 * segments of a cell close to loops, each of which becomes a disk of triangles. A diagonal of a loop whose ends
 * lie on one side of the cell could meet a segment or another diagonal there, and has no height above segments of
 * finer cells, so none is taken: then every edge of the mesh has exactly two triangles, whatever the signs. Where a
 * loop has no such triangulation (some of length 8, 9 and 12, all of them with ambiguous faces, and those that lie in
 * one side) a vertex in its middle takes part.
 *
 * Faces with more than one segment are ambiguous. The field decides, at the saddle of the bilinear function of
 * the four corners (Nielson and Hamann, The asymptotic decider, 1991) or, for faces that touch finer cells, at
 * the middle: inside there joins the insides, outside the outsides.
 *
 * Corner i of a cell is at (i & 1, i >> 1 & 1, i >> 2 & 1). Edge 4 * axis + j runs along the axis, from the corner
 * whose other two coordinates are the bits of j, lower axis first.
 */
#ifndef BLOB_MESH_CELL_H
#define BLOB_MESH_CELL_H

#include <float.h>
#include <string.h>

#include "mesh.h"

/* Vertices of a cell: 12 edges, or on the lattice of half cells (27 nodes x + 3 y + 9 z): 27 * axis + node; 81 + edge.
 */
enum { CELL_VERTICES = 93, CELL_WHOLE = 81, CELL_FACES = 24, CELL_LOOP = 96, CELL_SHORT = 12 };

/* A face: its nodes counter-clockwise from outside, edge i from node i to the next. */
typedef struct cell_face {
    int count, joins;
    uint8_t inside[8];
    int8_t vertex[8]; /* what edge i is called */
} cell_face;

typedef struct cell_loops {
    int8_t next[CELL_VERTICES];    /* along the surface; -1: none */
    uint32_t faces[CELL_VERTICES]; /* four bits for each side: its faces */
} cell_loops;

/* Segments of a face. Going round, edges leave and enter the inside by turns: each that leaves is joined to the
 * next that enters (around an outside, when the insides are joined) or to the one before. */
static void cell_add_face(cell_loops *loops, const cell_face *face, int number) {
    for (int i = 0; i < face->count; i++) {
        const int next = i + 1 < face->count ? i + 1 : 0;
        if (face->inside[i] == face->inside[next]) continue;
        loops->faces[face->vertex[i]] |= 1u << number;
        if (!face->inside[i]) continue;
        int j = i;
        do {
            j = face->joins ? j + 1 : j - 1;
            if (j == face->count) j = 0;
            if (j < 0) j = face->count - 1;
        } while (face->inside[j] || !face->inside[j + 1 < face->count ? j + 1 : 0]);
        loops->next[face->vertex[i]] = face->vertex[j];
    }
}

static void cell_clear(cell_loops *loops) {
    memset(loops->next, -1, sizeof loops->next);
    memset(loops->faces, 0, sizeof loops->faces);
}

/* Takes a loop out; returns its length, 0: none is left. */
static int cell_take(cell_loops *loops, int *from, int8_t *loop) {
    while (*from < CELL_VERTICES && loops->next[*from] < 0) ++*from;
    int n = 0;
    for (int v = *from; v < CELL_VERTICES && v >= 0 && loops->next[v] >= 0;) {
        const int after = loops->next[v];
        loop[n++] = (int8_t)v;
        loops->next[v] = -1;
        v = after;
    }
    return n;
}

static double cell_distance2(const double *a, const double *b) {
    return (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]);
}

/* The sides of a cell that a vertex lies on, as one bit of four each. */
static uint32_t cell_sides(const cell_loops *loops, int vertex) {
    const uint32_t faces = loops->faces[vertex];
    return (faces | faces >> 1 | faces >> 2 | faces >> 3) & 0x111111u;
}

/* Does all of a loop lie on one side? */
static int cell_is_flat(const cell_loops *loops, const int8_t *loop, int n) {
    uint32_t sides = 0x111111u;
    for (int i = 0; i < n; i++) sides &= cell_sides(loops, loop[i]);
    return sides != 0;
}

/* Triangles of a loop without diagonals in a side, with the least sum of squared diagonals: as triples of places
 * in the loop. at: places of its vertices. Returns how many, 0 where there is no such triangulation. */
static int cell_triangulate(const cell_loops *loops, const int8_t *loop, int n, double (*at)[3], uint8_t *triangles) {
    double cost[CELL_SHORT][CELL_SHORT];
    int8_t split[CELL_SHORT][CELL_SHORT];
    if (n > CELL_SHORT || cell_is_flat(loops, loop, n)) return 0;
    for (int span = 1; span < n; span++) {
        for (int i = 0; i + span < n; i++) {
            const int j = i + span, side = span == 1 || span == n - 1;
            cost[i][j] = span == 1 ? 0.0 : DBL_MAX;
            if (span == 1 || (!side && cell_sides(loops, loop[i]) & cell_sides(loops, loop[j]))) continue;
            for (int k = i + 1; k < j; k++) {
                if (cost[i][k] == DBL_MAX || cost[k][j] == DBL_MAX) continue;
                const double sum = cost[i][k] + cost[k][j] + (side ? 0.0 : cell_distance2(at[i], at[j]));
                if (sum < cost[i][j]) cost[i][j] = sum, split[i][j] = (int8_t)k;
            }
        }
    }
    if (cost[0][n - 1] == DBL_MAX) return 0;
    int stack[CELL_SHORT][2], top = 0, count = 0;
    stack[top][0] = 0, stack[top++][1] = n - 1;
    while (top > 0) {
        const int i = stack[--top][0], j = stack[top][1];
        if (j - i < 2) continue;
        const int k = split[i][j];
        triangles[3 * count] = (uint8_t)j, triangles[3 * count + 1] = (uint8_t)k, triangles[3 * count + 2] = (uint8_t)i;
        count++;
        stack[top][0] = i, stack[top++][1] = k;
        stack[top][0] = k, stack[top++][1] = j;
    }
    return count;
}

/* ---- whole cells ------------------------------------------------------------------------------------ */

/* Corners of face 2 * axis + side, counter-clockwise from outside. */
static void cell_corners(int face, int *corners) {
    const int axis = face >> 1, side = face & 1, u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (int i = 0; i < 4; i++) {
        const int at = side ? i : 3 - i;
        corners[i] = side << axis | (at == 1 || at == 2) << u | (at >= 2) << v;
    }
}

/* The edge between two neighbouring corners. */
static int cell_edge(int a, int b) {
    const int axis = (a ^ b) >> 1, low = a & b;
    return 4 * axis + (axis == 0 ? low >> 1 : axis == 1 ? (low & 1) | (low >> 1 & 2) : low & 3);
}

/* The lower corner of an edge. */
static int cell_edge_corner(int edge) {
    const int axis = edge >> 2, j = edge & 3;
    return axis == 0 ? j << 1 : axis == 1 ? (j & 1) | (j & 2) << 1 : j;
}

/* Faces of a cell whose corners' signs are the bits of mask; bit i of joins: of face i. */
static void cell_whole_loops(int mask, int joins, cell_loops *loops) {
    cell_clear(loops);
    for (int f = 0; f < 6; f++) {
        int corners[4];
        cell_face face = {.count = 4, .joins = joins >> f & 1};
        cell_corners(f, corners);
        for (int i = 0; i < 4; i++) {
            face.inside[i] = mask >> corners[i] & 1;
            face.vertex[i] = (int8_t)cell_edge(corners[i], corners[(i + 1) % 4]);
        }
        cell_add_face(loops, &face, 4 * f);
    }
}

static int cell_ambiguous(int mask, int face) {
    int corners[4];
    cell_corners(face, corners);
    const int a = mask >> corners[0] & 1, b = mask >> corners[1] & 1;
    return a != b && (mask >> corners[2] & 1) == a && (mask >> corners[3] & 1) == b;
}

static void cell_edge_middle(int edge, double *at) {
    const int corner = cell_edge_corner(edge);
    for (int k = 0; k < 3; k++) at[k] = k == edge >> 2 ? 0.5 : (double)(corner >> k & 1);
}

/* The table of all cells without ambiguous faces. */
static inline void cell_fill_table(mesh_case *cases) {
    memset(cases, 0, 256 * sizeof *cases);
    for (int mask = 0; mask < 256; mask++) {
        mesh_case *one = &cases[mask];
        for (int f = 0; f < 6; f++) one->ambiguous |= (uint8_t)(cell_ambiguous(mask, f) << f);
        if (one->ambiguous) continue;
        cell_loops loops;
        cell_whole_loops(mask, 0, &loops);
        int8_t loop[CELL_LOOP];
        int from = 0;
        for (int n; (n = cell_take(&loops, &from, loop)) > 0;) {
            double at[CELL_LOOP][3];
            uint8_t triangles[3 * CELL_SHORT];
            for (int i = 0; i < n; i++) cell_edge_middle(loop[i], at[i]);
            const int count = cell_triangulate(&loops, loop, n, at, triangles);
            for (int i = 0; i < 3 * count; i++) one->edge[3 * one->count + i] = (uint8_t)loop[triangles[i]];
            one->count = (uint8_t)(one->count + count);
        }
    }
}

#endif
