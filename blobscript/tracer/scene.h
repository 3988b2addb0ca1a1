/* scene.h - the packed scene: what pack.py writes and the tracer reads.
 *
 * Packed coordinates: p = (P - center) * scale for a scene point P, with scale a power of two that
 * brings the extent of the scene near 1, so that rays and elements are small numbers whatever the
 * scale of the script (numerics.md: "recentre and scale by a power of two").
 *
 * An *element* is one density w * D(dist(p, skeleton) / reach). The elements of a surface are numbered
 * in the order of its tree (depth first), so every node covers a contiguous range of elements. A node
 * combines its children, elements or nodes, by sum, max, min or the smooth maximum (joint.h); what lies
 * beyond its reach counts as 0.
 */
#ifndef BLOB_SCENE_H
#define BLOB_SCENE_H

#include "blob.h"

/* ORDER KERNELS: the same order in pack.py. */
enum {
    KERNEL_SOFT2,
    KERNEL_SOFT3,
    KERNEL_WYVILL,
    KERNEL_GAUSS,
    KERNEL_GAUSS_C1,
    KERNEL_METABALL,
    KERNEL_USER,
    KERNEL_COUNT
};
/* ORDER OPS: the same order in pack.py. */
enum { OP_SUM, OP_MAX, OP_MIN, OP_SMOOTH_MAX, OP_SMOOTH_MIN };
/* ORDER SHAPES: the same order in pack.py. Plain points need no shape. */
enum { SHAPE_POINT, SHAPE_LINE, SHAPE_TRIANGLE, SHAPE_MESH };

/* A polynomial piece of a user kernel, see ir.KernelPiece. */
enum { PIECE_DEGREE = 23 };
typedef struct blob_piece {
    double s_lo, s_hi, centre, half;
    /* value and slope in s at s_hi, of this piece and the next (0 beyond the reach), smaller and larger */
    double end_value_lo, end_value_hi, end_slope_lo, end_slope_hi;
    /* of all joints up to s_hi, within runs: by how much slopes change against the run's curvature, and what
     * that and the jumps of values can make of the values in all */
    double kinks, defects;
    double coefficients[PIECE_DEGREE + 1];
    int32_t degree; /* <= PIECE_DEGREE */
    int32_t in_s;   /* variable is s = r^2, else r */
    int32_t convex; /* of D in s: 1 convex, -1 concave, 0 linear */
    int32_t falling;
    /* pieces that are convex together, or (negative) concave: numbered from 1 in each kernel */
    int32_t run;
    int32_t joined; /* the run goes on behind s_hi */
} blob_piece;

typedef struct blob_kernel {
    int32_t id;          /* KERNEL_* */
    int32_t first_piece; /* KERNEL_USER: pieces [first, first + count), covering 0 <= r <= 1 */
    int32_t piece_count;
    int32_t reserved;
    double a;         /* of the Gaussians */
    double norm;      /* gauss_c1: 1 / (1 - e^-a (1 + a)) */
    double tail;      /* gauss_c1: e^-a */
    double lipschitz; /* max |dD/dr| */
} blob_kernel;

/* A skeleton that is not a plain point, or one with a map. */
typedef struct blob_shape {
    int32_t kind;   /* SHAPE_* */
    int32_t matrix; /* index into matrices, or -1 */
    int32_t mesh;   /* SHAPE_MESH: index into meshes, or -1 */
    int32_t reserved;
    double box[6]; /* packed coordinates: where the density is not 0; lo x, y, z, hi x, y, z */
    double b[3];   /* SHAPE_LINE: the other end; SHAPE_TRIANGLE: second corner */
    double c[3];   /* SHAPE_TRIANGLE: third corner */
} blob_shape;

typedef struct blob_surface {
    double threshold;
    int32_t element_begin, element_end; /* elements [begin, end) */
    int32_t node_begin, node_end;       /* nodes [begin, end); the first is the root */
    int32_t material;
    int32_t reserved;
} blob_surface;

typedef struct blob_node {
    int32_t op;       /* OP_* */
    int32_t parent;   /* -1: root */
    int32_t children; /* how many, elements and nodes together */
    int32_t depth;    /* root: 0 */
    int32_t element_begin, element_end;
} blob_node;

/* Triangles for nearest-point queries. A flat triangle is a line or a point. Where solid (distance 0
 * inside): closed and counter-clockwise, and mesh_neighbors and mesh_normals tell the side. */
typedef struct blob_mesh {
    int32_t vertex_begin, vertex_end;     /* into mesh_vertices and mesh_normals, triples */
    int32_t triangle_begin, triangle_end; /* into mesh_triangles and mesh_neighbors, triples */
    int32_t solid, convex;                /* convex: of the solid */
} blob_mesh;

struct blob_scene {
    int32_t abi;
    int32_t surface_count, node_count, element_count, kernel_count, piece_count, shape_count, matrix_count;
    int32_t mesh_count, mesh_vertex_count, mesh_triangle_count;
    int32_t reserved;
    double center[3], scale;
    double lo[3], hi[3]; /* packed box around all elements */

    const blob_surface *surfaces;
    const blob_node *nodes;
    const blob_kernel *kernels;
    const blob_piece *pieces;
    const blob_shape *shapes;
    const double *matrices; /* 12 each: packed coordinates -> skeleton space of that element, row-major 3x4 */
    const blob_mesh *meshes;
    const double *mesh_vertices;
    const int32_t *mesh_triangles; /* counted from vertex_begin */
    const int32_t *mesh_neighbors; /* across edge i, i + 1: counted from triangle_begin; NULL: no solids */
    const double *mesh_normals;    /* of vertices, weighted by angles; NULL: no solids */

    /* One entry per element; x, y, z is the point, the first end or the first corner. */
    const double *x, *y, *z;
    const double *weight;
    const double *inverse_reach2; /* 1 / R^2, packed (or skeleton space, where there is a matrix) */
    const double *support;        /* distance at which the density ends, same space as R */
    const uint16_t *kernel;       /* index into kernels */
    const int32_t *node;          /* parent */
    const int32_t *paint;         /* material or -1: the surface's */
    const int32_t *shape;         /* index into shapes or -1: plain point; NULL: all plain points */
};

#endif
