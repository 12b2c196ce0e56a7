/**
 * place_s3.c: blobs as objects of a bucket, by the protocol of S3 (Amazon S3 API Reference, version 2006-03-01) over
 * libcurl, which signs requests (AWS Signature Version 4). The library is loaded when such a place is opened, so that
 * a daemon without one runs without it.
 *
 * An object is put by one request, which S3 takes up to 5 GiB of: it appears whole or not at all, the server compares
 * its bytes with the hash that is signed, and nothing is left behind to be collected. Parts would be needed beyond.
 *
 * The bucket stands in the path of the URL, as every server of this protocol understands it.
 */
#include <ctype.h>
#include <curl/curl.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/library.h"
#include "base/log.h"
#include "place.h"

#define LARGEST 5368709120u /* bytes of an object that is put by one request */
#define ADDRESS_SIZE 1024
#define KEY_SIZE 256
#define TOKEN_SIZE 4096
#define IDLE 8               /* connections that wait for a request */
#define CONNECT_S 3L         /* for a connection */
#define SILENCE_S 10L        /* that a request may take without a byte */
#define REPEATING_MS 5000.0  /* since its start, that a request is repeated after a fault */
#define FIRST_DELAY_MS 100.0 /* before that; doubles */
#define REPLY_SIZE 1024      /* of an error, to find its code in */
#define NO_BYTES "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" /* SHA-256 of nothing */
#define LIBRARY "libcurl.so.4" /* the soname since 2006 */

/* ---- libcurl ---- */

/** The functions in use, without the prefix curl_. */
#define CURL_MAP(XX)                                                                                         \
    XX(global_init)                                                                                          \
    XX(easy_init)                                                                                            \
    XX(easy_reset)                                                                                           \
    XX(easy_cleanup)                                                                                         \
    XX(easy_setopt)                                                                                          \
    XX(easy_getinfo)                                                                                         \
    XX(easy_perform)                                                                                         \
    XX(easy_strerror)                                                                                        \
    XX(slist_append)                                                                                         \
    XX(slist_free_all)

/* The header has macros of these names that check types. */
#undef curl_easy_setopt
#undef curl_easy_getinfo

static struct {
#define XX(name) __typeof__(curl_##name) *name;
    CURL_MAP(XX)
#undef XX
} curl;

/** Loads the library, which stays loaded; from version 7.84 on also beside threads that use OpenSSL. */
static bool load_curl(char message[QM_MESSAGE_SIZE])
{
    void *library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
#define XX(name) &&qm_library_find(library, "curl_" #name, &curl.name)
    bool is_loaded = library CURL_MAP(XX);
#undef XX
    if (is_loaded && curl.global_init(CURL_GLOBAL_DEFAULT) == 0) return true;
    const char *reason = dlerror();
    snprintf(message, QM_MESSAGE_SIZE, "blobs: libcurl cannot be loaded (Debian: libcurl4): %.160s",
             reason ? reason : LIBRARY);
    return false;
}

/* ---- the place ---- */

typedef struct s3_place {
    qm_place base;
    char address[ADDRESS_SIZE]; /* of the bucket, and the prefix of its objects */
    char signature[128];        /* what libcurl signs for */
    char *keys;                 /* file; "" for the environment */
    pthread_mutex_t lock;       /* guards what follows */
    CURL *idle[IDLE];
    size_t idle_count;
} s3_place;

static CURL *take_handle(s3_place *self)
{
    CURL *handle = NULL;
    pthread_mutex_lock(&self->lock);
    if (self->idle_count > 0) handle = self->idle[--self->idle_count];
    pthread_mutex_unlock(&self->lock);
    return handle ? handle : curl.easy_init();
}

static void give_back(s3_place *self, CURL *handle)
{
    curl.easy_reset(handle); /* its connection stays */
    pthread_mutex_lock(&self->lock);
    bool stays = self->idle_count < IDLE;
    if (stays) self->idle[self->idle_count++] = handle;
    pthread_mutex_unlock(&self->lock);
    if (!stays) curl.easy_cleanup(handle);
}

/* ---- keys ---- */

typedef struct key_pair {
    char id[KEY_SIZE], secret[KEY_SIZE], token[TOKEN_SIZE];
} key_pair;

static void copy_value(const char *value, char *out, size_t size)
{
    value += strspn(value, " \t=");
    snprintf(out, size, "%.*s", (int)strcspn(value, " \t\r\n"), value);
}

/** Reads the lines of a file as AWS's own programs have it: aws_access_key_id = ..., and so on. */
static bool read_keys(const char *path, key_pair *out)
{
    static const char id[] = "aws_access_key_id", secret[] = "aws_secret_access_key",
                      token[] = "aws_session_token";
    char line[TOKEN_SIZE + 64];
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file)) {
        const char *name = line + strspn(line, " \t");
        if (strncasecmp(name, id, strlen(id)) == 0) copy_value(name + strlen(id), out->id, KEY_SIZE);
        if (strncasecmp(name, secret, strlen(secret)) == 0)
            copy_value(name + strlen(secret), out->secret, KEY_SIZE);
        if (strncasecmp(name, token, strlen(token)) == 0)
            copy_value(name + strlen(token), out->token, TOKEN_SIZE);
    }
    if (file) fclose(file);
    return file;
}

/** Finds the keys, which others may replace while the daemon runs. */
static bool find_keys(s3_place *self, key_pair *out)
{
    static const char *const names[] = {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"};
    *out = (key_pair){0};
    if (self->keys[0] && !read_keys(self->keys, out)) {
        qm_place_fail(&self->base, "the file of keys cannot be read");
        return false;
    }
    char *const values[] = {out->id, out->secret, out->token};
    static const size_t sizes[] = {KEY_SIZE, KEY_SIZE, TOKEN_SIZE};
    for (size_t i = 0; !self->keys[0] && i < sizeof names / sizeof names[0]; i++) {
        const char *value = getenv(names[i]);
        copy_value(value ? value : "", values[i], sizes[i]);
    }
    if (out->id[0] && out->secret[0]) return true;
    qm_place_fail(&self->base,
                  "there are no keys for the bucket: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY in "
                  "the environment, or in the file of --blobs-keys");
    return false;
}

/* ---- requests ---- */

typedef struct s3_request {
    const char *method, *name;
    const char *hash; /* of the bytes that are sent */
    int file;         /* for the bytes that are sent or received */
    uint64_t size;    /* that is sent */
    uint64_t sent;
    CURL *handle;
    long code;              /* of the reply, in HTTP; 0: none */
    qm_stored local;        /* whether the file could be written */
    int64_t length;         /* that the reply says; -1: it does not */
    char reply[REPLY_SIZE]; /* the start of an error */
    size_t reply_size;
} s3_request;

static size_t send_bytes(char *bytes, size_t size, size_t count, void *user)
{
    s3_request *request = user;
    ssize_t got = qm_place_read(request->file, bytes, size * count, request->sent);
    if (got < 0) return CURL_READFUNC_ABORT;
    request->sent += (uint64_t)got;
    return (size_t)got;
}

/** libcurl sends a request anew on another connection when the first one turns out to be closed. */
static int rewind_bytes(void *user, curl_off_t offset, int origin)
{
    s3_request *request = user;
    if (origin != SEEK_SET) return CURL_SEEKFUNC_CANTSEEK;
    request->sent = (uint64_t)offset;
    return CURL_SEEKFUNC_OK;
}

static size_t take_bytes(char *bytes, size_t size, size_t count, void *user)
{
    s3_request *request = user;
    long code = 0;
    size *= count;
    curl.easy_getinfo(request->handle, CURLINFO_RESPONSE_CODE, &code);
    if (code == 200 && request->file >= 0) {
        request->local = qm_place_write(request->file, bytes, size);
        return request->local == QM_STORED ? size : 0;
    }
    size_t room = sizeof request->reply - 1 - request->reply_size, part = size < room ? size : room;
    memcpy(request->reply + request->reply_size, bytes, part);
    request->reply_size += part;
    return size;
}

/** What the server says of an error: the text of the element Code. */
static void find_code(const s3_request *request, char out[64])
{
    const char *start = strstr(request->reply, "<Code>");
    if (start)
        snprintf(out, 64, "%.*s", (int)strcspn(start + 6, "<"), start + 6);
    else
        snprintf(out, 64, "HTTP %ld", request->code);
}

static struct curl_slist *make_headers(const s3_request *request, const key_pair *keys)
{
    char line[TOKEN_SIZE + 64];
    snprintf(line, sizeof line, "x-amz-content-sha256: %s", request->hash);
    struct curl_slist *headers = curl.slist_append(NULL, line), *longer = headers;
    snprintf(line, sizeof line, "x-amz-security-token: %s", keys->token);
    if (headers && keys->token[0]) longer = curl.slist_append(headers, line);
    if (longer) return longer;
    curl.slist_free_all(headers);
    return NULL;
}

static void set_up(s3_place *self, s3_request *request, const key_pair *keys, struct curl_slist *headers)
{
    char url[ADDRESS_SIZE + QM_ID_SIZE];
    CURL *handle = request->handle;
    snprintf(url, sizeof url, "%s%s", self->address, request->name);
    curl.easy_setopt(handle, CURLOPT_URL, url);
    curl.easy_setopt(handle, CURLOPT_NOSIGNAL, 1L);
    curl.easy_setopt(handle, CURLOPT_CONNECTTIMEOUT, CONNECT_S);
    curl.easy_setopt(handle, CURLOPT_LOW_SPEED_LIMIT, 1L);
    curl.easy_setopt(handle, CURLOPT_LOW_SPEED_TIME, SILENCE_S);
    curl.easy_setopt(handle, CURLOPT_AWS_SIGV4, self->signature);
    curl.easy_setopt(handle, CURLOPT_USERNAME, keys->id);
    curl.easy_setopt(handle, CURLOPT_PASSWORD, keys->secret);
    curl.easy_setopt(handle, CURLOPT_HTTPHEADER, headers);
    curl.easy_setopt(handle, CURLOPT_WRITEFUNCTION, take_bytes);
    curl.easy_setopt(handle, CURLOPT_WRITEDATA, request);
    if (strcmp(request->method, "HEAD") == 0) {
        curl.easy_setopt(handle, CURLOPT_NOBODY, 1L);
    } else if (strcmp(request->method, "PUT") == 0) {
        curl.easy_setopt(handle, CURLOPT_UPLOAD, 1L);
        curl.easy_setopt(handle, CURLOPT_EXPECT_100_TIMEOUT_MS, 100L); /* some servers do not answer that */
        curl.easy_setopt(handle, CURLOPT_INFILESIZE_LARGE, (curl_off_t)request->size);
        curl.easy_setopt(handle, CURLOPT_READFUNCTION, send_bytes);
        curl.easy_setopt(handle, CURLOPT_READDATA, request);
        curl.easy_setopt(handle, CURLOPT_SEEKFUNCTION, rewind_bytes);
        curl.easy_setopt(handle, CURLOPT_SEEKDATA, request);
    } else if (strcmp(request->method, "DELETE") == 0) {
        curl.easy_setopt(handle, CURLOPT_CUSTOMREQUEST, "DELETE");
    }
}

/** Empties the file that receives bytes, before they come again. */
static bool is_ready(s3_request *request)
{
    request->sent = 0;
    request->reply_size = 0;
    request->code = 0;
    request->length = -1;
    request->local = QM_STORED;
    memset(request->reply, 0, sizeof request->reply);
    bool receives = strcmp(request->method, "GET") == 0;
    return !receives || qm_place_empty(request->file);
}

/** Sends a request once. */
static CURLcode perform(s3_place *self, s3_request *request, const key_pair *keys)
{
    struct curl_slist *headers = make_headers(request, keys);
    request->handle = headers ? take_handle(self) : NULL;
    CURLcode result = CURLE_OUT_OF_MEMORY;
    if (request->handle && is_ready(request)) {
        curl_off_t length = -1;
        set_up(self, request, keys, headers);
        result = curl.easy_perform(request->handle);
        curl.easy_getinfo(request->handle, CURLINFO_RESPONSE_CODE, &request->code);
        curl.easy_getinfo(request->handle, CURLINFO_CONTENT_LENGTH_DOWNLOAD_T, &length);
        request->length = (int64_t)length;
    }
    if (request->handle) give_back(self, request->handle);
    curl.slist_free_all(headers);
    return result;
}

/** What a reply means. */
static qm_stored status_of(s3_place *self, s3_request *request, CURLcode result)
{
    char code[64];
    if (request->local != QM_STORED) return request->local;
    if (result != CURLE_OK)
        return qm_place_fail(&self->base, "the bucket does not answer: %s", curl.easy_strerror(result));
    find_code(request, code);
    if (request->code == 200 || request->code == 204) return QM_STORED;
    bool is_missing =
        strcmp(code, "NoSuchKey") == 0 || (strcmp(request->method, "HEAD") == 0 && request->code == 404);
    if (is_missing) return QM_STORED_NONE;
    qm_place_fail(&self->base, "the bucket refuses %s: %s", request->method, code);
    return request->code == 507 ? QM_STORED_NO_ROOM : QM_STORED_AWAY;
}

static bool is_worth_repeating(const s3_request *request, CURLcode result)
{
    if (result == CURLE_OUT_OF_MEMORY || request->local != QM_STORED) return false;
    return result != CURLE_OK || request->code == 429 || (request->code >= 500 && request->code != 507);
}

/** Sends a request, and again after a fault that may pass. */
static qm_stored run(s3_place *self, s3_request *request)
{
    key_pair keys;
    if (!find_keys(self, &keys)) return QM_STORED_AWAY;
    double start_ms = qm_clock_now_ms(), delay_ms = FIRST_DELAY_MS;
    CURLcode result = perform(self, request, &keys);
    while (is_worth_repeating(request, result) && qm_clock_now_ms() + delay_ms < start_ms + REPEATING_MS) {
        usleep((useconds_t)(1e3 * delay_ms));
        delay_ms *= 2.0;
        result = perform(self, request, &keys);
    }
    return status_of(self, request, result);
}

/* ---- objects ---- */

static qm_stored put_object(qm_place *place, const qm_place_object *object)
{
    s3_request request = {.method = "PUT",
                          .name = object->name,
                          .hash = object->hash,
                          .file = object->file,
                          .size = object->size};
    if (object->size > LARGEST) {
        qm_place_fail(place, "a bucket takes 5 GiB at most in one request");
        return QM_STORED_NO_ROOM;
    }
    return run((s3_place *)place, &request);
}

static qm_stored look_for(qm_place *place, const char *name, uint64_t size)
{
    s3_request request = {.method = "HEAD", .name = name, .hash = NO_BYTES, .file = -1};
    qm_stored status = run((s3_place *)place, &request);
    return status == QM_STORED && request.length != (int64_t)size ? QM_STORED_NONE : status;
}

static qm_stored get_object(qm_place *place, const char *name, uint64_t size, int file)
{
    (void)size;
    s3_request request = {.method = "GET", .name = name, .hash = NO_BYTES, .file = file};
    return run((s3_place *)place, &request);
}

static qm_stored remove_object(qm_place *place, const char *name)
{
    s3_request request = {.method = "DELETE", .name = name, .hash = NO_BYTES, .file = -1};
    qm_stored status = run((s3_place *)place, &request);
    return status == QM_STORED_NONE ? QM_STORED : status;
}

static void close_place(qm_place *place)
{
    s3_place *self = (s3_place *)place;
    for (size_t i = 0; i < self->idle_count; i++)
        curl.easy_cleanup(self->idle[i]);
    pthread_mutex_destroy(&self->lock);
    free(self->keys);
    free(self);
}

static const qm_place_kind kind = {.name = "s3",
                                   .put = put_object,
                                   .look = look_for,
                                   .get = get_object,
                                   .remove = remove_object,
                                   .close = close_place};

/* ---- addresses ---- */

/** The parts of s3://BUCKET/PREFIX?endpoint=...&region=... */
typedef struct s3_address {
    char bucket[64], prefix[256], endpoint[256], region[64];
} s3_address;

/** Copies a part that needs no escapes; false for another one. */
static bool copy_part(const char *text, size_t length, const char *others, char *out, size_t size)
{
    if (length >= size) return false;
    for (size_t i = 0; i < length; i++)
        if (!isalnum((unsigned char)text[i]) && !strchr(others, text[i])) return false;
    memcpy(out, text, length);
    out[length] = '\0';
    return true;
}

static bool read_parameters(const char *text, s3_address *out)
{
    while (*text) {
        size_t length = strcspn(text, "&");
        bool is_read = false;
        if (strncmp(text, "endpoint=", 9) == 0)
            is_read = copy_part(text + 9, length - 9, ":/.-_[]", out->endpoint, sizeof out->endpoint);
        if (strncmp(text, "region=", 7) == 0)
            is_read = copy_part(text + 7, length - 7, "-", out->region, sizeof out->region);
        if (!is_read) return false;
        text += length + (text[length] == '&');
    }
    return true;
}

static bool read_address(const char *url, s3_address *out)
{
    const char *bucket = url + strlen("s3://");
    size_t length = strcspn(bucket, "/?");
    if (length == 0 || !copy_part(bucket, length, ".-", out->bucket, sizeof out->bucket)) return false;
    const char *prefix = bucket + length + (bucket[length] == '/');
    size_t prefix_length = strcspn(prefix, "?");
    if (!copy_part(prefix, prefix_length, "/.-_", out->prefix, sizeof out->prefix)) return false;
    while (prefix_length > 0 && out->prefix[prefix_length - 1] == '/')
        out->prefix[--prefix_length] = '\0';
    const char *parameters = strchr(prefix, '?');
    if (parameters && !read_parameters(parameters + 1, out)) return false;
    if (!out->region[0]) snprintf(out->region, sizeof out->region, "us-east-1");
    if (!out->endpoint[0])
        snprintf(out->endpoint, sizeof out->endpoint, "https://s3.%s.amazonaws.com", out->region);
    size_t end = strlen(out->endpoint);
    while (end > 0 && out->endpoint[end - 1] == '/')
        out->endpoint[--end] = '\0';
    return strncmp(out->endpoint, "http://", 7) == 0 || strncmp(out->endpoint, "https://", 8) == 0;
}

qm_stored qm_place_open_s3(const char *url, const char *keys, qm_place **out, char message[QM_MESSAGE_SIZE])
{
    s3_address address = {0};
    *out = NULL;
    if (!read_address(url, &address)) {
        snprintf(message, QM_MESSAGE_SIZE,
                 "blobs: --blobs is not s3://BUCKET/PREFIX?endpoint=https://HOST&region=REGION; each part "
                 "may be left "
                 "out but the bucket, and none has escapes");
        return QM_STORED_FAULT;
    }
    if (!load_curl(message)) return QM_STORED_FAULT;
    s3_place *self = calloc(1, sizeof *self);
    char *copy = strdup(keys ? keys : "");
    if (!self || !copy) {
        free(self);
        free(copy);
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_STORED_NO_MEMORY;
    }
    self->base = (qm_place){&kind, message};
    self->keys = copy;
    pthread_mutex_init(&self->lock, NULL);
    snprintf(self->address, sizeof self->address, "%s/%s/%s%s", address.endpoint, address.bucket,
             address.prefix, address.prefix[0] ? "/" : "");
    snprintf(self->signature, sizeof self->signature, "aws:amz:%s:s3", address.region);
    *out = &self->base;
    return QM_STORED;
}
