/* mesh.c - triangles for a surface: bricks, rounds of work, results. What it is about: mesh.h.
 *
 * Threads belong to the caller: any number of them may be in blob_mesher_work and blob_mesher_write at once, and
 * the result does not depend on how many. All else is for one thread. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "mesh.h"
#include "mesh_cell.h"

typedef struct mesh_isa {
    mesh_scratch *(*scratch_new)(void);
    void (*scratch_free)(mesh_scratch *scratch);
    blob_status (*descend)(blob_mesher *mesher, mesh_scratch *scratch, int32_t level, const int32_t *at, int32_t size,
                           const int32_t *ids, size_t count);
    blob_status (*work)(blob_mesher *mesher, mesh_scratch *scratch, mesh_brick *brick);
} mesh_isa;

#define MESH_ISA(SUFFIX)                                                                                               \
    { mesh_scratch_new_##SUFFIX, mesh_scratch_free_##SUFFIX, mesh_descend_##SUFFIX, mesh_work_##SUFFIX }

static const mesh_isa MESH_BASELINE = MESH_ISA(baseline);
#ifdef BLOB_X86
static const mesh_isa MESH_V3 = MESH_ISA(v3);
static const mesh_isa MESH_V4 = MESH_ISA(v4);
#endif

/* The same instruction set as for rays. */
static const mesh_isa *mesh_pick(void) {
#ifdef BLOB_X86
    const char *name = blob_isa();
    if (strcmp(name, "x86-64-v4") == 0) return &MESH_V4;
    if (strcmp(name, "x86-64-v3") == 0) return &MESH_V3;
#endif
    return &MESH_BASELINE;
}

/* ---- bricks by place -------------------------------------------------------------------------------- */

static size_t mesh_slot(const blob_mesher *m, int32_t level, const int32_t *at) {
    uint64_t key = (uint64_t)(uint32_t)level;
    for (int k = 0; k < 3; k++) key = (key ^ (uint64_t)(uint32_t)at[k]) * 0x9e3779b97f4a7c15u, key ^= key >> 29;
    size_t slot = (size_t)key & (m->table_size - 1);
    while (m->table[slot] != UINT32_MAX) {
        const mesh_brick *brick = &m->bricks[m->table[slot]];
        if (brick->level == level && memcmp(brick->at, at, sizeof brick->at) == 0) break;
        slot = (slot + 1) & (m->table_size - 1);
    }
    return slot;
}

mesh_brick *mesh_find(const blob_mesher *m, int32_t level, const int32_t *at) {
    if (m->table_size == 0) return NULL;
    const uint32_t number = m->table[mesh_slot(m, level, at)];
    return number == UINT32_MAX ? NULL : &m->bricks[number];
}

mesh_brick *mesh_owner(const blob_mesher *m, const mesh_edge *edge) {
    const int u = (edge->axis + 1) % 3, v = (edge->axis + 2) % 3;
    const int32_t unit = 1 << (m->levels - edge->level);
    int32_t at[3], both[3];
    for (int k = 0; k < 3; k++) {
        const int32_t node = edge->node[k] / unit;
        at[k] = node / MESH_CELLS;
        both[k] = node % MESH_CELLS == 0;
    }
    for (int i = 0; i <= both[u]; i++) {
        for (int j = 0; j <= both[v]; j++) {
            int32_t place[3] = {at[0], at[1], at[2]};
            place[u] -= i, place[v] -= j;
            mesh_brick *brick = mesh_find(m, edge->level, place);
            if (brick && brick->state == MESH_LEAF) return brick;
        }
    }
    return NULL;
}

static int mesh_room(void **data, size_t *room, size_t need, size_t size) {
    if (need <= *room) return 1;
    const size_t bigger = need + need / 2 + 256;
    void *fresh = realloc(*data, bigger * size);
    if (!fresh) return 0;
    *data = fresh;
    *room = bigger;
    return 1;
}

static int mesh_grow_table(blob_mesher *m) {
    if (2 * (m->brick_count + 1) <= m->table_size) return 1;
    const size_t size = m->table_size ? 2 * m->table_size : 1024;
    uint32_t *table = malloc(size * sizeof *table);
    if (!table) return 0;
    free(m->table);
    m->table = table;
    m->table_size = size;
    memset(table, 0xff, size * sizeof *table);
    for (size_t i = 0; i < m->brick_count; i++) table[mesh_slot(m, m->bricks[i].level, m->bricks[i].at)] = (uint32_t)i;
    return 1;
}

static int mesh_enqueue(blob_mesher *m, size_t number) {
    if (m->bricks[number].queued) return 1;
    if (!mesh_room((void **)&m->queue, &m->queue_room, m->queue_count + 1, sizeof *m->queue)) return 0;
    m->bricks[number].queued = 1;
    m->queue[m->queue_count++] = (uint32_t)number;
    return 1;
}

blob_status mesh_add_brick(blob_mesher *m, int32_t level, const int32_t *at, const int32_t *ids, size_t count) {
    const size_t bytes = m->brick_count * sizeof *m->bricks + (m->pool.count + count) * sizeof *ids;
    if (m->byte_limit && bytes > m->byte_limit) return BLOB_TOO_LARGE;
    if (m->brick_count >= UINT32_MAX - 1) return BLOB_TOO_LARGE;
    if (!mesh_grow_table(m) || !mesh_room((void **)&m->bricks, &m->brick_room, m->brick_count + 1, sizeof *m->bricks) ||
        !mesh_room((void **)&m->pool.ids, &m->pool.room, m->pool.count + count, sizeof *ids))
        return BLOB_NO_MEMORY;
    mesh_brick *brick = &m->bricks[m->brick_count];
    memset(brick, 0, sizeof *brick);
    memcpy(brick->at, at, sizeof brick->at);
    brick->level = (int16_t)level;
    brick->state = MESH_LEAF;
    brick->ids = m->pool.count;
    brick->id_count = (uint32_t)count;
    if (count) memcpy(m->pool.ids + m->pool.count, ids, count * sizeof *ids);
    m->pool.count += count;
    m->table[mesh_slot(m, level, at)] = (uint32_t)m->brick_count++;
    return mesh_enqueue(m, m->brick_count - 1) ? BLOB_OK : BLOB_NO_MEMORY;
}

/* ---- beginning ---------------------------------------------------------------------------------------- */

static int mesh_plan_is_sound(const blob_scene *scene, const blob_mesh_plan *plan) {
    if (plan->surface < 0 || plan->surface >= scene->surface_count) return 0;
    if (plan->levels < 0 || plan->levels > 16) return 0;
    for (int k = 0; k < 3; k++) {
        if (!isfinite(plan->lo[k]) || !isfinite(plan->cell[k]) || !(plan->cell[k] > 0.0)) return 0;
        if (plan->cells[k] <= 0 || (int64_t)plan->cells[k] << plan->levels > 1 << 28) return 0;
        if (plan->clip && !(plan->clip_lo[k] < plan->clip_hi[k])) return 0;
    }
    return isfinite(plan->tolerance) && plan->tolerance >= 0.0;
}

/* Packed coordinates, the nodes within the clip box, how far nodes are kept from the surface. */
static void mesh_frame(blob_mesher *m, const blob_mesh_plan *plan) {
    const blob_scene *scene = m->scene;
    double smallest = INFINITY;
    m->magnitude = 0.0;
    for (int k = 0; k < 3; k++) {
        m->lo[k] = (plan->lo[k] - scene->center[k]) * scene->scale;
        m->fine[k] = ldexp(plan->cell[k] * scene->scale, -plan->levels);
        m->end[k] = plan->cells[k] << plan->levels;
        const double hi = m->lo[k] + (double)m->end[k] * m->fine[k];
        m->magnitude +=
            fmax(fmax(m->lo[k] * m->lo[k], hi * hi), scene->lo[k] * scene->lo[k] + scene->hi[k] * scene->hi[k]);
        smallest = fmin(smallest, m->fine[k]);
        if (!plan->clip) continue;
        m->clip_lo[k] = (plan->clip_lo[k] - scene->center[k]) * scene->scale;
        m->clip_hi[k] = (plan->clip_hi[k] - scene->center[k]) * scene->scale;
        m->clip_first[k] = (int32_t)ceil((m->clip_lo[k] - m->lo[k]) / m->fine[k]);
        m->clip_last[k] = (int32_t)floor((m->clip_hi[k] - m->lo[k]) / m->fine[k]);
    }
    m->magnitude = 2.0 * sqrt(m->magnitude);
    m->warp = smallest * fmin(0.2, 0.02 * ldexp(1.0, plan->levels));
}

static blob_status mesh_begin(blob_mesher *m) {
    const int32_t count = m->surface->element_end - m->surface->element_begin, zero[3] = {0, 0, 0};
    const mesh_isa *isa = mesh_pick();
    mesh_scratch *scratch = isa->scratch_new();
    int32_t *ids = malloc(((size_t)count + 1) * sizeof *ids);
    int32_t bricks = 1, most = 0;
    for (int k = 0; k < 3; k++) most = m->end[k] > most ? m->end[k] : most;
    while (bricks * MESH_CELLS << m->levels < most) bricks *= 2;
    if (bricks < 2) bricks = 2;
    blob_status status = scratch && ids ? BLOB_OK : BLOB_NO_MEMORY;
    for (int32_t i = 0; ids && i < count; i++) ids[i] = m->surface->element_begin + i;
    if (status == BLOB_OK) status = isa->descend(m, scratch, 0, zero, bricks / 2, ids, (size_t)count);
    isa->scratch_free(scratch);
    free(ids);
    return status;
}

BLOB_API blob_status blob_mesher_new(const blob_scene *scene, const blob_index *index, const blob_mesh_plan *plan,
                                     blob_mesher **mesher) {
    if (!scene || !index || !plan || !mesher || !mesh_plan_is_sound(scene, plan)) return BLOB_BAD_ARGUMENT;
    blob_mesher *m = calloc(1, sizeof *m);
    if (!m) return BLOB_NO_MEMORY;
    m->scene = scene;
    m->index = index;
    m->surface = &scene->surfaces[plan->surface];
    m->depth = index->trees[plan->surface].depth;
    m->levels = plan->levels;
    m->clip = plan->clip;
    m->tolerance = plan->tolerance;
    m->byte_limit = plan->byte_limit;
    m->cancel = plan->cancel;
    mesh_frame(m, plan);
    cell_fill_table(m->cases);
    const blob_status status = mesh_begin(m);
    if (status) blob_mesher_free(m);
    *mesher = status ? NULL : m;
    return status;
}

BLOB_API void blob_mesher_free(blob_mesher *m) {
    if (!m) return;
    for (size_t i = 0; i < m->brick_count; i++) {
        free(m->bricks[i].vertices);
        free(m->bricks[i].triangles);
        free(m->bricks[i].foreign);
    }
    free(m->bricks);
    free(m->pool.ids);
    free(m->table);
    free(m->queue);
    free(m);
}

BLOB_API blob_status blob_mesh_extent(const blob_scene *scene, const blob_index *index, int32_t surface, double *lo,
                                      double *hi) {
    if (!scene || !index || !lo || !hi || surface < 0 || surface >= scene->surface_count) return BLOB_BAD_ARGUMENT;
    const index_tree *tree = &index->trees[surface];
    for (int k = 0; k < 3; k++) {
        lo[k] = tree->lo[k] / scene->scale + scene->center[k];
        hi[k] = tree->hi[k] / scene->scale + scene->center[k];
    }
    return BLOB_OK;
}

/* ---- rounds ---------------------------------------------------------------------------------------------- */

/* Bricks that a thread takes at once. */
enum { MESH_GRAIN = 8 };

BLOB_API blob_status blob_mesher_work(blob_mesher *m) {
    if (!m) return BLOB_BAD_ARGUMENT;
    const mesh_isa *isa = mesh_pick();
    mesh_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    blob_status status = BLOB_OK;
    while (status == BLOB_OK) {
        const size_t first = atomic_fetch_add(&m->next, MESH_GRAIN);
        for (size_t i = first; i < first + MESH_GRAIN && i < m->queue_count && status == BLOB_OK; i++) {
            status = m->cancel && *m->cancel ? BLOB_CANCELLED : isa->work(m, scratch, &m->bricks[m->queue[i]]);
            atomic_fetch_add(&m->done, 1);
        }
        if (first >= m->queue_count) break;
    }
    isa->scratch_free(scratch);
    return status;
}

/* Bricks of a level around a place, and at it, are to be worked on again. */
static int mesh_enqueue_around(blob_mesher *m, int32_t level, const int32_t *at) {
    for (int i = 0; i < 27; i++) {
        const int32_t place[3] = {at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1};
        const mesh_brick *brick = mesh_find(m, level, place);
        if (brick && brick->state == MESH_LEAF && !mesh_enqueue(m, (size_t)(brick - m->bricks))) return 0;
    }
    return 1;
}

/* Halves a leaf into bricks of the next level, and before that those around it that are coarser. */
static blob_status mesh_split(blob_mesher *m, const mesh_isa *isa, mesh_scratch *scratch, size_t number) {
    if (m->bricks[number].state != MESH_LEAF) return BLOB_OK;
    const int32_t level = m->bricks[number].level;
    const int32_t at[3] = {m->bricks[number].at[0], m->bricks[number].at[1], m->bricks[number].at[2]};
    for (int i = 0; i < 27 && level > 0; i++) {
        const int32_t place[3] = {at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1};
        if (place[0] < 0 || place[1] < 0 || place[2] < 0) continue;
        const int32_t above[3] = {place[0] / 2, place[1] / 2, place[2] / 2};
        const mesh_brick *coarse = mesh_find(m, level - 1, above);
        const blob_status status = coarse ? mesh_split(m, isa, scratch, (size_t)(coarse - m->bricks)) : BLOB_OK;
        if (status) return status;
    }
    mesh_brick *brick = &m->bricks[number];
    const size_t count = brick->id_count;
    int32_t *ids = malloc((count + 1) * sizeof *ids);
    if (!ids) return BLOB_NO_MEMORY;
    memcpy(ids, m->pool.ids + brick->ids, count * sizeof *ids);
    free(brick->vertices);
    free(brick->triangles);
    free(brick->foreign);
    brick->vertices = NULL, brick->triangles = NULL, brick->foreign = NULL;
    brick->vertex_count = brick->triangle_count = brick->foreign_count = 0;
    brick->cells = brick->undecided = brick->hidden = 0;
    brick->error = 0.0;
    brick->state = MESH_SPLIT;
    const int32_t first[3] = {2 * at[0], 2 * at[1], 2 * at[2]};
    blob_status status = isa->descend(m, scratch, level + 1, first, 1, ids, count);
    free(ids);
    if (status == BLOB_OK && !mesh_enqueue_around(m, level, at)) status = BLOB_NO_MEMORY;
    for (int i = 0; i < 8 && status == BLOB_OK; i++) {
        const int32_t child[3] = {first[0] + (i & 1), first[1] + (i >> 1 & 1), first[2] + (i >> 2)};
        if (!mesh_enqueue_around(m, level + 1, child)) status = BLOB_NO_MEMORY;
    }
    return status;
}

BLOB_API blob_status blob_mesher_refine(blob_mesher *m, int32_t *more) {
    if (!m || !more) return BLOB_BAD_ARGUMENT;
    const mesh_isa *isa = mesh_pick();
    mesh_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    const size_t before = m->brick_count;
    for (size_t i = 0; i < m->queue_count; i++) m->bricks[m->queue[i]].queued = 0;
    m->queue_count = 0;
    atomic_store(&m->next, 0);
    atomic_store(&m->done, 0);
    blob_status status = BLOB_OK;
    for (size_t i = 0; i < before && status == BLOB_OK; i++) {
        const mesh_brick *brick = &m->bricks[i];
        const int coarse = m->tolerance > 0.0 && brick->error > m->tolerance;
        if (brick->state == MESH_LEAF && brick->level < m->levels && (brick->hidden || coarse))
            status = mesh_split(m, isa, scratch, i);
    }
    isa->scratch_free(scratch);
    *more = m->queue_count > 0;
    return status;
}

/* ---- results --------------------------------------------------------------------------------------------------- */

BLOB_API blob_status blob_mesher_count(blob_mesher *m, blob_mesh_counts *counts) {
    if (!m || !counts) return BLOB_BAD_ARGUMENT;
    *counts = (blob_mesh_counts){.visited = m->visited, .queued = m->queue_count};
    for (int k = 0; k < 3; k++) counts->lo[k] = INFINITY, counts->hi[k] = -INFINITY;
    for (size_t i = 0; i < m->brick_count; i++) {
        mesh_brick *brick = &m->bricks[i];
        if (brick->state != MESH_LEAF) continue;
        brick->first_vertex = counts->vertices;
        brick->first_triangle = counts->triangles;
        counts->bricks++;
        counts->vertices += brick->vertex_count;
        counts->triangles += brick->triangle_count;
        counts->cells += brick->cells;
        counts->undecided += brick->undecided;
        counts->hidden += brick->hidden;
        counts->refined += brick->level > 0;
        counts->error = fmax(counts->error, brick->error);
        const double unit = ldexp(1.0, m->levels - brick->level) * MESH_CELLS;
        for (int k = 0; k < 3; k++) {
            const double lo = m->lo[k] + brick->at[k] * unit * m->fine[k], hi = lo + unit * m->fine[k];
            counts->lo[k] = fmin(counts->lo[k], lo / m->scene->scale + m->scene->center[k]);
            counts->hi[k] = fmax(counts->hi[k], hi / m->scene->scale + m->scene->center[k]);
        }
    }
    return BLOB_OK;
}

BLOB_API size_t blob_mesher_done(blob_mesher *m) { return m ? atomic_load(&m->done) : 0; }

/* Where some of the cells that may hide something are: up to `room` middles of bricks with such cells. */
BLOB_API size_t blob_mesher_hidden(const blob_mesher *m, size_t room, double *places) {
    size_t n = 0;
    for (size_t i = 0; m && i < m->brick_count && n < room; i++) {
        const mesh_brick *brick = &m->bricks[i];
        if (brick->state != MESH_LEAF || brick->hidden == 0) continue;
        const double unit = ldexp(1.0, m->levels - brick->level) * MESH_CELLS;
        for (int k = 0; k < 3; k++)
            places[3 * n + (size_t)k] =
                (m->lo[k] + (brick->at[k] + 0.5) * unit * m->fine[k]) / m->scene->scale + m->scene->center[k];
        n++;
    }
    return n;
}

BLOB_API blob_status blob_mesher_finish(blob_mesher *m) {
    if (!m) return BLOB_BAD_ARGUMENT;
    atomic_store(&m->next, 0);
    atomic_store(&m->done, 0);
    return BLOB_OK;
}

static int64_t mesh_vertex_number(const mesh_brick *brick, int code) {
    const uint64_t bit = (uint64_t)1 << (code % 64), word = brick->edges[code / 64];
    if (!(word & bit)) return -1;
    return (int64_t)(brick->first_vertex + brick->rank[code / 64] + (uint64_t)__builtin_popcountll(word & (bit - 1)));
}

/* The number of the vertex on an edge, whoever owns it; -1: nobody does. */
static int64_t mesh_edge_number(const blob_mesher *m, const mesh_edge *edge) {
    const mesh_brick *owner = mesh_owner(m, edge);
    if (!owner) return -1;
    const int32_t unit = 1 << (m->levels - edge->level);
    int local[3];
    for (int k = 0; k < 3; k++) local[k] = edge->node[k] / unit - MESH_CELLS * owner->at[k];
    const int node = local[0] + MESH_NODES * (local[1] + MESH_NODES * local[2]);
    return mesh_vertex_number(owner, edge->axis * MESH_NODE_COUNT + node);
}

static int64_t mesh_code_number(const blob_mesher *m, const mesh_brick *brick, int code) {
    if (code >= MESH_EXTRA) {
        const uint32_t edges = brick->vertex_count - brick->extra_count;
        return (int64_t)(brick->first_vertex + edges + (uint32_t)(code - MESH_EXTRA));
    }
    if (code >= MESH_FOREIGN) return mesh_edge_number(m, &brick->foreign[code - MESH_FOREIGN]);
    const int64_t own = mesh_vertex_number(brick, code);
    if (own >= 0) return own;
    const int32_t unit = 1 << (m->levels - brick->level), node = code % MESH_NODE_COUNT;
    mesh_edge edge = {.axis = (int16_t)(code / MESH_NODE_COUNT), .level = brick->level};
    const int32_t local[3] = {node % MESH_NODES, node / MESH_NODES % MESH_NODES, node / (MESH_NODES * MESH_NODES)};
    for (int k = 0; k < 3; k++) edge.node[k] = (MESH_CELLS * brick->at[k] + local[k]) * unit;
    return mesh_edge_number(m, &edge);
}

static blob_status mesh_write_brick(const blob_mesher *m, const mesh_brick *brick, double *vertices, double *normals,
                                    int64_t *triangles) {
    int64_t known[MESH_EDGE_COUNT]; /* numbers of the vertices of other bricks that were looked up */
    memset(known, 0xff, sizeof known);
    for (uint32_t i = 0; i < brick->vertex_count; i++) {
        memcpy(vertices + 3 * (brick->first_vertex + i), brick->vertices + 6 * i, 3 * sizeof *vertices);
        memcpy(normals + 3 * (brick->first_vertex + i), brick->vertices + 6 * i + 3, 3 * sizeof *normals);
    }
    for (uint32_t i = 0; i < 3 * brick->triangle_count; i++) {
        const int code = brick->triangles[i];
        int64_t number = code < MESH_EDGE_COUNT ? known[code] : -1;
        if (number < 0) {
            number = mesh_code_number(m, brick, code);
            if (number < 0) return BLOB_BAD_SCENE;
            if (code < MESH_EDGE_COUNT) known[code] = number;
        }
        triangles[3 * brick->first_triangle + i] = number;
    }
    return BLOB_OK;
}

/* Bricks written between two times that freed memory goes back to the system, so that the arrays that they are
 * written to may take its place. */
enum { MESH_GIVE_BACK = 1 << 14 };

static void mesh_give_back(void) {
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

BLOB_API blob_status blob_mesher_write(blob_mesher *m, double *vertices, double *normals, int64_t *triangles) {
    if (!m || !vertices || !normals || !triangles) return BLOB_BAD_ARGUMENT;
    blob_status status = BLOB_OK;
    while (status == BLOB_OK) {
        const size_t first = atomic_fetch_add(&m->next, MESH_GRAIN);
        if (first >= m->brick_count) break;
        if (first % MESH_GIVE_BACK == 0 && first) mesh_give_back();
        for (size_t i = first; i < first + MESH_GRAIN && i < m->brick_count && status == BLOB_OK; i++) {
            mesh_brick *brick = &m->bricks[i];
            if (brick->state != MESH_LEAF) continue;
            if (m->cancel && *m->cancel) return BLOB_CANCELLED;
            status = mesh_write_brick(m, brick, vertices, normals, triangles);
            free(brick->vertices);
            free(brick->triangles);
            brick->vertices = NULL;
            brick->triangles = NULL;
        }
    }
    return status;
}
