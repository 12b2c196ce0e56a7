/**
 * codec_drc.c: Draco: the library decodes and encodes behind codec_draco.h. Before it decodes, the counts in the header are
 * checked. Draco's meshes are triangles; the edges that cut a quad or polygon are marked in an attribute "added_edges",
 * as the library's own tools do: the encoder writes the marks, and the decoder joins triangles along them.
 *
 * The shorter of its two encodings drops degenerate faces and vertices without a face and splits vertices where the
 * surface is not a manifold, so it is for manifolds without such. A cut that other faces have as an edge is beyond
 * such marks: a reader finds the triangles there.
 * Source: Draco bitstream specification 2.2, sections 4 and 5.
 */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "codec_draco.h"
#include "codec_welder.h"
#include "encoder_internal.h"

/* ---- the header ---- */

typedef struct drc_head {
    const uint8_t *at, *end;
} drc_head;

#define MAGIC "DRACO"
#define HEAD_SIZE 11
#define HAS_METADATA 0x8000
#define DEEPEST_METADATA 64
/* 2.2 has the number of points again behind the head, and Draco sizes its arrays by it */
#define FIRST_SAFE_KD_TREE 3

static bool skip_bytes(drc_head *head, uint64_t size)
{
    if ((uint64_t)(head->end - head->at) < size) return false;
    head->at += size;
    return true;
}

/** Seven bits a byte, the low ones first. */
static bool read_varint(drc_head *head, uint64_t *number)
{
    *number = 0;
    for (unsigned shift = 0; shift < 63; shift += 7) {
        if (head->at == head->end) return false;
        uint8_t byte = *head->at++;
        *number |= (uint64_t)(byte & 0x7f) << shift;
        if (!(byte & 0x80)) return true;
    }
    return false;
}

static bool skip_name(drc_head *head)
{
    return head->at < head->end && skip_bytes(head, 1 + (uint64_t)*head->at);
}

/** One table of named values, and the tables within it. */
static bool skip_metadata(drc_head *head, int depth)
{
    uint64_t count, size;
    if (depth > DEEPEST_METADATA || !read_varint(head, &count)) return false;
    for (; count > 0; --count)
        if (!skip_name(head) || !read_varint(head, &size) || !skip_bytes(head, size)) return false;
    if (!read_varint(head, &count)) return false;
    for (; count > 0; --count)
        if (!skip_name(head) || !skip_metadata(head, depth + 1)) return false;
    return true;
}

/** Checks the counts in the header of a file against the limits, because a few bytes may specify a mesh that exhausts
 * memory. */
static qm_status check_head(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    size_t *offset = &builder->report->offset;
    *offset = 0;
    if (size < HEAD_SIZE || memcmp(bytes, MAGIC, strlen(MAGIC)) != 0)
        return qm_codec_fail(builder->report, QM_E_FORMAT, "the file does not start like a Draco file");
    *offset = strlen(MAGIC);
    if (bytes[5] != 2 || bytes[6] < 2)
        return qm_codec_fail(builder->report, QM_E_UNSUPPORTED,
                             "only version 2.2 and later of the Draco format is supported");
    if (bytes[7] == 0 && bytes[8] == 1 && bytes[6] < FIRST_SAFE_KD_TREE)
        return qm_codec_fail(
            builder->report, QM_E_UNSUPPORTED,
            "point clouds in a kd-tree are supported from version 2.3 of the Draco format on");
    drc_head head = {bytes + HEAD_SIZE, bytes + size};
    bool has_metadata = (bytes[9] | bytes[10] << 8) & HAS_METADATA;
    uint64_t vertices = 0, faces = 0, table_count = 0, id;
    bool whole = !has_metadata || read_varint(&head, &table_count);
    for (; whole && table_count > 0; --table_count) /* of attributes */
        whole = read_varint(&head, &id) && skip_metadata(&head, 0);
    if (has_metadata) whole = whole && skip_metadata(&head, 0);
    if (bytes[7] != 1) { /* a point cloud */
        whole = whole && head.end - head.at >= 4;
        if (whole) vertices = qm_read_u32_le(head.at);
    } else if (bytes[8] != 1) { /* sequential */
        whole = whole && read_varint(&head, &faces) && read_varint(&head, &vertices);
    } else { /* Edgebreaker */
        whole = whole && skip_bytes(&head, 1) && read_varint(&head, &vertices) && read_varint(&head, &faces);
    }
    *offset = (size_t)(head.at - bytes);
    if (!whole) return qm_codec_fail(builder->report, QM_E_FORMAT, "the header of the file is invalid");
    if (vertices > builder->limits->max_vertices || faces > builder->limits->max_faces)
        return qm_codec_fail(builder->report, QM_E_TOO_LARGE,
                             "the file has more than %zu vertices or more than %zu faces",
                             builder->limits->max_vertices, builder->limits->max_faces);
    return QM_OK;
}

/* ---- polygons of triangles ---- */

#define MAX_INSERTION 32 /* sides that an insertion sort sorts faster than qsort */

/** One side of an edge, filed under the lower one of its two vertices. Half-edge 3 * t + c of triangle t runs opposite to
 * corner c. */
typedef struct edge_side {
    uint32_t high; /* its other vertex */
    uint32_t half_edge;
} edge_side;

typedef struct joining {
    qm_builder *builder;
    qm_draco_facts facts;
    qm_draco_arrays arrays;
    uint32_t *twins; /* for each half-edge: the one beyond an added edge, or QM_NO_INDEX */
    uint8_t *done;   /* for each triangle: its polygon is stored */
} joining;

static uint32_t next_half_edge(uint32_t half_edge)
{
    return half_edge % 3 == 2 ? half_edge - 2 : half_edge + 1;
}

/** The vertex where the half-edge begins: the corner after the one opposite. */
static uint32_t start_of(const joining *join, uint32_t half_edge)
{
    return join->arrays.triangles[next_half_edge(half_edge)];
}

static uint32_t end_of(const joining *join, uint32_t half_edge)
{
    return join->arrays.triangles[next_half_edge(next_half_edge(half_edge))];
}

static int compare_sides(const void *left, const void *right)
{
    const edge_side *a = left, *b = right;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return a->half_edge < b->half_edge ? -1 : 1;
}

/** Sorts the sides filed under a vertex, which are in the order of their half-edges: few, except in hostile files. */
static void sort_sides(edge_side *sides, size_t count)
{
    if (count > MAX_INSERTION) {
        qsort(sides, count, sizeof *sides, compare_sides);
        return;
    }
    for (size_t i = 1; i < count; ++i) {
        const edge_side side = sides[i];
        size_t at = i;
        for (; at > 0 && sides[at - 1].high > side.high; --at)
            sides[at] = sides[at - 1];
        sides[at] = side;
    }
}

/** Files all sides under their lower vertices by a counting sort: those of vertex v end at ends[v], where those of the
 * next one begin. ends has one entry more than vertices. */
static void file_sides(const joining *join, edge_side *sides, uint32_t *ends)
{
    const uint32_t count = (uint32_t)(3 * join->facts.triangle_count);
    memset(ends, 0, (join->facts.vertex_count + 1) * sizeof *ends);
    for (uint32_t h = 0; h < count; ++h) {
        uint32_t start = start_of(join, h), end = end_of(join, h);
        ++ends[(start < end ? start : end) + 1];
    }
    for (size_t v = 1; v <= join->facts.vertex_count; ++v)
        ends[v] += ends[v - 1];
    for (uint32_t h = 0; h < count; ++h) {
        uint32_t start = start_of(join, h), end = end_of(join, h);
        sides[ends[start < end ? start : end]++] = (edge_side){start < end ? end : start, h};
    }
}

/**
 * Pairs the two sides of each added edge, of which one or both carry the mark. Where an edge has not exactly
 * two sides in opposite directions the marks mean nothing; returns how many do.
 */
static size_t pair_sides(joining *join, edge_side *sides, uint32_t *ends)
{
    size_t meaningless = 0, i = 0;
    file_sides(join, sides, ends);
    for (size_t vertex = 0; vertex < join->facts.vertex_count; ++vertex) {
        const size_t last = ends[vertex];
        sort_sides(sides + i, last - i);
        for (size_t next; i < last; i = next) {
            size_t marks = 0;
            for (next = i; next < last && sides[next].high == sides[i].high; ++next)
                marks += join->arrays.added[sides[next].half_edge] == 1;
            if (marks == 0) continue;
            uint32_t first = sides[i].half_edge, second = sides[next - 1].half_edge;
            if (next - i != 2 || first / 3 == second / 3 || start_of(join, first) != end_of(join, second)) {
                meaningless += marks;
                continue;
            }
            join->twins[first] = second;
            join->twins[second] = first;
        }
    }
    return meaningless;
}

/** Walks round the polygon from an edge that was not added, adding corners; counts the edges met. */
static qm_status walk_outline(joining *join, uint32_t first, size_t *edge_count)
{
    uint32_t half_edge = first;
    *edge_count = 0;
    do {
        qm_status status = qm_builder_add_corner(join->builder, start_of(join, half_edge));
        if (status != QM_OK) return status;
        ++*edge_count;
        half_edge = next_half_edge(half_edge);
        while (join->twins[half_edge] != QM_NO_INDEX)
            half_edge = next_half_edge(join->twins[half_edge]);
    } while (half_edge != first);
    return QM_OK;
}

/** Marks the triangles joined to one, listing them; returns their number and counts their outer edges. */
static size_t gather_triangles(joining *join, uint32_t triangle, uint32_t *list, size_t *outer_count)
{
    size_t count = 0;
    *outer_count = 0;
    list[count++] = triangle;
    join->done[triangle] = 1;
    for (size_t i = 0; i < count; ++i)
        for (uint32_t h = 3 * list[i]; h < 3 * list[i] + 3; ++h) {
            uint32_t twin = join->twins[h];
            *outer_count += twin == QM_NO_INDEX;
            if (twin == QM_NO_INDEX || join->done[twin / 3]) continue;
            join->done[twin / 3] = 1;
            list[count++] = twin / 3;
        }
    return count;
}

static qm_status add_triangles(joining *join, const uint32_t *list, size_t count)
{
    const uint32_t *corners = join->arrays.triangles;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < count; ++i) {
        const uint32_t *c = corners + 3 * (size_t)list[i];
        status = qm_builder_add_triangle(join->builder, c[0], c[1], c[2]);
    }
    return status;
}

/**
 * An outer edge from which to walk: the one after an added edge, so that a quad starts on its diagonal and is
 * split again where it was split.
 */
static uint32_t find_first_edge(const joining *join, const uint32_t *list, size_t count)
{
    uint32_t outer = QM_NO_INDEX;
    for (size_t i = 0; i < count; ++i)
        for (uint32_t h = 3 * list[i]; h < 3 * list[i] + 3; ++h) {
            if (join->twins[h] != QM_NO_INDEX) continue;
            outer = h;
            if (join->twins[next_half_edge(next_half_edge(h))] != QM_NO_INDEX) return h;
        }
    return outer;
}

/** Adds the faces that the triangles are part of, and triangles that do not form one polygon as they are. */
static qm_status add_polygons(joining *join, uint32_t *list, size_t meaningless)
{
    size_t broken = 0;
    for (uint32_t t = 0; t < join->facts.triangle_count; ++t) {
        if (join->done[t]) continue;
        size_t outer_count, edge_count = 0;
        const size_t count = gather_triangles(join, t, list, &outer_count);
        const uint32_t first = count > 1 ? find_first_edge(join, list, count) : QM_NO_INDEX;
        qm_status status = first == QM_NO_INDEX ? QM_OK : walk_outline(join, first, &edge_count);
        if (status != QM_OK) return status;
        const bool is_polygon = edge_count == outer_count && outer_count == count + 2;
        broken += count > 1 && !is_polygon;
        if (count > 1 && is_polygon) {
            status = qm_builder_end_face(join->builder);
        } else {
            join->builder->corner_count = 0;
            status = add_triangles(join, list, count);
        }
        if (status != QM_OK) return status;
    }
    if (meaningless + broken > 0)
        qm_codec_warn(join->builder->report,
                      "inconsistent marks of edges that cut polygons: %zu (the triangles there were kept)",
                      meaningless + broken);
    return QM_OK;
}

/** Adds the faces that the triangles were cut from, or the triangles themselves if their marks are inconsistent. */
static qm_status join_triangles(qm_builder *builder, const qm_draco_facts *facts,
                                const qm_draco_arrays *arrays)
{
    qm_context *ctx = builder->ctx;
    size_t triangle_count = facts->triangle_count, corner_count = 3 * triangle_count;
    joining join = {.builder = builder, .facts = *facts, .arrays = *arrays};
    edge_side *sides = qm_context_alloc(ctx, corner_count, sizeof *sides);
    uint32_t *ends = qm_context_alloc(ctx, facts->vertex_count + 1, sizeof *ends);
    uint32_t *list = qm_context_alloc(ctx, triangle_count, sizeof *list);
    join.twins = qm_context_alloc(ctx, corner_count, sizeof *join.twins);
    join.done = qm_context_alloc(ctx, triangle_count, sizeof *join.done);
    qm_status status = QM_E_NO_MEMORY;
    if (sides && ends && list && join.twins && join.done) {
        memset(join.twins, 0xff, corner_count * sizeof *join.twins);
        memset(join.done, 0, triangle_count * sizeof *join.done);
        status = add_polygons(&join, list, pair_sides(&join, sides, ends));
    }
    qm_context_free(ctx, sides, corner_count, sizeof *sides);
    qm_context_free(ctx, ends, facts->vertex_count + 1, sizeof *ends);
    qm_context_free(ctx, list, triangle_count, sizeof *list);
    qm_context_free(ctx, join.twins, corner_count, sizeof *join.twins);
    qm_context_free(ctx, join.done, triangle_count, sizeof *join.done);
    return status;
}

/* ---- decoding ---- */

typedef struct drc_reader {
    qm_builder *builder;
    qm_draco_facts facts;
    qm_draco_arrays arrays;
    qm_status status;
} drc_reader;

static qm_draco_decode_fn *decode_draco = qm_draco_decode;

void qm_codec_drc_set_decoder(qm_draco_decode_fn *decode)
{
    decode_draco = decode;
}

/** Counts what the facts promise: split vertices are merged, and two triangles or more may be one face. */
static void count_arrays(qm_builder *builder, const qm_draco_facts *facts)
{
    const size_t vertices = facts->has_split_points ? 0 : facts->vertex_count;
    const size_t quads = facts->has_added_edges ? facts->triangle_count / 2 : 0;
    qm_builder_count(builder, vertices, facts->has_added_edges ? quads : facts->triangle_count, quads);
    builder->counts_are_low |= facts->has_split_points || facts->has_added_edges;
}

static bool prepare_arrays(void *user, const qm_draco_facts *facts, qm_draco_arrays *arrays)
{
    drc_reader *reader = user;
    qm_context *ctx = reader->builder->ctx;
    reader->facts = *facts;
    reader->status = qm_builder_reserve_vertices(reader->builder, facts->vertex_count);
    if (reader->status == QM_OK)
        reader->status = qm_builder_reserve_faces(reader->builder, facts->triangle_count);
    if (reader->status != QM_OK) return false;
    if (reader->builder->only_counts) {
        count_arrays(reader->builder, facts);
        return false;
    }
    reader->status = QM_E_NO_MEMORY;
    size_t corner_count = 3 * facts->triangle_count;
    reader->arrays.positions = qm_context_alloc(ctx, facts->vertex_count, 3 * sizeof(double));
    if (!reader->arrays.positions && facts->vertex_count > 0) return false;
    reader->arrays.triangles = qm_context_alloc(ctx, corner_count, sizeof(uint32_t));
    if (!reader->arrays.triangles && corner_count > 0) return false;
    if (facts->has_added_edges) reader->arrays.added = qm_context_alloc(ctx, corner_count, 1);
    if (!reader->arrays.added && facts->has_added_edges && corner_count > 0) return false;
    *arrays = reader->arrays;
    reader->status = QM_OK;
    return true;
}

/** Where the file splits vertices for their attributes, equal positions are one vertex again. */
static qm_status weld_vertices(drc_reader *reader)
{
    qm_welder welder;
    qm_builder *builder = reader->builder;
    size_t vertex_count = reader->facts.vertex_count;
    uint32_t *vertices = qm_context_alloc(builder->ctx, vertex_count, sizeof *vertices);
    if (!vertices) return QM_E_NO_MEMORY;
    size_t done;
    qm_status status = qm_welder_create(builder, vertex_count, &welder);
    if (status == QM_OK) {
        status = qm_welder_find(&welder, reader->arrays.positions, vertex_count, vertices, &done);
        qm_welder_destroy(&welder);
    }
    for (size_t i = 0; status == QM_OK && i < 3 * reader->facts.triangle_count; ++i)
        reader->arrays.triangles[i] = vertices[reader->arrays.triangles[i]];
    qm_context_free(builder->ctx, vertices, vertex_count, sizeof *vertices);
    if (status == QM_OK && builder->vertex_count < vertex_count)
        qm_codec_warn(builder->report, "vertices with the same coordinates as others: %zu (merged)",
                      vertex_count - builder->vertex_count);
    return status;
}

static qm_status add_vertices(drc_reader *reader)
{
    for (size_t i = 0; i < 3 * reader->facts.vertex_count; ++i)
        if (!isfinite(reader->arrays.positions[i]))
            return qm_codec_fail(reader->builder->report, QM_E_NOT_FINITE,
                                 "a coordinate is not a finite number");
    if (reader->facts.has_split_points && reader->facts.vertex_count > 0) return weld_vertices(reader);
    if (reader->facts.vertex_count == 0) return QM_OK;
    return qm_builder_add_vertices(reader->builder, reader->arrays.positions, reader->facts.vertex_count);
}

/**
 * Half a step along each axis moves a vertex by no more than half the diagonal of a cell; the rest covers the
 * library's single precision, where a step has a relative rounding of 2^-24 and so has the sum.
 */
static void warn_about_quantization(const drc_reader *reader)
{
    const qm_draco_facts *facts = &reader->facts;
    if (facts->quantization_bits == 0) return;
    double half_cell = sqrt(3) / 2 * facts->range / ((1u << facts->quantization_bits) - 1);
    double rounding = sqrt(3) * 0x1p-23 * (facts->range + facts->magnitude);
    qm_codec_warn(
        reader->builder->report,
        "positions were quantised to %d bits; a vertex may be up to %.4g from its original position",
        facts->quantization_bits, 1.001 * (half_cell + rounding));
}

static qm_status read_file(drc_reader *reader, const uint8_t *bytes, size_t size)
{
    qm_codec_report *report = reader->builder->report;
    qm_status status = check_head(reader->builder, bytes, size);
    if (status != QM_OK) return status;
    qm_draco_outcome outcome = decode_draco(bytes, size, prepare_arrays, reader, &report->offset);
    if (outcome == QM_DRACO_STOPPED) return reader->status;
    if (outcome == QM_DRACO_NO_MEMORY) return QM_E_NO_MEMORY;
    if (outcome == QM_DRACO_UNSUPPORTED)
        return qm_codec_fail(report, QM_E_UNSUPPORTED,
                             "positions other than three floats or integers are not supported");
    if (outcome == QM_DRACO_TOO_LARGE)
        return qm_codec_fail(report, QM_E_TOO_LARGE,
                             "decoding takes more memory or time than Draco data of %zu bytes may use", size);
    if (outcome != QM_DRACO_DONE)
        return qm_codec_fail(report, QM_E_FORMAT, "the Draco data is invalid or truncated");
    status = add_vertices(reader);
    if (status == QM_OK && reader->facts.triangle_count > 0 && reader->facts.has_added_edges) {
        status = join_triangles(reader->builder, &reader->facts, &reader->arrays);
    } else {
        const uint32_t *corners = reader->arrays.triangles;
        for (size_t i = 0; status == QM_OK && i < reader->facts.triangle_count; ++i, corners += 3)
            status = qm_builder_add_triangle(reader->builder, corners[0], corners[1], corners[2]);
    }
    if (status != QM_OK) return status;
    warn_about_quantization(reader);
    if (report->offset < size)
        qm_codec_warn(report, "bytes after the end of the data: %zu (ignored)", size - report->offset);
    return QM_OK;
}

qm_status qm_codec_decode_drc(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    drc_reader reader = {.builder = builder};
    qm_status status = read_file(&reader, bytes, size);
    qm_context *ctx = reader.builder->ctx;
    size_t corner_count = 3 * reader.facts.triangle_count;
    qm_context_free(ctx, reader.arrays.positions, reader.facts.vertex_count, 3 * sizeof(double));
    qm_context_free(ctx, reader.arrays.triangles, corner_count, sizeof(uint32_t));
    qm_context_free(ctx, reader.arrays.added, corner_count, 1);
    return status;
}

/* ---- encoding ---- */

typedef struct encoder_arrays {
    float *positions;
    uint32_t *triangles;
    uint8_t *added;
} encoder_arrays;

static bool take_file(void *user, const char *bytes, size_t size)
{
    qm_text *whole = user;
    qm_text_add(whole, bytes, size);
    return !whole->failed;
}

static qm_status run_library(qm_encoder *encoder, const encoder_arrays *arrays)
{
    const qm_mesh_facts *facts = encoder->facts;
    qm_draco_input input = {.positions = arrays->positions,
                            .vertex_count = encoder->mesh->vertex_count,
                            .triangles = arrays->triangles,
                            .triangle_count = encoder->triangles,
                            .added = arrays->added,
                            .quantization_bits = encoder->bits,
                            .keeps_all = !facts->manifold || facts->repeated_corner_faces > 0 ||
                                         facts->unused_vertices > 0};
    double displacement;
    qm_draco_outcome outcome = qm_draco_encode(&input, take_file, &encoder->file, &displacement);
    if (outcome == QM_DRACO_NO_MEMORY) return QM_E_NO_MEMORY;
    if (outcome != QM_DRACO_DONE)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED, "the mesh cannot be written as Draco");
    /* Rounded to single precision, then quantised: the displacements add up at most. */
    encoder->losses.displacement = (encoder->losses.displacement + displacement) * (1.0 + 8.0 * DBL_EPSILON);
    encoder->size = encoder->file.size;
    return QM_OK;
}

static qm_status prepare_drc(qm_encoder *encoder)
{
    qm_status status = qm_encoder_round_to_floats(encoder);
    if (status != QM_OK) return status;
    const size_t corner_count = 3 * encoder->triangles;
    const bool is_cut = encoder->triangles > encoder->input_faces;
    encoder_arrays arrays = {0};
    arrays.positions = qm_context_alloc(encoder->ctx, encoder->mesh->vertex_count, 3 * sizeof(float));
    if (corner_count > 0) arrays.triangles = qm_context_alloc(encoder->ctx, corner_count, sizeof(uint32_t));
    if (is_cut) arrays.added = qm_context_alloc(encoder->ctx, corner_count, 1);
    status = QM_E_NO_MEMORY;
    if (arrays.positions && (arrays.triangles || corner_count == 0) && (arrays.added || !is_cut)) {
        size_t filled = 0;
        for (size_t i = 0; i < 3 * encoder->mesh->vertex_count; i++)
            arrays.positions[i] = (float)encoder->mesh->positions[i];
        for (uint32_t face = 0, end; face < encoder->mesh->face_count; face = end) {
            end = qm_encoder_face_end(encoder->mesh, face);
            /* Of a triangle (c0, ci, ci+1) of a fan the sides at c0 are cuts, but for the first and the last. */
            size_t corners = qm_encoder_corner_count(encoder->mesh, face, end);
            for (size_t i = 1; i + 1 < corners; i++, filled += 3) {
                arrays.triangles[filled] = qm_encoder_corner(encoder->mesh, face, 0);
                arrays.triangles[filled + 1] = qm_encoder_corner(encoder->mesh, face, i);
                arrays.triangles[filled + 2] = qm_encoder_corner(encoder->mesh, face, i + 1);
                if (!arrays.added) continue;
                arrays.added[filled] = 0;
                arrays.added[filled + 1] = i + 2 < corners;
                arrays.added[filled + 2] = i > 1;
            }
        }
        status = run_library(encoder, &arrays);
    }
    qm_context_free(encoder->ctx, arrays.positions, encoder->mesh->vertex_count, 3 * sizeof(float));
    qm_context_free(encoder->ctx, arrays.triangles, corner_count, sizeof(uint32_t));
    qm_context_free(encoder->ctx, arrays.added, corner_count, 1);
    if (status == QM_E_NO_MEMORY) qm_context_fail(encoder->ctx, status, "out of memory for the file");
    return status;
}

static void add_whole(const qm_encoder *encoder, qm_text *out)
{
    qm_text_add(out, encoder->file.data, encoder->file.size);
}

const qm_encoder_format qm_encoder_drc = {prepare_drc, add_whole, NULL, NULL, false};
