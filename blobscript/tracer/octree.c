/* octree.c - hierarchical subdivision: a cube is halved along all three axes until few elements are left.
 *
 * An element belongs to the cell of its centre; the boxes of the tree are drawn around the elements, not the
 * cells, so none is listed twice. Cells with one occupied octant cost no node.
 */
#include "builder.h"

/* In terms of doubled centres, as octree_sort. */
typedef struct octree_cell {
    double middle[3], half;
    int depth;
} octree_cell;

static int octree_octant(const index_item *item, const double *middle) {
    int octant = 0;
    for (int k = 0; k < 3; k++) octant |= ((double)item->box.lo[k] + (double)item->box.hi[k] >= middle[k]) << k;
    return octant;
}

void octree_sort(index_item *items, int32_t count, const double *middle, int32_t *begin) {
    int32_t counts[8] = {0}, at[8];
    for (int32_t i = 0; i < count; i++) counts[octree_octant(&items[i], middle)]++;
    begin[0] = 0;
    for (int o = 0; o < 8; o++) at[o] = begin[o], begin[o + 1] = begin[o] + counts[o];
    for (int o = 0; o < 8; o++) {
        while (at[o] < begin[o + 1]) {
            const int home = octree_octant(&items[at[o]], middle);
            if (home != o) {
                const index_item swap = items[at[home]];
                items[at[home]] = items[at[o]];
                items[at[o]] = swap;
            }
            at[home]++;
        }
    }
}

static index_slot octree_node(index_builder *builder, int32_t first, int32_t count, octree_cell cell) {
    index_item *items = builder->items + first;
    if (count <= INDEX_LEAF || cell.depth == INDEX_DEEP || builder->failed) return index_leaf(builder, items, count);
    int32_t begin[9];
    index_slot slots[8];
    int used = 0;
    octree_sort(items, count, cell.middle, begin);
    for (int o = 0; o < 8; o++) {
        if (begin[o] == begin[o + 1]) continue;
        octree_cell below = {.half = 0.5 * cell.half, .depth = cell.depth + 1};
        for (int k = 0; k < 3; k++) below.middle[k] = cell.middle[k] + (o >> k & 1 ? below.half : -below.half);
        slots[used++] = octree_node(builder, first + begin[o], begin[o + 1] - begin[o], below);
    }
    return index_join(builder, slots, used);
}

double octree_cube(const index_builder *builder, double *middle) {
    double half = 0.0;
    for (int k = 0; k < 3; k++) {
        double lo = DBL_MAX, hi = -DBL_MAX;
        for (int32_t i = 0; i < builder->count; i++) {
            const double center = (double)builder->items[i].box.lo[k] + (double)builder->items[i].box.hi[k];
            if (center < lo) lo = center;
            if (center > hi) hi = center;
        }
        middle[k] = 0.5 * (lo + hi);
        if (0.5 * (hi - lo) > half) half = 0.5 * (hi - lo);
    }
    return half;
}

index_slot octree_build(index_builder *builder) {
    octree_cell whole = {.depth = 0};
    whole.half = octree_cube(builder, whole.middle);
    if (whole.half == 0.0) whole.depth = INDEX_DEEP; /* coincident: nothing to divide */
    return octree_node(builder, 0, builder->count, whole);
}
