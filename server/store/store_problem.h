/**
 * store_problem.h: what a client is told when a verb of the store has failed.
 */
#ifndef QM_STORE_PROBLEM_H
#define QM_STORE_PROBLEM_H

#include "ops/problem.h"
#include "store.h"

/** The problem of a row that was not found, with the code `none`, or not read; the format names it ("mesh m_7"). */
qm_problem qm_store_read_problem(qm_stored stored, qm_problem_code none, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** The problem of something that was not stored: "the layout". */
qm_problem qm_store_write_problem(qm_stored stored, const char *noun);

#endif
