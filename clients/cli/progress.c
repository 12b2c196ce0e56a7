#include <math.h>
#include <stdio.h>
#include <unistd.h>

#include "cli.h"

#define BAR_WIDTH 24

cli_bar cli_bar_make(double tolerance)
{
    return (cli_bar){.is_terminal = isatty(STDERR_FILENO) == 1, .tolerance = tolerance};
}

/** The share of the way from the first gap to the tolerance, on a log scale. */
static double share_done(const cli_bar *bar, double gap)
{
    if (!(gap > bar->tolerance) || !(bar->first_gap > bar->tolerance)) return 1.0;
    return log(bar->first_gap / gap) / log(bar->first_gap / bar->tolerance);
}

void cli_bar_show(cli_bar *bar, double lower, double upper, double elapsed_ms, double iterations)
{
    if (!bar->is_terminal || !isfinite(upper)) return;
    double gap = upper - lower;
    if (bar->first_gap == 0.0) bar->first_gap = gap;
    int filled = (int)(share_done(bar, gap) * BAR_WIDTH);
    char drawn[BAR_WIDTH + 1];
    for (int i = 0; i < BAR_WIDTH; i++)
        drawn[i] = i < filled ? '#' : '.';
    drawn[BAR_WIDTH] = '\0';
    fprintf(stderr, "\r[%s] %.9g .. %.9g  gap %.1e  %.0f/s\033[K", drawn, lower, upper, gap,
            elapsed_ms > 0.0 ? 1e3 * iterations / elapsed_ms : 0.0);
}

void cli_bar_clear(const cli_bar *bar)
{
    if (bar->is_terminal) fputs("\r\033[K", stderr);
}
