#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "cli.h"
#include "ops/patches_out.h"

static const char usage[] =
    "usage: quadmesh patches FILE [-o OUT] [--json]\n"
    "\n"
    "Splits a mesh of quads into regular patches of rows x columns, and tells how many there are.\n"
    "\n"
    "  -o, --output OUT  the faces of each patch: as JSON, or when OUT ends in .csv as lines of\n"
    "                    face, patch, row, column (faces by their place in the file, from 0); - for the\n"
    "                    standard output\n"
    "  --json            the counts as JSON, or the problem document\n";

typedef struct question {
    const char *mesh, *output;
    bool as_json;
} question;

static void print_counts(const question *asked, const qm_loaded_mesh *mesh)
{
    qm_regular_patch largest = qm_loaded_mesh_largest_patch(mesh);
    const char *format =
        asked->as_json
            ? "{\"patch_count\":%zu,\"quads\":%zu,\"irregular_vertices\":%zu,\"largest_patch\":{\"rows\":%u,"
              "\"columns\":%u},\"elapsed_ms\":%.3f}\n"
            : "%zu patches of %zu quads, %zu irregular vertices, the largest %u x %u, found in %.1f ms\n";
    printf(format, mesh->patches.patch_count, mesh->facts.quads, mesh->facts.irregular_vertices, largest.rows,
           largest.columns, mesh->patches_ms);
}

static bool write_file(const question *asked, const qm_loaded_mesh *mesh)
{
    qm_text text = {0};
    size_t length = strlen(asked->output);
    bool as_csv = length >= 4 && strcmp(asked->output + length - 4, ".csv") == 0;
    (as_csv ? qm_patches_write_csv : qm_patches_write_json)(&text, mesh);
    char *bytes = qm_text_take(&text);
    FILE *out = strcmp(asked->output, "-") == 0 ? stdout : fopen(asked->output, "wb");
    bool written = bytes && out && fputs(bytes, out) >= 0 && (as_csv || fputs("\n", out) >= 0);
    if (out && out != stdout && fclose(out) != 0) written = false;
    free(bytes);
    if (!written) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "cannot be written: %s",
                                             strerror(errno ? errno : ENOMEM));
        cli_complain(asked->output, &problem, asked->as_json);
    }
    return written;
}

static bool read_options(int argc, char **argv, question *asked, int *status)
{
    static const struct option options[] = {{"output", required_argument, NULL, 'o'},
                                            {"json", no_argument, NULL, 'j'},
                                            {"help", no_argument, NULL, 'h'},
                                            {0}};
    *status = EXIT_USAGE;
    for (int option; (option = getopt_long(argc, argv, "o:", options, NULL)) != -1;) {
        if (option == 'h') return *status = EXIT_OK, fputs(usage, stdout), false;
        if (option == '?') return fputs(usage, stderr), false;
        if (option == 'j') asked->as_json = true;
        if (option == 'o') asked->output = optarg;
    }
    if (argc - optind == 1) return asked->mesh = argv[optind], true;
    fprintf(stderr, "quadmesh: patches takes one file, got %d\n\n", argc - optind);
    return fputs(usage, stderr), false;
}

int cmd_patches(int argc, char **argv)
{
    question asked = {0};
    int status;
    if (!read_options(argc, argv, &asked, &status)) return status;
    qm_context ctx = qm_host_context();
    const qm_preparation structure = {
        .has_facts = true, .has_patches = true, .parts = QM_BVH_SOURCE, .thread_count = 1};
    qm_loaded_mesh mesh;
    if (!cli_load_mesh(&ctx, asked.mesh, asked.as_json, &structure, &mesh)) return EXIT_BAD_INPUT;
    bool good = !asked.output || write_file(&asked, &mesh);
    /* What goes to the standard output is not to be mixed with words. */
    if (good && !(asked.output && strcmp(asked.output, "-") == 0)) print_counts(&asked, &mesh);
    qm_loaded_mesh_reset(&ctx, &mesh);
    return good ? EXIT_OK : EXIT_BAD_INPUT;
}
