/**
 * store_postgres_claims.c: the jobs that this process knows to have.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

/** The place of a job; the count when it is not there. Under the lock. */
static size_t find(const struct qm_postgres *postgres, const char *id)
{
    size_t i = 0;
    while (i < postgres->claim_count && strcmp(postgres->claims[i], id) != 0)
        i++;
    return i;
}

/** Makes room for one more. Under the lock. */
static bool grow(struct qm_postgres *postgres)
{
    if (postgres->claim_count < postgres->claim_capacity) return true;
    size_t capacity = 2 * postgres->claim_capacity + 16;
    char(*claims)[QM_ID_SIZE] = realloc(postgres->claims, capacity * sizeof *claims);
    if (!claims) return false;
    postgres->claims = claims;
    postgres->claim_capacity = capacity;
    return true;
}

bool qm_postgres_add_claim(qm_store *store, const char *id)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    bool is_there = find(postgres, id) < postgres->claim_count;
    bool fits = is_there || grow(postgres);
    if (fits && !is_there) snprintf(postgres->claims[postgres->claim_count++], QM_ID_SIZE, "%s", id);
    pthread_mutex_unlock(&postgres->lock);
    return fits;
}

void qm_postgres_remove_claim(qm_store *store, const char *id)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    size_t place = find(postgres, id);
    if (place < postgres->claim_count)
        memmove(postgres->claims[place], postgres->claims[--postgres->claim_count], QM_ID_SIZE);
    pthread_mutex_unlock(&postgres->lock);
}

void qm_postgres_remove_claims(qm_store *store)
{
    pthread_mutex_lock(&store->postgres->lock);
    store->postgres->claim_count = 0;
    pthread_mutex_unlock(&store->postgres->lock);
}

void qm_postgres_write_claims(qm_store *store, qm_text *array)
{
    pthread_mutex_lock(&store->postgres->lock);
    for (size_t i = 0; i < store->postgres->claim_count; i++)
        qm_postgres_write_text(array, store->postgres->claims[i]);
    pthread_mutex_unlock(&store->postgres->lock);
}
