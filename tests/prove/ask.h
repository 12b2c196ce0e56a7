/**
 * ask.h: one case: a pair of meshes, the queries about it, and whether the engine's answers are true.
 */
#ifndef QM_PROVE_ASK_H
#define QM_PROVE_ASK_H

#include "cases.h"
#include "qm/bvh.h"
#include "wide_surface.h"

#include <stdio.h>

/** What a class has come to so far. */
typedef struct qm_tally {
    uint64_t cases, tries; /* a try is an answer of the engine that was held against a reference */
    uint64_t failures;
    uint64_t open;    /* answers whose reference was too wide to find more than a gross error */
    uint64_t refused; /* calls that gave no answer: scales too different */
} qm_tally;

/** The case that is tested. */
typedef struct qm_trial {
    const char *family; /* the kind of question */
    const qm_case_kind *kind;
    uint64_t seed, index;
    qm_random random;
    qm_pair pair;
    qm_tally *tally;
    bool is_shown; /* failures are printed with their meshes */

    /* Made for the questions: the trees, and both meshes in one frame. */
    qm_context ctx;
    qm_bvh *tree[2];
    qm_wide_frame frame;
    double size; /* of the frame: the meshes are about as large */
} qm_trial;

/** Counts a failure and prints it: the message, how to draw the case again, and the meshes on request. */
void qm_trial_fail(qm_trial *trial, const char *format, ...) __attribute__((format(printf, 2, 3)));

typedef void qm_ask(qm_trial *trial);
qm_ask qm_ask_hausdorff, qm_ask_project, qm_ask_ties, qm_ask_deviation;

#endif
