/* patch.h - what is known about the triangles of each child of a mesh's nodes, beside its box.
 *
 * Triangles stand in the order of the tree, corners and all, a leaf in one piece of memory. A part of a smooth mesh
 * is nearly flat: between two planes across its mean normal it is far thinner than any box, which alone leaves all
 * that surround the nearest point to be looked at - the more, the finer the mesh.
 */
#ifndef BLOB_PATCH_H
#define BLOB_PATCH_H

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "builder.h"

/* More triangles than that are rarely thin. */
enum { PATCH_MOST = 4096 };

typedef struct patch_maker {
    const blob_scene *scene;
    const blob_mesh *mesh; /* at hand */
    blob_index *index;
    index_node *nodes;
    const int32_t *given; /* what leaves list before */
    int32_t *order;
    int32_t filled;
} patch_maker;

/* A leaf's triangles to the next free room. Returns its number. */
static int32_t patch_leaf(patch_maker *maker, int32_t child, int32_t count) {
    const int32_t begin = maker->filled, *ids = maker->given + ~child;
    while (maker->filled < begin + count || maker->filled % INDEX_WIDTH) {
        const int32_t i = maker->filled++ - begin, triangle = ids[i < count ? i : count - 1];
        const size_t at = (size_t)(begin + i);
        const int32_t *corners =
            maker->scene->mesh_triangles + 3 * ((size_t)maker->mesh->triangle_begin + (size_t)triangle);
        double *run = maker->index->mesh_corners + 9 * (at - at % INDEX_WIDTH) + at % INDEX_WIDTH;
        maker->order[at] = triangle;
        for (size_t corner = 0; corner < 3; corner++) {
            const double *v =
                maker->scene->mesh_vertices + 3 * ((size_t)maker->mesh->vertex_begin + (size_t)corners[corner]);
            for (size_t k = 0; k < 3; k++) run[(3 * corner + k) * INDEX_WIDTH] = v[k];
        }
    }
    return ~begin;
}

/* Corners of the triangle in place `at`: nine numbers, INDEX_WIDTH apart. */
static const double *patch_corners(const patch_maker *maker, int32_t at) {
    const size_t lane = (size_t)at % INDEX_WIDTH;
    return maker->index->mesh_corners + 9 * ((size_t)at - lane) + lane;
}

/* Mean normal of the triangles [begin, end), whichever way they are turned; somewhat shorter than 1, or 0. */
static void patch_normal(const patch_maker *maker, int32_t begin, int32_t end, float *n) {
    double sum[3] = {0.0, 0.0, 0.0};
    for (int32_t i = begin; i < end; i++) {
        const double *c = patch_corners(maker, i);
        double u[3], v[3], cross[3];
        for (int k = 0; k < 3; k++) {
            u[k] = c[(3 + k) * INDEX_WIDTH] - c[k * INDEX_WIDTH];
            v[k] = c[(6 + k) * INDEX_WIDTH] - c[k * INDEX_WIDTH];
        }
        for (int k = 0; k < 3; k++) cross[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
        const double sense = cross[0] * sum[0] + cross[1] * sum[1] + cross[2] * sum[2] < 0.0 ? -1.0 : 1.0;
        for (int k = 0; k < 3; k++) sum[k] += sense * cross[k];
    }
    const double length = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    const double scale = length > 0.0 ? (1.0 - 1e-6) / length : 0.0;
    for (int k = 0; k < 3; k++) n[k] = scale < DBL_MAX ? (float)(sum[k] * scale) : 0.0f;
}

/* The slab of child i of a node, around the triangles [begin, end). */
static void patch_slab(const patch_maker *maker, int32_t begin, int32_t end, index_slab *slab, int i) {
    float n[3];
    patch_normal(maker, begin, end, n);
    double least = DBL_MAX, most = -DBL_MAX;
    for (int32_t item = begin; item < end; item++) {
        const double *c = patch_corners(maker, item);
        for (int corner = 0; corner < 3; corner++) {
            double height = 0.0, size = 0.0;
            for (int k = 0; k < 3; k++) {
                const double x = c[(3 * corner + k) * INDEX_WIDTH];
                height += (double)n[k] * x;
                size += fabs(x);
            }
            least = height - 1e-15 * size < least ? height - 1e-15 * size : least;
            most = height + 1e-15 * size > most ? height + 1e-15 * size : most;
        }
    }
    for (int k = 0; k < 3; k++) slab->n[k][i] = n[k];
    slab->lo[i] = index_down(least);
    slab->hi[i] = index_up(most);
}

/* A node and all below it. */
static void patch_node(patch_maker *maker, int32_t number) {
    index_node *node = &maker->nodes[number];
    index_slab *slab = &maker->index->mesh_slabs[number - maker->index->mesh_node];
    for (int i = 0; i < INDEX_WIDTH; i++) {
        const int32_t begin = maker->filled;
        if (node->count[i] == 0) continue;
        if (node->child[i] >= 0) patch_node(maker, node->child[i]);
        else node->child[i] = patch_leaf(maker, node->child[i], node->count[i]);
        if (maker->filled - begin <= PATCH_MOST) patch_slab(maker, begin, maker->filled, slab, i);
    }
}

/* Room that the leaves of the mesh nodes take. */
static size_t patch_room(const blob_index *index, const index_node *nodes, int32_t node_count) {
    size_t room = 0;
    for (int32_t n = index->mesh_node; n < node_count; n++)
        for (int i = 0; i < INDEX_WIDTH; i++)
            if (nodes[n].child[i] < 0)
                room += ((size_t)nodes[n].count[i] + INDEX_WIDTH - 1) / INDEX_WIDTH * INDEX_WIDTH;
    return room;
}

/* Orders the triangles of all meshes anew and fills in what is known of them. 0: no memory. */
static int patch_make(blob_index *index, index_node *nodes, int32_t node_count) {
    const size_t room = patch_room(index, nodes, node_count), slabs = (size_t)(node_count - index->mesh_node);
    if (room > INT32_MAX) return 0;
    patch_maker maker = {.scene = index->scene, .index = index, .nodes = nodes, .given = index->mesh_order};
    maker.order = malloc((room + 1) * sizeof *maker.order);
    index->mesh_corners = aligned_alloc(64, (9 * room + INDEX_WIDTH) * sizeof *index->mesh_corners);
    index->mesh_slabs = calloc(slabs + 1, sizeof *index->mesh_slabs);
    if (!maker.order || !index->mesh_corners || !index->mesh_slabs) {
        free(maker.order);
        return 0;
    }
    for (int32_t m = 0; m < index->scene->mesh_count; m++) {
        maker.mesh = &index->scene->meshes[m];
        if (index->mesh_trees[m].root >= 0) patch_node(&maker, index->mesh_trees[m].root);
    }
    free(index->mesh_order);
    index->mesh_order = maker.order;
    index->triangle_count = maker.filled;
    return 1;
}

#endif
