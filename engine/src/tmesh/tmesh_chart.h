/**
 * tmesh_chart.h: discs of a surface, and maps of them to the plane that do not fold.
 *
 * Where lattices fold, nearness in space does not tell how the surface runs: between the tail and the back of an animal the
 * nearest point is now on the one, now on the other. A chart does. It is a disc of the surface's triangles round a closed
 * line, whose boundary goes to a circle, and each inner vertex to a mean of its neighbours with positive weights: such
 * a map of a disc is one to one (Tutte, How to draw a graph, 1963; Floater, Parametrization and smooth approximation
 * of surface triangulations, 1997). It is checked all the same, as rounding may fold what is very thin in the plane.
 */
#ifndef QM_TMESH_CHART_H
#define QM_TMESH_CHART_H

#include "core/arena.h"
#include "core/heap.h"
#include "core/vec.h"
#include "qm/source.h"
#include "quads/trimesh.h"

/** The triangles of a surface with their neighbours; seams are closed. */
typedef struct qm_tmesh_triangles {
    qm_context *ctx;
    const qm_ref_surface *surface;
    qm_trimesh mesh;
    uint32_t *first; /* by face of the surface: its triangles are first[f] to first[f + 1] - 1 */
    size_t surface_faces;
    /* scratch of a chart, by triangle, and by vertex for number; a stamp tells of which search it is */
    uint32_t *in_disc, *seen, *label, *before, *disc, *number, *number_stamp;
    double *cost;
    uint32_t stamp;
    qm_heap heap;
} qm_tmesh_triangles;

/** Makes them of a mesh. Returns QM_OK; QM_E_NO_MEMORY. *out is the caller's, for its reset, after an error too. */
qm_status qm_tmesh_triangles_make(qm_context *ctx, const qm_ref_surface *surface, qm_tmesh_triangles *out);
void qm_tmesh_triangles_reset(qm_tmesh_triangles *t);

/** A place on the surface. */
typedef struct qm_tmesh_spot {
    uint32_t triangle;
    double weight[3]; /* of its corners */
} qm_tmesh_spot;

/** Finds the place nearest to a point. False if a face without area is there. */
bool qm_tmesh_triangles_find(const qm_tmesh_triangles *t, qm_vec point, qm_tmesh_spot *spot);

/** A point of the plane. */
typedef struct qm_tmesh_flat {
    double u, v;
} qm_tmesh_flat;

/** Its arrays are the arena's. */
typedef struct qm_tmesh_chart {
    size_t triangle_count, vertex_count;
    uint32_t (*corner)[3]; /* vertices of the chart */
    uint32_t *twin;        /* 3 a triangle: the triangle beyond each side; QM_NO_INDEX */
    uint32_t *triangle;    /* by triangle: its number in the surface, ascending */
    qm_vec *at;            /* by vertex */
    qm_tmesh_flat *flat;   /* by vertex */
} qm_tmesh_chart;

/**
 * Makes a chart of the disc that a closed line of places bounds, and of a margin round it: of the two sides of the line the smaller
 * one.
 *
 * most  triangles of the chart; not more than there are
 *
 * Returns: QM_OK, with *is_made false where there is no such disc; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_chart_make(qm_arena *arena, qm_tmesh_triangles *t, const qm_tmesh_spot *line, size_t count,
                              size_t most, qm_tmesh_chart *out, bool *is_made);

/** Puts the inner vertices of a chart to where they belong, its boundary being on a circle already. *is_made is false where rounding folds
 * it. Returns false when out of memory. */
bool qm_tmesh_chart_flatten(qm_arena *arena, qm_tmesh_chart *chart, const bool *is_fixed, bool *is_made);

/**
 * Puts the inner vertices of a chart to where they belong, its boundary being on a convex polygon already, so that no part of the surface gets
 * much less of the plane than others: weights are divided by the stretch at both ends of a side while the mean stretch falls. What is flat
 * on the surface, and on the polygon, is mapped as it is. Rounding may fold what is very thin.
 *
 * size  of the polygon's box on the surface, along u and v
 *
 * Returns false when out of memory.
 */
bool qm_tmesh_chart_spread(qm_arena *arena, qm_tmesh_chart *chart, const bool *is_fixed, qm_tmesh_flat size);

/** Where a place of the surface is in the chart, and in which triangle of it. False if it is outside. */
bool qm_tmesh_chart_place(const qm_tmesh_chart *chart, const qm_tmesh_spot *spot, qm_tmesh_flat *flat,
                          uint32_t *triangle);

/** The point of the surface at a point of the plane. *triangle is one near it, at first, and that which it is in.
 * False if it is outside the chart. */
bool qm_tmesh_chart_lift(const qm_tmesh_chart *chart, qm_tmesh_flat flat, uint32_t *triangle, qm_vec *at);

/** How a point of the plane moves as its point of the surface moves in the plane of a triangle. */
qm_tmesh_flat qm_tmesh_chart_move(const qm_tmesh_chart *chart, uint32_t triangle, qm_vec by);

/** The normal of a triangle, of length 1. */
qm_vec qm_tmesh_chart_normal(const qm_tmesh_chart *chart, uint32_t triangle);

/** Twice the area of a triangle of the plane; above 0 where it runs as the surface's. */
static inline double qm_tmesh_flat_area(qm_tmesh_flat a, qm_tmesh_flat b, qm_tmesh_flat c)
{
    return (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
}

#endif
