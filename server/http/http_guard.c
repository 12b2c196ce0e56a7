/**
 * http_guard.c: the list of connections, and the limits on idle and slow ones.
 *
 * The library's own time limit starts again with every byte, so that a client can hold a connection for ever
 * by sending one now and then. Here a connection without a request ends after the idle time whatever it
 * sends, and one whose body comes more slowly than a rate ends as well.
 */
#include <stdlib.h>
#include <sys/socket.h>

#include "base/clock.h"
#include "base/metrics.h"
#include "http_internal.h"

#define RATE_GRACE_MS 10000.0 /* time of an upload before its rate is checked */
#define MS_PER_S 1e3

void qm_guard_init(qm_guard *guard, double idle_ms, double least_rate)
{
    *guard = (qm_guard){.idle_ms = idle_ms, .least_rate = least_rate};
    uv_mutex_init(&guard->lock);
}

void qm_guard_reset(qm_guard *guard)
{
    uv_mutex_destroy(&guard->lock);
}

static void add(qm_guard *guard, struct MHD_Connection *connection, void **context)
{
    qm_connection *added = calloc(1, sizeof *added);
    *context = added;
    if (!added) return;
    added->socket = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    added->since_ms = qm_clock_now_ms();
    uv_mutex_lock(&guard->lock);
    added->next = guard->first;
    if (guard->first) guard->first->previous = added;
    guard->first = added;
    guard->count++;
    uv_mutex_unlock(&guard->lock);
}

/** The library closes the socket after this call. */
static void drop(qm_guard *guard, qm_connection *dropped)
{
    if (!dropped) return;
    uv_mutex_lock(&guard->lock);
    if (dropped->next) dropped->next->previous = dropped->previous;
    if (dropped->previous)
        dropped->previous->next = dropped->next;
    else
        guard->first = dropped->next;
    guard->count--;
    uv_mutex_unlock(&guard->lock);
    free(dropped);
}

void qm_guard_on_connection(void *cls, struct MHD_Connection *connection, void **socket_context,
                            enum MHD_ConnectionNotificationCode code)
{
    if (code == MHD_CONNECTION_NOTIFY_STARTED)
        add(cls, connection, socket_context);
    else
        drop(cls, *socket_context);
}

qm_connection *qm_guard_find(struct MHD_Connection *connection)
{
    return MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context;
}

void qm_guard_set_stage(qm_guard *guard, qm_connection *connection, qm_connection_stage stage)
{
    if (!connection) return;
    uv_mutex_lock(&guard->lock);
    connection->stage = stage;
    connection->since_ms = qm_clock_now_ms();
    uv_mutex_unlock(&guard->lock);
    if (stage == QM_CONNECTION_RECEIVING) atomic_store(&connection->received, 0);
}

size_t qm_guard_count(qm_guard *guard)
{
    uv_mutex_lock(&guard->lock);
    size_t count = guard->count;
    uv_mutex_unlock(&guard->lock);
    return count;
}

static bool is_over_time(const qm_guard *guard, qm_connection *connection, double now_ms)
{
    double elapsed = now_ms - connection->since_ms;
    if (connection->stage == QM_CONNECTION_IDLE) return elapsed > guard->idle_ms;
    if (connection->stage != QM_CONNECTION_RECEIVING || elapsed < RATE_GRACE_MS) return false;
    return (double)atomic_load(&connection->received) < guard->least_rate * elapsed / MS_PER_S;
}

void qm_guard_tick(qm_guard *guard, double now_ms)
{
    uv_mutex_lock(&guard->lock);
    for (qm_connection *c = guard->first; c; c = c->next) {
        if (!is_over_time(guard, c, now_ms)) continue;
        /* The library sees the end of the input and closes the socket, which belongs to it. */
        shutdown(c->socket, SHUT_RDWR);
        c->since_ms = now_ms;
        qm_metrics_add(QM_METRICS_SLOW_CLIENTS, 1);
    }
    uv_mutex_unlock(&guard->lock);
}
