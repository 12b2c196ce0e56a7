/**
 * quads.h: a mesh of quads of about equal size from any surface of triangles and quads.
 *
 * Directions and corners of the quads come from smooth fields, the numbers of quads between them from an integer flow:
 * so every face is a quad, and vertices are irregular only where the directions turn round them or rows had to end.
 */
#ifndef QM_QUADS_H
#define QM_QUADS_H

#include "qm/bvh.h"

/** Vertices, faces and their triangles have numbers of 32 bits. */
#define QM_QUADS_MOST 100000000

typedef struct qm_quads_options {
    size_t quads; /* wanted number of quads, from 1 to QM_QUADS_MOST */
    double
        crease_angle; /* degrees, from 0 to 180: an edge whose faces differ by more is a crease, and followed; 0: none are */
    int thread_count;
    bool
        keeps_pairs; /* of opposite singular vertices, instead of cancelling them: patches of a layout are less stretched */
} qm_quads_options;

/** 5,000 quads, creases above 40 degrees, one thread. */
qm_quads_options qm_quads_options_default(void);

/** What happened on the way. */
typedef struct qm_quads_record {
    size_t components;         /* of the surface */
    double size;               /* side of a quad, for the largest component */
    size_t crosses_turned;     /* vertices round which directions turn */
    size_t steps_inconsistent; /* faces in which rounded steps did not close */
    size_t steps_open;   /* of these, those that the flow could not close (0 unless creases contradict) */
    size_t steps_folded; /* faces that lie upside down in the grid */
    size_t unmatched;    /* triangles that had no partner by their steps: thin parts */
    size_t halved;       /* components that were cut into quads by their midpoints, for want of a matching */
} qm_quads_record;

/**
 * Makes a quad mesh of a surface.
 *
 * bvh     of the surface, with QM_BVH_TARGET; quads count as two triangles
 * record  may be NULL
 *
 * Edges of the surface with more than two faces, or between faces of opposite orientation, count as boundaries. Each
 * component gets quads by its share of the area, and at least 24 or so. Their number is within 5 percent of what was asked
 * for where whole rows of quads allow it. Every face of the result is a quad; the result is manifold. It is the same for any
 * number of threads.
 *
 * Vertices lie on creases and boundaries, else near the surface: where that brings the quads nearer to it they leave it. The
 * diagonal from corner 0 to 2 of each quad, along which quads are read as triangles, is the one that is nearer to it.
 * engine/QUADS.md tells how it works and what was measured.
 *
 * Ownership: borrows the tree; *out is the caller's, for qm_mesh_reset. After an error it is empty.
 * Returns:   QM_OK; QM_E_ARGUMENT (no target, no faces, an option); QM_E_EMPTY (no area); QM_E_SCALE (a diagonal beyond
 *            1e75 or below 1e-75); QM_E_NO_MEMORY; QM_E_CANCELED.
 * Source:    W. Jakob, M. Tarini, D. Panozzo, O. Sorkine-Hornung, Instant field-aligned meshes, 2015 (the fields);
 *            J. Huang, Y. Zhou, M. Niessner, J. R. Shewchuk, L. J. Guibas, QuadriFlow: a scalable and robust method for
 *            quadrangulation, 2018 (integers on edges by flow).
 */
qm_status qm_quads_make(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options, qm_mesh *out,
                        qm_quads_record *record);

/**
 * As qm_quads_make, and says which edges follow creases and boundaries of the surface.
 *
 * creases  receives a byte for each face: bit k for the side from its corner k to the next one. The caller's, for
 *          qm_context_free(ctx, *creases, out->face_count, 1); NULL after an error
 */
qm_status qm_quads_make_with_creases(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options,
                                     qm_mesh *out, uint8_t **creases, qm_quads_record *record);

/**
 * Divides each quad into four, by the middles of its sides and the mean of its corners. Middles of sides that two quads share
 * are one vertex.
 *
 * mesh     every face a quad, a quarter of QM_QUADS_MOST at most; its vertices come first in the result, the parts of face f are faces 4 f to 4 f + 3
 *
 * Ownership: *out is the caller's, for qm_mesh_reset. After an error it is empty.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_quads_divide(qm_context *ctx, const qm_mesh *mesh, qm_mesh *out);

/** Scaled Jacobian below which quads are poor. */
#define QM_QUADS_POOR_SINE 0.2

/** How many faces of a mesh of quads are poor, or folded. */
size_t qm_quads_count_poor(const qm_mesh *mesh);

/** How vertices move before bad quads are opened. Once: no other way is tried where quads stay folded, the vertices go back where more
 * than a few quads stay poor, and there is no last fit where any do. */
typedef enum qm_quads_settling {
    QM_QUADS_SPREAD_ONCE,
    QM_QUADS_SPREAD, /* to equal heights of the surface over all sides */
    QM_QUADS_CENTRE, /* among their neighbours */
    QM_QUADS_STAY    /* not at all */
} qm_quads_settling;

/** What settling keeps of a mesh. All zero is nothing. */
typedef struct qm_quads_marks {
    uint8_t *stays; /* of each vertex: it stays where it is, bit for bit */
    uint8_t *
        sharp; /* of each face: bit k for the side from its corner k to the next one: vertices of such sides stay on the lines */
    double *lines; /* segments, rows of x y z of both ends */
    size_t vertex_count, face_count, line_count;
} qm_quads_marks;

/** Frees what qm_reconstruction_find_marks has allocated. */
void qm_quads_marks_reset(qm_context *ctx, qm_quads_marks *marks);

/**
 * Moves the vertices of a mesh of quads, whose faces stay, along a surface and off it, so that no quad is bad where there is room
 * and the quads lie nearer to the surface. Sides that run along its creases and boundaries come to lie on them; other
 * boundaries stay. No more quads are folded after it.
 *
 * bvh      of the surface, with QM_BVH_TARGET
 * options  the crease angle and the threads count
 * how      where that folds quads, the next way is tried instead; at the end they stay as they were
 * marks    of the mesh, or NULL: what is marked is kept also where that leaves bad quads
 * mesh     near the surface; every face a quad
 *
 * Returns: QM_OK, also when the mesh is not manifold or not oriented: it is left as it was; QM_E_ARGUMENT; QM_E_NO_MEMORY;
 *          QM_E_CANCELED.
 */
qm_status qm_quads_settle(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options,
                          qm_quads_settling how, const qm_quads_marks *marks, qm_mesh *mesh);

#endif
