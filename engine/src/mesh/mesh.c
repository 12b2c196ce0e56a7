/**
 * mesh.c: checks of a mesh and its bounding box.
 */
#include "qm/mesh.h"

#include <math.h>
#include <string.h>

#include "bvh/kernel.h"

void qm_mesh_reset(qm_context *ctx, qm_mesh *mesh)
{
    qm_context_free(ctx, mesh->positions, mesh->vertex_count, 3 * sizeof *mesh->positions);
    qm_context_free(ctx, mesh->faces, mesh->face_count, 4 * sizeof *mesh->faces);
    qm_context_free(ctx, mesh->face_origin, mesh->face_count, sizeof *mesh->face_origin);
    qm_context_free(ctx, mesh->grids, mesh->grid_count, sizeof *mesh->grids);
    qm_context_free(ctx, mesh->normals, mesh->vertex_count, 3 * sizeof *mesh->normals);
    *mesh = (qm_mesh){0};
}

static qm_box box_of_vertices(const qm_mesh *mesh)
{
    qm_box box;
    qm_kernel_get()->vertex_box(mesh->positions, mesh->vertex_count, &box);
    return box;
}

/** Nearly always the box of all vertices, which the kernel reads in order, is the box of the used ones. */
qm_box qm_mesh_bounding_box(const qm_mesh *mesh)
{
    QM_ASSERT(mesh);
    const qm_box box = box_of_vertices(mesh);
    if (mesh->face_count == 0) return box;
    const qm_kernel *kernel = qm_kernel_get();
    uint32_t side[QM_BOX_SIDES] = {0};
    kernel->vertices_on_sides(mesh->positions, mesh->vertex_count, &box, side);
    if (kernel->faces_contain(mesh->faces, mesh->face_count, side)) return box;
    qm_box used = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < 4 * mesh->face_count; ++i) {
        if (mesh->faces[i] == QM_NO_INDEX) continue;
        const double *point = mesh->positions + 3 * (size_t)mesh->faces[i];
        for (int axis = 0; axis < 3; ++axis) { /* conditional moves, not branches: one instruction each */
            used.min[axis] = point[axis] < used.min[axis] ? point[axis] : used.min[axis];
            used.max[axis] = point[axis] > used.max[axis] ? point[axis] : used.max[axis];
        }
    }
    return used;
}

double qm_mesh_box_diagonal(const qm_box *box)
{
    double extent[3], largest = 0;
    for (int axis = 0; axis < 3; ++axis) {
        extent[axis] = box->max[axis] - box->min[axis];
        if (extent[axis] > largest) largest = extent[axis];
    }
    if (largest == 0 || !isfinite(largest)) return largest;

    /* Scaled by a power of two, which is exact, the largest extent lies in [0.5, 1). */
    int exponent;
    frexp(largest, &exponent);
    double sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
        double scaled = ldexp(extent[axis], -exponent);
        sum += scaled * scaled;
    }
    return ldexp(sqrt(sum), exponent);
}

/** True when no number is infinite or NaN. An exponent of ones carries into the sign bit: the compiler
 * vectorizes integer operations in a loop without an early exit. */
static bool all_finite(const double *numbers, size_t count)
{
    const uint64_t exponent = 0x7ff0000000000000u, step = 0x0010000000000000u;
    uint64_t carried = 0;
    for (size_t i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, numbers + i, sizeof bits);
        carried |= (bits & exponent) + step;
    }
    return carried >> 63 == 0;
}

qm_status qm_mesh_validate(qm_context *ctx, const qm_mesh *mesh)
{
    QM_ASSERT(ctx && mesh);
    if (mesh->vertex_count == 0 && mesh->face_count == 0)
        return qm_context_fail(ctx, QM_E_EMPTY, "the mesh has no vertex and no face");
    if (!all_finite(mesh->positions, 3 * mesh->vertex_count)) {
        size_t i = 0;
        while (isfinite(mesh->positions[i]))
            ++i;
        return qm_context_fail(ctx, QM_E_NOT_FINITE, "vertex %zu has a coordinate that is not finite", i / 3);
    }
    qm_box box = box_of_vertices(mesh);
    if (!isfinite(qm_mesh_box_diagonal(&box)))
        return qm_context_fail(ctx, QM_E_NOT_FINITE,
                               "the vertices lie so far apart that distances overflow double precision");
    if (mesh->vertex_count < QM_NO_INDEX &&
        qm_kernel_get()->faces_below(mesh->faces, mesh->face_count, (uint32_t)mesh->vertex_count))
        return QM_OK;
    for (size_t i = 0; i < mesh->face_count; ++i) {
        const uint32_t *face = mesh->faces + 4 * i;
        int corner = 0;
        while (corner < 4 && (face[corner] < mesh->vertex_count || (corner == 3 && face[3] == QM_NO_INDEX)))
            ++corner;
        if (corner < 4)
            return qm_context_fail(ctx, QM_E_INDEX, "face %zu refers to vertex %u of %zu, counted from 0", i,
                                   face[corner], mesh->vertex_count);
    }
    return QM_OK;
}
