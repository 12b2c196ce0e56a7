#include "json_out.h"

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "utf8.h"

char *qm_json_number(double value, char out[QM_JSON_NUMBER_SIZE])
{
    if (!isfinite(value)) return strcpy(out, "null");
    /* Printing drops zeros at the end, so that 15 digits, which every normal number has, are a fair start. */
    for (int digits = fabs(value) < DBL_MIN ? 1 : 15; digits <= 17; digits++) {
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

/*
 * Documents are written straight into the text, which remembers when memory ran out: there is no half
 * document that passes for a whole one. A value that follows another one in its object or array is preceded
 * by a comma, and what was written last tells whether it is the first.
 */

static void add_comma(qm_text *out)
{
    if (out->size > 0 && !strchr("{[:", out->data[out->size - 1])) qm_text_add_string(out, ",");
}

/** Quoted and escaped; bytes that are not UTF-8 become U+FFFD. */
static void add_quoted(qm_text *out, const char *string)
{
    qm_text_add_string(out, "\"");
    for (size_t rest = strlen(string); rest > 0;) {
        size_t length = qm_utf8_length(string, rest);
        if (length == 0)
            qm_text_add_string(out, "\xef\xbf\xbd");
        else if (*string == '"' || *string == '\\')
            qm_text_printf(out, "\\%c", *string);
        else if ((unsigned char)*string < 0x20)
            qm_text_printf(out, "\\u%04x", (unsigned)*string);
        else
            qm_text_add(out, string, length);
        string += length > 0 ? length : 1;
        rest -= length > 0 ? length : 1;
    }
    qm_text_add_string(out, "\"");
}

static void add_name(qm_text *out, const char *name)
{
    add_comma(out);
    add_quoted(out, name);
    qm_text_add_string(out, ":");
}

/** Opens an object or array as a member of the one at hand; qm_text_add_string closes it. */
static void open_member(qm_text *out, const char *name, const char *bracket)
{
    add_name(out, name);
    qm_text_add_string(out, bracket);
}

static void add_string(qm_text *out, const char *name, const char *value)
{
    add_name(out, name);
    add_quoted(out, value);
}

/** A value that is JSON already: null, true, false. */
static void add_word(qm_text *out, const char *name, const char *word)
{
    add_name(out, name);
    qm_text_add_string(out, word);
}

static void add_bool(qm_text *out, const char *name, bool value)
{
    add_word(out, name, value ? "true" : "false");
}

static void add_number(qm_text *out, const char *name, double value)
{
    char text[QM_JSON_NUMBER_SIZE];
    add_word(out, name, qm_json_number(value, text));
}

static void add_count(qm_text *out, const char *name, uint64_t value)
{
    add_name(out, name);
    qm_text_printf(out, "%llu", (unsigned long long)value);
}

static void add_numbers(qm_text *out, const char *name, const double *values, int count)
{
    char text[QM_JSON_NUMBER_SIZE];
    open_member(out, name, "[");
    for (int i = 0; i < count; i++) {
        add_comma(out);
        qm_text_add_string(out, qm_json_number(values[i], text));
    }
    qm_text_add_string(out, "]");
}

/* ---- meshes ---- */

static void add_faces(qm_text *out, const qm_loaded_mesh *mesh)
{
    open_member(out, "faces", "{");
    add_count(out, "triangles", mesh->facts.triangles);
    add_count(out, "quads", mesh->facts.quads);
    add_count(out, "polygons", mesh->facts.polygons);
    qm_text_add_string(out, "}");
}

static void add_box(qm_text *out, const qm_loaded_mesh *mesh)
{
    open_member(out, "bounding_box", "{");
    add_numbers(out, "min", mesh->box.min, 3);
    add_numbers(out, "max", mesh->box.max, 3);
    add_number(out, "diagonal", mesh->diagonal);
    qm_text_add_string(out, "}");
}

static void add_times(qm_text *out, const qm_loaded_mesh *mesh)
{
    open_member(out, "prepare_ms", "{");
    add_number(out, "parse", mesh->parse_ms);
    add_number(out, "topology", mesh->topology_ms);
    add_number(out, "bvh", mesh->bvh_ms);
    qm_text_add_string(out, "}");
}

void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh)
{
    qm_text_add_string(out, "{");
    if (label->id) add_string(out, "id", label->id);
    add_string(out, "name", label->name);
    add_string(out, "kind", qm_loaded_mesh_kind(mesh));
    add_count(out, "vertices", mesh->mesh.vertex_count);
    add_faces(out, mesh);
    add_count(out, "irregular_vertices", mesh->facts.irregular_vertices);
    add_count(out, "boundary_edges", mesh->facts.boundary_edges);
    add_count(out, "components", mesh->facts.components);
    add_bool(out, "manifold", mesh->facts.manifold);
    add_box(out, mesh);
    add_string(out, "format", qm_format_name(mesh->format));
    add_count(out, "size_bytes", mesh->file_size);
    add_count(out, "memory_bytes", qm_loaded_mesh_memory_size(mesh));
    add_times(out, mesh);
    add_count(out, "revision", label->revision);
    if (label->content_hash) add_string(out, "content_hash", label->content_hash);
    if (label->created) add_string(out, "created", label->created);
    open_member(out, "warnings", "[");
    for (size_t i = 0; i < mesh->warning_count; i++) {
        add_comma(out);
        add_quoted(out, mesh->warnings[i]);
    }
    qm_text_add_string(out, "]}");
}

/* ---- problems ---- */

static void add_error(qm_text *out, const qm_problem_error *error)
{
    add_comma(out);
    qm_text_add_string(out, "{");
    if (error->pointer[0]) add_string(out, "pointer", error->pointer);
    if (error->line != QM_NO_PLACE) add_count(out, "line", error->line);
    if (error->offset != QM_NO_PLACE) add_count(out, "offset", error->offset);
    add_string(out, "detail", error->detail);
    qm_text_add_string(out, "}");
}

void qm_json_write_problem(qm_text *out, const qm_problem *problem)
{
    char type[96];
    snprintf(type, sizeof type, "/problems/%s", qm_problem_name(problem->code));
    qm_text_add_string(out, "{");
    add_string(out, "type", type);
    add_string(out, "title", qm_problem_title(problem->code));
    add_count(out, "status", (uint64_t)qm_problem_status(problem->code));
    add_string(out, "detail", problem->detail);
    add_string(out, "code", qm_problem_name(problem->code));
    if (problem->error_count > 0) {
        open_member(out, "errors", "[");
        for (size_t i = 0; i < problem->error_count; i++)
            add_error(out, &problem->errors[i]);
        qm_text_add_string(out, "]");
    }
    qm_text_add_string(out, "}");
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
    qm_text_add_string(out, "{");
    add_string(out, "type", "hausdorff");
    add_string(out, "a", request->a);
    add_string(out, "b", request->b);
    add_string(out, "direction", direction_name(request->direction));
    add_string(out, "quads", quads_name(request->quads));
    add_number(out, "tolerance", request->tolerance);
    add_string(out, "tolerance_unit", request->tolerance_is_absolute ? "absolute" : "relative");
    if (!isnan(request->threshold)) add_number(out, "threshold", request->threshold);
    if (request->deadline_ms > 0.0) add_number(out, "deadline_ms", request->deadline_ms);
    if (request->threads > 0) add_count(out, "threads", (uint64_t)request->threads);
    qm_text_add_string(out, "}");
}

/** A bound as a share of the diagonal, rounded away from the inside of the bracket. */
static double relative_bound(double bound, double diagonal, double towards)
{
    if (!(diagonal > 0.0)) return INFINITY;
    double share = bound / diagonal;
    return bound == 0.0 ? 0.0 : nextafter(share, towards);
}

static void add_bounds(qm_text *out, double lower, double upper, double diagonal)
{
    add_number(out, "lower", lower);
    add_number(out, "upper", upper);
    add_number(out, "lower_relative", relative_bound(lower, diagonal, 0.0));
    add_number(out, "upper_relative", relative_bound(upper, diagonal, INFINITY));
}

static void add_surface_point(qm_text *out, const char *name, const char *mesh, const char *id, uint32_t face,
                              const qm_surface_point *point)
{
    open_member(out, name, "{");
    add_string(out, "mesh", mesh);
    if (id[0]) add_string(out, "id", id);
    add_count(out, "face", face);
    add_numbers(out, "uv", point->uv, 2);
    add_numbers(out, "point", point->position, 3);
    qm_text_add_string(out, "}");
}

static void add_witness(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_hausdorff_result *h = &result->hausdorff;
    bool from_a = h->from_side == 0;
    open_member(out, "witness", "{");
    add_surface_point(out, "from", from_a ? "a" : "b", from_a ? request->a : request->b, result->from_face,
                      &h->from);
    add_surface_point(out, "to", from_a ? "b" : "a", from_a ? request->b : request->a, result->to_face,
                      &h->to);
    qm_text_add_string(out, "}");
}

void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const stop_names[] = {"converged", "threshold", "deadline", "canceled", "precision"};
    const qm_hausdorff_result *h = &result->hausdorff;
    qm_text_add_string(out, "{");
    add_bounds(out, h->lower, h->upper, result->diagonal);
    if (h->has_witness)
        add_witness(out, request, result);
    else
        add_word(out, "witness", "null");
    add_string(out, "direction", direction_name(request->direction));
    add_string(out, "quads", quads_name(request->quads));
    add_number(out, "tolerance", result->tolerance);
    add_count(out, "iterations", h->iterations);
    add_count(out, "projections", h->projections);
    add_count(out, "max_queue", h->max_queue);
    open_member(out, "prepare_ms", "{");
    add_number(out, "a", result->prepare_a_ms);
    add_number(out, "b", result->prepare_b_ms);
    qm_text_add_string(out, "}");
    add_number(out, "elapsed_ms", h->elapsed_ms);
    add_bool(out, "converged", h->stop == QM_STOP_CONVERGED);
    add_string(out, "stopped_by", stop_names[h->stop]);
    if (h->verdict == 0)
        add_word(out, "verdict", "null");
    else
        add_string(out, "verdict", h->verdict > 0 ? "above" : "below");
    qm_text_add_string(out, "}");
}

void qm_json_write_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal)
{
    qm_text_add_string(out, "{");
    add_number(out, "elapsed_ms", progress->elapsed_ms);
    add_bounds(out, progress->lower, progress->upper, diagonal);
    add_number(out, "gap_relative",
               diagonal > 0.0 ? (progress->upper - progress->lower) / diagonal : INFINITY);
    add_count(out, "iterations", progress->iterations);
    add_count(out, "projections", progress->projections);
    add_count(out, "queue", progress->queue_count);
    qm_text_add_string(out, "}");
}
