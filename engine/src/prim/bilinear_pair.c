/**
 * bilinear_pair.c: a depth-first branch and bound over pairs of parts. Faces are cut in quarters; a pair of
 * parts that is farther apart than the limit is pruned.
 */
#include "bilinear_pair.h"

#include "bilinear.h"
#include "tri_tri.h"
#include "triangle.h"

/**
 * More than all roundings of the distance of two parts, with coordinates up to QM_FACE_EXTENT = 8: 8192 u
 * with u = 2^-53. The distance of two triangles is off by QM_FACE_EXTENT times QM_TRIANGLE_GAP_ERROR: 2048 u.
 * A cut puts corners at midpoints, off by 12 u along each axis at most and never beyond the corners they lie
 * between, so by no more than the part's size either: over any number of cuts 12 u * 56 for the first 56
 * levels and 16 u for all others, sqrt(3) times that for a corner, 1200 u for each of two parts.
 */
#define PART_ERROR (4.0 * QM_FACE_EXTENT * 0x1p-45)

typedef struct face_part {
    qm_vec corner[4];
    double uv[4][2];        /* of the corners in the face */
    double twist;           /* flatness bound: how far the part is from its two triangles at most */
    int count;              /* 3 or 4 */
    bool is_shared[4];      /* the corner lies on a corner or edge that the face shares with the other */
    bool is_shared_edge[4]; /* so does the edge from this corner to the next */
} face_part;

/** The distance of the triangles of two parts, 0 when they meet, with local parameters of two such points. */
typedef struct part_gap {
    double distance, uv[2][2];
} part_gap;

/* A height above a plane: far more than the corners have by rounding */
#define STRICTLY_ABOVE (1024.0 * PART_ERROR)

static const double corner_uv[2][4][2] = {{{0, 0}, {1, 0}, {0, 1}, {0, 1}}, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}};

static void set_twist(face_part *part)
{
    part->twist = part->count == 4 ? qm_bilinear_twist(part->corner) : 0.0;
}

static face_part part_make(const qm_face_shape *face)
{
    face_part part = {.count = face->count};
    for (int i = 0; i < face->count; i++) {
        part.corner[i] = face->corner[i];
        for (int k = 0; k < 2; k++)
            part.uv[i][k] = corner_uv[face->count - 3][i][k];
    }
    set_twist(&part);
    return part;
}

static int find_vertex(const qm_face_shape *face, uint32_t vertex)
{
    for (int i = 0; i < face->count; i++)
        if (face->vertex[i] == vertex) return i;
    return -1;
}

/** True when two vertices are the ends of an edge of the face. */
static bool has_edge(const qm_face_shape *face, uint32_t from, uint32_t to)
{
    for (int i = 0; i < face->count; i++) {
        uint32_t here = face->vertex[i], next = face->vertex[(i + 1) % face->count];
        if ((here == from && next == to) || (here == to && next == from)) return true;
    }
    return false;
}

static int mark_shared(const qm_face_shape *face, const qm_face_shape *other, face_part *part)
{
    int count = 0;
    for (int i = 0; i < face->count; i++) {
        part->is_shared[i] = find_vertex(other, face->vertex[i]) >= 0;
        part->is_shared_edge[i] = has_edge(other, face->vertex[i], face->vertex[(i + 1) % face->count]);
        count += part->is_shared[i];
    }
    return count;
}

/* ---- cutting ---- */

/** Sets a corner of a quarter to the midpoint of edge i of the part. */
static void copy_midpoint(face_part *to, int at, const face_part *from, int i)
{
    int k = (i + 1) % from->count;
    to->corner[at] = qm_vec_scale(0.5, qm_vec_add(from->corner[i], from->corner[k]));
    to->uv[at][0] = 0.5 * (from->uv[i][0] + from->uv[k][0]);
    to->uv[at][1] = 0.5 * (from->uv[i][1] + from->uv[k][1]);
    to->is_shared[at] = from->is_shared_edge[i];
}

static face_part part_quarter(const face_part *part, int i)
{
    face_part quarter = {.count = part->count};
    if (part->count == 3 && i == 3) {
        for (int k = 0; k < 3; k++)
            copy_midpoint(&quarter, k, part, k);
        return quarter;
    }
    int last = (i + part->count - 1) % part->count;
    quarter.corner[0] = part->corner[i];
    quarter.uv[0][0] = part->uv[i][0];
    quarter.uv[0][1] = part->uv[i][1];
    quarter.is_shared[0] = part->is_shared[i];
    copy_midpoint(&quarter, 1, part, i);
    if (part->count == 4) {
        qm_vec sum = qm_vec_add(qm_vec_add(part->corner[0], part->corner[2]),
                                qm_vec_add(part->corner[1], part->corner[3]));
        quarter.corner[2] = qm_vec_scale(0.25, sum);
        for (int k = 0; k < 2; k++)
            quarter.uv[2][k] = 0.25 * (part->uv[0][k] + part->uv[1][k] + part->uv[2][k] + part->uv[3][k]);
        quarter.is_shared[2] = false;
    }
    copy_midpoint(&quarter, part->count - 1, part, last);
    quarter.is_shared_edge[0] = part->is_shared_edge[i];
    quarter.is_shared_edge[part->count - 1] = part->is_shared_edge[last];
    set_twist(&quarter);
    return quarter;
}

static double part_size(const face_part *part)
{
    qm_box box = qm_vec_box(part->corner, part->count);
    return fmax(box.max[0] - box.min[0], fmax(box.max[1] - box.min[1], box.max[2] - box.min[2]));
}

static qm_vec face_at(const face_part *face, const double uv[2])
{
    if (face->count == 4) {
        qm_bilinear patch = qm_bilinear_make(face->corner);
        return qm_bilinear_at(&patch, uv[0], uv[1]);
    }
    const double weight[3] = {1.0 - uv[0] - uv[1], uv[0], uv[1]};
    return qm_triangle_at(face->corner, weight);
}

/* ---- distance ---- */

/** Triangle t of a part: (c0 c1 c2), or (c0 c2 c3). */
static void part_triangle(const face_part *part, int t, qm_vec corner[3])
{
    corner[0] = part->corner[0];
    corner[1] = part->corner[1 + t];
    corner[2] = part->corner[2 + t];
}

static void local_uv(const face_part *part, int t, const double weight[3], double uv[2])
{
    bool is_quad = part->count == 4;
    uv[0] = !is_quad ? weight[1] : t == 0 ? weight[1] + weight[2] : weight[1];
    uv[1] = !is_quad || t == 0 ? weight[2] : weight[1] + weight[2];
}

/** Weights of the nearest point of a triangle. */
static void find_weights(const qm_vec corner[3], qm_vec point, double weight[3])
{
    qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
    qm_triangle_footpoint(&triangle, point, weight);
}

static qm_triangle_gap triangle_gap(const qm_vec a[3], const qm_vec b[3])
{
    qm_contact contact;
    if (!qm_tri_tri_meet(a, b)) return qm_triangle_find_gap(a, b);
    qm_triangle_gap gap = {.distance = 0.0};
    qm_tri_tri_contact(a, b, &contact);
    qm_vec midpoint = qm_vec_mix(qm_vec_load(contact.point[0]), qm_vec_load(contact.point[1]), 0.5);
    find_weights(a, midpoint, gap.weight[0]);
    find_weights(b, midpoint, gap.weight[1]);
    return gap;
}

static part_gap part_distance(const face_part *p, const face_part *q)
{
    part_gap nearest = {.distance = INFINITY};
    for (int i = 0; i < p->count - 2; i++) {
        for (int k = 0; k < q->count - 2; k++) {
            qm_vec a[3], b[3];
            part_triangle(p, i, a);
            part_triangle(q, k, b);
            qm_triangle_gap gap = triangle_gap(a, b);
            if (!(gap.distance < nearest.distance)) continue;
            nearest.distance = gap.distance;
            local_uv(p, i, gap.weight[0], nearest.uv[0]);
            local_uv(q, k, gap.weight[1], nearest.uv[1]);
        }
    }
    return nearest;
}

/* ---- shared corners and edges ---- */

static double segment_distance(qm_vec a, qm_vec b, qm_vec p)
{
    qm_vec along = qm_vec_sub(b, a), from = qm_vec_sub(p, a);
    double size = qm_vec_norm2(along);
    double t = size > 0.0 ? qm_clamp(qm_vec_dot(from, along) / size, 0.0, 1.0) : 0.0;
    return qm_vec_norm(qm_vec_sub(from, qm_vec_scale(t, along)));
}

static bool is_near_shared(const face_part *const face[2], qm_vec point, double distance)
{
    const face_part *p = face[0];
    for (int i = 0; i < p->count; i++) {
        if (p->is_shared[i] && qm_vec_distance(p->corner[i], point) <= distance) return true;
        if (p->is_shared_edge[i] &&
            segment_distance(p->corner[i], p->corner[(i + 1) % p->count], point) <= distance)
            return true;
    }
    return false;
}

/** The shared corner of a part that is farthest from a point; its distance, -1 when it has none. */
static double farthest_shared(const face_part *part, qm_vec from, qm_vec *out)
{
    double farthest = -1.0;
    for (int i = 0; i < part->count; i++) {
        if (!part->is_shared[i]) continue;
        double distance = qm_vec_distance(from, part->corner[i]);
        if (!(distance > farthest)) continue;
        farthest = distance;
        *out = part->corner[i];
    }
    return farthest;
}

/** The component of a vector at a right angle to a direction of length 1 (or 0). */
static qm_vec across(qm_vec v, qm_vec direction)
{
    return qm_vec_axpy(v, -qm_vec_dot(v, direction), direction);
}

/** The mean direction in which a part leaves the line of the shared corners; false when all corners are
 * shared. */
static bool leaving_direction(const face_part *part, qm_vec origin, qm_vec line, qm_vec *out)
{
    qm_vec sum = {0};
    int count = 0;
    for (int i = 0; i < part->count; i++) {
        if (part->is_shared[i]) continue;
        sum = qm_vec_add(sum, qm_vec_unit(across(qm_vec_sub(part->corner[i], origin), line)));
        count++;
    }
    *out = qm_vec_unit(sum);
    return count > 0;
}

/** True when shared corners lie in the plane and all others strictly above it. */
static bool lies_above(const face_part *part, qm_vec origin, qm_vec normal)
{
    for (int i = 0; i < part->count; i++) {
        double height = qm_vec_dot(normal, qm_vec_sub(part->corner[i], origin));
        if (part->is_shared[i] ? fabs(height) > PART_ERROR : height <= STRICTLY_ABOVE) return false;
    }
    return true;
}

static bool are_separated(const face_part *p, const face_part *q)
{
    qm_vec origin, end_p = {0}, end_q = {0}, up_p, up_q;
    if (farthest_shared(p, p->corner[0], &origin) < 0.0) return false;
    double in_p = farthest_shared(p, origin, &end_p), in_q = farthest_shared(q, origin, &end_q);
    if (in_q < 0.0) return false;
    qm_vec line = qm_vec_unit(qm_vec_sub(in_p > in_q ? end_p : end_q, origin));
    if (!leaving_direction(p, origin, line, &up_p) || !leaving_direction(q, origin, line, &up_q))
        return false;
    qm_vec normal = qm_vec_unit(across(qm_vec_sub(up_p, up_q), line));
    return lies_above(p, origin, normal) && lies_above(q, origin, qm_vec_scale(-1.0, normal));
}

/* ---- cutting until the query is answered ---- */

#define MAX_PAIRS 5000    /* of parts in one pass: the remaining ones keep the bounds that they have */
#define ERROR_STEP 0.0625 /* from one pass to the next */

/** A query and its result so far. */
typedef struct search {
    const face_part *face[2];
    double error, stop_above; /* pairs proven to be stop_above apart are pruned */
    double enough;            /* a distance of at most this ends the search */
    double tolerance;         /* parts this near to a shared corner or edge do not count */
    bool has_shared;
    int pairs;
    bool is_done, is_exhausted;
    qm_bilinear_gap gap;
} search;

static void offer(search *f, const face_part part[2], const part_gap *found)
{
    qm_bilinear_gap gap;
    for (int side = 0; side < 2; side++) {
        const double(*corner)[2] = part[side].uv;
        for (int k = 0; k < 2; k++)
            gap.uv[side][k] = corner[0][k] + found->uv[side][0] * (corner[1][k] - corner[0][k]) +
                              found->uv[side][1] * (corner[part[side].count - 1][k] - corner[0][k]);
        gap.point[side] = face_at(f->face[side], gap.uv[side]);
    }
    gap.upper = qm_vec_distance(gap.point[0], gap.point[1]);
    if (!(gap.upper < f->gap.upper)) return;
    if (f->has_shared && is_near_shared(f->face, gap.point[0], f->tolerance)) return;
    gap.lower = f->gap.lower;
    f->gap = gap;
    f->is_done |= gap.upper <= f->enough;
}

/** Cutoff: pairs with a lower bound above this are pruned. */
static double limit(const search *f)
{
    return fmax(fmin(f->gap.upper, f->stop_above) - f->error, 0.0);
}

/** Prunes a pair: the result cannot claim more than its lower bound. */
static void prune(search *f, double lower)
{
    f->gap.lower = fmin(f->gap.lower, lower);
}

typedef struct part_pair {
    face_part part[2];
    double lower;
} part_pair;

/** Bounds a pair and prunes it when it is beyond the limit; true when it is decided: pruned, or the parts
 * meet nowhere but in the corners and edges that the faces share. */
static bool is_decided(search *f, part_pair *pair)
{
    const face_part *p = &pair->part[0], *q = &pair->part[1];
    if (f->has_shared && are_separated(p, q)) return true;
    qm_box a = qm_vec_box(p->corner, p->count), b = qm_vec_box(q->corner, q->count);
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        double gap = fmax(fmax(a.min[k] - b.max[k], b.min[k] - a.max[k]), 0.0);
        sum += gap * gap;
    }
    pair->lower = fmax(sqrt(sum) - PART_ERROR, 0.0);
    if (pair->lower <= limit(f)) {
        part_gap found = part_distance(p, q);
        pair->lower = fmax(found.distance - p->twist - q->twist - PART_ERROR, 0.0);
        offer(f, pair->part, &found);
    }
    if (pair->lower <= limit(f)) return false;
    prune(f, pair->lower);
    return true;
}

static bool is_small(const search *f, const part_pair *pair)
{
    return f->has_shared && part_size(&pair->part[0]) < f->tolerance &&
           part_size(&pair->part[1]) < f->tolerance &&
           is_near_shared(f->face, pair->part[0].corner[0], f->tolerance);
}

/** The part to cut: the more twisted one, or the larger of two flat ones. */
static int choose_part(const part_pair *pair)
{
    const face_part *p = &pair->part[0], *q = &pair->part[1];
    if (p->twist != q->twist) return p->twist < q->twist;
    return part_size(p) < part_size(q);
}

static void cut(search *f, const part_pair *pair)
{
    if (is_small(f, pair)) return;
    if (f->pairs >= MAX_PAIRS) {
        f->is_exhausted = true;
        prune(f, pair->lower);
        return;
    }
    f->pairs += 4;
    int side = choose_part(pair);
    part_pair child[4];
    int order[4], count = 0;
    for (int i = 0; i < 4; i++) {
        child[i].part[1 - side] = pair->part[1 - side];
        child[i].part[side] = part_quarter(&pair->part[side], i);
        if (f->is_done || is_decided(f, &child[i])) continue;
        int slot = count++;
        for (; slot > 0 && child[order[slot - 1]].lower > child[i].lower; slot--)
            order[slot] = order[slot - 1];
        order[slot] = i;
    }
    for (int i = 0; i < count && !f->is_done; i++) {
        if (child[order[i]].lower > limit(f))
            prune(f, child[order[i]].lower);
        else
            cut(f, &child[order[i]]);
    }
}

/** One pass over the faces: unless it is exhausted, no pair nearer than the limit remains. */
static void pass(search *f, const face_part *a, const face_part *b)
{
    part_pair pair = {.part = {*a, *b}};
    f->gap.lower = INFINITY;
    f->pairs = 0;
    if (!is_decided(f, &pair) && !f->is_done) cut(f, &pair);
    if (f->is_done) f->gap.lower = 0.0;
    f->gap.lower = fmin(f->gap.lower, f->gap.upper);
    QM_ASSERT(f->gap.lower >= 0.0);
}

static void start(search *f, const face_part *a, const face_part *b)
{
    f->face[0] = a;
    f->face[1] = b;
    f->gap = (qm_bilinear_gap){.lower = INFINITY, .upper = INFINITY};
}

/** Passes with falling errors: a plateau of equal distances exhausts a pass only, and leaves the bounds of
 * the last pass that ended. */
qm_bilinear_gap qm_bilinear_pair_distance(const qm_face_shape *a, const qm_face_shape *b, double error,
                                          double stop_above)
{
    face_part part_a = part_make(a), part_b = part_make(b);
    QM_ASSERT(error > 0.0 && !(stop_above < 0.0));
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

/** Pruned pairs do not meet; pairs that remain when the pass is exhausted count as meeting. */
static bool decide(search *f, const face_part *a, const face_part *b, qm_bilinear_gap *gap)
{
    f->error = f->stop_above = 0.0;
    f->enough = f->tolerance;
    start(f, a, b);
    pass(f, a, b);
    *gap = f->gap;
    bool meets = f->is_done || gap->lower <= 0.0;
    if (meets && gap->upper == INFINITY) {
        /* The pass is exhausted and found no point off the shared corners and edges: takes any near ones. */
        const face_part part[2] = {*a, *b};
        part_gap nearest = part_distance(a, b);
        f->has_shared = false;
        offer(f, part, &nearest);
        *gap = f->gap;
    }
    return meets;
}

bool qm_bilinear_pair_meet(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                           qm_bilinear_gap *gap)
{
    face_part part_a = part_make(a), part_b = part_make(b);
    search f = {.tolerance = tolerance};
    return decide(&f, &part_a, &part_b, gap);
}

bool qm_bilinear_pair_cross(const qm_face_shape *a, const qm_face_shape *b, double tolerance,
                            qm_bilinear_gap *gap)
{
    face_part part_a = part_make(a), part_b = part_make(b);
    search f = {.tolerance = tolerance};
    mark_shared(b, a, &part_b);
    f.has_shared = mark_shared(a, b, &part_a) > 0;
    return decide(&f, &part_a, &part_b, gap);
}
