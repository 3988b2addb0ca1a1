/* texture.h - programs that give parts of a material by place: see texture.py, which is the specification.
 *
 * Straight programs over registers; each instruction runs over TEXTURE_LANES places at once. Registers 0, 1, 2
 * hold the place, then the constants, then one result per instruction.
 */
#ifndef BLOB_TEXTURE_H
#define BLOB_TEXTURE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "shade.h"

enum { TEXTURE_LANES = 32 };
typedef double texture_lanes[TEXTURE_LANES];

/* ORDER TEXTURE: as in texture.py. */
enum {
    TEXTURE_ADD,
    TEXTURE_SUBTRACT,
    TEXTURE_MULTIPLY,
    TEXTURE_DIVIDE,
    TEXTURE_NEGATE,
    TEXTURE_ABS,
    TEXTURE_FLOOR,
    TEXTURE_CEIL,
    TEXTURE_SQRT,
    TEXTURE_EXP,
    TEXTURE_LOG,
    TEXTURE_SIN,
    TEXTURE_COS,
    TEXTURE_TAN,
    TEXTURE_ASIN,
    TEXTURE_ACOS,
    TEXTURE_ATAN,
    TEXTURE_ATAN2,
    TEXTURE_POWER,
    TEXTURE_MOD,
    TEXTURE_MIN,
    TEXTURE_MAX,
    TEXTURE_LESS,
    TEXTURE_LESS_EQUAL,
    TEXTURE_EQUAL,
    TEXTURE_AND,
    TEXTURE_OR,
    TEXTURE_NOT,
    TEXTURE_SELECT,
    TEXTURE_NOISE,
    TEXTURE_RAND,
    TEXTURE_LINEAR,
    TEXTURE_OPERATIONS
};

/* ---- random ----------------------------------------------------------------------------------- */

static const uint64_t texture_step = 0x9E3779B97F4A7C15u;

static inline uint64_t texture_mix(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static inline uint64_t texture_word(double x) { return fabs(x) < 0x1p63 ? (uint64_t)(int64_t)x : 0; }

static inline double texture_rand(double i, double seed) {
    const uint64_t start = texture_mix(texture_word(seed) + texture_step);
    return (double)(texture_mix(start + (texture_word(i) + 1) * texture_step) >> 11) * 0x1p-53;
}

/* Dot product of the way (x, y, z) from a corner with the corner's direction, one of a cube's 12 edges. */
static inline double texture_edge(uint64_t hash, double x, double y, double z) {
    switch ((hash >> 32) % 12) {
        case 0: return x + y;
        case 1: return -x + y;
        case 2: return x - y;
        case 3: return -x - y;
        case 4: return x + z;
        case 5: return -x + z;
        case 6: return x - z;
        case 7: return -x - z;
        case 8: return y + z;
        case 9: return -y + z;
        case 10: return y - z;
        default: return -y - z;
    }
}

static inline double texture_fade(double t) { return t * t * t * (t * (t * 6.0 - 15.0) + 10.0); }

static double texture_noise(double x, double y, double z, double seed) {
    if (!isfinite(x) || !isfinite(y) || !isfinite(z)) return 0.0;
    const double i = floor(x), j = floor(y), k = floor(z);
    const double u = x - i, v = y - j, w = z - k, fx = texture_fade(u), fy = texture_fade(v);
    const uint64_t start = texture_mix(texture_word(seed) + texture_step);
    uint64_t rows[2][2];
    for (uint64_t a = 0; a < 2; a++) {
        const uint64_t column = texture_mix(start + (texture_word(i) + a) * texture_step);
        for (uint64_t b = 0; b < 2; b++) rows[a][b] = texture_mix(column + (texture_word(j) + b) * texture_step);
    }
    double along[2];
    for (uint64_t c = 0; c < 2; c++) {
        double line[2];
        const uint64_t place = (texture_word(k) + c) * texture_step;
        for (int b = 0; b < 2; b++) {
            const double near = texture_edge(texture_mix(rows[0][b] + place), u, v - b, w - (double)c);
            const double far = texture_edge(texture_mix(rows[1][b] + place), u - 1, v - b, w - (double)c);
            line[b] = near + fx * (far - near);
        }
        along[c] = line[0] + fy * (line[1] - line[0]);
    }
    return 0.96 * (along[0] + texture_fade(w) * (along[1] - along[0]));
}

/* ---- operations ------------------------------------------------------------------------------- */

/* Has the sign of `by`; as Python's %. */
static inline double texture_mod(double x, double by) {
    const double rest = fmod(x, by);
    return rest != 0.0 && (rest < 0.0) != (by < 0.0) ? rest + by : copysign(rest, rest != 0.0 ? rest : by);
}

static inline double texture_unit(double x) { return fabs(x) <= 1 + 1e-12 ? fmin(fmax(x, -1.0), 1.0) : (double)NAN; }

static inline double texture_linear(double x) {
    const double c = fmin(fmax(x, 0.0), 1.0);
    return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
}

#define TEXTURE_EACH(VALUE)                                                                                            \
    for (size_t l = 0; l < n; l++) out[l] = (VALUE);                                                                   \
    break

static void texture_step_run(const int32_t *step, size_t n, texture_lanes *registers, double *out) {
    const double *a = registers[step[1]], *b = registers[step[2]], *c = registers[step[3]], *d = registers[step[4]];
    switch (step[0]) {
        case TEXTURE_ADD: TEXTURE_EACH(a[l] + b[l]);
        case TEXTURE_SUBTRACT: TEXTURE_EACH(a[l] - b[l]);
        case TEXTURE_MULTIPLY: TEXTURE_EACH(a[l] * b[l]);
        case TEXTURE_DIVIDE: TEXTURE_EACH(a[l] / b[l]);
        case TEXTURE_NEGATE: TEXTURE_EACH(-a[l]);
        case TEXTURE_ABS: TEXTURE_EACH(fabs(a[l]));
        case TEXTURE_FLOOR: TEXTURE_EACH(floor(a[l]));
        case TEXTURE_CEIL: TEXTURE_EACH(ceil(a[l]));
        case TEXTURE_SQRT: TEXTURE_EACH(sqrt(a[l]));
        case TEXTURE_EXP: TEXTURE_EACH(exp(a[l]));
        case TEXTURE_LOG: TEXTURE_EACH(log(a[l]));
        case TEXTURE_SIN: TEXTURE_EACH(sin(a[l]));
        case TEXTURE_COS: TEXTURE_EACH(cos(a[l]));
        case TEXTURE_TAN: TEXTURE_EACH(tan(a[l]));
        case TEXTURE_ASIN: TEXTURE_EACH(asin(texture_unit(a[l])));
        case TEXTURE_ACOS: TEXTURE_EACH(acos(texture_unit(a[l])));
        case TEXTURE_ATAN: TEXTURE_EACH(atan(a[l]));
        case TEXTURE_ATAN2: TEXTURE_EACH(atan2(a[l], b[l]));
        case TEXTURE_POWER: TEXTURE_EACH(pow(a[l], b[l]));
        case TEXTURE_MOD: TEXTURE_EACH(texture_mod(a[l], b[l]));
        case TEXTURE_MIN: TEXTURE_EACH(b[l] < a[l] ? b[l] : a[l]);
        case TEXTURE_MAX: TEXTURE_EACH(b[l] > a[l] ? b[l] : a[l]);
        case TEXTURE_LESS: TEXTURE_EACH(a[l] < b[l]);
        case TEXTURE_LESS_EQUAL: TEXTURE_EACH(a[l] <= b[l]);
        case TEXTURE_EQUAL: TEXTURE_EACH(a[l] == b[l]);
        case TEXTURE_AND: TEXTURE_EACH(a[l] != 0 && b[l] != 0);
        case TEXTURE_OR: TEXTURE_EACH(a[l] != 0 || b[l] != 0);
        case TEXTURE_NOT: TEXTURE_EACH(a[l] == 0);
        case TEXTURE_SELECT: TEXTURE_EACH(a[l] != 0 ? b[l] : c[l]);
        case TEXTURE_NOISE: TEXTURE_EACH(texture_noise(a[l], b[l], c[l], d[l]));
        case TEXTURE_RAND: TEXTURE_EACH(texture_rand(a[l], b[l]));
        case TEXTURE_LINEAR: TEXTURE_EACH(texture_linear(a[l]));
        default: break;
    }
}
#undef TEXTURE_EACH

/* Registers that a texture needs. */
static size_t texture_size(const shade_texture *texture) {
    return 3 + (size_t)texture->constant_count + (size_t)texture->code_count;
}

/* Colours and shares within their limits, heights any finite number. */
static double texture_limited(int32_t column, double x) {
    if (!isfinite(x)) return 0.0;
    if (column == SHADE_BUMP) return x;
    return column < 5 ? fmin(fmax(x, 0.0), 1.0) : fmax(x, 0.0);
}

/* The outputs at up to TEXTURE_LANES places: out[place * output_count + output]. */
static void texture_run(const shade_picture *picture, const shade_texture *texture, size_t n, const double *places,
                        texture_lanes *registers, double *out) {
    for (size_t l = 0; l < n; l++) {
        const double *p = places + 3 * l, *m = texture->matrix;
        for (size_t k = 0; k < 3; k++)
            registers[k][l] =
                texture->mapped ? m[4 * k] * p[0] + m[4 * k + 1] * p[1] + m[4 * k + 2] * p[2] + m[4 * k + 3] : p[k];
    }
    const int32_t *code = picture->code + SHADE_INSTRUCTION * (size_t)texture->code_begin;
    const int32_t *outputs = picture->outputs + 2 * (size_t)texture->output_begin;
    texture_lanes *next = registers + 3;
    for (int32_t i = 0; i < texture->constant_count; i++, next++)
        for (size_t l = 0; l < n; l++) (*next)[l] = picture->constants[texture->constant_begin + i];
    for (int32_t i = 0; i < texture->code_count; i++, next++)
        texture_step_run(code + SHADE_INSTRUCTION * (size_t)i, n, registers, *next);
    for (size_t l = 0; l < n; l++)
        for (int32_t i = 0; i < texture->output_count; i++)
            *out++ = texture_limited(outputs[2 * i], registers[outputs[2 * i + 1]][l]);
}

#endif
