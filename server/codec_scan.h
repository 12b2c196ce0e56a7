/**
 * codec_scan.h: a scanner over the bytes of a text format: rows, words, integers, and numbers in correctly
 * rounded doubles, whatever the locale. Lines end with LF, CRLF or CR; a backslash before a line end joins
 * two lines. Every call that can fail leaves its words in the report; the line is text->line at that moment.
 */
#ifndef QM_CODEC_SCAN_H
#define QM_CODEC_SCAN_H

#include <endian.h>
#include <string.h>

#include "codec.h"

typedef struct qm_scan {
    const uint8_t *at, *end;
    size_t line;    /* of at, from 1 */
    bool has_comma; /* a comma ends a number, as a blank does */
    qm_codec_report *report;
} qm_scan;

/** Starts at the first byte, after a byte order mark. QM_E_FORMAT if the text holds a NUL byte. */
qm_status qm_scan_open(qm_scan *text, const uint8_t *bytes, size_t size, qm_codec_report *report);

static inline bool qm_scan_is_blank(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}

static inline bool qm_scan_is_line_end(uint8_t c)
{
    return c == '\n' || c == '\r';
}

/** True at the end of the line, of the text, or where a comment begins. */
static inline bool qm_scan_at_row_end(const qm_scan *text)
{
    return text->at == text->end || qm_scan_is_line_end(*text->at) || *text->at == '#';
}

/** Steps over one LF, CRLF or CR, at which the text stands. */
static inline void qm_scan_skip_line_end(qm_scan *text)
{
    if (*text->at++ == '\r' && text->at < text->end && *text->at == '\n') ++text->at;
    ++text->line;
}

/** Steps over a backslash and the line end after it; false if that is not what stands there. */
bool qm_scan_skip_joint(qm_scan *text);

/** Steps over blanks and joined line ends. */
static inline void qm_scan_skip_blanks(qm_scan *text)
{
    while (text->at < text->end &&
           (qm_scan_is_blank(*text->at) ? (++text->at, true) : *text->at == '\\' && qm_scan_skip_joint(text)))
        ;
}

/** Steps over the rest of the line and its end; a backslash joins no lines here. */
void qm_scan_skip_line(qm_scan *text);

/** Steps over the rest of the line, the lines joined to it, and the end. */
void qm_scan_skip_statement(qm_scan *text);

/** Steps over empty lines and lines of comment to the first character of a row; false at the end of the text.
 */
bool qm_scan_find_row(qm_scan *text);

/** Steps over blanks and reads a word: bytes up to a blank or line end. False at the end of the row. */
bool qm_scan_read_word(qm_scan *text, const uint8_t **word, size_t *size);

/** True if the word is the lower-case one given, in any case. */
bool qm_scan_word_is(const uint8_t *word, size_t size, const char *lower);

/** Steps over blanks and reads a finite number. QM_E_FORMAT; QM_E_NOT_FINITE for NaN, infinity, overflow. */
qm_status qm_scan_read_number(qm_scan *text, double *number);

/** Three numbers. */
qm_status qm_scan_read_position(qm_scan *text, double position[3]);

/**
 * The number that the digits at p make, of which it looks at eight characters and counts those before the
 * first other one; anything if there is none. No branch depends on their count. Neighbours are joined to
 * numbers of two, four and eight digits, each step in all places of the word. Source: Lemire, Number Parsing
 * at a Gigabyte per Second, Software: Practice and Experience 51, 2021.
 */
static inline uint64_t qm_scan_eight(const uint8_t *p, size_t *count)
{
    uint64_t word;
    memcpy(&word, p, sizeof word);
    word = le64toh(word) ^ 0x3030303030303030u;
    /* A digit is now 9 at most. What is more sets the high bit here, and disturbs only what comes after. */
    const uint64_t others = ((word + 0x7676767676767676u) | word) & 0x8080808080808080u;
    *count = others ? (size_t)__builtin_ctzll(others) / 8 : 8;
    word <<=
        (64 - 8 * *count) & 63; /* zeros come before the first digit; no others are left after the last */
    word = (10 * word + (word >> 8)) & 0x00ff00ff00ff00ffu;
    word = (100 * word + (word >> 16)) & 0x0000ffff0000ffffu;
    return (10000 * word + (word >> 32)) & 0xffffffffu;
}

/** The call below in all cases. */
bool qm_scan_any_integer(qm_scan *text, int64_t *integer, bool *overflow);

/** What an integer may be followed by is left to the caller: steps over no blanks. False if there is none, or
 * none that fits 63 bits, told apart by *overflow. */
static inline bool qm_scan_bare_integer(qm_scan *text, int64_t *integer, bool *overflow)
{
    size_t count = 0;
    if (text->end - text->at >= 8) *integer = (int64_t)qm_scan_eight(text->at, &count);
    if (count == 0 || count == 8) return qm_scan_any_integer(text, integer, overflow);
    *overflow = false;
    text->at += count;
    return true;
}

/** Steps over blanks and reads a whole number. QM_E_FORMAT for anything else and for what does not fit 63
 * bits. */
qm_status qm_scan_read_integer(qm_scan *text, int64_t *integer);

#endif
