/*
 * libFuzzer target over the engine: all queries of the engine on two small triangle soups.
 * Every answer is compared with the slow twins, or with another answer that it must agree with.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "exact_twin.h"
#include "fuzz_check.h"
#include "qm/collide.h"
#include "qm/deform.h"
#include "qm/deviation.h"
#include "qm/distance.h"
#include "slow_twin.h"
#include "soup.h"

#define CELLS 300 /* of the slow twin, which holds its bracket when they run out */
#define WORK 2000
#define PATCH_PAIRS 8

/** The queries of one input. */
typedef struct question {
    qm_soup soup[2];
    qm_soup_kind kind;
    double scale, size; /* of the boxes of both soups together */
    qm_quad_reading quads;
    qm_accelerator accelerator;
    qm_direction direction;
    qm_bounds bounds;
    qm_bvh *tree[2];
    qm_context ctx;
} question;

/** Coordinates so large or small are refused, or not for the slow twins. */
static bool is_tame(const question *q)
{
    return q->kind != QM_SOUP_RAW || (q->size < 1e100 && q->size > 1e-100);
}

static bool is_refusal(qm_status status)
{
    return status == QM_E_SCALE || status == QM_E_UNSUPPORTED;
}

/** A tolerance is greater than 0. */
static double share_of_size(const question *q, double share)
{
    return fmax(share * q->size, DBL_TRUE_MIN);
}

static double find_size(const question *q)
{
    double size = 0.0;
    for (int side = 0; side < 2; side++)
        for (size_t i = 0; i < 3 * q->soup[side].mesh.vertex_count; i++)
            size = fmax(size, fabs(q->soup[side].positions[i]));
    return size;
}

/* ---- nearest points ---- */

static void check_foot(const question *q, const double point[3], double distance, const double foot[3])
{
    double slack = 1e-11 * q->size, eps = 1e-12 * q->size;
    qm_slow_bracket slow = qm_slow_distance(&q->soup[1].mesh, q->quads, point, eps > 0 ? eps : 1e-12);
    CHECK(distance >= slow.lower - slack && distance <= slow.upper + slack);
    double gap = hypot(hypot(point[0] - foot[0], point[1] - foot[1]), point[2] - foot[2]);
    CHECK(fabs(gap - distance) <= slack);
}

/** The vertices of one soup on the other. */
static void project(question *q)
{
    double distance[QM_SOUP_VERTICES], position[3 * QM_SOUP_VERTICES];
    const qm_soup *a = &q->soup[0];
    qm_locator locator;
    qm_status status = qm_locator_build(&q->ctx, q->tree[1], NULL, q->accelerator, &locator);
    CHECK(status == QM_OK || is_refusal(status));
    if (status != QM_OK) return;
    qm_projection out = {.distance = distance, .position = position};
    status = qm_project_points_with(&q->ctx, &locator, q->quads, a->positions, a->mesh.vertex_count, 1, &out);
    CHECK(status == QM_OK || is_refusal(status));
    for (size_t i = 0; status == QM_OK && is_tame(q) && i < a->mesh.vertex_count; i++)
        check_foot(q, a->positions + 3 * i, distance[i], position + 3 * i);
    qm_locator_reset(&q->ctx, &locator);
}

/* ---- distances ---- */

/** Two intervals that hold the same value have something in common. */
static void check_intervals(const question *q, double lower, double upper, qm_slow_bracket slow)
{
    double slack = 1e-13 * q->size;
    CHECK(lower <= upper && lower >= 0.0);
    if (!is_tame(q)) return;
    CHECK(lower <= slow.upper + slack && slow.lower <= upper + slack);
}

static void measure_hausdorff(question *q)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    qm_hausdorff_result result;
    options.direction = q->direction;
    options.quads = q->quads;
    options.bounds = q->bounds;
    options.accelerator = q->accelerator;
    options.tolerance = share_of_size(q, 1e-4);
    options.work_limit = WORK;
    qm_status status = qm_hausdorff_measure(&q->ctx, q->tree[0], q->tree[1], &options, &result);
    CHECK(status == QM_OK || is_refusal(status));
    if (status != QM_OK) return;
    qm_slow_bracket slow = {0, INFINITY, false};
    if (is_tame(q))
        slow = qm_slow_hausdorff(&q->soup[0].mesh, &q->soup[1].mesh, q->direction, q->quads,
                                 options.tolerance, CELLS);
    check_intervals(q, result.lower, result.upper, slow);
}

static void measure_deviation(question *q)
{
    static const double percentiles[] = {10, 50, 100};
    qm_deviation_options options = qm_deviation_options_default();
    qm_deviation result;
    options.quads = q->quads;
    options.tolerance = share_of_size(q, 1e-2);
    options.accuracy = 0.1;
    options.piece_limit = 200;
    options.percentile = percentiles;
    options.percentile_count = 3;
    options.bin_count = 4;
    qm_status status = qm_deviation_measure(&q->ctx, q->tree[0], q->tree[1], &options, &result);
    CHECK(status == QM_OK || is_refusal(status));
    if (status != QM_OK) return;
    CHECK(result.mean.lower <= result.mean.upper && result.rms.lower <= result.rms.upper);
    CHECK(result.max.lower <= result.max.upper);
    CHECK(result.mean.lower <= result.rms.upper && result.rms.lower <= result.max.upper);
    for (size_t i = 0; i < result.percentile_count; i++)
        CHECK(result.percentile[i].lower <= result.percentile[i].upper);
    qm_deviation_reset(&q->ctx, &result);
}

/* ---- collisions ---- */

static qm_bigint_point whole_corner(const qm_soup *soup, size_t face, int corner)
{
    const double *p = soup->positions + 3 * (size_t)soup->faces[4 * face + (size_t)corner];
    return (qm_bigint_point){{(int64_t)p[0], (int64_t)p[1], (int64_t)p[2]}};
}

/** The triangles of a face: one, or two. */
static int cut(const qm_soup *soup, size_t face, qm_bigint_point out[2][3])
{
    for (int i = 0; i < 3; i++)
        out[0][i] = whole_corner(soup, face, i);
    if (soup->faces[4 * face + 3] == QM_NO_INDEX) return 1;
    out[1][0] = out[0][0];
    out[1][1] = out[0][2];
    out[1][2] = whole_corner(soup, face, 3);
    return 2;
}

static bool faces_meet(const question *q, size_t a, size_t b)
{
    qm_bigint_point first[2][3], second[2][3];
    int count = cut(&q->soup[0], a, first), others = cut(&q->soup[1], b, second);
    for (int i = 0; i < count; i++)
        for (int j = 0; j < others; j++)
            if (qm_exact_meet(first[i], second[j])) return true;
    return false;
}

/** All pairs by whole numbers, in order. */
static void check_pairs(const question *q, const qm_collision *found)
{
    size_t next = 0;
    for (size_t a = 0; a < q->soup[0].mesh.face_count; a++)
        for (size_t b = 0; b < q->soup[1].mesh.face_count; b++) {
            bool reported =
                next < found->pair_count && found->pairs[next].a == a && found->pairs[next].b == b;
            CHECK(reported == faces_meet(q, a, b));
            next += reported;
        }
    CHECK(next == found->pair_count);
}

static void check_least_distance(question *q, bool meets)
{
    qm_distance_options options = {.quads = q->quads, .tolerance = share_of_size(q, 1e-6), .limit = NAN};
    qm_distance result;
    qm_status status = qm_distance_measure(&q->ctx, q->tree[0], q->tree[1], &options, &result);
    CHECK(status == QM_OK || is_refusal(status));
    if (status != QM_OK) return;
    CHECK(result.lower <= result.upper && result.lower >= 0.0);
    if (q->quads == QM_QUADS_TRIANGLES) CHECK(meets == (result.upper == 0.0));
}

static void collide(question *q)
{
    /* Cutting patches takes many exact tests, which under the sanitizers are slow. */
    size_t pairs = q->soup[0].mesh.face_count * (q->soup[0].mesh.face_count + q->soup[1].mesh.face_count);
    if (q->quads == QM_QUADS_BILINEAR && (q->kind == QM_SOUP_RAW || pairs > PATCH_PAIRS)) return;
    bool has_faces = q->soup[0].mesh.face_count > 0 && q->soup[1].mesh.face_count > 0;
    qm_collide_options options = qm_collide_options_default();
    qm_collision found;
    options.quads = q->quads;
    options.tolerance = share_of_size(q, 1e-3);
    qm_status status = qm_collide_meshes(&q->ctx, q->tree[0], q->tree[1], &options, &found);
    CHECK(status == QM_OK || is_refusal(status));
    if (status == QM_OK && has_faces) {
        if (q->kind == QM_SOUP_WHOLE && q->quads == QM_QUADS_TRIANGLES) check_pairs(q, &found);
        check_least_distance(q, found.pair_count > 0);
    }
    if (status == QM_OK) qm_collide_reset(&q->ctx, &found);
    status = qm_collide_self(&q->ctx, q->tree[0], &options, NULL, &found);
    CHECK(status == QM_OK || is_refusal(status));
    if (status == QM_OK) qm_collide_reset(&q->ctx, &found);
}

/* ---- the whole ---- */

/** Moves the target and lets its tree follow. */
static bool deform(question *q, qm_bytes *bytes)
{
    qm_deformer *deformer;
    size_t updated;
    qm_soup *soup = &q->soup[1];
    CHECK(qm_deformer_build(&q->ctx, q->tree[1], &deformer) == QM_OK);
    qm_soup_move(soup, bytes, q->kind, q->scale);
    bool valid = qm_mesh_validate(&q->ctx, &soup->mesh) == QM_OK;
    if (valid) {
        CHECK(qm_bvh_refit(&q->ctx, q->tree[1], deformer, &soup->mesh, NULL, 0, 1, &updated) == QM_OK);
        q->size = find_size(q);
    }
    qm_deformer_destroy(&q->ctx, deformer);
    return valid;
}

static void ask(question *q, qm_bytes *bytes)
{
    for (int side = 0; side < 2; side++)
        CHECK(qm_bvh_build(&q->ctx, &q->soup[side].mesh, QM_BVH_ALL, 1, &q->tree[side]) == QM_OK);
    project(q);
    measure_hausdorff(q);
    measure_deviation(q);
    collide(q);
    if (deform(q, bytes)) {
        project(q);
        collide(q);
    }
    for (int side = 0; side < 2; side++)
        qm_bvh_destroy(&q->ctx, q->tree[side]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    qm_bytes bytes = {data, size};
    static const double scales[] = {1.0, 0x1p-40, 0x1p50, 1e-3};
    uint8_t first = qm_bytes_take(&bytes), second = qm_bytes_take(&bytes);
    question q = {.kind = (qm_soup_kind)(first % 3),
                  .scale = scales[first / 3 % 4],
                  .quads = (qm_quad_reading)(second % 2),
                  .accelerator = (qm_accelerator)(second / 2 % QM_ACCELERATOR_COUNT),
                  .direction = (qm_direction)(second / 8 % 3),
                  .bounds = (qm_bounds)(second / 32 % 2),
                  .ctx = qm_context_make()};
    for (int side = 0; side < 2; side++) {
        qm_soup_read(&q.soup[side], &bytes, q.kind, q.scale);
        if (qm_mesh_validate(&q.ctx, &q.soup[side].mesh) != QM_OK) return 0;
    }
    q.size = find_size(&q);
    ask(&q, &bytes);
    return 0;
}
