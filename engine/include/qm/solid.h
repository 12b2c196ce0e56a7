/**
 * solid.h: whether a surface bounds a solid: it is closed, consistently oriented, and does not meet itself. Then every point
 * off it is inside or outside.
 *
 * Closed and oriented: each edge is run through as often from its one end to the other as back, so that the surface winds round
 * each point off it a whole number of times, the same for all points that a path joins without a crossing. A point is
 * *inside* where that number is not 0: with several shells, in each of them; in a cavity, whose shell is oriented against the one
 * around it, not. A mesh that is inside out has the same inside.
 *
 * Vertices are equal when their indices are, as in mesh.h: corners that are not shared must be welded before.
 */
#ifndef QM_SOLID_H
#define QM_SOLID_H

#include "qm/collide.h"

/** What stands in the way, the first that applies. */
typedef enum qm_solid_fault {
    QM_SOLID_PROVEN,
    QM_SOLID_EMPTY,   /* no faces: a point set */
    QM_SOLID_OPEN,    /* edges with an odd number of faces */
    QM_SOLID_TURNED,  /* edges with neighbours that are oriented against one another */
    QM_SOLID_CROSSING /* faces that meet besides what they share */
} qm_solid_fault;

typedef struct qm_solid {
    qm_solid_fault fault;
    size_t edge_count;  /* edges with that fault; of OPEN and TURNED */
    uint32_t edge[2];   /* the ends of one of them, the vertex of lower index first */
    qm_face_pair faces; /* a pair of faces that meet, in the numbering of the input; of CROSSING */
} qm_solid;

/**
 * Checks a surface. Faces that meet are found as by qm_collide_self: patches nearer than 1e-9 of the box's diagonal to one
 * another may count as meeting.
 *
 * Threads: only reads the tree; splits the search for crossings with ctx->parallel.
 * Cost:    linear in the faces, and a search of the mesh with itself when all else is well.
 * Returns: QM_OK, also with a fault; QM_E_SCALE (see collide.h); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_solid_check(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading, int thread_count,
                         qm_solid *out);

/** QM_OK for a proven solid, else QM_E_NOT_CLOSED with a message that names the mesh and the fault. */
qm_status qm_solid_require(qm_context *ctx, const qm_solid *solid, const char *mesh_name);

/** How two solids lie whose surfaces do not meet. */
typedef enum qm_relation {
    QM_RELATION_MEETING,    /* their surfaces do meet */
    QM_RELATION_APART,      /* they have no point in common; one may be in a cavity of the other */
    QM_RELATION_A_INSIDE_B, /* all of A's surface is inside of B, and none of B's inside of A */
    QM_RELATION_B_INSIDE_A,
    QM_RELATION_OVERLAPPING /* some shells of one are inside of the other and others are not, or some of each in the other */
} qm_relation;

/**
 * Tells how two proven solids lie whose surfaces do not meet, by the winding numbers at one vertex of each component. Returns
 * QM_OK; QM_E_SCALE; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_solid_relate(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                          qm_relation *out);

/** How often a proven solid winds round a point off its surface, in the frame of the mesh: 0 outside. Coordinates are
 * below 2^300. */
int qm_solid_winding(const qm_bvh *bvh, qm_quad_reading reading, const double point[3]);

#endif
