#include "deviation_bound.h"

#include "deviation_integral.h"

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
    double facet[3]; /* the least of the facets' planes at each corner; cap, to begin with */
} bound_work;

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
            work->at_middle = qm_lesser(work->at_middle, here + slack);
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

/** Heights of the corners over the plane of a facet, on the side that a point lies on. */
static void heights_over_facet(const bound_work *work, const qm_triangle *facet, qm_vec from,
                               double height[3])
{
    double side = qm_vec_dot(qm_vec_sub(from, facet->origin), facet->z) < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 3; i++)
        height[i] = side * qm_vec_dot(qm_vec_sub(work->shape->corner[i], facet->origin), facet->z);
}

/** Heights of the corners over the plane that the facet lies behind as seen from a point. */
static void heights_from(const bound_work *work, const qm_triangle *facet, qm_vec from, double height[3])
{
    double weight[3];
    qm_triangle_footpoint(facet, from, weight);
    /* Over the facet itself it is the plane of the facet, whose normal is exact however near the point is. */
    if (weight[0] > 0.0 && weight[1] > 0.0 && weight[2] > 0.0) {
        heights_over_facet(work, facet, from, height);
        return;
    }
    const qm_vec end = qm_vec_axpy(facet->origin, facet->length, facet->x);
    const qm_vec third = qm_vec_axpy(qm_vec_axpy(facet->origin, facet->cx, facet->x), facet->cy, facet->y);
    qm_vec foot = qm_vec_scale(weight[0], facet->origin);
    foot = qm_vec_axpy(qm_vec_axpy(foot, weight[1], end), weight[2], third);
    qm_vec direction = qm_vec_sub(from, foot);
    double distance = qm_vec_norm(direction);
    direction = distance > 0.0 ? qm_vec_scale(1.0 / distance, direction) : facet->z;
    /* The foot may be off, the direction too; nothing of the facet lies beyond its farthest corner. */
    double farthest = qm_greater(0.0, qm_greater(qm_vec_dot(direction, qm_vec_sub(end, facet->origin)),
                                                 qm_vec_dot(direction, qm_vec_sub(third, facet->origin))));
    for (int i = 0; i < 3; i++)
        height[i] = qm_vec_dot(direction, qm_vec_sub(work->shape->corner[i], facet->origin)) - farthest;
}

/** How much of what the corners' distances may be at most a linear function reaches. */
static double score(const bound_work *work, const double height[3])
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += qm_lesser(height[i], work->cap[i]);
    return sum;
}

/** True when the least of the planes is no less for a facet with these heights. */
static bool hides_nothing(const bound_work *work, const double height[3], double slack)
{
    return height[0] - slack >= work->facet[0] && height[1] - slack >= work->facet[1] &&
           height[2] - slack >= work->facet[2];
}

/** The corner where a linear function hides most. */
static int find_worst(const bound_work *work, const double height[3])
{
    int worst = 0;
    for (int i = 1; i < 3; i++)
        if (work->cap[i] - height[i] > work->cap[worst] - height[worst]) worst = i;
    return worst;
}

/**
 * A facet takes part in the least of the planes with one plane of its own: that of the facet, or one seen
 * from a corner or from the middle. Any is valid; the one that hides least is taken.
 */
static void add_plane(bound_work *work, const qm_triangle *facet, double slack)
{
    double best[3];
    heights_over_facet(work, facet, work->shape->middle, best);
    int worst = find_worst(work, best);
    const qm_vec from[4] = {work->shape->corner[worst], work->shape->middle,
                            work->shape->corner[(worst + 1) % 3], work->shape->corner[(worst + 2) % 3]};
    double best_score = score(work, best);
    for (int k = 0; k < 4 && !hides_nothing(work, best, slack); k++) {
        double height[3];
        heights_from(work, facet, from[k], height);
        double here = score(work, height);
        if (!(here > best_score)) continue;
        best_score = here;
        for (int i = 0; i < 3; i++)
            best[i] = height[i];
    }
    for (int i = 0; i < 3; i++)
        work->facet[i] = qm_lesser(work->facet[i], best[i] - slack);
}

/** Planes of the facets of a pack that may be nearest to any point; a facet that is farther than the corners
 * are, everywhere, can be no matter. */
static void add_planes(bound_work *work, int pack, const double distance[QM_PACK_LANES])
{
    const qm_near_facets *near = work->near;
    double most = qm_greater(work->facet[0], qm_greater(work->facet[1], work->facet[2]));
    double reach = qm_lesser(work->ball, most + work->shape->radius + 4.0 * work->maker->eta);
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        if (pack * QM_PACK_LANES + lane >= near->count || distance[lane] > reach) continue;
        qm_triangle facet = qm_pack_triangle(&near->pack[pack], lane);
        add_plane(work, &facet, near->slack[pack][lane]);
    }
}

/** Bounds by the facets of a complete list. */
static void bound_by_facets(bound_work *work)
{
    const qm_near_facets *near = work->near;
    _Alignas(64) double distance[QM_FACET_PACKS][QM_PACK_LANES];
    measure_middle(work, distance);
    work->ball = work->at_middle + 2.0 * work->shape->radius + 4.0 * work->maker->eta;
    for (int pack = 0; pack < near->pack_count; pack++)
        if (has_any_within(distance[pack], work->ball)) offer_pack(work, pack);
    for (int i = 0; i < 3; i++)
        work->facet[i] = work->cap[i];
    for (int pack = 0; pack < near->pack_count; pack++)
        if (has_any_within(distance[pack], work->ball)) add_planes(work, pack, distance[pack]);
    offer_low(work, work->facet);
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

/** Lower bound by the distances of the corners. */
static void bound_by_corners(bound_work *work)
{
    double third = work->shape->longest2 / 3.0, low[3];
    for (int i = 0; i < 3; i++) {
        double excess = work->floor[i] * work->floor[i] - third;
        if (!(work->floor[i] > 0.0 && excess >= 0.0)) return;
        low[i] = sqrt(excess);
    }
    offer_low(work, low);
}

static void bound_by_middle(bound_work *work)
{
    double sure = qm_greater(0.0, work->certain - work->shape->radius);
    const double low[3] = {sure, sure, sure};
    offer_low(work, low);
    double most =
        qm_lesser(work->at_middle + work->shape->radius, work->maker->greatest + work->shape->slack);
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
    if (desk->near.is_complete)
        bound_by_facets(&work);
    else
        bound_by_searches(&work, desk);
    bound_by_middle(&work);
    bound_by_corners(&work);
    for (int i = 0; i < 3; i++) {
        out->low[i] = work.low[i] - shape->slack - maker->eta;
        out->high[i] = work.high[i] + shape->slack + maker->eta;
    }
    qm_piece_integrate(shape, out);
}
