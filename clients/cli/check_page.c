/**
 * check_page.c: the report of a pair that was checked, for people: a file of HTML.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "check.h"
#include "report/report.h"

enum { PATH_SIZE = 4096 };

bool cli_is_page(const char *path)
{
    static const char end[] = ".html";
    size_t size = strlen(path), length = strlen(end);
    return size >= length && strcmp(path + size - length, end) == 0;
}

/** The file of the pair: the one that was named, or one in the folder whose name starts with the pair's place, so that no two are the
 * same. False when it is too long. */
static bool name_file(const char *pages, const cli_checked_pair *pair, char out[PATH_SIZE])
{
    bool is_file = cli_is_page(pages);
    int used = is_file
                   ? snprintf(out, PATH_SIZE, "%s", pages)
                   : snprintf(out, PATH_SIZE, "%s/%03zu-%s.html", pages, pair->place + 1, pair->check->name);
    if (used < 0 || used >= PATH_SIZE) return false;
    for (char *at = out + (is_file ? used : (int)strlen(pages) + 1); *at; at++)
        if (*at == '/') *at = '_';
    return true;
}

/** Compares the pair with what a report shows; false after a failure. */
static bool compare(qm_context *ctx, const cli_check_settings *settings, const cli_checked_pair *pair,
                    qm_report *report, qm_text *request_text, qm_text *result_text)
{
    qm_job_request request = qm_job_request_default();
    request.kind = QM_JOB_COMPARISON;
    request.quads = pair->check->rule.quads;
    request.threads = settings->threads;
    cli_ask_for_report(&request);
    request.limit_count = (size_t)qm_report_limits(report->limit, report->range, request.limits);
    qm_job_result result;
    if (qm_job_execute(ctx, &request, &pair->mesh[0], &pair->mesh[1], NULL, NULL, &result) != QM_OK)
        return false;
    qm_json_write_request_briefly(request_text, &request);
    qm_json_write_result(result_text, &request, &result);
    for (int side = 0; side < 2; side++)
        report->mesh[side].notes = result.notes[side];
    qm_job_result_reset(ctx, &result);
    report->request = request_text->data;
    report->result = result_text->data;
    return !request_text->failed && !result_text->failed;
}

bool cli_write_check_page(qm_context *ctx, const cli_check_settings *settings, const cli_checked_pair *pair,
                          qm_problem *problem)
{
    const qm_check_rule *rule = &pair->check->rule;
    char hash[2][QM_HASH_SIZE], now[QM_TIME_SIZE], path[PATH_SIZE];
    qm_clock_format(now);
    /* A report judges the greatest distance of both directions. */
    bool has_verdict = rule->percent >= 100.0 && rule->direction == QM_TWO_SIDED;
    qm_report report = {.made = now,
                        .limit = has_verdict ? rule->limit : NAN,
                        .range = rule->limit > 0.0 ? 2.0 * rule->limit : NAN,
                        .thread_count = settings->threads};
    for (int side = 0; side < 2; side++)
        report.mesh[side] = (qm_report_mesh){.name = cli_base_name(pair->check->path[side]),
                                             .hash = cli_hash_file(pair->check->path[side], hash[side]),
                                             .transform = side == 0 ? pair->transform : NULL,
                                             .loaded = &pair->mesh[side]};
    qm_text request = {0}, result = {0}, page = {0};
    bool is_made = compare(ctx, settings, pair, &report, &request, &result);
    if (!is_made)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "the comparison for the report failed");
    is_made = is_made && qm_report_write(ctx, &report, &page, problem);
    if (is_made && !(name_file(settings->pages, pair, path) && cli_write_file(path, page.data, page.size))) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "the report cannot be written to %s: %s",
                                   settings->pages, strerror(errno));
        is_made = false;
    }
    qm_text_reset(&request);
    qm_text_reset(&result);
    qm_text_reset(&page);
    return is_made;
}
