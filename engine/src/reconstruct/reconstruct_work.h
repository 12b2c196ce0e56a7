/**
 * reconstruct_work.h: the inside of a reconstruction, shared by its stages.
 *
 *   reconstruct.c          creation, edits, what is told of the result
 *   reconstruct_step.c     the step
 *   reconstruct_chords.c   which curves are doubled together, and which go first
 *   reconstruct_curves.c   curves on the surface, vertices at equal arc length
 *   reconstruct_detours.c  curves led round where they leave the surface for good
 *   reconstruct_grids.c    grids of vertices: Coons patches, doubling, fairing
 *   reconstruct_samples.c  points of the surface, and their parameters in the grids
 *   reconstruct_sides.c    samples on the wrong side, by their normals
 *   reconstruct_place.c    inner vertices from the points that enclose them
 *   reconstruct_untangle.c folded quads smoothed out
 *   reconstruct_unturn.c   quads upside down laid anew
 *   reconstruct_mesh.c     grids to meshes
 *   reconstruct_rim.c      the rim of all patches, beyond which nothing was drawn
 *   reconstruct_state.c    copies to go back to when a step fails
 *   reconstruct_edit.c     what stays when the layout is edited
 *   reconstruct_atlas.c    first parameters of samples, along the surface
 *
 * Counts of two kinds: `edges` is that of the mesh, a power of two from 1 on; `work` is that of the grids, at
 * least the base. The mesh takes every (work / edges)th vertex.
 */
#ifndef QM_RECONSTRUCT_WORK_H
#define QM_RECONSTRUCT_WORK_H

#include "core/vec.h"
#include "mesh/quad_shape.h"
#include "qm/reconstruct.h"

/** Curves that are doubled together. */
typedef struct qm_chord {
    uint32_t edges, work;
    double length; /* mean length of the lines along it, in the patch where that is greatest */
} qm_chord;

/** A curve on the surface. */
typedef struct qm_track {
    uint32_t chord;        /* QM_NO_INDEX: no patch has this curve */
    size_t point_count;    /* of the fine polyline */
    double *points;        /* rows of x y z, on the surface where curves are pulled */
    double *arc;           /* length up to each point */
    double *vertices;      /* work + 1 rows at equal arc length */
    uint32_t vertex_edges; /* how many edges the vertices make: work of the chord */
} qm_track;

/** Vertices of a patch: (rows + 1) rows of (columns + 1) points; (0, 0) is corner 0, columns go along side
 * 0. */
typedef struct qm_patch_grid {
    uint32_t columns, rows;
    double *vertices;
    bool *in_hole; /* of each vertex: no three samples enclosed it when it was placed */
    bool is_stale; /* split in this step: its inner vertices are to be placed */
    uint32_t part; /* of the layout: patches that curves connect */
    size_t points;
} qm_patch_grid;

/** Where a point lies in the grids: parameters count edges of the grid from corner 0. */
typedef struct qm_sample_place {
    double u, v, distance;
    uint32_t patch;
} qm_sample_place;

/** Points of the surface: an even spread over a mesh, or a share of a point set. */
typedef struct qm_samples {
    size_t count, capacity;
    double *positions; /* rows of x y z */
    float *normals;    /* the same, of any length: of the faces, or what came with the points; NULL for points
                          without */
    qm_sample_place *place;
    bool is_projected; /* places come from projection on the grids */
} qm_samples;

struct qm_reconstruction {
    qm_source source;
    qm_reconstruction_options options;
    qm_layout layout;
    qm_chord *chords; /* room for curve_count of them */
    size_t chord_count;
    qm_track *tracks;     /* layout.curve_count of them */
    qm_patch_grid *grids; /* layout.patch_count of them */
    size_t point_count, uncovered_count;
};

static inline double qm_reconstruction_reach(const qm_reconstruction *r)
{
    return r->options.cover_share * r->source.diagonal;
}

static inline size_t qm_grid_index(const qm_patch_grid *grid, uint32_t column, uint32_t row)
{
    return (size_t)row * (grid->columns + 1) + column;
}

static inline double *qm_grid_vertex(const qm_patch_grid *grid, uint32_t column, uint32_t row)
{
    return grid->vertices + 3 * qm_grid_index(grid, column, row);
}

static inline qm_vec qm_grid_at(const qm_patch_grid *grid, uint32_t column, uint32_t row)
{
    return qm_vec_load(qm_grid_vertex(grid, column, row));
}

/** The least sine at a corner of a quad of a grid; not above 0 where it is folded. */
static inline double qm_grid_quad_sine(const qm_patch_grid *grid, uint32_t column, uint32_t row)
{
    const qm_vec corner[4] = {qm_grid_at(grid, column, row), qm_grid_at(grid, column + 1, row),
                              qm_grid_at(grid, column + 1, row + 1), qm_grid_at(grid, column, row + 1)};
    return qm_quad_least_sine(corner);
}

/** Vertices from low to high of a grid: columns, then rows. */
typedef struct qm_vertex_block {
    uint32_t low[2], high[2];
} qm_vertex_block;

static inline size_t qm_grid_vertex_count(const qm_patch_grid *grid)
{
    return ((size_t)grid->rows + 1) * ((size_t)grid->columns + 1);
}

/** Vertex k, counted along the side (0 at corner `side`), of a side of a patch. */
static inline const double *qm_border_vertex(const qm_reconstruction *r, const qm_layout_patch *patch,
                                             int side, uint32_t k)
{
    const qm_track *track = &r->tracks[patch->side[side]];
    return track->vertices + 3 * (size_t)(patch->against[side] ? track->vertex_edges - k : k);
}

/** Chord of the columns (direction 0) or rows (direction 1) of a patch. */
static inline qm_chord *qm_patch_chord(const qm_reconstruction *r, size_t patch, int direction)
{
    return &r->chords[r->tracks[r->layout.patches[patch].side[direction]].chord];
}

qm_status qm_chords_find(qm_context *ctx, qm_reconstruction *r);
/** Chooses and doubles the chords of one step; fills chords_doubled and patches_split. */
qm_status qm_chords_double(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                           qm_reconstruction_record *out);
/** Finds the chords' lengths from the grids; doubles the work of the longest while there are few enough
 * quads. */
void qm_chords_measure(qm_reconstruction *r);
void qm_chords_refine_work(qm_reconstruction *r, size_t max_quads);
size_t qm_chords_quads(const qm_reconstruction *r);
double qm_chords_longest(const qm_reconstruction *r);

/** Lays the curves on the surface; then vertices of each at its chord's count. */
qm_status qm_tracks_create(qm_context *ctx, qm_reconstruction *r);
/** Lays the fine points of a track along a polyline. */
qm_status qm_track_lay(qm_context *ctx, const qm_reconstruction *r, const double *points, size_t count,
                       qm_track *track);

/** Leads curves that jump from one sheet of the surface to another round along it, over so many samples. */
qm_status qm_tracks_detour(qm_context *ctx, qm_reconstruction *r, size_t wanted);

/** Takes turns back out of the curves, which neighbouring points make when they are pulled past each
 * other. */
void qm_tracks_straighten(qm_reconstruction *r);

/** Point and direction of a curve at a share of its length. */
void qm_track_at(const qm_track *track, double share, double position[3], qm_vec *tangent);
qm_status qm_tracks_set_vertices(qm_context *ctx, qm_reconstruction *r);

/** Vertices of a grid with its counts, in no hole; false when out of memory, with nothing to free. */
bool qm_grid_allocate(qm_context *ctx, qm_patch_grid *grid);
void qm_grid_free(qm_context *ctx, qm_patch_grid *grid);

/** Where a vertex lies in the Coons patch over the border of a block. */
qm_vec qm_grid_coons(const qm_patch_grid *grid, const qm_vertex_block *block, uint32_t column, uint32_t row);

/** Grids as Coons patches; doubled to their chords' counts; inner vertices evened out within the surface. */
qm_status qm_grids_create(qm_context *ctx, qm_reconstruction *r);
qm_status qm_grids_double(qm_context *ctx, qm_reconstruction *r);
qm_status qm_grids_fair(qm_context *ctx, qm_reconstruction *r, int rounds);

/** Puts a vertex at the surface's point for a place, or there where a point set has none nearby. */
void qm_source_place(const qm_source *source, qm_vec place, double vertex[3]);
/** Lays blocks round quads that are folded or lie upside down between their neighbours anew, where that
 * leaves fewer of them; true when any vertex has moved. */
bool qm_grid_unturn(const qm_source *source, const qm_patch_grid *grid);
/** Smooths folded quads out, of one grid and of all stale ones; outlines stay. */
void qm_grid_untangle(const qm_source *source, const qm_patch_grid *grid);
void qm_grids_untangle(const qm_reconstruction *r);

/** So many samples, or fewer where a point set has not as many; and their places in the grids. */
qm_status qm_samples_create(qm_context *ctx, const qm_reconstruction *r, size_t wanted, qm_samples *out);
qm_status qm_samples_locate(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples);
/** As many as the quads of the grids need. */
qm_status qm_samples_create_fine(qm_context *ctx, const qm_reconstruction *r, qm_samples *out);
/** Takes the parameters of samples whose normals look the other way than the grid under them: these lie on
 * the other wall of a gap or sheet. Only in patches where nearly all samples agree, as normals may be wrong.
 * QM_OK or QM_E_NO_MEMORY. */
qm_status qm_samples_drop_turned(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples);
/** Makes parameters count the edges of the grids; before, a patch has base edges a side. */
void qm_samples_scale(const qm_reconstruction *r, qm_samples *samples, uint32_t base);
void qm_samples_reset(qm_context *ctx, qm_samples *samples);
/** The patch that a face of a mesh of the grids belongs to; first has the number of each patch's first
 * face. */
size_t qm_patch_of_face(const size_t *first, size_t patch_count, uint32_t face);

/** Places the inner vertices of stale grids. */
qm_status qm_place_vertices(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples);

#define QM_STEP_FAIR 4 /* rounds of evening out before the vertices of a step are placed */

/** Evens the stale grids out in so many rounds and places their vertices again, by the samples projected on
 * them. */
qm_status qm_grids_refine(qm_context *ctx, qm_reconstruction *r, int fair, qm_samples *samples);

/** What a step changes, copied before it: counts, vertices of curves and grids. */
typedef struct qm_saved_state {
    qm_chord *chords;
    qm_track *tracks; /* only their vertices are copies */
    qm_patch_grid *grids;
} qm_saved_state;
qm_status qm_state_save(qm_context *ctx, const qm_reconstruction *r, qm_saved_state *out);
void qm_state_drop(qm_context *ctx, const qm_reconstruction *r, qm_saved_state *saved);
/** Puts the copy back in place of what is there, and is gone afterwards. */
void qm_state_restore(qm_context *ctx, qm_reconstruction *r, qm_saved_state *saved);

/** What is taken over from the reconstruction of the layout before an edit: counts of chords; tracks of
 * curves that run as they did; grids of patches of such curves. The last tells how many grids are still to be
 * made. */
void qm_edit_inherit_counts(qm_reconstruction *r, const qm_reconstruction *old);
void qm_edit_inherit_tracks(qm_reconstruction *r, const qm_reconstruction *old);
size_t qm_edit_keep_grids(qm_reconstruction *r, const qm_reconstruction *old);

/** The mesh of the working grids when fine, else that of the mesh's own counts, free of folds where that can
 * be. */
qm_status qm_grids_mesh(qm_context *ctx, const qm_reconstruction *r, bool fine, qm_mesh *out);

#endif
