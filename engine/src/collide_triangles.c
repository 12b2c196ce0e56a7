/**
 * collide_triangles.c: two packs of triangles: most pairs are told apart eight at a time, many between copies
 * have a corner in common, and the rest is decided by exact signs.
 */
#include "collide_worker.h"
#include "tri_tri.h"

static const qm_leaf *get_leaf(qm_collide_worker *w, int cache, int mesh, uint32_t pack)
{
    const qm_collide_search *search = w->search;
    qm_leaf *leaf = &w->cache[cache][pack % QM_CACHED_LEAVES];
    if (leaf->pack != pack)
        qm_leaf_fill(search->bvh[mesh], &search->bvh[0]->frame, search->is_self, pack, leaf);
    return leaf;
}

/** One mesh needs the second cache only for leaves that want the same place in the first. */
static const qm_leaf *get_second_leaf(qm_collide_worker *w, const qm_leaf *first, uint32_t pack)
{
    bool same_cache = w->search->is_self &&
                      (pack == first->pack || pack % QM_CACHED_LEAVES != first->pack % QM_CACHED_LEAVES);
    return get_leaf(w, same_cache ? 0 : 1, 1, pack);
}

/** One of two packs that are compared. */
typedef struct side {
    const qm_leaf *leaf;
    const qm_pack_lanes *lanes;
    const double *positions; /* of the mesh */
} side;

static side make_side(const qm_bvh *bvh, const qm_leaf *leaf)
{
    return (side){leaf, &bvh->lanes[leaf->pack], bvh->mesh.positions};
}

static uint32_t corner_vertex(const side *s, int lane, int corner)
{
    return s->lanes->vertex[s->lanes->corner[lane][corner]];
}

/** Triangles of two meshes whose corners lie at the same place meet there. */
static bool corners_coincide(const side *a, int i, const side *b, int j, int32_t corners)
{
    const double *x = a->positions + 3 * (size_t)corner_vertex(a, i, corners >> 2),
                 *y = b->positions + 3 * (size_t)corner_vertex(b, j, corners & 3);
    return x[0] == y[0] && x[1] == y[1] && x[2] == y[2];
}

static void load_triangle(const side *s, int lane, uint32_t vertex[3], qm_vec corner[3])
{
    for (int i = 0; i < 3; i++) {
        vertex[i] = corner_vertex(s, lane, i);
        corner[i] = qm_vec_load(s->positions + 3 * (size_t)vertex[i]);
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

/** Decides all lanes of b that may meet lane i of a; false when the search may end. */
static bool test_lane(qm_collide_worker *w, const side *a, int i, const side *b, const qm_near_lanes *lanes)
{
    bool is_self = w->search->is_self;
    for (unsigned bits = lanes->near[i]; bits; bits &= bits - 1) {
        int j = __builtin_ctz(bits);
        qm_face_pair faces;
        if (!qm_collide_wants(w, a->leaf->face[i], b->leaf->face[j], &faces)) continue;
        w->tests++;
        bool is_alike = lanes->alike[i] >> j & 1;
        if (!(is_alike && corners_coincide(a, i, b, j, lanes->corners[i][j])) &&
            !triangles_meet(a, i, b, j, is_self))
            continue;
        if (!qm_collide_keep(w, faces)) return false;
    }
    return true;
}

bool qm_collide_triangles(qm_collide_worker *w, const qm_pack_pair *packs)
{
    const qm_collide_search *search = w->search;
    const qm_leaf *p = get_leaf(w, 0, 0, packs->pack[0]), *q = get_second_leaf(w, p, packs->pack[1]);
    qm_near_lanes lanes;
    if (!w->kernel->compare_leaves(p, q, search->is_self, packs->moved[0], packs->moved[1], &lanes))
        return true;
    side a = make_side(search->bvh[0], p), b = make_side(search->bvh[1], q);
    for (int i = 0; i < QM_PACK_LANES; i++)
        if (lanes.near[i] && !test_lane(w, &a, i, &b, &lanes)) return false;
    return true;
}
