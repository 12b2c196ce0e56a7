/**
 * codec_ply_header.c: the header of a PLY file.
 */
#include "codec_ply.h"

const qm_ply_scalar_facts qm_ply_scalars[QM_PLY_NO_SCALAR] = {
    {"char", "int8", 1}, {"uchar", "uint8", 1}, {"short", "int16", 2},   {"ushort", "uint16", 2},
    {"int", "int32", 4}, {"uint", "uint32", 4}, {"float", "float32", 4}, {"double", "float64", 8}};

qm_status qm_ply_fail(qm_ply_reader *reader, const char *detail)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "%s", detail);
}

static qm_ply_scalar find_scalar_type(const uint8_t *word, size_t size)
{
    for (int i = 0; i < QM_PLY_NO_SCALAR; ++i)
        if (qm_scan_word_is(word, size, qm_ply_scalars[i].name) ||
            qm_scan_word_is(word, size, qm_ply_scalars[i].sized_name))
            return (qm_ply_scalar)i;
    return QM_PLY_NO_SCALAR;
}

static qm_status read_scalar_type(qm_ply_reader *reader, qm_ply_scalar *type)
{
    const uint8_t *word;
    size_t size;
    *type = QM_PLY_NO_SCALAR;
    if (qm_scan_read_word(&reader->text, &word, &size)) *type = find_scalar_type(word, size);
    return *type == QM_PLY_NO_SCALAR ? qm_ply_fail(reader, "a property has an unknown type") : QM_OK;
}

static qm_status read_format(qm_ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (reader->encoding != QM_PLY_NO_ENCODING)
        return qm_ply_fail(reader, "the header has a second format line");
    if (!qm_scan_read_word(&reader->text, &word, &size)) size = 0;
    if (size == 0) return qm_ply_fail(reader, "the format line has no format");
    if (qm_scan_word_is(word, size, "ascii")) reader->encoding = QM_PLY_ASCII;
    if (qm_scan_word_is(word, size, "binary_little_endian")) reader->encoding = QM_PLY_LITTLE_ENDIAN_BINARY;
    if (qm_scan_word_is(word, size, "binary_big_endian")) reader->encoding = QM_PLY_BIG_ENDIAN_BINARY;
    bool host_is_big = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
    reader->swaps_bytes = host_is_big != (reader->encoding == QM_PLY_BIG_ENDIAN_BINARY);
    if (reader->encoding == QM_PLY_NO_ENCODING)
        return qm_ply_fail(reader, "the format line has an unknown format");
    if (qm_scan_read_word(&reader->text, &word, &size) && qm_scan_word_is(word, size, "1.0")) return QM_OK;
    return qm_ply_fail(reader, "the format line has another version than 1.0");
}

static qm_status name_element(qm_ply_reader *reader, const uint8_t *word, size_t size, qm_ply_kind *kind)
{
    *kind = QM_PLY_OTHERS;
    if (qm_scan_word_is(word, size, "vertex")) *kind = QM_PLY_VERTICES;
    if (qm_scan_word_is(word, size, "face")) *kind = QM_PLY_FACES;
    if (qm_scan_word_is(word, size, "tristrips"))
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED, "triangle strips in PLY are not supported");
    for (size_t i = 0; *kind != QM_PLY_OTHERS && i < reader->element_count; ++i)
        if (reader->elements[i].kind == *kind)
            return qm_ply_fail(reader, "the header describes vertices or faces twice");
    return QM_OK;
}

static qm_status read_element(qm_ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    qm_ply_element element = {.first_property = reader->property_count};
    if (!qm_scan_read_word(&reader->text, &word, &size)) return qm_ply_fail(reader, "an element has no name");
    qm_status status = name_element(reader, word, size, &element.kind);
    int64_t count;
    if (status == QM_OK) status = qm_scan_read_integer(&reader->text, &count);
    if (status != QM_OK) return status;
    if (count < 0) return qm_ply_fail(reader, "the count of an element is negative");
    element.count = (uint64_t)count;
    if (element.kind == QM_PLY_VERTICES) reader->vertex_count = element.count;

    void *block = reader->elements;
    if (!qm_codec_reserve(reader->builder->ctx, &block, &reader->element_capacity, reader->element_count + 1,
                          sizeof element))
        return QM_E_NO_MEMORY;
    reader->elements = block;
    reader->elements[reader->element_count++] = element;
    return QM_OK;
}

static int find_role(const qm_ply_element *element, bool is_list, const uint8_t *word, size_t size)
{
    static const char *const names[QM_PLY_CORNERS] = {"x", "y", "z", "nx", "ny", "nz"};
    for (int role = 0; role < QM_PLY_CORNERS; ++role)
        if (element->kind == QM_PLY_VERTICES && !is_list && qm_scan_word_is(word, size, names[role]))
            return role;
    bool is_corners =
        qm_scan_word_is(word, size, "vertex_indices") || qm_scan_word_is(word, size, "vertex_index");
    return element->kind == QM_PLY_FACES && is_list && is_corners ? QM_PLY_CORNERS : QM_PLY_OTHER;
}

static qm_status add_property(qm_ply_reader *reader, qm_ply_element *element, qm_ply_property property)
{
    for (size_t i = 0; property.role != QM_PLY_OTHER && i < element->property_count; ++i)
        if (reader->properties[element->first_property + i].role == property.role)
            return qm_ply_fail(reader, "the header describes a coordinate, a normal or the corners twice");
    if (property.role == QM_PLY_CORNERS && qm_ply_is_float(property.type))
        return qm_ply_fail(reader, "the corners of faces must be integers");
    void *block = reader->properties;
    if (!qm_codec_reserve(reader->builder->ctx, &block, &reader->property_capacity,
                          reader->property_count + 1, sizeof property))
        return QM_E_NO_MEMORY;
    reader->properties = block;
    reader->properties[reader->property_count++] = property;
    ++element->property_count;
    return QM_OK;
}

static qm_status read_property(qm_ply_reader *reader)
{
    if (reader->element_count == 0) return qm_ply_fail(reader, "a property comes before the first element");
    qm_ply_element *element = &reader->elements[reader->element_count - 1];
    qm_ply_property property = {.count_type = QM_PLY_NO_SCALAR};
    qm_scan ahead = reader->text;
    const uint8_t *word;
    size_t size;
    qm_status status = QM_OK;
    bool is_list = qm_scan_read_word(&ahead, &word, &size) && qm_scan_word_is(word, size, "list");
    if (is_list) {
        reader->text = ahead;
        status = read_scalar_type(reader, &property.count_type);
        if (status == QM_OK && qm_ply_is_float(property.count_type))
            return qm_ply_fail(reader, "the length of a list must be an integer");
    }
    if (status == QM_OK) status = read_scalar_type(reader, &property.type);
    if (status != QM_OK) return status;
    if (!qm_scan_read_word(&reader->text, &word, &size)) return qm_ply_fail(reader, "a property has no name");
    property.role = find_role(element, is_list, word, size);
    return add_property(reader, element, property);
}

/** A comment "grid ROWS COLUMNS" says that faces form a grid; other comments are ignored. */
static qm_status read_comment(qm_ply_reader *reader)
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

/** Reads the lines of the header through end_header. */
static qm_status read_header_lines(qm_ply_reader *reader)
{
    for (;;) {
        const uint8_t *word;
        size_t size;
        if (reader->text.at == reader->text.end) return qm_ply_fail(reader, "the header has no end");
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
                status = qm_ply_fail(reader, "the header has an unknown line");
        }
        if (status != QM_OK) return status;
        qm_scan_skip_line(&reader->text);
    }
}

static qm_status check_elements(qm_ply_reader *reader)
{
    unsigned roles = 0;
    bool has_corners = false, has_faces = false;
    size_t other_count = 0;
    for (size_t i = 0; i < reader->property_count; ++i) {
        int role = reader->properties[i].role;
        if (role < QM_PLY_CORNERS) roles |= 1u << role;
        has_corners |= role == QM_PLY_CORNERS;
    }
    if ((roles & 7) != 7)
        return qm_ply_fail(reader, "the header describes no element vertex with properties x, y and z");
    for (size_t i = 0; i < reader->element_count; ++i) {
        const qm_ply_element *element = &reader->elements[i];
        if (element->kind == QM_PLY_FACES && element->count > 0 && !has_corners)
            return qm_ply_fail(reader, "the faces have no list named vertex_indices or vertex_index");
        other_count += element->kind == QM_PLY_OTHERS && element->count > 0;
        has_faces |= element->kind == QM_PLY_FACES && element->count > 0;
    }
    reader->has_normals = roles == 63 && !has_faces;
    if (other_count > 0)
        qm_codec_warn(reader->report, "elements other than vertex and face: %zu (ignored)", other_count);
    return QM_OK;
}

qm_status qm_ply_read_header(qm_ply_reader *reader)
{
    const uint8_t *word;
    size_t size;
    if (!qm_scan_read_word(&reader->text, &word, &size) || !qm_scan_word_is(word, size, "ply"))
        return qm_ply_fail(reader, "the file does not start with the word ply");
    qm_scan_skip_line(&reader->text);
    qm_status status = read_header_lines(reader);
    if (status != QM_OK) return status;
    if (reader->encoding == QM_PLY_NO_ENCODING) return qm_ply_fail(reader, "the header has no format line");
    qm_scan_skip_line(&reader->text);
    return check_elements(reader);
}
