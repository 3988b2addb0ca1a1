/* trace.c - the queries of blob.h: rays in blocks, points in packets, with the instruction set of the machine. */
#include <math.h>
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

#define TRACE_ISA(NAME, SUFFIX)                                                                                        \
    {                                                                                                                  \
        NAME, engine_scratch_new_##SUFFIX, engine_scratch_free_##SUFFIX, engine_trace_##SUFFIX, engine_field_##SUFFIX, \
            engine_paint_##SUFFIX                                                                                      \
    }

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

/* Normals by differences of the field, for teaching: forward (F(P + h e) - F(P)) / h or central
 * (F(P + h e) - F(P - h e)) / 2h. The default steps are the best of numerics: 1e-8 and 1e-6 reaches. */
static blob_status trace_differences(const trace_isa *isa, const blob_scene *scene, const blob_index *index,
                                     const blob_query *query, engine_scratch *scratch, const engine_block *block) {
    const int central = query->normals == BLOB_NORMALS_CENTRAL;
    const blob_hits *hits = block->hits;
    for (size_t i = 0; i < block->count; i++) {
        if (hits->surface[i] < 0) continue;
        const double reach = index->trees[hits->surface[i]].typical_reach / scene->scale;
        const double h = query->normal_step > 0.0 ? query->normal_step : reach * (central ? 1e-6 : 1e-8);
        const double *o = block->origins + 3 * i, *d = block->directions + 3 * i;
        const double largest = fmax(fmax(fabs(d[0]), fabs(d[1])), fabs(d[2]));
        const double u[3] = {d[0] / largest, d[1] / largest, d[2] / largest};
        const double length = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        double points[7][3], value[7], gradient[3], size = 0.0;
        for (int p = 0; p < 7; p++)
            for (int k = 0; k < 3; k++)
                points[p][k] = o[k] + hits->t[i] * (u[k] / length) + (p == k ? h : central && p == k + 3 ? -h : 0.0);
        const blob_status status = isa->field(scene, index, scratch, hits->surface[i], points[0], 7, value, NULL);
        if (status) return status;
        for (int k = 0; k < 3; k++) {
            gradient[k] = value[k] - value[central ? k + 3 : 6];
            size += gradient[k] * gradient[k];
        }
        for (int k = 0; k < 3; k++) hits->normal[3 * i + (size_t)k] = -gradient[k] / sqrt(size);
        if (hits->evaluations) hits->evaluations[i] += central ? 6 : 4;
    }
    return BLOB_OK;
}

/* Is there such a search, with such options? A step belongs to march alone. */
static int trace_has(const blob_query *query) {
    if (query->search < BLOB_SEARCH_SANDWICH || query->search > BLOB_SEARCH_MARCH) return 0;
    if (!isfinite(query->tolerance) || query->tolerance < 0.0) return 0;
    return query->step == 0.0 || (query->search == BLOB_SEARCH_MARCH && isfinite(query->step) && query->step > 0.0);
}

static blob_status trace_all(const blob_scene *scene, const blob_index *index, const blob_query *query, size_t n,
                             const double *origins, const double *directions, const double *t_min, const double *t_max,
                             const blob_hits *hits, uint8_t *any) {
    if (!scene || !index || !query || (n && (!origins || !directions || !t_min || !t_max))) return BLOB_BAD_ARGUMENT;
    if (!trace_has(query)) return BLOB_BAD_ARGUMENT;
    if (query->normals < BLOB_NORMALS_ANALYTIC || query->normals > BLOB_NORMALS_CENTRAL) return BLOB_BAD_ARGUMENT;
    if (hits && query->normals != BLOB_NORMALS_ANALYTIC && (!hits->surface || !hits->t)) return BLOB_BAD_ARGUMENT;
    const trace_isa *isa = trace_pick();
    engine_scratch *scratch = isa->scratch_new();
    if (!scratch) return BLOB_NO_MEMORY;
    blob_status status = BLOB_OK;
    for (size_t i = 0; i < n && status == BLOB_OK; i += ENGINE_RAYS) {
        const size_t count = n - i < ENGINE_RAYS ? n - i : ENGINE_RAYS;
        engine_block block = {count, origins + 3 * i, directions + 3 * i, t_min + i, t_max + i, NULL,
                              NULL,  n - i - count};
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
        if (status == BLOB_OK && hits && hits->normal && query->normals != BLOB_NORMALS_ANALYTIC)
            status = trace_differences(isa, scene, index, query, scratch, &block);
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
