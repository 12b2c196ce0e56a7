/**
 * json_object.h: the text of a request to the JSON tree of its object. For the files that read requests only.
 */
#ifndef QM_JSON_OBJECT_H
#define QM_JSON_OBJECT_H

#include "problem.h"

struct cJSON;

/** The object of a request, for cJSON_Delete; NULL with a problem (400), in which `what` names what it should
 * be ("a job"). */
struct cJSON *qm_json_parse_object(const char *text, size_t size, const char *what, qm_problem *problem);

#endif
