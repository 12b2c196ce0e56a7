#include "wide_surface.h"

#include <stdio.h>
#include <stdlib.h>

/* ---- frames and surfaces ---- */

static void widen_span(const qm_mesh *mesh, const double origin[3], qm_wide *span)
{
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++) {
        qm_wide gap = (qm_wide)mesh->positions[i] - origin[i % 3];
        *span = qm_wide_greatest(*span, gap < 0 ? -gap : gap);
    }
}

qm_wide_frame qm_wide_frame_make(const qm_mesh *a, const qm_mesh *b)
{
    const double *origin = a->positions;
    qm_wide span = 0, scale = 1;
    widen_span(a, origin, &span);
    if (b) widen_span(b, origin, &span);
    while (span > 0 && span * scale > 1)
        scale /= 2;
    while (span > 0 && span * scale <= (qm_wide)0.5)
        scale *= 2;
    return (qm_wide_frame){{origin[0], origin[1], origin[2]}, scale};
}

qm_wide_vec qm_wide_local(const qm_wide_frame *frame, const double p[3])
{
    return qm_wide_scale(frame->scale, qm_wide_sub((qm_wide_vec){p[0], p[1], p[2]}, frame->origin));
}

static qm_wide_facet make_facet(uint32_t face, const qm_wide_vec *corner, int count)
{
    qm_wide_facet out = {.corner_count = count, .face = face};
    qm_long_vec sum = {0, 0, 0};
    for (int i = 0; i < count; i++) {
        out.corner[i] = corner[i];
        out.rounded[i] = qm_wide_round(corner[i]);
        sum = qm_long_add(sum, out.rounded[i]);
        for (int j = 0; j < i; j++)
            out.size = qm_wide_greatest(out.size, qm_wide_length(qm_wide_sub(corner[i], corner[j])));
    }
    out.centre = qm_long_scale(1 / (qm_long)count, sum);
    for (int i = 0; i < count; i++)
        out.radius = qm_long_greatest(out.radius, qm_long_length(qm_long_sub(out.rounded[i], out.centre)));
    out.radius += 0x1p-60L * (1 + qm_long_length(out.centre));
    return out;
}

qm_wide_surface qm_wide_surface_make(const qm_wide_frame *frame, const qm_mesh *mesh, qm_quad_reading reading)
{
    size_t faces = mesh->face_count ? mesh->face_count : mesh->vertex_count;
    qm_wide_surface out = {malloc(2 * faces * sizeof *out.facets), 0};
    if (!out.facets) {
        fprintf(stderr, "out of memory for a surface\n");
        abort();
    }
    for (size_t f = 0; f < faces; f++) {
        const uint32_t own[4] = {(uint32_t)f, QM_NO_INDEX, QM_NO_INDEX, QM_NO_INDEX};
        const uint32_t *index = mesh->face_count ? mesh->faces + 4 * f : own;
        int count = index[1] == QM_NO_INDEX ? 1 : index[3] == QM_NO_INDEX ? 3 : 4;
        qm_wide_vec c[4];
        for (int i = 0; i < count; i++)
            c[i] = qm_wide_local(frame, mesh->positions + 3 * (size_t)index[i]);
        bool is_cut = count == 4 && reading == QM_QUADS_TRIANGLES;
        out.facets[out.count++] = make_facet((uint32_t)f, c, is_cut ? 3 : count);
        if (is_cut) out.facets[out.count++] = make_facet((uint32_t)f, (qm_wide_vec[]){c[0], c[2], c[3]}, 3);
    }
    return out;
}

void qm_wide_surface_free(qm_wide_surface *surface)
{
    free(surface->facets);
    *surface = (qm_wide_surface){0};
}

qm_wide_vec qm_wide_facet_at(const qm_wide_facet *facet, qm_wide u, qm_wide v)
{
    const qm_wide_vec *c = facet->corner;
    if (facet->corner_count == 1) return c[0];
    if (facet->corner_count == 4)
        return qm_wide_lerp(qm_wide_lerp(c[0], c[1], u), qm_wide_lerp(c[3], c[2], u), v);
    return qm_wide_axpy(qm_wide_axpy(c[0], u, qm_wide_sub(c[1], c[0])), v, qm_wide_sub(c[2], c[0]));
}

/* ---- segments and triangles ---- */

/** Distance from the origin of the space to a segment; the share of b in the nearest point goes to *at. */
static qm_wide segment_distance(qm_wide_vec a, qm_wide_vec b, qm_wide *at)
{
    qm_wide_vec side = qm_wide_sub(b, a);
    qm_wide square = qm_wide_dot(side, side);
    *at = square > 0 ? qm_wide_clamp(-qm_wide_dot(a, side) / square) : 0;
    return qm_wide_length(qm_wide_axpy(a, *at, side));
}

static void keep(qm_wide_distance *best, qm_wide distance, qm_wide u, qm_wide v)
{
    if (!(distance < best->upper)) return;
    best->upper = distance;
    best->uv[0] = u;
    best->uv[1] = v;
}

/** Keeps the nearest point of a segment, whose ends have these parameters. */
static void keep_side(qm_wide_distance *best, qm_wide_vec a, qm_wide_vec b, const int a_uv[2],
                      const int b_uv[2])
{
    qm_wide at, distance = segment_distance(a, b, &at);
    keep(best, distance, (1 - at) * a_uv[0] + at * b_uv[0], (1 - at) * a_uv[1] + at * b_uv[1]);
}

static const int corner_uv[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};

/** a, b, c relative to the point. The nearest of the three sides, and the plane where the point lies over the
 * inside. */
static qm_wide_distance triangle_distance(qm_wide_vec a, qm_wide_vec b, qm_wide_vec c)
{
    qm_wide_distance out = {.upper = INFINITY};
    keep_side(&out, a, b, corner_uv[0], corner_uv[1]);
    keep_side(&out, b, c, corner_uv[1], corner_uv[3]);
    keep_side(&out, c, a, corner_uv[3], corner_uv[0]);
    out.lower = out.upper;
    qm_wide_vec ab = qm_wide_sub(b, a), ac = qm_wide_sub(c, a), n = qm_wide_cross(ab, ac);
    qm_wide square = qm_wide_dot(n, n), sides = qm_wide_dot(ab, ab) * qm_wide_dot(ac, ac);
    /* Thinner than 2^-64 of its sides, the inside is no nearer than the sides but by so much. */
    if (!(square > 0x1p-128L * sides)) {
        out.lower = qm_wide_greatest(0, out.upper - 0x1p-63L * qm_wide_sqrt(sides > 0 ? sides : 0));
        return out;
    }
    qm_wide u = -qm_wide_dot(qm_wide_cross(a, ac), n) / square;
    qm_wide v = -qm_wide_dot(qm_wide_cross(ab, a), n) / square;
    if (u < 0 || v < 0 || u + v > 1) return out;
    qm_wide height = qm_wide_dot(n, a) / qm_wide_sqrt(square);
    keep(&out, height < 0 ? -height : height, u, v);
    /* The normal is off by a few 2^-113 |ab| |ac|, the height by its angle times the way to a. */
    qm_wide error = 0x1p-108L * qm_wide_sqrt(sides / square) * qm_wide_length(a);
    out.lower = qm_wide_greatest(0, out.upper - error);
    return out;
}

/* ---- patches ---- */

/**
 * A patch relative to the point, as segments a(s) to b(s) between two of its sides, which for each s are
 * exact: the distance to the patch is the least over s of that to the segment.
 */
typedef struct rulings {
    qm_wide_vec a[2], b[2]; /* at s = 0 and 1 */
    qm_wide speed;          /* greatest way of an end while s goes from 0 to 1 */
} rulings;

static qm_wide_vec ruling_end(const qm_wide_vec side[2], qm_wide s)
{
    return qm_wide_axpy(qm_wide_scale(1 - s, side[0]), s, side[1]);
}

/** Bernstein coefficients of the square of a quadratic vector with coefficients c, of degree 4. */
static void square_of(const qm_wide_vec c[3], qm_wide out[5])
{
    out[0] = qm_wide_dot(c[0], c[0]);
    out[1] = qm_wide_dot(c[0], c[1]);
    out[2] = (2 * qm_wide_dot(c[1], c[1]) + qm_wide_dot(c[0], c[2])) / 3;
    out[3] = qm_wide_dot(c[1], c[2]);
    out[4] = qm_wide_dot(c[2], c[2]);
}

/** The same coefficients for a quadratic number, raised to degree 4. */
static void raise_degree(const qm_wide c[3], qm_wide out[5])
{
    out[0] = c[0];
    out[1] = (c[0] + c[1]) / 2;
    out[2] = (c[0] + 4 * c[1] + c[2]) / 6;
    out[3] = (c[1] + c[2]) / 2;
    out[4] = c[2];
}

/**
 * True when the insides of the rulings from s0 to s1 are proven to be target away from the origin at least,
 * or no nearer than the sides that they end on.
 *
 * With e = b - a, the foot on the line of a ruling is at t = -a.e / |e|^2: beyond an end throughout when all
 * Bernstein coefficients of that quadratic say so. The distance of the line is |a x e| / |e|, so that
 * |a x e|^2 - target^2 |e|^2 >= 0 is wanted, a quartic, again by its coefficients. Those are off by a few
 * 2^-113 of the greatest of |a x e|^2, which 2^-105 covers.
 */
static bool are_far(const rulings *r, qm_wide s0, qm_wide s1, qm_wide target)
{
    const qm_wide_vec a[2] = {ruling_end(r->a, s0), ruling_end(r->a, s1)};
    const qm_wide_vec e[2] = {qm_wide_sub(ruling_end(r->b, s0), a[0]),
                              qm_wide_sub(ruling_end(r->b, s1), a[1])};
    const qm_wide length2[3] = {qm_wide_dot(e[0], e[0]), qm_wide_dot(e[0], e[1]), qm_wide_dot(e[1], e[1])};
    const qm_wide foot[3] = {-qm_wide_dot(a[0], e[0]),
                             -(qm_wide_dot(a[0], e[1]) + qm_wide_dot(a[1], e[0])) / 2,
                             -qm_wide_dot(a[1], e[1])};
    bool before = true, after = true;
    for (int i = 0; i < 3; i++) {
        before = before && foot[i] <= 0;
        after = after && foot[i] >= length2[i];
    }
    if (before || after) return true;
    const qm_wide_vec across[3] = {
        qm_wide_cross(a[0], e[0]),
        qm_wide_scale((qm_wide)0.5, qm_wide_add(qm_wide_cross(a[0], e[1]), qm_wide_cross(a[1], e[0]))),
        qm_wide_cross(a[1], e[1])};
    qm_wide area2[5], wanted[5], greatest = 0;
    square_of(across, area2);
    raise_degree(length2, wanted);
    for (int i = 0; i < 3; i++)
        greatest = qm_wide_greatest(greatest, qm_wide_dot(across[i], across[i]));
    for (int i = 0; i < 5; i++)
        if (!(area2[i] - target * target * wanted[i] >= 0x1p-105L * greatest)) return false;
    return true;
}

typedef struct interval {
    qm_wide s0, s1;
    int depth;
} interval;

/** Half the derivative by s of the least squared distance on the ruling at s, whose foot is at *t. */
static qm_wide slope_at(const rulings *r, qm_wide s, qm_wide *t)
{
    qm_wide_vec a = ruling_end(r->a, s), b = ruling_end(r->b, s);
    segment_distance(a, b, t);
    qm_wide_vec along = qm_wide_lerp(qm_wide_sub(r->a[1], r->a[0]), qm_wide_sub(r->b[1], r->b[0]), *t);
    return qm_wide_dot(qm_wide_lerp(a, b, *t), along);
}

/** Goes from s down to a minimum: to where the slope changes its sign, in strides that double and then by
 * bisection and the rule of false position by turns. */
static qm_wide go_down(const rulings *r, qm_wide s, qm_wide stride)
{
    qm_wide t, slope = slope_at(r, s, &t), end = s, end_slope = slope;
    qm_wide way = slope > 0 ? -stride : stride;
    while (slope != 0 && (end_slope > 0) == (slope > 0)) {
        s = end;
        slope = end_slope;
        end = qm_wide_clamp(s + way);
        if (end == s) return s;
        end_slope = slope_at(r, end, &t);
        way *= 2;
    }
    for (int turn = 0; turn < 160 && slope != end_slope && s != end; turn++) {
        qm_wide share = turn % 2 ? (qm_wide)0.5 : slope / (slope - end_slope);
        qm_wide middle = s + share * (end - s), middle_slope = slope_at(r, middle, &t);
        if (middle == s || middle == end) break;
        bool is_like_end = (middle_slope > 0) == (end_slope > 0);
        *(is_like_end ? &end : &s) = middle;
        *(is_like_end ? &end_slope : &slope) = middle_slope;
    }
    return s;
}

/** The distance of the patch from below, up to target; *nearer is set to an s whose ruling is nearer than
 * best by more than slack, if such a one is met. */
static qm_wide certify(const rulings *r, qm_wide target, qm_wide best, qm_wide slack, interval *nearer)
{
    enum { DEPTH = 75, LIMIT = 3000 };
    interval stack[DEPTH + 2];
    int height = 0;
    stack[height++] = (interval){0, 1, 0};
    qm_wide lower = target;
    for (int looked = 0; height > 0; looked++) {
        interval at = stack[--height];
        qm_wide s = (at.s0 + at.s1) / 2, t;
        qm_wide here = segment_distance(ruling_end(r->a, s), ruling_end(r->b, s), &t);
        if (here < best - slack) {
            *nearer = at;
            return 0;
        }
        /* Rulings of the interval have their ends within half its length of the middle one's. */
        qm_wide least = here - (at.s1 - at.s0) / 2 * r->speed * (1 + 0x1p-100L);
        if (least >= target || are_far(r, at.s0, at.s1, target)) continue;
        if (at.depth == DEPTH || looked > LIMIT) {
            lower = qm_wide_least(lower, least);
            continue;
        }
        stack[height++] = (interval){s, at.s1, at.depth + 1};
        stack[height++] = (interval){at.s0, s, at.depth + 1};
    }
    return qm_wide_greatest(0, lower);
}

/** Goes on from a point of the patch: in long double first, then by Newton in 113 bits. */
static void improve(const qm_wide_vec c[4], qm_wide u, qm_wide v, qm_wide_distance *best)
{
    qm_wide_facet facet = {.corner_count = 4};
    for (int i = 0; i < 4; i++)
        facet.rounded[i] = qm_wide_round(c[i]);
    qm_long start[2] = {(qm_long)u, (qm_long)v};
    qm_wide_facet_near(&facet, (qm_long_vec){0, 0, 0}, start);
    qm_wide x[2] = {start[0], start[1]};
    const qm_wide_vec e1 = qm_wide_sub(c[1], c[0]), e2 = qm_wide_sub(c[3], c[0]);
    const qm_wide_vec w = qm_wide_sub(qm_wide_sub(c[2], c[1]), e2);
    for (int step = 0; step < 4; step++) {
        qm_wide_vec along_u = qm_wide_axpy(e1, x[1], w), along_v = qm_wide_axpy(e2, x[0], w);
        qm_wide_vec gap = qm_wide_axpy(qm_wide_axpy(c[0], x[0], e1), x[1], along_v);
        qm_wide before = best->upper;
        keep(best, qm_wide_length(gap), x[0], x[1]);
        if (step > 0 && !(best->upper < before)) break;
        qm_wide uu = qm_wide_dot(along_u, along_u), vv = qm_wide_dot(along_v, along_v);
        qm_wide uv = qm_wide_dot(along_u, along_v) + qm_wide_dot(gap, w), determinant = uu * vv - uv * uv;
        qm_wide gu = qm_wide_dot(gap, along_u), gv = qm_wide_dot(gap, along_v);
        if (!(determinant > 0)) break;
        qm_wide to[2] = {x[0] - (vv * gu - uv * gv) / determinant, x[1] - (uu * gv - uv * gu) / determinant};
        if (to[0] < 0 || to[0] > 1 || to[1] < 0 || to[1] > 1) break;
        x[0] = to[0];
        x[1] = to[1];
    }
}

enum { ROUNDS = 12 }; /* of a certificate, each from a nearer point than the last */

/** c relative to the point. */
static qm_wide_distance patch_distance(const qm_wide_vec c[4], qm_wide size, qm_wide eps, qm_wide enough)
{
    qm_wide_distance best = {.upper = INFINITY};
    for (int i = 0; i < 4; i++)
        keep_side(&best, c[i], c[(i + 1) % 4], corner_uv[i], corner_uv[(i + 1) % 4]);
    const qm_wide start = (qm_wide)0.5;
    improve(c, start, start, &best);
    /* Rulings that run between the shorter sides move less. */
    qm_wide along_u =
        qm_wide_greatest(qm_wide_length(qm_wide_sub(c[1], c[0])), qm_wide_length(qm_wide_sub(c[2], c[3])));
    qm_wide along_v =
        qm_wide_greatest(qm_wide_length(qm_wide_sub(c[3], c[0])), qm_wide_length(qm_wide_sub(c[2], c[1])));
    bool by_v = along_v < along_u;
    rulings r = {{c[0], by_v ? c[3] : c[1]}, {by_v ? c[1] : c[3], c[2]}, by_v ? along_v : along_u};
    /* The distance of a few roundings below the best is no reason to begin again. */
    qm_wide slack = eps / 8 + 0x1p-90L * size;
    for (int round = 0; round < ROUNDS; round++) {
        interval nearer = {-1, -1, 0};
        qm_wide target = qm_wide_least(best.upper, enough) - eps;
        best.lower = 0;
        if (!(target > 0)) break;
        best.lower = certify(&r, target, best.upper, round + 1 < ROUNDS ? slack : INFINITY, &nearer);
        if (nearer.s0 < 0) break;
        /* A stride may cross a minimum and a maximum and end higher, so the start counts too. */
        qm_wide middle = (nearer.s0 + nearer.s1) / 2;
        const qm_wide along[2] = {middle, go_down(&r, middle, (nearer.s1 - nearer.s0) / 2)};
        for (int i = 0; i < 2; i++) {
            qm_wide s = along[i], at;
            qm_wide distance = segment_distance(ruling_end(r.a, s), ruling_end(r.b, s), &at);
            keep(&best, distance, by_v ? at : s, by_v ? s : at);
            improve(c, best.uv[0], best.uv[1], &best);
        }
    }
    best.lower = qm_wide_least(best.lower, best.upper);
    return best;
}

qm_wide_distance qm_wide_facet_distance(const qm_wide_facet *facet, qm_wide_vec p, qm_wide eps,
                                        qm_wide enough)
{
    qm_wide_vec c[4];
    for (int i = 0; i < facet->corner_count; i++)
        c[i] = qm_wide_sub(facet->corner[i], p);
    if (facet->corner_count == 4) return patch_distance(c, facet->size, eps, enough);
    if (facet->corner_count == 3) return triangle_distance(c[0], c[1], c[2]);
    qm_wide d = qm_wide_length(c[0]);
    return (qm_wide_distance){.lower = d, .upper = d};
}

qm_wide_distance qm_wide_surface_distance(const qm_wide_surface *surface, qm_wide_vec p, qm_wide eps)
{
    qm_wide_distance out = {.lower = INFINITY, .upper = INFINITY};
    qm_long_vec rounded = qm_wide_round(p);
    for (size_t f = 0; f < surface->count; f++) {
        const qm_wide_facet *facet = &surface->facets[f];
        qm_long away = qm_long_length(qm_long_sub(rounded, facet->centre)) * (1 - 0x1p-60L) - facet->radius;
        if (away - 0x1p-60L * qm_long_length(rounded) >= out.upper) continue;
        qm_wide_distance d = qm_wide_facet_distance(facet, p, eps, out.upper);
        out.lower = qm_wide_least(out.lower, d.lower);
        if (d.upper < out.upper) {
            qm_wide lower = out.lower;
            out = d;
            out.lower = lower;
            out.facet = f;
        }
    }
    out.lower = qm_wide_least(out.lower, out.upper);
    return out;
}

/* ---- near points in long double ---- */

static qm_long near_triangle(const qm_long_vec corner[3], qm_long_vec p, qm_long uv[2])
{
    const qm_long_vec a = qm_long_sub(corner[0], p), b = qm_long_sub(corner[1], p),
                      c = qm_long_sub(corner[2], p);
    const qm_long_vec ab = qm_long_sub(b, a), ac = qm_long_sub(c, a), bc = qm_long_sub(c, b);
    qm_long bb = qm_long_dot(ab, ab), cc = qm_long_dot(ac, ac), dd = qm_long_dot(bc, bc);
    qm_long s = bb > 0 ? qm_long_clamp(-qm_long_dot(a, ab) / bb) : 0;
    qm_long t = cc > 0 ? qm_long_clamp(-qm_long_dot(a, ac) / cc) : 0;
    qm_long r = dd > 0 ? qm_long_clamp(-qm_long_dot(b, bc) / dd) : 0;
    const qm_long tries[3][2] = {{s, 0}, {0, t}, {1 - r, r}};
    const qm_long_vec gaps[3] = {qm_long_axpy(a, s, ab), qm_long_axpy(a, t, ac), qm_long_axpy(b, r, bc)};
    qm_long best = INFINITY;
    for (int i = 0; i < 3; i++) {
        qm_long square = qm_long_dot(gaps[i], gaps[i]);
        if (!(square < best)) continue;
        best = square;
        uv[0] = tries[i][0];
        uv[1] = tries[i][1];
    }
    qm_long_vec n = qm_long_cross(ab, ac);
    qm_long square = qm_long_dot(n, n);
    if (square > 0) {
        qm_long u = -qm_long_dot(qm_long_cross(a, ac), n) / square;
        qm_long v = -qm_long_dot(qm_long_cross(ab, a), n) / square;
        qm_long_vec gap = qm_long_axpy(qm_long_axpy(a, u, ab), v, ac);
        if (u >= 0 && v >= 0 && u + v <= 1 && qm_long_dot(gap, gap) < best) {
            best = qm_long_dot(gap, gap);
            uv[0] = u;
            uv[1] = v;
        }
    }
    return sqrtl(best);
}

/** A patch relative to a point, in powers of u and v. */
typedef struct long_patch {
    qm_long_vec origin, e1, e2, w;
} long_patch;

static qm_long_vec gap_at(const long_patch *q, const qm_long x[2])
{
    return qm_long_axpy(qm_long_axpy(q->origin, x[0], q->e1), x[1], qm_long_axpy(q->e2, x[0], q->w));
}

static qm_long square_at(const long_patch *q, const qm_long x[2])
{
    qm_long_vec gap = gap_at(q, x);
    return qm_long_dot(gap, gap);
}

/** The exact best along one axis. */
static void settle(const long_patch *q, qm_long x[2], int axis)
{
    qm_long_vec along = axis == 0 ? qm_long_axpy(q->e1, x[1], q->w) : qm_long_axpy(q->e2, x[0], q->w);
    qm_long square = qm_long_dot(along, along);
    if (square > 0) x[axis] = qm_long_clamp(x[axis] - qm_long_dot(gap_at(q, x), along) / square);
}

/** Keeps to in best when it is nearer. */
static void keep_nearer(const long_patch *q, const qm_long to[2], qm_long best[2], qm_long *square)
{
    qm_long here = square_at(q, to);
    if (!(here < *square)) return;
    *square = here;
    best[0] = to[0];
    best[1] = to[1];
}

/** Tries the minimum of a quadratic model with this mixed derivative, and where it leaves the square the best
 * point of the two sides that it leaves by. */
static void try_model(const long_patch *q, const qm_long x[2], qm_long bend, qm_long best[2], qm_long *square)
{
    qm_long_vec gap = gap_at(q, x);
    qm_long_vec along_u = qm_long_axpy(q->e1, x[1], q->w), along_v = qm_long_axpy(q->e2, x[0], q->w);
    qm_long uu = qm_long_dot(along_u, along_u), vv = qm_long_dot(along_v, along_v);
    qm_long uv = qm_long_dot(along_u, along_v) + bend * qm_long_dot(gap, q->w),
            determinant = uu * vv - uv * uv;
    if (!(determinant > 0)) return;
    qm_long gu = qm_long_dot(gap, along_u), gv = qm_long_dot(gap, along_v);
    const qm_long to[2] = {qm_long_clamp(x[0] - (vv * gu - uv * gv) / determinant),
                           qm_long_clamp(x[1] - (uu * gv - uv * gu) / determinant)};
    keep_nearer(q, to, best, square);
    for (int axis = 0; axis < 2; axis++) {
        qm_long side[2] = {to[0], to[1]};
        settle(q, side, axis);
        keep_nearer(q, side, best, square);
    }
}

/** Steps by Newton's model, by that of the tangent plane, and by turns along the axes, whichever gains
 * most. */
static qm_long near_patch(const qm_long_vec c[4], qm_long_vec p, qm_long uv[2])
{
    const qm_long_vec e1 = qm_long_sub(c[1], c[0]), e2 = qm_long_sub(c[3], c[0]);
    const long_patch q = {qm_long_sub(c[0], p), e1, e2, qm_long_sub(qm_long_sub(c[2], c[1]), e2)};
    qm_long square = square_at(&q, uv);
    for (int step = 0; step < 40; step++) {
        qm_long from[2] = {uv[0], uv[1]}, turns[2] = {uv[0], uv[1]}, before = square;
        try_model(&q, from, 1, uv, &square);
        if (!(square < before)) {
            try_model(&q, from, 0, uv, &square);
            settle(&q, turns, 0);
            settle(&q, turns, 1);
            keep_nearer(&q, turns, uv, &square);
        }
        if (!(square < before * (1 - 0x1p-55L))) break;
    }
    return sqrtl(square);
}

qm_long qm_wide_facet_near(const qm_wide_facet *facet, qm_long_vec p, qm_long uv[2])
{
    if (facet->corner_count == 4) return near_patch(facet->rounded, p, uv);
    if (facet->corner_count == 3) return near_triangle(facet->rounded, p, uv);
    uv[0] = uv[1] = 0;
    return qm_long_length(qm_long_sub(facet->rounded[0], p));
}
