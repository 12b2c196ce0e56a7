/**
 * bvh_tree.h: the inside of a tree, shared by its builder, the kernels and the searches.
 *
 * Faces lie in Hilbert order of their centroids; eight lanes (triangles; a quad takes two neighbouring lanes
 * of one pack) make a pack, and a tree of boxes (box_tree.h) lies over the packs.
 */
#ifndef QM_BVH_TREE_H
#define QM_BVH_TREE_H

#include "box_tree.h"
#include "core/demand.h"
#include "float_pack.h"
#include "prim/bilinear_point.h"
#include "qm/bvh.h"

#define QM_PACK_LANES 8
#define QM_MAX_SCALE_RATIO 0x1p300 /* of local lengths to 1: beyond it, squares would overflow or vanish */

/**
 * Local frame of a tree: local = (world - origin) * scale. scale is a power of two, so that scaling is exact
 * and squared lengths neither overflow nor vanish; the mesh then lies within [-1, 1] in each coordinate.
 */
typedef struct qm_frame {
    qm_vec origin;
    double scale, inverse_scale;
} qm_frame;

static inline qm_vec qm_frame_local(const qm_frame *frame, const double *world)
{
    return qm_vec_scale(frame->scale, qm_vec_sub(qm_vec_load(world), frame->origin));
}

static inline qm_vec qm_frame_world(const qm_frame *frame, qm_vec local)
{
    return qm_vec_axpy(frame->origin, frame->inverse_scale, local);
}

/**
 * Rows of a pack. A triangle is kept by an orthonormal frame: origin at an end of its longest edge, X along
 * that edge, Y in the plane towards the third corner, Z = X x Y. In it the corners are (0, 0), (L, 0) and
 * (CX, CY). Distances computed this way are exact for a triangle within a few roundings of the true one,
 * whatever its shape; barycentric formulas lose all digits on slivers.
 */
enum {
    QM_ROW_OX,
    QM_ROW_OY,
    QM_ROW_OZ,
    QM_ROW_XX,
    QM_ROW_XY,
    QM_ROW_XZ,
    QM_ROW_YX,
    QM_ROW_YY,
    QM_ROW_YZ,
    QM_ROW_ZX,
    QM_ROW_ZY,
    QM_ROW_ZZ,
    QM_ROW_L,
    QM_ROW_CX,
    QM_ROW_CY,
    QM_ROW_INVERSE_C2, /* 1 / |(CX, CY)|^2, 0 for an edge of no length */
    QM_ROW_INVERSE_D2, /* 1 / |(CX - L, CY)|^2, likewise */
    QM_ROW_COUNT
};

typedef struct qm_pack {
    _Alignas(64) double row[QM_ROW_COUNT][QM_PACK_LANES];
} qm_pack;

/** The corners of a pack's lanes, local: at[corner][axis][lane]; lanes past the last repeat the first. */
typedef struct qm_pack_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} qm_pack_corners;

/** What a pack stands for in the mesh. Lanes past lane_count repeat lane 0 and are never looked at by
 * sources. */
typedef struct qm_pack_lanes {
    uint32_t face[QM_PACK_LANES];
    uint32_t vertex[3 * QM_PACK_LANES]; /* the different vertices of the pack, vertex_count of them */
    uint8_t corner[QM_PACK_LANES][3];   /* corners of each lane, as places in vertex[] */
    uint8_t lane_count, vertex_count;
    uint8_t
        second; /* bit j: lane j is the second triangle (c0 c2 c3) of a quad, whose first one is lane j - 1 */
} qm_pack_lanes;

static inline bool qm_lane_is_second(const qm_pack_lanes *lanes, uint32_t lane)
{
    return lanes->second >> lane & 1;
}

/** True when the lane is the first triangle of a quad, whose second one is in the next. */
static inline bool qm_lane_has_second(const qm_pack_lanes *lanes, uint32_t lane)
{
    return qm_lane_is_second(lanes, lane + 1);
}

/** Corners of the face that starts at a lane, as places in vertex[]: of a quad all four where patches are
 * read, else of the lane alone. Returns 3 or 4; the next face starts count - 2 lanes on. */
static inline int qm_lane_corners(const qm_pack_lanes *lanes, uint32_t lane, bool patches, int corner[4])
{
    for (int i = 0; i < 3; i++)
        corner[i] = lanes->corner[lane][i];
    if (!patches || !qm_lane_has_second(lanes, lane)) return 3;
    corner[3] = lanes->corner[lane + 1][2];
    return 4;
}

/** |w| / 4 of each lane's quad rounded up, local; 0 for triangles. */
typedef struct qm_pack_twists {
    float lane[QM_PACK_LANES];
} qm_pack_twists;

struct qm_bvh {
    qm_mesh mesh; /* the arrays are borrowed */
    qm_frame frame;
    double reach; /* greatest local coordinate of the surface, by magnitude: at most 1 */
    size_t pack_count;
    qm_pack_lanes *lanes;
    bool has_quads;
    qm_box_tree boxes; /* over the packs */
    /* Of each pack, made on demand: bvh_demand.h. Without items where the tree was built without. */
    qm_demand floats, rows; /* qm_float_pack, qm_pack: the triangles of targets in both precisions */
    bool has_all_floats;    /* those in single precision are all made */
    qm_demand twists;       /* qm_pack_twists: when there are quads that may be read as patches */
};

static inline bool qm_bvh_has_twists(const qm_bvh *bvh)
{
    return bvh->twists.items != NULL;
}

/** True when the tree was built with what it takes to search it in this reading. */
static inline bool qm_bvh_is_target(const qm_bvh *bvh, qm_quad_reading reading)
{
    return bvh->rows.items && (reading == QM_QUADS_TRIANGLES || qm_bvh_has_twists(bvh) || !bvh->has_quads);
}

/** A vertex in the local frame. */
static inline qm_vec qm_bvh_vertex(const qm_bvh *bvh, uint32_t vertex)
{
    return qm_frame_local(&bvh->frame, bvh->mesh.positions + 3 * (size_t)vertex);
}

/** Corners of the triangle of a lane in the local frame. */
static inline void qm_bvh_load_triangle(const qm_bvh *bvh, uint32_t pack, uint32_t lane, qm_vec corner[3])
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    for (int i = 0; i < 3; i++)
        corner[i] = qm_bvh_vertex(bvh, lanes->vertex[lanes->corner[lane][i]]);
}

/** Corners of a face in the local frame; returns 3 or 4. */
static inline int qm_bvh_load_face(const qm_bvh *bvh, uint32_t face, qm_vec corner[4])
{
    const qm_mesh *mesh = &bvh->mesh;
    if (mesh->face_count == 0) {
        corner[0] = corner[1] = corner[2] = qm_bvh_vertex(bvh, face);
        return 3;
    }
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    int count = index[3] == QM_NO_INDEX ? 3 : 4;
    for (int i = 0; i < count; i++)
        corner[i] = qm_bvh_vertex(bvh, index[i]);
    return count;
}

/** The bilinear patch of a quad in the local frame. */
static inline qm_bilinear qm_bvh_load_patch(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    qm_bvh_load_face(bvh, face, corner);
    return qm_bilinear_make(corner);
}

#endif
