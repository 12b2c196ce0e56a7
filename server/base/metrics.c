/**
 * metrics.c: counters, and histograms of the times of requests and jobs.
 */
#include "metrics.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <string.h>

#include "qm/base.h"

#define PREFIX "quadmeshd_"
#define MAX_SERIES 256

/** Upper bounds of the buckets in seconds, from the cheapest request to the longest job. */
static const double bucket_ends[] = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25,
                                     0.5,    1,     2.5,    5,     10,   30,    60,   300};
enum { BUCKET_END_COUNT = sizeof bucket_ends / sizeof bucket_ends[0] };

/** A histogram of one set of labels, which are written once, before the state becomes SERIES_READY. */
enum { SERIES_FREE, SERIES_CLAIMED, SERIES_READY };

typedef struct series {
    atomic_int state;
    const char *first, *second;
    int status; /* of a request, 0 for others */
    _Atomic uint64_t buckets[BUCKET_END_COUNT + 1];
    _Atomic uint64_t nanoseconds;
} series;

static series requests[MAX_SERIES], jobs[MAX_SERIES], waits[MAX_SERIES], verbs[MAX_SERIES];
static _Atomic uint64_t counters[QM_METRICS_COUNTER_COUNT];

void qm_metrics_add(qm_metrics_counter counter, uint64_t amount)
{
    QM_ASSERT(counter < QM_METRICS_COUNTER_COUNT);
    atomic_fetch_add_explicit(&counters[counter], amount, memory_order_relaxed);
}

/** Finds or claims the series of these labels; NULL if the table is full. Series are never freed. */
static series *find_series(series *table, const char *first, const char *second, int status)
{
    for (size_t i = 0; i < MAX_SERIES; i++) {
        series *s = &table[i];
        int expected = SERIES_FREE;
        if (atomic_compare_exchange_strong(&s->state, &expected, SERIES_CLAIMED)) {
            s->first = first;
            s->second = second;
            s->status = status;
            atomic_store(&s->state, SERIES_READY);
            return s;
        }
        while (atomic_load(&s->state) == SERIES_CLAIMED)
            continue;
        if (s->status == status && strcmp(s->first, first) == 0 && strcmp(s->second, second) == 0) return s;
    }
    return NULL;
}

static void add_time(series *s, double seconds)
{
    if (!s) return;
    size_t bucket = 0;
    while (bucket < BUCKET_END_COUNT && seconds > bucket_ends[bucket])
        bucket++;
    atomic_fetch_add_explicit(&s->buckets[bucket], 1, memory_order_relaxed);
    atomic_fetch_add_explicit(&s->nanoseconds, (uint64_t)(1e9 * seconds), memory_order_relaxed);
}

/** Methods that no route has share one series: clients could make up any number of them. */
static const char *known_method(const char *method)
{
    static const char *const known[] = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(known[i], method) == 0) return known[i];
    return "other";
}

void qm_metrics_add_request(const char *method, const char *route, int status, double seconds)
{
    add_time(find_series(requests, known_method(method), route, status), seconds);
}

void qm_metrics_add_job(const char *type, const char *state, double seconds)
{
    add_time(find_series(jobs, type, state, 0), seconds);
}

void qm_metrics_add_wait(const char *type, double seconds)
{
    add_time(find_series(waits, type, "", 0), seconds);
}

void qm_metrics_add_store(const char *verb, const char *outcome, double seconds)
{
    add_time(find_series(verbs, verb, outcome, 0), seconds);
}

/* ---- writing ---- */

static void write_head(qm_text *out, const char *name, const char *type, const char *help)
{
    qm_text_printf(out, "# HELP " PREFIX "%s %s\n# TYPE " PREFIX "%s %s\n", name, help, name, type);
}

static void write_value(qm_text *out, const char *name, const char *labels, double value)
{
    char number[QM_NUMBER_SIZE];
    qm_text_printf(out, PREFIX "%s%s %s\n", name, labels, qm_text_number(value, number));
}

static void write_series(qm_text *out, const char *name, const char *labels, const series *s)
{
    uint64_t total = 0;
    char number[QM_NUMBER_SIZE];
    for (size_t i = 0; i <= BUCKET_END_COUNT; i++) {
        total += atomic_load_explicit(&s->buckets[i], memory_order_relaxed);
        qm_text_printf(out, PREFIX "%s_bucket{%s,le=\"%s\"} %llu\n", name, labels,
                       i < BUCKET_END_COUNT ? qm_text_number(bucket_ends[i], number) : "+Inf",
                       (unsigned long long)total);
    }
    double sum = 1e-9 * (double)atomic_load_explicit(&s->nanoseconds, memory_order_relaxed);
    qm_text_printf(out, PREFIX "%s_sum{%s} %s\n" PREFIX "%s_count{%s} %llu\n", name, labels,
                   qm_text_number(sum, number), name, labels, (unsigned long long)total);
}

static void write_histogram(qm_text *out, const char *name, const char *help, const series *table)
{
    write_head(out, name, "histogram", help);
    for (size_t i = 0; i < MAX_SERIES && atomic_load(&table[i].state) == SERIES_READY; i++) {
        const series *s = &table[i];
        qm_text labels = {0};
        if (table == requests)
            qm_text_printf(&labels, "method=\"%s\",route=\"%s\",status=\"%d\"", s->first, s->second,
                           s->status);
        else if (table == waits)
            qm_text_printf(&labels, "type=\"%s\"", s->first);
        else if (table == verbs)
            qm_text_printf(&labels, "verb=\"%s\",outcome=\"%s\"", s->first, s->second);
        else
            qm_text_printf(&labels, "type=\"%s\",state=\"%s\"", s->first, s->second);
        if (labels.failed)
            out->failed = true;
        else
            write_series(out, name, labels.data, s);
        qm_text_reset(&labels);
    }
}

void qm_metrics_write(qm_text *out, const qm_metrics_gauge *gauges, size_t count)
{
    static const struct {
        const char *name, *help;
    } names[] = {
#define XX(suffix, name, help) {name, help},
        QM_METRICS_COUNTER_MAP(XX)
#undef XX
    };
    for (size_t i = 0; i < count; i++) {
        write_head(out, gauges[i].name, "gauge", gauges[i].help);
        write_value(out, gauges[i].name, "", gauges[i].value);
    }
    for (size_t i = 0; i < QM_METRICS_COUNTER_COUNT; i++) {
        write_head(out, names[i].name, "counter", names[i].help);
        write_value(out, names[i].name, "", (double)atomic_load_explicit(&counters[i], memory_order_relaxed));
    }
    write_histogram(out, "request_seconds", "Time from the first header to the end of the reply.", requests);
    write_histogram(out, "job_wait_seconds", "Time that a job waited for its first turn.", waits);
    write_histogram(out, "job_seconds", "Time from a job's first turn to its end.", jobs);
    if (atomic_load(&verbs[0].state) == SERIES_READY)
        write_histogram(out, "store_seconds", "Time of a call of the shared store.", verbs);
}

void qm_metrics_write_plain(qm_text *out, const char *name, const char *type, const char *help, double value)
{
    char number[QM_NUMBER_SIZE];
    qm_text_printf(out, "# HELP %s %s\n# TYPE %s %s\n%s %s\n", name, help, name, type, name,
                   qm_text_number(value, number));
}
