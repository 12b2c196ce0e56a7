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

/** The calls below where the line goes on. */
void qm_scan_skip_long_line(qm_scan *text);
void qm_scan_skip_long_statement(qm_scan *text);

/** Steps over the rest of the line and its end; a backslash joins no lines here. */
static inline void qm_scan_skip_line(qm_scan *text)
{
    if (text->at < text->end && *text->at == '\n')
        qm_scan_skip_line_end(text);
    else
        qm_scan_skip_long_line(text);
}

/** Steps over the rest of the line, the lines joined to it, and the end. */
static inline void qm_scan_skip_statement(qm_scan *text)
{
    if (text->at < text->end && *text->at == '\n')
        qm_scan_skip_line_end(text);
    else
        qm_scan_skip_long_statement(text);
}

/** The call below in all cases. */
bool qm_scan_find_any_row(qm_scan *text);

/** Steps over empty lines and comment lines to the first character of a row; false at the end of the text. */
static inline bool qm_scan_find_row(qm_scan *text)
{
    return (text->end > text->at && *text->at > '#' && *text->at != '\\') || qm_scan_find_any_row(text);
}

/** Steps over blanks and reads a word: bytes up to a blank or line end. False at the end of the row. */
bool qm_scan_read_word(qm_scan *text, const uint8_t **word, size_t *size);

static inline uint8_t qm_scan_to_lower(uint8_t c)
{
    return c >= 'A' && c <= 'Z' ? (uint8_t)(c | 0x20) : c;
}

/** True if the word is the lower-case one given, in any case. */
static inline bool qm_scan_word_is(const uint8_t *word, size_t size, const char *lower)
{
    if (size != strlen(lower)) return false;
    for (size_t i = 0; i < size; ++i)
        if (qm_scan_to_lower(word[i]) != (uint8_t)lower[i]) return false;
    return true;
}

/** Steps over blanks and reads a finite number. QM_E_FORMAT; QM_E_NOT_FINITE for NaN, infinity, overflow. */
qm_status qm_scan_read_number(qm_scan *text, double *number);

/** Three numbers of the commonest kind, each but the first after one blank and the last before a blank or the
 * line's end; false, and nothing read, for others. */
bool qm_scan_plain_position(qm_scan *text, double position[3]);

/** Three numbers. */
qm_status qm_scan_read_position(qm_scan *text, double position[3]);

#define QM_SCAN_ZEROS 0x3030303030303030u /* eight of the digit */

/** Eight characters, digits by their value. */
static inline uint64_t qm_scan_load(const uint8_t *p)
{
    uint64_t word;
    memcpy(&word, p, sizeof word);
    return le64toh(word) ^ QM_SCAN_ZEROS;
}

/** The high bit of each character that is no digit; behind one beyond ASCII also that of a nine. */
static inline uint64_t qm_scan_others(uint64_t word)
{
    /* A digit is 9 at most. What is more sets the high bit here, and carries where it is 0x8a or more. */
    return ((word + 0x7676767676767676u) | word) & 0x8080808080808080u;
}

/**
 * The number that the first characters of a word make, digits so many as count says, at most eight; 0 if
 * there is none. No branch depends on their count. Neighbours are joined to numbers of two, four and eight
 * digits, each step in all places of the word; what it leaves in the places between the next one drops.
 * Source: Lemire, Number Parsing at a Gigabyte per Second, Software: Practice and Experience 51, 2021.
 */
static inline uint64_t qm_scan_join(uint64_t word, size_t count)
{
    const size_t half = 32 - 4 * count;
    word = word << half << half; /* zeros come before the first digit; nothing is left after the last */
    word = word * (1 + (10u << 8)) >> 8;
    word = (word & 0x00ff00ff00ff00ffu) * (1 + (100u << 16)) >> 16;
    return (word & 0x0000ffff0000ffffu) * (1 + (UINT64_C(10000) << 32)) >> 32;
}

/** The number that the digits at p make, of which it looks at eight characters and counts those before the
 * first other one. */
static inline uint64_t qm_scan_eight(const uint8_t *p, size_t *count)
{
    const uint64_t word = qm_scan_load(p), others = qm_scan_others(word);
    *count = others ? (size_t)__builtin_ctzll(others) / 8 : 8;
    return qm_scan_join(word, *count);
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

#define QM_SCAN_SHORT_REACH 9 /* characters that the call below may look at */

/** The commonest whole number: fewer than eight digits from p on, then a blank or the line's end, where it
 * returns to; NULL for all others. */
static inline const uint8_t *qm_scan_short_integer(const uint8_t *p, uint32_t *integer)
{
    size_t count;
    *integer = (uint32_t)qm_scan_eight(p, &count);
    const bool ends = (p[count] == ' ') | (p[count] == '\n') | (p[count] == '\r');
    return (count > 0) & (count < 8) & ends ? p + count : NULL;
}

#define QM_SCAN_CORNERS_REACH (4 * QM_SCAN_SHORT_REACH) /* characters that the call below may look at */

/** So many such numbers, four at most, each after one blank, the first of which is at p; returns where they
 * end, or NULL for anything else. A single load leads from one number to the next. */
static inline const uint8_t *qm_scan_short_corners(const uint8_t *p, int count, uint32_t corners[4])
{
    for (int i = 0; i < count; ++i) {
        if (*p != ' ') return NULL;
        p = qm_scan_short_integer(p + 1, &corners[i]);
        if (!p) return NULL;
    }
    return p;
}

/** Reads the commonest row of a face, a three or a four and as many vertices below vertex_count; the fourth
 * corner of a triangle becomes QM_NO_INDEX. Further columns may follow. False, and nothing read, for other
 * rows. */
static inline bool qm_scan_plain_face(qm_scan *text, size_t vertex_count, uint32_t corners[4])
{
    if (text->end - text->at < 1 + QM_SCAN_CORNERS_REACH) return false;
    const bool is_quad = *text->at == '4';
    if (!is_quad && *text->at != '3') return false;
    const uint8_t *at = qm_scan_short_corners(text->at + 1, is_quad ? 4 : 3, corners);
    if (!at) return false;
    if (!is_quad) corners[3] = corners[0];
    for (int i = 0; i < 4; ++i)
        if (corners[i] >= vertex_count) return false;
    if (!is_quad) corners[3] = QM_NO_INDEX;
    text->at = at;
    return true;
}

/** Steps over blanks and reads a whole number. QM_E_FORMAT for anything else and for what does not fit 63
 * bits. */
qm_status qm_scan_read_integer(qm_scan *text, int64_t *integer);

#endif
