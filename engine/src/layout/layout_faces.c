/**
 * layout_faces.c: the faces of the arrangement that the curves make on the surface. Those with four sides are
 * the patches.
 *
 * Each curve c is two darts (half-edges): 2 c runs along it and 2 c + 1 against it. The darts that leave
 * a node are ordered anticlockwise about the surface's normal. A face (cell) lies to the left of its darts; at the
 * end of a dart it continues with the dart that is next clockwise after the reversed one.
 */
#include "bvh/bvh_tree.h"
#include "layout_internal.h"
#include "qm/features.h"
#include "qm/project.h"

#include <string.h>

#define TANGENT_LENGTH                                                                                       \
    0.25 /* of the shortest curve at a node: the secants that give curves' directions there */
#define RING_STEP                                                                                            \
    0.02 /* of the middle segment of a curve: places round it, that tell whether a mesh ends there */
#define RING_TURN (FULL_TURN / 16.0)
#define SHORTEST_BOUNDARY 1e-9 /* of the diagonal */
#define BEYOND 0.75            /* of the length round a cell */
#define CLEAR 0.8              /* of a place's distance from one sheet alone */
#define NODES_A_POLL 64        /* of the cancel flag */
#define FULL_TURN 6.283185307179586
#define TRANSPORT_STEPS 4 /* samples of the normal on each segment of a curve, as it is transported along */

enum { POINT_SIZE = 3 * sizeof(double) };

typedef struct arrangement {
    qm_context *ctx;
    const qm_ref_surface *surface;
    const qm_layout *layout;
    size_t dart_count;
    const uint32_t *first_at, *at; /* the darts of each node, as in qm_layout_cells */
    qm_vec *normal;                /* of each node, consistent along the curves; 0 while unknown */
    double *angle;                 /* of each dart in the tangent plane of its start node */
    uint32_t *next;                /* the dart that follows on the same face */
    uint32_t *queue;               /* nodes whose normals are to be propagated */
} arrangement;

uint32_t qm_layout_dart_start(const qm_layout *layout, uint32_t dart)
{
    const qm_curve *curve = &layout->curves[dart / 2];
    return dart % 2 ? curve->to : curve->from;
}

static qm_vec surface_normal(const qm_ref_surface *surface, const double p[3])
{
    qm_ref_surface_point projection;
    qm_ref_surface_project(surface, p, &projection);
    return qm_vec_load(projection.normal);
}

/** Point k of a curve in the direction of the dart. */
static const double *dart_point(const qm_curve *curve, uint32_t dart, size_t k)
{
    return curve->points + 3 * (dart % 2 ? curve->point_count - 1 - k : k);
}

/**
 * Transports a normal from the start of a dart to its end. A mesh has oriented normals of its own; the fitted
 * normals of a point set have no certain side, so that each is flipped to agree with the one before it.
 */
static qm_vec transport_normal(const arrangement *arr, uint32_t dart, qm_vec normal)
{
    const qm_curve *curve = &arr->layout->curves[dart / 2];
    if (!arr->surface->is_cloud) {
        qm_vec own = surface_normal(arr->surface, dart_point(curve, dart, curve->point_count - 1));
        return qm_vec_norm2(own) > 0.0 ? own : normal;
    }
    for (size_t k = 1; k < curve->point_count; k++) {
        qm_vec before = qm_vec_load(dart_point(curve, dart, k - 1));
        qm_vec after = qm_vec_load(dart_point(curve, dart, k));
        for (int step = 1; step <= TRANSPORT_STEPS; step++) {
            double at[3];
            qm_vec_store(at, qm_vec_mix(before, after, (double)step / TRANSPORT_STEPS));
            qm_vec here = surface_normal(arr->surface, at);
            if (qm_vec_norm2(here) == 0.0) continue;
            normal = qm_vec_dot(here, normal) < 0.0 ? qm_vec_scale(-1.0, here) : here;
        }
    }
    return normal;
}

/** Sets the normals of all nodes that curves connect with a start node, breadth first. */
static void propagate_normals(arrangement *arr, uint32_t start)
{
    size_t queued = 0;
    arr->normal[start] = surface_normal(arr->surface, arr->layout->nodes + 3 * (size_t)start);
    if (qm_vec_norm2(arr->normal[start]) == 0.0) arr->normal[start] = (qm_vec){0, 0, 1};
    arr->queue[queued++] = start;
    for (size_t i = 0; i < queued; i++) {
        uint32_t node = arr->queue[i];
        for (uint32_t k = arr->first_at[node]; k < arr->first_at[node + 1]; k++) {
            uint32_t end = qm_layout_dart_start(arr->layout, arr->at[k] ^ 1);
            if (qm_vec_norm2(arr->normal[end]) > 0.0) continue;
            QM_ASSERT(queued < arr->layout->node_count);
            arr->normal[end] = transport_normal(arr, arr->at[k], arr->normal[node]);
            arr->queue[queued++] = end;
        }
    }
}

/** The secant from the start of a dart to its point at an arc length, or to its end if it is shorter. */
static qm_vec dart_direction(const qm_layout *layout, uint32_t dart, double length)
{
    const qm_curve *curve = &layout->curves[dart / 2];
    qm_vec start = qm_vec_load(dart_point(curve, dart, 0)), here = start;
    for (size_t k = 1; k < curve->point_count; k++) {
        qm_vec next = qm_vec_load(dart_point(curve, dart, k));
        double segment = qm_vec_distance(here, next);
        if (segment >= length)
            return qm_vec_sub(qm_vec_mix(here, next, segment > 0.0 ? length / segment : 0.0), start);
        length -= segment;
        here = next;
    }
    return qm_vec_sub(here, start);
}

/** Sets the angles of the darts of a node in its tangent plane. */
static void measure_angles(arrangement *arr, uint32_t node)
{
    double shortest = INFINITY;
    const uint32_t *darts = arr->at + arr->first_at[node];
    size_t count = arr->first_at[node + 1] - arr->first_at[node];
    for (size_t i = 0; i < count; i++)
        shortest = fmin(shortest, qm_layout_curve_length(&arr->layout->curves[darts[i] / 2]));
    double length = TANGENT_LENGTH * shortest;
    /*
     * The mean of the normals between the darts of a node. The node's own normal would not do at the corner of
     * a box: it is that of one of three faces, and one of the edges runs along it.
     */
    qm_vec at_node = arr->normal[node], start = qm_vec_load(arr->layout->nodes + 3 * (size_t)node),
           sum = at_node;
    for (size_t a = 0; a < count; a++) {
        for (size_t b = a + 1; b < count; b++) {
            qm_vec between = qm_vec_add(dart_direction(arr->layout, darts[a], length),
                                        dart_direction(arr->layout, darts[b], length));
            double at[3];
            qm_vec_store(at, qm_vec_axpy(start, 0.5, between));
            qm_vec here = surface_normal(arr->surface, at);
            bool is_flipped = arr->surface->is_cloud && qm_vec_dot(here, at_node) < 0.0;
            sum = qm_vec_axpy(sum, is_flipped ? -1.0 : 1.0, here);
        }
    }
    double norm = qm_vec_norm(sum);
    qm_vec normal = norm > 1e-3 ? qm_vec_scale(1.0 / norm, sum) : at_node;
    qm_vec x = fabs(normal.x) < 0.6 ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    x = qm_vec_axpy(x, -qm_vec_dot(x, normal), normal);
    x = qm_vec_scale(1.0 / qm_vec_norm(x), x);
    qm_vec y = qm_vec_cross(normal, x);
    for (size_t i = 0; i < count; i++) {
        qm_vec d = dart_direction(arr->layout, darts[i], length);
        arr->angle[darts[i]] = atan2(qm_vec_dot(d, y), qm_vec_dot(d, x));
    }
}

/** The order of darts round a node: by angle, then by index. It is total, however the angles are rounded. */
static bool is_before(const arrangement *arr, uint32_t dart, uint32_t other)
{
    return arr->angle[dart] < arr->angle[other] || (arr->angle[dart] == arr->angle[other] && dart < other);
}

/**
 * The dart that is next clockwise: the last one before this in the order round the node, else the last of
 * all. This is a permutation of the darts, so that the trace of a face returns to its first dart.
 */
static uint32_t next_clockwise(const arrangement *arr, uint32_t dart)
{
    uint32_t before = dart, last = dart, node = qm_layout_dart_start(arr->layout, dart);
    for (uint32_t k = arr->first_at[node]; k < arr->first_at[node + 1]; k++) {
        uint32_t other = arr->at[k];
        if (is_before(arr, last, other)) last = other;
        if (is_before(arr, other, dart) && (before == dart || is_before(arr, before, other))) before = other;
    }
    return before != dart ? before : last;
}

/** By how much a dart turns to the left along the surface between its ends. */
static double dart_turning(const arrangement *arr, uint32_t dart)
{
    const qm_curve *curve = &arr->layout->curves[dart / 2];
    qm_vec before = {0, 0, 0}, normal = arr->normal[qm_layout_dart_start(arr->layout, dart)];
    double sum = 0.0;
    for (size_t k = 1; k < curve->point_count; k++) {
        qm_vec here = qm_vec_load(dart_point(curve, dart, k - 1));
        qm_vec segment = qm_vec_sub(qm_vec_load(dart_point(curve, dart, k)), here);
        if (qm_vec_norm2(segment) == 0.0) continue;
        if (qm_vec_norm2(before) > 0.0) {
            qm_vec own = surface_normal(arr->surface, dart_point(curve, dart, k - 1));
            bool is_flipped = arr->surface->is_cloud && qm_vec_dot(own, normal) < 0.0;
            if (qm_vec_norm2(own) > 0.0) normal = is_flipped ? qm_vec_scale(-1.0, own) : own;
            sum += atan2(qm_vec_dot(qm_vec_cross(before, segment), normal), qm_vec_dot(before, segment));
        }
        before = segment;
    }
    return sum;
}

/** The distance of the surface from a place, in steps. */
static double clearance(const arrangement *arr, qm_vec from, qm_vec way, double step)
{
    double at[3];
    qm_ref_surface_point nearest;
    qm_vec_store(at, qm_vec_axpy(from, step, way));
    qm_ref_surface_project(arr->surface, at, &nearest);
    return nearest.distance / step;
}

/** True if the mesh has a boundary within a step of a place. A thin rim looks like one, but its edges have two faces. */
static bool is_at_boundary(const arrangement *arr, qm_vec at, double step)
{
    double box[6];
    qm_vec_store(box, qm_vec_sub(at, (qm_vec){step, step, step}));
    qm_vec_store(box + 3, qm_vec_add(at, (qm_vec){step, step, step}));
    const qm_features_options options = {
        .angle = 180.0, .shortest = SHORTEST_BOUNDARY * arr->surface->diagonal, .box = box};
    qm_features found;
    /* Without memory a cell stays one. */
    if (qm_features_find(arr->ctx, &arr->surface->bvh->mesh, &options, &found) != QM_OK) return false;
    bool has_boundary = found.edge_count > 0;
    qm_features_reset(arr->ctx, &found);
    return has_boundary;
}

/**
 * True if a mesh ends at the middle of a dart: round the dart it has one sheet alone, on its right. At an angle from the sheet a place one
 * step away is the sine of that away from it; another sheet would be nearer to one of the places, which are RING_TURN apart. A thin rim
 * looks so, too: with looks_it_up the mesh tells.
 */
static bool has_nothing_on_left(const arrangement *arr, uint32_t dart, bool looks_it_up)
{
    const qm_curve *curve = &arr->layout->curves[dart / 2];
    size_t k = (curve->point_count - 1) / 2;
    qm_vec a = qm_vec_load(dart_point(curve, dart, k)), b = qm_vec_load(dart_point(curve, dart, k + 1));
    double at[3], length = qm_vec_distance(a, b), step = RING_STEP * length;
    qm_vec middle = qm_vec_mix(a, b, 0.5);
    qm_vec_store(at, middle);
    if (!(length > 0.0)) return false;
    qm_vec along = qm_vec_scale(1.0 / length, qm_vec_sub(b, a)), up = surface_normal(arr->surface, at),
           left = qm_vec_cross(up, along);
    double norm = qm_vec_norm(left);
    if (!(norm > 0.0)) return false;
    left = qm_vec_scale(1.0 / norm, left);
    up = qm_vec_cross(along, left);
    if (clearance(arr, middle, left, step) < CLEAR || clearance(arr, middle, left, -step) > 1.0 - CLEAR)
        return false;
    for (double turn = RING_TURN; turn < 0.5 * FULL_TURN - 0.5 * RING_TURN; turn += RING_TURN)
        for (int side = -1; side <= 1; side += 2) {
            qm_vec way = qm_vec_axpy(qm_vec_scale(cos(turn), left), side * sin(turn), up);
            double free = turn <= 0.25 * FULL_TURN ? 1.0 : sin(turn);
            if (clearance(arr, middle, way, step) < CLEAR * free) return false;
        }
    return !looks_it_up || is_at_boundary(arr, middle, step);
}

/** True if a cell lies beyond the boundary of an open mesh: most of what is round it has the surface on its right alone. The mesh is
 * asked last, as that takes long. */
static bool is_beyond(const arrangement *arr, const uint32_t *dart, uint32_t sides)
{
    for (int looks_it_up = 0; looks_it_up < 2; looks_it_up++) {
        double open = 0.0, closed = 0.0, around = 0.0;
        for (uint32_t k = 0; k < sides; k++)
            around += qm_layout_curve_length(&arr->layout->curves[dart[k] / 2]);
        for (uint32_t k = 0; k < sides && open < BEYOND * around; k++) {
            double length = qm_layout_curve_length(&arr->layout->curves[dart[k] / 2]);
            *(has_nothing_on_left(arr, dart[k], looks_it_up) ? &open : &closed) += length;
            if (closed > (1.0 - BEYOND) * around) return false;
        }
    }
    return true;
}

/**
 * True if a cell encloses a drawing from outside. By Gauss and Bonnet the curvature of a cell is the sum of its corners
 * and a full turn, less a straight angle a side and what the sides turn towards it: about 0 in a flat cell, half of that of
 * a whole closed surface in the end of a limb, nearly all of it outside a small drawing. Three quarters decide.
 */
static bool is_outside(const arrangement *arr, const uint32_t *dart, uint32_t sides, double corners)
{
    double curvature = FULL_TURN + corners - 0.5 * FULL_TURN * sides;
    if (curvature < 0.5 * FULL_TURN) return false; /* sides that are not bent into hooks do not change that */
    for (uint32_t k = 0; k < sides; k++)
        curvature -= dart_turning(arr, dart[k]);
    return curvature > 1.5 * FULL_TURN;
}

/** Traces the cell left of a dart, and appends it. */
static void trace_cell(const arrangement *arr, uint32_t first, qm_layout_cells *out)
{
    qm_layout_cell *cell = &out->cells[out->count];
    *cell = (qm_layout_cell){.first = out->count > 0 ? cell[-1].first + cell[-1].sides : 0};
    double sum = 0.0;
    uint32_t dart = first;
    do {
        size_t side = cell->first + cell->sides++;
        QM_ASSERT(side < arr->dart_count);
        out->dart[side] = dart;
        out->of_dart[dart] = (uint32_t)out->count;
        /* The anticlockwise angle from the next dart of the node to this one reversed, in (0, 2 pi]: 2 pi to itself. */
        uint32_t to = dart ^ 1, next = arr->next[dart];
        double angle = arr->angle[to] - arr->angle[next];
        if (angle < 0.0 || (angle == 0.0 && to <= next)) angle += FULL_TURN;
        sum += angle;
        out->corner[next] = angle;
        dart = next;
    } while (dart != first);
    cell->is_outside = is_outside(arr, out->dart + cell->first, cell->sides, sum) ||
                       (!arr->surface->is_cloud && is_beyond(arr, out->dart + cell->first, cell->sides));
    out->count++;
}

/** Appends a cell with four sides to the patches, reports any other as an issue. */
static qm_status store_cell(qm_context *ctx, qm_layout *layout, const qm_layout_cells *cells,
                            const qm_layout_cell *cell, qm_layout_issues *out)
{
    const uint32_t *dart = cells->dart + cell->first;
    if (cell->is_outside) return QM_OK;
    if (qm_layout_cell_is_patch(cell)) {
        qm_layout_patch patch;
        for (int k = 0; k < 4; k++) {
            patch.side[k] = dart[k] / 2;
            patch.against[k] = dart[k] % 2;
        }
        return qm_layout_append_patch(ctx, layout, &patch);
    }
    const qm_curve *curve = &layout->curves[dart[0] / 2];
    qm_layout_issue issue = {.fault = QM_LAYOUT_CELL_SIDES,
                             .curve = {curve->id, QM_NO_INDEX},
                             .node = qm_layout_dart_start(layout, dart[0]),
                             .sides = cell->sides};
    memcpy(issue.position, curve->points + 3 * (curve->point_count / 2), POINT_SIZE);
    return qm_layout_add_issue(ctx, out, &issue);
}

static qm_status report_dangling(qm_context *ctx, const qm_layout *layout, const qm_layout_cells *cells,
                                 qm_layout_issues *out)
{
    for (uint32_t dart = 0; dart < 2 * layout->curve_count; dart++) {
        uint32_t node = qm_layout_dart_start(layout, dart);
        if (cells->first_at[node + 1] - cells->first_at[node] != 1) continue;
        qm_layout_issue issue = {.fault = QM_LAYOUT_DANGLING_END,
                                 .curve = {layout->curves[dart / 2].id, QM_NO_INDEX},
                                 .node = node};
        memcpy(issue.position, layout->nodes + 3 * (size_t)node, POINT_SIZE);
        qm_status status = qm_layout_add_issue(ctx, out, &issue);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

static void join_roots(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = find_root(parent, a);
    b = find_root(parent, b);
    parent[a > b ? a : b] = a > b ? b : a;
}

/** Joins the vertices of each face. */
static void join_faces(const qm_mesh *mesh, uint32_t *parent)
{
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        parent[i] = i;
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        if (mesh->faces[i] != QM_NO_INDEX) join_roots(parent, mesh->faces[i & ~(size_t)3], mesh->faces[i]);
}

/** True if the faces have several components. */
static bool has_several(const qm_mesh *mesh, uint32_t *parent)
{
    uint32_t first = QM_NO_INDEX;
    for (size_t i = 0; i < mesh->face_count; i++) {
        uint32_t root = find_root(parent, mesh->faces[4 * i]);
        if (first != QM_NO_INDEX && root != first) return true;
        first = root;
    }
    return false;
}

/** The component of the mesh under each node, by its lowest vertex. */
static qm_status find_components(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                                 uint32_t *parent, uint32_t *own)
{
    const qm_projection nearest = {.face = own};
    qm_status status = qm_project_points(ctx, surface->bvh, QM_QUADS_TRIANGLES, layout->nodes,
                                         layout->node_count, 1, &nearest);
    for (size_t i = 0; i < layout->node_count && status == QM_OK; i++)
        own[i] = find_root(parent, surface->bvh->mesh.faces[4 * (size_t)own[i]]);
    return status;
}

/** Reports the parts of a drawing, by their first nodes, but for the first one on each component of the mesh. */
static qm_status report_parts(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                              const qm_layout_cells *cells, uint32_t *parent, qm_layout_issues *out)
{
    const qm_mesh *mesh = &surface->bvh->mesh;
    size_t nodes = layout->node_count, vertices = mesh->vertex_count;
    uint32_t *vertex = qm_context_alloc(ctx, vertices, sizeof *vertex);
    uint32_t *own = qm_context_alloc(ctx, nodes, sizeof *own);
    bool *is_drawn_on = qm_context_alloc(ctx, vertices, sizeof *is_drawn_on); /* of components */
    qm_status status = QM_OK;
    if (vertex && own && is_drawn_on) {
        memset(own, 0, nodes * sizeof *own);
        memset(is_drawn_on, 0, vertices * sizeof *is_drawn_on);
        join_faces(mesh, vertex);
        if (has_several(mesh, vertex)) status = find_components(ctx, surface, layout, vertex, own);
    } else {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the parts of the layout");
    }
    for (uint32_t i = 0; i < nodes && status == QM_OK; i++) {
        bool has_curve = cells->first_at[i + 1] > cells->first_at[i];
        if (find_root(parent, i) != i || !has_curve) continue;
        bool is_first = !is_drawn_on[own[i]];
        is_drawn_on[own[i]] = true;
        if (is_first) continue;
        qm_layout_issue issue = {.fault = QM_LAYOUT_APART,
                                 .curve = {layout->curves[cells->at[cells->first_at[i]] / 2].id, QM_NO_INDEX},
                                 .node = i};
        memcpy(issue.position, layout->nodes + 3 * (size_t)i, POINT_SIZE);
        status = qm_layout_add_issue(ctx, out, &issue);
    }
    qm_context_free(ctx, vertex, vertices, sizeof *vertex);
    qm_context_free(ctx, own, nodes, sizeof *own);
    qm_context_free(ctx, is_drawn_on, vertices, sizeof *is_drawn_on);
    return status;
}

/**
 * Reports each part of the drawing that no curve connects with another one on the same component of a mesh: the cell between
 * them has two borders, and is none of those that were traced. On a point set, whose components nobody knows, it reports
 * nothing.
 */
static qm_status report_apart(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                              const qm_layout_cells *cells, qm_layout_issues *out)
{
    size_t nodes = layout->node_count, parts = 0;
    if (surface->is_cloud) return QM_OK;
    uint32_t *parent = qm_context_alloc(ctx, nodes, sizeof *parent);
    if (!parent) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the parts of the layout");
    for (uint32_t i = 0; i < nodes; i++)
        parent[i] = i;
    for (size_t i = 0; i < layout->curve_count; i++)
        join_roots(parent, layout->curves[i].from, layout->curves[i].to);
    for (uint32_t i = 0; i < nodes; i++)
        parts += find_root(parent, i) == i;
    qm_status status = parts > 1 ? report_parts(ctx, surface, layout, cells, parent, out) : QM_OK;
    qm_context_free(ctx, parent, nodes, sizeof *parent);
    return status;
}

/** Lists the darts of each node. */
static void list_darts(const qm_layout *layout, qm_layout_cells *out)
{
    memset(out->first_at, 0, (out->node_count + 1) * sizeof *out->first_at);
    for (uint32_t dart = 0; dart < out->dart_count; dart++)
        out->first_at[qm_layout_dart_start(layout, dart)]++;
    for (size_t i = 0; i < out->node_count; i++)
        out->first_at[i + 1] += out->first_at[i];
    for (uint32_t dart = (uint32_t)out->dart_count; dart-- > 0;)
        out->at[--out->first_at[qm_layout_dart_start(layout, dart)]] = dart;
}

static qm_status find_cells(qm_context *ctx, arrangement *arr, qm_layout_cells *out)
{
    for (uint32_t node = 0; node < arr->layout->node_count; node++)
        arr->normal[node] = (qm_vec){0, 0, 0};
    for (uint32_t node = 0; node < arr->layout->node_count; node++)
        if (qm_vec_norm2(arr->normal[node]) == 0.0) propagate_normals(arr, node);
    for (uint32_t node = 0; node < arr->layout->node_count; node++) {
        if (node % NODES_A_POLL == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled");
        measure_angles(arr, node);
    }
    for (uint32_t dart = 0; dart < arr->dart_count; dart++) {
        arr->next[dart] = next_clockwise(arr, dart ^ 1);
        out->of_dart[dart] = QM_NO_INDEX;
    }
    for (uint32_t dart = 0; dart < arr->dart_count; dart++)
        if (out->of_dart[dart] == QM_NO_INDEX) trace_cell(arr, dart, out);
    for (uint32_t dart = 0; dart < arr->dart_count; dart++)
        if (out->of_dart[dart] == out->of_dart[dart ^ 1])
            out->cells[out->of_dart[dart]].is_on_both_sides = true;
    return QM_OK;
}

static bool alloc_cells(qm_context *ctx, size_t darts, size_t nodes, qm_layout_cells *out)
{
    *out = (qm_layout_cells){.dart_count = darts, .node_count = nodes};
    out->cells = qm_context_alloc(ctx, darts, sizeof *out->cells);
    out->dart = qm_context_alloc(ctx, darts, sizeof *out->dart);
    out->of_dart = qm_context_alloc(ctx, darts, sizeof *out->of_dart);
    out->corner = qm_context_alloc(ctx, darts, sizeof *out->corner);
    out->normal = qm_context_alloc(ctx, nodes, sizeof *out->normal);
    out->first_at = qm_context_alloc(ctx, nodes + 1, sizeof *out->first_at);
    out->at = qm_context_alloc(ctx, darts, sizeof *out->at);
    return out->cells && out->dart && out->of_dart && out->corner && out->normal && out->first_at && out->at;
}

void qm_layout_cells_reset(qm_context *ctx, qm_layout_cells *cells)
{
    qm_context_free(ctx, cells->cells, cells->dart_count, sizeof *cells->cells);
    qm_context_free(ctx, cells->dart, cells->dart_count, sizeof *cells->dart);
    qm_context_free(ctx, cells->of_dart, cells->dart_count, sizeof *cells->of_dart);
    qm_context_free(ctx, cells->corner, cells->dart_count, sizeof *cells->corner);
    qm_context_free(ctx, cells->normal, cells->node_count, sizeof *cells->normal);
    qm_context_free(ctx, cells->first_at, cells->node_count + 1, sizeof *cells->first_at);
    qm_context_free(ctx, cells->at, cells->dart_count, sizeof *cells->at);
    *cells = (qm_layout_cells){0};
}

qm_status qm_layout_find_cells(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                               qm_layout_cells *out)
{
    QM_ASSERT(ctx && surface && layout && out && layout->curve_count > 0);
    size_t nodes = layout->node_count, darts = 2 * layout->curve_count;
    arrangement arr = {.ctx = ctx, .surface = surface, .layout = layout, .dart_count = darts};
    arr.queue = qm_context_alloc(ctx, nodes, sizeof *arr.queue);
    arr.angle = qm_context_alloc(ctx, darts, sizeof *arr.angle);
    arr.next = qm_context_alloc(ctx, darts, sizeof *arr.next);
    qm_status status = QM_OK;
    bool has_cells = alloc_cells(ctx, darts, nodes, out);
    arr.normal = out->normal;
    arr.first_at = out->first_at;
    arr.at = out->at;
    if (has_cells && arr.queue && arr.angle && arr.next) {
        list_darts(layout, out);
        status = find_cells(ctx, &arr, out);
    } else {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the arrangement of the layout");
    }
    qm_context_free(ctx, arr.queue, nodes, sizeof *arr.queue);
    qm_context_free(ctx, arr.angle, darts, sizeof *arr.angle);
    qm_context_free(ctx, arr.next, darts, sizeof *arr.next);
    if (status != QM_OK) qm_layout_cells_reset(ctx, out);
    return status;
}

qm_status qm_layout_find_patches(qm_context *ctx, const qm_ref_surface *surface, qm_layout *layout,
                                 qm_layout_issues *out)
{
    QM_ASSERT(ctx && surface && layout && out);
    *out = (qm_layout_issues){0};
    qm_layout_clear_patches(ctx, layout);
    if (layout->curve_count == 0) return QM_OK;
    qm_layout_cells cells;
    qm_status status = qm_layout_find_cells(ctx, surface, layout, &cells);
    if (status != QM_OK) return status;
    status = report_dangling(ctx, layout, &cells, out);
    if (status == QM_OK) status = report_apart(ctx, surface, layout, &cells, out);
    for (size_t i = 0; i < cells.count && status == QM_OK; i++)
        status = store_cell(ctx, layout, &cells, &cells.cells[i], out);
    qm_layout_cells_reset(ctx, &cells);
    if (status == QM_OK) status = qm_layout_find_crossings(ctx, layout, surface, out);
    if (status != QM_OK) qm_layout_issues_reset(ctx, out);
    return status;
}
