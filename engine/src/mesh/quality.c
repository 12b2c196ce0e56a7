/**
 * quality.c: shape measures of quads, summed over a mesh.
 */
#include "qm/quality.h"

#include "quad_shape.h"

/** Distance between the diagonals, as a fraction of their mean length. */
static double warp(const qm_vec corner[4])
{
    qm_vec first = qm_vec_sub(corner[2], corner[0]), second = qm_vec_sub(corner[3], corner[1]);
    qm_vec normal = qm_vec_cross(first, second);
    double length = qm_vec_norm(normal), mean = 0.5 * (qm_vec_norm(first) + qm_vec_norm(second));
    if (!(length > 0.0)) return 0.0;
    return fabs(qm_vec_dot(qm_vec_sub(corner[1], corner[0]), normal)) / (length * mean);
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

void qm_quality_measure(const qm_mesh *mesh, qm_quality *out)
{
    QM_ASSERT(mesh && out);
    *out = (qm_quality){0};
    for (size_t face = 0; face < mesh->face_count; face++) {
        if (mesh->faces[4 * face + 3] == QM_NO_INDEX) continue;
        qm_vec corner[4];
        load_corners(mesh, face, corner);
        double shortest = INFINITY, longest = 0.0;
        for (int k = 0; k < 4; k++) {
            double length = qm_vec_distance(corner[k], corner[(k + 1) % 4]);
            shortest = fmin(shortest, length);
            longest = fmax(longest, length);
        }
        double edge_ratio =
            longest < QM_QUALITY_MAX_RATIO * shortest ? longest / shortest : QM_QUALITY_MAX_RATIO;
        double sine = qm_quad_min_sine(corner), twist = warp(corner);
        out->least_jacobian = out->quads == 0 ? sine : fmin(out->least_jacobian, sine);
        out->quads++;
        out->folded += !(sine > 0.0);
        /* The corners' differences from a right angle, in degrees. */
        const double degrees = 57.29577951308232;
        double sum = 0.0;
        for (int k = 0; k < 4; k++) {
            qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]);
            qm_vec back = qm_vec_sub(corner[(k + 3) % 4], corner[k]);
            double angle = degrees * qm_vec_angle(on, back);
            sum += fabs(angle - 90.0);
            out->max_angle = fmax(out->max_angle, fabs(angle - 90.0));
        }
        out->mean_angle += sum / 4.0;
        out->mean_edge_ratio += edge_ratio;
        out->max_edge_ratio = fmax(out->max_edge_ratio, edge_ratio);
        out->mean_warp += twist;
        out->max_warp = fmax(out->max_warp, twist);
    }
    size_t first = 0;
    for (size_t g = 0; g < mesh->grid_count; g++) {
        /* The inverted quads of a grid whose first face is first: three or more neighbours face apart from
         * each. */
        size_t inverted = 0, columns = mesh->grids[g].columns;
        for (size_t j = 0; j < mesh->grids[g].rows; j++) {
            for (size_t i = 0; i < columns; i++) {
                size_t quad = first + j * columns + i;
                int apart = 0;
                if (i > 0) apart += face_apart(mesh, quad, quad - 1);
                if (i + 1 < columns) apart += face_apart(mesh, quad, quad + 1);
                if (j > 0) apart += face_apart(mesh, quad, quad - columns);
                if (j + 1 < mesh->grids[g].rows) apart += face_apart(mesh, quad, quad + columns);
                inverted += apart >= 3;
            }
        }
        out->turned += inverted;
        first += (size_t)mesh->grids[g].rows * mesh->grids[g].columns;
    }
    if (out->quads == 0) return;
    out->mean_angle /= (double)out->quads;
    out->mean_edge_ratio /= (double)out->quads;
    out->mean_warp /= (double)out->quads;
}
