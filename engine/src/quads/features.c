/**
 * features.c: creases and boundaries of any mesh, as it is: not oriented, in loose faces, or with edges of three faces.
 */
#include "qm/features.h"

#include <stdlib.h>
#include <string.h>

#include "core/union_find.h"
#include "quads/quads_internal.h"

#define SHORTEST_SIDES 3.0 /* the sides of a quad in the length below which quads_features.c drops features */

#define ENDS 4.0 /* times the shortest length that creases with an end have */

#define ZIGZAG 0.5      /* times the shortest length, for each zigzag */
#define ZIGZAG_SINE 0.5 /* of both turns of one */

enum {
    POINT_SIZE = 3 * sizeof(double),
    BOUNDARY = 1 << 16, /* counts the edges of boundaries at a vertex beside its creases, which are fewer */
};

typedef struct placed {
    double at[3];
    uint32_t index;
} placed;

static int compare_positions(const double *a, const double *b)
{
    for (int k = 0; k < 3; k++)
        if (a[k] != b[k]) return a[k] < b[k] ? -1 : 1;
    return 0;
}

static int compare_placed(const void *a, const void *b)
{
    const placed *x = a, *y = b;
    int order = compare_positions(x->at, y->at);
    return order != 0 ? order : (x->index > y->index) - (x->index < y->index);
}

/** Gives each position the lowest index of those equal to it. */
static qm_status weld(qm_context *ctx, const double *positions, size_t count, uint32_t *out)
{
    if (count == 0) return QM_OK;
    placed *rows = qm_context_alloc(ctx, count, sizeof *rows);
    if (!rows) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < count; i++) {
        memcpy(rows[i].at, positions + 3 * i, POINT_SIZE);
        rows[i].index = (uint32_t)i;
    }
    qsort(rows, count, sizeof *rows, compare_placed);
    for (size_t i = 0, first = 0; i < count; i++) {
        if (compare_positions(rows[i].at, rows[first].at) != 0) first = i;
        out[rows[i].index] = rows[first].index;
    }
    qm_context_free(ctx, rows, count, sizeof *rows);
    return QM_OK;
}

/** True if a face, or an edge, reaches into a box; without a box always. */
static bool is_in_box(const double *box, const double *positions, const uint32_t *corner, int count)
{
    for (int k = 0; k < 3 && box; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < count; i++) {
            double x = positions[3 * (size_t)corner[i] + (size_t)k];
            low = fmin(low, x);
            high = fmax(high, x);
        }
        if (high < box[k] || low > box[3 + k]) return false;
    }
    return true;
}

/** The faces that reach into the box, with one vertex for each position. Positions are those of the mesh itself. */
static qm_status weld_faces(qm_context *ctx, const qm_mesh *mesh, const double *box, qm_mesh *out)
{
    size_t count = mesh->vertex_count;
    *out = (qm_mesh){.positions = mesh->positions, .vertex_count = count};
    uint32_t *same = qm_context_alloc(ctx, count, sizeof *same);
    out->faces = qm_context_alloc(ctx, mesh->face_count, 4 * sizeof *out->faces);
    qm_status status = same && out->faces ? weld(ctx, mesh->positions, count, same) : QM_E_NO_MEMORY;
    for (size_t f = 0; f < mesh->face_count && status == QM_OK; f++) {
        const uint32_t *from = mesh->faces + 4 * f;
        int corners = from[3] == QM_NO_INDEX ? 3 : 4;
        if (!is_in_box(box, mesh->positions, from, corners)) continue;
        uint32_t *to = out->faces + 4 * out->face_count++;
        for (int k = 0; k < 4; k++)
            to[k] = k < corners ? same[from[k]] : QM_NO_INDEX;
    }
    qm_context_free(ctx, same, count, sizeof *same);
    return status;
}

/** An edge of a feature, by indices of positions, the lower one first. */
typedef struct feature_edge {
    uint32_t end[2];
    uint32_t boundaries; /* how many half-edges without a twin run along it; 0 of a crease */
    qm_vec normal;       /* of the face of the half-edge */
    qm_vec other_normal; /* of a crease: that of the face beyond it */
    bool is_forward;     /* the half-edge runs from the lower index on */
    bool is_kept;
} feature_edge;

static int compare_edges(const void *a, const void *b)
{
    const feature_edge *x = a, *y = b;
    for (int k = 0; k < 2; k++)
        if (x->end[k] != y->end[k]) return x->end[k] < y->end[k] ? -1 : 1;
    return 0;
}

/** True if two faces whose common edge runs the same way in both are oriented alike after one is turned, and meet smoothly. */
static bool is_smooth(const feature_edge *a, const feature_edge *b, double cosine)
{
    double dot = qm_vec_dot(a->normal, b->normal) * (a->is_forward == b->is_forward ? -1.0 : 1.0);
    return dot >= cosine * qm_vec_norm(a->normal) * qm_vec_norm(b->normal);
}

/** Sorts edges and keeps one of each; of two faces that only orientation has parted, only where they make a crease. */
static size_t merge_edges(feature_edge *edge, size_t count, double cosine)
{
    size_t kept = 0;
    if (count > 0) qsort(edge, count, sizeof *edge, compare_edges);
    for (size_t first = 0, last; first < count; first = last) {
        for (last = first + 1; last < count && compare_edges(&edge[first], &edge[last]) == 0;)
            last++;
        bool are_two = last - first == 2 && edge[first].boundaries > 0 && edge[first + 1].boundaries > 0;
        if (are_two && is_smooth(&edge[first], &edge[first + 1], cosine)) continue;
        edge[kept++] = edge[first];
    }
    return kept;
}

/** Lists the features of a mesh that lie in the box. same receives, for each vertex of the mesh, the first at its position. */
static size_t list_edges(const qm_trimesh *m, const double *box, const double *positions,
                         const uint32_t *same, feature_edge *out)
{
    size_t count = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t twin = m->twin[h];
        if (!m->is_feature[h] || (twin != QM_NO_INDEX && twin < h)) continue;
        uint32_t from = same[m->from[h]], to = same[qm_trimesh_to(m, h)];
        const uint32_t ends[2] = {from, to};
        if (from == to || !is_in_box(box, positions, ends, 2)) continue;
        out[count++] = (feature_edge){.end = {from < to ? from : to, from < to ? to : from},
                                      .boundaries = twin == QM_NO_INDEX,
                                      .normal = qm_trimesh_normal(m, h / 3),
                                      .other_normal = twin == QM_NO_INDEX ? (qm_vec){0, 0, 0}
                                                                          : qm_trimesh_normal(m, twin / 3),
                                      .is_forward = from < to};
    }
    return count;
}

/** The turn of a line from one edge to the next at a vertex, as a vector whose length is the sine of its angle. */
static qm_vec turn_at(const double *positions, const feature_edge *before, uint32_t at,
                      const feature_edge *after)
{
    qm_vec here = qm_vec_load(positions + 3 * (size_t)at);
    qm_vec a = qm_vec_sub(here, qm_vec_load(positions + 3 * (size_t)before->end[before->end[0] == at])),
           b = qm_vec_sub(qm_vec_load(positions + 3 * (size_t)after->end[after->end[0] == at]), here);
    double scale = qm_vec_norm(a) * qm_vec_norm(b);
    return scale > 0.0 ? qm_vec_scale(1.0 / scale, qm_vec_cross(a, b)) : (qm_vec){0, 0, 0};
}

/**
 * Charges connected creases for the edges before and after which the line turns sharply to opposite sides. links has, of
 * each vertex of two edges, the numbers of both, one combined with the other by exclusive or.
 */
static void charge_zigzags(const double *positions, const feature_edge *edge, size_t count,
                           const uint32_t *degree, const uint32_t *links, double price, uint32_t *parent,
                           double *length)
{
    for (uint32_t i = 0; i < count; i++) {
        uint32_t from = edge[i].end[0], to = edge[i].end[1];
        if (edge[i].boundaries > 0 || degree[from] != 2 || degree[to] != 2) continue;
        qm_vec first = turn_at(positions, &edge[links[from] ^ i], from, &edge[i]),
               second = turn_at(positions, &edge[i], to, &edge[links[to] ^ i]);
        if (qm_vec_norm(first) > ZIGZAG_SINE && qm_vec_norm(second) > ZIGZAG_SINE &&
            qm_vec_dot(first, second) < 0.0)
            length[qm_union_find_root(parent, from)] -= price;
    }
}

/**
 * Leaves out connected creases, and connected boundaries, that are shorter together than the shortest length; creases also as
 * much for each meeting of three edges or more, as where all edges of a rough mesh are creases these meet everywhere, and
 * four times as much where only one of these is a crease: it ends at the boundary. Half as much is charged for each zigzag.
 */
static qm_status drop_short(qm_context *ctx, const double *positions, size_t vertex_count, double shortest,
                            feature_edge *edge, size_t *count)
{
    uint32_t *parent = qm_context_alloc(ctx, vertex_count, sizeof *parent);
    uint32_t *degree = qm_context_alloc(ctx, vertex_count, sizeof *degree);
    uint32_t *links = qm_context_alloc(ctx, vertex_count, sizeof *links);
    double *length = qm_context_alloc(ctx, vertex_count, sizeof *length);
    bool has_memory = parent && degree && links && length;
    size_t total = *count, kept = 0;
    for (uint32_t v = 0; v < vertex_count && has_memory; v++)
        degree[v] = links[v] = 0;
    for (uint32_t i = 0; i < total && has_memory; i++)
        for (int k = 0; k < 2; k++) {
            degree[edge[i].end[k]] += edge[i].boundaries > 0 ? BOUNDARY : 1;
            links[edge[i].end[k]] ^= i;
        }
    for (int of_boundaries = 0; of_boundaries < 2 && has_memory; of_boundaries++) {
        for (uint32_t v = 0; v < vertex_count; v++)
            parent[v] = v, length[v] = 0.0;
        for (size_t i = 0; i < total; i++)
            if ((edge[i].boundaries > 0) == of_boundaries)
                qm_union_find_join(parent, edge[i].end[0], edge[i].end[1]);
        for (uint32_t v = 0; v < vertex_count && !of_boundaries; v++)
            if (degree[v] % BOUNDARY > 0 && degree[v] > 2)
                length[qm_union_find_root(parent, v)] -= (degree[v] % BOUNDARY == 1 ? ENDS : 1.0) * shortest;
        if (!of_boundaries)
            charge_zigzags(positions, edge, total, degree, links, ZIGZAG * shortest, parent, length);
        for (size_t i = 0; i < total; i++)
            if ((edge[i].boundaries > 0) == of_boundaries)
                length[qm_union_find_root(parent, edge[i].end[0])] +=
                    qm_vec_distance(qm_vec_load(positions + 3 * (size_t)edge[i].end[0]),
                                    qm_vec_load(positions + 3 * (size_t)edge[i].end[1]));
        for (size_t i = 0; i < total; i++)
            if ((edge[i].boundaries > 0) == of_boundaries)
                edge[i].is_kept = length[qm_union_find_root(parent, edge[i].end[0])] >= shortest;
    }
    for (size_t i = 0; i < total && has_memory; i++)
        if (edge[i].is_kept) edge[kept++] = edge[i];
    if (has_memory) *count = kept;
    qm_context_free(ctx, parent, vertex_count, sizeof *parent);
    qm_context_free(ctx, degree, vertex_count, sizeof *degree);
    qm_context_free(ctx, links, vertex_count, sizeof *links);
    qm_context_free(ctx, length, vertex_count, sizeof *length);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

/** The normal on the left of an edge less that on its right: a half-edge has its face on its left. */
static qm_vec step_across(const feature_edge *edge)
{
    double own = qm_vec_norm(edge->normal), other = qm_vec_norm(edge->other_normal);
    if (edge->boundaries > 0 || !(own > 0.0) || !(other > 0.0)) return (qm_vec){0, 0, 0};
    qm_vec across = qm_vec_axpy(qm_vec_scale(1.0 / own, edge->normal), -1.0 / other, edge->other_normal);
    return edge->is_forward ? across : qm_vec_scale(-1.0, across);
}

/** Makes the graph of edges: numbers the positions that they use in order. */
static qm_status make_graph(qm_context *ctx, const double *positions, size_t vertex_count,
                            const feature_edge *edge, size_t count, qm_features *out)
{
    if (count == 0) return QM_OK;
    uint32_t *number = qm_context_alloc(ctx, vertex_count, sizeof *number);
    if (!number) return QM_E_NO_MEMORY;
    size_t used = 0;
    memset(number, 0, vertex_count * sizeof *number);
    for (size_t i = 0; i < count; i++)
        number[edge[i].end[0]] = number[edge[i].end[1]] = 1;
    for (size_t v = 0; v < vertex_count; v++)
        used += number[v];
    out->points = qm_context_alloc(ctx, used, POINT_SIZE);
    out->edges = qm_context_alloc(ctx, count, sizeof *out->edges);
    out->across = qm_context_alloc(ctx, count, sizeof *out->across);
    bool has_memory = out->points && out->edges && out->across;
    out->point_count = used;
    out->edge_count = count;
    if (has_memory) {
        used = 0;
        for (size_t v = 0; v < vertex_count; v++) {
            if (!number[v]) continue;
            memcpy(out->points + 3 * used, positions + 3 * v, POINT_SIZE);
            number[v] = (uint32_t)used++;
        }
        for (size_t i = 0; i < count; i++) {
            for (int k = 0; k < 2; k++)
                out->edges[i][k] = number[edge[i].end[k]];
            qm_vec_store(out->across[i], step_across(&edge[i]));
        }
    }
    qm_context_free(ctx, number, vertex_count, sizeof *number);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

/** The features of a mesh of triangles, as a graph. */
static qm_status collect(qm_context *ctx, const qm_trimesh *m, const qm_features_options *options,
                         qm_features *out)
{
    size_t vertices = m->vertex_count, capacity = 0, count = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        capacity += m->is_feature[h] != 0;
    if (capacity == 0) return QM_OK;
    double *positions = qm_context_alloc(ctx, vertices, POINT_SIZE);
    uint32_t *same = qm_context_alloc(ctx, vertices, sizeof *same);
    feature_edge *edge = qm_context_alloc(ctx, capacity, sizeof *edge);
    qm_status status = positions && same && edge ? QM_OK : QM_E_NO_MEMORY;
    for (size_t v = 0; v < vertices && status == QM_OK; v++)
        qm_vec_store(positions + 3 * v, m->position[v]);
    /* An edge of three faces has become several boundaries with vertices of their own. */
    if (status == QM_OK) status = weld(ctx, positions, vertices, same);
    if (status == QM_OK) {
        count = list_edges(m, options->box, positions, same, edge);
        count = merge_edges(edge, count, cos(options->angle * QM_DEGREE));
        status = drop_short(ctx, positions, vertices, options->shortest, edge, &count);
    }
    if (status == QM_OK) status = make_graph(ctx, positions, vertices, edge, count, out);
    qm_context_free(ctx, positions, vertices, POINT_SIZE);
    qm_context_free(ctx, same, vertices, sizeof *same);
    qm_context_free(ctx, edge, capacity, sizeof *edge);
    return status;
}

qm_status qm_features_find(qm_context *ctx, const qm_mesh *mesh, const qm_features_options *options,
                           qm_features *out)
{
    QM_ASSERT(ctx && mesh && options && out);
    *out = (qm_features){0};
    if (!(options->angle > 0.0) || options->angle > 180.0)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the angle of creases must be above 0, and 180 at most");
    if (!(options->shortest > 0.0) || !isfinite(options->shortest))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the shortest length of features must be above 0");
    if (mesh->face_count == 0) return QM_OK;
    qm_mesh welded;
    qm_quads_triangles t = {0};
    qm_trimesh m = {0};
    qm_status status = weld_faces(ctx, mesh, options->box, &welded);
    bool has_faces = status == QM_OK && welded.face_count > 0;
    if (has_faces) status = qm_quads_list_triangles(ctx, &welded, &t);
    if (has_faces && status == QM_OK)
        status = qm_trimesh_build(ctx, mesh->positions, mesh->vertex_count, (const uint32_t(*)[3])t.corner,
                                  t.count, &m);
    if (status == QM_OK && m.face_count > 0) {
        qm_quads_drop_slivers(&m);
        status = qm_quads_find_features(ctx, &m, options->angle, options->shortest / SHORTEST_SIDES, false);
    }
    if (status == QM_OK) status = collect(ctx, &m, options, out);
    qm_trimesh_reset(ctx, &m);
    qm_quads_triangles_reset(ctx, &t);
    qm_context_free(ctx, welded.faces, mesh->face_count, 4 * sizeof *welded.faces);
    if (status != QM_OK) qm_features_reset(ctx, out);
    return status == QM_E_NO_MEMORY ? qm_context_fail(ctx, status, "out of memory for the features") : status;
}

void qm_features_reset(qm_context *ctx, qm_features *features)
{
    qm_context_free(ctx, features->points, features->point_count, POINT_SIZE);
    qm_context_free(ctx, features->edges, features->edge_count, sizeof *features->edges);
    qm_context_free(ctx, features->across, features->edge_count, sizeof *features->across);
    *features = (qm_features){0};
}
