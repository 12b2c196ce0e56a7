/**
 * deviation_sides.c: sides of pieces, sums over each side, bands, and a branch and bound for the greatest distance on a side.
 */
#include "deviation_sides.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "bvh/winding.h"
#include "core/heap.h"
#include "core/rounding.h"

#define NEAR_ROUNDINGS 16.0 /* etas: open pieces no farther than that are not cut */
#define CHUNK 256           /* pieces that a worker takes at a time */
#define CANCEL_STRIDE 0x400
#define SEARCH_WORK 1024     /* pieces that are cut for the maximum of a side, */
#define SEARCH_SHARE 0.02    /* and further ones for each piece */
#define SEARCH_PARTS 16      /* of one of them */
#define SAFE (1.0 - 0x1p-20) /* of a distance: covers the roundings of its comparison with another */

/* ---- one piece ---- */

/** A computed point of a piece. */
static qm_vec piece_point(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                          const double weight[3])
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    double u = 0.0, v = 0.0;
    for (int i = 0; i < 3; i++) {
        u += weight[i] * piece->u[i];
        v += weight[i] * piece->v[i];
    }
    return qm_deviation_face_at(&face, u, v);
}

static const double centre[3] = {1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0};

static int point_side(const qm_deviation_sides *sides, qm_vec p, uint32_t *hint)
{
    if (sides->normals.bvh) return qm_deviation_normals_side(&sides->normals, p, hint);
    const qm_bvh *target = sides->pieces->setup.target;
    return qm_winding_number(target, sides->options->quads, QM_WINDING_LOCAL, p) != 0 ? QM_PIECE_BEHIND
                                                                                      : QM_PIECE_FRONT;
}

/** The last point whose side was found, and its distance from the target from below. */
typedef struct known_side {
    qm_vec at;
    double least;
    int side;
    uint32_t hint;
} known_side;

static qm_vec middle_of(const qm_deviation_sides *sides, size_t i)
{
    const qm_deviation_setup *setup = &sides->pieces->setup;
    if (!sides->has_points) return piece_point(setup, &sides->pieces->piece[i], centre);
    return qm_frame_local(&setup->target->frame, setup->source->mesh.positions + 3 * (size_t)sides->point[i]);
}

/** The side of a point no nearer to the target than this. The segment to the last point is clear when either is
 * farther from the target than from the other. */
static int find_side(const qm_deviation_sides *sides, qm_vec p, double least, known_side *known)
{
    if (!(least > 0.0)) return QM_PIECE_OPEN;
    double reach = qm_max(least, known->least) * SAFE;
    bool is_near = known->least > 0.0 && qm_vec_distance(p, known->at) < reach && !sides->normals.bvh;
    int side = is_near ? known->side : point_side(sides, p, &known->hint);
    *known = (known_side){p, least, side, known->hint};
    return side;
}

static void find_chunk(void *data, int worker, size_t block)
{
    (void)worker;
    const qm_deviation_sides *sides = data;
    size_t end = (block + 1) * CHUNK < sides->pieces->count ? (block + 1) * CHUNK : sides->pieces->count;
    known_side known = {.least = 0.0};
    for (size_t i = block * CHUNK; i < end && !qm_context_canceled(sides->pieces->ctx); i++)
        if (sides->side[i] == QM_PIECE_UNKNOWN)
            sides->side[i] =
                (int8_t)find_side(sides, middle_of(sides, i), sides->pieces->bounds[i].least, &known);
}

/** Finds the sides that are unknown, after making room for those of all pieces. */
static qm_status find_sides(qm_deviation_sides *sides)
{
    qm_refinement *pieces = sides->pieces;
    qm_context *ctx = pieces->ctx;
    if (pieces->count > sides->capacity) {
        size_t capacity = pieces->count + pieces->count / 2;
        int8_t *larger = qm_context_resize(ctx, sides->side, sides->capacity, capacity, sizeof *larger);
        if (!larger) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the sides");
        memset(larger + sides->capacity, QM_PIECE_UNKNOWN, capacity - sides->capacity);
        sides->side = larger;
        sides->capacity = capacity;
    }
    int threads = ctx->parallel ? sides->options->thread_count : 1;
    qm_context_parallel_for(ctx, threads, (pieces->count + CHUNK - 1) / CHUNK, find_chunk, sides);
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled") : QM_OK;
}

/* ---- cuts ---- */

/** How much an open piece leaves open: its area as a share of all, and what it may add to the mean as a share of that. */
static double open_share(const qm_deviation_bounds *piece, const qm_deviation_survey *survey)
{
    double share = piece->area_high / survey->area.upper,
           mean = qm_max(survey->mean.lower, 0.5 * survey->mean.upper);
    return mean > 0.0 ? share + 2.0 * piece->mean_high / (mean * survey->area.upper) : share;
}

/** Open pieces that are no farther from the target than nearest are not cut. */
typedef struct open_work {
    qm_deviation_sides *sides;
    double nearest;
} open_work;

static double find_open(const void *user, size_t i)
{
    const open_work *work = user;
    const qm_refinement *pieces = work->sides->pieces;
    const qm_deviation_bounds *piece = &pieces->bounds[i];
    bool is_open = work->sides->side[i] == QM_PIECE_OPEN && piece->most > work->nearest;
    return is_open ? open_share(piece, &pieces->survey) : QM_NOT_OPEN;
}

/** The parts of a piece have no side yet. */
static qm_status find_sides_again(const void *user, const uint8_t *marks, size_t count)
{
    qm_deviation_sides *sides = ((const open_work *)user)->sides;
    for (size_t i = 0; i < count; i++)
        if (marks[i]) sides->side[i] = QM_PIECE_UNKNOWN;
    return find_sides(sides);
}

/** Cuts open pieces until little is left in them, or there is no room. */
static qm_status cut_open(qm_deviation_sides *sides)
{
    qm_refinement *pieces = sides->pieces;
    double unit = pieces->setup.target->frame.scale, accuracy = fmin(pieces->accuracy, 1.0);
    const open_work work = {sides, qm_max(NEAR_ROUNDINGS * pieces->setup.eta,
                                          qm_max(sides->options->tolerance * unit,
                                                 QM_OPEN_SHARE * accuracy * pieces->survey.mean.lower))};
    qm_status status = qm_refinement_cut_open(pieces, find_open, find_sides_again, &work);
    return status == QM_OK ? qm_refinement_survey(pieces) : status;
}

/* ---- sums ---- */

/** Sums over the pieces of one side, low and high. */
typedef struct side_sums {
    long double area[2], mean[2];
} side_sums;

/** By the side, from BEHIND to FRONT. */
typedef struct all_sums {
    side_sums of[QM_PIECE_SIDES];
} all_sums;

static const side_sums *sums_of(const all_sums *sums, int side)
{
    return &sums->of[side - QM_PIECE_BEHIND];
}

static all_sums add_up(const qm_deviation_sides *sides)
{
    all_sums sums = {0};
    for (size_t i = 0; i < sides->pieces->count; i++) {
        const qm_deviation_bounds *piece = &sides->pieces->bounds[i];
        QM_ASSERT(sides->side[i] != QM_PIECE_UNKNOWN);
        side_sums *of = &sums.of[sides->side[i] - QM_PIECE_BEHIND];
        of->area[0] += (long double)piece->area_low;
        of->area[1] += (long double)piece->area_high;
        of->mean[0] += (long double)piece->mean_low;
        of->mean[1] += (long double)piece->mean_high;
    }
    return sums;
}

/** A quotient of a bound of any sign: by the area that makes it least, or greatest. */
static double divide(double value, qm_interval area, bool is_lower)
{
    double by = (value < 0.0) == is_lower ? area.lower : area.upper;
    return by > 0.0 ? value / by : value < 0.0 ? -INFINITY : value > 0.0 ? INFINITY : 0.0;
}

/** The signed mean from below; from above by exchange of the sides. Open pieces, and the leak, count as behind. */
static double mean_below(const qm_refinement *pieces, const side_sums *front, const side_sums *behind,
                         const side_sums *open)
{
    double error = qm_deviation_sum_error(pieces->count);
    double up = (double)front->mean[0] * (1.0 - error);
    double down =
        (double)(behind->mean[1] + open->mean[1]) * (1.0 + error) + 2.0 * pieces->leak * pieces->farthest;
    double sum = up - down;
    /* Either of them has four roundings at most, their difference one, this one, and the quotient. */
    sum -= 8.0 * QM_UNIT_ROUNDING * (up + down);
    return divide(sum, pieces->survey.area, true);
}

static qm_interval side_size(const qm_refinement *pieces, const side_sums *side, const side_sums *open)
{
    double error = qm_deviation_sum_error(pieces->count);
    return (qm_interval){fmax(0.0, (double)side->area[0] * (1.0 - error) - pieces->leak),
                         (double)(side->area[1] + open->area[1]) * (1.0 + error) +
                             pieces->leak * (1.0 + error)};
}

/** An interval of areas in square units of the meshes. */
static qm_interval to_unit(const qm_deviation_sides *sides, const qm_deviation *out, qm_interval size)
{
    if (out->measure == QM_OVER_AREA) {
        const qm_deviation_setup *setup = &sides->pieces->setup;
        size.lower = qm_deviation_unit_area(setup, size.lower, true);
        size.upper = qm_deviation_unit_area(setup, size.upper, false);
    }
    size.upper = fmin(size.upper, out->size.upper);
    return size;
}

/** A lower bound times a power of two, which is exact but below the least normal number. */
static double scale_below(double value, double scale)
{
    double scaled = value * scale;
    if (value < 0.0) return scaled > -DBL_MIN ? -DBL_MIN : scaled;
    return scaled < DBL_MIN ? 0.0 : scaled;
}

static void set_sums(const qm_deviation_sides *sides, const all_sums *sums, qm_deviation *out)
{
    const qm_refinement *pieces = sides->pieces;
    qm_signed_deviation *figures = &out->sides;
    double inverse = pieces->setup.target->frame.inverse_scale;
    const side_sums *front = sums_of(sums, QM_PIECE_FRONT), *behind = sums_of(sums, QM_PIECE_BEHIND),
                    *open = sums_of(sums, QM_PIECE_OPEN);
    double lower = mean_below(pieces, front, behind, open),
           upper = 0.0 - mean_below(pieces, behind, front, open);
    figures->mean.lower = fmax(figures->mean.lower, scale_below(lower, inverse));
    figures->mean.upper = fmin(figures->mean.upper, 0.0 - scale_below(-upper, inverse));
    figures->front.size = to_unit(sides, out, side_size(pieces, front, open));
    figures->behind.size = to_unit(sides, out, side_size(pieces, behind, open));
    const side_sums none = {0};
    figures->open_size = to_unit(sides, out, side_size(pieces, open, &none)).upper;
}

/* ---- bands ---- */

/** The band as positive in front, local. */
static qm_interval local_band(const qm_deviation_sides *sides, size_t i)
{
    double scale = sides->pieces->setup.target->frame.scale;
    qm_interval band = sides->options->band[i];
    if (sides->options->sign == QM_SIGN_INSIDE) band = (qm_interval){-band.upper, -band.lower};
    return (qm_interval){band.lower * scale, band.upper * scale};
}

static qm_status set_bands(const qm_deviation_sides *sides, const all_sums *sums, qm_deviation *out)
{
    qm_context *ctx = sides->pieces->ctx;
    size_t count = sides->options->band_count;
    if (count == 0) return QM_OK;
    qm_deviation_groups groups = {.side = sides->side};
    for (int k = 0; k < QM_PIECE_SIDES; k++)
        memcpy(groups.area[k], sums->of[k].area, sizeof groups.area[k]);
    qm_interval *band = qm_context_alloc(ctx, count, sizeof *band);
    if (!band) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the bands");
    for (size_t i = 0; i < count; i++)
        band[i] = local_band(sides, i);
    qm_status status = qm_deviation_band_shares(ctx, qm_refinement_list(sides->pieces), &groups, band, count,
                                                out->sides.band);
    qm_context_free(ctx, band, count, sizeof *band);
    return status;
}

/* ---- the greatest distance on a side ---- */

/** A piece that may have it. */
typedef struct candidate {
    qm_deviation_piece piece;
    double most;
    int side;
} candidate;

typedef struct side_search {
    const qm_deviation_sides *sides;
    qm_context *ctx;
    int side;
    candidate *candidates;
    size_t count, capacity;
    qm_heap heap;           /* of them, the greatest first */
    double lower, finished; /* a distance on the side; no more is possible on pieces that are done with */
    double nearest;         /* no piece is nearer to the target */
    bool has_witness;
    qm_deviation_piece at; /* the witness: a piece, and the weights of its corners; or the index of a point */
    double weight[3];
    size_t point;
} side_search;

static qm_status offer_piece(side_search *search, const qm_deviation_piece *piece, double most, int side)
{
    if ((side != search->side && side != QM_PIECE_OPEN) || !(most > search->lower)) return QM_OK;
    if (search->count == search->capacity) {
        size_t capacity = search->capacity > 0 ? 2 * search->capacity : 256;
        candidate *larger =
            qm_context_resize(search->ctx, search->candidates, search->capacity, capacity, sizeof *larger);
        if (!larger) return QM_E_NO_MEMORY;
        search->candidates = larger;
        search->capacity = capacity;
    }
    search->candidates[search->count] = (candidate){*piece, most, side};
    return qm_heap_push(search->ctx, &search->heap,
                        (qm_heap_item){.key = -most, .number = (uint32_t)search->count++});
}

/** Takes a point of a piece on this side, with the lower bound of its distance, if it is the farthest so far. */
static void offer_point(side_search *search, const qm_deviation_piece *piece, const double weight[3],
                        double least)
{
    if (!(least > search->lower) || !(least > 0.0)) return;
    search->lower = least;
    search->has_witness = true;
    search->at = *piece;
    memcpy(search->weight, weight, sizeof search->weight);
}

/** Measures the corners and the centroid of a piece. */
static void measure_points(side_search *search, const candidate *from, qm_deviation_workspace *workspace)
{
    static const double weights[4][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0}};
    const qm_deviation_setup *setup = &search->sides->pieces->setup;
    qm_deviation_face face = qm_deviation_face_load(setup, &from->piece);
    for (int i = 0; i < 4; i++) {
        qm_vec p = piece_point(setup, &from->piece, weights[i]);
        double certain;
        qm_deviation_search(setup, workspace, p, &certain);
        double least = certain - setup->eta - face.slack;
        if (!(least > search->lower)) continue;
        uint32_t hint = workspace->hint;
        int side = from->side == QM_PIECE_OPEN ? point_side(search->sides, p, &hint) : from->side;
        if (side == search->side) offer_point(search, &from->piece, weights[i], least);
    }
}

/** Cuts a piece into parts that may have a greater distance on the side. */
static qm_status cut_candidate(side_search *search, const candidate *from, qm_deviation_workspace *workspace,
                               qm_deviation_piece part[QM_DEVIATION_PARTS],
                               qm_deviation_bounds bounds[QM_DEVIATION_PARTS])
{
    const qm_deviation_setup *setup = &search->sides->pieces->setup;
    double leak;
    qm_status status = QM_OK;
    known_side known = {.least = 0.0};
    int count = qm_deviation_piece_split(setup, &from->piece, workspace, part, bounds, &leak);
    for (int i = 0; status == QM_OK && i < count; i++) {
        double most = qm_min(bounds[i].most, from->most);
        if (!(most > search->lower)) continue;
        int side = from->side;
        if (side == QM_PIECE_OPEN)
            side = find_side(search->sides, piece_point(setup, &part[i], centre), bounds[i].least, &known);
        status = offer_piece(search, &part[i], most, side);
    }
    return status;
}

/** Cuts the piece that may be farthest, until no other is farther than the tolerance beyond the point that is found, or the work is
 * done. */
static qm_status run_search(side_search *search)
{
    const qm_refinement *pieces = search->sides->pieces;
    double tolerance = 0.5 * search->sides->options->tolerance * pieces->setup.target->frame.scale;
    size_t work = SEARCH_WORK + (size_t)(SEARCH_SHARE * (double)pieces->count);
    qm_deviation_piece *part = qm_context_alloc(search->ctx, QM_DEVIATION_PARTS, sizeof *part);
    qm_deviation_bounds *bounds = qm_context_alloc(search->ctx, QM_DEVIATION_PARTS, sizeof *bounds);
    qm_deviation_workspace *workspace = qm_context_alloc_aligned(search->ctx, 1, sizeof *workspace);
    qm_status status = part && bounds && workspace ? QM_OK : QM_E_NO_MEMORY;
    if (workspace) {
        workspace->hint = 0;
        workspace->searches = 0;
    }
    for (size_t step = 0; status == QM_OK && search->heap.count > 0; step++) {
        const candidate from = search->candidates[search->heap.items[0].number];
        if (step == work || from.most <= search->lower + tolerance) break;
        if (step % 16 == 0 && qm_context_canceled(search->ctx)) status = QM_E_CANCELED;
        qm_heap_pop(&search->heap);
        measure_points(search, &from, workspace);
        if (from.piece.depth == QM_DEVIATION_DEPTH)
            search->finished = qm_max(search->finished, from.most);
        else if (status == QM_OK)
            status = cut_candidate(search, &from, workspace, part, bounds);
        if (status == QM_E_CANCELED) search->finished = qm_max(search->finished, from.most);
    }
    qm_context_free(search->ctx, part, QM_DEVIATION_PARTS, sizeof *part);
    qm_context_free(search->ctx, bounds, QM_DEVIATION_PARTS, sizeof *bounds);
    qm_context_free_aligned(search->ctx, workspace, 1, sizeof *workspace);
    return status;
}

/** The pieces of the side and the open ones, and the greatest distance that the corners of the former have. */
static qm_status start_search(side_search *search)
{
    static const double corners[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const qm_deviation_sides *sides = search->sides;
    const qm_refinement *pieces = sides->pieces;
    for (size_t i = 0; i < pieces->count; i++) {
        const qm_deviation_bounds *bounds = &pieces->bounds[i];
        if (sides->side[i] != search->side) continue;
        if (sides->has_points && bounds->least > search->lower) {
            search->lower = bounds->least;
            search->has_witness = true;
            search->point = i;
        }
        if (sides->has_points || bounds->invalid_low > 0.0) continue;
        double slack = qm_deviation_face_load(&pieces->setup, &pieces->piece[i]).slack;
        for (int k = 0; k < 3; k++) {
            double least = qm_deviation_bounds_corner_least(bounds, k);
            offer_point(search, &pieces->piece[i], corners[k], least - slack);
        }
    }
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < pieces->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(search->ctx)) return QM_E_CANCELED;
        bool counts = sides->side[i] == search->side || sides->side[i] == QM_PIECE_OPEN;
        search->nearest = qm_min(search->nearest, pieces->bounds[i].least);
        if (sides->has_points && counts) search->finished = qm_max(search->finished, pieces->bounds[i].most);
        if (!sides->has_points)
            status = offer_piece(search, &pieces->piece[i], pieces->bounds[i].most, sides->side[i]);
    }
    return status;
}

/** A vertex as a point of the first face that has it, or of a point set. */
static qm_surface_point vertex_point(const qm_mesh *mesh, uint32_t vertex)
{
    qm_surface_point out = {.face = mesh->face_count > 0 ? QM_NO_INDEX : vertex};
    for (size_t i = 0; out.face == QM_NO_INDEX && i < 4 * mesh->face_count; i++) {
        if (mesh->faces[i] != vertex) continue;
        bool is_quad = mesh->faces[i | 3] != QM_NO_INDEX;
        out.face = (uint32_t)(i / 4);
        out.uv[0] = i % 4 == 1 || (is_quad && i % 4 == 2) ? 1.0 : 0.0;
        out.uv[1] = i % 4 >= 2 ? 1.0 : 0.0;
    }
    return out;
}

/** The witness as a point of A, and its foot on B. */
static void set_witness(const side_search *search, qm_deviation_side *out)
{
    const qm_deviation_sides *sides = search->sides;
    const qm_deviation_setup *setup = &sides->pieces->setup;
    qm_vec p;
    out->has_witness = true;
    if (sides->has_points) {
        p = middle_of(sides, search->point);
        out->from = vertex_point(&setup->source->mesh, sides->point[search->point]);
        qm_vec_store(out->from.position, qm_frame_world(&setup->target->frame, p));
    } else {
        double u = 0.0, v = 0.0;
        for (int i = 0; i < 3; i++) {
            u += search->weight[i] * search->at.u[i];
            v += search->weight[i] * search->at.v[i];
        }
        p = qm_deviation_piece_point(setup, &search->at, u, v, &out->from);
    }
    out->to = qm_deviation_foot(setup, sides->options->quads, p);
}

/**
 * Bounds the distance on a side from above: by the pieces there and the open ones. A point of the surface that is in a crack between
 * pieces is on the side of one that it is next to, or no farther from the target than the crack is wide.
 */
static void set_upper(const side_search *search, double crack, qm_deviation_side *out)
{
    double inverse = search->sides->pieces->setup.target->frame.inverse_scale;
    double most = search->heap.count > 0 ? -search->heap.items[0].key : 0.0;
    most = qm_max(qm_max(most, search->finished), search->lower);
    bool is_none = !(most > 0.0) && search->nearest > crack;
    out->max.upper = is_none ? 0.0 : fmin(out->max.upper, (most + crack) * inverse + DBL_MIN);
}

static qm_status search_side(const qm_deviation_sides *sides, int side, qm_deviation_side *out)
{
    qm_refinement *pieces = sides->pieces;
    side_search search = {.sides = sides, .ctx = pieces->ctx, .side = side, .nearest = INFINITY};
    double crack = sides->has_points ? 0.0 : QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * pieces->setup.extent;
    double inverse = pieces->setup.target->frame.inverse_scale;
    pieces->setup.part_limit = SEARCH_PARTS;
    pieces->setup.patch_error = 4.0 * pieces->setup.eta;
    qm_status status = start_search(&search);
    bool is_whole = status == QM_OK; /* all pieces are in the heap */
    if (status == QM_OK) status = run_search(&search);
    /* Between points that stand for faces without area there is more of the surface. */
    bool is_all = !sides->has_points || pieces->setup.source->mesh.face_count == 0;
    if (is_whole && is_all && status != QM_E_NO_MEMORY) set_upper(&search, crack, out);
    if (search.has_witness) {
        out->max.lower = fmin(search.lower * inverse, out->max.upper);
        set_witness(&search, out);
    }
    qm_context_free(pieces->ctx, search.candidates, search.capacity, sizeof *search.candidates);
    qm_heap_reset(pieces->ctx, &search.heap);
    if (status == QM_E_NO_MEMORY)
        return qm_context_fail(pieces->ctx, status, "out of memory for the greatest distance");
    return status == QM_E_CANCELED ? qm_context_fail(pieces->ctx, status, "deviation canceled") : status;
}

/* ---- the calls ---- */

qm_status qm_deviation_sides_init(qm_context *ctx, const qm_deviation_options *options, qm_deviation *out)
{
    qm_signed_deviation *figures = &out->sides;
    const qm_interval max = {0.0, out->max.upper}, size = {0.0, out->size.upper};
    *figures = (qm_signed_deviation){.is_proven = options->sign != QM_SIGN_NORMAL,
                                     .mean = {0.0 - out->mean.upper, out->mean.upper},
                                     .front = {.max = max, .size = size},
                                     .behind = {.max = max, .size = size},
                                     .open_size = out->size.upper,
                                     .band_count = options->band_count};
    figures->band = qm_context_alloc(ctx, figures->band_count, sizeof *figures->band);
    if (!figures->band && figures->band_count > 0)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the bands");
    for (size_t i = 0; i < figures->band_count; i++)
        figures->band[i] = (qm_interval){0.0, 1.0};
    return QM_OK;
}

/** A mean that is positive inside. */
static void turn_mean(const qm_deviation_options *options, qm_interval *mean)
{
    if (options->sign == QM_SIGN_INSIDE) *mean = (qm_interval){0.0 - mean->upper, 0.0 - mean->lower};
}

qm_status qm_deviation_sides_measure(qm_deviation_sides *sides, qm_deviation *out)
{
    const qm_refinement *pieces = sides->pieces;
    qm_status status = QM_OK;
    if (sides->options->sign == QM_SIGN_NORMAL)
        status = qm_deviation_normals_init(pieces->ctx, pieces->setup.target, sides->options->quads,
                                           &sides->normals);
    if (status == QM_OK) status = find_sides(sides);
    if (status == QM_OK && !sides->has_points && pieces->has_area) status = cut_open(sides);
    if (status != QM_OK) return status;
    const all_sums sums = add_up(sides);
    set_sums(sides, &sums, out);
    turn_mean(sides->options, &out->sides.mean);
    status = set_bands(sides, &sums, out);
    if (status == QM_OK) status = search_side(sides, QM_PIECE_FRONT, &out->sides.front);
    if (status == QM_OK) status = search_side(sides, QM_PIECE_BEHIND, &out->sides.behind);
    return status;
}

void qm_deviation_sides_reset(qm_deviation_sides *sides)
{
    if (!sides->pieces) return;
    qm_context_free(sides->pieces->ctx, sides->side, sides->capacity, sizeof *sides->side);
    qm_deviation_normals_reset(sides->pieces->ctx, &sides->normals);
}
