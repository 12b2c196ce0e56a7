/**
 * tetra_fit.c: the offset radii of a patch from the leaves up, and its box.
 */
#include "box.h"
#include "bvh/tetra_tree.h"
#include "kernels.h"
#include "tetra_bound.h"

#define FETCH_QUADS 64   /* of a part whose vertices are prefetched together */
#define LEAF_VERTICES 24 /* 18 at max: two rows of nine */

/**
 * Fraction of distance d and size S (max coordinate relative to a corner) by which a distance of floats may
 * be too small: 32 v with v = 2^-24. The point and a corner are off by v S along each axis, the point
 * relative to the corner and both sides by 2 v S, the steps along the sides by 6 v S, sqrt(3) times that
 * together: 24 v S. The last difference, squares, sum and root: 4 v d.
 */
#define FLOAT_MARGIN 0x1p-19

/** By which a distance of doubles may be too small: 24 v S + 4 v d again, with v = 2^-53; as S <= 2 and d <=
 * 4 in local space, less than 2^-46. */
#define RADIUS_MARGIN 0x1p-44

typedef struct tetra_fit {
    qm_tetra *tetra;
    const qm_tetra_patch *patch;
    const uint64_t *changed; /* a bit for each node to be computed; NULL: all */
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

/** The vertices of a leaf relative to its first corner, padded with that corner to a multiple of eight.
 * Floats suffice: their errors are in proportion to the size of the leaf. */
typedef struct leaf_points {
    _Alignas(32) float at[3][LEAF_VERTICES];
    int count;
    float size; /* the max coordinate by magnitude */
} leaf_points;

static inline qm_vf load_floats(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

static inline void load_leaf(const tetra_fit *fit, const qm_tetra_part *part, qm_vec origin,
                             leaf_points *points)
{
    points->count = 0;
    for (uint32_t r = 0; r <= part->rows; r++) {
        const uint32_t *vertex = vertex_row(fit, part->row + r) + part->column;
        for (uint32_t c = 0; c <= part->columns; c++) {
            qm_vec p = qm_vec_sub(qm_tetra_vertex(fit->tetra, vertex[c]), origin);
            points->at[0][points->count] = (float)p.x;
            points->at[1][points->count] = (float)p.y;
            points->at[2][points->count++] = (float)p.z;
        }
    }
    for (; points->count % 8 != 0; points->count++)
        for (int k = 0; k < 3; k++)
            points->at[k][points->count] = 0.0f;
    qm_vf max = {0};
    for (int i = 0; i < points->count; i += 8)
        for (int k = 0; k < 3; k++) {
            qm_vf x = load_floats(points->at[k] + i);
            max = qm_vf_max(max, qm_vf_max(x, -x));
        }
    QM_ASSERT(points->count <= LEAF_VERTICES);
    points->size = qm_vf_max_lane(max);
}

/** A face by one of its corners and the two sides there, which in a patch are about perpendicular. */
typedef struct float_face {
    float a[3], e[3], g[3], ee, eg, gg, inverse;
} float_face;

static inline float_face float_face_make(const float corner[4][3], int at)
{
    float_face face;
    for (int k = 0; k < 3; k++) {
        face.a[k] = corner[at][k];
        face.e[k] = corner[(at + 1) % 4][k] - face.a[k];
        face.g[k] = corner[(at + 3) % 4][k] - face.a[k];
    }
    face.ee = face.e[0] * face.e[0] + face.e[1] * face.e[1] + face.e[2] * face.e[2];
    face.eg = face.e[0] * face.g[0] + face.e[1] * face.g[1] + face.e[2] * face.g[2];
    face.gg = face.g[0] * face.g[0] + face.g[1] * face.g[1] + face.g[2] * face.g[2];
    float area2 = face.ee * face.gg - face.eg * face.eg;
    face.inverse = area2 > 0.0f ? 1.0f / area2 : 0.0f;
    return face;
}

/** Squared distances from eight points to points of a face near their footpoints. However the weights are
 * rounded, they are those of a point of the face. */
static inline qm_vf float_face_d2(const float_face *face, qm_vf x, qm_vf y, qm_vf z)
{
    const qm_vf zero = {0}, one = zero + 1.0f;
    x -= face->a[0];
    y -= face->a[1];
    z -= face->a[2];
    qm_vf we = x * face->e[0] + y * face->e[1] + z * face->e[2];
    qm_vf wg = x * face->g[0] + y * face->g[1] + z * face->g[2];
    qm_vf s = qm_vf_min(qm_vf_max((we * face->gg - wg * face->eg) * face->inverse, zero), one);
    qm_vf t = qm_vf_min(qm_vf_max((wg * face->ee - we * face->eg) * face->inverse, zero), one - s);
    x -= s * face->e[0] + t * face->g[0];
    y -= s * face->e[1] + t * face->g[1];
    z -= s * face->e[2] + t * face->g[2];
    return x * x + y * y + z * z;
}

/** An upper bound of the max distance of the vertices of a leaf to the faces. */
static inline double leaf_radius(const tetra_fit *fit, const qm_tetra_part *part, const qm_vec corner[4])
{
    leaf_points points;
    load_leaf(fit, part, corner[0], &points);
    float corners[4][3];
    for (int i = 0; i < 4; i++) {
        qm_vec c = qm_vec_sub(corner[i], corner[0]);
        corners[i][0] = (float)c.x;
        corners[i][1] = (float)c.y;
        corners[i][2] = (float)c.z;
    }
    float_face face[4];
    for (int i = 0; i < 4; i++)
        face[i] = float_face_make(corners, i);
    qm_vf max = {0};
    for (int i = 0; i < points.count; i += 8) {
        qm_vf x = load_floats(points.at[0] + i), y = load_floats(points.at[1] + i),
              z = load_floats(points.at[2] + i);
        qm_vf d2 = float_face_d2(&face[0], x, y, z);
        for (int k = 1; k < 4; k++)
            d2 = qm_vf_min(d2, float_face_d2(&face[k], x, y, z));
        max = qm_vf_max(max, d2);
    }
    double distance = sqrt((double)qm_vf_max_lane(max));
    return distance + FLOAT_MARGIN * (distance + (double)points.size);
}

/** Prefetches the vertices of a part, whose rows lie far apart in memory. */
static inline void fetch_part(const tetra_fit *fit, const qm_tetra_part *part)
{
    const double *positions = fit->tetra->bvh->mesh.positions;
    for (uint32_t r = 0; r <= part->rows; r++) {
        const uint32_t *vertex = vertex_row(fit, part->row + r) + part->column;
        for (uint32_t c = 0; c <= part->columns; c++)
            __builtin_prefetch(positions + 3 * (size_t)vertex[c]);
    }
}

static inline float keep_radius(tetra_fit *fit, uint32_t node, double radius)
{
    fit->updated++;
    return fit->tetra->nodes[node].radius = radius > 0.0 ? qm_float_above(radius + RADIUS_MARGIN) : 0.0f;
}

/** Computes the radius of a part with these corners, in cyclic order. */
static double fit_part(tetra_fit *fit, const qm_tetra_part *part, const qm_vec corner[4])
{
    if (fit->changed && !(fit->changed[part->node / 64] >> part->node % 64 & 1))
        return (double)fit->tetra->nodes[part->node].radius;
    if (qm_tetra_part_is_leaf(part))
        return (double)keep_radius(fit, part->node, leaf_radius(fit, part, corner));
    uint64_t quads = (uint64_t)part->rows * part->columns;
    if (quads <= FETCH_QUADS && quads > FETCH_QUADS / 2) fetch_part(fit, part);
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
    qm_tetra_faces faces = qm_tetra_faces_make(qm_tetra_corners(corner));
    double apart2 = fmax(qm_tetra_faces_upper2(&faces, v1), qm_tetra_faces_upper2(&faces, v2));
    return (double)keep_radius(fit, part->node, radius + sqrt(apart2));
}

size_t QM_KERNEL(tetra_fit)(qm_tetra *tetra, size_t patch, const uint64_t *changed)
{
    tetra_fit fit = {.tetra = tetra, .patch = &tetra->patches[patch], .changed = changed};
    qm_tetra_part root = qm_tetra_part_root(fit.patch);
    uint32_t vertex[4];
    qm_vec corner[4];
    qm_tetra_part_corners(tetra, fit.patch, &root, vertex);
    for (int i = 0; i < 4; i++)
        corner[i] = qm_tetra_vertex(tetra, vertex[i]);
    double radius = fit_part(&fit, &root, corner);
    qm_box box = qm_vec_box(corner, 4);
    for (int k = 0; k < 3; k++) {
        box.min[k] -= radius;
        box.max[k] += radius;
    }
    qm_box_tree_set(&tetra->boxes, patch, &box);
    return fit.updated;
}
