#include "deviation_cut.h"

#include "core/rounding.h"

#define OUTLINE_CORNERS 16
#define MAX_CUTS ((QM_PIECE_PARTS - 1) / 2)
#define MARGIN 1e-4 /* of an outline's size: less than this on one side of a line is not cut off */
#define SNAP 1e-6   /* likewise: corners this near to a line lie on it */

/** A convex polygon of parameters. */
typedef struct outline {
    int count;
    double u[OUTLINE_CORNERS], v[OUTLINE_CORNERS];
    qm_vec at[OUTLINE_CORNERS];
    double nearest[OUTLINE_CORNERS]; /* distance to the listed facets */
    double area;
} outline;

typedef struct cut_work {
    const qm_piece_maker *maker;
    const qm_piece_face *face;
    const qm_near_facets *near;
    outline aside[MAX_CUTS + 1]; /* count of them, to be looked at */
    int count, cuts, cut_limit;
    double slack; /* the greatest of a facet on the list, where it is more than the distance: then differences
                     of distances below it mean nothing */
    double worth; /* what a corner of the outline at work must be off for a cut */
    double leak;
} cut_work;

/** What a rounded corner on an edge of these extents may leak. */
static double edge_leak(double du, double dv)
{
    return 4.0 * QM_UNIT_ROUNDING * (fabs(du) + fabs(dv));
}

/** What a part leaks that may have turned round. */
static double turn_leak(const qm_source_piece *part)
{
    double error, doubled = qm_piece_parameter_area2(part, &error);
    return doubled > error ? 0.0 : fabs(doubled) + error;
}

static qm_near_facet find_facet(const cut_work *work, qm_vec p)
{
    return qm_near_facets_nearest(work->maker->kernel, work->near, p);
}

/* ---- outlines ---- */

static void add_corner(outline *to, double u, double v, qm_vec at, double nearest)
{
    to->u[to->count] = u;
    to->v[to->count] = v;
    to->at[to->count] = at;
    to->nearest[to->count++] = nearest;
}

static void copy_corner(outline *to, const outline *from, int i)
{
    add_corner(to, from->u[i], from->v[i], from->at[i], from->nearest[i]);
}

/** A new corner of both outlines, on the edge that starts at a corner of the one that is cut. */
static void add_crossing(cut_work *work, const outline *from, int i, double share, outline *one, outline *two)
{
    int next = (i + 1) % from->count;
    double du = from->u[next] - from->u[i], dv = from->v[next] - from->v[i];
    double u = from->u[i] + share * du, v = from->v[i] + share * dv;
    work->leak += edge_leak(du, dv);
    qm_vec at = qm_piece_face_at(work->face, u, v);
    add_corner(one, u, v, at, find_facet(work, at).distance);
    copy_corner(two, one, one->count - 1);
}

static double size_of(const outline *o)
{
    double size2 = 0.0;
    for (int i = 1; i < o->count; i++)
        size2 = fmax(size2, qm_vec_norm2(qm_vec_sub(o->at[i], o->at[0])));
    return sqrt(size2);
}

static double area_of(const outline *o)
{
    qm_vec doubled = {0, 0, 0};
    for (int i = 2; i < o->count; i++)
        doubled = qm_vec_add(
            doubled, qm_vec_cross(qm_vec_sub(o->at[i - 1], o->at[0]), qm_vec_sub(o->at[i], o->at[0])));
    return 0.5 * qm_vec_norm(doubled);
}

/** True when one chord of the outline separates the corners where a function is positive from those where it
 * is negative: two borders between its signs, where a corner of value 0 is itself one. On a patch a function
 * need not be so simple. */
static bool has_one_chord(const outline *o, const double value[OUTLINE_CORNERS])
{
    int borders = 0;
    for (int i = 0; i < o->count; i++) {
        double here = value[i], next = value[(i + 1) % o->count];
        borders += (here < 0.0 && next > 0.0) || (here > 0.0 && next < 0.0) || here == 0.0;
    }
    return borders == 2;
}

/**
 * Cuts an outline along the line where a function that is about linear is 0: what lies where it is positive
 * stays, the rest is put aside. False when too little lies on one side.
 */
static bool cut(cut_work *work, outline *o, double value[OUTLINE_CORNERS])
{
    double size = size_of(o), low = 0.0, high = 0.0;
    for (int i = 0; i < o->count; i++) {
        low = fmin(low, value[i]);
        high = fmax(high, value[i]);
        if (fabs(value[i]) <= SNAP * size) value[i] = 0.0;
    }
    bool has_room = work->cuts < work->cut_limit && o->count + 2 <= OUTLINE_CORNERS;
    if (!has_room || -low <= MARGIN * size || high <= MARGIN * size || !has_one_chord(o, value)) return false;
    outline stays, *goes = &work->aside[work->count++];
    stays.count = goes->count = 0;
    for (int i = 0; i < o->count; i++) {
        double here = value[i], there = value[(i + 1) % o->count];
        if (here >= 0.0) copy_corner(&stays, o, i);
        if (here <= 0.0) copy_corner(goes, o, i);
        if ((here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0))
            add_crossing(work, o, i, here / (here - there), &stays, goes);
    }
    stays.area = area_of(&stays);
    goes->area = area_of(goes);
    work->cuts++;
    *o = stays;
    return true;
}

/* ---- lines ---- */

/** What a corner of an outline must be off for a cut: a small one may be off by more, as it counts less. */
static double find_worth(const cut_work *work, const outline *o)
{
    double cell = work->maker->cell_area;
    double worth = work->maker->worth * (o->area < cell ? cell / fmax(o->area, 1e-6 * cell) : 1.0);
    return fmax(worth, work->slack);
}

static double height_over(const qm_triangle *t, qm_vec p)
{
    return qm_vec_dot(qm_vec_sub(p, t->origin), t->z);
}

/** True when a facet is not good enough at a corner: another is nearer by more than it is worth. */
static bool is_bad_at(const cut_work *work, const outline *o, const qm_near_facet *facet, int corner)
{
    double distance = sqrt(qm_triangle_distance2(&facet->triangle, o->at[corner]));
    return distance - o->nearest[corner] > work->worth;
}

static bool is_good(const cut_work *work, const outline *o, const qm_near_facet *facet)
{
    for (int i = 0; i < o->count; i++)
        if (is_bad_at(work, o, facet, i)) return false;
    return true;
}

/** Cuts off what lies beyond the walls of a facet, where a corner is badly off there. */
static void cut_walls(cut_work *work, outline *o, const qm_near_facet *facet)
{
    for (int wall = 0; wall < 3; wall++) {
        double value[OUTLINE_CORNERS];
        bool is_bad = false;
        for (int i = 0; i < o->count; i++) {
            double inside[3];
            qm_triangle_walls(&facet->triangle, o->at[i], inside);
            value[i] = inside[wall];
            is_bad |= value[i] < 0.0 && is_bad_at(work, o, facet, i);
        }
        if (is_bad && cut(work, o, value)) work->worth = find_worth(work, o);
    }
}

/** Cuts where the heights over two facets are alike, as seen from the side of o: for a corner that is nearer
 * to another facet. */
static bool cut_valley(cut_work *work, outline *o, const qm_near_facet *facet)
{
    for (int i = 0; i < o->count; i++) {
        qm_near_facet other = find_facet(work, o->at[i]);
        double here = height_over(&facet->triangle, o->at[i]), there = height_over(&other.triangle, o->at[i]);
        if (other.place == facet->place || !(fabs(here) - fabs(there) > work->worth)) continue;
        double sign[2] = {here < 0.0 ? -1.0 : 1.0, there < 0.0 ? -1.0 : 1.0}, value[OUTLINE_CORNERS];
        for (int k = 0; k < o->count; k++)
            value[k] = sign[1] * height_over(&other.triangle, o->at[k]) -
                       sign[0] * height_over(&facet->triangle, o->at[k]);
        if (cut(work, o, value)) return true;
    }
    return false;
}

/* ---- the piece ---- */

static qm_vec middle_of(const outline *o)
{
    qm_vec sum = {0, 0, 0};
    for (int i = 0; i < o->count; i++)
        sum = qm_vec_add(sum, o->at[i]);
    return qm_vec_scale(1.0 / o->count, sum);
}

/** Cuts an outline down to what belongs to the facet under its middle. */
static void settle(cut_work *work, outline *o)
{
    qm_near_facet facet = find_facet(work, middle_of(o));
    work->worth = find_worth(work, o);
    cut_walls(work, o, &facet);
    if (!is_good(work, o, &facet)) cut_valley(work, o, &facet);
}

static int add_parts(const qm_source_piece *piece, const outline *o, qm_source_piece *part, int count)
{
    for (int i = 2; i < o->count; i++) {
        part[count] = *piece;
        part[count].depth++;
        const int corner[3] = {0, i - 1, i};
        for (int k = 0; k < 3; k++) {
            part[count].u[k] = o->u[corner[k]];
            part[count].v[k] = o->v[corner[k]];
        }
        count++;
    }
    return count;
}

static double greatest_slack(const qm_near_facets *near)
{
    double greatest = 0.0;
    for (int i = 0; i < near->count; i++)
        greatest = fmax(greatest, near->slack[i / QM_PACK_LANES][i % QM_PACK_LANES]);
    return greatest;
}

static void start(cut_work *work, const qm_source_piece *piece)
{
    outline *first = &work->aside[0];
    first->count = 0;
    for (int i = 0; i < 3; i++) {
        qm_vec at = qm_piece_face_at(work->face, piece->u[i], piece->v[i]);
        add_corner(first, piece->u[i], piece->v[i], at, find_facet(work, at).distance);
    }
    first->area = area_of(first);
    work->count = 1;
    work->slack = greatest_slack(work->near);
    if (work->slack < fmin(first->nearest[0], fmin(first->nearest[1], first->nearest[2]))) work->slack = 0.0;
}

/** Takes the largest of the outlines that were put aside. */
static outline take_largest(cut_work *work)
{
    int largest = 0;
    for (int i = 1; i < work->count; i++)
        if (work->aside[i].area > work->aside[largest].area) largest = i;
    outline taken = work->aside[largest];
    work->aside[largest] = work->aside[--work->count];
    return taken;
}

int qm_piece_cut_by_facets(const qm_piece_maker *maker, const qm_piece_face *face,
                           const qm_source_piece *piece, const qm_near_facets *near,
                           qm_source_piece part[QM_PIECE_PARTS], double *leak)
{
    cut_work work; /* large, and filled as it is used */
    work.maker = maker;
    work.face = face;
    work.near = near;
    work.cuts = 0;
    work.leak = 0.0;
    work.cut_limit = (maker->part_limit - 1) / 2; /* each adds two triangles at most */
    start(&work, piece);
    int count = 0;
    while (work.count > 0) {
        outline at = take_largest(&work);
        settle(&work, &at);
        count = add_parts(piece, &at, part, count);
    }
    for (int i = 0; i < count; i++)
        work.leak += turn_leak(&part[i]);
    *leak += work.leak;
    return count;
}

/** True when the sum of two numbers is not rounded, so that their middle lies between them exactly: what was
 * added on either side comes back whole (Moller, Knuth). */
static bool is_sum_exact(double a, double b)
{
    double sum = a + b, part = sum - a;
    return a - (sum - part) == 0.0 && b - part == 0.0;
}

void qm_piece_halve(const qm_piece_shape *shape, const qm_source_piece *piece, qm_source_piece part[2],
                    double *leak)
{
    int a = 0; /* the longest edge runs from a to b */
    double longest2 = -1.0;
    for (int i = 0; i < 3; i++) {
        double edge2 = qm_vec_norm2(qm_vec_sub(shape->corner[i], shape->corner[(i + 1) % 3]));
        if (edge2 > longest2) {
            longest2 = edge2;
            a = i;
        }
    }
    int b = (a + 1) % 3;
    double u = 0.5 * (piece->u[a] + piece->u[b]), v = 0.5 * (piece->v[a] + piece->v[b]);
    part[0] = part[1] = *piece;
    part[0].depth = part[1].depth = (uint8_t)(piece->depth + 1);
    part[0].u[b] = part[1].u[a] = u;
    part[0].v[b] = part[1].v[a] = v;
    if (!is_sum_exact(piece->u[a], piece->u[b]) || !is_sum_exact(piece->v[a], piece->v[b]))
        *leak += edge_leak(piece->u[b] - piece->u[a], piece->v[b] - piece->v[a]);
    *leak += turn_leak(&part[0]) + turn_leak(&part[1]);
}
