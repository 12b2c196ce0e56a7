/**
 * leaf.c: prepares packs for pair tests, from the current positions of their vertices.
 */
#include <string.h>

#include "bvh/node_pairs.h"
#include "four.h"
#include "kernels.h"
#include "wide.h"

#define CENTER_ROUNDING 0x1p-50 /* of a coordinate in the frame of the search, relative */
#define MAX_REACH 1e8f          /* larger packs are left to exact tests: products might overflow */

/** A hash of a position. (0 and -0 have different hashes; exact tests decide such corners.) */
static inline uint32_t hash_position(const double *position)
{
    uint64_t x[3];
    memcpy(x, position, sizeof x);
    uint64_t hash = (x[0] * 3 + x[1]) * 5 + x[2];
    hash *= UINT64_C(0x9e3779b97f4a7c15);
    return (uint32_t)(hash >> 32);
}

/** Loads the vertices relative to a center, for which any point of the pack serves: the first vertex. */
static inline void load_vertices(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind,
                                 const qm_pack_lanes *lanes, qm_collide_leaf *leaf)
{
    typedef uint32_t four_words __attribute__((vector_size(16)));
    const double *positions = bvh->mesh.positions;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    qm_four center = (qm_four_position(positions + 3 * (size_t)lanes->vertex[0]) - origin) * frame->scale;
    leaf->center = (qm_vec){center[0], center[1], center[2]};
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = positions + 3 * (size_t)lanes->vertex[i];
        uint32_t mark = kind == QM_COLLIDE_TWO ? hash_position(position) : lanes->vertex[i];
        qm_four from_center = (qm_four_position(position) - origin) * frame->scale - center;
        four_words row = (four_words)qm_four_round(from_center);
        row[3] = mark; /* stored whole: a load of what two stores wrote would wait for both */
        memcpy(leaf->vertex[i], &row, sizeof row);
    }
}

/** Sets the boxes of the lanes and of the pack; returns the max coordinate by magnitude. */
static inline float set_boxes(qm_collide_leaf *leaf, qm_vf *size)
{
    float reach = 0.0f;
    *size = (qm_vf){0};
    for (int k = 0; k < 3; k++) {
        qm_vf x = wide_load_row(leaf->corner[0][k]), y = wide_load_row(leaf->corner[1][k]),
              z = wide_load_row(leaf->corner[2][k]);
        qm_vf low = qm_vf_min(x, qm_vf_min(y, z)), high = qm_vf_max(x, qm_vf_max(y, z));
        wide_store_row(leaf->low[k], low);
        wide_store_row(leaf->high[k], high);
        *size = qm_vf_max(*size, high - low);
        leaf->box_low[k] = -qm_vf_max_lane(-low);
        leaf->box_high[k] = qm_vf_max_lane(high);
        float far = -leaf->box_low[k] > leaf->box_high[k] ? -leaf->box_low[k] : leaf->box_high[k];
        reach = far > reach ? far : reach;
    }
    return reach;
}

static inline void set_plane(qm_collide_leaf *leaf, int plane, wide normal, wide point)
{
    wide_store_row(leaf->plane[plane][0], normal.x);
    wide_store_row(leaf->plane[plane][1], normal.y);
    wide_store_row(leaf->plane[plane][2], normal.z);
    wide_store_row(leaf->plane[plane][3], wide_dot(normal, point));
}

/** Transposes one corner of all lanes from rows of vertices to components. */
static inline void set_corner(qm_collide_leaf *leaf, int corner)
{
    qm_vf two[4], column[4];
    for (int i = 0; i < 4; i++)
        two[i] = wide_join(leaf->vertex[leaf->corner_vertex[i][corner]],
                           leaf->vertex[leaf->corner_vertex[i + 4][corner]]);
    wide_transpose(two, column);
    for (int k = 0; k < 3; k++)
        wide_store_row(leaf->corner[corner][k], column[k]);
    memcpy(leaf->mark[corner], &column[3], sizeof column[3]);
}

static inline void set_planes(qm_collide_leaf *leaf)
{
    wide c[3] = {wide_load(leaf->corner[0]), wide_load(leaf->corner[1]), wide_load(leaf->corner[2])};
    wide edge[3] = {wide_sub(c[1], c[0]), wide_sub(c[2], c[1]), wide_sub(c[0], c[2])};
    wide normal = wide_cross(edge[1], edge[2]);
    set_plane(leaf, 0, normal, c[0]);
    for (int i = 0; i < 3; i++)
        set_plane(leaf, 1 + i, wide_cross(edge[i], normal), c[i]);
}

void QM_KERNEL(fill_leaf)(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack,
                          qm_collide_leaf *leaf)
{
    QM_ASSERT(pack < bvh->pack_count);
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    load_vertices(bvh, frame, kind, lanes, leaf);
    memcpy(leaf->corner_vertex, lanes->corner, sizeof leaf->corner_vertex);
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        memcpy(leaf->corner_vertex[lane], leaf->corner_vertex[0], sizeof leaf->corner_vertex[0]);
    for (int i = 0; i < 3; i++)
        set_corner(leaf, i);
    QM_ASSERT(lanes->lane_count >= 1 && lanes->lane_count <= QM_PACK_LANES);
    leaf->pack = pack;
    leaf->lane_count = lanes->lane_count;
    if (kind != QM_COLLIDE_TWO) set_planes(leaf);
    qm_vf size;
    leaf->reach = set_boxes(leaf, &size);
    double x = fabs(leaf->center.x), y = fabs(leaf->center.y), z = fabs(leaf->center.z);
    double center = x > y ? x : y;
    center = z > center ? z : center;
    leaf->error = leaf->reach * QM_LEAF_ROUNDING + (float)(center * CENTER_ROUNDING) + QM_LEAF_UNDERFLOW;
    if (!(leaf->reach < MAX_REACH)) leaf->error = INFINITY;
    wide_store_row(leaf->size, size + 4.0f * leaf->error);
}
