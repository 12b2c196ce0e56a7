#include "collide_faces.h"

#include "prim/bilinear_pair.h"
#include "prim/tri_tri.h"

#define LEAST_TOLERANCE 1e-12 /* of faces scaled to about 1: below it, rounding decides */

static bool is_quad(const qm_mesh *mesh, uint32_t face)
{
    return mesh->face_count > 0 && mesh->faces[4 * (size_t)face + 3] != QM_NO_INDEX;
}

bool qm_faces_have_quad(const qm_faces *faces)
{
    return is_quad(faces->mesh[0], faces->face[0]) || is_quad(faces->mesh[1], faces->face[1]);
}

/** The corners of a face; a point of a point set is a triangle of no size. */
static qm_face_shape load_face(const qm_mesh *mesh, uint32_t face)
{
    qm_face_shape shape = {.count = is_quad(mesh, face) ? 4 : 3};
    for (int i = 0; i < shape.count; i++) {
        shape.vertex[i] = mesh->face_count > 0 ? mesh->faces[4 * (size_t)face + (size_t)i] : face;
        shape.corner[i] = qm_vec_load(mesh->positions + 3 * (size_t)shape.vertex[i]);
    }
    return shape;
}

/* ---- as triangles ---- */

bool qm_faces_meet_exactly(const qm_faces *faces)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    return faces->is_self ? qm_tri_tri_cross(a.corner, a.vertex, b.corner, b.vertex)
                          : qm_tri_tri_meet(a.corner, b.corner);
}

static bool is_larger(const qm_contact *a, const qm_contact *b)
{
    if (a->kind != b->kind) return a->kind > b->kind;
    return qm_vec_distance(qm_vec_load(a->point[0]), qm_vec_load(a->point[1])) >
           qm_vec_distance(qm_vec_load(b->point[0]), qm_vec_load(b->point[1]));
}

bool qm_faces_find_contact(const qm_faces *faces, qm_contact *contact)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    bool found = false;
    for (int i = 0; i < a.count - 2; i++) {
        for (int k = 0; k < b.count - 2; k++) {
            const qm_vec p[3] = {a.corner[0], a.corner[i + 1], a.corner[i + 2]};
            const qm_vec q[3] = {b.corner[0], b.corner[k + 1], b.corner[k + 2]};
            qm_contact here;
            if (!qm_tri_tri_contact(p, q, &here)) continue;
            if (!found || is_larger(&here, contact)) *contact = here;
            found = true;
        }
    }
    return found;
}

/* ---- as patches ---- */

/** Moves and scales both faces so that they lie round the origin and measure about 1. Returns the scale, a
 * power of two. */
static double bring_near(qm_face_shape *a, qm_face_shape *b)
{
    qm_vec origin = a->corner[0];
    qm_face_shape *const both[2] = {a, b};
    double reach = 0.0;
    for (int side = 0; side < 2; side++) {
        for (int i = 0; i < both[side]->count; i++) {
            qm_vec *c = &both[side]->corner[i];
            *c = qm_vec_sub(*c, origin);
            reach = fmax(reach, fmax(fabs(c->x), fmax(fabs(c->y), fabs(c->z))));
        }
    }
    int exponent = 0;
    if (reach > 0.0) frexp(reach, &exponent);
    double scale = ldexp(1.0, exponent < -1000 ? 1000 : -exponent); /* a number, as its inverse is */
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < both[side]->count; i++)
            both[side]->corner[i] = qm_vec_scale(scale, both[side]->corner[i]);
    return scale;
}

bool qm_faces_meet_bilinear(const qm_faces *faces, double tolerance, qm_contact *contact)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    qm_vec origin = a.corner[0];
    double scale = bring_near(&a, &b), scaled = fmax(tolerance * scale, LEAST_TOLERANCE);
    qm_bilinear_gap gap;
    bool meets = faces->is_self ? qm_bilinear_pair_cross(&a, &b, scaled, &gap)
                                : qm_bilinear_pair_meet(&a, &b, scaled, &gap);
    if (meets && contact) {
        qm_vec middle = qm_vec_axpy(origin, 1.0 / scale, qm_vec_mix(gap.point[0], gap.point[1], 0.5));
        contact->kind = QM_CONTACT_POINT;
        qm_vec_store(contact->point[0], middle);
        qm_vec_store(contact->point[1], middle);
    }
    return meets;
}
