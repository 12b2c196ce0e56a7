/**
 * patch_merge.c: joins blocks through a priority queue of the sides of all blocks, longest first. A side that
 * two blocks share is in the queue from either of them, and a joined block adds its own sides; so a side that
 * is popped while it is not shared need not be tested again until one of its blocks changes.
 */
#include "core/heap.h"
#include "patch_work.h"

#define CANCEL_STRIDE 4096

typedef struct merger {
    qm_context *ctx;
    qm_patch_links *links;
    qm_patch_block *block;
    size_t count;
    uint32_t *owner;
    uint32_t *parent;  /* union-find over the blocks */
    uint32_t *version; /* changes of each block so far */
    qm_heap queue;     /* of sides: see push_sides */
} merger;

static uint32_t find_block(merger *work, uint32_t face)
{
    uint32_t block = work->owner[face];
    while (work->parent[block] != block)
        block = work->parent[block] = work->parent[work->parent[block]];
    return work->owner[face] = block;
}

/**
 * Queues the four sides of a block by their lengths. The number of an item is 4 * block + side, with side 0
 * after the last column, 1 before the first one, 2 and 3 alike for rows; its origin is the version of the
 * block: the item is stale once the block has changed. False: out of memory.
 */
static bool push_sides(merger *work, uint32_t block)
{
    const qm_patch_block *at = &work->block[block];
    for (uint32_t side = 0; side < 4; side++)
        if (qm_heap_push(work->ctx, &work->queue,
                         (qm_heap_item){-(double)(side < 2 ? at->rows : at->columns), 4 * block + side,
                                        work->version[block]}) != QM_OK)
            return false;
    return true;
}

/** The cell at one end of a side: u points across the side, v along it. */
static qm_patch_cell side_cell(const qm_patch_links *links, const qm_patch_block *block, uint32_t side)
{
    qm_patch_cell cell = side < 2 ? block->first : qm_patch_cell_swap(block->first);
    if (side & 1) return qm_patch_cell_reverse_u(cell);
    while (qm_patch_cell_next(links, &cell)) {
    }
    return cell;
}

/** The cell across the side u; false where there is none. */
static bool cell_beyond(const qm_patch_links *links, qm_patch_cell cell, qm_patch_cell *beyond)
{
    if (!qm_patch_links_has(links, (qm_patch_side){cell.face, cell.u})) return false;
    *beyond = cell;
    qm_patch_cell_cross(links, beyond);
    return true;
}

/** True when the side that begins at this cell is a complete side of another block, too. */
static bool is_shared(merger *work, qm_patch_cell cell, uint32_t *other)
{
    const qm_patch_links *links = work->links;
    qm_patch_cell beyond, opposite;
    if (!cell_beyond(links, cell, &beyond)) return false;
    *other = find_block(work, beyond.face);
    if (*other == find_block(work, cell.face)) return false;
    if (!qm_patch_links_is_cut(links, (qm_patch_side){beyond.face, (beyond.v + 2) & 3})) return false;
    while (qm_patch_cell_next_row(links, &cell)) {
        if (!qm_patch_cell_next_row(links, &beyond)) return false;
        if (!cell_beyond(links, cell, &opposite)) return false;
        if (opposite.face != beyond.face || opposite.u != beyond.u || opposite.v != beyond.v) return false;
    }
    return qm_patch_links_is_cut(links, (qm_patch_side){beyond.face, beyond.v});
}

static bool join(merger *work, uint32_t block, uint32_t other, qm_patch_cell cell)
{
    do
        qm_patch_links_set_cut(work->links, (qm_patch_side){cell.face, cell.u}, false);
    while (qm_patch_cell_next_row(work->links, &cell));
    uint32_t kept = block < other ? block : other, gone = block < other ? other : block;
    work->parent[gone] = kept;
    work->version[gone]++;
    work->version[kept]++;
    unsigned ring;
    bool found = qm_patch_block_find(work->links, work->block[kept].first, &work->block[kept], &ring);
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
    for (size_t popped = 0; work->queue.count > 0; popped++) {
        if (popped % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return QM_E_CANCELED;
        qm_heap_item item = qm_heap_pop(&work->queue);
        uint32_t block = item.number / 4, other;
        if (item.origin != work->version[block]) continue;
        qm_patch_cell cell = side_cell(work->links, &work->block[block], item.number % 4);
        if (is_shared(work, cell, &other) && !join(work, block, other, cell)) return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

qm_status qm_patch_merge(qm_context *ctx, qm_patch_links *links, qm_patch_block *block, size_t count,
                         uint32_t *owner)
{
    merger work = {.ctx = ctx, .links = links, .block = block, .count = count, .owner = owner};
    work.parent = qm_context_alloc(ctx, count, sizeof *work.parent);
    work.version = qm_context_alloc(ctx, count, sizeof *work.version);
    qm_status status = (work.parent && work.version) || count == 0 ? merge_all(&work) : QM_E_NO_MEMORY;
    qm_context_free(ctx, work.parent, count, sizeof *work.parent);
    qm_context_free(ctx, work.version, count, sizeof *work.version);
    qm_heap_reset(ctx, &work.queue);
    return status;
}
