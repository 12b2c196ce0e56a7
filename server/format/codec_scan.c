/**
 * codec_scan.c: blanks, words and numbers of text formats.
 */
#include "codec_scan.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "codec_builder.h"

void qm_scan_skip_mark(qm_scan *text)
{
    static const uint8_t mark[3] = {0xef, 0xbb, 0xbf};
    if (text->end - text->at >= 3 && memcmp(text->at, mark, sizeof mark) == 0) text->at += sizeof mark;
}

qm_status qm_scan_open(qm_scan *text, const uint8_t *bytes, size_t size, qm_codec_report *report)
{
    *text = (qm_scan){.at = bytes, .end = bytes + size, .line = 1, .report = report};
    const uint8_t *nul = memchr(bytes, 0, size);
    if (nul) {
        while (text->at < nul)
            if (qm_scan_is_line_end(*text->at))
                qm_scan_skip_line_end(text);
            else
                ++text->at;
        return qm_codec_fail(report, QM_E_FORMAT, "the text contains a NUL byte");
    }
    qm_scan_skip_mark(text);
    return QM_OK;
}

bool qm_scan_skip_joint(qm_scan *text)
{
    const uint8_t *next = text->at + 1;
    if (*text->at != '\\' || next == text->end || !qm_scan_is_line_end(*next)) return false;
    text->at = next;
    qm_scan_skip_line_end(text);
    return true;
}

void qm_scan_skip_long_line(qm_scan *text)
{
    while (text->at < text->end && !qm_scan_is_line_end(*text->at))
        ++text->at;
    if (text->at < text->end) qm_scan_skip_line_end(text);
}

void qm_scan_skip_long_statement(qm_scan *text)
{
    while (text->at < text->end && !qm_scan_is_line_end(*text->at))
        if (*text->at != '\\' || !qm_scan_skip_joint(text)) ++text->at;
    if (text->at < text->end) qm_scan_skip_line_end(text);
}

bool qm_scan_find_any_row(qm_scan *text)
{
    for (;;) {
        qm_scan_skip_blanks(text);
        if (text->at == text->end) return false;
        if (!qm_scan_at_row_end(text)) return true;
        qm_scan_skip_line(text);
    }
}

bool qm_scan_read_word(qm_scan *text, const uint8_t **word, size_t *size)
{
    qm_scan_skip_blanks(text);
    if (qm_scan_at_row_end(text)) return false;
    *word = text->at;
    while (text->at < text->end && !qm_scan_is_blank(*text->at) && !qm_scan_is_line_end(*text->at))
        ++text->at;
    *size = (size_t)(text->at - *word);
    return true;
}

const char *qm_scan_show(const uint8_t *word, size_t size, char shown[QM_SCAN_SHOWN_SIZE])
{
    static const char cut[] = "...";
    const size_t most = QM_SCAN_SHOWN_SIZE - sizeof cut;
    const size_t length = size < most ? size : most;
    for (size_t i = 0; i < length; ++i)
        shown[i] = (char)(word[i] > ' ' && word[i] < 0x7f && word[i] != '"' ? word[i] : '?');
    memcpy(shown + length, size > most ? cut : "", size > most ? sizeof cut : 1);
    return shown;
}

static bool is_digit(uint8_t c)
{
    return c >= '0' && c <= '9';
}

/** Whether a number may end here. */
static bool at_number_end(const qm_scan *text, const uint8_t *at)
{
    return at == text->end || qm_scan_is_blank(*at) || qm_scan_is_line_end(*at) || *at == '#' ||
           *at == '\\' || (*at == ',' && text->has_comma);
}

static bool starts_with(const qm_scan *text, const uint8_t *at, const char *lower)
{
    size_t length = strlen(lower);
    return (size_t)(text->end - at) >= length && qm_scan_word_is(at, length, lower);
}

/** Reports why there is no number. */
static qm_status fail_number(qm_scan *text)
{
    if (qm_scan_at_row_end(text))
        return qm_codec_fail(text->report, QM_E_FORMAT, "the line ends where a number is expected");
    const uint8_t *at = text->at;
    if (*at == '-' || *at == '+') ++at;
    if (starts_with(text, at, "nan") || starts_with(text, at, "inf"))
        return qm_codec_fail(text->report, QM_E_NOT_FINITE, "a coordinate is not a finite number");
    const uint8_t *digits = at;
    while (at < text->end && is_digit(*at))
        ++at;
    if (at > digits && at < text->end && *at == ',')
        return qm_codec_fail(text->report, QM_E_FORMAT,
                             "a number contains a comma; a decimal point is expected");
    return qm_codec_fail(text->report, QM_E_FORMAT, "expected a number");
}

static const uint64_t integer_powers_of_ten[] = {1u,
                                                 10u,
                                                 100u,
                                                 1000u,
                                                 10000u,
                                                 100000u,
                                                 1000000u,
                                                 10000000u,
                                                 100000000u,
                                                 1000000000u,
                                                 10000000000u,
                                                 100000000000u,
                                                 1000000000000u,
                                                 10000000000000u,
                                                 100000000000000u,
                                                 1000000000000000u,
                                                 10000000000000000u,
                                                 100000000000000000u,
                                                 1000000000000000000u,
                                                 10000000000000000000u};

static const double exact_powers_of_ten[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                             1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                             1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/** mantissa / 10^power with one rounding: the quotient has 63 bits or more, and its last bit also stands for
 * everything below it, so that rounding to 53 bits sees a tie only where there is one. */
static double divide_rounded(uint64_t mantissa, int power)
{
    int shift = __builtin_clzll(mantissa);
    unsigned __int128 dividend = (unsigned __int128)(mantissa << shift) << 64;
    uint64_t divisor = integer_powers_of_ten[power];
    unsigned __int128 quotient = dividend / divisor;
    quotient |= quotient * divisor != dividend;
    return ldexp((double)quotient, -64 - shift);
}

/**
 * mantissa * 10^power where that takes one rounding; false elsewhere.
 * Source: Clinger, How to Read Floating Point Numbers Accurately, 1990, section 3, for the exact powers.
 */
static bool scale_fast(uint64_t mantissa, int64_t power, double *number)
{
    if (mantissa <= (uint64_t)1 << 53) {
        if (power < -22 || power > 22) return false;
        *number = power < 0 ? (double)mantissa / exact_powers_of_ten[-power]
                            : (double)mantissa * exact_powers_of_ten[power];
        return true;
    }
    if (power < -19 || power > 19) return false;
    *number = power < 0 ? divide_rounded(mantissa, (int)-power)
                        : (double)((unsigned __int128)mantissa * integer_powers_of_ten[power]);
    return true;
}

#define MAX_NUMBER_SIZE 1200 /* more digits than any double has in full */

/** A function of its own, because its buffer would enlarge the stack frame of the fast path. */
__attribute__((noinline)) static qm_status scale_slow(qm_scan *text, const uint8_t *from, const uint8_t *to,
                                                      double *number)
{
    char copy[MAX_NUMBER_SIZE + 1];
    size_t length = (size_t)(to - from);
    if (length > MAX_NUMBER_SIZE)
        return qm_codec_fail(text->report, QM_E_FORMAT, "a number has more than %d characters",
                             MAX_NUMBER_SIZE);
    memcpy(copy, from, length);
    copy[length] = 0;
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) return QM_E_NO_MEMORY;
    *number = strtod_l(copy, NULL, plain);
    freelocale(plain);
    if (!isfinite(*number))
        return qm_codec_fail(text->report, QM_E_NOT_FINITE, "a number is too large for double precision");
    return QM_OK;
}

/** Reads an exponent like "e-12", if any; false if it has no digits. A huge one saturates. */
static bool scan_exponent(const qm_scan *text, const uint8_t **at, int64_t *exponent)
{
    const uint8_t *p = *at;
    if (p == text->end || (*p | 0x20) != 'e') return true;
    ++p;
    bool negative = p < text->end && *p == '-';
    if (p < text->end && (*p == '-' || *p == '+')) ++p;
    if (p == text->end || !is_digit(*p)) return false;
    int64_t value = 0;
    for (; p < text->end && is_digit(*p); ++p)
        if (value < 100000) value = 10 * value + (*p - '0');
    *exponent += negative ? -value : value;
    *at = p;
    return true;
}

/** Appends the digits at the current position to the number; returns their end. */
static inline const uint8_t *scan_digits(const uint8_t *p, const uint8_t *end, uint64_t *number)
{
    for (; p < end && is_digit(*p); ++p)
        *number = 10 * *number + (uint64_t)(*p - '0');
    return p;
}

/** The same, faster for more than two digits. */
static inline const uint8_t *scan_many_digits(const uint8_t *p, const uint8_t *end, uint64_t *number)
{
    while (end - p >= 8) {
        size_t count;
        const uint64_t digits = qm_scan_eight(p, &count);
        if (count == 0) return p;
        *number = integer_powers_of_ten[count] * *number + digits;
        p += count;
        if (count < 8) return p;
    }
    return scan_digits(p, end, number);
}

static qm_status read_any_number(qm_scan *text, double *number)
{
    qm_scan_skip_blanks(text);
    const uint8_t *p = text->at, *end = text->end;
    bool negative = p < end && *p == '-';
    if (p < end && (*p == '-' || *p == '+')) ++p;

    const uint8_t *first = p;
    uint64_t mantissa = 0; /* wraps beyond 19 digits, and is not used then */
    p = scan_digits(p, end, &mantissa);
    int64_t digit_count = p - first, exponent = 0;
    if (p < end && *p == '.') {
        const uint8_t *fraction = ++p;
        p = scan_many_digits(p, end, &mantissa);
        exponent = fraction - p;
        digit_count += p - fraction;
    }
    if (digit_count == 0 || !scan_exponent(text, &p, &exponent) || !at_number_end(text, p))
        return fail_number(text);

    if (digit_count > 19 || !scale_fast(mantissa, exponent, number)) {
        qm_status status = scale_slow(text, first, p, number);
        if (status != QM_OK) return status;
    }
    if (negative) *number = -*number;
    text->at = p;
    return QM_OK;
}

#define SHORT_NUMBER_SIZE 24 /* characters that the fast path may read */

/** The fast path for exponents like "e-12": two digits and an optional sign; NULL for others. */
static inline const uint8_t *read_short_exponent(const uint8_t *p, int *exponent)
{
    const bool negative = p[1] == '-';
    if ((*p | 0x20) != 'e') return NULL;
    p += negative || p[1] == '+' ? 2 : 1;
    if (!is_digit(p[0]) || !is_digit(p[1])) return NULL;
    const int value = 10 * (p[0] - '0') + (p[1] - '0');
    *exponent = negative ? -value : value;
    return p + 2;
}

/**
 * The fast path for the most common numbers: an optional sign and digits around a point, in sixteen characters
 * including the one after: a blank, a line end or a short exponent. Returns the end; NULL for other numbers. The position
 * of a number depends on the one before it by a single load, and no branch depends on the position of the point. Fourteen
 * digits, and powers of ten up to 22, are exact, so that quotient and product are rounded once.
 */
static inline const uint8_t *read_short_number(const uint8_t *p, double *number)
{
    const uint64_t negative = *p == '-';
    const uint64_t others = qm_scan_others(qm_scan_load(p)) ^ negative << 7;
    const uint64_t behind = others & (others - 1), is_long = -(uint64_t)(behind == 0);
    const uint64_t ends = behind | (qm_scan_others(qm_scan_load(p + 8)) & is_long);
    if (!others || !ends) return NULL;
    const uint8_t *const point = p + (size_t)__builtin_ctzll(others) / 8;
    const uint8_t *end = p + (is_long & 8) + (size_t)__builtin_ctzll(ends) / 8;
    p += negative;
    if (*point != '.' || end - p < 2) return NULL;
    const size_t place = (size_t)(point - p), count = (size_t)(end - p) - 1;
    const uint64_t before = (UINT64_C(1) << 8 * place) - 1;
    const uint64_t digits = (qm_scan_load(p) & before) | (qm_scan_load(p + 1) & ~before);
    uint64_t mantissa = qm_scan_join(digits, count < 8 ? count : 8);
    if (count > 8)
        mantissa = mantissa * integer_powers_of_ten[count - 8] + qm_scan_join(qm_scan_load(p + 9), count - 8);
    int power = (int)place - (int)count;
    double value = (double)(int64_t)mantissa;
    if (*end != ' ' && !qm_scan_is_line_end(*end)) {
        int exponent;
        end = read_short_exponent(end, &exponent);
        if (!end || (*end != ' ' && !qm_scan_is_line_end(*end))) return NULL;
        power += exponent;
        if (power < -22 || power > 22) return NULL;
    }
    value = power < 0 ? value / exact_powers_of_ten[-power] : value * exact_powers_of_ten[power];
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits |= negative << 63;
    memcpy(number, &bits, sizeof bits);
    return end;
}

qm_status qm_scan_read_number(qm_scan *text, double *number)
{
    const uint8_t *at = text->at;
    at += at < text->end && *at == ' ';
    at = text->end - at >= SHORT_NUMBER_SIZE ? read_short_number(at, number) : NULL;
    if (!at) return read_any_number(text, number);
    text->at = at;
    return QM_OK;
}

bool qm_scan_plain_position(qm_scan *text, double position[3])
{
    const uint8_t *at = text->at;
    if (text->end - at < 1 + 3 * SHORT_NUMBER_SIZE) return false;
    at += *at == ' ';
    for (int axis = 0; axis < 3; ++axis) {
        if (axis > 0 && *at++ != ' ') return false;
        at = read_short_number(at, position + axis);
        if (!at) return false;
    }
    text->at = at;
    return true;
}

qm_status qm_scan_read_position(qm_scan *text, double position[3])
{
    qm_status status = QM_OK;
    if (qm_scan_plain_position(text, position)) return QM_OK;
    for (int axis = 0; axis < 3 && status == QM_OK; ++axis)
        status = qm_scan_read_number(text, position + axis);
    return status;
}

#define SAFE_DIGITS 18 /* integers with so many digits fit 63 bits */

bool qm_scan_any_integer(qm_scan *text, int64_t *integer, bool *overflow)
{
    const uint8_t *p = text->at, *end = text->end;
    bool negative = p < end && *p == '-';
    *overflow = false;
    if (p < end && (*p == '-' || *p == '+')) ++p;
    const uint8_t *first = p;
    uint64_t value = 0;
    p = scan_many_digits(p, end, &value);
    if (p == first) return false;
    if (p - first > SAFE_DIGITS) { /* a longer one may fit, too; value wraps beyond 19 digits */
        while (first < p && *first == '0')
            ++first;
        *overflow = p - first > SAFE_DIGITS + 1 || value > INT64_MAX;
        if (*overflow) return false;
    }
    *integer = negative ? -(int64_t)value : (int64_t)value;
    text->at = p;
    return true;
}

qm_status qm_scan_read_integer(qm_scan *text, int64_t *integer)
{
    qm_scan_skip_blanks(text);
    if (qm_scan_at_row_end(text))
        return qm_codec_fail(text->report, QM_E_FORMAT, "the line ends where an integer is expected");
    bool overflow;
    if (!qm_scan_bare_integer(text, integer, &overflow))
        return overflow ? qm_codec_fail(text->report, QM_E_FORMAT, "an integer is too large")
                        : qm_codec_fail(text->report, QM_E_FORMAT, "expected an integer");
    if (!at_number_end(text, text->at))
        return qm_codec_fail(text->report, QM_E_FORMAT, "an integer is not followed by a blank");
    return QM_OK;
}
