/**
 * tetra_search.c: nearest triangle or patch by offset tetrahedra, the nearest part first. Parts wait in a
 * heap by their lower bounds; the corners of a part are points of the surface, and so bound the distance from
 * above before any leaf is reached. When the heap is full a part is searched at once, depth first.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.2.
 */
#include "box.h"
#include "bvh/tetra_tree.h"
#include "kernels.h"
#include "tetra_bound.h"
#include "visit.h"

#define HEAP_SIZE 256
#define LIMIT_MARGIN 0x1p-40 /* by which a limit exceeds a computed distance, relative and local */
#define SEEN_COUNT 16

/** What waits: a group of boxes (level 1 and up), or a part of a patch (level 0). */
typedef struct waiting {
    double lower;
    uint32_t level, index; /* of the group, or of the patch */
    qm_tetra_part part;
} waiting;

typedef struct tetra_walk {
    const qm_tetra *tetra;
    qm_vec p;
    qm_box_query query;
    double limit; /* nothing beyond is of interest */
    qm_visit_fn *visit;
    void *best;
    int count;
    waiting heap[HEAP_SIZE];
    uint32_t seen[SEEN_COUNT]; /* packs visited of late, by their last bits */
} tetra_walk;

static inline void lower_limit(tetra_walk *walk, double distance)
{
    walk->limit = fmin(walk->limit, distance + LIMIT_MARGIN * (1.0 + distance));
}

static void visit_pack(tetra_walk *walk, uint32_t pack)
{
    if (walk->seen[pack % SEEN_COUNT] == pack) return;
    walk->seen[pack % SEEN_COUNT] = pack;
    lower_limit(walk, walk->visit(walk->best, pack));
}

static void visit_leaf(tetra_walk *walk, const qm_tetra_part *part)
{
    uint32_t link = walk->tetra->nodes[part->node].link;
    const uint32_t *pack = walk->tetra->packs + (link >> QM_TETRA_COUNT_BITS);
    for (uint32_t i = 0; i < (link & ((1u << QM_TETRA_COUNT_BITS) - 1)); i++)
        visit_pack(walk, pack[i]);
}

static void expand(tetra_walk *walk, waiting at);

static void push(tetra_walk *walk, waiting item)
{
    if (walk->count == HEAP_SIZE) {
        expand(walk, item);
        return;
    }
    int at = walk->count++;
    for (int up; at > 0 && item.lower < walk->heap[up = (at - 1) / 2].lower; at = up)
        walk->heap[at] = walk->heap[up];
    walk->heap[at] = item;
}

static waiting pop(tetra_walk *walk)
{
    waiting top = walk->heap[0], last = walk->heap[--walk->count];
    int at = 0;
    for (int down; (down = 2 * at + 1) < walk->count; at = down) {
        if (down + 1 < walk->count && walk->heap[down + 1].lower < walk->heap[down].lower) down++;
        if (last.lower <= walk->heap[down].lower) break;
        walk->heap[at] = walk->heap[down];
    }
    walk->heap[at] = last;
    return top;
}

/** Squared distance from p to the box of four corners. */
static inline double corners_box_d2(const qm_vec c[4], qm_vec p)
{
    qm_box box = qm_vec_box(c, 4);
    double x = fmax(fmax(box.min[0] - p.x, p.x - box.max[0]), 0.0);
    double y = fmax(fmax(box.min[1] - p.y, p.y - box.max[1]), 0.0);
    double z = fmax(fmax(box.min[2] - p.z, p.z - box.max[2]), 0.0);
    return x * x + y * y + z * z;
}

/** Bounds a part and lets it wait, or visits it when it is a leaf. */
static void offer(tetra_walk *walk, uint32_t patch, const qm_tetra_part *part)
{
    const qm_tetra *tetra = walk->tetra;
    uint32_t vertex[4];
    qm_vec corner[4];
    qm_tetra_part_corners(tetra, &tetra->patches[patch], part, vertex);
    for (int i = 0; i < 4; i++)
        corner[i] = qm_tetra_vertex(tetra, vertex[i]);
    double radius = (double)tetra->nodes[part->node].radius, reach = walk->limit + radius;
    if (corners_box_d2(corner, walk->p) > reach * reach * (1.0 + LIMIT_MARGIN)) return;
    qm_four_vec corners = qm_tetra_corners(corner);
    double lower = qm_tetra_lower(corners, walk->p) - radius;
    if (lower > walk->limit) return;
    if (qm_tetra_part_is_leaf(part)) {
        visit_leaf(walk, part);
        return;
    }
    qm_four_vec way = qm_four_vec_sub(corners, qm_four_vec_splat(walk->p));
    lower_limit(walk, sqrt(qm_four_least(qm_four_vec_dot(way, way))));
    push(walk, (waiting){lower, 0, patch, *part});
}

static void offer_members(tetra_walk *walk, uint32_t level, uint32_t index)
{
    const qm_tetra *tetra = walk->tetra;
    _Alignas(32) float d2[QM_PACK_LANES];
    float limit = qm_box_limit(walk->limit * walk->limit);
    unsigned within = qm_box_node_within(&tetra->boxes.groups[level][index], &walk->query, limit, d2);
    within &= (1u << qm_box_tree_child_count(&tetra->boxes, (int)level, index)) - 1;
    for (; within; within &= within - 1) {
        unsigned member = (unsigned)__builtin_ctz(within);
        uint32_t below = 8 * index + member;
        if (level > 1) {
            /* The root of a square that is at most 1 + 4e-7 times the true one (box.h) exceeds the distance
             * by 2e-7 of it: taking 1e-6 off makes it a lower bound. */
            push(walk, (waiting){sqrt((double)d2[member]) * (1.0 - 1e-6), level - 1, below, {0}});
        } else {
            qm_tetra_part whole = qm_tetra_part_whole(&tetra->patches[below]);
            offer(walk, below, &whole);
        }
    }
}

static void expand(tetra_walk *walk, waiting at)
{
    if (at.level > 0) {
        offer_members(walk, at.level, at.index);
        return;
    }
    qm_tetra_part half[2];
    qm_tetra_part_cut(&at.part, half);
    half[1].node = walk->tetra->nodes[at.part.node].link;
    offer(walk, at.index, &half[0]);
    offer(walk, at.index, &half[1]);
}

/** Visits every pack that may hold something nearer than the best, from the pack start on. */
static void walk_tetra(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_visit_fn *visit, void *best)
{
    tetra_walk here, *walk = &here;
    walk->tetra = tetra;
    walk->p = p;
    walk->query = qm_box_query_point(p);
    walk->limit = INFINITY;
    walk->visit = visit;
    walk->best = best;
    walk->count = 0;
    for (int i = 0; i < SEEN_COUNT; i++)
        walk->seen[i] = QM_NO_INDEX;
    visit_pack(walk, start);
    offer_members(walk, (uint32_t)walk->tetra->boxes.level_count, 0);
    while (walk->count > 0) {
        waiting at = pop(walk);
        if (at.lower > walk->limit) return;
        expand(walk, at);
    }
}

void QM_KERNEL(tetra_closest)(const qm_tetra *tetra, qm_vec p, qm_hit *hit)
{
    qm_triangle_search search = {tetra->bvh, qm_splat_make(p), hit};
    hit->lane = QM_PACK_LANES;
    walk_tetra(tetra, p, hit->pack, qm_visit_triangles, &search);
}

void QM_KERNEL(tetra_closest_patch)(const qm_tetra *tetra, qm_vec p, uint32_t start, double error,
                                    qm_bilinear_hit *hit)
{
    *hit = (qm_bilinear_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_patch_search search = {tetra->bvh, p, error, hit, {.is_set = false}};
    walk_tetra(tetra, p, start, qm_visit_all_patches, &search);
    hit->lower = fmin(hit->lower, hit->distance);
}

void QM_KERNEL(tetra_closest_ties)(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_ties *ties)
{
    qm_tie_search search = {tetra->bvh, qm_splat_make(p), p, ties};
    walk_tetra(tetra, p, start, ties->error > 0.0 ? qm_visit_tied_patches : qm_visit_tied_triangles, &search);
}
