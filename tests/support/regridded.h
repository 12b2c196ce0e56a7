/**
 * regridded.h: folded quads: heaps of them, and one surface of them in two grids, which do not match.
 */
#ifndef QM_REGRIDDED_H
#define QM_REGRIDDED_H

#include "random.h"
#include "shapes.h"

/** Every quad in columns x rows parts of its bilinear patch, cut at u[0..columns] and v[0..rows]; a quad of
 * the grid becomes its two triangles where as_triangles says so. */
qm_mesh qm_regridded(const qm_mesh *mesh, int columns, const double *u, int rows, const double *v,
                     bool as_triangles);

/** How the quads of a pair are folded. */
typedef enum qm_fold {
    QM_FOLD_BOW_TIE,  /* a flat quad with two corners swapped */
    QM_FOLD_SWAPPED,  /* a twisted quad with two corners swapped */
    QM_FOLD_AT_EDGE,  /* the last corner near the first side's end: two sides fall together */
    QM_FOLD_REFLEX,   /* a flat quad with one corner inside the triangle of the others */
    QM_FOLD_DIAGONAL, /* both halves nearly on each other */
    QM_FOLD_LINE,     /* four corners nearly in line */
    QM_FOLD_ANY,      /* any four corners */
    QM_FOLD_COUNT
} qm_fold;

typedef enum qm_regridding {
    QM_REGRIDDED_CLOSELY,   /* with noise below 1e-8 */
    QM_REGRIDDED_NOISY,     /* above */
    QM_REGRIDDED_TRIANGLES, /* one of both cut in triangles, without noise */
    QM_REGRIDDING_COUNT
} qm_regridding;

typedef struct qm_regridded_pair {
    qm_mesh a, b; /* for qm_shape_free */
    double noise; /* of each coordinate of b */
} qm_regridded_pair;

/** A soup of quads with corners of their own, each folded in any of these ways: they cross one another. */
qm_mesh qm_folded_heap(qm_random *random, size_t count);

/** One to four such quads in two grids. */
qm_regridded_pair qm_regridded_draw(qm_random *random, qm_fold fold, qm_regridding how);

#endif
