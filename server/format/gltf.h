/**
 * gltf.h: the internal header of the glTF decoder: the JSON part of a file as plain arrays.
 * Source: glTF 2.0 specification, sections 3.5 to 3.7, and the extensions that are named below.
 */
#ifndef QM_GLTF_H
#define QM_GLTF_H

#include "codec_builder.h"

/* Every index is in range or QM_GLTF_NONE, every node has at most one parent, and roots have none. */

#define QM_GLTF_NONE SIZE_MAX

#define QM_GLTF_SHOWN_URI 40

/** Bytes of a data URI or of a file beside this one, or of the binary part: the first buffer, when it has no URI. */
typedef struct qm_gltf_buffer {
    uint8_t *bytes; /* of a data URI or a file; NULL else */
    size_t size, capacity;
    bool is_binary_part;
    char uri[QM_GLTF_SHOWN_URI + 1]; /* the beginning of one that is not a data URI */
} qm_gltf_buffer;

typedef enum qm_gltf_coding { QM_GLTF_ATTRIBUTES, QM_GLTF_TRIANGLES, QM_GLTF_INDICES } qm_gltf_coding;

typedef enum qm_gltf_filter { QM_GLTF_NO_FILTER, QM_GLTF_EXPONENTIAL, QM_GLTF_OTHER_FILTER } qm_gltf_filter;

typedef struct qm_gltf_view {
    size_t buffer;
    uint64_t offset, size; /* bytes within the buffer, unchecked */
    uint64_t stride;       /* 0: elements are contiguous */
    /* EXT_meshopt_compression: buffer, offset and size are of the encoded bytes, of count elements. */
    bool is_encoded;
    uint64_t count;
    qm_gltf_coding coding;
    qm_gltf_filter filter;
    uint8_t *decoded; /* count elements of stride bytes, once they have been needed */
} qm_gltf_view;

/** Elements that replace those of an accessor (section 3.6.2.3); count 0: none. */
typedef struct qm_gltf_sparse {
    size_t index_view, value_view;
    uint64_t count, index_offset, value_offset;
    int index_type;
} qm_gltf_sparse;

typedef struct qm_gltf_accessor {
    size_t view; /* QM_GLTF_NONE: all elements are 0 */
    uint64_t offset, count;
    int component_type;  /* the OpenGL constant, 5120 to 5126 */
    int component_count; /* 1 for SCALAR, 3 for VEC3, 0 for anything else */
    bool is_normalized;  /* integers stand for fractions, section 3.11 */
    qm_gltf_sparse sparse;
} qm_gltf_accessor;

typedef struct qm_gltf_primitive {
    size_t positions, indices; /* accessors */
    int mode;                  /* 0 to 6: points, three kinds of lines, triangles, strip, fan */
    bool is_draco;             /* KHR_draco_mesh_compression: draco is the view of the data */
    size_t draco;
    bool has_polygons; /* FB_ngon_encoding: triangles in a row with one first corner are one polygon */
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

typedef struct qm_gltf_scene {
    qm_gltf_buffer *buffers;
    size_t buffer_count;
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
} qm_gltf_scene;

/** Parses the JSON part, for qm_gltf_free in any case. QM_E_FORMAT, QM_E_UNSUPPORTED, QM_E_TOO_LARGE, QM_E_NO_MEMORY. For
 * invalid JSON it adds the location of the error to report->offset, which is that of the part. */
qm_status qm_gltf_parse(qm_builder *builder, const uint8_t *json, size_t size, qm_gltf_scene *gltf);

void qm_gltf_free(qm_context *ctx, qm_gltf_scene *gltf);

#endif
