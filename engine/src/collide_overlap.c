/**
 * collide_overlap.c: a grid lies over the box that both meshes have in common. The cells that the box of a
 * face reaches into are marked for one mesh, then looked up for the other: faces that reach no marked cell
 * go, and what is left of one mesh is compared with the other the same way. Coordinates become cells by the
 * same monotone steps for both meshes, so that boxes with a point in common have its cell in common.
 */
#include "collide_overlap.h"

#include <math.h>
#include <string.h>

#define MOST_CELLS 120    /* along an axis: cells 0 to MOST_CELLS + 1 are seven bits */
#define MOST_IN_ROW 62    /* along the shortest axis: a row is a word */
#define FACES_A_CELL 3.0  /* the square root of the faces over it are the cells along the longest axis */
#define MOST_ROWS 64      /* faces that reach into more rows of cells are not looked up: they stay */
#define ROWS_A_FACE 16    /* on average; where faces are so large, the grid doesn't pay */
#define FEWEST_FACES 2000 /* of both meshes; for fewer it doesn't pay either */
#define SAMPLE_STEP 31    /* one face of so many tells what share would go */

/** Cells 1 to count along each axis; 0 and count + 1 are all that is outside. The shortest axis comes last.
 */
typedef struct overlap_grid {
    int axis[3]; /* the mesh's; all else is in this order */
    double low[3], high[3], scale[3];
    uint32_t count[3];
    size_t row_count;
} overlap_grid;

/** Marks of the cells along the last axis, a bit each. */
typedef uint64_t cell_row;

/** Three cells, one along each axis, a byte each: the last axis lowest. */
typedef uint32_t cell;
enum { Z_SHIFT = 0, Y_SHIFT = 8, X_SHIFT = 16, ONES = 0x010101, TOPS = 0x808080 };

/** The cells that the box of a face reaches into. */
typedef struct cell_box {
    cell low, high;
} cell_box;

typedef struct overlap_work {
    qm_context *ctx;
    const qm_mesh *mesh[2];
    overlap_grid grid;
    cell *cells[2];     /* of each vertex */
    cell_row *marks[2]; /* where each mesh has faces */
    qm_overlap *out;
} overlap_work;

static qm_box vertex_box(const qm_mesh *mesh)
{
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int k = 0; k < 3; k++) {
            double x = mesh->positions[3 * i + (size_t)k];
            box.min[k] = x < box.min[k] ? x : box.min[k];
            box.max[k] = x > box.max[k] ? x : box.max[k];
        }
    }
    return box;
}

/** Puts the shortest axis last. */
static void order_axes(const qm_box *box, int axis[3])
{
    int last = 0;
    for (int k = 1; k < 3; k++)
        if (box->max[k] - box->min[k] < box->max[last] - box->min[last]) last = k;
    axis[0] = (last + 1) % 3;
    axis[1] = (last + 2) % 3;
    axis[2] = last;
}

/** The box that two have in common; false when there is none. */
static bool common_box(const qm_box *a, const qm_box *b, qm_box *out)
{
    bool is_there = true;
    for (int k = 0; k < 3; k++) {
        out->min[k] = fmax(a->min[k], b->min[k]);
        out->max[k] = fmin(a->max[k], b->max[k]);
        is_there &= out->min[k] <= out->max[k];
    }
    return is_there;
}

/** Lays the grid over what the meshes' boxes have in common; false when that is nothing. */
static bool lay_grid(const qm_mesh *const mesh[2], overlap_grid *grid)
{
    qm_box a = vertex_box(mesh[0]), b = vertex_box(mesh[1]), box;
    if (!common_box(&a, &b, &box)) return false;
    order_axes(&box, grid->axis);
    double faces = (double)(mesh[0]->face_count + mesh[1]->face_count) / 2.0, longest = 0.0;
    double cells = fmin(sqrt(faces) / FACES_A_CELL, MOST_CELLS);
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, box.max[k] - box.min[k]);
    for (int k = 0; k < 3; k++) {
        grid->low[k] = box.min[grid->axis[k]];
        grid->high[k] = box.max[grid->axis[k]];
        double length = grid->high[k] - grid->low[k];
        double count =
            longest > 0.0 ? fmin(ceil(cells * (length / longest)), k == 2 ? MOST_IN_ROW : MOST_CELLS) : 1.0;
        grid->count[k] = count > 1.0 ? (uint32_t)count : 1;
        grid->scale[k] = length > 0.0 ? grid->count[k] / length : 0.0;
        if (!(grid->scale[k] < INFINITY)) grid->scale[k] = 0.0;
    }
    grid->row_count = (grid->count[0] + 2) * (size_t)(grid->count[1] + 2);
    return true;
}

static uint32_t find_cell(const overlap_grid *grid, int k, double x)
{
    double place = (x - grid->low[k]) * grid->scale[k], last = grid->count[k] - 1.0;
    place = place > 0.0 ? place : 0.0;
    uint32_t inside = 1 + (uint32_t)(int32_t)(place < last ? place : last);
    return x < grid->low[k] ? 0 : x > grid->high[k] ? grid->count[k] + 1 : inside;
}

static void set_cells(const overlap_grid *grid, const qm_mesh *mesh, cell *cells)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        const double *p = mesh->positions + 3 * i;
        cells[i] = find_cell(grid, 0, p[grid->axis[0]]) << X_SHIFT |
                   find_cell(grid, 1, p[grid->axis[1]]) << Y_SHIFT |
                   find_cell(grid, 2, p[grid->axis[2]]) << Z_SHIFT;
    }
}

/** The top bit of each byte in which a is at least b: none of them has one of its own. */
static inline uint32_t at_least(cell a, cell b)
{
    return ((a | TOPS) - b) & TOPS;
}

/** The bytes of a where the top bits are set, those of b elsewhere. */
static inline cell choose(uint32_t tops, cell a, cell b)
{
    uint32_t bytes = (tops >> 7) * 0xff;
    return (a & bytes) | (b & ~bytes);
}

static inline void extend(cell_box *box, cell c)
{
    box->low = choose(at_least(box->low, c), c, box->low);
    box->high = choose(at_least(c, box->high), c, box->high);
}

/** The cells of a face; false when all are outside on one side of the grid. */
static inline bool face_cells(const overlap_grid *grid, const uint32_t *corner, const cell *cells,
                              cell_box *out)
{
    *out = (cell_box){cells[corner[0]], cells[corner[0]]};
    extend(out, cells[corner[1]]);
    extend(out, cells[corner[2]]);
    if (corner[3] != QM_NO_INDEX) extend(out, cells[corner[3]]);
    cell beyond =
        (grid->count[0] + 1) << X_SHIFT | (grid->count[1] + 1) << Y_SHIFT | (grid->count[2] + 1) << Z_SHIFT;
    return at_least(out->high, ONES) == TOPS && at_least(out->low, beyond) == 0;
}

static inline uint32_t axis_cell(cell c, int shift)
{
    return c >> shift & 0xff;
}

/** Where the rows of a box lie. */
typedef struct row_range {
    uint32_t x[2], y[2];
    cell_row bits; /* of the cells in each */
    bool is_small; /* two by two rows at most, which then are taken without branches */
} row_range;

static inline row_range find_rows(const cell_box *box)
{
    row_range rows = {.x = {axis_cell(box->low, X_SHIFT), axis_cell(box->high, X_SHIFT)},
                      .y = {axis_cell(box->low, Y_SHIFT), axis_cell(box->high, Y_SHIFT)}};
    uint32_t first = axis_cell(box->low, Z_SHIFT), last = axis_cell(box->high, Z_SHIFT);
    rows.bits = (((cell_row)2 << (last - first)) - 1) << first;
    rows.is_small = rows.x[1] - rows.x[0] < 2 && rows.y[1] - rows.y[0] < 2;
    return rows;
}

static inline size_t row_place(const overlap_grid *grid, uint32_t x, uint32_t y)
{
    return x * (size_t)(grid->count[1] + 2) + y;
}

static inline size_t count_rows(const row_range *rows)
{
    return (rows->x[1] - rows->x[0] + 1) * (size_t)(rows->y[1] - rows->y[0] + 1);
}

static inline void mark_rows(const overlap_grid *grid, cell_row *marks, const row_range *rows)
{
    if (rows->is_small) {
        for (int i = 0; i < 4; i++)
            marks[row_place(grid, rows->x[i / 2], rows->y[i % 2])] |= rows->bits;
        return;
    }
    for (uint32_t x = rows->x[0]; x <= rows->x[1]; x++)
        for (uint32_t y = rows->y[0]; y <= rows->y[1]; y++)
            marks[row_place(grid, x, y)] |= rows->bits;
}

static inline bool rows_are_marked(const overlap_grid *grid, const cell_row *marks, const row_range *rows)
{
    cell_row found = 0;
    if (rows->is_small) {
        for (int i = 0; i < 4; i++)
            found |= marks[row_place(grid, rows->x[i / 2], rows->y[i % 2])];
        return (found & rows->bits) != 0;
    }
    if (count_rows(rows) > MOST_ROWS) return true;
    for (uint32_t x = rows->x[0]; x <= rows->x[1]; x++)
        for (uint32_t y = rows->y[0]; y <= rows->y[1]; y++)
            found |= marks[row_place(grid, x, y)];
    return (found & rows->bits) != 0;
}

/** Marks the cells of all faces; false when they are too large for that. */
static bool mark_faces(const overlap_grid *grid, const qm_mesh *mesh, const cell *cells, cell_row *marks)
{
    size_t rows_left = ROWS_A_FACE * mesh->face_count;
    for (size_t i = 0; i < mesh->face_count; i++) {
        cell_box box;
        if (!face_cells(grid, mesh->faces + 4 * i, cells, &box)) continue;
        row_range rows = find_rows(&box);
        if (count_rows(&rows) > rows_left) return false;
        rows_left -= count_rows(&rows);
        mark_rows(grid, marks, &rows);
    }
    return true;
}

/** Whether a sample of the first mesh says that at least a third of its faces would go. */
static bool would_pay(const overlap_work *work)
{
    const qm_mesh *mesh = work->mesh[0];
    size_t looked_at = 0, near = 0;
    for (size_t i = 0; i < mesh->face_count; i += SAMPLE_STEP) {
        cell_box box;
        looked_at++;
        if (!face_cells(&work->grid, mesh->faces + 4 * i, work->cells[0], &box)) continue;
        row_range rows = find_rows(&box);
        near += rows_are_marked(&work->grid, work->marks[1], &rows);
    }
    return 3 * near <= 2 * looked_at;
}

static qm_status make_room(overlap_work *work, int side)
{
    size_t count = work->mesh[side]->face_count;
    qm_mesh *part = &work->out->part[side];
    work->out->capacity[side] = count;
    part->faces = qm_context_alloc(work->ctx, count, 4 * sizeof *part->faces);
    part->face_origin = qm_context_alloc(work->ctx, count, sizeof *part->face_origin);
    part->face_count = 0;
    return part->faces && part->face_origin ? QM_OK : QM_E_NO_MEMORY;
}

/** Keeps the faces of one mesh that are near marked cells of the other, and marks theirs. */
static qm_status keep_near(overlap_work *work, int side)
{
    const qm_mesh *mesh = work->mesh[side];
    qm_mesh *part = &work->out->part[side];
    qm_status status = make_room(work, side);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < mesh->face_count; i++) {
        cell_box box;
        if (!face_cells(&work->grid, mesh->faces + 4 * i, work->cells[side], &box)) continue;
        row_range rows = find_rows(&box);
        if (!rows_are_marked(&work->grid, work->marks[1 - side], &rows)) continue;
        if (side == 0) mark_rows(&work->grid, work->marks[0], &rows);
        memcpy(part->faces + 4 * part->face_count, mesh->faces + 4 * i, 4 * sizeof *part->faces);
        part->face_origin[part->face_count++] = qm_mesh_input_face(mesh, (uint32_t)i);
    }
    work->out->is_empty |= part->face_count == 0;
    return QM_OK;
}

static qm_status find_parts(overlap_work *work)
{
    for (int side = 0; side < 2; side++) {
        set_cells(&work->grid, work->mesh[side], work->cells[side]);
        memset(work->marks[side], 0, work->grid.row_count * sizeof *work->marks[side]);
    }
    bool pays = mark_faces(&work->grid, work->mesh[1], work->cells[1], work->marks[1]) && would_pay(work);
    qm_status status = pays ? keep_near(work, 0) : QM_OK;
    return pays && status == QM_OK && !work->out->is_empty ? keep_near(work, 1) : status;
}

static qm_status run(overlap_work *work)
{
    qm_context *ctx = work->ctx;
    size_t row_count = work->grid.row_count;
    bool has_memory = true;
    for (int side = 0; side < 2; side++) {
        work->cells[side] = qm_context_alloc(ctx, work->mesh[side]->vertex_count, sizeof(cell));
        work->marks[side] = qm_context_alloc_aligned(ctx, row_count, sizeof(cell_row));
        has_memory &= work->cells[side] && work->marks[side];
    }
    qm_status status = has_memory ? find_parts(work) : QM_E_NO_MEMORY;
    for (int side = 0; side < 2; side++) {
        qm_context_free(ctx, work->cells[side], work->mesh[side]->vertex_count, sizeof(cell));
        qm_context_free_aligned(ctx, work->marks[side], row_count, sizeof(cell_row));
    }
    return status;
}

qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out)
{
    overlap_work work = {.ctx = ctx, .mesh = {a, b}, .out = out};
    *out = (qm_overlap){.part = {*a, *b}};
    if (a->face_count == 0 || b->face_count == 0 || a->face_count + b->face_count < FEWEST_FACES)
        return QM_OK;
    if (!lay_grid(work.mesh, &work.grid)) {
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
