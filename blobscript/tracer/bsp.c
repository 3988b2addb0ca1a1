/* bsp.c - binary space partition by planes across the axes (a k-d tree); an element on both sides of a plane
 * is listed on both.
 *
 * A cell is cut across its longest axis at the best of 15 planes (surface area heuristic, MacDonald and
 * Booth 1990), as long as that promises less work. A budget of BSP_REPEATS listings for each element, shared
 * out among the two sides of each cut, bounds the memory. Cells shrink to the elements within them, which
 * cuts off empty space; three levels of cuts make a node of the tree of boxes.
 */
#include <stdlib.h>

#include "builder.h"

enum { BSP_PLANES = 15, BSP_LEVELS = 3, BSP_REPEATS = 6 };
/* What visiting one more box costs, in elements. */
static const float BSP_VISIT = 1.0f;

/* Items list[0 .. count), cut to a cell whose box fits them; at most `room` listings below. */
typedef struct bsp_cell {
    int32_t *list;
    int32_t count;
    int64_t room;
    index_box box;
} bsp_cell;

typedef struct bsp_cut {
    int axis;
    float plane;
    int32_t left, right; /* elements on each side */
} bsp_cut;

static index_box bsp_clipped(const index_box *box, const index_box *cell) {
    index_box part;
    for (int k = 0; k < 3; k++) {
        part.lo[k] = box->lo[k] > cell->lo[k] ? box->lo[k] : cell->lo[k];
        part.hi[k] = box->hi[k] < cell->hi[k] ? box->hi[k] : cell->hi[k];
    }
    return part;
}

/* Shrink the box of a cell to its items. */
static void bsp_fit(const index_builder *builder, bsp_cell *cell) {
    index_box fitted = INDEX_EMPTY;
    for (int32_t i = 0; i < cell->count; i++) {
        const index_box part = bsp_clipped(&builder->items[cell->list[i]].box, &cell->box);
        index_grow(&fitted, &part);
    }
    cell->box = fitted;
}

/* How many of the rising planes are below x. */
static int bsp_below(const float *planes, float x, float lo, float per_plane) {
    const float guess = (x - lo) * per_plane;
    int n = guess < 0.0f ? 0 : guess < (float)BSP_PLANES ? (int)guess : BSP_PLANES;
    while (n > 0 && !(planes[n - 1] < x)) n--;
    while (n < BSP_PLANES && planes[n] < x) n++;
    return n;
}

/* An item is right of a plane if it ends above it, left if it begins below or is not right. */
static int bsp_is_right(const index_box *box, const bsp_cut *cut) { return box->hi[cut->axis] > cut->plane; }
static int bsp_is_left(const index_box *box, const bsp_cut *cut) {
    return box->lo[cut->axis] < cut->plane || !bsp_is_right(box, cut);
}

/* The cut of least cost; 0 where none is better than leaving the cell whole. */
static int bsp_best_cut(const index_builder *builder, const bsp_cell *cell, bsp_cut *best) {
    const index_box *box = &cell->box;
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (box->hi[k] - box->lo[k] > box->hi[axis] - box->lo[axis]) axis = k;
    const float lo = box->lo[axis], width = box->hi[axis] - lo, per_plane = (float)(BSP_PLANES + 1) / width;
    if (!(width > 0.0f && per_plane < FLT_MAX)) return 0;
    float planes[BSP_PLANES];
    for (int p = 0; p < BSP_PLANES; p++) planes[p] = lo + width * ((float)(p + 1) / (float)(BSP_PLANES + 1));
    int32_t ends[BSP_PLANES + 1] = {0}, begins[BSP_PLANES + 1] = {0}; /* by the number of planes below */
    for (int32_t i = 0; i < cell->count; i++) {
        const index_box *item = &builder->items[cell->list[i]].box;
        const int end = bsp_below(planes, item->hi[axis], lo, per_plane);
        int begin = 0;
        while (begin < end && planes[begin] <= item->lo[axis]) begin++;
        begins[begin]++;
        ends[end]++;
    }
    const float whole = index_area(box) * (float)cell->count;
    float least = whole - BSP_VISIT * index_area(box);
    int32_t left = 0, right = cell->count;
    int found = 0;
    for (int p = 0; p < BSP_PLANES; p++) {
        left += begins[p];
        right -= ends[p];
        if ((int64_t)left + right > cell->room || left == cell->count || right == cell->count) continue;
        index_box below = *box, above = *box;
        below.hi[axis] = above.lo[axis] = planes[p];
        const float cost = index_area(&below) * (float)left + index_area(&above) * (float)right;
        if (cost < least) least = cost, *best = (bsp_cut){axis, planes[p], left, right}, found = 1;
    }
    return found;
}

/* Lists the items left of the cut in place and those right of it from `room` on. */
static void bsp_divide(const index_builder *builder, const bsp_cell *cell, const bsp_cut *cut, int32_t *room,
                       bsp_cell *left, bsp_cell *right) {
    const int64_t share = (int64_t)((double)cell->room * ((double)cut->left / ((double)cut->left + cut->right)));
    *left = (bsp_cell){cell->list, 0, share > cut->left ? share : cut->left, cell->box};
    *right = (bsp_cell){room, 0, cell->room - left->room, cell->box};
    left->box.hi[cut->axis] = right->box.lo[cut->axis] = cut->plane;
    for (int32_t i = 0; i < cell->count; i++) {
        const int32_t item = cell->list[i];
        const index_box *box = &builder->items[item].box;
        if (bsp_is_right(box, cut)) right->list[right->count++] = item;
        if (bsp_is_left(box, cut)) left->list[left->count++] = item;
    }
}

static index_slot bsp_leaf(index_builder *builder, const bsp_cell *cell) {
    int32_t *ids;
    index_slot slot = index_open_leaf(builder, cell->count, &ids);
    for (int32_t i = 0; ids && i < cell->count; i++) ids[i] = builder->items[cell->list[i]].id;
    slot.box = cell->box;
    return slot;
}

/* Cuts a cell until `level` reaches BSP_LEVELS, where another node begins; appends what comes out to `slots`.
 * `room` is free from there on: for lists at most as long together as the cell's own room. */
static void bsp_gather(index_builder *builder, bsp_cell cell, int32_t *room, int level, int depth, index_slot *slots,
                       int *count) {
    bsp_cut cut;
    bsp_cell left, right;
    if (level == BSP_LEVELS) {
        index_slot below[INDEX_WIDTH];
        int used = 0;
        bsp_gather(builder, cell, room, 0, depth, below, &used);
        slots[(*count)++] = index_join(builder, below, used);
        return;
    }
    bsp_fit(builder, &cell);
    if (cell.count <= INDEX_LEAF || depth == INDEX_DEEP || builder->failed || !bsp_best_cut(builder, &cell, &cut)) {
        slots[(*count)++] = bsp_leaf(builder, &cell);
        return;
    }
    bsp_divide(builder, &cell, &cut, room, &left, &right);
    bsp_gather(builder, left, room + right.count, level + 1, depth + 1, slots, count);
    /* the left list is done with: move the right one there */
    for (int32_t i = 0; i < right.count; i++) cell.list[i] = right.list[i];
    right.list = cell.list;
    bsp_gather(builder, right, room, level + 1, depth + 1, slots, count);
}

index_slot bsp_build(index_builder *builder) {
    const int64_t room = (int64_t)BSP_REPEATS * builder->count;
    int32_t *lists = malloc(((size_t)builder->count + (size_t)room) * sizeof *lists);
    index_slot slots[INDEX_WIDTH] = {{INDEX_EMPTY, -1, 0}};
    int count = 0;
    if (!lists) {
        builder->failed = 1;
        return slots[0];
    }
    for (int32_t i = 0; i < builder->count; i++) lists[i] = i;
    const bsp_cell all = {lists, builder->count, room, builder->box};
    bsp_gather(builder, all, lists + builder->count, 0, 0, slots, &count);
    free(lists);
    return index_join(builder, slots, count);
}
