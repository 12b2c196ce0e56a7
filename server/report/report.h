/**
 * report.h: a comparison of two meshes as one file of HTML that needs nothing beside itself: no script, no request, its
 * pictures and charts within it. The daemon and the command line write it; both have the same result object.
 *
 * A report is a view of a result: every interval in it is one of the result's, rounded outward to as many digits as its
 * width leaves certain, with all digits in data-lower and data-upper. Pictures show distances at the middle of their
 * pixels, found anew; no word in the report rests on them.
 */
#ifndef QM_REPORT_H
#define QM_REPORT_H

#include "base/json.h"
#include "base/notes.h"
#include "ops/mesh_load.h"
#include "ops/problem.h"
#include "qm/transform.h"

typedef struct qm_report_mesh {
    const char *name; /* of the file; NULL: none */
    const char *hash; /* SHA-256 of the file in hex; NULL: not known */
    qm_notes notes;
    const double *transform;      /* that has moved the mesh (qm/transform.h); NULL: it lies as in its file */
    const qm_loaded_mesh *loaded; /* with a tree that is a target, of patches too if quads are read so */
} qm_report_mesh;

/** The permitted distances, 0 or more; NAN: no limit. Without any there is no verdict. */
typedef struct qm_report_limits {
    double distance;        /* of both meshes from one another */
    double inside, outside; /* how far A may be inside and outside of B: signed distances of A are needed */
} qm_report_limits;

typedef struct qm_report {
    qm_report_mesh mesh[2];
    const char *result;  /* the result object of a comparison; with the regions that it may have */
    const char *request; /* the request object that was asked */
    const char *command; /* the command line; NULL: none */
    const char *made;    /* when, RFC 3339 */
    qm_report_limits limits;
    double region_limit; /* what the regions of the result are beyond, if it has any */
    double range;        /* the end of the colour scale, above 0; NAN: chosen (scale.h) */
    int thread_count;
} qm_report;

/** What proven intervals of greatest distances say of the limits. */
typedef enum qm_report_verdict {
    QM_REPORT_NO_LIMIT,
    QM_REPORT_WITHIN,   /* no point is farther */
    QM_REPORT_BEYOND,   /* a point is farther */
    QM_REPORT_UNDECIDED /* a limit lies inside its interval, or the interval is not known */
} qm_report_verdict;

/** The verdict on a result object of a comparison: beyond, if a point is beyond any of the limits. */
qm_report_verdict qm_report_judge(const qm_json *result, const qm_report_limits *limits);

/** Appends the document. False with a problem: memory, a canceled context, no library for pictures. */
bool qm_report_write(qm_context *ctx, const qm_report *report, qm_text *out, qm_problem *problem);

/** The limits to ask a comparison for so that the report has a histogram in the bands of its colours: the edges of the
 * scale for a limit and a range as above. None without either, as the scale then follows from the result. Writes at most
 * QM_REPORT_MAX_LIMITS numbers, and returns how many. */
#define QM_REPORT_MAX_LIMITS 16
int qm_report_scale_limits(double limit, double range, double *out);

#endif
