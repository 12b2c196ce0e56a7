/**
 * cloud_surface.c: from points to triangles: which points count, which way they look, and the order of the stages.
 */
#include "qm/cloud.h"

#include <stdlib.h>
#include <string.h>

#include "bvh/bvh_tree.h"
#include "cloud_levels.h"
#include "cloud_points.h"
#include "cloud_trim.h"
#include "layout/ref_points.h"

#define MOST_POINTS 262144 /* more are thinned: the quads are coarser than these */
#define MIN_POINTS 16      /* fewer are no surface */
#define CELL 1.5           /* side of the finest cells, in spacings of the points */
#define SPACING 0.7236     /* of the distance to the sixth neighbour: sqrt(pi / 6), where points lie evenly */
#define NEIGHBOURS 7       /* a point and six others */
#define PROBES 2000        /* points of which the spacing is the median */
#define OUTLIER_RATIO 2.0  /* of the distance to the neighbours to theirs */
#define OUTLIER_ROUNDS 2   /* where outliers had outliers for neighbours */
#define MOST_REACH 5.0 /* medians of the distance to the sixth neighbour: sparser points vouch for no more */
#define FINER 2        /* times that cells are halved where walls are near to each other */
#define MOST_THIN 0.01 /* of the points, on walls that cells do not tell apart */
#define MAX_FLATNESS 0.22 /* of the distance of points from the surface of 20 neighbours to its radius */
#define HOLE 0.15         /* of the diagonal: larger holes are ends of the surface */
#define FADING 0.5        /* of the distance in which vertices at holes are drawn to points less and less */
#define MAX_MOVE 1.0      /* cells by which a vertex moves at most to come onto the points */
#define NORMAL_POINTS 32  /* of which estimated normals become those of the polynomial */
#define MIN_AGREEING 0.5  /* cosine between a vertex's normal and that of the points */

enum { POINT_SIZE = 3 * sizeof(double), NORMAL_SIZE = 3 * sizeof(float), BLOCK = 512 };

qm_cloud_options qm_cloud_options_default(void)
{
    return (qm_cloud_options){-1.0, 1};
}

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a surface of points");
}

static qm_status canceled(qm_context *ctx)
{
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "surface of points canceled")
                                    : QM_OK;
}

/** The points that count, as they are used, and what is made of them. */
typedef struct cloud_work {
    qm_noise_points points; /* world; with normals of length 1 in the end */
    qm_bvh *tree;
    qm_vec *position, *normal; /* local; capacity points.count */
    size_t oriented_count;
    float *reach; /* local distance from each point to its sixth neighbour */
    qm_cloud_level level;
    qm_cloud_triangles triangles;
    qm_cloud_place *place; /* of the vertices */
    size_t place_capacity;
    double cell; /* local */
} cloud_work;

static void free_work(qm_context *ctx, cloud_work *w)
{
    qm_context_free(ctx, w->position, w->oriented_count, sizeof *w->position);
    qm_context_free(ctx, w->normal, w->oriented_count, sizeof *w->normal);
    qm_context_free(ctx, w->reach, w->oriented_count, sizeof *w->reach);
    qm_context_free(ctx, w->place, w->place_capacity, sizeof *w->place);
    qm_cloud_triangles_reset(ctx, &w->triangles);
    qm_cloud_level_reset(ctx, &w->level);
    qm_bvh_destroy(ctx, w->tree);
    qm_noise_points_reset(ctx, &w->points);
}

static void drop_normals(qm_context *ctx, qm_noise_points *points)
{
    qm_context_free(ctx, points->normals, points->capacity, NORMAL_SIZE);
    points->normals = NULL;
}

/* ---- which points count ---- */

/** Makes the tree of the points anew. */
static qm_status build_tree(qm_context *ctx, cloud_work *w, int thread_count)
{
    qm_bvh_destroy(ctx, w->tree);
    w->tree = NULL;
    return qm_noise_points_build_tree(ctx, &w->points, thread_count, &w->tree);
}

/** Marks all points but one of each place. The lowest index stays, which is the first that the search finds. */
static void mark_copies(const cloud_work *w, bool *is_copy)
{
    for (size_t i = 0; i < w->points.count; i++) {
        qm_nearest_points near;
        qm_nearest_points_find(w->tree, qm_frame_local(&w->tree->frame, w->points.positions + 3 * i), 1,
                               &near);
        is_copy[i] = near.count > 0 && near.index[0] != i &&
                     memcmp(w->points.positions + 3 * i, w->points.positions + 3 * (size_t)near.index[0],
                            POINT_SIZE) == 0;
    }
}

/** Drops points that are there twice: the neighbours of a point would be its copies. */
static qm_status drop_copies(qm_context *ctx, cloud_work *w, int thread_count)
{
    size_t count = w->points.count;
    bool *is_copy = qm_context_alloc(ctx, count, sizeof *is_copy);
    qm_status status = is_copy ? build_tree(ctx, w, thread_count) : no_memory(ctx);
    if (status == QM_OK) {
        mark_copies(w, is_copy);
        qm_noise_points_drop(&w->points, is_copy);
        if (w->points.count < count) status = build_tree(ctx, w, thread_count);
    }
    qm_context_free(ctx, is_copy, count, sizeof *is_copy);
    return status;
}

/** Replaces the points by the smooth ones of a guide. */
static qm_status take_guide(qm_context *ctx, cloud_work *w, const qm_guide *guide)
{
    const qm_mesh *smooth = qm_bvh_mesh(qm_guide_surface(guide)->bvh);
    qm_noise_points points;
    qm_status status = qm_noise_points_thin(ctx, smooth->positions, smooth->normals, smooth->vertex_count,
                                            smooth->vertex_count, &points);
    if (status != QM_OK) return status;
    qm_noise_points_reset(ctx, &w->points);
    w->points = points;
    return QM_OK;
}

/** Drops points off the surface of the others, with less doubt than is told of: without a few points of it the surface is the same. */
static qm_status drop_outliers(qm_context *ctx, cloud_work *w, int thread_count)
{
    qm_status status = QM_OK;
    for (int round = 0; round < OUTLIER_ROUNDS && status == QM_OK; round++) {
        size_t count = w->points.count, outliers;
        bool *is_outlier = qm_context_alloc(ctx, count, sizeof *is_outlier);
        status = is_outlier ? qm_noise_find_outliers(ctx, &w->points, 0.0, OUTLIER_RATIO, thread_count,
                                                     is_outlier, &outliers)
                            : no_memory(ctx);
        if (status == QM_OK) qm_noise_points_drop(&w->points, is_outlier);
        qm_context_free(ctx, is_outlier, count, sizeof *is_outlier);
    }
    return status;
}

/** Takes the smooth points of a guide, or drops outliers where the points are exact. */
static qm_status clean_points(qm_context *ctx, cloud_work *w, double noise_share, int thread_count,
                              qm_cloud_record *record)
{
    qm_guide *guide = NULL;
    double outliers, turn;
    qm_ref_surface given;
    size_t count = w->points.count;
    qm_status status = qm_ref_surface_init(ctx, w->tree, &given);
    if (status == QM_OK) status = qm_guide_create(ctx, &given, noise_share, thread_count, &guide, &outliers);
    if (status == QM_OK && guide) {
        qm_guide_points(guide, &record->noise, &turn);
        record->outliers += (size_t)(outliers * (double)count + 0.5);
        status = take_guide(ctx, w, guide);
    } else if (status == QM_OK) {
        status = drop_outliers(ctx, w, thread_count);
        record->outliers += count - w->points.count;
    }
    qm_guide_release(ctx, guide);
    return status == QM_OK ? build_tree(ctx, w, thread_count) : status;
}

/** True if most points lie beside the surfaces of their neighbours as much as along them. */
static bool are_scattered(const cloud_work *w, double *residual)
{
    double flatness;
    return qm_noise_probe(&w->points, w->tree, residual, &flatness) && flatness > MAX_FLATNESS;
}

/** Takes the points without copies, outliers and noise. Noise as wide as the spacing of the points is not found, as it cannot be told from
 * shape: without normals it is taken for noise, and if no surface comes of it then the points fill space. */
static qm_status choose_points(qm_context *ctx, const qm_ref_surface *cloud, const qm_cloud_options *options,
                               cloud_work *w, qm_cloud_record *record)
{
    const qm_mesh *mesh = qm_bvh_mesh(cloud->bvh);
    double residual;
    qm_status status = qm_noise_points_thin(ctx, mesh->positions, mesh->normals, mesh->vertex_count,
                                            MOST_POINTS, &w->points);
    if (status == QM_OK) status = drop_copies(ctx, w, options->thread_count);
    if (status == QM_OK && w->points.count < MIN_POINTS)
        status = qm_context_fail(ctx, QM_E_EMPTY, "%zu points at different places are too few for a surface",
                                 w->points.count);
    if (status == QM_OK && qm_noise_are_lines(&w->points, w->tree))
        status = qm_context_fail(ctx, QM_E_EMPTY, "the points lie along lines: no surface runs through them");
    size_t count = w->points.count;
    if (status == QM_OK) status = clean_points(ctx, w, options->noise_share, options->thread_count, record);
    bool has_normals =
        status == QM_OK && w->points.normals && qm_noise_points_have_sides(&w->points, w->tree);
    if (status == QM_OK && !has_normals && options->noise_share < 0.0 && are_scattered(w, &residual)) {
        status = clean_points(ctx, w, residual / cloud->diagonal, options->thread_count, record);
        if (status == QM_OK && are_scattered(w, &residual))
            status = qm_context_fail(ctx, QM_E_EMPTY, "the points fill space: no surface runs through them");
    }
    record->points = count - record->outliers;
    return status;
}

/* ---- which way they look ---- */

/** Estimates normals, and gives them to the points. */
static qm_status estimate_normals(qm_context *ctx, cloud_work *w)
{
    size_t count = w->points.count;
    qm_ref_surface surface;
    double *normals = qm_context_alloc(ctx, count, POINT_SIZE);
    w->points.normals = qm_context_alloc(ctx, w->points.capacity, NORMAL_SIZE);
    qm_status status = normals && w->points.normals ? QM_OK : no_memory(ctx);
    if (status == QM_OK) status = qm_ref_surface_init(ctx, w->tree, &surface);
    if (status == QM_OK) status = qm_ref_surface_estimate_normals(ctx, &surface, normals);
    for (size_t i = 0; i < 3 * count && status == QM_OK; i++)
        w->points.normals[i] = (float)normals[i];
    qm_context_free(ctx, normals, count, POINT_SIZE);
    return status;
}

/** What becomes of estimated normals: those of the polynomial through more points of the same wall. */
typedef struct normal_work {
    const cloud_work *work;
    const qm_ref_surface *surface;
    float *to;
} normal_work;

static void smooth_normals(void *user, int worker, size_t block)
{
    (void)worker;
    const normal_work *n = user;
    const cloud_work *w = n->work;
    size_t end = (block + 1) * BLOCK < w->points.count ? (block + 1) * BLOCK : w->points.count;
    for (size_t i = block * BLOCK; i < end; i++) {
        const float *row = w->points.normals + 3 * i;
        qm_vec normal = {(double)row[0], (double)row[1], (double)row[2]};
        qm_vec at = qm_frame_local(&w->tree->frame, w->points.positions + 3 * i);
        qm_nearest_points near = {0};
        if (qm_vec_norm2(normal) > 0.0)
            qm_nearest_points_find_toward(w->tree, at, NORMAL_POINTS, normal, 4.0, &near);
        if (near.count == NORMAL_POINTS) {
            qm_ref_surface_point projection;
            qm_ref_surface_project_to_points(n->surface, at, &near, &projection);
            qm_vec found = qm_vec_load(projection.normal);
            double cosine = qm_vec_dot(found, normal);
            if (fabs(cosine) > MIN_AGREEING) normal = qm_vec_scale(cosine > 0.0 ? 1.0 : -1.0, found);
        }
        n->to[3 * i] = (float)normal.x;
        n->to[3 * i + 1] = (float)normal.y;
        n->to[3 * i + 2] = (float)normal.z;
    }
}

/** Replaces estimated normals by smoother ones. */
static qm_status improve_normals(qm_context *ctx, cloud_work *w, int thread_count)
{
    size_t count = w->points.count;
    qm_ref_surface surface;
    normal_work n = {w, &surface, qm_context_alloc(ctx, w->points.capacity, NORMAL_SIZE)};
    qm_status status = n.to ? qm_ref_surface_init(ctx, w->tree, &surface) : no_memory(ctx);
    if (status == QM_OK)
        qm_context_parallel_for(ctx, thread_count, (count + BLOCK - 1) / BLOCK, smooth_normals, &n);
    if (status == QM_OK) memcpy(w->points.normals, n.to, count * NORMAL_SIZE);
    qm_context_free(ctx, n.to, w->points.capacity, NORMAL_SIZE);
    return status;
}

/** Fills the local copies of points and unit normals. */
static qm_status copy_points(qm_context *ctx, cloud_work *w)
{
    size_t count = w->oriented_count = w->points.count, known = 0;
    w->position = qm_context_alloc(ctx, count, sizeof *w->position);
    w->normal = qm_context_alloc(ctx, count, sizeof *w->normal);
    w->reach = qm_context_alloc(ctx, count, sizeof *w->reach);
    if (!w->position || !w->normal || !w->reach) return no_memory(ctx);
    for (size_t i = 0; i < count; i++) {
        float *row = w->points.normals + 3 * i;
        qm_vec normal = {(double)row[0], (double)row[1], (double)row[2]};
        double length = qm_vec_norm(normal);
        w->normal[i] = length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
        w->position[i] = qm_frame_local(&w->tree->frame, w->points.positions + 3 * i);
        known += length > 0.0;
    }
    if (known < MIN_POINTS)
        return qm_context_fail(ctx, QM_E_EMPTY, "the points lie on a line: they are no surface");
    return QM_OK;
}

/** Sees to it that all points have normals that agree. */
static qm_status orient(qm_context *ctx, cloud_work *w, int thread_count, qm_cloud_record *record)
{
    qm_status status = QM_OK;
    record->has_own_normals = w->points.normals && qm_noise_points_have_sides(&w->points, w->tree);
    if (!record->has_own_normals) {
        drop_normals(ctx, &w->points);
        status = estimate_normals(ctx, w);
        if (status == QM_OK) status = build_tree(ctx, w, thread_count);
        if (status == QM_OK) status = improve_normals(ctx, w, thread_count);
    }
    return status == QM_OK ? copy_points(ctx, w) : status;
}

/* ---- how dense they are ---- */

static void find_reach(void *user, int worker, size_t block)
{
    (void)worker;
    const cloud_work *w = user;
    size_t end = (block + 1) * BLOCK < w->points.count ? (block + 1) * BLOCK : w->points.count;
    for (size_t i = block * BLOCK; i < end; i++) {
        qm_nearest_points near;
        qm_nearest_points_find(w->tree, w->position[i], NEIGHBOURS, &near);
        w->reach[i] = (float)sqrt(near.d2[near.count - 1]);
    }
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void run_blocks(qm_context *ctx, int thread_count, size_t count, cloud_work *w,
                       void (*task)(void *user, int worker, size_t block))
{
    qm_context_parallel_for(ctx, thread_count, (count + BLOCK - 1) / BLOCK, task, w);
}

/** Finds the distance of each point from its neighbours, and the side of the cells. */
static qm_status measure_spacing(qm_context *ctx, cloud_work *w, int thread_count, qm_cloud_record *record)
{
    double sorted[PROBES + 1];
    size_t found = 0, step = w->points.count / PROBES + 1;
    run_blocks(ctx, thread_count, w->points.count, w, find_reach);
    for (size_t i = 0; i < w->points.count; i += step)
        sorted[found++] = (double)w->reach[i];
    qsort(sorted, found, sizeof *sorted, compare_doubles);
    double spacing = SPACING * sorted[found / 2];
    float most = (float)(MOST_REACH * sorted[found / 2]);
    for (size_t i = 0; i < w->points.count; i++)
        if (w->reach[i] > most) w->reach[i] = most;
    record->spacing = spacing * w->tree->frame.inverse_scale;
    w->cell = CELL * spacing;
    return canceled(ctx);
}

/* ---- vertices come onto the points ---- */

/** Sets sums of the normals of the triangles round each vertex. */
static void sum_normals(const qm_cloud_triangles *triangles, qm_vec *sum)
{
    for (size_t v = 0; v < triangles->vertex_count; v++)
        sum[v] = (qm_vec){0, 0, 0};
    for (size_t i = 0; i < triangles->count; i++) {
        const uint32_t *c = triangles->corner[i];
        qm_vec a = qm_vec_sub(triangles->position[c[1]], triangles->position[c[0]]),
               b = qm_vec_sub(triangles->position[c[2]], triangles->position[c[0]]);
        for (int k = 0; k < 3; k++)
            sum[c[k]] = qm_vec_add(sum[c[k]], qm_vec_cross(a, b));
    }
}

typedef struct mover {
    cloud_work *work;
    const qm_ref_surface *surface;
    const qm_vec *normal; /* of the vertices, of any length */
} mover;

/** Moves a vertex onto the surface of the points of its own wall, less and less towards holes. */
static void move_vertex(const mover *m, size_t v)
{
    cloud_work *w = m->work;
    qm_vec p = w->triangles.position[v], normal = m->normal[v];
    qm_nearest_points near = {0};
    double length = qm_vec_norm(normal);
    if (length > 0.0) {
        normal = qm_vec_scale(1.0 / length, normal);
        qm_nearest_points_find_toward(w->tree, p, QM_FIT_POINTS, normal, 4.0, &near);
    }
    bool has_wall = near.count >= QM_FIT_POINTS / 2;
    if (!has_wall) qm_nearest_points_find(w->tree, p, 1, &near);
    double away = sqrt(near.d2[0]) / fmax((double)w->reach[near.index[0]], 1e-30), lean = 1.0;
    if (has_wall)
        lean = qm_vec_distance(qm_vec_centroid(near.position, near.count), p) / sqrt(near.d2[near.count - 1]);
    w->place[v] = (qm_cloud_place){near.index[0], (float)away, (float)lean};
    double share = qm_clamp((QM_CLOUD_GAP - away) / FADING, 0.0, 1.0);
    if (!has_wall || !(share > 0.0)) return;
    qm_ref_surface_point projection;
    qm_ref_surface_project_to_points(m->surface, p, &near, &projection);
    qm_vec to = qm_frame_local(&w->tree->frame, projection.position), found = qm_vec_load(projection.normal);
    if (qm_vec_distance(to, p) > MAX_MOVE * w->cell || fabs(qm_vec_dot(found, normal)) < MIN_AGREEING) return;
    w->triangles.position[v] = qm_vec_mix(p, to, share);
}

static void move_block(void *user, int worker, size_t block)
{
    (void)worker;
    const mover *m = user;
    size_t count = m->work->triangles.vertex_count,
           end = (block + 1) * BLOCK < count ? (block + 1) * BLOCK : count;
    for (size_t v = block * BLOCK; v < end; v++)
        move_vertex(m, v);
}

static qm_status move_vertices(qm_context *ctx, cloud_work *w, int thread_count)
{
    size_t count = w->triangles.vertex_count;
    qm_ref_surface surface;
    w->place_capacity = count;
    w->place = qm_context_alloc(ctx, count, sizeof *w->place);
    qm_vec *normal = qm_context_alloc(ctx, count, sizeof *normal);
    qm_status status = w->place && normal ? qm_ref_surface_init(ctx, w->tree, &surface) : no_memory(ctx);
    if (status == QM_OK) {
        sum_normals(&w->triangles, normal);
        const mover m = {w, &surface, normal};
        qm_context_parallel_for(ctx, thread_count, (count + BLOCK - 1) / BLOCK, move_block,
                                (void *)(uintptr_t)&m);
        status = canceled(ctx);
    }
    qm_context_free(ctx, normal, count, sizeof *normal);
    return status;
}

/* ---- the mesh ---- */

/** Six times the volume inside; of an open surface that between it and the mean of its vertices, so that it looks away from there. */
static double enclosed_volume(const qm_cloud_triangles *triangles)
{
    double sum = 0.0;
    qm_vec mean = {0, 0, 0};
    for (size_t v = 0; v < triangles->vertex_count; v++)
        mean = qm_vec_axpy(mean, 1.0 / (double)triangles->vertex_count, triangles->position[v]);
    for (size_t i = 0; i < triangles->count; i++) {
        const uint32_t *c = triangles->corner[i];
        qm_vec corner[3];
        for (int k = 0; k < 3; k++)
            corner[k] = qm_vec_sub(triangles->position[c[k]], mean);
        sum += qm_vec_dot(corner[0], qm_vec_cross(corner[1], corner[2]));
    }
    return sum;
}

static qm_status make_mesh(qm_context *ctx, const cloud_work *w, bool is_turned, qm_mesh *out)
{
    const qm_cloud_triangles *all = &w->triangles;
    *out = (qm_mesh){.vertex_count = all->vertex_count, .face_count = all->count};
    out->positions = qm_context_alloc(ctx, all->vertex_count, POINT_SIZE);
    out->faces = qm_context_alloc(ctx, all->count, 4 * sizeof *out->faces);
    if (!out->positions || !out->faces) {
        qm_mesh_reset(ctx, out);
        return no_memory(ctx);
    }
    for (size_t v = 0; v < all->vertex_count; v++)
        qm_vec_store(out->positions + 3 * v, qm_frame_world(&w->tree->frame, all->position[v]));
    for (size_t i = 0; i < all->count; i++) {
        const uint32_t row[4] = {all->corner[i][0], all->corner[i][is_turned ? 2 : 1],
                                 all->corner[i][is_turned ? 1 : 2], QM_NO_INDEX};
        memcpy(out->faces + 4 * i, row, sizeof row);
    }
    return QM_OK;
}

/** Gives the points the normals as they were turned, and takes the side of the cells as it was chosen. The tree only reads them. */
static void keep_normals(cloud_work *w, qm_cloud_record *record)
{
    w->cell = w->level.grid.side;
    record->thin_share = (double)w->level.thin / (double)w->oriented_count;
    for (size_t i = 0; i < w->oriented_count; i++) {
        float *row = w->points.normals + 3 * i;
        row[0] = (float)w->normal[i].x;
        row[1] = (float)w->normal[i].y;
        row[2] = (float)w->normal[i].z;
    }
}

/** Finds the function of the points: where known normals cancel in cells, as those of two walls do, in cells of half the side, and again. */
static qm_status solve_field(qm_context *ctx, cloud_work *w, qm_cloud_record *record)
{
    static const uint64_t rings[FINER + 1] = {1, 1, 2};
    qm_status status = QM_OK;
    for (int k = 0; k <= FINER && status == QM_OK; k++, w->cell *= 0.5) {
        const qm_cloud_points points = {w->oriented_count, w->position, w->normal, rings[k],
                                        record->has_own_normals};
        qm_cloud_level_reset(ctx, &w->level);
        status = qm_cloud_levels_solve(ctx, &points, w->cell, &w->level);
        if (status == QM_OK) keep_normals(w, record);
        if (!record->has_own_normals || record->thin_share <= MOST_THIN) break;
    }
    return status;
}

/** QM_OK while there are triangles. */
static qm_status check_surface(qm_context *ctx, const cloud_work *w, const qm_cloud_record *record)
{
    if (w->triangles.count > 0) return QM_OK;
    if (record->thin_share > 0.5)
        return qm_context_fail(ctx, QM_E_EMPTY,
                               "the points lie on walls that are nearer to each other than the points");
    return qm_context_fail(ctx, QM_E_EMPTY, "no surface runs through the points");
}

static qm_status make(qm_context *ctx, const qm_ref_surface *cloud, const qm_cloud_options *options,
                      cloud_work *w, qm_mesh *out, qm_cloud_record *record)
{
    int threads = options->thread_count;
    qm_status status = choose_points(ctx, cloud, options, w, record);
    if (status == QM_OK) status = orient(ctx, w, threads, record);
    if (status == QM_OK) status = measure_spacing(ctx, w, threads, record);
    if (status == QM_OK) status = solve_field(ctx, w, record);
    if (status == QM_OK) status = qm_cloud_isosurface(ctx, &w->level.grid, w->level.field, &w->triangles);
    qm_cloud_level_reset(ctx, &w->level);
    if (status == QM_OK) status = check_surface(ctx, w, record);
    if (status == QM_OK) status = move_vertices(ctx, w, threads);
    double hole = status == QM_OK ? HOLE * cloud->diagonal * w->tree->frame.scale : 0.0;
    if (status == QM_OK)
        status = qm_cloud_trim(ctx, &w->triangles, w->place, w->oriented_count, hole, record);
    if (status == QM_OK) status = qm_cloud_close(ctx, &w->triangles, hole, record);
    bool is_turned = status == QM_OK && !record->has_own_normals && enclosed_volume(&w->triangles) < 0.0;
    return status == QM_OK ? make_mesh(ctx, w, is_turned, out) : status;
}

qm_status qm_cloud_make_surface(qm_context *ctx, const qm_ref_surface *cloud, const qm_cloud_options *options,
                                qm_mesh *out, qm_cloud_record *record)
{
    QM_ASSERT(ctx && cloud && options && options->thread_count >= 1 && out);
    qm_cloud_record ignored;
    if (!record) record = &ignored;
    *record = (qm_cloud_record){0};
    *out = (qm_mesh){0};
    if (!cloud->is_cloud) return qm_context_fail(ctx, QM_E_ARGUMENT, "the surface is a mesh already");
    cloud_work w = {0};
    qm_status status = make(ctx, cloud, options, &w, out, record);
    free_work(ctx, &w);
    return status;
}
