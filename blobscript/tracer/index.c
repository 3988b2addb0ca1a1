/* index.c - builds and frees indexes: what all kinds of them share. */
#include <math.h>
#include <stdlib.h>

#include "builder.h"
#include "patch.h"

/* Items whose elements, spheres and boxes are some megabytes. */
enum { INDEX_LARGE = 1 << 14 };

/* One leaf of everything: no index at all. */
static index_slot index_build_none(index_builder *builder) {
    return index_leaf(builder, builder->items, builder->count);
}

static const struct {
    index_slot (*build)(index_builder *builder);
    int32_t repeats;
} INDEX_KINDS[] = {[BLOB_INDEX_BVH] = {bvh_build, 0},
                   [BLOB_INDEX_GRID] = {grid_build, 1},
                   [BLOB_INDEX_OCTREE] = {octree_build, 0},
                   [BLOB_INDEX_BSP] = {bsp_build, 1},
                   [BLOB_INDEX_NONE] = {index_build_none, 0}};

/* ---- nodes and leaves ------------------------------------------------------------------------- */

/* Room for `need` entries, half as many again when it grows. NULL: no memory, or too many for 32 bits. */
static void *index_grown(void *data, int32_t *room, size_t need, size_t size) {
    if (need <= (size_t)*room) return data;
    size_t bigger = (size_t)*room + (size_t)*room / 2 + 64;
    if (bigger < need) bigger = need;
    if (bigger > INT32_MAX) bigger = INT32_MAX;
    void *fresh = need <= bigger ? realloc(data, bigger * size) : NULL;
    if (fresh) *room = (int32_t)bigger;
    return fresh;
}

index_slot index_open_leaf(index_builder *builder, int32_t count, int32_t **ids) {
    const index_slot slot = {INDEX_EMPTY, ~builder->order_count, count};
    int32_t *order =
        index_grown(builder->order, &builder->order_room, (size_t)builder->order_count + (size_t)count, sizeof *order);
    *ids = NULL;
    if (!order) {
        builder->failed = 1;
        return slot;
    }
    builder->order = order;
    *ids = order + builder->order_count;
    builder->order_count += count;
    return slot;
}

index_slot index_leaf(index_builder *builder, const index_item *items, int32_t count) {
    int32_t *ids;
    index_slot slot = index_open_leaf(builder, count, &ids);
    for (int32_t i = 0; ids && i < count; i++) {
        ids[i] = items[i].id;
        index_grow(&slot.box, &items[i].box);
    }
    return slot;
}

static index_slot index_new_node(index_builder *builder, const index_slot *slots, int count) {
    const index_slot none = {INDEX_EMPTY, -1, 0};
    index_node *nodes =
        index_grown(builder->nodes, &builder->node_room, (size_t)builder->node_count + 1, sizeof *nodes);
    if (!nodes) {
        builder->failed = 1;
        return none;
    }
    builder->nodes = nodes;
    index_slot all = {INDEX_EMPTY, builder->node_count++, 1};
    index_node *node = &nodes[all.child];
    for (int i = 0; i < INDEX_WIDTH; i++) {
        const index_slot *slot = i < count ? &slots[i] : &none;
        for (int k = 0; k < 3; k++) node->lo[k][i] = slot->box.lo[k], node->hi[k][i] = slot->box.hi[k];
        node->child[i] = slot->child;
        node->count[i] = slot->count;
        index_grow(&all.box, &slot->box);
    }
    return all;
}

index_slot index_join(index_builder *builder, const index_slot *slots, int count) {
    return count == 1 ? slots[0] : index_new_node(builder, slots, count);
}

/* Give back the room that was not needed. */
static void *index_fit(void *data, int32_t count, size_t size) {
    void *fitted = count > 0 ? realloc(data, (size_t)count * size) : NULL;
    return fitted ? fitted : data;
}

/* ---- boxes of elements and triangles -------------------------------------------------------------- */

/* Box of element e in packed coordinates: where its density is not zero. */
static void index_element_box(const blob_scene *scene, int32_t e, double *lo, double *hi) {
    if (scene->shape && scene->shape[e] >= 0) {
        const blob_shape *shape = &scene->shapes[scene->shape[e]];
        for (int k = 0; k < 3; k++) lo[k] = shape->box[k], hi[k] = shape->box[3 + k];
        return;
    }
    const double c[3] = {scene->x[e], scene->y[e], scene->z[e]}, r = scene->support[e] * (1.0 + 1e-15);
    for (int k = 0; k < 3; k++) lo[k] = c[k] - r, hi[k] = c[k] + r;
}

static void index_element_items(index_builder *builder, const blob_scene *scene, const blob_surface *surface) {
    builder->count = surface->element_end - surface->element_begin;
    builder->box = INDEX_EMPTY;
    double reach = 0.0;
    for (int32_t i = 0; i < builder->count; i++) {
        double lo[3], hi[3], widest = 0.0;
        index_item *item = &builder->items[i];
        item->id = surface->element_begin + i;
        item->count = 1;
        index_element_box(scene, item->id, lo, hi);
        for (int k = 0; k < 3; k++) {
            item->box.lo[k] = index_down(lo[k]);
            item->box.hi[k] = index_up(hi[k]);
            if (hi[k] - lo[k] > widest) widest = hi[k] - lo[k];
        }
        index_grow(&builder->box, &item->box);
        /* first steps along a ray are of that size: of a mesh, what is felt of it, not how large it is */
        const int32_t shape = scene->shape ? scene->shape[item->id] : -1;
        const int mesh = shape >= 0 && scene->shapes[shape].kind == SHAPE_MESH && scene->shapes[shape].matrix < 0;
        reach += mesh && scene->support[item->id] < 0.5 * widest ? scene->support[item->id] : 0.5 * widest;
    }
    builder->reach = builder->count > 0 ? reach / builder->count : 0.0;
}

static void index_triangle_items(index_builder *builder, const blob_scene *scene, const blob_mesh *mesh) {
    builder->count = mesh->triangle_end - mesh->triangle_begin;
    builder->box = INDEX_EMPTY;
    for (int32_t i = 0; i < builder->count; i++) {
        const int32_t *ids = scene->mesh_triangles + 3 * ((size_t)mesh->triangle_begin + (size_t)i);
        index_item *item = &builder->items[i];
        item->id = i;
        item->count = 1;
        item->box = INDEX_EMPTY;
        for (int corner = 0; corner < 3; corner++) {
            const double *v = scene->mesh_vertices + 3 * ((size_t)mesh->vertex_begin + (size_t)ids[corner]);
            const index_box box = {{index_down(v[0]), index_down(v[1]), index_down(v[2])},
                                   {index_up(v[0]), index_up(v[1]), index_up(v[2])}};
            index_grow(&item->box, &box);
        }
        index_grow(&builder->box, &item->box);
    }
}

/* ---- trees -------------------------------------------------------------------------------------------- */

/* The tree over the builder's items. */
static void index_plant(index_builder *builder, index_slot (*build)(index_builder *builder), index_tree *tree) {
    tree->root = -1;
    if (builder->count == 0) return;
    index_slot top = build(builder);
    if (top.child < 0 && !builder->failed) top = index_new_node(builder, &top, 1);
    tree->root = top.child;
    tree->typical_reach = builder->reach;
    for (int k = 0; k < 3; k++) tree->lo[k] = (double)builder->box.lo[k], tree->hi[k] = (double)builder->box.hi[k];
}

/* How deep the nodes of a surface nest; one sum of elements needs no walk and counts as 0. */
static int32_t index_nesting(const blob_scene *scene, const blob_surface *surface) {
    if (surface->node_end - surface->node_begin == 1 && scene->nodes[surface->node_begin].op == OP_SUM) return 0;
    int32_t depth = 0;
    for (int32_t n = surface->node_begin; n < surface->node_end; n++)
        if (scene->nodes[n].depth + 1 > depth) depth = scene->nodes[n].depth + 1;
    return depth;
}

/* A plain point, or a line that is not mapped. */
static int index_is_simple(const blob_scene *scene, int32_t e) {
    if (!scene->shape || scene->shape[e] < 0) return 1;
    const blob_shape *shape = &scene->shapes[scene->shape[e]];
    return shape->kind == SHAPE_LINE && shape->matrix < 0;
}

/* The kind of kernel that all elements have, where they are points and lines under one sum; else -1. */
static int32_t index_kind(const blob_scene *scene, const blob_surface *surface) {
    if (index_nesting(scene, surface) > 0 || surface->element_begin == surface->element_end) return -1;
    const int32_t kind = scene->kernels[scene->kernel[surface->element_begin]].id;
    for (int32_t e = surface->element_begin; e < surface->element_end; e++)
        if (!index_is_simple(scene, e) || scene->kernels[scene->kernel[e]].id != kind) return -1;
    return kind;
}

static int index_has_lines(const blob_scene *scene, const blob_surface *surface) {
    for (int32_t e = surface->element_begin; e < surface->element_end; e++)
        if (scene->shape && scene->shape[e] >= 0) return 1;
    return 0;
}

static void index_surfaces(blob_index *index, index_builder *builder) {
    const blob_scene *scene = index->scene;
    for (int32_t s = 0; s < scene->surface_count && !builder->failed; s++) {
        index_element_items(builder, scene, &scene->surfaces[s]);
        index_plant(builder, INDEX_KINDS[index->kind].build, &index->trees[s]);
        index->trees[s].depth = index_nesting(scene, &scene->surfaces[s]);
        index->trees[s].kind = index_kind(scene, &scene->surfaces[s]);
        index->trees[s].lines = index_has_lines(scene, &scene->surfaces[s]);
    }
    index->order = index_fit(builder->order, builder->order_count, sizeof *index->order);
    index->item_count = builder->order_count;
    builder->order = NULL;
    builder->order_count = builder->order_room = 0;
}

static void index_meshes(blob_index *index, index_builder *builder) {
    const blob_scene *scene = index->scene;
    index->mesh_node = builder->node_count;
    for (int32_t m = 0; m < scene->mesh_count && !builder->failed; m++) {
        index_triangle_items(builder, scene, &scene->meshes[m]);
        index_plant(builder, bvh_build, &index->mesh_trees[m]);
    }
    index->mesh_order = builder->order;
    index->triangle_count = builder->order_count;
    builder->order = NULL;
    if (!builder->failed) builder->failed = !patch_make(index, builder->nodes, builder->node_count);
}

/* Bounding spheres of the items, readable 8 at a time. */
static blob_status index_spheres(blob_index *index) {
    const blob_scene *scene = index->scene;
    const size_t room = (size_t)index->item_count + INDEX_WIDTH;
    index->x = calloc(room, sizeof(double));
    index->y = calloc(room, sizeof(double));
    index->z = calloc(room, sizeof(double));
    index->reach = calloc(room, sizeof(double));
    if (!index->x || !index->y || !index->z || !index->reach) return BLOB_NO_MEMORY;
    for (int32_t i = 0; i < index->item_count; i++) {
        const int32_t e = index->order[i];
        if (scene->shape && scene->shape[e] >= 0) {
            double lo[3], hi[3], half2 = 0.0;
            index_element_box(scene, e, lo, hi);
            for (int k = 0; k < 3; k++) half2 += 0.25 * (hi[k] - lo[k]) * (hi[k] - lo[k]);
            index->x[i] = 0.5 * (lo[0] + hi[0]);
            index->y[i] = 0.5 * (lo[1] + hi[1]);
            index->z[i] = 0.5 * (lo[2] + hi[2]);
            index->reach[i] = sqrt(half2);
        } else {
            index->x[i] = scene->x[e];
            index->y[i] = scene->y[e];
            index->z[i] = scene->z[e];
            index->reach[i] = scene->support[e];
        }
    }
    return BLOB_OK;
}

/* ---- the public functions ------------------------------------------------------------------------------- */

/* Items of the largest surface or mesh. */
static size_t index_most_items(const blob_scene *scene) {
    int32_t most = 0;
    for (int32_t s = 0; s < scene->surface_count; s++) {
        const int32_t count = scene->surfaces[s].element_end - scene->surfaces[s].element_begin;
        if (count > most) most = count;
    }
    for (int32_t m = 0; m < scene->mesh_count; m++) {
        const int32_t count = scene->meshes[m].triangle_end - scene->meshes[m].triangle_begin;
        if (count > most) most = count;
    }
    return (size_t)most;
}

static blob_status index_fill(blob_index *index) {
    const blob_scene *scene = index->scene;
    index->tree_count = scene->surface_count;
    index->mesh_count = scene->mesh_count;
    index->repeats = INDEX_KINDS[index->kind].repeats;
    index->trees = calloc((size_t)scene->surface_count + 1, sizeof *index->trees);
    index->mesh_trees = calloc((size_t)scene->mesh_count + 1, sizeof *index->mesh_trees);
    index_builder builder = {.items = malloc((index_most_items(scene) + 1) * sizeof *builder.items)};
    blob_status status = BLOB_NO_MEMORY;
    if (index->trees && index->mesh_trees && builder.items) {
        index_surfaces(index, &builder);
        index_meshes(index, &builder);
        if (!builder.failed) status = BLOB_OK;
    }
    index->nodes = index_fit(builder.nodes, builder.node_count, sizeof *index->nodes);
    index->node_count = builder.node_count;
    index->is_large = index->item_count >= INDEX_LARGE;
    free(builder.items);
    return status == BLOB_OK ? index_spheres(index) : status;
}

BLOB_API blob_status blob_index_build(const blob_scene *scene, int32_t kind, blob_index **out) {
    if (!scene || !out || kind < BLOB_INDEX_BVH || kind > BLOB_INDEX_NONE) return BLOB_BAD_ARGUMENT;
    *out = NULL;
    blob_index *index = calloc(1, sizeof *index);
    if (!index) return BLOB_NO_MEMORY;
    index->scene = scene;
    index->kind = kind;
    const blob_status status = index_fill(index);
    if (status == BLOB_OK) {
        *out = index;
    } else {
        blob_index_free(index);
    }
    return status;
}

BLOB_API void blob_index_free(blob_index *index) {
    if (!index) return;
    free(index->trees);
    free(index->mesh_trees);
    free(index->mesh_order);
    free(index->mesh_corners);
    free(index->mesh_slabs);
    free(index->nodes);
    free(index->order);
    free(index->x);
    free(index->y);
    free(index->z);
    free(index->reach);
    free(index);
}

BLOB_API size_t blob_index_bytes(const blob_index *index) {
    return sizeof *index + (size_t)index->tree_count * sizeof *index->trees +
           (size_t)index->node_count * sizeof *index->nodes +
           (size_t)index->item_count * (sizeof *index->order + 4 * sizeof(double)) +
           (size_t)index->mesh_count * sizeof *index->mesh_trees +
           (size_t)index->triangle_count * (sizeof *index->mesh_order + 9 * sizeof *index->mesh_corners) +
           (size_t)(index->node_count - index->mesh_node) * sizeof *index->mesh_slabs;
}
