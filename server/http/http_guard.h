/**
 * http_guard.h: ends connections that keep the daemon waiting, and counts connections.
 *
 * The library's own time limit starts again with every byte, so that a client can hold a connection for ever
 * by sending one now and then. Here a connection without a request ends after the idle time whatever it
 * sends, and one whose body comes more slowly than a rate ends as well.
 */
#ifndef QM_HTTP_GUARD_H
#define QM_HTTP_GUARD_H

#include <microhttpd.h>
#include <stdatomic.h>
#include <uv.h>

typedef enum qm_connection_stage {
    QM_CONNECTION_IDLE,
    QM_CONNECTION_RECEIVING,
    QM_CONNECTION_BUSY
} qm_connection_stage;

typedef struct qm_connection {
    MHD_socket socket;
    qm_connection_stage stage;
    double since_ms;        /* of the stage */
    atomic_size_t received; /* bytes of the body, while receiving */
    struct qm_connection *previous, *next;
} qm_connection;

/** lock guards the list and the stages. */
typedef struct qm_guard {
    uv_mutex_t lock;
    qm_connection *first;
    size_t count;
    double idle_ms;
    double least_rate; /* bytes a second; 0: any */
} qm_guard;

void qm_guard_init(qm_guard *guard, double idle_ms, double least_rate);
void qm_guard_reset(qm_guard *guard);

/** The library's hook for connections that come and go; cls is the guard. */
void qm_guard_on_connection(void *cls, struct MHD_Connection *connection, void **socket_context,
                            enum MHD_ConnectionNotificationCode code);

/** The guard's record of a connection; NULL when there was no memory for one. */
qm_connection *qm_guard_find(struct MHD_Connection *connection);

/** NULL is fine. */
void qm_guard_set_stage(qm_guard *guard, qm_connection *connection, qm_connection_stage stage);

size_t qm_guard_count(qm_guard *guard);

/** Ends the connections that are over time; called now and then. */
void qm_guard_tick(qm_guard *guard, double now_ms);

#endif
