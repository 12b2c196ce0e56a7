/**
 * tmesh_router.h: shared by the files that lay the curves of a layout as paths that cannot meet (tmesh_route.h): which curves follow each
 * other round a node (tmesh_route_darts.c), the mesh that they divide (tmesh_route_mesh.c), its boundaries (tmesh_route_boundary.c), the
 * search for a path (tmesh_route_path.c) and for one round a handle (tmesh_route_handle.c), straight paths in charts (tmesh_route_chart.c),
 * and the layout that comes of it (tmesh_route_layout.c).
 *
 * The mesh is a copy of the surface's triangles. A half-edge of the path of curve c has step[0] c + 1, its label, any other 0. A dart is a
 * curve in one of its directions, 2 c from its first node and 2 c + 1 from its last; the patches tell which darts follow each other round a
 * node. Functions that return bool return false when out of memory, where their comment says nothing else.
 */
#ifndef QM_TMESH_ROUTER_H
#define QM_TMESH_ROUTER_H

#include "core/vec.h"
#include "tmesh/tmesh_route.h"

#define QM_ROUTE_LEAST_SHARE 0.05 /* of an edge on each side of a curve */

typedef struct qm_router {
    qm_arena *arena;
    qm_context *ctx;
    const qm_tmesh_triangles *triangles;
    const qm_layout *layout;
    const qm_tmesh_guides *guides;
    qm_trimesh m;
    qm_heap heap;
    /* darts */
    uint32_t *left; /* by dart: the patch to its left; QM_NO_INDEX */
    uint32_t *next,
        *before;         /* by dart: round its first node, counterclockwise; QM_NO_INDEX beyond a boundary */
    int8_t *turn;        /* by patch: 1 if it runs as the triangles do, -1 against */
    qm_vec *wanted;      /* by node: where it shall be */
    uint32_t *vertex;    /* by node */
    bool *is_laid;       /* by curve */
    uint32_t *at_vertex; /* by vertex of the mesh when nodes are placed: its node; QM_NO_INDEX */
    /* by triangle of the mesh */
    size_t capacity;
    double *cost;
    uint32_t *back, *stamp, *local, *queue; /* back: the half-edge that led here, of the triangle before */
    uint32_t stamp_value;
    /* the path of a curve: edges that it passes, in order */
    uint32_t (*edge)[2];
    double *share;
    size_t edge_count, edge_capacity;
    size_t most_faces;
    bool is_lost; /* a curve has found no path, or paths have become too long */
} qm_router;

static inline uint32_t qm_router_start(const qm_router *r, uint32_t dart)
{
    const qm_curve *curve = &r->layout->curves[dart / 2];
    return dart % 2 == 0 ? curve->from : curve->to;
}

static inline uint32_t qm_router_label(const qm_router *r, uint32_t h)
{
    return (uint32_t)r->m.step[h][0];
}

static inline void qm_router_set_label(qm_router *r, uint32_t h, uint32_t value)
{
    r->m.step[h][0] = (int32_t)value;
    if (r->m.twin[h] != QM_NO_INDEX) r->m.step[r->m.twin[h]][0] = (int32_t)value;
}

static inline const qm_vec *qm_router_guide_points(const qm_router *r, uint32_t curve, size_t *count)
{
    *count = r->guides->first[curve + 1] - r->guides->first[curve];
    return r->guides->points + r->guides->first[curve];
}

/* ---- darts ---- */

/** The darts of a patch, in the order that has it on their left. */
void qm_router_patch_darts(const qm_router *r, uint32_t patch, uint32_t out[4]);

/** Orders the darts round the nodes. *is_ordered is false if the patches do not tell. */
bool qm_router_order_darts(qm_router *r, const double *grids, bool *is_ordered);

bool qm_router_is_boundary(const qm_router *r, uint32_t curve);

/* ---- the mesh ---- */

/** Copies the triangles, divides large ones, and puts the nodes into them. */
bool qm_router_prepare(qm_router *r);

/** Puts a node onto a vertex. False where another one is. */
bool qm_router_take_vertex(qm_router *r, uint32_t node, uint32_t vertex);

/** Makes room for what is known of triangles. */
bool qm_router_reserve(qm_router *r);

/** Divides an edge that no curve runs along, or one of a boundary. */
bool qm_router_split_edge(qm_router *r, uint32_t h, qm_vec at, uint32_t *vertex);

bool qm_router_split_face(qm_router *r, uint32_t face, qm_vec at, uint32_t *vertex);

/** The half-edge from u to w of a triangle at a vertex; QM_NO_INDEX. */
uint32_t qm_router_opposite_edge(const qm_router *r, uint32_t vertex, uint32_t u, uint32_t w);

/** A half-edge between two vertices, of either direction; QM_NO_INDEX. */
uint32_t qm_router_edge_between(const qm_router *r, uint32_t a, uint32_t b);

/** The half-edge of a curve out of a vertex; QM_NO_INDEX where there is none, or its path only comes in along a boundary. */
uint32_t qm_router_labelled_edge(const qm_router *r, uint32_t vertex, uint32_t curve);

/* ---- paths ---- */

/** Points along a curve, by which its path is chosen. */
typedef struct qm_route_guide {
    const qm_vec *at;
    size_t count;
    double length;
} qm_route_guide;

qm_route_guide qm_route_guide_make(const qm_vec *at, size_t count);
/** The distance of a point; *passed is where it is nearest, as a length along the guide. */
double qm_route_guide_distance(const qm_route_guide *g, qm_vec p, double *passed);
qm_route_guide qm_router_curve_guide(const qm_router *r, uint32_t curve);

/** Adds an edge to the path of a curve, which passes it at a share of its length, */
bool qm_router_add_edge(qm_router *r, uint32_t h, double share);
/** or where the guide is nearest to it. */
bool qm_router_add_guided_edge(qm_router *r, uint32_t h, const qm_route_guide *g);
void qm_router_reverse_edges(qm_router *r);

/** Lists the triangles at the first node of a dart, between the curves beside it that lie. */
size_t qm_router_list_sector(const qm_router *r, uint32_t dart, uint32_t *out);

/** The middle of a triangle. */
qm_vec qm_router_middle(const qm_router *r, uint32_t face);

/** What a step between neighbours costs on the path of a curve. */
double qm_router_step_cost(const qm_router *r, const qm_route_guide *g, uint32_t face, uint32_t next);

/** Gives the edge between two vertices to a curve; the curve is lost where it is not free. */
bool qm_router_label_between(qm_router *r, uint32_t a, uint32_t b, uint32_t curve);

/** Lays a curve from a vertex over the edges of its path; *last becomes the vertex on the last one. */
bool qm_router_lay_edges(qm_router *r, uint32_t curve, uint32_t *last);

/** Lays a curve over the edges of its path, or through a triangle alone. */
bool qm_router_lay(qm_router *r, uint32_t curve, uint32_t middle);

/** Finds a path for a curve, and lays it. */
bool qm_router_route_curve(qm_router *r, uint32_t curve, const qm_route_guide *g);

/** Lays a curve along the edges of the mesh that it runs on, all of which are free; else not at all. */
void qm_router_route_line(qm_router *r, uint32_t curve, const qm_route_guide *g);

/** The same for a curve that must not divide what is free of curves (tmesh_route_handle.c). */
bool qm_router_route_handle(qm_router *r, uint32_t curve, const qm_route_guide *g);

/** Lays all curves, in an order in which each finds a path; such as run on edges of the mesh along these, if they may. */
bool qm_router_route_all(qm_router *r, bool may_follow_edges);

/* ---- boundaries ---- */

/** Puts the nodes of boundaries onto those of the mesh, in their order. */
bool qm_router_place_on_boundaries(qm_router *r);

/** Lays a curve along the boundary, its patch on the left. */
bool qm_router_route_boundary(qm_router *r, uint32_t curve);

/* ---- charts of faces ---- */

/** A disc of the mesh, and how its triangles and corners are numbered in its chart. */
typedef struct qm_route_disc {
    qm_tmesh_chart chart;
    uint32_t *number; /* 3 a triangle: the chart's vertex at each corner */
    uint32_t *beyond; /* 3 a triangle: the half-edge beyond each side; QM_NO_INDEX */
    uint32_t *ring;   /* of the boundary, in order */
    size_t ring_count;
    bool *is_fixed;
} qm_route_disc;

/** Gathers the triangles that are connected with one, over open curves too, and numbers them; open may be NULL. *is_made is false where they are
 * no disc: then there is no ring. The arrays are the arena's. */
bool qm_router_gather(qm_router *r, qm_arena *arena, uint32_t first, const bool *open, qm_route_disc *out,
                      bool *is_made);

/** The vertex of the chart at the start of a half-edge of the disc that was gathered last. */
uint32_t qm_router_corner_at(const qm_router *r, const qm_route_disc *d, uint32_t h);

/** Puts a part of the boundary onto an arc of the circle, from one place of the ring to another. */
void qm_route_disc_place_arc(qm_route_disc *d, size_t from, size_t count, double start, double angle);

/** Lays a curve straight within its two faces; open: by curve, all false. */
bool qm_router_straighten_curve(qm_router *r, uint32_t curve, bool *open);

/** Lays each curve but those along features straight within its two faces, and moves the nodes that are not fixed to the middle of theirs. */
bool qm_router_straighten(qm_router *r, const bool *is_fixed, const bool *is_line);

/* ---- the layout ---- */

/** Lists the points of a curve's path; *points is the arena's. */
bool qm_router_list_points(qm_router *r, uint32_t curve, double **points, size_t *count);

/** Makes the grids of all patches as Coons patches of their curves. */
void qm_router_blend_grids(const qm_layout *layout, double *grids);

/** Writes the layout that the paths are, and its grids. */
qm_status qm_router_write_layout(qm_router *r, double *grids, qm_layout *out);

#endif
