#include "regridded.h"

#include <math.h>
#include <string.h>

enum { MOST = 6 };
#define CROWDED 0.8 /* of the way to one point: quads of a heap cross one another */

static void patch_at(const qm_mesh *mesh, const uint32_t *face, double s, double t, double out[3])
{
    for (int k = 0; k < 3; k++) {
        const double *p = mesh->positions + k;
        out[k] = (1 - s) * (1 - t) * p[3 * (size_t)face[0]] + s * (1 - t) * p[3 * (size_t)face[1]] +
                 s * t * p[3 * (size_t)face[2]] + (1 - s) * t * p[3 * (size_t)face[3]];
    }
}

qm_mesh qm_regridded(const qm_mesh *mesh, int columns, const double *u, int rows, const double *v,
                     bool as_triangles)
{
    size_t cells = (size_t)(columns * rows), corners = (size_t)((columns + 1) * (rows + 1));
    qm_mesh out = qm_shape_make(mesh->face_count * corners, mesh->face_count * cells);
    for (size_t f = 0; f < mesh->face_count; f++) {
        uint32_t *face = out.faces + 4 * f * cells;
        size_t first = f * corners;
        for (int j = 0; j <= rows; j++)
            for (int i = 0; i <= columns; i++)
                patch_at(mesh, mesh->faces + 4 * f, u[i], v[j],
                         out.positions + 3 * (first + (size_t)(j * (columns + 1) + i)));
        for (int j = 0; j < rows; j++)
            for (int i = 0; i < columns; i++, face += 4) {
                uint32_t low = (uint32_t)first + (uint32_t)(j * (columns + 1) + i),
                         side = (uint32_t)columns + 1;
                memcpy(face, (const uint32_t[]){low, low + 1, low + side + 1, low + side}, 4 * sizeof *face);
            }
    }
    if (!as_triangles) return out;
    qm_mesh triangles = qm_shape_triangulated(&out);
    qm_shape_free(&out);
    return triangles;
}

static void mix(double *out, const double *a, const double *b, double share)
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + share * (b[k] - a[k]);
}

static void shake(qm_random *random, double *p, double amplitude)
{
    for (int k = 0; k < 3; k++)
        p[k] += amplitude * qm_random_range(random, -1, 1);
}

/** Moves the corners of a quad c[0..3] that lie anywhere. */
static void fold_quad(qm_random *random, qm_fold fold, double *c)
{
    double crumb = (double[]){0, 1e-9, 1e-3, 0.1}[qm_random_below(random, 4)];
    if (fold == QM_FOLD_BOW_TIE || fold == QM_FOLD_SWAPPED) {
        /* A parallelogram, 1 and 2 swapped. */
        double corner[3];
        for (int k = 0; k < 3; k++)
            corner[k] = c[3 + k] + c[9 + k] - c[k];
        memcpy(c + 6, c + 3, sizeof corner);
        memcpy(c + 3, corner, sizeof corner);
        if (fold == QM_FOLD_SWAPPED) shake(random, c + 6, qm_random_range(random, 0, 0.6));
    } else if (fold == QM_FOLD_AT_EDGE) {
        size_t to = qm_random_below(random, 3);
        mix(c + 9, c, c + 3, (double[]){0, 1, 0.5}[to]);
        shake(random, c + 9, crumb);
    } else if (fold == QM_FOLD_REFLEX) {
        double on_side[3];
        mix(on_side, c + 3, c + 6, qm_random_range(random, 0.2, 0.8));
        mix(c + 9, c, on_side, qm_random_range(random, 0.1, 0.9));
    } else if (fold == QM_FOLD_DIAGONAL) {
        memcpy(c + 9, c + 3, 3 * sizeof *c);
        shake(random, c + 9, crumb);
    } else if (fold == QM_FOLD_LINE) {
        for (int i = 2; i < 4; i++) {
            mix(c + 3 * i, c, c + 3, qm_random_range(random, -0.5, 1.5));
            shake(random, c + 3 * i, crumb);
        }
    }
}

qm_mesh qm_folded_heap(qm_random *random, size_t count)
{
    qm_mesh heap = qm_shape_soup(random, count, QM_SOUP_QUADS, QM_SOUP_APART, 1);
    for (size_t f = 0; f < count; f++) {
        double *c = heap.positions + 12 * f, apart[3];
        for (int k = 0; k < 3; k++)
            apart[k] = CROWDED * c[k];
        for (int i = 0; i < 12; i++)
            c[i] -= apart[i % 3];
        fold_quad(random, (qm_fold)qm_random_below(random, QM_FOLD_COUNT), c);
    }
    return heap;
}

/** Cuts 0 = cut[0] < ... < cut[count] = 1. */
static int draw_cuts(qm_random *random, double cut[MOST + 1])
{
    int count = 1 + (int)qm_random_below(random, MOST);
    bool is_even = qm_random_below(random, 4) > 0;
    double sum = 0;
    cut[0] = 0;
    for (int i = 1; i <= count; i++)
        cut[i] = sum += is_even ? 1 : qm_random_range(random, 0.05, 1);
    for (int i = 1; i <= count; i++)
        cut[i] = i == count ? 1 : cut[i] / sum;
    return count;
}

static qm_mesh draw_grid(qm_random *random, const qm_mesh *mesh, bool as_triangles)
{
    double u[MOST + 1], v[MOST + 1];
    int columns = draw_cuts(random, u), rows = draw_cuts(random, v);
    return qm_regridded(mesh, columns, u, rows, v, as_triangles);
}

qm_regridded_pair qm_regridded_draw(qm_random *random, qm_fold fold, qm_regridding how)
{
    size_t count = 1 + qm_random_below(random, qm_random_below(random, 4) == 0 ? 4 : 1);
    qm_mesh quads = qm_shape_soup(random, count, QM_SOUP_QUADS, QM_SOUP_APART,
                                  (double[]){0, 0.1, 2}[qm_random_below(random, 3)]);
    for (size_t f = 0; f < count; f++)
        fold_quad(random, fold, quads.positions + 12 * f);
    bool is_a_cut = qm_random_below(random, 2), is_cut = how == QM_REGRIDDED_TRIANGLES;
    qm_regridded_pair pair = {draw_grid(random, &quads, is_cut && is_a_cut),
                              draw_grid(random, &quads, is_cut && !is_a_cut), 0};
    double noise = pow(10, how == QM_REGRIDDED_CLOSELY ? qm_random_range(random, -15, -8)
                                                       : qm_random_range(random, -8, -2));
    pair.noise = how == QM_REGRIDDED_TRIANGLES ? 0 : noise;
    qm_shape_shake(&pair.b, random, pair.noise);
    qm_shape_free(&quads);
    return pair;
}
