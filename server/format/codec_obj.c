/**
 * codec_obj.c: OBJ: one pass over the text. Faces may come before their vertices, so an index is checked against the count
 * only at the end; the line of the largest one is kept for the message. Texture and normal indices are read
 * and forgotten, as are the statements that carry no geometry.
 */
#include "codec_blocks.h"
#include "encoder_internal.h"

typedef struct obj_reader {
    qm_scan text;
    qm_builder *builder;
    uint32_t max_index; /* from 1; 0 before the first face */
    size_t largest_line;
    size_t skipped_count; /* statements of unsupported geometry, or unknown ones */
} obj_reader;

static qm_status fail_corner(obj_reader *reader)
{
    return qm_codec_fail(reader->text.report, QM_E_FORMAT,
                         "a corner of a face is not of the form v, v/vt, v//vn or v/vt/vn");
}

/** Skips "/vt", "//vn" or "/vt/vn". */
static bool skip_attribute_indices(qm_scan *text)
{
    for (int i = 0; i < 2 && text->at < text->end && *text->at == '/'; ++i) {
        ++text->at;
        int64_t index;
        bool overflow;
        if (!qm_scan_bare_integer(text, &index, &overflow) && overflow) return false;
    }
    return qm_scan_at_row_end(text) || qm_scan_is_blank(*text->at) || *text->at == '\\';
}

/** Updates the max index, from 1, and its line. */
static void note_index(obj_reader *reader, uint32_t index)
{
    if (index <= reader->max_index) return;
    reader->max_index = index;
    reader->largest_line = reader->text.line;
}

/** Converts an index of the file, from 1 or backward from -1, to one from 0. */
static qm_status resolve_index(obj_reader *reader, int64_t index, uint32_t *vertex)
{
    const qm_builder *builder = reader->builder;
    if (index == 0)
        return qm_codec_fail(builder->report, QM_E_INDEX,
                             "face refers to vertex 0, but vertices count from 1");
    if (index < 0 && (uint64_t)-index > builder->vertex_count)
        return qm_codec_fail(builder->report, QM_E_INDEX,
                             "face refers back to vertex %lld, but only %zu vertices come before it",
                             (long long)index, builder->vertex_count);
    if (index > (int64_t)builder->limits->max_vertices)
        return qm_codec_fail(builder->report, QM_E_INDEX,
                             "face refers to vertex %lld, but no file may have more than %zu vertices",
                             (long long)index, builder->limits->max_vertices);
    *vertex = (uint32_t)(index > 0 ? index - 1 : (int64_t)builder->vertex_count + index);
    note_index(reader, *vertex + 1);
    return QM_OK;
}

static qm_status read_corner(obj_reader *reader)
{
    int64_t index;
    bool overflow;
    if (!qm_scan_bare_integer(&reader->text, &index, &overflow)) {
        if (!overflow) return fail_corner(reader);
        return qm_codec_fail(reader->text.report, QM_E_INDEX, "face refers to a vertex beyond 63 bits");
    }
    if (!skip_attribute_indices(&reader->text)) return fail_corner(reader);
    uint32_t vertex = 0;
    qm_status status = resolve_index(reader, index, &vertex);
    return status == QM_OK ? qm_builder_add_corner(reader->builder, vertex) : status;
}

static qm_status read_any_face(obj_reader *reader)
{
    for (;;) {
        qm_scan_skip_blanks(&reader->text);
        if (qm_scan_at_row_end(&reader->text)) return qm_builder_end_face(reader->builder);
        qm_status status = read_corner(reader);
        if (status != QM_OK) return status;
    }
}

/** The fast path for a triangle or quad of plain indices; false, without reading anything, for other faces. */
static bool read_plain_corners(obj_reader *reader, uint32_t corners[4])
{
    const qm_scan *text = &reader->text;
    if (text->end - text->at < QM_SCAN_CORNERS_SIZE) return false;
    const uint8_t *at = qm_scan_short_corners(text->at, 3, corners);
    const bool is_quad = at && *at == ' ';
    if (is_quad) at = qm_scan_short_integer(at + 1, &corners[3]);
    if (!at || !qm_scan_is_line_end(*at)) return false;
    if (!is_quad) corners[3] = corners[0];
    uint32_t least = UINT32_MAX, most = 0;
    for (int i = 0; i < 4; ++i) {
        least = corners[i] < least ? corners[i] : least;
        most = corners[i] > most ? corners[i] : most;
        --corners[i];
    }
    if (!is_quad) corners[3] = QM_NO_INDEX;
    if (least == 0 || most > reader->builder->limits->max_vertices) return false;
    note_index(reader, most);
    reader->text.at = at;
    return true;
}

static qm_status read_statement(obj_reader *reader)
{
    const uint8_t *word = reader->text.at;
    size_t size;
    if (reader->text.end - word >= 2 && word[1] == ' ') { /* nearly all words have one letter */
        size = 1;
        ++reader->text.at;
    } else if (!qm_scan_read_word(&reader->text, &word, &size)) {
        return QM_OK;
    }
    if (size == 1 && *word == 'v') {
        double position[3];
        qm_status status = qm_scan_read_position(&reader->text, position);
        if (status == QM_OK) status = qm_builder_add_vertex(reader->builder, position);
        return status;
    }
    if (size == 1 && *word == 'f') {
        uint32_t corners[4];
        return read_plain_corners(reader, corners) ? qm_builder_add_face(reader->builder, corners)
                                                   : read_any_face(reader);
    }
    /* Statements about appearance and names, and attributes of vertices. */
    static const char *const known[] = {"vt", "vn", "g", "o", "s", "mg", "usemtl", "mtllib", "usemap", "lod"};
    for (size_t i = 0; i < sizeof known / sizeof *known; ++i)
        if (qm_scan_word_is(word, size, known[i])) return QM_OK;
    ++reader->skipped_count;
    return QM_OK;
}

static qm_status read_statements(obj_reader *reader)
{
    qm_scan *text = &reader->text;
    while (qm_scan_find_row(text)) {
        qm_status status = read_statement(reader);
        if (status != QM_OK) return status;
        qm_scan_skip_statement(text);
    }
    return QM_OK;
}

/** Results of blocks besides vertices and faces. */
typedef struct obj_blocks {
    obj_reader *whole;
    obj_reader part[QM_BLOCKS_BATCH];
} obj_blocks;

static qm_status read_block(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder)
{
    obj_reader *part = &((obj_blocks *)user)->part[index];
    (void)line_count;
    *part = (obj_reader){.text = *text, .builder = builder};
    qm_status status = read_statements(part);
    *text = part->text;
    return status;
}

static void take_block(void *user, size_t index)
{
    obj_reader *whole = ((obj_blocks *)user)->whole;
    const obj_reader *part = &((obj_blocks *)user)->part[index];
    if (part->max_index > whole->max_index) {
        whole->max_index = part->max_index;
        whole->largest_line = part->largest_line;
    }
    whole->skipped_count += part->skipped_count;
}

static qm_status read_file(obj_reader *reader)
{
    const qm_scan *text = &reader->text;
    obj_blocks blocks;
    blocks.whole = reader;
    const qm_block_reader of_words = {
        .rows = QM_BLOCK_WORDS, .read = read_block, .take = take_block, .user = &blocks};
    qm_status status = qm_blocks_read(reader->builder, &reader->text, &of_words);
    if (status == QM_OK) status = read_statements(reader);
    if (status != QM_OK) return status;
    if (reader->max_index > reader->builder->vertex_count) {
        reader->text.line = reader->largest_line;
        return qm_builder_fail_index(reader->builder, reader->max_index);
    }
    if (reader->skipped_count > 0)
        qm_codec_warn(
            text->report,
            "statements that are neither vertices nor faces, such as lines and curves: %zu (ignored)",
            reader->skipped_count);
    return QM_OK;
}

qm_status qm_codec_decode_obj(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    obj_reader reader = {.builder = builder};
    qm_status status = qm_scan_open(&reader.text, bytes, size, builder->report);
    if (status == QM_OK) status = read_file(&reader);
    builder->report->line = reader.text.line;
    return status;
}

/* ---- encoding ---- */

static void add_obj_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_printf(out, "# %zu vertices, %zu faces\n", encoder->mesh->vertex_count, encoder->input_faces);
}

static qm_status prepare_obj(qm_encoder *encoder)
{
    if (encoder->uv) encoder->row_count += encoder->uv->mesh.vertex_count;
    return QM_OK;
}

/** A vertex, or, after them all, a texture coordinate. */
static void add_obj_vertex(const qm_encoder *encoder, size_t row, qm_text *out)
{
    size_t count = encoder->mesh->vertex_count;
    if (row < count) {
        qm_encoder_add_position(encoder, row, "v ", out);
        return;
    }
    char u[QM_NUMBER_SIZE], v[QM_NUMBER_SIZE];
    const double *uv = encoder->uv->uv + 2 * (row - count);
    qm_text_printf(out, "vt %s %s\n", qm_text_number(uv[0], u), qm_text_number(uv[1], v));
}

static void add_obj_face(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    qm_text_add_string(out, "f");
    if (!encoder->uv) {
        qm_encoder_add_corners(encoder, first, end, 1, out);
        return;
    }
    size_t count = qm_encoder_corner_count(encoder->mesh, first, end);
    for (size_t i = 0; i < count; i++)
        qm_text_printf(out, " %u/%u", qm_encoder_corner(encoder->mesh, first, i) + 1,
                       qm_encoder_corner(&encoder->uv->mesh, first, i) + 1);
    qm_text_add_string(out, "\n");
}

const qm_encoder_format qm_encoder_obj = {prepare_obj, add_obj_head, add_obj_vertex, add_obj_face, true};
