/**
 * measure.h: how every program of the benchmark measures itself: this engine's and the peers', C and C++.
 *
 * A program prints one JSON object on one line. Times are lists in milliseconds, one number for each repeat;
 * memory is in kilobytes: resting_kb is what the process held once its input was read, peak_kb the most that
 * it held from then on.
 */
#ifndef QM_BENCH_MEASURE_H
#define QM_BENCH_MEASURE_H

#include <malloc.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define QM_BENCH_REPEATS 5
#define QM_BENCH_ENOUGH_MS 500.0

static inline double qm_bench_now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

/** Short work is repeated in one process, so that its median does not hang on one interruption. */
typedef struct qm_bench_times {
    double build_ms[QM_BENCH_REPEATS], query_ms[QM_BENCH_REPEATS];
    int count;
    double spent_ms;
} qm_bench_times;

static inline bool qm_bench_wants_more(const qm_bench_times *times)
{
    return times->count == 0 || (times->count < QM_BENCH_REPEATS && times->spent_ms < QM_BENCH_ENOUGH_MS);
}

static inline void qm_bench_add(qm_bench_times *times, double build_ms, double query_ms)
{
    times->build_ms[times->count] = build_ms;
    times->query_ms[times->count++] = query_ms;
    times->spent_ms += build_ms + query_ms;
}

static inline void qm_bench_print_list(const char *name, const double *values, int count)
{
    printf("\"%s\": [", name);
    for (int i = 0; i < count; i++)
        printf("%s%.6f", i > 0 ? ", " : "", values[i]);
    printf("]");
}

/** A line of /proc/self/status such as VmHWM; 0 where the system does not say. */
static inline long qm_bench_memory_kb(const char *key)
{
    char line[256];
    long size = 0;
    FILE *status = fopen("/proc/self/status", "r");
    while (status && fgets(line, sizeof line, status))
        if (strncmp(line, key, strlen(key)) == 0) sscanf(line + strlen(key), ": %ld", &size);
    if (status) fclose(status);
    return size;
}

/** Gives back what reading left over and resets the peak; returns the kilobytes held. */
static inline long qm_bench_rest(void)
{
    malloc_trim(0);
    FILE *peak = fopen("/proc/self/clear_refs", "w");
    if (peak) {
        fputs("5", peak);
        fclose(peak);
    }
    return qm_bench_memory_kb("VmRSS");
}

/** Opens the object with what all programs have in common. */
static inline void qm_bench_print_times(const qm_bench_times *times, long resting_kb)
{
    printf("{");
    qm_bench_print_list("build_ms", times->build_ms, times->count);
    printf(", ");
    qm_bench_print_list("query_ms", times->query_ms, times->count);
    printf(", \"resting_kb\": %ld, \"peak_kb\": %ld", resting_kb, qm_bench_memory_kb("VmHWM"));
}

#endif
