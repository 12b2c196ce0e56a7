/**
 * bvh_build.c: second half of building a tree: faces in order to packs, and boxes from the packs up.
 */
#include <string.h>

#include "bits.h"
#include "bvh_order.h"
#include "bvh_pack.h"

#define PREFETCH 16   /* faces ahead of the one at hand whose corners are fetched: the order jumps about */
#define MIN_PACKS 512 /* packs that make it worth to start another thread */

/** Work on the packs, a range of them for each worker; a range starts at a multiple of eight. */
typedef struct pack_builder {
    qm_context *ctx;
    const qm_kernel *kernel;
    qm_bvh *bvh;
    const uint64_t *order;
    size_t count;
    uint32_t
        *first; /* place in the order of each pack's first face; NULL when all have QM_PACK_LANES faces */
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

static bool mesh_has_quads(const qm_mesh *mesh)
{
    for (size_t i = 0; i < mesh->face_count; i++)
        if (face_corners(mesh, (uint32_t)i) == 4) return true;
    return false;
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
    return pack * QM_PACK_LANES < builder->count ? pack * QM_PACK_LANES : builder->count;
}

/** The vertices of the pack at hand by their last bits: place + 1, 0 for none. */
typedef struct vertex_slots {
    uint8_t place[64];
} vertex_slots;

static uint8_t pack_vertex(qm_pack_lanes *lanes, vertex_slots *slots, uint32_t vertex)
{
    unsigned slot = vertex % 64;
    for (; slots->place[slot]; slot = (slot + 1) % 64)
        if (lanes->vertex[slots->place[slot] - 1] == vertex) return (uint8_t)(slots->place[slot] - 1);
    lanes->vertex[lanes->vertex_count] = vertex;
    slots->place[slot] = ++lanes->vertex_count;
    return (uint8_t)(lanes->vertex_count - 1);
}

/** A quad takes two lanes, which share its first and third corner. */
static void add_face(const qm_mesh *mesh, qm_pack_lanes *lanes, vertex_slots *slots, uint32_t face)
{
    uint8_t place[4];
    int corners = face_corners(mesh, face);
    for (int i = 0; i < corners; i++)
        place[i] = pack_vertex(lanes, slots, mesh->faces[4 * (size_t)face + (size_t)i]);
    for (int half = 0; half < corners - 2; half++) {
        int lane = lanes->lane_count++;
        lanes->face[lane] = face;
        lanes->corner[lane][0] = place[0];
        lanes->corner[lane][1] = place[1 + half];
        lanes->corner[lane][2] = place[2 + half];
        if (half == 1) lanes->second |= (uint8_t)(1u << lane);
    }
}

/** A point of a point set: a triangle of no size. */
static void add_point(qm_pack_lanes *lanes, uint32_t point)
{
    int lane = lanes->lane_count++;
    lanes->face[lane] = lanes->vertex[lane] = point;
    lanes->vertex_count = lanes->lane_count;
    for (int i = 0; i < 3; i++)
        lanes->corner[lane][i] = (uint8_t)lane;
}

static void fill_lanes(const pack_builder *builder, size_t pack)
{
    const qm_mesh *mesh = &builder->bvh->mesh;
    qm_pack_lanes *lanes = &builder->bvh->lanes[pack];
    lanes->lane_count = lanes->vertex_count = lanes->second = 0;
    vertex_slots slots = {{0}};
    size_t end = pack_first(builder, pack + 1);
    for (size_t i = pack_first(builder, pack); i < end; i++) {
        if (mesh->face_count == 0) {
            add_point(lanes, order_face(builder->order[i]));
            continue;
        }
        if (i + PREFETCH < builder->count)
            __builtin_prefetch(mesh->faces + 4 * (size_t)order_face(builder->order[i + PREFETCH]));
        add_face(mesh, lanes, &slots, order_face(builder->order[i]));
    }
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        lanes->face[lane] = lanes->face[0];
}

static void build_pack(const pack_builder *builder, size_t pack)
{
    qm_bvh *bvh = builder->bvh;
    fill_lanes(builder, pack);
    qm_vec vertex[3 * QM_PACK_LANES];
    qm_box box = qm_vec_box(vertex, qm_bvh_load_pack(bvh, pack, vertex));
    qm_box_tree_set(&bvh->boxes, pack, &box);
    qm_bvh_fill_pack(builder->kernel, bvh, pack, vertex);
}

static void build_own_packs(void *data, int worker)
{
    const pack_builder *builder = data;
    size_t groups = (builder->bvh->pack_count + 7) / 8, workers = (size_t)builder->workers;
    size_t begin = 8 * (groups * (size_t)worker / workers),
           end = 8 * (groups * ((size_t)worker + 1) / workers);
    for (size_t i = begin; i < end && i < builder->bvh->pack_count; i++) {
        if (i % 4096 == 0 && qm_context_canceled(builder->ctx)) return;
        build_pack(builder, i);
    }
}

static qm_status allocate_tree(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, bool has_quads)
{
    size_t count = bvh->pack_count;
    bvh->lanes = qm_context_alloc(ctx, count, sizeof *bvh->lanes);
    if (!bvh->lanes) return QM_E_NO_MEMORY;
    if ((parts & QM_BVH_TARGET) && !(bvh->packs = qm_context_alloc_aligned(ctx, count, sizeof *bvh->packs)))
        return QM_E_NO_MEMORY;
    if ((parts & QM_BVH_PATCHES) && has_quads &&
        !(bvh->twist = qm_context_alloc(ctx, count, sizeof *bvh->twist)))
        return QM_E_NO_MEMORY;
    return qm_box_tree_init(ctx, count, &bvh->boxes) ? QM_OK : QM_E_NO_MEMORY;
}

static qm_status build_tree(pack_builder *builder, qm_bvh_parts parts, bool has_quads)
{
    qm_bvh *bvh = builder->bvh;
    qm_status status = allocate_tree(builder->ctx, bvh, parts, has_quads);
    if (status != QM_OK) return status;
    while (builder->workers > 1 && bvh->pack_count / (size_t)builder->workers < MIN_PACKS)
        builder->workers--;
    qm_context_parallel(builder->ctx, builder->workers, build_own_packs, builder);
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    qm_box_tree_fill(&bvh->boxes);
    bvh->reach = qm_box_tree_reach(&bvh->boxes);
    return QM_OK;
}

static qm_status build_from_order(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, int thread_count,
                                  const uint64_t *order)
{
    pack_builder builder = {.ctx = ctx,
                            .kernel = qm_kernel_get(),
                            .bvh = bvh,
                            .order = order,
                            .count = qm_mesh_facet_count(&bvh->mesh),
                            .workers = thread_count};
    bool has_quads = mesh_has_quads(&bvh->mesh);
    bvh->has_quads = has_quads;
    bvh->pack_count = (builder.count + QM_PACK_LANES - 1) / QM_PACK_LANES;
    if (has_quads) {
        builder.first = qm_context_alloc(ctx, builder.count + 1, sizeof *builder.first);
        if (!builder.first) return QM_E_NO_MEMORY;
        bvh->pack_count = set_first(&bvh->mesh, order, builder.count, builder.first);
    }
    qm_status status = build_tree(&builder, parts, has_quads);
    qm_context_free(ctx, builder.first, builder.count + 1, sizeof *builder.first);
    return status;
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
    if (bvh && order) {
        status = qm_bvh_order(ctx, mesh, thread_count, &bvh->frame, order);
        if (status == QM_OK) status = build_from_order(ctx, bvh, parts, thread_count, order);
    }
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
    qm_box_tree_reset(ctx, &bvh->boxes);
    qm_bits_free(ctx, bvh->stale, bvh->pack_count);
    qm_context_free(ctx, bvh->twist, bvh->pack_count, sizeof *bvh->twist);
    qm_context_free_aligned(ctx, bvh->packs, bvh->pack_count, sizeof *bvh->packs);
    qm_context_free(ctx, bvh->lanes, bvh->pack_count, sizeof *bvh->lanes);
    qm_context_free(ctx, bvh, 1, sizeof *bvh);
}

const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh)
{
    return &bvh->mesh;
}

size_t qm_bvh_memory_size(const qm_bvh *bvh)
{
    size_t size = sizeof *bvh + bvh->pack_count * sizeof *bvh->lanes;
    if (bvh->packs) size += bvh->pack_count * sizeof *bvh->packs;
    if (bvh->twist) size += bvh->pack_count * sizeof *bvh->twist;
    return size + qm_box_tree_memory_size(&bvh->boxes);
}
