/**
 * reconstruct_lattice.c: lattices as Coons patches, their doubling, and fairing, which slides vertices along
 * the lattice lines until each edge has its share of the curvature.
 *
 * Source: S. Coons, Surfaces for computer-aided design of space forms, 1967.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define FLAT_TURN 20.0 /* curvature that flat regions are given: radians along the surface's diagonal */

#define CLOUD_REACH 0.05 /* of the diagonal: a wall of points is sought no farther away */
#define NEAR_RIM 0.25  /* of the shortest edge: a vertex farther beyond the boundary of a mesh is in a hole */
#define OFF_WALL 0.5   /* of its shortest edge: a vertex farther from its wall is off it */
#define MIN_ALONG 0.98 /* of the vertices of a Coons patch that lies along its walls */
#define EXACT 0.02     /* of the longest edge: a Coons patch no farther from its wall is as good as it */
#define SILENT 0.1     /* of the longest edge: a wall without points is no farther from those of others */
#define CHOOSE_RATIO 2 /* times fewer vertices off their wall make the Coons patch the better start */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
}

bool qm_lattice_allocate(qm_context *ctx, qm_lattice *lattice)
{
    size_t count = qm_lattice_vertex_count(lattice);
    lattice->vertices = qm_context_alloc(ctx, count, POINT_SIZE);
    lattice->in_hole = qm_context_alloc(ctx, count, sizeof *lattice->in_hole);
    if (lattice->vertices && lattice->in_hole) {
        memset(lattice->in_hole, 0, count * sizeof *lattice->in_hole);
        return true;
    }
    qm_lattice_free(ctx, lattice);
    return false;
}

void qm_lattice_free(qm_context *ctx, qm_lattice *lattice)
{
    size_t count = qm_lattice_vertex_count(lattice);
    qm_context_free(ctx, lattice->vertices, count, POINT_SIZE);
    qm_context_free(ctx, lattice->in_hole, count, sizeof *lattice->in_hole);
    lattice->vertices = NULL;
    lattice->in_hole = NULL;
}

/** Vertex k, counted from corner `side`, of a side of a patch. */
static const double *side_vertex(const qm_reconstruction *r, const qm_layout_patch *patch, int side,
                                 uint32_t k)
{
    const qm_polyline *polyline = &r->polylines[patch->side[side]];
    QM_ASSERT(k <= polyline->vertex_edges);
    return polyline->vertices + 3 * (size_t)(patch->against[side] ? polyline->vertex_edges - k : k);
}

/** Copies the vertices of the four curves to the border of a lattice. */
static void set_border(const qm_reconstruction *r, size_t p)
{
    const qm_layout_patch *patch = &r->layout.patches[p];
    qm_lattice *lattice = &r->lattices[p];
    for (uint32_t i = 0; i <= lattice->columns; i++) {
        memcpy(qm_lattice_vertex(lattice, i, 0), side_vertex(r, patch, 0, i), POINT_SIZE);
        memcpy(qm_lattice_vertex(lattice, i, lattice->rows), side_vertex(r, patch, 2, lattice->columns - i),
               POINT_SIZE);
    }
    for (uint32_t j = 0; j <= lattice->rows; j++) {
        memcpy(qm_lattice_vertex(lattice, lattice->columns, j), side_vertex(r, patch, 1, j), POINT_SIZE);
        memcpy(qm_lattice_vertex(lattice, 0, j), side_vertex(r, patch, 3, lattice->rows - j), POINT_SIZE);
    }
}

/** Bilinear blending: the sum of two ruled surfaces less the bilinear patch of the corners. */
qm_vec qm_lattice_coons(const qm_lattice *lattice, const qm_vertex_block *block, uint32_t column,
                        uint32_t row)
{
    QM_ASSERT(block->low[0] < block->high[0] && block->high[0] <= lattice->columns);
    QM_ASSERT(block->low[1] < block->high[1] && block->high[1] <= lattice->rows);
    uint32_t left = block->low[0], right = block->high[0], first = block->low[1], last = block->high[1];
    double u = (double)(column - left) / (right - left), v = (double)(row - first) / (last - first);
    qm_vec across =
        qm_vec_mix(qm_lattice_at(lattice, column, first), qm_lattice_at(lattice, column, last), v);
    qm_vec along = qm_vec_mix(qm_lattice_at(lattice, left, row), qm_lattice_at(lattice, right, row), u);
    qm_vec bottom = qm_vec_mix(qm_lattice_at(lattice, left, first), qm_lattice_at(lattice, right, first), u);
    qm_vec top = qm_vec_mix(qm_lattice_at(lattice, left, last), qm_lattice_at(lattice, right, last), u);
    return qm_vec_sub(qm_vec_add(across, along), qm_vec_mix(bottom, top, v));
}

/** Sets the inner vertices to the Coons patch of the border. */
static void fill_inside(const qm_lattice *lattice)
{
    const qm_vertex_block all = {{0, 0}, {lattice->columns, lattice->rows}};
    for (uint32_t j = 1; j < lattice->rows; j++)
        for (uint32_t i = 1; i < lattice->columns; i++)
            qm_vec_store(qm_lattice_vertex(lattice, i, j), qm_lattice_coons(lattice, &all, i, j));
}

qm_status qm_lattices_create(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        qm_lattice *lattice = &r->lattices[p];
        qm_lattice_free(ctx, lattice);
        *lattice = (qm_lattice){.columns = qm_chord_of_patch(r, p, 0)->lattice_edges,
                                .rows = qm_chord_of_patch(r, p, 1)->lattice_edges,
                                .is_stale = true,
                                .spans_hole = lattice->spans_hole,
                                .component = lattice->component,
                                .is_flipped = lattice->is_flipped,
                                .points = lattice->points};
        if (!qm_lattice_allocate(ctx, lattice)) return no_memory(ctx);
        set_border(r, p);
        fill_inside(lattice);
    }
    return QM_OK;
}

qm_vec qm_lattice_normal(const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    uint32_t west = i > 0 ? i - 1 : i, east = i < lattice->columns ? i + 1 : i;
    uint32_t south = j > 0 ? j - 1 : j, north = j < lattice->rows ? j + 1 : j;
    qm_vec normal =
        qm_vec_cross(qm_vec_sub(qm_lattice_at(lattice, east, j), qm_lattice_at(lattice, west, j)),
                     qm_vec_sub(qm_lattice_at(lattice, i, north), qm_lattice_at(lattice, i, south)));
    double length = qm_vec_norm(normal);
    return length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
}

/** The lengths of the shortest and of the longest edge at an inner vertex. */
static void measure_edges(const qm_lattice *lattice, uint32_t i, uint32_t j, double *shortest,
                          double *longest)
{
    const qm_vec here = qm_lattice_at(lattice, i, j);
    const qm_vec neighbour[4] = {qm_lattice_at(lattice, i - 1, j), qm_lattice_at(lattice, i + 1, j),
                                 qm_lattice_at(lattice, i, j - 1), qm_lattice_at(lattice, i, j + 1)};
    *shortest = INFINITY;
    *longest = 0.0;
    for (int k = 0; k < 4; k++) {
        double length = qm_vec_distance(here, neighbour[k]);
        *shortest = fmin(*shortest, length);
        *longest = fmax(*longest, length);
    }
}

/** Projects as qm_lattice_project, into holes of a mesh onto their boundaries. */
static bool project_onto_wall(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i,
                              uint32_t j, double longest, const double p[3], qm_ref_surface_point *out)
{
    double toward[3];
    qm_vec normal = qm_lattice_normal(lattice, i, j);
    double reach = surface->is_cloud ? CLOUD_REACH * surface->diagonal : longest;
    qm_vec_store(toward, normal);
    if (!lattice->faces_walls || !(reach > 0.0) || !(qm_vec_norm2(normal) > 0.0)) {
        qm_ref_surface_project(surface, p, out);
        return false;
    }
    if (qm_ref_surface_project_toward(surface, p, toward, reach, out)) return true;
    /* A wall of too few points, of which those of the walls beside it do not tell where it is, or a hole. */
    if (surface->is_cloud || out->distance > longest)
        *out = (qm_ref_surface_point){.position = {p[0], p[1], p[2]}, .spacing = out->spacing};
    return false;
}

bool qm_lattice_project(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i, uint32_t j,
                        const double p[3], qm_ref_surface_point *out)
{
    double shortest, longest;
    measure_edges(lattice, i, j, &shortest, &longest);
    bool has_wall = project_onto_wall(surface, lattice, i, j, longest, p, out);
    if (surface->is_cloud || !(out->distance > NEAR_RIM * shortest) || !qm_ref_surface_ends_at(surface, p))
        return has_wall;
    *out = (qm_ref_surface_point){.position = {p[0], p[1], p[2]}};
    return false;
}

qm_vec qm_lattice_own_side(const qm_reconstruction *r, size_t p, double u, double v)
{
    const qm_layout_patch *patch = &r->layout.patches[p];
    const qm_lattice *lattice = &r->lattices[p];
    const double from[4] = {v, lattice->columns - u, lattice->rows - v, u};
    const double along[4] = {u, v, lattice->columns - u, lattice->rows - v};
    qm_vec sum = {0, 0, 0};
    for (int side = 0; side < 4; side++) {
        const qm_polyline *polyline = &r->polylines[patch->side[side]];
        if (!polyline->across || from[side] > 1.0) continue;
        uint32_t k = (uint32_t)(along[side] + 0.5);
        QM_ASSERT(k <= polyline->vertex_edges);
        /* Patches lie on the left of the sides that run in their direction. */
        if (patch->against[side])
            sum = qm_vec_sub(sum, qm_vec_load(polyline->across + 3 * (size_t)(polyline->vertex_edges - k)));
        else
            sum = qm_vec_add(sum, qm_vec_load(polyline->across + 3 * (size_t)k));
    }
    return sum;
}

bool qm_lattice_project_own(const qm_reconstruction *r, size_t p, uint32_t i, uint32_t j,
                            const double position[3], qm_ref_surface_point *out)
{
    const qm_lattice *lattice = &r->lattices[p];
    double shortest, longest, toward[3];
    qm_vec_store(toward, qm_lattice_own_side(r, p, i, j));
    measure_edges(lattice, i, j, &shortest, &longest);
    if (r->has_sides && shortest > 0.0 && qm_vec_norm2(qm_vec_load(toward)) > 0.0 &&
        qm_ref_surface_project_toward(&r->surface, position, toward, shortest, out))
        return true;
    return qm_lattice_project(&r->surface, lattice, i, j, position, out);
}

/** The number of inner vertices that are off the wall that the lattice faces there. */
static size_t count_off_wall(const qm_ref_surface *surface, const qm_lattice *lattice)
{
    size_t count = 0;
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            double shortest, longest;
            qm_ref_surface_point projection;
            measure_edges(lattice, i, j, &shortest, &longest);
            bool has_wall =
                qm_lattice_project(surface, lattice, i, j, qm_lattice_vertex(lattice, i, j), &projection);
            count += !has_wall || projection.distance > OFF_WALL * shortest;
        }
    }
    return count;
}

/**
 * True if a Coons patch lies along the walls that it faces, within the cover distance. Its normals are then those of
 * the surface; over a protrusion they are not.
 */
static bool is_along_walls(const qm_reconstruction *r, const qm_lattice *lattice)
{
    double reach = qm_reconstruction_cover_distance(r);
    size_t count = 0, along = 0;
    for (uint32_t j = 1; j < lattice->rows; j += 2) {
        for (uint32_t i = 1; i < lattice->columns; i += 2) {
            double toward[3];
            qm_ref_surface_point projection;
            qm_vec_store(toward, qm_lattice_normal(lattice, i, j));
            double shortest, longest;
            const double *vertex = qm_lattice_vertex(lattice, i, j);
            measure_edges(lattice, i, j, &shortest, &longest);
            bool has_wall = qm_ref_surface_project_toward(&r->surface, vertex, toward, reach, &projection);
            bool is_near = projection.distance <= reach;
            if (!has_wall && r->surface.is_cloud) {
                /* A thin wall has few points, which must agree with the patch; without any it says nothing. */
                has_wall = qm_ref_surface_project_toward(&r->surface, vertex, toward,
                                                         CLOUD_REACH * r->surface.diagonal, &projection);
                is_near = projection.distance <= SILENT * longest;
                if (!has_wall && is_near) continue;
            }
            count++;
            along += has_wall && is_near;
        }
    }
    return (double)along >= MIN_ALONG * (double)count;
}

/**
 * Projects the inner vertices of a Coons patch onto the walls that it faces. True if none moves far: the patch is then
 * as good as the wall, and tells it from others that look the same way.
 */
static bool project_inside(const qm_ref_surface *surface, const qm_lattice *lattice, double *scratch)
{
    memcpy(scratch, lattice->vertices, qm_lattice_vertex_count(lattice) * POINT_SIZE);
    bool is_exact = true;
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            /* The normals are those of the Coons patch, so the positions go elsewhere until all are known. */
            size_t k = 3 * qm_lattice_index(lattice, i, j);
            double shortest, longest;
            qm_ref_surface_point projection;
            measure_edges(lattice, i, j, &shortest, &longest);
            if (qm_lattice_project(surface, lattice, i, j, lattice->vertices + k, &projection))
                memcpy(scratch + k, projection.position, POINT_SIZE);
            is_exact &= projection.distance <= EXACT * longest;
        }
    }
    memcpy(lattice->vertices, scratch, qm_lattice_vertex_count(lattice) * POINT_SIZE);
    return is_exact;
}

qm_status qm_lattices_choose(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count && r->has_sides; p++) {
        qm_lattice *lattice = &r->lattices[p];
        if (!lattice->is_stale || lattice->spans_hole) continue;
        if (r->options.grids) {
            lattice->faces_walls = is_along_walls(r, lattice);
            continue;
        }
        qm_lattice walled = *lattice;
        if (!qm_lattice_allocate(ctx, &walled)) return no_memory(ctx);
        size_t count = qm_lattice_vertex_count(lattice);
        double *scratch = qm_context_alloc(ctx, count, POINT_SIZE);
        if (!scratch) {
            qm_lattice_free(ctx, &walled);
            return no_memory(ctx);
        }
        memcpy(walled.vertices, lattice->vertices, count * POINT_SIZE);
        fill_inside(&walled);
        lattice->faces_walls = is_along_walls(r, &walled);
        if (lattice->faces_walls) {
            walled.faces_walls = true;
            bool is_exact = project_inside(&r->surface, &walled, scratch);
            if (is_exact ||
                CHOOSE_RATIO * count_off_wall(&r->surface, &walled) < count_off_wall(&r->surface, lattice))
                memcpy(lattice->vertices, walled.vertices, count * POINT_SIZE);
        }
        qm_context_free(ctx, scratch, count, POINT_SIZE);
        qm_lattice_free(ctx, &walled);
    }
    return QM_OK;
}

qm_status qm_lattices_resample(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        uint32_t columns = qm_chord_of_patch(r, p, 0)->lattice_edges,
                 rows = qm_chord_of_patch(r, p, 1)->lattice_edges;
        if (columns == r->lattices[p].columns && rows == r->lattices[p].rows) continue;
        qm_lattice *lattice = &r->lattices[p];
        qm_lattice fine = {.columns = columns,
                           .rows = rows,
                           .is_stale = true,
                           .faces_walls = lattice->faces_walls,
                           .spans_hole = lattice->spans_hole,
                           .component = lattice->component,
                           .is_flipped = lattice->is_flipped,
                           .points = lattice->points};
        if (!qm_lattice_allocate(ctx, &fine)) return no_memory(ctx);
        /* Bilinear interpolation between the vertices of the old lattice. */
        for (uint32_t j = 0; j <= rows; j++) {
            uint64_t place = (uint64_t)j * lattice->rows;
            uint32_t row = (uint32_t)(place / rows), next_row = row < lattice->rows ? row + 1 : row;
            double v = (double)(place % rows) / rows;
            for (uint32_t i = 0; i <= columns; i++) {
                place = (uint64_t)i * lattice->columns;
                uint32_t column = (uint32_t)(place / columns),
                         next = column < lattice->columns ? column + 1 : column;
                double u = (double)(place % columns) / columns;
                qm_vec low =
                    qm_vec_mix(qm_lattice_at(lattice, column, row), qm_lattice_at(lattice, next, row), u);
                qm_vec high = qm_vec_mix(qm_lattice_at(lattice, column, next_row),
                                         qm_lattice_at(lattice, next, next_row), u);
                qm_vec_store(qm_lattice_vertex(&fine, i, j), qm_vec_mix(low, high, v));
            }
        }
        qm_lattice_free(ctx, lattice);
        *lattice = fine;
        set_border(r, p);
    }
    return QM_OK;
}

/** A vertex with its normal. */
typedef struct fair_point {
    qm_vec at, normal;
} fair_point;

/**
 * The weight of an edge: the square root of the surface's height above it, which goes as its length times the
 * angle between the normals at its ends, and of a term in its length, so that flat regions get vertices too.
 * Equal weights mean equal distances from the surface.
 */
static double edge_weight(const fair_point *a, const fair_point *b, double flat)
{
    double length2 = qm_vec_norm2(qm_vec_sub(a->at, b->at));
    double turn2 = qm_vec_norm2(qm_vec_sub(a->normal, b->normal));
    return sqrt(flat * length2 + sqrt(length2 * turn2));
}

/** The move along the heavier of two edges by a quarter of the way to equal weights. */
static qm_vec balance(const fair_point *before, const fair_point *here, const fair_point *after, double flat)
{
    double back = edge_weight(before, here, flat), on = edge_weight(here, after, flat);
    double heavier = fmax(back, on);
    if (heavier == 0.0) return (qm_vec){0, 0, 0};
    return qm_vec_scale(0.25 * fabs(on - back) / heavier,
                        qm_vec_sub(on > back ? after->at : before->at, here->at));
}

static fair_point point_of(const qm_lattice *lattice, const qm_vec *normal, uint32_t i, uint32_t j)
{
    return (fair_point){qm_lattice_at(lattice, i, j), normal[qm_lattice_index(lattice, i, j)]};
}

/** Slides each inner vertex along its row and its column towards equal weights on both sides. */
static void fair_round(qm_lattice *lattice, qm_vec *normal, double flat)
{
    for (uint32_t j = 0; j <= lattice->rows; j++)
        for (uint32_t i = 0; i <= lattice->columns; i++)
            normal[qm_lattice_index(lattice, i, j)] = qm_lattice_normal(lattice, i, j);
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++) {
            fair_point here = point_of(lattice, normal, i, j);
            fair_point west = point_of(lattice, normal, i - 1, j), east = point_of(lattice, normal, i + 1, j);
            fair_point south = point_of(lattice, normal, i, j - 1),
                       north = point_of(lattice, normal, i, j + 1);
            qm_vec move =
                qm_vec_add(balance(&west, &here, &east, flat), balance(&south, &here, &north, flat));
            qm_vec_store(qm_lattice_vertex(lattice, i, j), qm_vec_add(here.at, move));
        }
    }
}

qm_status qm_lattices_fair(qm_context *ctx, qm_reconstruction *r, int rounds)
{
    size_t max_count = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        size_t count = qm_lattice_vertex_count(&r->lattices[p]);
        if (count > max_count) max_count = count;
    }
    qm_vec *normal = qm_context_alloc(ctx, max_count, sizeof *normal);
    if (!normal) return no_memory(ctx);
    double flat = FLAT_TURN / r->surface.diagonal;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        qm_lattice *lattice = &r->lattices[p];
        for (int round = 0; round < rounds && lattice->is_stale && !lattice->spans_hole; round++) {
            fair_round(lattice, normal, flat);
            /* Noise of a point set would roughen the lattice before the fit averages it. On a mesh, vertices
             * off the surface would be projected onto the wrong side of a narrow gap by the next stage. */
            if (r->surface.is_cloud) continue;
            for (uint32_t j = 1; j < lattice->rows; j++) {
                for (uint32_t i = 1; i < lattice->columns; i++) {
                    double *vertex = qm_lattice_vertex(lattice, i, j);
                    qm_ref_surface_point projection;
                    qm_lattice_project_own(r, p, i, j, vertex, &projection);
                    memcpy(vertex, projection.position, POINT_SIZE);
                }
            }
        }
    }
    qm_context_free(ctx, normal, max_count, sizeof *normal);
    return QM_OK;
}
