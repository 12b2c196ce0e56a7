/**
 * handle_system.c: health, metrics, and facts about the daemon.
 */
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/json.h"
#include "base/metrics.h"
#include "handlers.h"
#include "ops/job_kinds.h"
#include "qm/bvh.h"

/** Free bytes below which the daemon is not ready: a small upload and the database need about this. */
#define MIN_FREE_DISK (64.0 * 1048576.0)

void qm_handle_health(qm_request *request)
{
    qm_reply_static(request, 200, "application/json", "{\"status\":\"ok\"}");
}

/** Bytes of the data folder's disk that are free for this process; NAN when that is not known. */
static double measure_free_disk(const qm_app *app)
{
    struct statvfs disk;
    if (statvfs(app->config->data_dir, &disk) != 0) return NAN;
    return (double)disk.f_bavail * (double)disk.f_frsize;
}

void qm_handle_ready(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    double free_bytes = measure_free_disk(app);
    qm_problem problem;
    if (atomic_load(&app->draining)) {
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping");
    } else if (qm_jobs_is_isolated(app->jobs)) {
        problem = qm_problem_make(QM_PROBLEM_STORE_UNAVAILABLE,
                                  "this node has not reached the database for some seconds");
    } else if (!(free_bytes >= MIN_FREE_DISK)) {
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE,
                                  "the disk of the data folder is full: %.0f bytes are free, %.0f are needed",
                                  fmax(free_bytes, 0.0), MIN_FREE_DISK);
    } else {
        qm_reply_static(request, 200, "application/json", "{\"status\":\"ready\"}");
        return;
    }
    qm_reply_problem(request, &problem);
}

/** Writes the process metrics that Prometheus' client libraries have, from /proc; nothing when it is not there. */
static void write_process(qm_text *out)
{
    struct rusage usage;
    if (getrusage(RUSAGE_SELF, &usage) == 0)
        qm_metrics_write_plain(out, "process_cpu_seconds_total", "counter", "Processor time, seconds.",
                               (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                                   1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec));
    FILE *file = fopen("/proc/self/statm", "re");
    unsigned long long size, resident;
    if (file && fscanf(file, "%llu %llu", &size, &resident) == 2) {
        double page = (double)sysconf(_SC_PAGESIZE);
        qm_metrics_write_plain(out, "process_virtual_memory_bytes", "gauge", "Address space, bytes.",
                               page * (double)size);
        qm_metrics_write_plain(out, "process_resident_memory_bytes", "gauge", "Memory in use, bytes.",
                               page * (double)resident);
    }
    if (file) fclose(file);
    DIR *folder = opendir("/proc/self/fd");
    if (!folder) return;
    size_t count = 0;
    while (readdir(folder))
        count++;
    closedir(folder);
    /* Without the two dots and the folder itself. */
    qm_metrics_write_plain(out, "process_open_fds", "gauge", "Open files.", (double)(count - 3));
}

/** Writes what the node knows of its cluster. */
static void write_cluster(qm_text *out, qm_app *app)
{
    qm_store_cluster cluster;
    double age_s;
    if (!qm_jobs_read_cluster(app->jobs, &cluster, &age_s)) return;
    bool is_up = !qm_jobs_is_isolated(app->jobs);
    qm_metrics_write_plain(out, "quadmeshd_store_up", "gauge", "1 while the shared store answers.", is_up);
    qm_metrics_write_plain(out, "quadmeshd_store_beat_age_seconds", "gauge",
                           "Since the last beat that was stored.", age_s);
    qm_metrics_write_plain(out, "quadmeshd_cluster_nodes", "gauge", "Nodes that live.",
                           (double)cluster.nodes);
    qm_metrics_write_plain(out, "quadmeshd_cluster_jobs_queued", "gauge", "Jobs that wait in the cluster.",
                           (double)cluster.queued);
    qm_metrics_write_plain(out, "quadmeshd_cluster_jobs_running", "gauge", "Jobs that run in the cluster.",
                           (double)cluster.running);
}

void qm_handle_metrics(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_job_counts jobs = qm_jobs_count(app->jobs);
    qm_meshes_memory memory = qm_meshes_measure(app->meshes);
    qm_pool_load decodes = qm_pool_count(app->pools[QM_LANE_DECODE]);
    qm_store_usage usage;
    qm_store_measure(app->store, &usage);
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
        {"data_bytes", "Bytes of all that is stored.", (double)usage.total},
        {"data_blob_bytes", "Bytes of stored files of meshes.", (double)usage.files[QM_STORE_BLOBS]},
        {"data_result_bytes", "Bytes of stored arrays of results.", (double)usage.files[QM_STORE_RESULTS]},
        {"data_upload_bytes", "Bytes of uploads on their way.", (double)usage.files[QM_STORE_UPLOADS]},
        {"data_database_bytes", "Bytes of the database in use.", (double)usage.database},
        {"data_limit_bytes", "Quota of all that is stored, bytes; 0: none.", (double)usage.quota},
        {"disk_free_bytes", "Free bytes on the disk of the data folder.", measure_free_disk(app)},
        {"requests_open", "Requests in progress.", atomic_load(&app->request_count)},
    };
    qm_text out = {0};
    qm_metrics_write(&out, gauges, sizeof gauges / sizeof gauges[0]);
    write_cluster(&out, app);
    qm_text_printf(&out,
                   "# HELP quadmeshd_build_info The version, as a label.\n# TYPE quadmeshd_build_info gauge\n"
                   "quadmeshd_build_info{version=\"%s\"} 1\n",
                   QM_VERSION);
    write_process(&out);
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

/** Adds the node and its cluster; nothing for an embedded store. */
static void add_cluster(qm_text *out, qm_app *app)
{
    static const char *const durabilities[] = {"none", "one machine", "replicated"};
    qm_store_cluster cluster;
    double age_s;
    if (!qm_jobs_read_cluster(app->jobs, &cluster, &age_s)) return;
    qm_json_add_string(out, "node", cluster.node);
    qm_json_open(out, "cluster", "{");
    qm_json_add_string(out, "engine", cluster.engine);
    qm_json_add_string(out, "durability", durabilities[cluster.durability]);
    qm_json_add_count(out, "nodes", cluster.nodes);
    qm_json_add_count(out, "queued", cluster.queued);
    qm_json_add_count(out, "running", cluster.running);
    qm_text_add_string(out, "}");
}

void qm_handle_info(qm_request *request)
{
    const qm_config *config = qm_request_app(request)->config;
    qm_job_counts counts = qm_jobs_count(qm_request_app(request)->jobs);
    qm_store_usage usage;
    qm_store_measure(qm_request_app(request)->store, &usage);
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
                   "\"data_bytes\":%.15g,\"memory_bytes\":%zu,"
                   "\"faces\":%.15g,\"queued_jobs\":%.15g,\"connections\":%.15g,\"streams\":%.15g},"
                   "\"workers\":%.15g,\"queued\":%zu,\"running\":%zu,\"data_bytes\":%.15g",
                   config->max_body, config->max_data_bytes,
                   qm_meshes_measure(qm_request_app(request)->meshes).limit, config->max_faces, config->queue,
                   config->connections, config->streams, config->workers, counts.queued, counts.running,
                   (double)usage.total);
    add_cluster(&out, qm_request_app(request));
    qm_text_add_string(&out, "}");
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}
