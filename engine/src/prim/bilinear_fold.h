/**
 * bilinear_fold.h: where a bilinear patch is folded, as seen along one direction.
 */
#ifndef QM_BILINEAR_FOLD_H
#define QM_BILINEAR_FOLD_H

#include "bilinear_point.h"

/**
 * The area that the parameters span, J(s, t) = n.(Q_s x Q_t) = at + rise.(s, t): linear, since w x w = 0. Of
 * a flat patch n is a normal, and J changes its sign at the fold.
 */
typedef struct qm_fold_area {
    double at, rise[2];
} qm_fold_area;

static inline qm_vec qm_longer_of(qm_vec a, qm_vec b)
{
    return qm_vec_norm2(b) > qm_vec_norm2(a) ? b : a;
}

static inline qm_fold_area qm_fold_area_make(const qm_bilinear *patch)
{
    qm_vec flat = qm_vec_cross(patch->e1, patch->e2), by_s = qm_vec_cross(patch->e1, patch->w),
           by_t = qm_vec_cross(patch->w, patch->e2);
    qm_vec n = qm_longer_of(flat, qm_longer_of(by_s, by_t));
    return (qm_fold_area){qm_vec_dot(n, flat), {qm_vec_dot(n, by_s), qm_vec_dot(n, by_t)}};
}

static inline double qm_fold_area_at(const qm_fold_area *area, const double x[2])
{
    return area->at + area->rise[0] * x[0] + area->rise[1] * x[1];
}

#endif
