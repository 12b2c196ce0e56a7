#include "near_points.h"

#include "bvh_demand.h"

typedef struct near_search {
    const qm_bvh *bvh;
    qm_vec p;
    int wanted;
    qm_near_points *out;
} near_search;

static double worst(const near_search *search)
{
    const qm_near_points *out = search->out;
    return out->count < search->wanted ? INFINITY : out->d2[out->count - 1];
}

static bool comes_before(const qm_near_points *out, int place, double d2, uint32_t index)
{
    return d2 < out->d2[place] || (d2 == out->d2[place] && index < out->index[place]);
}

/** Keeps the list sorted; it is short, so that moving its end is as quick as any heap. */
static void insert(near_search *search, double d2, uint32_t index, qm_vec position)
{
    qm_near_points *out = search->out;
    int place = out->count;
    if (place == search->wanted) {
        if (!comes_before(out, place - 1, d2, index)) return;
        place--;
    } else {
        out->count++;
    }
    for (; place > 0 && comes_before(out, place - 1, d2, index); place--) {
        out->d2[place] = out->d2[place - 1];
        out->index[place] = out->index[place - 1];
        out->position[place] = out->position[place - 1];
    }
    out->d2[place] = d2;
    out->index[place] = index;
    out->position[place] = position;
}

static void visit_pack(near_search *search, size_t pack)
{
    const qm_pack_lanes *lanes = &search->bvh->lanes[pack];
    qm_pack spare;
    const qm_pack *rows = qm_bvh_rows(search->bvh, pack, &spare);
    double d2[QM_PACK_LANES];
    for (int i = 0; i < QM_PACK_LANES; i++) {
        double x = rows->row[QM_ROW_OX][i] - search->p.x, y = rows->row[QM_ROW_OY][i] - search->p.y,
               z = rows->row[QM_ROW_OZ][i] - search->p.z;
        d2[i] = x * x + y * y + z * z;
    }
    double limit = worst(search);
    for (int i = 0; i < lanes->lane_count; i++) {
        if (d2[i] > limit) continue;
        qm_vec at = {rows->row[QM_ROW_OX][i], rows->row[QM_ROW_OY][i], rows->row[QM_ROW_OZ][i]};
        insert(search, d2[i], lanes->face[i], at);
        limit = worst(search);
    }
}

/** Squared distances from the point to the boxes of a group; boxes reach a little beyond what they hold. */
static void box_distances(const qm_box_node *group, qm_vec p, float d2[QM_PACK_LANES])
{
    const float at[3] = {(float)p.x, (float)p.y, (float)p.z};
    for (int i = 0; i < QM_PACK_LANES; i++)
        d2[i] = 0.0f;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < QM_PACK_LANES; i++) {
            float below = group->low[k][i] - at[k], above = at[k] - group->high[k][i];
            float gap = below > above ? below : above;
            gap = gap > 0.0f ? gap : 0.0f;
            d2[i] += gap * gap;
        }
    }
}

/** Members of a group, nearest box first. */
static void visit_group(near_search *search, int level, size_t group)
{
    float d2[QM_PACK_LANES];
    int order[QM_PACK_LANES], members = qm_box_tree_child_count(&search->bvh->boxes, level, group);
    box_distances(&search->bvh->boxes.groups[level][group], search->p, d2);
    for (int i = 0; i < members; i++) {
        int place = i;
        for (; place > 0 && d2[order[place - 1]] > d2[i]; place--)
            order[place] = order[place - 1];
        order[place] = i;
    }
    for (int i = 0; i < members; i++) {
        /* A float may have lost what its margin does not make up for when the point is far away. */
        if ((double)d2[order[i]] * (1.0 - 0x1p-18) > worst(search)) return;
        size_t member = 8 * group + (size_t)order[i];
        if (level > 1)
            visit_group(search, level - 1, member);
        else
            visit_pack(search, member);
    }
}

void qm_near_points_find(const qm_bvh *bvh, qm_vec p, int wanted, qm_near_points *out)
{
    near_search search = {.bvh = bvh, .p = p, .wanted = wanted, .out = out};
    out->count = 0;
    visit_group(&search, bvh->boxes.level_count, 0);
}
