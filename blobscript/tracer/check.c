/* check.c - is this packed scene safe to trace? Every index in range, every number usable, and the tree
 * laid out as scene.h says: nodes in depth-first order over contiguous elements. A scene that passes can
 * be traced without reading or writing out of bounds, whatever else it may be. */
#include <math.h>

#include "scene.h"

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) return 0;                                                                                    \
    } while (0)

static int check_counts(const blob_scene *s) {
    CHECK(s->abi == BLOB_ABI);
    const int32_t counts[] = {s->surface_count,     s->node_count,         s->element_count, s->kernel_count,
                              s->piece_count,       s->shape_count,        s->matrix_count,  s->mesh_count,
                              s->mesh_vertex_count, s->mesh_triangle_count};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) CHECK(counts[i] >= 0);
    CHECK(s->element_count <= INT32_MAX / 4);
    CHECK(s->surface_count == 0 || s->surfaces);
    CHECK(s->node_count == 0 || s->nodes);
    CHECK(s->kernel_count == 0 || s->kernels);
    CHECK(s->piece_count == 0 || s->pieces);
    CHECK(s->shape_count == 0 || s->shapes);
    CHECK(s->matrix_count == 0 || s->matrices);
    CHECK(s->mesh_count == 0 || s->meshes);
    CHECK(s->mesh_vertex_count == 0 || s->mesh_vertices);
    CHECK(s->mesh_triangle_count == 0 || s->mesh_triangles);
    CHECK(s->element_count == 0 ||
          (s->x && s->y && s->z && s->weight && s->inverse_reach2 && s->support && s->kernel && s->node && s->paint));
    for (int k = 0; k < 3; k++)
        CHECK(isfinite(s->center[k]) && isfinite(s->lo[k]) && isfinite(s->hi[k]) && s->lo[k] <= s->hi[k]);
    return isfinite(s->scale) && s->scale > 0.0;
}

static int check_kernels(const blob_scene *s) {
    for (int32_t i = 0; i < s->piece_count; i++) {
        const blob_piece *p = &s->pieces[i];
        CHECK(p->degree >= 0 && p->degree <= PIECE_DEGREE);
        CHECK(isfinite(p->centre) && isfinite(p->half) && p->half > 0.0);
        CHECK(p->s_lo >= 0.0 && p->s_lo <= p->s_hi && p->s_hi <= 1.0);
        CHECK(p->end_value_lo <= p->end_value_hi && p->end_slope_lo <= p->end_slope_hi);
        CHECK(isfinite(p->kinks) && p->kinks >= 0.0 && isfinite(p->defects) && p->defects >= 0.0);
        for (int k = 0; k <= p->degree; k++) CHECK(isfinite(p->coefficients[k]));
    }
    for (int32_t i = 0; i < s->kernel_count; i++) {
        const blob_kernel *k = &s->kernels[i];
        CHECK(k->id >= 0 && k->id < KERNEL_COUNT);
        CHECK(isfinite(k->lipschitz) && k->lipschitz >= 0.0);
        if (k->id == KERNEL_GAUSS || k->id == KERNEL_GAUSS_C1) CHECK(isfinite(k->a) && k->a > 0.0);
        if (k->id == KERNEL_GAUSS_C1) CHECK(isfinite(k->norm) && isfinite(k->tail));
        if (k->id != KERNEL_USER) continue;
        CHECK(k->first_piece >= 0 && k->piece_count > 0 && k->piece_count <= s->piece_count - k->first_piece);
    }
    return 1;
}

static int check_shapes(const blob_scene *s) {
    for (int32_t i = 0; i < s->matrix_count; i++)
        for (int k = 0; k < 12; k++) CHECK(isfinite(s->matrices[12 * (size_t)i + (size_t)k]));
    for (int32_t i = 0; i < s->shape_count; i++) {
        const blob_shape *p = &s->shapes[i];
        CHECK(p->kind >= SHAPE_POINT && p->kind <= SHAPE_MESH);
        CHECK(p->matrix >= -1 && p->matrix < s->matrix_count);
        CHECK(p->kind != SHAPE_MESH || (p->mesh >= 0 && p->mesh < s->mesh_count));
        for (int k = 0; k < 3; k++) {
            CHECK(isfinite(p->box[k]) && isfinite(p->box[3 + k]) && p->box[k] <= p->box[3 + k]);
            CHECK(isfinite(p->b[k]) && isfinite(p->c[k]));
        }
    }
    for (int32_t i = 0; i < s->mesh_count; i++) {
        const blob_mesh *m = &s->meshes[i];
        CHECK(m->vertex_begin >= 0 && m->vertex_begin < m->vertex_end && m->vertex_end <= s->mesh_vertex_count);
        CHECK(m->triangle_begin >= 0 && m->triangle_begin < m->triangle_end &&
              m->triangle_end <= s->mesh_triangle_count);
        for (size_t k = 3 * (size_t)m->triangle_begin; k < 3 * (size_t)m->triangle_end; k++)
            CHECK(s->mesh_triangles[k] >= 0 && s->mesh_triangles[k] < m->vertex_end - m->vertex_begin);
        if (!m->solid) continue;
        CHECK(s->mesh_neighbors && s->mesh_normals);
        for (size_t k = 3 * (size_t)m->triangle_begin; k < 3 * (size_t)m->triangle_end; k++)
            CHECK(s->mesh_neighbors[k] >= 0 && s->mesh_neighbors[k] < m->triangle_end - m->triangle_begin);
        for (size_t k = 3 * (size_t)m->vertex_begin; k < 3 * (size_t)m->vertex_end; k++)
            CHECK(isfinite(s->mesh_normals[k]));
    }
    for (size_t k = 0; k < 3 * (size_t)s->mesh_vertex_count; k++) CHECK(isfinite(s->mesh_vertices[k]));
    return 1;
}

/* Depth first: each node hangs below the last one of the depth above it, behind what is already there. */
static int check_nodes(const blob_scene *s, const blob_surface *surface) {
    for (int32_t n = surface->node_begin; n < surface->node_end; n++) {
        const blob_node *node = &s->nodes[n];
        CHECK(node->op >= OP_SUM && node->op <= OP_SMOOTH_MIN && node->children >= 0);
        CHECK(node->element_begin <= node->element_end);
        if (n == surface->node_begin) {
            CHECK(node->parent == -1 && node->depth == 0);
            CHECK(node->element_begin == surface->element_begin && node->element_end == surface->element_end);
        } else {
            CHECK(node->parent >= surface->node_begin && node->parent < n);
            const blob_node *parent = &s->nodes[node->parent];
            CHECK(node->depth == parent->depth + 1);
            /* up from the last node: its parents are checked, so this ends, at the root at the latest */
            int32_t sibling = -1, open = n - 1;
            while (s->nodes[open].depth >= node->depth) sibling = open, open = s->nodes[open].parent;
            CHECK(open == node->parent);
            const int32_t taken = sibling < 0 ? parent->element_begin : s->nodes[sibling].element_end;
            CHECK(node->element_begin >= taken && node->element_end <= parent->element_end);
        }
    }
    return 1;
}

/* The box where the element's density is not 0 must fit into the floats of an index, with room to spare. */
static int check_place(const blob_scene *s, int32_t e) {
    const double most = 1e30, support = s->support[e];
    const int32_t shape = s->shape ? s->shape[e] : -1;
    if (shape < 0) return fabs(s->x[e]) < most && fabs(s->y[e]) < most && fabs(s->z[e]) < most && support < most;
    for (int k = 0; k < 6; k++) CHECK(fabs(s->shapes[shape].box[k]) < most);
    return 1;
}

/* Every element belongs to the innermost node around it. */
static int check_elements(const blob_scene *s, const blob_surface *surface) {
    int32_t next = surface->node_begin, open = -1;
    for (int32_t e = surface->element_begin; e < surface->element_end; e++) {
        while (open >= 0 && e >= s->nodes[open].element_end) open = s->nodes[open].parent;
        for (; next < surface->node_end && s->nodes[next].element_begin <= e; next++)
            if (s->nodes[next].element_end > e) open = next;
        CHECK(s->node[e] == open);
        CHECK(isfinite(s->x[e]) && isfinite(s->y[e]) && isfinite(s->z[e]) && isfinite(s->weight[e]));
        CHECK(isfinite(s->inverse_reach2[e]) && s->inverse_reach2[e] > 0.0);
        CHECK(isfinite(s->support[e]) && s->support[e] > 0.0);
        CHECK(s->kernel[e] < s->kernel_count);
        CHECK(s->paint[e] >= -1);
        if (s->shape) CHECK(s->shape[e] >= -1 && s->shape[e] < s->shape_count);
        CHECK(check_place(s, e));
    }
    return 1;
}

BLOB_API blob_status blob_check(const blob_scene *s) {
    if (!s) return BLOB_BAD_ARGUMENT;
    if (!check_counts(s) || !check_kernels(s) || !check_shapes(s)) return BLOB_BAD_SCENE;
    int32_t element = 0, node = 0;
    for (int32_t i = 0; i < s->surface_count; i++) {
        const blob_surface *surface = &s->surfaces[i];
        const int in_order = surface->element_begin == element && surface->element_end >= element &&
                             surface->element_end <= s->element_count && surface->node_begin == node &&
                             surface->node_end > node && surface->node_end <= s->node_count;
        if (!in_order || !isfinite(surface->threshold) || surface->material < 0) return BLOB_BAD_SCENE;
        if (!check_nodes(s, surface) || !check_elements(s, surface)) return BLOB_BAD_SCENE;
        element = surface->element_end;
        node = surface->node_end;
    }
    return element == s->element_count && node == s->node_count ? BLOB_OK : BLOB_BAD_SCENE;
}
