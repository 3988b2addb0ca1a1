/* harness.c - traces a packed scene that was written to a file, as it is or with random bytes changed.
 *
 *   harness scene.packed first count
 *
 * Run 0 takes the scene as it is; it must be accepted. Run n > 0 changes one to eight random bytes, pointers
 * aside, n being the seed. Every array lies in a block of exactly its size, so that a sanitizer sees the first
 * byte beyond. What blob_check refuses is not traced, nor are counts that the arrays have no room for: whoever
 * reads a scene knows how long its arrays are. Numbers that are none of a proved kernel's can make a search creep:
 * after a second it is cancelled, as a user would. Ends with a line of totals; a crash, a sanitizer's report or a run
 * that does not stop within HARNESS_SECONDS of that is a failure, and the number of the run is told.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "scene.h"

enum { HARNESS_BLOCKS = 21, HARNESS_RAYS = 40, HARNESS_SECONDS = 20 };

typedef struct block {
    size_t size;
    unsigned char *bytes;
} block;

static volatile sig_atomic_t harness_run;
static volatile int32_t harness_cancel;

static void harness_late(int signal_number) {
    (void)signal_number;
    if (!harness_cancel) {
        harness_cancel = 1;
        alarm(HARNESS_SECONDS);
        return;
    }
    char text[64];
    const int n = snprintf(text, sizeof text, "run %d does not stop\n", (int)harness_run);
    if (write(2, text, (size_t)n) < 0) _exit(4);
    _exit(3);
}

static uint64_t harness_random(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static double harness_unit(uint64_t *state) { return (double)(harness_random(state) >> 11) * 0x1p-53; }

static void *harness_memory(size_t size) {
    void *memory = malloc(size ? size : 1);
    if (!memory) exit(2);
    return memory;
}

static block harness_read(FILE *file) {
    uint64_t size;
    if (fread(&size, sizeof size, 1, file) != 1) exit(2);
    block b = {(size_t)size, harness_memory((size_t)size)};
    if (b.size && fread(b.bytes, 1, b.size, file) != b.size) exit(2);
    return b;
}

/* The arrays in the order of the file, which is that of the structure: address of the pointer, how many entries,
 * bytes of each. */
typedef struct place {
    const void **pointer;
    int64_t count;
    size_t size;
} place;

static void harness_places(blob_scene *s, place *p) {
    const int64_t e = s->element_count, v = s->mesh_vertex_count, t = s->mesh_triangle_count;
    const place places[HARNESS_BLOCKS] = {
        {(const void **)&s->surfaces, s->surface_count, sizeof(blob_surface)},
        {(const void **)&s->nodes, s->node_count, sizeof(blob_node)},
        {(const void **)&s->kernels, s->kernel_count, sizeof(blob_kernel)},
        {(const void **)&s->pieces, s->piece_count, sizeof(blob_piece)},
        {(const void **)&s->shapes, s->shape_count, sizeof(blob_shape)},
        {(const void **)&s->matrices, s->matrix_count, 12 * sizeof(double)},
        {(const void **)&s->meshes, s->mesh_count, sizeof(blob_mesh)},
        {(const void **)&s->mesh_vertices, v, 3 * sizeof(double)},
        {(const void **)&s->mesh_triangles, t, 3 * sizeof(int32_t)},
        {(const void **)&s->mesh_neighbors, t, 3 * sizeof(int32_t)},
        {(const void **)&s->mesh_normals, v, 3 * sizeof(double)},
        {(const void **)&s->x, e, sizeof(double)},
        {(const void **)&s->y, e, sizeof(double)},
        {(const void **)&s->z, e, sizeof(double)},
        {(const void **)&s->weight, e, sizeof(double)},
        {(const void **)&s->inverse_reach2, e, sizeof(double)},
        {(const void **)&s->support, e, sizeof(double)},
        {(const void **)&s->kernel, e, sizeof(uint16_t)},
        {(const void **)&s->node, e, sizeof(int32_t)},
        {(const void **)&s->paint, e, sizeof(int32_t)},
        {(const void **)&s->shape, e, sizeof(int32_t)},
    };
    memcpy(p, places, sizeof places);
}

/* Points the scene at the blocks. 0 where a count asks for more than there is. */
static int harness_point(blob_scene *s, const block *blocks) {
    place places[HARNESS_BLOCKS];
    harness_places(s, places);
    for (int i = 0; i < HARNESS_BLOCKS; i++) {
        *places[i].pointer = blocks[i].size ? blocks[i].bytes : NULL;
        if (places[i].count < 0 || (blocks[i].size && (uint64_t)places[i].count * places[i].size > blocks[i].size))
            return 0;
    }
    return 1;
}

static void harness_change(blob_scene *s, block *blocks, uint64_t *state) {
    const size_t head = offsetof(blob_scene, surfaces);
    size_t total = 0;
    for (int i = 0; i < HARNESS_BLOCKS; i++) total += blocks[i].size;
    for (uint64_t n = 1 + harness_random(state) % 8; n > 0; n--) {
        /* one change in four hits the head, which is small and matters much */
        const int in_head = harness_random(state) % 4 == 0;
        size_t at = (size_t)(harness_random(state) % (in_head ? head : total));
        const unsigned char value = (unsigned char)harness_random(state);
        if (in_head) {
            ((unsigned char *)s)[at] = value;
            continue;
        }
        int i = 0;
        while (at >= blocks[i].size) at -= blocks[i++].size;
        blocks[i].bytes[at] = value;
    }
}

/* Every query of the library on a scene that was accepted. */
static blob_status harness_trace(const blob_scene *s, uint64_t *state, int32_t kind) {
    double *origins = harness_memory(sizeof(double) * 3 * HARNESS_RAYS),
           *directions = harness_memory(sizeof(double) * 3 * HARNESS_RAYS);
    double *ends = harness_memory(sizeof(double) * 2 * HARNESS_RAYS),
           *t = harness_memory(sizeof(double) * HARNESS_RAYS);
    double *normals = harness_memory(sizeof(double) * 3 * HARNESS_RAYS);
    int8_t *status = harness_memory(HARNESS_RAYS);
    uint8_t *any = harness_memory(HARNESS_RAYS);
    int32_t *surface = harness_memory(sizeof(int32_t) * HARNESS_RAYS);
    double middle[3], size = 0.0;
    for (int k = 0; k < 3; k++) {
        middle[k] = 0.5 * (s->lo[k] + s->hi[k]) / s->scale + s->center[k];
        size += (s->hi[k] - s->lo[k]) / s->scale;
    }
    for (int i = 0; i < HARNESS_RAYS; i++) {
        for (int k = 0; k < 3; k++) {
            const double away = (i % 4 ? 2.0 : 0.2) * size * (harness_unit(state) - 0.5);
            origins[3 * i + k] = middle[k] + away;
            directions[3 * i + k] = 0.1 * size * (harness_unit(state) - 0.5) - away;
        }
        ends[i] = 0.0;
        ends[HARNESS_RAYS + i] = 1e300;
    }
    blob_index *index = NULL;
    blob_status result = blob_index_build(s, kind, &index);
    const blob_query query = {.cancel = &harness_cancel};
    const blob_hits hits = {.status = status, .t = t, .normal = normals, .surface = surface};
    const size_t n = HARNESS_RAYS;
    if (!result) result = blob_first_hit(s, index, &query, n, origins, directions, ends, ends + n, &hits);
    if (!result) result = blob_any_hit(s, index, &query, n, origins, directions, ends, ends + n, any);
    for (int32_t i = 0; !result && i < s->surface_count && i < 4; i++)
        result = blob_field(s, index, i, n, origins, t, normals);
    /* materials that a changed scene asks for may not exist: that is the caller's table, not the scene's */
    blob_index_free(index);
    free(origins), free(directions), free(ends), free(t), free(normals), free(status), free(any), free(surface);
    return result;
}

static int harness_once(const blob_scene *head, const block *original, int run, int32_t kind, int *traced,
                        int *cancelled) {
    uint64_t state = (uint64_t)run;
    blob_scene scene = *head;
    block blocks[HARNESS_BLOCKS];
    for (int i = 0; i < HARNESS_BLOCKS; i++) {
        blocks[i] = (block){original[i].size, harness_memory(original[i].size)};
        memcpy(blocks[i].bytes, original[i].bytes, original[i].size);
    }
    harness_run = run;
    harness_cancel = 0;
    if (run > 0) alarm(1);
    if (run > 0) harness_change(&scene, blocks, &state);
    const int accepted = harness_point(&scene, blocks) && blob_check(&scene) == BLOB_OK;
    *traced += accepted;
    const blob_status result = accepted ? harness_trace(&scene, &state, kind) : BLOB_OK;
    alarm(0);
    *cancelled += result == BLOB_CANCELLED;
    const int fine = result == BLOB_OK || result == BLOB_NO_MEMORY || (run > 0 && result == BLOB_CANCELLED);
    for (int i = 0; i < HARNESS_BLOCKS; i++) free(blocks[i].bytes);
    if (run == 0 && !accepted) fprintf(stderr, "the scene as it is was refused\n");
    if (!fine) fprintf(stderr, "run %d: status %d\n", run, (int)result);
    return (run == 0 && !accepted) || !fine;
}

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    FILE *file = fopen(argv[1], "rb");
    blob_scene scene;
    block blocks[HARNESS_BLOCKS];
    if (!file || fread(&scene, sizeof scene, 1, file) != 1) return 2;
    for (int i = 0; i < HARNESS_BLOCKS; i++) blocks[i] = harness_read(file);
    fclose(file);
    signal(SIGALRM, harness_late);
    const int first = atoi(argv[2]), count = atoi(argv[3]);
    const int32_t kind = (int32_t)atoi(argv[4]);
    int traced = 0, cancelled = 0, failed = 0;
    for (int run = first; run < first + count && !failed; run++)
        failed = harness_once(&scene, blocks, run, kind, &traced, &cancelled);
    for (int i = 0; i < HARNESS_BLOCKS; i++) free(blocks[i].bytes);
    printf("%d runs, %d accepted and traced, %d cancelled\n", count, traced, cancelled);
    return failed;
}
