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
#include "search.h"

#define ENGINE_JOIN_(a, b) a##b
#define ENGINE_JOIN(a, b) ENGINE_JOIN_(a, b)
#define ENGINE_NAME(name) ENGINE_JOIN(name##_, BLOB_ISA)

enum { ENGINE_PACKETS = ENGINE_RAYS / LANES };

struct engine_scratch {
    packet_scratch packet;
    beam_scratch beam;
    packet_rays rays[ENGINE_PACKETS];
    LANE_ALIGN double begin[ENGINE_RAYS], end[ENGINE_RAYS]; /* windows in local t */
    LANE_ALIGN double shift[ENGINE_RAYS];                   /* t_packed = t_local + shift */
    LANE_ALIGN double hit_t[ENGINE_RAYS], normal[3][ENGINE_RAYS];
    int8_t status[ENGINE_RAYS];
    int32_t surface[ENGINE_RAYS];
    int32_t evaluations[ENGINE_RAYS], nodes[ENGINE_RAYS], candidates[ENGINE_RAYS], spans[ENGINE_RAYS],
        sandwiches[ENGINE_RAYS], fallbacks[ENGINE_RAYS];
};

engine_scratch *ENGINE_NAME(engine_scratch_new)(void) {
    engine_scratch *scratch = aligned_alloc(64, (sizeof *scratch + 63) / 64 * 64);
    if (scratch) memset(scratch, 0, sizeof *scratch);
    return scratch;
}

void ENGINE_NAME(engine_scratch_free)(engine_scratch *scratch) {
    if (!scratch) return;
    packet_scratch_free(&scratch->packet);
    beam_scratch_free(&scratch->beam);
    free(scratch);
}

/* ---- rays ----------------------------------------------------------------------------------- */

/* One ray into packed coordinates. Its status is INVALID, or MISS for now. */
static void engine_ray(const blob_scene *scene, engine_scratch *w, const engine_block *block, size_t i,
                       const double *middle, double radius) {
    const double *o = block->origins + 3 * i, *d = block->directions + 3 * i;
    packet_rays *rays = &w->rays[i / LANES];
    const size_t l = i % LANES;
    const double t_min = block->t_min[i], t_max = block->t_max[i];
    double largest = 0.0, q[3], unit[3], length2 = 0.0, along = 0.0, away2 = 0.0, world = 0.0;
    int finite = isfinite(t_min);
    for (int k = 0; k < 3; k++) {
        finite &= isfinite(o[k]) & isfinite(d[k]);
        largest = kernel_max(largest, fabs(d[k]));
    }
    const int valid = finite && largest > 0.0;
    for (int k = 0; k < 3; k++) {
        unit[k] = valid ? d[k] / largest : (k == 2 ? 1.0 : 0.0);
        length2 += unit[k] * unit[k];
        q[k] = valid ? (o[k] - scene->center[k]) * scene->scale : middle[k];
        world = kernel_max(world, valid ? fabs(o[k]) * scene->scale : 0.0);
    }
    const double length = sqrt(length2);
    for (int k = 0; k < 3; k++) {
        unit[k] /= length;
        along += (middle[k] - q[k]) * unit[k];
        away2 += (middle[k] - q[k]) * (middle[k] - q[k]);
    }
    const double shift = away2 > 16.0 * radius * radius ? along : 0.0;
    for (int k = 0; k < 3; k++) {
        rays->o[k][l] = q[k] + shift * unit[k];
        rays->d[k][l] = unit[k];
    }
    const double begin = t_min * scene->scale - shift, end = t_max * scene->scale - shift;
    /* distances from the origin to elements; what moving to packed coordinates and along the ray rounds */
    const double moved = (scene->center[0] != 0.0) | (scene->center[1] != 0.0) | (scene->center[2] != 0.0) ? world : 0.0;
    rays->magnitude[l] = sqrt(away2) + radius + moved;
    w->shift[i] = shift;
    w->begin[i] = begin;
    w->end[i] = valid && t_min < t_max && isfinite(rays->magnitude[l]) ? end : -BLOB_INFINITY;
    w->status[i] = valid ? BLOB_MISS : BLOB_INVALID;
    w->surface[i] = -1;
    w->hit_t[i] = BLOB_INFINITY;
    for (int k = 0; k < 3; k++) w->normal[k][i] = BLOB_NAN;
}

static void engine_rays(const blob_scene *scene, engine_scratch *w, const engine_block *block) {
    double middle[3], radius = 0.0;
    for (int k = 0; k < 3; k++) {
        middle[k] = 0.5 * (scene->lo[k] + scene->hi[k]);
        radius += 0.25 * (scene->hi[k] - scene->lo[k]) * (scene->hi[k] - scene->lo[k]);
    }
    radius = sqrt(radius);
    for (size_t i = 0; i < block->count; i++) engine_ray(scene, w, block, i, middle, radius);
    /* fill the last packet with copies of its first ray, which never search */
    for (size_t i = block->count; i % LANES; i++) {
        packet_rays *rays = &w->rays[i / LANES];
        const size_t l = i % LANES;
        for (int k = 0; k < 3; k++) rays->o[k][l] = rays->o[k][0], rays->d[k][l] = rays->d[k][0];
        rays->magnitude[l] = rays->magnitude[0];
        w->begin[i] = 0.0;
        w->end[i] = -BLOB_INFINITY;
    }
    for (size_t i = 0; i < ENGINE_RAYS; i++)
        w->evaluations[i] = w->nodes[i] = w->candidates[i] = w->spans[i] = w->sandwiches[i] = w->fallbacks[i] = 0;
}

/* ---- beams ------------------------------------------------------------------------------------ */

/* The window of one ray within the box of a surface. */
KERNEL_INLINE void engine_clip(const packet_rays *rays, int l, const index_tree *tree, double *begin, double *end) {
    const double grow = 1e-14 * rays->magnitude[l];
    for (int k = 0; k < 3; k++) {
        const double inverse = beam_reciprocal(rays->d[k][l]);
        const double u = (tree->lo[k] - grow - rays->o[k][l]) * inverse;
        const double v = (tree->hi[k] + grow - rays->o[k][l]) * inverse;
        *begin = kernel_max(*begin, kernel_min(u, v));
        *end = kernel_min(*end, kernel_max(u, v));
    }
}

/* Axis, spread and window of packets [first, first + count). 0: no ray of them meets the surface's box. */
static int engine_beam(const engine_scratch *w, const index_tree *tree, size_t first, size_t count, beam *b) {
    double rays = 0.0, length2 = 0.0, t_far = 0.0, magnitude = 0.0;
    b->t_begin = BLOB_INFINITY;
    b->t_end = -BLOB_INFINITY;
    for (int k = 0; k < 3; k++) b->o[k] = b->d[k] = 0.0;
    for (size_t p = first; p < first + count; p++) {
        const packet_rays *r = &w->rays[p];
        LANE_LOOP(l) {
            double begin = w->begin[p * LANES + (size_t)l], end = w->end[p * LANES + (size_t)l];
            engine_clip(r, l, tree, &begin, &end);
            if (!(begin < end)) continue;
            rays += 1.0;
            b->t_begin = kernel_min(b->t_begin, begin);
            b->t_end = kernel_max(b->t_end, end);
            magnitude = kernel_max(magnitude, r->magnitude[l]);
            for (int k = 0; k < 3; k++) b->o[k] += r->o[k][l], b->d[k] += r->d[k][l];
        }
    }
    if (rays == 0.0) return 0;
    for (int k = 0; k < 3; k++) b->o[k] /= rays, length2 += b->d[k] * b->d[k];
    for (int k = 0; k < 3; k++) b->d[k] /= sqrt(length2) > 0.0 ? sqrt(length2) : 1.0;
    double r0 = 0.0, r1 = 0.0;
    for (size_t p = first; p < first + count; p++) {
        const packet_rays *r = &w->rays[p];
        LANE_LOOP(l) {
            double begin = w->begin[p * LANES + (size_t)l], end = w->end[p * LANES + (size_t)l], u = 0.0, v = 0.0;
            engine_clip(r, l, tree, &begin, &end);
            if (!(begin < end)) continue;
            for (int k = 0; k < 3; k++) {
                u += (r->o[k][l] - b->o[k]) * (r->o[k][l] - b->o[k]);
                v += (r->d[k][l] - b->d[k]) * (r->d[k][l] - b->d[k]);
            }
            r0 = kernel_max(r0, u);
            r1 = kernel_max(r1, v);
        }
    }
    t_far = kernel_max(fabs(b->t_begin), fabs(b->t_end));
    b->r0 = sqrt(r0) * (1.0 + 1e-12) + 1e-13 * magnitude;
    b->r1 = sqrt(r1) * (1.0 + 1e-12) + 1e-15;
    b->box_spread = b->r0 + b->r1 * t_far;
    return 1;
}

/* ---- one packet against one surface -------------------------------------------------------------- */

static void engine_begin(search *s, const blob_scene *scene, const blob_index *index, engine_scratch *w, int32_t surface,
                         size_t packet_index) {
    const index_tree *tree = &index->trees[surface];
    const blob_surface *target = &scene->surfaces[surface];
    s->p.scene = scene;
    s->p.index = index;
    s->p.surface = target;
    s->p.scratch = &w->packet;
    s->p.rays = w->rays[packet_index];
    s->p.leaf_count = s->p.piece_count = s->p.step_count = 0;
    s->p.out_of_memory = 0;
    const blob_node *root = &scene->nodes[target->node_begin];
    const int flat = target->node_end - target->node_begin == 1 && root->op == OP_SUM;
    int32_t depth = 0;
    for (int32_t n = target->node_begin; n < target->node_end; n++)
        if (scene->nodes[n].depth + 1 > depth) depth = scene->nodes[n].depth + 1;
    s->p.depth = flat ? 0 : depth;
    s->threshold = target->threshold;
    s->reach = tree->typical_reach;
    LANE_LOOP(l) {
        const size_t i = packet_index * LANES + (size_t)l;
        double begin = w->begin[i], end = w->end[i];
        engine_clip(&w->rays[packet_index], l, tree, &begin, &end);
        /* cut to the box only where nothing can happen outside of it; else the sign at the start counts */
        s->p.t[l] = w->begin[i];
        s->p.end[l] = w->end[i];
        s->searching[l] = begin < end ? -1 : 0;
        if (begin > w->begin[i]) s->sign[l] = s->threshold >= 0.0 ? 1.0 : -1.0, s->p.t[l] = begin;
        else s->sign[l] = 0.0;
        if (end < w->end[i]) s->p.end[l] = end;
        s->flat_from[l] = s->flat_to[l] = BLOB_NAN;
        s->step[l] = s->reach;
        s->ripe[l] = 0.25 * s->reach;
        s->from_start[l] = -1;
        s->bracketed[l] = s->hit[l] = s->grazed[l] = 0;
        s->evaluations[l] = s->sandwiches[l] = s->fallbacks[l] = 0;
    }
}

static void engine_keep(const search *s, engine_scratch *w, int32_t surface, size_t packet_index) {
    LANE_LOOP(l) {
        const size_t i = packet_index * LANES + (size_t)l;
        w->evaluations[i] += (int32_t)s->evaluations[l];
        w->sandwiches[i] += (int32_t)s->sandwiches[l];
        w->fallbacks[i] += (int32_t)s->fallbacks[l];
        w->candidates[i] += (int32_t)s->p.leaf_count;
        if (s->hit[l]) {
            w->status[i] = s->sign[l] > 0.0 ? BLOB_ENTER : BLOB_EXIT;
            w->surface[i] = surface;
            w->hit_t[i] = s->hit_t[l];
            w->end[i] = s->hit_t[l];
            const double x = s->normal[0][l], y = s->normal[1][l], z = s->normal[2][l];
            const double largest = kernel_max(kernel_max(fabs(x), fabs(y)), fabs(z));
            const double u = x / largest, v = y / largest, r = z / largest, length = -sqrt(u * u + v * v + r * r);
            w->normal[0][i] = u / length;
            w->normal[1][i] = v / length;
            w->normal[2][i] = r / length;
        } else if (s->grazed[l] && w->status[i] == BLOB_MISS) {
            w->status[i] = BLOB_GRAZE;
        }
    }
}

static blob_status engine_packet(const blob_scene *scene, engine_scratch *w, beam *b, int32_t surface, size_t packet_index) {
    search s;
    engine_begin(&s, scene, b->index, w, surface, packet_index);
    lane_flag any = 0;
    LANE_LOOP(l) any |= s.searching[l];
    if (!any) return BLOB_OK;
    size_t from = 0;
    for (size_t c = 0;; c++) {
        if (c == b->chunk_count) beam_pull(b);
        if (b->out_of_memory) return BLOB_NO_MEMORY;
        const beam_chunk chunk = b->scratch->chunks[c];
        int added = 0;
        for (; from < chunk.end; from++) added |= packet_add(&s.p, b->scratch->items[from]);
        if (s.p.out_of_memory || !packet_plan(&s.p)) return BLOB_NO_MEMORY;
        search_advance(&s, chunk.limit);
        any = 0;
        LANE_LOOP(l) {
            any |= s.searching[l];
            w->spans[packet_index * LANES + (size_t)l] -= (int32_t)s.searching[l];
        }
        if (!any || chunk.limit == BLOB_INFINITY) break;
        packet_forget(&s.p);
    }
    engine_keep(&s, w, surface, packet_index);
    return BLOB_OK;
}

/* ---- blocks ---------------------------------------------------------------------------------------- */

static blob_status engine_packets(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                  engine_scratch *w, int32_t surface, size_t first, size_t count) {
    beam b;
    b.index = index;
    b.tree = &index->trees[surface];
    b.scratch = &w->beam;
    if (query->cancel && *query->cancel) return BLOB_CANCELLED;
    if (!engine_beam(w, b.tree, first, count, &b)) return BLOB_OK;
    /* wider than what matters to a ray: the parts have shorter lists than the whole */
    if (count > 1 && b.box_spread > b.tree->typical_reach) {
        const size_t half = count / 2;
        const blob_status status = engine_packets(scene, index, query, w, surface, first, half);
        return status ? status : engine_packets(scene, index, query, w, surface, first + half, count - half);
    }
    b.single = count == 1 && (b.box_spread > 0.25 * b.tree->typical_reach || b.r1 > 0.5) ? &w->rays[first] : NULL;
    b.out_of_memory = 0;
    beam_start(&b);
    for (size_t p = first; p < first + count; p++) {
        const blob_status status = engine_packet(scene, w, &b, surface, p);
        if (status) return status;
    }
    for (size_t i = first * LANES; i < (first + count) * LANES; i++) w->nodes[i] += (int32_t)b.nodes_opened;
    return BLOB_OK;
}

static void engine_write(const blob_scene *scene, const engine_scratch *w, const engine_block *block) {
    for (size_t i = 0; i < block->count; i++) {
        const int hit = w->surface[i] >= 0;
        if (block->any) {
            block->any[i] = (uint8_t)hit;
            continue;
        }
        const blob_hits *out = block->hits;
        out->status[i] = w->status[i];
        if (out->t) out->t[i] = hit ? (w->hit_t[i] + w->shift[i]) / scene->scale : BLOB_INFINITY;
        if (out->surface) out->surface[i] = w->surface[i];
        if (out->normal)
            for (size_t k = 0; k < 3; k++) out->normal[3 * i + k] = w->normal[k][i];
        if (out->evaluations) out->evaluations[i] = w->evaluations[i];
        if (out->nodes) out->nodes[i] = w->nodes[i];
        if (out->candidates) out->candidates[i] = w->candidates[i];
        if (out->spans) out->spans[i] = w->spans[i];
        if (out->sandwiches) out->sandwiches[i] = w->sandwiches[i];
        if (out->fallbacks) out->fallbacks[i] = w->fallbacks[i];
    }
}

blob_status ENGINE_NAME(engine_trace)(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                      engine_scratch *w, const engine_block *block) {
    engine_rays(scene, w, block);
    const size_t packets = (block->count + LANES - 1) / LANES;
    for (int32_t s = 0; s < scene->surface_count; s++) {
        const blob_status status = engine_packets(scene, index, query, w, s, 0, packets);
        if (status) return status;
    }
    engine_write(scene, w, block);
    return BLOB_OK;
}

/* ---- points ------------------------------------------------------------------------------------------- */

/* Elements around LANES points: rays without direction, whose t = 0 is the point. */
static blob_status engine_points(const blob_scene *scene, const blob_index *index, engine_scratch *w, int32_t surface,
                                 const double *points, size_t count, packet *p) {
    const index_tree *tree = &index->trees[surface];
    search s;
    for (int k = 0; k < 3; k++) {
        LANE_LOOP(l) {
            const size_t i = (size_t)l < count ? (size_t)l : 0;
            w->rays[0].o[k][l] = (points[3 * i + (size_t)k] - scene->center[k]) * scene->scale;
            w->rays[0].d[k][l] = 0.0;
        }
    }
    LANE_LOOP(l) w->rays[0].magnitude[l] = w->begin[l] = 0.0, w->end[l] = 1.0;
    engine_begin(&s, scene, index, w, surface, 0);
    *p = s.p;
    LANE_LOOP(l) p->t[l] = -DBL_MIN, p->end[l] = DBL_MIN;
    beam b = {.index = index, .tree = tree, .scratch = &w->beam, .single = &p->rays, .t_begin = -1.0, .t_end = 1.0};
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
    static const double zero[LANES] = {0.0};
    for (size_t i = 0; i < n; i += LANES) {
        const size_t count = n - i < LANES ? n - i : LANES;
        packet p;
        const blob_status status = engine_points(scene, index, w, surface, points + 3 * i, count, &p);
        if (status) return status;
        leaf_point f;
        packet_point(&p, zero, &f);
        for (size_t l = 0; l < count; l++) {
            field[i + l] = f.value[l];
            if (!gradient) continue;
            for (size_t k = 0; k < 3; k++) gradient[3 * (i + l) + k] = f.gradient[k][l] * scene->scale;
        }
    }
    return BLOB_OK;
}

blob_status ENGINE_NAME(engine_paint)(const blob_scene *scene, const blob_index *index, engine_scratch *w, size_t n,
                                      const double *points, const int32_t *surface, const double *materials,
                                      double *out) {
    paint_mix *stack = malloc((TREE_DEPTH + 2) * sizeof *stack);
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
