/* beam.h - front to back through the index, once for a block of neighbouring rays.
 *
 * Ray i of a beam is at most spread(t) = r0 + r1 |t| away from the axis point at the same t. So a box
 * can only matter to the block where the axis meets the box grown by the spread, and no earlier. Items
 * are handed out in chunks; a chunk's `limit` is the entry of the nearest node not yet opened: up to
 * there every element of the surface is known. The packets of the block share the chunks, each reads as
 * far as its rays need, so nothing behind the last first hit is ever looked at.
 */
#ifndef BLOB_BEAM_H
#define BLOB_BEAM_H

#include <stdlib.h>
#include <string.h>

#include "index.h"
#include "leaf.h"

enum { BEAM_CHUNK = 24, BEAM_RAYS = 256 };

typedef struct beam_entry {
    double t;
    int32_t child, count; /* as in index_node */
} beam_entry;

typedef struct beam_chunk {
    size_t end;   /* items [previous end, end) */
    double limit; /* +inf: the last one */
} beam_chunk;

/* Grows as needed, reused from beam to beam. */
typedef struct beam_scratch {
    beam_entry *heap;
    int32_t *items;
    beam_chunk *chunks;
    uint32_t *stamps; /* per element, where leaves share elements: the last beam that met it */
    uint32_t stamp;   /* of the beam at hand */
    double *spheres;  /* of items that are sifted: by eights, x, y, z and reach */
    size_t heap_room, item_room, chunk_room, stamp_room, sphere_room;
} beam_scratch;

typedef struct beam {
    const blob_index *index;
    const index_tree *tree;
    beam_scratch *scratch;
    const packet_rays *single; /* one packet only: test its rays, not the axis */
    double o[3], d[3], inverse[3];
    double r0, r1, box_spread;
    double t_begin, t_end;          /* of all rays */
    LANE_ALIGN double until[LANES]; /* of one packet: what its rays still want to see, -inf where they are done */
    int sifts;                      /* keep spheres of items: the parts of the beam look at fewer (beam_sift) */
    size_t heap_count, item_count, chunk_count;
    int64_t nodes_opened;
    int out_of_memory;
} beam;

static void beam_scratch_free(beam_scratch *scratch) {
    free(scratch->heap);
    free(scratch->items);
    free(scratch->chunks);
    free(scratch->stamps);
    free(scratch->spheres);
}

static int beam_room(void **data, size_t *room, size_t need, size_t size) {
    if (need <= *room) return 1;
    const size_t bigger = *room * 2 > need + 64 ? *room * 2 : need + 64;
    void *fresh = realloc(*data, bigger * size);
    if (!fresh) return 0;
    *data = fresh;
    *room = bigger;
    return 1;
}

static void beam_push(beam *restrict b, beam_entry entry) {
    void *data = b->scratch->heap;
    if (!beam_room(&data, &b->scratch->heap_room, b->heap_count + 1, sizeof(beam_entry))) {
        b->out_of_memory = 1;
        return;
    }
    beam_entry *heap = b->scratch->heap = data;
    size_t i = b->heap_count++;
    while (i > 0 && heap[(i - 1) / 2].t > entry.t) {
        heap[i] = heap[(i - 1) / 2];
        i = (i - 1) / 2;
    }
    heap[i] = entry;
}

static beam_entry beam_pop(beam *restrict b) {
    beam_entry *heap = b->scratch->heap;
    const beam_entry first = heap[0], last = heap[--b->heap_count];
    size_t i = 0;
    for (;;) {
        size_t child = 2 * i + 1;
        if (child >= b->heap_count) break;
        if (child + 1 < b->heap_count && heap[child + 1].t < heap[child].t) child++;
        if (heap[child].t >= last.t) break;
        heap[i] = heap[child];
        i = child;
    }
    heap[i] = last;
    return first;
}

KERNEL_INLINE double beam_reciprocal(double d) { return 1.0 / (fabs(d) > 1e-300 ? d : copysign(1e-300, d)); }

/* Entry and exit of the axis into the eight boxes, grown by the spread. */
KERNEL_INLINE void beam_axis_boxes(const beam *restrict b, const index_node *restrict node, double *restrict enter,
                                   double *restrict leave) {
    const double grow = b->box_spread;
    for (int i = 0; i < INDEX_WIDTH; i++) {
        double from = b->t_begin, to = b->t_end;
        for (int k = 0; k < 3; k++) {
            const double u = ((double)node->lo[k][i] - grow - b->o[k]) * b->inverse[k];
            const double v = ((double)node->hi[k][i] + grow - b->o[k]) * b->inverse[k];
            from = kernel_max(from, kernel_min(u, v));
            to = kernel_min(to, kernel_max(u, v));
        }
        enter[i] = from;
        leave[i] = to;
    }
}

/* The same for the rays of one packet: the earliest entry of any of them. */
static void beam_packet_boxes(const beam *restrict b, const index_node *restrict node, double *restrict enter,
                              double *restrict leave) {
    const packet_rays *restrict r = b->single;
    for (int i = 0; i < INDEX_WIDTH; i++) {
        LANE_ALIGN double from[LANES], to[LANES];
        LANE_LOOP(l) {
            const double grow = 1e-14 * r->magnitude[l];
            double f = b->t_begin, g = b->until[l];
            for (int k = 0; k < 3; k++) {
                const double inverse = r->inverse[k][l];
                const double u = ((double)node->lo[k][i] - grow - r->o[k][l]) * inverse;
                const double v = ((double)node->hi[k][i] + grow - r->o[k][l]) * inverse;
                f = kernel_max(f, kernel_min(u, v));
                g = kernel_min(g, kernel_max(u, v));
            }
            from[l] = f;
            to[l] = g;
        }
        double first = BLOB_INFINITY;
        LANE_LOOP(l) first = from[l] <= to[l] ? kernel_min(first, from[l]) : first;
        enter[i] = first;
        leave[i] = first < BLOB_INFINITY ? BLOB_INFINITY : -BLOB_INFINITY;
    }
}

/* Ask for the memory of a child that may be looked at next. */
KERNEL_INLINE void beam_fetch_child(const blob_index *restrict index, int32_t child) {
    if (child >= 0) {
        const char *node = (const char *)&index->nodes[child];
        for (size_t i = 0; i < sizeof(index_node); i += 64) __builtin_prefetch(node + i);
    } else {
        const int32_t first = ~child;
        __builtin_prefetch(index->x + first);
        __builtin_prefetch(index->y + first);
        __builtin_prefetch(index->z + first);
        __builtin_prefetch(index->reach + first);
        __builtin_prefetch(index->order + first);
    }
}

static void beam_open(beam *restrict b, int32_t n) {
    const index_node *node = &b->index->nodes[n];
    LANE_ALIGN double enter[INDEX_WIDTH], leave[INDEX_WIDTH];
    if (b->single) beam_packet_boxes(b, node, enter, leave);
    else beam_axis_boxes(b, node, enter, leave);
    b->nodes_opened++;
    for (int i = 0; i < INDEX_WIDTH; i++)
        if (node->count[i] > 0 && enter[i] <= leave[i]) {
            if (b->index->is_large) beam_fetch_child(b->index, node->child[i]);
            beam_push(b, (beam_entry){enter[i], node->child[i], node->count[i]});
        }
}

/* Has the beam not met this element before? */
KERNEL_INLINE int beam_is_new(const beam *restrict b, int32_t element) {
    if (!b->index->repeats) return 1;
    uint32_t *stamp = &b->scratch->stamps[element];
    if (*stamp == b->scratch->stamp) return 0;
    *stamp = b->scratch->stamp;
    return 1;
}

/* Ask for the memory of an element that packets are about to look at: in scenes that are larger than the cache,
 * neighbours are nowhere near each other. */
KERNEL_INLINE void beam_fetch_element(const blob_scene *restrict scene, int32_t e) {
    __builtin_prefetch(scene->x + e);
    __builtin_prefetch(scene->y + e);
    __builtin_prefetch(scene->z + e);
    __builtin_prefetch(scene->support + e);
    __builtin_prefetch(scene->inverse_reach2 + e);
    __builtin_prefetch(scene->weight + e);
    __builtin_prefetch(scene->kernel + e);
}

/* The sphere of item i of the index, kept as that of item `at` of the beam. */
KERNEL_INLINE void beam_keep_sphere(const beam *restrict b, size_t at, int32_t i) {
    const blob_index *index = b->index;
    double *sphere = b->scratch->spheres + at / LANES * (4 * LANES) + at % LANES;
    sphere[0] = index->x[i], sphere[LANES] = index->y[i], sphere[2 * LANES] = index->z[i];
    sphere[3 * LANES] = index->reach[i];
}

/* Room for the spheres of `count` items. */
static int beam_sphere_room(beam_scratch *restrict s, size_t count) {
    if (count <= s->sphere_room) return 1;
    const size_t bigger = (2 * count + LANES - 1) / LANES * LANES;
    double *fresh = aligned_alloc(64, bigger * 4 * sizeof *fresh);
    if (!fresh) return 0;
    if (s->spheres) memcpy(fresh, s->spheres, s->sphere_room * 4 * sizeof *fresh);
    free(s->spheres);
    s->spheres = fresh;
    s->sphere_room = bigger;
    return 1;
}

/* Which of the eight items that begin at 8 * group some ray of `part`, a part of the beam, may meet at a t in
 * [begin, end]: as in beam_meets, and there the axis is no farther than that, either. */
LANE_INLINE lane_bits beam_sift(const beam_scratch *restrict s, const beam *restrict part, size_t group, double begin,
                                double end) {
    const double *sphere = s->spheres + group * (4 * LANES);
    const lane_real x = lane_load(sphere) - part->o[0], y = lane_load(sphere + LANES) - part->o[1],
                    z = lane_load(sphere + 2 * LANES) - part->o[2], reach = lane_load(sphere + 3 * LANES) + part->r0;
    const lane_real tau = x * part->d[0] + y * part->d[1] + z * part->d[2];
    const lane_real px = x - tau * part->d[0], py = y - tau * part->d[1], pz = z - tau * part->d[2];
    const lane_real near = reach + part->r1 / (1.0 - part->r1) * (lane_abs(tau) + reach);
    const lane_bits beside = lane_at_most(px * px + py * py + pz * pz, near * near);
    return lane_both(beside,
                     lane_both(lane_at_most(lane_all(begin), tau + near), lane_at_most(tau - near, lane_all(end))));
}

/* Which of `count` items, eight at most, from `first` on have a bounding sphere that some ray of the beam can touch: a
 * bit each. */
static uint32_t beam_meets(const beam *restrict b, int32_t first, int32_t count) {
    const blob_index *index = b->index;
    const lane_real x = lane_load_any(index->x + first) - b->o[0], y = lane_load_any(index->y + first) - b->o[1],
                    z = lane_load_any(index->z + first) - b->o[2];
    const lane_real reach = lane_load_any(index->reach + first) + b->r0;
    const lane_real tau = x * b->d[0] + y * b->d[1] + z * b->d[2];
    const lane_real px = x - tau * b->d[0], py = y - tau * b->d[1], pz = z - tau * b->d[2];
    const lane_real near = reach + b->r1 / (1.0 - b->r1) * (lane_abs(tau) + reach);
    const uint32_t met = lane_set(lane_at_most(px * px + py * py + pz * pz, near * near));
    return count < LANES ? met & ((1u << count) - 1u) : met;
}

/* Items of a leaf whose bounding sphere some ray of the beam can touch; an element only once. */
static void beam_take(beam *restrict b, int32_t first, int32_t count) {
    const blob_index *index = b->index;
    void *data = b->scratch->items;
    if (!beam_room(&data, &b->scratch->item_room, b->item_count + (size_t)count, sizeof(int32_t))) {
        b->out_of_memory = 1;
        return;
    }
    int32_t *items = b->scratch->items = data;
    if (b->sifts && !beam_sphere_room(b->scratch, b->item_count + (size_t)count)) {
        b->out_of_memory = 1;
        return;
    }
    if (b->single) {
        for (int32_t i = first; i < first + count; i++)
            if (beam_is_new(b, index->order[i])) items[b->item_count++] = index->order[i];
        return;
    }
    for (int32_t from = first; from < first + count; from += LANES) {
        uint32_t rest = beam_meets(b, from, first + count - from);
        for (; rest; rest &= rest - 1) {
            const int32_t i = from + __builtin_ctz(rest);
            if (!beam_is_new(b, index->order[i])) continue;
            if (b->sifts) beam_keep_sphere(b, b->item_count, i);
            if (index->is_large) beam_fetch_element(index->scene, index->order[i]);
            items[b->item_count++] = index->order[i];
        }
    }
}

/* Gather the next chunk. */
static void beam_pull(beam *restrict b) {
    const size_t begin = b->item_count;
    double last = -BLOB_INFINITY;
    while (b->heap_count > 0 && !b->out_of_memory) {
        const double next = b->scratch->heap[0].t;
        if (b->item_count - begin >= BEAM_CHUNK && next > last) break;
        const beam_entry entry = beam_pop(b);
        last = entry.t;
        if (entry.child >= 0) beam_open(b, entry.child);
        else beam_take(b, ~entry.child, entry.count);
    }
    void *data = b->scratch->chunks;
    if (!beam_room(&data, &b->scratch->chunk_room, b->chunk_count + 1, sizeof(beam_chunk))) {
        b->out_of_memory = 1;
        return;
    }
    b->scratch->chunks = data;
    b->scratch->chunks[b->chunk_count++] =
        (beam_chunk){b->item_count, b->heap_count > 0 ? b->scratch->heap[0].t : BLOB_INFINITY};
}

/* A stamp that no element has yet. 0: no memory. */
static int beam_new_stamp(beam *restrict b) {
    beam_scratch *s = b->scratch;
    const size_t need = (size_t)b->index->scene->element_count;
    if (need > s->stamp_room) {
        free(s->stamps);
        s->stamps = calloc(need, sizeof *s->stamps);
        s->stamp_room = s->stamps ? need : 0;
        s->stamp = 0;
        if (!s->stamps) return 0;
    }
    if (++s->stamp == 0) {
        memset(s->stamps, 0, s->stamp_room * sizeof *s->stamps);
        s->stamp = 1;
    }
    return 1;
}

static void beam_start(beam *restrict b) {
    for (int k = 0; k < 3; k++) b->inverse[k] = beam_reciprocal(b->d[k]);
    b->heap_count = b->item_count = b->chunk_count = 0;
    b->nodes_opened = 0;
    if (b->tree->root < 0 || !(b->t_begin < b->t_end)) return;
    if (b->index->repeats && !beam_new_stamp(b)) b->out_of_memory = 1;
    else beam_open(b, b->tree->root);
}

#endif
