/*
 * Numbers and documents to JSON, and job requests from it.
 */
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "check.h"
#include "folder.h"
#include "job/former_names.h"
#include "job/json_in.h"
#include "ops/json_out.h"
#include "random.h"

/* ---- numbers ---- */

static uint64_t bits_of(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static double double_of(uint64_t bits)
{
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void check_number(double value, uint64_t seed)
{
    char text[QM_NUMBER_SIZE];
    assert_ptr_equal(qm_text_number(value, text), text);
    QM_CHECK(bits_of(strtod(text, NULL)) == bits_of(value), "seed %llu: %a became %s",
             (unsigned long long)seed, value, text);
    QM_CHECK(strspn(text, "0123456789+-.e") == strlen(text), "%s", text);
}

static void random_bits_survive(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 0);
    int count = qm_check_long() ? 5000000 : 200000;
    for (int i = 0; i < count; i++) {
        uint64_t bits = qm_random_bits(&random);
        if (i % 8 == 0) bits &= ~(0x7ffull << 52); /* subnormal */
        if (isfinite(double_of(bits))) check_number(double_of(bits), seed);
    }
}

static void edges_survive(void **state)
{
    (void)state;
    static const double edges[] = {0.0,     -0.0,       DBL_TRUE_MIN, -DBL_TRUE_MIN, DBL_MIN,
                                   DBL_MAX, -DBL_MAX,   1e308,        1e-308,        0.1,
                                   1.0 / 3, 4.93439e-4, 1e22,         1e23,          9007199254740993.0};
    for (size_t i = 0; i < sizeof edges / sizeof edges[0]; i++) {
        check_number(edges[i], 0);
        check_number(nextafter(edges[i], 0.0), 0);
    }
}

static void numbers_are_short(void **state)
{
    (void)state;
    char text[QM_NUMBER_SIZE];
    assert_string_equal(qm_text_number(0.1, text), "0.1");
    assert_string_equal(qm_text_number(1e-6, text), "1e-06");
    assert_string_equal(qm_text_number(100.0, text), "100");
    assert_string_equal(qm_text_number(DBL_TRUE_MIN, text), "5e-324");
    assert_string_equal(qm_text_number(0.1 + 0.2, text), "0.30000000000000004");
}

static void not_finite_is_null(void **state)
{
    (void)state;
    char text[QM_NUMBER_SIZE];
    assert_string_equal(qm_text_number(NAN, text), "null");
    assert_string_equal(qm_text_number(INFINITY, text), "null");
    assert_string_equal(qm_text_number(-INFINITY, text), "null");
}

/** Makes a locale with a decimal comma, whatever the machine has, and sets it. */
static void set_comma(void)
{
    char *folder = qm_folder_make(), command[512];
    snprintf(command, sizeof command, "localedef -i de_DE -f UTF-8 %s/de_DE.UTF-8", folder);
    int status = system(command);
    QM_CHECK(status == 0, "%s: status %d (package locales)", command, status);
    assert_int_equal(setenv("LOCPATH", folder, 1), 0);
    assert_non_null(setlocale(LC_NUMERIC, "de_DE.UTF-8"));
    qm_folder_remove(folder);
    assert_string_equal(localeconv()->decimal_point, ",");
}

static void a_decimal_comma_stays_out(void **state)
{
    (void)state;
    set_comma();
    char text[QM_NUMBER_SIZE];
    qm_text_number(1.0 / 3, text);
    qm_job_request request;
    qm_problem problem;
    static const char body[] = "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"m\",\"tolerance\":0.25}";
    bool is_read = qm_json_read_job(body, strlen(body), &request, &problem);
    setlocale(LC_NUMERIC, "C");
    assert_string_equal(text, "0.3333333333333333");
    assert_true(is_read);
    assert_true(request.tolerance == 0.25);
}

/* ---- requests ---- */

static bool read_job(const char *text, qm_job_request *request, qm_problem *problem)
{
    /* An exact block on the heap: a sanitizer sees any look past the end. */
    size_t size = strlen(text);
    char *copy = malloc(size > 0 ? size : 1);
    assert_non_null(copy);
    memcpy(copy, text, size);
    bool ok = qm_json_read_job(copy, size, request, problem);
    free(copy);
    return ok;
}

static void every_field_is_read(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    assert_true(
        read_job(" {\"type\":\"hausdorff\",\"a\":\"mesh-1\",\"b\":\"mesh-2\",\"direction\":\"b_to_a\","
                 "\"quads\":\"bilinear\",\"tolerance\":1e-3,\"tolerance_unit\":\"absolute\","
                 "\"threshold\":0,\"deadline_ms\":1500.5,\"threads\":2,\"accelerator\":\"grid\","
                 "\"bounds\":\"matching\",\"detach\":true}\r\n",
                 &request, &problem));
    assert_int_equal(request.kind, QM_JOB_HAUSDORFF);
    assert_string_equal(request.a, "mesh-1");
    assert_string_equal(request.b, "mesh-2");
    assert_int_equal(request.direction, QM_B_TO_A);
    assert_int_equal(request.quads, QM_QUADS_BILINEAR);
    assert_true(request.tolerance == 1e-3);
    assert_true(request.tolerance_is_absolute);
    assert_true(request.threshold == 0.0);
    assert_true(request.deadline_ms == 1500.5);
    assert_int_equal(request.threads, 2);
    assert_int_equal(request.accelerator, QM_ACCELERATOR_GRID);
    assert_int_equal(request.bounds, QM_BOUNDS_MATCHING);
    assert_true(request.detach);
}

static void what_is_the_engines_own_is_an_object(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    assert_true(read_job("{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",\"gap\":1e-3,\"limit\":2,"
                         "\"engine\":{\"accelerator\":\"grid\",\"bounds\":\"cells\",\"memory_limit\":65536}}",
                         &request, &problem));
    assert_int_equal(request.accelerator, QM_ACCELERATOR_GRID);
    assert_int_equal(request.bounds, QM_BOUNDS_COVER); /* whose former name that is */
    assert_int_equal(request.memory_limit, 65536);
    qm_text text = {0};
    qm_json_write_request_briefly(&text, &request);
    assert_string_equal(text.data,
                        "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",\"quads\":\"triangles\","
                        "\"direction\":\"two_sided\",\"gap\":0.001,\"gap_unit\":\"relative\",\"limit\":2,"
                        "\"engine\":{\"accelerator\":\"grid\",\"memory_limit\":65536}}");
    qm_text_reset(&text);
    assert_true(read_job("{\"type\":\"heatmap\",\"a\":\"m\",\"b\":\"n\",\"engine\":{\"pieces\":0}}", &request,
                         &problem));
    assert_int_equal(request.pieces, 0);
    qm_json_write_request_briefly(&text, &request);
    assert_non_null(strstr(text.data, ",\"engine\":{\"pieces\":0}}"));
    qm_text_reset(&text);
    assert_false(
        read_job("{\"type\":\"alignment\",\"a\":\"m\",\"b\":\"n\",\"engine\":{}}", &request, &problem));
    assert_string_equal(problem.errors[0].pointer, "/engine");
}

static void former_names_are_replaced(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        {"", ""},
        {"\"tolerance\":1", "\"gap\":1"},
        {"{\"request\":{\"tolerance\":1e-06,\"tolerance_unit\":\"relative\",\"threshold\":0.5},\"x\":1}",
         "{\"request\":{\"gap\":1e-06,\"gap_unit\":\"relative\",\"limit\":0.5},\"x\":1}"},
        {"{\"stopped_by\":\"threshold\"}", "{\"stopped_by\":\"limit\"}"},
        {"{\"stopped_by\":\"work\",\"name\":\"threshold\",\"list\":[\"tolerance\",\"threshold\"]}",
         "{\"stopped_by\":\"work\",\"name\":\"threshold\",\"list\":[\"tolerance\",\"threshold\"]}"},
        {"{\"detail\":\"a \\\"tolerance\\\": 1\"}", "{\"detail\":\"a \\\"tolerance\\\": 1\"}"},
    };
    qm_former_names_replace(NULL);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char *text = strdup(cases[i][0]);
        qm_former_names_replace(text);
        assert_string_equal(text, cases[i][1]);
        free(text);
    }
}

static void absent_fields_have_defaults(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    assert_true(
        read_job("{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",\"threshold\":null}", &request, &problem));
    assert_int_equal(request.direction, QM_TWO_SIDED);
    assert_int_equal(request.quads, QM_QUADS_TRIANGLES);
    assert_true(request.tolerance == 1e-6);
    assert_false(request.tolerance_is_absolute);
    assert_true(isnan(request.threshold));
    assert_true(request.deadline_ms == 0.0);
    assert_int_equal(request.threads, 0);
    assert_int_equal(request.accelerator, QM_ACCELERATOR_AUTO);
    assert_int_equal(request.bounds, QM_BOUNDS_COVER);
    assert_false(request.detach);
}

/** A member added to a good request, the code of the refusal and the pointer of its first error. */
typedef struct bad_member {
    const char *member;
    qm_problem_code code;
    const char *pointer;
} bad_member;

static void bad_members_are_pointed_at(void **state)
{
    (void)state;
    static const bad_member cases[] = {
        {"\"direction\":\"up\"", QM_PROBLEM_INVALID_FIELD, "/direction"},
        {"\"direction\":1", QM_PROBLEM_INVALID_FIELD, "/direction"},
        {"\"direction\":null", QM_PROBLEM_INVALID_FIELD, "/direction"},
        {"\"Direction\":\"a_to_b\"", QM_PROBLEM_INVALID_FIELD, "/Direction"},
        {"\"quads\":true", QM_PROBLEM_INVALID_FIELD, "/quads"},
        {"\"quads\":\"Bilinear\"", QM_PROBLEM_INVALID_FIELD, "/quads"},
        {"\"tolerance\":0", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance\":-1e-6", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance\":\"1e-6\"", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance\":1e999", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance\":1e-999", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance\":[1]", QM_PROBLEM_INVALID_FIELD, "/tolerance"},
        {"\"tolerance_unit\":\"mm\"", QM_PROBLEM_INVALID_FIELD, "/tolerance_unit"},
        {"\"threshold\":-1", QM_PROBLEM_INVALID_FIELD, "/threshold"},
        {"\"threshold\":1e400", QM_PROBLEM_INVALID_FIELD, "/threshold"},
        {"\"threshold\":{}", QM_PROBLEM_INVALID_FIELD, "/threshold"},
        {"\"deadline_ms\":0", QM_PROBLEM_INVALID_FIELD, "/deadline_ms"},
        {"\"deadline_ms\":false", QM_PROBLEM_INVALID_FIELD, "/deadline_ms"},
        {"\"threads\":0", QM_PROBLEM_INVALID_FIELD, "/threads"},
        {"\"threads\":1.5", QM_PROBLEM_INVALID_FIELD, "/threads"},
        {"\"threads\":1e18", QM_PROBLEM_INVALID_FIELD, "/threads"},
        {"\"threads\":-3", QM_PROBLEM_INVALID_FIELD, "/threads"},
        {"\"detach\":1", QM_PROBLEM_INVALID_FIELD, "/detach"},
        {"\"detach\":\"true\"", QM_PROBLEM_INVALID_FIELD, "/detach"},
        {"\"accelerator\":\"octree\"", QM_PROBLEM_INVALID_FIELD, "/accelerator"},
        {"\"bounds\":\"loose\"", QM_PROBLEM_INVALID_FIELD, "/bounds"},
        {"\"accelerator\":\"octree\",\"threads\":0", QM_PROBLEM_INVALID_FIELD, "/accelerator"},
        {"\"engine\":1", QM_PROBLEM_INVALID_FIELD, "/engine"},
        {"\"engine\":null", QM_PROBLEM_INVALID_FIELD, "/engine"},
        {"\"engine\":[]", QM_PROBLEM_INVALID_FIELD, "/engine"},
        {"\"engine\":{\"bounds\":\"loose\"}", QM_PROBLEM_INVALID_FIELD, "/engine/bounds"},
        {"\"engine\":{\"memory_limit\":1}", QM_PROBLEM_INVALID_FIELD, "/engine/memory_limit"},
        {"\"engine\":{\"threads\":1}", QM_PROBLEM_INVALID_FIELD, "/engine/threads"},
        {"\"engine\":{\"gap\":1}", QM_PROBLEM_INVALID_FIELD, "/engine/gap"},
        {"\"engine\":{\"pieces\":1}", QM_PROBLEM_INVALID_FIELD, "/engine/pieces"},
        {"\"engine\":{\"a/b\\u00e9\":1}", QM_PROBLEM_INVALID_FIELD, "/engine/a~1b??"},
        {"\"engine\":{\"bounds\":\"cover\",\"bounds\":\"cover\"}", QM_PROBLEM_INVALID_FIELD,
         "/engine/bounds"},
        {"\"engine\":{},\"engine\":{}", QM_PROBLEM_INVALID_FIELD, "/engine"},
        {"\"engine\":{\"bounds\":\"cover\"},\"bounds\":\"cover\"", QM_PROBLEM_INVALID_FIELD, "/bounds"},
        {"\"accelerator\":\"grid\",\"engine\":{\"accelerator\":\"grid\"}", QM_PROBLEM_INVALID_FIELD,
         "/engine/accelerator"},
        {"\"colour\":\"red\"", QM_PROBLEM_INVALID_FIELD, "/colour"},
        {"\"a/b~c\":1", QM_PROBLEM_INVALID_FIELD, "/a~1b~0c"},
        {"\"\":1", QM_PROBLEM_INVALID_FIELD, "/"},
        {"\"a\":\"again\"", QM_PROBLEM_INVALID_FIELD, "/a"},
        {"\"threads\":1,\"threads\":1", QM_PROBLEM_INVALID_FIELD, "/threads"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[256];
        snprintf(text, sizeof text, "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",%s}", cases[i].member);
        qm_job_request request;
        qm_problem problem;
        QM_CHECK(!read_job(text, &request, &problem), "%s was taken", text);
        QM_CHECK(problem.code == cases[i].code, "%s: %s", text, qm_problem_name(problem.code));
        QM_CHECK(problem.detail[0] && problem.errors[0].detail[0], "%s: no words", text);
        QM_CHECK(problem.error_count >= 1 && strcmp(problem.errors[0].pointer, cases[i].pointer) == 0,
                 "%s: %s", text, problem.errors[0].pointer);
    }
}

static void what_is_missing_is_named(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    assert_false(read_job("{}", &request, &problem));
    assert_int_equal(problem.code, QM_PROBLEM_INVALID_FIELD);
    assert_int_equal(problem.error_count, 3);
    assert_string_equal(problem.errors[0].pointer, "/type");
    assert_string_equal(problem.errors[1].pointer, "/a");
    assert_string_equal(problem.errors[2].pointer, "/b");
    assert_false(read_job("{\"type\":\"fitting\",\"a\":\"\",\"b\":7}", &request, &problem));
    assert_int_equal(problem.error_count, 3);
    assert_false(read_job("{\"type\":\"hausdorff\",\"a\":\"0123456789012345678901234567890123456789\","
                          "\"b\":\"b\"}",
                          &request, &problem));
    assert_string_equal(problem.errors[0].pointer, "/a");
}

static void more_faults_than_fit_are_refused_too(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    assert_false(read_job("{\"1\":1,\"2\":2,\"3\":3,\"4\":4,\"5\":5,\"6\":6,\"7\":7,\"8\":8,\"9\":9}",
                          &request, &problem));
    assert_int_equal(problem.error_count, QM_PROBLEM_ERRORS);
}

/** A body that is not JSON, and the byte where it stops to be. */
typedef struct bad_text {
    const char *text;
    size_t offset;
} bad_text;

static void malformed_text_is_refused(void **state)
{
    (void)state;
    static const bad_text cases[] = {
        {"", 0},
        {"{", QM_NO_LOCATION},
        {"nonsense", 0},
        {"{\"type\":\"hausdorff\"", QM_NO_LOCATION},
        {"{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\"} x", 37},
        {"{} {}", 3},
        {"{\"a\":\"\xff\"}", 6},
        {"{\"a\":\"\xc0\x80\"}", 6},
        {"{\"a\":\"\xed\xa0\x80\"}", 6},
        {"{\"a\":\"\xf4\x90\x80\x80\"}", 6},
        {"{\"a\":\"\xe2\x82", 6},
        {"{\"a\":\"m\\u0000n\"}", 7},
        {"[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]", 16},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        qm_job_request request;
        qm_problem problem;
        QM_CHECK(!read_job(cases[i].text, &request, &problem), "%s was taken", cases[i].text);
        QM_CHECK(problem.code == QM_PROBLEM_MALFORMED_JSON, "%s: %s", cases[i].text,
                 qm_problem_name(problem.code));
        assert_int_equal(problem.error_count, 1);
        if (cases[i].offset != QM_NO_LOCATION) assert_int_equal(problem.errors[0].offset, cases[i].offset);
    }
}

static void a_byte_of_zero_ends_nothing(void **state)
{
    (void)state;
    static const char text[] = "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\"}\0{}";
    qm_job_request request;
    qm_problem problem;
    assert_false(qm_json_read_job(text, sizeof text - 1, &request, &problem));
    assert_int_equal(problem.code, QM_PROBLEM_MALFORMED_JSON);
}

static void other_values_are_no_job(void **state)
{
    (void)state;
    static const char *const texts[] = {"[]", "null", "7", "\"hausdorff\"",
                                        "[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        qm_job_request request;
        qm_problem problem;
        QM_CHECK(!read_job(texts[i], &request, &problem), "%s was taken", texts[i]);
        QM_CHECK(problem.code == QM_PROBLEM_INVALID_FIELD, "%s: %s", texts[i], qm_problem_name(problem.code));
    }
}

static void check_text(qm_text *text, const char *expected)
{
    char *data = qm_text_take(text);
    assert_non_null(data);
    assert_string_equal(data, expected);
    free(data);
}

static void brackets_in_strings_are_text(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    static const char line[] =
        "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",\"key\":\"[[[[[[[[[[[[[[[[[[\\\"[[}\"}";
    qm_text key = {0};
    assert_true(qm_json_read_batch_line(line, sizeof line - 1, &key, &request, &problem));
    check_text(&key, "\"[[[[[[[[[[[[[[[[[[\\\"[[}\"");
}

static void damaged_requests_never_crash(void **state)
{
    (void)state;
    static const char good[] = "{\"type\":\"hausdorff\",\"a\":\"m\",\"b\":\"n\",\"tolerance\":1e-3,"
                               "\"threshold\":null,\"detach\":false,\"quads\":\"bilinear\"}";
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 1);
    for (int i = 0; i < 20000; i++) {
        char text[sizeof good];
        memcpy(text, good, sizeof good);
        for (size_t change = 0; change <= qm_random_below(&random, 3); change++)
            text[qm_random_below(&random, sizeof good - 1)] = (char)(1 + qm_random_below(&random, 255));
        qm_job_request request;
        qm_problem problem;
        bool ok = read_job(text, &request, &problem);
        QM_CHECK(ok == (problem.error_count == 0) && ok == (problem.detail[0] == '\0'), "seed %llu: %s",
                 (unsigned long long)seed, text);
    }
}

/* ---- documents ---- */

static void a_request_comes_back(void **state)
{
    (void)state;
    qm_job_request request = qm_job_request_default(), again;
    qm_problem problem;
    strcpy(request.a, "m.1");
    strcpy(request.b, "m-2_");
    request.direction = QM_A_TO_B;
    request.tolerance = 0.1 + 0.2;
    request.threshold = 1e308;
    request.threads = 3;
    request.accelerator = QM_ACCELERATOR_GRID;
    request.bounds = QM_BOUNDS_MATCHING;
    qm_text text = {0};
    qm_json_write_request(&text, &request);
    assert_true(qm_json_read_job(text.data, text.size, &again, &problem));
    assert_string_equal(again.a, request.a);
    assert_string_equal(again.b, request.b);
    assert_int_equal(again.direction, request.direction);
    assert_true(again.tolerance == request.tolerance);
    assert_true(again.threshold == request.threshold);
    assert_int_equal(again.threads, request.threads);
    assert_int_equal(again.accelerator, request.accelerator);
    assert_int_equal(again.bounds, request.bounds);
    qm_text_reset(&text);
}

static void points_are_read(void **state)
{
    (void)state;
    qm_job_request request;
    qm_problem problem;
    static const double expected[] = {0, 1, 2, -1.5, 1e300, 4e-5};
    assert_true(read_job("{\"points\":[[0,1,2],[-1.5,1e300,4e-5]],\"type\":\"project\",\"mesh\":\"m_1\"}",
                         &request, &problem));
    assert_int_equal(request.kind, QM_JOB_PROJECT);
    assert_string_equal(request.a, "m_1");
    assert_int_equal(request.point_count, 2);
    assert_memory_equal(request.points, expected, sizeof expected);
    qm_text text = {0};
    qm_job_request again;
    qm_json_write_request(&text, &request);
    assert_true(read_job(text.data, &again, &problem));
    assert_int_equal(again.point_count, 2);
    assert_memory_equal(again.points, expected, sizeof expected);
    qm_text_reset(&text);
    qm_json_write_request_briefly(&text, &request);
    assert_string_equal(text.data,
                        "{\"type\":\"project\",\"mesh\":\"m_1\",\"quads\":\"triangles\",\"point_count\":2}");
    qm_text_reset(&text);
    qm_job_request_reset(&request);
    qm_job_request_reset(&again);
}

/** Only the Hausdorff distance has a choice that is served. */
static void points_may_be_searched_with_any_accelerator(void **state)
{
    (void)state;
    static const char *const names[] = {"auto", "boxes", "tetra", "grid"};
    for (int i = 0; i < QM_ACCELERATOR_COUNT; i++) {
        qm_job_request request;
        qm_problem problem;
        char text[128];
        snprintf(text, sizeof text,
                 "{\"points\":[],\"type\":\"project\",\"mesh\":\"m_1\",\"accelerator\":\"%s\"}", names[i]);
        assert_true(read_job(text, &request, &problem));
        assert_int_equal(request.accelerator, i);
        qm_job_request_reset(&request);
    }
}

static void bad_points_are_pointed_at(void **state)
{
    (void)state;
    static const struct {
        const char *points, *pointer;
    } cases[] = {
        {"[[0,0,0],[0,1,1e999]]", "/points/1/2"},
        {"[[0,0,0],[0,1]]", "/points/1"},
        {"[[0,0,0,0]]", "/points/0"},
        {"[[0,[],0]]", "/points/0/1"},
        {"[0]", "/points/0"},
        {"{}", "/points"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[128];
        qm_job_request request;
        qm_problem problem;
        snprintf(text, sizeof text, "{\"type\":\"project\",\"mesh\":\"m\",\"points\":%s}", cases[i].points);
        assert_false(read_job(text, &request, &problem));
        assert_int_equal(problem.code, QM_PROBLEM_INVALID_FIELD);
        assert_int_equal(problem.error_count, 1);
        assert_string_equal(problem.errors[0].pointer, cases[i].pointer);
        assert_null(request.points);
    }
}

static void a_problem_is_a_document(void **state)
{
    (void)state;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "a \"b\"\n\x01\xff\xc3\xa9");
    qm_problem_add_pointer(&problem, "/a", "is %s", "missing");
    problem.errors[problem.error_count++] =
        (qm_problem_error){.line = 3, .offset = QM_NO_LOCATION, .detail = "odd"};
    qm_text text = {0};
    qm_json_write_problem(&text, &problem);
    check_text(&text,
               "{\"type\":\"/problems/invalid_field\",\"title\":\"A field of the request is not valid\","
               "\"status\":400,\"detail\":\"a \\\"b\\\"\\u000a\\u0001\xef\xbf\xbd\xc3\xa9\","
               "\"code\":\"invalid_field\",\"errors\":[{\"pointer\":\"/a\",\"detail\":\"is missing\"},"
               "{\"line\":3,\"detail\":\"odd\"}]}");
}

static void a_result_is_a_document(void **state)
{
    (void)state;
    qm_job_request request = qm_job_request_default();
    strcpy(request.b, "m2");
    qm_job_result result = {.diagonal = 2.0, .tolerance = 0.5, .prepare_a_ms = 1, .prepare_b_ms = 2};
    result.from_face = 7;
    result.hausdorff = (qm_hausdorff_result){.lower = 0.0,
                                             .upper = INFINITY,
                                             .from_side = 1,
                                             .has_witness = true,
                                             .iterations = 5,
                                             .projections = 6,
                                             .max_queue = 4,
                                             .elapsed_ms = 3,
                                             .stop = QM_STOP_DEADLINE};
    qm_text text = {0};
    qm_json_write_result(&text, &request, &result);
    check_text(&text, "{\"lower\":0,\"upper\":null,\"lower_relative\":0,\"upper_relative\":null,\"witness\":"
                      "{\"from\":{\"mesh\":\"b\",\"id\":\"m2\",\"face\":7,\"uv\":[0,0],\"point\":[0,0,0]},"
                      "\"to\":{\"mesh\":\"a\",\"face\":0,\"uv\":[0,0],\"point\":[0,0,0]}},"
                      "\"direction\":\"two_sided\",\"quads\":\"triangles\",\"gap\":0.5,\"iterations\":5,"
                      "\"projections\":6,\"max_queue\":4,\"prepare_ms\":{\"a\":1,\"b\":2},\"elapsed_ms\":3,"
                      "\"converged\":false,\"stopped_by\":\"deadline\",\"verdict\":null}");
}

static void a_result_without_witness_leaves_it_out(void **state)
{
    (void)state;
    qm_job_request request = qm_job_request_default();
    qm_job_result result = {.diagonal = 0.0, .hausdorff = {.stop = QM_STOP_THRESHOLD, .verdict = -1}};
    qm_text text = {0};
    qm_json_write_result(&text, &request, &result);
    assert_non_null(strstr(text.data, "\"lower_relative\":null,\"upper_relative\":null,\"direction\":"));
    assert_null(strstr(text.data, "witness"));
    assert_non_null(strstr(text.data, "\"stopped_by\":\"limit\",\"verdict\":\"below\"}"));
    qm_text_reset(&text);
}

/** The number that follows "name": in a document. */
static double number_of(const char *text, const char *name)
{
    char key[64];
    snprintf(key, sizeof key, "\"%s\":", name);
    const char *found = strstr(text, key);
    QM_CHECK(found, "no %s in %s", name, text);
    return strtod(found + strlen(key), NULL);
}

static void relative_bounds_are_rounded_outwards(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 2);
    for (int i = 0; i < 20000; i++) {
        qm_hausdorff_progress progress = {.lower = qm_random_range(&random, 0.0, 1.0)};
        progress.upper = progress.lower;
        double diagonal = qm_random_range(&random, 0.1, 10.0);
        qm_text text = {0};
        qm_json_add_bounds(&text, &progress, diagonal);
        /* long double has 11 bits more: enough to see on which side of the true share a double lies. */
        long double share = (long double)progress.lower / (long double)diagonal;
        QM_CHECK((long double)number_of(text.data, "lower_relative") < share, "seed %llu: %s",
                 (unsigned long long)seed, text.data);
        QM_CHECK((long double)number_of(text.data, "upper_relative") > share, "seed %llu: %s",
                 (unsigned long long)seed, text.data);
        assert_true(number_of(text.data, "lower") == progress.lower);
        assert_true(number_of(text.data, "upper") == progress.upper);
        qm_text_reset(&text);
    }
}

static void only_utf8_has_a_length(void **state)
{
    (void)state;
    assert_int_equal(qm_text_utf8_length("a", 1), 1);
    assert_int_equal(qm_text_utf8_length("\xc3\xa9", 2), 2);
    assert_int_equal(qm_text_utf8_length("\xed\x9f\xbf", 3), 3);
    assert_int_equal(qm_text_utf8_length("\xf4\x8f\xbf\xbf", 4), 4);
    assert_int_equal(qm_text_utf8_length("\xc3\xa9", 1), 0);
    assert_int_equal(qm_text_utf8_length("\xc1\xbf", 2), 0);
    assert_int_equal(qm_text_utf8_length("\xe0\x9f\xbf", 3), 0);
    assert_int_equal(qm_text_utf8_length("\xf0\x8f\xbf\xbf", 4), 0);
    assert_int_equal(qm_text_utf8_length("\xe1\x80\x28", 3), 0);
    assert_int_equal(qm_text_utf8_length("\x80", 1), 0);
}

static bool make_no_room(void *user, size_t missing)
{
    (void)user;
    return missing == 0;
}

/** Trees are in the budget, of which all together may have a quarter, and leave it when they end. */
static void test_trees_are_in_the_budget(void **state)
{
    (void)state;
    static char text[20003];
    qm_budget budget = {.limit = 1 << 20, .make_room = make_no_room};
    const char *end;
    bool no_memory;
    memset(text, 0, sizeof text);
    text[0] = '[';
    for (size_t i = 0; i < 10000; i++)
        memcpy(text + 1 + 2 * i, i < 9999 ? "0," : "0]", 2);
    qm_json_set_budget(&budget);
    struct cJSON *small = qm_json_parse_tree("[1,{\"a\":\"text\"}]", 16, &end, &no_memory);
    assert_non_null(small);
    size_t used = qm_json_measure();
    assert_true(used > 4 * 64 && used < 1000 && atomic_load(&budget.used) == used);
    assert_null(qm_json_parse_tree(text, strlen(text), &end, &no_memory));
    assert_true(no_memory && qm_json_measure() == used && atomic_load(&budget.used) == used);
    qm_json_free((qm_json *)small);
    assert_true(qm_json_measure() == 0 && atomic_load(&budget.used) == 0);
    /* Other memory of the budget counts, too. */
    atomic_store(&budget.used, budget.limit - 100);
    assert_null(qm_json_parse_tree("[1,2,3]", 7, &end, &no_memory));
    assert_true(no_memory && atomic_load(&budget.used) == budget.limit - 100);
    atomic_store(&budget.used, 0);
    qm_json_set_budget(NULL);
    small = qm_json_parse_tree(text, strlen(text), &end, &no_memory);
    assert_true(small && qm_json_measure() > 640000);
    qm_json_free((qm_json *)small);
    assert_int_equal(qm_json_measure(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_bits_survive),
        cmocka_unit_test(edges_survive),
        cmocka_unit_test(numbers_are_short),
        cmocka_unit_test(not_finite_is_null),
        cmocka_unit_test(a_decimal_comma_stays_out),
        cmocka_unit_test(every_field_is_read),
        cmocka_unit_test(what_is_the_engines_own_is_an_object),
        cmocka_unit_test(former_names_are_replaced),
        cmocka_unit_test(absent_fields_have_defaults),
        cmocka_unit_test(bad_members_are_pointed_at),
        cmocka_unit_test(what_is_missing_is_named),
        cmocka_unit_test(more_faults_than_fit_are_refused_too),
        cmocka_unit_test(malformed_text_is_refused),
        cmocka_unit_test(a_byte_of_zero_ends_nothing),
        cmocka_unit_test(other_values_are_no_job),
        cmocka_unit_test(brackets_in_strings_are_text),
        cmocka_unit_test(damaged_requests_never_crash),
        cmocka_unit_test(a_request_comes_back),
        cmocka_unit_test(points_are_read),
        cmocka_unit_test(points_may_be_searched_with_any_accelerator),
        cmocka_unit_test(bad_points_are_pointed_at),
        cmocka_unit_test(a_problem_is_a_document),
        cmocka_unit_test(a_result_is_a_document),
        cmocka_unit_test(a_result_without_witness_leaves_it_out),
        cmocka_unit_test(relative_bounds_are_rounded_outwards),
        cmocka_unit_test(only_utf8_has_a_length),
        cmocka_unit_test(test_trees_are_in_the_budget),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
