/**
 * route.h: the table of what the daemon answers.
 */
#ifndef QM_ROUTE_H
#define QM_ROUTE_H

#include "http.h"

typedef enum qm_body { QM_BODY_NONE, QM_BODY_MEMORY, QM_BODY_SPOOL } qm_body;

typedef struct qm_route {
    const char *method;
    const char *path; /* {id} stands for one segment of letters, digits and _ */
    void (*handle)(qm_request *request);
    const char *type; /* of the answer: clients that do not take it get 406; NULL: the handler looks */
    qm_body body;
    bool waits; /* may wait for disk or decode: runs on the pool, not on a thread of the connections */
} qm_route;

/**
 * The route of a method and path; writes what stands for {id}. NULL with a problem: 404, or 405 with the
 * methods that the path has. HEAD goes with GET.
 */
const qm_route *qm_route_find(const char *method, const char *path, char id[QM_ID_SIZE], qm_problem *problem);

#endif
