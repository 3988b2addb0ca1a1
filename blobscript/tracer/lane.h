/* lane.h - LANES numbers at a time, as GCC and Clang vector types: the same source for every instruction
 * set. Loops over lanes (LANE_LOOP, LANE_SIMD) do for formulas that compilers vectorise by themselves; where
 * they do not, as in steps full of decisions, these types say it outright. A mask has all bits set or none. */
#ifndef BLOB_LANE_H
#define BLOB_LANE_H

#include <math.h>
#include <stdint.h>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

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
/* The second where either is NaN. */
LANE_INLINE lane_real lane_min(lane_real a, lane_real b) {
#if defined(__AVX512DQ__)
    return (lane_real)_mm512_min_pd((__m512d)a, (__m512d)b);
#else
    return lane_select(a < b, a, b);
#endif
}
LANE_INLINE lane_real lane_max(lane_real a, lane_real b) {
#if defined(__AVX512DQ__)
    return (lane_real)_mm512_max_pd((__m512d)a, (__m512d)b);
#else
    return lane_select(a > b, a, b);
#endif
}
/* a b + c, rounded once where the processor can. */
LANE_INLINE lane_real lane_fma(lane_real a, lane_real b, lane_real c) {
#if defined(__AVX512DQ__)
    return (lane_real)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c);
#else
    return a * b + c;
#endif
}
LANE_INLINE lane_real lane_abs(lane_real a) { return (lane_real)((lane_mask)a & ~(lane_mask)lane_all(-0.0)); }
LANE_INLINE lane_real lane_sqrt(lane_real a) {
    lane_real r;
    for (int l = 0; l < LANES; l++) r[l] = sqrt(a[l]);
    return r;
}
LANE_INLINE int lane_any(lane_mask m) {
#if defined(__AVX512DQ__)
    return _mm512_movepi64_mask((__m512i)m) != 0;
#else
    return (m[0] | m[1] | m[2] | m[3] | m[4] | m[5] | m[6] | m[7]) != 0;
#endif
}

/* The same in one bit per lane where the processor has registers for that: a lane_mask there costs a conversion at
 * each decision. */
#if defined(__AVX512DQ__)
typedef __mmask8 lane_bits;
LANE_INLINE lane_bits lane_less(lane_real a, lane_real b) {
    return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_LT_OQ);
}
LANE_INLINE lane_bits lane_at_most(lane_real a, lane_real b) {
    return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_LE_OQ);
}
LANE_INLINE lane_real lane_pick(lane_bits m, lane_real yes, lane_real no) {
    return (lane_real)_mm512_mask_blend_pd(m, (__m512d)no, (__m512d)yes);
}
LANE_INLINE lane_bits lane_bits_of(lane_mask m) { return _mm512_movepi64_mask((__m512i)m); }
LANE_INLINE lane_mask lane_mask_of(lane_bits m) { return (lane_mask)_mm512_movm_epi64(m); }
LANE_INLINE int lane_some(lane_bits m) { return m != 0; }
#else
typedef lane_mask lane_bits;
LANE_INLINE lane_bits lane_less(lane_real a, lane_real b) { return a < b; }
LANE_INLINE lane_bits lane_at_most(lane_real a, lane_real b) { return a <= b; }
LANE_INLINE lane_real lane_pick(lane_bits m, lane_real yes, lane_real no) { return lane_select(m, yes, no); }
LANE_INLINE lane_bits lane_bits_of(lane_mask m) { return m; }
LANE_INLINE lane_mask lane_mask_of(lane_bits m) { return m; }
LANE_INLINE int lane_some(lane_bits m) { return lane_any(m); }
#endif
LANE_INLINE lane_bits lane_both(lane_bits a, lane_bits b) { return (lane_bits)(a & b); }
LANE_INLINE lane_bits lane_either(lane_bits a, lane_bits b) { return (lane_bits)(a | b); }
LANE_INLINE lane_bits lane_without(lane_bits a, lane_bits b) { return (lane_bits)(a & ~b); }

#endif
