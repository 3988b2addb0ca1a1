/* brdf.h - how a material answers light: the metallic-roughness model.
 *
 * A base of diffuse reflection (dielectrics) under a specular layer of microfacets:
 *
 *   diffuse   improved Oren-Nayar with sigma = roughness / 2. Fujii, "A tiny improvement of the
 *             Oren-Nayar reflectance model" (2012). Roughness 0 is Lambert; sigma near 1 looks as
 *             flat as the full moon, so clay and stone stay at half of it.
 *   specular  F D V with the GGX distribution (Walter et al. 2007), height-correlated Smith visibility
 *             (Heitz 2014) and Schlick's Fresnel (1994); alpha = roughness^2 (Burley 2012).
 *   total     what the layer reflects of light from everywhere, `brdf_layer`: Karis's fit (2014) of the
 *             integral of the specular term. The base gets the rest, so that no material returns
 *             more light than it receives.
 *
 * Directions are unit vectors that point away from the surface; n.v and n.l are positive.
 */
#ifndef BLOB_BRDF_H
#define BLOB_BRDF_H

#include "vector.h"

/* A row of blob_paint's output by name. */
typedef struct brdf_material {
    vector color;
    double roughness, metalness, specular, transmission, ior;
    vector absorption, emission;
    double reflection;
} brdf_material;

static inline brdf_material brdf_read(const double *row) {
    return (brdf_material){.color = vector_of(row),
                           .roughness = row[3],
                           .metalness = row[4],
                           .specular = row[5],
                           .transmission = row[6],
                           .ior = row[7],
                           .absorption = vector_of(row + 8),
                           .emission = vector_of(row + 11),
                           .reflection = row[14]};
}

/* Lights have no size, so a mirror would show them as nothing: this roughness stands for one. */
#define BRDF_MIN_ALPHA 0.03

static const double brdf_pi = 3.14159265358979323846;

static inline vector brdf_f0(const brdf_material *m) {
    const double plain = 0.08 * m->specular;
    return blend((vector){plain, plain, plain}, m->color, m->metalness);
}

/* Share of the light from everywhere that the specular layer sends to the eye. */
static inline vector brdf_layer(vector f0, double roughness, double nv) {
    const double x = 1 - roughness, y = 0.0425 - 0.0275 * roughness;
    const double a004 = fmin(x * x, exp2(-9.28 * nv)) * x + y;
    const double scale = -1.04 * a004 + 1.04 - 0.572 * roughness;
    const double offset = fmax(1.04 * a004 - 0.04 + 0.022 * roughness, 0);
    return (vector){fmin(f0.x * scale + offset, 1), fmin(f0.y * scale + offset, 1), fmin(f0.z * scale + offset, 1)};
}

/* Share that the base gets: all but the layer's. */
static inline vector brdf_base(const brdf_material *m, vector layer) {
    const double dielectric = (1 - m->metalness) * (1 - m->transmission);
    return times(dielectric, filter(m->color, subtract((vector){1, 1, 1}, layer)));
}

/* The cosines of one light on one point; nv and nl are positive. */
typedef struct brdf_angles {
    double nv, nl, nh, vh, vl;
} brdf_angles;

static inline brdf_angles brdf_measure(vector n, vector v, vector l, double nv) {
    const vector sum = add(v, l);
    const double length = sqrt(dot(sum, sum));
    const vector h = length > 0 ? times(1 / length, sum) : n;
    return (brdf_angles){nv, dot(n, l), dot(n, h), fmax(dot(v, h), 0), dot(v, l)};
}

/* Diffuse term times n.l, for a base of colour 1. */
static inline double brdf_diffuse(double roughness, const brdf_angles *at) {
    const double s = at->vl - at->nl * at->nv;
    const double stretch = s > 0 ? s / fmax(at->nl, at->nv) : s;
    const double sigma = roughness / 2, level = 1 / (brdf_pi + (brdf_pi / 2 - 2.0 / 3) * sigma);
    return at->nl * level * (1 + sigma * stretch);
}

/* Specular term times n.l. */
static inline vector brdf_specular(vector f0, double roughness, const brdf_angles *at) {
    const double alpha = fmax(roughness * roughness, BRDF_MIN_ALPHA), a2 = alpha * alpha;
    const double nv = at->nv, nl = at->nl;
    const double bowl = fmax(at->nh * at->nh * (a2 - 1) + 1, a2);
    const double visibility = 0.5 / (nl * sqrt(nv * nv * (1 - a2) + a2) + nv * sqrt(nl * nl * (1 - a2) + a2));
    const double strength = nl * visibility * a2 / (brdf_pi * bowl * bowl);
    const double far = 1 - at->vh, schlick = far * far * far * far * far;
    return times(strength, add(f0, times(schlick, subtract((vector){1, 1, 1}, f0))));
}

/* Fresnel's reflectance for unpolarised light; `eta` is the index in front over the one behind, `cosine`
 * the incident one. *bent: the cosine behind, -1 for total reflection. */
static inline double brdf_fresnel(double cosine, double eta, double *bent) {
    const double square = 1 - eta * eta * (1 - cosine * cosine);
    if (square <= 0) {
        *bent = -1;
        return 1;
    }
    const double behind = sqrt(square);
    const double s = (eta * cosine - behind) / (eta * cosine + behind);
    const double p = (cosine - eta * behind) / (cosine + eta * behind);
    *bent = behind;
    return 0.5 * (s * s + p * p);
}

#endif
