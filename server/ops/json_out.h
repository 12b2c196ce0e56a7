/**
 * json_out.h: structs to JSON. Numbers have the shortest decimals that read back to the same double, in any locale;
 * times in milliseconds have three decimals. Numbers that are not finite become null.
 */
#ifndef QM_JSON_OUT_H
#define QM_JSON_OUT_H

#include "base/json.h"
#include "job_kinds.h"
#include "problem.h"

/** The members of the mesh resource that the mesh itself does not have. */
typedef struct qm_mesh_label {
    const char *id, *name;    /* id may be NULL (the command line has none): the member is then omitted */
    const char *content_hash; /* 64 hex digits, or NULL */
    uint64_t revision;
    const char *created; /* RFC 3339, or NULL */
} qm_mesh_label;

/** The mesh resource, one JSON object without a newline. */
void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh);

/** The problem document, and its members for a document with more of them. */
void qm_json_write_problem(qm_text *out, const qm_problem *problem);
void qm_json_add_problem(qm_text *out, const qm_problem *problem);

/** A request with all its fields in a fixed order: the body sent to a daemon, and the key of its cache. */
void qm_json_write_request(qm_text *out, const qm_job_request *request);

/** A request for lists of jobs: long arrays are replaced by their lengths. */
void qm_json_write_request_briefly(qm_text *out, const qm_job_request *request);

/** A projection as one object, after a comma unless it is the first; relative figures refer to diagonal, that of the
 * mesh. */
void qm_json_write_projection(qm_text *out, const qm_projections *projections, size_t i, double diagonal);

/** The result object of a job of any kind. */
void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result);

/** Adds the members lower and upper, and both as fractions of the diagonal, rounded outward. */
void qm_json_add_lower_upper(qm_text *out, double lower, double upper, double diagonal);

/** An interval as an object of those members. */
void qm_json_add_interval(qm_text *out, const char *name, qm_interval interval, double diagonal);

/** Adds an interval of what is no length, or has a sign: without relative bounds. */
void qm_json_add_range(qm_text *out, const char *name, qm_interval range);

/** A point of a surface: mesh is its name in the request, id that of the resource or "". */
void qm_json_add_surface_point(qm_text *out, const char *name, const char *mesh, const char *id,
                               uint32_t face, const qm_surface_point *point);

/** The times in which the two meshes were prepared. */
void qm_json_add_prepare_ms(qm_text *out, const qm_job_result *result);

/** Adds the members of a bounds event but for event and seq; relative figures refer to diagonal. */
void qm_json_add_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal);

/** Adds the members of the record of a step; relative figures refer to diagonal, that of the source. */
void qm_json_add_step(qm_text *out, const qm_refine_record *record, double diagonal);

/** Adds the member settled of what came of settling a mesh. */
void qm_json_add_settled(qm_text *out, const qm_settled *settled, double diagonal);

#endif
