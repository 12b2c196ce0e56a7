/**
 * codec_scan.h: a scanner of text formats: rows, words, integers, and numbers as correctly rounded doubles in any locale.
 * Lines end with LF, CRLF or CR; a backslash before a line end joins two lines. Calls that fail write their message to
 * the report; its line is the current text->line.
 */
#ifndef QM_CODEC_SCAN_H
#define QM_CODEC_SCAN_H

#include <endian.h>
#include <string.h>

#include "codec.h"

typedef struct qm_scan {
    const uint8_t *at, *end;
    size_t line;    /* of at, from 1 */
    bool has_comma; /* a comma ends a number like a blank */
    qm_codec_report *report;
} qm_scan;

/** Skips the byte order mark of UTF-8. */
void qm_scan_skip_mark(qm_scan *text);

/** Starts at the first byte after a byte order mark. QM_E_FORMAT if the text contains a NUL byte. */
qm_status qm_scan_open(qm_scan *text, const uint8_t *bytes, size_t size, qm_codec_report *report);

static inline bool qm_scan_is_blank(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}

static inline bool qm_scan_is_line_end(uint8_t c)
{
    return c == '\n' || c == '\r';
}

/** Whether the scanner is at the end of the line or the text, or at a comment. */
static inline bool qm_scan_at_row_end(const qm_scan *text)
{
    return text->at == text->end || qm_scan_is_line_end(*text->at) || *text->at == '#';
}

/** Skips the LF, CRLF or CR at the current position. */
static inline void qm_scan_skip_line_end(qm_scan *text)
{
    if (*text->at++ == '\r' && text->at < text->end && *text->at == '\n') ++text->at;
    ++text->line;
}

/** Skips a backslash and the line end after it; false if there is none. */
bool qm_scan_skip_joint(qm_scan *text);

/** Skips blanks and joined line ends. */
static inline void qm_scan_skip_blanks(qm_scan *text)
{
    while (text->at < text->end &&
           (qm_scan_is_blank(*text->at) ? (++text->at, true) : *text->at == '\\' && qm_scan_skip_joint(text)))
        ;
}

/** The slow paths of the calls below, before the end of the line. */
void qm_scan_skip_long_line(qm_scan *text);
void qm_scan_skip_long_statement(qm_scan *text);

/** Skips the remainder of the line and its end; a backslash joins no lines here. */
static inline void qm_scan_skip_line(qm_scan *text)
{
    if (text->at < text->end && *text->at == '\n')
        qm_scan_skip_line_end(text);
    else
        qm_scan_skip_long_line(text);
}

/** Skips the remainder of the line, the lines joined to it, and the end. */
static inline void qm_scan_skip_statement(qm_scan *text)
{
    if (text->at < text->end && *text->at == '\n')
        qm_scan_skip_line_end(text);
    else
        qm_scan_skip_long_statement(text);
}

/** The slow path of the call below. */
bool qm_scan_find_any_row(qm_scan *text);

/** Skips empty lines and comments to the first character of a row; false at the end of the text. */
static inline bool qm_scan_find_row(qm_scan *text)
{
    return (text->end > text->at && *text->at > '#' && *text->at != '\\') || qm_scan_find_any_row(text);
}

/** Skips the remainder of the line and finds the next row. */
static inline bool qm_scan_find_next_row(qm_scan *text)
{
    qm_scan_skip_line(text);
    return qm_scan_find_row(text);
}

/** Skips blanks and reads a word: bytes up to a blank or line end. False at the end of the row. */
bool qm_scan_read_word(qm_scan *text, const uint8_t **word, size_t *size);

#define QM_SCAN_SHOWN_SIZE 28

/** Writes a word of the file for a message: ASCII, other bytes as question marks, cut when it is long. Returns shown. */
const char *qm_scan_show(const uint8_t *word, size_t size, char shown[QM_SCAN_SHOWN_SIZE]);

static inline uint8_t qm_scan_to_lower(uint8_t c)
{
    return c >= 'A' && c <= 'Z' ? (uint8_t)(c | 0x20) : c;
}

/** Compares a word with a lower-case one, ignoring case. */
static inline bool qm_scan_word_is(const uint8_t *word, size_t size, const char *lower)
{
    if (size != strlen(lower)) return false;
    for (size_t i = 0; i < size; ++i)
        if (qm_scan_to_lower(word[i]) != (uint8_t)lower[i]) return false;
    return true;
}

/** Skips blanks and reads a finite number. QM_E_FORMAT; QM_E_NOT_FINITE for NaN, infinity, overflow. */
qm_status qm_scan_read_number(qm_scan *text, double *number);

/** The fast path for three numbers in the most common form, separated by one blank each and followed by a blank or line
 * end. False, without reading anything, for other forms. */
bool qm_scan_plain_position(qm_scan *text, double position[3]);

/** Reads three numbers. */
qm_status qm_scan_read_position(qm_scan *text, double position[3]);

#define QM_SCAN_ZEROS 0x3030303030303030u /* "00000000" */

/** Loads eight characters and converts digits to their values. */
static inline uint64_t qm_scan_load(const uint8_t *p)
{
    uint64_t word;
    memcpy(&word, p, sizeof word);
    return le64toh(word) ^ QM_SCAN_ZEROS;
}

/** Sets the high bit of each character that is not a digit; after one beyond ASCII also that of a nine. */
static inline uint64_t qm_scan_others(uint64_t word)
{
    /* Values above 9 set the high bit here; values of 0x8a and more carry into the next character. */
    return ((word + 0x7676767676767676u) | word) & 0x8080808080808080u;
}

/**
 * The value of the first count digits of a word, at most eight; 0 for none. No branch depends on count. Each step joins
 * neighbours to numbers of two, four and eight digits, in all lanes of the word; the next step masks the lanes between.
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

/** The value of the digits at p, up to eight; *count is their number. Reads eight characters. */
static inline uint64_t qm_scan_eight(const uint8_t *p, size_t *count)
{
    const uint64_t word = qm_scan_load(p), others = qm_scan_others(word);
    *count = others ? (size_t)__builtin_ctzll(others) / 8 : 8;
    return qm_scan_join(word, *count);
}

/** The slow path of the call below. */
bool qm_scan_any_integer(qm_scan *text, int64_t *integer, bool *overflow);

/** Reads an integer without skipping blanks; the caller checks what follows. False if there is none, or with *overflow
 * if it exceeds 63 bits. */
static inline bool qm_scan_bare_integer(qm_scan *text, int64_t *integer, bool *overflow)
{
    size_t count = 0;
    if (text->end - text->at >= 8) *integer = (int64_t)qm_scan_eight(text->at, &count);
    if (count == 0 || count == 8) return qm_scan_any_integer(text, integer, overflow);
    *overflow = false;
    text->at += count;
    return true;
}

#define QM_SCAN_SHORT_SIZE 9 /* characters that qm_scan_short_integer may read */

/** The fast path for an integer of fewer than eight digits, followed by a blank or line end, to which it returns a
 * pointer; NULL for others. */
static inline const uint8_t *qm_scan_short_integer(const uint8_t *p, uint32_t *integer)
{
    size_t count;
    *integer = (uint32_t)qm_scan_eight(p, &count);
    const bool ends = (p[count] == ' ') | (p[count] == '\n') | (p[count] == '\r');
    return (count > 0) & (count < 8) & ends ? p + count : NULL;
}

#define QM_SCAN_CORNERS_SIZE (4 * QM_SCAN_SHORT_SIZE) /* characters that qm_scan_short_corners may read */

/** The fast path for count such integers, at most four, each after one blank, the first of which is at p. Returns their
 * end; NULL for other forms. The position of an integer depends on the one before it by a single load. */
static inline const uint8_t *qm_scan_short_corners(const uint8_t *p, int count, uint32_t corners[4])
{
    for (int i = 0; i < count; ++i) {
        if (*p != ' ') return NULL;
        p = qm_scan_short_integer(p + 1, &corners[i]);
        if (!p) return NULL;
    }
    return p;
}

/** The fast path for the row of a face: 3 or 4, and as many vertices below vertex_count; the fourth corner of a triangle
 * becomes QM_NO_INDEX. More columns may follow. False, without reading anything, for other rows. */
static inline bool qm_scan_plain_face(qm_scan *text, size_t vertex_count, uint32_t corners[4])
{
    if (text->end - text->at < 1 + QM_SCAN_CORNERS_SIZE) return false;
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

/** Skips blanks and reads an integer of up to 63 bits. QM_E_FORMAT for anything else. */
qm_status qm_scan_read_integer(qm_scan *text, int64_t *integer);

#endif
