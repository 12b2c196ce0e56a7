#include "handlers.h"
#include "ops/patches_out.h"

static char *write_patches(const qm_loaded_mesh *mesh)
{
    qm_text out = {0};
    qm_patches_write_json(&out, mesh);
    return qm_text_take(&out);
}

void qm_handle_mesh_patches(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_mesh_ref *mesh = qm_take_mesh(request, "-patches");
    if (!mesh) return;
    char *document = write_patches(qm_mesh_ref_get(mesh));
    qm_meshes_release(app->meshes, mesh);
    qm_reply_text(request, 200, "application/json", document);
}
