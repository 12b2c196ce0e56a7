#include "bvh_order.h"

#include <float.h>
#include <string.h>

#include "core/hilbert.h"
#include "kernel.h"

#define MAX_BLOCKS 64       /* of vertices or faces, which the workers share; */
#define BLOCK_MEMBERS 1024  /* in each so many at least */
#define MOST_BY_6_BITS 256  /* two passes of sorting instead of three */
#define MOST_BY_8_BITS 8192 /* faces: cells of a curve of 8 bits that a surface meets, over eight or so */
#define MOST_BY_10_BITS (16 * MOST_BY_8_BITS)
#define SOURCE_SHARE 64 /* so many times the faces do for a source, whose packs are not searched */

#define INVERSE_OF_ONE (1u << 24) /* for inverses as whole numbers */

typedef struct order_work {
    const qm_mesh *mesh;
    qm_frame frame;
    bool marks_used;
    uint64_t *vertices; /* first, if asked for, a mark for each that a face uses; then fine coordinates */
    int key_bits;       /* an axis */
    double stretch;     /* from the frame, which is up to twice as large as the mesh, to the cells */
    atomic_size_t quad_count;
    qm_box box[MAX_BLOCKS];
} order_work;

static size_t count_blocks(size_t count)
{
    size_t blocks = count / BLOCK_MEMBERS;
    return blocks < 1 ? 1 : blocks < MAX_BLOCKS ? blocks : MAX_BLOCKS;
}

static void block_range(size_t count, size_t block, size_t *begin, size_t *end)
{
    size_t blocks = count_blocks(count);
    *begin = count * block / blocks;
    *end = count * (block + 1) / blocks;
}

static void mark(uint64_t *vertices, uint32_t vertex)
{
    __atomic_store_n(&vertices[vertex], 1, __ATOMIC_RELAXED);
}

static void mark_used(void *data, int worker, size_t block)
{
    (void)worker;
    const order_work *work = data;
    size_t begin, end;
    block_range(work->mesh->face_count, block, &begin, &end);
    for (size_t i = begin; i < end; i++) {
        const uint32_t *corner = work->mesh->faces + 4 * i;
        for (int k = 0; k < 3; k++)
            mark(work->vertices, corner[k]);
        mark(work->vertices, corner[3] == QM_NO_INDEX ? corner[2] : corner[3]);
    }
}

/** Box of the vertices that faces use. */
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

qm_frame qm_frame_make(const qm_box *box)
{
    qm_frame frame;
    double half = 0.0, middle[3];
    for (int k = 0; k < 3; k++) {
        middle[k] = 0.5 * box->min[k] + 0.5 * box->max[k];
        half = fmax(half, fmax(box->max[k] - middle[k], middle[k] - box->min[k]));
    }
    /* A single point has no size of its own; the place where it lies tells the scale that others come in. */
    if (half == 0.0) half = fmax(fabs(middle[0]), fmax(fabs(middle[1]), fabs(middle[2])));
    int exponent = 0;
    if (half > 0.0) frexp(half, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent > 1023 ? 1023 : exponent; /* both scales are numbers */
    frame.origin = qm_vec_load(middle);
    frame.scale = ldexp(1.0, -exponent);
    frame.inverse_scale = ldexp(1.0, exponent);
    return frame;
}

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

/** Sum of the corners of a face; inverse becomes INVERSE_OF_ONE over their number. */
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

/** Cells of the curve that the middles of faces lie in. Returns how many of them are quads. */
static inline size_t set_cells(const order_work *work, size_t first, int count, qm_hilbert_cells *cells)
{
    int shift = 24 + QM_FINE_BITS - work->key_bits;
    size_t quads = 0;
    for (int i = 0; i < count; i++) {
        uint32_t inverse;
        uint64_t sum = face_sum(work, first + (size_t)i, &inverse);
        quads += inverse == INVERSE_OF_ONE / 4;
        for (int k = 0; k < 3; k++) {
            uint64_t fine = sum >> (k * QM_FINE_FIELD) & ((1u << QM_FINE_FIELD) - 1);
            cells->axis[k][i] = (uint32_t)(fine * inverse >> shift);
        }
    }
    return quads;
}

static void make_entries(void *data, size_t begin, size_t end, uint64_t *entries)
{
    order_work *work = data;
    const qm_kernel *kernel = qm_kernel_get();
    qm_hilbert_cells cells;
    uint64_t keys[QM_HILBERT_TOGETHER];
    size_t quads = 0;
    for (size_t first = begin; first < end; first += QM_HILBERT_TOGETHER) {
        int count = end - first < QM_HILBERT_TOGETHER ? (int)(end - first) : QM_HILBERT_TOGETHER;
        quads += set_cells(work, first, count, &cells);
        kernel->hilbert_keys(&cells, count, work->key_bits, keys);
        for (int i = 0; i < count; i++)
            *entries++ = qm_radix_entry(keys[i], first + (size_t)i);
    }
    atomic_fetch_add_explicit(&work->quad_count, quads, memory_order_relaxed);
}

/** Bits that part the faces of a surface into cells of a few faces each. */
static int choose_key_bits(size_t faces, qm_bvh_parts parts)
{
    if (!(parts & QM_BVH_TARGET)) faces /= SOURCE_SHARE;
    return faces <= MOST_BY_6_BITS    ? 6
           : faces <= MOST_BY_8_BITS  ? 8
           : faces <= MOST_BY_10_BITS ? 10
                                      : QM_HILBERT_BITS;
}

static qm_box join_boxes(const order_work *work)
{
    qm_box box = work->box[0];
    for (size_t i = 1; i < count_blocks(work->mesh->vertex_count); i++) {
        for (int k = 0; k < 3; k++) {
            box.min[k] = fmin(box.min[k], work->box[i].min[k]);
            box.max[k] = fmax(box.max[k], work->box[i].max[k]);
        }
    }
    return box;
}

static double cell_stretch(const qm_frame *frame, const qm_box *box)
{
    double half = 0.0;
    for (int k = 0; k < 3; k++)
        half = fmax(half, (0.5 * box->max[k] - 0.5 * box->min[k]) * frame->scale);
    return half >= 0.25 ? 1.0 / half : 1.0;
}

qm_status qm_bvh_order(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, qm_frame_of of,
                       int thread_count, qm_frame *frame, qm_bvh_faces *faces)
{
    order_work work = {.mesh = mesh,
                       .marks_used = of == QM_FRAME_OF_SURFACE && mesh->face_count > 0,
                       .key_bits = choose_key_bits(faces->count, parts)};
    size_t blocks = count_blocks(mesh->vertex_count);
    size_t room = mesh->vertex_count > faces->count ? mesh->vertex_count : faces->count;
    work.vertices = qm_context_alloc(ctx, room, sizeof *work.vertices);
    if (!work.vertices) return QM_E_NO_MEMORY;
    if (work.marks_used) {
        memset(work.vertices, 0, mesh->vertex_count * sizeof *work.vertices);
        qm_context_share(ctx, thread_count, count_blocks(mesh->face_count), mark_used, &work);
    }
    qm_context_share(ctx, thread_count, blocks, find_box, &work);
    qm_box box = join_boxes(&work);
    *frame = work.frame = qm_frame_make(&box);
    work.stretch = cell_stretch(frame, &box);
    qm_context_share(ctx, thread_count, blocks, set_fine, &work);
    const qm_radix_maker maker = {make_entries, &work};
    qm_radix_sort_made(ctx, faces->order, work.vertices, faces->count, 3 * work.key_bits, thread_count,
                       &maker);
    qm_context_free(ctx, work.vertices, room, sizeof *work.vertices);
    faces->quad_count = work.quad_count;
    return QM_OK;
}
