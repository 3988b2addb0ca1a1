/* vector.h - three doubles, for directions, places and colours of the shading. */
#ifndef BLOB_VECTOR_H
#define BLOB_VECTOR_H

#include <math.h>

/* The larger and the smaller of two numbers; b where a is none. (fmax and fmin are calls.) */
static inline double more(double a, double b) { return a > b ? a : b; }

static inline double less(double a, double b) { return a < b ? a : b; }

typedef struct vector {
    double x, y, z;
} vector;

static inline vector vector_of(const double *p) { return (vector){p[0], p[1], p[2]}; }

static inline void vector_put(vector a, double *p) {
    p[0] = a.x;
    p[1] = a.y;
    p[2] = a.z;
}

static inline vector add(vector a, vector b) { return (vector){a.x + b.x, a.y + b.y, a.z + b.z}; }

static inline vector subtract(vector a, vector b) { return (vector){a.x - b.x, a.y - b.y, a.z - b.z}; }

/* Component by component, as colours filter light. */
static inline vector filter(vector a, vector b) { return (vector){a.x * b.x, a.y * b.y, a.z * b.z}; }

static inline vector times(double s, vector a) { return (vector){s * a.x, s * a.y, s * a.z}; }

static inline vector blend(vector a, vector b, double t) { return add(times(1 - t, a), times(t, b)); }

static inline double dot(vector a, vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline vector unit(vector a) { return times(1 / sqrt(dot(a, a)), a); }

static inline double largest(vector a) { return more(a.x, more(a.y, a.z)); }

#endif
