/**
 * archive.h: archives by libzip, from memory and to memory. The library is loaded when a file needs it: with those that it
 * needs itself it would cost each start of the command line some milliseconds.
 */
#ifndef QM_ARCHIVE_H
#define QM_ARCHIVE_H

#include "base/text.h"
#include "codec.h"

typedef struct qm_archive qm_archive;

/**
 * Opens an archive; the bytes outlive it. Returns QM_OK; QM_E_FORMAT or QM_E_UNSUPPORTED (the library is not installed)
 * with report->detail; QM_E_NO_MEMORY.
 *
 * max_size  bytes that all its files may inflate to; 0: no limit
 */
qm_status qm_archive_open(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size,
                          qm_archive **out, qm_codec_report *report);
void qm_archive_close(qm_archive *zip); /* NULL is fine */

/** Whether there is a file of this name, in small or capital letters. */
bool qm_archive_has(const qm_archive *zip, const char *name);

/** Takes a block of a file; anything but QM_OK ends the reading. */
typedef qm_status qm_archive_take_fn(void *user, const char *bytes, size_t size, bool is_last);

/**
 * Inflates a file block by block. Returns what the callback returned last, or QM_E_FORMAT (damaged, or there is no such
 * file), QM_E_UNSUPPORTED (encrypted, or an unknown compression), QM_E_TOO_LARGE with report->detail; QM_E_CANCELED.
 */
qm_status qm_archive_read(qm_archive *zip, const char *name, qm_archive_take_fn *take, void *user,
                          qm_codec_report *report);

/** A file to be written; the bytes are the caller's. */
typedef struct qm_archive_file {
    const char *name, *bytes;
    size_t size;
} qm_archive_file;

/** Writes an archive of compressed files. QM_OK; QM_E_NO_MEMORY; QM_E_UNSUPPORTED: the library is not installed. */
qm_status qm_archive_write(const qm_archive_file *files, size_t count, qm_text *out);

#endif
