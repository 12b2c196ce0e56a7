/**
 * grid.c: builds a uniform grid. The faces of each pack in turn mark the cells that they may meet: those that
 * meet both the box of the face's corners and the slab that holds the corners along the face's normal. Both
 * contain the convex hull of the corners, and with it the triangles and the bilinear patch; a slab along any
 * direction would, so the normal of a sliver does no harm. The marks are counted, then sorted by cell.
 */
#include <string.h>

#include "grid_cells.h"

#define MAX_CELLS 0x1p26     /* in the box of the mesh */
#define MIN_ENTRY_LIMIT 1024 /* entries that a grid may have whatever the size of the mesh */
#define TESTS_PER_ENTRY 16   /* cells tested for each entry allowed */
#define TOUCHED_BLOCKS 32    /* blocks of one pack kept until they are flushed */
#define CANCEL_INTERVAL 4096 /* packs between two checks of the cancel flag */

/**
 * Fraction of half a cell's extent along the normal n by which slabs are enlarged, |n|_1 2^-11. Coordinates
 * are at most C = 2^31 cells (2 by at least 2^-30), so with u = 2^-53 two dot products are off by 3 u |n|_1 C
 * each and the corners' positions by 2 u C along each axis: |n|_1 2^-19 in all. The rounding of n itself does
 * not matter.
 */
#define SLAB_MARGIN 0x1p-10

/** Cells of one block that one pack meets. */
typedef struct marked_block {
    uint64_t cells;
    uint32_t block, pack;
} marked_block;

typedef struct grid_builder {
    qm_context *ctx;
    qm_grid *grid;
    marked_block *marked;
    size_t marked_count, marked_capacity;
    size_t entries, entry_limit; /* of the cells' lists */
    size_t tests, test_limit;    /* cells tested */
    int touched_count;
    marked_block touched[TOUCHED_BLOCKS]; /* of the current pack */
} grid_builder;

/** Appends the touched blocks of the current pack to the marked ones. False when out of memory. */
static bool flush_touched(grid_builder *builder)
{
    size_t wanted = builder->marked_count + (size_t)builder->touched_count;
    if (wanted > builder->marked_capacity) {
        size_t capacity = 2 * builder->marked_capacity + TOUCHED_BLOCKS;
        marked_block *grown = qm_context_resize(builder->ctx, builder->marked, builder->marked_capacity,
                                                capacity, sizeof *grown);
        if (!grown) return false;
        builder->marked = grown;
        builder->marked_capacity = capacity;
    }
    for (int i = 0; i < builder->touched_count; i++) {
        const marked_block *touched = &builder->touched[i];
        builder->marked[builder->marked_count++] = *touched;
        builder->grid->block[touched->block].used |= touched->cells;
        builder->entries += (size_t)__builtin_popcountll(touched->cells);
    }
    builder->touched_count = 0;
    return true;
}

/** Marks a cell for a pack. Where a pack touches very many blocks, it may be listed twice in a cell. */
static bool mark_cell(grid_builder *builder, uint32_t pack, const int cell[3])
{
    uint32_t block = (uint32_t)qm_grid_block_at(builder->grid, cell[0] >> 2, cell[1] >> 2, cell[2] >> 2);
    uint64_t bit = UINT64_C(1) << ((cell[0] & 3) + 4 * (cell[1] & 3) + 16 * (cell[2] & 3));
    int i = builder->touched_count;
    while (i-- > 0) {
        if (builder->touched[i].block != block) continue;
        builder->touched[i].cells |= bit;
        return true;
    }
    if (builder->touched_count == TOUCHED_BLOCKS && !flush_touched(builder)) return false;
    builder->touched[builder->touched_count++] = (marked_block){bit, block, pack};
    return true;
}

/** A range of cells, and the slab that marked cells meet. */
typedef struct hull_cells {
    int low[3], high[3];
    qm_vec normal;
    double min, max; /* of normal . center of a cell */
} hull_cells;

static hull_cells hull_cells_make(const qm_grid *grid, const qm_vec *corner, int count)
{
    hull_cells hull;
    qm_box box = qm_vec_box(corner, count);
    for (int k = 0; k < 3; k++) {
        hull.low[k] = qm_grid_clamp(box.min[k] - QM_GRID_MARGIN, grid->size[k]);
        hull.high[k] = qm_grid_clamp(box.max[k] + QM_GRID_MARGIN, grid->size[k]);
    }
    hull.normal = qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[count - 1], corner[1]));
    hull.min = hull.max = qm_vec_dot(hull.normal, corner[0]);
    for (int i = 1; i < count; i++) {
        double along = qm_vec_dot(hull.normal, corner[i]);
        hull.min = fmin(hull.min, along);
        hull.max = fmax(hull.max, along);
    }
    double half = 0.5 * (fabs(hull.normal.x) + fabs(hull.normal.y) + fabs(hull.normal.z));
    hull.min -= (1.0 + SLAB_MARGIN) * half;
    hull.max += (1.0 + SLAB_MARGIN) * half;
    return hull;
}

static bool mark_hull(grid_builder *builder, uint32_t pack, const qm_vec *corner, int count)
{
    hull_cells hull = hull_cells_make(builder->grid, corner, count);
    int cell[3];
    for (cell[2] = hull.low[2]; cell[2] <= hull.high[2]; cell[2]++) {
        for (cell[1] = hull.low[1]; cell[1] <= hull.high[1]; cell[1]++) {
            builder->tests += (size_t)(hull.high[0] - hull.low[0] + 1);
            if (builder->tests > builder->test_limit) return true;
            for (cell[0] = hull.low[0]; cell[0] <= hull.high[0]; cell[0]++) {
                qm_vec center = {cell[0] + 0.5, cell[1] + 0.5, cell[2] + 0.5};
                double along = qm_vec_dot(hull.normal, center);
                if (along < hull.min || along > hull.max) continue;
                if (!mark_cell(builder, pack, cell)) return false;
            }
        }
    }
    return true;
}

/** True when the cells are too small: the grid has too many entries or tests. */
static bool is_over_limit(const grid_builder *builder)
{
    return builder->entries > builder->entry_limit || builder->tests > builder->test_limit;
}

static bool mark_pack(grid_builder *builder, uint32_t pack)
{
    const qm_bvh *bvh = builder->grid->bvh;
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_vec position[3 * QM_PACK_LANES];
    for (int i = 0; i < lanes->vertex_count; i++)
        position[i] = qm_grid_position(builder->grid, qm_bvh_vertex(bvh, lanes->vertex[i]));
    for (int lane = 0, count; lane < lanes->lane_count; lane += count - 2) {
        int index[4];
        count = qm_lane_corners(lanes, (uint32_t)lane, qm_bvh_has_twists(bvh), index);
        qm_vec corner[4];
        for (int i = 0; i < count; i++)
            corner[i] = position[index[i]];
        if (!mark_hull(builder, pack, corner, count)) return false;
        if (is_over_limit(builder)) return true;
    }
    return flush_touched(builder);
}

static qm_status mark_all(grid_builder *builder)
{
    builder->marked_count = builder->entries = builder->tests = 0;
    builder->touched_count = 0;
    for (size_t i = 0; i < builder->grid->bvh->pack_count && !is_over_limit(builder); i++) {
        if (i % CANCEL_INTERVAL == 0 && qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
        if (!mark_pack(builder, (uint32_t)i)) return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

/** Sorts the marked cells (counting sort); packs come in order, so each list ascends. */
static qm_status sort_marked(grid_builder *builder)
{
    qm_grid *grid = builder->grid;
    for (size_t i = 0; i < grid->block_count; i++) {
        grid->block[i].first = (uint32_t)grid->cell_count;
        grid->cell_count += (size_t)__builtin_popcountll(grid->block[i].used);
    }
    grid->pack_count = builder->entries;
    grid->start = qm_context_alloc(builder->ctx, grid->cell_count + 2, sizeof *grid->start);
    grid->packs = qm_context_alloc(builder->ctx, grid->pack_count, sizeof *grid->packs);
    if (!grid->start || !grid->packs) return QM_E_NO_MEMORY;
    memset(grid->start, 0, (grid->cell_count + 2) * sizeof *grid->start);
    for (int pass = 0; pass < 2; pass++) {
        /* The first pass counts two entries on; after the prefix sum, the second pass moves each start into
         * place. */
        for (size_t i = 0; i < builder->marked_count; i++) {
            const qm_grid_block *block = &grid->block[builder->marked[i].block];
            for (uint64_t rest = builder->marked[i].cells; rest; rest &= rest - 1) {
                uint64_t below = (rest & (0 - rest)) - 1;
                size_t cell = block->first + (size_t)__builtin_popcountll(block->used & below);
                if (pass == 0)
                    grid->start[cell + 2]++;
                else
                    grid->packs[grid->start[cell + 1]++] = builder->marked[i].pack;
            }
        }
        for (size_t i = 1; pass == 0 && i < grid->cell_count + 2; i++)
            grid->start[i] += grid->start[i - 1];
    }
    return QM_OK;
}

/** The edge of a cube of which about count fill the box, or its largest side or length when it is flat. */
static double cube_edge(const double extent[3], double count)
{
    double sorted[3] = {extent[0], extent[1], extent[2]};
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 2 - i; k++) {
            if (sorted[k] >= sorted[k + 1]) continue;
            double kept = sorted[k];
            sorted[k] = sorted[k + 1];
            sorted[k + 1] = kept;
        }
    }
    double edge = cbrt(sorted[0] * sorted[1] * sorted[2] / count);
    if (edge > sorted[2]) edge = sqrt(sorted[0] * sorted[1] / count);
    if (edge > sorted[1]) edge = sorted[0] / count;
    return fmax(edge, 0x1p-30);
}

static qm_status lay_out(qm_context *ctx, qm_grid *grid, const double extent[3], double edge)
{
    qm_context_free(ctx, grid->block, grid->block_count, sizeof *grid->block);
    grid->inverse = 1.0 / edge;
    grid->block_count = 1;
    for (int k = 0; k < 3; k++) {
        grid->size[k] = (int)(extent[k] / edge) + 1;
        grid->blocks[k] = (grid->size[k] + 3) / 4;
        grid->block_count *= (size_t)grid->blocks[k];
    }
    grid->block = qm_context_alloc(ctx, grid->block_count, sizeof *grid->block);
    if (!grid->block) return QM_E_NO_MEMORY;
    memset(grid->block, 0, grid->block_count * sizeof *grid->block);
    return QM_OK;
}

static qm_status fill_grid(grid_builder *builder)
{
    qm_grid *grid = builder->grid;
    size_t triangles = QM_PACK_LANES * grid->bvh->pack_count;
    builder->entry_limit = QM_GRID_SHARE * triangles + MIN_ENTRY_LIMIT;
    builder->test_limit = TESTS_PER_ENTRY * builder->entry_limit;
    double low[3], extent[3];
    /* The box of the surface in the tree: enlarged by QM_BOX_MARGIN, so that its extent is never 0. */
    qm_box box = qm_box_tree_bounds(&grid->bvh->boxes);
    for (int k = 0; k < 3; k++) {
        low[k] = box.min[k];
        extent[k] = box.max[k] - box.min[k];
    }
    grid->low = qm_vec_load(low);
    double edge = cube_edge(extent, fmin(QM_GRID_DENSITY * (double)triangles, MAX_CELLS));
    qm_status status;
    do {
        status = lay_out(builder->ctx, grid, extent, edge);
        if (status == QM_OK) status = mark_all(builder);
        edge *= 2.0;
    } while (status == QM_OK && is_over_limit(builder));
    return status == QM_OK ? sort_marked(builder) : status;
}

qm_status qm_grid_build(qm_context *ctx, const qm_bvh *bvh, qm_grid **out)
{
    *out = NULL;
    if (!bvh->rows.items) return qm_context_fail(ctx, QM_E_ARGUMENT, "a grid needs a tree that is a target");
    qm_grid *grid = qm_context_alloc(ctx, 1, sizeof *grid);
    if (!grid) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a grid");
    *grid = (qm_grid){.bvh = bvh};
    grid_builder builder = {.ctx = ctx, .grid = grid};
    qm_status status = fill_grid(&builder);
    qm_context_free(ctx, builder.marked, builder.marked_capacity, sizeof *builder.marked);
    if (status != QM_OK) {
        qm_grid_destroy(ctx, grid);
        return qm_context_fail(ctx, status, "%s while building the grid", qm_status_text(status));
    }
    QM_ASSERT(grid->start[grid->cell_count] == grid->pack_count);
    *out = grid;
    return QM_OK;
}

void qm_grid_destroy(qm_context *ctx, qm_grid *grid)
{
    if (!grid) return;
    qm_context_free(ctx, grid->packs, grid->pack_count, sizeof *grid->packs);
    qm_context_free(ctx, grid->start, grid->cell_count + 2, sizeof *grid->start);
    qm_context_free(ctx, grid->block, grid->block_count, sizeof *grid->block);
    qm_context_free(ctx, grid, 1, sizeof *grid);
}

size_t qm_grid_memory_size(const qm_grid *grid)
{
    return sizeof *grid + grid->block_count * sizeof *grid->block +
           (grid->cell_count + 2) * sizeof *grid->start + grid->pack_count * sizeof *grid->packs;
}
