/**
 * json_out.h: structs to JSON. Numbers are printed with the fewest digits that read back to the same double,
 * in any locale; what is not finite becomes null.
 */
#ifndef QM_JSON_OUT_H
#define QM_JSON_OUT_H

#include "base/json_write.h"
#include "job_kinds.h"
#include "problem.h"

/** What the mesh resource shows besides the mesh itself. */
typedef struct qm_mesh_label {
    const char *id, *name;    /* id may be NULL: the member is then left out, as the command line does */
    const char *content_hash; /* 64 hex digits, or NULL */
    uint64_t revision;
    const char *created; /* RFC 3339, or NULL */
} qm_mesh_label;

/** The mesh resource of the contract, one JSON object without a line end. */
void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh);

/** The problem document. */
void qm_json_write_problem(qm_text *out, const qm_problem *problem);

/** A request with all its fields in a fixed order: what is asked of a daemon, and the key of the cache. */
void qm_json_write_request(qm_text *out, const qm_job_request *request);

/** The same for people and lists: of long arrays only how many entries they have. */
void qm_json_write_request_briefly(qm_text *out, const qm_job_request *request);

/** A foot as one object, after a comma where one is due; diagonal, that of the mesh, makes the relative
 * figure. */
void qm_json_write_foot(qm_text *out, const qm_projections *feet, size_t i, double diagonal);

/** The result object of a job of any kind. */
void qm_json_write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result);

/** The members of a bounds event as one object, without event and seq; diagonal makes the relative
 * figures. */
void qm_json_write_bounds(qm_text *out, const qm_hausdorff_progress *progress, double diagonal);

#endif
