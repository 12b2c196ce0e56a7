#include "json_value.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_ID 2147483647.0

bool qm_json_refuse(qm_problem *problem, const char *words, const char *format, size_t i, size_t k)
{
    char pointer[64];
    snprintf(pointer, sizeof pointer, format, i, k);
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s %s", pointer + 1, words);
    qm_problem_add_pointer(problem, pointer, "%s", words);
    return false;
}

bool qm_json_lack_memory(qm_problem *problem)
{
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the layout");
    return false;
}

bool qm_json_check_names(const cJSON *object, const char *const *known, qm_problem *problem)
{
    for (const cJSON *member = object->child; member; member = member->next) {
        size_t i = 0;
        while (known[i] && strcmp(known[i], member->string) != 0)
            i++;
        if (known[i]) continue;
        *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
        qm_json_complain(problem, member->string, "is not a field of this request");
        return false;
    }
    return true;
}

bool qm_json_read_index(const cJSON *value, uint32_t *out)
{
    double number;
    if (!qm_json_read_number(value, &number) || number < 0.0 || number > MAX_ID || number != floor(number))
        return false;
    *out = (uint32_t)number;
    return true;
}

bool qm_json_read_numbers(const cJSON *value, int count, double *out)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) != count) return false;
    for (const cJSON *number = value->child; number; number = number->next)
        if (!qm_json_read_number(number, out++)) return false;
    return true;
}

bool qm_json_read_table(const cJSON *value, int width, size_t least, const char *name, double **out,
                        size_t *count, qm_problem *problem)
{
    char pointer[48], words[64];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(words, sizeof words, "must hold %zu rows or more, each of %d finite numbers", least, width);
    size_t rows = cJSON_IsArray(value) ? (size_t)cJSON_GetArraySize(value) : 0;
    if (!cJSON_IsArray(value) || rows < least) return qm_json_refuse(problem, words, pointer, 0, 0);
    *out = malloc((rows + 1) * (size_t)width * sizeof **out);
    if (!*out) return qm_json_lack_memory(problem);
    *count = 0;
    for (const cJSON *row = value->child; row; row = row->next, ++*count) {
        if (qm_json_read_numbers(row, width, *out + (size_t)width * *count)) continue;
        free(*out);
        *out = NULL;
        snprintf(pointer, sizeof pointer, "/%s/%%zu", name);
        return qm_json_refuse(problem, words, pointer, *count, 0);
    }
    return true;
}

bool qm_json_read_id(const cJSON *object, const char *name, char out[QM_ID_SIZE], qm_problem *problem)
{
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, name));
    char pointer[32], words[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(words, sizeof words, "must be the id of a %s", strcmp(name, "layout") == 0 ? name : "mesh");
    if (!id || !*id || strlen(id) >= QM_ID_SIZE) return qm_json_refuse(problem, words, pointer, 0, 0);
    snprintf(out, QM_ID_SIZE, "%s", id);
    return true;
}
