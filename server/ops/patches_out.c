#include "patches_out.h"

#include "base/json_write.h"

static uint32_t face_at(const qm_loaded_mesh *mesh, const qm_regular_patch *patch, size_t cell)
{
    return qm_mesh_input_face(&mesh->mesh, mesh->patches.faces[patch->first + cell]);
}

static void write_patch(qm_text *out, const qm_loaded_mesh *mesh, const qm_regular_patch *patch)
{
    qm_text_printf(out, "{\"rows\":%u,\"columns\":%u,\"faces\":[", patch->rows, patch->columns);
    size_t count = (size_t)patch->rows * patch->columns;
    for (size_t cell = 0; cell < count; cell++)
        qm_text_printf(out, cell > 0 ? ",%u" : "%u", face_at(mesh, patch, cell));
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
        for (size_t cell = 0; cell < count; cell++)
            qm_text_printf(out, "%u,%zu,%zu,%zu\n", face_at(mesh, patch, cell), i, cell / patch->columns,
                           cell % patch->columns);
    }
}
