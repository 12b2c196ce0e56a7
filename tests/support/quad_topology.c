/**
 * quad_topology.c: what a mesh of quads is.
 */
#include "quad_topology.h"

#include <stdlib.h>

#include "check.h"
#include "core/vec.h"

typedef struct directed_edge {
    uint32_t low, high;
    bool is_forward;
} directed_edge;

static int compare_edges(const void *a, const void *b)
{
    const directed_edge *x = a, *y = b;
    if (x->low != y->low) return x->low < y->low ? -1 : 1;
    return (x->high > y->high) - (x->high < y->high);
}

static uint32_t root_of(uint32_t *parent, uint32_t v)
{
    while (parent[v] != v)
        v = parent[v];
    return v;
}

/** Corners of faces at a vertex are one fan if walking from face to face by shared edges reaches them all. */
static bool has_one_fan(const qm_mesh *m, const uint32_t *corners, size_t count)
{
    bool reached[64] = {true};
    if (count > 64) return false;
    for (size_t round = 0; round < count; round++) {
        for (size_t i = 0; i < count; i++) {
            for (size_t j = 0; j < count && reached[i]; j++) {
                const uint32_t *a = m->faces + corners[i] / 4 * 4, *b = m->faces + corners[j] / 4 * 4;
                uint32_t ka = corners[i] % 4, kb = corners[j] % 4;
                if (a[(ka + 1) % 4] == b[(kb + 3) % 4] || a[(ka + 3) % 4] == b[(kb + 1) % 4])
                    reached[j] = true;
            }
        }
    }
    for (size_t i = 0; i < count; i++)
        if (!reached[i]) return false;
    return true;
}

qm_topology qm_topology_find(const qm_mesh *m)
{
    qm_topology t = {.is_manifold = true, .is_oriented = true, .is_all_quads = true};
    size_t sides = 4 * m->face_count, edges = 0;
    directed_edge *edge = malloc(sides * sizeof *edge);
    uint32_t *parent = malloc(m->vertex_count * sizeof *parent),
             *start = calloc(m->vertex_count + 2, sizeof *start);
    uint32_t *corners = malloc(sides * sizeof *corners);
    bool *is_border = calloc(m->vertex_count, 1);
    assert_true(edge && parent && start && corners && is_border);
    for (uint32_t v = 0; v < m->vertex_count; v++)
        parent[v] = v;
    for (size_t c = 0; c < sides; c++) {
        const uint32_t *face = m->faces + c / 4 * 4;
        uint32_t a = face[c % 4], b = face[(c + 1) % 4];
        for (size_t k = 1; k < 4; k++)
            t.is_all_quads = t.is_all_quads && face[c % 4] != face[(c + k) % 4];
        assert_true(a < m->vertex_count && b < m->vertex_count);
        edge[c] = (directed_edge){a < b ? a : b, a < b ? b : a, a < b};
        uint32_t x = root_of(parent, a), y = root_of(parent, b);
        parent[x > y ? x : y] = x > y ? y : x;
        start[a + 2]++;
    }
    qsort(edge, sides, sizeof *edge, compare_edges);
    for (size_t i = 0; i < sides; edges++) {
        size_t end = i + 1;
        while (end < sides && compare_edges(&edge[i], &edge[end]) == 0)
            end++;
        if (end - i == 1) {
            t.boundary_edges++;
            is_border[edge[i].low] = is_border[edge[i].high] = true;
        }
        t.is_manifold = t.is_manifold && end - i <= 2;
        t.is_oriented = t.is_oriented && (end - i != 2 || edge[i].is_forward != edge[i + 1].is_forward);
        i = end;
    }
    for (size_t v = 0; v < m->vertex_count; v++)
        start[v + 2] += start[v + 1];
    for (uint32_t c = 0; c < sides; c++)
        corners[start[m->faces[c] + 1]++] = c;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        size_t count = start[v + 1] - start[v];
        QM_CHECK(count > 0, "vertex %u has no face", v);
        t.components += root_of(parent, v) == v;
        t.irregular += !is_border[v] && count != 4;
        t.is_manifold = t.is_manifold && has_one_fan(m, corners + start[v], count);
    }
    t.euler = (ptrdiff_t)m->vertex_count - (ptrdiff_t)edges + (ptrdiff_t)m->face_count;
    free(edge);
    free(parent);
    free(start);
    free(corners);
    free(is_border);
    return t;
}

static double face_sine(const qm_mesh *m, size_t face)
{
    qm_vec p[4];
    for (size_t k = 0; k < 4; k++)
        p[k] = qm_vec_load(m->positions + 3 * (size_t)m->faces[4 * face + k]);
    qm_vec normal = qm_vec_cross(qm_vec_sub(p[2], p[0]), qm_vec_sub(p[3], p[1]));
    double least = 1.0;
    for (size_t k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(p[(k + 1) % 4], p[k]), back = qm_vec_sub(p[(k + 3) % 4], p[k]);
        double scale = qm_vec_norm(normal) * qm_vec_norm(on) * qm_vec_norm(back);
        if (!(scale > 0.0)) return -1.0;
        least = fmin(least, qm_vec_dot(qm_vec_cross(on, back), normal) / scale);
    }
    return least;
}

double qm_topology_least_sine(const qm_mesh *m)
{
    double least = 1.0;
    for (size_t f = 0; f < m->face_count; f++)
        least = fmin(least, face_sine(m, f));
    return least;
}

size_t qm_topology_count_folded(const qm_mesh *m)
{
    size_t folded = 0;
    for (size_t f = 0; f < m->face_count; f++)
        folded += !(face_sine(m, f) > 0.0);
    return folded;
}
