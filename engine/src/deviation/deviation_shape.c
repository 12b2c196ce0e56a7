#include "deviation_shape.h"

#include "bvh/bvh_demand.h"
#include "core/rounding.h"
#include "prim/bilinear_hull.h"

/**
 * A vector along a face is off by at most 40 u S, S the greatest local coordinate. An edge: both corners by u
 * S each as they enter the frame, the difference by 2 u S, in each of three coordinates: 7 u S. Q_s = e1 + t
 * w: corners give 2 + 4 u S, e1 2 u S, w = (c0 - c1) + (c2 - c3) 2 + 2 + 4 u S, t w 4 u S, the sum 2 u S,
 * each coordinate: 22 sqrt(3) u S = 38 u S. A cross product adds 6 u, its length 3 u of the product of
 * lengths.
 */
#define CROSS_ROUNDINGS 40.0

/** Of a determinant of parameters: each of four differences by u, both products and their difference. */
#define PARAMETER_ROUNDINGS 4.0

#define OUTSIDE 0x1p-20 /* relative: corners of pieces may lie outside of the face by far less */

/** What rounding may have done to a cross product of two edges. */
static double cross_error(const qm_piece_maker *maker, qm_vec a, qm_vec b)
{
    double la = qm_vec_norm(a), lb = qm_vec_norm(b);
    return CROSS_ROUNDINGS * QM_UNIT_ROUNDING * (la * lb + maker->reach * (la + lb));
}

/* ---- faces ---- */

/** How much the triangles of a patch differ from it, for the common normal of the diagonals: g, and 2 k, in
 * which the factor covers rounding. INFINITY where rounding leaves open whether the view is convex. */
static void compare_triangles(const qm_piece_maker *maker, const qm_vec c[4], double *slack, double *spread)
{
    *slack = *spread = INFINITY;
    qm_vec normal = qm_vec_cross(qm_vec_sub(c[2], c[0]), qm_vec_sub(c[3], c[1]));
    double length = qm_vec_norm(normal), least = INFINITY, longest = 0.0;
    if (!(length > QM_LEAST_LENGTH)) return;
    normal = qm_vec_scale(1.0 / length, normal);
    for (int i = 0; i < 4; i++) {
        qm_vec on = qm_vec_sub(c[(i + 1) % 4], c[i]), after = qm_vec_sub(c[(i + 2) % 4], c[(i + 1) % 4]);
        double turn = qm_vec_dot(normal, qm_vec_cross(on, after)) - 2.0 * cross_error(maker, on, after);
        least = fmin(least, turn);
        longest = fmax(longest, qm_vec_norm(on));
    }
    if (!(least > 0.0)) return;
    *slack = qm_hull_width(c, normal);
    double aside = 2.0 * *slack * longest / least;
    *spread = aside * aside;
}

/** Loads the corners of a face; false for a triangle, which has three. */
static bool load_corners(const qm_piece_maker *maker, uint32_t face, qm_vec corner[4])
{
    const qm_mesh *mesh = &maker->source->mesh;
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    bool is_quad = index[3] != QM_NO_INDEX;
    for (int i = 0; i < (is_quad ? 4 : 3); i++)
        corner[i] = qm_frame_local(&maker->target->frame, mesh->positions + 3 * (size_t)index[i]);
    return is_quad;
}

/** True when the parameters of a patch tell its distance from a target nearby better than its triangles,
 * whose points are up to |w| / 4 beside those of the patch: over a patch that is twisted against them,
 * heights differ there by more than what functions over a ground are opened by. Farther away than that they
 * change sign nowhere, and differ less. */
static bool is_over_twist(const qm_piece_maker *maker, const qm_vec corner[4])
{
    qm_bilinear patch = qm_bilinear_make(corner);
    double size = qm_min(qm_vec_norm(patch.e1), qm_vec_norm(patch.e2)), w = qm_vec_norm(patch.w);
    if (!maker->target_patches || !(w > maker->stray_error)) return false;
    qm_hit hit = {.d2 = INFINITY, .pack = 0};
    maker->kernel->closest(maker->target, qm_bilinear_at(&patch, 0.5, 0.5), &hit);
    double twist = (double)qm_bvh_twists(maker->target, hit.pack)[hit.lane];
    return twist * w > maker->stray_error * size && 16.0 * hit.d2 < w * w;
}

bool qm_piece_face_is_flat(const qm_piece_maker *maker, uint32_t face)
{
    qm_vec corner[4];
    double slack, spread;
    if (!maker->source_patches || !load_corners(maker, face, corner)) return true;
    compare_triangles(maker, corner, &slack, &spread);
    return slack <= maker->flat_error && spread <= maker->flat_spread && !is_over_twist(maker, corner);
}

qm_piece_face qm_piece_face_load(const qm_piece_maker *maker, const qm_source_piece *piece)
{
    qm_piece_face face = {.is_patch = !piece->is_flat};
    bool is_quad = load_corners(maker, piece->face, face.corner);
    if (face.is_patch) face.patch = qm_bilinear_make(face.corner);
    if (face.is_patch || !is_quad) return face;
    if (maker->source_patches) compare_triangles(maker, face.corner, &face.slack, &face.spread);
    if (piece->second) {
        face.corner[1] = face.corner[2];
        face.corner[2] = face.corner[3];
    }
    return face;
}

/* ---- pieces ---- */

static qm_vec flat_point(const qm_vec corner[3], double u, double v)
{
    return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(1.0 - u - v, corner[0]), u, corner[1]), v, corner[2]);
}

qm_vec qm_piece_face_at(const qm_piece_face *face, double u, double v)
{
    return face->is_patch ? qm_bilinear_at(&face->patch, u, v) : flat_point(face->corner, u, v);
}

double qm_piece_parameter_area2(const qm_source_piece *piece, double *error)
{
    double du1 = piece->u[1] - piece->u[0], dv1 = piece->v[1] - piece->v[0];
    double du2 = piece->u[2] - piece->u[0], dv2 = piece->v[2] - piece->v[0];
    *error = PARAMETER_ROUNDINGS * QM_UNIT_ROUNDING * (fabs(du1 * dv2) + fabs(du2 * dv1));
    return du1 * dv2 - du2 * dv1;
}

/** Areas that the piece would have at densities of its face, from below and above. */
static void set_spread(qm_piece_shape *shape, const qm_piece_maker *maker, const qm_source_piece *piece,
                       const double low[3], const double high[3], double rounding)
{
    double error, doubled = fabs(qm_piece_parameter_area2(piece, &error));
    double least = 0.5 * maker->area_unit * fmax(0.0, doubled - error);
    double most = 0.5 * maker->area_unit * (doubled + error);
    for (int i = 0; i < 3; i++) {
        shape->low[i] = least * low[i];
        shape->high[i] = most * high[i];
    }
    shape->rounding = most * rounding;
}

static double spread(const double x[3])
{
    return fmax(x[0], fmax(x[1], x[2])) - fmin(x[0], fmin(x[1], x[2]));
}

static void spread_flat(qm_piece_shape *shape, const qm_piece_maker *maker, const qm_piece_face *face,
                        const qm_source_piece *piece)
{
    const qm_vec *corner = face->corner;
    qm_vec a = qm_vec_sub(corner[1], corner[0]), b = qm_vec_sub(corner[2], corner[0]);
    double doubled = qm_vec_norm(qm_vec_cross(a, b)), error = cross_error(maker, a, b);
    double most_spread = 1.0 + face->spread;
    double least = fmax(0.0, doubled - error) / most_spread, most = (doubled + error) * most_spread;
    set_spread(shape, maker, piece, (const double[]){least, least, least}, (const double[]){most, most, most},
               error);
    shape->slack = face->slack;
    shape->is_uniform = true;
}

/** Q_s x Q_t = e1 x e2 + s e1 x w + t w x e2 is linear in s and t: its length is convex. */
static qm_vec patch_normal(const qm_piece_maker *maker, const qm_bilinear *patch, double s, double t,
                           double *error)
{
    qm_vec along_s = qm_vec_axpy(patch->e1, t, patch->w), along_t = qm_vec_axpy(patch->e2, s, patch->w);
    *error = cross_error(maker, along_s, along_t);
    return qm_vec_cross(along_s, along_t);
}

static void spread_patch(qm_piece_shape *shape, const qm_piece_maker *maker, const qm_piece_face *face,
                         const qm_source_piece *piece)
{
    const qm_bilinear *patch = &face->patch;
    qm_vec normal[3], sum = {0, 0, 0};
    double low[3], high[3], error = 0.0;
    for (int i = 0; i < 3; i++) {
        double here;
        normal[i] = patch_normal(maker, patch, piece->u[i], piece->v[i], &here);
        sum = qm_vec_add(sum, normal[i]);
        error = fmax(error, here);
    }
    double length = qm_vec_norm(sum);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
    for (int i = 0; i < 3; i++) {
        low[i] = qm_vec_dot(unit, normal[i]) - error;
        high[i] = qm_vec_norm(normal[i]) + error;
    }
    /* Clamped values are no linear function below the length any more. */
    if (low[0] <= 0.0 || low[1] <= 0.0 || low[2] <= 0.0) low[0] = low[1] = low[2] = 0.0;
    set_spread(shape, maker, piece, low, high, error);
    shape->slack = 0.25 * qm_vec_norm(patch->w) * spread(piece->u) * spread(piece->v);
    shape->is_uniform = qm_vec_norm2(patch->w) == 0.0;
}

double qm_piece_face_density(const qm_piece_maker *maker, const qm_piece_face *face)
{
    double most = 0.0;
    if (!face->is_patch) {
        qm_vec a = qm_vec_sub(face->corner[1], face->corner[0]);
        qm_vec b = qm_vec_sub(face->corner[2], face->corner[0]);
        most = qm_vec_norm(qm_vec_cross(a, b)) + cross_error(maker, a, b);
    }
    for (int i = 0; i < 4 && face->is_patch; i++) {
        double error;
        qm_vec normal = patch_normal(maker, &face->patch, i & 1 ? 1.0 : 0.0, i & 2 ? 1.0 : 0.0, &error);
        most = fmax(most, qm_vec_norm(normal) + error);
    }
    return maker->area_unit * most * (1.0 + face->spread) * (1.0 + OUTSIDE);
}

qm_piece_shape qm_piece_shape_make(const qm_piece_maker *maker, const qm_piece_face *face,
                                   const qm_source_piece *piece)
{
    qm_piece_shape shape = {.radius = 0.0};
    for (int i = 0; i < 3; i++)
        shape.corner[i] = qm_piece_face_at(face, piece->u[i], piece->v[i]);
    if (face->is_patch)
        spread_patch(&shape, maker, face, piece);
    else
        spread_flat(&shape, maker, face, piece);
    qm_vec sum = qm_vec_add(qm_vec_add(shape.corner[0], shape.corner[1]), shape.corner[2]);
    shape.middle = qm_vec_scale(1.0 / 3.0, sum);
    for (int i = 0; i < 3; i++) {
        shape.radius = fmax(shape.radius, qm_vec_distance(shape.corner[i], shape.middle));
        shape.longest2 =
            fmax(shape.longest2, qm_vec_norm2(qm_vec_sub(shape.corner[i], shape.corner[(i + 1) % 3])));
    }
    return shape;
}
