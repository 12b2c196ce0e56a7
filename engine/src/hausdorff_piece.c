/**
 * hausdorff_piece.c: the lower stage. A part of a face is covered by convex sets round facets of the target;
 * what is left of it is split and tried again at once, and goes back to the queue when the budget of one
 * visit is used up.
 *
 * Termination: a corner that no candidate reaches is measured, which raises the lower bound to it and makes
 * its nearest facet a candidate; from STRICT_DEPTH on so is every corner that is not reached with half the
 * tolerance to spare. A part of a diameter below that half is then covered by the nearest facet of any of its
 * corners. Cuts never make a diameter larger, and from MIDPOINT_DEPTH on every second level halves it.
 */
#include <float.h>

#include "bilinear_point.h"
#include "hausdorff_search.h"

#define STRICT_DEPTH 8
#define MIDPOINT_DEPTH 40
#define MAX_ATTEMPTS 4  /* covers of one part, each with candidates that the last one's corners brought */
#define VISIT_BUDGET 64 /* parts looked at before the rest goes back to the queue */
#define STACK_SIZE 128
#define REFINED_PATCHES 4  /* of the target, with labels cut to the part */
#define REFINED_MARGIN 0.1 /* by which these labels reach beyond the feet of the part's corners */
#define SLACK_SHARE 0.125  /* of the tolerance: a patch this flat goes on as triangles */

/** A triangle of the piece, with what is known of its corners; in_reach holds for one generation of
 * candidates. */
typedef struct part {
    qm_vec corner[3];
    uint64_t in_reach[3];
    unsigned generation;
    uint8_t depth;
} part;

/** A piece on its way. */
typedef struct piece_work {
    qm_worker *worker;
    const qm_search *search;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_entry entry;
    qm_piece piece;
    double slack; /* the parts lie within this distance of the source's surface */
    uint32_t packs[QM_COVER_PACKS];
    int pack_count, pack_capacity;
    qm_candidates candidates;
    unsigned generation; /* counts changes of the candidates */
    qm_pack refined;     /* labels cut out of patches of the target, in the last place of the candidates */
    part stack[STACK_SIZE];
    int height;
} piece_work;

static double local_allowed(const piece_work *work)
{
    return qm_search_allowed(work->search) * work->side->scale;
}

/* ---- candidates ---- */

static void fill_candidates(piece_work *work)
{
    qm_candidates_fill(&work->candidates, work->side, work->packs, work->pack_count,
                       local_allowed(work) - work->slack);
    work->generation++;
}

/** The packs of the target that come near enough to the piece to matter; the hint when there is none. */
static void gather_candidates(piece_work *work)
{
    qm_box box = {{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    for (int i = 0; i < work->piece.corner_count; i++) {
        const double p[3] = {work->piece.corner[i].x, work->piece.corner[i].y, work->piece.corner[i].z};
        for (int k = 0; k < 3; k++) {
            if (p[k] < box.min[k]) box.min[k] = p[k];
            if (p[k] > box.max[k]) box.max[k] = p[k];
        }
    }
    work->pack_capacity = work->side->target_patches ? QM_COVER_PACKS - 1 : QM_COVER_PACKS;
    work->pack_count =
        work->kernel->gather(work->side->target, &box, local_allowed(work), work->pack_capacity, work->packs);
    if (work->pack_count == 0) work->packs[work->pack_count++] = work->entry.hint;
    fill_candidates(work);
}

/** Puts a pack among the candidates, in place of the last when they are full. False when it is there already.
 */
static bool add_candidate(piece_work *work, uint32_t pack)
{
    for (int k = 0; k < work->pack_count; k++)
        if (work->packs[k] == pack) return false;
    if (work->pack_count < work->pack_capacity) work->pack_count++;
    for (int k = work->pack_count - 1; k > 0; k--)
        work->packs[k] = work->packs[k - 1];
    work->packs[0] = pack;
    return true;
}

/** A list of faces of the target, nearest first. */
typedef struct near_faces {
    int count;
    uint32_t face[REFINED_PATCHES];
    double d2[REFINED_PATCHES];
} near_faces;

static void add_near_face(near_faces *near, uint32_t face, double d2)
{
    int place = 0;
    while (place < near->count && near->face[place] != face)
        place++;
    bool is_known = place < near->count;
    if (is_known && near->d2[place] <= d2) return;
    if (!is_known && near->count == REFINED_PATCHES && near->d2[near->count - 1] <= d2) return;
    if (!is_known) place = near->count < REFINED_PATCHES ? near->count++ : near->count - 1;
    for (; place > 0 && near->d2[place - 1] > d2; place--) {
        near->d2[place] = near->d2[place - 1];
        near->face[place] = near->face[place - 1];
    }
    near->d2[place] = d2;
    near->face[place] = face;
}

/** Patches among the candidates that lie nearest to a point; flat ones have nothing to win. */
static near_faces nearest_patches(const piece_work *work, qm_vec p)
{
    near_faces near = {0};
    for (int k = 0; k < work->pack_count; k++) {
        const qm_pack_lanes *lanes = &work->side->target->lanes[work->packs[k]];
        double d2[QM_PACK_LANES];
        work->kernel->pack_distances(work->candidates.pack[k], p, d2);
        for (int lane = 0; lane < lanes->lane_count; lane++)
            if (work->candidates.twist[k][lane] > 0.0) add_near_face(&near, lanes->face[lane], d2[lane]);
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

/** The two triangles of a part of a patch as labels; that part leaves them by a ds dt share of the twist. */
static void set_refined_lanes(piece_work *work, lane_corners *corners, int lane, const qm_patch *patch,
                              const double low[2], const double high[2])
{
    const qm_vec c[4] = {qm_patch_at(patch, low[0], low[1]), qm_patch_at(patch, high[0], low[1]),
                         qm_patch_at(patch, high[0], high[1]), qm_patch_at(patch, low[0], high[1])};
    double share = (high[0] - low[0]) * (high[1] - low[1]);
    double twist = 0.25 * share * qm_vec_norm(patch->w) * (1.0 + 0x1p-20);
    double rest = local_allowed(work) - work->slack - twist;
    for (int half = 0; half < 2; half++) {
        set_lane_corner(corners, 0, lane + half, c[0]);
        set_lane_corner(corners, 1, lane + half, c[1 + half]);
        set_lane_corner(corners, 2, lane + half, c[2 + half]);
        work->candidates.twist[work->pack_count][lane + half] = twist;
        work->candidates.allowed2[work->pack_count][lane + half] = rest >= 0.0 ? rest * rest : -1.0;
    }
}

/**
 * Labels of the target's patches lose their twist of the allowed distance. Where that is too much, parts of
 * the nearest patches just under the polygon lose only their share, which falls with the square of its size.
 * The refined labels stand behind the candidates until drop_refined. False when there is no twist to win
 * back.
 */
static bool refine_candidates(piece_work *work, qm_polygon *polygon)
{
    if (!work->side->target_patches) return false;
    qm_vec middle = {0, 0, 0};
    for (int i = 0; i < polygon->count; i++)
        middle = qm_vec_axpy(middle, 1.0 / polygon->count, polygon->corner[i]);
    near_faces near = nearest_patches(work, middle);
    if (near.count == 0) return false;
    lane_corners corners;
    for (int i = 0; i < REFINED_PATCHES; i++) {
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

static void drop_refined(piece_work *work, qm_polygon *polygon)
{
    work->candidates.count = work->pack_count;
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] &= (UINT64_C(1) << (QM_PACK_LANES * work->pack_count)) - 1;
}

/* ---- covering ---- */

static void reach_corners(const piece_work *work, qm_polygon *polygon)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&work->candidates, polygon->corner[i]);
}

/** Covers a polygon by the candidates, then, when that is not enough, by refined ones too. */
static bool cover(piece_work *work, qm_polygon *polygon, bool *moved)
{
    bool cut;
    bool covered = work->kernel->cover(&work->candidates, polygon, &cut);
    *moved |= cut;
    if (covered || !refine_candidates(work, polygon)) return covered;
    covered = work->kernel->cover(&work->candidates, polygon, &cut);
    *moved |= cut;
    drop_refined(work, polygon);
    return covered;
}

/** True when a corner has to be measured: no candidate reaches it, or, deep down, none with enough to spare.
 */
static bool needs_sample(const piece_work *work, const qm_polygon *polygon, int i, int depth)
{
    if (depth < STRICT_DEPTH) return polygon->in_reach[i] == 0;
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, &polygon->corner[i], 1, &place) + work->slack;
    return upper > local_allowed(work) - 0.5 * work->search->tolerance * work->side->scale;
}

/** Measures the corners that need it. True when that found new candidates: in_reach is then made anew. */
static bool sample_corners(piece_work *work, qm_polygon *polygon, int depth)
{
    bool found = false;
    for (int i = 0; i < polygon->count; i++) {
        if (!needs_sample(work, polygon, i, depth)) continue;
        uint32_t hint = work->packs[0];
        qm_worker_sample(work->worker, work->side, polygon->corner[i], work->slack, work->piece.face, &hint);
        if (!add_candidate(work, hint)) continue;
        fill_candidates(work);
        found = true;
    }
    if (found) reach_corners(work, polygon);
    return found;
}

/* ---- splitting ---- */

/** Queues a triangle or rectangle with the bound that its best single label gives. */
static void push_piece(piece_work *work, const qm_piece *piece)
{
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, piece->corner, piece->corner_count, &place);
    qm_entry entry = work->entry;
    entry.upper = fmin(entry.upper, (upper + piece->slack) * work->side->inverse_scale);
    entry.hint = work->packs[place < work->pack_count ? place : 0];
    qm_worker_push(work->worker, entry, piece);
}

static void push_part(piece_work *work, const part *from)
{
    qm_piece piece = work->piece;
    piece.corner_count = 3;
    piece.slack = work->slack;
    piece.depth = from->depth;
    for (int i = 0; i < 3; i++)
        piece.corner[i] = from->corner[i];
    push_piece(work, &piece);
}

static void keep_part(piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    part kept = {
        .corner = {polygon->corner[a], polygon->corner[b], polygon->corner[c]},
        .in_reach = {polygon->in_reach[a], polygon->in_reach[b], polygon->in_reach[c]},
        .generation = work->generation,
        .depth = depth,
    };
    if (work->height < STACK_SIZE)
        work->stack[work->height++] = kept;
    else
        push_part(work, &kept);
}

/** Keeps a triangle of a polygon in four parts, cut at the midpoints: each has half the diameter. */
static void keep_quarters(piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    const int index[3] = {a, b, c};
    qm_polygon six;
    six.count = 6;
    for (int i = 0; i < 3; i++) {
        six.corner[i] = polygon->corner[index[i]];
        six.in_reach[i] = polygon->in_reach[index[i]];
        six.corner[3 + i] = qm_vec_mix(polygon->corner[index[i]], polygon->corner[index[(i + 1) % 3]], 0.5);
        six.in_reach[3 + i] = work->kernel->in_reach(&work->candidates, six.corner[3 + i]);
    }
    keep_part(work, &six, 0, 3, 5, depth);
    keep_part(work, &six, 3, 1, 4, depth);
    keep_part(work, &six, 5, 4, 2, depth);
    keep_part(work, &six, 4, 5, 3, depth);
}

static void split_rest(piece_work *work, const qm_polygon *rest, bool moved, uint8_t depth)
{
    bool halve = !moved || (depth >= MIDPOINT_DEPTH && depth % 2 == 0);
    uint8_t deeper = (uint8_t)(depth < UINT8_MAX ? depth + 1 : MIDPOINT_DEPTH);
    for (int i = 1; i + 1 < rest->count; i++) {
        if (halve)
            keep_quarters(work, rest, 0, i, i + 1, deeper);
        else
            keep_part(work, rest, 0, i, i + 1, deeper);
    }
}

static qm_polygon part_polygon(const piece_work *work, const part *from)
{
    qm_polygon polygon;
    polygon.count = 3;
    for (int i = 0; i < 3; i++) {
        polygon.corner[i] = from->corner[i];
        polygon.in_reach[i] = from->in_reach[i];
    }
    if (from->generation != work->generation) reach_corners(work, &polygon);
    return polygon;
}

static void process_part(piece_work *work, const part *from)
{
    qm_polygon rest = part_polygon(work, from);
    bool moved = false;
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        if (cover(work, &rest, &moved)) return;
        if (!sample_corners(work, &rest, from->depth)) break;
    }
    split_rest(work, &rest, moved, from->depth);
}

/** Works through the stack of parts; what the budget leaves over goes to the queue. */
static void process_stack(piece_work *work)
{
    for (int budget = VISIT_BUDGET; work->height > 0; budget--) {
        part next = work->stack[--work->height];
        if (budget > 0)
            process_part(work, &next);
        else
            push_part(work, &next);
    }
    qm_worker_discard(work->worker, qm_search_allowed(work->search));
}

static void keep_triangle(piece_work *work, const qm_vec *a, const qm_vec *b, const qm_vec *c)
{
    work->stack[work->height++] = (part){
        .corner = {*a, *b, *c},
        .generation = work->generation - 1,
        .depth = work->piece.depth,
    };
}

/* ---- parameter rectangles of the source's patches ---- */

static qm_patch source_patch(const piece_work *work)
{
    const uint32_t *vertex = work->side->source->mesh->faces + 4 * (size_t)work->piece.face;
    qm_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = qm_side_vertex(work->side, vertex[i]);
    return qm_patch_make(corner);
}

/** One label for the hull of the four corners, which holds that part of the patch. */
static bool hull_reached(const piece_work *work, qm_polygon *corners)
{
    uint64_t labels = ~UINT64_C(0);
    corners->count = 4;
    for (int i = 0; i < 4; i++) {
        corners->corner[i] = work->piece.corner[i];
        corners->in_reach[i] = work->kernel->in_reach(&work->candidates, work->piece.corner[i]);
        labels &= corners->in_reach[i];
    }
    return labels != 0;
}

/** Covers the two triangles of a rectangle, with the slack by which the patch leaves them. */
static bool triangles_reached(piece_work *work, double slack)
{
    work->slack = slack;
    fill_candidates(work);
    bool covered = true, moved = false;
    for (int half = 0; half < 2 && covered; half++) {
        const qm_vec *c = work->piece.corner;
        qm_polygon polygon = {.count = 3, .corner = {c[0], c[1 + half], c[2 + half]}};
        reach_corners(work, &polygon);
        covered = cover(work, &polygon, &moved);
    }
    work->slack = 0.0;
    fill_candidates(work);
    return covered;
}

/** Cuts a rectangle across its longer side. */
static void split_rectangle(piece_work *work, const qm_patch *patch)
{
    const qm_vec *c = work->piece.corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    int axis = along_s >= along_t ? 0 : 1;
    double middle = 0.5 * (work->piece.low[axis] + work->piece.high[axis]);
    for (int half = 0; half < 2; half++) {
        qm_piece child = work->piece;
        child.depth = (uint8_t)(child.depth < UINT8_MAX ? child.depth + 1 : UINT8_MAX);
        *(half == 0 ? &child.high[axis] : &child.low[axis]) = middle;
        child.corner[0] = qm_patch_at(patch, child.low[0], child.low[1]);
        child.corner[1] = qm_patch_at(patch, child.high[0], child.low[1]);
        child.corner[2] = qm_patch_at(patch, child.high[0], child.high[1]);
        child.corner[3] = qm_patch_at(patch, child.low[0], child.high[1]);
        push_piece(work, &child);
    }
}

static void process_rectangle(piece_work *work)
{
    qm_polygon corners;
    qm_worker_discard(work->worker, qm_search_allowed(work->search));
    if (hull_reached(work, &corners)) return;
    qm_patch patch = source_patch(work);
    const qm_piece *piece = &work->piece;
    double share = (piece->high[0] - piece->low[0]) * (piece->high[1] - piece->low[1]);
    double slack = 0.25 * share * qm_vec_norm(patch.w) * (1.0 + 0x1p-20);
    if (slack <= SLACK_SHARE * work->search->tolerance * work->side->scale) {
        work->slack = slack;
        fill_candidates(work);
        keep_triangle(work, &piece->corner[0], &piece->corner[1], &piece->corner[2]);
        keep_triangle(work, &piece->corner[0], &piece->corner[2], &piece->corner[3]);
        process_stack(work);
        return;
    }
    if (slack < local_allowed(work) && triangles_reached(work, slack)) return;
    sample_corners(work, &corners, STRICT_DEPTH);
    split_rectangle(work, &patch);
}

void qm_worker_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    piece_work work;
    work.worker = worker;
    work.search = worker->search;
    work.side = &worker->search->side[entry.side];
    work.kernel = worker->search->kernel;
    work.entry = entry;
    work.piece = *piece;
    work.slack = piece->slack;
    work.generation = 1;
    work.height = 0;
    gather_candidates(&work);
    if (piece->corner_count == 4) {
        process_rectangle(&work);
        return;
    }
    keep_triangle(&work, &piece->corner[0], &piece->corner[1], &piece->corner[2]);
    process_stack(&work);
}
