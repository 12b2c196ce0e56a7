/**
 * png.h: pictures as PNG, by libspng. The library, and zlib, which it needs, are loaded when a picture is written: programs
 * that write none start faster without them.
 */
#ifndef QM_PNG_H
#define QM_PNG_H

#include "base/text.h"

/** A picture of width * height pixels, row by row. */
typedef struct qm_png {
    int width, height;
    const uint8_t *pixels;       /* three bytes each, or with a palette one, an index */
    const uint8_t (*palette)[3]; /* NULL: none. The first colour is transparent */
    int palette_count;           /* at most 256 */
} qm_png;

typedef enum qm_png_status { QM_PNG_OK, QM_PNG_NO_LIBRARY, QM_PNG_NO_MEMORY } qm_png_status;

/** Appends the bytes of a file. */
qm_png_status qm_png_write(qm_text *out, const qm_png *picture);

/** Appends the picture as a data: URI. */
qm_png_status qm_png_write_uri(qm_text *out, const qm_png *picture);

#endif
