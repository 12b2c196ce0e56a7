/**
 * reconstruct_chords.c: chords, which are the classes of curves that opposite sides of patches put together.
 * All curves of a chord have equally many edges, so that chords are what a step doubles, those of the longest
 * edges first.
 */
#include "reconstruct_internal.h"

#include "core/union_find.h"

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
        /* Unite the opposite sides of every patch (union-find), and mark the curves that are sides. */
        for (size_t i = 0; i < r->layout.curve_count; i++)
            parent[i] = (uint32_t)i;
        for (size_t p = 0; p < r->layout.patch_count; p++) {
            const uint32_t *side = r->layout.patches[p].side;
            for (int k = 0; k < 4; k++)
                is_used[side[k]] = true;
            for (int k = 0; k < 2; k++)
                qm_union_find_join(parent, side[k], side[k + 2]);
        }
        /* Number the chords by their first curves, so that the order of the layout breaks ties between chords. */
        for (size_t i = 0; i < r->layout.curve_count; i++)
            number[i] = QM_NO_INDEX;
        for (size_t i = 0; i < r->layout.curve_count; i++) {
            r->polylines[i].chord = QM_NO_INDEX;
            if (!is_used[i]) continue;
            uint32_t *chord = &number[qm_union_find_root(parent, (uint32_t)i)];
            if (*chord == QM_NO_INDEX) {
                *chord = (uint32_t)r->chord_count;
                r->chords[r->chord_count++] = (qm_chord){.edges = 1, .lattice_edges = QM_RECONSTRUCTION_BASE};
            }
            r->polylines[i].chord = *chord;
        }
    }
    qm_context_free(ctx, parent, count, sizeof *parent);
    qm_context_free(ctx, number, count, sizeof *number);
    qm_context_free(ctx, is_used, count, sizeof *is_used);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
}

size_t qm_chords_count_quads(const qm_reconstruction *r)
{
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads += (size_t)qm_chord_of_patch(r, p, 0)->edges * qm_chord_of_patch(r, p, 1)->edges;
    return quads;
}

/** The length of the longest line of a lattice along its columns (direction 0) or rows (1). */
static double longest_line(const qm_lattice *lattice, int direction)
{
    uint32_t lines = direction == 0 ? lattice->rows + 1 : lattice->columns + 1;
    uint32_t edges = direction == 0 ? lattice->columns : lattice->rows;
    double longest = 0.0;
    for (uint32_t line = 0; line < lines; line++) {
        double length = 0.0;
        for (uint32_t k = 0; k < edges; k++) {
            const double *from =
                direction == 0 ? qm_lattice_vertex(lattice, k, line) : qm_lattice_vertex(lattice, line, k);
            const double *to = direction == 0 ? qm_lattice_vertex(lattice, k + 1, line)
                                              : qm_lattice_vertex(lattice, line, k + 1);
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
            qm_chord *chord = qm_chord_of_patch(r, p, k);
            chord->length = fmax(chord->length, longest_line(&r->lattices[p], k));
        }
    }
}

void qm_chords_refine_lattices(qm_reconstruction *r, size_t max_quads)
{
    for (;;) {
        qm_chord *longest = &r->chords[0];
        for (size_t i = 1; i < r->chord_count; i++)
            if (r->chords[i].length / r->chords[i].lattice_edges > longest->length / longest->lattice_edges)
                longest = &r->chords[i];
        longest->lattice_edges *= 2;
        size_t quads = 0;
        for (size_t p = 0; p < r->layout.patch_count; p++)
            quads +=
                (size_t)qm_chord_of_patch(r, p, 0)->lattice_edges * qm_chord_of_patch(r, p, 1)->lattice_edges;
        if (quads <= max_quads) continue;
        longest->lattice_edges /= 2;
        return;
    }
}

static double edge_length(const qm_chord *chord)
{
    return chord->length / chord->edges;
}

double qm_chords_longest_edge(const qm_reconstruction *r)
{
    QM_ASSERT(r->chord_count > 0);
    size_t longest = 0;
    for (size_t i = 1; i < r->chord_count; i++)
        if (edge_length(&r->chords[i]) > edge_length(&r->chords[longest])) longest = i;
    return edge_length(&r->chords[longest]);
}

/**
 * Doubles the chords whose edges are longer than the longest over the square root of 2, the longest first. A
 * chord with which the mesh would have more than max_quads is skipped.
 */
static void double_longest(qm_reconstruction *r, size_t max_quads, bool *is_done,
                           qm_reconstruction_record *out)
{
    double min_length = qm_chords_longest_edge(r) * sqrt(0.5);
    for (;;) {
        qm_chord *longest = NULL;
        for (size_t i = 0; i < r->chord_count; i++)
            if (!is_done[i] && (!longest || edge_length(&r->chords[i]) > edge_length(longest)))
                longest = &r->chords[i];
        if (!longest || edge_length(longest) < min_length) return;
        is_done[longest - r->chords] = true;
        longest->edges *= 2;
        if (qm_chords_count_quads(r) > max_quads) {
            longest->edges /= 2;
            continue;
        }
        out->chords_doubled++;
        if (longest->lattice_edges < longest->edges) longest->lattice_edges = longest->edges;
        QM_ASSERT(longest->lattice_edges % longest->edges == 0);
    }
}

qm_status qm_chords_double(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                           qm_reconstruction_record *out)
{
    uint32_t *old_edges = qm_context_alloc(ctx, r->chord_count, sizeof *old_edges);
    bool *is_done = qm_context_alloc(ctx, r->chord_count, sizeof *is_done);
    bool has_memory = old_edges && is_done;
    if (has_memory) {
        for (size_t i = 0; i < r->chord_count; i++) {
            old_edges[i] = r->chords[i].edges;
            is_done[i] = false;
        }
        double_longest(r, max_quads, is_done, out);
        for (size_t p = 0; p < r->layout.patch_count; p++) {
            const qm_chord *across = qm_chord_of_patch(r, p, 0), *up = qm_chord_of_patch(r, p, 1);
            out->patches_split +=
                across->edges != old_edges[across - r->chords] || up->edges != old_edges[up - r->chords];
        }
    }
    qm_context_free(ctx, old_edges, r->chord_count, sizeof *old_edges);
    qm_context_free(ctx, is_done, r->chord_count, sizeof *is_done);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
}
