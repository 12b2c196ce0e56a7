/**
 * collide_faces.c: the tests of two faces. Triangles are tested by exact signs (prim/tri_tri.h); bilinear
 * patches by subdivision to within the tolerance (prim/bilinear_pair.h), after both faces were moved to the
 * origin and scaled by a power of two, which is exact but for the subtraction of the origin.
 */
#include "collide_faces.h"

#include "prim/bilinear.h"
#include "prim/bilinear_pair.h"
#include "prim/tri_tri.h"

#define MIN_TOLERANCE 1e-12 /* of faces scaled to about 1: below it, rounding decides */

static bool is_quad(const qm_mesh *mesh, uint32_t face)
{
    return mesh->face_count > 0 && mesh->faces[4 * (size_t)face + 3] != QM_NO_INDEX;
}

bool qm_collide_faces_have_quad(const qm_collide_faces *faces)
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

bool qm_collide_faces_meet_exactly(const qm_collide_faces *faces)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    return faces->is_self ? qm_tri_tri_cross(a.corner, a.vertex, b.corner, b.vertex)
                          : qm_tri_tri_meet(a.corner, b.corner);
}

/** The direction of a vector of any size, or 0 0 0. */
static qm_vec direction(qm_vec v)
{
    double most = fmax(fabs(v.x), fmax(fabs(v.y), fabs(v.z)));
    if (!(most > 0.0)) return (qm_vec){0, 0, 0};
    qm_vec scaled = {v.x / most, v.y / most, v.z / most};
    return qm_vec_scale(1.0 / qm_vec_norm(scaled), scaled);
}

/** Stores the normal of the plane of two edges. */
static void store_normal(double out[3], qm_vec edge, qm_vec other)
{
    qm_vec_store(out, direction(qm_vec_cross(direction(edge), direction(other))));
}

static void store_triangle_normal(double out[3], const qm_vec t[3])
{
    store_normal(out, qm_vec_sub(t[1], t[0]), qm_vec_sub(t[2], t[0]));
}

/** The normal of a face at parameters of it. */
static void store_face_normal(double out[3], const qm_face_shape *shape, const double uv[2])
{
    if (shape->count == 3) {
        store_triangle_normal(out, shape->corner);
    } else {
        qm_bilinear patch = qm_bilinear_make(shape->corner);
        store_normal(out, qm_vec_axpy(patch.e1, uv[1], patch.w), qm_vec_axpy(patch.e2, uv[0], patch.w));
    }
}

/** Finds the largest contact of two faces as triangles; false when they have none. */
static bool find_triangle_contact(const qm_collide_faces *faces, qm_contact *contact)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    bool found = false;
    double length = 0.0;
    for (int i = 0; i < a.count - 2; i++) {
        for (int k = 0; k < b.count - 2; k++) {
            const qm_vec p[3] = {a.corner[0], a.corner[i + 1], a.corner[i + 2]};
            const qm_vec q[3] = {b.corner[0], b.corner[k + 1], b.corner[k + 2]};
            qm_contact here;
            if (!qm_tri_tri_contact(p, q, &here)) continue;
            double here_length = qm_vec_distance(qm_vec_load(here.point[0]), qm_vec_load(here.point[1]));
            if (found && (here.kind != contact->kind ? here.kind < contact->kind : !(here_length > length)))
                continue;
            *contact = here;
            store_triangle_normal(contact->normal[0], p);
            store_triangle_normal(contact->normal[1], q);
            length = here_length;
            found = true;
        }
    }
    return found;
}

/* ---- as patches ---- */

/** Moves and scales both faces so that the first one begins at the origin and the largest coordinate is about
 * 1. Returns the scale, a power of two. */
static double normalize(qm_face_shape *a, qm_face_shape *b)
{
    qm_vec origin = a->corner[0];
    qm_face_shape *const both[2] = {a, b};
    double extent = 0.0;
    for (int side = 0; side < 2; side++) {
        for (int i = 0; i < both[side]->count; i++) {
            qm_vec *c = &both[side]->corner[i];
            *c = qm_vec_sub(*c, origin);
            extent = fmax(extent, fmax(fabs(c->x), fmax(fabs(c->y), fabs(c->z))));
        }
    }
    QM_ASSERT(extent >= 0.0);
    int exponent = 0;
    if (extent > 0.0) frexp(extent, &exponent);
    double scale = ldexp(1.0, exponent < -1000 ? 1000 : -exponent); /* finite, as its inverse is */
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < both[side]->count; i++)
            both[side]->corner[i] = qm_vec_scale(scale, both[side]->corner[i]);
    return scale;
}

bool qm_collide_faces_meet_bilinear(const qm_collide_faces *faces, double tolerance, qm_contact *contact)
{
    qm_face_shape a = load_face(faces->mesh[0], faces->face[0]),
                  b = load_face(faces->mesh[1], faces->face[1]);
    qm_vec origin = a.corner[0];
    double scale = normalize(&a, &b), scaled = fmax(tolerance * scale, MIN_TOLERANCE);
    qm_bilinear_gap gap;
    bool meets = faces->is_self ? qm_bilinear_pair_cross(&a, &b, scaled, &gap)
                                : qm_bilinear_pair_meet(&a, &b, scaled, &gap);
    if (meets && contact) {
        qm_vec midpoint = qm_vec_axpy(origin, 1.0 / scale, qm_vec_mix(gap.point[0], gap.point[1], 0.5));
        contact->kind = QM_CONTACT_POINT;
        qm_vec_store(contact->point[0], midpoint);
        qm_vec_store(contact->point[1], midpoint);
        store_face_normal(contact->normal[0], &a, gap.uv[0]);
        store_face_normal(contact->normal[1], &b, gap.uv[1]);
    }
    return meets;
}

/* ---- where a pair of input faces meets ---- */

/** The first face of the mesh that was cut from this input face, or from a later one: origins ascend. */
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

bool qm_collide_faces_find_contact(qm_collide_faces *faces, const qm_collide_options *options,
                                   qm_face_pair pair, qm_contact *contact)
{
    const qm_mesh *a = faces->mesh[0], *b = faces->mesh[1];
    for (uint32_t i = first_face(a, pair.a); is_of_face(a, i, pair.a); i++) {
        for (uint32_t k = first_face(b, pair.b); is_of_face(b, k, pair.b); k++) {
            faces->face[0] = i;
            faces->face[1] = k;
            bool is_bilinear = options->quads == QM_QUADS_BILINEAR && qm_collide_faces_have_quad(faces);
            if (is_bilinear ? qm_collide_faces_meet_bilinear(faces, options->tolerance, contact)
                            : find_triangle_contact(faces, contact))
                return true;
        }
    }
    return false;
}

bool qm_collide_contact(const qm_mesh *a, const qm_mesh *b, const qm_collide_options *options,
                        qm_face_pair pair, qm_contact *out)
{
    QM_ASSERT(a && b && options && out);
    qm_collide_faces faces = {.mesh = {a, b}, .is_self = a == b};
    if (qm_collide_faces_find_contact(&faces, options, pair, out)) return true;
    if (a != b) return false;
    /* A search of two meshes that are one also finds patches that have no more than a corner or an edge in common. */
    faces.is_self = false;
    return qm_collide_faces_find_contact(&faces, options, pair, out);
}
