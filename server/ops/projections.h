/**
 * projections.h: projects batches of points onto a surface, and writes the results as records. Shared by the jobs, the
 * streaming projection and the command line.
 */
#ifndef QM_PROJECTIONS_H
#define QM_PROJECTIONS_H

#include "base/text.h"
#include "mesh_load.h"
#include "qm/project.h"

/** The nearest points, an entry for each point; arrays on the allocator of the context that found them. */
typedef struct qm_projections {
    size_t count;
    double *distance, *position, *uv; /* 1, 3, 2 numbers a point */
    uint32_t *face;                   /* index in the input file; of a point set that of the point */
    uint32_t *patch; /* that contains the face; NULL if the mesh was loaded without patches */
} qm_projections;

/**
 * Projects count points with a locator of the mesh; *out is the caller's, for qm_projections_reset in the same context.
 * Returns the status of qm_project_points_with; after an error *out is all zero.
 */
qm_status qm_projections_find(qm_context *ctx, const qm_loaded_mesh *mesh, const qm_locator *locator,
                              qm_quad_reading quads, const double *points, size_t count, int threads,
                              qm_projections *out);
void qm_projections_reset(qm_context *ctx, qm_projections *projections);

/** The index of the first of count numbers that is not finite, or count. */
size_t qm_projections_find_invalid(const double *numbers, size_t count);

/** Converts count little-endian floats at the start of the array to doubles, in place. */
void qm_projections_widen(double *numbers, size_t count);

/** Points that are projected and written before the next ones, which bounds memory. */
#define QM_PROJECTIONS_BLOCK 65536

/** Bytes of a record in QM_ARRAY_BINARY. */
#define QM_PROJECTIONS_RECORD_SIZE (7 * sizeof(double))

/** Write the text before the first block and after the last one. A record is distance, x, y, z, face, u, v; JSON is one
 * document with an array "points". */
void qm_projections_write_begin(qm_text *out, qm_array_format format);
void qm_projections_write_end(qm_text *out, qm_array_format format);

/** Writes the records of a block. diagonal is that of the mesh; is_first is for the comma between blocks of JSON. */
void qm_projections_write(qm_text *out, qm_array_format format, const qm_projections *projections,
                          double diagonal, bool is_first);

#endif
