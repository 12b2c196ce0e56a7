/**
 * sheet.h: the bytes of a fuzzer's input as a grid of quads over a surface by formula, open, closed or one-sided, and as what
 * is then broken of it.
 */
#ifndef QM_SHEET_H
#define QM_SHEET_H

#include "soup.h"

#define QM_SHEET_SIDE 10 /* faces along a side at most */
#define QM_SHEET_VERTICES ((QM_SHEET_SIDE + 1) * (QM_SHEET_SIDE + 1))
#define QM_SHEET_FACES (QM_SHEET_SIDE * QM_SHEET_SIDE)

typedef enum qm_sheet_shape {
    QM_SHEET_PLANE,
    QM_SHEET_SADDLE,
    QM_SHEET_TORUS,
    QM_SHEET_MOEBIUS, /* its end joins its start upside down */
    QM_SHEET_KLEIN,   /* so does this one's; a tube that passes through itself */
    QM_SHEET_SPINDLE, /* a sphere whose poles are rows of equal points */
    QM_SHEET_FOLDED,  /* a plane that lies on itself */
    QM_SHEET_POINT,   /* all points are equal */
    QM_SHEET_SHAPE_COUNT
} qm_sheet_shape;

/** A grid of parameters: ends that are joined, and how. */
typedef struct qm_sheet_grid {
    qm_sheet_shape shape;
    double scale;
    int columns, rows;
    bool wrap_u, wrap_v, is_turned; /* turned: the end of u joins its start with v reversed */
} qm_sheet_grid;

/** A mesh whose arrays are its own. */
typedef struct qm_sheet {
    qm_sheet_grid grid;
    double positions[3 * QM_SHEET_VERTICES];
    uint32_t faces[4 * QM_SHEET_FACES];
    qm_mesh mesh; /* over the arrays */
} qm_sheet;

/** A number from 0 to 1. */
double qm_bytes_take_share(qm_bytes *bytes);

/** A coordinate that means harm: enormous, tiny, no number, or any double. */
double qm_bytes_take_harm(qm_bytes *bytes);

/** The point of the surface at u, v from 0 to 1. */
void qm_sheet_at(const qm_sheet_grid *grid, double u, double v, double out[3]);

/** Number of the grid's point in column i from 0 to columns and row j from 0 to rows; joined ones have the same. */
uint32_t qm_sheet_number(const qm_sheet_grid *grid, int i, int j);
size_t qm_sheet_count(const qm_sheet_grid *grid);

/** Reads a shape and a scale, and divides it into up to `most` columns and rows. */
qm_sheet_grid qm_sheet_read_grid(qm_bytes *bytes, int most);

/** The mesh of a grid. */
void qm_sheet_make(const qm_sheet_grid *grid, qm_sheet *out);

/** Breaks some of a mesh: faces are lost, turned over, repeated or cut, vertices are merged or moved. */
void qm_sheet_break(qm_sheet *sheet, qm_bytes *bytes);

#endif
