/* shade.c - tiles of a picture.
 *
 * A tile is made in areas of 16 x 16 pixels. Camera rays go in Morton order, SHADE_BLOCK at a time, so
 * that any eight consecutive rays lie close together. Each block is one batch for the tracer; so is each
 * of its shadow tests (all rays to one light). Bounces wait in queues by depth until there are SHADE_BATCH, are sorted
 * by direction, so that consecutive ones go about the same way, and then become blocks of their own.
 *
 * Secondary rays start on the surface with t_min = 0: the tracer itself finds which side they leave
 * to, so there is no offset in scene units. For that the start must be on the surface to its own last
 * bits, and o + t d is so only to the last bits of t, which is larger where the camera is far away: one
 * Newton step along the gradient mends it. The floor is a plane whose rays leave upwards only.
 *
 * Chance is a pattern: every ray has a key, made from the pixel and its way through the scene, and the
 * sample's number; pattern.h turns the two into numbers that are well spread over the samples.
 *
 * Sampling goes in rounds that double the samples. After each, a cell of 4 x 4 pixels is done when the
 * two halves of its samples agree: their difference, as the picture will show it, is about twice the
 * error of their mean, and its root mean square over the cell is what `noise` asks for.
 */
#define _POSIX_C_SOURCE 200809L
#include "shade.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "brdf.h"
#include "light.h"
#include "pattern.h"
#include "plain.h"
#include "texture.h"

enum { SHADE_BLOCK = 256, SHADE_BATCH = 8 * SHADE_BLOCK, SHADE_QUEUE = SHADE_BATCH + 2 * SHADE_BLOCK };

/* Bits of a direction's place in the order by which bounces are sorted: 2^8 rows and columns of the sphere. */
enum { SHADE_DIGIT = 256 };

/* Pixels on a side of the areas that are sampled together, and of the cells that decide together. */
enum { SHADE_AREA = 16, SHADE_CELL = 4, SHADE_CELLS = SHADE_AREA / SHADE_CELL };

/* Light that a ray carries to its pixel below this share is not followed further: half a step of an 8-bit
 * picture's darkest codes. Where chance decides, below SHADE_WEAK some are followed for all of them. */
#define SHADE_FAINT (1.0 / 1024)
#define SHADE_WEAK 0.08

/* Rougher lobes are followed like diffuse light, for one bounce. */
#define SHADE_ROUGH 0.5

/* Roughness at least of highlights that rays of rough lobes see. */
#define SHADE_SPREAD 0.6

/* Brighter is cut to this, the largest half float: no infinity gets into a picture. */
#define SHADE_BRIGHTEST 65504.0

static_assert(sizeof(shade_light) == 64, "layout shared with backends/picture.py");
static_assert(sizeof(shade_sky) == 256, "layout shared with backends/picture.py");
static_assert(sizeof(shade_texture) == 128, "layout shared with backends/picture.py");
static_assert(sizeof(shade_picture) == 656, "layout shared with backends/picture.py");
static_assert(sizeof(shade_layers) == 112, "layout shared with backends/picture.py");

/* What a ray looks for: all there is; the light from everywhere, ending at the next surface; whether the sky is
 * free, for a floor that catches shadows. */
enum { RAY_SEEN, RAY_GATHER, RAY_CATCH };

/* Of a light that reaches a pixel. CLEAR: how much of the sky behind all it lets through, where that is not shown. */
enum { LIGHT_DIRECT, LIGHT_INDIRECT, LIGHT_CLEAR, LIGHT_PARTS };

typedef struct shade_ray {
    vector origin, direction, weight;
    double density; /* with which it was drawn where lights are drawn, too; 0: there is no other way to it */
    double dim;     /* share of the sky's radiance that it sees */
    double spread;  /* roughness at least of the highlights that it sees */
    int32_t pixel;  /* of the tile */
    int32_t depth;  /* bounces so far */
    int32_t kind;   /* RAY_* */
    uint32_t key, sample;
} shade_ray;

/* A point on a surface that a ray has met, and how it answers light. */
typedef struct shade_point {
    vector place, normal, eye; /* the normal on the side of the eye; eye: unit vector to where it came from */
    vector flat;               /* the normal without bumps */
    vector weight;
    brdf_material material;
    vector f0, gain, layer, base;
    vector caught;          /* a floor that catches shadows: what it shows where there is none */
    double facing;          /* normal . eye, > 0 */
    double diffuse, glossy; /* chance that its bounce is drawn from either */
    double dim;             /* of the ray that came here */
    double spread;          /* the same */
    double width;           /* of a pixel there, about */
    int32_t pixel, depth, kind;
    int32_t inside; /* the ray came from within the surface */
    int32_t floor;  /* SHADE_NO_FLOOR: a surface */
    uint32_t key, sample;
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
    double *light;  /* LIGHT_PARTS colours a pixel of the tile, summed over its samples */
    double *before; /* the same at the start of the last round */
    int32_t *taken; /* samples of each pixel */
    double hits;    /* seconds of the tracer's queries, where `timed` */
    int timed;
    size_t waiting[SHADE_DEPTH + 1];
    shade_ray queues[SHADE_DEPTH + 1][SHADE_QUEUE];
    uint16_t orders[SHADE_DEPTH + 1][SHADE_QUEUE], keys[SHADE_QUEUE]; /* of a queue, by direction */
    shade_batch rays, shadows;
    shade_ray chunk[SHADE_BLOCK];
    shade_point points[SHADE_BLOCK];
    double places[3 * SHADE_BLOCK], rows[BLOB_MATERIAL * SHADE_BLOCK];
    double marks[BLOB_MATERIAL * SHADE_BLOCK], bumps[SHADE_BLOCK][3];
    int32_t surfaces[SHADE_BLOCK];
    /* Field at the places of one surface, and which points they are. */
    double together[3 * SHADE_BLOCK], field[SHADE_BLOCK], gradients[3 * SHADE_BLOCK];
    int32_t which[SHADE_BLOCK];
    /* One light's shadow rays: the point, what arrives if nothing is in the way, and the share that does. */
    int32_t lit[SHADE_BLOCK], passing[SHADE_BLOCK];
    vector arriving[SHADE_BLOCK], share[SHADE_BLOCK];
    uint8_t blocked[SHADE_BLOCK];
    shade_ray first[SHADE_BLOCK], second[SHADE_BLOCK];
    texture_lanes *registers;
} shade_job;

/* ---- small things ----------------------------------------------------------------------------- */

static const vector white = {1, 1, 1}, black = {0, 0, 0};

static double brightness(vector c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

static void deposit(shade_job *job, int32_t pixel, int part, vector light) {
    double *sum = job->light + 3 * (LIGHT_PARTS * (size_t)pixel + (size_t)part);
    vector_put(add(vector_of(sum), light), sum);
}

static int cancelled(const blob_query *query) { return query->cancel && *query->cancel; }

/* Keys of what is decided by chance at one point. */
enum { KEY_LENS = 1, KEY_LOBE, KEY_WAY, KEY_FACET, KEY_SURVIVE, KEY_FIRST, KEY_SECOND, KEY_PICK, KEY_LIGHTS = 16 };

static uint32_t key_of(uint32_t key, uint32_t what) { return pattern_hash(key + what * 0x9e3779b9u); }

/* Processor time of this thread in seconds. */
static double seconds_now(void) {
    struct timespec now;
#if defined(CLOCK_THREAD_CPUTIME_ID)
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
#else
    timespec_get(&now, TIME_UTC);
#endif
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double clock_start(const shade_job *job) { return job->timed ? seconds_now() : 0; }
static void clock_stop(shade_job *job, double start) {
    if (job->timed) job->hits += seconds_now() - start;
}

static void batch_push(shade_batch *batch, vector origin, vector direction, double end) {
    const size_t i = batch->n++;
    vector_put(origin, batch->origins + 3 * i);
    vector_put(direction, batch->directions + 3 * i);
    batch->starts[i] = 0;
    batch->ends[i] = end;
}

static blob_status batch_trace(shade_job *job, shade_batch *batch, int counting) {
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
    const double start = clock_start(job);
    const blob_status status = blob_first_hit(job->scene, job->index, job->query, batch->n, batch->origins,
                                              batch->directions, batch->starts, batch->ends, &hits);
    clock_stop(job, start);
    return status;
}

static int is_hit(int8_t status) { return status == BLOB_ENTER || status == BLOB_EXIT; }

/* ---- the floor -------------------------------------------------------------------------------- */

/* Distance to the floor along a ray; +inf where it does not meet it from above. */
static double floor_reach(const shade_picture *picture, vector origin, vector direction) {
    const double above = origin.y - picture->floor_height;
    if (picture->floor == SHADE_NO_FLOOR || !(above > 0) || !(direction.y < 0)) return HUGE_VAL;
    return above / -direction.y;
}

/* How much of the floor has passed into the background at a place. */
static double floor_gone(const shade_picture *picture, vector place) {
    const double end = picture->floor_fade[2];
    if (!(end > 0)) return 0;
    const double x = place.x - picture->floor_fade[0], z = place.z - picture->floor_fade[1];
    const double way = less(more(2 * sqrt(x * x + z * z) / end - 1, 0), 1);
    return way * way * (3 - 2 * way);
}

/* ---- materials -------------------------------------------------------------------------------- */

/* The heights around a place, for the slope of a bump: the place and a step along each axis. */
static void bump_read(shade_job *job, const shade_texture *texture, int32_t output, size_t i, double share) {
    double places[12], out[4 * 16];
    const double *place = job->places + 3 * i;
    const double step = more(job->points[i].width, 1e-9 * (fabs(place[0]) + fabs(place[1]) + fabs(place[2])));
    for (size_t k = 0; k < 12; k++) places[k] = place[k % 3] + (k / 3 == k % 3 + 1 ? step : 0);
    texture_run(job->picture, texture, 4, places, job->registers, out);
    const size_t outputs = (size_t)texture->output_count;
    for (size_t k = 0; k < 3; k++)
        job->bumps[i][k] += share * (out[(k + 1) * outputs + (size_t)output] - out[(size_t)output]) / step;
}

/* Adds a texture's parts to the rows of the points that have it; share[i * stride]: how much of it is at point i. */
static void texture_add(shade_job *job, const shade_texture *texture, size_t n, const double *share, size_t stride,
                        int bumps) {
    double places[3 * TEXTURE_LANES], out[TEXTURE_LANES * 16];
    size_t which[TEXTURE_LANES], count = 0;
    for (size_t i = 0; i <= n; i++) {
        if (count == TEXTURE_LANES || (i == n && count)) {
            texture_run(job->picture, texture, count, places, job->registers, out);
            for (size_t l = 0; l < count; l++)
                for (int32_t k = 0; k < texture->output_count; k++) {
                    const int32_t column = job->picture->outputs[2 * (texture->output_begin + k)];
                    const double part = share[which[l] * stride];
                    if (column < BLOB_MATERIAL)
                        job->rows[BLOB_MATERIAL * which[l] + (size_t)column] +=
                            part * out[l * (size_t)texture->output_count + (size_t)k];
                    else if (bumps) bump_read(job, texture, k, which[l], part);
                }
            count = 0;
        }
        if (i == n || !(share[i * stride] > 0)) continue;
        memcpy(places + 3 * count, job->places + 3 * i, 3 * sizeof *places);
        which[count++] = i;
    }
}

static int32_t material_at(const shade_picture *picture, int32_t surface) {
    return surface < 0 ? picture->floor_material : picture->surface_material[surface];
}

static blob_status read_textures(shade_job *job, size_t n, int bumps) {
    const shade_picture *picture = job->picture;
    if (bumps) memset(job->bumps, 0, n * sizeof *job->bumps);
    for (int32_t group = 0; group < picture->mark_count; group++) {
        const double *marks = picture->marks + (size_t)group * BLOB_MATERIAL * (size_t)picture->material_count;
        if (picture->painted) {
            const blob_status status =
                blob_paint(job->scene, job->index, n, job->places, job->surfaces, marks, job->marks);
            if (status != BLOB_OK) return status;
        }
        for (size_t i = 0; i < n; i++)
            if (!picture->painted || job->surfaces[i] < 0)
                memcpy(job->marks + BLOB_MATERIAL * i,
                       marks + BLOB_MATERIAL * (size_t)material_at(picture, job->surfaces[i]),
                       BLOB_MATERIAL * sizeof *marks);
        for (int32_t k = 0; k < BLOB_MATERIAL; k++) {
            const int32_t texture = group * BLOB_MATERIAL + k;
            if (texture < picture->texture_count)
                texture_add(job, &picture->textures[texture], n, job->marks + k, BLOB_MATERIAL, bumps);
        }
    }
    return BLOB_OK;
}

/* The rows of materials at n places: job->places and job->surfaces, the floor's is -1. With bumps: these are the
 * points of the job, and their slopes are wanted. */
static blob_status read_materials(shade_job *job, size_t n, int bumps) {
    const shade_picture *picture = job->picture;
    if (n == 0) return BLOB_OK;
    if (picture->painted) {
        const blob_status status =
            blob_paint(job->scene, job->index, n, job->places, job->surfaces, picture->materials, job->rows);
        if (status != BLOB_OK) return status;
    }
    for (size_t i = 0; i < n; i++)
        if (!picture->painted || job->surfaces[i] < 0)
            memcpy(job->rows + BLOB_MATERIAL * i,
                   picture->materials + BLOB_MATERIAL * (size_t)material_at(picture, job->surfaces[i]),
                   BLOB_MATERIAL * sizeof(double));
    return picture->texture_count ? read_textures(job, n, bumps) : BLOB_OK;
}

/* ---- what a point on a surface sends back ----------------------------------------------------- */

static void point_prepare(shade_job *job, shade_point *point, const shade_ray *ray, size_t i, double floor) {
    const shade_batch *batch = &job->rays;
    const int solid = floor < HUGE_VAL;
    const double t = solid ? floor : batch->t[i];
    const vector normal = solid ? (vector){0, 1, 0} : vector_of(batch->normals + 3 * i);
    point->eye = times(-1, ray->direction);
    point->inside = !solid && batch->status[i] == BLOB_EXIT;
    point->place = add(ray->origin, times(t, ray->direction));
    if (solid) point->place.y = job->picture->floor_height;
    /* Where the gradient vanishes there is no normal: as if seen from the front. */
    point->flat = dot(normal, normal) > 0.5 ? times(point->inside ? -1 : 1, normal) : point->eye;
    point->normal = point->flat;
    point->facing = more(dot(point->normal, point->eye), 1e-6);
    point->weight = ray->weight;
    point->pixel = ray->pixel;
    point->depth = ray->depth;
    point->kind = ray->kind;
    point->dim = ray->dim;
    point->spread = ray->spread;
    point->key = ray->key;
    point->sample = ray->sample;
    point->floor = solid ? job->picture->floor : SHADE_NO_FLOOR;
    point->width = t * sqrt(dot(vector_of(job->picture->down), vector_of(job->picture->down)));
    point->caught = black;
    point->diffuse = point->glossy = 0;
    job->rays.t[i] = t;
}

static vector absorbed(vector absorption, double t) {
    return (vector){exp(-absorption.x * t), exp(-absorption.y * t), exp(-absorption.z * t)};
}

static double point_transmission(const shade_point *point) {
    return point->material.transmission * (1 - point->material.metalness);
}

/* Turns the normal by the slope of a bump. */
static void point_bump(shade_point *point, const double *slope) {
    const vector g = vector_of(slope);
    if (!(dot(g, g) > 0)) return;
    const vector n = point->flat, along = subtract(g, times(dot(g, n), n));
    const vector turned = unit(subtract(n, times(point->inside ? -1 : 1, along)));
    if (!(dot(turned, n) > 0)) return;
    point->normal = turned;
    point->facing = more(dot(turned, point->eye), 1e-3);
}

/* The material's answer, once it is known. t: the way that the ray came. */
static void point_finish(shade_point *point, double t) {
    const brdf_material *m = &point->material;
    const double through = point_transmission(point), bare = (m->ior - 1) / (m->ior + 1), glass = bare * bare;
    point->f0 = blend(brdf_f0(m), (vector){glass, glass, glass}, through);
    const double single = m->metalness > 0 ? brdf_single(m->roughness, point->facing) : 1;
    point->gain = brdf_gain(m, single);
    point->layer = brdf_layer(point->f0, m, single, point->gain, point->facing);
    point->base = brdf_base(m, point->layer);
    if (point->inside && through > 0) point->weight = filter(point->weight, absorbed(m->absorption, t));
}

static vector mirror_direction(vector normal, vector eye) { return subtract(times(2 * dot(normal, eye), normal), eye); }

static int light_part(const shade_point *point) { return point->depth == 0 ? LIGHT_DIRECT : LIGHT_INDIRECT; }

/* The same for what a floor that catches shadows shows. */
static int floor_part(const shade_job *job, const shade_point *point, int part) {
    return job->picture->clear && point->depth == 0 ? LIGHT_CLEAR : part;
}

/* What the background sends if it sends the same from everywhere near. A mirror image replaces the share `sharp`. */
static void point_even(shade_job *job, const shade_point *point, double sharp) {
    const brdf_material *m = &point->material;
    const shade_sky *sky = &job->picture->sky;
    const double kept = (1 - m->reflection) * (1 - sharp) * (1 - point_transmission(point));
    const vector image = mirror_direction(point->normal, point->eye);
    const vector blurred = blend(sky_look(sky, image), sky_ambient(sky, image), m->roughness);
    const double fill = sky->fill + (1 - sky->fill) * m->metalness;
    const vector base = times((1 - m->reflection) * sky->fill, filter(point->base, sky_ambient(sky, point->normal)));
    const vector layer = times(kept * fill, filter(point->layer, blurred));
    deposit(job, point->pixel, LIGHT_INDIRECT, filter(point->weight, add(base, layer)));
}

/* A ray that goes on from a point, as far as it matters. Where chance decides, weak ones may end, and the others
 * stand for them, too. */
static void push_bounce(shade_job *job, shade_ray *list, size_t *n, const shade_point *point, shade_ray ray,
                        uint32_t branch) {
    const shade_picture *picture = job->picture;
    const double most = largest(ray.weight);
    ray.key = key_of(point->key, branch);
    ray.sample = point->sample;
    if (picture->indirect == SHADE_EVEN) {
        if (most < SHADE_FAINT) return;
    } else if (most < SHADE_WEAK) {
        double u[2];
        pattern_pair(key_of(ray.key, KEY_SURVIVE), ray.sample, u);
        if (!(u[0] * SHADE_WEAK < most)) return;
        ray.weight = times(SHADE_WEAK / most, ray.weight);
    }
    ray.origin = point->place;
    ray.direction = unit(ray.direction);
    ray.pixel = point->pixel;
    ray.depth = point->depth + 1;
    ray.spread = more(ray.spread, point->spread);
    if (point->kind == RAY_GATHER) {
        ray.kind = RAY_GATHER;
        ray.dim *= point->dim;
    }
    if (point->depth < SHADE_DEPTH) list[(*n)++] = ray;
    else
        deposit(job, point->pixel, LIGHT_INDIRECT,
                times(ray.dim, filter(ray.weight, sky_look(&picture->sky, ray.direction))));
}

/* Direction behind a facet; `behind`: the cosine there. */
static vector bent_direction(vector facet, vector eye, double cosine, double eta, double behind) {
    return add(times(-eta, eye), times(eta * cosine - behind, facet));
}

/* Mirror image and refraction, both followed, sharp. Both directions follow from Snell's law. */
static void point_bounce(shade_job *job, const shade_point *point, double sharp, size_t *mirrored, size_t *bent) {
    const brdf_material *m = &point->material;
    const double through = point_transmission(point), plain = 1 - m->reflection;
    const double eta = point->inside ? m->ior : 1 / m->ior;
    double behind = -1, fresnel = 0;
    if (through > 0) fresnel = brdf_fresnel(point->facing, eta, &behind);
    const double even = m->reflection + plain * through * fresnel;
    const vector share = add((vector){even, even, even}, times(plain * (1 - through) * sharp, point->layer));
    shade_ray ray = {.dim = 1, .kind = RAY_SEEN};
    if (largest(share) > 0) {
        ray.direction = mirror_direction(point->normal, point->eye);
        ray.weight = filter(point->weight, share);
        push_bounce(job, job->first, mirrored, point, ray, KEY_FIRST);
    }
    if (behind >= 0) {
        ray.direction = bent_direction(point->normal, point->eye, point->facing, eta, behind);
        ray.weight = times(plain * through * (1 - fresnel), point->weight);
        push_bounce(job, job->second, bent, point, ray, KEY_SECOND);
    }
}

/* ---- bounces by chance ------------------------------------------------------------------------ */

static double lobe_alpha(const brdf_material *m) { return m->roughness * m->roughness; }

/* Too smooth for lights to be drawn towards it: its rays find the sky themselves. */
static int lobe_sharp(const brdf_material *m) { return lobe_alpha(m) < BRDF_MIN_ALPHA; }

/* A facet's normal and its cosine to the eye; polished surfaces have one. */
static vector draw_facet(const shade_point *point, uint32_t what, double *cosine) {
    const double alpha = lobe_alpha(&point->material);
    *cosine = point->facing;
    if (alpha < 1e-4) return point->normal;
    double u[2];
    pattern_pair(key_of(point->key, what), point->sample, u);
    const brdf_frame frame = brdf_frame_of(point->normal);
    vector eye = brdf_into(&frame, point->eye);
    eye.z = more(eye.z, 1e-6);
    const vector facet = brdf_from(&frame, brdf_visible(unit(eye), alpha, u));
    *cosine = more(dot(facet, point->eye), 1e-6);
    return facet;
}

/* Over the surface as it is without bumps, too. */
static vector lifted(const shade_point *point, vector direction) {
    const double below = dot(direction, point->flat);
    return below < 0 ? add(direction, times(-2 * below, point->flat)) : direction;
}

/* Density with which the lobes draw a direction, given what each is chosen with. */
static double lobes_density(const shade_point *point, const brdf_angles *at) {
    double density = point->diffuse * at->nl / brdf_pi;
    if (point->glossy > 0)
        density += point->glossy * brdf_visible_density(lobe_alpha(&point->material), point->facing, at->nh);
    return density;
}

/* What the base and, unless it is sharp, the layer send to the eye of light from a direction, times its cosine. */
static vector lobes_answer(const shade_point *point, const brdf_angles *at) {
    const brdf_material *m = &point->material;
    const double plain = 1 - m->reflection;
    const vector base = times(plain * brdf_diffuse(m->roughness, at), point->base);
    if (!(point->glossy > 0)) return base;
    const vector layer = filter(point->gain, brdf_specular(point->f0, m->roughness, at));
    return add(base, times(plain * (1 - point_transmission(point)), layer));
}

/* A ray towards the light from everywhere that is drawn from one of the lobes and stands for both: the two densities
 * are weighed together, so that a direction that one lobe seldom draws is never bright for that. `taken`: the chance
 * that there is such a ray. */
static void push_lobes(shade_job *job, const shade_point *point, int glossy, double taken, size_t *n) {
    const brdf_material *m = &point->material;
    vector way;
    if (glossy) {
        double cosine;
        way = mirror_direction(draw_facet(point, KEY_WAY, &cosine), point->eye);
    } else {
        double u[2];
        pattern_pair(key_of(point->key, KEY_WAY), point->sample, u);
        const brdf_frame frame = brdf_frame_of(point->normal);
        way = brdf_from(&frame, brdf_cosine(u));
    }
    const brdf_angles at = brdf_measure(point->normal, point->eye, way, point->facing);
    if (!(at.nl > 0) || !(dot(way, point->flat) > 0)) return;
    const double density = taken * lobes_density(point, &at), fill = job->picture->sky.fill;
    if (!(density > 0)) return;
    shade_ray ray = {.direction = way, .density = density, .spread = SHADE_SPREAD};
    ray.kind = glossy && m->roughness <= SHADE_ROUGH ? RAY_SEEN : RAY_GATHER;
    ray.dim = fill + (1 - fill) * m->metalness;
    ray.weight = filter(point->weight, times(1 / density, lobes_answer(point, &at)));
    push_bounce(job, job->first, n, point, ray, KEY_FIRST);
}

/* The mirror image in a sharp layer, a little blurred by its roughness. */
static void push_image(shade_job *job, const shade_point *point, double chance, double share, size_t *n) {
    const brdf_material *m = &point->material;
    const double alpha = lobe_alpha(m), fill = job->picture->sky.fill;
    double cosine;
    const vector way = mirror_direction(draw_facet(point, KEY_WAY, &cosine), point->eye);
    const double nl = dot(way, point->normal);
    if (!(nl > 0)) return;
    const double masking = alpha < 1e-4 ? 1 : brdf_masking(alpha, point->facing, nl);
    shade_ray ray = {.direction = lifted(point, way), .kind = RAY_SEEN, .dim = fill + (1 - fill) * m->metalness};
    const vector layer = filter(point->gain, brdf_schlick(point->f0, cosine));
    ray.weight = filter(point->weight, times(share * masking / chance, layer));
    push_bounce(job, job->first, n, point, ray, KEY_FIRST);
}

/* At most two rays go on: one by way of glass, and one of what the rest sends back. From a ray that gathers, none
 * but through glass, and one at that. */
static void point_scatter(shade_job *job, shade_point *point, size_t *first, size_t *second) {
    const brdf_material *m = &point->material;
    const double through = point_transmission(point), plain = 1 - m->reflection;
    const int gathers = point->kind == RAY_GATHER;
    const double eta = point->inside ? m->ior : 1 / m->ior;
    double behind = -1, fresnel = 0, cosine = point->facing;
    vector facet = point->normal;
    if (through > 0) {
        facet = draw_facet(point, KEY_FACET, &cosine);
        fresnel = brdf_fresnel(cosine, eta, &behind);
    }
    const double glass = plain * through * fresnel;
    const double glossy = gathers ? 0 : brightness(times(plain * (1 - through), point->layer));
    const double diffuse = gathers || point->inside ? 0 : brightness(times(plain, point->base));
    const double mirror = gathers ? 0 : m->reflection, sum = glass + glossy + diffuse + mirror;
    const double bent = behind >= 0 ? plain * through * (1 - fresnel) : 0;
    double u[2];
    pattern_pair(key_of(point->key, KEY_LOBE), point->sample, u);
    int back = sum > 0, on = bent > 0;
    double one = 1; /* chance of the one that is taken where only one is */
    if (back && on && (gathers || point->depth > 2)) {
        one = sum / (sum + bent);
        if (u[1] < one) on = 0;
        else {
            back = 0;
            one = 1 - one;
        }
    }
    if (on) {
        shade_ray ray = {.dim = 1, .kind = RAY_SEEN};
        ray.direction = bent_direction(facet, point->eye, cosine, eta, behind);
        ray.weight = times(bent / one, point->weight);
        if (dot(ray.direction, point->flat) < 0) push_bounce(job, job->second, second, point, ray, KEY_SECOND);
    }
    point->diffuse = sum > 0 ? diffuse / sum : 0;
    point->glossy = sum > 0 && !lobe_sharp(m) ? glossy / sum : 0;
    if (!back) return;
    const double at = u[0] * sum;
    if (at < diffuse || (at < diffuse + glossy && point->glossy > 0)) {
        push_lobes(job, point, at >= diffuse, one, first);
    } else if (at < diffuse + glossy) {
        push_image(job, point, one * glossy / sum, plain * (1 - through), first);
    } else {
        const int flat = at < diffuse + glossy + mirror;
        shade_ray ray = {.dim = 1, .kind = RAY_SEEN};
        ray.direction = lifted(point, mirror_direction(flat ? point->normal : facet, point->eye));
        ray.weight = times(sum / one, point->weight);
        push_bounce(job, job->first, first, point, ray, KEY_FIRST);
    }
}

/* ---- a floor that catches shadows ------------------------------------------------------------- */

/* Brightness that a light gives the floor if nothing is in the way. */
static double floor_light(const shade_light *light, vector place) {
    vector direction, irradiance;
    const double distance = light_middle(light, place, &direction, &irradiance);
    return distance > 0 && direction.y > 0 ? direction.y * brightness(irradiance) : 0;
}

static double floor_sky(const shade_picture *picture) {
    return brdf_pi * picture->sky.fill * brightness(sky_ambient(&picture->sky, (vector){0, 1, 0}));
}

/* Splits what the floor shows among all that shines on it; the sky's part is sent out here. */
static void floor_catch(shade_job *job, shade_point *point, size_t *n) {
    const shade_picture *picture = job->picture;
    const int part = floor_part(job, point, light_part(point));
    const vector shown = part == LIGHT_CLEAR                   ? white
                         : point->depth == 0 && picture->plain ? vector_of(picture->shown)
                                                               : sky_look(&picture->sky, times(-1, point->eye));
    double sum = floor_sky(picture);
    for (int32_t k = 0; k < picture->light_count; k++) sum += floor_light(&picture->lights[k], point->place);
    const vector whole = times(point->dim, filter(point->weight, shown));
    if (!(sum > 0) || point->kind != RAY_SEEN) {
        deposit(job, point->pixel, part, whole);
        return;
    }
    point->caught = times(1 / sum, whole);
    const vector even = times(floor_sky(picture) / sum, whole);
    if (picture->indirect == SHADE_EVEN) {
        deposit(job, point->pixel, floor_part(job, point, LIGHT_INDIRECT), even);
        return;
    }
    double u[2];
    pattern_pair(key_of(point->key, KEY_WAY), point->sample, u);
    const vector up = brdf_cosine(u);
    const shade_ray ray = {.direction = {up.x, up.z, up.y}, .weight = even, .kind = RAY_CATCH, .dim = 1};
    push_bounce(job, job->first, n, point, ray, KEY_FIRST);
}

/* ---- lights ----------------------------------------------------------------------------------- */

/* The disc of a light in the mirror image of a point, over the solid angle that it fills: 1 / that within it, 0
 * outside. The edge is as soft as facets of this alpha make it: smooth over 4 alpha, at most to the middle; its
 * integral stays 1. */
static double disc_seen(const shade_point *point, vector middle, double half, double alpha) {
    const vector gap = subtract(mirror_direction(point->normal, point->eye), middle);
    const double radius = 2 * sin(half / 2), soft = less(more(2 * alpha, 1e-3 * radius), radius);
    const double x = less(more((sqrt(dot(gap, gap)) - radius + soft) / (2 * soft), 0), 1);
    return (1 - x * x * (3 - 2 * x)) / (brdf_pi * (radius * radius + soft * soft / 5));
}

/* What a smooth layer sends to the eye of a light with a size. */
static vector light_image(const shade_point *point, vector middle, double half, double alpha) {
    const double seen = disc_seen(point, middle, half, alpha);
    return times(seen, filter(point->gain, brdf_schlick(point->f0, point->facing)));
}

/* What the light sends to the eye by way of this point if nothing is between. own: density of drawing this
 * direction, for light that the rays of the lobes find, too; it is weighed against theirs (Veach's balance
 * heuristic), and the image in a sharp layer is theirs alone. 0: nothing else finds it. */
static vector light_answer(const shade_point *point, vector direction, vector irradiance, double own, vector middle,
                           double half) {
    const brdf_material *m = &point->material;
    const brdf_angles at = brdf_measure(point->normal, point->eye, direction, point->facing);
    if (own > 0) {
        const double share = own / (own + lobes_density(point, &at));
        return filter(filter(point->weight, irradiance), times(share, lobes_answer(point, &at)));
    }
    const vector base = times((1 - m->reflection) * brdf_diffuse(m->roughness, &at), point->base);
    /* A highlight that a ray of a rough lobe happens on would be a speck: it is spread. One that is narrower than
     * the light would be made of specks: the light's disc is seen in it instead. */
    const double roughness = more(m->roughness, point->spread);
    vector layer;
    if (roughness * roughness < less(half / 2, 1)) layer = light_image(point, middle, half, roughness * roughness);
    else layer = filter(point->gain, brdf_specular(point->f0, roughness, &at));
    if (m->reflection > 0 && half > 0) {
        const double seen =
            point->spread > 0 ? brdf_specular(white, point->spread, &at).x : disc_seen(point, middle, half, 0);
        layer = blend(layer, (vector){seen, seen, seen}, m->reflection);
    }
    return filter(filter(point->weight, irradiance), add(base, layer));
}

/* Half the angle of a light as seen from a place. */
static double light_half(const shade_light *light, double distance) {
    if (light->kind == SHADE_SUN) return 2 * asin(less(sqrt(light->size / 2), 1));
    return asin(less(light->size / distance, 1));
}

/* Direction, distance and full answer of light k at a point; k beyond the lights: the picture of the sky. 0 if
 * nothing can come from there. */
static double light_sample(const shade_job *job, const shade_point *point, int32_t k, vector *direction,
                           vector *answer) {
    const shade_picture *picture = job->picture;
    vector irradiance;
    double u[2], distance = HUGE_VAL, own = 0, half = 0;
    vector middle = black;
    if (picture->indirect != SHADE_EVEN) pattern_pair(key_of(point->key, KEY_LIGHTS + (uint32_t)k), point->sample, u);
    if (k == picture->light_count) {
        *direction = sky_draw(&picture->sky, u);
        own = sky_density(&picture->sky, *direction);
        if (!(own > 0)) return 0;
        irradiance = times(1 / own, sky_look(&picture->sky, *direction));
    } else if (picture->indirect == SHADE_EVEN) {
        distance = light_middle(&picture->lights[k], point->place, direction, &irradiance);
    } else {
        const shade_light *light = &picture->lights[k];
        half = light_half(light, light_middle(light, point->place, &middle, &irradiance));
        distance = light_draw(light, point->place, u, direction, &irradiance);
    }
    if (!(distance > 0) || !(dot(point->normal, *direction) > 0) || !(dot(point->flat, *direction) > 0)) return 0;
    if (point->floor == SHADE_CATCH) {
        const double known = floor_light(&picture->lights[k], point->place);
        *answer = times(known, point->caught);
        return known > 0 ? distance : 0;
    }
    if (picture->floor == SHADE_SOLID && direction->y < 0 && point->place.y > picture->floor_height) {
        const double reach = (point->place.y - picture->floor_height) / -direction->y;
        if (reach < distance) return 0;
    }
    *answer = light_answer(point, *direction, irradiance, own, middle, half);
    return largest(*answer) > 0 ? distance : 0;
}

/* Collects the points that the light can reach at all; their shadow rays go into job->shadows. */
static void light_collect(shade_job *job, int32_t k, size_t points) {
    const int image = k == job->picture->light_count;
    job->shadows.n = 0;
    for (size_t i = 0; i < points; i++) {
        const shade_point *point = &job->points[i];
        if (point->inside || point->kind == RAY_CATCH) continue;
        if (job->picture->indirect != SHADE_EVEN && point->kind == RAY_GATHER) continue;
        if (image && point->floor == SHADE_CATCH) continue;
        vector direction, answer;
        const double distance = light_sample(job, point, k, &direction, &answer);
        if (!(distance > 0)) continue;
        job->lit[job->shadows.n] = (int32_t)i;
        job->arriving[job->shadows.n] = answer;
        batch_push(&job->shadows, point->place, direction, distance);
    }
}

/* Where rays that gather have ended: one light for each point, picked by what it would send. */
static void light_pick(shade_job *job, size_t points) {
    job->shadows.n = 0;
    for (size_t i = 0; i < points; i++) {
        const shade_point *point = &job->points[i];
        if (point->inside || point->kind != RAY_GATHER || point->floor == SHADE_CATCH) continue;
        vector way = black, answer = black;
        double sum = 0, far = 0, u[2];
        pattern_pair(key_of(point->key, KEY_PICK), point->sample, u);
        for (int32_t k = 0; k < job->picture->light_count; k++) {
            vector direction, one;
            const double distance = light_sample(job, point, k, &direction, &one);
            if (!(distance > 0)) continue;
            const double size = largest(one);
            sum += size;
            if (u[0] * sum < size) { /* in place of the one before, which keeps its chance */
                u[0] = u[0] * sum / size;
                way = direction;
                far = distance;
                answer = times(1 / size, one);
            } else {
                u[0] = (u[0] * sum - size) / (sum - size);
            }
        }
        if (!(sum > 0)) continue;
        job->lit[job->shadows.n] = (int32_t)i;
        job->arriving[job->shadows.n] = times(sum, answer);
        batch_push(&job->shadows, point->place, way, far);
    }
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
            *share = black;
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
        if (status == BLOB_OK) status = read_materials(job, rows, 0);
        if (status != BLOB_OK) return status;
        light_cross(job);
    }
    return BLOB_OK;
}

/* Adds what the collected lights send by way of the points. */
static blob_status light_add(shade_job *job) {
    shade_batch *batch = &job->shadows;
    const size_t n = batch->n;
    if (n == 0) return BLOB_OK;
    blob_status status;
    if (job->picture->transparent) {
        for (size_t i = 0; i < n; i++) job->share[i] = white;
        status = light_look_through(job);
    } else {
        const double start = clock_start(job);
        status = blob_any_hit(job->scene, job->index, job->query, n, batch->origins, batch->directions, batch->starts,
                              batch->ends, job->blocked);
        clock_stop(job, start);
        for (size_t i = 0; status == BLOB_OK && i < n; i++) job->share[i] = job->blocked[i] ? black : white;
    }
    for (size_t i = 0; status == BLOB_OK && i < n; i++) {
        const shade_point *point = &job->points[job->lit[i]];
        const int part = point->floor == SHADE_CATCH ? floor_part(job, point, light_part(point)) : light_part(point);
        deposit(job, point->pixel, part, filter(job->share[i], job->arriving[i]));
    }
    return status;
}

static blob_status light_points(shade_job *job, size_t n) {
    const shade_picture *picture = job->picture;
    const int chance = picture->indirect != SHADE_EVEN;
    const int32_t lights = picture->light_count + (chance && picture->sky.kind == SHADE_IMAGE);
    blob_status status = BLOB_OK;
    for (int32_t k = 0; k < lights && status == BLOB_OK; k++) {
        light_collect(job, k, n);
        status = light_add(job);
    }
    if (status == BLOB_OK && chance && picture->light_count) {
        light_pick(job, n);
        status = light_add(job);
    }
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

/* One Newton step towards the surface for those of the first n of job->places that are on one. */
static blob_status polish_places(shade_job *job, size_t n) {
    for (int32_t surface = -1;;) {
        /* The lowest surface above the last one, and its places together. */
        int32_t next = INT32_MAX;
        size_t count = 0;
        for (size_t i = 0; i < n; i++)
            if (job->surfaces[i] > surface && job->surfaces[i] < next) next = job->surfaces[i];
        if (next == INT32_MAX) return BLOB_OK;
        for (size_t i = 0; i < n; i++) {
            if (job->surfaces[i] != next) continue;
            memcpy(job->together + 3 * count, job->places + 3 * i, 3 * sizeof(double));
            job->which[count++] = (int32_t)i;
        }
        const double start = clock_start(job);
        const blob_status status =
            blob_field(job->scene, job->index, next, count, job->together, job->field, job->gradients);
        clock_stop(job, start);
        if (status != BLOB_OK) return status;
        for (size_t i = 0; i < count; i++) point_polish(job, i, job->picture->thresholds[next]);
        surface = next;
    }
}

/* ---- batches of rays -------------------------------------------------------------------------- */

/* The sky as a ray sees it that has met nothing. */
static vector seen_sky(const shade_job *job, const shade_ray *ray, int part) {
    const shade_picture *picture = job->picture;
    if (ray->kind == RAY_CATCH || part == LIGHT_CLEAR) return white;
    if (ray->depth == 0 && picture->plain) return vector_of(picture->shown);
    vector seen = times(ray->dim, sky_look(&picture->sky, ray->direction));
    if (picture->sky.kind == SHADE_IMAGE && ray->density > 0)
        seen = times(ray->density / (ray->density + sky_density(&picture->sky, ray->direction)), seen);
    return seen;
}

/* What fog leaves of light over a distance, and adds to a ray that goes on. */
static double fog_left(const shade_picture *picture, double t) {
    return picture->fog[0] > 0 ? exp(-t * picture->fog[0]) : 1;
}

static void fog_add(shade_job *job, const shade_ray *ray, double left) {
    const vector glow = filter(ray->weight, vector_of(job->picture->fog + 1));
    deposit(job, ray->pixel, ray->depth == 0 ? LIGHT_DIRECT : LIGHT_INDIRECT, times((1 - left) * ray->dim, glow));
}

/* A ray that has met nothing. Fog lies low: it hides the sky at the horizon only. */
static void ray_miss(shade_job *job, const shade_ray *ray) {
    const shade_picture *picture = job->picture;
    const double left = picture->fog[0] > 0 && ray->kind != RAY_CATCH ? -expm1(-6 * more(ray->direction.y, 0)) : 1;
    if (left < 1) fog_add(job, ray, left);
    int part = ray->depth == 0 ? LIGHT_DIRECT : LIGHT_INDIRECT;
    if (picture->clear && ray->depth == (ray->kind == RAY_CATCH)) part = LIGHT_CLEAR;
    deposit(job, ray->pixel, part, times(left, filter(ray->weight, seen_sky(job, ray, part))));
}

/* Misses see the background; the rest become job->points without material. Returns how many. */
static size_t collect_points(shade_job *job, size_t n) {
    const shade_batch *batch = &job->rays;
    const shade_picture *picture = job->picture;
    size_t points = 0;
    for (size_t i = 0; i < n; i++) {
        shade_ray *ray = &job->chunk[i];
        const int hit = is_hit(batch->status[i]);
        double floor = ray->kind == RAY_CATCH ? HUGE_VAL : floor_reach(picture, ray->origin, ray->direction);
        if (hit && floor >= batch->t[i]) floor = HUGE_VAL;
        double gone = 0;
        if (floor < HUGE_VAL) gone = floor_gone(picture, add(ray->origin, times(floor, ray->direction)));
        if (gone > 0) {
            shade_ray rest = *ray;
            rest.weight = times(gone, ray->weight);
            rest.direction.y = 0; /* where the floor has gone the sky goes on as it is at the horizon */
            rest.direction = unit(rest.direction);
            ray_miss(job, &rest);
            ray->weight = times(1 - gone, ray->weight);
        }
        if (!hit && !(floor < HUGE_VAL)) {
            ray_miss(job, ray);
            continue;
        }
        if (ray->kind == RAY_CATCH || !(gone < 1)) continue;
        shade_point *point = &job->points[points];
        point_prepare(job, point, ray, i, floor);
        if (!point->inside && picture->fog[0] > 0) {
            const double left = fog_left(picture, batch->t[i]);
            fog_add(job, ray, left);
            point->weight = times(left, point->weight);
        }
        vector_put(point->place, job->places + 3 * points);
        job->surfaces[points] = floor < HUGE_VAL ? -1 : batch->surface[i];
        job->passing[points++] = (int32_t)i;
    }
    return points;
}

static void push_children(shade_job *job, const shade_ray *list, size_t n) {
    if (n == 0) return;
    size_t *waiting = &job->waiting[list->depth];
    assert(*waiting + n <= SHADE_QUEUE);
    memcpy(job->queues[list->depth] + *waiting, list, n * sizeof *list);
    *waiting += n;
}

/* Interleaves zeros between the bits of a byte. */
static uint32_t spread_bits(uint32_t x) {
    x = (x | x << 4) & 0x0f0fu;
    x = (x | x << 2) & 0x3333u;
    return (x | x << 1) & 0x5555u;
}

/* Place of a direction in an order in which neighbours point about the same way: the sphere on a square (Meyer et
 * al., "On floating-point normal vectors", 2010), whose cells are taken in Morton order. */
static uint16_t direction_key(vector d) {
    const double size = fabs(d.x) + fabs(d.y) + fabs(d.z);
    double u = d.x / size, v = d.z / size;
    if (d.y < 0) {
        const double fold = (1 - fabs(v)) * (u < 0 ? -1 : 1);
        v = (1 - fabs(u)) * (v < 0 ? -1 : 1);
        u = fold;
    }
    const double half = 0.5 * SHADE_DIGIT, most = SHADE_DIGIT - 1;
    const uint32_t i = (uint32_t)less(more((u + 1) * half, 0), most), j = (uint32_t)less(more((v + 1) * half, 0), most);
    return (uint16_t)(spread_bits(i) | spread_bits(j) << 1);
}

/* One pass of a radix sort: the first n of `from` by a byte of their keys, stably. */
static void sort_pass(const uint16_t *keys, int shift, const uint16_t *from, size_t n, uint16_t *to) {
    size_t starts[SHADE_DIGIT + 1] = {0};
    for (size_t i = 0; i < n; i++) starts[(keys[i] >> shift & (SHADE_DIGIT - 1)) + 1]++;
    for (size_t k = 1; k < SHADE_DIGIT; k++) starts[k] += starts[k - 1];
    for (size_t i = 0; i < n; i++) to[starts[keys[from[i]] >> shift & (SHADE_DIGIT - 1)]++] = from[i];
}

/* The order in which the rays of one depth are taken: the camera's as they come, bounces by their direction, so that
 * those which are traced together go the same way. */
static void sort_queue(shade_job *job, size_t depth) {
    uint16_t *order = job->orders[depth], other[SHADE_QUEUE];
    const size_t n = job->waiting[depth];
    for (size_t i = 0; i < n; i++) order[i] = (uint16_t)i;
    if (depth == 0) return;
    for (size_t i = 0; i < n; i++) job->keys[i] = direction_key(job->queues[depth][i].direction);
    sort_pass(job->keys, 0, order, n, other);
    sort_pass(job->keys, 8, other, n, order);
}

/* Takes rays of one depth from the end of their order, at most a block of them. */
static size_t take_chunk(shade_job *job, size_t depth) {
    size_t *waiting = &job->waiting[depth];
    const size_t n = *waiting < SHADE_BLOCK ? *waiting : SHADE_BLOCK;
    *waiting -= n;
    const uint16_t *order = job->orders[depth] + *waiting;
    for (size_t i = 0; i < n; i++) job->chunk[i] = job->queues[depth][order[i]];
    return n;
}

/* Emission, the light from everywhere, and the rays that go on from a point. */
static void shade_point_itself(shade_job *job, shade_point *point, size_t *first, size_t *second) {
    const brdf_material *m = &point->material;
    const int mode = job->picture->indirect;
    if (point->floor == SHADE_CATCH) {
        floor_catch(job, point, first);
        return;
    }
    deposit(job, point->pixel, light_part(point), filter(point->weight, m->emission));
    if (mode == SHADE_EVEN) {
        const double smooth = 1 - m->roughness, sharp = point->inside ? 0 : m->metalness * smooth * smooth;
        point_even(job, point, sharp);
        point_bounce(job, point, sharp, first, second);
        return;
    }
    if (point->kind == RAY_GATHER) point_even(job, point, 0);
    point_scatter(job, point, first, second);
}

static blob_status shade_points(shade_job *job, size_t n) {
    size_t first = 0, second = 0, kept = 0;
    blob_status status = polish_places(job, n);
    if (status == BLOB_OK) status = read_materials(job, n, 1);
    if (status != BLOB_OK) return status;
    for (size_t i = 0; i < n; i++) {
        shade_point *point = &job->points[i];
        point->place = vector_of(job->places + 3 * i);
        point->material = brdf_read(job->rows + BLOB_MATERIAL * i);
        if (job->picture->texture_count) point_bump(point, job->bumps[i]);
        point_finish(point, job->rays.t[job->passing[i]]);
        /* Occlusion: what such rays hit is dark, but for what shines through it. */
        if (job->picture->indirect == SHADE_OCCLUSION && point->kind == RAY_GATHER && !(point_transmission(point) > 0))
            continue;
        shade_point_itself(job, point, &first, &second);
        if (kept != i) job->points[kept] = *point;
        kept++;
    }
    push_children(job, job->first, first);
    push_children(job, job->second, second);
    return light_points(job, kept);
}

static blob_status shade_chunk(shade_job *job, size_t depth) {
    if (cancelled(job->query)) return BLOB_CANCELLED;
    const size_t n = take_chunk(job, depth);
    job->rays.n = 0;
    for (size_t i = 0; i < n; i++) batch_push(&job->rays, job->chunk[i].origin, job->chunk[i].direction, HUGE_VAL);
    const blob_status status = batch_trace(job, &job->rays, 0);
    if (status != BLOB_OK) return status;
    const size_t points = collect_points(job, n);
    return points ? shade_points(job, points) : BLOB_OK;
}

/* All rays of one depth, and of those behind it whatever fills a batch; no queue runs over, as a block leaves at most
 * two for the next depth. */
static blob_status shade_depth(shade_job *job, size_t depth) {
    sort_queue(job, depth);
    while (job->waiting[depth]) {
        blob_status status = shade_chunk(job, depth);
        if (status == BLOB_OK && depth < SHADE_DEPTH && job->waiting[depth + 1] >= SHADE_BATCH)
            status = shade_depth(job, depth + 1);
        if (status != BLOB_OK) return status;
    }
    return BLOB_OK;
}

/* Until no ray waits: from the camera on, so that what is left becomes as few blocks as can be. */
static blob_status shade_waiting(shade_job *job) {
    blob_status status = BLOB_OK;
    for (size_t depth = 0; depth <= SHADE_DEPTH && status == BLOB_OK; depth++) status = shade_depth(job, depth);
    return status;
}

/* ---- rays from the camera --------------------------------------------------------------------- */

typedef struct shade_area {
    int32_t x0, y0, x1, y1;
} shade_area;

static vector view_way(const shade_picture *picture, double x, double y) {
    const vector across = add(times(x, vector_of(picture->right)), times(y, vector_of(picture->down)));
    return add(vector_of(picture->corner), across);
}

static void push_camera(shade_job *job, int32_t x, int32_t y, int32_t pixel, uint32_t key, uint32_t sample) {
    const shade_picture *picture = job->picture;
    double place[2] = {0.5, 0.5};
    if (picture->samples > 1) pattern_place(key, sample, place);
    vector eye = vector_of(picture->eye), way = view_way(picture, x + place[0], y + place[1]);
    if (picture->focus > 0 && picture->samples > 1) {
        double u[2];
        pattern_pair(key_of(key, KEY_LENS), sample, u);
        const double r = sqrt(u[0]), turn = 2 * brdf_pi * u[1];
        const vector off =
            add(times(r * cos(turn), vector_of(picture->lens)), times(r * sin(turn), vector_of(picture->lens + 3)));
        eye = add(eye, off);
        way = subtract(times(picture->focus, way), off);
    }
    job->queues[0][job->waiting[0]++] = (shade_ray){.origin = eye,
                                                    .direction = unit(way),
                                                    .weight = white,
                                                    .dim = 1,
                                                    .pixel = pixel,
                                                    .kind = RAY_SEEN,
                                                    .key = key,
                                                    .sample = sample};
}

/* Samples [first, last) of a pixel. */
static blob_status sample_pixel(shade_job *job, shade_area tile, int32_t x, int32_t y, int32_t first, int32_t last) {
    const int32_t pixel = (y - tile.y0) * (tile.x1 - tile.x0) + x - tile.x0;
    const uint32_t key = pattern_pixel((uint32_t)x, (uint32_t)y, job->picture->seed);
    for (int32_t i = first; i < last; i++) {
        push_camera(job, x, y, pixel, key, (uint32_t)i);
        if (job->waiting[0] < SHADE_BLOCK) continue;
        const blob_status status = shade_depth(job, 0);
        if (status != BLOB_OK) return status;
    }
    job->taken[pixel] = last;
    return BLOB_OK;
}

/* The even bits of a Morton number. */
static int32_t every_other_bit(uint32_t code) {
    code &= 0x55555555u;
    code = (code | code >> 1) & 0x33333333u;
    code = (code | code >> 2) & 0x0f0f0f0fu;
    code = (code | code >> 4) & 0x00ff00ffu;
    return (int32_t)((code | code >> 8) & 0x0000ffffu);
}

/* ---- rounds of samples ------------------------------------------------------------------------ */

/* How bright light looks in the picture, 0 to 1: about what images.py does to it. */
static double shown_as(const shade_picture *picture, double x) {
    x *= picture->exposure;
    if (picture->curve == SHADE_FILM) x = 1 - exp(-x);
    return sqrt(less(more(x, 0), 1));
}

/* Mean square of what a pixel's error may be after n samples of which the first half was there before. */
static double pixel_error(const shade_job *job, size_t pixel, int32_t n) {
    const double *now = job->light + 3 * LIGHT_PARTS * pixel, *then = job->before + 3 * LIGHT_PARTS * pixel;
    double sum = 0;
    for (size_t k = 0; k < 3; k++) {
        const double half = then[k] + then[3 + k] + then[6 + k], rest = now[k] + now[3 + k] + now[6 + k] - half;
        const double gap = shown_as(job->picture, 2 * half / n) - shown_as(job->picture, 2 * rest / n);
        sum += gap * gap / 12;
    }
    return sum;
}

static size_t pixel_at(shade_area tile, int32_t x, int32_t y) {
    return (size_t)(y - tile.y0) * (size_t)(tile.x1 - tile.x0) + (size_t)(x - tile.x0);
}

static shade_area cut(shade_area a, shade_area tile) {
    return (shade_area){a.x0 > tile.x0 ? a.x0 : tile.x0, a.y0 > tile.y0 ? a.y0 : tile.y0,
                        a.x1 < tile.x1 ? a.x1 : tile.x1, a.y1 < tile.y1 ? a.y1 : tile.y1};
}

/* Does the cell need more than these n samples? Remembers where it is. */
static int cell_goes_on(shade_job *job, shade_area tile, shade_area cell, int32_t n) {
    double sum = 0;
    int32_t count = 0;
    for (int32_t y = cell.y0; y < cell.y1; y++)
        for (int32_t x = cell.x0; x < cell.x1; x++, count++) {
            const size_t pixel = pixel_at(tile, x, y), size = 3 * LIGHT_PARTS;
            sum += pixel_error(job, pixel, n);
            memcpy(job->before + size * pixel, job->light + size * pixel, size * sizeof *job->light);
        }
    return sum > job->picture->noise * job->picture->noise * count;
}

/* Samples [first, last) of the cells of an area that go on, in Morton order. */
static blob_status sample_area(shade_job *job, shade_area tile, shade_area area, const uint8_t *active, int32_t first,
                               int32_t last) {
    for (uint32_t code = 0; code < SHADE_AREA * SHADE_AREA; code++) {
        const int32_t i = every_other_bit(code), j = every_other_bit(code >> 1), x = area.x0 + i, y = area.y0 + j;
        if (x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) continue;
        if (!active[j / SHADE_CELL * SHADE_CELLS + i / SHADE_CELL]) continue;
        const blob_status status = sample_pixel(job, tile, x, y, first, last);
        if (status != BLOB_OK) return status;
    }
    return shade_waiting(job);
}

/* An area of 16 x 16 pixels, round by round. */
static blob_status shade_rounds(shade_job *job, shade_area tile, shade_area area) {
    const shade_picture *picture = job->picture;
    uint8_t active[SHADE_CELLS * SHADE_CELLS];
    memset(active, 1, sizeof active);
    const int rounds = picture->noise > 0 && picture->least < picture->samples;
    /* Half of the first round comes alone, so that there are halves to compare. */
    int32_t first = 0, last = rounds ? picture->least / 2 : picture->samples;
    for (int go = 1; go && first < picture->samples;) {
        const blob_status status = sample_area(job, tile, area, active, first, last);
        if (status != BLOB_OK) return status;
        go = 0;
        for (int32_t c = 0; c < SHADE_CELLS * SHADE_CELLS; c++) {
            const int32_t x = area.x0 + c % SHADE_CELLS * SHADE_CELL, y = area.y0 + c / SHADE_CELLS * SHADE_CELL;
            const shade_area cell = cut((shade_area){x, y, x + SHADE_CELL, y + SHADE_CELL}, tile);
            if (!active[c] || cell.x0 >= cell.x1 || cell.y0 >= cell.y1) continue;
            active[c] = (uint8_t)(cell_goes_on(job, tile, cell, last) || last < picture->least);
            go |= active[c];
        }
        first = last;
        last = last > picture->samples / 2 ? picture->samples : 2 * last;
    }
    return BLOB_OK;
}

/* ---- layers ----------------------------------------------------------------------------------- */

static void layers_write(const shade_layers *layers, const shade_batch *batch, size_t i, double floor, size_t pixel) {
    int32_t *const counters[6] = {layers->evaluations, layers->nodes,      layers->candidates,
                                  layers->spans,       layers->sandwiches, layers->fallbacks};
    const int hit = is_hit(batch->status[i]), plane = floor < HUGE_VAL;
    const double t = plane ? floor : batch->t[i];
    for (size_t k = 0; k < 3; k++) {
        const double place = batch->origins[3 * i + k] + t * batch->directions[3 * i + k];
        const double normal = plane ? k == 1 : batch->normals[3 * i + k];
        if (layers->normal) layers->normal[3 * pixel + k] = hit || plane ? (float)normal : NAN;
        if (layers->position) layers->position[3 * pixel + k] = hit || plane ? (float)place : NAN;
    }
    if (layers->depth) layers->depth[pixel] = hit || plane ? (float)t : INFINITY;
    if (layers->surface) layers->surface[pixel] = hit && !plane ? batch->surface[i] : -1;
    for (size_t k = 0; k < 6; k++)
        if (counters[k]) counters[k][pixel] = batch->counters[k][i];
}

/* The colours of what a batch of camera rays has hit. */
static blob_status layers_albedo(shade_job *job, const size_t *pixels, const double *floors) {
    const shade_batch *batch = &job->rays;
    size_t which[SHADE_BLOCK], n = 0;
    for (size_t i = 0; i < batch->n; i++) {
        const int plane = floors[i] < HUGE_VAL;
        for (size_t k = 0; k < 3; k++) job->layers->albedo[3 * pixels[i] + k] = 0;
        if (!plane && !is_hit(batch->status[i])) continue;
        const vector way = times(plane ? floors[i] : batch->t[i], vector_of(batch->directions + 3 * i));
        vector_put(add(vector_of(batch->origins + 3 * i), way), job->places + 3 * n);
        job->surfaces[n] = plane ? -1 : batch->surface[i];
        which[n++] = pixels[i];
    }
    const blob_status status = read_materials(job, n, 0);
    for (size_t i = 0; status == BLOB_OK && i < n; i++)
        for (size_t k = 0; k < 3; k++) job->layers->albedo[3 * which[i] + k] = (float)job->rows[BLOB_MATERIAL * i + k];
    return status;
}

/* Layers of one area of pixels, with rays of their own. */
static blob_status layers_area(shade_job *job, shade_area tile, shade_area area) {
    const shade_picture *picture = job->picture;
    size_t pixels[SHADE_BLOCK];
    double floors[SHADE_BLOCK];
    const vector eye = vector_of(picture->eye);
    job->rays.n = 0;
    for (uint32_t code = 0; code < SHADE_BLOCK; code++) {
        const int32_t x = area.x0 + every_other_bit(code), y = area.y0 + every_other_bit(code >> 1);
        if (x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) continue;
        pixels[job->rays.n] = pixel_at(tile, x, y);
        batch_push(&job->rays, eye, unit(view_way(picture, x + 0.5, y + 0.5)), HUGE_VAL);
    }
    const blob_status status = batch_trace(job, &job->rays, 1);
    if (status != BLOB_OK) return status;
    for (size_t i = 0; i < job->rays.n; i++) {
        floors[i] = HUGE_VAL;
        if (picture->floor == SHADE_SOLID)
            floors[i] = floor_reach(picture, eye, vector_of(job->rays.directions + 3 * i));
        if (is_hit(job->rays.status[i]) && floors[i] >= job->rays.t[i]) floors[i] = HUGE_VAL;
        layers_write(job->layers, &job->rays, i, floors[i], pixels[i]);
    }
    return job->layers->albedo ? layers_albedo(job, pixels, floors) : BLOB_OK;
}

/* ---- tiles ------------------------------------------------------------------------------------ */

static blob_status each_area(shade_job *job, shade_area tile,
                             blob_status (*make)(shade_job *job, shade_area tile, shade_area area)) {
    for (int32_t y = tile.y0 & -SHADE_AREA; y < tile.y1; y += SHADE_AREA)
        for (int32_t x = tile.x0 & -SHADE_AREA; x < tile.x1; x += SHADE_AREA) {
            if (cancelled(job->query)) return BLOB_CANCELLED;
            const blob_status status = make(job, tile, (shade_area){x, y, x + SHADE_AREA, y + SHADE_AREA});
            if (status != BLOB_OK) return status;
        }
    return BLOB_OK;
}

static void write_color(float *out, const double *light, int32_t samples) {
    for (size_t k = 0; k < 3; k++) {
        const double mean = light[k] / samples;
        out[k] = (float)(mean < SHADE_BRIGHTEST ? mean : SHADE_BRIGHTEST);
    }
}

static void write_pixels(const shade_job *job, size_t pixels, float *rgba) {
    const shade_layers *layers = job->layers;
    for (size_t i = 0; i < pixels; i++) {
        const double *direct = job->light + 3 * LIGHT_PARTS * i, *indirect = direct + 3;
        const double sum[3] = {direct[0] + indirect[0], direct[1] + indirect[1], direct[2] + indirect[2]};
        write_color(rgba + 4 * i, sum, job->taken[i]);
        const double *clear = direct + (size_t)3 * LIGHT_CLEAR;
        rgba[4 * i + 3] = (float)less(more(1 - (clear[0] + clear[1] + clear[2]) / (3.0 * job->taken[i]), 0), 1);
        if (layers && layers->direct) write_color(layers->direct + 3 * i, direct, job->taken[i]);
        if (layers && layers->indirect) write_color(layers->indirect + 3 * i, indirect, job->taken[i]);
        if (layers && layers->samples) layers->samples[i] = job->taken[i];
    }
}

static int wants_centres(const shade_layers *layers) {
    return layers && (layers->depth || layers->normal || layers->position || layers->surface || layers->evaluations ||
                      layers->nodes || layers->candidates || layers->spans || layers->sandwiches || layers->fallbacks ||
                      layers->albedo);
}

static int acceptable(const shade_picture *picture, shade_area tile) {
    return picture->samples >= 1 && picture->least >= 1 && tile.x0 >= 0 && tile.x0 < tile.x1 &&
           tile.x1 <= picture->width && tile.y0 >= 0 && tile.y0 < tile.y1 && tile.y1 <= picture->height;
}

/* Room for the registers of the largest texture. */
static size_t most_registers(const shade_picture *picture) {
    size_t most = 1;
    for (int32_t i = 0; i < picture->texture_count; i++) {
        const size_t size = texture_size(&picture->textures[i]);
        if (size > most) most = size;
    }
    return most;
}

/* Pictures that plain.h is not enough for, and layers by rays of their own: where rgba is NULL, only those. */
static blob_status shade_fully(const blob_scene *scene, const blob_index *index, const blob_query *query,
                               const shade_picture *picture, shade_area tile, float *rgba, const shade_layers *layers,
                               double *seconds) {
    const size_t pixels = rgba ? (size_t)(tile.x1 - tile.x0) * (size_t)(tile.y1 - tile.y0) : 1;
    shade_job *job = malloc(sizeof *job);
    double *light = calloc(3 * LIGHT_PARTS * pixels, sizeof *light);
    double *before = calloc(3 * LIGHT_PARTS * pixels, sizeof *before);
    int32_t *taken = calloc(pixels, sizeof *taken);
    texture_lanes *registers = malloc(most_registers(picture) * sizeof *registers);
    blob_status status = BLOB_NO_MEMORY;
    if (job && light && before && taken && registers) {
        job->scene = scene;
        job->index = index;
        job->query = query;
        job->picture = picture;
        job->layers = layers;
        job->light = light;
        job->before = before;
        job->taken = taken;
        job->registers = registers;
        job->hits = 0;
        job->timed = seconds != NULL;
        memset(job->waiting, 0, sizeof job->waiting);
        status = rgba ? each_area(job, tile, shade_rounds) : BLOB_OK;
        if (status == BLOB_OK && wants_centres(layers)) status = each_area(job, tile, layers_area);
        if (status == BLOB_OK && rgba) write_pixels(job, pixels, rgba);
        if (seconds) seconds[0] += job->hits;
    }
    free(registers);
    free(taken);
    free(before);
    free(light);
    free(job);
    return status;
}

/* ---- plain pictures --------------------------------------------------------------------------- */

int plain_enough(const shade_picture *picture, const blob_query *query) {
    if (query->normals != BLOB_NORMALS_ANALYTIC) return 0;
    if (picture->clear || picture->indirect != SHADE_EVEN || (picture->noise > 0 && picture->least < picture->samples))
        return 0;
    if (picture->floor || picture->fog[0] > 0 || picture->texture_count || picture->sky.kind == SHADE_IMAGE) return 0;
    if (picture->focus > 0 && picture->samples > 1) return 0;
    for (int32_t i = 0; i < picture->material_count; i++) {
        const brdf_material m = brdf_read(picture->materials + BLOB_MATERIAL * (size_t)i);
        if (m.metalness > 0 || m.transmission > 0 || m.reflection > 0) return 0;
    }
    return 1;
}

/* The layers that come from samples, of sums as plain_tile.light. */
static void plain_layers(const shade_layers *layers, size_t pixels, const double *light, int32_t samples) {
    for (size_t i = 0; i < pixels; i++) {
        if (layers->direct) write_color(layers->direct + 3 * i, light + 6 * i, samples);
        if (layers->indirect) write_color(layers->indirect + 3 * i, light + 6 * i + 3, samples);
        if (layers->samples) layers->samples[i] = samples;
    }
}

static blob_status shade_plain(const blob_scene *scene, const blob_index *index, const blob_query *query,
                               const shade_picture *picture, shade_area tile, float *rgba, const shade_layers *layers,
                               double *seconds) {
    const size_t pixels = (size_t)(tile.x1 - tile.x0) * (size_t)(tile.y1 - tile.y0);
    const int sampled = layers && (layers->direct || layers->indirect || layers->samples);
    plain_tile plain = {.scene = scene,
                        .index = index,
                        .query = query,
                        .picture = picture,
                        .x0 = tile.x0,
                        .y0 = tile.y0,
                        .x1 = tile.x1,
                        .y1 = tile.y1,
                        .rgba = rgba,
                        .light = sampled ? malloc(6 * pixels * sizeof(double)) : NULL};
    if (sampled && !plain.light) return BLOB_NO_MEMORY;
    const double start = seconds ? seconds_now() : 0;
    blob_status (*make)(plain_tile * tile) = plain_make_baseline;
#ifdef BLOB_X86
    if (strcmp(blob_isa(), "x86-64-v3") == 0) make = plain_make_v3;
    if (strcmp(blob_isa(), "x86-64-v4") == 0) make = plain_make_v4;
#endif
    const blob_status status = make(&plain);
    if (seconds) seconds[0] += (seconds_now() - start) * plain.seconds[0] / more(plain.seconds[1], 1e-9);
    if (sampled && status == BLOB_OK) plain_layers(layers, pixels, plain.light, picture->samples);
    free(plain.light);
    if (status != BLOB_OK || !wants_centres(layers)) return status;
    return shade_fully(scene, index, query, picture, tile, NULL, layers, seconds);
}

int32_t shade_abi(void) { return SHADE_ABI; }

blob_status shade_tile(const blob_scene *scene, const blob_index *index, const blob_query *query,
                       const shade_picture *picture, int32_t x0, int32_t y0, int32_t x1, int32_t y1, float *rgba,
                       const shade_layers *layers, double *seconds) {
    const shade_area tile = {x0, y0, x1, y1};
    if (!acceptable(picture, tile)) return BLOB_BAD_ARGUMENT;
    const double start = seconds ? seconds_now() : 0;
    const blob_status status = plain_enough(picture, query)
                                   ? shade_plain(scene, index, query, picture, tile, rgba, layers, seconds)
                                   : shade_fully(scene, index, query, picture, tile, rgba, layers, seconds);
    if (seconds) seconds[1] += seconds_now() - start;
    return status;
}

/* ---- for tests -------------------------------------------------------------------------------- */

void shade_pattern(uint32_t x, uint32_t y, uint32_t seed, int32_t n, double *places) {
    const uint32_t pixel = pattern_pixel(x, y, seed);
    for (int32_t i = 0; i < n; i++) pattern_place(pixel, (uint32_t)i, places + 2 * i);
}

void shade_evaluate(const shade_picture *picture, int32_t texture, size_t n, const double *places, double *out) {
    const shade_texture *program = &picture->textures[texture];
    texture_lanes *registers = malloc(texture_size(program) * sizeof *registers);
    for (size_t i = 0; registers && i < n; i += TEXTURE_LANES)
        texture_run(picture, program, n - i < TEXTURE_LANES ? n - i : TEXTURE_LANES, places + 3 * i, registers,
                    out + i * (size_t)program->output_count);
    free(registers);
}

/* A point with this material at the origin, seen from `eye`, the normal along z. */
static shade_point test_point(const double *material, vector eye) {
    shade_point point = {.normal = {0, 0, 1}, .flat = {0, 0, 1}, .eye = eye, .weight = white, .dim = 1};
    point.material = brdf_read(material);
    point.facing = more(eye.z, 1e-6);
    point_finish(&point, 0);
    return point;
}

void shade_respond(const double *material, size_t n, const double *eyes, const double *lights, double *out) {
    for (size_t i = 0; i < n; i++) {
        const shade_point point = test_point(material, vector_of(eyes + 3 * i));
        const brdf_angles at = brdf_measure(point.normal, point.eye, vector_of(lights + 3 * i), point.facing);
        vector_put(times(brdf_diffuse(point.material.roughness, &at), point.base), out + 6 * i);
        vector_put(filter(point.gain, brdf_specular(point.f0, point.material.roughness, &at)), out + 6 * i + 3);
    }
}

void shade_lobe(const double *material, const double *eye, size_t n, const double *numbers, double *out) {
    const shade_point point = test_point(material, vector_of(eye));
    const double alpha = lobe_alpha(&point.material);
    for (size_t i = 0; i < n; i++) {
        const vector facet = brdf_visible(point.eye, alpha, numbers + 2 * i);
        const vector way = mirror_direction(facet, point.eye);
        const double masking = way.z > 0 ? brdf_masking(alpha, point.facing, way.z) : 0;
        vector_put(way, out + 7 * i);
        out[7 * i + 3] = brdf_visible_density(alpha, point.facing, facet.z);
        vector_put(times(masking, filter(point.gain, brdf_schlick(point.f0, dot(facet, point.eye)))), out + 7 * i + 4);
    }
}

void shade_sky_look(const shade_sky *sky, size_t n, const double *directions, double *out) {
    for (size_t i = 0; i < n; i++) {
        const vector d = vector_of(directions + 3 * i);
        vector_put(sky_look(sky, d), out + 4 * i);
        out[4 * i + 3] = sky->kind == SHADE_IMAGE ? sky_density(sky, d) : 0;
    }
}

void shade_sky_draw(const shade_sky *sky, size_t n, const double *numbers, double *directions) {
    for (size_t i = 0; i < n; i++) vector_put(sky_draw(sky, numbers + 2 * i), directions + 3 * i);
}
