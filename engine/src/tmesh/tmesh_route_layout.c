/**
 * tmesh_route_layout.c: the layout of curves that are laid, and its grids.
 */
#include "tmesh/tmesh_router.h"

#include <math.h>
#include <string.h>

#define GRADE 0.4       /* of the distance to the nearer end of a curve: segments there are no longer, */
#define SHORTEST 1e-4   /* or than this share of it */
#define LEAST_STEP 1e-5 /* of a curve: points nearer than that are one */

enum { MOST_GRADES = 200 }; /* points beside those of a path */

bool qm_router_list_points(qm_router *r, uint32_t curve, double **points, size_t *count)
{
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t vertex = r->vertex[at->from], end = r->vertex[at->to], came = QM_NO_INDEX;
    size_t capacity = 64;
    *count = 0;
    *points = qm_arena_alloc(r->arena, 3 * capacity, sizeof **points);
    if (!*points) return false;
    for (;;) {
        if (*count == capacity) {
            double *grown = qm_arena_alloc(r->arena, 6 * capacity, sizeof *grown);
            if (!grown) return false;
            memcpy(grown, *points, 3 * capacity * sizeof *grown);
            *points = grown;
            capacity *= 2;
        }
        qm_vec_store(*points + 3 * (*count)++, r->m.position[vertex]);
        if (vertex == end) return true;
        uint32_t first = qm_trimesh_first(&r->m, vertex), h = first, next = QM_NO_INDEX;
        do { /* a boundary may run against the curve */
            uint32_t prev = qm_trimesh_prev(h);
            if (qm_router_label(r, h) == curve + 1 && qm_trimesh_to(&r->m, h) != came)
                next = qm_trimesh_to(&r->m, h);
            if (qm_router_label(r, prev) == curve + 1 && r->m.from[prev] != came) next = r->m.from[prev];
            h = qm_trimesh_around(&r->m, h);
        } while (h != QM_NO_INDEX && h != first);
        if (next == QM_NO_INDEX || *count > r->m.vertex_count) {
            r->is_lost = true;
            return true;
        }
        came = vertex;
        vertex = next;
    }
}

/** The points of a path, as the points of a curve: segments near its ends are short, since crossings are told by how near segments are for
 * their lengths, and curves are near each other at their node; points that are very near each other are left out. */
static bool grade_points(qm_router *r, const double *path, size_t path_count, double **points, size_t *count)
{
    double length = 0, passed = 0;
    for (size_t i = 1; i < path_count; i++)
        length += qm_vec_distance(qm_vec_load(path + 3 * i - 3), qm_vec_load(path + 3 * i));
    size_t capacity = 2 * path_count + MOST_GRADES;
    *points = qm_arena_alloc(r->arena, 3 * capacity, sizeof **points);
    if (!*points) return false;
    memcpy(*points, path, 3 * sizeof *path);
    *count = 1;
    for (size_t i = 1; i < path_count; i++) {
        qm_vec from = qm_vec_load(path + 3 * i - 3), to = qm_vec_load(path + 3 * i);
        double step = qm_vec_distance(from, to), done = 0;
        while (step > 0 && *count + 1 < capacity) {
            double at = passed + done, most = fmax(GRADE * fmin(at, length - at), SHORTEST * length);
            if (done + most >= step) break;
            done += most;
            qm_vec_store(*points + 3 * (*count)++, qm_vec_mix(from, to, done / step));
        }
        passed += step;
        bool is_last = i + 1 == path_count;
        if (step - done<LEAST_STEP * length && * count> 1 && is_last) --*count;
        if (step - done < LEAST_STEP * length && !is_last) continue;
        qm_vec_store(*points + 3 * (*count)++, to);
    }
    return true;
}

/** The points of the grids on a curve, at equal lengths. */
static void mark_curve(const qm_curve *curve, qm_vec out[QM_LAYOUT_GRID + 1])
{
    double length = qm_layout_curve_length(curve), passed = 0;
    size_t i = 0;
    for (int k = 0; k <= QM_LAYOUT_GRID; k++)
        for (;; i++) {
            double wanted = length * k / QM_LAYOUT_GRID;
            qm_vec a = qm_vec_load(curve->points + 3 * i), b = qm_vec_load(curve->points + 3 * (i + 1));
            double step = qm_vec_distance(a, b);
            if (passed + step >= wanted || i + 2 == curve->point_count) {
                out[k] = qm_vec_mix(a, b, step > 0 ? qm_clamp((wanted - passed) / step, 0, 1) : 0);
                break;
            }
            passed += step;
        }
    out[0] = qm_vec_load(curve->points);
    out[QM_LAYOUT_GRID] = qm_vec_load(curve->points + 3 * (curve->point_count - 1));
}

/** The border of a patch's grid, from its curves. */
static void grid_border(const qm_layout *layout, uint32_t patch, qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    const int n = QM_LAYOUT_GRID;
    for (int side = 0; side < 4; side++) {
        qm_vec at[QM_LAYOUT_GRID + 1];
        mark_curve(&layout->curves[layout->patches[patch].side[side]], at);
        for (int i = 0; i <= n; i++) {
            int column = side == 0   ? i
                         : side == 1 ? n
                         : side == 2 ? n - i
                                     : 0,
                row = side == 0   ? 0
                      : side == 1 ? i
                      : side == 2 ? n
                                  : n - i;
            grid[row * (n + 1) + column] = at[layout->patches[patch].against[side] ? n - i : i];
        }
    }
}

/** The inner points of a grid as a Coons patch of its border. */
static void blend_grid(qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    const int n = QM_LAYOUT_GRID, w = n + 1;
    for (int row = 1; row < n; row++)
        for (int column = 1; column < n; column++) {
            double u = (double)column / n, v = (double)row / n;
            qm_vec across = qm_vec_mix(grid[row * w], grid[row * w + n], u),
                   along = qm_vec_mix(grid[column], grid[n * w + column], v),
                   corners = qm_vec_mix(qm_vec_mix(grid[0], grid[n], u),
                                        qm_vec_mix(grid[n * w], grid[n * w + n], u), v);
            grid[row * w + column] = qm_vec_sub(qm_vec_add(across, along), corners);
        }
}

/** The inner points of a grid in a chart of its patch, whose corners are at the diagonals. False when out of memory. */
static bool chart_grid(qm_router *r, uint32_t patch, qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    uint32_t dart[4], start[4];
    size_t place[5] = {0};
    qm_router_patch_darts(r, patch, dart);
    for (int k = 0; k < 4; k++) {
        start[k] = qm_router_labelled_edge(r, r->vertex[qm_router_start(r, dart[k])], dart[k] / 2);
        if (start[k] == QM_NO_INDEX) return true;
    }
    qm_route_disc d;
    bool is_made;
    if (!qm_router_gather(r, r->arena, start[0] / 3, NULL, &d, &is_made)) return false;
    if (!is_made) return true;
    for (int k = 0; k < 4; k++) {
        if (r->stamp[start[k] / 3] != r->stamp_value) return true;
        uint32_t corner = qm_router_corner_at(r, &d, start[k]);
        while (place[k] < d.ring_count && d.ring[place[k]] != corner)
            place[k]++;
    }
    for (int k = 0; k < 4; k++) {
        size_t end = place[(k + 1) & 3], count = (end + d.ring_count - place[k]) % d.ring_count;
        qm_route_disc_place_arc(&d, place[k], count, (225.0 + 90.0 * k) * QM_DEGREE, 90.0 * QM_DEGREE);
    }
    for (size_t i = 0; i < d.ring_count; i++)
        if (!d.is_fixed[d.ring[i]]) return true;
    if (!qm_tmesh_chart_flatten(r->arena, &d.chart, d.is_fixed, &is_made)) return false;
    const int n = QM_LAYOUT_GRID;
    uint32_t triangle = 0;
    for (int row = 1; row < n && is_made; row++)
        for (int column = 1; column < n; column++) {
            double x = 2.0 * column / n - 1, y = 2.0 * row / n - 1;
            qm_tmesh_flat at = {x * sqrt(1 - y * y / 2), y * sqrt(1 - x * x / 2)};
            if (r->turn[patch] < 0) at = (qm_tmesh_flat){at.v, at.u};
            qm_vec on;
            if (qm_tmesh_chart_lift(&d.chart, at, &triangle, &on)) grid[row * (n + 1) + column] = on;
        }
    return true;
}

static void store_grid(const qm_vec grid[QM_LAYOUT_GRID_POINTS], size_t patch, double *grids)
{
    for (int i = 0; i < QM_LAYOUT_GRID_POINTS; i++)
        qm_vec_store(grids + 3 * ((size_t)QM_LAYOUT_GRID_POINTS * patch + (size_t)i), grid[i]);
}

void qm_router_blend_grids(const qm_layout *layout, double *grids)
{
    for (uint32_t p = 0; p < layout->patch_count; p++) {
        qm_vec grid[QM_LAYOUT_GRID_POINTS];
        grid_border(layout, p, grid);
        blend_grid(grid);
        store_grid(grid, p, grids);
    }
}

qm_status qm_router_write_layout(qm_router *r, double *grids, qm_layout *out)
{
    const qm_layout *layout = r->layout;
    qm_status status = QM_OK;
    for (uint32_t n = 0; n < layout->node_count && status == QM_OK; n++) {
        double at[3];
        qm_vec_store(at, r->m.position[r->vertex[n]]);
        status = qm_layout_add_node(r->ctx, out, at);
    }
    for (uint32_t c = 0; c < layout->curve_count && status == QM_OK && !r->is_lost; c++) {
        double *points;
        size_t count;
        if (!qm_router_list_points(r, c, &points, &count)) return QM_E_NO_MEMORY;
        if (count < 2) r->is_lost = true;
        if (!r->is_lost && !grade_points(r, points, count, &points, &count)) return QM_E_NO_MEMORY;
        if (!r->is_lost)
            status =
                qm_layout_add_curve(r->ctx, out, layout->curves[c].from, layout->curves[c].to, points, count);
    }
    for (uint32_t p = 0; p < layout->patch_count && status == QM_OK && !r->is_lost; p++) {
        uint32_t id[4];
        for (int k = 0; k < 4; k++)
            id[k] = layout->patches[p].side[k];
        status = qm_layout_add_patch(r->ctx, out, id);
    }
    for (uint32_t p = 0; p < layout->patch_count && status == QM_OK && !r->is_lost; p++) {
        qm_vec grid[QM_LAYOUT_GRID_POINTS];
        if (qm_context_canceled(r->ctx)) r->is_lost = true;
        grid_border(out, p, grid);
        blend_grid(grid);
        if (!chart_grid(r, p, grid)) return QM_E_NO_MEMORY;
        store_grid(grid, p, grids);
    }
    return status;
}
