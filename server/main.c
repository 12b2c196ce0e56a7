/**
 * main.c: starts the parts in order, waits for a signal, stops them in the opposite order.
 */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <uv.h>

#include "base/host.h"
#include "base/json.h"
#include "base/log.h"
#include "base/notify.h"
#include "format/draco_child.h"
#include "http/http.h"
#include "http/route.h"
#include "store/store_copy.h"

#define SHORT_THREADS 4
#define SHARED_SHORT_THREADS 16 /* a handler waits for a database elsewhere, not for a processor */
#define EDIT_THREADS 2
#define DOWNLOAD_THREADS 2
#define LONG_NICENESS 5 /* of downloads and decoders: as jobs have */
#define TICK_MS 20
#define CONNECTIONS_MS 1000
#define OWN_FILES 64
#define SAVING_MS 500
#define CLEANING_MS 5000
#define BLOB_CLEANING_MS 60000
#define UNNEEDED_S (24 * 60 * 60.0) /* that a blob is kept which nothing names: jobs may still read it */
#define MS_PER_S 1e3
#define S_PER_H 3600.0

enum { SIGNAL_COUNT = 3 };

typedef struct daemon_state {
    qm_app app;
    qm_http *http;
    uv_loop_t loop;
    uv_signal_t signals[SIGNAL_COUNT];
    uv_timer_t tick;
    double saved_ms, connections_checked_ms, cleaned_ms, blobs_cleaned_ms;
} daemon_state;

/** Reads the tokens; false with a record in the log, and the old tokens stay. */
static bool load_tokens(const qm_app *app)
{
    char message[QM_ACCESS_TOKENS_MESSAGE_SIZE];
    if (!app->config->token_file[0]) return true;
    bool loaded = qm_access_tokens_load(app->tokens, app->config->token_file, message);
    struct stat file;
    if (loaded) qm_log(QM_LOG_INFO, "token file: %zu tokens", qm_access_tokens_count(app->tokens));
    if (loaded && stat(app->config->token_file, &file) == 0 && (file.st_mode & (S_IRWXG | S_IRWXO)))
        qm_log(QM_LOG_WARN, "token file: other users may use %s; its mode should be 600",
               app->config->token_file);
    if (!loaded) qm_log(QM_LOG_ERROR, "token file: %s", message);
    return loaded;
}

static void on_signal(uv_signal_t *handle, int number)
{
    daemon_state *state = handle->data;
    if (number == SIGHUP) {
        load_tokens(&state->app);
        return;
    }
    qm_log(QM_LOG_INFO, "signal %d: draining", number);
    atomic_store(&state->app.draining, true);
    uv_stop(&state->loop);
}

static void save(void *jobs)
{
    qm_job_events_save(jobs);
}

static void clean(void *user)
{
    qm_app *app = user;
    qm_jobs_drop_old(app->jobs);
    qm_meshes_drop_expired(app->meshes);
}

/** Of a shared store, which removes the blobs that are no longer needed after a day. */
static void clean_blobs(void *user)
{
    qm_app *app = user;
    qm_store_clean_blobs(app->store, UNNEEDED_S);
    qm_blob_trim_cache(app->store, (uint64_t)app->config->cache_bytes);
}

static void on_tick(uv_timer_t *handle)
{
    daemon_state *state = handle->data;
    double now = qm_clock_now_ms();
    qm_job_events_tick(state->app.jobs, now);
    if (now < state->saved_ms + SAVING_MS) return;
    bool is_shared = qm_store_is_shared(state->app.store);
    if (!is_shared) qm_pool_submit(state->app.pools[QM_LANE_SHORT], NULL, save, state->app.jobs);
    state->saved_ms = now;
    if (now < state->connections_checked_ms + CONNECTIONS_MS) return;
    qm_http_tick(state->http, now);
    state->connections_checked_ms = now;
    if (now < state->cleaned_ms + CLEANING_MS) return;
    qm_pool_submit(state->app.pools[QM_LANE_SHORT], NULL, clean, &state->app);
    state->cleaned_ms = now;
    if (!is_shared || now < state->blobs_cleaned_ms + BLOB_CLEANING_MS) return;
    qm_pool_submit(state->app.pools[QM_LANE_SHORT], NULL, clean_blobs, &state->app);
    state->blobs_cleaned_ms = now;
}

static void stop_loop(daemon_state *state)
{
    /* Further signals are ignored: once the loop is closed they would kill the process. */
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGHUP);
    pthread_sigmask(SIG_BLOCK, &set, NULL);
    for (size_t i = 0; i < SIGNAL_COUNT; i++)
        uv_close((uv_handle_t *)&state->signals[i], NULL);
    uv_close((uv_handle_t *)&state->tick, NULL);
    uv_run(&state->loop, UV_RUN_DEFAULT);
    uv_loop_close(&state->loop);
}

/** Finds the folder of the page: beside the program, or in the share folder of an installation. */
static void find_dashboard(qm_config *config, char *found, size_t size)
{
    if (config->dashboard[0]) return;
    char program[2048];
    ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    if (length <= 0) return;
    program[length] = '\0';
    *strrchr(program, '/') = '\0';
    static const char *const places[] = {"dashboard", "../share/quadmeshd/dashboard"};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        snprintf(found, size, "%s/%s", program, places[i]);
        if (access(found, R_OK) == 0) {
            config->dashboard = found;
            return;
        }
    }
}

static bool create_pools(qm_app *app, const qm_config *config)
{
    int processors = qm_host_thread_count();
    const struct {
        int threads, niceness;
    } sizes[QM_LANE_COUNT] = {
        [QM_LANE_SHORT] = {qm_store_is_shared(app->store) ? SHARED_SHORT_THREADS : SHORT_THREADS, 0},
        [QM_LANE_QUERY] = {processors > 2 ? processors : 2, 0},
        [QM_LANE_EDIT] = {EDIT_THREADS, 0},
        [QM_LANE_DOWNLOAD] = {DOWNLOAD_THREADS, LONG_NICENESS},
        [QM_LANE_DECODE] = {(int)config->decodes, LONG_NICENESS},
    };
    for (int lane = QM_LANE_SHORT; lane < QM_LANE_COUNT; lane++) {
        app->pools[lane] = qm_pool_create(sizes[lane].threads, sizes[lane].niceness);
        if (!app->pools[lane]) return false;
    }
    return true;
}

static qm_meshes *create_meshes(qm_store *store, const qm_config *config)
{
    qm_codec_limits limits = {.max_vertices = (size_t)config->max_faces,
                              .max_faces = (size_t)config->max_faces,
                              .max_size = (size_t)config->max_body};
    size_t memory = config->memory_budget > 0 ? (size_t)config->memory_budget : qm_host_default_budget();
    int prepare_threads = config->prepare_threads > 0 ? (int)config->prepare_threads : qm_host_thread_count();
    return qm_meshes_create(store, limits, memory, prepare_threads);
}

_Static_assert(QM_CONFIG_NODE_NAME < QM_NODE_NAME_SIZE, "a name fits, so that two do not become one");

/** What a shared store is told of this process. */
static qm_store_node describe_node(const qm_config *config)
{
    qm_store_node node = {.version = QM_VERSION,
                          .workers = (int)config->workers,
                          .memory = config->memory_budget > 0 ? (uint64_t)config->memory_budget
                                                              : qm_host_default_budget(),
                          .blobs = config->blobs,
                          .blobs_keys = config->blobs_keys};
    snprintf(node.name, sizeof node.name, "%s", config->node_name);
    if (!node.name[0]) gethostname(node.name, sizeof node.name - 1);
    return node;
}

/** Opens the store of the settings; false with a line in the log. */
static bool open_store(qm_app *app, const qm_config *config)
{
    char message[QM_MESSAGE_SIZE];
    if (!config->store[0]) {
        if (qm_store_open(config->data_dir, QM_STORE_SERVE, &app->store, message) == QM_OK) return true;
        qm_log(QM_LOG_ERROR, "data folder: %s", message);
        return false;
    }
    app->node = describe_node(config);
    bool is_unsafe = config->store_unsafe > 0.0;
    qm_stored stored =
        qm_store_open_shared(config->store, config->data_dir, &app->node, is_unsafe, &app->store, message);
    if (stored != QM_STORED) qm_log(QM_LOG_ERROR, "store: %s", message);
    return stored == QM_STORED;
}

static bool start_parts(daemon_state *state, const qm_config *config)
{
    qm_app *app = &state->app;
    app->config = config;
    app->tokens = qm_access_tokens_create();
    if (!app->tokens || !load_tokens(app) || !open_store(app, config)) return false;
    qm_store_set_quota(app->store, (uint64_t)config->max_data_bytes);
    app->meshes = create_meshes(app->store, config);
    size_t memory = app->meshes ? qm_meshes_measure(app->meshes).limit : 0;
    if (app->meshes) qm_json_set_budget(qm_meshes_budget(app->meshes));
    bool has_pools = create_pools(app, config);
    app->reconstructions = qm_reconstructions_create(app->store, app->meshes);
    if (!app->meshes || !app->reconstructions || !has_pools) return false;
    app->jobs = qm_jobs_create(
        app->store, app->meshes, app->reconstructions,
        (qm_job_limits){.workers = (int)config->workers,
                        .queue = (int)config->queue,
                        .threads = (int)config->job_threads,
                        .max_job_ms =
                            config->max_job_seconds > 0.0 ? config->max_job_seconds * MS_PER_S : INFINITY,
                        .search_memory = memory / 4 < QM_HAUSDORFF_MEMORY ? memory / 4 : QM_HAUSDORFF_MEMORY,
                        .grace_ms = config->grace * MS_PER_S,
                        .kept_jobs = (size_t)config->kept_jobs,
                        .kept_s = config->kept_hours * S_PER_H,
                        .heartbeat_ms = config->heartbeat * MS_PER_S,
                        .node = app->node.name});
    if (!app->jobs) return false;
    state->http = qm_http_start(app);
    if (!state->http || !config->port_file[0]) return state->http;
    FILE *file = fopen(config->port_file, "w");
    if (!file) return false;
    fprintf(file, "%d\n", qm_http_port(state->http));
    return fclose(file) == 0;
}

/**
 * Order matters. While jobs have their grace time the daemon still replies, and refuses new work. Their end
 * resumes all streams. Handlers end next, and then the connections, none of which is suspended by then.
 */
static void stop_parts(daemon_state *state)
{
    qm_app *app = &state->app;
    if (app->jobs) qm_jobs_drain(app->jobs);
    if (state->http) qm_http_quiesce(state->http);
    for (int lane = 0; lane < QM_LANE_COUNT; lane++)
        if (app->pools[lane]) qm_pool_close(app->pools[lane]);
    if (app->jobs) qm_job_events_stop_notifier(app->jobs);
    qm_http_stop(state->http);
    for (int lane = 0; lane < QM_LANE_COUNT; lane++)
        qm_pool_destroy(app->pools[lane]);
    qm_jobs_destroy(app->jobs);
    qm_reconstructions_destroy(app->reconstructions);
    qm_json_set_budget(NULL);
    qm_meshes_destroy(app->meshes);
    qm_store_close(app->store);
    qm_access_tokens_destroy(app->tokens);
}

/** Raises the limit on open files: one for each connection, and some for the daemon. */
static void allow_connections(const qm_config *config)
{
    struct rlimit files;
    rlim_t needed = (rlim_t)config->connections + OWN_FILES;
    if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= needed) return;
    files.rlim_cur = needed < files.rlim_max ? needed : files.rlim_max;
    if (setrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur < needed)
        qm_log(QM_LOG_WARN, "only %ju files may be open: fewer connections than --connections says",
               (uintmax_t)files.rlim_cur);
}

/* ---- tasks ---- */

typedef struct adoption {
    qm_store *store;
    qm_meshes *meshes;
    size_t adopted, moved;
    bool failed;
} adoption;

/** Makes a mesh of a blob. One that is none, positions of a revision or damaged, is moved away. */
static void adopt(void *user, const char *hash)
{
    adoption *work = user;
    qm_store_mesh mesh;
    qm_problem problem;
    if (qm_meshes_adopt(work->meshes, hash, &mesh, &problem)) {
        printf("%s is mesh %s\n", hash, mesh.id);
        qm_store_mesh_reset(&mesh);
        work->adopted++;
        return;
    }
    bool may_be_one = problem.code == QM_PROBLEM_UNAVAILABLE || problem.code == QM_PROBLEM_OUT_OF_MEMORY;
    bool moved = !may_be_one && qm_blob_move_away(work->store, hash);
    printf("%s is no mesh: %s; it %s\n", hash, problem.detail, moved ? "was moved to lost/" : "stays");
    work->moved += moved;
    work->failed |= !moved;
}

static bool run_adopt(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    adoption work = {0};
    if (qm_store_open(config->data_dir, QM_STORE_ADOPT, &work.store, message) != QM_OK) return false;
    work.meshes = create_meshes(work.store, config);
    if (!work.meshes || !qm_blob_each_orphan(work.store, adopt, &work)) work.failed = true;
    snprintf(message, QM_MESSAGE_SIZE, "%zu meshes adopted, %zu files moved to lost/%s", work.adopted,
             work.moved, work.failed ? "; some could not be read" : "");
    qm_meshes_destroy(work.meshes);
    qm_store_close(work.store);
    return !work.failed;
}

static bool run_check(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    qm_store_findings found;
    const qm_store_node self = describe_node(config);
    bool repairs = config->task == QM_CONFIG_REPAIR;
    if (config->store[0] && repairs) {
        snprintf(message, QM_MESSAGE_SIZE, "a database of --store is not repaired from here, only checked");
        return false;
    }
    bool done = config->store[0]
                    ? qm_store_check_shared(config->store, &self, stdout, &found, message) == QM_STORED
                    : qm_store_check(config->data_dir, repairs, stdout, &found, message) == QM_OK;
    if (!done) return false;
    snprintf(message, QM_MESSAGE_SIZE,
             "%zu meshes, %zu files, %zu jobs: %zu faults, %zu repaired; %zu files without a mesh",
             found.meshes, found.files, found.jobs, found.faults, found.repaired, found.orphans);
    return found.faults == found.repaired;
}

static bool run_backup(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    qm_store_findings found;
    bool restores = config->task == QM_CONFIG_RESTORE;
    qm_status status = restores
                           ? qm_store_restore(config->task_file, config->data_dir, stdout, &found, message)
                           : qm_store_backup(config->data_dir, config->task_file, stdout, &found, message);
    if (status != QM_OK) return false;
    snprintf(message, QM_MESSAGE_SIZE,
             restores ? "%zu meshes, %zu jobs and %zu files restored: %zu faults"
                      : "%zu meshes, %zu jobs with arrays and %zu files saved: %zu faults",
             found.meshes, found.jobs, found.files, found.faults);
    return found.faults == 0;
}

static bool run_copy(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    qm_store_copied copied;
    const qm_store_node self = describe_node(config);
    const char *folder = config->task_file;
    qm_stored stored = config->task == QM_CONFIG_IMPORT
                           ? qm_store_import(folder, config->store, &self, config->store_unsafe > 0.0, stdout,
                                             &copied, message)
                           : qm_store_export(config->store, &self, folder, stdout, &copied, message);
    if (stored != QM_STORED) return false;
    snprintf(message, QM_MESSAGE_SIZE,
             "%zu meshes, %zu layouts, %zu reconstructions and %zu jobs copied; %zu were there: %zu faults",
             copied.meshes, copied.layouts, copied.reconstructions, copied.jobs, copied.before,
             copied.faults);
    return copied.faults == 0;
}

static bool run_status(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    size_t faults;
    const qm_store_node self = describe_node(config);
    if (qm_store_print_status(config->store, &self, stdout, &faults, message) != QM_STORED) return false;
    snprintf(message, QM_MESSAGE_SIZE, "%zu faults", faults);
    return faults == 0;
}

static bool run_migrate(const qm_config *config, char message[QM_MESSAGE_SIZE])
{
    const qm_store_node self = describe_node(config);
    if (qm_store_migrate(config->store, &self, message) != QM_STORED) return false;
    snprintf(message, QM_MESSAGE_SIZE, "the tables are up to date");
    return true;
}

static int run_task(const qm_config *config)
{
    char message[QM_MESSAGE_SIZE] = "";
    bool done = false;
    switch (config->task) {
    case QM_CONFIG_SERVE:
        break;
    case QM_CONFIG_CHECK:
    case QM_CONFIG_REPAIR:
        done = run_check(config, message);
        break;
    case QM_CONFIG_BACKUP:
    case QM_CONFIG_RESTORE:
        done = run_backup(config, message);
        break;
    case QM_CONFIG_IMPORT:
    case QM_CONFIG_EXPORT:
        done = run_copy(config, message);
        break;
    case QM_CONFIG_STATUS:
        done = run_status(config, message);
        break;
    case QM_CONFIG_ADOPT:
        done = run_adopt(config, message);
        break;
    case QM_CONFIG_EMPTY:
        done = qm_store_empty(config->data_dir, message) == QM_OK;
        if (done) snprintf(message, sizeof message, "the files are in lost/");
        break;
    case QM_CONFIG_MIGRATE:
        done = run_migrate(config, message);
        break;
    }
    fprintf(done ? stdout : stderr, "quadmeshd: %s\n", message);
    return done ? 0 : 1;
}

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], QM_DRACO_CHILD_FLAG) == 0) return qm_draco_child_main();
    if (argc == 2 && strcmp(argv[1], "--print-routes") == 0) return qm_route_print_all(), 0;
    qm_config config;
    qm_config_outcome outcome = qm_config_read(&config, argc, argv);
    if (outcome != QM_CONFIG_RUN) return outcome == QM_CONFIG_EXIT_OK ? 0 : 2;
    qm_log_level level = QM_LOG_ERROR;
    while (strcmp(config.log_level, qm_log_level_name(level)) != 0)
        level++;
    qm_log_init(strcmp(config.log_format, "json") == 0, level);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is a failed write, as on a full disk */
    qm_codec_drc_set_decoder(qm_draco_child_decode);
    if (config.task != QM_CONFIG_SERVE) return run_task(&config);
    qm_host_return_memory();
    allow_connections(&config);
    char dashboard[4096];
    find_dashboard(&config, dashboard, sizeof dashboard);
    static daemon_state state;
    static const int signals[SIGNAL_COUNT] = {SIGTERM, SIGINT, SIGHUP};
    uv_loop_init(&state.loop);
    uv_timer_init(&state.loop, &state.tick);
    state.tick.data = &state;
    for (size_t i = 0; i < SIGNAL_COUNT; i++) {
        uv_signal_init(&state.loop, &state.signals[i]);
        state.signals[i].data = &state;
        uv_signal_start(&state.signals[i], on_signal, signals[i]);
    }
    uv_timer_start(&state.tick, on_tick, TICK_MS, TICK_MS);
    bool started = start_parts(&state, &config);
    if (started) {
        printf("quadmeshd %s listens on http://%s:%d/\n", QM_VERSION, config.listen,
               qm_http_port(state.http));
        fflush(stdout);
        qm_notify_send("READY=1");
        uv_run(&state.loop, UV_RUN_DEFAULT);
    }
    qm_notify_send("STOPPING=1");
    stop_parts(&state);
    stop_loop(&state);
    if (started) qm_log(QM_LOG_INFO, "stopped");
    return started ? 0 : 1;
}
