/**
 * soup.h: the bytes of a fuzzer's input as two small meshes of triangles and quads, or points, and as
 * choices.
 */
#ifndef QM_SOUP_H
#define QM_SOUP_H

#include "qm/mesh.h"

#define QM_SOUP_VERTICES 14
#define QM_SOUP_FACES 10

/** What is left of the input; reading beyond its end gives zeros. */
typedef struct qm_bytes {
    const uint8_t *next;
    size_t size;
} qm_bytes;

uint8_t qm_bytes_take(qm_bytes *bytes);

/** A mesh whose arrays are its own. */
typedef struct qm_soup {
    double positions[3 * QM_SOUP_VERTICES];
    uint32_t faces[4 * QM_SOUP_FACES];
    qm_mesh mesh; /* over the arrays */
} qm_soup;

/** How coordinates are read. */
typedef enum qm_soup_kind {
    QM_SOUP_WHOLE, /* whole numbers of a byte each: many coincidences */
    QM_SOUP_FINE,  /* two bytes each, by a scale of the input's choice */
    QM_SOUP_RAW    /* the bits of any double */
} qm_soup_kind;

/** Reads places for the vertices that the soup has. */
void qm_soup_move(qm_soup *soup, qm_bytes *bytes, qm_soup_kind kind, double scale);

/** Reads a soup of one to QM_SOUP_VERTICES vertices; whether it is valid is for qm_mesh_validate to say. */
void qm_soup_read(qm_soup *out, qm_bytes *bytes, qm_soup_kind kind, double scale);

#endif
