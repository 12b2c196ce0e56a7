/**
 * hausdorff_candidates.c: the facets of the target that a piece may be covered with.
 */
#include <float.h>

#include "hausdorff_piece.h"

#define NEGLIGIBLE_TWIST 0.1 /* of the tolerance: labels with less are not refined */
#define REFINED_MARGIN 0.1   /* by which refined labels reach beyond the feet of the part's corners */

void qm_piece_fill_candidates(qm_piece_work *work)
{
    work->filled_for = qm_piece_allowed(work);
    qm_candidates_fill(&work->candidates, work->side, work->packs, work->pack_count,
                       work->filled_for - work->slack);
    work->generation++;
}

void qm_piece_gather(qm_piece_work *work, qm_near_packs *near)
{
    qm_box box = qm_vec_box(work->piece.corner, work->piece.corner_count);
    work->kernel->gather(work->side->target, &box, qm_piece_allowed(work), near);
    work->near = near;
    work->pack_capacity = work->side->target_patches ? QM_COVER_PACKS - 1 : QM_COVER_PACKS;
    work->pack_count =
        work->kernel->narrow(work->near, &box, qm_piece_allowed(work), work->pack_capacity, work->packs);
    if (work->pack_count == 0) work->packs[work->pack_count++] = work->entry.hint;
    qm_piece_fill_candidates(work);
}

/** Puts a pack among the candidates, in place of the last when they are full. False when it is there already.
 */
bool qm_piece_add_candidate(qm_piece_work *work, uint32_t pack)
{
    for (int k = 0; k < work->pack_count; k++)
        if (work->packs[k] == pack) return false;
    if (work->pack_count < work->pack_capacity) work->pack_count++;
    for (int k = work->pack_count - 1; k > 0; k--)
        work->packs[k] = work->packs[k - 1];
    work->packs[0] = pack;
    return true;
}

static void add_near_face(qm_near_faces *near, uint32_t face, double distance)
{
    int place = near->count < QM_NEAR_FACES ? near->count++ : near->count - 1;
    for (; place > 0 && near->distance[place - 1] > distance; place--) {
        near->distance[place] = near->distance[place - 1];
        near->face[place] = near->face[place - 1];
    }
    near->distance[place] = distance;
    near->face[place] = face;
}

/** Looks at the quad that starts at a lane: a twisted one is measured itself, since its triangles may lie far
 * off. */
static void visit_quad(const qm_piece_work *work, qm_near_faces *near, uint32_t face, double triangles,
                       double twist, qm_vec p)
{
    bool is_full = near->count == QM_NEAR_FACES;
    if (is_full && triangles - twist >= near->distance[QM_NEAR_FACES - 1]) return;
    double distance = triangles;
    if (twist > NEGLIGIBLE_TWIST * work->search->tolerance * work->side->scale) {
        qm_vec corner[4];
        qm_bvh_load_face(work->side->target, face, corner);
        qm_patch patch = qm_patch_make(corner);
        distance = qm_patch_descend(&patch, p).distance;
    }
    if (!is_full || distance < near->distance[QM_NEAR_FACES - 1]) add_near_face(near, face, distance);
}

qm_near_faces qm_piece_near_quads(const qm_piece_work *work, qm_vec p, bool twisted_only)
{
    qm_near_faces near = {0};
    double least_twist = NEGLIGIBLE_TWIST * work->search->tolerance * work->side->scale;
    for (int k = 0; k < work->pack_count; k++) {
        const qm_pack_lanes *lanes = &work->side->target->lanes[work->packs[k]];
        double d2[QM_PACK_LANES];
        work->kernel->pack_distances(work->candidates.pack[k], p, d2);
        for (int lane = 1; lane < lanes->lane_count; lane++) {
            double twist = work->candidates.twist[k][lane];
            if (!(lanes->second >> lane & 1) || (twisted_only && twist <= least_twist)) continue;
            visit_quad(work, &near, lanes->face[lane], sqrt(fmin(d2[lane - 1], d2[lane])), twist, p);
        }
    }
    return near;
}

/** The parameters of a patch that lie under the corners of a polygon, with a margin. */
static void feet_rectangle(const qm_patch *patch, const qm_polygon *polygon, double low[2], double high[2])
{
    low[0] = low[1] = 1.0;
    high[0] = high[1] = 0.0;
    for (int i = 0; i < polygon->count; i++) {
        qm_patch_foot foot = qm_patch_descend(patch, polygon->corner[i]);
        for (int k = 0; k < 2; k++) {
            low[k] = fmin(low[k], foot.uv[k]);
            high[k] = fmax(high[k], foot.uv[k]);
        }
    }
    for (int k = 0; k < 2; k++) {
        double margin = REFINED_MARGIN * (high[k] - low[k]);
        low[k] = fmax(0.0, low[k] - margin);
        high[k] = fmin(1.0, high[k] + margin);
    }
}

/** Corners of eight triangles, as kernels take them. */
typedef struct lane_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} lane_corners;

static void set_lane_corner(lane_corners *corners, int i, int lane, qm_vec p)
{
    corners->at[i][0][lane] = p.x;
    corners->at[i][1][lane] = p.y;
    corners->at[i][2][lane] = p.z;
}

/** The two triangles of a part of a patch as labels; that part leaves them by a twist of its own. */
static void set_refined_lanes(qm_piece_work *work, lane_corners *corners, int lane, const qm_patch *patch,
                              const double low[2], const double high[2])
{
    const qm_vec c[4] = {qm_patch_at(patch, low[0], low[1]), qm_patch_at(patch, high[0], low[1]),
                         qm_patch_at(patch, high[0], high[1]), qm_patch_at(patch, low[0], high[1])};
    double twist = qm_patch_twist(c);
    double rest = qm_piece_allowed(work) - work->slack - twist;
    for (int half = 0; half < 2; half++) {
        set_lane_corner(corners, 0, lane + half, c[0]);
        set_lane_corner(corners, 1, lane + half, c[1 + half]);
        set_lane_corner(corners, 2, lane + half, c[2 + half]);
        work->candidates.twist[work->pack_count][lane + half] = twist;
        work->candidates.allowed2[work->pack_count][lane + half] = rest >= 0.0 ? rest * rest : -1.0;
    }
}

bool qm_piece_refine(qm_piece_work *work, qm_polygon *polygon)
{
    if (!work->side->target_patches) return false;
    qm_vec middle = {0, 0, 0};
    for (int i = 0; i < polygon->count; i++)
        middle = qm_vec_axpy(middle, 1.0 / polygon->count, polygon->corner[i]);
    qm_near_faces near = qm_piece_near_quads(work, middle, true);
    if (near.count == 0) return false;
    lane_corners corners;
    for (int i = 0; i < QM_NEAR_FACES; i++) {
        qm_vec corner[4];
        double low[2], high[2];
        qm_bvh_load_face(work->side->target, near.face[i < near.count ? i : 0], corner);
        qm_patch patch = qm_patch_make(corner);
        feet_rectangle(&patch, polygon, low, high);
        set_refined_lanes(work, &corners, 2 * i, &patch, low, high);
    }
    work->kernel->fill_pack(&work->refined, corners.at);
    work->candidates.pack[work->pack_count] = &work->refined;
    work->candidates.count = work->pack_count + 1;
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&work->candidates, polygon->corner[i]);
    return true;
}

void qm_piece_drop_refined(qm_piece_work *work, qm_polygon *polygon)
{
    work->candidates.count = work->pack_count;
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] &= (UINT64_C(1) << (QM_PACK_LANES * work->pack_count)) - 1;
}
