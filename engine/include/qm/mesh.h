/**
 * mesh.h: a surface of triangles and quads, or a set of points, as flat arrays.
 *
 * Frame and unit are those of the input. A quad with corners c0 c1 c2 c3 has two readings: the two triangles
 * (c0 c1 c2) and (c0 c2 c3), always split at the first corner, or the bilinear patch of the four corners.
 * Parameters (u, v) are (0,0) at c0, (1,0) at c1, (1,1) at c2 and (0,1) at c3 in both readings. On a triangle
 * the point is (1 - u - v) c0 + u c1 + v c2.
 */
#ifndef QM_MESH_H
#define QM_MESH_H

#include "qm/context.h"

/** The fourth corner of a triangle; also "none" for any index that may be absent. */
#define QM_NO_INDEX UINT32_MAX

/** The surface of a quad. */
typedef enum qm_quad_reading { QM_QUADS_TRIANGLES, QM_QUADS_BILINEAR } qm_quad_reading;

/** A structured block of quads in a mesh: its faces row by row, the blocks one after the other. Corner 0 of
 * each quad is at the start of its row and column, corner 1 at the next column, corner 3 at the next row. */
typedef struct qm_mesh_grid {
    uint32_t rows, columns;
} qm_mesh_grid;

/**
 * A mesh or point set. Its arrays belong to the allocator of the context that resets it. face_count 0 means a
 * point set: the points are the surface. Polygons of the input are stored as fans of triangles; face_origin
 * then maps each face to its face of the input. NULL means that both have equal indices.
 */
typedef struct qm_mesh {
    double *positions;     /* vertex_count rows of x y z */
    size_t vertex_count;   /* at most QM_NO_INDEX - 1 */
    uint32_t *faces;       /* face_count rows of four corners; the fourth is QM_NO_INDEX for a triangle */
    size_t face_count;     /* at most QM_NO_INDEX - 1 */
    uint32_t *face_origin; /* face_count entries, non-decreasing, or NULL */
    size_t polygon_count;  /* faces of the input with five corners or more */
    qm_mesh_grid *grids;   /* grid_count entries: the structured blocks of the mesh, or NULL */
    size_t grid_count;
    /* input normals of a point set: vertex_count rows of x y z of any length, 0 0 0 for an unknown one; or
       NULL */
    float *normals;
} qm_mesh;

/** Frees the arrays and sets all members to zero. */
void qm_mesh_reset(qm_context *ctx, qm_mesh *mesh);

/** The index of face in the numbering of the input. */
static inline uint32_t qm_mesh_input_face(const qm_mesh *mesh, uint32_t face)
{
    return mesh->face_origin ? mesh->face_origin[face] : face;
}

/**
 * Checks the preconditions of every other call: the mesh is not empty, indices are in range, coordinates are
 * finite, and distances do not overflow.
 *
 * Returns: QM_OK; QM_E_EMPTY; QM_E_INDEX or QM_E_NOT_FINITE (ctx->message names the face or vertex, counted
 * from 0).
 */
qm_status qm_mesh_validate(qm_context *ctx, const qm_mesh *mesh);

/** Axis-parallel box; empty when min > max. */
typedef struct qm_box {
    double min[3], max[3];
} qm_box;

/** Box of the surface: of the vertices that faces use, or of all vertices of a point set. The mesh is valid
 * and not empty. */
qm_box qm_mesh_bounding_box(const qm_mesh *mesh);

/** Length of the box's diagonal, without intermediate overflow or underflow. */
double qm_mesh_box_diagonal(const qm_box *box);

/** Counts of a mesh that need no geometry. */
typedef struct qm_mesh_facts {
    size_t triangles, quads;      /* of the input: triangles of fans do not count */
    size_t polygons;              /* faces of the input with five corners or more */
    size_t unused_vertices;       /* of no face: they are not part of the surface (0 for a point set) */
    size_t boundary_edges;        /* edges with one face */
    size_t nonmanifold_edges;     /* edges with three faces or more */
    size_t irregular_vertices;    /* inner vertices with quads only and a valence other than 4 */
    size_t components;            /* connected by shared vertices; 0 for a point set */
    size_t repeated_corner_faces; /* faces that repeat a vertex: kept, as triangles, segments or points */
    size_t duplicate_faces; /* of the input: with the vertices of an earlier one in the same or the opposite
                               order; polygons by the triangles of their fans */
    size_t edges;
    size_t boundary_loops;  /* closed curves of boundary edges; those that meet at a vertex count as one */
    ptrdiff_t euler_number; /* vertices - edges + faces, of the faces that have edges */
    size_t genus;           /* sum over the components; QM_NO_GENUS unless manifold, watertight and
                                winding_consistent */
    bool manifold;   /* every edge has one or two faces, and the faces around each vertex form one fan */
    bool watertight; /* there are edges, and each has two faces */
    bool winding_consistent; /* no two faces run through an edge in the same direction */
} qm_mesh_facts;

#define QM_NO_GENUS SIZE_MAX

/**
 * Counts edges, components, loops, irregular vertices and duplicates. Vertices are equal when their indices are:
 * meshes with unshared corners (STL) must be welded before. A face that repeats a vertex counts as what is left of
 * it: a quad of three vertices as a triangle, one of two vertices as nothing.
 *
 * Cost:    linear in the faces; scratch memory of about 50 bytes an edge, and 40 for each face whose vertices all have
 *          crowded edges or several fans, among which duplicates are.
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_mesh_find_facts(qm_context *ctx, const qm_mesh *mesh, qm_mesh_facts *out);

#endif
