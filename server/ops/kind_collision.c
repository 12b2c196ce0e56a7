/**
 * kind_collision.c: pairs of faces that meet, of two meshes or of one with itself.
 */
#include "job_kinds_internal.h"

#define DEPTH_ACCURACY 1.0 /* of means, which nobody asks for: few pieces */

const char *const qm_collide_mode_names[] = {"all", "first", "any", NULL};

const char *const qm_relation_names[] = {"meeting", "apart", "a_inside_b", "b_inside_a", "overlapping", NULL};

/** The trees of both meshes, which have one each or are given one for the call. */
typedef struct tree_pair {
    const qm_bvh *bvh[2];
    qm_bvh *own[2];
} tree_pair;

static qm_status get_trees(const qm_job_call *call, tree_pair *trees)
{
    const qm_loaded_mesh *const mesh[2] = {call->a, call->b};
    qm_bvh_parts parts = call->request->quads == QM_QUADS_BILINEAR ? QM_BVH_ALL : QM_BVH_TARGET;
    qm_status status = QM_OK;
    *trees = (tree_pair){{call->a->bvh, call->b->bvh}, {NULL, NULL}};
    for (int i = 0; status == QM_OK && i < 2; i++) {
        if (trees->bvh[i]) continue;
        status = qm_bvh_build(call->ctx, &mesh[i]->mesh, parts, call->threads, &trees->own[i]);
        trees->bvh[i] = trees->own[i];
    }
    return status;
}

static qm_status require_solids(const qm_job_call *call, const tree_pair *trees)
{
    const qm_loaded_mesh *const mesh[2] = {call->a, call->b};
    static const char *const names[2] = {"A", "B"};
    qm_status status = QM_OK;
    for (int i = 0; status == QM_OK && i < 2; i++) {
        qm_solid solid;
        status = qm_solids_check(mesh[i]->solids, call->ctx, trees->bvh[i], call->request->quads,
                                 call->threads, &solid);
        if (status == QM_OK) status = qm_solid_require(call->ctx, &solid, names[i]);
    }
    return status;
}

/** How deep one solid, the source, is in the other: the greatest distance inside of a signed deviation. */
static qm_status measure_depth(const qm_job_call *call, const tree_pair *trees, int source, double tolerance,
                               qm_deviation_side *out)
{
    static const qm_solid proven = {.fault = QM_SOLID_PROVEN};
    const qm_loaded_mesh *from = source == 0 ? call->a : call->b, *to = source == 0 ? call->b : call->a;
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = call->request->quads;
    options.accuracy = DEPTH_ACCURACY;
    options.tolerance = tolerance;
    options.thread_count = call->threads;
    options.sign = QM_SIGN_OUTSIDE;
    options.solid = &proven;
    qm_deviation found;
    qm_status status =
        qm_deviation_measure(call->ctx, trees->bvh[source], trees->bvh[1 - source], &options, &found);
    if (status != QM_OK) return status;
    if (found.is_canceled) status = qm_context_fail(call->ctx, QM_E_CANCELED, "penetration canceled");
    *out = found.sides.behind;
    out->from.face = qm_mesh_input_face(&from->mesh, out->from.face);
    out->to.face = qm_mesh_input_face(&to->mesh, out->to.face);
    qm_deviation_reset(call->ctx, &found);
    return status;
}

/** Tells how the solids lie, and how deep they are in one another. */
static qm_status relate_solids(const qm_job_call *call, const tree_pair *trees, qm_job_result *out)
{
    qm_status status = QM_OK;
    if (out->pairs.found.pair_count == 0)
        status =
            qm_solid_relate(call->ctx, trees->bvh[0], trees->bvh[1], call->request->quads, &out->relation);
    if (status != QM_OK || !call->request->penetration) return status;
    status = measure_depth(call, trees, 0, out->tolerance, &out->a_inside_b);
    return status == QM_OK ? measure_depth(call, trees, 1, out->tolerance, &out->b_inside_a) : status;
}

static qm_status run_solid(const qm_job_call *call, const qm_collide_options *options, qm_job_result *out)
{
    tree_pair trees;
    qm_status status = get_trees(call, &trees);
    if (status == QM_OK) status = require_solids(call, &trees);
    if (status == QM_OK)
        status = qm_listed_pairs_find(call->ctx, call->a, call->b, options, false, call->request->list_limit,
                                      &out->pairs);
    if (status == QM_OK) status = relate_solids(call, &trees, out);
    qm_bvh_destroy(call->ctx, trees.own[0]);
    qm_bvh_destroy(call->ctx, trees.own[1]);
    return status;
}

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    qm_collide_options options = qm_collide_options_default();
    options.quads = call->request->quads;
    options.mode = call->request->mode;
    options.tolerance = out->tolerance = qm_job_tolerance(call);
    options.thread_count = call->threads;
    if (call->request->solid || call->request->penetration) return run_solid(call, &options, out);
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
    qm_job_add_gap(out, request);
    if (request->solid) qm_json_add_bool(out, "solid", true);
    if (request->penetration) qm_json_add_bool(out, "penetration", true);
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
    qm_text_add_string(out, "]");
    qm_json_open(out, "normals", "[");
    for (int i = 0; i < 2; i++)
        qm_json_add_array(out, contact->normal[i], 3);
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
    if (request->quads == QM_QUADS_BILINEAR) qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_count(out, "tests", listed->found.tests);
}

/** from and to name the meshes of the request whose surface is in the other. */
static void add_depth(qm_text *out, const char *name, const char *from, const char *to,
                      const qm_job_request *request, const qm_job_result *result,
                      const qm_deviation_side *side)
{
    bool is_a = from[0] == 'a';
    qm_json_open(out, name, "{");
    qm_json_add_lower_upper(out, side->max.lower, side->max.upper, result->diagonal);
    if (side->has_witness) {
        qm_json_open(out, "witness", "{");
        qm_json_add_surface_point(out, "from", from, is_a ? request->a : request->b, side->from.face,
                                  &side->from);
        qm_json_add_surface_point(out, "to", to, is_a ? request->b : request->a, side->to.face, &side->to);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "}");
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    write_pairs(out, request, result);
    if (request->solid || request->penetration)
        qm_json_add_string(out, "relation", qm_relation_names[result->relation]);
    if (request->penetration) {
        qm_json_open(out, "penetration", "{");
        add_depth(out, "a_in_b", "a", "b", request, result, &result->a_inside_b);
        add_depth(out, "b_in_a", "b", "a", request, result, &result->b_inside_a);
        qm_text_add_string(out, "}");
    }
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

static const qm_job_field fields[] = {QM_JOB_FIELD_PAIR,
                                      QM_JOB_FIELD_QUADS,
                                      QM_JOB_FIELDS_GAP,
                                      QM_JOB_FIELD_BOXES,
                                      LIST_FIELDS,
                                      {"solid", QM_FIELD_FLAG, QM_FIELD_AT(solid)},
                                      {"penetration", QM_FIELD_FLAG, QM_FIELD_AT(penetration)},
                                      {0}};

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
                                           QM_JOB_FIELDS_GAP,
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
