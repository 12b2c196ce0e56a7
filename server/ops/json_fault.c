#include "json_fault.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define POINTER_SIZE sizeof(((qm_problem_error *)NULL)->pointer)

bool qm_json_read_number(const cJSON *value, double *out)
{
    *out = cJSON_GetNumberValue(value);
    return cJSON_IsNumber(value) && isfinite(*out);
}

bool qm_json_read_whole(const cJSON *value, double least, double greatest, double *out)
{
    return qm_json_read_number(value, out) && *out >= least && *out <= greatest && *out == floor(*out);
}

bool qm_json_read_rows(const cJSON *value, double **rows, size_t *row_count, qm_json_fault *at)
{
    if (!cJSON_IsArray(value)) return false;
    size_t count = (size_t)cJSON_GetArraySize(value);
    if (count == 0) return true;
    *rows = malloc(count * 3 * sizeof **rows);
    if (!*rows) {
        at->no_memory = true;
        return false;
    }
    for (const cJSON *row = value->child; row; row = row->next) {
        *at = (qm_json_fault){.depth = 1, .index = {*row_count}};
        if (!cJSON_IsArray(row) || cJSON_GetArraySize(row) != 3) return false;
        at->depth = 2;
        for (const cJSON *number = row->child; number; number = number->next, at->index[1]++)
            if (!qm_json_read_number(number, &(*rows)[3 * *row_count + at->index[1]])) return false;
        ++*row_count;
    }
    return true;
}

/** A JSON pointer to a member, or to an entry in it: ~ and / of the name are written ~0 and ~1; long names
 * and odd bytes are shortened. */
static void make_pointer(char out[POINTER_SIZE], const char *name, const qm_json_fault *at)
{
    size_t length = 0;
    out[length++] = '/';
    for (const char *c = name; *c && length < 64; c++) {
        if ((unsigned char)*c < 0x20 || (unsigned char)*c >= 0x7f) {
            out[length++] = '?';
        } else if (*c == '~' || *c == '/') {
            out[length++] = '~';
            out[length++] = *c == '~' ? '0' : '1';
        } else {
            out[length++] = *c;
        }
    }
    out[length] = '\0';
    for (int i = 0; i < at->depth; i++)
        length += (size_t)snprintf(out + length, POINTER_SIZE - length, "/%zu", at->index[i]);
}

void qm_json_complain_of(qm_problem *problem, const char *name, const qm_json_fault *at, const char *words)
{
    char pointer[POINTER_SIZE];
    make_pointer(pointer, name, at);
    if (at->no_memory) words = "needs more memory than there is";
    qm_problem_code code = at->no_memory ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_INVALID_FIELD;
    bool takes_over = code == QM_PROBLEM_INVALID_FIELD && problem->code != code;
    if (problem->error_count == 0 || takes_over) {
        problem->code = code;
        snprintf(problem->detail, sizeof problem->detail, "%s %s", pointer + 1, words);
    }
    qm_problem_add_pointer(problem, pointer, "%s", words);
}

void qm_json_complain(qm_problem *problem, const char *name, const char *words)
{
    qm_json_complain_of(problem, name, &(qm_json_fault){0}, words);
}
