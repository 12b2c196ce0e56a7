/**
 * tetra.c: builds and refits a hierarchy of offset tetrahedra. Patches are sorted by the packs of their first faces,
 * which is their order along the space-filling curve; then nodes and lists of packs are laid out, and the
 * kernel computes radii.
 */
#include "qm/tetra.h"

#include <stdlib.h>
#include <string.h>

#include "core/bits.h"
#include "kernel.h"
#include "tetra_tree.h"

typedef struct tetra_builder {
    qm_context *ctx;
    qm_tetra *tetra;
    uint32_t *face_pack; /* by face: the pack of the tree that holds it */
    size_t node_capacity, pack_capacity;
} tetra_builder;

/** Counts the nodes of a part: parts of more quads than a leaf holds have two halves. */
static size_t count_nodes(const qm_tetra_part *part, size_t *leaf_faces)
{
    if (qm_tetra_part_is_leaf(part)) {
        *leaf_faces += (size_t)part->rows * part->columns;
        return 1;
    }
    qm_tetra_part half[2];
    qm_tetra_part_cut(part, half);
    return 1 + count_nodes(&half[0], leaf_faces) + count_nodes(&half[1], leaf_faces);
}

static int compare_words(const void *a, const void *b)
{
    uint64_t one = *(const uint64_t *)a, other = *(const uint64_t *)b;
    return one < other ? -1 : one > other;
}

static qm_status lay_out_patches(tetra_builder *builder)
{
    qm_tetra *tetra = builder->tetra;
    const qm_patch_set *set = &tetra->set;
    uint64_t *order = qm_context_alloc(builder->ctx, set->patch_count, sizeof *order);
    if (!order) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < set->patch_count; i++)
        order[i] = (uint64_t)builder->face_pack[set->faces[set->patches[i].first]] << 32 | i;
    qsort(order, set->patch_count, sizeof *order, compare_words);
    for (size_t i = 0; i < set->patch_count; i++) {
        uint32_t index = (uint32_t)order[i];
        const qm_regular_patch *patch = &set->patches[index];
        tetra->set_patch[i] = index;
        tetra->patches[i] =
            (qm_tetra_patch){patch->rows, patch->columns, (uint32_t)tetra->node_count, tetra->vertex_count};
        qm_tetra_part root = qm_tetra_part_root(&tetra->patches[i]);
        tetra->node_count += count_nodes(&root, &builder->pack_capacity);
        tetra->vertex_count += ((size_t)patch->rows + 1) * ((size_t)patch->columns + 1);
    }
    qm_context_free(builder->ctx, order, set->patch_count, sizeof *order);
    return QM_OK;
}

/** The vertex at a row and column of a patch; a triangle counts as a quad whose last two corners coincide. */
static uint32_t patch_vertex(const qm_tetra *tetra, uint32_t patch, uint32_t row, uint32_t column)
{
    const qm_mesh *mesh = &tetra->bvh->mesh;
    const uint32_t *face = mesh->faces + 4 * (size_t)tetra->set.faces[tetra->set.patches[patch].first];
    if (face[3] == QM_NO_INDEX) return face[row == 0 ? column : 2];
    return qm_patch_vertex(&tetra->set, mesh, patch, row, column);
}

/** Lays the nodes of a part out in preorder; returns the next free one. */
static uint32_t fill_nodes(tetra_builder *builder, size_t at, const qm_tetra_part *part)
{
    qm_tetra_node *node = &builder->tetra->nodes[part->node];
    if (qm_tetra_part_is_leaf(part)) {
        /* List each pack of the leaf's quads once. */
        qm_tetra *tetra = builder->tetra;
        const qm_regular_patch *patch = &tetra->set.patches[tetra->set_patch[at]];
        size_t first = tetra->pack_count;
        for (uint32_t r = part->row; r < part->row + part->rows; r++) {
            for (uint32_t c = part->column; c < part->column + part->columns; c++) {
                uint32_t pack =
                    builder->face_pack[tetra->set.faces[patch->first + (size_t)r * patch->columns + c]];
                size_t i = first;
                while (i < tetra->pack_count && tetra->packs[i] != pack)
                    i++;
                if (i == tetra->pack_count) tetra->packs[tetra->pack_count++] = pack;
            }
        }
        QM_ASSERT(tetra->pack_count - first < 1u << QM_TETRA_COUNT_BITS &&
                  tetra->pack_count <= tetra->pack_capacity);
        node->link = (uint32_t)(first << QM_TETRA_COUNT_BITS | (tetra->pack_count - first));
        return part->node + 1;
    }
    qm_tetra_part half[2];
    qm_tetra_part_cut(part, half);
    node->link = half[1].node = fill_nodes(builder, at, &half[0]);
    return fill_nodes(builder, at, &half[1]);
}

static qm_status fill_patches(tetra_builder *builder)
{
    qm_tetra *tetra = builder->tetra;
    const qm_kernel *kernel = qm_kernel_get();
    for (size_t i = 0; i < tetra->patch_count; i++) {
        if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
        const qm_tetra_patch *patch = &tetra->patches[i];
        uint32_t *corner = tetra->vertices + patch->vertices;
        for (uint32_t r = 0; r <= patch->rows; r++)
            for (uint32_t c = 0; c <= patch->columns; c++)
                *corner++ = patch_vertex(tetra, tetra->set_patch[i], r, c);
        const qm_regular_patch *regular = &tetra->set.patches[tetra->set_patch[i]];
        size_t end = regular->first + (size_t)regular->rows * regular->columns;
        for (size_t slot = regular->first; slot < end; slot++) {
            tetra->face_slot[tetra->set.faces[slot]] = (uint32_t)slot;
            tetra->face_patch[tetra->set.faces[slot]] = (uint32_t)i;
        }
        qm_tetra_part root = qm_tetra_part_root(&tetra->patches[i]);
        fill_nodes(builder, i, &root);
        kernel->tetra_fit(tetra, i, NULL);
    }
    qm_box_tree_fill(&tetra->boxes, 2);
    return QM_OK;
}

static qm_status build(tetra_builder *builder)
{
    qm_context *ctx = builder->ctx;
    qm_tetra *tetra = builder->tetra;
    tetra->patches = qm_context_alloc(ctx, tetra->patch_count, sizeof *tetra->patches);
    tetra->set_patch = qm_context_alloc(ctx, tetra->patch_count, sizeof *tetra->set_patch);
    tetra->face_slot = qm_context_alloc(ctx, tetra->set.face_count, sizeof *tetra->face_slot);
    tetra->face_patch = qm_context_alloc(ctx, tetra->set.face_count, sizeof *tetra->face_patch);
    if (!tetra->patches || !tetra->set_patch || !tetra->face_slot || !tetra->face_patch ||
        !builder->face_pack)
        return QM_E_NO_MEMORY;
    qm_status status = lay_out_patches(builder);
    if (status != QM_OK) return status;
    tetra->pack_capacity = builder->pack_capacity;
    tetra->nodes = qm_context_alloc(ctx, tetra->node_count, sizeof *tetra->nodes);
    tetra->vertices = qm_context_alloc(ctx, tetra->vertex_count, sizeof *tetra->vertices);
    tetra->packs = qm_context_alloc(ctx, tetra->pack_capacity, sizeof *tetra->packs);
    bool has_boxes = qm_box_tree_init(ctx, tetra->patch_count, &tetra->boxes);
    if (!tetra->nodes || !tetra->vertices || !tetra->packs || !has_boxes) return QM_E_NO_MEMORY;
    status = fill_patches(builder);
    if (status != QM_OK) return status;
    uint32_t *packs =
        qm_context_resize(ctx, tetra->packs, tetra->pack_capacity, tetra->pack_count, sizeof *packs);
    if (packs) {
        tetra->packs = packs;
        tetra->pack_capacity = tetra->pack_count;
    }
    return QM_OK;
}

qm_status qm_tetra_build(qm_context *ctx, const qm_bvh *bvh, const qm_patch_set *patches, qm_tetra **out)
{
    *out = NULL;
    size_t faces = bvh->mesh.face_count;
    if (!bvh->rows.items)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "offset tetrahedra need a tree that is a target");
    if (faces == 0)
        return qm_context_fail(ctx, QM_E_UNSUPPORTED, "a point set has no patches for offset tetrahedra");
    if (patches->face_count != faces)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the patches are those of another mesh");
    qm_tetra *tetra = qm_context_alloc(ctx, 1, sizeof *tetra);
    qm_status status = QM_E_NO_MEMORY;
    if (tetra) {
        *tetra =
            (qm_tetra){.bvh = bvh, .set = *patches, .frame = bvh->frame, .patch_count = patches->patch_count};
        uint32_t *face_pack = qm_context_alloc(ctx, bvh->mesh.face_count, sizeof *face_pack);
        for (size_t pack = 0; face_pack && pack < bvh->pack_count; pack++)
            for (int lane = 0; lane < bvh->lanes[pack].lane_count; lane++)
                face_pack[bvh->lanes[pack].face[lane]] = (uint32_t)pack;
        tetra_builder builder = {.ctx = ctx, .tetra = tetra, .face_pack = face_pack};
        status = build(&builder);
        qm_context_free(ctx, builder.face_pack, faces, sizeof *builder.face_pack);
    }
    if (status != QM_OK) {
        qm_tetra_destroy(ctx, tetra);
        return qm_context_fail(ctx, status, "%s while building offset tetrahedra", qm_status_text(status));
    }
    *out = tetra;
    return QM_OK;
}

void qm_tetra_destroy(qm_context *ctx, qm_tetra *tetra)
{
    if (!tetra) return;
    qm_box_tree_reset(ctx, &tetra->boxes);
    qm_context_free(ctx, tetra->patches, tetra->patch_count, sizeof *tetra->patches);
    qm_context_free(ctx, tetra->set_patch, tetra->patch_count, sizeof *tetra->set_patch);
    qm_context_free(ctx, tetra->face_slot, tetra->set.face_count, sizeof *tetra->face_slot);
    qm_context_free(ctx, tetra->face_patch, tetra->set.face_count, sizeof *tetra->face_patch);
    qm_context_free(ctx, tetra->nodes, tetra->node_count, sizeof *tetra->nodes);
    qm_context_free(ctx, tetra->vertices, tetra->vertex_count, sizeof *tetra->vertices);
    qm_context_free(ctx, tetra->packs, tetra->pack_capacity, sizeof *tetra->packs);
    qm_context_free(ctx, tetra, 1, sizeof *tetra);
}

const qm_bvh *qm_tetra_bvh(const qm_tetra *tetra)
{
    return tetra->bvh;
}

size_t qm_tetra_find_patch(const qm_tetra *tetra, uint32_t face)
{
    return tetra->set_patch[tetra->face_patch[face]];
}

size_t qm_tetra_memory_size(const qm_tetra *tetra)
{
    return sizeof *tetra + tetra->patch_count * (sizeof *tetra->patches + sizeof *tetra->set_patch) +
           tetra->node_count * sizeof *tetra->nodes + tetra->vertex_count * sizeof *tetra->vertices +
           tetra->set.face_count * (sizeof *tetra->face_slot + sizeof *tetra->face_patch) +
           tetra->pack_capacity * sizeof *tetra->packs + qm_box_tree_memory_size(&tetra->boxes);
}

/* ---- refitting ---- */

/** Marks the nodes on the paths from the roots of patches to the leaves of changed faces. */
typedef struct path_marker {
    const qm_tetra *tetra;
    uint64_t *nodes, *patches;
    uint32_t patch;     /* of the leaf below */
    qm_tetra_part leaf; /* the last leaf marked: neighbors often follow one another */
} path_marker;

static bool part_holds(const qm_tetra_part *part, uint32_t row, uint32_t column)
{
    return row - part->row < part->rows && column - part->column < part->columns;
}

static void mark_path(path_marker *marker, uint32_t face)
{
    const qm_tetra *tetra = marker->tetra;
    uint32_t patch = tetra->face_patch[face];
    const qm_regular_patch *regular = &tetra->set.patches[tetra->set_patch[patch]];
    size_t quad = tetra->face_slot[face] - regular->first;
    uint32_t row = (uint32_t)(quad / regular->columns), column = (uint32_t)(quad % regular->columns);
    if (marker->patch == patch && part_holds(&marker->leaf, row, column)) return;
    qm_tetra_part part = qm_tetra_part_root(&tetra->patches[patch]);
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

qm_status qm_tetra_refit(qm_context *ctx, qm_tetra *tetra, const uint32_t *faces, size_t face_count,
                         size_t *updated)
{
    *updated = 0;
    if (!faces || memcmp(&tetra->frame, &tetra->bvh->frame, sizeof tetra->frame) != 0) {
        const qm_kernel *kernel = qm_kernel_get();
        for (size_t i = 0; i < tetra->patch_count; i++)
            *updated += kernel->tetra_fit(tetra, i, NULL);
        qm_box_tree_fill(&tetra->boxes, 2);
        tetra->frame = tetra->bvh->frame;
        return QM_OK;
    }
    if (face_count == 0) return QM_OK;
    size_t list_size = face_count < tetra->patch_count ? face_count : tetra->patch_count;
    path_marker marker = {.tetra = tetra, .patch = QM_NO_INDEX};
    marker.nodes = qm_bits_create(ctx, tetra->node_count);
    marker.patches = qm_bits_create(ctx, tetra->patch_count);
    uint32_t *patches = qm_context_alloc(ctx, list_size, sizeof *patches);
    qm_status status = QM_OK;
    if (!marker.nodes || !marker.patches || !patches) {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory to refit offset tetrahedra");
    } else {
        for (size_t i = 0; i < face_count; i++)
            mark_path(&marker, faces[i]);
        size_t count = qm_bits_list(marker.patches, tetra->patch_count, patches);
        const qm_kernel *kernel = qm_kernel_get();
        for (size_t i = 0; i < count; i++)
            *updated += kernel->tetra_fit(tetra, patches[i], marker.nodes);
        qm_box_tree_refill(&tetra->boxes, patches, count);
    }
    qm_context_free(ctx, patches, list_size, sizeof *patches);
    qm_bits_free(ctx, marker.patches, tetra->patch_count);
    qm_bits_free(ctx, marker.nodes, tetra->node_count);
    return status;
}
