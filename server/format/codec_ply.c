/**
 * codec_ply.c: PLY: a text header that describes elements and their properties, then their rows as text or as binary in
 * either byte order. The coordinates are the properties x, y, z of the element vertex, the corners the list
 * vertex_indices or vertex_index of the element face. Of a point set the properties nx, ny, nz are kept too;
 * everything else is stepped over by its declared size.
 */
#include "codec_ply.h"
#include "codec_blocks.h"

/** The min size of a row: lists are empty, except for the corners of a triangle. */
static size_t smallest_row(const qm_ply_reader *reader, const qm_ply_element *element)
{
    size_t size = 0;
    for (size_t i = 0; i < element->property_count; ++i) {
        const qm_ply_property *property = &reader->properties[element->first_property + i];
        bool is_list = property->count_type != QM_PLY_NO_SCALAR;
        size_t values = property->role == QM_PLY_CORNERS ? 3 : !is_list;
        if (reader->encoding == QM_PLY_ASCII)
            size += 2 * (values + is_list);
        else
            size += (is_list ? qm_ply_scalars[property->count_type].size : 0) +
                    values * qm_ply_scalars[property->type].size;
    }
    return size;
}

/** Checks the count of the header against the remaining bytes, and reserves arrays. */
static qm_status start_element(qm_ply_reader *reader, const qm_ply_element *element)
{
    uint64_t left = (uint64_t)(reader->text.end - reader->text.at);
    if (reader->encoding == QM_PLY_ASCII) ++left; /* the last line end is optional */
    size_t row = smallest_row(reader, element);
    if (row > 0 && element->count > left / row)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %llu rows of an element, but the file has room for %llu",
                             (unsigned long long)element->count, (unsigned long long)(left / row));
    if (element->kind == QM_PLY_VERTICES) return qm_builder_reserve_vertices(reader->builder, element->count);
    if (element->kind == QM_PLY_FACES) return qm_builder_reserve_faces(reader->builder, element->count);
    return QM_OK;
}

qm_status qm_ply_add_corner(qm_ply_reader *reader, int64_t vertex)
{
    if (vertex < 0 || (uint64_t)vertex >= reader->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %lld, but the file has %llu vertices, counted from 0",
                             (long long)vertex, (unsigned long long)reader->vertex_count);
    return qm_builder_add_corner(reader->builder, (uint32_t)vertex);
}

qm_status qm_ply_end_row(qm_ply_reader *reader, qm_ply_kind kind, const double value[QM_PLY_CORNERS])
{
    if (kind == QM_PLY_FACES) return qm_builder_end_face(reader->builder);
    if (kind != QM_PLY_VERTICES) return QM_OK;
    qm_status status = qm_builder_add_vertex(reader->builder, value + QM_PLY_COORDINATE);
    if (status != QM_OK || !reader->has_normals) return status;
    return qm_builder_set_normal(reader->builder, value + QM_PLY_NORMAL);
}

static qm_status read_text_list(qm_ply_reader *reader, const qm_ply_property *property)
{
    int64_t length;
    qm_status status = qm_scan_read_integer(&reader->text, &length);
    if (status == QM_OK && length < 0) return qm_ply_fail(reader, "the length of a list is negative");
    for (int64_t i = 0; status == QM_OK && i < length; ++i) {
        int64_t vertex;
        double ignored;
        if (property->role != QM_PLY_CORNERS) {
            status = qm_scan_read_number(&reader->text, &ignored);
            continue;
        }
        status = qm_scan_read_integer(&reader->text, &vertex);
        if (status == QM_OK) status = qm_ply_add_corner(reader, vertex);
    }
    return status;
}

/** Whether rows have only the three coordinates in order, or only the corners of a face. */
static bool is_plain(const qm_ply_reader *reader, const qm_ply_element *element)
{
    const qm_ply_property *first = reader->properties + element->first_property;
    if (element->kind == QM_PLY_FACES) return element->property_count == 1 && first->role == QM_PLY_CORNERS;
    bool is_position = element->kind == QM_PLY_VERTICES && element->property_count == 3;
    for (int axis = 0; is_position && axis < 3; ++axis)
        is_position = first[axis].role == QM_PLY_COORDINATE + axis;
    return is_position;
}

/** The fast path for such rows; false, without reading anything, for others. */
static bool read_plain_row(qm_ply_reader *reader, qm_ply_kind kind, qm_status *status)
{
    qm_scan *text = &reader->text;
    const uint8_t *at = text->at;
    double position[3];
    uint32_t corners[4];
    bool is_read = kind == QM_PLY_FACES ? qm_scan_plain_face(text, reader->vertex_count, corners)
                                        : qm_scan_plain_position(text, position);
    if (!is_read || !qm_scan_is_line_end(*text->at)) {
        text->at = at;
        return false;
    }
    *status = kind == QM_PLY_FACES ? qm_builder_add_face(reader->builder, corners)
                                   : qm_builder_add_vertex(reader->builder, position);
    return true;
}

static qm_status read_text_row(qm_ply_reader *reader, const qm_ply_element *element)
{
    double value[QM_PLY_CORNERS] = {0}, ignored;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < element->property_count; ++i) {
        const qm_ply_property *property = &reader->properties[element->first_property + i];
        if (property->count_type != QM_PLY_NO_SCALAR)
            status = read_text_list(reader, property);
        else
            status = qm_scan_read_number(&reader->text,
                                         property->role < QM_PLY_CORNERS ? &value[property->role] : &ignored);
    }
    qm_scan_skip_blanks(&reader->text);
    if (status == QM_OK && !qm_scan_at_row_end(&reader->text))
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the row has more values than the header describes");
    return status == QM_OK ? qm_ply_end_row(reader, element->kind, value) : status;
}

static qm_status read_text_rows(qm_ply_reader *reader, const qm_ply_element *element, uint64_t done)
{
    if (element->property_count == 0) return QM_OK;
    const bool plain = is_plain(reader, element);
    for (uint64_t i = done; i < element->count; ++i) {
        if (!qm_scan_find_row(&reader->text))
            return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends after %llu of %llu rows",
                                 (unsigned long long)i, (unsigned long long)element->count);
        qm_status status;
        if (!plain || !read_plain_row(reader, element->kind, &status))
            status = read_text_row(reader, element);
        if (status != QM_OK) return status;
        qm_scan_skip_line(&reader->text);
    }
    return QM_OK;
}

typedef struct element_reader {
    const qm_ply_reader *reader;
    const qm_ply_element *element;
} element_reader;

static qm_status read_block(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder)
{
    const element_reader *whole = user;
    qm_ply_element rows = *whole->element;
    qm_ply_reader reader = *whole->reader;
    (void)index;
    rows.count = line_count;
    reader.builder = builder;
    reader.report = builder->report;
    reader.text = *text;
    qm_status status = read_text_rows(&reader, &rows, 0);
    *text = reader.text;
    return status;
}

/** Reads rows of one line each on several threads, as many as possible; *done counts them. */
static qm_status read_blocks(qm_ply_reader *reader, const qm_ply_element *element, uint64_t *done)
{
    const size_t first_line = reader->text.line;
    element_reader user = {.reader = reader, .element = element};
    const qm_block_reader rows = {.rows = element->kind == QM_PLY_FACES ? QM_BLOCK_FACES : QM_BLOCK_VERTICES,
                                  .max_lines = element->count,
                                  .read = read_block,
                                  .user = &user};
    *done = 0;
    if (element->kind == QM_PLY_OTHERS || reader->has_normals) return QM_OK;
    qm_status status = qm_blocks_read(reader->builder, &reader->text, &rows);
    *done = reader->text.line - first_line;
    return status;
}

static qm_status read_text_element(qm_ply_reader *reader, const qm_ply_element *element)
{
    uint64_t done;
    qm_status status = read_blocks(reader, element, &done);
    return status == QM_OK ? read_text_rows(reader, element, done) : status;
}

static void warn_about_rest(qm_ply_reader *reader)
{
    if (reader->encoding == QM_PLY_ASCII) {
        if (qm_scan_find_row(&reader->text))
            qm_codec_warn(reader->report,
                          "line %zu and the following ones come after the last row and were ignored",
                          reader->text.line);
    } else if (reader->text.at < reader->text.end) {
        qm_codec_warn(reader->report, "bytes after the last row: %zu (ignored)",
                      (size_t)(reader->text.end - reader->text.at));
    }
}

static qm_status read_rows(qm_ply_reader *reader)
{
    for (size_t i = 0; i < reader->element_count; ++i) {
        const qm_ply_element *element = &reader->elements[i];
        qm_status status = start_element(reader, element);
        if (status == QM_OK)
            status = reader->encoding == QM_PLY_ASCII ? read_text_element(reader, element)
                                                      : qm_ply_read_binary_rows(reader, element);
        if (status != QM_OK) return status;
    }
    warn_about_rest(reader);
    return QM_OK;
}

/** Reopens the file as text, which checks all of it for NUL bytes, and skips to its rows. */
static qm_status reopen_as_text(qm_ply_reader *reader, size_t size)
{
    qm_scan header = reader->text;
    qm_status status = qm_scan_open(&reader->text, reader->bytes, size, reader->report);
    if (status == QM_OK) reader->text = header;
    return status;
}

static qm_status read_file(qm_ply_reader *reader, size_t size)
{
    qm_status status = qm_ply_read_header(reader);
    if (status == QM_OK && reader->encoding == QM_PLY_ASCII) status = reopen_as_text(reader, size);
    if (status == QM_OK) status = read_rows(reader);
    return status;
}

qm_status qm_codec_decode_ply(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    qm_ply_reader reader = {.builder = builder,
                            .report = builder->report,
                            .bytes = bytes,
                            .text = {.at = bytes, .end = bytes + size, .line = 1, .report = builder->report}};
    qm_status status = read_file(&reader, size);
    if (reader.encoding == QM_PLY_ASCII || reader.encoding == QM_PLY_NO_ENCODING)
        builder->report->line = reader.text.line;
    else
        builder->report->offset = (size_t)(reader.text.at - bytes);
    qm_context_free(builder->ctx, reader.elements, reader.element_capacity, sizeof *reader.elements);
    qm_context_free(builder->ctx, reader.properties, reader.property_capacity, sizeof *reader.properties);
    return status;
}
