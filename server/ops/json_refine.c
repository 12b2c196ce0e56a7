#include "json_refine.h"

#include <math.h>

/** The share is rounded outward, so that the bracket holds. */
static void add_bounds(qm_text *out, const char *name, double lower, double upper, double diagonal)
{
    qm_json_open(out, name, "{");
    qm_json_add_number(out, "lower", lower);
    qm_json_add_number(out, "upper", upper);
    qm_json_add_number(out, "lower_relative", lower > 0.0 ? nextafter(lower / diagonal, 0.0) : 0.0);
    qm_json_add_number(out, "upper_relative", upper > 0.0 ? nextafter(upper / diagonal, INFINITY) : 0.0);
    qm_text_add_string(out, "}");
}

static void add_quality(qm_text *out, const qm_quality *quality)
{
    qm_json_open(out, "quality", "{");
    qm_json_add_count(out, "folded_quads", quality->folded);
    qm_json_add_count(out, "turned_quads", quality->turned);
    qm_json_add_number(out, "least_jacobian", quality->least_jacobian);
    qm_json_add_number(out, "mean_angle_deviation_deg", quality->mean_angle);
    qm_json_add_number(out, "max_angle_deviation_deg", quality->max_angle);
    qm_json_add_number(out, "mean_edge_ratio", quality->mean_edge_ratio);
    qm_json_add_number(out, "max_edge_ratio", quality->max_edge_ratio);
    qm_json_add_number(out, "mean_warp", quality->mean_warp);
    qm_json_add_number(out, "max_warp", quality->max_warp);
    qm_text_add_string(out, "}");
}

void qm_json_add_step(qm_text *out, const qm_refine_record *record, double diagonal)
{
    const qm_reconstruction_record *step = &record->step;
    qm_json_add_count(out, "quads", step->quads);
    qm_json_add_count(out, "chords_doubled", step->chords_doubled);
    qm_json_add_count(out, "patches_split", step->patches_split);
    qm_json_add_count(out, "moved_vertices", step->moved_vertices);
    qm_json_add_count(out, "holes_filled", step->holes_filled);
    qm_json_add_number(out, "longest_edge", step->longest_edge);
    add_quality(out, &record->quality);
    if (record->is_measured) {
        add_bounds(out, "hausdorff", record->lower, record->upper, diagonal);
        if (record->mesh_to_points_upper > 0.0) {
            add_bounds(out, "covered", record->covered, record->covered, diagonal);
            add_bounds(out, "mesh_to_points", record->mesh_to_points_lower, record->mesh_to_points_upper,
                       diagonal);
            qm_json_add_count(out, "uncovered_points", record->uncovered);
            qm_json_add_count(out, "beyond_points", record->beyond);
        }
    } else {
        qm_json_add_word(out, "hausdorff", "null");
    }
    qm_json_add_number(out, "step_ms", record->step_ms);
    qm_json_add_number(out, "measure_ms", record->measure_ms);
}
