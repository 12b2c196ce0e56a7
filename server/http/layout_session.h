/**
 * layout_session.h: one edit of a layout, from its row in the store to the reply.
 */
#ifndef QM_LAYOUT_SESSION_H
#define QM_LAYOUT_SESSION_H

#include "base/text.h"
#include "http.h"
#include "mesh/meshes.h"
#include "ops/problem.h"
#include "qm/layout.h"
#include "store/store.h"

/**
 * The state of one edit of a layout, between its row in the store and the reply. An edit reads the current revision, changes a
 * copy, finds the patches again and stores the copy as the next revision; an edit that lost a race against another one is a
 * conflict (409).
 *
 * before is the layout as it was opened. qm_layout_session_close frees all members, also after a failure.
 */
typedef struct qm_layout_session {
    qm_app *app;
    qm_context ctx;
    qm_store_layout row;
    qm_layout before, layout;
    qm_layout_issues issues;
    qm_mesh_ref *mesh;
    qm_ref_surface source;
} qm_layout_session;

/** An empty session, for a new layout. */
qm_layout_session qm_layout_session_make(qm_app *app);
void qm_layout_session_close(qm_layout_session *s);

/** Opens a session on the layout that the path names. False with a problem; qm_layout_session_close is due in either case. */
bool qm_layout_session_open(qm_request *request, qm_layout_session *s, qm_problem *problem);

/** Acquires the mesh that the row names, and its surface. False with a problem. */
bool qm_layout_session_take_mesh(qm_layout_session *s, qm_problem *problem);

/** The row of the layout that the path names. False with a problem. */
bool qm_layout_session_find(qm_request *request, qm_store_layout *out, qm_problem *problem);

/** Makes the problem of a status of the engine; returns false. */
bool qm_layout_session_fail(const qm_layout_session *s, qm_status status, qm_problem *problem);

/** True if the status is QM_OK. An argument that the engine rejects is a fault of the request. */
bool qm_layout_session_outcome(qm_layout_session *s, qm_status status, qm_problem *problem);

/** The layout and its issues as JSON, for the caller to free also after a failure. False: out of memory. */
bool qm_layout_session_write(const qm_layout_session *s, char **layout, char **issues);

/** Adds the members of a layout; without its curves when brief. */
void qm_layout_session_describe(qm_text *out, const qm_store_layout *row, bool is_brief);

/** Replies with a layout and what an edit changed, which may be NULL. */
void qm_layout_session_reply(qm_request *request, int status, const qm_store_layout *row,
                             const char *changed);

/** Finds the patches and issues of the edited layout. False with a problem. */
bool qm_layout_session_find_patches(qm_layout_session *s, qm_problem *problem);

/** Stores the edited layout as the next revision and replies with it; more has members that the edit adds. */
void qm_layout_session_finish(qm_request *request, qm_layout_session *s, const char *more);

#endif
