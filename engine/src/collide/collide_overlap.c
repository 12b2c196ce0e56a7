/**
 * collide_overlap.c: a grid lies over the box that both meshes have in common. The cells that the box of a
 * face reaches into are marked for one mesh, then looked up for the other: faces that reach no marked cell
 * go, and what is left of one mesh is compared with the other the same way. Boxes with a point in common have
 * its cell in common.
 */
#include "collide_overlap.h"

#include <string.h>

#include "bvh/kernel.h"
#include "core/hilbert.h"
#include "core/radix.h"

#define MOST_ROWS 64            /* faces that reach into more rows of cells are not looked up: they stay */
#define ROWS_A_FACE 16          /* on average; where faces are so large, the grid doesn't pay */
#define MOST_VERTICES INT32_MAX /* more of a mesh are numbered beyond what is looked up eight at a time */
#define KEY_BITS 8        /* an axis: twice the cells, or as many where they are more than half of that */
#define FEWEST_FACES 2000 /* of both meshes; for fewer it doesn't pay either */
#define SAMPLE_STEP 31    /* eight faces of so many times eight tell what share would go */

typedef struct overlap_work {
    qm_context *ctx;
    const qm_kernel *kernel;
    const qm_mesh *mesh[2];
    qm_cell_grid grid;
    qm_cell *cells[2];       /* of each vertex */
    qm_cell_marks *marks[2]; /* where each mesh has faces */
    qm_cell_list list;       /* of faces that are at hand */
    size_t rows_left;        /* how many more rows may be marked */
    int key_shift;           /* of the sum of two cells */
    qm_overlap *out;
} overlap_work;

/** The cells of up to QM_CELL_FACES faces from the first on; bits of those that are not all outside on one
 * side of the grid. */
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

/** Bits of those of some faces of one mesh that reach into cells where the other has faces. */
static inline unsigned find_near(const overlap_work *work, int side, const qm_cell_boxes *boxes,
                                 unsigned faces)
{
    const qm_cell_marks *marks = work->marks[1 - side];
    unsigned large, near = work->kernel->cells_marked(&work->grid, marks, boxes, &large);
    for (large &= faces; large; large &= large - 1) {
        int i = __builtin_ctz(large);
        qm_cell_rows rows = qm_cell_rows_find(boxes->low[i], boxes->high[i]);
        bool is_near = qm_cell_rows_count(&rows) > MOST_ROWS || qm_cell_marks_meet(&work->grid, marks, &rows);
        near |= (unsigned)is_near << i;
    }
    return near & faces;
}

/** Marks the cells of the faces of the list; false when they are too large for that. */
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

/** Marks the cells of all faces of the second mesh; false when they are too large for that. */
static bool mark_faces(overlap_work *work)
{
    size_t count = work->mesh[1]->face_count;
    work->rows_left = ROWS_A_FACE * count;
    work->list.count = 0;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, 1, first, &boxes);
        work->kernel->keep_cells(&boxes, (uint32_t)first, faces, &work->list);
        if (work->list.count < QM_CELL_LIST) continue;
        if (!mark_list(work, 1)) return false;
        work->list.count = 0;
    }
    if (!mark_list(work, 1)) return false;
    qm_cell_marks_spread(&work->grid, work->marks[1]);
    return true;
}

/** Whether a sample of the first mesh says that at least a third of its faces would go. */
static bool would_pay(const overlap_work *work)
{
    size_t count = work->mesh[0]->face_count, looked_at = 0, near = 0;
    for (size_t first = 0; first < count; first += SAMPLE_STEP * QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, 0, first, &boxes);
        looked_at += count - first < QM_CELL_FACES ? count - first : QM_CELL_FACES;
        near += (size_t)__builtin_popcount(find_near(work, 0, &boxes, faces));
    }
    return 3 * near <= 2 * looked_at;
}

/** Puts some faces of the list into a part, by their place along the curve. */
static void add_faces(overlap_work *work, int side, unsigned first, unsigned count)
{
    const qm_cell_list *list = &work->list;
    const uint32_t *faces = work->mesh[side]->faces;
    qm_bvh_part *part = &work->out->part[side];
    static const int shift[3] = {QM_CELL_X, QM_CELL_Y, QM_CELL_Z};
    qm_hilbert_cells middle;
    uint64_t keys[QM_HILBERT_TOGETHER];
    for (int k = 0; k < 3; k++)
        for (unsigned i = 0; i < count; i++)
            middle.axis[k][i] = (qm_cell_axis(list->low[first + i], shift[k]) +
                                 qm_cell_axis(list->high[first + i], shift[k])) >>
                                work->key_shift;
    work->kernel->hilbert_keys(&middle, (int)count, KEY_BITS, keys);
    for (unsigned i = 0; i < count; i++) {
        uint32_t face = list->face[first + i];
        part->entries[part->count++] = qm_radix_entry(keys[i], face);
        part->quad_count += faces[4 * (size_t)face + 3] != QM_NO_INDEX;
    }
}

static void add_list(overlap_work *work, int side)
{
    for (unsigned first = 0; first < work->list.count; first += QM_HILBERT_TOGETHER) {
        unsigned left = work->list.count - first;
        add_faces(work, side, first, left < QM_HILBERT_TOGETHER ? left : QM_HILBERT_TOGETHER);
    }
}

/** Finds the faces of one mesh that are near marked cells of the other, and marks their own cells where those
 * will be looked up. */
static void find_near_faces(overlap_work *work, int side)
{
    size_t count = work->mesh[side]->face_count;
    work->rows_left = SIZE_MAX;
    work->list.count = 0;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, side, first, &boxes);
        work->kernel->keep_cells(&boxes, (uint32_t)first, find_near(work, side, &boxes, faces), &work->list);
        if (work->list.count < QM_CELL_LIST && first + QM_CELL_FACES < count) continue;
        if (side == 0) mark_list(work, 0);
        add_list(work, side);
        work->list.count = 0;
    }
    if (side == 0) qm_cell_marks_spread(&work->grid, work->marks[0]);
}

/** Only what is used of the room is touched. */
static qm_status keep_near(overlap_work *work, int side)
{
    qm_bvh_part *part = &work->out->part[side];
    size_t capacity = work->mesh[side]->face_count;
    part->entries = qm_context_alloc(work->ctx, capacity, sizeof *part->entries);
    if (!part->entries) return QM_E_NO_MEMORY;
    work->out->capacity[side] = capacity;
    part->key_bits = 3 * KEY_BITS;
    find_near_faces(work, side);
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
    size_t row_count = work->grid.row_count + 1; /* what is looked up at a time may reach over the end */
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

/** Whether there are so many faces, and no more, as it takes to look at all of them. */
static bool fits(const qm_mesh *a, const qm_mesh *b)
{
    return a->face_count > 0 && b->face_count > 0 && a->face_count + b->face_count >= FEWEST_FACES &&
           a->vertex_count <= MOST_VERTICES && b->vertex_count <= MOST_VERTICES &&
           a->face_count <= QM_RADIX_INDEX_MASK && b->face_count <= QM_RADIX_INDEX_MASK;
}

qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out)
{
    *out = (qm_overlap){.is_whole = !fits(a, b)};
    if (out->is_whole) return QM_OK;
    overlap_work *work = qm_context_alloc_aligned(ctx, 1, sizeof *work);
    if (!work) return QM_E_NO_MEMORY;
    *work = (overlap_work){.ctx = ctx, .kernel = qm_kernel_get(), .mesh = {a, b}, .out = out};
    qm_box box[2];
    out->is_empty = !qm_cell_grid_lay(work->mesh, box, &work->grid);
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
