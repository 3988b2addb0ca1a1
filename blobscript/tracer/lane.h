/* lane.h - LANES numbers at a time, as GCC and Clang vector types: the same source for every instruction
 * set. Loops over lanes (LANE_LOOP, LANE_SIMD) do for formulas that compilers vectorise by themselves; where
 * they do not, as in steps full of decisions, these types say it outright. A mask has all bits set or none. */
#ifndef BLOB_LANE_H
#define BLOB_LANE_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
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
/* From any place. */
LANE_INLINE lane_real lane_load_any(const double *p) {
    lane_real v;
    memcpy(&v, p, sizeof v);
    return v;
}
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
/* v / |v| for v other than 0, however long: brought to a largest component in [1, 2) by a power of two. */
LANE_INLINE void lane_normalise(lane_real *v) {
    const lane_real largest = lane_max(lane_max(lane_abs(v[0]), lane_abs(v[1])), lane_abs(v[2]));
    const lane_mask power = (lane_mask)largest & INT64_C(0x7ff0000000000000);
    const lane_real scale = lane_max((lane_real)(INT64_C(0x7fe0000000000000) - power), lane_all(DBL_MIN));
    for (int k = 0; k < 3; k++) v[k] *= scale;
    const lane_real length = lane_sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
#if defined(__AVX512DQ__)
    const lane_real inverse = 1.0 / length; /* quotients by one division: v / length is q + (v - q length) / length */
    for (int k = 0; k < 3; k++) {
        const lane_real q = v[k] * inverse;
        v[k] = lane_fma(lane_fma(-q, length, v[k]), inverse, q);
    }
#else
    for (int k = 0; k < 3; k++) v[k] /= length;
#endif
}

/* 1 / x to within 2 ulp, and at most 1e-4 above sqrt(x), x >= 0: without the wait for a division or a root. */
LANE_INLINE lane_real lane_inverse(lane_real x) {
#if defined(__AVX512DQ__)
    lane_real r = (lane_real)_mm512_rcp14_pd((__m512d)x);
    for (int i = 0; i < 2; i++) r = lane_fma(lane_fma(-x, r, lane_all(1.0)), r, r);
    return r;
#else
    return 1.0 / x;
#endif
}
LANE_INLINE lane_real lane_root_above(lane_real x) {
#if defined(__AVX512DQ__)
    const lane_real some = lane_max(x, lane_all(DBL_MIN));
    return some * (lane_real)_mm512_rsqrt14_pd((__m512d)some) * (1.0 + 0x1p-13);
#else
    return lane_sqrt(x);
#endif
}

/* Quotient of numbers and root of x >= 0, with a relative error below 2^-26. */
LANE_INLINE lane_real lane_coarse_quotient(lane_real a, lane_real b) {
#if defined(__AVX512DQ__)
    const lane_real r = (lane_real)_mm512_rcp14_pd((__m512d)b);
    return a * lane_fma(lane_fma(-b, r, lane_all(1.0)), r, r);
#else
    return a / b;
#endif
}
LANE_INLINE lane_real lane_coarse_root(lane_real x) {
#if defined(__AVX512DQ__)
    const lane_real some = lane_max(x, lane_all(DBL_MIN)), y = (lane_real)_mm512_rsqrt14_pd((__m512d)some);
    const lane_real g = some * y;
    return lane_fma(g, lane_fma(-g, 0.5 * y, lane_all(0.5)), g);
#else
    return lane_sqrt(x);
#endif
}

/* Four numbers and four numbers. */
LANE_INLINE lane_real lane_load_halves(const double *first, const double *second) {
#if defined(__AVX512DQ__)
    return (lane_real)_mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_loadu_pd(first)), _mm256_loadu_pd(second), 1);
#else
    return (lane_real){first[0], first[1], first[2], first[3], second[0], second[1], second[2], second[3]};
#endif
}

/* Eight vectors of three numbers each, in two runs of four, to and from three lane_reals. */
LANE_INLINE void lane_load_vectors(const double *first, const double *second, lane_real *v) {
#if defined(__AVX512DQ__)
    const __m512d a = _mm512_loadu_pd(first), c = _mm512_loadu_pd(second + 4);
    const __m512d b =
        _mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_loadu_pd(first + 8)), _mm256_loadu_pd(second), 1);
    const __m512i x1 = _mm512_setr_epi64(0, 3, 6, 9, 12, 15, 0, 0), x2 = _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 10, 13);
    const __m512i y1 = _mm512_setr_epi64(1, 4, 7, 10, 13, 0, 0, 0), y2 = _mm512_setr_epi64(0, 1, 2, 3, 4, 8, 11, 14);
    const __m512i z1 = _mm512_setr_epi64(2, 5, 8, 11, 14, 0, 0, 0), z2 = _mm512_setr_epi64(0, 1, 2, 3, 4, 9, 12, 15);
    v[0] = (lane_real)_mm512_permutex2var_pd(_mm512_permutex2var_pd(a, x1, b), x2, c);
    v[1] = (lane_real)_mm512_permutex2var_pd(_mm512_permutex2var_pd(a, y1, b), y2, c);
    v[2] = (lane_real)_mm512_permutex2var_pd(_mm512_permutex2var_pd(a, z1, b), z2, c);
#else
    for (int l = 0; l < LANES; l++)
        for (int k = 0; k < 3; k++) v[k][l] = l < 4 ? first[3 * l + k] : second[3 * (l - 4) + k];
#endif
}
LANE_INLINE void lane_store_vectors(double *first, double *second, const lane_real *v) {
#if defined(__AVX512DQ__)
    const __m512d x = (__m512d)v[0], y = (__m512d)v[1], z = (__m512d)v[2];
    const __m512i a1 = _mm512_setr_epi64(0, 8, 0, 1, 9, 0, 2, 10), a2 = _mm512_setr_epi64(0, 1, 8, 3, 4, 9, 6, 7);
    const __m512i b1 = _mm512_setr_epi64(0, 3, 11, 0, 4, 12, 0, 5), b2 = _mm512_setr_epi64(10, 1, 2, 11, 4, 5, 12, 7);
    const __m512i c1 = _mm512_setr_epi64(13, 0, 6, 14, 0, 7, 15, 0), c2 = _mm512_setr_epi64(0, 13, 2, 3, 14, 5, 6, 15);
    const __m512d b = _mm512_permutex2var_pd(_mm512_permutex2var_pd(x, b1, y), b2, z);
    _mm512_storeu_pd(first, _mm512_permutex2var_pd(_mm512_permutex2var_pd(x, a1, y), a2, z));
    _mm256_storeu_pd(first + 8, _mm512_castpd512_pd256(b));
    _mm256_storeu_pd(second, _mm512_extractf64x4_pd(b, 1));
    _mm512_storeu_pd(second + 4, _mm512_permutex2var_pd(_mm512_permutex2var_pd(x, c1, y), c2, z));
#else
    for (int l = 0; l < LANES; l++)
        for (int k = 0; k < 3; k++) *(l < 4 ? first + 3 * l + k : second + 3 * (l - 4) + k) = v[k][l];
#endif
}

/* How many lanes are set, and those of v one behind the other; all LANES numbers at `to` are written. */
LANE_INLINE size_t lane_number(lane_bits m) {
#if defined(__AVX512DQ__)
    return (size_t)__builtin_popcount(m);
#else
    size_t n = 0;
    for (int l = 0; l < LANES; l++) n += (size_t)(m[l] != 0);
    return n;
#endif
}
/* Bit l tells whether lane l is set. */
LANE_INLINE uint32_t lane_set(lane_bits m) {
#if defined(__AVX512DQ__)
    return m;
#else
    uint32_t bits = 0;
    for (int l = 0; l < LANES; l++) bits |= (uint32_t)(m[l] != 0) << l;
    return bits;
#endif
}
LANE_INLINE void lane_pack(double *to, lane_bits m, lane_real v) {
#if defined(__AVX512DQ__)
    _mm512_storeu_pd(to, _mm512_maskz_compress_pd(m, (__m512d)v));
#else
    size_t n = 0;
    for (int l = 0; l < LANES; l++) {
        to[n] = v[l];
        n += (size_t)(m[l] != 0);
    }
#endif
}

LANE_INLINE lane_bits lane_both(lane_bits a, lane_bits b) { return (lane_bits)(a & b); }
LANE_INLINE lane_bits lane_either(lane_bits a, lane_bits b) { return (lane_bits)(a | b); }
LANE_INLINE lane_bits lane_without(lane_bits a, lane_bits b) { return (lane_bits)(a & ~b); }

#endif
