/**
 * tmesh_curves.c: the curves of a layout on a surface.
 *
 * Every face of the layout is a lattice of STEPS x STEPS cells. Its vertices belong to a class of points (a node), to a
 * class of segments (inside a curve that is shared by faces of several T-mesh patches) or to one patch alone. They start at the
 * quads: where arcs without length have brought nodes together, in their middle. Then each moves to the mean of its
 * neighbours and back onto the surface, over and over.
 */
#include <math.h>
#include <string.h>

#include "core/vec.h"
#include "layout/layout_internal.h"
#include "tmesh/tmesh_lattice.h"

#define STEPS QM_LAYOUT_GRID
/* Rounds of sweeps, until no cell is folded, or STALLED_ROUNDS in a row leave no fewer. A point is pulled to its place by a share of the
 * way: a lattice round an ear would come off it otherwise, so that a place has no point within LOST edges. The more it is pulled, the
 * more cells stay folded: pulls are tried in this order, until there are neither. A required vertex is pulled by PULL, and by SLACKEN
 * times less after each round in which it is a corner of a folded face. */
static const double pulls[] = {0.03, 0.1, 0.3};
#define ROUNDS 12
#define STALLED_ROUNDS 3
#define SWEEPS 6
#define PULL 0.3
#define SLACKEN 0.5
#define REACH 0.1 /* of the diagonal: how far from the surface a lattice may be */
/* Folds that sweeps do not take out: rounds over their points, each of which tries places in TRIAL_WAYS directions at
 * TRIAL_SIZES distances, from half the mean edge on by halves, until all sines round it are GOOD_SINE. From farther places
 * cells may wind round a point twice, which no sine tells. */
/* Folds that remain, and then crossings, are drawn anew in charts with so many rings of cells; crossings several times. */
#define FOLD_RINGS 1
#define MENDS 6
#define UNTANGLE_ROUNDS 30
#define TRIAL_WAYS 8
#define TRIAL_SIZES 4
#define GOOD_SINE 0.1
/* Of the cells, before any is opened: of 26 layouts of models with good meshes 0.038 are folded at most, of layouts that no mesh could be made of 0.13 to 0.5. */
#define MOST_FOLDED 0.08
/* The chord between points of a curve may be so much of the diagonal off the surface, after so many halvings of one between lattice points. */
#define CURVE_OFF 5e-4
#define CURVE_HALVINGS 4
/* Rounds in which curves that cross with such points are drawn without them; after these all curves are. */
#define DENSE_ROUNDS 4

_Static_assert((1 << CURVE_HALVINGS) - 1 <= QM_TMESH_TRACE, "points between two of the lattice have room");

/** A feature between two required vertices, or a closed one from any node. */
typedef struct feature_chain {
    uint32_t first, count;         /* of the polyline's vertices */
    uint32_t first_station, steps; /* of the layout: it has steps + 1 stations */
} feature_chain;

/** An arc of a feature in its chain. */
typedef struct chain_arc {
    uint32_t chain;  /* QM_NO_INDEX: no feature */
    uint32_t step;   /* at its start in the direction of the chain */
    double place[2]; /* of its ends in that direction */
    bool forward;    /* it runs as the chain does */
} chain_arc;

typedef struct curve_drawer {
    qm_arena *arena;
    const qm_tmesh_quads *quads;
    const qm_patch_set *set;
    const qm_tmesh *tmesh;
    const uint32_t *length;
    const qm_tmesh_classes *classes;
    const qm_ref_surface *surface;
    const qm_tmesh_source *source;
    bool is_rough;                 /* for the grids alone: curves may cross */
    qm_tmesh_triangles *triangles; /* of the surface, made when they are needed */
    qm_tmesh_lattice lattice;
    double least_pull;      /* of a point to its place */
    qm_tmesh_traces traces; /* of curves that were drawn in charts */
    uint32_t *of_class;     /* by point class: its lattice point */
    uint32_t *of_segment;   /* by segment class: the first of its STEPS - 1 */
    size_t *first_cell;     /* by patch: of grid */
    uint32_t *grid;         /* lattice points of each patch with faces, row by row */
    /* features */
    feature_chain *chains;
    size_t chain_count;
    qm_vec *chain_point;
    double *chain_length; /* from the start of its chain */
    double *station;      /* places of the layout's points */
    chain_arc *arcs;      /* by arc */
} curve_drawer;

static qm_vec vertex_at(const curve_drawer *d, uint32_t vertex)
{
    return qm_vec_load(d->quads->mesh.positions + 3 * (size_t)vertex);
}

static uint32_t arc_vertex(const curve_drawer *d, uint32_t arc, uint32_t i)
{
    return qm_tmesh_arc_vertex(d->quads, d->set, d->tmesh, arc, i);
}

static qm_tmesh_place source_point(const curve_drawer *d, uint32_t point)
{
    return qm_tmesh_source_point(d->source, point);
}

static qm_tmesh_place arc_place(const curve_drawer *d, uint32_t arc, double share)
{
    return qm_tmesh_source_on_arc(d->source, arc, share);
}

/* ---- features as polylines ---- */

static bool is_chain_end(const curve_drawer *d, uint32_t node)
{
    return d->quads->is_required[d->tmesh->node_vertex[node]];
}

/** What has been used of the arrays of chains. */
typedef struct chain_use {
    size_t points, stations;
} chain_use;

/** Walks a chain from a node over an arc: its polyline, its arcs and its number of steps. */
static void walk_chain(curve_drawer *d, const uint32_t *node_arcs, uint32_t node, uint32_t arc,
                       chain_use *used)
{
    feature_chain *chain = &d->chains[d->chain_count];
    *chain = (feature_chain){.first = (uint32_t)used->points, .first_station = (uint32_t)used->stations};
    uint32_t start = node;
    d->chain_point[used->points] = vertex_at(d, d->tmesh->node_vertex[node]);
    d->chain_length[used->points++] = 0;
    do {
        const qm_tmesh_arc *at = &d->tmesh->arcs[arc];
        bool forward = at->from == node;
        chain_arc *in_chain = &d->arcs[arc];
        *in_chain = (chain_arc){.chain = (uint32_t)d->chain_count, .step = chain->steps, .forward = forward};
        in_chain->place[0] = d->chain_length[used->points - 1];
        for (uint32_t i = 1; i <= at->length; i++, used->points++) {
            qm_vec *to = &d->chain_point[used->points];
            *to = vertex_at(d, arc_vertex(d, arc, forward ? i : at->length - i));
            d->chain_length[used->points] =
                d->chain_length[used->points - 1] + qm_vec_distance(to[0], to[-1]);
        }
        in_chain->place[1] = d->chain_length[used->points - 1];
        chain->steps += d->length[arc];
        node = forward ? at->to : at->from;
        const uint32_t *pair = node_arcs + 2 * (size_t)node;
        arc = pair[0] == arc ? pair[1] : pair[0];
    } while (node != start && !is_chain_end(d, node));
    chain->count = (uint32_t)(used->points - chain->first);
    used->stations += chain->steps + 1;
    d->chain_count++;
}

/** Where the layout meets a chain: half way between where the quads do, which may be crowded, and equal steps. */
static bool place_stations(curve_drawer *d, size_t count)
{
    d->station = qm_arena_zeroed(d->arena, count, sizeof *d->station);
    uint32_t *met = qm_arena_zeroed(d->arena, count, sizeof *met);
    if (!d->station || !met) return false;
    for (size_t a = 0; a < d->tmesh->arc_count; a++) {
        const chain_arc *arc = &d->arcs[a];
        for (uint32_t i = 0; i <= d->length[a] && arc->chain != QM_NO_INDEX; i++) {
            size_t at = d->chains[arc->chain].first_station + arc->step + i;
            double share = d->length[a] > 0 ? (double)i / d->length[a] : 0.5;
            d->station[at] += arc->place[0] + share * (arc->place[1] - arc->place[0]);
            met[at]++;
        }
    }
    for (size_t c = 0; c < d->chain_count; c++) {
        const feature_chain *chain = &d->chains[c];
        double length = d->chain_length[chain->first + chain->count - 1];
        for (uint32_t i = 0; i <= chain->steps; i++) {
            size_t at = chain->first_station + i;
            double even = chain->steps > 0 ? length * i / chain->steps : 0;
            d->station[at] = i == 0 || i == chain->steps ? even : 0.5 * (even + d->station[at] / met[at]);
        }
    }
    return true;
}

static bool find_chains(curve_drawer *d)
{
    const qm_tmesh *tmesh = d->tmesh;
    size_t arcs = tmesh->arc_count, edges = 0;
    for (size_t a = 0; a < arcs; a++)
        edges += tmesh->arcs[a].is_feature ? tmesh->arcs[a].length + 1 : 0;
    d->chains = qm_arena_alloc(d->arena, arcs, sizeof *d->chains);
    d->chain_point = qm_arena_alloc(d->arena, edges + 1, sizeof *d->chain_point);
    d->chain_length = qm_arena_alloc(d->arena, edges + 1, sizeof *d->chain_length);
    d->arcs = qm_arena_alloc(d->arena, arcs, sizeof *d->arcs);
    uint32_t *node_arcs = qm_arena_alloc(d->arena, 2 * tmesh->node_count, sizeof *node_arcs);
    if (!d->chains || !d->chain_point || !d->chain_length || !d->arcs || !node_arcs) return false;
    memset(node_arcs, 0xff, 2 * tmesh->node_count * sizeof *node_arcs);
    for (uint32_t a = 0; a < arcs; a++) {
        d->arcs[a].chain = QM_NO_INDEX;
        const uint32_t end[2] = {tmesh->arcs[a].from, tmesh->arcs[a].to};
        for (int i = 0; i < 2 && tmesh->arcs[a].is_feature; i++) {
            uint32_t *pair = node_arcs + 2 * (size_t)end[i];
            pair[pair[0] != QM_NO_INDEX] = a; /* two, but at the ends of chains, where it does not matter */
        }
    }
    chain_use used = {0, 0};
    for (int from_ends = 1; from_ends >= 0; from_ends--)
        for (uint32_t a = 0; a < arcs; a++) {
            const qm_tmesh_arc *arc = &tmesh->arcs[a];
            if (!arc->is_feature || d->arcs[a].chain != QM_NO_INDEX) continue;
            if (!from_ends || is_chain_end(d, arc->from))
                walk_chain(d, node_arcs, arc->from, a, &used);
            else if (is_chain_end(d, arc->to))
                walk_chain(d, node_arcs, arc->to, a, &used);
        }
    return place_stations(d, used.stations);
}

static qm_vec chain_position(const curve_drawer *d, uint32_t chain, double place)
{
    const feature_chain *at = &d->chains[chain];
    size_t low = at->first, high = at->first + at->count - 1;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (d->chain_length[middle] <= place)
            low = middle;
        else
            high = middle;
    }
    double step = d->chain_length[high] - d->chain_length[low];
    return qm_vec_mix(d->chain_point[low], d->chain_point[high],
                      step > 0 ? qm_clamp((place - d->chain_length[low]) / step, 0, 1) : 0);
}

/* ---- lattice points and where they start ---- */

static uint32_t class_of(const curve_drawer *d, uint32_t point)
{
    return d->of_class[d->classes->point_class[point]];
}

/** The point of an arc at a step. */
static uint32_t arc_point(const curve_drawer *d, uint32_t arc, uint32_t step)
{
    if (step == 0) return d->tmesh->arcs[arc].from;
    return step == d->length[arc] ? d->tmesh->arcs[arc].to : d->classes->first_point[arc] + step - 1;
}

static void gather(qm_tmesh_point *to, qm_tmesh_place place)
{
    to->sum = qm_vec_add(to->sum, place.at);
    to->normal_sum = qm_vec_add(to->normal_sum, place.normal);
    to->count++;
}

static void fix(qm_tmesh_point *to, qm_vec at)
{
    to->at = at;
    to->is_fixed = true;
    to->chain = QM_NO_INDEX;
}

/** Fixes a point at a place of a chain; within the chain it may slide there. */
static void fix_on_chain(const curve_drawer *d, qm_tmesh_point *to, uint32_t chain, double place)
{
    const feature_chain *at = &d->chains[chain];
    fix(to, chain_position(d, chain, place));
    if (place > 0 && place < d->chain_length[at->first + at->count - 1]) to->chain = chain;
    to->place = place;
}

/** Places the classes of points: required vertices at themselves, features at their stations, others in the middle of what has
 * come together. */
static void place_classes(curve_drawer *d)
{
    const qm_tmesh *tmesh = d->tmesh;
    for (uint32_t n = 0; n < tmesh->node_count; n++)
        gather(&d->lattice.points[class_of(d, n)], source_point(d, d->source->node_points[n]));
    for (uint32_t a = 0; a < tmesh->arc_count; a++) {
        const chain_arc *in_chain = &d->arcs[a];
        uint32_t steps = d->length[a];
        for (uint32_t i = 1; i < steps; i++)
            gather(&d->lattice.points[class_of(d, arc_point(d, a, i))], arc_place(d, a, (double)i / steps));
        for (uint32_t i = 0; i <= steps && in_chain->chain != QM_NO_INDEX; i++) {
            uint32_t station = d->chains[in_chain->chain].first_station + in_chain->step + i;
            fix_on_chain(d,
                         &d->lattice.points[class_of(d, arc_point(d, a, in_chain->forward ? i : steps - i))],
                         in_chain->chain, d->station[station]);
        }
    }
    for (uint32_t n = 0; n < tmesh->node_count; n++)
        if (d->quads->is_required[tmesh->node_vertex[n]]) {
            qm_tmesh_point *to = &d->lattice.points[class_of(d, n)];
            qm_vec at = vertex_at(d, tmesh->node_vertex[n]);
            if (d->quads->is_on_feature[tmesh->node_vertex[n]]) fix(to, at);
            to->is_pinned = true;
            to->pin = at;
            qm_tmesh_place place = source_point(d, d->source->node_points[n]);
            to->sum = place.at;
            to->normal_sum = place.normal;
            to->count = 1;
        }
    for (size_t i = 0; i < d->lattice.point_count; i++) {
        qm_tmesh_point *point = &d->lattice.points[i];
        point->normal = point->normal_sum;
        if (!point->is_fixed && point->count > 0) point->at = qm_vec_scale(1.0 / point->count, point->sum);
    }
}

/** True when a segment's lattice points run as its arc: from the lower class to the higher. */
static bool runs_up(const curve_drawer *d, uint32_t arc, uint32_t step)
{
    return class_of(d, arc_point(d, arc, step)) < class_of(d, arc_point(d, arc, step + 1));
}

static void place_segments(curve_drawer *d)
{
    for (uint32_t a = 0; a < d->tmesh->arc_count; a++) {
        const chain_arc *in_chain = &d->arcs[a];
        uint32_t steps = d->length[a];
        for (uint32_t i = 0; i < steps; i++) {
            uint32_t segment = d->classes->segment_class[d->classes->first_segment[a] + i];
            bool up = runs_up(d, a, i), is_own = segment == d->classes->first_segment[a] + i;
            for (uint32_t k = 1; k < STEPS; k++) {
                qm_tmesh_point *to = &d->lattice.points[d->of_segment[segment] + (up ? k : STEPS - k) - 1];
                double share = (double)k / STEPS;
                qm_tmesh_place place = arc_place(d, a, (i + share) / steps);
                if (is_own) to->normal = place.normal;
                if (in_chain->chain != QM_NO_INDEX) {
                    uint32_t station = d->chains[in_chain->chain].first_station + in_chain->step +
                                       (in_chain->forward ? i : steps - 1 - i);
                    double along = in_chain->forward ? share : 1 - share;
                    fix_on_chain(d, to, in_chain->chain,
                                 d->station[station] +
                                     along * (d->station[station + 1] - d->station[station]));
                } else if (is_own && !to->is_fixed) {
                    to->at = place.at;
                }
            }
        }
    }
}

/** Numbers the points of the sides of a patch's grid. */
static void join_sides(curve_drawer *d, size_t p, uint32_t *grid, uint32_t columns, uint32_t rows)
{
    for (int side = 0; side < 4; side++) {
        uint32_t steps = qm_tmesh_side_steps(d->classes, p, side);
        for (uint32_t i = 0; i <= steps * STEPS; i++) {
            uint32_t step = i / STEPS, k = i % STEPS, point;
            if (k == 0) {
                point = class_of(d, qm_tmesh_side_point(d->classes, p, side, step));
            } else {
                uint32_t segment = qm_tmesh_side_segment(d->classes, p, side, step) >> 1;
                bool up = class_of(d, qm_tmesh_side_point(d->classes, p, side, step)) <
                          class_of(d, qm_tmesh_side_point(d->classes, p, side, step + 1));
                point = d->of_segment[d->classes->segment_class[segment]] + (up ? k : STEPS - k) - 1;
            }
            uint32_t column = side == 0 ? i : side == 1 ? columns : side == 2 ? columns - i : 0;
            uint32_t row = side == 0 ? 0 : side == 1 ? i : side == 2 ? rows : rows - i;
            grid[(size_t)row * (columns + 1) + column] = point;
        }
    }
}

static double side_cells(const curve_drawer *d, size_t p, int side, double place)
{
    return qm_tmesh_source_on_side(d->source, d->tmesh, d->length, p, side, place);
}

/** Adds the inner points of a patch's grid, at the places that its sides have in the quads. */
static void place_inside(curve_drawer *d, size_t p, uint32_t *grid, uint32_t columns, uint32_t rows)
{
    const uint32_t size[2] = {qm_tmesh_side_length(d->tmesh, d->source->arc_cells, p, 0),
                              qm_tmesh_side_length(d->tmesh, d->source->arc_cells, p, 1)};
    for (uint32_t row = 1; row < rows; row++) {
        double v = (double)row / STEPS, height = (double)rows / STEPS, right = side_cells(d, p, 1, v),
               left = size[1] - side_cells(d, p, 3, height - v);
        for (uint32_t column = 1; column < columns; column++) {
            double u = (double)column / STEPS, width = (double)columns / STEPS;
            double bottom = side_cells(d, p, 0, u), top = size[0] - side_cells(d, p, 2, width - u);
            qm_tmesh_place place =
                qm_tmesh_source_in_patch(d->source, d->tmesh, p, bottom + v / height * (top - bottom),
                                         left + u / width * (right - left));
            grid[(size_t)row * (columns + 1) + column] = (uint32_t)d->lattice.point_count;
            d->lattice.points[d->lattice.point_count++] =
                (qm_tmesh_point){.at = place.at, .normal = place.normal};
        }
    }
}

static bool has_faces(const curve_drawer *d, size_t p, uint32_t *columns, uint32_t *rows)
{
    *columns = STEPS * qm_tmesh_side_steps(d->classes, p, 0);
    *rows = STEPS * qm_tmesh_side_steps(d->classes, p, 1);
    return *columns > 0 && *rows > 0;
}

static bool make_lattices(curve_drawer *d)
{
    const qm_tmesh_classes *classes = d->classes;
    size_t cells = 0, inner = 0;
    uint32_t columns, rows;
    d->first_cell = qm_arena_alloc(d->arena, d->tmesh->patch_count, sizeof *d->first_cell);
    if (!d->first_cell) return false;
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        d->first_cell[p] = cells;
        if (!has_faces(d, p, &columns, &rows)) continue;
        cells += ((size_t)columns + 1) * (rows + 1);
        inner += ((size_t)columns - 1) * (rows - 1);
    }
    size_t capacity = classes->point_count + (STEPS - 1) * classes->segment_count + inner;
    d->grid = qm_arena_alloc(d->arena, cells, sizeof *d->grid);
    d->lattice.points = qm_arena_zeroed(d->arena, capacity, sizeof *d->lattice.points);
    d->of_class = qm_arena_alloc(d->arena, classes->point_count, sizeof *d->of_class);
    d->of_segment = qm_arena_alloc(d->arena, classes->segment_count, sizeof *d->of_segment);
    if (!d->grid || !d->lattice.points || !d->of_class || !d->of_segment) return false;
    for (size_t i = 0; i < classes->point_count; i++)
        if (classes->point_class[i] == i) d->of_class[i] = (uint32_t)d->lattice.point_count++;
    for (size_t i = 0; i < classes->segment_count; i++)
        if (classes->segment_class[i] == i) {
            d->of_segment[i] = (uint32_t)d->lattice.point_count;
            d->lattice.point_count += STEPS - 1;
        }
    place_classes(d);
    place_segments(d);
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        if (!has_faces(d, p, &columns, &rows)) continue;
        join_sides(d, p, d->grid + d->first_cell[p], columns, rows);
        place_inside(d, p, d->grid + d->first_cell[p], columns, rows);
    }
    return true;
}

/* ---- relaxation ---- */

/** Puts a point onto the wall of the surface that looks as it did there, one of a feature onto any. False, and the point is as it
 * was, where there is none near. */
static bool project(const curve_drawer *d, qm_tmesh_point *point)
{
    double at[3], normal[3];
    qm_ref_surface_point on;
    qm_vec_store(at, point->at);
    qm_vec_store(normal, point->normal);
    if (point->is_fixed || d->surface->is_cloud || !d->source->is_oriented ||
        qm_vec_norm2(point->normal) == 0)
        qm_ref_surface_project(d->surface, at, &on);
    else if (!qm_ref_surface_project_toward(d->surface, at, normal, REACH * d->surface->diagonal, &on))
        return false;
    point->at = qm_vec_load(on.position);
    point->normal = qm_vec_load(on.normal);
    return true;
}

/** Lists the cells, and those round each point. */
static bool list_cells(curve_drawer *d)
{
    size_t count = 0;
    uint32_t columns, rows;
    for (size_t p = 0; p < d->tmesh->patch_count; p++)
        if (has_faces(d, p, &columns, &rows)) count += (size_t)columns * rows;
    d->lattice.cells = qm_arena_alloc(d->arena, count, sizeof *d->lattice.cells);
    d->lattice.at = qm_arena_alloc(d->arena, 4 * count, sizeof *d->lattice.at);
    d->lattice.first_at = qm_arena_zeroed(d->arena, d->lattice.point_count + 1, sizeof *d->lattice.first_at);
    if (!d->lattice.cells || !d->lattice.at || !d->lattice.first_at) return false;
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        if (!has_faces(d, p, &columns, &rows)) continue;
        uint32_t stride = columns + 1;
        for (uint32_t row = 0; row < rows; row++)
            for (uint32_t column = 0; column < columns; column++) {
                size_t first = d->first_cell[p];
                const uint32_t *cell = d->grid + first + (size_t)row * stride + column;
                d->lattice.cells[d->lattice.cell_count++] = (qm_tmesh_cell){
                    {cell[0], cell[1], cell[stride + 1], cell[stride]},
                    (uint32_t)(first + (size_t)(row / STEPS * STEPS) * stride + column / STEPS * STEPS),
                    stride,
                    false,
                    false,
                    0};
            }
    }
    for (size_t c = 0; c < 4 * d->lattice.cell_count; c++)
        d->lattice.first_at[d->lattice.cells[c / 4].corner[c % 4]]++;
    uint32_t sum = 0;
    for (size_t i = 0; i <= d->lattice.point_count; i++)
        sum = d->lattice.first_at[i] += sum;
    for (size_t c = 4 * d->lattice.cell_count; c-- > 0;)
        d->lattice.at[--d->lattice.first_at[d->lattice.cells[c / 4].corner[c % 4]]] = (uint32_t)c;
    return true;
}

/**
 * The surface's normal at a corner of a cell. On a crease it has those of both sides, so that a point there takes the
 * cell's other points' normals.
 */
static qm_vec corner_normal(const curve_drawer *d, const qm_tmesh_cell *cell, uint32_t i)
{
    const qm_tmesh_point *point = &d->lattice.points[cell->corner[i]];
    if (!point->is_fixed) return point->normal;
    qm_vec sum = {0};
    for (uint32_t k = 0; k < 4; k++)
        if (!d->lattice.points[cell->corner[k]].is_fixed)
            sum = qm_vec_add(sum, d->lattice.points[cell->corner[k]].normal);
    double length = qm_vec_norm(sum);
    return length > 0 ? qm_vec_scale(1 / length, sum) : point->normal;
}

/** Twice the area of the triangle at a corner of a cell, about the surface's normal. */
static double corner_area(const curve_drawer *d, const qm_tmesh_cell *cell, uint32_t i)
{
    qm_vec at = d->lattice.points[cell->corner[i]].at;
    return cell->sign *
           qm_vec_dot(qm_vec_cross(qm_vec_sub(d->lattice.points[cell->corner[(i + 1) & 3]].at, at),
                                   qm_vec_sub(d->lattice.points[cell->corner[(i + 3) & 3]].at, at)),
                      corner_normal(d, cell, i));
}

/** The side on which most of each patch lies. */
static void find_signs(curve_drawer *d)
{
    size_t cell = 0;
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        uint32_t columns, rows;
        if (!has_faces(d, p, &columns, &rows)) continue;
        size_t end = cell + (size_t)columns * rows;
        double sum = 0;
        for (size_t c = cell; c < end; c++) {
            d->lattice.cells[c].sign = 1;
            for (uint32_t i = 0; i < 4; i++)
                sum += corner_area(d, &d->lattice.cells[c], i);
        }
        for (size_t c = cell; c < end; c++)
            d->lattice.cells[c].sign = sum < 0 ? -1 : 1;
        cell = end;
    }
}

/** Lets all points of a face move. */
static void loosen_face(curve_drawer *d, const qm_tmesh_cell *cell)
{
    for (uint32_t i = 0; i <= STEPS; i++)
        for (uint32_t j = 0; j <= STEPS; j++) {
            qm_tmesh_point *at = &d->lattice.points[d->grid[cell->face + (size_t)i * cell->stride + j]];
            at->is_loose = true;
            if (i % STEPS == 0 && j % STEPS == 0) at->pull = fmax(d->least_pull, SLACKEN * at->pull);
        }
}

/** Counts the folded cells; lets the points of their faces move, and pulls the required vertices of these less. */
static size_t count_folds(curve_drawer *d)
{
    size_t folds = 0;
    for (size_t c = 0; c < d->lattice.cell_count; c++) {
        qm_tmesh_cell *cell = &d->lattice.cells[c];
        cell->is_folded = false;
        for (uint32_t i = 0; i < 4 && !cell->is_charted; i++)
            cell->is_folded |= corner_area(d, cell, i) <= 0;
        if (!cell->is_folded) continue;
        folds++;
        loosen_face(d, cell);
    }
    return folds;
}

/** Moves a point to the mean of its neighbours, onto the wall that they are on. */
static void smooth_point(curve_drawer *d, uint32_t index)
{
    qm_tmesh_point *point = &d->lattice.points[index], old = *point;
    qm_vec sum = {0}, normal = {0};
    uint32_t count = 0;
    for (uint32_t i = d->lattice.first_at[index]; i < d->lattice.first_at[index + 1]; i++)
        for (uint32_t k = 1; k < 4; k += 2, count++) {
            const qm_tmesh_point *other =
                &d->lattice.points[d->lattice.cells[d->lattice.at[i] / 4].corner[(d->lattice.at[i] + k) & 3]];
            sum = qm_vec_add(sum, other->at);
            normal = qm_vec_add(normal, other->normal);
        }
    if (count == 0) return;
    point->at = qm_vec_scale(1.0 / count, sum);
    if (point->pull > 0) point->at = qm_vec_mix(point->at, point->pin, point->pull);
    point->normal = normal;
    if (!project(d, point)) *point = old;
}

static void place_on_surface(curve_drawer *d)
{
    for (size_t i = 0; i < d->lattice.point_count; i++) {
        qm_tmesh_point *point = &d->lattice.points[i];
        project(d, point);
        if (!point->is_pinned) point->pin = point->at;
    }
}

/** The sine at a corner of a cell, seen along the surface's normal there; not above 0 where it is folded. */
static double corner_sine(const curve_drawer *d, const qm_tmesh_cell *cell, uint32_t i)
{
    qm_vec at = d->lattice.points[cell->corner[i]].at;
    double one = qm_vec_distance(at, d->lattice.points[cell->corner[(i + 1) & 3]].at),
           other = qm_vec_distance(at, d->lattice.points[cell->corner[(i + 3) & 3]].at);
    if (!(one * other > 0)) return -1;
    return corner_area(d, cell, i) / (one * other);
}

/** What the cells round a point lack of GOOD_SINE at their corners, squared. */
static double lack_at(const curve_drawer *d, uint32_t index)
{
    double lack = 0;
    for (uint32_t i = d->lattice.first_at[index]; i < d->lattice.first_at[index + 1]; i++)
        for (uint32_t k = 0; k < 4; k++) {
            double missing = GOOD_SINE - corner_sine(d, &d->lattice.cells[d->lattice.at[i] / 4], k);
            if (missing > 0) lack += missing * missing;
        }
    return lack;
}

/** The mean length of the edges at a point. */
static double edge_at(const curve_drawer *d, uint32_t index)
{
    double sum = 0;
    uint32_t count = 0;
    for (uint32_t i = d->lattice.first_at[index]; i < d->lattice.first_at[index + 1]; i++)
        for (uint32_t k = 1; k < 4; k += 2, count++)
            sum += qm_vec_distance(
                d->lattice.points[index].at,
                d->lattice.points[d->lattice.cells[d->lattice.at[i] / 4].corner[(d->lattice.at[i] + k) & 3]]
                    .at);
    return count > 0 ? sum / count : 0;
}

/** Puts a fixed point elsewhere on its chain. False if that is beyond its ends. */
static bool slide(const curve_drawer *d, qm_tmesh_point *point, double by)
{
    const feature_chain *chain = &d->chains[point->chain];
    double place = point->place + by;
    if (!(place > 0 && place < d->chain_length[chain->first + chain->count - 1])) return false;
    point->place = place;
    point->at = chain_position(d, point->chain, place);
    return project(d, point);
}

/** Tries places round a point, farther and nearer ones, and takes those where the cells round it are better. */
static bool untangle_point(curve_drawer *d, uint32_t index)
{
    qm_tmesh_point *point = &d->lattice.points[index];
    double least = lack_at(d, index), reach = 0.5 * edge_at(d, index);
    bool has_moved = false;
    int ways = point->is_fixed ? 2 : TRIAL_WAYS;
    for (int size = 0; size < TRIAL_SIZES && least > 0; size++, reach *= 0.5)
        for (int way = 0; way < ways && least > 0; way++) {
            qm_tmesh_point before = *point;
            bool is_on = false;
            if (point->is_fixed) {
                is_on = slide(d, point, way == 0 ? reach : -reach);
            } else {
                qm_vec normal = point->normal, across = qm_vec_perpendicular(normal);
                double length = qm_vec_norm(across), angle = 360.0 * QM_DEGREE * way / TRIAL_WAYS;
                qm_vec right = length > 0 ? qm_vec_scale(1 / length, across) : (qm_vec){1, 0, 0};
                qm_vec along =
                    qm_vec_axpy(qm_vec_scale(cos(angle), right), sin(angle), qm_vec_cross(normal, right));
                point->at = qm_vec_axpy(point->at, reach, along);
                is_on = project(d, point);
            }
            double lack = is_on ? lack_at(d, index) : INFINITY;
            if (lack < least) {
                least = lack;
                has_moved = true;
            } else {
                *point = before;
            }
        }
    return has_moved;
}

/** Moves the points of folded cells, one by one, to where these are folded less. */
static size_t untangle(curve_drawer *d, size_t folds)
{
    for (int round = 0; round < UNTANGLE_ROUNDS && folds > 0 && !qm_context_canceled(d->arena->ctx);
         round++) {
        bool has_moved = false;
        for (size_t c = 0; c < d->lattice.cell_count; c++)
            for (uint32_t i = 0; i < 4 && d->lattice.cells[c].is_folded; i++)
                if (!d->lattice.points[d->lattice.cells[c].corner[i]].is_fixed ||
                    d->lattice.points[d->lattice.cells[c].corner[i]].chain != QM_NO_INDEX)
                    has_moved |= untangle_point(d, d->lattice.cells[c].corner[i]);
        folds = count_folds(d);
        if (!has_moved) break;
    }
    return folds;
}

/** Counts the places of points that the lattice has left: the tips of limbs. */
static size_t count_lost(const curve_drawer *d)
{
    size_t lost = 0;
    for (uint32_t i = 0; i < d->lattice.point_count; i++)
        lost += qm_tmesh_is_lost(&d->lattice, i);
    return lost;
}

/** Relaxes the points from where they are, pulled to their places; of all rounds the one with the fewest folds remains. best has room
 * for them. */
static qm_status relax_by(curve_drawer *d, double pull, qm_tmesh_point *best, size_t *folds)
{
    const size_t size = d->lattice.point_count * sizeof *best;
    size_t least = SIZE_MAX;
    int stalled = 0;
    d->least_pull = pull;
    for (size_t i = 0; i < d->lattice.point_count; i++)
        d->lattice.points[i].pull = d->lattice.points[i].is_pinned ? PULL : pull;
    for (int round = 0; round <= ROUNDS && stalled < STALLED_ROUNDS && least > 0; round++) {
        for (int sweep = 0; sweep < SWEEPS && round > 0; sweep++) {
            if (qm_context_canceled(d->arena->ctx))
                return qm_context_fail(d->arena->ctx, QM_E_CANCELED, "canceled");
            for (uint32_t i = 0; i < d->lattice.point_count; i++) {
                if (!d->lattice.points[i].is_fixed && d->lattice.points[i].is_loose) smooth_point(d, i);
            }
        }
        size_t now = count_folds(d);
        stalled = now < least ? 0 : stalled + 1;
        if (stalled > 0) continue;
        least = now;
        memcpy(best, d->lattice.points, size);
    }
    memcpy(d->lattice.points, best, size);
    *folds = least;
    return QM_OK;
}

/** Relaxes the points by one pull after the other, and keeps those with the smallest sum of folded cells and lost places. A rough drawing with
 * too many folded cells is refused: they do not open, and take long. */
static qm_status relax(curve_drawer *d, size_t *folds, bool *is_refused)
{
    const size_t count = d->lattice.point_count, size = count * sizeof *d->lattice.points;
    qm_tmesh_point *start = qm_arena_alloc(d->arena, count, sizeof *start);
    qm_tmesh_point *best = qm_arena_alloc(d->arena, count, sizeof *best);
    qm_tmesh_point *kept = qm_arena_alloc(d->arena, count, sizeof *kept);
    if (!best || !start || !kept || !list_cells(d))
        return qm_context_fail(d->arena->ctx, QM_E_NO_MEMORY, "out of memory for the curves");
    place_on_surface(d);
    find_signs(d);
    memcpy(start, d->lattice.points, size);
    size_t least = SIZE_MAX;
    qm_status status = QM_OK;
    for (size_t i = 0; i < sizeof pulls / sizeof *pulls && least > 0; i++) {
        size_t now = 0;
        memcpy(d->lattice.points, start, size);
        status = relax_by(d, pulls[i], best, &now);
        if (status != QM_OK) return status;
        *is_refused = i == 0 && d->is_rough && now > MOST_FOLDED * (double)d->lattice.cell_count;
        if (*is_refused) return QM_OK;
        count_folds(d);
        now = untangle(d, now);
        size_t lost = count_lost(d);
        if (now + lost >= least) continue;
        least = now + lost;
        *folds = now;
        memcpy(kept, d->lattice.points, size);
    }
    memcpy(d->lattice.points, kept, size);
    count_folds(d);
    return QM_OK;
}

/** Draws marked cells anew in charts of the surface. */
static qm_status mend(curve_drawer *d, bool *is_seed, int rings)
{
    if (d->surface->is_cloud) return QM_OK;
    if (!d->triangles->ctx) {
        qm_status status = qm_tmesh_triangles_make(d->arena->ctx, d->surface, d->triangles);
        if (status == QM_E_NO_MEMORY)
            qm_context_fail(d->arena->ctx, status, "out of memory for the triangles of the surface");
        if (status != QM_OK) return status;
    }
    return qm_tmesh_mend(d->arena, d->triangles, &d->lattice, is_seed, rings, &d->traces);
}

/** Draws folded cells anew, and counts those that remain. */
static qm_status mend_folds(curve_drawer *d, bool *is_seed, size_t *folds)
{
    for (size_t c = 0; c < d->lattice.cell_count; c++)
        is_seed[c] = d->lattice.cells[c].is_folded;
    qm_status status = *folds > 0 ? mend(d, is_seed, FOLD_RINGS) : QM_OK;
    *folds = count_folds(d);
    return status;
}

/* ---- the layout ---- */

/** What has been made of the lattices. */
typedef struct layout_maker {
    curve_drawer *d;
    qm_layout *out;
    uint32_t *node;  /* by lattice point */
    uint32_t *point; /* by node */
    uint32_t *curve; /* by the lattice point after the start of a curve from its lower end */
    uint32_t *lines; /* by curve: its STEPS + 1 lattice points */
    bool *is_sparse; /* by the middle lattice point of a curve: it has one point between each two */
    double *grids;   /* of the faces */
} layout_maker;

static qm_status node_of(layout_maker *maker, uint32_t point, uint32_t *node)
{
    if (maker->node[point] == QM_NO_INDEX) {
        double at[3];
        qm_vec_store(at, maker->d->lattice.points[point].at);
        qm_status status = qm_layout_add_node(maker->d->arena->ctx, maker->out, at);
        if (status != QM_OK) return status;
        maker->node[point] = (uint32_t)maker->out->node_count - 1;
        maker->point[maker->node[point]] = point;
    }
    *node = maker->node[point];
    return QM_OK;
}

/**
 * Adds points between two of a curve: the middle on the surface, and more, up to so many halvings, while that is CURVE_OFF away from the chord, so
 * that a curve does not cut off what the surface does between its points.
 */
static void add_between(const curve_drawer *d, const qm_tmesh_point *from, const qm_tmesh_point *to,
                        int halvings, double (*line)[3], size_t *count)
{
    qm_tmesh_point middle = from->is_fixed ? *to : *from; /* fixed where both are */
    middle.at = qm_vec_mix(from->at, to->at, 0.5);
    const qm_vec chord = middle.at;
    project(d, &middle);
    bool is_off = halvings > 1 && qm_vec_distance(chord, middle.at) > CURVE_OFF * d->surface->diagonal;
    if (is_off) add_between(d, from, &middle, halvings - 1, line, count);
    qm_vec_store(line[(*count)++], middle.at);
    if (is_off) add_between(d, &middle, to, halvings - 1, line, count);
}

/** The id of the curve over STEPS + 1 lattice points, with more points between each two, or their trace. */
static qm_status curve_of(layout_maker *maker, const uint32_t *point, uint32_t *id)
{
    curve_drawer *d = maker->d;
    uint32_t key = point[STEPS / 2];
    if (maker->curve[key] == QM_NO_INDEX) {
        uint32_t from, to;
        double line[(QM_TMESH_TRACE + 1) * STEPS + 1][3];
        size_t count = 0;
        qm_status status = node_of(maker, point[0], &from);
        if (status == QM_OK) status = node_of(maker, point[STEPS], &to);
        if (status != QM_OK) return status;
        for (int i = 0; i <= STEPS; i++) {
            const qm_tmesh_point *at = &d->lattice.points[point[i]];
            if (i == 0) {
                qm_vec_store(line[count++], at->at);
                continue;
            }
            const qm_tmesh_trace *trace = qm_tmesh_traces_find(&d->traces, point[i - 1], point[i]);
            if (trace) {
                for (int k = 0; k < QM_TMESH_TRACE; k++)
                    qm_vec_store(line[count++],
                                 trace->at[trace->point[0] == point[i - 1] ? k : QM_TMESH_TRACE - 1 - k]);
                qm_vec_store(line[count++], at->at);
                continue;
            }
            add_between(d, &d->lattice.points[point[i - 1]], at, maker->is_sparse[key] ? 1 : CURVE_HALVINGS,
                        line, &count);
            qm_vec_store(line[count++], at->at);
        }
        status = qm_layout_add_curve(d->arena->ctx, maker->out, from, to, line[0], count);
        if (status != QM_OK) return status;
        memcpy(maker->lines + (STEPS + 1) * (maker->out->curve_count - 1), point,
               (STEPS + 1) * sizeof *point);
        maker->curve[key] = maker->out->curves[maker->out->curve_count - 1].id;
    }
    *id = maker->curve[key];
    return QM_OK;
}

static qm_status add_face(layout_maker *maker, const uint32_t *cell, uint32_t stride)
{
    uint32_t id[4];
    for (int side = 0; side < 4; side++) {
        uint32_t line[STEPS + 1];
        for (uint32_t i = 0; i <= STEPS; i++) {
            uint32_t column = side == 0 ? i : side == 1 ? STEPS : side == 2 ? STEPS - i : 0;
            uint32_t row = side == 0 ? 0 : side == 1 ? i : side == 2 ? STEPS : STEPS - i;
            line[i] = cell[(size_t)row * stride + column];
        }
        qm_status status = curve_of(maker, line, &id[side]);
        if (status != QM_OK) return status;
    }
    double *at = maker->grids + 3 * QM_LAYOUT_GRID_POINTS * maker->out->patch_count;
    for (uint32_t row = 0; row <= STEPS; row++)
        for (uint32_t column = 0; column <= STEPS; column++, at += 3)
            qm_vec_store(at, maker->d->lattice.points[cell[(size_t)row * stride + column]].at);
    return qm_layout_add_patch(maker->d->arena->ctx, maker->out, id);
}

/** Marks lattice points: 1 at the corners of folded faces, 2 at the ends of curves that cross. */
static void mark_faults(const layout_maker *maker, const qm_layout_issues *issues, uint8_t *fault)
{
    curve_drawer *d = maker->d;
    count_folds(d);
    for (size_t c = 0; c < d->lattice.cell_count; c++) {
        const qm_tmesh_cell *cell = &d->lattice.cells[c];
        for (uint32_t i = 0; i < 4 && cell->is_folded; i++)
            fault[d->grid[cell->face + (size_t)(i / 2) * STEPS * cell->stride + i % 2 * STEPS]] = 1;
    }
    for (size_t i = 0; i < 2 * issues->count; i++) { /* curves were numbered from 0 */
        const qm_curve *curve = &maker->out->curves[issues->items[i / 2].curve[i % 2]];
        fault[maker->point[curve->from]] = fault[maker->point[curve->to]] = 2;
    }
}

/** Marks the cells at the curves that cross: those at the points nearest to where they do. */
static void mark_crossed(const layout_maker *maker, const qm_layout_issues *issues, bool *is_seed)
{
    const qm_tmesh_lattice *lattice = &maker->d->lattice;
    for (size_t i = 0; i < issues->count; i++) {
        qm_vec at = qm_vec_load(issues->items[i].position);
        for (int k = 0; k < 2; k++) {
            const uint32_t *line = maker->lines + (STEPS + 1) * (size_t)issues->items[i].curve[k];
            uint32_t nearest = line[0];
            for (int j = 1; j <= STEPS; j++)
                if (qm_vec_distance(lattice->points[line[j]].at, at) <
                    qm_vec_distance(lattice->points[nearest].at, at))
                    nearest = line[j];
            for (uint32_t j = lattice->first_at[nearest]; j < lattice->first_at[nearest + 1]; j++)
                is_seed[lattice->at[j] / 4] = true;
        }
    }
}

static qm_status add_faces(layout_maker *maker)
{
    curve_drawer *d = maker->d;
    memset(maker->node, 0xff, d->lattice.point_count * sizeof *maker->node);
    memset(maker->curve, 0xff, d->lattice.point_count * sizeof *maker->curve);
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        uint32_t columns, rows;
        if (!has_faces(d, p, &columns, &rows)) continue;
        const uint32_t *grid = d->grid + d->first_cell[p];
        for (uint32_t row = 0; row < rows; row += STEPS)
            for (uint32_t column = 0; column < columns; column += STEPS) {
                qm_status status = add_face(maker, grid + (size_t)row * (columns + 1) + column, columns + 1);
                if (status != QM_OK) return status;
            }
    }
    return QM_OK;
}

static size_t count_seeds(const curve_drawer *d, const bool *is_seed)
{
    size_t count = 0;
    for (size_t c = 0; c < d->lattice.cell_count; c++)
        count += is_seed[c];
    return count;
}

/** True when a curve lies along one feature: its inner points slide on that. */
static bool is_along_feature(const layout_maker *maker, size_t curve)
{
    const uint32_t *line = maker->lines + (STEPS + 1) * curve;
    const qm_tmesh_point *points = maker->d->lattice.points;
    for (int k = 1; k < STEPS; k++)
        if (!points[line[k]].is_fixed || points[line[k]].chain == QM_NO_INDEX ||
            points[line[k]].chain != points[line[1]].chain)
            return false;
    return true;
}

/** Marks the curves along features as sharp. */
static void mark_features(const layout_maker *maker)
{
    for (size_t c = 0; c < maker->out->curve_count; c++)
        if (is_along_feature(maker, c)) maker->out->curves[c].mark = QM_CURVE_SHARP;
}

/** Numbers the guides by the lattice points inside their curves: *start is the lattice point that each begins at. */
static void number_guides(const curve_drawer *d, const qm_tmesh_guides *all, uint32_t *of_point,
                          uint32_t *start)
{
    const qm_tmesh_classes *classes = d->classes;
    for (uint32_t i = 0; i < classes->segment_count; i++)
        for (uint32_t k = 0; k < STEPS - 1 && classes->segment_class[i] == i; k++) {
            of_point[d->of_segment[i] + k] = i;
            start[i] = d->of_class[all->from_class[i]];
        }
    uint32_t next = (uint32_t)classes->segment_count, columns, rows;
    for (size_t p = 0; p < d->tmesh->patch_count; p++) {
        if (!has_faces(d, p, &columns, &rows)) continue;
        for (uint32_t row = 0; row < rows; row += STEPS)
            for (uint32_t column = 0; column < columns; column += STEPS)
                for (uint32_t is_up = 0; is_up < 2; is_up++) {
                    if (is_up ? column == 0 : row == 0) continue;
                    const uint32_t *at = d->grid + d->first_cell[p] + (size_t)row * (columns + 1) + column;
                    for (uint32_t k = 1; k < STEPS; k++)
                        of_point[at[is_up ? (size_t)k * (columns + 1) : k]] = next;
                    start[next++] = at[0];
                }
    }
    QM_ASSERT(next == all->count);
}

/** Finds the guides of the curves, in their directions. False when out of memory. */
static bool copy_guides(const layout_maker *maker, qm_drawing *drawing)
{
    const curve_drawer *d = maker->d;
    qm_tmesh_guides all, *out = &drawing->guides;
    size_t curves = maker->out->curve_count, total = 0;
    if (!qm_tmesh_guides_find(d->arena, d->quads, d->tmesh, d->length, d->classes, d->source, d->surface,
                              &all))
        return false;
    uint32_t *of_point = qm_arena_alloc(d->arena, d->lattice.point_count, sizeof *of_point);
    uint32_t *start = qm_arena_alloc(d->arena, all.count, sizeof *start);
    out->first = qm_context_alloc(d->arena->ctx, curves + 1, sizeof *out->first);
    if (!out->first) return false;
    out->count = curves;
    out->first[curves] = 0;
    if (!of_point || !start) return false;
    number_guides(d, &all, of_point, start);
    for (size_t c = 0; c < curves; c++) {
        uint32_t guide = of_point[maker->lines[(STEPS + 1) * c + 1]];
        out->first[c] = total;
        total += all.first[guide + 1] - all.first[guide];
    }
    out->points = qm_context_alloc(d->arena->ctx, total, sizeof *out->points);
    out->first[curves] = out->points ? total : 0;
    if (!out->points) return false;
    for (size_t c = 0; c < curves; c++) {
        const uint32_t *line = maker->lines + (STEPS + 1) * c;
        uint32_t guide = of_point[line[1]];
        size_t count = out->first[c + 1] - out->first[c];
        for (size_t i = 0; i < count; i++)
            out->points[out->first[c] + i] =
                all.points[all.first[guide] + (start[guide] == line[0] ? i : count - 1 - i)];
    }
    return true;
}

/** Tells what is on features, and where curves come from. False when out of memory. */
static bool mark_origins(const layout_maker *maker, qm_drawing *drawing)
{
    const qm_layout *layout = maker->out;
    const qm_tmesh_point *points = maker->d->lattice.points;
    drawing->is_fixed = qm_context_alloc(maker->d->arena->ctx, layout->node_count, sizeof *drawing->is_fixed);
    drawing->is_line = qm_context_alloc(maker->d->arena->ctx, layout->curve_count, sizeof *drawing->is_line);
    if (!drawing->is_fixed || !drawing->is_line) return false;
    for (size_t n = 0; n < layout->node_count; n++)
        drawing->is_fixed[n] = points[maker->point[n]].is_fixed;
    for (size_t c = 0; c < layout->curve_count; c++)
        drawing->is_line[c] = points[maker->lines[(STEPS + 1) * c + STEPS / 2]].is_fixed;
    return copy_guides(maker, drawing);
}

/** Makes the nodes, curves and patches anew; finds crossings if they are wanted. */
static qm_status draw_faces(layout_maker *maker, bool finds_crossings, qm_layout_issues *issues)
{
    qm_context *ctx = maker->d->arena->ctx;
    qm_layout_reset(ctx, maker->out);
    qm_layout_issues_reset(ctx, issues);
    qm_status status = add_faces(maker);
    if (status == QM_OK && finds_crossings)
        status = qm_layout_find_crossings(ctx, maker->out, maker->d->surface, issues);
    return status;
}

/** Adds points to curves that do not cross where their chords leave the surface, but for those that cross then. */
static qm_status draw_dense(layout_maker *maker, qm_layout_issues *issues)
{
    const size_t points = maker->d->lattice.point_count;
    memset(maker->is_sparse, false, points);
    for (int round = 0; round < DENSE_ROUNDS; round++) {
        qm_status status = draw_faces(maker, true, issues);
        if (status != QM_OK || issues->count == 0) return status;
        for (size_t i = 0; i < issues->count; i++)
            for (int k = 0; k < 2; k++)
                maker->is_sparse[maker->lines[(STEPS + 1) * (size_t)issues->items[i].curve[k] + STEPS / 2]] =
                    true;
    }
    memset(maker->is_sparse, true, points);
    return draw_faces(maker, true, issues);
}

/** Makes the layout; while curves cross, the cells there are drawn anew, with more and more round them. In a rough one folded cells come first, alone. */
static qm_status make_layout(curve_drawer *d, qm_drawing *drawing, bool *is_seed, uint8_t *class_fault)
{
    qm_layout *out = &drawing->layout;
    layout_maker maker = {.d = d, .out = out, .grids = drawing->grids};
    size_t points = d->lattice.point_count;
    maker.node = qm_arena_alloc(d->arena, points, sizeof *maker.node);
    maker.point = qm_arena_alloc(d->arena, points, sizeof *maker.point);
    maker.curve = qm_arena_alloc(d->arena, points, sizeof *maker.curve);
    maker.lines = qm_arena_alloc(d->arena, points, (STEPS + 1) * sizeof *maker.lines);
    maker.is_sparse = qm_arena_alloc(d->arena, points, sizeof *maker.is_sparse);
    uint8_t *fault = qm_arena_zeroed(d->arena, points, sizeof *fault);
    if (!maker.is_sparse || !maker.node || !maker.point || !maker.curve || !maker.lines || !fault)
        return QM_E_NO_MEMORY;
    memset(maker.is_sparse, true, points);
    for (int round = 0;; round++) {
        bool is_folded = d->is_rough && count_folds(d) > 0;
        qm_status status = draw_faces(&maker, !is_folded, &drawing->issues);
        if (status != QM_OK) return status;
        bool is_clean = drawing->issues.count == 0 && !is_folded;
        if (is_clean || round == MENDS || d->surface->is_cloud) break;
        for (size_t c = 0; c < d->lattice.cell_count; c++)
            is_seed[c] = d->lattice.cells[c].is_folded;
        mark_crossed(&maker, &drawing->issues, is_seed);
        size_t before = count_seeds(d, is_seed);
        status = mend(d, is_seed, FOLD_RINGS + round);
        if (status != QM_OK) return status;
        if (count_seeds(d, is_seed) == before) break;
    }
    if (drawing->issues.count == 0 && !d->is_rough && !d->surface->is_cloud) {
        qm_status status = draw_dense(&maker, &drawing->issues);
        if (status != QM_OK) return status;
    }
    mark_features(&maker);
    mark_faults(&maker, &drawing->issues, fault);
    if (!mark_origins(&maker, drawing)) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < d->classes->point_count; i++)
        if (d->classes->point_class[i] == i) class_fault[i] = fault[d->of_class[i]];
    return QM_OK;
}

qm_status qm_tmesh_draw_curves(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set,
                               const qm_tmesh *tmesh, const uint32_t *length, const qm_tmesh_classes *classes,
                               const qm_ref_surface *surface, const qm_tmesh_source *source, bool is_rough,
                               qm_tmesh_triangles *triangles, qm_drawing *out, qm_tmesh_faults *faults)
{
    curve_drawer d = {.arena = arena,
                      .quads = quads,
                      .set = set,
                      .tmesh = tmesh,
                      .length = length,
                      .classes = classes,
                      .surface = surface,
                      .source = source,
                      .is_rough = is_rough,
                      .triangles = triangles};
    *faults = (qm_tmesh_faults){.class_fault = qm_arena_zeroed(arena, classes->point_count, 1)};
    out->grid_count = classes->face_count;
    out->grids =
        qm_context_alloc(arena->ctx, out->grid_count, 3 * QM_LAYOUT_GRID_POINTS * sizeof *out->grids);
    if (!out->grids || !faults->class_fault || !find_chains(&d) || !make_lattices(&d))
        return qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for the curves of %zu patches",
                               classes->face_count);
    qm_status status = relax(&d, &faults->folds, &faults->is_refused);
    if (status != QM_OK || faults->is_refused) return status;
    bool *is_seed = qm_arena_zeroed(arena, d.lattice.cell_count, sizeof *is_seed);
    if (status == QM_OK && !is_seed)
        status = qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for the curves");
    if (status == QM_OK) status = mend_folds(&d, is_seed, &faults->folds);
    if (status == QM_OK) status = make_layout(&d, out, is_seed, faults->class_fault);
    if (status == QM_OK) faults->folds = count_folds(&d);
    faults->crossings = out->issues.count;
    return status;
}
