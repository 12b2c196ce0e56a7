/**
 * json_layout.h: layouts and their edits as JSON.
 */
#ifndef QM_JSON_LAYOUT_H
#define QM_JSON_LAYOUT_H

#include "base/id.h"
#include "base/text.h"
#include "problem.h"
#include "qm/layout_edit.h"
#include "qm/layout_suggest.h"
#include "qm/pick.h"
#include "qm/reconstruct.h"
#include "symmetric_layout.h"

struct cJSON;

/**
 * Reads {nodes, corners, curves, patches}, each of which is optional: patches name curves by id; *has_patches is false if the
 * member is absent. mesh receives the id in the member "mesh", which is then required; NULL for a file that holds a
 * layout alone. features receives what the member "features" says, its angle 0 if that is absent; NULL with mesh. Curves keep
 * their ids.
 *
 * Returns true, and *out is the caller's for qm_layout_reset with ctx; or false with a problem (400 that points to the
 * fault, 422 for an invalid layout, 507).
 */
bool qm_json_read_layout(qm_context *ctx, const char *text, size_t size, char mesh[QM_ID_SIZE],
                         qm_layout_features_options *features, qm_layout *out, bool *has_patches,
                         qm_problem *problem);

/** What the request of POST /v1/layouts makes the layout of. */
typedef enum qm_layout_source {
    QM_LAYOUT_GIVEN,   /* nodes, curves and patches, see qm_json_read_layout */
    QM_LAYOUT_QUADS,   /* the quads of a mesh */
    QM_LAYOUT_SURFACE, /* quads that are made of the surface first */
} qm_layout_source;

/** The request of POST /v1/layouts for a layout that is made. */
typedef struct qm_json_quad_layout {
    qm_layout_source source;
    char mesh[QM_ID_SIZE];
    char quads[QM_ID_SIZE];      /* of QM_LAYOUT_QUADS */
    qm_quads_options make_quads; /* of QM_LAYOUT_SURFACE */
    qm_quad_layout_options options;
    qm_symmetry_wish symmetry; /* of QM_LAYOUT_SURFACE */
    double deadline_ms;        /* from the start of the request on; 0: none */
} qm_json_quad_layout;

/**
 * Reads {mesh, quads, patches, features, deadline_ms} or {mesh, auto, quad_count, patches, features, symmetry, deadline_ms}, where
 * crease_angle may stand for features. A request with neither quads nor auto gives a layout, and has no problem here.
 *
 * False with a problem (400).
 */
bool qm_json_read_quad_layout(const char *text, size_t size, qm_json_quad_layout *out, qm_problem *problem);

/** Reads the name of a curve's mark. False for another value. */
bool qm_json_read_mark(const struct cJSON *value, qm_curve_mark *out);

/** Reads the members of a search for features, all of which may be absent; name is that of the member that the object is, or "".
 * False with a problem. */
bool qm_json_read_features(const struct cJSON *object, const char *name, qm_layout_features_options *out,
                           qm_problem *problem);

/** Adds the members nodes, corners, curves and patches. */
void qm_json_add_layout(qm_text *out, const qm_layout *layout);

/** Adds the member issues: why the layout is incomplete, each with a message. */
void qm_json_add_layout_issues(qm_text *out, const qm_layout_issues *issues);

/** Adds the member suggestions, each with a reason. */
void qm_json_add_suggestions(qm_text *out, const qm_layout_suggestions *suggestions);

/** What a reconstruction's warning says, and the word that names it. */
#define QM_WARNING_TEXT 200
const char *qm_json_warning_name(qm_reconstruction_warning_kind kind);
void qm_json_warning_text(const qm_reconstruction_warning *warning, char out[QM_WARNING_TEXT]);

/** Adds the member warnings of a reconstruction: the first hundred, each with its kind and detail. */
void qm_json_add_warnings(qm_text *out, const qm_reconstruction *reconstruction);

/** What a layout's issue says. */
#define QM_ISSUE_TEXT 160
void qm_layout_issue_text(const qm_layout_issue *issue, char out[QM_ISSUE_TEXT]);

/** The edits. */
typedef enum qm_layout_edit_kind {
    QM_EDIT_STROKE,
    QM_EDIT_SPLIT,
    QM_EDIT_SNAP,
    QM_EDIT_REDRAW,
    QM_EDIT_CURVES, /* two of them: to merge, to join by a tube */
    QM_EDIT_NODES,  /* two of them: to merge, to link */
    QM_EDIT_RING,
    QM_EDIT_FILL,
    QM_EDIT_MIRROR,
    QM_EDIT_MOVE,
    QM_EDIT_SLIDE,
    QM_EDIT_SPLIT_CHORD,
    QM_EDIT_FEATURES,
    QM_EDIT_MARKS,
    QM_EDIT_CURVE,
    QM_EDIT_DELETE /* a query instead of a body */
} qm_layout_edit_kind;

/** An edit; the fields of other kinds are zero. */
typedef struct qm_layout_edit {
    double *points; /* x y in the window, or x y z, of each point; malloc'ed */
    size_t point_count;
    bool
        in_window; /* always of a stroke and a ring, optional of a redraw, move, slide: points are picked with camera
                       and pick */
    qm_camera camera;
    qm_pick_options pick;
    double radius;    /* the distance at which ends snap; 0 if absent */
    double point[3];  /* split, snap, fill, move, mirror */
    bool has_point;   /* fill */
    double normal[3]; /* mirror */
    bool has_mirror;  /* the edit is made on both sides of a plane */
    double mirror_point[3], mirror_normal[3];
    double from[3];         /* slide: the place that is held; point is where it goes */
    int end;                /* snap: 0 from, 1 to */
    uint32_t first, second; /* merge */
    uint32_t parts;         /* split of a chord */
    qm_layout_features_options
        features; /* of features; of a stroke angle and radius, the reach, where has_features */
    bool has_features;
    uint32_t *curves, *nodes; /* marks: malloc'ed, NULL for none */
    size_t curve_count, node_count;
    qm_curve_mark mark; /* of the curves, or of a curve that is added */
    bool is_corner;     /* of the nodes */
} qm_layout_edit;

/** False with a problem (400, 507); else *out is the caller's, for qm_layout_edit_reset. */
bool qm_json_read_layout_edit(const char *text, size_t size, qm_layout_edit_kind kind, qm_layout_edit *out,
                              qm_problem *problem);
void qm_layout_edit_reset(qm_layout_edit *edit);

/** Reads a plane: six numbers between commas, its point and its normal, which is not 0. False for another text. */
bool qm_json_read_plane_text(const char *text, double point[3], double normal[3]);

/** The request of POST /v1/reconstructions. */
typedef struct qm_json_reconstruction {
    char layout[QM_ID_SIZE];
    char source[QM_ID_SIZE]; /* "" for the mesh of the layout */
    qm_reconstruction_options options;
    double deadline_ms; /* 0: none */
} qm_json_reconstruction;

/** False with a problem (400). */
bool qm_json_read_reconstruction(const char *text, size_t size, qm_json_reconstruction *out,
                                 qm_problem *problem);

/** Reads {layout}, the body of PUT /v1/reconstructions/{id}/layout. */
bool qm_json_read_layout_choice(const char *text, size_t size, qm_json_reconstruction *out,
                                qm_problem *problem);

#endif
