#include "collide_search.h"

#include <string.h>

#include "collide_faces.h"
#include "kernel.h"
#include "tri_tri.h"

#define CACHED_LEAVES 256   /* of each mesh and worker: neighbours in the tree come up again soon */
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
    crew *crew;
    qm_leaf *cache[2];
    qm_pair_list pairs;
    uint64_t least; /* mode first: the least pair so far */
    uint64_t tests, leaf_pairs;
    bool is_done;
} worker;

static void stop_crew(crew *c, qm_status status)
{
    int expected = QM_OK;
    atomic_compare_exchange_strong(&c->status, &expected, (int)status);
}

static const qm_leaf *get_leaf(worker *w, int cache, const qm_bvh *bvh, uint32_t pack)
{
    qm_leaf *leaf = &w->cache[cache][pack % CACHED_LEAVES];
    if (leaf->pack != pack) qm_leaf_fill(bvh, &w->crew->search->bvh[0]->frame, pack, leaf);
    return leaf;
}

/** One mesh needs the second cache only for leaves that want the same place in the first. */
static const qm_leaf *get_second_leaf(worker *w, const qm_leaf *first, uint32_t pack)
{
    const qm_collide_search *search = w->crew->search;
    bool same_cache =
        search->is_self && (pack == first->pack || pack % CACHED_LEAVES != first->pack % CACHED_LEAVES);
    return get_leaf(w, same_cache ? 0 : 1, search->bvh[1], pack);
}

static void load_triangle(const qm_bvh *bvh, const qm_leaf *leaf, int lane, uint32_t index[3],
                          qm_vec corner[3])
{
    for (int i = 0; i < 3; i++) {
        index[i] = leaf->vertex[i][lane];
        corner[i] = qm_vec_load(bvh->mesh.positions + 3 * (size_t)index[i]);
    }
}

/** Two meshes with a corner at the same place: nothing else needs to be looked at. */
static bool corners_coincide(const qm_vec a[3], const qm_vec b[3])
{
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (a[i].x == b[k].x && a[i].y == b[k].y && a[i].z == b[k].z) return true;
    return false;
}

static bool lanes_meet(const qm_collide_search *search, const qm_leaf *p, int i, const qm_leaf *q, int j)
{
    uint32_t a_index[3], b_index[3];
    qm_vec a[3], b[3];
    load_triangle(search->bvh[0], p, i, a_index, a);
    load_triangle(search->bvh[1], q, j, b_index, b);
    if (search->is_self) return qm_tri_tri_cross(a, a_index, b, b_index);
    return corners_coincide(a, b) || qm_tri_tri_meet(a, b);
}

/** Keeps a pair as the mode asks for it; false when the search may end. */
static bool keep_pair(worker *w, uint32_t a, uint32_t b)
{
    crew *c = w->crew;
    const qm_collide_options *options = c->search->options;
    if (options->mode == QM_COLLIDE_FIRST) {
        uint64_t pair = (uint64_t)a << 32 | b;
        w->least = pair < w->least ? pair : w->least;
        return true;
    }
    if (!qm_pair_list_add(c->search->ctx, &w->pairs, a, b)) {
        stop_crew(c, QM_E_NO_MEMORY);
        return false;
    }
    return options->mode == QM_COLLIDE_ALL;
}

/** The faces of two lanes as a pair of faces of the input; false when they are one, or not wanted. */
static bool make_pair(const worker *w, uint32_t face_a, uint32_t face_b, qm_face_pair *out)
{
    const qm_collide_search *search = w->crew->search;
    uint32_t a = qm_mesh_input_face(&search->bvh[0]->mesh, face_a),
             b = qm_mesh_input_face(&search->bvh[1]->mesh, face_b);
    bool turns = search->is_self && a > b;
    *out = (qm_face_pair){turns ? b : a, turns ? a : b};
    return !(search->is_self && a == b) && ((uint64_t)out->a << 32 | out->b) < w->least;
}

/** Tests a pair of lanes exactly; false when the search may end. */
static bool test_lanes(worker *w, const qm_leaf *p, int i, const qm_leaf *q, int j)
{
    const qm_collide_search *search = w->crew->search;
    qm_face_pair pair;
    if (!make_pair(w, search->bvh[0]->lanes[p->pack].face[i], search->bvh[1]->lanes[q->pack].face[j], &pair))
        return true;
    w->tests++;
    return !lanes_meet(search, p, i, q, j) || keep_pair(w, pair.a, pair.b);
}

/** Compares two leaves as triangles; false when the search may end. */
static bool test_leaves(worker *w, uint32_t pack_a, uint32_t pack_b, unsigned moved_a, unsigned moved_b)
{
    const qm_collide_search *search = w->crew->search;
    const qm_leaf *p = get_leaf(w, 0, search->bvh[0], pack_a), *q = get_second_leaf(w, p, pack_b);
    uint8_t near[QM_PACK_LANES];
    if (!w->crew->kernel->compare_leaves(p, q, search->is_self, moved_a, moved_b, near)) return true;
    for (int i = 0; i < QM_PACK_LANES; i++)
        for (unsigned bits = near[i]; bits; bits &= bits - 1)
            if (!test_lanes(w, p, i, q, __builtin_ctz(bits))) return false;
    return true;
}

/* ---- quads as patches ---- */

/** The faces of a pack with their boxes. */
typedef struct pack_faces {
    int count;
    uint32_t face[QM_PACK_LANES];
    unsigned moved; /* bits by place here */
    qm_box box[QM_PACK_LANES];
} pack_faces;

static qm_box face_box(const qm_mesh *mesh, uint32_t face)
{
    qm_vec corner[4];
    if (mesh->face_count == 0) {
        corner[0] = qm_vec_load(mesh->positions + 3 * (size_t)face);
        return qm_vec_box(corner, 1);
    }
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    int count = index[3] == QM_NO_INDEX ? 3 : 4;
    for (int i = 0; i < count; i++)
        corner[i] = qm_vec_load(mesh->positions + 3 * (size_t)index[i]);
    return qm_vec_box(corner, count);
}

static void load_faces(const qm_bvh *bvh, uint32_t pack, unsigned moved, pack_faces *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    out->count = 0;
    out->moved = 0;
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        if (lanes->second >> lane & 1) continue;
        out->face[out->count] = lanes->face[lane];
        out->box[out->count] = face_box(&bvh->mesh, lanes->face[lane]);
        out->moved |= (moved >> lane & 1) << out->count++;
    }
}

static bool boxes_meet(const qm_box *a, const qm_box *b)
{
    for (int k = 0; k < 3; k++)
        if (a->min[k] > b->max[k] || b->min[k] > a->max[k]) return false;
    return true;
}

/** Triangles of a fan share edges as any do; only quads need the patches. */
static bool faces_meet(const qm_collide_search *search, uint32_t face_a, uint32_t face_b)
{
    const qm_mesh *a = &search->bvh[0]->mesh, *b = &search->bvh[1]->mesh;
    qm_faces faces = {.mesh = {a, b}, .face = {face_a, face_b}, .is_self = search->is_self};
    if (qm_faces_have_quad(&faces)) return qm_faces_meet_bilinear(&faces, search->options->tolerance, NULL);
    return qm_faces_meet_exactly(&faces);
}

/** Compares the faces of two packs one by one; false when the search may end. */
static bool test_faces(worker *w, uint32_t pack_a, uint32_t pack_b, unsigned moved_a, unsigned moved_b)
{
    const qm_collide_search *search = w->crew->search;
    pack_faces p, q;
    load_faces(search->bvh[0], pack_a, moved_a, &p);
    load_faces(search->bvh[1], pack_b, moved_b, &q);
    bool is_same = search->is_self && pack_a == pack_b;
    for (int i = 0; i < p.count; i++) {
        for (int j = is_same ? i + 1 : 0; j < q.count; j++) {
            qm_face_pair pair;
            bool has_moved = (p.moved >> i | q.moved >> j) & 1;
            if (!has_moved || !boxes_meet(&p.box[i], &q.box[j])) continue;
            if (!make_pair(w, p.face[i], q.face[j], &pair)) continue;
            w->tests++;
            if (faces_meet(search, p.face[i], q.face[j]) && !keep_pair(w, pair.a, pair.b)) return false;
        }
    }
    return true;
}

/** Adds up the pairs of this pair of leaves with those of all workers, and looks for reasons to stop. */
static bool may_go_on(worker *w, size_t new_pairs)
{
    crew *c = w->crew;
    const qm_collide_search *search = c->search;
    if (new_pairs > 0 &&
        atomic_fetch_add_explicit(&c->pair_count, new_pairs, memory_order_relaxed) + new_pairs >
            search->options->pair_limit)
        stop_crew(c, QM_E_TOO_LARGE);
    if (++w->leaf_pairs % CANCEL_STEP == 0 && qm_context_canceled(search->ctx)) stop_crew(c, QM_E_CANCELED);
    return atomic_load_explicit(&c->status, memory_order_relaxed) == QM_OK;
}

static bool take_leaves(void *user, const qm_node *a, const qm_node *b)
{
    worker *w = user;
    const qm_change_marks *marks = w->crew->search->marks;
    unsigned moved_a = marks ? marks->level[0][a->index] : 0xff,
             moved_b = marks ? marks->level[0][b->index] : 0xff;
    size_t before = w->pairs.count;
    bool goes_on = w->crew->has_patches ? test_faces(w, a->index, b->index, moved_a, moved_b)
                                        : test_leaves(w, a->index, b->index, moved_a, moved_b);
    w->is_done |= !goes_on;
    return may_go_on(w, w->pairs.count - before) && goes_on;
}

static void work_off_tasks(void *data, int index)
{
    crew *c = data;
    worker *w = &c->workers[index];
    qm_descent descent = c->descent;
    descent.take = take_leaves;
    descent.user = w;
    while (!w->is_done && atomic_load(&c->status) == QM_OK) {
        size_t task = atomic_fetch_add(&c->next_task, 1);
        if (task >= c->task_count) break;
        c->kernel->descend(&descent, &c->tasks[task].a, &c->tasks[task].b);
    }
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
            stop_crew(c, QM_E_NO_MEMORY);
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

static bool make_worker(crew *c, worker *w)
{
    *w = (worker){.crew = c, .least = UINT64_MAX};
    for (int side = 0; side < 2; side++) {
        w->cache[side] = qm_context_alloc_aligned(c->search->ctx, CACHED_LEAVES, sizeof **w->cache);
        if (!w->cache[side]) return false;
        for (int i = 0; i < CACHED_LEAVES; i++)
            w->cache[side][i].pack = QM_LEAF_NONE;
    }
    return true;
}

static void free_worker(qm_context *ctx, worker *w)
{
    for (int side = 0; side < 2; side++)
        qm_context_free_aligned(ctx, w->cache[side], CACHED_LEAVES, sizeof **w->cache);
    qm_pair_list_reset(ctx, &w->pairs);
}

static qm_status join(crew *c, int workers, qm_pair_list *list, uint64_t *tests)
{
    qm_context *ctx = c->search->ctx;
    uint64_t least = UINT64_MAX;
    for (int i = 0; i < workers; i++) {
        if (!qm_pair_list_join(ctx, list, &c->workers[i].pairs)) return QM_E_NO_MEMORY;
        least = c->workers[i].least < least ? c->workers[i].least : least;
        *tests += c->workers[i].tests;
    }
    if (least < UINT64_MAX && !qm_pair_list_add(ctx, list, (uint32_t)(least >> 32), (uint32_t)least))
        return QM_E_NO_MEMORY;
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
                          .is_self = search->is_self,
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
