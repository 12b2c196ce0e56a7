/**
 * access.c: the token file and the comparison in constant time; hosts and origins.
 */
#include "access.h"

#include <arpa/inet.h>
#include <errno.h>
#include <nettle/memops.h>
#include <nettle/sha2.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define MAX_TOKENS 1024
#define MAX_LINE 1024
#define BLANK " \t\r\n"
#define SEPARATORS ", \t"

/* ---- tokens ---- */

typedef struct token {
    uint8_t hash[SHA256_DIGEST_SIZE];
    qm_scope scope;
    char name[QM_ACCESS_NAME_SIZE];
} token;

/** lock guards list, count and are_needed. */
struct qm_tokens {
    pthread_rwlock_t lock;
    token *list;
    size_t count;
    bool are_needed;
};

qm_tokens *qm_access_tokens_create(void)
{
    qm_tokens *tokens = calloc(1, sizeof *tokens);
    if (tokens) pthread_rwlock_init(&tokens->lock, NULL);
    return tokens;
}

void qm_access_tokens_destroy(qm_tokens *tokens)
{
    if (!tokens) return;
    pthread_rwlock_destroy(&tokens->lock);
    free(tokens->list);
    free(tokens);
}

static void hash_token(const char *text, size_t size, uint8_t out[SHA256_DIGEST_SIZE])
{
    struct sha256_ctx hash;
    sha256_init(&hash);
    sha256_update(&hash, size, (const uint8_t *)text);
    sha256_digest(&hash, SHA256_DIGEST_SIZE, out);
}

/** The first digits of a hash: enough to find the line of a token, too few to test guesses with. */
static void name_by_hash(const uint8_t hash[SHA256_DIGEST_SIZE], char out[QM_ACCESS_NAME_SIZE])
{
    for (size_t i = 0; i < 4; i++)
        snprintf(out + 2 * i, 3, "%02x", hash[i]);
}

/** True for a name that a log can have as it is. */
static bool is_name(const char *text)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._@-";
    size_t length = strspn(text, letters);
    return length > 0 && length < QM_ACCESS_NAME_SIZE && !text[length];
}

/** Reads "scope token" or "scope token name"; false with a fault, which never has the token. */
static bool read_line(char *line, token *out, const char **fault)
{
    char *rest = NULL, *scope = strtok_r(line, BLANK, &rest), *text = strtok_r(NULL, BLANK, &rest),
         *name = text ? strtok_r(NULL, BLANK, &rest) : NULL;
    out->scope = strcmp(scope, "read") == 0    ? QM_SCOPE_READ
                 : strcmp(scope, "write") == 0 ? QM_SCOPE_WRITE
                                               : QM_SCOPE_NONE;
    *fault = out->scope == QM_SCOPE_NONE            ? "does not start with read or write"
             : !text                                ? "has no token"
             : name && strtok_r(NULL, BLANK, &rest) ? "has more than a scope, a token and a name"
             : name && !is_name(name) ? "has a name of other characters than letters, digits and ._@-"
             : strlen(text) < QM_ACCESS_TOKENS_MIN_LENGTH ? "has a token that is too short"
                                                          : NULL;
    if (*fault) return false;
    hash_token(text, strlen(text), out->hash);
    if (name)
        snprintf(out->name, sizeof out->name, "%s", name);
    else
        name_by_hash(out->hash, out->name);
    return true;
}

/** Reads the lines into a list of MAX_TOKENS and counts them; false with a message. */
static bool read_lines(FILE *file, token *list, size_t *count, char message[QM_ACCESS_TOKENS_MESSAGE_SIZE])
{
    char line[MAX_LINE];
    *count = 0;
    const char *fault = NULL;
    int number = 0;
    while (!fault && fgets(line, sizeof line, file)) {
        number++;
        const char *start = line + strspn(line, BLANK);
        if (strlen(line) + 1 == sizeof line)
            fault = "is too long";
        else if (*count == MAX_TOKENS)
            fault = "is one token too many";
        else if (*start && *start != '#' && read_line(line, &list[*count], &fault))
            ++*count;
    }
    explicit_bzero(line, sizeof line);
    if (fault) snprintf(message, QM_ACCESS_TOKENS_MESSAGE_SIZE, "line %d %s", number, fault);
    return !fault;
}

bool qm_access_tokens_load(qm_tokens *tokens, const char *path, char message[QM_ACCESS_TOKENS_MESSAGE_SIZE])
{
    FILE *file = fopen(path, "re");
    if (!file && (errno != ENOENT || !qm_access_tokens_are_needed(tokens))) {
        snprintf(message, QM_ACCESS_TOKENS_MESSAGE_SIZE, "%s", strerror(errno));
        return false;
    }
    token *list = calloc(MAX_TOKENS, sizeof *list);
    size_t count = 0;
    bool is_read = list && (!file || read_lines(file, list, &count, message));
    if (!list) snprintf(message, QM_ACCESS_TOKENS_MESSAGE_SIZE, "out of memory");
    if (file) fclose(file);
    if (is_read && count == 0 && !qm_access_tokens_are_needed(tokens)) {
        snprintf(message, QM_ACCESS_TOKENS_MESSAGE_SIZE, "it holds no token");
        is_read = false;
    }
    if (!is_read) {
        free(list);
        return false;
    }
    pthread_rwlock_wrlock(&tokens->lock);
    token *old = tokens->list;
    tokens->list = list;
    tokens->count = count;
    tokens->are_needed = true;
    pthread_rwlock_unlock(&tokens->lock);
    free(old);
    return true;
}

size_t qm_access_tokens_count(qm_tokens *tokens)
{
    pthread_rwlock_rdlock(&tokens->lock);
    size_t count = tokens->count;
    pthread_rwlock_unlock(&tokens->lock);
    return count;
}

bool qm_access_tokens_are_needed(qm_tokens *tokens)
{
    pthread_rwlock_rdlock(&tokens->lock);
    bool are_needed = tokens->are_needed;
    pthread_rwlock_unlock(&tokens->lock);
    return are_needed;
}

qm_scope qm_access_tokens_check(qm_tokens *tokens, const char *authorization, char name[QM_ACCESS_NAME_SIZE])
{
    static const char scheme[] = "Bearer ";
    if (name) name[0] = '\0';
    if (!authorization || strncasecmp(authorization, scheme, strlen(scheme)) != 0) return QM_SCOPE_NONE;
    const char *text = authorization + strlen(scheme);
    text += strspn(text, BLANK);
    uint8_t hash[SHA256_DIGEST_SIZE];
    hash_token(text, strcspn(text, BLANK), hash);
    qm_scope scope = QM_SCOPE_NONE;
    pthread_rwlock_rdlock(&tokens->lock);
    for (size_t i = 0; i < tokens->count; i++) {
        if (!memeql_sec(hash, tokens->list[i].hash, sizeof hash) || tokens->list[i].scope <= scope) continue;
        scope = tokens->list[i].scope;
        if (name) snprintf(name, QM_ACCESS_NAME_SIZE, "%s", tokens->list[i].name);
    }
    pthread_rwlock_unlock(&tokens->lock);
    return scope;
}

/* ---- hosts and origins ---- */

bool qm_access_origin_is_listed(const char *list, const char *origin)
{
    size_t length = strlen(origin);
    for (list += strspn(list, SEPARATORS); *list; list += strspn(list, SEPARATORS)) {
        size_t size = strcspn(list, SEPARATORS);
        if ((size == 1 && *list == '*') || (size == length && strncasecmp(list, origin, length) == 0))
            return true;
        list += size;
    }
    return false;
}

bool qm_access_origin_is_host(const char *origin, const char *host)
{
    const char *name = strstr(origin, "://");
    return name && host && strcasecmp(name + strlen("://"), host) == 0;
}

bool qm_access_host_is_plain(const char *host)
{
    char name[64];
    struct in6_addr address;
    if (!host || !*host) return true;
    /* Without the port, and without the brackets of an address of version 6. */
    bool has_brackets = *host == '[';
    if (has_brackets) host++;
    size_t length = strcspn(host, has_brackets ? "]" : ":");
    if (length >= sizeof name || (has_brackets && host[length] != ']')) return false;
    memcpy(name, host, length);
    name[length] = '\0';
    return strcasecmp(name, "localhost") == 0 || inet_pton(AF_INET, name, &address) == 1 ||
           inet_pton(AF_INET6, name, &address) == 1;
}
