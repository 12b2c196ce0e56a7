/**
 * reconstruct_atlas.c: the first parameters of the samples, found along the surface.
 *
 * A patch may hold a whole ear: points projected on its Coons patch would then lie over one another. So each
 * sample gets the patch on the side of the curve that is nearest to it along the surface, and parameters that
 * are a weighted mean of its neighbours', with the curves held fixed on the outline of the unit square. Such
 * a map does not fold (Tutte). The weights are then divided by the stretch at each neighbour, a few times, so
 * that the tip of the ear gets its share of the square.
 *
 * Sources: W. Tutte, How to draw a graph, 1963; M. Floater, Parametrization and smooth approximation of
 * surface triangulations, 1997; S. Yoshizawa, A. Belyaev, H.-P. Seidel, A fast and simple stretch-minimizing
 * mesh parameterization, 2004.
 */
#include "reconstruct_atlas.h"

#include <string.h>

#define STRETCH_ROUNDS 10
#define SWEEPS 24       /* of relaxation a round, to and fro */
#define RELAX 1.7       /* over-relaxation */
#define ALONG_CURVE 0.1 /* share of the distance that tells one side of a curve from the other */

typedef struct qm_uv {
    double u, v;
} qm_uv;

/** Links of a sample within its patch, by place in uv. */
typedef struct own_links {
    int count;
    uint32_t to[QM_GRAPH_LINKS];
    double weight[QM_GRAPH_LINKS], length2[QM_GRAPH_LINKS];
} own_links;

typedef struct atlas {
    qm_context *ctx;
    qm_reconstruction *r;
    const qm_atlas_nodes *nodes;
    qm_surface_graph graph;
    uint32_t (*beside)[2]; /* patches to the left and right of each curve */
    uint32_t *label;       /* patch of each sample, or QM_NO_INDEX */
    double *distance;      /* along the surface from the nearest curve */
    uint32_t *nearest;     /* that curve's node */
    qm_uv *uv;             /* of each sample, then of fixed nodes as single samples see them */
    double *stretch;
    own_links *link;
    size_t uv_count;
} atlas;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the parameters of samples");
}

static qm_vec node_at(const atlas *a, uint32_t i)
{
    return qm_vec_load(a->nodes->positions + 3 * (size_t)i);
}

static bool is_sample(const atlas *a, uint32_t i)
{
    return i < a->nodes->sample_count;
}

static const qm_fixed_node *fixed_node(const atlas *a, uint32_t i)
{
    return &a->nodes->fixed[i - a->nodes->sample_count];
}

/** Parameters of a point of a side: s runs from corner `side` to the next. */
static qm_uv side_uv(int side, double s)
{
    const qm_uv of[4] = {{s, 0.0}, {1.0, s}, {1.0 - s, 1.0}, {0.0, 1.0 - s}};
    return of[side];
}

/** Parameters of a fixed node in a patch; false when it has none there, or more than one pair. */
static bool fixed_uv(const atlas *a, const qm_fixed_node *node, uint32_t p, qm_uv *out)
{
    const qm_layout_patch *patch = &a->r->layout.patches[p];
    int found = 0;
    for (int k = 0; k < 4; k++) {
        if (node->curve != QM_NO_INDEX) {
            if (patch->side[k] != node->curve) continue;
            *out = side_uv(k, patch->against[k] ? 1.0 - node->t : node->t);
        } else {
            if (qm_layout_corner(&a->r->layout, patch, k) != node->corner) continue;
            *out = side_uv(k, 0.0);
        }
        found++;
    }
    return found == 1;
}

/** Patches turn anticlockwise, so that each lies to the left of the sides that run with it. */
static void find_beside(atlas *a)
{
    const qm_layout *layout = &a->r->layout;
    for (size_t i = 0; i < layout->curve_count; i++)
        a->beside[i][0] = a->beside[i][1] = QM_NO_INDEX;
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++)
            a->beside[layout->patches[p].side[k]][layout->patches[p].against[k]] = (uint32_t)p;
}

/** A sample near a node of a curve belongs to the patch on its side, unless it lies too nearly on the
 * curve. */
static void offer_side(atlas *a, uint32_t fixed, uint32_t sample)
{
    const qm_fixed_node *node = fixed_node(a, fixed);
    if (node->curve == QM_NO_INDEX) return;
    qm_vec d = qm_vec_sub(node_at(a, sample), node_at(a, fixed));
    double distance = qm_vec_norm(d);
    double side = qm_vec_dot(d, qm_vec_cross(a->graph.normal[fixed], node->tangent));
    if (fabs(side) < ALONG_CURVE * distance || distance >= a->distance[sample]) return;
    a->distance[sample] = distance;
    a->label[sample] = a->beside[node->curve][side < 0.0];
    a->nearest[sample] = fixed;
}

static void offer_sides(atlas *a)
{
    uint32_t samples = (uint32_t)a->nodes->sample_count;
    for (uint32_t i = 0; i < samples; i++) {
        a->distance[i] = INFINITY;
        a->label[i] = a->nearest[i] = QM_NO_INDEX;
    }
    for (uint32_t i = 0; i < (uint32_t)a->graph.count; i++) {
        for (int k = 0; k < QM_GRAPH_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
            uint32_t j = a->graph.link[i][k];
            if (is_sample(a, i) != is_sample(a, j)) offer_side(a, i < samples ? j : i, i < samples ? i : j);
        }
    }
}

/** Spreads the labels from the curves inward: each sample takes that of the one that it is reached from. */
static qm_status spread_labels(atlas *a)
{
    qm_heap heap = {0};
    qm_status status = QM_OK;
    for (uint32_t i = 0; i < (uint32_t)a->nodes->sample_count && status == QM_OK; i++)
        if (a->distance[i] < INFINITY)
            status = qm_heap_push(a->ctx, &heap, (qm_heap_item){.key = a->distance[i], .number = i});
    while (status == QM_OK && heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&heap);
        uint32_t i = item.number;
        if (item.key > a->distance[i]) continue;
        for (int k = 0; k < QM_GRAPH_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
            uint32_t j = a->graph.link[i][k];
            if (!is_sample(a, j)) continue;
            double distance = a->distance[i] + qm_vec_distance(node_at(a, i), node_at(a, j));
            if (distance >= a->distance[j]) continue;
            a->distance[j] = distance;
            a->label[j] = a->label[i];
            a->nearest[j] = a->nearest[i];
            status = qm_heap_push(a->ctx, &heap, (qm_heap_item){.key = distance, .number = j});
            if (status != QM_OK) break;
        }
    }
    qm_heap_reset(a->ctx, &heap);
    return status;
}

/** Parameters of fixed nodes as the samples beside them see them, after those of the samples themselves. */
static size_t count_fixed_links(const atlas *a)
{
    size_t count = 0;
    for (size_t i = 0; i < a->nodes->sample_count; i++)
        for (int k = 0; k < QM_GRAPH_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++)
            count += !is_sample(a, a->graph.link[i][k]);
    return count;
}

/** Keeps the links of a sample within its patch, pointed at parameters, with weights that fall with
 * distance. */
static void keep_own_links(atlas *a, uint32_t i, size_t *fixed)
{
    int kept = 0;
    for (int k = 0; k < QM_GRAPH_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
        uint32_t j = a->graph.link[i][k], at = j;
        double distance = qm_vec_distance(node_at(a, i), node_at(a, j));
        if (!(distance > 0.0)) continue;
        if (is_sample(a, j)) {
            if (a->label[j] != a->label[i]) continue;
        } else {
            if (!fixed_uv(a, fixed_node(a, j), a->label[i], &a->uv[*fixed])) continue;
            at = (uint32_t)(*fixed)++;
        }
        a->link[i].to[kept] = at;
        a->link[i].length2[kept] = distance * distance;
        a->link[i].weight[kept++] = 1.0 / distance;
    }
    a->link[i].count = kept;
}

/** Starts from the nearest curve. */
static void start_parameters(atlas *a)
{
    size_t fixed = a->nodes->sample_count;
    for (uint32_t i = 0; i < (uint32_t)a->nodes->sample_count; i++) {
        qm_uv near;
        a->stretch[i] = 1.0;
        a->uv[i] = (qm_uv){0.5, 0.5};
        a->link[i].count = 0;
        if (a->label[i] == QM_NO_INDEX) continue;
        if (fixed_uv(a, fixed_node(a, a->nearest[i]), a->label[i], &near)) a->uv[i] = near;
        keep_own_links(a, i, &fixed);
    }
}

static void relax_sample(atlas *a, uint32_t i)
{
    const own_links *links = &a->link[i];
    double sum = 0.0, u = 0.0, v = 0.0;
    for (int k = 0; k < links->count; k++) {
        qm_uv at = a->uv[links->to[k]];
        sum += links->weight[k];
        u += links->weight[k] * at.u;
        v += links->weight[k] * at.v;
    }
    if (!(sum > 0.0)) return;
    a->uv[i].u += RELAX * (u / sum - a->uv[i].u);
    a->uv[i].v += RELAX * (v / sum - a->uv[i].v);
}

static void relax(atlas *a)
{
    uint32_t count = (uint32_t)a->nodes->sample_count;
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (uint32_t k = 0; k < count; k++)
            relax_sample(a, sweep % 2 ? count - 1 - k : k);
}

/** How much longer the links of a sample are on the surface than in the parameters. */
static double find_stretch(const atlas *a, uint32_t i)
{
    const own_links *links = &a->link[i];
    double length2 = 0.0, parameter2 = 0.0;
    for (int k = 0; k < links->count; k++) {
        double du = a->uv[links->to[k]].u - a->uv[i].u, dv = a->uv[links->to[k]].v - a->uv[i].v;
        length2 += links->length2[k];
        parameter2 += du * du + dv * dv;
    }
    return parameter2 > 0.0 ? sqrt(length2 / parameter2) : 1.0;
}

/** Neighbours in stretched places pull less, so that these places widen. */
static void weigh_stretch(atlas *a)
{
    uint32_t count = (uint32_t)a->nodes->sample_count;
    for (uint32_t i = 0; i < count; i++)
        a->stretch[i] = find_stretch(a, i);
    for (uint32_t i = 0; i < count; i++) {
        for (int k = 0; k < a->link[i].count; k++) {
            uint32_t j = a->link[i].to[k];
            a->link[i].weight[k] /= a->stretch[j < count ? j : i];
        }
    }
}

static void write_places(const atlas *a, qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++) {
        uint32_t label = a->label[i];
        samples->place[i] = (qm_sample_place){.distance = INFINITY};
        if (label == QM_NO_INDEX) continue;
        samples->place[i] = (qm_sample_place){.patch = label,
                                              .u = qm_clamp(a->uv[i].u, 0.0, 1.0) * QM_RECONSTRUCTION_BASE,
                                              .v = qm_clamp(a->uv[i].v, 0.0, 1.0) * QM_RECONSTRUCTION_BASE};
    }
}

static qm_status find_parameters(atlas *a, qm_samples *samples)
{
    qm_status status = QM_OK;
    if (!qm_samples_orient(samples, &a->graph)) status = qm_surface_graph_orient(a->ctx, &a->graph);
    if (status != QM_OK) return status;
    status = qm_atlas_turn_patches(a->ctx, a->r, a->nodes, &a->graph);
    if (status != QM_OK) return status;
    find_beside(a);
    offer_sides(a);
    status = spread_labels(a);
    if (status != QM_OK) return status;
    a->uv_count = a->nodes->sample_count + count_fixed_links(a);
    a->uv = qm_context_alloc(a->ctx, a->uv_count, sizeof *a->uv);
    if (!a->uv) return no_memory(a->ctx);
    start_parameters(a);
    relax(a);
    for (int round = 0; round < STRETCH_ROUNDS; round++) {
        if (qm_context_canceled(a->ctx))
            return qm_context_fail(a->ctx, QM_E_CANCELED, "reconstruction canceled");
        weigh_stretch(a);
        relax(a);
    }
    write_places(a, samples);
    return QM_OK;
}

qm_status qm_atlas_locate(qm_context *ctx, qm_reconstruction *r, const qm_atlas_nodes *nodes,
                          qm_samples *samples)
{
    size_t count = samples->count, curves = r->layout.curve_count;
    atlas a = {.ctx = ctx, .r = r, .nodes = nodes};
    a.beside = qm_context_alloc(ctx, curves, sizeof *a.beside);
    a.label = qm_context_alloc(ctx, count, sizeof *a.label);
    a.distance = qm_context_alloc(ctx, count, sizeof *a.distance);
    a.nearest = qm_context_alloc(ctx, count, sizeof *a.nearest);
    a.stretch = qm_context_alloc(ctx, count, sizeof *a.stretch);
    a.link = qm_context_alloc(ctx, count, sizeof *a.link);
    qm_status status = QM_OK;
    if (!a.beside || !a.label || !a.distance || !a.nearest || !a.stretch || !a.link) status = no_memory(ctx);
    if (status == QM_OK) status = qm_surface_graph_build(ctx, nodes->positions, nodes->count, NULL, &a.graph);
    if (status == QM_OK) status = find_parameters(&a, samples);
    qm_surface_graph_reset(ctx, &a.graph);
    qm_context_free(ctx, a.beside, curves, sizeof *a.beside);
    qm_context_free(ctx, a.label, count, sizeof *a.label);
    qm_context_free(ctx, a.distance, count, sizeof *a.distance);
    qm_context_free(ctx, a.nearest, count, sizeof *a.nearest);
    qm_context_free(ctx, a.uv, a.uv_count, sizeof *a.uv);
    qm_context_free(ctx, a.stretch, count, sizeof *a.stretch);
    qm_context_free(ctx, a.link, count, sizeof *a.link);
    return status;
}
