/**
 * utf8.h: which bytes are UTF-8.
 */
#ifndef QM_UTF8_H
#define QM_UTF8_H

#include <stddef.h>

/**
 * Length of the sequence at text (size >= 1 bytes are there), or 0 when it is none: no overlong form, no
 * surrogate, nothing beyond U+10FFFF.
 */
size_t qm_utf8_length(const char *text, size_t size);

#endif
