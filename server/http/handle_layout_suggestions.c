/**
 * handle_layout_suggestions.c: what is found for a layout and changes nothing: curves that would bring it nearer to completion,
 * planes of symmetry of its surface.
 */
#include "handlers.h"
#include "layout_image.h"
#include "layout_session.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "qm/layout_suggest.h"
#include "qm/symmetry.h"

#define MOST_SUGGESTIONS 100

/** Finds something for a layout, and adds it to the reply. mirror has the plane of the query, if there is one. */
typedef qm_status find_fn(qm_layout_session *s, const qm_layout_edit *mirror, qm_text *out);

static void reply_found(qm_request *request, find_fn *find)
{
    qm_layout_session s;
    qm_problem problem;
    qm_text out = {0};
    bool is_found = false;
    double deadline_ms;
    qm_layout_edit mirror = {0};
    if (!qm_handlers_read_deadline(request, &deadline_ms) || !qm_layout_image_read_plane(request, &mirror))
        return;
    if (qm_layout_session_open(request, &s, &problem)) {
        qm_http_watch watch;
        qm_http_watch_begin(&watch, request, deadline_ms, &s.ctx);
        qm_text_add_string(&out, "{");
        is_found = qm_layout_session_outcome(&s, find(&s, &mirror, &out), &problem);
        qm_text_add_string(&out, "}");
        is_found = qm_http_watch_end(&watch, &s.ctx, &problem) && is_found;
    }
    if (is_found) {
        qm_reply_text(request, 200, "application/json", qm_text_take(&out));
    } else {
        qm_text_reset(&out);
        qm_reply_problem(request, &problem);
    }
    qm_layout_session_close(&s);
}

static qm_status find_suggestions(qm_layout_session *s, const qm_layout_edit *mirror, qm_text *out)
{
    const qm_layout_features_options options = qm_layout_features_options_default();
    qm_layout_suggestions found = {0};
    qm_status status = QM_OK;
    if (mirror->has_mirror)
        status = qm_layout_suggest_images(&s->ctx, &s->layout, &s->source, mirror->mirror_point,
                                          mirror->mirror_normal, QM_IMAGE_SHARE * s->source.diagonal,
                                          MOST_SUGGESTIONS, &found);
    if (status == QM_OK && found.count == 0)
        status = qm_layout_suggest(&s->ctx, &s->layout, &s->source, &options, MOST_SUGGESTIONS, &found);
    if (status == QM_OK) qm_json_add_suggestions(out, &found);
    qm_layout_suggestions_reset(&s->ctx, &found);
    return status;
}

static qm_status find_symmetry(qm_layout_session *s, const qm_layout_edit *mirror, qm_text *out)
{
    (void)mirror;
    qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
    size_t count;
    qm_status status = qm_symmetry_find(&s->ctx, &s->source, QM_SYMMETRY_SHARE, plane, &count);
    if (status != QM_OK) return status;
    qm_json_open(out, "planes", "[");
    for (size_t i = 0; i < count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_numbers(out, "point", plane[i].point, 3);
        qm_json_add_numbers(out, "normal", plane[i].normal, 3);
        qm_json_open(out, "distance", "{");
        qm_json_add_number(out, "lower", plane[i].lower);
        qm_json_add_number(out, "upper", plane[i].upper);
        qm_text_add_string(out, "}}");
    }
    qm_text_add_string(out, "]");
    return QM_OK;
}

void qm_handle_layout_suggestions(qm_request *request)
{
    reply_found(request, find_suggestions);
}

void qm_handle_layout_symmetry(qm_request *request)
{
    reply_found(request, find_symmetry);
}
