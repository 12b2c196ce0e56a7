/**
 * job_run.c: what a worker does with a job, and how a job ends: a stored one with its document and last
 * events in the store before any subscriber is notified, one that is not stored by its on_end.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/log.h"
#include "base/metrics.h"
#include "job_help.h"
#include "job_pulse.h"
#include "ops/json_out.h"
#include "split_search.h"
#include "store/result_file.h"
#include "store/store_problem.h"

#define MIN_WAIT_MS 100 /* between tries to store the end of a job */
#define MAX_WAIT_MS 2000

/* ---- the end of a job ---- */

/** True for a result, false for a problem. */
static bool has_result(const qm_job_outcome *outcome)
{
    return strcmp(outcome->member, "result") == 0;
}

static const char *last_event_name(const qm_job_outcome *outcome)
{
    return has_result(outcome) ? "result" : "error";
}

/** The row and the last event of a stored job; false when out of memory. */
static bool make_end(qm_job *job, const qm_job_outcome *outcome, qm_job_end *end)
{
    qm_text text = {0};
    qm_text_printf(&text, "\"state\":\"%s\",\"%s\":", qm_job_state_name(outcome->state), outcome->member);
    qm_text_add_string(&text, outcome->object);
    *end = (qm_job_end){.outcome = *outcome, .event = qm_text_take(&text)};
    end->row.state = outcome->state;
    end->row.restarts = job->restarts;
    end->row.result = has_result(outcome) ? strdup(outcome->object) : NULL;
    memcpy(end->row.id, job->id, sizeof end->row.id);
    uv_mutex_lock(&job->jobs->lock);
    end->row.document =
        qm_job_write_members(job, outcome->state, has_result(outcome) ? NULL : outcome->object);
    uv_mutex_unlock(&job->jobs->lock);
    return end->event && end->row.document && (end->row.result || !has_result(outcome));
}

/** Stores the end of a job with the events that the store lacks or may lose, and a last one. */
static qm_stored store_end(qm_job *job, const qm_job_end *end, const qm_store_effect *effect)
{
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    size_t count = job->event_count - job->durable_count;
    qm_store_event *events = calloc(count + 1, sizeof *events);
    if (events) {
        qm_job_list_events(job, job->durable_count, job->event_count, events);
        events[count] =
            (qm_store_event){job->id, qm_job_next_seq(job), last_event_name(&end->outcome), end->event};
    }
    uv_mutex_unlock(&jobs->lock);
    qm_stored stored =
        events ? qm_store_finish_job(jobs->store, &end->row, job->revisions, events, count + 1, effect)
               : QM_STORED_NO_MEMORY;
    free(events);
    return stored;
}

static void finish(qm_job *job, const qm_job_outcome *outcome);

/** Takes the list of the jobs that follow a job; those that share its result run from now on. The caller holds the
 * lock. */
static qm_job *take_followers(qm_job *job, bool share_result)
{
    qm_job *first = job->followers;
    job->followers = NULL;
    for (qm_job *follower = first; follower; follower = follower->next_follower) {
        follower->leader = NULL;
        if (!share_result) continue;
        qm_job_mark_running(follower);
        memcpy(follower->started, job->started, sizeof follower->started);
        memcpy(follower->revisions, job->revisions, sizeof follower->revisions);
    }
    return first;
}

/** Ends the jobs of such a list with the result that they share, or, without one, has them computed. */
static void end_followers(qm_job *job, qm_job *first, const qm_job_outcome *shared)
{
    for (qm_job *next; first; first = next) {
        next = first->next_follower;
        if (shared)
            finish(first, shared);
        else if (!qm_job_enqueue(job->jobs, first))
            qm_job_interrupt(first);
        qm_jobs_release(job->jobs, first);
    }
}

/** Ends a stored job in memory, with its last event. */
static void announce_stored(qm_job *job, qm_job_end *end)
{
    qm_jobs *jobs = job->jobs;
    const qm_job_outcome *outcome = &end->outcome;
    uv_mutex_lock(&jobs->lock);
    bool shares = outcome->state == QM_JOB_SUCCEEDED && job->expiry == QM_JOB_IN_TIME;
    qm_job *followers = take_followers(job, shares);
    QM_ASSERT(jobs->running > 0);
    jobs->running--;
    job->state = outcome->state;
    job->document = end->row.document;
    job->result = end->row.result;
    qm_job_add_event(job, last_event_name(outcome), end->event ? end->event : "\"detail\":\"out of memory\"");
    if (end->is_stored) qm_job_unlist(job);
    uv_mutex_unlock(&jobs->lock);
    end_followers(job, followers, shares ? outcome : NULL);
}

/** Ends a job that is not stored. */
static void announce_unstored(qm_job *job, const qm_job_outcome *outcome)
{
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    QM_ASSERT(jobs->running > 0);
    jobs->running--;
    job->state = outcome->state;
    job->on_end(job->end_user, outcome);
    qm_job_unlist(job);
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_announce_end(qm_job *job, qm_job_end *end)
{
    QM_ASSERT(job->state == QM_JOB_RUNNING && end->outcome.state > QM_JOB_RUNNING);
    if (!job->is_helper)
        qm_metrics_add_job(qm_job_type_of(job->request.kind)->name, qm_job_state_name(end->outcome.state),
                           (qm_clock_now_ms() - job->started_ms) / MS_PER_S);
    if (job->on_end)
        announce_unstored(job, &end->outcome);
    else
        announce_stored(job, end);
    free(end->event);
    free(end->object);
    qm_job_pulse_free_worker(job->jobs);
}

/** Frees an end that was not announced. */
static void free_end(qm_job_end *end)
{
    free(end->event);
    free(end->row.document);
    free(end->row.result);
    *end = (qm_job_end){.outcome = end->outcome};
}

/** True when the store may yet take the end of a job: a shared one is asked again until it has said that it has the end, or
 * that the job is another node's by now. The result waits here meanwhile. */
static bool is_open(const qm_job *job, qm_stored stored)
{
    bool is_decided = stored == QM_STORED || stored == QM_STORED_LOST || stored == QM_STORED_LATE;
    return !is_decided && qm_store_is_shared(job->jobs->store) && !atomic_load(&job->jobs->closed);
}

bool qm_job_outlasts(qm_job *job, const qm_problem *problem)
{
    bool waits = problem->code == QM_PROBLEM_STORE_UNAVAILABLE && !job->on_end &&
                 qm_store_is_shared(job->jobs->store) && !atomic_load(&job->cancel) &&
                 !atomic_load(&job->jobs->closed);
    if (waits) uv_sleep(MIN_WAIT_MS);
    return waits;
}

bool qm_job_runs_again(qm_job *job, const qm_problem *problem)
{
    uv_mutex_lock(&job->jobs->lock);
    bool is_lost = job->is_lost;
    uv_mutex_unlock(&job->jobs->lock);
    return problem->code == QM_PROBLEM_STORE_UNAVAILABLE && !job->on_end &&
           (is_lost || atomic_load(&job->jobs->closed));
}

/** Takes note that the store gave the job to another node, before the pulse has heard of it. */
static void mark_lost(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    job->is_lost = true;
    uv_mutex_unlock(&job->jobs->lock);
}

/** Makes the row of the end of a job and stores it. With a result other than QM_STORED there is no end. */
static qm_stored make_and_store(qm_job *job, const qm_job_outcome *outcome, const qm_store_effect *effect,
                                qm_job_end *end)
{
    qm_stored stored;
    unsigned wait = MIN_WAIT_MS;
    do {
        stored = make_end(job, outcome, end) ? store_end(job, end, effect) : QM_STORED_NO_MEMORY;
        if (stored != QM_STORED) free_end(end);
        if (!is_open(job, stored)) break;
        uv_sleep(wait);
        wait = wait < MAX_WAIT_MS ? 2 * wait : wait;
    } while (stored != QM_STORED);
    if (stored == QM_STORED_LOST) mark_lost(job);
    end->is_stored = stored == QM_STORED;
    return stored;
}

/** Ends a job that is marked as running. Only the thread that runs a job ends it, or, while the job is loading, the
 * one that clears this mark. */
static void finish(qm_job *job, const qm_job_outcome *outcome)
{
    qm_job_end end = {.outcome = *outcome};
    qm_stored stored = job->on_end ? QM_STORED : make_and_store(job, outcome, NULL, &end);
    if (stored == QM_STORED_LOST) {
        qm_job_interrupt(job);
        return;
    }
    if (stored != QM_STORED) {
        qm_log(QM_LOG_ERROR, "the end of job %s could not be stored: it is kept in memory", job->id);
        make_end(job, outcome, &end);
    }
    qm_job_announce_end(job, &end);
}

/** Stores the effect of a job that is not stored itself. */
static qm_stored store_effect(qm_store *store, const qm_store_effect *effect)
{
    if (effect && effect->next) return qm_store_update_reconstruction(store, effect);
    qm_stored stored = effect && effect->mesh ? qm_store_put_mesh(store, effect->mesh) : QM_STORED;
    return stored == QM_STORED_TAKEN ? QM_STORED_LATE : stored;
}

qm_stored qm_job_store_end(qm_job *job, qm_job_state state, const qm_job_result *result,
                           const qm_store_effect *effect, qm_job_end *end)
{
    qm_text text = {0};
    qm_json_write_result(&text, &job->request, result);
    char *object = qm_text_take(&text);
    const qm_job_outcome outcome = {state, "result", object ? object : "null"};
    *end = (qm_job_end){.outcome = outcome};
    if (!object) return QM_STORED_NO_MEMORY;
    qm_stored stored;
    if (!job->on_end)
        stored = make_and_store(job, &outcome, effect, end);
    else
        stored = store_effect(job->jobs->store, effect);
    if (stored == QM_STORED)
        end->object = object;
    else
        free(object);
    return stored;
}

void qm_job_finish_with_problem(qm_job *job, qm_job_state state, const qm_problem *problem)
{
    qm_text object = {0};
    qm_json_write_problem(&object, problem);
    char *text = qm_text_take(&object);
    finish(job, &(qm_job_outcome){state, "problem", text ? text : "null"});
    free(text);
}

void qm_job_finish_with_result(qm_job *job, qm_job_state state, const qm_job_result *result)
{
    qm_text object = {0};
    qm_json_write_result(&object, &job->request, result);
    char *text = qm_text_take(&object);
    finish(job, &(qm_job_outcome){state, "result", text ? text : "null"});
    free(text);
}

void qm_job_interrupt(qm_job *job)
{
    if (job->on_end) { /* it is not stored and cannot run again */
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping");
        qm_job_finish_with_problem(job, QM_JOB_CANCELED, &problem);
        return;
    }
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    qm_job *followers = take_followers(job, false);
    qm_job_add_event(job, "server_shutdown",
                     job->is_lost ? "\"detail\":\"this node was away; another one goes on with the job\""
                     : qm_store_is_shared(jobs->store)
                         ? "\"detail\":\"this node is stopping; another one goes on with the job\""
                         : "\"detail\":\"the daemon is stopping; the job runs again after its next start\"");
    job->interrupted = true;
    if (job->is_lost) { /* nothing here may tell of the job any more */
        qm_metrics_add(QM_METRICS_LEASES_LOST, 1);
        if (job->state == QM_JOB_QUEUED)
            jobs->queued--;
        else
            jobs->running--;
        qm_job_unlist(job);
    }
    uv_mutex_unlock(&jobs->lock);
    end_followers(job, followers, NULL);
}

/* ---- running ---- */

typedef struct progress_target {
    qm_job *job;
    double diagonal;
    const qm_split *split;
} progress_target;

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    const progress_target *target = user;
    qm_text text = {0};
    qm_json_add_bounds(&text, progress, target->diagonal);
    if (target->split->parts > 0) {
        qm_json_add_count(&text, "parts", target->split->parts);
        qm_json_add_count(&text, "nodes", target->split->nodes);
    }
    char *members = qm_text_take(&text);
    if (!members) return;
    uv_mutex_lock(&target->job->jobs->lock);
    qm_job_add_progress(target->job, members);
    uv_mutex_unlock(&target->job->jobs->lock);
    free(members);
}

bool qm_job_is_canceled(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    bool canceled = job->is_canceled;
    uv_mutex_unlock(&job->jobs->lock);
    return canceled;
}

void qm_job_begin_loading(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    QM_ASSERT(job->state == QM_JOB_RUNNING && !job->is_loading);
    job->is_loading = true;
    uv_mutex_unlock(&job->jobs->lock);
}

bool qm_job_end_loading(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    bool is_mine = job->is_loading;
    job->is_loading = false;
    uv_mutex_unlock(&job->jobs->lock);
    return is_mine;
}

qm_job_expiry qm_job_get_expiry(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    qm_job_expiry expiry = job->is_canceled ? QM_JOB_IN_TIME : job->expiry;
    uv_mutex_unlock(&job->jobs->lock);
    return expiry;
}

qm_problem qm_job_expiry_problem(const qm_job *job, qm_job_expiry expiry)
{
    if (expiry == QM_JOB_PAST_LIMIT)
        return qm_problem_make(QM_PROBLEM_DEADLINE_EXCEEDED,
                               "the job ran longer than the %.15g s that the daemon allows",
                               job->jobs->limits.max_job_ms / MS_PER_S);
    return qm_problem_make(QM_PROBLEM_DEADLINE_EXCEEDED, "the deadline of %.15g ms was over",
                           job->request.deadline_ms);
}

void qm_job_set_context(qm_job *job, qm_context *ctx)
{
    ctx->cancel = &job->cancel;
    ctx->pause = qm_scheduler_flag(job->turn);
    ctx->wait = qm_scheduler_pause;
    ctx->wait_user = job->turn;
    ctx->parallel = qm_host_parallel;
}

/** Stores the long array of a result, if it has one, beside the job, for GET .../result; or a problem. */
static qm_stored store_array(qm_job *job, const qm_job_result *result, qm_problem *problem)
{
    size_t count;
    const double *numbers = job->on_end ? NULL : qm_job_result_array(result, &count);
    qm_stored stored = QM_STORED;
    if (!numbers) return stored;
    do {
        stored = qm_result_file_write(job->jobs->store, job->id, numbers, count);
        *problem = qm_store_write_problem(stored, "the result");
    } while (stored != QM_STORED && qm_job_outlasts(job, problem));
    return stored;
}

/** The revisions of two meshes, and their notes if they have any. */
static void write_revisions(uint64_t a, uint64_t b, const qm_notes notes[2], char out[QM_REVISIONS_SIZE])
{
    int used = snprintf(out, QM_REVISIONS_SIZE, "%llu %llu", (unsigned long long)a, (unsigned long long)b);
    bool has_notes = false;
    for (int i = 0; i < 2; i++)
        has_notes |= notes[i].unit[0] || notes[i].uncertainty > 0.0;
    if (has_notes)
        snprintf(out + used, QM_REVISIONS_SIZE - (size_t)used, " %s/%.17g %s/%.17g", notes[0].unit,
                 notes[0].uncertainty, notes[1].unit, notes[1].uncertainty);
}

bool qm_job_ran_on(qm_jobs *jobs, const qm_store_job *row, uint64_t a, uint64_t b, const qm_notes notes[2])
{
    /* Revisions only grow: what is as in its file was so before. */
    if (a == 0 && b == 0) return true;
    char revisions[QM_REVISIONS_SIZE];
    write_revisions(a, b, notes, revisions);
    qm_store_job found;
    if (qm_store_find_job_by_key(jobs->store, row->key, revisions, row->state, &found) != QM_STORED)
        return false;
    bool is_same = strcmp(found.id, row->id) == 0;
    qm_store_job_reset(&found);
    return is_same;
}

/* ---- the meshes of a request ---- */

size_t qm_job_count_meshes(const qm_job_request *request)
{
    const char *const *field = qm_job_type_of(request->kind)->mesh_field;
    return request->mesh_count > 0 ? request->mesh_count : field[1] ? 2 : 1;
}

/** The name of a mesh, for which there is room in QM_JOB_MESH_SIZE. */
static char *name_of_mesh(qm_job_request *request, size_t i)
{
    return request->mesh_count > 0 ? request->meshes[i].name : i == 0 ? request->a : request->b;
}

void qm_job_point_to_mesh(const qm_job_request *request, size_t i, char pointer[QM_JOB_POINTER_SIZE])
{
    if (request->mesh_count > 0)
        snprintf(pointer, QM_JOB_POINTER_SIZE, "/meshes/%zu", i);
    else
        snprintf(pointer, QM_JOB_POINTER_SIZE, "/%s", qm_job_type_of(request->kind)->mesh_field[i]);
}

bool qm_job_find_meshes(qm_jobs *jobs, const qm_job_request *request, qm_store_mesh_state *out,
                        qm_problem *problem)
{
    const char *ids[QM_JOB_MAX_MESHES];
    char pointer[QM_JOB_POINTER_SIZE];
    size_t count = qm_job_count_meshes(request), i = 0;
    QM_ASSERT(count <= QM_JOB_MAX_MESHES);
    for (; i < count; i++)
        ids[i] = request->mesh_count > 0 ? request->meshes[i].name : i == 0 ? request->a : request->b;
    qm_stored stored = qm_store_find_mesh_states(jobs->store, ids, count, out);
    for (i = 0; stored == QM_STORED && i < count && out[i].is_found;)
        i++;
    if (stored == QM_STORED && i == count) return true;
    qm_job_point_to_mesh(request, i < count ? i : 0, pointer);
    *problem = qm_store_read_problem(stored == QM_STORED ? QM_STORED_NONE : stored, QM_PROBLEM_MESH_NOT_FOUND,
                                     "mesh with the id in `%s`", pointer + 1);
    if (stored == QM_STORED) qm_problem_add_pointer(problem, pointer, "no such mesh");
    return false;
}

static bool check_meshes(qm_jobs *jobs, const qm_job_request *request, char revisions[QM_REVISIONS_SIZE],
                         qm_problem *problem)
{
    qm_store_mesh_state state[2] = {0};
    bool exist = qm_job_find_meshes(jobs, request, state, problem);
    const qm_notes notes[2] = {state[0].notes, state[1].notes};
    write_revisions(state[0].revision, state[1].revision, notes, revisions);
    if (!exist || qm_job_check_units(notes, problem)) return exist;
    qm_problem_add_pointer(problem, "/b", "another unit");
    return false;
}

bool qm_job_names_hash(const qm_job_request *request)
{
    bool has_hash = qm_json_hash_of_name(request->a) || qm_json_hash_of_name(request->b);
    for (size_t i = 0; i < request->mesh_count; i++)
        has_hash |= qm_json_hash_of_name(request->meshes[i].name) != NULL;
    return has_hash;
}

bool qm_job_resolve(qm_jobs *jobs, qm_job_request *request, qm_problem *problem)
{
    size_t total = qm_job_count_meshes(request), count = 0;
    const char *hashes[QM_JOB_MAX_MESHES];
    if (!qm_job_names_hash(request)) return true;
    for (size_t i = 0; i < total; i++) {
        const char *hash = qm_json_hash_of_name(name_of_mesh(request, i));
        if (hash) hashes[count++] = hash;
    }
    char(*ids)[QM_ID_SIZE] = calloc(count, sizeof *ids);
    qm_stored stored = ids ? qm_store_find_undeformed(jobs->store, hashes, count, ids) : QM_STORED_NO_MEMORY;
    bool is_found = stored == QM_STORED;
    for (size_t i = 0, k = 0; i < total && is_found; i++) {
        char *name = name_of_mesh(request, i), pointer[QM_JOB_POINTER_SIZE];
        if (!qm_json_hash_of_name(name)) continue;
        is_found = ids[k][0];
        if (is_found) {
            snprintf(name, QM_JOB_MESH_SIZE, "%s", ids[k++]);
            continue;
        }
        qm_job_point_to_mesh(request, i, pointer);
        *problem = qm_store_read_problem(QM_STORED_NONE, QM_PROBLEM_MESH_NOT_FOUND,
                                         "mesh with the content in `%s`", pointer + 1);
        qm_problem_add_pointer(problem, pointer, "no mesh has this content");
    }
    free(ids);
    if (stored != QM_STORED)
        *problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "the meshes of the job");
    if (request->mesh_count > 0) strcpy(request->a, request->meshes[0].name);
    return is_found;
}

void qm_job_set_limits(const qm_job *job, qm_job_request *request)
{
    const qm_job_limits *limits = &job->jobs->limits;
    if (request->threads == 0) request->threads = limits->threads;
    if (request->memory_limit == 0 || request->memory_limit > limits->search_memory)
        request->memory_limit = limits->search_memory;
}

/** True for a search that may go on in parts: of a stored job, with nothing that each call of the engine would have to
 * build. */
static bool may_split(const qm_job *job)
{
    const qm_job_request *request = &job->request;
    bool has_boxes =
        request->accelerator == QM_ACCELERATOR_AUTO || request->accelerator == QM_ACCELERATOR_BOXES;
    return request->kind == QM_JOB_HAUSDORFF && has_boxes && !job->on_end;
}

qm_job_request qm_job_begin_run(qm_job *job, qm_context *ctx)
{
    *ctx = qm_meshes_context(job->jobs->meshes);
    qm_job_set_context(job, ctx);
    qm_job_request request = job->request;
    /* At least a moment is left, in which the search finds its first bounds. */
    if (request.deadline_ms > 0.0)
        request.deadline_ms = fmax(request.deadline_ms - (qm_clock_now_ms() - job->submitted_ms), 1.0);
    qm_job_set_limits(job, &request);
    return request;
}

/** True for a search that its deadline has stopped. */
static bool is_late(const qm_job_result *result)
{
    return (result->kind == QM_JOB_HAUSDORFF && result->hausdorff.stop == QM_STOP_DEADLINE) ||
           (result->kind == QM_JOB_MATRIX && result->matrix.stop == QM_MATRIX_DEADLINE);
}

/** Makes a search that was canceled one that its deadline has stopped. */
static void mark_late(qm_job_result *result)
{
    result->is_canceled = false;
    if (result->kind == QM_JOB_HAUSDORFF) result->hausdorff.stop = QM_STOP_DEADLINE;
    if (result->kind == QM_JOB_MATRIX) result->matrix.stop = QM_MATRIX_DEADLINE;
}

void qm_job_end_run(qm_job *job, qm_context *ctx, qm_status status, qm_job_result *result,
                    const qm_problem *fault)
{
    bool canceled = status == QM_E_CANCELED || (status == QM_OK && result->is_canceled);
    qm_job_expiry expiry = canceled ? qm_job_get_expiry(job) : QM_JOB_IN_TIME;
    qm_scheduler_leave(job->turn);
    if (expiry != QM_JOB_IN_TIME || (status == QM_OK && is_late(result)))
        job->revisions[0] = '\0'; /* no answer for a later request */
    if (expiry != QM_JOB_IN_TIME && status == QM_OK) {
        mark_late(result);
        canceled = false;
    }
    const qm_mesh_facts *facts;
    qm_problem problem;
    if (expiry != QM_JOB_IN_TIME && status != QM_OK) {
        problem = qm_job_expiry_problem(job, expiry);
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    } else if (canceled && !qm_job_is_canceled(job)) {
        qm_job_interrupt(job);
    } else if (status == QM_OK && qm_job_result_mesh(result, &facts)) {
        qm_job_finish_with_mesh(job, ctx, result);
    } else if (status == QM_OK) {
        qm_stored stored = store_array(job, result, &problem);
        if (stored == QM_STORED)
            qm_job_finish_with_result(job, canceled ? QM_JOB_CANCELED : QM_JOB_SUCCEEDED, result);
        else if (qm_job_runs_again(job, &problem))
            qm_job_interrupt(job);
        else
            qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    } else {
        problem = fault ? *fault : qm_problem_from_status(status, ctx->message);
        if (fault && qm_job_runs_again(job, fault))
            qm_job_interrupt(job);
        else
            qm_job_finish_with_problem(job, canceled ? QM_JOB_CANCELED : QM_JOB_FAILED, &problem);
    }
    if (status == QM_OK) qm_job_result_reset(ctx, result);
}

/** b is NULL for a kind of one mesh. */
static void answer(qm_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b, const qm_notes notes[2])
{
    qm_problem units;
    if (!qm_job_check_units(notes, &units)) {
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &units);
        return;
    }
    qm_context ctx;
    qm_job_request request = qm_job_begin_run(job, &ctx);
    memcpy(request.notes, notes, sizeof request.notes);
    write_revisions(a->revision, b ? b->revision : 0, notes, job->revisions);
    qm_split split = {.store = job->jobs->store,
                      .job = job->id,
                      .restarts = job->restarts,
                      .whole_ms = QM_SPLIT_WHOLE_MS,
                      .round_ms = QM_SPLIT_ROUND_MS,
                      .most_pieces = QM_SPLIT_MOST_PIECES};
    const qm_job_search search = {qm_split_measure, &split};
    if (may_split(job)) request.search = &search;
    qm_job_stages stages = {job, a->diagonal, qm_clock_now_ms()};
    request.remesh.on_stage = job->on_end ? NULL : qm_job_tell_stage;
    request.remesh.user = &stages;
    progress_target target = {job, a->diagonal, &split};
    qm_hausdorff_progress_fn *progress = job->on_end ? NULL : on_progress;
    qm_job_result result;
    qm_status status = qm_job_execute(&ctx, &request, a, b, progress, &target, &result);
    if (split.is_lost) mark_lost(job);
    qm_job_end_run(job, &ctx, status, &result, NULL);
}

void qm_job_mark_running(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs) && job->state == QM_JOB_QUEUED && job->jobs->queued > 0);
    job->state = QM_JOB_RUNNING;
    job->started_ms = qm_clock_now_ms();
    job->jobs->queued--;
    job->jobs->running++;
}

/** Marks a queued job as running. False when it is not to run: it was canceled, or the daemon stops. */
static bool start(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    bool is_queued = job->state == QM_JOB_QUEUED;
    bool runs = is_queued && !jobs->closed && !job->is_canceled && !job->is_lost;
    /* A job that is not stored cannot run later: it ends now, and is running until then. */
    if (runs || (is_queued && job->on_end)) {
        qm_job_mark_running(job);
        qm_clock_format(job->started);
        /* A deadline that is over ends the job here, unless the job is a search that may find bounds. */
        if (!qm_job_type_of(job->request.kind)->is_anytime) qm_job_check_time(job, job->started_ms);
    }
    uv_mutex_unlock(&jobs->lock);
    if (is_queued && !runs) qm_job_interrupt(job);
    if (runs && !job->is_helper)
        qm_metrics_add_wait(qm_job_type_of(job->request.kind)->name,
                            (job->started_ms - job->submitted_ms) / MS_PER_S);
    return runs;
}

/** What a job works on. b is NULL for a kind of one mesh, and when it is a, so that a mesh is compared with itself at one
 * revision. */
typedef struct mesh_pair {
    qm_mesh_ref *a, *b;
    qm_notes notes[2];
} mesh_pair;

/** True when b names the mesh that a names, at the same place. */
static bool is_itself(const qm_job_request *request)
{
    return strcmp(request->a, request->b) == 0 && qm_job_equal_poses(&request->pose[0], &request->pose[1]);
}

qm_mesh_ref *qm_job_acquire(qm_meshes *meshes, const char *id, const qm_job_pose *pose, qm_notes *notes,
                            qm_problem *problem)
{
    return pose->is_given ? qm_meshes_acquire_moved(meshes, id, pose->transform, notes, problem)
                          : qm_meshes_acquire_noted(meshes, id, notes, problem);
}

static bool acquire(qm_job *job, mesh_pair *pair, qm_problem *problem)
{
    if (job->given[0]) {
        *pair = (mesh_pair){.a = job->given[0], .b = job->given[1]};
        /* No store has them, and so no other notes than those of their files. */
        for (int i = 0; i < 2 && job->given[i]; i++)
            memcpy(pair->notes[i].unit, qm_mesh_ref_get(job->given[i])->unit, sizeof pair->notes[i].unit);
        job->given[0] = job->given[1] = NULL;
        return true;
    }
    qm_meshes *meshes = job->jobs->meshes;
    const qm_job_request *request = &job->request;
    bool has_b = qm_job_type_of(request->kind)->mesh_field[1] && !is_itself(request);
    pair->a = qm_job_acquire(meshes, request->a, &request->pose[0], &pair->notes[0], problem);
    pair->b = pair->a && has_b
                  ? qm_job_acquire(meshes, request->b, &request->pose[1], &pair->notes[1], problem)
                  : NULL;
    if (!has_b && qm_job_type_of(request->kind)->mesh_field[1]) pair->notes[1] = pair->notes[0];
    if (pair->a && (pair->b || !has_b)) return true;
    qm_meshes_release(meshes, pair->a);
    pair->a = NULL;
    return false;
}

/** True when taking the meshes takes no time: moved copies may have to be made. */
static bool has_loaded(const qm_job *job)
{
    const qm_job_request *request = &job->request;
    if (request->pose[0].is_given || request->pose[1].is_given) return false;
    if (job->given[0]) return true;
    return qm_meshes_has_loaded(job->jobs->meshes, request->a) &&
           (!qm_job_type_of(request->kind)->mesh_field[1] ||
            qm_meshes_has_loaded(job->jobs->meshes, request->b));
}

static void run_on_meshes(qm_job *job)
{
    qm_problem problem;
    mesh_pair pair = {0};
    bool is_there = has_loaded(job) && acquire(job, &pair, &problem);
    bool loads = !is_there, is_over = false;
    if (loads) {
        qm_job_begin_loading(job);
        qm_scheduler_leave(job->turn);
        do
            is_there = acquire(job, &pair, &problem);
        while (!is_there && qm_job_outlasts(job, &problem));
        qm_scheduler_return(job->turn);
        is_over = !qm_job_end_loading(job);
    }
    const qm_loaded_mesh *first = pair.a ? qm_mesh_ref_get(pair.a) : NULL;
    const qm_loaded_mesh *second = pair.b ? qm_mesh_ref_get(pair.b)
                                   : qm_job_type_of(job->request.kind)->mesh_field[1] ? first
                                                                                      : NULL;
    if (!is_over && is_there && job->is_helper) {
        qm_job_help_run(job, first, second);
    } else if (!is_over && is_there) {
        answer(job, first, second, pair.notes);
    } else if (!is_over && qm_job_runs_again(job, &problem)) {
        qm_job_interrupt(job);
    } else if (!is_over) {
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    }
    qm_meshes_release(job->jobs->meshes, pair.a);
    qm_meshes_release(job->jobs->meshes, pair.b);
}

const qm_job_runner *qm_job_runner_of(qm_job_kind kind)
{
    QM_ASSERT(kind < QM_JOB_KIND_COUNT);
    static const qm_job_runner on_meshes = {check_meshes, run_on_meshes};
    static const qm_job_runner *const others[QM_JOB_KIND_COUNT] = {
        [QM_JOB_RECONSTRUCTION_STEP] = &qm_job_steps_runner,
        [QM_JOB_MATRIX] = &qm_job_matrix_runner,
    };
    return others[kind] ? others[kind] : &on_meshes;
}

void qm_job_run(void *data)
{
    qm_job *job = data;
    qm_jobs *jobs = job->jobs;
    if (job->seq_base > 0 && qm_store_begin_job(jobs->store, job->id) != QM_STORED)
        qm_log(QM_LOG_ERROR, "the run of job %s could not be counted", job->id);
    if (start(job)) {
        qm_job_expiry expiry = qm_job_get_expiry(job);
        qm_problem problem = qm_job_expiry_problem(job, expiry);
        if (expiry == QM_JOB_IN_TIME)
            qm_job_runner_of(job->request.kind)->run(job);
        else
            qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    }
    uv_mutex_lock(&jobs->lock);
    job->turn = NULL; /* it ends with this call */
    uv_mutex_unlock(&jobs->lock);
    qm_jobs_release(jobs, job);
}
