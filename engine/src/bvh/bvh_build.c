/**
 * bvh_build.c: building a tree: the local space of the mesh and the order of its faces along a Hilbert curve,
 * packs of faces in that order, and boxes from the packs up.
 *
 * Vertices far away that no face uses would make the local space too large. Looking for them takes a pass
 * over the faces, so the build assumes that there are none, and starts again with the used vertices alone
 * when the boxes turn out much smaller than the local space.
 */
#include "bvh_build.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "bvh_demand.h"
#include "core/radix.h"
#include "kernel.h"

/* ---- the order of the faces ---- */

#define MAX_BLOCKS 64         /* of vertices or faces, which the workers share */
#define MIN_BLOCK_SIZE 1024   /* vertices or faces in a block */
#define MAX_FACES_6_BITS 256  /* two passes of sorting instead of three */
#define MAX_FACES_8_BITS 8192 /* a surface meets about this many cells of an 8-bit curve, over eight */
#define MAX_FACES_10_BITS (16 * MAX_FACES_8_BITS)
#define SOURCE_RATIO                                                                                         \
    64 /* a source, whose packs are not searched, gets the cells of a mesh this many times smaller */

#define INVERSE_OF_ONE (1u << 24) /* 1 as a fixed-point inverse */

/** Which vertices define the local space: all, or only those used by faces. */
typedef enum frame_of { FRAME_OF_VERTICES, FRAME_OF_SURFACE } frame_of;

/** The faces that a tree is over: the index of each in the low QM_RADIX_INDEX_BITS of its entry. */
typedef struct face_order {
    uint64_t *entries;
    size_t count, quad_count;
} face_order;

typedef struct order_work {
    const qm_mesh *mesh;
    qm_frame frame;
    bool marks_used;
    uint64_t *vertices; /* with marks_used first a mark for each that a face uses; then fine coordinates */
    int key_bits;       /* per axis */
    double stretch;     /* of the local space, up to twice as large as the mesh, to the cells */
    atomic_size_t quad_count;
    qm_box box[MAX_BLOCKS];
} order_work;

static size_t count_blocks(size_t count)
{
    size_t blocks = count / MIN_BLOCK_SIZE;
    return blocks < 1 ? 1 : blocks < MAX_BLOCKS ? blocks : MAX_BLOCKS;
}

static void block_range(size_t count, size_t block, size_t *begin, size_t *end)
{
    size_t blocks = count_blocks(count);
    *begin = count * block / blocks;
    *end = count * (block + 1) / blocks;
}

/** Marks the vertices that the faces of a block use; several threads may mark one vertex. */
static void mark_used(void *data, int worker, size_t block)
{
    (void)worker;
    const order_work *work = data;
    size_t begin, end;
    block_range(work->mesh->face_count, block, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        const uint32_t *corner = work->mesh->faces + 4 * i;
        for (int k = 0; k < 4; k++)
            if (corner[k] != QM_NO_INDEX) __atomic_store_n(&work->vertices[corner[k]], 1, __ATOMIC_RELAXED);
    }
}

/** Box of the marked vertices. */
static qm_box box_of_used(const order_work *work, size_t begin, size_t end)
{
    qm_box box = {{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    for (size_t i = begin; i < end; i++) {
        if (!work->vertices[i]) continue;
        const double *p = work->mesh->positions + 3 * i;
        for (int k = 0; k < 3; k++) {
            box.min[k] = p[k] < box.min[k] ? p[k] : box.min[k];
            box.max[k] = p[k] > box.max[k] ? p[k] : box.max[k];
        }
    }
    return box;
}

static void find_box(void *data, int worker, size_t block)
{
    (void)worker;
    order_work *work = data;
    size_t begin, end;
    block_range(work->mesh->vertex_count, block, &begin, &end);
    if (work->marks_used)
        work->box[block] = box_of_used(work, begin, end);
    else
        qm_kernel_get()->vertex_box(work->mesh->positions + 3 * begin, end - begin, &work->box[block]);
}

qm_frame qm_bvh_frame_make(const qm_box *box)
{
    qm_frame frame;
    double half = 0.0, center[3];
    for (int k = 0; k < 3; k++) {
        center[k] = 0.5 * box->min[k] + 0.5 * box->max[k];
        half = fmax(half, fmax(box->max[k] - center[k], center[k] - box->min[k]));
    }
    /* A single point has no size: its position sets the scale. */
    if (half == 0.0) half = fmax(fabs(center[0]), fmax(fabs(center[1]), fabs(center[2])));
    int exponent = 0;
    if (half > 0.0) frexp(half, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent > 1023 ? 1023 : exponent; /* both scales are finite */
    frame.origin = qm_vec_load(center);
    frame.scale = ldexp(1.0, -exponent);
    frame.inverse_scale = ldexp(1.0, exponent);
    return frame;
}

/** Quantizes the vertices of a block. */
static void set_fine(void *data, int worker, size_t block)
{
    (void)worker;
    const order_work *work = data;
    size_t begin, end;
    block_range(work->mesh->vertex_count, block, &begin, &end);
    double origin[3];
    qm_vec_store(origin, work->frame.origin);
    qm_kernel_get()->vertex_fine(origin, work->frame.scale * work->stretch, work->mesh->positions + 3 * begin,
                                 end - begin, work->vertices + begin);
}

/** Sum of the corners of a face; *inverse becomes INVERSE_OF_ONE over their number. */
static inline uint64_t face_sum(const order_work *work, size_t face, uint32_t *inverse)
{
    const uint64_t *vertices = work->vertices;
    *inverse = INVERSE_OF_ONE;
    if (work->mesh->face_count == 0) return vertices[face];
    const uint32_t *corner = work->mesh->faces + 4 * face;
    bool is_quad = corner[3] != QM_NO_INDEX;
    *inverse = is_quad ? INVERSE_OF_ONE / 4 : INVERSE_OF_ONE / 3;
    uint64_t sum = vertices[corner[0]] + vertices[corner[1]] + vertices[corner[2]];
    return is_quad ? sum + vertices[corner[3]] : sum;
}

static void make_entries(void *data, size_t begin, size_t end, uint64_t *entries)
{
    order_work *work = data;
    const qm_kernel *kernel = qm_kernel_get();
    qm_hilbert_cells cells;
    uint64_t keys[QM_HILBERT_BATCH];
    size_t quads = 0;
    for (size_t first = begin; first < end; first += QM_HILBERT_BATCH) {
        int count = end - first < QM_HILBERT_BATCH ? (int)(end - first) : QM_HILBERT_BATCH;
        int shift = 24 + QM_FINE_BITS - work->key_bits;
        for (int i = 0; i < count; i++) {
            uint32_t inverse;
            uint64_t sum = face_sum(work, first + (size_t)i, &inverse);
            quads += inverse == INVERSE_OF_ONE / 4;
            for (int k = 0; k < 3; k++) {
                uint64_t fine = sum >> (k * QM_FINE_FIELD) & ((1u << QM_FINE_FIELD) - 1);
                cells.axis[k][i] = (uint32_t)(fine * inverse >> shift);
            }
        }
        kernel->hilbert_keys(&cells, count, work->key_bits, keys);
        for (int i = 0; i < count; i++)
            *entries++ = qm_radix_entry(keys[i], first + (size_t)i);
    }
    atomic_fetch_add_explicit(&work->quad_count, quads, memory_order_relaxed);
}

/** Bits per axis of a curve whose cells hold a few faces of the surface each. */
static int choose_key_bits(size_t faces, qm_bvh_parts parts)
{
    if (!(parts & QM_BVH_TARGET)) faces /= SOURCE_RATIO;
    return faces <= MAX_FACES_6_BITS    ? 6
           : faces <= MAX_FACES_8_BITS  ? 8
           : faces <= MAX_FACES_10_BITS ? 10
                                        : QM_HILBERT_BITS;
}

/**
 * Finds the local space, and sorts the faces by their centroids along a Hilbert curve: order->entries has
 * room for the order->count faces of the mesh. The cells of the curve are smaller for a tree that is to be a
 * target.
 *
 * Returns QM_OK or QM_E_NO_MEMORY.
 */
static qm_status order_faces(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, frame_of of,
                             int thread_count, qm_frame *frame, face_order *order)
{
    order_work work = {.mesh = mesh,
                       .marks_used = of == FRAME_OF_SURFACE && mesh->face_count > 0,
                       .key_bits = choose_key_bits(order->count, parts)};
    size_t blocks = count_blocks(mesh->vertex_count);
    size_t room = mesh->vertex_count > order->count ? mesh->vertex_count : order->count;
    work.vertices = qm_context_alloc(ctx, room, sizeof *work.vertices);
    if (!work.vertices) return QM_E_NO_MEMORY;
    if (work.marks_used) {
        memset(work.vertices, 0, mesh->vertex_count * sizeof *work.vertices);
        qm_context_parallel_for(ctx, thread_count, count_blocks(mesh->face_count), mark_used, &work);
    }

    qm_context_parallel_for(ctx, thread_count, blocks, find_box, &work);
    qm_box box = work.box[0];
    for (size_t i = 1; i < blocks; i++) {
        for (int k = 0; k < 3; k++) {
            box.min[k] = fmin(box.min[k], work.box[i].min[k]);
            box.max[k] = fmax(box.max[k], work.box[i].max[k]);
        }
    }
    *frame = work.frame = qm_bvh_frame_make(&box);
    double half = 0.0;
    for (int k = 0; k < 3; k++)
        half = fmax(half, (0.5 * box.max[k] - 0.5 * box.min[k]) * frame->scale);
    work.stretch = half >= 0.25 ? 1.0 / half : 1.0;

    qm_context_parallel_for(ctx, thread_count, blocks, set_fine, &work);
    const qm_radix_producer maker = {make_entries, &work};
    qm_radix_sort_produced(ctx, order->entries, work.vertices, order->count, 3 * work.key_bits, thread_count,
                           &maker);
    qm_context_free(ctx, work.vertices, room, sizeof *work.vertices);
    order->quad_count = work.quad_count;
    QM_ASSERT(order->quad_count <= order->count);
    return QM_OK;
}

/* ---- packs ---- */

#define FACES_AHEAD 16       /* faces ahead whose corners are prefetched: the order jumps about the mesh */
#define PACKS_AHEAD 8        /* packs whose vertices are prefetched before their boxes are computed */
#define PACKS_KEPT 16384     /* packs of a tree that has room for all triangles in double precision */
#define PACKS_KEPT_BEYOND 16 /* beyond them there is room for one in this many */
#define ALL_FLOATS_MAX 4096  /* packs of the largest tree whose float packs are all made by the build */
#define BLOCK_PACKS 64       /* packs of a block of work: those below one node of level 2 */

/** Work on the packs, which the workers share by blocks. */
typedef struct pack_builder {
    qm_context *ctx;
    const qm_kernel *kernel;
    qm_bvh *bvh;
    const uint64_t *order;
    size_t count;
    size_t stride;   /* faces of every pack but the last; 0 when triangles and quads are mixed */
    uint32_t *first; /* when they are: the index in the order of each pack's first face */
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

/** Assigns faces to packs in order; a pack with a single lane left is closed before a quad. Returns the
 * number of packs. */
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

/** Adds a face; a quad takes two lanes, which share its first and third corner. Returns the number of
 * lanes. */
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

/** Adds a point of a point set: a triangle of no size. */
static int add_point(qm_pack_lanes *lanes, int lane, uint32_t *vertex, uint32_t point)
{
    lanes->face[lane] = point;
    for (int i = 0; i < 3; i++)
        vertex[3 * lane + i] = point;
    return lane + 1;
}

/** Fills the lanes of a pack, and prefetches its vertices. */
static void fill_lanes(const pack_builder *builder, size_t pack)
{
    const qm_mesh *mesh = &builder->bvh->mesh;
    qm_pack_lanes *lanes = &builder->bvh->lanes[pack];
    uint32_t vertex[3 * QM_PACK_LANES];
    int lane = 0;
    lanes->second = 0;
    size_t end = pack_first(builder, pack + 1);
    for (size_t i = pack_first(builder, pack); i < end; i++) {
        if (i + FACES_AHEAD < builder->count && mesh->face_count > 0)
            __builtin_prefetch(mesh->faces + 4 * (size_t)order_face(builder->order[i + FACES_AHEAD]));
        uint32_t facet = order_face(builder->order[i]);
        lane = mesh->face_count > 0 ? add_face(mesh, lanes, lane, vertex, facet)
                                    : add_point(lanes, lane, vertex, facet);
    }
    QM_ASSERT(lane >= 1 && lane <= QM_PACK_LANES);
    lanes->lane_count = (uint8_t)lane;
    for (; lane < QM_PACK_LANES; lane++) {
        lanes->face[lane] = lanes->face[0];
        memcpy(vertex + 3 * lane, vertex, 3 * sizeof *vertex);
    }
    builder->kernel->dedupe_corners(lanes, vertex);
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = mesh->positions + 3 * (size_t)lanes->vertex[i];
        __builtin_prefetch(position); /* it may span two cache lines */
        __builtin_prefetch(position + 2);
    }
}

/** Makes the packs of a block, and the boxes of the nodes above them. */
static void build_block(void *data, int worker, size_t block)
{
    (void)worker;
    const pack_builder *builder = data;
    qm_bvh *bvh = builder->bvh;
    if (qm_context_canceled(builder->ctx)) return;
    size_t begin = block * BLOCK_PACKS,
           end = begin + BLOCK_PACKS < bvh->pack_count ? begin + BLOCK_PACKS : bvh->pack_count;
    for (size_t i = begin; i < end + PACKS_AHEAD; i++) {
        if (i < end) fill_lanes(builder, i);
        if (i >= begin + PACKS_AHEAD) {
            /* Searches ask for most packs of a small tree: their float packs are made here, while the vertices
             * are in the cache. Of a large one they are made on demand, next to each other, so that those of
             * packs that no search comes near take neither time nor memory. */
            size_t pack = i - PACKS_AHEAD;
            const qm_pack_lanes *lanes = &bvh->lanes[pack];
            if (bvh->floats.in_place) {
                qm_pack_corners corners;
                builder->kernel->fit_corners(bvh, pack, &corners);
                qm_bvh_put_float_pack(bvh, pack, &corners);
            } else {
                builder->kernel->fit_box(bvh, pack, lanes->vertex, lanes->vertex_count);
            }
        }
    }
    if (bvh->boxes.level_count > 1) qm_box_tree_fill_children(&bvh->boxes, 2, begin / 8, (end + 7) / 8);
}

/** The number of packs that have room for their triangles in double precision. These take more memory than all else, so
 * that a large mesh has room for some of its packs only. */
static size_t kept_packs(size_t packs)
{
    return packs <= PACKS_KEPT ? packs : PACKS_KEPT + (packs - PACKS_KEPT) / PACKS_KEPT_BEYOND;
}

static qm_status fill_tree(pack_builder *builder, qm_bvh_parts parts)
{
    qm_bvh *bvh = builder->bvh;
    size_t packs = bvh->pack_count, kept = kept_packs(packs);
    size_t float_room = packs <= ALL_FLOATS_MAX ? 0 : packs;
    bool is_target = parts & QM_BVH_TARGET, has_twists = parts & QM_BVH_PATCHES && bvh->has_quads;
    bvh->lanes = qm_context_alloc(builder->ctx, packs, sizeof *bvh->lanes);
    bool has_room =
        bvh->lanes &&
        (!is_target ||
         qm_demand_init(builder->ctx, packs, float_room, sizeof(qm_float_pack), &bvh->floats)) &&
        (!is_target || qm_demand_init(builder->ctx, packs, kept, sizeof(qm_pack), &bvh->rows)) &&
        (!has_twists || qm_demand_init(builder->ctx, packs, 0, sizeof(qm_pack_twists), &bvh->twists)) &&
        qm_box_tree_init(builder->ctx, packs, &bvh->boxes);
    qm_status status = has_room ? QM_OK : QM_E_NO_MEMORY;
    if (status != QM_OK) return status;
    size_t blocks = (bvh->pack_count + BLOCK_PACKS - 1) / BLOCK_PACKS;
    qm_context_parallel_for(builder->ctx, builder->workers, blocks, build_block, builder);
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    bvh->has_all_floats = bvh->floats.in_place;
    qm_box_tree_fill(&bvh->boxes, 3);
    bvh->reach = qm_box_tree_max_coordinate(&bvh->boxes);
    return QM_OK;
}

/** Builds the tree of ordered faces in a local space that is set. Returns QM_OK, QM_E_NO_MEMORY or
 * QM_E_CANCELED. */
static qm_status build_ordered(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, int thread_count,
                               const face_order *order)
{
    QM_ASSERT(order->count > 0);
    pack_builder builder = {.ctx = ctx,
                            .kernel = qm_kernel_get(),
                            .bvh = bvh,
                            .order = order->entries,
                            .count = order->count,
                            .workers = thread_count};
    bvh->has_quads = order->quad_count > 0;
    if (order->quad_count == 0 || order->quad_count == order->count) {
        builder.stride = bvh->has_quads ? QM_PACK_LANES / 2 : QM_PACK_LANES;
        bvh->pack_count = (builder.count + builder.stride - 1) / builder.stride;
    } else {
        builder.first = qm_context_alloc(ctx, builder.count + 1, sizeof *builder.first);
        if (!builder.first) return QM_E_NO_MEMORY;
        bvh->pack_count = set_first(&bvh->mesh, order->entries, builder.count, builder.first);
    }
    qm_status status = fill_tree(&builder, parts);
    qm_context_free(ctx, builder.first, builder.count + 1, sizeof *builder.first);
    return status;
}

/* ---- whole meshes and subsets ---- */

/** True when the surface has much less than half the size of its local space. */
static bool frame_is_wide(const qm_bvh *bvh)
{
    qm_box box = qm_box_tree_bounds(&bvh->boxes);
    double half = 0.0;
    for (int k = 0; k < 3; k++)
        half = fmax(half, 0.5 * (box.max[k] - box.min[k]));
    return half < 0.25;
}

/** Frees all but the mesh and the tree itself. */
static void reset(qm_context *ctx, qm_bvh *bvh)
{
    qm_box_tree_reset(ctx, &bvh->boxes);
    qm_demand_reset(ctx, &bvh->twists);
    qm_demand_reset(ctx, &bvh->rows);
    qm_demand_reset(ctx, &bvh->floats);
    qm_context_free(ctx, bvh->lanes, bvh->pack_count, sizeof *bvh->lanes);
    *bvh = (qm_bvh){.mesh = bvh->mesh};
}

static qm_status build_mesh(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, frame_of of, int thread_count,
                            uint64_t *entries)
{
    face_order order = {.entries = entries, .count = qm_bvh_facet_count(&bvh->mesh)};
    qm_status status = order_faces(ctx, &bvh->mesh, parts, of, thread_count, &bvh->frame, &order);
    if (status == QM_OK) status = build_ordered(ctx, bvh, parts, thread_count, &order);
    if (status != QM_OK || of == FRAME_OF_SURFACE || !frame_is_wide(bvh)) return status;
    reset(ctx, bvh);
    return build_mesh(ctx, bvh, parts, FRAME_OF_SURFACE, thread_count, entries);
}

qm_status qm_bvh_build(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, int thread_count,
                       qm_bvh **out)
{
    *out = NULL;
    size_t count = qm_bvh_facet_count(mesh);
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
    if (bvh && order) status = build_mesh(ctx, bvh, parts, FRAME_OF_VERTICES, thread_count, order);
    qm_context_free(ctx, order, count, sizeof *order);
    if (status != QM_OK) {
        qm_bvh_destroy(ctx, bvh);
        return qm_context_fail(ctx, status, "%s while building the tree", qm_status_text(status));
    }
    *out = bvh;
    return QM_OK;
}

/** The box of the vertices that a subset uses. */
static qm_box box_of_subset(const qm_mesh *mesh, const qm_bvh_subset *subset)
{
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < subset->count; i++) {
        const uint32_t *corner = mesh->faces + 4 * (size_t)(subset->entries[i] & QM_RADIX_INDEX_MASK);
        for (int c = 0; c < 4 && corner[c] != QM_NO_INDEX; c++) {
            const double *p = mesh->positions + 3 * (size_t)corner[c];
            for (int k = 0; k < 3; k++) {
                box.min[k] = fmin(box.min[k], p[k]);
                box.max[k] = fmax(box.max[k], p[k]);
            }
        }
    }
    return box;
}

/** Builds in the local space of the box; in a smaller one when the faces take up little of it. */
static qm_status build_subset(qm_context *ctx, qm_bvh *bvh, const qm_bvh_subset *subset, int thread_count)
{
    const face_order order = {subset->entries, subset->count, subset->quad_count};
    bvh->frame = qm_bvh_frame_make(&subset->box);
    qm_status status = build_ordered(ctx, bvh, QM_BVH_SOURCE, thread_count, &order);
    if (status != QM_OK || !frame_is_wide(bvh)) return status;
    reset(ctx, bvh);
    qm_box box = box_of_subset(&bvh->mesh, subset);
    bvh->frame = qm_bvh_frame_make(&box);
    return build_ordered(ctx, bvh, QM_BVH_SOURCE, thread_count, &order);
}

qm_status qm_bvh_build_subset(qm_context *ctx, const qm_mesh *mesh, const qm_bvh_subset *subset,
                              int thread_count, qm_bvh **out)
{
    *out = NULL;
    qm_status status = qm_radix_sort(ctx, subset->entries, subset->count, subset->key_bits, thread_count);
    qm_bvh *bvh = status == QM_OK ? qm_context_alloc(ctx, 1, sizeof *bvh) : NULL;
    if (bvh) {
        *bvh = (qm_bvh){.mesh = *mesh};
        status = build_subset(ctx, bvh, subset, thread_count);
    }
    if (status == QM_OK && !bvh) status = QM_E_NO_MEMORY;
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
    reset(ctx, bvh);
    qm_context_free(ctx, bvh, 1, sizeof *bvh);
}

const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh)
{
    return &bvh->mesh;
}

size_t qm_bvh_memory_needed(size_t triangles, size_t quads, qm_bvh_parts parts)
{
    /* Packs of mixed faces may have empty lanes. A leaf of the boxes has eight packs; the levels above are left out. */
    const size_t packs = (triangles + 2 * quads) / QM_PACK_LANES;
    size_t width = sizeof(qm_pack_lanes);
    if (parts & QM_BVH_TARGET) width += sizeof(qm_float_pack);
    if (parts & QM_BVH_PATCHES && quads > 0) width += sizeof(qm_pack_twists);
    return (triangles + quads) * sizeof(uint64_t) + packs * width + packs / 8 * sizeof(qm_box_node) +
           (parts & QM_BVH_TARGET ? kept_packs(packs) * sizeof(qm_pack) : 0);
}

size_t qm_bvh_memory_size(const qm_bvh *bvh)
{
    return sizeof *bvh + bvh->pack_count * sizeof *bvh->lanes + qm_demand_memory_size(&bvh->floats) +
           qm_demand_memory_size(&bvh->rows) + qm_demand_memory_size(&bvh->twists) +
           qm_box_tree_memory_size(&bvh->boxes);
}
