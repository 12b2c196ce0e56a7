/**
 * etag.h: entity tags and the headers that compare them (RFC 9110, 8.8.3 and 13.1).
 */
#ifndef QM_ETAG_H
#define QM_ETAG_H

#include <stdbool.h>
#include <stdint.h>

#define QM_ETAG_SIZE 128

/** The strong tag of a revision of a mesh; suffix distinguishes its representations. */
void qm_etag_write_mesh(const char *hash, uint64_t revision, const char *suffix, char out[QM_ETAG_SIZE]);

/**
 * True when a list of tags, as If-Match and If-None-Match have it, names this one or is "*".
 *
 * list  NULL names nothing
 * etag  with its quotes, strong
 * weak  a tag of the list may be a weak one; If-None-Match allows that, If-Match does not
 */
bool qm_etag_is_listed(const char *list, const char *etag, bool weak);

#endif
