/**
 * store_sqlite_sums.c: a layer between SQLite and the file of the database that ends each page with its checksum, and
 * compares them whenever a page is read: rows, indices and free pages alike. SQLite leaves room for it at the
 * end of pages (reserved bytes, byte 20 of the header). Pages in the write-ahead log have SQLite's own
 * checksums; they get theirs when they are copied to the file.
 */
#include <stdlib.h>
#include <string.h>

#include "checksum.h"
#include "store_sqlite.h"

#define MIN_PAGE 512 /* whatever is shorter is a part of the header */
#define HEADER_SIZE 100
#define RESERVED_PLACE 20

/** Followed by the file of the layer below. */
typedef struct summed_file {
    sqlite3_file base;
    bool is_plain; /* written by a version without checksums */
} summed_file;

static sqlite3_file *below(sqlite3_file *file)
{
    return (sqlite3_file *)(void *)((summed_file *)(void *)file + 1);
}

static bool is_summed(sqlite3_file *file, int size, sqlite3_int64 offset)
{
    return !((summed_file *)(void *)file)->is_plain && size >= MIN_PAGE && offset % size == 0;
}

static uint64_t sum_page(const uint8_t *page, int size, sqlite3_int64 offset)
{
    return qm_checksum(page, (size_t)size - QM_STORE_SUM_SIZE, (uint64_t)(offset / size));
}

static int read_file(sqlite3_file *file, void *bytes, int size, sqlite3_int64 offset)
{
    int result = below(file)->pMethods->xRead(below(file), bytes, size, offset);
    if (result != SQLITE_OK || !is_summed(file, size, offset)) return result;
    uint64_t sum = sum_page(bytes, size, offset);
    return memcmp((const char *)bytes + size - sizeof sum, &sum, sizeof sum) == 0 ? SQLITE_OK
                                                                                  : SQLITE_IOERR_DATA;
}

static int write_file(sqlite3_file *file, const void *bytes, int size, sqlite3_int64 offset)
{
    const sqlite3_io_methods *methods = below(file)->pMethods;
    if (!is_summed(file, size, offset)) return methods->xWrite(below(file), bytes, size, offset);
    uint64_t sum = sum_page(bytes, size, offset);
    uint8_t *page = sqlite3_malloc(size);
    if (!page) return SQLITE_NOMEM;
    memcpy(page, bytes, (size_t)size - sizeof sum);
    memcpy(page + size - sizeof sum, &sum, sizeof sum);
    int result = methods->xWrite(below(file), page, size, offset);
    sqlite3_free(page);
    return result;
}

static int control(sqlite3_file *file, int code, void *value)
{
    if (code != QM_STORE_ASK_PLAIN) return below(file)->pMethods->xFileControl(below(file), code, value);
    *(bool *)value = ((summed_file *)(void *)file)->is_plain;
    return SQLITE_OK;
}

/* ---- what the layer below does alone ---- */

static int close_file(sqlite3_file *file)
{
    return below(file)->pMethods->xClose(below(file));
}

static int truncate_file(sqlite3_file *file, sqlite3_int64 size)
{
    return below(file)->pMethods->xTruncate(below(file), size);
}

static int sync_file(sqlite3_file *file, int flags)
{
    return below(file)->pMethods->xSync(below(file), flags);
}

static int get_size(sqlite3_file *file, sqlite3_int64 *size)
{
    return below(file)->pMethods->xFileSize(below(file), size);
}

static int lock(sqlite3_file *file, int level)
{
    return below(file)->pMethods->xLock(below(file), level);
}

static int unlock(sqlite3_file *file, int level)
{
    return below(file)->pMethods->xUnlock(below(file), level);
}

static int check_lock(sqlite3_file *file, int *is_held)
{
    return below(file)->pMethods->xCheckReservedLock(below(file), is_held);
}

static int get_sector_size(sqlite3_file *file)
{
    return below(file)->pMethods->xSectorSize(below(file));
}

static int get_traits(sqlite3_file *file)
{
    return below(file)->pMethods->xDeviceCharacteristics(below(file));
}

static int map_shared(sqlite3_file *file, int region, int size, int extends, void volatile **out)
{
    return below(file)->pMethods->xShmMap(below(file), region, size, extends, out);
}

static int lock_shared(sqlite3_file *file, int offset, int count, int flags)
{
    return below(file)->pMethods->xShmLock(below(file), offset, count, flags);
}

static void order_shared(sqlite3_file *file)
{
    below(file)->pMethods->xShmBarrier(below(file));
}

static int unmap_shared(sqlite3_file *file, int deletes)
{
    return below(file)->pMethods->xShmUnmap(below(file), deletes);
}

/* Version 2: without access to mapped pages, which nothing would compare. */
static const sqlite3_io_methods methods = {
    .iVersion = 2,
    .xClose = close_file,
    .xRead = read_file,
    .xWrite = write_file,
    .xTruncate = truncate_file,
    .xSync = sync_file,
    .xFileSize = get_size,
    .xLock = lock,
    .xUnlock = unlock,
    .xCheckReservedLock = check_lock,
    .xFileControl = control,
    .xSectorSize = get_sector_size,
    .xDeviceCharacteristics = get_traits,
    .xShmMap = map_shared,
    .xShmLock = lock_shared,
    .xShmBarrier = order_shared,
    .xShmUnmap = unmap_shared,
};

/* ---- files ---- */

static int open_file(sqlite3_vfs *vfs, sqlite3_filename name, sqlite3_file *file, int flags, int *out_flags)
{
    sqlite3_vfs *parent = vfs->pAppData;
    uint8_t header[HEADER_SIZE];
    if (!(flags & SQLITE_OPEN_MAIN_DB)) return parent->xOpen(parent, name, file, flags, out_flags);
    summed_file *opened = (summed_file *)(void *)file;
    opened->base.pMethods = NULL;
    int result = parent->xOpen(parent, name, below(file), flags, out_flags);
    if (!below(file)->pMethods) return result;
    opened->base.pMethods = &methods;
    /* A header that says so by damage is that of a newer schema, and refused. */
    opened->is_plain = result == SQLITE_OK &&
                       below(file)->pMethods->xRead(below(file), header, HEADER_SIZE, 0) == SQLITE_OK &&
                       header[RESERVED_PLACE] == 0;
    return result;
}

static int delete_file(sqlite3_vfs *vfs, const char *name, int syncs)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xDelete(parent, name, syncs);
}

static int access_file(sqlite3_vfs *vfs, const char *name, int flags, int *out)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xAccess(parent, name, flags, out);
}

static int find_full_path(sqlite3_vfs *vfs, const char *name, int size, char *out)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xFullPathname(parent, name, size, out);
}

static int make_random(sqlite3_vfs *vfs, int size, char *out)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xRandomness(parent, size, out);
}

static int sleep_for(sqlite3_vfs *vfs, int microseconds)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xSleep(parent, microseconds);
}

static int get_time(sqlite3_vfs *vfs, double *now)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xCurrentTime(parent, now);
}

static int get_last_error(sqlite3_vfs *vfs, int size, char *out)
{
    sqlite3_vfs *parent = vfs->pAppData;
    return parent->xGetLastError(parent, size, out);
}

static sqlite3_vfs layer;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void add_layer(void)
{
    sqlite3_vfs *parent = sqlite3_vfs_find(NULL);
    if (!parent) return;
    layer = (sqlite3_vfs){
        .iVersion = 1,
        .szOsFile = (int)sizeof(summed_file) + parent->szOsFile,
        .mxPathname = parent->mxPathname,
        .zName = QM_STORE_SUMS,
        .pAppData = parent,
        .xOpen = open_file,
        .xDelete = delete_file,
        .xAccess = access_file,
        .xFullPathname = find_full_path,
        .xRandomness = make_random,
        .xSleep = sleep_for,
        .xCurrentTime = get_time,
        .xGetLastError = get_last_error,
    };
    sqlite3_vfs_register(&layer, 0);
}

void qm_sqlite_sums_register(void)
{
    pthread_once(&once, add_layer);
}
