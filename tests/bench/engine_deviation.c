/*
 * Times the deviation of a surface with noise from the same surface without, near it and apart from it: how far
 * the bounds have to go depends on both. The surfaces are made in memory.
 */
#include "engine.h"

#include "base/host.h"
#include "measure.h"
#include "qm/deviation.h"
#include "random.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#define APART 0.05 /* of the diagonal */

typedef void place_fn(double u, double v, double out[3]);

static void place_sphere(double u, double v, double out[3])
{
    double around = 2.0 * M_PI * u, down = M_PI * (0.02 + 0.96 * v);
    out[0] = sin(down) * cos(around);
    out[1] = sin(down) * sin(around);
    out[2] = cos(down);
}

static void place_torus(double u, double v, double out[3])
{
    double ring = 1.0 + 0.4 * cos(2.0 * M_PI * v);
    out[0] = ring * cos(2.0 * M_PI * u);
    out[1] = ring * sin(2.0 * M_PI * u);
    out[2] = 0.4 * sin(2.0 * M_PI * v);
}

static void place_saddle(double u, double v, double out[3])
{
    out[0] = 2.0 * u - 1.0;
    out[1] = 2.0 * v - 1.0;
    out[2] = 0.5 * (out[0] * out[0] - out[1] * out[1]);
}

static void place_wave(double u, double v, double out[3])
{
    out[0] = 2.0 * u - 1.0;
    out[1] = 2.0 * v - 1.0;
    out[2] = 0.1 * sin(7.0 * out[0]) * cos(5.0 * out[1]);
}

/** The sides of a box, unrolled; both ends are open. */
static void place_box(double u, double v, double out[3])
{
    double along = 4.0 * u, rest = along - floor(along);
    int side = (int)along % 4;
    out[0] = side == 0 ? rest : side == 1 ? 1.0 : side == 2 ? 1.0 - rest : 0.0;
    out[1] = side == 0 ? 0.0 : side == 1 ? rest : side == 2 ? 1.0 : 1.0 - rest;
    out[2] = v;
}

/** A surface by formula; a closed one has no last column of vertices or row of them of its own. */
typedef struct surface {
    const char *name;
    place_fn *place;
    bool closed[2];
    double columns_a_row;
} surface;

static const surface surfaces[] = {
    {"box", place_box, {true, false}, 4.0},    {"sphere", place_sphere, {true, false}, 2.0},
    {"torus", place_torus, {true, true}, 2.0}, {"saddle", place_saddle, {false, false}, 1.0},
    {"wave", place_wave, {false, false}, 1.0},
};

static const surface *find_surface(const char *name)
{
    for (size_t i = 0; i < sizeof surfaces / sizeof surfaces[0]; i++)
        if (strcmp(surfaces[i].name, name) == 0) return &surfaces[i];
    bench_fail(name, "is none of box, sphere, torus, saddle, wave");
}

/** About so many faces: quads, or pairs of triangles. */
static qm_mesh make_surface(qm_context *ctx, const surface *of, size_t count, bool quads)
{
    double cells = (double)count / (quads ? 1.0 : 2.0);
    size_t rows = (size_t)fmax(3.0, round(sqrt(cells / of->columns_a_row)));
    /* The corners of a box are vertices. */
    size_t columns = 4 * (size_t)fmax(1.0, round(cells / (double)rows / 4.0));
    size_t across = columns + !of->closed[0], down = rows + !of->closed[1], faces = quads ? 1 : 2;
    qm_mesh mesh = {.vertex_count = across * down, .face_count = faces * rows * columns};
    mesh.positions = qm_context_alloc(ctx, mesh.vertex_count, 3 * sizeof *mesh.positions);
    mesh.faces = qm_context_alloc(ctx, mesh.face_count, 4 * sizeof *mesh.faces);
    if (!mesh.positions || !mesh.faces) bench_fail(of->name, "there is not enough memory");
    for (size_t j = 0; j < down; j++)
        for (size_t i = 0; i < across; i++)
            of->place((double)i / (double)columns, (double)j / (double)rows,
                      mesh.positions + 3 * (j * across + i));
    uint32_t *face = mesh.faces;
    for (size_t j = 0; j < rows; j++)
        for (size_t i = 0; i < columns; i++) {
            size_t right = (i + 1) % across, below = (j + 1) % down;
            const uint32_t a = (uint32_t)(j * across + i), b = (uint32_t)(j * across + right),
                           c = (uint32_t)(below * across + right), d = (uint32_t)(below * across + i);
            const uint32_t row[8] = {a, b, c, quads ? d : QM_NO_INDEX, a, c, d, QM_NO_INDEX};
            memcpy(face, row, 4 * faces * sizeof *row);
            face += 4 * faces;
        }
    return mesh;
}

static double diagonal_of(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    return qm_mesh_box_diagonal(&box);
}

static void add_noise(qm_mesh *mesh, double reach, uint64_t seed)
{
    qm_random random = qm_random_make(seed, 0);
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] += qm_random_range(&random, -reach, reach);
}

static void move(qm_mesh *mesh, double step)
{
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] += step / sqrt(3.0);
}

/** Raises a flag after some time, unless it is told to end before. */
typedef struct deadline {
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t ended;
    bool is_over;
    double seconds;
    atomic_bool raised;
} deadline;

static void *wait_for_end(void *user)
{
    deadline *of = user;
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += (time_t)of->seconds;
    pthread_mutex_lock(&of->lock);
    int status = 0;
    while (!of->is_over && status == 0)
        status = pthread_cond_timedwait(&of->ended, &of->lock, &until);
    if (!of->is_over) atomic_store(&of->raised, true);
    pthread_mutex_unlock(&of->lock);
    return NULL;
}

static void start_deadline(deadline *of)
{
    pthread_mutex_init(&of->lock, NULL);
    pthread_cond_init(&of->ended, NULL);
    if (pthread_create(&of->thread, NULL, wait_for_end, of) != 0) bench_fail("deadline", "no thread");
}

static void end_deadline(deadline *of)
{
    pthread_mutex_lock(&of->lock);
    of->is_over = true;
    pthread_cond_signal(&of->ended);
    pthread_mutex_unlock(&of->lock);
    pthread_join(of->thread, NULL);
    pthread_cond_destroy(&of->ended);
    pthread_mutex_destroy(&of->lock);
}

/** Time on processors, of all threads: waiting for one does not count. */
static double cpu_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

/** Share of the mean that an interval leaves open, which its lower bound divides. */
static double open_share(qm_interval value, double mean)
{
    return mean > 0.0 ? (value.upper - value.lower) / mean : INFINITY;
}

static void measure(const char *name, const qm_mesh *a, const qm_mesh *b,
                    const bench_deviation_question *question)
{
    deadline limit = {.seconds = question->seconds};
    qm_context ctx = qm_host_context();
    ctx.cancel = &limit.raised;
    static const double percentile[3] = {50.0, 95.0, 99.0};
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = question->quads;
    options.accuracy = question->accuracy;
    options.tolerance = question->accuracy * diagonal_of(a);
    options.piece_limit = (size_t)1 << 24;
    options.percentile = percentile;
    options.percentile_count = 3;
    options.thread_count = question->threads;
    qm_bvh *tree[2];
    qm_deviation found;
    if (qm_bvh_build(&ctx, a, QM_BVH_ALL, question->threads, &tree[0]) != QM_OK ||
        qm_bvh_build(&ctx, b, QM_BVH_ALL, question->threads, &tree[1]) != QM_OK)
        bench_fail("trees", ctx.message);
    start_deadline(&limit);
    double start = qm_bench_now_ms(), start_cpu = cpu_ms();
    if (qm_deviation_measure(&ctx, tree[0], tree[1], &options, &found) != QM_OK)
        bench_fail("deviation", ctx.message);
    double elapsed = qm_bench_now_ms() - start, used = cpu_ms() - start_cpu;
    end_deadline(&limit);
    printf(
        "\"%s\": {\"ms\": %.3f, \"cpu_ms\": %.3f, \"cpu_ms_a_face\": %.4f, \"pieces\": %zu, \"is_accurate\": "
        "%s, "
        "\"mean\": [%.12g, %.12g], \"open_mean\": %.2e, \"open_rms\": %.2e, \"open_percentiles\": "
        "[%.2e, %.2e, %.2e]}",
        name, elapsed, used, used / (double)a->face_count, found.pieces, found.is_accurate ? "true" : "false",
        found.mean.lower, found.mean.upper, open_share(found.mean, found.mean.lower),
        open_share(found.rms, found.rms.lower), open_share(found.percentile[0], found.mean.lower),
        open_share(found.percentile[1], found.mean.lower), open_share(found.percentile[2], found.mean.lower));
    qm_deviation_reset(&ctx, &found);
    qm_bvh_destroy(&ctx, tree[1]);
    qm_bvh_destroy(&ctx, tree[0]);
}

void bench_deviation(const bench_deviation_question *question)
{
    qm_context ctx = qm_host_context();
    const surface *of = find_surface(question->surface);
    bool quads = question->quads == QM_QUADS_BILINEAR;
    qm_mesh a = make_surface(&ctx, of, question->count, quads);
    qm_mesh b = make_surface(&ctx, of, question->count, quads);
    double diagonal = diagonal_of(&b);
    add_noise(&a, question->noise * diagonal, question->seed);
    printf("{\"surface\": \"%s\", \"faces\": %zu, \"quads\": %s, \"noise\": %g, ", of->name, a.face_count,
           quads ? "true" : "false", question->noise);
    measure("near", &a, &b, question);
    printf(", ");
    move(&a, APART * diagonal);
    measure("apart", &a, &b, question);
    printf("}\n");
    qm_mesh_reset(&ctx, &b);
    qm_mesh_reset(&ctx, &a);
}
