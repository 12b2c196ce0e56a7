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

void qm_averages_add_percentiles(qm_text *out, const double *percent, const qm_interval *percentile,
                                 size_t count, double diagonal)
{
    qm_json_open(out, "percentiles", "[");
    for (size_t i = 0; i < count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "percent", percent[i]);
        qm_json_add_lower_upper(out, percentile[i].lower, percentile[i].upper, diagonal);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

void qm_averages_add_measure(qm_text *out, const qm_deviation *deviation)
{
    static const char *const measures[] = {"area", "vertices", "points"};
    qm_json_add_string(out, "over", measures[deviation->measure]);
    qm_json_open(out, "size", "{");
    qm_json_add_number(out, "lower", deviation->size.lower);
    qm_json_add_number(out, "upper", deviation->size.upper);
    qm_text_add_string(out, "}");
}
