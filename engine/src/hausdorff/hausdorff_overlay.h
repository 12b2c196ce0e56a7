/**
 * hausdorff_overlay.h: upper bounds for faces of the source by the facets straight over them. See the
 * argument in hausdorff_overlay.c.
 */
#ifndef QM_HAUSDORFF_OVERLAY_H
#define QM_HAUSDORFF_OVERLAY_H

#include "bvh/overlay_facets.h"
#include "hausdorff_worker.h"

#define QM_OVERLAY_FACES QM_PACK_LANES

/** Triangles of the source, local to the target. */
typedef struct qm_overlay_source {
    int count;
    qm_vec corner[QM_OVERLAY_FACES][3];
} qm_overlay_source;

/** Facets of the target over a region of the source, for all faces in it. */
typedef struct qm_overlay {
    qm_overlay_frame frame;
    qm_overlay_facets facets;
    double shrink; /* how far corners of faces move towards their centroids, at most */
} qm_overlay;

/** Sum of the normals of triangles of the source, as long as their doubled areas. */
qm_vec qm_overlay_normal(const qm_overlay_source *source);

/** Collects the facets of packs that are over the region of the points, as seen along a normal; false when
 * there are none, or too many. */
bool qm_overlay_set(qm_worker *worker, const qm_side *side, qm_vec normal, const qm_vec *point, int count,
                    const qm_near_packs *near, qm_overlay *overlay);

/** Bits of the triangles that the facets of an overlay show to be within the cutoff; their corners are among
 * its points. */
unsigned qm_overlay_test(qm_worker *worker, const qm_side *side, const qm_overlay *overlay,
                         const qm_overlay_source *source);

/** True when an overlay of its own, without facets too far from it, shows a triangle to be within the
 * cutoff, with all points that are no farther from it than slack. Local. */
bool qm_overlay_test_face(qm_worker *worker, const qm_side *side, const qm_vec corner[3], double slack,
                          const qm_near_packs *near);

/** True when an overlay of its own shows a rectangle of a patch, by its corners in cyclic order, to be within the cutoff. Its
 * bend costs nothing, as the height of a patch over a plane is a bilinear function (hausdorff_overlay_patch.c). Local. */
bool qm_overlay_test_patch(qm_worker *worker, const qm_side *side, const qm_vec corner[4],
                           const qm_near_packs *near);

/** The greatest vertical distance of a bilinear patch, its corners in an overlay's frame, from the facets where they are over
 * it, twists included; negative where none is. Sets the bits of facets beyond enough in far, unless that is NULL: then the first
 * such ends it. */
double qm_overlay_patch_gap(const qm_overlay_facets *facets, const double corner[4][3], double enough,
                            uint8_t *far);

/** Clears the bits in far of facets whose whole patch, where it is over a face, is within enough of its plane; true when no
 * other bits are set. */
bool qm_overlay_patches_are_near(const qm_overlay_facets *facets, const qm_overlay_face *face, double enough,
                                 uint8_t *far);

/** Sets all else of a face from its corners. Returns the margin of its vertical distances for each unit of
 * size, the largest coordinate by magnitude; INFINITY where the face is too steep or too thin. */
double qm_overlay_set_face(qm_overlay_face *face, double size);

#endif
