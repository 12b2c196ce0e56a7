/**
 * tetra_fit.c: the offset radii of a patch from the leaves up, and its box.
 */
#include "../tetra_tree.h"
#include "box.h"
#include "kernels.h"
#include "tetra_bound.h"

#define RADIUS_MARGIN 0x1p-44 /* more than the rounding of local coordinates and distances */

typedef struct tetra_fit {
    qm_tetra *tetra;
    const qm_tetra_patch *patch;
    const uint64_t *changed; /* a bit a node: others keep their radii; NULL: all change */
    size_t updated;
} tetra_fit;

static inline const uint32_t *vertex_row(const tetra_fit *fit, uint32_t row)
{
    return fit->tetra->vertices + fit->patch->vertices + (size_t)row * (fit->patch->columns + 1);
}

static inline qm_vec vertex_at(const tetra_fit *fit, uint32_t row, uint32_t column)
{
    return qm_tetra_vertex(fit->tetra, vertex_row(fit, row)[column]);
}

/** The greatest distance of the vertices of a leaf to its faces. */
static inline double leaf_radius(const tetra_fit *fit, const qm_tetra_part *part, const qm_tetra_faces *faces)
{
    double most2 = 0.0;
    for (uint32_t r = 0; r <= part->rows; r++) {
        const uint32_t *vertex = vertex_row(fit, part->row + r) + part->column;
        bool has_corners = r == 0 || r == part->rows;
        for (uint32_t c = has_corners; c + has_corners <= part->columns; c++) {
            double d2 = qm_tetra_faces_upper2(faces, qm_tetra_vertex(fit->tetra, vertex[c]));
            most2 = d2 > most2 ? d2 : most2;
        }
    }
    return sqrt(most2);
}

static inline float keep_radius(tetra_fit *fit, uint32_t node, double radius)
{
    fit->updated++;
    return fit->tetra->nodes[node].radius = radius > 0.0 ? qm_float_above(radius + RADIUS_MARGIN) : 0.0f;
}

/** The radius of a part with these corners, in turn. */
static double fit_part(tetra_fit *fit, const qm_tetra_part *part, const qm_vec corner[4])
{
    if (fit->changed && !(fit->changed[part->node / 64] >> part->node % 64 & 1))
        return (double)fit->tetra->nodes[part->node].radius;
    qm_tetra_faces faces = qm_tetra_faces_make(qm_tetra_corners(corner));
    if (qm_tetra_part_is_leaf(part))
        return (double)keep_radius(fit, part->node, leaf_radius(fit, part, &faces));
    qm_tetra_part half[2];
    qm_tetra_part_cut(part, half);
    half[1].node = fit->tetra->nodes[part->node].link;
    uint32_t row = half[1].row, column = half[1].column;
    bool by_rows = row > part->row;
    qm_vec v1 = vertex_at(fit, row, column);
    qm_vec v2 =
        by_rows ? vertex_at(fit, row, column + part->columns) : vertex_at(fit, row + part->rows, column);
    const qm_vec before[4] = {corner[0], by_rows ? corner[1] : v1, v2, by_rows ? v1 : corner[3]};
    const qm_vec after[4] = {v1, by_rows ? v2 : corner[1], corner[2], by_rows ? corner[3] : v2};
    double radius = fmax(fit_part(fit, &half[0], before), fit_part(fit, &half[1], after));
    double apart2 = fmax(qm_tetra_faces_upper2(&faces, v1), qm_tetra_faces_upper2(&faces, v2));
    return (double)keep_radius(fit, part->node, radius + sqrt(apart2));
}

size_t QM_KERNEL(tetra_fit)(qm_tetra *tetra, size_t patch, const uint64_t *changed)
{
    tetra_fit fit = {.tetra = tetra, .patch = &tetra->patches[patch], .changed = changed};
    qm_tetra_part whole = qm_tetra_part_whole(fit.patch);
    uint32_t vertex[4];
    qm_vec corner[4];
    qm_tetra_part_corners(tetra, fit.patch, &whole, vertex);
    for (int i = 0; i < 4; i++)
        corner[i] = qm_tetra_vertex(tetra, vertex[i]);
    double radius = fit_part(&fit, &whole, corner);
    qm_box box = qm_vec_box(corner, 4);
    for (int k = 0; k < 3; k++) {
        box.min[k] -= radius;
        box.max[k] += radius;
    }
    qm_box_tree_set(&tetra->boxes, patch, &box);
    return fit.updated;
}
