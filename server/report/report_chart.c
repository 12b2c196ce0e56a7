/**
 * report_chart.c: the legend of the colours, and how distances spread, as SVG in the document.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "report_internal.h"

enum { WIDTH = 640, LEFT = 52, RIGHT = 630, TOP = 20, BOTTOM = 172, HEIGHT = 216 };
enum { MAX_LIMITS = 64, MAX_STEPS = 2 * MAX_LIMITS + 2 };

/** Opens a chart with its text alternative, which the caller writes and ends by qm_text_add_string("</title>"). */
static void open_chart(qm_report_writer *w, int height)
{
    int number = ++w->figure_count;
    qm_text_printf(w->out,
                   "<figure class=\"chart\"><svg viewBox=\"0 0 %d %d\" role=\"img\" aria-labelledby=\"f%d\">"
                   "<title id=\"f%d\">",
                   WIDTH, height, number, number);
}

static void add_label(qm_report_writer *w, double x, double y, const char *anchor, double number)
{
    qm_text_printf(w->out, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", x, y, anchor);
    qm_report_add_number(w->out, number);
    qm_text_add_string(w->out, "</text>");
}

/** The name of the horizontal axis, with the unit. */
static void add_axis_name(qm_report_writer *w)
{
    const char *unit = qm_report_unit(w);
    qm_text_printf(w->out, "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">distance%s%s</text>", RIGHT,
                   HEIGHT - 8, unit[0] ? ", " : "", unit);
}

static void add_fill(qm_text *out, const qm_scale *scale, int band)
{
    uint8_t colour[3];
    qm_scale_colour(scale, band, colour);
    qm_text_printf(out, "fill=\"#%02x%02x%02x\"", colour[0], colour[1], colour[2]);
}

/* ---- the legend ---- */

/** Whether an edge gets a number: the first, the last, the limit, and others that are far enough from these. */
static bool is_labelled(const qm_scale *scale, int edge)
{
    const int kept[3] = {0, scale->within, QM_SCALE_BANDS};
    for (int i = 0; i < 3; i++) {
        if (edge == kept[i]) return true;
        if (abs(edge - kept[i]) < 3) return false;
    }
    return edge % 4 == 0;
}

void qm_report_add_legend(qm_report_writer *w)
{
    const double band = (RIGHT - LEFT) / (QM_SCALE_BANDS + 1.0);
    open_chart(w, 62);
    qm_text_add_string(w->out, "Colours of distances from 0 to ");
    qm_report_add_number(w->out, w->scale.edge[QM_SCALE_BANDS]);
    qm_text_add_string(w->out, " and more");
    if (w->scale.within > 0) qm_text_add_string(w->out, ": blue within the limit, orange and red beyond it");
    qm_text_add_string(w->out, "</title>");
    for (int i = 0; i <= QM_SCALE_BANDS; i++) {
        qm_text_printf(w->out, "<rect x=\"%.1f\" y=\"18\" width=\"%.1f\" height=\"20\" stroke=\"#777\" ",
                       LEFT + i * band, band);
        add_fill(w->out, &w->scale, i);
        qm_text_add_string(w->out, "/>");
        if (is_labelled(&w->scale, i)) add_label(w, LEFT + i * band, 54, "middle", w->scale.edge[i]);
    }
    qm_text_printf(w->out, "<text x=\"%d\" y=\"13\" text-anchor=\"end\">more</text>", RIGHT);
    qm_text_printf(w->out, "<text x=\"%d\" y=\"34\" text-anchor=\"end\">%s</text>", LEFT - 4,
                   qm_report_unit(w));
    if (w->scale.within > 0)
        qm_text_printf(w->out, "<text x=\"%.1f\" y=\"13\" text-anchor=\"middle\">limit</text>",
                       LEFT + w->scale.within * band);
    qm_text_add_string(w->out, "</svg></figure>\n");
}

/* ---- the share in each band of the limits ---- */

typedef struct limit_share {
    double limit, lower, upper;
} limit_share;

static int compare_limits(const void *a, const void *b)
{
    double x = ((const limit_share *)a)->limit, y = ((const limit_share *)b)->limit;
    return (x > y) - (x < y);
}

/** The shares within limits, in the order of the limits, each limit once. */
static int find_shares(const qm_report_writer *w, int side, limit_share out[MAX_LIMITS])
{
    const char *name = qm_report_side_names[side];
    int count = 0, kept = 0;
    while (count < MAX_LIMITS && qm_report_has(w, "%s.shares.%d", name, count)) {
        qm_report_interval share = qm_report_find(w, "%s.shares.%d", name, count);
        out[count] =
            (limit_share){qm_report_number(w, "%s.shares.%d.limit", name, count), share.lower, share.upper};
        count++;
    }
    qsort(out, (size_t)count, sizeof *out, compare_limits);
    for (int i = 0; i < count; i++)
        if (i == 0 || out[i].limit > out[kept - 1].limit) out[kept++] = out[i];
    return kept;
}

/** The share beyond limit i - 1 up to limit i: what is within the one less what is within the other. */
static qm_report_interval find_band(const limit_share *shares, int count, int i)
{
    qm_report_interval below = {0.0, 0.0}, whole = {1.0, 1.0};
    if (i > 0) below = (qm_report_interval){shares[i - 1].lower, shares[i - 1].upper};
    if (i < count) whole = (qm_report_interval){shares[i].lower, shares[i].upper};
    return (qm_report_interval){fmax(whole.lower - below.upper, 0.0), fmin(whole.upper - below.lower, 1.0)};
}

/** The end of the vertical axis. */
static double find_axis(const limit_share *shares, int count)
{
    static const double ends[] = {0.01, 0.02, 0.05, 0.1, 0.2, 0.5};
    double greatest = 0.0;
    for (int i = 0; i <= count; i++)
        greatest = fmax(greatest, find_band(shares, count, i).upper);
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
        if (greatest <= ends[i]) return ends[i];
    return 1.0;
}

static void add_axes(qm_report_writer *w, double axis)
{
    for (int i = 0; i <= 2; i++)
        qm_text_printf(w->out, "<text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">%.3g %%</text>", LEFT - 4,
                       BOTTOM - 0.5 * i * (BOTTOM - TOP) + 4, 50.0 * i * axis);
    qm_text_printf(w->out, "<path class=\"axis\" fill=\"none\" d=\"M%d %dV%dH%d\"/>", LEFT, TOP, BOTTOM,
                   RIGHT);
}

static void add_bar(qm_report_writer *w, double x, double wide, double low, double high, const char *style)
{
    qm_text_printf(w->out, "<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" %s ", x,
                   BOTTOM - high * (BOTTOM - TOP), wide, (high - low) * (BOTTOM - TOP), style);
}

static void add_bands(qm_report_writer *w, int side)
{
    limit_share shares[MAX_LIMITS];
    int count = find_shares(w, side, shares);
    if (count == 0) return;
    double axis = find_axis(shares, count), wide = (RIGHT - LEFT) / (count + 1.0);
    const char *mesh = qm_report_mesh_names[side];
    open_chart(w, HEIGHT);
    qm_text_printf(
        w->out,
        "The share of %s in each of %d bands of distance; the table of all figures has the shares within "
        "the limits between them</title>",
        mesh, count + 1);
    add_axes(w, axis);
    for (int i = 0; i <= count; i++) {
        qm_report_interval share = find_band(shares, count, i);
        double middle = i == count ? nextafter(shares[i - 1].limit, INFINITY)
                                   : 0.5 * ((i > 0 ? shares[i - 1].limit : 0.0) + shares[i].limit);
        for (int part = 0; part < 2; part++) {
            add_bar(
                w, LEFT + i * wide + 0.1 * wide, 0.8 * wide, part == 0 ? 0.0 : share.lower / axis,
                (part == 0 ? share.lower : share.upper) / axis,
                part == 0
                    ? "stroke=\"#555\" stroke-width=\"0.7\""
                    : "stroke=\"#555\" stroke-width=\"0.7\" stroke-dasharray=\"2 2\" fill-opacity=\"0.35\"");
            add_fill(w->out, &w->scale, qm_scale_band(&w->scale, middle));
            qm_text_add_string(w->out, "/>");
        }
        if (count < 20) {
            qm_text_printf(w->out, "<text class=\"small\" x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">",
                           LEFT + (i + 0.5) * wide, BOTTOM - share.upper / axis * (BOTTOM - TOP) - 3.0);
            qm_report_add_percent(w->out, share);
            qm_text_add_string(w->out, "</text>");
        }
        if (i < count && (i + 1) % ((count + 1) / 9 + 1) == 0)
            add_label(w, LEFT + (i + 1) * wide, BOTTOM + 16, "middle", shares[i].limit);
    }
    add_axis_name(w);
    qm_text_printf(
        w->out,
        "</svg><figcaption>Share of %s in each band of distance, in percent; the last bar is all that is "
        "beyond. A full bar is certain, the dashed part above it may belong to it.</figcaption></figure>\n",
        mesh);
}

/* ---- the share within each distance ---- */

/** At least (or at most) the share y of the surface is within every distance from x on (or up to x). */
typedef struct curve_step {
    double x, y;
} curve_step;

static int compare_steps(const void *a, const void *b)
{
    double x = ((const curve_step *)a)->x, y = ((const curve_step *)b)->x;
    return (x > y) - (x < y);
}

/** What percentiles, shares and the maximum say of the share within a distance: from below (bound 0) or above (1). */
static int find_steps(const qm_report_writer *w, int side, int bound, curve_step out[MAX_STEPS])
{
    const char *name = qm_report_side_names[side];
    limit_share shares[MAX_LIMITS];
    int count = find_shares(w, side, shares), steps = 0;
    for (int i = 0; i < count; i++)
        out[steps++] = (curve_step){shares[i].limit, bound == 0 ? shares[i].lower : shares[i].upper};
    for (int i = 0; i < MAX_LIMITS && qm_report_has(w, "%s.percentiles.%d", name, i); i++) {
        qm_report_interval at = qm_report_find(w, "%s.percentiles.%d", name, i);
        double percent = qm_report_number(w, "%s.percentiles.%d.percent", name, i);
        out[steps++] = (curve_step){bound == 0 ? at.upper : at.lower, percent / 100.0};
    }
    double end = qm_report_find(w, "%s.hausdorff", name).upper;
    out[steps++] = (curve_step){end, 1.0};
    qsort(out, (size_t)steps, sizeof *out, compare_steps);
    if (bound == 0) {
        for (int i = 1; i < steps; i++)
            out[i].y = fmax(out[i].y, out[i - 1].y);
    } else {
        for (int i = steps - 2; i >= 0; i--)
            out[i].y = fmin(out[i].y, out[i + 1].y);
    }
    return steps;
}

static void add_point(qm_text *out, char command, double x, double y, double end)
{
    qm_text_printf(out, "%c%.2f %.2f", command, LEFT + fmin(x / end, 1.0) * (RIGHT - LEFT),
                   BOTTOM - y * (BOTTOM - TOP));
}

/** The area between the two curves: along the upper one, back along the lower one. */
static void add_curves(qm_report_writer *w, int side, double end)
{
    curve_step steps[MAX_STEPS];
    int count = find_steps(w, side, 1, steps);
    qm_text_add_string(w->out, "<path fill=\"#3d7ab8\" fill-opacity=\"0.45\" stroke=\"#3d7ab8\" d=\"");
    for (int i = 0; i < count; i++) {
        add_point(w->out, i == 0 ? 'M' : 'L', i == 0 ? 0.0 : steps[i - 1].x, steps[i].y, end);
        add_point(w->out, 'L', steps[i].x, steps[i].y, end);
    }
    count = find_steps(w, side, 0, steps);
    for (int i = count - 1; i >= 0; i--) {
        add_point(w->out, 'L', steps[i].x, steps[i].y, end);
        add_point(w->out, 'L', steps[i].x, i == 0 ? 0.0 : steps[i - 1].y, end);
    }
    add_point(w->out, 'L', 0.0, 0.0, end);
    qm_text_add_string(w->out, "Z\"/>");
}

/** 1, 2 or 5 times a power of ten: between four and nine of them make the length. */
static double find_step(double length)
{
    double unit = pow(10.0, floor(log10(length)) - 1.0);
    return length >= 50.0 * unit ? 10.0 * unit : length >= 20.0 * unit ? 5.0 * unit : 2.0 * unit;
}

static void add_distribution(qm_report_writer *w, int side)
{
    const char *mesh = qm_report_mesh_names[side];
    double limit = w->report->limits.distance,
           end = qm_report_find(w, "%s.hausdorff", qm_report_side_names[side]).upper;
    if (limit <= 4.0 * end) end = fmax(end, limit);
    if (!(isfinite(end) && end > 0.0)) {
        qm_text_printf(
            w->out, "<p>No point of %s is away from the other mesh: there is nothing to spread.</p>\n", mesh);
        return;
    }
    open_chart(w, HEIGHT);
    qm_text_printf(w->out,
                   "The share of %s within each distance, as a band that holds the true curve</title>", mesh);
    add_axes(w, 1.0);
    add_curves(w, side, end);
    double step = find_step(end);
    for (int i = 0; i * step <= end; i++)
        add_label(w, LEFT + i * step / end * (RIGHT - LEFT), BOTTOM + 16, "middle", i * step);
    if (limit > 0.0 && limit <= end)
        qm_text_printf(
            w->out,
            "<path class=\"axis\" stroke-dasharray=\"4 3\" d=\"M%.2f %dV%d\"/><text x=\"%.2f\" y=\"%d\" "
            "text-anchor=\"%s\">limit</text>",
            LEFT + limit / end * (RIGHT - LEFT), TOP, BOTTOM,
            LEFT + limit / end * (RIGHT - LEFT) + (limit > 0.5 * end ? -5.0 : 5.0), BOTTOM - 8,
            limit > 0.5 * end ? "end" : "start");
    add_axis_name(w);
    qm_text_printf(w->out,
                   "</svg><figcaption>Share of %s within each distance: the true curve runs inside the "
                   "band.</figcaption></figure>\n",
                   mesh);
}

void qm_report_add_charts(qm_report_writer *w, int side)
{
    add_bands(w, side);
    add_distribution(w, side);
}
