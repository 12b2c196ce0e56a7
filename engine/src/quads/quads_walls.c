/**
 * quads_walls.c: the nearest point of a wall that looks the same way.
 *
 * A vertex that is centred among its neighbours leaves a bent surface by about an eighth of a quad's side squared times the curvature. Where
 * the surface is thinner than that, the other wall is nearer then, and so is the crease on the other side of its rim. Both are told by
 * their normals: where the nearest point looks the other way, the vertex is pushed along its own normal, less far first, and outward
 * before inward, until the nearest point is one of its own wall. Vertices without a normal, which those at tips are given, lie on any.
 */
#include <string.h>

#include "mesh/quad_shape.h"
#include "qm/project.h"
#include "quads/quads_internal.h"

/* Cosine between the normals of a vertex and of what it is projected onto, below which that is another wall, or the crease on
 * the other side of a rim: there it is 0 to -1 where both creases are square, and 0.7 to 1 at the vertex's own. */
#define OTHER_WALL (-0.3)
#define OTHER_CREASE 0.35
#define PUSHES 8 /* by an eighth of the reach, a quarter, half of it, and all, both ways */

static qm_vec corner_at(const qm_mesh *m, uint32_t vertex)
{
    return qm_vec_load(m->positions + 3 * (size_t)vertex);
}

/** The normal of a face of the target; 0 where it has none. */
static qm_vec face_normal(const qm_quads_target *on, uint32_t face)
{
    if (on->normal) return on->normal[face];
    const qm_mesh *m = qm_bvh_mesh(on->bvh);
    const uint32_t *c = m->faces + 4 * (size_t)face;
    const qm_vec corner[4] = {corner_at(m, c[0]), corner_at(m, c[1]), corner_at(m, c[2]),
                              corner_at(m, c[3] == QM_NO_INDEX ? c[0] : c[3])};
    if (c[3] != QM_NO_INDEX) return qm_quad_normal(corner);
    return qm_vec_cross(qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]));
}

static bool is_opposed(const qm_quads_target *on, uint32_t face, qm_vec normal)
{
    qm_vec other = face_normal(on, face);
    double least = on->normal ? OTHER_CREASE : OTHER_WALL;
    return qm_vec_dot(normal, other) < least * qm_vec_norm(normal) * qm_vec_norm(other);
}

/** The rows whose nearest point is on another wall, and where they are pushed to. */
typedef struct strays {
    uint32_t *row, *face;
    double *from, *to; /* three numbers for each row */
} strays;

static qm_status bring_back(qm_context *ctx, const qm_quads_target *on, const double *points,
                            const qm_vec *normal, double reach, size_t count, int thread_count, strays *s,
                            double *nearest)
{
    const qm_projection out = {.position = s->to, .face = s->face};
    qm_status status = QM_OK;
    for (int push = 0; push < PUSHES && count > 0 && status == QM_OK; push++) {
        double way = (push % 2 == 0 ? reach : -reach) / (1 << (PUSHES - 1 - push) / 2);
        for (size_t k = 0; k < count; k++) {
            qm_vec at = qm_vec_load(points + 3 * (size_t)s->row[k]);
            qm_vec_store(s->from + 3 * k, qm_vec_axpy(at, way, normal[s->row[k]]));
        }
        status = qm_project_points(ctx, on->bvh, QM_QUADS_TRIANGLES, s->from, count, thread_count, &out);
        size_t left = 0;
        for (size_t k = 0; k < count && status == QM_OK; k++) {
            uint32_t row = s->row[k];
            /* its own wall is no farther than it was pushed */
            double off = qm_vec_distance(qm_vec_load(points + 3 * (size_t)row), qm_vec_load(s->to + 3 * k));
            if (is_opposed(on, s->face[k], normal[row]) || off > fabs(way))
                s->row[left++] = row;
            else
                memcpy(nearest + 3 * (size_t)row, s->to + 3 * k, 3 * sizeof *nearest);
        }
        count = left;
    }
    return status;
}

qm_status qm_quads_project(qm_context *ctx, const qm_quads_target *on, const double *points,
                           const qm_vec *normal, double reach, size_t count, int thread_count,
                           double *nearest)
{
    uint32_t *face = qm_context_alloc(ctx, count, sizeof *face);
    if (count > 0 && !face) return QM_E_NO_MEMORY;
    const qm_projection out = {.position = nearest, .face = face};
    qm_status status = qm_project_points(ctx, on->bvh, QM_QUADS_TRIANGLES, points, count, thread_count, &out);
    size_t stray = 0;
    for (size_t i = 0; i < count && status == QM_OK; i++)
        if (is_opposed(on, face[i], normal[i])) face[stray++] = (uint32_t)i;
    if (stray > 0) {
        strays s = {face, qm_context_alloc(ctx, stray, sizeof *s.face),
                    qm_context_alloc(ctx, stray, 3 * sizeof *s.from),
                    qm_context_alloc(ctx, stray, 3 * sizeof *s.to)};
        status = s.face && s.from && s.to ? QM_OK : QM_E_NO_MEMORY;
        if (status == QM_OK)
            status = bring_back(ctx, on, points, normal, reach, stray, thread_count, &s, nearest);
        qm_context_free(ctx, s.face, stray, sizeof *s.face);
        qm_context_free(ctx, s.from, stray, 3 * sizeof *s.from);
        qm_context_free(ctx, s.to, stray, 3 * sizeof *s.to);
    }
    qm_context_free(ctx, face, count, sizeof *face);
    return status;
}
