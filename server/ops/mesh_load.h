/**
 * mesh_load.h: decodes the bytes of a file and prepares the mesh for jobs, with the time of each stage. Shared by the
 * daemon and the command line.
 */
#ifndef QM_MESH_LOAD_H
#define QM_MESH_LOAD_H

#include "base/notes.h"
#include "format/codec.h"
#include "qm/deform.h"
#include "qm/extent.h"
#include "qm/transform.h"
#include "self_pairs.h"
#include "solids.h"

typedef struct qm_loaded_mesh {
    qm_mesh mesh;
    qm_bvh *bvh;          /* NULL if the preparation has no tree */
    qm_patch_set patches; /* empty without quads */
    qm_tetra *tetra;      /* over the patches; NULL without quads or if not requested */
    qm_mesh_facts facts;
    qm_extent extent; /* all zero if not requested, and after a deformation in memory */
    qm_box box;
    double diagonal;
    qm_transform_change moved; /* what its transform has done to distances; all zero: it is where it was */
    uint64_t revision;         /* number of deformations since the file */
    qm_self_pairs *self_pairs; /* cache of its self-collisions; NULL if not requested */
    qm_solids *solids;         /* what is known of it as a solid; NULL if not requested */
    qm_deformer *deformer;     /* created by the first deformation in memory; NULL before */
    qm_format format;
    char unit[QM_UNIT_SIZE]; /* of the file; "" when it does not tell */
    size_t file_size;        /* compressed if it is */
    double parse_ms, topology_ms, patches_ms, bvh_ms;
    char (*warnings)[QM_CODEC_DETAIL_SIZE]; /* of the decoder, then of the facts */
    size_t warning_count;
} qm_loaded_mesh;

/** The structures to build. Those that are not requested cost neither time nor memory. */
typedef struct qm_preparation {
    bool has_facts;     /* counts facts and derives warnings; else facts are all zero */
    bool has_extent;    /* measures area and volume */
    bool has_patches;   /* finds the regular patches of a mesh with quads; needs has_facts */
    bool keeps_pairs;   /* keeps self-collisions, for incremental searches after a deformation, and solids */
    bool has_tetra;     /* builds offset tetrahedra over the patches; needs a target tree */
    qm_bvh_parts parts; /* of the tree */
    bool has_no_tree;   /* builds no tree: enough for the collision of two meshes */
    int thread_count;   /* 1 or more; ctx->parallel is needed for more than one */
    const double *positions; /* x y z of each vertex of a revision; NULL: those of the file */
    size_t position_count;   /* points in positions */
    const double *transform; /* moves the mesh (qm/transform.h), which passes its check; NULL: it stays */
} qm_preparation;

/**
 * Decodes the file (QM_FORMAT_UNKNOWN: the format is detected from its content), which may be compressed with gzip, and
 * prepares the mesh. On success *out
 * is the caller's, for qm_loaded_mesh_reset with the same allocator.
 *
 * Returns QM_OK; or a status with report->detail and the location in the file. After an error *out is all zero.
 */
qm_status qm_mesh_load(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, const qm_preparation *preparation, qm_loaded_mesh *out,
                       qm_codec_report *report);

/**
 * Measures the memory that qm_mesh_load needs at least for the mesh of a file, by decoding the file without storing its
 * mesh. Where the counts of the file are exact it lowers *limits to them, so that qm_mesh_load allocates no more than
 * the arrays take. Returns a status as qm_mesh_load does; after QM_E_NO_MEMORY *needed is the memory of the content of a
 * compressed file, else 0.
 */
qm_status qm_mesh_measure(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                          qm_codec_limits *limits, const qm_preparation *preparation, size_t *needed,
                          qm_codec_report *report);

/**
 * The two halves of qm_mesh_load, so that the caller can free the bytes in between and their memory serves the tree. A
 * mesh that has been read has no tree, facts or warnings until it is prepared.
 */
qm_status qm_mesh_read(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, qm_loaded_mesh *out, qm_codec_report *report);
qm_status qm_mesh_make_ready(qm_context *ctx, const qm_preparation *preparation, qm_loaded_mesh *mesh,
                             qm_codec_report *report);

/**
 * Creates a mesh of the same faces, facts and warnings with other positions: x y z of every vertex, which have passed
 * qm_mesh_validate. Takes ownership of positions, which are on the allocator of the context.
 *
 * Returns QM_OK or a status; after an error *out is all zero, and the caller still owns positions.
 */
qm_status qm_loaded_mesh_copy(qm_context *ctx, const qm_loaded_mesh *mesh, double *positions,
                              const qm_preparation *preparation, qm_loaded_mesh *out);

/**
 * Moves the vertices of a mesh that no other thread uses: takes ownership of positions as above, and refits the trees.
 * vertices lists the moved ones; NULL means all. *updated counts the boxes and radii that were recomputed. After an
 * error the mesh may only be passed to qm_loaded_mesh_reset; positions are freed with it.
 */
qm_status qm_loaded_mesh_deform(qm_context *ctx, qm_loaded_mesh *mesh, double *positions,
                                const uint32_t *vertices, size_t vertex_count, int thread_count,
                                size_t *updated);

void qm_loaded_mesh_reset(qm_context *ctx, qm_loaded_mesh *mesh);

/** The patch with most faces; zero rows without patches. */
qm_regular_patch qm_loaded_mesh_largest_patch(const qm_loaded_mesh *mesh);

/** Bytes of arrays, tree and patches. */
size_t qm_loaded_mesh_memory_size(const qm_loaded_mesh *mesh);

/** "triangles", "quads", "mixed" or "points". */
const char *qm_loaded_mesh_kind(const qm_loaded_mesh *mesh);

/** Brings the notes of a mesh along when it was moved: how far the true surface, which is moved with it, may be. */
void qm_loaded_mesh_move_notes(const qm_loaded_mesh *mesh, qm_notes *notes);
/** The same for a mesh that a change has moved. */
void qm_mesh_move_notes(const qm_transform_change *moved, qm_notes *notes);

#endif
