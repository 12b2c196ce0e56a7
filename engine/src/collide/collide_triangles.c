/**
 * collide_triangles.c: two packs of triangles: most pairs are told apart eight at a time, many between copies
 * have a corner in common, and the rest is decided by exact signs.
 */
#include <string.h>

#include "collide_worker.h"
#include "prim/tri_tri.h"

static const qm_leaf *get_leaf(qm_collide_worker *w, int cache, int mesh, uint32_t pack)
{
    const qm_collide_search *search = w->search;
    qm_leaf *leaf = &w->cache[cache][pack % QM_CACHED_LEAVES];
    if (leaf->pack != pack)
        w->kernel->fill_leaf(search->bvh[mesh], &search->bvh[0]->frame, search->kind, pack, leaf);
    return leaf;
}

/** One tree needs the second cache only for leaves that want the same place in the first. */
static const qm_leaf *get_second_leaf(qm_collide_worker *w, const qm_leaf *first, uint32_t pack)
{
    bool same_cache = w->search->kind != QM_COLLIDE_TWO &&
                      (pack == first->pack || pack % QM_CACHED_LEAVES != first->pack % QM_CACHED_LEAVES);
    return get_leaf(w, same_cache ? 0 : 1, 1, pack);
}

/** One of two packs that are compared. */
typedef struct side {
    const qm_pack_lanes *lanes;
    const qm_mesh *mesh;
} side;

static side make_side(const qm_bvh *bvh, uint32_t pack)
{
    return (side){&bvh->lanes[pack], &bvh->mesh};
}

/** In the numbering of the input. */
static uint32_t lane_face(const side *s, int lane)
{
    return qm_mesh_input_face(s->mesh, s->lanes->face[lane]);
}

static uint32_t corner_vertex(const side *s, int lane, int corner)
{
    return s->lanes->vertex[s->lanes->corner[lane][corner]];
}

/** Triangles of two meshes whose corners lie at the same place meet there. Bits are compared, which is quick:
 * 0 and -0 are left to the exact test. */
static bool corners_coincide(const side *a, int i, const side *b, int j, int32_t corners)
{
    uint64_t x[3], y[3];
    memcpy(x, a->mesh->positions + 3 * (size_t)corner_vertex(a, i, corners >> 2), sizeof x);
    memcpy(y, b->mesh->positions + 3 * (size_t)corner_vertex(b, j, corners & 3), sizeof y);
    return ((x[0] ^ y[0]) | (x[1] ^ y[1]) | (x[2] ^ y[2])) == 0;
}

static void load_triangle(const side *s, int lane, uint32_t vertex[3], qm_vec corner[3])
{
    for (int i = 0; i < 3; i++) {
        vertex[i] = corner_vertex(s, lane, i);
        corner[i] = qm_vec_load(s->mesh->positions + 3 * (size_t)vertex[i]);
    }
}

static bool triangles_meet(const side *a, int i, const side *b, int j, bool is_self)
{
    uint32_t a_vertex[3], b_vertex[3];
    qm_vec p[3], q[3];
    load_triangle(a, i, a_vertex, p);
    load_triangle(b, j, b_vertex, q);
    return is_self ? qm_tri_tri_cross(p, a_vertex, q, b_vertex) : qm_tri_tri_meet(p, q);
}

/** Keeps pairs of lanes of equal meshes that have a corner in common, both ways, where all pairs are asked
 * for, and takes them out of those that are left to test: equal marks are one vertex. */
static void take_coincident(qm_collide_worker *w, const side *a, const side *b, uint64_t alike,
                            uint64_t *left)
{
    size_t count = 0;
    qm_face_pair *room = qm_pair_list_room(w->search->ctx, &w->pairs, 2 * QM_PACK_LANES * QM_PACK_LANES);
    if (!room) return; /* adding the pairs one by one will tell */
    *left &= ~alike;
    for (; alike; alike &= alike - 1) {
        int place = __builtin_ctzll(alike), i = place / QM_PACK_LANES, j = place % QM_PACK_LANES;
        qm_face_pair pair = {lane_face(a, i), lane_face(b, j)};
        room[count++] = (qm_face_pair){pair.b, pair.a};
        room[count++] = pair;
    }
    qm_pair_list_take(&w->pairs, count);
    w->tests += count;
}

/** Keeps a pair of faces that meet, and for equal meshes the pair the other way round; false when the search
 * may end. */
static bool keep(qm_collide_worker *w, uint32_t face_a, uint32_t face_b)
{
    qm_face_pair pair;
    if (qm_collide_wants(w, face_a, face_b, &pair) && !qm_collide_keep(w, pair)) return false;
    bool turns = w->search->kind == QM_COLLIDE_TWIN && face_a != face_b;
    return !turns || !qm_collide_wants(w, face_b, face_a, &pair) || qm_collide_keep(w, pair);
}

/** Equal meshes: every face meets itself. */
static bool keep_own(qm_collide_worker *w, const side *s)
{
    for (int i = 0; i < s->lanes->lane_count; i++) {
        uint32_t face = lane_face(s, i);
        if (!keep(w, face, face)) return false;
    }
    return true;
}

/** Tests a pair of lanes exactly; false when the search may end. */
static bool test_lanes(qm_collide_worker *w, const side *a, int i, const side *b, int j)
{
    uint32_t face_a = lane_face(a, i), face_b = lane_face(b, j);
    qm_collide_kind kind = w->search->kind;
    qm_face_pair ahead, back;
    bool is_wanted = qm_collide_wants(w, face_a, face_b, &ahead) ||
                     (kind == QM_COLLIDE_TWIN && qm_collide_wants(w, face_b, face_a, &back));
    if (!is_wanted) return true;
    w->tests++;
    return !triangles_meet(a, i, b, j, kind == QM_COLLIDE_SELF) || keep(w, face_a, face_b);
}

/** Packs of one tree. */
static bool compare_packs(qm_collide_worker *w, const qm_pack_pair *packs)
{
    const qm_collide_search *search = w->search;
    const qm_leaf *p = get_leaf(w, 0, 0, packs->pack[0]), *q = get_second_leaf(w, p, packs->pack[1]);
    side a = make_side(search->bvh[0], p->pack), b = make_side(search->bvh[1], q->pack);
    if (search->kind == QM_COLLIDE_TWIN && p == q && !keep_own(w, &a)) return false;
    qm_near_lanes lanes;
    if (!w->kernel->compare_leaves(p, q, search->kind, packs->moved[0], packs->moved[1], &lanes)) return true;
    uint64_t left = lanes.near;
    if (lanes.alike && search->options->mode == QM_COLLIDE_ALL)
        take_coincident(w, &a, &b, lanes.alike, &left);
    for (; left; left &= left - 1) {
        int place = __builtin_ctzll(left);
        if (!test_lanes(w, &a, place / QM_PACK_LANES, &b, place % QM_PACK_LANES)) return false;
    }
    return true;
}

/** Pairs of lanes that seem to have a corner in common meet when they do. */
static bool take_alike(qm_collide_worker *w, const uint32_t pack[2], const qm_near_lanes *lanes)
{
    side a = make_side(w->search->bvh[0], pack[0]), b = make_side(w->search->bvh[1], pack[1]);
    bool goes_on = true;
    w->alike += (size_t)__builtin_popcountll(lanes->alike);
    for (uint64_t alike = lanes->alike; alike && goes_on; alike &= alike - 1) {
        int place = __builtin_ctzll(alike), i = place / QM_PACK_LANES, j = place % QM_PACK_LANES;
        goes_on = corners_coincide(&a, i, &b, j, lanes->corners[i][j])
                      ? keep(w, lane_face(&a, i), lane_face(&b, j))
                      : test_lanes(w, &a, i, &b, j);
    }
    return goes_on;
}

/** Does what the verdict about a pair asks for; false when the search may end. */
static bool take_pair(qm_collide_worker *w, unsigned pair, bool meets)
{
    const qm_lane_pairs *waiting = w->waiting;
    side s[2];
    int lane[2];
    for (int k = 0; k < 2; k++) {
        s[k] = make_side(w->search->bvh[k], waiting->lane[k][pair] / QM_PACK_LANES);
        lane[k] = (int)(waiting->lane[k][pair] % QM_PACK_LANES);
    }
    if (meets) return keep(w, lane_face(&s[0], lane[0]), lane_face(&s[1], lane[1]));
    return test_lanes(w, &s[0], lane[0], &s[1], lane[1]);
}

/** Where meshes are alike in places, looking for common corners settles most of what would be left open
 * there; elsewhere it would settle nothing. */
bool qm_collide_decide(qm_collide_worker *w)
{
    bool goes_on = true;
    size_t open = w->alike, count = w->alike + w->waiting->count;
    for (unsigned first = 0; first < w->waiting->count && goes_on; first += QM_PACK_LANES) {
        qm_pair_verdicts verdicts;
        w->kernel->decide_lane_pairs(w->waiting, first, &verdicts);
        open += (size_t)__builtin_popcount(verdicts.open);
        for (unsigned left = verdicts.meet | verdicts.open; left && goes_on; left &= left - 1) {
            unsigned i = (unsigned)__builtin_ctz(left);
            goes_on = take_pair(w, first + i, verdicts.meet >> i & 1);
        }
    }
    w->waiting->count = 0;
    w->alike = 0;
    w->seeks_alike = 4 * open > count;
    return goes_on;
}

bool qm_collide_triangles(qm_collide_worker *w, const qm_pack_pair *packs)
{
    if (w->search->kind != QM_COLLIDE_TWO) return compare_packs(w, packs);
    const qm_leaf *p = get_leaf(w, 0, 0, packs->pack[0]), *q = get_leaf(w, 1, 1, packs->pack[1]);
    qm_near_lanes lanes;
    w->kernel->add_lane_pairs(p, q, w->seeks_alike, w->waiting, &lanes);
    if (lanes.alike && !take_alike(w, packs->pack, &lanes)) return false;
    return w->waiting->count < QM_PAIRS_ENOUGH || qm_collide_decide(w);
}
