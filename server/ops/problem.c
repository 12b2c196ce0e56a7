/**
 * problem.c: the table of problem codes, and conversions to problems.
 */
#include "problem.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

typedef struct problem_row {
    int status;
    const char *name, *title;
} problem_row;

static const problem_row rows[] = {
#define XX(suffix, status, code, title) {status, code, title},
    QM_PROBLEM_MAP(XX)
#undef XX
};

int qm_problem_status(qm_problem_code code)
{
    QM_ASSERT(code < QM_PROBLEM_COUNT);
    return rows[code].status;
}

const char *qm_problem_name(qm_problem_code code)
{
    return rows[code].name;
}

const char *qm_problem_title(qm_problem_code code)
{
    return rows[code].title;
}

/** Conditions that pass may be retried: a full queue soon, an unavailable daemon after a restart. */
static int retry_after(qm_problem_code code)
{
    return code == QM_PROBLEM_TOO_MANY_JOBS ? 1 : code == QM_PROBLEM_UNAVAILABLE ? 5 : 0;
}

qm_problem qm_problem_make(qm_problem_code code, const char *format, ...)
{
    qm_problem problem = {.code = code, .retry_after_s = retry_after(code)};
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(problem.detail, sizeof problem.detail, format, arguments);
    va_end(arguments);
    return problem;
}

void qm_problem_add_pointer(qm_problem *problem, const char *pointer, const char *format, ...)
{
    if (problem->error_count == QM_PROBLEM_ERRORS) return;
    qm_problem_error *error = &problem->errors[problem->error_count++];
    *error = (qm_problem_error){.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    snprintf(error->pointer, sizeof error->pointer, "%s", pointer);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->detail, sizeof error->detail, format, arguments);
    va_end(arguments);
}

void qm_problem_add_offset(qm_problem *problem, size_t offset, const char *message)
{
    if (problem->error_count == QM_PROBLEM_ERRORS) return;
    qm_problem_error *error = &problem->errors[problem->error_count++];
    *error = (qm_problem_error){.line = QM_NO_LOCATION, .offset = offset};
    snprintf(error->detail, sizeof error->detail, "%s", message);
}

qm_problem qm_problem_from_store(qm_status status, qm_problem_code none, const char *format, ...)
{
    char name[128];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(name, sizeof name, format, arguments);
    va_end(arguments);
    if (status == QM_E_EMPTY) return qm_problem_make(none, "there is no %s", name);
    if (status == QM_E_NO_MEMORY)
        return qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for %s", name);
    return qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s cannot be read", name);
}

/** The problem code of each status of the engine. */
static const qm_problem_code code_of_status[] = {
    [QM_OK] = QM_PROBLEM_INTERNAL,
    [QM_E_ARGUMENT] = QM_PROBLEM_INVALID_FIELD,
    [QM_E_NO_MEMORY] = QM_PROBLEM_OUT_OF_MEMORY,
    [QM_E_CANCELED] = QM_PROBLEM_CONFLICT,
    [QM_E_NOT_FINITE] = QM_PROBLEM_NOT_FINITE,
    [QM_E_EMPTY] = QM_PROBLEM_EMPTY_MESH,
    [QM_E_INDEX] = QM_PROBLEM_INDEX_OUT_OF_RANGE,
    [QM_E_FORMAT] = QM_PROBLEM_MALFORMED_FILE,
    [QM_E_UNSUPPORTED] = QM_PROBLEM_UNSUPPORTED_FEATURE,
    [QM_E_TOO_LARGE] = QM_PROBLEM_TOO_LARGE,
    [QM_E_SCALE] = QM_PROBLEM_SCALE_OUT_OF_RANGE,
    [QM_E_LAYOUT] = QM_PROBLEM_INVALID_LAYOUT,
};
_Static_assert(sizeof code_of_status / sizeof code_of_status[0] == QM_STATUS_COUNT,
               "a status has no problem code");

qm_problem qm_problem_from_status(qm_status status, const char *message)
{
    QM_ASSERT(status < QM_STATUS_COUNT);
    return qm_problem_make(code_of_status[status], "%s", message[0] ? message : qm_status_text(status));
}

qm_problem qm_problem_from_codec(qm_status status, const qm_codec_report *report)
{
    qm_problem problem = qm_problem_from_status(status, report->detail);
    if (report->line == QM_NO_LOCATION && report->offset == QM_NO_LOCATION) return problem;
    problem.error_count = 1;
    problem.errors[0] = (qm_problem_error){.line = report->line, .offset = report->offset};
    snprintf(problem.errors[0].detail, sizeof problem.errors[0].detail, "%s", problem.detail);
    return problem;
}
