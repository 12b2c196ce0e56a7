/**
 * kind_collision.c: pairs of faces that meet, of two meshes or of one with itself.
 */
#include "job_kinds_internal.h"

const char *const qm_collide_mode_names[] = {"all", "first", "any", NULL};

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    qm_collide_options options = qm_collide_options_default();
    options.quads = call->request->quads;
    options.mode = call->request->mode;
    options.tolerance = out->tolerance = qm_job_tolerance(call);
    options.thread_count = call->threads;
    return qm_listed_pairs_find(call->ctx, call->a, call->b, &options, call->request->incremental,
                                call->request->list_limit, &out->pairs);
}

static const double *find_pairs(const qm_job_result *result, size_t *count)
{
    *count = 2 * result->pairs.found.pair_count;
    return result->pairs.faces;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_listed_pairs_reset(ctx, &result->pairs);
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_count(out, "limit", request->list_limit);
    qm_job_add_tolerance(out, request);
}

static void write_self_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    write_request(out, request, is_brief);
    if (request->incremental) qm_json_add_bool(out, "incremental", true);
}

static void add_pair(qm_text *out, qm_face_pair pair, const qm_contact *contact)
{
    static const char *const kinds[] = {"point", "segment", "area"};
    const double faces[2] = {pair.a, pair.b};
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_numbers(out, "faces", faces, 2);
    qm_json_add_string(out, "contact", kinds[contact->kind]);
    qm_json_open(out, "points", "[");
    for (int i = 0; i < (contact->kind == QM_CONTACT_POINT ? 1 : 2); i++)
        qm_json_add_array(out, contact->point[i], 3);
    qm_text_add_string(out, "]}");
}

static void write_pairs(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_listed_pairs *listed = &result->pairs;
    qm_json_add_bool(out, "collides", listed->found.pair_count > 0);
    qm_json_add_count(out, "count", listed->found.pair_count);
    qm_json_open(out, "pairs", "[");
    for (size_t i = 0; i < listed->listed_count; i++)
        add_pair(out, listed->found.pairs[i], &listed->contacts[i]);
    qm_text_add_string(out, "]");
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->quads == QM_QUADS_BILINEAR) qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_count(out, "tests", listed->found.tests);
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    write_pairs(out, request, result);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->pairs.found.elapsed_ms);
}

static void write_self_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    write_pairs(out, request, result);
    qm_json_add_bool(out, "incremental", result->pairs.is_incremental);
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->pairs.found.elapsed_ms);
}

#define LIST_FIELDS                                                                                          \
    {"mode", QM_FIELD_CHOICE, QM_FIELD_AT(mode), .names = qm_collide_mode_names},                            \
    {                                                                                                        \
        "limit", QM_FIELD_COUNT, QM_FIELD_AT(list_limit), .max = QM_JOB_MAX_LISTED                           \
    }

static const qm_job_array pairs = {"all_pairs", "face_a,face_b", 2};

static const qm_job_field fields[] = {QM_JOB_FIELD_PAIR,  QM_JOB_FIELD_QUADS, QM_JOB_FIELDS_TOLERANCE,
                                      QM_JOB_FIELD_BOXES, LIST_FIELDS,        {0}};

const qm_job_hooks qm_job_kind_collision = {
    .type = {.name = "collision", .mesh_field = {"a", "b"}, .is_pure = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .array = &pairs,
    .find_array = find_pairs,
    .reset = reset};

static const qm_job_field self_fields[] = {QM_JOB_FIELD_MESH,
                                           QM_JOB_FIELD_QUADS,
                                           QM_JOB_FIELDS_TOLERANCE,
                                           QM_JOB_FIELD_BOXES,
                                           LIST_FIELDS,
                                           {"incremental", QM_FIELD_FLAG, QM_FIELD_AT(incremental)},
                                           {0}};

const qm_job_hooks qm_job_kind_self_collision = {
    .type = {.name = "self_collision", .mesh_field = {"mesh", NULL}, .is_pure = true},
    .fields = self_fields,
    .run = run,
    .write_request = write_self_request,
    .write_result = write_self_result,
    .array = &pairs,
    .find_array = find_pairs,
    .reset = reset};
