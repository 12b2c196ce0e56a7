/**
 * nearest.h: nearest points of a surface by whichever accelerator a locator stands for, the nearest face by a
 * rule that does not depend on it, and the nearest points of a point set.
 */
#ifndef QM_NEAREST_H
#define QM_NEAREST_H

#include "kernel.h"
#include "qm/locator.h"

/* ---- the searches of a locator; kernel_table.inc says what each promises ---- */

static inline void qm_nearest_triangle(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                       qm_hit *hit)
{
    QM_ASSERT(hit->pack < locator->bvh->pack_count);
    if (locator->grid)
        kernel->grid_closest(locator->grid, p, hit);
    else if (locator->tetra)
        kernel->tetra_closest(locator->tetra, p, hit);
    else
        kernel->closest(locator->bvh, p, hit);
}

static inline void qm_nearest_patch(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                    uint32_t start, double error, qm_bilinear_hit *hit)
{
    QM_ASSERT(start < locator->bvh->pack_count);
    if (locator->grid)
        kernel->grid_closest_patch(locator->grid, p, start, error, hit);
    else if (locator->tetra)
        kernel->tetra_closest_patch(locator->tetra, p, start, error, hit);
    else
        kernel->closest_patch(locator->bvh, p, start, error, hit);
}

static inline void qm_nearest_ties(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                   uint32_t start, qm_ties *ties)
{
    QM_ASSERT(start < locator->bvh->pack_count);
    if (locator->grid)
        kernel->grid_closest_ties(locator->grid, p, start, ties);
    else if (locator->tetra)
        kernel->tetra_closest_ties(locator->tetra, p, start, ties);
    else
        kernel->closest_ties(locator->bvh, p, start, ties);
}

/* ---- the nearest face ---- */

/**
 * The face that a projection reports: one rule for every accelerator, instruction set, order of the points
 * and number of threads.
 *
 * Faces that are equally near seldom have the same computed distance, and which rounding is smallest means
 * nothing. So the result is the lowest index among the faces whose computed distance is at most the min plus
 * tau. The computed distance of a face comes from the same operations whatever else was visited, so the rule
 * gives one face. tau is more than three times the largest difference found between computed distances of
 * equally near faces, so that these tie. The distance reported is the min.
 *
 * Error of a computed distance. Let u = 2^-53; lengths are local, so coordinates of the mesh are at most 1.
 * With s = 1 + the max coordinate of p no difference of coordinates exceeds s, and so |p - o| <= sqrt(3) s
 * for any point o of the mesh; edges are at most 2 sqrt(3) long. To a triangle (prim/triangle.h), in u s:
 *   - local coordinates, one rounding each, of p and of the mesh: sqrt(3) < 2;
 *   - the triangle that the frame stands for: its corners are off by 17 u lengths of the longest edge. Of the
 *     third corner: along x 3 for the product and 9 for x x, whose factors are of length 1 to 4.5 u; along y
 *     the same; across the plane 5 for the remainder of the corner when its part along x is subtracted,
 *     whatever the height. sqrt(12^2 + 12^2 + 5^2) < 18, less the height's share: 17 * 2 sqrt(3) < 59;
 *   - p - o and its three coordinates in the frame, 1 + 3 sqrt(3), and the frame, which is orthonormal to 28
 *     u in the sum of a row, half of which acts on a length: (6.2 + 14) sqrt(3) < 36;
 *   - in the plane a point of an edge is off by 7 along it, the vector to it by 3, both times sqrt(3): < 18.
 *     A point wrongly classified as inside is nearer to an edge than that;
 *   - squares, sum and root, 2.5 of the distance: 2.5 sqrt(3) < 5. Together less than 120 u s:
 *     QM_DISTANCE_ROUNDING = 128 u. Tests find 9 u s at most.
 *
 * To a patch: the requested certified error, 128 u and 32 u |p| (less could not be certified of a rounded
 * distance), and the roundings of |p - Q(uv)|. Corners and p are off by 2 s, e1 and e2 by one rounding and w
 * by three of 2 sqrt(3), the six sums and products of Q - p by 6 (sqrt(3) s + 2 sqrt(3)) and the length by 5
 * s: less than 70 u s. A patch within a quarter of the certified error of its triangles is as far as the
 * nearer of these and that much more.
 *
 * So a reported distance exceeds the true one by at most tau and one error, and s is at most 2 + the
 * distance. A local length of 1 is at most four times the longest side L of the surface's box (qm_bvh_refit
 * makes a new local space before less than that is used), so in world units that is (32 + 128) u (8 L + D)
 * for triangles, and for patches 3 (512 u L + 32 u (8 L + D)) + (32 + 70) u (8 L + D): what qm/project.h
 * promises.
 */
#define QM_DISTANCE_ROUNDING 0x1p-46
#define QM_TIE_ROUNDING 0x1p-48 /* 32 u: of computed distances, which are found to be off by 9 u at most */

static inline double qm_max_coordinate(qm_vec p)
{
    return qm_max(fabs(p.x), qm_max(fabs(p.y), fabs(p.z)));
}

/** s times QM_DISTANCE_ROUNDING: the max error of the distance to a triangle. */
static inline double qm_distance_rounding(qm_vec p)
{
    return QM_DISTANCE_ROUNDING * (1.0 + qm_max_coordinate(p));
}

/** The certified error of projections onto patches when the nearest face is wanted. */
static inline double qm_bilinear_error(qm_vec p)
{
    return QM_BILINEAR_MIN_ERROR + QM_TIE_ROUNDING * qm_max_coordinate(p);
}

/** The nearest face for p, local, and its nearest lane. *hint is a pack to start from, and becomes that of
 * the face. */
qm_tie qm_nearest_face(const qm_kernel *kernel, const qm_locator *locator, qm_quad_reading reading, qm_vec p,
                       uint32_t *hint);

/* ---- the nearest points of a point set ---- */

#define QM_NEAREST_POINTS_MAX 128

typedef struct qm_nearest_points {
    int count;
    uint32_t index[QM_NEAREST_POINTS_MAX]; /* vertices, nearest first; of equally near ones the lower first */
    double d2[QM_NEAREST_POINTS_MAX];      /* squared distances, local */
    qm_vec position[QM_NEAREST_POINTS_MAX]; /* local */
} qm_nearest_points;

/** Finds the wanted (at most QM_NEAREST_POINTS_MAX) points nearest to p, local; fewer where the set has
 * fewer. The tree is that of a point set, built with QM_BVH_TARGET. */
void qm_nearest_points_find(const qm_bvh *bvh, qm_vec p, int wanted, qm_nearest_points *out);

/** As qm_nearest_points_find, of the points within a reach, local, whose normals are within 78 degrees of a unit
 * vector. The set has normals. */
void qm_nearest_points_find_toward(const qm_bvh *bvh, qm_vec p, int wanted, qm_vec toward, double reach,
                                   qm_nearest_points *out);

/* ---- the nearest point of a mesh's faces that look one way ---- */

/** A point of a mesh, local, and the unit normal of its face. */
typedef struct qm_facing_point {
    qm_vec position, normal;
} qm_facing_point;

/** Finds the point nearest to p, local, of the triangles whose normals are within a right angle of a vector. False
 * when there is none nearer than the reach, local. The tree is that of a mesh. */
bool qm_nearest_facing(const qm_bvh *bvh, qm_vec p, qm_vec toward, double reach, qm_facing_point *out);

/* ---- the triangles of a mesh near a point ---- */

/** Writes the corners, local, of the triangles within a reach of p, local. Returns their number, or capacity + 1 when there
 * are more. The tree is that of a mesh. */
size_t qm_near_triangles(const qm_bvh *bvh, qm_vec p, double reach, qm_vec (*out)[3], size_t capacity);

#endif
