/**
 * budget.c: counts the bytes of blocks against a limit, without a lock.
 */
#include "budget.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "host.h"

/** Reserves bytes of the budget; false if they cannot be made free. */
static bool reserve(qm_budget *budget, size_t more)
{
    size_t used = atomic_load(&budget->used);
    for (;;) {
        if (more <= budget->limit && used <= budget->limit - more) {
            if (atomic_compare_exchange_weak(&budget->used, &used, used + more)) return true;
            continue;
        }
        if (more > budget->limit || !budget->make_room(budget->user)) return false;
        used = atomic_load(&budget->used);
    }
}

static void *resize(void *user, void *block, size_t old_size, size_t new_size)
{
    qm_budget *budget = user;
    if (new_size > old_size && !reserve(budget, new_size - old_size)) return NULL;
    void *moved = qm_host_allocator.resize(qm_host_allocator.user, block, old_size, new_size);
    QM_ASSERT(new_size > old_size || atomic_load(&budget->used) >= old_size - new_size);
    if (!moved && new_size > old_size) atomic_fetch_sub(&budget->used, new_size - old_size);
    if (new_size < old_size && (moved || new_size == 0)) atomic_fetch_sub(&budget->used, old_size - new_size);
    return moved;
}

qm_allocator qm_budget_allocator(qm_budget *budget)
{
    return (qm_allocator){.resize = resize, .user = budget};
}

/** The memory limit of the control group (version 2); SIZE_MAX if there is none. */
static size_t find_group_limit(void)
{
    FILE *file = fopen("/sys/fs/cgroup/memory.max", "re");
    unsigned long long limit;
    bool is_limited = file && fscanf(file, "%llu", &limit) == 1;
    if (file) fclose(file);
    return is_limited ? (size_t)limit : SIZE_MAX;
}

size_t qm_budget_default_limit(void)
{
    size_t machine = (size_t)sysconf(_SC_PHYS_PAGES) * (size_t)sysconf(_SC_PAGESIZE);
    size_t group = find_group_limit();
    return (group < machine ? group : machine) / 2;
}
