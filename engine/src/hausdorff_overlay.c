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
 * those beside all faces, and for each face those that are too far from it, as the sides of a sharp ridge
 * are: what is left is any set. Which plane is taken, and what is left out, decides how often this works,
 * never whether it holds.
 *
 * Ridges and corners of the target often lie on edges of the source, where roundings would leave it open on
 * which side of a face an edge of the boundary lies. So a face is made smaller first: each of its corners
 * moves towards the middle by a length d. A point of the face moves by d at most with them, hence is within d
 * of a point of the smaller face, which alone is looked at.
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
 *     That, a few u of gaps, of 16 s at most, and 16 u s by which corners may move farther than d make
 *     QM_OVERLAY_GAP.
 */
#include "hausdorff_overlay.h"

#include <string.h>

#define MAX_SLOPE 2.0
#define SHRINK_BY_ALLOWED 0x1p-6 /* of the allowed distance, */
#define SHRINK_BY_SIZE 0x1p-30   /* and of the greatest coordinate: how far corners move at most */
#define MAX_SHRINK 0.125         /* of the way to the middle */
#define EDGE_PLACES 1024         /* of the table of edges, a power of two */
#define EDGE_BITS 10
#define MAX_FACETS (QM_OVERLAY_GROUPS * QM_PACK_LANES)

_Static_assert(1 << EDGE_BITS == EDGE_PLACES && 3 * MAX_FACETS < EDGE_PLACES, "the table has room");

/** An edge: its vertices, the lower first, and a facet that has it. */
typedef struct edge {
    uint32_t vertex[2];
    uint16_t facet;
    uint8_t corner; /* of the facet, from which it goes to the next */
    bool is_odd;    /* an odd number of facets has it */
} edge;

typedef struct overlay_work {
    const qm_side *side;
    const qm_kernel *kernel;
    qm_overlay_frame frame;
    qm_overlay_face face[QM_OVERLAY_FACES];
    qm_overlay_facets facets;
    int edge_count;
    int16_t place[EDGE_PLACES]; /* of an edge, plus 1; 0 for none */
    edge edges[3 * MAX_FACETS];
    uint16_t edge_of[MAX_FACETS][3]; /* of a facet, from each of its corners to the next */
    qm_overlay_rim rim;              /* of all facets */
} overlay_work;

static inline void map_point(const qm_overlay_frame *frame, qm_vec p, double out[3])
{
    qm_vec d = qm_vec_sub(p, frame->origin);
    for (int k = 0; k < 3; k++)
        out[k] = qm_vec_dot(d, frame->axis[k]);
}

/** False when the faces have no direction in common. */
static bool set_frame(qm_overlay_frame *frame, const qm_overlay_source *source)
{
    qm_vec normal = {0, 0, 0};
    for (int i = 0; i < source->count; i++) {
        const qm_vec *c = source->corner[i];
        normal = qm_vec_add(normal, qm_vec_cross(qm_vec_sub(c[1], c[0]), qm_vec_sub(c[2], c[0])));
    }
    double length = qm_vec_norm(normal);
    if (!(length > 0.0)) return false;
    frame->origin = source->corner[0][0];
    qm_vec z = qm_vec_scale(1.0 / length, normal);
    qm_vec other = fabs(z.x) < fabs(z.y) ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    qm_vec across = qm_vec_cross(other, z);
    frame->axis[0] = qm_vec_scale(1.0 / qm_vec_norm(across), across);
    frame->axis[1] = qm_vec_cross(z, frame->axis[0]);
    frame->axis[2] = z;
    return true;
}

/** Moves the corners of a triangle towards its middle, by this length at most and a few roundings. */
static void shrink_face(qm_overlay_face *face, double length)
{
    double(*c)[3] = face->corner, middle[3], farthest2 = 0.0;
    for (int k = 0; k < 3; k++)
        middle[k] = (c[0][k] + c[1][k] + c[2][k]) / 3.0;
    for (int i = 0; i < 3; i++) {
        double x = middle[0] - c[i][0], y = middle[1] - c[i][1], z = middle[2] - c[i][2];
        farthest2 = qm_greater(x * x + y * y + z * z, farthest2);
    }
    if (!(farthest2 > 0.0)) return;
    double share = qm_lesser(length / sqrt(farthest2), MAX_SHRINK);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            c[i][k] += share * (middle[k] - c[i][k]);
}

/** Maps the faces to the frame and shrinks them; its box becomes theirs and what is allowed above and below.
 * Returns by how much their corners moved at most. */
static double map_faces(overlay_work *work, const qm_overlay_source *source, double allowed)
{
    qm_overlay_frame *frame = &work->frame;
    double size = 0.0;
    for (int i = 0; i < source->count; i++) {
        for (int c = 0; c < 3; c++) {
            map_point(frame, source->corner[i][c], work->face[i].corner[c]);
            for (int k = 0; k < 3; k++)
                size = qm_greater(fabs(work->face[i].corner[c][k]), size);
        }
    }
    double shrink = qm_lesser(SHRINK_BY_ALLOWED * allowed, SHRINK_BY_SIZE * size);
    for (int k = 0; k < 3; k++) {
        frame->low[k] = INFINITY;
        frame->high[k] = -INFINITY;
    }
    for (int i = 0; i < source->count; i++) {
        shrink_face(&work->face[i], shrink);
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 3; k++) {
                frame->low[k] = qm_lesser(work->face[i].corner[c][k], frame->low[k]);
                frame->high[k] = qm_greater(work->face[i].corner[c][k], frame->high[k]);
            }
        }
    }
    frame->low[2] -= allowed;
    frame->high[2] += allowed;
    work->facets.size = size;
    return shrink;
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

/** Counts an edge that goes from a corner of a facet to the next. */
static void toggle_edge(overlay_work *work, uint32_t from, uint32_t to, int facet, int corner)
{
    uint32_t low = from < to ? from : to, high = from < to ? to : from;
    uint32_t hash = (low * UINT32_C(0x9e3779b1)) ^ (high * UINT32_C(0x85ebca6b));
    for (uint32_t i = hash >> (32 - EDGE_BITS);; i = (i + 1) % EDGE_PLACES) {
        if (work->place[i] == 0) {
            work->edge_of[facet][corner] = (uint16_t)work->edge_count;
            work->edges[work->edge_count++] = (edge){{low, high}, (uint16_t)facet, (uint8_t)corner, true};
            work->place[i] = (int16_t)work->edge_count;
            return;
        }
        edge *known = &work->edges[work->place[i] - 1];
        if (known->vertex[0] != low || known->vertex[1] != high) continue;
        known->is_odd = !known->is_odd;
        work->edge_of[facet][corner] = (uint16_t)(known - work->edges);
        return;
    }
}

/** Adds the facets of a pack that may lie over the faces; false when there is no room. */
static bool add_pack(overlay_work *work, uint32_t pack)
{
    const qm_bvh *target = work->side->target;
    const qm_pack_lanes *lanes = &target->lanes[pack];
    if (work->facets.count + lanes->lane_count > MAX_FACETS) return false;
    int facet = work->facets.count;
    unsigned added = work->kernel->overlay_add(&work->facets, &work->frame, target, pack,
                                               qm_side_twists(work->side, pack));
    for (; added; added &= added - 1, facet++) {
        const uint8_t *corner = lanes->corner[__builtin_ctz(added)];
        for (int i = 0; i < 3; i++)
            toggle_edge(work, lanes->vertex[corner[i]], lanes->vertex[corner[(i + 1) % 3]], facet, i);
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

/** Whether the box of an edge meets that of the faces in the plane. */
static bool edge_meets(const qm_overlay_frame *frame, const double at[2][2])
{
    for (int k = 0; k < 2; k++)
        if ((at[0][k] < frame->low[k] && at[1][k] < frame->low[k]) ||
            (at[0][k] > frame->high[k] && at[1][k] > frame->high[k]))
            return false;
    return true;
}

static void set_rim_edge(qm_overlay_rim *rim, int place, const double at[2][2])
{
    for (int end = 0; end < 2; end++)
        for (int k = 0; k < 2; k++)
            rim->at[end][k][place] = at[end][k];
}

/** Makes the rim of those edges of the boundary that may lie over a face; false when there are too many. */
static bool set_rim(const overlay_work *work, qm_overlay_rim *rim)
{
    const qm_overlay_facets *facets = &work->facets;
    int count = 0;
    double at[2][2];
    for (int i = 0; i < work->edge_count; i++) {
        const edge *e = &work->edges[i];
        if (!e->is_odd) continue;
        int group = e->facet / QM_PACK_LANES, lane = e->facet % QM_PACK_LANES;
        for (int end = 0; end < 2; end++)
            for (int k = 0; k < 2; k++)
                at[end][k] = facets->group[group].at[(e->corner + end) % 3][k][lane];
        if (!edge_meets(&work->frame, at)) continue;
        if (count == QM_OVERLAY_RIM) return false;
        set_rim_edge(rim, count++, at);
    }
    rim->count = count;
    for (int i = count; i % QM_PACK_LANES != 0; i++)
        for (int end = 0; end < 2; end++)
            for (int k = 0; k < 2; k++)
                rim->at[end][k][i] = rim->at[end][k][0];
    return true;
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
    return set_rim(work, &work->rim);
}

/** About how many hundred instructions an overlay takes. */
static uint64_t cost_of(const overlay_work *work, int faces, int packs)
{
    uint64_t facets = (uint64_t)work->facets.count;
    return 10 + 9 * (uint64_t)packs + 2 * facets + (uint64_t)faces * (3 + facets / 2);
}

static void toggle_facet(overlay_work *work, int facet)
{
    for (int i = 0; i < 3; i++)
        work->edges[work->edge_of[facet][i]].is_odd ^= true;
}

/** Toggles the edges of the facets that are farther from a face than this. */
static void toggle_far_facets(overlay_work *work, const qm_overlay_gaps *gaps, double enough)
{
    for (int i = 0; i < work->facets.count; i++)
        if (!(gaps->at[i] <= enough)) toggle_facet(work, i);
}

/** True when no edge of the boundary of the facets that are near enough lies over the face. */
static bool is_clear(overlay_work *work, const qm_overlay_face *face, const qm_overlay_gaps *gaps,
                     double enough)
{
    double size = work->facets.size;
    if (gaps->greatest <= enough) return work->kernel->overlay_clear(&work->rim, size, face);
    qm_overlay_rim rim;
    toggle_far_facets(work, gaps, enough);
    bool clear = set_rim(work, &rim) && work->kernel->overlay_clear(&rim, size, face);
    toggle_far_facets(work, gaps, enough);
    return clear;
}

/** True when an odd number of the facets that are near enough certainly is over the probe. */
static bool probe_is_covered(const overlay_work *work, const qm_overlay_gaps *gaps, double enough)
{
    int over = 0;
    for (int first = 0; first < work->facets.count; first += QM_PACK_LANES) {
        unsigned near = 0;
        int group = first / QM_PACK_LANES;
        for (int lane = 0; lane < QM_PACK_LANES && first + lane < work->facets.count; lane++)
            near |= (unsigned)(gaps->at[first + lane] <= enough) << lane;
        if (near & ~(gaps->over_probe[group] | gaps->beside_probe[group])) return false;
        over += __builtin_popcount(near & gaps->over_probe[group]);
    }
    return over % 2 == 1;
}

unsigned qm_worker_overlay(qm_worker *worker, const qm_side *side, const qm_overlay_source *source,
                           const qm_near_packs *near)
{
    overlay_work work;
    work.side = side;
    work.kernel = worker->search->kernel;
    double allowed = qm_search_allowed(worker->search) * side->scale;
    if (!set_frame(&work.frame, source)) return 0;
    double shrink = map_faces(&work, source, allowed);
    bool has_facets = set_facets(&work, near);
    worker->overlay_cost += cost_of(&work, source->count, near->count);
    if (!has_facets) return 0;
    unsigned settled = 0;
    for (int i = 0; i < source->count; i++) {
        qm_overlay_face *face = &work.face[i];
        double size = work.facets.size, margin = size * qm_overlay_set_face(face, size);
        double enough = allowed - shrink - margin;
        if (!(enough > 0.0)) continue;
        qm_overlay_gaps gaps;
        work.kernel->overlay_gaps(&work.facets, face, &gaps);
        if (probe_is_covered(&work, &gaps, enough) && is_clear(&work, face, &gaps, enough))
            settled |= 1u << i;
    }
    return settled;
}

bool qm_worker_overlay_face(qm_worker *worker, const qm_side *side, const qm_piece *face,
                            const qm_near_packs *near)
{
    qm_overlay_source source = {.count = 1};
    memcpy(source.corner[0], face->corner, sizeof source.corner[0]);
    return qm_worker_overlay(worker, side, &source, near) != 0;
}
