/**
 * patches_out.c: the faces of regular patches as JSON and CSV.
 */
#include "patches_out.h"

#include "base/json.h"

static uint32_t face_at(const qm_loaded_mesh *mesh, const qm_regular_patch *patch, size_t index)
{
    return qm_mesh_input_face(&mesh->mesh, mesh->patches.faces[patch->first + index]);
}

static void write_patch(qm_text *out, const qm_loaded_mesh *mesh, const qm_regular_patch *patch)
{
    qm_text_printf(out, "{\"rows\":%u,\"columns\":%u,\"faces\":[", patch->rows, patch->columns);
    size_t count = (size_t)patch->rows * patch->columns;
    for (size_t k = 0; k < count; k++)
        qm_text_printf(out, k > 0 ? ",%u" : "%u", face_at(mesh, patch, k));
    qm_text_add_string(out, "]}");
}

void qm_patches_write_json(qm_text *out, const qm_loaded_mesh *mesh)
{
    const qm_patch_set *set = &mesh->patches;
    qm_text_printf(out, "{\"patch_count\":%zu,\"irregular_vertices\":%zu,\"patches\":[", set->patch_count,
                   mesh->facts.irregular_vertices);
    for (size_t i = 0; i < set->patch_count; i++) {
        if (i > 0) qm_text_add_string(out, ",");
        write_patch(out, mesh, &set->patches[i]);
    }
    qm_text_add_string(out, "]}");
}

void qm_patches_write_csv(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_text_add_string(out, "face,patch,row,column\n");
    for (size_t i = 0; i < mesh->patches.patch_count; i++) {
        const qm_regular_patch *patch = &mesh->patches.patches[i];
        size_t count = (size_t)patch->rows * patch->columns;
        for (size_t k = 0; k < count; k++)
            qm_text_printf(out, "%u,%zu,%zu,%zu\n", face_at(mesh, patch, k), i, k / patch->columns,
                           k % patch->columns);
    }
}
