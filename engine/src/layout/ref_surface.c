/**
 * ref_surface.c: the surface under a layout, and projection onto it.
 *
 * On a mesh the projection of a point is its nearest point. The surface of a point set is defined by moving
 * least squares: a polynomial of second order over the plane of the nearest points, fitted with weights that
 * fall with distance.
 */
#include "qm/source.h"

#include "bvh/bvh_demand.h"
#include "bvh/nearest.h"
#include "bvh/surface.h"
#include "core/linear.h"
#include "knn_graph.h"
#include "ref_points.h"

#define MOST_LOCAL 0x1p40 /* sizes of the surface: a point that is farther away is taken from there */
#define MOST_SIZE 0x1p310 /* of a surface, and the inverse of the least: products of squares stay finite */
#define MIN_SIDE 1e-2     /* of the diagonal: thinner sides of a box count as this thick */

qm_status qm_ref_surface_init(qm_context *ctx, const qm_bvh *bvh, qm_ref_surface *out)
{
    QM_ASSERT(ctx && bvh && out);
    if (!qm_bvh_is_target(bvh, QM_QUADS_TRIANGLES))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the tree was not built as a target");
    qm_box box = qm_mesh_bounding_box(&bvh->mesh);
    *out = (qm_ref_surface){
        .bvh = bvh, .is_cloud = bvh->mesh.face_count == 0, .diagonal = qm_mesh_box_diagonal(&box)};
    if (!(out->diagonal > 0.0))
        return qm_context_fail(ctx, QM_E_EMPTY, "all points of the surface are the same");
    double farthest = 0.0;
    for (int k = 0; k < 3; k++)
        farthest = fmax(farthest, fmax(fabs(box.min[k]), fabs(box.max[k])));
    if (!(out->diagonal >= 1 / MOST_SIZE && farthest <= MOST_SIZE))
        return qm_context_fail(ctx, QM_E_SCALE,
                               "the surface is larger than 2^310, or smaller than its inverse");
    return QM_OK;
}

qm_vec qm_ref_surface_local(const qm_ref_surface *surface, const double p[3])
{
    qm_vec local = qm_frame_local(&surface->bvh->frame, p);
    /* fmin and fmax return the other one for what is no number. */
    return (qm_vec){fmax(fmin(local.x, MOST_LOCAL), -MOST_LOCAL),
                    fmax(fmin(local.y, MOST_LOCAL), -MOST_LOCAL),
                    fmax(fmin(local.z, MOST_LOCAL), -MOST_LOCAL)};
}

/** Centroid and principal axes of weighted points. */
typedef struct local_frame {
    qm_vec centroid, axis[3]; /* the first axis is the normal */
    double flatness;          /* the normal's fraction of the variance, 0 to 1/3; 1 for points on a line */
} local_frame;

/** The least-squares plane of the neighbours: principal axes of their covariance. */
static local_frame fit_plane(const qm_nearest_points *near, const double *weight)
{
    local_frame frame = {{0, 0, 0}, {{0, 0, 0}}, 0.0};
    double sum = 0.0, m[6] = {0}, value[3];
    for (int i = 0; i < near->count; i++) {
        sum += weight[i];
        frame.centroid = qm_vec_axpy(frame.centroid, weight[i], near->position[i]);
    }
    frame.centroid = qm_vec_scale(1.0 / sum, frame.centroid);
    for (int i = 0; i < near->count; i++) {
        qm_vec d = qm_vec_sub(near->position[i], frame.centroid), w = qm_vec_scale(weight[i], d);
        m[0] += w.x * d.x;
        m[1] += w.x * d.y;
        m[2] += w.x * d.z;
        m[3] += w.y * d.y;
        m[4] += w.y * d.z;
        m[5] += w.z * d.z;
    }
    qm_linear_eigen(m, value, frame.axis);
    double total = value[0] + value[1] + value[2];
    frame.flatness = total > 0.0 && value[1] > 1e-6 * value[2] ? value[0] / total : 1.0;
    return frame;
}

/**
 * Fits a polynomial over the plane through p: x[0] is the height at p, x[1] and x[2] are the slopes. It is of
 * second order, or of first where points are few or the equations are singular; false if they still are.
 */
static bool fit_heights(const qm_nearest_points *near, const double *weight, const local_frame *frame,
                        qm_vec p, double scale, double x[QM_LEAST_SQUARES_MAX])
{
    qm_least_squares sums = {.count = near->count >= 2 * QM_LEAST_SQUARES_MAX ? 6 : 3};
    for (int i = 0; i < near->count; i++) {
        qm_vec d = qm_vec_scale(scale, qm_vec_sub(near->position[i], p));
        double a = qm_vec_dot(d, frame->axis[1]), b = qm_vec_dot(d, frame->axis[2]);
        const double row[] = {1.0, a, b, a * a, a * b, b * b};
        qm_linear_add(&sums, row, qm_vec_dot(d, frame->axis[0]), weight[i]);
    }
    if (qm_linear_solve(&sums, x)) return true;
    sums.count = 3;
    return qm_linear_solve(&sums, x);
}

void qm_ref_surface_set_point(const qm_ref_surface *surface, qm_vec p, qm_vec at, qm_vec normal,
                              qm_ref_surface_point *out)
{
    qm_vec_store(out->position, qm_frame_world(&surface->bvh->frame, at));
    qm_vec_store(out->normal, normal);
    out->distance = qm_vec_distance(p, at) * surface->bvh->frame.inverse_scale;
}

void qm_ref_surface_project_to_points(const qm_ref_surface *surface, qm_vec p, const qm_nearest_points *near,
                                      qm_ref_surface_point *out)
{
    QM_ASSERT(near->count >= 1 && near->count <= QM_NEAREST_POINTS_MAX);
    /* Weights fall with the distance from the nearest neighbour, not from p, which may be far from all of
     * them. */
    qm_vec nearest = near->position[0];
    double weight[QM_NEAREST_POINTS_MAX], radius2 = 0.0;
    for (int i = 0; i < near->count; i++)
        radius2 = fmax(radius2, qm_vec_norm2(qm_vec_sub(near->position[i], nearest)));
    out->spacing = sqrt(radius2) * surface->bvh->frame.inverse_scale;
    qm_ref_surface_set_point(surface, p, nearest, (qm_vec){0, 0, 0}, out);
    if (near->count < 3 || radius2 == 0.0) return;
    for (int i = 0; i < near->count; i++) {
        double ratio = qm_vec_norm2(qm_vec_sub(near->position[i], nearest)) / (1.2 * radius2);
        weight[i] = (1.0 - ratio) * (1.0 - ratio);
    }
    local_frame frame = fit_plane(near, weight);
    if (frame.flatness > 0.3) return;
    double scale = 1.0 / sqrt(radius2), x[QM_LEAST_SQUARES_MAX];
    /* p is projected onto the plane first, so that the polynomial is evaluated among the neighbours. */
    double height = qm_vec_dot(qm_vec_sub(p, frame.centroid), frame.axis[0]);
    qm_vec base = qm_vec_axpy(p, -height, frame.axis[0]);
    if (qm_vec_norm2(qm_vec_sub(base, nearest)) > 4.0 * radius2) base = nearest;
    if (!fit_heights(near, weight, &frame, base, scale, x) || !(fabs(x[0]) <= 1.0)) return;
    qm_vec normal = qm_vec_axpy(qm_vec_axpy(frame.axis[0], -x[1], frame.axis[1]), -x[2], frame.axis[2]);
    normal = qm_vec_scale(1.0 / qm_vec_norm(normal), normal);
    qm_ref_surface_set_point(surface, p, qm_vec_axpy(base, x[0] / scale, frame.axis[0]), normal, out);
}

/** Where the last search of a thread ended: the next one often ends near it. The result is the same from any start, of this or
 * another tree. */
static _Thread_local uint32_t last_pack;

void qm_ref_surface_project(const qm_ref_surface *surface, const double p[3], qm_ref_surface_point *out)
{
    QM_ASSERT(surface && surface->bvh && p && out);
    qm_vec local = qm_ref_surface_local(surface, p);
    if (surface->is_cloud) {
        qm_nearest_points near;
        qm_nearest_points_find(surface->bvh, local, QM_FIT_POINTS, &near);
        qm_ref_surface_project_to_points(surface, local, &near, out);
    } else {
        const qm_bvh *bvh = surface->bvh;
        qm_hit hit = {.d2 = INFINITY, .pack = last_pack < bvh->pack_count ? last_pack : 0};
        qm_kernel_get()->closest(bvh, local, &hit);
        last_pack = hit.pack;
        qm_surface_point nearest = qm_surface_triangle_foot(bvh, hit.pack, hit.lane, local);
        qm_vec_store(out->position, qm_vec_load(nearest.position));
        qm_pack scratch;
        const qm_pack *frames = qm_bvh_pack(bvh, hit.pack, &scratch);
        qm_vec z = {frames->row[QM_PACK_ZX][hit.lane], frames->row[QM_PACK_ZY][hit.lane],
                    frames->row[QM_PACK_ZZ][hit.lane]};
        /* The frame of a triangle has the orientation of its corners; CY is 0 where they lie on a line. */
        qm_vec_store(out->normal, frames->row[QM_PACK_CY][hit.lane] > 0.0 ? z : (qm_vec){0, 0, 0});
        out->distance = sqrt(hit.d2) * bvh->frame.inverse_scale;
        out->spacing = 0.0;
    }
}

double qm_ref_surface_disc_radius(const qm_mesh *mesh)
{
    if (mesh->face_count > 0) return 0.0;
    qm_box box = qm_mesh_bounding_box(mesh);
    double root = 1.0,
           diagonal = qm_mesh_box_diagonal(&box); /* the cube root of the volume, which may overflow */
    for (int k = 0; k < 3; k++)
        root *= cbrt(fmax(box.max[k] - box.min[k], MIN_SIDE * diagonal));
    return 0.15 * root / cbrt((double)mesh->vertex_count);
}

qm_status qm_ref_surface_estimate_normals(qm_context *ctx, const qm_ref_surface *surface, double *normals)
{
    if (!surface->is_cloud)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "normals are estimated for point sets only");
    const qm_mesh *cloud = &surface->bvh->mesh;
    qm_knn_graph graph;
    qm_status status = qm_knn_graph_build(ctx, cloud->positions, cloud->vertex_count, NULL, &graph);
    if (status != QM_OK) return status;
    status = qm_knn_graph_orient(ctx, &graph);
    for (size_t i = 0; i < graph.count && status == QM_OK; i++)
        qm_vec_store(normals + 3 * i, graph.normal[i]);
    qm_knn_graph_reset(ctx, &graph);
    return status;
}
