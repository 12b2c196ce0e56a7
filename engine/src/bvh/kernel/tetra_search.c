/**
 * tetra_search.c: nearest triangle or patch by offset tetrahedra, the nearest part first. Parts wait in a
 * priority queue by their lower bounds; the corners of a part are points of the surface, and so bound the
 * distance from above before the search reaches any leaf. When the queue is full a part is searched at once,
 * depth first.
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

/** An entry of the queue: a node of the box tree (level 1 and up), or a part of a patch (level 0). */
typedef struct queue_entry {
    double lower;
    uint32_t level, index; /* of the node, or of the patch */
    qm_tetra_part part;
} queue_entry;

typedef struct tetra_traversal {
    const qm_tetra *tetra;
    qm_vec p;
    qm_box_query query;
    double limit; /* all beyond is pruned */
    qm_visit_fn *visit;
    void *best;
    int count;
    queue_entry heap[HEAP_SIZE];
    uint32_t seen[SEEN_COUNT]; /* packs visited recently, by their last bits */
} tetra_traversal;

static inline void lower_limit(tetra_traversal *t, double distance)
{
    t->limit = fmin(t->limit, distance + LIMIT_MARGIN * (1.0 + distance));
}

static void visit_pack(tetra_traversal *t, uint32_t pack)
{
    if (t->seen[pack % SEEN_COUNT] == pack) return;
    t->seen[pack % SEEN_COUNT] = pack;
    lower_limit(t, t->visit(t->best, pack));
}

static void visit_leaf(tetra_traversal *t, const qm_tetra_part *part)
{
    uint32_t link = t->tetra->nodes[part->node].link;
    const uint32_t *pack = t->tetra->packs + (link >> QM_TETRA_COUNT_BITS);
    for (uint32_t i = 0; i < (link & ((1u << QM_TETRA_COUNT_BITS) - 1)); i++)
        visit_pack(t, pack[i]);
}

static void expand(tetra_traversal *t, queue_entry at);

static void push(tetra_traversal *t, queue_entry item)
{
    if (t->count == HEAP_SIZE) {
        expand(t, item);
        return;
    }
    int at = t->count++;
    for (int up; at > 0 && item.lower < t->heap[up = (at - 1) / 2].lower; at = up)
        t->heap[at] = t->heap[up];
    t->heap[at] = item;
}

static queue_entry pop(tetra_traversal *t)
{
    QM_ASSERT(t->count > 0);
    queue_entry top = t->heap[0], last = t->heap[--t->count];
    int at = 0;
    for (int down; (down = 2 * at + 1) < t->count; at = down) {
        if (down + 1 < t->count && t->heap[down + 1].lower < t->heap[down].lower) down++;
        if (last.lower <= t->heap[down].lower) break;
        t->heap[at] = t->heap[down];
    }
    t->heap[at] = last;
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

/** Bounds a part, and queues it or visits it when it is a leaf. */
static void offer(tetra_traversal *t, uint32_t patch, const qm_tetra_part *part)
{
    const qm_tetra *tetra = t->tetra;
    uint32_t vertex[4];
    qm_vec corner[4];
    qm_tetra_part_corners(tetra, &tetra->patches[patch], part, vertex);
    for (int i = 0; i < 4; i++)
        corner[i] = qm_tetra_vertex(tetra, vertex[i]);
    QM_ASSERT(part->node < tetra->node_count);
    double radius = (double)tetra->nodes[part->node].radius, reach = t->limit + radius;
    if (corners_box_d2(corner, t->p) > reach * reach * (1.0 + LIMIT_MARGIN)) return;
    qm_four_vec corners = qm_tetra_corners(corner);
    double lower = qm_tetra_lower(corners, t->p) - radius;
    if (lower > t->limit) return;
    if (qm_tetra_part_is_leaf(part)) {
        visit_leaf(t, part);
        return;
    }
    qm_four_vec to_corner = qm_four_vec_sub(corners, qm_four_vec_splat(t->p));
    lower_limit(t, sqrt(qm_four_min_lane(qm_four_vec_dot(to_corner, to_corner))));
    push(t, (queue_entry){lower, 0, patch, *part});
}

static void offer_children(tetra_traversal *t, uint32_t level, uint32_t index)
{
    const qm_tetra *tetra = t->tetra;
    _Alignas(32) float d2[QM_PACK_LANES];
    float limit = qm_box_limit(t->limit * t->limit);
    unsigned within = qm_box_node_within(&tetra->boxes.groups[level][index], &t->query, limit, d2);
    within &= (1u << qm_box_tree_child_count(&tetra->boxes, (int)level, index)) - 1;
    for (; within; within &= within - 1) {
        unsigned child = (unsigned)__builtin_ctz(within);
        uint32_t below = 8 * index + child;
        if (level > 1) {
            /* The root of a square that is at most 1 + 4e-7 times the true one (box.h) exceeds the distance
             * by 2e-7 of it: taking 1e-6 off makes it a lower bound. */
            push(t, (queue_entry){sqrt((double)d2[child]) * (1.0 - 1e-6), level - 1, below, {0}});
        } else {
            qm_tetra_part whole = qm_tetra_part_root(&tetra->patches[below]);
            offer(t, below, &whole);
        }
    }
}

static void expand(tetra_traversal *t, queue_entry at)
{
    if (at.level > 0) {
        offer_children(t, at.level, at.index);
        return;
    }
    qm_tetra_part half[2];
    qm_tetra_part_cut(&at.part, half);
    half[1].node = t->tetra->nodes[at.part.node].link;
    offer(t, at.index, &half[0]);
    offer(t, at.index, &half[1]);
}

/** Visits every pack that may be nearer than the best, the pack start first. */
static void traverse_tetra(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_visit_fn *visit, void *best)
{
    tetra_traversal here, *t = &here;
    t->tetra = tetra;
    t->p = p;
    t->query = qm_box_query_point(p);
    t->limit = INFINITY;
    t->visit = visit;
    t->best = best;
    t->count = 0;
    for (int i = 0; i < SEEN_COUNT; i++)
        t->seen[i] = QM_NO_INDEX;
    visit_pack(t, start);
    offer_children(t, (uint32_t)t->tetra->boxes.level_count, 0);
    while (t->count > 0) {
        queue_entry at = pop(t);
        if (at.lower > t->limit) return;
        expand(t, at);
    }
}

void QM_KERNEL(tetra_closest)(const qm_tetra *tetra, qm_vec p, qm_hit *hit)
{
    qm_triangle_search search = {tetra->bvh, qm_splat_make(p), hit};
    hit->lane = QM_PACK_LANES;
    traverse_tetra(tetra, p, hit->pack, qm_visit_triangles, &search);
}

void QM_KERNEL(tetra_closest_patch)(const qm_tetra *tetra, qm_vec p, uint32_t start, double error,
                                    qm_bilinear_hit *hit)
{
    *hit = (qm_bilinear_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_patch_search search = {tetra->bvh, p, error, hit, {.is_set = false}};
    traverse_tetra(tetra, p, start, qm_visit_all_patches, &search);
    hit->lower = fmin(hit->lower, hit->distance);
}

void QM_KERNEL(tetra_closest_ties)(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_ties *ties)
{
    qm_tie_search search = {tetra->bvh, qm_splat_make(p), p, ties};
    traverse_tetra(tetra, p, start, ties->error > 0.0 ? qm_visit_tied_patches : qm_visit_tied_triangles,
                   &search);
}
