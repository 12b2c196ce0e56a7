/**
 * job_waker.c: the thread that wakes readers.
 *
 * One event may have hundreds of readers, and to wake one takes a system call. The worker that has the event
 * computes at a low priority: if it woke them itself, under the lock, all would wait for it whenever the
 * machine has something better to do. So it only hands them over.
 */
#include "job_internal.h"

static void wake_all(qm_reader *first)
{
    for (qm_reader *reader = first, *next; reader; reader = next) {
        next = reader->next_awake; /* one that is awake may be gone at once */
        reader->wake(reader->user);
    }
}

static void run(void *data)
{
    qm_jobs *jobs = data;
    uv_mutex_lock(&jobs->lock);
    while (jobs->awake || !jobs->waker_ends) {
        qm_reader *first = jobs->awake;
        jobs->awake = NULL;
        if (!first) {
            uv_cond_wait(&jobs->has_awake, &jobs->lock);
            continue;
        }
        uv_mutex_unlock(&jobs->lock);
        wake_all(first);
        uv_mutex_lock(&jobs->lock);
    }
    uv_mutex_unlock(&jobs->lock);
}

bool qm_waker_start(qm_jobs *jobs)
{
    uv_cond_init(&jobs->has_awake);
    jobs->has_waker = uv_thread_create(&jobs->waker, run, jobs) == 0;
    return jobs->has_waker;
}

void qm_jobs_settle(qm_jobs *jobs)
{
    if (!jobs->has_waker) return;
    uv_mutex_lock(&jobs->lock);
    jobs->waker_ends = true;
    uv_cond_signal(&jobs->has_awake);
    uv_mutex_unlock(&jobs->lock);
    uv_thread_join(&jobs->waker);
    jobs->has_waker = false;
}

void qm_reader_wake(qm_jobs *jobs, qm_reader *reader)
{
    if (!reader->asleep) return;
    reader->asleep = false;
    if (jobs->waker_ends) {
        reader->wake(reader->user);
        return;
    }
    reader->next_awake = jobs->awake;
    jobs->awake = reader;
    uv_cond_signal(&jobs->has_awake);
}
