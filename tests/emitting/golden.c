/* ==== the scene ==== */

static const blob_surface scene_surfaces[1] = {
    {.threshold = 0.25, .element_end = 2, .node_end = 1}
};

static const blob_node scene_nodes[1] = {
    {.element_end = 2}
};

static const blob_kernel scene_kernels[2] = {
    {.id = 1},
    {0}
};

static const blob_shape scene_shapes[1] = {
    {.kind = 1, .matrix = -1, .box = {-3.75e-15, -0.12500000000000375, -0.12500000000000125, 0.2500000000000038, 0.3750000000000038, 0.12500000000000125}, .b = {0.125, 0.25}}
};

static const double scene_x[2] = {
    0.0, 0.125
};

static const double scene_y[2] = {
    0.0625, 0.0
};

static const double scene_z[2] = {
    0.0, 0.0
};

static const double scene_weight[2] = {
    1.0, -0.5
};

static const double scene_inverse_reach2[2] = {
    16.0, 64.0
};

static const double scene_support[2] = {
    0.25, 0.125
};

static const uint16_t scene_kernel[2] = {
    0, 1
};

static const int32_t scene_shape[2] = {
    -1, 0
};

static const blob_scene the_scene = {
    .surface_count = 1,
    .node_count = 1,
    .scale = 0.125,
    .lo = {-0.25, -0.1875, -0.25},
    .hi = {0.2500000000000038, 0.3750000000000038, 0.25},
    .surfaces = scene_surfaces,
    .nodes = scene_nodes,
    .kernels = scene_kernels,
    .shapes = scene_shapes,
    .x = scene_x,
    .y = scene_y,
    .z = scene_z,
    .weight = scene_weight,
    .inverse_reach2 = scene_inverse_reach2,
    .support = scene_support,
    .kernel = scene_kernel,
    .shape = scene_shape,
};

static const shade_light picture_lights[1] = {
    {
        .place = {-0.0, 1.0, -0.0},
        .color = {2.0, 2.0, 2.0},
    }
};

static const double picture_materials[15] = {
    0.6938717612919899, 0.238397573812271, 0.14412847085805777, 0.9, 0.0, 0.25, 0.0, 1.5, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0
};

static const int32_t picture_surface_material[1] = {
    0
};

static const double picture_thresholds[1] = {
    0.25
};
