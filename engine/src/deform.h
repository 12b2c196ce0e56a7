/**
 * deform.h: the inside of a deformer.
 */
#ifndef QM_DEFORM_INTERNAL_H
#define QM_DEFORM_INTERNAL_H

#include "bvh_tree.h"
#include "qm/deform.h"

struct qm_deformer {
    size_t vertex_count, face_count, corner_count;
    uint32_t *start;     /* vertex_count + 1: where the faces of each vertex begin */
    uint32_t *faces;     /* corner_count */
    uint32_t *face_pack; /* face_count: the pack that holds each face, or point */
};

#endif
