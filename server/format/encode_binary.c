/**
 * encode_binary.c: PLY in double precision, STL and glTF binary in single. All little-endian.
 */
#include <endian.h>
#include <math.h>
#include <string.h>

#include "base/json.h"
#include "encode_internal.h"

static void add_u32(qm_text *out, uint32_t value)
{
    uint32_t bits = htole32(value);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

static void add_f32(qm_text *out, double value)
{
    float single = (float)value;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    add_u32(out, bits);
}

static void add_f64(qm_text *out, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

/* ---- PLY ---- */

/** The type of the corner count: a byte if it suffices, as most readers expect. */
static bool has_byte_counts(const qm_encoder *encoder)
{
    return encoder->max_corners <= UINT8_MAX;
}

static void add_ply_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_add_string(out, "ply\nformat binary_little_endian 1.0\n");
    for (size_t i = 0; i < encoder->mesh->grid_count; i++)
        qm_text_printf(out, "comment grid %u %u\n", encoder->mesh->grids[i].rows,
                       encoder->mesh->grids[i].columns);
    qm_text_printf(out,
                   "element vertex %zu\n"
                   "property double x\nproperty double y\nproperty double z\n",
                   encoder->mesh->vertex_count);
    if (encoder->input_faces > 0)
        qm_text_printf(out, "element face %zu\nproperty list %s uint vertex_indices\n", encoder->input_faces,
                       has_byte_counts(encoder) ? "uchar" : "uint");
    qm_text_add_string(out, "end_header\n");
}

static qm_status prepare_ply(qm_encoder *encoder)
{
    qm_text head = {0};
    add_ply_head(encoder, &head);
    /* The fan of a face has two triangles fewer than corners. */
    uint64_t corners = (uint64_t)encoder->triangles + 2 * (uint64_t)encoder->input_faces;
    encoder->size = head.size + 24 * (uint64_t)encoder->mesh->vertex_count +
                    (has_byte_counts(encoder) ? 1 : 4) * (uint64_t)encoder->input_faces + 4 * corners;
    qm_status status = head.failed ? QM_E_NO_MEMORY : QM_OK;
    qm_text_reset(&head);
    return status;
}

static void add_ply_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    for (int axis = 0; axis < 3; axis++)
        add_f64(out, encoder->mesh->positions[3 * vertex + (size_t)axis]);
}

static void add_ply_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    size_t count = qm_encode_corner_count(encoder->mesh, first, end);
    uint8_t byte = (uint8_t)count;
    if (has_byte_counts(encoder))
        qm_text_add(out, (const char *)&byte, 1);
    else
        add_u32(out, (uint32_t)count);
    for (size_t i = 0; i < count; i++)
        add_u32(out, qm_encode_corner(encoder->mesh, first, i));
}

const qm_encode_format qm_encode_ply = {prepare_ply, add_ply_head, add_ply_vertex, add_ply_face};

/* ---- STL ---- */

#define STL_HEAD_SIZE 80

static qm_status fail_size(const qm_encoder *encoder)
{
    return qm_context_fail(encoder->ctx, QM_E_TOO_LARGE, "the mesh exceeds the counts of the format");
}

static qm_status prepare_stl(qm_encoder *encoder)
{
    if (encoder->mesh->face_count == 0)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED,
                               "stl holds triangles only, and the mesh has points");
    if (encoder->triangles > UINT32_MAX) return fail_size(encoder);
    encoder->size = STL_HEAD_SIZE + 4 + 50 * (uint64_t)encoder->triangles;
    encoder->losses.cut_faces = encoder->facts->quads + encoder->facts->polygons;
    encoder->losses.left_out_vertices = encoder->facts->unused_vertices;
    return qm_encode_round_to_floats(encoder);
}

static void add_stl_head(const qm_encoder *encoder, qm_text *out)
{
    char head[STL_HEAD_SIZE + 1] = {0};
    memcpy(head, "binary STL", strlen("binary STL"));
    qm_text_add(out, head, STL_HEAD_SIZE);
    add_u32(out, (uint32_t)encoder->triangles);
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
        add_f32(out, normal[i]);
    for (int i = 0; i < 9; i++)
        add_f32(out, p[i / 3][i % 3]);
    qm_text_add(out, "\0", 2);
}

static void add_stl_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    for (uint32_t face = first; face < end; face++) {
        uint32_t rows[2][3];
        int count = qm_encode_list_triangles(encoder->mesh->faces + 4 * (size_t)face, rows);
        for (int i = 0; i < count; i++)
            add_stl_triangle(encoder->mesh, rows[i], out);
    }
}

const qm_encode_format qm_encode_stl = {prepare_stl, add_stl_head, NULL, add_stl_face};

/* ---- glTF binary ---- */

#define GLB_MAGIC 0x46546c67u
#define GLB_JSON 0x4e4f534au
#define GLB_BIN 0x004e4942u
#define GLB_TRIANGLES 4
#define GLB_POINTS 0
#define GLB_ARRAY_BUFFER 34962
#define GLB_ELEMENT_BUFFER 34963
#define GLB_FLOAT 5126
#define GLB_UNSIGNED_INT 5125

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

/** The bounding box of the vertices in single precision. */
static void add_box(const qm_encoder *encoder, qm_text *json)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double *p = encoder->mesh->positions;
    for (size_t i = 0; i < 3 * encoder->mesh->vertex_count; i++) {
        double value = (double)(float)p[i];
        low[i % 3] = fmin(low[i % 3], value);
        high[i % 3] = fmax(high[i % 3], value);
    }
    qm_json_add_numbers(json, "min", low, 3);
    qm_json_add_numbers(json, "max", high, 3);
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
                   has_faces ? "\"indices\":1," : "", has_faces ? GLB_TRIANGLES : GLB_POINTS,
                   (unsigned long long)(positions + indices));
    add_view(json, 0, positions, GLB_ARRAY_BUFFER);
    if (has_faces) add_view(json, positions, indices, GLB_ELEMENT_BUFFER);
    qm_text_add_string(json, "],\"accessors\":[");
    open_accessor(json, 0, GLB_FLOAT, encoder->mesh->vertex_count, "VEC3");
    add_box(encoder, json);
    qm_text_add_string(json, "}");
    if (has_faces) {
        open_accessor(json, 1, GLB_UNSIGNED_INT, indices / 4, "SCALAR");
        qm_text_add_string(json, "}");
    }
    qm_text_add_string(json, "]}");
    while (json->size % 4 != 0 && !json->failed)
        qm_text_add_string(json, " ");
}

static qm_status prepare_glb(qm_encoder *encoder)
{
    qm_status status = qm_encode_round_to_floats(encoder);
    if (status != QM_OK) return status;
    write_glb_json(encoder, &encoder->file);
    if (encoder->file.failed) return QM_E_NO_MEMORY;
    encoder->size = 12 + 8 + encoder->file.size + 8 + positions_size(encoder) + indices_size(encoder);
    encoder->losses.cut_faces = encoder->facts->quads + encoder->facts->polygons;
    return encoder->size <= UINT32_MAX ? QM_OK : fail_size(encoder);
}

static void add_glb_head(const qm_encoder *encoder, qm_text *out)
{
    add_u32(out, GLB_MAGIC);
    add_u32(out, 2);
    add_u32(out, (uint32_t)encoder->size);
    add_u32(out, (uint32_t)encoder->file.size);
    add_u32(out, GLB_JSON);
    qm_text_add(out, encoder->file.data, encoder->file.size);
    add_u32(out, (uint32_t)(positions_size(encoder) + indices_size(encoder)));
    add_u32(out, GLB_BIN);
}

static void add_glb_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    for (int axis = 0; axis < 3; axis++)
        add_f32(out, encoder->mesh->positions[3 * vertex + (size_t)axis]);
}

static void add_glb_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    for (uint32_t face = first; face < end; face++) {
        uint32_t rows[2][3];
        int count = qm_encode_list_triangles(encoder->mesh->faces + 4 * (size_t)face, rows);
        for (int i = 0; i < count; i++)
            for (int corner = 0; corner < 3; corner++)
                add_u32(out, rows[i][corner]);
    }
}

const qm_encode_format qm_encode_glb = {prepare_glb, add_glb_head, add_glb_vertex, add_glb_face};
