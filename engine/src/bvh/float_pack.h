/**
 * float_pack.h: the triangles of a pack in single precision, about the middle of the pack: a third of the
 * memory of the rows in double, and eight lanes at a time where those take two turns. Most upper bounds of a
 * search are far from deciding anything in their last digits, so they are taken from here, with a margin for
 * every rounding; only what a margin leaves open is looked at in double precision.
 *
 * Margin. Let u = 2^-24, q the point from the middle, R the radius of the pack and rho = |q| + R; all lengths
 * on the way are at most rho.
 *   - The frame that fill makes in floats is orthonormal to a few u, since y is made perpendicular twice; the
 *     triangle that it stands for differs from the true one by at most 10 u rho (corners, edge, tilt: the
 *     tilt by u length / width acts on lengths up to the width only).
 *   - q - origin and its three coordinates in the frame are off by at most 14 u rho together.
 *   - The distance in the plane is one to a point of the triangle or of an edge: parameters on the edges may
 *     be off by 7 u rho, products and sums by another 10 u rho.
 *   - A point taken to lie inside wrongly is within 8 u rho of an edge's line, and, because the longest edge
 *     is the base, within twice that of the triangle.
 *   - A list of lanes moves them to another middle, a line is followed by whole steps of it, and allowed
 *     distances are squared: 5 u rho.
 * Together less than 63 u rho; the margin is 64 u (|qx| + |qy| + |qz| + R), and tests compare it with what
 * double precision says. What underflows is covered by an absolute term.
 */
#ifndef QM_FLOAT_PACK_H
#define QM_FLOAT_PACK_H

#define QM_FLOAT_LANES 8 /* those of a pack */

/** Rows of a float pack: origin and frame as in bvh_tree.h, without what is cheaper to compute anew. */
enum {
    QM_FLOAT_OX,
    QM_FLOAT_OY,
    QM_FLOAT_OZ,
    QM_FLOAT_XX,
    QM_FLOAT_XY,
    QM_FLOAT_XZ,
    QM_FLOAT_YX,
    QM_FLOAT_YY,
    QM_FLOAT_YZ,
    QM_FLOAT_L,
    QM_FLOAT_CX,
    QM_FLOAT_CY,
    QM_FLOAT_ROW_COUNT
};

typedef struct qm_float_pack {
    float row[QM_FLOAT_ROW_COUNT][QM_FLOAT_LANES];
    float middle[3]; /* what positions are relative to, local */
    float radius;    /* of the ball round the middle that holds all corners */
} qm_float_pack;

#endif
