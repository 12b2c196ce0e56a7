/* Memory on large pages: what is in a block stays as it is, whatever becomes of its size. */
#include "base/host.h"

#include "check.h"
#include "random.h"

#define MEBIBYTE ((size_t)1 << 20)
#define SMALL_PAGE 4096
#define BLOCKS 12
#define STEPS 400

static void *resize(void *block, size_t from, size_t to)
{
    return qm_host_allocator.resize(qm_host_allocator.user, block, from, to);
}

/** Every place of a block says where it is, and in which block. */
static void write_places(unsigned char *block, size_t from, size_t to, unsigned salt)
{
    for (size_t i = from; i < to; i++)
        block[i] = (unsigned char)(i * 131 + (i >> 12) + salt);
}

static void check_places(const unsigned char *block, size_t size, unsigned salt)
{
    for (size_t i = 0; i < size; i++)
        QM_CHECK(block[i] == (unsigned char)(i * 131 + (i >> 12) + salt),
                 "seed %llu: byte %zu of %zu is lost", (unsigned long long)qm_check_seed(), i, size);
}

static void test_contents_stay(void **state)
{
    (void)state;
    /* Round the least size that is mapped, and those at which the last page becomes a large one. */
    static const size_t sizes[] = {
        1,
        MEBIBYTE - 1,
        MEBIBYTE,
        MEBIBYTE + 1,
        2 * MEBIBYTE - SMALL_PAGE,
        2 * MEBIBYTE,
        2 * MEBIBYTE + 1,
        3 * MEBIBYTE - 1,
        3 * MEBIBYTE,
        7 * MEBIBYTE + 12345,
    };
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
            unsigned char *block = resize(NULL, 0, sizes[i]);
            assert_non_null(block);
            write_places(block, 0, sizes[i], 7);
            block = resize(block, sizes[i], sizes[k]);
            assert_non_null(block);
            check_places(block, sizes[i] < sizes[k] ? sizes[i] : sizes[k], 7);
            write_places(block, 0, sizes[k], 9); /* all of it is there */
            assert_null(resize(block, sizes[k], 0));
        }
    }
    assert_null(resize(NULL, 0, 0));
}

/** Mostly of realistic sizes of arrays, from a few bytes to some megabytes. */
static size_t draw_size(qm_random *random)
{
    return 1 + qm_random_below(random, (size_t)1 << (4 + qm_random_below(random, 19)));
}

static void test_blocks_keep_apart(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    unsigned char *block[BLOCKS] = {0};
    size_t size[BLOCKS] = {0};
    for (int step = 0; step < STEPS; step++) {
        unsigned i = (unsigned)qm_random_below(&random, BLOCKS);
        size_t wanted = qm_random_below(&random, 5) == 0 ? 0 : draw_size(&random);
        if (block[i]) check_places(block[i], size[i], i);
        block[i] = resize(block[i], size[i], wanted);
        assert_int_equal(block[i] != NULL, wanted > 0);
        check_places(block[i], size[i] < wanted ? size[i] : wanted, i);
        write_places(block[i], size[i] < wanted ? size[i] : wanted, wanted, i);
        size[i] = wanted;
    }
    for (unsigned i = 0; i < BLOCKS; i++) {
        check_places(block[i], size[i], i);
        resize(block[i], size[i], 0);
    }
}

static void test_what_is_not_to_be_had(void **state)
{
    (void)state;
    unsigned char *block = resize(NULL, 0, 3 * MEBIBYTE);
    assert_non_null(block);
    write_places(block, 0, 3 * MEBIBYTE, 1);
    assert_null(resize(block, 3 * MEBIBYTE, SIZE_MAX - 5));
    assert_null(resize(block, 3 * MEBIBYTE, (size_t)1 << 60));
    check_places(block, 3 * MEBIBYTE, 1);
    resize(block, 3 * MEBIBYTE, 0);
    assert_null(resize(NULL, 0, SIZE_MAX / 2));
}

/** The same blocks once more, which are those of malloc up to larger sizes. */
static void test_heap_of_large_pages(void **state)
{
    qm_host_use_large_heap();
    test_contents_stay(state);
    test_blocks_keep_apart(state);
    unsigned char *block = resize(NULL, 0, 31 * MEBIBYTE);
    assert_non_null(block);
    write_places(block, 0, 31 * MEBIBYTE, 3);
    block = resize(block, 31 * MEBIBYTE, 33 * MEBIBYTE);
    assert_non_null(block);
    check_places(block, 31 * MEBIBYTE, 3);
    write_places(block, 0, 33 * MEBIBYTE, 5);
    block = resize(block, 33 * MEBIBYTE, 5 * MEBIBYTE);
    assert_non_null(block);
    check_places(block, 5 * MEBIBYTE, 5);
    resize(block, 5 * MEBIBYTE, 0);
    test_what_is_not_to_be_had(state);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_contents_stay), cmocka_unit_test(test_blocks_keep_apart),
        cmocka_unit_test(test_what_is_not_to_be_had),
        cmocka_unit_test(test_heap_of_large_pages), /* last, for the heap stays so */
    };
    return cmocka_run_group_tests_name("large_pages", tests, NULL, NULL);
}
