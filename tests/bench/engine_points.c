/* Points to project: near a surface, within its box, and all round it. */
#include "engine.h"

#include "random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define NEAR_DEVIATION 1e-3
#define FAR_BOXES 3.0

static void cut_corner(const qm_mesh *mesh, size_t face, int half, const double *corner[3])
{
    const uint32_t *v = mesh->faces + 4 * face;
    corner[0] = mesh->positions + 3 * (size_t)v[0];
    corner[1] = mesh->positions + 3 * (size_t)v[half + 1];
    corner[2] = mesh->positions + 3 * (size_t)v[half + 2];
}

static double triangle_area(const double *const corner[3])
{
    double e[3], f[3];
    for (int k = 0; k < 3; k++) {
        e[k] = corner[1][k] - corner[0][k];
        f[k] = corner[2][k] - corner[0][k];
    }
    return 0.5 *
           hypot(hypot(e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2]), e[0] * f[1] - e[1] * f[0]);
}

/** sums[i]: area of the halves of faces up to i; half 2 f + 1 of a triangle has none. */
static double *sum_areas(const qm_mesh *mesh)
{
    double *sums = bench_alloc(2 * mesh->face_count, sizeof *sums), sum = 0.0;
    for (size_t i = 0; i < 2 * mesh->face_count; i++) {
        const double *corner[3];
        bool is_there = i % 2 == 0 || mesh->faces[4 * (i / 2) + 3] != QM_NO_INDEX;
        if (is_there) {
            cut_corner(mesh, i / 2, (int)(i % 2), corner);
            sum += triangle_area(corner);
        }
        sums[i] = sum;
    }
    return sums;
}

/** The first place whose sum is above the value, so never a half without area. */
static size_t find_half(const double *sums, size_t count, double value)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (sums[middle] > value)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/** Source: Box, Muller, A note on the generation of random normal deviates, 1958. */
static double draw_normal(qm_random *random)
{
    double u = 1.0 - qm_random_range(random, 0.0, 1.0), angle = qm_random_range(random, -M_PI, M_PI);
    return sqrt(-2.0 * log(u)) * cos(angle);
}

static void draw_near(qm_random *random, const qm_mesh *mesh, const double *sums, double deviation,
                      double out[3])
{
    size_t count = 2 * mesh->face_count;
    size_t half = find_half(sums, count, qm_random_range(random, 0.0, sums[count - 1]));
    const double *corner[3];
    cut_corner(mesh, half / 2, (int)(half % 2), corner);
    double u = qm_random_range(random, 0.0, 1.0), v = qm_random_range(random, 0.0, 1.0);
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    for (int k = 0; k < 3; k++)
        out[k] = corner[0][k] + u * (corner[1][k] - corner[0][k]) + v * (corner[2][k] - corner[0][k]) +
                 deviation * draw_normal(random);
}

static void draw_box(qm_random *random, const qm_box *box, double scale, double out[3])
{
    for (int k = 0; k < 3; k++) {
        double middle = 0.5 * (box->min[k] + box->max[k]), half = 0.5 * scale * (box->max[k] - box->min[k]);
        out[k] = qm_random_range(random, middle - half, middle + half);
    }
}

void bench_draw_sets(const qm_mesh *mesh, size_t count, uint64_t seed, double *out[3])
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double deviation = NEAR_DEVIATION * qm_mesh_box_diagonal(&box);
    double *sums = sum_areas(mesh);
    qm_random random = qm_random_make(seed, 0);
    for (size_t i = 0; i < count; i++)
        draw_near(&random, mesh, sums, deviation, out[0] + 3 * i);
    for (int set = 1; set < 3; set++)
        for (size_t i = 0; i < count; i++)
            draw_box(&random, &box, set == 1 ? 1.0 : FAR_BOXES, out[set] + 3 * i);
    free(sums);
}

void bench_draw(const char *path, size_t count, uint64_t seed, const char *prefix)
{
    static const char *const names[3] = {"near", "mid", "far"};
    qm_context ctx = qm_context_make();
    qm_mesh mesh = bench_read_mesh(&ctx, path, &(bench_change){0});
    double *points[3];
    for (int set = 0; set < 3; set++)
        points[set] = bench_alloc(count, 3 * sizeof *points[set]);
    bench_draw_sets(&mesh, count, seed, points);
    for (int set = 0; set < 3; set++) {
        bench_write_array(prefix, names[set], points[set], count, 3 * sizeof *points[set]);
        free(points[set]);
    }
    printf("{\"points\": %zu, \"seed\": %llu}\n", count, (unsigned long long)seed);
    qm_mesh_reset(&ctx, &mesh);
}
