/**
 * codec_draco.h: the door to the Draco library, plain enough for C and C++. codec_drc.c,
 * encode_drc.c and draco_child.c go through it.
 */
#ifndef QM_CODEC_DRACO_H
#define QM_CODEC_DRACO_H

#ifdef __cplusplus
#include <cstddef>
#include <cstdint>
extern "C" {
#else
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#endif

typedef enum qm_draco_outcome {
    QM_DRACO_DONE,
    QM_DRACO_MALFORMED,
    QM_DRACO_UNSUPPORTED, /* positions that are not three floats, doubles or ints */
    QM_DRACO_NO_MEMORY,   /* in the library */
    QM_DRACO_STOPPED      /* prepare said no */
} qm_draco_outcome;

/** What the library found. A vertex is a value of the position attribute, not one of Draco's points. */
typedef struct qm_draco_facts {
    size_t vertex_count, triangle_count;
    bool has_added_edges;    /* the triangles were cut from polygons */
    bool has_split_points;   /* a vertex may stand there more than once, for its other attributes */
    int quantization_bits;   /* 0: not quantised */
    double range, magnitude; /* of the quantised box: its largest extent and coordinate */
} qm_draco_facts;

/** Arrays of the caller that the decoder fills: rows of three. added[3 * t + c] is 1 if the edge of triangle
 * t opposite to its corner c was added; NULL without added edges. */
typedef struct qm_draco_arrays {
    double *positions;
    uint32_t *triangles; /* each corner below vertex_count */
    uint8_t *added;
} qm_draco_arrays;

/** Makes the arrays for the counts found; false stops the decoder. Nothing else of C is called. */
typedef bool qm_draco_prepare(void *user, const qm_draco_facts *facts, qm_draco_arrays *arrays);

typedef qm_draco_outcome qm_draco_decode_fn(const uint8_t *bytes, size_t size, qm_draco_prepare *prepare,
                                            void *user, size_t *consumed);

/**
 * Decodes a mesh or a point cloud. *consumed is where the library stopped reading, also after a fault.
 * Memory inside the library comes from C++'s heap. Lets no exception out and keeps no state.
 */
qm_draco_decode_fn qm_draco_decode;

/** Has codec_drc.c decode by another function than the one above; called before the first file. */
void qm_codec_drc_set_decoder(qm_draco_decode_fn *decode);

/** A mesh or point cloud to encode. */
typedef struct qm_draco_input {
    const float *positions; /* vertex_count rows of three */
    size_t vertex_count;
    const uint32_t *triangles; /* triangle_count rows of three; none: a point cloud */
    size_t triangle_count;
    const uint8_t *added;  /* as qm_draco_arrays.added, or NULL when no triangle was cut from a larger face */
    int quantization_bits; /* 0: positions stay as they are */
    bool keeps_all;        /* faces and vertices exactly as they are, at the price of a longer file */
} qm_draco_input;

/** Takes the file, whole; false when there is no memory for it. Nothing else of C is called. */
typedef bool qm_draco_write(void *user, const char *bytes, size_t size);

/**
 * Encodes. *displacement is the largest distance between a vertex given and the same vertex decoded, computed
 * in double precision. QM_DRACO_MALFORMED when the library cannot encode the mesh.
 */
qm_draco_outcome qm_draco_encode(const qm_draco_input *input, qm_draco_write *write, void *user,
                                 double *displacement);

#ifdef __cplusplus
}
#endif
#endif
