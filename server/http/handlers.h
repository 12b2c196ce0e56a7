/**
 * handlers.h: one function a route (route.c), one file a resource.
 */
#ifndef QM_HANDLERS_H
#define QM_HANDLERS_H

#include "http.h"

void qm_handle_mesh_create(qm_request *request);
void qm_handle_mesh_list(qm_request *request);
void qm_handle_mesh_get(qm_request *request);
void qm_handle_mesh_find(qm_request *request);
void qm_handle_mesh_patch(qm_request *request);
void qm_handle_mesh_copy(qm_request *request);
void qm_handle_mesh_delete(qm_request *request);

void qm_handle_mesh_content(qm_request *request);
void qm_handle_mesh_vertices(qm_request *request);
void qm_handle_mesh_patches(qm_request *request);
void qm_handle_mesh_quality(qm_request *request);
void qm_handle_mesh_deform(qm_request *request);
void qm_handle_mesh_project(qm_request *request);

void qm_handle_job_create(qm_request *request);
void qm_handle_job_list(qm_request *request);
void qm_handle_job_get(qm_request *request);
void qm_handle_job_patch(qm_request *request);
void qm_handle_job_delete(qm_request *request);
void qm_handle_job_events(qm_request *request);
void qm_handle_job_result(qm_request *request);
void qm_handle_job_report(qm_request *request);

/** Whether a layout is made, which takes seconds, and not given: by the names of its members, as only the lane depends on it. */
bool qm_handle_layout_computes(const qm_request *request);
void qm_handle_layout_create(qm_request *request);
void qm_handle_layout_list(qm_request *request);
void qm_handle_layout_get(qm_request *request);
void qm_handle_layout_delete(qm_request *request);
void qm_handle_layout_stroke(qm_request *request);
void qm_handle_layout_undo(qm_request *request);
void qm_handle_layout_redo(qm_request *request);
void qm_handle_curve_merge(qm_request *request);
void qm_handle_curve_split(qm_request *request);
void qm_handle_curve_snap(qm_request *request);
void qm_handle_curve_redraw(qm_request *request);
void qm_handle_curve_delete(qm_request *request);
void qm_handle_curve_slide(qm_request *request);
void qm_handle_chord_split(qm_request *request);
void qm_handle_node_merge(qm_request *request);
void qm_handle_node_move(qm_request *request);
void qm_handle_layout_ring(qm_request *request);
void qm_handle_layout_link(qm_request *request);
void qm_handle_layout_tube(qm_request *request);
void qm_handle_layout_fill(qm_request *request);
void qm_handle_layout_mirror(qm_request *request);
void qm_handle_layout_features(qm_request *request);
void qm_handle_layout_mark(qm_request *request);
void qm_handle_layout_suggestions(qm_request *request);
void qm_handle_layout_symmetry(qm_request *request);
void qm_handle_curve_add(qm_request *request);

void qm_handle_reconstruction_create(qm_request *request);
void qm_handle_reconstruction_list(qm_request *request);
void qm_handle_reconstruction_get(qm_request *request);
void qm_handle_reconstruction_edit(qm_request *request);
void qm_handle_reconstruction_delete(qm_request *request);
void qm_handle_reconstruction_mesh(qm_request *request);
void qm_handle_reconstruction_patches(qm_request *request);

void qm_handle_batch_create(qm_request *request);
void qm_handle_compare(qm_request *request);

void qm_handle_health(qm_request *request);
void qm_handle_ready(qm_request *request);
void qm_handle_metrics(qm_request *request);
void qm_handle_info(qm_request *request);
void qm_handle_openapi(qm_request *request);
void qm_handle_docs(qm_request *request);
void qm_handle_problem(qm_request *request);
void qm_handle_page(qm_request *request);

/** The row of the mesh that the path names, for qm_store_mesh_reset; false after a problem was the reply. */
bool qm_handlers_find_mesh(qm_request *request, qm_store_mesh *out);

/**
 * Gives the reply the entity tag of a mesh (content and revision) and compares it: false after a 304
 * (If-None-Match, on GET) or 412 (If-Match).
 */
bool qm_handlers_check_mesh_tag(qm_request *request, const qm_store_mesh *mesh);

/**
 * Takes a reference to the mesh in the path, to reply with a representation of the very revision that the
 * reply's tag names. suffix distinguishes the representations of a mesh in the tag. NULL after a reply: 304,
 * 404, 412, or what kept the mesh from being read.
 */
qm_mesh_ref *qm_handlers_take_mesh(qm_request *request, const char *suffix);

/** Reads the Idempotency-Key, NULL when there is none; false, and replied with a problem, when it cannot be
 * one. */
bool qm_handlers_read_idempotency_key(qm_request *request, const char **key);

/** Reads the key with the hash of the request, which distinguishes requests of one key. */
bool qm_handlers_read_idempotency(qm_request *request, qm_store_idempotency *out);

/** Whether a request has created something already. */
typedef enum qm_idempotency {
    QM_IDEMPOTENCY_NEW,    /* it has not, or has no key */
    QM_IDEMPOTENCY_MADE,   /* it has created the resource of this id */
    QM_IDEMPOTENCY_REFUSED /* replied with a problem: the key belongs to another request */
} qm_idempotency;
typedef qm_stored qm_find_idempotency_record(qm_store *store, const char *key,
                                             qm_store_idempotency_record *out);
qm_idempotency qm_handlers_check_idempotency(qm_request *request, const qm_store_idempotency *idempotency,
                                             qm_find_idempotency_record *find, char id[QM_ID_SIZE]);

/** Reads ?format=, QM_FORMAT_UNKNOWN when it is not given; replies with a problem and returns false when it names
 * none. */
bool qm_handlers_read_format(qm_request *request, qm_format *out);

/** Ends a page of a list: closes its array and adds the cursor of the next page; 0 after the last one. */
void qm_handlers_end_page(qm_text *out, int64_t next);

/** Reads ?limit=, ?cursor= and ?order=; replies with a problem and returns false when they are not valid. */
bool qm_handlers_read_paging(qm_request *request, qm_store_page *out);

/** Reads `deadline_ms` of the query, 0 if it is absent. False after a reply. */
bool qm_handlers_read_deadline(qm_request *request, double *deadline_ms);

#endif
