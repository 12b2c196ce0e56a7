/**
 * store_postgres_claims.c: the jobs that this process knows to have.
 *
 * A claim tells the database which jobs these are, and is given the node's other ones, whose claims were not heard of. A job
 * that is submitted for this node while a claim is under way may be in what the claim sees and not in what it told; so a job
 * that was added meanwhile is known until the end of that claim, even if it is over by then.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

/** The place of a job; the count when it is not there. Under the lock. */
static size_t find(const struct qm_postgres *postgres, const char *id)
{
    size_t i = 0;
    while (i < postgres->claim_count && strcmp(postgres->claims[i].id, id) != 0)
        i++;
    return i;
}

/** Makes room for one more. Under the lock. */
static bool grow(struct qm_postgres *postgres)
{
    if (postgres->claim_count < postgres->claim_capacity) return true;
    size_t capacity = 2 * postgres->claim_capacity + 16;
    qm_postgres_claim *claims = realloc(postgres->claims, capacity * sizeof *claims);
    if (!claims) return false;
    postgres->claims = claims;
    postgres->claim_capacity = capacity;
    return true;
}

bool qm_postgres_add_claim(qm_store *store, const char *id)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    size_t place = find(postgres, id);
    bool is_there = place < postgres->claim_count, fits = is_there || grow(postgres);
    if (fits && !is_there) {
        postgres->claim_count++;
        snprintf(postgres->claims[place].id, QM_ID_SIZE, "%s", id);
    }
    if (fits) postgres->claims[place].is_over = false;
    pthread_mutex_unlock(&postgres->lock);
    return fits;
}

void qm_postgres_remove_claim(qm_store *store, const char *id)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    size_t place = find(postgres, id);
    if (place < postgres->claim_count && postgres->is_claiming)
        postgres->claims[place].is_over = true;
    else if (place < postgres->claim_count)
        postgres->claims[place] = postgres->claims[--postgres->claim_count];
    pthread_mutex_unlock(&postgres->lock);
}

void qm_postgres_remove_claims(qm_store *store)
{
    pthread_mutex_lock(&store->postgres->lock);
    store->postgres->claim_count = 0;
    pthread_mutex_unlock(&store->postgres->lock);
}

void qm_postgres_begin_claiming(qm_store *store, qm_text *array)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    QM_ASSERT(!postgres->is_claiming);
    postgres->is_claiming = true;
    for (size_t i = 0; i < postgres->claim_count; i++)
        qm_postgres_write_text(array, postgres->claims[i].id);
    pthread_mutex_unlock(&postgres->lock);
}

bool qm_postgres_has_claim(qm_store *store, const char *id)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    bool is_there = find(postgres, id) < postgres->claim_count;
    pthread_mutex_unlock(&postgres->lock);
    return is_there;
}

void qm_postgres_end_claiming(qm_store *store)
{
    struct qm_postgres *postgres = store->postgres;
    size_t kept = 0;
    pthread_mutex_lock(&postgres->lock);
    for (size_t i = 0; i < postgres->claim_count; i++)
        if (!postgres->claims[i].is_over) postgres->claims[kept++] = postgres->claims[i];
    postgres->claim_count = kept;
    postgres->is_claiming = false;
    pthread_mutex_unlock(&postgres->lock);
}
