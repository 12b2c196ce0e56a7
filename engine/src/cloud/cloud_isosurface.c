/**
 * cloud_isosurface.c: marching tetrahedra, whose cases have no ambiguity.
 *
 * The six tetrahedra of a cell are the ways from its lowest corner to its highest along one axis after the other (H. Freudenthal,
 * Simplizialzerlegungen von beschraenkter Flachheit, 1942). So each edge of a tetrahedron runs from a node to one that has more of some
 * coordinates, and its key is the key of the first and those axes.
 */
#include "cloud_isosurface.h"

#define MIN_SHARE 0.02 /* of an edge between a vertex and a node: no triangle without area */

void qm_cloud_triangles_reset(qm_context *ctx, qm_cloud_triangles *triangles)
{
    qm_context_free(ctx, triangles->position, triangles->vertex_capacity, sizeof *triangles->position);
    qm_context_free(ctx, triangles->corner, triangles->capacity, sizeof *triangles->corner);
    *triangles = (qm_cloud_triangles){0};
}

bool qm_cloud_crosses(const qm_cloud_grid *grid, const double *field, size_t cell)
{
    uint32_t corner[8];
    int above = 0;
    qm_cloud_grid_corners(grid, cell, corner);
    for (int i = 0; i < 8; i++)
        above += field[corner[i]] >= 0.0;
    return above > 0 && above < 8;
}

/** The corners of a cell that its tetrahedra pass, by axes: 1, 2 and 4. */
static const int tetrahedra[6][4] = {{0, 1, 3, 7}, {0, 2, 3, 7}, {0, 2, 6, 7},
                                     {0, 4, 6, 7}, {0, 4, 5, 7}, {0, 1, 5, 7}};
/** Whether the corners of a tetrahedron, as they are listed, are a right-handed system: an even permutation of the axes. */
static const bool is_right[6] = {true, false, true, false, true, false};

typedef struct marcher {
    const qm_cloud_grid *grid;
    const double *field;
    qm_cloud_triangles *out;
    uint32_t (*vertex)
        [8]; /* of each node, on the edge from it along the axes of 1 to 7; QM_NO_INDEX where there is none */
} marcher;

/** The vertex between two corners of a cell, the lower first. */
static uint32_t find_vertex(marcher *m, const uint32_t corner[8], int from, int to)
{
    uint32_t low = corner[from], high = corner[to], *slot = &m->vertex[low][from ^ to];
    if (*slot != QM_NO_INDEX) return *slot;
    double a = m->field[low], b = m->field[high];
    double share = qm_clamp(a / (a - b), MIN_SHARE, 1.0 - MIN_SHARE);
    *slot = (uint32_t)m->out->vertex_count;
    m->out->position[m->out->vertex_count++] =
        qm_vec_mix(qm_cloud_grid_node(m->grid, low), qm_cloud_grid_node(m->grid, high), share);
    return *slot;
}

static uint32_t vertex_between(marcher *m, const uint32_t corner[8], int a, int b)
{
    return a < b ? find_vertex(m, corner, a, b) : find_vertex(m, corner, b, a);
}

static void add_triangle(marcher *m, uint32_t a, uint32_t b, uint32_t c, bool is_turned)
{
    uint32_t *row = m->out->corner[m->out->count++];
    row[0] = a;
    row[1] = is_turned ? c : b;
    row[2] = is_turned ? b : c;
}

/** Cuts one tetrahedron of a cell. */
static void cut(marcher *m, const uint32_t corner[8], int which)
{
    /* Corners above come first; is_turned says whether that order is left-handed. */
    int order[4], above = 0, below = 4;
    for (int i = 0; i < 4; i++)
        if (m->field[corner[tetrahedra[which][i]]] >= 0.0) order[above++] = i;
    for (int i = 3; i >= 0; i--)
        if (!(m->field[corner[tetrahedra[which][i]]] >= 0.0)) order[--below] = i;
    if (above == 0 || above == 4) return;
    int swaps = 0, c[4];
    for (int i = 0; i < 4; i++)
        for (int j = i + 1; j < 4; j++)
            swaps += order[i] > order[j];
    bool is_turned = (swaps % 2 == 1) == is_right[which];
    for (int i = 0; i < 4; i++)
        c[i] = tetrahedra[which][order[i]];
    if (above == 1) {
        add_triangle(m, vertex_between(m, corner, c[0], c[1]), vertex_between(m, corner, c[0], c[2]),
                     vertex_between(m, corner, c[0], c[3]), !is_turned);
    } else if (above == 3) {
        add_triangle(m, vertex_between(m, corner, c[3], c[0]), vertex_between(m, corner, c[3], c[1]),
                     vertex_between(m, corner, c[3], c[2]), !is_turned);
    } else {
        uint32_t ac = vertex_between(m, corner, c[0], c[2]), ad = vertex_between(m, corner, c[0], c[3]),
                 bd = vertex_between(m, corner, c[1], c[3]), bc = vertex_between(m, corner, c[1], c[2]);
        add_triangle(m, ac, ad, bd, !is_turned);
        add_triangle(m, ac, bd, bc, !is_turned);
    }
}

/** The numbers of vertices and triangles that there will be at most. */
static void count_cuts(const qm_cloud_grid *grid, const double *field, size_t *vertices, size_t *triangles)
{
    size_t cells = 0;
    for (size_t c = 0; c < grid->cell_count; c++)
        cells += qm_cloud_crosses(grid, field, c);
    *triangles = 12 * cells;
    *vertices = 19 * cells; /* the edges of a cell, its sides and its diagonal */
}

qm_status qm_cloud_isosurface(qm_context *ctx, const qm_cloud_grid *grid, const double *field,
                              qm_cloud_triangles *out)
{
    *out = (qm_cloud_triangles){0};
    count_cuts(grid, field, &out->vertex_capacity, &out->capacity);
    if (out->capacity == 0) return QM_OK;
    marcher m = {.grid = grid, .field = field, .out = out};
    m.vertex = qm_context_alloc(ctx, grid->node_count, sizeof *m.vertex);
    out->position = qm_context_alloc(ctx, out->vertex_capacity, sizeof *out->position);
    out->corner = qm_context_alloc(ctx, out->capacity, sizeof *out->corner);
    bool has_memory = m.vertex && out->position && out->corner;
    for (size_t i = 0; i < grid->node_count && has_memory; i++)
        for (int k = 0; k < 8; k++)
            m.vertex[i][k] = QM_NO_INDEX;
    for (size_t c = 0; c < grid->cell_count && has_memory; c++) {
        if (!qm_cloud_crosses(grid, field, c)) continue;
        uint32_t corner[8];
        qm_cloud_grid_corners(grid, c, corner);
        for (int k = 0; k < 6; k++)
            cut(&m, corner, k);
    }
    qm_context_free(ctx, m.vertex, grid->node_count, sizeof *m.vertex);
    if (has_memory) return QM_OK;
    qm_cloud_triangles_reset(ctx, out);
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a surface of points");
}
