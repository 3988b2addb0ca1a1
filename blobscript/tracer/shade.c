/* shade.c - tiles of a picture.
 *
 * A tile is made in blocks of up to SHADE_BLOCK camera rays from neighbouring pixels in Morton order,
 * so that any eight consecutive rays lie in 4 x 2 pixels or less. Each block is one batch for the
 * tracer; so is each of its shadow tests (all rays to one light) and each of its bounces. Bounces wait
 * on a stack, sorted by depth, and the deepest go first: a batch of n rays leaves at most 2 n behind,
 * so no depth ever has more than 2 SHADE_BLOCK of them waiting.
 *
 * Secondary rays start on the surface with t_min = 0: the tracer itself finds which side they leave
 * to, so there is no offset in scene units. For that the start must be on the surface to its own last
 * bits, and o + t d is so only to the last bits of t, which is larger where the camera is far away: one
 * Newton step along the gradient mends it.
 */
#include "shade.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "brdf.h"
#include "pattern.h"

enum { SHADE_BLOCK = 256, SHADE_STACK = SHADE_BLOCK + 2 * SHADE_BLOCK * SHADE_DEPTH };

/* Light that a ray carries to its pixel below this share is not followed further: half a step of an 8-bit
 * picture's darkest codes. */
#define SHADE_FAINT (1.0 / 1024)

/* Brighter is cut to this, the largest half float: no infinity gets into a picture. */
#define SHADE_BRIGHTEST 65504.0

static_assert(sizeof(shade_light) == 56, "layout shared with backends/picture.py");
static_assert(sizeof(shade_picture) == 304, "layout shared with backends/picture.py");
static_assert(sizeof(shade_layers) == 80, "layout shared with backends/picture.py");

typedef struct shade_ray {
    vector origin, direction, weight;
    int32_t pixel; /* of the tile */
    int32_t depth; /* bounces so far */
} shade_ray;

/* A point on a surface that a ray has met, and how it answers light. */
typedef struct shade_point {
    vector place, normal, eye; /* the normal on the side of the eye; eye: unit vector to where it came from */
    vector weight;
    brdf_material material;
    vector f0, layer, base;
    double facing; /* normal . eye, > 0 */
    int32_t pixel, depth;
    int inside; /* the ray came from within the surface */
} shade_point;

/* One batch for the tracer, and its answers. */
typedef struct shade_batch {
    size_t n;
    double origins[3 * SHADE_BLOCK], directions[3 * SHADE_BLOCK];
    double starts[SHADE_BLOCK], ends[SHADE_BLOCK];
    int8_t status[SHADE_BLOCK];
    double t[SHADE_BLOCK], normals[3 * SHADE_BLOCK];
    int32_t surface[SHADE_BLOCK];
    int32_t counters[6][SHADE_BLOCK];
} shade_batch;

typedef struct shade_job {
    const blob_scene *scene;
    const blob_index *index;
    const blob_query *query;
    const shade_picture *picture;
    const shade_layers *layers;
    double *light; /* 3 a pixel of the tile, summed over its samples */
    size_t waiting;
    shade_ray stack[SHADE_STACK];
    shade_batch rays, shadows;
    shade_ray chunk[SHADE_BLOCK];
    shade_point points[SHADE_BLOCK];
    double places[3 * SHADE_BLOCK], rows[BLOB_MATERIAL * SHADE_BLOCK];
    int32_t surfaces[SHADE_BLOCK];
    /* Field at the places of one surface, and which points they are. */
    double together[3 * SHADE_BLOCK], field[SHADE_BLOCK], gradients[3 * SHADE_BLOCK];
    int32_t which[SHADE_BLOCK];
    /* One light's shadow rays: the point, what arrives if nothing is in the way, and the share that does. */
    int32_t lit[SHADE_BLOCK], passing[SHADE_BLOCK];
    vector arriving[SHADE_BLOCK], share[SHADE_BLOCK];
    uint8_t blocked[SHADE_BLOCK];
    shade_ray mirrored[SHADE_BLOCK], bent[SHADE_BLOCK];
} shade_job;

/* ---- small things ----------------------------------------------------------------------------- */

static vector background(const shade_picture *picture, vector direction) {
    const double y = direction.y - picture->level;
    const double rise = y / sqrt(y * y + picture->bend * picture->bend);
    return blend(vector_of(picture->below), vector_of(picture->above), 0.5 + 0.5 * rise);
}

/* Irradiance / pi of the background on a surface that faces n; also its radiance, very much blurred. */
static vector ambient(const shade_picture *picture, vector n) {
    return add(vector_of(picture->ambient), times(n.y, vector_of(picture->tilt)));
}

static void deposit(shade_job *job, int32_t pixel, vector light) {
    double *sum = job->light + 3 * (size_t)pixel;
    vector_put(add(vector_of(sum), light), sum);
}

static int cancelled(const blob_query *query) { return query->cancel && *query->cancel; }

static void batch_push(shade_batch *batch, vector origin, vector direction, double end) {
    const size_t i = batch->n++;
    vector_put(origin, batch->origins + 3 * i);
    vector_put(direction, batch->directions + 3 * i);
    batch->starts[i] = 0;
    batch->ends[i] = end;
}

static blob_status batch_trace(const shade_job *job, shade_batch *batch, int counting) {
    int32_t(*counters)[SHADE_BLOCK] = batch->counters;
    blob_hits hits = {.status = batch->status, .t = batch->t, .normal = batch->normals, .surface = batch->surface};
    if (counting) {
        hits.evaluations = counters[0];
        hits.nodes = counters[1];
        hits.candidates = counters[2];
        hits.spans = counters[3];
        hits.sandwiches = counters[4];
        hits.fallbacks = counters[5];
    }
    return blob_first_hit(job->scene, job->index, job->query, batch->n, batch->origins, batch->directions,
                          batch->starts, batch->ends, &hits);
}

static int is_hit(int8_t status) { return status == BLOB_ENTER || status == BLOB_EXIT; }

/* ---- layers ----------------------------------------------------------------------------------- */

static void layers_write(const shade_layers *layers, const shade_batch *batch, size_t i, size_t pixel) {
    int32_t *const counters[6] = {layers->evaluations, layers->nodes,      layers->candidates,
                                  layers->spans,       layers->sandwiches, layers->fallbacks};
    const int hit = is_hit(batch->status[i]);
    for (size_t k = 0; k < 3; k++) {
        const double place = batch->origins[3 * i + k] + batch->t[i] * batch->directions[3 * i + k];
        if (layers->normal) layers->normal[3 * pixel + k] = hit ? (float)batch->normals[3 * i + k] : NAN;
        if (layers->position) layers->position[3 * pixel + k] = hit ? (float)place : NAN;
    }
    if (layers->depth) layers->depth[pixel] = hit ? (float)batch->t[i] : INFINITY;
    if (layers->surface) layers->surface[pixel] = hit ? batch->surface[i] : -1;
    for (size_t k = 0; k < 6; k++)
        if (counters[k]) counters[k][pixel] = batch->counters[k][i];
}

/* ---- what a point on a surface sends back ----------------------------------------------------- */

static void point_prepare(shade_point *point, const shade_ray *ray, const shade_batch *batch, size_t i) {
    const double t = batch->t[i];
    const vector normal = vector_of(batch->normals + 3 * i);
    point->eye = times(-1, ray->direction);
    point->inside = batch->status[i] == BLOB_EXIT;
    point->place = add(ray->origin, times(t, ray->direction));
    /* Where the gradient vanishes there is no normal: as if seen from the front. */
    point->normal = dot(normal, normal) > 0.5 ? times(point->inside ? -1 : 1, normal) : point->eye;
    point->facing = fmax(dot(point->normal, point->eye), 1e-6);
    point->weight = ray->weight;
    point->pixel = ray->pixel;
    point->depth = ray->depth;
}

static vector absorbed(vector absorption, double t) {
    return (vector){exp(-absorption.x * t), exp(-absorption.y * t), exp(-absorption.z * t)};
}

static double point_transmission(const shade_point *point) {
    return point->material.transmission * (1 - point->material.metalness);
}

/* The material's answer, once it is known. t: the way that the ray came. */
static void point_finish(shade_point *point, double t) {
    const brdf_material *m = &point->material;
    const double through = point_transmission(point), bare = (m->ior - 1) / (m->ior + 1), glass = bare * bare;
    point->f0 = blend(brdf_f0(m), (vector){glass, glass, glass}, through);
    point->layer = brdf_layer(point->f0, m->roughness, point->facing);
    point->base = brdf_base(m, point->layer);
    if (point->inside && through > 0) point->weight = filter(point->weight, absorbed(m->absorption, t));
}

static vector mirror_direction(vector normal, vector eye) { return subtract(times(2 * dot(normal, eye), normal), eye); }

/* Emission, and what the background sends. A mirror image replaces the share `sharp` of it. */
static void point_ambient(shade_job *job, const shade_point *point, double sharp) {
    const brdf_material *m = &point->material;
    const shade_picture *picture = job->picture;
    const double kept = (1 - m->reflection) * (1 - sharp) * (1 - point_transmission(point));
    const vector image = mirror_direction(point->normal, point->eye);
    const vector blurred = blend(background(picture, image), ambient(picture, image), m->roughness);
    const double fill = picture->fill + (1 - picture->fill) * m->metalness;
    const vector base =
        times((1 - m->reflection) * picture->fill, filter(point->base, ambient(picture, point->normal)));
    const vector layer = times(kept * fill, filter(point->layer, blurred));
    deposit(job, point->pixel, filter(point->weight, add(m->emission, add(base, layer))));
}

static void push_bounce(shade_job *job, shade_ray *list, size_t *n, const shade_point *point, vector direction,
                        vector weight) {
    if (largest(weight) < SHADE_FAINT) return;
    if (point->depth >= SHADE_DEPTH) deposit(job, point->pixel, filter(weight, background(job->picture, direction)));
    else list[(*n)++] = (shade_ray){point->place, unit(direction), weight, point->pixel, point->depth + 1};
}

/* Mirror image and refraction. Both directions follow from Snell's law. */
static void point_bounce(shade_job *job, const shade_point *point, double sharp, size_t *mirrored, size_t *bent) {
    const brdf_material *m = &point->material;
    const double through = point_transmission(point), plain = 1 - m->reflection;
    const double eta = point->inside ? m->ior : 1 / m->ior;
    double behind = -1, fresnel = 0;
    if (through > 0) fresnel = brdf_fresnel(point->facing, eta, &behind);
    const double even = m->reflection + plain * through * fresnel;
    const vector share = add((vector){even, even, even}, times(plain * (1 - through) * sharp, point->layer));
    if (largest(share) > 0)
        push_bounce(job, job->mirrored, mirrored, point, mirror_direction(point->normal, point->eye),
                    filter(point->weight, share));
    if (behind >= 0) {
        const vector direction = add(times(-eta, point->eye), times(eta * point->facing - behind, point->normal));
        push_bounce(job, job->bent, bent, point, direction, times(plain * through * (1 - fresnel), point->weight));
    }
}

/* ---- lights ----------------------------------------------------------------------------------- */

/* Unit vector and distance to the light, and its irradiance on a surface that faces it. */
static double light_reach(const shade_light *light, vector place, vector *direction, vector *irradiance) {
    *irradiance = vector_of(light->color);
    if (light->kind == SHADE_SUN) {
        *direction = vector_of(light->place);
        return HUGE_VAL;
    }
    const vector way = subtract(vector_of(light->place), place);
    const double square = dot(way, way), distance = sqrt(square);
    *direction = times(1 / distance, way);
    *irradiance = times(1 / square, *irradiance);
    return distance;
}

/* What the light sends to the eye by way of this point if nothing is between. */
static vector light_answer(const shade_point *point, vector direction, vector irradiance) {
    const brdf_material *m = &point->material;
    const brdf_angles at = brdf_measure(point->normal, point->eye, direction, point->facing);
    const vector base = times((1 - m->reflection) * brdf_diffuse(m->roughness, &at), point->base);
    const vector layer = brdf_specular(point->f0, m->roughness, &at);
    return filter(filter(point->weight, irradiance), add(base, layer));
}

/* Collects the points that the light can reach at all; their shadow rays go into job->shadows. */
static void light_collect(shade_job *job, const shade_light *light, size_t points) {
    job->shadows.n = 0;
    for (size_t i = 0; i < points; i++) {
        const shade_point *point = &job->points[i];
        vector direction, irradiance;
        const double distance = light_reach(light, point->place, &direction, &irradiance);
        if (point->inside || !(distance > 0) || !(dot(point->normal, direction) > 0)) continue;
        const vector answer = light_answer(point, direction, irradiance);
        if (!(largest(answer) > 0)) continue;
        job->lit[job->shadows.n] = (int32_t)i;
        job->arriving[job->shadows.n] = answer;
        batch_push(&job->shadows, point->place, direction, distance);
    }
}

/* The rows of materials at hits of a batch: job->places and job->surfaces, n of them. */
static blob_status read_materials(shade_job *job, size_t n) {
    const shade_picture *picture = job->picture;
    if (picture->painted)
        return blob_paint(job->scene, job->index, n, job->places, job->surfaces, picture->materials, job->rows);
    for (size_t i = 0; i < n; i++) {
        const int32_t material = picture->surface_material[job->surfaces[i]];
        memcpy(job->rows + BLOB_MATERIAL * i, picture->materials + BLOB_MATERIAL * (size_t)material,
               BLOB_MATERIAL * sizeof(double));
    }
    return BLOB_OK;
}

/* One crossing of the surfaces between points and light: the shares shrink, and the rays that still carry
 * light go on behind it. */
static void light_cross(shade_job *job) {
    shade_batch *batch = &job->shadows;
    const size_t n = batch->n;
    size_t row = 0;
    batch->n = 0;
    for (size_t i = 0; i < n; i++) {
        if (!is_hit(batch->status[i])) continue;
        const brdf_material m = brdf_read(job->rows + BLOB_MATERIAL * row);
        const vector place = vector_of(job->places + 3 * row++);
        const int32_t ray = job->passing[i];
        const double through = m.transmission * (1 - m.metalness) * (1 - m.reflection);
        vector *share = &job->share[ray];
        *share = batch->status[i] == BLOB_EXIT && through > 0 ? filter(*share, absorbed(m.absorption, batch->t[i]))
                                                              : times(through, *share);
        if (largest(*share) < SHADE_FAINT) {
            *share = (vector){0, 0, 0};
            continue;
        }
        job->passing[batch->n] = ray;
        batch_push(batch, place, vector_of(batch->directions + 3 * i), batch->ends[i] - batch->t[i]);
    }
}

/* job->share of every shadow ray where something may be transparent: straight through, coloured. */
static blob_status light_look_through(shade_job *job) {
    shade_batch *batch = &job->shadows;
    for (size_t i = 0; i < batch->n; i++) job->passing[i] = (int32_t)i;
    for (int crossing = 0; batch->n && crossing < 2 * SHADE_DEPTH; crossing++) {
        blob_status status = batch_trace(job, batch, 0);
        size_t rows = 0;
        for (size_t i = 0; status == BLOB_OK && i < batch->n; i++) {
            if (!is_hit(batch->status[i])) continue;
            const vector way = times(batch->t[i], vector_of(batch->directions + 3 * i));
            vector_put(add(vector_of(batch->origins + 3 * i), way), job->places + 3 * rows);
            job->surfaces[rows++] = batch->surface[i];
        }
        if (status == BLOB_OK) status = read_materials(job, rows);
        if (status != BLOB_OK) return status;
        light_cross(job);
    }
    return BLOB_OK;
}

/* Adds what one light sends by way of the points. */
static blob_status light_add(shade_job *job, const shade_light *light, size_t points) {
    shade_batch *batch = &job->shadows;
    light_collect(job, light, points);
    const size_t n = batch->n;
    if (n == 0) return BLOB_OK;
    blob_status status;
    if (job->picture->transparent) {
        for (size_t i = 0; i < n; i++) job->share[i] = (vector){1, 1, 1};
        status = light_look_through(job);
    } else {
        status = blob_any_hit(job->scene, job->index, job->query, n, batch->origins, batch->directions, batch->starts,
                              batch->ends, job->blocked);
        for (size_t i = 0; status == BLOB_OK && i < n; i++)
            job->share[i] = job->blocked[i] ? (vector){0, 0, 0} : (vector){1, 1, 1};
    }
    for (size_t i = 0; status == BLOB_OK && i < n; i++)
        deposit(job, job->points[job->lit[i]].pixel, filter(job->share[i], job->arriving[i]));
    return status;
}

/* ---- starts of secondary rays ----------------------------------------------------------------- */

/* Largest Newton step, as a share of the distances involved: far above their rounding, and far below what a
 * step from a place with a vanishing gradient could do. */
#define POLISH_MOST 1e-7

static void point_polish(shade_job *job, size_t i, double threshold) {
    double *place = job->places + 3 * (size_t)job->which[i];
    const vector gradient = vector_of(job->gradients + 3 * i), here = vector_of(place);
    const double square = dot(gradient, gradient);
    const vector step = times((threshold - job->field[i]) / square, gradient);
    const double t = job->rays.t[job->passing[job->which[i]]];
    const double most = POLISH_MOST * (t + sqrt(dot(here, here)));
    if (square > 0 && dot(step, step) <= most * most) vector_put(add(here, step), place);
}

/* One Newton step towards the surface for the first n of job->places. */
static blob_status polish_places(shade_job *job, size_t n) {
    size_t done = 0;
    for (int32_t surface = -1; done < n;) {
        /* The lowest surface above the last one, and its places together. */
        int32_t next = INT32_MAX;
        size_t count = 0;
        for (size_t i = 0; i < n; i++)
            if (job->surfaces[i] > surface && job->surfaces[i] < next) next = job->surfaces[i];
        for (size_t i = 0; i < n; i++) {
            if (job->surfaces[i] != next) continue;
            memcpy(job->together + 3 * count, job->places + 3 * i, 3 * sizeof(double));
            job->which[count++] = (int32_t)i;
        }
        const blob_status status =
            blob_field(job->scene, job->index, next, count, job->together, job->field, job->gradients);
        if (status != BLOB_OK) return status;
        for (size_t i = 0; i < count; i++) point_polish(job, i, job->picture->thresholds[next]);
        surface = next;
        done += count;
    }
    return BLOB_OK;
}

/* ---- batches of rays -------------------------------------------------------------------------- */

/* Misses see the background; the rest become job->points without material. Returns how many. */
static size_t collect_points(shade_job *job, size_t n) {
    const shade_batch *batch = &job->rays;
    size_t points = 0;
    for (size_t i = 0; i < n; i++) {
        const shade_ray *ray = &job->chunk[i];
        if (job->layers && job->picture->samples == 1 && ray->depth == 0)
            layers_write(job->layers, batch, i, (size_t)ray->pixel);
        if (!is_hit(batch->status[i])) {
            const int plain = ray->depth == 0 && job->picture->plain;
            const vector seen = plain ? vector_of(job->picture->shown) : background(job->picture, ray->direction);
            deposit(job, ray->pixel, filter(ray->weight, seen));
            continue;
        }
        point_prepare(&job->points[points], ray, batch, i);
        vector_put(job->points[points].place, job->places + 3 * points);
        job->surfaces[points] = batch->surface[i];
        job->passing[points++] = (int32_t)i;
    }
    return points;
}

static void push_children(shade_job *job, const shade_ray *list, size_t n) {
    assert(job->waiting + n <= SHADE_STACK);
    memcpy(job->stack + job->waiting, list, n * sizeof *list);
    job->waiting += n;
}

/* Takes the topmost rays of equal depth off the stack, at most a block of them. */
static size_t pop_chunk(shade_job *job) {
    size_t n = 0;
    const int32_t depth = job->stack[job->waiting - 1].depth;
    while (n < SHADE_BLOCK && n < job->waiting && job->stack[job->waiting - n - 1].depth == depth) n++;
    job->waiting -= n;
    memcpy(job->chunk, job->stack + job->waiting, n * sizeof *job->chunk);
    return n;
}

static blob_status shade_points(shade_job *job, size_t n) {
    const shade_picture *picture = job->picture;
    size_t mirrored = 0, bent = 0;
    blob_status status = polish_places(job, n);
    if (status == BLOB_OK) status = read_materials(job, n);
    if (status != BLOB_OK) return status;
    for (size_t i = 0; i < n; i++) {
        shade_point *point = &job->points[i];
        point->place = vector_of(job->places + 3 * i);
        point->material = brdf_read(job->rows + BLOB_MATERIAL * i);
        point_finish(point, job->rays.t[job->passing[i]]);
        const double smooth = 1 - point->material.roughness;
        const double sharp = point->inside ? 0 : point->material.metalness * smooth * smooth;
        point_ambient(job, point, sharp);
        point_bounce(job, point, sharp, &mirrored, &bent);
    }
    push_children(job, job->mirrored, mirrored);
    push_children(job, job->bent, bent);
    for (int32_t k = 0; k < picture->light_count && status == BLOB_OK; k++)
        status = light_add(job, &picture->lights[k], n);
    return status;
}

/* Until no ray waits. */
static blob_status shade_waiting(shade_job *job) {
    blob_status status = BLOB_OK;
    while (job->waiting && status == BLOB_OK) {
        if (cancelled(job->query)) return BLOB_CANCELLED;
        const size_t n = pop_chunk(job);
        const int counting = job->layers && job->picture->samples == 1 && job->chunk[0].depth == 0;
        job->rays.n = 0;
        for (size_t i = 0; i < n; i++) batch_push(&job->rays, job->chunk[i].origin, job->chunk[i].direction, HUGE_VAL);
        status = batch_trace(job, &job->rays, counting);
        if (status != BLOB_OK) return status;
        const size_t points = collect_points(job, n);
        if (points) status = shade_points(job, points);
    }
    return status;
}

/* ---- tiles ------------------------------------------------------------------------------------ */

typedef struct shade_area {
    int32_t x0, y0, x1, y1;
} shade_area;

static vector view_direction(const shade_picture *picture, double x, double y) {
    const vector across = add(times(x, vector_of(picture->right)), times(y, vector_of(picture->down)));
    return unit(add(vector_of(picture->corner), across));
}

/* The even bits of a Morton number. */
static int32_t every_other_bit(uint32_t code) {
    code &= 0x55555555u;
    code = (code | code >> 1) & 0x33333333u;
    code = (code | code >> 2) & 0x0f0f0f0fu;
    code = (code | code >> 4) & 0x00ff00ffu;
    return (int32_t)((code | code >> 8) & 0x0000ffffu);
}

/* How many bits of Morton number a block of pixels has, so that its samples fill a batch: 16 x 16 pixels with
 * one sample, 16 x 8 with two, ..., one pixel with more than 128. */
static int block_bits(int32_t samples) {
    int bits = 8;
    while (bits > 0 && ((int64_t)samples << bits) > SHADE_BLOCK) bits--;
    return bits;
}

static blob_status shade_pixel(shade_job *job, int32_t x, int32_t y, int32_t pixel) {
    const shade_picture *picture = job->picture;
    const vector eye = vector_of(picture->eye), white = {1, 1, 1};
    for (int32_t i = 0; i < picture->samples; i++) {
        double place[2] = {0.5, 0.5};
        if (picture->samples > 1) pattern_place((uint32_t)x, (uint32_t)y, picture->seed, (uint32_t)i, place);
        const vector direction = view_direction(picture, x + place[0], y + place[1]);
        job->stack[job->waiting++] = (shade_ray){eye, direction, white, pixel, 0};
        if (job->waiting < SHADE_BLOCK) continue;
        const blob_status status = shade_waiting(job);
        if (status != BLOB_OK) return status;
    }
    return BLOB_OK;
}

/* Layers of one block of pixels, where they have rays of their own. */
static blob_status layers_block(shade_job *job, shade_area tile, shade_area block) {
    size_t pixels[SHADE_BLOCK];
    const vector eye = vector_of(job->picture->eye);
    job->rays.n = 0;
    for (uint32_t code = 0; code < SHADE_BLOCK; code++) {
        const int32_t x = block.x0 + every_other_bit(code), y = block.y0 + every_other_bit(code >> 1);
        if (x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) continue;
        pixels[job->rays.n] = (size_t)(y - tile.y0) * (size_t)(tile.x1 - tile.x0) + (size_t)(x - tile.x0);
        batch_push(&job->rays, eye, view_direction(job->picture, x + 0.5, y + 0.5), HUGE_VAL);
    }
    const blob_status status = batch_trace(job, &job->rays, 1);
    for (size_t i = 0; status == BLOB_OK && i < job->rays.n; i++) layers_write(job->layers, &job->rays, i, pixels[i]);
    return status;
}

static blob_status shade_block(shade_job *job, shade_area tile, shade_area block, int bits) {
    for (uint32_t code = 0; code < 1u << bits; code++) {
        const int32_t x = block.x0 + every_other_bit(code), y = block.y0 + every_other_bit(code >> 1);
        if (x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) continue;
        const blob_status status = shade_pixel(job, x, y, (y - tile.y0) * (tile.x1 - tile.x0) + x - tile.x0);
        if (status != BLOB_OK) return status;
    }
    return shade_waiting(job);
}

static blob_status each_block(shade_job *job, shade_area tile, int bits, int shading) {
    const int32_t width = 1 << ((bits + 1) / 2), height = 1 << (bits / 2);
    for (int32_t y = tile.y0 & -height; y < tile.y1; y += height)
        for (int32_t x = tile.x0 & -width; x < tile.x1; x += width) {
            const shade_area block = {x, y, x + width, y + height};
            if (cancelled(job->query)) return BLOB_CANCELLED;
            const blob_status status = shading ? shade_block(job, tile, block, bits) : layers_block(job, tile, block);
            if (status != BLOB_OK) return status;
        }
    return BLOB_OK;
}

static void write_pixels(const shade_job *job, size_t pixels, float *rgba) {
    for (size_t i = 0; i < pixels; i++) {
        for (size_t k = 0; k < 3; k++) {
            const double mean = job->light[3 * i + k] / job->picture->samples;
            rgba[4 * i + k] = (float)(mean < SHADE_BRIGHTEST ? mean : SHADE_BRIGHTEST);
        }
        rgba[4 * i + 3] = 1;
    }
}

static int acceptable(const shade_picture *picture, shade_area tile) {
    return picture->samples >= 1 && tile.x0 >= 0 && tile.x0 < tile.x1 && tile.x1 <= picture->width && tile.y0 >= 0 &&
           tile.y0 < tile.y1 && tile.y1 <= picture->height;
}

int32_t shade_abi(void) { return SHADE_ABI; }

blob_status shade_tile(const blob_scene *scene, const blob_index *index, const blob_query *query,
                       const shade_picture *picture, int32_t x0, int32_t y0, int32_t x1, int32_t y1, float *rgba,
                       const shade_layers *layers) {
    const shade_area tile = {x0, y0, x1, y1};
    if (!acceptable(picture, tile)) return BLOB_BAD_ARGUMENT;
    const size_t pixels = (size_t)(x1 - x0) * (size_t)(y1 - y0);
    shade_job *job = malloc(sizeof *job);
    double *light = calloc(3 * pixels, sizeof *light);
    blob_status status = BLOB_NO_MEMORY;
    if (job && light) {
        job->scene = scene;
        job->index = index;
        job->query = query;
        job->picture = picture;
        job->layers = layers;
        job->light = light;
        job->waiting = 0;
        status = each_block(job, tile, block_bits(picture->samples), 1);
        if (status == BLOB_OK && layers && picture->samples > 1) status = each_block(job, tile, 8, 0);
        if (status == BLOB_OK) write_pixels(job, pixels, rgba);
    }
    free(light);
    free(job);
    return status;
}

void shade_pattern(uint32_t x, uint32_t y, uint32_t seed, int32_t n, double *places) {
    for (int32_t i = 0; i < n; i++) pattern_place(x, y, seed, (uint32_t)i, places + 2 * i);
}
