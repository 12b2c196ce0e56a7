/**
 * tmesh_lattice.h: the lattices that the curves of a layout are drawn with (tmesh_curves.c), and how they are mended where they fold
 * (tmesh_mend.c).
 */
#ifndef QM_TMESH_LATTICE_H
#define QM_TMESH_LATTICE_H

#include "tmesh/tmesh.h"
#include "tmesh/tmesh_chart.h"

/** A vertex of the lattices. */
typedef struct qm_tmesh_point {
    qm_vec at, sum, normal, normal_sum;
    uint32_t count; /* of neighbours in sum */
    bool is_fixed, is_pinned, is_loose;
    uint32_t chain; /* that a fixed point may slide on; QM_NO_INDEX */
    double place;   /* on that chain */
    qm_vec pin;     /* of a required vertex */
    double pull;    /* towards it */
} qm_tmesh_point;

typedef struct qm_tmesh_cell {
    uint32_t corner[4];
    uint32_t face;   /* its first lattice point of the layout's face: an index of grid */
    uint32_t stride; /* of the grid */
    bool is_folded;
    bool is_charted; /* drawn in a chart, where it is not folded */
    double sign;     /* of its area about the normals of the surface, when it is not folded */
} qm_tmesh_cell;

typedef struct qm_tmesh_lattice {
    qm_tmesh_point *points;
    size_t point_count;
    qm_tmesh_cell *cells;
    size_t cell_count;
    uint32_t *first_at; /* by point: of at */
    uint32_t *at;       /* 4 * cell + corner */
} qm_tmesh_lattice;

/** Points of curves between two points of lattices, on the surface. */
enum { QM_TMESH_TRACE = 15 };

typedef struct qm_tmesh_trace {
    uint32_t point[2]; /* the lower first; QM_NO_INDEX: none */
    qm_vec at[QM_TMESH_TRACE];
} qm_tmesh_trace;

/** A hash table of traces. */
typedef struct qm_tmesh_traces {
    qm_tmesh_trace *slots;
    size_t count, capacity; /* a power of two, or 0 */
} qm_tmesh_traces;

/** The trace between two points; NULL if there is none. */
const qm_tmesh_trace *qm_tmesh_traces_find(const qm_tmesh_traces *traces, uint32_t a, uint32_t b);

/** True if the lattice has left the place that a point started at, its pin: it is more than a few cells away from the points from there on. */
bool qm_tmesh_is_lost(const qm_tmesh_lattice *lattice, uint32_t index);

/**
 * Draws cells anew in charts of the surface, with cells round them, so that none of them folds there, and the curves between their
 * points do not cross: each of the seeds that this succeeds for has is_seed cleared, and its new neighbours' is_charted
 * set.
 *
 * is_seed  by cell
 * rings    of cells round the seeds that are drawn anew, at least
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_mend(qm_arena *arena, qm_tmesh_triangles *triangles, qm_tmesh_lattice *lattice,
                        bool *is_seed, int rings, qm_tmesh_traces *traces);

#endif
