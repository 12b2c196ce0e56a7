/**
 * deviation_facets.h: the facets of a target that lie near a piece of the source, copied side by side, so
 * that all parts of the piece are bounded and cut without another search of the tree.
 *
 * A piece lies within a ball of radius r round c. The facet nearest to a point p of it has
 *     d(c, T) <= d(p, T) + r <= d(c, B) + 2 r.
 * So once every facet within that radius of c is listed, the minimum of the distances to the list is the
 * distance to B at every point of the piece, and at every point of its parts.
 *
 * A facet is a triangle of the target. A patch of a bilinear target is cut into rectangles, each of which is
 * within its flatness bound of two triangles; these are its facets, and slack is that bound. A mild
 * rectangle, one that bends little and whose radius of curvature exceeds the distance, is not cut any
 * further: it is bounded as a patch (deviation_match.h).
 */
#ifndef QM_DEVIATION_FACETS_H
#define QM_DEVIATION_FACETS_H

#include "bvh/kernel.h"
#include "prim/bilinear_match.h"
#include "prim/triangle.h"

#define QM_FACET_PACKS 40        /* of eight facets each */
#define QM_MAX_RECTANGLES 96     /* of all patches of a list, */
#define QM_MAX_CUT_RECTANGLES 32 /* no rectangle is cut further once there are this many */
#define QM_NO_RECTANGLE (-1)

/** A part of a patch of the target. */
typedef struct qm_deviation_rectangle {
    uint32_t face;
    bool is_mild;      /* bends so little that matches hold */
    bool is_plane;     /* all of the patch is within the permitted error of a plane */
    qm_bilinear patch; /* the whole of it */
    qm_uv_box box;
} qm_deviation_rectangle;

typedef struct qm_deviation_facets {
    int count, pack_count;
    bool is_complete; /* every facet within reach is listed; otherwise only some */
    double slack[QM_FACET_PACKS][QM_PACK_LANES];
    qm_pack pack[QM_FACET_PACKS]; /* slots past count repeat the last facet */
    int rectangle_count;
    int8_t rectangle_of[QM_FACET_PACKS][QM_PACK_LANES]; /* of a facet, or QM_NO_RECTANGLE */
    qm_deviation_rectangle rectangle[QM_MAX_RECTANGLES];
} qm_deviation_facets;

/**
 * Lists the facets within reach of a point.
 *
 * patches   whether the target's quads are bilinear patches
 * cuts_all  whether mild rectangles are cut like the others
 * whole     plane patches that are nearer than this are rectangles as well, and stay whole
 * error     the flatness bound below which they are not cut
 * distance  about how far the target is from the point
 */
void qm_deviation_facets_find(const qm_kernel *kernel, const qm_bvh *target, bool patches, bool cuts_all,
                              double whole, double error, qm_vec centre, double distance, double reach,
                              qm_deviation_facets *near);

/** The rectangle that a listed facet is of, by its index, or QM_NO_RECTANGLE. */
static inline int qm_deviation_facets_rectangle(const qm_deviation_facets *near, int facet)
{
    return near->rectangle_of[facet / QM_PACK_LANES][facet % QM_PACK_LANES];
}

/** The facet at a lane of a pack. */
qm_triangle qm_deviation_facet_at(const qm_pack *pack, int lane);

/** How far a point lies inside of the three planes that stand on the edges of a facet. */
void qm_deviation_facet_edges(const qm_triangle *t, qm_vec p, double inside[3]);

/** How far a point is from both ends of each of these edges, along it; negative past an end. */
void qm_deviation_facet_ends(const qm_triangle *t, qm_vec p, double within[3][2]);

/** The least sine of an angle of a facet that is no obtuse one; 0 of a facet without height. */
double qm_deviation_facet_min_sine(const qm_triangle *t);

/** One of the listed facets, its index, and its distance from a point. */
typedef struct qm_deviation_facet {
    qm_triangle triangle;
    double distance;
    int index;
} qm_deviation_facet;

/** The listed facet nearest to a point; the list is not empty. */
qm_deviation_facet qm_deviation_facets_nearest(const qm_kernel *kernel, const qm_deviation_facets *near,
                                               qm_vec p);

#endif
