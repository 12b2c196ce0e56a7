#include "json_read.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "json_parse.h"

qm_json *qm_json_parse(const char *text)
{
    const char *end;
    bool no_memory;
    return (qm_json *)qm_json_parse_tree(text, strlen(text), &end, &no_memory);
}

void qm_json_free(qm_json *json)
{
    cJSON_Delete((cJSON *)json);
}

static const cJSON *find(const qm_json *json, const char *path)
{
    const cJSON *at = (const cJSON *)json;
    while (at && *path) {
        char name[64];
        size_t length = strcspn(path, ".");
        if (length >= sizeof name) return NULL;
        memcpy(name, path, length);
        name[length] = '\0';
        bool is_place = cJSON_IsArray(at) && name[0] >= '0' && name[0] <= '9';
        if (is_place) {
            at = cJSON_GetArrayItem(at, atoi(name));
        } else {
            if (cJSON_IsArray(at)) at = at->child;
            at = cJSON_GetObjectItemCaseSensitive(at, name);
        }
        path += length + (path[length] == '.');
    }
    return at;
}

double qm_json_get_number(const qm_json *json, const char *path)
{
    const cJSON *found = find(json, path);
    return cJSON_IsNumber(found) ? found->valuedouble : NAN;
}

const char *qm_json_get_string(const qm_json *json, const char *path)
{
    return cJSON_GetStringValue(find(json, path));
}

bool qm_json_is_true(const qm_json *json, const char *path)
{
    return cJSON_IsTrue(find(json, path));
}

bool qm_json_has(const qm_json *json, const char *path)
{
    const cJSON *found = find(json, path);
    return found && !cJSON_IsNull(found);
}
