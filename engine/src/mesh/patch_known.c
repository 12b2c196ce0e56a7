#include "patch_known.h"

#include <string.h>

static const uint32_t *face_at(const qm_mesh *mesh, size_t first, const qm_mesh_grid *grid, uint32_t row,
                               uint32_t column)
{
    return mesh->faces + 4 * (first + (size_t)row * grid->columns + column);
}

static bool has_four_corners(const uint32_t *face)
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++)
            if (face[i] == face[j]) return false;
    return face[3] != QM_NO_INDEX;
}

static bool grid_holds(const qm_mesh *mesh, size_t first, const qm_mesh_grid *grid)
{
    for (uint32_t row = 0; row < grid->rows; row++) {
        for (uint32_t column = 0; column < grid->columns; column++) {
            const uint32_t *face = face_at(mesh, first, grid, row, column);
            if (!has_four_corners(face)) return false;
            if (column > 0) {
                const uint32_t *before = face_at(mesh, first, grid, row, column - 1);
                if (before[1] != face[0] || before[2] != face[3]) return false;
            }
            if (row > 0) {
                const uint32_t *below = face_at(mesh, first, grid, row - 1, column);
                if (below[3] != face[0] || below[2] != face[1]) return false;
            }
        }
    }
    return true;
}

bool qm_patch_grids_hold(const qm_mesh *mesh)
{
    size_t first = 0;
    for (size_t i = 0; i < mesh->grid_count; i++) {
        const qm_mesh_grid *grid = &mesh->grids[i];
        size_t left = mesh->face_count - first;
        if (grid->rows == 0 || grid->columns == 0 || grid->rows > left / grid->columns) return false;
        if (!grid_holds(mesh, first, grid)) return false;
        first += (size_t)grid->rows * grid->columns;
    }
    return mesh->grid_count > 0 && first == mesh->face_count;
}

qm_status qm_patch_set_from_grids(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out)
{
    *out = (qm_patch_set){.patch_count = mesh->grid_count, .face_count = mesh->face_count};
    out->patches = qm_context_alloc(ctx, out->patch_count, sizeof *out->patches);
    out->faces = qm_context_alloc(ctx, out->face_count, sizeof *out->faces);
    out->turns = qm_context_alloc(ctx, out->face_count, sizeof *out->turns);
    if (!out->patches || !out->faces || !out->turns) {
        qm_patch_set_reset(ctx, out);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
    }
    size_t first = 0;
    for (size_t i = 0; i < mesh->grid_count; i++) {
        const qm_mesh_grid *grid = &mesh->grids[i];
        size_t count = (size_t)grid->rows * grid->columns;
        out->patches[i] = (qm_regular_patch){first, grid->rows, grid->columns};
        if (count > 1) out->quad_count += count;
        first += count;
    }
    for (size_t face = 0; face < mesh->face_count; face++)
        out->faces[face] = (uint32_t)face;
    memset(out->turns, 0, out->face_count * sizeof *out->turns);
    return QM_OK;
}
