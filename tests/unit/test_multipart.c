/* Bodies of multipart/form-data: written by formula and split again, and changed at random. */
#include "http/multipart.h"

#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "check.h"
#include "random.h"

enum { ROOM = 6 };

typedef struct found {
    qm_multipart_part part[ROOM];
    size_t count;
    qm_problem problem;
} found;

static bool split(const char *body, size_t size, const char *boundary, found *out)
{
    return qm_multipart_split((const uint8_t *)body, size, boundary, out->part, ROOM, &out->count,
                              &out->problem);
}

static void boundaries(void **state)
{
    (void)state;
    const struct {
        const char *type, *boundary;
    } cases[] = {
        {"multipart/form-data; boundary=abc", "abc"},
        {"Multipart/Form-Data; charset=utf-8; BOUNDARY=\"a b:c\"", "a b:c"},
        {"multipart/form-data;boundary=----WebKitFormBoundary7MA4YWxk ; x=y",
         "----WebKitFormBoundary7MA4YWxk"},
        {"multipart/form-data; boundary=a; boundary=b", "a"},
        {"multipart/form-data", NULL},
        {"multipart/form-data; boundary=", NULL},
        {"multipart/form-data; boundary=\"", NULL},
        {"multipart/form-data; boundary", NULL},
        {"multipart/mixed; boundary=abc", NULL},
        {"text/plain", NULL},
        {NULL, NULL},
        {"multipart/form-data; "
         "boundary=0123456789012345678901234567890123456789012345678901234567890123456789",
         "0123456789012345678901234567890123456789012345678901234567890123456789"},
        {"multipart/form-data; "
         "boundary=01234567890123456789012345678901234567890123456789012345678901234567890",
         NULL},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char boundary[QM_MULTIPART_BOUNDARY_SIZE];
        bool is_read = qm_multipart_read_boundary(cases[i].type, boundary);
        QM_CHECK(is_read == (cases[i].boundary != NULL), "case %zu", i);
        if (is_read) assert_string_equal(boundary, cases[i].boundary);
    }
}

static void a_body_as_curl_sends_it(void **state)
{
    (void)state;
    static const char body[] =
        "before\r\n--abc\r\nContent-Disposition: form-data; name=\"a\"; filename=\"a \\\"1\\\".stl\"\r\n"
        "Content-Type: model/stl\r\n\r\none\r\n--ab\r\ntwo\r\n--abc \t\r\n"
        "content-disposition:form-data;name=b\r\nX: y\r\n\r\n\r\n--abc--\r\nafter";
    found f;
    assert_true(split(body, sizeof body - 1, "abc", &f));
    assert_int_equal(f.count, 2);
    assert_string_equal(f.part[0].name, "a");
    assert_string_equal(f.part[0].file_name, "a \"1\".stl");
    assert_string_equal(f.part[0].type, "model/stl");
    assert_int_equal(f.part[0].size, strlen("one\r\n--ab\r\ntwo"));
    assert_memory_equal(body + f.part[0].offset, "one\r\n--ab\r\ntwo", f.part[0].size);
    assert_string_equal(f.part[1].name, "b");
    assert_int_equal(f.part[1].size, 0);
    /* An empty content that shares the line end of the headers. */
    static const char bare[] = "--x\r\nContent-Disposition: form-data; name=\"a\"\r\n\r\n--x--";
    assert_true(split(bare, sizeof bare - 1, "x", &f));
    assert_int_equal(f.count, 1);
    assert_int_equal(f.part[0].size, 0);
    static const char none[] = "--x--";
    assert_true(split(none, sizeof none - 1, "x", &f));
    assert_int_equal(f.count, 0);
}

static void faults_are_named(void **state)
{
    (void)state;
#define HEAD "--x\r\nContent-Disposition: form-data; name=\"a\"\r\n"
    const struct {
        const char *body, *message;
    } cases[] = {
        {"", "is empty"},
        {"--y\r\n", "does not have the boundary"},
        {"--x", "must end its line"},
        {"--xy\r\n", "must end its line"},
        {"--x\r\n", "has no end"},
        {"--x\r\n\r\n", "has no name"},
        {"--x\r\nA: b\r\n\r\nc\r\n--x--", "has no name"},
        {HEAD "\r\nc", "last part has no end"},
        {HEAD "\r\nc\r\n--x", "must end its line"},
        {HEAD "Content-Transfer-Encoding: base64\r\n\r\nc\r\n--x--", "must be binary"},
        {"--x\r\nContent-Disposition: attachment; name=\"a\"\r\n\r\nc\r\n--x--", "must be form-data"},
        {"--x\r\nContent-Disposition: form-data; name=\"a\r\n\r\nc\r\n--x--", "must be form-data"},
        {HEAD "\r\n\r\n" HEAD "\r\n\r\n" HEAD "\r\n\r\n" HEAD "\r\n\r\n" HEAD "\r\n\r\n" HEAD "\r\n\r\n" HEAD
              "\r\n\r\n--x--",
         "too many parts"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        found f;
        QM_CHECK(!split(cases[i].body, strlen(cases[i].body), "x", &f), "case %zu", i);
        assert_int_equal(f.problem.code, QM_PROBLEM_MALFORMED_BODY);
        QM_CHECK(strstr(f.problem.detail, cases[i].message), "case %zu: %s", i, f.problem.detail);
        assert_true(f.problem.error_count == 1 && f.problem.errors[0].offset <= strlen(cases[i].body));
    }
    /* Headers without end. */
    qm_text body = {0};
    qm_text_add_string(&body, HEAD);
    for (int i = 0; i < 20; i++)
        qm_text_add_string(&body, "X: y\r\n");
    found f;
    assert_false(split(body.data, body.size, "x", &f));
    assert_non_null(strstr(f.problem.detail, "too many headers"));
    body.size = 0;
    qm_text_add_string(&body, "--x\r\n");
    for (int i = 0; i < 300; i++)
        qm_text_add_string(&body, "long ");
    assert_false(split(body.data, body.size, "x", &f));
    assert_non_null(strstr(f.problem.detail, "too long"));
    qm_text_reset(&body);
#undef HEAD
}

/** Random contents, with much that looks like a boundary, come back as they were; cut or changed bodies are split or refused, and every
 * part lies in the body. */
static void random_bodies(void **state)
{
    (void)state;
    static const char letters[] = "\r\n-xab";
    for (unsigned run = 0; run < 6000; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        size_t count = qm_random_below(&random, ROOM), size[ROOM], at[ROOM];
        qm_text body = {0};
        for (size_t i = 0; i < count; i++) {
            qm_text_printf(&body, "%s--xa\r\nContent-Disposition: form-data; name=\"p%zu\"\r\n\r\n",
                           i > 0 ? "\r\n" : "", i);
            at[i] = body.size;
            size[i] = qm_random_below(&random, 40);
            for (size_t k = 0; k < size[i]; k++)
                qm_text_add(&body, letters + qm_random_below(&random, sizeof letters), 1);
            /* No content may have the boundary at the start of a line. */
            for (size_t k = at[i] - 2; k + 6 <= body.size; k++)
                if (memcmp(body.data + k, "\r\n--xa", 6) == 0) body.data[k + 5] = 'b';
        }
        qm_text_add_string(&body, count > 0 ? "\r\n--xa--" : "--xa--");
        found f;
        QM_CHECK(split(body.data, body.size, "xa", &f), "seed %llu run %u: %s",
                 (unsigned long long)qm_check_seed(), run, f.problem.detail);
        assert_int_equal(f.count, count);
        for (size_t i = 0; i < count; i++) {
            char name[24];
            snprintf(name, sizeof name, "p%zu", i);
            assert_string_equal(f.part[i].name, name);
            assert_true(f.part[i].offset == at[i] && f.part[i].size == size[i]);
        }
        for (size_t i = qm_random_below(&random, 4); i > 0; i--)
            body.data[qm_random_below(&random, body.size)] =
                letters[qm_random_below(&random, sizeof letters)];
        size_t cut = qm_random_below(&random, body.size + 1);
        char *exact = malloc(cut + 1); /* so that a sanitizer sees reads beyond it */
        memcpy(exact, body.data, cut);
        exact = realloc(exact, cut > 0 ? cut : 1);
        f.count = 0;
        split(exact, cut, "xa", &f);
        for (size_t i = 0; i < f.count; i++)
            assert_true(f.part[i].offset <= cut && f.part[i].size <= cut - f.part[i].offset);
        free(exact);
        qm_text_reset(&body);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boundaries),
        cmocka_unit_test(a_body_as_curl_sends_it),
        cmocka_unit_test(faults_are_named),
        cmocka_unit_test(random_bodies),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
