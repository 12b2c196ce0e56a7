/**
 * rounding.h: the rounding budget of a distance, shared by the searches that report bounds.
 *
 * Let u = 2^-53, S the largest local coordinate of either surface by magnitude (so that every point of either
 * has a norm of at most R = sqrt(3) S), and eta = QM_ETA_ROUNDINGS u S. A search that compares computed
 * distances of computed points reports bounds that hold for the exact surfaces once it opens them by eta.
 * The terms, each at its worst, in units of u R:
 *
 *   2    Vertices. local = (world - origin) * scale rounds each coordinate once; the scale is a power of two.
 *        Both surfaces move by at most u R, and with them every distance (it is 1-Lipschitz in either).
 *
 * Distance from a point p to a triangle in its frame (bvh_tree.h). d = p - origin, |d| <= 2 R; the longest
 * edge and the distance are at most 2 R, too.
 *   12.4 d is rounded once (1 u |d|), each of its three coordinates in the frame is a sum of three products
 *        (3 u |d|, together sqrt(3) * 3 u |d|).
 *   28   The rows X, Y, Z are orthonormal to 14 u: X is divided by a length that is off by 2.5 u, Y is made
 *        perpendicular twice, Z is their cross product. A map this near to a rotation changes a distance by
 *        a factor of at most 1 + 14 u.
 *   72   The corners (0, 0), (L, 0), (CX, CY) stand for the true ones as the rows map them. The end of the
 *        longest edge is off by 7 u L. The third corner is off by 14 u L where its height h is above 2^-50 L:
 *        the direction of Y is off by 8 u L / h, and acts on the height alone. Below that any perpendicular
 *        will do: the height is then at most 16 u L with its rounding, computed as 20 u L at most.
 *   30   In the plane: the parameter on an edge is off by 7 u |d| / length, the remainder of the segment's
 *        distance by 4 u |d|. A point is classified as inside wrongly only if the two products of an edge's
 *        test cancel, hence within 4 u |d| of the edge itself: the longest edge is the base, so the angles at
 *        it are acute.
 *
 *   2    A quarter of |w|, by which the patch of a quad may leave its triangles: w is a sum of four corners.
 *
 * Distance from a point to a bilinear patch: 34 in all, less than the triangle's 142 (w is off by 8 u R and
 * used with weights of at most 1).
 *
 *   147  together. 256 u S = 147.8 u R.
 *
 * Cuts. A search cuts faces into parts at computed points. Mapping the exact parts to the computed ones,
 * linearly on each, moves no point farther than the rounding moved the nearest cut point: so each cut from
 * the face down to a part adds its own rounding, and nothing else. qm_vec_mix is off by at most 2.5 u R =
 * 4.34 u S: (1 - t) by u / 2, both products and the sum by half an ulp each. QM_FREE_CUTS such cuts fit into
 * the other half of eta; a part with more of them lies within QM_CUT_ROUNDINGS u S a cut of its face, and is
 * bounded with a slack of that (hausdorff_piece.c).
 */
#ifndef QM_ROUNDING_H
#define QM_ROUNDING_H

#define QM_UNIT_ROUNDING 0x1p-53
#define QM_POINT_ROUNDINGS 256.0 /* u S: the distance of a point from a surface, without cuts */
#define QM_ETA_ROUNDINGS 512.0
#define QM_CUT_ROUNDINGS 4.34
#define QM_FREE_CUTS 58

#endif
