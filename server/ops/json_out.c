/**
 * json_out.c: meshes, problems, requests, results and steps to JSON.
 */
#include "json_out.h"

#include <math.h>
#include <stdio.h>

#include "base/json.h"
#include "job_kinds_internal.h"

/* ---- meshes ---- */

static void add_faces(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "faces", "{");
    qm_json_add_count(out, "triangles", mesh->facts.triangles);
    qm_json_add_count(out, "quads", mesh->facts.quads);
    qm_json_add_count(out, "polygons", mesh->facts.polygons);
    qm_text_add_string(out, "}");
}

static void add_largest_patch(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_regular_patch largest = qm_loaded_mesh_largest_patch(mesh);
    if (largest.rows == 0) {
        qm_json_add_word(out, "largest_patch", "null");
        return;
    }
    qm_json_open(out, "largest_patch", "{");
    qm_json_add_count(out, "rows", largest.rows);
    qm_json_add_count(out, "columns", largest.columns);
    qm_text_add_string(out, "}");
}

static void add_box(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "bounding_box", "{");
    qm_json_add_numbers(out, "min", mesh->box.min, 3);
    qm_json_add_numbers(out, "max", mesh->box.max, 3);
    qm_json_add_number(out, "diagonal", mesh->diagonal);
    qm_text_add_string(out, "}");
}

static void add_bounds_of(qm_text *out, qm_interval bounds)
{
    qm_json_add_number(out, "lower", bounds.lower);
    qm_json_add_number(out, "upper", bounds.upper);
}

/** The figure of both readings; quads are read as triangles unless it is said. */
static void add_extent(qm_text *out, const char *name, const qm_interval by_reading[2], bool has_quads)
{
    qm_json_open(out, name, "{");
    add_bounds_of(out, by_reading[QM_QUADS_TRIANGLES]);
    if (has_quads) qm_json_add_range(out, "bilinear", by_reading[QM_QUADS_BILINEAR]);
    qm_text_add_string(out, "}");
}

/** What a surface is: whether it is closed, and how large. */
static void add_surface(qm_text *out, const qm_loaded_mesh *mesh)
{
    const qm_mesh_facts *facts = &mesh->facts;
    bool has_faces = mesh->mesh.face_count > 0, has_quads = facts->quads > 0;
    qm_json_add_bool(out, "watertight", facts->watertight);
    qm_json_add_bool(out, "winding_consistent", facts->winding_consistent);
    qm_json_add_count(out, "edges", facts->edges);
    qm_json_add_count(out, "boundary_loops", facts->boundary_loops);
    if (has_faces)
        qm_json_add_number(out, "euler_number", (double)facts->euler_number);
    else
        qm_json_add_word(out, "euler_number", "null");
    if (facts->genus != QM_NO_GENUS)
        qm_json_add_count(out, "genus", facts->genus);
    else
        qm_json_add_word(out, "genus", "null");
    qm_json_add_count(out, "degenerate_faces", mesh->extent.degenerate_faces);
    qm_json_add_count(out, "duplicate_faces", facts->duplicate_faces);
    if (has_faces)
        add_extent(out, "area", mesh->extent.area, has_quads);
    else
        qm_json_add_word(out, "area", "null");
    if (facts->watertight && facts->winding_consistent)
        add_extent(out, "volume", mesh->extent.volume, has_quads);
    else
        qm_json_add_word(out, "volume", "null");
}

static void add_times(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "prepare_ms", "{");
    qm_json_add_ms(out, "parse", mesh->parse_ms);
    qm_json_add_ms(out, "topology", mesh->topology_ms);
    qm_json_add_ms(out, "patches", mesh->patches_ms);
    qm_json_add_ms(out, "bvh", mesh->bvh_ms);
    qm_text_add_string(out, "}");
}

void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh)
{
    qm_text_add_string(out, "{");
    if (label->id) qm_json_add_string(out, "id", label->id);
    qm_json_add_string(out, "name", label->name);
    qm_json_add_string(out, "kind", qm_loaded_mesh_kind(mesh));
    qm_json_add_count(out, "vertices", mesh->mesh.vertex_count);
    add_faces(out, mesh);
    qm_json_add_count(out, "irregular_vertices", mesh->facts.irregular_vertices);
    qm_json_add_count(out, "patches", mesh->patches.patch_count);
    add_largest_patch(out, mesh);
    qm_json_add_count(out, "boundary_edges", mesh->facts.boundary_edges);
    qm_json_add_count(out, "components", mesh->facts.components);
    qm_json_add_bool(out, "manifold", mesh->facts.manifold);
    add_surface(out, mesh);
    add_box(out, mesh);
    if (mesh->mesh.face_count == 0) {
        qm_json_add_bool(out, "has_normals", mesh->mesh.normals != NULL);
        qm_json_add_number(out, "disc_radius", qm_ref_surface_disc_radius(&mesh->mesh));
    }
    qm_json_add_string(out, "format", qm_format_name(mesh->format));
    qm_json_add_count(out, "size_bytes", mesh->file_size);
    qm_json_add_count(out, "memory_bytes", qm_loaded_mesh_memory_size(mesh));
    add_times(out, mesh);
    qm_json_add_count(out, "revision", label->revision);
    if (label->content_hash) qm_json_add_string(out, "content_hash", label->content_hash);
    if (label->created) qm_json_add_string(out, "created", label->created);
    qm_json_open(out, "warnings", "[");
    for (size_t i = 0; i < mesh->warning_count; i++) {
        qm_json_add_comma(out);
        qm_json_add_quoted(out, mesh->warnings[i]);
    }
    qm_text_add_string(out, "]}");
}

/* ---- problems ---- */

static void add_error(qm_text *out, const qm_problem_error *error)
{
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    if (error->pointer[0]) qm_json_add_string(out, "pointer", error->pointer);
    if (error->line != QM_NO_LOCATION) qm_json_add_count(out, "line", error->line);
    if (error->offset != QM_NO_LOCATION) qm_json_add_count(out, "offset", error->offset);
    qm_json_add_string(out, "detail", error->detail);
    qm_text_add_string(out, "}");
}

void qm_json_add_problem(qm_text *out, const qm_problem *problem)
{
    char type[96];
    snprintf(type, sizeof type, "/problems/%s", qm_problem_name(problem->code));
    qm_json_add_string(out, "type", type);
    qm_json_add_string(out, "title", qm_problem_title(problem->code));
    qm_json_add_count(out, "status", (uint64_t)qm_problem_status(problem->code));
    qm_json_add_string(out, "detail", problem->detail);
    qm_json_add_string(out, "code", qm_problem_name(problem->code));
    if (problem->error_count > 0) {
        qm_json_open(out, "errors", "[");
        for (size_t i = 0; i < problem->error_count; i++)
            add_error(out, &problem->errors[i]);
        qm_text_add_string(out, "]");
    }
}

void qm_json_write_problem(qm_text *out, const qm_problem *problem)
{
    qm_text_add_string(out, "{");
    qm_json_add_problem(out, problem);
    qm_text_add_string(out, "}");
}

/* ---- requests ---- */

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    const qm_job_hooks *hooks = qm_job_hooks_of(request->kind);
    const qm_job_type *type = &hooks->type;
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "type", type->name);
    const char *const meshes[2] = {request->a, request->b};
    for (int i = 0; i < 2 && type->mesh_field[i]; i++) {
        qm_json_add_name(out, type->mesh_field[i]);
        qm_json_add_mesh(out, meshes[i], &request->pose[i]);
    }
    const qm_job_field *reading = qm_job_find_field(hooks->fields, "quads");
    if (reading && reading->names == qm_quads_names)
        qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->threads > 0) qm_json_add_count(out, "threads", (uint64_t)request->threads);
    hooks->write_request(out, request, is_brief);
    qm_job_add_engine(out, request);
    if (request->deadline_ms > 0.0) qm_json_add_number(out, "deadline_ms", request->deadline_ms);
    /* It does not change the result: it is no part of the key. */
    if (is_brief && request->priority != QM_PRIORITY_NORMAL)
        qm_json_add_string(out, "priority", qm_priority_names[request->priority]);
    qm_text_add_string(out, "}");
}

void qm_json_write_request(qm_text *out, const qm_job_request *request)
{
    write_request(out, request, false);
}

void qm_json_write_request_briefly(qm_text *out, const qm_job_request *request)
{
    write_request(out, request, true);
}

/* ---- results ---- */

void qm_json_add_prepare_ms(qm_text *out, const qm_job_result *result)
{
    qm_json_open(out, "prepare_ms", "{");
    qm_json_add_ms(out, "a", result->prepare_a_ms);
    qm_json_add_ms(out, "b", result->prepare_b_ms);
    qm_text_add_string(out, "}");
}

/** A bound as a fraction of the diagonal, rounded outward, so that the interval still holds. */
static double relative_bound(double bound, double diagonal, double towards)
{
    if (!(diagonal > 0.0)) return INFINITY;
    return bound == 0.0 ? 0.0 : nextafter(bound / diagonal, towards);
}

void qm_json_add_lower_upper(qm_text *out, double lower, double upper, double diagonal)
{
    QM_ASSERT(!(lower > upper));
    qm_json_add_number(out, "lower", lower);
    qm_json_add_number(out, "upper", upper);
    qm_json_add_number(out, "lower_relative", relative_bound(lower, diagonal, 0.0));
    qm_json_add_number(out, "upper_relative", relative_bound(upper, diagonal, INFINITY));
}

void qm_json_add_interval(qm_text *out, const char *name, qm_interval interval, double diagonal)
{
    qm_json_open(out, name, "{");
    qm_json_add_lower_upper(out, interval.lower, interval.upper, diagonal);
    qm_text_add_string(out, "}");
}

void qm_json_add_range(qm_text *out, const char *name, qm_interval range)
{
    qm_json_open(out, name, "{");
    add_bounds_of(out, range);
    qm_text_add_string(out, "}");
}

void qm_json_add_surface_point(qm_text *out, const char *name, const char *mesh, const char *id,
                               uint32_t face, const qm_surface_point *point)
{
    qm_json_open(out, name, "{");
    qm_json_add_string(out, "mesh", mesh);
    if (id[0]) qm_json_add_string(out, "id", id);
    qm_json_add_count(out, "face", face);
    qm_json_add_numbers(out, "uv", point->uv, 2);
    qm_json_add_numbers(out, "point", point->position, 3);
    qm_text_add_string(out, "}");
}

void qm_json_add_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal)
{
    qm_json_add_ms(out, "elapsed_ms", progress->elapsed_ms);
    qm_json_add_lower_upper(out, progress->lower, progress->upper, diagonal);
    qm_json_add_number(out, "gap_relative",
                       diagonal > 0.0 ? (progress->upper - progress->lower) / diagonal : INFINITY);
    qm_json_add_count(out, "iterations", progress->iterations);
    qm_json_add_count(out, "projections", progress->projections);
    qm_json_add_count(out, "queue", progress->queue_count);
}

void qm_json_write_projection(qm_text *out, const qm_projections *projections, size_t i, double diagonal)
{
    double distance = projections->distance[i];
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_number(out, "distance", distance);
    qm_json_add_number(out, "distance_relative", diagonal > 0.0 ? distance / diagonal : INFINITY);
    qm_json_add_numbers(out, "point", projections->position + 3 * i, 3);
    qm_json_add_count(out, "face", projections->face[i]);
    if (projections->patch) qm_json_add_count(out, "patch", projections->patch[i]);
    qm_json_add_numbers(out, "uv", projections->uv + 2 * i, 2);
    qm_text_add_string(out, "}");
}

#define STRANGE_SCALE 50.0 /* of one diagonal to the other: the units are probably not the same */

/** What is likely to be a mistake in a question about two meshes. */
static void add_doubts(qm_text *out, const qm_job_result *result)
{
    double a = result->diagonal, b = result->other_diagonal;
    if (!(a > 0.0 && b > 0.0) || (a <= STRANGE_SCALE * b && b <= STRANGE_SCALE * a)) return;
    char text[160];
    snprintf(text, sizeof text, "the diagonal of A is %.4g times that of B: are both in the same unit?",
             a / b);
    qm_json_open(out, "warnings", "[");
    qm_json_add_quoted(out, text);
    qm_text_add_string(out, "]");
}

void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_text_add_string(out, "{");
    QM_ASSERT(request->kind == result->kind);
    qm_job_hooks_of(request->kind)->write_result(out, request, result);
    add_doubts(out, result);
    qm_text_add_string(out, "}");
}

/* ---- steps of a reconstruction ---- */

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
    qm_json_add_count(out, "chords_doubled", step->chords_changed);
    qm_json_add_count(out, "patches_split", step->patches_split);
    qm_json_add_count(out, "moved_vertices", step->moved_vertices);
    qm_json_add_count(out, "holes_filled", step->holes_filled);
    qm_json_add_number(out, "longest_edge", step->longest_edge);
    add_quality(out, &record->quality);
    if (record->is_measured) {
        qm_json_add_interval(out, "hausdorff", (qm_interval){record->lower, record->upper}, diagonal);
        if (record->mesh_to_points_upper > 0.0) {
            qm_json_add_interval(out, "covered", (qm_interval){record->covered, record->covered}, diagonal);
            qm_json_add_interval(out, "mesh_to_points",
                                 (qm_interval){record->mesh_to_points_lower, record->mesh_to_points_upper},
                                 diagonal);
            qm_json_add_count(out, "uncovered_points", record->uncovered);
            qm_json_add_count(out, "beyond_points", record->beyond);
        }
    } else {
        qm_json_add_word(out, "hausdorff", "null");
    }
    qm_json_add_ms(out, "step_ms", record->step_ms);
    qm_json_add_ms(out, "measure_ms", record->measure_ms);
}

void qm_json_add_settled(qm_text *out, const qm_settled *settled, double diagonal)
{
    qm_json_open(out, "settled", "{");
    qm_json_add_bool(out, "kept", settled->is_kept);
    add_quality(out, &settled->quality);
    qm_json_add_interval(out, "hausdorff", qm_settle_two_sided(&settled->distance), diagonal);
    qm_json_add_interval(out, "from_surface", settled->distance.from_surface, diagonal);
    qm_json_add_interval(out, "from_quads", settled->distance.from_quads, diagonal);
    qm_text_add_string(out, "}");
}
