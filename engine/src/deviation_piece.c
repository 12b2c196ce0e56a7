#include "deviation_piece.h"

#include "tri_point.h"

#define EPSILON 0x1p-53
#define DIRECTION_ROUNDINGS 32.0 /* in a vector between two points, of the greatest coordinate */
#define AREA_ROUNDINGS 16.0
#define CHANGE_STEPS 30 /* bisections of an edge */
#define INSET 1e-4      /* of the way to the middle */
#define CUT_MARGIN 1e-3 /* of an edge: cuts nearer to its ends are not worth a piece */
#define PATCH_CUTS 32   /* of all patches near a piece; then they are cut no further */

/** A piece on its way to its bounds. */
typedef struct piece_work {
    const qm_piece_maker *maker;
    qm_vec corner[3], middle;
    double radius, longest2; /* greatest distance of a corner from the middle; longest edge squared */
    double slack;            /* how far the piece may be from its flat triangle */
    double near;             /* distance of the middle, known from above */
    double certain;          /* and from below */
    double ball;             /* no facet farther than this from the middle is nearest to any point */
    double low[3], low_sum, high[3], high_sum;
    double facet[3]; /* the least of the facets' planes at each corner */
    double cap[3];   /* the least distance to a facet at each corner */
    int patch_cuts;
    unsigned searches;
} piece_work;

/* ---- the piece in space ---- */

static qm_vec load_vertex(const qm_piece_maker *maker, uint32_t vertex)
{
    return qm_frame_local(&maker->target->frame, maker->source->mesh.positions + 3 * (size_t)vertex);
}

/** Corners of the face: four for a patch, three of a flat face's triangle. */
static bool load_face(const qm_piece_maker *maker, const qm_source_piece *piece, qm_vec corner[4])
{
    const uint32_t *index = maker->source->mesh.faces + 4 * (size_t)piece->face;
    bool is_quad = index[3] != QM_NO_INDEX, is_patch = is_quad && maker->source_patches;
    corner[0] = load_vertex(maker, index[0]);
    corner[1] = load_vertex(maker, index[piece->second ? 2 : 1]);
    corner[2] = load_vertex(maker, index[piece->second ? 3 : 2]);
    if (is_patch) corner[3] = load_vertex(maker, index[3]);
    return is_patch;
}

static qm_vec flat_point(const qm_vec corner[3], double u, double v)
{
    return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(1.0 - u - v, corner[0]), u, corner[1]), v, corner[2]);
}

/** Twice the area of the piece in its parameters. */
static double parameter_area2(const qm_source_piece *piece)
{
    double du1 = piece->u[1] - piece->u[0], dv1 = piece->v[1] - piece->v[0];
    double du2 = piece->u[2] - piece->u[0], dv2 = piece->v[2] - piece->v[0];
    return fabs(du1 * dv2 - du2 * dv1);
}

static double spread(const double x[3])
{
    return fmax(x[0], fmax(x[1], x[2])) - fmin(x[0], fmin(x[1], x[2]));
}

/** What rounding may have done to a cross product of two edges. */
static double cross_error(const qm_piece_maker *maker, qm_vec a, qm_vec b)
{
    double la = qm_vec_norm(a), lb = qm_vec_norm(b);
    return AREA_ROUNDINGS * EPSILON * (la * lb + maker->reach * (la + lb));
}

/** Areas that the whole piece would have if it were spread as at its corners, from below and above. */
typedef struct piece_weights {
    double low[3], high[3];
    bool is_uniform;
} piece_weights;

static void place_flat(piece_work *work, const qm_source_piece *piece, const qm_vec corner[3],
                       piece_weights *weights)
{
    for (int i = 0; i < 3; i++)
        work->corner[i] = flat_point(corner, piece->u[i], piece->v[i]);
    qm_vec a = qm_vec_sub(corner[1], corner[0]), b = qm_vec_sub(corner[2], corner[0]);
    double doubled = qm_vec_norm(qm_vec_cross(a, b)), error = cross_error(work->maker, a, b);
    double share = 0.5 * parameter_area2(piece);
    for (int i = 0; i < 3; i++) {
        weights->low[i] = share * fmax(0.0, doubled - error);
        weights->high[i] = share * (doubled + error);
    }
    work->slack = 0.0;
    weights->is_uniform = true;
}

/** Q_s x Q_t = e1 x e2 + s e1 x w + t w x e2 is linear in s and t: its length is convex. */
static void place_patch(piece_work *work, const qm_source_piece *piece, const qm_vec corner[4],
                        piece_weights *weights)
{
    qm_patch patch = qm_patch_make(corner);
    qm_vec normal[3], sum = {0, 0, 0};
    double share = 0.5 * parameter_area2(piece), error = 0.0;
    for (int i = 0; i < 3; i++) {
        double s = piece->u[i], t = piece->v[i];
        qm_vec along_s = qm_vec_axpy(patch.e1, t, patch.w), along_t = qm_vec_axpy(patch.e2, s, patch.w);
        work->corner[i] = qm_patch_at(&patch, s, t);
        normal[i] = qm_vec_cross(along_s, along_t);
        sum = qm_vec_add(sum, normal[i]);
        error = fmax(error, cross_error(work->maker, along_s, along_t));
    }
    double length = qm_vec_norm(sum);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
    for (int i = 0; i < 3; i++) {
        weights->low[i] = share * fmax(0.0, qm_vec_dot(unit, normal[i]) - error);
        weights->high[i] = share * (qm_vec_norm(normal[i]) + error);
    }
    /* Clamped values are no linear function below the length any more. */
    if (weights->low[0] <= 0.0 || weights->low[1] <= 0.0 || weights->low[2] <= 0.0)
        weights->low[0] = weights->low[1] = weights->low[2] = 0.0;
    work->slack = 0.25 * qm_vec_norm(patch.w) * spread(piece->u) * spread(piece->v);
    weights->is_uniform = qm_vec_norm2(patch.w) == 0.0;
}

static void place(piece_work *work, const qm_source_piece *piece, piece_weights *weights)
{
    qm_vec corner[4];
    if (load_face(work->maker, piece, corner))
        place_patch(work, piece, corner, weights);
    else
        place_flat(work, piece, corner, weights);
    qm_vec sum = qm_vec_add(qm_vec_add(work->corner[0], work->corner[1]), work->corner[2]);
    work->middle = qm_vec_scale(1.0 / 3.0, sum);
    work->radius = work->longest2 = 0.0;
    for (int i = 0; i < 3; i++) {
        work->radius = fmax(work->radius, qm_vec_distance(work->corner[i], work->middle));
        work->longest2 =
            fmax(work->longest2, qm_vec_norm2(qm_vec_sub(work->corner[i], work->corner[(i + 1) % 3])));
    }
}

/* ---- offers ---- */

static void offer_high(piece_work *work, const double high[3])
{
    double sum = high[0] + high[1] + high[2];
    if (!(sum < work->high_sum)) return;
    work->high_sum = sum;
    for (int i = 0; i < 3; i++)
        work->high[i] = high[i];
}

static void offer_low(piece_work *work, const double low[3])
{
    double sum = low[0] + low[1] + low[2];
    if (!(sum > work->low_sum)) return;
    work->low_sum = sum;
    for (int i = 0; i < 3; i++)
        work->low[i] = low[i];
}

/** Heights of the corners over the plane of a facet, on the side that a point lies on. */
static void heights_over_facet(const piece_work *work, const qm_triangle *facet, qm_vec from,
                               double height[3])
{
    double side = qm_vec_dot(qm_vec_sub(from, facet->origin), facet->z) < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 3; i++)
        height[i] = side * qm_vec_dot(qm_vec_sub(work->corner[i], facet->origin), facet->z);
}

/** Heights of the corners over the plane that the facet lies behind as seen from a point of the piece. */
static void heights_from(const piece_work *work, const qm_triangle *facet, qm_vec from, double height[3])
{
    double weight[3];
    qm_triangle_footpoint(facet, from, weight);
    /* Over the facet itself it is the plane of the facet, whose normal is exact however near the point is. */
    if (weight[0] > 0.0 && weight[1] > 0.0 && weight[2] > 0.0) {
        heights_over_facet(work, facet, from, height);
        return;
    }
    double x = weight[1] * facet->length + weight[2] * facet->cx, y = weight[2] * facet->cy;
    qm_vec foot = qm_vec_axpy(qm_vec_axpy(facet->origin, x, facet->x), y, facet->y);
    qm_vec direction = qm_vec_sub(from, foot);
    double distance = qm_vec_norm(direction), error = 0.0;
    if (distance > work->maker->eta) {
        direction = qm_vec_scale(1.0 / distance, direction);
        error = DIRECTION_ROUNDINGS * EPSILON * work->maker->reach * (3.0 * work->radius + 2.0 * work->ball) /
                distance;
    } else {
        direction = (qm_vec){0, 0, 0};
    }
    for (int i = 0; i < 3; i++)
        height[i] = qm_vec_dot(direction, qm_vec_sub(work->corner[i], foot)) - error;
}

/** How much of what the corners' distances may be at most a linear function reaches. */
static double score(const piece_work *work, const double height[3])
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += fmin(height[i], work->cap[i]);
    return sum;
}

/**
 * A facet takes part in the least of the planes with one plane of its own: that of the facet, or one seen
 * from the middle or from a corner. Any is valid; the one that hides least is taken.
 */
static void add_plane(piece_work *work, const qm_triangle *facet, double slack)
{
    double best[3], best_score, full = work->cap[0] + work->cap[1] + work->cap[2];
    heights_over_facet(work, facet, work->middle, best);
    best_score = score(work, best);
    for (int k = 0; k < 4 && best_score < full; k++) {
        double height[3];
        heights_from(work, facet, k == 0 ? work->middle : work->corner[k - 1], height);
        double here = score(work, height);
        if (!(here > best_score)) continue;
        best_score = here;
        for (int i = 0; i < 3; i++)
            best[i] = height[i];
    }
    for (int i = 0; i < 3; i++)
        work->facet[i] = fmin(work->facet[i], best[i] - slack);
}

static void add_facet(piece_work *work, qm_vec a, qm_vec b, qm_vec c, double slack)
{
    qm_triangle facet = qm_triangle_make(a, b, c);
    facet.first = 0;
    double high[3];
    for (int i = 0; i < 3; i++)
        high[i] = sqrt(qm_triangle_distance2(&facet, work->corner[i])) + slack;
    offer_high(work, high);
    if (sqrt(qm_triangle_distance2(&facet, work->middle)) - slack <= work->ball)
        add_plane(work, &facet, slack);
}

/* ---- patches of the target ---- */

typedef struct rectangle {
    qm_vec corner[4];
} rectangle;

static bool is_far(const piece_work *work, const rectangle *r, double twist)
{
    qm_triangle first = qm_triangle_make(r->corner[0], r->corner[1], r->corner[2]);
    qm_triangle second = qm_triangle_make(r->corner[0], r->corner[2], r->corner[3]);
    double d2 =
        fmin(qm_triangle_distance2(&first, work->middle), qm_triangle_distance2(&second, work->middle));
    return sqrt(d2) - twist > work->ball;
}

/** The rectangle in halves, across its longer sides. A part of a bilinear patch is one. */
static void halve(const rectangle *from, rectangle out[2])
{
    const qm_vec *c = from->corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    if (along_s >= along_t) {
        qm_vec low = qm_vec_mix(c[0], c[1], 0.5), high = qm_vec_mix(c[3], c[2], 0.5);
        out[0] = (rectangle){{c[0], low, high, c[3]}};
        out[1] = (rectangle){{low, c[1], c[2], high}};
    } else {
        qm_vec left = qm_vec_mix(c[0], c[3], 0.5), right = qm_vec_mix(c[1], c[2], 0.5);
        out[0] = (rectangle){{c[0], c[1], right, left}};
        out[1] = (rectangle){{left, right, c[2], c[3]}};
    }
}

static void add_rectangle(piece_work *work, const rectangle *r, double twist)
{
    add_facet(work, r->corner[0], r->corner[1], r->corner[2], twist);
    add_facet(work, r->corner[0], r->corner[2], r->corner[3], twist);
}

/** Cuts a patch until its parts near the piece are flat enough, or there is no room for more of them. */
static void add_patch(piece_work *work, const qm_vec corner[4])
{
    rectangle stack[PATCH_CUTS + 2];
    int height = 0;
    stack[height++] = (rectangle){{corner[0], corner[1], corner[2], corner[3]}};
    while (height > 0) {
        rectangle at = stack[--height];
        double twist = qm_patch_twist(at.corner);
        if (is_far(work, &at, twist)) continue;
        if (twist <= work->maker->patch_error || work->patch_cuts == PATCH_CUTS) {
            add_rectangle(work, &at, twist);
            continue;
        }
        work->patch_cuts++;
        halve(&at, stack + height);
        height += 2;
    }
}

/* ---- facets ---- */

static qm_triangle lane_triangle(const qm_pack *pack, uint32_t lane)
{
#define ROW(name) pack->row[QM_ROW_##name][lane]
    return (qm_triangle){.origin = {ROW(OX), ROW(OY), ROW(OZ)},
                         .x = {ROW(XX), ROW(XY), ROW(XZ)},
                         .y = {ROW(YX), ROW(YY), ROW(YZ)},
                         .z = {ROW(ZX), ROW(ZY), ROW(ZZ)},
                         .length = ROW(L),
                         .cx = ROW(CX),
                         .cy = ROW(CY),
                         .inverse_c2 = ROW(INVERSE_C2),
                         .inverse_d2 = ROW(INVERSE_D2)};
#undef ROW
}

static double lane_twist(const qm_piece_maker *maker, uint32_t pack, uint32_t lane)
{
    return maker->target_patches ? (double)maker->target->twist[pack][lane] : 0.0;
}

/** Upper bounds by all facets of a pack. */
static void add_pack_uppers(piece_work *work, uint32_t pack)
{
    const qm_piece_maker *maker = work->maker;
    const qm_pack *packed = &maker->target->packs[pack];
    _Alignas(64) double d2[3][QM_PACK_LANES];
    for (int i = 0; i < 3; i++)
        maker->kernel->pack_distances(packed, work->corner[i], d2[i]);
    for (uint32_t lane = 0; lane < maker->target->lanes[pack].lane_count; lane++) {
        double twist = lane_twist(maker, pack, lane), high[3];
        for (int i = 0; i < 3; i++) {
            high[i] = sqrt(d2[i][lane]) + twist;
            work->cap[i] = fmin(work->cap[i], high[i]);
        }
        offer_high(work, high);
    }
}

/** Planes of the facets of a pack that may be nearest to any point. */
static void add_pack_planes(piece_work *work, uint32_t pack)
{
    const qm_piece_maker *maker = work->maker;
    const qm_pack *packed = &maker->target->packs[pack];
    const qm_pack_lanes *lanes = &maker->target->lanes[pack];
    _Alignas(64) double d2[QM_PACK_LANES];
    maker->kernel->pack_distances(packed, work->middle, d2);
    for (uint32_t lane = 0; lane < lanes->lane_count; lane++) {
        double twist = lane_twist(maker, pack, lane);
        if (sqrt(d2[lane]) - twist > work->ball) continue;
        qm_vec corner[4];
        if (twist <= maker->patch_error || work->patch_cuts == PATCH_CUTS) {
            qm_triangle facet = lane_triangle(packed, lane);
            add_plane(work, &facet, twist);
        } else if (qm_bvh_load_face(maker->target, lanes->face[lane], corner) == 4) {
            add_patch(work, corner);
            if (lane + 1 < lanes->lane_count && lanes->face[lane + 1] == lanes->face[lane]) lane++;
        }
    }
}

/** Bounds by facets; the lower one only when all facets within the ball are known. */
static void bound_by_facets(piece_work *work, uint32_t hint)
{
    const qm_piece_maker *maker = work->maker;
    const qm_box point = {{work->middle.x, work->middle.y, work->middle.z},
                          {work->middle.x, work->middle.y, work->middle.z}};
    qm_near_packs near;
    bool has_hint = false;
    maker->kernel->gather(maker->target, &point, work->ball, &near);
    for (int i = 0; i < near.count; i++) {
        add_pack_uppers(work, near.pack[i]);
        has_hint |= near.pack[i] == hint;
    }
    if (!has_hint) add_pack_uppers(work, hint);
    if (near.count == 0 || near.count == QM_NEAR_PACKS) return;
    for (int i = 0; i < near.count; i++)
        add_pack_planes(work, near.pack[i]);
    offer_low(work, work->facet);
}

/* ---- distances ---- */

/** Nearest point of the target: the distance from above, and from below through *certain. */
static double search(piece_work *work, qm_vec p, uint32_t *hint, double *certain)
{
    const qm_piece_maker *maker = work->maker;
    qm_hit hit = {.d2 = INFINITY, .pack = *hint};
    maker->kernel->closest(maker->target, p, &hit);
    *hint = hit.pack;
    work->searches++;
    *certain = sqrt(hit.d2);
    if (!maker->target_patches) return *certain;
    qm_patch_hit patch;
    maker->kernel->closest_patch(maker->target, p, hit.pack, maker->patch_error, &patch);
    *certain = fmax(0.0, patch.lower);
    return patch.distance;
}

/** Lower bound by the distances of the corners, where it can be better than what there is. */
static void bound_by_corners(piece_work *work, uint32_t hint)
{
    double third = work->longest2 / 3.0, sure2 = work->certain * work->certain;
    if (!(sure2 > third) || !(3.0 * sqrt(sure2 - third) > work->low_sum)) return;
    double low[3];
    for (int i = 0; i < 3; i++) {
        double certain;
        uint32_t near = hint;
        search(work, work->corner[i], &near, &certain);
        if (near != hint) add_pack_uppers(work, near);
        if (certain * certain < third) return;
        low[i] = sqrt(certain * certain - third);
    }
    offer_low(work, low);
}

static void bound_by_middle(piece_work *work)
{
    double sure = fmax(0.0, work->certain - work->radius);
    const double low[3] = {sure, sure, sure};
    offer_low(work, low);
    double most = fmin(work->near + work->radius, work->maker->greatest + work->slack);
    const double high[3] = {most, most, most};
    offer_high(work, high);
}

/* ---- integrals ---- */

static double sum3(const double x[3])
{
    return x[0] + x[1] + x[2];
}

static double least(const double x[3])
{
    return fmin(x[0], fmin(x[1], x[2]));
}

static double greatest(const double x[3])
{
    return fmax(x[0], fmax(x[1], x[2]));
}

/** Mean over a triangle of the product of two linear functions. */
static double mean_product(const double f[3], const double g[3])
{
    return (sum3(f) * sum3(g) + f[0] * g[0] + f[1] * g[1] + f[2] * g[2]) / 12.0;
}

/** Integral of max(f, 0)^2 from below. */
static double square_below(const double f[3], const piece_weights *w)
{
    double mean = fmax(0.0, sum3(f) / 3.0);
    double by_mean = least(w->low) * mean * mean;
    if (least(f) < 0.0) return by_mean;
    if (w->is_uniform) return w->low[0] * mean_product(f, f);
    /* f^2 lies above its tangent at the middle, which is linear. */
    double tangent[3];
    for (int i = 0; i < 3; i++)
        tangent[i] = (2.0 * f[i] - mean) * mean;
    return least(tangent) < 0.0 ? by_mean : fmax(by_mean, mean_product(tangent, w->low));
}

/** Integral of f^2, f >= 0, from above; f^2 is convex. */
static double square_above(const double f[3], const piece_weights *w)
{
    if (w->is_uniform) return w->high[0] * mean_product(f, f);
    const double f2[3] = {f[0] * f[0], f[1] * f[1], f[2] * f[2]};
    return mean_product(f2, w->high);
}

static void integrate(const piece_weights *w, qm_piece_bounds *out)
{
    out->area_low = sum3(w->low) / 3.0;
    out->area_high = sum3(w->high) / 3.0;
    out->density_low = least(w->low);
    out->density_high = greatest(w->high);
    out->mean_low = least(out->low) >= 0.0 ? mean_product(out->low, w->low)
                                           : out->density_low * fmax(0.0, sum3(out->low) / 3.0);
    out->mean_high = mean_product(out->high, w->high);
    out->square_low = square_below(out->low, w);
    out->square_high = square_above(out->high, w);
}

/* ---- the calls ---- */

unsigned qm_piece_bound(const qm_piece_maker *maker, const qm_source_piece *piece, uint32_t *hint,
                        qm_piece_bounds *out)
{
    piece_work work = {.maker = maker,
                       .low_sum = -INFINITY,
                       .high_sum = INFINITY,
                       .facet = {INFINITY, INFINITY, INFINITY},
                       .cap = {INFINITY, INFINITY, INFINITY}};
    piece_weights weights;
    place(&work, piece, &weights);
    work.near = search(&work, work.middle, hint, &work.certain);
    work.ball = work.near + 2.0 * work.radius + 4.0 * maker->eta;
    bound_by_middle(&work);
    bound_by_facets(&work, *hint);
    bound_by_corners(&work, *hint);
    for (int i = 0; i < 3; i++) {
        out->low[i] = work.low[i] - work.slack - maker->eta;
        out->high[i] = work.high[i] + work.slack + maker->eta;
    }
    integrate(&weights, out);
    return work.searches;
}

qm_piece_bounds qm_piece_bound_point(double distance, double eta)
{
    double low = distance - eta, high = distance + eta, sure = fmax(0.0, low);
    return (qm_piece_bounds){
        .low = {low, low, low},
        .high = {high, high, high},
        .area_low = 1.0,
        .area_high = 1.0,
        .density_low = 1.0,
        .density_high = 1.0,
        .mean_low = sure,
        .mean_high = high,
        .square_low = sure * sure,
        .square_high = high * high,
    };
}

/* ---- cutting ---- */

/** The facet under a point. */
typedef struct near_facet {
    qm_triangle triangle;
    uint32_t pack, lane, face;
} near_facet;

static double height_over(const near_facet *facet, qm_vec p)
{
    return qm_vec_dot(qm_vec_sub(p, facet->triangle.origin), facet->triangle.z);
}

static near_facet find_facet(const qm_piece_maker *maker, qm_vec p, uint32_t *hint)
{
    qm_hit hit = {.d2 = INFINITY, .pack = *hint};
    maker->kernel->closest(maker->target, p, &hit);
    *hint = hit.pack;
    near_facet found = {.triangle = lane_triangle(&maker->target->packs[hit.pack], hit.lane),
                        .pack = hit.pack,
                        .lane = hit.lane,
                        .face = maker->target->lanes[hit.pack].face[hit.lane]};
    return found;
}

/** The triangles of a patch count as one facet: where one ends is no matter. */
static bool is_same_facet(const qm_piece_maker *maker, const near_facet *a, const near_facet *b)
{
    return (a->pack == b->pack && a->lane == b->lane) || (maker->target_patches && a->face == b->face);
}

/** Where on the way from one point to another the facet under the first stops being nearer than the second.
 */
static double find_change(const near_facet *a, const near_facet *b, qm_vec from, qm_vec to)
{
    double low = 0.0, high = 1.0;
    for (int step = 0; step < CHANGE_STEPS; step++) {
        double share = 0.5 * (low + high);
        qm_vec p = qm_vec_mix(from, to, share);
        bool is_nearer = qm_triangle_distance2(&a->triangle, p) <= qm_triangle_distance2(&b->triangle, p);
        *(is_nearer ? &low : &high) = share;
    }
    return 0.5 * (low + high);
}

/** Where an edge is best cut: where it passes through the facet under it, or from one facet into the next; 0
 * for nowhere, also when another facet lies between. */
static double find_cut(const qm_piece_maker *maker, const near_facet *a, const near_facet *b, qm_vec from,
                       qm_vec to)
{
    double share = 0.0;
    if (!is_same_facet(maker, a, b)) {
        uint32_t hint = b->pack;
        share = find_change(a, b, from, to);
        near_facet at = find_facet(maker, qm_vec_mix(from, to, share), &hint);
        if (!is_same_facet(maker, &at, a) && !is_same_facet(maker, &at, b)) share = 0.0;
    } else {
        double from_height = height_over(a, from), to_height = height_over(a, to);
        if (from_height * to_height < 0.0) share = from_height / (from_height - to_height);
    }
    return share > CUT_MARGIN && share < 1.0 - CUT_MARGIN ? share : 0.0;
}

/** Corners of the parts of a piece: 0 to 2 are its own, 3 to 5 lie on the edges that start at these. */
typedef struct part_corners {
    double u[6], v[6];
} part_corners;

static qm_source_piece make_part(const qm_source_piece *piece, const part_corners *at, int a, int b, int c)
{
    qm_source_piece part = *piece;
    const int corner[3] = {a, b, c};
    part.depth++;
    for (int i = 0; i < 3; i++) {
        part.u[i] = at->u[corner[i]];
        part.v[i] = at->v[corner[i]];
    }
    return part;
}

/** Cuts a piece at a place on each edge whose share is not 0: one or two of them. */
static int cut_at(const qm_source_piece *piece, const double share[3], qm_source_piece out[3])
{
    part_corners at;
    int cuts = 0, first = 0; /* the edge with the only cut, or the one that ends where the other begins */
    for (int i = 0; i < 3; i++) {
        int next = (i + 1) % 3;
        at.u[i] = piece->u[i];
        at.v[i] = piece->v[i];
        at.u[3 + i] = piece->u[i] + share[i] * (piece->u[next] - piece->u[i]);
        at.v[3 + i] = piece->v[i] + share[i] * (piece->v[next] - piece->v[i]);
        cuts += share[i] > 0.0;
        if (share[i] > 0.0 && !(share[(i + 2) % 3] > 0.0)) first = i;
    }
    int a = first, b = (first + 1) % 3, c = (first + 2) % 3;
    if (cuts == 1) {
        out[0] = make_part(piece, &at, a, 3 + a, c);
        out[1] = make_part(piece, &at, 3 + a, b, c);
        return 2;
    }
    out[0] = make_part(piece, &at, 3 + a, b, 3 + b);
    out[1] = make_part(piece, &at, a, 3 + a, 3 + b);
    out[2] = make_part(piece, &at, a, 3 + b, c);
    return 3;
}

/** Places on the edges where a piece is cut along the line between two facets of the target, or along the
 * line where it passes through one. False when it lies over more facets, or over one on one side. */
static bool find_line(const piece_work *work, double share[3])
{
    const qm_piece_maker *maker = work->maker;
    near_facet facet[3];
    qm_vec inside[3]; /* corners moved off the lines between facets, as those of cut pieces lie on them */
    uint32_t hint = 0;
    int changes = 0, cuts = 0;
    for (int i = 0; i < 3; i++) {
        inside[i] = qm_vec_mix(work->corner[i], work->middle, INSET);
        facet[i] = find_facet(maker, inside[i], &hint);
    }
    for (int i = 0; i < 3; i++)
        changes += !is_same_facet(maker, &facet[i], &facet[(i + 1) % 3]);
    if (changes == 3) return false;
    for (int i = 0; i < 3; i++) {
        int next = (i + 1) % 3;
        bool may_cut = changes == 0 || !is_same_facet(maker, &facet[i], &facet[next]);
        share[i] =
            may_cut ? find_cut(maker, &facet[i], &facet[next], work->corner[i], work->corner[next]) : 0.0;
        cuts += share[i] > 0.0;
    }
    return cuts > 0;
}

/**
 * Both bounds are tight over a single facet of the target and on one side of it: a piece over two facets is
 * cut along the line between them. Any other is halved across its longest edge, and so is every piece on
 * every sixth level, which brings any piece to an end.
 */
int qm_piece_cut(const qm_piece_maker *maker, const qm_source_piece *piece, qm_source_piece out[3])
{
    piece_work work = {.maker = maker};
    piece_weights weights;
    place(&work, piece, &weights);
    double share[3] = {0.0, 0.0, 0.0}, longest2 = -1.0;
    if (piece->depth % 6 != 5 && find_line(&work, share)) return cut_at(piece, share, out);
    int longest = 0; /* of the edges, each from its corner to the next */
    for (int i = 0; i < 3; i++) {
        double edge2 = qm_vec_norm2(qm_vec_sub(work.corner[i], work.corner[(i + 1) % 3]));
        share[i] = 0.0;
        if (edge2 > longest2) {
            longest2 = edge2;
            longest = i;
        }
    }
    share[longest] = 0.5;
    return cut_at(piece, share, out);
}
