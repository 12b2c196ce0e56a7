/**
 * deviation_normals.c: the foot of a point, what it lies on, and the normals there.
 */
#include "deviation_normals.h"

#include <string.h>

#include "bvh/nearest.h"
#include "bvh/surface.h"
#include "core/face_ring.h"

#define FOOT_ERROR 1e-12 /* local */
#define ON_BORDER 1e-9   /* of the parameters of a face: nearer to an edge or corner than that is on it */

qm_status qm_deviation_normals_init(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                                    qm_deviation_normals *out)
{
    const qm_mesh *mesh = &bvh->mesh;
    *out = (qm_deviation_normals){.bvh = bvh, .reading = reading};
    if (mesh->face_count == 0)
        return qm_context_fail(ctx, QM_E_NOT_CLOSED, "mesh B is a point set, which has no sides");
    size_t corners = 4 * mesh->face_count;
    for (size_t i = 0; i < corners; i++)
        out->corner_count += mesh->faces[i] != QM_NO_INDEX;
    out->start = qm_context_alloc(ctx, mesh->vertex_count + 1, sizeof *out->start);
    out->faces = qm_context_alloc(ctx, out->corner_count, sizeof *out->faces);
    if (!out->start || !out->faces)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the normals");
    memset(out->start, 0, (mesh->vertex_count + 1) * sizeof *out->start);
    for (size_t i = 0; i < corners; i++)
        if (mesh->faces[i] != QM_NO_INDEX) out->start[mesh->faces[i]]++;
    uint32_t end = 0;
    for (size_t v = 0; v <= mesh->vertex_count; v++)
        out->start[v] = end += out->start[v];
    for (size_t i = corners; i-- > 0;)
        if (mesh->faces[i] != QM_NO_INDEX) out->faces[--out->start[mesh->faces[i]]] = (uint32_t)(i / 4);
    return QM_OK;
}

void qm_deviation_normals_reset(qm_context *ctx, qm_deviation_normals *normals)
{
    if (normals->bvh)
        qm_context_free(ctx, normals->start, normals->bvh->mesh.vertex_count + 1, sizeof *normals->start);
    qm_context_free(ctx, normals->faces, normals->corner_count, sizeof *normals->faces);
    *normals = (qm_deviation_normals){0};
}

/* ---- normals ---- */

/** A face: its corners, in turn, and how many triangles it is: 0 for a patch. */
typedef struct normal_face {
    int count, triangles;
    const uint32_t *index;
    qm_vec corner[4];
} normal_face;

static normal_face load_face(const qm_deviation_normals *normals, uint32_t face)
{
    const qm_mesh *mesh = &normals->bvh->mesh;
    normal_face out = {.index = mesh->faces + 4 * (size_t)face};
    out.count = qm_face_corners(out.index);
    out.triangles = out.count == 4 && normals->reading == QM_QUADS_BILINEAR ? 0 : out.count - 2;
    for (int i = 0; i < out.count; i++)
        out.corner[i] = qm_frame_local(&normals->bvh->frame, mesh->positions + 3 * (size_t)out.index[i]);
    return out;
}

/** The unit normal of the triangle of three corners, times its angle at the first where that is to weigh. */
static qm_vec triangle_normal(qm_vec a, qm_vec b, qm_vec c, bool has_weight)
{
    qm_vec on = qm_vec_sub(b, a), back = qm_vec_sub(c, a), cross = qm_vec_cross(on, back);
    double angle = has_weight ? atan2(qm_vec_norm(cross), qm_vec_dot(on, back)) : 1.0;
    return qm_vec_scale(angle, qm_vec_unit(cross));
}

/** The normals of a face at one of its corners, by their angles. */
static qm_vec corner_normal(const normal_face *face, int corner)
{
    qm_vec sum = {0, 0, 0};
    for (int k = 0; k < face->triangles; k++) {
        const int of[3] = {0, k + 1, k + 2};
        for (int i = 0; i < 3; i++)
            if (of[i] == corner)
                sum = qm_vec_add(sum, triangle_normal(face->corner[corner], face->corner[of[(i + 1) % 3]],
                                                      face->corner[of[(i + 2) % 3]], true));
    }
    if (face->triangles > 0) return sum;
    return triangle_normal(face->corner[corner], face->corner[(corner + 1) % 4],
                           face->corner[(corner + 3) % 4], true);
}

/** The normal of a face beside the edge after one of its corners, at a fraction of it. */
static qm_vec edge_normal(const normal_face *face, int corner, double fraction)
{
    int next = (corner + 1) % face->count;
    if (face->triangles > 0) {
        int third = face->count == 3 ? (corner + 2) % 3
                    : corner < 2     ? (corner == 0 ? 2 : 0)
                                     : (corner == 2 ? 0 : 2);
        return triangle_normal(face->corner[corner], face->corner[next], face->corner[third], false);
    }
    qm_vec from = qm_vec_cross(qm_vec_sub(face->corner[next], face->corner[corner]),
                               qm_vec_sub(face->corner[(corner + 3) % 4], face->corner[corner]));
    qm_vec to = qm_vec_cross(qm_vec_sub(face->corner[(next + 1) % 4], face->corner[next]),
                             qm_vec_sub(face->corner[corner], face->corner[next]));
    return qm_vec_unit(qm_vec_mix(from, to, fraction));
}

/** The normal of a face inside of it; of two triangles, both on their common edge. */
static qm_vec inner_normal(const normal_face *face, const double uv[2])
{
    if (face->triangles == 0) {
        qm_bilinear patch = qm_bilinear_make(face->corner);
        return qm_vec_unit(
            qm_vec_cross(qm_vec_axpy(patch.e1, uv[1], patch.w), qm_vec_axpy(patch.e2, uv[0], patch.w)));
    }
    qm_vec first = triangle_normal(face->corner[0], face->corner[1], face->corner[2], false);
    if (face->triangles == 1 || uv[0] > uv[1] + ON_BORDER) return first;
    qm_vec second = triangle_normal(face->corner[0], face->corner[2], face->corner[3], false);
    return uv[1] > uv[0] + ON_BORDER ? second : qm_vec_add(first, second);
}

/** Sums the normals of all faces at a vertex, or beside the edge from there to another one, unless that is QM_NO_INDEX. */
static qm_vec sum_at(const qm_deviation_normals *normals, uint32_t vertex, uint32_t other, double fraction)
{
    qm_vec sum = {0, 0, 0};
    for (uint32_t i = normals->start[vertex]; i < normals->start[vertex + 1]; i++) {
        normal_face face = load_face(normals, normals->faces[i]);
        for (int k = 0; k < face.count; k++) {
            uint32_t here = face.index[k], next = face.index[(k + 1) % face.count];
            if (other == QM_NO_INDEX && here == vertex) sum = qm_vec_add(sum, corner_normal(&face, k));
            if (here == vertex && next == other) sum = qm_vec_add(sum, edge_normal(&face, k, fraction));
            if (next == vertex && here == other) sum = qm_vec_add(sum, edge_normal(&face, k, 1.0 - fraction));
        }
    }
    return sum;
}

/** The weights of the corners of a face at a point of it. */
static void find_weights(const normal_face *face, const double uv[2], double weight[4])
{
    double u = uv[0], v = uv[1];
    if (face->count == 3) {
        weight[0] = 1.0 - u - v;
        weight[1] = u;
        weight[2] = v;
    } else {
        weight[0] = (1.0 - u) * (1.0 - v);
        weight[1] = u * (1.0 - v);
        weight[2] = u * v;
        weight[3] = (1.0 - u) * v;
    }
}

static qm_vec normal_at(const qm_deviation_normals *normals, const qm_surface_point *foot)
{
    normal_face face = load_face(normals, foot->face);
    double weight[4];
    find_weights(&face, foot->uv, weight);
    for (int i = 0; i < face.count; i++)
        if (weight[i] > 1.0 - ON_BORDER) return sum_at(normals, face.index[i], QM_NO_INDEX, 0.0);
    for (int i = 0; i < face.count; i++) {
        int next = (i + 1) % face.count;
        double there = weight[i] + weight[next];
        if (there > 1.0 - ON_BORDER)
            return sum_at(normals, face.index[i], face.index[next], weight[next] / there);
    }
    return inner_normal(&face, foot->uv);
}

int qm_deviation_normals_side(const qm_deviation_normals *normals, qm_vec p, uint32_t *hint)
{
    const qm_bvh *bvh = normals->bvh;
    const qm_locator locator = {.bvh = bvh};
    qm_tie tie = qm_nearest_face(qm_kernel_get(), &locator, normals->reading, p, hint);
    qm_surface_point foot = qm_surface_face_foot(bvh, normals->reading, tie.face, p, FOOT_ERROR);
    qm_vec from = qm_vec_sub(p, qm_frame_local(&bvh->frame, foot.position));
    double side = qm_vec_dot(from, normal_at(normals, &foot));
    return (side > 0.0) - (side < 0.0);
}
