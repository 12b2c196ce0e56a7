/**
 * quads_features.c: creases and corners of a triangle mesh.
 */
#include "quads/quads_internal.h"

#include <string.h>

#include "core/union_find.h"

#define SHORTEST 3.0    /* of connected creases, in sides of a quad */
#define FINE_RADIUS 0.7 /* of the faces whose normals tell of a crease, in sides of a quad */
#define FINE_ROUNDS 3   /* a crease that goes opens the sides of the next one */
#define SHARP_BEND 0.5  /* cosine of the bend of a feature at which its vertex is a corner: 60 degrees */

static void mark(qm_trimesh *m, uint32_t h, uint8_t value)
{
    m->is_feature[h] = value;
    if (m->twin[h] != QM_NO_INDEX) m->is_feature[m->twin[h]] = value;
}

static void mark_creases(qm_trimesh *m, double angle)
{
    double cosine = cos(angle * QM_DEGREE);
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX || t < h) continue;
        qm_vec a = qm_trimesh_normal(m, h / 3), b = qm_trimesh_normal(m, t / 3);
        double scale = qm_vec_norm(a) * qm_vec_norm(b);
        if (scale > 0.0 && qm_vec_dot(a, b) < cosine * scale) mark(m, h, true);
    }
}

/** The faces on one side of a crease, near one of its edges. */
typedef struct crease_side {
    qm_vec normal; /* sum */
    bool meets;    /* it has met the other side: the crease ends nearby */
} crease_side;

/** Gathers faces from start on, without crossing features; seen has the mark of each face that was gathered before. */
static crease_side gather_side(const qm_trimesh *m, uint32_t start, uint32_t other, qm_vec centre,
                               double radius, uint32_t *seen, uint32_t mark_value, uint32_t *queue)
{
    crease_side side = {{0, 0, 0}, false};
    size_t head = 0, tail = 0;
    queue[tail++] = start;
    seen[start] = mark_value;
    while (head < tail) {
        uint32_t f = queue[head++];
        if (f == other) side.meets = true;
        side.normal = qm_vec_add(side.normal, qm_trimesh_normal(m, f));
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            if (m->is_feature[h]) continue;
            uint32_t g = m->twin[h] / 3;
            if (seen[g] == mark_value) continue;
            seen[g] = mark_value;
            const uint32_t *c = m->from + 3 * (size_t)g;
            const qm_vec corner[3] = {m->position[c[0]], m->position[c[1]], m->position[c[2]]};
            if (qm_vec_distance(qm_vec_centroid(corner, 3), centre) <= radius) queue[tail++] = g;
        }
    }
    return side;
}

/**
 * Unmarks creases that are none at the size of a quad: within the radius their sides meet, or have normals that differ by
 * less than the angle.
 */
static qm_status drop_fine(qm_context *ctx, qm_trimesh *m, double angle, double radius)
{
    size_t faces = m->face_count, halves = 3 * faces;
    uint32_t *seen = qm_context_alloc(ctx, faces, sizeof *seen),
             *queue = qm_context_alloc(ctx, faces, sizeof *queue);
    uint8_t *is_kept = qm_context_alloc(ctx, halves, 1);
    bool has_memory = seen && queue && is_kept;
    double cosine = cos(angle * QM_DEGREE);
    if (has_memory) {
        uint32_t mark_value = 0;
        memset(seen, 0, faces * sizeof *seen);
        memcpy(is_kept, m->is_feature, halves);
        for (uint32_t h = 0; h < halves; h++) {
            uint32_t t = m->twin[h];
            if (!m->is_feature[h] || t == QM_NO_INDEX || t < h) continue;
            qm_vec middle = qm_vec_mix(m->position[m->from[h]], m->position[m->from[t]], 0.5);
            crease_side a = gather_side(m, h / 3, t / 3, middle, radius, seen, ++mark_value, queue);
            crease_side b = gather_side(m, t / 3, h / 3, middle, radius, seen, ++mark_value, queue);
            double scale = qm_vec_norm(a.normal) * qm_vec_norm(b.normal);
            bool is_sharp = !a.meets && qm_vec_dot(a.normal, b.normal) < cosine * scale;
            is_kept[h] = is_kept[t] = is_sharp;
        }
        memcpy(m->is_feature, is_kept, halves);
    }
    qm_context_free(ctx, seen, faces, sizeof *seen);
    qm_context_free(ctx, queue, faces, sizeof *queue);
    qm_context_free(ctx, is_kept, halves, 1);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

/** Unmarks creases of connected ones whose lengths sum up to less than shortest. */
static qm_status drop_short(qm_context *ctx, qm_trimesh *m, double shortest)
{
    size_t count = m->vertex_count;
    uint32_t *parent = qm_context_alloc(ctx, count, sizeof *parent);
    double *length = qm_context_alloc(ctx, count, sizeof *length);
    bool has_memory = parent && length;
    if (has_memory) {
        for (uint32_t v = 0; v < count; v++)
            parent[v] = v, length[v] = 0.0;
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (m->is_feature[h]) qm_union_find_join(parent, m->from[h], qm_trimesh_to(m, h));
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (m->is_feature[h] && m->twin[h] != QM_NO_INDEX && m->twin[h] > h)
                length[qm_union_find_root(parent, m->from[h])] += qm_vec_norm(qm_trimesh_edge(m, h));
            else if (m->twin[h] == QM_NO_INDEX)
                length[qm_union_find_root(parent, m->from[h])] = INFINITY;
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (m->is_feature[h] && length[qm_union_find_root(parent, m->from[h])] < shortest)
                mark(m, h, false);
    }
    qm_context_free(ctx, parent, count, sizeof *parent);
    qm_context_free(ctx, length, count, sizeof *length);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

static void fix_corners(qm_trimesh *m)
{
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t line[2];
        m->is_fixed[v] = false;
        int kind = qm_trimesh_kind(m, v, line);
        if (kind == QM_TRIMESH_CORNER) m->is_fixed[v] = true;
        if (kind != QM_TRIMESH_ON_LINE) continue;
        qm_vec a = qm_vec_sub(m->position[v], m->position[line[0]]);
        qm_vec b = qm_vec_sub(m->position[line[1]], m->position[v]);
        m->is_fixed[v] = qm_vec_dot(a, b) < SHARP_BEND * qm_vec_norm(a) * qm_vec_norm(b);
    }
}

qm_status qm_quads_find_features(qm_context *ctx, qm_trimesh *m, double crease_angle, double size)
{
    qm_status status = QM_OK;
    if (crease_angle > 0.0) {
        mark_creases(m, crease_angle);
        for (int round = 0; round < FINE_ROUNDS && status == QM_OK; round++)
            status = drop_fine(ctx, m, crease_angle, FINE_RADIUS * size);
    }
    if (status == QM_OK) status = drop_short(ctx, m, SHORTEST * size);
    if (status == QM_OK) fix_corners(m);
    return status;
}

/** A face with several features is cut from the middle of the edge, or of the first edge, that is none. */
qm_status qm_quads_separate_features(qm_context *ctx, qm_trimesh *m)
{
    qm_status status = QM_OK;
    size_t count = m->face_count;
    for (uint32_t f = 0; f < count && status == QM_OK; f++) {
        uint32_t features = 0, opposite = 3 * f, vertex;
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            features += m->is_feature[h];
            if (!m->is_feature[h]) opposite = h;
        }
        if (features == 2) {
            qm_vec middle =
                qm_vec_mix(m->position[m->from[opposite]], m->position[qm_trimesh_to(m, opposite)], 0.5);
            status = qm_trimesh_split(ctx, m, opposite, middle, &vertex);
        } else if (features == 3) {
            /* a vertex inside: split an edge would put it on a feature, and two of the faces would still have two */
            status = qm_trimesh_split_face(ctx, m, f, &vertex);
        }
    }
    return status;
}
