/*
 * PLY: a text header that describes elements and their properties, then their rows as text or as binary in
 * either byte order. The coordinates are the properties x, y, z of the element vertex, the corners the list
 * vertex_indices or vertex_index of the element face. Of a point set the properties nx, ny, nz are kept too;
 * everything else is stepped over by its declared size.
 * Source: Turk, The PLY Polygon File Format, 1994.
 */
#include <math.h>

#include "codec_build.h"
#include "codec_scan.h"

typedef enum scalar_type {
    INT8,
    UINT8,
    INT16,
    UINT16,
    INT32,
    UINT32,
    FLOAT32,
    FLOAT64,
    NO_SCALAR
} scalar_type;

static const struct {
    const char *name, *sized_name;
    size_t size;
} scalar_types[] = {{"char", "int8", 1},     {"uchar", "uint8", 1},   {"short", "int16", 2},
                    {"ushort", "uint16", 2}, {"int", "int32", 4},     {"uint", "uint32", 4},
                    {"float", "float32", 4}, {"double", "float64", 8}};

/** What a property means for the mesh: COORDINATE + axis, NORMAL + axis, the corner list, or nothing. */
typedef enum property_role { COORDINATE, NORMAL = COORDINATE + 3, CORNERS = NORMAL + 3, OTHER } property_role;

typedef struct ply_property {
    scalar_type count_type; /* NO_SCALAR unless the property is a list */
    scalar_type type;
    int role;
} ply_property;

typedef enum element_kind { VERTICES, FACES, OTHERS } element_kind;

typedef struct ply_element {
    element_kind kind;
    uint64_t count;
    size_t first_property, property_count;
} ply_element;

typedef enum encoding { NO_ENCODING, ASCII, LITTLE_ENDIAN_BINARY, BIG_ENDIAN_BINARY } encoding;

typedef struct ply_reader {
    qm_builder *builder;
    qm_codec_report *report;
    qm_scan text;         /* the header, and the rows of a text file */
    const uint8_t *bytes; /* the whole file; rows of a binary file are read at text.at */
    encoding encoding;
    bool swaps_bytes;
    ply_element *elements;
    size_t element_count, element_capacity;
    ply_property *properties;
    size_t property_count, property_capacity;
    uint64_t vertex_count; /* announced */
    bool has_normals;      /* a point set with all three of them */
} ply_reader;

/* Header */

static qm_status fail_header(ply_reader *reader, const char *detail)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "%s", detail);
}

static scalar_type find_scalar_type(const uint8_t *word, size_t size)
{
    for (int i = 0; i < NO_SCALAR; ++i)
        if (qm_scan_word_is(word, size, scalar_types[i].name) ||
            qm_scan_word_is(word, size, scalar_types[i].sized_name))
            return (scalar_type)i;
    return NO_SCALAR;
}

static bool is_float(scalar_type type)
{
    return type == FLOAT32 || type == FLOAT64;
}

static qm_status read_scalar_type(ply_reader *reader, scalar_type *type)
{
    const uint8_t *word;
    size_t size;
    *type = NO_SCALAR;
    if (qm_scan_read_word(&reader->text, &word, &size)) *type = find_scalar_type(word, size);
    return *type == NO_SCALAR ? fail_header(reader, "a property has no known type") : QM_OK;
}

static qm_status read_format(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (reader->encoding != NO_ENCODING) return fail_header(reader, "the header has a second format line");
    if (!qm_scan_read_word(&reader->text, &word, &size)) size = 0;
    if (size == 0) return fail_header(reader, "the format line names no format");
    if (qm_scan_word_is(word, size, "ascii")) reader->encoding = ASCII;
    if (qm_scan_word_is(word, size, "binary_little_endian")) reader->encoding = LITTLE_ENDIAN_BINARY;
    if (qm_scan_word_is(word, size, "binary_big_endian")) reader->encoding = BIG_ENDIAN_BINARY;
    bool host_is_big = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
    reader->swaps_bytes = host_is_big != (reader->encoding == BIG_ENDIAN_BINARY);
    if (reader->encoding == NO_ENCODING)
        return fail_header(reader, "the format line names an unknown format");
    if (qm_scan_read_word(&reader->text, &word, &size) && qm_scan_word_is(word, size, "1.0")) return QM_OK;
    return fail_header(reader, "the format line does not name version 1.0");
}

static qm_status name_element(ply_reader *reader, const uint8_t *word, size_t size, element_kind *kind)
{
    *kind = OTHERS;
    if (qm_scan_word_is(word, size, "vertex")) *kind = VERTICES;
    if (qm_scan_word_is(word, size, "face")) *kind = FACES;
    if (qm_scan_word_is(word, size, "tristrips"))
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED, "triangle strips in PLY are not supported");
    for (size_t i = 0; *kind != OTHERS && i < reader->element_count; ++i)
        if (reader->elements[i].kind == *kind)
            return fail_header(reader, "the header describes vertices or faces twice");
    return QM_OK;
}

static qm_status read_element(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    ply_element element = {.first_property = reader->property_count};
    if (!qm_scan_read_word(&reader->text, &word, &size)) return fail_header(reader, "an element has no name");
    qm_status status = name_element(reader, word, size, &element.kind);
    int64_t count;
    if (status == QM_OK) status = qm_scan_read_integer(&reader->text, &count);
    if (status != QM_OK) return status;
    if (count < 0) return fail_header(reader, "the count of an element is negative");
    element.count = (uint64_t)count;
    if (element.kind == VERTICES) reader->vertex_count = element.count;

    void *block = reader->elements;
    if (!qm_array_reserve(reader->builder->ctx, &block, &reader->element_capacity, reader->element_count + 1,
                          sizeof element))
        return QM_E_NO_MEMORY;
    reader->elements = block;
    reader->elements[reader->element_count++] = element;
    return QM_OK;
}

static int find_role(const ply_element *element, bool is_list, const uint8_t *word, size_t size)
{
    static const char *const names[CORNERS] = {"x", "y", "z", "nx", "ny", "nz"};
    for (int role = 0; role < CORNERS; ++role)
        if (element->kind == VERTICES && !is_list && qm_scan_word_is(word, size, names[role])) return role;
    bool is_corners =
        qm_scan_word_is(word, size, "vertex_indices") || qm_scan_word_is(word, size, "vertex_index");
    return element->kind == FACES && is_list && is_corners ? CORNERS : OTHER;
}

static qm_status add_property(ply_reader *reader, ply_element *element, ply_property property)
{
    for (size_t i = 0; property.role != OTHER && i < element->property_count; ++i)
        if (reader->properties[element->first_property + i].role == property.role)
            return fail_header(reader, "the header names a coordinate, a normal or the corners twice");
    if (property.role == CORNERS && is_float(property.type))
        return fail_header(reader, "the corners of faces are not whole numbers");
    void *block = reader->properties;
    if (!qm_array_reserve(reader->builder->ctx, &block, &reader->property_capacity,
                          reader->property_count + 1, sizeof property))
        return QM_E_NO_MEMORY;
    reader->properties = block;
    reader->properties[reader->property_count++] = property;
    ++element->property_count;
    return QM_OK;
}

static qm_status read_property(ply_reader *reader)
{
    if (reader->element_count == 0) return fail_header(reader, "a property comes before the first element");
    ply_element *element = &reader->elements[reader->element_count - 1];
    ply_property property = {.count_type = NO_SCALAR};
    qm_scan ahead = reader->text;
    const uint8_t *word;
    size_t size;
    qm_status status = QM_OK;
    bool is_list = qm_scan_read_word(&ahead, &word, &size) && qm_scan_word_is(word, size, "list");
    if (is_list) {
        reader->text = ahead;
        status = read_scalar_type(reader, &property.count_type);
        if (status == QM_OK && is_float(property.count_type))
            return fail_header(reader, "the length of a list is not a whole number");
    }
    if (status == QM_OK) status = read_scalar_type(reader, &property.type);
    if (status != QM_OK) return status;
    if (!qm_scan_read_word(&reader->text, &word, &size)) return fail_header(reader, "a property has no name");
    property.role = find_role(element, is_list, word, size);
    return add_property(reader, element, property);
}

/** Reads the header line by line up to and with end_header. */
static qm_status read_header_lines(ply_reader *reader)
{
    for (;;) {
        const uint8_t *word;
        size_t size;
        if (reader->text.at == reader->text.end) return fail_header(reader, "the header has no end");
        qm_status status = QM_OK;
        if (qm_scan_read_word(&reader->text, &word, &size)) {
            if (qm_scan_word_is(word, size, "end_header")) return QM_OK;
            if (qm_scan_word_is(word, size, "format"))
                status = read_format(reader);
            else if (qm_scan_word_is(word, size, "element"))
                status = read_element(reader);
            else if (qm_scan_word_is(word, size, "property"))
                status = read_property(reader);
            else if (!qm_scan_word_is(word, size, "comment") && !qm_scan_word_is(word, size, "obj_info"))
                status = fail_header(reader, "the header has a line of unknown meaning");
        }
        if (status != QM_OK) return status;
        qm_scan_skip_line(&reader->text);
    }
}

static qm_status check_elements(ply_reader *reader)
{
    unsigned roles = 0;
    bool has_corners = false, has_faces = false;
    size_t other_count = 0;
    for (size_t i = 0; i < reader->property_count; ++i) {
        int role = reader->properties[i].role;
        if (role < CORNERS) roles |= 1u << role;
        has_corners |= role == CORNERS;
    }
    if ((roles & 7) != 7)
        return fail_header(reader, "the header describes no element vertex with properties x, y and z");
    for (size_t i = 0; i < reader->element_count; ++i) {
        const ply_element *element = &reader->elements[i];
        if (element->kind == FACES && element->count > 0 && !has_corners)
            return fail_header(reader, "the faces have no list named vertex_indices or vertex_index");
        other_count += element->kind == OTHERS && element->count > 0;
        has_faces |= element->kind == FACES && element->count > 0;
    }
    reader->has_normals = roles == 63 && !has_faces;
    if (other_count > 0)
        qm_codec_warn(reader->report, "elements other than vertex and face: %zu (left out)", other_count);
    return QM_OK;
}

static qm_status read_header(ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (!qm_scan_read_word(&reader->text, &word, &size) || !qm_scan_word_is(word, size, "ply"))
        return fail_header(reader, "the file does not start with the word ply");
    qm_scan_skip_line(&reader->text);
    qm_status status = read_header_lines(reader);
    if (status != QM_OK) return status;
    if (reader->encoding == NO_ENCODING) return fail_header(reader, "the header has no format line");
    qm_scan_skip_line(&reader->text);
    return check_elements(reader);
}

/* Rows */

/** The least bytes that a row takes: lists are empty, but for the corners of a triangle. */
static size_t smallest_row(const ply_reader *reader, const ply_element *element)
{
    size_t size = 0;
    for (size_t i = 0; i < element->property_count; ++i) {
        const ply_property *property = &reader->properties[element->first_property + i];
        bool is_list = property->count_type != NO_SCALAR;
        size_t values = property->role == CORNERS ? 3 : !is_list;
        if (reader->encoding == ASCII)
            size += 2 * (values + is_list);
        else
            size += (is_list ? scalar_types[property->count_type].size : 0) +
                    values * scalar_types[property->type].size;
    }
    return size;
}

/** Checks the announced count against the bytes left, and makes room. */
static qm_status start_element(ply_reader *reader, const ply_element *element)
{
    uint64_t left = (uint64_t)(reader->text.end - reader->text.at);
    if (reader->encoding == ASCII) ++left; /* the last line end may be missing */
    size_t row = smallest_row(reader, element);
    if (row > 0 && element->count > left / row)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header announces %llu rows of an element, but the file has room for %llu",
                             (unsigned long long)element->count, (unsigned long long)(left / row));
    if (element->kind == VERTICES) return qm_builder_reserve_vertices(reader->builder, element->count);
    if (element->kind == FACES) return qm_builder_reserve_faces(reader->builder, element->count);
    return QM_OK;
}

static qm_status add_corner(ply_reader *reader, int64_t vertex)
{
    if (vertex < 0 || (uint64_t)vertex >= reader->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %lld, but the file has %llu vertices, counted from 0",
                             (long long)vertex, (unsigned long long)reader->vertex_count);
    return qm_builder_add_corner(reader->builder, (uint32_t)vertex);
}

/** value holds the coordinates and the normal by their roles. */
static qm_status end_row(ply_reader *reader, element_kind kind, const double value[CORNERS])
{
    if (kind == FACES) return qm_builder_end_face(reader->builder);
    if (kind != VERTICES) return QM_OK;
    qm_status status = qm_builder_add_vertex(reader->builder, value + COORDINATE);
    if (status != QM_OK || !reader->has_normals) return status;
    return qm_builder_set_normal(reader->builder, value + NORMAL);
}

static qm_status read_text_list(ply_reader *reader, const ply_property *property)
{
    int64_t length;
    qm_status status = qm_scan_read_integer(&reader->text, &length);
    if (status == QM_OK && length < 0) return fail_header(reader, "the length of a list is negative");
    for (int64_t i = 0; status == QM_OK && i < length; ++i) {
        int64_t vertex;
        double ignored;
        if (property->role != CORNERS) {
            status = qm_scan_read_number(&reader->text, &ignored);
            continue;
        }
        status = qm_scan_read_integer(&reader->text, &vertex);
        if (status == QM_OK) status = add_corner(reader, vertex);
    }
    return status;
}

static qm_status read_text_row(ply_reader *reader, const ply_element *element)
{
    double value[CORNERS] = {0}, ignored;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < element->property_count; ++i) {
        const ply_property *property = &reader->properties[element->first_property + i];
        if (property->count_type != NO_SCALAR)
            status = read_text_list(reader, property);
        else
            status = qm_scan_read_number(&reader->text,
                                         property->role < CORNERS ? &value[property->role] : &ignored);
    }
    qm_scan_skip_blanks(&reader->text);
    if (status == QM_OK && !qm_scan_at_row_end(&reader->text))
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the row has more values than the header describes");
    return status == QM_OK ? end_row(reader, element->kind, value) : status;
}

static qm_status read_text_rows(ply_reader *reader, const ply_element *element)
{
    if (element->property_count == 0) return QM_OK;
    for (uint64_t i = 0; i < element->count; ++i) {
        if (!qm_scan_find_row(&reader->text))
            return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends after %llu of %llu rows",
                                 (unsigned long long)i, (unsigned long long)element->count);
        qm_status status = read_text_row(reader, element);
        if (status != QM_OK) return status;
        qm_scan_skip_line(&reader->text);
    }
    return QM_OK;
}

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

static int64_t load_integer(const ply_reader *reader, scalar_type type, const uint8_t *at)
{
    uint64_t bits = load_bits(at, scalar_types[type].size, reader->swaps_bytes);
    switch (type) {
    case INT8:
        return (int8_t)bits;
    case INT16:
        return (int16_t)bits;
    case INT32:
        return (int32_t)bits;
    default:
        return (int64_t)bits;
    }
}

static double load_number(const ply_reader *reader, scalar_type type, const uint8_t *at)
{
    if (!is_float(type)) return (double)load_integer(reader, type, at);
    uint64_t bits = load_bits(at, scalar_types[type].size, reader->swaps_bytes);
    double number;
    memcpy(&number, &bits, sizeof number);
    if (type == FLOAT64) return number;
    uint32_t low = (uint32_t)bits;
    float narrow;
    memcpy(&narrow, &low, sizeof narrow);
    return narrow;
}

static qm_status fail_short(ply_reader *reader)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends within a row");
}

/** Room for so many bytes at text.at. */
static bool has_bytes(const ply_reader *reader, uint64_t size)
{
    return (uint64_t)(reader->text.end - reader->text.at) >= size;
}

static qm_status read_binary_list(ply_reader *reader, const ply_property *property)
{
    size_t count_size = scalar_types[property->count_type].size, size = scalar_types[property->type].size;
    if (!has_bytes(reader, count_size)) return fail_short(reader);
    int64_t length = load_integer(reader, property->count_type, reader->text.at);
    if (length < 0) return fail_header(reader, "the length of a list is negative");
    reader->text.at += count_size;
    if (!has_bytes(reader, (uint64_t)length * size)) return fail_short(reader);
    if (property->role != CORNERS) {
        reader->text.at += (size_t)length * size;
        return QM_OK;
    }
    for (int64_t i = 0; i < length; ++i, reader->text.at += size) {
        qm_status status = add_corner(reader, load_integer(reader, property->type, reader->text.at));
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status read_binary_row(ply_reader *reader, const ply_element *element)
{
    double value[CORNERS] = {0};
    const ply_property *property = reader->properties + element->first_property;
    for (const ply_property *end = property + element->property_count; property < end; ++property) {
        if (property->count_type != NO_SCALAR) {
            qm_status status = read_binary_list(reader, property);
            if (status != QM_OK) return status;
            continue;
        }
        if (!has_bytes(reader, scalar_types[property->type].size)) return fail_short(reader);
        if (property->role < CORNERS) {
            double number = load_number(reader, property->type, reader->text.at);
            if (property->role < NORMAL && !isfinite(number))
                return qm_codec_fail(reader->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
            value[property->role] = number;
        }
        reader->text.at += scalar_types[property->type].size;
    }
    return end_row(reader, element->kind, value);
}

static qm_status read_binary_rows(ply_reader *reader, const ply_element *element)
{
    if (element->property_count == 0) return QM_OK;
    for (uint64_t i = 0; i < element->count; ++i) {
        qm_status status = read_binary_row(reader, element);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static void warn_about_rest(ply_reader *reader)
{
    if (reader->encoding == ASCII) {
        if (qm_scan_find_row(&reader->text))
            qm_codec_warn(reader->report,
                          "line %zu and what follows come after the last row and were left out",
                          reader->text.line);
    } else if (reader->text.at < reader->text.end) {
        qm_codec_warn(reader->report, "bytes after the last row: %zu (left out)",
                      (size_t)(reader->text.end - reader->text.at));
    }
}

static qm_status read_rows(ply_reader *reader)
{
    for (size_t i = 0; i < reader->element_count; ++i) {
        const ply_element *element = &reader->elements[i];
        qm_status status = start_element(reader, element);
        if (status == QM_OK)
            status = reader->encoding == ASCII ? read_text_rows(reader, element)
                                               : read_binary_rows(reader, element);
        if (status != QM_OK) return status;
    }
    warn_about_rest(reader);
    return QM_OK;
}

/** A text file is opened anew as text, which looks for NUL bytes in all of it, and stepped to its rows. */
static qm_status reopen_as_text(ply_reader *reader, size_t size)
{
    qm_scan header = reader->text;
    qm_status status = qm_scan_open(&reader->text, reader->bytes, size, reader->report);
    if (status == QM_OK) reader->text = header;
    return status;
}

static qm_status read_file(ply_reader *reader, size_t size)
{
    qm_status status = read_header(reader);
    if (status == QM_OK && reader->encoding == ASCII) status = reopen_as_text(reader, size);
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
    if (reader.encoding == ASCII || reader.encoding == NO_ENCODING)
        builder->report->line = reader.text.line;
    else
        builder->report->offset = (size_t)(reader.text.at - bytes);
    qm_context_free(builder->ctx, reader.elements, reader.element_capacity, sizeof *reader.elements);
    qm_context_free(builder->ctx, reader.properties, reader.property_capacity, sizeof *reader.properties);
    return status;
}
