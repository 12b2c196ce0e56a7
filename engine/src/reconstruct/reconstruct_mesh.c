/**
 * reconstruct_mesh.c: grids to one mesh. Nodes come first, then the inner vertices of each curve, then those
 * of each patch, so that patches share what lies on their curves.
 */
#include "reconstruct_work.h"

#include <string.h>

enum { ROW = 3 * sizeof(double) };

/** How a mesh is numbered. */
typedef struct numbering {
    const qm_reconstruction *r;
    bool fine;
    uint32_t *node;  /* of the layout, QM_NO_INDEX where no patch has it */
    uint32_t *curve; /* first inner vertex of each curve */
    size_t vertex_count, face_count;
} numbering;

static uint32_t chord_count(const numbering *n, const qm_chord *chord)
{
    return n->fine ? chord->work : chord->edges;
}

static uint32_t curve_edges(const numbering *n, uint32_t curve)
{
    return chord_count(n, &n->r->chords[n->r->tracks[curve].chord]);
}

static void number_vertices(numbering *n)
{
    const qm_layout *layout = &n->r->layout;
    for (size_t i = 0; i < layout->node_count; i++)
        n->node[i] = QM_NO_INDEX;
    for (size_t i = 0; i < layout->curve_count; i++) {
        if (n->r->tracks[i].chord == QM_NO_INDEX) continue;
        const uint32_t end[2] = {layout->curves[i].from, layout->curves[i].to};
        for (int k = 0; k < 2; k++)
            if (n->node[end[k]] == QM_NO_INDEX) n->node[end[k]] = (uint32_t)n->vertex_count++;
    }
    for (size_t i = 0; i < layout->curve_count; i++) {
        if (n->r->tracks[i].chord == QM_NO_INDEX) continue;
        n->curve[i] = (uint32_t)n->vertex_count;
        n->vertex_count += curve_edges(n, (uint32_t)i) - 1;
    }
    for (size_t p = 0; p < layout->patch_count; p++) {
        size_t columns = chord_count(n, qm_patch_chord(n->r, p, 0));
        size_t rows = chord_count(n, qm_patch_chord(n->r, p, 1));
        n->vertex_count += (columns - 1) * (rows - 1);
        n->face_count += columns * rows;
    }
}

/** The number of vertex k along a side, from corner `side` on. */
static uint32_t side_vertex(const numbering *n, const qm_layout_patch *patch, int side, uint32_t k)
{
    uint32_t curve = patch->side[side], edges = curve_edges(n, curve);
    if (k == 0) return n->node[qm_layout_corner(&n->r->layout, patch, side)];
    if (k == edges) return n->node[qm_layout_corner(&n->r->layout, patch, (side + 1) % 4)];
    return n->curve[curve] + (patch->against[side] ? edges - k : k) - 1;
}

static uint32_t grid_vertex(const numbering *n, const qm_layout_patch *patch, uint32_t columns, uint32_t rows,
                            uint32_t first, uint32_t i, uint32_t j)
{
    if (j == 0) return side_vertex(n, patch, 0, i);
    if (j == rows) return side_vertex(n, patch, 2, columns - i);
    if (i == columns) return side_vertex(n, patch, 1, j);
    if (i == 0) return side_vertex(n, patch, 3, rows - j);
    return first + (j - 1) * (columns - 1) + i - 1;
}

/** Every so manieth vertex of a patch. Quads that come out folded are smoothed out here: in the finer grid
 * none may be. */
static qm_status thin_grid(qm_context *ctx, const numbering *n, size_t p, qm_patch_grid *out)
{
    const qm_patch_grid *grid = &n->r->grids[p];
    *out = (qm_patch_grid){.columns = chord_count(n, qm_patch_chord(n->r, p, 0)),
                           .rows = chord_count(n, qm_patch_chord(n->r, p, 1))};
    if (!qm_grid_allocate(ctx, out)) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a patch");
    uint32_t across = grid->columns / out->columns, down = grid->rows / out->rows;
    for (uint32_t j = 0; j <= out->rows; j++)
        for (uint32_t i = 0; i <= out->columns; i++)
            memcpy(qm_grid_vertex(out, i, j), qm_grid_vertex(grid, i * across, j * down), ROW);
    if (across > 1 || down > 1) qm_grid_untangle(&n->r->source, out);
    return QM_OK;
}

/** Vertices and faces of a patch; first is the number of its first inner vertex. */
static void add_grid(const numbering *n, const qm_layout_patch *patch, const qm_patch_grid *grid,
                     uint32_t first, uint32_t *faces, double *positions)
{
    uint32_t columns = grid->columns, rows = grid->rows;
    for (uint32_t j = 0; j <= rows; j++) {
        for (uint32_t i = 0; i <= columns; i++) {
            uint32_t vertex = grid_vertex(n, patch, columns, rows, first, i, j);
            memcpy(positions + 3 * (size_t)vertex, qm_grid_vertex(grid, i, j), ROW);
            if (i == columns || j == rows) continue;
            uint32_t *face = faces + 4 * ((size_t)j * columns + i);
            face[0] = vertex;
            face[1] = grid_vertex(n, patch, columns, rows, first, i + 1, j);
            face[2] = grid_vertex(n, patch, columns, rows, first, i + 1, j + 1);
            face[3] = grid_vertex(n, patch, columns, rows, first, i, j + 1);
        }
    }
}

static qm_status fill_mesh(qm_context *ctx, const numbering *n, uint32_t first, qm_mesh *out)
{
    uint32_t *faces = out->faces;
    for (size_t p = 0; p < n->r->layout.patch_count; p++) {
        qm_patch_grid grid;
        qm_status status = thin_grid(ctx, n, p, &grid);
        if (status != QM_OK) return status;
        out->grids[p] = (qm_mesh_grid){grid.rows, grid.columns};
        add_grid(n, &n->r->layout.patches[p], &grid, first, faces, out->positions);
        first += (grid.columns - 1) * (grid.rows - 1);
        faces += 4 * (size_t)grid.columns * grid.rows;
        qm_grid_free(ctx, &grid);
    }
    return QM_OK;
}

static qm_status make_mesh(qm_context *ctx, numbering *n, qm_mesh *out)
{
    number_vertices(n);
    if (n->vertex_count >= QM_NO_INDEX || n->face_count >= QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "the mesh would have %zu quads", n->face_count);
    uint32_t first = (uint32_t)n->vertex_count;
    for (size_t p = 0; p < n->r->layout.patch_count; p++)
        first -= (chord_count(n, qm_patch_chord(n->r, p, 0)) - 1) *
                 (chord_count(n, qm_patch_chord(n->r, p, 1)) - 1);
    out->vertex_count = n->vertex_count;
    out->face_count = n->face_count;
    out->positions = qm_context_alloc(ctx, n->vertex_count, ROW);
    out->faces = qm_context_alloc(ctx, n->face_count, 4 * sizeof *out->faces);
    out->grid_count = n->r->layout.patch_count;
    out->grids = qm_context_alloc(ctx, out->grid_count, sizeof *out->grids);
    if (!out->positions || !out->faces || !out->grids) {
        qm_mesh_reset(ctx, out);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for %zu quads", n->face_count);
    }
    qm_status status = fill_mesh(ctx, n, first, out);
    if (status != QM_OK) qm_mesh_reset(ctx, out);
    return status;
}

qm_status qm_grids_mesh(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_mesh *out)
{
    const qm_layout *layout = &r->layout;
    numbering n = {.r = r, .fine = fine};
    *out = (qm_mesh){0};
    n.node = qm_context_alloc(ctx, layout->node_count, sizeof *n.node);
    n.curve = qm_context_alloc(ctx, layout->curve_count, sizeof *n.curve);
    qm_status status = QM_E_NO_MEMORY;
    if (n.node && n.curve)
        status = make_mesh(ctx, &n, out);
    else
        qm_context_fail(ctx, status, "out of memory for the mesh");
    qm_context_free(ctx, n.node, layout->node_count, sizeof *n.node);
    qm_context_free(ctx, n.curve, layout->curve_count, sizeof *n.curve);
    return status;
}
