/**
 * handle_content.c: what a mesh consists of, block by block: the file in any format (GET .../content), the
 * positions of its vertices in the order that results and PATCH count them in (GET .../vertices), and its
 * regular patches (GET .../patches).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "format/encoder.h"
#include "handlers.h"
#include "ops/patches_out.h"

#define VERTICES_BLOCK 8192 /* vertices */

/* ---- content ---- */

/** What is sent. The context is the encoder's and lives as long. */
typedef struct content_reply {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_context ctx;
    qm_uv_atlas atlas; /* all zero without texture coordinates */
    qm_encoder *encoder;
} content_reply;

static void end_content_reply(void *user)
{
    content_reply *s = user;
    qm_encoder_destroy(s->encoder);
    qm_uv_atlas_reset(&s->ctx, &s->atlas);
    qm_meshes_release(s->meshes, s->mesh);
    free(s);
}

static qm_block next_content(void *user, qm_text *out, qm_problem *problem)
{
    (void)problem; /* the encoder only runs out of memory, which out remembers */
    return qm_encoder_next(((content_reply *)user)->encoder, out) ? QM_BLOCK_MORE : QM_BLOCK_LAST;
}

/** ?format=, else what Accept likes best. */
static bool read_format(qm_request *request, qm_format *format)
{
    if (!qm_handlers_read_format(request, format)) return false;
    if (*format == QM_FORMAT_UNKNOWN) *format = qm_format_from_media_type(qm_request_media(request));
    QM_ASSERT(*format != QM_FORMAT_UNKNOWN);
    return true;
}

static bool read_bits(qm_request *request, qm_format format, int *bits)
{
    const char *given = qm_request_query(request, "quantization");
    char *end;
    long value = given ? strtol(given, &end, 10) : 0;
    *bits = (int)value;
    if (!given) return true;
    bool is_number = end != given && !*end && value >= 0 && value <= QM_ENCODE_MAX_BITS;
    if (is_number && (value == 0 || format == QM_FORMAT_DRC)) return true;
    qm_problem problem =
        is_number
            ? qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`quantization` is only valid for the format drc")
            : qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                              "`quantization` must be an integer from 0 (none) to %d", QM_ENCODE_MAX_BITS);
    qm_reply_problem(request, &problem);
    return false;
}

/** ?uv=patches; false after a refusal. */
static bool read_uv(qm_request *request, qm_format format, bool *has_uv)
{
    const char *given = qm_request_query(request, "uv");
    bool is_known = given && strcmp(given, "patches") == 0;
    *has_uv = is_known;
    if (!given || (is_known && qm_encoder_holds_uv(format))) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "%s",
                                         is_known ? "`uv` is only valid for the formats obj, ply and glb"
                                                  : "`uv` must be \"patches\"");
    qm_reply_problem(request, &problem);
    return false;
}

static void add_headers(qm_request *request, const content_reply *s, qm_format format, int bits)
{
    char number[QM_NUMBER_SIZE];
    qm_encode_losses losses = qm_encoder_losses(s->encoder);
    qm_reply_header(request, "Content-Disposition", "attachment; filename=\"%s.%s\"", qm_request_id(request),
                    qm_format_name(format));
    qm_reply_header(request, "Mesh-Displacement", "%s", qm_text_number(losses.displacement, number));
    if (bits > 0) qm_reply_header(request, "Mesh-Quantization", "%d", bits);
    if (losses.cut_faces > 0) qm_reply_header(request, "Mesh-Cut-Faces", "%zu", losses.cut_faces);
    if (losses.left_out_vertices > 0)
        qm_reply_header(request, "Mesh-Left-Out-Vertices", "%zu", losses.left_out_vertices);
}

/** Takes over the reference; NULL with a problem. */
static content_reply *begin_content(qm_meshes *meshes, qm_mesh_ref *ref, qm_format format, int bits,
                                    bool has_uv, qm_problem *problem)
{
    content_reply *s = calloc(1, sizeof *s);
    if (!s) {
        qm_meshes_release(meshes, ref);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
        return NULL;
    }
    *s = (content_reply){.meshes = meshes, .mesh = ref, .ctx = qm_context_make()};
    const qm_loaded_mesh *mesh = qm_mesh_ref_get(ref);
    qm_status status = QM_OK;
    if (has_uv) {
        s->ctx = qm_meshes_context(meshes); /* the copy of the mesh is within the budget */
        status = qm_uv_atlas_make(&s->ctx, &mesh->mesh, &mesh->patches, &s->atlas);
    }
    if (status == QM_OK)
        status = qm_encoder_create(&s->ctx, &mesh->mesh, &mesh->facts, format, bits,
                                   has_uv ? &s->atlas : NULL, &s->encoder);
    if (status == QM_OK) return s;
    *problem = qm_problem_from_status(status, s->ctx.message);
    end_content_reply(s);
    return NULL;
}

void qm_handle_mesh_content(qm_request *request)
{
    qm_format format;
    int bits;
    bool has_uv;
    qm_problem problem;
    if (!read_format(request, &format) || !read_bits(request, format, &bits) ||
        !read_uv(request, format, &has_uv))
        return;
    char suffix[32];
    snprintf(suffix, sizeof suffix, "-%s-%d%s", qm_format_name(format), bits, has_uv ? "-uv" : "");
    qm_mesh_ref *mesh = qm_handlers_take_mesh(request, suffix);
    if (!mesh) return;
    content_reply *s = begin_content(qm_request_app(request)->meshes, mesh, format, bits, has_uv, &problem);
    if (!s) {
        qm_reply_problem(request, &problem);
        return;
    }
    add_headers(request, s, format, bits);
    uint64_t size;
    if (!qm_encoder_size(s->encoder, &size)) size = QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_format_media_type(format), size,
                    (qm_block_source){next_content, end_content_reply, s});
}

/* ---- vertices ---- */

typedef struct vertices_reply {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_array_format rows;
    size_t done; /* vertices */
} vertices_reply;

static void end_vertices_reply(void *user)
{
    vertices_reply *s = user;
    qm_meshes_release(s->meshes, s->mesh);
    free(s);
}

static qm_block next_vertices(void *user, qm_text *out, qm_problem *problem)
{
    (void)problem; /* only memory can run out, which out remembers */
    static const char *const starts[] = {"", "x,y,z\n", "{\"positions\":["};
    vertices_reply *s = user;
    const qm_mesh *mesh = &qm_mesh_ref_get(s->mesh)->mesh;
    double numbers[3 * VERTICES_BLOCK];
    size_t rest = mesh->vertex_count - s->done, count = rest < VERTICES_BLOCK ? rest : VERTICES_BLOCK;
    if (s->done == 0) qm_text_add_string(out, starts[s->rows]);
    memcpy(numbers, mesh->positions + 3 * s->done, 3 * count * sizeof *numbers);
    qm_text_add_array(out, s->rows, 3, s->done, numbers, 3 * count);
    s->done += count;
    if (s->done < mesh->vertex_count) return QM_BLOCK_MORE;
    if (s->rows == QM_ARRAY_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

void qm_handle_mesh_vertices(qm_request *request)
{
    static const char *const suffixes[] = {"-vertices-f64", "-vertices-csv", "-vertices-json"};
    qm_meshes *meshes = qm_request_app(request)->meshes;
    qm_array_format rows = qm_request_rows(request);
    qm_mesh_ref *mesh = qm_handlers_take_mesh(request, suffixes[rows]);
    if (!mesh) return;
    vertices_reply *s = malloc(sizeof *s);
    if (!s) {
        qm_meshes_release(meshes, mesh);
        qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
        qm_reply_problem(request, &problem);
        return;
    }
    *s = (vertices_reply){.meshes = meshes, .mesh = mesh, .rows = rows};
    size_t count = qm_mesh_ref_get(mesh)->mesh.vertex_count;
    uint64_t size = rows == QM_ARRAY_BINARY ? 3 * sizeof(double) * count : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_vertices, end_vertices_reply, s});
}

/* ---- patches ---- */

static char *write_patches(const qm_loaded_mesh *mesh)
{
    qm_text out = {0};
    qm_patches_write_json(&out, mesh);
    return qm_text_take(&out);
}

void qm_handle_mesh_patches(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_mesh_ref *mesh = qm_handlers_take_mesh(request, "-patches");
    if (!mesh) return;
    char *document = write_patches(qm_mesh_ref_get(mesh));
    qm_meshes_release(app->meshes, mesh);
    qm_reply_text(request, 200, "application/json", document);
}
