/**
 * budget.h: memory that is counted and ends at a limit. When it would be passed, somebody is asked to give
 * memory back; when nobody can, the allocation fails as if the machine had no more.
 */
#ifndef QM_BUDGET_H
#define QM_BUDGET_H

#include <stdatomic.h>

#include "qm/base.h"

typedef struct qm_budget {
    size_t limit; /* bytes */
    atomic_size_t used;
    bool (*make_room)(void *user); /* gives something back; false when there is nothing. Any thread. */
    void *user;
} qm_budget;

/** qm_large_pages within the budget, for any thread; blocks go back through the same one. */
qm_allocator qm_budget_allocator(qm_budget *budget);

/** Half of the memory that this process may have: of the machine, or of its control group. */
size_t qm_budget_default_limit(void);

#endif
