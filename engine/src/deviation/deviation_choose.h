/**
 * deviation_choose.h: which pieces are cut next: those that leave most in doubt.
 */
#ifndef QM_DEVIATION_CHOOSE_H
#define QM_DEVIATION_CHOOSE_H

#include "deviation_sum.h"

/** Of a mean, in accuracies: what the functions may leave open in the mean. */
#define QM_BLUR_ROOM 8.0

/** A piece to cut, and what it leaves open. */
typedef struct qm_open_piece {
    size_t place;
    double open;
} qm_open_piece;

/** Which pieces are cut: those that leave more open than an exponent of two says, and of those at it the
 * first few; count of them in all. */
typedef struct qm_cut_choice {
    int exponent;
    size_t count, at_exponent;
} qm_cut_choice;

/**
 * Chooses the pieces that leave most open of mean, rms, area and distribution: the others together leave no
 * more than a share of the accuracy, or room for so many is all that there is. Pieces at their last depth are
 * never chosen.
 */
qm_cut_choice qm_cuts_choose(const qm_source_piece *piece, qm_piece_list pieces,
                             const qm_piece_totals *totals, double accuracy, size_t room);

/** Lists the chosen pieces, those first that leave most open; todo has room for choice.count. */
void qm_cuts_list(const qm_source_piece *piece, qm_piece_list pieces, const qm_piece_totals *totals,
                  qm_cut_choice choice, qm_open_piece *todo);

#endif
