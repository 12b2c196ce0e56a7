/*
 * Every task that was taken runs once, in the order of the queue, and none is taken after the end.
 */
#include <sched.h>
#include <stdatomic.h>

#include "base/pool.h"
#include "check.h"

enum { TASK_COUNT = 1000 };

typedef struct tally {
    atomic_int runs;
    int order[TASK_COUNT];
} tally;

typedef struct numbered {
    tally *tally;
    int number;
} numbered;

static void note(void *data)
{
    const numbered *task = data;
    task->tally->order[atomic_fetch_add(&task->tally->runs, 1)] = task->number;
}

static void run_all(int thread_count, tally *into)
{
    static numbered tasks[TASK_COUNT];
    qm_pool *pool = qm_pool_create(thread_count, 0);
    assert_non_null(pool);
    for (int i = 0; i < TASK_COUNT; i++) {
        tasks[i] = (numbered){into, i};
        assert_true(qm_pool_submit(pool, "client", note, &tasks[i]));
    }
    qm_pool_close(pool);
    qm_pool_load load = qm_pool_count(pool);
    assert_true(load.running == 0 && load.waiting == 0);
    assert_int_equal(atomic_load(&into->runs), TASK_COUNT);
    assert_false(qm_pool_submit(pool, NULL, note, &tasks[0]));
    qm_pool_destroy(pool);
    assert_int_equal(atomic_load(&into->runs), TASK_COUNT);
}

static void test_one_thread_keeps_the_order(void **state)
{
    (void)state;
    static tally done;
    run_all(1, &done);
    for (int i = 0; i < TASK_COUNT; i++)
        assert_int_equal(done.order[i], i);
}

static void await_start(void *data)
{
    while (!atomic_load((atomic_bool *)data))
        sched_yield();
}

/** One client has queued six tasks when others come with two and one. */
static void test_clients_take_turns(void **state)
{
    (void)state;
    static const char *const clients = "aaaaaabbca";
    static const int expected[] = {0, 6, 8, 1, 7, 2, 3, 4, 5, 9};
    static tally done;
    static numbered tasks[10];
    static char names[10][2];
    static atomic_bool starts;
    qm_pool *pool = qm_pool_create(1, 0);
    assert_true(qm_pool_submit(pool, "a", await_start, &starts));
    while (qm_pool_count(pool).running == 0)
        sched_yield();
    for (int i = 0; i < 10; i++) {
        tasks[i] = (numbered){&done, i};
        names[i][0] = clients[i];
        assert_true(qm_pool_submit(pool, names[i], note, &tasks[i]));
    }
    atomic_store(&starts, true);
    qm_pool_close(pool);
    qm_pool_destroy(pool);
    assert_memory_equal(done.order, expected, sizeof expected);
}

static void test_many_threads_run_each_task_once(void **state)
{
    (void)state;
    static tally done;
    static bool seen[TASK_COUNT];
    run_all(7, &done);
    for (int i = 0; i < TASK_COUNT; i++) {
        assert_false(seen[done.order[i]]);
        seen[done.order[i]] = true;
    }
}

static void test_an_idle_pool_ends(void **state)
{
    (void)state;
    qm_pool *pool = qm_pool_create(3, 1);
    assert_non_null(pool);
    qm_pool_destroy(pool);
    qm_pool_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_thread_keeps_the_order),
        cmocka_unit_test(test_clients_take_turns),
        cmocka_unit_test(test_many_threads_run_each_task_once),
        cmocka_unit_test(test_an_idle_pool_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
