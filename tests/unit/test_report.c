/* The words and colours of a report: intervals in print, text that is no markup, bands. */
#include "check.h"

#include "random.h"
#include "report/report_internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- numbers ---- */

/** A printed interval, read back. */
static qm_report_interval read_back(qm_report_interval interval, bool is_share, int spare, char text[1000])
{
    qm_text out = {0};
    qm_report_add_interval(&out, interval, is_share, spare);
    snprintf(text, 1000, "%s", out.data);
    qm_text_reset(&out);
    char *end;
    qm_report_interval found;
    found.lower = found.upper = strtod(text, &end);
    if (strncmp(end, " to ", 4) == 0) found.upper = strtod(end + 4, NULL);
    return found;
}

static void intervals_in_print_hold_those_of_the_result(void **state)
{
    (void)state;
    size_t draws = qm_check_long() ? 1000000 : 30000;
    for (size_t draw = 0; draw < draws; draw++) {
        qm_random random = qm_random_make(qm_check_seed(), draw);
        double lower = pow(10.0, qm_random_range(&random, -290.0, 290.0));
        if (draw % 2 == 0) lower = pow(10.0, qm_random_range(&random, -6.0, 6.0));
        double upper = lower * (1.0 + pow(10.0, qm_random_range(&random, -17.0, 2.0)));
        if (draw % 7 == 0) lower = 0.0;
        int spare = draw % 3 == 0 ? 2 : 0;
        char text[1000];
        qm_report_interval found = read_back((qm_report_interval){lower, upper}, false, spare, text);
        QM_CHECK(lower == upper || (found.lower <= lower && found.upper >= upper),
                 "draw %zu: %.17g %.17g as %s", draw, lower, upper, text);
        /* One unit of the last digit on either side, which is at most the width, or two where the rounding of halves adds. */
        double allowed = 2.0 * (upper - lower) + 4e-16 * upper;
        QM_CHECK(lower - found.lower <= allowed && found.upper - upper <= allowed,
                 "draw %zu: %.17g %.17g as %s", draw, lower, upper, text);
    }
}

static void shares_in_print_hold_those_of_the_result(void **state)
{
    (void)state;
    for (size_t draw = 0; draw < 20000; draw++) {
        qm_random random = qm_random_make(qm_check_seed(), draw);
        double lower = qm_random_range(&random, 0.0, 1.0), upper = qm_random_range(&random, lower, 1.0);
        if (draw % 5 == 0) upper = 1.0;
        if (draw % 7 == 0) lower = 0.0;
        char text[1000];
        qm_report_interval found = read_back((qm_report_interval){lower, upper}, true, 0, text);
        QM_CHECK(found.lower <= 100.0 * lower && found.upper >= 100.0 * upper && found.lower >= 0.0,
                 "%.17g %.17g as %s", lower, upper, text);
    }
}

static void check_print(double lower, double upper, bool is_share, const char *expected)
{
    char text[1000];
    read_back((qm_report_interval){lower, upper}, is_share, 0, text);
    assert_string_equal(text, expected);
}

static void digits_end_with_the_width(void **state)
{
    (void)state;
    check_print(0.123456, 0.123789, false, "0.1234 to 0.1238");
    check_print(0.0, 0.0, false, "0");
    check_print(0.0, 0.002, false, "0 to 0.002");
    check_print(2.0, 2.0, false, "2");
    check_print(12345678.0, 12345679.5, false, "1.2345678e+07 to 1.2345680e+07");
    check_print(1.0, 1.0, true, "100&nbsp;%");
    check_print(0.25, 0.2501, true, "25.00 to 25.01&nbsp;%");
    check_print((double)NAN, (double)NAN, false, "unknown to unknown");
}

static void check_percent(double lower, double upper, const char *expected)
{
    qm_text out = {0};
    qm_report_add_percent(&out, (qm_report_interval){lower, upper});
    assert_string_equal(out.data, expected);
    qm_text_reset(&out);
}

static void small_print_tells_what_is_certain(void **state)
{
    (void)state;
    check_percent(0.0, 0.0, "0");
    check_percent(0.0, 1e-9, "&lt;0.1");
    check_percent(0.12341, 0.12349, "12.3");
    check_percent(0.1151, 0.1249, "12");
    check_percent(0.1151, 0.21, "11&ndash;21");
    check_percent(1.0, 1.0, "100.0");
}

/* ---- text ---- */

static void check_escaped(const char *text, const char *expected)
{
    qm_text out = {0};
    qm_text_add_string(&out, "");
    qm_report_add_escaped(&out, text);
    assert_string_equal(out.data ? out.data : "", expected);
    qm_text_reset(&out);
}

static void text_is_no_markup(void **state)
{
    (void)state;
    check_escaped("</title><script>alert('1')</script>",
                  "&lt;/title&gt;&lt;script&gt;alert('1')&lt;/script&gt;");
    check_escaped("a\" onload=\"x&amp;", "a&quot; onload=&quot;x&amp;amp;");
    check_escaped("\xC3\xA9t\xC3\xA9 \xFF\xC3\x01\x7F.",
                  "\xC3\xA9t\xC3\xA9 \xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD.");
    check_escaped("", "");
}

/* ---- colours ---- */

static void check_scale(double limit, double range, double greatest)
{
    const qm_scale scale = qm_scale_make(limit, range, greatest);
    assert_true(scale.edge[0] == 0.0);
    for (int i = 0; i < QM_SCALE_BANDS; i++) {
        QM_CHECK(scale.edge[i] < scale.edge[i + 1], "limit %g range %g greatest %g edge %d", limit, range,
                 greatest, i);
        assert_int_equal(qm_scale_band(&scale, scale.edge[i + 1]), i);
        assert_int_equal(qm_scale_band(&scale, nextafter(scale.edge[i + 1], INFINITY)), i + 1);
        uint8_t a[3], b[3];
        qm_scale_colour(&scale, i, a);
        qm_scale_colour(&scale, i + 1, b);
        QM_CHECK(memcmp(a, b, 3) != 0, "bands %d and %d", i, i + 1);
    }
    assert_int_equal(qm_scale_band(&scale, 0.0), 0);
    assert_int_equal(qm_scale_band(&scale, INFINITY), QM_SCALE_BANDS);
    if (limit > 0.0) {
        QM_CHECK(scale.edge[scale.within] == limit, "limit %.17g is edge %.17g", limit,
                 scale.edge[scale.within]);
    } else {
        assert_int_equal(scale.within, 0);
        QM_CHECK(!isnan(range) || greatest == 0.0 || scale.edge[QM_SCALE_BANDS] >= greatest, "greatest %.17g",
                 greatest);
    }
    for (int i = 0; i <= QM_SCALE_BANDS && scale.within > 0; i++) {
        uint8_t colour[3];
        qm_scale_colour(&scale, i, colour);
        QM_CHECK(i < scale.within ? colour[2] > colour[0] : colour[0] > colour[2], "band %d of %d within", i,
                 scale.within);
    }
}

static void the_limit_is_the_edge_of_a_band(void **state)
{
    (void)state;
    for (size_t draw = 0; draw < 20000; draw++) {
        qm_random random = qm_random_make(qm_check_seed(), draw);
        double size = pow(10.0, qm_random_range(&random, -200.0, 200.0));
        double limit = draw % 4 == 0 ? (double)NAN : size * qm_random_range(&random, 0.01, 10.0);
        double range = draw % 3 == 0 ? (double)NAN : size * qm_random_range(&random, 0.01, 10.0);
        check_scale(limit, range, size * qm_random_range(&random, 0.01, 10.0));
    }
    check_scale(0.0, (double)NAN, 3.0);
    check_scale((double)NAN, (double)NAN, 0.0);
    check_scale(1.0, 1.0, 0.0);
}

/** The verdict on a result whose greatest distance is in [lower, upper], null where not finite, and which has signed figures. */
static qm_report_verdict judge(double lower, double upper, const char *side, qm_report_limits limits)
{
    char text[400], end[2][32];
    snprintf(end[0], sizeof end[0], isnan(lower) ? "null" : "%.17g", lower);
    snprintf(end[1], sizeof end[1], isnan(upper) ? "null" : "%.17g", upper);
    snprintf(text, sizeof text, "{\"symmetric\":{\"hausdorff\":{\"lower\":%s,\"upper\":%s}},\"a_to_b\":{%s}}",
             end[0], end[1], side);
    qm_json *result = qm_json_parse(text);
    assert_non_null(result);
    qm_report_verdict verdict = qm_report_judge(result, &limits);
    qm_json_free(result);
    return verdict;
}

static void a_verdict_needs_proof(void **state)
{
    (void)state;
    const double none = NAN;
    const struct {
        double lower, upper, limit;
        qm_report_verdict verdict;
    } cases[] = {{0.0, 1.0, none, QM_REPORT_NO_LIMIT},
                 {0.5, 1.0, 1.0, QM_REPORT_WITHIN},
                 {1.0, 1.5, 1.0, QM_REPORT_UNDECIDED},
                 {nextafter(1.0, 2.0), 1.5, 1.0, QM_REPORT_BEYOND},
                 {0.0, 0.0, 0.0, QM_REPORT_WITHIN},
                 /* An end that does not fit into a double is null in the result. */
                 {0.0, none, 1.0, QM_REPORT_UNDECIDED},
                 {none, none, 1.0, QM_REPORT_UNDECIDED}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const qm_report_limits limits = {cases[i].limit, none, none};
        QM_CHECK(judge(cases[i].lower, cases[i].upper, "", limits) == cases[i].verdict, "case %zu", i);
    }
}

static void signed_limits_are_about_sides(void **state)
{
    (void)state;
    static const char proven[] = "\"signed\":{\"proven\":true,\"inside\":{\"max\":{\"lower\":1,\"upper\":2}},"
                                 "\"outside\":{\"max\":{\"lower\":3,\"upper\":4}}}";
    static const char guessed[] =
        "\"signed\":{\"proven\":false,\"inside\":{\"max\":{\"lower\":1,\"upper\":2}},"
        "\"outside\":{\"max\":{\"lower\":3,\"upper\":4}}}";
    const double none = NAN;
    const struct {
        const char *side;
        qm_report_limits limits;
        qm_report_verdict verdict;
    } cases[] = {{proven, {none, 2.0, none}, QM_REPORT_WITHIN},
                 {proven, {none, 1.5, none}, QM_REPORT_UNDECIDED},
                 {proven, {none, 0.5, none}, QM_REPORT_BEYOND},
                 {proven, {none, none, 4.0}, QM_REPORT_WITHIN},
                 {proven, {none, none, 2.0}, QM_REPORT_BEYOND},
                 {proven, {none, 2.0, 4.0}, QM_REPORT_WITHIN},
                 {proven, {none, 2.0, 3.5}, QM_REPORT_UNDECIDED},
                 /* Beyond one limit is beyond, whatever is open. */
                 {proven, {none, 1.5, 2.0}, QM_REPORT_BEYOND},
                 {proven, {4.0, 2.0, 2.0}, QM_REPORT_BEYOND},
                 {proven, {2.0, 2.0, 4.0}, QM_REPORT_BEYOND},
                 {guessed, {none, 9.0, 9.0}, QM_REPORT_UNDECIDED},
                 {guessed, {none, none, 2.0}, QM_REPORT_UNDECIDED},
                 {"", {none, 9.0, none}, QM_REPORT_UNDECIDED}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        QM_CHECK(judge(3.0, 4.0, cases[i].side, cases[i].limits) == cases[i].verdict, "case %zu", i);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intervals_in_print_hold_those_of_the_result),
        cmocka_unit_test(shares_in_print_hold_those_of_the_result),
        cmocka_unit_test(digits_end_with_the_width),
        cmocka_unit_test(small_print_tells_what_is_certain),
        cmocka_unit_test(text_is_no_markup),
        cmocka_unit_test(the_limit_is_the_edge_of_a_band),
        cmocka_unit_test(a_verdict_needs_proof),
        cmocka_unit_test(signed_limits_are_about_sides),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
