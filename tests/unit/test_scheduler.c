/* Tasks of many clients on few workers: order, shares, pauses. Shares are of the time that tasks hold a worker, so that
 * other programs on the machine do not matter. */
#include "check.h"

#include <stdatomic.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "base/clock.h"
#include "base/scheduler.h"
#include "random.h"

/** A task that counts pieces of work until a flag ends it or has done them all. */
typedef struct worker_task {
    qm_turn *turn;
    atomic_bool is_ended;
    atomic_bool stop;
    uint64_t limit;              /* pieces; 0: until stop */
    atomic_uint_fast64_t done;   /* pieces */
    atomic_uint_fast64_t held;   /* microseconds in pieces */
    atomic_uint_fast64_t *order; /* counts ends, or NULL */
    uint64_t place;              /* at which it ended */
    int leaves;                  /* times that it gives its worker back */
} worker_task;

/** Computes for about 0.1 ms. */
static void do_piece(worker_task *task)
{
    double start = qm_clock_now_ms(), now = start;
    while (now < start + 0.1)
        now = qm_clock_now_ms();
    atomic_fetch_add(&task->done, 1);
    atomic_fetch_add(&task->held, (uint64_t)(1e3 * (now - start)));
}

static void run(void *data)
{
    worker_task *task = data;
    while (!atomic_load(&task->stop) && (task->limit == 0 || atomic_load(&task->done) < task->limit)) {
        do_piece(task);
        if (task->leaves > 0) {
            task->leaves--;
            qm_scheduler_leave(task->turn);
            usleep(1000);
            qm_scheduler_return(task->turn);
        }
        if (atomic_load(qm_scheduler_flag(task->turn))) qm_scheduler_pause(task->turn);
    }
    if (task->order) task->place = atomic_fetch_add(task->order, 1) + 1;
    atomic_store(&task->is_ended, true);
}

static void submit(qm_scheduler *scheduler, worker_task *task, const char *client, qm_priority priority)
{
    const qm_task submitted = {
        .run = run, .data = task, .threads = 1, .priority = priority, .client = client};
    assert_true(qm_scheduler_submit(scheduler, &submitted, &task->turn));
}

static void wait_for(worker_task *task)
{
    while (!atomic_load(&task->is_ended))
        usleep(500);
}

static void stop_all(worker_task *task, int count)
{
    for (int i = 0; i < count; i++)
        atomic_store(&task[i].stop, true);
}

/** Short tasks end while tasks without an end hold every worker, also after many of them. */
static void test_short_beside_endless(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(2, 32, 0);
    worker_task endless[6] = {0};
    for (int i = 0; i < 6; i++)
        submit(scheduler, &endless[i], "one", QM_PRIORITY_NORMAL);
    for (int i = 0; i < 20; i++) {
        worker_task brief = {.limit = 10, .leaves = i % 3};
        submit(scheduler, &brief, i % 2 ? "one" : "two", QM_PRIORITY_NORMAL);
        wait_for(&brief);
        assert_int_equal(atomic_load(&brief.done), 10);
    }
    assert_true(qm_scheduler_count_paused(scheduler) > 0);
    for (int i = 0; i < 6; i++)
        assert_false(atomic_load(&endless[i].is_ended));
    stop_all(endless, 6);
    qm_scheduler_destroy(scheduler);
    for (int i = 0; i < 6; i++)
        assert_true(atomic_load(&endless[i].is_ended) && atomic_load(&endless[i].done) > 0);
}

/** The time that each client's tasks have held a worker. */
static void measure_shares(int workers, int clients, const int *tasks, double seconds, uint64_t *out)
{
    qm_scheduler *scheduler = qm_scheduler_create(workers, 64, 0);
    static worker_task all[64];
    memset(all, 0, sizeof all);
    int total = 0;
    for (int i = 0; i < clients; i++)
        for (int k = 0; k < tasks[i]; k++) {
            char name[24];
            snprintf(name, sizeof name, "client %d", i);
            submit(scheduler, &all[total++], name, QM_PRIORITY_NORMAL);
        }
    /* The time until all have begun is not counted. */
    usleep(500000);
    uint64_t before[64];
    for (int i = 0; i < total; i++)
        before[i] = atomic_load(&all[i].held);
    usleep((useconds_t)(seconds * 1e6));
    int at = 0;
    for (int i = 0; i < clients; i++) {
        out[i] = 0;
        for (int k = 0; k < tasks[i]; k++, at++)
            out[i] += atomic_load(&all[at].held) - before[at];
    }
    stop_all(all, total);
    qm_scheduler_destroy(scheduler);
}

/** Clients with one, two and four tasks get equal shares of one worker. */
static void test_equal_shares(void **state)
{
    (void)state;
    const int tasks[] = {1, 4, 2, 1, 1};
    uint64_t done[5], least = UINT64_MAX, most = 0;
    measure_shares(1, 5, tasks, 3.0, done);
    for (int i = 0; i < 5; i++) {
        least = done[i] < least ? done[i] : least;
        most = done[i] > most ? done[i] : most;
    }
    QM_CHECK(least > 0 && (double)most < 1.6 * (double)least, "shares from %llu to %llu",
             (unsigned long long)least, (unsigned long long)most);
}

/** Of two endless tasks of one client, the one of high priority gets four times the worker's time. */
static void test_priorities(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(1, 8, 0);
    worker_task task[2] = {0};
    submit(scheduler, &task[0], "one", QM_PRIORITY_NORMAL);
    submit(scheduler, &task[1], "one", QM_PRIORITY_HIGH);
    usleep(2000000);
    double ratio = (double)atomic_load(&task[1].held) / (double)atomic_load(&task[0].held);
    stop_all(task, 2);
    qm_scheduler_destroy(scheduler);
    QM_CHECK(ratio > 2.0 && ratio < 8.0, "ratio %g", ratio);
}

/** Tasks that have not begun go by priority, and by age within one. */
static void test_order(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(1, 1, 0);
    atomic_uint_fast64_t order = 0;
    worker_task first = {0}, task[6];
    submit(scheduler, &first, "one", QM_PRIORITY_NORMAL);
    static const qm_priority priority[] = {QM_PRIORITY_LOW, QM_PRIORITY_NORMAL, QM_PRIORITY_HIGH};
    for (int i = 0; i < 6; i++) {
        task[i] = (worker_task){.limit = 1, .order = &order};
        submit(scheduler, &task[i], "one", priority[i % 3]);
    }
    atomic_store(&first.stop, true);
    qm_scheduler_destroy(scheduler);
    static const uint64_t expected[] = {5, 3, 1, 6, 4, 2};
    for (int i = 0; i < 6; i++)
        assert_int_equal(task[i].place, expected[i]);
}

/** A task that hurries is not paused, and one that waits begins at once. */
static void test_hurry(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(1, 8, 0);
    worker_task endless[3] = {0}, hurried = {.limit = 1000};
    for (int i = 0; i < 3; i++)
        submit(scheduler, &endless[i], "one", QM_PRIORITY_HIGH);
    submit(scheduler, &hurried, "one", QM_PRIORITY_LOW);
    qm_scheduler_hurry(hurried.turn);
    wait_for(&hurried);
    while (qm_scheduler_count_paused(scheduler) < 2)
        usleep(500);
    for (int i = 0; i < 3; i++) {
        atomic_store(&endless[i].stop, true);
        qm_scheduler_hurry(endless[i].turn);
        wait_for(&endless[i]);
    }
    qm_scheduler_destroy(scheduler);
}

/** A task that notes how many others run when it begins and ends. */
typedef struct counted_task {
    double work_ms;
    bool is_suspect;
    atomic_int *runs, *suspects; /* that run now */
    int others;                  /* the most that ran beside it, of those that a suspect must not meet */
} counted_task;

static void run_counted(void *data)
{
    counted_task *task = data;
    atomic_fetch_add(task->runs, 1);
    atomic_fetch_add(task->suspects, task->is_suspect);
    for (int k = 0; k < 2; k++) {
        int others = task->is_suspect ? atomic_load(task->runs) - 1 : atomic_load(task->suspects);
        if (others > task->others) task->others = others;
        if (k == 0) usleep((useconds_t)(1e3 * task->work_ms));
    }
    atomic_fetch_sub(task->suspects, task->is_suspect);
    atomic_fetch_sub(task->runs, 1);
}

/** While the time of a suspect has not passed, nothing runs beside it. */
static void test_suspects_run_alone(void **state)
{
    (void)state;
    enum { COUNT = 60 };
    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_scheduler *scheduler = qm_scheduler_create(4, 16, 0);
    counted_task tasks[COUNT];
    atomic_int runs = 0, suspects = 0;
    for (int i = 0; i < COUNT; i++) {
        tasks[i] =
            (counted_task){.is_suspect = i % 8 == 3 || i % 8 == 4, .runs = &runs, .suspects = &suspects};
        if (qm_random_below(&random, 3) > 0) tasks[i].work_ms = qm_random_range(&random, 0.0, 20.0);
        qm_turn *turn;
        const qm_task task = {.run = run_counted,
                              .data = &tasks[i],
                              .threads = 1,
                              .priority = QM_PRIORITY_NORMAL,
                              .client = i % 3 ? "one" : "two",
                              .alone_ms = tasks[i].is_suspect ? 1e9 : 0.0};
        assert_true(qm_scheduler_submit(scheduler, &task, &turn));
        if (qm_random_below(&random, 4) == 0) usleep(5000);
    }
    qm_scheduler_close(scheduler);
    for (int i = 0; i < COUNT; i++)
        QM_CHECK(tasks[i].others == 0, "seed %llu: task %d ran beside %d",
                 (unsigned long long)qm_check_seed(), i, tasks[i].others);
    qm_scheduler_destroy(scheduler);
}

/** A suspect does not wait for tasks without an end, and others do not wait for one without an end. */
static void test_suspects_do_not_block(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(1, 16, 0);
    worker_task endless = {0}, suspect = {0}, brief = {.limit = 3};
    submit(scheduler, &endless, "one", QM_PRIORITY_NORMAL);
    const qm_task suspected = {.run = run,
                               .data = &suspect,
                               .threads = 1,
                               .priority = QM_PRIORITY_NORMAL,
                               .client = "one",
                               .alone_ms = 30.0};
    assert_true(qm_scheduler_submit(scheduler, &suspected, &suspect.turn));
    submit(scheduler, &brief, "two", QM_PRIORITY_NORMAL);
    wait_for(&brief);
    assert_true(atomic_load(&suspect.done) > 0);
    stop_all(&endless, 1);
    stop_all(&suspect, 1);
    qm_scheduler_destroy(scheduler);
}

/** A closed scheduler runs what it has and takes nothing. */
static void test_close(void **state)
{
    (void)state;
    qm_scheduler *scheduler = qm_scheduler_create(2, 4, 0);
    static worker_task task[200];
    memset(task, 0, sizeof task);
    for (int i = 0; i < 200; i++) {
        task[i].limit = 1;
        submit(scheduler, &task[i], i % 3 ? "one" : "two", QM_PRIORITY_NORMAL);
    }
    qm_scheduler_close(scheduler);
    for (int i = 0; i < 200; i++)
        assert_int_equal(atomic_load(&task[i].done), 1);
    const qm_task late = {
        .run = run, .data = &task[0], .threads = 1, .priority = QM_PRIORITY_NORMAL, .client = "one"};
    qm_turn *turn;
    assert_false(qm_scheduler_submit(scheduler, &late, &turn));
    qm_scheduler_destroy(scheduler);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_short_beside_endless),
        cmocka_unit_test(test_equal_shares),
        cmocka_unit_test(test_priorities),
        cmocka_unit_test(test_order),
        cmocka_unit_test(test_hurry),
        cmocka_unit_test(test_suspects_run_alone),
        cmocka_unit_test(test_suspects_do_not_block),
        cmocka_unit_test(test_close),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
