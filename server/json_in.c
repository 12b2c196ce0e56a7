#include "json_in.h"

#include <cjson/cJSON.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_object.h"
#include "json_write.h"

#define MAX_THREADS 256
#define MAX_PIECES 1e7
#define MAX_STEPS 64
#define MAX_BINS 1e4
#define MAX_LISTED 1e5
#define POINTER_SIZE sizeof(((qm_problem_error *)NULL)->pointer)

/** Where in an array a value is at fault: the places of its entries from the outside in. */
typedef struct fault {
    int depth;
    size_t index[2];
    bool no_memory; /* nothing is wrong but that */
} fault;

/** One field of a job: reads the value, or says what it should be and where in it the fault lies. */
typedef struct field {
    const char *name;
    unsigned kinds, required; /* a bit for each kind that has it, and that must have it */
    bool (*read)(const cJSON *value, qm_job_request *out);
    bool (*read_list)(const cJSON *value, qm_job_request *out, fault *at); /* for arrays, in place of read */
    const char *expected;
} field;

static bool read_string(const cJSON *value, const char **out)
{
    *out = cJSON_GetStringValue(value);
    return *out != NULL;
}

static bool read_number(const cJSON *value, double *out)
{
    *out = cJSON_GetNumberValue(value);
    return cJSON_IsNumber(value) && isfinite(*out);
}

static bool read_id(const cJSON *value, char out[QM_ID_SIZE])
{
    const char *id;
    if (!read_string(value, &id) || !id[0] || strlen(id) >= QM_ID_SIZE) return false;
    strcpy(out, id);
    return true;
}

/** The place of a name in a NULL-ended list, or -1. */
static int find_name(const cJSON *value, const char *const *names)
{
    const char *given;
    if (!read_string(value, &given)) return -1;
    for (int i = 0; names[i]; i++)
        if (strcmp(given, names[i]) == 0) return i;
    return -1;
}

#define XX(suffix, name, first, second) " \"" #name "\""
#define TYPE_NAMES QM_JOB_MAP(XX)

static bool read_type(const cJSON *value, qm_job_request *out)
{
    const char *given;
    return read_string(value, &given) && qm_job_kind_find(given, &out->kind);
}

static bool read_a(const cJSON *value, qm_job_request *out)
{
    return read_id(value, out->a);
}

static bool read_b(const cJSON *value, qm_job_request *out)
{
    return read_id(value, out->b);
}

static bool read_direction(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"two_sided", "a_to_b", "b_to_a", NULL};
    static const qm_direction directions[] = {QM_TWO_SIDED, QM_A_TO_B, QM_B_TO_A};
    int place = find_name(value, names);
    if (place >= 0) out->direction = directions[place];
    return place >= 0;
}

static bool read_quads(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"triangles", "bilinear", NULL};
    int place = find_name(value, names);
    if (place >= 0) out->quads = place == 1 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
    return place >= 0;
}

static bool read_tolerance(const cJSON *value, qm_job_request *out)
{
    return read_number(value, &out->tolerance) && out->tolerance > 0.0;
}

static bool read_tolerance_unit(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"relative", "absolute", NULL};
    int place = find_name(value, names);
    out->tolerance_is_absolute = place == 1;
    return place >= 0;
}

static bool read_threshold(const cJSON *value, qm_job_request *out)
{
    if (cJSON_IsNull(value)) return true;
    return read_number(value, &out->threshold) && out->threshold >= 0.0;
}

static bool read_deadline(const cJSON *value, qm_job_request *out)
{
    return read_number(value, &out->deadline_ms) && out->deadline_ms > 0.0;
}

static bool read_whole(const cJSON *value, double least, double greatest, double *out)
{
    return read_number(value, out) && *out >= least && *out <= greatest && *out == floor(*out);
}

static bool read_threads(const cJSON *value, qm_job_request *out)
{
    double threads;
    if (!read_whole(value, 1, MAX_THREADS, &threads)) return false;
    out->threads = (int)threads;
    return true;
}

static bool read_accuracy(const cJSON *value, qm_job_request *out)
{
    return read_number(value, &out->accuracy) && out->accuracy > 0.0;
}

static bool read_pieces(const cJSON *value, qm_job_request *out)
{
    double pieces;
    if (!read_whole(value, 0, MAX_PIECES, &pieces)) return false;
    out->pieces = (size_t)pieces;
    return true;
}

static bool read_steps(const cJSON *value, qm_job_request *out)
{
    double steps;
    if (!read_whole(value, 1, MAX_STEPS, &steps)) return false;
    out->goal.steps = (size_t)steps;
    return true;
}

static bool read_until(const cJSON *value, qm_job_request *out)
{
    if (!cJSON_IsObject(value)) return false;
    for (const cJSON *member = value->child; member; member = member->next) {
        double quads;
        bool good = false;
        if (strcmp(member->string, "hausdorff_relative") == 0) {
            good = read_number(member, &out->hausdorff_relative) && out->hausdorff_relative > 0.0;
        } else if (strcmp(member->string, "edge_length") == 0) {
            good = read_number(member, &out->goal.edge) && out->goal.edge > 0.0;
        } else if (strcmp(member->string, "max_quads") == 0) {
            good = read_whole(member, 1, QM_REFINE_MOST_QUADS, &quads);
            if (good) out->goal.max_quads = (size_t)quads;
        }
        if (!good) return false;
    }
    return true;
}

static bool read_measure(const cJSON *value, qm_job_request *out)
{
    out->goal.measures = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_bins(const cJSON *value, qm_job_request *out)
{
    double bins;
    if (!read_whole(value, 0, MAX_BINS, &bins)) return false;
    out->bins = (size_t)bins;
    return true;
}

static bool read_percentiles(const cJSON *value, qm_job_request *out, fault *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_PERCENTILES) return false;
    out->percentile_count = 0;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double *percentile = &out->percentiles[out->percentile_count];
        if (!read_number(number, percentile) || !(*percentile > 0.0 && *percentile <= 100.0)) return false;
        out->percentile_count++;
    }
    return true;
}

static bool read_mode(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"all", "first", "any", NULL};
    static const qm_collide_mode modes[] = {QM_COLLIDE_ALL, QM_COLLIDE_FIRST, QM_COLLIDE_ANY};
    int place = find_name(value, names);
    if (place >= 0) out->mode = modes[place];
    return place >= 0;
}

static bool read_limit(const cJSON *value, qm_job_request *out)
{
    double limit;
    if (!read_whole(value, 0, MAX_LISTED, &limit)) return false;
    out->list_limit = (size_t)limit;
    return true;
}

static bool read_incremental(const cJSON *value, qm_job_request *out)
{
    out->incremental = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_detach(const cJSON *value, qm_job_request *out)
{
    out->detach = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_accelerator(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"auto", "boxes", "tetra", "grid", NULL}; /* as in qm_accelerator */
    int place = find_name(value, names);
    if (place >= 0) out->accelerator = (qm_accelerator)place;
    return place >= 0;
}

/** For a kind that has one way to search. */
static bool read_boxes(const cJSON *value, qm_job_request *out)
{
    return read_accelerator(value, out) && out->accelerator <= QM_ACCELERATOR_BOXES;
}

static bool read_bounds(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"cells", "matching", NULL};
    int place = find_name(value, names);
    out->bounds = place == 1 ? QM_BOUNDS_MATCHING : QM_BOUNDS_CELLS;
    return place >= 0;
}

/** Rows of three numbers, on the heap. */
static bool read_rows(const cJSON *value, double **rows, size_t *row_count, fault *at)
{
    if (!cJSON_IsArray(value)) return false;
    size_t count = (size_t)cJSON_GetArraySize(value);
    if (count == 0) return true;
    *rows = malloc(count * 3 * sizeof **rows);
    if (!*rows) {
        at->no_memory = true;
        return false;
    }
    for (const cJSON *row = value->child; row; row = row->next) {
        *at = (fault){.depth = 1, .index = {*row_count}};
        if (!cJSON_IsArray(row) || cJSON_GetArraySize(row) != 3) return false;
        at->depth = 2;
        for (const cJSON *number = row->child; number; number = number->next, at->index[1]++)
            if (!read_number(number, &(*rows)[3 * *row_count + at->index[1]])) return false;
        ++*row_count;
    }
    return true;
}

static bool read_points(const cJSON *value, qm_job_request *out, fault *at)
{
    return read_rows(value, &out->points, &out->point_count, at);
}

enum {
    ALL = (1u << QM_JOB_KIND_COUNT) - 1,
    HAUSDORFF = 1u << QM_JOB_HAUSDORFF,
    PROJECT = 1u << QM_JOB_PROJECT,
    DEVIATION = 1u << QM_JOB_DEVIATION,
    COLLISION = 1u << QM_JOB_COLLISION,
    SELF = 1u << QM_JOB_SELF_COLLISION,
    PAIRS = HAUSDORFF | DEVIATION | 1u << QM_JOB_DISTANCE | COLLISION,
    SINGLE = PROJECT | SELF,
    STEP = 1u << QM_JOB_RECONSTRUCTION_STEP
};

static const field fields[] = {
    {"type", ALL, ALL, read_type, NULL, "must be one of" TYPE_NAMES},
    {"a", PAIRS, PAIRS, read_a, NULL, "must be the id of a mesh"},
    {"b", PAIRS, PAIRS, read_b, NULL, "must be the id of a mesh"},
    {"mesh", SINGLE, SINGLE, read_a, NULL, "must be the id of a mesh"},
    {"points", PROJECT, PROJECT, NULL, read_points, "must hold points, each of three finite numbers"},
    {"direction", HAUSDORFF, 0, read_direction, NULL, "must be \"two_sided\", \"a_to_b\" or \"b_to_a\""},
    {"reconstruction", STEP, STEP, read_a, NULL, "must be the id of a reconstruction"},
    {"steps", STEP, 0, read_steps, NULL, "must be a whole number from 1 to 64"},
    {"until", STEP, 0, read_until, NULL,
     "must be an object with hausdorff_relative, max_quads, edge_length, or some of them, each above 0"},
    {"measure", STEP, 0, read_measure, NULL, "must be true or false"},
    {"quads", ALL & ~STEP, 0, read_quads, NULL, "must be \"triangles\" or \"bilinear\""},
    {"tolerance", PAIRS | SELF, 0, read_tolerance, NULL, "must be a number above 0"},
    {"tolerance_unit", PAIRS | SELF, 0, read_tolerance_unit, NULL, "must be \"relative\" or \"absolute\""},
    {"threshold", HAUSDORFF, 0, read_threshold, NULL, "must be a number of 0 or more, or null"},
    {"deadline_ms", HAUSDORFF, 0, read_deadline, NULL, "must be a number above 0"},
    {"accuracy", DEVIATION, 0, read_accuracy, NULL, "must be a number above 0"},
    {"pieces", DEVIATION, 0, read_pieces, NULL, "must be a whole number from 0 to 10000000"},
    {"bins", DEVIATION, 0, read_bins, NULL, "must be a whole number from 0 to 10000"},
    {"percentiles", DEVIATION, 0, NULL, read_percentiles,
     "must hold at most 64 numbers above 0, none above 100"},
    {"mode", COLLISION | SELF, 0, read_mode, NULL, "must be \"all\", \"first\" or \"any\""},
    {"limit", COLLISION | SELF, 0, read_limit, NULL, "must be a whole number from 0 to 100000"},
    {"incremental", SELF, 0, read_incremental, NULL, "must be true or false"},
    {"threads", ALL, 0, read_threads, NULL, "must be a whole number from 1 to 256"},
    {"detach", ALL, 0, read_detach, NULL, "must be true or false"},
    {"accelerator", HAUSDORFF | PROJECT, 0, read_accelerator, NULL,
     "must be \"auto\", \"boxes\", \"tetra\" or \"grid\""},
    {"accelerator", ALL & ~(HAUSDORFF | PROJECT | STEP), 0, read_boxes, NULL,
     "must be \"auto\" or \"boxes\""},
    {"bounds", HAUSDORFF, 0, read_bounds, NULL, "must be \"cells\" or \"matching\""},
};
enum { FIELD_COUNT = sizeof fields / sizeof fields[0] };

/** The field that a kind of job has under this name, or NULL. */
static const field *find_field(const char *name, unsigned kind)
{
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if ((fields[i].kinds & kind) && strcmp(fields[i].name, name) == 0) return &fields[i];
    return NULL;
}

/** A JSON pointer to a member, or to an entry in it: ~ and / of the name are written ~0 and ~1; long names
 * and odd bytes are shortened. */
static void make_pointer(char out[POINTER_SIZE], const char *name, const fault *at)
{
    size_t length = 0;
    out[length++] = '/';
    for (const char *c = name; *c && length < 64; c++) {
        if ((unsigned char)*c < 0x20 || (unsigned char)*c >= 0x7f) {
            out[length++] = '?';
        } else if (*c == '~' || *c == '/') {
            out[length++] = '~';
            out[length++] = *c == '~' ? '0' : '1';
        } else {
            out[length++] = *c;
        }
    }
    out[length] = '\0';
    for (int i = 0; i < at->depth; i++)
        length += (size_t)snprintf(out + length, POINTER_SIZE - length, "/%zu", at->index[i]);
}

/** Adds a fault. The problem as a whole takes code and words from its first one; a fault that is plainly
 * invalid takes over from values that are only not available, as the request would stay refused. */
static void complain_of(qm_problem *problem, qm_problem_code code, const char *name, const fault *at,
                        const char *words)
{
    char pointer[POINTER_SIZE];
    make_pointer(pointer, name, at);
    bool takes_over = code == QM_PROBLEM_INVALID_FIELD && problem->code != code;
    if (problem->error_count == 0 || takes_over) {
        problem->code = code;
        snprintf(problem->detail, sizeof problem->detail, "%s %s", pointer + 1, words);
    }
    qm_problem_add_pointer(problem, pointer, "%s", words);
}

/** The same of a member as a whole. */
static void complain(qm_problem *problem, qm_problem_code code, const char *name, const char *words)
{
    complain_of(problem, code, name, &(fault){0}, words);
}

/** Reads one member that is known and given for the first time. */
static void read_member(const field *known, const cJSON *member, qm_job_request *out, qm_problem *problem)
{
    fault place = {0};
    if (!(known->read ? known->read(member, out) : known->read_list(member, out, &place)))
        complain_of(problem, place.no_memory ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_INVALID_FIELD,
                    known->name, &place,
                    place.no_memory ? "needs more memory than there is" : known->expected);
}

/** The kind decides what the other members may be. Without a valid one they are held against the default. */
static void find_kind(const cJSON *object, qm_job_request *out)
{
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(object, "type");
    if (type) read_type(type, out);
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[FIELD_COUNT] = {false};
    find_kind(object, out);
    unsigned kind = 1u << out->kind;
    for (const cJSON *member = object->child; member; member = member->next) {
        const field *known = find_field(member->string, kind);
        if (!known)
            complain(problem, QM_PROBLEM_INVALID_FIELD, member->string, "is not a field of this job");
        else if (seen[known - fields])
            complain(problem, QM_PROBLEM_INVALID_FIELD, member->string, "is given twice");
        else
            read_member(known, member, out, problem);
        if (known) seen[known - fields] = true;
    }
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if ((fields[i].required & kind) && !seen[i])
            complain(problem, QM_PROBLEM_INVALID_FIELD, fields[i].name, "is missing");
}

/** Reads the members and gives the tree back. */
static bool read_request(cJSON *object, qm_job_request *out, qm_problem *problem)
{
    read_members(object, out, problem);
    cJSON_Delete(object);
    if (problem->error_count == 0) return true;
    qm_job_request_reset(out);
    return false;
}

bool qm_json_read_job(const char *text, size_t size, qm_job_request *out, qm_problem *problem)
{
    *out = qm_job_request_default();
    cJSON *object = qm_json_parse_object(text, size, "a job", problem);
    return object && read_request(object, out, problem);
}

/** Takes the key out of the object. */
static void take_key(cJSON *object, qm_text *key, qm_problem *problem)
{
    cJSON *member = object ? cJSON_DetachItemFromObjectCaseSensitive(object, "key") : NULL;
    const char *string = cJSON_GetStringValue(member);
    char number[QM_JSON_NUMBER_SIZE];
    if (string && strlen(string) <= QM_JSON_MAX_KEY) {
        qm_json_add_quoted(key, string);
    } else {
        if (member && !cJSON_IsNumber(member) && !cJSON_IsNull(member))
            complain(problem, QM_PROBLEM_INVALID_FIELD, "key", "must be a number or a short string");
        double value = cJSON_IsNumber(member) ? cJSON_GetNumberValue(member) : NAN;
        qm_text_add_string(key, qm_json_number(value, number));
    }
    cJSON_Delete(member);
}

bool qm_json_read_batch_line(const char *text, size_t size, qm_text *key, qm_job_request *out,
                             qm_problem *problem)
{
    *out = qm_job_request_default();
    cJSON *object = qm_json_parse_object(text, size, "a job", problem);
    take_key(object, key, problem);
    return object && read_request(object, out, problem);
}

/* ---- deformations ---- */

static bool read_indices(const cJSON *value, qm_moved_vertices *out, size_t *count, fault *at)
{
    if (!cJSON_IsArray(value)) return false;
    size_t size = (size_t)cJSON_GetArraySize(value);
    out->indices = malloc((size + 1) * sizeof *out->indices);
    at->no_memory = !out->indices;
    if (at->no_memory) return false;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double index;
        if (!read_whole(number, 0, UINT32_MAX, &index)) return false;
        out->indices[(*count)++] = (uint32_t)index;
    }
    return true;
}

static void complain_of_member(qm_problem *problem, const char *name, const fault *at, const char *words)
{
    complain_of(problem, at->no_memory ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_INVALID_FIELD, name, at,
                at->no_memory ? "needs more memory than there is" : words);
}

static void read_moved(const cJSON *object, qm_moved_vertices *out, qm_problem *problem)
{
    size_t index_count = 0;
    bool has_positions = false;
    for (const cJSON *member = object->child; member; member = member->next) {
        fault place = {0};
        bool is_indices = strcmp(member->string, "indices") == 0;
        bool is_positions = strcmp(member->string, "positions") == 0;
        if ((!is_indices && !is_positions) || (is_indices && out->indices) || (is_positions && has_positions))
            complain(problem, QM_PROBLEM_INVALID_FIELD, member->string, "is unknown, or given twice");
        else if (is_indices && !read_indices(member, out, &index_count, &place))
            complain_of_member(problem, "indices", &place, "must hold whole numbers of 0 or more");
        else if (is_positions && !read_rows(member, &out->positions, &out->count, &place))
            complain_of_member(problem, "positions", &place, "must hold rows of three finite numbers");
        has_positions |= is_positions;
    }
    if (!has_positions) complain(problem, QM_PROBLEM_INVALID_FIELD, "positions", "is missing");
    if (problem->error_count == 0 && out->indices && index_count != out->count)
        complain(problem, QM_PROBLEM_INVALID_FIELD, "positions",
                 "must have as many rows as there are indices");
}

bool qm_json_read_moved_vertices(const char *text, size_t size, qm_moved_vertices *out, qm_problem *problem)
{
    *out = (qm_moved_vertices){0};
    cJSON *object = qm_json_parse_object(text, size, "a deformation", problem);
    if (!object) return false;
    *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
    read_moved(object, out, problem);
    cJSON_Delete(object);
    if (problem->error_count == 0) return true;
    qm_moved_vertices_reset(out);
    return false;
}
