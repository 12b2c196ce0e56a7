/**
 * layout_tools.c: several curves by one click or stroke: a ring round a limb, a tube between two rings, and the mirror
 * image of one side of the surface.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "layout_internal.h"
#include "layout_section.h"

#define RING_DIRECTIONS 16 /* planes through a place that are tried first */
#define RING_ROUNDS 4      /* each halves the angle to the next plane */
#define MAX_RING 64        /* curves of a ring */

enum { POINT_SIZE = 3 * sizeof(double) };

/* ---- rings ---- */

/** The shortest ring through a place, of planes along the surface's normal there. Empty if none returns. */
static qm_status shortest_ring(qm_context *ctx, const qm_ref_surface *surface,
                               const qm_ref_surface_point *through, qm_section *out)
{
    qm_vec at = qm_vec_load(through->position), normal = qm_vec_load(through->normal);
    if (qm_vec_norm2(normal) == 0.0) normal = (qm_vec){0, 0, 1};
    qm_vec x = qm_vec_perpendicular(normal);
    x = qm_vec_scale(1.0 / qm_vec_norm(x), x);
    qm_vec y = qm_vec_cross(normal, x);
    double best = INFINITY, angle = 0.0, step = QM_STRAIGHT_ANGLE / RING_DIRECTIONS;
    *out = (qm_section){0};
    for (int round = 0; round <= RING_ROUNDS; round++) {
        int count = round == 0 ? RING_DIRECTIONS : 2;
        double centre = angle;
        step *= round == 0 ? 1.0 : 0.5;
        for (int k = 0; k < count; k++) {
            double tried = round == 0 ? k * step : centre + (k == 0 ? -step : step);
            qm_vec plane = qm_vec_axpy(qm_vec_scale(cos(tried), x), sin(tried), y);
            qm_section line;
            qm_status status = qm_section_ring(ctx, surface, at, plane, &line);
            if (status != QM_OK) {
                qm_section_reset(ctx, out);
                return status;
            }
            double length = line.count >= 4 ? qm_section_length(&line) : INFINITY;
            if (length < best) {
                best = length;
                angle = tried;
                qm_section_reset(ctx, out);
                *out = line;
            } else {
                qm_section_reset(ctx, &line);
            }
        }
    }
    return QM_OK;
}

qm_status qm_layout_add_ring(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                             const double through[3], const double *plane, double radius, uint32_t *id)
{
    QM_ASSERT(ctx && layout && surface && through && id);
    qm_ref_surface_point at;
    qm_ref_surface_project(surface, through, &at);
    qm_section line;
    qm_status status;
    if (plane) {
        double length = qm_vec_norm(qm_vec_load(plane));
        if (!(length > 0.0) || !isfinite(length))
            return qm_context_fail(ctx, QM_E_ARGUMENT, "the plane of a ring has no direction");
        status = qm_section_ring(ctx, surface, qm_vec_load(at.position),
                                 qm_vec_scale(1.0 / length, qm_vec_load(plane)), &line);
    } else {
        status = shortest_ring(ctx, surface, &at, &line);
    }
    if (status != QM_OK) return status;
    status = line.count >= 4
                 ? qm_layout_add_stroke(ctx, layout, surface, line.points, line.count, radius, id)
                 : qm_context_fail(ctx, QM_E_ARGUMENT,
                                   "no plane through the place cuts the surface in a closed curve");
    qm_section_reset(ctx, &line);
    return status;
}

/* ---- tubes ---- */

/** The nodes of the ring that a curve belongs to: at each node it goes on with the curve that leaves most nearly straight.
 * Returns their number, 0 if they do not return. */
static uint32_t ring_nodes(const qm_layout *layout, uint32_t index, uint32_t node[MAX_RING])
{
    uint32_t start = layout->curves[index].from, at = layout->curves[index].to, count = 0;
    node[count++] = start;
    while (at != start && count < MAX_RING) {
        const qm_curve *curve = &layout->curves[index];
        qm_vec back = qm_layout_leaving_direction(curve, curve->to == at);
        uint32_t next = QM_NO_INDEX;
        double straightest = INFINITY;
        for (uint32_t i = 0; i < layout->curve_count; i++) {
            const qm_curve *other = &layout->curves[i];
            if (i == index || (other->from != at && other->to != at)) continue;
            double cosine = qm_vec_dot(back, qm_layout_leaving_direction(other, other->to == at));
            if (cosine >= straightest) continue;
            straightest = cosine;
            next = i;
        }
        if (next == QM_NO_INDEX) return 0;
        node[count++] = at;
        at = layout->curves[next].from == at ? layout->curves[next].to : layout->curves[next].from;
        index = next;
    }
    return at == start ? count : 0;
}

static qm_vec node_at(const qm_layout *layout, uint32_t node)
{
    return qm_vec_load(layout->nodes + 3 * (size_t)node);
}

/** A closed walk over curves, by its nodes. */
typedef struct loop {
    uint32_t node[MAX_RING], count;
} loop;

/** The walks that a curve is part of: the ring that it goes on straight along, and the borders of the cells on both sides.
 * Returns their number. */
static int find_loops(const qm_layout *layout, const qm_layout_cells *cells, uint32_t index, loop found[3])
{
    int count = 0;
    found[0].count = ring_nodes(layout, index, found[0].node);
    count += found[0].count >= 2;
    for (uint32_t side = 0; side < 2; side++) {
        const qm_layout_cell *cell = &cells->cells[cells->of_dart[2 * index + side]];
        if (cell->sides < 2 || cell->sides > MAX_RING || cell->is_on_both_sides) continue;
        for (uint32_t k = 0; k < cell->sides; k++)
            found[count].node[k] = qm_layout_dart_start(layout, cells->dart[cell->first + k]);
        found[count++].count = cell->sides;
    }
    return count;
}

/** A pairing of the nodes of two loops of equal length: node i of the first with node shift + i, or shift - i, of the second. */
typedef struct pairing {
    const loop *first, *second;
    uint32_t shift;
    bool is_reversed;
    double sum; /* of the squared distances */
} pairing;

static uint32_t partner_of(const pairing *p, uint32_t i)
{
    uint32_t count = p->first->count;
    return p->second->node[(p->is_reversed ? p->shift + count - i : p->shift + i) % count];
}

/** Replaces the pairing by a better one of two loops, which have no node in common. */
static void pair_loops(const qm_layout *layout, const loop *first, const loop *second, pairing *best)
{
    if (first->count != second->count) return;
    for (uint32_t i = 0; i < first->count; i++)
        for (uint32_t k = 0; k < second->count; k++)
            if (first->node[i] == second->node[k]) return;
    for (uint32_t turn = 0; turn < 2 * first->count; turn++) {
        pairing tried = {first, second, turn / 2, turn % 2, 0.0};
        for (uint32_t i = 0; i < first->count; i++) {
            double length =
                qm_vec_distance(node_at(layout, first->node[i]), node_at(layout, partner_of(&tried, i)));
            tried.sum += length * length;
        }
        if (tried.sum < best->sum) *best = tried;
    }
}

static qm_status add_tube(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface, const pairing *p)
{
    qm_status status = QM_OK;
    for (uint32_t i = 0; i < p->first->count && status == QM_OK; i++) {
        status = qm_layout_draw_curve(ctx, layout, surface, p->first->node[i], partner_of(p, i),
                                      (qm_vec){0, 0, 0});
    }
    return status;
}

qm_status qm_layout_add_tube(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                             uint32_t first, uint32_t second)
{
    QM_ASSERT(ctx && layout && surface);
    const uint32_t id[2] = {first, second};
    loop loops[2][3];
    int count[2];
    uint32_t index[2];
    for (int k = 0; k < 2; k++) {
        index[k] = qm_layout_find_curve(layout, id[k]);
        if (index[k] == QM_NO_INDEX)
            return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id[k]);
    }
    qm_layout_cells cells;
    qm_status status = qm_layout_find_cells(ctx, surface, layout, &cells);
    if (status != QM_OK) return status;
    for (int k = 0; k < 2; k++)
        count[k] = find_loops(layout, &cells, index[k], loops[k]);
    qm_layout_cells_reset(ctx, &cells);
    pairing best = {.sum = INFINITY};
    for (int a = 0; a < count[0]; a++)
        for (int b = 0; b < count[1]; b++)
            pair_loops(layout, &loops[0][a], &loops[1][b], &best);
    if (!best.first)
        return qm_context_fail(
            ctx, QM_E_ARGUMENT,
            "curves %u and %u belong to no rings or cells with equally many nodes, none of them in "
            "common",
            first, second);
    qm_layout copy;
    status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_finish_edit(ctx, layout, &copy, add_tube(ctx, &copy, surface, &best));
}

qm_status qm_layout_add_link(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface, uint32_t from,
                             uint32_t to)
{
    QM_ASSERT(ctx && layout && surface);
    if (from == to) return qm_context_fail(ctx, QM_E_ARGUMENT, "node %u cannot be linked with itself", from);
    if (from >= layout->node_count || to >= layout->node_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no node %u: the layout has %zu",
                               from > to ? from : to, layout->node_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    status = qm_layout_draw_curve(ctx, &copy, surface, from, to, (qm_vec){0, 0, 0});
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}

/* ---- mirror ---- */

typedef struct mirror {
    qm_vec point, normal; /* of length 1; the side that it points to is kept */
    double radius;        /* what is nearer to the plane lies on it */
} mirror;

static double height(const mirror *m, const double p[3])
{
    return qm_vec_dot(qm_vec_sub(qm_vec_load(p), m->point), m->normal);
}

static qm_vec reflect(const mirror *m, qm_vec p)
{
    return qm_vec_axpy(p, -2.0 * qm_vec_dot(qm_vec_sub(p, m->point), m->normal), m->normal);
}

static qm_vec reflect_direction(const mirror *m, qm_vec way)
{
    return qm_vec_axpy(way, -2.0 * qm_vec_dot(way, m->normal), m->normal);
}

/** Replaces points by their mirror images, projected onto the wall that looks the mirrored way. */
static void reflect_points(const qm_ref_surface *surface, const mirror *m, double *points, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        qm_ref_surface_point at;
        qm_ref_surface_project(surface, points + 3 * i, &at);
        qm_vec own = qm_vec_load(at.normal);
        double moved[3], direction[3];
        qm_vec_store(moved, reflect(m, qm_vec_load(points + 3 * i)));
        qm_vec_store(direction, reflect_direction(m, own));
        if (qm_vec_norm2(own) > 0.0)
            qm_ref_surface_project_toward(surface, moved, direction, 0.05 * surface->diagonal, &at);
        else
            qm_ref_surface_project(surface, moved, &at);
        memcpy(points + 3 * i, at.position, POINT_SIZE);
    }
}

static mirror mirror_make(const double point[3], const double normal[3])
{
    qm_vec n = qm_vec_load(normal);
    return (mirror){.point = qm_vec_load(point), .normal = qm_vec_scale(1.0 / qm_vec_norm(n), n)};
}

void qm_layout_reflect(const qm_ref_surface *surface, const double point[3], const double normal[3],
                       double *points, size_t count)
{
    QM_ASSERT(surface && point && normal && points);
    mirror m = mirror_make(point, normal);
    reflect_points(surface, &m, points, count);
}

void qm_layout_reflect_direction(const double normal[3], double direction[3])
{
    QM_ASSERT(normal && direction);
    mirror m = mirror_make((const double[]){0, 0, 0}, normal);
    qm_vec_store(direction, reflect_direction(&m, qm_vec_load(direction)));
}

/** Least and greatest height of a curve. */
static void find_range(const mirror *m, const qm_curve *curve, double range[2])
{
    range[0] = INFINITY;
    range[1] = -INFINITY;
    for (size_t i = 0; i < curve->point_count; i++) {
        double h = height(m, curve->points + 3 * i);
        range[0] = fmin(range[0], h);
        range[1] = fmax(range[1], h);
    }
}

/** Cuts a curve where it first passes through the plane, if it has parts on both sides of it. */
static qm_status cut_at_plane(qm_context *ctx, qm_layout *layout, const mirror *m, uint32_t index,
                              qm_section *cuts)
{
    const qm_curve *curve = &layout->curves[index];
    double range[2];
    find_range(m, curve, range);
    if (range[0] >= -m->radius || range[1] <= m->radius) return QM_OK;
    for (size_t i = 0; i + 1 < curve->point_count; i++) {
        double a = height(m, curve->points + 3 * i), b = height(m, curve->points + 3 * i + 3);
        if ((a > 0.0) == (b > 0.0)) continue;
        qm_curve_position at = {.segment = i, .along = qm_layout_points_length(curve->points, i + 1)};
        qm_vec from = qm_vec_load(curve->points + 3 * i), to = qm_vec_load(curve->points + 3 * i + 3);
        qm_vec place = qm_vec_mix(from, to, a / (a - b));
        at.along += qm_vec_distance(from, place);
        qm_vec_store(at.position, place);
        if (!qm_layout_is_inside(curve, &at)) continue;
        qm_status status = qm_section_add(ctx, cuts, place);
        return status == QM_OK ? qm_layout_split_at(ctx, layout, index, &at) : status;
    }
    return QM_OK;
}

/** The mirror image of a node: itself on the plane, else a new node. */
static qm_status image_of_node(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const mirror *m, uint32_t node, uint32_t *image)
{
    if (image[node] != QM_NO_INDEX) return QM_OK;
    double at[3];
    memcpy(at, layout->nodes + 3 * (size_t)node, sizeof at);
    image[node] = node;
    if (fabs(height(m, at)) <= m->radius) return QM_OK;
    reflect_points(surface, m, at, 1);
    image[node] = (uint32_t)layout->node_count;
    qm_status status = qm_layout_add_node(ctx, layout, at);
    return status == QM_OK && qm_layout_is_corner(layout, node)
               ? qm_layout_set_corner(ctx, layout, image[node], true)
               : status;
}

static qm_status add_image(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface, const mirror *m,
                           uint32_t index, uint32_t *image)
{
    const qm_curve *curve = &layout->curves[index];
    uint32_t from = curve->from, to = curve->to;
    double range[2];
    size_t count = curve->point_count;
    find_range(m, curve, range);
    if (range[1] <= m->radius) return QM_OK; /* it lies on the plane */
    qm_status status = image_of_node(ctx, layout, surface, m, from, image);
    if (status == QM_OK) status = image_of_node(ctx, layout, surface, m, to, image);
    if (status != QM_OK) return status;
    double *points = qm_context_alloc(ctx, count, POINT_SIZE);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a curve");
    memcpy(points, curve->points, count * POINT_SIZE);
    reflect_points(surface, m, points, count);
    status = qm_layout_add_curve(ctx, layout, image[from], image[to], points, count);
    if (status == QM_OK) layout->curves[layout->curve_count - 1].mark = layout->curves[index].mark;
    qm_context_free(ctx, points, count, POINT_SIZE);
    return status;
}

/** Joins the two curves at each place where the plane has cut one. */
static qm_status join_at_cuts(qm_context *ctx, qm_layout *layout, const qm_section *cuts)
{
    qm_status status = qm_layout_remove_isolated_nodes(ctx, layout);
    for (size_t i = 0; i < cuts->count && status == QM_OK; i++) {
        uint32_t node = 0, found[2] = {QM_NO_INDEX, QM_NO_INDEX};
        while (node < layout->node_count &&
               memcmp(layout->nodes + 3 * (size_t)node, cuts->points + 3 * i, POINT_SIZE) != 0)
            node++;
        if (node == layout->node_count || qm_layout_node_degree(layout, node) != 2) continue;
        for (uint32_t k = 0; k < layout->curve_count; k++)
            if (layout->curves[k].from == node || layout->curves[k].to == node)
                found[found[0] != QM_NO_INDEX] = k;
        if (found[1] != QM_NO_INDEX) status = qm_layout_join_curves(ctx, layout, found[0], found[1], node);
    }
    return status;
}

static qm_status mirror_curves(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const mirror *m, uint32_t **image, size_t *image_count, qm_section *cuts)
{
    qm_status status = QM_OK;
    for (uint32_t i = 0; i < layout->curve_count && status == QM_OK; i++)
        status = cut_at_plane(ctx, layout, m, i, cuts);
    for (uint32_t i = (uint32_t)layout->curve_count; i-- > 0 && status == QM_OK;) {
        double range[2];
        find_range(m, &layout->curves[i], range);
        if (range[0] < -m->radius) status = qm_layout_remove_curve(ctx, layout, i);
    }
    if (status != QM_OK) return status;
    uint32_t curves = (uint32_t)layout->curve_count;
    *image_count = layout->node_count;
    *image = qm_context_alloc(ctx, *image_count, sizeof **image);
    if (!*image) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the nodes");
    for (size_t i = 0; i < *image_count; i++)
        (*image)[i] = QM_NO_INDEX;
    for (uint32_t i = 0; i < curves && status == QM_OK; i++)
        status = add_image(ctx, layout, surface, m, i, *image);
    return status == QM_OK ? join_at_cuts(ctx, layout, cuts) : status;
}

qm_status qm_layout_mirror(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                           const double point[3], const double normal[3], double radius)
{
    QM_ASSERT(ctx && layout && surface && point && normal);
    double length = qm_vec_norm(qm_vec_load(normal));
    if (!(length > 0.0) || !isfinite(length))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the plane of the mirror has no direction");
    mirror m = mirror_make(point, normal);
    m.radius = radius;
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    qm_section cuts = {0};
    uint32_t *image = NULL;
    size_t image_count = 0;
    status = mirror_curves(ctx, &copy, surface, &m, &image, &image_count, &cuts);
    if (status == QM_OK && copy.curve_count == 0)
        status = qm_context_fail(ctx, QM_E_ARGUMENT, "no curve lies on the side that the normal points to");
    qm_context_free(ctx, image, image_count, sizeof *image);
    qm_section_reset(ctx, &cuts);
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}
