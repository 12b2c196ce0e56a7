/**
 * ref_samples.c: samples of a mesh, in proportion to area.
 */
#include "ref_samples.h"

#include "core/vec.h"

static void load_triangle(const qm_mesh *mesh, size_t face, int half, qm_vec corner[3])
{
    const uint32_t *index = mesh->faces + 4 * face;
    const uint32_t of[3] = {index[0], index[1 + half], index[2 + half]};
    for (int k = 0; k < 3; k++)
        corner[k] = qm_vec_load(mesh->positions + 3 * (size_t)of[k]);
}

/** A normal of twice the triangle's area. */
static qm_vec triangle_normal(const qm_vec corner[3])
{
    return qm_vec_cross(qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]));
}

static double triangle_area(const qm_vec corner[3])
{
    return 0.5 * qm_vec_norm(triangle_normal(corner));
}

static void store_normal(float row[3], qm_vec normal)
{
    double length = qm_vec_norm(normal);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
    row[0] = (float)unit.x;
    row[1] = (float)unit.y;
    row[2] = (float)unit.z;
}

/**
 * The k-th sample as a point of a triangle: a quasirandom sequence in the square, folded into the triangle.
 * Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
 */
static qm_vec triangle_sample(const qm_vec corner[3], size_t k)
{
    double s = fmod(0.5 + 0.7548776662466927 * (double)k, 1.0);
    double t = fmod(0.5 + 0.5698402909980532 * (double)k, 1.0);
    if (s + t > 1.0) {
        s = 1.0 - s;
        t = 1.0 - t;
    }
    qm_vec along = qm_vec_axpy(corner[0], s, qm_vec_sub(corner[1], corner[0]));
    return qm_vec_axpy(along, t, qm_vec_sub(corner[2], corner[0]));
}

static double mesh_area(const qm_mesh *mesh)
{
    double area = 0.0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        int halves = mesh->faces[4 * face + 3] == QM_NO_INDEX ? 1 : 2;
        for (int half = 0; half < halves; half++) {
            qm_vec corner[3];
            load_triangle(mesh, face, half, corner);
            area += triangle_area(corner);
        }
    }
    return area;
}

size_t qm_ref_surface_sample(const qm_mesh *mesh, size_t count, double *positions, float *normals)
{
    double done = 0.0, total = mesh_area(mesh);
    size_t k = 0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        int halves = mesh->faces[4 * face + 3] == QM_NO_INDEX ? 1 : 2;
        for (int half = 0; half < halves; half++) {
            qm_vec corner[3];
            load_triangle(mesh, face, half, corner);
            done += triangle_area(corner);
            for (; k < count && ((double)k + 0.5) * total <= done * (double)count; k++) {
                qm_vec_store(positions + 3 * k, triangle_sample(corner, k));
                if (normals) store_normal(normals + 3 * k, triangle_normal(corner));
            }
        }
    }
    QM_ASSERT(k <= count);
    return k;
}
