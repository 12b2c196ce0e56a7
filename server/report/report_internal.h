/**
 * report_internal.h: what the files of a report share: text, figures, charts and pictures.
 */
#ifndef QM_REPORT_INTERNAL_H
#define QM_REPORT_INTERNAL_H

#include "base/json.h"
#include "heat.h"
#include "report.h"

/** A report that is being written. */
typedef struct qm_report_writer {
    qm_context *ctx;
    const qm_report *report;
    qm_text *out;
    qm_json *result;
    qm_scale scale;
    qm_quad_reading quads;
    qm_problem *problem;
    int figure_count; /* pictures and charts have ids */
} qm_report_writer;

/** An interval of the result; NAN where it has none. */
typedef struct qm_report_interval {
    double lower, upper;
} qm_report_interval;

/** The object of that path in the result, and whether it has one. */
qm_report_interval qm_report_find(const qm_report_writer *w, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
bool qm_report_has(const qm_report_writer *w, const char *format, ...) __attribute__((format(printf, 2, 3)));
double qm_report_number(const qm_report_writer *w, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/** "a_to_b" and "b_to_a". */
extern const char *const qm_report_side_names[2];
/** "A" and "B". */
extern const char *const qm_report_mesh_names[2];

/** The unit of both meshes; "" when it is not known. */
const char *qm_report_unit(const qm_report_writer *w);

/** A cell of a table: the interval as printed, and all of its digits as data. */
void qm_report_add_cell(qm_report_writer *w, qm_report_interval interval, bool is_share);

/* ---- report_text.c ---- */

/** Text of a document or of an attribute; what is not UTF-8 or a control character becomes U+FFFD. */
void qm_report_add_escaped(qm_text *out, const char *text);

/** A number in the shortest decimals that read back to it, to 6 digits at most. */
void qm_report_add_number(qm_text *out, double number);

/**
 * "0.1234 to 0.1236": rounded outward to digits that the width leaves certain, a percentage of a share if asked. One number
 * where both are equal. `spare` more digits are printed.
 */
void qm_report_add_interval(qm_text *out, qm_report_interval interval, bool is_share, int spare);

/** A coordinate, to a millionth of a length. */
void qm_report_add_coordinate(qm_text *out, double number, double length);

/** A share in percent, in as many of its first digits as are certain, for small print. */
void qm_report_add_percent(qm_text *out, qm_report_interval share);

/** The bound alone that the interval has below (side 0) or above (1). */
void qm_report_add_bound(qm_text *out, qm_report_interval interval, int side, int spare);

/* ---- report_chart.c ---- */

/** The legend of the scale. */
void qm_report_add_legend(qm_report_writer *w);

/** How the distances of a direction spread: the share in each band of the limits, and the share within each distance. */
void qm_report_add_charts(qm_report_writer *w, int side);

/* ---- report_picture.c ---- */

/** The pictures of a mesh from six sides, with its worst places. False with a problem. */
bool qm_report_add_six_sides(qm_report_writer *w, int side);

/** A cell of a table: the face and the point at an end ("from" or "to") of the witness of that path. */
void qm_report_add_point(qm_report_writer *w, const char *place, const char *end);

/** The table of the worst places, with a picture of each of the first ones. False with a problem. */
bool qm_report_add_places(qm_report_writer *w, int side);

/** The table of the parts of a mesh that are beyond the limit, with a picture of each of the first ones; nothing where they
 * were not asked for. False with a problem. */
bool qm_report_add_regions(qm_report_writer *w, int side);

/* ---- report_sides.c ---- */

/** The signed figures and bands of a mesh, or why it has none; nothing where no sign was asked for. */
void qm_report_add_sides(qm_report_writer *w, int side);

/* ---- report_style.c ---- */

extern const char qm_report_style[];

#endif
