/**
 * hausdorff_piece.c: the lower stage. A part of a face is covered by convex sets round facets of the target,
 * or what is left of it is split and goes back to the queue.
 *
 * Termination: every corner of a piece that goes back is within lower + tolerance / 2 of a candidate or was
 * measured, which raised the lower bound to it; so a piece of a diameter below half the tolerance is covered
 * by the nearest facet of any corner. Cuts never make a diameter larger, and from MIDPOINT_DEPTH on every
 * second level halves it.
 */
#include "bilinear_point.h"
#include "hausdorff_search.h"

#define MIDPOINT_DEPTH 40
#define REFINED_PATCHES 4  /* of the target, with labels cut to the piece */
#define REFINED_MARGIN 0.1 /* by which these labels reach beyond the feet of the piece's corners */
#define MAX_ATTEMPTS 4     /* covers of one piece, each with candidates that the last one's corners brought */
#define SLACK_SHARE 0.125  /* of the tolerance: a patch this flat goes on as triangles */

/** A piece on its way. */
typedef struct piece_work {
    qm_worker *worker;
    const qm_side *side;
    qm_entry entry;
    qm_piece *piece;
    qm_candidates candidates;
    qm_pack refined; /* labels cut out of patches of the target */
} piece_work;

/* ---- candidates ---- */

/** Puts a pack in front of the piece's candidates. False when it is there already. */
static bool add_candidate(qm_piece *piece, uint32_t pack)
{
    for (int k = 0; k < piece->pack_count; k++)
        if (piece->pack[k] == pack) return false;
    if (piece->pack_count < QM_COVER_PACKS) piece->pack_count++;
    for (int k = piece->pack_count - 1; k > 0; k--)
        piece->pack[k] = piece->pack[k - 1];
    piece->pack[0] = pack;
    return true;
}

static double local_allowed(const piece_work *work)
{
    return qm_search_allowed(work->worker->search) * work->side->scale;
}

static void fill_candidates(piece_work *work, double slack)
{
    qm_candidates_fill(&work->candidates, work->side, work->piece->pack, work->piece->pack_count,
                       local_allowed(work) - slack);
}

/** Faces of the nearest candidates as seen from a point, each once, patches that are not flat only. */
static int nearest_patches(const piece_work *work, qm_vec p, uint32_t face[REFINED_PATCHES])
{
    double distance[REFINED_PATCHES];
    int count = 0;
    for (int k = 0; k < work->piece->pack_count; k++) {
        const qm_pack_lanes *lanes = &work->side->target->lanes[work->piece->pack[k]];
        double d2[QM_PACK_LANES];
        work->worker->search->kernel->pack_distances(work->candidates.pack[k], p, d2);
        for (int lane = 0; lane < lanes->lane_count; lane++) {
            if (!(work->candidates.twist[k][lane] > 0.0)) continue;
            int place = 0;
            while (place < count && face[place] != lanes->face[lane])
                place++;
            bool known = place < count;
            if (known && distance[place] <= d2[lane]) continue;
            if (!known && count == REFINED_PATCHES && distance[count - 1] <= d2[lane]) continue;
            if (!known) place = count < REFINED_PATCHES ? count++ : count - 1;
            for (; place > 0 && distance[place - 1] > d2[lane]; place--) {
                distance[place] = distance[place - 1];
                face[place] = face[place - 1];
            }
            distance[place] = d2[lane];
            face[place] = lanes->face[lane];
        }
    }
    return count;
}

/** The parameters of a patch that lie under the corners of the piece, with a margin. */
static void feet_rectangle(const qm_patch *patch, const qm_piece *piece, double low[2], double high[2])
{
    low[0] = low[1] = 1.0;
    high[0] = high[1] = 0.0;
    for (int i = 0; i < piece->corner_count; i++) {
        qm_patch_foot foot = qm_patch_descend(patch, piece->corner[i]);
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

/** Writes the two triangles of a part of a patch as labels; the part leaves them by a ds dt share of the
 * twist. */
static void set_refined_lanes(piece_work *work, int place, int lane, const qm_patch *patch,
                              const double low[2], const double high[2], double allowed)
{
    qm_vec a = qm_patch_at(patch, low[0], low[1]), b = qm_patch_at(patch, high[0], low[1]);
    qm_vec c = qm_patch_at(patch, high[0], high[1]), d = qm_patch_at(patch, low[0], high[1]);
    qm_pack_set_lane(&work->refined, lane, a, b, c);
    qm_pack_set_lane(&work->refined, lane + 1, a, c, d);
    double share = (high[0] - low[0]) * (high[1] - low[1]);
    double twist = 0.25 * share * qm_vec_norm(patch->w) * (1.0 + 0x1p-20), rest = allowed - twist;
    for (int i = lane; i < lane + 2; i++) {
        work->candidates.twist[place][i] = twist;
        work->candidates.allowed2[place][i] = rest >= 0.0 ? rest * rest : -1.0;
    }
}

/**
 * Labels of the target's patches lose their twist of the allowed distance. Where that is too much, parts of
 * the nearest patches just under the piece lose only their share, which falls with the square of the piece's
 * size. The refined labels take the last place of the candidates. False when there is no twist to win back.
 */
static bool refine_candidates(piece_work *work, double slack)
{
    const qm_piece *piece = work->piece;
    uint32_t face[REFINED_PATCHES];
    qm_vec middle =
        qm_vec_scale(1.0 / 3.0, qm_vec_add(qm_vec_add(piece->corner[0], piece->corner[1]), piece->corner[2]));
    int count = work->side->target_patches ? nearest_patches(work, middle, face) : 0;
    if (count == 0) return false;
    qm_candidates *candidates = &work->candidates;
    int place = candidates->count < QM_COVER_PACKS ? candidates->count++ : QM_COVER_PACKS - 1;
    candidates->pack[place] = &work->refined;
    for (int i = 0; i < REFINED_PATCHES; i++) {
        qm_vec corner[4];
        double low[2], high[2];
        qm_bvh_load_face(work->side->target, face[i < count ? i : 0], corner);
        qm_patch patch = qm_patch_make(corner);
        feet_rectangle(&patch, piece, low, high);
        set_refined_lanes(work, place, 2 * i, &patch, low, high, local_allowed(work) - slack);
    }
    return true;
}

/* ---- covering and splitting ---- */

static void reach_corners(const piece_work *work, qm_polygon *polygon)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] =
            work->worker->search->kernel->in_reach(&work->candidates, polygon->corner[i], NULL);
}

static bool cover(const piece_work *work, qm_polygon *polygon, bool *moved)
{
    bool cut = false;
    reach_corners(work, polygon);
    bool covered = work->worker->search->kernel->cover(&work->candidates, polygon, &cut);
    *moved |= cut;
    return covered;
}

/** Covers a polygon by the piece's candidates, then, when that is not enough, by refined ones too. */
static bool cover_refined(piece_work *work, qm_polygon *polygon, double slack, bool *moved)
{
    fill_candidates(work, slack);
    return cover(work, polygon, moved) || (refine_candidates(work, slack) && cover(work, polygon, moved));
}

/** Measures the corners that no candidate brings near enough. True when that found a new candidate. */
static bool sample_corners(piece_work *work, const qm_vec *corner, int count, double slack)
{
    const qm_search *search = work->worker->search;
    bool found = false;
    for (int i = 0; i < count; i++) {
        qm_lane_rows rows;
        int nearest;
        search->kernel->in_reach(&work->candidates, corner[i], rows.d2);
        double upper = qm_candidates_point_upper(&work->candidates, &rows, &nearest) + slack;
        if (upper * work->side->inverse_scale <= qm_search_allowed(search) - 0.5 * search->tolerance)
            continue;
        uint32_t hint = work->piece->pack[nearest < work->piece->pack_count ? nearest : 0];
        qm_worker_sample(work->worker, work->side, corner[i], slack, work->piece->face, &hint);
        found |= add_candidate(work->piece, hint);
    }
    return found;
}

/** Bounds a child by its best single label, and queues it when that is not enough. */
static void push_child(piece_work *work, const qm_piece *child)
{
    const qm_search *search = work->worker->search;
    qm_lane_rows rows[4];
    const qm_lane_rows *row[4];
    for (int i = 0; i < child->corner_count; i++) {
        search->kernel->in_reach(&work->candidates, child->corner[i], rows[i].d2);
        row[i] = &rows[i];
    }
    double upper = qm_candidates_upper(&work->candidates, row, child->corner_count) + child->slack;
    qm_entry entry = work->entry;
    entry.upper = fmin(entry.upper, upper * work->side->inverse_scale);
    qm_worker_push(work->worker, entry, child);
}

static void push_triangle(piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    qm_piece child = *work->piece;
    child.corner[0] = a;
    child.corner[1] = b;
    child.corner[2] = c;
    child.depth = (uint8_t)(child.depth < UINT8_MAX ? child.depth + 1 : MIDPOINT_DEPTH);
    push_child(work, &child);
}

/** Queues a triangle in four, cut at the midpoints: each has half the diameter. */
static void push_quarters(piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    qm_vec ab = qm_vec_mix(a, b, 0.5), bc = qm_vec_mix(b, c, 0.5), ca = qm_vec_mix(c, a, 0.5);
    push_triangle(work, a, ab, ca);
    push_triangle(work, ab, b, bc);
    push_triangle(work, ca, bc, c);
    push_triangle(work, bc, ca, ab);
}

static void split_triangle(piece_work *work, const qm_polygon *rest, bool moved)
{
    bool halve = !moved || (work->piece->depth >= MIDPOINT_DEPTH && work->piece->depth % 2 == 0);
    for (int i = 1; i + 1 < rest->count; i++) {
        if (halve)
            push_quarters(work, rest->corner[0], rest->corner[i], rest->corner[i + 1]);
        else
            push_triangle(work, rest->corner[0], rest->corner[i], rest->corner[i + 1]);
    }
}

static qm_polygon triangle_polygon(qm_vec a, qm_vec b, qm_vec c)
{
    qm_polygon polygon;
    polygon.count = 3;
    polygon.corner[0] = a;
    polygon.corner[1] = b;
    polygon.corner[2] = c;
    return polygon;
}

static void process_triangle(piece_work *work)
{
    const qm_piece *piece = work->piece;
    qm_polygon rest = triangle_polygon(piece->corner[0], piece->corner[1], piece->corner[2]);
    bool moved = false;
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        bool covered = cover_refined(work, &rest, piece->slack, &moved);
        qm_worker_discard(work->worker, qm_search_allowed(work->worker->search));
        if (covered) return;
        if (!sample_corners(work, rest.corner, rest.count, piece->slack)) break;
    }
    split_triangle(work, &rest, moved);
}

/* ---- parameter rectangles of the source's patches ---- */

static qm_patch source_patch(const piece_work *work)
{
    const uint32_t *vertex = work->side->source->mesh->faces + 4 * (size_t)work->piece->face;
    qm_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = qm_side_vertex(work->side, vertex[i]);
    return qm_patch_make(corner);
}

/** One label for the hull of the four corners, which holds the part of the patch. */
static bool hull_reached(piece_work *work)
{
    uint64_t labels = ~UINT64_C(0);
    fill_candidates(work, 0.0);
    for (int i = 0; i < 4; i++)
        labels &= work->worker->search->kernel->in_reach(&work->candidates, work->piece->corner[i], NULL);
    return labels != 0;
}

static bool triangles_reached(piece_work *work, double slack)
{
    const qm_vec *c = work->piece->corner;
    qm_polygon first = triangle_polygon(c[0], c[1], c[2]), second = triangle_polygon(c[0], c[2], c[3]);
    bool moved = false;
    return cover_refined(work, &first, slack, &moved) && cover_refined(work, &second, slack, &moved);
}

/** Goes on with the two triangles of a rectangle that leaves them by no more than slack. */
static void push_flat(piece_work *work, double slack)
{
    qm_piece *piece = work->piece;
    const qm_vec c[4] = {piece->corner[0], piece->corner[1], piece->corner[2], piece->corner[3]};
    piece->corner_count = 3;
    piece->slack = slack;
    fill_candidates(work, slack);
    push_triangle(work, c[0], c[1], c[2]);
    push_triangle(work, c[0], c[2], c[3]);
}

/** Cuts a rectangle across its longer side. */
static void split_rectangle(piece_work *work, const qm_patch *patch)
{
    const qm_piece *piece = work->piece;
    const qm_vec *c = piece->corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    int axis = along_s >= along_t ? 0 : 1;
    double middle = 0.5 * (piece->low[axis] + piece->high[axis]);
    fill_candidates(work, 0.0);
    for (int half = 0; half < 2; half++) {
        qm_piece child = *piece;
        child.depth = (uint8_t)(child.depth < UINT8_MAX ? child.depth + 1 : UINT8_MAX);
        *(half == 0 ? &child.high[axis] : &child.low[axis]) = middle;
        child.corner[0] = qm_patch_at(patch, child.low[0], child.low[1]);
        child.corner[1] = qm_patch_at(patch, child.high[0], child.low[1]);
        child.corner[2] = qm_patch_at(patch, child.high[0], child.high[1]);
        child.corner[3] = qm_patch_at(patch, child.low[0], child.high[1]);
        push_child(work, &child);
    }
}

static void process_rectangle(piece_work *work)
{
    const qm_search *search = work->worker->search;
    const qm_piece *piece = work->piece;
    qm_worker_discard(work->worker, qm_search_allowed(search));
    if (hull_reached(work)) return;
    qm_patch patch = source_patch(work);
    double share = (piece->high[0] - piece->low[0]) * (piece->high[1] - piece->low[1]);
    double slack = 0.25 * share * qm_vec_norm(patch.w) * (1.0 + 0x1p-20);
    if (slack <= SLACK_SHARE * search->tolerance * work->side->scale) {
        push_flat(work, slack);
        return;
    }
    if (slack < local_allowed(work) && triangles_reached(work, slack)) return;
    fill_candidates(work, 0.0);
    sample_corners(work, piece->corner, 4, 0.0);
    split_rectangle(work, &patch);
}

void qm_worker_piece(qm_worker *worker, qm_entry entry, qm_piece *piece)
{
    piece_work work;
    work.worker = worker;
    work.side = &worker->search->side[entry.side];
    work.entry = entry;
    work.piece = piece;
    if (piece->corner_count == 3)
        process_triangle(&work);
    else
        process_rectangle(&work);
}
