/**
 * codec_gltf.h: the JSON part of a glTF file as plain arrays. Every index is in range or QM_GLTF_NONE, every node has at
 * most one parent, and roots have none.
 */
#ifndef QM_CODEC_GLTF_H
#define QM_CODEC_GLTF_H

#include "codec_build.h"

#define QM_GLTF_NONE SIZE_MAX

typedef struct qm_gltf_view {
    uint64_t offset, size; /* bytes within the binary part, unchecked */
    uint64_t stride;       /* 0: elements are contiguous */
    bool is_foreign;       /* in another buffer than the binary part of the file */
} qm_gltf_view;

typedef struct qm_gltf_accessor {
    size_t view;
    uint64_t offset, count;
    int component_type;  /* the OpenGL constant, 5120 to 5126 */
    int component_count; /* 1 for SCALAR, 3 for VEC3, 0 for anything else */
    bool is_sparse;
} qm_gltf_accessor;

typedef struct qm_gltf_primitive {
    size_t positions, indices; /* accessors */
    int mode;                  /* 0 to 6: points, three kinds of lines, triangles, strip, fan */
    bool is_draco;
} qm_gltf_primitive;

typedef struct qm_gltf_mesh {
    size_t first_primitive, primitive_count;
} qm_gltf_mesh;

typedef struct qm_gltf_node {
    double matrix[16]; /* column-major, to the coordinates of the parent */
    size_t mesh;
    size_t first_child, child_count; /* in links */
    bool has_parent;                 /* or is a root of the scene */
} qm_gltf_node;

typedef struct qm_gltf {
    qm_gltf_view *views;
    qm_gltf_accessor *accessors;
    qm_gltf_primitive *primitives;
    qm_gltf_mesh *meshes;
    qm_gltf_node *nodes;
    size_t *links; /* children of all nodes, then the roots of the scene */
    size_t view_count, accessor_count, primitive_count, mesh_count, node_count, link_count;
    size_t primitive_capacity, link_capacity;
    size_t first_root;
    bool has_poses; /* skins or morph targets, which are not applied */
} qm_gltf;

/** Parses the JSON part, for qm_gltf_free in any case. QM_E_FORMAT, QM_E_UNSUPPORTED, QM_E_TOO_LARGE, QM_E_NO_MEMORY. For
 * invalid JSON it adds the location of the error to report->offset, which is that of the part. */
qm_status qm_gltf_parse(qm_builder *builder, const uint8_t *json, size_t size, qm_gltf *gltf);

void qm_gltf_free(qm_context *ctx, qm_gltf *gltf);

#endif
