/*
 * Which route answers a path, and which of its types a client gets.
 */
#include <string.h>

#include "check.h"
#include "http/media.h"
#include "http/route.h"

static const char *id_of(const char *method, const char *path)
{
    static char ids[2][QM_HASH_SIZE];
    qm_problem problem;
    return qm_route_find(method, path, ids, &problem) ? ids[0] : NULL;
}

static void test_known_paths(void **state)
{
    (void)state;
    assert_string_equal(id_of("GET", "/v1/meshes"), "");
    assert_string_equal(id_of("GET", "/v1/meshes/m_abc2"), "m_abc2");
    assert_string_equal(id_of("HEAD", "/v1/meshes/m_abc2"), "m_abc2");
    assert_string_equal(id_of("GET", "/v1/jobs/j_1/events"), "j_1");
    const char *hash = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    assert_string_equal(id_of("HEAD", "/v1/meshes/sha256:0123456789abcdef0123456789abcdef0123456789abcdef"
                                      "0123456789abcdef"),
                        hash);
    assert_string_equal(id_of("GET", "/"), "");
    assert_string_equal(id_of("GET", "/dashboard/main.js"), "main.js");
    assert_string_equal(id_of("GET", "/dashboard/js/index.js"), "js/index.js");
}

static void test_paths_of_two_names(void **state)
{
    (void)state;
    char ids[2][QM_HASH_SIZE];
    qm_problem problem;
    assert_non_null(qm_route_find("POST", "/v1/layouts/l_1/curves/17/split", ids, &problem));
    assert_string_equal(ids[0], "l_1");
    assert_string_equal(ids[1], "17");
    assert_non_null(qm_route_find("POST", "/v1/layouts/l_1/curves/merge", ids, &problem));
    assert_string_equal(ids[0], "l_1");
    assert_string_equal(ids[1], "");
}

static void test_unknown_paths(void **state)
{
    (void)state;
    static const char *const paths[] = {
        "", "/v1", "/v1/meshes/", "/v1/meshes/a/b", "/v1/meshes/a%", "/v1/meshes/\xc3\xa4", "//v1/meshes",
        "/v1/jobs/j_1/events/", "/v1/jobs//events", "/v1/meshesx", "/dashboard/../etc",
        "/dashboard/js/../../etc", "/dashboard//etc", "/dashboard/.git", "/dashboard/js/.x", "/dashboard/",
        /* one character more than an id may have */
        "/v1/meshes/0123456789012345678901234567890123456789"};
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; i++) {
        char ids[2][QM_HASH_SIZE];
        qm_problem problem;
        QM_CHECK(!qm_route_find("GET", paths[i], ids, &problem), "%s", paths[i]);
        QM_CHECK(problem.code == QM_PROBLEM_NOT_FOUND, "%s: %d", paths[i], (int)problem.code);
    }
}

static void check_allow(const char *method, const char *path, const char *allow)
{
    char ids[2][QM_HASH_SIZE];
    qm_problem problem;
    assert_null(qm_route_find(method, path, ids, &problem));
    assert_int_equal(problem.code, QM_PROBLEM_METHOD_NOT_ALLOWED);
    assert_string_equal(problem.allow, allow);
}

static void test_other_methods_name_the_allowed_ones(void **state)
{
    (void)state;
    check_allow("PUT", "/v1/meshes", "POST, GET, HEAD");
    check_allow("POST", "/v1/meshes/m_1", "GET, HEAD, PATCH, DELETE");
    check_allow("DELETE", "/healthz", "GET, HEAD");
    check_allow("get", "/healthz", "GET, HEAD");
}

static void test_content_types(void **state)
{
    (void)state;
    assert_true(qm_media_is("application/json", "application/json"));
    assert_true(qm_media_is(" Application/JSON ; charset=utf-8", "application/json"));
    assert_false(qm_media_is("application/json5", "application/json"));
    assert_false(qm_media_is("application/jso", "application/json"));
    assert_false(qm_media_is("", "application/json"));
    assert_false(qm_media_is("*/*", "application/json"));
}

static void test_accept(void **state)
{
    (void)state;
    static const char *const offers[] = {"application/json", "application/x-ndjson", "text/event-stream",
                                         NULL};
    static const struct {
        const char *accept;
        int expected;
    } cases[] = {
        {NULL, 0},
        {"", 0},
        {" , ", 0},
        {"*/*", 0},
        {"application/*", 0},
        {"text/*", 2},
        {"text/html", -1},
        {"application/x-ndjson", 1},
        {"APPLICATION/X-NDJSON;foo=bar", 1},
        {"application/json, application/x-ndjson", 0},
        {"application/x-ndjson, application/json;q=0.9", 1},
        {"application/json;q=0.2,text/event-stream;q=0.4", 2},
        {"text/event-stream, */*", 2},
        {"*/*;q=0.1, application/json;q=0", 1},
        {"application/json;q=0", -1},
        {"application/*;q=0.3, application/json;q=0.1, text/*;q=0.2", 1},
        {"application/json;level=1;q=0.5, text/event-stream; q=0.6", 2},
        {"application/json;q=nonsense", -1},
        {";q=1", -1},
        {"*", -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        int chosen = qm_media_choose(cases[i].accept, offers);
        QM_CHECK(chosen == cases[i].expected, "\"%s\": %d, not %d",
                 cases[i].accept ? cases[i].accept : "(none)", chosen, cases[i].expected);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_known_paths),   cmocka_unit_test(test_paths_of_two_names),
        cmocka_unit_test(test_unknown_paths), cmocka_unit_test(test_other_methods_name_the_allowed_ones),
        cmocka_unit_test(test_content_types), cmocka_unit_test(test_accept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
