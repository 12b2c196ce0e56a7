#include "json_out.h"

#include <cjson/cJSON.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/*
 * Documents are built as cJSON trees, so that strings are escaped by the library; numbers go in as raw text,
 * because cJSON prints doubles with 15 digits where these happen to be near enough, which moves bounds the
 * wrong way.
 */

char *qm_json_number(double value, char out[QM_JSON_NUMBER_SIZE])
{
    if (!isfinite(value)) return strcpy(out, "null");
    for (int digits = 15; digits <= 17; digits++) {
        snprintf(out, QM_JSON_NUMBER_SIZE, "%.*g", digits, value);
        if (strtod(out, NULL) == value) break;
    }
    /* The process may run in a locale with decimal commas; strtod above then reads them too. */
    const char *point = localeconv()->decimal_point;
    char *found = strcmp(point, ".") == 0 ? NULL : strstr(out, point);
    if (found) {
        memmove(found + 1, found + strlen(point), strlen(found + strlen(point)) + 1);
        *found = '.';
    }
    return out;
}

static void add_number(cJSON *object, const char *name, double value)
{
    char text[QM_JSON_NUMBER_SIZE];
    cJSON_AddItemToObject(object, name, cJSON_CreateRaw(qm_json_number(value, text)));
}

static void add_count(cJSON *object, const char *name, uint64_t value)
{
    char text[QM_JSON_NUMBER_SIZE];
    snprintf(text, sizeof text, "%llu", (unsigned long long)value);
    cJSON_AddItemToObject(object, name, cJSON_CreateRaw(text));
}

static void add_numbers(cJSON *object, const char *name, const double *values, int count)
{
    cJSON *array = cJSON_AddArrayToObject(object, name);
    for (int i = 0; i < count; i++) {
        char text[QM_JSON_NUMBER_SIZE];
        cJSON_AddItemToArray(array, cJSON_CreateRaw(qm_json_number(values[i], text)));
    }
}

/** Prints and frees the tree. */
static void write_tree(qm_text *out, cJSON *tree)
{
    char *text = tree ? cJSON_PrintUnformatted(tree) : NULL;
    if (text)
        qm_text_add_string(out, text);
    else
        out->failed = true;
    cJSON_free(text);
    cJSON_Delete(tree);
}

/* ---- meshes ---- */

static void add_faces(cJSON *object, const qm_loaded_mesh *mesh)
{
    cJSON *faces = cJSON_AddObjectToObject(object, "faces");
    add_count(faces, "triangles", mesh->facts.triangles);
    add_count(faces, "quads", mesh->facts.quads);
    add_count(faces, "polygons", mesh->facts.polygons);
}

static void add_box(cJSON *object, const qm_loaded_mesh *mesh)
{
    cJSON *box = cJSON_AddObjectToObject(object, "bounding_box");
    add_numbers(box, "min", mesh->box.min, 3);
    add_numbers(box, "max", mesh->box.max, 3);
    add_number(box, "diagonal", mesh->diagonal);
}

static void add_times(cJSON *object, const qm_loaded_mesh *mesh)
{
    cJSON *times = cJSON_AddObjectToObject(object, "prepare_ms");
    add_number(times, "parse", mesh->parse_ms);
    add_number(times, "topology", mesh->topology_ms);
    add_number(times, "bvh", mesh->bvh_ms);
}

void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh)
{
    cJSON *object = cJSON_CreateObject();
    if (label->id) cJSON_AddStringToObject(object, "id", label->id);
    cJSON_AddStringToObject(object, "name", label->name);
    cJSON_AddStringToObject(object, "kind", qm_loaded_mesh_kind(mesh));
    add_count(object, "vertices", mesh->mesh.vertex_count);
    add_faces(object, mesh);
    add_count(object, "irregular_vertices", mesh->facts.irregular_vertices);
    add_count(object, "boundary_edges", mesh->facts.boundary_edges);
    add_count(object, "components", mesh->facts.components);
    cJSON_AddBoolToObject(object, "manifold", mesh->facts.manifold);
    add_box(object, mesh);
    cJSON_AddStringToObject(object, "format", qm_format_name(mesh->format));
    add_count(object, "size_bytes", mesh->file_size);
    add_count(object, "memory_bytes", qm_loaded_mesh_memory_size(mesh));
    add_times(object, mesh);
    add_count(object, "revision", label->revision);
    if (label->content_hash) cJSON_AddStringToObject(object, "content_hash", label->content_hash);
    if (label->created) cJSON_AddStringToObject(object, "created", label->created);
    cJSON *warnings = cJSON_AddArrayToObject(object, "warnings");
    for (size_t i = 0; i < mesh->warning_count; i++)
        cJSON_AddItemToArray(warnings, cJSON_CreateString(mesh->warnings[i]));
    write_tree(out, object);
}

/* ---- problems ---- */

static cJSON *error_tree(const qm_problem_error *error)
{
    cJSON *object = cJSON_CreateObject();
    if (error->pointer[0]) cJSON_AddStringToObject(object, "pointer", error->pointer);
    if (error->line != QM_NO_PLACE) add_count(object, "line", error->line);
    if (error->offset != QM_NO_PLACE) add_count(object, "offset", error->offset);
    cJSON_AddStringToObject(object, "detail", error->detail);
    return object;
}

void qm_json_write_problem(qm_text *out, const qm_problem *problem)
{
    char type[96];
    snprintf(type, sizeof type, "/problems/%s", qm_problem_name(problem->code));
    cJSON *object = cJSON_CreateObject();
    cJSON_AddStringToObject(object, "type", type);
    cJSON_AddStringToObject(object, "title", qm_problem_title(problem->code));
    add_count(object, "status", (uint64_t)qm_problem_status(problem->code));
    cJSON_AddStringToObject(object, "detail", problem->detail);
    cJSON_AddStringToObject(object, "code", qm_problem_name(problem->code));
    if (problem->error_count > 0) {
        cJSON *errors = cJSON_AddArrayToObject(object, "errors");
        for (size_t i = 0; i < problem->error_count; i++)
            cJSON_AddItemToArray(errors, error_tree(&problem->errors[i]));
    }
    write_tree(out, object);
}

/* ---- jobs ---- */

static const char *direction_name(qm_direction direction)
{
    return direction == QM_A_TO_B ? "a_to_b" : direction == QM_B_TO_A ? "b_to_a" : "two_sided";
}

static const char *quads_name(qm_quad_reading quads)
{
    return quads == QM_QUADS_BILINEAR ? "bilinear" : "triangles";
}

void qm_json_write_request(qm_text *out, const qm_job_request *request)
{
    cJSON *object = cJSON_CreateObject();
    cJSON_AddStringToObject(object, "type", "hausdorff");
    cJSON_AddStringToObject(object, "a", request->a);
    cJSON_AddStringToObject(object, "b", request->b);
    cJSON_AddStringToObject(object, "direction", direction_name(request->direction));
    cJSON_AddStringToObject(object, "quads", quads_name(request->quads));
    add_number(object, "tolerance", request->tolerance);
    cJSON_AddStringToObject(object, "tolerance_unit",
                            request->tolerance_is_absolute ? "absolute" : "relative");
    if (!isnan(request->threshold)) add_number(object, "threshold", request->threshold);
    if (request->deadline_ms > 0.0) add_number(object, "deadline_ms", request->deadline_ms);
    if (request->threads > 0) add_count(object, "threads", (uint64_t)request->threads);
    write_tree(out, object);
}

/** A bound as a share of the diagonal, rounded away from the inside of the bracket. */
static double relative_bound(double bound, double diagonal, double towards)
{
    if (!(diagonal > 0.0)) return INFINITY;
    double share = bound / diagonal;
    return bound == 0.0 ? 0.0 : nextafter(share, towards);
}

static void add_bounds(cJSON *object, double lower, double upper, double diagonal)
{
    add_number(object, "lower", lower);
    add_number(object, "upper", upper);
    add_number(object, "lower_relative", relative_bound(lower, diagonal, 0.0));
    add_number(object, "upper_relative", relative_bound(upper, diagonal, INFINITY));
}

static void add_surface_point(cJSON *object, const char *name, const char *mesh, const char *id,
                              uint32_t face, const qm_surface_point *point)
{
    cJSON *entry = cJSON_AddObjectToObject(object, name);
    cJSON_AddStringToObject(entry, "mesh", mesh);
    if (id[0]) cJSON_AddStringToObject(entry, "id", id);
    add_count(entry, "face", face);
    add_numbers(entry, "uv", point->uv, 2);
    add_numbers(entry, "point", point->position, 3);
}

static void add_witness(cJSON *object, const qm_job_request *request, const qm_job_result *result)
{
    const qm_hausdorff_result *h = &result->hausdorff;
    bool from_a = h->from_side == 0;
    cJSON *witness = cJSON_AddObjectToObject(object, "witness");
    add_surface_point(witness, "from", from_a ? "a" : "b", from_a ? request->a : request->b,
                      result->from_face, &h->from);
    add_surface_point(witness, "to", from_a ? "b" : "a", from_a ? request->b : request->a, result->to_face,
                      &h->to);
}

void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const stop_names[] = {"converged", "threshold", "deadline", "canceled", "precision"};
    const qm_hausdorff_result *h = &result->hausdorff;
    cJSON *object = cJSON_CreateObject();
    add_bounds(object, h->lower, h->upper, result->diagonal);
    if (h->has_witness) add_witness(object, request, result);
    cJSON_AddStringToObject(object, "direction", direction_name(request->direction));
    cJSON_AddStringToObject(object, "quads", quads_name(request->quads));
    add_number(object, "tolerance", result->tolerance);
    add_count(object, "iterations", h->iterations);
    add_count(object, "projections", h->projections);
    add_count(object, "max_queue", h->max_queue);
    cJSON *prepare = cJSON_AddObjectToObject(object, "prepare_ms");
    add_number(prepare, "a", result->prepare_a_ms);
    add_number(prepare, "b", result->prepare_b_ms);
    add_number(object, "elapsed_ms", h->elapsed_ms);
    cJSON_AddBoolToObject(object, "converged", h->stop == QM_STOP_CONVERGED);
    cJSON_AddStringToObject(object, "stopped_by", stop_names[h->stop]);
    if (h->verdict == 0)
        cJSON_AddNullToObject(object, "verdict");
    else
        cJSON_AddStringToObject(object, "verdict", h->verdict > 0 ? "above" : "below");
    write_tree(out, object);
}

void qm_json_write_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal)
{
    cJSON *object = cJSON_CreateObject();
    add_number(object, "elapsed_ms", progress->elapsed_ms);
    add_bounds(object, progress->lower, progress->upper, diagonal);
    add_number(object, "gap_relative",
               diagonal > 0.0 ? (progress->upper - progress->lower) / diagonal : INFINITY);
    add_count(object, "iterations", progress->iterations);
    add_count(object, "projections", progress->projections);
    add_count(object, "queue", progress->queue_count);
    write_tree(out, object);
}
