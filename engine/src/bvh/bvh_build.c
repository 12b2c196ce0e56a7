/**
 * bvh_build.c: second half of building a tree: faces in order to packs, and boxes from the packs up.
 */
#include <math.h>
#include <string.h>

#include "bvh_demand.h"
#include "bvh_order.h"
#include "kernel.h"

#define PREFETCH 16     /* faces ahead of the one at hand whose corners are fetched: the order jumps about */
#define FETCHED_PACKS 8 /* packs whose vertices are fetched while others are looked at */
#define ROWS_KEPT 16384 /* packs of which there is room for all triangles in double precision, and */
#define ROWS_SHARE 16   /* for one in so many of those beyond */
/* Packs of the largest tree whose triangles in single precision are made at once */
#define FLOATS_AT_ONCE 65536
#define BLOCK_PACKS 64 /* packs that a worker takes at once: a multiple of 64, a box of the third level */

/** Work on the packs, which the workers share by blocks. */
typedef struct pack_builder {
    qm_context *ctx;
    const qm_kernel *kernel;
    qm_bvh *bvh;
    const uint64_t *order;
    size_t count;
    size_t stride;   /* faces of every pack but the last; 0 when faces of both kinds are mixed, and then */
    uint32_t *first; /* the place in the order of each pack's first face */
    int workers;
} pack_builder;

static uint32_t order_face(uint64_t entry)
{
    return (uint32_t)(entry & QM_RADIX_INDEX_MASK);
}

static int face_corners(const qm_mesh *mesh, uint32_t face)
{
    return mesh->faces[4 * (size_t)face + 3] == QM_NO_INDEX ? 3 : 4;
}

/** Fills packs in order; one with a single lane left closes before a quad. Returns how many there are. */
static size_t set_first(const qm_mesh *mesh, const uint64_t *order, size_t count, uint32_t *first)
{
    size_t packs = 0;
    int used = QM_PACK_LANES;
    for (size_t i = 0; i < count; i++) {
        int lanes = face_corners(mesh, order_face(order[i])) - 2;
        if (used + lanes > QM_PACK_LANES) {
            first[packs++] = (uint32_t)i;
            used = 0;
        }
        used += lanes;
    }
    first[packs] = (uint32_t)count;
    return packs;
}

static size_t pack_first(const pack_builder *builder, size_t pack)
{
    if (builder->first) return builder->first[pack];
    return pack * builder->stride < builder->count ? pack * builder->stride : builder->count;
}

/** A quad takes two lanes, which share its first and third corner. Returns how many lanes there are now. */
static int add_face(const qm_mesh *mesh, qm_pack_lanes *lanes, int lane, uint32_t *vertex, uint32_t face)
{
    const uint32_t *corner = mesh->faces + 4 * (size_t)face;
    memcpy(vertex + 3 * lane, corner, 3 * sizeof *corner);
    lanes->face[lane++] = face;
    if (corner[3] == QM_NO_INDEX) return lane;
    const uint32_t second[3] = {corner[0], corner[2], corner[3]};
    memcpy(vertex + 3 * lane, second, sizeof second);
    lanes->face[lane] = face;
    lanes->second |= (uint8_t)(1u << lane);
    return lane + 1;
}

/** A point of a point set: a triangle of no size. */
static int add_point(qm_pack_lanes *lanes, int lane, uint32_t *vertex, uint32_t point)
{
    lanes->face[lane] = point;
    for (int i = 0; i < 3; i++)
        vertex[3 * lane + i] = point;
    return lane + 1;
}

/** Fills the lanes of a pack, and fetches its vertices. */
static void fill_lanes(const pack_builder *builder, size_t pack)
{
    const qm_mesh *mesh = &builder->bvh->mesh;
    qm_pack_lanes *lanes = &builder->bvh->lanes[pack];
    uint32_t vertex[3 * QM_PACK_LANES];
    int lane = 0;
    lanes->second = 0;
    size_t end = pack_first(builder, pack + 1);
    for (size_t i = pack_first(builder, pack); i < end; i++) {
        if (i + PREFETCH < builder->count && mesh->face_count > 0)
            __builtin_prefetch(mesh->faces + 4 * (size_t)order_face(builder->order[i + PREFETCH]));
        uint32_t facet = order_face(builder->order[i]);
        lane = mesh->face_count > 0 ? add_face(mesh, lanes, lane, vertex, facet)
                                    : add_point(lanes, lane, vertex, facet);
    }
    lanes->lane_count = (uint8_t)lane;
    for (; lane < QM_PACK_LANES; lane++) {
        lanes->face[lane] = lanes->face[0];
        memcpy(vertex + 3 * lane, vertex, 3 * sizeof *vertex);
    }
    builder->kernel->share_corners(lanes, vertex);
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = mesh->positions + 3 * (size_t)lanes->vertex[i];
        __builtin_prefetch(position); /* it may span two cache lines */
        __builtin_prefetch(position + 2);
    }
}

/** The box of a pack; and of a small tree, of which searches ask for most, its triangles in single precision
 * while its vertices are at hand. */
static void finish_pack(const pack_builder *builder, size_t pack)
{
    qm_bvh *bvh = builder->bvh;
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    if (bvh->floats.items && bvh->pack_count <= FLOATS_AT_ONCE) {
        qm_pack_corners corners;
        builder->kernel->fit_corners(bvh, pack, &corners);
        qm_bvh_put_floats(bvh, pack, &corners);
    } else {
        builder->kernel->fit_box(bvh, pack, lanes->vertex, lanes->vertex_count);
    }
}

/** Packs of a block, and the boxes above its groups. */
static void build_block(void *data, int worker, size_t block)
{
    (void)worker;
    const pack_builder *builder = data;
    qm_bvh *bvh = builder->bvh;
    if (qm_context_canceled(builder->ctx)) return;
    size_t begin = block * BLOCK_PACKS,
           end = begin + BLOCK_PACKS < bvh->pack_count ? begin + BLOCK_PACKS : bvh->pack_count;
    for (size_t i = begin; i < end + FETCHED_PACKS; i++) {
        if (i < end) fill_lanes(builder, i);
        if (i >= begin + FETCHED_PACKS) finish_pack(builder, i - FETCHED_PACKS);
    }
    if (bvh->boxes.level_count > 1) qm_box_tree_fill_children(&bvh->boxes, 2, begin / 8, (end + 7) / 8);
}

/** Triangles in double precision take more memory than all else: of a large mesh a part is kept. */
static size_t rows_room(size_t packs)
{
    return packs <= ROWS_KEPT ? packs : ROWS_KEPT + (packs - ROWS_KEPT) / ROWS_SHARE;
}

static qm_status allocate_tree(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts)
{
    size_t count = bvh->pack_count;
    bool is_target = parts & QM_BVH_TARGET, has_twists = parts & QM_BVH_PATCHES && bvh->has_quads;
    bvh->lanes = qm_context_alloc(ctx, count, sizeof *bvh->lanes);
    bool has_room =
        bvh->lanes && (!is_target || qm_demand_init(ctx, count, 0, sizeof(qm_float_pack), &bvh->floats)) &&
        (!is_target || qm_demand_init(ctx, count, rows_room(count), sizeof(qm_pack), &bvh->rows)) &&
        (!has_twists || qm_demand_init(ctx, count, 0, sizeof(qm_pack_twists), &bvh->twists)) &&
        qm_box_tree_init(ctx, count, &bvh->boxes);
    return has_room ? QM_OK : QM_E_NO_MEMORY;
}

static qm_status build_tree(pack_builder *builder, qm_bvh_parts parts)
{
    qm_bvh *bvh = builder->bvh;
    qm_status status = allocate_tree(builder->ctx, bvh, parts);
    if (status != QM_OK) return status;
    size_t blocks = (bvh->pack_count + BLOCK_PACKS - 1) / BLOCK_PACKS;
    qm_context_share(builder->ctx, builder->workers, blocks, build_block, builder);
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    bvh->has_all_floats = bvh->floats.items && bvh->pack_count <= FLOATS_AT_ONCE;
    qm_box_tree_fill(&bvh->boxes, 3);
    bvh->reach = qm_box_tree_reach(&bvh->boxes);
    return QM_OK;
}

qm_status qm_bvh_build_ordered(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, int thread_count,
                               const qm_bvh_faces *faces)
{
    pack_builder builder = {.ctx = ctx,
                            .kernel = qm_kernel_get(),
                            .bvh = bvh,
                            .order = faces->order,
                            .count = faces->count,
                            .workers = thread_count};
    bvh->has_quads = faces->quad_count > 0;
    if (faces->quad_count == 0 || faces->quad_count == faces->count) {
        builder.stride = bvh->has_quads ? QM_PACK_LANES / 2 : QM_PACK_LANES;
        bvh->pack_count = (builder.count + builder.stride - 1) / builder.stride;
    } else {
        builder.first = qm_context_alloc(ctx, builder.count + 1, sizeof *builder.first);
        if (!builder.first) return QM_E_NO_MEMORY;
        bvh->pack_count = set_first(&bvh->mesh, faces->order, builder.count, builder.first);
    }
    qm_status status = build_tree(&builder, parts);
    qm_context_free(ctx, builder.first, builder.count + 1, sizeof *builder.first);
    return status;
}

bool qm_bvh_frame_is_wide(const qm_bvh *bvh)
{
    qm_box box = qm_box_tree_whole(&bvh->boxes);
    double half = 0.0;
    for (int k = 0; k < 3; k++)
        half = fmax(half, 0.5 * (box.max[k] - box.min[k]));
    return half < 0.25;
}

void qm_bvh_reset(qm_context *ctx, qm_bvh *bvh)
{
    qm_box_tree_reset(ctx, &bvh->boxes);
    qm_demand_reset(ctx, &bvh->twists);
    qm_demand_reset(ctx, &bvh->rows);
    qm_demand_reset(ctx, &bvh->floats);
    qm_context_free(ctx, bvh->lanes, bvh->pack_count, sizeof *bvh->lanes);
    *bvh = (qm_bvh){.mesh = bvh->mesh};
}

static qm_status build(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, qm_frame_of of, int thread_count,
                       uint64_t *order)
{
    qm_bvh_faces faces = {.order = order, .count = qm_mesh_facet_count(&bvh->mesh)};
    qm_status status = qm_bvh_order(ctx, &bvh->mesh, parts, of, thread_count, &bvh->frame, &faces);
    if (status == QM_OK) status = qm_bvh_build_ordered(ctx, bvh, parts, thread_count, &faces);
    if (status != QM_OK || of == QM_FRAME_OF_SURFACE || !qm_bvh_frame_is_wide(bvh)) return status;
    qm_bvh_reset(ctx, bvh);
    return build(ctx, bvh, parts, QM_FRAME_OF_SURFACE, thread_count, order);
}

qm_status qm_bvh_build(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, int thread_count,
                       qm_bvh **out)
{
    *out = NULL;
    size_t count = qm_mesh_facet_count(mesh);
    if (count == 0) return qm_context_fail(ctx, QM_E_EMPTY, "the mesh has no face and no vertex");
    if (count > QM_RADIX_INDEX_MASK)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "a tree holds at most %llu faces",
                               (unsigned long long)QM_RADIX_INDEX_MASK);
    if (thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "thread count must be 1 or more, got %d", thread_count);
    qm_bvh *bvh = qm_context_alloc(ctx, 1, sizeof *bvh);
    uint64_t *order = qm_context_alloc(ctx, count, sizeof *order);
    qm_status status = QM_E_NO_MEMORY;
    if (bvh) *bvh = (qm_bvh){.mesh = *mesh};
    if (bvh && order) status = build(ctx, bvh, parts, QM_FRAME_OF_VERTICES, thread_count, order);
    qm_context_free(ctx, order, count, sizeof *order);
    if (status != QM_OK) {
        qm_bvh_destroy(ctx, bvh);
        return qm_context_fail(ctx, status, "%s while building the tree", qm_status_text(status));
    }
    *out = bvh;
    return QM_OK;
}

void qm_bvh_destroy(qm_context *ctx, qm_bvh *bvh)
{
    if (!bvh) return;
    qm_bvh_reset(ctx, bvh);
    qm_context_free(ctx, bvh, 1, sizeof *bvh);
}

const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh)
{
    return &bvh->mesh;
}

size_t qm_bvh_memory_size(const qm_bvh *bvh)
{
    return sizeof *bvh + bvh->pack_count * sizeof *bvh->lanes + qm_demand_memory_size(&bvh->floats) +
           qm_demand_memory_size(&bvh->rows) + qm_demand_memory_size(&bvh->twists) +
           qm_box_tree_memory_size(&bvh->boxes);
}
