/**
 * winding.c: the faces above a point, found through the tree, and the turns of their outlines.
 */
#include "winding.h"

#include "prim/bilinear.h"
#include "prim/orient.h"

/** A query: the point as the signs see it, and in the frame of the tree's boxes. */
typedef struct winding_query {
    const qm_bvh *bvh;
    bool has_patches;
    qm_winding_space space;
    qm_vec p, local;
} winding_query;

/** How often the outline of a triangle turns round the point, as seen from above, counted on the ray along x: each edge that
 * crosses it has one end at most as high as the point and one above. */
static int outline_turn(const qm_vec t[3], qm_vec p)
{
    int turn = 0;
    for (int i = 0; i < 3; i++) {
        const qm_vec *from = &t[i], *to = &t[(i + 1) % 3];
        bool rises = from->y <= p.y && to->y > p.y, falls = from->y > p.y && to->y <= p.y;
        if (rises && qm_orient2d_nudged(*from, *to, p) > 0) turn++;
        if (falls && qm_orient2d_nudged(*from, *to, p) < 0) turn--;
    }
    return turn;
}

/** The turn of a triangle that is above the point, else 0. */
static int triangle_turn(const qm_vec t[3], qm_vec p)
{
    if ((t[0].y <= p.y) == (t[1].y <= p.y) && (t[1].y <= p.y) == (t[2].y <= p.y)) return 0;
    int turn = outline_turn(t, p);
    return turn != 0 && qm_orient3d_nudged(t[0], t[1], t[2], p) == -turn ? turn : 0;
}

/** What a patch adds to its triangles: 1 or -1 between them, where the triangles look towards the patch or away from it. */
static int twist_turn(const qm_vec c[4], qm_vec p)
{
    int volume = qm_orient3d(c[0], c[1], c[2], c[3]);
    if (volume == 0) return 0;
    bool is_inside = qm_orient3d_nudged(c[0], c[1], c[2], p) == volume &&
                     qm_orient3d_nudged(c[0], c[2], c[3], p) == volume &&
                     qm_orient3d_nudged(c[1], c[2], c[3], p) == -volume &&
                     qm_orient3d_nudged(c[0], c[1], c[3], p) == -volume;
    return is_inside && qm_bilinear_side(c, p) > 0 ? volume : 0;
}

static int face_turn(const winding_query *query, uint32_t pack, uint32_t lane)
{
    const qm_bvh *bvh = query->bvh;
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    const uint32_t *index = bvh->mesh.faces + 4 * (size_t)lanes->face[lane];
    bool is_second = qm_lane_is_second(lanes, lane);
    bool has_patch = query->has_patches && qm_lane_has_second(lanes, lane);
    qm_vec c[4];
    for (int i = 0; i < (has_patch ? 4 : 3); i++) {
        const double *at = bvh->mesh.positions + 3 * (size_t)index[i > 0 && is_second ? i + 1 : i];
        c[i] = query->space == QM_WINDING_LOCAL ? qm_frame_local(&bvh->frame, at) : qm_vec_load(at);
    }
    int turn = triangle_turn(c, query->p);
    return has_patch ? turn + twist_turn(c, query->p) : turn;
}

static int pack_turn(const winding_query *query, uint32_t pack)
{
    int turn = 0;
    for (uint32_t lane = 0; lane < query->bvh->lanes[pack].lane_count; lane++)
        turn += face_turn(query, pack, lane);
    return turn;
}

/** The turns of all faces below a node, but for those whose boxes the ray upward from the point misses: a box is larger than what
 * is in it by far more than the local point is rounded. */
static int node_turn(const winding_query *query, int level, size_t node)
{
    const qm_box_tree *boxes = &query->bvh->boxes;
    const qm_box_node *box = &boxes->groups[level][node];
    const qm_vec p = query->local;
    int turn = 0, count = qm_box_tree_child_count(boxes, level, node);
    for (int i = 0; i < count; i++) {
        bool is_above = p.x >= (double)box->low[0][i] && p.x <= (double)box->high[0][i] &&
                        p.y >= (double)box->low[1][i] && p.y <= (double)box->high[1][i] &&
                        p.z <= (double)box->high[2][i];
        if (!is_above) continue;
        size_t child = 8 * node + (size_t)i;
        turn += level > 1 ? node_turn(query, level - 1, child) : pack_turn(query, (uint32_t)child);
    }
    return turn;
}

int qm_winding_number(const qm_bvh *bvh, qm_quad_reading reading, qm_winding_space space, qm_vec p)
{
    QM_ASSERT(bvh);
    double world[3];
    qm_vec_store(world, p);
    const winding_query query = {.bvh = bvh,
                                 .has_patches = reading == QM_QUADS_BILINEAR && bvh->has_quads,
                                 .space = space,
                                 .p = p,
                                 .local = space == QM_WINDING_LOCAL ? p : qm_frame_local(&bvh->frame, world)};
    return bvh->mesh.face_count > 0 ? node_turn(&query, bvh->boxes.level_count, 0) : 0;
}
