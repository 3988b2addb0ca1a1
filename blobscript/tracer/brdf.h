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
 * Directions are unit vectors that point away from the surface; n.v and n.l are positive. The second half draws
 * directions from numbers in [0, 1): where it has no roughness of at least BRDF_MIN_ALPHA, a mirror is a mirror.
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
    const double a004 = less(x * x, exp2(-9.28 * nv)) * x + y;
    const double scale = -1.04 * a004 + 1.04 - 0.572 * roughness;
    const double offset = more(1.04 * a004 - 0.04 + 0.022 * roughness, 0);
    return (vector){less(f0.x * scale + offset, 1), less(f0.y * scale + offset, 1), less(f0.z * scale + offset, 1)};
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
    return (brdf_angles){nv, dot(n, l), dot(n, h), more(dot(v, h), 0), dot(v, l)};
}

/* Diffuse term times n.l, for a base of colour 1. */
static inline double brdf_diffuse(double roughness, const brdf_angles *at) {
    const double s = at->vl - at->nl * at->nv;
    const double stretch = s > 0 ? s / more(at->nl, at->nv) : s;
    const double sigma = roughness / 2, level = 1 / (brdf_pi + (brdf_pi / 2 - 2.0 / 3) * sigma);
    return at->nl * level * (1 + sigma * stretch);
}

/* Specular term times n.l. */
static inline vector brdf_specular(vector f0, double roughness, const brdf_angles *at) {
    const double alpha = more(roughness * roughness, BRDF_MIN_ALPHA), a2 = alpha * alpha;
    const double nv = at->nv, nl = at->nl;
    const double bowl = more(at->nh * at->nh * (a2 - 1) + 1, a2);
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

/* ---- directions drawn by chance ---------------------------------------------------------------- */

/* Two unit vectors that make a right-handed frame with the unit vector n (Duff et al., "Building an orthonormal
 * basis, revisited", JCGT 6(1), 2017). */
typedef struct brdf_frame {
    vector s, t, n;
} brdf_frame;

static inline brdf_frame brdf_frame_of(vector n) {
    const double sign = copysign(1.0, n.z), a = -1 / (sign + n.z), b = n.x * n.y * a;
    return (brdf_frame){{1 + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
}

static inline vector brdf_from(const brdf_frame *f, vector v) {
    return add(times(v.x, f->s), add(times(v.y, f->t), times(v.z, f->n)));
}

static inline vector brdf_into(const brdf_frame *f, vector v) {
    return (vector){dot(v, f->s), dot(v, f->t), dot(v, f->n)};
}

/* A direction above z = 0 with density cosine / pi. */
static inline vector brdf_cosine(const double u[2]) {
    const double r = sqrt(u[0]), turn = 2 * brdf_pi * u[1];
    return (vector){r * cos(turn), r * sin(turn), sqrt(more(1 - u[0], 0))};
}

/* A direction within a cone about z: `height` is 1 - the cosine of its half angle; evenly in solid angle. */
static inline vector brdf_cone(double height, const double u[2]) {
    const double h = u[0] * height, r = sqrt(more(h * (2 - h), 0)), turn = 2 * brdf_pi * u[1];
    return (vector){r * cos(turn), r * sin(turn), 1 - h};
}

/* Smith's Lambda for GGX. */
static inline double brdf_lambda(double alpha, double cosine) {
    const double c2 = cosine * cosine;
    return 0.5 * (sqrt(1 + alpha * alpha * more(1 - c2, 0) / c2) - 1);
}

/* A facet's normal among those that the eye sees, in the frame of the surface. Dupuy and Benyoub, "Sampling visible
 * GGX normals with spherical caps" (2023). */
static inline vector brdf_visible(vector eye, double alpha, const double u[2]) {
    const vector stretched = unit((vector){alpha * eye.x, alpha * eye.y, eye.z});
    const double turn = 2 * brdf_pi * u[0], z = (1 - u[1]) * (1 + stretched.z) - stretched.z;
    const double r = sqrt(more(1 - z * z, 0));
    const vector cap = add((vector){r * cos(turn), r * sin(turn), z}, stretched);
    return unit((vector){alpha * cap.x, alpha * cap.y, more(cap.z, 0)});
}

/* Density with which reflection at such facets goes in a direction with half vector h. */
static inline double brdf_visible_density(double alpha, double nv, double nh) {
    const double a2 = alpha * alpha, bowl = more(nh * nh * (a2 - 1) + 1, a2);
    return a2 / (brdf_pi * bowl * bowl) / (4 * nv * (1 + brdf_lambda(alpha, nv)));
}

/* Share of the light from the facets that a drawn direction stands for: masking on its way out. */
static inline double brdf_masking(double alpha, double nv, double nl) {
    const double in = 1 + brdf_lambda(alpha, nv);
    return in / (in + brdf_lambda(alpha, nl));
}

static inline vector brdf_schlick(vector f0, double vh) {
    const double far = 1 - less(vh, 1), weight = far * far * far * far * far;
    return add(f0, times(weight, subtract((vector){1, 1, 1}, f0)));
}

#endif
