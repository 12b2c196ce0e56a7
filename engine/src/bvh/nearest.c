/**
 * nearest.c: the face that a projection reports, and the nearest points of a point set.
 */
#include "nearest.h"

#include <string.h>

#include "bvh_demand.h"
#include "prim/triangle.h"

#define MIN_TOWARD 0.2 /* the cosine of 78 degrees: the normals of one wall, and not those across an edge */

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
    double reach2;        /* squared distance of the farthest points that count */
    const qm_vec *toward; /* NULL, or only points count whose normals lie within 78 degrees of it */
    qm_nearest_points *out;
} point_search;

/** The squared distance that a point must not exceed to enter the list. */
static double max_d2(const point_search *search)
{
    const qm_nearest_points *out = search->out;
    return out->count < search->wanted ? search->reach2 : out->d2[out->count - 1];
}

/** True for a point whose normal counts. */
static bool is_toward(const point_search *search, uint32_t vertex)
{
    if (!search->toward) return true;
    const float *normal = search->bvh->mesh.normals + 3 * (size_t)vertex;
    qm_vec n = {normal[0], normal[1], normal[2]};
    return qm_vec_dot(n, *search->toward) > MIN_TOWARD * qm_vec_norm(n);
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
        if (d2[i] > limit || !is_toward(search, lanes->face[i])) continue;
        qm_vec at = {pack->row[QM_PACK_OX][i], pack->row[QM_PACK_OY][i], pack->row[QM_PACK_OZ][i]};
        insert(search, d2[i], lanes->face[i], at);
        limit = max_d2(search);
    }
}

/**
 * Fraction of a squared distance of sort_children by which it may exceed that to the contents of the box. Let v = 2^-24.
 * A coordinate of p below 2 is off by 2 v, which QM_BOX_MARGIN covers. One that is larger has a gap of at least half of it:
 * v for p is 2 v of the gap, and the difference rounds by v. Squared, rounded and added: 6 v + v + 2 v < 2^-20.
 */
#define BOX_ROUNDING 0x1p-18

/**
 * Sorts the children of a node by their squared distances from a point, d2, of boxes that are a little larger than
 * their contents. Returns the number of children.
 */
static int sort_children(const qm_bvh *bvh, qm_vec p, int level, size_t node, float d2[QM_PACK_LANES],
                         int order[QM_PACK_LANES])
{
    int children = qm_box_tree_child_count(&bvh->boxes, level, node);
    const qm_box_node *boxes = &bvh->boxes.groups[level][node];
    const float at[3] = {(float)p.x, (float)p.y, (float)p.z};
    for (int i = 0; i < QM_PACK_LANES; i++)
        d2[i] = 0.0f;
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
    return children;
}

/** Visits the children of a node, nearest box first. */
static void visit_node(point_search *search, int level, size_t node)
{
    int order[QM_PACK_LANES];
    float d2[QM_PACK_LANES];
    int children = sort_children(search->bvh, search->p, level, node, d2, order);
    for (int i = 0; i < children; i++) {
        if ((double)d2[order[i]] * (1.0 - BOX_ROUNDING) > max_d2(search)) return;
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
    point_search search = {.bvh = bvh, .p = p, .wanted = wanted, .reach2 = INFINITY, .out = out};
    out->count = 0;
    visit_node(&search, bvh->boxes.level_count, 0);
}

void qm_nearest_points_find_toward(const qm_bvh *bvh, qm_vec p, int wanted, qm_vec toward, double reach,
                                   qm_nearest_points *out)
{
    QM_ASSERT(wanted >= 1 && wanted <= QM_NEAREST_POINTS_MAX && bvh->mesh.face_count == 0 &&
              bvh->mesh.normals);
    point_search search = {
        .bvh = bvh, .p = p, .wanted = wanted, .reach2 = reach * reach, .toward = &toward, .out = out};
    out->count = 0;
    visit_node(&search, bvh->boxes.level_count, 0);
}

/* ---- the nearest point of a mesh's faces that look one way ---- */

typedef struct facing_search {
    const qm_bvh *bvh;
    qm_vec p, toward;
    double best2;
    qm_facing_point *out;
} facing_search;

static void visit_facing_pack(facing_search *search, size_t index)
{
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    for (uint32_t i = 0; i < lanes->lane_count; i++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(search->bvh, (uint32_t)index, i, corner);
        qm_vec normal = qm_vec_cross(qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]));
        if (!(qm_vec_dot(normal, search->toward) > 0.0)) continue;
        qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
        double d2 = qm_triangle_distance2(&triangle, search->p), weight[3];
        if (d2 >= search->best2) continue;
        qm_triangle_footpoint(&triangle, search->p, weight);
        search->best2 = d2;
        search->out->position = qm_triangle_at(corner, weight);
        search->out->normal = qm_vec_scale(1.0 / qm_vec_norm(normal), normal);
    }
}

static void visit_facing_node(facing_search *search, int level, size_t node)
{
    int order[QM_PACK_LANES];
    float d2[QM_PACK_LANES];
    int children = sort_children(search->bvh, search->p, level, node, d2, order);
    for (int i = 0; i < children; i++) {
        if ((double)d2[order[i]] * (1.0 - BOX_ROUNDING) > search->best2) return;
        size_t child = 8 * node + (size_t)order[i];
        if (level > 1)
            visit_facing_node(search, level - 1, child);
        else
            visit_facing_pack(search, child);
    }
}

bool qm_nearest_facing(const qm_bvh *bvh, qm_vec p, qm_vec toward, double reach, qm_facing_point *out)
{
    QM_ASSERT(bvh->mesh.face_count > 0);
    facing_search search = {.bvh = bvh, .p = p, .toward = toward, .best2 = reach * reach, .out = out};
    visit_facing_node(&search, bvh->boxes.level_count, 0);
    return search.best2 < reach * reach;
}

/* ---- the triangles of a mesh near a point ---- */

typedef struct near_search {
    const qm_bvh *bvh;
    qm_vec p;
    double reach2;
    qm_vec (*out)[3];
    size_t count, capacity;
} near_search;

static void visit_near_pack(near_search *search, size_t index)
{
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    for (uint32_t i = 0; i < lanes->lane_count && search->count <= search->capacity; i++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(search->bvh, (uint32_t)index, i, corner);
        qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
        if (qm_triangle_distance2(&triangle, search->p) > search->reach2) continue;
        if (search->count < search->capacity) memcpy(search->out[search->count], corner, sizeof corner);
        search->count++;
    }
}

static void visit_near_node(near_search *search, int level, size_t node)
{
    int order[QM_PACK_LANES];
    float d2[QM_PACK_LANES];
    int children = sort_children(search->bvh, search->p, level, node, d2, order);
    for (int i = 0; i < children; i++) {
        if ((double)d2[order[i]] * (1.0 - BOX_ROUNDING) > search->reach2) return;
        size_t child = 8 * node + (size_t)order[i];
        if (level > 1)
            visit_near_node(search, level - 1, child);
        else
            visit_near_pack(search, child);
    }
}

size_t qm_near_triangles(const qm_bvh *bvh, qm_vec p, double reach, qm_vec (*out)[3], size_t capacity)
{
    QM_ASSERT(bvh->mesh.face_count > 0);
    near_search search = {.bvh = bvh, .p = p, .reach2 = reach * reach, .out = out, .capacity = capacity};
    visit_near_node(&search, bvh->boxes.level_count, 0);
    return search.count;
}
