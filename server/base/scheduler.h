/**
 * scheduler.h: shares a number of workers between the tasks of many clients.
 *
 * A task runs on a thread of its own, but only while it holds one of the workers. When its slice of time is over and
 * another task waits, its flag rises; the task polls the flag and calls qm_scheduler_pause, which returns when the task has a
 * worker again. So a long task delays a short one by a slice at most. A paused task keeps its memory and its references,
 * so the number of tasks that have begun is limited; it must not hold a lock.
 *
 * Order: the client that has used the least time, for an equal share of the workers each. Within a client, weighted fair
 * queueing (Demers, Keshav and Shenker 1989) between its tasks that have been paused, and one more flow, which has its
 * tasks that have not. A client or a flow that was idle begins a little ahead of the others, so that a small task runs
 * at once, but keeps the account of the time that it used before, so that many small tasks get no more than their share.
 *
 * A suspect is a task that may kill the process. It begins alone, so that a death in its first moments is its own: no
 * task has begun for a while before, and none begins for a while after, unless the suspect has ended. Suspects go first,
 * in the order of their submission; tasks that have begun go on beside them.
 */
#ifndef QM_SCHEDULER_H
#define QM_SCHEDULER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

typedef struct qm_scheduler qm_scheduler;
typedef struct qm_turn qm_turn; /* a task's place in the scheduler */

typedef enum qm_priority { QM_PRIORITY_LOW, QM_PRIORITY_NORMAL, QM_PRIORITY_HIGH } qm_priority;

/** The longest name that distinguishes clients. */
#define QM_CLIENT_SIZE 64

typedef struct qm_task {
    void (*run)(void *data);
    void *data;
    int threads;          /* that it uses while it runs: its time counts so many times */
    qm_priority priority; /* among the tasks of its client */
    const char *client;
    double alone_ms; /* of a suspect: the while; 0 for other tasks */
} qm_task;

/**
 * workers: tasks that run at a time. max_begun: tasks that have begun and not ended; a client may have as many divided
 * by the number of clients and one more. niceness: of the threads, see nice(2). NULL: out of memory or threads.
 */
qm_scheduler *qm_scheduler_create(int workers, size_t max_begun, int niceness);

/** Has the task run. Writes its turn, which lives until run has returned, before it runs. False, and it never runs, if
 * memory ran out or the scheduler is closed. */
bool qm_scheduler_submit(qm_scheduler *scheduler, const qm_task *task, qm_turn **turn);

/** Runs all tasks to their ends, and ends the threads; nothing can be submitted any more. */
void qm_scheduler_close(qm_scheduler *scheduler);

/** Closes the scheduler if it is open, and frees it; NULL is allowed. */
void qm_scheduler_destroy(qm_scheduler *scheduler);

/** Tasks that have begun and wait for a worker. */
size_t qm_scheduler_count_paused(qm_scheduler *scheduler);

/** The flag that the task polls, and the call for any of its threads that finds it raised: returns at once when no
 * other task is to have the worker. */
const atomic_bool *qm_scheduler_flag(const qm_turn *turn);
void qm_scheduler_pause(void *turn);

/** Lets a task go on to its end without a pause, beside those that hold the workers: it is about to end. */
void qm_scheduler_hurry(qm_turn *turn);

/** The task gives its worker back, because it waits for the disk or loads a mesh, and waits for a worker again. It may
 * also end without one. Called by the thread that runs the task while no other thread works for it. */
void qm_scheduler_leave(qm_turn *turn);
void qm_scheduler_return(qm_turn *turn);

#endif
