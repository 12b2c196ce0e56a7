#include "qm/source.h"

#include "bvh/bvh_demand.h"
#include "bvh/near_points.h"
#include "bvh/nearest.h"
#include "bvh/surface.h"
#include "core/symmetric.h"

#define FIT_POINTS 20  /* neighbours that a surface of second order is fitted to: it has six unknowns */
#define THIN_SIDE 1e-2 /* of the diagonal: what a flat box counts as thick */

qm_status qm_source_init(qm_context *ctx, const qm_bvh *bvh, qm_source *out)
{
    if (!qm_bvh_is_target(bvh, QM_QUADS_TRIANGLES))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the tree lacks parts that a source needs");
    qm_box box = qm_mesh_bounding_box(&bvh->mesh);
    *out = (qm_source){.bvh = bvh, .is_cloud = bvh->mesh.face_count == 0, .diagonal = qm_box_diagonal(&box)};
    if (!(out->diagonal > 0.0))
        return qm_context_fail(ctx, QM_E_EMPTY, "all points of the surface are the same");
    return QM_OK;
}

static void pull_to_mesh(const qm_source *source, qm_vec p, qm_foothold *out)
{
    const qm_bvh *bvh = source->bvh;
    qm_hit hit = {.d2 = INFINITY};
    qm_kernel_get()->closest(bvh, p, &hit);
    qm_surface_point foot = qm_surface_triangle_foot(bvh, hit.pack, hit.lane, p);
    qm_vec_store(out->position, qm_vec_load(foot.position));
    qm_pack spare;
    const qm_pack *rows = qm_bvh_rows(bvh, hit.pack, &spare);
    qm_vec z = {rows->row[QM_ROW_ZX][hit.lane], rows->row[QM_ROW_ZY][hit.lane],
                rows->row[QM_ROW_ZZ][hit.lane]};
    /* The frame of a triangle starts at its longest edge and turns the same way as its corners. */
    qm_vec_store(out->normal, rows->row[QM_ROW_CY][hit.lane] > 0.0 ? z : (qm_vec){0, 0, 0});
    out->distance = sqrt(hit.d2) * bvh->frame.inverse_scale;
    out->spacing = 0.0;
}

/** Middle and axes of the weighted neighbours; the first axis is the normal. */
typedef struct fit_frame {
    qm_vec middle, axis[3];
    double flatness; /* how much of the spread lies along the normal, 0 to 1/3 */
} fit_frame;

static fit_frame find_frame(const qm_near_points *near, const double *weight)
{
    fit_frame frame = {{0, 0, 0}, {{0, 0, 0}}, 0.0};
    double sum = 0.0, m[6] = {0}, value[3];
    for (int i = 0; i < near->count; i++) {
        sum += weight[i];
        frame.middle = qm_vec_axpy(frame.middle, weight[i], near->position[i]);
    }
    frame.middle = qm_vec_scale(1.0 / sum, frame.middle);
    for (int i = 0; i < near->count; i++) {
        qm_vec d = qm_vec_sub(near->position[i], frame.middle), w = qm_vec_scale(weight[i], d);
        m[0] += w.x * d.x;
        m[1] += w.x * d.y;
        m[2] += w.x * d.z;
        m[3] += w.y * d.y;
        m[4] += w.y * d.z;
        m[5] += w.z * d.z;
    }
    qm_symmetric_eigen(m, value, frame.axis);
    double total = value[0] + value[1] + value[2];
    frame.flatness = total > 0.0 && value[1] > 1e-6 * value[2] ? value[0] / total : 1.0;
    return frame;
}

/** Height and slopes above the plane through p, of the surface fitted to the neighbours. */
static bool fit_heights(const qm_near_points *near, const double *weight, const fit_frame *frame, qm_vec p,
                        double scale, double x[QM_LEAST_SQUARES_MAX])
{
    qm_least_squares sums = {.count = near->count >= 2 * QM_LEAST_SQUARES_MAX ? 6 : 3};
    for (int i = 0; i < near->count; i++) {
        qm_vec d = qm_vec_scale(scale, qm_vec_sub(near->position[i], p));
        double a = qm_vec_dot(d, frame->axis[1]), b = qm_vec_dot(d, frame->axis[2]);
        const double row[] = {1.0, a, b, a * a, a * b, b * b};
        qm_least_squares_add(&sums, row, qm_vec_dot(d, frame->axis[0]), weight[i]);
    }
    if (qm_least_squares_solve(&sums, x)) return true;
    sums.count = 3;
    return qm_least_squares_solve(&sums, x);
}

static void set_foothold(const qm_source *source, qm_vec p, qm_vec at, qm_vec normal, qm_foothold *out)
{
    qm_vec_store(out->position, qm_frame_world(&source->bvh->frame, at));
    qm_vec_store(out->normal, normal);
    out->distance = qm_vec_distance(p, at) * source->bvh->frame.inverse_scale;
}

static void pull_to_cloud(const qm_source *source, qm_vec p, qm_foothold *out)
{
    qm_near_points near;
    qm_near_points_find(source->bvh, p, FIT_POINTS, &near);
    /* Neighbours count by how near they are to the nearest one: p itself may still be far from all. */
    qm_vec nearest = near.position[0];
    double weight[QM_NEAR_POINTS_MAX], reach2 = 0.0;
    for (int i = 0; i < near.count; i++)
        reach2 = fmax(reach2, qm_vec_norm2(qm_vec_sub(near.position[i], nearest)));
    out->spacing = sqrt(reach2) * source->bvh->frame.inverse_scale;
    set_foothold(source, p, nearest, (qm_vec){0, 0, 0}, out);
    if (near.count < 3 || reach2 == 0.0) return;
    for (int i = 0; i < near.count; i++) {
        double share = qm_vec_norm2(qm_vec_sub(near.position[i], nearest)) / (1.2 * reach2);
        weight[i] = (1.0 - share) * (1.0 - share);
    }
    fit_frame frame = find_frame(&near, weight);
    if (frame.flatness > 0.3) return;
    double scale = 1.0 / sqrt(reach2), x[QM_LEAST_SQUARES_MAX];
    /* p is first laid on the plane of the neighbours, so that the fit is read where they are. */
    double height = qm_vec_dot(qm_vec_sub(p, frame.middle), frame.axis[0]);
    qm_vec laid = qm_vec_axpy(p, -height, frame.axis[0]);
    if (qm_vec_norm2(qm_vec_sub(laid, nearest)) > 4.0 * reach2) laid = nearest;
    if (!fit_heights(&near, weight, &frame, laid, scale, x) || !(fabs(x[0]) <= 1.0)) return;
    qm_vec normal = qm_vec_axpy(qm_vec_axpy(frame.axis[0], -x[1], frame.axis[1]), -x[2], frame.axis[2]);
    normal = qm_vec_scale(1.0 / qm_vec_norm(normal), normal);
    set_foothold(source, p, qm_vec_axpy(laid, x[0] / scale, frame.axis[0]), normal, out);
}

void qm_source_pull(const qm_source *source, const double p[3], qm_foothold *out)
{
    qm_vec local = qm_frame_local(&source->bvh->frame, p);
    if (source->is_cloud)
        pull_to_cloud(source, local, out);
    else
        pull_to_mesh(source, local, out);
}

double qm_mesh_disc_radius(const qm_mesh *mesh)
{
    if (mesh->face_count > 0) return 0.0;
    qm_box box = qm_mesh_bounding_box(mesh);
    double root = 1.0, diagonal = qm_box_diagonal(&box); /* of the volume, which itself may overflow */
    for (int k = 0; k < 3; k++)
        root *= cbrt(fmax(box.max[k] - box.min[k], THIN_SIDE * diagonal));
    return 0.15 * root / cbrt((double)mesh->vertex_count);
}
