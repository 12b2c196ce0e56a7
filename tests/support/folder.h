/**
 * folder.h: folders for a test's files.
 */
#ifndef QM_FOLDER_H
#define QM_FOLDER_H

#include <stddef.h>

/** A new empty folder; the path is the caller's, for qm_folder_remove. Without one the test program ends. */
char *qm_folder_make(void);

/** Removes the folder with all that is in it, and frees the path. */
void qm_folder_remove(char *path);

/** Files below a folder, folders not counted. */
size_t qm_folder_count_files(const char *path);

#endif
