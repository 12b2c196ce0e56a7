/* Origins, hosts, entity tags and tokens, as headers have them. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "http/access.h"
#include "mesh/etag.h"

static void test_lists_of_origins(void **state)
{
    (void)state;
    assert_true(qm_access_origin_is_listed("https://a.example", "https://a.example"));
    assert_true(qm_access_origin_is_listed(" http://b , https://a.example,", "https://A.example"));
    assert_true(qm_access_origin_is_listed("*", "null"));
    static const char *const others[] = {"https://a.exampl", "https://a.example.evil", "http://a.example",
                                         ""};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        QM_CHECK(!qm_access_origin_is_listed("https://a.example,http://b", others[i]), "%s", others[i]);
    assert_false(qm_access_origin_is_listed("", "https://a.example"));
}

static void test_an_origin_is_that_of_its_host(void **state)
{
    (void)state;
    assert_true(qm_access_origin_is_host("http://127.0.0.1:7878", "127.0.0.1:7878"));
    assert_true(qm_access_origin_is_host("https://mesh.example", "Mesh.example"));
    assert_false(qm_access_origin_is_host("http://127.0.0.1:7879", "127.0.0.1:7878"));
    assert_false(qm_access_origin_is_host("null", "null"));
    assert_false(qm_access_origin_is_host("http://a", NULL));
}

static void test_hosts(void **state)
{
    (void)state;
    static const char *const plain[] = {
        "", "localhost", "LocalHost:80", "127.0.0.1", "10.0.0.1:7878", "[::1]:7878", "[fe80::1]"};
    static const char *const named[] = {"example.org", "localhost.", "127.0.0.1.example.org:80",
                                        "[::1",        "1.2.3",      "localhost.example.org"};
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++)
        QM_CHECK(qm_access_host_is_plain(plain[i]), "%s", plain[i]);
    for (size_t i = 0; i < sizeof named / sizeof *named; i++)
        QM_CHECK(!qm_access_host_is_plain(named[i]), "%s", named[i]);
    assert_true(qm_access_host_is_plain(NULL));
}

static void test_entity_tags(void **state)
{
    (void)state;
    static const struct {
        const char *list;
        bool strong, weak;
    } cases[] = {
        {NULL, false, false},
        {"", false, false},
        {"*", true, true},
        {"\"a\"", true, true},
        {"W/\"a\"", false, true},
        {" \"b\" , \"a\"", true, true},
        {"\"b\", W/\"a\"", false, true},
        {"\"b\",*", true, true},
        {"a", false, false},
        {"\"a", false, false},
        {"\"aa\", \"\"", false, false},
        {"\"b\" \"a\"", true, true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *list = cases[i].list ? cases[i].list : "(none)";
        QM_CHECK(qm_etag_is_listed(cases[i].list, "\"a\"", false) == cases[i].strong, "%s", list);
        QM_CHECK(qm_etag_is_listed(cases[i].list, "\"a\"", true) == cases[i].weak, "%s", list);
    }
}

/** Loads a file of this text. */
static bool load(qm_tokens *tokens, const char *text, char message[QM_ACCESS_TOKENS_MESSAGE_SIZE])
{
    char path[] = "/tmp/quadmeshd-tokens-XXXXXX";
    int file = mkstemp(path);
    assert_true(file >= 0 && write(file, text, strlen(text)) == (ssize_t)strlen(text));
    close(file);
    bool loaded = qm_access_tokens_load(tokens, path, message);
    unlink(path);
    return loaded;
}

static void test_tokens(void **state)
{
    (void)state;
    char message[QM_ACCESS_TOKENS_MESSAGE_SIZE];
    qm_tokens *tokens = qm_access_tokens_create();
    assert_int_equal(qm_access_tokens_count(tokens), 0);
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer 0123456789abcdef", NULL), QM_SCOPE_NONE);
    assert_true(load(tokens,
                     "# x\n\n read 0123456789abcdef\nwrite\tfedcba9876543210\r\nread same0000same0000\n"
                     "write same0000same0000",
                     message));
    assert_int_equal(qm_access_tokens_count(tokens), 4);
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer 0123456789abcdef", NULL), QM_SCOPE_READ);
    assert_int_equal(qm_access_tokens_check(tokens, "bEARER   fedcba9876543210 ", NULL), QM_SCOPE_WRITE);
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer same0000same0000", NULL), QM_SCOPE_WRITE);
    static const char *const others[] = {"Bearer",
                                         "Bearer ",
                                         "Bearer 0123456789abcde",
                                         "0123456789abcdef",
                                         "Bearer 0123456789abcdef0",
                                         "Basic fedcba9876543210",
                                         ""};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        QM_CHECK(qm_access_tokens_check(tokens, others[i], NULL) == QM_SCOPE_NONE, "%s", others[i]);
    assert_int_equal(qm_access_tokens_check(tokens, NULL, NULL), QM_SCOPE_NONE);
    qm_access_tokens_destroy(tokens);
}

static void test_names_of_tokens(void **state)
{
    (void)state;
    char message[QM_ACCESS_TOKENS_MESSAGE_SIZE], name[QM_ACCESS_NAME_SIZE];
    qm_tokens *tokens = qm_access_tokens_create();
    assert_true(load(tokens, "read 0123456789abcdef ci@host-1\nwrite fedcba9876543210\n", message));
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer 0123456789abcdef", name), QM_SCOPE_READ);
    assert_string_equal(name, "ci@host-1");
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer fedcba9876543210", name), QM_SCOPE_WRITE);
    assert_string_equal(name, "3465f6e6"); /* sha256sum's first digits */
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer fedcba987654321", name), QM_SCOPE_NONE);
    assert_string_equal(name, "");
    qm_access_tokens_destroy(tokens);
}

/** The first file must have a token; a later one without any, or that is gone, leaves no token valid. */
static void test_all_tokens_can_be_revoked(void **state)
{
    (void)state;
    char message[QM_ACCESS_TOKENS_MESSAGE_SIZE];
    for (int gone = 0; gone < 2; gone++) {
        qm_tokens *tokens = qm_access_tokens_create();
        assert_false(load(tokens, "# only\n", message));
        assert_non_null(strstr(message, "no token"));
        assert_false(qm_access_tokens_load(tokens, "/nowhere/at/all", message));
        assert_false(qm_access_tokens_are_needed(tokens));
        assert_true(load(tokens, "write 0123456789abcdef\n", message));
        assert_true(gone ? qm_access_tokens_load(tokens, "/nowhere/at/all", message)
                         : load(tokens, "# none\n", message));
        assert_int_equal(qm_access_tokens_count(tokens), 0);
        assert_true(qm_access_tokens_are_needed(tokens));
        assert_int_equal(qm_access_tokens_check(tokens, "Bearer 0123456789abcdef", NULL), QM_SCOPE_NONE);
        qm_access_tokens_destroy(tokens);
    }
}

static void test_a_faulty_file_changes_nothing(void **state)
{
    (void)state;
    static const struct {
        const char *text, *words;
    } cases[] = {
        {"read 0123456789abcdef\nadmin 0123456789abcdef\n", "line 2 does not start"},
        {"read\n", "line 1 has no token"},
        {"write short\n", "too short"},
        {"write 0123456789abcdef one more\n", "more than"},
        {"write 0123456789abcdef \"one\"\n", "other characters"},
    };
    char message[QM_ACCESS_TOKENS_MESSAGE_SIZE], line[1100] = "write ";
    qm_tokens *tokens = qm_access_tokens_create();
    assert_true(load(tokens, "write 0123456789abcdef\n", message));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        QM_CHECK(!load(tokens, cases[i].text, message), "%s", cases[i].text);
        QM_CHECK(strstr(message, cases[i].words), "%s: %s", cases[i].text, message);
    }
    memset(line + 6, 'x', sizeof line - 7);
    assert_false(load(tokens, line, message));
    assert_non_null(strstr(message, "too long"));
    assert_false(qm_access_tokens_load(tokens, "/dev/null/at/all", message));
    assert_int_equal(qm_access_tokens_check(tokens, "Bearer 0123456789abcdef", NULL), QM_SCOPE_WRITE);
    qm_access_tokens_destroy(tokens);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lists_of_origins),
        cmocka_unit_test(test_an_origin_is_that_of_its_host),
        cmocka_unit_test(test_hosts),
        cmocka_unit_test(test_entity_tags),
        cmocka_unit_test(test_tokens),
        cmocka_unit_test(test_names_of_tokens),
        cmocka_unit_test(test_all_tokens_can_be_revoked),
        cmocka_unit_test(test_a_faulty_file_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
