#include "deviation_bound.h"

#include "deviation_integral.h"

#define SQUARE_ROUNDINGS 0x1p-49 /* relative: of a difference of squares, 16 u */
#define MOST_OUTSIDE 0.5         /* share of a piece beside the ground: with more its height tells little */
#define NEAR_GROUND 4.0       /* radii: pieces farther from the target are bounded by their corners better */
#define LEAST_LENGTH 0x1p-400 /* of a vector that can be made one of length 1: its square is no subnormal */

/** A piece on its way to its bounds. */
typedef struct bound_work {
    const qm_piece_maker *maker;
    const qm_piece_shape *shape;
    const qm_near_facets *near;
    double at_middle, certain; /* distance of the middle, from above and below */
    double ball;               /* no facet farther than this from the middle is nearest to any point */
    double low[3], low_sum, high[3], high_sum;
    double cap[3]; /* the least distance to a facet at each corner, from above and below */
    double floor[3];
    int ground; /* place of the facet nearest to the middle */
    qm_triangle ground_facet;
} bound_work;

/** The lower function by planes on one side of the surface. */
typedef struct plane_work {
    double cap[3];   /* what the function is at most */
    double facet[3]; /* the least of the facets' planes at each corner; cap, to begin with */
    qm_vec up;       /* the normal of the ground, towards the middle */
} plane_work;

/* ---- offers ---- */

static void offer_high(bound_work *work, const double high[3])
{
    double sum = high[0] + high[1] + high[2];
    if (!(sum < work->high_sum)) return;
    work->high_sum = sum;
    for (int i = 0; i < 3; i++)
        work->high[i] = high[i];
}

static void offer_low(bound_work *work, const double low[3])
{
    double sum = low[0] + low[1] + low[2];
    if (!(sum > work->low_sum)) return;
    work->low_sum = sum;
    for (int i = 0; i < 3; i++)
        work->low[i] = low[i];
}

/* ---- distances to the list ---- */

/** Distances of the middle from all facets of the list. */
static void measure_middle(bound_work *work, double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    const qm_near_facets *near = work->near;
    work->at_middle = work->certain = INFINITY;
    for (int pack = 0; pack < near->pack_count; pack++) {
        work->maker->kernel->pack_distances(&near->pack[pack], work->shape->middle, distance[pack]);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            double here = sqrt(distance[pack][lane]), slack = near->slack[pack][lane];
            if (here + slack < work->at_middle) {
                work->at_middle = here + slack;
                work->ground = pack * QM_PACK_LANES + lane;
            }
            work->certain = qm_lesser(work->certain, here - slack);
            distance[pack][lane] = here - slack;
        }
    }
}

/** Upper bounds by the facets of a pack, and the corners' own distances. */
static void offer_pack(bound_work *work, int pack)
{
    const qm_near_facets *near = work->near;
    _Alignas(64) double d[3][QM_PACK_LANES];
    for (int i = 0; i < 3; i++) {
        work->maker->kernel->pack_distances(&near->pack[pack], work->shape->corner[i], d[i]);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            double here = sqrt(d[i][lane]), slack = near->slack[pack][lane];
            work->floor[i] = qm_lesser(work->floor[i], here - slack);
            d[i][lane] = here + slack;
            work->cap[i] = qm_lesser(work->cap[i], d[i][lane]);
        }
    }
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const double high[3] = {d[0][lane], d[1][lane], d[2][lane]};
        offer_high(work, high);
    }
}

static bool has_any_within(const double distance[QM_PACK_LANES], double reach)
{
    bool any = false;
    for (int lane = 0; lane < QM_PACK_LANES; lane++)
        any |= distance[lane] <= reach;
    return any;
}

/* ---- planes ---- */

static qm_vec turn_up(qm_vec normal, double side)
{
    return side < 0.0 ? qm_vec_scale(-1.0, normal) : normal;
}

/** Heights of the corners over the plane of a facet, seen from above. */
static void heights_over_facet(const bound_work *work, const qm_triangle *facet, qm_vec up, double height[3])
{
    for (int i = 0; i < 3; i++)
        height[i] = qm_vec_dot(up, qm_vec_sub(work->shape->corner[i], facet->origin));
}

/** Heights of the corners over the plane at a right angle to a direction that the facet lies behind. */
static void heights_along(const bound_work *work, const qm_triangle *facet, qm_vec direction,
                          double height[3])
{
    double second = facet->length * qm_vec_dot(direction, facet->x);
    double third = facet->cx * qm_vec_dot(direction, facet->x) + facet->cy * qm_vec_dot(direction, facet->y);
    double farthest = qm_greater(0.0, qm_greater(second, third));
    for (int i = 0; i < 3; i++)
        height[i] = qm_vec_dot(direction, qm_vec_sub(work->shape->corner[i], facet->origin)) - farthest;
}

/** Heights of the corners over the plane that the facet lies behind as seen from a point. */
static void heights_from(const bound_work *work, const qm_triangle *facet, qm_vec from, qm_vec up,
                         double height[3])
{
    double weight[3];
    qm_triangle_footpoint(facet, from, weight);
    /* Over the facet itself it is the plane of the facet, whose normal is exact however near the point is. */
    if (weight[0] > 0.0 && weight[1] > 0.0 && weight[2] > 0.0) {
        heights_over_facet(work, facet, up, height);
        return;
    }
    const qm_vec end = qm_vec_axpy(facet->origin, facet->length, facet->x);
    const qm_vec third = qm_vec_axpy(qm_vec_axpy(facet->origin, facet->cx, facet->x), facet->cy, facet->y);
    qm_vec foot = qm_vec_scale(weight[0], facet->origin);
    foot = qm_vec_axpy(qm_vec_axpy(foot, weight[1], end), weight[2], third);
    qm_vec direction = qm_vec_sub(from, foot);
    double distance = qm_vec_norm(direction);
    /* The foot may be off, the direction too; nothing of the facet lies beyond its farthest corner. */
    heights_along(work, facet, distance > LEAST_LENGTH ? qm_vec_scale(1.0 / distance, direction) : facet->z,
                  height);
}

/** How much of what the corners' distances may be at most a linear function reaches. */
static double score(const plane_work *planes, const double height[3])
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += qm_lesser(height[i], planes->cap[i]);
    return sum;
}

/** True when the least of the planes is no less for a facet with these heights. */
static bool hides_nothing(const plane_work *planes, const double height[3], double slack)
{
    return height[0] - slack >= planes->facet[0] && height[1] - slack >= planes->facet[1] &&
           height[2] - slack >= planes->facet[2];
}

/** The corner where a linear function hides most. */
static int find_worst(const plane_work *planes, const double height[3])
{
    int worst = 0;
    for (int i = 1; i < 3; i++)
        if (planes->cap[i] - height[i] > planes->cap[worst] - height[worst]) worst = i;
    return worst;
}

static void keep_better(const plane_work *planes, double best[3], const double height[3])
{
    if (!(score(planes, height) > score(planes, best))) return;
    for (int i = 0; i < 3; i++)
        best[i] = height[i];
}

/**
 * A facet takes part in the least of the planes with one plane of its own: that of the facet, one that is
 * parallel to the ground, or one seen from a corner or from the middle. Any is valid; the one that hides
 * least is taken.
 */
static void add_plane(const bound_work *work, plane_work *planes, const qm_triangle *facet, double slack)
{
    double best[3], height[3];
    double side = qm_vec_dot(qm_vec_sub(work->shape->middle, facet->origin), facet->z);
    qm_vec up = turn_up(facet->z, side);
    heights_over_facet(work, facet, up, best);
    if (!hides_nothing(planes, best, slack)) {
        heights_along(work, facet, planes->up, height);
        keep_better(planes, best, height);
    }
    int worst = find_worst(planes, best);
    const qm_vec from[4] = {work->shape->corner[worst], work->shape->middle,
                            work->shape->corner[(worst + 1) % 3], work->shape->corner[(worst + 2) % 3]};
    for (int k = 0; k < 4 && !hides_nothing(planes, best, slack); k++) {
        heights_from(work, facet, from[k], up, height);
        keep_better(planes, best, height);
    }
    for (int i = 0; i < 3; i++)
        planes->facet[i] = qm_lesser(planes->facet[i], best[i] - slack);
}

/** Planes of the facets of a pack that may be nearest to any point; a facet that is farther than the corners
 * are, everywhere, can be no matter. */
static void add_pack_planes(const bound_work *work, plane_work *planes, int pack,
                            const double distance[QM_PACK_LANES])
{
    const qm_near_facets *near = work->near;
    double most = qm_greater(planes->facet[0], qm_greater(planes->facet[1], planes->facet[2]));
    double reach = qm_lesser(work->ball, most + work->shape->radius + 4.0 * work->maker->eta);
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        if (pack * QM_PACK_LANES + lane >= near->count || distance[lane] > reach) continue;
        qm_triangle facet = qm_pack_triangle(&near->pack[pack], lane);
        add_plane(work, planes, &facet, near->slack[pack][lane]);
    }
}

static void add_planes(const bound_work *work, plane_work *planes,
                       const double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    for (int i = 0; i < 3; i++)
        planes->facet[i] = planes->cap[i];
    for (int pack = 0; pack < work->near->pack_count; pack++)
        if (has_any_within(distance[pack], work->ball)) add_pack_planes(work, planes, pack, distance[pack]);
}

/** Bounds by the facets of a complete list. */
static void bound_by_facets(bound_work *work, double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    const qm_near_facets *near = work->near;
    measure_middle(work, distance);
    work->ball = work->at_middle + 2.0 * work->shape->radius + 4.0 * work->maker->eta;
    work->ground_facet =
        qm_pack_triangle(&near->pack[work->ground / QM_PACK_LANES], work->ground % QM_PACK_LANES);
    for (int pack = 0; pack < near->pack_count; pack++)
        if (has_any_within(distance[pack], work->ball)) offer_pack(work, pack);
    const qm_triangle *ground = &work->ground_facet;
    double side = qm_vec_dot(qm_vec_sub(work->shape->middle, ground->origin), ground->z);
    plane_work planes = {.up = turn_up(ground->z, side)};
    for (int i = 0; i < 3; i++)
        planes.cap[i] = work->cap[i];
    add_planes(work, &planes, distance);
    offer_low(work, planes.facet);
}

/* ---- over the ground ---- */

/** The height over the ground on one side of it, and what the other facets take off it there. */
typedef struct side_work {
    double up;              /* 1 or -1: the side that the normal of the ground points to, or the other one */
    qm_vec normal;          /* towards the side */
    double height[3], most; /* over the ground, less its slack; at the corners, and the greatest */
    qm_positive_region region;
    qm_positive_part lost;
} side_work;

/** What of the height is above a facet's plane with these heights, in the mean over the piece. */
static qm_positive_part find_loss(const side_work *side, const double height[3], double slack)
{
    double above[3];
    for (int i = 0; i < 3; i++)
        above[i] = side->height[i] - (height[i] - slack);
    return qm_positive_part_in(&side->region, above);
}

static void keep_least(qm_positive_part *least, qm_positive_part loss)
{
    if (loss.mean < least->mean) *least = loss;
}

/** Takes off what a facet may lower: by its own plane, one parallel to the ground, or one as seen from a
 * corner or the middle. Any is valid; the one that takes off least is taken. */
static void take_facet_off(const bound_work *work, side_work *side, const qm_triangle *facet, double slack)
{
    double height[3];
    qm_vec up = turn_up(facet->z, qm_vec_dot(side->normal, facet->z));
    heights_over_facet(work, facet, up, height);
    qm_positive_part least = find_loss(side, height, slack);
    if (least.mean > 0.0) {
        heights_along(work, facet, side->normal, height);
        keep_least(&least, find_loss(side, height, slack));
    }
    for (int k = 0; k < 4 && least.mean > 0.0; k++) {
        qm_vec from = k < 3 ? work->shape->corner[k] : work->shape->middle;
        if (k < 3 && !(side->height[k] > 0.0)) continue;
        heights_from(work, facet, from, up, height);
        keep_least(&least, find_loss(side, height, slack));
    }
    side->lost.mean += least.mean;
    side->lost.share += least.share;
}

/** A facet that is farther than the piece is high, everywhere, takes nothing off. */
static void take_facets_off(const bound_work *work, side_work *side,
                            const double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    const qm_near_facets *near = work->near;
    double reach = qm_lesser(work->ball, side->most + work->shape->radius + 4.0 * work->maker->eta);
    for (int place = 0; place < near->count; place++) {
        int pack = place / QM_PACK_LANES, lane = place % QM_PACK_LANES;
        if (place == work->ground || distance[pack][lane] > reach) continue;
        qm_triangle facet = qm_pack_triangle(&near->pack[pack], lane);
        take_facet_off(work, side, &facet, near->slack[pack][lane]);
    }
}

/** What a piece may be beside the ground: by how much its distance is above the height at most, and in the
 * mean, and in what share. */
static qm_outside find_outside(const bound_work *work)
{
    const qm_triangle *t = &work->ground_facet;
    double wall[3][3], most = 0.0;
    qm_outside outside = {0.0, {0.0, 0.0, 0.0}};
    for (int i = 0; i < 3; i++) {
        double inside[3];
        qm_triangle_walls(t, work->shape->corner[i], inside);
        for (int k = 0; k < 3; k++)
            wall[k][i] = work->maker->eta - inside[k];
    }
    for (int k = 0; k < 3; k++) {
        double here = qm_greater(wall[k][0], qm_greater(wall[k][1], wall[k][2]));
        if (!(here > 0.0)) continue;
        qm_positive_part part = qm_positive_part_of(wall[k]);
        most += here;
        outside.part.mean += part.mean;
        outside.part.share += part.share;
    }
    if (!(most > 0.0)) return outside;
    double sharpness = 1.0 / qm_triangle_least_sine(t) * (1.0 + SQUARE_ROUNDINGS);
    outside.most = sharpness * most;
    outside.part.mean *= sharpness;
    return outside;
}

/** Bounds by the height over the ground; false when the piece is not over it for the most part. */
static bool bound_over_ground(const bound_work *work, const double distance[QM_FACET_PACKS][QM_PACK_LANES],
                              qm_piece_bounds *out)
{
    const qm_triangle *ground = &work->ground_facet;
    double slack = work->near->slack[work->ground / QM_PACK_LANES][work->ground % QM_PACK_LANES];
    double height[3], open = slack + work->shape->slack + work->maker->eta;
    qm_outside outside = find_outside(work);
    if (!(outside.part.share < MOST_OUTSIDE) || !(outside.most < INFINITY)) return false;
    heights_over_facet(work, ground, ground->z, height);
    qm_positive_part lost = {0.0, 0.0, 0.0};
    for (int k = 0; k < 2; k++) {
        side_work side = {.up = k ? -1.0 : 1.0, .normal = turn_up(ground->z, k ? -1.0 : 1.0)};
        for (int i = 0; i < 3; i++) {
            side.height[i] = side.up * height[i] - slack;
            side.most = qm_greater(side.most, side.height[i]);
        }
        if (!(side.most > 0.0)) continue;
        side.region = qm_positive_region_of(side.height);
        take_facets_off(work, &side, distance);
        lost.mean += side.lost.mean;
        lost.share += side.lost.share;
    }
    for (int i = 0; i < 3; i++) {
        out->low[i] = height[i] - open;
        out->high[i] = height[i] + open;
    }
    qm_piece_integrate_signed(work->shape, lost, outside, out);
    return true;
}

/* ---- without planes ---- */

double qm_piece_search(const qm_piece_maker *maker, qm_piece_desk *desk, qm_vec p, double *certain)
{
    qm_hit hit = {.d2 = INFINITY, .pack = desk->hint};
    maker->kernel->closest(maker->target, p, &hit);
    desk->hint = hit.pack;
    desk->searches++;
    *certain = sqrt(hit.d2);
    if (!maker->target_patches) return *certain;
    qm_patch_hit patch;
    maker->kernel->closest_patch(maker->target, p, hit.pack, maker->patch_error, &patch);
    *certain = qm_greater(0.0, patch.lower);
    return patch.distance;
}

/** The distances of middle and corners by searches, and upper bounds by what is listed. */
static void bound_by_searches(bound_work *work, qm_piece_desk *desk)
{
    work->at_middle = qm_piece_search(work->maker, desk, work->shape->middle, &work->certain);
    for (int pack = 0; pack < work->near->pack_count; pack++)
        offer_pack(work, pack);
    for (int i = 0; i < 3; i++)
        qm_piece_search(work->maker, desk, work->shape->corner[i], &work->floor[i]);
}

/**
 * Lower bound by the distances of the corners. Near 0 a root makes sqrt(2 d eta) of an error eta of d, so
 * that eta is taken off before the root. Squares, quotient and difference are off by 6 u relative to their
 * terms, which SQUARE_ROUNDINGS covers; the root's own u of a length of 4 S at most is within eta.
 */
static void bound_by_corners(bound_work *work)
{
    double third = work->shape->longest2 / 3.0 * (1.0 + SQUARE_ROUNDINGS), low[3];
    for (int i = 0; i < 3; i++) {
        double sure = work->floor[i] - work->maker->eta;
        double excess = sure * sure * (1.0 - SQUARE_ROUNDINGS) - third;
        if (!(sure > 0.0 && excess >= 0.0)) return;
        low[i] = sqrt(excess);
    }
    offer_low(work, low);
}

static void bound_by_middle(bound_work *work)
{
    double sure = qm_greater(0.0, work->certain - work->shape->radius);
    const double low[3] = {sure, sure, sure};
    offer_low(work, low);
    double most = work->at_middle + work->shape->radius;
    const double high[3] = {most, most, most};
    offer_high(work, high);
}

/* ---- the calls ---- */

void qm_piece_list_near(const qm_piece_maker *maker, const qm_piece_shape *shape, qm_piece_desk *desk)
{
    double certain, distance = qm_piece_search(maker, desk, shape->middle, &certain);
    qm_near_facets_find(maker->kernel, maker->target, maker->target_patches, maker->patch_error,
                        shape->middle, qm_piece_reach(maker, shape, distance), &desk->near);
}

void qm_piece_bound_near(const qm_piece_maker *maker, const qm_piece_shape *shape, qm_piece_desk *desk,
                         qm_piece_bounds *out)
{
    bound_work work = {.maker = maker,
                       .shape = shape,
                       .near = &desk->near,
                       .low_sum = -INFINITY,
                       .high_sum = INFINITY,
                       .cap = {INFINITY, INFINITY, INFINITY},
                       .floor = {INFINITY, INFINITY, INFINITY}};
    _Alignas(64) double distance[QM_FACET_PACKS][QM_PACK_LANES];
    if (desk->near.is_complete)
        bound_by_facets(&work, distance);
    else
        bound_by_searches(&work, desk);
    bound_by_middle(&work);
    bound_by_corners(&work);
    out->is_signed = false;
    out->stray_low = out->stray_high = out->excess = 0.0;
    for (int i = 0; i < 3; i++) {
        out->low[i] = work.low[i] - shape->slack - maker->eta;
        out->high[i] = work.high[i] + shape->slack + maker->eta;
    }
    qm_piece_integrate(shape, out);
    qm_piece_bounds over;
    if (desk->near.is_complete && work.at_middle < NEAR_GROUND * shape->radius &&
        bound_over_ground(&work, distance, &over) &&
        over.mean_high - over.mean_low < out->mean_high - out->mean_low)
        qm_piece_bounds_combine(out, &over);
}
