#include "parallel.h"

#include <pthread.h>

#define MAX_THREADS 256

typedef struct assignment {
    void (*task)(void *data, int worker);
    void *data;
    int worker;
} assignment;

static void *run(void *argument)
{
    const assignment *given = argument;
    given->task(given->data, given->worker);
    return NULL;
}

void qm_parallel_run(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    pthread_t threads[MAX_THREADS];
    assignment given[MAX_THREADS];
    int started = 0;
    for (int worker = 1; worker < worker_count && worker <= MAX_THREADS; worker++) {
        given[started] = (assignment){task, data, worker};
        if (pthread_create(&threads[started], NULL, run, &given[started]) != 0) break;
        started++;
    }
    task(data, 0);
    for (int worker = started + 1; worker < worker_count; worker++)
        task(data, worker);
    for (int i = 0; i < started; i++)
        pthread_join(threads[i], NULL);
}
