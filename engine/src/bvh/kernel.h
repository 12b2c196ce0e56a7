/**
 * kernel.h: the inner loops, compiled once for each instruction set and picked at run time. All geometry is
 * in the local frame of one tree. Nothing here allocates.
 */
#ifndef QM_KERNEL_H
#define QM_KERNEL_H

#include "bvh_tree.h"
#include "collide_leaf.h"
#include "collide_marks.h"
#include "core/hilbert.h"
#include "overlay_facets.h"
#include "qm/deform.h"
#include "qm/grid.h"

/** A label of an upper bound: one lane of one of a piece's packs. */
#define QM_COVER_PACKS 8    /* packs of candidates a piece; 64 lanes make one word of bits */
#define QM_NEAR_PACKS 32    /* packs of a neighbourhood */
#define QM_COVER_CORNERS 12 /* corners of the polygons on the way */
#define QM_SORT_FEW 32      /* numbers that sort_few takes at most */

/** Result of a search: the nearest triangle. */
typedef struct qm_hit {
    double d2;
    uint32_t pack, lane;
} qm_hit;

/** Result of a search in single precision: an upper bound of the distance to a triangle. */
typedef struct qm_float_hit {
    double upper;
    uint32_t pack, lane;
} qm_float_hit;

/**
 * Bits of the lanes of a pack, by what single precision can tell: in the low byte those proven to be within a
 * distance, in the high byte those not proven to lie beyond it. What holds for several points is their & .
 */
typedef uint16_t qm_float_bits;

static inline unsigned qm_float_certain(unsigned bits)
{
    return bits & 0xff;
}

/** Result of a search over bilinear patches. The distance d and its certified lower bound. */
typedef struct qm_bilinear_hit {
    double distance, lower;
    uint32_t face, pack;
} qm_bilinear_hit;

#define QM_TIES 16 /* faces of a list of ties */

/** A face that may be the answer of a projection, with its distance by the same operations whatever was
 * looked at before. */
typedef struct qm_tie {
    double distance;
    uint32_t face, pack, lane;
} qm_tie;

/**
 * The faces at most tau farther than the nearest, of which the lowest index is the answer. A face is left out
 * for one of a lower index that is no farther: wherever the nearest turns out to be, that one wins. So there
 * are few however many faces tie, and where there are too many all the same, a second search with is_settled
 * set and the least distance known keeps the lowest index alone.
 */
typedef struct qm_ties {
    double error; /* of the distances to patches, certified; 0: faces are read as triangles */
    double tau;
    double margin;    /* by which a lower bound of a distance may exceed the distance computed */
    double least;     /* of the distances so far */
    double reach;     /* least + tau: nothing beyond can be the answer */
    double reach2;    /* its square, rounded up */
    bool is_settled;  /* least is the least of all */
    bool is_overfull; /* a face found no place */
    int count;
    qm_tie tie[QM_TIES];
} qm_ties;

/** Packs near a part of the source, with their boxes. */
typedef struct qm_near_packs {
    int count;
    uint32_t pack[QM_NEAR_PACKS];
    qm_box_node box[QM_NEAR_PACKS / 8];
} qm_near_packs;

/** The lanes nearest to a point, nearest first; the first again where there are fewer. */
typedef struct qm_shortlist {
    uint32_t pack[QM_PACK_LANES];
    uint8_t lane[QM_PACK_LANES];
} qm_shortlist;

/** The candidates to cover a piece with: what lanes stand for, and how near a point must be to each. */
typedef struct qm_candidates {
    int count;
    const qm_pack *pack[QM_COVER_PACKS];
    qm_pack spare[QM_COVER_PACKS]; /* for those that the target has no room for */
    _Alignas(64) double cutoff2[QM_COVER_PACKS][QM_PACK_LANES]; /* squared distance; -1 for never */
    double twist[QM_COVER_PACKS][QM_PACK_LANES]; /* how far the surface may be from the lane's triangle */
} qm_candidates;

/** Whether single precision can tell that something is covered. */
typedef enum qm_float_verdict { QM_FLOAT_OPEN, QM_FLOAT_COVERED, QM_FLOAT_TOO_COARSE } qm_float_verdict;

/** A convex polygon of a source piece; in_reach has a bit for each lane within the cutoff distance. */
typedef struct qm_polygon {
    int count;
    int cuts_left; /* cuts that its rounding budget has room for, see rounding.h */
    qm_vec corner[QM_COVER_CORNERS];
    uint64_t in_reach[QM_COVER_CORNERS];
} qm_polygon;

enum { QM_BOX_SIDES = 6 };

typedef struct qm_kernel {
    const char *name;

    /** Lists the different vertices of 3 QM_PACK_LANES corners, in the order in which they come, and tells
     * each corner's place among them. */
    void (*share_corners)(qm_pack_lanes *lanes, const uint32_t vertex[3 * QM_PACK_LANES]);

    /** Sets the box of a pack from where its vertices are now. */
    void (*fit_box)(qm_bvh *bvh, size_t pack, const uint32_t *vertices, size_t count);

    /** Sets the boxes of a range of groups of eight packs, and those of their packs, by the lists of a
     * deformer. */
    void (*fit_groups)(qm_bvh *bvh, const qm_deformer *deformer, size_t begin, size_t end);

    /** Loads the corners of a pack's lanes from where their vertices are now. */
    void (*load_corners)(const qm_bvh *bvh, size_t pack, qm_pack_corners *out);

    /** Loads the corners as load_corners does, and sets the box of the pack. */
    void (*fit_corners)(qm_bvh *bvh, size_t pack, qm_pack_corners *out);

    /** Makes a pack of eight triangles: corner[i][axis][lane], axis 0 to 2 for x, y, z; aligned like the
     * pack. */
    void (*fill_pack)(qm_pack *pack, const double corner[3][3][QM_PACK_LANES]);

    /** The same in single precision. */
    void (*fill_float)(qm_float_pack *pack, const double corner[3][3][QM_PACK_LANES]);

    /** Squared distances from p to the eight triangles of a pack. */
    void (*pack_distances)(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES]);

    /**
     * Nearest triangle. hit->pack is a first guess and may be any pack; hit->d2 an upper bound already known
     * or INFINITY. Of equally near triangles the one of the lowest face wins. hit->lane is QM_PACK_LANES when
     * nothing is nearer than the bound given.
     */
    void (*closest)(const qm_bvh *bvh, qm_vec p, qm_hit *hit);

    /**
     * Nearest point of the patches, certified to within error; start is a first guess of a pack. With an
     * error of INFINITY a good point only: its distance is valid, lower is not.
     */
    void (*closest_patch)(const qm_bvh *bvh, qm_vec p, uint32_t start, double error, qm_bilinear_hit *hit);

    /** Finds the faces that tie; start is a first guess of a pack. */
    void (*closest_ties)(const qm_bvh *bvh, qm_vec p, uint32_t start, qm_ties *ties);

    /** Upper bound of the distance from p to the nearest surface of a pack: its triangles, or what is within
     * twist of them. */
    double (*float_upper)(const qm_float_pack *pack, const float *twist, qm_vec p);

    /** For each of 3 QM_PACK_LANES points with a bit in wanted, the bits of the lanes by the cutoff
     * distance. */
    void (*float_reach)(const qm_float_pack *pack, const float *twist, double cutoff, const qm_vec *point,
                        unsigned wanted, qm_float_bits *bits);

    /**
     * A triangle at most 1.2 times as far from p as the nearest, by its upper bound; the search ends as soon
     * as that is enough. hit->pack is a first guess. INFINITY when p is too far for single precision.
     */
    void (*float_closest)(const qm_bvh *bvh, qm_vec p, double enough, qm_float_hit *hit);

    /** The same three searches in a grid over the tree. */
    void (*grid_closest)(const qm_grid *grid, qm_vec p, qm_hit *hit);
    void (*grid_closest_patch)(const qm_grid *grid, qm_vec p, uint32_t start, double error,
                               qm_bilinear_hit *hit);
    void (*grid_closest_ties)(const qm_grid *grid, qm_vec p, uint32_t start, qm_ties *ties);

    /** The same three searches by offset tetrahedra over the tree. */
    void (*tetra_closest)(const qm_tetra *tetra, qm_vec p, qm_hit *hit);
    void (*tetra_closest_patch)(const qm_tetra *tetra, qm_vec p, uint32_t start, double error,
                                qm_bilinear_hit *hit);
    void (*tetra_closest_ties)(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_ties *ties);

    /**
     * Finds the radii of a patch's nodes, and its box, from where the vertices are now. changed has a bit for
     * each node that is to be looked at, with all above it; NULL for all. Returns how many radii were found.
     */
    size_t (*tetra_fit)(qm_tetra *tetra, size_t patch, const uint64_t *changed);

    /** Packs whose boxes come within reach of a box; when there are too many, those nearest to its middle. */
    void (*gather)(const qm_bvh *bvh, const qm_box *box, double reach, qm_near_packs *near);

    /** The same from a list, for a box in it: at most capacity packs. Returns how many; nearest first. */
    int (*narrow)(const qm_near_packs *near, const qm_box *box, double reach, int capacity, uint32_t *packs);

    /** Bits of the lanes within their cutoff distance of p, counted through the packs. */
    uint64_t (*in_reach)(const qm_candidates *candidates, qm_vec p);

    /** The eight lanes of the packs that are nearest to p, nearest first. The list of packs is not empty. */
    void (*shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list);

    /** Their triangles as one pack. */
    void (*shortlist_rows)(const qm_bvh *bvh, const qm_shortlist *list, qm_pack *rows);
    void (*shortlist_floats)(const qm_bvh *bvh, const qm_shortlist *list, qm_float_pack *rows);

    /**
     * The least over all lanes of the greatest distance of count points: an upper bound for every point of
     * their convex hull. *place is the candidate whose lane gives it.
     */
    double (*hull_upper)(const qm_candidates *candidates, const qm_vec *point, int count, int *place);

    /**
     * Tries to cover a convex polygon by convex sets {x : d(x, T_k) <= allowed_k}, cutting off as large a
     * part as one label can take at a time. True when nothing is left; else *polygon is what is left, a
     * convex part of the input, in_reach filled, and *moved is set when anything was cut off.
     */
    bool (*cover)(const qm_candidates *candidates, qm_polygon *polygon, bool *moved);

    /**
     * The same in single precision, by the lanes of one pack, less their twists unless NULL. Fills in
     * in_reach of the corners first; a polygon of more than three is covered by one label or not at all.
     */
    qm_float_verdict (*float_cover)(const qm_float_pack *pack, const float *twist, double cutoff,
                                    qm_polygon *polygon, bool *moved);

    /** Adds those facets of a pack whose boxes meet that of the frame, less their twists unless NULL; returns
     * their bits, and the vertices. There is room for all. */
    unsigned (*overlay_add)(qm_overlay_facets *facets, const qm_overlay_frame *frame, const qm_bvh *bvh,
                            uint32_t pack, const float *twist, qm_overlay_vertices *vertices);

    /** Sets planes and boxes from the facets added, at least one, and fills up the last group. */
    void (*overlay_close)(qm_overlay_facets *facets);

    /** True when no edge of the rim lies over a face. */
    bool (*overlay_is_clear)(const qm_overlay_facets *facets, const qm_overlay_face *face);

    /** An upper bound of the vertical distance between a face and the facets where they lie over each other;
     * -1 where none does. Above enough it is the greatest distance. Sets in far, a byte for each group, the
     * bits of the facets whose distance is more than enough, unless NULL. */
    double (*overlay_gap)(const qm_overlay_facets *facets, const qm_overlay_face *face, double enough,
                          uint8_t *far);

    /** Counts the facets over the probe of a face; -1 where roundings leave that open. */
    int (*overlay_count)(const qm_overlay_facets *facets, const qm_overlay_face *face);

    /** Walks from a pair of nodes, whose boxes are taken to meet, to the pairs below that meet. False when
     * take ended the walk. */
    bool (*descend)(const qm_descent *descent, const qm_node *a, const qm_node *b);

    /** Squared distances, in the frame of the tree that is split, of the members of one node of a pair from
     * the other node; 1 + 4e-7 times the true ones at most, INFINITY beyond what floats hold. Returns a bit
     * for each member. */
    unsigned (*node_distances)(const qm_descent *descent, const qm_node *a, const qm_node *b, bool splits_a,
                               float d2[QM_PACK_LANES]);

    /** Makes a leaf from a pack, in the frame given; the kind tells how its corners are marked. */
    void (*fill_leaf)(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack,
                      qm_leaf *leaf);

    /** Finds the pairs of a lane of p and one of q whose boxes meet, in TWO only, and adds those that are not
     * alike, or all if none are to be told alike, to what waits to be decided; there is room for all. */
    void (*add_lane_pairs)(const qm_leaf *p, const qm_leaf *q, bool seeks_alike, qm_lane_pairs *pairs,
                           qm_near_lanes *out);

    /** Tells whether eight pairs from the first on, a multiple of eight, meet; those that are there. */
    void (*decide_lane_pairs)(const qm_lane_pairs *pairs, unsigned first, qm_pair_verdicts *out);

    /**
     * Finds the pairs of a lane of p and one of q that may meet: all others are proven not to. In SELF
     * corners of the same mark and the edges between them don't count, and of a pair one must have its bit in
     * moved_p or moved_q. A leaf with itself gives each pair of different lanes once. False when there are
     * none. Not in TWO.
     */
    bool (*compare_leaves)(const qm_leaf *p, const qm_leaf *q, qm_collide_kind kind, unsigned moved_p,
                           unsigned moved_q, qm_near_lanes *out);

    /** Places along the curve of up to QM_HILBERT_TOGETHER cells, whose coordinates are below 2^bits. keys
     * has room for as many. */
    void (*hilbert_keys)(const qm_hilbert_cells *cells, int count, int bits, uint64_t *keys);

    /** The box of count positions, x y z each: an empty one of none. */
    void (*vertex_box)(const double *positions, size_t count, qm_box *box);

    /** Sets a vertex that lies on each side of the box of count positions: least x, y, z, then greatest. */
    void (*vertices_on_sides)(const double *positions, size_t count, const qm_box *box,
                              uint32_t vertex[QM_BOX_SIDES]);

    /** True when all corners of count faces, rows of four, are below vertex_count; the fourth may be
     * QM_NO_INDEX. */
    bool (*faces_below)(const uint32_t *faces, size_t count, uint32_t vertex_count);

    /** True when each of these vertices is a corner of one of count faces. */
    bool (*faces_name)(const uint32_t *faces, size_t count, const uint32_t vertex[QM_BOX_SIDES]);

    /** Finds the cell of each position, by the same monotone steps wherever it stands. */
    void (*vertex_cells)(const qm_cell_grid *grid, const double *positions, size_t count, qm_cell *cells);

    /** Vertices in whole numbers: (position - origin) scale + 1 is 0 to 2, which becomes 0 to 2^QM_FINE_BITS;
     * what is beyond goes to the first or last number. Each axis takes QM_FINE_FIELD bits, x the lowest. */
    void (*vertex_fine)(const double origin[3], double scale, const double *positions, size_t count,
                        uint64_t *fine);

    /** Finds the cells that the boxes of QM_CELL_FACES faces, rows of four corners, reach into, from those of
     * the vertices, fewer than 2^31. Returns bits of the faces that are not all outside on one side. */
    unsigned (*cell_boxes)(const qm_cell_grid *grid, const uint32_t *faces, const qm_cell *cells,
                           qm_cell_boxes *out);

    /** Bits of the boxes that reach into a marked cell. Those over more than two by two rows, or more than
     * QM_CELL_SPAN cells further, are not looked at: *large has their bits. */
    unsigned (*cells_marked)(const qm_cell_grid *grid, const qm_cell_marks *marks, const qm_cell_boxes *boxes,
                             unsigned *large);

    /** Adds those of eight faces, the first of which is told, that have a bit to a list. */
    void (*keep_cells)(const qm_cell_boxes *boxes, uint32_t first, unsigned faces, qm_cell_list *list);

    /** Sorts up to QM_SORT_FEW numbers below 2^58, equal ones too. */
    void (*sort_few)(uint64_t *numbers, int count);
} qm_kernel;

/** The widest kernel that this processor runs. */
const qm_kernel *qm_kernel_get(void);

/** All kernels that this processor runs, widest first; NULL ends the list. For tests. */
const qm_kernel *const *qm_kernel_list(void);

#endif
