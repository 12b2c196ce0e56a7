/**
 * json_results.c: results of jobs and their progress as JSON, a function for each kind.
 */
#include <math.h>

#include "job_names.h"
#include "json_out.h"

static void add_prepare_ms(qm_text *out, const qm_job_result *result)
{
    qm_json_open(out, "prepare_ms", "{");
    qm_json_add_number(out, "a", result->prepare_a_ms);
    qm_json_add_number(out, "b", result->prepare_b_ms);
    qm_text_add_string(out, "}");
}

/* ---- hausdorff ---- */

/** A bound as a share of the diagonal, rounded away from the inside of the bracket. */
static double relative_bound(double bound, double diagonal, double towards)
{
    if (!(diagonal > 0.0)) return INFINITY;
    double share = bound / diagonal;
    return bound == 0.0 ? 0.0 : nextafter(share, towards);
}

static void add_bounds(qm_text *out, double lower, double upper, double diagonal)
{
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
    qm_json_add_number(out, "elapsed_ms", h->elapsed_ms);
    qm_json_add_bool(out, "converged", h->stop == QM_STOP_CONVERGED);
    qm_json_add_string(out, "stopped_by", stop_names[h->stop]);
    if (h->verdict == 0)
        qm_json_add_word(out, "verdict", "null");
    else
        qm_json_add_string(out, "verdict", h->verdict > 0 ? "above" : "below");
}

void qm_json_write_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal)
{
    qm_text_add_string(out, "{");
    qm_json_add_number(out, "elapsed_ms", progress->elapsed_ms);
    add_bounds(out, progress->lower, progress->upper, diagonal);
    qm_json_add_number(out, "gap_relative",
                       diagonal > 0.0 ? (progress->upper - progress->lower) / diagonal : INFINITY);
    qm_json_add_count(out, "iterations", progress->iterations);
    qm_json_add_count(out, "projections", progress->projections);
    qm_json_add_count(out, "queue", progress->queue_count);
    qm_text_add_string(out, "}");
}

/* ---- project ---- */

void qm_json_write_foot(qm_text *out, const qm_projections *feet, size_t i, double diagonal)
{
    double distance = feet->distance[i];
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_number(out, "distance", distance);
    qm_json_add_number(out, "distance_relative", diagonal > 0.0 ? distance / diagonal : INFINITY);
    qm_json_add_numbers(out, "point", feet->position + 3 * i, 3);
    qm_json_add_count(out, "face", feet->face[i]);
    if (feet->patch) qm_json_add_count(out, "patch", feet->patch[i]);
    qm_json_add_numbers(out, "uv", feet->uv + 2 * i, 2);
    qm_text_add_string(out, "}");
}

static void write_project_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_projections *feet = &result->feet;
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_count(out, "point_count", feet->count);
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < feet->count; i++)
        qm_json_write_foot(out, feet, i, result->diagonal);
    qm_text_add_string(out, "]");
    qm_json_add_number(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_number(out, "elapsed_ms", result->elapsed_ms);
}

/* ---- deviation ---- */

/** An interval as an object; with a diagonal also as a share of it. */
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

/** Bins as rows [lower, upper] of shares: they are many. */
static void add_histogram(qm_text *out, const qm_deviation *deviation)
{
    qm_json_open(out, "histogram", "{");
    qm_json_add_number(out, "bin_width", deviation->bin_width);
    qm_json_open(out, "shares", "[");
    for (size_t i = 0; i < deviation->bin_count; i++) {
        const double share[2] = {deviation->bin[i].lower, deviation->bin[i].upper};
        qm_json_add_array(out, share, 2);
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
    qm_json_add_number(out, "elapsed_ms", result->elapsed_ms);
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
    qm_json_add_number(out, "elapsed_ms", distance->elapsed_ms);
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
    const qm_told_pairs *told = &result->pairs;
    qm_json_add_bool(out, "collides", told->found.pair_count > 0);
    qm_json_add_count(out, "count", told->found.pair_count);
    qm_json_open(out, "pairs", "[");
    for (size_t i = 0; i < told->listed_count; i++)
        add_pair(out, told->found.pairs[i], &told->contacts[i]);
    qm_text_add_string(out, "]");
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->quads == QM_QUADS_BILINEAR) qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_count(out, "tests", told->found.tests);
}

static void write_collision_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    write_pairs(out, request, result);
    add_prepare_ms(out, result);
    qm_json_add_number(out, "elapsed_ms", result->pairs.found.elapsed_ms);
}

static void write_self_collision_result(qm_text *out, const qm_job_request *request,
                                        const qm_job_result *result)
{
    write_pairs(out, request, result);
    qm_json_add_bool(out, "incremental", result->pairs.is_incremental);
    qm_json_add_number(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_number(out, "elapsed_ms", result->pairs.found.elapsed_ms);
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
    qm_json_add_number(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_number(out, "elapsed_ms", result->elapsed_ms);
}

/* ---- any kind ---- */

static void (*const writers[])(qm_text *out, const qm_job_request *request, const qm_job_result *result) = {
#define XX(suffix, name, first, second) write_##name##_result,
    QM_JOB_MAP(XX)
#undef XX
};

void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_text_add_string(out, "{");
    writers[request->kind](out, request, result);
    qm_text_add_string(out, "}");
}
