/**
 * engine.h: the parts of bench_engine, the program that runs this engine for the benchmark.
 *
 * A part that cannot go on says why on standard error and ends the program with status 1.
 */
#ifndef QM_BENCH_ENGINE_H
#define QM_BENCH_ENGINE_H

#include "qm/locator.h"

/** What a mesh is changed by, in this order: makes a near twin or another mesh of the same model out of
 * it. */
typedef struct bench_change {
    bool refine;    /* every face cut in four at the middles of its edges */
    double coarsen; /* one vertex for each cell of a grid; the cell's side as a share of the mean edge */
    double shift;   /* moves along (1, 1, 1), by this share of the diagonal */
    double noise;   /* moves every coordinate of every vertex by up to this share of the diagonal */
    double part;    /* keeps the faces whose first corner lies in this share of the box along x; 0: all */
    double turn;    /* about the axis (1, 2, 3) through the middle of its box; radians */
} bench_change;

_Noreturn void bench_fail(const char *subject, const char *detail);

/** Makes a torus with waves on it if the name is torus:COLUMNSxROWSxCORNERS: of quads, or of twice as many
 * triangles. The mesh is the caller's, for qm_mesh_reset. */
bool bench_make_torus(qm_context *ctx, const char *name, qm_mesh *out);

/** Reads a file of any format, which may be a point set, or makes a torus; the mesh is the caller's, for
 * qm_mesh_reset. */
qm_mesh bench_read_any(qm_context *ctx, const char *path);

/** Reads a mesh file of any format and disturbs it; the mesh is the caller's, for qm_mesh_reset. */
qm_mesh bench_read_mesh(qm_context *ctx, const char *path, const bench_change *change);

/** One vertex for each cell of a grid that holds some, in their mean; cell is a share of the mean edge. */
void bench_coarsen(qm_mesh *mesh, double cell);

/** Cuts every face in four at the middles of its edges; a quad also at the mean of its corners. */
void bench_refine(qm_context *ctx, qm_mesh *mesh);

/** Memory that must be there; the caller's, for free. */
void *bench_alloc(size_t count, size_t width);

/** The hundredth part of the vertices that is nearest to the first one: a part of the mesh that lies
 * together. The caller's, for free. */
uint32_t *bench_pick_part(const qm_mesh *mesh, size_t *count);

/** Writes rows of doubles or indices as they lie in memory. */
void bench_write_array(const char *prefix, const char *suffix, const void *data, size_t count, size_t width);

typedef struct bench_hausdorff_question {
    const char *path_a, *path_b;
    bench_change change_b;
    qm_quad_reading quads;
    double tolerance; /* a share of the diagonal of A */
    int threads;
    qm_accelerator accelerator;
} bench_hausdorff_question;

/** Times the distance from A to B and prints it. */
void bench_hausdorff(const bench_hausdorff_question *question);

typedef struct bench_deviation_question {
    const char *surface; /* box, sphere, torus, saddle, wave */
    size_t count;        /* of its faces, about */
    double noise;        /* moves every coordinate of A by up to this share of the diagonal */
    qm_quad_reading quads;
    double accuracy;
    int threads;
    uint64_t seed;
    double seconds; /* after which a measurement is canceled */
} bench_deviation_question;

/** Times the deviation of a noisy surface from itself without noise, near it and apart, and prints it. */
void bench_deviation(const bench_deviation_question *question);

/** Times pairs of faces that meet and prints how many; path_b is NULL for a mesh with itself. */
void bench_collide(const char *path_a, const char *path_b, const bench_change *change_b);

/** Writes PREFIX.vertices and PREFIX.triangles: used vertices only, quads split at their first corner. */
void bench_export(const char *path, const bench_change *change, const char *prefix);

/** Writes the changed mesh, quads as quads, as an OFF file with all digits. */
void bench_vary(const char *path, const bench_change *change, const char *out);

/**
 * Draws points in random order and writes them as PREFIX.near, PREFIX.mid and PREFIX.far: a point of the
 * surface with normal noise of a thousandth of the diagonal; a point of the box; a point of the box three
 * times as large.
 */
void bench_draw(const char *path, size_t count, uint64_t seed, const char *prefix);

/** The same points in memory: count rows for each of the three sets. */
void bench_draw_sets(const qm_mesh *mesh, size_t count, uint64_t seed, double *out[3]);

/** Projects count points of each set by every accelerator, in both readings, and prints how far their
 * distances differ at most, as a share of the diagonal. */
void bench_agree(const char *path, size_t count, uint64_t seed);

/** Times projections of a file of points and prints them; quads as triangles. The accelerator counts as part
 * of the tree. */
void bench_project(const char *path, const char *points_path, qm_accelerator accelerator, int threads);

/** Times how trees follow the vertices of a mesh, and prints that beside their building and memory. */
void bench_refit(const char *path, int threads);

/** Times the finding of regular patches and prints how many there are. */
void bench_patches(const char *path);

/**
 * Times the distances of all pairs of so many meshes by formula, as a matrix and pair by pair, and prints how many pairs were
 * searched. kind: sizes, versions, any; want: all, nearest, within.
 */
void bench_matrix(const char *kind, const char *want, size_t count, double tolerance);

/** Times pairs of faces of a mesh that meet after a hundredth part of its vertices has moved. */
void bench_moved(const char *path);

/** Times alignments of A, moved by each of a file of motions (rows of 16 doubles), onto B, and prints how many ended where; A and B
 * are arrays as bench_export writes them. */
void bench_align(const char *prefix_a, const char *prefix_b, const char *motions_path, int threads);

/** Times a reconstruction from a layout file up to so many quads, and picks on the surface, and prints
 * them. */
void bench_reconstruct(const char *path, const char *layout_path, size_t max_quads, int threads);

#endif
