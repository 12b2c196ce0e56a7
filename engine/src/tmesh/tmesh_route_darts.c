/**
 * tmesh_route_darts.c: which curves of a layout follow each other round its nodes, told by its patches.
 */
#include "tmesh/tmesh_router.h"

#include <string.h>

void qm_router_patch_darts(const qm_router *r, uint32_t patch, uint32_t out[4])
{
    const qm_layout_patch *at = &r->layout->patches[patch];
    for (int k = 0; k < 4; k++) {
        int side = r->turn[patch] > 0 ? k : 3 - k;
        out[k] = 2 * at->side[side] + ((r->turn[patch] > 0) == at->against[side]);
    }
}

/** By curve: its patches, and in which direction these run along it. */
typedef struct curve_faces {
    uint32_t patch[2];
    bool against[2];
    uint32_t count;
} curve_faces;

/** How much a patch runs as the triangles under it do. */
static double measure_turn(const qm_router *r, const double *grid)
{
    const int corner[4] = {0, QM_LAYOUT_GRID, QM_LAYOUT_GRID_POINTS - 1,
                           QM_LAYOUT_GRID_POINTS - 1 - QM_LAYOUT_GRID};
    double sum = 0;
    for (int cell = 0; cell < QM_LAYOUT_GRID * QM_LAYOUT_GRID; cell++) {
        const double *at = grid + 3 * (cell / QM_LAYOUT_GRID * (QM_LAYOUT_GRID + 1) + cell % QM_LAYOUT_GRID);
        qm_vec p[4];
        for (int k = 0; k < 4; k++)
            p[k] = qm_vec_load(at + 3 * (corner[k] / QM_LAYOUT_GRID > 0 && k > 1 ? QM_LAYOUT_GRID + 1 : 0) +
                               3 * (k == 1 || k == 2));
        qm_tmesh_spot spot;
        if (!qm_tmesh_triangles_find(r->triangles, qm_vec_centroid(p, 4), &spot)) continue;
        sum += qm_vec_dot(qm_vec_cross(qm_vec_sub(p[2], p[0]), qm_vec_sub(p[3], p[1])),
                          qm_trimesh_normal(&r->triangles->mesh, spot.triangle));
    }
    return sum;
}

/** Turns the patches of a component alike, and as the triangles. False if it has one side only. */
static bool turn_component(qm_router *r, const curve_faces *faces, const double *grids, uint32_t first,
                           uint32_t *queue)
{
    const qm_layout *layout = r->layout;
    size_t head = 0, tail = 0;
    double sum = 0;
    r->turn[first] = 1;
    queue[tail++] = first;
    while (head < tail) {
        uint32_t patch = queue[head++];
        sum += r->turn[patch] * measure_turn(r, grids + (size_t)3 * QM_LAYOUT_GRID_POINTS * patch);
        for (int k = 0; k < 4; k++) {
            const curve_faces *at = &faces[layout->patches[patch].side[k]];
            if (at->count != 2) continue;
            uint32_t other = at->patch[0] == patch ? at->patch[1] : at->patch[0];
            int8_t turn = at->against[0] != at->against[1] ? r->turn[patch] : (int8_t)-r->turn[patch];
            if (r->turn[other] == 0) {
                r->turn[other] = turn;
                queue[tail++] = other;
            }
            if (r->turn[other] != turn) return false;
        }
    }
    for (size_t i = 0; i < tail && sum < 0; i++)
        r->turn[queue[i]] = (int8_t)-r->turn[queue[i]];
    return true;
}

bool qm_router_order_darts(qm_router *r, const double *grids, bool *is_ordered)
{
    const qm_layout *layout = r->layout;
    size_t darts = 2 * layout->curve_count;
    curve_faces *faces = qm_arena_zeroed(r->arena, layout->curve_count, sizeof *faces);
    uint32_t *queue = qm_arena_alloc(r->arena, layout->patch_count, sizeof *queue);
    r->left = qm_arena_alloc(r->arena, darts, sizeof *r->left);
    r->next = qm_arena_alloc(r->arena, darts, sizeof *r->next);
    r->before = qm_arena_alloc(r->arena, darts, sizeof *r->before);
    r->turn = qm_arena_zeroed(r->arena, layout->patch_count, sizeof *r->turn);
    *is_ordered = false;
    if (!faces || !queue || !r->left || !r->next || !r->before || !r->turn) return false;
    memset(r->left, 0xff, darts * sizeof *r->left);
    memset(r->next, 0xff, darts * sizeof *r->next);
    memset(r->before, 0xff, darts * sizeof *r->before);
    for (uint32_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++) {
            curve_faces *at = &faces[layout->patches[p].side[k]];
            if (at->count == 2) return true;
            at->patch[at->count] = p;
            at->against[at->count++] = layout->patches[p].against[k];
        }
    for (uint32_t p = 0; p < layout->patch_count; p++)
        if (r->turn[p] == 0 && !turn_component(r, faces, grids, p, queue)) return true;
    for (uint32_t p = 0; p < layout->patch_count; p++) {
        uint32_t dart[4];
        qm_router_patch_darts(r, p, dart);
        for (int k = 0; k < 4; k++) {
            uint32_t reversed = dart[(k + 3) & 3] ^ 1;
            if (r->left[dart[k]] != QM_NO_INDEX || r->before[reversed] != QM_NO_INDEX) return true;
            r->left[dart[k]] = p;
            r->next[dart[k]] = reversed;
            r->before[reversed] = dart[k];
        }
    }
    *is_ordered = true;
    return true;
}

bool qm_router_is_boundary(const qm_router *r, uint32_t curve)
{
    return r->left[2 * curve] == QM_NO_INDEX || r->left[2 * curve + 1] == QM_NO_INDEX;
}
