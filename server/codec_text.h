/**
 * codec_text.h: a scanner over the bytes of a text format: rows, words, integers, and numbers in correctly
 * rounded doubles, whatever the locale. Lines end with LF, CRLF or CR; a backslash before a line end joins
 * two lines. Every call that can fail leaves its words in the report; the line is text->line at that moment.
 */
#ifndef QM_CODEC_TEXT_H
#define QM_CODEC_TEXT_H

#include "codec.h"

typedef struct qm_text {
    const uint8_t *at, *end;
    size_t line;    /* of at, from 1 */
    bool has_comma; /* a comma ends a number, as a blank does */
    qm_codec_report *report;
} qm_text;

/** Starts at the first byte, after a byte order mark. QM_E_FORMAT if the text holds a NUL byte. */
qm_status qm_text_open(qm_text *text, const uint8_t *bytes, size_t size, qm_codec_report *report);

static inline bool qm_text_is_blank(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}

static inline bool qm_text_is_line_end(uint8_t c)
{
    return c == '\n' || c == '\r';
}

/** True at the end of the line, of the text, or where a comment begins. */
static inline bool qm_text_at_row_end(const qm_text *text)
{
    return text->at == text->end || qm_text_is_line_end(*text->at) || *text->at == '#';
}

/** Steps over one LF, CRLF or CR, at which the text stands. */
static inline void qm_text_skip_line_end(qm_text *text)
{
    if (*text->at++ == '\r' && text->at < text->end && *text->at == '\n') ++text->at;
    ++text->line;
}

/** Steps over a backslash and the line end after it; false if that is not what stands there. */
bool qm_text_skip_joint(qm_text *text);

/** Steps over blanks and joined line ends. */
static inline void qm_text_skip_blanks(qm_text *text)
{
    while (text->at < text->end &&
           (qm_text_is_blank(*text->at) ? (++text->at, true) : *text->at == '\\' && qm_text_skip_joint(text)))
        ;
}

/** Steps over the rest of the line and its end; a backslash joins no lines here. */
void qm_text_skip_line(qm_text *text);

/** Steps over the rest of the line, the lines joined to it, and the end. */
void qm_text_skip_statement(qm_text *text);

/** Steps over empty lines and lines of comment to the first character of a row; false at the end of the text.
 */
bool qm_text_find_row(qm_text *text);

/** Steps over blanks and reads a word: bytes up to a blank or line end. False at the end of the row. */
bool qm_text_read_word(qm_text *text, const uint8_t **word, size_t *size);

/** True if the word is the lower-case one given, in any case. */
bool qm_text_word_is(const uint8_t *word, size_t size, const char *lower);

/** Steps over blanks and reads a finite number. QM_E_FORMAT; QM_E_NOT_FINITE for NaN, infinity, overflow. */
qm_status qm_text_read_number(qm_text *text, double *number);

/** Three numbers. */
qm_status qm_text_read_position(qm_text *text, double position[3]);

/** What an integer may be followed by is left to the caller: steps over no blanks. False if there is none, or
 * none that fits 63 bits, told apart by *overflow. */
bool qm_text_scan_integer(qm_text *text, int64_t *integer, bool *overflow);

/** Steps over blanks and reads a whole number. QM_E_FORMAT for anything else and for what does not fit 63
 * bits. */
qm_status qm_text_read_integer(qm_text *text, int64_t *integer);

#endif
