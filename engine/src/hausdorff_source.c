/**
 * hausdorff_source.c: the upper stages. A group or pack of the source is let go when the ball round its box
 * is near enough; a pack's faces when one triangle of the target reaches all corners of the face.
 */
#include <float.h>

#include "hausdorff_search.h"

/** The ball round box member of a group, in the frame of the target. */
static double member_ball(const qm_side *side, const qm_box_group *group, int member, qm_vec *centre)
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

void qm_worker_group(qm_worker *worker, qm_entry entry)
{
    const qm_search *search = worker->search;
    const qm_side *side = &search->side[entry.side];
    const qm_box_group *group = &side->source->groups[entry.level][entry.index];
    int members = qm_bvh_member_count(side->source, entry.level, entry.index);
    uint32_t hint = entry.hint;
    for (int m = 0; m < members; m++) {
        qm_vec centre;
        double radius = member_ball(side, group, m, &centre);
        double upper = qm_side_pack_upper(search, side, hint, centre) + radius;
        if (upper * side->inverse_scale > qm_search_allowed(search)) {
            qm_hit hit = {.d2 = INFINITY, .pack = hint};
            search->kernel->closest(side->target, centre, &hit);
            worker->projections++;
            hint = hit.pack;
            upper = fmin(upper, sqrt(hit.d2) + qm_side_twist(side, hit.pack, hit.lane) + radius);
        }
        qm_entry child = {
            .upper = fmin(entry.upper, upper * side->inverse_scale),
            .index = 8 * entry.index + (uint32_t)m,
            .hint = hint,
            .kind = entry.level > 1 ? QM_ENTRY_GROUP : QM_ENTRY_PACK,
            .side = entry.side,
            .level = (uint8_t)(entry.level - 1),
        };
        qm_worker_push(worker, child, NULL);
    }
}

/** A pack of the source on its way: vertices in the target's frame and, for each, lanes in reach and
 * distances. */
typedef struct pack_work {
    const qm_side *side;
    const qm_pack_lanes *lanes;
    qm_vec vertex[3 * QM_PACK_LANES];
    uint64_t in_reach[3 * QM_PACK_LANES];
    qm_lane_rows rows[3 * QM_PACK_LANES];
    qm_candidates candidates;
    uint32_t packs[QM_COVER_PACKS];
    int pack_count;
} pack_work;

static void load_vertices(pack_work *work, qm_box *box)
{
    *box = (qm_box){{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    for (int i = 0; i < work->lanes->vertex_count; i++) {
        double p[3];
        work->vertex[i] = qm_side_vertex(work->side, work->lanes->vertex[i]);
        qm_vec_store(p, work->vertex[i]);
        for (int k = 0; k < 3; k++) {
            box->min[k] = fmin(box->min[k], p[k]);
            box->max[k] = fmax(box->max[k], p[k]);
        }
    }
}

static void reach_vertices(const qm_search *search, pack_work *work, double allowed, bool with_distances)
{
    qm_candidates_fill(&work->candidates, work->side, work->packs, work->pack_count, allowed);
    for (int i = 0; i < work->lanes->vertex_count; i++)
        work->in_reach[i] = search->kernel->in_reach(&work->candidates, work->vertex[i],
                                                     with_distances ? work->rows[i].d2 : NULL);
}

/** Corners of the face that starts at lane, as places in vertex[]; a patch is held whole, else each lane
 * alone. */
static int face_corners(const pack_work *work, int lane, int corner[4])
{
    const qm_pack_lanes *lanes = work->lanes;
    for (int i = 0; i < 3; i++)
        corner[i] = lanes->corner[lane][i];
    bool is_patch =
        work->side->source_patches && lane + 1 < lanes->lane_count && (lanes->second >> (lane + 1) & 1);
    if (!is_patch) return 3;
    corner[3] = lanes->corner[lane + 1][2];
    return 4;
}

/** True when one lane of the candidates reaches all corners of a face. */
static bool face_reached(const pack_work *work, const int *corner, int count)
{
    uint64_t labels = work->in_reach[corner[0]];
    for (int i = 1; i < count; i++)
        labels &= work->in_reach[corner[i]];
    return labels != 0;
}

static bool all_faces_reached(const pack_work *work)
{
    for (int lane = 0, count; lane < work->lanes->lane_count; lane += count - 2) {
        int corner[4];
        count = face_corners(work, lane, corner);
        if (!face_reached(work, corner, count)) return false;
    }
    return true;
}

static double single_label_upper(const pack_work *work, const int *corner, int count)
{
    const qm_lane_rows *rows[4];
    for (int i = 0; i < count; i++)
        rows[i] = &work->rows[corner[i]];
    return qm_candidates_upper(&work->candidates, rows, count);
}

/** Vertices that the candidates do not bring near enough are measured: they may raise the lower bound. */
static void sample_far_vertices(qm_worker *worker, pack_work *work)
{
    double below = qm_search_allowed(worker->search) - 0.5 * worker->search->tolerance;
    for (int i = 0; i < work->lanes->vertex_count; i++) {
        int nearest;
        double upper = qm_candidates_point_upper(&work->candidates, &work->rows[i], &nearest);
        if (upper * work->side->inverse_scale <= below) continue;
        uint32_t hint = work->packs[nearest], lane = 0;
        while (work->lanes->corner[lane][0] != i && work->lanes->corner[lane][1] != i &&
               work->lanes->corner[lane][2] != i)
            lane++;
        qm_worker_sample(worker, work->side, work->vertex[i], 0.0, work->lanes->face[lane], &hint);
    }
}

static void push_faces(qm_worker *worker, const pack_work *work, qm_entry entry)
{
    for (int lane = 0, count; lane < work->lanes->lane_count; lane += count - 2) {
        int corner[4];
        count = face_corners(work, lane, corner);
        if (face_reached(work, corner, count)) continue;
        double upper = single_label_upper(work, corner, count) * work->side->inverse_scale;
        qm_piece piece = {
            .high = {1.0, 1.0},
            .face = work->lanes->face[lane],
            .corner_count = (uint8_t)count,
            .pack_count = (uint8_t)work->pack_count,
        };
        for (int i = 0; i < count; i++)
            piece.corner[i] = work->vertex[corner[i]];
        for (int k = 0; k < work->pack_count; k++)
            piece.pack[k] = work->packs[k];
        qm_entry child = {.upper = fmin(entry.upper, upper), .kind = QM_ENTRY_PIECE, .side = entry.side};
        qm_worker_push(worker, child, &piece);
    }
}

void qm_worker_pack(qm_worker *worker, qm_entry entry)
{
    const qm_search *search = worker->search;
    pack_work work;
    work.side = &search->side[entry.side];
    work.lanes = &work.side->source->lanes[entry.index];
    qm_box box;
    load_vertices(&work, &box);

    double allowed = qm_search_allowed(search);
    work.packs[0] = entry.hint;
    work.pack_count = 1;
    reach_vertices(search, &work, allowed * work.side->scale, false);
    if (all_faces_reached(&work)) {
        qm_worker_discard(worker, allowed);
        return;
    }
    double near = fmin(allowed, entry.upper) * work.side->scale;
    int found = search->kernel->gather(work.side->target, &box, near, QM_COVER_PACKS, work.packs);
    work.pack_count = found > 0 ? found : 1;
    reach_vertices(search, &work, allowed * work.side->scale, true);
    qm_worker_discard(worker, allowed);
    if (all_faces_reached(&work)) return;
    sample_far_vertices(worker, &work);
    push_faces(worker, &work, entry);
}
