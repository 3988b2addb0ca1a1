/* builder.h - what index.c offers the builders of trees, and what it asks of them.
 *
 * A builder divides `items` and returns the top of its tree, made bottom up of leaves (index_leaf) and nodes
 * (index_join). Trees depend on the scene alone. When memory runs out, `failed` is set and what is
 * returned no longer matters.
 */
#ifndef BLOB_BUILDER_H
#define BLOB_BUILDER_H

#include <float.h>
#include <math.h>

#include "index.h"

typedef struct index_box {
    float lo[3], hi[3];
} index_box;

/* An element of a surface or a triangle of a mesh, with its box. A builder may also use it for a run of items:
 * id is the first, count how many. */
typedef struct index_item {
    index_box box;
    int32_t id, count;
} index_item;

/* What a child of a node is: a node or a leaf, as in index_node. */
typedef struct index_slot {
    index_box box;
    int32_t child, count; /* count 0: nothing */
} index_slot;

typedef struct index_builder {
    index_item *items; /* of the surface or mesh at hand; a builder may permute them */
    int32_t count;     /* > 0 */
    index_box box;     /* around the items */
    double reach;      /* mean of half the widest side of their boxes */
    index_node *nodes;
    int32_t *order; /* what the leaves list */
    int32_t node_count, node_room, order_count, order_room;
    int failed;
} index_builder;

static const index_box INDEX_EMPTY = {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};

static inline float index_min(float a, float b) { return a < b ? a : b; }
static inline float index_max(float a, float b) { return a > b ? a : b; }

static inline void index_grow(index_box *box, const index_box *other) {
    for (int k = 0; k < 3; k++) {
        box->lo[k] = index_min(box->lo[k], other->lo[k]);
        box->hi[k] = index_max(box->hi[k], other->hi[k]);
    }
}

/* Half the surface; 0: empty. */
static inline float index_area(const index_box *box) {
    const float x = box->hi[0] - box->lo[0], y = box->hi[1] - box->lo[1], z = box->hi[2] - box->lo[2];
    return x < 0.0f ? 0.0f : x * y + y * z + z * x;
}

/* Packed scenes are about 1 in size. Whatever else they say, sums and differences of boxes stay finite. */
static inline float index_float(double value) {
    const double most = (double)FLT_MAX / 8.0;
    return (float)(value > most ? most : value < -most ? -most : value);
}

/* Rounded outwards, by two places at most. */
static inline float index_down(double value) {
    const float f = index_float(value);
    return (double)f > value ? f - fabsf(f) * FLT_EPSILON - FLT_MIN : f;
}

static inline float index_up(double value) {
    const float f = index_float(value);
    return (double)f < value ? f + fabsf(f) * FLT_EPSILON + FLT_MIN : f;
}

/* A leaf of `count` items whose ids the caller writes to *ids; its box is empty yet. NULL: no memory. */
index_slot index_open_leaf(index_builder *builder, int32_t count, int32_t **ids);
index_slot index_leaf(index_builder *builder, const index_item *items, int32_t count);
/* A node of at most INDEX_WIDTH children that are something; of one child: that child. */
index_slot index_join(index_builder *builder, const index_slot *slots, int count);

/* Bring the items of each octant around `middle` together; begin[o] to begin[o + 1] are those of octant o. Items
 * belong where their centre is; `middle` is in terms of doubled centres, lo + hi of a box. */
void octree_sort(index_item *items, int32_t count, const double *middle, int32_t *begin);
/* The smallest cube around all centres, doubled likewise: its middle and half its side. */
double octree_cube(const index_builder *builder, double *middle);

index_slot bvh_build(index_builder *builder);
index_slot grid_build(index_builder *builder);
index_slot octree_build(index_builder *builder);
index_slot bsp_build(index_builder *builder);

#endif
