/* mesh_engine.c - the work of mesh.c that goes through the field: compiled once per instruction set (BLOB_ISA). */
#include <math.h>

#pragma GCC diagnostic ignored "-Wunused-function" /* packet.h has what searches need, too */
#include "mesh_polygon.h"

#define MESH_JOIN_(a, b) a##b
#define MESH_JOIN(a, b) MESH_JOIN_(a, b)
#define MESH_NAME(name) MESH_JOIN(name##_, BLOB_ISA)

mesh_scratch *MESH_NAME(mesh_scratch_new)(void) {
    mesh_scratch *scratch = aligned_alloc(64, (sizeof *scratch + 63) / 64 * 64);
    if (scratch) memset(scratch, 0, sizeof *scratch);
    return scratch;
}

void MESH_NAME(mesh_scratch_free)(mesh_scratch *scratch) {
    if (!scratch) return;
    packet_scratch_free(&scratch->packet);
    box_scratch_free(&scratch->box);
    free(scratch->vertices.data);
    free(scratch->triangles.data);
    free(scratch->foreign.data);
    free(scratch->members.data);
    free(scratch->matters.data);
    free(scratch);
}

/* ---- down to bricks ------------------------------------------------------------------------------------ */

/* Is a box partly beyond the clip box? Then its being inside proves nothing. */
static int mesh_box_is_cut(const blob_mesher *m, const int32_t *first, int32_t units) {
    if (!m->clip) return 0;
    for (int k = 0; k < 3; k++)
        if (first[k] < m->clip_first[k] || first[k] + units > m->clip_last[k]) return 1;
    return 0;
}

/* Does any of the box lie within the clip box, or, where there is none, the grid? */
static int mesh_box_counts(const blob_mesher *m, const int32_t *first, int32_t units) {
    for (int k = 0; k < 3; k++) {
        if (first[k] >= m->end[k]) return 0;
        if (m->clip && (first[k] >= m->clip_last[k] || first[k] + units <= m->clip_first[k])) return 0;
    }
    return 1;
}

/* The octants of a cube of 2 * size bricks of `level`, at `at` (bricks of that level): those that may hold the
 * surface become bricks (size 1) or are halved on. */
blob_status MESH_NAME(mesh_descend)(blob_mesher *m, mesh_scratch *w, int32_t level, const int32_t *at, int32_t size,
                                    const int32_t *ids, size_t count) {
    if (m->cancel && *m->cancel) return BLOB_CANCELLED;
    const int32_t unit = 1 << (m->levels - level), units = MESH_CELLS * unit * size;
    box_lanes lanes = {.scene = m->scene, .index = m->index, .surface = m->surface, .depth = m->depth};
    box_bounds b;
    size_t steps;
    for (int k = 0; k < 3; k++) {
        lanes.half[k] = 0.5 * (double)units * m->fine[k] * (1.0 + 1e-12);
        LANE_LOOP(l) {
            const int32_t first = (at[k] + size * (l >> k & 1)) * MESH_CELLS * unit;
            lanes.rays.o[k][l] = m->lo[k] + ((double)first + 0.5 * (double)units) * m->fine[k];
            lanes.rays.d[k][l] = 0.0, lanes.rays.inverse[k][l] = 1e300, lanes.rays.magnitude[l] = m->magnitude;
        }
    }
    uint8_t *matters = malloc(count + 1);
    int32_t *kept = malloc((count + 1) * sizeof *kept);
    blob_status status = matters && kept && box_plan(&lanes, &w->box, ids, count, &steps) ? BLOB_OK : BLOB_NO_MEMORY;
    if (status == BLOB_OK) {
        box_bounds_of(&lanes, &w->box, ids, count, steps, matters, &b);
        box_close_bounds(&lanes, &b);
        m->visited += LANES;
    }
    for (int l = 0; l < LANES && status == BLOB_OK; l++) {
        const int32_t next[3] = {at[0] + size * (l & 1), at[1] + size * (l >> 1 & 1), at[2] + size * (l >> 2)};
        const int32_t first[3] = {next[0] * MESH_CELLS * unit, next[1] * MESH_CELLS * unit,
                                  next[2] * MESH_CELLS * unit};
        if (!mesh_box_counts(m, first, units)) continue;
        const int verdict = mesh_verdict(m, &b, l);
        if (verdict < 0 || (verdict > 0 && !mesh_box_is_cut(m, first, units))) continue;
        size_t left = 0;
        for (size_t i = 0; i < count; i++)
            if (matters[i] >> l & 1) kept[left++] = ids[i];
        if (size == 1) status = mesh_add_brick(m, level, next, kept, left);
        else status = MESH_NAME(mesh_descend)(m, w, level, next, size / 2, kept, left);
    }
    free(matters);
    free(kept);
    return status;
}

/* ---- one brick -------------------------------------------------------------------------------------------- */

static void mesh_open(blob_mesher *m, mesh_scratch *w, mesh_brick *brick) {
    w->mesher = m;
    w->brick = brick;
    w->unit = 1 << (m->levels - brick->level);
    w->p.scene = m->scene;
    w->p.index = m->index;
    w->p.surface = m->surface;
    w->p.scratch = &w->packet;
    w->p.depth = m->depth;
    w->any_split = 0;
    for (int k = 0; k < 3; k++) w->base[k] = brick->at[k] * MESH_CELLS * w->unit;
    for (int i = 0; i < 27; i++) {
        const int32_t at[3] = {brick->at[0] + i % 3 - 1, brick->at[1] + i / 3 % 3 - 1, brick->at[2] + i / 9 - 1};
        w->around[i] = (uint8_t)mesh_state(m, brick->level, at);
        w->any_split |= w->around[i] == MESH_SPLIT;
    }
    w->at_clip = (uint8_t)mesh_box_is_cut(m, w->base, MESH_CELLS * w->unit);
    w->vertex_count = w->triangle_count = w->foreign_count = 0;
    brick->cells = brick->undecided = brick->hidden = brick->extra_count = 0;
    brick->error = 0.0;
}

/* How far up to LANES places seem to be from the surface, to first order, at most. 0 when memory has run out. */
static int mesh_measure_places(mesh_scratch *w, double (*places)[3], int count) {
    if (count == 0) return 1;
    leaf_point f;
    LANE_LOOP(l) mesh_set_point(w, l, places[l < count ? l : 0]);
    mesh_set_window(&w->p, -DBL_MIN, DBL_MIN);
    if (!mesh_load(w)) return 0;
    mesh_evaluate(w, MESH_ZERO, &f);
    for (int l = 0; l < count; l++) {
        double size2 = 0.0;
        for (int k = 0; k < 3; k++) size2 += f.gradient[k][l] * f.gradient[k][l];
        const double far = size2 > 0.0 ? fabs(f.value[l]) / sqrt(size2) / w->mesher->scene->scale : 0.0;
        w->brick->error = kernel_max(w->brick->error, far);
    }
    return 1;
}

/* The place of a vertex of the brick's own, packed. 0: it belongs to another. */
static int mesh_own_place(const mesh_scratch *w, int code, double *at) {
    if (code >= MESH_EDGE_COUNT || !(w->brick->edges[code / 64] >> (code % 64) & 1)) return 0;
    const uint64_t below = w->brick->edges[code / 64] & (((uint64_t)1 << (code % 64)) - 1);
    const double *v = (const double *)w->vertices.data + 6 * (w->brick->rank[code / 64] + __builtin_popcountll(below));
    for (int k = 0; k < 3; k++) at[k] = (v[k] - w->mesher->scene->center[k]) * w->mesher->scene->scale;
    return 1;
}

/* The error of the brick: at the middles of triangles and of their sides, where all corners are its own. */
static int mesh_measure(mesh_scratch *w) {
    const uint16_t *triangles = w->triangles.data;
    double places[LANES][3], corner[3][3];
    int count = 0;
    for (uint32_t i = 0; i < w->triangle_count; i++) {
        int own = 1;
        for (uint32_t j = 0; j < 3 && own; j++) own = mesh_own_place(w, triangles[3 * i + j], corner[j]);
        if (!own) continue;
        for (int k = 0; k < 3; k++) {
            places[count][k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3.0;
            for (int j = 0; j < 3; j++) places[count + 1 + j][k] = 0.5 * (corner[j][k] + corner[(j + 1) % 3][k]);
        }
        count = count == 0 ? 4 : 0;
        if (count == 0 && !mesh_measure_places(w, places, LANES)) return 0;
    }
    return mesh_measure_places(w, places, count);
}

static int mesh_copy(void **to, const void *from, size_t bytes) {
    free(*to);
    *to = NULL;
    if (bytes == 0) return 1;
    *to = malloc(bytes);
    if (*to) memcpy(*to, from, bytes);
    return *to != NULL;
}

/* Hands the brick what was found. */
static int mesh_close(mesh_scratch *w) {
    mesh_brick *brick = w->brick;
    brick->vertex_count = w->vertex_count;
    brick->triangle_count = w->triangle_count;
    brick->foreign_count = w->foreign_count;
    const size_t bytes[3] = {w->vertex_count * 6 * sizeof(double), w->triangle_count * 3 * sizeof(uint16_t),
                             w->foreign_count * sizeof(mesh_edge)};
    atomic_fetch_add(&w->mesher->bytes, bytes[0] + bytes[1] + bytes[2]);
    return mesh_copy((void **)&brick->vertices, w->vertices.data, bytes[0]) &&
           mesh_copy((void **)&brick->triangles, w->triangles.data, bytes[1]) &&
           mesh_copy((void **)&brick->foreign, w->foreign.data, bytes[2]);
}

blob_status MESH_NAME(mesh_work)(blob_mesher *m, mesh_scratch *w, mesh_brick *brick) {
    static const int corner[3] = {0, 0, 0};
    mesh_open(m, w, brick);
    const size_t room = (size_t)brick->id_count * MESH_HALVINGS + 1;
    if (!mesh_grown(&w->members, room, sizeof(int32_t)) || !mesh_grown(&w->matters, room, 1)) return BLOB_NO_MEMORY;
    const mesh_members all = mesh_all_members(w);
    memset(w->state, 0, sizeof w->state);
    memset(w->plain, 0, sizeof w->plain);
    if (!w->at_clip && !mesh_cull(w, corner, MESH_CELLS / 2, &all)) return BLOB_NO_MEMORY;
    mesh_mark_nodes(w);
    if (!mesh_sample(w) || !mesh_find_vertices(w) || !polygon_hidden(w) || !polygon_brick(w)) return BLOB_NO_MEMORY;
    if (m->tolerance > 0.0 && !mesh_measure(w)) return BLOB_NO_MEMORY;
    return mesh_close(w) ? BLOB_OK : BLOB_NO_MEMORY;
}
