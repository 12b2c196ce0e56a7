/**
 * quads_sides.h: the sides of the quads of a mesh, each with its twin, and the local changes of the mesh that keep its topology.
 *
 * Side s is that from corner s % 4 of face s / 4 to the next one.
 *
 * Source: the changes: M. Tarini, N. Pietroni, P. Cignoni, D. Panozzo, E. Puppo, Practical quad mesh simplification, 2010.
 */
#ifndef QM_QUADS_SIDES_H
#define QM_QUADS_SIDES_H

#include "quads/quads_internal.h"

typedef struct qm_quads_sides {
    qm_context *ctx;
    qm_quads_result *r;
    size_t face_count, vertex_count; /* with those that are gone */
    uint32_t *twin;                  /* of each side; QM_NO_INDEX at a boundary */
    uint8_t *is_gone;                /* of each face */
    uint32_t *out;                   /* of each vertex: a side from it; QM_NO_INDEX: the vertex is gone */
    uint8_t *kind;                   /* of each vertex: QM_TRIMESH_FREE ... */
    uint32_t *stamp, stamp_value;    /* scratch */
} qm_quads_sides;

/** The arrays of a mesh that a local change writes to. */
typedef struct qm_quads_snapshot {
    uint32_t *corner, *twin, *out;
    uint8_t *is_gone, *is_feature;
    double *positions;
} qm_quads_snapshot;

/** Pairs the sides of a manifold mesh. Returns QM_OK; QM_E_NO_MEMORY; sides is the caller's, for qm_quads_sides_reset. */
qm_status qm_quads_sides_build(qm_context *ctx, qm_quads_result *r, qm_quads_sides *sides);
void qm_quads_sides_reset(qm_quads_sides *sides);

/** Closes the gaps of vertices and faces that are gone; sides is used up, but for its reset. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_sides_compact(qm_quads_sides *sides);

static inline uint32_t qm_quads_next(uint32_t s)
{
    return s % 4 == 3 ? s - 3 : s + 1;
}

static inline uint32_t qm_quads_prev(uint32_t s)
{
    return s % 4 == 0 ? s + 3 : s - 1;
}

static inline uint32_t qm_quads_from(const qm_quads_sides *t, uint32_t side)
{
    return t->r->mesh.faces[side];
}

static inline qm_vec qm_quads_at(const qm_quads_sides *t, uint32_t vertex)
{
    return qm_vec_load(t->r->mesh.positions + 3 * (size_t)vertex);
}

/** The first side of the fan of a vertex: at a boundary the one without a twin. */
uint32_t qm_quads_first_side(const qm_quads_sides *t, uint32_t vertex);

/** The side after s in the fan of its vertex; QM_NO_INDEX after the last one of a vertex of the boundary. That of an inner vertex
 * comes round to the first. */
static inline uint32_t qm_quads_around(const qm_quads_sides *t, uint32_t s)
{
    return t->twin[qm_quads_prev(s)];
}

/** Quads between two features of a vertex, and how many its angle has room for. */
typedef struct qm_quads_sector {
    int quads, wanted;
} qm_quads_sector;

/** The sector of the vertex of a side that the face of the side is in. */
qm_quads_sector qm_quads_sector_at(const qm_quads_sides *t, uint32_t side);

/** True if the face of a side can be contracted: the corner of the side goes to the opposite one. */
bool qm_quads_can_contract(qm_quads_sides *t, uint32_t side);
void qm_quads_contract(qm_quads_sides *t, uint32_t side);

/** Two quads round an edge, with corners 0 to 5 in order: the edge joins 0 and 3. It can be turned to join 1 and 4, or 2 and 5. */
typedef struct qm_quads_hexagon {
    uint32_t side, vertex[6], outer[6]; /* outer: the twins of the sides from the corners */
    uint8_t is_feature[6];              /* of these sides */
    qm_quads_sector sector[6];
} qm_quads_hexagon;

/** False if the edge of a side must stay: a feature, or one round which vertices or faces repeat. */
bool qm_quads_find_hexagon(const qm_quads_sides *t, uint32_t side, qm_quads_hexagon *out);

/** True if the edge can be turned by k corners, 1 or 2. */
bool qm_quads_can_turn(qm_quads_sides *t, const qm_quads_hexagon *x, int k);
void qm_quads_turn(qm_quads_sides *t, const qm_quads_hexagon *x, int k);

/** Space for a copy of all that local changes write to. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_snapshot_alloc(const qm_quads_sides *t, qm_quads_snapshot *s);
void qm_quads_snapshot_reset(const qm_quads_sides *t, qm_quads_snapshot *s);
void qm_quads_snapshot_take(const qm_quads_sides *t, qm_quads_snapshot *s);
void qm_quads_snapshot_restore(qm_quads_sides *t, const qm_quads_snapshot *s);

#endif
