/* qm_arena: what it holds, as its allocator counts. */
#include "check.h"

#include "core/arena.h"
#include "failing_allocator.h"

#include <string.h>

/** Arrays that grow a little from one rewind to the next do not leave their former selves behind. */
static void growing_blocks_take_no_more_than_a_few_times_the_last(void **state)
{
    (void)state;
    qm_failing_allocator memory = {.fail_at = SIZE_MAX};
    qm_context ctx = qm_context_make();
    ctx.allocator = qm_failing_allocator_hook(&memory);
    qm_arena arena = qm_arena_make(&ctx);
    const size_t first = 100000, rounds = 3000;
    for (size_t round = 0; round < rounds; round++) {
        qm_arena_rewind(&arena);
        unsigned char *block[3];
        for (int i = 0; i < 3; i++) {
            size_t size = first + 100 * round + (size_t)i;
            block[i] = qm_arena_alloc(&arena, size, 1);
            assert_non_null(block[i]);
            memset(block[i], i, size);
        }
        for (int i = 0; i < 3; i++)
            assert_int_equal(block[i][first + 100 * round + (size_t)i - 1], i);
    }
    /* For each block chunks of four sizes an octave, in two octaves: 4 + 4 / 2 times the last one, which is rounded up by a quarter. */
    assert_true(memory.live_bytes <= 8 * 3 * (first + 100 * rounds));
    qm_arena_reset(&arena);
    assert_int_equal(memory.live_blocks, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(growing_blocks_take_no_more_than_a_few_times_the_last),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
