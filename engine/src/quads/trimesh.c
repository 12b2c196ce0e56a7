/**
 * trimesh.c: a triangle mesh with half-edges, and its edits.
 */
#include "trimesh.h"

#include <stdlib.h>
#include <string.h>

uint32_t qm_trimesh_first(const qm_trimesh *m, uint32_t vertex)
{
    uint32_t start = m->out[vertex], h = start;
    while (m->twin[h] != QM_NO_INDEX) {
        h = qm_trimesh_next(m->twin[h]);
        if (h == start) break;
    }
    return h;
}

qm_vec qm_trimesh_normal(const qm_trimesh *m, size_t face)
{
    const uint32_t *c = m->from + 3 * face;
    qm_vec a = m->position[c[0]];
    return qm_vec_cross(qm_vec_sub(m->position[c[1]], a), qm_vec_sub(m->position[c[2]], a));
}

qm_vec qm_trimesh_vertex_normal(const qm_trimesh *m, uint32_t vertex)
{
    qm_vec sum = {0, 0, 0};
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        sum = qm_vec_add(sum, qm_trimesh_normal(m, h / 3));
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    double length = qm_vec_norm(sum);
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
}

int qm_trimesh_kind(const qm_trimesh *m, uint32_t vertex, uint32_t line[2])
{
    int count = 0;
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        if (m->is_feature[h]) {
            if (count < 2) line[count] = qm_trimesh_to(m, h);
            count++;
        }
        uint32_t back = qm_trimesh_prev(h);
        if (m->twin[back] == QM_NO_INDEX) { /* the other boundary edge runs towards the vertex */
            if (count < 2) line[count] = m->from[back];
            count++;
        }
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    if (m->is_fixed[vertex]) return QM_TRIMESH_CORNER;
    return count == 0 ? QM_TRIMESH_FREE : count == 2 ? QM_TRIMESH_ON_LINE : QM_TRIMESH_CORNER;
}

/*
 * Memory.
 */

static void free_vertices(qm_context *ctx, qm_trimesh *m)
{
    qm_context_free(ctx, m->position, m->vertex_capacity, sizeof *m->position);
    qm_context_free(ctx, m->out, m->vertex_capacity, sizeof *m->out);
    qm_context_free(ctx, m->is_fixed, m->vertex_capacity, sizeof *m->is_fixed);
    qm_context_free(ctx, m->stamp, m->vertex_capacity, sizeof *m->stamp);
}

static void free_faces(qm_context *ctx, qm_trimesh *m)
{
    qm_context_free(ctx, m->from, 3 * m->face_capacity, sizeof *m->from);
    qm_context_free(ctx, m->twin, 3 * m->face_capacity, sizeof *m->twin);
    qm_context_free(ctx, m->is_feature, 3 * m->face_capacity, sizeof *m->is_feature);
    qm_context_free(ctx, m->step, 3 * m->face_capacity, sizeof *m->step);
}

void qm_trimesh_reset(qm_context *ctx, qm_trimesh *m)
{
    free_vertices(ctx, m);
    free_faces(ctx, m);
    *m = (qm_trimesh){0};
}

/** All arrays grow to one capacity, or none: an array that has grown alone would be freed by the wrong size. */
static bool reserve_vertices(qm_context *ctx, qm_trimesh *m, size_t capacity)
{
    if (capacity <= m->vertex_capacity) return true;
    if (capacity >= QM_NO_INDEX) return false;
    qm_trimesh n = {.vertex_capacity = capacity};
    n.position = qm_context_alloc(ctx, capacity, sizeof *n.position);
    n.out = qm_context_alloc(ctx, capacity, sizeof *n.out);
    n.is_fixed = qm_context_alloc(ctx, capacity, sizeof *n.is_fixed);
    n.stamp = qm_context_alloc(ctx, capacity, sizeof *n.stamp);
    if (!n.position || !n.out || !n.is_fixed || !n.stamp) {
        free_vertices(ctx, &n);
        return false;
    }
    size_t count = m->vertex_count;
    memset(n.stamp, 0, capacity * sizeof *n.stamp);
    if (count > 0) {
        memcpy(n.position, m->position, count * sizeof *n.position);
        memcpy(n.out, m->out, count * sizeof *n.out);
        memcpy(n.is_fixed, m->is_fixed, count * sizeof *n.is_fixed);
        memcpy(n.stamp, m->stamp, count * sizeof *n.stamp);
    }
    free_vertices(ctx, m);
    m->position = n.position, m->out = n.out, m->is_fixed = n.is_fixed, m->stamp = n.stamp;
    m->vertex_capacity = capacity;
    return true;
}

static bool reserve_faces(qm_context *ctx, qm_trimesh *m, size_t capacity)
{
    if (capacity <= m->face_capacity) return true;
    if (capacity >= QM_NO_INDEX / 16) return false;
    qm_trimesh n = {.face_capacity = capacity};
    n.from = qm_context_alloc(ctx, 3 * capacity, sizeof *n.from);
    n.twin = qm_context_alloc(ctx, 3 * capacity, sizeof *n.twin);
    n.is_feature = qm_context_alloc(ctx, 3 * capacity, sizeof *n.is_feature);
    n.step = qm_context_alloc(ctx, 3 * capacity, sizeof *n.step);
    if (!n.from || !n.twin || !n.is_feature || !n.step) {
        free_faces(ctx, &n);
        return false;
    }
    size_t count = 3 * m->face_count;
    if (count > 0) {
        memcpy(n.from, m->from, count * sizeof *n.from);
        memcpy(n.twin, m->twin, count * sizeof *n.twin);
        memcpy(n.is_feature, m->is_feature, count * sizeof *n.is_feature);
        memcpy(n.step, m->step, count * sizeof *n.step);
    }
    free_faces(ctx, m);
    m->from = n.from, m->twin = n.twin, m->is_feature = n.is_feature, m->step = n.step;
    m->face_capacity = capacity;
    return true;
}

/*
 * Construction.
 */

typedef struct edge_entry {
    uint32_t other, h; /* the greater vertex of the edge, and a half-edge */
} edge_entry;

static int compare_entries(const void *a, const void *b)
{
    const edge_entry *x = a, *y = b;
    if (x->other != y->other) return x->other < y->other ? -1 : 1;
    return (x->h > y->h) - (x->h < y->h);
}

static void sort_entries(edge_entry *entry, size_t count)
{
    if (count > 24) {
        qsort(entry, count, sizeof *entry, compare_entries);
        return;
    }
    for (size_t i = 1; i < count; i++) {
        edge_entry moved = entry[i];
        size_t k = i;
        for (; k > 0 && compare_entries(&moved, &entry[k - 1]) < 0; k--)
            entry[k] = entry[k - 1];
        entry[k] = moved;
    }
}

/** Pairs the half-edges between the same vertices; start and entries are scratch. */
static void pair_twins(qm_trimesh *m, size_t vertex_count, uint32_t *start, edge_entry *entries)
{
    size_t count = 3 * m->face_count;
    memset(start, 0, (vertex_count + 1) * sizeof *start);
    for (uint32_t h = 0; h < count; h++) {
        uint32_t a = m->from[h], b = qm_trimesh_to(m, h);
        start[(a < b ? a : b) + 1]++;
    }
    for (size_t v = 0; v < vertex_count; v++)
        start[v + 1] += start[v];
    for (uint32_t h = 0; h < count; h++) {
        uint32_t a = m->from[h], b = qm_trimesh_to(m, h);
        entries[start[a < b ? a : b]++] = (edge_entry){a < b ? b : a, h};
        m->twin[h] = QM_NO_INDEX;
    }
    size_t begin = 0;
    for (size_t v = 0; v < vertex_count; v++) { /* start[v] is now the end of the entries of v */
        sort_entries(entries + begin, start[v] - begin);
        for (size_t i = begin; i < start[v];) {
            size_t end = i + 1;
            while (end < start[v] && entries[end].other == entries[i].other)
                end++;
            uint32_t h = entries[i].h;
            if (end - i == 2 && m->from[h] != m->from[entries[i + 1].h]) {
                m->twin[h] = entries[i + 1].h;
                m->twin[entries[i + 1].h] = h;
            }
            i = end;
        }
        begin = start[v];
    }
}

/** Gives each fan a vertex: until then from has the vertices of the input. */
static void split_fans(qm_trimesh *m, const double *positions, uint32_t *renamed)
{
    size_t count = 3 * m->face_count;
    for (size_t h = 0; h < count; h++)
        renamed[h] = QM_NO_INDEX;
    for (uint32_t corner = 0; corner < count; corner++) {
        if (renamed[corner] != QM_NO_INDEX) continue;
        uint32_t vertex = (uint32_t)m->vertex_count++, h = corner;
        m->position[vertex] = qm_vec_load(positions + 3 * (size_t)m->from[corner]);
        m->out[vertex] = corner;
        m->is_fixed[vertex] = false;
        do {
            renamed[h] = vertex;
            h = m->twin[qm_trimesh_prev(h)];
        } while (h != QM_NO_INDEX && h != corner);
        if (h == corner) continue;
        for (h = m->twin[corner]; h != QM_NO_INDEX; h = m->twin[h]) {
            h = qm_trimesh_next(h);
            renamed[h] = vertex;
        }
    }
    memcpy(m->from, renamed, count * sizeof *renamed);
}

qm_status qm_trimesh_build(qm_context *ctx, const double *positions, size_t vertex_count,
                           const uint32_t (*corner)[3], size_t face_count, qm_trimesh *out)
{
    *out = (qm_trimesh){0};
    qm_trimesh *m = out;
    if (!reserve_faces(ctx, m, face_count + 1)) return QM_E_NO_MEMORY;
    for (size_t f = 0; f < face_count; f++) {
        const uint32_t *c = corner[f];
        if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) continue;
        memcpy(m->from + 3 * m->face_count++, c, 3 * sizeof *c);
    }
    size_t count = 3 * m->face_count;
    memset(m->step, 0, count * sizeof *m->step);
    uint32_t *start = qm_context_alloc(ctx, vertex_count + 1, sizeof *start);
    uint32_t *renamed = qm_context_alloc(ctx, count + 1, sizeof *renamed);
    edge_entry *entries = qm_context_alloc(ctx, count + 1, sizeof *entries);
    /* A closed mesh has half as many vertices as faces; a soup three for each. */
    bool has_memory = start && renamed && entries && reserve_vertices(ctx, m, count + 1);
    if (has_memory) {
        pair_twins(m, vertex_count, start, entries);
        split_fans(m, positions, renamed);
        for (size_t h = 0; h < count; h++)
            m->is_feature[h] = m->twin[h] == QM_NO_INDEX;
    }
    qm_context_free(ctx, start, vertex_count + 1, sizeof *start);
    qm_context_free(ctx, renamed, count + 1, sizeof *renamed);
    qm_context_free(ctx, entries, count + 1, sizeof *entries);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

qm_status qm_trimesh_copy(qm_context *ctx, const qm_trimesh *m, qm_trimesh *out)
{
    size_t count = m->vertex_count, halves = 3 * m->face_count;
    *out = (qm_trimesh){0};
    if (!reserve_faces(ctx, out, m->face_count + 1) || !reserve_vertices(ctx, out, count + 1))
        return QM_E_NO_MEMORY;
    memcpy(out->position, m->position, count * sizeof *m->position);
    memcpy(out->out, m->out, count * sizeof *m->out);
    memcpy(out->is_fixed, m->is_fixed, count * sizeof *m->is_fixed);
    memcpy(out->from, m->from, halves * sizeof *m->from);
    memcpy(out->twin, m->twin, halves * sizeof *m->twin);
    memcpy(out->is_feature, m->is_feature, halves * sizeof *m->is_feature);
    memcpy(out->step, m->step, halves * sizeof *m->step);
    out->vertex_count = count, out->face_count = m->face_count;
    return QM_OK;
}

/*
 * Edits.
 */

static void link_twins(qm_trimesh *m, uint32_t a, uint32_t b)
{
    if (a != QM_NO_INDEX) m->twin[a] = b;
    if (b != QM_NO_INDEX) m->twin[b] = a;
}

static void set_face(qm_trimesh *m, uint32_t face, uint32_t a, uint32_t b, uint32_t c)
{
    m->from[3 * face] = a;
    m->from[3 * face + 1] = b;
    m->from[3 * face + 2] = c;
    m->out[a] = 3 * face;
    m->out[b] = 3 * face + 1;
    m->out[c] = 3 * face + 2;
}

/** Cuts the face of h from the middle of h to the opposite corner: h keeps the first half, the new face has the other. */
static uint32_t split_face(qm_trimesh *m, uint32_t h, uint32_t middle)
{
    uint32_t next = qm_trimesh_next(h), prev = qm_trimesh_prev(h);
    uint32_t v = m->from[next], w = m->from[prev];
    uint32_t face = (uint32_t)m->face_count++, k = 3 * face;
    uint32_t outer = m->twin[next];
    m->is_feature[k] = m->is_feature[h];
    m->is_feature[k + 1] = m->is_feature[next];
    m->is_feature[k + 2] = false;
    memset(m->step + k, 0, 3 * sizeof *m->step);
    memcpy(m->step[k + 1], m->step[next], sizeof m->step[next]);
    m->is_feature[next] = false;
    m->from[next] = middle;
    set_face(m, face, middle, v, w);
    link_twins(m, k + 1, outer);
    link_twins(m, next, k + 2);
    return k;
}

static bool reserve_vertex_and_faces(qm_context *ctx, qm_trimesh *m)
{
    if (m->face_count + 2 > m->face_capacity &&
        !reserve_faces(ctx, m, m->face_capacity + m->face_capacity / 2 + 16))
        return false;
    return m->vertex_count + 1 <= m->vertex_capacity ||
           reserve_vertices(ctx, m, m->vertex_capacity + m->vertex_capacity / 2 + 16);
}

static uint32_t new_vertex(qm_trimesh *m, qm_vec position)
{
    uint32_t vertex = (uint32_t)m->vertex_count++;
    m->position[vertex] = position;
    m->is_fixed[vertex] = false;
    m->stamp[vertex] = 0;
    return vertex;
}

qm_status qm_trimesh_split(qm_context *ctx, qm_trimesh *m, uint32_t h, qm_vec position, uint32_t *vertex)
{
    if (!reserve_vertex_and_faces(ctx, m)) return QM_E_NO_MEMORY;
    uint32_t middle = new_vertex(m, position), twin = m->twin[h], first = m->from[h];
    uint32_t rest = split_face(m, h, middle);
    m->out[middle] = rest;
    m->out[first] = h;
    m->twin[rest] = QM_NO_INDEX;
    if (twin != QM_NO_INDEX) {
        uint32_t other = split_face(m, twin, middle);
        link_twins(m, h, other);
        link_twins(m, twin, rest);
    }
    *vertex = middle;
    return QM_OK;
}

qm_status qm_trimesh_split_face(qm_context *ctx, qm_trimesh *m, uint32_t face, uint32_t *vertex)
{
    if (!reserve_vertex_and_faces(ctx, m)) return QM_E_NO_MEMORY;
    uint32_t corner[3], outer[3], new_face[3] = {face, (uint32_t)m->face_count, (uint32_t)m->face_count + 1};
    uint8_t feature[3];
    qm_vec sum = {0, 0, 0};
    m->face_count += 2;
    for (uint32_t k = 0; k < 3; k++) {
        corner[k] = m->from[3 * face + k];
        outer[k] = m->twin[3 * face + k];
        feature[k] = m->is_feature[3 * face + k];
        sum = qm_vec_axpy(sum, 1.0 / 3.0, m->position[corner[k]]);
    }
    uint32_t middle = new_vertex(m, sum);
    for (uint32_t k = 0; k < 3; k++) {
        uint32_t h = 3 * new_face[k];
        set_face(m, new_face[k], corner[k], corner[(k + 1) % 3], middle);
        link_twins(m, h, outer[k]);
        link_twins(m, h + 1, 3 * new_face[(k + 1) % 3] + 2);
        m->is_feature[h] = feature[k];
        m->is_feature[h + 1] = m->is_feature[h + 2] = false;
        memset(m->step + h, 0, 3 * sizeof *m->step);
    }
    *vertex = middle;
    return QM_OK;
}

/** The boundary edge after one. */
static uint32_t next_boundary(const qm_trimesh *m, uint32_t h)
{
    return qm_trimesh_first(m, qm_trimesh_to(m, h));
}

static void fill_hole(qm_trimesh *m, uint32_t first, size_t count, qm_vec centre)
{
    uint32_t middle = new_vertex(m, centre), before = QM_NO_INDEX, start = (uint32_t)(3 * m->face_count);
    for (size_t i = 0; i < count; i++) {
        /* the face at the first edge hides it from the last one */
        uint32_t next = i + 1 < count ? next_boundary(m, first) : first;
        uint32_t face = (uint32_t)m->face_count++, k = 3 * face;
        set_face(m, face, qm_trimesh_to(m, first), m->from[first], middle);
        memset(m->step + k, 0, 3 * sizeof *m->step);
        memset(m->is_feature + k, 0, 3);
        m->is_feature[first] = false;
        m->twin[k + 1] = m->twin[k + 2] = QM_NO_INDEX;
        link_twins(m, k, first);
        link_twins(m, k + 1, before);
        before = k + 2;
        first = next;
    }
    link_twins(m, start + 1, before);
}

qm_status qm_trimesh_fill_holes(qm_context *ctx, qm_trimesh *m, double longest)
{
    size_t halves = 3 * m->face_count;
    for (uint32_t first = 0; first < halves; first++) {
        if (m->twin[first] != QM_NO_INDEX) continue;
        double length = 0.0;
        size_t count = 0;
        qm_vec sum = {0, 0, 0};
        uint32_t h = first;
        do {
            length += qm_vec_norm(qm_trimesh_edge(m, h));
            sum = qm_vec_add(sum, m->position[m->from[h]]);
            count++;
            h = next_boundary(m, h);
        } while (h != first && length <= longest && count < halves);
        if (h != first || !(length <= longest) || count < 3) continue;
        size_t faces = m->face_count + count;
        if ((faces > m->face_capacity && !reserve_faces(ctx, m, faces + faces / 8)) ||
            (m->vertex_count + 1 > m->vertex_capacity && !reserve_vertices(ctx, m, m->vertex_count + 16)))
            return QM_E_NO_MEMORY;
        fill_hole(m, first, count, qm_vec_scale(1.0 / (double)count, sum));
    }
    return QM_OK;
}

static bool is_on_boundary(const qm_trimesh *m, uint32_t vertex)
{
    return m->twin[qm_trimesh_first(m, vertex)] == QM_NO_INDEX;
}

static void stamp_neighbours(qm_trimesh *m, uint32_t vertex)
{
    m->stamp_value++;
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        m->stamp[qm_trimesh_to(m, h)] = m->stamp_value;
        m->stamp[m->from[qm_trimesh_prev(h)]] = m->stamp_value;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
}

/** Neighbours of a vertex that are stamped; each counts once. */
static int count_stamped(const qm_trimesh *m, uint32_t vertex)
{
    int count = 0;
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        count += m->stamp[qm_trimesh_to(m, h)] == m->stamp_value;
        uint32_t back = qm_trimesh_prev(h);
        if (m->twin[back] == QM_NO_INDEX) count += m->stamp[m->from[back]] == m->stamp_value;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return count;
}

/** The corner opposite to h would be left without a face or with two: of three faces, one is lost and two are joined. Where
 * the third neighbour of such a corner is the other wing, the link of the edge does not show it. */
static bool leaves_fin(const qm_trimesh *m, uint32_t h)
{
    uint32_t a = m->twin[qm_trimesh_next(h)], b = m->twin[qm_trimesh_prev(h)];
    if (a == QM_NO_INDEX && b == QM_NO_INDEX) return true;
    if (a == QM_NO_INDEX || b == QM_NO_INDEX) return false;
    return a / 3 == b / 3 || m->twin[qm_trimesh_prev(a)] == qm_trimesh_next(b);
}

/** True if a vertex has another edge to the vertex that a half-edge from it leads to. */
static bool is_double(const qm_trimesh *m, uint32_t h)
{
    uint32_t v = m->from[h], to = qm_trimesh_to(m, h), first = qm_trimesh_first(m, v), k = first;
    do {
        uint32_t back = qm_trimesh_prev(k);
        if (k != h && qm_trimesh_to(m, k) == to) return true;
        if (m->twin[back] == QM_NO_INDEX && m->from[back] == to) return true;
        k = qm_trimesh_around(m, k);
    } while (k != QM_NO_INDEX && k != first);
    return false;
}

qm_status qm_trimesh_split_doubles(qm_context *ctx, qm_trimesh *m)
{
    uint32_t halves = 3 * (uint32_t)m->face_count, vertex;
    qm_status status = QM_OK;
    for (uint32_t h = 0; h < halves && status == QM_OK; h++) {
        uint32_t t = m->twin[h];
        bool is_sheet = t != QM_NO_INDEX && m->from[qm_trimesh_prev(h)] == m->from[qm_trimesh_prev(t)];
        if (is_sheet) status = qm_trimesh_split_face(ctx, m, h / 3, &vertex);
        if (t != QM_NO_INDEX || !is_double(m, h)) continue;
        qm_vec middle = qm_vec_mix(m->position[m->from[h]], m->position[qm_trimesh_to(m, h)], 0.5);
        status = qm_trimesh_split(ctx, m, h, middle, &vertex);
    }
    return status;
}

bool qm_trimesh_can_collapse(qm_trimesh *m, uint32_t h)
{
    uint32_t u = m->from[h], v = qm_trimesh_to(m, h), twin = m->twin[h];
    bool is_inner = twin != QM_NO_INDEX;
    if (is_inner && is_on_boundary(m, u) && is_on_boundary(m, v)) return false;
    if (leaves_fin(m, h) || (is_inner && leaves_fin(m, twin))) return false;
    stamp_neighbours(m, u);
    if (count_stamped(m, v) != (is_inner ? 2 : 1)) return false;
    if (!is_inner) return true;
    return m->from[qm_trimesh_prev(h)] != m->from[qm_trimesh_prev(twin)];
}

static void remove_face(qm_trimesh *m, uint32_t face)
{
    m->from[3 * face] = m->from[3 * face + 1] = m->from[3 * face + 2] = QM_NO_INDEX;
}

/** Closes the face of h, whose two other edges become one. */
static void close_face(qm_trimesh *m, uint32_t h, uint32_t kept)
{
    uint32_t next = qm_trimesh_next(h), prev = qm_trimesh_prev(h);
    uint32_t a = m->twin[next], b = m->twin[prev], w = m->from[prev];
    bool is_feature = m->is_feature[next] || m->is_feature[prev];
    link_twins(m, a, b);
    if (a != QM_NO_INDEX) m->is_feature[a] = is_feature;
    if (b != QM_NO_INDEX) m->is_feature[b] = is_feature;
    /* a runs from w to the kept vertex, b from it to w */
    m->out[w] = a != QM_NO_INDEX ? a : qm_trimesh_next(b);
    m->out[kept] = b != QM_NO_INDEX ? b : qm_trimesh_next(a);
    remove_face(m, h / 3);
}

void qm_trimesh_collapse(qm_trimesh *m, uint32_t h)
{
    uint32_t u = m->from[h], v = qm_trimesh_to(m, h), twin = m->twin[h];
    uint32_t first = qm_trimesh_first(m, u), k = first;
    do {
        m->from[k] = v;
        k = qm_trimesh_around(m, k);
    } while (k != QM_NO_INDEX && k != first);
    m->is_fixed[v] |= m->is_fixed[u];
    close_face(m, h, v);
    if (twin != QM_NO_INDEX) close_face(m, twin, v);
    m->out[u] = QM_NO_INDEX;
}

bool qm_trimesh_can_flip(qm_trimesh *m, uint32_t h)
{
    uint32_t twin = m->twin[h];
    if (twin == QM_NO_INDEX || m->is_feature[h]) return false;
    uint32_t w = m->from[qm_trimesh_prev(h)], x = m->from[qm_trimesh_prev(twin)];
    if (w == x) return false;
    stamp_neighbours(m, w);
    return m->stamp[x] != m->stamp_value;
}

void qm_trimesh_flip(qm_trimesh *m, uint32_t h)
{
    uint32_t twin = m->twin[h], hn = qm_trimesh_next(h), hp = qm_trimesh_prev(h);
    uint32_t tn = qm_trimesh_next(twin), tp = qm_trimesh_prev(twin);
    uint32_t u = m->from[h], v = m->from[twin], w = m->from[hp], x = m->from[tp];
    uint32_t outer[4] = {m->twin[hn], m->twin[hp], m->twin[tn], m->twin[tp]};
    uint8_t feature[4] = {m->is_feature[hn], m->is_feature[hp], m->is_feature[tn], m->is_feature[tp]};
    uint32_t f = h / 3, g = twin / 3;
    set_face(m, f, x, w, u); /* x w, w u, u x */
    set_face(m, g, w, x, v); /* w x, x v, v w */
    link_twins(m, 3 * f, 3 * g);
    link_twins(m, 3 * f + 1, outer[1]);
    link_twins(m, 3 * f + 2, outer[2]);
    link_twins(m, 3 * g + 1, outer[3]);
    link_twins(m, 3 * g + 2, outer[0]);
    m->is_feature[3 * f] = m->is_feature[3 * g] = false;
    m->is_feature[3 * f + 1] = feature[1];
    m->is_feature[3 * f + 2] = feature[2];
    m->is_feature[3 * g + 1] = feature[3];
    m->is_feature[3 * g + 2] = feature[0];
}

void qm_trimesh_compact(qm_trimesh *m)
{
    size_t faces = 0, vertices = 0;
    uint32_t *renamed = m->stamp; /* of vertices; set to 0 at the end */
    for (size_t f = 0; f < m->face_count; f++) {
        if (!qm_trimesh_has_face(m, f)) continue;
        if (f != faces) {
            for (size_t k = 0; k < 3; k++) {
                size_t to = 3 * faces + k, at = 3 * f + k;
                m->from[to] = m->from[at];
                m->is_feature[to] = m->is_feature[at];
                memcpy(m->step[to], m->step[at], sizeof m->step[at]);
                link_twins(m, (uint32_t)to, m->twin[at]);
            }
        }
        faces++;
    }
    m->face_count = faces;
    for (size_t v = 0; v < m->vertex_count; v++) {
        if (m->out[v] == QM_NO_INDEX) continue;
        renamed[v] = (uint32_t)vertices;
        m->position[vertices] = m->position[v];
        m->is_fixed[vertices] = m->is_fixed[v];
        vertices++;
    }
    for (uint32_t h = 0; h < 3 * faces; h++)
        m->from[h] = renamed[m->from[h]];
    m->vertex_count = vertices;
    for (uint32_t h = 0; h < 3 * faces; h++)
        m->out[m->from[h]] = h;
    memset(m->stamp, 0, m->vertex_capacity * sizeof *m->stamp);
    m->stamp_value = 0;
}
