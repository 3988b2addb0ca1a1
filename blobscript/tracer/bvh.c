/* bvh.c - bounding volume hierarchy, the default index.
 *
 * Top down: the largest part of a node's items is split in two at the best of 16 bins along the widest
 * axis of their centres (surface area heuristic, Wald 2007) until there are eight parts. A level costs one
 * pass to bin, from which the parts get their bounds, and one to partition. Where there are many items the
 * upper levels split runs of up to BVH_RUN neighbours instead, which octants bring together first (after
 * Garanzha, Pantaleoni and McAllister, Simpler and faster HLBVH, 2011): half the time, and rays open some
 * twentieth more nodes.
 */
#include <stdlib.h>

#include "builder.h"

enum { BVH_BINS = 16, BVH_RUN = 64, BVH_MANY = 1 << 16 };

/* What is around items, and around their centres (doubled: lo + hi). */
typedef struct bvh_bin {
    index_box box, centers;
    int32_t count;
} bvh_bin;

/* things[0 .. number): items, or runs of them. */
typedef struct bvh_part {
    index_item *things;
    int32_t number, is_runs;
    bvh_bin all;
} bvh_part;

/* Runs of a tree's items, as they are found. */
typedef struct bvh_runs {
    index_builder *builder;
    index_item *runs;
    int32_t count;
} bvh_runs;

static const bvh_bin BVH_NOTHING = {{{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}},
                                    {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}},
                                    0};

static void bvh_count(bvh_bin *bin, const index_item *thing) {
    const index_box *box = &thing->box;
    index_grow(&bin->box, box);
    for (int k = 0; k < 3; k++) {
        const float c = box->lo[k] + box->hi[k];
        bin->centers.lo[k] = index_min(bin->centers.lo[k], c);
        bin->centers.hi[k] = index_max(bin->centers.hi[k], c);
    }
    bin->count += thing->count;
}

static void bvh_merge(bvh_bin *bin, const bvh_bin *other) {
    index_grow(&bin->box, &other->box);
    index_grow(&bin->centers, &other->centers);
    bin->count += other->count;
}

static bvh_part bvh_measured(index_item *things, int32_t number, int32_t is_runs) {
    bvh_part part = {things, number, is_runs, BVH_NOTHING};
    for (int32_t i = 0; i < number; i++) bvh_count(&part.all, &things[i]);
    return part;
}

/* ---- splitting ------------------------------------------------------------------------------------ */

/* The bin border with the least area * count on both sides: things in bins <= the result go left. */
static int bvh_best_border(const bvh_bin *bins) {
    float right_cost[BVH_BINS];
    index_box box = INDEX_EMPTY;
    int32_t count = 0;
    for (int b = BVH_BINS - 1; b > 0; b--) {
        index_grow(&box, &bins[b].box);
        count += bins[b].count;
        right_cost[b] = index_area(&box) * (float)count;
    }
    box = INDEX_EMPTY;
    count = 0;
    int best = 0;
    float best_cost = FLT_MAX;
    for (int b = 0; b < BVH_BINS - 1; b++) {
        index_grow(&box, &bins[b].box);
        count += bins[b].count;
        const float cost = index_area(&box) * (float)count + right_cost[b + 1];
        if (bins[b].count > 0 && cost < best_cost) best_cost = cost, best = b;
    }
    return best;
}

/* Where centres lie along an axis. */
typedef struct bvh_scale {
    int axis;
    float lo, per_bin;
} bvh_scale;

static int bvh_bin_of(const index_item *thing, const bvh_scale *scale) {
    const float center = thing->box.lo[scale->axis] + thing->box.hi[scale->axis];
    const int bin = (int)((center - scale->lo) * scale->per_bin);
    return bin < BVH_BINS - 1 ? bin : BVH_BINS - 1;
}

/* Bins along the widest axis; 0: the centres coincide. */
static int bvh_measure(const bvh_part *part, bvh_scale *scale) {
    const index_box *centers = &part->all.centers;
    scale->axis = 0;
    for (int k = 1; k < 3; k++)
        if (centers->hi[k] - centers->lo[k] > centers->hi[scale->axis] - centers->lo[scale->axis]) scale->axis = k;
    const float width = centers->hi[scale->axis] - centers->lo[scale->axis];
    scale->lo = centers->lo[scale->axis];
    scale->per_bin = (float)BVH_BINS / width;
    return width > 0.0f && scale->per_bin < FLT_MAX;
}

/* Things in bins <= border first. Returns how many they are. */
static int32_t bvh_partition(const bvh_part *part, const bvh_scale *scale, int border) {
    index_item *things = part->things;
    int32_t i = 0, j = part->number;
    while (i < j) {
        if (bvh_bin_of(&things[i], scale) <= border) {
            i++;
        } else {
            const index_item swap = things[i];
            things[i] = things[--j];
            things[j] = swap;
        }
    }
    return i;
}

/* A part of one run becomes a part of its items. */
static void bvh_open(index_builder *builder, bvh_part *part) {
    if (!part->is_runs || part->number > 1) return;
    const index_item *run = part->things;
    *part = bvh_measured(builder->items + run->id, run->count, 0);
}

/* Split a part in two; both get something. */
static void bvh_split(index_builder *builder, bvh_part *left, bvh_part *right, int depth) {
    bvh_open(builder, left);
    const bvh_part whole = *left;
    bvh_scale scale;
    if (depth > INDEX_DEEP || !bvh_measure(&whole, &scale)) {
        const int32_t half = whole.number / 2;
        *left = bvh_measured(whole.things, half, whole.is_runs);
        *right = bvh_measured(whole.things + half, whole.number - half, whole.is_runs);
        return;
    }
    bvh_bin bins[BVH_BINS];
    for (int b = 0; b < BVH_BINS; b++) bins[b] = BVH_NOTHING;
    for (int32_t i = 0; i < whole.number; i++) bvh_count(&bins[bvh_bin_of(&whole.things[i], &scale)], &whole.things[i]);
    const int border = bvh_best_border(bins); /* the first and the last bin are never empty */
    const int32_t middle = bvh_partition(&whole, &scale, border);
    *left = (bvh_part){whole.things, middle, whole.is_runs, BVH_NOTHING};
    *right = (bvh_part){whole.things + middle, whole.number - middle, whole.is_runs, BVH_NOTHING};
    for (int b = 0; b < BVH_BINS; b++) bvh_merge(b <= border ? &left->all : &right->all, &bins[b]);
}

/* ---- nodes ------------------------------------------------------------------------------------------ */

static index_slot bvh_leaf(index_builder *builder, const bvh_part *part) {
    int32_t *ids;
    index_slot slot = index_open_leaf(builder, part->all.count, &ids);
    slot.box = part->all.box;
    for (int32_t i = 0; ids && i < part->number; i++) {
        const index_item *thing = &part->things[i];
        if (!part->is_runs) *ids++ = thing->id;
        else
            for (int32_t j = 0; j < thing->count; j++) *ids++ = builder->items[thing->id + j].id;
    }
    return slot;
}

/* The part that is worth splitting most; -1: none is. */
static int bvh_largest(const bvh_part *parts, int count) {
    int largest = -1;
    float most = -1.0f;
    for (int i = 0; i < count; i++) {
        const float cost = index_area(&parts[i].all.box) * (float)parts[i].all.count;
        if (parts[i].all.count > INDEX_LEAF && cost > most) largest = i, most = cost;
    }
    return largest;
}

static index_slot bvh_node(index_builder *builder, const bvh_part *whole, int depth) {
    if (whole->all.count <= INDEX_LEAF || builder->failed) return bvh_leaf(builder, whole);
    bvh_part parts[INDEX_WIDTH] = {*whole};
    index_slot slots[INDEX_WIDTH];
    int count = 1;
    while (count < INDEX_WIDTH) {
        const int largest = bvh_largest(parts, count);
        if (largest < 0) break;
        bvh_split(builder, &parts[largest], &parts[count++], depth);
    }
    for (int i = 0; i < count; i++) slots[i] = bvh_node(builder, &parts[i], depth + 1);
    return index_join(builder, slots, count);
}

/* ---- runs --------------------------------------------------------------------------------------------- */

/* Halve a cube of doubled centres until BVH_RUN items are left; those are a run. */
static void bvh_gather(bvh_runs *runs, int32_t first, int32_t count, const double *middle, double half, int depth) {
    index_item *items = runs->builder->items + first;
    if (count <= BVH_RUN || depth == INDEX_DEEP) {
        index_item *run = &runs->runs[runs->count++];
        *run = (index_item){INDEX_EMPTY, first, count};
        for (int32_t i = 0; i < count; i++) index_grow(&run->box, &items[i].box);
        return;
    }
    int32_t begin[9];
    octree_sort(items, count, middle, begin);
    for (int o = 0; o < 8; o++) {
        double below[3];
        for (int k = 0; k < 3; k++) below[k] = middle[k] + (o >> k & 1 ? 0.5 : -0.5) * half;
        if (begin[o + 1] > begin[o])
            bvh_gather(runs, first + begin[o], begin[o + 1] - begin[o], below, 0.5 * half, depth + 1);
    }
}

index_slot bvh_build(index_builder *builder) {
    bvh_runs runs = {.builder = builder};
    bvh_part whole;
    if (builder->count >= BVH_MANY) {
        runs.runs = malloc((size_t)builder->count * sizeof *runs.runs);
        if (!runs.runs) {
            builder->failed = 1;
            return (index_slot){INDEX_EMPTY, -1, 0};
        }
        double middle[3];
        const double half = octree_cube(builder, middle);
        bvh_gather(&runs, 0, builder->count, middle, half, half > 0.0 ? 0 : INDEX_DEEP);
        whole = bvh_measured(runs.runs, runs.count, 1);
    } else {
        whole = bvh_measured(builder->items, builder->count, 0);
    }
    const index_slot top = bvh_node(builder, &whole, 0);
    free(runs.runs);
    return top;
}
