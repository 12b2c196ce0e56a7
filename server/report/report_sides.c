/**
 * report_sides.c: on which side of the other mesh a mesh is: the signed figures of a direction, and its share in each band of
 * signed distances.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "report_internal.h"

enum { WIDTH = 640, LEFT = 170, RIGHT = 560, ROW = 24, NAME_SIZE = 96 };

/* ---- names ---- */

static void print_end(double number, char out[32])
{
    snprintf(out, 32, "%.6g", number);
}

/** "below -0.1", "-0.1 to 0.2", "above 0.2" or "all"; an end that is NAN is none. */
static void name_band(double from, double to, char out[NAME_SIZE])
{
    char low[32], high[32];
    print_end(from, low);
    print_end(to, high);
    if (isnan(from) && isnan(to))
        snprintf(out, NAME_SIZE, "all");
    else if (isnan(from) || isnan(to))
        snprintf(out, NAME_SIZE, "%s %s", isnan(from) ? "below" : "above", isnan(from) ? high : low);
    else
        snprintf(out, NAME_SIZE, "%s to %s", low, high);
}

/** A band of the result; false where there is no such band. */
static bool find_band(const qm_report_writer *w, int side, int i, char name[NAME_SIZE], double ends[2],
                      qm_report_interval *share)
{
    const char *direction = qm_report_side_names[side];
    if (!qm_report_has(w, "%s.signed.bands.%d", direction, i)) return false;
    ends[0] = qm_report_number(w, "%s.signed.bands.%d.from", direction, i);
    ends[1] = qm_report_number(w, "%s.signed.bands.%d.to", direction, i);
    *share = qm_report_find(w, "%s.signed.bands.%d", direction, i);
    name_band(ends[0], ends[1], name);
    return true;
}

/* ---- figures ---- */

static void add_figure(qm_report_writer *w, int side, const char *label, const char *path)
{
    char place[NAME_SIZE];
    const char *direction = qm_report_side_names[side];
    qm_text_printf(w->out, "<tr><th scope=\"row\">%s</th>", label);
    qm_report_add_cell(w, qm_report_find(w, "%s.signed.%s", direction, path), false);
    snprintf(place, sizeof place, "%s.signed.%.*s.witness", direction, (int)strcspn(path, "."), path);
    if (strstr(path, ".max") && qm_report_has(w, "%s", place))
        qm_report_add_point(w, place, "from");
    else
        qm_text_add_string(w->out, "<td>&ndash;</td>");
    qm_text_add_string(w->out, "</tr>\n");
}

static void add_figures(qm_report_writer *w, int side)
{
    static const char *const rows[][2] = {{"Mean signed distance", "mean"},
                                          {"Greatest distance outside", "outside.max"},
                                          {"Area, or count, outside", "outside.size"},
                                          {"Greatest distance inside", "inside.max"},
                                          {"Area, or count, inside", "inside.size"}};
    const char *mesh = qm_report_mesh_names[side];
    qm_text_printf(w->out,
                   "<table><caption>Signed figures of %s.</caption><thead><tr><th scope=\"col\">Figure</th>"
                   "<th scope=\"col\">Interval</th><th scope=\"col\">On %s</th></tr></thead><tbody>\n",
                   mesh, mesh);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        add_figure(w, side, rows[i][0], rows[i][1]);
    qm_text_add_string(w->out, "</tbody></table>\n");
}

/* ---- bands ---- */

/** The colour of a band: below zero, above it, or about it. */
static const char *colour_of(const double ends[2])
{
    return ends[1] <= 0.0 ? "#3d7ab8" : ends[0] >= 0.0 ? "#c8643c" : "#6f8f6a";
}

static void add_bar(qm_report_writer *w, int i, double low, double high, const char *style)
{
    qm_text_printf(w->out, "<rect x=\"%.2f\" y=\"%d\" width=\"%.2f\" height=\"%d\" stroke=\"#555\" %s/>",
                   LEFT + low * (RIGHT - LEFT), i * ROW + 4, (high - low) * (RIGHT - LEFT), ROW - 8, style);
}

static void add_chart(qm_report_writer *w, int side, int count)
{
    const char *mesh = qm_report_mesh_names[side];
    char name[NAME_SIZE], style[96];
    double ends[2];
    qm_report_interval share;
    int number = ++w->figure_count;
    qm_text_printf(
        w->out,
        "<figure class=\"chart\"><svg viewBox=\"0 0 %d %d\" role=\"img\" aria-labelledby=\"f%d\">"
        "<title id=\"f%d\">The share of %s in each of %d bands of signed distance, as in the table "
        "below</title>",
        WIDTH, count * ROW + 4, number, number, mesh, count);
    for (int i = 0; find_band(w, side, i, name, ends, &share); i++) {
        int middle = i * ROW + ROW / 2 + 4;
        qm_text_printf(w->out, "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">%s</text>", LEFT - 6, middle,
                       name);
        snprintf(style, sizeof style, "fill=\"%s\"", colour_of(ends));
        add_bar(w, i, 0.0, share.lower, style);
        snprintf(style, sizeof style, "fill=\"%s\" fill-opacity=\"0.35\" stroke-dasharray=\"2 2\"",
                 colour_of(ends));
        add_bar(w, i, share.lower, share.upper, style);
        qm_text_printf(w->out, "<text x=\"%.1f\" y=\"%d\">", LEFT + share.upper * (RIGHT - LEFT) + 6, middle);
        qm_report_add_percent(w->out, share);
        qm_text_add_string(w->out, " %</text>");
    }
    qm_text_printf(
        w->out,
        "</svg><figcaption>Share of %s in each band of signed distance: blue below zero, orange above it, "
        "green "
        "about it. A full bar is certain, the dashed part may belong to it.</figcaption></figure>\n",
        mesh);
}

static void add_bands(qm_report_writer *w, int side)
{
    char name[NAME_SIZE];
    double ends[2];
    qm_report_interval share;
    int count = 0;
    while (find_band(w, side, count, name, ends, &share))
        count++;
    if (count == 0) return;
    add_chart(w, side, count);
    qm_text_printf(w->out,
                   "<table><caption>Share of %s in each band of signed distance.</caption><thead><tr><th "
                   "scope=\"col\">Band</th><th scope=\"col\">Share</th></tr></thead><tbody>\n",
                   qm_report_mesh_names[side]);
    for (int i = 0; find_band(w, side, i, name, ends, &share); i++) {
        qm_text_printf(w->out, "<tr><th scope=\"row\">%s</th>", name);
        qm_report_add_cell(w, share, true);
        qm_text_add_string(w->out, "</tr>\n");
    }
    qm_text_add_string(w->out, "</tbody></table>\n");
}

/* ---- the part of a direction ---- */

static void add_sign(qm_report_writer *w, int side, const char *sign)
{
    const char *other = qm_report_mesh_names[1 - side];
    if (strcmp(sign, "normal") == 0)
        qm_text_printf(w->out,
                       "<p>Distances on the side that the normals of %s point to are positive. The sides are "
                       "<strong>not proven</strong>, as %s need not be closed.</p>\n",
                       other, other);
    else
        qm_text_printf(w->out,
                       "<p>Distances %s of %s are positive. The sides are proven: %s is closed, consistently "
                       "oriented, and does not meet itself.</p>\n",
                       sign, other, other);
}

/** Why a mesh has no sides, in words for the name that a result has. */
static const char *words_of(const char *reason)
{
    static const char *const words[][2] = {{"open", "is open"},
                                           {"turned", "is not consistently oriented"},
                                           {"crossing", "meets itself"},
                                           {"empty", "has no faces"},
                                           {"canceled", "was not checked before the comparison was stopped"}};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcmp(reason, words[i][0]) == 0) return words[i][1];
    return "is no solid";
}

void qm_report_add_sides(qm_report_writer *w, int side)
{
    char path[NAME_SIZE];
    const char *mesh = qm_report_mesh_names[side], *other = qm_report_mesh_names[1 - side];
    snprintf(path, sizeof path, "%s.signed.sign", qm_report_side_names[side]);
    const char *sign = qm_json_get_string(w->result, path);
    snprintf(path, sizeof path, "%s.unsigned", qm_report_side_names[side]);
    const char *reason = qm_json_get_string(w->result, path);
    if (!sign && !reason) return;
    qm_text_printf(w->out, "<h3>On which side of %s</h3>\n", other);
    if (!sign) {
        qm_text_printf(w->out, "<p>The sides of %s are not known, as %s %s.</p>\n", mesh, other,
                       words_of(reason));
        return;
    }
    add_sign(w, side, sign);
    add_figures(w, side);
    add_bands(w, side);
}
