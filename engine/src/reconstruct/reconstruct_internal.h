/**
 * reconstruct_internal.h: the state of a reconstruction, and what its stages call of each other.
 *
 *   reconstruct.c             creation, steps, edits; the order of the stages
 *   reconstruct_chords.c      chords: which curves are doubled together, and which chord first
 *   reconstruct_chords_fill.c counts of edges that fill the limit of quads
 *   reconstruct_polylines.c   curves as polylines on the surface, rerouted where they left it; their vertices
 *   reconstruct_samples.c     samples of the surface, and their parameters by projection onto the lattices
 *   reconstruct_parameters.c  the first parameters of samples, along the surface
 *   reconstruct_maps.c        lattices from maps of the patches over the triangles of the surface
 *   reconstruct_levels.c      lattices that start anew, and are settled with half as many edges first
 *   reconstruct_anchors.c     lattices that miss a part of the surface, fitted by parameters along it
 *   reconstruct_lattice.c     lattices: Coons patches, doubling, fairing
 *   reconstruct_lattice_start.c       lattices from grids that came with the layout
 *   reconstruct_lattice_fit.c         inner vertices of lattices from the samples around them
 *   reconstruct_lattice_untangle.c    repair of folded and inverted quads
 *   reconstruct_lattice_mesh.c        lattices to a mesh, and its boundary
 *   reconstruct_noise_fit.c   lattices as a least-squares fit to noisy points
 *   reconstruct_bending.c     the bending energy of that fit
 *   reconstruct_warnings.c    whether the layout fits the surface; what the result does not show by itself
 *
 * A layout patch has a lattice of vertices. A chord has two counts: `edges` is that of the mesh;
 * `lattice_edges` is that of the lattices, a multiple of it and at least QM_RECONSTRUCTION_BASE. The
 * mesh takes every (lattice_edges / edges)th vertex.
 */
#ifndef QM_RECONSTRUCT_INTERNAL_H
#define QM_RECONSTRUCT_INTERNAL_H

#include "cloud/cloud_points.h"
#include "core/vec.h"
#include "layout/knn_graph.h"
#include "layout/layout_creases.h"
#include "mesh/quad_shape.h"
#include "qm/reconstruct.h"
#include "tmesh/tmesh_maps.h"

/** The curves that are doubled together. */
typedef struct qm_chord {
    uint32_t edges, lattice_edges;
    double length; /* of the longest lattice line along the chord */
} qm_chord;

/** A layout curve as a polyline on the surface. */
typedef struct qm_polyline {
    uint32_t chord;        /* QM_NO_INDEX: the curve is a side of no patch */
    size_t point_count;    /* of the fine polyline */
    double *points;        /* rows of x y z, on the surface if options.pull_curves */
    double *arc;           /* arc length up to each point */
    double *vertices;      /* vertex_edges + 1 rows, nearer where it turns */
    double *across;        /* of the vertices of a sharp curve, see qm_creases_step_across; else NULL */
    uint32_t vertex_edges; /* lattice_edges of the chord */
} qm_polyline;

/**
 * The vertices of a patch: rows + 1 rows of columns + 1 points. (0, 0) is corner 0; columns run along side 0.
 */
typedef struct qm_lattice {
    uint32_t columns, rows;
    double *vertices;
    bool *in_hole;    /* of each vertex: no three samples enclosed it when it was fitted */
    bool is_stale;    /* split in this step: its inner vertices are to be fitted */
    bool faces_walls; /* its normals are about those of the surface, which are known */
    bool
        is_flipped; /* its patch runs round the other way than in the layout that was given: rows are columns there */
    bool spans_hole;    /* no surface is under it: a Coons patch between its curves */
    uint32_t component; /* of the layout: patches that curves connect */
    size_t points;      /* samples that belong to the patch */
} qm_lattice;

/** Parameters in a patch, in edges of its lattice from corner 0. */
typedef struct qm_sample_location {
    double u, v, distance;
    uint32_t patch;
} qm_sample_location;

/** Points of the surface: quasirandom points of a mesh, or a subset of a point set. */
typedef struct qm_samples {
    size_t count, capacity;
    double *positions; /* rows of x y z */
    float
        *normals; /* rows of x y z, of any length: of the faces, or of the points; NULL for points without */
    qm_sample_location *location;
    bool is_projected; /* locations come from projection onto the lattices */
} qm_samples;

/**
 * Points of the surface with parameters along it, which a patch has wherever its lattice is. None on point sets, nor where
 * normals do not tell walls apart.
 */
typedef struct qm_anchors {
    size_t count, capacity, sample_count; /* samples come first, then points of curves, once for each patch */
    double *positions;                    /* rows of x y z */
    float *normals;                       /* rows of x y z, of any length */
    qm_sample_location *at;               /* parameters from 0 to 1 */
    qm_bvh *tree;                         /* of the positions */
} qm_anchors;

struct qm_reconstruction {
    qm_ref_surface given;   /* the surface as it came */
    qm_ref_surface surface; /* what the stages work on: the same, or the guide's */
    qm_guide *guide;        /* NULL where the points are exact */
    double outlier_share;   /* of the points */
    qm_reconstruction_options options;
    qm_layout layout;
    qm_creases creases; /* near sharp curves; none without such */
    qm_chord *chords;   /* capacity layout.curve_count */
    size_t chord_count;
    qm_polyline *polylines; /* layout.curve_count */
    qm_lattice *lattices;   /* layout.patch_count */
    qm_anchors anchors;
    qm_tmesh_maps *maps; /* while a mesh is made anew; else NULL */
    size_t point_count, uncovered_count;
    bool has_sides; /* the surface's normals tell its walls apart, and the patches are oriented by them */
};

/** Vertices low to high of a lattice: columns, then rows. */
typedef struct qm_vertex_block {
    uint32_t low[2], high[2];
} qm_vertex_block;

static inline size_t qm_lattice_index(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    return (size_t)row * (lattice->columns + 1) + column;
}

static inline double *qm_lattice_vertex(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    return lattice->vertices + 3 * qm_lattice_index(lattice, column, row);
}

static inline qm_vec qm_lattice_at(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    return qm_vec_load(qm_lattice_vertex(lattice, column, row));
}

static inline size_t qm_lattice_vertex_count(const qm_lattice *lattice)
{
    return ((size_t)lattice->rows + 1) * ((size_t)lattice->columns + 1);
}

/** The corners of a quad, in order. */
static inline void qm_lattice_quad(const qm_lattice *lattice, uint32_t column, uint32_t row, qm_vec out[4])
{
    QM_ASSERT(column < lattice->columns && row < lattice->rows);
    out[0] = qm_lattice_at(lattice, column, row);
    out[1] = qm_lattice_at(lattice, column + 1, row);
    out[2] = qm_lattice_at(lattice, column + 1, row + 1);
    out[3] = qm_lattice_at(lattice, column, row + 1);
}

/** The area of a quad. */
static inline double qm_lattice_quad_area(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    qm_vec corner[4];
    qm_lattice_quad(lattice, column, row, corner);
    return 0.5 *
           qm_vec_norm(qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1])));
}

/** The root of the mean area of the quads of a lattice. */
static inline double qm_lattice_mean_edge(const qm_lattice *lattice)
{
    double area = 0.0;
    for (uint32_t j = 0; j < lattice->rows; j++)
        for (uint32_t i = 0; i < lattice->columns; i++)
            area += qm_lattice_quad_area(lattice, i, j);
    return sqrt(area / ((double)lattice->columns * lattice->rows));
}

/** The scaled Jacobian of a quad: the least sine at its corners; not above 0 where it is folded. */
static inline double qm_lattice_quad_sine(const qm_lattice *lattice, uint32_t column, uint32_t row)
{
    qm_vec corner[4];
    qm_lattice_quad(lattice, column, row, corner);
    return qm_quad_min_sine(corner);
}

/** The chord of the columns (direction 0) or rows (direction 1) of a patch. */
static inline qm_chord *qm_chord_of_patch(const qm_reconstruction *r, size_t patch, int direction)
{
    QM_ASSERT(patch < r->layout.patch_count);
    return &r->chords[r->polylines[r->layout.patches[patch].side[direction]].chord];
}

/** Checks that the layout lies where the surface does, in its unit. QM_OK or QM_E_LAYOUT. */
qm_status qm_reconstruction_check_place(qm_context *ctx, const qm_ref_surface *surface,
                                        const qm_layout *layout, double cover_distance);

/** Finds the chords of the layout. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_chords_find(qm_context *ctx, qm_reconstruction *r);

/**
 * Doubles the chords whose edges are longer than the longest over the square root of 2; sets chords_changed and patches_split. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_chords_double(qm_context *ctx, qm_reconstruction *r, qm_reconstruction_record *out);

/** Would the mesh stay within a limit if a step doubled all that it wants to? */
bool qm_chords_can_double(const qm_reconstruction *r, size_t max_quads);

/**
 * Chooses counts of edges for all chords, which need not be powers of two, such that the mesh has as many quads as fit and
 * they are where the surface bends; no change if that is not more quads than it has. Sets chords_changed and
 * patches_split. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_chords_fill(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                         qm_reconstruction_record *out);

/** Sets the chords' lengths from the lattices. */
void qm_chords_measure(qm_reconstruction *r);

/**
 * Doubles lattice_edges of the chord with the longest ones while the lattices have at most max_quads quads.
 */
void qm_chords_refine_lattices(qm_reconstruction *r, size_t max_quads);

size_t qm_chords_count_quads(const qm_reconstruction *r);
double qm_chords_longest_edge(const qm_reconstruction *r);

/** Makes the polyline of each curve. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_polylines_create(qm_context *ctx, qm_reconstruction *r);

/**
 * Reroutes polylines that jump from one layer of the surface to another: along a shortest path over
 * sample_count samples. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_polylines_reroute(qm_context *ctx, qm_reconstruction *r, size_t sample_count);

/** True if the polyline of a smooth curve jumps from one layer of the surface to another. */
bool qm_polylines_has_jump(const qm_reconstruction *r, size_t curve);

/** Lays the polyline of a curve along points on the surface. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_polylines_follow(qm_context *ctx, qm_reconstruction *r, size_t curve, const double *points,
                              size_t count);

/** Removes reversals from the polylines, which points make that are projected past their neighbours. */
void qm_polylines_straighten(qm_reconstruction *r);

/**
 * Sets the vertices of each polyline whose chord has another number of lattice edges. QM_OK or
 * QM_E_NO_MEMORY.
 */
qm_status qm_polylines_set_vertices(qm_context *ctx, qm_reconstruction *r);

/** The point and unit tangent of a polyline at a fraction of its length. */
void qm_polyline_at(const qm_polyline *polyline, double fraction, double position[3], qm_vec *tangent);

/**
 * Allocates the vertices of a lattice, none of them in a hole. False when out of memory, with nothing to
 * free.
 */
bool qm_lattice_allocate(qm_context *ctx, qm_lattice *lattice);
void qm_lattice_free(qm_context *ctx, qm_lattice *lattice);

/** The point of the Coons patch over the border of a block at a vertex. */
qm_vec qm_lattice_coons(const qm_lattice *lattice, const qm_vertex_block *block, uint32_t column,
                        uint32_t row);

/** Replaces all lattices by Coons patches. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_lattices_create(qm_context *ctx, qm_reconstruction *r);

/** Flips each component of patches whose grids are clockwise about the normals of the surface, a mesh. */
void qm_lattices_orient(qm_reconstruction *r);

/** Replaces all lattices by such whose inner vertices lie where grids or maps tell: there are such. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_lattices_place(qm_context *ctx, qm_reconstruction *r);

/**
 * Starts lattices with the numbers of edges of the mesh where grids or maps tell, settled with half as many first, unless these are too
 * few: *is_settled tells. Needs no lattices. steps: the polylines of the mesh of the steps, from which fixed curves have their vertices; or NULL. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_levels_fill(qm_context *ctx, qm_reconstruction *r, const qm_quads_options *quads,
                         const qm_polyline *steps, bool *is_settled);

/**
 * Brings the lattices to their chords' counts; those that it changes become stale. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_lattices_resample(qm_context *ctx, qm_reconstruction *r);

/**
 * Finds which stale lattices face walls of the surface: those whose Coons patches lie along it. Replaces one by that
 * patch, projected, where far fewer of its vertices are off their wall. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_lattices_choose(qm_context *ctx, qm_reconstruction *r);

/** The unit normal of a lattice at a vertex from its two to four neighbours; 0 where they lie on a line. */
qm_vec qm_lattice_normal(const qm_lattice *lattice, uint32_t column, uint32_t row);

/** Projects a position of an inner vertex onto the wall that the lattice faces there, if it does. True if there
 * is such a wall near. In a hole of a mesh the position stays. */
bool qm_lattice_project(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t column,
                        uint32_t row, const double p[3], qm_ref_surface_point *out);

/**
 * A direction that the surface looks along beside a sharp side of a patch, and not beyond it: for a place in the first row of
 * quads from such sides. 0 elsewhere.
 */
qm_vec qm_lattice_own_side(const qm_reconstruction *r, size_t patch, double u, double v);

/** As qm_lattice_project, of a patch; beside a sharp curve onto its own side of the crease. */
bool qm_lattice_project_own(const qm_reconstruction *r, size_t patch, uint32_t column, uint32_t row,
                            const double p[3], qm_ref_surface_point *out);

/** Evens out the inner vertices of stale lattices within the surface. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_lattices_fair(qm_context *ctx, qm_reconstruction *r, int rounds);

/** Fits the inner vertices of stale lattices to the samples. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_lattices_fit(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples);

/** Moves the inner vertices of folded and inverted quads until none is left or none improves. */
void qm_lattice_untangle(const qm_ref_surface *surface, const qm_lattice *lattice);

/**
 * Rebuilds blocks of vertices round quads that are folded or lie inverted between their neighbours, where
 * that leaves fewer of them. True if a vertex has moved.
 */
bool qm_lattice_rebuild_inverted(const qm_ref_surface *surface, const qm_lattice *lattice);

/** The patch of a face of a mesh of all lattices; first[p] is the index of patch p's first face. */
size_t qm_lattices_find_patch(const size_t *first, size_t patch_count, uint32_t face);

/**
 * The mesh of all vertices of the lattices when fine, else that of the chords' edges, without folded quads as
 * far as possible. QM_OK; QM_E_TOO_LARGE; QM_E_NO_MEMORY.
 */
qm_status qm_lattices_mesh(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_mesh *out);

/** As qm_reconstruction_find_marks, of the mesh of all vertices of the lattices when fine. */
qm_status qm_lattices_find_marks(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_quads_marks *out);

/** Sets the vertices of all lattices and polylines from a mesh of all lattices. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_lattices_set(qm_context *ctx, qm_reconstruction *r, const qm_mesh *mesh);

/**
 * Where the points have noise, fits all vertices to them, those of curves as well unless these are kept; of the stale lattices and what
 * they alone have if only_stale. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_noise_fit_lattices(qm_context *ctx, qm_reconstruction *r, bool only_stale);

/**
 * Takes `wanted` samples of the surface, or fewer if a point set has fewer points. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_samples_create(qm_context *ctx, const qm_reconstruction *r, size_t wanted, qm_samples *out);
void qm_samples_reset(qm_context *ctx, qm_samples *samples);

/** Sets the locations of samples by projection onto the lattices. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_samples_project(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples);

/** The distances of points from the mesh of all lattices. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_samples_distances(qm_context *ctx, const qm_reconstruction *r, const double *points,
                               size_t count, double *out);

/** Scales locations that count `base` edges a side to the edges of the lattices. */
void qm_samples_scale(const qm_reconstruction *r, qm_samples *samples, uint32_t base);

/**
 * Sets whether the surface has sides: if the samples' own normals are known, and consistent between neighbours. Those
 * on the two walls of a sheet or gap are opposed and consistent. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_samples_find_sides(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples);

/** Flips the normals of the graph to agree with the samples' own, and removes links between opposed samples. */
void qm_samples_orient_graph(const qm_samples *samples, qm_knn_graph *graph);

/** Makes maps of the patches; *out is the caller's, NULL where these do not cover an exact mesh. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_maps_find(qm_context *ctx, const qm_reconstruction *r, qm_tmesh_maps **out);

/** Lays polylines that jump along the surface, if there are any and the patches cover an exact mesh. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_maps_lay_jumps(qm_context *ctx, qm_reconstruction *r);

/** Starts the inner vertices of all lattices at their places on the maps. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_maps_start(qm_context *ctx, qm_reconstruction *r);

/** Makes room for anchors, none of them added. False when out of memory, with nothing to free. */
bool qm_anchors_allocate(qm_context *ctx, size_t capacity, qm_anchors *out);
void qm_anchors_add(qm_anchors *anchors, const double position[3], qm_vec normal, uint32_t patch, double u,
                    double v);

/** Builds the tree, when all are added. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_anchors_index(qm_context *ctx, qm_anchors *anchors);
void qm_anchors_reset(qm_context *ctx, qm_anchors *anchors);

/**
 * Fits stale lattices that miss anchors by the anchors' parameters, where that is better. The samples are projected; if there are
 * such lattices, they are not afterwards. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_anchors_recover(qm_context *ctx, qm_reconstruction *r, qm_samples *samples);

/** Reverses the orientation of a patch; its corner 0 stays. */
void qm_parameters_flip(qm_reconstruction *r, size_t patch);

/**
 * Orients the patches of each component as its first one, breadth first: two run along a common curve in opposite directions.
 * Numbers the components. QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_parameters_orient(qm_context *ctx, qm_reconstruction *r);

/**
 * Orients the patches of the layout consistently, anticlockwise about the surface's normals, and, unless there are grids, sets
 * the first locations of the samples by a parameterization along the surface, and the anchors. QM_OK; QM_E_NO_MEMORY;
 * QM_E_CANCELED.
 */
qm_status qm_parameters_find(qm_context *ctx, qm_reconstruction *r, qm_samples *samples);

#endif
