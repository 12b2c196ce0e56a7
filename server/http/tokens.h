/**
 * tokens.h: bearer tokens (RFC 6750) from a file, each with a scope.
 *
 * A line of the file is "read TOKEN" or "write TOKEN"; write includes read. Empty lines and lines that start
 * with # are passed over. Only hashes of the tokens are kept, and a given token is compared with all of them
 * in constant time. Threads: any call from any thread.
 */
#ifndef QM_TOKENS_H
#define QM_TOKENS_H

#include <stdbool.h>
#include <stddef.h>

#define QM_TOKENS_MIN_LENGTH 16
#define QM_TOKENS_MESSAGE_SIZE 256

typedef enum qm_scope { QM_SCOPE_NONE, QM_SCOPE_READ, QM_SCOPE_WRITE } qm_scope;

typedef struct qm_tokens qm_tokens;

/** NULL when out of memory; without any token. */
qm_tokens *qm_tokens_create(void);
void qm_tokens_destroy(qm_tokens *tokens);

/** Replaces all tokens by those of a file. False with a message, and no change, when the file cannot be read,
 * has a faulty line (which the message names) or no token. */
bool qm_tokens_load(qm_tokens *tokens, const char *path, char message[QM_TOKENS_MESSAGE_SIZE]);

size_t qm_tokens_count(qm_tokens *tokens);

/** What the holder of an Authorization header may do; NULL: nothing. */
qm_scope qm_tokens_check(qm_tokens *tokens, const char *authorization);

#endif
