/**
 * collide.h: finds the pairs of faces of two surfaces that meet, or of one surface with itself.
 *
 * Surfaces are closed sets, so faces that only touch meet too. With quads as triangles, exact signs decide
 * every pair: the result does not depend on the order of faces or corners, on threads, or on a common
 * translation that is exact in doubles.
 *
 * Two faces of one mesh collide when they have a point in common besides the corners and edges that they
 * share:
 *   no corner shared     any common point, touching included
 *   one corner           any common point but that corner
 *   an edge              any common point off the edge: one is folded onto the other, in one plane
 *   three corners        always, unless they are degenerate: then they are the edges that they share
 * Corners are shared when they are the same vertex: two vertices at one position are two. With quads as
 * triangles this holds for the triangles, so that a quad's diagonal is one of its edges, and the two
 * triangles of a quad (all triangles of a polygon) are one face, which does not collide with itself.
 *
 * Quads as bilinear patches are tested by subdivision: faces that meet are always reported, faces farther
 * apart than the tolerance never, and faces in between may be reported or not, deterministically. Neighbours
 * then collide when they meet farther than the tolerance from their shared corners and edges. Triangles stay
 * exact. A pair so badly folded that its subdivision does not end within its limit is reported.
 *
 * Source: pairs of nodes: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh,
 * sections 4.4
 *         and 4.5; S. Gottschalk, M. Lin, D. Manocha, OBBTree, 1996.
 */
#ifndef QM_COLLIDE_H
#define QM_COLLIDE_H

#include "qm/bvh.h"

/** The dimension of the intersection of two faces. */
typedef enum qm_contact_kind { QM_CONTACT_POINT, QM_CONTACT_SEGMENT, QM_CONTACT_AREA } qm_contact_kind;

/** An intersection of two faces: two points of it, in the frame of the meshes; equal for a point. */
typedef struct qm_contact {
    qm_contact_kind kind;
    double point[2][3];
    double normal[2][3]; /* of length 1: of the facets, or patches, of both faces there; 0 0 0 without area */
} qm_contact;

/** Faces in the numbering of the input (qm_mesh_input_face); of one mesh, a < b. */
typedef struct qm_face_pair {
    uint32_t a, b;
} qm_face_pair;

typedef enum qm_collide_mode {
    QM_COLLIDE_ALL,   /* every pair */
    QM_COLLIDE_FIRST, /* the first pair in the order by a, then by b */
    QM_COLLIDE_ANY    /* the pair that the search finds first: it depends on the order of faces */
} qm_collide_mode;

typedef struct qm_collide_options {
    qm_quad_reading quads;
    qm_collide_mode mode;
    double tolerance; /* > 0, unit of the meshes: of bilinear quads, see above; unused for triangles */
    int thread_count; /* 1 or more */
    /* an error beyond it: the pairs would fill the memory. A pair of quads counts once for each pair of its
       triangles that meets */
    size_t pair_limit;
} qm_collide_options;

/** Triangles, all pairs, tolerance 0 (to be set for bilinear quads), one thread, 2^27 pairs. */
qm_collide_options qm_collide_options_default(void);

typedef struct qm_collision {
    qm_face_pair *pairs; /* sorted by a, then by b; distinct; NULL when there are none */
    size_t pair_count;
    uint64_t tests; /* pairs of triangles that needed an exact test */
    double elapsed_ms;
} qm_collision;

/**
 * Finds the pairs of faces of a and b that meet. Trees for any purpose serve.
 *
 * Ownership: borrows everything but *out, which is the caller's, for qm_collide_reset in the same context.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   QM_OK; QM_E_ARGUMENT (tolerance, threads); QM_E_TOO_LARGE (more pairs than the limit);
 *            QM_E_SCALE (coordinates beyond 2^300, or a ratio of the sizes beyond that); QM_E_NO_MEMORY;
 *            QM_E_CANCELED. After an error *out is all zero.
 */
qm_status qm_collide_meshes(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                            const qm_collide_options *options, qm_collision *out);

/**
 * As qm_collide_meshes for meshes without trees: builds trees over the faces near the other mesh alone, which
 * often are few. The meshes pass qm_mesh_validate. elapsed_ms is the time of the search without the trees.
 *
 * Returns: as qm_collide_meshes; QM_E_EMPTY; QM_E_TOO_LARGE also for more faces than a tree holds.
 */
qm_status qm_collide_surfaces(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                              const qm_collide_options *options, qm_collision *out);

/** The changes of a mesh since its pairs were found last. */
typedef struct qm_collide_changes {
    const uint32_t *vertices; /* vertex_count moved vertices, in any order; no other vertex has moved */
    size_t vertex_count;
    const qm_face_pair *pairs; /* all pairs of the earlier result, with the same mesh and reading */
    size_t pair_count;
} qm_collide_changes;

/**
 * Finds the pairs of faces of one mesh that collide, as defined above. The tree holds the current positions.
 * With changes, searches pairs with a moved face only and keeps the earlier pairs of other faces: equal pairs
 * in less time. Without changes (NULL) searches all pairs.
 *
 * Returns: as qm_collide_meshes; QM_E_INDEX when the changes name a vertex or face that does not exist.
 */
qm_status qm_collide_self(qm_context *ctx, const qm_bvh *bvh, const qm_collide_options *options,
                          const qm_collide_changes *changes, qm_collision *out);

void qm_collide_reset(qm_context *ctx, qm_collision *collision);

/**
 * Computes the intersection of a pair of faces that was found: the largest of several (a quad has two
 * triangles), that of its first triangle for a polygon. With the same mesh twice it includes shared corners
 * and edges. The kind is exact, coordinates are rounded; for bilinear quads it is one point, to within the
 * tolerance. False when the faces do not meet.
 */
bool qm_collide_contact(const qm_mesh *a, const qm_mesh *b, const qm_collide_options *options,
                        qm_face_pair pair, qm_contact *out);

#endif
