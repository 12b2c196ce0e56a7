#include <math.h>
#include <stdio.h>

#include "base/json_read.h"
#include "cli.h"

static void print_words(const qm_json *result)
{
    double lower = qm_json_get_number(result, "lower"), upper = qm_json_get_number(result, "upper");
    printf("Hausdorff distance, %s, quads as %s\n", qm_json_get_string(result, "direction"),
           qm_json_get_string(result, "quads"));
    printf("  lower    %.17g\n  upper    %.17g\n", lower, upper);
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    double relative = qm_json_get_number(result, "upper_relative");
    if (isfinite(relative))
        printf("  relative %s to %s of the diagonal of A\n",
               cli_format_bound(qm_json_get_number(result, "lower_relative"), false, low),
               cli_format_bound(relative, true, high));
    if (qm_json_has(result, "witness"))
        printf("  farthest on face %.0f of %s, nearest to it face %.0f of %s\n",
               qm_json_get_number(result, "witness.from.face"),
               qm_json_get_string(result, "witness.from.mesh"), qm_json_get_number(result, "witness.to.face"),
               qm_json_get_string(result, "witness.to.mesh"));
    const char *verdict = qm_json_get_string(result, "verdict");
    if (verdict) printf("  verdict  %s the threshold\n", verdict);
    printf("  search   %.1f ms after %.1f + %.1f ms to prepare, %.0f iterations, %.0f projections\n",
           qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
           qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "iterations"),
           qm_json_get_number(result, "projections"));
    if (!qm_json_is_true(result, "converged"))
        printf("  stopped  by %s; the bounds hold\n", qm_json_get_string(result, "stopped_by"));
}

int cli_print_result(const char *json, bool as_json)
{
    qm_json *result = qm_json_parse(json);
    if (as_json)
        puts(json);
    else
        print_words(result);
    bool is_done = qm_json_is_true(result, "converged") || qm_json_has(result, "verdict");
    qm_json_free(result);
    return is_done ? EXIT_OK : EXIT_NOT_CONVERGED;
}
