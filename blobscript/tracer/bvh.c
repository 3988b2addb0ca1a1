/* bvh.c - bounding volume hierarchy, the default index.
 *
 * Top down: the largest part of a node's items is split in two at the best of 16 bins along the widest
 * axis of their centres (surface area heuristic, Wald 2007) until there are eight parts. No sorting: a
 * level costs one pass to bin, from which the parts get their bounds, and one to partition.
 */
#include <math.h>

#include "builder.h"

enum { BVH_BINS = 16 };

/* Items, what is around them, and what is around their centres (doubled: lo + hi). */
typedef struct bvh_bin {
    index_box box, centers;
    int32_t count;
} bvh_bin;

typedef struct bvh_part {
    int32_t first;
    bvh_bin all;
} bvh_part;

static const bvh_bin BVH_NOTHING = {{{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}},
                                    {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}},
                                    0};

static void bvh_count(bvh_bin *bin, const index_item *item) {
    const index_box *box = &item->box;
    index_grow(&bin->box, box);
    for (int k = 0; k < 3; k++) {
        const float c = box->lo[k] + box->hi[k];
        bin->centers.lo[k] = index_min(bin->centers.lo[k], c);
        bin->centers.hi[k] = index_max(bin->centers.hi[k], c);
    }
    bin->count++;
}

static void bvh_merge(bvh_bin *bin, const bvh_bin *other) {
    index_grow(&bin->box, &other->box);
    index_grow(&bin->centers, &other->centers);
    bin->count += other->count;
}

static float bvh_cost(const bvh_bin *bin) { return index_area(&bin->box) * (float)bin->count; }

/* Bounds of items [first, first + count). */
static bvh_part bvh_measured(const index_item *items, int32_t first, int32_t count) {
    bvh_part part = {first, BVH_NOTHING};
    for (int32_t i = first; i < first + count; i++) bvh_count(&part.all, &items[i]);
    return part;
}

static int bvh_axis(const index_box *centers) {
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (centers->hi[k] - centers->lo[k] > centers->hi[axis] - centers->lo[axis]) axis = k;
    return axis;
}

/* The bin border with the least area * count on both sides: items of bins <= the result go left. */
static int bvh_best_border(const bvh_bin *bins) {
    float right_cost[BVH_BINS];
    bvh_bin side = BVH_NOTHING;
    for (int b = BVH_BINS - 1; b > 0; b--) {
        bvh_merge(&side, &bins[b]);
        right_cost[b] = bvh_cost(&side);
    }
    side = BVH_NOTHING;
    int best = 0;
    float best_cost = FLT_MAX;
    for (int b = 0; b < BVH_BINS - 1; b++) {
        bvh_merge(&side, &bins[b]);
        const float cost = bvh_cost(&side) + right_cost[b + 1];
        if (bins[b].count > 0 && cost < best_cost) best_cost = cost, best = b;
    }
    return best;
}

static int bvh_bin_of(const index_item *item, int axis, float lo, float per_bin) {
    const int bin = (int)((item->box.lo[axis] + item->box.hi[axis] - lo) * per_bin);
    return bin < BVH_BINS - 1 ? bin : BVH_BINS - 1;
}

/* Coincident centres: by count. */
static void bvh_halve(const index_item *items, bvh_part *left, bvh_part *right) {
    const int32_t first = left->first, count = left->all.count;
    *left = bvh_measured(items, first, count / 2);
    *right = bvh_measured(items, first + count / 2, count - count / 2);
}

/* Split a part in two; both get items. */
static void bvh_split(index_item *items, bvh_part *left, bvh_part *right, int depth) {
    const int axis = bvh_axis(&left->all.centers);
    const float lo = left->all.centers.lo[axis], width = left->all.centers.hi[axis] - lo;
    const float per_bin = (float)BVH_BINS / width;
    if (!(width > 0.0f && width < FLT_MAX && per_bin < FLT_MAX && depth <= INDEX_DEEP)) {
        bvh_halve(items, left, right);
        return;
    }
    const int32_t first = left->first, end = first + left->all.count;
    bvh_bin bins[BVH_BINS];
    for (int b = 0; b < BVH_BINS; b++) bins[b] = BVH_NOTHING;
    for (int32_t i = first; i < end; i++) bvh_count(&bins[bvh_bin_of(&items[i], axis, lo, per_bin)], &items[i]);
    const int border = bvh_best_border(bins); /* the first and the last bin are never empty */
    int32_t i = first, j = end;
    while (i < j) {
        if (bvh_bin_of(&items[i], axis, lo, per_bin) <= border) {
            i++;
        } else {
            const index_item swap = items[i];
            items[i] = items[--j];
            items[j] = swap;
        }
    }
    *left = (bvh_part){first, BVH_NOTHING};
    *right = (bvh_part){i, BVH_NOTHING};
    for (int b = 0; b < BVH_BINS; b++) bvh_merge(b <= border ? &left->all : &right->all, &bins[b]);
}

/* The part that is worth splitting most; -1: none is. */
static int bvh_largest(const bvh_part *parts, int count) {
    int largest = -1;
    float most = -1.0f;
    for (int i = 0; i < count; i++) {
        const float cost = bvh_cost(&parts[i].all);
        if (parts[i].all.count > INDEX_LEAF && cost > most) largest = i, most = cost;
    }
    return largest;
}

static index_slot bvh_node(index_builder *builder, const bvh_part *whole, int depth) {
    if (whole->all.count <= INDEX_LEAF || builder->failed)
        return index_leaf(builder, builder->items + whole->first, whole->all.count);
    bvh_part parts[INDEX_WIDTH] = {*whole};
    index_slot slots[INDEX_WIDTH];
    int count = 1;
    while (count < INDEX_WIDTH) {
        const int largest = bvh_largest(parts, count);
        if (largest < 0) break;
        bvh_split(builder->items, &parts[largest], &parts[count++], depth);
    }
    for (int i = 0; i < count; i++) slots[i] = bvh_node(builder, &parts[i], depth + 1);
    return index_join(builder, slots, count);
}

index_slot bvh_build(index_builder *builder) {
    const bvh_part whole = bvh_measured(builder->items, 0, builder->count);
    return bvh_node(builder, &whole, 0);
}
