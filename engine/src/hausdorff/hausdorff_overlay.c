/**
 * hausdorff_overlay.c: faces of the source over a region of the target are bounded by the vertical distance,
 * along one direction for all of them: a coarse face may lie over dozens of facets, none of which alone is
 * near to all of it.
 *
 * Everything is projected along a direction to a plane. If every point of a face has a facet over it, then no
 * point is farther from the target than the largest vertical distance between the face and any facet, where
 * one is over the other; that is found facet by facet (kernel/overlay.c).
 *
 * That every point of a face has a facet over it is shown as follows. Take any set of facets, and those edges
 * that an odd number of them has, by the indices of their vertices: the boundary of the set, modulo 2. Where
 * no edge of the boundary is over the inside of a face, the number of facets over a point is odd everywhere
 * in the face or even everywhere, but for points on edges: crossing any other edge changes it by
 * an even number (the degree of a map modulo 2 is constant off the image of the boundary: Guillemin, Pollack,
 * Differential Topology, 1974, chapter 2). So an odd number over one point shows it for all, the points on
 * edges being limits of others. Meshes may be open, non-manifold, or fold back over themselves.
 *
 * A bilinear patch lies within its flatness bound of its two facets, which adds that to their vertical
 * distances. For a folded patch that is much, as far as it reaches along the plane; but seen from above, the
 * patch has the boundary of its two facets, so that the degree of its projection about a point is the number
 * of these over the point, modulo 2. Let q be a point of a face beside all edges, with an odd number of facets
 * over it. Then a facet that is no part of a patch, or an odd number of the two of a patch, and that is one, is
 * over q; and so is a point of the patch. It is in the hull of the corners, so that its vertical distance from
 * the plane of the face is at most the largest of a corner. Either argument will do, facet by facet: that the
 * one facet over q is near, or that all of its patch is near the plane. The other facet of a patch may be left
 * out where it is beside the region, for it is then not over q. Where it is left out as higher or lower, the
 * second argument is not used. Nor is it where it is left out as too far from a face: the distances of the
 * patch's corners are then too large, and they are the same numbers for both facets.
 *
 * Facets higher or lower than all faces by more than the cutoff are left out, and so are facets beside all
 * faces and, where one face is tested alone, facets too far from it, as on the other side of a sharp ridge:
 * the argument holds for any set. The choice of the plane and of the set decides how often the test succeeds,
 * never whether it is sound.
 *
 * Ridges and corners of the target are often on edges of the source, where roundings would leave it open on
 * which side of a face's edge an edge of the boundary is. So a face is shrunk first: each of its corners
 * moves towards the centroid by a length d at most. A point of the face moves by d at most with them, hence
 * is within d of a point of the shrunk face, which is tested in its stead.
 *
 * Roundings, s being the largest coordinate of the facets and the faces in the plane's frame, by magnitude.
 * Mapping a vertex to the frame takes 1 u |d| for d = vertex - origin, 6 u |d| for the coordinates and 14 u
 * |d| for a frame that is not quite orthonormal: less than the 142 u R that rounding.h has for the distance
 * to a triangle, which is not computed here. A vertex has one position in the frame, whichever facet it is
 * reached from. Below, faces and facets are those of the mapped vertices, exactly.
 *   - A half plane (a, b, c) of a face with a, b divided by the edge's length is off by 12 u s at the edge's
 *     second end and by 6 u s at the first, and its value at a vertex of a facet by 9 u s: together less than
 *     QM_OVERLAY_SIDE u s.
 *   - A doubled area of three points is a difference of two products of differences, at most 2 s each: off by
 *     4 u 4 s^2 twice and 8 u s^2, less than QM_OVERLAY_AREA u s^2.
 *   - The slopes of a plane come from two such areas over a third; they are off by 128 u s length / area, and
 *     heights by twice s times that and some u s. Planes steeper than QM_OVERLAY_SLOPE are not tested.
 * That, a few u of gaps, of 16 s at most, and 16 u s by which corners may move farther than d make
 * QM_OVERLAY_GAP, for the planes of faces and of facets.
 */
#include "hausdorff_overlay.h"

#include <string.h>

#define SHRINK_BY_CUTOFF 0x1p-6 /* of the cutoff, */
#define SHRINK_BY_SIZE 0x1p-30  /* and of the largest coordinate: how far corners move at most, */
#define MAX_SHRINK 0.125        /* and of the distance to the centroid */
#define EDGE_SLOTS 1024         /* of the hash table of edges, a power of two */
#define EDGE_BITS 10
#define COST_OF_PART 200 /* hundreds of instructions (AVX2) of one part of a face in the search, about */
#define MAX_FACETS (QM_OVERLAY_GROUPS * QM_PACK_LANES)

_Static_assert(1 << EDGE_BITS == EDGE_SLOTS && 3 * MAX_FACETS < EDGE_SLOTS, "the table has room");

/** An edge: its vertices, the lower index first, and their positions in the plane. */
typedef struct edge {
    uint32_t vertex[2];
    double at[2][2];
    bool is_odd; /* an odd number of facets has it */
} edge;

/** The edges of the facets that may be over the region, by a hash of their vertices. */
typedef struct edge_table {
    int count;
    int16_t slot[EDGE_SLOTS]; /* index of an edge, plus 1; 0 for none */
    edge edges[3 * MAX_FACETS];
} edge_table;

static inline void map_point(const qm_overlay_frame *frame, qm_vec p, double out[3])
{
    qm_vec d = qm_vec_sub(p, frame->origin);
    for (int k = 0; k < 3; k++)
        out[k] = qm_vec_dot(d, frame->axis[k]);
}

qm_vec qm_overlay_normal(const qm_overlay_source *source)
{
    qm_vec normal = {0, 0, 0};
    for (int i = 0; i < source->count; i++) {
        const qm_vec *c = source->corner[i];
        normal = qm_vec_add(normal, qm_vec_cross(qm_vec_sub(c[1], c[0]), qm_vec_sub(c[2], c[0])));
    }
    return normal;
}

double qm_overlay_set_face(qm_overlay_face *face, double size)
{
    /* On no line along which meshes are subdivided. */
    static const double probe_weight[3] = {0.4327, 0.3391, 0.2282};
    double(*c)[3] = face->corner;
    double dx[2] = {c[1][0] - c[0][0], c[2][0] - c[0][0]}, dy[2] = {c[1][1] - c[0][1], c[2][1] - c[0][1]};
    double dz[2] = {c[1][2] - c[0][2], c[2][2] - c[0][2]};
    double area = dx[0] * dy[1] - dx[1] * dy[0], turn = area < 0.0 ? -1.0 : 1.0, longest = 0.0;
    for (int k = 0; k < 3; k++) {
        const double *a = c[k], *b = c[(k + 1) % 3];
        double x = b[0] - a[0], y = b[1] - a[1], length = sqrt(x * x + y * y);
        if (!(length > 0.0)) return INFINITY;
        longest = qm_max(length, longest);
        face->side[k][0] = -turn * y / length;
        face->side[k][1] = turn * x / length;
        face->side[k][2] = -(face->side[k][0] * a[0] + face->side[k][1] * a[1]);
    }
    /* A thinner face would leave it open whether the probe is inside. */
    if (!(fabs(area) > QM_OVERLAY_GAP * QM_UNIT_ROUNDING * size * longest)) return INFINITY;
    double slope_x = (dz[0] * dy[1] - dz[1] * dy[0]) / area, slope_y = (dx[0] * dz[1] - dx[1] * dz[0]) / area;
    if (!(fabs(slope_x) + fabs(slope_y) <= QM_OVERLAY_SLOPE)) return INFINITY;
    face->plane[0] = slope_x;
    face->plane[1] = slope_y;
    face->plane[2] = c[0][2] - (slope_x * c[0][0] + slope_y * c[0][1]);
    for (int k = 0; k < 2; k++)
        face->probe[k] = probe_weight[0] * c[0][k] + probe_weight[1] * c[1][k] + probe_weight[2] * c[2][k];
    return QM_OVERLAY_GAP * QM_UNIT_ROUNDING * (1.0 + size * longest / fabs(area));
}

/** Adds an edge that an odd number of the facets of a pack has to the table, modulo 2. */
static void toggle_edge(edge_table *table, const qm_pack_lanes *lanes, const qm_overlay_vertices *vertices,
                        const int end[2])
{
    int turn = lanes->vertex[end[0]] > lanes->vertex[end[1]];
    uint32_t low = lanes->vertex[end[turn]], high = lanes->vertex[end[1 - turn]];
    uint32_t hash = (low * UINT32_C(0x9e3779b1)) ^ (high * UINT32_C(0x85ebca6b));
    uint32_t i = hash >> (32 - EDGE_BITS);
    for (; table->slot[i] != 0; i = (i + 1) % EDGE_SLOTS) {
        edge *known = &table->edges[table->slot[i] - 1];
        if (known->vertex[0] != low || known->vertex[1] != high) continue;
        known->is_odd = !known->is_odd;
        return;
    }
    QM_ASSERT(table->count < 3 * MAX_FACETS);
    edge *added = &table->edges[table->count++];
    table->slot[i] = (int16_t)table->count;
    *added = (edge){.vertex = {low, high}, .is_odd = true};
    for (int j = 0; j < 2; j++)
        for (int k = 0; k < 2; k++)
            added->at[j][k] = vertices->at[k][end[j]];
}

/** Counts the edges of the facets of a pack that have a bit. Most are edges of two of them, found by a bit
 * for each pair of vertices. Edges beside the region are left out: they are no part of its boundary. */
static void toggle_pack(edge_table *table, const qm_pack_lanes *lanes, const qm_overlay_vertices *vertices,
                        unsigned facets)
{
    uint32_t odd[3 * QM_PACK_LANES] = {0};
    for (; facets; facets &= facets - 1) {
        const uint8_t *corner = lanes->corner[__builtin_ctz(facets)];
        for (int i = 0; i < 3; i++) {
            uint8_t a = corner[i], b = corner[i < 2 ? i + 1 : 0];
            odd[a < b ? a : b] ^= UINT32_C(1) << (a < b ? b : a);
        }
    }
    for (int a = 0; a < lanes->vertex_count; a++) {
        for (uint32_t left = odd[a]; left; left &= left - 1) {
            int b = __builtin_ctz(left);
            if (vertices->beyond[a] & vertices->beyond[b] & QM_OVERLAY_BESIDE) continue;
            toggle_edge(table, lanes, vertices, (const int[2]){a, b});
        }
    }
}

/** Lists the odd edges as the rim, the boundary of the set; false when there are too many. */
static bool set_rim(qm_overlay_facets *facets, const edge_table *table)
{
    int count = 0;
    for (int i = 0; i < table->count; i++) {
        const edge *e = &table->edges[i];
        if (!e->is_odd) continue;
        if (count == QM_OVERLAY_RIM) return false;
        for (int j = 0; j < 4; j++)
            facets->rim[j / 2][j % 2][count] = e->at[j / 2][j % 2];
        count++;
    }
    facets->rim_count = count;
    for (int i = count; i % QM_PACK_LANES != 0; i++)
        for (int j = 0; j < 4; j++)
            facets->rim[j / 2][j % 2][i] = facets->rim[j / 2][j % 2][0];
    return true;
}

/** Removes the far facets of those that a pack has added from index first on; listed is the index that the
 * first of them had when far was set. Returns the bits of the others. */
static unsigned remove_far(qm_overlay_facets *facets, int first, int listed, unsigned added,
                           const uint8_t *far)
{
    unsigned kept = 0;
    int count = first;
    for (int from = first; added; added &= added - 1, from++, listed++) {
        if (far[listed / QM_PACK_LANES] >> listed % QM_PACK_LANES & 1) continue;
        qm_overlay_copy_facet(facets, from, count++);
        kept |= added & -added;
    }
    facets->count = count;
    return kept;
}

/** Adds the facets of the packs that may be over the region, without those that have a bit in far unless far
 * is NULL; false when there are none, or no room. */
static bool set_facets(const qm_kernel *kernel, const qm_side *side, const qm_near_packs *near,
                       const uint8_t *far, qm_overlay *overlay)
{
    const qm_bvh *target = side->target;
    qm_overlay_facets *facets = &overlay->facets;
    edge_table table;
    table.count = 0;
    memset(table.slot, 0, sizeof table.slot);
    facets->count = 0;
    facets->has_patches = side->target_patches;
    for (int i = 0, listed = 0; i < near->count; i++) {
        uint32_t pack = near->pack[i];
        const qm_pack_lanes *lanes = &target->lanes[pack];
        int first = facets->count;
        if (first + lanes->lane_count > MAX_FACETS) return false;
        qm_overlay_vertices vertices;
        unsigned added =
            kernel->overlay_add(facets, &overlay->frame, target, pack, qm_side_twists(side, pack), &vertices);
        int count = facets->count - first;
        if (far) added = remove_far(facets, first, listed, added, far);
        listed += count;
        toggle_pack(&table, lanes, &vertices, added);
    }
    if (facets->count == 0 || !set_rim(facets, &table)) return false;
    kernel->overlay_close(facets);
    return true;
}

/**
 * Counts work in hundreds of instructions, about, for the choice between overlays and covers, and in parts as
 * the search's iterations, which its limit is about. The counts of the callers are fitted to the instructions
 * that the AVX2 kernels execute, as are the costs of covers in hausdorff_piece.c. Other kernels execute more
 * or fewer, but count the same: so every machine makes the same choices, and returns the same bits.
 */
static void count_work(qm_worker *worker, uint64_t hundreds)
{
    uint64_t before = worker->overlay_work / COST_OF_PART;
    worker->overlay_cost += hundreds;
    worker->overlay_work += hundreds;
    worker->iterations += worker->overlay_work / COST_OF_PART - before;
}

static bool set_overlay(qm_worker *worker, const qm_side *side, const qm_near_packs *near, const uint8_t *far,
                        qm_overlay *overlay)
{
    bool is_set = set_facets(worker->search->kernel, side, near, far, overlay);
    count_work(worker, 8 + 11 * (uint64_t)near->count + (uint64_t)overlay->facets.count / 2);
    return is_set;
}

bool qm_overlay_set(qm_worker *worker, const qm_side *side, qm_vec normal, const qm_vec *point, int count,
                    const qm_near_packs *near, qm_overlay *overlay)
{
    QM_ASSERT(worker && side && point && near && overlay);
    QM_ASSERT(count > 0);
    qm_overlay_frame *frame = &overlay->frame;
    double length = qm_vec_norm(normal), size = 0.0, cutoff = qm_search_cutoff(worker->search) * side->scale;
    if (!(length > QM_MIN_LENGTH)) return false;
    qm_vec z = qm_vec_scale(1.0 / length, normal);
    qm_vec other = fabs(z.x) < fabs(z.y) ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    qm_vec across = qm_vec_cross(other, z);
    frame->origin = point[0];
    frame->axis[0] = qm_vec_scale(1.0 / qm_vec_norm(across), across);
    frame->axis[1] = qm_vec_cross(z, frame->axis[0]);
    frame->axis[2] = z;
    /* The region is the box of the points, and the cutoff above and below. */
    for (int k = 0; k < 3; k++) {
        frame->low[k] = INFINITY;
        frame->high[k] = -INFINITY;
    }
    for (int i = 0; i < count; i++) {
        double at[3];
        map_point(frame, point[i], at);
        for (int k = 0; k < 3; k++) {
            frame->low[k] = qm_min(at[k], frame->low[k]);
            frame->high[k] = qm_max(at[k], frame->high[k]);
            size = qm_max(fabs(at[k]), size);
        }
    }
    frame->low[2] -= cutoff;
    frame->high[2] += cutoff;
    overlay->facets.size = size;
    overlay->shrink = qm_min(SHRINK_BY_CUTOFF * cutoff, SHRINK_BY_SIZE * size);
    count_work(worker, (uint64_t)count / 2);
    return set_overlay(worker, side, near, NULL, overlay);
}

/** Sets a face, its corners moved towards its centroid by shrink at most and a few roundings. Returns the
 * vertical distance up to which it may be discarded, or a negative number. */
static double set_face(const qm_overlay *overlay, const qm_vec corner[3], double cutoff,
                       qm_overlay_face *face)
{
    double(*c)[3] = face->corner, centroid[3], farthest2 = 0.0, size = overlay->facets.size;
    for (int i = 0; i < 3; i++)
        map_point(&overlay->frame, corner[i], c[i]);
    for (int k = 0; k < 3; k++)
        centroid[k] = (c[0][k] + c[1][k] + c[2][k]) / 3.0;
    for (int i = 0; i < 3; i++) {
        double x = centroid[0] - c[i][0], y = centroid[1] - c[i][1], z = centroid[2] - c[i][2];
        farthest2 = qm_max(x * x + y * y + z * z, farthest2);
    }
    double share = farthest2 > 0.0 ? qm_min(overlay->shrink / sqrt(farthest2), MAX_SHRINK) : 0.0;
    for (int i = 0; i < 3 && share > 0.0; i++)
        for (int k = 0; k < 3; k++)
            c[i][k] += share * (centroid[k] - c[i][k]);
    return cutoff - overlay->shrink - size * qm_overlay_set_face(face, size);
}

/** True when an odd number of facets is over each point of a face. */
static bool is_under(const qm_kernel *kernel, const qm_overlay_facets *facets, const qm_overlay_face *face)
{
    if (!kernel->overlay_is_clear(facets, face)) return false;
    int count = kernel->overlay_count(facets, face);
    return count > 0 && count % 2 == 1;
}

static bool is_covered(const qm_kernel *kernel, const qm_overlay_facets *facets, const qm_overlay_face *face,
                       double enough)
{
    return is_under(kernel, facets, face) && kernel->overlay_gap(facets, face, enough, NULL) <= enough;
}

unsigned qm_overlay_test(qm_worker *worker, const qm_side *side, const qm_overlay *overlay,
                         const qm_overlay_source *source)
{
    QM_ASSERT(worker && side && overlay && source);
    QM_ASSERT(source->count >= 0 && source->count <= QM_OVERLAY_FACES);
    double cutoff = qm_search_cutoff(worker->search) * side->scale;
    unsigned discarded = 0;
    for (int i = 0; i < source->count; i++) {
        qm_overlay_face face;
        double enough = set_face(overlay, source->corner[i], cutoff, &face);
        if (enough > 0.0 && is_covered(worker->search->kernel, &overlay->facets, &face, enough))
            discarded |= 1u << i;
    }
    count_work(worker, (uint64_t)source->count * (12 + (uint64_t)overlay->facets.count / 8));
    return discarded;
}

bool qm_overlay_test_face(qm_worker *worker, const qm_side *side, const qm_vec corner[3], double slack,
                          const qm_near_packs *near)
{
    const qm_kernel *kernel = worker->search->kernel;
    qm_overlay overlay;
    qm_overlay_source source = {.count = 1};
    memcpy(source.corner[0], corner, sizeof source.corner[0]);
    if (!qm_overlay_set(worker, side, qm_overlay_normal(&source), source.corner[0], 3, near, &overlay))
        return false;
    double cutoff = qm_search_cutoff(worker->search) * side->scale;
    qm_overlay_face face;
    double enough = set_face(&overlay, source.corner[0], cutoff - slack, &face);
    if (!(enough > 0.0)) return false;
    count_work(worker, 12 + (uint64_t)overlay.facets.count / 8);
    const qm_overlay_facets *facets = &overlay.facets;
    bool is_over = is_under(kernel, facets, &face);
    uint8_t far[QM_OVERLAY_GROUPS] = {0};
    bool is_near =
        kernel->overlay_gap(facets, &face, enough, far) <= enough ||
        (is_over && facets->has_patches && qm_overlay_patches_are_near(facets, &face, enough, far));
    if (is_near) return is_over;
    return set_overlay(worker, side, near, far, &overlay) && is_covered(kernel, facets, &face, enough);
}

/* --- Rectangles of patches --- */

/** A rectangle of a patch in the frame of an overlay, and the two triangles that its view fills. */
typedef struct seen_patch {
    double corner[4][3];
    qm_overlay_face half[2];
    double enough; /* of vertical distances */
} seen_patch;

/** True when all corners of the rectangle surely turn the same way in the view. */
static bool is_convex(const double corner[4][3], double size)
{
    double margin = QM_OVERLAY_AREA * QM_UNIT_ROUNDING * size * size, lowest = INFINITY, highest = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const double *a = corner[i], *b = corner[(i + 1) % 4], *c = corner[(i + 2) % 4];
        double turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
        lowest = qm_min(lowest, turn);
        highest = qm_max(highest, turn);
    }
    return lowest > margin || highest < -margin;
}

/** Sets the rectangle, shrunk as a face is; false where its view is not convex, or too steep. */
static bool set_patch(const qm_overlay *overlay, const qm_vec corner[4], double cutoff, seen_patch *patch)
{
    double(*c)[3] = patch->corner, centroid[3], farthest2 = 0.0, size = overlay->facets.size, margin = 0.0;
    for (int i = 0; i < 4; i++)
        map_point(&overlay->frame, corner[i], c[i]);
    for (int k = 0; k < 3; k++)
        centroid[k] = 0.25 * (c[0][k] + c[1][k] + c[2][k] + c[3][k]);
    for (int i = 0; i < 4; i++) {
        double x = centroid[0] - c[i][0], y = centroid[1] - c[i][1], z = centroid[2] - c[i][2];
        farthest2 = qm_max(x * x + y * y + z * z, farthest2);
    }
    double share = farthest2 > 0.0 ? qm_min(overlay->shrink / sqrt(farthest2), MAX_SHRINK) : 0.0;
    for (int i = 0; i < 12 && share > 0.0; i++)
        c[i / 3][i % 3] += share * (centroid[i % 3] - c[i / 3][i % 3]);
    if (!is_convex(patch->corner, size)) return false;
    for (int half = 0; half < 2; half++) {
        memcpy(patch->half[half].corner[0], c[0], sizeof c[0]);
        memcpy(patch->half[half].corner[1], c[1 + half], sizeof c[0]);
        memcpy(patch->half[half].corner[2], c[2 + half], sizeof c[0]);
        margin = qm_max(margin, qm_overlay_set_face(&patch->half[half], size));
    }
    patch->enough = cutoff - overlay->shrink - size * margin;
    return patch->enough > 0.0;
}

/** How many facets are over the rectangle where that is odd for all of it; 0 otherwise. */
static int count_over(const qm_kernel *kernel, const qm_overlay_facets *facets, const seen_patch *patch)
{
    int most = 0;
    for (int half = 0; half < 2; half++) {
        if (!kernel->overlay_is_clear(facets, &patch->half[half])) return 0;
        int count = kernel->overlay_count(facets, &patch->half[half]);
        if (!(count > 0 && count % 2 == 1)) return 0;
        most = count > most ? count : most;
    }
    return most;
}

bool qm_overlay_test_patch(qm_worker *worker, const qm_side *side, const qm_vec corner[4],
                           const qm_near_packs *near)
{
    QM_ASSERT(worker && side && corner && near);
    const qm_kernel *kernel = worker->search->kernel;
    qm_overlay overlay;
    qm_overlay_facets *facets = &overlay.facets;
    seen_patch patch;
    qm_vec normal = qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1]));
    if (!qm_overlay_set(worker, side, normal, corner, 4, near, &overlay)) return false;
    if (!set_patch(&overlay, corner, qm_search_cutoff(worker->search) * side->scale, &patch)) return false;
    count_work(worker, 20 + 3 * (uint64_t)facets->count);
    int count = count_over(kernel, facets, &patch);
    uint8_t far[QM_OVERLAY_GROUPS] = {0};
    /* Where one facet is over each point, and one of them is too far, the others leave a hole. */
    if (count == 1) return qm_overlay_patch_gap(facets, patch.corner, patch.enough, NULL) <= patch.enough;
    if (qm_overlay_patch_gap(facets, patch.corner, patch.enough, far) <= patch.enough) return count > 0;
    return set_overlay(worker, side, near, far, &overlay) && count_over(kernel, facets, &patch) > 0 &&
           qm_overlay_patch_gap(facets, patch.corner, patch.enough, NULL) <= patch.enough;
}
