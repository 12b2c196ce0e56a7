/**
 * collide_search.c: one search: a traversal of both trees at once (kernel->descend) from pairs of nodes with
 * overlapping boxes down to pairs of packs.
 *
 * For several threads the traversal is first made down to a level with enough pairs of nodes; these are the
 * tasks, which the workers take one after the other from a shared counter. Each worker keeps its pairs in a
 * list of its own, and the lists are sorted together, so that the result does not depend on the schedule.
 */
#include "collide_search.h"

#include <string.h>

#define TASKS_PER_WORKER 64 /* pairs of nodes, on average */
#define CANCEL_STEP 1024    /* pairs of leaves between looks at the cancel flag */

typedef struct node_pair {
    qm_node a, b;
} node_pair;

/** The state that all workers share. */
typedef struct shared_state {
    const qm_collide_search *search;
    const qm_kernel *kernel;
    bool has_patches; /* some face is a quad and is read as a bilinear patch */
    qm_dual_traversal descent;
    node_pair *tasks;
    size_t task_count, task_capacity;
    atomic_size_t next_task, pair_count;
    atomic_int status; /* the first that isn't QM_OK ends the search */
    struct worker *workers;
} shared_state;

typedef struct worker {
    qm_collide_worker own;
    shared_state *shared;
} worker;

/** Adds new pairs to the count of all workers and checks the limits; false when the search ends. */
static bool check_limits(worker *w, size_t new_pairs)
{
    shared_state *c = w->shared;
    const qm_collide_search *search = c->search;
    if (new_pairs > 0 &&
        atomic_fetch_add_explicit(&c->pair_count, new_pairs, memory_order_relaxed) + new_pairs >
            search->options->pair_limit)
        qm_collide_stop(&c->status, QM_E_TOO_LARGE);
    if (++w->own.leaf_pairs % CANCEL_STEP == 0 && qm_context_canceled(search->ctx))
        qm_collide_stop(&c->status, QM_E_CANCELED);
    return atomic_load_explicit(&c->status, memory_order_relaxed) == QM_OK;
}

/** Compares two packs that the traversal has reached. */
static bool compare_packs(void *user, const qm_node *a, const qm_node *b)
{
    worker *w = user;
    const qm_motion_marks *marks = w->shared->search->marks;
    const qm_pack_pair packs = {
        .pack = {a->index, b->index},
        .moved = {marks ? marks->level[0][a->index] : 0xff, marks ? marks->level[0][b->index] : 0xff}};
    size_t before = w->own.pairs.count;
    bool goes_on =
        w->shared->has_patches ? qm_collide_patches(&w->own, &packs) : qm_collide_triangles(&w->own, &packs);
    w->own.is_done |= !goes_on;
    return check_limits(w, w->own.pairs.count - before) && goes_on;
}

/** The loop of a worker: traverses one task after the other, then decides the pairs that still wait. */
static void run_worker(void *data, int index)
{
    shared_state *c = data;
    worker *w = &c->workers[index];
    qm_dual_traversal descent = c->descent;
    descent.take = compare_packs;
    descent.user = w;
    while (!w->own.is_done && atomic_load(&c->status) == QM_OK) {
        size_t task = atomic_fetch_add(&c->next_task, 1);
        if (task >= c->task_count) break;
        c->kernel->descend(&descent, &c->tasks[task].a, &c->tasks[task].b);
    }
    if (w->own.is_done || atomic_load(&c->status) != QM_OK) return;
    size_t before = w->own.pairs.count;
    qm_collide_decide(&w->own);
    check_limits(w, w->own.pairs.count - before);
}

/* ---- tasks ---- */

static bool add_task(void *user, const qm_node *a, const qm_node *b)
{
    shared_state *c = user;
    qm_context *ctx = c->search->ctx;
    if (c->task_count == c->task_capacity) {
        size_t capacity = c->task_capacity > 0 ? 2 * c->task_capacity : TASKS_PER_WORKER;
        node_pair *grown = qm_context_resize(ctx, c->tasks, c->task_capacity, capacity, sizeof *grown);
        if (!grown) {
            qm_collide_stop(&c->status, QM_E_NO_MEMORY);
            return false;
        }
        c->tasks = grown;
        c->task_capacity = capacity;
    }
    QM_ASSERT(c->task_count < c->task_capacity);
    c->tasks[c->task_count++] = (node_pair){*a, *b};
    return true;
}

/** Splits the search into tasks, going down level by level until there are enough to keep all workers
 * busy. */
static void split_into_tasks(shared_state *c, int workers)
{
    qm_node a = qm_node_root(c->descent.a), b = qm_node_root(c->descent.b);
    qm_dual_traversal descent = c->descent;
    descent.take = add_task;
    descent.user = c;
    int top = a.level > b.level ? a.level : b.level;
    size_t enough = workers > 1 ? (size_t)workers * TASKS_PER_WORKER : 1;
    for (int level = top; level >= 0 && c->task_count < enough; level--) {
        c->task_count = 0;
        descent.stop_level = level;
        if (!c->kernel->descend(&descent, &a, &b)) return;
    }
}

static bool make_worker(shared_state *c, worker *out)
{
    *out = (worker){
        .own = {.search = c->search, .kernel = c->kernel, .status = &c->status, .first_pair = UINT64_MAX},
        .shared = c};
    for (int side = 0; side < 2; side++) {
        qm_collide_leaf *cache = qm_context_alloc_aligned(c->search->ctx, QM_CACHED_LEAVES, sizeof *cache);
        if (!cache) return false;
        out->own.cache[side] = cache;
        for (int i = 0; i < QM_CACHED_LEAVES; i++)
            cache[i].pack = QM_LEAF_NONE;
    }
    qm_lane_pairs *waiting = qm_context_alloc_aligned(c->search->ctx, 1, sizeof *waiting);
    if (!waiting) return false;
    memset(waiting, 0, sizeof *waiting); /* the kernel computes all eight lanes, also unused ones */
    out->own.waiting = waiting;
    return true;
}

qm_status qm_collide_run(const qm_collide_search *search, qm_pair_list *list, uint64_t *tests)
{
    qm_context *ctx = search->ctx;
    /* Which pair is found first must not depend on the number of threads. */
    int workers = search->options->mode == QM_COLLIDE_ANY ? 1 : search->options->thread_count, made = 0;
    QM_ASSERT(workers >= 1);
    shared_state c = {
        .search = search,
        .kernel = qm_kernel_get(),
        .has_patches = search->options->quads == QM_QUADS_BILINEAR &&
                       (search->bvh[0]->has_quads || search->bvh[1]->has_quads),
        .descent = {.a = &search->bvh[0]->boxes,
                    .b = &search->bvh[1]->boxes,
                    .change = qm_frame_change_make(&search->bvh[0]->frame, &search->bvh[1]->frame),
                    .is_one = search->kind != QM_COLLIDE_TWO,
                    .marked = search->marks ? search->marks->level : NULL}};
    split_into_tasks(&c, workers);
    if (c.task_count < (size_t)workers) workers = c.task_count > 0 ? (int)c.task_count : 1;
    c.workers = qm_context_alloc(ctx, (size_t)workers, sizeof *c.workers);
    bool has_memory = c.workers != NULL;
    while (has_memory && made < workers)
        has_memory = make_worker(&c, &c.workers[made++]);
    if (has_memory) qm_context_parallel(ctx, workers, run_worker, &c);
    qm_status status = has_memory ? (qm_status)atomic_load(&c.status) : QM_E_NO_MEMORY;

    uint64_t first = UINT64_MAX;
    for (int i = 0; i < workers && status == QM_OK; i++) {
        qm_collide_worker *w = &c.workers[i].own;
        qm_pair_list_append(list, &w->pairs);
        first = w->first_pair < first ? w->first_pair : first;
        *tests += w->tests;
    }
    qm_face_pair pair = {(uint32_t)(first >> 32), (uint32_t)first};
    if (first < UINT64_MAX && !qm_pair_list_add(ctx, list, pair)) status = QM_E_NO_MEMORY;

    for (int i = 0; i < made; i++) {
        qm_collide_worker *w = &c.workers[i].own;
        for (int side = 0; side < 2; side++)
            qm_context_free_aligned(ctx, w->cache[side], QM_CACHED_LEAVES, sizeof **w->cache);
        qm_context_free_aligned(ctx, w->waiting, 1, sizeof *w->waiting);
        qm_pair_list_reset(ctx, &w->pairs);
    }
    qm_context_free(ctx, c.workers, (size_t)workers, sizeof *c.workers);
    qm_context_free(ctx, c.tasks, c.task_capacity, sizeof *c.tasks);
    return status;
}
