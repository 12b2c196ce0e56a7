/**
 * overlay.c: facets of the target that lie over a face of the source, and their vertical distances from it.
 * The vertical distance is linear over what a facet and a face have in common; so it is greatest in a corner
 * of that: where an edge of the facet enters or leaves the face, or in a corner of the face under the facet.
 *
 * Roundings. Let s be the greatest coordinate by magnitude. The half planes of a face are taken
 * QM_OVERLAY_SIDE u s wider, and facets QM_OVERLAY_AREA u s^2 (of a doubled area), than they are computed,
 * see ../hausdorff_overlay.h: nothing that truly lies over the face is missed. A corner (x, y) of the face
 * truly under a facet has weights w_k / w, w = w_0 + w_1 + w_2, for the gaps g_k in the facet's corners; the
 * computed ones are off by d_k, |d_k| <= QM_OVERLAY_AREA u s^2, and the gap by |sum d_k (g_k - g)| / |w| at
 * most, where w is what is computed: three times the bound of d_k times the range of g_k. Where that is more
 * than the greatest |g_k|, this is taken. The rest is left to the caller's margin: the interpolated gaps are
 * off by a few u of what they lie between.
 */
#include <string.h>

#include "../hausdorff_overlay.h"
#include "kernels.h"

#define NOT_OVER -1.0

/** A facet in each lane, as one face sees it. */
typedef struct wide_facet {
    qm_vd x[3], y[3];
    qm_vd inside[3][3]; /* of edge k of the face, by corner; with the margin */
    qm_vd gap[3];       /* of the planes, by corner of the facet */
} wide_facet;

static inline qm_vd magnitude(qm_vd a)
{
    return qm_vd_max(a, -a);
}

static inline qm_vd affine(const double f[3], qm_vd x, qm_vd y)
{
    return x * f[0] + y * f[1] + f[2];
}

/** False when all facets lie beyond an edge of the face. */
static inline bool load_facet(wide_facet *f, const double at[3][3][QM_PACK_LANES], int part,
                              const qm_overlay_face *face, double margin)
{
    for (int i = 0; i < 3; i++) {
        f->x[i] = qm_vd_load(&at[i][0][part * QM_WIDTH]);
        f->y[i] = qm_vd_load(&at[i][1][part * QM_WIDTH]);
    }
    const qm_vd zero = qm_vd_set(0.0);
    qm_vl beyond = zero > zero;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            f->inside[k][i] = affine(face->side[k], f->x[i], f->y[i]) + margin;
        beyond |= (f->inside[k][0] < zero) & (f->inside[k][1] < zero) & (f->inside[k][2] < zero);
    }
    if (qm_vl_bits(beyond) == (1u << QM_WIDTH) - 1) return false;
    for (int i = 0; i < 3; i++)
        f->gap[i] = qm_vd_load(&at[i][2][part * QM_WIDTH]) - affine(face->plane, f->x[i], f->y[i]);
    return true;
}

/** The greatest gap along an edge of each facet, over the face; NOT_OVER where it is not over the face. */
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

/** Lanes in which all weights are at least so much, or minus that at most. */
static inline qm_vl have_one_sign(const qm_vd weight[3], double least)
{
    qm_vd low = qm_vd_min(weight[0], qm_vd_min(weight[1], weight[2]));
    qm_vd high = qm_vd_max(weight[0], qm_vd_max(weight[1], weight[2]));
    return (low >= qm_vd_set(least)) | (high <= qm_vd_set(-least));
}

/** The gap in a corner of the face; NOT_OVER where it is not under the facet. */
static inline qm_vd corner_gap(const wide_facet *f, const double corner[3], double margin)
{
    qm_vd weight[3];
    find_weights(f, corner[0], corner[1], weight);
    qm_vl under = have_one_sign(weight, -margin);
    if (!qm_vl_bits(under)) return qm_vd_set(NOT_OVER);
    const qm_vd *g = f->gap;
    qm_vd whole = weight[0] + weight[1] + weight[2];
    qm_vd here = (weight[1] * g[0] + weight[2] * g[1] + weight[0] * g[2]) / whole;
    qm_vd low = qm_vd_min(g[0], qm_vd_min(g[1], g[2])), high = qm_vd_max(g[0], qm_vd_max(g[1], g[2]));
    qm_vd error = 3.0 * margin * (high - low) / magnitude(whole);
    qm_vd bound = qm_vd_min(magnitude(here) + error, qm_vd_max(high, -low)); /* the latter of no number */
    return qm_vd_select(under, bound, qm_vd_set(NOT_OVER));
}

/** Sets the bits of those facets that certainly are over the probe of a face, or beside it. */
static inline void look_at_probe(const wide_facet *f, const double probe[2], double margin, int first,
                                 qm_overlay_gaps *out)
{
    qm_vd weight[3];
    find_weights(f, probe[0], probe[1], weight);
    int group = first / QM_PACK_LANES, shift = first % QM_PACK_LANES;
    unsigned over = qm_vl_bits(have_one_sign(weight, margin));
    unsigned beside = ~qm_vl_bits(have_one_sign(weight, -margin)) & ((1u << QM_WIDTH) - 1);
    out->over_probe[group] |= (uint8_t)(over << shift);
    out->beside_probe[group] |= (uint8_t)(beside << shift);
}

enum { MAX_VERTICES = 3 * QM_PACK_LANES };
_Static_assert(MAX_VERTICES % QM_WIDTH == 0, "vertices fill whole vectors");

/** The vertices of a pack in a frame, by axis, and on which sides of its box each lies: a bit a side. */
typedef struct mapped_pack {
    _Alignas(64) double at[3][MAX_VERTICES];
    _Alignas(64) int64_t beyond[MAX_VERTICES];
} mapped_pack;

static inline void load_positions(mapped_pack *m, const qm_bvh *bvh, const qm_pack_lanes *lanes)
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

/** Maps the vertices; returns the greatest coordinate by magnitude. */
static inline double map_pack(mapped_pack *m, const qm_overlay_frame *frame, const qm_bvh *bvh,
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
    double greatest = 0.0;
    for (int lane = 0; lane < QM_WIDTH; lane++)
        greatest = qm_greater(size[lane], greatest);
    return greatest;
}

unsigned QM_KERNEL(overlay_add)(qm_overlay_facets *facets, const qm_overlay_frame *frame, const qm_bvh *bvh,
                                uint32_t pack, const float *twist)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    mapped_pack m;
    double size = map_pack(&m, frame, bvh, lanes);
    unsigned added = 0;
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        const uint8_t *corner = lanes->corner[lane];
        if (m.beyond[corner[0]] & m.beyond[corner[1]] & m.beyond[corner[2]]) continue;
        int group = facets->count / QM_PACK_LANES, here = facets->count % QM_PACK_LANES;
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                facets->group[group].at[i][k][here] = m.at[k][corner[i]];
        facets->group[group].twist[here] = twist ? (double)twist[lane] : 0.0;
        facets->count++;
        added |= 1u << lane;
    }
    if (added) facets->size = qm_greater(size, facets->size);
    return added;
}

bool QM_KERNEL(overlay_clear)(const qm_overlay_rim *rim, double size, const qm_overlay_face *face)
{
    double side_margin = QM_OVERLAY_SIDE * QM_UNIT_ROUNDING * size;
    double area_margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * size * size;
    for (int first = 0; first < rim->count; first += QM_WIDTH) {
        qm_vd x[2], y[2];
        for (int end = 0; end < 2; end++) {
            x[end] = qm_vd_load(&rim->at[end][0][first]);
            y[end] = qm_vd_load(&rim->at[end][1][first]);
        }
        const qm_vd outside = qm_vd_set(-side_margin);
        qm_vl parted = outside > outside;
        qm_vd low = qm_vd_set(INFINITY), high = -low;
        for (int k = 0; k < 3; k++) {
            parted |=
                (affine(face->side[k], x[0], y[0]) < outside) & (affine(face->side[k], x[1], y[1]) < outside);
            qm_vd area =
                (x[1] - x[0]) * (face->corner[k][1] - y[0]) - (y[1] - y[0]) * (face->corner[k][0] - x[0]);
            low = qm_vd_min(area, low);
            high = qm_vd_max(area, high);
        }
        parted |= (low > qm_vd_set(area_margin)) | (high < qm_vd_set(-area_margin));
        if (qm_vl_bits(parted) != (1u << QM_WIDTH) - 1) return false;
    }
    return true;
}

/** The gap of each facet. */
static inline qm_vd find_gap(const wide_facet *f, const qm_overlay_face *face, double area_margin,
                             qm_vd twist)
{
    qm_vd gap = edge_gap(f, 0, 1);
    gap = qm_vd_max(gap, qm_vd_max(edge_gap(f, 1, 2), edge_gap(f, 2, 0)));
    for (int i = 0; i < 3; i++)
        gap = qm_vd_max(gap, corner_gap(f, face->corner[i], area_margin));
    return qm_vd_select(gap >= qm_vd_set(0.0), gap + twist, gap);
}

void QM_KERNEL(overlay_gaps)(const qm_overlay_facets *facets, const qm_overlay_face *face,
                             qm_overlay_gaps *out)
{
    double side_margin = QM_OVERLAY_SIDE * QM_UNIT_ROUNDING * facets->size;
    double area_margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * facets->size * facets->size;
    qm_vd greatest = qm_vd_set(NOT_OVER);
    memset(out->over_probe, 0, sizeof out->over_probe);
    memset(out->beside_probe, 0, sizeof out->beside_probe);
    for (int first = 0; first < facets->count; first += QM_WIDTH) {
        int group = first / QM_PACK_LANES, part = first % QM_PACK_LANES / QM_WIDTH;
        qm_vd gap = qm_vd_set(NOT_OVER);
        wide_facet f;
        if (load_facet(&f, facets->group[group].at, part, face, side_margin)) {
            gap = find_gap(&f, face, area_margin, qm_vd_load(&facets->group[group].twist[part * QM_WIDTH]));
            look_at_probe(&f, face->probe, area_margin, first, out);
        } else {
            out->beside_probe[group] |= (uint8_t)(((1u << QM_WIDTH) - 1) << part * QM_WIDTH);
        }
        qm_vd_store(&out->at[first], gap);
        greatest = qm_vd_max(gap, greatest);
    }
    out->greatest = NOT_OVER;
    for (int lane = 0; lane < QM_WIDTH; lane++)
        out->greatest = qm_greater(greatest[lane], out->greatest);
}
