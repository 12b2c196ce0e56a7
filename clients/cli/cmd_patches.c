/**
 * cmd_patches.c: the regular patches of a mesh of quads.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "ops/patches_out.h"
#include "options.h"

typedef struct patches_options {
    const char *mesh, *output;
    bool as_json;
} patches_options;

static bool write_file(const patches_options *options, const qm_loaded_mesh *mesh)
{
    qm_text text = {0};
    bool as_csv = cli_path_ends_in(options->output, ".csv");
    if (as_csv)
        qm_patches_write_csv(&text, mesh);
    else
        qm_patches_write_json(&text, mesh);
    char *bytes = qm_text_take(&text);
    FILE *out = strcmp(options->output, "-") == 0 ? stdout : fopen(options->output, "wb");
    bool is_written = bytes && out && fputs(bytes, out) >= 0 && (as_csv || fputs("\n", out) >= 0);
    if (out && out != stdout && fclose(out) != 0) is_written = false;
    free(bytes);
    if (!is_written) cli_report_unwritable(options->output, options->as_json);
    return is_written;
}

static int run(int argc, char **argv)
{
    patches_options o = {0};
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .target = &o.output,
         .help =
             "the faces of each patch: as JSON, or if OUT ends in .csv as lines of face, patch, row, column\n"
             "(faces by their index in the file, from 0); - is standard output"},
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "the counts as JSON, or the problem document"}};
    int status;
    if (!cli_read_options(&cmd_patches, options, 2, argc, argv, &o.mesh, &status)) return status;
    qm_context ctx = qm_host_context();
    const qm_preparation structure = {
        .has_facts = true, .has_patches = true, .parts = QM_BVH_SOURCE, .thread_count = 1};
    qm_loaded_mesh mesh;
    if (!cli_load_mesh(&ctx, o.mesh, o.as_json, &structure, &mesh)) return EXIT_BAD_INPUT;
    bool is_written = !o.output || write_file(&o, &mesh);
    /* Standard output holds either the patches or the counts. */
    if (is_written && !(o.output && strcmp(o.output, "-") == 0)) {
        qm_regular_patch largest = qm_loaded_mesh_largest_patch(&mesh);
        const char *format =
            o.as_json
                ? "{\"patch_count\":%zu,\"quads\":%zu,\"irregular_vertices\":%zu,\"largest_patch\":"
                  "{\"rows\":%u,\"columns\":%u},\"elapsed_ms\":%.3f}\n"
                : "%zu patches of %zu quads, %zu irregular vertices, the largest %u x %u, found in %.1f ms\n";
        printf(format, mesh.patches.patch_count, mesh.facts.quads, mesh.facts.irregular_vertices,
               largest.rows, largest.columns, mesh.patches_ms);
    }
    qm_loaded_mesh_reset(&ctx, &mesh);
    return is_written ? EXIT_OK : EXIT_BAD_INPUT;
}

const cli_command cmd_patches = {
    .name = "patches",
    .arguments = "FILE [-o OUT] [--json]",
    .summary = "the regular patches of a mesh of quads",
    .takes = "one file",
    .path_count = 1,
    .description =
        "Splits a mesh of quads into regular patches of rows x columns, and prints their number.\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage.",
    .run = run};
