/**
 * nearest_face.h: the face that a projection tells: one rule for every accelerator, instruction set, order of
 * the points and number of threads.
 *
 * Faces that are equally near seldom have the same computed distance, and which rounding is the least means
 * nothing. So the answer is the lowest index among the faces whose computed distance is at most the least one
 * plus tau. The computed distance of a face is that of the same operations whatever else was looked at, so
 * the rule gives one face. tau is more than three times what computed distances of equally near faces are
 * found to differ by, so that these tie. The distance told is the least.
 *
 * Error of a computed distance. Let u = 2^-53; lengths are local, so coordinates of the mesh are at most 1.
 * With s = 1 + the greatest coordinate of p no difference of coordinates exceeds s, and so |p - o| <= sqrt(3)
 * s for any point o of the mesh; edges are at most 2 sqrt(3) long. To a triangle (tri_point.h), in u s:
 *   - local coordinates, one rounding each, of p and of the mesh: sqrt(3) < 2;
 *   - the triangle that the frame stands for: its corners are off by 17 u lengths of the longest edge. Of the
 *     third corner: along x 3 for the product and 9 for x x, whose factors are of length 1 to 4.5 u; along y
 *     the same; across the plane 5 for what is left of the corner when its part along x is taken off,
 * whatever the height. sqrt(12^2 + 12^2 + 5^2) < 18, less the height's share: 17 * 2 sqrt(3) < 59;
 *   - p - o and its three coordinates in the frame, 1 + 3 sqrt(3), and the frame, which is orthonormal to 28
 * u in the sum of a row, half of which acts on a length: (6.2 + 14) sqrt(3) < 36;
 *   - in the plane a point of an edge is off by 7 along it, the way to it by 3, both times sqrt(3): < 18. A
 *     point taken to be inside wrongly is nearer to an edge than that;
 *   - squares, sum and root, 2.5 of the distance: 2.5 sqrt(3) < 5.
 * Together less than 120 u s: QM_DISTANCE_ROUNDING = 128 u. Tests find 9 u s at most.
 *
 * To a patch: the certified error asked for, 128 u and 32 u |p| (less could not be certified of a rounded
 * distance), and the roundings of |p - Q(uv)|. Corners and p are off by 2 s, e1 and e2 by one rounding and w
 * by three of 2 sqrt(3), the six sums and products of Q - p by 6 (sqrt(3) s + 2 sqrt(3)) and the length by 5
 * s: less than 70 u s. A patch that is within a quarter of the certified error of its triangles is as far as
 * the nearer of these and that much more.
 *
 * So a distance told exceeds the true one by at most tau and one error, and s is at most 2 + the distance. A
 * local length of 1 is at most four times the longest side L of the surface's box (bvh_refit.c makes a new
 * frame before less than that is used), so in the world's unit that is (32 + 128) u (8 L + D) for triangles,
 * and for patches 3 (512 u L + 32 u (8 L + D)) + (32 + 70) u (8 L + D): what project.h promises.
 */
#ifndef QM_NEAREST_FACE_H
#define QM_NEAREST_FACE_H

#include "kernel.h"
#include "qm/locator.h"

#define QM_DISTANCE_ROUNDING 0x1p-46
#define QM_TIE_ROUNDING 0x1p-48 /* 32 u: of computed distances, which are found to be off by 9 u at most */

static inline double qm_greatest_coordinate(qm_vec p)
{
    return qm_max(fabs(p.x), qm_max(fabs(p.y), fabs(p.z)));
}

/** s times QM_DISTANCE_ROUNDING: by which the distance of a triangle is off at most. */
static inline double qm_distance_rounding(qm_vec p)
{
    return QM_DISTANCE_ROUNDING * (1.0 + qm_greatest_coordinate(p));
}

/** The certified error of patches that are projected on for a face to be told. */
static inline double qm_bilinear_error(qm_vec p)
{
    return QM_BILINEAR_MIN_ERROR + QM_TIE_ROUNDING * qm_greatest_coordinate(p);
}

/** The face for p, local, and the lane that is nearest of it. *hint is a pack to start from, and becomes the
 * one that was found. */
qm_tie qm_nearest_face(const qm_kernel *kernel, const qm_locator *locator, qm_quad_reading reading, qm_vec p,
                       uint32_t *hint);

#endif
