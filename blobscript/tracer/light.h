/* light.h - where light comes from: the sky by direction, suns and lamps by the place that they shine on. */
#ifndef BLOB_LIGHT_H
#define BLOB_LIGHT_H

#include "brdf.h"
#include "shade.h"

/* ---- the sky ---------------------------------------------------------------------------------- */

static vector sky_colors(const shade_sky *sky, vector d) {
    const vector level = vector_of(sky->horizon);
    if (d.y >= 0) {
        const double far = 1 - d.y;
        return blend(vector_of(sky->above), level, far * far * far);
    }
    const double x = less(-d.y / 0.12, 1);
    return blend(level, vector_of(sky->below), x * x * (3 - 2 * x));
}

/* Column and row of a direction, as shares of the picture's width and height. */
static void sky_cell(const shade_sky *sky, vector d, double *across, double *down) {
    const double x = sky->turn[0] * d.x - sky->turn[1] * d.z, z = sky->turn[1] * d.x + sky->turn[0] * d.z;
    *across = 0.5 + atan2(x, -z) / (2 * brdf_pi);
    *down = acos(less(more(d.y, -1), 1)) / brdf_pi;
}

static vector sky_pixel(const shade_sky *sky, int32_t x, int32_t y) {
    const int32_t column = (x % sky->width + sky->width) % sky->width;
    const int32_t row = y < 0 ? 0 : y >= sky->height ? sky->height - 1 : y;
    const float *p = sky->pixels + 3 * ((size_t)row * (size_t)sky->width + (size_t)column);
    return (vector){(double)p[0], (double)p[1], (double)p[2]};
}

static vector sky_image(const shade_sky *sky, vector d) {
    double x, y;
    sky_cell(sky, d, &x, &y);
    x = x * sky->width - 0.5;
    y = y * sky->height - 0.5;
    const double column = floor(x), row = floor(y);
    const int32_t i = (int32_t)column, j = (int32_t)row;
    const vector upper = blend(sky_pixel(sky, i, j), sky_pixel(sky, i + 1, j), x - column);
    const vector lower = blend(sky_pixel(sky, i, j + 1), sky_pixel(sky, i + 1, j + 1), x - column);
    return blend(upper, lower, y - row);
}

/* Radiance from direction d. */
static vector sky_look(const shade_sky *sky, vector d) {
    if (sky->kind == SHADE_IMAGE) return sky_image(sky, d);
    if (sky->kind == SHADE_COLORS) return sky_colors(sky, d);
    const double y = d.y - sky->level;
    const double rise = y / sqrt(y * y + sky->bend * sky->bend);
    return blend(vector_of(sky->below), vector_of(sky->above), 0.5 + 0.5 * rise);
}

/* Irradiance / pi on a surface that faces n; also the sky's radiance, very much blurred. */
static vector sky_ambient(const shade_sky *sky, vector n) {
    const double *m = sky->tilt;
    const vector tilt = {m[0] * n.x + m[1] * n.y + m[2] * n.z, m[3] * n.x + m[4] * n.y + m[5] * n.z,
                         m[6] * n.x + m[7] * n.y + m[8] * n.z};
    const vector sum = add(vector_of(sky->ambient), tilt);
    return (vector){more(sum.x, 0), more(sum.y, 0), more(sum.z, 0)};
}

/* Height over the horizon plane of the line between rows i - 1 and i of the table. */
static double sky_line(const shade_sky *sky, int32_t i) { return cos(brdf_pi * i / sky->table_height); }

/* Density with which sky_draw draws a direction of an IMAGE. */
static double sky_density(const shade_sky *sky, vector d) {
    double x, y;
    sky_cell(sky, d, &x, &y);
    const int32_t column = (int32_t)less(more(x * sky->table_width, 0), sky->table_width - 1);
    const int32_t row = (int32_t)less(more(y * sky->table_height, 0), sky->table_height - 1);
    const double *line = sky->columns + (size_t)row * (size_t)(sky->table_width + 1) + column;
    const double share = (sky->rows[row + 1] - sky->rows[row]) * (line[1] - line[0]);
    const double height = sky_line(sky, row) - sky_line(sky, row + 1);
    return share * sky->table_width / (2 * brdf_pi * height);
}

/* The interval of a cumulative table of n that holds u, and where in it. */
static int32_t sky_find(const double *table, int32_t n, double u, double *within) {
    int32_t low = 0, high = n;
    while (high - low > 1) {
        const int32_t middle = (low + high) / 2;
        if (table[middle] <= u) low = middle;
        else high = middle;
    }
    const double width = table[low + 1] - table[low];
    *within = width > 0 ? less((u - table[low]) / width, 1) : 0.5;
    return low;
}

/* A direction of an IMAGE, bright ones more often. */
static vector sky_draw(const shade_sky *sky, const double u[2]) {
    double down, across;
    const int32_t row = sky_find(sky->rows, sky->table_height, u[1], &down);
    const double *line = sky->columns + (size_t)row * (size_t)(sky->table_width + 1);
    const int32_t column = sky_find(line, sky->table_width, u[0], &across);
    const double y = sky_line(sky, row) + down * (sky_line(sky, row + 1) - sky_line(sky, row));
    const double turn = 2 * brdf_pi * ((column + across) / sky->table_width - 0.5), r = sqrt(more(1 - y * y, 0));
    const double x = r * sin(turn), z = -r * cos(turn);
    return (vector){sky->turn[0] * x + sky->turn[1] * z, y, -sky->turn[1] * x + sky->turn[0] * z};
}

/* ---- suns and lamps --------------------------------------------------------------------------- */

/* Unit vector and distance to a light's middle, and its irradiance on a surface that faces it. */
static double light_middle(const shade_light *light, vector place, vector *direction, vector *irradiance) {
    *irradiance = vector_of(light->color);
    if (light->kind == SHADE_SUN) {
        *direction = vector_of(light->place);
        return HUGE_VAL;
    }
    const vector way = subtract(vector_of(light->place), place);
    const double square = dot(way, way), distance = sqrt(square);
    *direction = times(1 / distance, way);
    *irradiance = times(1 / square, *irradiance);
    return distance;
}

/* The same for a place on the light, drawn from the cone that it fills, evenly in solid angle. A lamp of radius r
 * has the radiance color / (pi r^2), so that far away it is as bright as the point that it replaces. */
static double light_draw(const shade_light *light, vector place, const double u[2], vector *direction,
                         vector *irradiance) {
    const double distance = light_middle(light, place, direction, irradiance);
    if (!(light->size > 0) || !(distance > 0)) return distance;
    double height = light->size, near = HUGE_VAL;
    const double sine = light->size / distance;
    if (light->kind == SHADE_LAMP) height = sine < 1 ? sine * sine / (1 + sqrt(1 - sine * sine)) : 1;
    const brdf_frame frame = brdf_frame_of(*direction);
    const vector way = brdf_cone(height, u);
    *direction = brdf_from(&frame, way);
    if (light->kind == SHADE_LAMP) {
        const double off = more(1 - way.z * way.z, 0);
        near = sine < 1 ? distance * (way.z - sqrt(more(sine * sine - off, 0))) : distance;
        *irradiance = times(2 * height / (sine * sine), *irradiance);
    }
    return near;
}

#endif
