#include "json_object.h"

#include <cjson/cJSON.h>
#include <string.h>

#include "base/json_check.h"
#include "base/json_parse.h"

static qm_problem malformed_at(size_t place, const char *words)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "%s at byte %zu", words, place);
    qm_problem_add_offset(&problem, place, words);
    return problem;
}

/** Parses the whole text; NULL with a problem when it is not one JSON value. */
static cJSON *parse(const char *text, size_t size, qm_problem *problem)
{
    const char *end;
    bool no_memory;
    cJSON *tree = qm_json_parse_tree(text, size, &end, &no_memory);
    const char *rest = end;
    while (tree && rest < text + size && *rest && strchr(" \t\r\n", *rest))
        rest++;
    if (tree && rest == text + size) return tree;
    if (no_memory)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory to read the JSON");
    else
        *problem = malformed_at((size_t)((tree ? rest : end) - text), "the JSON cannot be read");
    cJSON_Delete(tree);
    return NULL;
}

cJSON *qm_json_parse_object(const char *text, size_t size, const char *what, qm_problem *problem)
{
    *problem = (qm_problem){0};
    size_t place;
    const char *words;
    if (size == 0) {
        *problem = qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "the body is empty; %s is a JSON object", what);
        qm_problem_add_offset(problem, 0, "nothing is here");
        return NULL;
    }
    if (!qm_json_check_text(text, size, &place, &words)) {
        *problem = malformed_at(place, words);
        return NULL;
    }
    cJSON *tree = parse(text, size, problem);
    if (!tree || cJSON_IsObject(tree)) return tree;
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s is a JSON object", what);
    qm_problem_add_pointer(problem, "", "must be an object");
    cJSON_Delete(tree);
    return NULL;
}
