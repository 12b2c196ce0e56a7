/**
 * encode_drc.c: Draco. Its meshes are triangles; the edges that cut a quad or polygon are marked in an
 * attribute "added_edges", as the library's own tools do, so that they and codec_drc.c find the faces again.
 *
 * The shorter of its two methods drops degenerate faces and vertices without a face and splits vertices where
 * the surface is not a manifold, so it is for manifolds without such. A cut that other faces have as an edge
 * is beyond such marks: a reader finds the triangles there.
 */
#include <float.h>

#include "codec_draco.h"
#include "encode_internal.h"

typedef struct drc_arrays {
    float *positions;
    uint32_t *triangles;
    uint8_t *added;
} drc_arrays;

static size_t corner_count(const qm_encoder *encoder)
{
    return 3 * encoder->triangles;
}

static bool make_arrays(const qm_encoder *encoder, drc_arrays *arrays)
{
    size_t vertex_count = encoder->mesh->vertex_count, corners = corner_count(encoder);
    arrays->positions = qm_context_alloc(encoder->ctx, vertex_count, 3 * sizeof(float));
    if (corners > 0) arrays->triangles = qm_context_alloc(encoder->ctx, corners, sizeof(uint32_t));
    bool is_cut = encoder->triangles > encoder->input_faces;
    if (is_cut) arrays->added = qm_context_alloc(encoder->ctx, corners, 1);
    return arrays->positions && (arrays->triangles || corners == 0) && (arrays->added || !is_cut);
}

static void free_arrays(const qm_encoder *encoder, const drc_arrays *arrays)
{
    size_t corners = corner_count(encoder);
    qm_context_free(encoder->ctx, arrays->positions, encoder->mesh->vertex_count, 3 * sizeof(float));
    qm_context_free(encoder->ctx, arrays->triangles, corners, sizeof(uint32_t));
    qm_context_free(encoder->ctx, arrays->added, corners, 1);
}

/** Adds the fan of a face. Of its triangle (c0, ci, ci+1) the sides at c0 are cuts, but for the first and the
 * last. */
static void fill_face(const qm_mesh *mesh, uint32_t first, uint32_t end, const drc_arrays *arrays,
                      size_t *filled)
{
    size_t corners = qm_encode_corner_count(mesh, first, end);
    for (size_t i = 1; i + 1 < corners; i++, *filled += 3) {
        arrays->triangles[*filled] = qm_encode_corner(mesh, first, 0);
        arrays->triangles[*filled + 1] = qm_encode_corner(mesh, first, i);
        arrays->triangles[*filled + 2] = qm_encode_corner(mesh, first, i + 1);
        if (!arrays->added) continue;
        arrays->added[*filled] = 0;
        arrays->added[*filled + 1] = i + 2 < corners;
        arrays->added[*filled + 2] = i > 1;
    }
}

static void fill_arrays(const qm_mesh *mesh, const drc_arrays *arrays)
{
    size_t filled = 0;
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        arrays->positions[i] = (float)mesh->positions[i];
    for (uint32_t face = 0, end; face < mesh->face_count; face = end) {
        end = qm_encode_face_end(mesh, face);
        fill_face(mesh, face, end, arrays, &filled);
    }
}

static bool take_file(void *user, const char *bytes, size_t size)
{
    qm_text *whole = user;
    qm_text_add(whole, bytes, size);
    return !whole->failed;
}

static qm_status run_library(qm_encoder *encoder, const drc_arrays *arrays)
{
    const qm_mesh_facts *facts = encoder->facts;
    qm_draco_input input = {.positions = arrays->positions,
                            .vertex_count = encoder->mesh->vertex_count,
                            .triangles = arrays->triangles,
                            .triangle_count = encoder->triangles,
                            .added = arrays->added,
                            .quantization_bits = encoder->bits,
                            .keeps_all = !facts->manifold || facts->repeated_corner_faces > 0 ||
                                         facts->unused_vertices > 0};
    double displacement;
    qm_draco_outcome outcome = qm_draco_encode(&input, take_file, &encoder->file, &displacement);
    if (outcome == QM_DRACO_NO_MEMORY) return QM_E_NO_MEMORY;
    if (outcome != QM_DRACO_DONE)
        return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED, "the mesh cannot be written as Draco");
    /* Rounded to single precision, then quantised: the displacements add up at most. */
    encoder->losses.displacement = (encoder->losses.displacement + displacement) * (1.0 + 8.0 * DBL_EPSILON);
    encoder->size = encoder->file.size;
    return QM_OK;
}

static qm_status prepare_drc(qm_encoder *encoder)
{
    qm_status status = qm_encode_round_to_floats(encoder);
    if (status != QM_OK) return status;
    drc_arrays arrays = {0};
    status = QM_E_NO_MEMORY;
    if (make_arrays(encoder, &arrays)) {
        fill_arrays(encoder->mesh, &arrays);
        status = run_library(encoder, &arrays);
    }
    free_arrays(encoder, &arrays);
    if (status == QM_E_NO_MEMORY) qm_context_fail(encoder->ctx, status, "out of memory for the file");
    return status;
}

static void add_whole(const qm_encoder *encoder, qm_text *out)
{
    qm_text_add(out, encoder->file.data, encoder->file.size);
}

const qm_encode_format qm_encode_drc = {prepare_drc, add_whole, NULL, NULL};
