/**
 * store_check.h: what checks of both kinds of store share.
 */
#ifndef QM_STORE_CHECK_H
#define QM_STORE_CHECK_H

#include "store.h"

typedef struct qm_store_checking {
    qm_store *store;
    bool repairs;
    FILE *out;
    qm_store_findings found;
} qm_store_checking;

/** Counts a fault, and writes its line. */
void qm_store_check_tell(qm_store_checking *work, bool is_repaired, const char *what, const char *id,
                         const char *state);

/** Compares the files of all meshes and jobs with their hashes and checksums. */
void qm_store_check_rows(qm_store_checking *work);

#endif
