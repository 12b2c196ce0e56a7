/**
 * deviation_near.h: the facets of a target that lie near a piece of the source, copied side by side, so that
 * all parts of the piece are bounded and cut without another search of the tree.
 *
 * A piece lies within a ball of radius r round c. The facet nearest to a point p of it has
 *     d(c, T) <= d(p, T) + r <= d(c, B) + 2 r.
 * So once every facet within that reach of c is listed, the least distance to the list is the distance to B
 * at every point of the piece, and at every point of its parts.
 *
 * A facet is a triangle of the target; a patch of a bilinear target is cut into rectangles, each of which is
 * within its twist of two triangles. These are the facets then, and slack says how far the surface may be
 * from each. A rectangle that bends little, and less than the target is away, is not cut any further, as it
 * can be bounded as it is (deviation_match.h).
 */
#ifndef QM_DEVIATION_NEAR_H
#define QM_DEVIATION_NEAR_H

#include "bvh/kernel.h"
#include "prim/bilinear_match.h"
#include "prim/tri_point.h"

#define QM_FACET_PACKS 40     /* of eight facets each */
#define QM_NEAR_RECTANGLES 96 /* of all patches of a list, */
#define QM_NEAR_CUT 32        /* which are cut no further when there are so many */
#define QM_NO_RECTANGLE (-1)

/** A part of a patch of the target. */
typedef struct qm_near_rectangle {
    uint32_t face;
    bool is_mild;      /* bends so little that matches hold */
    qm_bilinear patch; /* the whole of it */
    qm_uv_box box;
} qm_near_rectangle;

typedef struct qm_near_facets {
    int count, pack_count;
    bool is_complete; /* every facet within reach is listed; otherwise only some */
    double slack[QM_FACET_PACKS][QM_PACK_LANES];
    qm_pack pack[QM_FACET_PACKS]; /* places past count repeat the last facet */
    int rectangle_count;
    int8_t rectangle_of[QM_FACET_PACKS][QM_PACK_LANES]; /* of a facet, or QM_NO_RECTANGLE */
    qm_near_rectangle rectangle[QM_NEAR_RECTANGLES];
} qm_near_facets;

/**
 * Lists the facets within reach of a point.
 *
 * patches   whether the target's quads are bilinear patches; error  the twist below which they are not cut
 * distance  about how far the target is from the point
 */
void qm_near_facets_find(const qm_kernel *kernel, const qm_bvh *target, bool patches, double error,
                         qm_vec middle, double distance, double reach, qm_near_facets *near);

/** The facet at a lane of a pack. */
qm_triangle qm_pack_triangle(const qm_pack *pack, int lane);

/** How far a point lies inside of the three walls that stand on the edges of a facet. */
void qm_triangle_walls(const qm_triangle *t, qm_vec p, double inside[3]);

/** How far a point is from both ends of each of these edges, along it; negative past an end. */
void qm_triangle_ends(const qm_triangle *t, qm_vec p, double within[3][2]);

/** The least sine of an angle of a facet that is no obtuse one; 0 of a facet without height. */
double qm_triangle_least_sine(const qm_triangle *t);

/** One of the listed facets, its place among them, and its distance from a point. */
typedef struct qm_near_facet {
    qm_triangle triangle;
    double distance;
    int place;
} qm_near_facet;

/** The listed facet nearest to a point; the list is not empty. */
qm_near_facet qm_near_facets_nearest(const qm_kernel *kernel, const qm_near_facets *near, qm_vec p);

#endif
