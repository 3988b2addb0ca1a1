/* brdf.h - how a material answers light: the metallic-roughness model.
 *
 * A base of diffuse reflection (dielectrics) under a specular layer of microfacets:
 *
 *   diffuse   improved Oren-Nayar with sigma = roughness / 2. Fujii, "A tiny improvement of the
 *             Oren-Nayar reflectance model" (2012). Roughness 0 is Lambert; sigma near 1 looks as
 *             flat as the full moon, so clay and stone stay at half of it. Light that goes from facet to facet
 *             is added, as far as its sum over all directions is missing from 1, the same for every colour
 *             (Portsmouth, Kutz and Hill, "EON: a practical energy-preserving rough diffuse BRDF", 2024).
 *   specular  F D V with the GGX distribution (Walter et al. 2007), height-correlated Smith visibility
 *             (Heitz 2014) and Schlick's Fresnel (1994); alpha = roughness^2 (Burley 2012).
 *   metal     light that facets send on to one another comes out after several of them, tinted by each: the specular
 *             term times `brdf_gain`, 1 + f0 (1 - E) / E, where E is what single facets return of light from
 *             everywhere (Turquin, "Practical multiple scattering compensation for microfacet models", 2019).
 *             White metal returns all light, to 1 %. Between the facets of dielectrics passes f0^2, a thousandth.
 *   total     what the layer reflects of light from everywhere, `brdf_layer`: Karis's fit (2014) of the
 *             integral of the specular term, and for metals the table of E. The base gets the rest, so that no
 *             material returns more light than it receives.
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

/* What facets that reflect everything return of light from everywhere after a single reflection: E by roughness
 * (rows) and the root of n.v (columns), both 0 to 1 in equal steps. Integrals over visible normals, 4 096 points
 * each; between them linear, within 0.9 %. */
enum { BRDF_SINGLES = 16 };
static const double brdf_singles[BRDF_SINGLES][BRDF_SINGLES] = {
    {0.9941, 0.9996, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000,
     1.0000, 1.0000},
    {0.9567, 0.8921, 0.9644, 0.9927, 0.9976, 0.9993, 0.9996, 0.9997, 0.9999, 1.0000, 1.0000, 1.0000, 1.0000, 1.0000,
     1.0000, 1.0000},
    {0.9883, 0.9522, 0.8918, 0.9220, 0.9641, 0.9845, 0.9922, 0.9959, 0.9975, 0.9982, 0.9990, 0.9993, 0.9994, 0.9994,
     0.9997, 0.9997},
    {0.9945, 0.9769, 0.9240, 0.8905, 0.9045, 0.9372, 0.9635, 0.9789, 0.9871, 0.9917, 0.9946, 0.9962, 0.9970, 0.9974,
     0.9976, 0.9982},
    {0.9966, 0.9859, 0.9497, 0.9090, 0.8876, 0.8944, 0.9175, 0.9419, 0.9607, 0.9732, 0.9812, 0.9865, 0.9897, 0.9918,
     0.9933, 0.9942},
    {0.9974, 0.9896, 0.9630, 0.9280, 0.8968, 0.8813, 0.8846, 0.9008, 0.9212, 0.9401, 0.9549, 0.9659, 0.9734, 0.9788,
     0.9825, 0.9851},
    {0.9977, 0.9910, 0.9690, 0.9390, 0.9077, 0.8827, 0.8701, 0.8712, 0.8826, 0.8993, 0.9166, 0.9322, 0.9447, 0.9547,
     0.9619, 0.9675},
    {0.9977, 0.9912, 0.9707, 0.9432, 0.9130, 0.8848, 0.8635, 0.8521, 0.8512, 0.8590, 0.8721, 0.8874, 0.9026, 0.9161,
     0.9277, 0.9370},
    {0.9974, 0.9906, 0.9698, 0.9425, 0.9122, 0.8823, 0.8561, 0.8365, 0.8252, 0.8224, 0.8268, 0.8367, 0.8495, 0.8636,
     0.8772, 0.8898},
    {0.9970, 0.9894, 0.9669, 0.9381, 0.9062, 0.8741, 0.8442, 0.8187, 0.7993, 0.7871, 0.7819, 0.7831, 0.7895, 0.7994,
     0.8115, 0.8244},
    {0.9965, 0.9878, 0.9626, 0.9308, 0.8960, 0.8607, 0.8269, 0.7964, 0.7705, 0.7502, 0.7360, 0.7278, 0.7253, 0.7276,
     0.7338, 0.7427},
    {0.9960, 0.9859, 0.9572, 0.9214, 0.8824, 0.8428, 0.8045, 0.7690, 0.7372, 0.7099, 0.6877, 0.6706, 0.6587, 0.6518,
     0.6492, 0.6506},
    {0.9953, 0.9837, 0.9509, 0.9102, 0.8661, 0.8215, 0.7780, 0.7371, 0.6995, 0.6659, 0.6366, 0.6117, 0.5913, 0.5752,
     0.5632, 0.5550},
    {0.9946, 0.9812, 0.9438, 0.8977, 0.8479, 0.7974, 0.7483, 0.7017, 0.6585, 0.6190, 0.5835, 0.5519, 0.5242, 0.5003,
     0.4799, 0.4629},
    {0.9938, 0.9786, 0.9361, 0.8840, 0.8280, 0.7714, 0.7163, 0.6640, 0.6152, 0.5704, 0.5295, 0.4925, 0.4592, 0.4294,
     0.4028, 0.3793},
    {0.9930, 0.9757, 0.9278, 0.8695, 0.8070, 0.7440, 0.6828, 0.6249, 0.5710, 0.5213, 0.4760, 0.4348, 0.3976, 0.3641,
     0.3339, 0.3067},
};

static inline double brdf_single(double roughness, double nv) {
    const double steps = BRDF_SINGLES - 1, a = less(more(roughness, 0), 1) * steps, b = sqrt(less(nv, 1)) * steps;
    const double i = less(floor(a), steps - 1), j = less(floor(b), steps - 1), u = a - i, v = b - j;
    const double *low = brdf_singles[(size_t)i] + (size_t)j, *high = low + BRDF_SINGLES;
    return (1 - u) * ((1 - v) * low[0] + v * low[1]) + u * ((1 - v) * high[0] + v * high[1]);
}

/* The specular term of metal is to be taken so many times. */
static inline vector brdf_gain(const brdf_material *m, double single) {
    return add((vector){1, 1, 1}, times(m->metalness * (1 / single - 1), m->color));
}

/* Share of the light from everywhere that the specular layer sends to the eye; gain: brdf_gain. */
static inline vector brdf_layer(vector f0, const brdf_material *m, double single, vector gain, double nv) {
    const double roughness = m->roughness, x = 1 - roughness, y = 0.0425 - 0.0275 * roughness;
    const double a004 = less(x * x, exp2(-9.28 * nv)) * x + y;
    const double fitted = -1.04 * a004 + 1.04 - 0.572 * roughness;
    const double offset = more(1.04 * a004 - 0.04 + 0.022 * roughness, 0);
    const double scale = fitted + m->metalness * (single - offset - fitted);
    return (vector){less((f0.x * scale + offset) * gain.x, 1), less((f0.y * scale + offset) * gain.y, 1),
                    less((f0.z * scale + offset) * gain.z, 1)};
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

/* What a single reflection by rough facets leaves to several: with g(c) the integral of stretch n.l / pi over the
 * lights for an eye at the cosine c, k = 1/2 - 2 / (3 pi), which makes pi level (1 + sigma k) = 1, and G the mean of g,
 * light in all directions is complete with (k - g(n.l)) (k - g(n.v)) / (k - G) more of stretch; this is a root of
 * that, a cubic within 0.003. */
#define BRDF_LIFT(c) (0.0009 + (c) * (0.6722 + (c) * (0.3476 - 0.3969 * (c))))
static inline double brdf_lift(double cosine) { return BRDF_LIFT(cosine); }

/* Diffuse term times n.l, for a base of colour 1. */
static inline double brdf_diffuse(double roughness, const brdf_angles *at) {
    const double s = at->vl - at->nl * at->nv;
    const double stretch = s > 0 ? s / more(at->nl, at->nv) : s;
    const double sigma = roughness / 2, level = 1 / (brdf_pi + (brdf_pi / 2 - 2.0 / 3) * sigma);
    return at->nl * level * (1 + sigma * (stretch + brdf_lift(at->nl) * brdf_lift(at->nv)));
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
