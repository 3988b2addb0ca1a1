/* index.h - the spatial index of a scene: one tree of boxes per surface and mesh, eight children to a node.
 *
 * Every kind of index is such a tree; they differ in how they divide space (bvh.c, grid.c, octree.c, bsp.c;
 * none: one leaf). What they all promise, and all that beam.h relies on: wherever a density is not zero,
 * some leaf that lists its element has a box around that point, and so have all nodes above. Boxes are
 * rounded outwards to float. Items are what leaves list, each leaf a contiguous run; where cells share
 * elements (`repeats`), an element is several items.
 */
#ifndef BLOB_INDEX_H
#define BLOB_INDEX_H

#include "scene.h"

enum { INDEX_WIDTH = 8, INDEX_LEAF = 8 };
/* Nodes of a bounding volume hierarchy deeper than INDEX_DEEP halve the runs of items, then the items, so no path is
 * longer than INDEX_DEEP + 62, and a walk that keeps the siblings of its path needs room for fewer than INDEX_STACK. */
enum { INDEX_DEEP = 32, INDEX_STACK = 768 };

/* child[i] >= 0: a node; < 0: the leaf of items [~child[i], ~child[i] + count[i]). Unused children
 * have count 0 and an empty box (lo > hi). */
typedef struct index_node {
    float lo[3][INDEX_WIDTH], hi[3][INDEX_WIDTH];
    int32_t child[INDEX_WIDTH], count[INDEX_WIDTH];
} index_node;

/* Around the triangles of each child of a mesh's node, beside its box: lo <= n . x <= hi with |n| <= 1; all 0 where
 * that is not worth it. */
typedef struct index_slab {
    float n[3][INDEX_WIDTH], lo[INDEX_WIDTH], hi[INDEX_WIDTH];
} index_slab;

typedef struct index_tree {
    int32_t root;         /* node; -1: the surface has no elements */
    int32_t depth;        /* of the surface's tree of nodes; 0: one sum of elements */
    int32_t kind;         /* KERNEL_*: one sum of points and lines, all with kernels of that kind; -1: not so */
    int32_t lines;        /* is any of those a line? */
    double lo[3], hi[3];  /* packed box around the elements */
    double typical_reach; /* mean distance at which densities end */
} index_tree;

struct blob_index {
    const blob_scene *scene;
    int32_t kind;
    int32_t repeats;  /* leaves share elements */
    int32_t is_large; /* larger than processors' caches: memory is asked for ahead */
    int32_t tree_count, node_count, item_count;
    int32_t mesh_count, triangle_count;
    index_tree *trees;      /* one per surface */
    index_tree *mesh_trees; /* one per mesh, over its triangles: a bounding volume hierarchy, whatever the kind */
    int32_t *mesh_order;    /* item -> triangle, counted from the mesh's first; a leaf begins at a multiple of
                               INDEX_WIDTH, and room that it leaves is filled with its last triangle */
    double *mesh_corners;   /* of INDEX_WIDTH items each: nine runs (corner, axis) of as many numbers */
    index_slab *mesh_slabs; /* of the nodes from mesh_node on */
    int32_t mesh_node;
    index_node *nodes;
    int32_t *order;            /* item -> element */
    double *x, *y, *z, *reach; /* bounding spheres of the items, readable 8 at a time */
};

#endif
