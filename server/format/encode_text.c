/**
 * encode_text.c: OBJ, OFF and XYZ. Numbers have the shortest decimals that read back to the same double.
 */
#include "base/json.h"
#include "encode_internal.h"

static void add_position(const qm_encoder *encoder, size_t vertex, const char *start, qm_text *out)
{
    char number[QM_NUMBER_SIZE];
    const double *p = encoder->mesh->positions + 3 * vertex;
    qm_text_add_string(out, start);
    for (int axis = 0; axis < 3; axis++) {
        qm_text_add_string(out, qm_text_number(p[axis], number));
        qm_text_add_string(out, axis < 2 ? " " : "\n");
    }
}

/** The corners, each after a blank; base is the index of the first vertex in the format. */
static void add_corners(const qm_encoder *encoder, uint32_t first, uint32_t end, uint32_t base, qm_text *out)
{
    size_t count = qm_encode_corner_count(encoder->mesh, first, end);
    for (size_t i = 0; i < count; i++)
        qm_text_printf(out, " %u", qm_encode_corner(encoder->mesh, first, i) + base);
    qm_text_add_string(out, "\n");
}

/* ---- OBJ ---- */

static void add_obj_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_printf(out, "# %zu vertices, %zu faces\n", encoder->mesh->vertex_count, encoder->input_faces);
}

static void add_obj_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    add_position(encoder, vertex, "v ", out);
}

static void add_obj_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    qm_text_add_string(out, "f");
    add_corners(encoder, first, end, 1, out);
}

const qm_encode_format qm_encode_obj = {NULL, add_obj_head, add_obj_vertex, add_obj_face};

/* ---- OFF ---- */

static void add_off_head(const qm_encoder *encoder, qm_text *out)
{
    qm_text_printf(out, "OFF\n%zu %zu 0\n", encoder->mesh->vertex_count, encoder->input_faces);
}

static void add_plain_vertex(const qm_encoder *encoder, size_t vertex, qm_text *out)
{
    add_position(encoder, vertex, "", out);
}

static void add_off_face(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    qm_text_printf(out, "%zu", qm_encode_corner_count(encoder->mesh, first, end));
    add_corners(encoder, first, end, 0, out);
}

const qm_encode_format qm_encode_off = {NULL, add_off_head, add_plain_vertex, add_off_face};

/* ---- XYZ ---- */

static qm_status prepare_xyz(qm_encoder *encoder)
{
    if (encoder->mesh->face_count == 0) return QM_OK;
    return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED, "xyz holds points only, and the mesh has faces");
}

static void add_xyz_head(const qm_encoder *encoder, qm_text *out)
{
    (void)encoder, (void)out;
}

const qm_encode_format qm_encode_xyz = {prepare_xyz, add_xyz_head, add_plain_vertex, NULL};
