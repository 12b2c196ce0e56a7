/**
 * route.h: the table of routes.
 */
#ifndef QM_ROUTE_H
#define QM_ROUTE_H

#include "http.h"

/** How a body is received. A file is spooled as it comes, also with Content-Encoding: gzip, which others may not have. */
typedef enum qm_body { QM_BODY_NONE, QM_BODY_MEMORY, QM_BODY_SPOOL, QM_BODY_FILE } qm_body;

typedef struct qm_route {
    const char *method;
    const char *path; /* {id}, {hash}, and a second name in braces, stand for letters, digits and _.- within a
                         segment, as many as an id or a hash has; {path} for several segments */
    qm_scope scope;   /* of the token that it needs, when the daemon has tokens */
    void (*handle)(qm_request *request);
    const char *const *produces; /* media types to choose from by Accept, NULL-ended; NULL: not negotiated */
    qm_body body;
    qm_lane lane;
    const char *const *query; /* parameters that it has, NULL-ended; NULL: any, none is read */
} qm_route;

/**
 * The route of a method and path; writes what stands for {id}, {hash} or {path} and for a second name in braces, ""
 * where there is none. NULL with a problem: 404, or 405 with the methods that the path has. HEAD goes with
 * GET.
 */
const qm_route *qm_route_find(const char *method, const char *path, char ids[2][QM_HASH_SIZE],
                              qm_problem *problem);

/** Prints a line for each route: method, path, the media types to choose from, ?parameters. */
void qm_route_print_all(void);

#endif
