#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"
#include "cli.h"

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

bool cli_read_choice(const char *name, const char *text, const char *const *choices, int *out)
{
    for (*out = 0; choices[*out]; ++*out)
        if (strcmp(text, choices[*out]) == 0) return true;
    fprintf(stderr, "quadmesh: --%s takes %s", name, choices[0]);
    for (int i = 1; choices[i]; i++)
        fprintf(stderr, "%s%s", choices[i + 1] ? ", " : " or ", choices[i]);
    fprintf(stderr, ", got \"%s\"\n", text);
    return false;
}

bool cli_read_quads(const char *text, qm_quad_reading *out)
{
    int place;
    bool known = cli_read_choice("quads", text, qm_quads_names, &place);
    if (known) *out = (qm_quad_reading)place;
    return known;
}

bool cli_read_accelerator(const char *text, qm_accelerator *out)
{
    int place;
    bool known = cli_read_choice("accelerator", text, qm_accelerator_names, &place);
    if (known) *out = (qm_accelerator)place;
    return known;
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
