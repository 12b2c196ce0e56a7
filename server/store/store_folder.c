/**
 * store_folder.c: the data folder of a store: who holds it, what is in it at a start, and the commands that do
 * away with files without a database.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store_sqlite.h"

#define OPEN_FOLDERS 8

qm_status qm_store_lock_folder(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    snprintf(path, sizeof path, "%s/lock", store->folder);
    store->lock_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_file >= 0 && flock(store->lock_file, LOCK_EX | LOCK_NB) == 0) return QM_OK;
    snprintf(message, QM_MESSAGE_SIZE,
             errno == EWOULDBLOCK ? "another process uses the folder" : "cannot lock: %s", strerror(errno));
    return QM_E_ARGUMENT;
}

/** True when there is no database, or one of no bytes. */
static bool is_fresh(const char *folder)
{
    char path[QM_STORE_PATH_SIZE];
    struct stat facts;
    snprintf(path, sizeof path, "%s/" QM_STORE_DATABASE, folder);
    return stat(path, &facts) != 0 ? errno == ENOENT : facts.st_size == 0;
}

/** Takes the folder over: nothing in it is touched before the lock is held. */
static qm_status take_folder(qm_store *store, qm_store_purpose purpose, char message[QM_MESSAGE_SIZE])
{
    bool makes = purpose != QM_STORE_CHECK && purpose != QM_STORE_COPY;
    if (makes && !qm_blob_make_folders(store->folder, message)) return QM_E_ARGUMENT;
    qm_status status = qm_store_lock_folder(store, message);
    if (status != QM_OK) return status;
    /* SQLite would make an empty database, and remove the log of a lost one. */
    if (is_fresh(store->folder) && (purpose == QM_STORE_CHECK || purpose == QM_STORE_COPY ||
                                    (purpose == QM_STORE_SERVE && qm_blob_has_files(store->folder)))) {
        snprintf(message, QM_MESSAGE_SIZE, "%s",
                 purpose == QM_STORE_SERVE ? QM_STORE_FRESH : "there is no database");
        return QM_E_EMPTY;
    }
    if (purpose == QM_STORE_SERVE) qm_blob_sweep(store->folder);
    status = qm_sqlite_open_database(store, purpose, message);
    if (status == QM_OK && purpose == QM_STORE_SERVE) qm_blob_sweep_orphans(store);
    if (status == QM_OK) qm_sqlite_measure_database(store);
    if (status == QM_OK) qm_space_count(store);
    return status;
}

/** A store whose folder is not yet opened; NULL: out of memory. */
static qm_store *create(const char *folder)
{
    qm_store *store = calloc(1, sizeof *store);
    if (!store) return NULL;
    store->lock_file = -1;
    pthread_mutex_init(&store->space.lock, NULL);
    size_t length = strlen(folder);
    while (length > 1 && folder[length - 1] == '/')
        length--;
    store->folder = strndup(folder, length);
    if (store->folder) return store;
    qm_store_close(store);
    return NULL;
}

qm_store *qm_store_create(const char *folder, char message[QM_MESSAGE_SIZE])
{
    bool fits = strlen(folder) < QM_STORE_FOLDER_SIZE;
    qm_store *store = fits ? create(folder) : NULL;
    if (!store)
        snprintf(message, QM_MESSAGE_SIZE, "%s",
                 fits ? qm_status_text(QM_E_NO_MEMORY) : "the name of the folder is too long");
    return store;
}

qm_status qm_store_open(const char *folder, qm_store_purpose purpose, qm_store **out,
                        char message[QM_MESSAGE_SIZE])
{
    *out = NULL;
    qm_store *store = qm_store_create(folder, message);
    if (!store) return QM_E_NO_MEMORY;
    qm_status status = take_folder(store, purpose, message);
    if (status == QM_OK)
        *out = store;
    else
        qm_store_close(store);
    return status;
}

void qm_store_close(qm_store *store)
{
    if (!store) return;
    if (store->driver) store->driver->close(store);
    if (store->lock_file >= 0) close(store->lock_file);
    pthread_mutex_destroy(&store->space.lock);
    free(store->folder);
    free(store);
}

qm_status qm_store_empty(const char *folder, char message[QM_MESSAGE_SIZE])
{
    qm_store *store = qm_store_create(folder, message);
    if (!store) return QM_E_NO_MEMORY;
    qm_status status = qm_store_lock_folder(store, message);
    if (status == QM_OK && !is_fresh(store->folder)) {
        snprintf(message, QM_MESSAGE_SIZE, "there is a database: nothing was moved");
        status = QM_E_ARGUMENT;
    }
    if (status == QM_OK && !qm_blob_move_all_away(store->folder)) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot move the files: %s", strerror(errno));
        status = QM_E_ARGUMENT;
    }
    qm_store_close(store);
    return status;
}

/* ---- folders that are made as a whole ---- */

/** True when there is nothing of this name, or an empty folder. */
static bool is_free(const char *path)
{
    DIR *folder = opendir(path);
    if (!folder) return errno == ENOENT;
    size_t entries = 0;
    for (struct dirent *entry; (entry = readdir(folder));)
        entries += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    closedir(folder);
    return entries == 0;
}

bool qm_store_plan_folder(const char *folder, const char *ending, char name[QM_STORE_FOLDER_SIZE],
                          char path[QM_STORE_FOLDER_SIZE], char message[QM_MESSAGE_SIZE])
{
    size_t length = strlen(folder);
    while (length > 1 && folder[length - 1] == '/')
        length--;
    if (length + strlen(ending) >= QM_STORE_FOLDER_SIZE) {
        snprintf(message, QM_MESSAGE_SIZE, "the name of the folder is too long");
        return false;
    }
    snprintf(name, QM_STORE_FOLDER_SIZE, "%.*s", (int)length, folder);
    snprintf(path, QM_STORE_FOLDER_SIZE, "%.*s%s", (int)length, folder, ending);
    if (!is_free(name))
        snprintf(message, QM_MESSAGE_SIZE, "%.200s is not empty: this needs a new folder", name);
    else if (access(path, F_OK) == 0)
        snprintf(
            message, QM_MESSAGE_SIZE,
            "%.160s is there, of an attempt that was cut off or still runs: in the first case, remove it",
            path);
    else
        return true;
    return false;
}

bool qm_store_put_in_place(const char *path, const char *name)
{
    char parent[QM_STORE_PATH_SIZE];
    snprintf(parent, sizeof parent, "%s", name);
    char *slash = strrchr(parent, '/');
    if (slash)
        slash[slash == parent] = '\0';
    else
        snprintf(parent, sizeof parent, ".");
    int file = open(path, O_RDONLY | O_CLOEXEC);
    bool synced = file >= 0 && fsync(file) == 0;
    if (file >= 0) close(file);
    return synced && rename(path, name) == 0 && qm_blob_sync_folder(parent);
}

static int remove_entry(const char *path, const struct stat *facts, int type, struct FTW *at)
{
    (void)facts, (void)type, (void)at;
    return remove(path);
}

void qm_store_remove_folder(const char *path)
{
    nftw(path, remove_entry, OPEN_FOLDERS, FTW_DEPTH | FTW_PHYS);
}
