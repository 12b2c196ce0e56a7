/**
 * job_matrix.c: what a worker does with a matrix, a job on a set of meshes. It holds no more than two of them at a time, so that
 * a set need not fit in memory: the others stay as long as the budget has room for them (mesh/meshes.h).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/json.h"
#include "job_internal.h"

#define EVENT_MS 100.0  /* between events */
#define EVENT_PAIRS 64u /* in one event at most, the last ones */

/** What is known of a mesh of the set. */
typedef struct member {
    qm_mesh_ref *ref; /* NULL while it is not held */
    int holds;
    bool is_seen;
    uint64_t revision;  /* once it was seen, with the rest */
    double uncertainty; /* as it was uploaded */
} member;

/** Pairs that were measured since the last event. */
typedef struct pair_news {
    size_t pair[EVENT_PAIRS][2];
    size_t count; /* of all; those beyond the room have replaced the first ones */
    double told_ms;
} pair_news;

typedef struct matrix_run {
    qm_job *job;
    member *members;
    size_t *same;
    double *uncertainty; /* of each mesh where it lies */
    pair_news news;
    double start_ms;
    qm_problem problem; /* why a mesh could not be had; with has_problem */
    bool has_problem;
} matrix_run;

/* ---- the request ---- */

/** Writes one text for the revisions of all meshes: a hash, as they may be many. False when out of memory. */
static bool write_revisions(qm_text *listed, char out[QM_REVISIONS_SIZE])
{
    char hash[QM_HASH_SIZE];
    bool is_written = !listed->failed;
    if (is_written) {
        qm_id_hash_text(listed->data, listed->size, hash);
        snprintf(out, QM_REVISIONS_SIZE, "%.*s", QM_REVISIONS_SIZE - 1, hash);
    }
    qm_text_reset(listed);
    return is_written;
}

/** Adds the revision of a mesh, and its uncertainty if it has one. */
static void add_revision(qm_text *listed, uint64_t revision, double uncertainty)
{
    qm_text_printf(listed, "%llu ", (unsigned long long)revision);
    if (uncertainty > 0.0) qm_text_printf(listed, "/%.17g ", uncertainty);
}

/** False with a problem when a mesh has another unit than one before it. */
static bool check_units(const qm_job_request *request, const qm_store_mesh_state *states, qm_problem *problem)
{
    qm_notes known = {0};
    for (size_t i = 0; i < request->mesh_count; i++) {
        const qm_notes both[2] = {known, states[i].notes};
        char pointer[QM_JOB_POINTER_SIZE];
        if (!known.unit[0]) known = states[i].notes;
        if (qm_job_check_units(both, problem)) continue;
        qm_job_point_to_mesh(request, i, pointer);
        qm_problem_add_pointer(problem, pointer, "another unit");
        return false;
    }
    return true;
}

static bool check_set(qm_jobs *jobs, const qm_job_request *request, char revisions[QM_REVISIONS_SIZE],
                      qm_problem *problem)
{
    qm_text listed = {0};
    qm_store_mesh_state *states = calloc(request->mesh_count, sizeof *states);
    bool is_usable =
        states && qm_job_find_meshes(jobs, request, states, problem) && check_units(request, states, problem);
    for (size_t i = 0; is_usable && i < request->mesh_count; i++)
        add_revision(&listed, states[i].revision, states[i].notes.uncertainty);
    bool is_written = is_usable && write_revisions(&listed, revisions);
    if (!states || (is_usable && !is_written))
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the job");
    free(states);
    return is_written;
}

/* ---- meshes ---- */

/** A reference to a mesh. One that is not in memory, or may have to be moved, is taken without a worker. */
static qm_mesh_ref *take(matrix_run *run, const qm_job_member *mesh, qm_notes *notes)
{
    qm_meshes *meshes = run->job->jobs->meshes;
    bool loads = mesh->pose.is_given || !qm_meshes_has_loaded(meshes, mesh->name);
    qm_mesh_ref *ref;
    if (loads) qm_scheduler_leave(run->job->turn);
    do
        ref = qm_job_acquire(meshes, mesh->name, &mesh->pose, notes, &run->problem);
    while (!ref && loads && qm_job_outlasts(run->job, &run->problem));
    if (loads) qm_scheduler_return(run->job->turn);
    return ref;
}

static qm_status fail(matrix_run *run, qm_status status)
{
    run->has_problem = true;
    return status;
}

static qm_status acquire(void *user, size_t index, const qm_loaded_mesh **out)
{
    matrix_run *run = user;
    member *own = &run->members[index];
    const qm_job_member *mesh = &run->job->request.meshes[index];
    qm_notes notes = {.uncertainty = own->uncertainty};
    if (!own->ref) own->ref = take(run, mesh, &notes);
    if (!own->ref) return fail(run, QM_E_EMPTY);
    *out = qm_mesh_ref_get(own->ref);
    own->holds++;
    if (!own->is_seen) {
        own->revision = (*out)->revision;
        own->uncertainty = notes.uncertainty;
        qm_loaded_mesh_move_notes(*out, &notes);
        run->uncertainty[index] = notes.uncertainty;
    }
    own->is_seen = true;
    if (own->revision == (*out)->revision) return QM_OK;
    own->holds--;
    qm_meshes_release(run->job->jobs->meshes, own->ref);
    own->ref = NULL;
    run->problem = qm_problem_make(QM_PROBLEM_CONFLICT, "mesh %s was deformed while its pairs were measured",
                                   mesh->name);
    return fail(run, QM_E_ARGUMENT);
}

static void release(void *user, size_t index)
{
    matrix_run *run = user;
    member *own = &run->members[index];
    QM_ASSERT(own->holds > 0);
    if (--own->holds > 0) return;
    qm_meshes_release(run->job->jobs->meshes, own->ref);
    own->ref = NULL;
}

/** Finds the meshes that are made of the same bytes in the same format, and lie at the same place. One that is not found equals none. */
static bool find_same(const qm_job *job, size_t *same)
{
    const qm_job_request *request = &job->request;
    qm_store_mesh_state *states = calloc(request->mesh_count, sizeof *states);
    qm_problem unused; /* of a mesh that is gone, which the search meets itself */
    if (!states) return false;
    qm_job_find_meshes(job->jobs, request, states, &unused);
    for (size_t i = 0; i < request->mesh_count; i++) {
        same[i] = i;
        for (size_t k = 0; k < i && same[i] == i && states[i].is_found; k++)
            if (states[k].is_found && states[k].format == states[i].format &&
                strcmp(states[k].hash, states[i].hash) == 0 &&
                strcmp(states[k].positions, states[i].positions) == 0 &&
                qm_job_equal_poses(&request->meshes[k].pose, &request->meshes[i].pose))
                same[i] = same[k];
    }
    free(states);
    return true;
}

/* ---- events ---- */

static void tell(matrix_run *run, const qm_matrix *matrix)
{
    pair_news *news = &run->news;
    qm_jobs *jobs = run->job->jobs;
    qm_text out = {0};
    qm_json_add_ms(&out, "elapsed_ms", qm_clock_now_ms() - run->start_ms);
    qm_json_add_count(&out, "pair_count", matrix->pair_count);
    qm_json_add_count(&out, "searched_pairs", matrix->searched);
    qm_json_add_count(&out, "bounded_pairs", matrix->bounded);
    qm_json_add_count(&out, "searches", matrix->searches);
    qm_json_open(&out, "pairs", "[");
    for (size_t i = news->count > EVENT_PAIRS ? news->count - EVENT_PAIRS : 0; i < news->count; i++) {
        const size_t *at = news->pair[i % EVENT_PAIRS];
        size_t pair = qm_matrix_pair(matrix->count, at[0], at[1]);
        const double row[] = {(double)at[0], (double)at[1], matrix->lower[pair], matrix->upper[pair]};
        qm_json_add_array(&out, row, 4);
    }
    qm_text_add_string(&out, "]");
    news->count = 0;
    news->told_ms = qm_clock_now_ms();
    char *members = qm_text_take(&out);
    if (!members) return;
    uv_mutex_lock(&jobs->lock);
    qm_job_add_event(run->job, "pairs", members);
    uv_mutex_unlock(&jobs->lock);
    free(members);
}

static void on_pair(void *user, const qm_matrix *matrix, size_t a, size_t b)
{
    matrix_run *run = user;
    size_t *at = run->news.pair[run->news.count++ % EVENT_PAIRS];
    at[0] = a;
    at[1] = b;
    if (!run->job->on_end && qm_clock_now_ms() - run->news.told_ms >= EVENT_MS) tell(run, matrix);
}

/* ---- running ---- */

/** The revisions that the result is of. */
static bool note_revisions(matrix_run *run)
{
    qm_text listed = {0};
    for (size_t i = 0; i < run->job->request.mesh_count; i++)
        add_revision(&listed, run->members[i].revision, run->members[i].uncertainty);
    return write_revisions(&listed, run->job->revisions);
}

static void run_set(qm_job *job)
{
    size_t count = job->request.mesh_count;
    matrix_run run = {.job = job,
                      .members = calloc(count, sizeof *run.members),
                      .same = calloc(count, sizeof *run.same),
                      .uncertainty = calloc(count, sizeof *run.uncertainty),
                      .start_ms = qm_clock_now_ms()};
    run.news.told_ms = run.start_ms;
    qm_context ctx;
    qm_job_request request = qm_job_begin_run(job, &ctx);
    qm_job_result result;
    qm_status status = QM_E_NO_MEMORY;
    if (run.members && run.same && run.uncertainty && find_same(job, run.same)) {
        const qm_job_set set = {acquire, release, on_pair, run.same, run.uncertainty, &run};
        request.set = &set;
        status = qm_job_execute(&ctx, &request, NULL, NULL, NULL, NULL, &result);
        if (status == QM_OK && !note_revisions(&run))
            job->revisions[0] = '\0'; /* no answer for a later request */
    } else {
        qm_context_fail(&ctx, QM_E_NO_MEMORY, "out of memory for the job");
    }
    qm_job_end_run(job, &ctx, status, &result, run.has_problem ? &run.problem : NULL);
    free(run.members);
    free(run.same);
    free(run.uncertainty);
}

const qm_job_runner qm_job_matrix_runner = {check_set, run_set};
