/**
 * host.c: the engine's hooks for threads and memory.
 */
#include "host.h"

#include <limits.h>
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* ---- memory ---- */

#define SMALL_PAGE ((size_t)4 << 10)
#define LARGE_PAGE ((size_t)2 << 20)
#define HEAP_RESERVE ((size_t)256 << 20)  /* address space; pages are taken on first use */
#define HEAP_MAX_BLOCK ((size_t)32 << 20) /* glibc maps larger blocks itself, whatever the threshold is */
#define FIRST_BLOCK ((size_t)144 << 10)   /* larger than the free space of a new heap */

static size_t min_mapped = LARGE_PAGE / 2; /* min bytes of a block that is mapped */

/* AddressSanitizer watches blocks of malloc only. */
#ifdef __SANITIZE_ADDRESS__
#define IS_MAPPING false
#else
#define IS_MAPPING true
#endif

static bool is_mapped(size_t size)
{
    return IS_MAPPING && size >= min_mapped;
}

static size_t round_up(size_t size, size_t page)
{
    return (size + page - 1) & ~(page - 1);
}

static size_t mapped_size(size_t size)
{
    return round_up(size, size % LARGE_PAGE >= LARGE_PAGE / 2 ? LARGE_PAGE : SMALL_PAGE);
}

/** Maps one large page too much, and unmaps what lies before the first large page and behind the block. */
static void *map(size_t size)
{
    QM_ASSERT(is_mapped(size));
    size_t length = mapped_size(size);
    char *area = mmap(NULL, length + LARGE_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (area == MAP_FAILED) return NULL;
    size_t before = round_up((uintptr_t)area, LARGE_PAGE) - (uintptr_t)area;
    if (before > 0) munmap(area, before);
    if (before < LARGE_PAGE) munmap(area + before + length, LARGE_PAGE - before);
    madvise(area + before, length, MADV_HUGEPAGE);
    return area + before;
}

static void release(void *block, size_t size)
{
    if (is_mapped(size))
        munmap(block, mapped_size(size));
    else
        free(block);
}

/** Moves a block to or from a mapping. */
static void *copy(void *block, size_t old_size, size_t new_size)
{
    void *copied = is_mapped(new_size) ? map(new_size) : malloc(new_size);
    if (!copied || !block) return copied;
    memcpy(copied, block, old_size < new_size ? old_size : new_size);
    release(block, old_size);
    return copied;
}

/** Resizes a mapped block by moving its pages. */
static void *remap(void *block, size_t old_size, size_t new_size)
{
    size_t old_length = mapped_size(old_size), new_length = mapped_size(new_size);
    if (new_length <= old_length) {
        if (new_length < old_length) munmap((char *)block + new_length, old_length - new_length);
        return block;
    }
    void *larger = map(new_size);
    if (!larger) return NULL;
    if (mremap(block, old_length, old_length, MREMAP_MAYMOVE | MREMAP_FIXED, larger) != MAP_FAILED)
        return larger;
    munmap(larger, new_length);
    return NULL;
}

static void *resize(void *user, void *block, size_t old_size, size_t new_size)
{
    (void)user;
    if (new_size == 0) {
        if (block) release(block, old_size);
        return NULL;
    }
    if (new_size > SIZE_MAX / 2) return NULL; /* rounding up would overflow */
    if (!is_mapped(old_size) && !is_mapped(new_size)) return realloc(block, new_size);
    if (is_mapped(old_size) && is_mapped(new_size)) return remap(block, old_size, new_size);
    return copy(block, old_size, new_size);
}

/** Lets the heap start a little below a large page, so that malloc's first writes leave that page untouched: a page
 * that is in use before madvise stays split into small ones. */
void qm_host_use_large_heap(void)
{
    if (!IS_MAPPING) return;
    const uintptr_t end = (uintptr_t)sbrk(0), page = round_up(end + FIRST_BLOCK, LARGE_PAGE);
    if (sbrk((intptr_t)(page - FIRST_BLOCK - end)) == (void *)-1) return;
    /* One arena, because those of other threads lie elsewhere; freed memory stays in the process. */
    mallopt(M_ARENA_MAX, 1);
    mallopt(M_TRIM_THRESHOLD, INT_MAX);
    mallopt(M_MMAP_THRESHOLD, (int)HEAP_MAX_BLOCK);
    mallopt(M_TOP_PAD, (int)HEAP_RESERVE);
    void *volatile block = malloc(FIRST_BLOCK - SMALL_PAGE);
    free(block);
    mallopt(M_TOP_PAD, (int)LARGE_PAGE);
    const uintptr_t top = (uintptr_t)sbrk(0);
    if (top > page) madvise((void *)page, top - page, MADV_HUGEPAGE);
    min_mapped = HEAP_MAX_BLOCK;
}

void qm_host_return_memory(void)
{
    mallopt(M_MMAP_THRESHOLD, 256 << 10);
}

const qm_allocator qm_host_allocator = {.resize = resize, .user = NULL};

/* ---- threads ----
 *
 * A team of helper threads that outlive a call. The engine runs many short parallel sections one after the other, and
 * to create a thread for each costs more than some of them take. An idle helper spins for a moment, yielding its
 * processor, and then sleeps. A task that its helper has not started when the caller has finished its own goes back to
 * the caller: if the processors are busy, or a helper wakes up late, the caller does not wait for it.
 */

#define SPINS 256      /* of a waiting thread before it sleeps, */
#define SPIN_PAUSES 32 /* pauses in each: a fraction of a millisecond in all */

enum { HELPER_DONE, HELPER_ASSIGNED, HELPER_RUNNING };

typedef struct helper {
    struct helper *next; /* in the list of idle helpers, or of the helpers of a call */
    void (*task)(void *data, int worker);
    void *data;
    int worker;
    atomic_int state;
    atomic_int sleepers; /* threads that wait for changed */
    pthread_mutex_t lock;
    pthread_cond_t changed;
} helper;

/** Helpers live until the process ends; lock guards the list and the count. */
static struct {
    pthread_mutex_t lock;
    helper *idle; /* helpers that no call holds */
    int count;    /* all helpers */
} team = {.lock = PTHREAD_MUTEX_INITIALIZER};

static void spin_pause(void)
{
    for (int i = 0; i < SPIN_PAUSES; i++) {
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#else
        atomic_signal_fence(memory_order_seq_cst);
#endif
    }
}

static bool change_state(helper *h, int from, int to)
{
    return atomic_compare_exchange_strong(&h->state, &from, to);
}

static void set_state(helper *h, int state)
{
    atomic_store(&h->state, state);
    if (atomic_load(&h->sleepers) == 0) return;
    pthread_mutex_lock(&h->lock);
    pthread_cond_broadcast(&h->changed);
    pthread_mutex_unlock(&h->lock);
}

static bool spin_for(helper *h, int state)
{
    for (int i = 0; i < SPINS; i++) {
        if (atomic_load(&h->state) == state) return true;
        spin_pause();
        sched_yield();
    }
    return false;
}

/** Spins again after each sleep: the task that woke the thread may be gone, and another one about to come. */
static void await_state(helper *h, int state)
{
    while (!spin_for(h, state)) {
        pthread_mutex_lock(&h->lock);
        atomic_fetch_add(&h->sleepers, 1);
        if (atomic_load(&h->state) != state) pthread_cond_wait(&h->changed, &h->lock);
        atomic_fetch_sub(&h->sleepers, 1);
        pthread_mutex_unlock(&h->lock);
    }
}

static void *help(void *argument)
{
    helper *h = argument;
    for (;;) {
        await_state(h, HELPER_ASSIGNED);
        if (!change_state(h, HELPER_ASSIGNED, HELPER_RUNNING)) continue;
        h->task(h->data, h->worker);
        set_state(h, HELPER_DONE);
    }
    return NULL;
}

/** A new helper, or NULL if there is no thread or no memory for it. */
static helper *create_helper(void)
{
    helper *h = calloc(1, sizeof *h);
    if (!h) return NULL;
    pthread_mutex_init(&h->lock, NULL);
    pthread_cond_init(&h->changed, NULL);
    pthread_t thread;
    if (pthread_create(&thread, NULL, help, h) == 0) {
        pthread_detach(thread);
        return h;
    }
    pthread_cond_destroy(&h->changed);
    pthread_mutex_destroy(&h->lock);
    free(h);
    return NULL;
}

static helper *take_helper(void)
{
    pthread_mutex_lock(&team.lock);
    helper *h = team.idle;
    if (h)
        team.idle = h->next;
    else if (team.count < QM_HOST_MAX_THREADS && (h = create_helper()))
        team.count++;
    pthread_mutex_unlock(&team.lock);
    return h;
}

static void give_back(helper *h)
{
    QM_ASSERT(atomic_load(&h->state) == HELPER_DONE);
    pthread_mutex_lock(&team.lock);
    h->next = team.idle;
    team.idle = h;
    pthread_mutex_unlock(&team.lock);
}

void qm_host_parallel(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    QM_ASSERT(worker_count >= 1 && task);
    helper *mine = NULL;
    int started = 0;
    while (started + 1 < worker_count) {
        helper *h = take_helper();
        if (!h) break;
        QM_ASSERT(atomic_load(&h->state) == HELPER_DONE);
        h->task = task;
        h->data = data;
        h->worker = ++started;
        h->next = mine;
        mine = h;
        set_state(h, HELPER_ASSIGNED);
    }
    task(data, 0);
    for (int worker = started + 1; worker < worker_count; worker++)
        task(data, worker);
    for (helper *h = mine; h; h = h->next)
        if (change_state(h, HELPER_ASSIGNED, HELPER_DONE)) task(data, h->worker);
    while (mine) {
        helper *h = mine;
        mine = h->next;
        await_state(h, HELPER_DONE);
        give_back(h);
    }
}

int qm_host_thread_count(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > QM_HOST_MAX_THREADS ? QM_HOST_MAX_THREADS : count;
}

qm_context qm_host_context(void)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    ctx.allocator = qm_host_allocator;
    return ctx;
}

/* ---- budget ---- */

/** Reserves bytes of the part of the budget that is free. */
static bool reserve_spare(qm_budget *budget, size_t more)
{
    size_t used = atomic_load(&budget->used);
    while (more <= budget->limit && used <= budget->limit - more)
        if (atomic_compare_exchange_weak(&budget->used, &used, used + more)) return true;
    return false;
}

bool qm_host_budget_reserve(qm_budget *budget, size_t more)
{
    while (!reserve_spare(budget, more)) {
        if (more > budget->limit) return false;
        size_t used = atomic_load(&budget->used);
        if (used <= budget->limit - more) continue;
        size_t free_bytes = used < budget->limit ? budget->limit - used : 0;
        if (!budget->make_room(budget->user, more - free_bytes)) return false;
    }
    return true;
}

void qm_host_budget_release(qm_budget *budget, size_t size)
{
    QM_ASSERT(atomic_load(&budget->used) >= size);
    atomic_fetch_sub(&budget->used, size);
}

bool qm_host_budget_make_room(qm_budget *budget, size_t size)
{
    if (!qm_host_budget_reserve(budget, size)) return false;
    qm_host_budget_release(budget, size);
    return true;
}

static void *resize_within(qm_budget *budget, bool (*reserve)(qm_budget *budget, size_t more), void *block,
                           size_t old_size, size_t new_size)
{
    if (new_size > old_size && !reserve(budget, new_size - old_size)) return NULL;
    void *moved = qm_host_allocator.resize(qm_host_allocator.user, block, old_size, new_size);
    if (!moved && new_size > old_size) qm_host_budget_release(budget, new_size - old_size);
    if (new_size < old_size && (moved || new_size == 0)) qm_host_budget_release(budget, old_size - new_size);
    return moved;
}

static void *budget_resize(void *user, void *block, size_t old_size, size_t new_size)
{
    return resize_within(user, qm_host_budget_reserve, block, old_size, new_size);
}

static void *spare_resize(void *user, void *block, size_t old_size, size_t new_size)
{
    return resize_within(user, reserve_spare, block, old_size, new_size);
}

qm_allocator qm_host_budget_spare_allocator(qm_budget *budget)
{
    return (qm_allocator){.resize = spare_resize, .user = budget};
}

qm_allocator qm_host_budget_allocator(qm_budget *budget)
{
    return (qm_allocator){.resize = budget_resize, .user = budget};
}

/** Lowers a limit to that in a file; one that cannot be read, or is "max", changes nothing. */
static void lower_to(size_t *limit, const char *path)
{
    unsigned long long found;
    FILE *file = fopen(path, "re");
    if (file && fscanf(file, "%llu", &found) == 1 && found < *limit) *limit = (size_t)found;
    if (file) fclose(file);
}

/** Lowers a limit to those of a control group and the groups that it is in; file is the name of the limit. */
static void lower_to_group(size_t *limit, const char *root, char *group, const char *file)
{
    char path[2 * PATH_MAX];
    for (char *end = group + strcspn(group, "\n"); end; end = strrchr(group, '/')) {
        *end = '\0';
        snprintf(path, sizeof path, "%s%s/%s", root, group, file);
        lower_to(limit, path);
    }
}

size_t qm_host_default_budget(void)
{
    size_t limit = (size_t)sysconf(_SC_PHYS_PAGES) * (size_t)sysconf(_SC_PAGESIZE);
    char line[PATH_MAX];
    FILE *groups = fopen("/proc/self/cgroup", "re");
    while (groups && fgets(line, sizeof line, groups)) {
        char *group = strchr(line, '/');
        if (strncmp(line, "0::", strlen("0::")) == 0)
            lower_to_group(&limit, "/sys/fs/cgroup", line + strlen("0::"), "memory.max");
        else if (group && strstr(line, ":memory:"))
            lower_to_group(&limit, "/sys/fs/cgroup/memory", group, "memory.limit_in_bytes");
    }
    if (groups) fclose(groups);
    return limit / 2;
}
