/**
 * self_pairs.c: cached self-collisions behind one lock.
 */
#include "self_pairs.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define MAX_PAIRS (1u << 22) /* more pairs than this cost less to find again than to keep */

/** The entry of one reading of quads. */
typedef struct cache_entry {
    bool is_valid;
    double tolerance; /* bilinear quads */
    qm_face_pair *pairs;
    size_t pair_count;
    uint32_t *moved; /* vertices moved since, each once */
    size_t moved_count;
    uint8_t *is_moved; /* by vertex */
} cache_entry;

struct qm_self_pairs {
    pthread_mutex_t lock;
    size_t vertex_count;
    cache_entry entries[2];
};

static void clear_entry(cache_entry *at)
{
    free(at->pairs);
    free(at->moved);
    free(at->is_moved);
    *at = (cache_entry){0};
}

qm_self_pairs *qm_self_pairs_create(size_t vertex_count)
{
    qm_self_pairs *cache = calloc(1, sizeof *cache);
    if (!cache) return NULL;
    cache->vertex_count = vertex_count;
    pthread_mutex_init(&cache->lock, NULL);
    return cache;
}

void qm_self_pairs_destroy(qm_self_pairs *cache)
{
    if (!cache) return;
    clear_entry(&cache->entries[0]);
    clear_entry(&cache->entries[1]);
    pthread_mutex_destroy(&cache->lock);
    free(cache);
}

void qm_self_pairs_move(qm_self_pairs *cache, const uint32_t *vertices, size_t count)
{
    pthread_mutex_lock(&cache->lock);
    for (int reading = 0; reading < 2; reading++) {
        cache_entry *at = &cache->entries[reading];
        if (!at->is_valid) continue;
        if (!vertices) {
            clear_entry(at);
            continue;
        }
        for (size_t i = 0; i < count; i++) {
            QM_ASSERT(vertices[i] < cache->vertex_count);
            if (at->is_moved[vertices[i]]) continue;
            at->is_moved[vertices[i]] = 1;
            QM_ASSERT(at->moved_count < cache->vertex_count);
            at->moved[at->moved_count++] = vertices[i];
        }
    }
    pthread_mutex_unlock(&cache->lock);
}

static void *copy(const void *from, size_t size)
{
    void *block = malloc(size + 1);
    if (block && size > 0) memcpy(block, from, size);
    return block;
}

/** A deep copy; invalid if memory runs out. */
static cache_entry copy_entry(const cache_entry *at, size_t vertex_count)
{
    cache_entry result = *at;
    if (!at->is_valid) return (cache_entry){0};
    result.pairs = copy(at->pairs, at->pair_count * sizeof *at->pairs);
    result.moved = malloc(vertex_count * sizeof *result.moved + 1);
    result.is_moved = copy(at->is_moved, vertex_count);
    if (result.pairs && result.moved && result.is_moved)
        memcpy(result.moved, at->moved, at->moved_count * sizeof *result.moved);
    else
        clear_entry(&result);
    return result;
}

void qm_self_pairs_inherit(qm_self_pairs *cache, qm_self_pairs *other)
{
    QM_ASSERT(cache->vertex_count == other->vertex_count);
    cache_entry copies[2];
    pthread_mutex_lock(&other->lock);
    for (int reading = 0; reading < 2; reading++)
        copies[reading] = copy_entry(&other->entries[reading], other->vertex_count);
    pthread_mutex_unlock(&other->lock);
    pthread_mutex_lock(&cache->lock);
    for (int reading = 0; reading < 2; reading++) {
        clear_entry(&cache->entries[reading]);
        cache->entries[reading] = copies[reading];
    }
    pthread_mutex_unlock(&cache->lock);
}

void qm_self_pairs_keep(qm_self_pairs *cache, const qm_collide_options *options, const qm_face_pair *pairs,
                        size_t count)
{
    pthread_mutex_lock(&cache->lock);
    cache_entry *at = &cache->entries[options->quads];
    clear_entry(at);
    if (count <= MAX_PAIRS) {
        *at = (cache_entry){.tolerance = options->tolerance, .pair_count = count};
        at->pairs = copy(pairs, count * sizeof *pairs);
        at->moved = malloc(cache->vertex_count * sizeof *at->moved + 1);
        at->is_moved = calloc(cache->vertex_count + 1, 1);
        at->is_valid = at->pairs && at->moved && at->is_moved;
        if (!at->is_valid) clear_entry(at);
    }
    pthread_mutex_unlock(&cache->lock);
}

bool qm_self_pairs_recall(qm_self_pairs *cache, const qm_collide_options *options, qm_collide_changes *out)
{
    *out = (qm_collide_changes){0};
    pthread_mutex_lock(&cache->lock);
    const cache_entry *at = &cache->entries[options->quads];
    bool is_exact = options->quads == QM_QUADS_TRIANGLES;
    if (at->is_valid && (is_exact || at->tolerance == options->tolerance)) {
        out->vertices = copy(at->moved, at->moved_count * sizeof *at->moved);
        out->vertex_count = at->moved_count;
        out->pairs = copy(at->pairs, at->pair_count * sizeof *at->pairs);
        out->pair_count = at->pair_count;
    }
    pthread_mutex_unlock(&cache->lock);
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
