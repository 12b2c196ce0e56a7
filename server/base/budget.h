/**
 * budget.h: an allocator with a limit. An allocation beyond it first asks the owner to free memory, and fails like
 * malloc if the owner cannot.
 */
#ifndef QM_BUDGET_H
#define QM_BUDGET_H

#include <stdatomic.h>

#include "qm/base.h"

typedef struct qm_budget {
    size_t limit; /* bytes */
    atomic_size_t used;
    bool (*make_room)(void *user); /* frees something; false if nothing can be freed. Any thread. */
    void *user;
} qm_budget;

/** qm_host_allocator within the budget, for any thread; blocks are freed through the same allocator. */
qm_allocator qm_budget_allocator(qm_budget *budget);

/** Half of the memory that this process may have: of the machine, or of its control group. */
size_t qm_budget_default_limit(void);

#endif
