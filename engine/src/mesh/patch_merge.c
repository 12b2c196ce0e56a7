/**
 * patch_merge.c: a heap of the sides of all blocks. A side that two blocks share is in it from either of
 * them, and a joined block puts its own sides in; so a side that comes out and is not shared by then needs
 * no second look until one of its blocks changes.
 */
#include "patch_merge.h"

#define CANCEL_STRIDE 4096

/** A side of a block as it was when it was put in: stale once the block has changed since. */
typedef struct block_side {
    uint32_t length;
    uint32_t block;
    uint32_t version;
    uint32_t side; /* 0: after the last column, 1: before the first, 2 and 3: the same of rows */
} block_side;

typedef struct merger {
    qm_context *ctx;
    qm_patch_links *links;
    qm_quad_cell_block *block;
    size_t count;
    uint32_t *owner;
    uint32_t *parent;  /* union-find over the blocks */
    uint32_t *version; /* changes of each block so far */
    block_side *heap;
    size_t heap_count, heap_capacity;
} merger;

static bool comes_before(const block_side *a, const block_side *b)
{
    if (a->length != b->length) return a->length > b->length;
    if (a->block != b->block) return a->block < b->block;
    return a->side < b->side;
}

static bool push(merger *work, block_side side)
{
    if (work->heap_count == work->heap_capacity) {
        size_t capacity = 2 * work->heap_capacity + 64;
        block_side *grown =
            qm_context_resize(work->ctx, work->heap, work->heap_capacity, capacity, sizeof *grown);
        if (!grown) return false;
        work->heap = grown;
        work->heap_capacity = capacity;
    }
    size_t at = work->heap_count++;
    for (size_t up; at > 0 && comes_before(&side, &work->heap[up = (at - 1) / 2]); at = up)
        work->heap[at] = work->heap[up];
    work->heap[at] = side;
    return true;
}

static block_side pop(merger *work)
{
    block_side top = work->heap[0], last = work->heap[--work->heap_count];
    size_t at = 0;
    for (size_t down; (down = 2 * at + 1) < work->heap_count; at = down) {
        if (down + 1 < work->heap_count && comes_before(&work->heap[down + 1], &work->heap[down])) down++;
        if (!comes_before(&work->heap[down], &last)) break;
        work->heap[at] = work->heap[down];
    }
    work->heap[at] = last;
    return top;
}

static uint32_t find_block(merger *work, uint32_t face)
{
    uint32_t block = work->owner[face];
    while (work->parent[block] != block)
        block = work->parent[block] = work->parent[work->parent[block]];
    return work->owner[face] = block;
}

static bool push_sides(merger *work, uint32_t block)
{
    const qm_quad_cell_block *at = &work->block[block];
    for (uint32_t side = 0; side < 4; side++)
        if (!push(work, (block_side){side < 2 ? at->rows : at->columns, block, work->version[block], side}))
            return false;
    return true;
}

/** The cell at one end of a side: u looks over the side, v runs along it. */
static qm_quad_cell side_cell(const qm_patch_links *links, const qm_quad_cell_block *block, uint32_t side)
{
    qm_quad_cell cell = side < 2 ? block->first : qm_quad_cell_swap(block->first);
    if (side & 1) return qm_quad_cell_reverse_u(cell);
    while (qm_quad_cell_next(links, &cell)) {
    }
    return cell;
}

static bool cell_equals(qm_quad_cell a, qm_quad_cell b)
{
    return a.face == b.face && a.u == b.u && a.v == b.v;
}

/** The cell beyond the cut that u looks at; false where there is none. */
static bool cell_beyond(const qm_patch_links *links, qm_quad_cell cell, qm_quad_cell *beyond)
{
    if (!qm_links_has(links, (qm_quad_side){cell.face, cell.u})) return false;
    *beyond = cell;
    qm_quad_cell_cross(links, beyond);
    return true;
}

/** True when another block lies along the whole side that begins at this cell, and ends where it ends. */
static bool is_shared(merger *work, qm_quad_cell cell, uint32_t *other)
{
    const qm_patch_links *links = work->links;
    qm_quad_cell beyond, opposite;
    if (!cell_beyond(links, cell, &beyond)) return false;
    *other = find_block(work, beyond.face);
    if (*other == find_block(work, cell.face)) return false;
    if (!qm_links_is_cut(links, (qm_quad_side){beyond.face, (beyond.v + 2) & 3})) return false;
    while (qm_quad_cell_next_row(links, &cell)) {
        if (!qm_quad_cell_next_row(links, &beyond)) return false;
        if (!cell_beyond(links, cell, &opposite) || !cell_equals(beyond, opposite)) return false;
    }
    return qm_links_is_cut(links, (qm_quad_side){beyond.face, beyond.v});
}

static bool join(merger *work, uint32_t block, uint32_t other, qm_quad_cell cell)
{
    do
        qm_links_set_cut(work->links, (qm_quad_side){cell.face, cell.u}, false);
    while (qm_quad_cell_next_row(work->links, &cell));
    uint32_t kept = block < other ? block : other, gone = block < other ? other : block;
    work->parent[gone] = kept;
    work->version[gone]++;
    work->version[kept]++;
    unsigned ring;
    bool found = qm_quad_cell_block_find(work->links, work->block[kept].first, &work->block[kept], &ring);
    QM_ASSERT(found);
    return found && push_sides(work, kept);
}

static qm_status merge_all(merger *work)
{
    for (uint32_t i = 0; i < work->count; i++) {
        work->parent[i] = i;
        work->version[i] = 0;
        if (!push_sides(work, i)) return QM_E_NO_MEMORY;
    }
    for (size_t looked = 0; work->heap_count > 0; looked++) {
        if (looked % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return QM_E_CANCELED;
        block_side side = pop(work);
        if (side.version != work->version[side.block]) continue;
        qm_quad_cell cell = side_cell(work->links, &work->block[side.block], side.side);
        uint32_t other;
        if (is_shared(work, cell, &other) && !join(work, side.block, other, cell)) return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

qm_status qm_patch_merge(qm_context *ctx, qm_patch_links *links, qm_quad_cell_block *block, size_t count,
                         uint32_t *owner)
{
    merger work = {.ctx = ctx, .links = links, .block = block, .count = count, .owner = owner};
    work.parent = qm_context_alloc(ctx, count, sizeof *work.parent);
    work.version = qm_context_alloc(ctx, count, sizeof *work.version);
    qm_status status = (work.parent && work.version) || count == 0 ? merge_all(&work) : QM_E_NO_MEMORY;
    qm_context_free(ctx, work.parent, count, sizeof *work.parent);
    qm_context_free(ctx, work.version, count, sizeof *work.version);
    qm_context_free(ctx, work.heap, work.heap_capacity, sizeof *work.heap);
    return status;
}
