/**
 * codec_off.c: OFF: a keyword, counts, a vertex a line, a face a line. Letters before OFF announce more columns after the
 * coordinates (normals, colours, texture), which are left out like every other further column.
 * Source: Geomview manual, OFF Files.
 */
#include "codec_blocks.h"
#include "encoder_internal.h"

#define MIN_VERTEX_SIZE 5 /* "0 0 0" */
#define MIN_FACE_SIZE 7   /* "3 0 0 0" */

static qm_status read_keyword(qm_scan *text)
{
    /* OFF with any of the prefixes ST, C and N. */
    static const char *const keywords[] = {"off",   "coff",   "noff",   "cnoff",
                                           "stoff", "stcoff", "stnoff", "stcnoff"};
    const uint8_t *word, *next;
    size_t size, next_size;
    if (!qm_scan_find_row(text)) return qm_codec_fail(text->report, QM_E_EMPTY, "the file has no data");
    qm_scan_read_word(text, &word, &size);
    for (size_t i = 0; i < sizeof keywords / sizeof *keywords; ++i) {
        if (!qm_scan_word_is(word, size, keywords[i])) continue;
        qm_scan ahead = *text;
        if (!qm_scan_read_word(&ahead, &next, &next_size) || !qm_scan_word_is(next, next_size, "binary"))
            return QM_OK;
        return qm_codec_fail(text->report, QM_E_UNSUPPORTED, "binary OFF is not supported");
    }
    if (size > 3 && qm_scan_word_is(word + size - 3, 3, "off"))
        return qm_codec_fail(text->report, QM_E_UNSUPPORTED,
                             "OFF with other than three coordinates is not supported");
    if (*word < '0' || *word > '9')
        return qm_codec_fail(text->report, QM_E_FORMAT, "the file does not start with OFF or with counts");
    text->at = word;
    qm_codec_warn(text->report, "the file does not start with the word OFF; it was read as if it did");
    return QM_OK;
}

static qm_status check_count(const qm_scan *text, int64_t count, size_t smallest_size, const char *what)
{
    if (count < 0) return qm_codec_fail(text->report, QM_E_FORMAT, "the count of %s is negative", what);
    size_t most = (size_t)(text->end - text->at) / smallest_size;
    if ((uint64_t)count > most)
        return qm_codec_fail(text->report, QM_E_FORMAT,
                             "the header specifies %lld %s, but the file has room for at most %zu",
                             (long long)count, what, most);
    return QM_OK;
}

static qm_status read_counts(qm_builder *builder, qm_scan *text, size_t *vertex_count, size_t *face_count)
{
    if (!qm_scan_find_row(text)) return qm_codec_fail(text->report, QM_E_FORMAT, "the counts are missing");
    int64_t counts[2];
    qm_status status = qm_scan_read_integer(text, &counts[0]);
    if (status == QM_OK) status = qm_scan_read_integer(text, &counts[1]);
    if (status == QM_OK) status = check_count(text, counts[0], MIN_VERTEX_SIZE, "vertices");
    if (status == QM_OK) status = check_count(text, counts[1], MIN_FACE_SIZE, "faces");
    if (status == QM_OK) status = qm_builder_reserve_vertices(builder, (uint64_t)counts[0]);
    if (status == QM_OK) status = qm_builder_reserve_faces(builder, (uint64_t)counts[1]);
    if (status != QM_OK) return status;
    *vertex_count = (size_t)counts[0];
    *face_count = (size_t)counts[1];
    qm_scan_skip_line(text);
    return QM_OK;
}

static qm_status read_vertices(qm_builder *builder, qm_scan *text, size_t done, size_t count)
{
    for (size_t i = done; i < count; ++i) {
        if (!qm_scan_find_row(text))
            return qm_codec_fail(text->report, QM_E_FORMAT, "the file ends after %zu of %zu vertices", i,
                                 count);
        double position[3];
        qm_status status = qm_scan_read_position(text, position);
        if (status == QM_OK) status = qm_builder_add_vertex(builder, position);
        if (status != QM_OK) return status;
        qm_scan_skip_line(text);
    }
    return QM_OK;
}

static qm_status read_any_face(qm_builder *builder, qm_scan *text)
{
    int64_t corner_count;
    qm_status status = qm_scan_read_integer(text, &corner_count);
    if (status != QM_OK) return status;
    for (int64_t i = 0; i < corner_count; ++i) {
        int64_t vertex;
        status = qm_scan_read_integer(text, &vertex);
        if (status != QM_OK) return status;
        if (vertex < 0)
            return qm_codec_fail(text->report, QM_E_INDEX, "face refers to vertex %lld", (long long)vertex);
        if ((uint64_t)vertex >= builder->vertex_count)
            return qm_codec_fail(text->report, QM_E_INDEX,
                                 "face refers to vertex %lld, but the file has %zu vertices, counted from 0",
                                 (long long)vertex, builder->vertex_count);
        status = qm_builder_add_corner(builder, (uint32_t)vertex);
        if (status != QM_OK) return status;
    }
    return qm_builder_end_face(builder);
}

static qm_status read_faces(qm_builder *builder, qm_scan *text, size_t done, size_t count)
{
    for (size_t i = done; i < count; ++i) {
        if (!qm_scan_find_row(text))
            return qm_codec_fail(text->report, QM_E_FORMAT, "the file ends after %zu of %zu faces", i, count);
        uint32_t corners[4];
        qm_status status = qm_scan_plain_face(text, builder->vertex_count, corners)
                               ? qm_builder_add_face(builder, corners)
                               : read_any_face(builder, text);
        if (status != QM_OK) return status;
        qm_scan_skip_line(text);
    }
    return QM_OK;
}

static qm_status read_vertex_block(void *user, size_t index, size_t line_count, qm_scan *text,
                                   qm_builder *builder)
{
    (void)user, (void)index;
    return read_vertices(builder, text, 0, line_count);
}

static qm_status read_face_block(void *user, size_t index, size_t line_count, qm_scan *text,
                                 qm_builder *builder)
{
    (void)user, (void)index;
    return read_faces(builder, text, 0, line_count);
}

static qm_status read_file(qm_builder *builder, qm_scan *text)
{
    size_t vertex_count = 0, face_count = 0;
    qm_status status = read_keyword(text);
    if (status == QM_OK) status = read_counts(builder, text, &vertex_count, &face_count);
    if (status == QM_OK) {
        const qm_block_reader vertices = {
            .rows = QM_BLOCK_VERTICES, .max_lines = vertex_count, .read = read_vertex_block};
        const qm_block_reader faces = {
            .rows = QM_BLOCK_FACES, .max_lines = face_count, .read = read_face_block};
        status = qm_blocks_read(builder, text, &vertices);
        if (status == QM_OK) status = read_vertices(builder, text, builder->vertex_count, vertex_count);
        if (status == QM_OK) status = qm_blocks_read(builder, text, &faces);
        if (status == QM_OK) status = read_faces(builder, text, builder->input_face_count, face_count);
        if (status == QM_OK && qm_scan_find_row(text))
            qm_codec_warn(text->report,
                          "line %zu and the following ones come after the last face and were ignored",
                          text->line);
    }
    return status;
}

qm_status qm_codec_decode_off(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    qm_scan text;
    qm_status status = qm_scan_open(&text, bytes, size, builder->report);
    if (status == QM_OK) status = read_file(builder, &text);
    builder->report->line = text.line;
    return status;
}

/* ---- encoding ---- */

static void add_off_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_printf(out, "OFF\n%zu %zu 0\n", encoder->mesh->vertex_count, encoder->input_faces);
}

static void add_off_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    qm_text_printf(out, "%zu", qm_encoder_corner_count(encoder->mesh, first, end));
    qm_encoder_add_corners(encoder, first, end, 0, out);
}

const qm_encoder_format qm_encoder_off = {NULL, add_off_head, qm_encoder_add_vertex_row, add_off_face};
