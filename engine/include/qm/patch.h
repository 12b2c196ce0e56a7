/**
 * patch.h: the regular patches of a quad mesh: rectangles of quads, rows x columns, that tile it.
 *
 * An inner vertex is irregular when it has not four quads, a boundary vertex when it has more than two. From
 * every irregular vertex a cut runs along each edge, straight through regular vertices, and ends at a
 * boundary, at an irregular vertex, or where another cut has passed before: all advance at equal speed, so no
 * cut shatters the mesh. The regions between the cuts are rectangles, and rings and tori, which are cut once
 * more. Then rectangles that share a complete side are joined, longest side first.
 *
 * Every face lies in just one patch. Triangles (those of polygons, too) and quads that repeat a vertex are
 * patches of 1 x 1; edges of three faces or more are cuts.
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

/** The patches of a mesh, sorted by their lowest face. A point set has none. */
typedef struct qm_patch_set {
    qm_regular_patch *patches; /* patch_count */
    uint32_t *faces;           /* face_count: every face of the mesh once, patch by patch */
    uint8_t *turns;            /* face_count: orientation of each entry of faces, see qm_patch_corner */
    size_t patch_count, face_count;
    size_t quad_count; /* quads that lie in patches of more than one face */
} qm_patch_set;

/**
 * The corner of a face at a position of its cell in the patch: position 0 is at (row r, column c), 1 at (r, c
 * + 1), 2 at (r + 1, c + 1), 3 at (r + 1, c) of the vertices. Bits 0 and 1 of turn rotate, bit 2 mirrors. A
 * triangle keeps its own numbering.
 */
static inline unsigned qm_patch_corner(uint8_t turn, unsigned position)
{
    return (turn & 4 ? turn - position : turn + position) & 3;
}

/**
 * Finds the patches. The result depends on the mesh alone. When the mesh has grids that contain all its faces
 * and match them, these are the patches, without a search; the caller must know that no other face uses their
 * inner edges (manifold of qm_mesh_facts).
 *
 * mesh  passes qm_mesh_validate
 *
 * Ownership: *out is the caller's, for qm_patch_set_reset in the same context.
 * Cost:      linear in the faces but for the joining; scratch memory of about 60 bytes a face.
 * Returns:   QM_OK; QM_E_TOO_LARGE (2^29 faces or more); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out
 *            is all zero.
 */
qm_status qm_patch_set_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out);

/**
 * Finds the regions between the cuts, without joining them, and with edges that no patch crosses: cuts end at
 * them as at a boundary, and start where they are irregular.
 *
 * mesh     passes qm_mesh_validate; its grids are not used
 * creases  a byte a face, bit s for the side from corner s to corner s + 1, set in both faces of an edge; or
 *          NULL
 *
 * Ownership and Returns: as for qm_patch_set_find.
 */
qm_status qm_patch_set_trace(qm_context *ctx, const qm_mesh *mesh, const uint8_t *creases, qm_patch_set *out);

void qm_patch_set_reset(qm_context *ctx, qm_patch_set *set);

/** The vertex of the mesh at (row, column) of a patch, row <= rows, column <= columns. The patch is not a
 * triangle. */
uint32_t qm_patch_vertex(const qm_patch_set *set, const qm_mesh *mesh, size_t patch, uint32_t row,
                         uint32_t column);

/** Bytes that the set holds. */
size_t qm_patch_set_memory_size(const qm_patch_set *set);

#endif
