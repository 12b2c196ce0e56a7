/* The surface by formula of pairs.py, made in memory: for meshes that no file should hold. */
#include "engine.h"

#include <math.h>
#include <stdio.h>

typedef struct grid {
    uint32_t columns, rows;
} grid;

static void put_vertex(const grid *of, uint32_t row, uint32_t column, double *out)
{
    double v = 2.0 * M_PI * row / of->rows, u = 2.0 * M_PI * column / of->columns;
    double tube = 0.4 + 0.03 * sin(9.0 * u) * cos(5.0 * v), ring = 1.0 + tube * cos(v);
    out[0] = ring * cos(u);
    out[1] = ring * sin(u);
    out[2] = tube * sin(v);
}

/** The quad at a place, or its two triangles. */
static void put_faces(const grid *of, uint32_t row, uint32_t column, bool is_cut, uint32_t *out)
{
    uint32_t next = (column + 1) % of->columns, here = row * of->columns,
             below = (row + 1) % of->rows * of->columns;
    const uint32_t a = here + column, b = here + next, c = below + next, d = below + column;
    const uint32_t faces[2][4] = {{a, b, c, is_cut ? QM_NO_INDEX : d}, {a, c, d, QM_NO_INDEX}};
    for (int i = 0; i < 4 * (is_cut ? 2 : 1); i++)
        out[i] = faces[i / 4][i % 4];
}

bool bench_make_torus(qm_context *ctx, const char *name, qm_mesh *out)
{
    grid of;
    unsigned corners;
    char end;
    if (sscanf(name, "torus:%ux%ux%u%c", &of.columns, &of.rows, &corners, &end) != 3) return false;
    if (of.columns < 3 || of.rows < 3 || (corners != 3 && corners != 4) || of.rows > 1000000000 / of.columns)
        bench_fail(name, "is no torus:COLUMNSxROWSxCORNERS of at most 10^9 vertices");
    size_t quads = (size_t)of.rows * of.columns, cuts = corners == 3 ? 2 : 1;
    *out = (qm_mesh){.vertex_count = quads, .face_count = cuts * quads};
    out->positions = qm_context_alloc(ctx, out->vertex_count, 3 * sizeof *out->positions);
    out->faces = qm_context_alloc(ctx, out->face_count, 4 * sizeof *out->faces);
    if (!out->positions || !out->faces) bench_fail(name, "there is not enough memory");
    for (uint32_t row = 0; row < of.rows; row++) {
        for (uint32_t column = 0; column < of.columns; column++) {
            size_t place = (size_t)row * of.columns + column;
            put_vertex(&of, row, column, out->positions + 3 * place);
            put_faces(&of, row, column, corners == 3, out->faces + 4 * cuts * place);
        }
    }
    return true;
}
