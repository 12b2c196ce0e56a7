/**
 * store_problem.c: the problems of verbs.
 */
#include "store_problem.h"

#include <stdarg.h>
#include <stdio.h>

qm_problem qm_store_read_problem(qm_stored stored, qm_problem_code none, const char *format, ...)
{
    char name[128];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(name, sizeof name, format, arguments);
    va_end(arguments);
    if (stored == QM_STORED_NONE) return qm_problem_make(none, "there is no %s", name);
    if (stored == QM_STORED_NO_MEMORY)
        return qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for %s", name);
    if (stored == QM_STORED_DAMAGED)
        return qm_problem_make(QM_PROBLEM_RECORD_DAMAGED, "what is stored of %s is damaged", name);
    if (stored == QM_STORED_AWAY)
        return qm_problem_make(QM_PROBLEM_STORE_UNAVAILABLE, "the store did not answer: %s was not read",
                               name);
    return qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s cannot be read", name);
}

qm_problem qm_store_write_problem(qm_stored stored, const char *noun)
{
    if (stored == QM_STORED_FULL)
        return qm_problem_make(QM_PROBLEM_STORAGE_FULL, "the data folder has no room for %s", noun);
    if (stored == QM_STORED_NO_ROOM)
        return qm_problem_make(
            QM_PROBLEM_STORAGE_FULL,
            "the database that daemons share, or the place of its blobs, has no room for %s", noun);
    if (stored == QM_STORED_NO_MEMORY)
        return qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for %s", noun);
    if (stored == QM_STORED_AWAY)
        return qm_problem_make(QM_PROBLEM_STORE_UNAVAILABLE,
                               "the store did not say whether %s was stored: repeat the request", noun);
    return qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s could not be stored", noun);
}
