/**
 * cloud_levels.c: grids from coarse to fine, each with half the side of the one before. The function on one is what the next one
 * starts with.
 */
#include "cloud_levels.h"

#include <string.h>

#include "cloud_isosurface.h"

#define COARSEST 12.0 /* cells along the longest side of the box at least, and fewer than twice as many */
#define MARGIN 3.0    /* coarsest cells round the box */
#define MOST_OCCUPIED 400000 /* cells with points: about 12 times as many nodes of 100 bytes each */

#define MIN_SLOPE 0.3 /* of the function against a normal, which has the slope 1, to turn it */
#define TURNS 2       /* of normals on the finest grid, each with another solution */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the cells round points");
}

void qm_cloud_level_reset(qm_context *ctx, qm_cloud_level *level)
{
    qm_context_free(ctx, level->field, level->grid.node_count, sizeof *level->field);
    level->field = NULL;
    qm_cloud_grid_reset(ctx, &level->grid);
}

/** Keys as they are collected. */
typedef struct key_list {
    uint64_t *keys;
    size_t count, capacity;
} key_list;

static qm_status reserve(qm_context *ctx, key_list *list, size_t more)
{
    if (list->count + more <= list->capacity) return QM_OK;
    size_t capacity = 2 * list->capacity + more;
    uint64_t *keys = qm_context_resize(ctx, list->keys, list->capacity, capacity, sizeof *keys);
    if (!keys) return no_memory(ctx);
    list->keys = keys;
    list->capacity = capacity;
    return QM_OK;
}

/** Adds the cells from `before` below a place to `after` above it, on each axis. */
static qm_status add_block(qm_context *ctx, key_list *list, const uint64_t at[3], uint64_t before,
                           uint64_t after)
{
    uint64_t low[3], high[3];
    qm_status status = reserve(ctx, list, (before + after + 1) * (before + after + 1) * (before + after + 1));
    if (status != QM_OK) return status;
    for (int k = 0; k < 3; k++) {
        low[k] = at[k] > before ? at[k] - before : 0;
        high[k] = at[k] + after;
    }
    for (uint64_t z = low[2]; z <= high[2]; z++)
        for (uint64_t y = low[1]; y <= high[1]; y++)
            for (uint64_t x = low[0]; x <= high[0]; x++)
                list->keys[list->count++] = qm_cloud_key(x, y, z);
    return QM_OK;
}

static void split_key(uint64_t key, uint64_t at[3])
{
    for (int k = 0; k < 3; k++)
        at[k] = qm_cloud_key_part(key, k);
}

/** The keys of the cells with points, for the caller to free. */
static qm_status find_occupied(qm_context *ctx, const qm_cloud_points *points, qm_vec origin, double side,
                               key_list *out)
{
    const qm_cloud_grid frame = {.origin = origin, .side = side};
    *out = (key_list){.capacity = points->count};
    out->keys = qm_context_alloc(ctx, points->count, sizeof *out->keys);
    if (!out->keys) return no_memory(ctx);
    for (size_t i = 0; i < points->count; i++)
        out->keys[out->count++] = qm_cloud_grid_key_at(&frame, points->position[i]);
    return qm_cloud_keys_sort(ctx, out->keys, &out->count);
}

static void free_keys(qm_context *ctx, key_list *list)
{
    qm_context_free(ctx, list->keys, list->capacity, sizeof *list->keys);
    *list = (key_list){0};
}

/** The key of the cell of the coarser grid that holds a cell. */
static uint64_t parent_of(uint64_t key)
{
    uint64_t at[3];
    split_key(key, at);
    return qm_cloud_key(at[0] / 2, at[1] / 2, at[2] / 2);
}

/** Lists the cells of the next grid, each once. */
static qm_status list_cells(qm_context *ctx, const qm_cloud_level *coarse, const qm_cloud_points *points,
                            key_list *out)
{
    key_list occupied;
    uint64_t at[3];
    *out = (key_list){0};
    qm_status status = find_occupied(ctx, points, coarse->grid.origin, 0.5 * coarse->grid.side, &occupied);
    for (size_t i = 0; i < occupied.count && status == QM_OK; i++) {
        split_key(occupied.keys[i], at);
        status = add_block(ctx, out, at, points->rings, points->rings);
    }
    free_keys(ctx, &occupied);
    for (size_t c = 0; c < coarse->grid.cell_count && status == QM_OK; c++) {
        if (!qm_cloud_crosses(&coarse->grid, coarse->field, c)) continue;
        split_key(coarse->grid.cells[c], at);
        for (int k = 0; k < 3; k++)
            at[k] *= 2;
        status = add_block(ctx, out, at, 1, 2);
    }
    if (status == QM_OK) status = qm_cloud_keys_sort(ctx, out->keys, &out->count);
    return status;
}

/** Drops the cells that lie in none of the coarser grid, and sets the cells in which the others lie. */
static void keep_children(const qm_cloud_grid *coarse, key_list *list, uint32_t *parent)
{
    size_t kept = 0;
    for (size_t i = 0; i < list->count; i++) {
        size_t cell = qm_cloud_keys_find(coarse->cells, coarse->cell_count, parent_of(list->keys[i]));
        if (cell == SIZE_MAX) continue;
        parent[kept] = (uint32_t)cell;
        list->keys[kept++] = list->keys[i];
    }
    list->count = kept;
}

/** Interpolates the values of the coarser grid, which are in cells of twice the side. */
static void interpolate(const qm_cloud_level *coarse, const uint32_t *parent, qm_cloud_level *fine)
{
    const qm_cloud_grid *grid = &fine->grid;
    for (size_t c = 0; c < grid->cell_count; c++) {
        uint32_t corner[8], around[8];
        uint64_t at[3];
        qm_cloud_grid_corners(grid, c, corner);
        qm_cloud_grid_corners(&coarse->grid, parent[c], around);
        split_key(grid->cells[c], at);
        for (int i = 0; i < 8; i++) {
            qm_vec place = {0.5 * (double)((at[0] & 1) + (i & 1)), 0.5 * (double)((at[1] & 1) + (i >> 1 & 1)),
                            0.5 * (double)((at[2] & 1) + (uint64_t)(i >> 2))};
            double value[8], slope[3][8], sum = 0.0;
            qm_cloud_grid_weights(place, value, slope);
            for (int k = 0; k < 8; k++)
                sum += value[k] * coarse->field[around[k]];
            fine->field[corner[i]] = 2.0 * sum;
        }
    }
}

static qm_status solve(qm_context *ctx, const qm_cloud_points *points, qm_cloud_level *level)
{
    qm_cloud_sample *samples;
    size_t count;
    qm_status status = qm_cloud_samples_make(ctx, &level->grid, points, &samples, &count);
    if (status == QM_OK) status = qm_cloud_field_solve(ctx, &level->grid, samples, count, level->field);
    qm_context_free(ctx, samples, level->grid.cell_count, sizeof *samples);
    return status;
}

/** The slope of the function at a point; 0 outside the grid. */
static qm_vec slope_at(const qm_cloud_level *level, qm_vec p)
{
    const qm_cloud_grid *grid = &level->grid;
    uint64_t key = qm_cloud_grid_key_at(grid, p);
    size_t cell = qm_cloud_keys_find(grid->cells, grid->cell_count, key);
    qm_vec sum = {0, 0, 0};
    if (cell == SIZE_MAX) return sum;
    uint32_t corner[8];
    double value[8], slope[3][8];
    qm_cloud_grid_corners(grid, cell, corner);
    qm_cloud_grid_weights(qm_cloud_grid_within(grid, key, p), value, slope);
    for (int i = 0; i < 8; i++) {
        double f = level->field[corner[i]];
        sum = qm_vec_add(sum, (qm_vec){f * slope[0][i], f * slope[1][i], f * slope[2][i]});
    }
    return sum;
}

/** Turns normals round that the function contradicts, to which all points near them contributed. Returns how many. */
static size_t turn_normals(const qm_cloud_level *level, const qm_cloud_points *points)
{
    size_t turned = 0;
    for (size_t i = 0; i < points->count && !points->is_sure; i++) {
        if (!(qm_vec_dot(points->normal[i], slope_at(level, points->position[i])) < -MIN_SLOPE)) continue;
        points->normal[i] = qm_vec_scale(-1.0, points->normal[i]);
        turned++;
    }
    return turned;
}

/** Counts the points along whose normals the function grows by less than a third of what it should. */
static size_t count_thin(const qm_cloud_level *level, const qm_cloud_points *points)
{
    size_t count = 0;
    for (size_t i = 0; i < points->count; i++)
        count += !(qm_vec_dot(points->normal[i], slope_at(level, points->position[i])) > MIN_SLOPE);
    return count;
}

/** Makes the grid of the cells, which it takes over, and room for its values. */
static qm_status make_level(qm_context *ctx, qm_vec origin, double side, key_list *cells, qm_cloud_level *out)
{
    qm_status status =
        qm_cloud_grid_make(ctx, origin, side, cells->keys, cells->count, cells->capacity, &out->grid);
    *cells = (key_list){0};
    if (status != QM_OK) return status;
    out->field = qm_context_alloc(ctx, out->grid.node_count, sizeof *out->field);
    return out->field ? QM_OK : no_memory(ctx);
}

/** Replaces a level by the next finer one. */
static qm_status refine(qm_context *ctx, const qm_cloud_points *points, qm_cloud_level *level)
{
    key_list cells;
    qm_cloud_level fine = {0};
    qm_status status = list_cells(ctx, level, points, &cells);
    size_t listed = cells.count;
    uint32_t *parent = status == QM_OK ? qm_context_alloc(ctx, listed, sizeof *parent) : NULL;
    if (status == QM_OK && !parent) status = no_memory(ctx);
    if (status == QM_OK) keep_children(&level->grid, &cells, parent);
    if (status == QM_OK) status = make_level(ctx, level->grid.origin, 0.5 * level->grid.side, &cells, &fine);
    if (status == QM_OK) interpolate(level, parent, &fine);
    qm_context_free(ctx, parent, listed, sizeof *parent);
    free_keys(ctx, &cells);
    qm_cloud_level_reset(ctx, level);
    *level = fine;
    return status == QM_OK ? solve(ctx, points, level) : status;
}

/** The first level: all cells of the box, where the function is 0 until points say otherwise. */
static qm_status start(qm_context *ctx, const qm_cloud_points *points, qm_vec origin, double side,
                       const uint64_t count[3], qm_cloud_level *out)
{
    key_list cells = {0};
    qm_status status = reserve(ctx, &cells, count[0] * count[1] * count[2]);
    for (uint64_t z = 0; z < count[2] && status == QM_OK; z++)
        for (uint64_t y = 0; y < count[1]; y++)
            for (uint64_t x = 0; x < count[0]; x++)
                cells.keys[cells.count++] = qm_cloud_key(x, y, z);
    if (status == QM_OK) status = make_level(ctx, origin, side, &cells, out);
    if (status != QM_OK) return status;
    memset(out->field, 0, out->grid.node_count * sizeof *out->field);
    return solve(ctx, points, out);
}

/** The side of the finest cells: the wanted one, or greater while too many cells have points. */
static qm_status choose_side(qm_context *ctx, const qm_cloud_points *points, qm_vec low, double extent,
                             double *side)
{
    const double finest = extent / (double)(1 << 16);
    *side = fmin(fmax(*side, finest), extent / COARSEST);
    for (int round = 0; round < 8; round++) {
        key_list occupied;
        qm_status status = find_occupied(ctx, points, low, *side, &occupied);
        size_t count = occupied.count;
        free_keys(ctx, &occupied);
        if (status != QM_OK || count <= MOST_OCCUPIED) return status;
        *side *= fmax(1.1, sqrt((double)count / MOST_OCCUPIED));
    }
    return QM_OK;
}

qm_status qm_cloud_levels_solve(qm_context *ctx, const qm_cloud_points *points, double side,
                                qm_cloud_level *out)
{
    QM_ASSERT(points->count > 0 && side > 0.0);
    *out = (qm_cloud_level){0};
    qm_vec low = points->position[0], high = low;
    for (size_t i = 1; i < points->count; i++) {
        qm_vec p = points->position[i];
        low = (qm_vec){fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z)};
        high = (qm_vec){fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z)};
    }
    const double size[3] = {high.x - low.x, high.y - low.y, high.z - low.z};
    double extent = fmax(size[0], fmax(size[1], size[2]));
    qm_status status = choose_side(ctx, points, low, extent, &side);
    int levels = 0;
    for (; extent / side >= 2.0 * COARSEST; levels++)
        side *= 2.0;
    uint64_t count[3];
    for (int k = 0; k < 3; k++)
        count[k] = (uint64_t)(size[k] / side) + 1 + (uint64_t)(2.0 * MARGIN);
    qm_vec origin = {low.x - MARGIN * side, low.y - MARGIN * side, low.z - MARGIN * side};
    if (status == QM_OK) status = start(ctx, points, origin, side, count, out);
    for (int k = 0; k < levels && status == QM_OK; k++) {
        turn_normals(out, points);
        status = refine(ctx, points, out);
    }
    for (int k = 0; k < TURNS && status == QM_OK && turn_normals(out, points) > 0; k++)
        status = solve(ctx, points, out);
    if (status == QM_OK)
        out->thin = count_thin(out, points);
    else
        qm_cloud_level_reset(ctx, out);
    return status;
}
