/**
 * json_checks.h: pairs of mesh files with what is expected of them, and the manifest that lists such pairs.
 *
 *     {"limit": 0.05, "checks": [{"new": "build/a.stl", "golden": "golden/a.stl"},
 *                                {"name": "lid", "new": "build/b.stl", "golden": "golden/b.stl", "percent": 99}]}
 *
 * What stands beside "checks" holds for all of them unless one says otherwise.
 */
#ifndef QM_JSON_CHECKS_H
#define QM_JSON_CHECKS_H

#include "job_kinds.h"

/** Whether surfaces should meet. */
typedef enum qm_check_meeting {
    QM_CHECK_MAY_MEET,
    QM_CHECK_MUST_NOT_MEET,
    QM_CHECK_MUST_MEET
} qm_check_meeting;
extern const char *const qm_check_meeting_names[]; /* NULL-ended */

/** What is expected of a pair. */
typedef struct qm_check_rule {
    double limit; /* permitted distance, unit of the meshes; NAN: none */
    double limit_in,
        limit_out;  /* permitted distance of the new mesh inside and outside of the golden one; NAN: none */
    double percent; /* of each surface that must be within it; 100: all */
    qm_direction direction;
    qm_quad_reading quads;
    qm_check_meeting collides;      /* the pair */
    qm_check_meeting self_collides; /* the new mesh with itself */
    qm_job_pose pose;               /* of the new mesh */
    qm_notes notes[2]; /* of the new mesh, and of the golden one; what is unset is as their files say */
} qm_check_rule;

/** Whether a rule asks for anything, and for anything that needs the sides of the golden mesh. */
bool qm_check_rule_asks(const qm_check_rule *rule);
bool qm_check_rule_is_signed(const qm_check_rule *rule);

/** No limit, all of both surfaces, triangles, and anything may meet. */
qm_check_rule qm_check_rule_default(void);

/** A pair; its strings are malloc'ed. A path may be NULL where a file is missing. */
typedef struct qm_check {
    char *name, *path[2]; /* the new mesh, and the golden one that it is held against */
    qm_check_rule rule;
} qm_check;

/** All zero is an empty list. */
typedef struct qm_check_list {
    qm_check *checks;
    size_t count, capacity;
} qm_check_list;

/** Adds a pair, with copies of the strings; false when memory runs out. */
bool qm_check_list_add(qm_check_list *list, const char *name, const char *new_path, const char *golden_path,
                       const qm_check_rule *rule);

void qm_check_list_reset(qm_check_list *list);

/**
 * Reads a manifest and adds its pairs.
 *
 * folder  precedes relative paths; "" or one that ends in a slash
 * rule    of what the manifest leaves open
 *
 * Returns false with a problem, which names the place; the list is then as it was, or longer.
 */
bool qm_checks_read(const char *text, size_t size, const char *folder, const qm_check_rule *rule,
                    qm_check_list *list, qm_problem *problem);

#endif
