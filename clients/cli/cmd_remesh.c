/**
 * cmd_remesh.c: a quad mesh of a surface, and how far it is from it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "ops/remesh.h"
#include "options.h"

typedef struct remesh_options {
    const char *surface, *output;
    qm_remesh_options how;
    double distance; /* a fraction of the diagonal */
    bool as_json;
} remesh_options;

/** Figures of the result, besides its distance. */
typedef struct remesh_facts {
    qm_mesh_facts mesh;
    qm_quality quality;
    double diagonal, elapsed_ms;
} remesh_facts;

static void print_json(const qm_remesh_result *result, const remesh_facts *facts)
{
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_count(&text, "quads", result->mesh.face_count);
    qm_json_add_count(&text, "irregular_vertices", facts->mesh.irregular_vertices);
    qm_json_add_count(&text, "components", facts->mesh.components);
    if (result->patches > 0) qm_json_add_count(&text, "patches", result->patches);
    qm_json_add_count(&text, "folded", facts->quality.folded);
    qm_json_add_number(&text, "least_scaled_jacobian", facts->quality.least_jacobian);
    qm_json_add_interval(&text, "hausdorff", (qm_interval){result->lower, result->upper}, facts->diagonal);
    qm_json_add_count(&text, "rounds", result->rounds);
    qm_json_add_number(&text, "elapsed_ms", facts->elapsed_ms);
    qm_text_add_string(&text, "}");
    char *line = qm_text_take(&text);
    puts(line ? line : "{}");
    free(line);
}

static void print_words(const remesh_options *o, const qm_remesh_result *result, const remesh_facts *facts)
{
    char bound[CLI_BOUND_SIZE], patches[40] = "";
    if (result->patches > 0) snprintf(patches, sizeof patches, " in %zu patches", result->patches);
    /* Standard output holds either the mesh or what is said of it. */
    fprintf(strcmp(o->output, "-") == 0 ? stderr : stdout,
            "%zu quads%s, %zu irregular vertices, %zu components, %zu folded, least scaled Jacobian %.3g, "
            "distance at most %s of the diagonal, in %.1f ms\n",
            result->mesh.face_count, patches, facts->mesh.irregular_vertices, facts->mesh.components,
            facts->quality.folded, facts->quality.least_jacobian,
            cli_format_bound(result->upper / facts->diagonal, true, bound), facts->elapsed_ms);
}

static int remesh(qm_context *ctx, remesh_options *o, const qm_loaded_mesh *surface)
{
    qm_ref_surface source;
    qm_remesh_result result = {0};
    remesh_facts facts = {0};
    double start = qm_clock_now_ms();
    qm_status status = qm_ref_surface_init(ctx, surface->bvh, &source);
    if (status == QM_OK) {
        o->how.distance = o->distance * source.diagonal;
        status = qm_remesh(ctx, &source, &o->how, &result);
    }
    facts.elapsed_ms = qm_clock_now_ms() - start;
    if (status == QM_OK) status = qm_mesh_find_facts(ctx, &result.mesh, &facts.mesh);
    bool is_done = status == QM_OK && cli_write_mesh(ctx, o->output, &result.mesh, o->as_json);
    if (is_done) {
        facts.diagonal = source.diagonal;
        qm_quality_measure(&result.mesh, &facts.quality);
        if (o->as_json)
            print_json(&result, &facts);
        else
            print_words(o, &result, &facts);
    } else if (status != QM_OK) {
        cli_report_status(o->surface, status, ctx, o->as_json);
    }
    bool is_near = !(o->distance > 0.0) || result.upper <= o->how.distance;
    qm_mesh_reset(ctx, &result.mesh);
    return !is_done ? EXIT_BAD_INPUT : is_near ? EXIT_OK : EXIT_NOT_CONVERGED;
}

/** How many quads where none are given: some to start from, or as many as it takes, or as usual. */
static void settle_quads(remesh_options *o)
{
    if (o->how.quads.quads > 0) return;
    o->how.quads.quads = !(o->distance > 0.0)     ? qm_quads_options_default().quads
                         : o->how.is_semi_regular ? QM_REMESH_MOST_QUADS
                                                  : QM_REMESH_FIRST_QUADS;
}

static int run(int argc, char **argv)
{
    remesh_options o = {.how = {.quads = qm_quads_options_default()}};
    o.how.quads.quads = 0;        /* not given */
    o.how.quads.thread_count = 0; /* one for each processor */
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .is_required = true,
         .target = &o.output,
         .help = "the mesh, in the format of its name, else PLY; - is standard output"},
        {.name = "quads",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e7,
         .target = &o.how.quads.quads,
         .help = "about so many quads (default 5000); with --distance the first of the numbers that are "
                 "tried, with\n"
                 "--semi-regular the limit"},
        {.name = "distance",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.distance,
         .help = "until the distance to the surface is at most X, as a fraction of the surface's diagonal"},
        {.name = "semi-regular",
         .type = CLI_FLAG,
         .target = &o.how.is_semi_regular,
         .help = "blocks of quads in rows and columns, by an automatic layout (see layout --auto)"},
        {.name = "crease-angle",
         .value = "DEG",
         .type = CLI_NUMBER,
         .target = &o.how.quads.crease_angle,
         .help = "edges whose faces differ by more are creases, and stay edges (default 40); 0: none"},
        CLI_OPTION_THREADS(&o.how.quads.thread_count),
        CLI_OPTION_JSON(&o.as_json)};
    int status;
    if (!cli_read_options(&cmd_remesh, options, sizeof options / sizeof *options, argc, argv, &o.surface,
                          &status))
        return status;
    if (!cli_check_one_document(&o.output, 1, o.as_json)) return EXIT_USAGE;
    if (!cli_check_writable(o.output, o.as_json)) return EXIT_BAD_INPUT;
    o.how.quads.thread_count = cli_count_threads(o.how.quads.thread_count);
    settle_quads(&o);
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_preparation preparation = {.parts = QM_BVH_TARGET, .thread_count = o.how.quads.thread_count};
    qm_loaded_mesh surface;
    if (!cli_load_mesh(&ctx, o.surface, o.as_json, &preparation, &surface)) return EXIT_BAD_INPUT;
    status = remesh(&ctx, &o, &surface);
    qm_loaded_mesh_reset(&ctx, &surface);
    return status;
}

const cli_command cmd_remesh = {
    .name = "remesh",
    .arguments = "SURFACE -o OUT [options]",
    .summary = "a quad mesh of a surface",
    .takes = "a surface and -o OUT",
    .path_count = 1,
    .description =
        "Makes a mesh of quads of about equal size. Boundaries and creases become edges of it, and its "
        "distance\nto the surface is measured, with a proven bound.\n"
        "Parts that are thinner than a quad may lose their shape: more quads keep them.\n\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage, 3 the distance was not reached.",
    .run = run};
