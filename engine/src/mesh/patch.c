/**
 * patch.c: from links and cuts to patches. What the cuts leave is flat, with straight sides and right
 * angles: by Gauss and Bonnet a rectangle, or a ring, a Moebius strip, a torus or a Klein bottle, which have
 * no corner. One cut across opens a ring or a strip; two that cross open the others.
 */
#include "qm/patch.h"

#include "patch_grid.h"
#include "patch_known.h"
#include "patch_merge.h"
#include "patch_trace.h"

#define NO_OWNER UINT32_MAX

typedef struct patch_finder {
    qm_context *ctx;
    const qm_mesh *mesh;
    qm_patch_links links;
    qm_patch_trace trace;
    uint32_t *owner; /* block of each face */
    qm_quad_cell_block *block;
    size_t block_count, block_capacity;
} patch_finder;

/** The block of a cell; where cells run into themselves, cuts are made first. False: out of memory. */
static bool find_block(patch_finder *finder, uint32_t face, qm_quad_cell_block *block)
{
    unsigned ring;
    while (!qm_quad_cell_block_find(&finder->links, qm_quad_cell_make(face), block, &ring)) {
        qm_quad_cell cell = qm_quad_cell_make(face);
        if ((ring & 1) && !qm_patch_trace_start_through(&finder->trace, (qm_quad_side){face, cell.u}))
            return false;
        if ((ring & 2) && !qm_links_is_cut(&finder->links, (qm_quad_side){face, cell.v}) &&
            !qm_patch_trace_start_through(&finder->trace, (qm_quad_side){face, cell.v}))
            return false;
        qm_patch_trace_run(&finder->trace);
    }
    return true;
}

static bool add_block(patch_finder *finder, const qm_quad_cell_block *block)
{
    if (finder->block_count == finder->block_capacity) {
        size_t capacity = 2 * finder->block_capacity + 64;
        qm_quad_cell_block *grown =
            qm_context_resize(finder->ctx, finder->block, finder->block_capacity, capacity, sizeof *grown);
        if (!grown) return false;
        finder->block = grown;
        finder->block_capacity = capacity;
    }
    finder->block[finder->block_count++] = *block;
    return true;
}

/** Calls visit for every cell of a block, row by row. */
static void visit_cells(const qm_patch_links *links, const qm_quad_cell_block *block,
                        void (*visit)(void *user, size_t place, qm_quad_cell cell), void *user)
{
    qm_quad_cell row = block->first;
    for (size_t r = 0; r < block->rows; r++) {
        qm_quad_cell cell = row;
        for (size_t c = 0; c < block->columns; c++) {
            visit(user, r * block->columns + c, cell);
            if (c + 1 < block->columns) qm_quad_cell_next(links, &cell);
        }
        if (r + 1 < block->rows) qm_quad_cell_next_row(links, &row);
    }
}

static void own_cell(void *user, size_t place, qm_quad_cell cell)
{
    (void)place;
    patch_finder *finder = user;
    finder->owner[cell.face] = (uint32_t)(finder->block_count - 1);
}

/** Finds the blocks of all faces, by their lowest one. */
static qm_status find_blocks(patch_finder *finder)
{
    finder->block_count = 0;
    for (size_t f = 0; f < finder->mesh->face_count; f++)
        finder->owner[f] = NO_OWNER;
    for (uint32_t f = 0; f < finder->mesh->face_count; f++) {
        qm_quad_cell_block block;
        if (finder->owner[f] != NO_OWNER) continue;
        if (qm_context_canceled(finder->ctx)) return QM_E_CANCELED;
        if (!find_block(finder, f, &block) || !add_block(finder, &block)) return QM_E_NO_MEMORY;
        visit_cells(&finder->links, &block, own_cell, finder);
    }
    return QM_OK;
}

/** Where visit_cells writes to. */
typedef struct patch_writer {
    uint32_t *faces;
    uint8_t *turns;
} patch_writer;

static void write_cell(void *user, size_t place, qm_quad_cell cell)
{
    const patch_writer *writer = user;
    writer->faces[place] = cell.face;
    writer->turns[place] = qm_quad_cell_turn(cell);
}

static qm_status write_patches(const patch_finder *finder, qm_patch_set *out)
{
    size_t faces = finder->mesh->face_count;
    out->patch_count = finder->block_count;
    out->face_count = faces;
    out->patches = qm_context_alloc(finder->ctx, out->patch_count, sizeof *out->patches);
    out->faces = qm_context_alloc(finder->ctx, faces, sizeof *out->faces);
    out->turns = qm_context_alloc(finder->ctx, faces, sizeof *out->turns);
    if (!out->patches || !out->faces || !out->turns) return QM_E_NO_MEMORY;
    size_t first = 0;
    for (size_t i = 0; i < out->patch_count; i++) {
        const qm_quad_cell_block *block = &finder->block[i];
        out->patches[i] = (qm_regular_patch){first, block->rows, block->columns};
        patch_writer writer = {out->faces + first, out->turns + first};
        visit_cells(&finder->links, block, write_cell, &writer);
        size_t count = (size_t)block->rows * block->columns;
        if (count > 1) out->quad_count += count;
        first += count;
    }
    return QM_OK;
}

static qm_status find_patches(patch_finder *finder, qm_patch_set *out)
{
    qm_status status = qm_patch_links_find(finder->ctx, finder->mesh, &finder->links);
    if (status != QM_OK) return status;
    if (!qm_patch_trace_start_irregular(&finder->trace)) return QM_E_NO_MEMORY;
    qm_patch_trace_run(&finder->trace);
    finder->owner = qm_context_alloc(finder->ctx, finder->mesh->face_count, sizeof *finder->owner);
    if (!finder->owner) return QM_E_NO_MEMORY;
    status = find_blocks(finder);
    if (status == QM_OK)
        status =
            qm_patch_merge(finder->ctx, &finder->links, finder->block, finder->block_count, finder->owner);
    if (status == QM_OK) status = find_blocks(finder);
    return status == QM_OK ? write_patches(finder, out) : status;
}

qm_status qm_patch_set_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out)
{
    *out = (qm_patch_set){0};
    if (mesh->face_count == 0) return QM_OK;
    if (qm_patch_grids_hold(mesh)) return qm_patch_set_from_grids(ctx, mesh, out);
    patch_finder finder = {.ctx = ctx, .mesh = mesh, .trace = {.ctx = ctx, .links = &finder.links}};
    qm_status status = find_patches(&finder, out);
    qm_patch_links_reset(ctx, &finder.links);
    qm_patch_trace_reset(&finder.trace);
    qm_context_free(ctx, finder.owner, mesh->face_count, sizeof *finder.owner);
    qm_context_free(ctx, finder.block, finder.block_capacity, sizeof *finder.block);
    if (status == QM_OK) return QM_OK;
    qm_patch_set_reset(ctx, out);
    return qm_context_fail(ctx, status, "%s while finding the patches", qm_status_text(status));
}

void qm_patch_set_reset(qm_context *ctx, qm_patch_set *set)
{
    qm_context_free(ctx, set->patches, set->patch_count, sizeof *set->patches);
    qm_context_free(ctx, set->faces, set->face_count, sizeof *set->faces);
    qm_context_free(ctx, set->turns, set->face_count, sizeof *set->turns);
    *set = (qm_patch_set){0};
}

uint32_t qm_patch_vertex(const qm_patch_set *set, const qm_mesh *mesh, size_t patch, uint32_t row,
                         uint32_t column)
{
    const qm_regular_patch *at = &set->patches[patch];
    uint32_t below = row == at->rows, right = column == at->columns;
    size_t place = at->first + (size_t)(row - below) * at->columns + (column - right);
    unsigned corner = qm_patch_corner(set->turns[place], below ? 3 - right : right);
    return mesh->faces[4 * (size_t)set->faces[place] + corner];
}

size_t qm_patch_set_memory_size(const qm_patch_set *set)
{
    return set->patch_count * sizeof *set->patches +
           set->face_count * (sizeof *set->faces + sizeof *set->turns);
}
