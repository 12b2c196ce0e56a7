/**
 * store_copy.h: copies everything from an embedded store to a shared one, or back: meshes with their revisions, layouts with
 * all that undo and redo reach, reconstructions, and jobs with their events and arrays, each kind in order of creation.
 *
 * A row is copied after all that it names, and as a whole or not at all. One that is there already is passed over: a copy
 * that was cut off may be made again, and copies the rest. What is damaged is left out, with a line.
 */
#ifndef QM_STORE_COPY_H
#define QM_STORE_COPY_H

#include "store.h"

/** What a copy has done. */
typedef struct qm_store_copied {
    size_t meshes, layouts, reconstructions, jobs; /* rows that were copied */
    size_t before;                                 /* rows that were there */
    size_t faults;                                 /* rows that were not copied, or not with all they have */
} qm_store_copied;

/** Copies from one store to the other, of which one is shared. Lines on out tell what is not as it was. Else than
 * QM_STORED: the copy was cut off. */
qm_stored qm_store_copy(qm_store *from, qm_store *to, FILE *out, qm_store_copied *copied);

/**
 * Copies a data folder that no process holds to a shared store, whose nodes may run. A folder of an earlier version is
 * first brought up to date. Jobs that have not ended wait there. A mesh whose content is there under another id keeps its
 * id, and no upload finds it. All is durable when QM_STORED is returned; else there is a message. A folder that the database
 * has had all of, without a fault, notes that, and is not copied there once more (QM_STORED_TAKEN).
 */
qm_stored qm_store_import(const char *folder, const char *address, const qm_store_node *self, bool is_unsafe,
                          FILE *out, qm_store_copied *copied, char message[QM_MESSAGE_SIZE]);

/**
 * Makes a data folder, which is missing or empty, of a shared store: one snapshot, whatever its nodes do meanwhile. The
 * folder gets its name when everything is in it and on disk. Else than QM_STORED: there is a message, and no folder.
 */
qm_stored qm_store_export(const char *address, const qm_store_node *self, const char *folder, FILE *out,
                          qm_store_copied *copied, char message[QM_MESSAGE_SIZE]);

#endif
