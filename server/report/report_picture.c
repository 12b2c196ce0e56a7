/**
 * report_picture.c: a mesh from six sides and from near by, in the colours of its distance from the other one.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "report_internal.h"

enum { SIDE_WIDTH = 480, SIDE_HEIGHT = 360, NEAR_WIDTH = 240, NEAR_HEIGHT = 180 };
#define MARKED 20       /* places that have a number in the pictures */
#define NEAR_PICTURES 8 /* places that have a picture of their own */
#define NEAR_SHARE 0.12 /* of the mesh's diagonal that such a picture is wide */

/** A place that is marked in a picture. */
typedef struct report_mark {
    double point[3];
    int number; /* from 1 */
} report_mark;

static bool fail(qm_report_writer *w, qm_png_status status)
{
    *w->problem =
        status == QM_PNG_NO_LIBRARY
            ? qm_problem_make(QM_PROBLEM_UNAVAILABLE, "libspng, which writes pictures, cannot be loaded")
            : qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for a picture");
    return false;
}

static void add_marks(qm_text *out, const qm_heat *heat, const report_mark *marks, int count)
{
    /* The first place is the worst, so it lies on top. */
    for (int i = count - 1; i >= 0; i--) {
        if (!qm_heat_shows(heat, marks[i].point)) continue;
        double at[3];
        qm_raster_project(&heat->raster.view, marks[i].point, at);
        /* The number stands beside its place, towards the middle of the picture. */
        bool is_right = at[0] > 0.75 * heat->raster.view.width;
        qm_text_printf(out,
                       "<circle class=\"mark\" cx=\"%.1f\" cy=\"%.1f\" r=\"3.5\"/>"
                       "<text class=\"number\" x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%d</text>",
                       at[0], at[1], at[0] + (is_right ? -6.0 : 6.0), at[1] - 4.0, is_right ? "end" : "start",
                       marks[i].number);
    }
}

static void list_seen(qm_text *out, const qm_heat *heat, const report_mark *marks, int count)
{
    const char *before = "; seen of the worst places: ";
    for (int i = 0; i < count; i++) {
        if (!qm_heat_shows(heat, marks[i].point)) continue;
        qm_text_printf(out, "%s%d", before, marks[i].number);
        before = ", ";
    }
}

/** Writes a picture that was drawn, with its marks; name says what is seen. */
static bool write_picture(qm_report_writer *w, const qm_heat *heat, const report_mark *marks, int count,
                          const char *name, const char *caption)
{
    const qm_view *view = &heat->raster.view;
    int number = ++w->figure_count;
    qm_text_printf(w->out,
                   "<figure><svg viewBox=\"0 0 %d %d\" role=\"img\" aria-labelledby=\"f%d\"><title "
                   "id=\"f%d\">%s",
                   view->width, view->height, number, number, name);
    list_seen(w->out, heat, marks, count);
    qm_text_printf(w->out, "</title><image width=\"%d\" height=\"%d\" href=\"", view->width, view->height);
    qm_png_status status = qm_heat_write(heat, &w->scale, w->out);
    qm_text_add_string(w->out, "\"/>");
    add_marks(w->out, heat, marks, count);
    qm_text_printf(w->out, "</svg><figcaption>%s</figcaption></figure>\n", caption);
    return status == QM_PNG_OK || fail(w, status);
}

static bool draw(qm_report_writer *w, int side, const qm_view *view, qm_heat *out)
{
    const qm_loaded_mesh *source = w->report->mesh[side].loaded, *target = w->report->mesh[1 - side].loaded;
    qm_status status =
        qm_heat_draw(w->ctx, view, &source->mesh, target->bvh, w->quads, w->report->thread_count, out);
    if (status != QM_OK) *w->problem = qm_problem_from_status(status, w->ctx->message);
    return status == QM_OK;
}

/* ---- places ---- */

static void find_point(const qm_report_writer *w, const char *place, const char *end, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = qm_report_number(w, "%s.%s.point.%d", place, end, k);
}

#define PLACE_SIZE 48

/** The path of a worst place of a direction in the result; the witness of the maximum is the only one where no others were
 * asked for. False when there are no more. */
static bool find_place(const qm_report_writer *w, int side, int i, char out[PLACE_SIZE])
{
    const char *name = qm_report_side_names[side];
    snprintf(out, PLACE_SIZE, "%s.worst.%d", name, i);
    if (i == 0 && !qm_report_has(w, "%s", out)) snprintf(out, PLACE_SIZE, "%s.witness", name);
    return qm_report_has(w, "%s.from", out);
}

static int find_marks(const qm_report_writer *w, int side, report_mark marks[MARKED])
{
    char place[PLACE_SIZE];
    int count = 0;
    for (; count < MARKED && find_place(w, side, count, place); count++) {
        find_point(w, place, "from", marks[count].point);
        marks[count].number = count + 1;
    }
    return count;
}

/* ---- six sides ---- */

/** A side that the mesh is seen from: towards the viewer, and up. */
typedef struct report_side {
    double towards[3], up[3];
    const char *name;
} report_side;

static const report_side sides[6] = {
    {{0, -1, 0}, {0, 0, 1}, "from &minus;y"}, {{1, 0, 0}, {0, 0, 1}, "from +x"},
    {{0, 0, 1}, {0, 1, 0}, "from +z"},        {{0, 1, 0}, {0, 0, 1}, "from +y"},
    {{-1, 0, 0}, {0, 0, 1}, "from &minus;x"}, {{0, 0, -1}, {0, 1, 0}, "from &minus;z"}};

bool qm_report_add_six_sides(qm_report_writer *w, int side)
{
    const qm_loaded_mesh *mesh = w->report->mesh[side].loaded;
    const char *name = qm_report_mesh_names[side];
    report_mark marks[MARKED];
    int count = find_marks(w, side, marks);
    qm_view views[6];
    double scale = INFINITY;
    for (int i = 0; i < 6; i++) {
        views[i] = qm_raster_view(&mesh->box, sides[i].towards, sides[i].up, SIDE_WIDTH, SIDE_HEIGHT);
        scale = fmin(scale, views[i].scale);
    }
    qm_text_add_string(w->out, "<div class=\"sides\">\n");
    bool good = true;
    for (int i = 0; i < 6 && good; i++) {
        char title[96], caption[96];
        qm_heat heat;
        /* Lengths are alike in all of them. */
        views[i].scale = scale;
        snprintf(title, sizeof title, "%s seen %s, in the colours of its distance from %s", name,
                 sides[i].name, qm_report_mesh_names[1 - side]);
        snprintf(caption, sizeof caption, "%s %s", name, sides[i].name);
        good = draw(w, side, &views[i], &heat);
        if (!good) break;
        good = write_picture(w, &heat, marks, count, title, caption);
        qm_heat_reset(w->ctx, &heat);
    }
    qm_text_add_string(w->out, "</div>\n");
    return good;
}

/* ---- near by ---- */

static double length_of(const double v[3])
{
    double greatest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(greatest > 0.0 && isfinite(greatest))) return 0.0;
    return greatest * sqrt(v[0] / greatest * (v[0] / greatest) + v[1] / greatest * (v[1] / greatest) +
                           v[2] / greatest * (v[2] / greatest));
}

/** A view of the surroundings of a place, from the side that it is away from the other mesh, or the opposite one. */
static qm_view look_near(const qm_loaded_mesh *mesh, const double from[3], const double to[3], double sign,
                         double share)
{
    double towards[3], up[3] = {0.0, 0.0, 1.0}, away[3];
    for (int k = 0; k < 3; k++)
        away[k] = from[k] - to[k];
    double length = length_of(away);
    for (int k = 0; k < 3; k++)
        towards[k] = length > 0.0 ? sign * (away[k] / length) : k == 2 ? sign : 0.3;
    if (fabs(towards[2]) > 0.9 * length_of(towards)) {
        up[1] = 1.0;
        up[2] = 0.0;
    }
    qm_view view = qm_raster_view(&mesh->box, towards, up, NEAR_WIDTH, NEAR_HEIGHT);
    memcpy(view.centre, from, sizeof view.centre);
    view.scale = NEAR_WIDTH / share;
    return view;
}

/** A picture of a place, as wide as a share of the mesh's diagonal; what names it, with its number from 1. */
static bool add_near(qm_report_writer *w, int side, int number, const char *place, const char *what,
                     double share)
{
    const qm_loaded_mesh *mesh = w->report->mesh[side].loaded;
    report_mark mark = {.number = number};
    double to[3];
    find_point(w, place, "from", mark.point);
    find_point(w, place, "to", to);
    qm_heat heat;
    qm_view view = look_near(mesh, mark.point, to, 1.0, share);
    if (!draw(w, side, &view, &heat)) return false;
    if (!qm_heat_shows(&heat, mark.point)) {
        /* Something is before it; it may be free on the other side. */
        qm_heat_reset(w->ctx, &heat);
        view = look_near(mesh, mark.point, to, -1.0, share);
        if (!draw(w, side, &view, &heat)) return false;
    }
    char title[96], caption[96];
    snprintf(title, sizeof title, "%s around its %s %d, from near by", qm_report_mesh_names[side], what,
             number);
    snprintf(caption, sizeof caption, "%s: %s %d", qm_report_mesh_names[side], what, number);
    bool good = write_picture(w, &heat, &mark, 1, title, caption);
    qm_heat_reset(w->ctx, &heat);
    return good;
}

void qm_report_add_point(qm_report_writer *w, const char *place, const char *end)
{
    double point[3];
    find_point(w, place, end, point);
    qm_text_printf(w->out, "<td>face %.0f, at ", qm_report_number(w, "%s.%s.face", place, end));
    for (int k = 0; k < 3; k++) {
        qm_text_add_string(w->out, k > 0 ? ", " : "(");
        qm_report_add_coordinate(w->out, point[k], w->report->mesh[0].loaded->diagonal);
    }
    qm_text_add_string(w->out, ")</td>");
}

static void add_place_row(qm_report_writer *w, int side, int i, const char *place)
{
    qm_report_interval distance = qm_report_find(w, "%s", place);
    if (isnan(distance.lower)) distance = qm_report_find(w, "%s.hausdorff", qm_report_side_names[side]);
    qm_text_printf(w->out, "<tr><th scope=\"row\">%d</th>", i + 1);
    qm_report_add_cell(w, distance, false);
    qm_report_add_point(w, place, "from");
    qm_report_add_point(w, place, "to");
    qm_text_add_string(w->out, "</tr>\n");
}

bool qm_report_add_places(qm_report_writer *w, int side)
{
    const char *name = qm_report_mesh_names[side], *other = qm_report_mesh_names[1 - side];
    char place[PLACE_SIZE];
    if (!find_place(w, side, 0, place)) return true;
    qm_text_printf(
        w->out,
        "<h3>Places of %s that are farthest from %s</h3>\n<table><caption>Each is the worst that is not "
        "near those before it. Faces are counted from 0, as in the file.</caption><thead><tr><th "
        "scope=\"col\">Place</th>"
        "<th scope=\"col\">Distance</th><th scope=\"col\">On %s</th><th scope=\"col\">Nearest on "
        "%s</th></tr></thead><tbody>\n",
        name, other, name, other);
    for (int i = 0; find_place(w, side, i, place); i++)
        add_place_row(w, side, i, place);
    qm_text_add_string(w->out, "</tbody></table>\n<div class=\"near\">\n");
    bool good = true;
    for (int i = 0; good && i < NEAR_PICTURES && find_place(w, side, i, place); i++)
        good = add_near(w, side, i + 1, place, "place", NEAR_SHARE);
    qm_text_add_string(w->out, "</div>\n");
    return good;
}

/* ---- regions ---- */

#define LISTED_REGIONS 50

static void add_region_row(qm_report_writer *w, int side, int i)
{
    const char *name = qm_report_side_names[side];
    double middle[3];
    for (int k = 0; k < 3; k++)
        middle[k] = qm_report_number(w, "%s.regions.%d.centroid.%d", name, i, k);
    char path[PLACE_SIZE];
    snprintf(path, sizeof path, "%s.regions.%d.surely", name, i);
    qm_text_printf(w->out, "<tr><th scope=\"row\">%d</th><td>%s</td>", i + 1,
                   qm_json_is_true(w->result, path) ? "yes" : "maybe");
    qm_report_add_cell(w, qm_report_find(w, "%s.regions.%d.max", name, i), false);
    qm_report_add_cell(w, qm_report_find(w, "%s.regions.%d.area", name, i), false);
    qm_text_printf(w->out, "<td>%.0f</td><td>", qm_report_number(w, "%s.regions.%d.face_count", name, i));
    for (int k = 0; k < 3; k++) {
        qm_text_add_string(w->out, k > 0 ? ", " : "(");
        qm_report_add_coordinate(w->out, middle[k], w->report->mesh[0].loaded->diagonal);
    }
    qm_text_add_string(w->out, ")</td></tr>\n");
}

/** How wide the picture of a region is, of the mesh's diagonal: its box, with a margin. */
static double find_width(const qm_report_writer *w, int side, int i)
{
    const char *name = qm_report_side_names[side];
    double size[3];
    for (int k = 0; k < 3; k++)
        size[k] = qm_report_number(w, "%s.regions.%d.box.max.%d", name, i, k) -
                  qm_report_number(w, "%s.regions.%d.box.min.%d", name, i, k);
    double diagonal = w->report->mesh[side].loaded->diagonal;
    double share = diagonal > 0.0 ? 2.0 * length_of(size) / diagonal : 0.0;
    return share > NEAR_SHARE ? fmin(share, 1.5) : NEAR_SHARE;
}

bool qm_report_add_regions(qm_report_writer *w, int side)
{
    const char *name = qm_report_mesh_names[side], *direction = qm_report_side_names[side];
    if (!qm_report_has(w, "%s.region_count", direction)) return true;
    double count = qm_report_number(w, "%s.region_count", direction), limit = w->report->region_limit;
    char number[QM_NUMBER_SIZE];
    const char *beyond = limit == w->report->limits.distance ? "the limit" : qm_text_number(limit, number);
    qm_text_printf(w->out, "<h3>Parts of %s beyond %s</h3>\n", name, beyond);
    if (!(count > 0.0)) {
        qm_text_printf(w->out, "<p>No part of %s is, or may be, beyond %s.</p>\n", name, beyond);
        return true;
    }
    qm_text_printf(
        w->out,
        "<table><caption>%.0f connected parts of %s that are, or may be, beyond %s, the farthest "
        "first%s.</caption><thead><tr><th scope=\"col\">Part</th><th scope=\"col\">Surely beyond</th>"
        "<th scope=\"col\">Greatest distance</th><th scope=\"col\">Area beyond</th>"
        "<th scope=\"col\">Faces</th><th scope=\"col\">Middle</th></tr></thead><tbody>\n",
        count, name, beyond, count > LISTED_REGIONS ? "; the first 50 of them" : "");
    int listed = 0;
    for (; listed < LISTED_REGIONS && qm_report_has(w, "%s.regions.%d", direction, listed); listed++)
        add_region_row(w, side, listed);
    qm_text_add_string(w->out, "</tbody></table>\n<div class=\"near\">\n");
    bool good = true;
    for (int i = 0; good && i < listed && i < NEAR_PICTURES; i++) {
        char place[PLACE_SIZE];
        snprintf(place, sizeof place, "%s.regions.%d.witness", direction, i);
        if (qm_report_has(w, "%s.from", place))
            good = add_near(w, side, i + 1, place, "part", find_width(w, side, i));
    }
    qm_text_add_string(w->out, "</div>\n");
    return good;
}
