/**
 * quads_triangles.c: the triangles of a surface, component by component.
 */
#include <string.h>

#include "core/union_find.h"
#include "quads/quads_internal.h"

/** The faces at each vertex: those of v are face[start[v]] ... face[start[v + 1] - 1]. */
typedef struct face_lists {
    uint32_t *start, *face;
} face_lists;

static int corner_count(const qm_mesh *mesh, size_t face)
{
    return mesh->faces[4 * face + 3] == QM_NO_INDEX ? 3 : 4;
}

static void list_faces(const qm_mesh *mesh, const face_lists *lists)
{
    memset(lists->start, 0, (mesh->vertex_count + 1) * sizeof *lists->start);
    for (size_t f = 0; f < mesh->face_count; f++)
        for (int k = 0; k < corner_count(mesh, f); k++)
            lists->start[mesh->faces[4 * f + (size_t)k]]++;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        lists->start[v + 1] += lists->start[v];
    for (size_t f = mesh->face_count; f-- > 0;)
        for (int k = 0; k < corner_count(mesh, f); k++)
            lists->face[--lists->start[mesh->faces[4 * f + (size_t)k]]] = (uint32_t)f;
}

/** True if another face has both vertices: a diagonal between them could be one edge too many. */
static bool is_shared(const qm_mesh *mesh, const face_lists *lists, uint32_t face, uint32_t a, uint32_t b)
{
    for (uint32_t i = lists->start[a]; i < lists->start[a + 1]; i++) {
        uint32_t other = lists->face[i];
        for (int k = 0; other != face && k < corner_count(mesh, other); k++)
            if (mesh->faces[4 * (size_t)other + (size_t)k] == b) return true;
    }
    return false;
}

static void cut_faces(const qm_mesh *mesh, const face_lists *lists, qm_quads_triangles *t)
{
    t->count = 0;
    for (uint32_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *c = mesh->faces + 4 * (size_t)f;
        if (c[3] == QM_NO_INDEX) {
            memcpy(t->corner[t->count++], c, 3 * sizeof *c);
            continue;
        }
        /* quads with two sides in common have a diagonal in common */
        uint32_t k = is_shared(mesh, lists, f, c[0], c[2]) && !is_shared(mesh, lists, f, c[1], c[3]);
        const uint32_t cut[2][3] = {{c[k], c[k + 1], c[k + 2]}, {c[k], c[k + 2], c[(k + 3) % 4]}};
        memcpy(t->corner[t->count++], cut[0], sizeof cut[0]);
        memcpy(t->corner[t->count++], cut[1], sizeof cut[1]);
    }
}

/** Numbers the components, connected by vertices, in the order of their first triangles, and sorts the triangles by them. */
static qm_status sort_components(qm_context *ctx, size_t vertex_count, qm_quads_triangles *t)
{
    uint32_t *parent = qm_context_alloc(ctx, vertex_count, sizeof *parent);
    uint32_t *number = qm_context_alloc(ctx, vertex_count, sizeof *number);
    uint32_t(*sorted)[3] = qm_context_alloc(ctx, t->count, sizeof *sorted);
    uint32_t *of = qm_context_alloc(ctx, t->count, sizeof *of);
    uint32_t *place = qm_context_alloc(ctx, t->count + 1, sizeof *place);
    bool has_memory = parent && number && sorted && of && place;
    if (has_memory) {
        for (uint32_t v = 0; v < vertex_count; v++)
            parent[v] = v, number[v] = QM_NO_INDEX;
        for (size_t i = 0; i < t->count; i++) {
            for (int k = 1; k < 3; k++)
                qm_union_find_join(parent, t->corner[i][0], t->corner[i][k]);
        }
        memset(place, 0, (t->count + 1) * sizeof *place);
        for (size_t i = 0; i < t->count; i++) {
            uint32_t root = qm_union_find_root(parent, t->corner[i][0]);
            if (number[root] == QM_NO_INDEX) number[root] = (uint32_t)t->component_count++;
            of[i] = number[root];
            place[of[i] + 1]++;
        }
        for (size_t k = 0; k < t->component_count; k++)
            place[k + 1] += place[k];
        for (size_t i = 0; i < t->count; i++) {
            uint32_t to = place[of[i]]++;
            memcpy(sorted[to], t->corner[i], sizeof *sorted);
            t->component[to] = of[i];
        }
        memcpy(t->corner, sorted, t->count * sizeof *sorted);
    }
    qm_context_free(ctx, parent, vertex_count, sizeof *parent);
    qm_context_free(ctx, number, vertex_count, sizeof *number);
    qm_context_free(ctx, sorted, t->count, sizeof *sorted);
    qm_context_free(ctx, of, t->count, sizeof *of);
    qm_context_free(ctx, place, t->count + 1, sizeof *place);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

qm_status qm_quads_list_triangles(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *t)
{
    size_t corners = 0;
    *t = (qm_quads_triangles){0};
    for (size_t f = 0; f < mesh->face_count; f++) {
        t->count += (size_t)corner_count(mesh, f) - 2;
        corners += (size_t)corner_count(mesh, f);
    }
    t->corner = qm_context_alloc(ctx, t->count, sizeof *t->corner);
    t->component = qm_context_alloc(ctx, t->count, sizeof *t->component);
    const face_lists lists = {qm_context_alloc(ctx, mesh->vertex_count + 1, sizeof *lists.start),
                              qm_context_alloc(ctx, corners, sizeof *lists.face)};
    bool has_memory = t->corner && t->component && lists.start && lists.face;
    if (has_memory) {
        list_faces(mesh, &lists);
        cut_faces(mesh, &lists, t);
    }
    qm_context_free(ctx, lists.start, mesh->vertex_count + 1, sizeof *lists.start);
    qm_context_free(ctx, lists.face, corners, sizeof *lists.face);
    qm_status status = has_memory ? qm_quads_close_seams(ctx, mesh, t) : QM_E_NO_MEMORY;
    return status == QM_OK ? sort_components(ctx, mesh->vertex_count, t) : status;
}

void qm_quads_triangles_reset(qm_context *ctx, qm_quads_triangles *t)
{
    qm_context_free(ctx, t->corner, t->count, sizeof *t->corner);
    qm_context_free(ctx, t->component, t->count, sizeof *t->component);
    *t = (qm_quads_triangles){0};
}
