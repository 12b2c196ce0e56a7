/**
 * reconstruct_parameters.c: the first parameters of the samples, found along the surface.
 *
 * A patch may hold a whole protrusion such as an ear: samples projected onto its Coons patch would lie over
 * one another. So each sample gets the patch on its side of the curve that is nearest along the surface, and
 * parameters that are a weighted mean of its neighbours', with the curves held fixed on the border of the
 * unit square. Such a map does not fold (Tutte). The weights are then divided by the stretch at each
 * neighbour, a few times, so that the tip of the ear gets its fraction of the square; more often in patches that
 * are still stretched unevenly.
 *
 * The sides of a curve are defined by the surface's normals and by the orientation of the patches, which is
 * made consistent first.
 *
 * Sources: W. Tutte, How to draw a graph, 1963; M. Floater, Parametrization and smooth approximation of
 * surface triangulations, 1997; S. Yoshizawa, A. Belyaev, H.-P. Seidel, A fast and simple stretch-minimizing
 * mesh parameterization, 2004; D. Young, Iterative methods for solving partial difference equations of elliptic type, 1954.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "core/heap.h"

#define NODE_SPACING 0.8  /* of nodes on curves, in spacings of the samples */
#define MAX_NODES 2000    /* of a curve */
#define STRETCH_ROUNDS 10 /* of dividing the weights by the stretch, of all patches */
#define MAX_ROUNDS 80     /* of patches that are stretched unevenly, while that gets less */
#define STRETCHED 4.0     /* times the mean stretch of a patch: uneven is a greater one */
#define STILL_FALLS 0.97  /* times the least so far of the greatest stretch of a patch: it gets less */
#define MAX_IDLE 4        /* rounds in which it does not get less */
#define MIN_SWEEPS 24     /* of relaxation in a round, forward and backward */
#define MAX_SWEEPS 120
#define SWEEP_SHARE 1.4     /* of the root of a patch's samples: sweeps of that patch */
#define MAX_RELAXATION 1.95 /* of the factor of successive over-relaxation */
#define CLEARLY_NEARER 0.8  /* times the distance of the other side */
#define MIN_TURN                                                                                             \
    0.25 /* of the most that a normal can tell of the side of a crease: half is that of a face beside it */
#define MIN_SIDE_SINE 0.1 /* of the angle between curve and sample, to separate the sides of the curve */

enum { POINT_SIZE = 3 * sizeof(double) };

/** A node of the graph with known parameters: on the border of patches. */
typedef struct border_node {
    uint32_t curve;  /* QM_NO_INDEX for a node of the layout */
    uint32_t corner; /* that node */
    double t;        /* fraction of the curve's length */
    qm_vec tangent;  /* of the curve, of length 1 */
} border_node;

/** The nodes of the graph: samples first, then nodes on the curves. */
typedef struct graph_nodes {
    size_t count, sample_count;
    double *positions; /* rows of x y z */
    border_node *border;
} graph_nodes;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the parameters of samples");
}

static double polyline_length(const qm_polyline *polyline)
{
    return polyline->arc[polyline->point_count - 1];
}

/** The number of nodes on a curve. */
static size_t count_curve_nodes(const qm_polyline *polyline, double spacing)
{
    if (polyline->chord == QM_NO_INDEX) return 0;
    double wanted = ceil(polyline_length(polyline) / spacing);
    return wanted < 1.0 ? 1 : wanted < MAX_NODES ? (size_t)wanted : MAX_NODES;
}

static void free_nodes(qm_context *ctx, graph_nodes *nodes)
{
    qm_context_free(ctx, nodes->positions, nodes->count, POINT_SIZE);
    qm_context_free(ctx, nodes->border, nodes->count - nodes->sample_count, sizeof *nodes->border);
    *nodes = (graph_nodes){0};
}

/** Makes the nodes of the graph: on curves that are sides of patches, about as dense as the samples. */
static qm_status create_nodes(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                              graph_nodes *out)
{
    /* The mean spacing of samples that cover the patches, as rectangles, evenly. */
    double area = 0.0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const uint32_t *side = r->layout.patches[p].side;
        area += 0.25 * (polyline_length(&r->polylines[side[0]]) + polyline_length(&r->polylines[side[2]])) *
                (polyline_length(&r->polylines[side[1]]) + polyline_length(&r->polylines[side[3]]));
    }
    double spacing = NODE_SPACING * sqrt(area / (double)samples->count);
    *out = (graph_nodes){.sample_count = samples->count, .count = samples->count + r->layout.node_count};
    for (size_t c = 0; c < r->layout.curve_count; c++)
        out->count += count_curve_nodes(&r->polylines[c], spacing);
    out->positions = qm_context_alloc(ctx, out->count, POINT_SIZE);
    out->border = qm_context_alloc(ctx, out->count - out->sample_count, sizeof *out->border);
    if (!out->positions || !out->border) {
        free_nodes(ctx, out);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for nodes on the curves");
    }
    memcpy(out->positions, samples->positions, samples->count * POINT_SIZE);
    size_t next = out->sample_count;
    for (size_t i = 0; i < r->layout.node_count; i++, next++) {
        out->border[next - out->sample_count] = (border_node){.curve = QM_NO_INDEX, .corner = (uint32_t)i};
        memcpy(out->positions + 3 * next, r->layout.nodes + 3 * i, POINT_SIZE);
    }
    for (size_t c = 0; c < r->layout.curve_count; c++) {
        size_t count = count_curve_nodes(&r->polylines[c], spacing);
        for (size_t k = 0; k < count; k++, next++) {
            border_node *node = &out->border[next - out->sample_count];
            *node = (border_node){.curve = (uint32_t)c, .t = ((double)k + 0.5) / (double)count};
            qm_polyline_at(&r->polylines[c], node->t, out->positions + 3 * next, &node->tangent);
        }
    }
    QM_ASSERT(next == out->count);
    return QM_OK;
}

/*
 * Orientation of the patches.
 */

/** Reverses the orientation of a patch; its corner 0 stays. */
void qm_parameters_flip(qm_reconstruction *r, size_t p)
{
    qm_layout_patch *patch = &r->layout.patches[p], old = *patch;
    r->lattices[p].is_flipped = !r->lattices[p].is_flipped;
    for (int k = 0; k < 4; k++) {
        patch->side[k] = old.side[3 - k];
        patch->against[k] = !old.against[3 - k];
    }
}

/** The patches that a curve is a side of, at most two. */
typedef struct curve_owners {
    size_t count;
    uint32_t patch[2];
} curve_owners;

/** Flips the neighbours of a patch that run along a common curve in its direction, and queues them. */
static size_t orient_neighbours(qm_reconstruction *r, const curve_owners *owners, uint32_t p,
                                uint32_t component, bool *is_oriented, uint32_t *queue, size_t queued)
{
    qm_layout_patch *patches = r->layout.patches;
    for (int k = 0; k < 4; k++) {
        const curve_owners *shared = &owners[patches[p].side[k]];
        for (size_t s = 0; s < shared->count; s++) {
            uint32_t other = shared->patch[s];
            if (is_oriented[other]) continue;
            for (int m = 0; m < 4; m++) {
                if (patches[other].side[m] != patches[p].side[k]) continue;
                if (patches[other].against[m] == patches[p].against[k]) qm_parameters_flip(r, other);
                break;
            }
            is_oriented[other] = true;
            r->lattices[other].component = component;
            queue[queued++] = other;
        }
    }
    return queued;
}

/**
 * Orients the patches of each component as its first one, breadth first: two run along a common curve in
 * opposite directions.
 */
qm_status qm_parameters_orient(qm_context *ctx, qm_reconstruction *r)
{
    size_t patches = r->layout.patch_count, curves = r->layout.curve_count;
    curve_owners *owners = qm_context_alloc(ctx, curves, sizeof *owners);
    bool *is_oriented = qm_context_alloc(ctx, patches, sizeof *is_oriented);
    uint32_t *queue = qm_context_alloc(ctx, patches, sizeof *queue);
    bool has_memory = owners && is_oriented && queue;
    if (has_memory) {
        memset(owners, 0, curves * sizeof *owners);
        memset(is_oriented, 0, patches * sizeof *is_oriented);
        for (size_t p = 0; p < patches; p++)
            for (int k = 0; k < 4; k++) {
                curve_owners *of = &owners[r->layout.patches[p].side[k]];
                if (of->count < 2) of->patch[of->count++] = (uint32_t)p;
            }
        uint32_t component = 0;
        for (size_t start = 0; start < patches; start++) {
            if (is_oriented[start]) continue;
            size_t queued = 0;
            is_oriented[start] = true;
            r->lattices[start].component = component;
            queue[queued++] = (uint32_t)start;
            for (size_t next = 0; next < queued; next++)
                queued = orient_neighbours(r, owners, queue[next], component, is_oriented, queue, queued);
            component++;
        }
    }
    qm_context_free(ctx, owners, curves, sizeof *owners);
    qm_context_free(ctx, is_oriented, patches, sizeof *is_oriented);
    qm_context_free(ctx, queue, patches, sizeof *queue);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
}

/** Twice the vector area of the border of a patch, which has about the direction of the patch's normal. */
static qm_vec vector_area(const qm_reconstruction *r, const qm_layout_patch *patch)
{
    qm_vec area = {0, 0, 0}, origin = qm_vec_load(r->polylines[patch->side[0]].points);
    for (int k = 0; k < 4; k++) {
        const qm_polyline *polyline = &r->polylines[patch->side[k]];
        double sign = patch->against[k] ? -1.0 : 1.0;
        for (size_t i = 1; i < polyline->point_count; i++) {
            qm_vec a = qm_vec_sub(qm_vec_load(polyline->points + 3 * i - 3), origin);
            qm_vec b = qm_vec_sub(qm_vec_load(polyline->points + 3 * i), origin);
            area = qm_vec_axpy(area, sign, qm_vec_cross(a, b));
        }
    }
    return area;
}

/** The distance of a vertex from the wall that looks along a direction, at most the reach. */
static double wall_distance(const qm_reconstruction *r, const double vertex[3], qm_vec toward, double reach)
{
    double direction[3];
    qm_ref_surface_point projection;
    qm_vec_store(direction, toward);
    if (!qm_ref_surface_project_toward(&r->surface, vertex, direction, reach, &projection)) return reach;
    return fmin(projection.distance, reach);
}

/**
 * 1 if the Coons patches of a component are much nearer to the walls that look along their normals, -1 if to those
 * that look against them, else 0. Walls are told apart by this however near they are to each other.
 */
static int side_by_walls(const qm_reconstruction *r, uint32_t component)
{
    double along = 0.0, against = 0.0, reach = qm_reconstruction_cover_distance(r);
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        if (lattice->component != component) continue;
        for (uint32_t j = 1; j < lattice->rows; j += 2) {
            for (uint32_t i = 1; i < lattice->columns; i += 2) {
                qm_vec normal = qm_lattice_normal(lattice, i, j);
                const double *vertex = qm_lattice_vertex(lattice, i, j);
                if (qm_vec_norm2(normal) == 0.0) continue;
                along += wall_distance(r, vertex, normal, reach);
                against += wall_distance(r, vertex, qm_vec_scale(-1.0, normal), reach);
            }
        }
    }
    return along < CLEARLY_NEARER * against ? 1 : against < CLEARLY_NEARER * along ? -1 : 0;
}

/** Flips each component of patches that is clockwise about the surface's normals. */
static qm_status orient_by_normals(qm_context *ctx, qm_reconstruction *r, const graph_nodes *nodes,
                                   const qm_knn_graph *graph)
{
    size_t curves = r->layout.curve_count;
    qm_vec *curve_normal = qm_context_alloc(ctx, curves, sizeof *curve_normal);
    if (!curve_normal) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
    memset(curve_normal, 0, curves * sizeof *curve_normal);
    for (size_t i = nodes->sample_count; i < nodes->count; i++) {
        uint32_t curve = nodes->border[i - nodes->sample_count].curve;
        if (curve != QM_NO_INDEX) curve_normal[curve] = qm_vec_add(curve_normal[curve], graph->normal[i]);
    }
    uint32_t components = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->lattices[p].component >= components) components = r->lattices[p].component + 1;
    qm_status status = r->has_sides ? qm_lattices_create(ctx, r) : QM_OK;
    for (uint32_t component = 0; component < components && status == QM_OK; component++) {
        int side = r->has_sides ? side_by_walls(r, component) : 0;
        if (side > 0) continue;
        /* The sum is positive if the patches are anticlockwise about the normals along their curves. */
        double sum = 0.0;
        for (size_t p = 0; p < r->layout.patch_count; p++) {
            const qm_layout_patch *patch = &r->layout.patches[p];
            if (r->lattices[p].component != component) continue;
            qm_vec normal = {0, 0, 0};
            for (int k = 0; k < 4; k++)
                normal = qm_vec_add(normal, curve_normal[patch->side[k]]);
            sum += qm_vec_dot(vector_area(r, patch), normal);
        }
        if (side == 0 && sum >= 0.0) continue;
        for (size_t p = 0; p < r->layout.patch_count; p++)
            if (r->lattices[p].component == component) qm_parameters_flip(r, p);
    }
    qm_context_free(ctx, curve_normal, curves, sizeof *curve_normal);
    return status;
}

/*
 * Parameterization.
 */

typedef struct uv_point {
    double u, v;
} uv_point;

/** Links of a sample within its patch, to indices of uv. */
typedef struct patch_links {
    int count;
    uint32_t to[QM_KNN_MAX_LINKS];
    double weight[QM_KNN_MAX_LINKS], length2[QM_KNN_MAX_LINKS];
} patch_links;

/** The parameterization as it is computed. */
typedef struct parameterization {
    qm_context *ctx;
    qm_reconstruction *r;
    const graph_nodes *nodes;
    const qm_samples *samples;
    qm_knn_graph graph;
    uint32_t (*beside)[2]; /* patches to the left and right of each curve */
    uint32_t *label;       /* patch of each sample, or QM_NO_INDEX */
    double *distance;      /* along the surface from the nearest curve */
    uint32_t *nearest;     /* the node on that curve */
    uv_point *uv;          /* of each sample, then of border nodes: one entry for each link to them */
    double *stretch;
    patch_links *link;
    size_t uv_count;
} parameterization;

static qm_vec node_at(const parameterization *a, uint32_t i)
{
    return qm_vec_load(a->nodes->positions + 3 * (size_t)i);
}

static bool is_sample(const parameterization *a, uint32_t i)
{
    return i < a->nodes->sample_count;
}

static const border_node *border_node_of(const parameterization *a, uint32_t i)
{
    return &a->nodes->border[i - a->nodes->sample_count];
}

/** Parameters of a point of a side, at a fraction s of the way from corner `side` to the next. */
static uv_point side_uv(int side, double s)
{
    const uv_point of[4] = {{s, 0.0}, {1.0, s}, {1.0 - s, 1.0}, {0.0, 1.0 - s}};
    return of[side];
}

/** Parameters of a border node in a patch. False if it has none there, or more than one pair. */
static bool border_uv(const parameterization *a, const border_node *node, uint32_t p, uv_point *out)
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

/** Which side of a sharp curve a sample looks as: above 0 on the left of it, below 0 on the right; 0: not known. */
static double crease_side(const parameterization *a, const border_node *node, uint32_t sample)
{
    const qm_polyline *polyline = &a->r->polylines[node->curve];
    if (!polyline->across || !a->samples->normals || !a->r->has_sides) return 0.0;
    size_t vertex = (size_t)(node->t * polyline->vertex_edges + 0.5);
    qm_vec across = qm_vec_load(polyline->across + 3 * vertex);
    const float *row = a->samples->normals + 3 * (size_t)sample;
    double turn = qm_vec_dot(across, (qm_vec){row[0], row[1], row[2]});
    return fabs(turn) >= MIN_TURN * qm_vec_norm2(across) ? turn : 0.0;
}

/** Labels a sample near a node of a curve with the patch on its side, unless it is nearly on the curve. */
static void label_by_side(parameterization *a, uint32_t border, uint32_t sample)
{
    const border_node *node = border_node_of(a, border);
    if (node->curve == QM_NO_INDEX) return;
    qm_vec d = qm_vec_sub(node_at(a, sample), node_at(a, border));
    double distance = qm_vec_norm(d);
    double side = qm_vec_dot(d, qm_vec_cross(a->graph.normal[border], node->tangent));
    double turn = crease_side(a, node, sample);
    if (turn != 0.0)
        side = turn; /* the sample's normal tells, however near it is to the curve */
    else if (fabs(side) < MIN_SIDE_SINE * distance)
        return;
    if (distance >= a->distance[sample]) return;
    a->distance[sample] = distance;
    a->label[sample] = a->beside[node->curve][side < 0.0];
    a->nearest[sample] = border;
}

/** Labels the samples that have links to curves. */
static void label_near_curves(parameterization *a)
{
    uint32_t samples = (uint32_t)a->nodes->sample_count;
    for (uint32_t i = 0; i < samples; i++) {
        a->distance[i] = INFINITY;
        a->label[i] = a->nearest[i] = QM_NO_INDEX;
    }
    for (uint32_t i = 0; i < (uint32_t)a->graph.count; i++) {
        for (int k = 0; k < QM_KNN_MAX_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
            uint32_t j = a->graph.link[i][k];
            if (is_sample(a, i) != is_sample(a, j))
                label_by_side(a, i < samples ? j : i, i < samples ? i : j);
        }
    }
}

/** Propagates the labels from the curves inward, along shortest paths (Dijkstra). */
static qm_status propagate_labels(parameterization *a)
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
        for (int k = 0; k < QM_KNN_MAX_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
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

/** Keeps the links of a sample within its patch, with weights that fall with distance. */
static void set_patch_links(parameterization *a, uint32_t i, size_t *border)
{
    int kept = 0;
    for (int k = 0; k < QM_KNN_MAX_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++) {
        uint32_t j = a->graph.link[i][k], at = j;
        double distance = qm_vec_distance(node_at(a, i), node_at(a, j));
        if (!(distance > 0.0)) continue;
        if (is_sample(a, j)) {
            if (a->label[j] != a->label[i]) continue;
        } else {
            if (!border_uv(a, border_node_of(a, j), a->label[i], &a->uv[*border])) continue;
            at = (uint32_t)(*border)++;
        }
        a->link[i].to[kept] = at;
        a->link[i].length2[kept] = distance * distance;
        a->link[i].weight[kept++] = 1.0 / distance;
    }
    QM_ASSERT(kept <= QM_KNN_MAX_LINKS && *border <= a->uv_count);
    a->link[i].count = kept;
}

/** Starts with the parameters of the nearest curves. */
static void start_parameters(parameterization *a)
{
    size_t border = a->nodes->sample_count;
    for (uint32_t i = 0; i < (uint32_t)a->nodes->sample_count; i++) {
        uv_point near;
        a->stretch[i] = 1.0;
        a->uv[i] = (uv_point){0.5, 0.5};
        a->link[i].count = 0;
        if (a->label[i] == QM_NO_INDEX) continue;
        if (border_uv(a, border_node_of(a, a->nearest[i]), a->label[i], &near)) a->uv[i] = near;
        set_patch_links(a, i, &border);
    }
}

/** The relaxation of the samples of a patch in a round. */
typedef struct patch_sweeps {
    double factor; /* of successive over-relaxation */
    int count;     /* 0: done */
    size_t samples;
    double sum, now,
        least; /* of the stretch of its samples in this round, the greatest, and the least that that was */
    int idle;  /* rounds since it has fallen */
} patch_sweeps;

/**
 * Of a grid of n points the best factor of successive over-relaxation is 2 / (1 + sin (pi / sqrt n)), with which sweeps in
 * proportion to sqrt n reach any accuracy (Young 1954). A patch that holds a protrusion has many more samples than others.
 */
static patch_sweeps find_sweeps(size_t samples)
{
    double side = sqrt((double)samples);
    return (patch_sweeps){
        .samples = samples,
        .factor = side > 2.0 ? fmin(2.0 / (1.0 + sin(180.0 * QM_DEGREE / side)), MAX_RELAXATION) : 1.0,
        .count = (int)qm_clamp(SWEEP_SHARE * side, MIN_SWEEPS, MAX_SWEEPS)};
}

/** Moves the parameters of a sample to, and beyond, the weighted mean of its neighbours'. */
static void relax_sample(parameterization *a, uint32_t i, double factor)
{
    const patch_links *links = &a->link[i];
    double sum = 0.0, u = 0.0, v = 0.0;
    for (int k = 0; k < links->count; k++) {
        QM_ASSERT(links->to[k] < a->uv_count);
        uv_point at = a->uv[links->to[k]];
        sum += links->weight[k];
        u += links->weight[k] * at.u;
        v += links->weight[k] * at.v;
    }
    if (!(sum > 0.0)) return;
    a->uv[i].u += factor * (u / sum - a->uv[i].u);
    a->uv[i].v += factor * (v / sum - a->uv[i].v);
}

/** Relaxes the parameters of all samples, in several sweeps. */
static void relax(parameterization *a, const patch_sweeps *sweeps)
{
    uint32_t count = (uint32_t)a->nodes->sample_count;
    int most = 0;
    for (size_t p = 0; p < a->r->layout.patch_count; p++)
        most = sweeps[p].count > most ? sweeps[p].count : most;
    for (int sweep = 0; sweep < most; sweep++) {
        for (uint32_t n = 0; n < count; n++) {
            uint32_t i = sweep % 2 ? count - 1 - n : n;
            if (a->link[i].count == 0 || sweep >= sweeps[a->label[i]].count) continue;
            relax_sample(a, i, sweeps[a->label[i]].factor);
        }
    }
}

/**
 * Divides weights by the stretch at the neighbour, the ratio of lengths on the surface to those in the
 * parameters: stretched regions then get more of the square.
 */
static void divide_weights(parameterization *a)
{
    uint32_t count = (uint32_t)a->nodes->sample_count;
    for (uint32_t i = 0; i < count; i++) {
        const patch_links *links = &a->link[i];
        double length2 = 0.0, parameter2 = 0.0;
        for (int k = 0; k < links->count; k++) {
            double du = a->uv[links->to[k]].u - a->uv[i].u, dv = a->uv[links->to[k]].v - a->uv[i].v;
            length2 += links->length2[k];
            parameter2 += du * du + dv * dv;
        }
        a->stretch[i] = parameter2 > 0.0 ? sqrt(length2 / parameter2) : 1.0;
    }
    for (uint32_t i = 0; i < count; i++) {
        patch_links *links = &a->link[i];
        double greatest = 0.0;
        for (int k = 0; k < links->count; k++) {
            uint32_t j = links->to[k];
            links->weight[k] /= a->stretch[j < count ? j : i];
            greatest = fmax(greatest, links->weight[k]);
        }
        /* Many rounds would underflow, in whatever unit the surface is. */
        for (int k = 0; k < links->count && greatest > 0.0; k++)
            links->weight[k] /= greatest;
    }
}

/** Ends the rounds of patches whose greatest stretch does not fall any more. True if any goes on. */
static bool end_rounds(const parameterization *a, int round, patch_sweeps *sweeps)
{
    size_t patches = a->r->layout.patch_count;
    bool is_moving = false;
    for (size_t i = 0; i < a->nodes->sample_count; i++) {
        if (a->label[i] == QM_NO_INDEX) continue;
        patch_sweeps *of = &sweeps[a->label[i]];
        of->now = fmax(of->now, a->stretch[i]);
        of->sum += a->stretch[i];
    }
    for (size_t p = 0; p < patches; p++) {
        bool falls = round <= STRETCH_ROUNDS || sweeps[p].now < STILL_FALLS * sweeps[p].least;
        if (falls) sweeps[p].least = sweeps[p].now;
        sweeps[p].idle = falls ? 0 : sweeps[p].idle + 1;
        bool is_even = sweeps[p].now * (double)sweeps[p].samples < STRETCHED * sweeps[p].sum;
        if (round >= STRETCH_ROUNDS && (is_even || sweeps[p].idle >= MAX_IDLE)) sweeps[p].count = 0;
        sweeps[p].now = sweeps[p].sum = 0.0;
        is_moving |= sweeps[p].count > 0;
    }
    return is_moving;
}

/** Relaxes the parameters from those of the nearest curves, and divides the weights by the stretch in between. */
static qm_status relax_all(parameterization *a)
{
    size_t patches = a->r->layout.patch_count;
    size_t *samples = qm_context_alloc(a->ctx, patches, sizeof *samples);
    patch_sweeps *sweeps = qm_context_alloc(a->ctx, patches, sizeof *sweeps);
    qm_status status = samples && sweeps ? QM_OK : no_memory(a->ctx);
    if (status == QM_OK) {
        memset(samples, 0, patches * sizeof *samples);
        for (size_t i = 0; i < a->nodes->sample_count; i++)
            if (a->label[i] != QM_NO_INDEX) samples[a->label[i]]++;
        for (size_t p = 0; p < patches; p++)
            sweeps[p] = find_sweeps(samples[p]);
        start_parameters(a);
        relax(a, sweeps);
    }
    bool is_moving = true;
    for (int round = 0; round < MAX_ROUNDS && status == QM_OK && is_moving; round++) {
        if (qm_context_canceled(a->ctx)) {
            status = qm_context_fail(a->ctx, QM_E_CANCELED, "reconstruction canceled");
            break;
        }
        divide_weights(a);
        is_moving = end_rounds(a, round, sweeps);
        relax(a, sweeps);
    }
    qm_context_free(a->ctx, samples, patches, sizeof *samples);
    qm_context_free(a->ctx, sweeps, patches, sizeof *sweeps);
    return status;
}

/** Keeps the samples, and the points of curves in each patch that they bound, with their parameters. */
static qm_status keep_anchors(parameterization *a)
{
    size_t samples = a->nodes->sample_count, border = a->nodes->count - samples;
    qm_anchors *anchors = &a->r->anchors;
    if (a->r->surface.is_cloud || a->r->guide || !a->r->has_sides) return QM_OK;
    if (!qm_anchors_allocate(a->ctx, samples + 2 * border, anchors)) return no_memory(a->ctx);
    for (size_t i = 0; i < samples; i++) {
        const float *normal = a->samples->normals + 3 * i;
        if (a->label[i] != QM_NO_INDEX)
            qm_anchors_add(anchors, a->nodes->positions + 3 * i, (qm_vec){normal[0], normal[1], normal[2]},
                           a->label[i], a->uv[i].u, a->uv[i].v);
    }
    anchors->sample_count = anchors->count;
    for (uint32_t i = (uint32_t)samples; i < (uint32_t)a->nodes->count; i++) {
        const border_node *node = border_node_of(a, i);
        for (int side = 0; side < 2 && node->curve != QM_NO_INDEX; side++) {
            uint32_t patch = a->beside[node->curve][side];
            uv_point at;
            if (patch != QM_NO_INDEX && border_uv(a, node, patch, &at))
                qm_anchors_add(anchors, a->nodes->positions + 3 * (size_t)i, a->graph.normal[i], patch, at.u,
                               at.v);
        }
    }
    return anchors->count > 0 ? qm_anchors_index(a->ctx, anchors) : QM_OK;
}

static qm_status parameterize(parameterization *a, qm_samples *samples)
{
    qm_status status = QM_OK;
    if (a->r->has_sides)
        qm_samples_orient_graph(samples, &a->graph);
    else
        status = qm_knn_graph_orient(a->ctx, &a->graph);
    if (status != QM_OK) return status;
    status = orient_by_normals(a->ctx, a->r, a->nodes, &a->graph);
    if (status != QM_OK || a->r->options.grids) return status;
    /* The patches beside each curve: each patch is to the left of the sides that run in its orientation. */
    const qm_layout *layout = &a->r->layout;
    for (size_t i = 0; i < layout->curve_count; i++)
        a->beside[i][0] = a->beside[i][1] = QM_NO_INDEX;
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++)
            a->beside[layout->patches[p].side[k]][layout->patches[p].against[k]] = (uint32_t)p;
    label_near_curves(a);
    status = propagate_labels(a);
    if (status != QM_OK) return status;
    a->uv_count = a->nodes->sample_count; /* and an entry for each link from a sample to a border node */
    for (size_t i = 0; i < a->nodes->sample_count; i++)
        for (int k = 0; k < QM_KNN_MAX_LINKS && a->graph.link[i][k] != QM_NO_INDEX; k++)
            a->uv_count += !is_sample(a, a->graph.link[i][k]);
    a->uv = qm_context_alloc(a->ctx, a->uv_count, sizeof *a->uv);
    if (!a->uv) return no_memory(a->ctx);
    status = relax_all(a);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < samples->count; i++) {
        uint32_t label = a->label[i];
        samples->location[i] = (qm_sample_location){.distance = INFINITY};
        if (label == QM_NO_INDEX) continue;
        samples->location[i] =
            (qm_sample_location){.patch = label,
                                 .u = qm_clamp(a->uv[i].u, 0.0, 1.0) * QM_RECONSTRUCTION_BASE,
                                 .v = qm_clamp(a->uv[i].v, 0.0, 1.0) * QM_RECONSTRUCTION_BASE};
    }
    return keep_anchors(a);
}

/** Parameterizes the samples over patches with a consistent orientation. */
static qm_status locate_samples(qm_context *ctx, qm_reconstruction *r, const graph_nodes *nodes,
                                qm_samples *samples)
{
    size_t count = samples->count, curves = r->layout.curve_count;
    parameterization a = {.ctx = ctx, .r = r, .nodes = nodes, .samples = samples};
    a.beside = qm_context_alloc(ctx, curves, sizeof *a.beside);
    a.label = qm_context_alloc(ctx, count, sizeof *a.label);
    a.distance = qm_context_alloc(ctx, count, sizeof *a.distance);
    a.nearest = qm_context_alloc(ctx, count, sizeof *a.nearest);
    a.stretch = qm_context_alloc(ctx, count, sizeof *a.stretch);
    a.link = qm_context_alloc(ctx, count, sizeof *a.link);
    qm_status status = QM_OK;
    if (!a.beside || !a.label || !a.distance || !a.nearest || !a.stretch || !a.link) status = no_memory(ctx);
    if (status == QM_OK) status = qm_knn_graph_build(ctx, nodes->positions, nodes->count, NULL, &a.graph);
    if (status == QM_OK) status = parameterize(&a, samples);
    qm_knn_graph_reset(ctx, &a.graph);
    qm_context_free(ctx, a.beside, curves, sizeof *a.beside);
    qm_context_free(ctx, a.label, count, sizeof *a.label);
    qm_context_free(ctx, a.distance, count, sizeof *a.distance);
    qm_context_free(ctx, a.nearest, count, sizeof *a.nearest);
    qm_context_free(ctx, a.uv, a.uv_count, sizeof *a.uv);
    qm_context_free(ctx, a.stretch, count, sizeof *a.stretch);
    qm_context_free(ctx, a.link, count, sizeof *a.link);
    return status;
}

qm_status qm_parameters_find(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    QM_ASSERT(ctx && r && samples);
    graph_nodes nodes = {0};
    qm_status status = qm_parameters_orient(ctx, r);
    if (status == QM_OK) status = create_nodes(ctx, r, samples, &nodes);
    if (status == QM_OK) status = locate_samples(ctx, r, &nodes, samples);
    free_nodes(ctx, &nodes);
    return status;
}
