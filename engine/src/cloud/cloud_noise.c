/**
 * cloud_noise.c: how far the points of a surface are off it, and which of them belong to it.
 *
 * A surface of noise s looks the same from near and from twice as far: of a polynomial of second order that is fitted to a
 * neighbourhood the points are off by s, however wide it is. A surface without noise does not: its parts of higher order grow with
 * the third power of the radius. So the residuals of the same number of neighbours are taken among all points and among a
 * quarter of them, which is twice the radius, and are noise where they grow little.
 *
 * Two walls that are nearer to each other than their points look so too. They are told apart by normals, or by the distribution of the
 * residuals, which has two peaks then.
 *
 * A point is an outlier if it is off the surface of its neighbours, and farther from them than they are from theirs: in number the
 * local outlier factor, with the denser quarter of the neighbours. So it is if its neighbours are farther than is usual and are no surface: far outliers have others
 * for neighbours.
 *
 * Source: M. Breunig, H.-P. Kriegel, R. Ng, J. Sander, LOF: identifying density-based local outliers, 2000.
 */
#include "cloud_points.h"

#include <string.h>

#include "bvh/bvh_tree.h"
#include "bvh/nearest.h"
#include "core/linear.h"

#define MIN_POINTS 1600   /* in which four levels of detail cannot be told from noise */
#define PROBES 600        /* neighbourhoods that are fitted */
#define NEIGHBOURS 20     /* of a neighbourhood */
#define UNKNOWNS 6        /* of a polynomial of second order */
#define THINNING 4        /* times fewer points: twice the radius */
#define MAX_GROWTH 1.7    /* of the residuals with twice the radius: those of shape grow by 1.85 to 40 */
#define MAX_FLATNESS 0.22 /* of the residuals to the radius: above it the plane is no plane */
/* Of the residuals of 20 points from a polynomial: in the median 2.55 for a normal distribution, 2.24 for an even one, 1.84 for two
 * layers. */
#define MIN_KURTOSIS 2.05
#define REACH 4.0         /* local: the whole tree */
#define MIN_SIGMA 1e-4    /* of the diagonal: less is exact */
#define MIN_TURN 0.02     /* radians: that of normals in files of few digits, or of a surface that bends */
#define LEVELS 4          /* of thinning */
#define SPACING_POINTS 7  /* a point and its neighbours, whose distance is the spacing there */
#define GAP_RATIO 2.0     /* spacings: what is farther from all points is in a hole */
#define MIN_AGREEING 0.75 /* of neighbours, whose normals must agree for normals to be used */
#define MIN_BREADTH                                                                                          \
    1e-3 /* of the variances of neighbours along their first two axes: below it they lie on a line */
#define OUTLIER_NEIGHBOURS 8
#define OUTLIER_HEIGHT 1.0 /* above the neighbours' plane, in their distances */
#define MIN_ROUND 0.08     /* of the variance along the normal: those neighbours are no surface */
#define MAX_DEVIATIONS 4.0 /* of noise, by which a point of the surface may be off it */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the points of the surface");
}

void qm_noise_points_reset(qm_context *ctx, qm_noise_points *points)
{
    qm_context_free(ctx, points->positions, points->capacity, POINT_SIZE);
    qm_context_free(ctx, points->normals, points->capacity, 3 * sizeof *points->normals);
    *points = (qm_noise_points){0};
}

qm_status qm_noise_points_thin(qm_context *ctx, const double *positions, const float *normals, size_t count,
                               size_t wanted, qm_noise_points *out)
{
    /* Scans are stored line by line, so that points are chosen by a hash of the index. */
    double share = (double)wanted / (double)count;
    uint64_t limit = share >= 1.0 ? UINT64_C(1) << 32 : (uint64_t)(share * 0x1p32);
    size_t capacity = share >= 1.0 ? count : wanted + wanted / 8 + 64;
    *out = (qm_noise_points){.capacity = capacity};
    out->positions = qm_context_alloc(ctx, capacity, POINT_SIZE);
    if (normals) out->normals = qm_context_alloc(ctx, capacity, 3 * sizeof *out->normals);
    if (!out->positions || (normals && !out->normals)) {
        qm_noise_points_reset(ctx, out);
        return no_memory(ctx);
    }
    for (size_t i = 0; i < count && out->count < capacity; i++) {
        uint64_t x = ((uint64_t)i + 1) * UINT64_C(0x9e3779b97f4a7c15);
        x ^= x >> 32;
        x *= UINT64_C(0xd6e8feb86659fd93);
        if (x >> 32 >= limit) continue;
        memcpy(out->positions + 3 * out->count, positions + 3 * i, POINT_SIZE);
        if (normals) memcpy(out->normals + 3 * out->count, normals + 3 * i, 3 * sizeof *normals);
        out->count++;
    }
    return QM_OK;
}

void qm_noise_points_drop(qm_noise_points *points, const bool *is_marked)
{
    size_t kept = 0;
    for (size_t i = 0; i < points->count; i++) {
        if (is_marked[i]) continue;
        memmove(points->positions + 3 * kept, points->positions + 3 * i, POINT_SIZE);
        if (points->normals)
            memmove(points->normals + 3 * kept, points->normals + 3 * i, 3 * sizeof *points->normals);
        kept++;
    }
    points->count = kept;
}

qm_status qm_noise_points_build_tree(qm_context *ctx, const qm_noise_points *points, int thread_count,
                                     qm_bvh **out)
{
    const qm_mesh cloud = {
        .positions = points->positions, .vertex_count = points->count, .normals = points->normals};
    return qm_bvh_build(ctx, &cloud, QM_BVH_TARGET, thread_count, out);
}

bool qm_cloud_is_in_gap(const qm_bvh *tree, const double position[3])
{
    qm_nearest_points near, around;
    qm_nearest_points_find(tree, qm_frame_local(&tree->frame, position), 1, &near);
    qm_nearest_points_find(tree, near.position[0], SPACING_POINTS, &around);
    return near.d2[0] > GAP_RATIO * GAP_RATIO * around.d2[around.count - 1];
}

static qm_vec normal_at(const float *normals, size_t i)
{
    const float *row = normals + 3 * i;
    return (qm_vec){(double)row[0], (double)row[1], (double)row[2]};
}

bool qm_noise_points_have_sides(const qm_noise_points *points, const qm_bvh *tree)
{
    size_t along = 0, inside = 0, outside = 0, step = points->count / 2000 + 1;
    for (size_t i = 0; i < points->count; i += step) {
        qm_nearest_points near;
        qm_vec at = qm_frame_local(&tree->frame, points->positions + 3 * i),
               normal = normal_at(points->normals, i);
        qm_nearest_points_find(tree, at, NEIGHBOURS, &near);
        for (int k = 0; k < near.count; k++) {
            double dot = qm_vec_dot(normal, normal_at(points->normals, near.index[k])),
                   height = qm_vec_dot(normal, qm_vec_sub(near.position[k], at));
            along += dot > 0.0;
            inside += dot < 0.0 && height < 0.0;
            outside += dot < 0.0 && height >= 0.0;
        }
    }
    size_t against = inside + outside, walls = inside > outside ? inside - outside : outside - inside;
    return (double)(along + walls) > MIN_AGREEING * (double)(along + against);
}

/** What a polynomial over a neighbourhood leaves: the standard deviation of its points, as it is and to the radius, and their kurtosis. */
typedef struct probe {
    double residual, flatness, kurtosis;
} probe;

/** The principal axes of neighbours, the normal first, and the sums of squares along them. Returns the centroid. */
static qm_vec find_axes(const qm_nearest_points *near, double value[3], qm_vec axis[3])
{
    qm_vec centroid = qm_vec_centroid(near->position, near->count);
    double m[6] = {0};
    for (int i = 0; i < near->count; i++)
        qm_linear_add_products(m, qm_vec_sub(near->position[i], centroid));
    qm_linear_eigen(m, value, axis);
    return centroid;
}

/** Fits a polynomial over the plane of the neighbours. False where they do not define one. */
static bool fit_probe(const qm_nearest_points *near, probe *out)
{
    qm_vec axis[3];
    double value[3], x[QM_LEAST_SQUARES_MAX];
    qm_vec centroid = find_axes(near, value, axis);
    /* Of a disc, the variances along two axes are a quarter of the square of the radius each. */
    double radius = sqrt(2.0 * (value[1] + value[2]) / near->count), sum = 0.0, fourth = 0.0;
    if (!(radius > 0.0) || !(value[1] > MIN_BREADTH * value[2])) return false;
    qm_least_squares sums = {.count = UNKNOWNS};
    double row[NEIGHBOURS][UNKNOWNS], height[NEIGHBOURS];
    for (int i = 0; i < near->count; i++) {
        qm_vec d = qm_vec_scale(1.0 / radius, qm_vec_sub(near->position[i], centroid));
        double a = qm_vec_dot(d, axis[1]), b = qm_vec_dot(d, axis[2]);
        const double of[UNKNOWNS] = {1.0, a, b, a * a, a * b, b * b};
        memcpy(row[i], of, sizeof of);
        height[i] = qm_vec_dot(d, axis[0]);
        qm_linear_add(&sums, row[i], height[i], 1.0);
    }
    if (!qm_linear_solve(&sums, x)) return false;
    for (int i = 0; i < near->count; i++) {
        double rest = height[i];
        for (int k = 0; k < UNKNOWNS; k++)
            rest -= x[k] * row[i][k];
        sum += rest * rest;
        fourth += rest * rest * rest * rest;
    }
    out->kurtosis = sum > 0.0 ? near->count * fourth / (sum * sum) : 0.0;
    out->flatness = sqrt(sum / (near->count - UNKNOWNS));
    out->residual = out->flatness * radius;
    return true;
}

/** The median of values, which it sorts. */
static double find_median(double *value, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        double here = value[i];
        size_t slot = i;
        for (; slot > 0 && value[slot - 1] > here; slot--)
            value[slot] = value[slot - 1];
        value[slot] = here;
    }
    return value[count / 2];
}

/** The neighbours of a point, of those that look as it does where normals are known: the walls of a thin sheet are no noise. */
static void find_on_wall(const qm_bvh *tree, const qm_noise_points *points, size_t i, qm_nearest_points *near)
{
    qm_vec at = qm_frame_local(&tree->frame, points->positions + 3 * i), normal = {0, 0, 0};
    if (points->normals) {
        const float *row = points->normals + 3 * i;
        normal = (qm_vec){(double)row[0], (double)row[1], (double)row[2]};
    }
    double length = qm_vec_norm(normal);
    if (length > 0.0)
        qm_nearest_points_find_toward(tree, at, NEIGHBOURS, qm_vec_scale(1.0 / length, normal), REACH, near);
    else
        qm_nearest_points_find(tree, at, NEIGHBOURS, near);
}

/** Sets the median residual, in the unit of the points, and flatness of neighbourhoods. False without enough of them. */
static bool probe_level(const qm_bvh *tree, const qm_noise_points *points, probe *out)
{
    double residual[PROBES + 1], flatness[PROBES + 1], kurtosis[PROBES + 1];
    size_t count = 0, step = points->count / PROBES + 1;
    for (size_t i = 0; i < points->count; i += step) {
        qm_nearest_points near;
        probe at;
        find_on_wall(tree, points, i, &near);
        if (near.count < NEIGHBOURS || !fit_probe(&near, &at)) continue;
        kurtosis[count] = at.kurtosis;
        residual[count] = at.residual * tree->frame.inverse_scale;
        flatness[count++] = at.flatness;
    }
    if (2 * count < points->count / step) return false;
    *out = (probe){find_median(residual, count), find_median(flatness, count), find_median(kurtosis, count)};
    return true;
}

bool qm_noise_are_lines(const qm_noise_points *points, const qm_bvh *tree)
{
    size_t lines = 0, count = 0, step = points->count / PROBES + 1;
    for (size_t i = 0; i < points->count; i += step, count++) {
        qm_nearest_points near;
        qm_vec axis[3];
        double value[3];
        qm_nearest_points_find(tree, qm_frame_local(&tree->frame, points->positions + 3 * i), NEIGHBOURS,
                               &near);
        find_axes(&near, value, axis);
        lines += !(value[1] > MIN_BREADTH * value[2]);
    }
    return 2 * lines > count;
}

bool qm_noise_probe(const qm_noise_points *points, const qm_bvh *tree, double *residual, double *flatness)
{
    probe found;
    if (!probe_level(tree, points, &found)) return false;
    *residual = found.residual;
    *flatness = found.flatness;
    return true;
}

qm_status qm_noise_estimate(qm_context *ctx, const qm_noise_points *points, double diagonal, int thread_count,
                            double *sigma)
{
    probe last = {0};
    size_t wanted = points->count;
    *sigma = 0.0;
    for (int level = 0; level < LEVELS; level++, wanted /= THINNING) {
        if (wanted < MIN_POINTS / THINNING || (level == 0 && wanted < MIN_POINTS)) return QM_OK;
        qm_noise_points thin;
        qm_bvh *tree = NULL;
        qm_status status =
            qm_noise_points_thin(ctx, points->positions, points->normals, points->count, wanted, &thin);
        if (status == QM_OK) status = qm_noise_points_build_tree(ctx, &thin, thread_count, &tree);
        probe here = {0};
        bool is_known = status == QM_OK && probe_level(tree, &thin, &here);
        qm_bvh_destroy(ctx, tree);
        qm_noise_points_reset(ctx, &thin);
        if (status != QM_OK || !is_known) return status;
        if (level > 0 && last.flatness <= MAX_FLATNESS) {
            bool is_layered = last.kurtosis < MIN_KURTOSIS;
            if (here.residual <= MAX_GROWTH * last.residual && last.residual > MIN_SIGMA * diagonal &&
                !is_layered)
                *sigma = last.residual;
            return QM_OK;
        }
        last = here;
    }
    return QM_OK;
}

/** The standard deviation of the normals of neighbours from those of a surface of second order, which are linear over its plane. False
 * where they do not define one. */
static bool fit_normals(const float *normals, const qm_nearest_points *near, double *out)
{
    qm_vec axis[3];
    double value[3], x[3][QM_LEAST_SQUARES_MAX], sum = 0.0;
    qm_vec centroid = find_axes(near, value, axis);
    if (!(value[1] > MIN_BREADTH * value[2])) return false;
    qm_least_squares sums[3] = {{.count = 3}, {.count = 3}, {.count = 3}};
    double radius = sqrt(2.0 * (value[1] + value[2]) / near->count);
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < near->count; i++) {
            const float *row = normals + 3 * (size_t)near->index[i];
            qm_vec d = qm_vec_sub(near->position[i], centroid),
                   normal = {(double)row[0], (double)row[1], (double)row[2]};
            double length = qm_vec_norm(normal) * (qm_vec_dot(normal, axis[0]) < 0.0 ? -1.0 : 1.0);
            if (length == 0.0) return false;
            const double of[3] = {1.0, qm_vec_dot(d, axis[1]) / radius, qm_vec_dot(d, axis[2]) / radius};
            for (int k = 1; k < 3; k++) {
                double tilt = qm_vec_dot(normal, axis[k]) / length;
                if (pass == 0) {
                    qm_linear_add(&sums[k], of, tilt, 1.0);
                } else {
                    double rest = tilt - of[0] * x[k][0] - of[1] * x[k][1] - of[2] * x[k][2];
                    sum += rest * rest;
                }
            }
        }
        if (pass == 0 && (!qm_linear_solve(&sums[1], x[1]) || !qm_linear_solve(&sums[2], x[2]))) return false;
    }
    *out = sqrt(sum / (2.0 * (near->count - 3)));
    return true;
}

qm_status qm_noise_estimate_turn(qm_context *ctx, const qm_noise_points *points, int thread_count,
                                 double *turn)
{
    *turn = 0.0;
    if (!points->normals) return QM_OK;
    qm_bvh *tree = NULL;
    qm_status status = qm_noise_points_build_tree(ctx, points, thread_count, &tree);
    if (status != QM_OK) return status;
    double value[PROBES + 1];
    size_t count = 0, step = points->count / PROBES + 1;
    for (size_t i = 0; i < points->count; i += step) {
        qm_nearest_points near;
        qm_nearest_points_find(tree, qm_frame_local(&tree->frame, points->positions + 3 * i), NEIGHBOURS,
                               &near);
        if (near.count == NEIGHBOURS && fit_normals(points->normals, &near, &value[count])) count++;
    }
    if (2 * count > points->count / step) *turn = fmax(find_median(value, count), MIN_TURN);
    qm_bvh_destroy(ctx, tree);
    return QM_OK;
}

/** The distance of the densest points from their neighbours: of a quarter of those round a point. */
static double dense_reach(const float *reach, const qm_nearest_points *near)
{
    double value[QM_NEAREST_POINTS_MAX];
    for (int i = 0; i < near->count; i++)
        value[i] = (double)reach[near->index[i]];
    find_median(value, (size_t)near->count);
    return value[near->count / 4];
}

/** Removes the point itself from its neighbours: the nearest of no distance, or the last. */
static void remove_self(qm_nearest_points *near, uint32_t self)
{
    int at = 0;
    while (at + 1 < near->count && near->index[at] != self)
        at++;
    near->count--;
    for (; at < near->count; at++) {
        near->index[at] = near->index[at + 1];
        near->d2[at] = near->d2[at + 1];
        near->position[at] = near->position[at + 1];
    }
}

/** The passes over all points: the distance of each to its neighbours, then which are outliers. */
typedef struct outlier_search {
    const qm_bvh *tree;
    const qm_noise_points *points;
    double sigma; /* local */
    float *reach; /* local */
    double ratio; /* of the distance to the neighbours to theirs */
    double usual; /* the median of it */
    bool *is_outlier;
    bool marks;
} outlier_search;

enum { BLOCK = 1024 };

/** About the median distance of all points from their neighbours. */
static double usual_reach(const float *reach, size_t count)
{
    double value[PROBES + 1];
    size_t found = 0, step = count / PROBES + 1;
    for (size_t i = 0; i < count; i += step)
        value[found++] = (double)reach[i];
    return find_median(value, found);
}

static void search_block(void *user, int worker, size_t block)
{
    (void)worker;
    const outlier_search *s = user;
    size_t end = (block + 1) * BLOCK < s->points->count ? (block + 1) * BLOCK : s->points->count;
    for (size_t i = block * BLOCK; i < end; i++) {
        qm_nearest_points near;
        qm_vec at = qm_frame_local(&s->tree->frame, s->points->positions + 3 * i), axis[3];
        qm_nearest_points_find(s->tree, at, OUTLIER_NEIGHBOURS + 1, &near);
        remove_self(&near, (uint32_t)i);
        if (!s->marks) {
            s->reach[i] = (float)sqrt(near.d2[near.count - 1]);
            continue;
        }
        double theirs = dense_reach(s->reach, &near), value[3], own = (double)s->reach[i];
        s->is_outlier[i] = false;
        if (own <= s->ratio * fmin(theirs, s->usual)) continue;
        qm_vec centroid = find_axes(&near, value, axis);
        double height = fabs(qm_vec_dot(axis[0], qm_vec_sub(at, centroid)));
        bool is_off = own > s->ratio * theirs && height > OUTLIER_HEIGHT * theirs + MAX_DEVIATIONS * s->sigma;
        bool is_loose = own > s->ratio * s->usual && value[0] > MIN_ROUND * (value[0] + value[1] + value[2]);
        s->is_outlier[i] = is_off || is_loose;
    }
}

qm_status qm_noise_find_outliers(qm_context *ctx, const qm_noise_points *points, double sigma, double ratio,
                                 int thread_count, bool *is_outlier, size_t *count)
{
    *count = 0;
    memset(is_outlier, 0, points->count * sizeof *is_outlier);
    if (points->count < MIN_POINTS) return QM_OK;
    qm_bvh *tree = NULL;
    qm_status status = qm_noise_points_build_tree(ctx, points, thread_count, &tree);
    if (status != QM_OK) return status;
    outlier_search search = {.tree = tree,
                             .points = points,
                             .ratio = ratio,
                             .sigma = sigma * tree->frame.scale,
                             .reach = qm_context_alloc(ctx, points->count, sizeof(float)),
                             .is_outlier = is_outlier};
    if (!search.reach) status = no_memory(ctx);
    for (int pass = 0; pass < 2 && status == QM_OK; pass++) {
        search.marks = pass == 1;
        if (search.marks) search.usual = usual_reach(search.reach, points->count);
        qm_context_parallel_for(ctx, thread_count, (points->count + BLOCK - 1) / BLOCK, search_block,
                                &search);
        if (qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "smoothing of points canceled");
    }
    for (size_t i = 0; i < points->count && status == QM_OK; i++)
        *count += is_outlier[i];
    qm_context_free(ctx, search.reach, points->count, sizeof *search.reach);
    qm_bvh_destroy(ctx, tree);
    return status;
}
