/* trace.c - the queries of blob.h: rays in blocks, points in packets, with the instruction set of the machine. */
#include <stdlib.h>
#include <string.h>

#include "engine.h"

typedef struct trace_isa {
    const char *name;
    engine_scratch *(*scratch_new)(void);
    void (*scratch_free)(engine_scratch *scratch);
    blob_status (*trace)(const blob_scene *scene, const blob_index *index, const blob_query *query,
                         engine_scratch *scratch, const engine_block *block);
    blob_status (*field)(const blob_scene *scene, const blob_index *index, engine_scratch *scratch, int32_t surface,
                         const double *points, size_t n, double *field, double *gradient);
    blob_status (*paint)(const blob_scene *scene, const blob_index *index, engine_scratch *scratch, size_t n,
                         const double *points, const int32_t *surface, const double *materials, double *out);
} trace_isa;

#define TRACE_ISA(NAME, SUFFIX)                                                                               \
    {NAME, engine_scratch_new_##SUFFIX, engine_scratch_free_##SUFFIX, engine_trace_##SUFFIX,                  \
     engine_field_##SUFFIX, engine_paint_##SUFFIX}

static const trace_isa TRACE_BASELINE = TRACE_ISA("baseline", baseline);
#ifdef BLOB_X86
static const trace_isa TRACE_V3 = TRACE_ISA("x86-64-v3", v3);
static const trace_isa TRACE_V4 = TRACE_ISA("x86-64-v4", v4);
#endif

/* The best set that the processor has and that BLOBSCRIPT_ISA (a name as above) does not exclude. */
static const trace_isa *trace_pick(void) {
#ifdef BLOB_X86
    const char *wanted = getenv("BLOBSCRIPT_ISA");
    const int most = !wanted ? 4 : strcmp(wanted, "baseline") == 0 ? 0 : strcmp(wanted, "x86-64-v3") == 0 ? 3 : 4;
    __builtin_cpu_init();
    const int v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    const int v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
                   __builtin_cpu_supports("avx512cd");
    if (v4 && most >= 4) return &TRACE_V4;
    if (v3 && most >= 3) return &TRACE_V3;
#endif
    return &TRACE_BASELINE;
}

BLOB_API int32_t blob_abi(void) { return BLOB_ABI; }
BLOB_API const char *blob_isa(void) { return trace_pick()->name; }

static blob_status trace_all(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                             const double *origins, const double *directions, const double *t_min, const double *t_max,
                             const blob_hits *hits, uint8_t *any) {
    if (!scene || !index || !query || (n && (!origins || !directions || !t_min || !t_max))) return BLOB_BAD_ARGUMENT;
    if (query->search < BLOB_SEARCH_SANDWICH || query->search > BLOB_SEARCH_MARCH) return BLOB_BAD_ARGUMENT;
    const trace_isa *isa = trace_pick();
    engine_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    blob_status status = BLOB_OK;
    for (size_t i = 0; i < n && status == BLOB_OK; i += ENGINE_RAYS) {
        const size_t count = n - i < ENGINE_RAYS ? n - i : ENGINE_RAYS;
        engine_block block = {count, origins + 3 * i, directions + 3 * i, t_min + i, t_max + i, NULL, NULL};
        blob_hits part;
        if (hits) {
            part = (blob_hits){hits->status + i,
                               hits->t ? hits->t + i : NULL,
                               hits->normal ? hits->normal + 3 * i : NULL,
                               hits->surface ? hits->surface + i : NULL,
                               hits->evaluations ? hits->evaluations + i : NULL,
                               hits->nodes ? hits->nodes + i : NULL,
                               hits->candidates ? hits->candidates + i : NULL,
                               hits->spans ? hits->spans + i : NULL,
                               hits->sandwiches ? hits->sandwiches + i : NULL,
                               hits->fallbacks ? hits->fallbacks + i : NULL};
            block.hits = &part;
        } else {
            block.any = any + i;
        }
        status = isa->trace(scene, index, query, scratch, &block);
    }
    isa->scratch_free(scratch);
    return status;
}

BLOB_API blob_status blob_first_hit(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                                    const double *origins, const double *directions, const double *t_min,
                                    const double *t_max, const blob_hits *hits) {
    if (!hits || (n && !hits->status)) return BLOB_BAD_ARGUMENT;
    return trace_all(scene, index, query, n, origins, directions, t_min, t_max, hits, NULL);
}

BLOB_API blob_status blob_any_hit(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                                  const double *origins, const double *directions, const double *t_min,
                                  const double *t_max, uint8_t *hit) {
    if (n && !hit) return BLOB_BAD_ARGUMENT;
    return trace_all(scene, index, query, n, origins, directions, t_min, t_max, NULL, hit);
}

BLOB_API blob_status blob_field(const blob_scene *scene, const blob_index *index, int32_t surface, size_t n,
                                const double *points, double *field, double *gradient) {
    if (!scene || !index || (n && (!points || !field))) return BLOB_BAD_ARGUMENT;
    if (surface < 0 || surface >= scene->surface_count) return BLOB_BAD_ARGUMENT;
    const trace_isa *isa = trace_pick();
    engine_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    const blob_status status = isa->field(scene, index, scratch, surface, points, n, field, gradient);
    isa->scratch_free(scratch);
    return status;
}

BLOB_API blob_status blob_paint(const blob_scene *scene, const blob_index *index, size_t n, const double *points,
                                const int32_t *surface, const double *materials, double *out) {
    if (!scene || !index || (n && (!points || !surface || !materials || !out))) return BLOB_BAD_ARGUMENT;
    const trace_isa *isa = trace_pick();
    engine_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    const blob_status status = isa->paint(scene, index, scratch, n, points, surface, materials, out);
    isa->scratch_free(scratch);
    return status;
}
