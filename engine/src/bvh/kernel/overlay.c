/**
 * overlay.c: facets of the target that lie over a face of the source, and their vertical distances from it.
 * The vertical distance is linear over the intersection of a facet and a face; so its max is at a corner of
 * that: where an edge of the facet enters or leaves the face, or at a corner of the face under the facet. The
 * kernel computes neither where all corners of the facet are within the threshold of the plane of the face,
 * or all corners of the face within the threshold of the plane of the facet: the intersection lies within
 * both.
 *
 * Roundings. Let s be the max coordinate by magnitude. The half planes of a face are taken QM_OVERLAY_SIDE u
 * s wider, and facets QM_OVERLAY_AREA u s^2 (of a doubled area), than computed, see hausdorff_overlay.c: so
 * all that truly lies over the face is included. A corner (x, y) of the face truly under a facet has weights
 * w_k / w, w = w_0 + w_1 + w_2, for the gaps g_k at the facet's corners; the computed ones are off by d_k,
 * |d_k| <= QM_OVERLAY_AREA u s^2, and the gap by |sum d_k (g_k
 * - g)| / |w| at most, where w is the computed sum: three times the bound of d_k times the range of g_k.
 *   Where that exceeds max |g_k|, max |g_k| is the bound. All else is left to the caller's margin: the
 *   interpolated gaps are off by a few u of the gaps that they lie between.
 */
#include <string.h>

#include "kernels.h"
#include "simd.h"

#define NOT_OVER -1.0

/** A facet in each lane, relative to one face. */
typedef struct wide_facet {
    qm_vd x[3], y[3];
    qm_vd inside[3][3]; /* of edge k of the face, by corner; with the margin */
    qm_vd gap[3];       /* of the planes, by corner of the facet */
    qm_vl beyond;       /* all ones where the facet lies beyond an edge of the face */
} wide_facet;

static inline qm_vd magnitude(qm_vd a)
{
    return qm_vd_max(a, -a);
}

static inline qm_vd affine(const double f[3], qm_vd x, qm_vd y)
{
    return x * f[0] + y * f[1] + f[2];
}

static inline bool is_all(qm_vl mask)
{
    return qm_vl_bits(mask) == (1u << QM_WIDTH) - 1;
}

static inline void load_corners(wide_facet *f, const double at[3][3][QM_PACK_LANES], int first)
{
    for (int i = 0; i < 3; i++) {
        f->x[i] = qm_vd_load(&at[i][0][first]);
        f->y[i] = qm_vd_load(&at[i][1][first]);
    }
}

/** False when all facets lie beyond an edge of the face. */
static inline bool load_facet(wide_facet *f, const double at[3][3][QM_PACK_LANES], int first,
                              const qm_overlay_face *face, double margin)
{
    load_corners(f, at, first);
    const qm_vd zero = qm_vd_set(0.0);
    f->beyond = zero > zero;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            f->inside[k][i] = affine(face->side[k], f->x[i], f->y[i]) + margin;
        f->beyond |= (f->inside[k][0] < zero) & (f->inside[k][1] < zero) & (f->inside[k][2] < zero);
    }
    if (is_all(f->beyond)) return false;
    for (int i = 0; i < 3; i++)
        f->gap[i] = qm_vd_load(&at[i][2][first]) - affine(face->plane, f->x[i], f->y[i]);
    return true;
}

/** The max gap along an edge of each facet, over the face; NOT_OVER where the edge is not over the face. */
static inline qm_vd edge_gap(const wide_facet *f, int from, int to)
{
    const qm_vd zero = qm_vd_set(0.0), one = qm_vd_set(1.0);
    qm_vd enter = zero, leave = one;
    qm_vl outside = zero > one;
    for (int k = 0; k < 3; k++) {
        qm_vd a = f->inside[k][from], b = f->inside[k][to], cross = a / (a - b);
        outside |= (a < zero) & (b < zero);
        enter = qm_vd_max(enter, qm_vd_select(a < zero, cross, zero));
        leave = qm_vd_min(leave, qm_vd_select(b < zero, cross, one));
    }
    qm_vd rise = f->gap[to] - f->gap[from];
    qm_vd gap = qm_vd_max(magnitude(f->gap[from] + enter * rise), magnitude(f->gap[from] + leave * rise));
    return qm_vd_select((enter <= leave) & ~outside, gap, qm_vd_set(NOT_OVER));
}

/** Doubled areas of the triangles of (x, y) and each edge of the facets. */
static inline void find_weights(const wide_facet *f, double x, double y, qm_vd weight[3])
{
    for (int i = 0; i < 3; i++) {
        int next = (i + 1) % 3;
        weight[i] = (f->x[next] - f->x[i]) * (y - f->y[i]) - (f->y[next] - f->y[i]) * (x - f->x[i]);
    }
}

/** Lanes in which all weights are at least limit, or all at most -limit. */
static inline qm_vl have_one_sign(const qm_vd weight[3], double limit)
{
    qm_vd low = qm_vd_min(weight[0], qm_vd_min(weight[1], weight[2]));
    qm_vd high = qm_vd_max(weight[0], qm_vd_max(weight[1], weight[2]));
    return (low >= qm_vd_set(limit)) | (high <= qm_vd_set(-limit));
}

/** The gap at a corner of the face; NOT_OVER where the corner is not under the facet. */
static inline qm_vd corner_gap(const wide_facet *f, const double corner[3], double margin)
{
    qm_vd weight[3];
    find_weights(f, corner[0], corner[1], weight);
    qm_vl under = have_one_sign(weight, -margin);
    if (!qm_vl_bits(under)) return qm_vd_set(NOT_OVER);
    const qm_vd *g = f->gap;
    qm_vd sum = weight[0] + weight[1] + weight[2];
    qm_vd here = (weight[1] * g[0] + weight[2] * g[1] + weight[0] * g[2]) / sum;
    qm_vd low = qm_vd_min(g[0], qm_vd_min(g[1], g[2])), high = qm_vd_max(g[0], qm_vd_max(g[1], g[2]));
    qm_vd error = 3.0 * margin * (high - low) / magnitude(sum);
    qm_vd bound =
        qm_vd_min(magnitude(here) + error, qm_vd_max(high, -low)); /* the latter where the former is NaN */
    return qm_vd_select(under, bound, qm_vd_set(NOT_OVER));
}

/**
 * The min of three bounds: of the gaps between the whole face and the planes of the facets, and between the
 * whole facets and the plane of the face, both with the facets' twists; and between the whole patches and the
 * plane of the face. The latter is linear along the patch's hull, hence largest at one of the four corners.
 */
static inline qm_vd whole_gap(const wide_facet *f, const qm_overlay_facets *facets, int group, int first,
                              const qm_overlay_face *face)
{
    qm_vd by_face = qm_vd_max(magnitude(f->gap[0]), qm_vd_max(magnitude(f->gap[1]), magnitude(f->gap[2])));
    qm_vd plane[3], by_facet = qm_vd_set(0.0);
    for (int k = 0; k < 3; k++)
        plane[k] = qm_vd_load(&facets->group[group].plane[k][first]);
    for (int i = 0; i < 3; i++) {
        const double *c = face->corner[i];
        by_facet = qm_vd_max(magnitude(plane[0] * c[0] + plane[1] * c[1] + plane[2] - c[2]), by_facet);
    }
    by_facet += qm_vd_load(&facets->group[group].plane_error[first]);
    qm_vd gap = qm_vd_min(by_facet, by_face) + qm_vd_load(&facets->group[group].twist[first]);
    if (!facets->has_patches) return gap;
    qm_vd opposite[3];
    for (int k = 0; k < 3; k++)
        opposite[k] = qm_vd_load(&facets->group[group].opposite[k][first]);
    qm_vd opposite_gap = opposite[2] - affine(face->plane, opposite[0], opposite[1]);
    return qm_vd_min(qm_vd_max(magnitude(opposite_gap), by_face), gap);
}

/** The max gap over the intersection of each facet and the face; NOT_OVER where it is empty. */
static inline qm_vd common_gap(const wide_facet *f, const qm_overlay_face *face, double area_margin)
{
    qm_vd gap = edge_gap(f, 0, 1);
    gap = qm_vd_max(gap, qm_vd_max(edge_gap(f, 1, 2), edge_gap(f, 2, 0)));
    for (int i = 0; i < 3; i++)
        gap = qm_vd_max(gap, corner_gap(f, face->corner[i], area_margin));
    return gap;
}

_Static_assert(3 * QM_PACK_LANES % QM_WIDTH == 0, "vertices fill whole vectors");

static inline void load_positions(qm_overlay_vertices *m, const qm_bvh *bvh, const qm_pack_lanes *lanes)
{
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *p = bvh->mesh.positions + 3 * (size_t)lanes->vertex[i];
        for (int k = 0; k < 3; k++)
            m->at[k][i] = p[k];
    }
    for (int i = lanes->vertex_count; i % QM_WIDTH != 0; i++)
        for (int k = 0; k < 3; k++)
            m->at[k][i] = m->at[k][0];
}

/** Maps the vertices to the frame; returns the max coordinate by magnitude. */
static inline double map_pack(qm_overlay_vertices *m, const qm_overlay_frame *frame, const qm_bvh *bvh,
                              const qm_pack_lanes *lanes)
{
    load_positions(m, bvh, lanes);
    const double shift[3] = {bvh->frame.origin.x, bvh->frame.origin.y, bvh->frame.origin.z};
    const double origin[3] = {frame->origin.x, frame->origin.y, frame->origin.z};
    qm_vd size = qm_vd_set(0.0);
    for (int i = 0; i < lanes->vertex_count; i += QM_WIDTH) {
        qm_vd d[3];
        for (int k = 0; k < 3; k++)
            d[k] = (qm_vd_load(&m->at[k][i]) - shift[k]) * bvh->frame.scale - origin[k];
        qm_vl beyond = {0};
        for (int k = 0; k < 3; k++) {
            const qm_vec *axis = &frame->axis[k];
            qm_vd at = d[0] * axis->x + d[1] * axis->y + d[2] * axis->z;
            qm_vd_store(&m->at[k][i], at);
            size = qm_vd_max(magnitude(at), size);
            beyond |= (at < qm_vd_set(frame->low[k])) & (INT64_C(1) << 2 * k);
            beyond |= (at > qm_vd_set(frame->high[k])) & (INT64_C(2) << 2 * k);
        }
        memcpy(&m->beyond[i], &beyond, sizeof beyond);
    }
    double max = 0.0;
    for (int lane = 0; lane < QM_WIDTH; lane++)
        max = qm_max(size[lane], max);
    return max;
}

/** Sets the corner of a lane's patch that the lane lacks. */
static void set_opposite(qm_overlay_facets *facets, int group, int here, const qm_overlay_vertices *vertices,
                         const qm_pack_lanes *lanes, uint32_t lane)
{
    double(*opposite)[QM_PACK_LANES] = facets->group[group].opposite;
    bool is_second = qm_lane_is_second(lanes, lane),
         is_alone = !is_second && !qm_lane_has_second(lanes, lane);
    const uint8_t *other = lanes->corner[is_alone ? lane : is_second ? lane - 1 : lane + 1];
    int from = other[is_second ? 1 : 2];
    for (int k = 0; k < 3; k++)
        opposite[k][here] = vertices->at[k][from];
    int64_t beyond = vertices->beyond[other[0]] & vertices->beyond[other[1]] & vertices->beyond[other[2]];
    bool is_missing = beyond && !(beyond & QM_OVERLAY_BESIDE);
    if (is_alone || is_missing) opposite[2][here] = INFINITY;
    facets->group[group].is_second[here] = is_second;
}

unsigned QM_KERNEL(overlay_add)(qm_overlay_facets *facets, const qm_overlay_frame *frame, const qm_bvh *bvh,
                                uint32_t pack, const float *twist, qm_overlay_vertices *vertices)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    double size = map_pack(vertices, frame, bvh, lanes);
    const int64_t *beyond = vertices->beyond;
    unsigned added = 0;
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        const uint8_t *corner = lanes->corner[lane];
        if (beyond[corner[0]] & beyond[corner[1]] & beyond[corner[2]]) continue;
        QM_ASSERT(facets->count < QM_OVERLAY_GROUPS * QM_PACK_LANES);
        int group = facets->count / QM_PACK_LANES, here = facets->count % QM_PACK_LANES;
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                facets->group[group].at[i][k][here] = vertices->at[k][corner[i]];
        facets->group[group].twist[here] = twist ? (double)twist[lane] : 0.0;
        if (twist) set_opposite(facets, group, here, vertices, lanes, (uint32_t)lane);
        facets->count++;
        added |= 1u << lane;
    }
    if (added) facets->size = qm_max(size, facets->size);
    return added;
}

/** Pads the last group with copies of its first facet. */
static void fill_up(qm_overlay_facets *facets)
{
    int group = facets->count / QM_PACK_LANES;
    for (int to = facets->count; to % QM_PACK_LANES != 0; to++)
        qm_overlay_copy_facet(facets, group * QM_PACK_LANES, to);
}

/** Sets the planes of facets, as qm_overlay_set_face sets that of a face. */
static inline void set_planes(qm_overlay_facets *facets, int group, int first)
{
    qm_vd at[3][3], to[2][3];
    for (int i = 0; i < 9; i++)
        at[i / 3][i % 3] = qm_vd_load(&facets->group[group].at[i / 3][i % 3][first]);
    for (int i = 0; i < 6; i++)
        to[i / 3][i % 3] = at[1 + i / 3][i % 3] - at[0][i % 3];
    qm_vd across[2] = {to[1][0] - to[0][0], to[1][1] - to[0][1]};
    qm_vd longest2 = qm_vd_max(
        to[0][0] * to[0][0] + to[0][1] * to[0][1],
        qm_vd_max(to[1][0] * to[1][0] + to[1][1] * to[1][1], across[0] * across[0] + across[1] * across[1]));
    qm_vd area = to[0][0] * to[1][1] - to[1][0] * to[0][1], length = qm_vd_sqrt(longest2);
    qm_vd slope_x = (to[0][2] * to[1][1] - to[1][2] * to[0][1]) / area,
          slope_y = (to[0][0] * to[1][2] - to[1][0] * to[0][2]) / area;
    qm_vd plane[3] = {slope_x, slope_y, at[0][2] - (slope_x * at[0][0] + slope_y * at[0][1])};
    double unit = QM_OVERLAY_GAP * QM_UNIT_ROUNDING * facets->size;
    qm_vl is_fit = (magnitude(slope_x) + magnitude(slope_y) <= qm_vd_set(QM_OVERLAY_SLOPE)) &
                   (magnitude(area) > unit * length);
    qm_vd plane_error = unit * (1.0 + facets->size * length / magnitude(area));
    for (int k = 0; k < 3; k++)
        qm_vd_store(&facets->group[group].plane[k][first], qm_vd_select(is_fit, plane[k], qm_vd_set(0.0)));
    qm_vd_store(&facets->group[group].plane_error[first],
                qm_vd_select(is_fit, plane_error, qm_vd_set(INFINITY)));
}

static inline void set_group_box(qm_overlay_facets *facets, int group)
{
    for (int k = 0; k < 2; k++) {
        qm_vd low = qm_vd_set(INFINITY), high = -low;
        for (int i = 0; i < 3 * QM_PARTS; i++) {
            qm_vd at = qm_vd_load(&facets->group[group].at[i / QM_PARTS][k][i % QM_PARTS * QM_WIDTH]);
            low = qm_vd_min(at, low);
            high = qm_vd_max(at, high);
        }
        facets->low[k][group] = INFINITY;
        facets->high[k][group] = -INFINITY;
        for (int lane = 0; lane < QM_WIDTH; lane++) {
            facets->low[k][group] = qm_min(low[lane], facets->low[k][group]);
            facets->high[k][group] = qm_max(high[lane], facets->high[k][group]);
        }
    }
}

/** Boxes past the last group are empty. */
void QM_KERNEL(overlay_close)(qm_overlay_facets *facets)
{
    QM_ASSERT(facets->count > 0 && facets->count <= QM_OVERLAY_GROUPS * QM_PACK_LANES);
    fill_up(facets);
    int group = 0;
    for (; group * QM_PACK_LANES < facets->count; group++) {
        set_group_box(facets, group);
        for (int part = 0; part < QM_PARTS; part++)
            set_planes(facets, group, part * QM_WIDTH);
    }
    for (; group % QM_WIDTH != 0; group++) {
        for (int k = 0; k < 2; k++) {
            facets->low[k][group] = INFINITY;
            facets->high[k][group] = -INFINITY;
        }
    }
}

/** Each edge of the rim must certainly lie beside the face: beyond one edge of the face, or with the whole
 * face on one side of its line. */
bool QM_KERNEL(overlay_is_clear)(const qm_overlay_facets *facets, const qm_overlay_face *face)
{
    double side_margin = QM_OVERLAY_SIDE * QM_UNIT_ROUNDING * facets->size;
    double area_margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * facets->size * facets->size;
    for (int first = 0; first < facets->rim_count; first += QM_WIDTH) {
        qm_vd x[2], y[2];
        for (int end = 0; end < 2; end++) {
            x[end] = qm_vd_load(&facets->rim[end][0][first]);
            y[end] = qm_vd_load(&facets->rim[end][1][first]);
        }
        const qm_vd outside = qm_vd_set(-side_margin);
        qm_vl separated = outside > outside;
        qm_vd low = qm_vd_set(INFINITY), high = -low;
        for (int k = 0; k < 3; k++) {
            separated |=
                (affine(face->side[k], x[0], y[0]) < outside) & (affine(face->side[k], x[1], y[1]) < outside);
            qm_vd area =
                (x[1] - x[0]) * (face->corner[k][1] - y[0]) - (y[1] - y[0]) * (face->corner[k][0] - x[0]);
            low = qm_vd_min(area, low);
            high = qm_vd_max(area, high);
        }
        separated |= (low > qm_vd_set(area_margin)) | (high < qm_vd_set(-area_margin));
        if (!is_all(separated)) return false;
    }
    return true;
}

_Static_assert(QM_OVERLAY_GROUPS <= 32 && QM_OVERLAY_GROUPS % QM_WIDTH == 0, "a bit for each group");

/** Bits of the groups whose boxes meet a box. */
static inline unsigned groups_about(const qm_overlay_facets *facets, const double low[2],
                                    const double high[2])
{
    unsigned groups = 0;
    for (int first = 0; first * QM_PACK_LANES < facets->count; first += QM_WIDTH) {
        const qm_vd zero = qm_vd_set(0.0);
        qm_vl meet = zero <= zero;
        for (int k = 0; k < 2; k++)
            meet &= (qm_vd_load(&facets->low[k][first]) <= qm_vd_set(high[k])) &
                    (qm_vd_load(&facets->high[k][first]) >= qm_vd_set(low[k]));
        groups |= qm_vl_bits(meet) << first;
    }
    return groups;
}

static inline unsigned groups_over(const qm_overlay_facets *facets, const qm_overlay_face *face)
{
    double low[2], high[2];
    for (int k = 0; k < 2; k++) {
        double a = face->corner[0][k], b = face->corner[1][k], c = face->corner[2][k];
        low[k] = qm_min(a, qm_min(b, c));
        high[k] = qm_max(a, qm_max(b, c));
    }
    return groups_about(facets, low, high);
}

double QM_KERNEL(overlay_gap)(const qm_overlay_facets *facets, const qm_overlay_face *face, double threshold,
                              uint8_t *far)
{
    double side_margin = QM_OVERLAY_SIDE * QM_UNIT_ROUNDING * facets->size;
    double area_margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * facets->size * facets->size;
    const qm_vd none = qm_vd_set(NOT_OVER);
    qm_vd max = none;
    for (unsigned groups = groups_over(facets, face); groups; groups &= groups - 1) {
        int group = __builtin_ctz(groups);
        for (int first = 0; first < QM_PACK_LANES; first += QM_WIDTH) {
            wide_facet f;
            if (!load_facet(&f, facets->group[group].at, first, face, side_margin)) continue;
            const qm_vd twist = qm_vd_load(&facets->group[group].twist[first]);
            qm_vd gap = whole_gap(&f, facets, group, first, face);
            qm_vl is_open = ~(gap <= qm_vd_set(threshold)) & ~f.beyond;
            if (qm_vl_bits(is_open)) {
                qm_vd common = common_gap(&f, face, area_margin);
                common = qm_vd_select(common >= qm_vd_set(0.0), common + twist, none);
                gap = qm_vd_select(is_open, common, gap);
            }
            gap = qm_vd_select(f.beyond, none, gap);
            if (far) far[group] |= (uint8_t)(qm_vl_bits(~(gap <= qm_vd_set(threshold))) << first);
            max = qm_vd_max(gap, max);
        }
    }
    double out = NOT_OVER;
    for (int lane = 0; lane < QM_WIDTH; lane++)
        out = qm_max(max[lane], out);
    return out;
}

int QM_KERNEL(overlay_count)(const qm_overlay_facets *facets, const qm_overlay_face *face)
{
    double margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * facets->size * facets->size;
    int count = 0;
    for (unsigned groups = groups_about(facets, face->probe, face->probe); groups; groups &= groups - 1) {
        int group = __builtin_ctz(groups);
        for (int first = 0; first < QM_PACK_LANES; first += QM_WIDTH) {
            wide_facet f;
            qm_vd weight[3];
            load_corners(&f, facets->group[group].at, first);
            find_weights(&f, face->probe[0], face->probe[1], weight);
            int left = facets->count - (group * QM_PACK_LANES + first);
            unsigned there = left <= 0 ? 0 : left < QM_WIDTH ? (1u << left) - 1 : ~0u;
            unsigned maybe = qm_vl_bits(have_one_sign(weight, -margin)) & there;
            if (maybe != (qm_vl_bits(have_one_sign(weight, margin)) & there)) return -1;
            count += __builtin_popcount(maybe);
        }
    }
    return count;
}
