/**
 * handle_vertices.c: GET /v1/meshes/{id}/vertices: where the vertices are, in the order that results and
 * PATCH count them in, a block at a time.
 */
#include <stdlib.h>
#include <string.h>

#include "handlers.h"

#define BLOCK 8192 /* vertices */

typedef struct sending {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_rows rows;
    size_t done; /* vertices */
} sending;

static void end_sending(void *user)
{
    sending *s = user;
    qm_meshes_release(s->meshes, s->mesh);
    free(s);
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    (void)problem; /* the only one there may be is that out has no memory, which it tells itself */
    static const char *const starts[] = {"", "x,y,z\n", "{\"positions\":["};
    sending *s = user;
    const qm_mesh *mesh = &qm_mesh_ref_get(s->mesh)->mesh;
    double numbers[3 * BLOCK];
    size_t rest = mesh->vertex_count - s->done, count = rest < BLOCK ? rest : BLOCK;
    if (s->done == 0) qm_text_add_string(out, starts[s->rows]);
    memcpy(numbers, mesh->positions + 3 * s->done, 3 * count * sizeof *numbers);
    qm_rows_write(out, s->rows, 3, s->done, numbers, 3 * count);
    s->done += count;
    if (s->done < mesh->vertex_count) return QM_BLOCK_MORE;
    if (s->rows == QM_ROWS_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

void qm_handle_mesh_vertices(qm_request *request)
{
    static const char *const suffixes[] = {"-vertices-f64", "-vertices-csv", "-vertices-json"};
    qm_meshes *meshes = qm_request_app(request)->meshes;
    qm_rows rows = qm_request_rows(request);
    qm_mesh_ref *mesh = qm_take_mesh(request, suffixes[rows]);
    if (!mesh) return;
    sending *s = malloc(sizeof *s);
    if (!s) {
        qm_meshes_release(meshes, mesh);
        qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reply");
        qm_reply_problem(request, &problem);
        return;
    }
    *s = (sending){.meshes = meshes, .mesh = mesh, .rows = rows};
    size_t count = qm_mesh_ref_get(mesh)->mesh.vertex_count;
    uint64_t size = rows == QM_ROWS_BINARY ? 3 * sizeof(double) * count : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_block, end_sending, s});
}
