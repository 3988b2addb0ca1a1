/* mesh_hide.h - could a cell hide a part of the surface that is smaller than it is?
 *
 * A part of the inside or outside has an extremum of the field. Boxes of a cell over which the field rises or falls in
 * some direction have none (they are plain); boxes that are of one kind throughout, and hang together with a corner of
 * the cell of that kind, belong to a part that is seen there. All other boxes are halved, down to MESH_FINEST along the
 * cell; what is left then may hide something.
 */
#ifndef BLOB_MESH_HIDE_H
#define BLOB_MESH_HIDE_H

#include "mesh_brick.h"

enum { HIDE_NO_MEMORY = -1, HIDE_NOTHING, HIDE_SOMETHING };
enum { HIDE_ROWS = MESH_FINEST * MESH_FINEST };

/* The smallest boxes of a cell, one bit each, rows along x. */
typedef struct hide_set {
    uint16_t row[HIDE_ROWS];
} hide_set;

/* Of a cell: those proved outside and inside, and those of them that have to hang together with a corner. */
typedef struct hide_cell {
    int all;      /* what is known of the corners: 1 inside, -1 outside, 0 some of both */
    int inside;   /* corners, as bits */
    double at[3]; /* in cells */
    int deep;     /* boxes of less than half a cell were looked at */
    hide_set kind[2], due[2];
} hide_cell;

static void hide_fill(hide_set *set, const int *at, int size) {
    const unsigned bits = ((1u << size) - 1u) << at[0];
    for (int z = at[2]; z < at[2] + size; z++)
        for (int y = at[1]; y < at[1] + size; y++) set->row[y + MESH_FINEST * z] |= (uint16_t)bits;
}

/* Adds to `seen` what hangs together with it within `kind`. */
static void hide_spread(const hide_set *kind, hide_set *seen) {
    for (int moved = 1; moved;) {
        moved = 0;
        for (int i = 0; i < HIDE_ROWS; i++) {
            const int y = i % MESH_FINEST, z = i / MESH_FINEST;
            unsigned bits = seen->row[i];
            if (y > 0) bits |= seen->row[i - 1];
            if (y < MESH_FINEST - 1) bits |= seen->row[i + 1];
            if (z > 0) bits |= seen->row[i - MESH_FINEST];
            if (z < MESH_FINEST - 1) bits |= seen->row[i + MESH_FINEST];
            bits &= kind->row[i];
            for (unsigned before = 0; bits != before;) before = bits, bits |= (bits << 1 | bits >> 1) & kind->row[i];
            moved |= bits != seen->row[i];
            seen->row[i] = (uint16_t)bits;
        }
    }
}

/* Do all boxes that have to, hang together with a corner? */
static int hide_is_seen(const hide_cell *cell) {
    for (int inside = 0; inside < 2; inside++) {
        hide_set seen = {{0}};
        for (int c = 0; c < 8; c++) {
            const int x = c & 1 ? MESH_FINEST - 1 : 0, y = c & 2 ? MESH_FINEST - 1 : 0, z = c & 4 ? MESH_FINEST - 1 : 0;
            const int i = y + MESH_FINEST * z;
            if ((cell->inside >> c & 1) == inside) seen.row[i] |= (uint16_t)(cell->kind[inside].row[i] & 1u << x);
        }
        hide_spread(&cell->kind[inside], &seen);
        for (int i = 0; i < HIDE_ROWS; i++)
            if (cell->due[inside].row[i] & ~seen.row[i]) return 0;
    }
    return 1;
}

/* The octants of a box, `size` finest boxes each, at `at`; along: as box_lanes.along. HIDE_NOTHING: all is decided
 * but for hide_is_seen. */
static int hide_look(mesh_scratch *w, hide_cell *cell, const int *at, int size, const mesh_members *of,
                     const double *along) {
    const double unit = 1.0 / (double)MESH_FINEST;
    const double corner[3] = {cell->at[0] + unit * at[0], cell->at[1] + unit * at[1], cell->at[2] + unit * at[2]};
    box_lanes lanes;
    box_bounds b;
    box_slopes g;
    mesh_lanes(w, &lanes, unit * size);
    mesh_set_octants(w, &lanes, corner, unit * size);
    for (int k = 0; k < 3; k++) LANE_LOOP(l) lanes.along[k][l] = along[k];
    size_t steps;
    int verdicts[LANES], open = 0, left = 0;
    if (!mesh_take_bounds(w, &lanes, of, 1, &steps, &b)) return HIDE_NO_MEMORY;
    for (int l = 0; l < LANES; l++) {
        verdicts[l] = mesh_verdict(w->mesher, &b, l);
        if (cell->all && verdicts[l] == -cell->all) return HIDE_SOMETHING;
        open |= (verdicts[l] == 0) << l;
    }
    /* octants of the cell have a corner each: those of one kind are seen there */
    const int whole = 2 * size == MESH_FINEST;
    if (whole && !open) return HIDE_NOTHING;
    if (whole) lanes.wanted = open;
    mesh_take_slopes(w, &lanes, of, steps, &g);
    for (int l = 0; l < LANES; l++) {
        const int verdict = verdicts[l], plain = (whole && verdict) || mesh_is_plain(&g, l);
        const int next[3] = {at[0] + size * (l & 1), at[1] + size * (l >> 1 & 1), at[2] + size * (l >> 2)};
        if (verdict) hide_fill(&cell->kind[verdict > 0], next, size);
        if (verdict && !plain) hide_fill(&cell->due[verdict > 0], next, size);
        if (!verdict && !plain) left |= 1 << l;
    }
    if (left && size == 1) return HIDE_SOMETHING;
    for (int l = 0; l < LANES; l++) {
        if (!(left >> l & 1)) continue;
        const int next[3] = {at[0] + size * (l & 1), at[1] + size * (l >> 1 & 1), at[2] + size * (l >> 2)};
        double turned[3];
        mesh_middle_gradient(&g, l, turned);
        const mesh_members some = mesh_members_of(w, of, l);
        cell->deep = 1;
        const int found = hide_look(w, cell, next, size / 2, &some, turned);
        if (found != HIDE_NOTHING) return found;
    }
    return HIDE_NOTHING;
}

/* Could cell (x, y, z) hide something? inside: its corners that are, as bits. */
static int hide_in_cell(mesh_scratch *w, const int *at, int inside, const mesh_members *of, const double *along) {
    static const int zero[3] = {0, 0, 0};
    hide_cell cell;
    memset(&cell, 0, sizeof cell);
    cell.all = inside == 255 ? 1 : inside == 0 ? -1 : 0;
    cell.inside = inside;
    for (int k = 0; k < 3; k++) cell.at[k] = at[k];
    const int found = hide_look(w, &cell, zero, MESH_FINEST / 2, of, along);
    if (found != HIDE_NOTHING || !cell.deep) return found;
    return hide_is_seen(&cell) ? HIDE_NOTHING : HIDE_SOMETHING;
}

/* How many cells of the block of 2 x 2 x 2 cells at `at`, of those in `asked` (bits), may hide something; -1: no
 * memory. inside: corners of each. */
static int hide_in_block(mesh_scratch *w, const int *at, int asked, const int *inside) {
    const mesh_members all = mesh_all_members(w);
    const double corner[3] = {at[0], at[1], at[2]};
    box_lanes lanes;
    box_bounds b;
    box_slopes g;
    int count = 0;
    mesh_lanes(w, &lanes, 1.0);
    mesh_set_octants(w, &lanes, corner, 1.0);
    size_t steps;
    if (!mesh_take_bounds(w, &lanes, &all, 1, &steps, &b)) return -1;
    lanes.wanted = asked;
    mesh_take_slopes(w, &lanes, &all, steps, &g);
    for (int l = 0; l < LANES; l++) {
        if (!(asked >> l & 1) || mesh_is_plain(&g, l)) continue;
        const int cell[3] = {at[0] + (l & 1), at[1] + (l >> 1 & 1), at[2] + (l >> 2)};
        double along[3];
        mesh_middle_gradient(&g, l, along);
        const mesh_members some = mesh_members_of(w, &all, l);
        const int found = hide_in_cell(w, cell, inside[l], &some, along);
        if (found == HIDE_NO_MEMORY) return -1;
        count += found;
    }
    return count;
}

#endif
