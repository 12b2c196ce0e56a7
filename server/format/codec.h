/**
 * codec.h: decodes files to meshes. Files are untrusted: every count is checked against the size of the file before
 * memory is allocated, and errors have a line or byte offset.
 */
#ifndef QM_CODEC_H
#define QM_CODEC_H

#include "base/notes.h"
#include "qm/mesh.h"

/**
 * The table of formats: XX(number, suffix, name, media type, magic). A row and the file codec_NAME.c, which decodes and
 * encodes, make a format. The number is stored with meshes; the name is also the extension; the magic is the start of
 * all files of a binary format, "" for others. Replies prefer the first row, which is short and exact.
 */
#define QM_FORMAT_MAP(XX)                                                                                    \
    XX(2, PLY, ply, "application/x-ply", "")                                                                 \
    XX(1, OBJ, obj, "model/obj", "")                                                                         \
    XX(3, STL, stl, "model/stl", "")                                                                         \
    XX(4, OFF, off, "application/x-off", "")                                                                 \
    XX(5, GLB, glb, "model/gltf-binary", "glTF")                                                             \
    XX(6, DRC, drc, "application/x-draco", "DRACO")                                                          \
    XX(7, XYZ, xyz, "text/x-xyz", "")                                                                        \
    XX(8, PCD, pcd, "application/x-pcd", "")                                                                 \
    XX(9, 3MF, 3mf, "model/3mf", "PK\x03\x04")

typedef enum qm_format {
    QM_FORMAT_UNKNOWN,
#define XX(number, suffix, name, media, magic) QM_FORMAT_##suffix = number,
    QM_FORMAT_MAP(XX)
#undef XX
} qm_format;

/** The format of a name ("ply"), of the extension of a path (before a ".gz"), or of a media type (without its
 * parameters); QM_FORMAT_UNKNOWN if there is none. */
qm_format qm_format_from_name(const char *name);
qm_format qm_format_from_path(const char *path);
qm_format qm_format_from_media_type(const char *media_type);
const char *qm_format_name(qm_format format);
const char *qm_format_media_type(qm_format format);

/** The names for messages, each after a blank. */
#define QM_FORMAT_NAME(number, suffix, name, media, magic) " " #name
#define QM_FORMAT_NAMES QM_FORMAT_MAP(QM_FORMAT_NAME)

/** The format by the first bytes of the file, and by size for binary STL; QM_FORMAT_UNKNOWN if there is none. */
qm_format qm_format_sniff(const uint8_t *bytes, size_t size);

typedef struct qm_codec_limits {
    size_t max_vertices, max_faces; /* QM_E_TOO_LARGE beyond; at most QM_NO_INDEX - 1 */
    int thread_count;               /* for large texts; ctx->parallel is needed for more than one */
    size_t max_size;                /* bytes that a compressed file may inflate to; 0: no limit */
    const char
        *folder; /* of the files that the text form of glTF names, "" or with a slash at its end; NULL: such
                           a file is refused */
} qm_codec_limits;

#define QM_NO_LOCATION SIZE_MAX /* no line, or no offset */
#define QM_CODEC_WARNING_COUNT 8
#define QM_CODEC_DETAIL_SIZE 256

/** The report of a decoder: the location of an error, or warnings about everything that was dropped or changed. */
typedef struct qm_codec_report {
    size_t line;                       /* of the error, from 1; QM_NO_LOCATION for binary formats */
    size_t offset;                     /* of the error in bytes from 0; QM_NO_LOCATION for text formats */
    char detail[QM_CODEC_DETAIL_SIZE]; /* UTF-8, one sentence; of the file it has printable words only */
    char warnings[QM_CODEC_WARNING_COUNT][QM_CODEC_DETAIL_SIZE];
    size_t warning_count;
    char unit[QM_UNIT_SIZE]; /* of the coordinates, where format or file tell; "" else */
} qm_codec_report;

/**
 * Decodes a whole file. On success the mesh passes qm_mesh_validate and is the caller's, for qm_mesh_reset.
 * Quads stay quads; polygons become fans (mesh.h); STL corners with the same coordinates are welded; a mesh
 * with vertices and no face is a point set.
 *
 * Returns QM_OK; QM_E_FORMAT, QM_E_UNSUPPORTED, QM_E_NOT_FINITE, QM_E_INDEX, QM_E_EMPTY, QM_E_TOO_LARGE with
 * report->detail and the location; QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is all zero.
 */
qm_status qm_codec_decode(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                          const qm_codec_limits *limits, qm_mesh *out, qm_codec_report *report);

/** The size of a mesh in a file. */
typedef struct qm_codec_counts {
    size_t vertices, faces, quads; /* faces as stored: polygons count as their triangles */
    bool is_exact;                 /* else there may be more: equal vertices are not merged, for example */
} qm_codec_counts;

/**
 * Counts the vertices and faces of a file as qm_codec_decode would store them, without memory for them. A file that
 * cannot be decoded fails alike, but for faces that refer to missing vertices.
 */
qm_status qm_codec_count(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                         const qm_codec_limits *limits, qm_codec_counts *out, qm_codec_report *report);

#endif
