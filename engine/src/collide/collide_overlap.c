/**
 * collide_overlap.c: which faces of two meshes can meet, before there is a tree of either, and the search in
 * trees of these faces alone.
 *
 * A grid divides the intersection of both bounding boxes. The cells that the boxes of the second mesh's faces
 * overlap are marked; faces of the first mesh that overlap no marked cell are left out, and the others mark
 * cells for the second mesh in turn. Boxes with a common point overlap its cell both, so that no pair is
 * lost.
 */
#include "collide_overlap.h"

#include <string.h>

#include "collide_search.h"
#include "core/radix.h"

#define MAX_ROWS 64            /* faces that overlap more rows of cells stay without a look at the marks */
#define ROWS_A_FACE 16         /* on average: with larger faces the grid doesn't pay */
#define MAX_VERTICES INT32_MAX /* a gather of eight takes signed indices */
#define KEY_BITS 8             /* an axis: sums of two cell indices, halved where they would not fit */
#define MIN_FACES 2000         /* of both meshes together; for fewer the grid doesn't pay either */
#define SAMPLE_STEP 31         /* one batch of eight faces in 31 estimates how many faces would be left out */

typedef struct overlap_work {
    qm_context *ctx;
    const qm_kernel *kernel;
    const qm_mesh *mesh[2];
    qm_cell_grid grid;
    qm_cell *cells[2];       /* of each vertex */
    qm_cell_marks *marks[2]; /* where each mesh has faces */
    qm_cell_list list;       /* the faces of the current batch */
    size_t rows_left;        /* how many more rows may be marked */
    int key_shift;           /* of the sum of two cells */
    qm_overlap *out;
} overlap_work;

/** Finds the cells of up to QM_CELL_FACES faces from first on. Returns a bit for each face that does not lie
 * outside of the grid on one side. */
static inline unsigned find_boxes(const overlap_work *work, int side, size_t first, qm_cell_boxes *boxes)
{
    const qm_mesh *mesh = work->mesh[side];
    const uint32_t *faces = mesh->faces + 4 * first;
    size_t count = mesh->face_count - first;
    if (count >= QM_CELL_FACES) return work->kernel->cell_boxes(&work->grid, faces, work->cells[side], boxes);
    uint32_t filled[QM_CELL_FACES][4];
    for (size_t i = 0; i < QM_CELL_FACES; i++)
        memcpy(filled[i], faces + (i < count ? 4 * i : 0), sizeof filled[i]);
    unsigned inside = work->kernel->cell_boxes(&work->grid, filled[0], work->cells[side], boxes);
    return inside & ((1u << count) - 1);
}

/** Of the faces that have a bit, returns those that overlap a marked cell of the other mesh. */
static inline unsigned find_near(const overlap_work *work, int side, const qm_cell_boxes *boxes,
                                 unsigned faces)
{
    const qm_cell_marks *marks = work->marks[1 - side];
    unsigned large, near = work->kernel->cells_marked(&work->grid, marks, boxes, &large);
    for (large &= faces; large; large &= large - 1) {
        int i = __builtin_ctz(large);
        qm_cell_rows rows = qm_cell_rows_find(boxes->low[i], boxes->high[i]);
        bool is_near = qm_cell_rows_count(&rows) > MAX_ROWS || qm_cell_marks_meet(&work->grid, marks, &rows);
        near |= (unsigned)is_near << i;
    }
    return near & faces;
}

/** Marks the cells of the faces of the list; false when the faces are too large for the budget of rows. */
static bool mark_list(overlap_work *work, int side)
{
    const qm_cell_list *list = &work->list;
    for (unsigned i = 0; i < list->count; i++) {
        qm_cell_rows rows = qm_cell_rows_find(list->low[i], list->high[i]);
        if (qm_cell_rows_count(&rows) > work->rows_left) return false;
        work->rows_left -= qm_cell_rows_count(&rows);
        qm_cell_marks_add(&work->grid, work->marks[side], &rows);
    }
    return true;
}

/** Marks the cells of all faces of the second mesh; false when its faces are too large. */
static bool mark_faces(overlap_work *work)
{
    size_t count = work->mesh[1]->face_count;
    work->rows_left = ROWS_A_FACE * count;
    work->list.count = 0;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, 1, first, &boxes);
        work->kernel->append_cells(&boxes, (uint32_t)first, faces, &work->list);
        if (work->list.count < QM_CELL_LIST) continue;
        if (!mark_list(work, 1)) return false;
        work->list.count = 0;
    }
    if (!mark_list(work, 1)) return false;
    qm_cell_marks_spread(&work->grid, work->marks[1]);
    return true;
}

/** Estimates from a sample of the first mesh whether at least a third of its faces would be left out. */
static bool would_pay(const overlap_work *work)
{
    size_t count = work->mesh[0]->face_count, sampled = 0, near = 0;
    for (size_t first = 0; first < count; first += SAMPLE_STEP * QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, 0, first, &boxes);
        sampled += count - first < QM_CELL_FACES ? count - first : QM_CELL_FACES;
        near += (size_t)__builtin_popcount(find_near(work, 0, &boxes, faces));
    }
    QM_ASSERT(near <= sampled);
    return 3 * near <= 2 * sampled;
}

/** Adds faces of the list to a part, with their position along the Hilbert curve as keys. */
static void add_faces(overlap_work *work, int side, unsigned first, unsigned count)
{
    const qm_cell_list *list = &work->list;
    const uint32_t *faces = work->mesh[side]->faces;
    qm_bvh_subset *part = &work->out->part[side];
    static const int shift[3] = {QM_CELL_X, QM_CELL_Y, QM_CELL_Z};
    qm_hilbert_cells centre;
    uint64_t keys[QM_HILBERT_BATCH];
    for (int k = 0; k < 3; k++)
        for (unsigned i = 0; i < count; i++)
            centre.axis[k][i] = (qm_cell_axis(list->low[first + i], shift[k]) +
                                 qm_cell_axis(list->high[first + i], shift[k])) >>
                                work->key_shift;
    work->kernel->hilbert_keys(&centre, (int)count, KEY_BITS, keys);
    for (unsigned i = 0; i < count; i++) {
        uint32_t face = list->face[first + i];
        QM_ASSERT(part->count < work->out->capacity[side]);
        part->entries[part->count++] = qm_radix_entry(keys[i], face);
        part->quad_count += faces[4 * (size_t)face + 3] != QM_NO_INDEX;
    }
}

/** Adds the faces of one mesh that overlap marked cells of the other to their part. Those of the first mesh
 * mark their own cells, against which the second mesh is compared. The array has room for all faces; memory
 * that is never written costs nothing. */
static qm_status keep_near(overlap_work *work, int side)
{
    qm_bvh_subset *part = &work->out->part[side];
    size_t count = work->mesh[side]->face_count;
    part->entries = qm_context_alloc(work->ctx, count, sizeof *part->entries);
    if (!part->entries) return QM_E_NO_MEMORY;
    work->out->capacity[side] = count;
    part->key_bits = 3 * KEY_BITS;
    work->rows_left = SIZE_MAX;
    work->list.count = 0;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, side, first, &boxes);
        work->kernel->append_cells(&boxes, (uint32_t)first, find_near(work, side, &boxes, faces),
                                   &work->list);
        if (work->list.count < QM_CELL_LIST && first + QM_CELL_FACES < count) continue;
        if (side == 0) mark_list(work, 0);
        for (unsigned at = 0; at < work->list.count; at += QM_HILBERT_BATCH) {
            unsigned left = work->list.count - at;
            add_faces(work, side, at, left < QM_HILBERT_BATCH ? left : QM_HILBERT_BATCH);
        }
        work->list.count = 0;
    }
    if (side == 0) qm_cell_marks_spread(&work->grid, work->marks[0]);
    work->out->is_empty |= part->count == 0;
    return QM_OK;
}

static qm_status find_parts(overlap_work *work)
{
    for (int side = 0; side < 2; side++) {
        work->kernel->vertex_cells(&work->grid, work->mesh[side]->positions, work->mesh[side]->vertex_count,
                                   work->cells[side]);
        memset(work->marks[side], 0, (work->grid.row_count + 1) * sizeof *work->marks[side]);
    }
    work->out->is_whole = !mark_faces(work) || !would_pay(work);
    if (work->out->is_whole) return QM_OK;
    for (int k = 0; k < 3; k++)
        if (2 * (work->grid.count[k] + 1) >= 1u << KEY_BITS) work->key_shift = 1;
    qm_status status = keep_near(work, 0);
    return status == QM_OK && !work->out->is_empty ? keep_near(work, 1) : status;
}

static qm_status run(overlap_work *work)
{
    qm_context *ctx = work->ctx;
    size_t row_count = work->grid.row_count + 1; /* a look-up of two rows may read one past the end */
    bool has_memory = true;
    for (int side = 0; side < 2; side++) {
        work->cells[side] = qm_context_alloc(ctx, work->mesh[side]->vertex_count, sizeof(qm_cell));
        work->marks[side] = qm_context_alloc_aligned(ctx, row_count, sizeof(qm_cell_marks));
        has_memory &= work->cells[side] && work->marks[side];
    }
    qm_status status = has_memory ? find_parts(work) : QM_E_NO_MEMORY;
    for (int side = 0; side < 2; side++) {
        qm_context_free(ctx, work->cells[side], work->mesh[side]->vertex_count, sizeof(qm_cell));
        qm_context_free_aligned(ctx, work->marks[side], row_count, sizeof(qm_cell_marks));
    }
    return status;
}

qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out)
{
    QM_ASSERT(ctx && a && b && out);
    /* Whether the grid can pay, and the kernels can index all vertices and faces. */
    bool fits = a->face_count > 0 && b->face_count > 0 && a->face_count + b->face_count >= MIN_FACES &&
                a->vertex_count <= MAX_VERTICES && b->vertex_count <= MAX_VERTICES &&
                a->face_count <= QM_RADIX_INDEX_MASK && b->face_count <= QM_RADIX_INDEX_MASK;
    *out = (qm_overlap){.is_whole = !fits};
    if (!fits) return QM_OK;
    overlap_work *work = qm_context_alloc_aligned(ctx, 1, sizeof *work);
    if (!work) return QM_E_NO_MEMORY;
    *work = (overlap_work){.ctx = ctx, .kernel = qm_kernel_get(), .mesh = {a, b}, .out = out};
    qm_box box[2];
    out->is_empty = !qm_cell_grid_init(work->mesh, box, &work->grid);
    out->part[0].box = box[0];
    out->part[1].box = box[1];
    qm_status status = out->is_empty ? QM_OK : run(work);
    qm_context_free_aligned(ctx, work, 1, sizeof *work);
    return status;
}

void qm_overlap_reset(qm_context *ctx, qm_overlap *overlap)
{
    for (int side = 0; side < 2; side++)
        qm_context_free(ctx, overlap->part[side].entries, overlap->capacity[side],
                        sizeof *overlap->part[side].entries);
    *overlap = (qm_overlap){0};
}

/* ---- the search ---- */

qm_status qm_collide_surfaces(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                              const qm_collide_options *options, qm_collision *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    *out = (qm_collision){0};
    qm_status status = qm_collide_check_options(ctx, options);
    if (status != QM_OK) return status;
    if (qm_collide_are_identical(a, b)) { /* one tree is enough */
        qm_bvh *tree;
        status = qm_bvh_build(ctx, a, QM_BVH_SOURCE, options->thread_count, &tree);
        if (status == QM_OK) status = qm_collide_meshes(ctx, tree, tree, options, out);
        qm_bvh_destroy(ctx, tree);
        return status;
    }
    qm_overlap overlap;
    status = qm_overlap_find(ctx, a, b, &overlap);
    if (status != QM_OK)
        qm_context_fail(ctx, status, "%s while looking for collisions", qm_status_text(status));
    /* Trees of both meshes, or of their parts that may meet the other mesh. */
    const qm_mesh *const mesh[2] = {a, b};
    qm_bvh *tree[2] = {NULL, NULL};
    int threads = options->thread_count;
    bool searches = status == QM_OK && !overlap.is_empty;
    for (int side = 0; side < 2 && searches && status == QM_OK; side++)
        status = overlap.is_whole
                     ? qm_bvh_build(ctx, mesh[side], QM_BVH_SOURCE, threads, &tree[side])
                     : qm_bvh_build_subset(ctx, mesh[side], &overlap.part[side], threads, &tree[side]);
    if (searches && status == QM_OK) status = qm_collide_meshes(ctx, tree[0], tree[1], options, out);
    qm_bvh_destroy(ctx, tree[1]);
    qm_bvh_destroy(ctx, tree[0]);
    qm_overlap_reset(ctx, &overlap);
    return status;
}
