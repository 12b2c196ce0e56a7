/**
 * heatmap.c: the pieces of a refinement, cut until linear functions between their corners are near enough to the distance.
 *
 * The distance over a piece lies between two linear functions, low and high (deviation_piece.h). With values f_i at the corners it is
 * within e of their interpolation, e the greatest high_i - f_i and f_i - low_i: both differences are linear. Three pairs of functions are
 * known: those by all facets; those of the bounds, where they are nowhere invalid and on one side; and the constants of least and most.
 */
#include "qm/heatmap.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "core/rounding.h"
#include "deviation_refine.h"

#define MAX_ROUNDS 40
#define CHUNK 64
#define CANCEL_STRIDE 0x1000
#define ACCURACY_SHARE 0.5 /* of the error: what the surfaces in place of patches may cost */

/** Distances at the corners of a piece and their error, local; an error of -1 is not known yet. */
typedef struct map_piece {
    double distance[3], error;
} map_piece;

typedef struct map_work {
    qm_context *ctx;
    const qm_heatmap_options *options;
    qm_refinement refinement;
    map_piece *piece; /* of each piece; capacity allocated */
    size_t capacity;
    double error; /* local */
} map_work;

/** Takes the middle between two linear functions, if it is nearer than what is known. */
static void offer(map_piece *piece, const double low[3], const double high[3])
{
    double distance[3], error = 0.0;
    for (int i = 0; i < 3; i++) {
        distance[i] = qm_max(0.0, 0.5 * (low[i] + high[i]));
        error = qm_max(error, qm_max(high[i] - distance[i], distance[i] - low[i]));
    }
    if (piece->error >= 0.0 && !(error < piece->error)) return;
    memcpy(piece->distance, distance, sizeof distance);
    piece->error = error;
}

static void find_piece(const map_work *work, size_t i, qm_deviation_workspace *workspace)
{
    const qm_deviation_bounds *bounds = &work->refinement.bounds[i];
    map_piece *piece = &work->piece[i];
    const double least[3] = {bounds->least, bounds->least, bounds->least};
    const double most[3] = {bounds->most, bounds->most, bounds->most};
    offer(piece, least, most);
    bool is_behind =
        bounds->is_signed && bounds->high[0] <= 0.0 && bounds->high[1] <= 0.0 && bounds->high[2] <= 0.0;
    bool is_before =
        !bounds->is_signed || (bounds->low[0] >= 0.0 && bounds->low[1] >= 0.0 && bounds->low[2] >= 0.0);
    double low[3], high[3];
    if (!(bounds->invalid_low > 0.0) && !(bounds->invalid_high > 0.0) && (is_before || is_behind)) {
        qm_deviation_bounds_flip(bounds, low, high);
        offer(piece, is_behind ? low : bounds->low, is_behind ? high : bounds->high);
    }
    if (piece->error <= work->error) return;
    qm_deviation_piece_envelope(&work->refinement.setup, &work->refinement.piece[i], workspace, low, high);
    offer(piece, low, high);
}

static void find_chunk(void *data, int worker, size_t block)
{
    (void)worker;
    const map_work *work = data;
    qm_deviation_workspace workspace;
    workspace.hint = 0;
    workspace.searches = 0;
    size_t end = (block + 1) * CHUNK < work->refinement.count ? (block + 1) * CHUNK : work->refinement.count;
    for (size_t i = block * CHUNK; i < end && !qm_context_canceled(work->ctx); i++)
        if (work->piece[i].error < 0.0) find_piece(work, i, &workspace);
}

/** Finds the functions of all pieces that are new. */
static qm_status find_pieces(map_work *work)
{
    size_t count = work->refinement.count;
    if (count > work->capacity) {
        size_t capacity = count + count / 2;
        map_piece *larger =
            qm_context_resize(work->ctx, work->piece, work->capacity, capacity, sizeof *larger);
        if (!larger) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the map");
        for (size_t i = work->capacity; i < capacity; i++)
            larger[i].error = -1.0;
        work->piece = larger;
        work->capacity = capacity;
    }
    int threads = work->ctx->parallel ? work->options->thread_count : 1;
    qm_context_parallel_for(work->ctx, threads, (count + CHUNK - 1) / CHUNK, find_chunk, work);
    return qm_context_canceled(work->ctx) ? qm_context_fail(work->ctx, QM_E_CANCELED, "map canceled") : QM_OK;
}

/** Cuts the pieces with a greater error than requested until there are none, or no room. */
static qm_status cut_pieces(map_work *work)
{
    qm_refinement *pieces = &work->refinement;
    qm_status status = find_pieces(work);
    for (int round = 0; status == QM_OK && round < MAX_ROUNDS; round++) {
        size_t count = pieces->count, marked = 0, cut = 0;
        uint8_t *marks = qm_context_alloc(work->ctx, count, 1);
        if (!marks) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the map");
        for (size_t i = 0; i < count; i++) {
            marks[i] = work->piece[i].error > work->error;
            marked += marks[i];
        }
        if (marked > 0) status = qm_refinement_cut(pieces, marks, &cut);
        for (size_t i = 0; i < count; i++)
            if (marks[i] && cut > 0) work->piece[i].error = -1.0;
        qm_context_free(work->ctx, marks, count, 1);
        if (status == QM_OK && cut > 0) status = find_pieces(work);
        if (cut < marked || marked == 0 || pieces->count == count) break;
    }
    return status;
}

/** An estimate of the mean distance, by the vertices; and their distances. */
static qm_status measure_vertices(map_work *work, double **distance)
{
    const qm_bvh *a = work->refinement.setup.source, *b = work->refinement.setup.target;
    size_t count = a->mesh.vertex_count;
    *distance = qm_context_alloc(work->ctx, count, sizeof **distance);
    if (!*distance) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the vertices");
    qm_projection projection = {.distance = *distance};
    return qm_project_points(work->ctx, b, work->options->quads, a->mesh.positions, count,
                             work->options->thread_count, &projection);
}

/** Makes the first pieces and cuts them. What stands for patches may be off by a share of typical, which is made a share of the error
 * by the accuracy. */
static qm_status run(map_work *work, const qm_bvh *a, const qm_bvh *b)
{
    qm_refinement *pieces = &work->refinement;
    double *distance = NULL;
    qm_status status = qm_refinement_init(pieces, a, b, work->options->quads);
    if (status == QM_OK) status = measure_vertices(work, &distance);
    if (status == QM_OK) {
        work->error = work->options->error * b->frame.scale;
        pieces->typical = qm_max(work->error, DBL_MIN);
        pieces->accuracy = ACCURACY_SHARE;
        pieces->thread_count = work->options->thread_count;
        status = qm_refinement_run(pieces, distance);
    }
    qm_context_free(work->ctx, distance, a->mesh.vertex_count, sizeof *distance);
    /* The clamp of typical to the mean must not make the cuts coarser than the error. */
    pieces->survey.mean.upper = fmin(pieces->survey.mean.upper, pieces->typical);
    pieces->survey.mean.lower = fmin(pieces->survey.mean.lower, pieces->survey.mean.upper);
    pieces->limit = pieces->count + work->options->piece_limit;
    return status == QM_OK ? cut_pieces(work) : status;
}

/* ---- the result ---- */

static int compare_rows(const void *a, const void *b)
{
    const double *x = a, *y = b;
    for (int k = QM_HEATMAP_FACE; k >= 0; k--)
        if (x[k] != y[k]) return x[k] < y[k] ? -1 : 1;
    return 0;
}

static qm_status write_rows(const map_work *work, qm_heatmap *out)
{
    const qm_refinement *pieces = &work->refinement;
    const qm_deviation_setup *setup = &pieces->setup;
    const qm_frame *frame = &setup->target->frame;
    out->row = qm_context_alloc(work->ctx, pieces->count, QM_HEATMAP_COLUMNS * sizeof *out->row);
    if (!out->row) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the map");
    out->count = pieces->count;
    for (size_t i = 0; i < pieces->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx))
            return qm_context_fail(work->ctx, QM_E_CANCELED, "map canceled");
        double *row = out->row + QM_HEATMAP_COLUMNS * i;
        const qm_deviation_piece *piece = &pieces->piece[i];
        qm_deviation_face face = qm_deviation_face_load(setup, piece);
        for (int k = 0; k < 3; k++) {
            qm_vec_store(row + 4 * k,
                         qm_frame_world(frame, qm_deviation_face_at(&face, piece->u[k], piece->v[k])));
            row[4 * k + 3] = work->piece[i].distance[k] * frame->inverse_scale;
        }
        row[QM_HEATMAP_FACE] = qm_mesh_input_face(&setup->source->mesh, piece->face);
        row[QM_HEATMAP_ERROR] = work->piece[i].error * frame->inverse_scale;
        out->error = fmax(out->error, row[QM_HEATMAP_ERROR]);
    }
    qsort(out->row, out->count, QM_HEATMAP_COLUMNS * sizeof *out->row, compare_rows);
    out->is_accurate = out->error <= work->options->error;
    return QM_OK;
}

qm_status qm_heatmap_make(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                          const qm_heatmap_options *options, qm_heatmap *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    *out = (qm_heatmap){0};
    if (!(options->error > 0.0) || !isfinite(options->error))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "error must be a positive number, got %g", options->error);
    if (options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "thread count must be 1 or more, got %d",
                               options->thread_count);
    if (a->mesh.face_count == 0)
        return qm_context_fail(ctx, QM_E_UNSUPPORTED, "a map is of a surface, and A is a point set");
    double start_ms = qm_clock_ms();
    map_work work = {.ctx = ctx, .options = options, .refinement.ctx = ctx};
    qm_status status = run(&work, a, b);
    if (status == QM_OK) status = write_rows(&work, out);
    qm_context_free(ctx, work.piece, work.capacity, sizeof *work.piece);
    qm_refinement_reset(&work.refinement);
    out->elapsed_ms = qm_clock_ms() - start_ms;
    if (status != QM_OK) qm_heatmap_reset(ctx, out);
    return status;
}

void qm_heatmap_reset(qm_context *ctx, qm_heatmap *map)
{
    qm_context_free(ctx, map->row, map->count, QM_HEATMAP_COLUMNS * sizeof *map->row);
    *map = (qm_heatmap){0};
}
