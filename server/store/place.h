/**
 * place.h: where the bytes of a shared store's blobs are, for all nodes: its database, a folder that all nodes see, or a
 * bucket of an object store that speaks the protocol of S3. Rows of the database say which objects a place has.
 *
 * An object is written once, under a name that no other one ever has, and never changed. Every function may be called
 * again with the same arguments. Calls may come from any thread.
 */
#ifndef QM_PLACE_H
#define QM_PLACE_H

#include "store.h"

struct qm_postgres_connection;
typedef struct qm_place qm_place;

/** An object that is to be put. */
typedef struct qm_place_object {
    const char *name;
    int file; /* has the bytes; read by offsets */
    uint64_t size;
    const char *hash;                           /* of the bytes: SHA-256 in hex */
    struct qm_postgres_connection *transaction; /* in which a place that is transactional writes; else NULL */
} qm_place_object;

/**
 * The functions of a kind of place. QM_STORED_AWAY: the place does not answer or refuses, which is logged;
 * QM_STORED_NO_ROOM: its disk is full.
 */
typedef struct qm_place_kind {
    const char *name;      /* as the database and messages have it */
    bool is_transactional; /* an object appears with the commit of the transaction that puts it */
    /** QM_STORED: all nodes can read the object from now on, and it survives a power cut of the place. */
    qm_stored (*put)(qm_place *place, const qm_place_object *object);
    /** QM_STORED_NONE: there is no object of the name that has so many bytes. */
    qm_stored (*look)(qm_place *place, const char *name, uint64_t size);
    /** Writes the bytes of an object to an empty file. The caller compares them with their hash. QM_STORED_NONE: the
     * object, or a part of it, is missing. */
    qm_stored (*get)(qm_place *place, const char *name, uint64_t size, int file);
    /** QM_STORED also when there is no such object. */
    qm_stored (*remove)(qm_place *place, const char *name);
    void (*close)(qm_place *place);
} qm_place_kind;

/** A place; its kind has more behind this. */
struct qm_place {
    const qm_place_kind *kind;
    char *message; /* of QM_MESSAGE_SIZE, receives a fault in place of the log; NULL once the store is open */
};

/** True for the setting of the place that needs no other software. */
bool qm_place_is_database(const char *where);

/**
 * Opens the place of a setting, a folder or s3://..., of which nothing is read yet. Keys: the file with the keys of a
 * bucket; "" for the environment. QM_STORED, or with a message.
 */
qm_stored qm_place_open(const char *where, const char *keys, qm_place **out, char message[QM_MESSAGE_SIZE]);
void qm_place_close(qm_place *place);

/**
 * Reads the id of a place, which lies in it as an object, so that neither a folder that is not mounted nor the bucket of
 * another store is taken for it. QM_STORED_NONE: it has none; creates: it gets one.
 */
qm_stored qm_place_identify(qm_place *place, bool creates, char id[QM_ID_SIZE]);

/** Name of the object with the id. */
#define QM_PLACE_ID "quadmeshd-place"

/* ---- for the kinds ---- */

qm_stored qm_place_open_folder(const char *path, qm_place **out, char message[QM_MESSAGE_SIZE]);
qm_stored qm_place_open_s3(const char *url, const char *keys, qm_place **out, char message[QM_MESSAGE_SIZE]);

/** Tells of a fault of the place. Returns QM_STORED_AWAY. */
qm_stored qm_place_fail(qm_place *place, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** Appends bytes to the file that a blob is copied to, which lies in the data folder. QM_STORED_FAULT: its disk takes no
 * more. */
qm_stored qm_place_write(int file, const void *bytes, size_t size);

/** Makes that file empty, to copy anew; false after a fault. */
bool qm_place_empty(int file);

/** Reads up to size bytes from an offset, fewer at the end of the file only; -1 after a fault, which is logged. */
ssize_t qm_place_read(int file, void *bytes, size_t size, uint64_t offset);

#endif
