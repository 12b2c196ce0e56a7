/**
 * nearest.c: the face that a projection reports, and the nearest points of a point set.
 */
#include "nearest.h"

#include "bvh_demand.h"

/* ---- the nearest face ---- */

/** The lowest face within reach, with the min distance of all. */
static qm_tie find_lowest(const qm_ties *ties)
{
    qm_tie lowest = {.face = QM_NO_INDEX};
    double min = INFINITY;
    for (int i = 0; i < ties->count; i++) {
        const qm_tie *tie = &ties->tie[i];
        min = qm_min(min, tie->distance);
        if (tie->distance <= ties->reach && tie->face < lowest.face) lowest = *tie;
    }
    lowest.distance = min;
    return lowest;
}

qm_tie qm_nearest_face(const qm_kernel *kernel, const qm_locator *locator, qm_quad_reading reading, qm_vec p,
                       uint32_t *hint)
{
    bool has_patches = reading == QM_QUADS_BILINEAR && qm_bvh_has_twists(locator->bvh);
    qm_ties ties;
    double rounding = qm_distance_rounding(p);
    ties.error = has_patches ? qm_bilinear_error(p) : 0.0;
    ties.tau = 2.0 * ties.error + QM_TIE_ROUNDING * (1.0 + qm_max_coordinate(p));
    ties.margin = 2.0 * rounding; /* that of the bound and that of the distance */
    ties.min = ties.reach = ties.reach2 = INFINITY;
    ties.is_min_known = ties.is_overfull = false;
    ties.count = 0;
    if (has_patches) {
        qm_hit hit = {.d2 = INFINITY, .pack = *hint};
        qm_nearest_triangle(kernel, locator, p, &hit);
        *hint = hit.pack;
    }
    qm_nearest_ties(kernel, locator, p, *hint, &ties);
    if (ties.is_overfull) {
        ties.is_min_known = true;
        ties.count = 0;
        qm_nearest_ties(kernel, locator, p, *hint, &ties);
    }
    qm_tie lowest = find_lowest(&ties);
    *hint = lowest.pack;
    return lowest;
}

/* ---- the nearest points of a point set ---- */

typedef struct point_search {
    const qm_bvh *bvh;
    qm_vec p;
    int wanted;
    qm_nearest_points *out;
} point_search;

/** The squared distance that a point must not exceed to enter the list. */
static double max_d2(const point_search *search)
{
    const qm_nearest_points *out = search->out;
    return out->count < search->wanted ? INFINITY : out->d2[out->count - 1];
}

static bool comes_before(const qm_nearest_points *out, int i, double d2, uint32_t index)
{
    return d2 < out->d2[i] || (d2 == out->d2[i] && index < out->index[i]);
}

/** Keeps the list sorted; it is so short that moving its tail is as fast as a heap. */
static void insert(point_search *search, double d2, uint32_t index, qm_vec position)
{
    qm_nearest_points *out = search->out;
    int i = out->count;
    if (i == search->wanted) {
        if (!comes_before(out, i - 1, d2, index)) return;
        i--;
    } else {
        out->count++;
    }
    for (; i > 0 && comes_before(out, i - 1, d2, index); i--) {
        out->d2[i] = out->d2[i - 1];
        out->index[i] = out->index[i - 1];
        out->position[i] = out->position[i - 1];
    }
    out->d2[i] = d2;
    out->index[i] = index;
    out->position[i] = position;
}

static void visit_pack(point_search *search, size_t index)
{
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    qm_pack spare;
    const qm_pack *pack = qm_bvh_pack(search->bvh, index, &spare);
    double d2[QM_PACK_LANES];
    for (int i = 0; i < QM_PACK_LANES; i++) {
        double x = pack->row[QM_PACK_OX][i] - search->p.x, y = pack->row[QM_PACK_OY][i] - search->p.y,
               z = pack->row[QM_PACK_OZ][i] - search->p.z;
        d2[i] = x * x + y * y + z * z;
    }
    double limit = max_d2(search);
    for (int i = 0; i < lanes->lane_count; i++) {
        if (d2[i] > limit) continue;
        qm_vec at = {pack->row[QM_PACK_OX][i], pack->row[QM_PACK_OY][i], pack->row[QM_PACK_OZ][i]};
        insert(search, d2[i], lanes->face[i], at);
        limit = max_d2(search);
    }
}

/** Visits the children of a node, nearest box first. */
static void visit_node(point_search *search, int level, size_t node)
{
    int order[QM_PACK_LANES], children = qm_box_tree_child_count(&search->bvh->boxes, level, node);
    /* Squared distances from the point to the boxes, which are a little larger than their contents. */
    const qm_box_node *boxes = &search->bvh->boxes.groups[level][node];
    const float at[3] = {(float)search->p.x, (float)search->p.y, (float)search->p.z};
    float d2[QM_PACK_LANES] = {0};
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < QM_PACK_LANES; i++) {
            float below = boxes->low[k][i] - at[k], above = at[k] - boxes->high[k][i];
            float gap = below > above ? below : above;
            gap = gap > 0.0f ? gap : 0.0f;
            d2[i] += gap * gap;
        }
    }
    for (int i = 0; i < children; i++) {
        int slot = i;
        for (; slot > 0 && d2[order[slot - 1]] > d2[i]; slot--)
            order[slot] = order[slot - 1];
        order[slot] = i;
    }
    for (int i = 0; i < children; i++) {
        /* When the point is far away, a float may lose more than the margin of the boxes makes up for. */
        if ((double)d2[order[i]] * (1.0 - 0x1p-18) > max_d2(search)) return;
        size_t child = 8 * node + (size_t)order[i];
        if (level > 1)
            visit_node(search, level - 1, child);
        else
            visit_pack(search, child);
    }
}

void qm_nearest_points_find(const qm_bvh *bvh, qm_vec p, int wanted, qm_nearest_points *out)
{
    QM_ASSERT(wanted >= 1 && wanted <= QM_NEAREST_POINTS_MAX && bvh->mesh.face_count == 0);
    point_search search = {.bvh = bvh, .p = p, .wanted = wanted, .out = out};
    out->count = 0;
    visit_node(&search, bvh->boxes.level_count, 0);
}
