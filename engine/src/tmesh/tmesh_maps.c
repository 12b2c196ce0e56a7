/**
 * tmesh_maps.c: maps of patches onto the square, over the triangles of the surface.
 */
#include "tmesh/tmesh_maps.h"

#include <math.h>
#include <string.h>

#include "tmesh/tmesh_router.h"

#define ASTRAY 0.25 /* of a curve's length, beside the reach: its path is no farther from it */
#define EVEN 1e-3   /* share of equal steps along a side of the square: the rest goes by length */
#define REACH 0.02  /* of the diagonal */

/** The path of a curve. */
typedef struct curve_path {
    double *points; /* rows of x y z */
    size_t count;
} curve_path;

struct qm_tmesh_maps {
    qm_arena arena;
    curve_path *path; /* by curve; of those that are not rough none */
    size_t patch_count;
    qm_tmesh_chart *chart; /* by patch */
    bool *is_clockwise;    /* by patch: it runs against the triangles */
};

/** Halves all edges between two points of curves that are not of a curve: a triangle between three points of one side would have no area
 * in the square. */
static bool halve_chords(qm_router *r)
{
    bool *is_on_curve = qm_arena_zeroed(r->arena, r->m.vertex_count, sizeof *is_on_curve);
    if (!is_on_curve) return false;
    for (uint32_t h = 0; h < 3 * r->m.face_count; h++)
        if (qm_router_label(r, h) != 0 || r->m.twin[h] == QM_NO_INDEX)
            is_on_curve[r->m.from[h]] = is_on_curve[qm_trimesh_to(&r->m, h)] = true;
    for (uint32_t h = 0, end = 3 * (uint32_t)r->m.face_count, old = (uint32_t)r->m.vertex_count; h < end;
         h++) {
        uint32_t a = r->m.from[h], b = qm_trimesh_to(&r->m, h), vertex;
        if (a >= old || b >= old || !is_on_curve[a] || !is_on_curve[b]) continue;
        if (qm_router_label(r, h) != 0 || r->m.twin[h] == QM_NO_INDEX) continue;
        if (!qm_router_split_edge(r, h, qm_vec_mix(r->m.position[a], r->m.position[b], 0.5), &vertex))
            return false;
    }
    return true;
}

/** Puts the vertices of the ring from one place to another onto a side of the square, by length; returns that length. */
static double place_side(qm_route_disc *d, size_t from, size_t count, int side)
{
    static const qm_tmesh_flat corner[5] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    qm_tmesh_flat a = corner[side], b = corner[side + 1];
    double length = 0, passed = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < count; i++) {
            uint32_t v = d->ring[(from + i) % d->ring_count], next = d->ring[(from + i + 1) % d->ring_count];
            double step = qm_vec_distance(d->chart.at[v], d->chart.at[next]);
            if (pass == 0) {
                length += step;
                continue;
            }
            double even = (double)i / (double)count,
                   share = length > 0 ? (1 - EVEN) * passed / length + EVEN * even : even;
            d->chart.flat[v] = (qm_tmesh_flat){a.u + share * (b.u - a.u), a.v + share * (b.v - a.v)};
            d->is_fixed[v] = true;
            passed += step;
        }
    return length;
}

/** Maps a patch. *is_made is false where it is no disc. False when out of memory. */
static bool map_patch(qm_router *r, qm_arena *scratch, uint32_t patch, qm_tmesh_maps *maps, bool *is_made)
{
    uint32_t dart[4], start[4];
    size_t place[4] = {0};
    double length[4];
    qm_route_disc d;
    *is_made = false;
    qm_router_patch_darts(r, patch, dart);
    for (int k = 0; k < 4; k++) {
        start[k] = qm_router_labelled_edge(r, r->vertex[qm_router_start(r, dart[k])], dart[k] / 2);
        if (start[k] == QM_NO_INDEX) return true;
    }
    if (!qm_router_gather(r, &maps->arena, start[0] / 3, NULL, &d, is_made)) return false;
    for (int k = 0; k < 4 && *is_made; k++) {
        *is_made = r->stamp[start[k] / 3] == r->stamp_value;
        if (!*is_made) return true;
        uint32_t corner = qm_router_corner_at(r, &d, start[k]);
        while (place[k] < d.ring_count && d.ring[place[k]] != corner)
            place[k]++;
    }
    if (!*is_made) return true;
    for (int k = 0; k < 4; k++) {
        size_t count = (place[(k + 1) & 3] + d.ring_count - place[k]) % d.ring_count;
        length[k] = place_side(&d, place[k], count, k);
    }
    for (size_t i = 0; i < d.ring_count; i++)
        *is_made = *is_made && d.is_fixed[d.ring[i]];
    const qm_tmesh_flat size = {0.5 * (length[0] + length[2]), 0.5 * (length[1] + length[3])};
    if (*is_made && !qm_tmesh_chart_spread(scratch, &d.chart, d.is_fixed, size)) return false;
    maps->chart[patch] = d.chart;
    maps->is_clockwise[patch] = r->turn[patch] < 0;
    return true;
}

/** Adds curves whose paths leave the points that they were laid along to the rough ones. False if one of a boundary does. */
static bool find_astray(const qm_router *r, bool *is_rough)
{
    for (uint32_t h = 0; h < 3 * r->m.face_count; h++) {
        if (qm_router_label(r, h) == 0) continue;
        const uint32_t curve = qm_router_label(r, h) - 1;
        const qm_route_guide g = qm_router_curve_guide(r, curve);
        double passed;
        if (qm_route_guide_distance(&g, r->m.position[r->m.from[h]], &passed) <=
            ASTRAY * g.length + REACH * r->triangles->surface->diagonal)
            continue;
        if (qm_router_is_boundary(r, curve)) return false;
        is_rough[curve] = true;
    }
    return true;
}

/** Lays rough curves straight, and keeps their paths. */
static bool lay_straight(qm_router *r, const bool *is_rough, qm_tmesh_maps *maps)
{
    size_t curves = r->layout->curve_count;
    bool *open = qm_arena_zeroed(r->arena, curves, sizeof *open);
    maps->path = qm_arena_zeroed(&maps->arena, curves, sizeof *maps->path);
    if (!open || !maps->path) return false;
    for (uint32_t c = 0; c < curves && !r->is_lost; c++)
        if (is_rough[c] && !qm_router_is_boundary(r, c) && !qm_router_straighten_curve(r, c, open))
            return false;
    for (uint32_t c = 0; c < curves && !r->is_lost; c++) {
        curve_path *path = &maps->path[c];
        double *points;
        if (!is_rough[c]) continue;
        if (!qm_router_list_points(r, c, &points, &path->count)) return false;
        path->points = qm_arena_alloc(&maps->arena, 3 * path->count, sizeof *path->points);
        if (!path->points) return false;
        memcpy(path->points, points, 3 * path->count * sizeof *points);
    }
    return true;
}

static bool map_patches(qm_router *r, qm_tmesh_maps *maps, bool *is_made)
{
    qm_arena scratch = qm_arena_make(r->ctx);
    bool has_memory = halve_chords(r);
    *is_made = true;
    for (uint32_t p = 0; p < maps->patch_count && has_memory && *is_made; p++) {
        qm_arena_rewind(&scratch);
        has_memory = map_patch(r, &scratch, p, maps, is_made);
        if (qm_context_canceled(r->ctx)) *is_made = false;
    }
    qm_arena_reset(&scratch);
    return has_memory;
}

/** Lays the curves and maps the patches. False when out of memory. */
static bool make(qm_router *r, bool *is_rough, qm_tmesh_maps *maps, bool *is_made)
{
    const qm_layout *layout = r->layout;
    double *grids = qm_arena_alloc(r->arena, layout->patch_count, 3 * QM_LAYOUT_GRID_POINTS * sizeof *grids);
    maps->chart = qm_arena_zeroed(&maps->arena, layout->patch_count, sizeof *maps->chart);
    maps->is_clockwise = qm_arena_zeroed(&maps->arena, layout->patch_count, sizeof *maps->is_clockwise);
    maps->patch_count = layout->patch_count;
    if (!grids || !maps->chart || !maps->is_clockwise) return false;
    qm_router_blend_grids(layout, grids);
    if (!qm_router_order_darts(r, grids, is_made)) return false;
    if (!*is_made) return true;
    if (!qm_router_prepare(r) || (!r->is_lost && !qm_router_route_all(r, true))) return false;
    if (!r->is_lost && find_astray(r, is_rough) && !lay_straight(r, is_rough, maps)) return false;
    *is_made = !r->is_lost && maps->path && !qm_context_canceled(r->ctx);
    return !*is_made || map_patches(r, maps, is_made);
}

qm_status qm_tmesh_maps_make(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                             const qm_tmesh_guides *guides, bool *is_rough, qm_tmesh_maps **out)
{
    qm_tmesh_triangles triangles;
    qm_arena arena = qm_arena_make(ctx);
    qm_router r = {.arena = &arena, .ctx = ctx, .triangles = &triangles, .layout = layout, .guides = guides};
    bool is_made = false;
    *out = qm_context_alloc(ctx, 1, sizeof **out);
    if (*out) **out = (qm_tmesh_maps){.arena = qm_arena_make(ctx)};
    qm_status status = qm_tmesh_triangles_make(ctx, surface, &triangles);
    bool has_memory = *out && status == QM_OK && make(&r, is_rough, *out, &is_made);
    qm_trimesh_reset(ctx, &r.m);
    qm_heap_reset(ctx, &r.heap);
    qm_arena_reset(&arena);
    qm_tmesh_triangles_reset(&triangles);
    if (!is_made || !has_memory) {
        qm_tmesh_maps_destroy(ctx, *out);
        *out = NULL;
    }
    if (!has_memory) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the maps of patches");
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "canceled") : QM_OK;
}

void qm_tmesh_maps_destroy(qm_context *ctx, qm_tmesh_maps *maps)
{
    if (!maps) return;
    qm_arena_reset(&maps->arena);
    qm_context_free(ctx, maps, 1, sizeof *maps);
}

bool qm_tmesh_maps_at(const qm_tmesh_maps *maps, size_t patch, double u, double v, uint32_t *triangle,
                      qm_vec *at)
{
    const qm_tmesh_flat flat = maps->is_clockwise[patch] ? (qm_tmesh_flat){v, u} : (qm_tmesh_flat){u, v};
    return qm_tmesh_chart_lift(&maps->chart[patch], flat, triangle, at);
}

const double *qm_tmesh_maps_path(const qm_tmesh_maps *maps, size_t curve, size_t *count)
{
    *count = maps->path[curve].count;
    return maps->path[curve].points;
}
