#include "job_names.h"

#include <stddef.h>

const char *const qm_direction_names[] = {"two_sided", "a_to_b", "b_to_a", NULL};
const char *const qm_quads_names[] = {"triangles", "bilinear", NULL};
const char *const qm_accelerator_names[] = {"auto", "boxes", "tetra", "grid", NULL};
const char *const qm_bounds_names[] = {"cells", "matching", NULL};
const char *const qm_collide_mode_names[] = {"all", "first", "any", NULL};
const char *const qm_tolerance_unit_names[] = {"relative", "absolute", NULL};
