/* glTF binary files by hand: transforms, modes, shared accessors, every fault. */
#include <dlfcn.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <nettle/base64.h>

#include "check.h"
#include "decode.h"
#include "random.h"
#include "shapes.h"

/** A binary part of a square: four positions (48 bytes), indices of two triangles as bytes, shorts and
 * ints. */
static void add_square(qm_bytes *part)
{
    static const float positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const uint8_t indices[6] = {0, 1, 2, 0, 2, 3};
    qm_bytes_add_floats(part, positions, 12);
    qm_bytes_add(part, indices, 6);
    qm_bytes_add(part, "\0\0", 2);
    for (int i = 0; i < 6; ++i)
        qm_bytes_add_u16(part, indices[i]);
    for (int i = 0; i < 6; ++i)
        qm_bytes_add_u32(part, indices[i]);
}

#define VIEWS "\"buffers\":[{\"byteLength\":92}]," TEXT_VIEWS
#define TEXT_VIEWS                                                                                           \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},"                                                     \
    "{\"buffer\":0,\"byteOffset\":48,\"byteLength\":6},{\"buffer\":0,\"byteOffset\":56,\"byteLength\":12},"  \
    "{\"buffer\":0,\"byteOffset\":68,\"byteLength\":24}]"
#define POSITIONS "{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}"
#define ACCESSORS                                                                                            \
    "\"accessors\":[" POSITIONS                                                                              \
    ",{\"bufferView\":1,\"componentType\":5121,\"count\":6,\"type\":\"SCALAR\"},"                            \
    "{\"bufferView\":2,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"},"                             \
    "{\"bufferView\":3,\"componentType\":5125,\"count\":6,\"type\":\"SCALAR\"}]"
/** The positions as an encoded view, of which nothing is there but the plain bytes. */
#define ENCODED(size, stride, count, more)                                                                   \
    "\"buffers\":[{\"byteLength\":92}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48,\"extensions\":{"    \
    "\"EXT_meshopt_compression\":{\"buffer\":0,\"byteLength\":" size ",\"byteStride\":" stride               \
    ",\"count\":" count ",\"mode\":\"ATTRIBUTES\"" more "}}},"                                               \
    "{\"buffer\":0,\"byteOffset\":48,\"byteLength\":6},{\"buffer\":0,\"byteOffset\":56,\"byteLength\":12},"  \
    "{\"buffer\":0,\"byteOffset\":68,\"byteLength\":24}]"
#define SCENE "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]"
#define MESH(indices) "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}" indices "}]}]"

static void add_file(qm_bytes *file, const char *json, const qm_bytes *part)
{
    file->size = 0;
    qm_bytes_add_text(file, "glTF");
    qm_bytes_add_u32(file, 2);
    qm_bytes_add_u32(file, (uint32_t)(12 + 8 + strlen(json) + 8 + part->size));
    qm_bytes_add_u32(file, (uint32_t)strlen(json));
    qm_bytes_add_text(file, "JSON");
    qm_bytes_add_text(file, json);
    qm_bytes_add_u32(file, (uint32_t)part->size);
    qm_bytes_add(file, "BIN", 4);
    qm_bytes_add(file, part->data, part->size);
}

static qm_decoded decode_square(const char *json)
{
    qm_bytes file, part = {.size = 0};
    add_square(&part);
    add_file(&file, json, &part);
    return qm_decode(QM_FORMAT_GLB, file.data, file.size);
}

static void check_faces(const char *json, const uint32_t (*faces)[4], size_t count)
{
    qm_decoded decoded = decode_square(json);
    QM_CHECK(decoded.status == QM_OK, "%s: %s", json, decoded.report.detail);
    assert_int_equal(decoded.mesh.face_count, count);
    if (count > 0) assert_memory_equal(decoded.mesh.faces, faces, count * sizeof *faces);
    qm_decoded_free(&decoded);
}

#define NONE QM_NO_INDEX

static void indices_come_in_three_widths_or_not_at_all(void **state)
{
    (void)state;
    static const uint32_t square[2][4] = {{0, 1, 2, NONE}, {0, 2, 3, NONE}};
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":1") "}", square, 2);
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":2") "}", square, 2);
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":3,\"mode\":4") "}", square, 2);
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"mode\":6") "}", square, 2);
}

static void strips_turn_every_second_triangle(void **state)
{
    (void)state;
    static const uint32_t strip[2][4] = {{0, 1, 2, NONE}, {1, 3, 2, NONE}};
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"mode\":5") "}", strip, 2);
    check_faces("{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"mode\":0") "}", NULL, 0);
}

static void nodes_place_their_meshes(void **state)
{
    (void)state;
    static const char json[] =
        "{" VIEWS "," ACCESSORS
        "," MESH(",\"indices\":1") ",\"scenes\":[{},{\"nodes\":[1,0]}],\"scene\":1,"
                                   "\"nodes\":[{\"mesh\":0,\"scale\":[-1,2,1]},{\"translation\":[10,0,0],"
                                   "\"children\":[2,3]},"
                                   "{\"mesh\":0,\"rotation\":[0,0,0.70710678118654752,0.70710678118654752]},"
                                   "{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,5,1]}]}";
    /* The third corner of the square, (1, 1, 0), in each placement: root 1 with its children comes first. */
    static const double corners[3][3] = {{9, 1, 0}, {11, 1, 5}, {-1, 2, 0}};
    qm_decoded decoded = decode_square(json);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 12);
    assert_int_equal(decoded.mesh.face_count, 6);
    for (size_t i = 0; i < 3; ++i)
        for (size_t axis = 0; axis < 3; ++axis)
            QM_CHECK(fabs(decoded.mesh.positions[3 * (4 * i + 2) + axis] - corners[i][axis]) < 1e-15,
                     "placement %zu axis %zu: %.17g", i, axis,
                     decoded.mesh.positions[3 * (4 * i + 2) + axis]);
    /* The mirrored one is listed the other way round. */
    static const uint32_t mirrored[4] = {8, 10, 9, NONE};
    assert_memory_equal(decoded.mesh.faces + 4 * 4, mirrored, sizeof mirrored);
    qm_decoded_free(&decoded);
}

static void shared_positions_are_added_once_a_mesh(void **state)
{
    (void)state;
    qm_decoded decoded = decode_square(
        "{" VIEWS "," ACCESSORS "," SCENE ",\"meshes\":[{\"primitives\":["
        "{\"attributes\":{\"POSITION\":0},\"indices\":1},{\"attributes\":{\"POSITION\":0},\"indices\":2},"
        "{\"attributes\":{\"POSITION\":0},\"mode\":1,\"targets\":[]}]}]}");
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 4);
    assert_int_equal(decoded.mesh.face_count, 4);
    assert_true(qm_decoded_warns(&decoded, "primitives of lines: 1"));
    assert_true(qm_decoded_warns(&decoded, "morph targets"));
    qm_decoded_free(&decoded);
}

static void strides_step_over_other_attributes(void **state)
{
    (void)state;
    qm_bytes file, part = {.size = 0};
    for (int i = 0; i < 3; ++i) {
        const float row[4] = {(float)(i == 1), (float)(i == 2), 0, 99};
        qm_bytes_add_floats(&part, row, i == 2 ? 3 : 4); /* the last row need not be whole */
    }
    add_file(&file,
             "{\"buffers\":[{}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":44,\"byteStride\":16}],"
             "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]," SCENE
             "," MESH("") "}",
             &part);
    qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
    static const double positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    assert_int_equal(decoded.status, QM_OK);
    assert_memory_equal(decoded.mesh.positions, positions, sizeof positions);
    qm_decoded_free(&decoded);
}

/** Positions of a number without data, the first ones replaced; of the indices 2, 0, 2, ... of the square. */
#define SPARSE(count, replaced, value_offset)                                                                \
    "{\"componentType\":5126,\"count\":" #count ",\"type\":\"VEC3\",\"sparse\":{\"count\":" #replaced        \
    ",\"indices\":{\"bufferView\":1,\"byteOffset\":2,\"componentType\":5121},"                               \
    "\"values\":{\"bufferView\":0,\"byteOffset\":" #value_offset "}}}"

static void check_positions(const char *json, const double (*expected)[3], size_t count)
{
    qm_decoded decoded = decode_square(json);
    QM_CHECK(decoded.status == QM_OK, "%s: %s", json, decoded.report.detail);
    assert_int_equal(decoded.mesh.vertex_count, count);
    for (size_t i = 0; i < 3 * count; ++i)
        QM_CHECK(decoded.mesh.positions[i] == expected[i / 3][i % 3], "%s: coordinate %zu is %.17g", json, i,
                 decoded.mesh.positions[i]);
    qm_decoded_free(&decoded);
}

static void sparse_accessors_replace_elements(void **state)
{
    (void)state;
    /* The indices at bytes 2 to 4 of their view are 2, 0, 2. */
    static const double zeros[4][3] = {{1, 0, 0}, {0, 0, 0}, {1, 1, 0}, {0, 0, 0}};
    static const double square[4][3] = {
        {0, 0x1p-148, 0x1.8p-148}, {1, 0, 0}, {0, 0x1p-149, 0x1p-148}, {0, 1, 0}};
    check_positions("{" VIEWS ",\"accessors\":[" SPARSE(4, 3, 0) "]," SCENE "," MESH(",\"mode\":6") "}",
                    zeros, 4);
    check_positions(
        "{" VIEWS ",\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,"
        "\"type\":\"VEC3\",\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":1,\"byteOffset\":2,"
        "\"componentType\":5121},\"values\":{\"bufferView\":3}}}]," SCENE "," MESH(",\"mode\":6") "}",
        square, 4);
}

static void files_without_a_scene_are_taken_whole(void **state)
{
    (void)state;
    static const double plain[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    static const double moved[4][3] = {{3, 0, 0}, {4, 0, 0}, {4, 1, 0}, {3, 1, 0}};
    check_positions("{" VIEWS "," ACCESSORS "," MESH(",\"indices\":1") "}", plain, 4);
    check_positions("{" VIEWS "," ACCESSORS
                    "," MESH(",\"indices\":1") ",\"nodes\":[{\"mesh\":0},"
                                               "{\"translation\":[3,0,0],\"children\":[0]}]}",
                    moved, 4);
}

static void integers_stand_for_positions(void **state)
{
    (void)state;
    static const uint8_t bytes[12] = {0, 127, 128, 0, 255, 1, 129, 0, 2, 3, 255, 0};
    static const char format[] =
        "{\"buffers\":[{}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":12,\"byteStride\":%d}],"
        "\"extensionsRequired\":[\"KHR_mesh_quantization\"],\"accessors\":[{\"bufferView\":0,"
        "\"componentType\":%d,\"normalized\":%s,\"count\":%d,\"type\":\"VEC3\"}]," SCENE
        "," MESH(",\"mode\":%d") "}";
    static const struct {
        int type, count;
        const char *normalized;
        double expected[3];
    } cases[] = {
        {5120, 3, "false", {0, 127, -128}},
        {5121, 3, "false", {0, 127, 128}},
        {5120, 3, "true", {0, 1, -1}}, /* -128 / 127 is clamped */
        {5121, 3, "true", {0, (float)127 / 255.0f, (float)128 / 255.0f}},
        {5122, 1, "false", {0x7f00, 0x0080, 0x01ff}},
        {5123, 1, "true", {(float)0x7f00 / 65535.0f, (float)0x0080 / 65535.0f, (float)0x01ff / 65535.0f}},
        {5122, 1, "true", {(float)0x7f00 / 32767.0f, (float)0x0080 / 32767.0f, (float)0x01ff / 32767.0f}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char json[1024];
        qm_bytes file, part = {.size = 0};
        bool is_byte = cases[i].type < 5122;
        snprintf(json, sizeof json, format, is_byte ? 4 : 8, cases[i].type, cases[i].normalized,
                 cases[i].count, is_byte ? 4 : 0);
        qm_bytes_add(&part, bytes, sizeof bytes);
        add_file(&file, json, &part);
        qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
        QM_CHECK(decoded.status == QM_OK, "%s: %s", json, decoded.report.detail);
        for (int axis = 0; axis < 3; ++axis)
            QM_CHECK(decoded.mesh.positions[axis] == cases[i].expected[axis], "case %zu axis %d: %.17g", i,
                     axis, decoded.mesh.positions[axis]);
        qm_decoded_free(&decoded);
    }
}

/** The text form of the square, its bytes in base64, with something before and after. */
static qm_decoded decode_text(const char *before, const char *uri_start, const char *uri_end)
{
    qm_bytes part = {.size = 0}, file = {.size = 0};
    char base64[256] = "";
    add_square(&part);
    assert_true(BASE64_ENCODE_RAW_LENGTH(part.size) < sizeof base64);
    base64_encode_raw(base64, part.size, part.data);
    qm_bytes_add_text(&file, before);
    qm_bytes_add_text(&file, "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":92,\"uri\":\"");
    qm_bytes_add_text(&file, uri_start);
    qm_bytes_add_text(&file, base64);
    qm_bytes_add_text(&file, uri_end);
    qm_bytes_add_text(&file, "\"}]," TEXT_VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":3") "}");
    assert_int_equal(qm_format_sniff(file.data, file.size), QM_FORMAT_GLB);
    return qm_decode(QM_FORMAT_GLB, file.data, file.size);
}

static void the_text_form_has_its_bytes_in_base64(void **state)
{
    (void)state;
    static const char start[] = "data:application/octet-stream;base64,";
    static const struct {
        const char *before, *start, *end;
        qm_status status;
        const char *words;
    } cases[] = {
        {"", start, "", QM_OK, ""},
        {" \r\n\t", "data:;base64,", "", QM_OK, ""},
        {"\xef\xbb\xbf", start, "", QM_OK, ""},
        {"", start, "A", QM_E_FORMAT, "base64 of buffer 0 is invalid"},
        {"", start, "?", QM_E_FORMAT, "base64 of buffer 0 is invalid"},
        {"", "data:text/plain,", "", QM_E_UNSUPPORTED, "buffer 0 is not in base64"},
        {"", "scan.bin?", "", QM_E_UNSUPPORTED, "another file (scan.bin?"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        qm_decoded decoded = decode_text(cases[i].before, cases[i].start, cases[i].end);
        QM_CHECK(decoded.status == cases[i].status && strstr(decoded.report.detail, cases[i].words),
                 "case %zu: %s", i, decoded.report.detail);
        if (decoded.status == QM_OK) {
            assert_int_equal(decoded.mesh.vertex_count, 4);
            assert_int_equal(decoded.mesh.face_count, 2);
            assert_true(decoded.mesh.positions[6] == 1.0 && decoded.mesh.positions[7] == 1.0);
        }
        qm_decoded_free(&decoded);
    }
    assert_int_equal(qm_format_from_path("a/scan.GLTF"), QM_FORMAT_GLB);
    assert_int_equal(qm_format_from_media_type("model/gltf+json; charset=utf-8"), QM_FORMAT_GLB);
    assert_int_equal(qm_format_from_name("gltf"), QM_FORMAT_UNKNOWN); /* none that is written */
}

typedef struct json_case {
    const char *json;
    qm_status status;
    const char *words;
} json_case;

static void json_faults_are_refused(void **state)
{
    (void)state;
    static const json_case cases[] = {
        {"", QM_E_FORMAT, "JSON part is invalid"},
        {"{\"a\":", QM_E_FORMAT, "JSON part is invalid"},
        {"[]", QM_E_FORMAT, "JSON part is invalid"},
        {"{}", QM_E_EMPTY, "no mesh"},
        {"{\"scenes\":[]}", QM_E_EMPTY, "no mesh"},
        {"{\"scenes\":{}}", QM_E_FORMAT, "must be an array"},
        {"{\"scenes\":[{}],\"scene\":1}", QM_E_FORMAT, "refers to a scene"},
        {"{\"scenes\":[{}],\"scene\":-1}", QM_E_FORMAT, "must be an integer"},
        {"{\"scenes\":[{}]}", QM_E_EMPTY, "no mesh"},
        {"{\"scenes\":[{\"nodes\":[1]}],\"nodes\":[{}]}", QM_E_FORMAT, "does not exist"},
        {"{\"scenes\":[{\"nodes\":[0,0]}],\"nodes\":[{}]}", QM_E_FORMAT, "two parents"},
        {"{\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"children\":[0]}]}", QM_E_FORMAT, "two parents"},
        {"{\"scenes\":[{\"nodes\":{}}],\"nodes\":[{}]}", QM_E_FORMAT, "must be an array"},
        {"{\"nodes\":[1]}", QM_E_FORMAT, "must be an object"},
        {"{\"nodes\":[[0,0,0]],\"curves\":[]}", QM_E_FORMAT, "this is a layout of curves, not a mesh"},
        {"{\"nodes\":{}}", QM_E_FORMAT, "must be an array"},
        {"{\"nodes\":[{\"mesh\":0}]}", QM_E_FORMAT, "`mesh` refers to entry 0 of 0"},
        {"{\"nodes\":[{\"matrix\":[1,2]}]}", QM_E_FORMAT, "16 numbers"},
        {"{\"nodes\":[{\"scale\":[1,2,\"x\"]}]}", QM_E_FORMAT, "3 numbers"},
        {"{\"nodes\":[{\"rotation\":[0,0,0,0]}]}", QM_E_FORMAT, "quaternion"},
        {"{\"bufferViews\":[{\"buffer\":0}]}", QM_E_FORMAT, "`buffer` refers to entry 0 of 0"},
        {"{\"accessors\":[{\"count\":1.5}]}", QM_E_FORMAT, "`count` must be an integer"},
        {"{\"meshes\":[{\"primitives\":{}}]}", QM_E_FORMAT, "must be an array"},
        {"{\"meshes\":[{\"primitives\":[1]}]}", QM_E_FORMAT, "must be an object"},
        {"{\"meshes\":[{\"primitives\":[{\"mode\":7}]}]}", QM_E_FORMAT, "`mode` of a primitive"},
        {"{\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]}", QM_E_EMPTY, "no mesh"},
        {"{\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"]}", QM_E_UNSUPPORTED,
         "EXT_mesh_gpu_instancing"},
        {"{\"asset\":{\"version\":\"1.0\"}}", QM_E_UNSUPPORTED, "glTF 1.0 is not supported"},
        {"{\"extensionsRequired\":[7]}", QM_E_UNSUPPORTED, "without a name"},
        {"{\"extensionsRequired\":[\"KHR_materials_unlit\"]}", QM_E_EMPTY, "no mesh"},
        {"{" VIEWS "," ACCESSORS "," SCENE ",\"meshes\":[{\"primitives\":[{}]}]}", QM_E_FORMAT,
         "no positions"},
        {"{" VIEWS "," ACCESSORS "," SCENE
         ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":1}}]}]}",
         QM_E_UNSUPPORTED, "three floats"},
        {"{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":0") "}", QM_E_FORMAT, "unsigned"},
        {"{" VIEWS "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_FORMAT,
         "4 indices are not a multiple of 3"},
        {"{" VIEWS "," ACCESSORS "," SCENE
         "," MESH(",\"extensions\":{\"KHR_draco_mesh_compression\":{}}") "}",
         QM_E_FORMAT, "must name a buffer view"},
        {"{" VIEWS "," ACCESSORS "," SCENE
         "," MESH(",\"extensions\":{\"KHR_draco_mesh_compression\":{\"bufferView\":4}}") "}",
         QM_E_FORMAT, "`bufferView` refers to entry 4 of 4"},
        {"{" VIEWS "," ACCESSORS "," SCENE
         "," MESH(",\"extensions\":{\"KHR_draco_mesh_compression\":{\"bufferView\":1}}") "}",
         QM_E_FORMAT, "buffer view 1: the file does not start like a Draco file"},
        {"{" ENCODED("48", "12", "4", "") "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_FORMAT,
         "the encoded data of buffer view 0 is invalid"},
        {"{" ENCODED("0", "12", "4", "") "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_FORMAT,
         "the encoded data of buffer view 0 is invalid"},
        {"{" ENCODED("48", "10", "4", "") "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_FORMAT,
         "48 bytes cannot be 4 elements of 10"},
        {"{" ENCODED("48", "12", "999999", "") "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_FORMAT,
         "48 bytes cannot be 999999 elements of 12"},
        {"{" ENCODED("48", "12", "99999999999", "") "," ACCESSORS "," SCENE "," MESH("") "}", QM_E_TOO_LARGE,
         "more than 1000000 elements"},
        {"{" ENCODED("48", "12", "4", ",\"filter\":\"OCTAHEDRAL\"") "," ACCESSORS "," SCENE "," MESH("") "}",
         QM_E_UNSUPPORTED, "a filter for normals"},
        {"{" VIEWS
         ",\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":5,\"type\":\"VEC3\"}]," SCENE
         "," MESH("") "}",
         QM_E_FORMAT, "room for 4 elements of 5"},
        {"{" VIEWS ",\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":9007199254740992,"
         "\"type\":\"VEC3\"}]," SCENE "," MESH("") "}",
         QM_E_FORMAT, "room for 4 elements"},
        {"{" VIEWS ",\"accessors\":[{\"bufferView\":0,\"byteOffset\":9007199254740992,\"componentType\":5126,"
         "\"count\":1,\"type\":\"VEC3\"}]," SCENE "," MESH("") "}",
         QM_E_FORMAT, "room for 0 elements"},
        {"{" VIEWS ",\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]," SCENE
         "," MESH("") "}",
         QM_E_UNSUPPORTED, "accessor 0 has no data"},
        {"{" VIEWS ",\"accessors\":[" SPARSE(2000000, 1, 0) "]," SCENE "," MESH("") "}", QM_E_TOO_LARGE,
         "without data"},
        {"{" VIEWS ",\"accessors\":[" SPARSE(2, 1, 0) "]," SCENE "," MESH("") "}", QM_E_INDEX,
         "replaces element 2"},
        {"{" VIEWS ",\"accessors\":[" SPARSE(4, 7, 0) "]," SCENE "," MESH("") "}", QM_E_FORMAT,
         "sparse indices of accessor 0 reaches past"},
        {"{" VIEWS ",\"accessors\":[" SPARSE(4, 1, 40) "]," SCENE "," MESH("") "}", QM_E_FORMAT,
         "sparse values of accessor 0 reaches past"},
        {"{" VIEWS ",\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\","
         "\"sparse\":{\"count\":1}}]," SCENE "," MESH("") "}",
         QM_E_FORMAT, "`sparse` must have"},
        {"{\"buffers\":[{}],\"bufferViews\":[{\"buffer\":0,\"byteOffset\":80,\"byteLength\":48}],"
         "\"accessors\":[" POSITIONS "]," SCENE "," MESH("") "}",
         QM_E_FORMAT, "past the binary part"},
        {"{\"buffers\":[{\"uri\":\"a.bin\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
         "\"accessors\":[" POSITIONS "]," SCENE "," MESH("") "}",
         QM_E_UNSUPPORTED, "another file (a.bin)"},
        {"{\"buffers\":[{}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48,\"byteStride\":4}],"
         "\"accessors\":[" POSITIONS "]," SCENE "," MESH("") "}",
         QM_E_FORMAT, "room for 0"},
        {"{" VIEWS "," ACCESSORS "," MESH(",\"indices\":1") ",\"scenes\":[{\"nodes\":[0]}],"
                                                            "\"nodes\":[{\"mesh\":0,\"scale\":[1e308,1e308,1]"
                                                            ",\"translation\":[1e308,1e308,0]}]}",
         QM_E_NOT_FINITE, "not a finite"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        qm_decoded decoded = decode_square(cases[i].json);
        QM_CHECK(decoded.status == cases[i].status && strstr(decoded.report.detail, cases[i].words),
                 "case %zu: %s: %s", i, qm_status_code(decoded.status), decoded.report.detail);
        assert_true(decoded.report.offset != QM_NO_LOCATION);
    }
}

/** A square twice, one of them mirrored, whose positions and indices are the Draco data part. */
static qm_decoded decode_draco_twice(const qm_bytes *part)
{
    char json[1024];
    qm_bytes file;
    snprintf(json, sizeof json,
             "{\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"buffers\":[{\"byteLength\":%zu}],"
             "\"bufferViews\":[{\"buffer\":0,\"byteLength\":%zu}],"
             "\"accessors\":[{\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}],"
             "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"extensions\":{"
             "\"KHR_draco_mesh_compression\":{\"bufferView\":0,\"attributes\":{\"POSITION\":0}}}}]}],"
             "\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"scale\":[-2,2,2],\"translation\":[0,0,5]}]}",
             part->size, part->size);
    add_file(&file, json, part);
    return qm_decode(QM_FORMAT_GLB, file.data, file.size);
}

static void draco_primitives_are_decoded_once_for_all_nodes(void **state)
{
    (void)state;
    static const uint32_t faces[2][4] = {{0, 1, 2, 3}, {3, 2, 4, NONE}};
    static const double positions[5][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 2, 0}};
    qm_mesh mesh = qm_shape_make(5, 2);
    memcpy(mesh.positions, positions, sizeof positions);
    memcpy(mesh.faces, faces, sizeof faces);
    qm_bytes part = {.size = 0};
    qm_encoded_bytes(&mesh, QM_FORMAT_DRC, &part);
    qm_decoded decoded = decode_draco_twice(&part);
    QM_CHECK(decoded.status == QM_OK, "%s", decoded.report.detail);
    assert_int_equal(decoded.mesh.vertex_count, 10);
    assert_int_equal(decoded.mesh.face_count, 4);
    size_t quads = 0;
    for (size_t f = 0; f < 4; ++f) {
        const uint32_t *face = decoded.mesh.faces + 4 * f;
        quads += face[3] != NONE;
        /* The mirrored one turns as the other does: both face up. */
        const double *a = decoded.mesh.positions + 3 * face[0], *b = decoded.mesh.positions + 3 * face[1],
                     *c = decoded.mesh.positions + 3 * face[2];
        double up = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        QM_CHECK(up > 0 && a[2] == (f < 2 ? 0.0 : 5.0), "face %zu: area %g, z %g", f, up, a[2]);
    }
    assert_int_equal(quads, 2);
    qm_decoded_free(&decoded);
    part.size -= 3;
    decoded = decode_draco_twice(&part);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_non_null(strstr(decoded.report.detail, "buffer view 0: the Draco data is invalid or truncated"));
    qm_decoded_free(&decoded);
    qm_shape_free(&mesh);
}

static void triangles_that_fan_out_are_polygons_where_the_file_says_so(void **state)
{
    (void)state;
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, -1, 1, 0, -1, 0, 0};
    /* A quad, a pentagon from another corner, and a triangle that has the pentagon's first corner in another place. */
    static const uint8_t indices[18] = {0, 1, 2, 0, 2, 3, 3, 4, 5, 3, 5, 0, 3, 0, 1, 1, 2, 3};
    qm_bytes part = {.size = 0}, file;
    qm_bytes_add_floats(&part, positions, 18);
    qm_bytes_add(&part, indices, 18);
    for (int mirrored = 0; mirrored < 2; ++mirrored) {
        char json[1024];
        snprintf(json, sizeof json,
                 "{\"buffers\":[{\"byteLength\":90}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":72},"
                 "{\"buffer\":0,\"byteOffset\":72,\"byteLength\":18}],\"accessors\":["
                 "{\"bufferView\":0,\"componentType\":5126,\"count\":6,\"type\":\"VEC3\"},"
                 "{\"bufferView\":1,\"componentType\":5121,\"count\":18,\"type\":\"SCALAR\"}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,"
                 "\"extensions\":{\"FB_ngon_encoding\":{}}}]}],\"nodes\":[{\"mesh\":0,\"scale\":[1,1,%d]}]}",
                 mirrored ? -1 : 1);
        add_file(&file, json, &part);
        qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
        QM_CHECK(decoded.status == QM_OK, "%s", decoded.report.detail);
        static const uint32_t faces[2][5][4] = {
            {{0, 1, 2, 3}, {3, 4, 5, NONE}, {3, 5, 0, NONE}, {3, 0, 1, NONE}, {1, 2, 3, NONE}},
            {{0, 3, 2, 1}, {3, 1, 0, NONE}, {3, 0, 5, NONE}, {3, 5, 4, NONE}, {1, 3, 2, NONE}}};
        assert_int_equal(decoded.mesh.face_count, 5);
        assert_memory_equal(decoded.mesh.faces, faces[mirrored], sizeof faces[mirrored]);
        assert_non_null(decoded.mesh.face_origin);
        assert_int_equal(decoded.mesh.face_origin[1], decoded.mesh.face_origin[3]);
        qm_decoded_free(&decoded);
    }
}

/** Quads come back as quads, and no face begins at the corner where the face before it does. */
static void quads_come_back_from_a_file(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 7);
    for (int k = 0; k < 50; ++k) {
        enum { FACES = 12 };
        qm_mesh mesh = qm_shape_soup(&random, FACES, QM_SOUP_MIXED, QM_SOUP_POOLED, 1);
        qm_bytes file = {.size = 0};
        qm_encoded_bytes(&mesh, QM_FORMAT_GLB, &file);
        qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
        QM_CHECK(decoded.status == QM_OK, "%d: %s", k, decoded.report.detail);
        QM_CHECK(decoded.mesh.face_count == FACES, "%d: %zu faces", k, decoded.mesh.face_count);
        for (size_t f = 0; f < FACES; ++f) {
            const uint32_t *is = decoded.mesh.faces + 4 * f, *was = mesh.faces + 4 * f;
            uint32_t count = was[3] == NONE ? 3 : 4, shift = 0;
            for (uint32_t i = 0; i < count; ++i)
                if (is[i] == was[0]) shift = i;
            bool is_equal = true;
            for (uint32_t i = 0; i < count; ++i)
                is_equal &= is[(i + shift) % count] == was[i];
            QM_CHECK(is_equal && (is[3] == NONE) == (count == 3) && (count == 3 || shift % 2 == 0),
                     "%d: face %zu is %u %u %u %u, was %u %u %u %u", k, f, is[0], is[1], is[2], is[3], was[0],
                     was[1], was[2], was[3]);
        }
        qm_decoded_free(&decoded);
        qm_shape_free(&mesh);
    }
}

/** Positions and triangles as the library encodes them. */
static void encoded_views_are_decoded(void **state)
{
    (void)state;
    size_t (*encode_vertices)(unsigned char *, size_t, const void *, size_t, size_t) = NULL;
    size_t (*encode_indices)(unsigned char *, size_t, const unsigned *, size_t) = NULL;
    void *library = dlopen("libmeshoptimizer.so.2d", RTLD_NOW), *symbol;
    assert_non_null(library);
    symbol = dlsym(library, "meshopt_encodeVertexBuffer");
    memcpy(&encode_vertices, &symbol, sizeof symbol);
    symbol = dlsym(library, "meshopt_encodeIndexBuffer");
    memcpy(&encode_indices, &symbol, sizeof symbol);
    enum { SIDE = 6, VERTICES = SIDE * SIDE, INDICES = 6 * (SIDE - 1) * (SIDE - 1) };
    float positions[3 * VERTICES];
    unsigned indices[INDICES];
    size_t used = 0;
    for (unsigned v = 0; v < VERTICES; ++v) {
        const float p[3] = {(float)(v % SIDE), (float)(v / SIDE), 0.25f * (float)(v % 5)};
        memcpy(positions + 3 * (size_t)v, p, sizeof p);
        if (v % SIDE + 1 == SIDE || v / SIDE + 1 == SIDE) continue;
        const unsigned square[6] = {v, v + 1, v + SIDE + 1, v, v + SIDE + 1, v + SIDE};
        memcpy(indices + used, square, sizeof square);
        used += 6;
    }
    qm_bytes part = {.size = 0}, file;
    size_t first = encode_vertices(part.data, sizeof part.data, positions, VERTICES, 3 * sizeof *positions);
    size_t second = encode_indices(part.data + first, sizeof part.data - first, indices, INDICES);
    assert_true(first > 0 && second > 0);
    part.size = first + second;
    char json[2048];
    snprintf(
        json, sizeof json,
        "{\"extensionsRequired\":[\"EXT_meshopt_compression\"],\"buffers\":[{\"byteLength\":%zu},{"
        "\"byteLength\":900}],\"bufferViews\":[{\"buffer\":1,\"byteLength\":432,\"byteStride\":12,"
        "\"extensions\":{\"EXT_meshopt_compression\":{\"buffer\":0,\"byteLength\":%zu,\"byteStride\":12,"
        "\"count\":%d,\"mode\":\"ATTRIBUTES\"}}},"
        "{\"buffer\":1,\"byteOffset\":432,\"byteLength\":600,"
        "\"extensions\":{\"KHR_meshopt_compression\":{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,"
        "\"byteStride\":4,\"count\":%d,\"mode\":\"TRIANGLES\",\"filter\":\"NONE\"}}}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":%d,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":%d,\"type\":\"SCALAR\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}]}",
        part.size, first, (int)VERTICES, first, second, (int)INDICES, (int)VERTICES, (int)INDICES);
    add_file(&file, json, &part);
    qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
    QM_CHECK(decoded.status == QM_OK, "%s", decoded.report.detail);
    assert_int_equal(decoded.mesh.vertex_count, VERTICES);
    assert_int_equal(decoded.mesh.face_count, INDICES / 3);
    for (size_t i = 0; i < 3 * VERTICES; ++i)
        assert_true(decoded.mesh.positions[i] == (double)positions[i]);
    qm_decoded_free(&decoded);
    dlclose(library);
}

static void indices_past_their_vertices_are_refused(void **state)
{
    (void)state;
    qm_bytes file, part = {.size = 0};
    add_square(&part);
    part.data[48 + 5] = 4;
    add_file(&file, "{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":1") "}", &part);
    qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
    assert_int_equal(decoded.status, QM_E_INDEX);
    assert_non_null(strstr(decoded.report.detail, "vertex 4, but its primitive has 4"));
    assert_int_equal(decoded.report.offset, file.size - part.size + 48 + 5);
}

#define MANY 3000 /* positions and triangles: more than the decoder takes together */

/** The binary part of a mesh with many elements, its triangles as ints and as shorts. */
typedef struct many_elements {
    float positions[MANY][3];
    uint32_t ints[MANY][3];
    uint16_t shorts[MANY][3];
} many_elements;

/** Decodes the triangles of the accessor; *part_offset becomes the offset of the part. */
static qm_decoded decode_many(const many_elements *part, int accessor, size_t *part_offset)
{
    char json[1024];
    snprintf(
        json, sizeof json,
        "{\"buffers\":[{\"byteLength\":%zu}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":%zu},"
        "{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu},{\"buffer\":0,\"byteOffset\":%zu,"
        "\"byteLength\":%zu}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":%d,\"type\":"
        "\"VEC3\"},{\"bufferView\":1,\"componentType\":5125,\"count\":%d,\"type\":\"SCALAR\"},{"
        "\"bufferView\":2,"
        "\"componentType\":5123,\"count\":%d,\"type\":\"SCALAR\"}],\"scene\":0,\"scenes\":[{\"nodes\":[0,1]}]"
        ","
        "\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"scale\":[-1,2,1],\"translation\":[1,0,3]}]," MESH(
            ",\"indices\":%d") "}",
        sizeof *part, sizeof part->positions, offsetof(many_elements, ints), sizeof part->ints,
        offsetof(many_elements, shorts), sizeof part->shorts, MANY, 3 * MANY, 3 * MANY, accessor);
    qm_bytes head;
    add_file(&head, json, &(qm_bytes){.size = 0});
    *part_offset = head.size;
    uint8_t *file = malloc(head.size + sizeof *part);
    memcpy(file, head.data, head.size);
    memcpy(file + head.size, part, sizeof *part);
    const uint32_t sizes[2] = {(uint32_t)(head.size + sizeof *part), (uint32_t)sizeof *part};
    memcpy(file + 8, &sizes[0], sizeof sizes[0]);
    memcpy(file + head.size - 8, &sizes[1], sizeof sizes[1]);
    qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file, head.size + sizeof *part);
    free(file);
    return decoded;
}

static void many_elements_are_read_like_few(void **state)
{
    (void)state;
    static many_elements part;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (uint32_t i = 0; i < MANY; i++) {
        for (uint32_t k = 0; k < 3; k++) {
            part.positions[i][k] = (float)qm_random_below(&random, 1000) - 500.0f;
            part.ints[i][k] = (i + k * (1 + i % 7)) % MANY;
            part.shorts[i][k] = (uint16_t)part.ints[i][k];
        }
    }
    size_t start;
    qm_decoded ints = decode_many(&part, 1, &start), shorts = decode_many(&part, 2, &start);
    QM_CHECK(ints.status == QM_OK && shorts.status == QM_OK, "%s; %s", ints.report.detail,
             shorts.report.detail);
    assert_int_equal(ints.mesh.vertex_count, 2 * MANY);
    assert_int_equal(ints.mesh.face_count, 2 * MANY);
    assert_int_equal(shorts.mesh.face_count, 2 * MANY);
    assert_memory_equal(ints.mesh.faces, shorts.mesh.faces, 2 * MANY * 4 * sizeof *ints.mesh.faces);
    for (uint32_t i = 0; i < MANY; i++) {
        const float *p = part.positions[i];
        const double *first = ints.mesh.positions + 3 * (size_t)i, *second = first + 3 * MANY;
        assert_true(first[0] == p[0] && first[1] == p[1] && first[2] == p[2]);
        assert_true(second[0] == 1.0 - p[0] && second[1] == 2.0 * p[1] && second[2] == p[2] + 3.0);
    }
    qm_decoded_free(&ints);
    qm_decoded_free(&shorts);

    part.ints[2500][1] = MANY;
    ints = decode_many(&part, 1, &start);
    assert_int_equal(ints.status, QM_E_INDEX);
    assert_int_equal(ints.report.offset, start + offsetof(many_elements, ints[2500][1]));
    qm_decoded_free(&ints);
    part.ints[2500][1] = 0;
    part.positions[2500][1] = NAN;
    ints = decode_many(&part, 1, &start);
    assert_int_equal(ints.status, QM_E_NOT_FINITE);
    assert_int_equal(ints.report.offset, start + offsetof(many_elements, positions[2500]));
    qm_decoded_free(&ints);
}

static void broken_chunks_name_their_byte(void **state)
{
    (void)state;
    qm_bytes file, part = {.size = 0};
    add_square(&part);
    add_file(&file, "{}", &part);
    static const struct {
        size_t at;
        uint8_t value;
        qm_status status;
        size_t place;
    } cases[] = {{0, 'G', QM_E_FORMAT, 0},    {4, 1, QM_E_UNSUPPORTED, 4}, {8, 255, QM_E_FORMAT, 8},
                 {8, 21, QM_E_FORMAT, 12},    {8, 25, QM_E_FORMAT, 22},    {12, 255, QM_E_FORMAT, 12},
                 {16, 'X', QM_E_FORMAT, 122}, {22, 255, QM_E_FORMAT, 22}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        uint8_t kept = file.data[cases[i].at];
        file.data[cases[i].at] = cases[i].value;
        qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
        QM_CHECK(decoded.status == cases[i].status && decoded.report.offset == cases[i].place,
                 "case %zu: %zu: %s", i, decoded.report.offset, decoded.report.detail);
        file.data[cases[i].at] = kept;
    }
}

static void bytes_after_the_end_are_reported(void **state)
{
    (void)state;
    qm_bytes file, part = {.size = 0};
    add_square(&part);
    add_file(&file, "{" VIEWS "," ACCESSORS "," SCENE "," MESH(",\"indices\":1") "}", &part);
    qm_bytes_add(&file, "more", 4);
    qm_decoded decoded = qm_decode(QM_FORMAT_GLB, file.data, file.size);
    assert_int_equal(decoded.status, QM_OK);
    assert_true(qm_decoded_warns(&decoded, "end of the file: 4"));
    qm_decoded_free(&decoded);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(indices_come_in_three_widths_or_not_at_all),
        cmocka_unit_test(strips_turn_every_second_triangle),
        cmocka_unit_test(sparse_accessors_replace_elements),
        cmocka_unit_test(files_without_a_scene_are_taken_whole),
        cmocka_unit_test(integers_stand_for_positions),
        cmocka_unit_test(the_text_form_has_its_bytes_in_base64),
        cmocka_unit_test(nodes_place_their_meshes),
        cmocka_unit_test(shared_positions_are_added_once_a_mesh),
        cmocka_unit_test(strides_step_over_other_attributes),
        cmocka_unit_test(draco_primitives_are_decoded_once_for_all_nodes),
        cmocka_unit_test(triangles_that_fan_out_are_polygons_where_the_file_says_so),
        cmocka_unit_test(quads_come_back_from_a_file),
        cmocka_unit_test(encoded_views_are_decoded),
        cmocka_unit_test(json_faults_are_refused),
        cmocka_unit_test(indices_past_their_vertices_are_refused),
        cmocka_unit_test(many_elements_are_read_like_few),
        cmocka_unit_test(broken_chunks_name_their_byte),
        cmocka_unit_test(bytes_after_the_end_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
