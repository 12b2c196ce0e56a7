/**
 * layout_symmetry.c: planes of symmetry of a surface.
 *
 * For a plane, samples are mirrored and projected back. The plane that brings the samples nearest to these projections has the
 * eigenvector of the least eigenvalue of their symmetric cross covariance as its normal: the sum of the squared distances
 * |p - 2 (n . p) n - q|^2, both about their centroids, is constant but for 4 (n . p) (n . q). So the plane is improved, and the
 * samples are projected again (iterative closest points).
 */
#include "qm/symmetry.h"

#include <string.h>

#include "core/linear.h"
#include "core/vec.h"
#include "qm/hausdorff.h"
#include "ref_samples.h"

#define SAMPLES 1500
#define FEW 150          /* samples by which planes are compared at first */
#define DIRECTIONS 60    /* over the half sphere, beside the principal and the coordinate axes */
#define REFINED 8        /* of these planes are improved */
#define SOME 400         /* samples by which they are */
#define STILL 1e-6       /* radians, and of the diagonal: a plane that moves less is where it belongs */
#define ROUNDS 24        /* of that */
#define SAME_COSINE 0.99 /* between the normals of planes that are one */
#define TOLERANCE 0.05   /* of the accepted distance, in measuring it */
/* By how much a mirrored point is off its place, as a fraction of the largest coordinate L. With u = 2^-53: a difference from
 * the plane's point is 2 sqrt(3) L long at most, and its coordinates are off by 2 u L. Its product with the normal is off by
 * 2 sqrt(3) u L for these and 3 u 2 sqrt(3) L for three products and two sums, twice that is 28 u L along the normal. The step
 * and the last difference round by 9 u L. A normal that was divided by its length is a unit vector to 3 u, which
 * moves the image by 4 (3 u) 2 sqrt(3) L = 42 u L. Together 79 u L, less than 128. */
#define MIRROR_ERROR 0x1p-46

enum { POINT_SIZE = 3 * sizeof(double), CANDIDATES = 6 + DIRECTIONS };

typedef struct candidate {
    qm_vec point, normal;
    double error; /* mean of the squared distances of mirrored samples */
} candidate;

typedef struct search {
    qm_context *ctx;
    const qm_ref_surface *surface;
    double *samples; /* rows of x y z */
    size_t count;
} search;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for planes of symmetry");
}

static qm_vec mirror(const candidate *plane, qm_vec p)
{
    return qm_vec_axpy(p, -2.0 * qm_vec_dot(qm_vec_sub(p, plane->point), plane->normal), plane->normal);
}

static qm_status take_samples(search *s)
{
    const qm_mesh *mesh = qm_bvh_mesh(s->surface->bvh);
    s->samples = qm_context_alloc(s->ctx, SAMPLES, POINT_SIZE);
    if (!s->samples) return no_memory(s->ctx);
    if (!s->surface->is_cloud) {
        s->count = qm_ref_surface_sample(mesh, SAMPLES, s->samples, NULL);
        return QM_OK;
    }
    s->count = mesh->vertex_count < SAMPLES ? mesh->vertex_count : SAMPLES;
    for (size_t i = 0; i < s->count; i++)
        memcpy(s->samples + 3 * i,
               mesh->positions + 3 * (size_t)((double)i / (double)s->count * (double)mesh->vertex_count),
               POINT_SIZE);
    return QM_OK;
}

static qm_vec sample_at(const search *s, size_t i)
{
    return qm_vec_load(s->samples + 3 * i);
}

static qm_vec project_mirrored(const search *s, const candidate *plane, size_t i)
{
    double at[3];
    qm_ref_surface_point on;
    qm_vec_store(at, mirror(plane, sample_at(s, i)));
    qm_ref_surface_project(s->surface, at, &on);
    return qm_vec_load(on.position);
}

/** The mean of the squared distances of every step-th mirrored sample from the surface. */
static double measure(const search *s, const candidate *plane, size_t step)
{
    double sum = 0.0;
    size_t used = 0;
    for (size_t i = 0; i < s->count; i += step, used++)
        sum += qm_vec_norm2(qm_vec_sub(mirror(plane, sample_at(s, i)), project_mirrored(s, plane, i)));
    return used > 0 ? sum / (double)used : INFINITY;
}

/** Moves a plane to where some mirrored samples are nearest to where they project to now. True if it has moved. */
static bool improve(const search *s, candidate *plane)
{
    double m[6] = {0}, value[3];
    qm_vec vector[3], from = {0, 0, 0}, to = {0, 0, 0}, on[SOME + 1];
    size_t step = s->count / SOME + 1, used = 0;
    for (size_t i = 0; i < s->count; i += step, used++) {
        on[used] = project_mirrored(s, plane, i);
        from = qm_vec_add(from, sample_at(s, i));
        to = qm_vec_add(to, on[used]);
    }
    from = qm_vec_scale(1.0 / (double)used, from);
    to = qm_vec_scale(1.0 / (double)used, to);
    for (size_t i = 0; i < used; i++) {
        qm_vec p = qm_vec_sub(sample_at(s, i * step), from), q = qm_vec_sub(on[i], to);
        m[0] += p.x * q.x;
        m[1] += 0.5 * (p.x * q.y + p.y * q.x);
        m[2] += 0.5 * (p.x * q.z + p.z * q.x);
        m[3] += p.y * q.y;
        m[4] += 0.5 * (p.y * q.z + p.z * q.y);
        m[5] += p.z * q.z;
    }
    qm_linear_eigen(m, value, vector);
    candidate before = *plane;
    plane->normal = vector[0];
    plane->point = qm_vec_mix(from, to, 0.5);
    double shift = fabs(qm_vec_dot(qm_vec_sub(plane->point, before.point), plane->normal));
    return qm_vec_norm(qm_vec_cross(before.normal, plane->normal)) > STILL ||
           shift > STILL * s->surface->diagonal;
}

/** Makes planes through the centroid: across the principal axes, the coordinate axes, and directions over the half sphere
 * (a Fibonacci spiral). */
static void make_candidates(const search *s, candidate out[CANDIDATES])
{
    qm_vec centre = {0, 0, 0}, axis[3];
    double m[6] = {0}, value[3];
    for (size_t i = 0; i < s->count; i++)
        centre = qm_vec_axpy(centre, 1.0 / (double)s->count, sample_at(s, i));
    for (size_t i = 0; i < s->count; i++)
        qm_linear_add_products(m, qm_vec_sub(sample_at(s, i), centre));
    qm_linear_eigen(m, value, axis);
    const qm_vec along[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int k = 0; k < CANDIDATES; k++) {
        double z = (k - 6 + 0.5) / DIRECTIONS, turn = 2.399963229728653 * k,
               radius = sqrt(fmax(0.0, 1.0 - z * z));
        qm_vec spiral = {radius * cos(turn), radius * sin(turn), z};
        out[k] = (candidate){.point = centre, .normal = k < 3 ? axis[k] : k < 6 ? along[k - 3] : spiral};
        out[k].error = measure(s, &out[k], s->count / FEW + 1);
    }
}

static void sort_candidates(candidate *all, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        candidate moved = all[i];
        size_t k = i;
        for (; k > 0 && all[k - 1].error > moved.error; k--)
            all[k] = all[k - 1];
        all[k] = moved;
    }
}

/** Bounds the distance of a mesh from its mirror image: of both directions, which are one another's mirror images, one. */
static qm_status bound_distance(const search *s, const candidate *plane, double most, double bound[2])
{
    const qm_mesh *mesh = qm_bvh_mesh(s->surface->bvh);
    qm_mesh image = *mesh;
    qm_bvh *tree = NULL;
    double largest = 0.0;
    image.positions = qm_context_alloc(s->ctx, mesh->vertex_count, POINT_SIZE);
    if (!image.positions) return no_memory(s->ctx);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        qm_vec_store(image.positions + 3 * i, mirror(plane, qm_vec_load(mesh->positions + 3 * i)));
        for (size_t k = 0; k < 3; k++)
            largest = fmax(largest, fmax(fabs(mesh->positions[3 * i + k]), fabs(image.positions[3 * i + k])));
    }
    qm_hausdorff_options options = qm_hausdorff_options_default();
    qm_hausdorff_result result;
    options.direction = QM_A_TO_B;
    options.tolerance = TOLERANCE * most;
    qm_status status = qm_bvh_build(s->ctx, &image, QM_BVH_ALL, 1, &tree);
    if (status == QM_OK) status = qm_hausdorff_measure(s->ctx, tree, s->surface->bvh, &options, &result);
    if (status == QM_OK) {
        bound[0] = fmax(0.0, result.lower - MIRROR_ERROR * largest);
        bound[1] = result.upper + MIRROR_ERROR * largest;
    }
    qm_bvh_destroy(s->ctx, tree);
    qm_context_free(s->ctx, image.positions, mesh->vertex_count, POINT_SIZE);
    return status;
}

static qm_status accept(const search *s, candidate *plane, double most, qm_symmetry_plane *out, bool *is_good)
{
    double bound[2] = {0.0, 0.0};
    qm_status status = QM_OK;
    plane->normal = qm_vec_scale(1.0 / qm_vec_norm(plane->normal), plane->normal);
    if (s->surface->is_cloud) {
        for (size_t i = 0; i < s->count; i++)
            bound[0] = fmax(bound[0],
                            qm_vec_distance(mirror(plane, sample_at(s, i)), project_mirrored(s, plane, i)));
        bound[1] = bound[0];
    } else {
        status = bound_distance(s, plane, most, bound);
    }
    *is_good = status == QM_OK && bound[1] <= most;
    qm_vec_store(out->point, plane->point);
    qm_vec_store(out->normal, plane->normal);
    out->lower = bound[0];
    out->upper = bound[1];
    return status;
}

static qm_status find_planes(search *s, double most, qm_symmetry_plane out[QM_SYMMETRY_PLANES], size_t *count)
{
    candidate all[CANDIDATES];
    make_candidates(s, all);
    sort_candidates(all, CANDIDATES);
    for (size_t i = 0; i < REFINED; i++) {
        if (qm_context_canceled(s->ctx)) return qm_context_fail(s->ctx, QM_E_CANCELED, "symmetry canceled");
        for (int round = 0; round < ROUNDS && improve(s, &all[i]); round++)
            continue;
        all[i].error = measure(s, &all[i], 1);
    }
    sort_candidates(all, REFINED);
    qm_status status = QM_OK;
    for (size_t i = 0; i < REFINED && *count < QM_SYMMETRY_PLANES && status == QM_OK; i++) {
        bool is_new = all[i].error <= most * most, is_good;
        for (size_t k = 0; k < *count; k++)
            is_new = is_new && fabs(qm_vec_dot(qm_vec_load(out[k].normal), all[i].normal)) < SAME_COSINE;
        if (!is_new) continue;
        status = accept(s, &all[i], most, &out[*count], &is_good);
        *count += status == QM_OK && is_good;
    }
    return status;
}

qm_status qm_symmetry_find(qm_context *ctx, const qm_ref_surface *surface, double share,
                           qm_symmetry_plane out[QM_SYMMETRY_PLANES], size_t *count)
{
    QM_ASSERT(ctx && surface && out && count);
    *count = 0;
    if (!(share > 0.0) || !isfinite(share))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the share of the diagonal must be above 0");
    search s = {.ctx = ctx, .surface = surface};
    qm_status status = take_samples(&s);
    if (status == QM_OK && s.count > 0) status = find_planes(&s, share * surface->diagonal, out, count);
    qm_context_free(ctx, s.samples, SAMPLES, POINT_SIZE);
    return status;
}
