/**
 * hausdorff_near.c: faces that lie far below the lower bound are settled by few searches, however many facets
 * of the target they lie over: by the ball round the middle, else by those of smaller parts.
 *
 * Parts. Let all corners c of a face lie within r of its middle m. Cut at the middles of its edges, a
 * triangle falls into one part at each corner and one between them, a patch, which is cut at m too, into one
 * at each corner. The part at c has c, middles (c + c')/2 and, of a patch, m for its corners; seen from (c +
 * m)/2 they are (c - m)/2, (c' - m)/2 and (m - c)/2 away. The part between has the corners (c + c')/2 = (3 m
 * - c")/2, which from m are (m - c")/2 away. So each part lies within r/2 of its point, which is the middle
 * of a triangle's part: those may be cut again.
 *
 * Roundings, in u R (see rounding.h). m is off by 5 at most, for its products and sums; r by 5 for that and 8
 * for the difference and the norm. A part's point is off by 2.5 for qm_vec_mix and half of what was given to
 * it, so by 5 at most, too. With half of r's and 1 for what is left of the allowed distance that is less than
 * 13. A part's corners are off by 2.5 a level, or by 5 for m. A face that comes here has not been cut, and
 * eta has room for QM_FREE_CUTS cuts of 2.5.
 */
#include "hausdorff_search.h"

#define TRIANGLE_LEVELS 3 /* of parts in parts */
#define PATCH_LEVELS 1
#define MAX_RADIUS 1.25   /* of the allowed distance: one lane seldom reaches all of a larger part */
#define MIN_RADIUS 0.5    /* of it: what a smaller part misses its own parts seldom find */
#define MAX_SEARCHES 10   /* for each face that parts settle, on average: a cover costs about as much */
#define FIRST_FACES 16    /* that may fail before that counts */
#define PARTS_INTERVAL 32 /* faces between two tries of parts where they cost more */
#define NEAR_SHARE 0.5 /* of the allowed distance: where the target is farther, smaller balls gain little */

/** A face of the source or a part of it, within the radius of its middle. */
typedef struct ball_part {
    int corner_count;
    qm_vec corner[4], middle;
    double radius;
} ball_part;

/** Where faces are tried, and how near the target must be, local. */
typedef struct near_work {
    qm_worker *worker;
    const qm_side *side;
    double allowed;
    uint32_t *hint;
    int *searches;
} near_work;

static bool lane_reaches(const near_work *work, const ball_part *part)
{
    qm_float_bits bits[4];
    unsigned labels = ~0u;
    work->worker->search->kernel->float_reach(qm_bvh_floats(work->side->target, *work->hint),
                                              qm_side_twists(work->side, *work->hint), work->allowed,
                                              part->corner, part->corner_count, bits);
    for (int i = 0; i < part->corner_count; i++)
        labels &= bits[i];
    return qm_float_certain(labels) != 0;
}

static bool parts_are_near(const near_work *work, const ball_part *whole, int levels);

/** By the part's own ball, by a lane of the pack that is found in its middle, or by its parts. */
static bool part_is_near(const near_work *work, const ball_part *part, int levels)
{
    if (part->radius <= MAX_RADIUS * work->allowed) {
        double enough = work->allowed - part->radius, sought = fmax(enough, NEAR_SHARE * work->allowed);
        work->worker->projections++;
        ++*work->searches;
        double distance =
            qm_side_nearly(work->worker->search, work->side, part->middle, sought, enough, work->hint);
        if (distance <= enough || lane_reaches(work, part)) return true;
        if (distance > NEAR_SHARE * work->allowed) return false;
    }
    bool may_gain = levels > 0 && part->radius > MIN_RADIUS * work->allowed;
    return may_gain && parts_are_near(work, part, levels - 1);
}

static bool parts_are_near(const near_work *work, const ball_part *whole, int levels)
{
    int count = whole->corner_count;
    ball_part part = {.corner_count = count, .middle = whole->middle, .radius = 0.5 * whole->radius};
    qm_vec between[4];
    for (int i = 0; i < count; i++)
        part.corner[i] = between[i] =
            qm_vec_mix(whole->corner[i], whole->corner[i + 1 < count ? i + 1 : 0], 0.5);
    if (count == 3 && !part_is_near(work, &part, levels)) return false;
    for (int i = 0; i < count; i++) {
        part.middle = qm_vec_mix(whole->middle, whole->corner[i], 0.5);
        part.corner[0] = whole->corner[i];
        part.corner[1] = between[i];
        part.corner[2] = whole->middle;
        part.corner[count - 1] = between[i > 0 ? i - 1 : count - 1];
        if (!part_is_near(work, &part, levels)) return false;
    }
    return true;
}

/** Where surfaces nearly coincide parts cost dozens of searches a face, and covers are cheaper. */
static bool may_try_parts(qm_worker *worker)
{
    bool is_due = worker->part_tries++ % PARTS_INTERVAL == 0;
    return is_due || worker->part_searches <= MAX_SEARCHES * (worker->part_hits + FIRST_FACES);
}

bool qm_worker_face_is_near(qm_worker *worker, const qm_side *side, const qm_piece *face, uint32_t *hint)
{
    ball_part whole = {.corner_count = face->corner_count};
    for (int i = 0; i < face->corner_count; i++) {
        whole.corner[i] = face->corner[i];
        whole.middle = qm_vec_axpy(whole.middle, 1.0 / face->corner_count, face->corner[i]);
    }
    double radius2 = 0.0;
    for (int i = 0; i < face->corner_count; i++)
        radius2 = fmax(radius2, qm_vec_norm2(qm_vec_sub(face->corner[i], whole.middle)));
    whole.radius = sqrt(radius2);
    int searches = 0;
    const near_work work = {worker, side, qm_search_allowed(worker->search) * side->scale, hint, &searches};
    int levels = !may_try_parts(worker) ? 0 : whole.corner_count == 3 ? TRIANGLE_LEVELS : PATCH_LEVELS;
    bool is_small = whole.radius <= (1 << levels) * MAX_RADIUS * work.allowed;
    bool is_near = is_small && part_is_near(&work, &whole, levels);
    if (searches > 1) {
        worker->part_searches += (uint64_t)searches;
        worker->part_hits += is_near;
    }
    return is_near;
}
