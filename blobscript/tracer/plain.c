/* plain.c - see plain.h. Compiled once per instruction set (BLOB_ISA), without fused operations.
 *
 * A block is 256 samples in Morton order of their pixels; each step goes over the block in lanes: directions, first
 * hits, the sky where nothing is hit, places and normals of the rest close together, what they send back of the sky,
 * and for each light the answers and one batch of shadow rays. The formulas are those of brdf.h and light.h.
 */
#define _POSIX_C_SOURCE 200809L
#include "plain.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "brdf.h"
#include "lane.h"
#include "pattern.h"

#define PLAIN_JOIN_(a, b) a##b
#define PLAIN_JOIN(a, b) PLAIN_JOIN_(a, b)
#define PLAIN_NAME(name) PLAIN_JOIN(name##_, BLOB_ISA)

enum { PLAIN_BLOCK = 256, PLAIN_AREA = 16 };

/* Largest Newton step, as in shade.c. */
#define PLAIN_POLISH 1e-7

typedef struct lanes3 {
    lane_real x, y, z;
} lanes3;

/* Numbers of a block, eight together. */
typedef double plain_column[PLAIN_BLOCK] __attribute__((aligned(64)));

/* What a row of a material tells here. */
enum { ROW_COLOR, ROW_ROUGHNESS = 3, ROW_SPECULAR, ROW_EMISSION, ROW_COUNT = 8 };
static const size_t row_columns[ROW_COUNT] = {0, 1, 2, 3, 5, 11, 12, 13};

typedef struct plain_block {
    size_t n; /* samples */
    int32_t pixel[PLAIN_BLOCK];
    uint32_t key[PLAIN_BLOCK], sample[PLAIN_BLOCK];
    plain_column px, py, ways[3]; /* places in the picture, unit directions */
    double origins[3 * PLAIN_BLOCK], directions[3 * PLAIN_BLOCK], starts[PLAIN_BLOCK], ends[PLAIN_BLOCK];
    int8_t status[PLAIN_BLOCK];
    double t[PLAIN_BLOCK], normals[3 * PLAIN_BLOCK];
    int32_t surface[PLAIN_BLOCK];
    /* The points that are hit: their rays, and what is known of them. */
    size_t points;
    int32_t ray[PLAIN_BLOCK], surfaces[PLAIN_BLOCK];
    plain_column place[3], normal[3], eye[3], rows[ROW_COUNT], far;
    double places[3 * PLAIN_BLOCK], materials[BLOB_MATERIAL * PLAIN_BLOCK];
    int32_t which[PLAIN_BLOCK];
    double together[3 * PLAIN_BLOCK], field[PLAIN_BLOCK], gradients[3 * PLAIN_BLOCK];
    LANE_ALIGN lane_flag front[PLAIN_BLOCK]; /* seen from outside */
    plain_column f0, base[3], layer[3], facing;
    plain_column sent[3], toward[3]; /* light to the eye, and where it is from */
    double shadow_origins[3 * PLAIN_BLOCK], shadow_directions[3 * PLAIN_BLOCK];
    int32_t lit[PLAIN_BLOCK];
    uint8_t blocked[PLAIN_BLOCK];
} plain_block;

/* ---- colours and directions in lanes ---------------------------------------------------------------- */

LANE_INLINE lanes3 lanes_all(const double *v) { return (lanes3){lane_all(v[0]), lane_all(v[1]), lane_all(v[2])}; }
LANE_INLINE lanes3 lanes_load(plain_column *v, size_t i) {
    return (lanes3){lane_load(v[0] + i), lane_load(v[1] + i), lane_load(v[2] + i)};
}
LANE_INLINE void lanes_store(plain_column *v, size_t i, lanes3 a) {
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
LANE_INLINE lanes3 lanes_unit(lanes3 a) { return lanes_times(1.0 / lane_sqrt(lanes_dot(a, a)), a); }

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
        lanes_store(b->ways, i, lanes_unit(lanes_add(corner, across)));
    }
    for (size_t i = 0; i < b->n; i++)
        for (size_t k = 0; k < 3; k++) b->directions[3 * i + k] = b->ways[k][i];
}

static void plain_deposit(const plain_tile *tile, int32_t pixel, int part, double x, double y, double z) {
    double *sum = tile->light + 3 * (PLAIN_PARTS * (size_t)pixel + (size_t)part);
    sum[0] += x;
    sum[1] += y;
    sum[2] += z;
}

static int plain_hit(int8_t status) { return status == BLOB_ENTER || status == BLOB_EXIT; }

/* The sky where nothing is hit; the rays that hit become points. */
static void plain_split(const plain_tile *tile, plain_block *b) {
    const shade_picture *picture = tile->picture;
    size_t points = 0;
    for (size_t i = 0; i < b->n; i += LANES) {
        const size_t end = i + LANES < b->n ? i + LANES : b->n;
        size_t missed = 0;
        for (size_t k = i; k < end; k++) {
            b->ray[points] = (int32_t)k;
            points += (size_t)plain_hit(b->status[k]);
            missed += (size_t)!plain_hit(b->status[k]);
        }
        if (!missed) continue;
        lanes_store(b->sent, i,
                    picture->plain ? lanes_all(picture->shown) : plain_sky(&picture->sky, lanes_load(b->ways, i)));
        for (size_t k = i; k < end; k++)
            if (!plain_hit(b->status[k]))
                plain_deposit(tile, b->pixel[k], 0, b->sent[0][k], b->sent[1][k], b->sent[2][k]);
    }
    b->points = points;
}

/* ---- points ----------------------------------------------------------------------------------------------- */

/* Places and normals, on the side of the eye. */
static void plain_points(const plain_tile *tile, plain_block *b) {
    for (size_t p = 0; p < b->points; p++) {
        const size_t i = (size_t)b->ray[p];
        const double *n = b->normals + 3 * i;
        const int front = b->status[i] == BLOB_ENTER, there = n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 0.5;
        for (size_t k = 0; k < 3; k++) {
            b->eye[k][p] = -b->ways[k][i];
            b->normal[k][p] = !there ? b->eye[k][p] : front ? n[k] : -n[k];
            b->places[3 * p + k] = tile->picture->eye[k] + b->t[i] * b->ways[k][i];
        }
        b->far[p] = b->t[i];
        b->front[p] = -front;
        b->surfaces[p] = b->surface[i];
    }
}

/* As point_polish and polish_places in shade.c: one Newton step, so that shadow rays start on the surface. */
static blob_status plain_polish(plain_tile *tile, plain_block *b) {
    for (int32_t last = -1;;) {
        int32_t s = INT32_MAX; /* the next surface of any point */
        size_t count = 0;
        for (size_t p = 0; p < b->points; p++)
            if (b->surfaces[p] > last && b->surfaces[p] < s) s = b->surfaces[p];
        if (s == INT32_MAX) return BLOB_OK;
        last = s;
        for (size_t p = 0; p < b->points; p++) {
            if (b->surfaces[p] != s) continue;
            memcpy(b->together + 3 * count, b->places + 3 * p, 3 * sizeof(double));
            b->which[count++] = (int32_t)p;
        }
        const blob_status status = blob_field(tile->scene, tile->index, s, count, b->together, b->field, b->gradients);
        if (status != BLOB_OK) return status;
        const double threshold = tile->picture->thresholds[s];
        for (size_t i = 0; i < count; i++) {
            const size_t p = (size_t)b->which[i];
            const vector g = vector_of(b->gradients + 3 * i), here = vector_of(b->places + 3 * p);
            const double square = dot(g, g), most = PLAIN_POLISH * (b->far[p] + sqrt(dot(here, here)));
            const vector step = times((threshold - b->field[i]) / square, g);
            if (square > 0 && dot(step, step) <= most * most) vector_put(add(here, step), b->places + 3 * p);
        }
    }
}

static blob_status plain_materials(const plain_tile *tile, plain_block *b) {
    const shade_picture *picture = tile->picture;
    if (picture->painted) {
        const blob_status status =
            blob_paint(tile->scene, tile->index, b->points, b->places, b->surfaces, picture->materials, b->materials);
        if (status != BLOB_OK) return status;
    }
    for (size_t p = 0; p < b->points; p++) {
        const int32_t material = picture->surface_material[b->surfaces[p]];
        const double *row =
            picture->painted ? b->materials + BLOB_MATERIAL * p : picture->materials + BLOB_MATERIAL * (size_t)material;
        for (size_t k = 0; k < ROW_COUNT; k++) b->rows[k][p] = row[row_columns[k]];
        for (size_t k = 0; k < 3; k++) b->place[k][p] = b->places[3 * p + k];
    }
    return BLOB_OK;
}

/* point_finish, brdf_layer and brdf_base, and point_even: what the points send back of the sky. */
static void plain_even(const plain_tile *tile, plain_block *b) {
    const shade_sky *sky = &tile->picture->sky;
    const lane_real zero = lane_all(0.0), one = lane_all(1.0);
    for (size_t i = 0; i < b->points; i += LANES) {
        const lanes3 normal = lanes_load(b->normal, i), eye = lanes_load(b->eye, i);
        const lane_real cosine = lanes_dot(normal, eye), facing = lane_max(cosine, lane_all(1e-6));
        const lane_real roughness = lane_load(b->rows[ROW_ROUGHNESS] + i);
        const lane_real f0 = 0.08 * lane_load(b->rows[ROW_SPECULAR] + i);
        const lane_real x = 1.0 - roughness, y = 0.0425 - 0.0275 * roughness;
        const lane_real a004 = lane_min(x * x, plain_exp2(-9.28 * lane_min(facing, one))) * x + y;
        const lane_real scale = -1.04 * a004 + 1.04 - 0.572 * roughness;
        const lane_real offset = lane_max(1.04 * a004 - 0.04 + 0.022 * roughness, zero);
        const lane_real layer = lane_min(f0 * scale + offset, one);
        const lanes3 base = lanes_times(1.0 - layer, lanes_load(b->rows + ROW_COLOR, i));
        const lanes3 image = {2.0 * cosine * normal.x - eye.x, 2.0 * cosine * normal.y - eye.y,
                              2.0 * cosine * normal.z - eye.z};
        const lanes3 blurred = lanes_blend(plain_sky(sky, image), plain_ambient(sky, image), roughness);
        const lanes3 sum = lanes_add(lanes_filter(base, plain_ambient(sky, normal)), lanes_times(layer, blurred));
        lanes_store(b->sent, i, lanes_times(lane_all(sky->fill), sum));
        lane_store(b->f0 + i, f0);
        lane_store(b->facing + i, facing);
        lanes_store(b->base, i, base);
    }
    for (size_t p = 0; p < b->points; p++) {
        const int32_t pixel = b->pixel[b->ray[p]];
        plain_deposit(tile, pixel, 1, b->sent[0][p], b->sent[1][p], b->sent[2][p]);
        plain_deposit(tile, pixel, 0, b->rows[ROW_EMISSION][p], b->rows[ROW_EMISSION + 1][p],
                      b->rows[ROW_EMISSION + 2][p]);
    }
}

/* ---- lights ----------------------------------------------------------------------------------------------- */

/* brdf_specular times the rest of its light, and brdf_diffuse. */
LANE_INLINE lanes3 plain_answer(plain_block *b, size_t i, lanes3 way, lane_real nl, lanes3 irradiance) {
    const lane_real zero = lane_all(0.0), one = lane_all(1.0), roughness = lane_load(b->rows[ROW_ROUGHNESS] + i);
    const lanes3 eye = lanes_load(b->eye, i), normal = lanes_load(b->normal, i), sum = lanes_add(way, eye);
    const lane_real nv = lane_load(b->facing + i), length = lane_sqrt(lanes_dot(sum, sum));
    const lane_mask there = length > zero;
    const lane_real inverse = 1.0 / lane_select(there, length, one);
    const lane_real nh = lane_select(there, inverse * lanes_dot(normal, sum), one);
    const lane_real vh = lane_max(lane_select(there, inverse * lanes_dot(eye, sum), nv), zero),
                    vl = lanes_dot(eye, way);
    const lane_real s = vl - nl * nv, stretch = lane_select(s > zero, s / lane_max(nl, nv), s);
    const lane_real sigma = 0.5 * roughness, level = 1.0 / (brdf_pi + (brdf_pi / 2 - 2.0 / 3) * sigma);
    const lanes3 diffuse = lanes_times(nl * level * (1.0 + sigma * stretch), lanes_load(b->base, i));
    const lane_real alpha = lane_max(roughness * roughness, lane_all(BRDF_MIN_ALPHA)), a2 = alpha * alpha;
    const lane_real bowl = lane_max(nh * nh * (a2 - 1.0) + 1.0, a2);
    const lane_real in = nl * lane_sqrt(nv * nv * (1.0 - a2) + a2), out = nv * lane_sqrt(nl * nl * (1.0 - a2) + a2);
    const lane_real strength = nl * 0.5 * a2 / ((in + out) * (brdf_pi * bowl * bowl));
    const lane_real far = 1.0 - vh, f0 = lane_load(b->f0 + i);
    const lane_real layer = strength * (f0 + far * far * far * far * far * (1.0 - f0));
    return lanes_filter(irradiance, lanes_add(diffuse, (lanes3){layer, layer, layer}));
}

/* The points that the light can reach, with what it sends by way of them and their shadow rays. Returns how many. */
static size_t plain_aim(const shade_light *light, plain_block *b) {
    const lane_real zero = lane_all(0.0);
    const lanes3 place = lanes_all(light->place), color = lanes_all(light->color);
    size_t n = 0;
    for (size_t i = 0; i < b->points; i += LANES) {
        const lanes3 normal = lanes_load(b->normal, i);
        lanes3 way = place, irradiance = color;
        lane_real distance = lane_all(HUGE_VAL);
        if (light->kind == SHADE_LAMP) {
            way = lanes_add(place, lanes_times(lane_all(-1.0), lanes_load(b->place, i)));
            const lane_real square = lanes_dot(way, way);
            distance = lane_sqrt(square);
            way = lanes_times(1.0 / distance, way);
            irradiance = lanes_times(1.0 / square, irradiance);
        }
        const lane_real nl = lanes_dot(normal, way);
        const lane_mask lit = lane_load_mask(b->front + i) & (nl > zero) & (distance > zero);
        if (!lane_any(lit)) continue;
        const lanes3 sent = plain_answer(b, i, way, nl, irradiance);
        LANE_ALIGN lane_flag on[LANES];
        LANE_ALIGN double columns[7][LANES];
        lane_store_mask(on, lit & (lane_max(sent.x, lane_max(sent.y, sent.z)) > zero));
        lane_store(columns[0], way.x), lane_store(columns[1], way.y), lane_store(columns[2], way.z);
        lane_store(columns[3], sent.x), lane_store(columns[4], sent.y), lane_store(columns[5], sent.z);
        lane_store(columns[6], distance);
        for (size_t l = 0; l < LANES && i + l < b->points; l++) {
            if (!on[l]) continue;
            for (size_t k = 0; k < 3; k++) {
                b->shadow_origins[3 * n + k] = b->places[3 * (i + l) + k];
                b->shadow_directions[3 * n + k] = columns[k][l];
                b->sent[k][n] = columns[3 + k][l];
            }
            b->ends[n] = columns[6][l];
            b->lit[n++] = b->pixel[b->ray[i + l]];
        }
    }
    return n;
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

static blob_status plain_lights(plain_tile *tile, plain_block *b) {
    for (int32_t k = 0; k < tile->picture->light_count; k++) {
        const size_t n = plain_aim(&tile->picture->lights[k], b);
        if (!n) continue;
        const double start = plain_clock(tile);
        const blob_status status = blob_any_hit(tile->scene, tile->index, tile->query, n, b->shadow_origins,
                                                b->shadow_directions, b->starts, b->ends, b->blocked);
        if (status != BLOB_OK) return status;
        tile->seconds[0] += plain_clock(tile) - start;
        for (size_t i = 0; i < n; i++)
            if (!b->blocked[i]) plain_deposit(tile, b->lit[i], 0, b->sent[0][i], b->sent[1][i], b->sent[2][i]);
    }
    return BLOB_OK;
}

/* ---- blocks ------------------------------------------------------------------------------------------------- */

static blob_status plain_shade(plain_tile *tile, plain_block *b) {
    plain_cameras(tile->picture, b);
    for (size_t i = 0; i < b->n; i++) b->ends[i] = HUGE_VAL;
    const blob_hits hits = {.status = b->status, .t = b->t, .normal = b->normals, .surface = b->surface};
    const double start = plain_clock(tile);
    blob_status status = blob_first_hit(tile->scene, tile->index, tile->query, b->n, b->origins, b->directions,
                                        b->starts, b->ends, &hits);
    if (status != BLOB_OK) return status;
    plain_split(tile, b);
    if (b->points == 0) {
        tile->seconds[0] += plain_clock(tile) - start;
        return BLOB_OK;
    }
    plain_points(tile, b);
    status = plain_polish(tile, b);
    tile->seconds[0] += plain_clock(tile) - start;
    if (status == BLOB_OK) status = plain_materials(tile, b);
    if (status != BLOB_OK) return status;
    plain_even(tile, b);
    return plain_lights(tile, b);
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

static uint32_t plain_bits(uint32_t code) {
    code &= 0x55u;
    code = (code | code >> 1) & 0x33u;
    return (code | code >> 2) & 0x0fu;
}

/* The samples of an area in Morton order of its pixels. */
static blob_status plain_area(plain_tile *tile, plain_block *b, int32_t left, int32_t top) {
    const shade_picture *picture = tile->picture;
    const double middle = picture->samples > 1 ? 0 : 0.5;
    for (uint32_t code = 0; code < PLAIN_AREA * PLAIN_AREA; code++) {
        const int32_t x = left + (int32_t)plain_bits(code), y = top + (int32_t)plain_bits(code >> 1);
        if (x < tile->x0 || x >= tile->x1 || y < tile->y0 || y >= tile->y1) continue;
        const uint32_t key = pattern_pixel((uint32_t)x, (uint32_t)y, picture->seed);
        for (int32_t i = 0; i < picture->samples; i++) {
            const size_t at = b->n++;
            b->pixel[at] = (y - tile->y0) * (tile->x1 - tile->x0) + x - tile->x0;
            b->key[at] = key;
            b->sample[at] = (uint32_t)i;
            b->px[at] = x + middle;
            b->py[at] = y + middle;
            if (b->n < PLAIN_BLOCK) continue;
            const blob_status status = plain_next(tile, b);
            if (status != BLOB_OK) return status;
        }
    }
    return b->n ? plain_next(tile, b) : BLOB_OK;
}

blob_status PLAIN_NAME(plain_make)(plain_tile *tile) {
    plain_block *b = aligned_alloc(64, (sizeof *b + 63) / 64 * 64);
    if (!b) return BLOB_NO_MEMORY;
    memset(b, 0, sizeof *b); /* lanes beyond the last ray or point are computed, too, and never read */
    for (size_t i = 0; i < PLAIN_BLOCK; i++) vector_put(vector_of(tile->picture->eye), b->origins + 3 * i);
    blob_status status = BLOB_OK;
    for (int32_t y = tile->y0 & -PLAIN_AREA; y < tile->y1 && status == BLOB_OK; y += PLAIN_AREA)
        for (int32_t x = tile->x0 & -PLAIN_AREA; x < tile->x1 && status == BLOB_OK; x += PLAIN_AREA)
            status = plain_area(tile, b, x, y);
    free(b);
    return status;
}
