/**
 * cmd_remesh.c: a quad mesh of a surface, without a layout.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "options.h"
#include "qm/quads.h"

typedef struct remesh_options {
    const char *surface, *output;
    qm_quads_options how;
    bool as_json;
} remesh_options;

static void print_result(const remesh_options *o, const qm_mesh *quads, const qm_mesh_facts *facts,
                         const qm_quads_record *record, double elapsed_ms)
{
    qm_quality quality;
    qm_quality_measure(quads, &quality);
    if (o->as_json) {
        qm_text text = {0};
        qm_text_add_string(&text, "{");
        qm_json_add_count(&text, "quads", quads->face_count);
        qm_json_add_count(&text, "irregular_vertices", facts->irregular_vertices);
        qm_json_add_count(&text, "components", facts->components);
        qm_json_add_count(&text, "folded", quality.folded);
        qm_json_add_number(&text, "least_scaled_jacobian", quality.least_jacobian);
        qm_json_add_number(&text, "edge", record->size);
        qm_json_add_number(&text, "elapsed_ms", elapsed_ms);
        qm_text_add_string(&text, "}");
        char *line = qm_text_take(&text);
        puts(line ? line : "{}");
        free(line);
        return;
    }
    /* Standard output holds either the mesh or what is said of it. */
    fprintf(
        strcmp(o->output, "-") == 0 ? stderr : stdout,
        "%zu quads, %zu irregular vertices, %zu components, %zu folded, least scaled Jacobian %.3g, edges of "
        "about %.4g, in %.1f ms\n",
        quads->face_count, facts->irregular_vertices, facts->components, quality.folded,
        quality.least_jacobian, record->size, elapsed_ms);
}

static int remesh(qm_context *ctx, const remesh_options *o, const qm_loaded_mesh *surface)
{
    qm_mesh quads;
    qm_mesh_facts facts;
    qm_quads_record record;
    double start = qm_clock_now_ms();
    qm_status status = qm_quads_make(ctx, surface->bvh, &o->how, &quads, &record);
    double elapsed_ms = qm_clock_now_ms() - start;
    if (status == QM_OK) status = qm_mesh_find_facts(ctx, &quads, &facts);
    bool is_done = status == QM_OK && cli_write_mesh(ctx, o->output, &quads, o->as_json);
    if (is_done)
        print_result(o, &quads, &facts, &record, elapsed_ms);
    else if (status != QM_OK)
        cli_report_status(o->surface, status, ctx, o->as_json);
    qm_mesh_reset(ctx, &quads);
    return is_done ? EXIT_OK : EXIT_BAD_INPUT;
}

static int run(int argc, char **argv)
{
    remesh_options o = {.how = qm_quads_options_default()};
    o.how.thread_count = 0; /* one for each processor */
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
         .target = &o.how.quads,
         .help = "about so many quads (default 5000)"},
        {.name = "crease-angle",
         .value = "DEG",
         .type = CLI_NUMBER,
         .target = &o.how.crease_angle,
         .help = "edges whose faces differ by more are creases, and stay edges (default 40); 0: none"},
        CLI_OPTION_THREADS(&o.how.thread_count),
        CLI_OPTION_JSON(&o.as_json)};
    int status;
    if (!cli_read_options(&cmd_remesh, options, sizeof options / sizeof *options, argc, argv, &o.surface,
                          &status))
        return status;
    if (!cli_check_one_document(&o.output, 1, o.as_json)) return EXIT_USAGE;
    if (!cli_check_writable(o.output, o.as_json)) return EXIT_BAD_INPUT;
    o.how.thread_count = cli_count_threads(o.how.thread_count);
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_preparation preparation = {.parts = QM_BVH_TARGET, .thread_count = o.how.thread_count};
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
    .description = "Makes a mesh of quads of about equal size, without a layout. Boundaries and creases "
                   "become edges of it.\n"
                   "Parts that are thinner than a quad may lose their shape: more quads keep them.\n\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage.",
    .run = run};
