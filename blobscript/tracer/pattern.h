/* pattern.h - where the samples of a pixel lie: well spread, the same on every machine.
 *
 * The first two dimensions of Sobol's sequence, a (0,2)-sequence in base 2: any 2^m consecutive
 * points that start at a multiple of 2^m have one point in every elementary box of area 2^-m. Each
 * pixel scrambles both with hashes of its own (nested uniform scrambling, Owen 1995), which keeps
 * that property and makes neighbouring pixels differ. Integer arithmetic only. The hash-based
 * scrambling is from Laine and Karras, "Stratified sampling for stochastic transparency" (2011), as
 * presented by Burley, "Practical hash-based Owen scrambling" (JCGT 9(4), 2020).
 */
#ifndef BLOB_PATTERN_H
#define BLOB_PATTERN_H

#include <stdint.h>

static inline uint32_t pattern_hash(uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

static inline uint32_t pattern_reverse(uint32_t x) {
    x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    x = (x >> 8 & 0x00ff00ffu) | (x & 0x00ff00ffu) << 8;
    return x >> 16 | x << 16;
}

/* Flips each bit depending on a hash of the bits above it: carries only run upwards in a product with
 * an even number, so the bits are reversed around it. */
static inline uint32_t pattern_scramble(uint32_t x, uint32_t seed) {
    x = pattern_reverse(x);
    x += seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return pattern_reverse(x);
}

/* The second Sobol dimension, primitive polynomial x + 1. Its matrix is Pascal's triangle modulo 2, which is a
 * Kronecker power of a triangular 2 x 2 matrix: five steps on the bits in reverse. */
static inline uint32_t pattern_sobol(uint32_t index) {
    uint32_t x = pattern_reverse(index);
    x ^= (x & 0x55555555u) << 1;
    x ^= (x & 0x33333333u) << 2;
    x ^= (x & 0x0f0f0f0fu) << 4;
    x ^= (x & 0x00ff00ffu) << 8;
    return x ^ x << 16;
}

static inline uint32_t pattern_pixel(uint32_t x, uint32_t y, uint32_t seed) {
    return pattern_hash(x ^ pattern_hash(y ^ pattern_hash(seed)));
}

/* Sample `index` of a pixel, given by its key: a place in [0, 1) x [0, 1). */
static inline void pattern_place(uint32_t pixel, uint32_t index, double place[2]) {
    place[0] = pattern_scramble(pattern_reverse(index), pattern_hash(pixel ^ 0x68bc21ebu)) * 0x1p-32;
    place[1] = pattern_scramble(pattern_sobol(index), pattern_hash(pixel ^ 0x02e5be93u)) * 0x1p-32;
}

/* Two more numbers in [0, 1) for sample `index` of whatever has this key: the same points in another order and
 * scrambled otherwise, so that pairs with different keys know nothing of each other (Burley's "padding"). */
static inline void pattern_pair(uint32_t key, uint32_t index, double pair[2]) {
    const uint32_t own = pattern_hash(key), order = pattern_scramble(index, own);
    pair[0] = pattern_scramble(pattern_reverse(order), pattern_hash(own ^ 0x68bc21ebu)) * 0x1p-32;
    pair[1] = pattern_scramble(pattern_sobol(order), pattern_hash(own ^ 0x02e5be93u)) * 0x1p-32;
}

#endif
