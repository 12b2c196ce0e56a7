/**
 * store_postgres_library.c: loads libpq.
 */
#include "store_postgres_library.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>

#include "base/library.h"

/* The soname since 2005. */
#define LIBRARY "libpq.so.5"

qm_pq_functions qm_pq;
static bool is_loaded;
static char failure[QM_MESSAGE_SIZE];

static void load(void)
{
    void *library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
#define XX(name) &&qm_library_find(library, "PQ" #name, &qm_pq.name)
    is_loaded = library QM_PQ_MAP(XX);
#undef XX
    if (is_loaded) return;
    const char *reason = dlerror();
    snprintf(failure, sizeof failure, "PostgreSQL's client library cannot be loaded (Debian: libpq5): %.180s",
             reason ? reason : LIBRARY);
}

bool qm_postgres_load_library(char message[QM_MESSAGE_SIZE])
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, load);
    if (!is_loaded) snprintf(message, QM_MESSAGE_SIZE, "%s", failure);
    return is_loaded;
}
