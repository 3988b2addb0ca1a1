/* blob.h - the public face of the blobscript tracer.
 *
 * A scene is read-only data owned by the caller: arrays packed by blobscript/pack.py (or constant
 * data in an emitted C scene). The library holds no state, never prints, never exits, starts no
 * thread; every function is pure in its inputs and writes only to the buffers it is given. Calls on
 * one scene from several threads at once are fine.
 *
 * Conventions: inside is field >= threshold; the normal is -gradient/|gradient|, never flipped; t is
 * a distance along the normalised direction; all vectors are x, y, z triples of doubles. Points and
 * rays are given in scene units; `blob_scene.center` and `.scale` say how they map to the packed
 * coordinates (p_packed = (p - center) * scale, scale a power of two).
 */
#ifndef BLOB_H
#define BLOB_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define BLOB_API __declspec(dllexport)
#else
#define BLOB_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Bumped whenever a struct below changes; pack.py and the library must agree. */
#define BLOB_ABI 3

typedef enum blob_status {
    BLOB_OK = 0,
    BLOB_NO_MEMORY = 1,
    BLOB_BAD_SCENE = 2, /* blob_check found the packed scene inconsistent */
    BLOB_BAD_ARGUMENT = 3,
    BLOB_CANCELLED = 4, /* *cancel became non-zero; outputs are incomplete */
    BLOB_TOO_LARGE = 5  /* a mesh would need more memory than the plan allows */
} blob_status;

/* Status of a ray, hits.status. */
enum { BLOB_MISS = 0, BLOB_ENTER = 1, BLOB_EXIT = 2, BLOB_GRAZE = 3, BLOB_INVALID = 4 };

enum {
    BLOB_SEARCH_SANDWICH,
    BLOB_SEARCH_BERNSTEIN,
    BLOB_SEARCH_INTERVAL,
    BLOB_SEARCH_SEGMENT,
    BLOB_SEARCH_SPHERE,
    BLOB_SEARCH_MARCH
};
enum { BLOB_INDEX_BVH, BLOB_INDEX_GRID, BLOB_INDEX_OCTREE, BLOB_INDEX_BSP, BLOB_INDEX_NONE };
enum { BLOB_NORMALS_ANALYTIC, BLOB_NORMALS_FORWARD, BLOB_NORMALS_CENTRAL };

typedef struct blob_scene blob_scene; /* see scene.h */
typedef struct blob_index blob_index; /* see index.h */

/* How to search; lengths in scene units. Zero in tolerance, step and normal_step means the default (strategy.h,
 * trace.c); a step for another search than MARCH is refused. */
typedef struct blob_query {
    int32_t search, normals;
    double tolerance, step, normal_step;
    const volatile int32_t *cancel; /* may be NULL */
} blob_query;

/* Where the answers go: n entries each (normal: 3n). Every pointer but status may be NULL. */
typedef struct blob_hits {
    int8_t *status;
    double *t;            /* +inf unless ENTER or EXIT */
    double *normal;       /* NaN unless ENTER or EXIT */
    int32_t *surface;     /* -1 unless ENTER or EXIT */
    int32_t *evaluations; /* point evaluations of the field plus bound evaluations over an interval */
    /* counters: nodes of the index opened and elements looked at for the ray and those beside it; stretches of its way
     * searched; quadratics taken; steps that another search took over */
    int32_t *nodes, *candidates, *spans, *sandwiches, *fallbacks;
} blob_hits;

BLOB_API int32_t blob_abi(void);
/* Name of the instruction set in use: "x86-64-v4", "x86-64-v3", "baseline", ... */
BLOB_API const char *blob_isa(void);

/* Refuses what the tracer could trip over: indices out of range, non-finite numbers, reach <= 0, ... */
BLOB_API blob_status blob_check(const blob_scene *scene);

/* The caller frees the index; it refers to the scene, which must outlive it. kind: BLOB_INDEX_*. */
BLOB_API blob_status blob_index_build(const blob_scene *scene, int32_t kind, blob_index **index);
BLOB_API void blob_index_free(blob_index *index);
BLOB_API size_t blob_index_bytes(const blob_index *index);

/* First crossing in (t_min, t_max] of each ray. origins, directions: 3n; t_min, t_max: n. */
BLOB_API blob_status blob_first_hit(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                                    const double *origins, const double *directions, const double *t_min,
                                    const double *t_max, const blob_hits *hits);

/* hit[i] = 1 if there is a crossing of any surface in (t_min, t_max]. */
BLOB_API blob_status blob_any_hit(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                                  const double *origins, const double *directions, const double *t_min,
                                  const double *t_max, uint8_t *hit);

/* Field of one surface (not minus threshold) and, where not NULL, its gradient (3n). */
BLOB_API blob_status blob_field(const blob_scene *scene, const blob_index *index, int32_t surface, size_t n,
                                const double *points, double *field, double *gradient);

/* Materials blended at points on surfaces: sum blends by positive contribution, max and min take the
 * winner's. materials: m rows of BLOB_MATERIAL doubles (color 3, roughness, metalness, specular,
 * transmission, ior, absorption 3, emission 3, reflection); out: n such rows. surface[i] < 0: row of 0. */
enum { BLOB_MATERIAL = 15 };
BLOB_API blob_status blob_paint(const blob_scene *scene, const blob_index *index, size_t n, const double *points,
                                const int32_t *surface, const double *materials, double *out);

/* ---- triangles (mesh.h) ------------------------------------------------------------------------------------ */

typedef struct blob_mesher blob_mesher;

/* What to mesh, in scene units. The grid starts at `lo`; cells of size `cell` may be halved `levels` times, where
 * they could hide something, or where the error is larger than `tolerance` (0: not for that). */
typedef struct blob_mesh_plan {
    int32_t surface, levels, clip, reserved;
    double lo[3], cell[3];
    int32_t cells[3], reserved2;
    double clip_lo[3], clip_hi[3]; /* clip: the solid is cut to this box */
    double tolerance;
    uint64_t byte_limit;            /* of bricks of cells; 0: none */
    const volatile int32_t *cancel; /* may be NULL */
} blob_mesh_plan;

typedef struct blob_mesh_counts {
    uint64_t vertices, triangles;
    uint64_t visited, bricks, refined; /* boxes that bounds were taken of; bricks left; of those with smaller cells */
    uint64_t cells, undecided, hidden; /* not proved empty; of those without a crossing; that may hide something */
    uint64_t queued;                   /* bricks in this round */
    double error;                      /* largest distance seen between a triangle and the surface */
    double lo[3], hi[3];               /* box around all bricks: the surface lies within; lo > hi: there is none */
} blob_mesh_counts;

/* Box around the elements of a surface, beyond which its field is 0. */
BLOB_API blob_status blob_mesh_extent(const blob_scene *scene, const blob_index *index, int32_t surface, double *lo,
                                      double *hi);

/* The caller frees the mesher; it refers to scene and index, not to the plan, but to plan->cancel. Then: work (by any
 * number of threads at once), refine, and again as long as there is more; finish, count, write (any number of threads,
 * once). The mesh does not depend on the number of threads. */
BLOB_API blob_status blob_mesher_new(const blob_scene *scene, const blob_index *index, const blob_mesh_plan *plan,
                                     blob_mesher **mesher);
BLOB_API void blob_mesher_free(blob_mesher *mesher);
BLOB_API blob_status blob_mesher_work(blob_mesher *mesher);
BLOB_API size_t blob_mesher_done(blob_mesher *mesher); /* bricks of this round, at any time */
BLOB_API blob_status blob_mesher_refine(blob_mesher *mesher, int32_t *more);
BLOB_API blob_status blob_mesher_finish(blob_mesher *mesher);
BLOB_API blob_status blob_mesher_count(blob_mesher *mesher, blob_mesh_counts *counts);
/* Middles of up to `room` bricks with cells that may hide something. Returns how many. */
BLOB_API size_t blob_mesher_hidden(const blob_mesher *mesher, size_t room, double *places);
/* vertices, normals (unit, out of the inside): 3 each per vertex; triangles: 3, counter-clockwise from outside. */
BLOB_API blob_status blob_mesher_write(blob_mesher *mesher, double *vertices, double *normals, int64_t *triangles);

#ifdef __cplusplus
}
#endif
#endif
