/**
 * deviation_cut.c: where a piece is cut: along the borders of the facets under it. A patch takes the place of
 * its facets where they are farther from it than the piece is: their borders then say nothing. Where a cut
 * lies decides how good the bounds of the parts are, never whether they hold. Where an edge or a vertex is the nearest, the
 * borders are planes along the normals of the facets that meet there.
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
#include "deviation_feature.h"
#include "deviation_match.h"

#define OUTLINE_CORNERS 16
#define FACET_LIMIT (QM_FACET_PACKS * QM_PACK_LANES)
#define MAX_CUTS ((QM_DEVIATION_PARTS - 1) / 2)
#define MARGIN 1e-4 /* of an outline's size: less than this on one side of a line is not cut off, */
#define THIN 0.25   /* unless its share of the size, times its width, exceeds this part of worth, */
#define LEAST_MARGIN 1e-9
#define SNAP 1e-2 /* of the margin: corners this near to a line lie on it */

/** A convex polygon of parameters. */
typedef struct outline {
    int count;
    double u[OUTLINE_CORNERS], v[OUTLINE_CORNERS];
    qm_vec at[OUTLINE_CORNERS];
    double nearest[OUTLINE_CORNERS]; /* distance to the listed facets */
    double area;
} outline;

/** A part of the target that an outline may belong to: a facet, or a patch in place of its facets. */
typedef struct cell {
    int index; /* of the facet, or FACET_LIMIT and that of the rectangle */
    double distance;
    qm_triangle triangle;
    const qm_bilinear *patch; /* NULL of a facet */
} cell;

typedef struct cut_work {
    const qm_deviation_setup *setup;
    const qm_deviation_face *face;
    const qm_deviation_facets *near;
    bool has_patches;            /* the patches themselves are measured, not their facets */
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

/* ---- cells ---- */

static double patch_distance(const qm_bilinear *patch, qm_vec p)
{
    double at[2] = {0.5, 0.5};
    qm_deviation_match_foot(patch, p, true, at);
    return qm_vec_distance(p, qm_bilinear_at(patch, at[0], at[1]));
}

static cell find_facet(const cut_work *work, qm_vec p)
{
    qm_deviation_facet found = qm_deviation_facets_nearest(work->setup->kernel, work->near, p);
    return (cell){found.index, found.distance, found.triangle, NULL};
}

/** The cell nearest to a point, with patches in place of their facets. */
static cell find_patch(const cut_work *work, qm_vec p)
{
    const qm_deviation_facets *near = work->near;
    cell found = {.distance = INFINITY};
    double least[QM_MAX_RECTANGLES]; /* distance of a patch from below */
    for (int i = 0; i < near->rectangle_count; i++)
        least[i] = INFINITY;
    for (int pack = 0; pack < near->pack_count; pack++) {
        _Alignas(64) double d2[QM_PACK_LANES];
        work->setup->kernel->pack_distances(&near->pack[pack], p, d2);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            int rectangle = near->rectangle_of[pack][lane];
            double distance = sqrt(d2[lane]);
            if (rectangle != QM_NO_RECTANGLE) {
                least[rectangle] = qm_min(least[rectangle], distance - near->slack[pack][lane]);
            } else if (distance < found.distance) {
                found.distance = distance;
                found.index = pack * QM_PACK_LANES + lane;
            }
        }
    }
    for (int i = 0; i < near->rectangle_count; i++) {
        if (!(least[i] < found.distance)) continue;
        double distance = patch_distance(&near->rectangle[i].patch, p);
        if (!(distance < found.distance)) continue;
        found.distance = distance;
        found.index = FACET_LIMIT + i;
    }
    if (found.index >= FACET_LIMIT)
        found.patch = &near->rectangle[found.index - FACET_LIMIT].patch;
    else
        found.triangle =
            qm_deviation_facet_at(&near->pack[found.index / QM_PACK_LANES], found.index % QM_PACK_LANES);
    return found;
}

static cell find_cell(const cut_work *work, qm_vec p)
{
    return work->has_patches ? find_patch(work, p) : find_facet(work, p);
}

static double distance_from(const cell *of, qm_vec p)
{
    return of->patch ? patch_distance(of->patch, p) : sqrt(qm_triangle_distance2(&of->triangle, p));
}

static qm_vec patch_normal(const qm_bilinear *patch, const double at[2])
{
    qm_vec normal =
        qm_vec_cross(qm_vec_axpy(patch->e1, at[1], patch->w), qm_vec_axpy(patch->e2, at[0], patch->w));
    double length = qm_vec_norm(normal);
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
}

/** The signed distance from the plane of a facet, or from the surface of a patch, also beyond its edges. */
static double height_over(const cell *of, qm_vec p)
{
    if (!of->patch) return qm_vec_dot(qm_vec_sub(p, of->triangle.origin), of->triangle.z);
    double at[2] = {0.5, 0.5};
    qm_deviation_match_foot(of->patch, p, false, at);
    return qm_vec_dot(qm_vec_sub(p, qm_bilinear_at(of->patch, at[0], at[1])), patch_normal(of->patch, at));
}

/** How far points lie inside of the planes that stand on an edge of a cell, as seen from a point. */
static void distances_inside(const cell *of, int edge, qm_vec from, const outline *o,
                             double value[OUTLINE_CORNERS])
{
    if (!of->patch) {
        for (int i = 0; i < o->count; i++) {
            double inside[3];
            qm_deviation_facet_edges(&of->triangle, o->at[i], inside);
            value[i] = inside[edge];
        }
        return;
    }
    const qm_uv_box whole = {{0.0, 0.0}, {1.0, 1.0}};
    double at[2] = {0.5, 0.5};
    qm_vec corner[4];
    qm_uv_box_corners(of->patch, &whole, corner);
    qm_deviation_match_foot(of->patch, from, true, at);
    qm_vec inwards =
        qm_vec_cross(patch_normal(of->patch, at), qm_vec_sub(corner[(edge + 1) % 4], corner[edge]));
    double length = qm_vec_norm(inwards);
    if (length > QM_MIN_LENGTH) inwards = qm_vec_scale(1.0 / length, inwards);
    for (int i = 0; i < o->count; i++)
        value[i] = qm_vec_dot(inwards, qm_vec_sub(o->at[i], corner[edge]));
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
    add_corner(one, u, v, at, find_cell(work, at).distance);
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
    double margin = fmax(LEAST_MARGIN * size, fmin(MARGIN * size, sqrt(THIN * size * work->worth)));
    for (int i = 0; i < o->count; i++) {
        low = fmin(low, value[i]);
        high = fmax(high, value[i]);
        if (fabs(value[i]) <= SNAP * margin) value[i] = 0.0;
    }
    bool has_room = work->cuts < work->cut_limit && o->count + 2 <= OUTLINE_CORNERS;
    if (!has_room || -low <= margin || high <= margin || !has_one_chord(o, value)) return false;
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
    double area = work->setup->cell_area;
    double worth = work->setup->worth * (o->area < area ? area / fmax(o->area, 1e-6 * area) : 1.0);
    return fmax(worth, work->slack);
}

/** Whether a cell misfits a corner: another one is nearer by more than the gain that a cut must bring, or the
 * corner is beside it, and farther from it than from its plane or surface. */
static bool misfits_at(const cut_work *work, const outline *o, const cell *of, int corner)
{
    double distance = distance_from(of, o->at[corner]);
    return distance - o->nearest[corner] > work->worth ||
           distance - fabs(height_over(of, o->at[corner])) > work->worth;
}

static bool fits(const cut_work *work, const outline *o, const cell *of)
{
    for (int i = 0; i < o->count; i++)
        if (misfits_at(work, o, of, i)) return false;
    return true;
}

/** Cuts off the parts beyond the planes on the edges of a cell, where a corner there misfits. */
static void cut_along_edges(cut_work *work, outline *o, const cell *of, qm_vec from)
{
    for (int edge = 0; edge < (of->patch ? 4 : 3); edge++) {
        double value[OUTLINE_CORNERS];
        bool misfits = false;
        distances_inside(of, edge, from, o, value);
        for (int i = 0; i < o->count; i++)
            misfits |= value[i] < 0.0 && misfits_at(work, o, of, i);
        if (misfits && cut(work, o, value)) work->worth = find_min_gain(work, o);
    }
}

/** Cuts along the bisector of two cells, where the heights over both are equal, as seen from the side of o:
 * for a corner that is nearer to another facet. */
static bool cut_along_bisector(cut_work *work, outline *o, const cell *of)
{
    for (int i = 0; i < o->count; i++) {
        cell other = find_cell(work, o->at[i]);
        double here = height_over(of, o->at[i]), there = height_over(&other, o->at[i]);
        if (other.index == of->index || !(fabs(here) - fabs(there) > work->worth)) continue;
        double sign[2] = {here < 0.0 ? -1.0 : 1.0, there < 0.0 ? -1.0 : 1.0}, value[OUTLINE_CORNERS];
        for (int k = 0; k < o->count; k++)
            value[k] = sign[1] * height_over(&other, o->at[k]) - sign[0] * height_over(of, o->at[k]);
        if (cut(work, o, value)) return true;
    }
    return false;
}

/* ---- round an edge or a vertex ---- */

static bool find_feature(const cut_work *work, const cell *of, qm_vec p, qm_deviation_feature *feature)
{
    const double middle[2] = {0.5, 0.5};
    return of->patch ? qm_deviation_feature_of_patch(of->patch, middle, p, feature)
                     : qm_deviation_feature_under(work->near, of->index, p, feature);
}

/** The distance of each corner of an outline from a feature. */
static void measure_feature(const qm_deviation_feature *feature, const outline *o,
                            double distance[OUTLINE_CORNERS])
{
    for (int i = 0; i < o->count; i++)
        distance[i] = qm_vec_norm(qm_deviation_feature_offset(feature, o->at[i]));
}

/** Cuts off what is beyond a border of a feature, where its distance misfits a corner there. */
static void cut_border(cut_work *work, outline *o, const qm_deviation_feature *feature,
                       double value[OUTLINE_CORNERS])
{
    double distance[OUTLINE_CORNERS];
    bool misfits = false;
    measure_feature(feature, o, distance);
    for (int i = 0; i < o->count; i++)
        misfits |= value[i] < 0.0 && fabs(distance[i] - o->nearest[i]) > work->worth;
    if (misfits && cut(work, o, value)) work->worth = find_min_gain(work, o);
}

/** Cuts along the normals of one cell that meets a feature: through the vertex across each of its edges, or along
 * the edge. */
static void cut_along_normals(cut_work *work, outline *o, const qm_deviation_feature *feature,
                              const qm_vec *corner, int count)
{
    double length[4], tolerance = work->setup->eta;
    qm_vec way[4];
    int met = 0;
    for (int i = 0; i < count; i++) {
        double past[2];
        way[i] = qm_deviation_feature_offset(feature, corner[i]);
        length[i] = qm_vec_norm(way[i]);
        qm_deviation_feature_past(feature, corner[i], past);
        met += length[i] <= tolerance && past[0] <= tolerance && past[1] <= tolerance;
    }
    if (met < (feature->length > 0.0 ? 2 : 1)) return;
    for (int i = 0; i < count; i++) {
        double value[OUTLINE_CORNERS];
        if (!(length[i] > tolerance)) continue;
        for (int k = 0; k < o->count; k++)
            value[k] = -qm_vec_dot(qm_deviation_feature_offset(feature, o->at[k]), way[i]) / length[i];
        cut_border(work, o, feature, value);
    }
}

/** Cuts along the borders of the part of space that is nearest to a feature. */
static void cut_round_feature(cut_work *work, outline *o, const qm_deviation_feature *feature)
{
    const qm_deviation_facets *near = work->near;
    for (int end = 0; end < 2 && feature->length > 0.0; end++) {
        double value[OUTLINE_CORNERS];
        for (int k = 0; k < o->count; k++) {
            double past[2];
            qm_deviation_feature_past(feature, o->at[k], past);
            value[k] = -past[end];
        }
        cut_border(work, o, feature, value);
    }
    for (int i = 0; i < near->count; i++) {
        if (qm_deviation_facets_rectangle(near, i) != QM_NO_RECTANGLE) continue;
        qm_triangle t = qm_deviation_facet_at(&near->pack[i / QM_PACK_LANES], i % QM_PACK_LANES);
        qm_vec corner[3];
        qm_triangle_corners(&t, corner);
        cut_along_normals(work, o, feature, corner, 3);
    }
    for (int i = 0; i < near->rectangle_count; i++) {
        qm_vec corner[4];
        qm_uv_box_corners(&near->rectangle[i].patch, &near->rectangle[i].box, corner);
        cut_along_normals(work, o, feature, corner, 4);
    }
}

/** Cuts where a feature is as far as another cell that is nearer to a corner. */
static void cut_beside_feature(cut_work *work, outline *o, const qm_deviation_feature *feature)
{
    double distance[OUTLINE_CORNERS], value[OUTLINE_CORNERS];
    measure_feature(feature, o, distance);
    for (int i = 0; i < o->count; i++) {
        if (!(distance[i] - o->nearest[i] > work->worth)) continue;
        cell other = find_cell(work, o->at[i]);
        for (int k = 0; k < o->count; k++)
            value[k] = distance_from(&other, o->at[k]) - distance[k];
        if (cut(work, o, value)) return;
    }
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
    double nearest = INFINITY;
    first->count = 0;
    for (int i = 0; i < 3; i++) {
        qm_vec at = qm_deviation_face_at(face, piece->u[i], piece->v[i]);
        add_corner(first, piece->u[i], piece->v[i], at, find_facet(&work, at).distance);
        nearest = fmin(nearest, first->nearest[i]);
    }
    first->area = area_of(first);
    work.count = 1;
    bool has_planes = false;
    for (int i = 0; i < near->rectangle_count; i++)
        has_planes |= near->rectangle[i].is_plane;
    double slack[2] = {0.0, 0.0}; /* the greatest of a facet, and of one that is no part of a patch */
    for (int i = 0; i < near->count; i++) {
        double here = near->slack[i / QM_PACK_LANES][i % QM_PACK_LANES];
        slack[0] = fmax(slack[0], here);
        if (qm_deviation_facets_rectangle(near, i) == QM_NO_RECTANGLE) slack[1] = fmax(slack[1], here);
    }
    work.has_patches = has_planes || (!(slack[0] < nearest) && slack[0] > slack[1]);
    for (int i = 0; i < 3 && work.has_patches; i++) {
        first->nearest[i] = find_patch(&work, first->at[i]).distance;
        nearest = fmin(nearest, first->nearest[i]);
    }
    work.slack = work.has_patches ? slack[1] : slack[0];
    if (work.slack < nearest) work.slack = 0.0;

    /* Each outline is cut down to the part that belongs to the cell under its centroid. */
    int count = 0;
    while (work.count > 0) {
        outline at = take_largest(&work);
        qm_vec centroid = centroid_of(&at);
        cell of = find_cell(&work, centroid);
        work.worth = find_min_gain(&work, &at);
        qm_deviation_feature feature;
        if (find_feature(&work, &of, centroid, &feature)) {
            cut_round_feature(&work, &at, &feature);
            cut_beside_feature(&work, &at, &feature);
        } else {
            cut_along_edges(&work, &at, &of, centroid);
            if (!fits(&work, &at, &of)) cut_along_bisector(&work, &at, &of);
        }
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
