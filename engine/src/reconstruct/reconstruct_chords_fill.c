/**
 * reconstruct_chords_fill.c: whole numbers of edges for the chords, where doubling all of them would exceed the limit of quads.
 *
 * The surface lies above an edge of length h by about k h^2 / 8, k being its curvature. So of a patch of area A, across
 * which one edge would be off by s and up which by t, the mean square of the distance is about that of
 *
 *     A (s / m^2 + t / n^2)^2        with m columns and n rows.
 *
 * Chords get edges one after the other, where the sum over all patches falls most for each quad that this adds.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define STRIDE 12       /* a chord of n edges gets n / STRIDE more at once, or one */
#define WORTH_STEP 1.01 /* so many times the quads of the mesh */
/* Height over an edge as long as the diagonal that is added everywhere, so that flat regions get edges too. */
#define FLAT_HEIGHT 0.02

/** Of one patch: its area, and the height of the surface over one edge along its columns and its rows. */
typedef struct patch_need {
    double area, height[2];
} patch_need;

/** The root mean square of the height over one edge across the whole lattice. */
static double mean_height(const qm_lattice *lattice, int direction)
{
    uint32_t di = direction == 0, dj = direction == 1, edges = di ? lattice->columns : lattice->rows;
    double sum = 0.0;
    size_t count = 0;
    for (uint32_t j = dj; j <= lattice->rows - dj; j++) {
        for (uint32_t i = di; i <= lattice->columns - di; i++) {
            qm_vec middle = qm_vec_mix(qm_lattice_at(lattice, i - di, j - dj),
                                       qm_lattice_at(lattice, i + di, j + dj), 0.5);
            qm_vec bend = qm_vec_sub(middle, qm_lattice_at(lattice, i, j));
            double height = fabs(qm_vec_dot(bend, qm_lattice_normal(lattice, i, j))) / 4.0;
            sum += height * height;
            count++;
        }
    }
    return count > 0 ? sqrt(sum / (double)count) * edges * edges : 0.0;
}

static patch_need measure_need(const qm_reconstruction *r, size_t patch)
{
    const qm_lattice *lattice = &r->lattices[patch];
    patch_need need = {0};
    for (uint32_t j = 0; j < lattice->rows; j++)
        for (uint32_t i = 0; i < lattice->columns; i++)
            need.area +=
                0.5 * qm_vec_norm(qm_vec_cross(
                          qm_vec_sub(qm_lattice_at(lattice, i + 1, j + 1), qm_lattice_at(lattice, i, j)),
                          qm_vec_sub(qm_lattice_at(lattice, i, j + 1), qm_lattice_at(lattice, i + 1, j))));
    for (int k = 0; k < 2; k++) {
        double length = qm_chord_of_patch(r, patch, k)->length;
        need.height[k] = mean_height(lattice, k) + FLAT_HEIGHT * length * length / r->surface.diagonal;
    }
    return need;
}

/** The counts that are chosen, and what tells which chord is next. */
typedef struct count_choice {
    const qm_reconstruction *r;
    const patch_need *need;
    const uint32_t *start, *patches; /* of each chord: its patches, those that it crosses twice once */
    uint32_t *edges;
    size_t quads, max_quads;
} count_choice;

static size_t chord_at(const count_choice *c, size_t patch, int direction)
{
    return (size_t)(qm_chord_of_patch(c->r, patch, direction) - c->r->chords);
}

static double patch_error(const count_choice *c, size_t patch)
{
    double error = 0.0;
    for (int k = 0; k < 2; k++) {
        double edges = c->edges[chord_at(c, patch, k)];
        error += c->need[patch].height[k] / (edges * edges);
    }
    return c->need[patch].area * error * error;
}

/** The sums over the patches of a chord, with its present number of edges. */
static void sum_patches(const count_choice *c, size_t chord, double *error, size_t *quads)
{
    *error = 0.0;
    *quads = 0;
    for (uint32_t i = c->start[chord]; i < c->start[chord + 1]; i++) {
        *error += patch_error(c, c->patches[i]);
        *quads += (size_t)c->edges[chord_at(c, c->patches[i], 0)] * c->edges[chord_at(c, c->patches[i], 1)];
    }
}

/** By how much the error falls for each quad when a chord gets more edges; *added are the quads. */
static double gain_of(count_choice *c, size_t chord, uint32_t more, size_t *added)
{
    double before, after;
    size_t quads, quads_after;
    sum_patches(c, chord, &before, &quads);
    c->edges[chord] += more;
    sum_patches(c, chord, &after, &quads_after);
    c->edges[chord] -= more;
    *added = quads_after - quads;
    return (before - after) / (double)*added;
}

/** Gives edges to the chord whose edges gain most, until none fits. */
static void choose_counts(count_choice *c, double *gain)
{
    size_t chords = c->r->chord_count, added;
    for (size_t i = 0; i < chords; i++)
        gain[i] = gain_of(c, i, 1, &added);
    for (;;) {
        size_t best = chords;
        for (size_t i = 0; i < chords; i++)
            if (gain[i] > 0.0 && (best == chords || gain[i] > gain[best])) best = i;
        if (best == chords) return;
        uint32_t more = c->edges[best] / STRIDE > 1 ? c->edges[best] / STRIDE : 1;
        gain_of(c, best, more, &added);
        if (c->quads + added > c->max_quads && more > 1) gain_of(c, best, more = 1, &added);
        if (c->quads + added > c->max_quads) {
            gain[best] = 0.0; /* nor will it fit later */
            continue;
        }
        c->edges[best] += more;
        c->quads += added;
        for (uint32_t i = c->start[best]; i < c->start[best + 1]; i++)
            for (int k = 0; k < 2; k++) {
                size_t crossed = chord_at(c, c->patches[i], k);
                if (gain[crossed] > 0.0) gain[crossed] = gain_of(c, crossed, 1, &added);
            }
    }
}

/** Lists the patches of each chord. */
static void list_patches(const qm_reconstruction *r, uint32_t *start, uint32_t *patches)
{
    memset(start, 0, (r->chord_count + 1) * sizeof *start);
    for (int is_filling = 0; is_filling < 2; is_filling++) {
        for (size_t p = r->layout.patch_count; p-- > 0;) {
            size_t across = (size_t)(qm_chord_of_patch(r, p, 0) - r->chords),
                   up = (size_t)(qm_chord_of_patch(r, p, 1) - r->chords);
            for (int k = 0; k < (across == up ? 1 : 2); k++) {
                uint32_t *entry = &start[k == 0 ? across : up];
                if (is_filling)
                    patches[--*entry] = (uint32_t)p;
                else
                    ++*entry;
            }
        }
        for (size_t i = 1; i <= r->chord_count && !is_filling; i++)
            start[i] += start[i - 1];
    }
}

/** Takes over the chosen counts. Lattices keep about the fineness that they have. */
static void take_counts(qm_reconstruction *r, const uint32_t *edges, qm_reconstruction_record *out)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        for (int k = 0; k < 2; k++)
            if (qm_chord_of_patch(r, p, k)->edges != edges[qm_chord_of_patch(r, p, k) - r->chords]) {
                out->patches_split++;
                break;
            }
    for (size_t i = 0; i < r->chord_count; i++) {
        qm_chord *chord = &r->chords[i];
        out->chords_changed += chord->edges != edges[i];
        uint32_t least = (QM_RECONSTRUCTION_BASE + edges[i] - 1) / edges[i],
                 like = (chord->lattice_edges + edges[i] / 2) / edges[i];
        chord->edges = edges[i];
        chord->lattice_edges = edges[i] * (like > least ? like : least);
    }
}

qm_status qm_chords_fill(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                         qm_reconstruction_record *out)
{
    size_t patches = r->layout.patch_count, chords = r->chord_count;
    patch_need *need = qm_context_alloc(ctx, patches, sizeof *need);
    uint32_t *start = qm_context_alloc(ctx, chords + 1, sizeof *start),
             *list = qm_context_alloc(ctx, 2 * patches, sizeof *list),
             *edges = qm_context_alloc(ctx, chords, sizeof *edges);
    double *gain = qm_context_alloc(ctx, chords, sizeof *gain);
    bool has_memory = need && start && list && edges && gain;
    if (has_memory) {
        for (size_t p = 0; p < patches; p++)
            need[p] = measure_need(r, p);
        for (size_t i = 0; i < chords; i++)
            edges[i] = 1;
        list_patches(r, start, list);
        count_choice choice = {r, need, start, list, edges, patches, max_quads};
        choose_counts(&choice, gain);
        /* Only more quads are another step, so that steps end. */
        if ((double)choice.quads > WORTH_STEP * (double)qm_chords_count_quads(r)) take_counts(r, edges, out);
    }
    qm_context_free(ctx, need, patches, sizeof *need);
    qm_context_free(ctx, start, chords + 1, sizeof *start);
    qm_context_free(ctx, list, 2 * patches, sizeof *list);
    qm_context_free(ctx, edges, chords, sizeof *edges);
    qm_context_free(ctx, gain, chords, sizeof *gain);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout's chords");
}
