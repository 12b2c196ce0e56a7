/**
 * deviation_cut.c: where a piece is cut: along the borders of the facets under it.
 *
 * A new corner is rounded and lies beside the edge that it is on, so that a sliver of the piece is in no
 * part, or in one and in its neighbour too. A coordinate is found by a difference, a product and a sum of
 * numbers of 1 at most: off by 3 u. With l the sum of the edge's extents in both parameters, the sliver has
 * an area of at most l 3 sqrt(2) u / 2 < 4 u l. Besides, a thin part may be inverted, and then counts
 * with twice its area too much. leak is the sum of both: the area of parameters by which the parts may differ
 * from the piece. A midpoint that is not rounded leaks nothing. As outlines and their parts are
 * defined by their corners alone, the leaks of cuts of cuts add up.
 */
#include "core/rounding.h"
#include "deviation_piece.h"

#define OUTLINE_CORNERS 16
#define MAX_CUTS ((QM_DEVIATION_PARTS - 1) / 2)
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
    const qm_deviation_setup *setup;
    const qm_deviation_face *face;
    const qm_deviation_facets *near;
    outline aside[MAX_CUTS + 1]; /* count of them, still to be cut */
    int count, cuts, cut_limit;
    double slack; /* the greatest of a facet on the list, where it is more than the distance: then differences
                     of distances below it mean nothing */
    double worth; /* the gain that a cut of the current outline must bring at a corner */
    double leak;
} cut_work;

/** The leak of a rounded corner on an edge of these extents. */
static double edge_leak(double du, double dv)
{
    return 4.0 * QM_UNIT_ROUNDING * (fabs(du) + fabs(dv));
}

/** The leak of a part that may be inverted. */
static double flip_leak(const qm_deviation_piece *part)
{
    double error, doubled = qm_deviation_parameter_area2(part, &error);
    return doubled > error ? 0.0 : fabs(doubled) + error;
}

static qm_deviation_facet find_facet(const cut_work *work, qm_vec p)
{
    return qm_deviation_facets_nearest(work->setup->kernel, work->near, p);
}

/* ---- outlines ---- */

static void add_corner(outline *to, double u, double v, qm_vec at, double nearest)
{
    QM_ASSERT(to->count < OUTLINE_CORNERS);
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
    qm_vec at = qm_deviation_face_at(work->face, u, v);
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
 * Cuts an outline along the zeros of a function that is about linear: the positive part is kept, the
 * remainder is put aside. False when too little lies on one side.
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
    QM_ASSERT(work->count <= MAX_CUTS);
    outline kept, *cut_off = &work->aside[work->count++];
    kept.count = cut_off->count = 0;
    for (int i = 0; i < o->count; i++) {
        double here = value[i], there = value[(i + 1) % o->count];
        if (here >= 0.0) copy_corner(&kept, o, i);
        if (here <= 0.0) copy_corner(cut_off, o, i);
        if ((here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0))
            add_crossing(work, o, i, here / (here - there), &kept, cut_off);
    }
    kept.area = area_of(&kept);
    cut_off->area = area_of(cut_off);
    work->cuts++;
    *o = kept;
    return true;
}

/* ---- lines ---- */

/** The gain that a cut must bring at a corner of an outline: a greater one if the outline is small. */
static double find_min_gain(const cut_work *work, const outline *o)
{
    double cell = work->setup->cell_area;
    double worth = work->setup->worth * (o->area < cell ? cell / fmax(o->area, 1e-6 * cell) : 1.0);
    return fmax(worth, work->slack);
}

static double height_over(const qm_triangle *t, qm_vec p)
{
    return qm_vec_dot(qm_vec_sub(p, t->origin), t->z);
}

/** Whether a facet misfits a corner: another one is nearer by more than the gain that a cut must bring. */
static bool misfits_at(const cut_work *work, const outline *o, const qm_deviation_facet *facet, int corner)
{
    double distance = sqrt(qm_triangle_distance2(&facet->triangle, o->at[corner]));
    return distance - o->nearest[corner] > work->worth;
}

static bool fits(const cut_work *work, const outline *o, const qm_deviation_facet *facet)
{
    for (int i = 0; i < o->count; i++)
        if (misfits_at(work, o, facet, i)) return false;
    return true;
}

/** Cuts off the parts beyond the planes on the edges of a facet, where a corner there misfits. */
static void cut_along_edges(cut_work *work, outline *o, const qm_deviation_facet *facet)
{
    for (int edge = 0; edge < 3; edge++) {
        double value[OUTLINE_CORNERS];
        bool misfits = false;
        for (int i = 0; i < o->count; i++) {
            double inside[3];
            qm_deviation_facet_edges(&facet->triangle, o->at[i], inside);
            value[i] = inside[edge];
            misfits |= value[i] < 0.0 && misfits_at(work, o, facet, i);
        }
        if (misfits && cut(work, o, value)) work->worth = find_min_gain(work, o);
    }
}

/** Cuts along the bisector of two facets, where the heights over both are equal, as seen from the side of o:
 * for a corner that is nearer to another facet. */
static bool cut_along_bisector(cut_work *work, outline *o, const qm_deviation_facet *facet)
{
    for (int i = 0; i < o->count; i++) {
        qm_deviation_facet other = find_facet(work, o->at[i]);
        double here = height_over(&facet->triangle, o->at[i]), there = height_over(&other.triangle, o->at[i]);
        if (other.index == facet->index || !(fabs(here) - fabs(there) > work->worth)) continue;
        double sign[2] = {here < 0.0 ? -1.0 : 1.0, there < 0.0 ? -1.0 : 1.0}, value[OUTLINE_CORNERS];
        for (int k = 0; k < o->count; k++)
            value[k] = sign[1] * height_over(&other.triangle, o->at[k]) -
                       sign[0] * height_over(&facet->triangle, o->at[k]);
        if (cut(work, o, value)) return true;
    }
    return false;
}

/* ---- the piece ---- */

static qm_vec centroid_of(const outline *o)
{
    qm_vec sum = {0, 0, 0};
    for (int i = 0; i < o->count; i++)
        sum = qm_vec_add(sum, o->at[i]);
    return qm_vec_scale(1.0 / o->count, sum);
}

static int add_parts(const qm_deviation_piece *piece, const outline *o, qm_deviation_piece *part, int count)
{
    for (int i = 2; i < o->count; i++) {
        QM_ASSERT(count < QM_DEVIATION_PARTS);
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

int qm_deviation_piece_cut(const qm_deviation_setup *setup, const qm_deviation_face *face,
                           const qm_deviation_piece *piece, const qm_deviation_facets *near,
                           qm_deviation_piece part[QM_DEVIATION_PARTS], double *leak)
{
    cut_work work; /* large, and filled as it is used */
    work.setup = setup;
    work.face = face;
    work.near = near;
    work.cuts = 0;
    work.leak = 0.0;
    QM_ASSERT(setup->part_limit >= 1 && setup->part_limit <= QM_DEVIATION_PARTS);
    work.cut_limit = (setup->part_limit - 1) / 2; /* each adds two triangles at most */

    outline *first = &work.aside[0];
    first->count = 0;
    for (int i = 0; i < 3; i++) {
        qm_vec at = qm_deviation_face_at(face, piece->u[i], piece->v[i]);
        add_corner(first, piece->u[i], piece->v[i], at, find_facet(&work, at).distance);
    }
    first->area = area_of(first);
    work.count = 1;
    work.slack = 0.0;
    for (int i = 0; i < near->count; i++)
        work.slack = fmax(work.slack, near->slack[i / QM_PACK_LANES][i % QM_PACK_LANES]);
    if (work.slack < fmin(first->nearest[0], fmin(first->nearest[1], first->nearest[2]))) work.slack = 0.0;

    /* Each outline is cut down to the part that belongs to the facet under its centroid. */
    int count = 0;
    while (work.count > 0) {
        outline at = take_largest(&work);
        qm_deviation_facet facet = find_facet(&work, centroid_of(&at));
        work.worth = find_min_gain(&work, &at);
        cut_along_edges(&work, &at, &facet);
        if (!fits(&work, &at, &facet)) cut_along_bisector(&work, &at, &facet);
        count = add_parts(piece, &at, part, count);
    }
    for (int i = 0; i < count; i++)
        work.leak += flip_leak(&part[i]);
    *leak += work.leak;
    return count;
}

/** True when the sum of two numbers is not rounded, so that their midpoint lies exactly between them: both
 * summands can be recovered from the sum (Moller, Knuth). */
static bool is_sum_exact(double a, double b)
{
    double sum = a + b, part = sum - a;
    return a - (sum - part) == 0.0 && b - part == 0.0;
}

void qm_deviation_piece_halve(const qm_deviation_shape *shape, const qm_deviation_piece *piece,
                              qm_deviation_piece part[2], double *leak)
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
    *leak += flip_leak(&part[0]) + flip_leak(&part[1]);
}
