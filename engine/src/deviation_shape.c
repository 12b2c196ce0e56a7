#include "deviation_shape.h"

#define EPSILON 0x1p-53
#define AREA_ROUNDINGS 16.0

static qm_vec load_vertex(const qm_piece_maker *maker, uint32_t vertex)
{
    return qm_frame_local(&maker->target->frame, maker->source->mesh.positions + 3 * (size_t)vertex);
}

qm_piece_face qm_piece_face_load(const qm_piece_maker *maker, const qm_source_piece *piece)
{
    const uint32_t *index = maker->source->mesh.faces + 4 * (size_t)piece->face;
    qm_piece_face face = {.is_patch = index[3] != QM_NO_INDEX && maker->source_patches};
    face.corner[0] = load_vertex(maker, index[0]);
    face.corner[1] = load_vertex(maker, index[piece->second ? 2 : 1]);
    face.corner[2] = load_vertex(maker, index[piece->second ? 3 : 2]);
    if (!face.is_patch) return face;
    face.corner[3] = load_vertex(maker, index[3]);
    face.patch = qm_patch_make(face.corner);
    return face;
}

static qm_vec flat_point(const qm_vec corner[3], double u, double v)
{
    return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(1.0 - u - v, corner[0]), u, corner[1]), v, corner[2]);
}

qm_vec qm_piece_face_at(const qm_piece_face *face, double u, double v)
{
    return face->is_patch ? qm_patch_at(&face->patch, u, v) : flat_point(face->corner, u, v);
}

/** Twice the area of the piece in its parameters. */
static double parameter_area2(const qm_source_piece *piece)
{
    double du1 = piece->u[1] - piece->u[0], dv1 = piece->v[1] - piece->v[0];
    double du2 = piece->u[2] - piece->u[0], dv2 = piece->v[2] - piece->v[0];
    return fabs(du1 * dv2 - du2 * dv1);
}

static double spread(const double x[3])
{
    return fmax(x[0], fmax(x[1], x[2])) - fmin(x[0], fmin(x[1], x[2]));
}

/** What rounding may have done to a cross product of two edges. */
static double cross_error(const qm_piece_maker *maker, qm_vec a, qm_vec b)
{
    double la = qm_vec_norm(a), lb = qm_vec_norm(b);
    return AREA_ROUNDINGS * EPSILON * (la * lb + maker->reach * (la + lb));
}

static void spread_flat(qm_piece_shape *shape, const qm_piece_maker *maker, const qm_piece_face *face,
                        const qm_source_piece *piece)
{
    const qm_vec *corner = face->corner;
    qm_vec a = qm_vec_sub(corner[1], corner[0]), b = qm_vec_sub(corner[2], corner[0]);
    double doubled = qm_vec_norm(qm_vec_cross(a, b)), error = cross_error(maker, a, b);
    double share = 0.5 * parameter_area2(piece);
    for (int i = 0; i < 3; i++) {
        shape->low[i] = share * fmax(0.0, doubled - error);
        shape->high[i] = share * (doubled + error);
    }
    shape->slack = 0.0;
    shape->is_uniform = true;
}

/** Q_s x Q_t = e1 x e2 + s e1 x w + t w x e2 is linear in s and t: its length is convex. */
static void spread_patch(qm_piece_shape *shape, const qm_piece_maker *maker, const qm_piece_face *face,
                         const qm_source_piece *piece)
{
    const qm_patch *patch = &face->patch;
    qm_vec normal[3], sum = {0, 0, 0};
    double share = 0.5 * parameter_area2(piece), error = 0.0;
    for (int i = 0; i < 3; i++) {
        qm_vec along_s = qm_vec_axpy(patch->e1, piece->v[i], patch->w);
        qm_vec along_t = qm_vec_axpy(patch->e2, piece->u[i], patch->w);
        normal[i] = qm_vec_cross(along_s, along_t);
        sum = qm_vec_add(sum, normal[i]);
        error = fmax(error, cross_error(maker, along_s, along_t));
    }
    double length = qm_vec_norm(sum);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
    for (int i = 0; i < 3; i++) {
        shape->low[i] = share * fmax(0.0, qm_vec_dot(unit, normal[i]) - error);
        shape->high[i] = share * (qm_vec_norm(normal[i]) + error);
    }
    /* Clamped values are no linear function below the length any more. */
    if (shape->low[0] <= 0.0 || shape->low[1] <= 0.0 || shape->low[2] <= 0.0)
        shape->low[0] = shape->low[1] = shape->low[2] = 0.0;
    shape->slack = 0.25 * qm_vec_norm(patch->w) * spread(piece->u) * spread(piece->v);
    shape->is_uniform = qm_vec_norm2(patch->w) == 0.0;
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
