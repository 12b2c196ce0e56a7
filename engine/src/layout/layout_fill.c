/**
 * layout_fill.c: cells of any number of sides become patches; a chord of patches gets new rows.
 *
 * A cell is filled by a pattern of curves inside it (in spirit: Takayama, Panozzo, Sorkine-Hornung, Pattern-based
 * quadrangulation for N-sided patches, 2014). Patterns fit an even number of nodes round the cell only, and look well only
 * where the corners of the quads are near right angles. So sides are cut where that helps; and a side that is cut cuts the
 * opposite side of the patch beyond it, and so on: the whole chord, up to a cell that is to be filled as well or to the
 * outside. The numbers of parts of the chords are chosen together, such that the quads that are added, and the bad corners
 * of the cells, cost least:
 *
 *   sides   parts                    pattern
 *   2       3 3 (both sharp)         two nodes of three curves each: 4 patches
 *   3       2 2 2                    a node of three curves: 3 patches
 *   4 + T   2 opposite the T         the curve goes on across: 2 patches, and so on along the chord
 *   5       2 1 1 1 1                from the cut to the corner opposite: 2 patches
 *   6       none                     between two opposite corners: 2 patches; or a node of three curves: 3
 *
 * Two cells at the ends of one chord share its cut, so that a T-junction and a pentagon, or two pentagons, are resolved by one
 * row of curves between them. The search is local: it starts without cuts, and with every side of the cells cut in two,
 * which always fits; the cheaper end is taken.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "core/union_find.h"
#include "layout_internal.h"
#include "layout_section.h"

#define MAX_POLYGON 48   /* nodes round a cell that patterns are sought for */
#define MAX_PARTS 4      /* of a chord that is cut to fill a cell */
#define NO_FIT 1e4       /* cost of a cell without a pattern */
#define WORST_CORNER 19  /* cost of a corner of 0 or 180 degrees or more, in patches */
#define IRREGULAR 0.5    /* cost of a node of three curves, in patches */
#define SIDE_SAMPLES 8   /* of a side, for the direction into its cell */
#define COONS_PIECES 12  /* of a curve that divides a patch */
#define MAX_FLAT 0.6     /* length of the mean direction into a cell from which it is the end of a limb */
#define MAX_CURVES 10000 /* of a layout whose chords are cut */
#define MAX_MOVES 4096   /* of the search */

enum { MAX_EDGES = MAX_POLYGON, MAX_INNER = 2, MAX_SPANS = 3 };

/** Curves of a pattern join corners by their numbers; inner nodes are counted after the corners. An inner node lies where
 * its spans, curves between two corners, have their middles. */
typedef struct pattern {
    uint8_t corners, quads, edge_count, inner_count;
    uint8_t edge[5][2];
    uint8_t span_count[MAX_INNER], span[MAX_INNER][MAX_SPANS][2];
} pattern;

static const pattern patterns[] = {
    {4, 1, 0, 0, {{0}}, {0}, {{{0}}}},
    {6, 2, 1, 0, {{0, 3}}, {0}, {{{0}}}},
    {6, 3, 3, 1, {{6, 0}, {6, 2}, {6, 4}}, {3}, {{{0, 3}, {2, 5}, {4, 1}}}},
    {6, 4, 5, 2, {{6, 1}, {6, 5}, {6, 7}, {7, 2}, {7, 4}}, {1, 1}, {{{1, 5}}, {{2, 4}}}},
    {8, 3, 2, 0, {{0, 3}, {7, 4}}, {0}, {{{0}}}},
    {8, 3, 2, 0, {{0, 3}, {0, 5}}, {0}, {{{0}}}},
    {8, 3, 2, 0, {{0, 3}, {3, 6}}, {0}, {{{0}}}},
    {8, 4, 4, 1, {{8, 0}, {8, 2}, {8, 4}, {8, 6}}, {2}, {{{0, 4}, {2, 6}}}},
    {8, 4, 4, 1, {{0, 3}, {8, 0}, {8, 4}, {8, 6}}, {3}, {{{0, 5}, {4, 7}, {6, 3}}}},
};

/** The curves that fill one cell, by the numbers of the nodes round it. */
typedef struct plan {
    double cost;
    size_t edge_count, inner_count;
    uint8_t edge[MAX_EDGES][2];
    uint8_t span_count[MAX_INNER], span[MAX_INNER][MAX_SPANS][2];
} plan;

typedef struct filling {
    qm_context *ctx;
    const qm_ref_surface *surface;
    const qm_layout *before; /* as it was, with curves that are not cut */
    qm_layout *layout;
    qm_layout_cells cells;
    size_t curve_count;
    uint32_t *chord;      /* of each curve; first as union-find trees, then numbers from 0 */
    uint32_t *parts;      /* of each chord */
    uint32_t *crossed;    /* of each chord: patches that it runs through */
    uint32_t (*end)[2];   /* of each chord: the chosen cells that it ends at, or QM_NO_INDEX */
    bool *is_chosen;      /* of each cell: it is to be filled */
    uint32_t *first_node; /* of each curve, in nodes: the nodes along it after it was cut */
    uint32_t *nodes;
    size_t chord_count, node_capacity;
} filling;

/* ---- patterns ---- */

/** What a corner costs whose angle is shared by some quads. */
static double corner_cost(double angle, int quads)
{
    double each = angle / quads, sine = each < QM_STRAIGHT_ANGLE ? sin(each) : 0.0;
    return quads * fmin(sine > 0.0 ? 1.0 / sine - 1.0 : WORST_CORNER, WORST_CORNER);
}

static int pattern_corner(const pattern *p, int rotation, bool is_mirrored, int corner)
{
    return corner >= p->corners ? corner
                                : (rotation + (is_mirrored ? p->corners - corner : corner)) % p->corners;
}

static double pattern_cost(const pattern *p, int rotation, bool is_mirrored, const double *angle)
{
    int quads[MAX_POLYGON + MAX_INNER] = {0};
    for (int e = 0; e < p->edge_count; e++)
        for (int k = 0; k < 2; k++)
            quads[pattern_corner(p, rotation, is_mirrored, p->edge[e][k])]++;
    double cost = p->quads;
    for (int i = 0; i < p->corners; i++)
        cost += corner_cost(angle[i], quads[i] + 1);
    for (int i = 0; i < p->inner_count; i++)
        cost += quads[p->corners + i] == 4 ? 0.0 : IRREGULAR;
    return cost;
}

/** Adds the cheapest pattern for the nodes left; map gives their numbers. */
static void add_pattern(int count, const double *angle, const uint8_t *map, int all, plan *out)
{
    double best = INFINITY;
    const pattern *found = NULL;
    int found_rotation = 0;
    bool found_mirrored = false;
    for (size_t i = 0; i < sizeof patterns / sizeof *patterns; i++) {
        if (patterns[i].corners != count) continue;
        for (int turn = 0; turn < 2 * count; turn++) {
            double cost = pattern_cost(&patterns[i], turn / 2, turn % 2, angle);
            if (cost >= best) continue;
            best = cost;
            found = &patterns[i];
            found_rotation = turn / 2;
            found_mirrored = turn % 2;
        }
    }
    out->cost += found ? best : NO_FIT;
    if (!found) return;
    out->inner_count = found->inner_count;
    for (int e = 0; e < found->edge_count; e++, out->edge_count++)
        for (int k = 0; k < 2; k++) {
            int corner = pattern_corner(found, found_rotation, found_mirrored, found->edge[e][k]);
            out->edge[out->edge_count][k] = (uint8_t)(corner < count ? map[corner] : all + corner - count);
        }
    for (int i = 0; i < found->inner_count; i++) {
        out->span_count[i] = found->span_count[i];
        for (int s = 0; s < found->span_count[i]; s++)
            for (int k = 0; k < 2; k++)
                out->span[i][s][k] =
                    map[pattern_corner(found, found_rotation, found_mirrored, found->span[i][s][k])];
    }
}

/** Plans the curves that fill a cell with nodes of these angles. Quads are cut off one by one where eight nodes are too many. */
static plan make_plan(int count, const double *angle)
{
    plan out = {0};
    double left[MAX_POLYGON];
    uint8_t map[MAX_POLYGON];
    int all = count;
    for (int i = 0; i < count; i++) {
        left[i] = angle[i];
        map[i] = (uint8_t)i;
    }
    while (count > 8) {
        double best = INFINITY;
        int at = 0;
        for (int i = 0; i < count; i++) {
            double cost = corner_cost(left[i], 2) + corner_cost(left[(i + 1) % count], 1) +
                          corner_cost(left[(i + 2) % count], 1) + corner_cost(left[(i + 3) % count], 2);
            if (cost >= best) continue;
            best = cost;
            at = i;
        }
        int end = (at + 3) % count;
        out.cost += 1.0 + corner_cost(left[(at + 1) % count], 1) + corner_cost(left[(at + 2) % count], 1) +
                    corner_cost(0.5 * left[at], 1) + corner_cost(0.5 * left[end], 1);
        out.edge[out.edge_count][0] = map[at];
        out.edge[out.edge_count++][1] = map[end];
        left[at] *= 0.5;
        left[end] *= 0.5;
        int kept = 0;
        for (int i = 0; i < count; i++) {
            if (i == (at + 1) % count || i == (at + 2) % count) continue;
            left[kept] = left[i];
            map[kept++] = map[i];
        }
        count = kept;
    }
    add_pattern(count, left, map, all, &out);
    return out;
}

/* ---- chords ---- */

static uint32_t chord_of(const filling *f, uint32_t dart)
{
    return f->chord[dart / 2];
}

static uint32_t cell_dart(const filling *f, const qm_layout_cell *cell, uint32_t side)
{
    return f->cells.dart[cell->first + side % cell->sides];
}

static void number_chords(filling *f)
{
    for (uint32_t i = 0; i < f->curve_count; i++)
        f->chord[i] = i;
    for (size_t i = 0; i < f->cells.count; i++) {
        const qm_layout_cell *cell = &f->cells.cells[i];
        for (uint32_t side = 0; side < 2 && qm_layout_cell_is_patch(cell); side++) {
            qm_union_find_join(f->chord, cell_dart(f, cell, side) / 2, cell_dart(f, cell, side + 2) / 2);
        }
    }
    for (uint32_t i = 0; i < f->curve_count; i++) /* roots are the lowest curves of their trees */
        f->parts[i] = qm_union_find_root(f->chord, i);
    for (uint32_t i = 0; i < f->curve_count; i++)
        f->chord[i] = f->parts[i] == i ? (uint32_t)f->chord_count++ : f->chord[f->parts[i]];
    for (size_t i = 0; i < f->chord_count; i++) {
        f->parts[i] = 1;
        f->crossed[i] = 0;
    }
    for (size_t i = 0; i < f->cells.count; i++)
        for (uint32_t side = 0; side < 2 && qm_layout_cell_is_patch(&f->cells.cells[i]); side++)
            f->crossed[chord_of(f, cell_dart(f, &f->cells.cells[i], side))]++;
}

/** The angles of the nodes round a cell, those of cuts too. Returns their number, 0 if they are too many. */
static int cell_angles(const filling *f, const qm_layout_cell *cell, double angle[MAX_POLYGON])
{
    size_t count = 0;
    for (uint32_t side = 0; side < cell->sides; side++) {
        uint32_t dart = cell_dart(f, cell, side), parts = f->parts[chord_of(f, dart)];
        if (count + parts > MAX_POLYGON) return 0;
        angle[count++] = f->cells.corner[dart];
        for (uint32_t k = 1; k < parts; k++)
            angle[count++] = QM_STRAIGHT_ANGLE;
    }
    return (int)count;
}

static double cell_cost(const filling *f, const qm_layout_cell *cell)
{
    double angle[MAX_POLYGON];
    int count = cell_angles(f, cell, angle);
    return count < 4 || count % 2 != 0 ? NO_FIT : make_plan(count, angle).cost;
}

/** What two chords cost, which may be the same: the patches that their cuts add, and the cells that they end at. */
static double chord_cost(const filling *f, uint32_t a, uint32_t b)
{
    const uint32_t cell[4] = {f->end[a][0], f->end[a][1], f->end[b][0], f->end[b][1]};
    double cost = (f->parts[a] - 1.0) * f->crossed[a];
    if (b != a) cost += (f->parts[b] - 1.0) * f->crossed[b];
    for (int i = 0; i < 4; i++) {
        bool is_new = cell[i] != QM_NO_INDEX;
        for (int k = 0; k < i; k++)
            is_new &= cell[k] != cell[i];
        if (is_new) cost += cell_cost(f, &f->cells.cells[cell[i]]);
    }
    return cost;
}

static double total_cost(const filling *f)
{
    double cost = 0.0;
    for (size_t i = 0; i < f->cells.count; i++)
        if (f->is_chosen[i]) cost += cell_cost(f, &f->cells.cells[i]);
    for (size_t i = 0; i < f->chord_count; i++)
        cost += (f->parts[i] - 1.0) * f->crossed[i];
    return cost;
}

/** Notes at which chosen cells each chord ends. */
static void find_ends(filling *f)
{
    for (size_t i = 0; i < f->chord_count; i++)
        f->end[i][0] = f->end[i][1] = QM_NO_INDEX;
    for (uint32_t i = 0; i < f->cells.count; i++)
        for (uint32_t side = 0; f->is_chosen[i] && side < f->cells.cells[i].sides; side++) {
            uint32_t *end = f->end[chord_of(f, cell_dart(f, &f->cells.cells[i], side))];
            QM_ASSERT(end[0] == QM_NO_INDEX || end[1] == QM_NO_INDEX); /* a row of patches has two ends */
            end[end[0] != QM_NO_INDEX] = i;
        }
}

/** True, and the parts are changed, if both chords can be by these numbers; a chord with itself by one of them. */
static bool change_parts(filling *f, uint32_t a, int by_a, uint32_t b, int by_b)
{
    int64_t to_a = (int64_t)f->parts[a] + by_a, to_b = (int64_t)f->parts[b] + by_b;
    if (to_a < 1 || to_a > MAX_PARTS || to_b < 1 || to_b > MAX_PARTS) return false;
    f->parts[a] = (uint32_t)to_a;
    f->parts[b] = (uint32_t)to_b;
    return true;
}

/** Tries each change of one chord, or of two, that end at a cell. True if one lowers the cost. */
static bool improve_cell(filling *f, const qm_layout_cell *cell)
{
    static const int step[][2] = {{1, 0}, {-1, 0}, {1, 1}, {-1, -1}, {1, -1}, {-1, 1}};
    bool is_better = false;
    for (uint32_t i = 0; i < cell->sides; i++)
        for (uint32_t k = i; k < cell->sides; k++)
            for (size_t s = 0; s < sizeof step / sizeof *step; s++) {
                uint32_t a = chord_of(f, cell_dart(f, cell, i)), b = chord_of(f, cell_dart(f, cell, k));
                bool is_single = step[s][1] == 0;
                if ((a == b) != is_single) continue;
                uint32_t before[2] = {f->parts[a], f->parts[b]};
                double cost = chord_cost(f, a, b);
                if (!change_parts(f, a, step[s][0], b, is_single ? step[s][0] : step[s][1])) continue;
                if (chord_cost(f, a, b) < cost - 1e-9) {
                    is_better = true;
                } else {
                    f->parts[a] = before[0];
                    f->parts[b] = before[1];
                }
            }
    return is_better;
}

static double improve(filling *f)
{
    bool is_better = true;
    for (int round = 0; is_better && round < MAX_MOVES; round++) {
        is_better = false;
        for (size_t i = 0; i < f->cells.count && !qm_context_canceled(f->ctx); i++)
            if (f->is_chosen[i]) is_better |= improve_cell(f, &f->cells.cells[i]);
    }
    return total_cost(f);
}

/** Chooses the numbers of parts of all chords. */
static qm_status choose_parts(filling *f)
{
    size_t count = f->chord_count;
    find_ends(f);
    double cost = improve(f);
    uint32_t *found = qm_context_alloc(f->ctx, count, sizeof *found);
    if (!found) return qm_context_fail(f->ctx, QM_E_NO_MEMORY, "out of memory for the chords");
    memcpy(found, f->parts, count * sizeof *found);
    for (size_t i = 0; i < count; i++)
        f->parts[i] = 1;
    for (size_t i = 0; i < f->cells.count; i++)
        for (uint32_t side = 0; f->is_chosen[i] && side < f->cells.cells[i].sides; side++)
            f->parts[chord_of(f, cell_dart(f, &f->cells.cells[i], side))] = 2;
    if (improve(f) >= cost) memcpy(f->parts, found, count * sizeof *found);
    qm_context_free(f->ctx, found, count, sizeof *found);
    return qm_context_canceled(f->ctx) ? QM_E_CANCELED : QM_OK;
}

/* ---- drawing ---- */

static qm_vec node_at(const filling *f, uint32_t node)
{
    return qm_vec_load(f->layout->nodes + 3 * (size_t)node);
}

static qm_status add_node(filling *f, qm_vec at, uint32_t *node)
{
    double position[3], projected[3];
    qm_ref_surface_point point;
    qm_vec_store(position, at);
    qm_ref_surface_project(f->surface, position, &point);
    memcpy(projected, point.position, sizeof projected);
    *node = (uint32_t)f->layout->node_count;
    return qm_layout_add_node(f->ctx, f->layout, projected);
}

static qm_status cut_curves(filling *f)
{
    qm_status status = QM_OK;
    size_t used = 0;
    for (uint32_t i = 0; i < f->curve_count; i++) {
        f->first_node[i] = (uint32_t)used;
        used += f->parts[f->chord[i]] + 1;
    }
    f->nodes = qm_context_alloc(f->ctx, used, sizeof *f->nodes);
    if (!f->nodes) return qm_context_fail(f->ctx, QM_E_NO_MEMORY, "out of memory for the nodes of curves");
    f->node_capacity = used;
    for (uint32_t i = 0; i < f->curve_count && status == QM_OK; i++)
        status =
            qm_layout_cut_curve(f->ctx, f->layout, i, f->parts[f->chord[i]], f->nodes + f->first_node[i]);
    return status;
}

/** Node k along a dart. */
static uint32_t dart_node(const filling *f, uint32_t dart, uint32_t k)
{
    uint32_t parts = f->parts[chord_of(f, dart)];
    return f->nodes[f->first_node[dart / 2] + (dart % 2 ? parts - k : k)];
}

/** The place at a share of a dart's length, as it was before it was cut. */
static qm_vec dart_at(const filling *f, uint32_t dart, double share)
{
    const qm_curve *curve = &f->before->curves[dart / 2];
    const qm_section line = {curve->points, curve->point_count, curve->point_count};
    return qm_section_at(&line, qm_section_length(&line) * (dart % 2 ? 1.0 - share : share));
}

/** The mean direction into a cell from its sides: near 0 in a flat one, along the limb in its end. */
static qm_vec cell_inward(const filling *f, const qm_layout_cell *cell)
{
    qm_vec sum = {0, 0, 0};
    double total = 0.0;
    for (uint32_t side = 0; side < cell->sides; side++) {
        uint32_t dart = cell_dart(f, cell, side);
        qm_vec normal = f->cells.normal[dart_node(f, dart, 0)], a = dart_at(f, dart, 0.0);
        for (int k = 0; k < SIDE_SAMPLES; k++) {
            double at[3];
            qm_ref_surface_point point;
            qm_vec b = dart_at(f, dart, (k + 1.0) / SIDE_SAMPLES), piece = qm_vec_sub(b, a);
            qm_vec_store(at, dart_at(f, dart, (k + 0.5) / SIDE_SAMPLES));
            qm_ref_surface_project(f->surface, at, &point);
            qm_vec own = qm_vec_load(point.normal);
            if (f->surface->is_cloud && qm_vec_dot(own, normal) < 0.0) own = qm_vec_scale(-1.0, own);
            if (qm_vec_norm2(own) > 0.0) normal = own;
            sum = qm_vec_add(sum, qm_vec_cross(normal, piece));
            total += qm_vec_norm(piece);
            a = b;
        }
    }
    return total > 0.0 ? qm_vec_scale(1.0 / total, sum) : sum;
}

/** The line that a curve between two nodes would follow if there were no others. */
static qm_status find_line(filling *f, uint32_t from, uint32_t to, qm_vec inward, qm_section *line)
{
    qm_vec start = node_at(f, from), end = node_at(f, to);
    qm_status status = qm_section_between(f->ctx, f->surface, start, end, inward, 0.0, line);
    if (status == QM_OK && line->count < 2) status = qm_section_project(f->ctx, f->surface, start, end, line);
    return status;
}

static qm_status add_between(filling *f, uint32_t from, uint32_t to, qm_vec inward)
{
    return qm_layout_draw_curve(f->ctx, f->layout, f->surface, from, to, inward);
}

/** Draws row r of a patch between its left and right sides, cut where the columns pass. */
static qm_status draw_row(filling *f, uint32_t from, uint32_t to, qm_vec inward, uint32_t columns,
                          uint32_t *nodes)
{
    qm_section line;
    qm_status status = find_line(f, from, to, inward, &line);
    if (status != QM_OK) return status;
    double length = qm_section_length(&line);
    nodes[0] = from;
    nodes[columns] = to;
    for (uint32_t c = 1; c < columns && status == QM_OK; c++)
        status = add_node(f, qm_section_at(&line, length * c / columns), &nodes[c]);
    for (uint32_t c = 0; c < columns && status == QM_OK; c++)
        status = add_between(f, nodes[c], nodes[c + 1], inward);
    qm_section_reset(f->ctx, &line);
    return status;
}

/** The Coons patch of the sides of a patch, u along the first one and v along the second (Coons 1967). */
static qm_vec coons_at(const filling *f, const qm_layout_cell *cell, double u, double v)
{
    qm_vec bottom = dart_at(f, cell_dart(f, cell, 0), u), right = dart_at(f, cell_dart(f, cell, 1), v),
           top = dart_at(f, cell_dart(f, cell, 2), 1.0 - u),
           left = dart_at(f, cell_dart(f, cell, 3), 1.0 - v);
    qm_vec corner[4];
    for (uint32_t k = 0; k < 4; k++)
        corner[k] = dart_at(f, cell_dart(f, cell, k), 0.0);
    qm_vec bilinear = qm_vec_mix(qm_vec_mix(corner[0], corner[1], u), qm_vec_mix(corner[3], corner[2], u), v);
    return qm_vec_sub(qm_vec_add(qm_vec_mix(bottom, top, v), qm_vec_mix(left, right, u)), bilinear);
}

/** Adds the curve of the Coons patch between two nodes of the lattice. Each point is put on the wall that the one before it
 * lies on, so that the curve turns round edges and does not change to the other side of a sheet. */
static qm_status add_coons_curve(filling *f, const qm_layout_cell *cell, const uint32_t node[2],
                                 const double from[2], const double to[2])
{
    double points[3 * (COONS_PIECES + 1)] = {0};
    qm_ref_surface_point at;
    qm_ref_surface_project(f->surface, f->layout->nodes + 3 * (size_t)node[0], &at);
    double reach = qm_vec_distance(node_at(f, node[0]), node_at(f, node[1]));
    size_t count = 0;
    for (int k = 0; k <= COONS_PIECES; k++) {
        double t = (double)k / COONS_PIECES, place[3], normal[3] = {at.normal[0], at.normal[1], at.normal[2]};
        qm_vec_store(place,
                     coons_at(f, cell, (1.0 - t) * from[0] + t * to[0], (1.0 - t) * from[1] + t * to[1]));
        if (reach > 0.0 && qm_vec_norm2(qm_vec_load(normal)) > 0.0)
            qm_ref_surface_project_toward(f->surface, place, normal, reach, &at);
        else
            qm_ref_surface_project(f->surface, place, &at);
        /* A point that repeats the one before gives no direction; the last one becomes the node. */
        qm_vec here = qm_vec_load(at.position);
        bool is_new = count == 0 || qm_vec_distance(here, qm_vec_load(points + 3 * count - 3)) > 1e-6 * reach;
        if (is_new) qm_vec_store(points + 3 * count++, here);
    }
    if (count == 1) count = 2; /* both ends become nodes */
    return qm_layout_add_curve(f->ctx, f->layout, node[0], node[1], points, count);
}

/** Divides a patch that is not the end of a limb along the lines of its Coons patch, which follow its sides. */
static qm_status divide_coons_patch(filling *f, const qm_layout_cell *cell, uint32_t columns, uint32_t rows,
                                    uint32_t *nodes)
{
    uint32_t *below = nodes, *here = nodes + columns + 1;
    qm_status status = QM_OK;
    for (uint32_t r = 1; r <= rows && status == QM_OK; r++) {
        double v = (double)r / rows, lower = (r - 1.0) / rows;
        here[0] = dart_node(f, cell_dart(f, cell, 3), rows - r);
        here[columns] = dart_node(f, cell_dart(f, cell, 1), r);
        for (uint32_t c = 1; c < columns && status == QM_OK; c++) {
            if (r == rows)
                here[c] = dart_node(f, cell_dart(f, cell, 2), columns - c);
            else
                status = add_node(f, coons_at(f, cell, (double)c / columns, v), &here[c]);
        }
        for (uint32_t c = 0; c < columns && status == QM_OK; c++) {
            double left = (double)c / columns, right = (c + 1.0) / columns;
            const uint32_t along[2] = {here[c], here[c + 1]}, up[2] = {below[c], here[c]};
            if (r < rows)
                status =
                    add_coons_curve(f, cell, along, (const double[]){left, v}, (const double[]){right, v});
            if (c > 0 && status == QM_OK)
                status =
                    add_coons_curve(f, cell, up, (const double[]){left, lower}, (const double[]){left, v});
        }
        memcpy(below, here, (columns + 1) * sizeof *below);
    }
    return status;
}

/** Draws the rows and columns of a patch whose sides were cut. */
static qm_status divide_patch(filling *f, const qm_layout_cell *cell)
{
    uint32_t bottom = cell_dart(f, cell, 0), right = cell_dart(f, cell, 1), top = cell_dart(f, cell, 2),
             left = cell_dart(f, cell, 3);
    uint32_t columns = f->parts[chord_of(f, bottom)], rows = f->parts[chord_of(f, right)];
    if (columns == 1 && rows == 1) return QM_OK;
    qm_vec inward = cell_inward(f, cell);
    size_t size = 2 * ((size_t)columns + 1);
    uint32_t *nodes = qm_context_alloc(f->ctx, size, sizeof *nodes);
    if (!nodes) return qm_context_fail(f->ctx, QM_E_NO_MEMORY, "out of memory for a row of curves");
    uint32_t *below = nodes, *here = nodes + columns + 1;
    qm_status status = QM_OK;
    for (uint32_t c = 0; c <= columns; c++)
        below[c] = dart_node(f, bottom, c);
    if (qm_vec_norm(inward) < MAX_FLAT) {
        status = divide_coons_patch(f, cell, columns, rows, nodes);
        rows = 0;
    }
    for (uint32_t r = 1; r <= rows && status == QM_OK; r++) {
        if (r == rows)
            for (uint32_t c = 0; c <= columns; c++)
                here[c] = dart_node(f, top, columns - c);
        else
            status = draw_row(f, dart_node(f, left, rows - r), dart_node(f, right, r), inward, columns, here);
        for (uint32_t c = 1; c < columns && status == QM_OK; c++)
            status = add_between(f, below[c], here[c], inward);
        memcpy(below, here, (columns + 1) * sizeof *below);
    }
    qm_context_free(f->ctx, nodes, size, sizeof *nodes);
    return status;
}

/** Adds the inner node of a pattern, in the middle of its spans. */
static qm_status add_inner_node(filling *f, const plan *p, size_t inner, qm_vec inward, uint32_t *nodes,
                                int count)
{
    qm_vec sum = {0, 0, 0};
    for (int s = 0; s < p->span_count[inner]; s++) {
        qm_section line;
        qm_status status =
            find_line(f, nodes[p->span[inner][s][0]], nodes[p->span[inner][s][1]], inward, &line);
        if (status != QM_OK) return status;
        sum = qm_vec_add(sum, qm_section_at(&line, 0.5 * qm_section_length(&line)));
        qm_section_reset(f->ctx, &line);
    }
    return add_node(f, qm_vec_scale(1.0 / p->span_count[inner], sum), &nodes[count + (int)inner]);
}

/** Draws the pattern of a cell. False if it has none. */
static qm_status fill_cell(filling *f, const qm_layout_cell *cell, bool *is_filled)
{
    double angle[MAX_POLYGON];
    uint32_t nodes[MAX_POLYGON + MAX_INNER];
    int count = cell_angles(f, cell, angle), at = 0;
    plan p = {.cost = NO_FIT};
    if (count >= 4 && count % 2 == 0) p = make_plan(count, angle);
    *is_filled = p.cost < NO_FIT;
    if (!*is_filled) return QM_OK;
    for (uint32_t side = 0; side < cell->sides; side++) {
        uint32_t dart = cell_dart(f, cell, side);
        for (uint32_t k = 0; k < f->parts[chord_of(f, dart)]; k++)
            nodes[at++] = dart_node(f, dart, k);
    }
    QM_ASSERT(at == count);
    qm_vec inward = cell_inward(f, cell);
    qm_status status = QM_OK;
    for (size_t i = 0; i < p.inner_count && status == QM_OK; i++)
        status = add_inner_node(f, &p, i, inward, nodes, count);
    for (size_t e = 0; e < p.edge_count && status == QM_OK; e++)
        status = add_between(f, nodes[p.edge[e][0]], nodes[p.edge[e][1]], inward);
    return status;
}

/* ---- edits ---- */

static void filling_reset(filling *f)
{
    size_t count = f->curve_count;
    qm_context_free(f->ctx, f->chord, count, sizeof *f->chord);
    qm_context_free(f->ctx, f->parts, count, sizeof *f->parts);
    qm_context_free(f->ctx, f->crossed, count, sizeof *f->crossed);
    qm_context_free(f->ctx, f->end, count, sizeof *f->end);
    qm_context_free(f->ctx, f->first_node, count, sizeof *f->first_node);
    qm_context_free(f->ctx, f->is_chosen, 2 * count, sizeof *f->is_chosen);
    qm_context_free(f->ctx, f->nodes, f->node_capacity, sizeof *f->nodes);
    qm_layout_cells_reset(f->ctx, &f->cells);
}

/** Prepares a filling of a layout with curves. filling_reset frees it, also after an error. */
static qm_status filling_init(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *before,
                              qm_layout *layout, filling *f)
{
    size_t count = layout->curve_count;
    *f = (filling){.ctx = ctx, .surface = surface, .before = before, .layout = layout, .curve_count = count};
    f->chord = qm_context_alloc(ctx, count, sizeof *f->chord);
    f->parts = qm_context_alloc(ctx, count, sizeof *f->parts);
    f->crossed = qm_context_alloc(ctx, count, sizeof *f->crossed);
    f->end = qm_context_alloc(ctx, count, sizeof *f->end);
    f->first_node = qm_context_alloc(ctx, count, sizeof *f->first_node);
    f->is_chosen = qm_context_alloc(ctx, 2 * count, sizeof *f->is_chosen);
    if (!f->chord || !f->parts || !f->crossed || !f->end || !f->first_node || !f->is_chosen)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the chords");
    memset(f->is_chosen, 0, 2 * count * sizeof *f->is_chosen);
    qm_status status = qm_layout_find_cells(ctx, surface, layout, &f->cells);
    if (status == QM_OK) number_chords(f);
    return status;
}

/** An error if the rows of cut chords would be more curves than layouts are made for: cells are found in the square of it. */
static qm_status check_size(const filling *f)
{
    size_t count = 0;
    for (size_t i = 0; i < f->curve_count; i++)
        count += f->parts[f->chord[i]];
    for (size_t i = 0; i < f->cells.count; i++) {
        const qm_layout_cell *cell = &f->cells.cells[i];
        if (!qm_layout_cell_is_patch(cell)) continue;
        size_t columns = f->parts[chord_of(f, cell_dart(f, cell, 0))],
               rows = f->parts[chord_of(f, cell_dart(f, cell, 1))];
        count += (rows - 1) * columns + (columns - 1) * rows;
    }
    return count <= MAX_CURVES
               ? QM_OK
               : qm_context_fail(f->ctx, QM_E_ARGUMENT,
                                 "the layout would have %zu curves, and %d are the most", count, MAX_CURVES);
}

/** Divides the patches that cut chords run through. */
static qm_status divide_patches(filling *f)
{
    qm_status status = QM_OK;
    for (size_t i = 0; i < f->cells.count && status == QM_OK; i++)
        if (qm_layout_cell_is_patch(&f->cells.cells[i])) status = divide_patch(f, &f->cells.cells[i]);
    return status;
}

static bool can_be_filled(const qm_layout_cell *cell)
{
    return !cell->is_outside && !cell->is_on_both_sides && !qm_layout_cell_is_patch(cell);
}

/** The cell that a place of the surface lies in: that on its side of the curve nearest to it. */
static uint32_t find_cell(const filling *f, const double near[3])
{
    double best = INFINITY;
    uint32_t found = QM_NO_INDEX;
    for (uint32_t i = 0; i < f->curve_count; i++) {
        const qm_curve *curve = &f->layout->curves[i];
        qm_curve_position at = qm_layout_nearest_position(curve, near);
        if (at.distance >= best) continue;
        best = at.distance;
        qm_vec along = qm_vec_sub(qm_vec_load(curve->points + 3 * at.segment + 3),
                                  qm_vec_load(curve->points + 3 * at.segment));
        qm_ref_surface_point point;
        qm_ref_surface_project(f->surface, at.position, &point);
        qm_vec normal = qm_vec_load(point.normal);
        if (f->surface->is_cloud && qm_vec_dot(normal, f->cells.normal[curve->from]) < 0.0)
            normal = qm_vec_scale(-1.0, normal);
        qm_vec away = qm_vec_sub(qm_vec_load(near), qm_vec_load(at.position));
        bool is_left = qm_vec_dot(qm_vec_cross(normal, along), away) >= 0.0;
        found = f->cells.of_dart[2 * i + !is_left];
    }
    return found;
}

static qm_status choose_cells(filling *f, const double *near)
{
    if (near) {
        uint32_t cell = find_cell(f, near);
        const qm_layout_cell *found = &f->cells.cells[cell];
        if (!can_be_filled(found))
            return qm_context_fail(f->ctx, QM_E_ARGUMENT,
                                   found->is_outside ? "the place lies outside the drawing"
                                   : found->is_on_both_sides
                                       ? "a curve ends inside the cell, or both its sides do not close"
                                       : "the cell has four sides already");
        f->is_chosen[cell] = true;
        return QM_OK;
    }
    size_t chosen = 0;
    for (size_t i = 0; i < f->cells.count; i++) {
        f->is_chosen[i] = can_be_filled(&f->cells.cells[i]);
        chosen += f->is_chosen[i];
    }
    return chosen > 0
               ? QM_OK
               : qm_context_fail(f->ctx, QM_E_ARGUMENT, "there is no closed cell of other than four sides");
}

static qm_status fill(filling *f, const double *near, size_t *filled)
{
    qm_status status = choose_cells(f, near);
    if (status == QM_OK) status = choose_parts(f);
    if (status == QM_OK) status = check_size(f);
    /* A cell without a pattern stays as it is, and does not count against the others. */
    if (status == QM_OK) status = cut_curves(f);
    if (status == QM_OK) status = divide_patches(f);
    *filled = 0;
    for (size_t i = 0; i < f->cells.count && status == QM_OK; i++) {
        bool is_filled = false;
        if (f->is_chosen[i]) status = fill_cell(f, &f->cells.cells[i], &is_filled);
        *filled += is_filled;
    }
    if (status == QM_OK && *filled == 0) status = qm_context_fail(f->ctx, QM_E_ARGUMENT, "no pattern fits");
    return status;
}

qm_status qm_layout_fill(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                         const double *near, size_t *filled)
{
    QM_ASSERT(ctx && layout && surface && filled);
    if (layout->curve_count == 0) return qm_context_fail(ctx, QM_E_ARGUMENT, "the layout has no curves");
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    filling f;
    status = filling_init(ctx, surface, layout, &copy, &f);
    if (status == QM_OK) status = fill(&f, near, filled);
    filling_reset(&f);
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}

qm_status qm_layout_split_chord(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t id, uint32_t parts)
{
    QM_ASSERT(ctx && layout && surface);
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id);
    if (parts < 2 || parts > QM_CHORD_PARTS_MAX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a chord is split into 2 to %d parts, not %u",
                               QM_CHORD_PARTS_MAX, parts);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    filling f;
    status = filling_init(ctx, surface, layout, &copy, &f);
    if (status == QM_OK) {
        f.parts[f.chord[index]] = parts;
        status = check_size(&f);
    }
    if (status == QM_OK) status = cut_curves(&f);
    if (status == QM_OK) status = divide_patches(&f);
    filling_reset(&f);
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}
