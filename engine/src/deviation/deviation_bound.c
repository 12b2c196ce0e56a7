/**
 * deviation_bound.c: the two linear functions of a piece, from the facets near it. deviation_piece.h has the
 * proofs; here they are tried in this order, and for each bound the best function is kept:
 *   facets of the list   upper functions by single facets; the lower one by one plane for each facet
 *   matches              both functions by bilinear patches, for rectangles that bend little
 *   centroid, corners    constants and roots, for pieces far from the target
 *   over the base        the integral of the height over the facet or patch under the piece, with bounds of
 *                        what other facets take off it, and of the excess beside it
 *   from a feature       the same with the distance from the edge or vertex under the piece in place of a height
 */
#include "deviation_feature.h"
#include "deviation_integral.h"
#include "deviation_match.h"
#include "deviation_piece.h"

#define SQUARE_ROUNDINGS 0x1p-49 /* relative: of a difference of squares, 16 u */
#define MAX_OUTSIDE 0.5          /* share of a piece beside the base: with more the height is a poor bound */
#define NEAR_BASE 4.0   /* radii: flat pieces farther from the target are bounded by their corners better */
#define LEAST_APART 0.5 /* radii: nearer pieces have no distance from an edge that is about cubic */
#define WHOLE 0.25      /* radii: plane patches that are nearer to a piece of a patch are not cut in two */
#define ATTACHED_PART 0x1p-6 /* of a height: the greatest loss to other parts of the base's patch */
#define NEGLIGIBLE 0x1p-6    /* of base_margin: a loss below it is not reduced any further */
#define BEND_PART 0x1p-3     /* of bend_error: the error of an integral over a part of a cell */
#define TILT 1.25            /* how much steeper than needed a height is tilted */

/** The state of one piece while it is bounded. */
typedef struct bound_work {
    const qm_deviation_setup *setup;
    const qm_deviation_face *face;
    const qm_deviation_piece *piece;
    const qm_deviation_shape *shape;
    const qm_deviation_facets *near;
    qm_vec bezier[6];
    double at_centroid, certain; /* distance of the centroid, from above and below */
    double ball;                 /* no facet farther than this from the centroid is nearest to any point */
    double low[3], low_sum, high[3], high_sum;
    double cap[3]; /* the least distance to a facet at each corner, from above and below */
    double floor[3];
    int base;       /* index of the facet nearest to the centroid */
    int patch_base; /* the rectangle that the piece is nearest to, or QM_NO_RECTANGLE */
    qm_triangle base_facet;
    double rectangle_distance[QM_MAX_RECTANGLES]; /* of the centroid from their facets, at least */
    /* Matches with the rectangles of the list, made on demand: with the whole surface of their
     * patches, and with what is within their edges where that is another one. */
    struct {
        bool is_computed, is_computed_within;
        int same; /* the rectangle whose matches these are: another one of the same patch, or itself */
        qm_deviation_match match, within;
    } matches[QM_MAX_RECTANGLES];
} bound_work;

/** The lower function by planes on one side of the surface. */
typedef struct plane_work {
    double cap[3];   /* an upper bound of the function at each corner */
    double facet[3]; /* the least of the facets' planes at each corner; cap, to begin with */
    qm_vec up;       /* the normal of the base, towards the centroid */
} plane_work;

/* ---- the best functions so far ---- */

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

/* ---- matches ---- */

/** The rectangle, of those before it, whose match holds for this one as well; otherwise itself. */
static int find_matched(const bound_work *work, int rectangle)
{
    const qm_deviation_rectangle *of = work->near->rectangle;
    for (int i = 0; i < rectangle; i++)
        if (of[i].face == of[rectangle].face && work->matches[i].is_computed && work->matches[i].same == i &&
            qm_deviation_match_loss(work->setup, &work->matches[i].match, &of[rectangle].box) < INFINITY)
            return i;
    return rectangle;
}

/** The match of the piece with the patch of a rectangle that bends little, else NULL. */
static const qm_deviation_match *match_of(bound_work *work, int rectangle, bool within)
{
    const qm_deviation_rectangle *of = &work->near->rectangle[rectangle];
    QM_ASSERT(rectangle >= 0 && rectangle < work->near->rectangle_count);
    /* The planes of its facets say all of a plane patch that is not the base. */
    bool is_base = rectangle == qm_deviation_facets_rectangle(work->near, work->base);
    if (!of->is_mild || (of->is_plane && !is_base)) return NULL;
    const double centre[2] = {0.5 * (of->box.low[0] + of->box.high[0]),
                              0.5 * (of->box.low[1] + of->box.high[1])};
    if (!work->matches[rectangle].is_computed) {
        work->matches[rectangle].is_computed = true;
        work->matches[rectangle].same = find_matched(work, rectangle);
        if (work->matches[rectangle].same == rectangle)
            qm_deviation_match_make(work->setup, work->face, work->piece, &of->patch, centre, false,
                                    &work->matches[rectangle].match);
    }
    int same = work->matches[rectangle].same;
    const qm_deviation_match *match = &work->matches[same].match;
    qm_deviation_match *inner = &work->matches[same].within;
    if (!within || qm_deviation_match_is_inside(match)) return match->holds ? match : NULL;
    if (!work->matches[same].is_computed_within) {
        qm_deviation_match_make(work->setup, work->face, work->piece, &of->patch, centre, true, inner);
        work->matches[same].is_computed_within = true;
    }
    return inner->holds ? inner : NULL;
}

/** Whether the rectangle is the first one of its patch on the list that bends much. */
static bool is_first(const qm_deviation_facets *near, int rectangle)
{
    for (int i = 0; i < rectangle; i++)
        if (near->rectangle[i].face == near->rectangle[rectangle].face && !near->rectangle[i].is_mild)
            return false;
    return !near->rectangle[rectangle].is_mild;
}

/** Upper bounds by matches with all rectangles, and which is under the piece: the one that is nearest. */
static void offer_matches(bound_work *work)
{
    const qm_deviation_facets *near = work->near;
    double least = INFINITY, high[3];
    work->patch_base = QM_NO_RECTANGLE;
    for (int i = 0; i < near->rectangle_count; i++) {
        if (work->rectangle_distance[i] > work->ball) continue;
        const qm_deviation_match *match = match_of(work, i, true);
        if (match && work->matches[i].same == i) {
            qm_deviation_match_upper(match, high);
            offer_high(work, high);
            if (high[0] + high[1] + high[2] < least) work->patch_base = i;
            least = qm_min(least, high[0] + high[1] + high[2]);
        }
        if (!work->face->is_patch || !is_first(near, i)) continue;
        if (qm_deviation_match_aligned_upper(work->setup, work->face, work->piece, &near->rectangle[i].patch,
                                             work->high_sum, high))
            offer_high(work, high);
    }
}

/** The linear function below the distance to a rectangle that its match gives; false when there is none. */
static bool find_match_plane(bound_work *work, int rectangle, double height[3])
{
    const qm_deviation_match *match = rectangle == QM_NO_RECTANGLE ? NULL : match_of(work, rectangle, true);
    if (!match || !(match->least > 0.0)) return false;
    double loss = qm_deviation_match_loss(work->setup, match, &work->near->rectangle[rectangle].box);
    for (int i = 0; i < 3; i++)
        height[i] = (match->low[i] > 0.0 ? match->low[i] : -match->high[i]) - loss;
    return loss < INFINITY;
}

/* ---- distances to the list ---- */

/** Distances of the centroid from all facets of the list. */
static void measure_centroid(bound_work *work, double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    const qm_deviation_facets *near = work->near;
    work->at_centroid = work->certain = INFINITY;
    for (int i = 0; i < near->rectangle_count; i++)
        work->rectangle_distance[i] = INFINITY;
    for (int pack = 0; pack < near->pack_count; pack++) {
        work->setup->kernel->pack_distances(&near->pack[pack], work->shape->centroid, distance[pack]);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            double here = sqrt(distance[pack][lane]), slack = near->slack[pack][lane];
            if (here + slack < work->at_centroid) {
                work->at_centroid = here + slack;
                work->base = pack * QM_PACK_LANES + lane;
            }
            work->certain = qm_min(work->certain, here - slack);
            distance[pack][lane] = here - slack;
            int rectangle = near->rectangle_of[pack][lane];
            if (rectangle == QM_NO_RECTANGLE) continue;
            double *least = &work->rectangle_distance[rectangle];
            *least = qm_min(*least, here - slack);
        }
    }
}

/** Upper bounds by the facets of a pack, and the corners' own distances. */
static void offer_pack(bound_work *work, int pack)
{
    const qm_deviation_facets *near = work->near;
    _Alignas(64) double d[3][QM_PACK_LANES];
    for (int i = 0; i < 3; i++) {
        work->setup->kernel->pack_distances(&near->pack[pack], work->shape->corner[i], d[i]);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            double here = sqrt(d[i][lane]), slack = near->slack[pack][lane];
            work->floor[i] = qm_min(work->floor[i], here - slack);
            d[i][lane] = here + slack;
            work->cap[i] = qm_min(work->cap[i], d[i][lane]);
        }
    }
    double slack = work->shape->slack;
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const double high[3] = {d[0][lane] + slack, d[1][lane] + slack, d[2][lane] + slack};
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

static qm_vec flip_towards(qm_vec normal, double side)
{
    return side < 0.0 ? qm_vec_scale(-1.0, normal) : normal;
}

/** The points of a piece whose heights are taken: its corners, or its Bezier points. */
typedef struct point_list {
    const qm_vec *at;
    int count;
} point_list;

static point_list corners_of(const bound_work *work)
{
    return (point_list){work->shape->corner, 3};
}

/** Heights of points over the plane of a facet, seen from above. */
static void heights_over_facet(point_list points, const qm_triangle *facet, qm_vec up, double *height)
{
    for (int i = 0; i < points.count; i++)
        height[i] = qm_vec_dot(up, qm_vec_sub(points.at[i], facet->origin));
}

/** Heights of points over the plane at a right angle to a direction that the facet lies behind. */
static void heights_along(point_list points, const qm_triangle *facet, qm_vec direction, double *height)
{
    double second = facet->length * qm_vec_dot(direction, facet->x);
    double third = facet->cx * qm_vec_dot(direction, facet->x) + facet->cy * qm_vec_dot(direction, facet->y);
    double farthest = qm_max(0.0, qm_max(second, third));
    for (int i = 0; i < points.count; i++)
        height[i] = qm_vec_dot(direction, qm_vec_sub(points.at[i], facet->origin)) - farthest;
}

/** Heights of points over the plane that the facet lies behind as seen from another point. */
static void heights_from(point_list points, const qm_triangle *facet, qm_vec from, double *height)
{
    double weight[3];
    qm_triangle_footpoint(facet, from, weight);
    /* Over the facet itself it is the plane of the facet, whose normal is exact however near the point is. */
    if (weight[0] > 0.0 && weight[1] > 0.0 && weight[2] > 0.0) {
        double side = qm_vec_dot(qm_vec_sub(from, facet->origin), facet->z);
        heights_over_facet(points, facet, flip_towards(facet->z, side), height);
        return;
    }
    qm_vec corner[3];
    qm_triangle_corners(facet, corner);
    qm_vec direction = qm_vec_sub(from, qm_triangle_at(corner, weight));
    double distance = qm_vec_norm(direction);
    /* The foot may be off, the direction too; nothing of the facet lies beyond its farthest corner. */
    heights_along(points, facet,
                  distance > QM_MIN_LENGTH ? qm_vec_scale(1.0 / distance, direction) : facet->z, height);
}

/** The sum of a linear function at the corners, cut at the corners' own distances. */
static double score(const plane_work *planes, const double height[3])
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += qm_min(height[i], planes->cap[i]);
    return sum;
}

/** Whether a facet with these heights leaves the minimum of the planes unchanged. */
static bool changes_nothing(const plane_work *planes, const double height[3], double slack)
{
    return height[0] - slack >= planes->facet[0] && height[1] - slack >= planes->facet[1] &&
           height[2] - slack >= planes->facet[2];
}

/** The corner where a linear function is farthest below the corner's own distance. */
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
 * parallel to the base, or one seen from a corner or from the centroid; or with the function that its match
 * gives. Any is valid; the one with the highest values at the corners is taken.
 */
static void add_plane(const bound_work *work, plane_work *planes, const qm_triangle *facet, double slack,
                      const double *by_match)
{
    double best[3], height[3];
    double side = qm_vec_dot(qm_vec_sub(work->shape->centroid, facet->origin), facet->z);
    qm_vec up = flip_towards(facet->z, side);
    heights_over_facet(corners_of(work), facet, up, best);
    if (by_match) {
        for (int i = 0; i < 3; i++)
            height[i] = by_match[i] + slack;
        keep_better(planes, best, height);
    }
    if (!changes_nothing(planes, best, slack)) {
        heights_along(corners_of(work), facet, planes->up, height);
        keep_better(planes, best, height);
    }
    int worst = find_worst(planes, best);
    const qm_vec from[4] = {work->shape->corner[worst], work->shape->centroid,
                            work->shape->corner[(worst + 1) % 3], work->shape->corner[(worst + 2) % 3]};
    for (int k = 0; k < 4 && !changes_nothing(planes, best, slack); k++) {
        heights_from(corners_of(work), facet, from[k], height);
        keep_better(planes, best, height);
    }
    for (int i = 0; i < 3; i++)
        planes->facet[i] = qm_min(planes->facet[i], best[i] - slack);
}

/** Adds planes of the facets of a pack that may be nearest to any point of the piece; a facet that is farther
 * than the corners are, everywhere, cannot be. */
static void add_pack_planes(bound_work *work, plane_work *planes, int pack,
                            const double distance[QM_PACK_LANES])
{
    const qm_deviation_facets *near = work->near;
    const qm_deviation_shape *shape = work->shape;
    double most = qm_max(planes->facet[0], qm_max(planes->facet[1], planes->facet[2]));
    double reach = qm_min(work->ball, most + shape->radius + shape->slack + 4.0 * work->setup->eta);
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        if (pack * QM_PACK_LANES + lane >= near->count || distance[lane] > reach) continue;
        qm_triangle facet = qm_deviation_facet_at(&near->pack[pack], lane);
        double by_match[3];
        bool is_matched = find_match_plane(work, near->rectangle_of[pack][lane], by_match);
        add_plane(work, planes, &facet, near->slack[pack][lane] + shape->slack, is_matched ? by_match : NULL);
    }
}

static void add_planes(bound_work *work, plane_work *planes,
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
    const qm_deviation_facets *near = work->near;
    QM_ASSERT(near->is_complete && near->count > 0);
    measure_centroid(work, distance);
    work->ball =
        work->at_centroid + 2.0 * (work->shape->radius + work->shape->slack) + 4.0 * work->setup->eta;
    work->base_facet =
        qm_deviation_facet_at(&near->pack[work->base / QM_PACK_LANES], work->base % QM_PACK_LANES);
    for (int pack = 0; pack < near->pack_count; pack++)
        if (has_any_within(distance[pack], work->ball)) offer_pack(work, pack);
    offer_matches(work);
    const qm_triangle *base = &work->base_facet;
    double side = qm_vec_dot(qm_vec_sub(work->shape->centroid, base->origin), base->z);
    plane_work planes = {.up = flip_towards(base->z, side)};
    for (int i = 0; i < 3; i++)
        planes.cap[i] = work->cap[i];
    add_planes(work, &planes, distance);
    offer_low(work, planes.facet);
}

/* ---- over the base ---- */

/** The surface that the height is over: a facet, or the patch of a rectangle. */
typedef struct base {
    double low[3], high[3]; /* the height lies between them, and so does the distance to the base, signed */
    double cap[2][3];       /* an upper bound of the lower bound of that distance, on either side */
    qm_vec normal;
    qm_excess outside;                   /* of the parts of the piece that may be beside it */
    const qm_deviation_match *match;     /* NULL of a facet */
    const qm_deviation_feature *feature; /* an edge or a vertex, from which distances are heights; or NULL: */
    double least, farthest;              /* they are between these */
    bool is_bent;                        /* the height is quadratic, over a patch or of a piece of one, */
    double height[6];                    /* with these coefficients, */
    double cubic[4], cubic_most;         /* but for a cubic part; */
    double slack;                        /* the source may be so far from the points that it is of */
    double loss, more;   /* of the match: by how much the distance may be below the height, and above, */
    bool is_plane;       /* the loss is that to all of its patch */
    double below, above; /* widen the height to hold the signed distance */
    uint32_t face;
} base;

/** The height on one side of the base, and its loss to the other facets there. */
typedef struct side_work {
    const base *over;
    double room;   /* by how much the height may exceed the distance and still count as a valid bound */
    double up;     /* 1 or -1: the side that the normal of the base points to, or the other one */
    qm_vec normal; /* towards the side */
    double height[3], most; /* a lower bound of the height at the corners, and its greatest value */
    double bent[6];         /* coefficients of that bound, with its cubic part at most */
    qm_positive_region region;
    qm_positive_part lost;
} side_work;

static double max3(const double x[3])
{
    return qm_max(x[0], qm_max(x[1], x[2]));
}

static double min3(const double x[3])
{
    return qm_min(x[0], qm_min(x[1], x[2]));
}

/** The positive part of a linear function that the loss is at most, as its mean over the piece; no more than
 * the height itself, as no distance is below 0. The share is that of the points where this part exceeds room. */
static qm_positive_part find_part(const side_work *side, double above[3])
{
    qm_positive_part part = qm_integral_positive_part_in(&side->region, above);
    part.mean = qm_min(part.mean, part.share * side->most);
    for (int i = 0; i < 3; i++)
        above[i] -= side->room;
    part.share = qm_integral_positive_part_in(&side->region, above).share;
    return part;
}

/** The part of the height above a linear function less slack. */
static qm_positive_part find_loss(const side_work *side, const double height[3], double slack)
{
    double above[3];
    for (int i = 0; i < 3; i++)
        above[i] = side->height[i] - (height[i] - slack);
    return find_part(side, above);
}

/** The same of a function with values at the Bezier points of a piece of a patch: differences of such heights
 * bend less than either, and are 0 in one plane. */
static qm_positive_part find_bent_loss(const side_work *side, const double height[6], double slack)
{
    double value[6], above[3];
    for (int k = 0; k < 6; k++)
        value[k] = side->bent[k] - (height[k] - slack);
    qm_quadratic_raise(value, above);
    return find_part(side, above);
}

static void keep_min(qm_positive_part *least, qm_positive_part loss)
{
    if (loss.mean < least->mean) *least = loss;
}

/** The loss of the distance from a feature to what is within slack of the hull of some corners: slack everywhere, and
 * more where a corner is nearer. */
static qm_positive_part find_hull_loss(const bound_work *work, const side_work *side, const qm_vec *corner,
                                       int count, double slack)
{
    const base *over = side->over;
    qm_positive_part sum = find_part(side, (double[3]){slack, slack, slack});
    for (int i = 0; i < count; i++) {
        qm_vec way = qm_deviation_feature_offset(over->feature, corner[i]);
        double value[6], above[3], error = work->setup->eta * qm_vec_norm(way);
        for (int k = 0; k < 6; k++) {
            qm_vec x = qm_deviation_feature_offset(over->feature, work->bezier[k]);
            value[k] = (qm_vec_dot(x, way) + error) / over->least;
        }
        qm_quadratic_raise(value, above);
        if (!(max3(above) > 0.0)) continue;
        qm_positive_part part = find_part(side, above);
        sum.mean += part.mean;
        sum.share += part.share;
    }
    return sum;
}

/** The loss to a facet: by its own plane, one parallel to the base, or one as seen from a corner or the
 * centroid. Any is valid; the one with the smallest loss is taken. */
static qm_positive_part find_facet_loss(const bound_work *work, const side_work *side,
                                        const qm_triangle *facet, double slack)
{
    bool by_bezier = side->over->is_bent;
    qm_positive_part least = {INFINITY, INFINITY, 1.0};
    if (side->over->feature) {
        qm_vec corner[3];
        qm_triangle_corners(facet, corner);
        least = find_hull_loss(work, side, corner, 3, slack);
        if (!(least.mean > 0.0)) return least;
    }
    point_list points = by_bezier ? (point_list){work->bezier, 6} : corners_of(work);
    qm_positive_part (*find)(const side_work *, const double *, double) =
        by_bezier ? find_bent_loss : find_loss;
    slack += by_bezier ? work->face->slack : work->shape->slack;
    double height[6];
    heights_over_facet(points, facet, flip_towards(facet->z, qm_vec_dot(side->normal, facet->z)), height);
    keep_min(&least, find(side, height, slack));
    if (least.mean > 0.0) {
        heights_along(points, facet, side->normal, height);
        keep_min(&least, find(side, height, slack));
    }
    for (int k = 0; k < 4 && least.mean > 0.0; k++) {
        qm_vec from = k < 3 ? work->shape->corner[k] : work->shape->centroid;
        if (k < 3 && !(side->height[k] > 0.0)) continue;
        heights_from(points, facet, from, height);
        keep_min(&least, find(side, height, slack));
    }
    return least;
}

/** Tilts a height over a rectangle's surface towards it: by as little as lifts all corners that are beyond
 * its edge to their heights over the base. */
static void tilt(const side_work *side, const double beyond[6], double height[6])
{
    double slope = 0.0;
    for (int k = 0; k < 6; k++)
        if (beyond[k] > 0.0 && side->bent[k] > height[k])
            slope = qm_max(slope, TILT * (side->bent[k] - height[k]) / beyond[k]);
    slope = qm_min(slope, 1.0 / TILT);
    double shorter = 1.0 / sqrt(1.0 + slope * slope);
    for (int k = 0; k < 6; k++)
        height[k] = (height[k] + slope * beyond[k]) * shorter;
}

/** The loss to a rectangle, by how far the piece is beyond one of its edges. */
static qm_positive_part find_aside_loss(const bound_work *work, const side_work *side, int rectangle)
{
    qm_positive_part least = {INFINITY, INFINITY, 1.0};
    const qm_deviation_rectangle *of = &work->near->rectangle[rectangle];
    double height[4][3];
    qm_deviation_match_beside(work->face, work->piece, &of->patch, &of->box, side->normal, height);
    for (int edge = 0; edge < 4 && least.mean > 0.0; edge++)
        keep_min(&least, find_loss(side, height[edge], work->face->slack));
    return least;
}

/** The loss to a rectangle, by its matches: that with the base, if it belongs to the same patch, and its
 * own. */
static qm_positive_part find_match_loss(bound_work *work, const side_work *side, int rectangle)
{
    const qm_deviation_rectangle *of = &work->near->rectangle[rectangle];
    if (side->over->match && side->over->face == of->face) {
        if (side->over->is_plane) return (qm_positive_part){0.0, 0.0, 0.0};
        double loss = qm_deviation_match_loss(work->setup, side->over->match, &of->box);
        /* No more than that of the base, or at least little: nowhere is it the nearest by more. */
        if (loss <= side->over->loss) return (qm_positive_part){0.0, 0.0, 0.0};
    }
    if (of->is_plane) return (qm_positive_part){INFINITY, INFINITY, 1.0};
    qm_positive_part least = find_aside_loss(work, side, rectangle);
    if (side->over->feature && least.mean > 0.0) {
        qm_vec corner[4];
        qm_uv_box_corners(&of->patch, &of->box, corner);
        keep_min(&least, find_hull_loss(work, side, corner, 4, 0.0));
    }
    double negligible = NEGLIGIBLE * work->setup->base_margin;
    for (int within = 0; within < 2 && least.mean > negligible; within++) {
        const qm_deviation_match *match = match_of(work, rectangle, within == 1);
        double height[6], beyond[6];
        if (!match) continue;
        qm_match_margin margin = qm_deviation_match_margin(work->setup, match, &of->box);
        if (!(margin.loss < INFINITY)) continue;
        double slack = margin.loss + match->slack + match->off;
        qm_deviation_match_beyond(match, &of->box, &margin, beyond);
        for (int flipped = 0; flipped < 2 && least.mean > 0.0; flipped++) {
            for (int k = 0; k < 6; k++)
                height[k] = flipped ? -match->height[k] : match->height[k];
            keep_min(&least, find_bent_loss(side, height, slack));
            tilt(side, beyond, height);
            keep_min(&least, find_bent_loss(side, height, slack));
        }
    }
    return least;
}

/** The facets of a list that may lower the height; a facet that is farther than the piece is high,
 * everywhere, takes nothing off. The two of a rectangle count as one where a match bounds them better. */
static void take_facets_off(bound_work *work, side_work *side,
                            const double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    const qm_deviation_facets *near = work->near;
    const qm_deviation_shape *shape = work->shape;
    double reach = qm_min(work->ball, side->most + shape->radius + shape->slack + 4.0 * work->setup->eta);
    int before = QM_NO_RECTANGLE;
    qm_positive_part whole = {0.0, 0.0, 0.0}, sum = whole;
    for (int index = 0; index <= near->count; index++) {
        int pack = index / QM_PACK_LANES, lane = index % QM_PACK_LANES;
        int rectangle = index < near->count ? near->rectangle_of[pack][lane] : QM_NO_RECTANGLE;
        if (before != QM_NO_RECTANGLE && rectangle != before) {
            keep_min(&sum, whole);
            side->lost.mean += sum.mean;
            side->lost.share += sum.share;
        }
        if (rectangle != before) sum = (qm_positive_part){0.0, 0.0, 0.0};
        if (rectangle != before && rectangle != QM_NO_RECTANGLE)
            whole = work->rectangle_distance[rectangle] > reach ? (qm_positive_part){0.0, 0.0, 0.0}
                                                                : find_match_loss(work, side, rectangle);
        before = rectangle;
        bool is_base = !side->over->match && !side->over->feature && index == work->base;
        if (index == near->count || is_base || distance[pack][lane] > reach) continue;
        if (rectangle != QM_NO_RECTANGLE && !(whole.mean > sum.mean)) continue;
        qm_triangle facet = qm_deviation_facet_at(&near->pack[pack], lane);
        qm_positive_part least = find_facet_loss(work, side, &facet, near->slack[pack][lane]);
        qm_positive_part *to = rectangle == QM_NO_RECTANGLE ? &side->lost : &sum;
        to->mean += least.mean;
        to->share += least.share;
    }
}

/** Bounds by how much the distance exceeds the height where a piece is beyond some edges, from how far its
 * corners are beyond each: at most, in the mean, and in which share of the piece. Beyond more than one edge
 * the excess is no more than the sum over the edges, times sharpness. */
static qm_excess find_outside(const double edge[][3], int count, double sharpness)
{
    double most = 0.0;
    qm_excess outside = {0.0, {0.0, 0.0, 0.0}};
    for (int k = 0; k < count; k++) {
        double here = max3(edge[k]);
        if (!(here > 0.0)) continue;
        qm_positive_part part = qm_integral_positive_part(edge[k]);
        most += here;
        outside.part.mean += part.mean;
        outside.part.share += part.share;
    }
    if (!(most > 0.0)) return outside;
    outside.most = sharpness * most;
    outside.part.mean *= sharpness;
    return outside;
}

/** Lowers the bounds of an excess o at a right angle to a height of at least least: the distance, the root of h^2 + o^2,
 * is at most h + o^2 / (2 h). Beyond n edges o^2 is no more than n times the sum of squares. */
static void square_outside(qm_excess *outside, const double edge[][3], int count, double sharpness,
                           double least)
{
    double sum = 0.0, beyond = 0.0;
    if (!(least > 0.0)) return;
    for (int k = 0; k < count; k++) {
        if (!(max3(edge[k]) > 0.0)) continue;
        sum += qm_integral_positive_part(edge[k]).square;
        beyond += 1.0;
    }
    if (!(sum > 0.0)) return;
    double mean = sharpness * sharpness * beyond * sum / (2.0 * least) * (1.0 + SQUARE_ROUNDINGS);
    double most = outside->most * outside->most / (2.0 * least) * (1.0 + SQUARE_ROUNDINGS);
    outside->part.mean = qm_min(outside->part.mean, mean);
    outside->most = qm_min(outside->most, most);
}

/** Lowers the bounds of find_outside by how far the corners are past both ends of each edge: a point beyond
 * an edge is no farther from it than the sum of these and its distance from the plane on the edge. */
static void narrow_outside(qm_excess *outside, const double edge[3][3], const double past[3][2][3])
{
    double most = 0.0, mean = 0.0;
    for (int k = 0; k < 3; k++) {
        double here = max3(edge[k]);
        if (!(here > 0.0)) continue;
        qm_positive_region region = qm_integral_positive_region(edge[k]);
        most += here;
        mean += qm_integral_positive_part(edge[k]).mean;
        for (int end = 0; end < 2; end++) {
            most += qm_max(0.0, max3(past[k][end]));
            mean += qm_integral_positive_part_in(&region, past[k][end]).mean;
        }
    }
    outside->most = qm_min(outside->most, most * (1.0 + SQUARE_ROUNDINGS));
    outside->part.mean = qm_min(outside->part.mean, mean * (1.0 + SQUARE_ROUNDINGS));
}

/** How far points are beyond the planes on a facet's edges, and past the ends of each edge. */
static void find_facet_edges(const qm_deviation_setup *setup, const qm_triangle *facet, point_list points,
                             double edge[3][6], double past[3][2][6])
{
    for (int i = 0; i < points.count; i++) {
        double inside[3], within[3][2];
        qm_deviation_facet_edges(facet, points.at[i], inside);
        qm_deviation_facet_ends(facet, points.at[i], within);
        for (int k = 0; k < 3; k++) {
            edge[k][i] = setup->eta - inside[k];
            for (int end = 0; end < 2; end++)
                past[k][end][i] = setup->eta - within[k][end];
        }
    }
}

/** Values at the corners of the function itself, where it is linear, or of a linear one above it. */
static void bound_above(const base *over, const double value[6], double high[3])
{
    if (over->is_bent) {
        qm_quadratic_raise(value, high);
        return;
    }
    for (int i = 0; i < 3; i++)
        high[i] = value[i];
}

/** The excess beside the facet, where the height is at least least. */
static void set_facet_outside(const bound_work *work, double least, base *over)
{
    const qm_triangle *t = &work->base_facet;
    point_list points = over->is_bent ? (point_list){work->bezier, 6} : corners_of(work);
    double edge[3][6], past[3][2][6], high_edge[3][3], high_past[3][2][3];
    find_facet_edges(work->setup, t, points, edge, past);
    for (int k = 0; k < 3; k++) {
        bound_above(over, edge[k], high_edge[k]);
        for (int end = 0; end < 2; end++)
            bound_above(over, past[k][end], high_past[k][end]);
    }
    double sharpness = 1.0 / qm_deviation_facet_min_sine(t) * (1.0 + SQUARE_ROUNDINGS);
    over->outside = find_outside((const double(*)[3])high_edge, 3, sharpness);
    narrow_outside(&over->outside, (const double(*)[3])high_edge, (const double(*)[2][3])high_past);
    square_outside(&over->outside, (const double(*)[3])high_edge, 3, sharpness, least);
}

/** The height over a facet. Of a piece of a patch it is quadratic, and exact. */
static void set_facet_base(const bound_work *work, base *over)
{
    const qm_triangle *t = &work->base_facet;
    double slack = work->near->slack[work->base / QM_PACK_LANES][work->base % QM_PACK_LANES];
    double low[3], high[3];
    over->match = NULL;
    over->feature = NULL;
    over->normal = t->z;
    over->is_bent = work->face->is_patch;
    over->slack = 0.0;
    over->below = over->above = slack;
    if (over->is_bent) {
        heights_over_facet((point_list){work->bezier, 6}, t, t->z, over->height);
        qm_quadratic_open(over->height, low, high);
    } else {
        over->below = over->above = slack + work->shape->slack;
        heights_over_facet(corners_of(work), t, t->z, low);
        heights_over_facet(corners_of(work), t, t->z, high);
    }
    over->cubic_most = 0.0;
    double lowest = qm_max(min3(low), -max3(high));
    set_facet_outside(work, lowest - work->setup->eta, over);
    for (int i = 0; i < 3; i++) {
        over->low[i] = low[i] - over->below;
        over->high[i] = high[i] + over->above;
        over->cap[0][i] = high[i] - over->below;
        over->cap[1][i] = -low[i] - over->above;
    }
}

/** The loss of the match to the parts of its patch on the list: the least loss to any of them, and the losses
 * to others that are but a small part of the height. */
static double find_patch_loss(const bound_work *work, const base *over)
{
    double height = 0.0, loss[QM_MAX_RECTANGLES], least = INFINITY;
    for (int i = 0; i < 3; i++)
        height = qm_max(height, qm_max(over->match->low[i], -over->match->high[i]));
    for (int k = 0; k < work->near->rectangle_count; k++) {
        const qm_deviation_rectangle *of = &work->near->rectangle[k];
        loss[k] =
            of->face == over->face ? qm_deviation_match_loss(work->setup, over->match, &of->box) : INFINITY;
        least = qm_min(least, loss[k]);
    }
    double most = least;
    for (int k = 0; k < work->near->rectangle_count; k++)
        if (loss[k] <= ATTACHED_PART * height) most = qm_max(most, loss[k]);
    return most;
}

/** Bounds how far the distance to a patch exceeds the height. */
static void set_patch_outside(const bound_work *work, base *over)
{
    double edge[4][3];
    qm_match_rise rise = qm_deviation_match_rise(work->setup, over->match);
    qm_deviation_match_edges(work->setup, over->match, rise.foot, edge);
    over->more = rise.over;
    over->outside = find_outside((const double(*)[3])edge, 4, 1.0);
}

static bool set_patch_base(bound_work *work, base *over)
{
    int rectangle = work->patch_base;
    over->match = rectangle == QM_NO_RECTANGLE ? NULL : match_of(work, rectangle, false);
    over->feature = NULL;
    if (!over->match) return false;
    over->face = work->near->rectangle[rectangle].face;
    over->loss = find_patch_loss(work, over);
    double to_plane = qm_deviation_match_plane_loss(work->setup, over->match, work->bezier);
    over->is_plane = to_plane < over->loss;
    if (over->is_plane) over->loss = to_plane;
    if (!(over->loss < INFINITY)) return false;
    const qm_deviation_match *match = over->match;
    over->normal = match->normal;
    over->is_bent = true;
    over->slack = match->slack + match->off;
    for (int k = 0; k < 6; k++)
        over->height[k] = match->height[k];
    over->cubic_most = match->cubic_most;
    for (int k = 0; k < 4 && over->cubic_most > 0.0; k++)
        over->cubic[k] = match->cubic[k];
    set_patch_outside(work, over);
    if (!(over->more < INFINITY)) return false;
    bool has_sign = match->least > 0.0, is_above = match->low[0] > 0.0;
    double both = qm_max(over->loss, over->more);
    over->below = !has_sign ? both : is_above ? over->loss : over->more;
    over->above = !has_sign ? both : is_above ? over->more : over->loss;
    for (int i = 0; i < 3; i++) {
        over->low[i] = match->low[i] - over->below;
        over->high[i] = match->high[i] + over->above;
        over->cap[0][i] = match->high[i] - over->below;
        over->cap[1][i] = -match->low[i] - over->above;
    }
    return true;
}

/** How far the piece is past the ends of an edge, of a facet that is within slack of the target. */
static void set_feature_outside(const bound_work *work, base *over)
{
    double past[2][6], edge[2][3];
    for (int k = 0; k < 6; k++) {
        double here[2];
        qm_deviation_feature_past(over->feature, work->bezier[k], here);
        for (int end = 0; end < 2; end++)
            past[end][k] = here[end] + work->setup->eta;
    }
    for (int end = 0; end < 2; end++)
        qm_quadratic_raise(past[end], edge[end]);
    bool is_edge = over->feature->length > 0.0;
    over->outside = find_outside((const double(*)[3])edge, is_edge ? 2 : 0, 1.0);
    square_outside(&over->outside, (const double(*)[3])edge, is_edge ? 2 : 0, 1.0, over->least);
}

/** The distance from an edge or vertex as a height over it. */
static bool set_feature_base(const bound_work *work, const qm_deviation_feature *feature, base *over)
{
    double low[3], high[3], eta = work->setup->eta;
    qm_feature_distance distance;
    if (!qm_deviation_feature_distance(work->setup, feature, work->bezier, &distance)) return false;
    over->match = NULL;
    over->feature = feature;
    over->least = distance.least;
    over->farthest = 0.0;
    /* No longer than 1, whether or not the feature is the nearest. */
    qm_vec offset = qm_deviation_feature_offset(feature, work->shape->centroid);
    over->normal = qm_vec_scale(1.0 / qm_max(qm_vec_norm(offset), QM_MIN_LENGTH), offset);
    QM_ASSERT(qm_vec_norm2(over->normal) <= 1.0 + 0x1p-40);
    over->is_bent = true;
    for (int k = 0; k < 6; k++) {
        over->height[k] = distance.value[k];
        over->farthest = qm_max(over->farthest, distance.value[k]);
    }
    for (int k = 0; k < 4; k++)
        over->cubic[k] = distance.cubic[k];
    over->cubic_most = distance.cubic_most;
    over->slack = work->face->slack + distance.off + distance.cubic_most;
    /* A feature of a rectangle is the patch's own. */
    bool is_exact = qm_deviation_facets_rectangle(work->near, work->base) != QM_NO_RECTANGLE;
    over->above = is_exact ? 0.0 : work->near->slack[work->base / QM_PACK_LANES][work->base % QM_PACK_LANES];
    /* An error of a normal cone, eta |x|, counts as the distance does. */
    over->below = eta * (over->farthest + distance.off + distance.cubic_most) / distance.least;
    qm_quadratic_open(over->height, low, high);
    for (int i = 0; i < 3; i++) {
        over->low[i] = low[i] - over->slack - over->below;
        over->high[i] = high[i] + over->slack + over->above;
        over->cap[0][i] = high[i] + over->slack - over->below;
        over->cap[1][i] = -low[i] + over->slack - over->above;
    }
    set_feature_outside(work, over);
    return true;
}

/** Bounds by the height over the base; false when the piece is not over it for the most part. */
static bool bound_over_base(bound_work *work, const base *over,
                            const double distance[QM_FACET_PACKS][QM_PACK_LANES], qm_deviation_bounds *out)
{
    double eta = work->setup->eta;
    if (!(over->outside.part.share < MAX_OUTSIDE) || !(over->outside.most < INFINITY)) return false;
    qm_positive_part lost = {0.0, 0.0, 0.0};
    double cubic = over->cubic_most;
    for (int k = 0; k < 2; k++) {
        side_work side = {.over = over,
                          .room = work->setup->base_margin,
                          .up = k ? -1.0 : 1.0,
                          .normal = flip_towards(over->normal, k ? -1.0 : 1.0)};
        for (int i = 0; i < 3; i++) {
            side.height[i] = over->cap[k][i];
            side.most = qm_max(side.most, side.height[i]);
        }
        for (int i = 0; i < 6; i++)
            side.bent[i] = !over->is_bent ? 0.5 * (side.height[i % 3] + side.height[(i + i / 3) % 3])
                           : k            ? -over->height[i] - over->above + cubic
                                          : over->height[i] - over->below + cubic;
        if (!(side.most > 0.0)) continue;
        side.region = qm_integral_positive_region(side.height);
        take_facets_off(work, &side, distance);
        lost.mean += side.lost.mean;
        lost.share += side.lost.share;
    }
    for (int i = 0; i < 3; i++) {
        out->low[i] = over->low[i] - eta;
        out->high[i] = over->high[i] + eta;
    }
    double room = lost.mean > 0.0 ? work->setup->base_margin : 0.0;
    if (over->is_bent) {
        for (int k = 0; k < 6; k++)
            out->bend.value[k] = over->height[k];
        out->bend.cubic_most = cubic;
        for (int k = 0; k < 4; k++)
            out->bend.cubic[k] = cubic > 0.0 ? over->cubic[k] : 0.0;
        out->bend.below = over->slack + over->below + eta;
        out->bend.above = over->slack + over->above + eta;
        out->bend.cells = qm_quadratic_count_cells(over->height, work->setup->bend_error);
        qm_deviation_integrate_quadratic(work->shape, lost, over->outside, room,
                                         BEND_PART * work->setup->bend_error, out);
    } else {
        qm_deviation_integrate_signed(work->shape, lost, over->outside, room, out);
    }
    return true;
}

/* ---- without planes ---- */

double qm_deviation_search(const qm_deviation_setup *setup, qm_deviation_workspace *workspace, qm_vec p,
                           double *certain)
{
    qm_hit hit = {.d2 = INFINITY, .pack = workspace->hint};
    setup->kernel->closest(setup->target, p, &hit);
    workspace->hint = hit.pack;
    workspace->searches++;
    *certain = sqrt(hit.d2);
    if (!setup->target_patches) return *certain;
    qm_bilinear_hit patch;
    setup->kernel->closest_patch(setup->target, p, hit.pack, setup->patch_error, &patch);
    *certain = qm_max(0.0, patch.lower);
    return patch.distance;
}

/** The distances of centroid and corners by searches, and upper functions by the facets that are listed. */
static void bound_by_searches(bound_work *work, qm_deviation_workspace *workspace)
{
    work->at_centroid = qm_deviation_search(work->setup, workspace, work->shape->centroid, &work->certain);
    for (int pack = 0; pack < work->near->pack_count; pack++)
        offer_pack(work, pack);
    for (int i = 0; i < 3; i++)
        qm_deviation_search(work->setup, workspace, work->shape->corner[i], &work->floor[i]);
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
        double sure = work->floor[i] - work->setup->eta;
        double excess = sure * sure * (1.0 - SQUARE_ROUNDINGS) - third;
        if (!(sure > 0.0 && excess >= 0.0)) return;
        low[i] = sqrt(excess) - work->shape->slack;
    }
    offer_low(work, low);
}

static void bound_by_centroid(bound_work *work)
{
    double extent = work->shape->radius + work->shape->slack;
    double sure = qm_max(0.0, work->certain - extent);
    const double low[3] = {sure, sure, sure};
    offer_low(work, low);
    double most = work->at_centroid + extent;
    const double high[3] = {most, most, most};
    offer_high(work, high);
}

/* ---- the calls ---- */

void qm_deviation_list_facets(const qm_deviation_setup *setup, const qm_deviation_shape *shape, bool cuts_all,
                              qm_deviation_workspace *workspace)
{
    double certain, distance = qm_deviation_search(setup, workspace, shape->centroid, &certain);
    double whole = shape->slack > 0.0 ? WHOLE * shape->radius : 0.0;
    qm_deviation_facets_find(setup->kernel, setup->target, setup->target_patches, cuts_all, whole,
                             setup->patch_error, shape->centroid, distance,
                             qm_deviation_search_radius(setup, shape, distance), &workspace->near);
}

/** Bounds over the patch or the facet under the piece, when they are better. */
static void combine_over_base(bound_work *work, const double distance[QM_FACET_PACKS][QM_PACK_LANES],
                              qm_deviation_bounds *out)
{
    base over;
    qm_deviation_bounds bounds;
    bool is_found = set_patch_base(work, &over) && bound_over_base(work, &over, distance, &bounds);
    bool is_bent = work->face->is_patch && work->shape->slack > 0.0;
    if (!is_found && (is_bent || work->at_centroid < NEAR_BASE * work->shape->radius)) {
        set_facet_base(work, &over);
        is_found = bound_over_base(work, &over, distance, &bounds);
    }
    if (is_found) qm_deviation_bounds_combine(out, &bounds);
    qm_deviation_feature feature;
    if (work->at_centroid > LEAST_APART * work->shape->radius &&
        qm_deviation_feature_under(work->near, work->base, work->shape->centroid, &feature) &&
        set_feature_base(work, &feature, &over) && bound_over_base(work, &over, distance, &bounds))
        qm_deviation_bounds_combine(out, &bounds);
}

/** The two functions by all facets, or by searches where not all are listed, by the centroid and by the corners. */
static void bound_by_all(bound_work *work, const qm_deviation_setup *setup, const qm_deviation_face *face,
                         const qm_deviation_piece *piece, const qm_deviation_shape *shape,
                         qm_deviation_workspace *workspace, double distance[QM_FACET_PACKS][QM_PACK_LANES])
{
    work->setup = setup;
    work->face = face;
    work->piece = piece;
    work->shape = shape;
    work->near = &workspace->near;
    qm_deviation_piece_coefficients(face, piece, work->bezier);
    work->low_sum = -INFINITY;
    work->high_sum = INFINITY;
    for (int i = 0; i < 3; i++)
        work->cap[i] = work->floor[i] = INFINITY;
    for (int i = 0; i < workspace->near.rectangle_count; i++)
        work->matches[i].is_computed = work->matches[i].is_computed_within = false;
    if (workspace->near.is_complete)
        bound_by_facets(work, distance);
    else
        bound_by_searches(work, workspace);
    bound_by_centroid(work);
    bound_by_corners(work);
}

void qm_deviation_piece_bound_near(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                   const qm_deviation_piece *piece, const qm_deviation_shape *shape,
                                   qm_deviation_workspace *workspace, qm_deviation_bounds *out)
{
    bound_work work; /* large, and filled as it is used */
    _Alignas(64) double distance[QM_FACET_PACKS][QM_PACK_LANES];
    bound_by_all(&work, setup, face, piece, shape, workspace, distance);
    out->is_signed = false;
    out->bend.cells = 0;
    out->invalid_low = out->invalid_high = out->excess = 0.0;
    for (int i = 0; i < 3; i++) {
        out->low[i] = work.low[i] - setup->eta;
        out->high[i] = work.high[i] + setup->eta;
    }
    qm_deviation_integrate(shape, out);
    if (workspace->near.is_complete) combine_over_base(&work, distance, out);
}

void qm_deviation_piece_envelope(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                                 qm_deviation_workspace *workspace, double low[3], double high[3])
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    qm_deviation_shape shape = qm_deviation_shape_make(setup, &face, piece);
    bound_work work; /* large, and filled as it is used */
    _Alignas(64) double distance[QM_FACET_PACKS][QM_PACK_LANES];
    qm_deviation_list_facets(setup, &shape, false, workspace);
    bound_by_all(&work, setup, &face, piece, &shape, workspace, distance);
    for (int i = 0; i < 3; i++) {
        low[i] = work.low[i] - setup->eta;
        high[i] = work.high[i] + setup->eta;
    }
}
