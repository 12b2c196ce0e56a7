/**
 * grid.c: nearest triangle or patch in a uniform grid. The cell of the point is visited first, then blocks of
 * cells in shells round it, each as thick as all before, and in them every used cell that meets the ball
 * round the point through the best foot so far. The search ends when the next shell lies outside that ball,
 * or outside the grid.
 *
 * Everything is in cells, and the ball is made larger by QM_GRID_MARGIN and by a share that covers the
 * roundings of points far outside: a pack that the tree would find is then found here too.
 *
 * Source: Bentley, Weide, Yao, Optimal expected-time algorithms for closest point problems, 1980.
 */
#include <stdlib.h>

#include "box.h"
#include "bvh/grid_cells.h"
#include "kernels.h"
#include "visit.h"

#define REACH_SHARE (1.0 + 0x1p-40)
#define SEEN_COUNT 64 /* packs remembered so as not to be visited again, by their last bits */

typedef struct grid_walk {
    const qm_grid *grid;
    qm_box_query query;
    qm_visit_fn *visit;
    void *best;
    double distance;     /* of the best so far, local */
    double at[3];        /* the point, in cells */
    double reach2;       /* squared radius of the ball, in cells */
    float limit;         /* the same for the boxes of packs */
    int low[3], high[3]; /* cells that the box of the ball meets */
    int centre[3];       /* the block of the point, or the nearest to it */
    uint32_t seen[SEEN_COUNT];
} grid_walk;

static inline void set_ball(grid_walk *walk, double distance)
{
    walk->distance = distance;
    double reach = distance * walk->grid->inverse * REACH_SHARE + QM_GRID_MARGIN;
    walk->reach2 = reach * reach;
    walk->limit = qm_box_limit(distance * distance);
    for (int k = 0; k < 3; k++) {
        walk->low[k] = qm_grid_clamp(walk->at[k] - reach, walk->grid->size[k]);
        walk->high[k] = qm_grid_clamp(walk->at[k] + reach, walk->grid->size[k]);
    }
}

/** Visits a pack that was not seen yet, when its box meets the ball. */
static inline void visit_once(grid_walk *walk, uint32_t pack)
{
    uint32_t *seen = &walk->seen[pack % SEEN_COUNT];
    if (*seen == pack) return;
    *seen = pack;
    _Alignas(32) float d2[QM_PACK_LANES];
    const qm_box_node *group = &walk->grid->bvh->boxes.groups[1][pack / 8];
    if (!(qm_box_node_within(group, &walk->query, walk->limit, d2) >> pack % 8 & 1)) return;
    double distance = walk->visit(walk->best, pack);
    if (distance < walk->distance) set_ball(walk, distance);
}

static inline void visit_cell(grid_walk *walk, const qm_grid_block *block, uint64_t bit)
{
    const qm_grid *grid = walk->grid;
    size_t cell = block->first + (size_t)__builtin_popcountll(block->used & (bit - 1));
    for (uint32_t i = grid->start[cell]; i < grid->start[cell + 1]; i++)
        visit_once(walk, grid->packs[i]);
}

/** How far x lies outside [low, high]. */
static inline double gap(double x, double low, double high)
{
    double below = low - x, above = x - high;
    double most = below > above ? below : above;
    return most > 0.0 ? most : 0.0;
}

static inline bool meets_ball(const grid_walk *walk, const int cell[3])
{
    double gap2 = 0.0;
    for (int k = 0; k < 3; k++) {
        double here = gap(walk->at[k], cell[k], cell[k] + 1);
        gap2 += here * here;
    }
    return gap2 <= walk->reach2;
}

static inline void visit_block(grid_walk *walk, int x, int y, int z)
{
    const qm_grid_block *block = &walk->grid->block[qm_grid_block_at(walk->grid, x, y, z)];
    if (!block->used) return;
    const int origin[3] = {4 * x, 4 * y, 4 * z};
    int low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = walk->low[k] > origin[k] ? walk->low[k] - origin[k] : 0;
        high[k] = walk->high[k] < origin[k] + 3 ? walk->high[k] - origin[k] : 3;
        if (low[k] > high[k]) return; /* the ball has shrunk since the shell was begun */
    }
    for (uint64_t rest = block->used & qm_grid_range_bits(low, high); rest; rest &= rest - 1) {
        int place = __builtin_ctzll(rest);
        const int cell[3] = {origin[0] + (place & 3), origin[1] + (place >> 2 & 3), origin[2] + (place >> 4)};
        if (meets_ball(walk, cell)) visit_cell(walk, block, UINT64_C(1) << place);
    }
}

/** Squared distance to the blocks that are at least so many blocks from the centre; infinite without any. */
static inline double shell_distance2(const grid_walk *walk, int shell)
{
    double outside2[3], least2 = INFINITY;
    for (int k = 0; k < 3; k++) {
        double outside = gap(walk->at[k], 0.0, walk->grid->size[k]);
        outside2[k] = outside * outside;
    }
    for (int k = 0; k < 3; k++) {
        double rest2 = outside2[(k + 1) % 3] + outside2[(k + 2) % 3];
        int above = walk->centre[k] + shell, below = walk->centre[k] - shell;
        if (above < walk->grid->blocks[k]) {
            double here = 4 * above - walk->at[k];
            least2 = fmin(least2, here * here + rest2);
        }
        if (below >= 0) {
            double here = walk->at[k] - 4 * (below + 1);
            least2 = fmin(least2, here * here + rest2);
        }
    }
    return least2;
}

static inline int at_least(int a, int b)
{
    return a > b ? a : b;
}

static inline int at_most(int a, int b)
{
    return a < b ? a : b;
}

/** Visits the blocks of a row from x = from to x = to that meet the ball, whose squared distance in y and z
 * is gap2. */
static inline void visit_row(grid_walk *walk, int from, int to, int y, int z, double gap2)
{
    double half = sqrt(walk->reach2 - gap2);
    from = at_least(from, qm_grid_clamp(walk->at[0] - half, walk->grid->size[0]) >> 2);
    to = at_most(to, qm_grid_clamp(walk->at[0] + half, walk->grid->size[0]) >> 2);
    for (int x = from; x <= to; x++)
        visit_block(walk, x, y, z);
}

/** Visits the blocks at least inner and at most outer blocks from the centre that meet the ball. */
static inline void visit_shell(grid_walk *walk, int inner, int outer)
{
    int from[3], to[3];
    for (int k = 0; k < 3; k++) {
        from[k] = at_least(walk->low[k] >> 2, walk->centre[k] - outer);
        to[k] = at_most(walk->high[k] >> 2, walk->centre[k] + outer);
    }
    for (int z = from[2]; z <= to[2]; z++) {
        double gap_z = gap(walk->at[2], 4 * z, 4 * z + 4);
        for (int y = from[1]; y <= to[1]; y++) {
            double gap_y = gap(walk->at[1], 4 * y, 4 * y + 4), gap2 = gap_y * gap_y + gap_z * gap_z;
            if (gap2 > walk->reach2) continue;
            bool is_cut = abs(z - walk->centre[2]) < inner && abs(y - walk->centre[1]) < inner;
            visit_row(walk, from[0], is_cut ? walk->centre[0] - inner : to[0], y, z, gap2);
            if (is_cut) visit_row(walk, walk->centre[0] + inner, to[0], y, z, gap2);
        }
    }
}

/** Visits every pack that comes through the ball of the best distance, from the pack start on. */
static inline void walk_grid(const qm_grid *grid, qm_vec p, uint32_t start, qm_visit_fn *visit, void *best)
{
    qm_vec place = qm_grid_place(grid, p);
    grid_walk walk = {.grid = grid,
                      .query = qm_box_query_point(p),
                      .visit = visit,
                      .best = best,
                      .at = {place.x, place.y, place.z}};
    int here[3];
    for (int k = 0; k < 3; k++) {
        int cell = qm_grid_clamp(walk.at[k], grid->size[k]);
        walk.centre[k] = cell >> 2;
        here[k] = cell & 3;
    }
    for (int i = 0; i < SEEN_COUNT; i++)
        walk.seen[i] = QM_NO_INDEX;
    walk.seen[start % SEEN_COUNT] = start;
    set_ball(&walk, visit(best, start));
    size_t index = qm_grid_block_at(grid, walk.centre[0], walk.centre[1], walk.centre[2]);
    uint64_t bit = qm_grid_range_bits(here, here);
    if (grid->block[index].used & bit) visit_cell(&walk, &grid->block[index], bit);
    visit_shell(&walk, 0, 0);
    for (int inner = 1; shell_distance2(&walk, inner) < walk.reach2; inner *= 2)
        visit_shell(&walk, inner, 2 * inner - 1);
}

void QM_KERNEL(grid_closest)(const qm_grid *grid, qm_vec p, qm_hit *hit)
{
    qm_triangle_search search = {grid->bvh, qm_splat_make(p), hit};
    hit->lane = QM_PACK_LANES;
    walk_grid(grid, p, hit->pack, qm_visit_triangles, &search);
}

void QM_KERNEL(grid_closest_patch)(const qm_grid *grid, qm_vec p, uint32_t start, double error,
                                   qm_bilinear_hit *hit)
{
    *hit = (qm_bilinear_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_patch_search search = {grid->bvh, p, error, hit, {.is_set = false}};
    walk_grid(grid, p, start, qm_visit_all_patches, &search);
    hit->lower = fmin(hit->lower, hit->distance);
}

void QM_KERNEL(grid_closest_ties)(const qm_grid *grid, qm_vec p, uint32_t start, qm_ties *ties)
{
    qm_tie_search search = {grid->bvh, qm_splat_make(p), p, ties};
    walk_grid(grid, p, start, ties->error > 0.0 ? qm_visit_tied_patches : qm_visit_tied_triangles, &search);
}
