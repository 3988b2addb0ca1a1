/* bvh.c - bounding volume hierarchy, the default index.
 *
 * Top down: the largest part of a node's items is split in two at the best of 16 bins along the widest
 * axis of their centres (surface area heuristic, Wald 2007) until there are eight parts. No sorting, so
 * a level costs one pass to bin and one to partition: 1 000 000 items in well under a second.
 * Deterministic: the tree depends on the scene alone.
 */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "index.h"

enum { BVH_BINS = 16 };

typedef struct bvh_box {
    float lo[3], hi[3];
} bvh_box;

typedef struct bvh_item {
    bvh_box box;
    int32_t element;
} bvh_item;

typedef struct bvh_part {
    int32_t first, count;
    bvh_box box;
    float center_lo[3], center_hi[3]; /* of the doubled centres lo + hi */
    float cost;                       /* area * count; 0: do not split */
} bvh_part;

typedef struct bvh_build {
    bvh_item *items;
    index_node *nodes;
    int32_t node_count, node_room;
    int failed;
} bvh_build;

static const bvh_box BVH_EMPTY = {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};

static void bvh_grow(bvh_box *box, const bvh_box *other) {
    for (int k = 0; k < 3; k++) {
        if (other->lo[k] < box->lo[k]) box->lo[k] = other->lo[k];
        if (other->hi[k] > box->hi[k]) box->hi[k] = other->hi[k];
    }
}

static float bvh_area(const bvh_box *box) {
    const float x = box->hi[0] - box->lo[0], y = box->hi[1] - box->lo[1], z = box->hi[2] - box->lo[2];
    return x < 0.0f ? 0.0f : x * y + y * z + z * x;
}

static float bvh_down(double value) {
    const float f = (float)value;
    return (double)f > value ? nextafterf(f, -FLT_MAX) : f;
}

static float bvh_up(double value) {
    const float f = (float)value;
    return (double)f < value ? nextafterf(f, FLT_MAX) : f;
}

/* Bounds of a part's items and of their centres. */
static void bvh_measure(const bvh_item *items, bvh_part *part) {
    part->box = BVH_EMPTY;
    for (int k = 0; k < 3; k++) part->center_lo[k] = FLT_MAX, part->center_hi[k] = -FLT_MAX;
    for (int32_t i = part->first; i < part->first + part->count; i++) {
        bvh_grow(&part->box, &items[i].box);
        for (int k = 0; k < 3; k++) {
            const float c = items[i].box.lo[k] + items[i].box.hi[k];
            if (c < part->center_lo[k]) part->center_lo[k] = c;
            if (c > part->center_hi[k]) part->center_hi[k] = c;
        }
    }
    part->cost = part->count > INDEX_LEAF ? (bvh_area(&part->box) + FLT_MIN) * (float)part->count : 0.0f;
}

static int bvh_bin(float center, float lo, float per_bin) {
    const int bin = (int)((center - lo) * per_bin);
    return bin < 0 ? 0 : bin >= BVH_BINS ? BVH_BINS - 1 : bin;
}

/* The bin border with the least area * count on both sides; items of bins <= the result go left. */
static int bvh_best_border(const bvh_box *boxes, const int32_t *counts) {
    float right_cost[BVH_BINS];
    bvh_box box = BVH_EMPTY;
    int32_t count = 0;
    for (int b = BVH_BINS - 1; b > 0; b--) {
        bvh_grow(&box, &boxes[b]);
        count += counts[b];
        right_cost[b] = bvh_area(&box) * (float)count;
    }
    box = BVH_EMPTY;
    count = 0;
    int best = 0;
    float best_cost = FLT_MAX;
    for (int b = 0; b < BVH_BINS - 1; b++) {
        bvh_grow(&box, &boxes[b]);
        count += counts[b];
        const float cost = bvh_area(&box) * (float)count + right_cost[b + 1];
        if (counts[b] > 0 && cost < best_cost) best_cost = cost, best = b;
    }
    return best;
}

/* Split a part in two; both get items. */
static void bvh_split(bvh_item *items, bvh_part *left, bvh_part *right, int depth) {
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (left->center_hi[k] - left->center_lo[k] > left->center_hi[axis] - left->center_lo[axis]) axis = k;
    const float lo = left->center_lo[axis], width = left->center_hi[axis] - lo;
    const int32_t first = left->first, end = first + left->count;
    int32_t middle = first + left->count / 2; /* coincident centres: by count */
    const float per_bin = (float)BVH_BINS / width;
    if (width > 0.0f && per_bin < FLT_MAX && depth <= INDEX_DEEP) {
        bvh_box boxes[BVH_BINS];
        int32_t counts[BVH_BINS] = {0};
        for (int b = 0; b < BVH_BINS; b++) boxes[b] = BVH_EMPTY;
        for (int32_t i = first; i < end; i++) {
            const int b = bvh_bin(items[i].box.lo[axis] + items[i].box.hi[axis], lo, per_bin);
            counts[b]++;
            bvh_grow(&boxes[b], &items[i].box);
        }
        const int border = bvh_best_border(boxes, counts);
        int32_t i = first, j = end;
        while (i < j) {
            if (bvh_bin(items[i].box.lo[axis] + items[i].box.hi[axis], lo, per_bin) <= border) {
                i++;
            } else {
                const bvh_item swap = items[i];
                items[i] = items[--j];
                items[j] = swap;
            }
        }
        if (i > first && i < end) middle = i;
    }
    right->first = middle;
    right->count = end - middle;
    left->count = middle - first;
    bvh_measure(items, left);
    bvh_measure(items, right);
}

static int32_t bvh_new_node(bvh_build *build) {
    if (build->node_count == build->node_room) {
        const int32_t room = build->node_room ? build->node_room + build->node_room / 2 : 64;
        index_node *nodes = realloc(build->nodes, (size_t)room * sizeof *nodes);
        if (!nodes) {
            build->failed = 1;
            return -1;
        }
        build->nodes = nodes;
        build->node_room = room;
    }
    return build->node_count++;
}

/* One node over the items of `whole`, and all below it. */
static int32_t bvh_node(bvh_build *build, const bvh_part *whole, int depth) {
    bvh_part parts[INDEX_WIDTH];
    int count = 1;
    parts[0] = *whole;
    while (count < INDEX_WIDTH) {
        int widest = 0;
        for (int i = 1; i < count; i++)
            if (parts[i].cost > parts[widest].cost) widest = i;
        if (parts[widest].count <= INDEX_LEAF) break;
        bvh_split(build->items, &parts[widest], &parts[count], depth);
        count++;
    }
    const int32_t at = bvh_new_node(build);
    if (at < 0) return at;
    for (int i = 0; i < INDEX_WIDTH; i++) {
        int32_t child = -1;
        const bvh_box box = i < count ? parts[i].box : BVH_EMPTY;
        if (i < count) child = parts[i].count > INDEX_LEAF ? bvh_node(build, &parts[i], depth + 1) : ~parts[i].first;
        if (build->failed) return -1;
        index_node *node = &build->nodes[at];
        for (int k = 0; k < 3; k++) node->lo[k][i] = box.lo[k], node->hi[k][i] = box.hi[k];
        node->child[i] = child;
        node->count[i] = i < count ? parts[i].count : 0;
    }
    return at;
}

void index_element_box(const blob_scene *scene, int32_t e, double *lo, double *hi) {
    if (scene->shape && scene->shape[e] >= 0) {
        const blob_shape *shape = &scene->shapes[scene->shape[e]];
        for (int k = 0; k < 3; k++) lo[k] = shape->box[k], hi[k] = shape->box[3 + k];
        return;
    }
    const double c[3] = {scene->x[e], scene->y[e], scene->z[e]}, r = scene->support[e] * (1.0 + 1e-15);
    for (int k = 0; k < 3; k++) lo[k] = c[k] - r, hi[k] = c[k] + r;
}

/* How deep the nodes of a surface nest; one sum of elements needs no walk and counts as 0. */
static int32_t bvh_nesting(const blob_scene *scene, const blob_surface *surface) {
    if (surface->node_end - surface->node_begin == 1 && scene->nodes[surface->node_begin].op == OP_SUM) return 0;
    int32_t depth = 0;
    for (int32_t n = surface->node_begin; n < surface->node_end; n++)
        if (scene->nodes[n].depth + 1 > depth) depth = scene->nodes[n].depth + 1;
    return depth;
}

static void bvh_tree(bvh_build *build, const blob_scene *scene, const blob_surface *surface, index_tree *tree) {
    tree->node_begin = build->node_count;
    tree->item_begin = surface->element_begin;
    tree->item_end = surface->element_end;
    tree->depth = bvh_nesting(scene, surface);
    bvh_part whole = {.first = tree->item_begin, .count = tree->item_end - tree->item_begin};
    double reach = 0.0;
    for (int32_t e = tree->item_begin; e < tree->item_end; e++) {
        double lo[3], hi[3], widest = 0.0;
        index_element_box(scene, e, lo, hi);
        bvh_item *item = &build->items[e];
        item->element = e;
        for (int k = 0; k < 3; k++) {
            item->box.lo[k] = bvh_down(lo[k]);
            item->box.hi[k] = bvh_up(hi[k]);
            if (hi[k] - lo[k] > widest) widest = hi[k] - lo[k];
        }
        reach += 0.5 * widest;
    }
    bvh_measure(build->items, &whole);
    if (whole.count > 0) {
        bvh_node(build, &whole, 0);
        tree->typical_reach = reach / whole.count;
    }
    for (int k = 0; k < 3; k++) {
        tree->lo[k] = whole.count > 0 ? (double)whole.box.lo[k] : 0.0;
        tree->hi[k] = whole.count > 0 ? (double)whole.box.hi[k] : 0.0;
    }
    tree->node_end = build->node_count;
}

/* A tree over the triangles of one mesh; items [begin, end) of `order` become theirs. */
static void bvh_mesh_tree(bvh_build *build, const blob_scene *scene, const blob_mesh *mesh, int32_t begin, int32_t *order,
                          index_tree *tree) {
    const int32_t count = mesh->triangle_end - mesh->triangle_begin;
    tree->node_begin = build->node_count;
    tree->item_begin = begin;
    tree->item_end = begin + count;
    bvh_part whole = {.first = begin, .count = count};
    for (int32_t i = 0; i < count; i++) {
        const int32_t *ids = scene->mesh_triangles + 3 * ((size_t)mesh->triangle_begin + (size_t)i);
        bvh_item *item = &build->items[begin + i];
        item->element = i;
        item->box = BVH_EMPTY;
        for (int corner = 0; corner < 3; corner++) {
            const double *v = scene->mesh_vertices + 3 * ((size_t)mesh->vertex_begin + (size_t)ids[corner]);
            for (int k = 0; k < 3; k++) {
                const float down = bvh_down(v[k]), up = bvh_up(v[k]);
                if (down < item->box.lo[k]) item->box.lo[k] = down;
                if (up > item->box.hi[k]) item->box.hi[k] = up;
            }
        }
    }
    bvh_measure(build->items, &whole);
    bvh_node(build, &whole, 0);
    tree->node_end = build->node_count;
    for (int32_t i = begin; i < begin + count; i++) order[i] = build->items[i].element;
}

static blob_status bvh_meshes(blob_index *index, bvh_build *build) {
    const blob_scene *scene = index->scene;
    size_t triangles = 0;
    for (int32_t m = 0; m < scene->mesh_count; m++)
        triangles += (size_t)(scene->meshes[m].triangle_end - scene->meshes[m].triangle_begin);
    if (triangles > INT32_MAX) return BLOB_BAD_SCENE;
    index->mesh_count = scene->mesh_count;
    index->triangle_count = (int32_t)triangles;
    index->mesh_trees = calloc((size_t)scene->mesh_count + 1, sizeof *index->mesh_trees);
    index->mesh_order = malloc((triangles + 1) * sizeof *index->mesh_order);
    free(build->items);
    build->items = malloc((triangles + 1) * sizeof *build->items);
    if (!index->mesh_trees || !index->mesh_order || !build->items) return BLOB_NO_MEMORY;
    int32_t begin = 0;
    for (int32_t m = 0; m < scene->mesh_count; m++) {
        bvh_mesh_tree(build, scene, &scene->meshes[m], begin, index->mesh_order, &index->mesh_trees[m]);
        begin = index->mesh_trees[m].item_end;
    }
    return build->failed ? BLOB_NO_MEMORY : BLOB_OK;
}

/* Bounding spheres of the items, in the order of the leaves. */
static void bvh_spheres(blob_index *index, const bvh_item *items) {
    const blob_scene *scene = index->scene;
    for (int32_t i = 0; i < index->item_count; i++) {
        const int32_t e = items[i].element;
        index->order[i] = e;
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
}

static blob_status bvh_allocate(blob_index *index, bvh_build *build) {
    const blob_scene *scene = index->scene;
    const size_t items = (size_t)scene->element_count, room = items ? items : 1;
    index->tree_count = scene->surface_count;
    index->item_count = scene->element_count;
    index->trees = calloc((size_t)scene->surface_count + 1, sizeof *index->trees);
    index->order = malloc(room * sizeof *index->order);
    index->x = malloc(room * sizeof(double));
    index->y = malloc(room * sizeof(double));
    index->z = malloc(room * sizeof(double));
    index->reach = malloc(room * sizeof(double));
    build->items = malloc(room * sizeof *build->items);
    const int ok = index->trees && index->order && index->x && index->y && index->z && index->reach && build->items;
    return ok ? BLOB_OK : BLOB_NO_MEMORY;
}

BLOB_API blob_status blob_index_build(const blob_scene *scene, int32_t kind, blob_index **out) {
    if (!scene || !out || kind != BLOB_INDEX_BVH) return BLOB_BAD_ARGUMENT;
    *out = NULL;
    blob_index *index = calloc(1, sizeof *index);
    if (!index) return BLOB_NO_MEMORY;
    index->scene = scene;
    index->kind = kind;
    bvh_build build = {0};
    blob_status status = bvh_allocate(index, &build);
    for (int32_t s = 0; status == BLOB_OK && s < scene->surface_count; s++) {
        bvh_tree(&build, scene, &scene->surfaces[s], &index->trees[s]);
        if (build.failed) status = BLOB_NO_MEMORY;
    }
    if (status == BLOB_OK) bvh_spheres(index, build.items);
    if (status == BLOB_OK) status = bvh_meshes(index, &build);
    index->nodes = build.nodes;
    index->node_count = build.node_count;
    free(build.items);
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
           (size_t)index->mesh_count * sizeof *index->mesh_trees + (size_t)index->triangle_count * sizeof(int32_t);
}
