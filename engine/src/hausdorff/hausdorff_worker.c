/**
 * hausdorff_worker.c: the workers of a search. Each keeps a queue of its own and shares only the lower bound;
 * one that runs dry steals half of another's entries. With one worker no lock is taken, and a run takes the
 * same path each time.
 */
#include "hausdorff_worker.h"

#define CHECK_INTERVAL 16   /* entries and parts between two checks of the clock and the cancel flag, */
#define CHECK_SEARCHES 64   /* or searches of nearest points, which may be slow where many faces coincide */
#define REPORT_INTERVAL 100 /* milliseconds between two reports at most */
#define MIN_STEAL 2         /* entries that make it worth to take half */

static bool is_shared(const qm_worker *worker)
{
    return worker->search->worker_count > 1;
}

static void lock(qm_worker *worker)
{
    if (is_shared(worker)) mtx_lock(&worker->lock);
}

static void unlock(qm_worker *worker)
{
    if (is_shared(worker)) mtx_unlock(&worker->lock);
}

/** Ends the search; the first reason counts. */
static void stop_for(qm_search *search, int reason)
{
    int running = QM_SEARCH_RUNNING;
    atomic_compare_exchange_strong(&search->stop, &running, reason);
}

bool qm_worker_create_all(qm_context *ctx, qm_search *search, int count)
{
    QM_ASSERT(ctx && search);
    QM_ASSERT(count > 0);
    search->workers = qm_context_alloc_aligned(ctx, (size_t)count, sizeof *search->workers);
    if (!search->workers) return false;
    search->worker_count = count;
    for (int i = 0; i < count; i++) {
        qm_worker *worker = &search->workers[i];
        *worker = (qm_worker){
            .ctx = ctx, .search = search, .index = i, .top = -1.0, .witness = -1.0, .ascend_above = -1.0};
        mtx_init(&worker->lock, mtx_plain);
        qm_queue_init(&worker->queue);
    }
    return true;
}

void qm_worker_destroy_all(qm_context *ctx, qm_search *search)
{
    for (int i = 0; i < search->worker_count; i++) {
        qm_queue_reset(ctx, &search->workers[i].queue);
        mtx_destroy(&search->workers[i].lock);
    }
    qm_context_free_aligned(ctx, search->workers, (size_t)search->worker_count, sizeof *search->workers);
}

/** Puts an entry in a worker's queue. Where there is no memory for it, it is discarded with its bound, so
 * that the upper bound stays valid, and the search ends. The caller holds the lock. */
static void push_within_limit(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    qm_search *search = worker->search;
    qm_queue *queue = &worker->queue;
    bool has_room = !qm_queue_is_full(queue) || 2 * qm_queue_bytes(queue) <= search->memory_limit;
    if (has_room && qm_queue_push(worker->ctx, queue, entry, piece)) return;
    qm_worker_discard(worker, entry.upper);
    stop_for(search, QM_STOP_MEMORY);
}

void qm_worker_push(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    QM_ASSERT(worker);
    QM_ASSERT(entry.side < worker->search->side_count);
    QM_ASSERT((entry.kind == QM_ENTRY_PIECE) == (piece != NULL));
    if (entry.upper <= qm_search_cutoff(worker->search)) {
        qm_worker_discard(worker, entry.upper);
        return;
    }
    lock(worker);
    push_within_limit(worker, entry, piece);
    if (worker->queue.count > worker->max_queue) worker->max_queue = worker->queue.count;
    unlock(worker);
}

/** Takes the entry with the largest bound from the worker's own queue; top is its bound while it is held. */
static bool take_own(qm_worker *worker, qm_entry *entry, qm_piece *piece)
{
    lock(worker);
    bool taken = worker->queue.count > 0;
    if (taken) {
        *entry = qm_queue_pop(&worker->queue, piece);
        worker->top = entry->upper;
        atomic_fetch_add(&worker->search->busy_count, 1);
    } else {
        worker->top = -1.0;
    }
    unlock(worker);
    return taken;
}

/** Takes half of another worker's entries. While any worker is busy, a last entry is not stolen; if none is,
 * its owner may not have started, or may have exited. */
static bool steal(qm_worker *thief)
{
    qm_search *search = thief->search;
    size_t min_count = atomic_load(&search->busy_count) > 0 ? MIN_STEAL : 1;
    for (int i = 1; i < search->worker_count; i++) {
        qm_worker *victim = &search->workers[(thief->index + i) % search->worker_count];
        qm_worker *first = victim->index < thief->index ? victim : thief;
        qm_worker *second = first == victim ? thief : victim;
        QM_ASSERT(thief != victim);
        lock(first);
        lock(second);
        size_t wanted = victim->queue.count >= min_count ? (victim->queue.count + 1) / 2 : 0;
        for (; wanted > 0; wanted--) {
            qm_piece piece;
            qm_entry entry = qm_queue_pop(&victim->queue, &piece);
            if (entry.upper > thief->top) thief->top = entry.upper;
            push_within_limit(thief, entry, entry.kind == QM_ENTRY_PIECE ? &piece : NULL);
        }
        bool stolen = thief->queue.count > 0;
        unlock(second);
        unlock(first);
        if (stolen) return true;
    }
    return false;
}

static void lock_all(const qm_search *search)
{
    for (int i = 0; i < search->worker_count; i++)
        lock(&search->workers[i]);
}

static void unlock_all(const qm_search *search)
{
    for (int i = search->worker_count; i-- > 0;)
        unlock(&search->workers[i]);
}

/** True when no entry is left, in a queue or held by a worker. */
static bool is_over(const qm_search *search)
{
    if (atomic_load(&search->busy_count) > 0) return false;
    lock_all(search);
    bool over = atomic_load(&search->busy_count) == 0;
    for (int i = 0; i < search->worker_count && over; i++)
        over = search->workers[i].queue.count == 0;
    unlock_all(search);
    return over;
}

double qm_worker_max_upper(const qm_search *search)
{
    double upper = atomic_load(&search->lower);
    lock_all(search);
    for (int i = 0; i < search->worker_count; i++) {
        qm_worker *worker = &search->workers[i];
        upper = fmax(upper, fmax(worker->top, atomic_load(&worker->discarded)));
        if (worker->queue.count > 0) upper = fmax(upper, worker->queue.heap[0].upper);
    }
    unlock_all(search);
    return upper;
}

static void report(qm_search *search, double now, double upper)
{
    const qm_hausdorff_options *options = search->options;
    double lower = fmax(0.0, atomic_load(&search->lower) - search->eta);
    upper = fmin(search->reported_upper, upper + search->eta);
    bool is_due = now - search->reported_ms >= REPORT_INTERVAL || upper - lower <= 0.5 * search->reported_gap;
    if (!options->progress || !is_due) return;
    size_t waiting = 0;
    for (int i = 0; i < search->worker_count; i++) {
        lock(&search->workers[i]);
        waiting += search->workers[i].queue.count;
        unlock(&search->workers[i]);
    }
    search->reported_ms = now;
    search->reported_gap = upper - lower;
    search->reported_upper = upper;
    qm_hausdorff_progress progress = {
        .elapsed_ms = now - search->start_ms,
        .lower = lower,
        .upper = upper,
        .iterations = atomic_load(&search->iterations),
        .projections = atomic_load(&search->projections),
        .queue_count = waiting,
    };
    options->progress(options->progress_user, &progress);
}

/** Tells the caller of a search in parts what this worker has found, and takes the lower bound that is known
 * elsewhere. */
static void exchange(qm_worker *worker)
{
    const qm_hausdorff_parts *parts = worker->search->options->parts;
    if (parts && parts->exchange)
        qm_search_raise_lower(worker->search, parts->exchange(parts->user, worker->witness));
}

/** Adds this worker's counts to the search's, reports progress and checks the limits; one worker at a
 * time. */
static void check_limits(qm_worker *worker)
{
    qm_search *search = worker->search;
    const qm_hausdorff_options *options = search->options;
    atomic_fetch_add(&search->iterations, worker->iterations);
    atomic_fetch_add(&search->projections, worker->projections);
    worker->iterations = worker->projections = 0;
    bool is_canceled = qm_context_canceled(worker->ctx); /* may wait: before the flag is taken */
    if (atomic_flag_test_and_set(&search->reporting)) return;
    double now = qm_clock_ms();
    exchange(worker);
    if (search->is_queued) report(search, now, qm_worker_max_upper(search));
    int reason = QM_SEARCH_RUNNING;
    if (is_canceled) reason = QM_STOP_CANCELED;
    if (options->deadline_ms > 0.0 && now - search->start_ms >= options->deadline_ms)
        reason = QM_STOP_DEADLINE;
    if (atomic_load(&search->iterations) >= search->work_limit) reason = (int)search->work_stop;
    if (atomic_load(&search->lower) - search->eta > options->threshold) reason = QM_STOP_THRESHOLD;
    if (reason != QM_SEARCH_RUNNING) stop_for(search, reason);
    atomic_flag_clear(&search->reporting);
}

bool qm_worker_must_stop(qm_worker *worker)
{
    if (worker->iterations >= CHECK_INTERVAL || worker->projections >= CHECK_SEARCHES) check_limits(worker);
    return atomic_load_explicit(&worker->search->stop, memory_order_relaxed) != QM_SEARCH_RUNNING;
}

void qm_worker_run(qm_worker *worker)
{
    QM_ASSERT(worker);
    qm_search *search = worker->search;
    qm_entry entry;
    qm_piece piece;
    while (!qm_worker_must_stop(worker)) {
        if (!take_own(worker, &entry, &piece)) {
            if (is_shared(worker) && steal(worker)) continue;
            if (is_over(search)) break;
            thrd_yield();
            continue;
        }
        if (entry.upper <= qm_search_cutoff(search)) /* which may have risen since it was queued */
            qm_worker_discard(worker, entry.upper);
        else if (entry.kind == QM_ENTRY_NODE && entry.level == 0) /* of a search in parts */
            qm_pack_visit_all(worker, &entry, 1);
        else if (entry.kind == QM_ENTRY_NODE)
            qm_node_visit(worker, entry);
        else if (qm_search_is_matching(search))
            qm_matching_visit_piece(worker, entry, &piece);
        else
            qm_piece_visit(worker, entry, &piece);
        qm_worker_follow(worker);
        QM_ASSERT(atomic_load(&search->busy_count) > 0);
        atomic_fetch_sub(&search->busy_count, 1);
        worker->iterations++;
    }
    check_limits(worker);
}
