/**
 * reconstruct_lattice_fit.c: inner vertices of lattices from the samples around them.
 *
 * Of all triangles of samples that enclose the parameters of a vertex, the one with the smallest perimeter is
 * interpolated, and the result projected onto the surface. Where no triangle encloses them, in a hole, the
 * move of the vertex is blended from those of its neighbours.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define QUADRANT_POINTS 3 /* samples kept in each quadrant round a vertex, the nearest ones */
#define MIN_BIN_POINTS 12 /* in a vertex's own bin; with fewer, those of the bins around it are used too */
#define MAX_MOVE 2.0      /* longest edges at a vertex: a longer move is due to an outlier */
#define BLEND_ROUNDS 20   /* of spreading the neighbours' moves into a hole */

enum { POINT_SIZE = 3 * sizeof(double), NEAR_POINTS = 4 * QUADRANT_POINTS };

/** Samples by the lattice vertex that is nearest in parameters: a counting sort. */
typedef struct vertex_bins {
    size_t bin_count, sample_count;
    size_t *patch_bin; /* first bin of each patch */
    uint32_t *start;   /* bin_count + 1 indices into list */
    uint32_t *list;    /* samples */
} vertex_bins;

/** Samples near a vertex, at their parameters less the vertex's own. */
typedef struct near_points {
    int count;
    double u[NEAR_POINTS], v[NEAR_POINTS], d2[NEAR_POINTS];
    uint32_t sample[NEAR_POINTS];
    int quadrant_count[4];
} near_points;

static size_t find_bin(const qm_reconstruction *r, const vertex_bins *bins,
                       const qm_sample_location *location)
{
    const qm_lattice *lattice = &r->lattices[location->patch];
    size_t column = (size_t)(location->u + 0.5), row = (size_t)(location->v + 0.5);
    QM_ASSERT(column <= lattice->columns && row <= lattice->rows);
    return bins->patch_bin[location->patch] + row * (lattice->columns + 1) + column;
}

/**
 * False for a sample whose projection lies on the border of its patch: it may lie anywhere beyond the patch.
 */
static bool is_inside(const qm_reconstruction *r, const qm_sample_location *location)
{
    const qm_lattice *lattice = &r->lattices[location->patch];
    return location->u > 0.0 && location->v > 0.0 && location->u < lattice->columns &&
           location->v < lattice->rows;
}

static void free_bins(qm_context *ctx, const qm_reconstruction *r, vertex_bins *bins)
{
    qm_context_free(ctx, bins->patch_bin, r->layout.patch_count, sizeof *bins->patch_bin);
    qm_context_free(ctx, bins->start, bins->bin_count + 1, sizeof *bins->start);
    qm_context_free(ctx, bins->list, bins->sample_count, sizeof *bins->list);
}

static qm_status create_bins(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                             vertex_bins *bins)
{
    *bins = (vertex_bins){.sample_count = samples->count};
    bins->patch_bin = qm_context_alloc(ctx, r->layout.patch_count, sizeof *bins->patch_bin);
    for (size_t p = 0; bins->patch_bin && p < r->layout.patch_count; p++) {
        bins->patch_bin[p] = bins->bin_count;
        bins->bin_count += qm_lattice_vertex_count(&r->lattices[p]);
    }
    bins->start = qm_context_alloc(ctx, bins->bin_count + 1, sizeof *bins->start);
    bins->list = qm_context_alloc(ctx, samples->count, sizeof *bins->list);
    if (!bins->patch_bin || !bins->start || !bins->list) {
        free_bins(ctx, r, bins);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the points of the patches");
    }
    memset(bins->start, 0, (bins->bin_count + 1) * sizeof *bins->start);
    for (size_t i = 0; i < samples->count; i++)
        if (is_inside(r, &samples->location[i])) bins->start[find_bin(r, bins, &samples->location[i]) + 1]++;
    for (size_t b = 0; b < bins->bin_count; b++)
        bins->start[b + 1] += bins->start[b];
    /* Each bin's start runs on while it is filled, and is then where the next one begins. */
    for (size_t i = 0; i < samples->count; i++)
        if (is_inside(r, &samples->location[i]))
            bins->list[bins->start[find_bin(r, bins, &samples->location[i])]++] = (uint32_t)i;
    memmove(bins->start + 1, bins->start, bins->bin_count * sizeof *bins->start);
    bins->start[0] = 0;
    return QM_OK;
}

/** Keeps the nearest samples of each quadrant: samples on one side only would enclose nothing. */
static void keep_nearest(near_points *near, double u, double v, uint32_t sample)
{
    int quadrant = (u < 0.0 ? 1 : 0) + (v < 0.0 ? 2 : 0);
    int first = quadrant * QUADRANT_POINTS, slot = first + near->quadrant_count[quadrant];
    double d2 = u * u + v * v;
    if (near->quadrant_count[quadrant] == QUADRANT_POINTS) {
        if (d2 >= near->d2[--slot]) return;
    } else {
        near->quadrant_count[quadrant]++;
    }
    for (; slot > first && d2 < near->d2[slot - 1]; slot--) {
        near->u[slot] = near->u[slot - 1];
        near->v[slot] = near->v[slot - 1];
        near->d2[slot] = near->d2[slot - 1];
        near->sample[slot] = near->sample[slot - 1];
    }
    near->u[slot] = u;
    near->v[slot] = v;
    near->d2[slot] = d2;
    near->sample[slot] = sample;
}

static void gather_bin(const vertex_bins *bins, const qm_samples *samples, size_t bin, double u, double v,
                       near_points *near)
{
    for (uint32_t k = bins->start[bin]; k < bins->start[bin + 1]; k++) {
        const qm_sample_location *location = &samples->location[bins->list[k]];
        keep_nearest(near, location->u - u, location->v - v, bins->list[k]);
    }
}

/** Gathers the samples in the bin of a vertex, or in the nine bins round it. */
static void gather(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples, size_t p,
                   uint32_t i, uint32_t j, bool is_wide, near_points *near)
{
    uint32_t columns = r->lattices[p].columns;
    memset(near->quadrant_count, 0, sizeof near->quadrant_count);
    size_t bin = bins->patch_bin[p] + (size_t)j * (columns + 1) + i;
    if (!is_wide) {
        gather_bin(bins, samples, bin, i, j, near);
    } else {
        for (int dj = -1; dj <= 1; dj++)
            for (int di = -1; di <= 1; di++)
                gather_bin(bins, samples, bin + (size_t)(dj * ((int)columns + 1) + di), i, j, near);
    }
    /* The samples of all quadrants move to the front. */
    near->count = 0;
    for (int quadrant = 0; quadrant < 4; quadrant++) {
        for (int k = 0; k < near->quadrant_count[quadrant]; k++) {
            int from = quadrant * QUADRANT_POINTS + k, to = near->count++;
            near->u[to] = near->u[from];
            near->v[to] = near->v[from];
            near->sample[to] = near->sample[from];
        }
    }
}

/** Barycentric coordinates of the origin in a triangle of parameters. False if it lies outside. */
static bool find_weights(const near_points *near, const int corner[3], double weight[3])
{
    double area[3], sum = 0.0;
    for (int k = 0; k < 3; k++) {
        int a = corner[(k + 1) % 3], b = corner[(k + 2) % 3];
        area[k] = near->u[a] * near->v[b] - near->u[b] * near->v[a];
        sum += area[k];
    }
    double sign = sum < 0.0 ? -1.0 : 1.0;
    if (!(fabs(sum) > 1e-12)) return false;
    for (int k = 0; k < 3; k++) {
        if (area[k] * sign < 0.0) return false;
        weight[k] = area[k] / sum;
    }
    return true;
}

/** Interpolates in the enclosing triangle of the smallest perimeter. False if there is none. */
static bool interpolate(const near_points *near, const qm_samples *samples, qm_vec *out)
{
    double best = INFINITY;
    qm_vec at[NEAR_POINTS];
    for (int a = 0; a < near->count; a++)
        at[a] = qm_vec_load(samples->positions + 3 * (size_t)near->sample[a]);
    for (int a = 0; a < near->count; a++) {
        for (int b = a + 1; b < near->count; b++) {
            double edge = qm_vec_distance(at[a], at[b]);
            if (2.0 * edge >= best) continue;
            for (int c = b + 1; c < near->count; c++) {
                double weight[3];
                const int corner[3] = {a, b, c};
                if (!find_weights(near, corner, weight)) continue;
                double perimeter = edge + qm_vec_distance(at[b], at[c]) + qm_vec_distance(at[c], at[a]);
                if (perimeter >= best) continue;
                best = perimeter;
                *out = qm_vec_axpy(qm_vec_axpy(qm_vec_scale(weight[0], at[a]), weight[1], at[b]), weight[2],
                                   at[c]);
            }
        }
    }
    return best < INFINITY;
}

/**
 * The move of a vertex onto the surface. False in a hole, or where the move is too long for projected
 * samples: an outlier enclosed the vertex then.
 */
static bool find_move(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples,
                      size_t p, uint32_t i, uint32_t j, qm_vec *move)
{
    const qm_lattice *lattice = &r->lattices[p];
    qm_vec to;
    near_points near;
    gather(r, bins, samples, p, i, j, false, &near);
    if (near.count < MIN_BIN_POINTS || !interpolate(&near, samples, &to)) {
        gather(r, bins, samples, p, i, j, true, &near);
        if (!interpolate(&near, samples, &to)) return false;
    }
    qm_ref_surface_point projection;
    double at[3];
    qm_vec_store(at, to);
    qm_lattice_project_own(r, p, i, j, at, &projection);
    *move = qm_vec_sub(qm_vec_load(projection.position), qm_vec_load(qm_lattice_vertex(lattice, i, j)));
    if (!samples->is_projected) return true;
    qm_vec here = qm_lattice_at(lattice, i, j);
    const qm_vec neighbour[4] = {qm_lattice_at(lattice, i - 1, j), qm_lattice_at(lattice, i + 1, j),
                                 qm_lattice_at(lattice, i, j - 1), qm_lattice_at(lattice, i, j + 1)};
    double longest = 0.0;
    for (int k = 0; k < 4; k++)
        longest = fmax(longest, qm_vec_distance(here, neighbour[k]));
    return qm_vec_norm(*move) <= MAX_MOVE * longest;
}

/** Finds the moves of the inner vertices of a lattice, and marks those in holes. True if there are any. */
static bool set_moves(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples,
                      size_t p, qm_vec *move)
{
    const qm_lattice *lattice = &r->lattices[p];
    bool has_hole = false;
    for (size_t k = 0; k < qm_lattice_vertex_count(lattice); k++)
        move[k] = (qm_vec){0, 0, 0};
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            size_t k = qm_lattice_index(lattice, i, j);
            lattice->in_hole[k] = !find_move(r, bins, samples, p, i, j, &move[k]);
            has_hole |= lattice->in_hole[k];
        }
    }
    return has_hole;
}

/** Spreads the moves round holes into them by relaxation: each becomes the mean of its neighbours. */
static void blend_holes(const qm_lattice *lattice, qm_vec *move)
{
    size_t count = qm_lattice_vertex_count(lattice), width = (size_t)lattice->columns + 1;
    for (size_t k = 0; k < count; k++)
        if (lattice->in_hole[k]) move[k] = (qm_vec){0, 0, 0};
    for (int round = 0; round < BLEND_ROUNDS; round++)
        for (size_t k = 0; k < count; k++)
            if (lattice->in_hole[k])
                move[k] = qm_vec_scale(0.25, qm_vec_add(qm_vec_add(move[k - 1], move[k + 1]),
                                                        qm_vec_add(move[k - width], move[k + width])));
}

/** Makes a lattice the Coons patch of its curves, all of whose inner vertices are in a hole. */
static void span_hole(const qm_lattice *lattice)
{
    const qm_vertex_block all = {{0, 0}, {lattice->columns, lattice->rows}};
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            qm_vec_store(qm_lattice_vertex(lattice, i, j), qm_lattice_coons(lattice, &all, i, j));
            lattice->in_hole[qm_lattice_index(lattice, i, j)] = true;
        }
    }
}

static qm_status fit_lattice(qm_context *ctx, qm_reconstruction *r, const vertex_bins *bins,
                             const qm_samples *samples, size_t p)
{
    qm_lattice *lattice = &r->lattices[p];
    size_t count = qm_lattice_vertex_count(lattice);
    if (lattice->spans_hole) return span_hole(lattice), QM_OK;
    qm_vec *move = qm_context_alloc(ctx, count, sizeof *move);
    if (!move) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a patch");
    if (set_moves(r, bins, samples, p, move)) blend_holes(lattice, move);
    /*
     * Move the inner vertices. A blended one is projected onto the surface where there is one: always on a mesh,
     * on a point set where the vertex lies among points.
     */
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            size_t k = qm_lattice_index(lattice, i, j);
            double *vertex = lattice->vertices + 3 * k;
            qm_vec_store(vertex, qm_vec_add(qm_vec_load(vertex), move[k]));
            if (!lattice->in_hole[k]) continue;
            qm_ref_surface_point projection;
            qm_lattice_project_own(r, p, i, j, vertex, &projection);
            if (!r->surface.is_cloud || projection.distance <= projection.spacing)
                memcpy(vertex, projection.position, POINT_SIZE);
        }
    }
    qm_context_free(ctx, move, count, sizeof *move);
    return QM_OK;
}

qm_status qm_lattices_fit(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples)
{
    vertex_bins bins;
    qm_status status = create_bins(ctx, r, samples, &bins);
    if (status != QM_OK) return status;
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK; p++) {
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        if (status == QM_OK && r->lattices[p].is_stale) status = fit_lattice(ctx, r, &bins, samples, p);
    }
    free_bins(ctx, r, &bins);
    return status;
}
