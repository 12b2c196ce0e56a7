/**
 * metrics.h: the daemon's metrics in Prometheus' text format (version 0.0.4).
 *
 * Counters live as long as the process; any thread increments them, without a lock. Values of the current state
 * (queued jobs, open streams) are not kept here: the handler passes them as gauges.
 */
#ifndef QM_METRICS_H
#define QM_METRICS_H

#include <stddef.h>
#include <stdint.h>

#include "text.h"

/** XX(suffix, name without the prefix, help). */
#define QM_METRICS_COUNTER_MAP(XX)                                                                           \
    XX(UPLOADED_BYTES, "uploaded_bytes_total", "Bytes of bodies that were received.")                        \
    XX(MESHES_ADDED, "meshes_added_total", "Meshes that were new.")                                          \
    XX(MESH_LOADS, "mesh_loads_total", "Meshes that were read back from their blob.")                        \
    XX(MESH_EVICTIONS, "mesh_evictions_total", "Meshes that were dropped from memory for others.")           \
    XX(DAMAGES, "damages_total", "Times that a stored file or record was found damaged or missing.")         \
    XX(REPAIRS, "repairs_total", "Damaged files of meshes that an upload of the same bytes has replaced.")   \
    XX(CACHED_ANSWERS, "cached_answers_total", "Jobs that were answered from an earlier one.")               \
    XX(BATCH_LINES, "batch_lines_total", "Lines of batches that were read.")                                 \
    XX(REFUSED_TOKENS, "refused_tokens_total", "Requests without a token that allows them.")                 \
    XX(SLOW_CLIENTS, "slow_clients_total", "Connections closed as they kept the daemon waiting.")            \
    XX(BLOB_BYTES_FETCHED, "blob_bytes_fetched_total", "Bytes of blobs copied from the shared store.")       \
    XX(LEASES_LOST, "leases_lost_total", "Jobs that another node took over.")                                \
    XX(JOBS_CLAIMED, "jobs_claimed_total", "Jobs taken from the queue of the shared store.")

typedef enum qm_metrics_counter {
#define XX(suffix, name, help) QM_METRICS_##suffix,
    QM_METRICS_COUNTER_MAP(XX)
#undef XX
        QM_METRICS_COUNTER_COUNT
} qm_metrics_counter;

void qm_metrics_add(qm_metrics_counter counter, uint64_t amount);

/** Counts a finished request; route is the pattern of its path, a literal, or "" if none matches. */
void qm_metrics_add_request(const char *method, const char *route, int status, double seconds);

/** Counts a finished job; both names are literals. */
void qm_metrics_add_job(const char *type, const char *state, double seconds);

/** Counts the time that a job waited for its first turn. */
void qm_metrics_add_wait(const char *type, double seconds);

/** Counts a call of a shared store; both names are literals. */
void qm_metrics_add_store(const char *verb, const char *outcome, double seconds);

/** A current value. */
typedef struct qm_metrics_gauge {
    const char *name, *help; /* without the prefix */
    double value;
} qm_metrics_gauge;

/** Writes all gauges, counters and histograms. */
void qm_metrics_write(qm_text *out, const qm_metrics_gauge *gauges, size_t count);

/** Writes one metric whose name is complete. */
void qm_metrics_write_plain(qm_text *out, const char *name, const char *type, const char *help, double value);

#endif
