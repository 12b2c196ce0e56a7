/**
 * json_out.c: meshes, problems, requests, results and steps to JSON; a writer for each kind of job.
 */
#include "json_out.h"

#include <math.h>
#include <stdio.h>

#include "base/json.h"

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

static void write_tolerance(qm_text *out, const qm_job_request *request)
{
    qm_json_add_number(out, "tolerance", request->tolerance);
    qm_json_add_string(out, "tolerance_unit", qm_tolerance_unit_names[request->tolerance_is_absolute]);
}

static void write_accelerator(qm_text *out, const qm_job_request *request)
{
    if (request->accelerator != QM_ACCELERATOR_AUTO)
        qm_json_add_string(out, "accelerator", qm_accelerator_names[request->accelerator]);
}

static void write_hausdorff_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "direction", qm_direction_names[request->direction]);
    write_tolerance(out, request);
    if (!isnan(request->threshold)) qm_json_add_number(out, "threshold", request->threshold);
    if (request->memory_limit > 0) qm_json_add_count(out, "memory_limit", request->memory_limit);
    write_accelerator(out, request);
    if (request->bounds == QM_BOUNDS_MATCHING)
        qm_json_add_string(out, "bounds", qm_bounds_names[request->bounds]);
}

static void write_project_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    write_accelerator(out, request);
    if (is_brief) {
        qm_json_add_count(out, "point_count", request->point_count);
        return;
    }
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < request->point_count; i++)
        qm_json_add_array(out, request->points + 3 * i, 3);
    qm_text_add_string(out, "]");
}

static void write_deviation_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    write_tolerance(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_count(out, "pieces", request->pieces);
    qm_json_add_count(out, "bins", request->bins);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
}

static void write_distance_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    write_tolerance(out, request);
}

static void write_collision_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_count(out, "limit", request->list_limit);
    write_tolerance(out, request);
}

static void write_self_collision_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    write_collision_request(out, request, is_brief);
    if (request->incremental) qm_json_add_bool(out, "incremental", true);
}

static void write_reconstruction_step_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    const qm_refine_goal *goal = &request->goal;
    if (goal->steps > 0) qm_json_add_count(out, "steps", goal->steps);
    qm_json_open(out, "until", "{");
    if (request->hausdorff_relative > 0.0)
        qm_json_add_number(out, "hausdorff_relative", request->hausdorff_relative);
    if (goal->max_quads > 0) qm_json_add_count(out, "max_quads", goal->max_quads);
    if (goal->edge > 0.0) qm_json_add_number(out, "edge_length", goal->edge);
    qm_text_add_string(out, "}");
    qm_json_add_bool(out, "measure", goal->measures);
}

static void (*const request_writers[])(qm_text *out, const qm_job_request *request, bool is_brief) = {
#define XX(suffix, name, first, second) write_##name##_request,
    QM_JOB_MAP(XX)
#undef XX
};

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    const qm_job_type *type = qm_job_type_of(request->kind);
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "type", type->name);
    qm_json_add_string(out, type->mesh_field[0], request->a);
    if (type->mesh_field[1]) qm_json_add_string(out, type->mesh_field[1], request->b);
    if (request->kind != QM_JOB_RECONSTRUCTION_STEP)
        qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->threads > 0) qm_json_add_count(out, "threads", (uint64_t)request->threads);
    QM_ASSERT(request->kind < QM_JOB_KIND_COUNT);
    request_writers[request->kind](out, request, is_brief);
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

static void add_prepare_ms(qm_text *out, const qm_job_result *result)
{
    qm_json_open(out, "prepare_ms", "{");
    qm_json_add_ms(out, "a", result->prepare_a_ms);
    qm_json_add_ms(out, "b", result->prepare_b_ms);
    qm_text_add_string(out, "}");
}

/* ---- hausdorff ---- */

/** A bound as a fraction of the diagonal, rounded outward, so that the interval still holds. */
static double relative_bound(double bound, double diagonal, double towards)
{
    if (!(diagonal > 0.0)) return INFINITY;
    return bound == 0.0 ? 0.0 : nextafter(bound / diagonal, towards);
}

static void add_bounds(qm_text *out, double lower, double upper, double diagonal)
{
    QM_ASSERT(!(lower > upper));
    qm_json_add_number(out, "lower", lower);
    qm_json_add_number(out, "upper", upper);
    qm_json_add_number(out, "lower_relative", relative_bound(lower, diagonal, 0.0));
    qm_json_add_number(out, "upper_relative", relative_bound(upper, diagonal, INFINITY));
}

static void add_surface_point(qm_text *out, const char *name, const char *mesh, const char *id, uint32_t face,
                              const qm_surface_point *point)
{
    qm_json_open(out, name, "{");
    qm_json_add_string(out, "mesh", mesh);
    if (id[0]) qm_json_add_string(out, "id", id);
    qm_json_add_count(out, "face", face);
    qm_json_add_numbers(out, "uv", point->uv, 2);
    qm_json_add_numbers(out, "point", point->position, 3);
    qm_text_add_string(out, "}");
}

static void add_witness(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_hausdorff_result *h = &result->hausdorff;
    bool from_a = h->from_side == 0;
    qm_json_open(out, "witness", "{");
    add_surface_point(out, "from", from_a ? "a" : "b", from_a ? request->a : request->b, result->from_face,
                      &h->from);
    add_surface_point(out, "to", from_a ? "b" : "a", from_a ? request->b : request->a, result->to_face,
                      &h->to);
    qm_text_add_string(out, "}");
}

static void write_hausdorff_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const stop_names[] = {"converged", "threshold", "deadline", "canceled",
                                             "precision", "work",      "memory"};
    const qm_hausdorff_result *h = &result->hausdorff;
    add_bounds(out, h->lower, h->upper, result->diagonal);
    if (h->has_witness)
        add_witness(out, request, result);
    else
        qm_json_add_word(out, "witness", "null");
    qm_json_add_string(out, "direction", qm_direction_names[request->direction]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_count(out, "iterations", h->iterations);
    qm_json_add_count(out, "projections", h->projections);
    qm_json_add_count(out, "max_queue", h->max_queue);
    add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", h->elapsed_ms);
    qm_json_add_bool(out, "converged", h->stop == QM_STOP_CONVERGED);
    qm_json_add_string(out, "stopped_by", stop_names[h->stop]);
    if (h->verdict == 0)
        qm_json_add_word(out, "verdict", "null");
    else
        qm_json_add_string(out, "verdict", h->verdict > 0 ? "above" : "below");
}

void qm_json_add_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal)
{
    qm_json_add_ms(out, "elapsed_ms", progress->elapsed_ms);
    add_bounds(out, progress->lower, progress->upper, diagonal);
    qm_json_add_number(out, "gap_relative",
                       diagonal > 0.0 ? (progress->upper - progress->lower) / diagonal : INFINITY);
    qm_json_add_count(out, "iterations", progress->iterations);
    qm_json_add_count(out, "projections", progress->projections);
    qm_json_add_count(out, "queue", progress->queue_count);
}

/* ---- project ---- */

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

static void write_project_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_projections *projections = &result->projections;
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_count(out, "point_count", projections->count);
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < projections->count; i++)
        qm_json_write_projection(out, projections, i, result->diagonal);
    qm_text_add_string(out, "]");
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

/* ---- deviation ---- */

/** An interval as an object, also as fractions of the diagonal. */
static void add_interval(qm_text *out, const char *name, qm_interval interval, double diagonal)
{
    qm_json_open(out, name, "{");
    add_bounds(out, interval.lower, interval.upper, diagonal);
    qm_text_add_string(out, "}");
}

static void add_percentiles(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_json_open(out, "percentiles", "[");
    for (size_t i = 0; i < result->deviation.percentile_count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "percent", request->percentiles[i]);
        add_bounds(out, result->deviation.percentile[i].lower, result->deviation.percentile[i].upper,
                   result->diagonal);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

/** Bins as pairs [lower, upper], because they are many. */
static void add_histogram(qm_text *out, const qm_deviation *deviation)
{
    qm_json_open(out, "histogram", "{");
    qm_json_add_number(out, "bin_width", deviation->bin_width);
    qm_json_open(out, "shares", "[");
    for (size_t i = 0; i < deviation->bin_count; i++) {
        const double fraction[2] = {deviation->bin[i].lower, deviation->bin[i].upper};
        qm_json_add_array(out, fraction, 2);
    }
    qm_text_add_string(out, "]}");
}

static void write_deviation_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const measures[] = {"area", "vertices", "points"};
    const qm_deviation *deviation = &result->deviation;
    qm_json_add_string(out, "over", measures[deviation->measure]);
    qm_json_open(out, "size", "{");
    qm_json_add_number(out, "lower", deviation->size.lower);
    qm_json_add_number(out, "upper", deviation->size.upper);
    qm_text_add_string(out, "}");
    add_interval(out, "mean", deviation->mean, result->diagonal);
    add_interval(out, "rms", deviation->rms, result->diagonal);
    add_interval(out, "max", deviation->max, result->diagonal);
    add_percentiles(out, request, result);
    add_histogram(out, deviation);
    qm_json_add_count(out, "vertex_count", deviation->vertex_count);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_bool(out, "accurate", deviation->is_accurate);
    qm_json_add_count(out, "pieces", deviation->pieces);
    qm_json_add_count(out, "projections", deviation->projections);
    add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

/* ---- distance ---- */

static void write_distance_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_distance *distance = &result->distance;
    add_bounds(out, distance->lower, distance->upper, result->diagonal);
    qm_json_open(out, "witness", "{");
    add_surface_point(out, "from", "a", request->a, result->from_face, &distance->from);
    add_surface_point(out, "to", "b", request->b, result->to_face, &distance->to);
    qm_text_add_string(out, "}");
    qm_json_add_bool(out, "collides", distance->upper == 0.0);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_bool(out, "converged", distance->is_converged);
    qm_json_add_count(out, "face_pairs", distance->pairs);
    add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", distance->elapsed_ms);
}

/* ---- collision, self_collision ---- */

static void add_pair(qm_text *out, qm_face_pair pair, const qm_contact *contact)
{
    static const char *const kinds[] = {"point", "segment", "area"};
    const double faces[2] = {pair.a, pair.b};
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_numbers(out, "faces", faces, 2);
    qm_json_add_string(out, "contact", kinds[contact->kind]);
    qm_json_open(out, "points", "[");
    for (int i = 0; i < (contact->kind == QM_CONTACT_POINT ? 1 : 2); i++)
        qm_json_add_array(out, contact->point[i], 3);
    qm_text_add_string(out, "]}");
}

static void write_pairs(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_listed_pairs *listed = &result->pairs;
    qm_json_add_bool(out, "collides", listed->found.pair_count > 0);
    qm_json_add_count(out, "count", listed->found.pair_count);
    qm_json_open(out, "pairs", "[");
    for (size_t i = 0; i < listed->listed_count; i++)
        add_pair(out, listed->found.pairs[i], &listed->contacts[i]);
    qm_text_add_string(out, "]");
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->quads == QM_QUADS_BILINEAR) qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_count(out, "tests", listed->found.tests);
}

static void write_collision_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    write_pairs(out, request, result);
    add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->pairs.found.elapsed_ms);
}

static void write_self_collision_result(qm_text *out, const qm_job_request *request,
                                        const qm_job_result *result)
{
    write_pairs(out, request, result);
    qm_json_add_bool(out, "incremental", result->pairs.is_incremental);
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->pairs.found.elapsed_ms);
}

/* ---- reconstruction_step ---- */

static void write_reconstruction_step_result(qm_text *out, const qm_job_request *request,
                                             const qm_job_result *result)
{
    qm_json_add_string(out, "reconstruction", request->a);
    qm_json_add_string(out, "mesh", result->mesh);
    qm_json_add_count(out, "quads", result->quads);
    qm_json_add_count(out, "step_count", result->step_count);
    qm_json_add_string(out, "stopped_by", qm_refine_stop_name(result->refine_stop));
    qm_json_open(out, "steps", "[");
    qm_text_add_string(out, result->records);
    qm_text_add_string(out, "]");
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static void (*const result_writers[])(qm_text *out, const qm_job_request *request,
                                      const qm_job_result *result) = {
#define XX(suffix, name, first, second) write_##name##_result,
    QM_JOB_MAP(XX)
#undef XX
};

void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_text_add_string(out, "{");
    QM_ASSERT(request->kind < QM_JOB_KIND_COUNT && request->kind == result->kind);
    result_writers[request->kind](out, request, result);
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
    qm_json_add_count(out, "chords_doubled", step->chords_doubled);
    qm_json_add_count(out, "patches_split", step->patches_split);
    qm_json_add_count(out, "moved_vertices", step->moved_vertices);
    qm_json_add_count(out, "holes_filled", step->holes_filled);
    qm_json_add_number(out, "longest_edge", step->longest_edge);
    add_quality(out, &record->quality);
    if (record->is_measured) {
        add_interval(out, "hausdorff", (qm_interval){record->lower, record->upper}, diagonal);
        if (record->mesh_to_points_upper > 0.0) {
            add_interval(out, "covered", (qm_interval){record->covered, record->covered}, diagonal);
            add_interval(out, "mesh_to_points",
                         (qm_interval){record->mesh_to_points_lower, record->mesh_to_points_upper}, diagonal);
            qm_json_add_count(out, "uncovered_points", record->uncovered);
            qm_json_add_count(out, "beyond_points", record->beyond);
        }
    } else {
        qm_json_add_word(out, "hausdorff", "null");
    }
    qm_json_add_ms(out, "step_ms", record->step_ms);
    qm_json_add_ms(out, "measure_ms", record->measure_ms);
}
