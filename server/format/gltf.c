/**
 * gltf.c: reads the JSON part of a glTF file. Members that do not concern the shape are skipped.
 */
#include "gltf.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>

#include <cjson/cJSON.h>
#include <nettle/base64.h>

#include "base/json.h"

#define MAX_JSON_SIZE ((size_t)16 << 20) /* the tree takes some 30 times this memory */
#define MAX_NUMBER 9007199254740992.0    /* integers are exact up to here */

typedef struct json_reader {
    qm_builder *builder;
    qm_gltf_scene *gltf;
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

/** Reads an index below count; QM_GLTF_NONE if it is absent. */
static qm_status read_json_index(json_reader *reader, const cJSON *object, const char *name, size_t count,
                                 size_t *index)
{
    uint64_t number = 0;
    qm_status status = read_integer(reader, object, name, &number);
    if (status != QM_OK) return status;
    if (!find(object, name)) {
        *index = QM_GLTF_NONE;
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

/** A file that the JSON part names. */
typedef struct gltf_file {
    char path[4096];
    FILE *file;
} gltf_file;

/** Decodes a data URI (RFC 2397) in base64. */
static qm_status read_data_uri(json_reader *reader, const char *uri, size_t number, qm_gltf_buffer *out)
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

/** Replaces %20 and its like by the characters that they stand for. */
static void decode_percents(char *text)
{
    char *out = text;
    for (const char *at = text; *at; ++out) {
        unsigned value;
        bool is_coded = at[0] == '%' && isxdigit((unsigned char)at[1]) && isxdigit((unsigned char)at[2]);
        if (is_coded) sscanf(at + 1, "%2x", &value);
        *out = is_coded ? (char)value : *at;
        at += is_coded ? 3 : 1;
    }
    *out = 0;
}

/** Reads the file of a buffer, which lies in the folder or below it. */
static qm_status read_named_file(json_reader *reader, const char *uri, size_t number, gltf_file *in,
                                 qm_gltf_buffer *out)
{
    const char *folder = reader->builder->limits->folder;
    snprintf(in->path, sizeof in->path, "%s", uri);
    decode_percents(in->path);
    bool is_within = in->path[0] != '/' && !strstr(in->path, "..") && !strstr(in->path, "://");
    size_t length = strlen(in->path), before = strlen(folder);
    if (!is_within || strlen(uri) >= sizeof in->path || before + length >= sizeof in->path)
        return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED,
                             "buffer %zu is not in a file beside this one: %s", number, out->uri);
    memmove(in->path + before, in->path, length + 1);
    memcpy(in->path, folder, before);
    in->file = fopen(in->path, "rb");
    long size = in->file && fseek(in->file, 0, SEEK_END) == 0 ? ftell(in->file) : -1;
    if (size < 0 || fseek(in->file, 0, SEEK_SET) != 0)
        return qm_codec_fail(reader->builder->report, QM_E_FORMAT, "buffer %zu: the file %s cannot be read",
                             number, out->uri);
    out->capacity = (size_t)size + 1;
    out->bytes = qm_context_alloc(reader->builder->ctx, out->capacity, 1);
    if (!out->bytes) return QM_E_NO_MEMORY;
    out->size = fread(out->bytes, 1, (size_t)size, in->file);
    return QM_OK;
}

static qm_status read_beside(json_reader *reader, const char *uri, size_t number, qm_gltf_buffer *out)
{
    gltf_file in = {.file = NULL};
    qm_status status = read_named_file(reader, uri, number, &in, out);
    if (in.file) fclose(in.file);
    return status;
}

static qm_status read_buffers(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    qm_gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "buffers", sizeof *gltf->buffers, &block, &gltf->buffer_count, &item);
    gltf->buffers = block;
    for (size_t i = 0; status == QM_OK && item; item = item->next, ++i) {
        qm_gltf_buffer *buffer = &gltf->buffers[i];
        const char *uri = cJSON_GetStringValue(find(item, "uri"));
        buffer->is_binary_part = i == 0 && !uri;
        if (uri && strncmp(uri, "data:", 5) == 0)
            status = read_data_uri(reader, uri, i, buffer);
        else
            snprintf(buffer->uri, sizeof buffer->uri, "%s", uri ? uri : "");
        if (status == QM_OK && buffer->uri[0] && reader->builder->limits->folder)
            status = read_beside(reader, uri, i, buffer);
    }
    return status;
}

/** An extension of this name, or of the name that it has since it was ratified. */
static const cJSON *find_extension(const cJSON *object, const char *name, const char *other)
{
    const cJSON *extensions = find(object, "extensions"), *item = find(extensions, name);
    return item || !other ? item : find(extensions, other);
}

/** Which of the names a member has; other for a name that is none of them, first if there is no such member. */
static int read_name(const cJSON *object, const char *member, const char *const *names, int count, int other)
{
    const char *name = cJSON_GetStringValue(find(object, member));
    for (int i = 0; name && i < count; ++i)
        if (strcmp(name, names[i]) == 0) return i;
    return name ? other : 0;
}

/** EXT_meshopt_compression: where the encoded bytes are, in place of the decoded ones. */
static qm_status read_encoded_view(json_reader *reader, const cJSON *item, qm_gltf_view *view)
{
    static const char *const codings[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
    static const char *const filters[] = {"NONE", "EXPONENTIAL"};
    *view = (qm_gltf_view){.is_encoded = true};
    view->coding = (qm_gltf_coding)read_name(item, "mode", codings, 3, QM_GLTF_ATTRIBUTES);
    view->filter = (qm_gltf_filter)read_name(item, "filter", filters, 2, QM_GLTF_OTHER_FILTER);
    qm_status status = read_json_index(reader, item, "buffer", reader->gltf->buffer_count, &view->buffer);
    if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &view->offset);
    if (status == QM_OK) status = read_integer(reader, item, "byteLength", &view->size);
    if (status == QM_OK) status = read_integer(reader, item, "byteStride", &view->stride);
    if (status == QM_OK) status = read_integer(reader, item, "count", &view->count);
    return status;
}

static qm_status read_views(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    qm_gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "bufferViews", sizeof *gltf->views, &block, &gltf->view_count, &item);
    gltf->views = block;
    for (qm_gltf_view *view = gltf->views; status == QM_OK && item; item = item->next, ++view) {
        status = read_json_index(reader, item, "buffer", gltf->buffer_count, &view->buffer);
        if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &view->offset);
        if (status == QM_OK) status = read_integer(reader, item, "byteLength", &view->size);
        if (status == QM_OK) status = read_integer(reader, item, "byteStride", &view->stride);
        const cJSON *encoded = find_extension(item, "EXT_meshopt_compression", "KHR_meshopt_compression");
        if (status == QM_OK && encoded) status = read_encoded_view(reader, encoded, view);
    }
    return status;
}

static qm_status read_sparse(json_reader *reader, const cJSON *item, qm_gltf_sparse *out)
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
    bool is_whole = out->index_view != QM_GLTF_NONE && out->value_view != QM_GLTF_NONE;
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
    qm_gltf_scene *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "accessors", sizeof *gltf->accessors, &block, &gltf->accessor_count, &item);
    gltf->accessors = block;
    for (qm_gltf_accessor *accessor = gltf->accessors; status == QM_OK && item;
         item = item->next, ++accessor) {
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
    qm_gltf_scene *gltf = reader->gltf;
    if (list && !cJSON_IsArray(list)) return fail_json(reader, "`primitives` must be an array");
    for (const cJSON *item = list ? list->child : NULL; item; item = item->next) {
        void *block = gltf->primitives;
        qm_gltf_primitive primitive;
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
        const cJSON *draco = find_extension(item, "KHR_draco_mesh_compression", NULL);
        primitive.is_draco = draco != NULL;
        if (status == QM_OK)
            status = read_json_index(reader, draco, "bufferView", reader->gltf->view_count, &primitive.draco);
        primitive.has_polygons = find_extension(item, "FB_ngon_encoding", NULL) != NULL;
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
    qm_gltf_scene *gltf = reader->gltf;
    qm_status status = start_list(reader, "meshes", sizeof *gltf->meshes, &block, &gltf->mesh_count, &item);
    gltf->meshes = block;
    for (qm_gltf_mesh *mesh = gltf->meshes; status == QM_OK && item; item = item->next, ++mesh) {
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
    qm_gltf_scene *gltf = reader->gltf;
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
    qm_gltf_scene *gltf = reader->gltf;
    qm_status status = start_list(reader, "nodes", sizeof *gltf->nodes, &block, &gltf->node_count, &item);
    gltf->nodes = block;
    for (qm_gltf_node *node = gltf->nodes; status == QM_OK && item; item = item->next, ++node) {
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
    qm_gltf_scene *gltf = reader->gltf;
    if (gltf->node_count == 0 && gltf->mesh_count > 0) {
        gltf->nodes = qm_context_alloc(reader->builder->ctx, gltf->mesh_count, sizeof *gltf->nodes);
        if (!gltf->nodes) return QM_E_NO_MEMORY;
        gltf->node_count = gltf->mesh_count;
        for (size_t i = 0; i < gltf->node_count; ++i)
            gltf->nodes[i] = (qm_gltf_node){.matrix = {[0] = 1, [5] = 1, [10] = 1, [15] = 1}, .mesh = i};
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

/** Extensions that are read, and those that change the appearance, but not the shape. */
static bool is_supported(const char *extension)
{
    static const char *const prefixes[] = {
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
        "FB_ngon_encoding",
        "KHR_mesh_quantization",
        "KHR_materials_",
        "KHR_texture_",
        "KHR_lights_",
        "KHR_animation_pointer",
        "KHR_xmp",
        "EXT_texture_",
    };
    for (size_t i = 0; i < sizeof prefixes / sizeof *prefixes; ++i)
        if (strncmp(extension, prefixes[i], strlen(prefixes[i])) == 0) return true;
    return false;
}

/** Version 1 is another format, and a layout, whose nodes are places, no mesh at all. */
static qm_status check_version(json_reader *reader)
{
    const char *version = cJSON_GetStringValue(find(find(reader->root, "asset"), "version"));
    if (!version && find(reader->root, "curves"))
        return fail_json(reader, "this is a layout of curves, not a mesh");
    if (!version || strncmp(version, "1.", 2) != 0) return QM_OK;
    return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED, "glTF %.16s is not supported, only 2.0",
                         version);
}

static qm_status check_extensions(json_reader *reader)
{
    const cJSON *list = find(reader->root, "extensionsRequired");
    for (const cJSON *item = cJSON_IsArray(list) ? list->child : NULL; item; item = item->next) {
        const char *name = cJSON_GetStringValue(item);
        if (name && is_supported(name)) continue;
        return qm_codec_fail(reader->builder->report, QM_E_UNSUPPORTED,
                             "the file requires the glTF extension %.64s, which is not supported",
                             name ? name : "without a name");
    }
    return QM_OK;
}

qm_status qm_gltf_parse(qm_builder *builder, const uint8_t *json, size_t size, qm_gltf_scene *gltf)
{
    *gltf = (qm_gltf_scene){0};
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

void qm_gltf_free(qm_context *ctx, qm_gltf_scene *gltf)
{
    for (size_t i = 0; i < gltf->buffer_count; ++i)
        qm_context_free(ctx, gltf->buffers[i].bytes, gltf->buffers[i].capacity, 1);
    qm_context_free(ctx, gltf->buffers, gltf->buffer_count, sizeof *gltf->buffers);
    for (size_t i = 0; i < gltf->view_count; ++i)
        if (gltf->views[i].decoded)
            qm_context_free(ctx, gltf->views[i].decoded, gltf->views[i].count, gltf->views[i].stride);
    qm_context_free(ctx, gltf->views, gltf->view_count, sizeof *gltf->views);
    qm_context_free(ctx, gltf->accessors, gltf->accessor_count, sizeof *gltf->accessors);
    qm_context_free(ctx, gltf->primitives, gltf->primitive_capacity, sizeof *gltf->primitives);
    qm_context_free(ctx, gltf->meshes, gltf->mesh_count, sizeof *gltf->meshes);
    qm_context_free(ctx, gltf->nodes, gltf->node_count, sizeof *gltf->nodes);
    qm_context_free(ctx, gltf->links, gltf->link_capacity, sizeof *gltf->links);
}
