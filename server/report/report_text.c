/**
 * report_text.c: text, and intervals in as many digits as they deserve.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "report_internal.h"

void qm_report_add_escaped(qm_text *out, const char *text)
{
    for (size_t rest = strlen(text), length; rest > 0; text += length, rest -= length) {
        length = qm_text_utf8_length(text, rest);
        unsigned char first = (unsigned char)*text;
        if (length == 0 || (first < 32 && !strchr("\t\n", first)) || first == 127) {
            qm_text_add_string(out, "\xEF\xBF\xBD");
            length = 1;
        } else if (first == '&') {
            qm_text_add_string(out, "&amp;");
        } else if (first == '<') {
            qm_text_add_string(out, "&lt;");
        } else if (first == '>') {
            qm_text_add_string(out, "&gt;");
        } else if (first == '"') {
            qm_text_add_string(out, "&quot;");
        } else {
            qm_text_add(out, text, length);
        }
    }
}

void qm_report_add_number(qm_text *out, double number)
{
    if (isfinite(number))
        qm_text_printf(out, "%.6g", number);
    else
        qm_text_add_string(out, "unknown");
}

#define DIGITS_SIZE 400 /* of the largest double, with all of its places */

/** Prints a number to the place 10^place: with places after the point, or with an exponent where those would be many. Returns
 * the place of the last digit that was printed. */
static int print_to_place(double number, int place, char out[DIGITS_SIZE])
{
    double size = fabs(number);
    if (number == 0.0) {
        snprintf(out, DIGITS_SIZE, "0");
    } else if (size >= 1e-5 && size < 1e7) {
        place = place > 0 ? 0 : place < -22 ? -22 : place;
        snprintf(out, DIGITS_SIZE, "%.*f", -place, number);
    } else {
        int first = (int)floor(log10(size)), digits = first - place;
        digits = digits < 0 ? 0 : digits > 16 ? 16 : digits;
        snprintf(out, DIGITS_SIZE, "%.*e", digits, number);
        place = first - digits;
    }
    return place;
}

/** Prints a bound, rounded outward to a place: the printed number is at least as far out as the bound. */
static void print_bound(double bound, bool is_upper, int place, char out[DIGITS_SIZE])
{
    place = print_to_place(bound, place, out);
    double printed = strtod(out, NULL), unit = pow(10.0, place);
    if (is_upper ? printed >= bound : printed <= bound) return;
    /* The nearest number of the place lies on the inner side, so the next one lies on the other. */
    print_to_place(is_upper ? bound + unit : bound - unit, place, out);
    printed = strtod(out, NULL);
    /* Units below the bound's own precision: all of its digits. */
    if (is_upper ? printed < bound : printed > bound) qm_text_number(bound, out);
}

/** The place of the last digit: that of the width, and so many more. */
static int find_place(qm_report_interval interval, int spare)
{
    double width = interval.upper - interval.lower;
    return (int)floor(log10(width)) - spare;
}

static void add_digits(qm_text *out, double lower, double upper, int side, int spare)
{
    char digits[DIGITS_SIZE];
    double bound = side == 0 ? lower : upper;
    if (!isfinite(bound))
        snprintf(digits, sizeof digits, "unknown");
    else if (!(upper - lower >= 1e-300) || !isfinite(upper - lower))
        qm_text_number(bound, digits);
    else
        print_bound(bound, side == 1, find_place((qm_report_interval){lower, upper}, spare), digits);
    qm_text_add_string(out, digits);
}

void qm_report_add_bound(qm_text *out, qm_report_interval interval, int side, int spare)
{
    add_digits(out, interval.lower, interval.upper, side, spare);
}

/** A hundred times a share, rounded towards a number. */
static double to_percent(double share, double towards)
{
    double percent = 100.0 * share, rest = fma(100.0, share, -percent); /* what the product lost */
    bool is_inside = towards > percent ? rest > 0.0 : rest < 0.0;
    return is_inside ? nextafter(percent, towards) : percent;
}

void qm_report_add_interval(qm_text *out, qm_report_interval interval, bool is_share, int spare)
{
    const char *unit = is_share ? "&nbsp;%" : "";
    double lower = interval.lower, upper = interval.upper;
    if (is_share) {
        lower = to_percent(lower, 0.0);
        upper = to_percent(upper, INFINITY);
    }
    add_digits(out, lower, upper, 0, spare);
    if (lower != upper) {
        qm_text_add_string(out, " to ");
        add_digits(out, lower, upper, 1, spare);
    }
    qm_text_add_string(out, unit);
}

void qm_report_add_coordinate(qm_text *out, double number, double length)
{
    char digits[DIGITS_SIZE];
    if (length > 1e-300)
        print_to_place(number, (int)floor(log10(length)) - 6, digits);
    else
        qm_text_number(number, digits);
    qm_text_add_string(out, digits);
}

void qm_report_add_percent(qm_text *out, qm_report_interval share)
{
    double lower = 100.0 * share.lower, upper = 100.0 * share.upper;
    char low[32], high[32];
    for (int places = 1; places >= 0; places--) {
        snprintf(low, sizeof low, "%.*f", places, lower);
        snprintf(high, sizeof high, "%.*f", places, upper);
        if (strcmp(low, high) != 0) continue;
        bool is_below = upper > 0.0 && strtod(high, NULL) == 0.0;
        qm_text_printf(out, "%s", upper == 0.0 ? "0" : is_below ? places == 1 ? "&lt;0.1" : "&lt;1" : high);
        return;
    }
    qm_text_printf(out, "%.0f&ndash;%.0f", floor(lower), ceil(upper));
}
