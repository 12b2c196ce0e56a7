/**
 * check_page.c: the report of a pair that was checked, for people: a file of HTML.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "check.h"

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

/** The request of the comparison that a report shows. */
static qm_job_request make_request(const cli_checked_pair *pair, const qm_report *report)
{
    qm_job_request request = cli_checked_request(pair, QM_JOB_COMPARISON);
    cli_ask_for_report(&request);
    const qm_report_limits *limits = &report->limits;
    request.limit_count = (size_t)qm_report_scale_limits(limits->distance, report->range, request.limits);
    cli_add_limit_bands(limits->inside, limits->outside, &request);
    return request;
}

/** Writes the report of a comparison in this process; false with a problem in the pair. */
static bool make_here(cli_checked_pair *pair, qm_report *report, qm_text *out)
{
    char hash[2][QM_HASH_SIZE], now[QM_TIME_SIZE];
    qm_job_request request = make_request(pair, report);
    qm_text request_text = {0};
    qm_problem problem;
    qm_clock_format(now);
    report->made = now;
    char *result = cli_ask_checked(pair, &request, true);
    qm_json_write_request_briefly(&request_text, &request);
    report->result = result;
    report->request = request_text.data;
    for (int side = 0; side < 2; side++)
        report->mesh[side] =
            (qm_report_mesh){.name = cli_base_name(pair->check->path[side]),
                             .hash = cli_hash_file(pair->check->path[side], hash[side]),
                             .notes = pair->notes[side],
                             .transform = side == 0 && pair->pose.is_given ? pair->pose.transform : NULL,
                             .loaded = &pair->mesh[side]};
    bool is_made = result && !request_text.failed;
    if (is_made && !qm_report_write(&pair->ctx, report, out, &problem)) {
        cli_format_problem(pair->problem, sizeof pair->problem, pair->check->path[0], &problem);
        is_made = false;
    }
    qm_text_reset(&request_text);
    free(result);
    return is_made;
}

/** Fetches that of a comparison on the daemon; false with a problem in the pair. */
static bool fetch(cli_checked_pair *pair, const qm_report *report, qm_text *out)
{
    qm_job_request request = make_request(pair, report);
    char *result = cli_ask_checked(pair, &request, true);
    bool is_made =
        result && cli_session_fetch_report(pair->settings->session, &report->limits, report->range, out);
    if (result && !is_made)
        cli_format_problem(pair->problem, sizeof pair->problem, pair->check->path[0], &pair->told);
    free(result);
    return is_made;
}

bool cli_write_check_page(cli_checked_pair *pair)
{
    const cli_check_settings *settings = pair->settings;
    const qm_check_rule *rule = &pair->check->rule;
    char path[PATH_SIZE];
    /* A report judges the greatest distance of both directions. */
    bool has_verdict = rule->percent >= 100.0 && rule->direction == QM_TWO_SIDED;
    qm_report report = {.limits = {has_verdict ? rule->limit : NAN, rule->limit_in, rule->limit_out},
                        .range = rule->limit > 0.0 ? 2.0 * rule->limit : NAN,
                        .thread_count = settings->threads};
    qm_text page = {0};
    bool is_made = settings->session ? fetch(pair, &report, &page) : make_here(pair, &report, &page);
    if (is_made && !(name_file(settings->pages, pair, path) && cli_write_file(path, page.data, page.size))) {
        snprintf(pair->problem, sizeof pair->problem, "the report cannot be written to %.300s: %s",
                 settings->pages, strerror(errno));
        is_made = false;
    }
    qm_text_reset(&page);
    return is_made;
}
