/* engine.h - what trace.c calls once per block of rays; one copy per instruction set. */
#ifndef BLOB_ENGINE_H
#define BLOB_ENGINE_H

#include "index.h"

/* A block of at most ENGINE_RAYS consecutive rays. */
enum { ENGINE_RAYS = 256 };

typedef struct engine_block {
    size_t count;
    const double *origins, *directions; /* 3 * count */
    const double *t_min, *t_max;        /* count */
    const blob_hits *hits;              /* outputs, already offset to the first ray; NULL for any_hit */
    uint8_t *any;                       /* any_hit only */
    size_t next;                        /* rays that follow those of the block in origins and directions */
} engine_block;

typedef struct engine_scratch engine_scratch;

/* Rays of a block by columns. Packed coordinates, but for `end`. */
typedef double engine_column[ENGINE_RAYS] __attribute__((aligned(64)));

/* What rays from one place hit: side is 1 seen from outside, -1 from inside, 0 for none; what is not hit has
 * neither place nor normal. Normals are unit vectors, NaN where the gradient vanishes. */
typedef struct engine_sight {
    size_t hits;
    engine_column side, place[3], normal[3];
    int32_t surface[ENGINE_RAYS];
} engine_sight;

/* Rays (0, end] that leave surfaces where something was seen. dark: 1 where one hits something; ENGINE_UNSURE where
 * the start is not told from the surface, or is on one that is not searched by teams. */
enum { ENGINE_UNSURE = 2 };
typedef struct engine_leaving {
    size_t count;
    engine_column place[3], way[3], end;
    int32_t surface[ENGINE_RAYS];
    uint8_t dark[ENGINE_RAYS];
} engine_leaving;

#define ENGINE_DECLARE(ISA)                                                                                            \
    engine_scratch *engine_scratch_new_##ISA(void);                                                                    \
    void engine_scratch_free_##ISA(engine_scratch *scratch);                                                           \
    blob_status engine_trace_##ISA(const blob_scene *scene, const blob_index *index, const blob_query *query,          \
                                   engine_scratch *scratch, const engine_block *block);                                \
    blob_status engine_field_##ISA(const blob_scene *scene, const blob_index *index, engine_scratch *scratch,          \
                                   int32_t surface, const double *points, size_t n, double *field, double *gradient);  \
    blob_status engine_paint_##ISA(const blob_scene *scene, const blob_index *index, engine_scratch *scratch,          \
                                   size_t n, const double *points, const int32_t *surface, const double *materials,    \
                                   double *out);                                                                       \
    blob_status engine_look_##ISA(const blob_scene *scene, const blob_index *index, const blob_query *query,           \
                                  engine_scratch *scratch, const double *eye, size_t n, engine_column *ways,           \
                                  engine_sight *sight);                                                                \
    blob_status engine_leave_##ISA(const blob_scene *scene, const blob_index *index, const blob_query *query,          \
                                   engine_scratch *scratch, engine_leaving *leaving);

ENGINE_DECLARE(baseline)
#ifdef BLOB_X86
ENGINE_DECLARE(v3)
ENGINE_DECLARE(v4)
#endif

#endif
