/* The text scanner: numbers bit for bit against strtod, line ends, joined lines. */
#include <inttypes.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "format/codec_scan.h"
#include "random.h"

/** Reads a number at the end of a text; in the middle of one, where the fast paths are taken, it must be
 * equal. */
static qm_status read_number(const char *word, double *number)
{
    static const char behind[] = " \n\r";
    qm_codec_report report;
    qm_scan text;
    size_t size = strlen(word);
    assert_int_equal(qm_scan_open(&text, (const uint8_t *)word, size, &report), QM_OK);
    qm_status status = qm_scan_read_number(&text, number);
    for (int i = 0; i < 3; ++i) {
        char longer[2100];
        double again = 0;
        snprintf(longer, sizeof longer, " %s%c%s", word, behind[i], "9.9-8.8 .77 7.e1 66..5,-4 3.3");
        qm_scan_open(&text, (const uint8_t *)longer, strlen(longer), &report);
        qm_status found = qm_scan_read_number(&text, &again);
        if (!word[0]) continue; /* the next number is read, or none */
        QM_CHECK(found == status, "%s: status %d, not %d", longer, found, status);
        if (status == QM_OK) assert_memory_equal(&again, number, sizeof again);
    }
    return status;
}

static void check_like_strtod(const char *word, uint64_t seed)
{
    double number = 0, expected = strtod(word, NULL);
    QM_CHECK(read_number(word, &number) == QM_OK, "%s refused, seed %" PRIu64, word, seed);
    QM_CHECK(memcmp(&number, &expected, sizeof number) == 0, "%s gives %a instead of %a, seed %" PRIu64, word,
             number, expected, seed);
}

static void hard_numbers_are_read_like_strtod(void **state)
{
    (void)state;
    static const char *const words[] = {"0",
                                        "-0",
                                        "+1",
                                        "1.",
                                        ".5",
                                        "-.5e1",
                                        "1e22",
                                        "1e23",
                                        "9007199254740993",
                                        "9007199254740992.5",
                                        "9007199254740993e-1",
                                        "1.7976931348623157e308",
                                        "2.2250738585072014e-308",
                                        "5e-324",
                                        "1e-400",
                                        "2.4703282292062327e-324",
                                        "0.30000000000000004",
                                        "123456789012345678e-19",
                                        "18446744073709551615",
                                        "9999999999999999999e-19",
                                        "9999999999999999999e19",
                                        "0000000000000000000000001.5",
                                        "0.00000000000000000000000000012345",
                                        "1.00000000000000011102230246251565404236316680908203125",
                                        "1.00000000000000011102230246251565404236316680908203126",
                                        "6.02214076E+23",
                                        "1e0000000000000000001",
                                        "0e99999999999"};
    for (size_t i = 0; i < sizeof words / sizeof *words; ++i)
        check_like_strtod(words[i], 0);
}

static void random_doubles_survive_printing(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 1);
    for (int i = 0; i < 100000; ++i) {
        char word[64];
        uint64_t bits = qm_random_bits(&random);
        double number;
        memcpy(&number, &bits, sizeof number);
        if (!(number - number == 0)) continue;
        snprintf(word, sizeof word, "%.17g", number);
        check_like_strtod(word, seed);
        /* Sizes of coordinates, where the fast ways are taken. */
        snprintf(word, sizeof word, "%.*f", (int)qm_random_below(&random, 19),
                 qm_random_range(&random, -1000, 1000));
        check_like_strtod(word, seed);
        snprintf(word, sizeof word, "%.*e", (int)qm_random_below(&random, 16),
                 ldexp(qm_random_range(&random, -1, 1), (int)qm_random_below(&random, 200) - 100));
        check_like_strtod(word, seed);
    }
}

static void random_digits_are_read_like_strtod(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 2);
    for (int i = 0; i < 200000; ++i) {
        char word[64];
        snprintf(word, sizeof word, "%" PRIu64 "e%d", qm_random_bits(&random) >> qm_random_below(&random, 64),
                 (int)qm_random_below(&random, 60) - 30);
        check_like_strtod(word, seed);
    }
}

static void other_words_are_no_numbers(void **state)
{
    (void)state;
    static const struct {
        const char *word;
        qm_status status;
    } cases[] = {
        {"", QM_E_FORMAT},
        {"x", QM_E_FORMAT},
        {"-", QM_E_FORMAT},
        {".", QM_E_FORMAT},
        {"e5", QM_E_FORMAT},
        {"1e", QM_E_FORMAT},
        {"1e+", QM_E_FORMAT},
        {"0x10", QM_E_FORMAT},
        {"1.2.3", QM_E_FORMAT},
        {"1,5", QM_E_FORMAT},
        {"1f", QM_E_FORMAT},
        {"--1", QM_E_FORMAT},
        {"1/2", QM_E_FORMAT},
        {"nan", QM_E_NOT_FINITE},
        {"-NaN", QM_E_NOT_FINITE},
        {"inf", QM_E_NOT_FINITE},
        {"-Infinity", QM_E_NOT_FINITE},
        {"1e999", QM_E_NOT_FINITE},
        {"-1.8e308", QM_E_NOT_FINITE},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        double number;
        QM_CHECK(read_number(cases[i].word, &number) == cases[i].status, "%s", cases[i].word);
    }
}

static void any_byte_among_digits_is_seen(void **state)
{
    (void)state;
    for (int byte = 1; byte < 256; ++byte)
        for (int place = 0; place < 8; ++place) {
            char word[] = "-0.12345678";
            word[3 + place] = (char)byte;
            bool is_digit = byte >= '0' && byte <= '9', ends = strchr(" \t\v\f\n\r#\\", byte) != NULL;
            bool is_exponent = (byte == 'e' || byte == 'E') && place < 7;
            if (is_exponent && place < 5) continue; /* too large */
            if (is_digit || is_exponent)
                check_like_strtod(word, 0);
            else {
                double number, expected;
                QM_CHECK(read_number(word, &number) == (ends ? QM_OK : QM_E_FORMAT), "%s", word);
                if (!ends) continue;
                word[3 + place] = 0;
                expected = strtod(word, NULL);
                assert_memory_equal(&number, &expected, sizeof number);
            }
        }
}

/** The fast way says the same as the other one, which read_number sees to. */
static void any_byte_in_an_exponent_is_seen(void **state)
{
    (void)state;
    static const char *const words[] = {"-1.234567e-01", "2.50000000E+17 ", "8.125e22 ", "1.5e-22\n",
                                        "7.e05 "};
    for (size_t i = 0; i < sizeof words / sizeof *words; ++i)
        for (int byte = 1; byte < 256; ++byte)
            for (size_t place = 0; place < strlen(words[i]); ++place) {
                char word[32];
                double number;
                strcpy(word, words[i]);
                word[place] = (char)byte;
                read_number(word, &number);
            }
}

static void very_long_number_is_refused(void **state)
{
    (void)state;
    char word[2000];
    double number;
    memset(word, '1', sizeof word - 1);
    word[sizeof word - 1] = 0;
    word[1] = '.';
    assert_int_equal(read_number(word, &number), QM_E_FORMAT);
    word[1000] = 0;
    check_like_strtod(word, 0);
}

static void comma_locale_changes_nothing(void **state)
{
    (void)state;
    /* Any that is installed will do; where none is, the numbers are still checked. */
    if (!setlocale(LC_NUMERIC, "de_DE.UTF-8") && !setlocale(LC_NUMERIC, "fr_FR.UTF-8"))
        print_message("no locale with decimal commas is installed\n");
    double fast = 0, slow = 0;
    assert_int_equal(read_number("1.5", &fast), QM_OK);
    assert_int_equal(read_number("1.50000000000000000000000000", &slow), QM_OK);
    setlocale(LC_NUMERIC, "C");
    assert_true(fast == 1.5 && slow == 1.5);
}

static void lines_are_counted_whatever_their_ends(void **state)
{
    (void)state;
    static const char *const texts[] = {"a\nb\n\nc", "a\r\nb\r\n\r\nc", "a\rb\r\rc", "a\nb # x\n#y\nc"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        qm_codec_report report;
        qm_scan text;
        qm_scan_open(&text, (const uint8_t *)texts[i], strlen(texts[i]), &report);
        static const size_t lines[] = {1, 2, 4};
        for (size_t row = 0; row < 3; ++row) {
            assert_true(qm_scan_find_row(&text));
            assert_int_equal(text.line, lines[row]);
            assert_int_equal(*text.at, 'a' + (int)row);
            qm_scan_skip_line(&text);
        }
        assert_false(qm_scan_find_row(&text));
    }
}

static void backslash_joins_lines_only_before_their_end(void **state)
{
    (void)state;
    static const char source[] = "1 \\\r\n2\\\n3 \\x\n";
    qm_codec_report report;
    qm_scan text;
    double number = 0;
    qm_scan_open(&text, (const uint8_t *)source, strlen(source), &report);
    for (int i = 1; i <= 3; ++i) {
        assert_int_equal(qm_scan_read_number(&text, &number), QM_OK);
        assert_true(number == i);
        assert_int_equal(text.line, i);
    }
    assert_int_equal(qm_scan_read_number(&text, &number), QM_E_FORMAT);
}

static void integers_stop_at_63_bits(void **state)
{
    (void)state;
    static const struct {
        const char *word;
        qm_status status;
        int64_t value;
    } cases[] = {{"-12", QM_OK, -12},
                 {"+7 ", QM_OK, 7},
                 {"900000000000000000", QM_OK, 900000000000000000},
                 {"9223372036854775807", QM_OK, INT64_MAX},
                 {"-0000000000000000000000000000012", QM_OK, -12},
                 {"9223372036854775808", QM_E_FORMAT, 0},
                 {"18446744073709551616", QM_E_FORMAT, 0},
                 {"99999999999999999999999999999999999999999", QM_E_FORMAT, 0},
                 {"1.0", QM_E_FORMAT, 0},
                 {"x", QM_E_FORMAT, 0},
                 {"", QM_E_FORMAT, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        qm_codec_report report;
        qm_scan text;
        int64_t value = 0;
        qm_scan_open(&text, (const uint8_t *)cases[i].word, strlen(cases[i].word), &report);
        QM_CHECK(qm_scan_read_integer(&text, &value) == cases[i].status, "%s", cases[i].word);
        if (cases[i].status == QM_OK) assert_int_equal(value, cases[i].value);
    }
}

/** Integers of every length that end at every distance from the end of the text, and with any byte after
 * them. */
static void integers_end_where_their_digits_do(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (size_t length = 1; length <= 18; ++length)
        for (int byte = 1; byte < 256; ++byte)
            for (size_t rest = 0; rest < 10; ++rest) {
                char word[40];
                for (size_t i = 0; i < length + 1 + rest; ++i)
                    word[i] = (char)('0' + qm_random_below(&random, 10));
                word[length + 1 + rest] = 0;
                bool is_digit = byte >= '0' && byte <= '9';
                if (!is_digit) word[length] = (char)byte;
                if (is_digit) word[length] = 0;
                qm_scan text = {.at = (uint8_t *)word,
                                .end = (uint8_t *)word + length + (is_digit ? 0 : 1 + rest)};
                int64_t value = 0, expected = strtoll(word, NULL, 10);
                bool overflow, found = qm_scan_bare_integer(&text, &value, &overflow);
                QM_CHECK(found && value == expected && (const char *)text.at == word + length,
                         "%s before byte %d gives %" PRId64 ", seed %" PRIu64, word, byte, value,
                         (uint64_t)qm_check_seed());
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hard_numbers_are_read_like_strtod),
        cmocka_unit_test(random_doubles_survive_printing),
        cmocka_unit_test(random_digits_are_read_like_strtod),
        cmocka_unit_test(other_words_are_no_numbers),
        cmocka_unit_test(any_byte_among_digits_is_seen),
        cmocka_unit_test(any_byte_in_an_exponent_is_seen),
        cmocka_unit_test(very_long_number_is_refused),
        cmocka_unit_test(comma_locale_changes_nothing),
        cmocka_unit_test(lines_are_counted_whatever_their_ends),
        cmocka_unit_test(backslash_joins_lines_only_before_their_end),
        cmocka_unit_test(integers_stop_at_63_bits),
        cmocka_unit_test(integers_end_where_their_digits_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
