/**
 * quality_out.c: the metrics of the faces of a mesh as JSON.
 */
#include "quality_out.h"

#include <math.h>

#include "base/json.h"

static void add_extreme(qm_text *out, const char *name, const char *face_name, double value, size_t face,
                        bool has_value)
{
    qm_json_add_number(out, name, value);
    if (has_value)
        qm_json_add_count(out, face_name, face);
    else
        qm_json_add_word(out, face_name, "null");
}

void qm_quality_add_summary(qm_text *out, qm_metric metric, const qm_metric_summary *summary)
{
    bool has_value = summary->faces > 0;
    qm_json_add_string(out, "metric", qm_metric_names[metric]);
    qm_json_add_count(out, "faces", summary->faces);
    qm_json_add_count(out, "undefined", summary->undefined);
    add_extreme(out, "minimum", "minimum_face", has_value ? summary->minimum : NAN, summary->minimum_face,
                has_value);
    add_extreme(out, "maximum", "maximum_face", has_value ? summary->maximum : NAN, summary->maximum_face,
                has_value);
    qm_json_add_number(out, "mean", has_value ? summary->mean : NAN);
    qm_json_open(out, "percentiles", "[");
    for (int i = 0; i < QM_METRIC_PERCENTILES && has_value; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "percent", qm_metric_percents[i]);
        qm_json_add_number(out, "value", summary->percentile[i]);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

qm_status qm_quality_write(qm_context *ctx, const qm_mesh *mesh, qm_text *out)
{
    qm_status status = QM_OK;
    qm_text_add_string(out, "{\"metrics\":[");
    for (int m = 0; m < QM_METRIC_COUNT && status == QM_OK; m++) {
        qm_metric_summary summary;
        status = qm_metric_summarize(ctx, mesh, (qm_metric)m, &summary);
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_quality_add_summary(out, (qm_metric)m, &summary);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]}");
    return status;
}
