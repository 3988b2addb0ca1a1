/* shade.h - from first hits to light: tiles of a picture, and its layers.
 *
 * Uses the public calls of blob.h only. No state: the caller owns every buffer; scratch memory is
 * allocated for a call and freed by it. A tile's result depends on its own pixels alone, so tiles
 * may be made in any order and on any threads; corners at multiples of 16 keep the blocks of rays,
 * and with them every last bit, the same however a picture is cut into tiles.
 *
 * The light model: suns and lamps with hard shadows; the background as an even ambient light without
 * occlusion; mirror images in metals and mirrors, refraction with absorption in transparent
 * materials, both up to SHADE_DEPTH bounces; materials as in brdf.h. Light is linear RGB.
 */
#ifndef BLOB_SHADE_H
#define BLOB_SHADE_H

#include "blob.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bumped whenever a struct below changes; backends/picture.py must agree. */
#define SHADE_ABI 1

/* Bounces of mirror images and refraction; what is left then sees the background. */
#define SHADE_DEPTH 8

/* ORDER LIGHTS: the same order in backends/picture.py. */
enum { SHADE_SUN, SHADE_LAMP };

typedef struct shade_light {
    int32_t kind; /* SHADE_* */
    int32_t reserved;
    double place[3]; /* SUN: unit vector to it; LAMP: where it is */
    double color[3]; /* SUN: irradiance; LAMP: irradiance at distance 1 */
} shade_light;

/* A picture. The view direction of the point (x, y), in pixels from the top left corner, is
 * corner + x right + y down. The background's radiance in the unit direction d is
 * below + (above - below) (1 + h / sqrt(h^2 + bend^2)) / 2 with h = d.y - level; a surface with normal n
 * gets pi (ambient + n.y tilt) of irradiance from it. */
typedef struct shade_picture {
    int32_t width, height;
    int32_t samples; /* per pixel, >= 1; one: the pixel's centre */
    uint32_t seed;
    double eye[3], corner[3], right[3], down[3];
    double above[3], below[3], level, bend;
    double shown[3]; /* where `plain`: what camera rays see of the background */
    double ambient[3], tilt[3];
    double fill; /* share of the background's radiance that lights rough surfaces, see picture.py */
    int32_t light_count;
    int32_t painted;     /* some surface has more than one material */
    int32_t transparent; /* some material transmits: shadows are looked through */
    int32_t plain;       /* the background is one colour to the eye */
    const shade_light *lights;
    const double *materials; /* rows of BLOB_MATERIAL */
    const int32_t *surface_material;
    const double *thresholds; /* of the surfaces */
} shade_picture;

/* Layers of the rays through the pixel centres, one entry a pixel (normal and position: 3), row by row
 * of the tile. Any pointer may be NULL. depth: distance from the eye, +inf on a miss; normal and
 * position: NaN on a miss; surface: -1 on a miss. */
typedef struct shade_layers {
    float *depth, *normal, *position;
    int32_t *surface, *evaluations, *nodes, *candidates, *spans, *sandwiches, *fallbacks;
} shade_layers;

BLOB_API int32_t shade_abi(void);

/* The pixels [x0, x1) x [y0, y1) of a picture. rgba: 4 floats a pixel, row by row; layers may be NULL.
 * BLOB_OK, BLOB_NO_MEMORY, BLOB_BAD_ARGUMENT, BLOB_CANCELLED, or what the tracer refused. */
BLOB_API blob_status shade_tile(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                const shade_picture *picture, int32_t x0, int32_t y0, int32_t x1, int32_t y1,
                                float *rgba, const shade_layers *layers);

/* Where the n samples of pixel (x, y) lie in it: x, y in [0, 1), 2n numbers. */
BLOB_API void shade_pattern(uint32_t x, uint32_t y, uint32_t seed, int32_t n, double *places);

#ifdef __cplusplus
}
#endif
#endif
