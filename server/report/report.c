/**
 * report.c: the document of a report, section by section.
 */
#include "report.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "qm/bvh.h"
#include "report_internal.h"

const char *const qm_report_side_names[2] = {"a_to_b", "b_to_a"};
const char *const qm_report_mesh_names[2] = {"A", "B"};

/* ---- the result ---- */

#define PATH_SIZE 96

qm_report_interval qm_report_find(const qm_report_writer *w, const char *format, ...)
{
    char path[PATH_SIZE], member[PATH_SIZE + 8];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(path, sizeof path, format, arguments);
    va_end(arguments);
    qm_report_interval found;
    snprintf(member, sizeof member, "%s.lower", path);
    found.lower = qm_json_get_number(w->result, member);
    snprintf(member, sizeof member, "%s.upper", path);
    found.upper = qm_json_get_number(w->result, member);
    return found;
}

bool qm_report_has(const qm_report_writer *w, const char *format, ...)
{
    char path[PATH_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(path, sizeof path, format, arguments);
    va_end(arguments);
    return qm_json_has(w->result, path);
}

double qm_report_number(const qm_report_writer *w, const char *format, ...)
{
    char path[PATH_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(path, sizeof path, format, arguments);
    va_end(arguments);
    return qm_json_get_number(w->result, path);
}

void qm_report_add_cell(qm_report_writer *w, qm_report_interval interval, bool is_share)
{
    char lower[QM_NUMBER_SIZE], upper[QM_NUMBER_SIZE];
    qm_text_printf(w->out, "<td data-lower=\"%s\" data-upper=\"%s\">", qm_text_number(interval.lower, lower),
                   qm_text_number(interval.upper, upper));
    qm_report_add_interval(w->out, interval, is_share, 0);
    qm_text_add_string(w->out, "</td>");
}

/* ---- names ---- */

/** The name of a file, whose direction of writing does not spread to what stands around it. */
static void add_name(qm_report_writer *w, int side)
{
    const char *name = w->report->mesh[side].name;
    qm_text_add_string(w->out, "<bdi>");
    qm_report_add_escaped(w->out, name && *name ? name : side == 0 ? "mesh A" : "mesh B");
    qm_text_add_string(w->out, "</bdi>");
}

static void add_title_name(qm_report_writer *w, int side)
{
    const char *name = w->report->mesh[side].name;
    qm_report_add_escaped(w->out, name && *name ? name : qm_report_mesh_names[side]);
}

const char *qm_report_unit(const qm_report_writer *w)
{
    const qm_report_mesh *mesh = w->report->mesh;
    return mesh[0].notes.unit[0] ? mesh[0].notes.unit : mesh[1].notes.unit;
}

/* ---- the verdict ---- */

/** The intervals that limits are about, as paths of a result, in the order of qm_report_limits. */
static const char *const limited[] = {"symmetric.hausdorff", "a_to_b.signed.inside.max",
                                      "a_to_b.signed.outside.max"};
enum { LIMITED = sizeof limited / sizeof *limited };

static double limit_at(const qm_report_limits *limits, int i)
{
    return i == 0 ? limits->distance : i == 1 ? limits->inside : limits->outside;
}

static qm_report_verdict judge_interval(double lower, double upper, double limit)
{
    return isnan(limit)     ? QM_REPORT_NO_LIMIT
           : upper <= limit ? QM_REPORT_WITHIN
           : lower > limit  ? QM_REPORT_BEYOND
                            : QM_REPORT_UNDECIDED;
}

/** That of one limit. Sides that are not proven decide nothing. */
static qm_report_verdict judge_limit(const qm_json *result, const qm_report_limits *limits, int i)
{
    char lower[48], upper[48];
    snprintf(lower, sizeof lower, "%s.lower", limited[i]);
    snprintf(upper, sizeof upper, "%s.upper", limited[i]);
    bool is_proven = i == 0 || qm_json_is_true(result, "a_to_b.signed.proven");
    return judge_interval(is_proven ? qm_json_get_number(result, lower) : 0.0,
                          is_proven ? qm_json_get_number(result, upper) : INFINITY, limit_at(limits, i));
}

qm_report_verdict qm_report_judge(const qm_json *result, const qm_report_limits *limits)
{
    int count[4] = {0};
    for (int i = 0; i < LIMITED; i++)
        count[judge_limit(result, limits, i)]++;
    return count[QM_REPORT_BEYOND] > 0      ? QM_REPORT_BEYOND
           : count[QM_REPORT_UNDECIDED] > 0 ? QM_REPORT_UNDECIDED
           : count[QM_REPORT_WITHIN] > 0    ? QM_REPORT_WITHIN
                                            : QM_REPORT_NO_LIMIT;
}

/** More digits than the width leaves certain, so that a bound is not rounded across the limit. */
#define VERDICT_SPARE 2

static void add_distance_words(qm_report_writer *w)
{
    double permitted = w->report->limits.distance;
    qm_report_interval greatest = qm_report_find(w, limited[0]);
    char limit[QM_NUMBER_SIZE];
    int side;
    qm_text_number(permitted, limit);
    qm_text_add_string(w->out, "<p>");
    switch (judge_limit(w->result, &w->report->limits, 0)) {
    case QM_REPORT_WITHIN:
        qm_text_printf(w->out,
                       "Every point of A is within %s of B, and every point of B within %s of A: the "
                       "greatest distance is at most ",
                       limit, limit);
        qm_report_add_bound(w->out, greatest, 1, VERDICT_SPARE);
        break;
    case QM_REPORT_BEYOND:
        side = qm_report_find(w, "a_to_b.hausdorff").lower > permitted ? 0 : 1;
        qm_text_printf(w->out, "There is a point of %s whose distance from %s is at least ",
                       qm_report_mesh_names[side], qm_report_mesh_names[1 - side]);
        qm_report_add_bound(w->out, qm_report_find(w, "%s.hausdorff", qm_report_side_names[side]), 0,
                            VERDICT_SPARE);
        break;
    case QM_REPORT_UNDECIDED:
        qm_text_add_string(w->out, "The limit lies inside the interval of the greatest distance, ");
        qm_report_add_interval(w->out, greatest, false, VERDICT_SPARE);
        qm_text_add_string(w->out, ", so neither is proven. A comparison with a smaller gap may decide");
        break;
    case QM_REPORT_NO_LIMIT:
        qm_text_add_string(w->out, "The greatest distance is ");
        qm_report_add_interval(w->out, greatest, false, 0);
        break;
    }
    qm_text_add_string(w->out, ".</p>");
}

static void add_side_words(qm_report_writer *w, int i, const char *where)
{
    double permitted = limit_at(&w->report->limits, i);
    qm_report_interval greatest = qm_report_find(w, "%s", limited[i]);
    char limit[QM_NUMBER_SIZE];
    if (isnan(permitted)) return;
    qm_text_number(permitted, limit);
    switch (judge_limit(w->result, &w->report->limits, i)) {
    case QM_REPORT_WITHIN:
        qm_text_printf(w->out, "<p>No point of A is farther %s B than %s: at most ", where, limit);
        qm_report_add_bound(w->out, greatest, 1, VERDICT_SPARE);
        break;
    case QM_REPORT_BEYOND:
        qm_text_printf(w->out, "<p>There is a point of A that is farther %s B than %s: at least ", where,
                       limit);
        qm_report_add_bound(w->out, greatest, 0, VERDICT_SPARE);
        break;
    default:
        qm_text_printf(w->out, "<p>Whether a point of A is farther %s B than %s is not proven: ", where,
                       limit);
        qm_report_add_interval(w->out, greatest, false, VERDICT_SPARE);
    }
    qm_text_add_string(w->out, ".</p>");
}

static void add_verdict_words(qm_report_writer *w, qm_report_verdict verdict)
{
    static const char *const words[] = {"No limit was given: there is no verdict", "Within the limit",
                                        "Beyond the limit", "Undecided at the limit"};
    const qm_report_limits *limits = &w->report->limits;
    char limit[QM_NUMBER_SIZE];
    bool is_one = isnan(limits->inside) && isnan(limits->outside);
    qm_text_printf(w->out, "<strong>%s", words[verdict]);
    if (verdict != QM_REPORT_NO_LIMIT && is_one)
        qm_text_printf(w->out, " of %s", qm_text_number(limits->distance, limit));
    else if (verdict != QM_REPORT_NO_LIMIT)
        qm_text_add_string(w->out, "s");
    qm_text_add_string(w->out, "</strong>");
    add_distance_words(w);
    add_side_words(w, 1, "inside");
    add_side_words(w, 2, "outside");
}

/** What holds between the surfaces that the meshes stand for, which are as near to them as their uncertainties say. */
static void add_true_words(qm_report_writer *w)
{
    static const char *const words[] = {"", ": within the limit", ": beyond the limit", ": undecided"};
    qm_report_interval greatest = qm_report_find(w, "symmetric.hausdorff.of_true");
    if (!qm_report_has(w, "symmetric.hausdorff.of_true")) return;
    qm_text_add_string(
        w->out, "<p>Between the true surfaces, which may differ from the meshes by their uncertainty, the "
                "greatest distance is ");
    qm_report_add_interval(w->out, greatest, false, VERDICT_SPARE);
    qm_text_printf(w->out, "%s.</p>",
                   words[judge_interval(greatest.lower, greatest.upper, w->report->limits.distance)]);
}

static void add_warnings(qm_report_writer *w)
{
    for (int i = 0; qm_report_has(w, "warnings.%d", i); i++) {
        char path[32];
        snprintf(path, sizeof path, "warnings.%d", i);
        qm_text_add_string(w->out, "<p>Warning: ");
        const char *warning = qm_json_get_string(w->result, path);
        qm_report_add_escaped(w->out, warning ? warning : "");
        qm_text_add_string(w->out, ".</p>");
    }
}

static void add_verdict(qm_report_writer *w)
{
    static const char *const classes[] = {"unlimited", "within", "beyond", "undecided"};
    qm_report_verdict verdict = qm_report_judge(w->result, &w->report->limits);
    qm_text_printf(
        w->out, "<section class=\"verdict %s\" aria-labelledby=\"verdict\"><h2 id=\"verdict\">Verdict</h2>",
        classes[verdict]);
    add_verdict_words(w, verdict);
    add_true_words(w);
    add_warnings(w);
    qm_text_add_string(
        w->out,
        "<p class=\"soft\">Intervals are proven: the true value lies in them. Nothing was sampled.</p>");
    if (!qm_json_is_true(w->result, "accurate"))
        qm_text_add_string(
            w->out, "<p>The search stopped before the accuracy that was asked for: intervals are wider, "
                    "and hold.</p>");
    qm_text_add_string(w->out, "</section>\n");
}

/* ---- the figures ---- */

/** A row of the table of figures. */
typedef struct figure_row {
    const char *label, *of_side, *of_both; /* paths; NULL: the figure does not exist there */
    bool is_share;
} figure_row;

static void add_cell_at(qm_report_writer *w, const char *side, const char *path, bool is_share)
{
    if (path && qm_report_has(w, "%s.%s", side, path))
        qm_report_add_cell(w, qm_report_find(w, "%s.%s", side, path), is_share);
    else
        qm_text_add_string(w->out, "<td>&ndash;</td>");
}

static void add_figure_row(qm_report_writer *w, const figure_row *row)
{
    qm_text_printf(w->out, "<tr><th scope=\"row\">%s</th>", row->label);
    add_cell_at(w, "a_to_b", row->of_side, row->is_share);
    add_cell_at(w, "b_to_a", row->of_side, row->is_share);
    add_cell_at(w, "symmetric", row->of_both, row->is_share);
    qm_text_add_string(w->out, "</tr>\n");
}

static void add_limit_rows(qm_report_writer *w)
{
    for (int i = 0; qm_report_has(w, "a_to_b.shares.%d", i); i++) {
        char label[64], share[32], score[32];
        snprintf(label, sizeof label, "Share within %.12g; both: F-score",
                 qm_report_number(w, "a_to_b.shares.%d.limit", i));
        snprintf(share, sizeof share, "shares.%d", i);
        snprintf(score, sizeof score, "f_score.%d.f", i);
        add_figure_row(w, &(figure_row){label, share, score, true});
    }
}

/** The figures that are known of the true surfaces, where these are others than the meshes. */
static void add_true_rows(qm_report_writer *w)
{
    static const figure_row rows[] = {
        {"Greatest distance of the true surfaces", "hausdorff.of_true", "hausdorff.of_true", false},
        {"Mean distance of the true surfaces", "mean.of_true", "mean.of_true", false},
        {"Root mean square of the true surfaces", "rms.of_true", "rms.of_true", false}};
    if (!qm_report_has(w, "symmetric.hausdorff.of_true")) return;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        add_figure_row(w, &rows[i]);
}

static void add_percentile_rows(qm_report_writer *w)
{
    for (int i = 0; qm_report_has(w, "a_to_b.percentiles.%d", i); i++) {
        char label[64], path[32];
        snprintf(label, sizeof label, "%.6g&nbsp;%% are within",
                 qm_report_number(w, "a_to_b.percentiles.%d.percent", i));
        snprintf(path, sizeof path, "percentiles.%d", i);
        add_figure_row(w, &(figure_row){label, path, NULL, false});
    }
}

static void add_figures(qm_report_writer *w)
{
    static const figure_row first[] = {{"Greatest distance (Hausdorff)", "hausdorff", "hausdorff", false},
                                       {"95th percentile, the greater of both (HD95)", NULL, "hd95", false},
                                       {"Mean distance", "mean", "mean", false},
                                       {"Root mean square", "rms", "rms", false},
                                       {"Standard deviation", "std", NULL, false},
                                       {"Chamfer L1: means added", NULL, "chamfer.l1", false},
                                       {"Chamfer L1, halved", NULL, "chamfer.l1_half", false},
                                       {"Chamfer L2: mean squares added", NULL, "chamfer.l2", false},
                                       {"Chamfer L2, halved", NULL, "chamfer.l2_half", false},
                                       {"Area, or count, that averages are over", "size", NULL, false}};
    qm_text_add_string(
        w->out,
        "<section aria-labelledby=\"figures\"><h2 id=\"figures\">All figures</h2>\n<table><caption>Intervals "
        "that hold the true values, rounded outward.</caption><thead><tr><th scope=\"col\">Figure</th>"
        "<th scope=\"col\">A from B</th><th scope=\"col\">B from A</th><th "
        "scope=\"col\">Both</th></tr></thead>"
        "<tbody>\n");
    for (size_t i = 0; i < sizeof first / sizeof *first; i++)
        add_figure_row(w, &first[i]);
    add_true_rows(w);
    add_percentile_rows(w);
    add_limit_rows(w);
    qm_text_add_string(w->out, "</tbody></table></section>\n");
}

/* ---- where ---- */

static bool add_direction(qm_report_writer *w, int side)
{
    const char *name = qm_report_mesh_names[side], *other = qm_report_mesh_names[1 - side];
    qm_report_interval greatest = qm_report_find(w, "%s.hausdorff", qm_report_side_names[side]);
    qm_report_interval mean = qm_report_find(w, "%s.mean", qm_report_side_names[side]);
    qm_text_printf(w->out, "<section aria-labelledby=\"from-%s\"><h2 id=\"from-%s\">Distances of %s (",
                   qm_report_side_names[side], qm_report_side_names[side], name);
    add_name(w, side);
    qm_text_printf(w->out, ") from %s</h2>\n<p>The greatest is ", other);
    qm_report_add_interval(w->out, greatest, false, 0);
    qm_text_add_string(w->out, ", the mean ");
    qm_report_add_interval(w->out, mean, false, 0);
    qm_text_add_string(w->out, ".</p>\n");
    qm_report_add_legend(w);
    qm_text_add_string(
        w->out,
        "<p class=\"soft\">All pictures of this report have these colours, and those of one mesh show "
        "lengths alike. A pixel has the distance of the point in its middle; numbers mark the worst "
        "places.</p>\n");
    if (!qm_report_add_six_sides(w, side)) return false;
    qm_report_add_charts(w, side);
    qm_report_add_sides(w, side);
    if (!qm_report_add_places(w, side) || !qm_report_add_regions(w, side)) return false;
    qm_text_add_string(w->out, "</section>\n");
    return true;
}

/* ---- the meshes ---- */

static void add_mesh_text(qm_report_writer *w, const char *label, const char *a, const char *b)
{
    qm_text_printf(w->out, "<tr><th scope=\"row\">%s</th>", label);
    for (int side = 0; side < 2; side++) {
        const char *text = side == 0 ? a : b;
        qm_text_add_string(w->out, "<td>");
        qm_report_add_escaped(w->out, text ? text : "unknown");
        qm_text_add_string(w->out, "</td>");
    }
    qm_text_add_string(w->out, "</tr>\n");
}

static void print_counts(const qm_mesh *mesh, char out[128])
{
    size_t triangles = 0;
    for (size_t i = 0; i < mesh->face_count; i++)
        triangles += mesh->faces[4 * i + 3] == QM_NO_INDEX;
    if (mesh->face_count == 0)
        snprintf(out, 128, "%zu points", mesh->vertex_count);
    else
        snprintf(out, 128, "%zu vertices, %zu triangles, %zu quads", mesh->vertex_count, triangles,
                 mesh->face_count - triangles);
}

static void print_box(const qm_box *box, char out[256])
{
    snprintf(out, 256, "%.6g × %.6g × %.6g, middle (%.6g, %.6g, %.6g)", box->max[0] - box->min[0],
             box->max[1] - box->min[1], box->max[2] - box->min[2], 0.5 * box->min[0] + 0.5 * box->max[0],
             0.5 * box->min[1] + 0.5 * box->max[1], 0.5 * box->min[2] + 0.5 * box->max[2]);
}

/** The matrix that has moved a mesh, row by row. */
static void add_transforms(qm_report_writer *w)
{
    const qm_report_mesh *mesh = w->report->mesh;
    if (!mesh[0].transform && !mesh[1].transform) return;
    qm_text_add_string(w->out, "<tr><th scope=\"row\">Moved by</th>");
    for (int side = 0; side < 2; side++) {
        qm_text_add_string(w->out, mesh[side].transform ? "<td>" : "<td>nothing");
        for (int row = 0; mesh[side].transform && row < 4; row++) {
            for (int column = 0; column < 4; column++) {
                char number[QM_NUMBER_SIZE];
                qm_text_printf(w->out, "%s%s", qm_text_number(mesh[side].transform[4 * column + row], number),
                               column < 3 ? " "
                               : row < 3  ? "; "
                                          : "");
            }
        }
        qm_text_add_string(w->out, "</td>");
    }
    qm_text_add_string(w->out, "</tr>\n");
}

static void add_meshes(qm_report_writer *w)
{
    char counts[2][128], boxes[2][256], moves[2][64], doubts[2][QM_NUMBER_SIZE];
    const qm_report_mesh *mesh = w->report->mesh;
    for (int side = 0; side < 2; side++) {
        const qm_loaded_mesh *loaded = mesh[side].loaded;
        print_counts(&loaded->mesh, counts[side]);
        print_box(&loaded->box, boxes[side]);
        snprintf(moves[side], sizeof moves[side],
                 loaded->revision > 0 ? "moved since: revision %llu" : "as in the file",
                 (unsigned long long)loaded->revision);
    }
    qm_text_add_string(
        w->out,
        "<section aria-labelledby=\"meshes\"><h2 id=\"meshes\">The meshes</h2>\n<table><thead><tr>"
        "<th scope=\"col\">Of the mesh</th><th scope=\"col\">A</th><th scope=\"col\">B</th></tr></thead>"
        "<tbody>\n<tr><th scope=\"row\">File</th><td>");
    add_name(w, 0);
    qm_text_add_string(w->out, "</td><td>");
    add_name(w, 1);
    qm_text_add_string(w->out, "</td></tr>\n");
    add_mesh_text(w, "SHA-256 of the file", mesh[0].hash, mesh[1].hash);
    add_mesh_text(w, "Unit", mesh[0].notes.unit[0] ? mesh[0].notes.unit : NULL,
                  mesh[1].notes.unit[0] ? mesh[1].notes.unit : NULL);
    add_mesh_text(w, "Uncertainty: the true surface is within",
                  qm_text_number(mesh[0].notes.uncertainty, doubts[0]),
                  qm_text_number(mesh[1].notes.uncertainty, doubts[1]));
    add_mesh_text(w, "Format", qm_format_name(mesh[0].loaded->format),
                  qm_format_name(mesh[1].loaded->format));
    add_mesh_text(w, "Vertices", moves[0], moves[1]);
    add_mesh_text(w, "Counts", counts[0], counts[1]);
    add_mesh_text(w, "Box", boxes[0], boxes[1]);
    add_transforms(w);
    add_mesh_text(w, "Quads are read as",
                  w->quads == QM_QUADS_BILINEAR ? "bilinear patches" : "two triangles",
                  w->quads == QM_QUADS_BILINEAR ? "bilinear patches" : "two triangles");
    qm_text_add_string(w->out, "</tbody></table></section>\n");
}

/* ---- how it was made ---- */

static void add_making(qm_report_writer *w)
{
    qm_text_add_string(
        w->out, "<section aria-labelledby=\"making\"><h2 id=\"making\">How this report was made</h2>\n");
    if (w->report->command) {
        qm_text_add_string(w->out, "<h3>Command line</h3><pre>");
        qm_report_add_escaped(w->out, w->report->command);
        qm_text_add_string(w->out, "</pre>\n");
    }
    qm_text_add_string(w->out, "<h3>Request of the comparison</h3><pre>");
    qm_report_add_escaped(w->out, w->report->request);
    qm_text_printf(w->out, "</pre>\n<p class=\"soft\">quadmeshd %s, kernel %s, ", QM_VERSION,
                   qm_kernel_name());
    qm_report_add_escaped(w->out, w->report->made);
    qm_text_add_string(w->out, " (UTC). Accuracy of the averages ");
    qm_report_add_number(w->out, qm_report_number(w, "accuracy"));
    qm_text_add_string(w->out, ", gap of the greatest distance ");
    qm_report_add_number(w->out, qm_report_number(w, "gap"));
    qm_text_add_string(w->out, ". Two meshes that are the same give 0 for all distances.</p></section>\n");
}

/* ---- the document ---- */

static void open_document(qm_report_writer *w)
{
    static const char *const words[] = {"", ": within the limit", ": beyond the limit", ": undecided"};
    qm_text_add_string(w->out,
                       "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
                       "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>");
    add_title_name(w, 0);
    qm_text_add_string(w->out, " against ");
    add_title_name(w, 1);
    qm_text_printf(w->out, "%s</title>\n<style>\n%s</style></head>\n<body><header><h1>",
                   words[qm_report_judge(w->result, &w->report->limits)], qm_report_style);
    add_name(w, 0);
    qm_text_add_string(w->out, " (A) against ");
    add_name(w, 1);
    qm_text_add_string(w->out, " (B)</h1>\n<p class=\"soft\">Comparison of two meshes, ");
    qm_report_add_escaped(w->out, w->report->made);
    qm_text_printf(w->out, ". Distances are in %s.</p></header>\n<main>\n",
                   qm_report_unit(w)[0] ? qm_report_unit(w) : "the unit of the files, which is not known");
}

static bool write_document(qm_report_writer *w)
{
    open_document(w);
    add_verdict(w);
    if (!add_direction(w, 0) || !add_direction(w, 1)) return false;
    add_figures(w);
    add_meshes(w);
    add_making(w);
    qm_text_add_string(w->out, "</main></body></html>\n");
    if (!w->out->failed) return true;
    *w->problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the report");
    return false;
}

bool qm_report_write(qm_context *ctx, const qm_report *report, qm_text *out, qm_problem *problem)
{
    qm_report_writer w = {.ctx = ctx,
                          .report = report,
                          .out = out,
                          .problem = problem,
                          .result = qm_json_parse(report->result)};
    if (!w.result) {
        *problem =
            qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the result of the comparison");
        return false;
    }
    const char *quads = qm_json_get_string(w.result, "quads");
    w.quads = quads && strcmp(quads, "bilinear") == 0 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
    w.scale = qm_scale_make(report->limits.distance, report->range,
                            qm_report_find(&w, "symmetric.hausdorff").upper);
    bool good = write_document(&w);
    qm_json_free(w.result);
    return good;
}

_Static_assert(QM_REPORT_MAX_LIMITS == QM_SCALE_BANDS, "a limit for each band");

int qm_report_scale_limits(double limit, double range, double *out)
{
    if (!(limit > 0.0 || range > 0.0)) return 0;
    const qm_scale scale = qm_scale_make(limit, range, 0.0);
    for (int i = 0; i < QM_SCALE_BANDS; i++)
        out[i] = scale.edge[i + 1];
    return QM_SCALE_BANDS;
}
