/**
 * codec_gltf_json.c: The JSON part of a glTF file, turned into the plain arrays of codec_gltf.h. cJSON's lists are chained, so
 * each is walked once in order, never by index.
 */
#include <math.h>

#include <cjson/cJSON.h>

#include "base/json.h"
#include "codec_gltf.h"

#define MAX_JSON_SIZE ((size_t)16 << 20) /* the tree takes some 30 times this memory */
#define MAX_NUMBER 9007199254740992.0    /* integers are exact up to here */

typedef struct json_reader {
    qm_builder *builder;
    qm_gltf *gltf;
    const cJSON *root;
    size_t buffer_count;
    bool first_buffer_is_foreign;
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
static qm_status read_index(json_reader *reader, const cJSON *object, const char *name, size_t count,
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

static qm_status read_buffers(json_reader *reader)
{
    const cJSON *list = find(reader->root, "buffers");
    if (!list) return QM_OK;
    if (!cJSON_IsArray(list)) return fail_json(reader, "`buffers` must be an array");
    reader->first_buffer_is_foreign = list->child && find(list->child, "uri");
    for (const cJSON *item = list->child; item; item = item->next)
        ++reader->buffer_count;
    return QM_OK;
}

static qm_status read_views(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    qm_gltf *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "bufferViews", sizeof *gltf->views, &block, &gltf->view_count, &item);
    gltf->views = block;
    for (qm_gltf_view *view = gltf->views; status == QM_OK && item; item = item->next, ++view) {
        size_t buffer = QM_GLTF_NONE;
        status = read_index(reader, item, "buffer", reader->buffer_count, &buffer);
        if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &view->offset);
        if (status == QM_OK) status = read_integer(reader, item, "byteLength", &view->size);
        if (status == QM_OK) status = read_integer(reader, item, "byteStride", &view->stride);
        view->is_foreign = buffer != 0 || reader->first_buffer_is_foreign;
    }
    return status;
}

static int count_components(const cJSON *accessor)
{
    const char *type = cJSON_GetStringValue(find(accessor, "type"));
    if (type && strcmp(type, "SCALAR") == 0) return 1;
    return type && strcmp(type, "VEC3") == 0 ? 3 : 0;
}

static qm_status read_accessors(json_reader *reader)
{
    void *block = NULL;
    const cJSON *item;
    qm_gltf *gltf = reader->gltf;
    qm_status status =
        start_list(reader, "accessors", sizeof *gltf->accessors, &block, &gltf->accessor_count, &item);
    gltf->accessors = block;
    for (qm_gltf_accessor *accessor = gltf->accessors; status == QM_OK && item;
         item = item->next, ++accessor) {
        uint64_t component_type = 0;
        status = read_index(reader, item, "bufferView", gltf->view_count, &accessor->view);
        if (status == QM_OK) status = read_integer(reader, item, "byteOffset", &accessor->offset);
        if (status == QM_OK) status = read_integer(reader, item, "count", &accessor->count);
        if (status == QM_OK) status = read_integer(reader, item, "componentType", &component_type);
        accessor->component_type = component_type <= 5126 ? (int)component_type : 0;
        accessor->component_count = count_components(item);
        accessor->is_sparse = find(item, "sparse") != NULL;
    }
    return status;
}

static qm_status read_primitive(json_reader *reader, const cJSON *item, qm_gltf_primitive *primitive)
{
    size_t accessor_count = reader->gltf->accessor_count;
    uint64_t mode = 4;
    if (!cJSON_IsObject(item)) return fail_json(reader, "an entry of `primitives` must be an object");
    qm_status status =
        read_index(reader, find(item, "attributes"), "POSITION", accessor_count, &primitive->positions);
    if (status == QM_OK) status = read_index(reader, item, "indices", accessor_count, &primitive->indices);
    if (status == QM_OK) status = read_integer(reader, item, "mode", &mode);
    if (status == QM_OK && mode > 6) return fail_json(reader, "`mode` of a primitive must not exceed 6");
    primitive->mode = (int)mode;
    primitive->is_draco = find(find(item, "extensions"), "KHR_draco_mesh_compression") != NULL;
    if (find(item, "targets")) reader->gltf->has_poses = true;
    return status;
}

static qm_status read_primitives(json_reader *reader, const cJSON *list)
{
    qm_gltf *gltf = reader->gltf;
    if (list && !cJSON_IsArray(list)) return fail_json(reader, "`primitives` must be an array");
    for (const cJSON *item = list ? list->child : NULL; item; item = item->next) {
        void *block = gltf->primitives;
        qm_gltf_primitive primitive;
        qm_status status = read_primitive(reader, item, &primitive);
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
    qm_gltf *gltf = reader->gltf;
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

/** Translation * rotation * scale, column-major. */
static void compose(const double t[3], const double q[4], const double s[3], double matrix[16])
{
    double x = q[0], y = q[1], z = q[2], w = q[3];
    const double columns[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
                                  {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
                                  {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}};
    for (int column = 0; column < 3; ++column)
        for (int row = 0; row < 3; ++row)
            matrix[4 * column + row] = columns[column][row] * s[column];
    memcpy(matrix + 12, t, 3 * sizeof *t);
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
    compose(t, q, s, matrix);
    return QM_OK;
}

/** Adds the nodes of a list to links, and sets their parents. */
static qm_status read_links(json_reader *reader, const cJSON *list)
{
    qm_gltf *gltf = reader->gltf;
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
    qm_gltf *gltf = reader->gltf;
    qm_status status = start_list(reader, "nodes", sizeof *gltf->nodes, &block, &gltf->node_count, &item);
    gltf->nodes = block;
    for (qm_gltf_node *node = gltf->nodes; status == QM_OK && item; item = item->next, ++node) {
        status = read_transform(reader, item, node->matrix);
        if (status == QM_OK) status = read_index(reader, item, "mesh", gltf->mesh_count, &node->mesh);
        if (find(item, "skin")) gltf->has_poses = true;
        node->first_child = gltf->link_count;
        if (status == QM_OK) status = read_links(reader, find(item, "children"));
        node->child_count = gltf->link_count - node->first_child;
    }
    return status;
}

/** The roots of the default scene, or of the first one. */
static qm_status read_scene(json_reader *reader)
{
    const cJSON *scene = find(reader->root, "scenes");
    uint64_t index = 0;
    reader->gltf->first_root = reader->gltf->link_count;
    qm_status status = read_integer(reader, reader->root, "scene", &index);
    if (status != QM_OK) return status;
    if (!cJSON_IsArray(scene)) return fail_json(reader, "the file has no scene");
    scene = scene->child;
    for (; scene && index > 0; --index)
        scene = scene->next;
    if (!scene) return fail_json(reader, "`scene` refers to a scene that does not exist");
    return read_links(reader, find(scene, "nodes"));
}

/** Extensions that change the appearance, but not the shape. */
static bool is_harmless_extension(const char *name)
{
    static const char *const prefixes[] = {"KHR_materials_", "KHR_texture_", "KHR_lights_",
                                           "EXT_texture_",   "KHR_xmp",      "KHR_mesh_quantization"};
    for (size_t i = 0; i < sizeof prefixes / sizeof *prefixes; ++i)
        if (strncmp(name, prefixes[i], strlen(prefixes[i])) == 0) return true;
    return false;
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
                             "the file requires a glTF extension that is not supported");
    }
    return QM_OK;
}

static qm_status read_tree(json_reader *reader)
{
    qm_status status = check_extensions(reader);
    if (status == QM_OK) status = read_buffers(reader);
    if (status == QM_OK) status = read_views(reader);
    if (status == QM_OK) status = read_accessors(reader);
    if (status == QM_OK) status = read_meshes(reader);
    if (status == QM_OK) status = read_nodes(reader);
    if (status == QM_OK) status = read_scene(reader);
    return status;
}

qm_status qm_gltf_parse(qm_builder *builder, const uint8_t *json, size_t size, qm_gltf *gltf)
{
    *gltf = (qm_gltf){0};
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
    qm_status status = read_tree(&reader);
    cJSON_Delete(root);
    return status;
}

void qm_gltf_free(qm_context *ctx, qm_gltf *gltf)
{
    qm_context_free(ctx, gltf->views, gltf->view_count, sizeof *gltf->views);
    qm_context_free(ctx, gltf->accessors, gltf->accessor_count, sizeof *gltf->accessors);
    qm_context_free(ctx, gltf->primitives, gltf->primitive_capacity, sizeof *gltf->primitives);
    qm_context_free(ctx, gltf->meshes, gltf->mesh_count, sizeof *gltf->meshes);
    qm_context_free(ctx, gltf->nodes, gltf->node_count, sizeof *gltf->nodes);
    qm_context_free(ctx, gltf->links, gltf->link_capacity, sizeof *gltf->links);
}
