/**
 * remesh.h: from a surface to a mesh of quads whose distance from it is known, until it is as near as is wanted.
 */
#ifndef QM_REMESH_H
#define QM_REMESH_H

#include "qm/layout.h"
#include "qm/quads.h"
#include "qm/source.h"

#define QM_REMESH_FIRST_QUADS 1000 /* that a search for a distance starts with */
#define QM_REMESH_MOST_QUADS 1000000

/** What is done at a moment: quads are made, a layout, its grids are filled, the distance is measured, or a surface is made of points. */
typedef enum qm_remesh_work {
    QM_REMESH_QUADS,
    QM_REMESH_LAYOUT,
    QM_REMESH_FILL,
    QM_REMESH_MEASURE,
    QM_REMESH_SURFACE /* by the caller: of points, before the quads */
} qm_remesh_work;
extern const char *const qm_remesh_work_names[];

/** Where the patches of a semi-regular mesh come from. */
typedef enum qm_remesh_origin {
    QM_REMESH_FROM_LAYOUT,   /* an automatic one: patches meet along whole sides */
    QM_REMESH_FROM_DIVISION, /* of each quad of a coarser mesh into four */
    QM_REMESH_FROM_QUADS     /* that were made without a layout */
} qm_remesh_origin;
extern const char *const qm_remesh_origin_names[];

/** Where the work is. */
typedef struct qm_remesh_stage {
    qm_remesh_work work;
    size_t quads;        /* of the mesh that is made, or of the last one; 0 before the first */
    double lower, upper; /* the distance of the last mesh that was measured; upper is 0 before the first */
} qm_remesh_stage;

typedef struct qm_remesh_options {
    qm_quads_options
        quads;       /* their number: wanted; with a distance the first; of a semi-regular mesh the limit */
    double distance; /* at most so far from the surface, in its unit; 0: any */
    bool is_semi_regular; /* by way of a layout, where one gives good quads: patches of rows and columns */
    void (*on_stage)(void *user,
                     const qm_remesh_stage *stage); /* called as each begins; NULL: nobody is told */
    void *user;
} qm_remesh_options;

typedef struct qm_remesh_result {
    qm_mesh mesh;             /* for qm_mesh_reset */
    qm_interval from_surface; /* greatest distance of a point of the surface from the quads, in its unit */
    qm_interval from_quads;   /* and of a point of the quads, read as two triangles, from the surface */
    double lower, upper;      /* the greater of both: the two-sided Hausdorff distance */
    size_t rounds;            /* meshes that were made */
    size_t patches;           /* of a semi-regular mesh; else 0 */
    qm_remesh_origin origin;  /* of these */
} qm_remesh_result;

/**
 * Makes the mesh. Where no number of quads is named (0), it is that of qm_quads_options_default; with a distance
 * QM_REMESH_FIRST_QUADS to begin with, or no limit of a semi-regular mesh. With a distance more and more quads are tried until the
 * upper bound is within it, or the next mesh would have more than QM_REMESH_MOST_QUADS, or than the limit; the last one is the result then, or the
 * nearest semi-regular one. A smaller distance never gives fewer quads, but of semi-regular meshes, whose layouts differ.
 *
 * surface  of a mesh, its tree with QM_BVH_TARGET
 *
 * Returns: QM_OK; QM_E_CANCELED; what qm_quads_make and qm_quad_layout_make_of_surface return. *out is empty after
 *          an error.
 */
qm_status qm_remesh(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                    qm_remesh_result *out);

#endif
