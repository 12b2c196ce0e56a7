#include "tmesh/tmesh_polygon.h"

#include <math.h>
#include <string.h>

static double length_of(qm_tmesh_flat a, qm_tmesh_flat b)
{
    return sqrt((b.u - a.u) * (b.u - a.u) + (b.v - a.v) * (b.v - a.v));
}

/** Puts the corners onto the circle, the way round that they run, by the lengths of their sides; no two come together. */
static void make_round(qm_tmesh_polygon *p, double sense)
{
    double length = 0, at = 0;
    for (size_t i = 0; i < p->count; i++)
        length += length_of(p->corner[i], p->corner[(i + 1) % p->count]);
    for (size_t i = 0; i < p->count; i++) {
        double share = 0.5 * at / length + 0.5 * (double)i / (double)p->count,
               angle = sense * 360.0 * QM_DEGREE * share;
        p->round[i] = (qm_tmesh_flat){cos(angle), sin(angle)};
        at += length_of(p->corner[i], p->corner[(i + 1) % p->count]);
    }
}

/** The area of a triangle over the square of its longest side; not above 0 where it is no ear of the polygon that is left. */
static double ear_shape(const qm_tmesh_polygon *p, const uint32_t *left, size_t count, size_t i, double sense)
{
    uint32_t index[3] = {left[(i + count - 1) % count], left[i], left[(i + 1) % count]};
    qm_tmesh_flat a = p->corner[index[0]], b = p->corner[index[1]], c = p->corner[index[2]];
    double area = sense * qm_tmesh_flat_area(a, b, c),
           longest = fmax(length_of(a, b), fmax(length_of(b, c), length_of(c, a)));
    if (!(area > 0)) return 0;
    for (size_t k = 0; k < count; k++) {
        if (left[k] == index[0] || left[k] == index[1] || left[k] == index[2]) continue;
        qm_tmesh_flat other = p->corner[left[k]];
        if (sense * qm_tmesh_flat_area(a, b, other) >= 0 && sense * qm_tmesh_flat_area(b, c, other) >= 0 &&
            sense * qm_tmesh_flat_area(c, a, other) >= 0)
            return 0;
    }
    return area / (longest * longest);
}

qm_status qm_tmesh_polygon_cut(qm_arena *arena, const qm_tmesh_flat *corner, size_t count,
                               qm_tmesh_polygon *out, bool *is_cut)
{
    QM_ASSERT(count >= 3);
    *out = (qm_tmesh_polygon){.count = count, .corner = corner};
    *is_cut = false;
    out->round = qm_arena_alloc(arena, count, sizeof *out->round);
    out->triangle = qm_arena_alloc(arena, count, sizeof *out->triangle);
    uint32_t *left = qm_arena_alloc(arena, count, sizeof *left);
    if (!out->round || !out->triangle || !left) return QM_E_NO_MEMORY;
    double area = 0;
    for (size_t i = 0; i < count; i++) {
        qm_tmesh_flat a = corner[i], b = corner[(i + 1) % count];
        area += a.u * b.v - a.v * b.u;
        left[i] = (uint32_t)i;
    }
    double sense = area < 0 ? -1 : 1;
    make_round(out, sense);
    size_t triangles = 0;
    for (size_t rest = count; rest >= 3; rest--) {
        double best = 0;
        size_t at = rest;
        for (size_t i = 0; i < rest; i++) {
            double shape = ear_shape(out, left, rest, i, sense);
            if (shape > best) best = shape, at = i;
        }
        if (at == rest) return QM_OK;
        const uint32_t ear[3] = {left[(at + rest - 1) % rest], left[at], left[(at + 1) % rest]};
        memcpy(out->triangle[triangles++], ear, sizeof ear);
        memmove(left + at, left + at + 1, (rest - at - 1) * sizeof *left);
    }
    *is_cut = true;
    return QM_OK;
}

qm_tmesh_flat qm_tmesh_polygon_map(const qm_tmesh_polygon *polygon, qm_tmesh_flat point)
{
    double best = -INFINITY;
    qm_tmesh_flat out = point;
    for (size_t t = 0; t + 2 < polygon->count; t++) {
        const uint32_t *c = polygon->triangle[t];
        const qm_tmesh_flat *round = polygon->round;
        double area = qm_tmesh_flat_area(round[c[0]], round[c[1]], round[c[2]]), weight[3], least = INFINITY;
        for (int k = 0; k < 3; k++) {
            weight[k] = qm_tmesh_flat_area(point, round[c[(k + 1) % 3]], round[c[(k + 2) % 3]]) / area;
            least = fmin(least, weight[k]);
        }
        if (!(least > best)) continue;
        best = least;
        out = (qm_tmesh_flat){0, 0};
        for (int k = 0; k < 3; k++) {
            out.u += weight[k] * polygon->corner[c[k]].u;
            out.v += weight[k] * polygon->corner[c[k]].v;
        }
    }
    return out;
}
