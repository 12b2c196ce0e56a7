/**
 * layout_suggest.c: curves that would bring a layout nearer to completion.
 *
 * A curve is drawn into a copy of the layout for each pair of nodes that may be joined, the nearest first, and kept there if it
 * crosses nothing, so that suggestions do not cross each other.
 */
#include "qm/layout_suggest.h"

#include <string.h>

#include "core/union_find.h"
#include "layout_internal.h"

#define TRIALS 12       /* pairs that are drawn for one suggestion */
#define MANY_SIDES 6    /* cells of more are divided */
#define CUT_OFF 3       /* sides of a cell that a curve cuts off with itself as the fourth */
#define MOST_CUT_OFF 8  /* ... where no curve that cuts off three is good */
#define OTHER_COST 2.0  /* times the distance */
#define AHEAD 0.5       /* of a distance: what lies straight ahead of an end counts as so much nearer */
#define DETOUR 3.0      /* times the distance: a longer curve is not suggested */
#define ACUTE 1.75      /* radians: a corner of less is not worth dividing */
#define ACUTE_COST 3.0  /* times the distance */
#define SAME_CURVE 1e-6 /* of the diagonal: a curve that is nearer to those before is a part of one */

enum { POINT_SIZE = 3 * sizeof(double) };

typedef struct suggester {
    qm_context *ctx;
    const qm_ref_surface *surface;
    qm_layout layout; /* the copy, with the curves that are suggested */
    qm_layout_suggestions *out;
    size_t most;
} suggester;

/** A node to join another one with. */
typedef struct candidate {
    uint32_t from, to;
    double cost;
} candidate;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for suggestions");
}

static qm_vec node_at(const suggester *s, uint32_t node)
{
    return qm_vec_load(s->layout.nodes + 3 * (size_t)node);
}

static qm_status append(qm_context *ctx, qm_layout_suggestions *out, qm_layout_suggestion_kind kind,
                        uint32_t sides, const qm_curve *curve)
{
    qm_layout_suggestion *items =
        qm_context_resize(ctx, out->items, out->count, out->count + 1, sizeof *items);
    if (!items) return no_memory(ctx);
    out->items = items;
    qm_layout_suggestion *added = &items[out->count++];
    *added = (qm_layout_suggestion){.kind = kind, .mark = curve->mark, .sides = sides};
    added->points = qm_context_alloc(ctx, curve->point_count, POINT_SIZE);
    if (!added->points) return no_memory(ctx);
    added->point_count = curve->point_count;
    memcpy(added->points, curve->points, curve->point_count * POINT_SIZE);
    return QM_OK;
}

static qm_status add(suggester *s, qm_layout_suggestion_kind kind, uint32_t sides, const qm_curve *curve)
{
    return append(s->ctx, s->out, kind, sides, curve);
}

/** Puts a candidate among the best, which are sorted by cost. */
static void consider(candidate best[TRIALS], size_t *count, candidate tried)
{
    size_t place = *count < TRIALS ? (*count)++ : TRIALS;
    for (; place > 0 && best[place - 1].cost > tried.cost; place--)
        if (place < TRIALS) best[place] = best[place - 1];
    if (place < TRIALS) best[place] = tried;
}

static bool are_joined(const qm_layout *layout, uint32_t a, uint32_t b)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if ((layout->curves[i].from == a && layout->curves[i].to == b) ||
            (layout->curves[i].from == b && layout->curves[i].to == a))
            return true;
    return false;
}

/** Draws the candidates in turn, and suggests the first that crosses nothing. */
static qm_status try_candidates(suggester *s, qm_layout_suggestion_kind kind, uint32_t sides,
                                const candidate best[TRIALS], size_t count)
{
    qm_status status = QM_OK;
    for (size_t i = 0; i < count && status == QM_OK && s->out->count < s->most; i++) {
        size_t crossings;
        if (qm_context_canceled(s->ctx))
            return qm_context_fail(s->ctx, QM_E_CANCELED, "suggestions canceled");
        status =
            qm_layout_draw_curve(s->ctx, &s->layout, s->surface, best[i].from, best[i].to, (qm_vec){0, 0, 0});
        if (status == QM_OK) status = qm_layout_count_crossings(s->ctx, &s->layout, s->surface, &crossings);
        uint32_t last = (uint32_t)s->layout.curve_count - 1;
        if (status != QM_OK) return status;
        double distance = qm_vec_distance(node_at(s, best[i].from), node_at(s, best[i].to));
        bool is_good = crossings == 0 &&
                       !qm_layout_runs_along(&s->layout, SAME_CURVE * s->surface->diagonal) &&
                       qm_layout_curve_length(&s->layout.curves[last]) <= DETOUR * distance;
        if (is_good) return add(s, kind, sides, &s->layout.curves[last]);
        status = qm_layout_remove_curve(s->ctx, &s->layout, last);
    }
    return status;
}

/* ---- features ---- */

/** True if a curve of a layout to which features were added is part of one that was there before. */
static bool was_there(const suggester *s, const qm_layout *before, const qm_curve *curve)
{
    if (curve->id < before->next_id) return true;
    double middle[3], nearest = INFINITY;
    size_t k = curve->point_count / 2;
    qm_vec_store(middle,
                 qm_vec_mix(qm_vec_load(curve->points + 3 * k), qm_vec_load(curve->points + 3 * k - 3), 0.5));
    for (size_t i = 0; i < before->curve_count; i++)
        nearest = fmin(nearest, qm_layout_nearest_position(&before->curves[i], middle).distance);
    return nearest <= SAME_CURVE * s->surface->diagonal;
}

static qm_status suggest_features(suggester *s, const qm_layout *before,
                                  const qm_layout_features_options *options)
{
    size_t added;
    qm_layout with;
    if (s->surface->is_cloud) return QM_OK;
    qm_status status = qm_layout_copy(s->ctx, before, &with);
    if (status != QM_OK) return status;
    status = qm_layout_add_features(s->ctx, &with, s->surface, options, &added);
    for (size_t i = 0; i < with.curve_count && status == QM_OK && s->out->count < s->most; i++)
        if (!was_there(s, before, &with.curves[i])) status = add(s, QM_SUGGEST_FEATURE, 0, &with.curves[i]);
    qm_layout_reset(s->ctx, &with);
    return status;
}

/* ---- ends ---- */

/** Joins the end of a curve, alone at its node, with a node of its cell. */
static qm_status suggest_from_end(suggester *s, const qm_layout_cells *cells, uint32_t node, uint32_t dart)
{
    const qm_layout_cell *cell = &cells->cells[cells->of_dart[dart]];
    candidate best[TRIALS];
    size_t count = 0;
    /* The direction away from the curve. */
    qm_vec ahead = qm_vec_scale(-1.0, qm_layout_leaving_direction(&s->layout.curves[dart / 2], dart % 2));
    for (uint32_t k = 0; k < cell->sides; k++) {
        uint32_t other = qm_layout_dart_start(&s->layout, cells->dart[cell->first + k]);
        if (other == node || are_joined(&s->layout, node, other)) continue;
        qm_vec way = qm_vec_sub(node_at(s, other), node_at(s, node));
        double distance = qm_vec_norm(way);
        if (!(distance > 0.0)) continue;
        double cosine = qm_vec_dot(ahead, way) / distance;
        bool is_there = false;
        for (size_t i = 0; i < count; i++)
            is_there |= best[i].to == other;
        if (!is_there) consider(best, &count, (candidate){node, other, distance * (1.0 - AHEAD * cosine)});
    }
    return try_candidates(s, QM_SUGGEST_END, 0, best, count);
}

static qm_status suggest_ends(suggester *s)
{
    qm_layout_cells cells;
    qm_status status = qm_layout_find_cells(s->ctx, s->surface, &s->layout, &cells);
    if (status != QM_OK) return status;
    uint32_t darts = 2 * (uint32_t)s->layout.curve_count;
    for (uint32_t dart = 0; dart < darts && status == QM_OK && s->out->count < s->most; dart++) {
        uint32_t node = qm_layout_dart_start(&s->layout, dart);
        if (qm_layout_node_degree(&s->layout, node) == 1) status = suggest_from_end(s, &cells, node, dart);
    }
    qm_layout_cells_reset(s->ctx, &cells);
    return status;
}

/* ---- parts ---- */

/** Joins each part that is reported as apart with the nearest node of another part. */
static qm_status suggest_joins(suggester *s, const qm_layout_issues *issues)
{
    size_t nodes = s->layout.node_count;
    uint32_t *parent = qm_context_alloc(s->ctx, nodes, sizeof *parent);
    if (!parent) return no_memory(s->ctx);
    for (uint32_t i = 0; i < nodes; i++)
        parent[i] = i;
    for (size_t i = 0; i < s->layout.curve_count; i++)
        qm_union_find_join(parent, s->layout.curves[i].from, s->layout.curves[i].to);
    qm_status status = QM_OK;
    for (size_t k = 0; k < issues->count && status == QM_OK && s->out->count < s->most; k++) {
        candidate best[TRIALS];
        size_t count = 0, before = s->out->count;
        if (issues->items[k].fault != QM_LAYOUT_APART) continue;
        uint32_t root = qm_union_find_root(parent, issues->items[k].node);
        for (uint32_t a = 0; a < nodes; a++)
            for (uint32_t b = 0; b < nodes && qm_union_find_root(parent, a) == root; b++)
                if (qm_union_find_root(parent, b) != root)
                    consider(best, &count, (candidate){a, b, qm_vec_distance(node_at(s, a), node_at(s, b))});
        status = try_candidates(s, QM_SUGGEST_JOIN, 0, best, count);
        const qm_curve *last = &s->layout.curves[s->layout.curve_count - 1];
        if (s->out->count > before) qm_union_find_join(parent, last->from, last->to);
    }
    qm_context_free(s->ctx, parent, nodes, sizeof *parent);
    return status;
}

/* ---- cells ---- */

/** What joining two corners of a cell, so many sides apart, costs. */
static double division_cost(const suggester *s, const qm_layout_cells *cells, const uint32_t dart[2],
                            uint32_t apart)
{
    double cost = qm_vec_distance(node_at(s, qm_layout_dart_start(&s->layout, dart[0])),
                                  node_at(s, qm_layout_dart_start(&s->layout, dart[1])));
    for (int k = 0; k < 2; k++)
        if (cells->corner[dart[k]] < ACUTE) cost *= ACUTE_COST;
    return apart == CUT_OFF ? cost : OTHER_COST * cost;
}

/** Cuts four sides off a cell with many, or more where that is much shorter. */
static qm_status suggest_division(suggester *s, const qm_layout_cells *cells, const qm_layout_cell *cell)
{
    candidate best[TRIALS];
    size_t count = 0;
    for (uint32_t k = 0; k < cell->sides; k++) {
        for (uint32_t apart = CUT_OFF; apart + CUT_OFF <= cell->sides && apart <= MOST_CUT_OFF; apart++) {
            const uint32_t dart[2] = {cells->dart[cell->first + k],
                                      cells->dart[cell->first + (k + apart) % cell->sides]};
            uint32_t from = qm_layout_dart_start(&s->layout, dart[0]),
                     to = qm_layout_dart_start(&s->layout, dart[1]);
            if (from == to || are_joined(&s->layout, from, to)) continue;
            consider(best, &count, (candidate){from, to, division_cost(s, cells, dart, apart)});
        }
    }
    return try_candidates(s, QM_SUGGEST_DIVIDE, cell->sides, best, count);
}

/** True if a curve ends in a cell. */
static bool has_end(const suggester *s, const qm_layout_cells *cells, const qm_layout_cell *cell)
{
    for (uint32_t k = 0; k < cell->sides; k++)
        if (qm_layout_node_degree(&s->layout,
                                  qm_layout_dart_start(&s->layout, cells->dart[cell->first + k])) == 1)
            return true;
    return false;
}

static qm_status suggest_divisions(suggester *s)
{
    qm_layout_cells cells;
    qm_status status = qm_layout_find_cells(s->ctx, s->surface, &s->layout, &cells);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < cells.count && status == QM_OK && s->out->count < s->most; i++) {
        const qm_layout_cell *cell = &cells.cells[i];
        if (cell->sides <= MANY_SIDES || cell->is_outside || has_end(s, &cells, cell)) continue;
        status = suggest_division(s, &cells, cell);
    }
    qm_layout_cells_reset(s->ctx, &cells);
    return status;
}

static qm_status suggest_curves(suggester *s)
{
    qm_layout_issues issues;
    qm_status status = qm_layout_find_patches(s->ctx, s->surface, &s->layout, &issues);
    if (status != QM_OK) return status;
    if (issues.count > 0) status = suggest_ends(s);
    if (status == QM_OK) status = suggest_joins(s, &issues);
    if (status == QM_OK && issues.count > 0) status = suggest_divisions(s);
    qm_layout_issues_reset(s->ctx, &issues);
    return status;
}

qm_status qm_layout_suggest(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                            const qm_layout_features_options *options, size_t most,
                            qm_layout_suggestions *out)
{
    QM_ASSERT(ctx && layout && surface && options && most > 0 && out);
    *out = (qm_layout_suggestions){0};
    suggester s = {.ctx = ctx, .surface = surface, .out = out, .most = most};
    qm_status status = suggest_features(&s, layout, options);
    if (status == QM_OK && out->count == 0 && layout->curve_count > 0) {
        status = qm_layout_copy(ctx, layout, &s.layout);
        if (status == QM_OK) status = suggest_curves(&s);
        qm_layout_reset(ctx, &s.layout);
    }
    if (status != QM_OK) qm_layout_suggestions_reset(ctx, out);
    return status;
}

/* ---- mirror images ---- */

/** True if a curve has places on both sides of a plane, farther from it than the radius, or none. */
static bool lies_across(const qm_curve *curve, const double point[3], const double normal[3], double radius)
{
    double low = 0.0, high = 0.0;
    qm_vec n = qm_vec_load(normal), from = qm_vec_load(point);
    n = qm_vec_scale(1.0 / qm_vec_norm(n), n);
    for (size_t k = 0; k < curve->point_count; k++) {
        double height = qm_vec_dot(qm_vec_sub(qm_vec_load(curve->points + 3 * k), from), n);
        low = fmin(low, height);
        high = fmax(high, height);
    }
    return (low < -radius) == (high > radius);
}

qm_status qm_layout_suggest_images(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                   const double point[3], const double normal[3], double radius, size_t most,
                                   qm_layout_suggestions *out)
{
    QM_ASSERT(ctx && layout && surface && point && normal && radius > 0.0 && most > 0 && out);
    qm_status status = QM_OK;
    *out = (qm_layout_suggestions){0};
    for (size_t i = 0; i < layout->curve_count && out->count < most && status == QM_OK; i++) {
        const qm_curve *curve = &layout->curves[i];
        bool is_reversed;
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "suggestions canceled");
        if (status != QM_OK || lies_across(curve, point, normal, radius) ||
            qm_layout_find_image_curve(layout, surface, point, normal, curve->id, radius, &is_reversed) !=
                QM_NO_INDEX)
            continue;
        status = append(ctx, out, QM_SUGGEST_IMAGE, 0, curve);
        if (status != QM_OK) break;
        qm_layout_suggestion *added = &out->items[out->count - 1];
        qm_layout_reflect(surface, point, normal, added->points, added->point_count);
        const uint32_t node[2] = {
            qm_layout_find_image_node(layout, surface, point, normal, curve->from, radius),
            qm_layout_find_image_node(layout, surface, point, normal, curve->to, radius)};
        for (int k = 0; k < 2; k++)
            if (node[k] != QM_NO_INDEX)
                memcpy(added->points + (k == 0 ? 0 : 3 * (added->point_count - 1)),
                       layout->nodes + 3 * (size_t)node[k], POINT_SIZE);
    }
    if (status != QM_OK) qm_layout_suggestions_reset(ctx, out);
    return status;
}

void qm_layout_suggestions_reset(qm_context *ctx, qm_layout_suggestions *suggestions)
{
    for (size_t i = 0; i < suggestions->count; i++)
        qm_context_free(ctx, suggestions->items[i].points, suggestions->items[i].point_count, POINT_SIZE);
    qm_context_free(ctx, suggestions->items, suggestions->count, sizeof *suggestions->items);
    *suggestions = (qm_layout_suggestions){0};
}
