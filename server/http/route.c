/**
 * route.c: the table of routes, and the search in it.
 */
#include "route.h"

#include <stdio.h>
#include <string.h>

#include "handlers.h"
#include "ops/job_kinds.h"

static const char *const json[] = {"application/json", NULL};
static const char *const json_or_id[] = {"application/json", QM_MEDIA_TEXT, NULL};
static const char *const files[] = {
#define XX(number, suffix, name, media, magic) media,
    QM_FORMAT_MAP(XX)
#undef XX
        NULL};
static const char *const rows[] = {QM_MEDIA_BINARY, QM_MEDIA_CSV, QM_MEDIA_JSON, NULL};
static const char *const pages[] = {"text/html", NULL};
static const char *const object_or_rows[] = {QM_MEDIA_JSON, QM_MEDIA_BINARY, QM_MEDIA_CSV, NULL};
static const char *const results[] = {QM_MEDIA_JSON, QM_MEDIA_BINARY, QM_MEDIA_CSV, QM_MEDIA_PLY, NULL};
static const char *const events[] = {QM_MEDIA_NDJSON, QM_MEDIA_SSE, NULL};
static const char *const lines[] = {QM_MEDIA_NDJSON, NULL};
static const char *const job_or_events[] = {"application/json", QM_MEDIA_NDJSON, QM_MEDIA_SSE, QM_MEDIA_TEXT,
                                            NULL};

static const char *const no_query[] = {NULL};
static const char *const deadline_query[] = {"deadline_ms", NULL};
static const char *const mirror_query[] = {"deadline_ms", "mirror", NULL};
static const char *const mesh_list_query[] = {"limit",        "cursor", "order", "name",
                                              "content_hash", "label",  NULL};
static const char *const job_list_query[] = {"limit", "cursor",         "order", "state", "type",
                                             "mesh",  "reconstruction", "label", NULL};
static const char *const list_query[] = {"limit", "cursor", "order", "mesh", NULL};
static const char *const upload_query[] = {"name",        "format", "ttl_seconds", "unit",
                                           "uncertainty", "labels", NULL};
static const char *const format_query[] = {"format", NULL};
static const char *const content_query[] = {"format", "quantization", "uv", NULL};
static const char *const quality_query[] = {"metric", NULL};
static const char *const rows_query[] = {"dtype", NULL};
static const char *const project_query[] = {"dtype",       "quads",     "order", "threads",
                                            "accelerator", "transform", NULL};
static const char *const delete_query[] = {"job", NULL};
static const char *const report_query[] = {"limit", "limit_in", "limit_out", "range", NULL};
static const char *const events_query[] = {"after", NULL};

static const qm_route routes[] = {
    {"POST", "/v1/meshes", QM_SCOPE_WRITE, qm_handle_mesh_create, json_or_id, QM_BODY_FILE, QM_LANE_DECODE,
     upload_query},
    {"GET", "/v1/meshes", QM_SCOPE_READ, qm_handle_mesh_list, json, QM_BODY_NONE, QM_LANE_SHORT,
     mesh_list_query},
    {"GET", "/v1/meshes/{id}", QM_SCOPE_READ, qm_handle_mesh_get, json, QM_BODY_NONE, QM_LANE_SHORT,
     no_query},
    {"GET", "/v1/meshes/" QM_JOB_HASH_PREFIX "{hash}", QM_SCOPE_READ, qm_handle_mesh_find, json_or_id,
     QM_BODY_NONE, QM_LANE_SHORT, no_query},
    {"PATCH", "/v1/meshes/{id}", QM_SCOPE_WRITE, qm_handle_mesh_patch, json, QM_BODY_MEMORY, QM_LANE_SHORT,
     no_query},
    {"DELETE", "/v1/meshes/{id}", QM_SCOPE_WRITE, qm_handle_mesh_delete, NULL, QM_BODY_NONE, QM_LANE_SHORT,
     no_query},
    {"GET", "/v1/meshes/{id}/content", QM_SCOPE_READ, qm_handle_mesh_content, files, QM_BODY_NONE,
     QM_LANE_DOWNLOAD, content_query},
    {"GET", "/v1/meshes/{id}/patches", QM_SCOPE_READ, qm_handle_mesh_patches, json, QM_BODY_NONE,
     QM_LANE_DOWNLOAD, no_query},
    {"GET", "/v1/meshes/{id}/quality", QM_SCOPE_READ, qm_handle_mesh_quality, object_or_rows, QM_BODY_NONE,
     QM_LANE_DOWNLOAD, quality_query},
    {"GET", "/v1/meshes/{id}/vertices", QM_SCOPE_READ, qm_handle_mesh_vertices, rows, QM_BODY_NONE,
     QM_LANE_DOWNLOAD, no_query},
    {"PATCH", "/v1/meshes/{id}/vertices", QM_SCOPE_WRITE, qm_handle_mesh_deform, json, QM_BODY_SPOOL,
     QM_LANE_EDIT, rows_query},
    {"POST", "/v1/meshes/{id}/copies", QM_SCOPE_WRITE, qm_handle_mesh_copy, json, QM_BODY_MEMORY,
     QM_LANE_DECODE, no_query},
    /* A projection is a POST only because of its size: it reads. */
    {"POST", "/v1/meshes/{id}/project", QM_SCOPE_READ, qm_handle_mesh_project, rows, QM_BODY_SPOOL,
     QM_LANE_QUERY, project_query},
    {"POST", "/v1/jobs", QM_SCOPE_WRITE, qm_handle_job_create, job_or_events, QM_BODY_MEMORY, QM_LANE_SHORT,
     no_query},
    {"GET", "/v1/jobs", QM_SCOPE_READ, qm_handle_job_list, json, QM_BODY_NONE, QM_LANE_SHORT, job_list_query},
    {"GET", "/v1/jobs/{id}", QM_SCOPE_READ, qm_handle_job_get, json, QM_BODY_NONE, QM_LANE_SHORT, no_query},
    {"PATCH", "/v1/jobs/{id}", QM_SCOPE_WRITE, qm_handle_job_patch, json, QM_BODY_MEMORY, QM_LANE_SHORT,
     no_query},
    {"DELETE", "/v1/jobs/{id}", QM_SCOPE_WRITE, qm_handle_job_delete, NULL, QM_BODY_NONE, QM_LANE_SHORT,
     delete_query},
    {"GET", "/v1/jobs/{id}/events", QM_SCOPE_READ, qm_handle_job_events, events, QM_BODY_NONE, QM_LANE_SHORT,
     events_query},
    {"GET", "/v1/jobs/{id}/result", QM_SCOPE_READ, qm_handle_job_result, results, QM_BODY_NONE, QM_LANE_SHORT,
     format_query},
    {"GET", "/v1/jobs/{id}/report", QM_SCOPE_READ, qm_handle_job_report, pages, QM_BODY_NONE, QM_LANE_DECODE,
     report_query},
    {"POST", "/v1/layouts", QM_SCOPE_WRITE, qm_handle_layout_create, json, QM_BODY_MEMORY, QM_LANE_EDIT,
     no_query},
    {"GET", "/v1/layouts", QM_SCOPE_READ, qm_handle_layout_list, json, QM_BODY_NONE, QM_LANE_SHORT,
     list_query},
    {"GET", "/v1/layouts/{id}", QM_SCOPE_READ, qm_handle_layout_get, json, QM_BODY_NONE, QM_LANE_SHORT,
     no_query},
    {"DELETE", "/v1/layouts/{id}", QM_SCOPE_WRITE, qm_handle_layout_delete, NULL, QM_BODY_NONE, QM_LANE_SHORT,
     no_query},
    {"POST", "/v1/layouts/{id}/strokes", QM_SCOPE_WRITE, qm_handle_layout_stroke, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/rings", QM_SCOPE_WRITE, qm_handle_layout_ring, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/links", QM_SCOPE_WRITE, qm_handle_layout_link, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/tubes", QM_SCOPE_WRITE, qm_handle_layout_tube, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/fill", QM_SCOPE_WRITE, qm_handle_layout_fill, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/mirror", QM_SCOPE_WRITE, qm_handle_layout_mirror, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/features", QM_SCOPE_WRITE, qm_handle_layout_features, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"GET", "/v1/layouts/{id}/suggestions", QM_SCOPE_READ, qm_handle_layout_suggestions, json, QM_BODY_NONE,
     QM_LANE_EDIT, mirror_query},
    {"GET", "/v1/layouts/{id}/symmetry", QM_SCOPE_READ, qm_handle_layout_symmetry, json, QM_BODY_NONE,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves", QM_SCOPE_WRITE, qm_handle_curve_add, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/marks", QM_SCOPE_WRITE, qm_handle_layout_mark, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/nodes/merge", QM_SCOPE_WRITE, qm_handle_node_merge, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/nodes/{node}/move", QM_SCOPE_WRITE, qm_handle_node_move, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/undo", QM_SCOPE_WRITE, qm_handle_layout_undo, json, QM_BODY_MEMORY,
     QM_LANE_SHORT, no_query},
    {"POST", "/v1/layouts/{id}/redo", QM_SCOPE_WRITE, qm_handle_layout_redo, json, QM_BODY_MEMORY,
     QM_LANE_SHORT, no_query},
    {"POST", "/v1/layouts/{id}/curves/merge", QM_SCOPE_WRITE, qm_handle_curve_merge, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves/{curve}/split", QM_SCOPE_WRITE, qm_handle_curve_split, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves/{curve}/snap", QM_SCOPE_WRITE, qm_handle_curve_snap, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves/{curve}/redraw", QM_SCOPE_WRITE, qm_handle_curve_redraw, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves/{curve}/slide", QM_SCOPE_WRITE, qm_handle_curve_slide, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"POST", "/v1/layouts/{id}/curves/{curve}/split-chord", QM_SCOPE_WRITE, qm_handle_chord_split, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"DELETE", "/v1/layouts/{id}/curves/{curve}", QM_SCOPE_WRITE, qm_handle_curve_delete, json, QM_BODY_NONE,
     QM_LANE_EDIT, mirror_query},
    {"POST", "/v1/reconstructions", QM_SCOPE_WRITE, qm_handle_reconstruction_create, json, QM_BODY_MEMORY,
     QM_LANE_EDIT, no_query},
    {"GET", "/v1/reconstructions", QM_SCOPE_READ, qm_handle_reconstruction_list, json, QM_BODY_NONE,
     QM_LANE_SHORT, list_query},
    {"GET", "/v1/reconstructions/{id}", QM_SCOPE_READ, qm_handle_reconstruction_get, json, QM_BODY_NONE,
     QM_LANE_SHORT, no_query},
    {"DELETE", "/v1/reconstructions/{id}", QM_SCOPE_WRITE, qm_handle_reconstruction_delete, NULL,
     QM_BODY_NONE, QM_LANE_SHORT, no_query},
    {"PUT", "/v1/reconstructions/{id}/layout", QM_SCOPE_WRITE, qm_handle_reconstruction_edit, json,
     QM_BODY_MEMORY, QM_LANE_EDIT, deadline_query},
    {"GET", "/v1/reconstructions/{id}/mesh", QM_SCOPE_READ, qm_handle_reconstruction_mesh, files,
     QM_BODY_NONE, QM_LANE_SHORT, format_query},
    {"GET", "/v1/reconstructions/{id}/patches", QM_SCOPE_READ, qm_handle_reconstruction_patches, json,
     QM_BODY_NONE, QM_LANE_EDIT, no_query},
    {"POST", "/v1/batches", QM_SCOPE_WRITE, qm_handle_batch_create, lines, QM_BODY_SPOOL, QM_LANE_AT_ONCE,
     no_query},
    {"POST", "/v1/compare", QM_SCOPE_WRITE, qm_handle_compare, json, QM_BODY_SPOOL, QM_LANE_DECODE, no_query},
    {"GET", "/v1/info", QM_SCOPE_READ, qm_handle_info, json, QM_BODY_NONE, QM_LANE_AT_ONCE, no_query},
    {"GET", "/healthz", QM_SCOPE_NONE, qm_handle_health, NULL, QM_BODY_NONE, QM_LANE_AT_ONCE, NULL},
    {"GET", "/readyz", QM_SCOPE_NONE, qm_handle_ready, NULL, QM_BODY_NONE, QM_LANE_AT_ONCE, NULL},
    {"GET", "/metrics", QM_SCOPE_READ, qm_handle_metrics, NULL, QM_BODY_NONE, QM_LANE_AT_ONCE, NULL},
    {"GET", "/openapi.yaml", QM_SCOPE_NONE, qm_handle_openapi, NULL, QM_BODY_NONE, QM_LANE_SHORT, NULL},
    {"GET", "/docs", QM_SCOPE_NONE, qm_handle_docs, NULL, QM_BODY_NONE, QM_LANE_SHORT, NULL},
    {"GET", "/problems/{code}", QM_SCOPE_NONE, qm_handle_problem, NULL, QM_BODY_NONE, QM_LANE_AT_ONCE, NULL},
    {"GET", "/", QM_SCOPE_NONE, qm_handle_page, NULL, QM_BODY_NONE, QM_LANE_SHORT, NULL},
    {"GET", "/dashboard/{path}", QM_SCOPE_NONE, qm_handle_page, NULL, QM_BODY_NONE, QM_LANE_SHORT, NULL},
};
enum { ROUTE_COUNT = sizeof routes / sizeof routes[0] };

static bool is_id_character(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '.' || c == '-';
}

/** {id}, {hash} and a second name in braces stand for the rest of a segment each, {path} for any number of segments, of which
 * none begins with a dot. */
static bool matches(const char *pattern, const char *path, char ids[2][QM_HASH_SIZE])
{
    char *id = ids[0];
    ids[0][0] = ids[1][0] = '\0';
    for (; *pattern; pattern++) {
        if (*pattern != '{') {
            if (*pattern != *path++) return false;
            continue;
        }
        bool takes_segments = strncmp(pattern, "{path}", strlen("{path}")) == 0;
        size_t length = 0,
               size = strncmp(pattern, "{hash}", strlen("{hash}")) == 0 ? QM_HASH_SIZE : QM_ID_SIZE;
        for (; length + 1 < size; path++) {
            bool starts_segment = takes_segments && (length == 0 || path[-1] == '/');
            bool fits = starts_segment ? is_id_character(*path) && *path != '.'
                                       : is_id_character(*path) || (takes_segments && *path == '/');
            if (!fits) break;
            id[length++] = *path;
        }
        id[length] = '\0';
        if (length == 0) return false;
        pattern = strchr(pattern, '}');
        id = ids[1];
    }
    return *path == '\0';
}

const qm_route *qm_route_find(const char *method, const char *path, char ids[2][QM_HASH_SIZE],
                              qm_problem *problem)
{
    const char *wanted = strcmp(method, "HEAD") == 0 ? "GET" : method;
    char allow[64] = "";
    const char *resource = NULL; /* of patterns that match, the first listed is the resource */
    for (size_t i = 0; i < ROUTE_COUNT; i++) {
        if (resource && strcmp(routes[i].path, resource) != 0) continue;
        if (!matches(routes[i].path, path, ids)) continue;
        resource = routes[i].path;
        if (strcmp(routes[i].method, wanted) == 0) return &routes[i];
        size_t used = strlen(allow);
        snprintf(allow + used, sizeof allow - used, "%s%s", used ? ", " : "",
                 strcmp(routes[i].method, "GET") == 0 ? "GET, HEAD" : routes[i].method);
    }
    if (allow[0]) {
        *problem = qm_problem_make(QM_PROBLEM_METHOD_NOT_ALLOWED, "this resource allows %s", allow);
        snprintf(problem->allow, sizeof problem->allow, "%s", allow);
    } else {
        *problem = qm_problem_make(QM_PROBLEM_NOT_FOUND, "there is no resource at this path");
    }
    return NULL;
}

void qm_route_print_all(void)
{
    for (size_t i = 0; i < ROUTE_COUNT; i++) {
        printf("%s %s", routes[i].method, routes[i].path);
        for (const char *const *type = routes[i].produces; type && *type; type++)
            printf(" %s", *type);
        for (const char *const *name = routes[i].query; name && *name; name++)
            printf(" ?%s", *name);
        printf("\n");
    }
}
