/**
 * arrays.h: raw arrays in files, as bench_engine writes them, for C and C++.
 *
 * PREFIX.vertices holds rows of three doubles, PREFIX.triangles rows of three 32-bit indices from 0, both in
 * the machine's byte order. A program that cannot read one ends with status 1 and says which.
 */
#ifndef QM_BENCH_ARRAYS_H
#define QM_BENCH_ARRAYS_H

#include <stdio.h>
#include <stdlib.h>

/** All rows of a file; the caller's, for free. */
static inline void *qm_bench_read_rows(const char *path, size_t width, size_t *count)
{
    FILE *file = fopen(path, "rb");
    long size = file && fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    void *rows = size >= 0 ? malloc((size_t)size + 1) : NULL;
    if (rows) {
        rewind(file);
        *count = fread(rows, width, (size_t)size / width, file);
    }
    if (!rows || *count * width != (size_t)size) {
        fprintf(stderr, "%s: cannot be read in rows of %zu bytes\n", path, width);
        exit(EXIT_FAILURE);
    }
    fclose(file);
    return rows;
}

static inline void *qm_bench_read_part(const char *prefix, const char *suffix, size_t width, size_t *count)
{
    char path[4096];
    snprintf(path, sizeof path, "%s.%s", prefix, suffix);
    return qm_bench_read_rows(path, width, count);
}

/**
 * Every this many points one distance is printed, so that run.py can compare the programs' answers.
 */
#define QM_BENCH_CHECK_STEP 997

static inline void qm_bench_print_checks(const double *distances, size_t count)
{
    printf("\"distances\": [");
    for (size_t i = 0; i < count; i += QM_BENCH_CHECK_STEP)
        printf("%s%.17g", i > 0 ? ", " : "", distances[i]);
    printf("]");
}

#endif
