/**
 * job_pulse.c: the pulse. Each round of it asks the store a few questions about all jobs of the node at once; between
 * rounds it sleeps, shortly while somebody waits for its answers. A verb that the database does not answer holds up the
 * round for some seconds, which the times below allow for.
 */
#include "job_pulse.h"

#include <math.h>
#include <stdlib.h>

#include "base/log.h"
#include "base/metrics.h"
#include "job_help.h"
#include "job_mirrors.h"

#define BEAT_MS 2000.0
#define SILENCE_S 10.0 /* that is death; judged by nodes that beat for as long without a fault */
#define REAP_MS 2000.0 /* and up to REAP_SPREAD_MS more, so that nodes do not do it all at once */
#define REAP_SPREAD_MS 500
#define SHORT_SLEEP_MS 50.0 /* while there are mirrors or free workers */
#define LONG_SLEEP_MS 250.0
#define WATCHED_SAVE_MS 100.0 /* between savings of events while a reader of another node waits for them */
#define SAVE_MS 500.0
#define SPILL_S 0.2 /* that a job waits for its home */
#define CLAIM_STEP 64
#define NS_PER_MS 1e6

struct qm_job_pulse {
    qm_jobs *jobs;
    uv_thread_t thread;
    uv_mutex_t lock; /* guards what follows */
    uv_cond_t wake;
    bool ends, is_closed, is_hurried;
    bool may_wait;     /* jobs in the queue, which the last claim had no workers for */
    bool is_canceling; /* another node asks for the end of a job that may run here */
    double beat_ms;    /* when the last beat that returned was sent */
    double good_ms;    /* since when no beat has failed */
    qm_store_cluster cluster;
    /* The thread's own: */
    double next_beat_ms, next_reap_ms, next_save_ms;
};

/* ---- the node ---- */

/** Gives up all jobs that run here: the other nodes have declared this one dead. */
static void lose_all(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job; job = job->next)
        if (!job->is_mirror && !job->on_end) qm_job_lose(job);
    uv_mutex_unlock(&jobs->lock);
}

/** Writes the number of jobs that run or wait here, and returns how many workers are left for others. */
static size_t count_free_workers(qm_jobs *jobs, size_t *busy)
{
    size_t workers = (size_t)jobs->limits.workers;
    uv_mutex_lock(&jobs->lock);
    *busy = jobs->running + jobs->queued;
    uv_mutex_unlock(&jobs->lock);
    return workers > *busy ? workers - *busy : 0;
}

static void beat(struct qm_job_pulse *pulse)
{
    qm_jobs *jobs = pulse->jobs;
    double start = qm_clock_now_ms();
    size_t busy;
    qm_store_cluster cluster;
    qm_stored stored = qm_store_beat(jobs->store, count_free_workers(jobs, &busy), &cluster,
                                     qm_job_events_note_durable, jobs);
    if (stored == QM_STORED_LOST) {
        qm_log(QM_LOG_ERROR, "this node was silent and has lost its jobs: it joins again");
        lose_all(jobs);
        stored = qm_store_join(jobs->store);
        if (stored == QM_STORED) stored = qm_store_beat(jobs->store, 0, &cluster, NULL, NULL);
        start = qm_clock_now_ms();
    }
    uv_mutex_lock(&pulse->lock);
    if (stored == QM_STORED) {
        bool was_isolated = start - pulse->beat_ms >= QM_JOB_PULSE_ISOLATION_MS;
        if (was_isolated) pulse->good_ms = start;
        pulse->beat_ms = start;
        pulse->cluster = cluster;
    } else {
        pulse->good_ms = INFINITY;
    }
    if (stored == QM_STORED && isinf(pulse->good_ms)) pulse->good_ms = start;
    uv_mutex_unlock(&pulse->lock);
    pulse->next_beat_ms = qm_clock_now_ms() + BEAT_MS;
}

/** Declares silent nodes dead, but only as one that would have heard of it if the database had been away. */
static void reap(struct qm_job_pulse *pulse)
{
    size_t count;
    double now = qm_clock_now_ms();
    if (now < pulse->good_ms + 1e3 * SILENCE_S) return;
    qm_stored stored = qm_store_reap(pulse->jobs->store, SILENCE_S, &count);
    if (stored == QM_STORED && count > 0)
        qm_log(QM_LOG_WARN, "%zu jobs of nodes that are silent were queued again", count);
    pulse->next_reap_ms = now + REAP_MS + (double)((uint64_t)now % REAP_SPREAD_MS);
}

/* ---- jobs ---- */

/** Takes jobs from the queue: as many as workers are free, or one that has waited elsewhere, so that the scheduler runs
 * it between the slices of those that are long. */
static void claim(struct qm_job_pulse *pulse)
{
    qm_jobs *jobs = pulse->jobs;
    qm_store_job rows[CLAIM_STEP];
    size_t count = 0, busy;
    qm_store_wish wish = {.free = count_free_workers(jobs, &busy), .spill_s = SPILL_S};
    if (wish.free > CLAIM_STEP) wish.free = CLAIM_STEP;
    wish.extra = wish.free == 0 && busy < QM_JOBS_BEGUN;
    if (wish.free + wish.extra > 0) qm_store_claim_jobs(jobs->store, &wish, rows, &count);
    uv_mutex_lock(&pulse->lock);
    pulse->may_wait = count >= wish.free;
    uv_mutex_unlock(&pulse->lock);
    if (count == 0) return;
    qm_metrics_add(QM_METRICS_JOBS_CLAIMED, count);
    qm_job_mirrors_follow(jobs); /* so that the mirrors of these have all events of earlier runs */
    for (size_t i = 0; i < count; i++) {
        qm_jobs_resume(jobs, &rows[i]);
        qm_store_job_reset(&rows[i]);
    }
}

/** Tells the store which clients have left the jobs that they owned. */
static void disown(qm_jobs *jobs)
{
    for (;;) {
        uv_mutex_lock(&jobs->lock);
        qm_job *job = jobs->disowned;
        if (job) jobs->disowned = job->next_disowned;
        int owners = job ? job->disowners : 0;
        if (job) job->disowners = 0;
        uv_mutex_unlock(&jobs->lock);
        if (!job) return;
        bool is_unwanted = false;
        if (qm_store_hold_job(jobs->store, job->id, -owners, false, &is_unwanted) == QM_STORED && is_unwanted)
            qm_job_cancel_noted(jobs, job);
        qm_jobs_release(jobs, job);
    }
}

/* ---- the thread ---- */

static bool is_isolated(const struct qm_job_pulse *pulse)
{
    return qm_clock_now_ms() - pulse->beat_ms >= QM_JOB_PULSE_ISOLATION_MS;
}

/** True while the thread is to go on; returns after the sleep. */
static bool rest(struct qm_job_pulse *pulse, bool is_short)
{
    uv_mutex_lock(&pulse->lock);
    if (!pulse->is_hurried && !pulse->ends)
        uv_cond_timedwait(&pulse->wake, &pulse->lock,
                          (uint64_t)(NS_PER_MS * (is_short ? SHORT_SLEEP_MS : LONG_SLEEP_MS)));
    pulse->is_hurried = false;
    if (pulse->is_canceling) pulse->next_save_ms = 0.0; /* whose answer tells which one */
    pulse->is_canceling = false;
    bool goes_on = !pulse->ends;
    uv_mutex_unlock(&pulse->lock);
    return goes_on;
}

static void run(void *data)
{
    struct qm_job_pulse *pulse = data;
    qm_jobs *jobs = pulse->jobs;
    bool is_watched = false, is_short = true;
    size_t busy;
    do {
        if (qm_clock_now_ms() >= pulse->next_beat_ms) beat(pulse);
        uv_mutex_lock(&pulse->lock);
        bool claims = !pulse->is_closed && !is_isolated(pulse);
        uv_mutex_unlock(&pulse->lock);
        if (qm_clock_now_ms() >= pulse->next_reap_ms) reap(pulse);
        if (claims) claim(pulse);
        if (claims) qm_job_help_look(jobs, count_free_workers(jobs, &busy) > 0);
        disown(jobs);
        if (qm_clock_now_ms() >= pulse->next_save_ms) {
            is_watched = qm_job_events_save(jobs);
            pulse->next_save_ms = qm_clock_now_ms() + (is_watched ? WATCHED_SAVE_MS : SAVE_MS);
        }
        bool has_mirrors = qm_job_mirrors_follow(jobs);
        is_short = has_mirrors || is_watched || (claims && count_free_workers(jobs, &busy) > 0);
    } while (rest(pulse, is_short));
    disown(jobs);
}

/** Does at once what the next round would do. */
static void take_news(void *user, qm_store_news news, const char *id)
{
    struct qm_job_pulse *pulse = user;
    if (news != QM_STORE_NEWS_QUEUED && !qm_job_is_listed(pulse->jobs, id)) return;
    uv_mutex_lock(&pulse->lock);
    pulse->is_hurried = true;
    pulse->is_canceling |= news == QM_STORE_NEWS_CANCELED;
    uv_cond_signal(&pulse->wake);
    uv_mutex_unlock(&pulse->lock);
}

bool qm_job_pulse_start(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = calloc(1, sizeof *pulse);
    if (!pulse) return false;
    pulse->jobs = jobs;
    uv_mutex_init(&pulse->lock);
    uv_cond_init(&pulse->wake);
    pulse->good_ms = INFINITY;
    pulse->beat_ms = -INFINITY;
    beat(pulse); /* the first request is answered by a node that knows its cluster */
    if (uv_thread_create(&pulse->thread, run, pulse) == 0) {
        jobs->pulse = pulse;
        qm_store_watch(jobs->store, take_news, pulse);
        return true;
    }
    uv_cond_destroy(&pulse->wake);
    uv_mutex_destroy(&pulse->lock);
    free(pulse);
    return false;
}

void qm_job_pulse_close(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return;
    uv_mutex_lock(&pulse->lock);
    pulse->is_closed = true;
    uv_mutex_unlock(&pulse->lock);
}

void qm_job_pulse_hurry(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return;
    uv_mutex_lock(&pulse->lock);
    pulse->is_hurried = true;
    uv_cond_signal(&pulse->wake);
    uv_mutex_unlock(&pulse->lock);
}

void qm_job_pulse_free_worker(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return;
    uv_mutex_lock(&pulse->lock);
    pulse->is_hurried |= pulse->may_wait;
    if (pulse->may_wait) uv_cond_signal(&pulse->wake);
    uv_mutex_unlock(&pulse->lock);
}

void qm_job_pulse_stop(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return;
    qm_store_unwatch(jobs->store);
    uv_mutex_lock(&pulse->lock);
    pulse->ends = true;
    uv_cond_signal(&pulse->wake);
    uv_mutex_unlock(&pulse->lock);
    uv_thread_join(&pulse->thread);
    uv_cond_destroy(&pulse->wake);
    uv_mutex_destroy(&pulse->lock);
    jobs->pulse = NULL;
    free(pulse);
}

bool qm_jobs_is_isolated(qm_jobs *jobs)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return false;
    uv_mutex_lock(&pulse->lock);
    bool isolated = is_isolated(pulse);
    uv_mutex_unlock(&pulse->lock);
    return isolated;
}

bool qm_jobs_read_cluster(qm_jobs *jobs, qm_store_cluster *out, double *beat_age_s)
{
    struct qm_job_pulse *pulse = jobs->pulse;
    if (!pulse) return false;
    uv_mutex_lock(&pulse->lock);
    *out = pulse->cluster;
    *beat_age_s = 1e-3 * (qm_clock_now_ms() - pulse->beat_ms);
    uv_mutex_unlock(&pulse->lock);
    return true;
}
