/**
 * patch_work.h: shared by the files that find the regular patches of a quad mesh (patch.c): links between
 * quads and cuts (patch_links.c), tracing of cuts (patch_trace.c), joining of blocks (patch_merge.c).
 *
 * Side s of a face runs from its corner s to corner s + 1. A link gives the face and side across a side, and
 * whether the two faces wind in opposite ways (then both sides run from the same end).
 */
#ifndef QM_PATCH_WORK_H
#define QM_PATCH_WORK_H

#include "qm/patch.h"

/* ---- links and cuts ---- */

#define QM_PATCH_NO_LINK UINT32_MAX

typedef struct qm_patch_side {
    uint32_t face;
    uint32_t side; /* 0 to 3 */
} qm_patch_side;

typedef struct qm_patch_links {
    size_t face_count;
    uint32_t *across; /* 4 a face: (face * 4 + side) * 2 + same way, or QM_PATCH_NO_LINK */
    uint8_t *cuts;    /* a bit a side: patches end here; set wherever there is no link */
} qm_patch_links;

/**
 * Links the quads of a mesh across every edge that has just two faces, both of them quads that repeat no
 * vertex. Returns QM_OK, QM_E_TOO_LARGE, QM_E_NO_MEMORY or QM_E_CANCELED; qm_patch_links_reset frees either
 * way.
 */
qm_status qm_patch_links_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_links *out);

void qm_patch_links_reset(qm_context *ctx, qm_patch_links *links);

static inline bool qm_patch_links_is_cut(const qm_patch_links *links, qm_patch_side at)
{
    return links->cuts[at.face] >> at.side & 1;
}

/** The side across a side that has a link. *same_way is set where the two faces wind in opposite ways. */
static inline qm_patch_side qm_patch_links_across(const qm_patch_links *links, qm_patch_side at,
                                                  bool *same_way)
{
    uint32_t link = links->across[4 * (size_t)at.face + at.side];
    QM_ASSERT(link != QM_PATCH_NO_LINK);
    *same_way = link & 1;
    return (qm_patch_side){link >> 3, link >> 1 & 3};
}

static inline bool qm_patch_links_has(const qm_patch_links *links, qm_patch_side at)
{
    return links->across[4 * (size_t)at.face + at.side] != QM_PATCH_NO_LINK;
}

/** Marks a side that has a link, and the side across, as a cut, or removes the marks. */
static inline void qm_patch_links_set_cut(const qm_patch_links *links, qm_patch_side at, bool cut)
{
    bool same_way;
    qm_patch_side beyond = qm_patch_links_across(links, at, &same_way);
    if (cut) {
        links->cuts[at.face] |= (uint8_t)(1u << at.side);
        links->cuts[beyond.face] |= (uint8_t)(1u << beyond.side);
    } else {
        links->cuts[at.face] &= (uint8_t) ~(1u << at.side);
        links->cuts[beyond.face] &= (uint8_t) ~(1u << beyond.side);
    }
}

/* ---- darts: sides with one of their ends, to circle around a vertex ---- */

typedef struct qm_patch_dart {
    qm_patch_side at;
    uint32_t corner; /* of at.face: at.side or at.side + 1, modulo 4 */
} qm_patch_dart;

/** The other side of the same face at the same corner. */
static inline qm_patch_dart qm_patch_dart_rotate(qm_patch_dart dart)
{
    bool is_start = dart.corner == dart.at.side;
    dart.at.side = (is_start ? dart.at.side + 3 : dart.at.side + 1) & 3;
    return dart;
}

/** The same side and corner as the face across has them; the side has a link. */
static inline qm_patch_dart qm_patch_dart_cross(const qm_patch_links *links, qm_patch_dart dart)
{
    bool same_way, is_start = dart.corner == dart.at.side;
    qm_patch_side beyond = qm_patch_links_across(links, dart.at, &same_way);
    return (qm_patch_dart){beyond, (is_start == same_way ? beyond.side : beyond.side + 1) & 3};
}

/** The same side with its other end. */
static inline qm_patch_dart qm_patch_dart_reverse(qm_patch_dart dart)
{
    dart.corner = (dart.corner == dart.at.side ? dart.at.side + 1 : dart.at.side) & 3;
    return dart;
}

/* ---- cells: quads of a block, a rectangle whose sides are cuts ---- */

typedef struct qm_patch_cell {
    uint32_t face;
    uint32_t u, v; /* adjacent sides of the face: towards the next column, and the next row */
} qm_patch_cell;

/** The cell in the orientation of its face: corner 0 at (0, 0), corner 1 at the next column. */
static inline qm_patch_cell qm_patch_cell_make(uint32_t face)
{
    return (qm_patch_cell){face, 1, 2};
}

/** The cell with columns and rows exchanged; qm_patch_cell_reverse_u and _v turn one direction round. */
static inline qm_patch_cell qm_patch_cell_swap(qm_patch_cell cell)
{
    return (qm_patch_cell){cell.face, cell.v, cell.u};
}

static inline qm_patch_cell qm_patch_cell_reverse_u(qm_patch_cell cell)
{
    return (qm_patch_cell){cell.face, (cell.u + 2) & 3, cell.v};
}

static inline qm_patch_cell qm_patch_cell_reverse_v(qm_patch_cell cell)
{
    return (qm_patch_cell){cell.face, cell.u, (cell.v + 2) & 3};
}

/** Steps over the side u, which has a link. The corner between the sides u and v stays the same. */
static inline void qm_patch_cell_cross(const qm_patch_links *links, qm_patch_cell *cell)
{
    bool v_follows = cell->v == ((cell->u + 1) & 3);
    qm_patch_dart dart = {{cell->face, cell->u}, v_follows ? cell->v : cell->u};
    qm_patch_dart over = qm_patch_dart_cross(links, dart);
    *cell = (qm_patch_cell){over.at.face, (over.at.side + 2) & 3, qm_patch_dart_rotate(over).at.side};
}

/** Steps to the next column; false at a cut. */
static inline bool qm_patch_cell_next(const qm_patch_links *links, qm_patch_cell *cell)
{
    if (qm_patch_links_is_cut(links, (qm_patch_side){cell->face, cell->u})) return false;
    qm_patch_cell_cross(links, cell);
    return true;
}

/** Steps to the next row; false at a cut. */
static inline bool qm_patch_cell_next_row(const qm_patch_links *links, qm_patch_cell *cell)
{
    qm_patch_cell swapped = qm_patch_cell_swap(*cell);
    if (!qm_patch_cell_next(links, &swapped)) return false;
    *cell = qm_patch_cell_swap(swapped);
    return true;
}

/** How the face is rotated and mirrored in its patch: see turns of qm_patch_set. */
static inline uint8_t qm_patch_cell_turn(qm_patch_cell cell)
{
    bool is_mirrored = cell.v != ((cell.u + 1) & 3);
    return is_mirrored ? (uint8_t)(4 | ((cell.u + 2) & 3)) : (uint8_t)((cell.u + 3) & 3);
}

typedef struct qm_patch_block {
    qm_patch_cell first;
    uint32_t rows, columns;
} qm_patch_block;

/**
 * Finds the block that a cell lies in. False when the cells form a ring: *ring is then set for columns that
 * return to their start (bit 0) and rows that do (bit 1).
 */
bool qm_patch_block_find(const qm_patch_links *links, qm_patch_cell cell, qm_patch_block *block,
                         unsigned *ring);

/* ---- cuts that run straight over the edges ---- */

/** Cuts in progress: each entry is the next step of one, a side and the corner that it leads to. */
typedef struct qm_patch_trace {
    qm_context *ctx;
    qm_patch_links *links;
    qm_patch_dart *steps;
    size_t count, capacity;
} qm_patch_trace;

/** Marks a side that has a link as a cut, which continues at both its ends. False: out of memory. */
bool qm_patch_trace_start_through(qm_patch_trace *trace, qm_patch_side side);

/** Starts cuts at every irregular vertex. False: out of memory. */
bool qm_patch_trace_start_irregular(qm_patch_trace *trace);

/** Advances all cuts in rounds of one side each, until the last has ended. */
void qm_patch_trace_run(qm_patch_trace *trace);

void qm_patch_trace_reset(qm_patch_trace *trace);

/* ---- joining ---- */

/**
 * Removes the cuts between blocks that share a complete side, longest side first, until no two do. block has
 * count entries, owner gives the block of each face; the call leaves both in an unspecified state.
 *
 * Returns QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED.
 */
qm_status qm_patch_merge(qm_context *ctx, qm_patch_links *links, qm_patch_block *block, size_t count,
                         uint32_t *owner);

#endif
