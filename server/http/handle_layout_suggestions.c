/**
 * handle_layout_suggestions.c: curves that would bring a layout nearer to completion.
 */
#include "handlers.h"
#include "layout_session.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "qm/layout_suggest.h"

#define MOST_SUGGESTIONS 100

void qm_handle_layout_suggestions(qm_request *request)
{
    qm_layout_session s;
    qm_problem problem;
    qm_layout_suggestions found = {0};
    qm_http_watch watch;
    const qm_layout_features_options options = qm_layout_features_options_default();
    bool is_open = qm_layout_session_open(request, &s, &problem), is_found = false;
    if (is_open) {
        qm_http_watch_begin(&watch, request, 0.0, &s.ctx);
        qm_status status =
            qm_layout_suggest(&s.ctx, &s.layout, &s.source, &options, MOST_SUGGESTIONS, &found);
        is_found = qm_layout_session_outcome(&s, status, &problem);
        is_found = qm_http_watch_end(&watch, &s.ctx, &problem) && is_found;
    }
    if (is_found) {
        qm_text out = {0};
        qm_text_add_string(&out, "{");
        qm_json_add_suggestions(&out, &found);
        qm_text_add_string(&out, "}");
        qm_reply_text(request, 200, "application/json", qm_text_take(&out));
    } else {
        qm_reply_problem(request, &problem);
    }
    qm_layout_suggestions_reset(&s.ctx, &found);
    qm_layout_session_close(&s);
}
