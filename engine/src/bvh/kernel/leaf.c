/**
 * leaf.c: leaves of the collision search from packs and where their vertices are.
 */
#include <string.h>

#include "bvh/collide_leaf.h"
#include "four.h"
#include "kernels.h"
#include "wide.h"

#define MIDDLE_ROUNDING 0x1p-50 /* of a coordinate in the frame of the search, relative */
#define LARGEST_REACH 1e8f      /* larger leaves are left to exact tests: products might overflow */

/** The same for equal positions, and hardly ever for others. (0 and -0 differ, so that such corners take the
 * long way.) */
static inline uint32_t mix_position(const double *position)
{
    uint64_t x[3];
    memcpy(x, position, sizeof x);
    uint64_t mixed = (x[0] * 3 + x[1]) * 5 + x[2];
    mixed *= UINT64_C(0x9e3779b97f4a7c15);
    return (uint32_t)(mixed >> 32);
}

/** Any point in the midst of a leaf serves as its middle: the first vertex is at hand. */
static inline void load_vertices(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind,
                                 const qm_pack_lanes *lanes, qm_leaf *leaf)
{
    typedef uint32_t four_words __attribute__((vector_size(16)));
    const double *positions = bvh->mesh.positions;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    qm_four middle = (qm_four_position(positions + 3 * (size_t)lanes->vertex[0]) - origin) * frame->scale;
    leaf->middle = (qm_vec){middle[0], middle[1], middle[2]};
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = positions + 3 * (size_t)lanes->vertex[i];
        uint32_t mark = kind == QM_COLLIDE_TWO ? mix_position(position) : lanes->vertex[i];
        qm_four from_middle = (qm_four_position(position) - origin) * frame->scale - middle;
        four_words row = (four_words)qm_four_round(from_middle);
        row[3] = mark; /* in one piece: reading what was stored in two would wait for both */
        memcpy(leaf->vertex[i], &row, sizeof row);
    }
}

/** The boxes of the lanes and of all; returns the greatest coordinate by magnitude. */
static inline float set_boxes(qm_leaf *leaf, qm_vf *size)
{
    float reach = 0.0f;
    *size = (qm_vf){0};
    for (int k = 0; k < 3; k++) {
        qm_vf x = wide_row(leaf->corner[0][k]), y = wide_row(leaf->corner[1][k]),
              z = wide_row(leaf->corner[2][k]);
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

static inline void set_plane(qm_leaf *leaf, int plane, wide normal, wide point)
{
    wide_store_row(leaf->plane[plane][0], normal.x);
    wide_store_row(leaf->plane[plane][1], normal.y);
    wide_store_row(leaf->plane[plane][2], normal.z);
    wide_store_row(leaf->plane[plane][3], wide_dot(normal, point));
}

/** Rows of a corner from the vertices of the lanes. */
static inline void set_corner(qm_leaf *leaf, int corner)
{
    qm_vf two[4], column[4];
    for (int i = 0; i < 4; i++)
        two[i] = wide_join(leaf->vertex[leaf->place[i][corner]], leaf->vertex[leaf->place[i + 4][corner]]);
    wide_transpose(two, column);
    for (int k = 0; k < 3; k++)
        wide_store_row(leaf->corner[corner][k], column[k]);
    memcpy(leaf->mark[corner], &column[3], sizeof column[3]);
}

static inline void set_planes(qm_leaf *leaf)
{
    wide c[3] = {wide_load(leaf->corner[0]), wide_load(leaf->corner[1]), wide_load(leaf->corner[2])};
    wide edge[3] = {wide_sub(c[1], c[0]), wide_sub(c[2], c[1]), wide_sub(c[0], c[2])};
    wide normal = wide_cross(edge[1], edge[2]);
    set_plane(leaf, 0, normal, c[0]);
    for (int i = 0; i < 3; i++)
        set_plane(leaf, 1 + i, wide_cross(edge[i], normal), c[i]);
}

void QM_KERNEL(fill_leaf)(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack,
                          qm_leaf *leaf)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    load_vertices(bvh, frame, kind, lanes, leaf);
    memcpy(leaf->place, lanes->corner, sizeof leaf->place);
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        memcpy(leaf->place[lane], leaf->place[0], sizeof leaf->place[0]);
    for (int i = 0; i < 3; i++)
        set_corner(leaf, i);
    leaf->pack = pack;
    leaf->lane_count = lanes->lane_count;
    if (kind != QM_COLLIDE_TWO) set_planes(leaf);
    qm_vf size;
    leaf->reach = set_boxes(leaf, &size);
    double x = fabs(leaf->middle.x), y = fabs(leaf->middle.y), z = fabs(leaf->middle.z);
    double middle = x > y ? x : y;
    middle = z > middle ? z : middle;
    leaf->error = leaf->reach * QM_LEAF_ROUNDING + (float)(middle * MIDDLE_ROUNDING) + QM_LEAF_UNDERFLOW;
    if (!(leaf->reach < LARGEST_REACH)) leaf->error = INFINITY;
    wide_store_row(leaf->size, size + 4.0f * leaf->error);
}
