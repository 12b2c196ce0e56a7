/**
 * deviation_normals.h: the side of a surface on which a point lies, by the normal at its foot. Where the foot is on an edge or a
 * vertex the normals of all faces there count, by their angles there: of a smooth or closed surface that is the right side.
 * Beyond the rim of an open one it is a matter of taste.
 *
 * Source: J. Baerentzen, H. Aanaes, Signed distance computation using the angle weighted pseudonormal, 2005.
 */
#ifndef QM_DEVIATION_NORMALS_H
#define QM_DEVIATION_NORMALS_H

#include "bvh/bvh_tree.h"
#include "qm/locator.h"

typedef struct qm_deviation_normals {
    const qm_bvh *bvh;
    qm_quad_reading reading;
    size_t corner_count;
    uint32_t *start; /* vertex_count + 1: where the faces of each vertex begin */
    uint32_t *faces;
} qm_deviation_normals;

/** Lists the faces of each vertex. Returns QM_OK; QM_E_NO_MEMORY; QM_E_NOT_CLOSED for a point set. */
qm_status qm_deviation_normals_init(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                                    qm_deviation_normals *out);
void qm_deviation_normals_reset(qm_context *ctx, qm_deviation_normals *normals);

/** 1 where the normal points to, -1 behind, 0 for neither; p is local. *hint is a pack to start from. */
int qm_deviation_normals_side(const qm_deviation_normals *normals, qm_vec p, uint32_t *hint);

#endif
