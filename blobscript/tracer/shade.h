/* shade.h - from first hits to light: tiles of a picture, and its layers.
 *
 * Uses the public calls of blob.h only. No state: the caller owns every buffer; scratch memory is
 * allocated for a call and freed by it. A tile's result depends on its own pixels alone, so tiles
 * may be made in any order and on any threads; corners at multiples of 16 keep the blocks of rays,
 * and with them every last bit, the same however a picture is cut into tiles.
 *
 * The light model: suns and lamps; the sky; materials as in brdf.h; mirror images in metals and
 * mirrors, refraction with absorption in transparent materials, both up to SHADE_DEPTH bounces. How
 * the light that comes from everywhere is found is a choice, shade_picture.indirect:
 *
 *   EVEN       the sky shines everywhere alike, lamps are points, nothing is left to chance: for one
 *              sample a pixel.
 *   OCCLUSION  each sample follows one ray for it, which is dark where it hits something; lamps and
 *              suns have their sizes, rough mirrors and glass are rough.
 *   BOUNCE     that ray brings back the light of what it hits, where the lights are followed and
 *              the rest is even: one bounce of indirect light.
 *
 * Light is linear RGB.
 */
#ifndef BLOB_SHADE_H
#define BLOB_SHADE_H

#include "blob.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bumped whenever a struct below changes; backends/picture.py must agree. */
#define SHADE_ABI 3

/* Bounces of mirror images and refraction; what is left then sees the background. */
#define SHADE_DEPTH 8

/* ORDER LIGHTS, SKIES, INDIRECT, FLOORS, CURVES: the same orders in backends/picture.py. */
enum { SHADE_SUN, SHADE_LAMP };
enum { SHADE_GRADIENT, SHADE_COLORS, SHADE_IMAGE };
enum { SHADE_EVEN, SHADE_OCCLUSION, SHADE_BOUNCE };
enum { SHADE_NO_FLOOR, SHADE_SOLID, SHADE_CATCH };
enum { SHADE_LINEAR, SHADE_FILM };

typedef struct shade_light {
    int32_t kind; /* SHADE_* */
    int32_t reserved;
    double place[3]; /* SUN: unit vector to it; LAMP: where it is */
    double color[3]; /* SUN: irradiance; LAMP: irradiance at distance 1 */
    double size;     /* SUN: 1 - cos of half its angle; LAMP: radius */
} shade_light;

/* Radiance by direction d, a unit vector.
 * GRADIENT: below + (above - below) (1 + h / sqrt(h^2 + bend^2)) / 2 with h = d.y - level.
 * COLORS: from horizon to above as 1 - (1 - d.y)^3; below the horizon within a few degrees to below.
 * IMAGE: rows of latitude from the zenith, the middle column towards -z after turning.
 * A surface with normal n gets pi (ambient + tilt n) of irradiance from all of it. */
typedef struct shade_sky {
    int32_t kind, width, height;
    int32_t table_width, table_height; /* of the cells by which an IMAGE is sampled */
    int32_t reserved;
    double above[3], below[3], horizon[3], level, bend;
    double turn[2]; /* cosine and sine */
    double ambient[3], tilt[9];
    double fill;           /* share of it that lights rough surfaces, see picture.py */
    const float *pixels;   /* IMAGE: 3 width height */
    const double *rows;    /* cumulative share of the light, table_height + 1 numbers from 0 to 1 */
    const double *columns; /* the same within each row, table_width + 1 numbers each */
} shade_sky;

/* A program that gives parts of a material by place: ir.Texture. */
enum { SHADE_INSTRUCTION = 6, SHADE_BUMP = 15 };
typedef struct shade_texture {
    int32_t constant_begin, constant_count; /* in shade_picture.constants */
    int32_t code_begin, code_count;         /* rows of .code */
    int32_t output_begin, output_count;     /* rows of .outputs */
    int32_t mapped;                         /* places go through the matrix first */
    int32_t reserved;
    double matrix[12];
} shade_texture;

/* A picture. The view direction of the point (x, y), in pixels from the top left corner, is
 * corner + x right + y down; corner's part along the view has length 1. */
typedef struct shade_picture {
    int32_t width, height;
    int32_t samples; /* per pixel at most, >= 1; one: the pixel's centre */
    int32_t least;   /* per pixel at least, a power of two; `samples` where noise is 0 */
    double noise;    /* goal for the error of a pixel as shown, white is 1; 0: take all samples */
    uint32_t seed;
    int32_t indirect; /* SHADE_EVEN, ... */
    double eye[3], corner[3], right[3], down[3];
    double lens[6]; /* radius times the lens's axes; sharp is what lies at `focus` along the view */
    double focus;
    double shown[3]; /* where `plain`: what camera rays see of the sky */
    double exposure; /* factor, and ... */
    int32_t curve;   /* ... SHADE_LINEAR or SHADE_FILM: for what an error looks like */
    int32_t light_count;
    int32_t painted;     /* some surface has more than one material */
    int32_t transparent; /* some material transmits: shadows are looked through */
    int32_t plain;       /* the sky is one colour to the eye */
    int32_t floor;       /* SHADE_NO_FLOOR, ... */
    int32_t floor_material;
    int32_t material_count;
    int32_t texture_count;
    int32_t mark_count; /* groups of BLOB_MATERIAL textured materials */
    int32_t clear;      /* camera rays do not see the sky: alpha is what hides it, the shadows of a CATCH floor too */
    int32_t reserved;
    double floor_height;  /* y */
    double floor_fade[3]; /* x and z of a point, and the distance from there where the floor has gone; 0: never */
    double fog[4];        /* 1 / distance, 0 for none, and color */
    shade_sky sky;
    const shade_light *lights;
    const double *materials; /* rows of BLOB_MATERIAL; 0 where a texture tells */
    const int32_t *surface_material;
    const double *thresholds;      /* of the surfaces */
    const shade_texture *textures; /* NULL: none */
    const double *constants;       /* of all textures */
    const int32_t *code;           /* rows of SHADE_INSTRUCTION: operation, registers */
    const int32_t *outputs;        /* pairs: column of the material's row or SHADE_BUMP, register */
    const double *marks;           /* by group, row of a material: 1 in the column of its texture, if it has one */
} shade_picture;

/* Layers, row by row of the tile. Any pointer may be NULL. From rays through the pixel centres: depth,
 * distance from the eye, +inf on a miss; normal and position, 3 numbers, NaN on a miss; surface, -1 on a
 * miss and on the floor; albedo, 3, the colour of what is hit; the counters of blob_hits. From the
 * samples: direct, 3, light that came straight or by way of one surface; indirect, 3, all other light; samples. */
typedef struct shade_layers {
    float *depth, *normal, *position;
    int32_t *surface, *evaluations, *nodes, *candidates, *spans, *sandwiches, *fallbacks;
    float *albedo, *direct, *indirect;
    int32_t *samples;
} shade_layers;

BLOB_API int32_t shade_abi(void);

/* The pixels [x0, x1) x [y0, y1) of a picture. rgba: 4 floats a pixel, row by row, alpha multiplied into the colours;
 * layers may be NULL. seconds: NULL, or processor time is added: of the tracer's queries, and of all. BLOB_OK,
 * BLOB_NO_MEMORY, BLOB_BAD_ARGUMENT, BLOB_CANCELLED, or what the tracer refused. */
BLOB_API blob_status shade_tile(const blob_scene *scene, const blob_index *index, const blob_query *query,
                                const shade_picture *picture, int32_t x0, int32_t y0, int32_t x1, int32_t y1,
                                float *rgba, const shade_layers *layers, double *seconds);

/* Where the n samples of pixel (x, y) lie in it: x, y in [0, 1), 2n numbers. */
BLOB_API void shade_pattern(uint32_t x, uint32_t y, uint32_t seed, int32_t n, double *places);

/* The outputs of a texture at n places: output_count numbers each. */
BLOB_API void shade_evaluate(const shade_picture *picture, int32_t texture, size_t n, const double *places,
                             double *out);

/* For tests, the parts of brdf.h. material: a row of BLOB_MATERIAL. For n pairs of unit vectors to the eye and
 * the light in the frame whose z is the normal, 3 numbers each: diffuse and specular, response times cosine, 6. */
BLOB_API void shade_respond(const double *material, size_t n, const double *eyes, const double *lights, double *out);

/* n directions of the specular lobe seen from `eye`, as drawn from pairs of numbers in [0, 1): 3 numbers, then
 * their density, then the weight of what comes from there (3), so 7. Weight 0: below the surface. */
BLOB_API void shade_lobe(const double *material, const double *eye, size_t n, const double *numbers, double *out);

/* Radiance of the sky in n directions, 3 numbers, and the density with which shade_sky_draw draws them. */
BLOB_API void shade_sky_look(const shade_sky *sky, size_t n, const double *directions, double *out);
BLOB_API void shade_sky_draw(const shade_sky *sky, size_t n, const double *numbers, double *directions);

#ifdef __cplusplus
}
#endif
#endif
