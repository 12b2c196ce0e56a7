/**
 * hausdorff_source.c: the upper stages. A group or pack of the source is let go when the ball round its box
 * is near enough; a pack's faces when one triangle of the target reaches all corners of the face.
 */
#include <string.h>

#include "hausdorff_overlay.h"

#define NEAR_SHARE 0.05 /* of a pack's diagonal: facets so much farther than its middle are gathered */

#define DEARER_INTERVAL 64 /* packs between two whose faces are settled in the way that seems dearer: */
#define COVER_PRIOR 50.0   /* what a cover of a face is taken to cost before there is one, and an overlay */
#define OVERLAY_PRIOR 100.0
#define MAX_SHARE_PAUSE 63 /* groups without a common overlay, at most, after failures in a row */
#define OVERLAY_GAIN 2.0   /* by which an overlay must be cheaper: the counts only estimate times */

/** The ball round box member of a group, in the frame of the target. */
static double child_ball(const qm_side *side, const qm_box_node *group, int member, qm_vec *centre)
{
    double middle[3], half2 = 0.0;
    for (int k = 0; k < 3; k++) {
        double low = (double)group->low[k][member], high = (double)group->high[k][member];
        middle[k] = 0.5 * (low + high);
        half2 += 0.25 * (high - low) * (high - low);
    }
    *centre = qm_vec_axpy(side->shift, side->factor, qm_vec_load(middle));
    return side->factor * sqrt(half2);
}

/** Radius of the ball round p that holds the box of a member, in the frame of the target. */
static double child_radius(const qm_side *side, const qm_box_node *group, int member, qm_vec p)
{
    double far2 = 0.0;
    const double shift[3] = {side->shift.x, side->shift.y, side->shift.z}, point[3] = {p.x, p.y, p.z};
    for (int k = 0; k < 3; k++) {
        double low = point[k] - (shift[k] + side->factor * (double)group->low[k][member]);
        double high = shift[k] + side->factor * (double)group->high[k][member] - point[k];
        double far = low > high ? low : high;
        far2 += far * far;
    }
    return sqrt(far2);
}

/** The packs of a group that are looked at in turn, and their common overlay. */
typedef struct group_work {
    const qm_entry *pack;
    int pack_count;
    bool is_begun, has_failed, has_overlay;
    int tries, hits; /* faces tried with it, and settled by it */
    qm_overlay overlay;
} group_work;

/** A pack of the source on its way: vertices in the target's frame and, for each, the lanes of one pack in
 * reach. */
typedef struct pack_work {
    qm_entry entry;
    group_work *group;
    const qm_side *side;
    const qm_kernel *kernel;
    const qm_pack_lanes *lanes;
    qm_vec vertex[3 * QM_PACK_LANES];
    qm_float_bits in_reach[3 * QM_PACK_LANES];
    uint32_t measured;    /* a bit a vertex: in_reach is what double precision says */
    qm_candidates hinted; /* the pack of the hint, for them */
    int open_count;       /* faces that a look at one lane or a few points has not settled */
    qm_piece open[QM_PACK_LANES];
    qm_near_faces faces; /* the open faces by their corners, valid until the first is settled */
    qm_near_packs near;  /* of the whole pack, where some are open */
} pack_work;

/** Where single precision leaves it open whether a lane reaches a vertex, as it does where the cutoff
 * distance is tiny or the source runs beside the target, double precision decides. */
static void measure_vertex(pack_work *work, double cutoff, int vertex)
{
    if (work->measured >> vertex & 1) return;
    if (work->measured == 0) qm_candidates_fill(&work->hinted, work->side, &work->entry.hint, 1, cutoff);
    work->measured |= 1u << vertex;
    unsigned bits = (unsigned)work->kernel->in_reach(&work->hinted, work->vertex[vertex]);
    work->in_reach[vertex] = (qm_float_bits)(bits << 8 | bits);
}

/** True when one lane of the pack of the hint reaches all corners of a face. */
static bool face_reached(pack_work *work, double cutoff, const int *corner, int count)
{
    unsigned bits = ~0u;
    for (int i = 0; i < count; i++)
        bits &= work->in_reach[corner[i]];
    if (qm_float_certain(bits) || bits == 0) return bits != 0;
    for (int i = 0; i < count; i++) {
        measure_vertex(work, cutoff, corner[i]);
        bits &= work->in_reach[corner[i]];
    }
    return bits != 0;
}

/** Bits of the lanes of a pack that reach a point each, for count points. */
static void reach_by_pack(const pack_work *work, double cutoff, uint32_t pack, const qm_vec *point, int count,
                          qm_float_bits *bits)
{
    work->kernel->float_reach(qm_bvh_floats(work->side->target, pack), qm_side_twists(work->side, pack),
                              cutoff, point, (1u << count) - 1, bits);
}

/**
 * Gathers the packs that faces are most likely covered with: those about as near as the hint is to the
 * middle. All that are within reach may be hundreds where the lower bound is great.
 */
static void gather_about(const qm_worker *worker, const pack_work *work, const qm_vec *point, int count,
                         qm_near_packs *near)
{
    const qm_search *search = worker->search;
    qm_box box = qm_vec_box(point, count);
    qm_vec low = qm_vec_load(box.min), high = qm_vec_load(box.max);
    double middle = qm_side_pack_upper(search, work->side, work->entry.hint, qm_vec_mix(low, high, 0.5));
    double reach =
        fmin(middle + NEAR_SHARE * qm_vec_distance(low, high), qm_search_cutoff(search) * work->side->scale);
    search->kernel->gather(work->side->target, &box, reach, near);
}

/** Takes the open faces out of the list that have a bit. */
static void take_out(pack_work *work, unsigned gone)
{
    int left = 0;
    for (int i = 0; i < work->open_count; i++)
        if (!(gone >> i & 1)) work->open[left++] = work->open[i];
    work->open_count = left;
}

/** Bits of those triangles that are settled by what lies straight over all of them. */
static unsigned settle_together(qm_worker *worker, const pack_work *work, const qm_overlay_source *source,
                                const qm_near_packs *near)
{
    qm_overlay overlay;
    bool is_set = qm_worker_set_overlay(worker, work->side, qm_overlay_normal(source), &source->corner[0][0],
                                        3 * source->count, near, &overlay);
    return is_set ? qm_worker_overlay(worker, work->side, &overlay, source) : 0;
}

static bool overlay_alone(qm_worker *worker, const pack_work *work, const qm_piece *face)
{
    qm_near_packs near;
    gather_about(worker, work, face->corner, 3, &near);
    return qm_worker_overlay_face(worker, work->side, face, &near);
}

/** Lists the open triangles; place tells which they are. */
static void list_open(const pack_work *work, qm_overlay_source *source, int *place)
{
    source->count = 0;
    for (int i = 0; i < work->open_count; i++) {
        if (work->open[i].corner_count != 3) continue;
        memcpy(source->corner[source->count], work->open[i].corner, sizeof source->corner[0]);
        place[source->count++] = i;
    }
}

/** The vertices of the packs of a group; returns how many. Adds up their normals. */
static int group_points(const group_work *group, const qm_side *side, qm_vec *point, qm_vec *normal)
{
    int count = 0;
    *normal = (qm_vec){0, 0, 0};
    for (int i = 0; i < group->pack_count; i++) {
        const qm_pack_lanes *lanes = &side->source->lanes[group->pack[i].index];
        const qm_vec *vertex = point + count;
        for (int k = 0; k < lanes->vertex_count; k++)
            point[count++] = qm_side_vertex(side, lanes->vertex[k]);
        qm_overlay_source faces = {.count = lanes->lane_count};
        for (int lane = 0; lane < faces.count; lane++)
            for (int c = 0; c < 3; c++)
                faces.corner[lane][c] = vertex[lanes->corner[lane][c]];
        *normal = qm_vec_add(*normal, qm_overlay_normal(&faces));
    }
    return count;
}

/** Makes the overlay of a group unless that has failed lately, as it does where a group of the source is much
 * larger than one of the target. */
static void begin_group_overlay(qm_worker *worker, const pack_work *work)
{
    group_work *group = work->group;
    group->is_begun = true;
    if (group->pack_count < 2) return;
    if (worker->share_wait > 0) {
        worker->share_wait--;
        return;
    }
    qm_vec point[3 * QM_PACK_LANES * QM_PACK_LANES], normal;
    int count = group_points(group, work->side, point, &normal);
    qm_near_packs near;
    gather_about(worker, work, point, count, &near);
    group->has_overlay =
        near.count < QM_NEAR_PACKS &&
        qm_worker_set_overlay(worker, work->side, normal, point, count, &near, &group->overlay);
    group->has_failed = !group->has_overlay;
}

/** Sets the pause before the next common overlay when all packs of a group are done. */
static void end_group_overlay(qm_worker *worker, const group_work *group)
{
    if (group->has_failed || 2 * group->hits < group->tries) {
        unsigned pause = 2 * worker->share_pause + 1;
        worker->share_wait = worker->share_pause = pause < MAX_SHARE_PAUSE ? pause : MAX_SHARE_PAUSE;
    } else if (group->has_overlay) {
        worker->share_pause = 0;
    }
}

/** Settles open triangles by what lies straight over the group. */
static void settle_by_group(qm_worker *worker, pack_work *work)
{
    qm_overlay_source source;
    int place[QM_PACK_LANES];
    list_open(work, &source, place);
    if (source.count == 0) return;
    if (!work->group->is_begun) begin_group_overlay(worker, work);
    if (!work->group->has_overlay) return;
    unsigned settled = qm_worker_overlay(worker, work->side, &work->group->overlay, &source), gone = 0;
    for (int i = 0; i < source.count; i++)
        if (settled >> i & 1) gone |= 1u << place[i];
    int hits = __builtin_popcount(settled);
    work->group->tries += source.count;
    work->group->hits += hits;
    take_out(work, gone);
    /* Those that are left are tried again, in settle_by_overlay, and counted there. */
    worker->overlay_tries += (uint64_t)hits;
    worker->overlay_hits += (uint64_t)hits;
}

/** Settles open triangles by what lies straight over them: all together, and each by itself where that has
 * not settled it, as where too many packs are near all of them. */
static void settle_by_overlay(qm_worker *worker, pack_work *work)
{
    qm_overlay_source source;
    int place[QM_PACK_LANES];
    list_open(work, &source, place);
    if (source.count == 0) return;
    bool has_all = source.count > 1 && work->near.count < QM_NEAR_PACKS;
    unsigned settled = has_all ? settle_together(worker, work, &source, &work->near) : 0, gone = 0;
    for (int i = 0; i < source.count; i++)
        if ((settled >> i & 1) || overlay_alone(worker, work, &work->open[place[i]])) gone |= 1u << place[i];
    take_out(work, gone);
    worker->overlay_tries += (uint64_t)source.count;
    worker->overlay_hits += (uint64_t)__builtin_popcount(gone);
}

/** Settles faces of a pack by few searches. */
static void settle_by_parts(qm_worker *worker, pack_work *work)
{
    take_out(work, qm_worker_faces_near(worker, work->side, &work->faces, work->entry.hint));
}

/** Gathers the packs near the open faces. */
static void gather_open(const qm_worker *worker, pack_work *work)
{
    qm_vec point[4 * QM_PACK_LANES] = {work->open[0].corner[0]};
    int count = 0;
    for (int i = 0; i < work->open_count; i++)
        for (int c = 0; c < work->open[i].corner_count; c++)
            point[count++] = work->open[i].corner[c];
    gather_about(worker, work, point, count, &work->near);
}

/**
 * Whether to settle faces by an overlay: at first, to see what that costs, and from then on where it has cost
 * less than covers. Now and then it is the other way round, the more seldom the more that costs.
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

/** Settles the faces of a pack that one lane does not reach: in the cheapest way first, one by one last. */
static void settle_open(qm_worker *worker, pack_work *work)
{
    bool is_matching = qm_search_is_matching(worker->search);
    settle_by_parts(worker, work);
    if (work->open_count == 0) return;
    if (!is_matching) {
        bool by_overlay = choose_overlay(worker);
        if (by_overlay) settle_by_group(worker, work);
        if (work->open_count == 0) return;
        gather_open(worker, work);
        if (by_overlay) settle_by_overlay(worker, work);
    }
    for (int i = 0; i < work->open_count; i++) {
        if (qm_worker_must_stop(worker)) {
            qm_worker_discard(worker, work->entry.upper);
            return;
        }
        if (is_matching) {
            qm_matching_face(worker, work->entry, &work->open[i]);
            continue;
        }
        qm_worker_face(worker, work->entry, &work->open[i], &work->near);
        qm_worker_follow(worker);
    }
}

/** True when a face is a copy of the last one, whose bounds hold for it, too; else it becomes the last. */
static bool is_copy(qm_worker *worker, const qm_side *side, const qm_piece *face)
{
    qm_settled_face *last = &worker->settled;
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

/** Settles the faces of a pack by the pack of its hint, together, or one by one. */
static void visit_pack(qm_worker *worker, qm_entry entry, group_work *group)
{
    const qm_search *search = worker->search;
    pack_work work;
    work.entry = entry;
    work.group = group;
    work.side = &search->side[entry.side];
    work.lanes = &work.side->source->lanes[entry.index];
    work.kernel = search->kernel;
    work.open_count = 0;
    work.measured = 0;
    double cutoff = qm_search_cutoff(search) * work.side->scale;
    for (int i = 0; i < work.lanes->vertex_count; i++)
        work.vertex[i] = qm_side_vertex(work.side, work.lanes->vertex[i]);
    reach_by_pack(&work, cutoff, entry.hint, work.vertex, work.lanes->vertex_count, work.in_reach);
    for (int lane = 0, count; lane < work.lanes->lane_count; lane += count - 2) {
        int corner[4];
        count = qm_lane_corners(work.lanes, (uint32_t)lane, work.side->source_patches, corner);
        if (face_reached(&work, cutoff, corner, count)) continue;
        qm_piece *piece = &work.open[work.open_count];
        *piece =
            (qm_piece){.high = {1.0, 1.0}, .face = work.lanes->face[lane], .corner_count = (uint8_t)count};
        for (int i = 0; i < count; i++)
            piece->corner[i] = work.vertex[corner[i]];
        for (int i = 0; i < 4; i++)
            work.faces.corner[work.open_count][i] = (uint8_t)corner[i < count ? i : count - 1];
        if (!is_copy(worker, work.side, piece)) work.open_count++;
    }
    work.faces.vertex = work.vertex;
    work.faces.vertex_count = work.lanes->vertex_count;
    work.faces.count = work.open_count;
    if (work.open_count > 0) settle_open(worker, &work);
    qm_worker_discard(worker, qm_search_cutoff(search)); /* the lower bound may have risen on the way */
}

/** Looks at packs of one group. */
static void visit_packs(qm_worker *worker, const qm_entry *pack, int count)
{
    group_work group;
    group.pack = pack;
    group.pack_count = count;
    group.is_begun = group.has_failed = group.has_overlay = false;
    group.tries = group.hits = 0;
    for (int i = 0; i < count; i++) {
        if (pack[i].upper <= qm_search_cutoff(worker->search) || qm_worker_must_stop(worker))
            qm_worker_push(worker, pack[i], NULL);
        else
            visit_pack(worker, pack[i], &group);
    }
    end_group_overlay(worker, &group);
}

static qm_entry child_entry(const qm_entry *group, int member, double upper, uint32_t hint)
{
    qm_entry child = *group;
    child.upper = fmin(group->upper, upper);
    child.index = 8 * group->index + (uint32_t)member;
    child.hint = hint;
    child.level = (uint8_t)(group->level - 1);
    return child;
}

/** Bound (local) of a group by the ball round its box; one search where the hint does not settle it. */
static double bound_node(qm_worker *worker, const qm_side *side, qm_vec centre, double radius, uint32_t *hint)
{
    double lower = qm_side_lower(worker->search, side);
    double reach = qm_search_cutoff(worker->search) * side->scale - radius;
    double enough = fmax(reach, QM_NEAR_ENOUGH * lower);
    worker->projections++;
    return qm_worker_nearly(worker, side, centre, enough, reach, hint) + radius;
}

/**
 * The same of a pack, round a point of its surface, which is searched for only when it may raise the lower
 * bound: neighbours on the curve are near enough to the pack of one hint mostly.
 */
static double bound_pack(qm_worker *worker, const qm_side *side, const qm_box_node *group, int member,
                         uint32_t pack, uint32_t *hint)
{
    uint32_t face;
    qm_vec p = qm_side_middle(side, pack, &face);
    double reach = child_radius(side, group, member, p);
    /* The scout has measured this point, at least as closely. */
    if (side->seeds && pack % side->seed_step == 0) {
        qm_seed seed = side->seeds[pack / side->seed_step];
        *hint = seed.hint;
        return seed.distance + reach;
    }
    double upper = qm_side_pack_upper(worker->search, side, *hint, p);
    double lower = qm_side_lower(worker->search, side);
    if (upper <= QM_NEAR_ENOUGH * lower) return upper + reach;
    double enough = qm_search_cutoff(worker->search) * side->scale - reach;
    enough = fmin(fmax(enough, QM_NEAR_ENOUGH * lower), lower);
    return qm_worker_sample(worker, side, p, 0.0, face, enough, hint) + reach;
}

/** Fetches what a pack needs next: its vertices lie far apart in memory. */
static void fetch_vertices(const qm_side *side, uint32_t pack)
{
    const qm_pack_lanes *lanes = &side->source->lanes[pack];
    for (int i = 0; i < lanes->vertex_count; i++)
        __builtin_prefetch(side->source->mesh.positions + 3 * (size_t)lanes->vertex[i]);
}

void qm_worker_node(qm_worker *worker, qm_entry entry)
{
    const qm_search *search = worker->search;
    const qm_side *side = &search->side[entry.side];
    const qm_box_node *group = &side->source->boxes.groups[entry.level][entry.index];
    int members = qm_box_tree_child_count(&side->source->boxes, entry.level, entry.index);
    qm_entry child[QM_PACK_LANES];
    uint32_t hint = entry.hint;
    for (int m = 0; m < members; m++) {
        if (entry.level == 1 && m + 1 < members) fetch_vertices(side, 8 * entry.index + (uint32_t)m + 1);
        qm_vec centre;
        double radius = child_ball(side, group, m, &centre);
        /* A ball larger than what is cutoff settles nothing, wherever its middle is. */
        bool is_small = radius * side->inverse_scale <= qm_search_cutoff(search);
        double upper = is_small ? qm_side_pack_upper(search, side, hint, centre) + radius : INFINITY;
        if (upper * side->inverse_scale > qm_search_cutoff(search) && !qm_worker_must_stop(worker)) {
            double nearer = entry.level > 1
                                ? bound_node(worker, side, centre, radius, &hint)
                                : bound_pack(worker, side, group, m, 8 * entry.index + (uint32_t)m, &hint);
            upper = fmin(upper, nearer);
        }
        child[m] = child_entry(&entry, m, upper * side->inverse_scale, hint);
    }
    /* Packs are looked at once all eight have had their say on the lower bound, and while they are at hand;
     * so are groups of packs, along the curve, where hints and vertices are still near. */
    int open_count = 0;
    for (int m = 0; m < members; m++) {
        if (entry.level > 2 || child[m].upper <= qm_search_cutoff(search) || qm_worker_must_stop(worker)) {
            qm_worker_push(worker, child[m], NULL);
        } else if (entry.level == 2) {
            worker->iterations++; /* as an entry of the queue: reports and limits come as often */
            qm_worker_node(worker, child[m]);
        } else {
            child[open_count++] = child[m];
        }
    }
    if (open_count > 0) visit_packs(worker, child, open_count);
}
