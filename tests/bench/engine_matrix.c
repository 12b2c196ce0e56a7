/* Times the distances of all pairs of a set of meshes by formula, as a matrix and pair by pair. */
#include "engine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "measure.h"
#include "qm/hausdorff.h"
#include "qm/matrix.h"

enum { COLUMNS = 48, ROWS = 24, WAVES = 4, FAMILY = 10 };

/** Spheres of radius about 1 with waves on them. */
typedef struct shape {
    double radius, height[WAVES], turn[WAVES];
} shape;

typedef struct set {
    qm_context ctx;
    size_t count;
    qm_mesh *mesh;
    qm_bvh **tree;
    qm_box *box;
} set;

/** A number from 0 to 1 by two places: the fraction of a large multiple of a sine, the same on every machine for these. */
static double draw(size_t item, size_t place)
{
    double number = 43758.5453 * sin(12.9898 * (double)item + 78.233 * (double)place);
    return number - floor(number);
}

/** sizes: spheres that differ in their radius alone. versions: families of ten, that differ little within and much between. any:
 * all of them differ much. */
static shape make_shape(const char *kind, size_t item, size_t count)
{
    shape out = {.radius = 1.0};
    if (strcmp(kind, "sizes") == 0) {
        out.radius += 2.0 * (double)item / (double)count;
        return out;
    }
    bool has_families = strcmp(kind, "versions") == 0;
    if (!has_families && strcmp(kind, "any") != 0) bench_fail(kind, "is none of sizes, versions, any");
    for (size_t i = 0; i < WAVES; i++) {
        size_t of = has_families ? item / FAMILY : item;
        out.height[i] = 0.2 * draw(of, i);
        out.turn[i] = 6.0 * draw(of, WAVES + i);
        if (has_families) out.height[i] += 0.01 * draw(1000 + item, i);
    }
    return out;
}

static void put_vertex(const shape *of, int row, int column, double *out)
{
    double polar = M_PI * (row + 1) / (ROWS + 1), azimuth = 2.0 * M_PI * column / COLUMNS,
           radius = of->radius;
    for (int i = 0; i < WAVES; i++)
        radius += of->height[i] * sin((i + 1) * polar) * sin((i + 2) * azimuth + of->turn[i]);
    out[0] = radius * sin(polar) * cos(azimuth);
    out[1] = radius * sin(polar) * sin(azimuth);
    out[2] = radius * cos(polar);
}

static void make_mesh(qm_context *ctx, const shape *of, qm_mesh *out)
{
    *out = (qm_mesh){.vertex_count = (size_t)ROWS * COLUMNS, .face_count = (size_t)(ROWS - 1) * COLUMNS};
    out->positions = qm_context_alloc(ctx, out->vertex_count, 3 * sizeof *out->positions);
    out->faces = qm_context_alloc(ctx, out->face_count, 4 * sizeof *out->faces);
    if (!out->positions || !out->faces) bench_fail("matrix", "there is not enough memory");
    for (int row = 0; row < ROWS; row++)
        for (int column = 0; column < COLUMNS; column++) {
            size_t place = (size_t)(row * COLUMNS + column);
            put_vertex(of, row, column, out->positions + 3 * place);
            if (row + 1 == ROWS) continue;
            uint32_t a = (uint32_t)place, b = (uint32_t)(row * COLUMNS + (column + 1) % COLUMNS);
            const uint32_t face[4] = {a, b, b + COLUMNS, a + COLUMNS};
            memcpy(out->faces + 4 * place, face, sizeof face);
        }
}

static qm_hausdorff_result search(set *s, size_t a, size_t b, double tolerance, double threshold)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = tolerance;
    options.threshold = threshold;
    qm_hausdorff_result found;
    if (qm_hausdorff_measure(&s->ctx, s->tree[a], s->tree[b], &options, &found) != QM_OK)
        bench_fail("matrix", s->ctx.message);
    return found;
}

static qm_status measure(void *user, const qm_matrix_question *question, qm_matrix_answer *out)
{
    qm_hausdorff_result found =
        search(user, question->a, question->b, question->tolerance, question->threshold);
    *out = (qm_matrix_answer){.lower = found.lower, .upper = found.upper};
    return QM_OK;
}

/** Searches every pair, and checks the matrix with it. */
static double search_all(set *s, const qm_matrix_options *options, const qm_matrix *matrix)
{
    double start = qm_bench_now_ms(), checking = 0.0;
    for (size_t a = 0; a < s->count; a++)
        for (size_t b = a + 1; b < s->count; b++) {
            bool has_limit = options->want == QM_MATRIX_WITHIN;
            qm_hausdorff_result found = search(s, a, b, options->tolerance, has_limit ? options->limit : NAN);
            double found_ms = qm_bench_now_ms();
            size_t pair = qm_matrix_pair(s->count, a, b);
            if (found.lower > matrix->upper[pair] || matrix->lower[pair] > found.upper)
                bench_fail("matrix", "two intervals of one distance have nothing in common");
            checking += qm_bench_now_ms() - found_ms;
        }
    return qm_bench_now_ms() - start - checking;
}

static void build(set *s, const char *kind)
{
    s->mesh = bench_alloc(s->count, sizeof *s->mesh);
    s->tree = bench_alloc(s->count, sizeof *s->tree);
    s->box = bench_alloc(s->count, sizeof *s->box);
    for (size_t i = 0; i < s->count; i++) {
        shape of = make_shape(kind, i, s->count);
        make_mesh(&s->ctx, &of, &s->mesh[i]);
        s->box[i] = qm_mesh_bounding_box(&s->mesh[i]);
        if (qm_bvh_build(&s->ctx, &s->mesh[i], QM_BVH_TARGET, 1, &s->tree[i]) != QM_OK)
            bench_fail("matrix", s->ctx.message);
    }
}

void bench_matrix(const char *kind, const char *want, size_t count, double tolerance)
{
    set s = {.ctx = qm_host_context(), .count = count};
    if (count < FAMILY) bench_fail(kind, "takes --count of 10 meshes or more");
    long resting_kb = qm_bench_rest();
    double start = qm_bench_now_ms();
    build(&s, kind);
    qm_matrix_options options = {.count = count,
                                 .boxes = s.box,
                                 .want = strcmp(want, "nearest") == 0  ? QM_MATRIX_NEAREST
                                         : strcmp(want, "within") == 0 ? QM_MATRIX_WITHIN
                                                                       : QM_MATRIX_ALL,
                                 .nearest = 3,
                                 .limit = 0.1,
                                 .tolerance = tolerance,
                                 .measure = measure,
                                 .user = &s};
    qm_matrix matrix;
    qm_bench_times times = {0};
    double built = qm_bench_now_ms();
    if (qm_matrix_measure(&s.ctx, &options, &matrix) != QM_OK) bench_fail("matrix", s.ctx.message);
    qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
    double full_ms = search_all(&s, &options, &matrix);
    qm_bench_print_times(&times, resting_kb);
    printf(", ");
    qm_bench_print_list("full_ms", &full_ms, 1);
    printf(", \"pairs\": %zu, \"searched\": %zu, \"searches\": %zu, \"pivots\": %zu, \"open\": %zu}\n",
           matrix.pair_count, matrix.searched, matrix.searches, matrix.pivots, matrix.open);
    qm_matrix_reset(&s.ctx, &matrix);
    for (size_t i = 0; i < count; i++) {
        qm_bvh_destroy(&s.ctx, s.tree[i]);
        qm_mesh_reset(&s.ctx, &s.mesh[i]);
    }
    free(s.mesh);
    free(s.tree);
    free(s.box);
}
