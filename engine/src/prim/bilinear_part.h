/**
 * bilinear_part.h: parts of faces that are cut in quarters: corners, twist, parameters, and what they share
 * with parts of a neighbouring face.
 */
#ifndef QM_BILINEAR_PART_H
#define QM_BILINEAR_PART_H

#include "bilinear_pair.h"

/**
 * More than all rounding does to the distance of two parts, with coordinates up to QM_FACE_REACH = 8: 8192 u
 * with u = 2^-53. That of two triangles is QM_FACE_REACH times QM_TRI_DISTANCE_ERROR: 2048 u. A cut puts
 * corners at middles, off by 12 u along each axis at most and never beyond the corners they lie between, so
 * by no more than the part's size either: over any number of cuts 12 u * 56 for the first 56 levels and 16 u
 * for all others, sqrt(3) times that for a corner, 1200 u for each of two parts.
 */
#define QM_BILINEAR_PART_ERROR (4.0 * QM_FACE_REACH * 0x1p-45)

typedef struct qm_bilinear_part {
    qm_vec corner[4];
    double uv[4][2];        /* of the corners in the whole face */
    double twist;           /* how far the part is from its two triangles at most */
    int count;              /* 3 or 4 */
    bool is_shared[4];      /* the corner lies on what the face shares with the other */
    bool is_shared_edge[4]; /* so does the edge from this corner to the next */
} qm_bilinear_part;

qm_bilinear_part qm_bilinear_part_make(const qm_face_shape *face);

/** Marks the corners of two faces that are the same vertex, and the edges between two of them. Returns how
 * many corners of a are. */
int qm_bilinear_part_share(const qm_face_shape *a, const qm_face_shape *b, qm_bilinear_part *part_a,
                           qm_bilinear_part *part_b);

/** Quarter i, 0 to 3. */
qm_bilinear_part qm_bilinear_part_quarter(const qm_bilinear_part *part, int i);

/** The longest side of its box. */
double qm_bilinear_part_size(const qm_bilinear_part *part);

/** The parameters in the whole face of a point at local parameters of a part. */
void qm_bilinear_part_uv(const qm_bilinear_part *part, const double local[2], double uv[2]);

/** The point of a whole face at its parameters. */
qm_vec qm_bilinear_part_at(const qm_bilinear_part *whole, const double uv[2]);

/** At least the distance of their boxes less rounding, 0 when those meet. */
double qm_bilinear_part_box_distance(const qm_bilinear_part *p, const qm_bilinear_part *q);

/** The distance of the triangles of two parts, 0 when they meet, with local parameters of two such points. */
typedef struct qm_bilinear_part_gap {
    double distance, uv[2][2];
} qm_bilinear_part_gap;
qm_bilinear_part_gap qm_part_distance(const qm_bilinear_part *p, const qm_bilinear_part *q);

/** True when the point is within a distance of what the two faces share. */
bool qm_part_near_shared(const qm_bilinear_part *const whole[2], qm_vec point, double distance);

/** True when a plane through what both parts share has the rest of them strictly on its two sides. */
bool qm_part_parted(const qm_bilinear_part *p, const qm_bilinear_part *q);

#endif
