/**
 * hausdorff_parts.c: what a search in parts begins with, and what it leaves.
 *
 * A piece is left as its whole pack: all else in the pack has been discarded, or is in a queue too, so that the
 * largest of these bounds holds for the pack. A face that was passed over as a copy of the one
 * before it has that face's bound: the pack of that face is left, or the face is discarded.
 */
#include "hausdorff_parts.h"

static qm_status check_part(qm_context *ctx, const qm_search *search, const qm_hausdorff_part *part, size_t i)
{
    if (part->side >= search->side_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "part %zu is of direction %d, the search has %d", i,
                               part->side, search->side_count);
    const qm_side *side = &search->side[part->side];
    const qm_box_tree *tree = &side->source->boxes;
    if (part->level > tree->level_count || part->index >= tree->group_count[part->level])
        return qm_context_fail(ctx, QM_E_ARGUMENT, "part %zu is node %u of level %d, which the tree lacks", i,
                               part->index, part->level);
    if (part->hint >= side->target->pack_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "part %zu has hint %u, the target has %zu packs", i,
                               part->hint, (size_t)side->target->pack_count);
    if (!(part->upper >= 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "part %zu has the upper bound %g", i, part->upper);
    return QM_OK;
}

qm_status qm_parts_check(qm_context *ctx, const qm_search *search)
{
    QM_ASSERT(ctx && search);
    const qm_hausdorff_parts *parts = search->options->parts;
    if (!parts) return QM_OK;
    if (!(parts->known_lower >= 0.0) || isinf(parts->known_lower))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "known lower bound must be 0 or more, got %g",
                               parts->known_lower);
    qm_status status = QM_OK;
    for (size_t i = 0; parts->begin && i < parts->count && status == QM_OK; i++)
        status = check_part(ctx, search, &parts->begin[i], i);
    return status;
}

void qm_parts_queue(qm_search *search)
{
    QM_ASSERT(search && search->options->parts && search->options->parts->begin);
    const qm_hausdorff_parts *parts = search->options->parts;
    for (size_t i = 0; i < parts->count; i++) {
        const qm_hausdorff_part *part = &parts->begin[i];
        qm_entry entry = {
            .upper = part->upper,
            .index = part->index,
            .hint = part->hint,
            .kind = QM_ENTRY_NODE,
            .side = part->side,
            .level = part->level,
        };
        qm_worker_push(&search->workers[i % (size_t)search->worker_count], entry, NULL);
    }
}

void qm_parts_give_rest(const qm_search *search)
{
    QM_ASSERT(search);
    const qm_hausdorff_parts *parts = search->options->parts;
    if (!parts || !parts->rest) return;
    for (int i = 0; i < search->worker_count; i++) {
        const qm_queue *queue = &search->workers[i].queue;
        for (size_t k = 0; k < queue->count; k++) {
            const qm_entry *entry = &queue->heap[k];
            bool is_piece = entry->kind == QM_ENTRY_PIECE;
            qm_hausdorff_part part = {
                .upper = entry->upper,
                .index = is_piece ? queue->pool[entry->index].pack : entry->index,
                .hint = entry->hint,
                .side = entry->side,
                .level = is_piece ? 0 : entry->level,
            };
            parts->rest(parts->user, &part);
        }
    }
}
