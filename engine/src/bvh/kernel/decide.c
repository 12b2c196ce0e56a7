/**
 * decide.c: lists the pairs of lanes of two packs whose boxes meet side by side, and decides eight of them in
 * single precision without a branch.
 *
 * Triangles whose corners all lie off the other's plane, some on either side of it, meet when two edges pass
 * each other on the right side, as in tri_tri.c (Guigue, Devillers 2003); the edges start at the isolated
 * corner of each triangle. Where every sign is beyond its error, that proves that they meet or do not; planes
 * through the edges of either prove more pairs apart of those that lie nearly in one plane.
 *
 * Errors: let e bound the error of every coordinate, E the size of the triangle whose plane it is, and S the
 * sum of both sizes, beyond which no two corners are apart along an axis, as the boxes meet. Differences are
 * then wrong by at most 3 e, normals by 18 E e and heights above a plane by 54 E S e + 27 E^2 e, which is
 * below 128 e E S. The product of an edge of either and the vector that joins them, (u x v) . t, is wrong by
 * at most 26 S^2 e, below 64 e S^2. Heights above planes through edges are wrong by at most 228 E^2 S e + 72
 * E^3 e, below 512 e E^2 S. Sizes are enlarged by 4 e for terms of second order.
 */
#include <string.h>

#include "kernels.h"
#include "leaf_boxes.h"

/** Appends a pair of lanes. */
static inline void add_pair(qm_lane_pairs *pairs, const qm_collide_leaf *const leaf[2], const int lane[2],
                            wide_part shift)
{
    QM_ASSERT(pairs->count < QM_PAIRS_CAPACITY);
    unsigned at = pairs->count++;
    for (int side = 0; side < 2; side++) {
        const qm_collide_leaf *from = leaf[side];
        for (int i = 0; i < 3; i++)
            memcpy(pairs->corner[side][i][at], from->vertex[from->corner_vertex[lane[side]][i]],
                   sizeof shift);
        pairs->lane[side][at] = QM_PACK_LANES * from->pack + (uint32_t)lane[side];
    }
    memcpy(pairs->shift[at], &shift, sizeof shift);
}

/** Finds the lanes with a corner of equal mark: where two meshes share vertices, most near lanes have one. */
static inline void find_alike(const qm_collide_leaf *p, const qm_collide_leaf *q, qm_near_lanes *out)
{
    for (int i = 0; i < QM_PACK_LANES; i++) {
        qm_vi any = {0}, which = {0};
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 3; k++) {
                qm_vi here = *(const qm_vi *)(const void *)q->mark[k] == (int32_t)p->mark[c][i];
                any |= here;
                which = qm_keys_max(which, here & (4 * c + k));
            }
        }
        memcpy(out->corners[i], &which, sizeof which);
        out->alike |= (uint64_t)qm_vi_bits(any) << (QM_PACK_LANES * i);
    }
    out->alike &= out->near;
}

static inline uint64_t find_near(const leaf_boxes *boxes)
{
    uint64_t near = 0;
    for (unsigned lanes = leaf_boxes_lanes(boxes); lanes; lanes &= lanes - 1) {
        int i = __builtin_ctz(lanes);
        near |= (uint64_t)leaf_boxes_near(boxes, i) << (QM_PACK_LANES * i);
    }
    return near;
}

void QM_KERNEL(add_lane_pairs)(const qm_collide_leaf *p, const qm_collide_leaf *q, bool seeks_alike,
                               qm_lane_pairs *pairs, qm_near_lanes *out)
{
    leaf_boxes boxes;
    leaf_boxes_set(&boxes, p, q);
    out->near = find_near(&boxes);
    out->alike = 0;
    if (out->near && seeks_alike) find_alike(p, q, out);
    const qm_collide_leaf *const leaf[2] = {p, q};
    const wide_part shift = {boxes.shift[0], boxes.shift[1], boxes.shift[2], boxes.error};
    for (uint64_t left = out->near & ~out->alike; left; left &= left - 1) {
        int pair = __builtin_ctzll(left);
        add_pair(pairs, leaf, (const int[2]){pair / QM_PACK_LANES, pair % QM_PACK_LANES}, shift);
    }
}

/** A triangle of each pair. */
typedef struct triangles {
    wide corner[3], normal;
    qm_vf size;        /* the longest side of its box and a little more */
    qm_vf tolerance;   /* of heights above its plane */
    qm_vf height[3];   /* of its corners above the other's plane */
    qm_vi below[3];    /* which of these are certainly below it */
    qm_vi isolated[3]; /* which corner is isolated: alone on its side */
} triangles;

static inline void load_columns(const float (*row)[4], qm_vf column[4])
{
    qm_vf two[4];
    for (int i = 0; i < 4; i++)
        two[i] = wide_join(row[i], row[i + 4]);
    wide_transpose(two, column);
}

static inline qm_vf span(qm_vf a, qm_vf b, qm_vf c)
{
    return qm_vf_max(a, qm_vf_max(b, c)) - qm_vf_min(a, qm_vf_min(b, c));
}

static inline void load_triangles(triangles *t, const float (*const row[3])[4], wide shift, qm_vf error)
{
    for (int i = 0; i < 3; i++) {
        qm_vf column[4];
        load_columns(row[i], column);
        t->corner[i] = wide_add((wide){column[0], column[1], column[2]}, shift);
    }
    const wide *c = t->corner;
    t->size = qm_vf_max(qm_vf_max(span(c[0].x, c[1].x, c[2].x), span(c[0].y, c[1].y, c[2].y)),
                        span(c[0].z, c[1].z, c[2].z)) +
              4.0f * error;
    t->normal = wide_cross(wide_sub(c[1], c[0]), wide_sub(c[2], c[0]));
}

/** Computes the heights of the corners of t above the plane of the other; returns the lanes in which all
 * corners lie certainly on one side. certain keeps the lanes in which the side of every corner is certain. */
static inline qm_vi find_heights(triangles *t, const triangles *other, qm_vi *certain)
{
    qm_vi above_all = ~(qm_vi){0}, below_all = above_all;
    for (int i = 0; i < 3; i++) {
        t->height[i] = wide_dot(other->normal, wide_sub(t->corner[i], other->corner[0]));
        qm_vi above = t->height[i] > other->tolerance;
        t->below[i] = t->height[i] < -other->tolerance;
        *certain &= above | t->below[i];
        above_all &= above;
        below_all &= t->below[i];
    }
    return above_all | below_all;
}

/** With one or two corners on either side, one of them is isolated. */
static inline void find_isolated(triangles *t)
{
    t->isolated[2] = ~(t->below[0] ^ t->below[1]);
    t->isolated[1] = ~(t->below[0] ^ t->below[2]) & ~t->isolated[2];
    t->isolated[0] = ~(t->isolated[1] | t->isolated[2]);
}

static inline qm_vf choose(qm_vi first, qm_vi second, qm_vf a, qm_vf b, qm_vf c)
{
    return (qm_vf)qm_vi_select(first, (qm_vi)a, qm_vi_select(second, (qm_vi)b, (qm_vi)c));
}

/** A corner of each triangle: 0 where first is set, else 1 where second is, else 2. */
static inline wide choose_corner(const triangles *t, qm_vi first, qm_vi second)
{
    const wide *c = t->corner;
    return (wide){choose(first, second, c[0].x, c[1].x, c[2].x),
                  choose(first, second, c[0].y, c[1].y, c[2].y),
                  choose(first, second, c[0].z, c[1].z, c[2].z)};
}

/** The isolated corner, and the edges from it to the next corner and to the previous one; in reverse order
 * where the other's isolated corner is above. */
typedef struct corner_edges {
    wide isolated_corner, edge[2];
} corner_edges;

static inline corner_edges corner_edges_make(const triangles *t, const triangles *other)
{
    const qm_vi *isolated = t->isolated;
    qm_vi is_below = (other->below[0] & other->isolated[0]) | (other->below[1] & other->isolated[1]) |
                     (other->below[2] & other->isolated[2]);
    /* The corner after 2 and the one before 1 are both 0, and so on. */
    qm_vi ahead_0 = qm_vi_select(is_below, isolated[2], isolated[1]),
          ahead_1 = qm_vi_select(is_below, isolated[0], isolated[2]),
          back_0 = qm_vi_select(is_below, isolated[1], isolated[2]),
          back_1 = qm_vi_select(is_below, isolated[2], isolated[0]);
    wide isolated_corner = choose_corner(t, isolated[0], isolated[1]);
    return (corner_edges){.isolated_corner = isolated_corner,
                          .edge = {wide_sub(choose_corner(t, ahead_0, ahead_1), isolated_corner),
                                   wide_sub(choose_corner(t, back_0, back_1), isolated_corner)}};
}

/** Lanes in which the other lies beyond the plane through an edge of t that is perpendicular to t. */
static inline qm_vi beyond_edges(const triangles *t, const triangles *other)
{
    const wide *c = t->corner;
    qm_vf limit = 4.0f * t->size * t->tolerance + QM_LEAF_UNDERFLOW;
    qm_vi apart = {0};
    for (int i = 0; i < 3; i++) {
        wide out = wide_cross(wide_sub(c[(i + 1) % 3], c[i]), t->normal);
        qm_vi beyond = ~(qm_vi){0};
        for (int k = 0; k < 3; k++)
            beyond &= wide_dot(out, wide_sub(other->corner[k], c[i])) > limit;
        apart |= beyond;
    }
    return apart;
}

void QM_KERNEL(decide_lane_pairs)(const qm_lane_pairs *pairs, unsigned first, qm_pair_verdicts *out)
{
    QM_ASSERT(first % QM_PACK_LANES == 0 && first < pairs->count && pairs->count <= QM_PAIRS_CAPACITY);
    triangles p, q;
    qm_vf shift[4];
    load_columns(pairs->shift + first, shift);
    qm_vf error = shift[3];
    const float(*const p_rows[3])[4] = {pairs->corner[0][0] + first, pairs->corner[0][1] + first,
                                        pairs->corner[0][2] + first};
    const float(*const q_rows[3])[4] = {pairs->corner[1][0] + first, pairs->corner[1][1] + first,
                                        pairs->corner[1][2] + first};
    load_triangles(&p, p_rows, (wide){{0}, {0}, {0}}, error);
    load_triangles(&q, q_rows, (wide){shift[0], shift[1], shift[2]}, error);
    qm_vf sizes = p.size + q.size;
    p.tolerance = 128.0f * error * p.size * sizes + QM_LEAF_UNDERFLOW;
    q.tolerance = 128.0f * error * q.size * sizes + QM_LEAF_UNDERFLOW;
    qm_vi certain = ~(qm_vi){0};
    qm_vi apart = find_heights(&q, &p, &certain) | find_heights(&p, &q, &certain);
    find_isolated(&p);
    find_isolated(&q);
    corner_edges of_p = corner_edges_make(&p, &q), of_q = corner_edges_make(&q, &p);
    wide join = wide_sub(of_q.isolated_corner, of_p.isolated_corner);
    qm_vf slack = 64.0f * error * sizes * sizes + QM_LEAF_UNDERFLOW;
    qm_vf ahead = wide_dot(wide_cross(of_p.edge[0], of_q.edge[0]), join),
          back = wide_dot(wide_cross(of_p.edge[1], of_q.edge[1]), join);
    qm_vi meet = certain & (ahead < -slack) & (back > slack) & ~apart;
    apart |= certain & ((ahead > slack) | (back < -slack));
    unsigned there = pairs->count - first < QM_PACK_LANES ? (1u << (pairs->count - first)) - 1 : 0xff;
    out->meet = qm_vi_bits(meet) & there;
    out->open = ~qm_vi_bits(meet | apart) & there;
    if (!out->open) return;
    out->open &= ~qm_vi_bits(beyond_edges(&p, &q) | beyond_edges(&q, &p));
}
