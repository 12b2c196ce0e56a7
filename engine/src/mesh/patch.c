/**
 * patch.c: the regular patches of a mesh: either the grids that it was made of, or from links and cuts. A
 * region between cuts is flat, with straight sides and right angles: by Gauss and Bonnet a rectangle, or a
 * ring, a Moebius strip, a torus or a Klein bottle, which have no corner. One cut across opens a ring or a
 * strip; two that cross open the others.
 */
#include "qm/patch.h"

#include <string.h>

#include "patch_work.h"

#define NO_OWNER UINT32_MAX

typedef struct patch_finder {
    qm_context *ctx;
    const qm_mesh *mesh;
    qm_patch_links links;
    qm_patch_trace trace;
    uint32_t *owner; /* block of each face */
    qm_patch_block *block;
    size_t block_count, block_capacity;
} patch_finder;

/** Calls visit for every cell of a block, row by row. */
static void visit_cells(const qm_patch_links *links, const qm_patch_block *block,
                        void (*visit)(void *user, size_t index, qm_patch_cell cell), void *user)
{
    qm_patch_cell row = block->first;
    for (size_t r = 0; r < block->rows; r++) {
        qm_patch_cell cell = row;
        for (size_t c = 0; c < block->columns; c++) {
            visit(user, r * block->columns + c, cell);
            if (c + 1 < block->columns) qm_patch_cell_next(links, &cell);
        }
        if (r + 1 < block->rows) qm_patch_cell_next_row(links, &row);
    }
}

static void own_cell(void *user, size_t index, qm_patch_cell cell)
{
    (void)index;
    patch_finder *finder = user;
    finder->owner[cell.face] = (uint32_t)(finder->block_count - 1);
}

/** Finds the blocks of all faces, in the order of their lowest face. */
static qm_status find_blocks(patch_finder *finder)
{
    finder->block_count = 0;
    for (size_t f = 0; f < finder->mesh->face_count; f++)
        finder->owner[f] = NO_OWNER;
    for (uint32_t f = 0; f < finder->mesh->face_count; f++) {
        if (finder->owner[f] != NO_OWNER) continue;
        if (qm_context_canceled(finder->ctx)) return QM_E_CANCELED;
        qm_patch_block block;
        qm_patch_cell cell = qm_patch_cell_make(f);
        unsigned ring;
        while (!qm_patch_block_find(&finder->links, cell, &block, &ring)) { /* cells form a ring: cut it */
            if ((ring & 1) && !qm_patch_trace_start_through(&finder->trace, (qm_patch_side){f, cell.u}))
                return QM_E_NO_MEMORY;
            if ((ring & 2) && !qm_patch_links_is_cut(&finder->links, (qm_patch_side){f, cell.v}) &&
                !qm_patch_trace_start_through(&finder->trace, (qm_patch_side){f, cell.v}))
                return QM_E_NO_MEMORY;
            qm_patch_trace_run(&finder->trace);
        }
        if (finder->block_count == finder->block_capacity) {
            size_t capacity = 2 * finder->block_capacity + 64;
            qm_patch_block *grown = qm_context_resize(finder->ctx, finder->block, finder->block_capacity,
                                                      capacity, sizeof *grown);
            if (!grown) return QM_E_NO_MEMORY;
            finder->block = grown;
            finder->block_capacity = capacity;
        }
        finder->block[finder->block_count++] = block;
        visit_cells(&finder->links, &block, own_cell, finder);
    }
    return QM_OK;
}

/** The arrays that write_cell fills. */
typedef struct patch_writer {
    uint32_t *faces;
    uint8_t *turns;
} patch_writer;

static void write_cell(void *user, size_t index, qm_patch_cell cell)
{
    const patch_writer *writer = user;
    writer->faces[index] = cell.face;
    writer->turns[index] = qm_patch_cell_turn(cell);
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
        const qm_patch_block *block = &finder->block[i];
        out->patches[i] = (qm_regular_patch){first, block->rows, block->columns};
        patch_writer writer = {out->faces + first, out->turns + first};
        visit_cells(&finder->links, block, write_cell, &writer);
        size_t count = (size_t)block->rows * block->columns;
        if (count > 1) out->quad_count += count;
        first += count;
    }
    QM_ASSERT(first == faces);
    return QM_OK;
}

/** Patches do not cross the marked sides: to the search they are boundaries. */
static void unlink_creases(qm_patch_links *links, const uint8_t *creases)
{
    for (size_t f = 0; f < links->face_count; f++)
        for (unsigned s = 0; s < 4; s++)
            if (creases[f] >> s & 1) {
                links->across[4 * f + s] = QM_PATCH_NO_LINK;
                links->cuts[f] |= (uint8_t)(1u << s);
            }
}

static qm_status find_patches(patch_finder *finder, const uint8_t *creases, bool join, qm_patch_set *out)
{
    qm_status status = qm_patch_links_find(finder->ctx, finder->mesh, &finder->links);
    if (status != QM_OK) return status;
    if (creases) unlink_creases(&finder->links, creases);
    if (!qm_patch_trace_start_irregular(&finder->trace)) return QM_E_NO_MEMORY;
    qm_patch_trace_run(&finder->trace);
    finder->owner = qm_context_alloc(finder->ctx, finder->mesh->face_count, sizeof *finder->owner);
    if (!finder->owner) return QM_E_NO_MEMORY;
    status = find_blocks(finder);
    if (status == QM_OK && join)
        status =
            qm_patch_merge(finder->ctx, &finder->links, finder->block, finder->block_count, finder->owner);
    if (status == QM_OK && join) status = find_blocks(finder);
    return status == QM_OK ? write_patches(finder, out) : status;
}

/* ---- a mesh with grids ---- */

static const uint32_t *face_at(const qm_mesh *mesh, size_t first, const qm_mesh_grid *grid, uint32_t row,
                               uint32_t column)
{
    return mesh->faces + 4 * (first + (size_t)row * grid->columns + column);
}

static bool has_four_corners(const uint32_t *face)
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++)
            if (face[i] == face[j]) return false;
    return face[3] != QM_NO_INDEX;
}

/** True when the grids of a mesh contain all of its faces, and neighbours in them share their corners. */
static bool grids_hold(const qm_mesh *mesh)
{
    size_t first = 0;
    for (size_t i = 0; i < mesh->grid_count; i++) {
        const qm_mesh_grid *grid = &mesh->grids[i];
        size_t remaining = mesh->face_count - first;
        if (grid->rows == 0 || grid->columns == 0 || grid->rows > remaining / grid->columns) return false;
        for (uint32_t row = 0; row < grid->rows; row++) {
            for (uint32_t column = 0; column < grid->columns; column++) {
                const uint32_t *face = face_at(mesh, first, grid, row, column);
                if (!has_four_corners(face)) return false;
                const uint32_t *before = column > 0 ? face_at(mesh, first, grid, row, column - 1) : NULL;
                if (before && (before[1] != face[0] || before[2] != face[3])) return false;
                const uint32_t *below = row > 0 ? face_at(mesh, first, grid, row - 1, column) : NULL;
                if (below && (below[3] != face[0] || below[2] != face[1])) return false;
            }
        }
        first += (size_t)grid->rows * grid->columns;
    }
    return mesh->grid_count > 0 && first == mesh->face_count;
}

/** Makes each grid a patch. QM_OK or QM_E_NO_MEMORY, with nothing to free. */
static qm_status take_grids(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out)
{
    *out = (qm_patch_set){.patch_count = mesh->grid_count, .face_count = mesh->face_count};
    out->patches = qm_context_alloc(ctx, out->patch_count, sizeof *out->patches);
    out->faces = qm_context_alloc(ctx, out->face_count, sizeof *out->faces);
    out->turns = qm_context_alloc(ctx, out->face_count, sizeof *out->turns);
    if (!out->patches || !out->faces || !out->turns) {
        qm_patch_set_reset(ctx, out);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
    }
    size_t first = 0;
    for (size_t i = 0; i < mesh->grid_count; i++) {
        const qm_mesh_grid *grid = &mesh->grids[i];
        size_t count = (size_t)grid->rows * grid->columns;
        out->patches[i] = (qm_regular_patch){first, grid->rows, grid->columns};
        if (count > 1) out->quad_count += count;
        first += count;
    }
    for (size_t face = 0; face < mesh->face_count; face++)
        out->faces[face] = (uint32_t)face;
    memset(out->turns, 0, out->face_count * sizeof *out->turns);
    return QM_OK;
}

/* ---- the public calls ---- */

static qm_status search(qm_context *ctx, const qm_mesh *mesh, const uint8_t *creases, bool join,
                        qm_patch_set *out)
{
    patch_finder finder = {.ctx = ctx, .mesh = mesh, .trace = {.ctx = ctx, .links = &finder.links}};
    qm_status status = find_patches(&finder, creases, join, out);
    qm_patch_links_reset(ctx, &finder.links);
    qm_patch_trace_reset(&finder.trace);
    qm_context_free(ctx, finder.owner, mesh->face_count, sizeof *finder.owner);
    qm_context_free(ctx, finder.block, finder.block_capacity, sizeof *finder.block);
    if (status == QM_OK) return QM_OK;
    qm_patch_set_reset(ctx, out);
    return qm_context_fail(ctx, status, "%s while finding the patches", qm_status_text(status));
}

qm_status qm_patch_set_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out)
{
    QM_ASSERT(ctx && mesh && out);
    *out = (qm_patch_set){0};
    if (mesh->face_count == 0) return QM_OK;
    return grids_hold(mesh) ? take_grids(ctx, mesh, out) : search(ctx, mesh, NULL, true, out);
}

qm_status qm_patch_set_trace(qm_context *ctx, const qm_mesh *mesh, const uint8_t *creases, qm_patch_set *out)
{
    QM_ASSERT(ctx && mesh && out);
    *out = (qm_patch_set){0};
    return mesh->face_count == 0 ? QM_OK : search(ctx, mesh, creases, false, out);
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
    QM_ASSERT(patch < set->patch_count && row <= set->patches[patch].rows &&
              column <= set->patches[patch].columns);
    const qm_regular_patch *at = &set->patches[patch];
    uint32_t below = row == at->rows, right = column == at->columns;
    size_t index = at->first + (size_t)(row - below) * at->columns + (column - right);
    unsigned corner = qm_patch_corner(set->turns[index], below ? 3 - right : right);
    return mesh->faces[4 * (size_t)set->faces[index] + corner];
}

size_t qm_patch_set_memory_size(const qm_patch_set *set)
{
    return set->patch_count * sizeof *set->patches +
           set->face_count * (sizeof *set->faces + sizeof *set->turns);
}
