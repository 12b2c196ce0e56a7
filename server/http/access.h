/**
 * access.h: who may use the daemon: clients with a bearer token (RFC 6750), and web pages by the host and the origin
 * that their browsers send (WHATWG Fetch, CORS protocol; RFC 6454 for origins).
 *
 * A line of the token file is "read TOKEN" or "write TOKEN", with a name for the log behind it if wanted; write includes
 * read. Empty lines and lines that start with # are skipped. Only hashes of the tokens are kept, and a given token is compared with all of them in constant time.
 * Threads: any call from any thread.
 */
#ifndef QM_ACCESS_H
#define QM_ACCESS_H

#include <stdbool.h>
#include <stddef.h>

/* ---- tokens ---- */

#define QM_ACCESS_TOKENS_MIN_LENGTH 16
#define QM_ACCESS_TOKENS_MESSAGE_SIZE 256
#define QM_ACCESS_NAME_SIZE 65

typedef enum qm_scope { QM_SCOPE_NONE, QM_SCOPE_READ, QM_SCOPE_WRITE } qm_scope;

typedef struct qm_tokens qm_tokens;

/** NULL when out of memory; without any token. */
qm_tokens *qm_access_tokens_create(void);
void qm_access_tokens_destroy(qm_tokens *tokens);

/**
 * Replaces all tokens by those of a file. False with a message, and no change, when the file cannot be read or has a
 * faulty line, which the message names. The first file must have a token; a later one without any, or that is gone,
 * revokes all.
 */
bool qm_access_tokens_load(qm_tokens *tokens, const char *path, char message[QM_ACCESS_TOKENS_MESSAGE_SIZE]);

size_t qm_access_tokens_count(qm_tokens *tokens);

/** True once a file was loaded: requests need a token from then on, also when all were revoked. */
bool qm_access_tokens_are_needed(qm_tokens *tokens);

/**
 * The scope of an Authorization header; NULL: none. Writes the name of the token, or the first digits of its SHA-256
 * when it has none; "" when the token is not valid. name may be NULL.
 */
qm_scope qm_access_tokens_check(qm_tokens *tokens, const char *authorization, char name[QM_ACCESS_NAME_SIZE]);

/* ---- hosts and origins ---- */

/** True when a list of origins with commas or blanks between them names this one, or is "*". */
bool qm_access_origin_is_listed(const char *list, const char *origin);

/** True when an origin is that of a page which was loaded from this host ("name:port", as Host has it). */
bool qm_access_origin_is_host(const char *origin, const char *host);

/**
 * True for a Host that stands for this machine by its address or as localhost. Any other name may be one that
 * a strange page has made resolve to this machine, so that its browser takes the daemon for its own server.
 */
bool qm_access_host_is_plain(const char *host);

#endif
