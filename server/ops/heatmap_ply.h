/**
 * heatmap_ply.h: a heat map as binary PLY: corners of their own for each triangle, with the distance as the property
 * "quality", then the faces, each with its source and its error. Written from rows of QM_HEATMAP_COLUMNS numbers, as many at a time
 * as the caller likes: first all corners, then all faces.
 */
#ifndef QM_HEATMAP_PLY_H
#define QM_HEATMAP_PLY_H

#include "base/text.h"

/** Everything before the corners; error: the greatest of all. */
void qm_heatmap_ply_begin(qm_text *out, uint64_t count, double error);

/** The corners of so many rows. */
void qm_heatmap_ply_add_corners(qm_text *out, const double *row, size_t count);

/** The faces of so many rows, of which the first one is that with this index. */
void qm_heatmap_ply_add_faces(qm_text *out, const double *row, uint64_t first, size_t count);

#endif
