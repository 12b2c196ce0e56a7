/**
 * projections.h: nearest points of a surface for a batch of points, and how they are written as rows. Shared
 * by the jobs, the streaming projection and the command line.
 */
#ifndef QM_PROJECTIONS_H
#define QM_PROJECTIONS_H

#include "base/rows.h"
#include "mesh_load.h"
#include "qm/project.h"

/** A row for each point; arrays on the allocator of the context that found them. */
typedef struct qm_projections {
    size_t count;
    double *distance, *position, *uv; /* rows of 1, 3, 2 */
    uint32_t *face;  /* in the numbering of the input file; for a point set the place of the point */
    uint32_t *patch; /* that holds the face; NULL for a mesh without patches at hand */
} qm_projections;

/**
 * Finds the feet of count points with a locator of the mesh; *out is the caller's, for qm_projections_reset
 * in the same context. Returns what qm_project_points_with returns; after an error *out is all zero.
 */
qm_status qm_projections_find(qm_context *ctx, const qm_loaded_mesh *mesh, const qm_locator *locator,
                              qm_quad_reading quads, const double *points, size_t count, int threads,
                              qm_projections *out);
void qm_projections_reset(qm_context *ctx, qm_projections *feet);

/** The place of the first of count numbers that is not finite, or count. */
size_t qm_projections_find_bad(const double *numbers, size_t count);

/** Little-endian floats at the start of the array to doubles of this machine, in place. */
void qm_projections_widen(double *numbers, size_t count);

/** Points that are projected together and written before the next ones are: what bounds memory. */
#define QM_PROJECTIONS_BLOCK 65536

/** Bytes of a row in QM_ROWS_BINARY. */
#define QM_PROJECTIONS_ROW_SIZE (7 * sizeof(double))

/** What stands before the first block and after the last one. A row has distance, x, y, z, face, u, v; JSON
 * is one document with an array "points". */
void qm_projections_write_begin(qm_text *out, qm_rows rows);
void qm_projections_write_end(qm_text *out, qm_rows rows);

/** Writes the rows of a block. diagonal is that of the mesh; is_first tells JSON whether a comma is due. */
void qm_projections_write(qm_text *out, qm_rows rows, const qm_projections *feet, double diagonal,
                          bool is_first);

#endif
