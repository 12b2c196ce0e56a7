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

/* ---- a visit of the parts near a point ---- */

typedef struct near_search near_search;

/** Looks at the parts of a pack, and may lower the search's reach2. */
typedef void visit_pack(near_search *search, size_t pack);

struct near_search {
    const qm_bvh *bvh;
    qm_vec p;
    double reach2; /* the squared distance above which no part counts */
    visit_pack *visit;
    void *out; /* the visit's own */
};

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

/** Visits the packs below a node within reach, the nearest box first. */
static void visit_node(near_search *search, int level, size_t node)
{
    int order[QM_PACK_LANES];
    float d2[QM_PACK_LANES];
    int children = sort_children(search->bvh, search->p, level, node, d2, order);
    for (int i = 0; i < children; i++) {
        if ((double)d2[order[i]] * (1.0 - BOX_ROUNDING) > search->reach2) return;
        size_t child = 8 * node + (size_t)order[i];
        if (level > 1)
            visit_node(search, level - 1, child);
        else
            search->visit(search, child);
    }
}

/** Visits the packs within a reach of a point. Returns the squared reach at the end. */
static double visit_near(const qm_bvh *bvh, qm_vec p, double reach2, visit_pack *visit, void *out)
{
    near_search search = {.bvh = bvh, .p = p, .reach2 = reach2, .visit = visit, .out = out};
    visit_node(&search, bvh->boxes.level_count, 0);
    return search.reach2;
}

/* ---- the nearest points of a point set ---- */

typedef struct point_list {
    int wanted;
    const qm_vec *toward; /* NULL, or only points count whose normals lie within 78 degrees of it */
    qm_nearest_points *found;
} point_list;

/** True for a point whose normal counts. */
static bool is_toward(const qm_bvh *bvh, const qm_vec *toward, uint32_t vertex)
{
    if (!toward) return true;
    const float *normal = bvh->mesh.normals + 3 * (size_t)vertex;
    qm_vec n = {normal[0], normal[1], normal[2]};
    return qm_vec_dot(n, *toward) > MIN_TOWARD * qm_vec_norm(n);
}

static bool comes_before(const qm_nearest_points *out, int i, double d2, uint32_t index)
{
    return d2 < out->d2[i] || (d2 == out->d2[i] && index < out->index[i]);
}

/** Keeps the list sorted; it is so short that moving its tail is as fast as a heap. */
static void insert(const point_list *list, double d2, uint32_t index, qm_vec position)
{
    qm_nearest_points *out = list->found;
    int i = out->count;
    if (i == list->wanted) {
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

static void visit_points(near_search *search, size_t index)
{
    const point_list *list = search->out;
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    qm_pack spare;
    const qm_pack *pack = qm_bvh_pack(search->bvh, index, &spare);
    double d2[QM_PACK_LANES];
    for (int i = 0; i < QM_PACK_LANES; i++) {
        double x = pack->row[QM_PACK_OX][i] - search->p.x, y = pack->row[QM_PACK_OY][i] - search->p.y,
               z = pack->row[QM_PACK_OZ][i] - search->p.z;
        d2[i] = x * x + y * y + z * z;
    }
    for (int i = 0; i < lanes->lane_count; i++) {
        if (d2[i] > search->reach2 || !is_toward(search->bvh, list->toward, lanes->face[i])) continue;
        qm_vec at = {pack->row[QM_PACK_OX][i], pack->row[QM_PACK_OY][i], pack->row[QM_PACK_OZ][i]};
        insert(list, d2[i], lanes->face[i], at);
        if (list->found->count == list->wanted) search->reach2 = list->found->d2[list->wanted - 1];
    }
}

void qm_nearest_points_find(const qm_bvh *bvh, qm_vec p, int wanted, qm_nearest_points *out)
{
    QM_ASSERT(wanted >= 1 && wanted <= QM_NEAREST_POINTS_MAX && bvh->mesh.face_count == 0);
    point_list list = {.wanted = wanted, .found = out};
    out->count = 0;
    visit_near(bvh, p, INFINITY, visit_points, &list);
}

void qm_nearest_points_find_toward(const qm_bvh *bvh, qm_vec p, int wanted, qm_vec toward, double reach,
                                   qm_nearest_points *out)
{
    QM_ASSERT(wanted >= 1 && wanted <= QM_NEAREST_POINTS_MAX && bvh->mesh.face_count == 0 &&
              bvh->mesh.normals);
    point_list list = {.wanted = wanted, .toward = &toward, .found = out};
    out->count = 0;
    visit_near(bvh, p, reach * reach, visit_points, &list);
}

/* ---- the nearest point of a mesh's faces that look one way ---- */

typedef struct facing_list {
    qm_vec toward;
    qm_facing_point *nearest;
} facing_list;

static void visit_facing(near_search *search, size_t index)
{
    const facing_list *list = search->out;
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    for (uint32_t i = 0; i < lanes->lane_count; i++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(search->bvh, (uint32_t)index, i, corner);
        qm_vec normal = qm_vec_cross(qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]));
        if (!(qm_vec_dot(normal, list->toward) > 0.0)) continue;
        qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
        double d2 = qm_triangle_distance2(&triangle, search->p), weight[3];
        if (d2 >= search->reach2) continue;
        qm_triangle_footpoint(&triangle, search->p, weight);
        search->reach2 = d2;
        list->nearest->position = qm_triangle_at(corner, weight);
        list->nearest->normal = qm_vec_scale(1.0 / qm_vec_norm(normal), normal);
    }
}

bool qm_nearest_facing(const qm_bvh *bvh, qm_vec p, qm_vec toward, double reach, qm_facing_point *out)
{
    QM_ASSERT(bvh->mesh.face_count > 0);
    facing_list list = {.toward = toward, .nearest = out};
    return visit_near(bvh, p, reach * reach, visit_facing, &list) < reach * reach;
}

/* ---- the triangles of a mesh near a point ---- */

typedef struct triangle_list {
    qm_vec (*corner)[3];
    size_t count, capacity;
} triangle_list;

static void visit_triangles(near_search *search, size_t index)
{
    triangle_list *list = search->out;
    const qm_pack_lanes *lanes = &search->bvh->lanes[index];
    for (uint32_t i = 0; i < lanes->lane_count && list->count <= list->capacity; i++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(search->bvh, (uint32_t)index, i, corner);
        qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
        if (qm_triangle_distance2(&triangle, search->p) > search->reach2) continue;
        if (list->count < list->capacity) memcpy(list->corner[list->count], corner, sizeof corner);
        list->count++;
    }
}

size_t qm_near_triangles(const qm_bvh *bvh, qm_vec p, double reach, qm_vec (*out)[3], size_t capacity)
{
    QM_ASSERT(bvh->mesh.face_count > 0);
    triangle_list list = {.corner = out, .capacity = capacity};
    visit_near(bvh, p, reach * reach, visit_triangles, &list);
    return list.count;
}
