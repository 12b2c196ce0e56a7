#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "cli.h"
#include "format/encode.h"
#include "ops/json_layout.h"
#include "ops/json_refine.h"
#include "picture.h"

#define DEFAULT_QUADS 10000

static const char usage[] =
    "usage: quadmesh reconstruct SURFACE LAYOUT -o OUT [options]\n"
    "\n"
    "Makes a semi-regular quad mesh of a point set or a mesh, from a layout of boundary curves (JSON: "
    "nodes,\n"
    "curves and patches; patches that are not given are found).\n"
    "\n"
    "  -o, --output OUT    the mesh; the end of the name tells the format, PLY without one; - is standard\n"
    "                      output, and the lines about the steps then go to standard error\n"
    "  --quads N           no more quads than N; 10000 when nothing else is asked for\n"
    "  --hausdorff X       until the distance to the surface is at most X, a share of the surface's "
    "diagonal\n"
    "  --edge X            until no mean edge is longer than X, in the unit of the surface\n"
    "  --steps N           so many steps\n"
    "  --no-measure        does not measure the distance after each step\n"
    "  --keep-curves       vertices of curves stay where they were drawn, on the surface or not\n"
    "  --picture FILE.png  a picture of the mesh\n"
    "  --threads N         1 unless told otherwise; the mesh does not depend on it\n"
    "  --json              the steps and the result as JSON, one object a line\n";

typedef struct question {
    const char *surface, *layout, *output, *picture;
    qm_refine_goal goal;
    double hausdorff; /* as a share of the diagonal */
    bool keeps_curves, as_json;
} question;

enum {
    OPTION_QUADS = 256,
    OPTION_HAUSDORFF,
    OPTION_EDGE,
    OPTION_STEPS,
    OPTION_NO_MEASURE,
    OPTION_KEEP_CURVES,
    OPTION_PICTURE,
    OPTION_THREADS
};

static bool read_count(const char *name, const char *text, size_t *out)
{
    double number;
    if (!cli_read_number(name, text, 1.0, &number)) return false;
    *out = number < 1e15 ? (size_t)number : 0;
    if (*out > 0 && (double)*out == number) return true;
    fprintf(stderr, "quadmesh: --%s takes a whole number of 1 or more, got \"%s\"\n", name, text);
    return false;
}

static bool read_option(int option, question *asked)
{
    switch (option) {
    case 'o':
        return asked->output = optarg, true;
    case 'j':
        return asked->as_json = true;
    case OPTION_QUADS:
        return read_count("quads", optarg, &asked->goal.max_quads);
    case OPTION_STEPS:
        return read_count("steps", optarg, &asked->goal.steps);
    case OPTION_HAUSDORFF:
        return cli_read_number("hausdorff", optarg, 1e-300, &asked->hausdorff);
    case OPTION_EDGE:
        return cli_read_number("edge", optarg, 1e-300, &asked->goal.edge);
    case OPTION_NO_MEASURE:
        return asked->goal.measures = false, true;
    case OPTION_KEEP_CURVES:
        return asked->keeps_curves = true;
    case OPTION_PICTURE:
        return asked->picture = optarg, true;
    case OPTION_THREADS:
        return cli_read_threads(optarg, &asked->goal.thread_count);
    default:
        return false;
    }
}

static bool read_options(int argc, char **argv, question *asked, int *status)
{
    static const struct option options[] = {{"output", required_argument, NULL, 'o'},
                                            {"quads", required_argument, NULL, OPTION_QUADS},
                                            {"hausdorff", required_argument, NULL, OPTION_HAUSDORFF},
                                            {"edge", required_argument, NULL, OPTION_EDGE},
                                            {"steps", required_argument, NULL, OPTION_STEPS},
                                            {"no-measure", no_argument, NULL, OPTION_NO_MEASURE},
                                            {"keep-curves", no_argument, NULL, OPTION_KEEP_CURVES},
                                            {"picture", required_argument, NULL, OPTION_PICTURE},
                                            {"threads", required_argument, NULL, OPTION_THREADS},
                                            {"json", no_argument, NULL, 'j'},
                                            {"help", no_argument, NULL, 'h'},
                                            {0}};
    *status = EXIT_USAGE;
    for (int option; (option = getopt_long(argc, argv, "o:", options, NULL)) != -1;) {
        if (option == 'h') return *status = EXIT_OK, fputs(usage, stdout), false;
        if (option == '?') return fputs(usage, stderr), false;
        if (!read_option(option, asked)) return false;
    }
    bool has_goal =
        asked->goal.max_quads || asked->goal.steps || asked->goal.edge > 0.0 || asked->hausdorff > 0.0;
    if (!has_goal) asked->goal.max_quads = DEFAULT_QUADS;
    if (argc - optind == 2 && asked->output) {
        asked->surface = argv[optind];
        asked->layout = argv[optind + 1];
        return true;
    }
    fputs("quadmesh: reconstruct takes a surface, a layout and -o OUT\n\n", stderr);
    return fputs(usage, stderr), false;
}

/** Reads the layout, and finds its patches when the file names none. False after words. */
static bool load_layout(qm_context *ctx, const question *asked, const qm_source *source, qm_layout *out)
{
    size_t size;
    uint8_t *bytes = cli_read_file(asked->layout, &size, asked->as_json);
    if (!bytes) return false;
    qm_problem problem;
    bool has_patches;
    bool good = qm_json_read_layout(ctx, (const char *)bytes, size, NULL, out, &has_patches, &problem);
    free(bytes);
    if (good && !has_patches) {
        qm_layout_issues issues;
        qm_status status = qm_layout_find_patches(ctx, source, out, &issues);
        good = status == QM_OK;
        if (!good) problem = qm_problem_from_status(status, ctx->message);
        qm_layout_issues_reset(ctx, &issues);
        if (!good) qm_layout_reset(ctx, out);
    }
    if (!good) cli_complain(asked->layout, &problem, asked->as_json);
    return good;
}

/** What the lines about the steps are printed with. */
typedef struct printer {
    const question *asked;
    FILE *out; /* not where the mesh goes */
    double diagonal;
} printer;

static void on_step(void *user, const qm_refine_record *record)
{
    const printer *p = user;
    if (p->asked->as_json) {
        qm_text text = {0};
        qm_text_add_string(&text, "{");
        qm_json_add_step(&text, record, p->diagonal);
        qm_text_add_string(&text, "}");
        char *line = qm_text_take(&text);
        fprintf(p->out, "%s\n", line ? line : "{}");
        free(line);
        return;
    }
    char bound[CLI_BOUND_SIZE];
    fprintf(p->out,
            "%8zu quads, %3zu patches split, %6zu vertices placed, %4zu in holes, %zu folded, %zu turned",
            record->step.quads, record->step.patches_split, record->step.moved_vertices,
            record->step.holes_filled, record->quality.folded, record->quality.turned);
    if (record->is_measured)
        fprintf(p->out, ", distance at most %s of the diagonal",
                cli_format_bound(record->upper / p->diagonal, true, bound));
    if (record->is_measured && record->uncovered + record->beyond > 0)
        fprintf(p->out, ", %s within what is drawn",
                cli_format_bound(record->covered / p->diagonal, true, bound));
    fprintf(p->out, ", %.1f ms\n", record->step_ms);
}

static bool write_mesh(qm_context *ctx, const question *asked, const qm_mesh *mesh)
{
    qm_mesh_facts facts;
    qm_encoder *encoder = NULL;
    qm_format format = qm_format_from_path(asked->output);
    if (format == QM_FORMAT_UNKNOWN) format = QM_FORMAT_PLY;
    qm_status status = qm_mesh_find_facts(ctx, mesh, &facts);
    if (status == QM_OK) status = qm_encoder_create(ctx, mesh, &facts, format, 0, &encoder);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx->message);
        cli_complain(asked->output, &problem, asked->as_json);
        return false;
    }
    FILE *out = strcmp(asked->output, "-") == 0 ? stdout : fopen(asked->output, "wb");
    bool written = out != NULL, goes_on = written;
    while (goes_on) {
        qm_text block = {0};
        goes_on = qm_encoder_next(encoder, &block);
        written = written && !block.failed && fwrite(block.data, 1, block.size, out) == block.size;
        qm_text_reset(&block);
    }
    if (out && out != stdout && fclose(out) != 0) written = false;
    qm_encoder_destroy(encoder);
    if (written) return true;
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "cannot be written: %s", strerror(errno ? errno : ENOMEM));
    cli_complain(asked->output, &problem, asked->as_json);
    return false;
}

static bool write_picture(const question *asked, const qm_mesh *mesh)
{
    if (!asked->picture || picture_write(asked->picture, mesh)) return true;
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "cannot be written: %s", strerror(errno ? errno : ENOMEM));
    cli_complain(asked->picture, &problem, asked->as_json);
    return false;
}

/** Takes the steps and writes what comes out. Returns the exit status. */
static int refine_and_write(qm_context *ctx, const question *asked, const qm_source *source,
                            qm_reconstruction *r)
{
    printer p = {asked, strcmp(asked->output, "-") == 0 ? stderr : stdout, source->diagonal};
    qm_refine_stop stop;
    qm_status status = qm_refine(ctx, r, source, &asked->goal, on_step, &p, &stop);
    ctx->cancel = NULL; /* what is done is written, also after an interrupt */
    qm_mesh mesh = {0};
    if (status == QM_OK) status = qm_reconstruction_mesh(ctx, r, &mesh);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx->message);
        cli_complain(asked->surface, &problem, asked->as_json);
        return EXIT_BAD_INPUT;
    }
    size_t points, uncovered;
    qm_reconstruction_coverage(r, &points, &uncovered);
    bool good = write_mesh(ctx, asked, &mesh) && write_picture(asked, &mesh);
    if (good && !asked->as_json)
        fprintf(p.out, "%s: %zu quads in %zu patches; %.2f %% of the surface is covered; stopped by %s\n",
                asked->output, mesh.face_count, qm_reconstruction_patch_count(r),
                100.0 * (double)(points - uncovered) / (double)points, qm_refine_stop_name(stop));
    qm_mesh_reset(ctx, &mesh);
    bool is_reached =
        stop != QM_REFINE_CANCELED && (!(asked->goal.hausdorff > 0.0) || stop == QM_REFINE_HAUSDORFF);
    return !good ? EXIT_BAD_INPUT : is_reached ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static int run(qm_context *ctx, question *asked, const qm_loaded_mesh *surface)
{
    qm_source source;
    qm_layout layout;
    qm_status status = qm_source_init(ctx, surface->bvh, &source);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx->message);
        return cli_complain(asked->surface, &problem, asked->as_json), EXIT_BAD_INPUT;
    }
    if (!load_layout(ctx, asked, &source, &layout)) return EXIT_BAD_INPUT;
    asked->goal.hausdorff = asked->hausdorff * source.diagonal;
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.pull_curves = !asked->keeps_curves;
    options.thread_count = asked->goal.thread_count;
    qm_reconstruction *r;
    status = qm_reconstruction_create(ctx, &source, &layout, &options, &r);
    qm_layout_reset(ctx, &layout);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx->message);
        return cli_complain(asked->layout, &problem, asked->as_json), EXIT_BAD_INPUT;
    }
    int result = refine_and_write(ctx, asked, &source, r);
    qm_reconstruction_destroy(ctx, r);
    return result;
}

int cmd_reconstruct(int argc, char **argv)
{
    question asked = {.goal = {.measures = true, .thread_count = 1}};
    int status;
    if (!read_options(argc, argv, &asked, &status)) return status;
    if (!cli_check_writable(asked.output, asked.as_json)) return EXIT_BAD_INPUT;
    if (asked.picture && !cli_check_writable(asked.picture, asked.as_json)) return EXIT_BAD_INPUT;
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_preparation preparation = {.parts = QM_BVH_TARGET, .thread_count = asked.goal.thread_count};
    qm_loaded_mesh surface;
    if (!cli_load_mesh(&ctx, asked.surface, asked.as_json, &preparation, &surface)) return EXIT_BAD_INPUT;
    status = run(&ctx, &asked, &surface);
    qm_loaded_mesh_reset(&ctx, &surface);
    return status;
}
