#include "bilinear_pair.h"

#include "bilinear_part.h"

#define MOST_PAIRS 5000 /* of parts looked at before what is left is told as it is */

#define ERROR_STEP 0.0625 /* from one pass to the next */

/** Cuts until the question is answered. */
typedef struct search {
    const qm_bilinear_part *whole[2];
    double error, stop_above; /* parts proven to be as far are dropped */
    double enough;            /* a distance of at most this ends it */
    double tolerance;         /* parts this near to what is shared don't count */
    bool has_shared;
    int pairs;
    bool is_done, is_exhausted;
    qm_bilinear_gap gap;
} search;

static void offer(search *f, const qm_bilinear_part part[2], const qm_bilinear_part_gap *found)
{
    qm_bilinear_gap gap;
    for (int side = 0; side < 2; side++) {
        qm_bilinear_part_uv(&part[side], found->uv[side], gap.uv[side]);
        gap.point[side] = qm_bilinear_part_at(f->whole[side], gap.uv[side]);
    }
    gap.upper = qm_vec_distance(gap.point[0], gap.point[1]);
    if (!(gap.upper < f->gap.upper)) return;
    if (f->has_shared && qm_part_near_shared(f->whole, gap.point[0], f->tolerance)) return;
    gap.lower = f->gap.lower;
    f->gap = gap;
    f->is_done |= gap.upper <= f->enough;
}

/** Parts with a lower bound of at least this are of no more interest. */
static double limit(const search *f)
{
    return fmax(fmin(f->gap.upper, f->stop_above) - f->error, 0.0);
}

/** Keeps what a part that is not looked into further may still be. */
static void drop(search *f, double lower)
{
    f->gap.lower = fmin(f->gap.lower, lower);
}

typedef struct part_pair {
    qm_bilinear_part part[2];
    double lower;
} part_pair;

/** True when two parts need not be looked into: they are too far apart, or meet in what they share alone. */
static bool is_settled(search *f, part_pair *pair)
{
    const qm_bilinear_part *p = &pair->part[0], *q = &pair->part[1];
    if (f->has_shared && qm_part_parted(p, q)) return true;
    pair->lower = qm_bilinear_part_box_distance(p, q);
    if (pair->lower <= limit(f)) {
        qm_bilinear_part_gap found = qm_part_distance(p, q);
        pair->lower = fmax(found.distance - p->twist - q->twist - QM_BILINEAR_PART_ERROR, 0.0);
        offer(f, pair->part, &found);
    }
    if (pair->lower <= limit(f)) return false;
    drop(f, pair->lower);
    return true;
}

static bool is_small(const search *f, const part_pair *pair)
{
    return f->has_shared && qm_bilinear_part_size(&pair->part[0]) < f->tolerance &&
           qm_bilinear_part_size(&pair->part[1]) < f->tolerance &&
           qm_part_near_shared(f->whole, pair->part[0].corner[0], f->tolerance);
}

/** The part to cut: the more twisted one, or of flat ones the larger. */
static int choose_part(const part_pair *pair)
{
    const qm_bilinear_part *p = &pair->part[0], *q = &pair->part[1];
    if (p->twist != q->twist) return p->twist < q->twist;
    return qm_bilinear_part_size(p) < qm_bilinear_part_size(q);
}

static void cut(search *f, const part_pair *pair)
{
    if (is_small(f, pair)) return;
    if (f->pairs >= MOST_PAIRS) {
        f->is_exhausted = true;
        drop(f, pair->lower);
        return;
    }
    f->pairs += 4;
    int side = choose_part(pair);
    part_pair child[4];
    int order[4], count = 0;
    for (int i = 0; i < 4; i++) {
        child[i].part[1 - side] = pair->part[1 - side];
        child[i].part[side] = qm_bilinear_part_quarter(&pair->part[side], i);
        if (f->is_done || is_settled(f, &child[i])) continue;
        int place = count++;
        for (; place > 0 && child[order[place - 1]].lower > child[i].lower; place--)
            order[place] = order[place - 1];
        order[place] = i;
    }
    for (int i = 0; i < count && !f->is_done; i++) {
        if (child[order[i]].lower > limit(f))
            drop(f, child[order[i]].lower);
        else
            cut(f, &child[order[i]]);
    }
}

/** One pass over the faces: when it ends in time, no part nearer than the limit is left. */
static void pass(search *f, const qm_bilinear_part *a, const qm_bilinear_part *b)
{
    part_pair pair = {.part = {*a, *b}};
    f->gap.lower = INFINITY;
    f->pairs = 0;
    if (!is_settled(f, &pair) && !f->is_done) cut(f, &pair);
    if (f->is_done) f->gap.lower = 0.0;
    f->gap.lower = fmin(f->gap.lower, f->gap.upper);
}

static void start(search *f, const qm_bilinear_part *a, const qm_bilinear_part *b)
{
    f->whole[0] = a;
    f->whole[1] = b;
    f->gap = (qm_bilinear_gap){.lower = INFINITY, .upper = INFINITY};
}

/** Passes of ever smaller errors: a plateau of equal distances takes no more time than there is, and leaves
 * the bounds of the last pass that ended. */
qm_bilinear_gap qm_bilinear_pair_distance(const qm_face_shape *a, const qm_face_shape *b, double error,
                                          double stop_above)
{
    qm_bilinear_part part_a = qm_bilinear_part_make(a), part_b = qm_bilinear_part_make(b);
    search f = {.stop_above = stop_above, .enough = error};
    start(&f, &part_a, &part_b);
    double lower = 0.0;
    f.error = fmax(part_a.twist + part_b.twist, error);
    for (;;) {
        pass(&f, &part_a, &part_b);
        lower = fmax(lower, f.gap.lower);
        bool is_beyond = lower >= stop_above;
        if (f.is_done || f.is_exhausted || is_beyond || f.error <= error) break;
        f.error = fmax(f.error * ERROR_STEP, error);
    }
    f.gap.lower = lower;
    return f.gap;
}

/** Dropped parts are apart; parts left over when it took too long count as meeting. */
static bool decide(search *f, const qm_bilinear_part *a, const qm_bilinear_part *b, qm_bilinear_gap *gap)
{
    f->error = f->stop_above = 0.0;
    f->enough = f->tolerance;
    start(f, a, b);
    pass(f, a, b);
    *gap = f->gap;
    bool meets = f->is_done || gap->lower <= 0.0;
    if (meets && gap->upper == INFINITY) {
        /* It took too long and nothing was found off what is shared: any near points tell the place. */
        const qm_bilinear_part part[2] = {*a, *b};
        qm_bilinear_part_gap nearest = qm_part_distance(a, b);
        f->has_shared = false;
        offer(f, part, &nearest);
        *gap = f->gap;
    }
    return meets;
}

bool qm_bilinear_pair_meet(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                           qm_bilinear_gap *gap)
{
    qm_bilinear_part part_a = qm_bilinear_part_make(a), part_b = qm_bilinear_part_make(b);
    search f = {.tolerance = tolerance};
    return decide(&f, &part_a, &part_b, gap);
}

bool qm_bilinear_pair_cross(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                            qm_bilinear_gap *gap)
{
    qm_bilinear_part part_a = qm_bilinear_part_make(a), part_b = qm_bilinear_part_make(b);
    search f = {.tolerance = tolerance};
    f.has_shared = qm_bilinear_part_share(a, b, &part_a, &part_b) > 0;
    return decide(&f, &part_a, &part_b, gap);
}
