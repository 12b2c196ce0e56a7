/**
 * tmesh_mend.c: lattices that fold are drawn anew in charts of the surface.
 *
 * A folded cell is taken together with rings of cells round it, until these are a disc whose border is a simple polygon in a chart
 * (tmesh_chart.h). Within the polygon the inner points go to the mean of their neighbours, and, where cells fold there, down a sum over
 * corners that opens folds (quads_untangle.c). Once none is folded in the plane, points move as is better in space, and
 * none comes to fold in the plane again. Straight lines of the plane between points are the curves.
 */
#include <math.h>
#include <string.h>

#include "tmesh/tmesh_lattice.h"
#include "tmesh/tmesh_polygon.h"

#define MOST_CELLS 1600      /* of a cluster */
#define GROWTHS 6            /* of a cluster that cannot be drawn */
#define PINCHES 12           /* of a cluster that touches itself at a point: it is widened there */
#define MOST_TRIANGLES 60000 /* of a chart, where there are more than three times as many */
/* Sweeps over the equations of the means, by successive overrelaxation, until no point moves by more than MEAN_CHANGE. */
/* Moves of points in the plane at most, for each point of the lattices and besides. */
#define MOVES_EACH 8
#define MOVES_BESIDES 20000
#define FLOODED_EACH 500 /* cells flooded in the search for holes at most, for each cell; tens are usual */
#define MEAN_SWEEPS 1000
#define MEAN_CHANGE 1e-13
#define OVERSTEP 1.8
#define IDLE_SWEEPS 6 /* that open no cell */
#define SHAPE_SWEEPS 12
#define BEND                                                                                                 \
    0.03 /* of the mean square of sides: what a corner that closes counts as, as in quads_untangle.c */
#define PIVOT_SINE                                                                                           \
    0.05 /* of a corner of the border, at one cell: below it the cell need not be convex there */
#define LEAST_SINE 1e-6 /* of a corner in the plane */
#define KEPT_SINE 1e-3  /* below it a corner in the plane must not become sharper */

enum { MOST_RING = 32 }; /* cells at a point */

typedef struct mender {
    qm_arena *arena;
    qm_tmesh_triangles *triangles;
    qm_tmesh_lattice *lattice;
    bool *is_seed;
    bool *is_tried; /* by cell: it was in the cluster of a seed */
    qm_tmesh_traces *traces;
    uint32_t *cell_stamp, *flood_stamp, *point_stamp, *number; /* by cell, by cell, by point */
    uint32_t stamp, flood;
    /* the cluster */
    uint32_t *cells;
    size_t cell_count;
    uint32_t (*corner)[4]; /* of its cells, all one way round, as numbers of its points */
    uint32_t *points;      /* of the lattice, by number: those of the border first, in order */
    size_t point_count, border;
    qm_tmesh_chart chart;
    qm_tmesh_flat *flat;
    uint8_t *pivot; /* by cell: the corner that cannot be convex; 4: none */
    qm_vec *at, *normal;
    uint32_t *triangle;            /* of the chart, by point */
    uint32_t *first_at, *cells_at; /* 4 * cell + corner */
    size_t moves_left;
    size_t floods_left;     /* cells */
    uint32_t *moved, sweep; /* by point: the last sweep that it moved in */
} mender;

/* ---- traces ---- */

static size_t trace_slot(const qm_tmesh_traces *traces, uint32_t low, uint32_t high)
{
    uint64_t key = ((uint64_t)low << 32 | high) * 0x9e3779b97f4a7c15u;
    size_t at = (size_t)(key >> 20) & (traces->capacity - 1);
    while (traces->slots[at].point[0] != QM_NO_INDEX &&
           (traces->slots[at].point[0] != low || traces->slots[at].point[1] != high))
        at = (at + 1) & (traces->capacity - 1);
    return at;
}

const qm_tmesh_trace *qm_tmesh_traces_find(const qm_tmesh_traces *traces, uint32_t a, uint32_t b)
{
    if (traces->count == 0) return NULL;
    const qm_tmesh_trace *trace = &traces->slots[trace_slot(traces, a < b ? a : b, a < b ? b : a)];
    return trace->point[0] == QM_NO_INDEX ? NULL : trace;
}

static bool add_trace(qm_arena *arena, qm_tmesh_traces *traces, const qm_tmesh_trace *trace)
{
    if (2 * traces->count >= traces->capacity) {
        qm_tmesh_traces grown = {.count = traces->count,
                                 .capacity = traces->capacity ? 2 * traces->capacity : 256};
        grown.slots = qm_arena_alloc(arena, grown.capacity, sizeof *grown.slots);
        if (!grown.slots) return false;
        for (size_t i = 0; i < grown.capacity; i++)
            grown.slots[i].point[0] = QM_NO_INDEX;
        for (size_t i = 0; i < traces->capacity; i++)
            if (traces->slots[i].point[0] != QM_NO_INDEX)
                grown.slots[trace_slot(&grown, traces->slots[i].point[0], traces->slots[i].point[1])] =
                    traces->slots[i];
        *traces = grown;
    }
    qm_tmesh_trace *slot = &traces->slots[trace_slot(traces, trace->point[0], trace->point[1])];
    traces->count += slot->point[0] == QM_NO_INDEX;
    *slot = *trace;
    return true;
}

/* ---- clusters ---- */

static void add_cell(mender *m, uint32_t cell)
{
    if (m->cell_stamp[cell] == m->stamp || m->cell_count > MOST_CELLS) return;
    m->cell_stamp[cell] = m->stamp;
    m->cells[m->cell_count++] = cell;
}

/** Adds all cells at a point of the lattice. */
static void add_cells_at(mender *m, uint32_t point)
{
    const qm_tmesh_lattice *lattice = m->lattice;
    for (uint32_t j = lattice->first_at[point]; j < lattice->first_at[point + 1]; j++)
        add_cell(m, lattice->at[j] / 4);
}

static void add_ring(mender *m)
{
    for (size_t i = 0, end = m->cell_count; i < end; i++)
        for (uint32_t k = 0; k < 4; k++)
            add_cells_at(m, m->lattice->cells[m->cells[i]].corner[k]);
}

/** Gathers a seed with rings of cells. False if they are too many. */
static bool gather(mender *m, uint32_t seed, int rings)
{
    m->stamp++;
    m->cell_count = 0;
    add_cell(m, seed);
    for (int ring = 0; ring < rings; ring++)
        add_ring(m);
    return m->cell_count <= MOST_CELLS && 2 * m->cell_count <= m->lattice->cell_count;
}

/** The cell beyond a side of a cell; QM_NO_INDEX. */
static uint32_t cell_beyond(const mender *m, uint32_t cell, uint32_t a, uint32_t b)
{
    const qm_tmesh_lattice *lattice = m->lattice;
    for (uint32_t i = lattice->first_at[a]; i < lattice->first_at[a + 1]; i++) {
        uint32_t other = lattice->at[i] / 4, k = lattice->at[i] % 4;
        const uint32_t *corner = lattice->cells[other].corner;
        if (other != cell && (corner[(k + 1) & 3] == b || corner[(k + 3) & 3] == b)) return other;
    }
    return QM_NO_INDEX;
}

/** Floods the cells outside the cluster from one on, into queue: their number, or limit + 1. */
static size_t flood_outside(mender *m, uint32_t first, uint32_t flooded, uint32_t *queue, size_t limit)
{
    size_t count = 0;
    m->flood_stamp[first] = flooded;
    queue[count++] = first;
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t *corner = m->lattice->cells[queue[i]].corner;
            uint32_t next = cell_beyond(m, queue[i], corner[k], corner[(k + 1) & 3]);
            if (next == QM_NO_INDEX || m->cell_stamp[next] == m->stamp || m->flood_stamp[next] == flooded)
                continue;
            if (count > limit) return count;
            m->flood_stamp[next] = flooded;
            queue[count++] = next;
        }
    return count;
}

/** Adds the cells that the cluster encloses: parts of what is outside that are no larger than it. */
static void fill_holes(mender *m)
{
    uint32_t *queue = m->cells + MOST_CELLS + 2;
    for (size_t i = 0, end = m->cell_count; i < end; i++)
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t *corner = m->lattice->cells[m->cells[i]].corner;
            uint32_t next = cell_beyond(m, m->cells[i], corner[k], corner[(k + 1) & 3]);
            if (next == QM_NO_INDEX || m->cell_stamp[next] == m->stamp) continue;
            size_t limit = end < MOST_CELLS / 2 ? end : MOST_CELLS / 2,
                   count = flood_outside(m, next, ++m->flood, queue, limit);
            m->floods_left -= count < m->floods_left ? count : m->floods_left;
            for (size_t j = 0; j < count && count <= limit; j++)
                add_cell(m, queue[j]);
        }
}

/** Turns the cells of the cluster one way, and writes their corners. False if they are not connected by sides, or have
 * one side only. */
static bool turn_cells(mender *m)
{
    const qm_tmesh_lattice *lattice = m->lattice;
    uint32_t inside = m->stamp, reached = ++m->stamp;
    uint32_t *order = m->cells + m->cell_count; /* the cells again, as they are reached */
    size_t count = 0;
    m->cell_stamp[m->cells[0]] = reached;
    memcpy(m->corner[0], lattice->cells[m->cells[0]].corner, sizeof m->corner[0]);
    order[count++] = m->cells[0];
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t a = m->corner[i][k], b = m->corner[i][(k + 1) & 3],
                     next = cell_beyond(m, order[i], a, b);
            if (next == QM_NO_INDEX || (m->cell_stamp[next] != inside && m->cell_stamp[next] != reached))
                continue;
            const uint32_t *corner = lattice->cells[next].corner;
            bool is_alike = false;
            for (uint32_t j = 0; j < 4; j++)
                is_alike |= corner[j] == b && corner[(j + 1) & 3] == a;
            if (m->cell_stamp[next] == reached) continue;
            m->cell_stamp[next] = reached;
            for (uint32_t j = 0; j < 4; j++)
                m->corner[count][j] = corner[is_alike ? j : 3 - j];
            order[count++] = next;
        }
    bool is_whole = count == m->cell_count;
    memcpy(m->cells, order, count * sizeof *order);
    return is_whole;
}

/** Numbers the points, those of the border first. False if the cells are no disc; *pinch is a point at which their border touches
 * itself. */
static bool number_points(mender *m, uint32_t *pinch)
{
    *pinch = QM_NO_INDEX;
    size_t points = 0, sides = 0, border = 0;
    uint32_t *next = m->number, start = QM_NO_INDEX; /* by point: the next one of the border */
    for (size_t i = 0; i < m->cell_count; i++)
        for (uint32_t k = 0; k < 4; k++)
            next[m->corner[i][k]] = QM_NO_INDEX;
    for (size_t i = 0; i < m->cell_count; i++)
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t a = m->corner[i][k], b = m->corner[i][(k + 1) & 3],
                     other = cell_beyond(m, m->cells[i], a, b);
            sides++;
            if (other != QM_NO_INDEX && m->cell_stamp[other] == m->stamp) continue;
            if (next[a] != QM_NO_INDEX) *pinch = a;
            next[a] = b;
            start = a;
            border++;
        }
    if (border == 0 || *pinch != QM_NO_INDEX) return false;
    m->point_count = 0;
    uint32_t at = start;
    do {
        if (at == QM_NO_INDEX || m->point_count >= border) return false;
        m->points[m->point_count++] = at;
        at = next[at];
    } while (at != start);
    if (m->point_count != border) return false;
    m->border = border;
    for (size_t i = 0; i < m->border; i++) {
        m->number[m->points[i]] = (uint32_t)i;
        m->point_stamp[m->points[i]] = m->stamp;
    }
    for (size_t i = 0; i < m->cell_count; i++)
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t point = m->corner[i][k];
            if (m->point_stamp[point] != m->stamp) {
                m->point_stamp[point] = m->stamp;
                m->number[point] = (uint32_t)m->point_count;
                m->points[m->point_count++] = point;
            }
            m->corner[i][k] = m->number[point];
        }
    points = m->point_count;
    return points + m->cell_count == (sides + border) / 2 + 1; /* Euler's formula of a disc */
}

static void list_cells_at(mender *m)
{
    memset(m->first_at, 0, (m->point_count + 2) * sizeof *m->first_at);
    for (size_t c = 0; c < 4 * m->cell_count; c++)
        m->first_at[m->corner[c / 4][c % 4] + 2]++;
    for (size_t v = 0; v < m->point_count; v++)
        m->first_at[v + 2] += m->first_at[v + 1];
    for (size_t c = 0; c < 4 * m->cell_count; c++)
        m->cells_at[m->first_at[m->corner[c / 4][c % 4] + 1]++] = (uint32_t)c;
}

/* ---- the polygon ---- */

static bool lines_meet(qm_tmesh_flat a, qm_tmesh_flat b, qm_tmesh_flat c, qm_tmesh_flat d)
{
    double one = qm_tmesh_flat_area(a, b, c), other = qm_tmesh_flat_area(a, b, d),
           third = qm_tmesh_flat_area(c, d, a), fourth = qm_tmesh_flat_area(c, d, b);
    return ((one > 0) != (other > 0)) && ((third > 0) != (fourth > 0));
}

/** True if the border is a simple polygon; the cells are turned as it runs. */
static bool take_polygon(mender *m)
{
    double area = 0;
    for (size_t i = 0; i < m->border; i++) {
        qm_tmesh_flat a = m->flat[i], b = m->flat[(i + 1) % m->border];
        area += a.u * b.v - a.v * b.u;
        if (a.u == b.u && a.v == b.v) return false;
        for (size_t j = i + 2; j < m->border; j++)
            if ((j + 1) % m->border != i && lines_meet(a, b, m->flat[j], m->flat[(j + 1) % m->border]))
                return false;
    }
    for (size_t c = 0; c < m->cell_count && area < 0; c++) {
        uint32_t spare = m->corner[c][1];
        m->corner[c][1] = m->corner[c][3];
        m->corner[c][3] = spare;
    }
    return area != 0;
}

/* ---- the plane ---- */

static double flat_length(qm_tmesh_flat a, qm_tmesh_flat b)
{
    return sqrt((b.u - a.u) * (b.u - a.u) + (b.v - a.v) * (b.v - a.v));
}

/** The sine of the angle at a of a triangle of the plane; -1 where a side has no length. */
static double flat_sine(qm_tmesh_flat a, qm_tmesh_flat b, qm_tmesh_flat c)
{
    double sides = flat_length(a, b) * flat_length(a, c);
    return sides > 0 ? qm_tmesh_flat_area(a, b, c) / sides : -1;
}

/** Above 0 where a cell is a simple quadrangle that runs as the others do, be it convex or not: the lesser sine of the two triangles
 * along a diagonal, of that where it is greater. With all cells so, and a border that is simple, no curves cross. */
static double cell_flat_sine(const mender *m, size_t cell)
{
    const uint32_t *c = m->corner[cell];
    double best = -1;
    for (uint32_t k = 0; k < 2; k++) {
        qm_tmesh_flat from = m->flat[c[k]], to = m->flat[c[k + 2]];
        best = fmax(
            best, fmin(flat_sine(from, m->flat[c[k + 1]], to), flat_sine(from, to, m->flat[c[(k + 3) & 3]])));
    }
    return best;
}

static double point_flat_sine(const mender *m, uint32_t v)
{
    double least = 1;
    for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++)
        least = fmin(least, cell_flat_sine(m, m->cells_at[i] / 4));
    return least;
}

/** Puts the inner points to the means of their neighbours, with the border where it is. */
static void go_to_means(mender *m)
{
    qm_tmesh_flat middle = {0, 0};
    for (size_t v = 0; v < m->border; v++) {
        middle.u += m->flat[v].u / (double)m->border;
        middle.v += m->flat[v].v / (double)m->border;
    }
    for (size_t v = m->border; v < m->point_count; v++)
        m->flat[v] = middle;
    double change = 1;
    for (int sweep = 0; sweep < MEAN_SWEEPS && change > MEAN_CHANGE; sweep++) {
        change = 0;
        for (uint32_t v = (uint32_t)m->border; v < m->point_count; v++) {
            qm_tmesh_flat sum = {0, 0}, old = m->flat[v];
            double count = 0;
            for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++, count++) {
                uint32_t next = m->corner[m->cells_at[i] / 4][(m->cells_at[i] + 1) & 3];
                sum.u += m->flat[next].u;
                sum.v += m->flat[next].v;
            }
            qm_tmesh_flat by = {sum.u / count - old.u, sum.v / count - old.v};
            m->flat[v] = (qm_tmesh_flat){old.u + OVERSTEP * by.u, old.v + OVERSTEP * by.v};
            change = fmax(change, fabs(by.u) + fabs(by.v));
        }
    }
}

/** What a corner with sides of these squared lengths and this area costs. */
static double corner_cost(double sides2, double area, double bend)
{
    return 0.5 * sides2 / fmax(0.5 * (area + sqrt(area * area + bend * bend)), 1e-300);
}

/** Three corners of a cell that corner k is judged by: itself and its neighbours; in a cell with a corner that cannot be convex, those of
 * a triangle beside the diagonal from that one. */
static void judged_corners(const mender *m, size_t cell, uint32_t k, uint32_t out[3])
{
    const uint32_t *c = m->corner[cell];
    uint32_t pivot = m->pivot[cell], at = pivot < 4 ? pivot : k;
    out[0] = c[at];
    out[1] = c[(at + (pivot < 4 ? 1 + k % 2 : 1)) & 3];
    out[2] = c[(at + (pivot < 4 ? 2 + k % 2 : 3)) & 3];
}

/** Finds the corners that cannot be convex: at inner points of two cells, and where the border turns inward at one. */
static void find_pivots(mender *m)
{
    for (size_t cell = 0; cell < m->cell_count; cell++) {
        m->pivot[cell] = 4;
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t v = m->corner[cell][k], count = m->first_at[v + 1] - m->first_at[v];
            bool is_pivot = v >= m->border && count == 2;
            if (v < m->border && count == 1)
                is_pivot = flat_sine(m->flat[v], m->flat[m->corner[cell][(k + 1) & 3]],
                                     m->flat[m->corner[cell][(k + 3) & 3]]) < PIVOT_SINE;
            if (is_pivot) m->pivot[cell] = (uint8_t)k;
        }
    }
}

static double flat_cost(const mender *m, uint32_t v, double bend)
{
    double sum = 0;
    for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++)
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t c[3];
            judged_corners(m, m->cells_at[i] / 4, k, c);
            double one = flat_length(m->flat[c[0]], m->flat[c[1]]),
                   other = flat_length(m->flat[c[0]], m->flat[c[2]]);
            sum += corner_cost(one * one + other * other,
                               qm_tmesh_flat_area(m->flat[c[0]], m->flat[c[1]], m->flat[c[2]]), bend);
        }
    return sum;
}

static double flat_edge(const mender *m, uint32_t v)
{
    double sum = 0, count = 0;
    for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++, count++)
        sum += flat_length(m->flat[v], m->flat[m->corner[m->cells_at[i] / 4][(m->cells_at[i] + 1) & 3]]);
    return count > 0 ? sum / count : 0;
}

/** Moves an inner point down the slope of the sum over the corners round it. */
static void open_point(mender *m, uint32_t v)
{
    m->moves_left -= m->moves_left > 0;
    double edge = flat_edge(m, v), tiny = 1e-4 * edge, bend = BEND * edge * edge;
    if (!(edge > 0)) return;
    qm_tmesh_flat here = m->flat[v], slope;
    double now = flat_cost(m, v, bend);
    m->flat[v].u = here.u + tiny;
    slope.u = flat_cost(m, v, bend);
    m->flat[v].u = here.u - tiny;
    slope.u -= flat_cost(m, v, bend);
    m->flat[v] = (qm_tmesh_flat){here.u, here.v + tiny};
    slope.v = flat_cost(m, v, bend);
    m->flat[v].v = here.v - tiny;
    slope.v -= flat_cost(m, v, bend);
    double length = hypot(slope.u, slope.v);
    for (double step = 0.4; step > 0.005 && length > 0; step /= 2) {
        m->flat[v] =
            (qm_tmesh_flat){here.u - step * edge * slope.u / length, here.v - step * edge * slope.v / length};
        if (flat_cost(m, v, bend) < now) return;
    }
    m->flat[v] = here;
}

/** Moves the points of cells that are folded in the plane, and their neighbours: the number of these cells. */
static size_t open_cells(mender *m)
{
    size_t folded = 0;
    for (size_t c = 0; c < m->cell_count; c++) {
        if (cell_flat_sine(m, c) >= LEAST_SINE) continue;
        folded++;
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t v = m->corner[c][k];
            for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++)
                for (uint32_t j = 0; j < 4; j++) {
                    uint32_t near = m->corner[m->cells_at[i] / 4][j];
                    if (near < m->border || m->moved[near] == m->sweep) continue;
                    m->moved[near] = m->sweep;
                    open_point(m, near);
                }
        }
        m->sweep++;
    }
    return folded;
}

/** Places the inner points: the means of a convex polygon do not fold (Tutte), and are mapped into the border. Where the border is nearly
 * convex means within it do as well, and are smoother. */
static qm_status place_inside(mender *m, bool *is_placed)
{
    qm_tmesh_polygon polygon;
    qm_tmesh_flat *border = qm_arena_alloc(m->arena, m->border, sizeof *border);
    if (!border) return QM_E_NO_MEMORY;
    memcpy(border, m->flat, m->border * sizeof *border);
    qm_status status = qm_tmesh_polygon_cut(m->arena, border, m->border, &polygon, is_placed);
    if (status != QM_OK || !*is_placed) return status;
    memcpy(m->flat, polygon.round, m->border * sizeof *border);
    go_to_means(m);
    memcpy(m->flat, border, m->border * sizeof *border);
    for (size_t v = m->border; v < m->point_count; v++)
        m->flat[v] = qm_tmesh_polygon_map(&polygon, m->flat[v]);
    return QM_OK;
}

/** True once no cell is folded in the plane. */
static bool open_all(mender *m)
{
    size_t least = SIZE_MAX;
    for (int idle = 0; idle < IDLE_SWEEPS && m->moves_left > 0; idle++) {
        size_t folded = open_cells(m);
        if (folded == 0) return true;
        if (folded < least) idle = 0;
        if (folded < least) least = folded;
    }
    return false;
}

/** Places the inner points such that no cell is folded in the plane; *is_unfolded is false where that fails. */
static qm_status unfold(mender *m, bool *is_unfolded)
{
    find_pivots(m);
    go_to_means(m);
    *is_unfolded = open_all(m);
    if (*is_unfolded) return QM_OK;
    qm_status status = place_inside(m, is_unfolded);
    if (status == QM_OK && *is_unfolded) *is_unfolded = open_all(m);
    return status;
}

/* ---- in space ---- */

static bool lift_points(mender *m)
{
    for (uint32_t v = (uint32_t)m->border; v < m->point_count; v++) {
        m->triangle[v] = m->triangle[v % m->border];
        if (!qm_tmesh_chart_lift(&m->chart, m->flat[v], &m->triangle[v], &m->at[v])) return false;
    }
    for (size_t v = 0; v < m->point_count; v++)
        m->normal[v] = qm_tmesh_chart_normal(&m->chart, m->triangle[v]);
    return true;
}

static double space_cost(const mender *m, uint32_t v, double bend)
{
    double sum = 0;
    for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++)
        for (uint32_t k = 0; k < 4; k++) {
            uint32_t c[3];
            judged_corners(m, m->cells_at[i] / 4, k, c);
            qm_vec one = qm_vec_sub(m->at[c[1]], m->at[c[0]]), other = qm_vec_sub(m->at[c[2]], m->at[c[0]]);
            sum += corner_cost(qm_vec_norm2(one) + qm_vec_norm2(other),
                               qm_vec_dot(qm_vec_cross(one, other), m->normal[c[0]]), bend);
        }
    return sum;
}

static double space_edge(const mender *m, uint32_t v)
{
    double sum = 0, count = 0;
    for (uint32_t i = m->first_at[v]; i < m->first_at[v + 1]; i++, count++)
        sum += qm_vec_distance(m->at[v], m->at[m->corner[m->cells_at[i] / 4][(m->cells_at[i] + 1) & 3]]);
    return count > 0 ? sum / count : 0;
}

/** Moves an inner point as is better in space, if no corner folds in the plane. */
static void shape_point(mender *m, uint32_t v)
{
    qm_vec here = m->at[v], normal = m->normal[v], axis[2], slope = {0};
    double edge = space_edge(m, v), tiny = 1e-4 * edge, bend = BEND * edge * edge;
    axis[0] = qm_vec_perpendicular(normal);
    double length = qm_vec_norm(axis[0]);
    if (!(edge > 0) || !(length > 0)) return;
    axis[0] = qm_vec_scale(1 / length, axis[0]);
    axis[1] = qm_vec_cross(normal, axis[0]);
    double now = space_cost(m, v, bend), flat_now = point_flat_sine(m, v);
    for (int k = 0; k < 2; k++) {
        m->at[v] = qm_vec_axpy(here, tiny, axis[k]);
        double rise = space_cost(m, v, bend);
        m->at[v] = qm_vec_axpy(here, -tiny, axis[k]);
        slope = qm_vec_axpy(slope, space_cost(m, v, bend) - rise, axis[k]);
    }
    m->at[v] = here;
    length = qm_vec_norm(slope);
    qm_tmesh_flat flat = m->flat[v];
    uint32_t triangle = m->triangle[v];
    for (double step = 0.4; step > 0.02 && length > 0; step /= 2) {
        qm_tmesh_flat by =
            qm_tmesh_chart_move(&m->chart, triangle, qm_vec_scale(step * edge / length, slope));
        m->flat[v] = (qm_tmesh_flat){flat.u + by.u, flat.v + by.v};
        double sine = point_flat_sine(m, v);
        if (sine >= LEAST_SINE && sine >= fmin(flat_now, KEPT_SINE) &&
            qm_tmesh_chart_lift(&m->chart, m->flat[v], &m->triangle[v], &m->at[v])) {
            m->normal[v] = qm_tmesh_chart_normal(&m->chart, m->triangle[v]);
            if (space_cost(m, v, bend) < now) return;
        }
        m->flat[v] = flat;
        m->triangle[v] = triangle;
        m->at[v] = here;
        m->normal[v] = normal;
    }
}

/* ---- what comes of it ---- */

static bool trace_side(mender *m, uint32_t a, uint32_t b)
{
    uint32_t from = m->points[a] < m->points[b] ? a : b, to = from == a ? b : a, triangle = m->triangle[from];
    qm_tmesh_trace trace = {.point = {m->points[from], m->points[to]}};
    for (int i = 0; i < QM_TMESH_TRACE; i++) {
        double share = (i + 1.0) / (QM_TMESH_TRACE + 1);
        qm_tmesh_flat flat = {m->flat[from].u + share * (m->flat[to].u - m->flat[from].u),
                              m->flat[from].v + share * (m->flat[to].v - m->flat[from].v)};
        if (!qm_tmesh_chart_lift(&m->chart, flat, &triangle, &trace.at[i])) return true;
    }
    return add_trace(m->arena, m->traces, &trace);
}

static size_t count_lost(const mender *m)
{
    size_t lost = 0;
    for (size_t v = m->border; v < m->point_count; v++)
        lost += qm_tmesh_is_lost(m->lattice, m->points[v]);
    return lost;
}

/** Exchanges the points inside the cluster for those of the lattice. */
static void swap_points(mender *m)
{
    for (size_t v = m->border; v < m->point_count; v++) {
        qm_tmesh_point *point = &m->lattice->points[m->points[v]];
        qm_vec at = point->at, normal = point->normal;
        point->at = m->at[v];
        point->normal = m->normal[v];
        m->at[v] = at;
        m->normal[v] = normal;
    }
}

/** Takes the points of the cluster, unless they leave a limb: in a chart that is a small spot, which means of neighbours lie beside. */
static bool take_points(mender *m)
{
    size_t before = count_lost(m);
    swap_points(m);
    if (count_lost(m) <= before) return true;
    swap_points(m);
    return false;
}

/** Writes the traces of the cluster. False when out of memory. */
static bool take_cluster(mender *m)
{
    for (size_t c = 0; c < m->cell_count; c++) {
        m->is_seed[m->cells[c]] = false;
        m->lattice->cells[m->cells[c]].is_charted = true;
        for (uint32_t k = 0; k < 4; k++)
            if (!trace_side(m, m->corner[c][k], m->corner[c][(k + 1) & 3])) return false;
    }
    return true;
}

static bool place_border(mender *m)
{
    for (size_t i = 0; i < m->border; i++) {
        qm_tmesh_spot spot;
        m->at[i] = m->lattice->points[m->points[i]].at;
        if (!qm_tmesh_triangles_find(m->triangles, m->at[i], &spot) ||
            !qm_tmesh_chart_place(&m->chart, &spot, &m->flat[i], &m->triangle[i]))
            return false;
    }
    return true;
}

static qm_status chart_border(mender *m, bool *is_made)
{
    qm_tmesh_spot *line = qm_arena_alloc(m->arena, m->border, sizeof *line);
    if (!line) return QM_E_NO_MEMORY;
    *is_made = false;
    for (size_t i = 0; i < m->border; i++)
        if (!qm_tmesh_triangles_find(m->triangles, m->lattice->points[m->points[i]].at, &line[i]))
            return QM_OK;
    size_t third = m->triangles->mesh.face_count / 3, most = third < MOST_TRIANGLES ? third : MOST_TRIANGLES;
    return qm_tmesh_chart_make(m->arena, m->triangles, line, m->border, most, &m->chart, is_made);
}

/** Fills the holes of the cluster, and widens it where its border touches itself. False if it is no disc then. */
static bool make_disc(mender *m)
{
    for (int round = 0; round < PINCHES; round++) {
        uint32_t pinch;
        fill_holes(m);
        if (m->cell_count > MOST_CELLS || 2 * m->cell_count > m->lattice->cell_count || !turn_cells(m))
            return false;
        if (number_points(m, &pinch)) return true;
        if (pinch == QM_NO_INDEX) return false;
        add_cells_at(m, pinch);
    }
    return false;
}

/** Draws a seed and what is round it; clears the seeds that this succeeds for. */
static qm_status mend_seed(mender *m, uint32_t seed, int rings)
{
    for (int growth = 0; growth < GROWTHS; growth++, rings += 1 + growth) {
        if (qm_context_canceled(m->arena->ctx)) return QM_E_CANCELED;
        if (!gather(m, seed, rings)) return QM_OK;
        for (size_t i = 0; i < m->cell_count && growth == 0; i++)
            m->is_tried[m->cells[i]] = true;
        if (!make_disc(m)) continue;
        bool is_made;
        qm_status status = chart_border(m, &is_made);
        if (status != QM_OK) return status;
        if (!is_made) continue;
        list_cells_at(m);
        if (!place_border(m) || !take_polygon(m)) continue;
        status = unfold(m, &is_made);
        if (status != QM_OK) return status;
        if (!is_made) continue;
        if (!lift_points(m)) continue;
        for (int sweep = 0; sweep < SHAPE_SWEEPS; sweep++)
            for (uint32_t v = (uint32_t)m->border; v < m->point_count; v++)
                shape_point(m, v);
        if (!take_points(m)) continue;
        return take_cluster(m) ? QM_OK : QM_E_NO_MEMORY;
    }
    return QM_OK;
}

static bool allocate(mender *m)
{
    size_t cells = MOST_CELLS + 2, points = 4 * cells;
    qm_arena *arena = m->arena;
    m->cell_stamp = qm_arena_zeroed(arena, m->lattice->cell_count, sizeof *m->cell_stamp);
    m->is_tried = qm_arena_zeroed(arena, m->lattice->cell_count, sizeof *m->is_tried);
    m->flood_stamp = qm_arena_zeroed(arena, m->lattice->cell_count, sizeof *m->flood_stamp);
    m->point_stamp = qm_arena_zeroed(arena, m->lattice->point_count, sizeof *m->point_stamp);
    m->number = qm_arena_alloc(arena, m->lattice->point_count, sizeof *m->number);
    m->cells = qm_arena_alloc(arena, 2 * cells, sizeof *m->cells);
    m->corner = qm_arena_alloc(arena, cells, sizeof *m->corner);
    m->pivot = qm_arena_alloc(arena, cells, sizeof *m->pivot);
    m->points = qm_arena_alloc(arena, points, sizeof *m->points);
    m->flat = qm_arena_alloc(arena, points, sizeof *m->flat);
    m->at = qm_arena_alloc(arena, points, sizeof *m->at);
    m->normal = qm_arena_alloc(arena, points, sizeof *m->normal);
    m->triangle = qm_arena_alloc(arena, points, sizeof *m->triangle);
    m->first_at = qm_arena_alloc(arena, points + 2, sizeof *m->first_at);
    m->cells_at = qm_arena_alloc(arena, points, sizeof *m->cells_at);
    m->moved = qm_arena_zeroed(arena, points, sizeof *m->moved);
    m->sweep = 1;
    m->moves_left = MOVES_EACH * m->lattice->point_count + MOVES_BESIDES;
    m->floods_left = FLOODED_EACH * m->lattice->cell_count;
    return m->is_tried && m->cell_stamp && m->flood_stamp && m->point_stamp && m->number && m->cells &&
           m->corner && m->points && m->flat && m->at && m->normal && m->triangle && m->first_at &&
           m->cells_at && m->moved;
}

qm_status qm_tmesh_mend(qm_arena *arena, qm_tmesh_triangles *triangles, qm_tmesh_lattice *lattice,
                        bool *is_seed, int rings, qm_tmesh_traces *traces)
{
    mender m = {
        .arena = arena, .triangles = triangles, .lattice = lattice, .is_seed = is_seed, .traces = traces};
    qm_status status = allocate(&m) ? QM_OK : QM_E_NO_MEMORY;
    for (uint32_t c = 0; c < lattice->cell_count && status == QM_OK; c++)
        if (is_seed[c] && !m.is_tried[c] && m.moves_left > 0 && m.floods_left > 0)
            status = mend_seed(&m, c, rings);
    if (status == QM_E_NO_MEMORY)
        return qm_context_fail(arena->ctx, status, "out of memory for the charts of a layout");
    if (status == QM_E_CANCELED) return qm_context_fail(arena->ctx, status, "canceled");
    return status;
}
