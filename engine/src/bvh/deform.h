/**
 * deform.h: the inside of a deformer.
 */
#ifndef QM_DEFORM_INTERNAL_H
#define QM_DEFORM_INTERNAL_H

#include "bvh_tree.h"
#include "qm/deform.h"

struct qm_deformer {
    size_t vertex_count, face_count, corner_count, pack_count, pack_vertex_count;
    uint32_t *start;         /* vertex_count + 1: where the faces of each vertex begin */
    uint32_t *faces;         /* corner_count */
    uint32_t *face_pack;     /* face_count: the pack that holds each face, or point */
    uint32_t *pack_start;    /* pack_count + 1: where the vertices of each pack begin */
    uint32_t *pack_vertices; /* pack_vertex_count: a dense copy of what lies far apart in the tree's lanes */
};

#endif
