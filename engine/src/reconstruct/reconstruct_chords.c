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

/** Chords are doubled whose edges are longer. */
static double doubled_length(const qm_reconstruction *r)
{
    return qm_chords_longest_edge(r) * sqrt(0.5);
}

bool qm_chords_can_double(const qm_reconstruction *r, size_t max_quads)
{
    double min_length = doubled_length(r);
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        size_t count = 1;
        for (int k = 0; k < 2; k++) {
            const qm_chord *chord = qm_chord_of_patch(r, p, k);
            count *= edge_length(chord) < min_length ? chord->edges : 2 * chord->edges;
        }
        quads += count;
    }
    return quads <= max_quads;
}

qm_status qm_chords_double(qm_context *ctx, qm_reconstruction *r, qm_reconstruction_record *out)
{
    double min_length = doubled_length(r);
    bool *is_doubled = qm_context_alloc(ctx, r->chord_count, sizeof *is_doubled);
    if (!is_doubled) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
    for (size_t i = 0; i < r->chord_count; i++)
        is_doubled[i] = edge_length(&r->chords[i]) >= min_length;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        out->patches_split += is_doubled[qm_chord_of_patch(r, p, 0) - r->chords] ||
                              is_doubled[qm_chord_of_patch(r, p, 1) - r->chords];
    for (size_t i = 0; i < r->chord_count; i++) {
        qm_chord *chord = &r->chords[i];
        if (!is_doubled[i]) continue;
        out->chords_changed++;
        chord->edges *= 2;
        chord->lattice_edges = chord->edges * ((chord->lattice_edges + chord->edges - 1) / chord->edges);
    }
    qm_context_free(ctx, is_doubled, r->chord_count, sizeof *is_doubled);
    return QM_OK;
}
