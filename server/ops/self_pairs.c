#include "self_pairs.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define MAX_KEPT (1u << 22) /* pairs: what is more than that costs less to find again than to keep */

/** What is known of one reading. */
typedef struct known {
    bool is_known;
    double tolerance; /* bilinear quads */
    qm_face_pair *pairs;
    size_t pair_count;
    uint32_t *moved; /* vertices since, each once */
    size_t moved_count;
    uint8_t *is_moved; /* by vertex */
} known;

struct qm_self_pairs {
    pthread_mutex_t lock;
    size_t vertex_count;
    known readings[2];
};

static void forget(known *at)
{
    free(at->pairs);
    free(at->moved);
    free(at->is_moved);
    *at = (known){0};
}

qm_self_pairs *qm_self_pairs_create(size_t vertex_count)
{
    qm_self_pairs *memory = calloc(1, sizeof *memory);
    if (!memory) return NULL;
    memory->vertex_count = vertex_count;
    pthread_mutex_init(&memory->lock, NULL);
    return memory;
}

void qm_self_pairs_destroy(qm_self_pairs *memory)
{
    if (!memory) return;
    forget(&memory->readings[0]);
    forget(&memory->readings[1]);
    pthread_mutex_destroy(&memory->lock);
    free(memory);
}

void qm_self_pairs_move(qm_self_pairs *memory, const uint32_t *vertices, size_t count)
{
    pthread_mutex_lock(&memory->lock);
    for (int reading = 0; reading < 2; reading++) {
        known *at = &memory->readings[reading];
        if (!at->is_known) continue;
        if (!vertices) {
            forget(at);
            continue;
        }
        for (size_t i = 0; i < count; i++) {
            if (at->is_moved[vertices[i]]) continue;
            at->is_moved[vertices[i]] = 1;
            at->moved[at->moved_count++] = vertices[i];
        }
    }
    pthread_mutex_unlock(&memory->lock);
}

static void *copy(const void *from, size_t size)
{
    void *block = malloc(size + 1);
    if (block && size > 0) memcpy(block, from, size);
    return block;
}

/** A copy that shares nothing; without memory it knows nothing. */
static known copy_known(const known *at, size_t vertex_count)
{
    known made = *at;
    if (!at->is_known) return (known){0};
    made.pairs = copy(at->pairs, at->pair_count * sizeof *at->pairs);
    made.moved = malloc(vertex_count * sizeof *made.moved + 1);
    made.is_moved = copy(at->is_moved, vertex_count);
    if (made.pairs && made.moved && made.is_moved)
        memcpy(made.moved, at->moved, at->moved_count * sizeof *made.moved);
    else
        forget(&made);
    return made;
}

void qm_self_pairs_inherit(qm_self_pairs *memory, qm_self_pairs *other)
{
    known made[2];
    pthread_mutex_lock(&other->lock);
    for (int reading = 0; reading < 2; reading++)
        made[reading] = copy_known(&other->readings[reading], other->vertex_count);
    pthread_mutex_unlock(&other->lock);
    pthread_mutex_lock(&memory->lock);
    for (int reading = 0; reading < 2; reading++) {
        forget(&memory->readings[reading]);
        memory->readings[reading] = made[reading];
    }
    pthread_mutex_unlock(&memory->lock);
}

void qm_self_pairs_keep(qm_self_pairs *memory, const qm_collide_options *options, const qm_face_pair *pairs,
                        size_t count)
{
    pthread_mutex_lock(&memory->lock);
    known *at = &memory->readings[options->quads];
    forget(at);
    if (count <= MAX_KEPT) {
        *at = (known){.tolerance = options->tolerance, .pair_count = count};
        at->pairs = copy(pairs, count * sizeof *pairs);
        at->moved = malloc(memory->vertex_count * sizeof *at->moved + 1);
        at->is_moved = calloc(memory->vertex_count + 1, 1);
        at->is_known = at->pairs && at->moved && at->is_moved;
        if (!at->is_known) forget(at);
    }
    pthread_mutex_unlock(&memory->lock);
}

bool qm_self_pairs_recall(qm_self_pairs *memory, const qm_collide_options *options, qm_collide_changes *out)
{
    *out = (qm_collide_changes){0};
    pthread_mutex_lock(&memory->lock);
    const known *at = &memory->readings[options->quads];
    bool is_exact = options->quads == QM_QUADS_TRIANGLES;
    if (at->is_known && (is_exact || at->tolerance == options->tolerance)) {
        out->vertices = copy(at->moved, at->moved_count * sizeof *at->moved);
        out->vertex_count = at->moved_count;
        out->pairs = copy(at->pairs, at->pair_count * sizeof *at->pairs);
        out->pair_count = at->pair_count;
    }
    pthread_mutex_unlock(&memory->lock);
    if (out->vertices && out->pairs) return true;
    qm_self_pairs_release(out);
    return false;
}

void qm_self_pairs_release(qm_collide_changes *changes)
{
    free((void *)(uintptr_t)changes->vertices);
    free((void *)(uintptr_t)changes->pairs);
    *changes = (qm_collide_changes){0};
}
