/**
 * handle_tags.c: how the mesh in a path is found, and compared with the entity tags that the client has.
 */
#include "handlers.h"
#include "mesh/etag.h"

bool qm_find_mesh(qm_request *request, qm_store_mesh *out)
{
    const char *id = qm_request_id(request);
    qm_status status = qm_store_find_mesh(qm_request_app(request)->store, id, out);
    if (status == QM_OK) return true;
    qm_problem problem = qm_problem_from_store(status, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
    qm_reply_problem(request, &problem);
    return false;
}

/** The client has this very representation. */
static bool is_known(const qm_request *request, const char *tag)
{
    return qm_request_only_reads(request) &&
           qm_etag_is_listed(qm_request_header(request, "If-None-Match"), tag, true);
}

static bool check_tag(qm_request *request, const char *tag)
{
    const char *wanted = qm_request_header(request, "If-Match");
    if (wanted && !qm_etag_is_listed(wanted, tag, false)) {
        qm_problem problem =
            qm_problem_make(QM_PROBLEM_PRECONDITION_FAILED, "the mesh is not the one that If-Match names");
        qm_reply_problem(request, &problem);
        return false;
    }
    qm_reply_header(request, "ETag", "%s", tag);
    if (!is_known(request, tag)) return true;
    qm_reply_empty(request, 304);
    return false;
}

bool qm_check_mesh_tag(qm_request *request, const qm_store_mesh *mesh)
{
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(mesh->hash, mesh->revision, "", tag);
    return check_tag(request, tag);
}

qm_mesh_ref *qm_take_mesh(qm_request *request, const char *suffix)
{
    qm_meshes *meshes = qm_request_app(request)->meshes;
    qm_store_mesh row;
    qm_problem problem;
    qm_mesh_ref *mesh = NULL;
    char tag[QM_ETAG_SIZE];
    if (!qm_find_mesh(request, &row)) return NULL;
    qm_etag_write_mesh(row.hash, row.revision, suffix, tag);
    /* Who has the revision is told so without reading the mesh. It may move on after its row was read: the
     * tag to send is that of the one in hand. */
    bool known = is_known(request, tag);
    if (!known && (mesh = qm_meshes_acquire(meshes, qm_request_id(request), &problem)))
        qm_etag_write_mesh(row.hash, qm_mesh_ref_get(mesh)->revision, suffix, tag);
    qm_store_mesh_reset(&row);
    if (!known && !mesh) {
        qm_reply_problem(request, &problem);
        return NULL;
    }
    if (check_tag(request, tag)) return mesh;
    qm_meshes_release(meshes, mesh);
    return NULL;
}
