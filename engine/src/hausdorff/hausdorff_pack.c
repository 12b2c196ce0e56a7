/**
 * hausdorff_pack.c: the packs of the source, leaves of its hierarchy: which faces of a pack may be discarded,
 * cheapest test first. A face that is left is visited alone (hausdorff_piece.c).
 *
 *   one facet      face_reached        one facet of the hinted pack reaches all corners: the distance to
 *                                      it is convex, so it is largest at a corner
 *   parts          visit_open          one facet for each part of a face, or balls (hausdorff_near.c)
 *   overlays       discard_by_overlay  all facets straight over faces (hausdorff_overlay.c): one overlay for
 *                                      the packs of a node, one for a pack, one for a face
 *
 * Overlays are tried where they have lately cost less than covers.
 */
#include <string.h>

#include "hausdorff_candidates.h"
#include "hausdorff_overlay.h"
#include "hausdorff_sample.h"

#define NEAR_SHARE 0.05 /* of a pack's diagonal: facets farther than its centre by this are gathered */
/* Packs between two that try the way that seems dearer, overlays or covers, times the ratio of their costs: so
 * these tries add a 64th to the time, whatever the ratio is. */
#define DEARER_INTERVAL 64
#define COVER_PRIOR 50.0 /* cost of a cover of a face assumed before there is one, and of an overlay */
#define OVERLAY_PRIOR 100.0
#define MAX_SHARE_PAUSE 63 /* nodes without a common overlay, at most, after failures in a row */
#define OVERLAY_GAIN 2.0   /* by which an overlay must be cheaper: the counts only estimate times */

/** The packs of a node that are visited in turn, and their common overlay. */
typedef struct node_work {
    const qm_entry *pack;
    int pack_count;
    bool is_begun, has_failed, has_overlay;
    int tries, hits; /* faces tried with it, and discarded by it */
    qm_overlay overlay;
} node_work;

/** A pack of the source in work: its vertices in local space and, for each, the lanes of the hinted pack that
 * reach it. */
typedef struct pack_work {
    qm_entry entry;
    node_work *node;
    const qm_side *side;
    const qm_kernel *kernel;
    const qm_pack_lanes *lanes;
    qm_vec vertex[3 * QM_PACK_LANES];
    qm_float_bits in_reach[3 * QM_PACK_LANES];
    uint32_t measured;    /* a bit a vertex: in_reach was computed in double precision */
    qm_candidates hinted; /* the pack of the hint, for them */
    int open_count;       /* faces that one lane does not reach */
    qm_piece open[QM_PACK_LANES];
    qm_near_faces faces; /* the open faces by their corners, valid until the first is removed */
    qm_near_packs near;  /* of the whole pack, where some are open */
} pack_work;

/* --- One facet --- */

/** True when one lane of the pack of the hint reaches all corners of a face. */
static bool face_reached(pack_work *work, double cutoff, const int *corner, int count)
{
    QM_ASSERT(count == 3 || count == 4);
    unsigned bits = ~0u;
    for (int i = 0; i < count; i++)
        bits &= work->in_reach[corner[i]];
    if (qm_float_certain(bits) || bits == 0) return bits != 0;
    /* Single precision leaves it open where the cutoff is tiny or the source runs beside the target. */
    for (int i = 0; i < count; i++) {
        int vertex = corner[i];
        if (!(work->measured >> vertex & 1)) {
            if (work->measured == 0)
                qm_candidates_fill(&work->hinted, work->side, &work->entry.hint, 1, cutoff);
            work->measured |= 1u << vertex;
            unsigned lanes = (unsigned)work->kernel->in_reach(&work->hinted, work->vertex[vertex]);
            work->in_reach[vertex] = (qm_float_bits)(lanes << 8 | lanes);
        }
        bits &= work->in_reach[vertex];
    }
    return bits != 0;
}

/** True when a face is a copy of the last one, whose bounds hold for it, too; else it becomes the last. */
static bool is_copy(qm_worker *worker, const qm_side *side, const qm_piece *face)
{
    qm_last_face *last = &worker->last_face;
    int count = face->corner_count;
    bool is_same = last->side == side && last->corner_count == count;
    for (int i = 0; i < count && is_same; i++)
        is_same = qm_vec_equal(last->corner[i], face->corner[i]);
    if (is_same) return true;
    last->side = side;
    last->corner_count = count;
    for (int i = 0; i < count; i++)
        last->corner[i] = face->corner[i];
    return false;
}

/* --- Overlays --- */

/** Gathers the packs that faces are most likely covered with: those about as near as the hint is to the
 * centre. All packs within reach may be hundreds where the lower bound is large. */
static void gather_about(const qm_worker *worker, const pack_work *work, const qm_vec *point, int count,
                         qm_near_packs *near)
{
    const qm_search *search = worker->search;
    qm_box box = qm_vec_box(point, count);
    qm_vec low = qm_vec_load(box.min), high = qm_vec_load(box.max);
    double centre =
        qm_sample_pack_upper(search->kernel, work->side, work->entry.hint, qm_vec_mix(low, high, 0.5));
    double reach =
        fmin(centre + NEAR_SHARE * qm_vec_distance(low, high), qm_search_cutoff(search) * work->side->scale);
    search->kernel->gather(work->side->target, &box, reach, near);
}

/** Removes the open faces that have a bit. */
static void remove_faces(pack_work *work, unsigned gone)
{
    int left = 0;
    for (int i = 0; i < work->open_count; i++)
        if (!(gone >> i & 1)) work->open[left++] = work->open[i];
    work->open_count = left;
}

/** Lists the open triangles, and the index of each in open. */
static void list_open(const pack_work *work, qm_overlay_source *source, int *index)
{
    source->count = 0;
    for (int i = 0; i < work->open_count; i++) {
        if (work->open[i].corner_count != 3) continue;
        memcpy(source->corner[source->count], work->open[i].corner, sizeof source->corner[0]);
        index[source->count++] = i;
    }
}

/** Makes the overlay over the vertices of all packs of a node, along the sum of their normals, unless that has
 * failed recently, as it does where a node of the source is much larger than one of the target. */
static void begin_node_overlay(qm_worker *worker, const pack_work *work)
{
    node_work *node = work->node;
    node->is_begun = true;
    if (node->pack_count < 2) return;
    if (worker->share_wait > 0) {
        worker->share_wait--;
        return;
    }
    const qm_side *side = work->side;
    qm_vec point[3 * QM_PACK_LANES * QM_PACK_LANES], normal = {0, 0, 0};
    int count = 0;
    for (int i = 0; i < node->pack_count; i++) {
        const qm_pack_lanes *lanes = &side->source->lanes[node->pack[i].index];
        const qm_vec *vertex = point + count;
        for (int k = 0; k < lanes->vertex_count; k++)
            point[count++] = qm_side_vertex(side, lanes->vertex[k]);
        qm_overlay_source faces = {.count = lanes->lane_count};
        for (int lane = 0; lane < faces.count; lane++)
            for (int c = 0; c < 3; c++)
                faces.corner[lane][c] = vertex[lanes->corner[lane][c]];
        normal = qm_vec_add(normal, qm_overlay_normal(&faces));
    }
    qm_near_packs near;
    gather_about(worker, work, point, count, &near);
    node->has_overlay = near.count < QM_NEAR_PACKS &&
                        qm_overlay_set(worker, work->side, normal, point, count, &near, &node->overlay);
    node->has_failed = !node->has_overlay;
}

/** Discards open triangles by the common overlay of the node. */
static void discard_by_node_overlay(qm_worker *worker, pack_work *work)
{
    qm_overlay_source source;
    int index[QM_PACK_LANES];
    list_open(work, &source, index);
    if (source.count == 0) return;
    if (!work->node->is_begun) begin_node_overlay(worker, work);
    if (!work->node->has_overlay) return;
    unsigned discarded = qm_overlay_test(worker, work->side, &work->node->overlay, &source), gone = 0;
    for (int i = 0; i < source.count; i++)
        if (discarded >> i & 1) gone |= 1u << index[i];
    int hits = __builtin_popcount(discarded);
    work->node->tries += source.count;
    work->node->hits += hits;
    remove_faces(work, gone);
    /* The others are tried again, in discard_by_overlay, and counted there. */
    worker->overlay_tries += (uint64_t)hits;
    worker->overlay_hits += (uint64_t)hits;
}

/** Discards open triangles by one overlay over all of them, and each by its own where that fails, as where
 * too many packs are near all of them. */
static void discard_by_overlay(qm_worker *worker, pack_work *work)
{
    qm_overlay_source source;
    int index[QM_PACK_LANES];
    list_open(work, &source, index);
    if (source.count == 0) return;
    bool has_all = source.count > 1 && work->near.count < QM_NEAR_PACKS;
    unsigned discarded = 0, gone = 0;
    qm_overlay overlay;
    if (has_all && qm_overlay_set(worker, work->side, qm_overlay_normal(&source), &source.corner[0][0],
                                  3 * source.count, &work->near, &overlay))
        discarded = qm_overlay_test(worker, work->side, &overlay, &source);
    for (int i = 0; i < source.count; i++) {
        const qm_piece *face = &work->open[index[i]];
        bool is_discarded = discarded >> i & 1;
        if (!is_discarded) {
            qm_near_packs near;
            gather_about(worker, work, face->corner, 3, &near);
            is_discarded = qm_overlay_test_face(worker, work->side, face->corner, 0.0, &near);
        }
        if (is_discarded) gone |= 1u << index[i];
    }
    remove_faces(work, gone);
    worker->overlay_tries += (uint64_t)source.count;
    worker->overlay_hits += (uint64_t)__builtin_popcount(gone);
}

/**
 * Whether to try overlays: at first, to learn their cost, and from then on where they have cost less than
 * covers. Now and then the dearer way is tried, the more seldom the more it costs.
 */
static bool choose_overlay(qm_worker *worker)
{
    if (worker->overlay_tries == 0) return true;
    double by_covers = ((double)worker->cover_cost + COVER_PRIOR) / ((double)worker->cover_tries + 1.0);
    double left = (double)(worker->overlay_tries - worker->overlay_hits);
    double by_overlay = ((double)worker->overlay_cost + left * by_covers + OVERLAY_PRIOR) /
                        ((double)worker->overlay_tries + 1.0);
    bool is_cheaper = OVERLAY_GAIN * by_overlay < by_covers;
    double ratio = is_cheaper ? by_covers / by_overlay : by_overlay / by_covers;
    if (++worker->since_probe < DEARER_INTERVAL * ratio) return is_cheaper;
    worker->since_probe = 0;
    return !is_cheaper;
}

/* --- Packs --- */

/** Queues the faces of a pack from `first` on, as the search is to end: as pieces, but by matching as the pack, since they lack what
 * matching keeps of corners. */
static void leave_open(qm_worker *worker, const pack_work *work, int first, bool is_matching)
{
    qm_entry entry = work->entry;
    if (is_matching) {
        qm_worker_push(worker, entry, NULL);
        return;
    }
    entry.kind = QM_ENTRY_PIECE;
    for (int i = first; i < work->open_count; i++)
        qm_worker_push(worker, entry, &work->open[i]);
}

/** Visits the faces of a pack that one lane does not reach: the cheapest test first, one by one last. */
static void visit_open(qm_worker *worker, pack_work *work)
{
    bool is_matching = qm_search_is_matching(worker->search);
    remove_faces(work, qm_near_test_faces(worker, work->side, &work->faces, work->entry.hint));
    if (work->open_count == 0) return;
    if (!is_matching) {
        bool by_overlay = choose_overlay(worker);
        if (by_overlay) discard_by_node_overlay(worker, work);
        if (work->open_count == 0) return;
        qm_vec point[4 * QM_PACK_LANES] = {work->open[0].corner[0]};
        int count = 0;
        for (int i = 0; i < work->open_count; i++)
            for (int c = 0; c < work->open[i].corner_count; c++)
                point[count++] = work->open[i].corner[c];
        gather_about(worker, work, point, count, &work->near);
        if (by_overlay) discard_by_overlay(worker, work);
    }
    for (int i = 0; i < work->open_count; i++) {
        if (qm_worker_must_stop(worker)) {
            leave_open(worker, work, i, is_matching);
            return;
        }
        if (is_matching) {
            qm_matching_visit_face(worker, work->entry, &work->open[i]);
            continue;
        }
        qm_piece_visit_face(worker, work->entry, &work->open[i], &work->near);
        qm_worker_follow(worker);
    }
}

/** Discards the faces of a pack by the pack of its hint, together, or one by one. */
static void visit_pack(qm_worker *worker, qm_entry entry, node_work *node)
{
    QM_ASSERT(entry.level == 0);
    const qm_search *search = worker->search;
    pack_work work;
    work.entry = entry;
    work.node = node;
    work.side = &search->side[entry.side];
    work.lanes = &work.side->source->lanes[entry.index];
    work.kernel = search->kernel;
    work.open_count = 0;
    work.measured = 0;
    double cutoff = qm_search_cutoff(search) * work.side->scale;
    for (int i = 0; i < work.lanes->vertex_count; i++)
        work.vertex[i] = qm_side_vertex(work.side, work.lanes->vertex[i]);
    search->kernel->float_reach(qm_bvh_float_pack(work.side->target, entry.hint),
                                qm_side_twists(work.side, entry.hint), cutoff, work.vertex,
                                (1u << work.lanes->vertex_count) - 1, work.in_reach);
    for (int lane = 0, count; lane < work.lanes->lane_count; lane += count - 2) {
        int corner[4];
        count = qm_lane_corners(work.lanes, (uint32_t)lane, work.side->source_patches, corner);
        if (face_reached(&work, cutoff, corner, count)) continue;
        qm_piece *piece = &work.open[work.open_count];
        *piece = (qm_piece){.high = {1.0, 1.0},
                            .face = work.lanes->face[lane],
                            .pack = entry.index,
                            .corner_count = (uint8_t)count};
        for (int i = 0; i < count; i++)
            piece->corner[i] = work.vertex[corner[i]];
        for (int i = 0; i < 4; i++)
            work.faces.corner[work.open_count][i] = (uint8_t)corner[i < count ? i : count - 1];
        if (!is_copy(worker, work.side, piece)) work.open_count++;
    }
    work.faces.vertex = work.vertex;
    work.faces.vertex_count = work.lanes->vertex_count;
    work.faces.count = work.open_count;
    if (work.open_count > 0) visit_open(worker, &work);
    qm_worker_discard(worker, qm_search_cutoff(search)); /* the lower bound may have risen on the way */
}

void qm_pack_visit_all(qm_worker *worker, const qm_entry *pack, int count)
{
    QM_ASSERT(worker && pack);
    QM_ASSERT(count > 0 && count <= QM_PACK_LANES);
    node_work node;
    node.pack = pack;
    node.pack_count = count;
    node.is_begun = node.has_failed = node.has_overlay = false;
    node.tries = node.hits = 0;
    for (int i = 0; i < count; i++) {
        if (pack[i].upper <= qm_search_cutoff(worker->search) || qm_worker_must_stop(worker))
            qm_worker_push(worker, pack[i], NULL);
        else
            visit_pack(worker, pack[i], &node);
    }
    if (node.has_failed || 2 * node.hits < node.tries) {
        unsigned pause = 2 * worker->share_pause + 1;
        worker->share_wait = worker->share_pause = pause < MAX_SHARE_PAUSE ? pause : MAX_SHARE_PAUSE;
    } else if (node.has_overlay) {
        worker->share_pause = 0;
    }
}
