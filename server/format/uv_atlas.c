/**
 * uv_atlas.c: the rectangles of patches on shelves, and the vertices in them.
 */
#include "uv_atlas.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Cells between two rectangles and round them all: a picture that is drawn up to the edge of one does not show on the next. */
#define GAP 0.5
/* Widths of shelves that are tried, from the side of a square of the rectangles' area on, in steps of a fraction of it: shelves
 * are not full at their ends. */
#define WIDTHS 16
#define WIDTH_STEP 0.02

enum { POINT_SIZE = 3 * sizeof(double) };

/** The rectangle of a patch, in cells. */
typedef struct rectangle {
    size_t patch;
    uint32_t columns, rows;
    double x, y; /* of its first corner */
} rectangle;

/** High ones first, wide ones before narrow ones, so that the order is always the same. */
static int compare(const void *a, const void *b)
{
    const rectangle *p = a, *q = b;
    if (p->rows != q->rows) return p->rows < q->rows ? 1 : -1;
    if (p->columns != q->columns) return p->columns < q->columns ? 1 : -1;
    return p->patch < q->patch ? -1 : 1;
}

static int compare_patches(const void *a, const void *b)
{
    const rectangle *p = a, *q = b;
    return p->patch < q->patch ? -1 : 1;
}

/** Puts sorted rectangles on shelves of some width, each as high as the first one on it; returns the side of the square that
 * holds all. */
static double fill_shelves(rectangle *all, size_t count, double width)
{
    double used = 0.0, x = GAP, y = GAP, height = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (x + all[i].columns + GAP > width) {
            y += height + GAP;
            x = GAP;
            height = 0.0;
        }
        all[i].x = x;
        all[i].y = y;
        x += all[i].columns + GAP;
        height = fmax(height, all[i].rows);
        used = fmax(used, x);
    }
    return fmax(used, y + height + GAP);
}

/** Places the rectangles, and returns the side of the square that holds all: the smallest for some widths of shelves. */
static double place(rectangle *all, size_t count)
{
    double area = 0.0, widest = 0.0, best = INFINITY, best_width = 0.0;
    for (size_t i = 0; i < count; i++) {
        area += (all[i].columns + GAP) * (all[i].rows + GAP);
        widest = fmax(widest, all[i].columns + 2.0 * GAP);
    }
    qsort(all, count, sizeof *all, compare);
    for (int i = 0; i < WIDTHS; i++) {
        double width = fmax(sqrt(area) * (1.0 + WIDTH_STEP * i) + GAP, widest);
        double side = fill_shelves(all, count, width);
        if (side >= best) continue;
        best = side;
        best_width = width;
    }
    fill_shelves(all, count, best_width);
    qsort(all, count, sizeof *all, compare_patches);
    return best;
}

/** Offset of a position of a cell, as of qm_patch_corner. */
static uint32_t right_of(unsigned position)
{
    return position == 1 || position == 2;
}

static uint32_t up_of(unsigned position)
{
    return position >= 2;
}

/** Writes the vertices of a patch, from base on, and its faces; returns how many vertices there are. */
static uint32_t fill_patch(const qm_mesh *mesh, const qm_patch_set *set, const rectangle *at, double side,
                           uint32_t base, qm_uv_atlas *out)
{
    const qm_regular_patch *patch = &set->patches[at->patch];
    bool is_triangle = mesh->faces[4 * (size_t)set->faces[patch->first] + 3] == QM_NO_INDEX;
    bool is_mirrored = !is_triangle && (set->turns[patch->first] & 4);
    unsigned corners = is_triangle ? 3 : 4;
    for (uint32_t r = 0; r < patch->rows; r++)
        for (uint32_t c = 0; c < patch->columns; c++) {
            size_t entry = patch->first + (size_t)r * patch->columns + c, face = set->faces[entry];
            for (unsigned position = 0; position < corners; position++) {
                unsigned corner = is_triangle ? position : qm_patch_corner(set->turns[entry], position);
                uint32_t i = c + right_of(position), j = r + up_of(position);
                uint32_t vertex = base + (is_triangle ? position : j * (patch->columns + 1) + i);
                out->mesh.faces[4 * face + corner] = vertex;
                memcpy(out->mesh.positions + 3 * (size_t)vertex,
                       mesh->positions + 3 * (size_t)mesh->faces[4 * face + corner], POINT_SIZE);
                out->uv[2 * (size_t)vertex] = (at->x + (is_mirrored ? patch->columns - i : i)) / side;
                out->uv[2 * (size_t)vertex + 1] = (at->y + j) / side;
            }
            if (is_triangle) out->mesh.faces[4 * face + 3] = QM_NO_INDEX;
        }
    return is_triangle ? 3 : (patch->rows + 1) * (patch->columns + 1);
}

static qm_status check(qm_context *ctx, const qm_mesh *mesh, const qm_patch_set *patches)
{
    if (patches->patch_count == 0 || mesh->face_count == 0)
        return qm_context_fail(ctx, QM_E_UNSUPPORTED, "the mesh has no quads, and so no patches to lay out");
    if (mesh->polygon_count > 0)
        return qm_context_fail(ctx, QM_E_UNSUPPORTED,
                               "%zu faces have five corners or more: they lie in no patch",
                               mesh->polygon_count);
    return QM_OK;
}

/** Vertices of the mesh whose patches are apart. */
static size_t count_vertices(const qm_mesh *mesh, const qm_patch_set *set)
{
    size_t count = 0;
    for (size_t p = 0; p < set->patch_count; p++) {
        const qm_regular_patch *patch = &set->patches[p];
        bool is_triangle = mesh->faces[4 * (size_t)set->faces[patch->first] + 3] == QM_NO_INDEX;
        count += is_triangle ? 3 : (size_t)(patch->rows + 1) * (patch->columns + 1);
    }
    return count;
}

/** Allocates the arrays; false when out of memory. */
static bool allocate(qm_context *ctx, const qm_mesh *mesh, const qm_patch_set *patches, qm_uv_atlas *out)
{
    *out = (qm_uv_atlas){.mesh = {.vertex_count = count_vertices(mesh, patches),
                                  .face_count = mesh->face_count,
                                  .grid_count = mesh->grid_count}};
    out->mesh.positions = qm_context_alloc(ctx, out->mesh.vertex_count, POINT_SIZE);
    out->mesh.faces = qm_context_alloc(ctx, mesh->face_count, 4 * sizeof *out->mesh.faces);
    out->uv = qm_context_alloc(ctx, out->mesh.vertex_count, 2 * sizeof *out->uv);
    if (mesh->grid_count > 0)
        out->mesh.grids = qm_context_alloc(ctx, mesh->grid_count, sizeof *out->mesh.grids);
    if (out->mesh.grids) memcpy(out->mesh.grids, mesh->grids, mesh->grid_count * sizeof *mesh->grids);
    return out->mesh.positions && out->mesh.faces && out->uv && (mesh->grid_count == 0 || out->mesh.grids);
}

qm_status qm_uv_atlas_make(qm_context *ctx, const qm_mesh *mesh, const qm_patch_set *patches,
                           qm_uv_atlas *out)
{
    *out = (qm_uv_atlas){0};
    qm_status status = check(ctx, mesh, patches);
    if (status != QM_OK) return status;
    rectangle *all = qm_context_alloc(ctx, patches->patch_count, sizeof *all);
    bool has_room = all && allocate(ctx, mesh, patches, out);
    for (size_t p = 0; has_room && p < patches->patch_count; p++)
        all[p] = (rectangle){p, patches->patches[p].columns, patches->patches[p].rows, 0.0, 0.0};
    if (has_room) {
        double side = place(all, patches->patch_count);
        uint32_t base = 0;
        for (size_t p = 0; p < patches->patch_count; p++)
            base += fill_patch(mesh, patches, &all[p], side, base, out);
        QM_ASSERT(base == out->mesh.vertex_count);
    }
    qm_context_free(ctx, all, patches->patch_count, sizeof *all);
    if (has_room) return QM_OK;
    qm_uv_atlas_reset(ctx, out);
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for texture coordinates");
}

void qm_uv_atlas_reset(qm_context *ctx, qm_uv_atlas *atlas)
{
    qm_context_free(ctx, atlas->uv, atlas->mesh.vertex_count, 2 * sizeof *atlas->uv);
    qm_mesh_reset(ctx, &atlas->mesh);
    atlas->uv = NULL;
}
