#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "parallel.h"

#define MAX_THREADS 256

bool cli_read_number(const char *name, const char *text, double least, double *out)
{
    char *end;
    *out = strtod(text, &end);
    if (end != text && !*end && isfinite(*out) && *out >= least) return true;
    fprintf(stderr, "quadmesh: --%s takes a number%s, got \"%s\"\n", name,
            least > 0.0 ? " above 0" : " of 0 or more", text);
    return false;
}

bool cli_read_quads(const char *text, qm_quad_reading *out)
{
    if (strcmp(text, "triangles") == 0) return *out = QM_QUADS_TRIANGLES, true;
    if (strcmp(text, "bilinear") == 0) return *out = QM_QUADS_BILINEAR, true;
    fprintf(stderr, "quadmesh: --quads takes triangles or bilinear, got \"%s\"\n", text);
    return false;
}

/** In the order of qm_accelerator. */
static const char *const accelerators[] = {"auto", "boxes", "tetra", "grid"};

bool cli_read_accelerator(const char *text, qm_accelerator *out)
{
    for (int i = 0; i < QM_ACCELERATOR_COUNT; i++)
        if (strcmp(text, accelerators[i]) == 0) return *out = (qm_accelerator)i, true;
    fprintf(stderr, "quadmesh: --accelerator takes auto, boxes, tetra or grid, got \"%s\"\n", text);
    return false;
}

const char *cli_accelerator_name(qm_accelerator accelerator)
{
    return accelerators[accelerator];
}

int cli_count_threads(int asked)
{
    return asked > 0 ? asked : qm_parallel_available();
}

bool cli_read_threads(const char *text, int *out)
{
    double number;
    if (!cli_read_number("threads", text, 1.0, &number)) return false;
    *out = (int)fmin(number, MAX_THREADS + 1);
    if (*out <= MAX_THREADS && *out == number) return true;
    fprintf(stderr, "quadmesh: --threads takes a whole number from 1 to %d, got \"%s\"\n", MAX_THREADS, text);
    return false;
}
