/**
 * codec_stl.c: STL: triangles with their own corners, as text or binary; corners with the same coordinates are welded. A
 * binary header may start with "solid" like a text, so the size that follows from the count decides first.
 * Normals and attribute bytes are left out: corners and their order say the same.
 */
#include <math.h>

#include "codec_scan.h"
#include "codec_welder.h"
#include "encoder_internal.h"

#define HEADER_SIZE 80
#define PREFIX_SIZE 84 /* header and count */
#define TRIANGLE_SIZE 50
#define TEXT_SIZE 250 /* of a triangle with six decimals, or so */
#define NORMAL_SIZE 12
#define TRIANGLES_TOGETHER (QM_WELDER_BATCH / 3)

bool qm_codec_is_binary_stl(const uint8_t *bytes, size_t size)
{
    return size >= PREFIX_SIZE &&
           (size - PREFIX_SIZE) == (uint64_t)qm_read_u32_le(bytes + HEADER_SIZE) * TRIANGLE_SIZE;
}

/** For files whose size is inconclusive: text starts with "solid" and has no NUL byte near its start. */
static bool looks_like_text(const uint8_t *bytes, size_t size)
{
    size_t head = size < 512 ? size : 512;
    qm_scan text = {.at = bytes, .end = bytes + size, .line = 1};
    const uint8_t *word;
    size_t word_size;
    return !memchr(bytes, 0, head) && qm_scan_find_row(&text) &&
           qm_scan_read_word(&text, &word, &word_size) && qm_scan_word_is(word, word_size, "solid");
}

/** Adds consecutive triangles by their positions; after a failure *done counts the corners before it. */
static qm_status add_triangles(qm_welder *welder, const double (*corners)[3], size_t count, size_t *done)
{
    uint32_t vertices[3 * TRIANGLES_TOGETHER];
    qm_status status = qm_welder_find(welder, corners[0], 3 * count, vertices, done);
    for (size_t i = 0; i < *done / 3; ++i) {
        const uint32_t *v = vertices + 3 * i;
        qm_status added = qm_builder_add_triangle(welder->builder, v[0], v[1], v[2]);
        if (added != QM_OK) return added;
    }
    return status;
}

/* Binary */

/** False when a coordinate is not finite. */
static bool load_triangle(const uint8_t *at, double corners[3][3])
{
    bool is_finite = true;
    for (int i = 0; i < 9; ++i) {
        double number = qm_read_f32_le(at + NORMAL_SIZE + 4 * i);
        corners[i / 3][i % 3] = number;
        is_finite &= isfinite(number) != 0;
    }
    return is_finite;
}

static qm_status read_binary(qm_welder *welder, const uint8_t *bytes, size_t size)
{
    qm_codec_report *report = welder->builder->report;
    report->offset = size;
    if (size < PREFIX_SIZE)
        return qm_codec_fail(report, QM_E_FORMAT,
                             "the file is neither a text STL nor long enough for a binary one");
    report->offset = HEADER_SIZE;
    size_t count = qm_read_u32_le(bytes + HEADER_SIZE), room = (size - PREFIX_SIZE) / TRIANGLE_SIZE;
    if (count > room)
        return qm_codec_fail(report, QM_E_FORMAT,
                             "the header specifies %zu triangles, but the file has room for %zu", count,
                             room);
    if (count == 0) return qm_codec_fail(report, QM_E_EMPTY, "the file has no triangle");
    size_t rest = size - PREFIX_SIZE - count * TRIANGLE_SIZE;
    if (rest > 0) qm_codec_warn(report, "bytes after the last triangle: %zu (ignored)", rest);
    qm_status status = qm_builder_reserve_faces(welder->builder, count);
    if (status != QM_OK) return status;
    report->offset = PREFIX_SIZE;
    for (size_t i = 0; i < count; i += TRIANGLES_TOGETHER) {
        const size_t most = count - i < TRIANGLES_TOGETHER ? count - i : TRIANGLES_TOGETHER;
        double corners[3 * TRIANGLES_TOGETHER][3];
        size_t good = 0, done;
        while (good < most &&
               load_triangle(bytes + report->offset + good * TRIANGLE_SIZE, &corners[3 * good]))
            ++good;
        status = add_triangles(welder, (const double(*)[3])corners, good, &done);
        report->offset += done / 3 * TRIANGLE_SIZE;
        if (status != QM_OK) return status;
        if (good < most) return qm_codec_fail(report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
    }
    return QM_OK;
}

/* Text */

typedef struct stl_text {
    qm_scan text;
    qm_welder *welder;
    bool in_solid, in_facet;
    int corner_count;   /* of the facet */
    size_t facet_count; /* complete, but not yet added; the current one follows them */
    size_t lines[TRIANGLES_TOGETHER];
    double corners[3 * TRIANGLES_TOGETHER][3];
} stl_text;

static qm_status fail_text(stl_text *reader, const char *detail)
{
    return qm_codec_fail(reader->text.report, QM_E_FORMAT, "%s", detail);
}

/** Begins a facet and skips its normal unread, because writers put NaN into those of slivers. */
static qm_status begin_facet(stl_text *reader)
{
    if (!reader->in_solid) return fail_text(reader, "a facet outside of a solid");
    if (reader->in_facet) return fail_text(reader, "a facet begins within another one");
    reader->in_facet = true;
    reader->corner_count = 0;
    const uint8_t *word;
    size_t size;
    if (!qm_scan_read_word(&reader->text, &word, &size)) return QM_OK;
    if (!qm_scan_word_is(word, size, "normal")) return fail_text(reader, "a facet without a normal");
    for (int i = 0; i < 3; ++i)
        if (!qm_scan_read_word(&reader->text, &word, &size))
            return fail_text(reader, "a normal has fewer than three numbers");
    return QM_OK;
}

/** Adds the pending facets; an error is reported at the line of its facet. */
static qm_status add_facets(stl_text *reader)
{
    size_t done;
    qm_status status =
        add_triangles(reader->welder, (const double(*)[3])reader->corners, reader->facet_count, &done);
    if (status != QM_OK) reader->text.line = reader->lines[done / 3];
    reader->facet_count = 0;
    return status;
}

/** A name may follow and fills the rest of the line. */
static qm_status change_solid(stl_text *reader, bool begins)
{
    if (reader->in_facet) return fail_text(reader, "a facet has no end");
    if (reader->in_solid == begins)
        return fail_text(reader, begins ? "a solid begins within another one" : "endsolid without a solid");
    reader->in_solid = begins;
    qm_scan_skip_line(&reader->text);
    return QM_OK;
}

static qm_status read_statement(stl_text *reader)
{
    const uint8_t *word;
    size_t size;
    qm_scan_read_word(&reader->text, &word, &size);
    if (qm_scan_word_is(word, size, "vertex")) {
        if (!reader->in_facet) return fail_text(reader, "a vertex outside of a facet");
        if (reader->corner_count == 3) return fail_text(reader, "a facet has more than three vertices");
        size_t corner = 3 * reader->facet_count + (size_t)reader->corner_count++;
        return qm_scan_read_position(&reader->text, reader->corners[corner]);
    }
    if (qm_scan_word_is(word, size, "facet")) return begin_facet(reader);
    if (qm_scan_word_is(word, size, "endfacet")) {
        if (!reader->in_facet) return fail_text(reader, "endfacet without a facet");
        if (reader->corner_count < 3) return fail_text(reader, "a facet has fewer than three vertices");
        reader->in_facet = false;
        reader->lines[reader->facet_count++] = reader->text.line;
        return reader->facet_count == TRIANGLES_TOGETHER ? add_facets(reader) : QM_OK;
    }
    if (qm_scan_word_is(word, size, "solid")) return change_solid(reader, true);
    if (qm_scan_word_is(word, size, "endsolid")) return change_solid(reader, false);
    if (qm_scan_word_is(word, size, "outer") || qm_scan_word_is(word, size, "loop") ||
        qm_scan_word_is(word, size, "endloop"))
        return QM_OK;
    return fail_text(reader, "unknown keyword");
}

static qm_status read_text(qm_welder *welder, const uint8_t *bytes, size_t size)
{
    stl_text reader = {.welder = welder};
    qm_status status = qm_scan_open(&reader.text, bytes, size, welder->builder->report);
    while (status == QM_OK && qm_scan_find_row(&reader.text))
        status = read_statement(&reader);
    if (status == QM_OK && reader.in_facet) status = fail_text(&reader, "the file ends within a facet");
    if (status == QM_OK && reader.in_solid)
        qm_codec_warn(reader.text.report, "the file ends without endsolid");
    /* An error of an earlier facet is reported first. */
    if (reader.facet_count > 0) {
        qm_status added = add_facets(&reader);
        if (added != QM_OK) status = added;
    }
    welder->builder->report->line = reader.text.line;
    return status;
}

qm_status qm_codec_decode_stl(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    qm_welder welder;
    bool is_text = !qm_codec_is_binary_stl(bytes, size) && looks_like_text(bytes, size);
    /* Closed surfaces have about half as many vertices as triangles. */
    size_t triangles = size / (is_text ? TEXT_SIZE : TRIANGLE_SIZE);
    qm_status status = qm_welder_create(builder, triangles / 2, &welder);
    if (status != QM_OK) return status;
    status = is_text ? read_text(&welder, bytes, size) : read_binary(&welder, bytes, size);
    qm_welder_destroy(&welder);
    return status;
}

/* ---- encoding ---- */

static qm_status prepare_stl(qm_encoder *encoder)
{
    if (encoder->mesh->face_count == 0)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED,
                               "stl holds triangles only, and the mesh has points");
    if (encoder->triangles > UINT32_MAX) return qm_encoder_fail_size(encoder);
    encoder->size = HEADER_SIZE + 4 + 50 * (uint64_t)encoder->triangles;
    encoder->losses.cut_faces = encoder->facts->quads + encoder->facts->polygons;
    encoder->losses.left_out_vertices = encoder->facts->unused_vertices;
    return qm_encoder_round_to_floats(encoder);
}

static void add_stl_head(const qm_encoder *encoder, qm_text *out)
{
    char head[HEADER_SIZE + 1] = {0};
    memcpy(head, "binary STL", strlen("binary STL"));
    qm_text_add(out, head, HEADER_SIZE);
    qm_encoder_add_u32(out, (uint32_t)encoder->triangles);
}

/** The unit normal; zero for a degenerate triangle, as the format allows. */
static void find_normal(const double *a, const double *b, const double *c, double normal[3])
{
    double u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        normal[i] = u[j] * v[k] - u[k] * v[j];
    }
    double length = hypot(hypot(normal[0], normal[1]), normal[2]);
    for (int i = 0; i < 3; i++)
        normal[i] = length > 0.0 && isfinite(length) ? normal[i] / length : 0.0;
}

static void add_stl_triangle(const qm_mesh *mesh, const uint32_t corners[3], qm_text *out)
{
    const double *p[3];
    double normal[3];
    for (int i = 0; i < 3; i++)
        p[i] = mesh->positions + 3 * (size_t)corners[i];
    find_normal(p[0], p[1], p[2], normal);
    for (int i = 0; i < 3; i++)
        qm_encoder_add_f32(out, normal[i]);
    for (int i = 0; i < 9; i++)
        qm_encoder_add_f32(out, p[i / 3][i % 3]);
    qm_text_add(out, "\0", 2);
}

static void add_stl_face(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    for (uint32_t face = first; face < end; face++) {
        uint32_t rows[2][3];
        int count = qm_encoder_list_triangles(encoder->mesh->faces + 4 * (size_t)face, rows);
        for (int i = 0; i < count; i++)
            add_stl_triangle(encoder->mesh, rows[i], out);
    }
}

const qm_encoder_format qm_encoder_stl = {prepare_stl, add_stl_head, NULL, add_stl_face, false};
