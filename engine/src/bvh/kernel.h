/**
 * kernel.h: the inner loops (kernels), compiled once for each instruction set and picked at run time, and the
 * types they work on. Kernels never allocate. kernel_table.inc lists them.
 */
#ifndef QM_KERNEL_H
#define QM_KERNEL_H

#include "bvh_tree.h"
#include "cell_grid.h"
#include "node_pairs.h"
#include "overlay_facets.h"
#include "qm/grid.h"

/* ---- the Hilbert curve, whose order keeps neighbours in space near in memory ---- */

#define QM_HILBERT_BITS 12  /* an axis, at most; keys have three times as many */
#define QM_HILBERT_BATCH 64 /* cells that a kernel takes in one call */

/** Fixed-point coordinates of vertices, three to a word, finer than the cells of the curve: sums of up to
 * four fit their fields, so that the centroid of a face takes a few integer additions. */
enum { QM_FINE_FIELD = 20, QM_FINE_BITS = QM_HILBERT_BITS + 4 };

/** A batch of cells, by axis. Cells beyond the count of a call may hold anything. */
typedef struct qm_hilbert_cells {
    _Alignas(32) uint32_t axis[3][QM_HILBERT_BATCH];
} qm_hilbert_cells;

/** The cell of a coordinate; one beyond [-1, 1] is clamped to the nearest cell. */
static inline uint32_t qm_hilbert_quantise(double local)
{
    double cell = (local + 1.0) * (1 << (QM_HILBERT_BITS - 1)), last = (1 << QM_HILBERT_BITS) - 1;
    cell = cell > 0.0 ? cell : 0.0;
    return (uint32_t)(int32_t)(cell < last ? cell : last);
}

/* ---- results of searches ---- */

/** The nearest triangle. */
typedef struct qm_hit {
    double d2;
    uint32_t pack, lane;
} qm_hit;

/** An upper bound of the distance to a triangle, found in single precision. */
typedef struct qm_float_hit {
    double upper;
    uint32_t pack, lane;
} qm_float_hit;

/** The nearest bilinear patch: the distance, its certified lower bound, and the parameters of the point that far
 * away: NAN where the distance is that of a triangle and a flatness bound. */
typedef struct qm_bilinear_hit {
    double distance, lower;
    double uv[2];
    uint32_t face, pack;
} qm_bilinear_hit;

#define QM_TIES 16 /* capacity of a list of ties */

/** A face that may be the result of a projection, with its distance by operations that do not depend on the
 * order of visits. */
typedef struct qm_tie {
    double distance;
    uint32_t face, pack, lane;
} qm_tie;

/**
 * The faces at most tau farther than the nearest; the result is the lowest index among them. A face is
 * dropped for one of a lower index that is no farther: wherever the nearest turns out to be, that one wins.
 * So the list stays short however many faces tie. If it overflows all the same, a second search with
 * is_min_known set and the min distance keeps the lowest index alone.
 */
typedef struct qm_ties {
    double error; /* of the distances to patches, certified; 0: faces are triangles */
    double tau;
    double margin;     /* max excess of a lower bound of a distance over the computed distance */
    double min;        /* of the distances so far */
    double reach;      /* min + tau: nothing beyond can be the result */
    double reach2;     /* its square, rounded up */
    bool is_min_known; /* min is that of all faces */
    bool is_overfull;  /* the list was full when a face was offered */
    int count;
    qm_tie tie[QM_TIES];
} qm_ties;

/* ---- covering a piece of the source ---- */

#define QM_COVER_PACKS 8    /* max candidate packs of a piece: their 64 lanes make one word of bits */
#define QM_COVER_CORNERS 12 /* max corners of the polygons that remain in between */
#define QM_NEAR_PACKS 32    /* max packs of a neighborhood */

/**
 * Bits of the lanes of a pack that single precision decides: in the low byte the lanes proven to be within a
 * distance, in the high byte those not proven to be beyond it. The & of the bits of several points holds for
 * all of them.
 */
typedef uint16_t qm_float_bits;

static inline unsigned qm_float_certain(unsigned bits)
{
    return bits & 0xff;
}

/** Packs near a part of the source, with their boxes. */
typedef struct qm_near_packs {
    int count;
    uint32_t pack[QM_NEAR_PACKS];
    qm_box_node box[QM_NEAR_PACKS / 8];
} qm_near_packs;

/** The lanes nearest to a point, nearest first; the first is repeated where there are fewer. */
typedef struct qm_shortlist {
    uint32_t pack[QM_PACK_LANES];
    uint8_t lane[QM_PACK_LANES];
} qm_shortlist;

/** The candidates to cover a piece with, a facet a lane, and their cutoffs. */
typedef struct qm_candidates {
    int count;
    uint32_t id[QM_COVER_PACKS]; /* indices of the packs in the target */
    const qm_pack *pack[QM_COVER_PACKS];
    qm_pack spare[QM_COVER_PACKS]; /* for packs that the target has no room to keep */
    _Alignas(64) double cutoff2[QM_COVER_PACKS][QM_PACK_LANES]; /* squared cutoff; -1: covers nothing */
    double twist[QM_COVER_PACKS][QM_PACK_LANES];                /* flatness bound of the lane's surface */
} qm_candidates;

/** What single precision decides about a cover. */
typedef enum qm_float_verdict { QM_FLOAT_OPEN, QM_FLOAT_COVERED, QM_FLOAT_TOO_COARSE } qm_float_verdict;

/** A convex polygon of a source piece, or the hull of four corners, which one facet must reach as a whole; in_reach has a bit
 * for each lane within its cutoff of a corner. */
typedef struct qm_polygon {
    int count;
    bool is_hull;
    int cuts_left; /* cuts left in its rounding budget, see core/rounding.h */
    qm_vec corner[QM_COVER_CORNERS];
    uint64_t in_reach[QM_COVER_CORNERS];
} qm_polygon;

/* ---- the table ---- */

#define QM_SORT_SMALL_MAX 32 /* numbers that sort_small takes at most */

enum { QM_BOX_SIDES = 6 };

/** The kernels of one instruction set. */
typedef struct qm_kernel {
    const char *name;
#define KERNEL_ENTRY(type, name, parameters) type(*name) parameters;
#include "kernel_table.inc"
#undef KERNEL_ENTRY
} qm_kernel;

#define QM_KERNEL_PASTE_(name, isa) qm_##name##_##isa
#define QM_KERNEL_PASTE(name, isa) QM_KERNEL_PASTE_(name, isa)
/** The function of a kernel for the instruction set QM_ISA. */
#define QM_KERNEL(name) QM_KERNEL_PASTE(name, QM_ISA)

/** The kernels of the widest instruction set that this processor runs. */
const qm_kernel *qm_kernel_get(void);

/** The kernels of all instruction sets that this processor runs, widest first; NULL ends the list. For
 * tests. */
const qm_kernel *const *qm_kernel_list(void);

#endif
