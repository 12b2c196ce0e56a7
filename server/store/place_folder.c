/**
 * place_folder.c: blobs as files of a folder that all nodes see, by NFS for instance. A file is written under another
 * name, synced and renamed, and the folder is synced: a name never stands for half a file.
 *
 * The folder is opened anew for each call, and must have the file with its id: when the file system beneath it goes away,
 * nothing is written to the empty folder that stays.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "place.h"

#define BLOCK ((size_t)1 << 20)
#define NAME_SIZE 128

typedef struct folder_place {
    qm_place base;
    char *path;
} folder_place;

static qm_stored fail(qm_place *place, const char *step)
{
    const folder_place *self = (const folder_place *)place;
    bool is_full = errno == ENOSPC || errno == EDQUOT;
    qm_place_fail(place, "%s in %.100s: %s", step, self->path, strerror(errno));
    return is_full ? QM_STORED_NO_ROOM : QM_STORED_AWAY;
}

/** Opens the folder for work with an object. -1 with *status. */
static int open_folder(qm_place *place, const char *name, qm_stored *status)
{
    const folder_place *self = (const folder_place *)place;
    int folder = open(self->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool is_whole =
        folder >= 0 && (strcmp(name, QM_PLACE_ID) == 0 || faccessat(folder, QM_PLACE_ID, F_OK, 0) == 0);
    *status = is_whole ? QM_STORED : fail(place, "cannot find " QM_PLACE_ID);
    if (is_whole || folder < 0) return folder;
    close(folder);
    return -1;
}

static void print_part(const char *name, char out[NAME_SIZE])
{
    snprintf(out, NAME_SIZE, "%s.part", name);
}

/** Copies a file from its start to another that is empty. */
static bool copy(int from, int to)
{
    char *block = malloc(BLOCK);
    ssize_t got = block ? 1 : -1;
    if (!block) errno = ENOMEM;
    for (uint64_t done = 0; got > 0; done += (uint64_t)got) {
        got = qm_place_read(from, block, BLOCK, done);
        for (ssize_t put = 0, count; got > 0 && put < got; put += count) {
            do
                count = write(to, block + put, (size_t)(got - put));
            while (count < 0 && errno == EINTR);
            if (count <= 0) got = -1;
        }
    }
    free(block);
    return got == 0;
}

static qm_stored put_in(qm_place *place, int folder, const qm_place_object *object)
{
    char part[NAME_SIZE];
    print_part(object->name, part);
    int file = openat(folder, part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file < 0) return fail(place, "cannot make a file");
    bool is_written = copy(object->file, file) && fsync(file) == 0;
    qm_stored status = is_written ? QM_STORED : fail(place, "cannot write a file");
    /* NFS tells some faults when the file is closed. */
    if (close(file) != 0 && status == QM_STORED) status = fail(place, "cannot write a file");
    if (status == QM_STORED && (renameat(folder, part, folder, object->name) != 0 || fsync(folder) != 0))
        status = fail(place, "cannot name a file");
    if (status != QM_STORED) unlinkat(folder, part, 0);
    return status;
}

static qm_stored put_object(qm_place *place, const qm_place_object *object)
{
    qm_stored status;
    int folder = open_folder(place, object->name, &status);
    if (folder < 0) return status;
    status = put_in(place, folder, object);
    close(folder);
    return status;
}

static qm_stored look_for(qm_place *place, const char *name, uint64_t size)
{
    qm_stored status;
    struct stat facts;
    int folder = open_folder(place, name, &status);
    if (folder < 0) return status;
    if (fstatat(folder, name, &facts, 0) != 0)
        status = errno == ENOENT ? QM_STORED_NONE : fail(place, "cannot look for a file");
    else if ((uint64_t)facts.st_size != size)
        status = QM_STORED_NONE;
    close(folder);
    return status;
}

/** Copies an open file of the folder. */
static qm_stored get_from(qm_place *place, int from, int file)
{
    char *block = malloc(BLOCK);
    if (!block) return QM_STORED_NO_MEMORY;
    qm_stored status = QM_STORED;
    for (uint64_t done = 0; status == QM_STORED;) {
        ssize_t got = qm_place_read(from, block, BLOCK, done);
        if (got == 0) break;
        status = got < 0 ? fail(place, "cannot read a file") : qm_place_write(file, block, (size_t)got);
        done += got > 0 ? (uint64_t)got : 0;
    }
    free(block);
    return status;
}

static qm_stored get_object(qm_place *place, const char *name, uint64_t size, int file)
{
    (void)size;
    qm_stored status;
    int folder = open_folder(place, name, &status);
    if (folder < 0) return status;
    int from = openat(folder, name, O_RDONLY | O_CLOEXEC);
    if (from >= 0)
        status = get_from(place, from, file);
    else
        status = errno == ENOENT ? QM_STORED_NONE : fail(place, "cannot open a file");
    if (from >= 0) close(from);
    close(folder);
    return status;
}

static qm_stored remove_object(qm_place *place, const char *name)
{
    char part[NAME_SIZE];
    qm_stored status;
    print_part(name, part);
    int folder = open_folder(place, name, &status);
    if (folder < 0) return status;
    bool is_gone = unlinkat(folder, name, 0) == 0 || errno == ENOENT;
    if (is_gone)
        is_gone = unlinkat(folder, part, 0) == 0 || errno == ENOENT; /* of an upload that was killed */
    if (!is_gone) status = fail(place, "cannot remove a file");
    close(folder);
    return status;
}

static void close_place(qm_place *place)
{
    folder_place *self = (folder_place *)place;
    free(self->path);
    free(self);
}

static const qm_place_kind kind = {.name = "folder",
                                   .put = put_object,
                                   .look = look_for,
                                   .get = get_object,
                                   .remove = remove_object,
                                   .close = close_place};

qm_stored qm_place_open_folder(const char *path, qm_place **out, char message[QM_MESSAGE_SIZE])
{
    folder_place *self = calloc(1, sizeof *self);
    char *copy_of_path = strdup(path);
    *out = NULL;
    if (!self || !copy_of_path) {
        free(self);
        free(copy_of_path);
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_STORED_NO_MEMORY;
    }
    *self = (folder_place){{&kind, message}, copy_of_path};
    *out = &self->base;
    return QM_STORED;
}
