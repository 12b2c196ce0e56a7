/**
 * mesh_load.h: the bytes of a file to a mesh that is ready for questions, with the time that each stage took.
 * Shared by the daemon and the command line.
 */
#ifndef QM_MESH_LOAD_H
#define QM_MESH_LOAD_H

#include "format/codec.h"
#include "qm/deform.h"
#include "self_pairs.h"

typedef struct qm_loaded_mesh {
    qm_mesh mesh;
    qm_bvh *bvh;          /* NULL when it was not to be built */
    qm_patch_set patches; /* none of a mesh without quads */
    qm_tetra *tetra;      /* over them; NULL without quads or when it was not asked for */
    qm_mesh_facts facts;
    qm_box box;
    double diagonal;
    uint64_t revision;         /* deformations of the file's mesh so far */
    qm_self_pairs *self_pairs; /* what is known of its own collisions; NULL when it is not to be kept */
    qm_deformer *deformer;     /* made by the first deformation in memory; NULL before */
    qm_format format;
    size_t file_size;
    double parse_ms, topology_ms, patches_ms, bvh_ms;
    char (*warnings)[QM_CODEC_DETAIL_SIZE]; /* of the decoder, then of the facts (degenerate faces, unused
                                               vertices) */
    size_t warning_count;
} qm_loaded_mesh;

/** What a mesh is made ready for. What is not asked for costs neither time nor memory. */
typedef struct qm_preparation {
    bool has_facts;     /* counts facts, and warns of what they tell; otherwise facts are all zero */
    bool has_patches;   /* finds the patches of a mesh with quads; needs has_facts */
    bool keeps_pairs;   /* of self-collisions, for those that come after a deformation */
    bool has_tetra;     /* builds offset tetrahedra over them; needs a tree that is a target */
    qm_bvh_parts parts; /* of the tree */
    bool has_no_tree;   /* leaves it out: enough for the collision of two meshes */
    int thread_count;   /* 1 or more; more than one is used only with ctx->parallel */
    const double
        *positions;        /* of a revision, in place of those of the file; NULL: the file's. Rows of x y z */
    size_t position_count; /* rows */
} qm_preparation;

/**
 * Decodes (format QM_FORMAT_UNKNOWN: sniffed), finds the facts and builds the tree. On success *out is the
 * caller's, for qm_loaded_mesh_reset with the same allocator.
 *
 * Returns QM_OK; or a status with report->detail and the place in the file. After an error *out is all zero.
 */
qm_status qm_mesh_load(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, const qm_preparation *preparation, qm_loaded_mesh *out,
                       qm_codec_report *report);

/**
 * The two halves of it, for who has no use for the bytes once they are decoded: their memory then serves the
 * tree. A mesh that has been read has no tree, facts or warnings until it is made ready.
 */
qm_status qm_mesh_read(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, qm_loaded_mesh *out, qm_codec_report *report);
qm_status qm_mesh_make_ready(qm_context *ctx, const qm_preparation *preparation, qm_loaded_mesh *mesh,
                             qm_codec_report *report);

/**
 * Makes a mesh of the same faces, facts and warnings with other positions, which it takes over: rows of x y z
 * for every vertex, on the allocator of the context. They have passed qm_mesh_validate.
 *
 * Returns QM_OK or a status; after an error *out is all zero, and positions are still the caller's.
 */
qm_status qm_loaded_mesh_copy(qm_context *ctx, const qm_loaded_mesh *mesh, double *positions,
                              const qm_preparation *preparation, qm_loaded_mesh *out);

/**
 * Moves the vertices of a mesh that nobody else uses: takes positions over as above, and lets trees follow.
 * vertices are those that moved, NULL for all. *updated counts the boxes and radii that were found anew.
 * After an error the mesh must not be used but for qm_loaded_mesh_reset; positions are gone.
 */
qm_status qm_loaded_mesh_deform(qm_context *ctx, qm_loaded_mesh *mesh, double *positions,
                                const uint32_t *vertices, size_t vertex_count, int thread_count,
                                size_t *updated);

void qm_loaded_mesh_reset(qm_context *ctx, qm_loaded_mesh *mesh);

/** The patch that holds most faces; zero rows without patches. */
qm_regular_patch qm_loaded_mesh_largest_patch(const qm_loaded_mesh *mesh);

/** Bytes of arrays, tree and patches. */
size_t qm_loaded_mesh_memory_size(const qm_loaded_mesh *mesh);

/** "triangles", "quads", "mixed" or "points". */
const char *qm_loaded_mesh_kind(const qm_loaded_mesh *mesh);

#endif
