#include "parallel.h"

#include <pthread.h>
#include <sched.h>

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

int qm_parallel_available(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > MAX_THREADS ? MAX_THREADS : count;
}
