/**
 * collide.c: the inner loops of collision: pairs of boxes eight at a time, and pairs of triangles one against
 * eight. What is told apart here is apart; the rest is for exact tests.
 */
#include "../collide_leaf.h"
#include "box.h"
#include "kernels.h"

/* ---- pairs of nodes ---- */

static inline qm_vf load(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

/** Bits of the members of a group whose boxes meet a box. */
static inline unsigned group_meets(const qm_box_group *group, const float low[3], const float high[3])
{
    qm_vi apart = {0};
    for (int k = 0; k < 3; k++)
        apart |= (load(group->low[k]) > high[k]) | (load(group->high[k]) < low[k]);
    return ~qm_vi_bits(apart) & 0xff;
}

static inline qm_node child_node(const qm_box_tree *tree, const qm_node *node, int member)
{
    const qm_box_group *group = &tree->groups[node->level][node->index];
    qm_node child = {.level = node->level - 1, .index = 8 * node->index + (uint32_t)member};
    for (int k = 0; k < 3; k++) {
        child.low[k] = group->low[k][member];
        child.high[k] = group->high[k][member];
    }
    return child;
}

static inline unsigned member_bits(const qm_box_tree *tree, const qm_node *node)
{
    return (1u << qm_box_tree_member_count(tree, node->level, node->index)) - 1;
}

static inline bool is_marked(const qm_descent *d, const qm_node *node)
{
    return d->marked[node->level][node->index];
}

/** The box of a node in the frame of the other tree, widened by what rounding may do. Where boxes meet at
 * all, their margins cover the rounding of the shift. */
static inline void change_box(const qm_node *node, double scale, const double shift[3], float low[3],
                              float high[3])
{
    for (int k = 0; k < 3; k++) {
        low[k] = qm_float_below(fmin(fmax((double)node->low[k] * scale + shift[k], -1e37), 1e37));
        high[k] = qm_float_above(fmin(fmax((double)node->high[k] * scale + shift[k], -1e37), 1e37));
    }
}

static bool descend(const qm_descent *d, const qm_node *a, const qm_node *b);

static inline bool take_pair(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    if (d->marked && !is_marked(d, a) && !is_marked(d, b)) return true;
    return descend(d, a, b);
}

/** All pairs of members of one node, each with itself too. */
static bool descend_self(const qm_descent *d, const qm_node *node)
{
    const qm_box_group *group = &d->a->groups[node->level][node->index];
    unsigned members = member_bits(d->a, node);
    for (int i = 0; members >> i; i++) {
        qm_node first = child_node(d->a, node, i);
        unsigned meets = group_meets(group, first.low, first.high) & members & ~0u << i;
        for (meets |= 1u << i; meets; meets &= meets - 1) {
            qm_node second = child_node(d->a, node, __builtin_ctz(meets));
            if (!take_pair(d, &first, &second)) return false;
        }
    }
    return true;
}

static bool descend(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    if (a->level <= d->stop_level && b->level <= d->stop_level) return d->take(d->user, a, b);
    if (d->is_self && a->level == b->level && a->index == b->index) return descend_self(d, a);
    bool splits_a = a->level >= b->level;
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *whole = splits_a ? b : a;
    const qm_box_group *group = &tree->groups[split->level][split->index];
    unsigned meets;
    if (d->is_self) {
        meets = group_meets(group, whole->low, whole->high);
    } else {
        float low[3], high[3];
        change_box(whole, splits_a ? d->change.scale_ab : d->change.scale_ba,
                   splits_a ? d->change.shift_ab : d->change.shift_ba, low, high);
        meets = group_meets(group, low, high);
    }
    for (meets &= member_bits(tree, split); meets; meets &= meets - 1) {
        qm_node child = child_node(tree, split, __builtin_ctz(meets));
        if (!take_pair(d, splits_a ? &child : a, splits_a ? b : &child)) return false;
    }
    return true;
}

bool QM_KERNEL(descend)(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    return take_pair(d, a, b);
}

/* ---- leaves ---- */

typedef struct wide {
    qm_vf x, y, z;
} wide;

static inline wide wide_sub(wide a, wide b)
{
    return (wide){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline wide wide_cross(wide a, wide b)
{
    return (wide){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline qm_vf wide_dot(wide a, wide b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline wide wide_set(const float x[3])
{
    const qm_vf zero = {0};
    return (wide){zero + x[0], zero + x[1], zero + x[2]};
}

static inline wide wide_corner(const qm_leaf *leaf, int corner)
{
    return (wide){load(leaf->corner[corner][0]), load(leaf->corner[corner][1]), load(leaf->corner[corner][2])};
}

static inline void store(float *p, qm_vf a)
{
    *(qm_vf *)(void *)p = a;
}

/* Bounds of the filter's errors, from the errors of coordinates: see filter_lane. */
#define COORDINATE_ROUNDING 0x1p-23f
#define MIDDLE_ROUNDING 0x1p-50
#define LARGEST_REACH 1e8f
#define UNDERFLOW 1e-36f

static void set_errors(qm_leaf *leaf)
{
    float reach = 0.0f;
    for (int k = 0; k < 3; k++) {
        leaf->box_low[k] = leaf->low[k][0];
        leaf->box_high[k] = leaf->high[k][0];
        for (int lane = 1; lane < QM_PACK_LANES; lane++) {
            leaf->box_low[k] = fminf(leaf->box_low[k], leaf->low[k][lane]);
            leaf->box_high[k] = fmaxf(leaf->box_high[k], leaf->high[k][lane]);
        }
        reach = fmaxf(reach, fmaxf(-leaf->box_low[k], leaf->box_high[k]));
    }
    double middle = fmax(fabs(leaf->middle.x), fmax(fabs(leaf->middle.y), fabs(leaf->middle.z)));
    leaf->reach = reach;
    leaf->error = reach * COORDINATE_ROUNDING + (float)(middle * MIDDLE_ROUNDING) + UNDERFLOW;
    if (!(reach < LARGEST_REACH)) leaf->error = INFINITY;
}

/** corner, vertex, middle, pack and lane_count are set; makes the rest. */
void QM_KERNEL(finish_leaf)(qm_leaf *leaf)
{
    wide c[3] = {wide_corner(leaf, 0), wide_corner(leaf, 1), wide_corner(leaf, 2)};
    wide normal = wide_cross(wide_sub(c[1], c[0]), wide_sub(c[2], c[0]));
    store(leaf->normal[0], normal.x);
    store(leaf->normal[1], normal.y);
    store(leaf->normal[2], normal.z);
    qm_vf size = {0};
    for (int k = 0; k < 3; k++) {
        qm_vf x = load(leaf->corner[0][k]), y = load(leaf->corner[1][k]), z = load(leaf->corner[2][k]);
        qm_vf low = qm_vf_min(x, qm_vf_min(y, z)), high = qm_vf_max(x, qm_vf_max(y, z));
        store(leaf->low[k], low);
        store(leaf->high[k], high);
        size = qm_vf_max(size, high - low);
    }
    set_errors(leaf);
    store(leaf->size, size + 4.0f * leaf->error);
}

/** The corners of q as seen from p's middle, with what bounds the errors of both. */
typedef struct against {
    const qm_leaf *p, *q;
    wide corner[3];
    float shift[3], error;
    bool is_self;
} against;

static inline against make_against(const qm_leaf *p, const qm_leaf *q, bool is_self)
{
    against g = {.p = p, .q = q, .is_self = is_self};
    g.shift[0] = (float)(q->middle.x - p->middle.x);
    g.shift[1] = (float)(q->middle.y - p->middle.y);
    g.shift[2] = (float)(q->middle.z - p->middle.z);
    wide shift = wide_set(g.shift);
    for (int i = 0; i < 3; i++) {
        wide c = wide_corner(q, i);
        g.corner[i] = (wide){c.x + shift.x, c.y + shift.y, c.z + shift.z};
    }
    float far = fmaxf(fabsf(g.shift[0]), fmaxf(fabsf(g.shift[1]), fabsf(g.shift[2])));
    g.error = p->error + q->error + 2.0f * COORDINATE_ROUNDING * (far + q->reach);
    return g;
}

/** Bits of p's lanes whose boxes meet q's. */
static inline unsigned lanes_near(const against *g)
{
    qm_vi apart = {0};
    float margin = 2.0f * g->error;
    for (int k = 0; k < 3; k++) {
        float low = g->q->box_low[k] + g->shift[k] - margin, high = g->q->box_high[k] + g->shift[k] + margin;
        apart |= (load(g->p->low[k]) > high) | (load(g->p->high[k]) < low);
    }
    return ~qm_vi_bits(apart) & ((1u << g->p->lane_count) - 1);
}

/** Bits of q's lanes whose boxes meet that of p's lane i. */
static inline unsigned boxes_near(const against *g, int i)
{
    qm_vi apart = {0};
    float margin = 2.0f * g->error;
    for (int k = 0; k < 3; k++) {
        float low = g->p->low[k][i] - g->shift[k] - margin, high = g->p->high[k][i] - g->shift[k] + margin;
        apart |= (load(g->q->low[k]) > high) | (load(g->q->high[k]) < low);
    }
    return ~qm_vi_bits(apart) & ((1u << g->q->lane_count) - 1);
}

/** Which corners of q's lanes are corners of p's lane i in the mesh: same[corner of p][corner of q]. */
typedef struct shared_corners {
    qm_vi same[3][3];
} shared_corners;

static inline shared_corners find_shared(const against *g, int i)
{
    shared_corners s = {{{{0}}}};
    if (!g->is_self) return s;
    for (int c = 0; c < 3; c++) {
        qm_vi own = (qm_vi){0} + (int32_t)g->p->vertex[c][i];
        for (int k = 0; k < 3; k++)
            s.same[c][k] = *(const qm_vi *)(const void *)g->q->vertex[k] == own;
    }
    return s;
}

/** All three strictly above, or all three strictly below; corners in shared count as both, unless all are. */
static inline qm_vi one_sided(const qm_vf side[3], qm_vf tolerance, const qm_vi shared[3])
{
    qm_vi above = shared[0] | (side[0] > tolerance), below = shared[0] | (side[0] < -tolerance);
    for (int k = 1; k < 3; k++) {
        above &= shared[k] | (side[k] > tolerance);
        below &= shared[k] | (side[k] < -tolerance);
    }
    return (above | below) & ~(shared[0] & shared[1] & shared[2]);
}

/**
 * Lanes of q that are apart from p's lane i but for the corners, or the edge between two corners, that they
 * share. Planes that part them: that of i, that of the other, and those through an edge of one at a right
 * angle to it. Where the corners that are not shared lie strictly beyond a plane that the shared ones lie in
 * and the other triangle doesn't cross, only the shared ones' hull can meet it.
 *
 * Errors: let e bound the error of each coordinate, E the size of the triangle whose plane it is, W the
 * distance from it along an axis, at most both sizes when the boxes meet. Edges are then wrong by at most
 * 3 e, normals by 18 E e, the products with W by 78 E W e + 18 E^2 e in first order, which is below
 * 128 e E (E + W); sizes are enlarged by 4 e for what is of second order. For planes through edges the same
 * count gives 228 E^2 W e + 36 E^3 e, below 256 e E^2 (E + W).
 */
static inline qm_vi lanes_apart(const against *g, int i)
{
    const qm_leaf *p = g->p, *q = g->q;
    shared_corners s = find_shared(g, i);
    float corner[3][3], normal[3];
    for (int k = 0; k < 3; k++) {
        normal[k] = p->normal[k][i];
        for (int c = 0; c < 3; c++)
            corner[c][k] = p->corner[c][k][i];
    }
    wide own[3] = {wide_set(corner[0]), wide_set(corner[1]), wide_set(corner[2])}, up = wide_set(normal);
    qm_vf size = load(q->size), own_size = (qm_vf){0} + p->size[i];
    float scale = 128.0f * g->error;
    qm_vf tolerance = scale * own_size * (own_size + own_size + size) + UNDERFLOW;
    const qm_vi of_q[3] = {s.same[0][0] | s.same[1][0] | s.same[2][0],
                           s.same[0][1] | s.same[1][1] | s.same[2][1],
                           s.same[0][2] | s.same[1][2] | s.same[2][2]};
    const wide from[3] = {wide_sub(g->corner[0], own[0]), wide_sub(g->corner[1], own[0]),
                          wide_sub(g->corner[2], own[0])};
    const qm_vf side[3] = {wide_dot(up, from[0]), wide_dot(up, from[1]), wide_dot(up, from[2])};
    qm_vi apart = one_sided(side, tolerance, of_q);

    qm_vf other_tolerance = scale * size * (size + size + own_size) + UNDERFLOW;
    wide other_up = {load(q->normal[0]), load(q->normal[1]), load(q->normal[2])};
    const qm_vi of_p[3] = {s.same[0][0] | s.same[0][1] | s.same[0][2],
                           s.same[1][0] | s.same[1][1] | s.same[1][2],
                           s.same[2][0] | s.same[2][1] | s.same[2][2]};
    const qm_vf other_side[3] = {wide_dot(other_up, wide_sub(own[0], g->corner[0])),
                                 wide_dot(other_up, wide_sub(own[1], g->corner[0])),
                                 wide_dot(other_up, wide_sub(own[2], g->corner[0]))};
    apart |= one_sided(other_side, other_tolerance, of_p);

    qm_vf edge_tolerance = 2.0f * own_size * tolerance + UNDERFLOW;
    for (int c = 0; c < 3; c++) {
        int next = (c + 1) % 3;
        wide out = wide_cross(wide_sub(own[next], own[c]), up);
        qm_vi beyond = ~(qm_vi){0};
        for (int k = 0; k < 3; k++)
            beyond &= s.same[c][k] | s.same[next][k] |
                      (wide_dot(out, wide_sub(g->corner[k], own[c])) > edge_tolerance);
        apart |= beyond;
    }
    return apart;
}

/** The same with the planes through the edges of q's lanes. */
static inline qm_vi lanes_apart_by_edges(const against *g, int i)
{
    const qm_leaf *p = g->p, *q = g->q;
    shared_corners s = find_shared(g, i);
    wide own[3], up = {load(q->normal[0]), load(q->normal[1]), load(q->normal[2])};
    for (int c = 0; c < 3; c++)
        own[c] = wide_set(
            (const float[3]){p->corner[c][0][i], p->corner[c][1][i], p->corner[c][2][i]});
    qm_vf size = load(q->size), own_size = (qm_vf){0} + p->size[i];
    qm_vf tolerance = 128.0f * g->error * size * (size + size + own_size) + UNDERFLOW;
    qm_vf edge_tolerance = 2.0f * size * tolerance + UNDERFLOW;
    qm_vi apart = {0};
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        wide out = wide_cross(wide_sub(g->corner[next], g->corner[k]), up);
        qm_vi beyond = ~(qm_vi){0};
        for (int c = 0; c < 3; c++)
            beyond &= s.same[c][k] | s.same[c][next] |
                      (wide_dot(out, wide_sub(own[c], g->corner[k])) > edge_tolerance);
        apart |= beyond;
    }
    return apart;
}

static inline bool compare(const qm_leaf *p, const qm_leaf *q, bool is_self, uint8_t near[QM_PACK_LANES])
{
    against g = make_against(p, q, is_self);
    bool is_same = is_self && p->pack == q->pack, any = false;
    unsigned lanes = lanes_near(&g);
    memset(near, 0, QM_PACK_LANES);
    for (; lanes; lanes &= lanes - 1) {
        int i = __builtin_ctz(lanes);
        unsigned bits = boxes_near(&g, i);
        if (is_same) bits &= ~0u << (i + 1);
        if (bits) bits &= ~qm_vi_bits(lanes_apart(&g, i));
        if (bits) bits &= ~qm_vi_bits(lanes_apart_by_edges(&g, i));
        near[i] = (uint8_t)bits;
        any |= bits != 0;
    }
    return any;
}

bool QM_KERNEL(compare_leaves)(const qm_leaf *p, const qm_leaf *q, bool is_self,
                               uint8_t near[QM_PACK_LANES])
{
    return is_self ? compare(p, q, true, near) : compare(p, q, false, near);
}
