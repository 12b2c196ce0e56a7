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

/** The longest side pair of each chord, from the lengths of its curves. */
static void measure_chords(qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const uint32_t *side = r->layout.patches[p].side;
        for (int k = 0; k < 2; k++) {
            double length = 0.5 * (qm_curve_length(&r->layout.curves[side[k]]) +
                                   qm_curve_length(&r->layout.curves[side[k + 2]]));
            qm_chord *chord = qm_patch_chord(r, p, k);
            chord->length = fmax(chord->length, length);
        }
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
        measure_chords(r);
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
