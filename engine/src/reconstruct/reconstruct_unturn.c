/**
 * reconstruct_unturn.c: quads that lie upside down between their neighbours, as where vertices of a row were
 * placed in the wrong order, and folds that smoothing left. No one vertex of them can move for the better, so
 * a block of the grid round them is laid anew between its border, which stays.
 */
#include "reconstruct_work.h"

#include <string.h>

#define LONGEST_RUN 4 /* of quads side by side that lie upside down; a ridge has no end */
#define WIDEST 8      /* quads that a block reaches beyond a run, doubled from 1 on */
#define WIDEST_OFF 2  /* the same off the surface: a wider block would cut off what sticks out of it */
#define ROUNDS 6      /* a block laid anew may free the next one */

enum { ROW = 3 * sizeof(double), BLOCK_SIDE = LONGEST_RUN + 2 * WIDEST + 1 };

static qm_vec quad_normal(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    const qm_vec corner[4] = {qm_grid_at(grid, i, j), qm_grid_at(grid, i + 1, j),
                              qm_grid_at(grid, i + 1, j + 1), qm_grid_at(grid, i, j + 1)};
    return qm_quad_normal(corner);
}

/** A row or column of quads that crosses a quad, and the place of the quad in it. */
typedef struct quad_line {
    const qm_patch_grid *grid;
    uint32_t across, place, count;
    bool is_row;
} quad_line;

static qm_vec normal_at(const quad_line *line, uint32_t place)
{
    return line->is_row ? quad_normal(line->grid, place, line->across)
                        : quad_normal(line->grid, line->across, place);
}

/**
 * Length of the run of turned quads that starts at a quad; 0 for none. The quads before and after a run look
 * the same way, which those on both sides of a ridge do not.
 */
static uint32_t run_length(const quad_line *line)
{
    if (line->place == 0) return 0;
    qm_vec before = normal_at(line, line->place - 1), last = normal_at(line, line->place);
    if (!qm_quads_look_apart(before, last)) return 0;
    for (uint32_t length = 1; length <= LONGEST_RUN && line->place + length < line->count; length++) {
        qm_vec next = normal_at(line, line->place + length);
        if (qm_quads_look_apart(last, next)) return qm_vec_dot(before, next) > 0.0 ? length : 0;
        last = next;
    }
    return 0;
}

static uint32_t run_at(const qm_patch_grid *grid, uint32_t i, uint32_t j, bool along_row)
{
    quad_line line = {grid, along_row ? j : i, along_row ? i : j, along_row ? grid->columns : grid->rows,
                      along_row};
    return run_length(&line);
}

static qm_vertex_block block_around(const qm_patch_grid *grid, const qm_vertex_block *inner, uint32_t reach)
{
    const uint32_t most[2] = {grid->columns, grid->rows};
    qm_vertex_block out;
    for (int k = 0; k < 2; k++) {
        out.low[k] = inner->low[k] > reach ? inner->low[k] - reach : 0;
        out.high[k] = inner->high[k] + reach < most[k] ? inner->high[k] + reach : most[k];
    }
    return out;
}

static bool is_folded(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    return !(qm_grid_quad_sine(grid, i, j) > 0.0);
}

/** True when a quad looks apart from three or more of those beside it: on a ridge none does. */
static bool sticks_out(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    qm_vec here = quad_normal(grid, i, j);
    int apart = 0;
    for (int way = 0; way < 4; way++) {
        uint32_t column = way == 0 ? i - 1 : way == 1 ? i + 1 : i; /* beyond all columns where i is 0 */
        uint32_t row = way == 2 ? j - 1 : way == 3 ? j + 1 : j;
        if (column < grid->columns && row < grid->rows)
            apart += qm_quads_look_apart(here, quad_normal(grid, column, row));
    }
    return apart >= 3;
}

/** Quads of a block that are folded, stick out, or start a turned run. */
static size_t count_bad(const qm_patch_grid *grid, const qm_vertex_block *b)
{
    size_t bad = 0;
    for (uint32_t j = b->low[1]; j < b->high[1]; j++)
        for (uint32_t i = b->low[0]; i < b->high[0]; i++)
            bad += (size_t)is_folded(grid, i, j) + (size_t)sticks_out(grid, i, j) +
                   (size_t)(run_at(grid, i, j, true) > 0) + (size_t)(run_at(grid, i, j, false) > 0);
    return bad;
}

/** Lays the inside of a block anew, on the surface or between its border alone; keeps it when fewer quads are
 * bad then, in and around it. */
static bool lay_anew(const qm_source *source, const qm_patch_grid *grid, const qm_vertex_block *b, bool pulls)
{
    double saved[BLOCK_SIDE][3 * BLOCK_SIDE];
    size_t width = b->high[0] - b->low[0] - 1;
    qm_vertex_block seen = block_around(grid, b, LONGEST_RUN + 1);
    size_t before = count_bad(grid, &seen);
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++)
        memcpy(saved[j - b->low[1]], qm_grid_vertex(grid, b->low[0] + 1, j), width * ROW);
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++) {
        for (uint32_t i = b->low[0] + 1; i < b->high[0]; i++) {
            qm_vec place = qm_grid_coons(grid, b, i, j);
            if (pulls)
                qm_source_place(source, place, qm_grid_vertex(grid, i, j));
            else
                qm_vec_store(qm_grid_vertex(grid, i, j), place);
        }
    }
    if (count_bad(grid, &seen) < before) return true;
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++)
        memcpy(qm_grid_vertex(grid, b->low[0] + 1, j), saved[j - b->low[1]], width * ROW);
    return false;
}

static bool unturn_block(const qm_source *source, const qm_patch_grid *grid, const qm_vertex_block *run,
                         uint32_t widest, bool pulls)
{
    for (uint32_t reach = 1; reach <= widest; reach *= 2) {
        qm_vertex_block b = block_around(grid, run, reach);
        if (lay_anew(source, grid, &b, pulls)) return true;
    }
    return false;
}

/** Whether a quad sticks out is asked of point sets alone. They may have too few points there, or too much
 * noise, to tell where the surface lies, so that at last a small block is laid off it. */
static bool unturn_quad(const qm_source *source, const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    uint32_t across = run_at(grid, i, j, true), down = run_at(grid, i, j, false);
    bool is_turned = across > 0 || down > 0 || is_folded(grid, i, j);
    if (!is_turned && !(source->is_cloud && sticks_out(grid, i, j))) return false;
    qm_vertex_block run = {{i, j}, {i + (across > 0 ? across : 1), j + (down > 0 ? down : 1)}};
    if (unturn_block(source, grid, &run, is_turned ? WIDEST : WIDEST_OFF, true)) return true;
    return source->is_cloud && unturn_block(source, grid, &run, is_turned ? WIDEST : WIDEST_OFF, false);
}

static bool unturn_round(const qm_source *source, const qm_patch_grid *grid)
{
    bool changed = false;
    for (uint32_t j = 0; j < grid->rows; j++)
        for (uint32_t i = 0; i < grid->columns; i++)
            changed |= unturn_quad(source, grid, i, j);
    return changed;
}

bool qm_grid_unturn(const qm_source *source, const qm_patch_grid *grid)
{
    bool changed = false;
    for (int round = 0; round < ROUNDS && unturn_round(source, grid); round++)
        changed = true;
    return changed;
}
