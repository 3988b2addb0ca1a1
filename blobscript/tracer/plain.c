/* plain.c - see plain.h. Compiled once per instruction set (BLOB_ISA), without fused operations.
 *
 * A block is 256 samples in Morton order of their pixels, in columns from end to end: unit directions, what they hit
 * (engine_look), the sky where that is nothing, what surfaces send back of the sky, and for each light the answers of
 * the points that face it and, close together, their rays to it (engine_leave). Those start from the hits as they are:
 * that they are on the surface is known. The few for which that does not do, and all on surfaces that are no plain
 * sums, get places mended by a Newton step, as in shade.c. The formulas are those of brdf.h and light.h.
 */
#define _POSIX_C_SOURCE 200809L
#include "plain.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "brdf.h"
#include "engine.h"
#include "lane.h"
#include "pattern.h"

#define PLAIN_JOIN_(a, b) a##b
#define PLAIN_JOIN(a, b) PLAIN_JOIN_(a, b)
#define PLAIN_NAME(name) PLAIN_JOIN(name##_, BLOB_ISA)

enum { PLAIN_BLOCK = ENGINE_RAYS, PLAIN_AREA = 16 };

/* Largest Newton step, as in shade.c. */
#define PLAIN_POLISH 1e-7

/* Brighter is cut to this, as in shade.c. */
#define PLAIN_BRIGHTEST 65504.0

typedef struct lanes3 {
    lane_real x, y, z;
} lanes3;

/* What a row of a material tells here. */
enum { ROW_COLOR, ROW_ROUGHNESS = 3, ROW_SPECULAR, ROW_EMISSION, ROW_COUNT = 8 };
static const size_t row_columns[ROW_COUNT] = {0, 1, 2, 3, 5, 11, 12, 13};

typedef struct plain_block {
    engine_scratch *look, *leave;           /* the first one's answers stay while the second asks */
    int alike, dark, glows;                 /* one material for all; the sky lights nothing; something emits light */
    size_t n;                               /* samples */
    uint8_t code[PLAIN_BLOCK];              /* their pixels of the area, in Morton order */
    int32_t x[PLAIN_BLOCK], y[PLAIN_BLOCK]; /* by code */
    size_t pixels;                          /* of the area that are in the tile */
    uint8_t spots[PLAIN_BLOCK + 1];         /* their codes */
    uint32_t key[PLAIN_BLOCK], sample[PLAIN_BLOCK];
    engine_column px, py, ways[3]; /* places in the picture, unit directions */
    engine_sight sight;
    engine_column normal[3], rows[ROW_COUNT], f0, base[3], facing; /* of what is hit; the normal on the eye's side */
    engine_column direct[3], indirect[3];                          /* light of the samples */
    engine_leaving leaving;
    LANE_ALIGN double slack[LANES]; /* lane_pack writes on */
    engine_column sent[3];          /* by a light, if nothing is in the way; 0 where it does not reach */
    engine_column sums[6];          /* direct and indirect light of the area's pixels */
    LANE_ALIGN lane_flag lit[PLAIN_BLOCK];
    uint8_t who[PLAIN_BLOCK + LANES]; /* samples of the leaving rays */
    double starts[PLAIN_BLOCK];       /* 0 */
    /* Places in the scene where they are asked for: of samples, those that are `mended`, and close together. */
    int8_t mended[PLAIN_BLOCK];
    double places[3 * PLAIN_BLOCK], together[3 * PLAIN_BLOCK], field[PLAIN_BLOCK], gradients[3 * PLAIN_BLOCK];
    double directions[3 * PLAIN_BLOCK], ends[PLAIN_BLOCK];
    double materials[BLOB_MATERIAL * PLAIN_BLOCK];
    int32_t which[PLAIN_BLOCK], surfaces[PLAIN_BLOCK];
    uint8_t blocked[PLAIN_BLOCK];
} plain_block;

/* ---- colours and directions in lanes ---------------------------------------------------------------- */

LANE_INLINE lanes3 lanes_all(const double *v) { return (lanes3){lane_all(v[0]), lane_all(v[1]), lane_all(v[2])}; }
LANE_INLINE lanes3 lanes_load(engine_column *v, size_t i) {
    return (lanes3){lane_load(v[0] + i), lane_load(v[1] + i), lane_load(v[2] + i)};
}
LANE_INLINE void lanes_store(engine_column *v, size_t i, lanes3 a) {
    lane_store(v[0] + i, a.x);
    lane_store(v[1] + i, a.y);
    lane_store(v[2] + i, a.z);
}

LANE_INLINE lanes3 lanes_add(lanes3 a, lanes3 b) { return (lanes3){a.x + b.x, a.y + b.y, a.z + b.z}; }
LANE_INLINE lanes3 lanes_times(lane_real s, lanes3 a) { return (lanes3){s * a.x, s * a.y, s * a.z}; }
LANE_INLINE lanes3 lanes_filter(lanes3 a, lanes3 b) { return (lanes3){a.x * b.x, a.y * b.y, a.z * b.z}; }
LANE_INLINE lane_real lanes_dot(lanes3 a, lanes3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
LANE_INLINE lanes3 lanes_blend(lanes3 a, lanes3 b, lane_real t) {
    return lanes_add(lanes_times(1.0 - t, a), lanes_times(t, b));
}
LANE_INLINE lanes3 lanes_pick(lane_bits m, lanes3 a, lanes3 b) {
    return (lanes3){lane_pick(m, a.x, b.x), lane_pick(m, a.y, b.y), lane_pick(m, a.z, b.z)};
}

/* 2^x for -1000 < x <= 0: a power of two times the series of e^(f ln 2), |f| <= 1/2; its 13th term is below 1e-16. */
LANE_INLINE lane_real plain_exp2(lane_real x) {
    const double shift = 0x1.8p52;
    const lane_real rounded = x + shift, f = (x - (rounded - shift)) * 0x1.62e42fefa39efp-1;
    lane_real sum = lane_all(1.0 / 479001600);
    static const double terms[] = {1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880, 1.0 / 40320, 1.0 / 5040, 1.0 / 720,
                                   1.0 / 120,      1.0 / 24,      1.0 / 6,      1.0 / 2,     1.0,        1.0};
    for (size_t i = 0; i < sizeof terms / sizeof *terms; i++) sum = sum * f + terms[i];
    return (lane_real)((lane_mask)sum + ((lane_mask)rounded << 52));
}

/* ---- the sky ------------------------------------------------------------------------------------------ */

/* sky_look, of a gradient or of colours. */
LANE_INLINE lanes3 plain_sky(const shade_sky *sky, lanes3 d) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    if (sky->kind == SHADE_GRADIENT) {
        const lane_real y = d.y - sky->level, rise = y / lane_sqrt(y * y + sky->bend * sky->bend);
        return lanes_blend(lanes_all(sky->below), lanes_all(sky->above), 0.5 + 0.5 * rise);
    }
    const lane_real far = 1.0 - d.y, x = lane_min(d.y / -0.12, one);
    const lane_mask up = d.y >= zero;
    const lanes3 level = lanes_all(sky->horizon);
    const lanes3 above = lanes_blend(lanes_all(sky->above), level, far * far * far);
    const lanes3 below = lanes_blend(level, lanes_all(sky->below), x * x * (3.0 - 2.0 * x));
    return (lanes3){lane_select(up, above.x, below.x), lane_select(up, above.y, below.y),
                    lane_select(up, above.z, below.z)};
}

/* sky_ambient. */
LANE_INLINE lanes3 plain_ambient(const shade_sky *sky, lanes3 n) {
    const double *m = sky->tilt, *even = sky->ambient;
    const lane_real zero = lane_all(0.0);
    return (lanes3){lane_max(even[0] + (m[0] * n.x + m[1] * n.y + m[2] * n.z), zero),
                    lane_max(even[1] + (m[3] * n.x + m[4] * n.y + m[5] * n.z), zero),
                    lane_max(even[2] + (m[6] * n.x + m[7] * n.y + m[8] * n.z), zero)};
}

/* ---- rays ----------------------------------------------------------------------------------------------- */

static void plain_cameras(const shade_picture *picture, plain_block *b) {
    if (picture->samples > 1) _Pragma("omp simd") for (size_t i = 0; i < b->n; i++) {
            const uint32_t key = b->key[i], sample = b->sample[i];
            b->px[i] += pattern_scramble(pattern_reverse(sample), pattern_hash(key ^ 0x68bc21ebu)) * 0x1p-32;
            b->py[i] += pattern_scramble(pattern_sobol(sample), pattern_hash(key ^ 0x02e5be93u)) * 0x1p-32;
        }
    const lanes3 corner = lanes_all(picture->corner), right = lanes_all(picture->right),
                 down = lanes_all(picture->down);
    for (size_t i = 0; i < b->n; i += LANES) {
        const lane_real x = lane_load(b->px + i), y = lane_load(b->py + i);
        const lanes3 across = lanes_add(lanes_times(x, right), lanes_times(y, down));
        lane_real way[3] = {corner.x + across.x, corner.y + across.y, corner.z + across.z};
        lane_normalise(way);
        lanes_store(b->ways, i, (lanes3){way[0], way[1], way[2]});
    }
}

/* Which of the samples from i on hit something. */
LANE_INLINE lane_bits plain_hits(const plain_block *b, size_t i) {
    return lane_less(lane_all(0.0), lane_abs(lane_load(b->sight.side + i)));
}

/* The sky where nothing is hit. */
static void plain_background(const plain_tile *tile, plain_block *b) {
    const shade_picture *picture = tile->picture;
    const lanes3 shown = lanes_all(picture->shown), none = lanes_all((const double[]){0.0, 0.0, 0.0});
    for (size_t i = 0; i < b->n; i += LANES) {
        const lane_bits hit = plain_hits(b, i);
        const lanes3 sky = picture->plain ? shown : plain_sky(&picture->sky, lanes_load(b->ways, i));
        lanes_store(b->direct, i, lanes_pick(hit, none, sky));
    }
}

/* ---- points ----------------------------------------------------------------------------------------------- */

/* The place of a sample in the scene. */
static void plain_place(const plain_tile *tile, const plain_block *b, size_t i, double *place) {
    const blob_scene *scene = tile->scene;
    for (size_t k = 0; k < 3; k++) place[k] = scene->center[k] + b->sight.place[k][i] / scene->scale;
}

/* Rows of the materials where they differ. */
static blob_status plain_materials(const plain_tile *tile, plain_block *b) {
    const shade_picture *picture = tile->picture;
    size_t count = 0;
    for (size_t i = 0; i < b->n; i++) {
        if (!(b->sight.side[i] != 0)) continue;
        if (picture->painted) plain_place(tile, b, i, b->together + 3 * count);
        b->surfaces[count] = b->sight.surface[i];
        b->which[count++] = (int32_t)i;
    }
    if (picture->painted) {
        const blob_status status = PLAIN_NAME(engine_paint)(tile->scene, tile->index, b->leave, count, b->together,
                                                            b->surfaces, picture->materials, b->materials);
        if (status != BLOB_OK) return status;
    }
    for (size_t p = 0; p < count; p++) {
        const size_t material = (size_t)picture->surface_material[b->surfaces[p]];
        const double *row =
            picture->painted ? b->materials + BLOB_MATERIAL * p : picture->materials + BLOB_MATERIAL * material;
        for (size_t k = 0; k < ROW_COUNT; k++) b->rows[k][b->which[p]] = row[row_columns[k]];
    }
    return BLOB_OK;
}

/* point_finish, brdf_layer and brdf_base, and point_even: what the points send back of the sky. */
static void plain_even(const plain_tile *tile, plain_block *b) {
    const shade_sky *sky = &tile->picture->sky;
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    const lanes3 none = {zero, zero, zero};
    for (size_t i = 0; i < b->n; i += LANES) {
        const lane_bits hit = plain_hits(b, i);
        lanes_store(b->indirect, i, none);
        if (!lane_some(hit)) continue;
        const lanes3 way = lanes_load(b->ways, i), eye = {-way.x, -way.y, -way.z},
                     given = lanes_load(b->sight.normal, i);
        const lane_real side = lane_load(b->sight.side + i);
        const lane_bits there = lane_less(lane_all(0.5), lanes_dot(given, given));
        const lanes3 normal = lanes_pick(there, lanes_times(side, given), eye);
        const lane_real cosine = lanes_dot(normal, eye), facing = lane_max(cosine, lane_all(1e-6));
        const lane_real roughness = lane_load(b->rows[ROW_ROUGHNESS] + i);
        const lane_real f0 = 0.08 * lane_load(b->rows[ROW_SPECULAR] + i);
        const lane_real x = 1.0 - roughness, y = 0.0425 - 0.0275 * roughness;
        const lane_real a004 = lane_min(x * x, plain_exp2(-9.28 * lane_min(facing, one))) * x + y;
        const lane_real scale = -1.04 * a004 + 1.04 - 0.572 * roughness;
        const lane_real offset = lane_max(1.04 * a004 - 0.04 + 0.022 * roughness, zero);
        const lane_real layer = lane_min(f0 * scale + offset, one);
        const lanes3 base = lanes_times(1.0 - layer, lanes_load(b->rows + ROW_COLOR, i));
        lanes_store(b->normal, i, normal);
        lane_store(b->f0 + i, f0);
        lane_store(b->facing + i, facing);
        lanes_store(b->base, i, base);
        if (b->glows) {
            const lanes3 glow = lanes_pick(hit, lanes_load(b->rows + ROW_EMISSION, i), none);
            lanes_store(b->direct, i, lanes_add(lanes_load(b->direct, i), glow));
        }
        if (b->dark) continue;
        const lanes3 image = {2.0 * cosine * normal.x - eye.x, 2.0 * cosine * normal.y - eye.y,
                              2.0 * cosine * normal.z - eye.z};
        const lanes3 blurred = lanes_blend(plain_sky(sky, image), plain_ambient(sky, image), roughness);
        const lanes3 sum = lanes_add(lanes_filter(base, plain_ambient(sky, normal)), lanes_times(layer, blurred));
        lanes_store(b->indirect, i, lanes_pick(hit, lanes_times(lane_all(sky->fill), sum), none));
    }
}

/* ---- lights ----------------------------------------------------------------------------------------------- */

/* brdf_specular times the rest of its light, and brdf_diffuse. */
LANE_INLINE lanes3 plain_answer(plain_block *b, size_t i, lanes3 way, lane_real nl, lanes3 irradiance) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0), roughness = lane_load(b->rows[ROW_ROUGHNESS] + i);
    const lanes3 from = lanes_load(b->ways, i), eye = {-from.x, -from.y, -from.z};
    const lanes3 normal = lanes_load(b->normal, i), sum = lanes_add(way, eye);
    const lane_real nv = lane_load(b->facing + i), length = lane_sqrt(lanes_dot(sum, sum));
    const lane_mask there = length > zero;
    const lane_real inverse = lane_inverse(lane_select(there, length, one));
    const lane_real nh = lane_select(there, inverse * lanes_dot(normal, sum), one);
    const lane_real vh = lane_max(lane_select(there, inverse * lanes_dot(eye, sum), nv), zero),
                    vl = lanes_dot(eye, way);
    const lane_real s = vl - nl * nv, stretch = lane_select(s > zero, s * lane_inverse(lane_max(nl, nv)), s);
    const lane_real sigma = 0.5 * roughness, level = lane_inverse(brdf_pi + (brdf_pi / 2 - 2.0 / 3) * sigma);
    const lanes3 diffuse =
        lanes_times(nl * level * (1.0 + sigma * (stretch + BRDF_LIFT(nl) * BRDF_LIFT(nv))), lanes_load(b->base, i));
    const lane_real alpha = lane_max(roughness * roughness, lane_all(BRDF_MIN_ALPHA)), a2 = alpha * alpha;
    const lane_real bowl = lane_max(nh * nh * (a2 - 1.0) + 1.0, a2);
    const lane_real in = nl * lane_sqrt(nv * nv * (1.0 - a2) + a2), out = nv * lane_sqrt(nl * nl * (1.0 - a2) + a2);
    const lane_real strength = nl * 0.5 * a2 * lane_inverse((in + out) * (brdf_pi * bowl * bowl));
    const lane_real far = 1.0 - vh, f0 = lane_load(b->f0 + i);
    const lane_real layer = strength * (f0 + far * far * far * far * far * (1.0 - f0));
    return lanes_filter(irradiance, lanes_add(diffuse, (lanes3){layer, layer, layer}));
}

/* The samples that the light can reach, with what it sends by way of them, and their rays to it. */
static void plain_aim(const plain_tile *tile, const shade_light *light, plain_block *b) {
    const lane_real zero = lane_all(0.0);
    const lanes3 place = lanes_all(light->place), color = lanes_all(light->color), none = {zero, zero, zero};
    const double unit = 1.0 / tile->scene->scale;
    engine_leaving *leaving = &b->leaving;
    size_t n = 0;
    for (size_t i = 0; i < b->n; i += LANES) {
        const lane_bits seen = lane_less(zero, lane_load(b->sight.side + i));
        lane_store_mask(b->lit + i, (lane_mask){0});
        if (!lane_some(seen)) continue;
        const lanes3 normal = lanes_load(b->normal, i), here = lanes_load(b->sight.place, i);
        lanes3 way = place, irradiance = color;
        lane_real distance = lane_all(HUGE_VAL);
        if (light->kind == SHADE_LAMP) {
            const lanes3 there = lanes_add(lanes_all(tile->scene->center), lanes_times(lane_all(unit), here));
            way = lanes_add(place, lanes_times(lane_all(-1.0), there));
            const lane_real square = lanes_dot(way, way);
            distance = lane_sqrt(square);
            const lane_real nearness = lane_inverse(distance);
            way = lanes_times(nearness, way);
            irradiance = lanes_times(nearness * nearness, irradiance);
        }
        const lane_real nl = lanes_dot(normal, way);
        const lane_bits faces = lane_both(seen, lane_both(lane_less(zero, nl), lane_less(zero, distance)));
        if (!lane_some(faces)) continue;
        const lanes3 sent = plain_answer(b, i, way, nl, irradiance);
        const lane_bits on = lane_both(faces, lane_less(zero, lane_max(sent.x, lane_max(sent.y, sent.z))));
        lanes_store(b->sent, i, lanes_pick(on, sent, none));
        lane_pack(leaving->place[0] + n, on, here.x);
        lane_pack(leaving->place[1] + n, on, here.y);
        lane_pack(leaving->place[2] + n, on, here.z);
        lane_pack(leaving->way[0] + n, on, way.x);
        lane_pack(leaving->way[1] + n, on, way.y);
        lane_pack(leaving->way[2] + n, on, way.z);
        lane_pack(leaving->end + n, on, distance);
        LANE_ALIGN lane_flag is_on[LANES];
        lane_store_mask(is_on, lane_mask_of(on));
        for (size_t l = 0; l < LANES; l++) {
            b->who[n] = (uint8_t)(i + l);
            n += (size_t)(is_on[l] != 0);
        }
    }
    for (size_t r = 0; r < n; r++) leaving->surface[r] = b->sight.surface[b->who[r]];
    leaving->count = n;
}

/* Processor time of this thread, in the blocks that are timed. */
static double plain_clock(const plain_tile *tile) {
    if (tile->blocks % PLAIN_TIMED) return 0;
    struct timespec now;
#if defined(CLOCK_THREAD_CPUTIME_ID)
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
#else
    timespec_get(&now, TIME_UTC);
#endif
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* One Newton step for each of some samples that are on one surface; as point_polish in shade.c. */
static blob_status plain_step(const plain_tile *tile, plain_block *b, int32_t surface, size_t count) {
    const blob_status status = PLAIN_NAME(engine_field)(tile->scene, tile->index, b->leave, surface, b->together, count,
                                                        b->field, b->gradients);
    if (status != BLOB_OK) return status;
    const double threshold = tile->picture->thresholds[surface];
    for (size_t i = 0; i < count; i++) {
        double *place = b->places + 3 * (size_t)b->which[i];
        const vector g = vector_of(b->gradients + 3 * i), here = vector_of(b->together + 3 * i);
        const vector way = subtract(here, vector_of(tile->picture->eye));
        const double square = dot(g, g), most = PLAIN_POLISH * (sqrt(dot(way, way)) + sqrt(dot(here, here)));
        const vector step = times((threshold - b->field[i]) / square, g);
        vector_put(square > 0 && dot(step, step) <= most * most ? add(here, step) : here, place);
    }
    return BLOB_OK;
}

/* The places of the leaving rays that are not sure, so that they start on the surface; once for all lights. */
static blob_status plain_mend(const plain_tile *tile, plain_block *b) {
    for (int32_t last = -1;;) {
        int32_t s = INT32_MAX; /* the next surface of any */
        size_t count = 0;
        for (size_t r = 0; r < b->leaving.count; r++) {
            if (b->leaving.dark[r] != ENGINE_UNSURE || b->mended[b->who[r]]) continue;
            if (b->leaving.surface[r] > last && b->leaving.surface[r] < s) s = b->leaving.surface[r];
        }
        if (s == INT32_MAX) return BLOB_OK;
        last = s;
        for (size_t r = 0; r < b->leaving.count; r++) {
            const size_t i = b->who[r];
            if (b->leaving.dark[r] != ENGINE_UNSURE || b->mended[i] || b->leaving.surface[r] != s) continue;
            plain_place(tile, b, i, b->together + 3 * count);
            b->mended[i] = 1;
            b->which[count++] = (int32_t)i;
        }
        const blob_status status = plain_step(tile, b, s, count);
        if (status != BLOB_OK) return status;
    }
}

/* Leaving rays that are not sure, by the general search. */
static blob_status plain_make_sure(const plain_tile *tile, plain_block *b) {
    blob_status status = plain_mend(tile, b);
    size_t count = 0;
    for (size_t r = 0; r < b->leaving.count; r++) {
        if (b->leaving.dark[r] != ENGINE_UNSURE) continue;
        memcpy(b->together + 3 * count, b->places + 3 * (size_t)b->who[r], 3 * sizeof(double));
        for (size_t k = 0; k < 3; k++) b->directions[3 * count + k] = b->leaving.way[k][r];
        b->ends[count] = b->leaving.end[r];
        b->which[count++] = (int32_t)r;
    }
    const engine_block block = {.count = count,
                                .origins = b->together,
                                .directions = b->directions,
                                .t_min = b->starts,
                                .t_max = b->ends,
                                .any = b->blocked};
    if (status == BLOB_OK && count)
        status = PLAIN_NAME(engine_trace)(tile->scene, tile->index, tile->query, b->leave, &block);
    for (size_t p = 0; p < count && status == BLOB_OK; p++) b->leaving.dark[b->which[p]] = b->blocked[p];
    return status;
}

static blob_status plain_leave(plain_tile *tile, plain_block *b) {
    const double start = plain_clock(tile);
    blob_status status = PLAIN_NAME(engine_leave)(tile->scene, tile->index, tile->query, b->leave, &b->leaving);
    int unsure = 0;
    for (size_t r = 0; r < b->leaving.count; r++) unsure |= b->leaving.dark[r] == ENGINE_UNSURE;
    if (status == BLOB_OK && unsure) status = plain_make_sure(tile, b);
    tile->seconds[0] += plain_clock(tile) - start;
    return status;
}

static blob_status plain_lights(plain_tile *tile, plain_block *b) {
    const lane_real zero = lane_all(0.0);
    for (int32_t k = 0; k < tile->picture->light_count; k++) {
        plain_aim(tile, &tile->picture->lights[k], b);
        if (!b->leaving.count) continue;
        const blob_status status = plain_leave(tile, b);
        if (status != BLOB_OK) return status;
        for (size_t r = 0; r < b->leaving.count; r++) b->lit[b->who[r]] = b->leaving.dark[r] ? 0 : -1;
        for (size_t i = 0; i < b->n; i += LANES) {
            const lane_bits lit = lane_bits_of(lane_load_mask(b->lit + i));
            if (!lane_some(lit)) continue;
            const lanes3 sent = lanes_pick(lit, lanes_load(b->sent, i), (lanes3){zero, zero, zero});
            lanes_store(b->direct, i, lanes_add(lanes_load(b->direct, i), sent));
        }
    }
    return BLOB_OK;
}

/* ---- blocks ------------------------------------------------------------------------------------------------- */

/* The samples' light, to the sums of their pixels. */
static void plain_gather(const plain_tile *tile, plain_block *b) {
    const size_t parts = b->dark || b->sight.hits == 0 ? 3 : 6;
    for (size_t k = 0; k < parts; k++) {
        const double *from = k < 3 ? b->direct[k] : b->indirect[k - 3];
        double *sums = b->sums[k];
        if (tile->picture->samples == 1 && b->n == PLAIN_BLOCK) memcpy(sums, from, sizeof b->sums[k]);
        else
            for (size_t i = 0; i < b->n; i++) sums[b->code[i]] += from[i];
    }
}

static blob_status plain_shade(plain_tile *tile, plain_block *b) {
    plain_cameras(tile->picture, b);
    const double start = plain_clock(tile);
    blob_status status = PLAIN_NAME(engine_look)(tile->scene, tile->index, tile->query, b->look, tile->picture->eye,
                                                 b->n, b->ways, &b->sight);
    tile->seconds[0] += plain_clock(tile) - start;
    if (status != BLOB_OK) return status;
    plain_background(tile, b);
    if (b->sight.hits) {
        memset(b->mended, 0, sizeof b->mended);
        if (!b->alike) status = plain_materials(tile, b);
        if (status != BLOB_OK) return status;
        plain_even(tile, b);
        status = plain_lights(tile, b);
    }
    if (status == BLOB_OK) plain_gather(tile, b);
    return status;
}

static blob_status plain_next(plain_tile *tile, plain_block *b) {
    if (tile->query->cancel && *tile->query->cancel) return BLOB_CANCELLED;
    const double start = plain_clock(tile);
    const blob_status status = plain_shade(tile, b);
    tile->seconds[1] += plain_clock(tile) - start;
    tile->blocks++;
    b->n = 0;
    return status;
}

/* ---- areas -------------------------------------------------------------------------------------------------- */

static uint32_t plain_bits(uint32_t code) {
    code &= 0x55u;
    code = (code | code >> 1) & 0x33u;
    return (code | code >> 2) & 0x0fu;
}

/* The pixels of an area, from their sums. */
static void plain_write(const plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    const double share = 1.0 / tile->picture->samples;
    LANE_ALIGN float colors[4][PLAIN_BLOCK];
    for (size_t k = 0; k < 3; k++) {
        const double *direct = b->sums[k], *indirect = b->sums[3 + k];
        _Pragma("omp simd") for (size_t i = 0; i < PLAIN_BLOCK; i++) {
            const double mean = share * (direct[i] + indirect[i]);
            colors[k][i] = (float)(mean < PLAIN_BRIGHTEST ? mean : PLAIN_BRIGHTEST);
        }
    }
    const size_t across = (size_t)(tile->x1 - tile->x0);
    for (size_t i = 0; i < b->pixels; i++) {
        const size_t code = b->spots[i];
        const size_t x = (size_t)(left - tile->x0 + b->x[code]), y = (size_t)(top - tile->y0 + b->y[code]);
        float *rgba = tile->rgba + 4 * (y * across + x);
        for (size_t k = 0; k < 3; k++) rgba[k] = colors[k][code];
        rgba[3] = 1;
        for (size_t k = 0; tile->light && k < 6; k++) tile->light[6 * (y * across + x) + k] = b->sums[k][code];
    }
}

/* The pixels of an area that are in the tile. */
static void plain_spots(const plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    b->pixels = 0;
    for (uint32_t code = 0; code < PLAIN_BLOCK; code++) {
        const int32_t x = left + b->x[code], y = top + b->y[code];
        b->spots[b->pixels] = (uint8_t)code;
        b->pixels += (size_t)(x >= tile->x0 && x < tile->x1 && y >= tile->y0 && y < tile->y1);
    }
}

/* One sample each, in the middle. */
static blob_status plain_middles(plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    for (size_t i = 0; i < b->pixels; i++) {
        b->code[i] = b->spots[i];
        b->px[i] = left + b->x[b->spots[i]] + 0.5;
        b->py[i] = top + b->y[b->spots[i]] + 0.5;
    }
    b->n = b->pixels;
    return plain_next(tile, b);
}

/* All samples of one pixel after another. */
static blob_status plain_spread(plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    const shade_picture *picture = tile->picture;
    blob_status status = BLOB_OK;
    for (size_t p = 0; p < b->pixels; p++) {
        const uint8_t code = b->spots[p];
        const int32_t x = left + b->x[code], y = top + b->y[code];
        const uint32_t key = pattern_pixel((uint32_t)x, (uint32_t)y, picture->seed);
        for (int32_t i = 0; i < picture->samples; i++) {
            const size_t at = b->n++;
            b->code[at] = code;
            b->key[at] = key;
            b->sample[at] = (uint32_t)i;
            b->px[at] = x;
            b->py[at] = y;
            if (b->n == PLAIN_BLOCK) status = plain_next(tile, b);
            if (status != BLOB_OK) return status;
        }
    }
    return b->n ? plain_next(tile, b) : BLOB_OK;
}

/* The samples of an area in Morton order of its pixels. */
static blob_status plain_area(plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    plain_spots(tile, b, left, top);
    memset(b->sums, 0, sizeof b->sums);
    const blob_status status = (tile->picture->samples == 1 ? plain_middles : plain_spread)(tile, b, left, top);
    if (status == BLOB_OK) plain_write(tile, b, left, top);
    return status;
}

/* ---- tiles -------------------------------------------------------------------------------------------------- */

static int plain_is_zero(const double *v, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (v[i] != 0) return 0;
    return 1;
}

/* What is the same for all blocks. */
static void plain_prepare(const plain_tile *tile, plain_block *b) {
    for (uint32_t code = 0; code < PLAIN_BLOCK; code++) {
        b->x[code] = (int32_t)plain_bits(code);
        b->y[code] = (int32_t)plain_bits(code >> 1);
    }
    const shade_picture *picture = tile->picture;
    const shade_sky *sky = &picture->sky;
    const int black = plain_is_zero(sky->above, 3) && plain_is_zero(sky->below, 3) && plain_is_zero(sky->horizon, 3) &&
                      plain_is_zero(sky->ambient, 3) && plain_is_zero(sky->tilt, 9);
    b->dark = black || sky->fill == 0;
    b->alike = !picture->painted;
    for (int32_t s = 1; s < tile->scene->surface_count; s++)
        b->alike &= picture->surface_material[s] == picture->surface_material[0];
    for (int32_t i = 0; i < picture->material_count; i++)
        b->glows |= !plain_is_zero(picture->materials + BLOB_MATERIAL * (size_t)i + row_columns[ROW_EMISSION], 3);
    if (!b->alike || tile->scene->surface_count == 0) return;
    const double *row = picture->materials + BLOB_MATERIAL * (size_t)picture->surface_material[0];
    for (size_t k = 0; k < ROW_COUNT; k++)
        for (size_t i = 0; i < PLAIN_BLOCK; i++) b->rows[k][i] = row[row_columns[k]];
}

static blob_status plain_areas(plain_tile *tile, plain_block *b) {
    blob_status status = BLOB_OK;
    plain_prepare(tile, b);
    for (int32_t y = tile->y0 & -PLAIN_AREA; y < tile->y1 && status == BLOB_OK; y += PLAIN_AREA)
        for (int32_t x = tile->x0 & -PLAIN_AREA; x < tile->x1 && status == BLOB_OK; x += PLAIN_AREA)
            status = plain_area(tile, b, x, y);
    return status;
}

blob_status PLAIN_NAME(plain_make)(plain_tile *tile) {
    plain_block *b = aligned_alloc(64, (sizeof *b + 63) / 64 * 64);
    if (!b) return BLOB_NO_MEMORY;
    memset(b, 0, offsetof(plain_block, mended)); /* lanes beyond the last sample are computed, too, and never read */
    b->look = PLAIN_NAME(engine_scratch_new)();
    b->leave = PLAIN_NAME(engine_scratch_new)();
    const blob_status status = b->look && b->leave ? plain_areas(tile, b) : BLOB_NO_MEMORY;
    PLAIN_NAME(engine_scratch_free)(b->look);
    PLAIN_NAME(engine_scratch_free)(b->leave);
    free(b);
    return status;
}
