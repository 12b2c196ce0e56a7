/**
 * store.h: persistent state behind one interface: blobs, meshes, jobs, layouts, reconstructions. The store
 * keeps documents (JSON text made elsewhere) and the columns that it searches; it knows no geometry and no
 * JSON.
 *
 * There are two kinds of store. An embedded one is a folder that one process holds: SQLite and files. A shared one
 * is a PostgreSQL database that any number of processes use, the nodes of a cluster; the folder of each is a cache.
 *
 * Each verb on rows is one atomic step that decides races itself. It may be called again with the same
 * arguments, and then tells what the first call has done. An id is made by the caller.
 *
 * Find verbs return QM_STORED, and the row is the caller's to reset; QM_STORED_NONE when there is none. List verbs
 * write the rows of a page, in order, and their count, which is 0 after a fault; a filter's NULL members let every
 * row pass. A page has all rows that were acknowledged before it was asked for; of a shared store, rows that are
 * added meanwhile may get a smaller sequence number than some of the page. Delete verbs return QM_STORED_NONE when
 * there was none.
 *
 * Durability: a verb that returned QM_STORED survives a kill -9 and a power cut of this machine, and of a shared
 * store as far as the database promises. Events of jobs that run are the exception: of a shared store the last
 * ones may be lost with the database. Threads: every call may come from any thread; the store takes locks of its own.
 */
#ifndef QM_STORE_H
#define QM_STORE_H

#include <stdio.h>

#include "base/clock.h"
#include "base/id.h"
#include "base/notes.h"
#include "base/text.h"
#include "qm/context.h"

/** How a verb on rows ended. */
typedef enum qm_stored {
    QM_STORED,           /* done, by this call or an equal one before */
    QM_STORED_NONE,      /* there is no such row */
    QM_STORED_LATE,      /* the row is no longer as the caller expects: to be read again */
    QM_STORED_TAKEN,     /* the Idempotency-Key, or the content, has another row */
    QM_STORED_LOST,      /* another node has the job, or it was given up: nothing of it may be told */
    QM_STORED_FULL,      /* a limit of bytes or of jobs that wait */
    QM_STORED_NO_ROOM,   /* the disk of a shared store, or of the place of its blobs, is full */
    QM_STORED_DAMAGED,   /* the row, or what it is found by, is damaged */
    QM_STORED_NO_MEMORY, /* of this process */
    QM_STORED_AWAY,      /* the database cannot be reached, or did not answer: it may have done it or not */
    QM_STORED_FAULT      /* any other; logged */
} qm_stored;

typedef struct qm_store qm_store;

/** What a data folder is opened for. */
typedef enum qm_store_purpose {
    QM_STORE_SERVE, /* removes half-written files, and files without a row that are older than a day */
    QM_STORE_ADOPT, /* leaves files without a row, and makes a database when there is none */
    QM_STORE_CHECK, /* leaves everything; refused when there is no database of this version */
    QM_STORE_COPY,  /* leaves files without a row; refused when there is no database */
    QM_STORE_FILL /* a new folder: what is written is on disk when the caller has synced the folder after its close */
} qm_store_purpose;

/**
 * Opens the data folder, and creates it if needed. One process at a time holds a folder. Returns QM_OK, or a
 * status with a message (which may name the folder: for the log only). To serve a folder that has files of
 * meshes or results but no database is refused with QM_E_EMPTY: every one of them would be without a row.
 */
qm_status qm_store_open(const char *folder, qm_store_purpose purpose, qm_store **out,
                        char message[QM_MESSAGE_SIZE]);
void qm_store_close(qm_store *store);

/** A process that joins a shared store. */
#define QM_NODE_NAME_SIZE 64
typedef struct qm_store_node {
    char name
        [QM_NODE_NAME_SIZE]; /* of the machine or place; a second start of a name ends the first one's claims */
    const char *version;
    int workers;
    uint64_t memory; /* bytes of its budget */
    /* Where the blobs are, as place.h has it, and the file with its keys; NULL: in the database. They live until the
     * store is open. */
    const char *blobs, *blobs_keys;
} qm_store_node;

/** How far a shared store keeps what it has acknowledged. */
typedef enum qm_store_durability {
    QM_STORE_UNSAFE,      /* the database does not wait for its disk */
    QM_STORE_ONE_MACHINE, /* it is on the disk of the database's machine */
    QM_STORE_REPLICATED   /* and on another machine */
} qm_store_durability;

/**
 * Opens a shared store at a postgres:// address, with a folder of this process as its cache, and joins its nodes.
 * Makes the tables when the database has none. QM_STORED, or with a message: QM_STORED_AWAY (no library, no
 * database), QM_STORED_FULL (not as durable as asked: is_unsafe allows all), QM_STORED_FAULT (other tables). Tables of the
 * version before are brought up to date while no other node lives.
 */
qm_stored qm_store_open_shared(const char *address, const char *folder, const qm_store_node *self,
                               bool is_unsafe, qm_store **out, char message[QM_MESSAGE_SIZE]);
bool qm_store_is_shared(const qm_store *store);

/** What another node has just done with a job. */
typedef enum qm_store_news {
    QM_STORE_NEWS_QUEUED,   /* the job waits for this node */
    QM_STORE_NEWS_CANCELED, /* somebody asks for its end */
    QM_STORE_NEWS_EVENTS    /* it has new events, or has ended */
} qm_store_news;

/**
 * Has a function called, by a thread of the store, for news of the other nodes of a shared store: of all jobs, as the
 * database does not know who wants which. They only save time: any may be lost, and none comes through a proxy that gives
 * each transaction another session. The id is that of the job; "" for QUEUED.
 */
typedef void qm_store_news_fn(void *user, qm_store_news news, const char *id);
void qm_store_watch(qm_store *store, qm_store_news_fn *tell, void *user);
/** No call is under way or comes after it. */
void qm_store_unwatch(qm_store *store);

/** Brings the tables of a shared store up to date, while daemons of the version before use them; makes them when there
 * are none. The status has a message unless it is QM_STORED. */
qm_stored qm_store_migrate(const char *address, const qm_store_node *self, char message[QM_MESSAGE_SIZE]);

/** What a check has found. */
typedef struct qm_store_findings {
    size_t meshes, jobs, files; /* that were looked at */
    size_t faults, repaired;    /* an array stays a fault until its job is gone */
    size_t orphans;             /* files of meshes that no row names: kept for a day, and no fault */
} qm_store_findings;

/**
 * Compares everything in a folder that no process holds with its hashes and checksums, a line on out for each
 * fault; repairs what can be if asked. The status says whether the folder could be opened.
 */
qm_status qm_store_check(const char *folder, bool repairs, FILE *out, qm_store_findings *found,
                         char message[QM_MESSAGE_SIZE]);

/**
 * Writes all of a folder to one file, while the daemon that holds the folder goes on: everything that was
 * acknowledged before the call, but for deletions since. What is damaged is left out, with a line on out and
 * a fault. QM_E_ARGUMENT with a message: there is no backup.
 */
qm_status qm_store_backup(const char *folder, const char *file, FILE *out, qm_store_findings *found,
                          char message[QM_MESSAGE_SIZE]);

/** Makes a folder of such a file, of this or an earlier version: all of it, or none. The folder must be missing or
 * empty. */
qm_status qm_store_restore(const char *file, const char *folder, FILE *out, qm_store_findings *found,
                           char message[QM_MESSAGE_SIZE]);

/** Moves the files of meshes and results of a folder without a database to a folder beside them, lost/. */
qm_status qm_store_empty(const char *folder, char message[QM_MESSAGE_SIZE]);

/** The files of a data folder, by their kind. */
typedef enum qm_store_files {
    QM_STORE_BLOBS,
    QM_STORE_RESULTS,
    QM_STORE_UPLOADS, /* on their way */
    QM_STORE_FILES_COUNT
} qm_store_files;

/** Bytes in use; space.h says what counts. */
typedef struct qm_store_usage {
    uint64_t files[QM_STORE_FILES_COUNT], database;
    uint64_t total, quota; /* quota 0: none */
} qm_store_usage;

/**
 * Sets how many bytes the files and the database may have. Calls that write files, or rows that begin something,
 * return QM_E_TOO_LARGE or QM_STORED_FULL when there is no room; what was begun may end, and its rows go beyond the quota. To be
 * called before there are other threads.
 */
void qm_store_set_quota(qm_store *store, uint64_t quota);
void qm_store_measure(qm_store *store, qm_store_usage *out);

/** Up to limit rows after the one with a sequence number; 0: from the first, which is the newest one if asked. */
typedef struct qm_store_page {
    int64_t after;
    bool newest_first;
    size_t limit;
} qm_store_page;

/** A blob that is being written: bytes go to a file of their own while the hash is computed. */
typedef struct qm_blob_writer qm_blob_writer;
/** expected: bytes that will be written, if known; room for them is reserved. */
qm_status qm_blob_begin(qm_store *store, uint64_t expected, qm_blob_writer **out);
qm_status qm_blob_write(qm_blob_writer *writer, const void *bytes, size_t size);
/** Ends the writing; returns the hash. */
qm_status qm_blob_seal(qm_blob_writer *writer, char hash[QM_HASH_SIZE]);
/** Maps the bytes of a sealed blob for reading; release with qm_blob_unmap. */
qm_status qm_blob_map_sealed(const qm_blob_writer *writer, const uint8_t **bytes, size_t *size);
/** Gives a sealed blob the name of its hash: it is on disk afterwards, or in the database that is shared. Frees the
 * writer, also after an error. */
qm_stored qm_blob_keep(qm_blob_writer *writer);
/** The same in place of a blob that qm_blob_check has found damaged or missing. */
qm_stored qm_blob_repair(qm_blob_writer *writer);
/** Bytes written so far, and reading them back from an offset: all of size, or not QM_OK. */
uint64_t qm_blob_size(const qm_blob_writer *writer);
qm_status qm_blob_read(const qm_blob_writer *writer, uint64_t offset, void *bytes, size_t size);
/** Drops a blob that is not kept. NULL is fine. */
void qm_blob_abort(qm_blob_writer *writer);
/**
 * Maps a blob for reading, after its bytes were compared with its hash; release with qm_blob_unmap. QM_E_EMPTY
 * when there is none of this hash; QM_E_FORMAT when it is damaged: its bytes are others, or the disk does not
 * give them; QM_E_NO_MEMORY or QM_E_ARGUMENT after a fault.
 */
qm_status qm_blob_map(qm_store *store, const char *hash, const uint8_t **bytes, size_t *size);
/** The status that qm_blob_map would return; of a shared store, at a node that has no copy of the blob. */
qm_status qm_blob_check(qm_store *store, const char *hash);
void qm_blob_unmap(const uint8_t *bytes, size_t size);
/**
 * Calls a function for each blob that no mesh refers to. From now on they are younger than a day. False when a
 * folder cannot be read.
 */
bool qm_blob_each_orphan(qm_store *store, void (*take)(void *user, const char *hash), void *user);
/** Moves a blob to the folder lost/. */
bool qm_blob_move_away(qm_store *store, const char *hash);
/** Removes blobs of a shared store from the folder, those used least recently first, until they have `limit` bytes. */
void qm_blob_trim_cache(qm_store *store, uint64_t limit);
/** Removes a blob of an embedded store unless a mesh refers to it. The caller ensures that no thread puts such a mesh.
 * A shared store removes blobs later (qm_store_clean_blobs). */
void qm_blob_remove(qm_store *store, const char *hash);

/** A row of meshes. Strings of found rows are the caller's, for qm_store_mesh_reset. */
typedef struct qm_store_mesh {
    char id[QM_ID_SIZE];
    char hash[QM_HASH_SIZE]; /* of the blob */
    char *options;           /* name and format: uploads of one hash and one options string are one mesh */
    char *name;
    char *document;               /* the mesh resource */
    char *created;                /* RFC 3339 */
    int format;                   /* qm_format */
    uint64_t revision;            /* deformations so far */
    char positions[QM_HASH_SIZE]; /* of the blob with the vertices of this revision: rows of three doubles
                                     as this machine writes them; "" for those of the file */
    char expires[QM_TIME_SIZE];   /* RFC 3339; "": never */
    qm_notes notes;
    char *labels;     /* each after a line feed and before the next one; or NULL as "" */
    int64_t sequence; /* order of creation; given by the store */
} qm_store_mesh;

/**
 * Stores a new mesh. QM_STORED_TAKEN when there is one of this content and these options; QM_STORED_LATE when its
 * blob has been removed meanwhile.
 */
qm_stored qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_store_find_mesh(qm_store *store, const char *id, qm_store_mesh *out);
/** What of a mesh changes the answers to questions about it: hash, positions and format say what it is made of. */
typedef struct qm_store_mesh_state {
    bool is_found;
    char hash[QM_HASH_SIZE], positions[QM_HASH_SIZE];
    int format;
    uint64_t revision;
    qm_notes notes;
} qm_store_mesh_state;
qm_stored qm_store_find_mesh_state(qm_store *store, const char *id, qm_store_mesh_state *out);
/** Finds the states of several meshes in one step; QM_STORED also when some are not found. */
qm_stored qm_store_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                    qm_store_mesh_state *out);
/** Finds for each hash the newest mesh with this content that was not deformed, in one step: its id, or "" for none. */
qm_stored qm_store_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                   char (*ids)[QM_ID_SIZE]);
qm_stored qm_store_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                        qm_store_mesh *out);
typedef struct qm_store_mesh_filter {
    const char *name, *hash, *label;
} qm_store_mesh_filter;
qm_stored qm_store_list_meshes(qm_store *store, const qm_store_page *page, const qm_store_mesh_filter *filter,
                               qm_store_mesh *out, size_t *count);
/**
 * Replaces a mesh by its next revision: revision, positions, options, document. Removes the blob of the
 * positions before. QM_STORED_LATE when the mesh is no longer at the revision before, QM_STORED_NONE when it is gone.
 */
qm_stored qm_store_revise_mesh(qm_store *store, const qm_store_mesh *mesh);
/** Sets notes, labels and options of a mesh to those of a row. QM_STORED_NONE when there is no such mesh. */
qm_stored qm_store_set_notes(qm_store *store, const qm_store_mesh *mesh);
/** Sets when a mesh expires. QM_STORED_NONE when there is no such mesh. */
qm_stored qm_store_set_expiry(qm_store *store, const char *id, const char *expires);
/** Finds a mesh that expired before a time, and that no unfinished job, layout or reconstruction needs. */
qm_stored qm_store_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out);
/** Removes the row, and its blobs unless another row has them. */
qm_stored qm_store_delete_mesh(qm_store *store, const char *id);
void qm_store_mesh_reset(qm_store_mesh *mesh);

typedef enum qm_job_state {
    QM_JOB_QUEUED,
    QM_JOB_RUNNING,
    QM_JOB_SUCCEEDED,
    QM_JOB_FAILED,
    QM_JOB_CANCELED
} qm_job_state;

/** A row of jobs. */
typedef struct qm_store_job {
    char id[QM_ID_SIZE];
    char *key; /* hash of the canonical request: jobs of one key have one result on the same revisions */
    char *idempotency_key; /* of the client, or NULL */
    char *body;            /* the JSON of the request, to run it again after a restart */
    const char
        *type; /* of a row that is submitted: its kind, and the ids that its request names; NULL else */
    const char *subjects; /* separated by blanks; one may come twice */
    char *created;        /* time of submission, RFC 3339 */
    char *document;       /* members of the job resource as of its end but for its result; NULL before */
    char *result;         /* the result object; NULL when the job has none */
    char *progress; /* of one that another node runs: members of its newest event of progress, or NULL */
    char *labels;   /* as those of a mesh; they may change at any time */
    qm_job_state state;
    int64_t sequence; /* order of creation; given by the store */
    int64_t restarts; /* number of times that it was claimed, and began again */
    int64_t deaths;   /* how many processes have died while it ran, since one has ended in order */
    double
        waited_s; /* of a job that a node claims: from its submission to its first claim; 0 in later ones */
    bool
        is_canceled; /* its end was asked for, and it has not ended yet; of a job that is taken over or copied */
} qm_store_job;

/** Deaths after which a job is not begun again. The last run before is one that the job began alone. */
#define QM_STORE_MAX_DEATHS 3

/** An event of a job. */
#define QM_EVENT_NAME_SIZE 24
typedef struct qm_store_event {
    const char *job; /* its id */
    uint64_t seq;
    const char *name;    /* shorter than QM_EVENT_NAME_SIZE */
    const char *members; /* of its JSON object besides name and seq */
} qm_store_event;

/** How a job enters the store. */
typedef struct qm_store_submission {
    const qm_store_job *job;
    /* Of a shared store: */
    const char *home; /* the name of the node that is to run it */
    size_t limit;     /* of jobs that wait; the queue of an embedded store is in memory */
    bool is_claimed;  /* this node runs it at once */
    bool is_kept;     /* it runs to its end whichever client leaves */
} qm_store_submission;

/**
 * A job is submitted once and finished once, also one that is canceled or fails. In between one process has it, which
 * appends its events from time to time. QM_STORED_TAKEN when its idempotency key has another job; QM_STORED_FULL.
 */
qm_stored qm_store_submit_job(qm_store *store, const qm_store_submission *submission);
/** A run of a job by this process, and what a shared store says of it. */
typedef struct qm_store_run {
    const char *job;
    int64_t restarts;
    const char *progress; /* members of its newest event of progress, or NULL */
    bool is_lost;         /* the job is no longer this node's */
    bool is_canceled;     /* a client of another node has asked for its end */
    bool is_watched;      /* clients of other nodes read its events */
} qm_store_run;

/**
 * Appends events of several runs, of all or of none; an event names its job, which is one of the runs. An event
 * replaces the one of the same job and seq, so that events which may have been stored are appended again. A job
 * that has ended, does not exist, or is lost, stays as it is. A failure of a server may take away what was appended last,
 * until a later beat of a shared store has told that it is durable, or the end of the job: this appends them again.
 */
qm_stored qm_store_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                 const qm_store_event *events, size_t count);
typedef struct qm_store_reconstruction qm_store_reconstruction;

/** What the end of a job changes besides the job: the next revision of a reconstruction with its mesh, or a mesh alone. */
typedef struct qm_store_effect {
    const qm_store_reconstruction *next; /* NULL: none */
    const qm_store_mesh *mesh;           /* when it is new; NULL when it is stored already */
} qm_store_effect;

/**
 * Ends a job: writes state, document and result of the row with end's id, the revisions of its meshes as
 * text, and appends its last events; with its effect, or without one for NULL. All of it is stored, or nothing.
 * QM_STORED_LATE: the reconstruction is deleted, or no longer at the revision before; or the content of the mesh has
 * another row. QM_STORED_LOST: the job is not
 * at the restart that end names, has ended in another way, or belongs to another node.
 */
qm_stored qm_store_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                              const qm_store_event *events, size_t count, const qm_store_effect *effect);
/** Called for each event; its strings live until it returns. False ends the reading (QM_STORED_NO_MEMORY). */
typedef bool qm_store_event_fn(void *user, const qm_store_event *event);
/** Reads the events of a job after a number in the order of seq; none of a job that does not exist. The callback may
 * run under a lock of the store. */
qm_stored qm_store_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                               void *user);
qm_stored qm_store_find_job(qm_store *store, const char *id, qm_store_job *out);
/** Finds the newest job of a key that ran on these revisions and is in this state. */
qm_stored qm_store_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                   qm_job_state state, qm_store_job *out);
/** Lets a job answer no later request: its result is damaged. */
qm_stored qm_store_forget_answer(qm_store *store, const char *id);
qm_stored qm_store_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out);
typedef struct qm_store_job_filter {
    const char *type, *subject; /* a kind; the id of a mesh or reconstruction that the request names */
    const qm_job_state *state;  /* of an embedded store all that have not ended are QM_JOB_QUEUED */
    const char *label;
} qm_store_job_filter;
qm_stored qm_store_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                             qm_store_job *out, size_t *count);
/** Sets the labels of a job. QM_STORED_NONE when there is no such job. */
qm_stored qm_store_set_job_labels(qm_store *store, const char *id, const char *labels);
/** Which jobs a process asks for. */
typedef struct qm_store_wish {
    size_t free;  /* workers: jobs whose home is this node, or that have none, and those that have waited */
    size_t extra; /* jobs beside those, all of which have waited for spill_s at other nodes */
    double spill_s;
} qm_store_wish;

/**
 * Gives unfinished jobs to this process: writes up to free + extra rows and their count. Of an embedded store these
 * are the jobs of an earlier process, each once. restarts counts the claims before this one of a job.
 */
qm_stored qm_store_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count);
/**
 * Counts a run of a claimed job, before it begins, as a death if the process does not end in order. A shared store
 * counts the death of a node for all jobs that it has; those that have one run left it counts here alone, so that no
 * job is given up for a death before its last run.
 */
qm_stored qm_store_begin_job(qm_store *store, const char *id);
/** Takes note that the end of a job that this process runs was asked for: whoever has it after a death ends it. */
qm_stored qm_store_note_cancel(qm_store *store, const char *id);
/** Ends in order: the unfinished jobs of this process have not ended it, and may be claimed at once. */
qm_stored qm_store_leave_jobs(qm_store *store);
/**
 * Removes up to limit jobs that have ended, the oldest first: jobs that were submitted kept_s seconds ago (0:
 * none), and jobs with at least `kept` newer ones. Writes their ids and their number.
 */
qm_stored qm_store_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                 char (*ids)[QM_ID_SIZE], size_t *count);
qm_stored qm_store_delete_job(qm_store *store, const char *id);
void qm_store_job_reset(qm_store_job *job);

/** Takes the first subject off the rest of a list of them; false at its end. */
bool qm_store_next_subject(const char **rest, char out[QM_ID_SIZE]);

/* ---- the nodes of a shared store ---- */

/** The cluster as the last beat has seen it. */
typedef struct qm_store_cluster {
    char node[QM_NODE_NAME_SIZE +
              16];          /* the id of this start of the process: its name, a dot, a random part */
    size_t nodes;           /* that live, with this one */
    size_t queued, running; /* jobs */
    qm_store_durability durability;
    char engine[64]; /* name and version of the database */
} qm_store_cluster;

/** Receives, for a job that this process runs, how many of its events no failure takes away any more, and the number of the
 * last of them. */
typedef void qm_store_durable_fn(void *user, const char *job, size_t count, uint64_t last);

/**
 * Tells that this process lives, durably. What it has appended before and the store still has is durable with it: take is
 * called for each job; NULL: for none. QM_STORED_LOST: it was declared dead, and its jobs are given away.
 */
qm_stored qm_store_beat(qm_store *store, size_t free_workers, qm_store_cluster *out,
                        qm_store_durable_fn *take, void *user);
/** Joins again, with a new id, after QM_STORED_LOST. */
qm_stored qm_store_join(qm_store *store);
/** Declares nodes dead that have been silent, and queues their jobs again; *count is the number of these. */
qm_stored qm_store_reap(qm_store *store, double silence_s, size_t *count);
/** The name of the node, of those that live, that is to run jobs on something with this id: by rendezvous hashing, the
 * one of the two first that has fewer waiting. */
qm_stored qm_store_find_home(qm_store *store, const char *id, char out[QM_NODE_NAME_SIZE]);

/**
 * Ends a job that waits (QM_STORED), with a document and a last event, or asks the node that runs it to (QM_STORED_LATE).
 * QM_STORED_NONE: it has ended.
 */
qm_stored qm_store_cancel_job(qm_store *store, const char *id, const char *document,
                              const qm_store_event *last);
/** Counts clients that own a job; *is_unwanted when the last one has left, and nobody keeps it. */
qm_stored qm_store_hold_job(qm_store *store, const char *id, int owners, bool is_kept, bool *is_unwanted);

/** A job that another node has, as it is after an event. */
typedef struct qm_store_look {
    const char *job;
    uint64_t after; /* number of an event */
    /* Written: */
    qm_job_state state; /* above QM_JOB_RUNNING: it has ended, and its row has the document */
    bool is_gone;
} qm_store_look;

/** Looks at several jobs at once, and tells their nodes that somebody reads them. */
qm_stored qm_store_look_at_jobs(qm_store *store, qm_store_look *looks, size_t count, qm_store_event_fn *take,
                                void *user);

/** Marks the blobs that no row names, and removes those that were marked delay_s ago. */
qm_stored qm_store_clean_blobs(qm_store *store, double delay_s);

/* ---- idempotency ---- */

/** Identifies a request that creates something when it is repeated. */
typedef struct qm_store_idempotency {
    const char *key; /* of the client; NULL: each request creates something */
    char request[QM_HASH_SIZE];
} qm_store_idempotency;

/** What such a request has created, and the hash of that request. */
typedef struct qm_store_idempotency_record {
    char id[QM_ID_SIZE];
    char request[QM_HASH_SIZE];
} qm_store_idempotency_record;
qm_stored qm_store_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                  qm_store_idempotency_record *out);
qm_stored qm_store_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                          qm_store_idempotency_record *out);

/**
 * A layout at one of its revisions, which are numbered from 0. Undo and redo move between the revisions that
 * are kept. Strings of found rows are the caller's, for qm_store_layout_reset.
 */
typedef struct qm_store_layout {
    char id[QM_ID_SIZE];
    char mesh[QM_ID_SIZE];
    char *created;
    int64_t revision, first, latest; /* the current one; undo and redo reach first to latest */
    char *layout;                    /* {nodes, curves, patches} */
    char *issues;                    /* "issues":[...] */
    bool is_complete;                /* there are no issues */
    int64_t next_curve;              /* id */
    int64_t sequence;
} qm_store_layout;

/** Stores a new layout with its revision 0; QM_STORED_TAKEN when its idempotency key has created another one. */
qm_stored qm_store_put_layout(qm_store *store, const qm_store_layout *layout,
                              const qm_store_idempotency *idempotency);
qm_stored qm_store_find_layout(qm_store *store, const char *id, qm_store_layout *out);
/** mesh: of one mesh only, or NULL. */
qm_stored qm_store_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                qm_store_layout *out, size_t *count);
/** Adds the revision after layout->revision and drops the undone ones. QM_STORED_LATE when the current
 * revision is another one. */
qm_stored qm_store_edit_layout(qm_store *store, const qm_store_layout *layout);
/** Moves from one revision to another that is kept; QM_STORED_LATE when `from` is not the current one. */
qm_stored qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to);
qm_stored qm_store_delete_layout(qm_store *store, const char *id);
void qm_store_layout_reset(qm_store_layout *layout);

/** A reconstruction: its source and layout, the steps that it has taken, and its current mesh. */
struct qm_store_reconstruction {
    char id[QM_ID_SIZE];
    char source[QM_ID_SIZE], layout_id[QM_ID_SIZE], mesh[QM_ID_SIZE];
    char *layout;   /* {nodes, curves, patches}: a line for its start and one for each edit */
    char *document; /* members of the resource that do not change */
    char *steps;    /* words: LIMIT:COUNT for COUNT steps with a limit of quads, EDIT for the next layout */
    char *records;  /* of the steps: JSON objects with commas between */
    char *state;    /* members of the resource that steps change */
    double cover_share;
    bool pull_curves;
    int64_t revision; /* number of changes */
    int64_t sequence;
};

/** Stores a new one, with its mesh, or with NULL when that is stored already: both, or none. QM_STORED_TAKEN
 * when its idempotency key has created another one; QM_STORED_LATE when the mesh's content has another row. */
qm_stored qm_store_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                      const qm_store_mesh *mesh, const qm_store_idempotency *idempotency);
qm_stored qm_store_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out);
/** source: of one mesh only, or NULL. */
qm_stored qm_store_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                        qm_store_reconstruction *out, size_t *count);
/** Writes mesh, layout, steps, records, state and revision, with a new mesh or NULL, as the end of a job does. */
qm_stored qm_store_update_reconstruction(qm_store *store, const qm_store_effect *effect);
qm_stored qm_store_delete_reconstruction(qm_store *store, const char *id);
void qm_store_reconstruction_reset(qm_store_reconstruction *reconstruction);

/* ---- copies of rows, for another store (store_copy.h) ---- */

/**
 * Opens a shared store without joining its nodes; the database shows the process by the name of self. To write: makes
 * the tables when the database has none. To read: one snapshot of the database, from one thread; folder is the cache of
 * blobs, or NULL when none is opened or checked. Returns as qm_store_open_shared does, and QM_STORED_NONE with a message
 * when there are no tables to read.
 */
qm_stored qm_store_visit_to_read(const char *address, const qm_store_node *self, const char *folder,
                                 qm_store **out, char message[QM_MESSAGE_SIZE]);
qm_stored qm_store_visit_to_write(const char *address, const qm_store_node *self, bool is_unsafe,
                                  qm_store **out, char message[QM_MESSAGE_SIZE]);

/** All that a store has of a job but its events and its array. */
typedef struct qm_store_job_copy {
    qm_store_job job; /* without type and subjects; deaths as the next claim is to tell them */
    char *type;
    char *subjects;  /* separated by blanks; "" or NULL: none */
    char *revisions; /* of its meshes; "" when it answers no later request */
    int64_t claims;  /* how often it was claimed; of an embedded store, once by each process that had it */
} qm_store_job_copy;

qm_stored qm_store_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                   size_t *count);
struct qm_store_array;
/**
 * Stores a job with its events and its array, or NULL for none, as they are; one that has not ended waits for a claim, and
 * runs to its end whichever client leaves. All of it is stored, or nothing, and durably after qm_store_sync. QM_STORED
 * also when the store has a job of this id, which stays as it is; QM_STORED_TAKEN when its idempotency key has another job.
 */
qm_stored qm_store_put_job_copy(qm_store *store, const qm_store_job_copy *copy, const qm_store_event *events,
                                size_t count, const struct qm_store_array *array);
void qm_store_job_copy_reset(qm_store_job_copy *copy);

/** The kept revisions of a layout, as pages in their order; a page begins after a revision, -1 for the first. */
qm_stored qm_store_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                         qm_store_layout *out, size_t *count);
/**
 * Stores a layout with all its kept revisions, in their order, of which `current` is the current one. QM_STORED also
 * when the store has a layout of this id, which stays as it is; QM_STORED_TAKEN when its idempotency key has another one.
 */
qm_stored qm_store_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                   int64_t current, const qm_store_idempotency *idempotency);

/** The idempotency key of the client that created a row, and the hash of its request. */
typedef struct qm_store_origin {
    char *key; /* on the heap; NULL: none */
    char request[QM_HASH_SIZE];
} qm_store_origin;
qm_stored qm_store_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out);
qm_stored qm_store_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out);

/** Makes all that was put before durable. */
qm_stored qm_store_sync(qm_store *store);

/* ---- a shared store, from outside ---- */

/**
 * Prints what a shared store is, without joining its nodes: a line "name: value" for each fact, and "fault: ..." for each
 * reason why it does not serve: commits that are not durable, no node that lives, other tables. *faults is their number.
 */
qm_stored qm_store_print_status(const char *address, const qm_store_node *self, FILE *out, size_t *faults,
                                char message[QM_MESSAGE_SIZE]);

/** Compares the rows and blobs of a shared store as qm_store_check does those of a folder, and repairs nothing. Blobs
 * that no row names count as orphans. */
qm_stored qm_store_check_shared(const char *address, const qm_store_node *self, FILE *out,
                                qm_store_findings *found, char message[QM_MESSAGE_SIZE]);

#endif
