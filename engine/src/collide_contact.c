#include "qm/collide.h"
#include "tri_tri.h"

/** The triangles of a face: one or two. */
typedef struct face_triangles {
    int count;
    qm_vec corner[2][3];
} face_triangles;

static face_triangles load_face(const qm_mesh *mesh, uint32_t face)
{
    face_triangles f = {.count = 1};
    qm_vec corner[4];
    if (mesh->face_count == 0) {
        qm_vec point = qm_vec_load(mesh->positions + 3 * (size_t)face);
        f.corner[0][0] = f.corner[0][1] = f.corner[0][2] = point;
        return f;
    }
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    f.count = index[3] == QM_NO_INDEX ? 1 : 2;
    for (int i = 0; i < f.count + 2; i++)
        corner[i] = qm_vec_load(mesh->positions + 3 * (size_t)index[i]);
    for (int t = 0; t < f.count; t++) {
        f.corner[t][0] = corner[0];
        f.corner[t][1] = corner[t + 1];
        f.corner[t][2] = corner[t + 2];
    }
    return f;
}

/** Faces of the mesh that came from a face of the input: from the first one found to before end. */
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

static double contact_length(const qm_contact *contact)
{
    return qm_vec_distance(qm_vec_load(contact->point[0]), qm_vec_load(contact->point[1]));
}

static bool is_larger(const qm_contact *a, const qm_contact *b)
{
    return a->kind != b->kind ? a->kind > b->kind : contact_length(a) > contact_length(b);
}

static void add_faces(const face_triangles *a, const face_triangles *b, bool *found, qm_contact *best)
{
    for (int i = 0; i < a->count; i++) {
        for (int k = 0; k < b->count; k++) {
            qm_contact contact;
            if (!qm_tri_tri_contact(a->corner[i], b->corner[k], &contact)) continue;
            if (!*found || is_larger(&contact, best)) *best = contact;
            *found = true;
        }
    }
}

bool qm_collide_contact(const qm_mesh *a, const qm_mesh *b, qm_face_pair pair, qm_contact *out)
{
    bool found = false;
    for (uint32_t i = first_face(a, pair.a); is_of_face(a, i, pair.a); i++) {
        face_triangles of_a = load_face(a, i);
        for (uint32_t k = first_face(b, pair.b); is_of_face(b, k, pair.b); k++) {
            face_triangles of_b = load_face(b, k);
            add_faces(&of_a, &of_b, &found, out);
        }
    }
    return found;
}
