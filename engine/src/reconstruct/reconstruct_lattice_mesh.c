/**
 * reconstruct_lattice_mesh.c: lattices to one mesh, what of it is marked, and its boundary.
 *
 * Vertices are numbered nodes first, then the inner vertices of each curve, then those of each patch, so that
 * patches share the vertices of their curves. The boundary consists of the curves that one patch only has:
 * beyond it nothing was drawn.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define SIDE_TOLERANCE 1e-9 /* of a quad: parameters nearer to a side lie on it */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the boundary of the patches");
}

/** The numbering of a mesh. */
typedef struct numbering {
    const qm_reconstruction *r;
    bool fine;
    uint32_t *node;  /* vertex of each node; QM_NO_INDEX if no patch has it */
    uint32_t *curve; /* first inner vertex of each curve */
    size_t vertex_count, face_count;
} numbering;

static uint32_t chord_count(const numbering *n, const qm_chord *chord)
{
    return n->fine ? chord->lattice_edges : chord->edges;
}

static uint32_t curve_edges(const numbering *n, uint32_t curve)
{
    return chord_count(n, &n->r->chords[n->r->polylines[curve].chord]);
}

/** The mesh vertex of vertex k along a side, counted from corner `side`. */
static uint32_t find_side_vertex(const numbering *n, const qm_layout_patch *patch, int side, uint32_t k)
{
    uint32_t curve = patch->side[side], edges = curve_edges(n, curve);
    if (k == 0) return n->node[qm_layout_corner(&n->r->layout, patch, side)];
    if (k == edges) return n->node[qm_layout_corner(&n->r->layout, patch, (side + 1) % 4)];
    return n->curve[curve] + (patch->against[side] ? edges - k : k) - 1;
}

static uint32_t find_vertex(const numbering *n, const qm_layout_patch *patch, uint32_t columns, uint32_t rows,
                            uint32_t first, uint32_t i, uint32_t j)
{
    if (j == 0) return find_side_vertex(n, patch, 0, i);
    if (j == rows) return find_side_vertex(n, patch, 2, columns - i);
    if (i == columns) return find_side_vertex(n, patch, 1, j);
    if (i == 0) return find_side_vertex(n, patch, 3, rows - j);
    return first + (j - 1) * (columns - 1) + i - 1;
}

/**
 * Takes every n-th vertex of a lattice. Quads that are folded after that, though none of the finer lattice
 * was, are untangled.
 */
static qm_status thin_lattice(qm_context *ctx, const numbering *n, size_t p, qm_lattice *out)
{
    const qm_lattice *lattice = &n->r->lattices[p];
    *out = (qm_lattice){.columns = chord_count(n, qm_chord_of_patch(n->r, p, 0)),
                        .rows = chord_count(n, qm_chord_of_patch(n->r, p, 1))};
    if (!qm_lattice_allocate(ctx, out))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a patch");
    uint32_t across = lattice->columns / out->columns, down = lattice->rows / out->rows;
    for (uint32_t j = 0; j <= out->rows; j++)
        for (uint32_t i = 0; i <= out->columns; i++)
            memcpy(qm_lattice_vertex(out, i, j), qm_lattice_vertex(lattice, i * across, j * down),
                   POINT_SIZE);
    if (across > 1 || down > 1) qm_lattice_untangle(&n->r->surface, out);
    return QM_OK;
}

static qm_status fill_mesh(qm_context *ctx, const numbering *n, uint32_t first, qm_mesh *out)
{
    uint32_t *faces = out->faces;
    for (size_t p = 0; p < n->r->layout.patch_count; p++) {
        qm_lattice lattice;
        qm_status status = thin_lattice(ctx, n, p, &lattice);
        if (status != QM_OK) return status;
        out->grids[p] = (qm_mesh_grid){lattice.rows, lattice.columns};
        /* The vertices and faces of the patch; first is the index of its first inner vertex. */
        uint32_t columns = lattice.columns, rows = lattice.rows;
        for (uint32_t j = 0; j <= rows; j++) {
            for (uint32_t i = 0; i <= columns; i++) {
                uint32_t vertex = find_vertex(n, &n->r->layout.patches[p], columns, rows, first, i, j);
                memcpy(out->positions + 3 * (size_t)vertex, qm_lattice_vertex(&lattice, i, j), POINT_SIZE);
                if (i == columns || j == rows) continue;
                uint32_t *face = faces + 4 * ((size_t)j * columns + i);
                face[0] = vertex;
                face[1] = find_vertex(n, &n->r->layout.patches[p], columns, rows, first, i + 1, j);
                face[2] = find_vertex(n, &n->r->layout.patches[p], columns, rows, first, i + 1, j + 1);
                face[3] = find_vertex(n, &n->r->layout.patches[p], columns, rows, first, i, j + 1);
            }
        }
        first += (lattice.columns - 1) * (lattice.rows - 1);
        faces += 4 * (size_t)lattice.columns * lattice.rows;
        qm_lattice_free(ctx, &lattice);
    }
    return QM_OK;
}

/** Numbers the nodes and the inner vertices of curves. */
static void number_curves(numbering *n)
{
    const qm_layout *layout = &n->r->layout;
    for (size_t i = 0; i < layout->node_count; i++)
        n->node[i] = QM_NO_INDEX;
    for (size_t i = 0; i < layout->curve_count; i++) {
        if (n->r->polylines[i].chord == QM_NO_INDEX) continue;
        const uint32_t end[2] = {layout->curves[i].from, layout->curves[i].to};
        for (int k = 0; k < 2; k++)
            if (n->node[end[k]] == QM_NO_INDEX) n->node[end[k]] = (uint32_t)n->vertex_count++;
    }
    for (size_t i = 0; i < layout->curve_count; i++) {
        if (n->r->polylines[i].chord == QM_NO_INDEX) continue;
        n->curve[i] = (uint32_t)n->vertex_count;
        n->vertex_count += curve_edges(n, (uint32_t)i) - 1;
    }
}

static qm_status make_mesh(qm_context *ctx, numbering *n, qm_mesh *out)
{
    const qm_layout *layout = &n->r->layout;
    number_curves(n);
    for (size_t p = 0; p < layout->patch_count; p++) {
        size_t columns = chord_count(n, qm_chord_of_patch(n->r, p, 0));
        size_t rows = chord_count(n, qm_chord_of_patch(n->r, p, 1));
        n->vertex_count += (columns - 1) * (rows - 1);
        n->face_count += columns * rows;
    }
    if (n->vertex_count >= QM_NO_INDEX || n->face_count >= QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "the mesh would have %zu quads", n->face_count);
    uint32_t first = (uint32_t)n->vertex_count;
    for (size_t p = 0; p < n->r->layout.patch_count; p++)
        first -= (chord_count(n, qm_chord_of_patch(n->r, p, 0)) - 1) *
                 (chord_count(n, qm_chord_of_patch(n->r, p, 1)) - 1);
    out->vertex_count = n->vertex_count;
    out->face_count = n->face_count;
    out->positions = qm_context_alloc(ctx, n->vertex_count, POINT_SIZE);
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

qm_status qm_lattices_mesh(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_mesh *out)
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

static void mark_vertices(const numbering *n, qm_quads_marks *out)
{
    const qm_layout *layout = &n->r->layout;
    for (size_t i = 0; i < layout->corner_count; i++)
        if (n->node[layout->corners[i]] != QM_NO_INDEX) out->stays[n->node[layout->corners[i]]] = true;
    for (uint32_t c = 0; c < layout->curve_count; c++) {
        const qm_curve *curve = &layout->curves[c];
        if (curve->mark != QM_CURVE_FIXED || n->r->polylines[c].chord == QM_NO_INDEX) continue;
        out->stays[n->node[curve->from]] = out->stays[n->node[curve->to]] = true;
        memset(out->stays + n->curve[c], true, curve_edges(n, c) - 1);
    }
}

/** Marks the sides of faces along sharp curves. */
static void mark_sides(const numbering *n, qm_quads_marks *out)
{
    size_t first = 0;
    for (size_t p = 0; p < n->r->layout.patch_count; p++) {
        const qm_layout_patch *patch = &n->r->layout.patches[p];
        size_t columns = chord_count(n, qm_chord_of_patch(n->r, p, 0));
        size_t rows = chord_count(n, qm_chord_of_patch(n->r, p, 1));
        const size_t start[4] = {0, columns - 1, (rows - 1) * columns, 0}, step[4] = {1, columns, 1, columns};
        for (int k = 0; k < 4; k++) {
            if (n->r->layout.curves[patch->side[k]].mark != QM_CURVE_SHARP) continue;
            for (size_t i = 0; i < (k % 2 == 0 ? columns : rows); i++)
                out->sharp[first + start[k] + i * step[k]] |= (uint8_t)(1 << k);
        }
        first += columns * rows;
    }
}

/** Counts the segments of sharp curves, and writes them if rows is not NULL. */
static size_t list_lines(const qm_reconstruction *r, double *rows)
{
    size_t count = 0;
    for (size_t c = 0; c < r->layout.curve_count; c++) {
        const qm_polyline *polyline = &r->polylines[c];
        if (r->layout.curves[c].mark != QM_CURVE_SHARP || polyline->chord == QM_NO_INDEX) continue;
        for (size_t i = 0; i + 1 < polyline->point_count; i++, count++)
            if (rows) memcpy(rows + 6 * count, polyline->points + 3 * i, (size_t)2 * POINT_SIZE);
    }
    return count;
}

static qm_status find_marks(qm_context *ctx, numbering *n, qm_quads_marks *out)
{
    number_curves(n);
    for (size_t p = 0; p < n->r->layout.patch_count; p++) {
        size_t columns = chord_count(n, qm_chord_of_patch(n->r, p, 0)),
               rows = chord_count(n, qm_chord_of_patch(n->r, p, 1));
        n->vertex_count += (columns - 1) * (rows - 1);
        n->face_count += columns * rows;
    }
    out->vertex_count = n->vertex_count;
    out->face_count = n->face_count;
    out->line_count = list_lines(n->r, NULL);
    out->stays = qm_context_alloc(ctx, out->vertex_count, 1);
    out->sharp = qm_context_alloc(ctx, out->face_count, 1);
    if (out->line_count > 0) out->lines = qm_context_alloc(ctx, out->line_count, 6 * sizeof *out->lines);
    if (!out->stays || !out->sharp || (out->line_count > 0 && !out->lines)) {
        qm_quads_marks_reset(ctx, out);
        return no_memory(ctx);
    }
    memset(out->stays, 0, out->vertex_count);
    memset(out->sharp, 0, out->face_count);
    mark_vertices(n, out);
    mark_sides(n, out);
    list_lines(n->r, out->lines);
    return QM_OK;
}

qm_status qm_lattices_find_marks(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_quads_marks *out)
{
    const qm_layout *layout = &r->layout;
    bool has_marks = layout->corner_count > 0;
    for (size_t c = 0; c < layout->curve_count; c++)
        has_marks |= layout->curves[c].mark != QM_CURVE_SMOOTH;
    *out = (qm_quads_marks){0};
    if (!has_marks) return QM_OK;
    numbering n = {.r = r, .fine = fine};
    n.node = qm_context_alloc(ctx, layout->node_count, sizeof *n.node);
    n.curve = qm_context_alloc(ctx, layout->curve_count, sizeof *n.curve);
    qm_status status = n.node && n.curve ? find_marks(ctx, &n, out) : no_memory(ctx);
    qm_context_free(ctx, n.node, layout->node_count, sizeof *n.node);
    qm_context_free(ctx, n.curve, layout->curve_count, sizeof *n.curve);
    return status;
}

qm_status qm_lattices_set(qm_context *ctx, qm_reconstruction *r, const qm_mesh *mesh)
{
    const qm_layout *layout = &r->layout;
    numbering n = {.r = r, .fine = true};
    n.node = qm_context_alloc(ctx, layout->node_count, sizeof *n.node);
    n.curve = qm_context_alloc(ctx, layout->curve_count, sizeof *n.curve);
    qm_status status = n.node && n.curve ? QM_OK : no_memory(ctx);
    if (status == QM_OK) number_curves(&n);
    for (size_t c = 0; c < layout->curve_count && status == QM_OK; c++) {
        const qm_polyline *polyline = &r->polylines[c];
        if (polyline->chord == QM_NO_INDEX) continue;
        for (uint32_t k = 0; k <= polyline->vertex_edges; k++) {
            uint32_t vertex = k == 0                        ? n.node[layout->curves[c].from]
                              : k == polyline->vertex_edges ? n.node[layout->curves[c].to]
                                                            : n.curve[c] + k - 1;
            memcpy(polyline->vertices + 3 * (size_t)k, mesh->positions + 3 * (size_t)vertex, POINT_SIZE);
        }
    }
    size_t first = n.vertex_count;
    for (size_t p = 0; p < layout->patch_count && status == QM_OK; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        for (uint32_t j = 0; j <= lattice->rows; j++)
            for (uint32_t i = 0; i <= lattice->columns; i++) {
                uint32_t vertex = find_vertex(&n, &layout->patches[p], lattice->columns, lattice->rows,
                                              (uint32_t)first, i, j);
                memcpy(qm_lattice_vertex(lattice, i, j), mesh->positions + 3 * (size_t)vertex, POINT_SIZE);
            }
        first += (size_t)(lattice->columns - 1) * (lattice->rows - 1);
    }
    qm_context_free(ctx, n.node, layout->node_count, sizeof *n.node);
    qm_context_free(ctx, n.curve, layout->curve_count, sizeof *n.curve);
    return status;
}

size_t qm_lattices_find_patch(const size_t *first, size_t patch_count, uint32_t face)
{
    size_t low = 0, high = patch_count;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (first[middle] <= face)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/** The number of patch sides that each curve is; NULL when out of memory. */
static uint32_t *count_uses(qm_context *ctx, const qm_layout *layout)
{
    uint32_t *uses = qm_context_alloc(ctx, layout->curve_count, sizeof *uses);
    if (!uses) return NULL;
    memset(uses, 0, layout->curve_count * sizeof *uses);
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++)
            uses[layout->patches[p].side[k]]++;
    return uses;
}

qm_status qm_reconstruction_boundary(qm_context *ctx, const qm_reconstruction *r, double **points,
                                     size_t *count)
{
    QM_ASSERT(ctx && r && points && count);
    *points = NULL;
    *count = 0;
    uint32_t *uses = count_uses(ctx, &r->layout);
    if (!uses) return no_memory(ctx);
    size_t curves = r->layout.curve_count, done = 0;
    for (size_t c = 0; c < curves; c++)
        if (uses[c] == 1) *count += r->polylines[c].point_count;
    if (*count > 0) *points = qm_context_alloc(ctx, *count, POINT_SIZE);
    for (size_t c = 0; c < curves && *points; c++) {
        if (uses[c] != 1) continue;
        memcpy(*points + 3 * done, r->polylines[c].points, r->polylines[c].point_count * POINT_SIZE);
        done += r->polylines[c].point_count;
    }
    qm_context_free(ctx, uses, curves, sizeof *uses);
    return *count > 0 && !*points ? no_memory(ctx) : QM_OK;
}

/** True if a point of a patch, given by one of its faces, lies on a side that one patch only has. */
static bool is_on_boundary(const qm_reconstruction *r, size_t p, const uint32_t *uses, size_t face,
                           const double uv[2])
{
    size_t columns = qm_chord_of_patch(r, p, 0)->edges, rows = qm_chord_of_patch(r, p, 1)->edges;
    size_t column = face % columns, row = face / columns;
    const bool on_side[4] = {
        row == 0 && uv[1] <= SIDE_TOLERANCE, column + 1 == columns && uv[0] >= 1.0 - SIDE_TOLERANCE,
        row + 1 == rows && uv[1] >= 1.0 - SIDE_TOLERANCE, column == 0 && uv[0] <= SIDE_TOLERANCE};
    for (int k = 0; k < 4; k++)
        if (on_side[k] && uses[r->layout.patches[p].side[k]] == 1) return true;
    return false;
}

qm_status qm_reconstruction_mark_boundary(qm_context *ctx, const qm_reconstruction *r, const uint32_t *faces,
                                          const double *uv, size_t count, bool *on_boundary)
{
    size_t patches = r->layout.patch_count;
    uint32_t *uses = count_uses(ctx, &r->layout);
    size_t *first = qm_context_alloc(ctx, patches, sizeof *first), face_count = 0;
    qm_status status = uses && first ? QM_OK : no_memory(ctx);
    for (size_t p = 0; p < patches && status == QM_OK; p++) {
        first[p] = face_count;
        face_count += (size_t)qm_chord_of_patch(r, p, 0)->edges * qm_chord_of_patch(r, p, 1)->edges;
    }
    for (size_t i = 0; i < count && status == QM_OK; i++) {
        QM_ASSERT(faces[i] < face_count);
        size_t p = qm_lattices_find_patch(first, patches, faces[i]);
        on_boundary[i] = is_on_boundary(r, p, uses, faces[i] - first[p], uv + 2 * i);
    }
    qm_context_free(ctx, uses, r->layout.curve_count, sizeof *uses);
    qm_context_free(ctx, first, patches, sizeof *first);
    return status;
}
