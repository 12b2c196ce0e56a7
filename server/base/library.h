/**
 * library.h: functions of shared libraries that are loaded when they are needed.
 */
#ifndef QM_LIBRARY_H
#define QM_LIBRARY_H

#include <stdbool.h>

/** Sets *function, a pointer to a function, to that of a library which dlopen has loaded; false when it has none of
 * the name. */
bool qm_library_find(void *library, const char *name, void *function);

#endif
