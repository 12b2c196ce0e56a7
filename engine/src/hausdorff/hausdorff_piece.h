/**
 * hausdorff_piece.h: one piece on its way through the lower stage, shared by the files that work on it.
 *
 *   hausdorff_face.c         whole faces, tried with the facets nearest to them; pieces that come back
 *   hausdorff_candidates.c   which facets of the target it may be covered with
 *   hausdorff_triangle.c     triangles: cover, split, try again
 *   hausdorff_rectangle.c    parameter rectangles of the source's bilinear patches
 */
#ifndef QM_HAUSDORFF_PIECE_H
#define QM_HAUSDORFF_PIECE_H

#include "core/rounding.h"
#include "hausdorff_search.h"
#include "prim/bilinear_point.h"

#define QM_PART_STACK 128 /* parts of a piece that wait */
#define QM_NEAR_QUADS 4   /* patches of the target looked at for one part */
#define QM_STRICT_DEPTH 8 /* from here on a corner must be reached with half the tolerance to spare */

/** A triangle of the piece, with what is known of its corners; in_reach holds for one generation of
 * candidates. */
typedef struct qm_part {
    qm_vec corner[3];
    uint64_t in_reach[3];
    unsigned generation;
    uint8_t depth, cuts_left;
} qm_part;

typedef struct qm_piece_work {
    qm_worker *worker;
    const qm_search *search;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_entry entry;
    qm_piece piece;
    int depth;                 /* of the piece, or of the part at hand */
    double slack;              /* the parts lie within this distance of the source's surface: piece.slack, */
    int cut_limit;             /* and the roundings of this many cuts beyond those that eta has room for */
    const qm_near_packs *near; /* of a neighbourhood that holds the piece */
    uint32_t packs[QM_COVER_PACKS];
    int pack_count;
    qm_candidates candidates;
    double filled_for;   /* what a distance was cutoff to be when the candidates were set up */
    unsigned generation; /* counts changes of the candidates */
    qm_part stack[QM_PART_STACK];
    int height;
} qm_piece_work;

/** A quad of the target near a point: how near, and where on it. */
typedef struct qm_near_quad {
    uint32_t face, pack;
    double
        distance; /* of a point of the patch; where the twist is negligible, of its triangles and the twist */
    double twist;
    bool has_foot; /* set for twisted quads only, */
    double uv[2];  /* of the foot */
    qm_bilinear patch;
} qm_near_quad;

/** Quads of the target, each once, nearest first. */
typedef struct qm_near_quads {
    int count, wanted;
    double farthest; /* quads no nearer than this are dropped */
    qm_near_quad at[QM_NEAR_QUADS];
} qm_near_quads;

/** Which of the quads near a point are asked for. */
typedef struct qm_quads_asked {
    int wanted;        /* at most so many, */
    double within;     /* all nearer than this; */
    double enough;     /* a nearest one within this ends the search, and others may be nearer then */
    bool twisted_only; /* no flat ones */
} qm_quads_asked;

/** Labels for those parts of the target's patches that lie under a polygon: they lose only their share of the
 * twist. */
typedef struct qm_refined {
    qm_pack pack;
    qm_candidates labels;
} qm_refined;

/** What a distance may be for a point to be let go, in the frame of the target. */
static inline double qm_piece_cutoff(const qm_piece_work *work)
{
    return qm_search_cutoff(work->search) * work->side->scale;
}

static inline qm_vec qm_polygon_centroid(const qm_polygon *polygon)
{
    return qm_vec_centroid(polygon->corner, polygon->count);
}

/* hausdorff_candidates.c */

/**
 * Gathers the packs within reach of the piece into near, which outlives work, and makes the nearest of them
 * the candidates, or the entry's hint when there is none.
 */
void qm_piece_gather(qm_piece_work *work, qm_near_packs *near);

/** Sets the candidates up from the list of packs, for the slack and the lower bound as they are now. */
void qm_piece_fill_candidates(qm_piece_work *work);

/** Puts a pack among the candidates, in place of the last one when full; false when it is one already. */
bool qm_piece_add_candidate(qm_piece_work *work, uint32_t pack);

/** Quads among the candidates that lie nearest to a point. */
qm_near_quads qm_piece_near_quads(const qm_piece_work *work, qm_vec p, qm_quads_asked asked);

/** Looks for the foot of p on a quad near to it, unless it is known. */
void qm_piece_find_foot(qm_near_quad *quad, qm_vec p);

/** True when a quad among the candidates is found to be no farther than that. */
bool qm_piece_quad_within(const qm_piece_work *work, qm_vec p, double distance);

/** True when a triangle is shown to be near enough by a quad of the target alone, read as a patch. */
bool qm_piece_over_face(const qm_piece_work *work, uint32_t face, const qm_polygon *polygon);

/** The same by the quad under its middle. */
bool qm_piece_over_patch(const qm_piece_work *work, const qm_polygon *polygon);

/**
 * Labels of the target's patches lose their twist of the cutoff distance. This makes labels for those parts
 * of the twisted patches near the middle of a polygon that lie just under it. They lose only their share,
 * which falls with the square of the size. False when no patch is twisted.
 */
bool qm_piece_refine(const qm_piece_work *work, const qm_polygon *polygon, qm_vec middle,
                     const qm_near_quads *near, qm_refined *refined);

/** Covers a polygon by refined labels alone; in_reach is of these afterwards. */
bool qm_piece_cover_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                            bool *moved);

/* hausdorff_face.c */

/**
 * Covers a polygon by the facets nearest to its middle: mostly enough, and much cheaper than by all. One
 * label must take all of a polygon of four corners, which stands for a hull.
 */
bool qm_piece_cover_by_nearest(const qm_piece_work *work, qm_polygon *polygon, bool *moved);

/* hausdorff_triangle.c */

/** Fills in_reach of all corners. */
void qm_piece_reach_corners(const qm_piece_work *work, qm_polygon *polygon);

/**
 * Covers a polygon by all candidates, and by refined parts of patches: these first where the polygon is a
 * part of the piece (depth is greater). in_reach is not filled afterwards.
 */
bool qm_piece_cover(const qm_piece_work *work, qm_polygon *polygon, bool *moved);

/** Covers as qm_piece_cover does, with refined labels that were made before, or NULL for none. */
bool qm_piece_cover_with(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                         bool *moved);

/**
 * Measures the corners that need it. True when that found new candidates or raised the lower bound: in_reach
 * is then made anew.
 */
bool qm_piece_sample_corners(qm_piece_work *work, qm_polygon *polygon, int depth);

/**
 * Measures a point of a piece when the candidates do not reach it. True when that brought a candidate or
 * raised the lower bound, so that another try may succeed.
 */
bool qm_piece_sample_unreached(qm_piece_work *work, qm_vec p);

/** Queues a triangle or rectangle with the bound that its best single label gives. */
void qm_piece_push(qm_piece_work *work, const qm_piece *piece);

/** Sets the slack of the piece's triangles: how far they leave the source's surface, beside roundings. */
void qm_piece_set_slack(qm_piece_work *work, double slack);

/** A triangle of the piece, with room for all cuts of a visit. */
qm_polygon qm_piece_triangle(const qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c);

/** Puts a triangle of the piece on the stack of parts. */
void qm_piece_keep_triangle(qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c);

/** Works through the stack of parts; what the budget of one visit leaves over goes to the queue. */
void qm_piece_process_stack(qm_piece_work *work);

/* hausdorff_rectangle.c */

/** Covers a rectangle by the facets nearest to it: its hull by one, or its two triangles with the slack of
 * the patch. */
bool qm_piece_rectangle_covered(qm_piece_work *work);

/** Covers a rectangle, or goes on with its two triangles when it is flat enough, or cuts it in parts for the
 * queue. */
void qm_piece_process_rectangle(qm_piece_work *work);

#endif
