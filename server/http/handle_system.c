/**
 * handle_system.c: health, metrics, and facts about the daemon.
 */
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/metrics.h"
#include "handlers.h"
#include "ops/job_kinds.h"
#include "qm/bvh.h"

void qm_handle_health(qm_request *request)
{
    qm_reply_static(request, 200, "application/json", "{\"status\":\"ok\"}");
}

void qm_handle_ready(qm_request *request)
{
    if (!atomic_load(&qm_request_app(request)->draining)) {
        qm_reply_static(request, 200, "application/json", "{\"status\":\"ready\"}");
        return;
    }
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping");
    qm_reply_problem(request, &problem);
}

void qm_handle_metrics(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_job_counts jobs = qm_jobs_count(app->jobs);
    qm_meshes_memory memory = qm_meshes_measure(app->meshes);
    qm_pool_load decodes = qm_pool_count(app->pools[QM_LANE_DECODE]);
    const qm_metrics_gauge gauges[] = {
        {"jobs_queued", "Queued jobs.", (double)jobs.queued},
        {"jobs_running", "Running jobs.", (double)jobs.running},
        {"jobs_paused", "Running jobs that wait for their next turn.", (double)jobs.paused},
        {"jobs_limit", "Capacity of the queue.", app->config->queue},
        {"streams_open", "Open streams.", atomic_load(&app->stream_count)},
        {"streams_limit", "Limit of open streams.", app->config->streams},
        {"connections_open", "Connections.", (double)qm_http_count_connections(app->http)},
        {"connections_limit", "Limit of connections.", app->config->connections},
        {"memory_bytes", "Memory of meshes and jobs, bytes.", (double)memory.used},
        {"memory_limit_bytes", "Memory budget, bytes.", (double)memory.limit},
        {"meshes_loaded", "Meshes in memory.", (double)memory.loaded},
        {"decodes_running", "Meshes that are decoded.", (double)decodes.running},
        {"decodes_waiting", "Meshes that wait for a decoder.", (double)decodes.waiting},
        {"requests_open", "Requests in progress.", atomic_load(&app->request_count)},
    };
    qm_text out = {0};
    qm_metrics_write(&out, gauges, sizeof gauges / sizeof gauges[0]);
    qm_reply_text(request, 200, "text/plain; version=0.0.4; charset=utf-8", qm_text_take(&out));
}

/** A member with the names of a NULL-ended list. */
static void add_names(qm_text *out, const char *member, const char *const *names)
{
    qm_json_open(out, member, "[");
    for (; *names; names++) {
        qm_json_add_comma(out);
        qm_json_add_quoted(out, *names);
    }
    qm_text_add_string(out, "]");
}

void qm_handle_info(qm_request *request)
{
    const qm_config *config = qm_request_app(request)->config;
    qm_job_counts counts = qm_jobs_count(qm_request_app(request)->jobs);
    qm_text out = {0};
#define XX(number, suffix, name, media, magic) #name,
    static const char *const formats[] = {QM_FORMAT_MAP(XX) NULL};
#undef XX
    qm_text_printf(&out, "{\"name\":\"quadmeshd\",\"version\":\"%s\",\"kernel\":\"%s\"", QM_VERSION,
                   qm_kernel_name());
    add_names(&out, "formats", formats);
    add_names(&out, "jobs", qm_job_kind_names);
    add_names(&out, "accelerators", qm_accelerator_names);
    qm_text_printf(&out,
                   ",\"limits\":{\"body_bytes\":%.15g,"
                   "\"memory_bytes\":%zu,"
                   "\"faces\":%.15g,\"queued_jobs\":%.15g,\"connections\":%.15g,\"streams\":%.15g},"
                   "\"workers\":%.15g,\"queued\":%zu,\"running\":%zu}",
                   config->max_body, qm_meshes_measure(qm_request_app(request)->meshes).limit,
                   config->max_faces, config->queue, config->connections, config->streams, config->workers,
                   counts.queued, counts.running);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}
