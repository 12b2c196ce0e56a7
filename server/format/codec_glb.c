/**
 * codec_glb.c: glTF: a header, a part of JSON and a part of bytes, or the JSON alone, with its bytes in base64 (the
 * text form, .gltf). The JSON part becomes plain arrays first. Then the
 * tree of the scene is traversed from its roots; each mesh is added in the coordinates of the scene, so a mesh of two
 * nodes is added twice. Files are written in single precision, as one mesh of triangles.
 * Source: glTF 2.0 specification, sections 3.5 to 3.7 and 4.
 */
#include <math.h>
#include <stdio.h>

#include <cjson/cJSON.h>
#include <nettle/base64.h>

#include "base/json.h"
#include "codec_builder.h"
#include "encoder_internal.h"

#define HEADER_SIZE 12
#define CHUNK_HEADER_SIZE 8
#define MAGIC 0x46546c67u
#define CHUNK_JSON 0x4e4f534au
#define CHUNK_BINARY 0x004e4942u
#define TYPE_UINT32 5125
#define TYPE_FLOAT 5126
#define ARRAY_BUFFER 34962
#define ELEMENT_BUFFER 34963

typedef enum primitive_mode {
    POINTS = 0,
    TRIANGLES = 4,
    TRIANGLE_STRIP = 5,
    TRIANGLE_FAN = 6
} primitive_mode;

/* ---- the JSON part ---- */

/* The JSON part as plain arrays. Every index is in range or GLTF_NONE, every node has at most one parent, and roots have
 * none. */

#define GLTF_NONE SIZE_MAX

/** Bytes of a data URI, or of the binary part: the first buffer, when it has no URI. */
#define SHOWN_URI 40
typedef struct gltf_buffer {
    uint8_t *bytes; /* of a data URI; NULL else */
    size_t size, capacity;
    bool is_binary_part;
    char uri[SHOWN_URI + 1]; /* the beginning of one that is not a data URI */
} gltf_buffer;

typedef struct gltf_view {
    size_t buffer;
    uint64_t offset, size; /* bytes within the buffer, unchecked */
    uint64_t stride;       /* 0: elements are contiguous */
} gltf_view;

/** Elements that replace those of an accessor (section 3.6.2.3); count 0: none. */
typedef struct gltf_sparse {
    size_t index_view, value_view;
    uint64_t count, index_offset, value_offset;
    int index_type;
} gltf_sparse;

typedef struct gltf_accessor {
    size_t view; /* GLTF_NONE: all elements are 0 */
    uint64_t offset, count;
    int component_type;  /* the OpenGL constant, 5120 to 5126 */
    int component_count; /* 1 for SCALAR, 3 for VEC3, 0 for anything else */
    bool is_normalized;  /* integers stand for fractions, section 3.11 */
    gltf_sparse sparse;
} gltf_accessor;

typedef struct gltf_primitive {
    size_t positions, indices; /* accessors */
    int mode;                  /* 0 to 6: points, three kinds of lines, triangles, strip, fan */
    bool is_draco;
} gltf_primitive;

typedef struct gltf_mesh {
    size_t first_primitive, primitive_count;
} gltf_mesh;

typedef struct gltf_node {
    double matrix[16]; /* column-major, to the coordinates of the parent */
    size_t mesh;
    size_t first_child, child_count; /* in links */
    bool has_parent;                 /* or is a root of the scene */
} gltf_node;

typedef struct gltf_scene {
    gltf_buffer *buffers;
    size_t buffer_count;
    gltf_view *views;
    gltf_accessor *accessors;
    gltf_primitive *primitives;
    gltf_mesh *meshes;
    gltf_node *nodes;
    size_t *links; /* children of all nodes, then the roots of the scene */
    size_t view_count, accessor_count, primitive_count, mesh_count, node_count, link_count;
    size_t primitive_capacity, link_capacity;
    size_t first_root;
    bool has_poses; /* skins or morph targets, which are not applied */
} gltf_scene;

#define MAX_ZEROS 0x100000u              /* elements without data: a file may claim them at no cost */
#define MAX_JSON_SIZE ((size_t)16 << 20) /* the tree takes some 30 times this memory */
#define MAX_NUMBER 9007199254740992.0    /* integers are exact up to here */

typedef struct json_reader {
    qm_builder *builder;
    gltf_scene *gltf;
    const cJSON *root;
} json_reader;

static qm_status fail_json(json_reader *reader, const char *detail)
{
    return qm_codec_fail(reader->builder->report, QM_E_FORMAT, "%s", detail);
}

static const cJSON *find(const cJSON *object, const char *name)
{
    return cJSON_GetObjectItemCaseSensitive(object, name);
}

/** Reads an integer of 0 or more; an absent member leaves *number unchanged. */
static qm_status read_integer(json_reader *reader, const cJSON *object, const char *name, uint64_t *number)
{
    const cJSON *item = find(object, name);
    if (!item) return QM_OK;
    if (!cJSON_IsNumber(item) || !(item->valuedouble >= 0 && item->valuedouble <= MAX_NUMBER) ||
        floor(item->valuedouble) != item->valuedouble)
        return qm_codec_fail(reader->builder->report, QM_E_FORMAT, "`%s` must be an integer of 0 or more",
                             name);
    *number = (uint64_t)item->valuedouble;
    return QM_OK;
}

/** Reads an index below count; GLTF_NONE if it is absent. */
static qm_status read_json_index(json_reader *reader, const cJSON *object, const char *name, size_t count,
                                 size_t *index)
{
    uint64_t number = 0;
    qm_status status = read_integer(reader, object, name, &number);
    if (status != QM_OK) return status;
    if (!find(object, name)) {
        *index = GLTF_NONE;
        return QM_OK;
    }
    *index = (size_t)number;
    if (number < count) return QM_OK;
    return qm_codec_fail(reader->builder->report, QM_E_FORMAT,
                         "`%s` refers to entry %llu of %zu, counted from 0", name, (unsigned long long)number,
                         count);
}

/** Counts the objects of an array at the root and allocates as many entries; 0 and NULL if it is absent. */
static qm_status start_list(json_reader *reader, const char *name, size_t width, void **block, size_t *count,
                            const cJSON **first)
{
    const cJSON *list = find(reader->root, name);
    *first = NULL;
    if (!list) return QM_OK;
    if (!cJSON_IsArray(list)) return fail_json(reader, "a list in the JSON must be an array");
    size_t length = 0;
    for (const cJSON *item = list->child; item; item = item->next, ++length)
        if (!cJSON_IsObject(item))
            return fail_json(reader, "an entry of a list in the JSON must be an object");
    if (length == 0) return QM_OK;
    *block = qm_context_alloc(reader->builder->ctx, length, width);
    if (!*block) return QM_E_NO_MEMORY;
    memset(*block, 0, length * width);
    *count = length;
    *first = list->child;
    return QM_OK;
}

/** Decodes a data URI (RFC 2397) in base64. */
static qm_status read_data_uri(json_reader *reader, const char *uri, size_t number, gltf_buffer *out)
{
    static const char marker[] = ";base64,";
    const char *data = strstr(uri, marker);
    struct base64_decode_ctx decoder;
    if (!data)
        return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED,
                             "the data URI of buffer %zu is not in base64", number);
    data += strlen(marker);
    size_t length = strlen(data);
    out->capacity = BASE64_DECODE_LENGTH(length) + 1;
    out->bytes = qm_context_alloc(reader->builder->ctx, out->capacity, 1);
    if (!out->bytes) return QM_E_NO_MEMORY;
    base64_decode_init(&decoder);
    out->size = out->capacity;
    if (base64_decode_update(&decoder, &out->size, out->bytes, length, data) && base64_decode_final(&decoder))
        return QM_OK;
    return qm_codec_fail(reader->builder->report, QM_E_FORMAT, "the base64 of buffer %zu is invalid", number);
}

static qm_status read_buffers(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "buffers", sizeof *gltf->buffers, &block, &gltf->buffer_count, &item);
    gltf->buffers = block;
    for (size_t i = 0; status == QM_OK && item; item = item->next, ++i) {
        gltf_buffer *buffer = &gltf->buffers[i];
        const char *uri = cJSON_GetStringValue(find(item, "uri"));
        buffer->is_binary_part = i == 0 && !uri;
        if (uri && strncmp(uri, "data:", 5) == 0)
            status = read_data_uri(reader, uri, i, buffer);
        else
            snprintf(buffer->uri, sizeof buffer->uri, "%s", uri ? uri : "");
    }
    return status;
}

static qm_status read_views(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "bufferViews", sizeof *gltf->views, &block, &gltf->view_count, &item);
    gltf->views = block;
    for (gltf_view *view = gltf->views; status == QM_OK && item; item = item->next, ++view) {
        status = read_json_index(reader, item, "buffer", gltf->buffer_count, &view->buffer);
        if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &view->offset);
        if (status == QM_OK) status = read_integer(reader, item, "byteLength", &view->size);
        if (status == QM_OK) status = read_integer(reader, item, "byteStride", &view->stride);
    }
    return status;
}

static qm_status read_sparse(json_reader *reader, const cJSON *item, gltf_sparse *out)
{
    uint64_t type = 0;
    if (!item) return QM_OK;
    const cJSON *indices = find(item, "indices"), *values = find(item, "values");
    size_t views = reader->gltf->view_count;
    qm_status status = read_integer(reader, item, "count", &out->count);
    if (status == QM_OK) status = read_json_index(reader, indices, "bufferView", views, &out->index_view);
    if (status == QM_OK) status = read_integer(reader, indices, "byteOffset", &out->index_offset);
    if (status == QM_OK) status = read_integer(reader, indices, "componentType", &type);
    if (status == QM_OK) status = read_json_index(reader, values, "bufferView", views, &out->value_view);
    if (status == QM_OK) status = read_integer(reader, values, "byteOffset", &out->value_offset);
    out->index_type = type <= 5126 ? (int)type : 0;
    bool is_whole = out->index_view != GLTF_NONE && out->value_view != GLTF_NONE;
    bool is_index = type == 5121 || type == 5123 || type == 5125;
    if (status == QM_OK && out->count > 0 && !(is_whole && is_index))
        return fail_json(reader,
                         "`sparse` must have indices of an unsigned type and values, each in a buffer view");
    return status;
}

static qm_status read_accessors(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "accessors", sizeof *gltf->accessors, &block, &gltf->accessor_count, &item);
    gltf->accessors = block;
    for (gltf_accessor *accessor = gltf->accessors; status == QM_OK && item; item = item->next, ++accessor) {
        uint64_t component_type = 0;
        status = read_json_index(reader, item, "bufferView", gltf->view_count, &accessor->view);
        if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &accessor->offset);
        if (status == QM_OK) status = read_integer(reader, item, "count", &accessor->count);
        if (status == QM_OK) status = read_integer(reader, item, "componentType", &component_type);
        accessor->component_type = component_type <= 5126 ? (int)component_type : 0;
        const char *type = cJSON_GetStringValue(find(item, "type"));
        accessor->component_count = !type                         ? 0
                                    : strcmp(type, "SCALAR") == 0 ? 1
                                    : strcmp(type, "VEC3") == 0   ? 3
                                                                  : 0;
        accessor->is_normalized = cJSON_IsTrue(find(item, "normalized"));
        if (status == QM_OK) status = read_sparse(reader, find(item, "sparse"), &accessor->sparse);
    }
    return status;
}

static qm_status read_primitives(json_reader *reader, const cJSON *list)
{
    gltf_scene *gltf = reader->gltf;
    if (list && !cJSON_IsArray(list)) return fail_json(reader, "`primitives` must be an array");
    for (const cJSON *item = list ? list->child : NULL; item; item = item->next) {
        void *block = gltf->primitives;
        gltf_primitive primitive;
        const size_t accessor_count = gltf->accessor_count;
        uint64_t mode = 4;
        if (!cJSON_IsObject(item)) return fail_json(reader, "an entry of `primitives` must be an object");
        qm_status status = read_json_index(reader, find(item, "attributes"), "POSITION", accessor_count,
                                           &primitive.positions);
        if (status == QM_OK)
            status = read_json_index(reader, item, "indices", accessor_count, &primitive.indices);
        if (status == QM_OK) status = read_integer(reader, item, "mode", &mode);
        if (status == QM_OK && mode > 6) return fail_json(reader, "`mode` of a primitive must not exceed 6");
        primitive.mode = (int)mode;
        primitive.is_draco = find(find(item, "extensions"), "KHR_draco_mesh_compression") != NULL;
        if (find(item, "targets")) gltf->has_poses = true;
        if (status != QM_OK) return status;
        if (!qm_codec_reserve(reader->builder->ctx, &block, &gltf->primitive_capacity,
                              gltf->primitive_count + 1, sizeof primitive))
            return QM_E_NO_MEMORY;
        gltf->primitives = block;
        gltf->primitives[gltf->primitive_count++] = primitive;
    }
    return QM_OK;
}

static qm_status read_meshes(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    gltf_scene *gltf = reader->gltf;
    qm_status status = start_list(reader, "meshes", sizeof *gltf->meshes, &block, &gltf->mesh_count, &item);
    gltf->meshes = block;
    for (gltf_mesh *mesh = gltf->meshes; status == QM_OK && item; item = item->next, ++mesh) {
        mesh->first_primitive = gltf->primitive_count;
        status = read_primitives(reader, find(item, "primitives"));
        mesh->primitive_count = gltf->primitive_count - mesh->first_primitive;
    }
    return status;
}

/** Reads an array of exactly count numbers; an absent member leaves them unchanged. */
static qm_status read_numbers(json_reader *reader, const cJSON *object, const char *name, double *numbers,
                              int count)
{
    const cJSON *list = find(object, name);
    if (!list) return QM_OK;
    const cJSON *item = cJSON_IsArray(list) ? list->child : NULL;
    for (int i = 0; i < count; ++i, item = item->next) {
        if (!item || !cJSON_IsNumber(item))
            return qm_codec_fail(reader->builder->report, QM_E_FORMAT, "`%s` must be an array of %d numbers",
                                 name, count);
        numbers[i] = item->valuedouble;
    }
    return QM_OK;
}

static qm_status read_transform(json_reader *reader, const cJSON *item, double matrix[16])
{
    static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    memcpy(matrix, identity, sizeof identity);
    if (find(item, "matrix")) return read_numbers(reader, item, "matrix", matrix, 16);
    double t[3] = {0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
    qm_status status = read_numbers(reader, item, "translation", t, 3);
    if (status == QM_OK) status = read_numbers(reader, item, "rotation", q, 4);
    if (status == QM_OK) status = read_numbers(reader, item, "scale", s, 3);
    if (status != QM_OK) return status;
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(length > 0 && isfinite(length)))
        return fail_json(reader, "`rotation` of a node must be a quaternion");
    for (int i = 0; i < 4; ++i)
        q[i] /= length;
    /* Translation * rotation * scale, column-major. */
    double x = q[0], y = q[1], z = q[2], w = q[3];
    const double columns[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
                                  {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
                                  {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}};
    for (int column = 0; column < 3; ++column)
        for (int row = 0; row < 3; ++row)
            matrix[4 * column + row] = columns[column][row] * s[column];
    memcpy(matrix + 12, t, 3 * sizeof *t);
    return QM_OK;
}

/** Adds the nodes of a list to links, and sets their parents. */
static qm_status read_links(json_reader *reader, const cJSON *list)
{
    gltf_scene *gltf = reader->gltf;
    if (list && !cJSON_IsArray(list)) return fail_json(reader, "a list of nodes must be an array");
    for (const cJSON *item = list ? list->child : NULL; item; item = item->next) {
        if (!cJSON_IsNumber(item) ||
            !(item->valuedouble >= 0 && item->valuedouble < (double)gltf->node_count) ||
            floor(item->valuedouble) != item->valuedouble)
            return fail_json(reader, "a list of nodes refers to a node that does not exist");
        size_t node = (size_t)item->valuedouble;
        if (gltf->nodes[node].has_parent)
            return fail_json(reader, "a node has two parents, or is also a root of the scene");
        gltf->nodes[node].has_parent = true;

        void *block = gltf->links;
        if (!qm_codec_reserve(reader->builder->ctx, &block, &gltf->link_capacity, gltf->link_count + 1,
                              sizeof *gltf->links))
            return QM_E_NO_MEMORY;
        gltf->links = block;
        gltf->links[gltf->link_count++] = node;
    }
    return QM_OK;
}

static qm_status read_nodes(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    gltf_scene *gltf = reader->gltf;
    qm_status status = start_list(reader, "nodes", sizeof *gltf->nodes, &block, &gltf->node_count, &item);
    gltf->nodes = block;
    for (gltf_node *node = gltf->nodes; status == QM_OK && item; item = item->next, ++node) {
        status = read_transform(reader, item, node->matrix);
        if (status == QM_OK) status = read_json_index(reader, item, "mesh", gltf->mesh_count, &node->mesh);
        if (find(item, "skin")) gltf->has_poses = true;
        node->first_child = gltf->link_count;
        if (status == QM_OK) status = read_links(reader, find(item, "children"));
        node->child_count = gltf->link_count - node->first_child;
    }
    return status;
}

/** Without scenes: all nodes without a parent; without nodes, each mesh as it is. */
static qm_status take_all(json_reader *reader)
{
    gltf_scene *gltf = reader->gltf;
    if (gltf->node_count == 0 && gltf->mesh_count > 0) {
        gltf->nodes = qm_context_alloc(reader->builder->ctx, gltf->mesh_count, sizeof *gltf->nodes);
        if (!gltf->nodes) return QM_E_NO_MEMORY;
        gltf->node_count = gltf->mesh_count;
        for (size_t i = 0; i < gltf->node_count; ++i)
            gltf->nodes[i] = (gltf_node){.matrix = {[0] = 1, [5] = 1, [10] = 1, [15] = 1}, .mesh = i};
    }
    for (size_t i = 0; i < gltf->node_count; ++i) {
        void *block = gltf->links;
        if (gltf->nodes[i].has_parent) continue;
        if (!qm_codec_reserve(reader->builder->ctx, &block, &gltf->link_capacity, gltf->link_count + 1,
                              sizeof *gltf->links))
            return QM_E_NO_MEMORY;
        gltf->links = block;
        gltf->links[gltf->link_count++] = i;
    }
    return QM_OK;
}

/** The roots of the default scene, or of the first one. */
static qm_status read_roots(json_reader *reader)
{
    const cJSON *scene = find(reader->root, "scenes");
    uint64_t index = 0;
    reader->gltf->first_root = reader->gltf->link_count;
    qm_status status = read_integer(reader, reader->root, "scene", &index);
    if (status != QM_OK) return status;
    if (scene && !cJSON_IsArray(scene)) return fail_json(reader, "`scenes` must be an array");
    if (!scene || !scene->child) return take_all(reader);
    scene = scene->child;
    for (; scene && index > 0; --index)
        scene = scene->next;
    if (!scene) return fail_json(reader, "`scene` refers to a scene that does not exist");
    return read_links(reader, find(scene, "nodes"));
}

/** Extensions that change the appearance, but not the shape. */
static bool is_harmless_extension(const char *name)
{
    static const char *const prefixes[] = {
        "KHR_materials_", "KHR_texture_",          "KHR_lights_",           "EXT_texture_",
        "KHR_xmp",        "KHR_animation_pointer", "KHR_mesh_quantization",
    };
    for (size_t i = 0; i < sizeof prefixes / sizeof *prefixes; ++i)
        if (strncmp(name, prefixes[i], strlen(prefixes[i])) == 0) return true;
    return false;
}

/** Version 1 is another format. */
static qm_status check_version(json_reader *reader)
{
    const char *version = cJSON_GetStringValue(find(find(reader->root, "asset"), "version"));
    if (!version || strncmp(version, "1.", 2) != 0) return QM_OK;
    return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED, "glTF %.16s is not supported, only 2.0",
                         version);
}

static qm_status check_extensions(json_reader *reader)
{
    const cJSON *list = find(reader->root, "extensionsRequired");
    for (const cJSON *item = cJSON_IsArray(list) ? list->child : NULL; item; item = item->next) {
        const char *name = cJSON_GetStringValue(item);
        if (name && is_harmless_extension(name)) continue;
        if (name && strcmp(name, "KHR_draco_mesh_compression") == 0)
            return qm_codec_fail(
                reader->builder->report, QM_E_UNSUPPORTED,
                "glTF with Draco compression is not supported; export it without, or as .drc");
        return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED,
                             "the file requires the glTF extension %.64s, which is not supported",
                             name ? name : "without a name");
    }
    return QM_OK;
}

/** Parses the JSON part, for gltf_free in any case. QM_E_FORMAT, QM_E_UNSUPPORTED, QM_E_TOO_LARGE, QM_E_NO_MEMORY. For
 * invalid JSON it adds the location of the error to report->offset, which is that of the part. */
static qm_status gltf_parse(qm_builder *builder, const uint8_t *json, size_t size, gltf_scene *gltf)
{
    *gltf = (gltf_scene){0};
    if (size > MAX_JSON_SIZE)
        return qm_codec_fail(builder->report, QM_E_TOO_LARGE, "the JSON part is larger than %zu bytes",
                             MAX_JSON_SIZE);
    const char *end;
    bool no_memory;
    cJSON *root = qm_json_parse_tree((const char *)json, size, &end, &no_memory);
    json_reader reader = {.builder = builder, .gltf = gltf, .root = root};
    if (no_memory) return qm_codec_fail(builder->report, QM_E_NO_MEMORY, "out of memory for the JSON part");
    if (!cJSON_IsObject(root)) {
        if (!root) builder->report->offset += (size_t)(end - (const char *)json);
        cJSON_Delete(root);
        return fail_json(&reader, "the JSON part is invalid");
    }
    qm_status status = check_version(&reader);
    if (status == QM_OK) status = check_extensions(&reader);
    if (status == QM_OK) status = read_buffers(&reader);
    if (status == QM_OK) status = read_views(&reader);
    if (status == QM_OK) status = read_accessors(&reader);
    if (status == QM_OK) status = read_meshes(&reader);
    if (status == QM_OK) status = read_nodes(&reader);
    if (status == QM_OK) status = read_roots(&reader);
    cJSON_Delete(root);
    return status;
}

static void gltf_free(qm_context *ctx, gltf_scene *gltf)
{
    for (size_t i = 0; i < gltf->buffer_count; ++i)
        qm_context_free(ctx, gltf->buffers[i].bytes, gltf->buffers[i].capacity, 1);
    qm_context_free(ctx, gltf->buffers, gltf->buffer_count, sizeof *gltf->buffers);
    qm_context_free(ctx, gltf->views, gltf->view_count, sizeof *gltf->views);
    qm_context_free(ctx, gltf->accessors, gltf->accessor_count, sizeof *gltf->accessors);
    qm_context_free(ctx, gltf->primitives, gltf->primitive_capacity, sizeof *gltf->primitives);
    qm_context_free(ctx, gltf->meshes, gltf->mesh_count, sizeof *gltf->meshes);
    qm_context_free(ctx, gltf->nodes, gltf->node_count, sizeof *gltf->nodes);
    qm_context_free(ctx, gltf->links, gltf->link_capacity, sizeof *gltf->links);
}

/* ---- the file ---- */

typedef struct byte_range {
    const uint8_t *bytes;
    size_t offset, size; /* within the file */
} byte_range;

typedef struct glb_reader {
    qm_builder *builder;
    qm_codec_report *report;
    byte_range json, binary;
    gltf_scene gltf;
    size_t *vertex_bases; /* for each accessor: where its vertices begin, if the mesh in hand has them */
    size_t *base_owners;  /* for each accessor: the number of the mesh that set vertex_bases, from 1 */
    size_t visit_count;   /* meshes added */
    size_t line_count;    /* primitives of lines, left out */
} glb_reader;

static qm_status fail_file(glb_reader *reader, qm_status status, const char *detail)
{
    return qm_codec_fail(reader->report, status, "%s", detail);
}

/** Where the text form begins, after a byte-order mark and blanks; size for other files. */
static size_t find_text(const uint8_t *bytes, size_t size)
{
    size_t i = size >= 3 && memcmp(bytes, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;
    while (i < size && (bytes[i] == ' ' || bytes[i] == '\t' || bytes[i] == '\r' || bytes[i] == '\n'))
        ++i;
    return i < size && bytes[i] == '{' ? i : size;
}

bool qm_codec_is_gltf_text(const uint8_t *bytes, size_t size)
{
    return find_text(bytes, size) < size;
}

/* Chunks */

/** Finds the two parts; report->offset follows. The text form is its JSON part. */
static qm_status find_chunks(glb_reader *reader, const uint8_t *bytes, size_t size)
{
    size_t *at = &reader->report->offset;
    *at = 0;
    size_t text = find_text(bytes, size);
    if (text < size) {
        reader->json = (byte_range){bytes + text, text, size - text};
        return QM_OK;
    }
    if (size < HEADER_SIZE || memcmp(bytes, "glTF", 4) != 0)
        return fail_file(reader, QM_E_FORMAT, "the file does not start like a glTF binary");
    *at = 4;
    if (qm_read_u32_le(bytes + 4) != 2)
        return fail_file(reader, QM_E_UNSUPPORTED, "only version 2 of glTF binary is supported");
    *at = 8;
    size_t announced = qm_read_u32_le(bytes + 8);
    if (announced > size)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %zu bytes, but the file has %zu", announced, size);
    if (announced < size)
        qm_codec_warn(reader->report, "bytes after the specified end of the file: %zu (ignored)",
                      size - announced);
    for (*at = HEADER_SIZE; *at < announced;) {
        size_t left = announced - *at;
        if (left < CHUNK_HEADER_SIZE) return fail_file(reader, QM_E_FORMAT, "the file ends within a chunk");
        size_t length = qm_read_u32_le(bytes + *at);
        uint32_t type = qm_read_u32_le(bytes + *at + 4);
        if (length > left - CHUNK_HEADER_SIZE)
            return qm_codec_fail(reader->report, QM_E_FORMAT,
                                 "a chunk specifies %zu bytes, but the file has %zu left", length,
                                 left - CHUNK_HEADER_SIZE);
        *at += CHUNK_HEADER_SIZE;
        byte_range *part = type == CHUNK_JSON ? &reader->json : &reader->binary;
        if ((type == CHUNK_JSON || type == CHUNK_BINARY) && !part->bytes)
            *part = (byte_range){bytes + *at, *at, length};
        *at += length;
    }
    return reader->json.bytes ? QM_OK : fail_file(reader, QM_E_FORMAT, "the file has no JSON part");
}

/* Accessors */

static size_t component_size(int component_type)
{
    switch (component_type) {
    case 5120:
    case 5121:
        return 1;
    case 5122:
    case 5123:
        return 2;
    case 5125:
    case TYPE_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/** The location of the elements of an accessor, all within the binary part. */
typedef struct element_range {
    const uint8_t *first;
    size_t offset; /* of first within the file */
    size_t count, stride;
} element_range;

/** Finds count elements of a width in a view, tightly packed when stride is 0. what and index name them. */
static qm_status locate_range(glb_reader *reader, size_t view_index, uint64_t offset, size_t width,
                              uint64_t stride, uint64_t count, const char *what, size_t index,
                              element_range *range)
{
    const gltf_view *view = &reader->gltf.views[view_index];
    const gltf_buffer *buffer = view->buffer != GLTF_NONE ? &reader->gltf.buffers[view->buffer] : NULL;
    byte_range part = {.offset = reader->json.offset};
    if (buffer && buffer->is_binary_part)
        part = reader->binary;
    else if (buffer && buffer->bytes)
        part = (byte_range){buffer->bytes, reader->json.offset, buffer->size};
    else
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                             "buffer view %zu is in another file (%s): only data within the file is read",
                             view_index, buffer ? buffer->uri : "");
    if (stride == 0) stride = width;
    if (view->size > part.size || view->offset > part.size - view->size)
        return qm_codec_fail(reader->report, QM_E_FORMAT, "buffer view %zu reaches past %s", view_index,
                             buffer->is_binary_part ? "the binary part" : "its buffer");
    /* The last element may be followed by less than a stride. */
    uint64_t room = offset <= view->size ? view->size - offset : 0;
    uint64_t most = width > 0 && room >= width && stride >= width ? (room - width) / stride + 1 : 0;
    if (count > most)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "%s %zu reaches past its buffer view: it has room for %llu elements of %llu",
                             what, index, (unsigned long long)most, (unsigned long long)count);
    range->offset = (size_t)(view->offset + offset);
    range->count = (size_t)count;
    /* Nothing needs no binary part. */
    range->first = range->count > 0 ? part.bytes + range->offset : NULL;
    /* Within base64 there is no place to name. */
    range->offset = buffer->is_binary_part ? range->offset + part.offset : part.offset;
    range->stride = (size_t)stride;
    return QM_OK;
}

static size_t element_size(const gltf_accessor *accessor)
{
    return component_size(accessor->component_type) * (size_t)accessor->component_count;
}

static qm_status locate_elements(glb_reader *reader, size_t index, element_range *range)
{
    const gltf_accessor *accessor = &reader->gltf.accessors[index];
    QM_ASSERT(accessor->view != GLTF_NONE);
    reader->report->offset = reader->json.offset;
    return locate_range(reader, accessor->view, accessor->offset, element_size(accessor),
                        reader->gltf.views[accessor->view].stride, accessor->count, "accessor", index, range);
}

/** An unsigned integer of one of three types. */
static size_t read_unsigned(const uint8_t *at, int component_type)
{
    return component_type == 5125   ? qm_read_u32_le(at)
           : component_type == 5123 ? (size_t)at[0] | (size_t)at[1] << 8
                                    : at[0];
}

/* Vertices */

static bool transform_point(const double matrix[16], const float point[3], double out[3])
{
    for (int row = 0; row < 3; ++row)
        out[row] = matrix[row] * point[0] + matrix[4 + row] * point[1] + matrix[8 + row] * point[2] +
                   matrix[12 + row];
    return isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]);
}

/** A component as a number; of integers that stand for fractions the fraction (section 3.11). */
static float read_component(const uint8_t *at, const gltf_accessor *accessor)
{
    int type = accessor->component_type;
    if (type == TYPE_FLOAT) return qm_read_f32_le(at);
    bool is_signed = type == 5120 || type == 5122, is_short = type == 5122 || type == 5123;
    int value = is_short ? at[0] | at[1] << 8 : at[0], bits = is_short ? 16 : 8;
    if (is_signed && value >> (bits - 1)) value -= 1 << bits;
    if (!accessor->is_normalized) return (float)value;
    float fraction = (float)value / (float)((1 << (bits - is_signed)) - 1);
    return fraction < -1.0f ? -1.0f : fraction;
}

static qm_status read_position(glb_reader *reader, const gltf_accessor *accessor, const element_range *range,
                               size_t i, const double matrix[16], double out[3])
{
    const uint8_t *at = range->first + i * range->stride;
    size_t size = component_size(accessor->component_type);
    const float point[3] = {read_component(at, accessor), read_component(at + size, accessor),
                            read_component(at + 2 * size, accessor)};
    reader->report->offset = range->offset + i * range->stride;
    return transform_point(matrix, point, out)
               ? QM_OK
               : fail_file(reader, QM_E_NOT_FINITE, "a coordinate is not a finite number");
}

/** Replaces vertices that were added last, from number base on, by those of a sparse accessor. */
static qm_status replace_vertices(glb_reader *reader, size_t index, size_t base, const double matrix[16])
{
    const gltf_accessor *accessor = &reader->gltf.accessors[index];
    const gltf_sparse *sparse = &accessor->sparse;
    element_range indices, values;
    reader->report->offset = reader->json.offset;
    qm_status status =
        locate_range(reader, sparse->index_view, sparse->index_offset, component_size(sparse->index_type), 0,
                     sparse->count, "the list of sparse indices of accessor", index, &indices);
    if (status == QM_OK)
        status = locate_range(reader, sparse->value_view, sparse->value_offset, element_size(accessor), 0,
                              sparse->count, "the list of sparse values of accessor", index, &values);
    for (size_t i = 0; status == QM_OK && i < indices.count; ++i) {
        size_t vertex = read_unsigned(indices.first + i * indices.stride, sparse->index_type);
        reader->report->offset = indices.offset + i * indices.stride;
        if (vertex >= accessor->count)
            return qm_codec_fail(reader->report, QM_E_INDEX,
                                 "a sparse accessor replaces element %zu, but has %llu, counted from 0",
                                 vertex, (unsigned long long)accessor->count);
        status = read_position(reader, accessor, &values, i, matrix,
                               reader->builder->positions + 3 * (base + vertex));
    }
    return status;
}

static qm_status add_vertices(glb_reader *reader, size_t index, const double matrix[16])
{
    const gltf_accessor *accessor = &reader->gltf.accessors[index];
    int type = accessor->component_type;
    bool is_position =
        accessor->component_count == 3 && (type == TYPE_FLOAT || (type >= 5120 && type <= 5123));
    if (!is_position)
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                             "accessor %zu is not one of positions: three floats, bytes or shorts", index);
    size_t base = reader->builder->vertex_count;
    element_range range = {.count = (size_t)accessor->count};
    qm_status status = QM_OK;
    if (accessor->view != GLTF_NONE)
        status = locate_elements(reader, index, &range);
    else if (accessor->sparse.count == 0)
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED, "accessor %zu has no data", index);
    else if (accessor->count > MAX_ZEROS)
        return qm_codec_fail(reader->report, QM_E_TOO_LARGE,
                             "accessor %zu has %llu elements without data; at most %u may be", index,
                             (unsigned long long)accessor->count, MAX_ZEROS);
    if (status == QM_OK) status = qm_builder_reserve_vertices(reader->builder, range.count);
    for (size_t i = 0; status == QM_OK && i < range.count; ++i) {
        double position[3] = {matrix[12], matrix[13], matrix[14]};
        if (range.first) status = read_position(reader, accessor, &range, i, matrix, position);
        if (status == QM_OK) status = qm_builder_add_vertex(reader->builder, position);
    }
    if (status != QM_OK || accessor->sparse.count == 0) return status;
    return replace_vertices(reader, index, base, matrix);
}

/* Faces */

typedef struct index_list {
    element_range range; /* first is NULL where the vertices are used in their order */
    int component_type;
    size_t base, vertex_count;
} index_list;

static qm_status read_index(glb_reader *reader, const index_list *list, size_t i, uint32_t *vertex)
{
    size_t index = i;
    if (list->range.first) {
        const uint8_t *at = list->range.first + i * list->range.stride;
        index = read_unsigned(at, list->component_type);
        reader->report->offset = list->range.offset + i * list->range.stride;
    }
    if (index >= list->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %zu, but its primitive has %zu vertices, counted from 0",
                             index, list->vertex_count);
    *vertex = (uint32_t)(list->base + index);
    return QM_OK;
}

static double determinant(const double m[16])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[4] * (m[1] * m[10] - m[2] * m[9]) +
           m[8] * (m[1] * m[6] - m[2] * m[5]);
}

/** A mirroring transform flips the triangles, so their corners are stored in reverse order. */
static qm_status add_faces(glb_reader *reader, const index_list *list, int mode, bool mirrored)
{
    size_t index_count = list->range.count, triangle_count = mode == TRIANGLES ? index_count / 3
                                                             : index_count > 2 ? index_count - 2
                                                                               : 0;
    reader->report->offset = reader->json.offset;
    if (triangle_count == 0 || (mode == TRIANGLES && index_count % 3 != 0))
        return qm_codec_fail(reader->report, QM_E_FORMAT, "%zu indices are not a multiple of 3", index_count);
    qm_status status = qm_builder_reserve_faces(reader->builder, triangle_count);
    for (size_t i = 0; status == QM_OK && i < triangle_count; ++i) {
        size_t places[3];
        uint32_t corners[3];
        /* The positions in the index list of the corners of triangle i, in the order of the mode. */
        size_t odd = i & 1;
        if (mode == TRIANGLES)
            memcpy(places, (const size_t[3]){3 * i, 3 * i + 1, 3 * i + 2}, 3 * sizeof *places);
        else if (mode == TRIANGLE_STRIP)
            memcpy(places, (const size_t[3]){i, i + 1 + odd, i + 2 - odd}, 3 * sizeof *places);
        else
            memcpy(places, (const size_t[3]){0, i + 1, i + 2}, 3 * sizeof *places);
        for (int k = 0; status == QM_OK && k < 3; ++k)
            status = read_index(reader, list, places[k], &corners[k]);
        if (status == QM_OK)
            status = qm_builder_add_triangle(reader->builder, corners[0], corners[1 + mirrored],
                                             corners[2 - mirrored]);
    }
    return status;
}

static qm_status add_primitive(glb_reader *reader, const gltf_primitive *primitive, const double matrix[16])
{
    reader->report->offset = reader->json.offset;
    if (primitive->is_draco)
        return fail_file(reader, QM_E_UNSUPPORTED,
                         "glTF with Draco compression is not supported; export it without, or as .drc");
    if (primitive->mode != POINTS && primitive->mode < TRIANGLES) {
        ++reader->line_count;
        return QM_OK;
    }
    if (primitive->positions == GLTF_NONE)
        return fail_file(reader, QM_E_FORMAT, "a primitive has no positions");
    index_list list = {.vertex_count = (size_t)reader->gltf.accessors[primitive->positions].count};
    qm_status status = QM_OK;
    /* Primitives of a mesh often share their positions, which are then added once. */
    if (reader->base_owners[primitive->positions] != reader->visit_count) {
        reader->vertex_bases[primitive->positions] = reader->builder->vertex_count;
        status = add_vertices(reader, primitive->positions, matrix);
        if (status != QM_OK) return status;
        reader->base_owners[primitive->positions] = reader->visit_count;
    }
    if (primitive->mode == POINTS) return QM_OK;
    list.base = reader->vertex_bases[primitive->positions];
    list.range.count = list.vertex_count;
    if (primitive->indices != GLTF_NONE) {
        const gltf_accessor *indices = &reader->gltf.accessors[primitive->indices];
        list.component_type = indices->component_type;
        bool is_unsigned =
            list.component_type == 5121 || list.component_type == 5123 || list.component_type == 5125;
        if (!is_unsigned || indices->component_count != 1)
            return fail_file(reader, QM_E_FORMAT, "indices must be of an unsigned type");
        if (indices->view == GLTF_NONE || indices->sparse.count > 0)
            return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                                 "accessor %zu has sparse indices or none: they are not supported",
                                 primitive->indices);
        status = locate_elements(reader, primitive->indices, &list.range);
    }
    return status == QM_OK ? add_faces(reader, &list, primitive->mode, determinant(matrix) < 0) : status;
}

/* Scene */

/** matrix = parent * matrix, both with a last row of 0 0 0 1. */
static void multiply(const double parent[16], double matrix[16])
{
    double product[16];
    for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 4; ++row) {
            double sum = 0;
            for (int k = 0; k < 4; ++k)
                sum += parent[4 * k + row] * matrix[4 * column + k];
            product[4 * column + row] = sum;
        }
    memcpy(matrix, product, sizeof product);
}

/** Depth-first traversal with a stack; a node has at most one parent, and is therefore visited at most once. */
static qm_status walk_nodes(glb_reader *reader, size_t *stack)
{
    gltf_scene *gltf = &reader->gltf;
    size_t depth = 0;
    for (size_t i = gltf->link_count; i > gltf->first_root; --i)
        stack[depth++] = gltf->links[i - 1];
    while (depth > 0) {
        const gltf_node *node = &gltf->nodes[stack[--depth]];
        const gltf_mesh *mesh = node->mesh != GLTF_NONE ? &gltf->meshes[node->mesh] : NULL;
        if (mesh) ++reader->visit_count;
        for (size_t i = 0; mesh && i < mesh->primitive_count; ++i) {
            qm_status status =
                add_primitive(reader, &gltf->primitives[mesh->first_primitive + i], node->matrix);
            if (status != QM_OK) return status;
        }
        for (size_t i = node->child_count; i > 0; --i) {
            size_t child = gltf->links[node->first_child + i - 1];
            multiply(node->matrix, gltf->nodes[child].matrix);
            stack[depth++] = child;
        }
    }
    return QM_OK;
}

static qm_status read_scene(glb_reader *reader)
{
    gltf_scene *gltf = &reader->gltf;
    qm_context *ctx = reader->builder->ctx;
    reader->report->offset = reader->json.offset;
    if (gltf->accessor_count == 0 || gltf->node_count == 0)
        return fail_file(reader, QM_E_EMPTY, "the scene has no mesh");
    reader->vertex_bases = qm_context_alloc(ctx, gltf->accessor_count, sizeof *reader->vertex_bases);
    reader->base_owners = qm_context_alloc(ctx, gltf->accessor_count, sizeof *reader->base_owners);
    size_t *stack = qm_context_alloc(ctx, gltf->node_count, sizeof *stack);
    qm_status status = QM_E_NO_MEMORY;
    if (reader->vertex_bases && reader->base_owners && stack) {
        memset(reader->base_owners, 0, gltf->accessor_count * sizeof *reader->base_owners);
        status = walk_nodes(reader, stack);
    }
    if (status == QM_OK) {
        if (reader->line_count > 0)
            qm_codec_warn(reader->report, "primitives of lines: %zu (ignored)", reader->line_count);
        if (reader->gltf.has_poses) qm_codec_warn(reader->report, "skins and morph targets were not applied");
    }
    qm_context_free(ctx, stack, gltf->node_count, sizeof *stack);
    qm_context_free(ctx, reader->base_owners, gltf->accessor_count, sizeof *reader->base_owners);
    qm_context_free(ctx, reader->vertex_bases, gltf->accessor_count, sizeof *reader->vertex_bases);
    return status;
}

qm_status qm_codec_decode_glb(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    glb_reader reader = {.builder = builder, .report = builder->report};
    qm_status status = find_chunks(&reader, bytes, size);
    if (status != QM_OK) return status;
    builder->report->offset = reader.json.offset;
    status = gltf_parse(builder, reader.json.bytes, reader.json.size, &reader.gltf);
    if (status == QM_OK) status = read_scene(&reader);
    gltf_free(builder->ctx, &reader.gltf);
    return status;
}

/* ---- encoding ---- */

static uint64_t positions_size(const qm_encoder *encoder)
{
    return 12 * (uint64_t)encoder->mesh->vertex_count;
}

static uint64_t indices_size(const qm_encoder *encoder)
{
    return 12 * (uint64_t)encoder->triangles;
}

static void add_view(qm_text *json, uint64_t offset, uint64_t size, int target)
{
    qm_json_add_comma(json);
    qm_text_add_string(json, "{");
    qm_json_add_count(json, "buffer", 0);
    qm_json_add_count(json, "byteOffset", offset);
    qm_json_add_count(json, "byteLength", size);
    qm_json_add_count(json, "target", (uint64_t)target);
    qm_text_add_string(json, "}");
}

static void open_accessor(qm_text *json, int view, int type, uint64_t count, const char *shape)
{
    qm_json_add_comma(json);
    qm_text_add_string(json, "{");
    qm_json_add_count(json, "bufferView", (uint64_t)view);
    qm_json_add_count(json, "componentType", (uint64_t)type);
    qm_json_add_count(json, "count", count);
    qm_json_add_string(json, "type", shape);
}

/** The JSON part, padded with blanks to a multiple of four bytes. */
static void write_glb_json(const qm_encoder *encoder, qm_text *json)
{
    uint64_t positions = positions_size(encoder), indices = indices_size(encoder);
    bool has_faces = indices > 0;
    qm_text_printf(json,
                   "{\"asset\":{\"version\":\"2.0\",\"generator\":\"quadmeshd\"},\"scene\":0,\"scenes\":[{"
                   "\"nodes\":[0]}],"
                   "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},%s"
                   "\"mode\":%d}]}],\"buffers\":[{\"byteLength\":%llu}],\"bufferViews\":[",
                   has_faces ? "\"indices\":1," : "", has_faces ? TRIANGLES : POINTS,
                   (unsigned long long)(positions + indices));
    add_view(json, 0, positions, ARRAY_BUFFER);
    if (has_faces) add_view(json, positions, indices, ELEMENT_BUFFER);
    qm_text_add_string(json, "],\"accessors\":[");
    open_accessor(json, 0, TYPE_FLOAT, encoder->mesh->vertex_count, "VEC3");
    /* The bounding box of the vertices in single precision. */
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double *p = encoder->mesh->positions;
    for (size_t i = 0; i < 3 * encoder->mesh->vertex_count; i++) {
        double value = (double)(float)p[i];
        low[i % 3] = fmin(low[i % 3], value);
        high[i % 3] = fmax(high[i % 3], value);
    }
    qm_json_add_numbers(json, "min", low, 3);
    qm_json_add_numbers(json, "max", high, 3);
    qm_text_add_string(json, "}");
    if (has_faces) {
        open_accessor(json, 1, TYPE_UINT32, indices / 4, "SCALAR");
        qm_text_add_string(json, "}");
    }
    qm_text_add_string(json, "]}");
    while (json->size % 4 != 0 && !json->failed)
        qm_text_add_string(json, " ");
}

static qm_status prepare_glb(qm_encoder *encoder)
{
    qm_status status = qm_encoder_round_to_floats(encoder);
    if (status != QM_OK) return status;
    write_glb_json(encoder, &encoder->file);
    if (encoder->file.failed) return QM_E_NO_MEMORY;
    encoder->size = 12 + 8 + encoder->file.size + 8 + positions_size(encoder) + indices_size(encoder);
    encoder->losses.cut_faces = encoder->facts->quads + encoder->facts->polygons;
    return encoder->size <= UINT32_MAX ? QM_OK : qm_encoder_fail_size(encoder);
}

static void add_glb_head(const qm_encoder *encoder, qm_text *out)
{
    qm_encoder_add_u32(out, MAGIC);
    qm_encoder_add_u32(out, 2);
    qm_encoder_add_u32(out, (uint32_t)encoder->size);
    qm_encoder_add_u32(out, (uint32_t)encoder->file.size);
    qm_encoder_add_u32(out, CHUNK_JSON);
    qm_text_add(out, encoder->file.data, encoder->file.size);
    qm_encoder_add_u32(out, (uint32_t)(positions_size(encoder) + indices_size(encoder)));
    qm_encoder_add_u32(out, CHUNK_BINARY);
}

static void add_glb_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    for (int axis = 0; axis < 3; axis++)
        qm_encoder_add_f32(out, encoder->mesh->positions[3 * vertex + (size_t)axis]);
}

static void add_glb_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    for (uint32_t face = first; face < end; face++) {
        uint32_t rows[2][3];
        int count = qm_encoder_list_triangles(encoder->mesh->faces + 4 * (size_t)face, rows);
        for (int i = 0; i < count; i++)
            for (int corner = 0; corner < 3; corner++)
                qm_encoder_add_u32(out, rows[i][corner]);
    }
}

const qm_encoder_format qm_encoder_glb = {prepare_glb, add_glb_head, add_glb_vertex, add_glb_face};
