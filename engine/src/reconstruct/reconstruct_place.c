/**
 * reconstruct_place.c: inner vertices from the points around them: of all triangles of points that enclose
 * the wanted parameters the one of the smallest perimeter is interpolated, and the result pulled onto the
 * surface. Where no triangle encloses them, the move is blended from those of the neighbours.
 */
#include "reconstruct_work.h"

#include <string.h>

#define QUADRANT_POINTS 3 /* nearest points kept in each quadrant round a vertex */
#define ENOUGH_POINTS 12  /* in a vertex's own cell; with fewer, those of the cells around join */
#define MOST_MOVE 2.0     /* longest edges at a vertex: no move onto the surface is farther */
#define BLEND_ROUNDS 20   /* of spreading the neighbours' moves into a hole */

enum { ROW = 3 * sizeof(double), NEAR_POINTS = 4 * QUADRANT_POINTS };

/** Samples by the vertex of the grids that they are nearest to. */
typedef struct vertex_bins {
    size_t bin_count, sample_count;
    size_t *patch_bin; /* first bin of each patch */
    uint32_t *start;   /* bin_count + 1 places in list */
    uint32_t *list;    /* samples */
} vertex_bins;

/** Points near a vertex, by their parameters less the vertex's own. */
typedef struct near_points {
    int count;
    double u[NEAR_POINTS], v[NEAR_POINTS], d2[NEAR_POINTS];
    uint32_t sample[NEAR_POINTS];
    int quadrant_count[4];
} near_points;

static size_t find_bin(const qm_reconstruction *r, const vertex_bins *bins, const qm_sample_place *place)
{
    const qm_patch_grid *grid = &r->grids[place->patch];
    size_t column = (size_t)(place->u + 0.5), row = (size_t)(place->v + 0.5);
    return bins->patch_bin[place->patch] + row * (grid->columns + 1) + column;
}

/** A point whose foot lies on the outline may lie anywhere beyond it, and tells nothing of the inside. */
static bool is_inside(const qm_reconstruction *r, const qm_sample_place *place)
{
    const qm_patch_grid *grid = &r->grids[place->patch];
    return place->u > 0.0 && place->v > 0.0 && place->u < grid->columns && place->v < grid->rows;
}

static void fill_bins(const qm_reconstruction *r, const qm_samples *samples, vertex_bins *bins)
{
    memset(bins->start, 0, (bins->bin_count + 1) * sizeof *bins->start);
    for (size_t i = 0; i < samples->count; i++)
        if (is_inside(r, &samples->place[i])) bins->start[find_bin(r, bins, &samples->place[i]) + 1]++;
    for (size_t b = 0; b < bins->bin_count; b++)
        bins->start[b + 1] += bins->start[b];
    /* Each bin's start runs on while it is filled, and is then where the next one begins. */
    for (size_t i = 0; i < samples->count; i++)
        if (is_inside(r, &samples->place[i]))
            bins->list[bins->start[find_bin(r, bins, &samples->place[i])]++] = (uint32_t)i;
    memmove(bins->start + 1, bins->start, bins->bin_count * sizeof *bins->start);
    bins->start[0] = 0;
}

static void free_bins(qm_context *ctx, const qm_reconstruction *r, vertex_bins *bins)
{
    qm_context_free(ctx, bins->patch_bin, r->layout.patch_count, sizeof *bins->patch_bin);
    qm_context_free(ctx, bins->start, bins->bin_count + 1, sizeof *bins->start);
    qm_context_free(ctx, bins->list, bins->sample_count, sizeof *bins->list);
}

static qm_status make_bins(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                           vertex_bins *bins)
{
    *bins = (vertex_bins){.sample_count = samples->count};
    bins->patch_bin = qm_context_alloc(ctx, r->layout.patch_count, sizeof *bins->patch_bin);
    for (size_t p = 0; bins->patch_bin && p < r->layout.patch_count; p++) {
        bins->patch_bin[p] = bins->bin_count;
        bins->bin_count += qm_grid_vertex_count(&r->grids[p]);
    }
    bins->start = qm_context_alloc(ctx, bins->bin_count + 1, sizeof *bins->start);
    bins->list = qm_context_alloc(ctx, samples->count, sizeof *bins->list);
    if (bins->patch_bin && bins->start && bins->list) {
        fill_bins(r, samples, bins);
        return QM_OK;
    }
    free_bins(ctx, r, bins);
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the points of the patches");
}

/** Keeps the nearest few of each quadrant: points all to one side, however many, would enclose nothing. */
static void consider(near_points *near, double u, double v, uint32_t sample)
{
    int quadrant = (u < 0.0 ? 1 : 0) + (v < 0.0 ? 2 : 0);
    int first = quadrant * QUADRANT_POINTS, place = first + near->quadrant_count[quadrant];
    double d2 = u * u + v * v;
    if (near->quadrant_count[quadrant] == QUADRANT_POINTS) {
        if (d2 >= near->d2[--place]) return;
    } else {
        near->quadrant_count[quadrant]++;
    }
    for (; place > first && d2 < near->d2[place - 1]; place--) {
        near->u[place] = near->u[place - 1];
        near->v[place] = near->v[place - 1];
        near->d2[place] = near->d2[place - 1];
        near->sample[place] = near->sample[place - 1];
    }
    near->u[place] = u;
    near->v[place] = v;
    near->d2[place] = d2;
    near->sample[place] = sample;
}

static void gather_bin(const vertex_bins *bins, const qm_samples *samples, size_t bin, double u, double v,
                       near_points *near)
{
    for (uint32_t k = bins->start[bin]; k < bins->start[bin + 1]; k++) {
        const qm_sample_place *place = &samples->place[bins->list[k]];
        consider(near, place->u - u, place->v - v, bins->list[k]);
    }
}

/** Closes the gaps between the quadrants. */
static void pack(near_points *near)
{
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

static void gather(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples, size_t p,
                   uint32_t i, uint32_t j, bool wide, near_points *near)
{
    uint32_t columns = r->grids[p].columns;
    memset(near->quadrant_count, 0, sizeof near->quadrant_count);
    size_t bin = bins->patch_bin[p] + (size_t)j * (columns + 1) + i;
    if (!wide) {
        gather_bin(bins, samples, bin, i, j, near);
    } else {
        for (int dj = -1; dj <= 1; dj++)
            for (int di = -1; di <= 1; di++)
                gather_bin(bins, samples, bin + (size_t)(dj * ((int)columns + 1) + di), i, j, near);
    }
    pack(near);
}

static qm_vec sample_at(const qm_samples *samples, uint32_t sample)
{
    return qm_vec_load(samples->positions + 3 * (size_t)sample);
}

/** Weights of the origin in a triangle of parameters; false when it lies outside. */
static bool enclose(const near_points *near, const int corner[3], double weight[3])
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

/** The enclosing triangle of the smallest perimeter, interpolated; false when there is none. */
static bool interpolate(const near_points *near, const qm_samples *samples, qm_vec *out)
{
    double best = INFINITY;
    qm_vec at[NEAR_POINTS];
    for (int a = 0; a < near->count; a++)
        at[a] = sample_at(samples, near->sample[a]);
    for (int a = 0; a < near->count; a++) {
        for (int b = a + 1; b < near->count; b++) {
            double edge = qm_vec_distance(at[a], at[b]);
            if (2.0 * edge >= best) continue;
            for (int c = b + 1; c < near->count; c++) {
                double weight[3];
                const int corner[3] = {a, b, c};
                if (!enclose(near, corner, weight)) continue;
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

/** The new place of a vertex; false in a hole. */
static bool place_vertex(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples,
                         size_t p, uint32_t i, uint32_t j, qm_vec *out)
{
    near_points near;
    gather(r, bins, samples, p, i, j, false, &near);
    if (near.count >= ENOUGH_POINTS && interpolate(&near, samples, out)) return true;
    gather(r, bins, samples, p, i, j, true, &near);
    return interpolate(&near, samples, out);
}

/** The longest of the four edges at a vertex. */
static double longest_edge(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    qm_vec here = qm_vec_load(qm_grid_vertex(grid, i, j));
    const double *around[4] = {qm_grid_vertex(grid, i - 1, j), qm_grid_vertex(grid, i + 1, j),
                               qm_grid_vertex(grid, i, j - 1), qm_grid_vertex(grid, i, j + 1)};
    double longest = 0.0;
    for (int k = 0; k < 4; k++)
        longest = fmax(longest, qm_vec_distance(here, qm_vec_load(around[k])));
    return longest;
}

/** The move of a vertex onto the surface; false in a hole, or where it would go farther than projected points
 * can tell: then it was an outlier that enclosed it. */
static bool find_move(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples,
                      size_t p, uint32_t i, uint32_t j, qm_vec *move)
{
    const qm_patch_grid *grid = &r->grids[p];
    qm_vec to;
    if (!place_vertex(r, bins, samples, p, i, j, &to)) return false;
    qm_foothold foot;
    double at[3];
    qm_vec_store(at, to);
    qm_source_pull(&r->source, at, &foot);
    *move = qm_vec_sub(qm_vec_load(foot.position), qm_vec_load(qm_grid_vertex(grid, i, j)));
    return !samples->is_projected || qm_vec_norm(*move) <= MOST_MOVE * longest_edge(grid, i, j);
}

/** Moves of the inner vertices of one grid; tells whether any lie in holes. */
static bool find_moves(const qm_reconstruction *r, const vertex_bins *bins, const qm_samples *samples,
                       size_t p, qm_vec *move)
{
    const qm_patch_grid *grid = &r->grids[p];
    bool has_hole = false;
    for (size_t k = 0; k < qm_grid_vertex_count(grid); k++)
        move[k] = (qm_vec){0, 0, 0};
    for (uint32_t j = 1; j < grid->rows; j++) {
        for (uint32_t i = 1; i < grid->columns; i++) {
            size_t k = qm_grid_index(grid, i, j);
            grid->in_hole[k] = !find_move(r, bins, samples, p, i, j, &move[k]);
            has_hole |= grid->in_hole[k];
        }
    }
    return has_hole;
}

/** Spreads the moves around a hole into it: each takes the mean of its neighbours', over and over. */
static void blend_holes(const qm_patch_grid *grid, qm_vec *move)
{
    size_t count = qm_grid_vertex_count(grid), width = (size_t)grid->columns + 1;
    for (size_t k = 0; k < count; k++)
        if (grid->in_hole[k]) move[k] = (qm_vec){0, 0, 0};
    for (int round = 0; round < BLEND_ROUNDS; round++)
        for (size_t k = 0; k < count; k++)
            if (grid->in_hole[k])
                move[k] = qm_vec_scale(0.25, qm_vec_add(qm_vec_add(move[k - 1], move[k + 1]),
                                                        qm_vec_add(move[k - width], move[k + width])));
}

/** A blended vertex goes onto the surface where there is one: a mesh has no holes that samples tell of, and a
 * point set has none where it lies among the points. */
static void pull_blended(const qm_source *source, double vertex[3])
{
    qm_foothold foot;
    qm_source_pull(source, vertex, &foot);
    if (!source->is_cloud || foot.distance <= foot.spacing) memcpy(vertex, foot.position, ROW);
}

/** The outline is left alone, bit for bit. */
static void apply_moves(const qm_source *source, qm_patch_grid *grid, const qm_vec *move)
{
    for (uint32_t j = 1; j < grid->rows; j++) {
        for (uint32_t i = 1; i < grid->columns; i++) {
            size_t k = qm_grid_index(grid, i, j);
            double *vertex = grid->vertices + 3 * k;
            qm_vec_store(vertex, qm_vec_add(qm_vec_load(vertex), move[k]));
            if (grid->in_hole[k]) pull_blended(source, vertex);
        }
    }
}

static qm_status place_grid(qm_context *ctx, qm_reconstruction *r, const vertex_bins *bins,
                            const qm_samples *samples, size_t p)
{
    qm_patch_grid *grid = &r->grids[p];
    size_t count = qm_grid_vertex_count(grid);
    qm_vec *move = qm_context_alloc(ctx, count, sizeof *move);
    if (!move) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a patch");
    if (find_moves(r, bins, samples, p, move)) blend_holes(grid, move);
    apply_moves(&r->source, grid, move);
    qm_context_free(ctx, move, count, sizeof *move);
    return QM_OK;
}

qm_status qm_place_vertices(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples)
{
    vertex_bins bins;
    qm_status status = make_bins(ctx, r, samples, &bins);
    if (status != QM_OK) return status;
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK; p++) {
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        if (status == QM_OK && r->grids[p].is_stale) status = place_grid(ctx, r, &bins, samples, p);
    }
    free_bins(ctx, r, &bins);
    return status;
}
