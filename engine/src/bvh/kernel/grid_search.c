/**
 * grid_search.c: nearest triangle or patch in a uniform grid. The cell of the point is visited first, then
 * bricks of cells in shells around it, each as thick as all before, and in them every used cell that meets
 * the ball around the point through the best footpoint so far. The search ends when the next shell lies
 * outside that ball, or outside the grid.
 *
 * Lengths are in cells, and the ball is enlarged by QM_GRID_MARGIN and by a factor that covers the roundings
 * of points far outside: a pack that a search of the tree would find is then found here too.
 *
 * Source: Bentley, Weide, Yao, Optimal expected-time algorithms for closest point problems, 1980.
 */
#include <stdlib.h>

#include "box.h"
#include "bvh/grid_cells.h"
#include "kernels.h"
#include "visit.h"

#define REACH_FACTOR (1.0 + 0x1p-40)
#define SEEN_COUNT 64 /* packs remembered so as not to visit them again, by their last bits */

typedef struct grid_traversal {
    const qm_grid *grid;
    qm_box_query query;
    qm_visit_fn *visit;
    void *best;
    double distance;     /* of the best so far, local */
    double at[3];        /* the point, in cells */
    double reach2;       /* squared radius of the ball, in cells */
    float limit;         /* squared radius for the boxes of packs, local */
    int low[3], high[3]; /* cells that the box of the ball meets */
    int center[3];       /* the block of the point, or the nearest to it */
    uint32_t seen[SEEN_COUNT];
} grid_traversal;

static inline void set_ball(grid_traversal *t, double distance)
{
    t->distance = distance;
    double reach = distance * t->grid->inverse * REACH_FACTOR + QM_GRID_MARGIN;
    t->reach2 = reach * reach;
    t->limit = qm_box_limit(distance * distance);
    for (int k = 0; k < 3; k++) {
        t->low[k] = qm_grid_clamp(t->at[k] - reach, t->grid->size[k]);
        t->high[k] = qm_grid_clamp(t->at[k] + reach, t->grid->size[k]);
    }
}

/** Visits a pack that is not remembered as visited, if its box meets the ball. */
static inline void visit_once(grid_traversal *t, uint32_t pack)
{
    uint32_t *seen = &t->seen[pack % SEEN_COUNT];
    if (*seen == pack) return;
    *seen = pack;
    _Alignas(32) float d2[QM_PACK_LANES];
    const qm_box_node *node = &t->grid->bvh->boxes.groups[1][pack / 8];
    if (!(qm_box_node_within(node, &t->query, t->limit, d2) >> pack % 8 & 1)) return;
    double distance = t->visit(t->best, pack);
    if (distance < t->distance) set_ball(t, distance);
}

static inline void visit_cell(grid_traversal *t, const qm_grid_block *block, uint64_t bit)
{
    const qm_grid *grid = t->grid;
    size_t cell = block->first + (size_t)__builtin_popcountll(block->used & (bit - 1));
    QM_ASSERT(block->used & bit && cell < grid->cell_count);
    for (uint32_t i = grid->start[cell]; i < grid->start[cell + 1]; i++)
        visit_once(t, grid->packs[i]);
}

/** Distance of x from [low, high]. */
static inline double gap(double x, double low, double high)
{
    double below = low - x, above = x - high;
    double outside = below > above ? below : above;
    return outside > 0.0 ? outside : 0.0;
}

static inline bool meets_ball(const grid_traversal *t, const int cell[3])
{
    double gap2 = 0.0;
    for (int k = 0; k < 3; k++) {
        double here = gap(t->at[k], cell[k], cell[k] + 1);
        gap2 += here * here;
    }
    return gap2 <= t->reach2;
}

static inline void visit_block(grid_traversal *t, int x, int y, int z)
{
    const qm_grid_block *block = &t->grid->block[qm_grid_block_at(t->grid, x, y, z)];
    if (!block->used) return;
    const int origin[3] = {4 * x, 4 * y, 4 * z};
    int low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = t->low[k] > origin[k] ? t->low[k] - origin[k] : 0;
        high[k] = t->high[k] < origin[k] + 3 ? t->high[k] - origin[k] : 3;
        if (low[k] > high[k]) return; /* the ball has shrunk since the shell began */
    }
    for (uint64_t rest = block->used & qm_grid_range_bits(low, high); rest; rest &= rest - 1) {
        int index = __builtin_ctzll(rest);
        const int cell[3] = {origin[0] + (index & 3), origin[1] + (index >> 2 & 3), origin[2] + (index >> 4)};
        if (meets_ball(t, cell)) visit_cell(t, block, UINT64_C(1) << index);
    }
}

/** Squared distance to the blocks at least shell blocks from the center; infinite when there are none. */
static inline double shell_distance2(const grid_traversal *t, int shell)
{
    double outside2[3], min2 = INFINITY;
    for (int k = 0; k < 3; k++) {
        double outside = gap(t->at[k], 0.0, t->grid->size[k]);
        outside2[k] = outside * outside;
    }
    for (int k = 0; k < 3; k++) {
        double rest2 = outside2[(k + 1) % 3] + outside2[(k + 2) % 3];
        int above = t->center[k] + shell, below = t->center[k] - shell;
        if (above < t->grid->blocks[k]) {
            double here = 4 * above - t->at[k];
            min2 = fmin(min2, here * here + rest2);
        }
        if (below >= 0) {
            double here = t->at[k] - 4 * (below + 1);
            min2 = fmin(min2, here * here + rest2);
        }
    }
    return min2;
}

static inline int int_max(int a, int b)
{
    return a > b ? a : b;
}

static inline int int_min(int a, int b)
{
    return a < b ? a : b;
}

/** Visits the blocks of a row from x = from to x = to that meet the ball, whose squared distance in y and z
 * is gap2. */
static inline void visit_row(grid_traversal *t, int from, int to, int y, int z, double gap2)
{
    double half = sqrt(t->reach2 - gap2);
    from = int_max(from, qm_grid_clamp(t->at[0] - half, t->grid->size[0]) >> 2);
    to = int_min(to, qm_grid_clamp(t->at[0] + half, t->grid->size[0]) >> 2);
    for (int x = from; x <= to; x++)
        visit_block(t, x, y, z);
}

/** Visits the blocks at least inner and at most outer blocks from the center that meet the ball. */
static inline void visit_shell(grid_traversal *t, int inner, int outer)
{
    int from[3], to[3];
    for (int k = 0; k < 3; k++) {
        from[k] = int_max(t->low[k] >> 2, t->center[k] - outer);
        to[k] = int_min(t->high[k] >> 2, t->center[k] + outer);
    }
    for (int z = from[2]; z <= to[2]; z++) {
        double gap_z = gap(t->at[2], 4 * z, 4 * z + 4);
        for (int y = from[1]; y <= to[1]; y++) {
            double gap_y = gap(t->at[1], 4 * y, 4 * y + 4), gap2 = gap_y * gap_y + gap_z * gap_z;
            if (gap2 > t->reach2) continue;
            bool is_cut = abs(z - t->center[2]) < inner && abs(y - t->center[1]) < inner;
            visit_row(t, from[0], is_cut ? t->center[0] - inner : to[0], y, z, gap2);
            if (is_cut) visit_row(t, t->center[0] + inner, to[0], y, z, gap2);
        }
    }
}

/** Visits every pack that meets the ball of the best distance, the pack start first. */
static inline void traverse_grid(const qm_grid *grid, qm_vec p, uint32_t start, qm_visit_fn *visit,
                                 void *best)
{
    qm_vec position = qm_grid_position(grid, p);
    grid_traversal t = {.grid = grid,
                        .query = qm_box_query_point(p),
                        .visit = visit,
                        .best = best,
                        .at = {position.x, position.y, position.z}};
    int here[3];
    for (int k = 0; k < 3; k++) {
        int cell = qm_grid_clamp(t.at[k], grid->size[k]);
        t.center[k] = cell >> 2;
        here[k] = cell & 3;
    }
    for (int i = 0; i < SEEN_COUNT; i++)
        t.seen[i] = QM_NO_INDEX;
    t.seen[start % SEEN_COUNT] = start;
    set_ball(&t, visit(best, start));
    size_t index = qm_grid_block_at(grid, t.center[0], t.center[1], t.center[2]);
    uint64_t bit = qm_grid_range_bits(here, here);
    if (grid->block[index].used & bit) visit_cell(&t, &grid->block[index], bit);
    visit_shell(&t, 0, 0);
    for (int inner = 1; shell_distance2(&t, inner) < t.reach2; inner *= 2)
        visit_shell(&t, inner, 2 * inner - 1);
}

void QM_KERNEL(grid_closest)(const qm_grid *grid, qm_vec p, qm_hit *hit)
{
    qm_triangle_search search = {grid->bvh, qm_splat_make(p), hit};
    hit->lane = QM_PACK_LANES;
    traverse_grid(grid, p, hit->pack, qm_visit_triangles, &search);
}

void QM_KERNEL(grid_closest_patch)(const qm_grid *grid, qm_vec p, uint32_t start, double error,
                                   qm_bilinear_hit *hit)
{
    *hit = (qm_bilinear_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_patch_search search = {grid->bvh, p, error, hit, {.is_set = false}};
    traverse_grid(grid, p, start, qm_visit_all_patches, &search);
    hit->lower = fmin(hit->lower, hit->distance);
}

void QM_KERNEL(grid_closest_ties)(const qm_grid *grid, qm_vec p, uint32_t start, qm_ties *ties)
{
    qm_tie_search search = {grid->bvh, qm_splat_make(p), p, ties};
    traverse_grid(grid, p, start, ties->error > 0.0 ? qm_visit_tied_patches : qm_visit_tied_triangles,
                  &search);
}
