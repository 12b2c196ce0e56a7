/**
 * cases.h: random pairs of small meshes, by the kind of trouble that they make.
 */
#ifndef QM_PROVE_CASES_H
#define QM_PROVE_CASES_H

#include "random.h"
#include "shapes.h"

typedef struct qm_pair {
    qm_mesh a, b; /* for qm_shape_free */
} qm_pair;

typedef struct qm_case_kind {
    const char *name;
    qm_pair (*draw)(qm_random *random);
    double coarsest;   /* power of ten, of the size: tolerances are not above it; 0: 10^-3 */
    bool only_patches; /* read as bilinear patches only */
    bool only_from_a;  /* from a to b only: b is the trouble, and a lies in it */
    bool has_no_ties;  /* no two of its faces are ever equally near to a point, but by chance */
    int share;         /* of the time, beside 1 of others; 0: 1 */
    bool is_slow;      /* searches over it may not end: they get little work */
} qm_case_kind;

extern const qm_case_kind qm_case_kinds[];
extern const size_t qm_case_kind_count;

/** 10^x for x from low to high. */
double qm_random_power(qm_random *random, double low, double high);

#endif
