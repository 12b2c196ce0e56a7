#include "json_parse.h"

#include <cjson/cJSON.h>
#include <pthread.h>
#include <stdlib.h>

/** The library tells no difference: the first failed request for memory is noted here. */
static _Thread_local bool has_failed;

static void *take_memory(size_t size)
{
    void *taken = malloc(size);
    if (!taken) has_failed = true;
    return taken;
}

static void set_hooks(void)
{
    cJSON_InitHooks(&(cJSON_Hooks){take_memory, free});
}

cJSON *qm_json_parse_tree(const char *text, size_t size, const char **end, bool *no_memory)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, set_hooks);
    has_failed = false;
    *end = text;
    cJSON *tree = cJSON_ParseWithLengthOpts(text, size, end, false);
    *no_memory = !tree && has_failed;
    return tree;
}
