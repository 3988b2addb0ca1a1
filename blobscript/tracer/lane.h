/* lane.h - LANES numbers at a time, as GCC and Clang vector types: the same source for every instruction
 * set. Loops over lanes (LANE_LOOP, LANE_SIMD) do for formulas that compilers vectorise by themselves; where
 * they do not, as in steps full of decisions, these types say it outright. A mask has all bits set or none. */
#ifndef BLOB_LANE_H
#define BLOB_LANE_H

#include <math.h>
#include <stdint.h>

enum { LANES = 8 };
#define LANE_INLINE static inline __attribute__((always_inline))
#define LANE_ALIGN _Alignas(64)

/* LANE_SIMD: lanes independent of each other. LANE_LOOP: reductions, and what is rare. */
#define LANE_LOOP(l) for (int l = 0; l < LANES; l++)
#define LANE_SIMD(l) _Pragma("omp simd") LANE_LOOP(l)

/* A mask in memory, one per lane: 0 or -1. */
typedef int64_t lane_flag;

typedef double lane_real __attribute__((vector_size(64), aligned(64), may_alias));
typedef int64_t lane_mask __attribute__((vector_size(64), aligned(64), may_alias));

LANE_INLINE lane_real lane_load(const double *p) { return *(const lane_real *)p; }
LANE_INLINE void lane_store(double *p, lane_real v) { *(lane_real *)p = v; }
LANE_INLINE lane_mask lane_load_mask(const lane_flag *p) { return *(const lane_mask *)p; }
LANE_INLINE void lane_store_mask(lane_flag *p, lane_mask v) { *(lane_mask *)p = v; }
LANE_INLINE lane_real lane_all(double x) { return (lane_real){x, x, x, x, x, x, x, x}; }

LANE_INLINE lane_real lane_select(lane_mask m, lane_real yes, lane_real no) {
    return (lane_real)((m & (lane_mask)yes) | (~m & (lane_mask)no));
}
LANE_INLINE lane_real lane_min(lane_real a, lane_real b) { return lane_select(a < b, a, b); }
LANE_INLINE lane_real lane_max(lane_real a, lane_real b) { return lane_select(a > b, a, b); }
LANE_INLINE lane_real lane_abs(lane_real a) { return (lane_real)((lane_mask)a & ~(lane_mask)lane_all(-0.0)); }
LANE_INLINE lane_real lane_sqrt(lane_real a) {
    lane_real r;
    for (int l = 0; l < LANES; l++) r[l] = sqrt(a[l]);
    return r;
}
LANE_INLINE int lane_any(lane_mask m) { return (m[0] | m[1] | m[2] | m[3] | m[4] | m[5] | m[6] | m[7]) != 0; }

#endif
