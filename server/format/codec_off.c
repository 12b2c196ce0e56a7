/**
 * codec_off.c: OFF: a keyword, counts, a vertex a line, a face a line. Letters before OFF announce more columns after the
 * coordinates (normals, colours, texture), which are left out like every other further column. With the word BINARY behind
 * the keyword the same numbers follow as big-endian 32-bit integers and floats, and each face has the count of its
 * colour's components behind its corners.
 * Source: Geomview manual, OFF Files.
 */
#include <math.h>

#include "codec_blocks.h"
#include "encoder_internal.h"

#define MIN_VERTEX_SIZE 5 /* "0 0 0" */
#define MIN_FACE_SIZE 7   /* "3 0 0 0" */
#define MIN_BINARY_FACE_SIZE 20

/** The numbers of a vertex behind its coordinates: of a normal, a colour and a texture coordinate. */
static size_t count_extras(const uint8_t *word, size_t size)
{
    const bool has_texture = size >= 2 && qm_scan_word_is(word, 2, "st");
    size_t count = has_texture ? 2 : 0;
    for (size_t i = has_texture ? 2 : 0; i + 3 < size; ++i)
        count += qm_scan_to_lower(word[i]) == 'c' ? 4 : 3;
    return count;
}

/** Reads the word OFF with its letters; *has_binary when the bytes of a binary file follow. */
static qm_status read_keyword(qm_scan *text, bool *has_binary, size_t *extras)
{
    /* OFF with any of the prefixes ST, C and N. */
    static const char *const keywords[] = {"off",   "coff",   "noff",   "cnoff",
                                           "stoff", "stcoff", "stnoff", "stcnoff"};
    const uint8_t *word, *next;
    size_t size, next_size;
    char shown[QM_SCAN_SHOWN_SIZE];
    *has_binary = false;
    if (!qm_scan_find_row(text)) return qm_codec_fail(text->report, QM_E_EMPTY, "the file has no data");
    qm_scan_read_word(text, &word, &size);
    const bool is_off = size >= 3 && qm_scan_word_is(word + size - 3, 3, "off");
    const uint8_t letter = is_off && size > 3 ? word[size - 4] : 0;
    /* A small n before capitals stands for n coordinates, a large one for normals. */
    if (letter == '4' || (letter == 'n' && word[size - 3] == 'O'))
        return qm_codec_fail(text->report, QM_E_UNSUPPORTED,
                             "\"%s\" has vertices of %s coordinates, not three; it is not supported",
                             qm_scan_show(word, size, shown), letter == '4' ? "four" : "n");
    for (size_t i = 0; i < sizeof keywords / sizeof *keywords; ++i) {
        if (!qm_scan_word_is(word, size, keywords[i])) continue;
        *extras = count_extras(word, size);
        qm_scan ahead = *text;
        *has_binary =
            qm_scan_read_word(&ahead, &next, &next_size) && qm_scan_word_is(next, next_size, "binary");
        if (*has_binary) *text = ahead;
        return QM_OK;
    }
    if (*word < '0' || *word > '9')
        return qm_codec_fail(text->report, QM_E_FORMAT,
                             "the file starts with \"%s\", not with OFF or with counts",
                             qm_scan_show(word, size, shown));
    text->at = word;
    qm_codec_warn(text->report, "the file does not start with the word OFF; it was read as if it did");
    return QM_OK;
}

/** Checks a count of the head against the bytes that are left. */
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

static qm_status read_text(qm_builder *builder, qm_scan *text)
{
    size_t vertex_count = 0, face_count = 0;
    qm_status status = read_counts(builder, text, &vertex_count, &face_count);
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

/* ---- binary ---- */

/** Reads a big-endian integer; false at the end of the file. */
static bool read_integer(qm_scan *file, int32_t *integer)
{
    if (file->end - file->at < 4) return false;
    uint32_t bits;
    memcpy(&bits, file->at, sizeof bits);
    *integer = (int32_t)be32toh(bits);
    file->at += sizeof bits;
    return true;
}

static qm_status fail_short(const qm_scan *file, size_t done, size_t count, const char *what)
{
    return qm_codec_fail(file->report, QM_E_FORMAT, "the file ends after %zu of %zu %s", done, count, what);
}

static qm_status read_binary_vertices(qm_builder *builder, qm_scan *file, size_t count, size_t extras)
{
    for (size_t i = 0; i < count; ++i) {
        double position[3];
        int32_t bits;
        for (int axis = 0; axis < 3; ++axis) {
            float single;
            if (!read_integer(file, &bits)) return fail_short(file, i, count, "vertices");
            memcpy(&single, &bits, sizeof single);
            position[axis] = (double)single;
            if (isfinite(single)) continue;
            file->at -= sizeof bits;
            return qm_codec_fail(file->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
        }
        if ((size_t)(file->end - file->at) < 4 * extras) return fail_short(file, i, count, "vertices");
        file->at += 4 * extras;
        qm_status status = qm_builder_add_vertex(builder, position);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status read_binary_faces(qm_builder *builder, qm_scan *file, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        int32_t corner_count, vertex, components;
        if (!read_integer(file, &corner_count)) return fail_short(file, i, count, "faces");
        for (int32_t k = 0; k < corner_count; ++k) {
            if (!read_integer(file, &vertex)) return fail_short(file, i, count, "faces");
            if (vertex < 0 || (size_t)vertex >= builder->vertex_count) {
                file->at -= sizeof vertex;
                return qm_codec_fail(
                    file->report, QM_E_INDEX,
                    "face refers to vertex %d, but the file has %zu vertices, counted from 0", (int)vertex,
                    builder->vertex_count);
            }
            qm_status status = qm_builder_add_corner(builder, (uint32_t)vertex);
            if (status != QM_OK) return status;
        }
        qm_status status = qm_builder_end_face(builder);
        if (status != QM_OK) return status;
        if (!read_integer(file, &components)) return fail_short(file, i, count, "faces");
        if (components < 0 || components > (file->end - file->at) / 4)
            return qm_codec_fail(file->report, QM_E_FORMAT, "the colour of a face has %d components",
                                 (int)components);
        file->at += 4 * (size_t)components;
    }
    return QM_OK;
}

/** Reads what follows the line of the keyword. */
static qm_status read_binary(qm_builder *builder, qm_scan *file, size_t extras)
{
    enum { VERTICES, FACES, EDGES, COUNTS };
    int32_t counts[COUNTS];
    while (file->at < file->end && qm_scan_is_blank(*file->at))
        ++file->at;
    if (file->at < file->end && *file->at == '\r') ++file->at;
    if (file->at == file->end || *file->at++ != '\n')
        return qm_codec_fail(file->report, QM_E_FORMAT, "the word BINARY is not followed by a line end");
    for (int i = 0; i < COUNTS; ++i)
        if (!read_integer(file, &counts[i]))
            return qm_codec_fail(file->report, QM_E_FORMAT, "the counts are missing");
    qm_status status = check_count(file, counts[VERTICES], 4 * (3 + extras), "vertices");
    if (status == QM_OK) status = check_count(file, counts[FACES], MIN_BINARY_FACE_SIZE, "faces");
    if (status == QM_OK) status = qm_builder_reserve_vertices(builder, (uint64_t)counts[VERTICES]);
    if (status == QM_OK) status = qm_builder_reserve_faces(builder, (uint64_t)counts[FACES]);
    if (status == QM_OK) status = read_binary_vertices(builder, file, (size_t)counts[VERTICES], extras);
    if (status == QM_OK) status = read_binary_faces(builder, file, (size_t)counts[FACES]);
    if (status == QM_OK && file->at < file->end)
        qm_codec_warn(file->report, "bytes after the last face: %zu (ignored)",
                      (size_t)(file->end - file->at));
    return status;
}

/* ---- the file ---- */

qm_status qm_codec_decode_off(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    qm_scan text = {.at = bytes, .end = bytes + size, .line = 1, .report = builder->report}, whole;
    bool has_binary;
    size_t extras;
    qm_scan_skip_mark(&text);
    qm_status status = read_keyword(&text, &has_binary, &extras);
    if (has_binary) {
        status = read_binary(builder, &text, extras);
        builder->report->offset = (size_t)(text.at - bytes);
        return status;
    }
    /* Opening the file as text checks all of it for NUL bytes. */
    if (status == QM_OK) {
        status = qm_scan_open(&whole, bytes, size, builder->report);
        if (status != QM_OK) text = whole;
    }
    if (status == QM_OK) status = read_text(builder, &text);
    builder->report->line = text.line;
    return status;
}

/* ---- encoding ---- */

static void add_off_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_printf(out, "OFF\n%zu %zu 0\n", encoder->mesh->vertex_count, encoder->input_faces);
}

static void add_off_face(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    qm_text_printf(out, "%zu", qm_encoder_corner_count(encoder->mesh, first, end));
    qm_encoder_add_corners(encoder, first, end, 0, out);
}

const qm_encoder_format qm_encoder_off = {NULL, add_off_head, qm_encoder_add_vertex_row, add_off_face, false};
