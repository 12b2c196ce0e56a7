#include "curl.h"

#include <dlfcn.h>
#include <stdbool.h>

/* The name that has been the same since 2006. */
#define LIBRARY "libcurl.so.4"

static bool find(void *library, const char *name, void *function)
{
    void *found = dlsym(library, name);
    *(void **)function = found;
    return found != NULL;
}

static bool find_all(void *library, cli_curl *curl)
{
#define XX(name) &&find(library, "curl_" #name, &curl->name)
    return library CLI_CURL_MAP(XX);
#undef XX
}

const cli_curl *cli_curl_load(const char **why)
{
    static cli_curl curl;
    static bool is_loaded;
    if (!is_loaded) is_loaded = find_all(dlopen(LIBRARY, RTLD_LAZY), &curl);
    if (is_loaded) return &curl;
    *why = dlerror();
    return NULL;
}
