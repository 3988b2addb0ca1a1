/* index.h - the spatial index of a scene: one tree of boxes per surface and mesh, eight children to a node.
 *
 * Items are the elements of the surface, permuted so that each leaf is a contiguous run. Boxes are
 * where densities are not zero, rounded outwards to float.
 */
#ifndef BLOB_INDEX_H
#define BLOB_INDEX_H

#include "scene.h"

enum { INDEX_WIDTH = 8, INDEX_LEAF = 8 };
/* Nodes deeper than INDEX_DEEP are split by count, so no path is longer than INDEX_DEEP + 11 (8^11 > 2^31) and a
 * walk that keeps the siblings of its path needs room for fewer than INDEX_STACK entries. */
enum { INDEX_DEEP = 32, INDEX_STACK = 512 };

/* child[i] >= 0: a node; < 0: the leaf of items [~child[i], ~child[i] + count[i]). Unused children
 * have count 0 and an empty box (lo > hi). */
typedef struct index_node {
    float lo[3][INDEX_WIDTH], hi[3][INDEX_WIDTH];
    int32_t child[INDEX_WIDTH], count[INDEX_WIDTH];
} index_node;

typedef struct index_tree {
    int32_t node_begin, node_end; /* the first is the root; none where the surface has no elements */
    int32_t item_begin, item_end;
    double lo[3], hi[3];  /* packed box around the items */
    double typical_reach; /* mean distance at which densities end */
    int32_t depth;        /* of the surface's tree of nodes; 0: one sum of elements */
} index_tree;

struct blob_index {
    const blob_scene *scene;
    int32_t kind;
    int32_t tree_count, node_count, item_count;
    int32_t mesh_count, triangle_count;
    index_tree *trees;      /* one per surface */
    index_tree *mesh_trees; /* one per mesh, over its triangles */
    int32_t *mesh_order;    /* item -> triangle, counted from the mesh's first */
    index_node *nodes;
    int32_t *order;                /* item -> element */
    double *x, *y, *z, *reach;     /* bounding spheres of the items */
};

/* Box of element e in packed coordinates; lo and hi have room for 3. */
void index_element_box(const blob_scene *scene, int32_t e, double *lo, double *hi);

#endif
