#include "collide_faces.h"

/** The first face of the mesh that came from this face of the input, or from a later one. */
static uint32_t first_face(const qm_mesh *mesh, uint32_t input_face)
{
    if (!mesh->face_origin) return input_face;
    size_t low = 0, high = mesh->face_count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (mesh->face_origin[middle] < input_face)
            low = middle + 1;
        else
            high = middle;
    }
    return (uint32_t)low;
}

static bool is_of_face(const qm_mesh *mesh, uint32_t face, uint32_t input_face)
{
    size_t count = mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
    return face < count && qm_mesh_input_face(mesh, face) == input_face;
}

static bool find_contact(const qm_faces *faces, const qm_collide_options *options, qm_contact *out)
{
    if (options->quads == QM_QUADS_BILINEAR && qm_faces_have_quad(faces))
        return qm_faces_meet_bilinear(faces, options->tolerance, out);
    return qm_faces_find_contact(faces, out);
}

bool qm_faces_find_pair(qm_faces *faces, const qm_collide_options *options, qm_face_pair pair,
                        qm_contact *contact)
{
    const qm_mesh *a = faces->mesh[0], *b = faces->mesh[1];
    for (uint32_t i = first_face(a, pair.a); is_of_face(a, i, pair.a); i++) {
        for (uint32_t k = first_face(b, pair.b); is_of_face(b, k, pair.b); k++) {
            faces->face[0] = i;
            faces->face[1] = k;
            if (find_contact(faces, options, contact)) return true;
        }
    }
    return false;
}

bool qm_collide_contact(const qm_mesh *a, const qm_mesh *b, const qm_collide_options *options,
                        qm_face_pair pair, qm_contact *out)
{
    qm_faces faces = {.mesh = {a, b}, .is_self = a == b};
    return qm_faces_find_pair(&faces, options, pair, out);
}
