/* The team of threads: every worker of a call runs once, whoever else calls, and however long it slept. */
#include <pthread.h>
#include <stdatomic.h>
#include <time.h>

#include "check.h"
#include "parallel.h"

#define MOST_WORKERS 300 /* more than there are helpers */

typedef struct tally {
    int workers;
    atomic_int calls[MOST_WORKERS];
} tally;

static void count_call(void *data, int worker)
{
    tally *t = data;
    assert_in_range(worker, 0, t->workers - 1);
    atomic_fetch_add(&t->calls[worker], 1);
}

static void run_and_check(int workers)
{
    tally t = {.workers = workers};
    qm_parallel_run(NULL, workers, count_call, &t);
    for (int i = 0; i < MOST_WORKERS; i++)
        assert_int_equal(atomic_load(&t.calls[i]), i < workers ? 1 : 0);
}

static void each_worker_runs_once(void **state)
{
    (void)state;
    for (int i = 0; i < 2000; i++)
        run_and_check(1 + i % 7);
    run_and_check(MOST_WORKERS);
}

static void helpers_wake_up(void **state)
{
    (void)state;
    for (int i = 0; i < 20; i++) {
        run_and_check(3);
        struct timespec nap = {.tv_nsec = 5000000}; /* far longer than a helper looks out for work */
        nanosleep(&nap, NULL);
    }
}

/** Each takes a while, so that the caller has to sleep until it is done. */
static void take_a_nap(void *data, int worker)
{
    struct timespec nap = {.tv_nsec = worker == 0 ? 0 : 5000000};
    nanosleep(&nap, NULL);
    count_call(data, worker);
}

static void the_caller_waits_for_all(void **state)
{
    (void)state;
    for (int i = 0; i < 10; i++) {
        tally t = {.workers = 4};
        qm_parallel_run(NULL, 4, take_a_nap, &t);
        for (int worker = 0; worker < 4; worker++)
            assert_int_equal(atomic_load(&t.calls[worker]), 1);
    }
}

static void call_inside(void *data, int worker)
{
    count_call(data, worker);
    run_and_check(3);
}

static void calls_may_lie_inside_calls(void **state)
{
    (void)state;
    tally t = {.workers = 5};
    qm_parallel_run(NULL, 5, call_inside, &t);
    for (int worker = 0; worker < 5; worker++)
        assert_int_equal(atomic_load(&t.calls[worker]), 1);
}

static void *call_often(void *unused)
{
    for (int i = 0; i < 500; i++)
        run_and_check(2 + i % 3);
    return unused;
}

static void calls_may_come_at_the_same_time(void **state)
{
    (void)state;
    pthread_t threads[4];
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, call_often, NULL), 0);
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_join(threads[i], NULL), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_worker_runs_once),           cmocka_unit_test(helpers_wake_up),
        cmocka_unit_test(the_caller_waits_for_all),        cmocka_unit_test(calls_may_lie_inside_calls),
        cmocka_unit_test(calls_may_come_at_the_same_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
