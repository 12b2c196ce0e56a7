/**
 * patch.h: the regular structure of a quad mesh: rectangles of quads, rows x columns, that tile it.
 *
 * A vertex is irregular when the quads round it are not four, or at a boundary more than two. From every
 * irregular vertex a cut runs along each edge, straight on through regular vertices, and ends at a boundary,
 * at an irregular vertex, or where another cut has come through before: all advance at the same speed, so no
 * cut shatters the mesh. What lies between the cuts are rectangles, and rings and tori, which are cut once
 * more. Then rectangles that share a whole side are joined, longest side first.
 *
 * Every face lies in just one patch. Triangles, quads that name a vertex twice, and so the parts of polygons,
 * are patches of 1 x 1 of their own; edges of three faces or more are cuts.
 *
 * Source: Eppstein, Goodrich, Kim, Tamstorf, Motorcycle graphs: canonical quad mesh partitioning, SGP 2008.
 */
#ifndef QM_PATCH_H
#define QM_PATCH_H

#include "qm/mesh.h"

/** Face (r, c) of the patch is faces[first + r * columns + c] of the set. */
typedef struct qm_regular_patch {
    size_t first;
    uint32_t rows, columns; /* 1 or more */
} qm_regular_patch;

/** The patches of a mesh, by their lowest face. A point set has none. */
typedef struct qm_patch_set {
    qm_regular_patch *patches; /* patch_count */
    uint32_t *faces;           /* face_count: every face of the mesh once, patch by patch */
    uint8_t *turns; /* face_count, beside faces: how the face lies in its patch, see qm_patch_corner */
    size_t patch_count, face_count;
    size_t quad_count; /* quads that lie in patches of more than one face */
} qm_patch_set;

/**
 * Which corner of its face lies at a place of its cell in the patch: 0 at (row r, column c), 1 at (r, c + 1),
 * 2 at (r + 1, c + 1), 3 at (r + 1, c) of the vertices. A triangle keeps its own numbering.
 */
static inline unsigned qm_patch_corner(uint8_t turn, unsigned place)
{
    return (turn & 4 ? turn - place : turn + place) & 3;
}

/**
 * Finds the patches. The mesh passes qm_mesh_validate. The result depends on the mesh alone. Where it tells
 * its grids, and its faces bear them out, these are its patches, and nothing is searched for; that no other
 * faces use what lies inside them is the caller's to know (qm_mesh_facts, manifold).
 *
 * Cost:    linear in the faces but for the joining; memory of about 60 bytes a face, given back on return.
 * Returns: QM_OK; QM_E_TOO_LARGE (2^29 faces or more); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is
 *          all zero. *out is the caller's, for qm_patch_set_reset in the same context.
 */
qm_status qm_patch_set_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out);

void qm_patch_set_reset(qm_context *ctx, qm_patch_set *set);

/** The vertex of the mesh at (row, column) of a patch: rows + 1 x columns + 1 of them. The patch is not a
 * triangle. */
uint32_t qm_patch_vertex(const qm_patch_set *set, const qm_mesh *mesh, size_t patch, uint32_t row,
                         uint32_t column);

/** Bytes that the set holds. */
size_t qm_patch_set_memory_size(const qm_patch_set *set);

#endif
