/**
 * tmesh.h: shared by the files that make a layout of a quad mesh (quad_layout.c): the mesh made ready
 * (tmesh_quads.c), its T-mesh (tmesh.c), whether integer lengths of the arcs give a layout (tmesh_classes.c),
 * lengths for which they do (tmesh_lengths.c), and the layout's curves (tmesh_curves.c, from tmesh_source.c).
 *
 * A T-mesh divides the quads into patches: rectangles of rows x columns, between cuts. Nodes are the corners of
 * patches, and all points where something meets a cut. An arc is a part of a cut between two nodes. A side of a patch
 * is a list of arcs: there are T-junctions.
 *
 *     corner 3 <--- side 2 ---- corner 2         side 0 runs along row 0, side 1 along the last column,
 *        |                         ^             side 2 back along the last row, side 3 back along column 0
 *      side 3                    side 1
 *        v                         |             axis 0 is that of sides 0 and 2, axis 1 of sides 1 and 3
 *     corner 0 ---- side 0 ---> corner 1
 */
#ifndef QM_TMESH_H
#define QM_TMESH_H

#include "core/arena.h"
#include "core/vec.h"
#include "qm/patch.h"
#include "qm/quad_layout.h"
#include "tmesh/tmesh_chart.h"

/* ---- the mesh, made ready ---- */

typedef struct qm_tmesh_edge {
    uint32_t vertex[2]; /* the lower first */
    uint32_t face[2];   /* face[1] is QM_NO_INDEX on a boundary */
    bool is_feature;    /* a crease or a boundary */
} qm_tmesh_edge;

/** Quads alone, manifold, with their features. Its arrays are the arena's. */
typedef struct qm_tmesh_quads {
    qm_mesh mesh;
    qm_tmesh_edge *edges;
    size_t edge_count;
    uint32_t *side_edge; /* 4 a face: the edge of each side */
    uint8_t *creases;    /* as for qm_patch_set_trace */
    bool *is_required;   /* by vertex: a layout must have a node there, and no other required vertex in it */
    bool *is_on_feature; /* by vertex */
    size_t required_count;
} qm_tmesh_quads;

/**
 * Makes a mesh ready. When a face is not a quad, all are divided into quads, at their centroids and the midpoints of
 * their edges. Edges of three faces or more become boundaries, and a vertex with several fans becomes one for each.
 * Required are irregular vertices, ends and meetings of creases, and points where a crease or boundary has not two
 * quads on a side or turns sharply.
 *
 * options  how creases are known; when faces have other places than in mesh, creases are not used
 *
 * Returns: QM_OK; QM_E_EMPTY (no face has an area); QM_E_TOO_LARGE; QM_E_NO_MEMORY.
 */
qm_status qm_tmesh_quads_make(qm_arena *arena, const qm_mesh *mesh, const qm_quad_layout_options *options,
                              qm_tmesh_quads *out);

/* ---- the T-mesh ---- */

typedef struct qm_tmesh_arc {
    uint32_t from, to; /* nodes */
    uint32_t length;   /* in edges */
    uint32_t first_edge;
    uint32_t slot[2]; /* where it lies; slot[1] is QM_NO_INDEX on a boundary */
    bool is_feature;
} qm_tmesh_arc;

/** An arc as a part of a side of a patch. */
typedef struct qm_tmesh_slot {
    uint32_t arc;
    uint32_t patch;
    uint32_t start; /* edges of the side before it */
    uint8_t side;
    bool forward; /* the arc runs as the side does */
} qm_tmesh_slot;

typedef struct qm_tmesh_patch {
    uint32_t rows, columns;
    uint32_t first[5]; /* slots of side s: first[s] to first[s + 1] */
} qm_tmesh_patch;

/** Its arrays are the arena's. */
typedef struct qm_tmesh {
    qm_tmesh_patch *patches;
    qm_tmesh_slot *slots;
    qm_tmesh_arc *arcs;
    uint32_t *node_vertex;
    size_t patch_count, slot_count, arc_count, node_count;
} qm_tmesh;

/** Makes the T-mesh of the patches of the quads. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_tmesh_make(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set, qm_tmesh *out);

static inline uint32_t qm_tmesh_mate(const qm_tmesh *tmesh, uint32_t slot)
{
    const qm_tmesh_arc *arc = &tmesh->arcs[tmesh->slots[slot].arc];
    return arc->slot[0] == slot ? arc->slot[1] : arc->slot[0];
}

/** Sum of the lengths on a side. */
static inline uint32_t qm_tmesh_side_length(const qm_tmesh *tmesh, const uint32_t *length, size_t patch,
                                            int side)
{
    const qm_tmesh_patch *at = &tmesh->patches[patch];
    uint32_t sum = 0;
    for (uint32_t s = at->first[side]; s < at->first[side + 1]; s++)
        sum += length[tmesh->slots[s].arc];
    return sum;
}

/* ---- lengths and what they give ---- */

/**
 * What remains of the T-mesh when each arc has its integer length, which may be 0, and opposite sides of every patch
 * have equal sums. Points are the nodes, the inner points of arcs at unit steps, and those of patches; those
 * that fall on each other form a class. So do unit segments of arcs, across patches of no width.
 */
typedef struct qm_tmesh_classes {
    size_t point_count, segment_count;
    uint32_t *first_point;   /* by arc: its inner points, length - 1 of them */
    uint32_t *first_segment; /* by arc */
    uint32_t *point_class;   /* by point: the lowest point of its class */
    uint32_t *segment_class; /* by segment: the lowest of its class */
    /* Points and segments along side s of patch p, from first_side[4 p + s] on: one more point than segments. The
       segments' lowest bit is set where the arc runs against the side. */
    uint32_t *first_side;
    uint32_t *side_point;
    uint32_t *side_segment;
    size_t face_count; /* unit squares of all patches */
    size_t side_sum;   /* half the girth of all patches */
    size_t fault_count;
    uint32_t *fault_first; /* fault_count + 1 */
    uint32_t *fault_arcs;  /* a longer one of them may mend the fault */
} qm_tmesh_classes;

/**
 * Finds the classes of lengths, and whether they are a layout: no two required vertices in a class, nor two points of
 * features but along the feature; every class of points and of segments contractible, so that the layout has the shape
 * of the surface (R. L. Moore, Concerning upper semi-continuous collections of continua, 1925); and four different
 * classes at the corners of every face. Finds at most fault_limit faults.
 *
 * Returns: QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_tmesh_classes_find(qm_arena *arena, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                const uint32_t *length, size_t fault_limit, qm_tmesh_classes *out);

/** The length of a side in steps. */
static inline uint32_t qm_tmesh_side_steps(const qm_tmesh_classes *classes, size_t patch, int side)
{
    const uint32_t *first = classes->first_side + 4 * patch + (size_t)side;
    return first[1] - first[0] - 1;
}

static inline uint32_t qm_tmesh_side_point(const qm_tmesh_classes *classes, size_t patch, int side,
                                           uint32_t step)
{
    return classes->side_point[classes->first_side[4 * patch + (size_t)side] + step];
}

static inline uint32_t qm_tmesh_side_segment(const qm_tmesh_classes *classes, size_t patch, int side,
                                             uint32_t step)
{
    return classes->side_segment[classes->first_side[4 * patch + (size_t)side] + step];
}

/**
 * Finds lengths that give a layout of few faces.
 *
 * effort  trials to find fewer
 * length  the caller's, one for each arc
 *
 * Returns: QM_OK; QM_E_LAYOUT (not even the quads are a layout); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_find_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                size_t effort, uint32_t *length);

/** Divides long arcs of a layout until it has nearly so many faces. Divided again, lengths are those that would have come of it at once.
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_tmesh_divide_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                  size_t wanted, uint32_t *length);

/**
 * Lengthens the longest arcs without length in classes that a drawing failed at, those of crossed curves first, and then
 * looks for fewer faces.
 *
 * is_held  by arc: it keeps a length from now on; all false before the first call
 *
 * *changed is false, and the lengths are as before, when there is none.
 */
qm_status qm_tmesh_spread_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                  const qm_tmesh_classes *classes, uint8_t *class_fault, bool *is_held,
                                  uint32_t *length, bool *changed);

/* ---- curves ---- */

/** Where a drawing starts: points along arcs and in patches, in cells. Its arrays are the arena's. */
typedef struct qm_tmesh_source {
    uint32_t *arc_cells;     /* by arc; 0: it is one point */
    size_t *first_arc_point; /* by arc: of its arc_cells + 1 points */
    uint32_t *arc_points, *node_points;
    size_t *first_cell;  /* by patch: of its grid, where that has an area */
    uint32_t *grid;      /* points of each patch, row by row */
    qm_vec *at, *normal; /* by point; the normal of the wall that it is on, of any length */
    bool is_oriented;    /* walls of the surface are told apart by normals */
} qm_tmesh_source;

/** Makes a source of the quads themselves. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_tmesh_source_of_quads(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set,
                                   const qm_tmesh *tmesh, const qm_ref_surface *surface,
                                   qm_tmesh_source *out);

/** A place of a source, and the normal that the surface has about there. */
typedef struct qm_tmesh_place {
    qm_vec at, normal;
} qm_tmesh_place;

qm_tmesh_place qm_tmesh_source_point(const qm_tmesh_source *source, uint32_t point);
/** The place at a share of an arc. */
qm_tmesh_place qm_tmesh_source_on_arc(const qm_tmesh_source *source, uint32_t arc, double share);
/** The place at a column and a row of a patch, in cells. */
qm_tmesh_place qm_tmesh_source_in_patch(const qm_tmesh_source *source, const qm_tmesh *tmesh, size_t patch,
                                        double column, double row);
/** Where a side has a place of the layout, in cells of the source: linear on each arc, in the middle of a jump. */
double qm_tmesh_source_on_side(const qm_tmesh_source *source, const qm_tmesh *tmesh, const uint32_t *length,
                               size_t patch, int side, double place);

/** The mesh's vertex after so many edges of an arc. */
uint32_t qm_tmesh_arc_vertex(const qm_tmesh_quads *quads, const qm_patch_set *set, const qm_tmesh *tmesh,
                             uint32_t arc, uint32_t i);

/** Points along curves, in the quads. */
typedef struct qm_tmesh_guides {
    size_t count;
    size_t *first; /* count + 1; of points */
    qm_vec *points;
    uint32_t *from_class; /* the class of points that each starts at; NULL: not told */
} qm_tmesh_guides;

/**
 * Finds how the curve of each class of segments runs in the quads, from one place of what has come together at its one end to one
 * place of that at the other: over arcs without length and across patches without width, and along the segment. The curves of all classes
 * could run there side by side. First those of segments, by lowest segment; others have none. Then for each patch, row by row and column by
 * column of its faces, that of the face's bottom and that of its left side, where these are inside the patch. The arrays are the arena's.
 * Returns false when out of memory.
 */
bool qm_tmesh_guides_find(qm_arena *arena, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                          const uint32_t *length, const qm_tmesh_classes *classes,
                          const qm_tmesh_source *source, const qm_ref_surface *surface, qm_tmesh_guides *out);

/** A layout, the curves of it that cross, and a grid of each of its patches. */
typedef struct qm_drawing {
    qm_layout layout;
    qm_layout_issues issues;
    double *grids; /* grid_count rows of QM_LAYOUT_GRID_POINTS points */
    size_t grid_count;
    bool *is_fixed;         /* by node: on a feature */
    bool *is_line;          /* by curve: along a feature */
    qm_tmesh_guides guides; /* by curve; its arrays are the context's */
} qm_drawing;

/** Where a drawing failed. */
typedef struct qm_tmesh_faults {
    bool is_refused;         /* there is no layout: too many cells were folded */
    size_t folds, crossings; /* cells of the lattices; pairs of curves */
    uint8_t *
        class_fault; /* by lowest point of a class of points: 2 at the end of a crossed curve, 1 at a corner of a
                                folded face, 0 else */
} qm_tmesh_faults;

/**
 * Draws the layout of lengths on a surface: each face is a lattice of cells, which starts where the source
 * is, and relaxes on the surface where it folds; points of features slide along them.
 *
 * is_rough   for the grids alone: crossings are not sought while cells are folded, and where very many are at first, it is refused
 * triangles  of the surface, or all zero: they are made when something folds; the caller's, for their reset
 * out        empty; the caller's, also after an error
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_draw_curves(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set,
                               const qm_tmesh *tmesh, const uint32_t *length, const qm_tmesh_classes *classes,
                               const qm_ref_surface *surface, const qm_tmesh_source *source, bool is_rough,
                               qm_tmesh_triangles *triangles, qm_drawing *out, qm_tmesh_faults *faults);

#endif
