/**
 * handle_content.c: GET /v1/meshes/{id}/content: the mesh back, in any format, a block at a time.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json_write.h"
#include "format/encode.h"
#include "handlers.h"

/** What is sent. The context is the encoder's and lives as long. */
typedef struct sending {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_context ctx;
    qm_encoder *encoder;
} sending;

static void end_sending(void *user)
{
    sending *s = user;
    qm_encoder_destroy(s->encoder);
    qm_meshes_release(s->meshes, s->mesh);
    free(s);
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    (void)problem; /* the encoder only runs out of memory, which out tells */
    return qm_encoder_next(((sending *)user)->encoder, out) ? QM_BLOCK_MORE : QM_BLOCK_LAST;
}

/** ?format=, else what Accept likes best. */
static bool read_format(qm_request *request, qm_format *format)
{
    const char *named = qm_request_query(request, "format");
    *format = named ? qm_format_from_name(named) : qm_format_from_media_type(qm_request_media(request));
    if (*format != QM_FORMAT_UNKNOWN) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "format is " QM_FORMAT_NAMES);
    qm_reply_problem(request, &problem);
    return false;
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
    qm_problem problem = is_number
                             ? qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "only drc has a quantization")
                             : qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                               "quantization is a whole number of bits from 0 (none) to %d",
                                               QM_ENCODE_MAX_BITS);
    qm_reply_problem(request, &problem);
    return false;
}

static void add_headers(qm_request *request, const sending *s, qm_format format, int bits)
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
static sending *begin(qm_meshes *meshes, qm_mesh_ref *ref, qm_format format, int bits, qm_problem *problem)
{
    sending *s = calloc(1, sizeof *s);
    if (!s) {
        qm_meshes_release(meshes, ref);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reply");
        return NULL;
    }
    *s = (sending){.meshes = meshes, .mesh = ref, .ctx = qm_context_make()};
    const qm_loaded_mesh *mesh = qm_mesh_ref_get(ref);
    qm_status status = qm_encoder_create(&s->ctx, &mesh->mesh, &mesh->facts, format, bits, &s->encoder);
    if (status == QM_OK) return s;
    *problem = qm_problem_from_status(status, s->ctx.message);
    end_sending(s);
    return NULL;
}

void qm_handle_mesh_content(qm_request *request)
{
    qm_format format;
    int bits;
    qm_problem problem;
    if (!read_format(request, &format) || !read_bits(request, format, &bits)) return;
    char suffix[32];
    snprintf(suffix, sizeof suffix, "-%s-%d", qm_format_name(format), bits);
    qm_mesh_ref *mesh = qm_take_mesh(request, suffix);
    if (!mesh) return;
    sending *s = begin(qm_request_app(request)->meshes, mesh, format, bits, &problem);
    if (!s) {
        qm_reply_problem(request, &problem);
        return;
    }
    add_headers(request, s, format, bits);
    uint64_t size;
    if (!qm_encoder_size(s->encoder, &size)) size = QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_format_media_type(format), size,
                    (qm_block_source){next_block, end_sending, s});
}
