/**
 * collide_patches.c: two packs whose quads are read as bilinear patches: faces whose boxes meet are compared
 * one by one.
 */
#include "collide_faces.h"
#include "collide_worker.h"

/** The faces of a pack with their boxes. */
typedef struct pack_faces {
    int count;
    uint32_t face[QM_PACK_LANES];
    unsigned moved; /* bits by place here */
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

/** Triangles of a fan share edges as any do; only quads need the patches. */
static bool faces_meet(const qm_collide_search *search, uint32_t face_a, uint32_t face_b)
{
    const qm_mesh *a = &search->bvh[0]->mesh, *b = &search->bvh[1]->mesh;
    qm_faces faces = {.mesh = {a, b}, .face = {face_a, face_b}, .is_self = search->kind == QM_COLLIDE_SELF};
    if (qm_faces_have_quad(&faces)) return qm_faces_meet_bilinear(&faces, search->options->tolerance, NULL);
    return qm_faces_meet_exactly(&faces);
}

/** Tests a pair of faces; false when the search may end. */
static bool test_faces(qm_collide_worker *w, uint32_t face_a, uint32_t face_b)
{
    const qm_collide_search *search = w->search;
    qm_face_pair pair;
    if (!qm_collide_wants(w, qm_mesh_input_face(&search->bvh[0]->mesh, face_a),
                          qm_mesh_input_face(&search->bvh[1]->mesh, face_b), &pair))
        return true;
    w->tests++;
    return !faces_meet(search, face_a, face_b) || qm_collide_keep(w, pair);
}

bool qm_collide_patches(qm_collide_worker *w, const qm_pack_pair *packs)
{
    const qm_collide_search *search = w->search;
    pack_faces p, q;
    load_faces(search->bvh[0], packs->pack[0], packs->moved[0], &p);
    load_faces(search->bvh[1], packs->pack[1], packs->moved[1], &q);
    bool is_same = search->kind == QM_COLLIDE_SELF && packs->pack[0] == packs->pack[1];
    for (int i = 0; i < p.count; i++) {
        for (int j = is_same ? i + 1 : 0; j < q.count; j++) {
            bool has_moved = (p.moved >> i | q.moved >> j) & 1;
            if (!has_moved || !boxes_meet(&p.box[i], &q.box[j])) continue;
            if (!test_faces(w, p.face[i], q.face[j])) return false;
        }
    }
    return true;
}
