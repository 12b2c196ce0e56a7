/**
 * hausdorff_parts.c: what a search in parts begins with, and what it leaves.
 *
 * A piece is left as it is, to the bit, so that the next call goes on where this one stopped. Its pack stands for it: all else
 * in the pack has been discarded, or is in a queue too, so that the largest of these bounds holds for the pack. A face that
 * was passed over as a copy of the one before it has the points of that face: pieces of that one are left, or it is discarded.
 */
#include "hausdorff_parts.h"

#include <string.h>

/* ---- pieces as bytes ---- */

/** Bytes that are written, or read. */
typedef struct piece_bytes {
    unsigned char at[QM_HAUSDORFF_PIECE_SIZE];
    size_t used;
    bool are_written;
} piece_bytes;

static void move(piece_bytes *bytes, void *value, size_t size)
{
    QM_ASSERT(bytes->used + size <= sizeof bytes->at);
    unsigned char *at = bytes->at + bytes->used;
    memcpy(bytes->are_written ? at : value, bytes->are_written ? value : at, size);
    bytes->used += size;
}

/** Writes or reads a piece; one that is read has 3 or 4 corners, or nothing beyond their number. */
static void move_piece(piece_bytes *bytes, qm_piece *piece, bool is_matching)
{
    move(bytes, &piece->corner_count, sizeof piece->corner_count);
    int count = piece->corner_count;
    if (count != 3 && count != 4) return;
    move(bytes, &piece->depth, sizeof piece->depth);
    move(bytes, &piece->cuts, sizeof piece->cuts);
    move(bytes, &piece->face, sizeof piece->face);
    move(bytes, &piece->slack, sizeof piece->slack);
    move(bytes, piece->corner, (size_t)count * sizeof *piece->corner);
    if (is_matching) {
        move(bytes, piece->distance, (size_t)count * sizeof *piece->distance);
        move(bytes, piece->foot, (size_t)count * sizeof *piece->foot);
    } else if (count == 4) {
        move(bytes, piece->low, sizeof piece->low);
        move(bytes, piece->high, sizeof piece->high);
    }
}

static void write_piece(const qm_search *search, const qm_piece *piece, qm_hausdorff_part *out)
{
    piece_bytes bytes = {.are_written = true};
    qm_piece copy = *piece;
    move_piece(&bytes, &copy, qm_search_is_matching(search));
    memcpy(out->piece, bytes.at, bytes.used);
    out->piece_size = (uint8_t)bytes.used;
}

/** False when the bytes are of another length than those of a piece. */
static bool read_piece(const qm_search *search, const qm_hausdorff_part *part, qm_piece *out)
{
    piece_bytes bytes = {.used = 0};
    if (part->piece_size > sizeof bytes.at) return false;
    memcpy(bytes.at, part->piece, part->piece_size);
    *out = (qm_piece){.pack = part->index};
    move_piece(&bytes, out, qm_search_is_matching(search));
    return bytes.used == part->piece_size;
}

/* ---- checks ---- */

static bool is_in_pack(const qm_pack_lanes *lanes, uint32_t face)
{
    bool is_in = false;
    for (uint32_t lane = 0; lane < lanes->lane_count; lane++)
        is_in |= lanes->face[lane] == face;
    return is_in;
}

/** True when the corners of a piece are feet on facets of the target, with distances. */
static bool has_feet(const qm_side *side, const qm_piece *piece)
{
    for (int i = 0; i < piece->corner_count; i++) {
        uint32_t pack = piece->foot[i] / QM_PACK_LANES, lane = piece->foot[i] % QM_PACK_LANES;
        if (pack >= side->target->pack_count || lane >= side->target->lanes[pack].lane_count) return false;
        if (!(piece->distance[i] >= 0.0)) return false;
    }
    return true;
}

static bool is_rectangle(const qm_piece *piece)
{
    for (int k = 0; k < 2; k++)
        if (!(piece->low[k] >= 0.0 && piece->low[k] <= piece->high[k] && piece->high[k] <= 1.0)) return false;
    return true;
}

/** True for a point that may be of the source: no coordinate is beyond all of the surfaces but for the roundings of cuts. */
static bool is_near(const qm_side *side, qm_vec p)
{
    return fmax(fabs(p.x), fmax(fabs(p.y), fabs(p.z))) <= 2.0 * side->reach && !isnan(p.x + p.y + p.z);
}

/** True when a part has a piece of a face of its pack. */
static bool has_piece(const qm_search *search, const qm_hausdorff_part *part)
{
    const qm_side *side = &search->side[part->side];
    qm_piece piece;
    if (part->level != 0 || !read_piece(search, part, &piece)) return false;
    if (!is_in_pack(&side->source->lanes[part->index], piece.face)) return false;
    if (!(piece.slack >= 0.0) || !isfinite(piece.slack)) return false;
    for (int i = 0; i < piece.corner_count; i++)
        if (!is_near(side, piece.corner[i])) return false;
    bool may_be_quad = piece.corner_count == 3 || side->source_patches;
    if (!may_be_quad ||
        (piece.corner_count == 4 && side->source->mesh.faces[4 * (size_t)piece.face + 3] == QM_NO_INDEX))
        return false;
    if (qm_search_is_matching(search)) return has_feet(side, &piece);
    return piece.corner_count == 3 || is_rectangle(&piece);
}

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
    if (part->piece_size > 0 && !has_piece(search, part))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "part %zu has no piece of pack %u of this search", i,
                               part->index);
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
        qm_worker *worker = &search->workers[i % (size_t)search->worker_count];
        qm_entry entry = {
            .upper = part->upper,
            .index = part->index,
            .hint = part->hint,
            .kind = part->piece_size > 0 ? QM_ENTRY_PIECE : QM_ENTRY_NODE,
            .side = part->side,
            .level = part->level,
        };
        qm_piece piece;
        bool is_read = entry.kind == QM_ENTRY_PIECE && read_piece(search, part, &piece);
        QM_ASSERT(is_read == (entry.kind == QM_ENTRY_PIECE)); /* checked */
        qm_worker_push(worker, entry, is_read ? &piece : NULL);
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
            qm_hausdorff_part part = {
                .upper = entry->upper,
                .index = entry->index,
                .hint = entry->hint,
                .side = entry->side,
                .level = entry->level,
            };
            if (entry->kind == QM_ENTRY_PIECE) {
                const qm_piece *piece = &queue->pool[entry->index];
                part.index = piece->pack;
                part.level = 0;
                write_piece(search, piece, &part);
            }
            parts->rest(parts->user, &part);
        }
    }
}
