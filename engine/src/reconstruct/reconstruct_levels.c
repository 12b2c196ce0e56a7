/**
 * reconstruct_levels.c: lattices that start anew, and are settled with half as many edges first.
 *
 * Settling moves a vertex by a few sides of a quad. Nodes that lie a patch away from where quads need them, and rows that run askew over a
 * whole patch, are twice as many sides away from that in a mesh of four times the quads. So lattices with half of their edges
 * start at the places that the grids or the maps of the layout tell, and are settled; then they get all of their edges, with vertices between
 * those, each on the wall that the quad looks at which it is in.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define LEAST_COARSE 400       /* quads of a coarse mesh that is worth it, */
#define LEAST_COARSE_A_PATCH 4 /* also for each patch */

enum { POINT_SIZE = 3 * sizeof(double) };

/** The vertices of the coarse lattices, and of the curves. */
typedef struct coarse_level {
    size_t patch_count, curve_count;
    qm_lattice *lattices; /* with vertices, or without after an error */
    qm_polyline *
        curves; /* of these only the vertices and their number; NULL of curves without patches, and after an error */
    qm_vec **normal; /* by curve, of each edge: the sum of the normals of the quads beside it */
} coarse_level;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the coarse patches");
}

static size_t vertex_count(const qm_polyline *polyline)
{
    return (size_t)polyline->vertex_edges + 1;
}

static void coarse_level_reset(qm_context *ctx, coarse_level *level)
{
    for (size_t p = 0; p < level->patch_count && level->lattices; p++)
        qm_lattice_free(ctx, &level->lattices[p]);
    for (size_t c = 0; c < level->curve_count; c++) {
        if (level->curves)
            qm_context_free(ctx, level->curves[c].vertices, vertex_count(&level->curves[c]), POINT_SIZE);
        if (level->curves && level->normal)
            qm_context_free(ctx, level->normal[c], vertex_count(&level->curves[c]), sizeof(qm_vec));
    }
    qm_context_free(ctx, level->lattices, level->patch_count, sizeof *level->lattices);
    qm_context_free(ctx, level->curves, level->curve_count, sizeof *level->curves);
    qm_context_free(ctx, level->normal, level->curve_count, sizeof *level->normal);
    *level = (coarse_level){0};
}

/** The normal of a quad of a lattice, as long as twice its area. */
static qm_vec quad_normal(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    qm_vec c[4];
    qm_lattice_quad(lattice, column, row, c);
    return qm_vec_cross(qm_vec_sub(c[2], c[0]), qm_vec_sub(c[3], c[1]));
}

/** Adds the normals of the outer quads of a patch to those of its curves. */
static void add_normals(const qm_reconstruction *r, size_t p, const coarse_level *level)
{
    const qm_lattice *lattice = &level->lattices[p];
    const qm_layout_patch *patch = &r->layout.patches[p];
    for (int k = 0; k < 4; k++) {
        uint32_t edges = k % 2 == 0 ? lattice->columns : lattice->rows;
        for (uint32_t i = 0; i < edges; i++) {
            uint32_t along = k < 2 ? i : edges - 1 - i;
            uint32_t column = k % 2 == 0 ? along : k == 1 ? lattice->columns - 1 : 0;
            uint32_t row = k % 2 != 0 ? along : k == 2 ? lattice->rows - 1 : 0;
            qm_vec *sum = &level->normal[patch->side[k]][patch->against[k] ? edges - 1 - i : i];
            *sum = qm_vec_add(*sum, quad_normal(lattice, column, row));
        }
    }
}

/** Takes copies of the lattices and of the vertices of curves; *out is the caller's, also after an error. */
static qm_status take_level(qm_context *ctx, const qm_reconstruction *r, coarse_level *out)
{
    size_t patches = r->layout.patch_count, curves = r->layout.curve_count;
    *out = (coarse_level){.patch_count = patches, .curve_count = curves};
    out->lattices = qm_context_alloc(ctx, patches, sizeof *out->lattices);
    out->curves = qm_context_alloc(ctx, curves, sizeof *out->curves);
    out->normal = qm_context_alloc(ctx, curves, sizeof *out->normal);
    if (out->lattices) memset(out->lattices, 0, patches * sizeof *out->lattices);
    if (out->curves) memset(out->curves, 0, curves * sizeof *out->curves);
    if (out->normal) memset(out->normal, 0, curves * sizeof *out->normal);
    if (!out->lattices || !out->curves || !out->normal) return no_memory(ctx);
    for (size_t c = 0; c < curves; c++) {
        const qm_polyline *from = &r->polylines[c];
        size_t count = vertex_count(from);
        if (from->chord == QM_NO_INDEX) continue;
        out->curves[c].vertex_edges = from->vertex_edges;
        out->curves[c].vertices = qm_context_alloc(ctx, count, POINT_SIZE);
        out->normal[c] = qm_context_alloc(ctx, count, sizeof(qm_vec));
        if (!out->curves[c].vertices || !out->normal[c]) return no_memory(ctx);
        memcpy(out->curves[c].vertices, from->vertices, count * POINT_SIZE);
        memset(out->normal[c], 0, count * sizeof(qm_vec));
    }
    for (size_t p = 0; p < patches; p++) {
        qm_lattice copy = r->lattices[p];
        if (!qm_lattice_allocate(ctx, &copy)) return no_memory(ctx);
        memcpy(copy.vertices, r->lattices[p].vertices, qm_lattice_vertex_count(&copy) * POINT_SIZE);
        out->lattices[p] = copy;
        add_normals(r, p, out);
    }
    return QM_OK;
}

/** Where vertex i of so many edges lies between coarse ones. */
static double place_of(uint32_t i, uint32_t edges, uint32_t coarse, uint32_t *before)
{
    double place = (double)i * coarse / edges;
    *before = (uint32_t)place < coarse ? (uint32_t)place : coarse - 1;
    return place - *before;
}

/** Projects a place onto the wall that looks along a normal, of any length, if that is within reach, else onto the nearest. */
static void project(const qm_reconstruction *r, qm_vec place, qm_vec normal, double reach, double out[3])
{
    double at[3], toward[3], length = qm_vec_norm(normal);
    qm_ref_surface_point on;
    qm_vec_store(at, place);
    bool is_found = false;
    if (r->has_sides && length > 0.0) {
        qm_vec_store(toward, qm_vec_scale(1.0 / length, normal));
        is_found = qm_ref_surface_project_toward(&r->surface, at, toward, reach, &on);
    }
    if (!is_found) qm_ref_surface_project(&r->surface, at, &on);
    memcpy(out, on.position, POINT_SIZE);
}

/** The nearest point of a polyline, if it is nearer than one before. */
static void take_nearest(const qm_polyline *polyline, qm_vec place, double *distance, double out[3])
{
    for (size_t i = 0; i + 1 < polyline->point_count; i++) {
        qm_vec a = qm_vec_load(polyline->points + 3 * i),
               along = qm_vec_sub(qm_vec_load(polyline->points + 3 * i + 3), a);
        double length2 = qm_vec_norm2(along),
               share = length2 > 0.0 ? qm_clamp(qm_vec_dot(qm_vec_sub(place, a), along) / length2, 0.0, 1.0)
                                     : 0.0;
        qm_vec at = qm_vec_axpy(a, share, along);
        if (qm_vec_distance(at, place) >= *distance) continue;
        *distance = qm_vec_distance(at, place);
        qm_vec_store(out, at);
    }
}

/** Projects a place of a sharp curve onto it, and onto those that go on from it, since nodes slide along them. */
static void project_sharp(const qm_reconstruction *r, size_t c, qm_vec place, double out[3])
{
    const qm_curve *curves = r->layout.curves, *own = &curves[c];
    double distance = INFINITY;
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        bool meets = curves[i].from == own->from || curves[i].from == own->to || curves[i].to == own->from ||
                     curves[i].to == own->to;
        if (curves[i].mark == QM_CURVE_SHARP && meets) take_nearest(&r->polylines[i], place, &distance, out);
    }
}

/** Grids come with curves that are not exact, whatever their marks are. */
static qm_curve_mark mark_of(const qm_reconstruction *r, size_t curve)
{
    return r->options.grids ? QM_CURVE_SMOOTH : r->layout.curves[curve].mark;
}

/** Puts the vertices of a curve between the coarse ones. */
static void refine_curve(const qm_reconstruction *r, size_t c, const coarse_level *level)
{
    const qm_polyline *polyline = &r->polylines[c];
    const uint32_t coarse = level->curves[c].vertex_edges;
    const double *from = level->curves[c].vertices;
    uint32_t k;
    memcpy(polyline->vertices, from, POINT_SIZE);
    memcpy(polyline->vertices + 3 * (size_t)polyline->vertex_edges, from + 3 * (size_t)coarse, POINT_SIZE);
    for (uint32_t i = 1; i < polyline->vertex_edges; i++) {
        double share = place_of(i, polyline->vertex_edges, coarse, &k);
        qm_vec a = qm_vec_load(from + 3 * (size_t)k), b = qm_vec_load(from + 3 * (size_t)k + 3);
        double *out = polyline->vertices + 3 * (size_t)i;
        if (mark_of(r, c) == QM_CURVE_SHARP)
            project_sharp(r, c, qm_vec_mix(a, b, share), out);
        else
            project(r, qm_vec_mix(a, b, share), level->normal[c][k], 2.0 * qm_vec_distance(a, b), out);
    }
}

/** Puts the inner vertices of a lattice between the coarse ones. */
static void refine_lattice(const qm_reconstruction *r, const qm_lattice *coarse, const qm_lattice *fine)
{
    uint32_t column, row;
    for (uint32_t j = 1; j < fine->rows; j++) {
        double v = place_of(j, fine->rows, coarse->rows, &row);
        for (uint32_t i = 1; i < fine->columns; i++) {
            double u = place_of(i, fine->columns, coarse->columns, &column);
            qm_vec c[4];
            qm_lattice_quad(coarse, column, row, c);
            project(r, qm_vec_mix(qm_vec_mix(c[0], c[1], u), qm_vec_mix(c[3], c[2], u), v),
                    quad_normal(coarse, column, row),
                    qm_vec_distance(c[0], c[2]) + qm_vec_distance(c[1], c[3]), qm_lattice_vertex(fine, i, j));
        }
    }
}

/** Gives the lattices a part of the edges of the mesh: the quads that they have then. */
static size_t set_lattice_edges(qm_reconstruction *r, uint32_t part)
{
    size_t quads = 0;
    for (size_t i = 0; i < r->chord_count; i++)
        r->chords[i].lattice_edges = (r->chords[i].edges + part - 1) / part;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads +=
            (size_t)qm_chord_of_patch(r, p, 0)->lattice_edges * qm_chord_of_patch(r, p, 1)->lattice_edges;
    return quads;
}

/** Sets the vertices of the curves, those of fixed ones where the mesh of the steps has them, if there is one and lattices have its edges. */
static qm_status set_vertices(qm_context *ctx, qm_reconstruction *r, const qm_polyline *steps)
{
    qm_status status = qm_polylines_set_vertices(ctx, r);
    for (size_t c = 0; c < r->layout.curve_count && status == QM_OK && steps; c++) {
        const qm_polyline *polyline = &r->polylines[c];
        if (mark_of(r, c) != QM_CURVE_FIXED || polyline->chord == QM_NO_INDEX) continue;
        if (polyline->vertex_edges != r->chords[polyline->chord].edges) continue;
        size_t stride = steps[c].vertex_edges / polyline->vertex_edges;
        for (size_t i = 0; i <= polyline->vertex_edges; i++)
            memcpy(polyline->vertices + 3 * i, steps[c].vertices + 3 * stride * i, POINT_SIZE);
    }
    return status;
}

/** Sets the vertices of curves, and starts the lattices at grids or maps. */
static qm_status start(qm_context *ctx, qm_reconstruction *r, const qm_polyline *steps)
{
    qm_status status = set_vertices(ctx, r, steps);
    return status == QM_OK ? qm_lattices_place(ctx, r) : status;
}

/** Puts vertices that were fitted off the surface back onto it, but for marked ones. */
static qm_status put_back(qm_context *ctx, const qm_reconstruction *r, const qm_quads_marks *marks,
                          qm_mesh *mesh)
{
    qm_vec *normal = qm_context_alloc(ctx, mesh->vertex_count, sizeof *normal);
    double *reach = qm_context_alloc(ctx, mesh->vertex_count, sizeof *reach);
    bool has_memory = normal && reach;
    if (has_memory) {
        memset(normal, 0, mesh->vertex_count * sizeof *normal);
        memset(reach, 0, mesh->vertex_count * sizeof *reach);
    }
    for (size_t f = 0; f < mesh->face_count && has_memory; f++) {
        qm_vec c[4];
        for (size_t k = 0; k < 4; k++)
            c[k] = qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * f + k]);
        qm_vec up = qm_vec_cross(qm_vec_sub(c[2], c[0]), qm_vec_sub(c[3], c[1]));
        for (size_t k = 0; k < 4; k++) {
            uint32_t v = mesh->faces[4 * f + k];
            normal[v] = qm_vec_add(normal[v], up);
            reach[v] = fmax(reach[v], qm_vec_distance(c[0], c[2]));
        }
    }
    for (size_t v = 0; v < mesh->vertex_count && has_memory; v++) {
        double *at = mesh->positions + 3 * v;
        if (!marks->stays || !marks->stays[v]) project(r, qm_vec_load(at), normal[v], reach[v], at);
    }
    qm_context_free(ctx, normal, mesh->vertex_count, sizeof *normal);
    qm_context_free(ctx, reach, mesh->vertex_count, sizeof *reach);
    return has_memory ? QM_OK : no_memory(ctx);
}

/** Settles the lattices as they are, and their curves as they are marked. */
static qm_status settle(qm_context *ctx, qm_reconstruction *r, const qm_quads_options *quads)
{
    qm_mesh mesh = {0};
    qm_quads_marks marks = {0};
    qm_status status = qm_lattices_mesh(ctx, r, true, &mesh);
    if (status == QM_OK && !r->options.grids) status = qm_lattices_find_marks(ctx, r, true, &marks);
    if (status == QM_OK) status = qm_quads_settle(ctx, r->surface.bvh, quads, QM_QUADS_SPREAD, &marks, &mesh);
    if (status == QM_OK) status = put_back(ctx, r, &marks, &mesh);
    if (status == QM_OK) status = qm_lattices_set(ctx, r, &mesh);
    qm_quads_marks_reset(ctx, &marks);
    qm_mesh_reset(ctx, &mesh);
    return status;
}

/** Puts all vertices between those of the coarse level. */
static qm_status refine(qm_context *ctx, qm_reconstruction *r, const qm_polyline *steps,
                        const coarse_level *level)
{
    qm_status status = set_vertices(ctx, r, steps);
    for (size_t c = 0; c < level->curve_count && status == QM_OK; c++)
        if (level->curves[c].vertices && mark_of(r, c) != QM_CURVE_FIXED) refine_curve(r, c, level);
    if (status == QM_OK) status = qm_lattices_create(ctx, r);
    for (size_t p = 0; p < level->patch_count && status == QM_OK; p++)
        refine_lattice(r, &level->lattices[p], &r->lattices[p]);
    return status;
}

qm_status qm_levels_fill(qm_context *ctx, qm_reconstruction *r, const qm_quads_options *quads,
                         const qm_polyline *steps, bool *is_settled)
{
    coarse_level level = {0};
    qm_status status = QM_OK;
    size_t coarse = set_lattice_edges(r, 2);
    *is_settled = r->options.settles_coarse && coarse >= LEAST_COARSE &&
                  coarse >= LEAST_COARSE_A_PATCH * r->layout.patch_count;
    if (*is_settled) {
        status = start(ctx, r, steps);
        if (status == QM_OK) status = settle(ctx, r, quads);
        if (status == QM_OK) status = take_level(ctx, r, &level);
    }
    set_lattice_edges(r, 1);
    if (status == QM_OK) status = *is_settled ? refine(ctx, r, steps, &level) : start(ctx, r, steps);
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK && *is_settled; p++) {
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        qm_lattice_untangle(&r->surface, &r->lattices[p]);
    }
    coarse_level_reset(ctx, &level);
    return status;
}
