/**
 * trimesh.h: a triangle mesh with half-edges that can be edited: edges are split, collapsed and flipped.
 *
 * Half-edge h is corner h % 3 of face h / 3 and runs from that corner to the next one. A mesh is always manifold: a
 * vertex has one fan of faces, an edge one face or two that run through it in opposite directions.
 */
#ifndef QM_TRIMESH_H
#define QM_TRIMESH_H

#include "core/vec.h"

/** What may move a vertex: anything, only along its feature, nothing. */
enum { QM_TRIMESH_FREE, QM_TRIMESH_ON_LINE, QM_TRIMESH_CORNER };

typedef struct qm_trimesh {
    size_t vertex_count, vertex_capacity;
    qm_vec *position;
    uint32_t *out;     /* a half-edge from the vertex; QM_NO_INDEX: no face uses it */
    uint8_t *is_fixed; /* a corner, whatever its features are */
    size_t face_count, face_capacity;
    uint32_t *from;      /* of each half-edge; QM_NO_INDEX: the face was removed */
    uint32_t *twin;      /* QM_NO_INDEX at a boundary */
    uint8_t *is_feature; /* of each half-edge, equal for twins; boundaries are features */
    int32_t (
        *step)[2];   /* of each half-edge: integers in the frame of its face, which quads_steps.c explains */
    uint32_t *stamp; /* of each vertex, scratch */
    uint32_t stamp_value;
} qm_trimesh;

static inline uint32_t qm_trimesh_next(uint32_t h)
{
    return h % 3 == 2 ? h - 2 : h + 1;
}

static inline uint32_t qm_trimesh_prev(uint32_t h)
{
    return h % 3 == 0 ? h + 2 : h - 1;
}

static inline uint32_t qm_trimesh_to(const qm_trimesh *m, uint32_t h)
{
    return m->from[qm_trimesh_next(h)];
}

static inline bool qm_trimesh_has_face(const qm_trimesh *m, size_t face)
{
    return m->from[3 * face] != QM_NO_INDEX;
}

static inline qm_vec qm_trimesh_edge(const qm_trimesh *m, uint32_t h)
{
    return qm_vec_sub(m->position[qm_trimesh_to(m, h)], m->position[m->from[h]]);
}

/** The first half-edge of the fan of a vertex in counterclockwise order: at a boundary the one without a twin. */
uint32_t qm_trimesh_first(const qm_trimesh *m, uint32_t vertex);

/** The half-edge after h in the fan of its vertex; QM_NO_INDEX after the last one of a vertex of the boundary. That of an
 * inner vertex comes round to the first. */
static inline uint32_t qm_trimesh_around(const qm_trimesh *m, uint32_t h)
{
    return m->twin[qm_trimesh_prev(h)];
}

/** Twice the area times the normal of a face. */
qm_vec qm_trimesh_normal(const qm_trimesh *m, size_t face);

/** Normal of length 1 of a vertex: mean of its faces by area; 0 if they cancel. */
qm_vec qm_trimesh_vertex_normal(const qm_trimesh *m, uint32_t vertex);

/** QM_TRIMESH_FREE, QM_TRIMESH_ON_LINE or QM_TRIMESH_CORNER; line receives two neighbours along the feature. */
int qm_trimesh_kind(const qm_trimesh *m, uint32_t vertex, uint32_t line[2]);

/**
 * Makes a mesh of triangles.
 *
 * corner    face_count rows of three vertices; faces that repeat one are left out
 * positions of all vertices; only those of faces are taken over
 *
 * Edges with more than two faces, or whose faces run through them in one direction, become boundaries, and each fan at a
 * vertex gets a vertex of its own: so anything becomes manifold.
 *
 * Returns QM_OK; QM_E_NO_MEMORY. *out is the caller's, for qm_trimesh_reset, after an error too.
 */
qm_status qm_trimesh_build(qm_context *ctx, const double *positions, size_t vertex_count,
                           const uint32_t (*corner)[3], size_t face_count, qm_trimesh *out);
void qm_trimesh_reset(qm_context *ctx, qm_trimesh *m);

/** Copies a mesh. Returns and owns as qm_trimesh_build does. */
qm_status qm_trimesh_copy(qm_context *ctx, const qm_trimesh *m, qm_trimesh *out);

/** Inserts a vertex into an edge; its two halves are features as the edge was; the steps are the caller's to set. *vertex
 * receives the new one. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_trimesh_split(qm_context *ctx, qm_trimesh *m, uint32_t h, qm_vec position, uint32_t *vertex);

/** Inserts a vertex at the centroid of a face, which becomes three. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_trimesh_split_face(qm_context *ctx, qm_trimesh *m, uint32_t face, uint32_t *vertex);

/** Closes boundaries that are no longer than longest, each by a fan round a new vertex. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_trimesh_fill_holes(qm_context *ctx, qm_trimesh *m, double longest);

/** Splits edges of the boundary that have both vertices in common with another edge, and faces that have all three in common with their
 * neighbour, whose edges would when they are split: quads, which are told by their vertices, could not be told apart there. No face
 * may have been removed. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_trimesh_split_doubles(qm_context *ctx, qm_trimesh *m);

/** True if the edge can be contracted without a change of topology. */
bool qm_trimesh_can_collapse(qm_trimesh *m, uint32_t h);

/** Contracts an edge that can be: its first vertex is removed, and its faces. */
void qm_trimesh_collapse(qm_trimesh *m, uint32_t h);

/** True if the edge can be turned within its two faces. */
bool qm_trimesh_can_flip(qm_trimesh *m, uint32_t h);
void qm_trimesh_flip(qm_trimesh *m, uint32_t h);

/** Closes the gaps of removed vertices and faces. */
void qm_trimesh_compact(qm_trimesh *m);

#endif
