/**
 * quads_tips.c: tips of horns: vertices from which the surface leads away in a narrow cone, at the size of a quad. Centred among its
 * neighbours such a vertex would slide down the horn while triangles are remeshed, and the end would be lost.
 */
#include "quads/quads_internal.h"

/* Lengths in sides of a quad. */
#define NEAR 1.0        /* how round an end may be */
#define BENT_FROM 0.25  /* from here on a surface that goes on along the tangent plane is no end */
#define LEAST_BEND 0.2  /* sine of the angle between that plane and the way to a vertex of an end */
#define FAR 3.0         /* how long a horn is at least */
#define MOST_ANGLE 30.0 /* degrees from the axis: quads come near enough to the end of a wider cone */
#define MOST_LIST 4096  /* vertices of an end */
#define VERTICES_A_POLL 1024

/** Vertices of an end, from its tip on. */
typedef struct end {
    uint32_t vertex[MOST_LIST];
    size_t count;
    qm_vec ways; /* sum of the directions to those that are not near */
} end;

/** True if the surface goes on along the tangent plane of a vertex, on the way along edges that lead away from it: what
 * gather_end would find as well, but only after all vertices that are nearer. */
static bool goes_on(const qm_trimesh *m, uint32_t vertex, double size)
{
    qm_vec origin = m->position[vertex], normal = qm_trimesh_vertex_normal(m, vertex);
    uint32_t at = vertex;
    for (double reached = 0.0; reached <= BENT_FROM * size;) {
        uint32_t first = qm_trimesh_first(m, at), h = first, farthest = at;
        do {
            uint32_t v = qm_trimesh_to(m, h);
            double distance = qm_vec_distance(m->position[v], origin);
            if (distance > reached) reached = distance, farthest = v;
            h = qm_trimesh_around(m, h);
        } while (h != QM_NO_INDEX && h != first);
        if (farthest == at) return false;
        at = farthest;
    }
    qm_vec d = qm_vec_sub(m->position[at], origin);
    return !(-qm_vec_dot(d, normal) > LEAST_BEND * qm_vec_norm(d));
}

/** Lists the vertices within reach; false: they lead away in more than one direction, to a boundary or to features. */
static bool gather_end(qm_trimesh *m, uint32_t tip, double size, end *e)
{
    const double spread = cos(2.0 * MOST_ANGLE * QM_DEGREE);
    qm_vec origin = m->position[tip], normal = qm_trimesh_vertex_normal(m, tip), way = {0, 0, 0};
    e->vertex[0] = tip, e->count = 1, e->ways = (qm_vec){0, 0, 0};
    m->stamp_value++;
    m->stamp[tip] = m->stamp_value;
    for (size_t i = 0; i < e->count; i++) {
        if (qm_vec_distance(m->position[e->vertex[i]], origin) > FAR * size) continue;
        uint32_t first = qm_trimesh_first(m, e->vertex[i]), h = first;
        do {
            uint32_t v = qm_trimesh_to(m, h);
            if (m->is_feature[h] || m->twin[h] == QM_NO_INDEX) return false;
            if (m->stamp[v] != m->stamp_value) {
                qm_vec d = qm_vec_sub(m->position[v], origin);
                double length = qm_vec_norm(d);
                if (e->count == MOST_LIST || m->is_fixed[v]) return false;
                double sine = -qm_vec_dot(d, normal) / length;
                if (length > BENT_FROM * size && !(sine > LEAST_BEND)) return false;
                m->stamp[v] = m->stamp_value;
                e->vertex[e->count++] = v;
                if (length > NEAR * size) {
                    d = qm_vec_scale(1.0 / length, d);
                    if (!(qm_vec_norm2(way) > 0.0)) way = d;
                    if (qm_vec_dot(d, way) < spread) return false;
                    e->ways = qm_vec_add(e->ways, d);
                }
            }
            h = qm_trimesh_around(m, h);
        } while (h != QM_NO_INDEX && h != first);
    }
    return true;
}

/** True if all of an end lies in a cone from its tip, and none of it behind the tip. */
static bool is_tip(const qm_trimesh *m, const end *e, double size)
{
    const double narrow = cos(MOST_ANGLE * QM_DEGREE);
    qm_vec origin = m->position[e->vertex[0]], axis = qm_vec_unit(e->ways);
    for (size_t i = 1; i < e->count; i++) {
        qm_vec d = qm_vec_sub(m->position[e->vertex[i]], origin);
        double length = qm_vec_norm(d), along = qm_vec_dot(d, axis);
        if (along < 0.0 || (length > NEAR * size && along < narrow * length)) return false;
    }
    return qm_vec_norm2(e->ways) > 0.0;
}

qm_status qm_quads_hold_tips(qm_context *ctx, qm_trimesh *m, double size)
{
    end *e = qm_context_alloc(ctx, 1, sizeof *e);
    qm_status status = e ? QM_OK : QM_E_NO_MEMORY;
    for (uint32_t v = 0; v < m->vertex_count && status == QM_OK; v++) {
        if (v % VERTICES_A_POLL == VERTICES_A_POLL - 1 && qm_context_canceled(ctx)) status = QM_E_CANCELED;
        if (status != QM_OK || m->out[v] == QM_NO_INDEX || m->is_fixed[v]) continue;
        m->is_fixed[v] = !goes_on(m, v, size) && gather_end(m, v, size, e) && is_tip(m, e, size);
    }
    qm_context_free(ctx, e, 1, sizeof *e);
    return status;
}

void qm_quads_release_tips(qm_trimesh *m)
{
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t line[2];
        if (!m->is_fixed[v]) continue;
        m->is_fixed[v] = false;
        m->is_fixed[v] = qm_trimesh_kind(m, v, line) != QM_TRIMESH_FREE;
    }
}
