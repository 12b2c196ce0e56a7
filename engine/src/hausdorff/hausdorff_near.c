/**
 * hausdorff_near.c: faces whose size is about that of the lower bound are discarded after few searches,
 * however many facets of the target they are over: a face is cut into parts, each of which one facet must
 * reach.
 *
 * The distance to a convex facet is convex. So a facet within the cutoff of a part's corners is within the
 * cutoff of all of the part. Parts share corners, and these are compared with all facets of a pack at once:
 * first with packs that were near recent faces, and where those leave a part open, with the pack that a
 * search from its centroid finds. A part that is still open may be in a ball round its centroid that is
 * within the cutoff; else it is cut again.
 *
 * Parts. A triangle is cut into triangles with corners at the parameters (i, j) / n, i + j <= n, a patch into
 * patches with corners at those of i, j <= n. A part is in the hull of its corners.
 *
 * Roundings, in u R (see rounding.h). The weights of a face's corners are multiples of 1/16, exact; so a
 * part's corner is a sum of at most four products, which are off by 1 together, and each of the three sums by
 * 1. A face is cut MAX_CUTS times at most, one after the other: its corners are then off by 12. The radius of
 * the ball that holds the corners, round the centroid as computed, is off by 8 for the differences and the
 * norm, and the cutoff less the radius by 1. A face that comes here has not been cut, and eta has
 * room for QM_FREE_CUTS cuts of 2.5.
 */
#include <string.h>

#include "hausdorff_sample.h"

#define TRIANGLE_LEVELS 3 /* how often the edges of a face are halved, */
#define PATCH_LEVELS 1
#define LEVELS_AT_ONCE 2  /* of these in one cut */
#define MAX_CUTS 3        /* of parts of parts */
#define MAX_RADIUS 1.25   /* of the cutoff: one facet seldom reaches all of a larger part */
#define MIN_RADIUS 0.5    /* of it: the parts of a smaller part seldom succeed where it fails */
#define NEAR_SHARE 0.5    /* of it: where the target is farther, smaller parts gain little */
#define RECENT_TRIES 2    /* recent packs that parts are compared with before a search */
#define TRIED_PACKS 8     /* remembered, not to be tried again */
#define COST_OF_SEARCH 40 /* in points compared with a pack */
#define COST_OF_PACK 4
#define MAX_COST 600   /* for each face that parts discard, on average: a cover costs about as much */
#define FIRST_FACES 16 /* that may fail before MAX_COST applies */
/* Faces between two tries of parts where they cost more than covers: some dozens of searches for one face
 * in 32 are about one for each, and still show when parts begin to pay. */
#define PARTS_INTERVAL 32

enum { MAX_PARTS = 16, MAX_PART_CORNERS = 15 }; /* of one cut, */
enum { MAX_POINTS = 3 * QM_PACK_LANES };        /* or those of a pack */

_Static_assert(TRIANGLE_LEVELS <= MAX_CUTS && LEVELS_AT_ONCE <= 2 && PATCH_LEVELS <= 1, "there is room");

/** Parts of a face, or faces of a pack. */
typedef struct part_list {
    const qm_vec *point;
    int count;
    uint8_t corner[MAX_PARTS][4]; /* indices of points; a triangle's last one twice */
    unsigned open;                /* a bit a part: not shown to be within the cutoff */
    unsigned tried_count;
    uint32_t tried[TRIED_PACKS]; /* packs that all open parts have been compared with */
} part_list;

/** The state of one call. */
typedef struct near_work {
    qm_worker *worker;
    const qm_side *side;
    double cutoff; /* local */
    uint32_t hint; /* where the next search starts */
    unsigned cost;
} near_work;

/** The point of a face at the parameters (x, y). */
static qm_vec face_point(const qm_vec *corner, int count, double x, double y)
{
    if (count == 3) {
        qm_vec along = qm_vec_axpy(qm_vec_scale(1.0 - x - y, corner[0]), x, corner[1]);
        return qm_vec_axpy(along, y, corner[2]);
    }
    qm_vec low = qm_vec_axpy(qm_vec_scale((1.0 - x) * (1.0 - y), corner[0]), x * (1.0 - y), corner[1]);
    return qm_vec_axpy(qm_vec_axpy(low, x * y, corner[2]), (1.0 - x) * y, corner[3]);
}

static void add_part(part_list *parts, int a, int b, int c, int d)
{
    QM_ASSERT(parts->count < MAX_PARTS);
    uint8_t *corner = parts->corner[parts->count++];
    corner[0] = (uint8_t)a;
    corner[1] = (uint8_t)b;
    corner[2] = (uint8_t)c;
    corner[3] = (uint8_t)d;
}

/** Cuts a face into parts, whose corners go to point. */
static void cut_face(const qm_vec *corner, int count, int level, qm_vec point[MAX_PART_CORNERS],
                     part_list *parts)
{
    QM_ASSERT(count == 3 || count == 4);
    QM_ASSERT(level >= 0 && level <= LEVELS_AT_ONCE);
    int n = 1 << level, row = 0;
    parts->point = point;
    parts->count = 0;
    parts->tried_count = 0;
    for (int j = 0; j <= n; j++) {
        int length = count == 3 ? n - j : n, next = row + length + 1;
        for (int i = 0; i <= length; i++)
            point[row + i] = face_point(corner, count, (double)i / n, (double)j / n);
        for (int i = 0; i < length && j < n; i++) {
            if (count == 4) {
                add_part(parts, row + i, row + i + 1, next + i + 1, next + i);
                continue;
            }
            add_part(parts, row + i, row + i + 1, next + i, next + i);
            if (i + 1 < length) add_part(parts, row + i + 1, next + i + 1, next + i, next + i);
        }
        row = next;
    }
    QM_ASSERT(row <= MAX_PART_CORNERS);
    parts->open = (1u << parts->count) - 1;
}

/** Corners of a part; returns how many. */
static int part_corners(const part_list *parts, int part, qm_vec corner[4])
{
    const uint8_t *index = parts->corner[part];
    int count = index[2] == index[3] ? 3 : 4;
    for (int i = 0; i < count; i++)
        corner[i] = parts->point[index[i]];
    return count;
}

/** Closes the open parts that one facet of a pack reaches. */
static void try_pack(near_work *work, part_list *parts, uint32_t pack)
{
    unsigned known = parts->tried_count < TRIED_PACKS ? parts->tried_count : TRIED_PACKS, corners = 0;
    for (unsigned i = 0; i < known; i++)
        if (parts->tried[i] == pack) return;
    for (unsigned left = parts->open; left; left &= left - 1)
        for (int i = 0; i < 4; i++)
            corners |= 1u << parts->corner[__builtin_ctz(left)][i];
    qm_float_bits bits[MAX_POINTS];
    work->cost += COST_OF_PACK + (unsigned)__builtin_popcount(corners);
    work->worker->search->kernel->float_reach(qm_bvh_float_pack(work->side->target, pack),
                                              qm_side_twists(work->side, pack), work->cutoff, parts->point,
                                              corners, bits);
    for (unsigned left = parts->open; left; left &= left - 1) {
        const uint8_t *corner = parts->corner[__builtin_ctz(left)];
        unsigned labels = bits[corner[0]] & bits[corner[1]] & bits[corner[2]] & bits[corner[3]];
        if (qm_float_certain(labels)) parts->open &= ~(left & -left);
    }
    parts->tried[parts->tried_count++ % TRIED_PACKS] = pack;
}

/** Puts a pack among the recent ones, in place of the oldest. */
static void remember(qm_worker *worker, const qm_side *side, uint32_t pack)
{
    qm_near_packs *recent = &worker->recent;
    if (worker->recent_side != side) recent->count = 0;
    worker->recent_side = side;
    for (int i = 0; i < recent->count; i++)
        if (recent->pack[i] == pack) return;
    unsigned slot = worker->recent_next++ % QM_RECENT_PACKS;
    if (recent->count < QM_RECENT_PACKS) slot = (unsigned)recent->count++;
    const qm_box_node *from = &side->target->boxes.groups[1][pack / 8];
    recent->pack[slot] = pack;
    for (int k = 0; k < 3; k++) {
        recent->box[0].low[k][slot] = from->low[k][pack % 8];
        recent->box[0].high[k][slot] = from->high[k][pack % 8];
    }
}

/** Closes the open parts that recent packs near some points reach. */
static void try_recent(near_work *work, part_list *parts, const qm_vec *point, int count)
{
    uint32_t packs[RECENT_TRIES];
    qm_box box = qm_vec_box(point, count);
    int found =
        work->worker->search->kernel->narrow(&work->worker->recent, &box, work->cutoff, RECENT_TRIES, packs);
    for (int k = 0; k < found && parts->open; k++)
        try_pack(work, parts, packs[k]);
    if (found > 0) work->hint = packs[0];
}

static bool parts_are_near(near_work *work, const qm_vec *corner, int count, int level, int deeper);

/** Searches from the centroid of the first open part, and closes that and all others that the pack found
 * reaches; false when the first stays open. */
static bool close_part(near_work *work, part_list *parts, int deeper)
{
    qm_worker *worker = work->worker;
    unsigned bit = parts->open & -parts->open;
    qm_vec corner[4];
    int count = part_corners(parts, __builtin_ctz(bit), corner);
    qm_vec centroid = qm_vec_centroid(corner, count);
    double radius = qm_vec_radius(corner, count, centroid);
    double enough = work->cutoff - radius, sought = fmax(enough, NEAR_SHARE * work->cutoff);
    worker->projections++;
    work->cost += COST_OF_SEARCH;
    double distance =
        qm_sample_upper(worker->search->kernel, work->side, centroid, sought, enough, &work->hint);
    remember(worker, work->side, work->hint);
    if (distance <= enough) parts->open &= ~bit;
    try_pack(work, parts, work->hint);
    if (!(parts->open & bit)) return true;
    bool may_gain = deeper > 0 && distance <= NEAR_SHARE * work->cutoff && radius > MIN_RADIUS * work->cutoff;
    if (!may_gain || !parts_are_near(work, corner, count, 1, deeper - 1)) return false;
    parts->open &= ~bit;
    return true;
}

/** Cuts a face or part, and its parts that are not near again, down to some levels deeper. True when all
 * parts are within the cutoff. */
static bool parts_are_near(near_work *work, const qm_vec *corner, int count, int level, int deeper)
{
    part_list parts;
    qm_vec point[MAX_PART_CORNERS];
    cut_face(corner, count, level, point, &parts);
    try_recent(work, &parts, corner, count);
    while (parts.open)
        if (!close_part(work, &parts, deeper)) return false;
    return true;
}

/** How often the edges of a face must be halved for parts that are small enough. */
static int level_of(const near_work *work, const qm_vec *corner, int count)
{
    double radius = qm_vec_radius(corner, count, qm_vec_centroid(corner, count));
    int level = 0;
    for (; level <= TRIANGLE_LEVELS && radius > MAX_RADIUS * work->cutoff; radius *= 0.5)
        level++;
    return level;
}

/** True when the parts of a face that is too large to be tried whole are near. */
static bool face_is_near(near_work *work, const qm_vec *corner, int count, int level)
{
    qm_worker *worker = work->worker;
    int max_level = count == 3 ? TRIANGLE_LEVELS : PATCH_LEVELS;
    if (level > max_level) return false;
    /* Where surfaces nearly coincide, parts cost more than covers: dozens of searches a face. */
    bool is_due = worker->part_tries++ % PARTS_INTERVAL == 0;
    if (!is_due && worker->part_cost > MAX_COST * (worker->part_hits + FIRST_FACES)) return false;
    if (level > LEVELS_AT_ONCE) level = LEVELS_AT_ONCE;
    work->cost = 0;
    bool is_near = parts_are_near(work, corner, count, level, max_level - level);
    worker->part_cost += work->cost;
    worker->part_hits += is_near;
    return is_near;
}

unsigned qm_near_test_faces(qm_worker *worker, const qm_side *side, const qm_near_faces *faces, uint32_t hint)
{
    QM_ASSERT(worker && side && faces);
    QM_ASSERT(faces->count >= 0 && faces->count <= QM_PACK_LANES);
    QM_ASSERT(faces->vertex_count <= MAX_POINTS);
    QM_ASSERT(hint < side->target->pack_count);
    near_work work = {worker, side, qm_search_cutoff(worker->search) * side->scale, hint, 0};
    part_list whole = {.point = faces->vertex, .count = faces->count, .tried_count = 1, .tried = {hint}};
    memcpy(whole.corner, faces->corner, sizeof faces->corner);
    remember(worker, side, hint);
    unsigned near = 0;
    for (int i = 0; i < faces->count; i++) {
        qm_vec corner[4];
        int count = part_corners(&whole, i, corner), level = level_of(&work, corner, count);
        if (level == 0)
            whole.open |= 1u << i;
        else if (face_is_near(&work, corner, count, level))
            near |= 1u << i;
    }
    work.hint = hint;
    near |= whole.open;
    if (whole.open) try_recent(&work, &whole, faces->vertex, faces->vertex_count);
    while (whole.open) {
        unsigned bit = whole.open & -whole.open;
        if (close_part(&work, &whole, 1)) continue;
        near &= ~bit;
        whole.open &= ~bit;
    }
    return near;
}
