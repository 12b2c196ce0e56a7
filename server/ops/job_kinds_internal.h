/**
 * job_kinds_internal.h: the hooks of a kind of job, and what several kinds share. A kind x has a row in
 * QM_JOB_MAP and a file that defines qm_job_kind_x (kind_distance.c is a short one).
 */
#ifndef QM_JOB_KINDS_INTERNAL_H
#define QM_JOB_KINDS_INTERNAL_H

#include <stddef.h>

#include "job_kinds.h"
#include "json_out.h"

struct cJSON;
struct qm_json_location;

/* ---- fields of requests ---- */

/** How the value of a field is read. */
typedef enum qm_field_type {
    QM_FIELD_ID,       /* char[QM_ID_SIZE] */
    QM_FIELD_MESH,     /* char[QM_JOB_MESH_SIZE], and the pose where the value is an object */
    QM_FIELD_POSITIVE, /* double above 0 */
    QM_FIELD_LIMIT,    /* double of 0 or more; null leaves the default */
    QM_FIELD_COUNT,    /* size_t from min to max */
    QM_FIELD_INTEGER,  /* int from min to max */
    QM_FIELD_FLAG,     /* bool */
    QM_FIELD_CHOICE,   /* an enum, by its place among the names */
    QM_FIELD_SWITCH,   /* bool, by the place among two names */
    QM_FIELD_OTHER     /* by a function of its own */
} qm_field_type;

/** A field of a request. A table of them ends with one without a name. */
typedef struct qm_job_field {
    const char *name;
    qm_field_type type;
    size_t offset; /* of the member of qm_job_request; not of OTHER */
    bool is_required,
        is_engine; /* is_engine: a member of `engine`; outside of it, where it was in the version before, as well */
    double min, max;          /* of COUNT and INTEGER */
    const char *const *names; /* of CHOICE and SWITCH, NULL-ended */
    int name_count;           /* of CHOICE: those after so many are former names of the first; 0: none is */
    bool (*read)(const struct cJSON *value, qm_job_request *out, struct qm_json_location *at); /* of OTHER */
    const char
        *expected; /* the text of the error, of ID and OTHER; else NULL: made of the type and its limits */
} qm_job_field;

#define QM_FIELD_AT(member) .offset = offsetof(qm_job_request, member)

/* Fields of several kinds. */
#define QM_JOB_FIELD_ID(name, member, text)                                                                  \
    {                                                                                                        \
        name, QM_FIELD_ID, QM_FIELD_AT(member), .is_required = true, .expected = text                        \
    }
#define QM_JOB_NAMES_MESH "must be the id of a mesh, or sha256: and the hash of its file in hex"
#define QM_JOB_FIELD_POSED(name, member)                                                                     \
    {                                                                                                        \
        name, QM_FIELD_MESH, QM_FIELD_AT(member),                                                            \
            .is_required = true,                                                                             \
            .expected = QM_JOB_NAMES_MESH ", or an object with \"mesh\" and \"transform\""                   \
    }
#define QM_JOB_FIELD_MESH QM_JOB_FIELD_POSED("mesh", a)
#define QM_JOB_FIELD_PAIR QM_JOB_FIELD_POSED("a", a), QM_JOB_FIELD_POSED("b", b)
#define QM_JOB_FIELD_QUADS                                                                                   \
    {                                                                                                        \
        "quads", QM_FIELD_CHOICE, QM_FIELD_AT(quads), .names = qm_quads_names                                \
    }
/** The width of an interval; tolerance is its name of the version before. */
#define QM_JOB_FIELDS_GAP                                                                                    \
    {"gap", QM_FIELD_POSITIVE, QM_FIELD_AT(tolerance)},                                                      \
        {"gap_unit", QM_FIELD_SWITCH, QM_FIELD_AT(tolerance_is_absolute), .names = qm_gap_unit_names},       \
        {"tolerance", QM_FIELD_POSITIVE, QM_FIELD_AT(tolerance)},                                            \
    {                                                                                                        \
        "tolerance_unit", QM_FIELD_SWITCH, QM_FIELD_AT(tolerance_is_absolute), .names = qm_gap_unit_names    \
    }
#define QM_JOB_FIELDS_AVERAGES                                                                               \
    {"accuracy", QM_FIELD_POSITIVE, QM_FIELD_AT(accuracy)}, QM_JOB_FIELD_PIECES,                             \
    {                                                                                                        \
        "percentiles", QM_FIELD_OTHER,                                                                       \
            .read = qm_averages_read_percentiles,                                                            \
            .expected = "must be an array of at most 64 numbers above 0 and at most 100"                     \
    }
#define QM_JOB_FIELD_PIECES                                                                                  \
    {                                                                                                        \
        "pieces", QM_FIELD_COUNT, QM_FIELD_AT(pieces), .is_engine = true, .max = QM_JOB_MAX_PIECES           \
    }
/** What a sign, bands and regions beyond a limit take. */
#define QM_JOB_FIELDS_SIDES                                                                                  \
    {"limit", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)}, {"regions", QM_FIELD_FLAG, QM_FIELD_AT(regions)},     \
        {"sign", QM_FIELD_CHOICE, QM_FIELD_AT(sign), .names = qm_sign_names},                                \
    {                                                                                                        \
        "bands", QM_FIELD_OTHER,                                                                             \
            .read = qm_sides_read_bands,                                                                     \
            .expected = "must be an array of at most 64 pairs of numbers, ascending; null is no limit"       \
    }
#define QM_JOB_FIELD_ACCELERATOR                                                                             \
    {                                                                                                        \
        "accelerator", QM_FIELD_CHOICE, QM_FIELD_AT(accelerator), .is_engine = true,                         \
                                                                  .names = qm_accelerator_names              \
    }
/** The accelerators of a kind that has one way to search: the first ones. */
#define QM_JOB_FIELD_BOXES                                                                                   \
    {                                                                                                        \
        "accelerator", QM_FIELD_CHOICE, QM_FIELD_AT(accelerator), .is_engine = true,                         \
                                                                  .names = qm_job_box_names                  \
    }
extern const char *const qm_job_box_names[];

/* ---- hooks ---- */

/** Copies the name of a mesh: its id, or the hash of its file after QM_JOB_HASH_PREFIX. False for other texts and NULL. */
bool qm_json_read_mesh_name(const char *text, char out[QM_JOB_MESH_SIZE]);

/** Reads such a name, or an object of a name and a transform. False with the location of the fault. */
bool qm_json_read_mesh(const struct cJSON *value, char name[QM_JOB_MESH_SIZE], qm_job_pose *pose,
                       struct qm_json_location *at);

/** Adds a mesh as a request names it, after the name of its member, or the comma of its array. */
void qm_json_add_mesh(qm_text *out, const char *name, const qm_job_pose *pose);

/** A request with its meshes and its context. */
typedef struct qm_job_call {
    qm_context *ctx;
    const qm_job_request *request;
    const qm_loaded_mesh *a, *b;
    qm_hausdorff_progress_fn *progress;
    void *progress_user;
    int threads;
} qm_job_call;

typedef struct qm_job_hooks {
    qm_job_type type;
    const qm_job_field *fields; /* besides those of all kinds */
    const qm_job_array *array;  /* NULL: its results have none */

    /** Reports members that do not go together, by qm_json_report; NULL: all do. */
    void (*check)(const qm_job_request *request, struct qm_problem *problem);

    /** Calls the engine and sets the result's members of this kind. */
    qm_status (*run)(const qm_job_call *call, qm_job_result *out);

    /** Adds the members of the request that only this kind has, in a fixed order; brief: without long arrays. */
    void (*write_request)(qm_text *out, const qm_job_request *request, bool is_brief);

    /** Adds the members of the result. */
    void (*write_result)(qm_text *out, const qm_job_request *request, const qm_job_result *result);

    /** The numbers of the array; of kinds that have one. */
    const double *(*find_array)(const qm_job_result *result, size_t *count);

    /** The mesh that was made, and its facts; NULL: the kind makes none. */
    const qm_mesh *(*find_mesh)(const qm_job_result *result, const qm_mesh_facts **facts);

    /** Frees the result's members of this kind; NULL: nothing is allocated. */
    void (*reset)(qm_context *ctx, qm_job_result *result);
} qm_job_hooks;

#define XX(suffix, name) extern const qm_job_hooks qm_job_kind_##name;
QM_JOB_MAP(XX)
#undef XX

const qm_job_hooks *qm_job_hooks_of(qm_job_kind kind);

/** The field of this name that a table has, or NULL. */
const qm_job_field *qm_job_find_field(const qm_job_field *fields, const char *name);

/* ---- what several kinds share ---- */

/** The tolerance in the unit of the meshes, whose diagonal is this, or A's. */
double qm_job_tolerance_of(const qm_job_request *request, double diagonal);
double qm_job_tolerance(const qm_job_call *call);

/** An interval of a distance between two meshes, widened to hold that of the true surfaces, rounded outward: by the
 * uncertainties a and b, the Hausdorff distance of each to its true surface at most, as all distances between sets change by no more. */
qm_interval qm_job_widen(qm_interval interval, double a, double b);

/** Adds the member of_true: an interval of a distance between the true surfaces, unless they are the meshes. */
void qm_job_add_of_true(qm_text *out, const qm_job_result *result, qm_interval interval);

/** Adds the members gap and gap_unit; and the object `engine` of what differs from the defaults in it, if anything does. */
void qm_job_add_gap(qm_text *out, const qm_job_request *request);
void qm_job_add_engine(qm_text *out, const qm_job_request *request);

/* Of kinds with averages over a surface (kind_averages.c). */
bool qm_averages_read_percentiles(const struct cJSON *value, qm_job_request *out,
                                  struct qm_json_location *at);
/** A greatest distance, also between the true surfaces; and a figure over the surface of a mesh, A's for side 0, which is also
 * one of the true surfaces when that mesh is exact: how near a mesh is to its true surface says nothing of where that has its
 * area. All that are added here differ by no more than the distances that they are over. */
void qm_averages_add_greatest(qm_text *out, const char *name, qm_interval interval,
                              const qm_job_result *result);
void qm_averages_add_figure(qm_text *out, const char *name, qm_interval interval, const qm_job_result *result,
                            int side);
void qm_averages_add_percentiles(qm_text *out, const double *percent, const qm_interval *percentile,
                                 size_t count, const qm_job_result *result, int side);
void qm_averages_add_measure(qm_text *out, const qm_deviation *deviation);

/* Of kinds with a sign, bands and regions (kind_sides.c). */
bool qm_sides_read_bands(const struct cJSON *value, qm_job_request *out, struct qm_json_location *at);
/** Reports members that do not go together. */
void qm_sides_check(const qm_job_request *request, qm_problem *problem);
void qm_sides_add_request(qm_text *out, const qm_job_request *request);
/** Sets *out to what is known of a mesh as a solid, kept in *solid, when the sign has to be proven; else to NULL, also when the call
 * is canceled: it has intervals all the same. */
qm_status qm_sides_find_solid(const qm_job_call *call, const qm_loaded_mesh *mesh, qm_solid *solid,
                              const qm_solid **out);
/** Sets the options of A's deviation from B that a deviation and a comparison share; *solid keeps what is known of B. */
qm_status qm_sides_set_options(const qm_job_call *call, qm_deviation_options *options, qm_solid *solid);
/** Faces of the input in place of those of the meshes as stored. */
void qm_sides_name_faces(qm_deviation *deviation, const qm_loaded_mesh *source, const qm_loaded_mesh *target);
/** Of a deviation from A, for side 0, or from B: the ends of a witness; the member signed; on which side of the limit the greatest
 * distance is, and the regions beyond it. */
void qm_sides_add_points(qm_text *out, const qm_job_request *request, int side, const qm_surface_point *from,
                         const qm_surface_point *to);
void qm_sides_add_signed(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                         const qm_deviation *deviation, int side);
void qm_sides_add_limit(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                        const qm_deviation *deviation, int side);

#endif
