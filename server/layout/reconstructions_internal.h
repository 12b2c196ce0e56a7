/**
 * reconstructions_internal.h: what the files of the reconstructions share: reconstructions.c (the table),
 * reconstruction_make.c (from a layout, or again from a row), reconstruction_rows.c (what is stored of them).
 */
#ifndef QM_RECONSTRUCTIONS_INTERNAL_H
#define QM_RECONSTRUCTIONS_INTERNAL_H

#include <uv.h>

#include "reconstructions.h"

/** Stands in the steps of a row for the layout in its next line. */
#define QM_EDIT_WORD "EDIT"

typedef struct qm_refining_entry {
    qm_refining refining; /* first, so that one is the other */
    bool in_work;
    struct qm_refining_entry *next; /* the one used last comes first */
} qm_refining_entry;

/** lock guards the list and in_work; a reconstruction itself belongs to who works on it. */
struct qm_reconstructions {
    qm_store *store;
    qm_meshes *meshes;
    uv_mutex_t lock;
    qm_refining_entry *first;
};

/** Starts a reconstruction of a layout on a mesh. NULL with a problem. */
qm_refining_entry *qm_refining_begin(qm_reconstructions *rs, const char *source, const char *layout_text,
                                     const qm_reconstruction_options *options, qm_problem *problem);

/** Makes a reconstruction of the store again. NULL with a problem. */
qm_refining_entry *qm_refining_make_again(qm_reconstructions *rs, const char *id, qm_problem *problem);

/** Puts the reconstruction of an edited layout in the place of the one before it; false with a problem. */
bool qm_refining_edit(qm_refining *r, const char *layout_text, size_t *redone, qm_problem *problem);

/** Gives an entry that is in no list back. */
void qm_refining_free(qm_reconstructions *rs, qm_refining_entry *e);

/** Lists a new entry that the caller works on. */
void qm_reconstructions_list(qm_reconstructions *rs, qm_refining_entry *e);

#endif
