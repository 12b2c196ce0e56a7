/*
 * The nearest points of a point set, the nearest point of the faces that look one way, and the triangles within a reach,
 * each against a look at all of them. Query points lie in the set, near it and far outside, where the boxes' distances
 * are rounded most.
 */
#include "check.h"

#include "bvh/nearest.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { QUERIES = 40, POINTS_MAX = 700, TRIANGLES_MAX = 4000 };
#define ROUNDING 1e-12 /* of a distance, in sizes of the set and of the query point's distance from it */

/** A query point: of the set, beside it, or up to 100 sizes away. */
static void draw_query(const qm_mesh *mesh, qm_random *random, double p[3])
{
    const double *at = mesh->positions + 3 * qm_random_below(random, mesh->vertex_count);
    double away = (double[]){0, exp2(qm_random_range(random, -30, 0)),
                             qm_random_range(random, 1, 100)}[qm_random_below(random, 3)];
    double off[3];
    qm_random_direction(random, off);
    for (int k = 0; k < 3; k++)
        p[k] = at[k] + away * off[k];
}

static double point_distance(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static double slack(const double p[3])
{
    return ROUNDING * (3.0 + fabs(p[0]) + fabs(p[1]) + fabs(p[2]));
}

static void world_position(const qm_frame *frame, qm_vec local, double out[3])
{
    qm_vec world = qm_frame_world(frame, local);
    out[0] = world.x;
    out[1] = world.y;
    out[2] = world.z;
}

/* ---- points ---- */

typedef struct candidate {
    double distance;
    uint32_t index;
} candidate;

static int compare_candidates(const void *a, const void *b)
{
    const candidate *x = a, *y = b;
    if (x->distance != y->distance) return x->distance < y->distance ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

/** A set of points, some of them at one place, with normals if told. */
static qm_mesh draw_points(qm_random *random, double *positions, float *normals)
{
    size_t count = 1 + qm_random_below(random, POINTS_MAX);
    for (size_t i = 0; i < count; i++) {
        double normal[3];
        qm_random_direction(random, normal);
        for (size_t k = 0; k < 3; k++)
            normals[3 * i + k] = (float)normal[k];
        if (i > 0 && i % 5 == 0)
            memcpy(positions + 3 * i, positions + 3 * qm_random_below(random, i), 3 * sizeof *positions);
        else
            qm_random_point(random, -1, 1, positions + 3 * i);
    }
    return (qm_mesh){.positions = positions, .normals = normals, .vertex_count = count};
}

/** The points that count, the nearest first. */
static size_t sort_all(const qm_mesh *mesh, const double p[3], const double *toward, double reach,
                       candidate *all)
{
    size_t count = 0;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        double distance = point_distance(p, mesh->positions + 3 * (size_t)i), cosine = 1.0;
        const float *n = mesh->normals + 3 * (size_t)i;
        if (toward) cosine = (double)n[0] * toward[0] + (double)n[1] * toward[1] + (double)n[2] * toward[2];
        if (distance <= reach && cosine > 0.2) all[count++] = (candidate){distance, i};
    }
    qsort(all, count, sizeof *all, compare_candidates);
    return count;
}

static void check_list(const qm_frame *frame, const qm_mesh *mesh, const double p[3],
                       const qm_nearest_points *found, const candidate *all, uint64_t seed)
{
    for (int i = 0; i < found->count; i++) {
        double distance = sqrt(found->d2[i]) * frame->inverse_scale;
        QM_CHECK(fabs(distance - all[i].distance) <= slack(p), "seed %llu, point %d: %.17g for %.17g",
                 (unsigned long long)seed, i, distance, all[i].distance);
        double true_distance = point_distance(p, mesh->positions + 3 * (size_t)found->index[i]);
        QM_CHECK(fabs(distance - true_distance) <= slack(p),
                 "seed %llu, point %d: index %u is at %.17g, not %.17g", (unsigned long long)seed, i,
                 found->index[i], true_distance, distance);
        if (i == 0) continue;
        QM_CHECK(found->d2[i - 1] < found->d2[i] ||
                     (found->d2[i - 1] == found->d2[i] && found->index[i - 1] < found->index[i]),
                 "seed %llu: points %d and %d are out of order", (unsigned long long)seed, i - 1, i);
    }
}

static void points_are_the_nearest_of_all(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    static double positions[3 * POINTS_MAX];
    static float normals[3 * POINTS_MAX];
    static candidate all[POINTS_MAX];
    static qm_nearest_points found;
    uint64_t trials = qm_check_long() ? 2000 : 60;
    for (uint64_t trial = 0; trial < trials; trial++) {
        qm_random random = qm_random_make(qm_check_seed(), trial);
        qm_mesh mesh = draw_points(&random, positions, normals);
        qm_bvh *bvh;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_TARGET, 1, &bvh), QM_OK);
        for (int query = 0; query < QUERIES; query++) {
            double p[3], toward[3];
            draw_query(&mesh, &random, p);
            qm_random_direction(&random, toward);
            qm_vec local = qm_frame_local(&bvh->frame, p);
            int wanted = 1 + (int)qm_random_below(&random, QM_NEAREST_POINTS_MAX);
            qm_nearest_points_find(bvh, local, wanted, &found);
            size_t count = sort_all(&mesh, p, NULL, DBL_MAX, all);
            assert_int_equal(found.count, count < (size_t)wanted ? count : (size_t)wanted);
            check_list(&bvh->frame, &mesh, p, &found, all, qm_check_seed());
            double reach = qm_random_range(&random, 0.01, 3.0);
            qm_nearest_points_find_toward(bvh, local, wanted, (qm_vec){toward[0], toward[1], toward[2]},
                                          reach * bvh->frame.scale, &found);
            count = sort_all(&mesh, p, toward, reach, all);
            assert_int_equal(found.count, count < (size_t)wanted ? count : (size_t)wanted);
            check_list(&bvh->frame, &mesh, p, &found, all, qm_check_seed());
        }
        qm_bvh_destroy(&ctx, bvh);
    }
}

/* ---- triangles ---- */

static qm_mesh draw_mesh(qm_random *random, uint64_t trial)
{
    qm_mesh mesh = trial % 3 == 0   ? qm_shape_torus(30, 20, 1, 0.4)
                   : trial % 3 == 1 ? qm_shape_saddle(15)
                                    : qm_shape_soup(random, 300, QM_SOUP_TRIANGLES, QM_SOUP_POOLED, 0.3);
    if (trial % 3 < 2) qm_shape_shake(&mesh, random, 0.02);
    qm_mesh cut = qm_shape_triangulated(&mesh);
    qm_shape_free(&mesh);
    return cut;
}

static const double *corner_of(const qm_mesh *mesh, size_t face, int corner)
{
    return mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)corner];
}

/** The distance to the faces whose normals are within a right angle of a direction; those at a right angle within
 * rounding are left out or counted as told. */
static double distance_facing(const qm_mesh *mesh, const double p[3], const double toward[3],
                              bool is_generous)
{
    double min = INFINITY, margin = is_generous ? -ROUNDING : ROUNDING;
    for (size_t i = 0; i < mesh->face_count; i++) {
        const double *a = corner_of(mesh, i, 0), *b = corner_of(mesh, i, 1), *c = corner_of(mesh, i, 2);
        double u[3], v[3];
        for (int k = 0; k < 3; k++) {
            u[k] = b[k] - a[k];
            v[k] = c[k] - a[k];
        }
        double side = toward[0] * (u[1] * v[2] - u[2] * v[1]) + toward[1] * (u[2] * v[0] - u[0] * v[2]) +
                      toward[2] * (u[0] * v[1] - u[1] * v[0]);
        if (side > margin) min = fmin(min, qm_slow_triangle_distance(p, a, b, c));
    }
    return min;
}

static void check_triangles(const qm_bvh *bvh, const qm_mesh *mesh, const double p[3], double reach)
{
    static qm_vec corners[TRIANGLES_MAX][3];
    size_t surely = 0, perhaps = 0;
    for (size_t i = 0; i < mesh->face_count; i++) {
        double d =
            qm_slow_triangle_distance(p, corner_of(mesh, i, 0), corner_of(mesh, i, 1), corner_of(mesh, i, 2));
        surely += d < reach - slack(p);
        perhaps += d < reach + slack(p);
    }
    qm_vec local = qm_frame_local(&bvh->frame, p);
    size_t count = qm_near_triangles(bvh, local, reach * bvh->frame.scale, corners, TRIANGLES_MAX);
    QM_CHECK(surely <= count && count <= perhaps, "seed %llu: %zu triangles for %zu to %zu within %g",
             (unsigned long long)qm_check_seed(), count, surely, perhaps, reach);
    for (size_t i = 0; i < count; i++) {
        double at[3][3];
        for (int k = 0; k < 3; k++)
            world_position(&bvh->frame, corners[i][k], at[k]);
        assert_true(qm_slow_triangle_distance(p, at[0], at[1], at[2]) <= reach + slack(p));
    }
    if (count > 1)
        assert_int_equal(qm_near_triangles(bvh, local, reach * bvh->frame.scale, corners, count - 1), count);
}

static void triangles_are_those_of_a_look_at_all(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    uint64_t trials = qm_check_long() ? 1000 : 30;
    for (uint64_t trial = 0; trial < trials; trial++) {
        qm_random random = qm_random_make(qm_check_seed(), trial);
        qm_mesh mesh = draw_mesh(&random, trial);
        assert_true(mesh.face_count <= TRIANGLES_MAX);
        qm_bvh *bvh;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_TARGET, 1, &bvh), QM_OK);
        for (int query = 0; query < QUERIES; query++) {
            double p[3], toward[3], reach = exp2(qm_random_range(&random, -8, 7));
            draw_query(&mesh, &random, p);
            qm_random_direction(&random, toward);
            qm_facing_point facing;
            qm_vec local = qm_frame_local(&bvh->frame, p);
            bool is_found = qm_nearest_facing(bvh, local, (qm_vec){toward[0], toward[1], toward[2]},
                                              reach * bvh->frame.scale, &facing);
            double least = distance_facing(&mesh, p, toward, true),
                   most = distance_facing(&mesh, p, toward, false);
            QM_CHECK(is_found ? least < reach + slack(p) : most >= reach - slack(p),
                     "seed %llu, trial %llu: %g to %g, reach %g", (unsigned long long)qm_check_seed(),
                     (unsigned long long)trial, least, most, reach);
            if (is_found) {
                double at[3];
                world_position(&bvh->frame, facing.position, at);
                double d = point_distance(p, at);
                QM_CHECK(d >= least - slack(p) && d <= most + slack(p),
                         "seed %llu, trial %llu: %.17g, not %.17g", (unsigned long long)qm_check_seed(),
                         (unsigned long long)trial, d, least);
                assert_true(facing.normal.x * toward[0] + facing.normal.y * toward[1] +
                                facing.normal.z * toward[2] >
                            -1e-6);
            }
            check_triangles(bvh, &mesh, p, reach);
        }
        qm_bvh_destroy(&ctx, bvh);
        qm_shape_free(&mesh);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_the_nearest_of_all),
        cmocka_unit_test(triangles_are_those_of_a_look_at_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
