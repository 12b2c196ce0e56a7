/**
 * library.c: ISO C converts no pointer to an object to one to a function, so the bytes are copied.
 */
#include "library.h"

#include <dlfcn.h>
#include <string.h>

bool qm_library_find(void *library, const char *name, void *function)
{
    void *symbol = dlsym(library, name);
    memcpy(function, &symbol, sizeof symbol);
    return symbol != NULL;
}
