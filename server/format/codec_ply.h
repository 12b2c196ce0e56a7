/**
 * codec_ply.h: the internal header of the PLY decoder. codec_ply_header.c reads the text header, which describes elements
 * and their properties, codec_ply.c rows of text, and codec_ply_binary.c binary ones.
 * Source: Turk, The PLY Polygon File Format, 1994.
 */
#ifndef QM_CODEC_PLY_H
#define QM_CODEC_PLY_H

#include "codec_build.h"
#include "codec_scan.h"

typedef enum qm_ply_scalar {
    QM_PLY_INT8,
    QM_PLY_UINT8,
    QM_PLY_INT16,
    QM_PLY_UINT16,
    QM_PLY_INT32,
    QM_PLY_UINT32,
    QM_PLY_FLOAT32,
    QM_PLY_FLOAT64,
    QM_PLY_NO_SCALAR
} qm_ply_scalar;

typedef struct qm_ply_scalar_facts {
    const char *name, *sized_name;
    size_t size;
} qm_ply_scalar_facts;

extern const qm_ply_scalar_facts qm_ply_scalars[QM_PLY_NO_SCALAR];

/** The use of a property: QM_PLY_COORDINATE + axis, QM_PLY_NORMAL + axis, the list of corners, or none. */
typedef enum qm_ply_role {
    QM_PLY_COORDINATE,
    QM_PLY_NORMAL = QM_PLY_COORDINATE + 3,
    QM_PLY_CORNERS = QM_PLY_NORMAL + 3,
    QM_PLY_OTHER
} qm_ply_role;

typedef struct qm_ply_property {
    qm_ply_scalar count_type; /* QM_PLY_NO_SCALAR unless the property is a list */
    qm_ply_scalar type;
    int role;
} qm_ply_property;

typedef enum qm_ply_kind { QM_PLY_VERTICES, QM_PLY_FACES, QM_PLY_OTHERS } qm_ply_kind;

typedef struct qm_ply_element {
    qm_ply_kind kind;
    uint64_t count;
    size_t first_property, property_count;
} qm_ply_element;

typedef enum qm_ply_encoding {
    QM_PLY_NO_ENCODING,
    QM_PLY_ASCII,
    QM_PLY_LITTLE_ENDIAN_BINARY,
    QM_PLY_BIG_ENDIAN_BINARY
} qm_ply_encoding;

typedef struct qm_ply_reader {
    qm_builder *builder;
    qm_codec_report *report;
    qm_scan text;         /* the header, and the rows of a text file */
    const uint8_t *bytes; /* the whole file; rows of a binary file are read at text.at */
    qm_ply_encoding encoding;
    bool swaps_bytes;
    qm_ply_element *elements;
    size_t element_count, element_capacity;
    qm_ply_property *properties;
    size_t property_count, property_capacity;
    uint64_t vertex_count; /* of the header */
    bool has_normals;      /* it is a point set with three normal properties */
} qm_ply_reader;

static inline bool qm_ply_is_float(qm_ply_scalar type)
{
    return type == QM_PLY_FLOAT32 || type == QM_PLY_FLOAT64;
}

/** Returns QM_E_FORMAT with this detail. */
qm_status qm_ply_fail(qm_ply_reader *reader, const char *detail);

/** Reads the header up to the first row. */
qm_status qm_ply_read_header(qm_ply_reader *reader);

/** Adds a corner to the current face; its vertex must be below the count of the header. */
qm_status qm_ply_add_corner(qm_ply_reader *reader, int64_t vertex);

/** Ends a row of an element: adds its face or vertex to the mesh. value has the coordinates and the normal by their
 * roles. */
qm_status qm_ply_end_row(qm_ply_reader *reader, qm_ply_kind kind, const double value[QM_PLY_CORNERS]);

/** Reads the rows of an element of a binary file, checking its size. */
qm_status qm_ply_read_binary_rows(qm_ply_reader *reader, const qm_ply_element *element);

#endif
