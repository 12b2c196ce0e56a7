/**
 * http_watch.c: what ends a long computation of a handler before its end: its client has left, or its time is over.
 *
 * The engine calls `wait` of a context wherever it polls, as long as `pause` is raised. A watch raises it for good, and looks
 * round in these calls, some times a second; what it finds raises the cancel flag of the computation.
 */
#include <math.h>

#include "base/clock.h"
#include "http_internal.h"

#define LOOK_MS 100.0
#define MS_PER_S 1e3

/** The library does not look at a connection that is suspended. */
bool qm_http_has_left(const qm_request *request)
{
    char byte;
    return request->guarded && recv(request->guarded->socket, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
}

/** Called by any thread of the computation. */
static void look(void *user)
{
    qm_http_watch *watch = user;
    double now = qm_clock_now_ms();
    uint64_t next = atomic_load_explicit(&watch->next_look, memory_order_relaxed);
    if ((uint64_t)now < next ||
        !atomic_compare_exchange_strong(&watch->next_look, &next, (uint64_t)(now + LOOK_MS)))
        return;
    if (qm_http_has_left(watch->request))
        atomic_store(&watch->cause, QM_WATCH_LEFT);
    else if (now >= watch->end_ms)
        atomic_store(&watch->cause, QM_WATCH_LATE);
    if (atomic_load(&watch->cause) != QM_WATCH_NOTHING) atomic_store(&watch->cancel, true);
}

void qm_http_watch_begin(qm_http_watch *watch, qm_request *request, double deadline_ms, qm_context *ctx)
{
    double most = MS_PER_S * (double)request->app->config->max_job_seconds;
    *watch = (qm_http_watch){.request = request, .deadline_ms = deadline_ms, .looks = true};
    watch->has_own_deadline = deadline_ms > 0.0 && !(most > 0.0 && most < deadline_ms);
    watch->end_ms = request->start_ms + (watch->has_own_deadline ? deadline_ms
                                         : most > 0.0            ? most
                                                                 : INFINITY);
    ctx->cancel = &watch->cancel;
    ctx->pause = &watch->looks;
    ctx->wait = look;
    ctx->wait_user = watch;
}

bool qm_http_watch_end(const qm_http_watch *watch, qm_context *ctx, qm_problem *problem)
{
    ctx->cancel = ctx->pause = NULL;
    ctx->wait = NULL;
    ctx->wait_user = NULL;
    switch (atomic_load(&watch->cause)) {
    case QM_WATCH_NOTHING:
        return true;
    case QM_WATCH_LEFT:
        *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the client has left");
        return false;
    default:
        *problem = watch->has_own_deadline
                       ? qm_problem_make(QM_PROBLEM_DEADLINE_EXCEEDED, "the deadline of %.15g ms was over",
                                         watch->deadline_ms)
                       : qm_problem_make(QM_PROBLEM_DEADLINE_EXCEEDED,
                                         "it took longer than the %d s that the daemon allows",
                                         (int)watch->request->app->config->max_job_seconds);
        return false;
    }
}
