/*
 * Settings from flags and environment.
 */
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "check.h"

enum { MOST_ARGUMENTS = 8 };

static qm_config_outcome read_flags(qm_config *config, const char *const *flags)
{
    char *argv[MOST_ARGUMENTS] = {(char *)"quadmeshd"};
    int argc = 1;
    for (; flags[argc - 1]; argc++)
        argv[argc] = (char *)flags[argc - 1];
    return qm_config_read(config, argc, argv);
}

#define READ(config, ...) read_flags(config, (const char *const[]){__VA_ARGS__, NULL})

static void test_defaults(void **state)
{
    (void)state;
    qm_config config;
    assert_int_equal(read_flags(&config, (const char *const[]){NULL}), QM_CONFIG_RUN);
    assert_string_equal(config.listen, "127.0.0.1");
    assert_true(config.port == 7878);
    assert_string_equal(config.log_level, "info");
}

static void test_flags(void **state)
{
    (void)state;
    qm_config config;
    assert_int_equal(READ(&config, "--port", "0", "--data-dir=/some=where", "--listen=::1"), QM_CONFIG_RUN);
    assert_true(config.port == 0);
    assert_string_equal(config.data_dir, "/some=where");
    assert_string_equal(config.listen, "::1");
    assert_int_equal(READ(&config, "--port", "1", "--port=2"), QM_CONFIG_RUN);
    assert_true(config.port == 2);
}

static void test_flags_win_over_the_environment(void **state)
{
    (void)state;
    qm_config config;
    setenv("QUADMESHD_MAX_BODY", "2048", 1);
    setenv("QUADMESHD_PORT", "99", 1);
    assert_int_equal(READ(&config, "--port", "100"), QM_CONFIG_RUN);
    assert_true(config.max_body == 2048);
    assert_true(config.port == 100);
    setenv("QUADMESHD_PORT", "nine", 1);
    assert_int_equal(READ(&config, "--port", "100"), QM_CONFIG_EXIT_USAGE);
    unsetenv("QUADMESHD_MAX_BODY");
    unsetenv("QUADMESHD_PORT");
}

static void test_bad_flags_are_refused(void **state)
{
    (void)state;
    static const char *const flags[][2] = {
        {"--port", "65536"},
        {"--port", "-1"},
        {"--port", "1.5"},
        {"--port", "12x"},
        {"--port", "nan"},
        {"--port", ""},
        {"--nothing", "1"},
        {"port", "1"},
        {"--por", "1"},
        {"--workers", "0"},
        {"--log-format", "xml"},
        {"--log-level", "debug"},
        {"--port=", "--help"},
        {"--listen", "0.0.0.0"},
        {"--listen", "10.0.0.1"},
        {"--listen", "::"},
        {"--listen", "localhost.example"},
    };
    for (size_t i = 0; i < sizeof flags / sizeof flags[0]; i++) {
        qm_config config;
        qm_config_outcome outcome = READ(&config, flags[i][0], flags[i][1]);
        QM_CHECK(outcome == QM_CONFIG_EXIT_USAGE, "%s %s", flags[i][0], flags[i][1]);
    }
    qm_config config;
    assert_int_equal(READ(&config, "--port"), QM_CONFIG_EXIT_USAGE);
}

static void test_other_addresses_with_tokens(void **state)
{
    (void)state;
    qm_config config;
    assert_int_equal(READ(&config, "--listen", "0.0.0.0", "--token-file", "tokens"), QM_CONFIG_RUN);
    assert_string_equal(config.token_file, "tokens");
}

static void test_help_and_version(void **state)
{
    (void)state;
    qm_config config;
    assert_int_equal(READ(&config, "--help"), QM_CONFIG_EXIT_OK);
    assert_int_equal(READ(&config, "--version"), QM_CONFIG_EXIT_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_flags),
        cmocka_unit_test(test_flags_win_over_the_environment),
        cmocka_unit_test(test_bad_flags_are_refused),
        cmocka_unit_test(test_other_addresses_with_tokens),
        cmocka_unit_test(test_help_and_version),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
