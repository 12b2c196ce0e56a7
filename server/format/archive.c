/**
 * archive.c: archives by libzip.
 */
#include "archive.h"

#include <dlfcn.h>
#include <pthread.h>
#include <string.h>
#include <time.h>
#include <zip.h>

#include "base/library.h"
#include "base/log.h"
#include "codec_builder.h"

#define LIBRARY "libzip.so.4"
#define BLOCK (64u << 10)

/** The functions in use. */
#define ZIP_MAP(XX)                                                                                          \
    XX(zip_close)                                                                                            \
    XX(zip_discard)                                                                                          \
    XX(zip_error_code_zip)                                                                                   \
    XX(zip_error_fini)                                                                                       \
    XX(zip_error_init)                                                                                       \
    XX(zip_error_strerror)                                                                                   \
    XX(zip_fclose)                                                                                           \
    XX(zip_file_add)                                                                                         \
    XX(zip_file_get_error)                                                                                   \
    XX(zip_file_set_mtime)                                                                                   \
    XX(zip_fopen_index)                                                                                      \
    XX(zip_fread)                                                                                            \
    XX(zip_get_error)                                                                                        \
    XX(zip_name_locate)                                                                                      \
    XX(zip_open_from_source)                                                                                 \
    XX(zip_source_buffer)                                                                                    \
    XX(zip_source_buffer_create)                                                                             \
    XX(zip_source_close)                                                                                     \
    XX(zip_source_free)                                                                                      \
    XX(zip_source_keep)                                                                                      \
    XX(zip_source_open)                                                                                      \
    XX(zip_source_read)

static struct {
#define XX(name) __typeof__(name) *name;
    ZIP_MAP(XX)
#undef XX
} lib;
static bool is_loaded;

static void load(void)
{
    void *library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
#define XX(name) &&qm_library_find(library, #name, &lib.name)
    is_loaded = library ZIP_MAP(XX);
#undef XX
    if (!is_loaded)
        qm_log(QM_LOG_WARN, "%s cannot be loaded: %s", LIBRARY,
               library ? "a function is missing" : dlerror());
}

static bool is_available(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, load);
    return is_loaded;
}

/* ---- reading ---- */

struct qm_archive {
    qm_context *ctx;
    zip_t *zip;
    size_t max_size, inflated; /* bytes; max_size 0: no limit */
};

static qm_status fail_open(zip_error_t *error, qm_codec_report *report)
{
    qm_status status = lib.zip_error_code_zip(error) == ZIP_ER_MEMORY
                           ? QM_E_NO_MEMORY
                           : qm_codec_fail(report, QM_E_FORMAT, "the file is not a whole zip archive: %s",
                                           lib.zip_error_strerror(error));
    lib.zip_error_fini(error);
    return status;
}

qm_status qm_archive_open(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size,
                          qm_archive **out, qm_codec_report *report)
{
    *out = NULL;
    if (!is_available())
        return qm_codec_fail(report, QM_E_UNSUPPORTED,
                             "zip archives are read by the library libzip, which is not installed");
    zip_error_t error;
    lib.zip_error_init(&error);
    zip_source_t *source = lib.zip_source_buffer_create(bytes, size, 0, &error);
    zip_t *zip = source ? lib.zip_open_from_source(source, ZIP_RDONLY, &error) : NULL;
    if (!zip) {
        if (source) lib.zip_source_free(source);
        return fail_open(&error, report);
    }
    lib.zip_error_fini(&error);
    *out = qm_context_alloc(ctx, 1, sizeof **out);
    if (!*out) {
        lib.zip_discard(zip);
        return QM_E_NO_MEMORY;
    }
    **out = (qm_archive){.ctx = ctx, .zip = zip, .max_size = max_size};
    return QM_OK;
}

void qm_archive_close(qm_archive *archive)
{
    if (!archive) return;
    lib.zip_discard(archive->zip);
    qm_context_free(archive->ctx, archive, 1, sizeof *archive);
}

bool qm_archive_has(const qm_archive *archive, const char *name)
{
    return lib.zip_name_locate(archive->zip, name, ZIP_FL_NOCASE) >= 0;
}

/** Of an archive, or of a file in it. */
static qm_status fail_read(const char *name, zip_error_t *error, qm_codec_report *report)
{
    int code = lib.zip_error_code_zip(error);
    if (code == ZIP_ER_MEMORY) return QM_E_NO_MEMORY;
    bool is_unknown = code == ZIP_ER_COMPNOTSUPP || code == ZIP_ER_ENCRNOTSUPP || code == ZIP_ER_NOPASSWD;
    return qm_codec_fail(report, is_unknown ? QM_E_UNSUPPORTED : QM_E_FORMAT, "%.100s cannot be unpacked: %s",
                         name, lib.zip_error_strerror(error));
}

qm_status qm_archive_read(qm_archive *archive, const char *name, qm_archive_take_fn *take, void *user,
                          qm_codec_report *report)
{
    zip_int64_t index = lib.zip_name_locate(archive->zip, name, ZIP_FL_NOCASE);
    if (index < 0) return qm_codec_fail(report, QM_E_FORMAT, "the archive has no file %.100s", name);
    zip_file_t *file = lib.zip_fopen_index(archive->zip, (zip_uint64_t)index, 0);
    if (!file) return fail_read(name, lib.zip_get_error(archive->zip), report);
    char *block = qm_context_alloc(archive->ctx, BLOCK, 1);
    qm_status status = block ? QM_OK : QM_E_NO_MEMORY;
    for (bool is_last = false; status == QM_OK && !is_last;) {
        if (qm_context_canceled(archive->ctx)) {
            status = QM_E_CANCELED;
            break;
        }
        zip_int64_t got = lib.zip_fread(file, block, BLOCK);
        if (got < 0) {
            status = fail_read(name, lib.zip_file_get_error(file), report);
            break;
        }
        archive->inflated += (size_t)got;
        if (archive->max_size > 0 && archive->inflated > archive->max_size) {
            status = qm_codec_fail(report, QM_E_TOO_LARGE, "the archive inflates to more than %zu bytes",
                                   archive->max_size);
            break;
        }
        is_last = got == 0;
        status = take(user, block, (size_t)got, is_last);
    }
    qm_context_free(archive->ctx, block, BLOCK, 1);
    lib.zip_fclose(file);
    return status;
}

/* ---- writing ---- */

/** Adds the files, with one date, so that equal meshes give equal archives. */
static bool add_files(zip_t *zip, const qm_archive_file *files, size_t count)
{
    struct tm day = {.tm_year = 80, .tm_mday = 1, .tm_isdst = -1}; /* the first that an archive can have */
    for (size_t i = 0; i < count; i++) {
        zip_source_t *source = lib.zip_source_buffer(zip, files[i].bytes, files[i].size, 0);
        zip_int64_t index = source ? lib.zip_file_add(zip, files[i].name, source, ZIP_FL_ENC_UTF_8) : -1;
        if (source && index < 0) lib.zip_source_free(source);
        if (index < 0 || lib.zip_file_set_mtime(zip, (zip_uint64_t)index, mktime(&day), 0) != 0) return false;
    }
    return true;
}

static bool read_archive(zip_source_t *buffer, qm_text *out)
{
    char block[4096];
    zip_int64_t got;
    if (lib.zip_source_open(buffer) != 0) return false;
    while ((got = lib.zip_source_read(buffer, block, sizeof block)) > 0)
        qm_text_add(out, block, (size_t)got);
    lib.zip_source_close(buffer);
    return got == 0 && !out->failed;
}

qm_status qm_archive_write(const qm_archive_file *files, size_t count, qm_text *out)
{
    if (!is_available()) return QM_E_UNSUPPORTED;
    zip_error_t error;
    lib.zip_error_init(&error);
    zip_source_t *buffer = lib.zip_source_buffer_create(NULL, 0, 0, &error);
    if (buffer) lib.zip_source_keep(buffer); /* beyond the end of the archive */
    zip_t *zip = buffer ? lib.zip_open_from_source(buffer, ZIP_CREATE | ZIP_TRUNCATE, &error) : NULL;
    lib.zip_error_fini(&error);
    if (buffer && !zip) lib.zip_source_free(buffer);
    bool is_closed = zip && add_files(zip, files, count) && lib.zip_close(zip) == 0;
    if (zip && !is_closed) lib.zip_discard(zip);
    bool is_written = is_closed && read_archive(buffer, out);
    if (buffer) lib.zip_source_free(buffer);
    return is_written ? QM_OK : QM_E_NO_MEMORY;
}
