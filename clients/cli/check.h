/**
 * check.h: the stages of `quadmesh check`: the pairs (check_pairs.c), the answer to each (check_run.c) by jobs here or on a
 * daemon (check_ask.c), and what is written about them (check_report.c, for people check_page.c).
 */
#ifndef QM_CLI_CHECK_H
#define QM_CLI_CHECK_H

#include "cli.h"
#include "ops/json_checks.h"

/** Of a pair, and of all pairs together: the later one counts more. */
typedef enum cli_outcome { CLI_WITHIN, CLI_UNDECIDED, CLI_BEYOND, CLI_TROUBLE } cli_outcome;
extern const char *const cli_outcome_names[];

enum { CLI_DETAIL_SIZE = 512 };

/** The answer to one check. All is of the meshes as read, but for of_true. */
typedef struct cli_verdict {
    cli_outcome outcome;
    char detail[CLI_DETAIL_SIZE]; /* a sentence: the figures, or the reason */
    qm_interval distance; /* the Hausdorff distance as far as it was needed; upper is NAN where it was not */
    qm_interval of_true;  /* the same of the true surfaces; upper is NAN where they are the meshes */
    qm_interval inside,
        outside; /* the new mesh of the golden one, at most; upper is NAN where it was not asked for */
    qm_interval share[2]; /* of each surface within the limit; upper is NAN where it was not asked for */
    int collides, self_collides; /* -1: not asked */
    double elapsed_ms;
} cli_verdict;

/** How checks are run. */
typedef struct cli_check_settings {
    double gap;           /* of the diagonal: nearer to the limit than this a distance is undecided */
    int threads;          /* 0: the daemon chooses */
    cli_session *session; /* a daemon; NULL: in this process */
    bool aligns;          /* the new mesh is moved onto the golden one before */
    const char
        *pages; /* a folder for a report of each pair, or a file of HTML for the one pair; NULL: none */
} cli_check_settings;

/* ---- a pair and the jobs about it (check_ask.c) ---- */

/** Its caller sets the first three. */
typedef struct cli_checked_pair {
    const qm_check *check;
    const cli_check_settings *settings;
    size_t place; /* among all pairs */
    qm_context ctx;
    qm_loaded_mesh mesh[2]; /* in this process */
    bool is_loaded;
    char id[2][QM_ID_SIZE];        /* on a daemon */
    qm_job_pose pose;              /* of the new mesh */
    qm_notes notes[2];             /* as given, or else as the files have them */
    qm_problem told;               /* by the daemon */
    char problem[CLI_DETAIL_SIZE]; /* of the last failure, after the file */
} cli_checked_pair;

/** Loads or uploads both meshes, for cli_close_checked in any case. False with a problem in the pair. */
bool cli_open_checked(cli_checked_pair *pair);
void cli_close_checked(cli_checked_pair *pair);

/** A request of a kind with what the rule and the settings say. */
qm_job_request cli_checked_request(const cli_checked_pair *pair, qm_job_kind kind);

/** The result object of a job, about the new mesh alone where is_pair is false, for free(). NULL with a problem in the pair. */
char *cli_ask_checked(cli_checked_pair *pair, qm_job_request *request, bool is_pair);

/** Moves the new mesh, which lies as in its file; false with a problem in the pair. */
bool cli_move_checked(cli_checked_pair *pair, const double transform[QM_TRANSFORM_SIZE]);

/* ---- reports ---- */

/** Whether a path is that of a file of HTML, not of a folder. */
bool cli_is_page(const char *path);

/**
 * Writes the report of a pair as `quadmesh report` does: where the rule is of all of both surfaces, with its limit, else without a
 * verdict. False with a problem in the pair.
 */
bool cli_write_check_page(cli_checked_pair *pair);

/**
 * Lists the pairs of two files, of two folders by the names of the files in them, or of a manifest where the second
 * path is NULL. A file without a counterpart is a pair with one path. False after a report.
 */
bool cli_find_checks(const char *const path[2], const qm_check_rule *rule, qm_check_list *list);

/** Answers a check, and stops as soon as the answer is certain; place: of it among all. */
cli_verdict cli_run_check(const qm_check *check, size_t place, const cli_check_settings *settings);

/** Writes the verdicts as a document of JUnit; false with errno. */
bool cli_write_junit(const char *path, const qm_check_list *list, const cli_verdict *verdicts);

/** Prints a command of GitHub's workflows for each pair that is not within. */
void cli_print_github(FILE *file, const qm_check_list *list, const cli_verdict *verdicts);

/** Prints all verdicts as one JSON object. */
void cli_print_checks(const qm_check_list *list, const cli_verdict *verdicts);

/** The outcome of all pairs, and how many there are of each. */
cli_outcome cli_count_outcomes(const qm_check_list *list, const cli_verdict *verdicts, size_t count[4]);

#endif
