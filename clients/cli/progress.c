#include "progress.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

#define BAR_WIDTH 24
#define BAR_EVERY_MS 80.0
#define LINE_EVERY_MS 1000.0

qm_progress_view qm_progress_view_make(double tolerance, double diagonal)
{
    bool is_terminal = isatty(STDERR_FILENO);
    /* The first line waits for its time too: a search of a blink says nothing. */
    return (qm_progress_view){.tolerance = tolerance, .diagonal = diagonal, .is_terminal = is_terminal};
}

/** Gaps shrink by factors, so the bar goes by their logarithms. */
static double share_done(const qm_progress_view *view, double gap)
{
    if (gap <= view->tolerance) return 1.0;
    if (!(view->first_gap > view->tolerance) || !isfinite(gap)) return 0.0;
    return fmax(0.0, log(view->first_gap / gap) / log(view->first_gap / view->tolerance));
}

static void write_bar(const qm_progress_view *view, double gap)
{
    char bar[BAR_WIDTH + 1];
    int full = (int)(share_done(view, gap) * BAR_WIDTH);
    for (int i = 0; i < BAR_WIDTH; i++)
        bar[i] = i < full ? '#' : '.';
    bar[BAR_WIDTH] = '\0';
    fprintf(stderr, "\r[%s] ", bar);
}

void qm_progress_view_show(qm_progress_view *view, const qm_hausdorff_progress *progress)
{
    double gap = progress->upper - progress->lower;
    if (view->first_gap == 0.0 && isfinite(gap)) view->first_gap = gap;
    if (progress->elapsed_ms - view->shown_ms < (view->is_terminal ? BAR_EVERY_MS : LINE_EVERY_MS)) return;
    view->shown_ms = progress->elapsed_ms;
    if (view->is_terminal) write_bar(view, gap);
    fprintf(stderr, "%.9g <= h <= %.9g  gap %.2e", progress->lower, progress->upper,
            view->diagonal > 0.0 ? gap / view->diagonal : gap);
    fprintf(stderr, "  %.0f pieces/s", 1e3 * (double)progress->iterations / progress->elapsed_ms);
    /* A shorter line must wipe the rest of a longer one. */
    fputs(view->is_terminal ? "\033[K" : "\n", stderr);
    view->has_bar = view->is_terminal;
    fflush(stderr);
}

void qm_progress_view_end(qm_progress_view *view)
{
    if (view->has_bar) fputs("\r\033[K", stderr);
    view->has_bar = false;
}
