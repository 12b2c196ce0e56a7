/**
 * layout_features.c: curves along the creases and boundaries of a mesh.
 *
 * The edges of the features (features.h) are put together to chains between the points where they end or more than two
 * of them meet. A chain has corners where it turns sharply over a length in which it would be nearly straight if it were round. A closed
 * one with one corner or none is cut into four, so that what lies on both sides of it is a cell of four sides.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "layout_internal.h"
#include "layout_section.h"
#include "qm/features.h"

#define TURN_SIDES 3.0   /* turns are measured over the shortest length over this at most */
#define TURN_PARTS 16.0  /* and over a chain's length over this at most: a circle turns by 22 degrees then */
#define SHARP_TURN 0.5   /* cosine of the turn at which a chain has a corner: 60 degrees */
#define RING_PARTS 4     /* of a closed chain with one corner or none */
#define COVERED 0.9      /* of a chain: with so much of it along curves that are there, it is not added */
#define COVER_SAMPLES 64 /* of a curve or a chain */
#define FLAT 1e-9        /* of the diagonal: points that are nearer to the line between others are left out */
#define MOST_LEFT_OUT 64 /* points in turn */
#define MOST_FEATURES 100000 /* curves */

enum { POINT_SIZE = 3 * sizeof(double) };

/** The edges at each point: those of i are edge[start[i]] ... edge[start[i + 1] - 1]. */
typedef struct edge_lists {
    uint32_t *start, *edge;
} edge_lists;

/** A chain of edges, with the arc length up to each point. The last point of a closed one is its first. */
typedef struct chain {
    uint32_t *point; /* capacity: edges of all features, and one */
    double *arc, *cosine;
    size_t count, capacity;
    bool is_closed; /* no other feature meets it */
} chain;

/** A place where a chain is cut. */
typedef struct cut {
    double arc;
    uint32_t point; /* QM_NO_INDEX: inside an edge */
    bool is_corner;
    uint32_t node; /* QM_NO_INDEX: none yet */
} cut;

typedef struct maker {
    qm_context *ctx;
    qm_layout *layout;
    const qm_ref_surface *surface;
    qm_features features;
    edge_lists at;
    bool *is_taken;    /* of each edge */
    uint32_t *node_of; /* of each point; QM_NO_INDEX: none yet */
    chain chain;
    double shortest, radius;
    bool was_empty; /* the layout had no curve: nothing to snap to */
    size_t added;
} maker;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the features");
}

static qm_vec point_at(const maker *m, uint32_t point)
{
    return qm_vec_load(m->features.points + 3 * (size_t)point);
}

static size_t degree(const maker *m, uint32_t point)
{
    return m->at.start[point + 1] - m->at.start[point];
}

static void list_edges(maker *m)
{
    const qm_features *f = &m->features;
    memset(m->at.start, 0, (f->point_count + 1) * sizeof *m->at.start);
    for (size_t i = 0; i < f->edge_count; i++)
        for (int k = 0; k < 2; k++)
            m->at.start[f->edges[i][k]]++;
    for (size_t v = 0; v < f->point_count; v++)
        m->at.start[v + 1] += m->at.start[v];
    for (size_t i = f->edge_count; i-- > 0;)
        for (int k = 0; k < 2; k++)
            m->at.edge[--m->at.start[f->edges[i][k]]] = (uint32_t)i;
}

/* ---- chains ---- */

/** An edge at a point that no chain has yet, or QM_NO_INDEX. */
static uint32_t next_edge(const maker *m, uint32_t point)
{
    for (uint32_t k = m->at.start[point]; k < m->at.start[point + 1]; k++)
        if (!m->is_taken[m->at.edge[k]]) return m->at.edge[k];
    return QM_NO_INDEX;
}

/** Follows features from a point along an edge, to where they end, meet others, or return. */
static void follow(maker *m, uint32_t start, uint32_t edge)
{
    chain *c = &m->chain;
    uint32_t at = start;
    c->count = 0;
    c->point[c->count++] = start;
    while (edge != QM_NO_INDEX) {
        const uint32_t *end = m->features.edges[edge];
        m->is_taken[edge] = true;
        at = end[end[0] == at];
        c->point[c->count++] = at;
        edge = degree(m, at) == 2 && at != start ? next_edge(m, at) : QM_NO_INDEX;
    }
    c->is_closed = at == start && degree(m, start) == 2;
    c->arc[0] = 0.0;
    for (size_t i = 1; i < c->count; i++)
        c->arc[i] = c->arc[i - 1] + qm_vec_distance(point_at(m, c->point[i - 1]), point_at(m, c->point[i]));
}

static double chain_length(const chain *c)
{
    return c->arc[c->count - 1];
}

/** The place of a chain at an arc length: past the ends of a closed chain it goes round, else the end is taken. */
static qm_vec chain_at(const maker *m, double arc)
{
    const chain *c = &m->chain;
    double length = chain_length(c);
    if (c->is_closed && arc < 0.0) arc += length;
    if (c->is_closed && arc > length) arc -= length;
    size_t low = 0, high = c->count - 1;
    while (low + 1 < high) {
        size_t middle = low + (high - low) / 2;
        if (c->arc[middle] <= arc)
            low = middle;
        else
            high = middle;
    }
    double edge = c->arc[high] - c->arc[low];
    double t = edge > 0.0 ? qm_clamp((arc - c->arc[low]) / edge, 0.0, 1.0) : 0.0;
    return qm_vec_mix(point_at(m, c->point[low]), point_at(m, c->point[high]), t);
}

/** The cosine of the turn of a chain at a place, over a length to both sides. */
static double turn_cosine(const maker *m, double arc, double reach)
{
    qm_vec here = chain_at(m, arc);
    qm_vec before = qm_vec_sub(here, chain_at(m, arc - reach)),
           after = qm_vec_sub(chain_at(m, arc + reach), here);
    double scale = qm_vec_norm(before) * qm_vec_norm(after);
    return scale > 0.0 ? qm_vec_dot(before, after) / scale : 1.0;
}

static double arc_between(const chain *c, double a, double b)
{
    double way = fabs(a - b);
    return c->is_closed ? fmin(way, chain_length(c) - way) : way;
}

/** Adds the corners of a chain to its cuts, the sharpest first: none is nearer to another one than the reach. A chain turns at
 * a corner over twice that length, too: over the shorter one alone a rough boundary turns everywhere. */
static qm_status find_corners(maker *m, cut *cuts, size_t most, size_t *count)
{
    chain *c = &m->chain;
    double reach = fmin(m->shortest / TURN_SIDES, chain_length(c) / TURN_PARTS);
    size_t first = c->is_closed ? 0 : 1;
    for (size_t i = first; i + 1 < c->count; i++)
        c->cosine[i] = fmax(turn_cosine(m, c->arc[i], reach), turn_cosine(m, c->arc[i], 2.0 * reach));
    while (*count < most) {
        size_t sharpest = c->count;
        double least = SHARP_TURN;
        for (size_t i = first; i + 1 < c->count; i++) {
            if (c->cosine[i] >= least) continue;
            least = c->cosine[i];
            sharpest = i;
        }
        if (sharpest == c->count) break;
        cuts[(*count)++] = (cut){c->arc[sharpest], c->point[sharpest], true, QM_NO_INDEX};
        for (size_t i = first; i + 1 < c->count; i++)
            if (arc_between(c, c->arc[i], c->arc[sharpest]) <= reach) c->cosine[i] = 1.0;
    }
    return QM_OK;
}

static void sort_cuts(cut *cuts, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        cut moved = cuts[i];
        size_t k = i;
        for (; k > 0 && cuts[k - 1].arc > moved.arc; k--)
            cuts[k] = cuts[k - 1];
        cuts[k] = moved;
    }
}

/** The start of a round chain: its farthest point in a direction that is the same for all, so that the cuts of two rims of one
 * tube lie beside each other. The direction is along no axis that a part is likely to have. */
static size_t find_start(const maker *m)
{
    const qm_vec way = {0.8017837, 0.5345225, 0.2672612};
    double farthest = -INFINITY;
    size_t start = 0;
    for (size_t i = 0; i + 1 < m->chain.count; i++) {
        double height = qm_vec_dot(way, point_at(m, m->chain.point[i]));
        if (height <= farthest) continue;
        farthest = height;
        start = i;
    }
    return start;
}

/* ---- curves ---- */

/** True if the points of a line between two of it lie on the straight line between these. */
static bool is_flat(const qm_section *line, size_t from, size_t to, double tolerance)
{
    qm_vec a = qm_vec_load(line->points + 3 * from), d = qm_vec_sub(qm_vec_load(line->points + 3 * to), a);
    double length2 = qm_vec_norm2(d);
    for (size_t i = from + 1; i < to; i++) {
        qm_vec p = qm_vec_sub(qm_vec_load(line->points + 3 * i), a);
        double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(p, d) / length2, 0.0, 1.0) : 0.0;
        if (qm_vec_norm(qm_vec_axpy(p, -t, d)) > tolerance) return false;
    }
    return true;
}

/** Leaves out points that lie on the line between others. */
static void thin_out(qm_section *line, double tolerance)
{
    size_t kept = 1;
    for (size_t from = 0; from + 1 < line->count;) {
        size_t to = from + 1;
        while (to + 1 < line->count && to - from < MOST_LEFT_OUT && is_flat(line, from, to + 1, tolerance))
            to++;
        memmove(line->points + 3 * kept++, line->points + 3 * to, POINT_SIZE);
        from = to;
    }
    line->count = kept;
}

/** The points of a chain from one cut to another one, which may lie behind the end of a closed chain. */
static qm_status line_between(maker *m, double from, double to, qm_section *out)
{
    const chain *c = &m->chain;
    double length = chain_length(c), tolerance = FLAT * m->surface->diagonal;
    qm_status status = qm_section_add(m->ctx, out, chain_at(m, from));
    for (int turn = 0; turn < 2 && status == QM_OK; turn++) {
        for (size_t i = 0; i + 1 < c->count && status == QM_OK; i++) {
            double arc = c->arc[i] + turn * length;
            if (arc > from + tolerance && arc < to - tolerance)
                status = qm_section_add(m->ctx, out, point_at(m, c->point[i]));
        }
        if (!c->is_closed) break;
    }
    if (status == QM_OK) status = qm_section_add(m->ctx, out, chain_at(m, to));
    if (status == QM_OK) thin_out(out, tolerance);
    return status;
}

/** The share of a line that lies within the radius of another one. */
static double share_along(const qm_section *line, const qm_curve *other, double radius)
{
    size_t near = 0;
    double length = qm_section_length(line);
    for (int i = 0; i < COVER_SAMPLES; i++) {
        double at[3];
        qm_vec_store(at, qm_section_at(line, length * (i + 0.5) / COVER_SAMPLES));
        near += qm_layout_nearest_position(other, at).distance <= radius;
    }
    return (double)near / COVER_SAMPLES;
}

/** True if curves that are there run along a line. Those that run along nothing else become sharp. */
static bool take_covered(const maker *m, const qm_section *line)
{
    const qm_curve own = {.points = line->points, .point_count = line->count};
    bool is_near[COVER_SAMPLES] = {false};
    size_t covered = 0;
    double length = qm_section_length(line);
    for (size_t c = 0; c < m->layout->curve_count; c++)
        for (int i = 0; i < COVER_SAMPLES; i++) {
            double at[3];
            if (is_near[i]) continue;
            qm_vec_store(at, qm_section_at(line, length * (i + 0.5) / COVER_SAMPLES));
            is_near[i] = qm_layout_nearest_position(&m->layout->curves[c], at).distance <= m->radius;
        }
    for (int i = 0; i < COVER_SAMPLES; i++)
        covered += is_near[i];
    if ((double)covered < COVERED * COVER_SAMPLES) return false;
    for (size_t c = 0; c < m->layout->curve_count; c++) {
        qm_curve *curve = &m->layout->curves[c];
        const qm_section points = {curve->points, curve->point_count, curve->point_count};
        if (curve->mark == QM_CURVE_SMOOTH && share_along(&points, &own, m->radius) >= COVERED)
            curve->mark = QM_CURVE_SHARP;
    }
    return true;
}

/** The node of a cut in a layout that had no curves, which is made when it is new. */
static qm_status find_node(maker *m, cut *at, qm_vec place)
{
    if (at->point != QM_NO_INDEX) at->node = m->node_of[at->point];
    if (at->node != QM_NO_INDEX) return QM_OK;
    double position[3];
    qm_vec_store(position, place);
    at->node = (uint32_t)m->layout->node_count;
    qm_status status = qm_layout_add_node(m->ctx, m->layout, position);
    if (status == QM_OK && at->is_corner) status = qm_layout_set_corner(m->ctx, m->layout, at->node, true);
    if (at->point != QM_NO_INDEX) m->node_of[at->point] = at->node;
    return status;
}

/** Makes the node nearest to a place a corner, if it is within the radius. */
static qm_status make_corner(maker *m, qm_vec place)
{
    double nearest = m->radius;
    uint32_t node = QM_NO_INDEX;
    for (uint32_t i = 0; i < m->layout->node_count; i++) {
        double distance = qm_vec_distance(place, qm_vec_load(m->layout->nodes + 3 * (size_t)i));
        if (distance > nearest) continue;
        nearest = distance;
        node = i;
    }
    return node == QM_NO_INDEX ? QM_OK : qm_layout_set_corner(m->ctx, m->layout, node, true);
}

/** Draws a line into a layout that has curves: it snaps and crosses as a stroke does. */
static qm_status draw_line(maker *m, const qm_section *line, const cut *from, const cut *to)
{
    uint32_t id;
    if (take_covered(m, line)) return QM_OK;
    qm_status status = qm_layout_draw_stroke(m->ctx, m->layout, m->surface, line->points, line->count,
                                             m->radius, QM_CURVE_SHARP, &id);
    if (status == QM_OK) m->added++;
    if (status == QM_OK && from->is_corner) status = make_corner(m, qm_vec_load(line->points));
    if (status == QM_OK && to->is_corner)
        status = make_corner(m, qm_vec_load(line->points + 3 * (line->count - 1)));
    return status;
}

/** Adds the curve between two cuts of a chain. */
static qm_status add_between(maker *m, cut *from, cut *to)
{
    qm_section line = {0};
    if (m->added >= MOST_FEATURES)
        return qm_context_fail(m->ctx, QM_E_ARGUMENT,
                               "the mesh has more than %d features: choose a greater angle, "
                               "or a greater shortest length",
                               MOST_FEATURES);
    double end = to->arc > from->arc ? to->arc : to->arc + chain_length(&m->chain);
    qm_status status = line_between(m, from->arc, end, &line);
    if (status == QM_OK && !m->was_empty) {
        status = draw_line(m, &line, from, to);
    } else if (status == QM_OK) {
        status = find_node(m, from, qm_vec_load(line.points));
        if (status == QM_OK) status = find_node(m, to, qm_vec_load(line.points + 3 * (line.count - 1)));
        if (status == QM_OK)
            status = qm_layout_add_curve(m->ctx, m->layout, from->node, to->node, line.points, line.count);
        if (status == QM_OK) m->layout->curves[m->layout->curve_count - 1].mark = QM_CURVE_SHARP;
        m->added += status == QM_OK;
    }
    qm_section_reset(m->ctx, &line);
    return status;
}

/** Cuts a chain that returns to a place into equal parts from there on. */
static size_t cut_ring(const maker *m, cut start, cut cuts[RING_PARTS])
{
    cuts[0] = start;
    for (int k = 1; k < RING_PARTS; k++) {
        double length = chain_length(&m->chain), arc = start.arc + k * length / RING_PARTS;
        cuts[k] = (cut){arc > length ? arc - length : arc, QM_NO_INDEX, false, QM_NO_INDEX};
    }
    return RING_PARTS;
}

/** Adds the curves of the chain. */
static qm_status add_chain(maker *m, cut *cuts, size_t most)
{
    const chain *c = &m->chain;
    size_t count = 0;
    bool is_ring = c->point[0] == c->point[c->count - 1];
    qm_status status = find_corners(m, cuts, most, &count);
    if (status != QM_OK) return status;
    if (!c->is_closed && !(is_ring && count == 0)) {
        /* From end to end: one more cut before the first corner, and one behind the last. */
        cuts[count++] = (cut){0.0, c->point[0], true, QM_NO_INDEX};
        cuts[count++] = (cut){chain_length(c), c->point[c->count - 1], true, QM_NO_INDEX};
    } else if (!c->is_closed) {
        count = cut_ring(m, (cut){0.0, c->point[0], true, QM_NO_INDEX}, cuts);
    } else if (count == 1) {
        count = cut_ring(m, cuts[0], cuts);
    } else if (count == 0) {
        size_t start = find_start(m);
        if (!m->was_empty) { /* a closed stroke is cut where it meets curves, else into four */
            cut whole = {c->arc[start], c->point[start], false, QM_NO_INDEX};
            return add_between(m, &whole, &whole);
        }
        count = cut_ring(m, (cut){c->arc[start], c->point[start], false, QM_NO_INDEX}, cuts);
    }
    sort_cuts(cuts, count);
    for (size_t k = 0; k + 1 < count && status == QM_OK; k++)
        status = add_between(m, &cuts[k], &cuts[k + 1]);
    if (status == QM_OK && is_ring && (c->is_closed || cuts[count - 1].arc < chain_length(c)))
        status = add_between(m, &cuts[count - 1], &cuts[0]);
    return status;
}

static qm_status add_chains(maker *m)
{
    size_t points = m->features.point_count, edges = m->features.edge_count;
    size_t most = edges + RING_PARTS + 2;
    cut *cuts = qm_context_alloc(m->ctx, most, sizeof *cuts);
    qm_status status = cuts ? QM_OK : no_memory(m->ctx);
    /* Chains between ends and meetings first; what is left are closed ones. */
    for (int round = 0; round < 2 && status == QM_OK; round++) {
        for (uint32_t v = 0; v < points && status == QM_OK; v++) {
            if (round == 0 && degree(m, v) == 2) continue;
            for (uint32_t e = next_edge(m, v); e != QM_NO_INDEX && status == QM_OK; e = next_edge(m, v)) {
                if (qm_context_canceled(m->ctx))
                    status = qm_context_fail(m->ctx, QM_E_CANCELED, "features canceled");
                follow(m, v, e);
                if (status == QM_OK) status = add_chain(m, cuts, edges);
            }
        }
    }
    qm_context_free(m->ctx, cuts, most, sizeof *cuts);
    return status;
}

static qm_status add_features(maker *m)
{
    size_t points = m->features.point_count, edges = m->features.edge_count;
    if (edges == 0) return QM_OK;
    m->chain.capacity = edges + 1;
    m->at.start = qm_context_alloc(m->ctx, points + 1, sizeof *m->at.start);
    m->at.edge = qm_context_alloc(m->ctx, 2 * edges, sizeof *m->at.edge);
    m->is_taken = qm_context_alloc(m->ctx, edges, sizeof *m->is_taken);
    m->node_of = qm_context_alloc(m->ctx, points, sizeof *m->node_of);
    m->chain.point = qm_context_alloc(m->ctx, edges + 1, sizeof *m->chain.point);
    m->chain.arc = qm_context_alloc(m->ctx, edges + 1, sizeof *m->chain.arc);
    m->chain.cosine = qm_context_alloc(m->ctx, edges + 1, sizeof *m->chain.cosine);
    qm_status status = QM_OK;
    if (!m->at.start || !m->at.edge || !m->is_taken || !m->node_of || !m->chain.point || !m->chain.arc ||
        !m->chain.cosine)
        status = no_memory(m->ctx);
    if (status == QM_OK) {
        memset(m->is_taken, 0, edges * sizeof *m->is_taken);
        for (size_t v = 0; v < points; v++)
            m->node_of[v] = QM_NO_INDEX;
        list_edges(m);
        status = add_chains(m);
    }
    qm_context_free(m->ctx, m->at.start, points + 1, sizeof *m->at.start);
    qm_context_free(m->ctx, m->at.edge, 2 * edges, sizeof *m->at.edge);
    qm_context_free(m->ctx, m->is_taken, edges, sizeof *m->is_taken);
    qm_context_free(m->ctx, m->node_of, points, sizeof *m->node_of);
    qm_context_free(m->ctx, m->chain.point, edges + 1, sizeof *m->chain.point);
    qm_context_free(m->ctx, m->chain.arc, edges + 1, sizeof *m->chain.arc);
    qm_context_free(m->ctx, m->chain.cosine, edges + 1, sizeof *m->chain.cosine);
    return status;
}

qm_layout_features_options qm_layout_features_options_default(void)
{
    return (qm_layout_features_options){.angle = 40.0};
}

qm_status qm_layout_add_features(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                 const qm_layout_features_options *options, size_t *added)
{
    QM_ASSERT(ctx && layout && surface && options && added);
    *added = 0;
    if (surface->is_cloud)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a point set has no features: they are edges of a mesh");
    maker m = {.ctx = ctx,
               .surface = surface,
               .shortest =
                   options->shortest > 0.0 ? options->shortest : QM_FEATURES_SHORTEST * surface->diagonal,
               .radius = options->radius > 0.0 ? options->radius : QM_FEATURES_RADIUS * surface->diagonal,
               .was_empty = layout->curve_count == 0};
    const qm_features_options wanted = {.angle = options->angle, .shortest = m.shortest};
    qm_status status = qm_features_find(ctx, qm_bvh_mesh(surface->bvh), &wanted, &m.features);
    if (status != QM_OK) return status;
    qm_layout copy;
    status = qm_layout_copy(ctx, layout, &copy);
    if (status == QM_OK) {
        m.layout = &copy;
        status = qm_layout_finish_edit(ctx, layout, &copy, add_features(&m));
    }
    if (status == QM_OK) *added = m.added;
    qm_features_reset(ctx, &m.features);
    return status;
}
