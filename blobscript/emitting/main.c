/* ==== the picture ==== */

static const double program_eye[3] = {@EYE@}, program_ahead[3] = {@AHEAD@};
static const double program_right[3] = {@RIGHT@}, program_down[3] = {@DOWN@}; /* a pixel's step, times the height */
@FIT@
/* A number from the command line; 0: it is none. */
static int32_t program_size(const char *text) {
    char *end;
    const long value = strtol(text, &end, 10);
    return end != text && *end == '\0' && value > 0 && value <= 65535 ? (int32_t)value : 0;
}

static void program_view(shade_picture *picture, int32_t width, int32_t height) {
    picture->width = width;
    picture->height = height;
    for (int k = 0; k < 3; k++) {
        picture->eye[k] = program_eye[k];
        picture->right[k] = program_right[k] / height;
        picture->down[k] = program_down[k] / height;
        picture->corner[k] =
            program_ahead[k] - picture->right[k] * (0.5 * width) - picture->down[k] * (0.5 * height);
    }@MOVE@
}

/* Portable float map: rows from below, bytes in the order of this machine. */
static int program_write(const float *rgb, int32_t width, int32_t height) {
    const uint16_t one = 1;
    const int little = *(const unsigned char *)&one == 1;
    if (printf("PF\n%d %d\n%s\n", (int)width, (int)height, little ? "-1.0" : "1.0") < 0) return 0;
    for (int32_t y = height - 1; y >= 0; y--)
        if (fwrite(rgb + 3 * (size_t)y * (size_t)width, 3 * sizeof *rgb, (size_t)width, stdout) != (size_t)width)
            return 0;
    return fflush(stdout) == 0;
}

enum { PROGRAM_TILE = 64 };

/* All tiles of the picture into rgb. */
static blob_status program_render(const blob_index *index, const shade_picture *picture, float *rgb) {
    static float tile[4 * PROGRAM_TILE * PROGRAM_TILE];
    const blob_query query = {0};
    for (int32_t y0 = 0; y0 < picture->height; y0 += PROGRAM_TILE)
        for (int32_t x0 = 0; x0 < picture->width; x0 += PROGRAM_TILE) {
            const int32_t x1 = x0 + PROGRAM_TILE < picture->width ? x0 + PROGRAM_TILE : picture->width;
            const int32_t y1 = y0 + PROGRAM_TILE < picture->height ? y0 + PROGRAM_TILE : picture->height;
            const blob_status status = shade_tile(&the_scene, index, &query, picture, x0, y0, x1, y1, tile, NULL, NULL);
            if (status != BLOB_OK) return status;
            const float *from = tile;
            for (int32_t y = y0; y < y1; y++)
                for (int32_t x = x0; x < x1; x++, from += 4)
                    memcpy(rgb + 3 * ((size_t)y * (size_t)picture->width + (size_t)x), from, 3 * sizeof *from);
        }
    return BLOB_OK;
}

int main(int argc, char **argv) {
    const int32_t width = argc > 1 ? program_size(argv[1]) : 640, height = argc > 2 ? program_size(argv[2]) : 480;
    if ((argc != 1 && argc != 3) || !width || !height) {
        fprintf(stderr, "usage: %s [WIDTH HEIGHT] > out.pfm\n", argv[0]);
        return 2;
    }
    shade_picture picture = the_picture;
    program_view(&picture, width, height);
    blob_index *index = NULL;
    float *rgb = malloc(3 * sizeof *rgb * (size_t)width * (size_t)height);
    blob_status status = rgb ? blob_index_build(&the_scene, @INDEX@, &index) : BLOB_NO_MEMORY;
    if (status == BLOB_OK) status = program_render(index, &picture, rgb);
    if (status != BLOB_OK) fprintf(stderr, "%s: not enough memory\n", argv[0]);
    const int written = status == BLOB_OK && program_write(rgb, width, height);
    if (status == BLOB_OK && !written) fprintf(stderr, "%s: the picture cannot be written\n", argv[0]);
    blob_index_free(index);
    free(rgb);
    return written ? 0 : 1;
}
