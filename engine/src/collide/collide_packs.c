/**
 * collide_packs.c: whether the facets of two packs meet, and which pairs of input faces that makes.
 *
 * Triangles of two meshes go through three stages. The kernel compares the boxes of all 64 pairs of lanes,
 * and the pairs that are left wait until 64 of them can be decided together, eight at a time: it proves in
 * single precision that they meet, or that they do not, or leaves them open. Open pairs take the exact test.
 * Facets of one mesh, or of two identical copies, are compared by separating planes instead, as most pairs of
 * neighbours touch in what they share and would stay open.
 *
 * Bilinear quads have no such filter: faces whose boxes overlap are tested one by one.
 */
#include <string.h>

#include "collide_faces.h"
#include "collide_search.h"
#include "prim/tri_tri.h"

/* ---- which pairs are recorded ---- */

/** Two input faces as a pair, smaller index first in a mesh against itself; false when they are one face, or
 * when the mode needs no pair behind the first one. */
static inline bool is_wanted(const qm_collide_worker *w, uint32_t a, uint32_t b, qm_face_pair *out)
{
    bool is_self = w->search->kind == QM_COLLIDE_SELF, swaps = is_self && a > b;
    *out = (qm_face_pair){swaps ? b : a, swaps ? a : b};
    return !(is_self && a == b) && ((uint64_t)out->a << 32 | out->b) < w->first_pair;
}

/** Records a wanted pair as the mode asks for it; false when the search may end. */
static inline bool record(qm_collide_worker *w, qm_face_pair pair)
{
    const qm_collide_options *options = w->search->options;
    if (options->mode == QM_COLLIDE_FIRST) {
        QM_ASSERT(((uint64_t)pair.a << 32 | pair.b) < w->first_pair);
        w->first_pair = (uint64_t)pair.a << 32 | pair.b;
        return true;
    }
    if (!qm_pair_list_add(w->search->ctx, &w->pairs, pair)) {
        qm_collide_stop(w->status, QM_E_NO_MEMORY);
        return false;
    }
    return options->mode == QM_COLLIDE_ALL;
}

/* ---- triangles ---- */

static const qm_collide_leaf *get_leaf(qm_collide_worker *w, int cache, int mesh, uint32_t pack)
{
    const qm_collide_search *search = w->search;
    qm_collide_leaf *leaf = &w->cache[cache][pack % QM_CACHED_LEAVES];
    if (leaf->pack != pack)
        w->kernel->fill_leaf(search->bvh[mesh], &search->bvh[0]->frame, search->kind, pack, leaf);
    return leaf;
}

/** In one tree the second cache serves only leaves that would evict the first leaf from its slot. */
static const qm_collide_leaf *get_second_leaf(qm_collide_worker *w, const qm_collide_leaf *first,
                                              uint32_t pack)
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

/** The input face of a lane. */
static uint32_t lane_face(const side *s, int lane)
{
    return qm_mesh_input_face(s->mesh, s->lanes->face[lane]);
}

static uint32_t corner_vertex(const side *s, int lane, int corner)
{
    return s->lanes->vertex[s->lanes->corner[lane][corner]];
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

/** In mode ALL, records the pairs of lanes of identical copies that share a vertex, in both orders, and
 * removes them from those that are left to test. Equal marks prove it: in one mesh a mark is the vertex. */
static void record_coincident(qm_collide_worker *w, const side *a, const side *b, uint64_t alike,
                              uint64_t *left)
{
    size_t count = 0;
    qm_face_pair *room = qm_pair_list_reserve(w->search->ctx, &w->pairs, 2 * QM_PACK_LANES * QM_PACK_LANES);
    if (!room) return; /* adding the pairs one by one reports the lack of memory */
    *left &= ~alike;
    for (; alike; alike &= alike - 1) {
        int index = __builtin_ctzll(alike), i = index / QM_PACK_LANES, j = index % QM_PACK_LANES;
        qm_face_pair pair = {lane_face(a, i), lane_face(b, j)};
        room[count++] = (qm_face_pair){pair.b, pair.a};
        room[count++] = pair;
    }
    qm_pair_list_commit(&w->pairs, count);
    w->tests += count;
}

/** Records a pair of faces that meet, for identical copies in both orders; false when the search may end. */
static bool record_faces(qm_collide_worker *w, uint32_t face_a, uint32_t face_b)
{
    qm_face_pair pair;
    if (is_wanted(w, face_a, face_b, &pair) && !record(w, pair)) return false;
    bool swaps = w->search->kind == QM_COLLIDE_COPY && face_a != face_b;
    return !swaps || !is_wanted(w, face_b, face_a, &pair) || record(w, pair);
}

/** Tests a pair of lanes exactly; false when the search may end. */
static bool test_lanes(qm_collide_worker *w, const side *a, int i, const side *b, int j)
{
    uint32_t face_a = lane_face(a, i), face_b = lane_face(b, j);
    qm_collide_kind kind = w->search->kind;
    qm_face_pair pair, swapped;
    if (!is_wanted(w, face_a, face_b, &pair) &&
        !(kind == QM_COLLIDE_COPY && is_wanted(w, face_b, face_a, &swapped)))
        return true;
    w->tests++;
    return !triangles_meet(a, i, b, j, kind == QM_COLLIDE_SELF) || record_faces(w, face_a, face_b);
}

/** Two packs of one tree. */
static bool compare_packs(qm_collide_worker *w, const qm_pack_pair *packs)
{
    const qm_collide_search *search = w->search;
    const qm_collide_leaf *p = get_leaf(w, 0, 0, packs->pack[0]), *q = get_second_leaf(w, p, packs->pack[1]);
    side a = make_side(search->bvh[0], p->pack), b = make_side(search->bvh[1], q->pack);
    for (int i = 0; search->kind == QM_COLLIDE_COPY && p == q && i < a.lanes->lane_count; i++) {
        uint32_t face = lane_face(&a, i); /* every face meets its copy */
        if (!record_faces(w, face, face)) return false;
    }
    qm_near_lanes lanes;
    if (!w->kernel->compare_leaves(p, q, search->kind, packs->moved[0], packs->moved[1], &lanes)) return true;
    QM_ASSERT((lanes.alike & ~lanes.near) == 0);
    uint64_t left = lanes.near;
    if (lanes.alike && search->options->mode == QM_COLLIDE_ALL)
        record_coincident(w, &a, &b, lanes.alike, &left);
    for (; left; left &= left - 1) {
        int index = __builtin_ctzll(left);
        if (!test_lanes(w, &a, index / QM_PACK_LANES, &b, index % QM_PACK_LANES)) return false;
    }
    return true;
}

/** Records the pairs of lanes whose common corner is one indeed, and tests the others: marks of two meshes
 * are hashes of positions. */
static bool take_alike(qm_collide_worker *w, const uint32_t pack[2], const qm_near_lanes *lanes)
{
    side a = make_side(w->search->bvh[0], pack[0]), b = make_side(w->search->bvh[1], pack[1]);
    bool goes_on = true;
    w->alike += (size_t)__builtin_popcountll(lanes->alike);
    for (uint64_t alike = lanes->alike; alike && goes_on; alike &= alike - 1) {
        int index = __builtin_ctzll(alike), i = index / QM_PACK_LANES, j = index % QM_PACK_LANES;
        /* Corners that have the same position: their triangles meet there. Bits are compared, which is fast: 0
         * and -0 are left to the exact test. */
        uint64_t x[3], y[3];
        memcpy(x, a.mesh->positions + 3 * (size_t)corner_vertex(&a, i, lanes->corners[i][j] >> 2), sizeof x);
        memcpy(y, b.mesh->positions + 3 * (size_t)corner_vertex(&b, j, lanes->corners[i][j] & 3), sizeof y);
        bool coincide = ((x[0] ^ y[0]) | (x[1] ^ y[1]) | (x[2] ^ y[2])) == 0;
        goes_on =
            coincide ? record_faces(w, lane_face(&a, i), lane_face(&b, j)) : test_lanes(w, &a, i, &b, j);
    }
    return goes_on;
}

/** Where two meshes share vertices, as scans of one object or an edited copy do, the search for common
 * corners decides most pairs that the filter would leave open; elsewhere it finds none. So it is switched on
 * while a quarter of the pairs are open or alike. */
bool qm_collide_decide(qm_collide_worker *w)
{
    QM_ASSERT(w->waiting->count <= QM_PAIRS_CAPACITY);
    bool goes_on = true;
    size_t open = w->alike, count = w->alike + w->waiting->count;
    for (unsigned first = 0; first < w->waiting->count && goes_on; first += QM_PACK_LANES) {
        qm_pair_verdicts verdicts;
        w->kernel->decide_lane_pairs(w->waiting, first, &verdicts);
        open += (size_t)__builtin_popcount(verdicts.open);
        for (unsigned left = verdicts.meet | verdicts.open; left && goes_on; left &= left - 1) {
            unsigned i = (unsigned)__builtin_ctz(left);
            side s[2];
            int lane[2];
            for (int k = 0; k < 2; k++) {
                uint32_t from = w->waiting->lane[k][first + i];
                s[k] = make_side(w->search->bvh[k], from / QM_PACK_LANES);
                lane[k] = (int)(from % QM_PACK_LANES);
            }
            goes_on = verdicts.meet >> i & 1
                          ? record_faces(w, lane_face(&s[0], lane[0]), lane_face(&s[1], lane[1]))
                          : test_lanes(w, &s[0], lane[0], &s[1], lane[1]);
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
    const qm_collide_leaf *p = get_leaf(w, 0, 0, packs->pack[0]), *q = get_leaf(w, 1, 1, packs->pack[1]);
    qm_near_lanes lanes;
    w->kernel->add_lane_pairs(p, q, w->seeks_alike, w->waiting, &lanes);
    if (lanes.alike && !take_alike(w, packs->pack, &lanes)) return false;
    return w->waiting->count < QM_PAIRS_BATCH || qm_collide_decide(w);
}

/* ---- bilinear patches ---- */

/** The faces of a pack with their boxes. */
typedef struct pack_faces {
    int count;
    uint32_t face[QM_PACK_LANES];
    unsigned moved; /* bit i: face[i] has moved */
    qm_box box[QM_PACK_LANES];
} pack_faces;

static qm_box face_box(const qm_mesh *mesh, uint32_t face)
{
    qm_vec corner[4];
    if (mesh->face_count == 0) {
        corner[0] = qm_vec_load(mesh->positions + 3 * (size_t)face);
        return qm_vec_box(corner, 1);
    }
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    int count = index[3] == QM_NO_INDEX ? 3 : 4;
    for (int i = 0; i < count; i++)
        corner[i] = qm_vec_load(mesh->positions + 3 * (size_t)index[i]);
    return qm_vec_box(corner, count);
}

static void load_faces(const qm_bvh *bvh, uint32_t pack, unsigned moved, pack_faces *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    out->count = 0;
    out->moved = 0;
    for (uint32_t lane = 0; lane < lanes->lane_count; lane++) {
        if (qm_lane_is_second(lanes, lane)) continue;
        out->face[out->count] = lanes->face[lane];
        out->box[out->count] = face_box(&bvh->mesh, lanes->face[lane]);
        out->moved |= (moved >> lane & 1) << out->count++;
    }
}

static bool boxes_meet(const qm_box *a, const qm_box *b)
{
    for (int k = 0; k < 3; k++)
        if (a->min[k] > b->max[k] || b->min[k] > a->max[k]) return false;
    return true;
}

bool qm_collide_patches(qm_collide_worker *w, const qm_pack_pair *packs)
{
    const qm_collide_search *search = w->search;
    const qm_mesh *a = &search->bvh[0]->mesh, *b = &search->bvh[1]->mesh;
    bool is_self = search->kind == QM_COLLIDE_SELF, is_same = is_self && packs->pack[0] == packs->pack[1];
    pack_faces p, q;
    load_faces(search->bvh[0], packs->pack[0], packs->moved[0], &p);
    load_faces(search->bvh[1], packs->pack[1], packs->moved[1], &q);
    for (int i = 0; i < p.count; i++) {
        for (int j = is_same ? i + 1 : 0; j < q.count; j++) {
            bool has_moved = (p.moved >> i | q.moved >> j) & 1;
            if (!has_moved || !boxes_meet(&p.box[i], &q.box[j])) continue;
            uint32_t face_a = qm_mesh_input_face(a, p.face[i]), face_b = qm_mesh_input_face(b, q.face[j]);
            qm_face_pair pair;
            if (!is_wanted(w, face_a, face_b, &pair)) continue;
            w->tests++;
            /* Only pairs with a quad are tested as patches: triangles stay exact. */
            qm_collide_faces faces = {.mesh = {a, b}, .face = {p.face[i], q.face[j]}, .is_self = is_self};
            bool meets = qm_collide_faces_have_quad(&faces)
                             ? qm_collide_faces_meet_bilinear(&faces, search->options->tolerance, NULL)
                             : qm_collide_faces_meet_exactly(&faces);
            if (meets && !record(w, pair)) return false;
        }
    }
    return true;
}
