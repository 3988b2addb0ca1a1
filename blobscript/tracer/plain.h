/* plain.h - pictures whose rays end where they hit: shaded LANES samples at a time.
 *
 * Where the light from everywhere is even and no ray is reflected, bent or filtered, a sample needs one ray, and one
 * to each light. Leaves out what else shade.c does: queues, keys, recursion, textures, floor and fog. The light is
 * that of shade.c to the last bits of a double. One copy per instruction set, with the same results.
 */
#ifndef BLOB_PLAIN_H
#define BLOB_PLAIN_H

#include "shade.h"

enum { PLAIN_TIMED = 37 };

/* What a tile is made with. rgba: 4 floats a pixel of the tile; light: NULL, or the sums of its direct and indirect
 * light, 6 numbers a pixel.
 * seconds: processor time of the tracer and of all, of every PLAIN_TIMED-th block: asking takes its time, too. */
typedef struct plain_tile {
    const blob_scene *scene;
    const blob_index *index;
    const blob_query *query;
    const shade_picture *picture;
    int32_t x0, y0, x1, y1;
    float *rgba;
    double *light;
    double seconds[2];
    size_t blocks;
} plain_tile;

/* Can a picture be made so? */
int plain_enough(const shade_picture *picture, const blob_query *query);

#define PLAIN_DECLARE(ISA) blob_status plain_make_##ISA(plain_tile *tile);
PLAIN_DECLARE(baseline)
#ifdef BLOB_X86
PLAIN_DECLARE(v3)
PLAIN_DECLARE(v4)
#endif

#endif
