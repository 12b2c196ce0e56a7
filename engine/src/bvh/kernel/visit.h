/**
 * visit.h: what the searches of the tree, of the grid and of the offset tetrahedra do with a pack that they
 * visit: offer its triangles or patches to the best so far. Shared, so that all of them give the same
 * results.
 */
#ifndef QM_KERNEL_VISIT_H
#define QM_KERNEL_VISIT_H

#include <string.h>

#include "bvh/bvh_demand.h"
#include "float_pack.h"
#include "pack.h"
#include "prim/bilinear.h"

/** True when single precision proves that no triangle of a pack is as near as the best so far. */
static inline bool qm_pack_is_far(const qm_bvh *bvh, uint32_t pack, qm_vec p, double best)
{
    const qm_float_pack *floats = qm_bvh_float_pack(bvh, pack);
    qm_float_point q = qm_float_point_make(floats, p);
    float min = qm_vf_min_lane(qm_float_pack_d2(floats, &q));
    return (double)__builtin_sqrtf(min) - (double)q.margin > best;
}

/** Squared distances from a point to the triangles of a pack; returns the min. */
static inline double qm_pack_parts_d2(const qm_pack *pack, const qm_splat *p, qm_vd d2[QM_PARTS])
{
    for (int part = 0; part < QM_PARTS; part++)
        d2[part] = qm_pack_part_d2(pack, part, p->x, p->y, p->z);
    qm_vd low = d2[0];
    for (int part = 1; part < QM_PARTS; part++)
        low = qm_vd_min(d2[part], low);
    double min = low[0];
    for (int i = 1; i < QM_WIDTH; i++)
        min = low[i] < min ? low[i] : min;
    return min;
}

/** Visits a pack; of equal distances the lower face wins, so that the order of visits does not matter. */
static inline void qm_visit_pack(const qm_bvh *bvh, uint32_t pack, qm_splat p, qm_hit *hit)
{
    qm_pack spare;
    const qm_pack *triangles = qm_bvh_pack(bvh, pack, &spare);
    qm_vd d2[QM_PARTS];
    double min = qm_pack_parts_d2(triangles, &p, d2);
    if (!(min <= hit->d2) || min == INFINITY) return;
    unsigned bits = 0;
    for (int part = 0; part < QM_PARTS; part++)
        bits |= qm_vl_bits(d2[part] == qm_vd_set(min)) << (part * QM_WIDTH);
    const uint32_t *face = bvh->lanes[pack].face;
    for (; bits; bits &= bits - 1) {
        uint32_t lane = (uint32_t)__builtin_ctz(bits);
        if (min < hit->d2 ||
            (hit->lane < QM_PACK_LANES && face[lane] < bvh->lanes[hit->pack].face[hit->lane]))
            *hit = (qm_hit){min, pack, lane};
    }
}

/** The last patch that a search has measured: copies of one face follow each other, and are measured once. */
typedef struct qm_last_patch {
    bool is_set;
    qm_bilinear patch;
    qm_bilinear_footpoint foot;
} qm_last_patch;

static inline bool qm_patches_equal(const qm_bilinear *a, const qm_bilinear *b)
{
    return memcmp(a, b, sizeof *a) == 0;
}

/** Measures the patch of a face, unless it is the last one. */
static inline qm_bilinear_footpoint qm_measure_patch(const qm_bvh *bvh, uint32_t face, qm_vec p, double error,
                                                     bool certified, double stop_above, qm_last_patch *last)
{
    qm_bilinear patch = qm_bvh_load_patch(bvh, face);
    if (!last->is_set || !qm_patches_equal(&patch, &last->patch)) {
        last->is_set = true;
        last->patch = patch;
        last->foot = certified ? qm_bilinear_project(&patch, p, error, stop_above)
                               : qm_bilinear_minimise(&patch, p, stop_above);
    }
    return last->foot;
}

/** Offers the surface of one lane to the best patch so far. */
static inline void qm_visit_patch(const qm_bvh *bvh, uint32_t pack, uint32_t lane, qm_vec p, double d2,
                                  double error, qm_last_patch *last, qm_bilinear_hit *hit)
{
    uint32_t face = bvh->lanes[pack].face[lane];
    qm_bilinear_footpoint foot = {.distance = sqrt(d2), .lower = sqrt(d2), .uv = {NAN, NAN}};
    double twist = qm_bvh_has_twists(bvh) ? (double)qm_bvh_twists(bvh, pack)[lane] : 0.0;
    bool certified = twist > 0.25 * error;
    if (certified || (twist > 0.0 && error == INFINITY)) {
        foot = qm_measure_patch(bvh, face, p, error, certified, hit->distance, last);
    } else {
        foot.distance += twist;
        foot.lower -= twist;
    }
    hit->lower = fmin(hit->lower, foot.lower);
    if (foot.distance < hit->distance || (foot.distance == hit->distance && face < hit->face)) {
        hit->distance = foot.distance;
        hit->uv[0] = foot.uv[0];
        hit->uv[1] = foot.uv[1];
        hit->face = face;
        hit->pack = pack;
    }
}

/** The nearest lane, or the first of its quad. */
static inline uint32_t qm_nearest_quad(const qm_pack_lanes *lanes, const double d2[QM_PACK_LANES])
{
    uint32_t nearest = 0;
    for (uint32_t lane = 1; lane < lanes->lane_count; lane++)
        if (d2[lane] < d2[nearest]) nearest = lane;
    return nearest - ((uint32_t)qm_lane_is_second(lanes, nearest));
}

/**
 * Visits the patches of a pack. A lane is measured when its triangle less its flatness bound is nearer than
 * the best; of a quad's two lanes the nearer. The nearest lane goes first: its distance prunes most of the
 * others.
 */
static inline void qm_visit_patches(const qm_bvh *bvh, uint32_t pack, qm_vec p, double error,
                                    qm_last_patch *last, qm_bilinear_hit *hit)
{
    _Alignas(64) double d2[QM_PACK_LANES];
    qm_pack spare;
    qm_pack_d2(qm_bvh_pack(bvh, pack, &spare), p, d2);
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    uint32_t count = lanes->lane_count, first = qm_nearest_quad(lanes, d2);
    for (uint32_t step = 0; step < count; step++) {
        uint32_t lane = first + step < count ? first + step : first + step - count;
        bool has_second = qm_lane_has_second(lanes, lane);
        uint32_t nearer = has_second && d2[lane + 1] < d2[lane] ? lane + 1 : lane;
        double twist = qm_bvh_has_twists(bvh) ? (double)qm_bvh_twists(bvh, pack)[lane] : 0.0;
        if (sqrt(d2[nearer]) - twist <= hit->distance)
            qm_visit_patch(bvh, pack, nearer, p, d2[nearer], error, last, hit);
        if (has_second) step++;
    }
}

/** The callback of a traversal: visits a pack, and returns the distance of the best so far. */
typedef double qm_visit_fn(void *best, uint32_t pack);

/** Search for the nearest triangle. */
typedef struct qm_triangle_search {
    const qm_bvh *bvh;
    qm_splat p;
    qm_hit *hit;
} qm_triangle_search;

static inline double qm_visit_triangles(void *best, uint32_t pack)
{
    const qm_triangle_search *search = best;
    qm_visit_pack(search->bvh, pack, search->p, search->hit);
    return sqrt(search->hit->d2);
}

/** Search for the nearest patch. */
typedef struct qm_patch_search {
    const qm_bvh *bvh;
    qm_vec p;
    double error;
    qm_bilinear_hit *hit;
    qm_last_patch last;
} qm_patch_search;

static inline double qm_visit_all_patches(void *best, uint32_t pack)
{
    qm_patch_search *search = best;
    qm_visit_patches(search->bvh, pack, search->p, search->error, &search->last, search->hit);
    return search->hit->distance;
}

/* ---- ties ---- */

/** True when the first face is the result wherever the second one would be. */
static inline bool qm_tie_beats(const qm_ties *ties, const qm_tie *a, const qm_tie *b)
{
    if (a->face > b->face) return false;
    return a->distance <= b->distance || (ties->is_min_known && a->face < b->face);
}

/** Offers a face to the list. */
static inline void qm_ties_offer(qm_ties *ties, qm_tie offered)
{
    if (offered.distance > ties->reach) return;
    int kept = 0;
    for (int i = 0; i < ties->count; i++) {
        if (qm_tie_beats(ties, &ties->tie[i], &offered)) return;
        bool stays = ties->tie[i].distance <= ties->reach && !qm_tie_beats(ties, &offered, &ties->tie[i]);
        ties->tie[kept] = ties->tie[i];
        kept += stays;
    }
    ties->count = kept;
    if (kept == QM_TIES)
        ties->is_overfull = true;
    else
        ties->tie[ties->count++] = offered;
}

/** Lowers the min distance, and with it the reach. */
static inline void qm_ties_lower(qm_ties *ties, double distance)
{
    double before = ties->min;
    if (!(distance < before)) return;
    ties->min = distance;
    ties->reach = distance + ties->tau;
    ties->reach2 = ties->reach * ties->reach * (1.0 + 0x1p-50); /* for squares: three roundings */
    if (ties->reach < before) ties->count = 0;
}

/** Search for ties. */
typedef struct qm_tie_search {
    const qm_bvh *bvh;
    qm_splat splat;
    qm_vec p;
    qm_ties *ties;
} qm_tie_search;

static inline double qm_visit_tied_triangles(void *best, uint32_t pack)
{
    const qm_tie_search *search = best;
    qm_ties *ties = search->ties;
    qm_pack spare;
    const qm_pack *triangles = qm_bvh_pack(search->bvh, pack, &spare);
    qm_vd d2[QM_PARTS];
    double min = qm_pack_parts_d2(triangles, &search->splat, d2);
    if (!(min <= ties->reach2)) return ties->reach;
    qm_ties_lower(ties, sqrt(min));
    unsigned bits = 0;
    for (int part = 0; part < QM_PARTS; part++)
        bits |= qm_vl_bits(d2[part] <= qm_vd_set(ties->reach2)) << (part * QM_WIDTH);
    const uint32_t *face = search->bvh->lanes[pack].face;
    for (; bits; bits &= bits - 1) {
        uint32_t lane = (uint32_t)__builtin_ctz(bits);
        qm_ties_offer(ties, (qm_tie){sqrt(d2[lane / QM_WIDTH][lane % QM_WIDTH]), face[lane], pack, lane});
    }
    return ties->reach;
}

/**
 * The distance to the surface of a lane, given that to its triangles, by operations that do not depend on the
 * order of visits; some distance beyond reach when the surface is beyond. Patches that are likely to lie
 * beyond are projected on with a limit first: near the limit the iterates may depend on it, so patches within
 * are projected on again.
 */
static inline double qm_tied_patch_distance(const qm_tie_search *search, uint32_t face, double twist,
                                            double triangle)
{
    const qm_ties *ties = search->ties;
    if (!(twist > 0.25 * ties->error)) return triangle + twist;
    qm_bilinear patch = qm_bvh_load_patch(search->bvh, face);
    if (triangle > ties->reach) {
        double limit = ties->reach + ties->margin, stop_above = limit + ties->error + ties->margin;
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, search->p, ties->error, stop_above);
        if (foot.lower > limit) return foot.distance;
    }
    return qm_bilinear_project(&patch, search->p, ties->error, INFINITY).distance;
}

/** See qm_visit_patches. */
static inline double qm_visit_tied_patches(void *best, uint32_t pack)
{
    const qm_tie_search *search = best;
    const qm_bvh *bvh = search->bvh;
    qm_ties *ties = search->ties;
    _Alignas(64) double d2[QM_PACK_LANES];
    qm_pack spare;
    qm_pack_d2(qm_bvh_pack(bvh, pack, &spare), search->p, d2);
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    uint32_t count = lanes->lane_count, first = qm_nearest_quad(lanes, d2);
    for (uint32_t step = 0; step < count; step++) {
        uint32_t lane = first + step < count ? first + step : first + step - count;
        bool has_second = qm_lane_has_second(lanes, lane);
        uint32_t nearer = has_second && d2[lane + 1] < d2[lane] ? lane + 1 : lane;
        double twist = (double)qm_bvh_twists(bvh, pack)[lane], triangle = sqrt(d2[nearer]);
        if (has_second) step++;
        if (triangle - twist > ties->reach + ties->margin) continue;
        double distance = qm_tied_patch_distance(search, lanes->face[lane], twist, triangle);
        qm_ties_lower(ties, distance);
        qm_ties_offer(ties, (qm_tie){distance, lanes->face[lane], pack, nearer});
    }
    return ties->reach + ties->margin;
}

#endif
