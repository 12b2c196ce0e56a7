/**
 * codec_draco.h: the C interface to the Draco library, for codec_drc.c and draco_child.c.
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
    QM_DRACO_TOO_LARGE,   /* decoding takes more memory or time than a file of this size may use */
    QM_DRACO_STOPPED      /* prepare returned false */
} qm_draco_outcome;

/** Facts of a file. A vertex is a value of the position attribute, not one of Draco's points. */
typedef struct qm_draco_facts {
    size_t vertex_count, triangle_count;
    bool has_added_edges;    /* the triangles were cut from polygons */
    bool has_split_points;   /* a vertex may occur more than once, for its other attributes */
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

/** Allocates the arrays for these counts; false stops the decoder. The only call back into C. */
typedef bool qm_draco_prepare(void *user, const qm_draco_facts *facts, qm_draco_arrays *arrays);

typedef qm_draco_outcome qm_draco_decode_fn(const uint8_t *bytes, size_t size, qm_draco_prepare *prepare,
                                            void *user, size_t *consumed);

/**
 * Decodes a mesh or a point cloud. *consumed is the number of bytes read, also after an error. The library allocates
 * from C++'s heap. Throws no exception and keeps no state.
 */
qm_draco_decode_fn qm_draco_decode;

/** Replaces the function that codec_drc.c decodes by; called before the first file. */
void qm_codec_drc_set_decoder(qm_draco_decode_fn *decode);

/** A mesh or point cloud to encode. */
typedef struct qm_draco_input {
    const float *positions; /* vertex_count rows of three */
    size_t vertex_count;
    const uint32_t *triangles; /* triangle_count rows of three; none: a point cloud */
    size_t triangle_count;
    const uint8_t *added;  /* as qm_draco_arrays.added; NULL if all faces are triangles */
    int quantization_bits; /* 0: none */
    bool keeps_all;        /* keeps degenerate faces and unused vertices, in a longer file */
} qm_draco_input;

/** Receives the whole file; false if memory runs out. The only call back into C. */
typedef bool qm_draco_write(void *user, const char *bytes, size_t size);

/**
 * Encodes. *displacement is the max distance between an input vertex and the same vertex decoded, computed in double
 * precision. QM_DRACO_MALFORMED if the library cannot encode the mesh.
 */
qm_draco_outcome qm_draco_encode(const qm_draco_input *input, qm_draco_write *write, void *user,
                                 double *displacement);

#ifdef __cplusplus
}
#endif
#endif
