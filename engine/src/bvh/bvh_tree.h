/**
 * bvh_tree.h: the bounding volume hierarchy over the faces of a mesh, shared by its builder, the kernels and
 * the searches.
 *
 * The leaf of the hierarchy is a pack: eight lanes, each a triangle. A quad takes two neighboring lanes of
 * one pack; a point of a point set is a triangle of no size. Faces lie in Hilbert order of their centroids,
 * and packs in the order of their faces. The inner nodes are boxes, eight children each (box_tree.h).
 *
 * What the hierarchy stores of a pack is small: which faces and vertices it has (qm_pack_lanes) and its box.
 * Its triangles as searches read them, in double precision (qm_pack) and in single precision (qm_float_pack),
 * are made on demand (bvh_demand.h).
 */
#ifndef QM_BVH_TREE_H
#define QM_BVH_TREE_H

#include "box_tree.h"
#include "core/demand.h"
#include "prim/bilinear.h"
#include "qm/bvh.h"
#include "qm/deform.h"

#define QM_PACK_LANES 8
#define QM_MAX_SCALE_RATIO 0x1p300 /* of local lengths to 1: beyond it, squares would overflow or vanish */

/* ---- the local space of a tree ---- */

/**
 * The local space of a tree: local = (world - origin) * scale. scale is a power of two, so that scaling is
 * exact and squared lengths neither overflow nor vanish; the mesh then lies within [-1, 1] along each axis.
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

/* ---- the triangles of a pack in double precision ---- */

/**
 * Components of a pack. A triangle is kept by an orthonormal frame: origin O at an end of its longest edge, X
 * along that edge, Y in the plane towards the third corner, Z = X x Y. In this frame the corners are (0, 0),
 * (L, 0) and (CX, CY). Distances computed this way are exact for a triangle within a few roundings of the
 * true one, whatever its shape; barycentric formulas lose all digits on slivers.
 */
enum {
    QM_PACK_OX,
    QM_PACK_OY,
    QM_PACK_OZ,
    QM_PACK_XX,
    QM_PACK_XY,
    QM_PACK_XZ,
    QM_PACK_YX,
    QM_PACK_YY,
    QM_PACK_YZ,
    QM_PACK_ZX,
    QM_PACK_ZY,
    QM_PACK_ZZ,
    QM_PACK_L,
    QM_PACK_CX,
    QM_PACK_CY,
    QM_PACK_INVERSE_C2, /* 1 / |(CX, CY)|^2, 0 for an edge of no length */
    QM_PACK_INVERSE_D2, /* 1 / |(CX - L, CY)|^2, 0 for an edge of no length */
    QM_PACK_COMPONENTS
};

/** Eight triangles as a structure of arrays: row[component][lane]. */
typedef struct qm_pack {
    _Alignas(64) double row[QM_PACK_COMPONENTS][QM_PACK_LANES];
} qm_pack;

/** The corners of a pack's lanes, local: at[corner][axis][lane]; lanes past the last repeat the first. */
typedef struct qm_pack_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} qm_pack_corners;

/* ---- the triangles of a pack in single precision ---- */

/** Components of a float pack: as of a pack, without those that are cheaper to recompute. */
enum {
    QM_FLOAT_PACK_OX,
    QM_FLOAT_PACK_OY,
    QM_FLOAT_PACK_OZ,
    QM_FLOAT_PACK_XX,
    QM_FLOAT_PACK_XY,
    QM_FLOAT_PACK_XZ,
    QM_FLOAT_PACK_YX,
    QM_FLOAT_PACK_YY,
    QM_FLOAT_PACK_YZ,
    QM_FLOAT_PACK_L,
    QM_FLOAT_PACK_CX,
    QM_FLOAT_PACK_CY,
    QM_FLOAT_PACK_COMPONENTS
};

/**
 * The triangles of a pack in single precision, about the center of the pack: a third of the memory of a
 * qm_pack, and eight lanes per operation where doubles take two. Most upper bounds of a search are decided
 * long before their last digits, so they are computed here, with a margin for every rounding; only cases that
 * the margin leaves open are computed in double precision.
 *
 * Margin. Let u = 2^-24, q the point relative to the center, R the radius of the pack and rho = |q| + R; all
 * intermediate lengths are at most rho.
 *   - The frame that fill_float makes in floats is orthonormal to a few u, since y is made perpendicular
 *     twice; the triangle that it stands for differs from the true one by at most 10 u rho (corners, edge,
 *     tilt: the tilt by u length / width acts on lengths up to the width only).
 *   - q - origin and its three coordinates in the frame are off by at most 14 u rho together.
 *   - The distance in the plane is one to a point of the triangle or of an edge: parameters on the edges may
 *     be off by 7 u rho, products and sums by another 10 u rho.
 *   - A point wrongly classified as inside is within 8 u rho of an edge's line, and, because the longest edge
 *     is the base, within twice that of the triangle.
 *   - A shortlist moves its lanes to another center, a line is followed by integer steps of it, and cutoff
 *     distances are squared: 5 u rho. Together less than 63 u rho; the margin is 64 u (|qx| + |qy| + |qz| +
 *     R), and tests compare it with double precision. An absolute term covers underflow.
 */
typedef struct qm_float_pack {
    float row[QM_FLOAT_PACK_COMPONENTS][QM_PACK_LANES];
    float middle[3]; /* the center, local: origin of the positions */
    float radius;    /* of the ball about the center that holds all corners */
} qm_float_pack;

/* ---- the faces of a pack ---- */

/** The faces and vertices of a pack. Lanes past lane_count repeat lane 0; searches of the source skip
 * them. */
typedef struct qm_pack_lanes {
    uint32_t face[QM_PACK_LANES];
    uint32_t vertex[3 * QM_PACK_LANES]; /* the distinct vertices of the pack, vertex_count of them */
    uint8_t corner[QM_PACK_LANES][3];   /* corners of each lane, as indices into vertex[] */
    uint8_t lane_count, vertex_count;
    uint8_t
        second; /* bit j: lane j is the second triangle (c0 c2 c3) of the quad whose first is lane j - 1 */
} qm_pack_lanes;

static inline bool qm_lane_is_second(const qm_pack_lanes *lanes, uint32_t lane)
{
    return lanes->second >> lane & 1;
}

/** True when the lane is the first triangle of a quad; the next lane is the second. */
static inline bool qm_lane_has_second(const qm_pack_lanes *lanes, uint32_t lane)
{
    return qm_lane_is_second(lanes, lane + 1);
}

/** Corners of the face that starts at a lane, as indices into vertex[]: all four of a quad when quads are
 * patches, else those of the lane alone. Returns 3 or 4; the next face starts count - 2 lanes on. */
static inline int qm_lane_corners(const qm_pack_lanes *lanes, uint32_t lane, bool patches, int corner[4])
{
    QM_ASSERT(lane < lanes->lane_count);
    for (int i = 0; i < 3; i++)
        corner[i] = lanes->corner[lane][i];
    if (!patches || !qm_lane_has_second(lanes, lane)) return 3;
    corner[3] = lanes->corner[lane + 1][2];
    return 4;
}

/** Flatness bounds: |w| / 4 of each lane's quad rounded up, local; 0 for triangles. */
typedef struct qm_pack_twists {
    float lane[QM_PACK_LANES];
} qm_pack_twists;

/* ---- the tree ---- */

struct qm_bvh {
    qm_mesh mesh; /* the arrays are borrowed */
    qm_frame frame;
    double reach; /* max local coordinate of the surface by magnitude: at most 1 */
    size_t pack_count;
    qm_pack_lanes *lanes;
    bool has_quads;
    qm_box_tree boxes; /* over the packs */
    /* Per pack, made on demand (bvh_demand.h). Without items where the tree was built without them. */
    qm_demand floats, rows; /* qm_float_pack and qm_pack: the triangles of targets in both precisions */
    bool has_all_floats;    /* all float packs are made */
    qm_demand twists;       /* qm_pack_twists: when there are quads that may be patches */
};

/** Lookup tables of a tree for moved vertices: from a vertex to its faces, from a face to its pack. */
struct qm_deformer {
    size_t vertex_count, face_count, corner_count, pack_count, pack_vertex_count;
    uint32_t *start;      /* vertex_count + 1: where the faces of each vertex begin */
    uint32_t *faces;      /* corner_count */
    uint32_t *face_pack;  /* face_count: the pack of each face, or point */
    uint32_t *pack_start; /* pack_count + 1: where the vertices of each pack begin */
    uint32_t
        *pack_vertices; /* pack_vertex_count: a dense copy of the vertices that the tree's lanes spread out */
};

/** Number of faces of a mesh, or of points of a point set. */
static inline size_t qm_bvh_facet_count(const qm_mesh *mesh)
{
    return mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
}

static inline bool qm_bvh_has_twists(const qm_bvh *bvh)
{
    return bvh->twists.items != NULL;
}

/** True when the tree was built with all that searches for nearest points need in this reading of quads. */
static inline bool qm_bvh_is_target(const qm_bvh *bvh, qm_quad_reading reading)
{
    return bvh->rows.items && (reading == QM_QUADS_TRIANGLES || qm_bvh_has_twists(bvh) || !bvh->has_quads);
}

/** A vertex, local. */
static inline qm_vec qm_bvh_vertex(const qm_bvh *bvh, uint32_t vertex)
{
    QM_ASSERT(vertex < bvh->mesh.vertex_count);
    return qm_frame_local(&bvh->frame, bvh->mesh.positions + 3 * (size_t)vertex);
}

/** Corners of the triangle of a lane, local. */
static inline void qm_bvh_load_triangle(const qm_bvh *bvh, uint32_t pack, uint32_t lane, qm_vec corner[3])
{
    QM_ASSERT(pack < bvh->pack_count && lane < QM_PACK_LANES);
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    for (int i = 0; i < 3; i++)
        corner[i] = qm_bvh_vertex(bvh, lanes->vertex[lanes->corner[lane][i]]);
}

/** Corners of a face, local; returns 3 or 4. A point is its own three corners. */
static inline int qm_bvh_load_face(const qm_bvh *bvh, uint32_t face, qm_vec corner[4])
{
    const qm_mesh *mesh = &bvh->mesh;
    QM_ASSERT(face < qm_bvh_facet_count(mesh));
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

/** The bilinear patch of a quad, local. */
static inline qm_bilinear qm_bvh_load_patch(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    qm_bvh_load_face(bvh, face, corner);
    return qm_bilinear_make(corner);
}

#endif
