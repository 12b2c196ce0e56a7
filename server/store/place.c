/**
 * place.c: what the kinds of places have in common.
 */
#include "place.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/log.h"

bool qm_place_is_database(const char *where)
{
    return !where || !where[0] || strcmp(where, "database") == 0;
}

qm_stored qm_place_open(const char *where, const char *keys, qm_place **out, char message[QM_MESSAGE_SIZE])
{
    *out = NULL;
    if (strncmp(where, "s3://", 5) == 0) return qm_place_open_s3(where, keys, out, message);
    if (where[0] == '/') return qm_place_open_folder(where, out, message);
    snprintf(message, QM_MESSAGE_SIZE,
             "blobs: --blobs is \"database\", a folder that begins with /, or s3://BUCKET/PREFIX");
    return QM_STORED_FAULT;
}

void qm_place_close(qm_place *place)
{
    if (place) place->kind->close(place);
}

qm_stored qm_place_fail(qm_place *place, const char *format, ...)
{
    char text[QM_MESSAGE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (place->message)
        snprintf(place->message, QM_MESSAGE_SIZE, "blobs: %.240s", text);
    else
        qm_log(QM_LOG_ERROR, "blobs: %s", text);
    return QM_STORED_AWAY;
}

qm_stored qm_place_write(int file, const void *bytes, size_t size)
{
    for (const char *next = bytes; size > 0;) {
        ssize_t put = write(file, next, size);
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) {
            qm_log(QM_LOG_ERROR, "a blob cannot be copied to the data folder: %s", strerror(errno));
            return QM_STORED_FAULT;
        }
        next += put;
        size -= (size_t)put;
    }
    return QM_STORED;
}

bool qm_place_empty(int file)
{
    return ftruncate(file, 0) == 0 && lseek(file, 0, SEEK_SET) == 0;
}

ssize_t qm_place_read(int file, void *bytes, size_t size, uint64_t offset)
{
    size_t done = 0;
    while (done < size) {
        ssize_t got = pread(file, (char *)bytes + done, size - done, (off_t)(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) qm_log(QM_LOG_ERROR, "a blob cannot be read: %s", strerror(errno));
        if (got < 0) return -1;
        if (got == 0) break;
        done += (size_t)got;
    }
    return (ssize_t)done;
}

/** Gives a place an id. */
static qm_stored put_id(qm_place *place, int file, char id[QM_ID_SIZE])
{
    char hash[QM_HASH_SIZE];
    qm_id_make('p', id);
    size_t size = strlen(id);
    qm_id_hash_text(id, size, hash);
    qm_stored status = qm_place_write(file, id, size);
    if (status != QM_STORED) return status;
    return place->kind->put(place, &(qm_place_object){QM_PLACE_ID, file, size, hash, NULL});
}

qm_stored qm_place_identify(qm_place *place, bool creates, char id[QM_ID_SIZE])
{
    int file = memfd_create("place", MFD_CLOEXEC);
    if (file < 0) return QM_STORED_FAULT;
    qm_stored status = place->kind->get(place, QM_PLACE_ID, 0, file);
    ssize_t size = status == QM_STORED ? qm_place_read(file, id, QM_ID_SIZE - 1, 0) : 0;
    id[size > 0 ? size : 0] = '\0';
    if (status == QM_STORED && size <= 0) status = QM_STORED_NONE;
    if (status == QM_STORED_NONE && creates) status = put_id(place, file, id);
    close(file);
    return status;
}
