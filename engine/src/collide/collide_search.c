#include "collide_search.h"

#include <string.h>

#include "collide_worker.h"

#define TASKS_PER_WORKER 64 /* pairs of nodes that work is dealt out in */
#define CANCEL_STEP 1024    /* pairs of leaves between looks at the cancel flag */

typedef struct node_pair {
    qm_node a, b;
} node_pair;

/** What all workers share. */
typedef struct crew {
    const qm_collide_search *search;
    const qm_kernel *kernel;
    bool has_patches; /* some face is a quad, to be read as a patch */
    qm_descent descent;
    node_pair *tasks;
    size_t task_count, task_capacity;
    atomic_size_t next_task, pair_count;
    atomic_int status; /* the first that isn't QM_OK ends all */
    struct worker *workers;
} crew;

typedef struct worker {
    qm_collide_worker own;
    crew *crew;
} worker;

/** Adds up the pairs of this pair of leaves with those of all workers, and looks for reasons to stop. */
static bool may_go_on(worker *w, size_t new_pairs)
{
    crew *c = w->crew;
    const qm_collide_search *search = c->search;
    if (new_pairs > 0 &&
        atomic_fetch_add_explicit(&c->pair_count, new_pairs, memory_order_relaxed) + new_pairs >
            search->options->pair_limit)
        qm_collide_stop(&c->status, QM_E_TOO_LARGE);
    if (++w->own.leaf_pairs % CANCEL_STEP == 0 && qm_context_canceled(search->ctx))
        qm_collide_stop(&c->status, QM_E_CANCELED);
    return atomic_load_explicit(&c->status, memory_order_relaxed) == QM_OK;
}

static bool take_leaves(void *user, const qm_node *a, const qm_node *b)
{
    worker *w = user;
    const qm_change_marks *marks = w->crew->search->marks;
    const qm_pack_pair packs = {
        .pack = {a->index, b->index},
        .moved = {marks ? marks->level[0][a->index] : 0xff, marks ? marks->level[0][b->index] : 0xff}};
    size_t before = w->own.pairs.count;
    bool goes_on =
        w->crew->has_patches ? qm_collide_patches(&w->own, &packs) : qm_collide_triangles(&w->own, &packs);
    w->own.is_done |= !goes_on;
    return may_go_on(w, w->own.pairs.count - before) && goes_on;
}

static void work_off_tasks(void *data, int index)
{
    crew *c = data;
    worker *w = &c->workers[index];
    qm_descent descent = c->descent;
    descent.take = take_leaves;
    descent.user = w;
    while (!w->own.is_done && atomic_load(&c->status) == QM_OK) {
        size_t task = atomic_fetch_add(&c->next_task, 1);
        if (task >= c->task_count) break;
        c->kernel->descend(&descent, &c->tasks[task].a, &c->tasks[task].b);
    }
    if (w->own.is_done || atomic_load(&c->status) != QM_OK) return;
    size_t before = w->own.pairs.count;
    qm_collide_decide(&w->own);
    may_go_on(w, w->own.pairs.count - before);
}

/* ---- tasks ---- */

static bool take_task(void *user, const qm_node *a, const qm_node *b)
{
    crew *c = user;
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
    c->tasks[c->task_count++] = (node_pair){*a, *b};
    return true;
}

/** Cuts the work into enough pairs of nodes to keep all workers busy. */
static void deal_tasks(crew *c, int workers)
{
    qm_node a = qm_node_root(c->descent.a), b = qm_node_root(c->descent.b);
    qm_descent descent = c->descent;
    descent.take = take_task;
    descent.user = c;
    int top = a.level > b.level ? a.level : b.level;
    size_t enough = workers > 1 ? (size_t)workers * TASKS_PER_WORKER : 1;
    for (int level = top; level >= 0 && c->task_count < enough; level--) {
        c->task_count = 0;
        descent.stop_level = level;
        if (!c->kernel->descend(&descent, &a, &b)) return;
    }
}

static bool make_worker(crew *c, worker *out)
{
    *out =
        (worker){.own = {.search = c->search, .kernel = c->kernel, .status = &c->status, .least = UINT64_MAX},
                 .crew = c};
    for (int side = 0; side < 2; side++) {
        qm_leaf *cache = qm_context_alloc_aligned(c->search->ctx, QM_CACHED_LEAVES, sizeof *cache);
        if (!cache) return false;
        out->own.cache[side] = cache;
        for (int i = 0; i < QM_CACHED_LEAVES; i++)
            cache[i].pack = QM_LEAF_NONE;
    }
    qm_lane_pairs *waiting = qm_context_alloc_aligned(c->search->ctx, 1, sizeof *waiting);
    if (!waiting) return false;
    memset(waiting, 0, sizeof *waiting); /* lanes of eight that are not there are computed, too */
    out->own.waiting = waiting;
    return true;
}

static void free_worker(qm_context *ctx, worker *w)
{
    for (int side = 0; side < 2; side++)
        qm_context_free_aligned(ctx, w->own.cache[side], QM_CACHED_LEAVES, sizeof **w->own.cache);
    qm_context_free_aligned(ctx, w->own.waiting, 1, sizeof *w->own.waiting);
    qm_pair_list_reset(ctx, &w->own.pairs);
}

static qm_status join(crew *c, int workers, qm_pair_list *list, uint64_t *tests)
{
    uint64_t least = UINT64_MAX;
    for (int i = 0; i < workers; i++) {
        qm_collide_worker *w = &c->workers[i].own;
        qm_pair_list_join(list, &w->pairs);
        least = w->least < least ? w->least : least;
        *tests += w->tests;
    }
    qm_face_pair first = {(uint32_t)(least >> 32), (uint32_t)least};
    if (least < UINT64_MAX && !qm_pair_list_add(c->search->ctx, list, first)) return QM_E_NO_MEMORY;
    return QM_OK;
}

qm_status qm_collide_run(const qm_collide_search *search, qm_pair_list *list, uint64_t *tests)
{
    qm_context *ctx = search->ctx;
    /* Which pair is found soonest must not hang on threads. */
    int workers = search->options->mode == QM_COLLIDE_ANY ? 1 : search->options->thread_count, made = 0;
    crew c = {.search = search,
              .kernel = qm_kernel_get(),
              .has_patches = search->options->quads == QM_QUADS_BILINEAR &&
                             (search->bvh[0]->has_quads || search->bvh[1]->has_quads),
              .descent = {.a = &search->bvh[0]->boxes,
                          .b = &search->bvh[1]->boxes,
                          .change = qm_frame_change_make(&search->bvh[0]->frame, &search->bvh[1]->frame),
                          .is_one = search->kind != QM_COLLIDE_TWO,
                          .marked = search->marks ? search->marks->level : NULL}};
    deal_tasks(&c, workers);
    if (c.task_count < (size_t)workers) workers = c.task_count > 0 ? (int)c.task_count : 1;
    c.workers = qm_context_alloc(ctx, (size_t)workers, sizeof *c.workers);
    bool has_memory = c.workers != NULL;
    while (has_memory && made < workers)
        has_memory = make_worker(&c, &c.workers[made++]);
    if (has_memory) qm_context_parallel(ctx, workers, work_off_tasks, &c);
    qm_status status = has_memory ? (qm_status)atomic_load(&c.status) : QM_E_NO_MEMORY;
    if (status == QM_OK) status = join(&c, workers, list, tests);
    for (int i = 0; i < made; i++)
        free_worker(ctx, &c.workers[i]);
    qm_context_free(ctx, c.workers, (size_t)workers, sizeof *c.workers);
    qm_context_free(ctx, c.tasks, c.task_capacity, sizeof *c.tasks);
    return status;
}
