/**
 * encoder.c: the table of encoders, and the loop over vertices and faces in blocks.
 */
#include "encoder_internal.h"

#include <float.h>
#include <math.h>

#include "base/json.h"

#define BLOCK_SIZE 100000 /* min bytes of a block */

static const qm_encoder_format *const formats[] = {
#define XX(number, suffix, name, media, magic) [QM_FORMAT_##suffix] = &qm_encoder_##name,
    QM_FORMAT_MAP(XX)
#undef XX
};

qm_status qm_encoder_round_to_floats(qm_encoder *encoder)
{
    const double *p = encoder->mesh->positions;
    double largest = 0.0;
    for (size_t i = 0; i < encoder->mesh->vertex_count; i++, p += 3) {
        double square = 0.0;
        for (int axis = 0; axis < 3; axis++) {
            if (!(fabs(p[axis]) <= (double)FLT_MAX))
                return qm_context_fail(
                    encoder->ctx, QM_E_SCALE,
                    "vertex %zu has a coordinate beyond single precision, the only one that "
                    "the format has",
                    i);
            double off = p[axis] - (double)(float)p[axis];
            square += off * off;
        }
        largest = fmax(largest, square);
    }
    /* The factor exceeds the four roundings of the sum and the root. */
    encoder->losses.displacement = sqrt(largest) * (1.0 + 4.0 * DBL_EPSILON);
    return QM_OK;
}

qm_status qm_encoder_create(qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                            qm_format format, int bits, const qm_uv_atlas *uv, qm_encoder **out)
{
    QM_ASSERT(format != QM_FORMAT_UNKNOWN && bits >= 0 && bits <= QM_ENCODE_MAX_BITS);
    qm_encoder *encoder = *out = qm_context_alloc(ctx, 1, sizeof *encoder);
    if (!encoder) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the file");
    *encoder = (qm_encoder){.ctx = ctx,
                            .mesh = mesh,
                            .facts = facts,
                            .format = formats[format],
                            .bits = bits,
                            .uv = uv,
                            .row_count = mesh->vertex_count,
                            .last_first = QM_NO_INDEX};
    for (uint32_t face = 0, end; face < mesh->face_count; face = end) {
        end = qm_encoder_face_end(mesh, face);
        size_t corners = qm_encoder_corner_count(mesh, face, end);
        encoder->input_faces++;
        encoder->triangles += corners - 2;
        if (corners > encoder->max_corners) encoder->max_corners = corners;
    }
    qm_status status = QM_OK;
    if (uv && !qm_encoder_holds_uv(format))
        status = qm_context_fail(ctx, QM_E_UNSUPPORTED, "only obj, ply and glb hold texture coordinates");
    if (status == QM_OK && encoder->format->prepare) status = encoder->format->prepare(encoder);
    if (status == QM_OK) return QM_OK;
    qm_encoder_destroy(encoder);
    *out = NULL;
    return status;
}

bool qm_encoder_holds_uv(qm_format format)
{
    return format != QM_FORMAT_UNKNOWN && formats[format]->has_uv;
}

void qm_encoder_destroy(qm_encoder *encoder)
{
    if (!encoder) return;
    qm_text_reset(&encoder->file);
    qm_context_free(encoder->ctx, encoder, 1, sizeof *encoder);
}

qm_encode_losses qm_encoder_losses(const qm_encoder *encoder)
{
    return encoder->losses;
}

bool qm_encoder_size(const qm_encoder *encoder, uint64_t *size)
{
    *size = encoder->size;
    return encoder->size > 0;
}

bool qm_encoder_next(qm_encoder *encoder, qm_text *out)
{
    const qm_encoder_format *format = encoder->format;
    const qm_mesh *mesh = encoder->mesh;
    size_t end = out->size + BLOCK_SIZE;
    if (!encoder->has_head) format->add_head(encoder, out);
    encoder->has_head = true;
    for (; format->add_vertex && encoder->vertex < encoder->row_count && out->size < end && !out->failed;
         encoder->vertex++)
        format->add_vertex(encoder, encoder->vertex, out);
    while (format->add_face && encoder->face < mesh->face_count && out->size < end && !out->failed) {
        uint32_t first = (uint32_t)encoder->face, last = qm_encoder_face_end(mesh, first);
        format->add_face(encoder, first, last, out);
        encoder->face = last;
    }
    bool has_vertices = format->add_vertex && encoder->vertex < encoder->row_count;
    bool has_faces = format->add_face && encoder->face < mesh->face_count;
    return (has_vertices || has_faces) && !out->failed;
}

/* ---- what several formats share ---- */

void qm_encoder_add_position(const qm_encoder *encoder, size_t vertex, const char *start, qm_text *out)
{
    char number[QM_NUMBER_SIZE];
    const double *p = encoder->mesh->positions + 3 * vertex;
    qm_text_add_string(out, start);
    for (int axis = 0; axis < 3; axis++) {
        qm_text_add_string(out, qm_text_number(p[axis], number));
        qm_text_add_string(out, axis < 2 ? " " : "\n");
    }
}

void qm_encoder_add_corners(const qm_encoder *encoder, uint32_t first, uint32_t end, uint32_t base,
                            qm_text *out)
{
    size_t count = qm_encoder_corner_count(encoder->mesh, first, end);
    for (size_t i = 0; i < count; i++)
        qm_text_printf(out, " %u", qm_encoder_corner(encoder->mesh, first, i) + base);
    qm_text_add_string(out, "\n");
}

void qm_encoder_add_vertex_row(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    qm_encoder_add_position(encoder, vertex, "", out);
}

void qm_encoder_take_apart(qm_encoder *encoder)
{
    if (!encoder->uv) return;
    encoder->mesh = &encoder->uv->mesh;
    encoder->row_count = encoder->mesh->vertex_count;
    encoder->losses.left_out_vertices = encoder->facts->unused_vertices;
}

qm_status qm_encoder_fail_size(const qm_encoder *encoder)
{
    return qm_context_fail(encoder->ctx, QM_E_TOO_LARGE, "the mesh exceeds the counts of the format");
}
