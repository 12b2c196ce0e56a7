/**
 * quads_polish.c: vertices of quads are centred among their neighbours and projected, those of features onto the features.
 */
#include "quads/quads_internal.h"

#include <string.h>

#include "mesh/quad_shape.h"
#include "qm/project.h"

#define ROUNDS 5 /* more would draw vertices off tips */

typedef struct polish {
    qm_context *ctx;
    qm_quads_result *r;
    const qm_bvh *surface, *features; /* features is NULL if there are none */
    uint32_t *start, *corner;         /* the corners (4 * face + k) at each vertex */
    uint8_t *kind;                    /* of each vertex, QM_TRIMESH_FREE ... */
    uint32_t (*line)[2];              /* of vertices on features: the two neighbours along them */
    double *target, *nearest;
    int thread_count;
} polish;

static qm_vec at(const polish *p, uint32_t vertex)
{
    return qm_vec_load(p->r->mesh.positions + 3 * (size_t)vertex);
}

static uint32_t corner_vertex(const polish *p, uint32_t face, uint32_t k)
{
    return p->r->mesh.faces[4 * (size_t)face + (k & 3)];
}

static void face_corners(const polish *p, uint32_t face, qm_vec out[4])
{
    for (uint32_t k = 0; k < 4; k++)
        out[k] = at(p, corner_vertex(p, face, k));
}

static void list_corners(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    memset(p->start, 0, (m->vertex_count + 1) * sizeof *p->start);
    for (size_t c = 0; c < 4 * m->face_count; c++)
        p->start[m->faces[c] + 1]++;
    for (size_t v = 0; v < m->vertex_count; v++)
        p->start[v + 1] += p->start[v];
    for (size_t c = 4 * m->face_count; c-- > 0;)
        p->corner[--p->start[m->faces[c] + 1]] = (uint32_t)c;
    /* start[v + 1] is now where v begins: shift back */
    for (size_t v = 0; v < m->vertex_count; v++)
        p->start[v] = p->start[v + 1];
    p->start[m->vertex_count] = (uint32_t)(4 * m->face_count);
}

static void add_line(polish *p, uint32_t vertex, uint32_t other)
{
    if (p->kind[vertex] > 0 && p->line[vertex][0] == other) return; /* the twin */
    if (p->kind[vertex] > 1 && p->line[vertex][1] == other) return;
    if (p->kind[vertex] < 2) p->line[vertex][p->kind[vertex]] = other;
    if (p->kind[vertex] < 3) p->kind[vertex]++;
}

static void find_kinds(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    memset(p->kind, 0, m->vertex_count);
    for (size_t c = 0; c < 4 * m->face_count; c++) {
        if (!p->r->is_feature[c]) continue;
        uint32_t a = m->faces[c], b = corner_vertex(p, (uint32_t)(c / 4), (uint32_t)(c % 4 + 1));
        add_line(p, a, b);
        add_line(p, b, a);
    }
    for (size_t v = 0; v < m->vertex_count; v++) {
        int count = p->kind[v];
        p->kind[v] = count == 0 ? QM_TRIMESH_FREE : count == 2 ? QM_TRIMESH_ON_LINE : QM_TRIMESH_CORNER;
        if (p->r->is_fixed[v]) p->kind[v] = QM_TRIMESH_CORNER;
    }
}

static qm_vec vertex_normal(const polish *p, uint32_t v)
{
    qm_vec sum = {0, 0, 0}, corner[4];
    for (uint32_t k = p->start[v]; k < p->start[v + 1]; k++) {
        face_corners(p, p->corner[k] / 4, corner);
        sum = qm_vec_add(sum, qm_quad_normal(corner));
    }
    double length = qm_vec_norm(sum);
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
}

/** Where a vertex would lie best: the mean of its neighbours, without the part along the normal. */
static qm_vec centred(const polish *p, uint32_t v)
{
    qm_vec here = at(p, v), sum = {0, 0, 0};
    if (p->kind[v] == QM_TRIMESH_CORNER || p->start[v] == p->start[v + 1]) return here;
    if (p->kind[v] == QM_TRIMESH_ON_LINE) return qm_vec_mix(at(p, p->line[v][0]), at(p, p->line[v][1]), 0.5);
    for (uint32_t k = p->start[v]; k < p->start[v + 1]; k++) {
        uint32_t c = p->corner[k];
        sum = qm_vec_add(sum, at(p, corner_vertex(p, c / 4, c + 1)));
    }
    qm_vec move = qm_vec_sub(qm_vec_scale(1.0 / (p->start[v + 1] - p->start[v]), sum), here);
    qm_vec normal = vertex_normal(p, v);
    return qm_vec_add(here, qm_vec_axpy(move, -qm_vec_dot(move, normal), normal));
}

/** Projects p->target onto the surface, and vertices on features onto these; writes the positions. */
static qm_status project_all(polish *p)
{
    qm_mesh *m = &p->r->mesh;
    const qm_projection out = {.position = p->nearest};
    qm_status status = qm_project_points(p->ctx, p->surface, QM_QUADS_TRIANGLES, p->target, m->vertex_count,
                                         p->thread_count, &out);
    if (status != QM_OK) return status;
    for (size_t v = 0; v < m->vertex_count; v++)
        if (p->kind[v] == QM_TRIMESH_FREE)
            memcpy(m->positions + 3 * v, p->nearest + 3 * v, 3 * sizeof(double));
    if (!p->features) return QM_OK;
    size_t count = 0;
    for (size_t v = 0; v < m->vertex_count; v++)
        if (p->kind[v] == QM_TRIMESH_ON_LINE)
            memmove(p->target + 3 * count++, p->target + 3 * v, 3 * sizeof(double));
    status =
        qm_project_points(p->ctx, p->features, QM_QUADS_TRIANGLES, p->target, count, p->thread_count, &out);
    count = 0;
    for (size_t v = 0; v < m->vertex_count && status == QM_OK; v++)
        if (p->kind[v] == QM_TRIMESH_ON_LINE)
            memcpy(m->positions + 3 * v, p->nearest + 3 * count++, 3 * sizeof(double));
    return status;
}

static qm_status centre_all(polish *p)
{
    for (uint32_t v = 0; v < p->r->mesh.vertex_count; v++)
        qm_vec_store(p->target + 3 * (size_t)v, centred(p, v));
    return project_all(p);
}

static qm_status run(polish *p)
{
    list_corners(p);
    find_kinds(p);
    qm_status status = QM_OK;
    for (int round = 0; round < ROUNDS && status == QM_OK; round++)
        status = centre_all(p);
    return status;
}

qm_status qm_quads_polish(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, int thread_count)
{
    size_t vertices = r->mesh.vertex_count, corners = 4 * r->mesh.face_count;
    qm_bvh *features = NULL;
    qm_status status = QM_OK;
    if (r->features.face_count > 0)
        status = qm_bvh_build(ctx, &r->features, QM_BVH_TARGET, thread_count, &features);
    polish p = {.ctx = ctx, .r = r, .surface = surface, .features = features, .thread_count = thread_count};
    p.start = qm_context_alloc(ctx, vertices + 1, sizeof *p.start);
    p.corner = qm_context_alloc(ctx, corners, sizeof *p.corner);
    p.kind = qm_context_alloc(ctx, vertices, 1);
    p.line = qm_context_alloc(ctx, vertices, sizeof *p.line);
    p.target = qm_context_alloc(ctx, vertices, 3 * sizeof *p.target);
    p.nearest = qm_context_alloc(ctx, vertices, 3 * sizeof *p.nearest);
    if (status == QM_OK && !(p.start && p.corner && p.kind && p.line && p.target && p.nearest))
        status = QM_E_NO_MEMORY;
    if (status == QM_OK) status = run(&p);
    qm_context_free(ctx, p.start, vertices + 1, sizeof *p.start);
    qm_context_free(ctx, p.corner, corners, sizeof *p.corner);
    qm_context_free(ctx, p.kind, vertices, 1);
    qm_context_free(ctx, p.line, vertices, sizeof *p.line);
    qm_context_free(ctx, p.target, vertices, 3 * sizeof *p.target);
    qm_context_free(ctx, p.nearest, vertices, 3 * sizeof *p.nearest);
    qm_bvh_destroy(ctx, features);
    return status;
}
