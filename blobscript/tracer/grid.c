/* grid.c - cellular bucket sort: a uniform grid; an element is listed in every cell that its box overlaps.
 *
 * Cells are about GRID_CELL mean reaches wide, fewer than GRID_CELLS for each element and coarse enough that
 * elements are listed no more than GRID_REPEATS times in the mean, however large some of them are. Occupied
 * cells hang under blocks of 2 x 2 x 2 cells, those under blocks of blocks, and so on, which makes the grid
 * a tree of boxes like the others; boxes shrink to what is in them.
 */
#include <math.h>
#include <stdlib.h>

#include "builder.h"

enum { GRID_CELLS = 2, GRID_REPEATS = 8 };
static const double GRID_CELL = 3.0, GRID_MOST = 1e6; /* most along an axis */

typedef struct grid {
    index_builder *builder;
    int32_t dims[3];
    double lo[3], per_cell[3];
    float *planes[3];  /* where cells begin; dims + 1 each */
    int32_t *begin;    /* listings of cell c: [begin[c], begin[c + 1]) */
    int32_t *listings; /* items */
} grid;

/* Cells first[k] to last[k] along each axis. */
typedef struct grid_range {
    int32_t first[3], last[3];
} grid_range;

static int32_t grid_place(const grid *g, int k, float x) {
    const double at = ((double)x - g->lo[k]) * g->per_cell[k];
    return at < 0.0 ? 0 : at < (double)g->dims[k] ? (int32_t)at : g->dims[k] - 1;
}

static grid_range grid_of(const grid *g, const index_box *box) {
    grid_range range;
    for (int k = 0; k < 3; k++) {
        range.first[k] = grid_place(g, k, box->lo[k]);
        range.last[k] = grid_place(g, k, box->hi[k]);
    }
    return range;
}

static size_t grid_cell(const grid *g, int32_t x, int32_t y, int32_t z) {
    return ((size_t)z * (size_t)g->dims[1] + (size_t)y) * (size_t)g->dims[0] + (size_t)x;
}

/* ---- how fine ------------------------------------------------------------------------------------ */

/* Cells of this size in the box; the number of them all. */
static double grid_divide(grid *g, double size) {
    double cells = 1.0;
    for (int k = 0; k < 3; k++) {
        const index_box *box = &g->builder->box;
        const double width = (double)box->hi[k] - (double)box->lo[k];
        g->dims[k] = width > size ? (int32_t)(width / size) : 1;
        g->lo[k] = (double)box->lo[k];
        g->per_cell[k] = width > 0.0 ? (double)g->dims[k] / width : 0.0;
        cells *= (double)g->dims[k];
    }
    return cells;
}

/* Listings of all elements, or more than `most`. */
static double grid_listings(const grid *g, double most) {
    double sum = 0.0;
    for (int32_t i = 0; i < g->builder->count && sum <= most; i++) {
        const grid_range range = grid_of(g, &g->builder->items[i].box);
        double cells = 1.0;
        for (int k = 0; k < 3; k++) cells *= (double)(range.last[k] - range.first[k] + 1);
        sum += cells;
    }
    return sum;
}

/* The finest grid within bounds. One cell always is. */
static void grid_choose(grid *g) {
    const double count = (double)g->builder->count;
    const index_box *box = &g->builder->box;
    double size = GRID_CELL * g->builder->reach;
    for (int k = 0; k < 3; k++) size = fmax(size, ((double)box->hi[k] - (double)box->lo[k]) / GRID_MOST);
    for (;; size *= 1.25) {
        const double cells = grid_divide(g, size);
        if (cells == 1.0) return;
        if (cells <= GRID_CELLS * count && grid_listings(g, GRID_REPEATS * count) <= GRID_REPEATS * count) return;
    }
}

/* ---- filling the cells ------------------------------------------------------------------------------ */

static int grid_allocate(grid *g) {
    const size_t cells = grid_cell(g, 0, 0, g->dims[2]);
    const double listings = grid_listings(g, DBL_MAX);
    for (int k = 0; k < 3; k++) g->planes[k] = malloc(((size_t)g->dims[k] + 1) * sizeof(float));
    g->begin = calloc(cells + 2, sizeof *g->begin);
    if (listings <= (double)INT32_MAX) g->listings = malloc((size_t)listings * sizeof *g->listings);
    return g->planes[0] && g->planes[1] && g->planes[2] && g->begin && g->listings;
}

static void grid_free(grid *g) {
    for (int k = 0; k < 3; k++) free(g->planes[k]);
    free(g->begin);
    free(g->listings);
}

/* Count the listings of each cell, then place them; begin[c + 1] moves from the beginning of c to its end. */
static void grid_fill(grid *g) {
    const size_t cells = grid_cell(g, 0, 0, g->dims[2]);
    for (int place = 0; place < 2; place++) {
        for (int32_t i = 0; i < g->builder->count; i++) {
            const grid_range r = grid_of(g, &g->builder->items[i].box);
            for (int32_t z = r.first[2]; z <= r.last[2]; z++)
                for (int32_t y = r.first[1]; y <= r.last[1]; y++)
                    for (int32_t x = r.first[0]; x <= r.last[0]; x++) {
                        const size_t cell = grid_cell(g, x, y, z);
                        if (place) g->listings[g->begin[cell + 1]++] = i;
                        else g->begin[cell + 2]++;
                    }
        }
        for (size_t c = 0; !place && c < cells; c++) g->begin[c + 2] += g->begin[c + 1];
    }
    for (int k = 0; k < 3; k++)
        for (int32_t i = 0; i <= g->dims[k]; i++)
            g->planes[k][i] = (float)(g->per_cell[k] > 0.0 ? g->lo[k] + (double)i / g->per_cell[k] : g->lo[k]);
}

/* ---- the tree of blocks -------------------------------------------------------------------------------- */

/* The part of an item's box in a cell. An item ends where its box does, not where rounding puts its last plane. */
static index_box grid_clipped(const grid *g, const index_box *box, const int32_t *cell) {
    const grid_range r = grid_of(g, box);
    index_box part = *box;
    for (int k = 0; k < 3; k++) {
        if (cell[k] > r.first[k]) part.lo[k] = g->planes[k][cell[k]];
        if (cell[k] < r.last[k]) part.hi[k] = g->planes[k][cell[k] + 1];
    }
    return part;
}

static index_slot grid_leaf(const grid *g, const int32_t *cell) {
    const size_t c = grid_cell(g, cell[0], cell[1], cell[2]);
    const int32_t begin = g->begin[c], count = g->begin[c + 1] - begin;
    if (count == 0) return (index_slot){INDEX_EMPTY, -1, 0};
    int32_t *ids;
    index_slot slot = index_open_leaf(g->builder, count, &ids);
    for (int32_t i = 0; ids && i < count; i++) {
        const index_item *item = &g->builder->items[g->listings[begin + i]];
        const index_box part = grid_clipped(g, &item->box, cell);
        index_grow(&slot.box, &part);
        ids[i] = item->id;
    }
    return slot;
}

/* The block of size^3 cells from `corner` on; size is a power of two. Nothing where all are empty. */
static index_slot grid_block(const grid *g, const int32_t *corner, int32_t size) {
    const index_slot nothing = {INDEX_EMPTY, -1, 0};
    for (int k = 0; k < 3; k++)
        if (corner[k] >= g->dims[k]) return nothing;
    if (g->builder->failed) return nothing;
    if (size == 1) return grid_leaf(g, corner);
    index_slot slots[8];
    int used = 0;
    for (int o = 0; o < 8; o++) {
        int32_t at[3];
        for (int k = 0; k < 3; k++) at[k] = corner[k] + (o >> k & 1 ? size / 2 : 0);
        slots[used] = grid_block(g, at, size / 2);
        if (slots[used].count > 0) used++;
    }
    return used > 0 ? index_join(g->builder, slots, used) : nothing;
}

index_slot grid_build(index_builder *builder) {
    static const int32_t origin[3] = {0, 0, 0};
    index_slot top = {INDEX_EMPTY, -1, 0};
    grid g = {.builder = builder};
    grid_choose(&g);
    if (grid_allocate(&g)) {
        grid_fill(&g);
        int32_t size = 1;
        for (int k = 0; k < 3; k++)
            while (size < g.dims[k]) size *= 2;
        top = grid_block(&g, origin, size);
    } else {
        builder->failed = 1;
    }
    grid_free(&g);
    return top;
}
