/**
 * compare.c: which lanes of two packs of one mesh may meet: one triangle against eight, most of which share
 * corners with it or with its neighbors. Pairs that this filter separates are apart; all others go to exact
 * tests.
 *
 * Triangles are separated by planes: that of either triangle, and those through the edges of either that are
 * perpendicular to it. Where the corners of a triangle that are not shared lie strictly beyond a plane that
 * contains the shared ones, and that the other triangle does not cross, only the hull of the shared ones can
 * meet it: a corner or an edge of both.
 *
 * Errors: let e bound the error of every coordinate, E the size of the triangle whose plane it is, and W the
 * distance of the other's corners from it along an axis: at most both sizes when their boxes meet. Edges are
 * then wrong by at most 3 e, normals by 18 E e and the height of a corner by 78 E W e + 54 E^2 e, which is
 * below 128 e E (E + W); sizes are enlarged by 4 e for terms of second order. For planes through edges the
 * same count gives 228 E^2 W e + 72 E^3 e, below 256 e E^2 (E + W).
 */
#include "kernels.h"
#include "leaf_boxes.h"

/** Everything is inlined into the two kinds of search, so that neither pays for the other. */
#define QM_INLINE __attribute__((always_inline))

/** The corners of q relative to p's center. */
typedef struct against {
    leaf_boxes boxes;
    wide corner[3];
    qm_collide_kind kind;
} against;

static inline void set_against(against *g, const qm_collide_leaf *p, const qm_collide_leaf *q,
                               qm_collide_kind kind)
{
    leaf_boxes_set(&g->boxes, p, q);
    g->kind = kind;
    for (int i = 0; i < 3; i++)
        g->corner[i] = leaf_shift(wide_load(q->corner[i]), g->boxes.shift, 0.0f);
}

static inline qm_vi equal_marks(const against *g, int i, int corner_p, int corner_q)
{
    return *(const qm_vi *)(const void *)g->boxes.q->mark[corner_q] == (int32_t)g->boxes.p->mark[corner_p][i];
}

/** Which corners of q's lanes are corners of p's lane i in the mesh: same[corner of p][corner of q]. */
typedef struct shared_corners {
    qm_vi same[3][3];
} shared_corners;

QM_INLINE static inline shared_corners find_shared(const against *g, int i)
{
    shared_corners s = {{{{0}}}};
    if (g->kind != QM_COLLIDE_SELF) return s;
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++)
            s.same[c][k] = equal_marks(g, i, c, k);
    return s;
}

/** Bits of q's lanes with a corner whose mark equals that of a corner of p's lane i. */
static inline unsigned lanes_sharing(const against *g, int i)
{
    qm_vi any = {0};
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++)
            any |= equal_marks(g, i, c, k);
    return qm_vi_bits(any);
}

/** Lane i of p against all lanes of q. */
typedef struct lane_against {
    const against *g;
    int i;
    shared_corners shared;
    qm_vf size, own_size, tolerance; /* of the plane of lane i */
} lane_against;

QM_INLINE static inline lane_against make_lane(const against *g, int i)
{
    lane_against l = {.g = g, .i = i, .shared = find_shared(g, i)};
    l.size = wide_load_row(g->boxes.q->size);
    l.own_size = (qm_vf){0} + g->boxes.p->size[i];
    l.tolerance =
        128.0f * g->boxes.error * l.own_size * (l.own_size + l.own_size + l.size) + QM_LEAF_UNDERFLOW;
    return l;
}

static inline qm_vf own_height(const lane_against *l, int plane, int corner)
{
    const float(*row)[QM_PACK_LANES] = l->g->boxes.p->plane[plane];
    wide c = l->g->corner[corner];
    return c.x * row[0][l->i] + c.y * row[1][l->i] + c.z * row[2][l->i];
}

/** All three strictly above, or all three strictly below; shared corners count as both, unless all are. */
static inline qm_vi one_sided(const qm_vf height[3], qm_vf low, qm_vf high, const qm_vi shared[3])
{
    qm_vi above = shared[0] | (height[0] > high), below = shared[0] | (height[0] < low);
    for (int k = 1; k < 3; k++) {
        above &= shared[k] | (height[k] > high);
        below &= shared[k] | (height[k] < low);
    }
    return (above | below) & ~(shared[0] & shared[1] & shared[2]);
}

/** Lanes of q on one side of the plane of lane i. */
QM_INLINE static inline qm_vi apart_by_own_plane(const lane_against *l)
{
    const qm_vi(*same)[3] = l->shared.same;
    const qm_vi shared[3] = {same[0][0] | same[1][0] | same[2][0], same[0][1] | same[1][1] | same[2][1],
                             same[0][2] | same[1][2] | same[2][2]};
    const qm_vf height[3] = {own_height(l, 0, 0), own_height(l, 0, 1), own_height(l, 0, 2)};
    float at = l->g->boxes.p->plane[0][3][l->i];
    return one_sided(height, at - l->tolerance, at + l->tolerance, shared);
}

/** Lanes of q beyond an edge of lane i. */
QM_INLINE static inline qm_vi apart_by_own_edges(const lane_against *l)
{
    const qm_vi(*same)[3] = l->shared.same;
    qm_vf tolerance = 2.0f * l->own_size * l->tolerance + QM_LEAF_UNDERFLOW;
    qm_vi apart = {0};
    for (int c = 0; c < 3; c++) {
        int next = (c + 1) % 3;
        qm_vf limit = l->g->boxes.p->plane[1 + c][3][l->i] + tolerance;
        qm_vi beyond = ~(qm_vi){0};
        for (int k = 0; k < 3; k++)
            beyond &= same[c][k] | same[next][k] | (own_height(l, 1 + c, k) > limit);
        apart |= beyond;
    }
    return apart;
}

/** A corner of lane i relative to q's center. */
static inline wide own_corner(const lane_against *l, int corner)
{
    const qm_vf zero = {0};
    const float(*row)[QM_PACK_LANES] = l->g->boxes.p->corner[corner];
    const float *shift = l->g->boxes.shift;
    return (wide){zero + (row[0][l->i] - shift[0]), zero + (row[1][l->i] - shift[1]),
                  zero + (row[2][l->i] - shift[2])};
}

/** Lanes of q that have lane i on one side of their planes, or beyond one of their edges. */
QM_INLINE static inline qm_vi apart_by_other_planes(const lane_against *l)
{
    const qm_collide_leaf *q = l->g->boxes.q;
    const qm_vi(*same)[3] = l->shared.same;
    wide own[3] = {own_corner(l, 0), own_corner(l, 1), own_corner(l, 2)};
    qm_vf tolerance =
        128.0f * l->g->boxes.error * l->size * (l->size + l->size + l->own_size) + QM_LEAF_UNDERFLOW;
    const qm_vi shared[3] = {same[0][0] | same[0][1] | same[0][2], same[1][0] | same[1][1] | same[1][2],
                             same[2][0] | same[2][1] | same[2][2]};
    wide normal = wide_load(q->plane[0]);
    const qm_vf height[3] = {wide_dot(normal, own[0]), wide_dot(normal, own[1]), wide_dot(normal, own[2])};
    qm_vf at = wide_load_row(q->plane[0][3]);
    qm_vi apart = one_sided(height, at - tolerance, at + tolerance, shared);
    qm_vf edge_tolerance = 2.0f * l->size * tolerance + QM_LEAF_UNDERFLOW;
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        wide out = wide_load(q->plane[1 + k]);
        qm_vf limit = wide_load_row(q->plane[1 + k][3]) + edge_tolerance;
        qm_vi beyond = ~(qm_vi){0};
        for (int c = 0; c < 3; c++)
            beyond &= same[c][k] | same[c][next] | (wide_dot(out, own[c]) > limit);
        apart |= beyond;
    }
    return apart;
}

/** Of these lanes of q, those that may meet lane i of p. */
QM_INLINE static inline void compare_lane(const against *g, int i, unsigned bits, qm_near_lanes *out)
{
    lane_against l = make_lane(g, i);
    unsigned alike = 0;
    bits &= ~qm_vi_bits(apart_by_own_plane(&l));
    if (bits && g->kind != QM_COLLIDE_SELF) {
        alike = bits & lanes_sharing(g, i);
        bits &= ~alike;
    }
    if (bits) bits &= ~qm_vi_bits(apart_by_own_edges(&l));
    if (bits) bits &= ~qm_vi_bits(apart_by_other_planes(&l));
    out->near |= (uint64_t)(bits | alike) << (QM_PACK_LANES * i);
    out->alike |= (uint64_t)alike << (QM_PACK_LANES * i);
}

QM_INLINE static inline bool compare(const qm_collide_leaf *p, const qm_collide_leaf *q, qm_collide_kind kind,
                                     unsigned moved_p, unsigned moved_q, qm_near_lanes *out)
{
    against g;
    set_against(&g, p, q, kind);
    bool is_same = p->pack == q->pack;
    out->near = out->alike = 0;
    for (unsigned lanes = leaf_boxes_lanes(&g.boxes); lanes; lanes &= lanes - 1) {
        int i = __builtin_ctz(lanes);
        unsigned bits = leaf_boxes_near(&g.boxes, i);
        if (is_same) bits &= ~0u << (i + 1);
        if (!(moved_p >> i & 1)) bits &= moved_q;
        if (bits) compare_lane(&g, i, bits, out);
    }
    return out->near != 0;
}

bool QM_KERNEL(compare_leaves)(const qm_collide_leaf *p, const qm_collide_leaf *q, qm_collide_kind kind,
                               unsigned moved_p, unsigned moved_q, qm_near_lanes *out)
{
    if (kind == QM_COLLIDE_SELF) return compare(p, q, QM_COLLIDE_SELF, moved_p, moved_q, out);
    return compare(p, q, QM_COLLIDE_COPY, 0xff, 0xff, out);
}
