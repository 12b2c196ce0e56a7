/** hausdorff_candidates.h: a piece in work, and its candidates: the facets of the target that it may be
 * covered with, as packs, as single quads, and as labels for parts of patches. */
#ifndef QM_HAUSDORFF_CANDIDATES_H
#define QM_HAUSDORFF_CANDIDATES_H

#include "core/rounding.h"
#include "hausdorff_worker.h"
#include "prim/bilinear.h"

#define QM_PART_STACK 128 /* parts of a piece that wait */
#define QM_NEAR_QUADS 4   /* patches of the target examined for one part */
#define QM_STRICT_DEPTH 8 /* from here on a corner must be reached with half the tolerance to spare */

/** A triangle or a strip of the piece, with its corners' candidates; in_reach holds for one generation of
 * candidates. */
typedef struct qm_part {
    qm_vec corner[4];
    uint64_t in_reach[4];
    unsigned generation;
    uint8_t count, depth, cuts_left;
} qm_part;

/** A piece on its way through one visit. */
typedef struct qm_piece_work {
    qm_worker *worker;
    const qm_search *search;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_entry entry;
    qm_piece piece;
    int depth; /* of the piece, or of the part in process */
    /* The parts are within this distance of the source's surface: piece.slack, and the roundings of the cuts
     * beyond those that eta has room for. */
    double slack;
    int cut_limit;             /* cuts that slack and eta together have room for */
    const qm_near_packs *near; /* of a neighbourhood that holds the piece */
    uint32_t packs[QM_COVER_PACKS];
    int pack_count;
    qm_candidates candidates;
    double filled_for;   /* the cutoff when the candidates were set up */
    unsigned generation; /* counts changes of the candidates */
    qm_part stack[QM_PART_STACK];
    int height;
} qm_piece_work;

/** A quad of the target near a point: how near, and its footpoint. */
typedef struct qm_near_quad {
    uint32_t face, pack;
    /* Of a point of the patch; where the twist is negligible, of its triangles, plus the twist. */
    double distance;
    double twist;
    bool has_foot; /* set for twisted quads only, */
    double uv[2];  /* the footpoint's parameters */
    qm_bilinear patch;
} qm_near_quad;

/** Quads of the target, each once, nearest first. */
typedef struct qm_near_quads {
    int count, wanted;
    double farthest; /* quads no nearer than this are dropped */
    qm_near_quad at[QM_NEAR_QUADS];
} qm_near_quads;

/** A request for quads near a point. */
typedef struct qm_quads_query {
    int wanted;        /* at most this many, */
    double within;     /* all nearer than this; */
    double enough;     /* a nearest one within this ends the search, and others may be nearer then */
    bool twisted_only; /* no flat ones */
} qm_quads_query;

/** Labels for the parts of the target's patches under a polygon: they lose only their share of the twist. */
typedef struct qm_refined {
    qm_pack pack;
    qm_candidates labels;
} qm_refined;

/** The cutoff in the local space of the target. */
static inline double qm_candidates_cutoff(const qm_piece_work *work)
{
    return qm_search_cutoff(work->search) * work->side->scale;
}

static inline qm_vec qm_polygon_centroid(const qm_polygon *polygon)
{
    return qm_vec_centroid(polygon->corner, polygon->count);
}

/** Sets how far a point may be from a lane: the cutoff less the twist of its patch. Local. */
static inline void qm_candidates_set_cutoff(qm_candidates *candidates, int k, uint32_t lane, double twist,
                                            double cutoff)
{
    double remainder = cutoff - twist;
    candidates->twist[k][lane] = twist;
    candidates->cutoff2[k][lane] = remainder >= 0.0 ? remainder * remainder : -1.0;
}

/** Sets up the candidates of a list of packs for a cutoff (local), which the caller has reduced by the
 * slack. */
void qm_candidates_fill(qm_candidates *candidates, const qm_side *side, const uint32_t *packs, int count,
                        double cutoff);

/**
 * Gathers the packs within reach of the piece into near, which outlives work, and makes the nearest of them
 * the candidates, or the entry's hint when there is none.
 */
void qm_candidates_gather(qm_piece_work *work, qm_near_packs *near);

/** Sets the candidates up again from the list of packs, for the present slack and cutoff. */
void qm_candidates_refill(qm_piece_work *work);

/** Adds a pack to the candidates, in place of the last one when full; false when it is one already. */
bool qm_candidates_add(qm_piece_work *work, uint32_t pack);

/** The quads among the candidates that are nearest to a point. */
qm_near_quads qm_candidates_near_quads(const qm_piece_work *work, qm_vec p, qm_quads_query query);

/** Finds the footpoint of p on a quad near it, unless it is known. */
void qm_candidates_find_foot(qm_near_quad *quad, qm_vec p);

/** True when a quad among the candidates is found within a distance of a point. */
bool qm_candidates_quad_within(const qm_piece_work *work, qm_vec p, double distance);

/** True when a face of the target, a quad read as a patch, is shown to be within the cutoff of a triangle. */
bool qm_candidates_quad_covers(const qm_piece_work *work, uint32_t face, const qm_polygon *polygon);

/**
 * Makes labels for parts of the target's patches. The label of a whole patch loses the patch's twist of the
 * cutoff; a label for the part of it that is just under a polygon loses only its share, which falls with the
 * square of the size. centre is a point near the polygon's centre. False when no patch near it is twisted.
 */
bool qm_candidates_refine(const qm_piece_work *work, const qm_polygon *polygon, qm_vec centre,
                          const qm_near_quads *near, qm_refined *refined);

/** Covers a polygon by refined labels alone; in_reach is of these afterwards. */
bool qm_candidates_cover_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                                 bool *moved);

#endif
