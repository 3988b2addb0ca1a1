/* engine.c - a block of rays against all surfaces. Compiled once per instruction set (BLOB_ISA).
 *
 * Rays are normalised and brought to packed coordinates; the origin of a far ray is moved to its point
 * nearest to the scene, so that local t stays small. Blocks that fit a narrow beam share one walk
 * through the index; wide ones are halved until they do, single packets of unrelated rays walk on their
 * own.
 */
#include <math.h>

#include "engine.h"
#include "paint.h"
#include "strategy.h"
#include "sum.h"

#define ENGINE_JOIN_(a, b) a##b
#define ENGINE_JOIN(a, b) ENGINE_JOIN_(a, b)
#define ENGINE_NAME(name) ENGINE_JOIN(name##_, BLOB_ISA)

enum { ENGINE_PACKETS = ENGINE_RAYS / LANES };

struct engine_scratch {
    packet_scratch packet;
    blob_hits out; /* of the block at hand */
    sum_scratch sum;
    beam_scratch beam;
    uint16_t order[ENGINE_RAYS]; /* place -> ray of the block, four by four */
    int ordered, square;         /* is `order` made, and is it of squares? */
    int leaving;                 /* rays start on surfaces, `start`; what is not sure is not searched further */
    int ends;                    /* some window has an end */
    int looking;                 /* rays from one place, neighbours one behind the other ... */
    double plane[4];             /* ... and the plane a . x = b that one of the last team has hit; 0: none */
    packet_rays rays[ENGINE_PACKETS];
    LANE_ALIGN double begin[ENGINE_RAYS], end[ENGINE_RAYS];      /* windows in local t */
    LANE_ALIGN double inside[ENGINE_RAYS], outside[ENGINE_RAYS]; /* the same, cut to the box of the surface at hand */
    LANE_ALIGN double shift[ENGINE_RAYS];                        /* t_packed = t_local + shift */
    LANE_ALIGN double hit_t[ENGINE_RAYS], normal[3][ENGINE_RAYS], side[ENGINE_RAYS]; /* side: 1, -1 or 0 for none */
    int32_t start[ENGINE_RAYS];
    uint8_t unsure[ENGINE_RAYS];
    int8_t status[ENGINE_RAYS];
    int32_t surface[ENGINE_RAYS];
    int32_t evaluations[ENGINE_RAYS], nodes[ENGINE_RAYS], candidates[ENGINE_RAYS], spans[ENGINE_RAYS],
        sandwiches[ENGINE_RAYS], fallbacks[ENGINE_RAYS];
};

engine_scratch *ENGINE_NAME(engine_scratch_new)(void) {
    engine_scratch *scratch = aligned_alloc(64, (sizeof *scratch + 63) / 64 * 64);
    if (scratch) memset(scratch, 0, offsetof(engine_scratch, rays)); /* the rest is written before it is read */
    return scratch;
}

void ENGINE_NAME(engine_scratch_free)(engine_scratch *scratch) {
    if (!scratch) return;
    packet_scratch_free(&scratch->packet);
    beam_scratch_free(&scratch->beam);
    sum_scratch_free(&scratch->sum);
    free(scratch);
}

/* ---- rays ----------------------------------------------------------------------------------- */

/* About how far ray i of a block is from its first where they are `away` from their origins. */
static double engine_apart(const engine_block *block, size_t i, double away) {
    double origins = 0.0, directions = 0.0, length = 0.0;
    for (size_t k = 0; k < 3; k++) {
        const double x = block->origins[3 * i + k] - block->origins[k], d = block->directions[k];
        const double y = block->directions[3 * i + k] - d;
        origins += x * x, directions += y * y, length += d * d;
    }
    return sqrt(origins) + away * sqrt(directions / length);
}

/* How far the first ray's origin is from the middle of the scene. */
static double engine_away(const blob_scene *scene, const engine_block *block) {
    double away = 0.0;
    for (int k = 0; k < 3; k++) {
        const double gap = block->origins[k] - scene->center[k];
        away += gap * gap;
    }
    return sqrt(away);
}

static double engine_least_reach(const blob_scene *scene, const blob_index *index) {
    double least = BLOB_INFINITY;
    for (int32_t s = 0; s < scene->surface_count; s++) least = kernel_min(least, index->trees[s].typical_reach);
    return least / scene->scale;
}

/* Rays of a block of 16 x 16 pixels, which ray 16 near to ray 0 tells, are taken in squares: packets of 4 x 2, two of
 * them 4 x 4, four 8 x 4 and so on, where a block is so wide that smaller beams have much less to look at. Others
 * stay in their order. */
static void engine_order(const blob_scene *scene, const blob_index *index, engine_scratch *w,
                         const engine_block *block) {
    int square = 0;
    if (block->count == ENGINE_RAYS) {
        const double away = engine_away(scene, block), width = engine_apart(block, 8, away);
        square = engine_apart(block, 16, away) < 0.25 * width && width > 0.25 * engine_least_reach(scene, index);
    }
    if (w->ordered && w->square == square) return;
    w->ordered = 1;
    w->square = square;
    for (size_t i = 0; i < ENGINE_RAYS; i++) {
        const size_t x = (i & 3) + ((i >> 4 & 1) << 2) + ((i >> 6 & 1) << 3);
        const size_t y = (i >> 2 & 3) + ((i >> 5 & 1) << 2) + ((i >> 7 & 1) << 3);
        w->order[i] = (uint16_t)(square ? 16 * y + x : i);
    }
}

/* LANES rays as they are given. */
typedef struct engine_given {
    lane_real o[3], d[3], t_min, t_max;
    lane_bits real; /* not beyond the last ray */
} engine_given;

/* Those in the places from `at` on. Places beyond the last ray take the first of these once more. */
static void engine_take(const engine_scratch *w, const engine_block *block, size_t at, engine_given *g) {
    const double *o = block->origins, *d = block->directions, *lo = block->t_min, *hi = block->t_max;
    LANE_ALIGN double some[2][LANES], spare[2][3 * LANES];
    const double *from[2][2], *ends[2][2];
    const size_t first = w->order[at], second = w->order[at + 4];
    if (at + LANES <= block->count) {
        for (int half = 0; half < 2; half++) {
            const size_t i = half ? second : first;
            from[0][half] = o + 3 * i, from[1][half] = d + 3 * i;
            ends[0][half] = lo + i, ends[1][half] = hi + i;
        }
    } else {
        for (size_t l = 0; l < LANES; l++) {
            const size_t i = at + l < block->count ? at + l : at;
            memcpy(spare[0] + 3 * l, o + 3 * i, 3 * sizeof(double));
            memcpy(spare[1] + 3 * l, d + 3 * i, 3 * sizeof(double));
            some[0][l] = lo[i], some[1][l] = hi[i];
        }
        for (int half = 0; half < 2; half++)
            for (int what = 0; what < 2; what++) {
                from[what][half] = spare[what] + 12 * half;
                ends[what][half] = some[what] + 4 * half;
            }
    }
    lane_load_vectors(from[0][0], from[0][1], g->o);
    lane_load_vectors(from[1][0], from[1][1], g->d);
    g->t_min = lane_load_halves(ends[0][0], ends[0][1]);
    g->t_max = lane_load_halves(ends[1][0], ends[1][1]);
    LANE_ALIGN double place[LANES];
    LANE_LOOP(l) place[l] = (double)l;
    g->real = lane_less(lane_load(place), lane_all((double)(block->count - at)));
}

/* Ask for the memory of a packet's part of the next block while this one is searched. */
static void engine_fetch(const engine_block *block, size_t at) {
    if (at + LANES > block->next) return;
    const double *ray = block->origins + 3 * (block->count + at), *way = block->directions + 3 * (block->count + at);
    for (size_t i = 0; i < 3 * LANES; i += LANES) {
        __builtin_prefetch(ray + i);
        __builtin_prefetch(way + i);
    }
}

/* The same for the results of a team. */
static void engine_fetch_room(const blob_hits *out, size_t at) {
    if (!out->normal) return;
    for (size_t i = 0; i < 3 * SUM_TEAM * LANES; i += LANES) __builtin_prefetch(out->normal + 3 * at + i, 1);
    for (size_t i = 0; out->t && i < SUM_TEAM * LANES; i += LANES) __builtin_prefetch(out->t + at + i, 1);
    if (out->surface) __builtin_prefetch(out->surface + at, 1);
    if (out->evaluations) __builtin_prefetch(out->evaluations + at, 1);
}

/* Rays of a packet in packed coordinates, of unit directions. */
typedef struct engine_placed {
    lane_real q[3], unit[3], world; /* world: coordinates of the scene, whose rounding moved the rays */
    lane_real t_min, t_max;         /* scene units */
    lane_bits valid, real;
} engine_placed;

/* Middle and radius of the box around all elements. */
typedef struct engine_extent {
    double middle[3], radius;
} engine_extent;

/* The packet's rays start at their point nearest to the scene, where that is far. Their status is INVALID, or MISS for
 * now; the last packet of a block is filled up with rays that never search. */
LANE_INLINE void engine_place(const blob_scene *scene, engine_scratch *w, size_t p, const engine_placed *g,
                              const engine_extent *extent) {
    packet_rays *rays = &w->rays[p];
    const size_t at = p * LANES;
    const lane_real zero = lane_all(0.0), far = lane_all(BLOB_INFINITY);
    lane_real along = zero, away2 = zero;
    for (int k = 0; k < 3; k++) {
        const lane_real gap = extent->middle[k] - g->q[k];
        along += gap * g->unit[k];
        away2 += gap * gap;
    }
    const double radius = extent->radius;
    const lane_real shift = lane_pick(lane_less(lane_all(16.0 * radius * radius), away2), along, zero);
    for (int k = 0; k < 3; k++) {
        lane_store(rays->o[k], g->q[k] + shift * g->unit[k]);
        lane_store(rays->d[k], g->unit[k]);
        const lane_bits steep = lane_less(lane_all(1e-300), lane_abs(g->unit[k]));
        lane_store(rays->inverse[k], lane_inverse(lane_pick(steep, g->unit[k], lane_all(1e-300))));
    }
    const lane_real magnitude = lane_root_above(away2) + radius + g->world; /* distances from the origin to elements */
    const lane_bits searches =
        lane_both(lane_both(g->valid, g->real), lane_both(lane_less(g->t_min, g->t_max), lane_less(magnitude, far)));
    lane_store(rays->magnitude, magnitude);
    lane_store(w->shift + at, shift);
    lane_store(w->begin + at, g->t_min * scene->scale - shift);
    /* A crossing that rounding alone has put behind t_max belongs to the window: what begins there takes it for a
     * start on the surface, so windows that share an end see each crossing once. */
    const lane_real end = g->t_max * scene->scale, slack = 4.0 * DBL_EPSILON * (lane_abs(end) + magnitude);
    lane_store(w->end + at, lane_pick(searches, end - shift + slack, -far));
    w->ends |= lane_some(lane_less(end, far));
    lane_store(w->hit_t + at, far);
    for (int k = 0; k < 3; k++) lane_store(w->normal[k] + at, lane_all(BLOB_NAN));
    lane_store(w->side + at, zero);
    memset(w->status + at, BLOB_MISS, LANES);
    if (lane_number(g->valid) < LANES) {
        LANE_ALIGN lane_flag is_valid[LANES];
        lane_store_mask(is_valid, lane_mask_of(g->valid));
        LANE_LOOP(l) w->status[at + (size_t)l] = (int8_t)(is_valid[l] ? BLOB_MISS : BLOB_INVALID);
    }
    memset(w->surface + at, 0xff, LANES * sizeof *w->surface);
    int32_t *counters[] = {w->evaluations, w->nodes, w->candidates, w->spans, w->sandwiches, w->fallbacks};
    for (size_t k = 0; k < sizeof counters / sizeof *counters; k++)
        memset(counters[k] + at, 0, LANES * sizeof(int32_t));
}

static int engine_centred(const blob_scene *scene) {
    return scene->center[0] == 0.0 && scene->center[1] == 0.0 && scene->center[2] == 0.0;
}

/* LANES rays into packed coordinates. */
static void engine_ray_packet(const blob_scene *scene, engine_scratch *w, const engine_block *block, size_t p,
                              const engine_extent *extent) {
    const size_t at = p * LANES;
    engine_given g;
    engine_take(w, block, at, &g);
    engine_fetch(block, at);
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    lane_real nothing = 0.0 * g.t_min, largest = zero; /* NaN where anything is not finite */
    for (int k = 0; k < 3; k++) {
        nothing += 0.0 * g.o[k] + 0.0 * g.d[k];
        largest = lane_max(largest, lane_abs(g.d[k]));
    }
    const lane_bits valid = lane_both(lane_at_most(nothing, zero), lane_less(zero, largest));
    engine_placed r = {.world = zero, .t_min = g.t_min, .t_max = g.t_max, .valid = valid, .real = g.real};
    for (int k = 0; k < 3; k++) r.unit[k] = lane_pick(valid, g.d[k], k == 2 ? one : zero);
    lane_normalise(r.unit);
    for (int k = 0; k < 3; k++) {
        r.q[k] = lane_pick(valid, (g.o[k] - scene->center[k]) * scene->scale, lane_all(extent->middle[k]));
        r.world = lane_max(r.world, lane_pick(valid, lane_abs(g.o[k]) * scene->scale, zero));
    }
    if (engine_centred(scene)) r.world = zero; /* moving to packed coordinates rounds nothing */
    engine_place(scene, w, p, &r, extent);
}

static engine_extent engine_extent_of(const blob_scene *scene) {
    engine_extent extent;
    double radius2 = 0.0;
    for (int k = 0; k < 3; k++) {
        extent.middle[k] = 0.5 * (scene->lo[k] + scene->hi[k]);
        radius2 += 0.25 * (scene->hi[k] - scene->lo[k]) * (scene->hi[k] - scene->lo[k]);
    }
    extent.radius = sqrt(radius2);
    return extent;
}

static void engine_rays(const blob_scene *scene, const blob_index *index, engine_scratch *w,
                        const engine_block *block) {
    const engine_extent extent = engine_extent_of(scene);
    engine_order(scene, index, w, block);
    w->ends = 0;
    for (size_t p = 0; p * LANES < block->count; p++) engine_ray_packet(scene, w, block, p, &extent);
}

/* ---- beams ------------------------------------------------------------------------------------ */

/* The windows of a packet within the box of a surface; empty (inside > outside) where a ray misses it. */
static void engine_clip(engine_scratch *w, const index_tree *tree, size_t p) {
    const packet_rays *r = &w->rays[p];
    const lane_real grow = 1e-14 * lane_load(r->magnitude);
    lane_real begin = lane_load(w->begin + p * LANES), end = lane_load(w->end + p * LANES);
    for (int k = 0; k < 3; k++) {
        const lane_real o = lane_load(r->o[k]), inverse = lane_load(r->inverse[k]);
        const lane_real u = (tree->lo[k] - grow - o) * inverse, v = (tree->hi[k] + grow - o) * inverse;
        begin = lane_max(begin, lane_min(u, v));
        end = lane_min(end, lane_max(u, v));
    }
    lane_store(w->inside + p * LANES, begin);
    lane_store(w->outside + p * LANES, end);
}

LANE_INLINE double engine_sum(lane_real v) { return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7])); }
LANE_INLINE double engine_max(lane_real v) {
    double most = v[0];
    for (int l = 1; l < LANES; l++) most = kernel_max(most, v[l]);
    return most;
}

/* Axis, spread and window of packets [first, first + count). 0: no ray of them meets the surface's box. */
static int engine_beam(const engine_scratch *w, size_t first, size_t count, beam *b) {
    const lane_real zero = lane_all(0.0), far = lane_all(BLOB_INFINITY);
    lane_real rays = zero, o[3] = {zero, zero, zero}, d[3] = {zero, zero, zero}, begin = far, end = -far, size = zero;
    for (size_t p = first; p < first + count; p++) {
        const packet_rays *r = &w->rays[p];
        const lane_real from = lane_load(w->inside + p * LANES), to = lane_load(w->outside + p * LANES);
        const lane_mask on = from < to;
        rays += lane_select(on, lane_all(1.0), zero);
        begin = lane_min(begin, lane_select(on, from, far));
        end = lane_max(end, lane_select(on, to, -far));
        size = lane_max(size, lane_select(on, lane_load(r->magnitude), zero));
        for (int k = 0; k < 3; k++) {
            o[k] += lane_select(on, lane_load(r->o[k]), zero);
            d[k] += lane_select(on, lane_load(r->d[k]), zero);
        }
    }
    const double number = engine_sum(rays);
    if (number == 0.0) return 0;
    double length2 = 0.0;
    for (int k = 0; k < 3; k++) {
        b->o[k] = engine_sum(o[k]) / number;
        b->d[k] = engine_sum(d[k]);
        length2 += b->d[k] * b->d[k];
    }
    for (int k = 0; k < 3; k++) b->d[k] /= length2 > 0.0 ? sqrt(length2) : 1.0;
    lane_real r0 = zero, r1 = zero;
    for (size_t p = first; p < first + count; p++) {
        const packet_rays *r = &w->rays[p];
        const lane_mask on = lane_load(w->inside + p * LANES) < lane_load(w->outside + p * LANES);
        lane_real u = zero, v = zero;
        for (int k = 0; k < 3; k++) {
            const lane_real x = lane_load(r->o[k]) - b->o[k], y = lane_load(r->d[k]) - b->d[k];
            u += x * x;
            v += y * y;
        }
        r0 = lane_max(r0, lane_select(on, u, zero));
        r1 = lane_max(r1, lane_select(on, v, zero));
    }
    b->t_begin = -engine_max(-begin);
    b->t_end = engine_max(end);
    b->r0 = sqrt(engine_max(r0)) * (1.0 + 1e-12) + 1e-13 * engine_max(size);
    b->r1 = sqrt(engine_max(r1)) * (1.0 + 1e-12) + 1e-15;
    b->box_spread = b->r0 + b->r1 * kernel_max(fabs(b->t_begin), fabs(b->t_end));
    return 1;
}

/* What those rays of a packet `on` want to see of a beam of their own. */
static void engine_until(const engine_scratch *w, beam *restrict b, size_t packet_index, lane_mask on) {
    const lane_real from = lane_load(w->inside + packet_index * LANES),
                    to = lane_load(w->outside + packet_index * LANES);
    lane_store(b->until, lane_select(on & (from < to), to, lane_all(-BLOB_INFINITY)));
}

/* ---- one packet against one surface -------------------------------------------------------------- */

static void engine_begin(search *s, const blob_scene *scene, const blob_index *index, const blob_query *query,
                         engine_scratch *w, int32_t surface, size_t packet_index) {
    const index_tree *tree = &index->trees[surface];
    const blob_surface *target = &scene->surfaces[surface];
    s->p.scene = scene;
    s->p.index = index;
    s->p.surface = target;
    s->p.scratch = &w->packet;
    s->p.rays = w->rays[packet_index];
    s->p.leaf_count = s->p.piece_count = s->p.memory_count = s->p.step_count = 0;
    s->p.out_of_memory = 0;
    s->p.depth = tree->depth;
    s->threshold = target->threshold;
    s->reach = tree->typical_reach;
    s->strategy = query->search;
    s->tolerance = query->tolerance * scene->scale;
    s->stride = query->step * scene->scale;
    s->cancel = query->cancel;
    /* A window is cut to the box, outside of which the field is 0: there a ray is outside where the
     * threshold is above 0. A ray that starts in the box is told by its field. */
    const double *at = w->begin + packet_index * LANES;
    const lane_real begin = lane_load(at), end = lane_load(w->end + packet_index * LANES), zero = lane_all(0.0);
    const lane_real inside = lane_load(w->inside + packet_index * LANES);
    const lane_real outside = lane_load(w->outside + packet_index * LANES), reach = lane_all(s->reach);
    const lane_mask none = (lane_mask){0}, later = inside > begin;
    lane_store(s->p.t, lane_select(later, inside, begin));
    lane_store(s->p.end, lane_min(outside, end));
    lane_store(s->sign, lane_select(later, lane_all(s->threshold >= 0.0 ? 1.0 : -1.0), zero));
    lane_store_mask(s->searching, inside < outside);
    LANE_ALIGN lane_flag own[LANES]; /* the end is t_max, no surface has cut it */
    LANE_LOOP(l) own[l] = w->surface[packet_index * LANES + (size_t)l] < 0 ? -1 : 0;
    lane_store_mask(s->closes, (end <= outside) & lane_load_mask(own));
    lane_store_mask(s->from_start, ~none);
    lane_store_mask(s->bracketed, none);
    lane_store_mask(s->hit, none);
    lane_store_mask(s->grazed, none);
    lane_store_mask(s->evaluations, none);
    lane_store_mask(s->sandwiches, none);
    lane_store_mask(s->fallbacks, none);
    lane_store(s->flat_from, lane_all(BLOB_NAN));
    lane_store(s->flat_to, lane_all(BLOB_NAN));
    lane_store(s->step, reach);
    lane_store(s->ripe, 0.5 * reach);
    lane_store(s->hit_t, zero);
    for (int k = 0; k < 3; k++) lane_store(s->normal[k], zero);
}

/* Crossings at t, with gradients g, of the rays of a packet that hit. */
static void engine_hit(engine_scratch *w, size_t at, lane_mask hit, lane_real t, const lane_real *g, lane_real sign,
                       int32_t surface) {
    lane_real unit[3] = {-g[0], -g[1], -g[2]};
    lane_normalise(unit);
    for (int k = 0; k < 3; k++) {
        double *normal = w->normal[k] + at;
        lane_store(normal, lane_select(hit, unit[k], lane_load(normal)));
    }
    lane_store(w->hit_t + at, lane_select(hit, t, lane_load(w->hit_t + at)));
    lane_store(w->end + at, lane_select(hit, t, lane_load(w->end + at)));
    lane_store(w->side + at, lane_select(hit, sign, lane_load(w->side + at)));
    LANE_ALIGN lane_flag is_hit[LANES], enters[LANES];
    lane_store_mask(is_hit, hit);
    lane_store_mask(enters, sign > 0.0);
    LANE_SIMD(l) {
        const size_t i = at + (size_t)l;
        w->status[i] = (int8_t)(is_hit[l] ? (enters[l] ? BLOB_ENTER : BLOB_EXIT) : w->status[i]);
        w->surface[i] = is_hit[l] ? surface : w->surface[i];
    }
}

static void engine_keep(const search *s, engine_scratch *w, int32_t surface, size_t packet_index) {
    const size_t at = packet_index * LANES;
    const lane_mask hit = lane_load_mask(s->hit);
    int32_t *restrict evaluations = w->evaluations + at, *restrict sandwiches = w->sandwiches + at;
    int32_t *restrict fallbacks = w->fallbacks + at, *restrict candidates = w->candidates + at;
    LANE_SIMD(l) evaluations[l] += (int32_t)s->evaluations[l];
    LANE_SIMD(l) sandwiches[l] += (int32_t)s->sandwiches[l];
    LANE_SIMD(l) fallbacks[l] += (int32_t)s->fallbacks[l];
    LANE_SIMD(l) candidates[l] += (int32_t)s->p.leaf_count;
    if (lane_any(lane_load_mask(s->grazed)))
        LANE_LOOP(l) if (s->grazed[l] && w->status[at + (size_t)l] == BLOB_MISS) w->status[at + (size_t)l] = BLOB_GRAZE;
    if (!lane_any(hit)) return;
    const lane_real g[3] = {lane_load(s->normal[0]), lane_load(s->normal[1]), lane_load(s->normal[2])};
    engine_hit(w, at, hit, lane_load(s->hit_t), g, lane_load(s->sign), surface);
}

static blob_status engine_packet(const blob_scene *scene, const blob_query *query, engine_scratch *w, beam *b,
                                 int32_t surface, size_t packet_index) {
    search s;
    engine_begin(&s, scene, b->index, query, w, surface, packet_index);
    int any = lane_any(lane_load_mask(s.searching));
    if (!any) return BLOB_OK;
    size_t from = 0;
    for (size_t c = 0;; c++) {
        if (c == b->chunk_count) {
            if (b->single) engine_until(w, b, packet_index, lane_load_mask(s.searching));
            beam_pull(b);
        }
        if (b->out_of_memory) return BLOB_NO_MEMORY;
        const beam_chunk chunk = b->scratch->chunks[c];
        for (; from < chunk.end; from++) packet_add(&s.p, b->scratch->items[from]);
        if (s.p.out_of_memory || !packet_plan(&s.p)) return BLOB_NO_MEMORY;
        int32_t *restrict spans = w->spans + packet_index * LANES;
        LANE_SIMD(l) spans[l] -= (int32_t)s.searching[l];
        strategy_advance(&s, chunk.limit);
        any = lane_any(lane_load_mask(s.searching));
        if (!any || chunk.limit == BLOB_INFINITY) break;
        packet_forget(&s.p);
    }
    engine_keep(&s, w, surface, packet_index);
    return BLOB_OK;
}

/* ---- two packets against one sum of points -------------------------------------------------------- */

/* As engine_begin. */
static void engine_begin_rays(sum_search *s, engine_scratch *w, int32_t surface, size_t packet_index, sum_rays *r) {
    const packet_rays *rays = &w->rays[packet_index];
    const double *at = w->begin + packet_index * LANES;
    const lane_real begin = lane_load(at), end = lane_load(w->end + packet_index * LANES), zero = lane_all(0.0);
    const lane_real inside = lane_load(w->inside + packet_index * LANES);
    const lane_real outside = lane_load(w->outside + packet_index * LANES), far = lane_all(BLOB_INFINITY);
    for (int k = 0; k < 3; k++) {
        r->o[k] = lane_load(rays->o[k]);
        r->d[k] = lane_load(rays->d[k]);
        r->normal[k] = zero;
    }
    r->magnitude = lane_load(rays->magnitude);
    r->searching = lane_less(inside, outside);
    r->t = lane_pick(r->searching, lane_max(inside, begin), far);
    r->end = lane_pick(r->searching, lane_min(outside, end), -far);
    r->sign = lane_pick(lane_less(begin, inside), lane_all(s->threshold >= 0.0 ? 1.0 : -1.0), zero);
    r->step = lane_all(s->reach);
    r->ripe = lane_all(0.5 * s->reach);
    r->hit_t = zero;
    r->bracketed = r->hit = r->left = r->on = r->pinned = sum_nowhere();
    if (w->leaving) {
        LANE_ALIGN lane_flag on[LANES];
        LANE_SIMD(l) on[l] = w->start[packet_index * LANES + (size_t)l] == surface ? -1 : 0;
        r->on = lane_bits_of(lane_load_mask(on));
    }
    r->evaluations = r->sandwiches = r->spans = (lane_mask){0};
}

static void engine_rest_rays(sum_rays *r) {
    r->searching = sum_nowhere();
    r->t = lane_all(BLOB_INFINITY);
    r->end = -r->t;
}

static void engine_keep_rays(const sum_search *s, const sum_rays *r, engine_scratch *w, int32_t surface,
                             size_t packet_index) {
    const size_t at = packet_index * LANES;
    LANE_ALIGN int64_t evaluations[LANES], sandwiches[LANES], spans[LANES];
    lane_store_mask(evaluations, r->evaluations);
    lane_store_mask(sandwiches, r->sandwiches);
    lane_store_mask(spans, r->spans);
    LANE_SIMD(l) w->evaluations[at + (size_t)l] += (int32_t)evaluations[l];
    LANE_SIMD(l) w->sandwiches[at + (size_t)l] += (int32_t)sandwiches[l];
    LANE_SIMD(l) w->spans[at + (size_t)l] += (int32_t)spans[l];
    LANE_SIMD(l) w->candidates[at + (size_t)l] += (int32_t)s->leaf_count;
    if (lane_some(r->hit)) engine_hit(w, at, lane_mask_of(r->hit), r->hit_t, r->normal, r->sign, surface);
}

/* Rays in the way of which is something are done; those that search.h would have to look at are not sure. */
static void engine_keep_leaving(const sum_rays *r, engine_scratch *w, int32_t surface, size_t packet_index) {
    const size_t at = packet_index * LANES;
    if (!lane_some(lane_either(r->hit, r->left))) return;
    LANE_ALIGN lane_flag hit[LANES], left[LANES];
    lane_store_mask(hit, lane_mask_of(r->hit));
    lane_store_mask(left, lane_mask_of(r->left));
    lane_store(w->end + at, lane_pick(r->hit, lane_all(-BLOB_INFINITY), lane_load(w->end + at)));
    LANE_LOOP(l) {
        if (hit[l]) w->surface[at + (size_t)l] = surface;
        if (left[l]) w->unsure[at + (size_t)l] = 1;
    }
}

/* Where the rays meet the plane of the last team's hit is probably where they hit. */
static void engine_pin(const engine_scratch *w, sum_search *s, double known) {
    const double *n = w->plane;
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > 0.0)) return;
    sum_reals guess;
    for (int h = 0; h < SUM_TEAM; h++) {
        const sum_rays *r = &s->rays[h];
        const lane_real height = n[3] - (n[0] * r->o[0] + n[1] * r->o[1] + n[2] * r->o[2]);
        const lane_real slope = n[0] * r->d[0] + n[1] * r->d[1] + n[2] * r->d[2];
        const lane_bits steep = lane_less(lane_all(0.1 * length), slope);
        guess.of[h] = lane_pick(steep, height / lane_pick(steep, slope, lane_all(1.0)), lane_all(BLOB_INFINITY));
    }
    sum_pin(s, &guess, known);
}

static void engine_set_plane(const sum_search *s, engine_scratch *w) {
    memset(w->plane, 0, sizeof w->plane);
    for (int h = 0; h < SUM_TEAM; h++) {
        const sum_rays *r = &s->rays[h];
        LANE_ALIGN lane_flag hit[LANES];
        if (!lane_some(r->hit)) continue;
        lane_store_mask(hit, lane_mask_of(r->hit));
        size_t l = LANES - 1;
        while (!hit[l]) l--;
        w->plane[3] = 0.0;
        for (int k = 0; k < 3; k++) {
            w->plane[k] = r->normal[k][l];
            w->plane[3] += w->plane[k] * (r->o[k][l] + r->hit_t[l] * r->d[k][l]);
        }
    }
}

/* sum_add of those items [from, end) of a beam that a part of it may meet. */
static void engine_sift(sum_search *restrict s, const beam *restrict b, const beam *restrict part, size_t from,
                        size_t end) {
    lane_real begin = lane_all(BLOB_INFINITY), last = -begin;
    for (int h = 0; h < SUM_TEAM; h++) {
        const sum_rays *r = &s->rays[h];
        begin = lane_min(begin, lane_pick(r->searching, r->t, lane_all(BLOB_INFINITY)));
        last = lane_max(last, lane_pick(r->searching, r->end, lane_all(-BLOB_INFINITY)));
    }
    const double t_begin = -engine_max(-begin), t_end = engine_max(last);
    for (size_t group = from / LANES; group * LANES < end; group++) {
        uint32_t rest = lane_set(beam_sift(b->scratch, part, group, t_begin, t_end));
        if (group == from / LANES) rest &= ~0u << from % LANES; /* not those of the chunk before */
        if (end - group * LANES < LANES) rest &= (1u << (end - group * LANES)) - 1u;
        for (; rest; rest &= rest - 1) sum_add(s, b->scratch->items[group * LANES + (size_t)__builtin_ctz(rest)]);
    }
}

/* Packets `first` and `second` (may be the same: only one) of a block. */
static blob_status engine_team(const blob_scene *scene, const blob_query *query, engine_scratch *w, beam *b,
                               int32_t surface, size_t first, size_t second, int any) {
    const index_tree *tree = &b->index->trees[surface];
    sum_search s; /* rays: by engine_begin_rays */
    s.scene = scene, s.scratch = &w->sum, s.leaf_count = s.line_count = 0, s.kind = tree->kind, s.lines = tree->lines,
    s.any = any, s.apart = b->single != NULL, s.out_of_memory = 0;
    s.threshold = scene->surfaces[surface].threshold;
    s.reach = tree->typical_reach;
    s.tolerance = query->tolerance * scene->scale;
    engine_begin_rays(&s, w, surface, first, &s.rays[0]);
    engine_begin_rays(&s, w, surface, second, &s.rays[1]);
    if (first == second) engine_rest_rays(&s.rays[1]);
    if (!lane_some(lane_either(s.rays[0].searching, s.rays[1].searching))) return BLOB_OK;
    engine_fetch_room(&w->out, first * LANES);
    beam part; /* the team's own */
    const int sifts = b->sifts && engine_beam(w, first, second + 1 - first, &part) && part.r1 <= 0.5;
    size_t from = 0;
    for (size_t c = 0;; c++) {
        if (c == b->chunk_count) {
            const sum_rays *r = &s.rays[0];
            if (b->single) engine_until(w, b, first, lane_mask_of(lane_either(r->searching, r->left)));
            beam_pull(b);
        }
        if (b->out_of_memory) return BLOB_NO_MEMORY;
        const beam_chunk chunk = b->scratch->chunks[c];
        if (sifts) engine_sift(&s, b, &part, from, chunk.end);
        else
            for (; from < chunk.end; from++) sum_add(&s, b->scratch->items[from]);
        from = chunk.end;
        if (s.out_of_memory) return BLOB_NO_MEMORY;
        if (c == 0 && w->looking) engine_pin(w, &s, chunk.limit);
        for (int h = 0; h < SUM_TEAM; h++)
            s.rays[h].spans -= lane_mask_of(lane_without(s.rays[h].searching, s.rays[h].bracketed));
        sum_advance(&s, chunk.limit);
        if (!lane_some(lane_either(s.rays[0].searching, s.rays[1].searching)) || chunk.limit == BLOB_INFINITY) break;
        sum_forget(&s);
    }
    if (w->looking) {
        sum_unpin(&s);
        engine_set_plane(&s, w);
    }
    const size_t packets[SUM_TEAM] = {first, second};
    for (int h = 0; h < (first == second ? 1 : SUM_TEAM); h++) {
        if (w->leaving) {
            engine_keep_leaving(&s.rays[h], w, surface, packets[h]);
            continue;
        }
        engine_keep_rays(&s, &s.rays[h], w, surface, packets[h]);
        if (!lane_some(s.rays[h].left)) continue;
        double *outside = w->outside + packets[h] * LANES;
        lane_store(outside, lane_pick(s.rays[h].left, lane_load(outside), lane_all(-BLOB_INFINITY)));
        const blob_status status = engine_packet(scene, query, w, b, surface, packets[h]);
        if (status) return status;
    }
    return BLOB_OK;
}

/* Packets by twos. */
static blob_status engine_teams(const blob_scene *scene, const blob_query *query, engine_scratch *w, beam *b,
                                int32_t surface, size_t first, size_t count, int any) {
    for (size_t i = 0; i < count; i += SUM_TEAM) {
        if (query->cancel && *query->cancel) return BLOB_CANCELLED;
        const size_t one = first + i, other = i + 1 < count ? one + 1 : one;
        const blob_status status = engine_team(scene, query, w, b, surface, one, other, any);
        if (status) return status;
    }
    return BLOB_OK;
}

/* ---- blocks ---------------------------------------------------------------------------------------- */

static blob_status engine_packets(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                  engine_scratch *w, int32_t surface, size_t first, size_t count, int any) {
    beam b;
    b.index = index;
    b.tree = &index->trees[surface];
    b.scratch = &w->beam;
    if (!engine_beam(w, first, count, &b)) return BLOB_OK;
    /* wider than what matters to a ray: the parts have shorter lists than the whole */
    const int teams = b.tree->kind >= 0 && query->search == BLOB_SEARCH_SANDWICH;
    const double most = (teams ? 2.0 : 1.0) * b.tree->typical_reach; /* teams sift what the beam meets */
    if (count > 1 && (b.box_spread > most || b.r1 > 0.5)) {
        const size_t half = count / 2;
        const blob_status status = engine_packets(scene, index, query, w, surface, first, half, any);
        if (status) return status;
        return engine_packets(scene, index, query, w, surface, first + half, count - half, any);
    }
    b.single = count == 1 && (b.box_spread > 0.25 * b.tree->typical_reach || b.r1 > 0.5) ? &w->rays[first] : NULL;
    b.out_of_memory = 0;
    b.sifts = teams && count > SUM_TEAM && b.box_spread > 0.5 * b.tree->typical_reach;
    if (b.single) engine_until(w, &b, first, ~(lane_mask){0});
    beam_start(&b);
    blob_status status = BLOB_OK;
    if (teams) status = engine_teams(scene, query, w, &b, surface, first, count, any);
    else
        for (size_t p = first; p < first + count && !status; p++) {
            if (query->cancel && *query->cancel) return BLOB_CANCELLED; /* packets may take long where much overlaps */
            status = engine_packet(scene, query, w, &b, surface, p);
        }
    if (status) return status;
    if (query->cancel && *query->cancel) return BLOB_CANCELLED; /* in the midst of a search */
    for (size_t i = first * LANES; i < (first + count) * LANES; i++) w->nodes[i] += (int32_t)b.nodes_opened;
    return BLOB_OK;
}

/* Numbers of the rays in their places, to where the rays stand. */
KERNEL_INLINE void engine_put(const engine_scratch *w, size_t n, size_t size, const void *from, void *to) {
    if (!w->square) {
        memcpy(to, from, n * size);
        return;
    }
    for (size_t i = 0; i < ENGINE_RAYS; i += 4)
        memcpy((char *)to + size * w->order[i], (const char *)from + size * i, 4 * size);
}

static void engine_write(const blob_scene *scene, const engine_scratch *w, const engine_block *block) {
    const size_t n = block->count;
    if (block->any) {
        for (size_t i = 0; i < n; i++) block->any[w->order[i]] = w->surface[i] >= 0;
        return;
    }
    const blob_hits *out = block->hits;
    const double unit = 1.0 / scene->scale; /* exact: a power of two */
    engine_put(w, n, sizeof *out->status, w->status, out->status);
    if (out->t) {
        double t[ENGINE_RAYS];
        for (size_t i = 0; i < n; i++) t[i] = (w->hit_t[i] + w->shift[i]) * unit;
        for (size_t i = 0; i < n && w->ends; i++) { /* see engine_place */
            const double end = block->t_max[w->order[i]];
            if (t[i] > end && w->surface[i] >= 0) t[i] = end;
        }
        engine_put(w, n, sizeof *t, t, out->t);
    }
    size_t whole = 0;
    for (; out->normal && whole + LANES <= n; whole += LANES) {
        const lane_real v[3] = {lane_load(w->normal[0] + whole), lane_load(w->normal[1] + whole),
                                lane_load(w->normal[2] + whole)};
        lane_store_vectors(out->normal + 3 * w->order[whole], out->normal + 3 * w->order[whole + 4], v);
    }
    for (size_t i = whole; out->normal && i < n; i++)
        for (size_t k = 0; k < 3; k++) out->normal[3 * i + k] = w->normal[k][i];
    const int32_t *from[] = {w->surface, w->evaluations, w->nodes,    w->candidates,
                             w->spans,   w->sandwiches,  w->fallbacks};
    int32_t *to[] = {out->surface, out->evaluations, out->nodes,    out->candidates,
                     out->spans,   out->sandwiches,  out->fallbacks};
    for (size_t k = 0; k < sizeof to / sizeof *to; k++)
        if (to[k]) engine_put(w, n, sizeof(int32_t), from[k], to[k]);
}

/* The packets of a block against all surfaces. */
static blob_status engine_surfaces(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                   engine_scratch *w, size_t packets, int any) {
    for (int32_t s = 0; s < scene->surface_count; s++) {
        for (size_t p = 0; p < packets; p++) engine_clip(w, &index->trees[s], p);
        const blob_status status = engine_packets(scene, index, query, w, s, 0, packets, any);
        if (status) return status;
    }
    return BLOB_OK;
}

blob_status ENGINE_NAME(engine_trace)(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                      engine_scratch *w, const engine_block *block) {
    engine_rays(scene, index, w, block);
    w->leaving = w->looking = 0;
    w->out = (blob_hits){0};
    if (block->hits && block->count == ENGINE_RAYS) w->out = *block->hits;
    const blob_status status =
        engine_surfaces(scene, index, query, w, (block->count + LANES - 1) / LANES, block->any != NULL);
    if (status == BLOB_OK) engine_write(scene, w, block);
    return status;
}

/* ---- rays in columns ---------------------------------------------------------------------------------- */

LANE_INLINE lane_bits engine_real(size_t at, size_t n) {
    static const LANE_ALIGN double place[LANES] = {0, 1, 2, 3, 4, 5, 6, 7};
    return lane_less(lane_load(place), lane_all((double)n - (double)at));
}

static void engine_see(engine_scratch *w, size_t p, engine_sight *sight) {
    const size_t at = p * LANES;
    const lane_real side = lane_load(w->side + at);
    const lane_bits hit = lane_less(lane_all(0.0), lane_abs(side));
    lane_store(sight->side + at, side);
    if (!lane_some(hit)) return;
    sight->hits += lane_number(hit);
    const packet_rays *rays = &w->rays[p];
    const lane_real t = lane_pick(hit, lane_load(w->hit_t + at), lane_all(0.0));
    for (int k = 0; k < 3; k++) {
        lane_store(sight->place[k] + at, lane_load(rays->o[k]) + t * lane_load(rays->d[k]));
        lane_store(sight->normal[k] + at, lane_load(w->normal[k] + at));
    }
    memcpy(sight->surface + at, w->surface + at, LANES * sizeof *sight->surface);
}

blob_status ENGINE_NAME(engine_look)(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                     engine_scratch *w, const double *eye, size_t n, engine_column *ways,
                                     engine_sight *sight) {
    const engine_extent extent = engine_extent_of(scene);
    const size_t packets = (n + LANES - 1) / LANES;
    const lane_real zero = lane_all(0.0);
    engine_placed r = {
        .world = zero, .t_min = zero, .t_max = lane_all(BLOB_INFINITY), .valid = lane_at_most(zero, zero)};
    double world = 0.0;
    for (int k = 0; k < 3; k++) {
        r.q[k] = lane_all((eye[k] - scene->center[k]) * scene->scale);
        world = kernel_max(world, fabs(eye[k]) * scene->scale);
    }
    if (!engine_centred(scene)) r.world = lane_all(world);
    for (size_t p = 0; p < packets; p++) {
        for (int k = 0; k < 3; k++) r.unit[k] = lane_load(ways[k] + p * LANES);
        r.real = engine_real(p * LANES, n);
        engine_place(scene, w, p, &r, &extent);
    }
    w->leaving = 0;
    w->looking = 1;
    memset(w->plane, 0, sizeof w->plane);
    w->out = (blob_hits){0};
    const blob_status status = engine_surfaces(scene, index, query, w, packets, 0);
    sight->hits = 0;
    for (size_t p = 0; p < packets && status == BLOB_OK; p++) engine_see(w, p, sight);
    return status;
}

/* Do teams search this surface? */
static int engine_has_teams(const blob_index *index, const blob_query *query, int32_t surface) {
    return index->trees[surface].kind >= 0 && query->search == BLOB_SEARCH_SANDWICH;
}

blob_status ENGINE_NAME(engine_leave)(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                      engine_scratch *w, engine_leaving *leaving) {
    const engine_extent extent = engine_extent_of(scene);
    const size_t n = leaving->count, packets = (n + LANES - 1) / LANES;
    const lane_real zero = lane_all(0.0);
    engine_placed r = {.world = zero, .t_min = zero, .valid = lane_at_most(zero, zero)};
    memcpy(w->start, leaving->surface, n * sizeof *w->start);
    for (size_t i = n; i < packets * LANES; i++) w->start[i] = -1;
    memset(w->unsure, 0, packets * LANES);
    for (size_t p = 0; p < packets; p++) {
        const size_t at = p * LANES;
        for (int k = 0; k < 3; k++) {
            r.q[k] = lane_load(leaving->place[k] + at);
            r.unit[k] = lane_load(leaving->way[k] + at);
        }
        r.t_max = lane_load(leaving->end + at);
        r.real = engine_real(at, n);
        engine_place(scene, w, p, &r, &extent);
    }
    for (int32_t s = 0; s < scene->surface_count; s++) {
        if (engine_has_teams(index, query, s)) continue;
        for (size_t i = 0; i < n; i++) {
            if (w->start[i] != s) continue;
            w->unsure[i] = 1;
            w->end[i] = -BLOB_INFINITY;
        }
    }
    w->leaving = 1;
    w->looking = 0;
    w->out = (blob_hits){0};
    const blob_status status = engine_surfaces(scene, index, query, w, packets, 1);
    for (size_t i = 0; i < n; i++)
        leaving->dark[i] = (uint8_t)(w->surface[i] >= 0 ? 1 : w->unsure[i] ? ENGINE_UNSURE : 0);
    return status;
}

/* ---- points ------------------------------------------------------------------------------------------- */

/* Elements around LANES points: rays without direction, whose t = 0 is the point. */
static blob_status engine_points(const blob_scene *scene, const blob_index *index, engine_scratch *w, int32_t surface,
                                 const double *points, size_t count, packet *p) {
    const index_tree *tree = &index->trees[surface];
    const blob_query query = {0};
    search s;
    for (int k = 0; k < 3; k++) {
        LANE_LOOP(l) {
            const size_t i = (size_t)l < count ? (size_t)l : 0;
            w->rays[0].o[k][l] = (points[3 * i + (size_t)k] - scene->center[k]) * scene->scale;
            w->rays[0].d[k][l] = 0.0;
        }
    }
    LANE_LOOP(l) w->rays[0].magnitude[l] = w->begin[l] = w->inside[l] = 0.0, w->end[l] = w->outside[l] = 1.0;
    for (int k = 0; k < 3; k++) lane_store(w->rays[0].inverse[k], lane_all(1e300));
    engine_begin(&s, scene, index, &query, w, surface, 0);
    *p = s.p;
    LANE_LOOP(l) p->t[l] = -DBL_MIN, p->end[l] = DBL_MIN;
    beam b = {.index = index, .tree = tree, .scratch = &w->beam, .single = &p->rays, .t_begin = -1.0, .t_end = 1.0};
    lane_store(b.until, lane_all(b.t_end));
    beam_start(&b);
    do beam_pull(&b);
    while (!b.out_of_memory && b.scratch->chunks[b.chunk_count - 1].limit < BLOB_INFINITY);
    if (b.out_of_memory) return BLOB_NO_MEMORY;
    for (size_t i = 0; i < b.item_count; i++) packet_add(p, b.scratch->items[i]);
    return p->out_of_memory || !packet_plan(p) ? BLOB_NO_MEMORY : BLOB_OK;
}

blob_status ENGINE_NAME(engine_field)(const blob_scene *scene, const blob_index *index, engine_scratch *w,
                                      int32_t surface, const double *points, size_t n, double *field,
                                      double *gradient) {
    static const LANE_ALIGN double zero[LANES] = {0.0};
    for (size_t i = 0; i < n; i += LANES) {
        const size_t count = n - i < LANES ? n - i : LANES;
        packet p;
        const blob_status status = engine_points(scene, index, w, surface, points + 3 * i, count, &p);
        if (status) return status;
        leaf_point f;
        packet_point(&p, zero, &f);
        for (size_t l = 0; l < count; l++) {
            const double *at = points + 3 * (i + l);
            const int is_place = !(isnan(at[0]) || isnan(at[1]) || isnan(at[2]));
            field[i + l] = is_place ? f.value[l] : BLOB_NAN;
            if (!gradient) continue;
            for (size_t k = 0; k < 3; k++)
                gradient[3 * (i + l) + k] = is_place ? f.gradient[k][l] * scene->scale : BLOB_NAN;
        }
    }
    return BLOB_OK;
}

blob_status ENGINE_NAME(engine_paint)(const blob_scene *scene, const blob_index *index, engine_scratch *w, size_t n,
                                      const double *points, const int32_t *surface, const double *materials,
                                      double *out) {
    int32_t depth = 0;
    for (int32_t s = 0; s < scene->surface_count; s++)
        if (index->trees[s].depth > depth) depth = index->trees[s].depth;
    paint_mix *stack = malloc(((size_t)depth + 2) * sizeof *stack);
    if (!stack) return BLOB_NO_MEMORY;
    blob_status status = BLOB_OK;
    for (size_t i = 0; i < n && status == BLOB_OK;) {
        const int32_t own = surface[i];
        size_t count = 1; /* a run of points on one surface */
        while (i + count < n && count < LANES && surface[i + count] == own) count++;
        if (own < 0 || own >= scene->surface_count) {
            memset(out + BLOB_MATERIAL * i, 0, count * BLOB_MATERIAL * sizeof(double));
        } else {
            packet p;
            status = engine_points(scene, index, w, own, points + 3 * i, count, &p);
            for (size_t l = 0; status == BLOB_OK && l < count; l++)
                paint_lane(&p, (int)l, materials, stack, out + BLOB_MATERIAL * (i + l));
        }
        i += count;
    }
    free(stack);
    return status;
}
