/**
 * tetra_refit.c: radii of a hierarchy whose vertices have moved: all of them, or those on the ways from the
 * faces that changed up to their patches.
 */
#include "core/bits.h"
#include "kernel.h"
#include "qm/deform.h"
#include "tetra_tree.h"

typedef struct way_marker {
    const qm_tetra *tetra;
    uint64_t *nodes, *patches;
    uint32_t patch;     /* of the leaf below */
    qm_tetra_part leaf; /* marked last: neighbours follow one another */
} way_marker;

static bool part_holds(const qm_tetra_part *part, uint32_t row, uint32_t column)
{
    return row - part->row < part->rows && column - part->column < part->columns;
}

static void mark_way(way_marker *marker, uint32_t face)
{
    const qm_tetra *tetra = marker->tetra;
    uint32_t patch = tetra->face_patch[face];
    const qm_regular_patch *regular = &tetra->set.patches[tetra->set_patch[patch]];
    size_t cell = tetra->face_place[face] - regular->first;
    uint32_t row = (uint32_t)(cell / regular->columns), column = (uint32_t)(cell % regular->columns);
    if (marker->patch == patch && part_holds(&marker->leaf, row, column)) return;
    qm_tetra_part part = qm_tetra_part_whole(&tetra->patches[patch]);
    qm_bits_add(marker->patches, patch);
    qm_bits_add(marker->nodes, part.node);
    while (!qm_tetra_part_is_leaf(&part)) {
        qm_tetra_part half[2];
        qm_tetra_part_cut(&part, half);
        half[1].node = tetra->nodes[part.node].link;
        part = half[part_holds(&half[1], row, column)];
        qm_bits_add(marker->nodes, part.node);
    }
    marker->patch = patch;
    marker->leaf = part;
}

static size_t refit_all(qm_tetra *tetra)
{
    const qm_kernel *kernel = qm_kernel_get();
    size_t updated = 0;
    for (size_t i = 0; i < tetra->patch_count; i++)
        updated += kernel->tetra_fit(tetra, i, NULL);
    qm_box_tree_fill(&tetra->boxes, 2);
    tetra->frame = tetra->bvh->frame;
    return updated;
}

static size_t refit_ways(qm_tetra *tetra, const uint64_t *nodes, uint32_t *patches, size_t patch_count)
{
    const qm_kernel *kernel = qm_kernel_get();
    size_t updated = 0;
    for (size_t i = 0; i < patch_count; i++)
        updated += kernel->tetra_fit(tetra, patches[i], nodes);
    qm_box_tree_refill(&tetra->boxes, patches, patch_count);
    return updated;
}

qm_status qm_tetra_refit(qm_context *ctx, qm_tetra *tetra, const uint32_t *faces, size_t face_count,
                         size_t *updated)
{
    *updated = 0;
    if (!faces || memcmp(&tetra->frame, &tetra->bvh->frame, sizeof tetra->frame) != 0) {
        *updated = refit_all(tetra);
        return QM_OK;
    }
    if (face_count == 0) return QM_OK;
    size_t list_size = face_count < tetra->patch_count ? face_count : tetra->patch_count;
    way_marker marker = {.tetra = tetra, .patch = QM_NO_INDEX};
    marker.nodes = qm_bits_create(ctx, tetra->node_count);
    marker.patches = qm_bits_create(ctx, tetra->patch_count);
    uint32_t *patches = qm_context_alloc(ctx, list_size, sizeof *patches);
    qm_status status = QM_OK;
    if (!marker.nodes || !marker.patches || !patches) {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory to refit offset tetrahedra");
    } else {
        for (size_t i = 0; i < face_count; i++)
            mark_way(&marker, faces[i]);
        size_t count = qm_bits_list(marker.patches, tetra->patch_count, patches);
        *updated = refit_ways(tetra, marker.nodes, patches, count);
    }
    qm_context_free(ctx, patches, list_size, sizeof *patches);
    qm_bits_free(ctx, marker.patches, tetra->patch_count);
    qm_bits_free(ctx, marker.nodes, tetra->node_count);
    return status;
}
