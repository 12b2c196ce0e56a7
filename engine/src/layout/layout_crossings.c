/**
 * layout_crossings.c: curves that cross without a node.
 *
 * Two segments cross if the nearest points of their lines lie inside both and are much nearer to each other
 * than the segments are long, unless they lie on two walls of the surface. They must still cross as they are halved again
 * and again on it, down to the spacing of points, and be connected there by a mesh. A sweep compares segments whose
 * ranges along two directions overlap, and no others. The directions are oblique, as the curves of a part lie
 * in planes parallel to the axes, often thousands in one, which a sweep along an axis would meet all at once.
 */
#include "layout_internal.h"

#include <string.h>

#define NEAR 0.1           /* of the sum of two lengths: crossing segments are nearer than that */
#define TOUCH 1e-6         /* of that sum: nearer ones meet, whatever walls they lie on */
#define END_TOLERANCE 1e-9 /* of a segment's length */
#define HALVINGS 5         /* of two segments that seem to cross: they must still do */
#define FINEST 0.4         /* of the radius of 20 fitted points, sqrt(pi / 20): their spacing */
#define COARSE 0.5 /* of the shorter piece: one that is so far off the mesh in its middle crosses elsewhere */
#define BEYOND 0.1 /* of a piece: a crossing may move so far as pieces are projected */
#define SHEET_REACH 2.0 /* of two pieces' lengths: they cross if the surface connects them within it */
#define WALL_REACH 0.05 /* of the diagonal: the wall of a curve is sought no farther away */
#define HAND_JITTER 0.1 /* of a curve's points: a loop over fewer of its segments is hand jitter */

#define MOST_CROSSINGS 1000 /* pairs of curves: a drawing with more has no use for a list of all */
#define PAIR_SLOTS 4096     /* several for each of them: places are found at once */
#define NO_PAIR UINT64_MAX  /* no curve has this id */

/* Of length 1 or a little less, nearly at right angles, and oblique to the axes and to their diagonals. */
static const qm_vec direction[2] = {{0.7573, 0.5411, 0.3656}, {-0.6214, 0.7693, 0.1482}};

typedef struct segment {
    double low[2], high[2]; /* its range along each direction, enlarged by NEAR of its length */
    uint32_t curve, index;
} segment;

static segment segment_make(const qm_curve *curve, uint32_t curve_index, uint32_t index)
{
    qm_vec from = qm_vec_load(curve->points + 3 * (size_t)index),
           to = qm_vec_load(curve->points + 3 * (size_t)(index + 1));
    double reach = NEAR * qm_vec_distance(from, to);
    segment made = {.curve = curve_index, .index = index};
    for (int k = 0; k < 2; k++) {
        double a = qm_vec_dot(from, direction[k]), b = qm_vec_dot(to, direction[k]);
        made.low[k] = fmin(a, b) - reach;
        made.high[k] = fmax(a, b) + reach;
    }
    return made;
}

static bool segments_overlap(const segment *a, const segment *b, int k)
{
    return a->low[k] <= b->high[k] && b->low[k] <= a->high[k];
}

/**
 * Sorts segments by the start of their first range: a Shell sort, which needs no memory. The order that it
 * leaves equal segments in is part of the results, as it decides which of two crossings is found first.
 */
static void sort_segments(segment *segments, size_t count)
{
    for (size_t gap = count / 2; gap > 0; gap = gap == 2 ? 1 : gap * 5 / 11) {
        for (size_t i = gap; i < count; i++) {
            segment moved = segments[i];
            size_t k = i;
            for (; k >= gap && segments[k - gap].low[0] > moved.low[0]; k -= gap)
                segments[k] = segments[k - gap];
            segments[k] = moved;
        }
    }
}

static qm_vec segment_end(const qm_layout *layout, const segment *p, uint32_t end)
{
    return qm_vec_load(layout->curves[p->curve].points + 3 * (size_t)(p->index + end));
}

/** The nearest points of the lines of two segments. */
typedef struct meeting {
    double s, t; /* where they are on the segments */
    qm_vec at[2];
    double gap, size; /* between them; of both segments */
} meeting;

/** False where the segments are nearly parallel. */
static bool find_meeting(const qm_vec a[2], const qm_vec b[2], meeting *out)
{
    qm_vec d = qm_vec_sub(a[1], a[0]), e = qm_vec_sub(b[1], b[0]), r = qm_vec_sub(a[0], b[0]);
    double dd = qm_vec_norm2(d), ee = qm_vec_norm2(e), de = qm_vec_dot(d, e), dr = qm_vec_dot(d, r),
           er = qm_vec_dot(e, r), det = dd * ee - de * de;
    if (!(det > 1e-6 * dd * ee)) return false;
    out->s = (de * er - ee * dr) / det;
    out->t = (dd * er - de * dr) / det;
    out->at[0] = qm_vec_axpy(a[0], out->s, d);
    out->at[1] = qm_vec_axpy(b[0], out->t, e);
    out->gap = qm_vec_distance(out->at[0], out->at[1]);
    out->size = sqrt(dd) + sqrt(ee);
    return true;
}

/** A part of a segment on a surface. */
typedef struct piece {
    qm_vec end[2], normal[2];
    bool is_last[2]; /* the end is one of the curve */
} piece;

/** Moves a point onto the surface. Returns the radius of the fitted points, 0 on a mesh. */
static double place(const qm_ref_surface *surface, qm_vec toward, qm_vec *at, qm_vec *normal)
{
    double p[3], facing[3];
    qm_vec_store(p, *at);
    qm_vec_store(facing, toward);
    qm_ref_surface_point on;
    /* Normals of fitted points have no orientation. */
    if (surface->is_cloud || !(qm_vec_norm2(toward) > 0) ||
        !qm_ref_surface_project_toward(surface, p, facing, WALL_REACH * surface->diagonal, &on))
        qm_ref_surface_project(surface, p, &on);
    *at = qm_vec_load(on.position);
    *normal = qm_vec_load(on.normal);
    return on.spacing;
}

static piece half(const piece *whole, int which, qm_vec middle, qm_vec normal)
{
    piece out = *whole;
    out.end[1 - which] = middle;
    out.normal[1 - which] = normal;
    out.is_last[1 - which] = false;
    return out;
}

/** True for a place on a piece, or a little beyond its end, where the curve goes on elsewhere; not for the end of the curve. */
static bool is_on_piece(const piece *p, double s)
{
    return s >= (p->is_last[0] ? END_TOLERANCE : -BEYOND) &&
           s <= (p->is_last[1] ? 1 - END_TOLERANCE : 1 + BEYOND);
}

/** True if the surface connects two pieces near where they meet; parts of it that touch or pass through each other do not. The farther
 * end of a piece tells which part it is on: near where they meet it is on both. */
static bool are_connected(const qm_ref_surface *surface, const piece *a, const piece *b, const meeting *m)
{
    const piece *whole[2] = {a, b};
    double middle[3], on[2][3];
    qm_vec_store(middle, qm_vec_mix(m->at[0], m->at[1], 0.5));
    for (int i = 0; i < 2; i++) {
        double first = qm_vec_distance(whole[i]->end[0], m->at[i]),
               second = qm_vec_distance(whole[i]->end[1], m->at[i]);
        qm_vec_store(on[i], whole[i]->end[second > first]);
    }
    return qm_ref_surface_connects(surface, on[0], on[1], middle, SHEET_REACH * m->size);
}

/** True when two pieces still cross as they are halved, on the surface. Walls that are apart no longer do when the pieces are
 * shorter than the walls are thick, nor curves side by side whose coarse segments cut corners. Pieces too coarse to be near
 * the surface do as they are, and those as short as points are apart, between which nobody knows the surface. */
static bool pieces_cross(const qm_ref_surface *surface, const piece *a, const piece *b, int depth)
{
    meeting m;
    if (!find_meeting(a->end, b->end, &m) || !is_on_piece(a, m.s) || !is_on_piece(b, m.t) ||
        !(m.gap < NEAR * m.size))
        return false;
    if (depth == 0) return surface->is_cloud || are_connected(surface, a, b, &m);
    const piece *whole[2] = {a, b};
    piece part[2][2];
    double shorter = fmin(qm_vec_distance(a->end[0], a->end[1]), qm_vec_distance(b->end[0], b->end[1]));
    for (int i = 0; i < 2; i++) {
        qm_vec straight = qm_vec_mix(whole[i]->end[0], whole[i]->end[1], 0.5), middle = straight, normal;
        double fitted =
            place(surface, qm_vec_add(whole[i]->normal[0], whole[i]->normal[1]), &middle, &normal);
        if (qm_vec_distance(straight, middle) > COARSE * shorter || shorter < FINEST * fitted) return true;
        for (int k = 0; k < 2; k++)
            part[i][k] = half(whole[i], k, middle, normal);
    }
    for (int k = 0; k < 4; k++)
        if (pieces_cross(surface, &part[0][k & 1], &part[1][k >> 1], depth - 1)) return true;
    return false;
}

static piece make_piece(const qm_layout *layout, const qm_ref_surface *surface, const segment *p)
{
    piece out = {.is_last = {p->index == 0, p->index + 2 == layout->curves[p->curve].point_count}};
    for (uint32_t k = 0; k < 2; k++) {
        out.end[k] = segment_end(layout, p, k);
        place(surface, (qm_vec){0, 0, 0}, &out.end[k], &out.normal[k]);
    }
    return out;
}

/**
 * True if parameter s of a segment is an end of its curve: a curve that touches another there does not cross
 * it.
 */
static bool is_curve_end(const qm_layout *layout, const segment *p, double s)
{
    return (s <= END_TOLERANCE && p->index == 0) ||
           (s >= 1.0 - END_TOLERANCE && p->index + 2 == layout->curves[p->curve].point_count);
}

/** Computes the crossing of two segments. False if they do not cross, or are nearly parallel. */
static bool segments_cross(const qm_layout *layout, const qm_ref_surface *surface, const segment *a,
                           const segment *b, qm_vec *at)
{
    const qm_vec one[2] = {segment_end(layout, a, 0), segment_end(layout, a, 1)},
                 other[2] = {segment_end(layout, b, 0), segment_end(layout, b, 1)};
    meeting m;
    if (!find_meeting(one, other, &m)) return false;
    if (m.s < -END_TOLERANCE || m.s > 1.0 + END_TOLERANCE || m.t < -END_TOLERANCE ||
        m.t > 1.0 + END_TOLERANCE)
        return false;
    if (is_curve_end(layout, a, m.s) || is_curve_end(layout, b, m.t)) return false;
    if (!(m.gap < NEAR * m.size)) return false;
    *at = m.at[0];
    if (!surface || m.gap <= TOUCH * m.size) return true;
    double on_a[3], on_b[3];
    qm_vec_store(on_a, m.at[0]);
    qm_vec_store(on_b, m.at[1]);
    if (qm_ref_surface_is_between_walls(surface, on_a, on_b)) return false;
    piece part[2] = {make_piece(layout, surface, a), make_piece(layout, surface, b)};
    return pieces_cross(surface, &part[0], &part[1], HALVINGS);
}

/** The pairs of curves that have an issue, by their ids: a pair is reported once, however often it crosses. */
typedef struct pair_set {
    uint64_t key[PAIR_SLOTS]; /* NO_PAIR: free */
    size_t count;             /* MOST_CROSSINGS at most */
} pair_set;

/** The slot of a pair, or the free one where it would be. */
static uint64_t *find_pair(pair_set *set, uint64_t key)
{
    size_t slot = (size_t)((key * 0x9e3779b97f4a7c15U) >> 32) % PAIR_SLOTS;
    while (set->key[slot] != NO_PAIR && set->key[slot] != key)
        slot = (slot + 1) % PAIR_SLOTS;
    return &set->key[slot];
}

static uint64_t pair_key(uint32_t first, uint32_t second)
{
    return (uint64_t)first << 32 | second;
}

static bool is_full(const pair_set *set)
{
    return set->count == MOST_CROSSINGS;
}

/** Adds a pair that is not there. */
static void add_pair(pair_set *set, uint64_t key)
{
    *find_pair(set, key) = key;
    set->count++;
}

/** The pairs that have an issue already. */
static void collect_pairs(const qm_layout_issues *issues, pair_set *out)
{
    memset(out->key, 0xff, sizeof out->key);
    out->count = 0;
    for (size_t i = 0; i < issues->count && !is_full(out); i++) {
        const qm_layout_issue *issue = &issues->items[i];
        uint64_t key = pair_key(issue->curve[0], issue->curve[1]);
        if (issue->fault == QM_LAYOUT_CROSSING && *find_pair(out, key) == NO_PAIR) add_pair(out, key);
    }
}

/** Adds an issue if two segments cross and their curves have none yet. */
static qm_status test_pair(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                           const segment *a, const segment *b, pair_set *known, qm_layout_issues *out)
{
    double gap = fabs((double)a->index - (double)b->index);
    size_t point_count = layout->curves[a->curve].point_count;
    if (a->curve == b->curve && (gap < 3.0 || gap < HAND_JITTER * (double)point_count)) return QM_OK;
    uint32_t first = layout->curves[a->curve].id, second = layout->curves[b->curve].id;
    qm_layout_issue issue = {.fault = QM_LAYOUT_CROSSING,
                             .curve = {first < second ? first : second, first < second ? second : first},
                             .node = QM_NO_INDEX};
    uint64_t key = pair_key(issue.curve[0], issue.curve[1]);
    qm_vec at;
    if (*find_pair(known, key) == key || !segments_cross(layout, surface, a, b, &at)) return QM_OK;
    add_pair(known, key);
    qm_vec_store(issue.position, at);
    return qm_layout_add_issue(ctx, out, &issue);
}

/** Looks for crossings until there are MOST_CROSSINGS. */
static qm_status sweep(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                       segment *segments, size_t total, pair_set *known, qm_layout_issues *out)
{
    size_t count = 0;
    for (size_t c = 0; c < layout->curve_count; c++)
        for (uint32_t i = 0; i + 1 < layout->curves[c].point_count; i++)
            segments[count++] = segment_make(&layout->curves[c], (uint32_t)c, i);
    QM_ASSERT(count == total);
    sort_segments(segments, count);
    collect_pairs(out, known);
    for (size_t i = 0; i < total && !is_full(known); i++) {
        if (qm_context_canceled(ctx)) return qm_context_fail(ctx, QM_E_CANCELED, "canceled");
        for (size_t k = i + 1; k < total && segments[k].low[0] <= segments[i].high[0] && !is_full(known);
             k++) {
            if (!segments_overlap(&segments[i], &segments[k], 1)) continue;
            qm_status status = test_pair(ctx, layout, surface, &segments[i], &segments[k], known, out);
            if (status != QM_OK) return status;
        }
    }
    return QM_OK;
}

qm_status qm_layout_find_crossings(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                   qm_layout_issues *out)
{
    QM_ASSERT(ctx && layout && out);
    size_t total = 0;
    for (size_t c = 0; c < layout->curve_count; c++)
        total += layout->curves[c].point_count - 1;
    if (total == 0) return QM_OK;
    segment *segments = qm_context_alloc(ctx, total, sizeof *segments);
    pair_set *known = qm_context_alloc(ctx, 1, sizeof *known);
    qm_status status = QM_OK;
    if (segments && known)
        status = sweep(ctx, layout, surface, segments, total, known, out);
    else
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the curves");
    qm_context_free(ctx, known, 1, sizeof *known);
    qm_context_free(ctx, segments, total, sizeof *segments);
    return status;
}
