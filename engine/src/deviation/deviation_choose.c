#include "deviation_choose.h"

#include <stdlib.h>

#define KEPT_SHARE 0.7 /* of the accuracy: pieces that together leave no more open are not cut */
#define EXPONENTS 4096 /* of doubles */
#define EXPONENT_BIAS 2100

/** What a piece leaves open of mean, rms, area and distribution, as shares of them. */
static double openness(const qm_piece_bounds *piece, const qm_piece_totals *totals)
{
    double mean = 0.5 * (totals->mean.lower + totals->mean.upper);
    double square = 0.5 * (totals->rms.lower * totals->rms.lower + totals->rms.upper * totals->rms.upper);
    double open = 2.0 * (piece->area_high - piece->area_low);
    if (mean > 0.0) open += (piece->mean_high - piece->mean_low + piece->blur / QM_BLUR_ROOM) / mean;
    if (square > 0.0) open += 0.5 * (piece->square_high - piece->square_low) / square;
    return open / totals->area.upper;
}

static int exponent_of(double open)
{
    int exponent = 0;
    if (open > 0.0) frexp(open, &exponent);
    return open > 0.0 ? (int)qm_clamp(exponent + EXPONENT_BIAS, 0, EXPONENTS - 1) : 0;
}

qm_cut_choice qm_cuts_choose(const qm_source_piece *piece, qm_piece_list pieces,
                             const qm_piece_totals *totals, double accuracy, size_t room)
{
    double open[EXPONENTS] = {0}, sum = 0.0;
    size_t count[EXPONENTS] = {0};
    for (size_t i = 0; i < pieces.count; i++) {
        double here = openness(&pieces.bounds[i], totals);
        int exponent = exponent_of(here);
        sum += here;
        open[exponent] += here;
        count[exponent] += piece[i].depth < QM_PIECE_DEPTH;
    }
    double kept = KEPT_SHARE * fmin(accuracy, sum), rest = sum;
    qm_cut_choice choice = {.exponent = EXPONENTS};
    while (choice.exponent > 1 && rest > kept && choice.count < room) {
        size_t here = count[--choice.exponent], left = room - choice.count;
        choice.at_exponent = here < left ? here : left;
        choice.count += choice.at_exponent;
        rest -= open[choice.exponent];
    }
    return choice;
}

static int compare_openness(const void *a, const void *b)
{
    const qm_open_piece *one = a, *two = b;
    if (one->open != two->open) return one->open > two->open ? -1 : 1;
    return (one->place > two->place) - (one->place < two->place);
}

void qm_cuts_list(const qm_source_piece *piece, qm_piece_list pieces, const qm_piece_totals *totals,
                  qm_cut_choice choice, qm_open_piece *todo)
{
    size_t listed = 0;
    for (size_t i = 0; i < pieces.count; i++) {
        if (piece[i].depth >= QM_PIECE_DEPTH) continue;
        double open = openness(&pieces.bounds[i], totals);
        int exponent = exponent_of(open);
        if (exponent < choice.exponent || (exponent == choice.exponent && choice.at_exponent == 0)) continue;
        if (exponent == choice.exponent) choice.at_exponent--;
        todo[listed++] = (qm_open_piece){i, open};
    }
    qsort(todo, listed, sizeof *todo, compare_openness);
}
