/**
 * handle_quality.c: the shape of the faces of a mesh by metrics of finite elements (GET .../quality): all of them summed up, or
 * one with a value for each face, block by block.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "handlers.h"
#include "media.h"
#include "ops/quality_out.h"

#define BLOCK 8192 /* faces */

/** What is sent of one metric. */
typedef struct quality_reply {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_metric metric;
    qm_array_format rows;
    qm_metric_summary summary; /* of JSON */
    size_t count, done, place; /* faces of the input; where those that are left begin */
} quality_reply;

static void end_reply(void *user)
{
    quality_reply *s = user;
    qm_meshes_release(s->meshes, s->mesh);
    free(s);
}

static void begin_rows(const quality_reply *s, qm_text *out)
{
    if (s->rows == QM_ARRAY_CSV) qm_text_printf(out, "face,%s\n", qm_metric_names[s->metric]);
    if (s->rows != QM_ARRAY_JSON) return;
    qm_text_add_string(out, "{");
    qm_quality_add_summary(out, s->metric, &s->summary);
    qm_json_open(out, "values", "[");
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    (void)problem; /* only memory can run out, which out remembers */
    quality_reply *s = user;
    double values[BLOCK];
    size_t rest = s->count - s->done, count = rest < BLOCK ? rest : BLOCK;
    if (s->done == 0) begin_rows(s, out);
    qm_metric_measure(&qm_mesh_ref_get(s->mesh)->mesh, s->metric, s->done, count, &s->place, values);
    qm_text_add_array(out, s->rows, 1, s->done, values, count);
    s->done += count;
    if (s->done < s->count) return QM_BLOCK_MORE;
    if (s->rows == QM_ARRAY_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

/** Reads ?metric=; QM_METRIC_COUNT is all. False after a refusal. */
static bool read_metric(qm_request *request, qm_metric *out)
{
    const char *name = qm_request_query(request, "metric");
    int metric = name ? 0 : QM_METRIC_COUNT;
    while (metric < QM_METRIC_COUNT && strcmp(qm_metric_names[metric], name) != 0)
        metric++;
    *out = (qm_metric)metric;
    bool is_known = !name || metric < QM_METRIC_COUNT;
    if (is_known && (name || qm_request_rows(request) == QM_ARRAY_JSON)) return true;
    char names[256] = "";
    for (int m = 0; m < QM_METRIC_COUNT; m++)
        snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", m > 0 ? ", " : "",
                 qm_metric_names[m]);
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "%s must be one of %s",
                                         name ? "`metric`" : "for a value of each face, `metric`", names);
    qm_reply_problem(request, &problem);
    return false;
}

static void reply_all(qm_request *request, qm_meshes *meshes, qm_mesh_ref *mesh)
{
    qm_context ctx = qm_meshes_context(meshes);
    qm_text out = {0};
    qm_status status = qm_quality_write(&ctx, &qm_mesh_ref_get(mesh)->mesh, &out);
    qm_meshes_release(meshes, mesh);
    if (status == QM_OK) {
        qm_reply_text(request, 200, QM_MEDIA_JSON, qm_text_take(&out));
        return;
    }
    qm_text_reset(&out);
    qm_problem problem = qm_problem_from_status(status, ctx.message);
    qm_reply_problem(request, &problem);
}

/** Takes over the reference; NULL with a problem. */
static quality_reply *begin_reply(qm_meshes *meshes, qm_mesh_ref *mesh, qm_metric metric,
                                  qm_array_format rows, qm_problem *problem)
{
    const qm_mesh *faces = &qm_mesh_ref_get(mesh)->mesh;
    qm_context ctx = qm_meshes_context(meshes);
    quality_reply *s = malloc(sizeof *s);
    qm_status status = s ? QM_OK : qm_context_fail(&ctx, QM_E_NO_MEMORY, "out of memory for the reply");
    if (s)
        *s = (quality_reply){.meshes = meshes,
                             .mesh = mesh,
                             .metric = metric,
                             .rows = rows,
                             .count = qm_metric_face_count(faces)};
    if (s && rows == QM_ARRAY_JSON) status = qm_metric_summarize(&ctx, faces, metric, &s->summary);
    if (status == QM_OK) return s;
    *problem = qm_problem_from_status(status, ctx.message);
    free(s);
    qm_meshes_release(meshes, mesh);
    return NULL;
}

void qm_handle_mesh_quality(qm_request *request)
{
    static const char *const forms[] = {"f64", "csv", "json"};
    qm_meshes *meshes = qm_request_app(request)->meshes;
    qm_metric metric;
    char suffix[48];
    if (!read_metric(request, &metric)) return;
    qm_array_format rows = qm_request_rows(request);
    snprintf(suffix, sizeof suffix, "-quality-%s-%s",
             metric < QM_METRIC_COUNT ? qm_metric_names[metric] : "all", forms[rows]);
    qm_mesh_ref *mesh = qm_handlers_take_mesh(request, suffix);
    if (!mesh) return;
    if (metric == QM_METRIC_COUNT) {
        reply_all(request, meshes, mesh);
        return;
    }
    qm_problem problem;
    quality_reply *s = begin_reply(meshes, mesh, metric, rows, &problem);
    if (!s) {
        qm_reply_problem(request, &problem);
        return;
    }
    uint64_t size = rows == QM_ARRAY_BINARY ? s->count * sizeof(double) : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_block, end_reply, s});
}
