#include "reconstruct_work.h"

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

/** Joins the opposite sides of every patch; marks curves that no patch has. */
static void join_sides(const qm_layout *layout, uint32_t *parent, bool *is_used)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        parent[i] = (uint32_t)i;
    for (size_t p = 0; p < layout->patch_count; p++) {
        const uint32_t *side = layout->patches[p].side;
        for (int k = 0; k < 4; k++)
            is_used[side[k]] = true;
        for (int k = 0; k < 2; k++)
            parent[find_root(parent, side[k + 2])] = find_root(parent, side[k]);
    }
}

/** Chords are numbered by their first curve, so that ties between them are broken by the layout's order. */
static void number_chords(qm_reconstruction *r, uint32_t *parent, const bool *is_used, uint32_t *number)
{
    for (size_t i = 0; i < r->layout.curve_count; i++)
        number[i] = QM_NO_INDEX;
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        r->tracks[i].chord = QM_NO_INDEX;
        if (!is_used[i]) continue;
        uint32_t *chord = &number[find_root(parent, (uint32_t)i)];
        if (*chord == QM_NO_INDEX) {
            *chord = (uint32_t)r->chord_count;
            r->chords[r->chord_count++] = (qm_chord){.edges = 1, .work = QM_RECONSTRUCTION_BASE};
        }
        r->tracks[i].chord = *chord;
    }
}

qm_status qm_chords_find(qm_context *ctx, qm_reconstruction *r)
{
    size_t count = r->layout.curve_count;
    uint32_t *parent = qm_context_alloc(ctx, count, sizeof *parent);
    uint32_t *number = qm_context_alloc(ctx, count, sizeof *number);
    bool *is_used = qm_context_alloc(ctx, count, sizeof *is_used);
    bool has_memory = parent && number && is_used;
    if (has_memory) {
        for (size_t i = 0; i < count; i++)
            is_used[i] = false;
        join_sides(&r->layout, parent, is_used);
        number_chords(r, parent, is_used, number);
    }
    qm_context_free(ctx, parent, count, sizeof *parent);
    qm_context_free(ctx, number, count, sizeof *number);
    qm_context_free(ctx, is_used, count, sizeof *is_used);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
}

size_t qm_chords_quads(const qm_reconstruction *r)
{
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads += (size_t)qm_patch_chord(r, p, 0)->edges * qm_patch_chord(r, p, 1)->edges;
    return quads;
}

/** Mean length of the grid lines of a patch that run with its columns (direction 0) or rows (1). */
static double mean_line(const qm_patch_grid *grid, int direction)
{
    uint32_t lines = direction == 0 ? grid->rows + 1 : grid->columns + 1;
    uint32_t edges = direction == 0 ? grid->columns : grid->rows;
    double longest = 0.0;
    for (uint32_t line = 0; line < lines; line++) {
        double length = 0.0;
        for (uint32_t k = 0; k < edges; k++) {
            const double *from =
                direction == 0 ? qm_grid_vertex(grid, k, line) : qm_grid_vertex(grid, line, k);
            const double *to =
                direction == 0 ? qm_grid_vertex(grid, k + 1, line) : qm_grid_vertex(grid, line, k + 1);
            length += qm_vec_distance(qm_vec_load(from), qm_vec_load(to));
        }
        longest = fmax(longest, length);
    }
    return longest;
}

void qm_chords_measure(qm_reconstruction *r)
{
    for (size_t i = 0; i < r->chord_count; i++)
        r->chords[i].length = 0.0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        for (int k = 0; k < 2; k++) {
            qm_chord *chord = qm_patch_chord(r, p, k);
            chord->length = fmax(chord->length, mean_line(&r->grids[p], k));
        }
    }
}

void qm_chords_refine_work(qm_reconstruction *r, size_t max_quads)
{
    for (;;) {
        qm_chord *longest = &r->chords[0];
        for (size_t i = 1; i < r->chord_count; i++)
            if (r->chords[i].length / r->chords[i].work > longest->length / longest->work)
                longest = &r->chords[i];
        longest->work *= 2;
        size_t quads = 0;
        for (size_t p = 0; p < r->layout.patch_count; p++)
            quads += (size_t)qm_patch_chord(r, p, 0)->work * qm_patch_chord(r, p, 1)->work;
        if (quads <= max_quads) continue;
        longest->work /= 2;
        return;
    }
}

static double edge_length(const qm_chord *chord)
{
    return chord->length / chord->edges;
}

/** The chord of the longest edges; of equal ones the first. */
static size_t longest_chord(const qm_reconstruction *r)
{
    size_t longest = 0;
    for (size_t i = 1; i < r->chord_count; i++)
        if (edge_length(&r->chords[i]) > edge_length(&r->chords[longest])) longest = i;
    return longest;
}

double qm_chords_longest(const qm_reconstruction *r)
{
    return edge_length(&r->chords[longest_chord(r)]);
}

/** Doubles a chord unless the mesh would get too large; tells the quads of the mesh afterwards. */
static bool try_doubling(const qm_reconstruction *r, qm_chord *chord, size_t max_quads, size_t *quads)
{
    chord->edges *= 2;
    *quads = qm_chords_quads(r);
    if (*quads <= max_quads) return true;
    chord->edges /= 2;
    return false;
}

static size_t count_split(const qm_reconstruction *r, const uint32_t *before)
{
    size_t split = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        bool is_split = false;
        for (int k = 0; k < 2; k++) {
            const qm_chord *chord = qm_patch_chord(r, p, k);
            is_split |= chord->edges != before[chord - r->chords];
        }
        split += is_split;
    }
    return split;
}

/** Longest first; chords that do not fit are passed over for good. */
static void double_longest(qm_reconstruction *r, size_t max_quads, bool *is_done,
                           qm_reconstruction_record *out)
{
    double limit = qm_chords_longest(r) * sqrt(0.5);
    for (;;) {
        qm_chord *longest = NULL;
        for (size_t i = 0; i < r->chord_count; i++)
            if (!is_done[i] && (!longest || edge_length(&r->chords[i]) > edge_length(longest)))
                longest = &r->chords[i];
        if (!longest || edge_length(longest) < limit) return;
        is_done[longest - r->chords] = true;
        size_t quads;
        if (!try_doubling(r, longest, max_quads, &quads)) continue;
        out->chords_doubled++;
        if (longest->work < longest->edges) longest->work = longest->edges;
    }
}

qm_status qm_chords_double(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                           qm_reconstruction_record *out)
{
    uint32_t *before = qm_context_alloc(ctx, r->chord_count, sizeof *before);
    bool *is_done = qm_context_alloc(ctx, r->chord_count, sizeof *is_done);
    bool has_memory = before && is_done;
    if (has_memory) {
        for (size_t i = 0; i < r->chord_count; i++) {
            before[i] = r->chords[i].edges;
            is_done[i] = false;
        }
        double_longest(r, max_quads, is_done, out);
        out->patches_split = count_split(r, before);
    }
    qm_context_free(ctx, before, r->chord_count, sizeof *before);
    qm_context_free(ctx, is_done, r->chord_count, sizeof *is_done);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
}
