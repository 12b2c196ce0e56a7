/**
 * check.h: cmocka with everything it wants included first, and a check that says more than its condition.
 */
#ifndef QM_CHECK_H
#define QM_CHECK_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdbool.h>
#include <stdlib.h>

/** Fails the test with the place, the condition and a printf-style message: give the seed and the values. */
#define QM_CHECK(condition, ...)                                                                             \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            print_error("%s:%d: %s: ", __FILE__, __LINE__, #condition);                                      \
            print_error(__VA_ARGS__);                                                                        \
            print_error("\n");                                                                               \
            fail();                                                                                          \
        }                                                                                                    \
    } while (0)

/** True when the long version of the tests is requested (QM_TEST_LONG=1). */
static inline bool qm_check_long(void)
{
    const char *value = getenv("QM_TEST_LONG");
    return value && value[0] != '\0' && value[0] != '0';
}

/** QM_TEST_SEED moves every random test to other numbers; without it the runs are always the same. */
static inline uint64_t qm_check_seed(void)
{
    const char *value = getenv("QM_TEST_SEED");
    return value ? strtoull(value, NULL, 0) : 1;
}

#endif
