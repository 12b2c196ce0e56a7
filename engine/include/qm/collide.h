/**
 * collide.h: which faces of two surfaces meet, or of one surface with itself.
 *
 * Surfaces are closed sets, so faces that only touch meet too. With quads as triangles, all is decided by
 * exact signs: the answer doesn't depend on the order of faces or corners, on threads, or on moving
 * everything by the same vector where that is exact in doubles.
 *
 * Two faces of one mesh collide when they have a point in common besides the corners and edges that they
 * share:
 *   no corner shared     any common point, touching included
 *   one corner           any common point but that corner
 *   an edge              any common point off the edge: one is folded onto the other, in one plane
 *   three corners        always, unless they are degenerate: then they are the edges that they share
 * Corners are shared when they are the same vertex, whatever the positions: two vertices at one place are
 * two. With quads as triangles this holds for the triangles, so that a quad's diagonal is one of its edges,
 * and the two triangles of a quad (all those of a polygon) are one face, which doesn't collide with itself.
 *
 * With quads as bilinear patches, contact is found by cutting them up: faces that meet are always told, faces
 * farther apart than the tolerance never, and in between it may be either, always the same. Neighbours then
 * collide when they meet farther than the tolerance from what they share. Triangles stay exact. A pair so
 * badly folded that its cutting doesn't end in time is told.
 *
 * Source: pairs of nodes: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh,
 * sections 4.4 and 4.5; S. Gottschalk, M. Lin, D. Manocha, OBBTree, 1996.
 */
#ifndef QM_COLLIDE_H
#define QM_COLLIDE_H

#include "qm/bvh.h"

/** What two faces have in common. */
typedef enum qm_contact_kind { QM_CONTACT_POINT, QM_CONTACT_SEGMENT, QM_CONTACT_AREA } qm_contact_kind;

/** One place where faces meet: two points of it, in the frame of the meshes; the same twice for a point. */
typedef struct qm_contact {
    qm_contact_kind kind;
    double point[2][3];
} qm_contact;

/** Faces in the numbering of the input (qm_mesh_input_face); of one mesh, a < b. */
typedef struct qm_face_pair {
    uint32_t a, b;
} qm_face_pair;

typedef enum qm_collide_mode {
    QM_COLLIDE_ALL,   /* every pair */
    QM_COLLIDE_FIRST, /* the least pair: by a, then by b */
    QM_COLLIDE_ANY    /* the pair that is found soonest; which one hangs on the order of faces */
} qm_collide_mode;

typedef struct qm_collide_options {
    qm_quad_reading quads;
    qm_collide_mode mode;
    double tolerance;  /* > 0, unit of the meshes: of bilinear quads, see above; unused for triangles */
    int thread_count;  /* 1 or more */
    size_t pair_limit; /* more pairs than this are an error: they would fill the memory; a pair of quads
                          counts for each pair of its triangles that meets */
} qm_collide_options;

/** Triangles, all pairs, tolerance 0 (to be set for bilinear quads), one thread, 2^27 pairs. */
qm_collide_options qm_collide_options_default(void);

typedef struct qm_collision {
    qm_face_pair *pairs; /* by a, then by b, none twice; NULL when there are none */
    size_t pair_count;
    uint64_t tests; /* pairs of triangles that took an exact test */
    double elapsed_ms;
} qm_collision;

/**
 * Finds the pairs of faces of a and b that meet. Any parts of the trees serve.
 *
 * Ownership: borrows everything but *out, which is the caller's, for qm_collision_reset in the same context.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   QM_OK; QM_E_ARGUMENT (tolerance, threads); QM_E_TOO_LARGE (more pairs than the limit);
 * QM_E_SCALE (coordinates beyond 2^300, or sizes of the meshes further apart than that); QM_E_NO_MEMORY;
 *            QM_E_CANCELED. After an error *out is all zero.
 */
qm_status qm_collide_meshes(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                            const qm_collide_options *options, qm_collision *out);

/**
 * The same for meshes that have no trees: makes trees of those faces alone that lie near the other mesh,
 * which often are few. The meshes pass qm_mesh_validate. elapsed_ms counts the search without the trees.
 *
 * Returns as above; QM_E_EMPTY; QM_E_TOO_LARGE also for more faces than a tree holds.
 */
qm_status qm_collide_surfaces(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                              const qm_collide_options *options, qm_collision *out);

/** What has happened to a mesh since its pairs were found last. */
typedef struct qm_collide_changes {
    const uint32_t *vertices; /* vertex_count that have moved, in any order; other faces are as they were */
    size_t vertex_count;
    const qm_face_pair *pairs; /* all pairs from before, of the same mesh in the same reading */
    size_t pair_count;
} qm_collide_changes;

/**
 * Finds the pairs of faces of one mesh that collide, as told above. The tree holds the positions as they are
 * now. With changes, only pairs with a face that has moved are looked for and those of before that have not
 * are carried over: the same pairs in less time. Without (NULL) all pairs are looked for.
 *
 * Returns as above; QM_E_INDEX when the changes name a vertex or face that is not there.
 */
qm_status qm_collide_self(qm_context *ctx, const qm_bvh *bvh, const qm_collide_options *options,
                          const qm_collide_changes *changes, qm_collision *out);

void qm_collision_reset(qm_context *ctx, qm_collision *collision);

/**
 * Where a pair of faces that was found meets: of several places (a quad has two triangles) the largest, of a
 * polygon that of its first triangle. With the same mesh twice the place includes what they share. The kind
 * is exact, coordinates are rounded; of bilinear quads one point is told, to within the tolerance. False when
 * they don't meet.
 */
bool qm_collide_contact(const qm_mesh *a, const qm_mesh *b, const qm_collide_options *options,
                        qm_face_pair pair, qm_contact *out);

#endif
