/**
 * codec_drc_head.c: The head of a Draco file. Source: Draco bitstream specification 2.2, sections 4 and 5.
 */
#include "codec_drc.h"

typedef struct drc_head {
    const uint8_t *at, *end;
} drc_head;

#define MAGIC "DRACO"
#define HEAD_SIZE 11
#define HAS_METADATA 0x8000
#define DEEPEST_METADATA 64
/* 2.2 tells the number of points again behind the head, and Draco sizes its arrays by it */
#define FIRST_SAFE_KD_TREE 3

static bool skip_bytes(drc_head *head, uint64_t size)
{
    if ((uint64_t)(head->end - head->at) < size) return false;
    head->at += size;
    return true;
}

/** Seven bits a byte, the low ones first. */
static bool read_varint(drc_head *head, uint64_t *number)
{
    *number = 0;
    for (unsigned shift = 0; shift < 63; shift += 7) {
        if (head->at == head->end) return false;
        uint8_t byte = *head->at++;
        *number |= (uint64_t)(byte & 0x7f) << shift;
        if (!(byte & 0x80)) return true;
    }
    return false;
}

static bool skip_name(drc_head *head)
{
    return head->at < head->end && skip_bytes(head, 1 + (uint64_t)*head->at);
}

/** One table of named values, and the tables within it. */
static bool skip_metadata(drc_head *head, int depth)
{
    uint64_t count, size;
    if (depth > DEEPEST_METADATA || !read_varint(head, &count)) return false;
    for (; count > 0; --count)
        if (!skip_name(head) || !read_varint(head, &size) || !skip_bytes(head, size)) return false;
    if (!read_varint(head, &count)) return false;
    for (; count > 0; --count)
        if (!skip_name(head) || !skip_metadata(head, depth + 1)) return false;
    return true;
}

static bool skip_all_metadata(drc_head *head)
{
    uint64_t attribute_count, id;
    if (!read_varint(head, &attribute_count)) return false;
    for (; attribute_count > 0; --attribute_count)
        if (!read_varint(head, &id) || !skip_metadata(head, 0)) return false;
    return skip_metadata(head, 0);
}

/** Vertices and faces as the head announces them. */
static bool read_counts(drc_head *head, bool is_mesh, bool is_edgebreaker, uint64_t *vertices,
                        uint64_t *faces)
{
    *faces = 0;
    if (!is_mesh) {
        if (head->end - head->at < 4) return false;
        *vertices = qm_read_u32_le(head->at);
        return true;
    }
    if (!is_edgebreaker) return read_varint(head, faces) && read_varint(head, vertices);
    return skip_bytes(head, 1) && read_varint(head, vertices) && read_varint(head, faces);
}

qm_status qm_drc_check_head(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    size_t *offset = &builder->report->offset;
    *offset = 0;
    if (size < HEAD_SIZE || memcmp(bytes, MAGIC, strlen(MAGIC)) != 0)
        return qm_codec_fail(builder->report, QM_E_FORMAT, "the file does not start like a Draco file");
    *offset = strlen(MAGIC);
    if (bytes[5] != 2 || bytes[6] < 2)
        return qm_codec_fail(builder->report, QM_E_UNSUPPORTED,
                             "only version 2.2 and later of the Draco format is supported");
    if (bytes[7] == 0 && bytes[8] == 1 && bytes[6] < FIRST_SAFE_KD_TREE)
        return qm_codec_fail(
            builder->report, QM_E_UNSUPPORTED,
            "point clouds in a kd-tree are supported from version 2.3 of the Draco format on");
    drc_head head = {bytes + HEAD_SIZE, bytes + size};
    bool has_metadata = (bytes[9] | bytes[10] << 8) & HAS_METADATA;
    uint64_t vertices, faces;
    bool whole = (!has_metadata || skip_all_metadata(&head)) &&
                 read_counts(&head, bytes[7] == 1, bytes[8] == 1, &vertices, &faces);
    *offset = (size_t)(head.at - bytes);
    if (!whole) return qm_codec_fail(builder->report, QM_E_FORMAT, "the header of the file is invalid");
    if (vertices > builder->limits->max_vertices || faces > builder->limits->max_faces)
        return qm_codec_fail(builder->report, QM_E_TOO_LARGE,
                             "the file has more than %zu vertices or more than %zu faces",
                             builder->limits->max_vertices, builder->limits->max_faces);
    return QM_OK;
}
