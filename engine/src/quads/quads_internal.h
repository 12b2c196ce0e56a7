/**
 * quads_internal.h: the steps from a triangle mesh to quads.
 *
 *   quads_triangles.c  the triangles of the surface, component by component
 *   quads_slivers.c    triangles without a height, which go
 *   quads_features.c   creases and corners of the mesh
 *   quads_tips.c       tips of horns, which stay where they are while triangles are remeshed
 *   quads_corners.c    acute corners of features, which need a quad
 *   quads_remesh.c     triangles of equal size, about half as long as the quads shall be
 *   quads_levels.c     a graph and its coarser versions, on which fields are smoothed
 *   quads_field.c      a cross in each face: the directions of the quads (orientation field)
 *   quads_cancel.c     pairs of singular vertices of this field, which go
 *   quads_map.c        the surface laid onto the plane of the grid, face by face: real steps that sum up to 0 round each
 *   quads_position.c   a grid at each vertex: where the corners of quads are to lie (position field)
 *   quads_steps.c      integers: how many quads lie between the ends of each edge, made consistent by a flow
 *   quads_extract.c    edges of no step are contracted; two triangles at a diagonal step make a quad
 *   quads_tidy.c       quads that are contracted, edges that are turned, so that fewer vertices are irregular
 *   quads_lone.c       vertices of boundaries with one quad, but room for more
 *   quads_polish.c     corners move along the surface for better shapes
 *   quads_walls.c      the nearest point of a wall that looks the same way
 *   quads_untangle.c   bad quads become better, or go
 *   quads_fit.c        vertices leave the surface where that brings the quads nearer to it
 *   quads_settle.c     the last three for a mesh whose faces stay
 *   quads_divide.c     each quad is cut into four
 *   quads_sides.c      the sides of quads, and changes of the mesh that tidying and untangling share
 */
#ifndef QM_QUADS_INTERNAL_H
#define QM_QUADS_INTERNAL_H

#include "qm/bvh.h"
#include "qm/quads.h"
#include "quads/trimesh.h"

/** Triangles of a surface, component by component; components are connected by vertices. */
typedef struct qm_quads_triangles {
    size_t count;
    uint32_t (*corner)[3];
    uint32_t *component; /* of each triangle */
    size_t component_count;
} qm_quads_triangles;

/** Turns triangles that look the other way than most of their surface, and gives those along seams their vertices in common: where just two
 * sides without a partner join two places, one each way. Returns
 * QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_close_seams(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *t);

/** Lists the triangles of a mesh, whose seams are closed. Returns QM_OK; QM_E_NO_MEMORY. *out is the caller's, for qm_quads_triangles_reset, after an error
 * too. */
qm_status qm_quads_list_triangles(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *out);
void qm_quads_triangles_reset(qm_context *ctx, qm_quads_triangles *t);

/** Contracts or turns edges until no triangle is without a height, where the topology allows it. */
void qm_quads_drop_slivers(qm_trimesh *m);

/** Marks edges whose faces meet at an angle as features, and vertices where features bend sharply as fixed. What is
 * a crease only below the size of a quad is left out, and, if wanted, edges between facets of a rounded surface. */
qm_status qm_quads_find_features(qm_context *ctx, qm_trimesh *m, double crease_angle, double size,
                                 bool drops_facets);

/** Marks tips of horns as fixed, which are longer than some sides of a quad of a size. Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_hold_tips(qm_context *ctx, qm_trimesh *m, double size);

/** Lets go of fixed vertices without a feature. */
void qm_quads_release_tips(qm_trimesh *m);

/** Makes the edges about as long as length; vertices lie on the surface of bvh. */
qm_status qm_quads_remesh(qm_context *ctx, qm_trimesh *m, const qm_bvh *bvh, double length, int thread_count);

/** Splits faces until none has two features. */
qm_status qm_quads_separate_features(qm_context *ctx, qm_trimesh *m);

/** Paths from acute corners between features inwards, along which the grid is turned so that the corners have a quad. */
typedef struct qm_quads_corners {
    uint32_t *
        vertex; /* of each path: the corner, the ends of the first edges of both sides, the way, QM_NO_INDEX */
    size_t count, capacity;
} qm_quads_corners;

/** Finds the paths, for quads of a side of size, and splits edges where they have no vertices. Returns QM_OK; QM_E_NO_MEMORY. *out is the caller's, for
 * qm_quads_corners_reset, after an error too. */
qm_status qm_quads_open_corners(qm_context *ctx, qm_trimesh *m, double size, qm_quads_corners *out);

/** Turns the frames of faces (quads_map.c) against each other along the paths of corners without a quarter turn. */
void qm_quads_turn_corners(const qm_trimesh *m, const qm_quads_corners *corners, uint8_t *turned,
                           const float (*edge)[2]);
void qm_quads_corners_reset(qm_context *ctx, qm_quads_corners *corners);

/** A graph of nodes with normals. */
typedef struct qm_quads_graph {
    size_t count;
    qm_vec *normal;
    double *weight;
    uint32_t
        *start; /* count + 1 entries: the links of node i are link[start[i]] ... link[start[i + 1] - 1] */
    uint32_t *link;
    size_t link_capacity;
    uint32_t *parent; /* the node of the next coarser level; NULL at the coarsest */
} qm_quads_graph;

enum { QM_QUADS_MAX_LEVELS = 40 };

typedef struct qm_quads_levels {
    int count;
    qm_quads_graph graph[QM_QUADS_MAX_LEVELS];
} qm_quads_levels;

/** Allocates a graph for so many nodes and links; NULL members when out of memory. */
bool qm_quads_graph_alloc(qm_context *ctx, qm_quads_graph *graph, size_t count, size_t links);

/** Makes the coarser levels of graph[0]: each joins pairs of neighbours whose normals differ least. */
qm_status qm_quads_levels_build(qm_context *ctx, qm_quads_levels *levels);
void qm_quads_levels_reset(qm_context *ctx, qm_quads_levels *levels);

/** A direction of each of two crosses. */
typedef struct qm_quads_match {
    qm_vec a, b;
} qm_quads_match;

/** The directions of two crosses, round their normals, that differ least in space. */
qm_quads_match qm_quads_match_crosses(qm_vec qa, qm_vec na, qm_vec qb, qm_vec nb);

/** A cross for each face: cross receives its first direction, of length 1. Faces with a feature follow it. cancels: pairs of singular vertices go
 * (qm_quads_cancel_pairs). Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_find_crosses(qm_context *ctx, const qm_trimesh *m, bool cancels, qm_vec *cross);

/** Turns crosses so that fewer vertices are singular, where that hardly makes them less smooth. normal: the planes of crosses, of length 1. is_set: of
 * each face: its cross stays. Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_cancel_pairs(qm_context *ctx, const qm_trimesh *m, const qm_vec *normal,
                                const uint8_t *is_set, qm_vec *cross);

/** A pair turned by quarters to the left. */
static inline void qm_quads_turn_pair(double s[2], int quarters)
{
    static const double cosine[4] = {1.0, 0.0, -1.0, 0.0}, sine[4] = {0.0, 1.0, 0.0, -1.0};
    double c = cosine[quarters & 3], i = sine[quarters & 3], x = s[0], y = s[1];
    s[0] = c * x - i * y;
    s[1] = i * x + c * y;
}

/** A surface on the plane of the grid, face by face, in the frames of its faces (quads_map.c). */
typedef struct qm_quads_map {
    size_t face_count;
    uint8_t
        *turned; /* of each half-edge: quarter turns of pairs from the frame of its face to that across it */
    float (*edge)[2]; /* of each half-edge: its vector, as long as it is */
    float (*step)[2]; /* of each half-edge: its vector on the grid, in sides of a quad */
    uint8_t *
        is_across; /* of each half-edge: bit k for axis k: it leads from one feature to another at its side */
    float *share;  /* of each half-edge: the part of its compliance that it has left */
    double (*multiplier)[2]; /* of each face, for quads of a side of size */
    double unit;
    double size; /* 0: not closed yet */
} qm_quads_map;

/** The axis along a feature. */
static inline int qm_quads_feature_axis(const qm_quads_map *map, uint32_t h)
{
    return fabsf(map->edge[h][0]) >= fabsf(map->edge[h][1]) ? 0 : 1;
}

/** Finds the frames, of which the first axes are the crosses, turned along the paths of corners. unit: about the side of a quad. Returns QM_OK;
 * QM_E_NO_MEMORY. *map is the caller's, for qm_quads_map_reset, after an error too. */
qm_status qm_quads_map_build(qm_context *ctx, const qm_trimesh *m, const qm_vec *cross,
                             const qm_quads_corners *corners, double unit, qm_quads_map *map);

/** Finds the steps for quads of a side of size, which nearly sum up to 0 in each face. Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_map_close(qm_context *ctx, const qm_trimesh *m, qm_quads_map *map, double size);
void qm_quads_map_reset(qm_context *ctx, qm_quads_map *map);

/** Where vertices lie on the grid. */
typedef struct qm_quads_phases {
    double (*phase)
        [2]; /* of each vertex: its place from the nearest corner, in the frame of the first face of its fan */
    uint8_t *
        turned; /* of each half-edge: quarter turns of pairs from the frame of its face to that of its vertex */
} qm_quads_phases;

/** Fits a grid to each vertex of a map. Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_find_phases(qm_context *ctx, const qm_trimesh *m, const qm_quads_map *map,
                               const qm_quads_phases *out);

/** Writes the steps of all half-edges, which are consistent in each face and along features, and moves the vertices to their corners of the
 * grid, of the crosses of faces and a side of size. */
qm_status qm_quads_find_steps(qm_context *ctx, qm_trimesh *m, const qm_vec *cross, const qm_quads_map *map,
                              double size, qm_quads_record *record);

/**
 * Contracts edges without a step and pairs the triangles that are left. size: of the side of a quad. m is used up; out receives quads, is_fixed a flag for
 * each of its vertices and is_feature one for each side of its faces (from a corner to the next one).
 */
qm_status qm_quads_extract(qm_context *ctx, qm_trimesh *m, double size, qm_mesh *out, uint8_t **is_fixed,
                           uint8_t **is_feature, qm_quads_record *record);

/** Flags of is_fixed and is_feature. */
enum { QM_QUADS_HELD = 1, QM_QUADS_KEPT = 2 /* untangling does not let go of it */ };

/** The quads of all components, and the features of the surface as segments: faces that repeat a corner. */
typedef struct qm_quads_result {
    qm_mesh mesh, features;
    qm_vec *feature_normal; /* of each segment: between those of its faces */
    uint8_t *is_fixed, *is_feature;
} qm_quads_result;

void qm_quads_result_reset(qm_context *ctx, qm_quads_result *r);

/** The sum of the areas of triangles. */
double qm_quads_area(const double *positions, const uint32_t (*corner)[3], size_t count);

/** The sum of the areas of quads, as seen along their normals. */
double qm_quads_mesh_area(const qm_mesh *m);

/** A piece of a feature. */
typedef struct qm_quads_segment {
    qm_vec end[2];
    qm_vec normal; /* between those of its faces, of length 1; 0: none */
} qm_quads_segment;

/** Lists the features of a mesh, the caller's. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_list_features(qm_context *ctx, const qm_trimesh *m, qm_quads_segment **segments,
                                 size_t *count);

/** Sets the features of a result. Returns QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_set_features(qm_context *ctx, const qm_quads_segment *segments, size_t count,
                                qm_quads_result *r);

/** What vertices are projected onto: a surface, or the features of a result. */
typedef struct qm_quads_target {
    const qm_bvh *bvh;    /* NULL: there are no features */
    const qm_vec *normal; /* of each face; NULL: that of its corners */
} qm_quads_target;

/** Of the normals of its faces, the part that a vertex's is at least where it tells which wall it is on. */
#define QM_QUADS_SURE 0.65

/**
 * Projects points that have normals (of length 1, or 0: any wall is right) onto the nearest point whose own normal is not opposed,
 * as far as there is one within about the reach; else onto the nearest.
 *
 * Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_quads_project(qm_context *ctx, const qm_quads_target *on, const double *points,
                           const qm_vec *normal, double reach, size_t count, int thread_count,
                           double *nearest);

/** Contracts quads along a diagonal and turns edges while that makes vertices more regular; *irregular receives the number of
 * vertices that are not. */
qm_status qm_quads_tidy(qm_context *ctx, qm_quads_result *r, size_t *irregular);

/** Gives vertices of a boundary that have one quad, but room for more, a second; *opened receives their number. Returns
 * QM_OK; QM_E_NO_MEMORY. */
qm_status qm_quads_open_lone(qm_context *ctx, qm_quads_result *r, size_t *opened);

/** Centres vertices along the surface, those of features along these. */
qm_status qm_quads_polish(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, int thread_count);

/** Spreads vertices along the surface, more where it bends, those of features along these. Vertices stay where a quad would become poor, but
 * those that are free: to come into order they may pass through worse states. is_free: of each vertex. */
qm_status qm_quads_spread(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, const uint8_t *is_free,
                          int thread_count);

/** Centres the vertices that are marked among their neighbours, with equal weights, in some rounds; the others stay. */
qm_status qm_quads_centre(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, const uint8_t *moves,
                          int rounds, int thread_count);

/** How many moves of vertices are usual to untangle a mesh: hopeless ones would take minutes. */
size_t qm_quads_untangle_moves(const qm_quads_result *r);

/** Makes bad quads better: vertices move along the surface, *moves times at most, which receives the rest; where that is not
 * enough the mesh changes, unless it keeps its faces. */
qm_status qm_quads_untangle(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, bool keeps_faces,
                            size_t *moves, int thread_count);

/** Turns the corners of each quad such that the diagonal from corner 0 to 2, along which it is cut into triangles, is the one whose
 * middle is nearer to the surface. Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_quads_choose_diagonals(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface,
                                    int thread_count);

/** Moves vertices off the surface, or out to its tips, so that the quads lie nearer to it. follows: nearest points go from quad to quad in
 * most rounds, instead of being sought in all quads, in a third of the time. */
qm_status qm_quads_fit(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, bool follows,
                       int thread_count);

#endif
