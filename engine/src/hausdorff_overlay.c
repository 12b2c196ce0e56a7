/**
 * hausdorff_overlay.c: faces of the source over a stretch of the target are bounded by the vertical distance,
 * along one direction for all of them: a coarse face may lie over dozens of facets, none of which alone is
 * near to all of it.
 *
 * Everything is projected along a direction to a plane. If every point of a face has a facet over it, then no
 * point is farther from the target than the greatest vertical distance between the face and any facet, where
 * one lies over the other; that is found facet by facet (kernel/overlay.c).
 *
 * That every point of a face has a facet over it is shown as follows. Take any set of facets, and those edges
 * that an odd number of them has, by the indices of their vertices: the boundary of the set, modulo 2. Where
 * no edge of the boundary lies over the inside of a face, the number of facets over a place is odd
 * everywhere in the face or even everywhere, but for places on edges: crossing any other edge changes it by
 * an even number (the degree of a map modulo 2 is constant off the image of the boundary: Guillemin, Pollack,
 * Differential Topology, 1974, chapter 2). So an odd number over one place shows it for all, the places on
 * edges being limits of others. Meshes may be open, non-manifold, or fold back over themselves.
 *
 * Facets that lie higher or lower than all faces by more than the allowed distance are left out, and so are
 * those beside all faces: what is left is any set. Which plane is taken, and what is left out, decides how
 * often this works, never whether it holds.
 *
 * Roundings, s being the greatest coordinate of the facets and the faces in the plane's frame, by magnitude.
 * Mapping a vertex to the frame takes 1 u |d| for d = vertex - origin, 6 u |d| for the coordinates and 14 u
 * |d| for a frame that is not quite orthonormal: less than the 142 u R that rounding.h has for the distance
 * to a triangle, which is not computed here. A vertex has one place in the frame, whichever facet it is
 * reached from. Below, faces and facets are those of the mapped vertices, exactly.
 *   - A half plane (a, b, c) of a face with a, b divided by the edge's length is off by 12 u s at the edge's
 *     second end and by 6 u s at the first, and its value at a vertex of a facet by 9 u s: together less than
 *     QM_OVERLAY_SIDE u s.
 *   - A doubled area of three points is a difference of two products of differences, at most 2 s each: off by
 *     4 u 4 s^2 twice and 8 u s^2, less than QM_OVERLAY_AREA u s^2.
 *   - The slopes of a face's plane come from two such areas over a third; they are off by 128 u s length /
 *     area, and heights by twice s times that and some u s. Faces steeper than MAX_SLOPE are not looked at.
 *     That and a few u of gaps, of 16 s at most, make QM_OVERLAY_GAP.
 */
#include "hausdorff_overlay.h"

#include <string.h>

#define MAX_SLOPE 2.0
#define EDGE_PLACES 1024 /* of the table of edges, a power of two */
#define MAX_RIM 128      /* edges of the boundary over the faces' rectangle */
#define MAX_FACETS (QM_OVERLAY_GROUPS * QM_PACK_LANES)

_Static_assert(3 * MAX_FACETS < EDGE_PLACES, "the table of edges has room");

/** An edge of a facet: its vertices, and where they are. */
typedef struct edge {
    uint32_t vertex[2]; /* the lower first */
    double end[2][2];
    bool is_odd; /* an odd number of facets has it */
} edge;

typedef struct overlay_work {
    const qm_side *side;
    qm_vec origin, axis[3]; /* of the frame: the last is upright */
    double low[3], high[3]; /* of the faces; heights with what is allowed */
    double size;
    qm_overlay_face face[QM_OVERLAY_FACES];
    qm_overlay_facets facets;
    int edge_count;
    int16_t place[EDGE_PLACES]; /* of an edge, plus 1; 0 for none */
    edge edges[3 * MAX_FACETS];
    int rim_count;
    const edge *rim[MAX_RIM];
} overlay_work;

static inline void map_point(const overlay_work *work, qm_vec p, double out[3])
{
    qm_vec d = qm_vec_sub(p, work->origin);
    for (int k = 0; k < 3; k++)
        out[k] = qm_vec_dot(d, work->axis[k]);
}

/** False when the faces have no direction in common. */
static bool set_frame(overlay_work *work, const qm_overlay_source *source)
{
    qm_vec normal = {0, 0, 0};
    for (int i = 0; i < source->count; i++) {
        const qm_vec *c = source->corner[i];
        normal = qm_vec_add(normal, qm_vec_cross(qm_vec_sub(c[1], c[0]), qm_vec_sub(c[2], c[0])));
    }
    double length = qm_vec_norm(normal);
    if (!(length > 0.0)) return false;
    work->origin = source->corner[0][0];
    qm_vec z = qm_vec_scale(1.0 / length, normal);
    double x = fabs(z.x), y = fabs(z.y);
    qm_vec other = x < y ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    qm_vec across = qm_vec_cross(other, z);
    work->axis[0] = qm_vec_scale(1.0 / qm_vec_norm(across), across);
    work->axis[1] = qm_vec_cross(z, work->axis[0]);
    work->axis[2] = z;
    return true;
}

static void map_faces(overlay_work *work, const qm_overlay_source *source, double allowed)
{
    work->size = 0.0;
    for (int k = 0; k < 3; k++) {
        work->low[k] = INFINITY;
        work->high[k] = -INFINITY;
    }
    for (int i = 0; i < source->count; i++) {
        for (int c = 0; c < 3; c++) {
            double *at = work->face[i].corner[c];
            map_point(work, source->corner[i][c], at);
            for (int k = 0; k < 3; k++) {
                work->low[k] = qm_lesser(at[k], work->low[k]);
                work->high[k] = qm_greater(at[k], work->high[k]);
                work->size = qm_greater(fabs(at[k]), work->size);
            }
        }
    }
    work->low[2] -= allowed;
    work->high[2] += allowed;
}

double qm_overlay_set_face(qm_overlay_face *face, double size)
{
    static const double probe_weight[3] = {0.4327, 0.3391, 0.2282}; /* on no line that meshes are cut along */
    double(*c)[3] = face->corner;
    double dx[2] = {c[1][0] - c[0][0], c[2][0] - c[0][0]}, dy[2] = {c[1][1] - c[0][1], c[2][1] - c[0][1]};
    double dz[2] = {c[1][2] - c[0][2], c[2][2] - c[0][2]};
    double area = dx[0] * dy[1] - dx[1] * dy[0], turn = area < 0.0 ? -1.0 : 1.0, longest = 0.0;
    for (int k = 0; k < 3; k++) {
        const double *a = c[k], *b = c[(k + 1) % 3];
        double x = b[0] - a[0], y = b[1] - a[1], length = sqrt(x * x + y * y);
        if (!(length > 0.0)) return INFINITY;
        longest = qm_greater(length, longest);
        face->side[k][0] = -turn * y / length;
        face->side[k][1] = turn * x / length;
        face->side[k][2] = -(face->side[k][0] * a[0] + face->side[k][1] * a[1]);
    }
    /* A thinner face would leave it open whether the probe is inside. */
    if (!(fabs(area) > QM_OVERLAY_GAP * QM_UNIT_ROUNDING * size * longest)) return INFINITY;
    double slope_x = (dz[0] * dy[1] - dz[1] * dy[0]) / area, slope_y = (dx[0] * dz[1] - dx[1] * dz[0]) / area;
    if (!(fabs(slope_x) + fabs(slope_y) <= MAX_SLOPE)) return INFINITY;
    face->plane[0] = slope_x;
    face->plane[1] = slope_y;
    face->plane[2] = c[0][2] - (slope_x * c[0][0] + slope_y * c[0][1]);
    for (int k = 0; k < 2; k++)
        face->probe[k] = probe_weight[0] * c[0][k] + probe_weight[1] * c[1][k] + probe_weight[2] * c[2][k];
    return QM_OVERLAY_GAP * QM_UNIT_ROUNDING * (1.0 + size * longest / fabs(area));
}

static void toggle_edge(overlay_work *work, uint32_t a, uint32_t b, const double *at_a, const double *at_b)
{
    if (a > b) {
        uint32_t vertex = a;
        const double *at = at_a;
        a = b;
        at_a = at_b;
        b = vertex;
        at_b = at;
    }
    uint32_t hash = (a * UINT32_C(0x9e3779b1)) ^ (b * UINT32_C(0x85ebca6b));
    for (uint32_t i = hash >> 22;; i = (i + 1) % EDGE_PLACES) {
        if (work->place[i] == 0) {
            edge *new = &work->edges[work->edge_count++];
            *new = (edge){{a, b}, {{at_a[0], at_a[1]}, {at_b[0], at_b[1]}}, true};
            work->place[i] = (int16_t)work->edge_count;
            return;
        }
        edge *known = &work->edges[work->place[i] - 1];
        if (known->vertex[0] != a || known->vertex[1] != b) continue;
        known->is_odd = !known->is_odd;
        return;
    }
}

/** Whether a box of points meets that of the faces, along so many axes. */
static inline bool meets_faces(const overlay_work *work, const double *const *at, int count, int axes)
{
    for (int k = 0; k < axes; k++) {
        double low = at[0][k], high = at[0][k];
        for (int i = 1; i < count; i++) {
            low = qm_lesser(at[i][k], low);
            high = qm_greater(at[i][k], high);
        }
        if (low > work->high[k] || high < work->low[k]) return false;
    }
    return true;
}

/** Adds the facets of a pack that lie over the faces; false when there is no room. */
static bool add_pack(overlay_work *work, uint32_t pack)
{
    const qm_bvh *target = work->side->target;
    const qm_pack_lanes *lanes = &target->lanes[pack];
    double vertex[3 * QM_PACK_LANES][3];
    for (int i = 0; i < lanes->vertex_count; i++)
        map_point(work, qm_bvh_vertex(target, lanes->vertex[i]), vertex[i]);
    for (uint32_t lane = 0; lane < lanes->lane_count; lane++) {
        const uint8_t *place = lanes->corner[lane];
        const double *at[3] = {vertex[place[0]], vertex[place[1]], vertex[place[2]]};
        if (!meets_faces(work, at, 3, 3)) continue;
        if (work->facets.count == MAX_FACETS) return false;
        int group = work->facets.count / QM_PACK_LANES, here = work->facets.count % QM_PACK_LANES;
        for (int i = 0; i < 3; i++) {
            for (int k = 0; k < 3; k++) {
                work->facets.group[group].at[i][k][here] = at[i][k];
                work->size = qm_greater(fabs(at[i][k]), work->size);
            }
            int next = (i + 1) % 3;
            toggle_edge(work, lanes->vertex[place[i]], lanes->vertex[place[next]], at[i], at[next]);
        }
        work->facets.group[group].twist[here] = qm_side_twist(work->side, pack, lane);
        work->facets.count++;
    }
    return true;
}

void qm_overlay_fill_up(qm_overlay_facets *facets)
{
    int group = facets->count / QM_PACK_LANES;
    for (int lane = facets->count % QM_PACK_LANES; lane > 0 && lane < QM_PACK_LANES; lane++) {
        for (int i = 0; i < 9; i++)
            facets->group[group].at[i / 3][i % 3][lane] = facets->group[group].at[i / 3][i % 3][0];
        facets->group[group].twist[lane] = facets->group[group].twist[0];
    }
}

/** Lists the edges of the boundary that may lie over a face; false when there are too many. */
static bool list_rim(overlay_work *work)
{
    work->rim_count = 0;
    for (int i = 0; i < work->edge_count; i++) {
        const edge *e = &work->edges[i];
        if (!e->is_odd) continue;
        const double *at[2] = {e->end[0], e->end[1]};
        if (!meets_faces(work, at, 2, 2)) continue;
        if (work->rim_count == MAX_RIM) return false;
        work->rim[work->rim_count++] = e;
    }
    return true;
}

/** True when a line beside an edge of the face, or the line of e, parts them certainly. */
static bool is_beside(const overlay_work *work, const qm_overlay_face *face, const edge *e)
{
    double side_margin = QM_OVERLAY_SIDE * QM_UNIT_ROUNDING * work->size;
    double area_margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * work->size * work->size;
    for (int k = 0; k < 3; k++) {
        const double *s = face->side[k];
        if (s[0] * e->end[0][0] + s[1] * e->end[0][1] + s[2] < -side_margin &&
            s[0] * e->end[1][0] + s[1] * e->end[1][1] + s[2] < -side_margin)
            return true;
    }
    double low = INFINITY, high = -INFINITY;
    for (int c = 0; c < 3; c++) {
        double x = face->corner[c][0] - e->end[0][0], y = face->corner[c][1] - e->end[0][1];
        double area = (e->end[1][0] - e->end[0][0]) * y - (e->end[1][1] - e->end[0][1]) * x;
        low = qm_lesser(area, low);
        high = qm_greater(area, high);
    }
    return low > area_margin || high < -area_margin;
}

static bool has_rim_over(const overlay_work *work, const qm_overlay_face *face)
{
    for (int i = 0; i < work->rim_count; i++)
        if (!is_beside(work, face, work->rim[i])) return true;
    return false;
}

static bool set_facets(overlay_work *work, const qm_near_packs *near)
{
    work->facets.count = 0;
    work->edge_count = 0;
    memset(work->place, 0, sizeof work->place);
    for (int i = 0; i < near->count; i++)
        if (!add_pack(work, near->pack[i])) return false;
    if (work->facets.count == 0) return false;
    qm_overlay_fill_up(&work->facets);
    work->facets.size = work->size;
    return list_rim(work);
}

unsigned qm_worker_overlay(const qm_worker *worker, const qm_side *side, const qm_overlay_source *source,
                           const qm_near_packs *near)
{
    overlay_work work;
    work.side = side;
    double allowed = qm_search_allowed(worker->search) * side->scale;
    if (!set_frame(&work, source)) return 0;
    map_faces(&work, source, allowed);
    if (!set_facets(&work, near)) return 0;
    unsigned settled = 0;
    for (int i = 0; i < source->count; i++) {
        qm_overlay_face *face = &work.face[i];
        double margin = work.size * qm_overlay_set_face(face, work.size);
        if (!(margin < allowed) || has_rim_over(&work, face)) continue;
        qm_overlay_gap gap;
        worker->search->kernel->overlay_gap(&work.facets, face, &gap);
        if (gap.over_probe < 0 || gap.over_probe % 2 == 0) continue;
        if (gap.greatest + margin <= allowed) settled |= 1u << i;
    }
    return settled;
}
