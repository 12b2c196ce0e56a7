/**
 * progress.c: bounds in few digits, and the progress bar.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "cli.h"

#define BAR_WIDTH 24

cli_bar cli_bar_make(double tolerance, bool is_forced)
{
    return (cli_bar){
        .is_terminal = isatty(STDERR_FILENO) == 1, .is_forced = is_forced, .tolerance = tolerance};
}

char *cli_format_bound(double bound, bool is_upper, char out[CLI_BOUND_SIZE])
{
    snprintf(out, CLI_BOUND_SIZE, "%.9g", bound);
    double printed = strtod(out, NULL);
    if (!isfinite(bound) || (is_upper ? printed >= bound : printed <= bound)) return out;
    /* One unit of the ninth digit outward. Near a power of ten log10 may round to the next digit, which widens the
     * interval and is safe. */
    double unit = pow(10.0, floor(log10(fabs(bound))) - 8.0);
    snprintf(out, CLI_BOUND_SIZE, "%.9g", is_upper ? printed + unit : printed - unit);
    return out;
}

void cli_bar_show(cli_bar *bar, double lower, double upper, double elapsed_ms, double iterations)
{
    if (!(bar->is_terminal || bar->is_forced) || !isfinite(upper)) return;
    QM_ASSERT(lower <= upper);
    double gap = upper - lower;
    if (bar->first_gap == 0.0) bar->first_gap = gap;
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    /* The completed fraction of the way from the first gap to the tolerance, on a log scale. */
    const bool is_open = gap > bar->tolerance && bar->first_gap > bar->tolerance;
    const double fraction = is_open ? log(bar->first_gap / gap) / log(bar->first_gap / bar->tolerance) : 1.0;
    int filled = (int)(fraction * BAR_WIDTH);
    char drawn[BAR_WIDTH + 1];
    for (int i = 0; i < BAR_WIDTH; i++)
        drawn[i] = i < filled ? '#' : '.';
    drawn[BAR_WIDTH] = '\0';
    fprintf(stderr, "%s[%s] %s .. %s  gap %.1e  %.0f/s%s", bar->is_terminal ? "\r" : "", drawn,
            cli_format_bound(lower, false, low), cli_format_bound(upper, true, high), gap,
            elapsed_ms > 0.0 ? 1e3 * iterations / elapsed_ms : 0.0, bar->is_terminal ? "\033[K" : "\n");
}

void cli_bar_clear(const cli_bar *bar)
{
    if (bar->is_terminal) fputs("\r\033[K", stderr);
}
