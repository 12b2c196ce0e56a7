/* The budget of memory: counted to the byte, and never passed. */
#include <pthread.h>
#include <string.h>

#include "base/host.h"
#include "check.h"

typedef struct spare {
    qm_allocator allocator;
    void *block[4];
    size_t size[4], count, calls;
} spare;

/** Gives back one block at a time. */
static bool give_back(void *user, size_t missing)
{
    assert_true(missing > 0);
    spare *spares = user;
    spares->calls++;
    if (spares->count == 0) return false;
    size_t last = --spares->count;
    spares->allocator.resize(spares->allocator.user, spares->block[last], spares->size[last], 0);
    return true;
}

static void *grow(const qm_allocator *allocator, void *block, size_t from, size_t to)
{
    return allocator->resize(allocator->user, block, from, to);
}

static void test_bytes_are_counted(void **state)
{
    (void)state;
    spare none = {.count = 0};
    qm_budget budget = {.limit = 1000, .make_room = give_back, .user = &none};
    qm_allocator allocator = qm_host_budget_allocator(&budget);
    char *a = grow(&allocator, NULL, 0, 600);
    assert_non_null(a);
    memset(a, 7, 600);
    assert_null(grow(&allocator, NULL, 0, 401));
    assert_int_equal(budget.used, 600);
    a = grow(&allocator, a, 600, 1000);
    assert_non_null(a);
    assert_int_equal(a[599], 7);
    assert_null(grow(&allocator, a, 1000, 1001));
    assert_null(grow(&allocator, NULL, 0, SIZE_MAX));
    a = grow(&allocator, a, 1000, 10);
    assert_int_equal(budget.used, 10);
    assert_null(grow(&allocator, a, 10, 0));
    assert_int_equal(budget.used, 0);
}

static void test_room_is_made(void **state)
{
    (void)state;
    spare spares = {.count = 0};
    qm_budget budget = {.limit = 1000, .make_room = give_back, .user = &spares};
    qm_allocator allocator = spares.allocator = qm_host_budget_allocator(&budget);
    for (; spares.count < 4; spares.count++) {
        spares.size[spares.count] = 250;
        spares.block[spares.count] = grow(&allocator, NULL, 0, 250);
    }
    /* As many are given back as it takes; none when nothing would help. */
    void *block = grow(&allocator, NULL, 0, 300);
    assert_non_null(block);
    assert_int_equal(spares.count, 2);
    assert_null(grow(&allocator, NULL, 0, 1001));
    assert_int_equal(spares.count, 2);
    assert_null(grow(&allocator, block, 300, 1001));
    assert_null(grow(&allocator, NULL, 0, 800));
    assert_int_equal(spares.count, 0);
    grow(&allocator, block, 300, 0);
    assert_int_equal(budget.used, 0);
}

/** The spare part is that which is free without asking; the room that is made is taken by the next allocation. */
static void test_spare_memory_is_not_asked_for(void **state)
{
    (void)state;
    spare spares = {.count = 0};
    qm_budget budget = {.limit = 1000, .make_room = give_back, .user = &spares};
    qm_allocator allocator = spares.allocator = qm_host_budget_allocator(&budget);
    qm_allocator free_part = qm_host_budget_spare_allocator(&budget);
    for (; spares.count < 3; spares.count++) {
        spares.size[spares.count] = 250;
        spares.block[spares.count] = grow(&allocator, NULL, 0, 250);
    }
    assert_null(grow(&free_part, NULL, 0, 251));
    assert_null(grow(&free_part, NULL, 0, SIZE_MAX));
    assert_int_equal(spares.calls, 0);
    assert_false(qm_host_budget_make_room(&budget, 1001));
    assert_int_equal(spares.count, 3);
    assert_true(qm_host_budget_make_room(&budget, 600));
    assert_int_equal(spares.count, 1);
    assert_int_equal(budget.used, 250);
    size_t calls = spares.calls;
    void *block = grow(&free_part, NULL, 0, 600);
    assert_non_null(block);
    assert_int_equal(spares.calls, calls);
    assert_null(grow(&allocator, block, 600, 0)); /* both count in one budget */
    assert_int_equal(budget.used, 250);
    assert_true(give_back(&spares, 1));
    assert_int_equal(budget.used, 0);
}

typedef struct contest {
    qm_allocator allocator;
    qm_budget *budget;
    bool passed;
} contest;

static void *contend(void *user)
{
    contest *c = user;
    for (int i = 0; i < 20000; i++) {
        void *block = grow(&c->allocator, NULL, 0, 40);
        if (atomic_load(&c->budget->used) > c->budget->limit) c->passed = true;
        if (block) grow(&c->allocator, block, 40, 0);
    }
    return NULL;
}

static void test_threads_do_not_pass_the_limit(void **state)
{
    (void)state;
    spare none = {.count = 0};
    qm_budget budget = {.limit = 100, .make_room = give_back, .user = &none};
    contest contests[4];
    pthread_t threads[4];
    for (int i = 0; i < 4; i++) {
        contests[i] = (contest){qm_host_budget_allocator(&budget), &budget, false};
        assert_int_equal(pthread_create(&threads[i], NULL, contend, &contests[i]), 0);
    }
    for (int i = 0; i < 4; i++) {
        pthread_join(threads[i], NULL);
        assert_false(contests[i].passed);
    }
    assert_int_equal(budget.used, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes_are_counted),
        cmocka_unit_test(test_room_is_made),
        cmocka_unit_test(test_spare_memory_is_not_asked_for),
        cmocka_unit_test(test_threads_do_not_pass_the_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
