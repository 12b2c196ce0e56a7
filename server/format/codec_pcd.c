/**
 * codec_pcd.c: PCD, the point clouds of the Point Cloud Library: a text header that describes the fields of a point, then
 * the points as text, as packed little-endian rows, or as one array a field compressed with LZF. The coordinates are the
 * fields x, y and z; normal_x, normal_y and normal_z are kept too; other fields are skipped by their size, and so is the
 * viewpoint. A point whose coordinates are not finite is one that the sensor did not see: it is left out, and counted in
 * a warning.
 * Source: the PCD file format, version 0.7, of the Point Cloud Library's documentation.
 */
#include <math.h>

#include "codec_builder.h"
#include "codec_scan.h"
#include "encoder_internal.h"

#define MAX_FIELDS 128
#define MAX_POINT_SIZE (1 << 20) /* bytes */

/** The use of a field: PCD_COORDINATE + axis, PCD_NORMAL + axis, or none. */
enum { PCD_COORDINATE, PCD_NORMAL = 3, PCD_ROLES = 6, PCD_OTHER = PCD_ROLES };

typedef struct pcd_field {
    int role;
    uint8_t type; /* F, I or U */
    size_t size, count;
    size_t offset; /* in a packed row */
} pcd_field;

typedef enum pcd_encoding { PCD_NO_ENCODING, PCD_ASCII, PCD_BINARY, PCD_COMPRESSED } pcd_encoding;

typedef struct pcd_reader {
    qm_builder *builder;
    qm_codec_report *report;
    qm_scan text; /* the header, and the rows of a text; binary rows are read at text.at */
    pcd_encoding encoding;
    pcd_field fields[MAX_FIELDS];
    size_t field_count;
    size_t row_size, column_count;     /* of a point: bytes, and numbers */
    uint64_t width, height, points;    /* of the header */
    unsigned seen;                     /* entries of the header, a bit each */
    const pcd_field *roles[PCD_ROLES]; /* NULL: there is no such field */
    bool has_normals;
    size_t unseen_count; /* points without finite coordinates */
} pcd_reader;

static qm_status pcd_fail(pcd_reader *reader, const char *detail)
{
    return qm_codec_fail(reader->report, QM_E_FORMAT, "%s", detail);
}

/* ---- the header ---- */

typedef enum pcd_entry {
    PCD_VERSION,
    PCD_FIELDS,
    PCD_SIZE,
    PCD_TYPE,
    PCD_COUNT,
    PCD_WIDTH,
    PCD_HEIGHT,
    PCD_VIEWPOINT,
    PCD_POINTS,
    PCD_DATA,
    PCD_ENTRIES
} pcd_entry;

static const char *const entry_names[PCD_ENTRIES] = {"version", "fields", "size",      "type",   "count",
                                                     "width",   "height", "viewpoint", "points", "data"};

static qm_status read_names(pcd_reader *reader)
{
    static const char *const names[PCD_ROLES] = {"x", "y", "z", "normal_x", "normal_y", "normal_z"};
    const uint8_t *word;
    size_t size;
    while (qm_scan_read_word(&reader->text, &word, &size)) {
        if (reader->field_count == MAX_FIELDS)
            return qm_codec_fail(reader->report, QM_E_TOO_LARGE, "the points have more than %d fields",
                                 MAX_FIELDS);
        pcd_field *field = &reader->fields[reader->field_count++];
        *field = (pcd_field){.role = PCD_OTHER, .type = 'F', .size = 4, .count = 1};
        for (int role = 0; role < PCD_ROLES; ++role) {
            if (!qm_scan_word_is(word, size, names[role])) continue;
            if (reader->roles[role])
                return pcd_fail(reader, "the header describes a coordinate or a normal twice");
            reader->roles[role] = field;
            field->role = role;
        }
    }
    return QM_OK;
}

/** Reads the size, type or count of each field. */
static qm_status read_facts(pcd_reader *reader, pcd_entry entry)
{
    const uint8_t *word;
    size_t size, i = 0;
    for (; i < reader->field_count; ++i) {
        pcd_field *field = &reader->fields[i];
        int64_t number = 0;
        qm_status status = QM_OK;
        if (entry == PCD_TYPE) {
            if (!qm_scan_read_word(&reader->text, &word, &size)) break;
            field->type = size == 1 ? word[0] & 0xdf : 0;
            if (field->type == 'F' || field->type == 'I' || field->type == 'U') continue;
            return pcd_fail(reader, "the type of a field must be F, I or U");
        }
        status = qm_scan_read_integer(&reader->text, &number);
        if (status != QM_OK) return status;
        if (entry == PCD_SIZE && number != 1 && number != 2 && number != 4 && number != 8)
            return pcd_fail(reader, "the size of a field must be 1, 2, 4 or 8");
        if (number < 0 || number > MAX_POINT_SIZE)
            return pcd_fail(reader, "the count of a field is out of range");
        *(entry == PCD_SIZE ? &field->size : &field->count) = (size_t)number;
    }
    qm_scan_skip_blanks(&reader->text);
    if (i < reader->field_count || !qm_scan_at_row_end(&reader->text))
        return pcd_fail(reader, "the line has another number of values than FIELDS");
    return QM_OK;
}

static qm_status read_count(pcd_reader *reader, uint64_t *count)
{
    int64_t number;
    qm_status status = qm_scan_read_integer(&reader->text, &number);
    if (status == QM_OK && number < 0) return pcd_fail(reader, "a count of points is negative");
    *count = (uint64_t)number;
    return status;
}

static qm_status read_encoding(pcd_reader *reader)
{
    const uint8_t *word;
    size_t size;
    char shown[QM_SCAN_SHOWN_SIZE];
    if (!qm_scan_read_word(&reader->text, &word, &size))
        return pcd_fail(reader, "the DATA line has no encoding");
    if (qm_scan_word_is(word, size, "ascii")) reader->encoding = PCD_ASCII;
    if (qm_scan_word_is(word, size, "binary")) reader->encoding = PCD_BINARY;
    if (qm_scan_word_is(word, size, "binary_compressed")) reader->encoding = PCD_COMPRESSED;
    if (reader->encoding != PCD_NO_ENCODING) return QM_OK;
    return qm_codec_fail(reader->report, QM_E_UNSUPPORTED, "the encoding \"%s\" is not supported",
                         qm_scan_show(word, size, shown));
}

static qm_status read_entry(pcd_reader *reader, const uint8_t *word, size_t size)
{
    pcd_entry entry = PCD_VERSION;
    while (entry < PCD_ENTRIES && !qm_scan_word_is(word, size, entry_names[entry]))
        ++entry;
    if (qm_scan_word_is(word, size, "columns")) entry = PCD_FIELDS; /* until version 0.5 */
    if (entry == PCD_ENTRIES) {
        char shown[QM_SCAN_SHOWN_SIZE];
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "line %zu of the header starts with \"%s\", which is no entry of PCD",
                             reader->text.line, qm_scan_show(word, size, shown));
    }
    if (reader->seen & 1u << entry) return pcd_fail(reader, "the header has an entry twice");
    reader->seen |= 1u << entry;
    if (entry == PCD_FIELDS) return read_names(reader);
    if (entry == PCD_WIDTH) return read_count(reader, &reader->width);
    if (entry == PCD_HEIGHT) return read_count(reader, &reader->height);
    if (entry == PCD_POINTS) return read_count(reader, &reader->points);
    if (entry == PCD_DATA) return read_encoding(reader);
    if (entry == PCD_VERSION || entry == PCD_VIEWPOINT) return QM_OK;
    if (!(reader->seen & 1u << PCD_FIELDS))
        return pcd_fail(reader, "the sizes, types and counts of fields must follow FIELDS");
    return read_facts(reader, entry);
}

/** Checks the fields, and gives each its place in a row. */
static qm_status lay_out(pcd_reader *reader)
{
    for (int axis = 0; axis < 3; ++axis)
        if (!reader->roles[PCD_COORDINATE + axis])
            return pcd_fail(reader, "the header describes no fields x, y and z");
    for (size_t i = 0; i < reader->field_count; ++i) {
        pcd_field *field = &reader->fields[i];
        if (field->role != PCD_OTHER && field->count != 1)
            return pcd_fail(reader, "a coordinate or a normal must have the count 1");
        if (field->type == 'F' && field->size < 4)
            return pcd_fail(reader, "a field of type F must have the size 4 or 8");
        field->offset = reader->row_size;
        reader->row_size += field->size * field->count;
        reader->column_count += field->count;
        if (reader->row_size > MAX_POINT_SIZE)
            return qm_codec_fail(reader->report, QM_E_TOO_LARGE, "a point has more than %d bytes",
                                 MAX_POINT_SIZE);
    }
    reader->has_normals = true;
    for (int role = PCD_NORMAL; role < PCD_ROLES; ++role)
        reader->has_normals &= reader->roles[role] != NULL;
    if (!(reader->seen & 1u << PCD_HEIGHT)) reader->height = 1;
    unsigned __int128 product = (unsigned __int128)reader->width * reader->height;
    if (!(reader->seen & 1u << PCD_POINTS))
        reader->points = product > INT64_MAX ? INT64_MAX : (uint64_t)product;
    else if (reader->seen & 1u << PCD_WIDTH && product != reader->points)
        return pcd_fail(reader, "POINTS differs from WIDTH times HEIGHT");
    return QM_OK;
}

static qm_status read_header(pcd_reader *reader)
{
    qm_status status = QM_OK;
    while (status == QM_OK && reader->encoding == PCD_NO_ENCODING) {
        const uint8_t *word;
        size_t size;
        if (!qm_scan_find_row(&reader->text)) return pcd_fail(reader, "the header has no DATA line");
        qm_scan_read_word(&reader->text, &word, &size);
        status = read_entry(reader, word, size);
        if (status == QM_OK && reader->encoding == PCD_NO_ENCODING) qm_scan_skip_line(&reader->text);
    }
    if (status == QM_OK) status = lay_out(reader);
    if (status == QM_OK) qm_scan_skip_line(&reader->text);
    return status;
}

/** Checks the count of the header against the bytes that are left, and reserves the vertices. */
static qm_status start_points(pcd_reader *reader, uint64_t left, size_t row_size)
{
    if (reader->points > left / row_size)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %llu points, but the file has room for %llu",
                             (unsigned long long)reader->points, (unsigned long long)(left / row_size));
    return qm_builder_reserve_vertices(reader->builder, reader->points);
}

static qm_status add_point(pcd_reader *reader, const double value[PCD_ROLES])
{
    const double *position = value + PCD_COORDINATE;
    if (!isfinite(position[0]) || !isfinite(position[1]) || !isfinite(position[2])) {
        ++reader->unseen_count;
        return QM_OK;
    }
    qm_status status = qm_builder_add_vertex(reader->builder, position);
    if (status != QM_OK || !reader->has_normals) return status;
    return qm_builder_set_normal(reader->builder, value + PCD_NORMAL);
}

/* ---- text ---- */

/** Whether a word is a number that is not finite, as the library writes it. */
static bool is_not_finite(const uint8_t *word, size_t size)
{
    if (size > 0 && (*word == '-' || *word == '+')) ++word, --size;
    return qm_scan_word_is(word, size, "nan") || qm_scan_word_is(word, size, "inf");
}

static qm_status read_text_row(pcd_reader *reader, double value[PCD_ROLES])
{
    qm_scan *text = &reader->text;
    const uint8_t *word;
    size_t size;
    for (size_t i = 0; i < reader->field_count; ++i) {
        const pcd_field *field = &reader->fields[i];
        for (size_t k = 0; k < field->count; ++k) {
            qm_scan ahead = *text;
            if (!qm_scan_read_word(&ahead, &word, &size))
                return qm_codec_fail(reader->report, QM_E_FORMAT,
                                     "the line ends where a number is expected; a point has %zu",
                                     reader->column_count);
            if (field->role == PCD_OTHER) {
                *text = ahead;
            } else if (is_not_finite(word, size)) {
                value[field->role] = NAN;
                *text = ahead;
            } else {
                qm_status status = qm_scan_read_number(text, &value[field->role]);
                if (status != QM_OK) return status;
            }
        }
    }
    qm_scan_skip_blanks(text);
    return qm_scan_at_row_end(text) ? QM_OK : pcd_fail(reader, "a point has more values than fields");
}

static qm_status read_text_rows(pcd_reader *reader)
{
    /* A digit and a blank each; the last line end is optional. */
    uint64_t left = (uint64_t)(reader->text.end - reader->text.at) + 1;
    qm_status status = start_points(reader, left, 2 * reader->column_count);
    for (uint64_t i = 0; i < reader->points && status == QM_OK; ++i) {
        double value[PCD_ROLES] = {0};
        if (!qm_scan_find_row(&reader->text))
            return qm_codec_fail(reader->report, QM_E_FORMAT, "the file ends after %llu of %llu points",
                                 (unsigned long long)i, (unsigned long long)reader->points);
        status = read_text_row(reader, value);
        if (status == QM_OK) status = add_point(reader, value);
        if (status == QM_OK) qm_scan_skip_line(&reader->text);
    }
    if (status == QM_OK && qm_scan_find_row(&reader->text))
        qm_codec_warn(reader->report,
                      "line %zu and the following ones come after the last point and were ignored",
                      reader->text.line);
    return status;
}

/* ---- binary ---- */

static double load_number(const pcd_field *field, const uint8_t *at)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < field->size; ++i)
        bits |= (uint64_t)at[i] << 8 * i;
    if (field->type == 'U') return (double)bits;
    if (field->type == 'I') {
        const unsigned unused = (unsigned)(8 * (sizeof bits - field->size));
        return (double)((int64_t)(bits << unused) >> unused);
    }
    double number;
    memcpy(&number, &bits, sizeof number);
    return field->size == 8 ? number : (double)qm_read_f32_le(at);
}

/** Reads the points of packed rows, or of arrays of one field each. */
static qm_status read_binary_rows(pcd_reader *reader, const uint8_t *bytes, bool has_arrays)
{
    for (uint64_t i = 0; i < reader->points; ++i) {
        double value[PCD_ROLES] = {0};
        for (int role = 0; role < (reader->has_normals ? PCD_ROLES : PCD_NORMAL); ++role) {
            const pcd_field *field = reader->roles[role];
            /* The arrays have the order of the fields in a row. */
            const uint8_t *at = has_arrays ? bytes + reader->points * field->offset + i * field->size
                                           : bytes + i * reader->row_size + field->offset;
            value[role] = load_number(field, at);
        }
        qm_status status = add_point(reader, value);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/**
 * Expands LZF data, which must fill the output; false for data that is damaged. A byte below 32 is followed by one more
 * literal byte than it says; others have a length in the high three bits, where 7 adds a byte, and a distance back.
 * Source: liblzf by Marc Lehmann, its decoder, for the format.
 */
static bool expand_lzf(const uint8_t *at, size_t size, uint8_t *out, size_t out_size)
{
    const uint8_t *const end = at + size;
    size_t done = 0;
    while (at < end) {
        const uint8_t head = *at++;
        if (head < 32) {
            const size_t length = (size_t)head + 1;
            if ((size_t)(end - at) < length || out_size - done < length) return false;
            memcpy(out + done, at, length);
            at += length;
            done += length;
            continue;
        }
        size_t length = (size_t)(head >> 5) + 2;
        if (length == 7 + 2) {
            if (at == end) return false;
            length += *at++;
        }
        if (at == end) return false;
        const size_t distance = ((size_t)(head & 31) << 8) + *at++ + 1;
        if (distance > done || out_size - done < length) return false;
        for (; length > 0; --length, ++done)
            out[done] = out[done - distance]; /* they may overlap */
    }
    return done == out_size;
}

#define MAX_LZF_RATIO 88 /* 264 bytes of three */

static qm_status read_compressed(pcd_reader *reader)
{
    const uint8_t *at = reader->text.at;
    const size_t left = (size_t)(reader->text.end - at);
    if (left < 8)
        return pcd_fail(reader, "the file ends where the sizes of the compressed points are expected");
    const size_t size = qm_read_u32_le(at), out_size = qm_read_u32_le(at + 4);
    reader->text.at = at += 8;
    if (size > left - 8)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the compressed points have %zu bytes, but the file ends after %zu", size,
                             left - 8);
    if (out_size / MAX_LZF_RATIO > size || out_size % reader->row_size != 0 ||
        out_size / reader->row_size != reader->points)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %llu points of %zu bytes, the compressed data %zu bytes",
                             (unsigned long long)reader->points, reader->row_size, out_size);
    qm_context *ctx = reader->builder->ctx;
    const size_t max_size = reader->builder->limits->max_size;
    if (max_size > 0 && out_size > max_size)
        return qm_codec_fail(reader->report, QM_E_TOO_LARGE, "the points have more than %zu bytes", max_size);
    qm_status status = start_points(reader, out_size, reader->row_size);
    if (status != QM_OK || out_size == 0) return status;
    uint8_t *out = qm_context_alloc(ctx, out_size, 1);
    if (!out) return QM_E_NO_MEMORY;
    if (expand_lzf(at, size, out, out_size))
        status = read_binary_rows(reader, out, true);
    else
        status = pcd_fail(reader, "the compressed points are damaged");
    qm_context_free(ctx, out, out_size, 1);
    reader->text.at += status == QM_OK ? size : 0;
    return status;
}

static qm_status read_binary(pcd_reader *reader)
{
    if (reader->encoding == PCD_COMPRESSED) return read_compressed(reader);
    qm_status status = start_points(reader, (uint64_t)(reader->text.end - reader->text.at), reader->row_size);
    if (status == QM_OK) status = read_binary_rows(reader, reader->text.at, false);
    if (status == QM_OK) reader->text.at += reader->points * reader->row_size;
    return status;
}

/* ---- the file ---- */

static qm_status read_points(pcd_reader *reader, const uint8_t *bytes, size_t size)
{
    qm_status status = read_header(reader);
    if (status == QM_OK && reader->encoding == PCD_ASCII) {
        /* Opening the file again as text checks all of it for NUL bytes. */
        qm_scan header = reader->text;
        status = qm_scan_open(&reader->text, bytes, size, reader->report);
        if (status == QM_OK) reader->text = header;
        if (status == QM_OK) status = read_text_rows(reader);
    } else if (status == QM_OK) {
        status = read_binary(reader);
        if (status == QM_OK && reader->text.at < reader->text.end)
            qm_codec_warn(reader->report, "bytes after the last point: %zu (ignored)",
                          (size_t)(reader->text.end - reader->text.at));
    }
    if (status == QM_OK && reader->unseen_count > 0)
        qm_codec_warn(reader->report, "points whose coordinates are not finite: %zu (left out)",
                      reader->unseen_count);
    if (status == QM_OK && reader->unseen_count > 0 && reader->builder->vertex_count == 0)
        status = qm_codec_fail(reader->report, QM_E_EMPTY, "no point has finite coordinates");
    return status;
}

qm_status qm_codec_decode_pcd(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    pcd_reader reader = {.builder = builder,
                         .report = builder->report,
                         .text = {.at = bytes, .end = bytes + size, .line = 1, .report = builder->report}};
    qm_scan_skip_mark(&reader.text);
    qm_status status = read_points(&reader, bytes, size);
    if (reader.encoding == PCD_BINARY || reader.encoding == PCD_COMPRESSED)
        builder->report->offset = (size_t)(reader.text.at - bytes);
    else
        builder->report->line = reader.text.line;
    return status;
}

/* ---- encoding ---- */

static void add_pcd_head(const qm_encoder *encoder, qm_text *out)
{
    size_t count = encoder->mesh->vertex_count;
    qm_text_printf(out,
                   "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\n"
                   "TYPE F F F\nCOUNT 1 1 1\nWIDTH %zu\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS %zu\n"
                   "DATA binary\n",
                   count, count);
}

static qm_status prepare_pcd(qm_encoder *encoder)
{
    if (encoder->mesh->face_count > 0)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED,
                               "pcd holds points only, and the mesh has faces");
    qm_text head = {0};
    add_pcd_head(encoder, &head);
    encoder->size = head.size + 24 * (uint64_t)encoder->mesh->vertex_count;
    qm_status status = head.failed ? QM_E_NO_MEMORY : QM_OK;
    qm_text_reset(&head);
    return status;
}

static void add_pcd_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    for (int axis = 0; axis < 3; axis++)
        qm_encoder_add_f64(out, encoder->mesh->positions[3 * vertex + (size_t)axis]);
}

const qm_encoder_format qm_encoder_pcd = {prepare_pcd, add_pcd_head, add_pcd_vertex, NULL, false};
