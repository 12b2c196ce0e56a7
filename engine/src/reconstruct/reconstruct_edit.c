/**
 * reconstruct_edit.c: what a reconstruction takes over from the one before its layout was edited.
 */
#include "reconstruct_work.h"

#include <string.h>

enum { ROW = 3 * sizeof(double) };

/** The curve of the old layout with the id of this one; QM_NO_INDEX when it is new. */
static uint32_t old_curve(const qm_reconstruction *r, const qm_reconstruction *old, size_t curve)
{
    return qm_layout_find_curve(&old->layout, r->layout.curves[curve].id);
}

/** True for a curve that runs as it did. */
static bool is_same_curve(const qm_reconstruction *r, const qm_reconstruction *old, size_t curve,
                          uint32_t before)
{
    const qm_curve *a = &r->layout.curves[curve], *b = &old->layout.curves[before];
    return a->point_count == b->point_count && memcmp(a->points, b->points, a->point_count * ROW) == 0;
}

void qm_edit_inherit_counts(qm_reconstruction *r, const qm_reconstruction *old)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        uint32_t before = old_curve(r, old, i);
        if (before == QM_NO_INDEX || r->tracks[i].chord == QM_NO_INDEX) continue;
        uint32_t chord = old->tracks[before].chord;
        if (chord == QM_NO_INDEX) continue;
        qm_chord *own = &r->chords[r->tracks[i].chord];
        if (own->edges < old->chords[chord].edges) own->edges = old->chords[chord].edges;
        if (own->work < old->chords[chord].work) own->work = old->chords[chord].work;
    }
}

void qm_edit_inherit_tracks(qm_reconstruction *r, const qm_reconstruction *old)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        uint32_t before = old_curve(r, old, i);
        if (before == QM_NO_INDEX || !is_same_curve(r, old, i, before)) continue;
        const qm_track *from = &old->tracks[before];
        memcpy(r->tracks[i].points, from->points, from->point_count * ROW);
        memcpy(r->tracks[i].arc, from->arc, from->point_count * sizeof *from->arc);
    }
}

/** By how many sides a patch is turned against one of the old layout whose curves are the same and run as
 * they did; -1 when it is another patch. */
static int find_turn(const qm_reconstruction *r, const qm_layout_patch *patch, const qm_reconstruction *old,
                     const qm_layout_patch *other)
{
    for (int turn = 0; turn < 4; turn++) {
        int same = 0;
        while (same < 4) {
            uint32_t before = old_curve(r, old, patch->side[same]);
            int side = (same + turn) % 4;
            if (before != other->side[side] || patch->against[same] != other->against[side] ||
                !is_same_curve(r, old, patch->side[same], before))
                break;
            same++;
        }
        if (same == 4) return turn;
    }
    return -1;
}

/** Copies a grid that is turned by so many sides; false when its counts differ. */
static bool copy_grid(const qm_patch_grid *from, int turn, qm_patch_grid *to)
{
    bool is_crossed = turn % 2;
    uint32_t columns = is_crossed ? from->rows : from->columns,
             rows = is_crossed ? from->columns : from->rows;
    if (to->columns != columns || to->rows != rows) return false;
    for (uint32_t j = 0; j <= rows; j++) {
        for (uint32_t i = 0; i <= columns; i++) {
            /* The place before each turn; the numbers of the other turns mean nothing and are not used. */
            const uint32_t column[4] = {i, from->columns - j, from->columns - i, j};
            const uint32_t row[4] = {j, i, from->rows - j, from->rows - i};
            size_t place = qm_grid_index(from, column[turn], row[turn]), copy = qm_grid_index(to, i, j);
            memcpy(to->vertices + 3 * copy, from->vertices + 3 * place, ROW);
            to->in_hole[copy] = from->in_hole[place];
        }
    }
    to->is_stale = false;
    return true;
}

size_t qm_edit_keep_grids(qm_reconstruction *r, const qm_reconstruction *old)
{
    size_t redone = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        for (size_t q = 0; q < old->layout.patch_count && r->grids[p].is_stale; q++) {
            int turn = find_turn(r, &r->layout.patches[p], old, &old->layout.patches[q]);
            if (turn >= 0) copy_grid(&old->grids[q], turn, &r->grids[p]);
        }
        redone += r->grids[p].is_stale;
    }
    return redone;
}
