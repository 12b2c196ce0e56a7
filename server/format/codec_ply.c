/**
 * codec_ply.c: PLY: a text header that describes elements and their properties, then their rows as text or as binary in
 * either byte order. The coordinates are the properties x, y, z of the element vertex, the corners the list
 * vertex_indices or vertex_index of the element face. The same list of the element tristrips has strips of triangles, as
 * Stanford's scans do: each vertex makes a triangle with the two before it, every second one is turned around, and -1
 * ends a strip. Of a point set the properties nx, ny, nz are kept too; everything else is skipped by its declared
 * size. Files are written as binary, in double precision.
 * Source: Turk, The PLY Polygon File Format, 1994.
 */
#include <math.h>

#include "codec_blocks.h"
#include "encoder_internal.h"

typedef enum ply_scalar {
    PLY_INT8,
    PLY_UINT8,
    PLY_INT16,
    PLY_UINT16,
    PLY_INT32,
    PLY_UINT32,
    PLY_FLOAT32,
    PLY_FLOAT64,
    PLY_NO_SCALAR
} ply_scalar;

typedef struct ply_scalar_facts {
    const char *name, *sized_name;
    size_t size;
} ply_scalar_facts;

/** The use of a property: PLY_COORDINATE + axis, PLY_NORMAL + axis, the list of corners, or none. */
typedef enum ply_role {
    PLY_COORDINATE,
    PLY_NORMAL = PLY_COORDINATE + 3,
    PLY_CORNERS = PLY_NORMAL + 3,
    PLY_OTHER
} ply_role;

typedef struct ply_property {
    ply_scalar count_type; /* PLY_NO_SCALAR unless the property is a list */
    ply_scalar type;
    int role;
} ply_property;

typedef enum ply_kind { PLY_VERTICES, PLY_FACES, PLY_STRIPS, PLY_OTHERS } ply_kind;

typedef struct ply_element {
    ply_kind kind;
    uint64_t count;
    size_t first_property, property_count;
} ply_element;

typedef enum ply_encoding {
    PLY_NO_ENCODING,
    PLY_ASCII,
    PLY_LITTLE_ENDIAN_BINARY,
    PLY_BIG_ENDIAN_BINARY
} ply_encoding;

/** The strip that is being read. */
typedef struct ply_strip {
    uint64_t length;   /* vertices of it so far */
    uint32_t last[2];  /* the last two of them, the one of even place first, as the next triangle has them */
    size_t flat_count; /* triangles of all strips that name a vertex twice */
} ply_strip;

typedef struct ply_reader {
    qm_builder *builder;
    qm_codec_report *report;
    qm_scan text;         /* the header, and the rows of a text file */
    const uint8_t *bytes; /* the whole file; rows of a binary file are read at text.at */
    ply_encoding encoding;
    bool swaps_bytes;
    ply_element *elements;
    size_t element_count, element_capacity;
    ply_property *properties;
    size_t property_count, property_capacity;
    uint64_t vertex_count; /* of the header */
    bool has_normals;      /* it is a point set with three normal properties */
    bool is_strips;        /* the corners of the current element are strips */
    ply_strip strip;
} ply_reader;

static inline bool ply_is_float(ply_scalar type)
{
    return type == PLY_FLOAT32 || type == PLY_FLOAT64;
}

static const ply_scalar_facts ply_scalars[PLY_NO_SCALAR] = {
    {"char", "int8", 1}, {"uchar", "uint8", 1}, {"short", "int16", 2},   {"ushort", "uint16", 2},
    {"int", "int32", 4}, {"uint", "uint32", 4}, {"float", "float32", 4}, {"double", "float64", 8}};

/* ---- the header ---- */

static qm_status ply_fail(ply_reader *reader, const char *detail)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "%s", detail);
}

/** Fails about a word of the header, which takes the place of %s. */
__attribute__((format(printf, 2, 0))) static qm_status fail_word(ply_reader *reader, const char *format,
                                                                 const uint8_t *word, size_t size)
{
    char shown[QM_SCAN_SHOWN_SIZE];
    return qm_codec_fail(reader->report, QM_E_FORMAT, format, qm_scan_show(word, size, shown));
}

static qm_status read_scalar_type(ply_reader *reader, ply_scalar *type)
{
    const uint8_t *word;
    size_t size;
    *type = PLY_NO_SCALAR;
    const bool has_word = qm_scan_read_word(&reader->text, &word, &size);
    for (int i = 0; has_word && i < PLY_NO_SCALAR; ++i)
        if (qm_scan_word_is(word, size, ply_scalars[i].name) ||
            qm_scan_word_is(word, size, ply_scalars[i].sized_name))
            *type = (ply_scalar)i;
    if (!has_word) return ply_fail(reader, "a property has no type");
    return *type == PLY_NO_SCALAR ? fail_word(reader, "a property has the unknown type \"%s\"", word, size)
                                  : QM_OK;
}

static qm_status read_format(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (reader->encoding != PLY_NO_ENCODING) return ply_fail(reader, "the header has a second format line");
    if (!qm_scan_read_word(&reader->text, &word, &size)) size = 0;
    if (size == 0) return ply_fail(reader, "the format line has no format");
    if (qm_scan_word_is(word, size, "ascii")) reader->encoding = PLY_ASCII;
    if (qm_scan_word_is(word, size, "binary_little_endian")) reader->encoding = PLY_LITTLE_ENDIAN_BINARY;
    if (qm_scan_word_is(word, size, "binary_big_endian")) reader->encoding = PLY_BIG_ENDIAN_BINARY;
    bool host_is_big = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
    reader->swaps_bytes = host_is_big != (reader->encoding == PLY_BIG_ENDIAN_BINARY);
    if (reader->encoding == PLY_NO_ENCODING)
        return fail_word(reader, "the format line has the unknown format \"%s\"", word, size);
    if (qm_scan_read_word(&reader->text, &word, &size) && qm_scan_word_is(word, size, "1.0")) return QM_OK;
    return ply_fail(reader, "the format line has another version than 1.0");
}

static qm_status read_element(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    ply_element element = {.first_property = reader->property_count};
    if (!qm_scan_read_word(&reader->text, &word, &size)) return ply_fail(reader, "an element has no name");
    element.kind = PLY_OTHERS;
    if (qm_scan_word_is(word, size, "vertex")) element.kind = PLY_VERTICES;
    if (qm_scan_word_is(word, size, "face")) element.kind = PLY_FACES;
    if (qm_scan_word_is(word, size, "tristrips")) element.kind = PLY_STRIPS;
    for (size_t i = 0; element.kind != PLY_OTHERS && i < reader->element_count; ++i)
        if (reader->elements[i].kind == element.kind)
            return ply_fail(reader, "the header describes vertices, faces or strips twice");
    int64_t count;
    qm_status status = qm_scan_read_integer(&reader->text, &count);
    if (status != QM_OK) return status;
    if (count < 0) return ply_fail(reader, "the count of an element is negative");
    element.count = (uint64_t)count;
    if (element.kind == PLY_VERTICES) reader->vertex_count = element.count;

    void *block = reader->elements;
    if (!qm_codec_reserve(reader->builder->ctx, &block, &reader->element_capacity, reader->element_count + 1,
                          sizeof element))
        return QM_E_NO_MEMORY;
    reader->elements = block;
    reader->elements[reader->element_count++] = element;
    return QM_OK;
}

static int find_role(const ply_element *element, bool is_list, const uint8_t *word, size_t size)
{
    static const char *const names[PLY_CORNERS] = {"x", "y", "z", "nx", "ny", "nz"};
    for (int role = 0; role < PLY_CORNERS; ++role)
        if (element->kind == PLY_VERTICES && !is_list && qm_scan_word_is(word, size, names[role]))
            return role;
    bool is_corners =
        qm_scan_word_is(word, size, "vertex_indices") || qm_scan_word_is(word, size, "vertex_index");
    bool has_corners = element->kind == PLY_FACES || element->kind == PLY_STRIPS;
    return has_corners && is_list && is_corners ? PLY_CORNERS : PLY_OTHER;
}

static qm_status read_property(ply_reader *reader)
{
    if (reader->element_count == 0) return ply_fail(reader, "a property comes before the first element");
    ply_element *element = &reader->elements[reader->element_count - 1];
    ply_property property = {.count_type = PLY_NO_SCALAR};
    qm_scan ahead = reader->text;
    const uint8_t *word;
    size_t size;
    qm_status status = QM_OK;
    bool is_list = qm_scan_read_word(&ahead, &word, &size) && qm_scan_word_is(word, size, "list");
    if (is_list) {
        reader->text = ahead;
        status = read_scalar_type(reader, &property.count_type);
        if (status == QM_OK && ply_is_float(property.count_type))
            return ply_fail(reader, "the length of a list must be an integer");
    }
    if (status == QM_OK) status = read_scalar_type(reader, &property.type);
    if (status != QM_OK) return status;
    if (!qm_scan_read_word(&reader->text, &word, &size)) return ply_fail(reader, "a property has no name");
    property.role = find_role(element, is_list, word, size);
    for (size_t i = 0; property.role != PLY_OTHER && i < element->property_count; ++i)
        if (reader->properties[element->first_property + i].role == property.role)
            return ply_fail(reader, "the header describes a coordinate, a normal or the corners twice");
    if (property.role == PLY_CORNERS && ply_is_float(property.type))
        return ply_fail(reader, "the corners of faces must be integers");
    void *block = reader->properties;
    if (!qm_codec_reserve(reader->builder->ctx, &block, &reader->property_capacity,
                          reader->property_count + 1, sizeof property))
        return QM_E_NO_MEMORY;
    reader->properties = block;
    reader->properties[reader->property_count++] = property;
    ++element->property_count;
    return QM_OK;
}

/** A comment "grid ROWS COLUMNS" says that faces form a grid; other comments are ignored. */
static qm_status read_comment(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    int64_t count[2];
    if (!qm_scan_read_word(&reader->text, &word, &size) || !qm_scan_word_is(word, size, "grid")) return QM_OK;
    for (int k = 0; k < 2; ++k) {
        bool overflow;
        qm_scan_skip_blanks(&reader->text);
        if (!qm_scan_bare_integer(&reader->text, &count[k], &overflow)) return QM_OK;
        if (count[k] < 1 || count[k] > UINT32_MAX) return QM_OK;
    }
    return qm_builder_add_grid(reader->builder, (qm_mesh_grid){(uint32_t)count[0], (uint32_t)count[1]});
}

static qm_status fail_unknown_line(ply_reader *reader, const uint8_t *word, size_t size)
{
    char shown[QM_SCAN_SHOWN_SIZE];
    return qm_codec_fail(reader->report, QM_E_FORMAT,
                         "line %zu of the header starts with \"%s\", which is no keyword of PLY",
                         reader->text.line, qm_scan_show(word, size, shown));
}

/** Reads the lines of the header through end_header. */
static qm_status read_header_lines(ply_reader *reader)
{
    for (;;) {
        const uint8_t *word;
        size_t size;
        if (reader->text.at == reader->text.end) return ply_fail(reader, "the header has no end");
        qm_status status = QM_OK;
        if (qm_scan_read_word(&reader->text, &word, &size)) {
            if (qm_scan_word_is(word, size, "end_header")) return QM_OK;
            if (qm_scan_word_is(word, size, "format"))
                status = read_format(reader);
            else if (qm_scan_word_is(word, size, "element"))
                status = read_element(reader);
            else if (qm_scan_word_is(word, size, "property"))
                status = read_property(reader);
            else if (qm_scan_word_is(word, size, "comment"))
                status = read_comment(reader);
            else if (!qm_scan_word_is(word, size, "obj_info"))
                status = fail_unknown_line(reader, word, size);
        }
        if (status != QM_OK) return status;
        qm_scan_skip_line(&reader->text);
    }
}

static qm_status ply_read_header(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (!qm_scan_read_word(&reader->text, &word, &size) || !qm_scan_word_is(word, size, "ply"))
        return ply_fail(reader, "the file does not start with the word ply");
    qm_scan_skip_line(&reader->text);
    qm_status status = read_header_lines(reader);
    if (status != QM_OK) return status;
    if (reader->encoding == PLY_NO_ENCODING) return ply_fail(reader, "the header has no format line");
    qm_scan_skip_line(&reader->text);
    unsigned roles = 0;
    bool has_faces = false;
    size_t other_count = 0;
    for (size_t i = 0; i < reader->property_count; ++i)
        if (reader->properties[i].role < PLY_CORNERS) roles |= 1u << reader->properties[i].role;
    if ((roles & 7) != 7)
        return ply_fail(reader, "the header describes no element vertex with properties x, y and z");
    for (size_t i = 0; i < reader->element_count; ++i) {
        const ply_element *element = &reader->elements[i];
        if (element->count == 0 || element->kind == PLY_VERTICES) continue;
        bool has_corners = false;
        for (size_t p = 0; p < element->property_count; ++p)
            has_corners |= reader->properties[element->first_property + p].role == PLY_CORNERS;
        if (element->kind != PLY_OTHERS && !has_corners)
            return ply_fail(reader, "the faces have no list named vertex_indices or vertex_index");
        other_count += element->kind == PLY_OTHERS;
        has_faces |= has_corners;
    }
    reader->has_normals = roles == 63 && !has_faces;
    if (other_count > 0)
        qm_codec_warn(reader->report, "elements other than vertex, face and tristrips: %zu (ignored)",
                      other_count);
    return QM_OK;
}

/* ---- rows ---- */

/** Checks the count of the header against the remaining bytes, and reserves arrays. */
static qm_status start_element(ply_reader *reader, const ply_element *element)
{
    uint64_t left = (uint64_t)(reader->text.end - reader->text.at);
    if (reader->encoding == PLY_ASCII) ++left; /* the last line end is optional */
    reader->is_strips = element->kind == PLY_STRIPS;
    /* The min size of a row, with empty lists; and in more of a row that can be read, for the corners of a triangle. */
    size_t row = 0, more = 0;
    for (size_t i = 0; i < element->property_count; ++i) {
        const ply_property *property = &reader->properties[element->first_property + i];
        bool is_list = property->count_type != PLY_NO_SCALAR;
        bool is_binary = reader->encoding != PLY_ASCII;
        size_t value = is_binary ? ply_scalars[property->type].size : 2;
        row += !is_list ? value : is_binary ? ply_scalars[property->count_type].size : 2;
        if (property->role == PLY_CORNERS && element->kind == PLY_FACES) more += 3 * value;
    }
    if (row > 0 && element->count > left / row)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %llu rows of an element, but the file has room for %llu",
                             (unsigned long long)element->count, (unsigned long long)(left / row));
    if (element->kind == PLY_VERTICES) return qm_builder_reserve_vertices(reader->builder, element->count);
    if (element->kind != PLY_FACES || row == 0) return QM_OK;
    uint64_t most = left / (row + more);
    return qm_builder_reserve_faces(reader->builder, element->count < most ? element->count : most);
}

/** Adds a vertex to the strip. A triangle that names a vertex twice only leads to the next one. */
static qm_status add_to_strip(ply_reader *reader, uint32_t vertex)
{
    ply_strip *strip = &reader->strip;
    const uint32_t a = strip->last[0], b = strip->last[1];
    const bool is_triangle = strip->length >= 2, is_flat = (a == b) | (a == vertex) | (b == vertex);
    strip->flat_count += is_triangle && is_flat;
    strip->last[strip->length++ % 2] = vertex;
    return is_triangle && !is_flat ? qm_builder_add_triangle(reader->builder, a, b, vertex) : QM_OK;
}

static qm_status ply_add_corner(ply_reader *reader, int64_t vertex)
{
    if (reader->is_strips && vertex == -1) {
        reader->strip.length = 0;
        return QM_OK;
    }
    if (vertex < 0 || (uint64_t)vertex >= reader->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %lld, but the file has %llu vertices, counted from 0",
                             (long long)vertex, (unsigned long long)reader->vertex_count);
    return reader->is_strips ? add_to_strip(reader, (uint32_t)vertex)
                             : qm_builder_add_corner(reader->builder, (uint32_t)vertex);
}

static qm_status ply_end_row(ply_reader *reader, ply_kind kind, const double value[PLY_CORNERS])
{
    if (kind == PLY_FACES) return qm_builder_end_face(reader->builder);
    reader->strip.length = 0;
    if (kind != PLY_VERTICES) return QM_OK;
    qm_status status = qm_builder_add_vertex(reader->builder, value + PLY_COORDINATE);
    if (status != QM_OK || !reader->has_normals) return status;
    return qm_builder_set_normal(reader->builder, value + PLY_NORMAL);
}

/* ---- rows of text ---- */

static qm_status read_text_list(ply_reader *reader, const ply_property *property)
{
    int64_t length;
    qm_status status = qm_scan_read_integer(&reader->text, &length);
    if (status == QM_OK && length < 0) return ply_fail(reader, "the length of a list is negative");
    for (int64_t i = 0; status == QM_OK && i < length; ++i) {
        int64_t vertex;
        double ignored;
        if (property->role != PLY_CORNERS) {
            status = qm_scan_read_number(&reader->text, &ignored);
            continue;
        }
        status = qm_scan_read_integer(&reader->text, &vertex);
        if (status == QM_OK) status = ply_add_corner(reader, vertex);
    }
    return status;
}

/** Whether rows have only the three coordinates in order, or only the corners of a face. */
static bool is_plain(const ply_reader *reader, const ply_element *element)
{
    const ply_property *first = reader->properties + element->first_property;
    if (element->kind == PLY_FACES) return element->property_count == 1 && first->role == PLY_CORNERS;
    bool is_position = element->kind == PLY_VERTICES && element->property_count == 3;
    for (int axis = 0; is_position && axis < 3; ++axis)
        is_position = first[axis].role == PLY_COORDINATE + axis;
    return is_position;
}

/** The fast path for such rows; false, without reading anything, for others. */
static bool read_plain_row(ply_reader *reader, ply_kind kind, qm_status *status)
{
    qm_scan *text = &reader->text;
    const uint8_t *at = text->at;
    double position[3];
    uint32_t corners[4];
    bool is_read = kind == PLY_FACES ? qm_scan_plain_face(text, reader->vertex_count, corners)
                                     : qm_scan_plain_position(text, position);
    if (!is_read || !qm_scan_is_line_end(*text->at)) {
        text->at = at;
        return false;
    }
    *status = kind == PLY_FACES ? qm_builder_add_face(reader->builder, corners)
                                : qm_builder_add_vertex(reader->builder, position);
    return true;
}

static qm_status read_text_row(ply_reader *reader, const ply_element *element)
{
    double value[PLY_CORNERS] = {0}, ignored;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < element->property_count; ++i) {
        const ply_property *property = &reader->properties[element->first_property + i];
        if (property->count_type != PLY_NO_SCALAR)
            status = read_text_list(reader, property);
        else
            status = qm_scan_read_number(&reader->text,
                                         property->role < PLY_CORNERS ? &value[property->role] : &ignored);
    }
    qm_scan_skip_blanks(&reader->text);
    if (status == QM_OK && !qm_scan_at_row_end(&reader->text))
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the row has more values than the header describes");
    return status == QM_OK ? ply_end_row(reader, element->kind, value) : status;
}

static qm_status read_text_rows(ply_reader *reader, const ply_element *element, uint64_t done)
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
    const ply_reader *reader;
    const ply_element *element;
} element_reader;

static qm_status read_block(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder)
{
    const element_reader *whole = user;
    ply_element rows = *whole->element;
    ply_reader reader = *whole->reader;
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
static qm_status read_blocks(ply_reader *reader, const ply_element *element, uint64_t *done)
{
    const size_t first_line = reader->text.line;
    element_reader user = {.reader = reader, .element = element};
    const qm_block_reader rows = {.rows = element->kind == PLY_FACES ? QM_BLOCK_FACES : QM_BLOCK_VERTICES,
                                  .max_lines = element->count,
                                  .read = read_block,
                                  .user = &user};
    *done = 0;
    const bool has_blocks = element->kind == PLY_VERTICES || element->kind == PLY_FACES;
    if (!has_blocks || reader->has_normals) return QM_OK;
    qm_status status = qm_blocks_read(reader->builder, &reader->text, &rows);
    *done = reader->text.line - first_line;
    return status;
}

/* ---- binary rows ---- */

static uint64_t load_bits(const uint8_t *at, size_t size, bool swaps)
{
    uint8_t b8;
    uint16_t b16;
    uint32_t b32;
    uint64_t b64;
    switch (size) {
    case 1:
        memcpy(&b8, at, 1);
        return b8;
    case 2:
        memcpy(&b16, at, 2);
        return swaps ? __builtin_bswap16(b16) : b16;
    case 4:
        memcpy(&b32, at, 4);
        return swaps ? __builtin_bswap32(b32) : b32;
    default:
        memcpy(&b64, at, 8);
        return swaps ? __builtin_bswap64(b64) : b64;
    }
}

static int64_t load_integer(const ply_reader *reader, ply_scalar type, const uint8_t *at)
{
    uint64_t bits = load_bits(at, ply_scalars[type].size, reader->swaps_bytes);
    switch (type) {
    case PLY_INT8:
        return (int8_t)bits;
    case PLY_INT16:
        return (int16_t)bits;
    case PLY_INT32:
        return (int32_t)bits;
    default:
        return (int64_t)bits;
    }
}

static double load_number(const ply_reader *reader, ply_scalar type, const uint8_t *at)
{
    if (!ply_is_float(type)) return (double)load_integer(reader, type, at);
    uint64_t bits = load_bits(at, ply_scalars[type].size, reader->swaps_bytes);
    double number;
    memcpy(&number, &bits, sizeof number);
    if (type == PLY_FLOAT64) return number;
    uint32_t low = (uint32_t)bits;
    float narrow;
    memcpy(&narrow, &low, sizeof narrow);
    return narrow;
}

static qm_status fail_short(ply_reader *reader)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends within a row");
}

/** Checks that size bytes are left at text.at. */
static bool has_bytes(const ply_reader *reader, uint64_t size)
{
    return (uint64_t)(reader->text.end - reader->text.at) >= size;
}

static qm_status read_binary_list(ply_reader *reader, const ply_property *property)
{
    size_t count_size = ply_scalars[property->count_type].size, size = ply_scalars[property->type].size;
    if (!has_bytes(reader, count_size)) return fail_short(reader);
    int64_t length = load_integer(reader, property->count_type, reader->text.at);
    if (length < 0) return ply_fail(reader, "the length of a list is negative");
    reader->text.at += count_size;
    if (!has_bytes(reader, (uint64_t)length * size)) return fail_short(reader);
    if (property->role != PLY_CORNERS) {
        reader->text.at += (size_t)length * size;
        return QM_OK;
    }
    for (int64_t i = 0; i < length; ++i, reader->text.at += size) {
        qm_status status = ply_add_corner(reader, load_integer(reader, property->type, reader->text.at));
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status read_binary_row(ply_reader *reader, const ply_element *element)
{
    double value[PLY_CORNERS] = {0};
    const ply_property *property = reader->properties + element->first_property;
    for (const ply_property *end = property + element->property_count; property < end; ++property) {
        if (property->count_type != PLY_NO_SCALAR) {
            qm_status status = read_binary_list(reader, property);
            if (status != QM_OK) return status;
            continue;
        }
        if (!has_bytes(reader, ply_scalars[property->type].size)) return fail_short(reader);
        if (property->role < PLY_CORNERS) {
            double number = load_number(reader, property->type, reader->text.at);
            if (property->role < PLY_NORMAL && !isfinite(number))
                return qm_codec_fail(reader->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
            value[property->role] = number;
        }
        reader->text.at += ply_scalars[property->type].size;
    }
    return ply_end_row(reader, element->kind, value);
}

/** The commonest rows, for which a walk over the properties would take most of the time: three doubles or
 * floats first, or nothing but corners as 32-bit numbers after a byte. */
typedef enum plain_row { NOT_PLAIN, PLAIN_DOUBLES, PLAIN_FLOATS, PLAIN_CORNERS } plain_row;

static plain_row find_plain(const ply_reader *reader, const ply_element *element)
{
    const ply_property *first = reader->properties + element->first_property;
    if (reader->swaps_bytes) return NOT_PLAIN;
    if (element->kind == PLY_FACES && element->property_count == 1 && first->role == PLY_CORNERS) {
        bool is_plain = first->count_type == PLY_UINT8 &&
                        (first->type == PLY_INT32 || first->type == PLY_UINT32) &&
                        reader->vertex_count <= INT32_MAX;
        return is_plain ? PLAIN_CORNERS : NOT_PLAIN;
    }
    if (element->kind != PLY_VERTICES || element->property_count != 3) return NOT_PLAIN;
    for (int axis = 0; axis < 3; ++axis)
        if (first[axis].role != PLY_COORDINATE + axis || first[axis].type != first->type ||
            first[axis].count_type != PLY_NO_SCALAR)
            return NOT_PLAIN;
    return first->type == PLY_FLOAT64 ? PLAIN_DOUBLES : first->type == PLY_FLOAT32 ? PLAIN_FLOATS : NOT_PLAIN;
}

/** Converts rows to positions; false if a number is not finite. Non-finite exponents carry into the sign bit, so that the
 * loop needs no exit. */
static bool widen_floats(const uint8_t *at, size_t count, double *positions)
{
    const uint32_t exponent = 0x7f800000u, step = 0x00800000u;
    uint32_t carried = 0;
    for (size_t i = 0; i < count; ++i) {
        uint32_t bits;
        float narrow;
        memcpy(&bits, at + i * sizeof bits, sizeof bits);
        memcpy(&narrow, &bits, sizeof narrow);
        positions[i] = (double)narrow;
        carried |= (bits & exponent) + step;
    }
    return carried >> 31 == 0;
}

static bool copy_doubles(const uint8_t *at, size_t count, double *positions)
{
    bool is_finite = true;
    memcpy(positions, at, count * sizeof *positions);
    for (size_t i = 0; i < count; ++i)
        is_finite &= isfinite(positions[i]) != 0;
    return is_finite;
}

#define ROWS_TOGETHER 1024

/** Reads plain rows up to a block with an invalid one, which the general loop reports; *done counts them. */
static qm_status read_plain_positions(ply_reader *reader, plain_row plain, uint64_t count, uint64_t *done)
{
    size_t size = 3 * (plain == PLAIN_DOUBLES ? sizeof(double) : sizeof(float));
    qm_status status = QM_OK;
    while (*done < count && status == QM_OK) {
        size_t rows = count - *done < ROWS_TOGETHER ? (size_t)(count - *done) : ROWS_TOGETHER;
        double positions[3 * ROWS_TOGETHER];
        if (!has_bytes(reader, rows * size)) break;
        if (!(plain == PLAIN_DOUBLES ? copy_doubles : widen_floats)(reader->text.at, 3 * rows, positions))
            break;
        reader->text.at += rows * size;
        *done += rows;
        status = qm_builder_add_vertices(reader->builder, positions, rows);
    }
    return status;
}

/** Loads a triangle or quad; corners[3] is QM_NO_INDEX for the former. False for a row that is to be read, or
 * refused, in the general way. */
static inline bool load_plain_face(const uint8_t *at, uint64_t vertex_count, uint32_t corners[4])
{
    memcpy(corners, at + 1, 4 * sizeof *corners);
    bool is_good = (corners[0] < vertex_count) & (corners[1] < vertex_count) & (corners[2] < vertex_count);
    if (at[0] == 4) return is_good & (corners[3] < vertex_count);
    corners[3] = QM_NO_INDEX;
    return is_good & (at[0] == 3);
}

static qm_status read_plain_faces(ply_reader *reader, uint64_t count, uint64_t *done)
{
    qm_status status = QM_OK;
    bool is_plain = true;
    while (is_plain && *done < count && status == QM_OK) {
        uint32_t faces[ROWS_TOGETHER][4];
        const uint8_t *at = reader->text.at, *end = reader->text.end;
        size_t rows = 0, most = count - *done < ROWS_TOGETHER ? (size_t)(count - *done) : ROWS_TOGETHER;
        for (; rows < most; ++rows) {
            bool is_whole = (size_t)(end - at) >= 1 + sizeof faces[rows];
            if (!is_whole || !load_plain_face(at, reader->vertex_count, faces[rows])) break;
            at += 1 + (faces[rows][3] == QM_NO_INDEX ? 3 : 4) * sizeof faces[0][0];
        }
        is_plain = rows == most;
        reader->text.at = at;
        *done += rows;
        status = qm_builder_add_faces(reader->builder, faces, rows);
    }
    return status;
}

static qm_status ply_read_binary_rows(ply_reader *reader, const ply_element *element)
{
    if (element->property_count == 0) return QM_OK;
    plain_row plain = find_plain(reader, element);
    qm_status status = QM_OK;
    for (uint64_t done = 0; done < element->count && status == QM_OK; ++done) {
        if (plain == PLAIN_CORNERS)
            status = read_plain_faces(reader, element->count, &done);
        else if (plain != NOT_PLAIN)
            status = read_plain_positions(reader, plain, element->count, &done);
        if (status == QM_OK && done < element->count) status = read_binary_row(reader, element);
    }
    return status;
}

/* ---- the file ---- */

static qm_status read_rows(ply_reader *reader)
{
    for (size_t i = 0; i < reader->element_count; ++i) {
        const ply_element *element = &reader->elements[i];
        qm_status status = start_element(reader, element);
        if (status == QM_OK && reader->encoding == PLY_ASCII) {
            uint64_t done;
            status = read_blocks(reader, element, &done);
            if (status == QM_OK) status = read_text_rows(reader, element, done);
        } else if (status == QM_OK) {
            status = ply_read_binary_rows(reader, element);
        }
        if (status != QM_OK) return status;
    }
    if (reader->strip.flat_count > 0)
        qm_codec_warn(reader->report, "triangles of strips that name a vertex twice: %zu (left out)",
                      reader->strip.flat_count);
    if (reader->encoding == PLY_ASCII) {
        if (qm_scan_find_row(&reader->text))
            qm_codec_warn(reader->report,
                          "line %zu and the following ones come after the last row and were ignored",
                          reader->text.line);
    } else if (reader->text.at < reader->text.end) {
        qm_codec_warn(reader->report, "bytes after the last row: %zu (ignored)",
                      (size_t)(reader->text.end - reader->text.at));
    }
    return QM_OK;
}

static qm_status read_file(ply_reader *reader, size_t size)
{
    qm_status status = ply_read_header(reader);
    if (status == QM_OK && reader->encoding == PLY_ASCII) {
        /* Opening the file again as text checks all of it for NUL bytes. */
        qm_scan header = reader->text;
        status = qm_scan_open(&reader->text, reader->bytes, size, reader->report);
        if (status == QM_OK) reader->text = header;
    }
    if (status == QM_OK) status = read_rows(reader);
    return status;
}

qm_status qm_codec_decode_ply(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    ply_reader reader = {.builder = builder,
                         .report = builder->report,
                         .bytes = bytes,
                         .text = {.at = bytes, .end = bytes + size, .line = 1, .report = builder->report}};
    qm_status status = read_file(&reader, size);
    if (reader.encoding == PLY_ASCII || reader.encoding == PLY_NO_ENCODING)
        builder->report->line = reader.text.line;
    else
        builder->report->offset = (size_t)(reader.text.at - bytes);
    qm_context_free(builder->ctx, reader.elements, reader.element_capacity, sizeof *reader.elements);
    qm_context_free(builder->ctx, reader.properties, reader.property_capacity, sizeof *reader.properties);
    return status;
}

/* ---- encoding ---- */

/** The type of the corner count: a byte if it suffices, as most readers expect. */
static bool has_byte_counts(const qm_encoder *encoder)
{
    return encoder->max_corners <= UINT8_MAX;
}

static void add_ply_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_add_string(out, "ply\nformat binary_little_endian 1.0\n");
    for (size_t i = 0; i < encoder->mesh->grid_count; i++)
        qm_text_printf(out, "comment grid %u %u\n", encoder->mesh->grids[i].rows,
                       encoder->mesh->grids[i].columns);
    qm_text_printf(out,
                   "element vertex %zu\n"
                   "property double x\nproperty double y\nproperty double z\n%s",
                   encoder->mesh->vertex_count, encoder->uv ? "property float s\nproperty float t\n" : "");
    if (encoder->input_faces > 0)
        qm_text_printf(out, "element face %zu\nproperty list %s uint vertex_indices\n", encoder->input_faces,
                       has_byte_counts(encoder) ? "uchar" : "uint");
    qm_text_add_string(out, "end_header\n");
}

static qm_status prepare_ply(qm_encoder *encoder)
{
    qm_text head = {0};
    qm_encoder_take_apart(encoder);
    add_ply_head(encoder, &head);
    /* The fan of a face has two triangles fewer than corners. */
    uint64_t corners = (uint64_t)encoder->triangles + 2 * (uint64_t)encoder->input_faces;
    encoder->size = head.size + (encoder->uv ? 32 : 24) * (uint64_t)encoder->mesh->vertex_count +
                    (has_byte_counts(encoder) ? 1 : 4) * (uint64_t)encoder->input_faces + 4 * corners;
    qm_status status = head.failed ? QM_E_NO_MEMORY : QM_OK;
    qm_text_reset(&head);
    return status;
}

static void add_ply_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    for (int axis = 0; axis < 3; axis++)
        qm_encoder_add_f64(out, encoder->mesh->positions[3 * vertex + (size_t)axis]);
    for (size_t k = 0; encoder->uv && k < 2; k++)
        qm_encoder_add_f32(out, encoder->uv->uv[2 * vertex + k]);
}

static void add_ply_face(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    size_t count = qm_encoder_corner_count(encoder->mesh, first, end);
    uint8_t byte = (uint8_t)count;
    if (has_byte_counts(encoder))
        qm_text_add(out, (const char *)&byte, 1);
    else
        qm_encoder_add_u32(out, (uint32_t)count);
    for (size_t i = 0; i < count; i++)
        qm_encoder_add_u32(out, qm_encoder_corner(encoder->mesh, first, i));
}

const qm_encoder_format qm_encoder_ply = {prepare_ply, add_ply_head, add_ply_vertex, add_ply_face, true};
