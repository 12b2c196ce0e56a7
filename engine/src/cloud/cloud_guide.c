/**
 * cloud_guide.c: a smooth surface through noisy points, on which all stages work but the last: curves, labels and lattices
 * would follow the noise otherwise.
 *
 * Each point goes to the polynomial surface of its neighbours (qm_ref_surface_project), of as many of them as the shape allows:
 * with more neighbours the value of the polynomial has less noise, but more of the shape that it does not follow. Of growing
 * neighbourhoods the last one is taken whose interval of a few standard errors still meets all intervals before it: where they
 * cease to, the shape shows through.
 *
 * Source: A. Goldenshluger, A. Nemirovski, On spatially adaptive estimation of nonparametric regression, 1997 (the intersection
 * of confidence intervals).
 */
#include "cloud_points.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "bvh/bvh_tree.h"
#include "layout/ref_points.h"

#define MAX_POINTS 1048576  /* of the data */
#define GUIDE_POINTS 60000  /* of the surface that is made of them */
#define STUDY_POINTS 262144 /* of which noise and outliers are found */
#define INTERVAL 2.0        /* standard errors to each side of an estimate */
/* The variance of the value of the polynomial at the middle of k neighbours with the weights of ref_surface.c is this over k: 5.2
 * to 5.9 by the inverse of the normal equations over 300 random discs, for 20 to 128 neighbours. */
#define VARIANCE 5.4
#define MIN_REACH 3.0 /* of the noise: the radius of a neighbourhood in which a plane shows */
#define SMOOTHING 2   /* rounds of averaging normals at the corners of faces */

enum { POINT_SIZE = 3 * sizeof(double), SIZES = 5, BLOCK = 256 };

struct qm_guide {
    atomic_int owners;
    qm_noise_points smooth, data;
    qm_mesh cloud; /* of the smooth points, which it borrows */
    qm_bvh *tree;
    qm_ref_surface surface;
    double sigma, turn; /* of the points; of their normals, in radians, 0 if unknown */
};

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a smooth surface");
}

qm_guide *qm_guide_keep(qm_guide *guide)
{
    if (guide) atomic_fetch_add(&guide->owners, 1);
    return guide;
}

void qm_guide_release(qm_context *ctx, qm_guide *guide)
{
    if (!guide || atomic_fetch_sub(&guide->owners, 1) > 1) return;
    qm_bvh_destroy(ctx, guide->tree);
    qm_noise_points_reset(ctx, &guide->smooth);
    qm_noise_points_reset(ctx, &guide->data);
    qm_context_free(ctx, guide, 1, sizeof *guide);
}

const qm_ref_surface *qm_guide_surface(const qm_guide *guide)
{
    return &guide->surface;
}

const qm_noise_points *qm_guide_points(const qm_guide *guide, double *sigma, double *turn)
{
    *sigma = guide->sigma;
    *turn = guide->turn;
    return &guide->data;
}

static qm_vec normal_at(const float *normals, size_t i)
{
    const float *row = normals + 3 * i;
    return (qm_vec){(double)row[0], (double)row[1], (double)row[2]};
}

static void store_unit(float *normals, size_t i, qm_vec normal)
{
    double length = qm_vec_norm(normal);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
    normals[3 * i] = (float)unit.x;
    normals[3 * i + 1] = (float)unit.y;
    normals[3 * i + 2] = (float)unit.z;
}

/** Adds the normal of a face to the sums at its corners: its own, or the mean of those at its corners. */
static void add_face(const qm_mesh *mesh, size_t face, const float *before, qm_vec *sum)
{
    const uint32_t *corner = mesh->faces + 4 * face;
    int count = corner[3] == QM_NO_INDEX ? 3 : 4;
    qm_vec normal = {0, 0, 0}, origin = qm_vec_load(mesh->positions + 3 * (size_t)corner[0]);
    for (int k = 1; k + 1 < count && !before; k++) {
        qm_vec a = qm_vec_sub(qm_vec_load(mesh->positions + 3 * (size_t)corner[k]), origin);
        qm_vec b = qm_vec_sub(qm_vec_load(mesh->positions + 3 * (size_t)corner[k + 1]), origin);
        normal = qm_vec_add(normal, qm_vec_cross(a, b));
    }
    for (int k = 0; k < count && before; k++)
        normal = qm_vec_add(normal, normal_at(before, corner[k]));
    for (int k = 0; k < count; k++)
        sum[corner[k]] = qm_vec_add(sum[corner[k]], normal);
}

/** Sets normals at the vertices of a mesh: means of the faces round them, averaged further. QM_OK or QM_E_NO_MEMORY. */
static qm_status find_vertex_normals(qm_context *ctx, const qm_mesh *mesh, float *normals)
{
    qm_vec *sum = qm_context_alloc(ctx, mesh->vertex_count, sizeof *sum);
    if (!sum) return no_memory(ctx);
    for (int round = 0; round <= SMOOTHING; round++) {
        for (size_t i = 0; i < mesh->vertex_count; i++)
            sum[i] = (qm_vec){0, 0, 0};
        for (size_t face = 0; face < mesh->face_count; face++)
            add_face(mesh, face, round > 0 ? normals : NULL, sum);
        for (size_t i = 0; i < mesh->vertex_count; i++)
            store_unit(normals, i, sum[i]);
    }
    qm_context_free(ctx, sum, mesh->vertex_count, sizeof *sum);
    return QM_OK;
}

/** The smoothing of all points: each block writes its own. */
typedef struct smoothing {
    const qm_bvh *tree;
    const qm_ref_surface *surface; /* of the tree */
    const qm_noise_points *from;
    qm_noise_points *to;
    double sigma;
} smoothing;

/** The neighbours of a point, of its wall where normals tell. */
static void find_neighbours(const smoothing *s, qm_vec at, qm_vec own, qm_nearest_points *near)
{
    double length = qm_vec_norm(own);
    if (s->from->normals && length > 0.0) {
        qm_nearest_points_find_toward(s->tree, at, QM_NEAREST_POINTS_MAX, qm_vec_scale(1.0 / length, own),
                                      4.0, near);
        if (near->count >= QM_FIT_POINTS) return;
    }
    qm_nearest_points_find(s->tree, at, QM_NEAREST_POINTS_MAX, near);
}

/** Projects a point onto the surface of as many neighbours as the shape allows. False where they define none. */
static bool smooth_point(const smoothing *s, size_t i, qm_vec *position, qm_vec *normal)
{
    static const int sizes[SIZES] = {20, 32, 50, 80, 128};
    const double *p = s->from->positions + 3 * i;
    double scale = s->tree->frame.inverse_scale, low = -INFINITY, high = INFINITY;
    qm_vec at = qm_frame_local(&s->tree->frame, p), own = {0, 0, 0}, axis = {0, 0, 0};
    qm_nearest_points near;
    if (s->from->normals) own = normal_at(s->from->normals, i);
    find_neighbours(s, at, own, &near);
    bool is_found = false;
    int most = near.count;
    for (int k = 0; k < SIZES && (k == 0 || sizes[k] <= most); k++) {
        near.count = sizes[k] < most ? sizes[k] : most;
        bool is_last = k + 1 == SIZES || sizes[k + 1] > most;
        if (!is_last && sqrt(near.d2[near.count - 1]) * scale < MIN_REACH * s->sigma) continue;
        qm_ref_surface_point projection;
        qm_ref_surface_project_to_points(s->surface, at, &near, &projection);
        qm_vec found = qm_vec_load(projection.normal), to = qm_vec_load(projection.position);
        if (!(qm_vec_norm2(found) > 0.0)) continue;
        if (!is_found) axis = found;
        double height = qm_vec_dot(qm_vec_sub(to, qm_vec_load(p)), axis);
        double error = INTERVAL * s->sigma * sqrt(VARIANCE / near.count);
        low = fmax(low, height - error);
        high = fmin(high, height + error);
        if (low > high) break;
        is_found = true;
        *position = to;
        *normal = qm_vec_dot(found, axis) < 0.0 ? qm_vec_scale(-1.0, found) : found;
    }
    qm_vec side = own;
    for (int k = 0; k < most && k < sizes[0] && s->from->normals; k++)
        side = qm_vec_add(side, normal_at(s->from->normals, near.index[k]));
    if (qm_vec_dot(side, *normal) < 0.0) *normal = qm_vec_scale(-1.0, *normal);
    return is_found;
}

static void smooth_block(void *user, int worker, size_t block)
{
    (void)worker;
    const smoothing *s = user;
    size_t end = (block + 1) * BLOCK < s->from->count ? (block + 1) * BLOCK : s->from->count;
    for (size_t i = block * BLOCK; i < end; i++) {
        qm_vec position = qm_vec_load(s->from->positions + 3 * i), normal = {0, 0, 0};
        smooth_point(s, i, &position, &normal);
        qm_vec_store(s->to->positions + 3 * i, position);
        if (s->to->normals) store_unit(s->to->normals, i, normal);
    }
}

/** Copies the points of a surface: of a point set, or the vertices of a mesh. QM_OK or QM_E_NO_MEMORY. */
static qm_status load_points(qm_context *ctx, const qm_ref_surface *surface, size_t wanted,
                             qm_noise_points *out)
{
    const qm_mesh *mesh = qm_bvh_mesh(surface->bvh);
    if (surface->is_cloud)
        return qm_noise_points_thin(ctx, mesh->positions, mesh->normals, mesh->vertex_count, wanted, out);
    float *normals = qm_context_alloc(ctx, mesh->vertex_count, 3 * sizeof *normals);
    qm_status status = normals ? find_vertex_normals(ctx, mesh, normals) : no_memory(ctx);
    if (status == QM_OK)
        status = qm_noise_points_thin(ctx, mesh->positions, normals, mesh->vertex_count, wanted, out);
    qm_context_free(ctx, normals, mesh->vertex_count, 3 * sizeof *normals);
    return status;
}

/** Makes the smooth points of the data. */
static qm_status smooth_points(qm_context *ctx, qm_guide *guide, int thread_count)
{
    qm_noise_points from;
    qm_status status = qm_noise_points_thin(ctx, guide->data.positions, guide->data.normals,
                                            guide->data.count, GUIDE_POINTS, &from);
    if (status != QM_OK) return status;
    qm_bvh *tree = NULL;
    qm_ref_surface surface;
    status = qm_noise_points_build_tree(ctx, &from, thread_count, &tree);
    if (status == QM_OK) status = qm_ref_surface_init(ctx, tree, &surface);
    if (status == QM_OK && from.normals && !qm_noise_points_have_sides(&from, tree)) {
        qm_context_free(ctx, from.normals, from.capacity, 3 * sizeof *from.normals);
        from.normals = NULL;
    }
    if (status == QM_OK)
        status =
            qm_noise_points_thin(ctx, from.positions, from.normals, from.count, from.count, &guide->smooth);
    if (status == QM_OK) {
        smoothing s = {tree, &surface, &from, &guide->smooth, guide->sigma};
        qm_context_parallel_for(ctx, thread_count, (from.count + BLOCK - 1) / BLOCK, smooth_block, &s);
        if (qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "smoothing of points canceled");
    }
    qm_bvh_destroy(ctx, tree);
    qm_noise_points_reset(ctx, &from);
    return status;
}

/** Makes the guide of points that are known to be noisy. */
static qm_status make_guide(qm_context *ctx, const qm_ref_surface *surface, int thread_count, qm_guide *guide)
{
    qm_status status = load_points(ctx, surface, MAX_POINTS, &guide->data);
    bool *is_outlier = NULL;
    size_t outliers, capacity = guide->data.count;
    if (status == QM_OK && surface->is_cloud) {
        is_outlier = qm_context_alloc(ctx, capacity, sizeof *is_outlier);
        status = is_outlier ? qm_noise_find_outliers(ctx, &guide->data, guide->sigma, QM_OUTLIER_RATIO,
                                                     thread_count, is_outlier, &outliers)
                            : no_memory(ctx);
        if (status == QM_OK) qm_noise_points_drop(&guide->data, is_outlier);
        qm_context_free(ctx, is_outlier, capacity, sizeof *is_outlier);
    }
    if (status == QM_OK && surface->is_cloud)
        status = qm_noise_estimate_turn(ctx, &guide->data, thread_count, &guide->turn);
    if (status == QM_OK) status = smooth_points(ctx, guide, thread_count);
    if (status != QM_OK) return status;
    guide->cloud = (qm_mesh){.positions = guide->smooth.positions,
                             .vertex_count = guide->smooth.count,
                             .normals = guide->smooth.normals};
    status = qm_bvh_build(ctx, &guide->cloud, QM_BVH_TARGET, thread_count, &guide->tree);
    return status == QM_OK ? qm_ref_surface_init(ctx, guide->tree, &guide->surface) : status;
}

/** Finds the noise of a surface, and the share of its points that are outliers. */
static qm_status study(qm_context *ctx, const qm_ref_surface *surface, double share, int thread_count,
                       double *sigma, double *outliers)
{
    qm_noise_points points;
    qm_status status = load_points(ctx, surface, STUDY_POINTS, &points);
    if (status != QM_OK) return status;
    *sigma = share > 0.0 ? share * surface->diagonal : 0.0;
    if (share < 0.0) status = qm_noise_estimate(ctx, &points, surface->diagonal, thread_count, sigma);
    if (status == QM_OK && surface->is_cloud) {
        bool *is_outlier = qm_context_alloc(ctx, points.count, sizeof *is_outlier);
        size_t count = 0;
        status = is_outlier ? qm_noise_find_outliers(ctx, &points, *sigma, QM_OUTLIER_RATIO, thread_count,
                                                     is_outlier, &count)
                            : no_memory(ctx);
        qm_context_free(ctx, is_outlier, points.count, sizeof *is_outlier);
        *outliers = (double)count / (double)points.count;
    }
    qm_noise_points_reset(ctx, &points);
    return status;
}

qm_status qm_guide_create(qm_context *ctx, const qm_ref_surface *surface, double share, int thread_count,
                          qm_guide **out, double *outliers)
{
    QM_ASSERT(ctx && surface && out && outliers);
    double sigma;
    *out = NULL;
    *outliers = 0.0;
    qm_status status = study(ctx, surface, share, thread_count, &sigma, outliers);
    if (status != QM_OK || sigma == 0.0) return status;
    qm_guide *guide = qm_context_alloc(ctx, 1, sizeof *guide);
    if (!guide) return no_memory(ctx);
    *guide = (qm_guide){.sigma = sigma};
    atomic_init(&guide->owners, 1);
    status = make_guide(ctx, surface, thread_count, guide);
    if (status == QM_OK)
        *out = guide;
    else
        qm_guide_release(ctx, guide);
    return status;
}
