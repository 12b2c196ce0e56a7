/**
 * codec_ply_binary.c: the rows of a binary PLY file.
 */
#include <math.h>

#include "codec_ply.h"

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

static int64_t load_integer(const qm_ply_reader *reader, qm_ply_scalar type, const uint8_t *at)
{
    uint64_t bits = load_bits(at, qm_ply_scalars[type].size, reader->swaps_bytes);
    switch (type) {
    case QM_PLY_INT8:
        return (int8_t)bits;
    case QM_PLY_INT16:
        return (int16_t)bits;
    case QM_PLY_INT32:
        return (int32_t)bits;
    default:
        return (int64_t)bits;
    }
}

static double load_number(const qm_ply_reader *reader, qm_ply_scalar type, const uint8_t *at)
{
    if (!qm_ply_is_float(type)) return (double)load_integer(reader, type, at);
    uint64_t bits = load_bits(at, qm_ply_scalars[type].size, reader->swaps_bytes);
    double number;
    memcpy(&number, &bits, sizeof number);
    if (type == QM_PLY_FLOAT64) return number;
    uint32_t low = (uint32_t)bits;
    float narrow;
    memcpy(&narrow, &low, sizeof narrow);
    return narrow;
}

static qm_status fail_short(qm_ply_reader *reader)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends within a row");
}

/** Checks that size bytes are left at text.at. */
static bool has_bytes(const qm_ply_reader *reader, uint64_t size)
{
    return (uint64_t)(reader->text.end - reader->text.at) >= size;
}

static qm_status read_binary_list(qm_ply_reader *reader, const qm_ply_property *property)
{
    size_t count_size = qm_ply_scalars[property->count_type].size, size = qm_ply_scalars[property->type].size;
    if (!has_bytes(reader, count_size)) return fail_short(reader);
    int64_t length = load_integer(reader, property->count_type, reader->text.at);
    if (length < 0) return qm_ply_fail(reader, "the length of a list is negative");
    reader->text.at += count_size;
    if (!has_bytes(reader, (uint64_t)length * size)) return fail_short(reader);
    if (property->role != QM_PLY_CORNERS) {
        reader->text.at += (size_t)length * size;
        return QM_OK;
    }
    for (int64_t i = 0; i < length; ++i, reader->text.at += size) {
        qm_status status = qm_ply_add_corner(reader, load_integer(reader, property->type, reader->text.at));
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status read_binary_row(qm_ply_reader *reader, const qm_ply_element *element)
{
    double value[QM_PLY_CORNERS] = {0};
    const qm_ply_property *property = reader->properties + element->first_property;
    for (const qm_ply_property *end = property + element->property_count; property < end; ++property) {
        if (property->count_type != QM_PLY_NO_SCALAR) {
            qm_status status = read_binary_list(reader, property);
            if (status != QM_OK) return status;
            continue;
        }
        if (!has_bytes(reader, qm_ply_scalars[property->type].size)) return fail_short(reader);
        if (property->role < QM_PLY_CORNERS) {
            double number = load_number(reader, property->type, reader->text.at);
            if (property->role < QM_PLY_NORMAL && !isfinite(number))
                return qm_codec_fail(reader->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
            value[property->role] = number;
        }
        reader->text.at += qm_ply_scalars[property->type].size;
    }
    return qm_ply_end_row(reader, element->kind, value);
}

/** The commonest rows, for which a walk over the properties would take most of the time: three doubles or
 * floats first, or nothing but corners as 32-bit numbers after a byte. */
typedef enum plain_row { NOT_PLAIN, PLAIN_DOUBLES, PLAIN_FLOATS, PLAIN_CORNERS } plain_row;

static plain_row find_plain(const qm_ply_reader *reader, const qm_ply_element *element)
{
    const qm_ply_property *first = reader->properties + element->first_property;
    if (reader->swaps_bytes) return NOT_PLAIN;
    if (element->kind == QM_PLY_FACES && element->property_count == 1 && first->role == QM_PLY_CORNERS) {
        bool is_plain = first->count_type == QM_PLY_UINT8 &&
                        (first->type == QM_PLY_INT32 || first->type == QM_PLY_UINT32) &&
                        reader->vertex_count <= INT32_MAX;
        return is_plain ? PLAIN_CORNERS : NOT_PLAIN;
    }
    if (element->kind != QM_PLY_VERTICES || element->property_count != 3) return NOT_PLAIN;
    for (int axis = 0; axis < 3; ++axis)
        if (first[axis].role != QM_PLY_COORDINATE + axis || first[axis].type != first->type ||
            first[axis].count_type != QM_PLY_NO_SCALAR)
            return NOT_PLAIN;
    return first->type == QM_PLY_FLOAT64   ? PLAIN_DOUBLES
           : first->type == QM_PLY_FLOAT32 ? PLAIN_FLOATS
                                           : NOT_PLAIN;
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
static qm_status read_plain_positions(qm_ply_reader *reader, plain_row plain, uint64_t count, uint64_t *done)
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

static qm_status read_plain_faces(qm_ply_reader *reader, uint64_t count, uint64_t *done)
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

static qm_status read_plain_rows(qm_ply_reader *reader, plain_row plain, uint64_t count, uint64_t *done)
{
    if (plain == NOT_PLAIN) return QM_OK;
    return plain == PLAIN_CORNERS ? read_plain_faces(reader, count, done)
                                  : read_plain_positions(reader, plain, count, done);
}

qm_status qm_ply_read_binary_rows(qm_ply_reader *reader, const qm_ply_element *element)
{
    if (element->property_count == 0) return QM_OK;
    plain_row plain = find_plain(reader, element);
    qm_status status = QM_OK;
    for (uint64_t done = 0; done < element->count && status == QM_OK; ++done) {
        status = read_plain_rows(reader, plain, element->count, &done);
        if (status == QM_OK && done < element->count) status = read_binary_row(reader, element);
    }
    return status;
}
