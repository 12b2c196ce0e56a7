/**
 * bilinear_pair.h: distance and contact of faces read as bilinear patches (triangles stay what they are),
 * certified by cutting them up.
 *
 * A part of a patch lies within its flatness bound, twist (bilinear.h), of its two triangles. So the distance
 * of two parts differs from that of their triangles by at most the sum of both twists, and a twist falls to a
 * quarter when its part is cut in quarters.
 *
 * Coordinates are at most QM_FACE_EXTENT by magnitude in the unit of the calls; all else is relative to 1.
 */
#ifndef QM_BILINEAR_PAIR_H
#define QM_BILINEAR_PAIR_H

#include "core/vec.h"

#define QM_FACE_EXTENT 8.0

/** A face: three or four corners, and for faces of one mesh the indices of their vertices. */
typedef struct qm_face_shape {
    qm_vec corner[4];
    uint32_t vertex[4];
    int count;
} qm_face_shape;

/** Bounds of a distance: lower <= d <= upper = |point[0] - point[1]|, each point at uv of its face. */
typedef struct qm_bilinear_gap {
    double lower, upper;
    double uv[2][2];
    qm_vec point[2];
} qm_bilinear_gap;

/**
 * Narrows the distance of two faces until upper - lower <= error, or lower >= stop_above. error is at least
 * 1e-13. When the faces are so twisted that this would take too long, the bounds stay wider; they hold.
 */
qm_bilinear_gap qm_bilinear_pair_distance(const qm_face_shape *a, const qm_face_shape *b, double error,
                                          double stop_above);

/** False when the faces are proven not to meet; otherwise true: they come within the tolerance. */
bool qm_bilinear_pair_meet(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                           qm_bilinear_gap *gap);

/** As qm_bilinear_pair_meet for faces of one mesh that share corners: true when they meet farther than the
 * tolerance from the corners and edges that they share. */
bool qm_bilinear_pair_cross(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                            qm_bilinear_gap *gap);

#endif
