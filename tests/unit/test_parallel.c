/* The team of threads: every worker of a call runs once, beside any other calls, and however long it slept. */
#include <pthread.h>
#include <stdatomic.h>
#include <time.h>

#include "base/host.h"
#include "check.h"
#include "qm/context.h"

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
    qm_host_parallel(NULL, workers, count_call, &t);
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
        qm_host_parallel(NULL, 4, take_a_nap, &t);
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
    qm_host_parallel(NULL, 5, call_inside, &t);
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

#define MOST_BLOCKS 1000

typedef struct block_tally {
    int workers;
    bool first_sleeps;
    atomic_int calls[MOST_BLOCKS];
} block_tally;

static void count_block(void *data, int worker, size_t block)
{
    block_tally *t = data;
    assert_in_range(worker, 0, t->workers - 1);
    struct timespec nap = {.tv_nsec = 5000000};
    if (t->first_sleeps && block == 0) nanosleep(&nap, NULL);
    atomic_fetch_add(&t->calls[block], 1);
}

static void share_and_check(qm_context *ctx, int workers, size_t blocks, bool first_sleeps)
{
    block_tally t = {.workers = workers, .first_sleeps = first_sleeps};
    qm_context_parallel_for(ctx, workers, blocks, count_block, &t);
    for (size_t i = 0; i < MOST_BLOCKS; i++)
        assert_int_equal(atomic_load(&t.calls[i]), i < blocks ? 1 : 0);
}

static void each_block_is_taken_once(void **state)
{
    (void)state;
    qm_context alone = qm_context_make(), together = qm_context_make();
    together.parallel = qm_host_parallel;
    const size_t counts[] = {0, 1, 2, 7, MOST_BLOCKS};
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
        for (int workers = 1; workers <= 5; workers++) {
            share_and_check(&alone, workers, counts[c], false);
            share_and_check(&together, workers, counts[c], true);
        }
        share_and_check(&together, 200, counts[c], false); /* more than have blocks of their own */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_worker_runs_once),           cmocka_unit_test(helpers_wake_up),
        cmocka_unit_test(the_caller_waits_for_all),        cmocka_unit_test(calls_may_lie_inside_calls),
        cmocka_unit_test(calls_may_come_at_the_same_time), cmocka_unit_test(each_block_is_taken_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
