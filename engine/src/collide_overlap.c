/**
 * collide_overlap.c: a grid lies over the box that both meshes have in common. The cells that the box of a
 * face reaches into are marked for one mesh, then looked up for the other: faces that reach no marked cell
 * go, and what is left of one mesh is compared with the other the same way. Boxes with a point in common have
 * its cell in common.
 */
#include "collide_overlap.h"

#include <string.h>

#include "kernel.h"

#define MOST_ROWS 64            /* faces that reach into more rows of cells are not looked up: they stay */
#define ROWS_A_FACE 16          /* on average; where faces are so large, the grid doesn't pay */
#define MOST_VERTICES INT32_MAX /* more of a mesh are numbered beyond what is looked up eight at a time */
#define FEWEST_FACES 2000       /* of both meshes; for fewer it doesn't pay either */
#define SAMPLE_STEP 31          /* eight faces of so many times eight tell what share would go */

typedef uint8_t near_bits; /* of QM_CELL_FACES faces */

typedef struct overlap_work {
    qm_context *ctx;
    const qm_kernel *kernel;
    const qm_mesh *mesh[2];
    qm_cell_grid grid;
    qm_cell *cells[2];       /* of each vertex */
    qm_cell_marks *marks[2]; /* where each mesh has faces */
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

/** Marks the cells of all faces of the second mesh; false when they are too large for that. */
static bool mark_faces(overlap_work *work)
{
    size_t count = work->mesh[1]->face_count, rows_left = ROWS_A_FACE * count;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        for (unsigned faces = find_boxes(work, 1, first, &boxes); faces; faces &= faces - 1) {
            int i = __builtin_ctz(faces);
            qm_cell_rows rows = qm_cell_rows_find(boxes.low[i], boxes.high[i]);
            if (qm_cell_rows_count(&rows) > rows_left) return false;
            rows_left -= qm_cell_rows_count(&rows);
            qm_cell_marks_add(&work->grid, work->marks[1], &rows);
        }
    }
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

/** Finds the faces of one mesh that are near marked cells of the other, a bit each, and marks their own cells
 * where those will be looked up. Returns how many there are. */
static size_t find_near_faces(overlap_work *work, int side, near_bits *near)
{
    size_t count = work->mesh[side]->face_count, found = 0;
    for (size_t first = 0; first < count; first += QM_CELL_FACES) {
        qm_cell_boxes boxes;
        unsigned faces = find_boxes(work, side, first, &boxes);
        if (faces) faces = find_near(work, side, &boxes, faces);
        near[first / QM_CELL_FACES] = (near_bits)faces;
        found += (size_t)__builtin_popcount(faces);
        for (; side == 0 && faces; faces &= faces - 1) {
            int i = __builtin_ctz(faces);
            qm_cell_rows rows = qm_cell_rows_find(boxes.low[i], boxes.high[i]);
            qm_cell_marks_add(&work->grid, work->marks[0], &rows);
        }
    }
    if (side == 0) qm_cell_marks_spread(&work->grid, work->marks[0]);
    return found;
}

static qm_status copy_faces(const overlap_work *work, int side, const near_bits *near, size_t count)
{
    const qm_mesh *mesh = work->mesh[side];
    qm_mesh *part = &work->out->part[side];
    work->out->capacity[side] = count;
    part->faces = qm_context_alloc(work->ctx, count, 4 * sizeof *part->faces);
    part->face_origin = qm_context_alloc(work->ctx, count, sizeof *part->face_origin);
    part->face_count = 0;
    if (!part->faces || !part->face_origin) return QM_E_NO_MEMORY;
    for (size_t first = 0; first < mesh->face_count; first += QM_CELL_FACES) {
        for (unsigned faces = near[first / QM_CELL_FACES]; faces; faces &= faces - 1) {
            size_t face = first + (size_t)__builtin_ctz(faces);
            memcpy(part->faces + 4 * part->face_count, mesh->faces + 4 * face, 4 * sizeof *part->faces);
            part->face_origin[part->face_count++] = qm_mesh_input_face(mesh, (uint32_t)face);
        }
    }
    return QM_OK;
}

/** Keeps the faces of one mesh that are near marked cells of the other. They are counted first: room for all
 * of them would be memory that is asked for and given back each time. */
static qm_status keep_near(overlap_work *work, int side)
{
    size_t blocks = (work->mesh[side]->face_count + QM_CELL_FACES - 1) / QM_CELL_FACES;
    near_bits *near = qm_context_alloc(work->ctx, blocks, sizeof *near);
    if (!near) return QM_E_NO_MEMORY;
    size_t count = find_near_faces(work, side, near);
    work->out->is_empty |= count == 0;
    qm_status status = count > 0 ? copy_faces(work, side, near, count) : QM_OK;
    qm_context_free(work->ctx, near, blocks, sizeof *near);
    return status;
}

static qm_status find_parts(overlap_work *work)
{
    for (int side = 0; side < 2; side++) {
        work->kernel->vertex_cells(&work->grid, work->mesh[side]->positions, work->mesh[side]->vertex_count,
                                   work->cells[side]);
        memset(work->marks[side], 0, (work->grid.row_count + 1) * sizeof *work->marks[side]);
    }
    bool pays = mark_faces(work) && would_pay(work);
    qm_status status = pays ? keep_near(work, 0) : QM_OK;
    return pays && status == QM_OK && !work->out->is_empty ? keep_near(work, 1) : status;
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

qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out)
{
    overlap_work work = {.ctx = ctx, .kernel = qm_kernel_get(), .mesh = {a, b}, .out = out};
    *out = (qm_overlap){.part = {*a, *b}};
    if (a->face_count == 0 || b->face_count == 0 || a->face_count + b->face_count < FEWEST_FACES ||
        a->vertex_count > MOST_VERTICES || b->vertex_count > MOST_VERTICES)
        return QM_OK;
    if (!qm_cell_grid_lay(work.mesh, &work.grid)) {
        out->is_empty = true;
        return QM_OK;
    }
    return run(&work);
}

void qm_overlap_reset(qm_context *ctx, qm_overlap *overlap)
{
    for (int side = 0; side < 2; side++) {
        qm_mesh *part = &overlap->part[side];
        size_t capacity = overlap->capacity[side];
        if (capacity == 0) continue;
        qm_context_free(ctx, part->faces, capacity, 4 * sizeof *part->faces);
        qm_context_free(ctx, part->face_origin, capacity, sizeof *part->face_origin);
    }
    *overlap = (qm_overlap){0};
}
