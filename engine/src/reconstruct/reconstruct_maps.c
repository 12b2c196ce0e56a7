/**
 * reconstruct_maps.c: lattices from maps of the patches over the triangles of the surface (tmesh_maps.h), where the layout covers an exact
 * mesh. They need no samples that may get into the wrong patch, and do not depend on where lattices were before. Maps are as large as the
 * mesh, and are not kept.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define GUIDE_POINTS 160 /* of a curve, at most */
#define MEETING_ROUNDS 4 /* of finding where a row and a column meet */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the maps of patches");
}

static void free_guides(qm_context *ctx, qm_tmesh_guides *guides)
{
    if (guides->first)
        qm_context_free(ctx, guides->points, guides->first[guides->count], sizeof *guides->points);
    qm_context_free(ctx, guides->first, guides->count + 1, sizeof *guides->first);
}

/** Points of the polylines, by curve; for free_guides, also after an error. */
static qm_status list_guides(qm_context *ctx, const qm_reconstruction *r, qm_tmesh_guides *out)
{
    size_t curves = r->layout.curve_count;
    *out = (qm_tmesh_guides){.count = curves};
    out->first = qm_context_alloc(ctx, curves + 1, sizeof *out->first);
    if (!out->first) return no_memory(ctx);
    out->first[0] = 0;
    for (size_t c = 0; c < curves; c++) {
        size_t count = r->polylines[c].point_count;
        out->first[c + 1] = out->first[c] + (count < GUIDE_POINTS ? count : GUIDE_POINTS);
    }
    out->points = qm_context_alloc(ctx, out->first[curves], sizeof *out->points);
    if (!out->points) return no_memory(ctx);
    for (size_t c = 0; c < curves; c++) {
        size_t last = out->first[c + 1] - out->first[c] - 1;
        for (size_t i = 0; i <= last; i++)
            out->points[out->first[c] + i] =
                qm_vec_load(r->polylines[c].points + 3 * ((r->polylines[c].point_count - 1) * i / last));
    }
    return QM_OK;
}

qm_status qm_maps_find(qm_context *ctx, const qm_reconstruction *r, qm_tmesh_maps **out)
{
    qm_tmesh_guides guides;
    size_t curves = r->layout.curve_count;
    *out = NULL;
    if (r->surface.is_cloud || r->guide || r->options.grids) return QM_OK;
    for (size_t c = 0; c < curves; c++)
        if (r->polylines[c].chord == QM_NO_INDEX) return QM_OK;
    bool *is_rough = qm_context_alloc(ctx, curves, sizeof *is_rough);
    for (size_t c = 0; c < curves && is_rough; c++)
        is_rough[c] = qm_polylines_has_jump(r, c);
    qm_status status = list_guides(ctx, r, &guides);
    if (status == QM_OK && !is_rough) status = no_memory(ctx);
    if (status == QM_OK) status = qm_tmesh_maps_make(ctx, &r->surface, &r->layout, &guides, is_rough, out);
    free_guides(ctx, &guides);
    qm_context_free(ctx, is_rough, curves, sizeof *is_rough);
    return status;
}

qm_status qm_maps_lay_jumps(qm_context *ctx, qm_reconstruction *r)
{
    size_t curves = r->layout.curve_count;
    qm_tmesh_maps *maps = NULL;
    bool has_jumps = false;
    for (size_t c = 0; c < curves; c++)
        has_jumps |= qm_polylines_has_jump(r, c);
    qm_status status = has_jumps ? qm_maps_find(ctx, r, &maps) : QM_OK;
    for (size_t c = 0; c < curves && maps && status == QM_OK; c++) {
        size_t count;
        const double *points = qm_tmesh_maps_path(maps, c, &count);
        if (qm_polylines_has_jump(r, c)) status = qm_polylines_follow(ctx, r, c, points, count);
    }
    qm_tmesh_maps_destroy(ctx, maps);
    return status;
}

/** The share of a side's length at each vertex of a row (direction 0) or column (1) of a lattice. */
static void list_shares(const qm_lattice *lattice, int direction, uint32_t line, double *share)
{
    uint32_t count = direction == 0 ? lattice->columns : lattice->rows;
    share[0] = 0.0;
    for (uint32_t i = 1; i <= count; i++) {
        qm_vec a = direction == 0 ? qm_lattice_at(lattice, i - 1, line) : qm_lattice_at(lattice, line, i - 1),
               b = direction == 0 ? qm_lattice_at(lattice, i, line) : qm_lattice_at(lattice, line, i);
        share[i] = share[i - 1] + qm_vec_distance(a, b);
    }
    for (uint32_t i = 1; i <= count; i++)
        share[i] = share[count] > 0.0 ? share[i] / share[count] : (double)i / count;
}

/** Starts a lattice: each inner vertex lies where its row and its column have their shares of the sides' lengths. share has room for two rows and two columns. */
static void start_lattice(const qm_reconstruction *r, size_t p, double *share)
{
    const qm_lattice *lattice = &r->lattices[p];
    double *low = share, *high = low + lattice->columns + 1, *left = high + lattice->columns + 1,
           *right = left + lattice->rows + 1;
    uint32_t triangle = 0;
    list_shares(lattice, 0, 0, low);
    list_shares(lattice, 0, lattice->rows, high);
    list_shares(lattice, 1, 0, left);
    list_shares(lattice, 1, lattice->columns, right);
    for (uint32_t j = 1; j < lattice->rows; j++)
        for (uint32_t i = 1; i < lattice->columns; i++) {
            double u = low[i], v = left[j];
            for (int round = 0; round < MEETING_ROUNDS; round++) {
                u = low[i] + v * (high[i] - low[i]);
                v = left[j] + u * (right[j] - left[j]);
            }
            qm_vec at;
            if (qm_tmesh_maps_at(r->maps, p, u, v, &triangle, &at))
                qm_vec_store(qm_lattice_vertex(lattice, i, j), at);
        }
}

qm_status qm_maps_start(qm_context *ctx, qm_reconstruction *r)
{
    size_t most = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        size_t size = 2 * ((size_t)r->lattices[p].columns + r->lattices[p].rows + 2);
        most = size > most ? size : most;
    }
    double *share = qm_context_alloc(ctx, most, sizeof *share);
    if (!share) return no_memory(ctx);
    for (size_t p = 0; p < r->layout.patch_count; p++)
        start_lattice(r, p, share);
    qm_context_free(ctx, share, most, sizeof *share);
    return QM_OK;
}
