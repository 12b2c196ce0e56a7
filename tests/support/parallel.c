#include "parallel.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

enum { WORKER_LIMIT = 16 };

typedef struct worker {
    pthread_t thread;
    void (*task)(void *data, int worker);
    void *data;
    int index;
} worker;

static void *run(void *argument)
{
    worker *self = argument;
    self->task(self->data, self->index);
    return NULL;
}

void qm_parallel_run(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    worker workers[WORKER_LIMIT];
    if (worker_count > WORKER_LIMIT) {
        fprintf(stderr, "the tests run at most %d workers\n", WORKER_LIMIT);
        abort();
    }
    for (int i = 0; i < worker_count; ++i) {
        workers[i] = (worker){.task = task, .data = data, .index = i};
        if (pthread_create(&workers[i].thread, NULL, run, &workers[i]) != 0) abort();
    }
    for (int i = 0; i < worker_count; ++i)
        pthread_join(workers[i].thread, NULL);
}
