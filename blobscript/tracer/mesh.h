/* mesh.h - triangles for a surface: what mesh.c (bricks, threads, results) and mesh_engine.c share.
 *
 * Space is a grid of cells; 8 x 8 x 8 cells are a brick. Boxes that the bounds of mesh_box.h prove free of the
 * surface are dropped, the others are halved down to bricks (mesh_descend), and each brick is worked on alone
 * (mesh_brick.h). Where a brick may hide something smaller than its cells it is halved once more, into eight
 * bricks of half the cell; neighbours differ by one level at most (mesh_refine in mesh.c).
 *
 * Nodes of the grid are numbered in units of the finest cell, from the corner `lo`, so that a node has the same
 * coordinates, to the bit, in every brick that it belongs to. The field at a node is always computed along the
 * same row of nodes (mesh_brick.h), and elements that a list has in vain contribute exactly 0: all bricks agree
 * on every sign, hence on every triangle across their borders.
 */
#ifndef BLOB_MESH_H
#define BLOB_MESH_H

#include <stdatomic.h>

#include "index.h"

enum {
    MESH_CELLS = 8,              /* along a brick */
    MESH_NODES = MESH_CELLS + 1, /* with those of the far sides */
    MESH_NODE_COUNT = MESH_NODES * MESH_NODES * MESH_NODES,
    MESH_CELL_COUNT = MESH_CELLS * MESH_CELLS * MESH_CELLS,
    MESH_EDGE_COUNT = 3 * MESH_NODE_COUNT, /* axis * MESH_NODE_COUNT + lower node */
    MESH_WORDS = (MESH_EDGE_COUNT + 63) / 64,
    MESH_FOREIGN = 4096, /* codes of triangles from here on: edges of finer bricks */
    MESH_EXTRA = 16384,  /* from here on: vertices within a cell */
    MESH_CASE_TRIANGLES = 10
};

enum { MESH_GONE, MESH_LEAF, MESH_SPLIT }; /* states of a brick; GONE: proved free of the surface */

/* An edge of the grid: its lower node in finest units, and its level. */
typedef struct mesh_edge {
    int32_t node[3];
    int16_t axis, level;
} mesh_edge;

typedef struct mesh_brick {
    int32_t at[3]; /* in bricks of its level */
    int16_t level;
    uint8_t state;
    uint8_t queued;
    uint64_t ids; /* first of its elements in the pool */
    uint32_t id_count;
    uint32_t vertex_count, triangle_count, foreign_count, extra_count;
    uint32_t cells, undecided, hidden; /* not dropped; of those without a sign change; that may hide something */
    uint64_t first_vertex, first_triangle;
    double error;        /* farthest that the middle of a triangle was seen from the surface */
    double *vertices;    /* place and unit normal, scene units */
    uint16_t *triangles; /* three codes each */
    mesh_edge *foreign;
    uint64_t edges[MESH_WORDS]; /* the crossed edges that are its own, in the order of its vertices */
    uint16_t rank[MESH_WORDS];  /* set bits before each word */
} mesh_brick;

/* Triangles of a cell by the signs of its corners: edges as in mesh_cell.h. */
typedef struct mesh_case {
    uint8_t count, ambiguous; /* faces with two diagonal corners inside: not in the table */
    uint8_t edge[3 * MESH_CASE_TRIANGLES];
} mesh_case;

typedef struct mesh_list {
    int32_t *ids;
    size_t count, room;
} mesh_list;

typedef struct mesh_scratch mesh_scratch;

struct blob_mesher {
    const blob_scene *scene;
    const blob_index *index;
    const blob_surface *surface;
    int32_t surface_number, depth;
    int32_t levels;        /* cells may be halved that often */
    double lo[3], fine[3]; /* packed: corner of the grid, finest cell */
    int32_t end[3];        /* the grid's last node, finest units */
    int32_t clip;          /* what lies beyond the clip box counts as outside */
    double clip_lo[3], clip_hi[3];
    int32_t clip_first[3], clip_last[3]; /* nodes within it */
    double warp;                         /* nodes nearer to the surface than that are moved away from it */
    double magnitude;                    /* |coordinates| that rounding is relative to */
    double tolerance;                    /* bricks with a larger error are halved; 0: none for that */
    size_t byte_limit;                   /* of bricks and lists; 0: none */
    const volatile int32_t *cancel;
    mesh_brick *bricks;
    size_t brick_count, brick_room;
    mesh_list pool;
    uint32_t *table; /* of bricks by level and place, open addressing; UINT32_MAX: free */
    size_t table_size;
    uint32_t *queue; /* bricks to be worked on in this round */
    size_t queue_count, queue_room;
    atomic_size_t next, done, bytes;
    size_t visited; /* boxes whose bounds were taken */
    size_t vertex_count, triangle_count;
    mesh_case cases[256];
};

/* The brick of a level at a place; NULL: there is none. */
mesh_brick *mesh_find(const blob_mesher *mesher, int32_t level, const int32_t *at);
/* What is at the place of a brick: MESH_GONE also where only a coarser one is. */
static inline int mesh_state(const blob_mesher *mesher, int32_t level, const int32_t *at) {
    const mesh_brick *brick = mesh_find(mesher, level, at);
    return brick ? brick->state : MESH_GONE;
}
/* A new leaf with the given elements. */
blob_status mesh_add_brick(blob_mesher *mesher, int32_t level, const int32_t *at, const int32_t *ids, size_t count);
/* A leaf number that owns an edge: the one of the greatest place among those around it. NULL: none. */
mesh_brick *mesh_owner(const blob_mesher *mesher, const mesh_edge *edge);

#define MESH_DECLARE(ISA)                                                                                              \
    mesh_scratch *mesh_scratch_new_##ISA(void);                                                                        \
    void mesh_scratch_free_##ISA(mesh_scratch *scratch);                                                               \
    blob_status mesh_descend_##ISA(blob_mesher *mesher, mesh_scratch *scratch, int32_t level, const int32_t *at,       \
                                   int32_t size, const int32_t *ids, size_t count);                                    \
    blob_status mesh_work_##ISA(blob_mesher *mesher, mesh_scratch *scratch, mesh_brick *brick);

MESH_DECLARE(baseline)
#ifdef BLOB_X86
MESH_DECLARE(v3)
MESH_DECLARE(v4)
#endif

#endif
