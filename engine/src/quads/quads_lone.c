/**
 * quads_lone.c: a vertex of the boundary that has room for two quads or more, but only one, gets a second. No place of it gives its quad a
 * shape: the corner is straight, or opens to the outside. No contraction and no turn of an edge helps without leaving another such
 * vertex. So two quads become six: one of the sides of its quad away from it gets two vertices, and the quad beyond two more
 * inside, so that nothing changes beyond.
 *
 *     l ---- n2 --- n1 ---- b                     q --------------- p
 *     |       \             |                     | \             / |
 *     |        \            |       and beyond    |  y1 ------- y2  |
 *     |         \           |                     |  |           |  |
 *     v ------------------- m                     l -n2 ------- n1- b
 */
#include <string.h>

#include "quads/quads_sides.h"

enum { MORE_FACES = 4, MORE_VERTICES = 4 };

/** The corners of both quads, l v m b and l b p q, and the sides between them; reversed where the quads lie the other way round. */
typedef struct lone {
    uint32_t face[2];
    uint32_t l, v, m, b, p, q;
    uint8_t lv, vm, mb, bp, pq, ql;
    bool is_reversed;
} lone;

static bool is_lone(const qm_quads_sides *t, uint32_t side)
{
    if (t->twin[side] != QM_NO_INDEX || t->twin[qm_quads_prev(side)] != QM_NO_INDEX) return false;
    int wanted = qm_quads_sector_at(t, side).wanted;
    return t->kind[qm_quads_from(t, side)] == QM_TRIMESH_ON_LINE ? wanted > 1 : wanted > 2;
}

static bool is_open(const qm_quads_sides *t, uint32_t side, const uint8_t *is_used)
{
    uint32_t other = t->twin[side];
    return other != QM_NO_INDEX && !t->r->is_feature[side] && !is_used[other / 4];
}

/** Finds the quads to be changed for the vertex of a side; false if none can be. */
static bool find_lone(const qm_quads_sides *t, uint32_t side, const uint8_t *is_used, lone *out)
{
    if (is_used[side / 4] || !is_lone(t, side)) return false;
    uint32_t s1 = qm_quads_next(side), s2 = qm_quads_next(s1), s3 = qm_quads_next(s2);
    const uint8_t *feature = t->r->is_feature;
    *out = (lone){.m = qm_quads_from(t, side), .l = qm_quads_from(t, s2)};
    uint32_t across;
    if (is_open(t, s1, is_used)) { /* from b to l */
        across = t->twin[s1];
        out->b = qm_quads_from(t, s1), out->v = qm_quads_from(t, s3);
        out->lv = feature[s2], out->vm = feature[s3], out->mb = feature[side];
    } else if (is_open(t, s2, is_used)) { /* from l to b */
        across = t->twin[s2];
        out->b = qm_quads_from(t, s3), out->v = qm_quads_from(t, s1);
        out->lv = feature[s1], out->vm = feature[side], out->mb = feature[s3];
        out->is_reversed = true;
    } else {
        return false;
    }
    uint32_t a1 = qm_quads_next(across), a2 = qm_quads_next(a1), a3 = qm_quads_next(a2);
    out->p = qm_quads_from(t, out->is_reversed ? a3 : a2),
    out->q = qm_quads_from(t, out->is_reversed ? a2 : a3);
    out->bp = feature[out->is_reversed ? a3 : a1], out->pq = feature[a2];
    out->ql = feature[out->is_reversed ? a1 : a3];
    out->face[0] = side / 4, out->face[1] = across / 4;
    return true;
}

static void write_quad(qm_quads_result *r, uint32_t face, const uint32_t corner[4], const uint8_t feature[4],
                       bool is_reversed)
{
    for (uint32_t k = 0; k < 4; k++) {
        r->mesh.faces[4 * face + k] = corner[is_reversed ? 3 - k : k];
        r->is_feature[4 * face + k] = feature[is_reversed ? (6 - k) % 4 : k];
    }
}

static void open_lone(qm_quads_result *r, const lone *o)
{
    qm_mesh *mesh = &r->mesh;
    uint32_t n1 = (uint32_t)mesh->vertex_count, n2 = n1 + 1, y1 = n1 + 2, y2 = n1 + 3,
             f = (uint32_t)mesh->face_count;
    qm_vec l = qm_vec_load(mesh->positions + 3 * (size_t)o->l),
           b = qm_vec_load(mesh->positions + 3 * (size_t)o->b),
           p = qm_vec_load(mesh->positions + 3 * (size_t)o->p),
           q = qm_vec_load(mesh->positions + 3 * (size_t)o->q);
    qm_vec on1 = qm_vec_mix(b, l, 1.0 / 3.0), on2 = qm_vec_mix(b, l, 2.0 / 3.0);
    qm_vec_store(mesh->positions + 3 * (size_t)n1, on1);
    qm_vec_store(mesh->positions + 3 * (size_t)n2, on2);
    qm_vec_store(mesh->positions + 3 * (size_t)y1, qm_vec_mix(on2, qm_vec_mix(p, q, 2.0 / 3.0), 0.5));
    qm_vec_store(mesh->positions + 3 * (size_t)y2, qm_vec_mix(on1, qm_vec_mix(p, q, 1.0 / 3.0), 0.5));
    memset(r->is_fixed + n1, 0, MORE_VERTICES);
    mesh->vertex_count += MORE_VERTICES, mesh->face_count += MORE_FACES;
    const uint32_t corner[6][4] = {{o->l, o->v, o->m, n2}, {n1, o->b, o->p, y2}, {o->m, o->b, n1, n2},
                                   {o->l, n2, y1, o->q},   {n2, n1, y2, y1},     {y1, y2, o->p, o->q}};
    const uint8_t feature[6][4] = {{o->lv, o->vm, 0, 0}, {0, o->bp, 0, 0}, {o->mb, 0, 0, 0},
                                   {0, 0, 0, o->ql},     {0, 0, 0, 0},     {0, 0, o->pq, 0}};
    for (uint32_t k = 0; k < 6; k++)
        write_quad(r, k < 2 ? o->face[k] : f + k - 2, corner[k], feature[k], o->is_reversed);
}

/** Gives a result room for so many more changes. */
static qm_status grow(qm_context *ctx, qm_quads_result *r, size_t count)
{
    qm_mesh old = r->mesh;
    size_t vertices = old.vertex_count + MORE_VERTICES * count, faces = old.face_count + MORE_FACES * count;
    double *positions = qm_context_alloc(ctx, vertices, 3 * sizeof *positions);
    uint32_t *corners = qm_context_alloc(ctx, faces, 4 * sizeof *corners);
    uint8_t *fixed = qm_context_alloc(ctx, vertices, 1), *features = qm_context_alloc(ctx, faces, 4);
    if (!(positions && corners && fixed && features)) {
        qm_context_free(ctx, positions, vertices, 3 * sizeof *positions);
        qm_context_free(ctx, corners, faces, 4 * sizeof *corners);
        qm_context_free(ctx, fixed, vertices, 1);
        qm_context_free(ctx, features, faces, 4);
        return QM_E_NO_MEMORY;
    }
    memcpy(positions, old.positions, 3 * old.vertex_count * sizeof *positions);
    memcpy(corners, old.faces, 4 * old.face_count * sizeof *corners);
    memcpy(fixed, r->is_fixed, old.vertex_count);
    memcpy(features, r->is_feature, 4 * old.face_count);
    qm_context_free(ctx, r->is_fixed, old.vertex_count, 1);
    qm_context_free(ctx, r->is_feature, old.face_count, 4);
    qm_mesh_reset(ctx, &r->mesh);
    /* the counts grow with the changes that are written */
    r->mesh = (qm_mesh){.positions = positions,
                        .faces = corners,
                        .vertex_count = old.vertex_count,
                        .face_count = old.face_count};
    r->is_fixed = fixed, r->is_feature = features;
    return QM_OK;
}

static size_t list_lone(const qm_quads_sides *t, uint8_t *is_used, lone *list)
{
    size_t count = 0;
    memset(is_used, 0, t->face_count);
    for (uint32_t side = 0; side < 4 * t->face_count; side++) {
        lone found;
        if (!find_lone(t, side, is_used, &found)) continue;
        is_used[found.face[0]] = is_used[found.face[1]] = true;
        if (list) list[count] = found;
        count++;
    }
    return count;
}

qm_status qm_quads_open_lone(qm_context *ctx, qm_quads_result *r, size_t *opened)
{
    qm_quads_sides t;
    qm_status status = qm_quads_sides_build(ctx, r, &t);
    size_t faces = r->mesh.face_count, count = 0;
    uint8_t *is_used = qm_context_alloc(ctx, faces, 1);
    lone *list = NULL;
    if (status == QM_OK && !is_used) status = QM_E_NO_MEMORY;
    if (status == QM_OK) count = list_lone(&t, is_used, NULL);
    if (count > 0) {
        list = qm_context_alloc(ctx, count, sizeof *list);
        status = list ? QM_OK : QM_E_NO_MEMORY;
        if (list) list_lone(&t, is_used, list);
    }
    if (count > 0 && status == QM_OK) status = grow(ctx, r, count);
    for (size_t i = 0; i < count && status == QM_OK; i++)
        open_lone(r, &list[i]);
    *opened = count;
    qm_context_free(ctx, list, count, sizeof *list);
    qm_context_free(ctx, is_used, faces, 1);
    qm_quads_sides_reset(&t);
    return status;
}
