/**
 * store_copy.c: copies everything from one store to another.
 */
#include "store_copy.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "result_file.h"
#include "store_driver.h"

#define PAGE 16 /* rows that are read at once */

typedef struct copy {
    qm_store *from, *to;
    FILE *out; /* NULL: it was told before */
    qm_store_copied done;
} copy;

/** Tells of a row that is not copied as it was. */
static void tell(copy *work, const char *noun, const char *id, const char *what)
{
    if (work->out) fprintf(work->out, "%s %s: %s\n", noun, id, what);
    work->done.faults++;
}

static qm_stored stored_of(qm_status status)
{
    switch (status) {
    case QM_OK:
        return QM_STORED;
    case QM_E_TOO_LARGE:
        return QM_STORED_FULL;
    case QM_E_NO_MEMORY:
        return QM_STORED_NO_MEMORY;
    case QM_E_CANCELED:
        return QM_STORED_AWAY;
    default:
        return QM_STORED_FAULT;
    }
}

/* ---- rows of each kind ---- */

/** How the rows of a kind are copied. */
typedef struct row_kind {
    size_t size; /* of a row */
    qm_stored (*list)(qm_store *store, const qm_store_page *page, void *rows, size_t *count);
    int64_t (*find_sequence)(const void *row);
    qm_stored (*find)(qm_store *store, const void *row);        /* QM_STORED: the row is there */
    qm_stored (*copy)(copy *work, const void *row, bool *done); /* *done: the row was copied */
    void (*reset)(void *row);
} row_kind;

static qm_stored copy_row(copy *work, const row_kind *rows, const void *row, size_t *copied)
{
    bool done = false;
    qm_stored stored = rows->find(work->to, row);
    work->done.before += stored == QM_STORED;
    if (stored != QM_STORED_NONE) return stored;
    stored = rows->copy(work, row, &done);
    *copied += stored == QM_STORED && done;
    return stored;
}

static qm_stored copy_kind(copy *work, const row_kind *kind, size_t *copied)
{
    char *rows = malloc(PAGE * kind->size);
    if (!rows) return QM_STORED_NO_MEMORY;
    qm_store_page page = {.limit = PAGE};
    qm_stored stored = QM_STORED;
    for (size_t count = PAGE; stored == QM_STORED && count == PAGE;) {
        stored = kind->list(work->from, &page, rows, &count);
        for (size_t i = 0; i < count; i++) {
            void *row = rows + i * kind->size;
            page.after = kind->find_sequence(row);
            if (stored == QM_STORED) stored = copy_row(work, kind, row, copied);
            kind->reset(row);
        }
    }
    free(rows);
    return stored;
}

/* ---- meshes ---- */

static qm_stored list_meshes(qm_store *store, const qm_store_page *page, void *rows, size_t *count)
{
    return qm_store_list_meshes(store, page, &(qm_store_mesh_filter){0}, rows, count);
}

static int64_t find_mesh_sequence(const void *row)
{
    return ((const qm_store_mesh *)row)->sequence;
}

static qm_stored find_mesh(qm_store *store, const void *row)
{
    qm_store_mesh_state state;
    return qm_store_find_mesh_state(store, ((const qm_store_mesh *)row)->id, &state);
}

/** *is_good: the bytes are in the other store. */
static qm_stored copy_blob(copy *work, const char *mesh, const char *hash, bool *is_good)
{
    qm_status status = hash[0] ? qm_blob_copy(work->from, work->to, hash) : QM_OK;
    *is_good = status == QM_OK;
    if (status != QM_E_EMPTY && status != QM_E_FORMAT) return stored_of(status);
    char what[QM_HASH_SIZE + 64];
    snprintf(what, sizeof what, "file %s is %s", hash, status == QM_E_EMPTY ? "missing" : "damaged");
    tell(work, "mesh", mesh, what);
    return QM_STORED;
}

/** The content of the mesh has another row: uploads of it find that one. */
static qm_stored put_beside(copy *work, const qm_store_mesh *mesh)
{
    char options[QM_ID_SIZE + 16];
    qm_store_mesh other = *mesh;
    snprintf(options, sizeof options, "imported %s", mesh->id);
    other.options = options;
    if (work->out)
        fprintf(work->out, "mesh %s has the content of another one, which uploads will find\n", mesh->id);
    return qm_store_put_mesh(work->to, &other);
}

static qm_stored copy_mesh(copy *work, const void *row, bool *done)
{
    const qm_store_mesh *mesh = row;
    bool has_file, has_positions = true;
    qm_stored stored = copy_blob(work, mesh->id, mesh->hash, &has_file);
    if (stored == QM_STORED && has_file) stored = copy_blob(work, mesh->id, mesh->positions, &has_positions);
    if (stored != QM_STORED || !has_file || !has_positions) return stored;
    *done = true;
    stored = qm_store_put_mesh(work->to, mesh);
    return stored == QM_STORED_TAKEN ? put_beside(work, mesh) : stored;
}

static void reset_mesh(void *row)
{
    qm_store_mesh_reset(row);
}

/* ---- layouts ---- */

static qm_stored list_layouts(qm_store *store, const qm_store_page *page, void *rows, size_t *count)
{
    return qm_store_list_layouts(store, page, NULL, rows, count);
}

static int64_t find_layout_sequence(const void *row)
{
    return ((const qm_store_layout *)row)->sequence;
}

static qm_stored find_layout(qm_store *store, const void *row)
{
    qm_store_layout found;
    qm_stored stored = qm_store_find_layout(store, ((const qm_store_layout *)row)->id, &found);
    if (stored == QM_STORED) qm_store_layout_reset(&found);
    return stored;
}

/** Reads all kept revisions of a layout; *out is on the heap. */
static qm_stored read_revisions(copy *work, const char *id, qm_store_layout **out, size_t *count)
{
    qm_store_page page = {.after = -1, .limit = PAGE};
    qm_stored stored = QM_STORED;
    *out = NULL;
    *count = 0;
    for (size_t read = PAGE; stored == QM_STORED && read == PAGE;) {
        qm_store_layout *larger = realloc(*out, (*count + PAGE) * sizeof **out);
        if (!larger) return QM_STORED_NO_MEMORY;
        *out = larger;
        stored = qm_store_list_layout_revisions(work->from, id, &page, *out + *count, &read);
        *count += read;
        if (read > 0) page.after = (*out)[*count - 1].revision;
    }
    return stored;
}

/** The key of a client that has another row in the other store goes to that one. */
static void tell_key(copy *work, const char *noun, const char *id)
{
    tell(work, noun, id, "its Idempotency-Key has another row: copied without it");
}

static qm_stored copy_layout(copy *work, const void *row, bool *done)
{
    const qm_store_layout *layout = row;
    qm_store_layout *revisions;
    size_t count;
    qm_store_origin origin = {0};
    qm_store_idempotency idempotency = {0};
    qm_stored stored = read_revisions(work, layout->id, &revisions, &count);
    if (stored == QM_STORED) stored = qm_store_find_layout_origin(work->from, layout->id, &origin);
    if (stored == QM_STORED) {
        idempotency.key = origin.key;
        memcpy(idempotency.request, origin.request, sizeof origin.request);
        stored = qm_store_put_layout_copy(work->to, revisions, count, layout->revision, &idempotency);
    }
    if (stored == QM_STORED_TAKEN) {
        tell_key(work, "layout", layout->id);
        idempotency.key = NULL;
        stored = qm_store_put_layout_copy(work->to, revisions, count, layout->revision, &idempotency);
    }
    while (count > 0)
        qm_store_layout_reset(&revisions[--count]);
    free(revisions);
    free(origin.key);
    *done = true;
    return stored;
}

static void reset_layout(void *row)
{
    qm_store_layout_reset(row);
}

/* ---- reconstructions ---- */

static qm_stored list_reconstructions(qm_store *store, const qm_store_page *page, void *rows, size_t *count)
{
    return qm_store_list_reconstructions(store, page, NULL, rows, count);
}

static int64_t find_reconstruction_sequence(const void *row)
{
    return ((const qm_store_reconstruction *)row)->sequence;
}

static qm_stored find_reconstruction(qm_store *store, const void *row)
{
    qm_store_reconstruction found;
    qm_stored stored =
        qm_store_find_reconstruction(store, ((const qm_store_reconstruction *)row)->id, &found);
    if (stored == QM_STORED) qm_store_reconstruction_reset(&found);
    return stored;
}

static qm_stored copy_reconstruction(copy *work, const void *row, bool *done)
{
    const qm_store_reconstruction *r = row;
    qm_store_origin origin = {0};
    qm_store_idempotency idempotency = {0};
    qm_stored stored = qm_store_find_reconstruction_origin(work->from, r->id, &origin);
    if (stored == QM_STORED) {
        idempotency.key = origin.key;
        memcpy(idempotency.request, origin.request, sizeof origin.request);
        stored = qm_store_put_reconstruction(work->to, r, NULL, &idempotency);
    }
    if (stored == QM_STORED_TAKEN) {
        tell_key(work, "reconstruction", r->id);
        idempotency.key = NULL;
        stored = qm_store_put_reconstruction(work->to, r, NULL, &idempotency);
    }
    free(origin.key);
    *done = true;
    return stored;
}

static void reset_reconstruction(void *row)
{
    qm_store_reconstruction_reset(row);
}

/* ---- jobs ---- */

static qm_stored list_jobs(qm_store *store, const qm_store_page *page, void *rows, size_t *count)
{
    return qm_store_list_job_copies(store, page, rows, count);
}

static int64_t find_job_sequence(const void *row)
{
    return ((const qm_store_job_copy *)row)->job.sequence;
}

static qm_stored find_job(qm_store *store, const void *row)
{
    qm_store_job found;
    qm_stored stored = qm_store_find_job(store, ((const qm_store_job_copy *)row)->job.id, &found);
    if (stored == QM_STORED) qm_store_job_reset(&found);
    return stored;
}

/** Events with strings of their own. */
typedef struct event_list {
    qm_store_event *events;
    size_t count, capacity;
} event_list;

static bool take_event(void *user, const qm_store_event *event)
{
    event_list *list = user;
    if (list->count == list->capacity) {
        size_t capacity = list->capacity ? 2 * list->capacity : 64;
        qm_store_event *events = realloc(list->events, capacity * sizeof *events);
        if (!events) return false;
        list->events = events;
        list->capacity = capacity;
    }
    qm_store_event *taken = &list->events[list->count++];
    *taken =
        (qm_store_event){.seq = event->seq, .name = strdup(event->name), .members = strdup(event->members)};
    return taken->name && taken->members;
}

static void reset_events(event_list *list)
{
    for (size_t i = 0; i < list->count; i++) {
        free((char *)list->events[i].name);
        free((char *)list->events[i].members);
    }
    free(list->events);
}

/** Stores a job with its events, and without its key when that has another job. */
static qm_stored put_job(copy *work, const qm_store_job_copy *row, const qm_store_array *array)
{
    event_list list = {0};
    qm_store_job_copy keyless = *row;
    keyless.job.idempotency_key = NULL;
    qm_stored stored = qm_store_read_events(work->from, row->job.id, 0, take_event, &list);
    if (stored == QM_STORED) stored = qm_store_put_job_copy(work->to, row, list.events, list.count, array);
    if (stored == QM_STORED_TAKEN) {
        tell_key(work, "job", row->job.id);
        stored = qm_store_put_job_copy(work->to, &keyless, list.events, list.count, array);
    }
    reset_events(&list);
    return stored;
}

/** One that has not ended writes its array again. */
static qm_stored copy_job(copy *work, const void *row, bool *done)
{
    const qm_store_job_copy *job = row;
    qm_store_job_copy unanswering = *job;
    unanswering.revisions = "";
    qm_store_array array = {0};
    qm_status status =
        job->job.document ? qm_result_file_copy(work->from, work->to, job->job.id, &array) : QM_E_EMPTY;
    qm_stored stored = QM_STORED;
    if (status == QM_E_FORMAT) tell(work, "job", job->job.id, "its array is damaged: copied without it");
    if (status == QM_OK || status == QM_E_EMPTY)
        stored = put_job(work, job, status == QM_OK ? &array : NULL);
    else if (status == QM_E_FORMAT)
        stored = put_job(work, &unanswering, NULL);
    else
        stored = stored_of(status);
    free(array.sums);
    *done = true;
    return stored;
}

static void reset_job(void *row)
{
    qm_store_job_copy_reset(row);
}

/* ---- everything ---- */

static const row_kind meshes = {
    sizeof(qm_store_mesh), list_meshes, find_mesh_sequence, find_mesh, copy_mesh, reset_mesh};
static const row_kind layouts = {
    sizeof(qm_store_layout), list_layouts, find_layout_sequence, find_layout, copy_layout, reset_layout};
static const row_kind reconstructions = {sizeof(qm_store_reconstruction),
                                         list_reconstructions,
                                         find_reconstruction_sequence,
                                         find_reconstruction,
                                         copy_reconstruction,
                                         reset_reconstruction};
static const row_kind jobs = {
    sizeof(qm_store_job_copy), list_jobs, find_job_sequence, find_job, copy_job, reset_job};

/** Copies what is missing; *count is the number of rows that were. */
static qm_stored copy_all(copy *work, size_t *count)
{
    qm_store_copied *done = &work->done;
    qm_stored stored = copy_kind(work, &meshes, &done->meshes);
    if (stored == QM_STORED) stored = copy_kind(work, &layouts, &done->layouts);
    if (stored == QM_STORED) stored = copy_kind(work, &reconstructions, &done->reconstructions);
    if (stored == QM_STORED) stored = copy_kind(work, &jobs, &done->jobs);
    if (stored == QM_STORED) stored = qm_store_sync(work->to);
    *count = done->meshes + done->layouts + done->reconstructions + done->jobs;
    return stored;
}

qm_stored qm_store_copy(qm_store *from, qm_store *to, FILE *out, qm_store_copied *copied)
{
    copy work = {.from = from, .to = to, .out = out};
    size_t count;
    qm_stored stored = copy_all(&work, &count);
    /* A database that was started again meanwhile, or another one in its place, may have lost rows that were copied before
     * they were durable. What a look after that finds is there for good. */
    while (stored == QM_STORED && count > 0 && qm_store_is_shared(to)) {
        copy again = {.from = from, .to = to};
        stored = copy_all(&again, &count);
    }
    *copied = work.done;
    return stored;
}

/* ---- marks ---- */

/* A folder notes the databases that have all of it: to copy it once more would bring back what was deleted there since. */
#define MARKS "imported"

static void make_marks_path(const char *folder, char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/" MARKS, folder);
}

/** True with a message when the folder has the mark of the database. */
static bool is_marked(const char *folder, const char *database, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE], line[QM_STORE_IDENTITY_SIZE + 2];
    make_marks_path(folder, path);
    FILE *file = fopen(path, "re");
    bool found = false;
    while (file && !found && fgets(line, sizeof line, file)) {
        line[strcspn(line, "\n")] = '\0';
        found = strcmp(line, database) == 0;
    }
    if (file) fclose(file);
    if (found)
        snprintf(message, QM_MESSAGE_SIZE,
                 "all of it is in the database, and what was deleted there would come back; without %.150s "
                 "it is copied",
                 path);
    return found;
}

static qm_stored mark(const char *folder, const char *database, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    make_marks_path(folder, path);
    FILE *file = fopen(path, "ae");
    bool written = file && fprintf(file, "%s\n", database) > 0;
    if (file && fclose(file) != 0) written = false;
    if (written) return QM_STORED;
    snprintf(message, QM_MESSAGE_SIZE, "everything is copied, but %.200s cannot be written: %s", path,
             strerror(errno));
    return QM_STORED_FAULT;
}

/** Why a copy was cut off. */
static void explain(qm_stored stored, char message[QM_MESSAGE_SIZE])
{
    const char *why = "it was refused; the log has more";
    if (stored == QM_STORED_AWAY) why = "the database does not answer";
    if (stored == QM_STORED_FULL || stored == QM_STORED_NO_ROOM) why = "there is no room for it";
    if (stored == QM_STORED_DAMAGED) why = "rows of it are damaged";
    if (stored == QM_STORED_NO_MEMORY) why = "there is no memory for it";
    snprintf(message, QM_MESSAGE_SIZE, "the copy was cut off: %s", why);
}

static qm_stored import_once(qm_store *from, qm_store *to, const char *folder, FILE *out,
                             qm_store_copied *copied, char message[QM_MESSAGE_SIZE])
{
    char database[QM_STORE_IDENTITY_SIZE];
    qm_stored stored = to->driver->identify(to, database);
    if (stored == QM_STORED && is_marked(folder, database, message)) return QM_STORED_TAKEN;
    if (stored == QM_STORED) stored = qm_store_copy(from, to, out, copied);
    if (stored != QM_STORED) {
        explain(stored, message);
        return stored;
    }
    /* What was left out may be copied once it is repaired. */
    return copied->faults == 0 ? mark(folder, database, message) : QM_STORED;
}

qm_stored qm_store_import(const char *folder, const char *address, const qm_store_node *self, bool is_unsafe,
                          FILE *out, qm_store_copied *copied, char message[QM_MESSAGE_SIZE])
{
    qm_store *from, *to = NULL;
    char why[QM_MESSAGE_SIZE];
    *copied = (qm_store_copied){0};
    if (qm_store_open(folder, QM_STORE_COPY, &from, why) != QM_OK) {
        snprintf(message, QM_MESSAGE_SIZE, "%.100s: %.150s", folder, why);
        return QM_STORED_FAULT;
    }
    qm_stored stored = qm_store_visit_to_write(address, self, is_unsafe, &to, message);
    if (stored == QM_STORED) stored = import_once(from, to, folder, out, copied, message);
    qm_store_close(to);
    qm_store_close(from);
    return stored;
}

/** All of the file system, which is quicker than each file. */
static bool sync_all(const char *path)
{
    int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool synced = folder >= 0 && syncfs(folder) == 0;
    if (folder >= 0) close(folder);
    return synced;
}

/** Fills a new folder. */
static qm_stored fill(qm_store *from, const char *path, FILE *out, qm_store_copied *copied,
                      char message[QM_MESSAGE_SIZE])
{
    qm_store *to;
    if (qm_store_open(path, QM_STORE_FILL, &to, message) != QM_OK) return QM_STORED_FAULT;
    qm_stored stored = qm_store_copy(from, to, out, copied);
    if (stored != QM_STORED) explain(stored, message);
    qm_store_close(to);
    return stored;
}

qm_stored qm_store_export(const char *address, const qm_store_node *self, const char *folder, FILE *out,
                          qm_store_copied *copied, char message[QM_MESSAGE_SIZE])
{
    qm_store *from;
    char name[QM_STORE_FOLDER_SIZE], path[QM_STORE_FOLDER_SIZE];
    *copied = (qm_store_copied){0};
    if (!qm_store_plan_folder(folder, ".exporting", name, path, message)) return QM_STORED_FAULT;
    qm_stored stored = qm_store_visit_to_read(address, self, NULL, &from, message);
    if (stored != QM_STORED) return stored;
    stored = fill(from, path, out, copied, message);
    if (stored == QM_STORED && (!sync_all(path) || !qm_store_put_in_place(path, name))) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot name %.200s: %s", name, strerror(errno));
        stored = QM_STORED_FAULT;
    }
    if (stored != QM_STORED) qm_store_remove_folder(path);
    qm_store_close(from);
    return stored;
}
