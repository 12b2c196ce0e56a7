/**
 * codec_3mf.c: 3MF: a zip archive with models in XML. The objects of all models that the first one refers to are read
 * first; then each item of its build is added in the coordinates of the build, so an object of two items is added twice.
 * Coordinates keep the unit of the file. Files are written as one object of triangles, in all digits.
 * Source: 3MF Core Specification 1.3, sections 2 to 4, and Production Extension 1.1, section 3.
 */
#include <expat.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include "archive.h"
#include "codec_builder.h"
#include "codec_scan.h"
#include "encoder_internal.h"

#define CORE "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
#define RELATIONSHIPS "http://schemas.openxmlformats.org/package/2006/relationships"
#define MODEL_RELATIONSHIP "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
#define USUAL_MODEL "3D/3dmodel.model"
#define BETWEEN '|' /* namespace and name */
#define MAX_DEPTH 64
#define MAX_VISITS 1000000 /* of objects in the tree of the build: a few bytes can ask for any number */
#define MAX_PARTS 1000
#define MAX_PREFIXES 32
#define PATH_SIZE 128

/** Extensions that add nothing to the surface, or that are read. */
static const char *const known_extensions[] = {
    CORE,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
};

/** x y z of a row, times the first three rows, plus the last one. */
typedef struct transform {
    double row[4][3];
} transform;

static const transform identity = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};

/** An object within another one, or in the build. */
typedef struct component {
    size_t part; /* model that has the object */
    uint64_t object;
    transform at;
    size_t line;
} component;

typedef struct object {
    size_t part;
    uint64_t id;
    size_t first_vertex, vertex_count, first_triangle, triangle_count, first_component, component_count;
} object;

typedef struct part {
    char path[PATH_SIZE];
} part;

typedef struct prefix {
    char name[16];
    char uri[96];
} prefix;

/** An array that grows. */
#define LIST(type)                                                                                           \
    struct {                                                                                                 \
        type *at;                                                                                            \
        size_t count, capacity;                                                                              \
    }

typedef struct reader {
    qm_builder *builder;
    qm_codec_report *report;
    qm_archive *archive;
    LIST(part) parts;
    LIST(object) objects;
    LIST(component) components; /* of objects, each in one range */
    LIST(component) items;      /* of the build */
    double *positions;          /* of all objects; rows of three */
    uint32_t (*triangles)[3];   /* corners count from the object's first vertex */
    size_t position_count, position_capacity, triangle_count, triangle_capacity;
    size_t visits;

    /* The part in hand. */
    size_t part;
    size_t depth; /* of the element in hand: 0 is the root */
    XML_Parser parser;
    bool is_relations, is_in_build, has_object;
    char target[PATH_SIZE]; /* of the relationship to the first model */
    prefix prefixes[MAX_PREFIXES];
    size_t prefix_count;
    qm_status status; /* of a callback */
} reader;

/* ---- XML ---- */

/** Bytes of the parser: names, elements in elements, and one element as a whole. */
#define MAX_XML ((size_t)4 << 20)

static _Thread_local size_t xml_used; /* by the parser of this thread */

/** A block that begins with its size. */
typedef union xml_block {
    size_t size;
    max_align_t align;
} xml_block;

static void *xml_resize(void *bytes, size_t size)
{
    xml_block *block = bytes ? (xml_block *)bytes - 1 : NULL;
    size_t before = block ? block->size : 0;
    if (size > MAX_XML || xml_used - before + size > MAX_XML) return NULL;
    block = realloc(block, sizeof *block + size);
    if (!block) return NULL;
    xml_used += size - before;
    block->size = size;
    return block + 1;
}

static void *xml_alloc(size_t size)
{
    return xml_resize(NULL, size);
}

static void xml_free(void *bytes)
{
    if (!bytes) return;
    xml_block *block = (xml_block *)bytes - 1;
    xml_used -= block->size;
    free(block);
}

/** Ends the parsing. */
static void stop(reader *r, qm_status status)
{
    if (r->status != QM_OK) return;
    r->status = status;
    XML_StopParser(r->parser, XML_FALSE);
}

#define FAIL(r, status, ...) stop(r, qm_codec_fail((r)->report, status, __VA_ARGS__))

/** The value of an attribute without a namespace, or of one in a namespace; NULL when it is absent. */
static const char *find(const char **attributes, const char *name)
{
    for (; *attributes; attributes += 2)
        if (strcmp(*attributes, name) == 0) return attributes[1];
    return NULL;
}

/** The name of an element of a namespace; NULL for others. Models without a namespace are taken for those of 3MF. */
static const char *local_name(const char *name, const char *space)
{
    const char *between = strchr(name, BETWEEN);
    if (!between) return name;
    size_t length = strlen(space);
    return (size_t)(between - name) == length && memcmp(name, space, length) == 0 ? between + 1 : NULL;
}

static qm_scan scan(reader *r, const char *text)
{
    const uint8_t *at = (const uint8_t *)text;
    return (qm_scan){.at = at, .end = at + strlen(text), .line = 1, .report = r->report};
}

/** Reads count numbers and no more. */
static bool read_numbers(reader *r, const char *element, const char *name, const char *text, double *out,
                         int count)
{
    if (!text) {
        FAIL(r, QM_E_FORMAT, "%s has no %s", element, name);
        return false;
    }
    qm_scan in = scan(r, text);
    for (int i = 0; i < count; i++) {
        qm_scan_skip_blanks(&in);
        qm_status status = qm_scan_read_number(&in, &out[i]);
        if (status != QM_OK) {
            stop(r, status);
            return false;
        }
    }
    qm_scan_skip_blanks(&in);
    if (in.at == in.end) return true;
    FAIL(r, QM_E_FORMAT, "%s of %s has more than %d numbers", name, element, count);
    return false;
}

static bool read_index(reader *r, const char *element, const char *name, const char *text, uint64_t limit,
                       uint64_t *out)
{
    int64_t number = -1;
    qm_scan in = scan(r, text ? text : "");
    qm_scan_skip_blanks(&in);
    bool is_read = text && qm_scan_read_integer(&in, &number) == QM_OK && number >= 0;
    if (is_read) qm_scan_skip_blanks(&in);
    if (!is_read || in.at < in.end) {
        FAIL(r, QM_E_FORMAT, "%s of %s must be an integer", name, element);
        return false;
    }
    *out = (uint64_t)number;
    if (*out < limit) return true;
    FAIL(r, QM_E_INDEX, "%s refers to vertex %llu, but its object has %llu before it, counted from 0",
         element, (unsigned long long)*out, (unsigned long long)limit);
    return false;
}

static bool read_transform(reader *r, const char **attributes, transform *out)
{
    const char *text = find(attributes, "transform");
    *out = identity;
    return !text || read_numbers(r, "an item", "transform", text, out->row[0], 12);
}

/* ---- models ---- */

#define RESERVE(r, list, needed)                                                                             \
    qm_codec_reserve((r)->builder->ctx, (void **)&(list)->at, &(list)->capacity, needed, sizeof *(list)->at)

/** The number of a part, which is to be read; the paths of archives begin with a slash or not. */
static bool find_part(reader *r, const char *path, size_t *out)
{
    while (*path == '/')
        path++;
    for (size_t i = 0; i < r->parts.count; i++)
        if (strcmp(r->parts.at[i].path, path) == 0) {
            *out = i;
            return true;
        }
    if (strlen(path) >= PATH_SIZE || r->parts.count == MAX_PARTS) {
        FAIL(r, QM_E_TOO_LARGE, "the archive has more than %d models, or a path of more than %d bytes",
             MAX_PARTS, PATH_SIZE - 1);
        return false;
    }
    if (!RESERVE(r, &r->parts, r->parts.count + 1)) {
        stop(r, QM_E_NO_MEMORY);
        return false;
    }
    *out = r->parts.count++;
    snprintf(r->parts.at[*out].path, PATH_SIZE, "%s", path);
    return true;
}

/** Refuses extensions that change the surface. */
static void check_extensions(reader *r, const char *required)
{
    while (required && *required) {
        size_t length = strcspn(required, " \t\r\n");
        const prefix *found = NULL;
        for (size_t i = 0; i < r->prefix_count; i++)
            if (strlen(r->prefixes[i].name) == length && memcmp(r->prefixes[i].name, required, length) == 0)
                found = &r->prefixes[i];
        bool is_known = length == 0;
        for (size_t i = 0; found && i < sizeof known_extensions / sizeof *known_extensions; i++)
            is_known |= strcmp(found->uri, known_extensions[i]) == 0;
        char shown[QM_SCAN_SHOWN_SIZE];
        if (!is_known) {
            FAIL(r, QM_E_UNSUPPORTED, "the model requires the extension %s, which is not read",
                 found ? found->uri : qm_scan_show((const uint8_t *)required, length, shown));
            return;
        }
        required += length;
        required += strspn(required, " \t\r\n");
    }
}

static void on_namespace(void *user, const char *name, const char *uri)
{
    reader *r = user;
    if (!name || !uri || r->prefix_count == MAX_PREFIXES) return;
    prefix *added = &r->prefixes[r->prefix_count++];
    snprintf(added->name, sizeof added->name, "%s", name);
    snprintf(added->uri, sizeof added->uri, "%s", uri);
}

static void start_object(reader *r, const char **attributes)
{
    object *added;
    uint64_t id;
    if (!read_index(r, "an object", "id", find(attributes, "id"), UINT64_MAX, &id)) return;
    if (!RESERVE(r, &r->objects, r->objects.count + 1)) {
        stop(r, QM_E_NO_MEMORY);
        return;
    }
    added = &r->objects.at[r->objects.count++];
    *added = (object){.part = r->part,
                      .id = id,
                      .first_vertex = r->position_count,
                      .first_triangle = r->triangle_count,
                      .first_component = r->components.count};
    r->has_object = true;
}

static void add_vertex(reader *r, const char **attributes)
{
    static const char *const names[] = {"x", "y", "z"};
    object *o = &r->objects.at[r->objects.count - 1];
    double position[3];
    for (int k = 0; k < 3; k++)
        if (!read_numbers(r, "a vertex", names[k], find(attributes, names[k]), &position[k], 1)) return;
    if (r->position_count >= r->builder->limits->max_vertices) {
        FAIL(r, QM_E_TOO_LARGE, "the file has more than %zu vertices", r->builder->limits->max_vertices);
        return;
    }
    if (!qm_codec_reserve(r->builder->ctx, (void **)&r->positions, &r->position_capacity,
                          r->position_count + 1, sizeof position)) {
        stop(r, QM_E_NO_MEMORY);
        return;
    }
    memcpy(r->positions + 3 * r->position_count++, position, sizeof position);
    o->vertex_count++;
}

static void add_triangle(reader *r, const char **attributes)
{
    static const char *const names[] = {"v1", "v2", "v3"};
    object *o = &r->objects.at[r->objects.count - 1];
    uint32_t corner[3];
    for (int k = 0; k < 3; k++) {
        uint64_t vertex;
        if (!read_index(r, "a triangle", names[k], find(attributes, names[k]), o->vertex_count, &vertex))
            return;
        corner[k] = (uint32_t)vertex;
    }
    if (r->triangle_count >= r->builder->limits->max_faces) {
        FAIL(r, QM_E_TOO_LARGE, "the file has more than %zu triangles", r->builder->limits->max_faces);
        return;
    }
    if (!qm_codec_reserve(r->builder->ctx, (void **)&r->triangles, &r->triangle_capacity,
                          r->triangle_count + 1, sizeof corner)) {
        stop(r, QM_E_NO_MEMORY);
        return;
    }
    memcpy(r->triangles[r->triangle_count++], corner, sizeof corner);
    o->triangle_count++;
}

/** Adds a component of the object in hand, or an item of the build. */
static void add_component(reader *r, const char **attributes)
{
    component added = {.part = r->part, .line = XML_GetCurrentLineNumber(r->parser)};
    const char *path =
        find(attributes, "http://schemas.microsoft.com/3dmanufacturing/production/2015/06|path");
    if (!read_index(r, "an item", "objectid", find(attributes, "objectid"), UINT64_MAX, &added.object) ||
        !read_transform(r, attributes, &added.at) || (path && !find_part(r, path, &added.part)))
        return;
    bool is_added = r->is_in_build ? RESERVE(r, &r->items, r->items.count + 1)
                                   : RESERVE(r, &r->components, r->components.count + 1);
    if (!is_added) {
        stop(r, QM_E_NO_MEMORY);
    } else if (r->is_in_build) {
        r->items.at[r->items.count++] = added;
    } else {
        r->components.at[r->components.count++] = added;
        r->objects.at[r->objects.count - 1].component_count++;
    }
}

/** The unit by the name that a model has for it. */
static void set_unit(qm_codec_report *report, const char *name)
{
    static const char *const names[][2] = {{"micron", "um"}, {"millimeter", "mm"}, {"centimeter", "cm"},
                                           {"meter", "m"},   {"inch", "in"},       {"foot", "ft"}};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(name, names[i][0]) == 0) snprintf(report->unit, sizeof report->unit, "%s", names[i][1]);
}

static void on_model_element(reader *r, const char *name, const char **attributes)
{
    if (strcmp(name, "vertex") == 0 && r->has_object) {
        add_vertex(r, attributes);
    } else if (strcmp(name, "triangle") == 0 && r->has_object) {
        add_triangle(r, attributes);
    } else if (strcmp(name, "object") == 0) {
        start_object(r, attributes);
    } else if (strcmp(name, "build") == 0) {
        r->is_in_build = r->part == 0; /* of the first model only */
    } else if (r->is_in_build ? strcmp(name, "item") == 0 : strcmp(name, "component") == 0 && r->has_object) {
        add_component(r, attributes);
    } else if (strcmp(name, "model") == 0 && r->depth > 0) {
        FAIL(r, QM_E_FORMAT, "a model inside another element");
    } else if (strcmp(name, "model") == 0) {
        const char *unit = find(attributes, "unit");
        char shown[QM_SCAN_SHOWN_SIZE];
        check_extensions(r, find(attributes, "requiredextensions"));
        if (r->part == 0) set_unit(r->report, unit ? unit : "millimeter");
        if (unit && r->part == 0 && strcmp(unit, "millimeter") != 0)
            qm_codec_warn(r->report, "the unit of the file is the %s: coordinates are kept as they are",
                          qm_scan_show((const uint8_t *)unit, strlen(unit), shown));
    }
}

static void on_start(void *user, const char *name, const char **attributes)
{
    reader *r = user;
    if (r->status != QM_OK) return;
    if (!r->is_relations) {
        const char *local = local_name(name, CORE);
        if (local) on_model_element(r, local, attributes);
        r->depth++;
        return;
    }
    const char *local = local_name(name, RELATIONSHIPS), *type = find(attributes, "Type"),
               *target = find(attributes, "Target");
    if (local && strcmp(local, "Relationship") == 0 && type && target &&
        strcmp(type, MODEL_RELATIONSHIP) == 0 && strlen(target) < PATH_SIZE)
        snprintf(r->target, sizeof r->target, "%s", target);
}

static void on_end(void *user, const char *name)
{
    reader *r = user;
    const char *local = r->is_relations ? NULL : local_name(name, CORE);
    if (local && strcmp(local, "object") == 0) r->has_object = false;
    if (local && strcmp(local, "build") == 0) r->is_in_build = false;
    if (!r->is_relations && r->status == QM_OK) r->depth--;
}

/** A document type may define entities that grow without end. 3MF forbids them. */
static void on_document_type(void *user, const char *name, const char *system, const char *public,
                             int has_subset)
{
    reader *r = user;
    (void)name, (void)system, (void)public, (void)has_subset;
    FAIL(r, QM_E_FORMAT, "a model must not have a document type");
}

static qm_status parse_block(void *user, const char *bytes, size_t size, bool is_last)
{
    reader *r = user;
    if (XML_Parse(r->parser, bytes, (int)size, is_last) == XML_STATUS_OK) return QM_OK;
    r->report->line = XML_GetCurrentLineNumber(r->parser);
    if (r->status != QM_OK) return r->status;
    enum XML_Error error = XML_GetErrorCode(r->parser);
    if (error == XML_ERROR_NO_MEMORY)
        return qm_codec_fail(r->report, QM_E_TOO_LARGE, "an element, or all names, have more than %zu bytes",
                             MAX_XML);
    return qm_codec_fail(r->report, QM_E_FORMAT, "the XML is malformed: %s", XML_ErrorString(error));
}

/** Parses a file of the archive; an error names it. */
static qm_status parse(reader *r, const char *path)
{
    static const XML_Memory_Handling_Suite memory = {xml_alloc, xml_resize, xml_free};
    static const char between[] = {BETWEEN, '\0'};
    r->parser = XML_ParserCreate_MM(NULL, &memory, between);
    if (!r->parser) return QM_E_NO_MEMORY;
    r->status = QM_OK;
    r->has_object = r->is_in_build = false;
    r->depth = 0;
    r->prefix_count = 0;
    XML_SetUserData(r->parser, r);
    XML_SetElementHandler(r->parser, on_start, on_end);
    XML_SetStartNamespaceDeclHandler(r->parser, on_namespace);
    XML_SetStartDoctypeDeclHandler(r->parser, on_document_type);
    qm_status status = qm_archive_read(r->archive, path, parse_block, r, r->report);
    XML_ParserFree(r->parser);
    if (status == QM_OK || !r->report->detail[0] || r->report->line == QM_NO_LOCATION) return status;
    char detail[QM_CODEC_DETAIL_SIZE];
    snprintf(detail, sizeof detail, "%s", r->report->detail);
    return qm_codec_fail(r->report, status, "%.100s: %.150s", path, detail);
}

/* ---- the build ---- */

static transform combine(const transform *inner, const transform *outer)
{
    transform out;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            double sum = i == 3 ? outer->row[3][k] : 0.0;
            for (int j = 0; j < 3; j++)
                sum += inner->row[i][j] * outer->row[j][k];
            out.row[i][k] = sum;
        }
    return out;
}

static double determinant(const transform *at)
{
    const double(*m)[3] = at->row;
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

static qm_status add_mesh(reader *r, const object *o, const transform *at)
{
    qm_builder *builder = r->builder;
    size_t base = builder->vertex_count;
    bool is_moved = memcmp(at, &identity, sizeof identity) != 0, is_mirrored = determinant(at) < 0.0;
    qm_status status = qm_builder_reserve_vertices(builder, o->vertex_count);
    if (status == QM_OK) status = qm_builder_reserve_faces(builder, o->triangle_count);
    for (size_t i = 0; status == QM_OK && i < o->vertex_count; i++) {
        const double *p = r->positions + 3 * (o->first_vertex + i);
        double moved[3];
        for (int k = 0; k < 3; k++)
            moved[k] =
                is_moved ? p[0] * at->row[0][k] + p[1] * at->row[1][k] + p[2] * at->row[2][k] + at->row[3][k]
                         : p[k];
        if (!isfinite(moved[0]) || !isfinite(moved[1]) || !isfinite(moved[2]))
            return qm_codec_fail(r->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
        status = qm_builder_add_vertex(builder, moved);
    }
    for (size_t i = 0; status == QM_OK && i < o->triangle_count; i++) {
        const uint32_t *corner = r->triangles[o->first_triangle + i];
        uint32_t last[2] = {(uint32_t)base + corner[1], (uint32_t)base + corner[2]};
        status = qm_builder_add_triangle(builder, (uint32_t)base + corner[0], last[is_mirrored],
                                         last[!is_mirrored]);
    }
    return status;
}

/** Objects are sorted by part and id. */
static int compare_objects(const void *first, const void *second)
{
    const object *a = first, *b = second;
    if (a->part != b->part) return a->part < b->part ? -1 : 1;
    return (a->id > b->id) - (a->id < b->id);
}

static qm_status add_object(reader *r, const component *used, const transform *outer, int depth)
{
    const object wanted = {.part = used->part, .id = used->object};
    const object *o = r->objects.count > 0 ? bsearch(&wanted, r->objects.at, r->objects.count,
                                                     sizeof *r->objects.at, compare_objects)
                                           : NULL;
    r->report->line = used->line;
    if (!o)
        return qm_codec_fail(r->report, QM_E_FORMAT, "there is no object %llu in %.100s",
                             (unsigned long long)used->object, r->parts.at[used->part].path);
    if (depth == MAX_DEPTH || ++r->visits > MAX_VISITS)
        return qm_codec_fail(r->report, QM_E_TOO_LARGE,
                             "objects are within others %d levels deep, or in more than %d places", MAX_DEPTH,
                             MAX_VISITS);
    transform at = combine(&used->at, outer);
    qm_status status = add_mesh(r, o, &at);
    for (size_t i = 0; status == QM_OK && i < o->component_count; i++)
        status = add_object(r, &r->components.at[o->first_component + i], &at, depth + 1);
    return status;
}

static qm_status read_package(reader *r)
{
    size_t first;
    r->is_relations = true;
    qm_status status = qm_archive_has(r->archive, "_rels/.rels") ? parse(r, "_rels/.rels") : QM_OK;
    r->is_relations = false;
    if (status != QM_OK) return status;
    const char *path = r->target[0] ? r->target : USUAL_MODEL;
    if (!qm_archive_has(r->archive, path + strspn(path, "/")))
        return qm_codec_fail(r->report, QM_E_FORMAT, "the zip archive has no 3D model, so it is not 3MF");
    if (!find_part(r, path, &first)) return r->status;
    for (r->part = 0; status == QM_OK && r->part < r->parts.count; r->part++) {
        char name[PATH_SIZE];
        snprintf(name, sizeof name, "%s", r->parts.at[r->part].path);
        status = parse(r, name);
    }
    if (status != QM_OK) return status;
    if (r->items.count == 0)
        return qm_codec_fail(r->report, QM_E_EMPTY, "the build of the model has no item");
    if (r->objects.count > 0) qsort(r->objects.at, r->objects.count, sizeof *r->objects.at, compare_objects);
    for (size_t i = 0; status == QM_OK && i < r->items.count; i++)
        status = add_object(r, &r->items.at[i], &identity, 0);
    return status;
}

qm_status qm_codec_decode_3mf(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    reader r = {.builder = builder, .report = builder->report};
    qm_context *ctx = builder->ctx;
    qm_status status =
        qm_archive_open(ctx, bytes, size, builder->limits->max_size, &r.archive, builder->report);
    if (status == QM_OK) status = read_package(&r);
    /* An archive has bytes, a model lines. */
    builder->report->offset = builder->report->line == QM_NO_LOCATION ? 0 : QM_NO_LOCATION;
    qm_archive_close(r.archive);
    qm_context_free(ctx, r.parts.at, r.parts.capacity, sizeof *r.parts.at);
    qm_context_free(ctx, r.objects.at, r.objects.capacity, sizeof *r.objects.at);
    qm_context_free(ctx, r.components.at, r.components.capacity, sizeof *r.components.at);
    qm_context_free(ctx, r.items.at, r.items.capacity, sizeof *r.items.at);
    qm_context_free(ctx, r.positions, r.position_capacity, 3 * sizeof *r.positions);
    qm_context_free(ctx, r.triangles, r.triangle_capacity, sizeof *r.triangles);
    return status;
}

/* ---- encoding ---- */

static void add_model(const qm_encoder *encoder, qm_text *out)
{
    static const char *const axes[] = {"<vertex x=\"", "\" y=\"", "\" z=\""};
    const qm_mesh *mesh = encoder->mesh;
    char number[QM_NUMBER_SIZE];
    qm_text_add_string(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
                            "<model unit=\"millimeter\" xml:lang=\"en-US\" xmlns=\"" CORE "\">\n"
                            "<resources><object id=\"1\" type=\"model\"><mesh>\n<vertices>\n");
    for (size_t i = 0; i < mesh->vertex_count && !out->failed; i++) {
        for (int k = 0; k < 3; k++) {
            qm_text_add_string(out, axes[k]);
            qm_text_add_string(out, qm_text_number(mesh->positions[3 * i + (size_t)k], number));
        }
        qm_text_add_string(out, "\"/>\n");
    }
    qm_text_add_string(out, "</vertices>\n<triangles>\n");
    for (size_t i = 0; i < mesh->face_count && !out->failed; i++) {
        uint32_t rows[2][3];
        int count = qm_encoder_list_triangles(mesh->faces + 4 * i, rows);
        for (int k = 0; k < count; k++)
            qm_text_printf(out, "<triangle v1=\"%u\" v2=\"%u\" v3=\"%u\"/>\n", rows[k][0], rows[k][1],
                           rows[k][2]);
    }
    qm_text_add_string(
        out, "</triangles>\n</mesh></object></resources>\n<build><item objectid=\"1\"/></build>\n</model>\n");
}

static qm_status prepare_3mf(qm_encoder *encoder)
{
    static const char types[] =
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">"
        "<Default Extension=\"rels\" "
        "ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>"
        "<Default Extension=\"model\" "
        "ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/>"
        "</Types>\n";
    static const char relations[] =
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Relationships xmlns=\"" RELATIONSHIPS "\">"
        "<Relationship Target=\"/" USUAL_MODEL "\" Id=\"model\" Type=\"" MODEL_RELATIONSHIP
        "\"/></Relationships>\n";
    if (encoder->mesh->face_count == 0)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED,
                               "3mf holds triangles only, and the mesh has points");
    encoder->losses.cut_faces = encoder->facts->quads + encoder->facts->polygons;
    qm_text model = {0};
    add_model(encoder, &model);
    qm_status status = QM_E_NO_MEMORY;
    if (!model.failed) {
        const qm_archive_file files[] = {{"[Content_Types].xml", types, strlen(types)},
                                         {"_rels/.rels", relations, strlen(relations)},
                                         {USUAL_MODEL, model.data, model.size}};
        status = qm_archive_write(files, sizeof files / sizeof *files, &encoder->file);
    }
    qm_text_reset(&model);
    encoder->size = encoder->file.size;
    if (status == QM_E_NO_MEMORY) qm_context_fail(encoder->ctx, status, "out of memory for the file");
    if (status == QM_E_UNSUPPORTED)
        qm_context_fail(encoder->ctx, status, "3mf is written by the library libzip, which is not installed");
    return status;
}

static void add_file(const qm_encoder *encoder, qm_text *out)
{
    qm_text_add(out, encoder->file.data, encoder->file.size);
}

const qm_encoder_format qm_encoder_3mf = {prepare_3mf, add_file, NULL, NULL, false};
