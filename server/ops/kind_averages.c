/**
 * kind_averages.c: what kinds of job with averages over a surface share: fields of requests, and members of results.
 */
#include <cjson/cJSON.h>

#include "job_kinds_internal.h"
#include "json_request.h"

bool qm_averages_read_percentiles(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_PERCENTILES) return false;
    out->percentile_count = 0;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double *percentile = &out->percentiles[out->percentile_count];
        if (!qm_json_read_number(number, percentile) || !(*percentile > 0.0 && *percentile <= 100.0))
            return false;
        out->percentile_count++;
    }
    return true;
}
_Static_assert(QM_JOB_MAX_PERCENTILES == 64, "the text of percentiles names the limit");

static void add_members(qm_text *out, qm_interval interval, const qm_job_result *result, bool has_true)
{
    qm_json_add_lower_upper(out, interval.lower, interval.upper, result->diagonal);
    if (has_true) qm_job_add_of_true(out, result, interval);
}

void qm_averages_add_figure(qm_text *out, const char *name, qm_interval interval, const qm_job_result *result,
                            int side)
{
    qm_json_open(out, name, "{");
    add_members(out, interval, result, result->notes[side].uncertainty == 0.0);
    qm_text_add_string(out, "}");
}

void qm_averages_add_greatest(qm_text *out, const char *name, qm_interval interval,
                              const qm_job_result *result)
{
    qm_json_open(out, name, "{");
    add_members(out, interval, result, true);
    qm_text_add_string(out, "}");
}

void qm_averages_add_percentiles(qm_text *out, const double *percent, const qm_interval *percentile,
                                 size_t count, const qm_job_result *result, int side)
{
    qm_json_open(out, "percentiles", "[");
    for (size_t i = 0; i < count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "percent", percent[i]);
        add_members(out, percentile[i], result, result->notes[side].uncertainty == 0.0);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

void qm_averages_add_measure(qm_text *out, const qm_deviation *deviation)
{
    static const char *const measures[] = {"area", "vertices", "points"};
    qm_json_add_string(out, "over", measures[deviation->measure]);
    qm_json_add_range(out, "size", deviation->size);
}
