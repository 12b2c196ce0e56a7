/**
 * quality.c: shape measures of quads, summed over a mesh.
 */
#include "qm/quality.h"

#include "quad_shape.h"

/** The sum of the corners' differences from a right angle, in degrees; *worst is the running maximum. */
static double angle_sum(const qm_vec corner[4], double *worst)
{
    const double degrees = 57.29577951308232;
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]);
        qm_vec back = qm_vec_sub(corner[(k + 3) % 4], corner[k]);
        double angle = degrees * atan2(qm_vec_norm(qm_vec_cross(on, back)), qm_vec_dot(on, back));
        sum += fabs(angle - 90.0);
        *worst = fmax(*worst, fabs(angle - 90.0));
    }
    return sum;
}

static double edge_ratio(const qm_vec corner[4])
{
    double shortest = INFINITY, longest = 0.0;
    for (int k = 0; k < 4; k++) {
        double length = qm_vec_distance(corner[k], corner[(k + 1) % 4]);
        shortest = fmin(shortest, length);
        longest = fmax(longest, length);
    }
    return longest < QM_QUALITY_MAX_RATIO * shortest ? longest / shortest : QM_QUALITY_MAX_RATIO;
}

/** Distance between the diagonals, as a fraction of their mean length. */
static double warp(const qm_vec corner[4])
{
    qm_vec first = qm_vec_sub(corner[2], corner[0]), second = qm_vec_sub(corner[3], corner[1]);
    qm_vec normal = qm_vec_cross(first, second);
    double length = qm_vec_norm(normal), mean = 0.5 * (qm_vec_norm(first) + qm_vec_norm(second));
    if (!(length > 0.0)) return 0.0;
    return fabs(qm_vec_dot(qm_vec_sub(corner[1], corner[0]), normal)) / (length * mean);
}

static void add_quad(const qm_vec corner[4], qm_quality *out)
{
    double sine = qm_quad_min_sine(corner), ratio = edge_ratio(corner), twist = warp(corner);
    out->least_jacobian = out->quads == 0 ? sine : fmin(out->least_jacobian, sine);
    out->quads++;
    out->folded += !(sine > 0.0);
    out->mean_angle += angle_sum(corner, &out->max_angle) / 4.0;
    out->mean_edge_ratio += ratio;
    out->max_edge_ratio = fmax(out->max_edge_ratio, ratio);
    out->mean_warp += twist;
    out->max_warp = fmax(out->max_warp, twist);
}

static void load_corners(const qm_mesh *mesh, size_t face, qm_vec corner[4])
{
    for (int k = 0; k < 4; k++)
        corner[k] = qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)k]);
}

static bool face_apart(const qm_mesh *mesh, size_t a, size_t b)
{
    qm_vec one[4], other[4];
    load_corners(mesh, a, one);
    load_corners(mesh, b, other);
    return qm_quad_faces_apart(qm_quad_normal(one), qm_quad_normal(other));
}

/** Counts the inverted quads of a grid whose first face is first: three or more neighbours face apart from
 * each. */
static size_t count_inverted(const qm_mesh *mesh, const qm_mesh_grid *grid, size_t first)
{
    size_t inverted = 0, columns = grid->columns;
    for (size_t j = 0; j < grid->rows; j++) {
        for (size_t i = 0; i < columns; i++) {
            size_t face = first + j * columns + i;
            int apart = 0;
            if (i > 0) apart += face_apart(mesh, face, face - 1);
            if (i + 1 < columns) apart += face_apart(mesh, face, face + 1);
            if (j > 0) apart += face_apart(mesh, face, face - columns);
            if (j + 1 < grid->rows) apart += face_apart(mesh, face, face + columns);
            inverted += apart >= 3;
        }
    }
    return inverted;
}

void qm_quality_measure(const qm_mesh *mesh, qm_quality *out)
{
    QM_ASSERT(mesh && out);
    *out = (qm_quality){0};
    for (size_t face = 0; face < mesh->face_count; face++) {
        if (mesh->faces[4 * face + 3] == QM_NO_INDEX) continue;
        qm_vec corner[4];
        load_corners(mesh, face, corner);
        add_quad(corner, out);
    }
    size_t first = 0;
    for (size_t g = 0; g < mesh->grid_count; g++) {
        out->turned += count_inverted(mesh, &mesh->grids[g], first);
        first += (size_t)mesh->grids[g].rows * mesh->grids[g].columns;
    }
    if (out->quads == 0) return;
    out->mean_angle /= (double)out->quads;
    out->mean_edge_ratio /= (double)out->quads;
    out->mean_warp /= (double)out->quads;
}
