/* Lists of pairs of faces against sorting them one by one. */
#include <stdlib.h>

#include "bvh/kernel.h"
#include "check.h"
#include "collide/collide_pairs.h"
#include "random.h"

static int compare_numbers(const void *x, const void *y)
{
    const uint64_t a = *(const uint64_t *)x, b = *(const uint64_t *)y;
    return (a > b) - (a < b);
}

static void a_few_numbers_are_sorted(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        for (int count = 0; count <= QM_SORT_SMALL_MAX; count++) {
            for (int run = 0; run < 20; run++) {
                uint64_t numbers[QM_SORT_SMALL_MAX], expected[QM_SORT_SMALL_MAX];
                size_t limit = run % 2 ? 5 : (size_t)1 << 58;
                for (int i = 0; i < count; i++)
                    numbers[i] = expected[i] = qm_random_below(&random, limit);
                qsort(expected, (size_t)count, sizeof *expected, compare_numbers);
                (*kernel)->sort_small(numbers, count);
                if (count > 0) assert_memory_equal(numbers, expected, (size_t)count * sizeof *numbers);
            }
        }
    }
}

/** count pairs of faces up to last, in two lists; a share of them has the same first face. */
static void check_list(qm_context *ctx, qm_random *random, size_t count, const uint32_t last[2],
                       size_t crowd_of_100, int threads)
{
    qm_pair_list list = {0}, other = {0};
    uint64_t *expected = malloc((count + 1) * sizeof *expected);
    assert_non_null(expected);
    for (size_t i = 0; i < count; i++) {
        uint32_t a = qm_random_below(random, 100) < crowd_of_100
                         ? last[0] / 2
                         : (uint32_t)qm_random_below(random, (size_t)last[0] + 1);
        uint32_t b = (uint32_t)qm_random_below(random, (size_t)last[1] + 1);
        expected[i] = (uint64_t)a << 32 | b;
        assert_true(qm_pair_list_add(ctx, i % 3 ? &list : &other, (qm_face_pair){a, b}));
    }
    qm_pair_list_append(&list, &other);
    assert_int_equal(list.count, count);
    qsort(expected, count, sizeof *expected, compare_numbers);
    qm_collide_options options = qm_collide_options_default();
    options.thread_count = threads;
    qm_collision out = {0};
    assert_int_equal(qm_pair_list_finish(ctx, &list, last, &options, &out), QM_OK);
    size_t reported = 0;
    for (size_t i = 0; i < count; i++) {
        if (i > 0 && expected[i] == expected[i - 1]) continue;
        assert_true(reported < out.pair_count);
        assert_int_equal((uint64_t)out.pairs[reported].a << 32 | out.pairs[reported].b, expected[i]);
        reported++;
    }
    assert_int_equal(reported, out.pair_count);
    qm_collide_reset(ctx, &out);
    options.mode = QM_COLLIDE_FIRST;
    assert_int_equal(qm_pair_list_finish(ctx, &list, last, &options, &out), QM_OK);
    assert_int_equal(out.pair_count, count > 0);
    if (count > 0) assert_int_equal((uint64_t)out.pairs[0].a << 32 | out.pairs[0].b, expected[0]);
    qm_collide_reset(ctx, &out);
    qm_pair_list_reset(ctx, &list);
    free(expected);
}

static void pairs_come_once_and_in_order(void **state)
{
    (void)state;
    static const uint32_t last[][2] = {{0, 0}, {0, 300}, {50, 50}, {100000, 70}, {268435455, 268435455}};
    static const size_t counts[] = {0, 1, 2, 100, 3000, 40000};
    qm_context ctx = qm_context_make();
    qm_random random = qm_random_make(qm_check_seed(), 2);
    for (size_t i = 0; i < sizeof last / sizeof *last; i++)
        for (size_t k = 0; k < sizeof counts / sizeof *counts; k++)
            for (size_t crowd = 0; crowd <= 100; crowd += 50)
                check_list(&ctx, &random, counts[k], last[i], crowd, 1 + (int)(k % 2));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_few_numbers_are_sorted),
        cmocka_unit_test(pairs_come_once_and_in_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
