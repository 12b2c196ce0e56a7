#include "cells.h"

#include <math.h>
#include <string.h>

#include "check.h"

/** A side of a cell that belongs to the surface. */
typedef struct cell_side {
    int cell[3], axis; /* normal to it */
    bool is_high;
} cell_side;

static bool is_filled(const qm_cells *cells, const int at[3])
{
    for (int k = 0; k < 3; k++)
        if (at[k] < 0 || at[k] >= cells->count[k]) return false;
    return cells->is_filled[at[0]][at[1]][at[2]];
}

/** Finds the sides of the surface; returns their number. */
static size_t find_sides(const qm_cells *cells, cell_side *out)
{
    size_t count = 0;
    for (int i = 0; i < cells->count[0]; i++)
        for (int j = 0; j < cells->count[1]; j++)
            for (int k = 0; k < cells->count[2]; k++)
                for (int s = 0; s < 6; s++) {
                    cell_side side = {{i, j, k}, s / 2, s % 2};
                    int beside[3] = {i, j, k};
                    beside[side.axis] += side.is_high ? 1 : -1;
                    if (is_filled(cells, side.cell) && !is_filled(cells, beside)) out[count++] = side;
                }
    return count;
}

enum { MAX_SIDES = 6 * QM_CELLS_MAX * QM_CELLS_MAX * QM_CELLS_MAX };

/** The axes of a side, so that the first, the second and the outer normal are right-handed. */
static void axes_of(const cell_side *side, int axis[2])
{
    axis[!side->is_high] = (side->axis + 1) % 3;
    axis[side->is_high] = (side->axis + 2) % 3;
}

static double between(const qm_cells *cells, int axis, int cell, double t)
{
    double low = cells->plane[axis][cell], high = cells->plane[axis][cell + 1];
    return t == 1.0 ? high : low + t * (high - low);
}

/** The point of a side at fractions along its two axes, before the warp. */
static void side_point(const qm_cells *cells, const cell_side *side, double s, double t, double out[3])
{
    int axis[2];
    axes_of(side, axis);
    out[side->axis] = cells->plane[side->axis][side->cell[side->axis] + side->is_high];
    out[axis[0]] = between(cells, axis[0], side->cell[axis[0]], s);
    out[axis[1]] = between(cells, axis[1], side->cell[axis[1]], t);
}

static void warp(const qm_cells *cells, double p[3])
{
    if (cells->warp) cells->warp(p);
}

/** The index of a point among those so far, appended if it is new. Equal points have equal bits. */
static uint32_t find_point(double *points, size_t *count, const double p[3])
{
    for (size_t i = 0; i < *count; i++)
        if (points[3 * i] == p[0] && points[3 * i + 1] == p[1] && points[3 * i + 2] == p[2])
            return (uint32_t)i;
    memcpy(points + 3 * *count, p, 24);
    return (uint32_t)(*count)++;
}

qm_mesh qm_cells_surface(const qm_cells *cells)
{
    cell_side side[MAX_SIDES];
    size_t sides = find_sides(cells, side), faces = 0, vertices = 0;
    for (size_t s = 0; s < sides; s++) {
        int axis[2];
        axes_of(&side[s], axis);
        faces += (size_t)cells->pieces[axis[0]] * (size_t)cells->pieces[axis[1]];
    }
    qm_mesh mesh = qm_shape_make(4 * faces, faces);
    size_t face = 0;
    for (size_t s = 0; s < sides; s++) {
        int axis[2];
        axes_of(&side[s], axis);
        int across = cells->pieces[axis[0]], up = cells->pieces[axis[1]];
        for (int j = 0; j < up; j++)
            for (int i = 0; i < across; i++, face++)
                for (int k = 0; k < 4; k++) {
                    double p[3];
                    side_point(cells, &side[s], (double)(i + (k == 1 || k == 2)) / across,
                               (double)(j + k / 2) / up, p);
                    mesh.faces[4 * face + (size_t)k] = find_point(mesh.positions, &vertices, p);
                }
    }
    mesh.vertex_count = vertices;
    for (size_t i = 0; i < vertices; i++)
        warp(cells, mesh.positions + 3 * i);
    return mesh;
}

/** The id of the curve between two corners, added if it is new. */
static uint32_t find_curve(const qm_cells *cells, qm_layout *layout, const double *corners, uint32_t from,
                           uint32_t to, int pieces)
{
    for (size_t c = 0; c < layout->curve_count; c++) {
        const qm_curve *curve = &layout->curves[c];
        if ((curve->from == from && curve->to == to) || (curve->from == to && curve->to == from))
            return curve->id;
    }
    qm_context ctx = qm_context_make();
    double points[3 * 65];
    assert_true(pieces <= 64);
    for (int k = 0; k <= pieces; k++) {
        for (int a = 0; a < 3; a++)
            points[3 * k + a] =
                corners[3 * from + (uint32_t)a] +
                (corners[3 * to + (uint32_t)a] - corners[3 * from + (uint32_t)a]) * k / pieces;
        warp(cells, points + 3 * k);
    }
    assert_int_equal(qm_layout_add_curve(&ctx, layout, from, to, points, (size_t)pieces + 1), QM_OK);
    return (uint32_t)layout->curve_count - 1;
}

qm_layout qm_cells_layout(const qm_cells *cells, int pieces)
{
    static const double at[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    cell_side side[MAX_SIDES];
    size_t sides = find_sides(cells, side), corner_count = 0;
    double *corners = malloc(4 * sides * 24);
    uint32_t(*corner)[4] = malloc(sides * sizeof *corner);
    assert_true(corners && corner);
    for (size_t s = 0; s < sides; s++)
        for (int k = 0; k < 4; k++) {
            double p[3];
            side_point(cells, &side[s], at[k][0], at[k][1], p);
            corner[s][k] = find_point(corners, &corner_count, p);
        }
    qm_context ctx = qm_context_make();
    qm_layout layout = {0};
    for (size_t i = 0; i < corner_count; i++) {
        double p[3];
        memcpy(p, corners + 3 * i, 24);
        warp(cells, p);
        assert_int_equal(qm_layout_add_node(&ctx, &layout, p), QM_OK);
    }
    for (size_t s = 0; s < sides; s++) {
        uint32_t id[4];
        for (int k = 0; k < 4; k++)
            id[k] = find_curve(cells, &layout, corners, corner[s][k], corner[s][(k + 1) % 4], pieces);
        assert_int_equal(qm_layout_add_patch(&ctx, &layout, id), QM_OK);
    }
    free(corners);
    free(corner);
    return layout;
}

/** The outer normal of the warped side at a point of it, by differences. */
static void set_normal(const qm_cells *cells, const cell_side *side, double s, double t, float out[3])
{
    const double step = 1e-6;
    double p[4][3], d[2][3];
    for (int k = 0; k < 4; k++) {
        side_point(cells, side,
                   s + (k == 0   ? step
                        : k == 1 ? -step
                                 : 0.0),
                   t + (k == 2   ? step
                        : k == 3 ? -step
                                 : 0.0),
                   p[k]);
        warp(cells, p[k]);
    }
    for (int a = 0; a < 3; a++) {
        d[0][a] = p[0][a] - p[1][a];
        d[1][a] = p[2][a] - p[3][a];
    }
    double n[3], length = 0.0;
    for (int a = 0; a < 3; a++) {
        int b = (a + 1) % 3, c = (a + 2) % 3;
        n[a] = d[0][b] * d[1][c] - d[0][c] * d[1][b];
        length += n[a] * n[a];
    }
    for (int a = 0; a < 3; a++)
        out[a] = (float)(n[a] / sqrt(length));
}

qm_mesh qm_cells_points(const qm_cells *cells, double density, size_t least, uint64_t stream)
{
    cell_side side[MAX_SIDES];
    size_t sides = find_sides(cells, side), total = 0, number[MAX_SIDES];
    for (size_t s = 0; s < sides; s++) {
        int axis[2];
        axes_of(&side[s], axis);
        double area = 1.0;
        for (int k = 0; k < 2; k++) {
            const double *plane = cells->plane[axis[k]] + side[s].cell[axis[k]];
            area *= plane[1] - plane[0];
        }
        number[s] = (size_t)(density * area) > least ? (size_t)(density * area) : least;
        total += number[s];
    }
    qm_random random = qm_random_make(qm_check_seed(), stream);
    qm_mesh points = qm_shape_make(total, 0);
    points.normals = malloc(3 * sizeof(float) * total);
    assert_non_null(points.normals);
    size_t next = 0;
    for (size_t s = 0; s < sides; s++)
        for (size_t k = 0; k < number[s]; k++, next++) {
            double u = qm_random_range(&random, 0, 1), v = qm_random_range(&random, 0, 1);
            side_point(cells, &side[s], u, v, points.positions + 3 * next);
            warp(cells, points.positions + 3 * next);
            set_normal(cells, &side[s], u, v, points.normals + 3 * next);
        }
    return points;
}
