/**
 * cmd_reconstruct.c: a semi-regular quad mesh of a surface, from a layout of curves.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "ops/json_layout.h"
#include "ops/settle.h"
#include "options.h"
#include "qm/quality.h"

#define WARNINGS_SHOWN 20

typedef struct reconstruct_options {
    const char *surface, *layout, *output, *picture;
    qm_refine_goal goal;
    double hausdorff; /* the goal, as a fraction of the diagonal */
    double noise;     /* the option noise_share of a reconstruction */
    bool keeps_curves, settles, keeps_vertices, has_uv, as_json;
} reconstruct_options;

/** Reads the layout, and finds its patches if the file has none. False after a report. */
static bool load_layout(qm_context *ctx, const reconstruct_options *options, const qm_ref_surface *source,
                        qm_layout *out)
{
    size_t size;
    uint8_t *bytes = cli_read_file(options->layout, &size, options->as_json);
    if (!bytes) return false;
    qm_problem problem;
    bool has_patches;
    bool is_valid =
        qm_json_read_layout(ctx, (const char *)bytes, size, NULL, NULL, out, &has_patches, &problem);
    free(bytes);
    if (is_valid && !has_patches) {
        qm_layout_issues issues;
        qm_status status = qm_layout_find_patches(ctx, source, out, &issues);
        for (size_t i = 0; i < issues.count && status == QM_OK; i++) {
            char text[QM_ISSUE_TEXT];
            qm_layout_issue_text(&issues.items[i], text);
            fprintf(stderr, "%s: %s\n", options->layout, text);
        }
        is_valid = status == QM_OK;
        if (!is_valid) problem = qm_problem_from_status(status, ctx->message);
        qm_layout_issues_reset(ctx, &issues);
        if (!is_valid) qm_layout_reset(ctx, out);
    }
    if (!is_valid) cli_report(options->layout, &problem, options->as_json);
    return is_valid;
}

/** Prints a line for each step. */
typedef struct printer {
    const reconstruct_options *options;
    FILE *out; /* stdout, or stderr if the mesh goes to stdout */
    double diagonal;
    size_t step_count;
} printer;

static void on_step(void *user, const qm_refine_record *record)
{
    printer *p = user;
    p->step_count++;
    if (p->options->as_json) {
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
        fprintf(p->out, ", %s within the layout",
                cli_format_bound(record->covered / p->diagonal, true, bound));
    fprintf(p->out, ", %.1f ms\n", record->step_ms);
}

/** Prints a line for the mesh whose vertices were moved at the end; as JSON it is a member of the result. */
static void print_settled(const printer *p, const qm_settled *settled)
{
    char bound[CLI_BOUND_SIZE];
    double upper = qm_settle_two_sided(&settled->distance).upper;
    if (p->options->as_json) return;
    fprintf(p->out, "%s: %zu folded, least scaled Jacobian %.3f, distance at most %s of the diagonal\n",
            settled->is_kept ? "settled"
                             : "not settled, which would have brought it farther from the surface",
            settled->quality.folded, settled->quality.least_jacobian,
            cli_format_bound(upper / p->diagonal, true, bound));
}

/** Prints the result as the last line: as an object, or as a sentence after the warnings. settled is NULL if nothing was. */
static void print_result(const printer *p, const qm_reconstruction *r, size_t quads, qm_refine_stop stop,
                         const qm_settled *settled)
{
    size_t points, uncovered;
    qm_reconstruction_coverage(r, &points, &uncovered);
    if (p->options->as_json) {
        qm_text text = {0};
        qm_text_add_string(&text, "{");
        qm_json_add_string(&text, "mesh", p->options->output);
        qm_json_add_count(&text, "quads", quads);
        qm_json_add_count(&text, "patch_count", qm_reconstruction_patch_count(r));
        qm_json_add_count(&text, "step_count", p->step_count);
        qm_json_add_string(&text, "stopped_by", qm_refine_stop_name(stop));
        qm_json_open(&text, "coverage", "{");
        qm_json_add_count(&text, "samples", points);
        qm_json_add_count(&text, "uncovered_samples", uncovered);
        qm_text_add_string(&text, "}");
        qm_json_add_warnings(&text, r);
        if (settled) qm_json_add_settled(&text, settled, p->diagonal);
        qm_text_add_string(&text, "}");
        char *line = qm_text_take(&text);
        fprintf(p->out, "%s\n", line ? line : "{}");
        free(line);
        return;
    }
    qm_reconstruction_warning warning[WARNINGS_SHOWN];
    size_t count = qm_reconstruction_find_warnings(r, warning, WARNINGS_SHOWN);
    for (size_t i = 0; i < count && i < WARNINGS_SHOWN; i++) {
        char text[QM_WARNING_TEXT];
        qm_json_warning_text(&warning[i], text);
        fprintf(stderr, "%s: %s\n", p->options->output, text);
    }
    fprintf(p->out, "%s: %zu quads in %zu patches; %.2f %% of the surface is covered; stopped by %s\n",
            p->options->output, quads, qm_reconstruction_patch_count(r),
            100.0 * (double)(points - uncovered) / (double)points, qm_refine_stop_name(stop));
}

static bool write_picture(const reconstruct_options *options, const qm_mesh *mesh)
{
    if (!options->picture || cli_write_picture(options->picture, mesh)) return true;
    cli_report_unwritable(options->picture, options->as_json);
    return false;
}

/**
 * True if the vertices move at the end: on a mesh that has no noise, which settled quads would follow. That it cannot be done is told
 * if it was asked for.
 */
static bool will_settle(const reconstruct_options *options, const qm_ref_surface *source,
                        const qm_reconstruction *r)
{
    bool has_noise = qm_reconstruction_noise(r) > 0.0;
    if (options->settles && has_noise)
        fputs("quadmesh: not settled: settled quads would follow the noise of the surface\n", stderr);
    return !has_noise &&
           (options->settles || !(options->keeps_vertices || options->keeps_curves || source->is_cloud));
}

/** Takes the steps and writes the mesh. Returns the exit status. */
static int refine_and_write(qm_context *ctx, const reconstruct_options *options, const qm_ref_surface *source,
                            qm_reconstruction *r)
{
    printer p = {options, strcmp(options->output, "-") == 0 ? stderr : stdout, source->diagonal, 0};
    qm_refine_stop stop;
    qm_status status = qm_refine(ctx, r, source, &options->goal, on_step, &p, &stop);
    ctx->cancel = NULL; /* the mesh is written, also after an interrupt */
    qm_mesh mesh = {0};
    bool is_settled = status == QM_OK && stop != QM_REFINE_CANCELED && will_settle(options, source, r);
    qm_settled settled;
    if (is_settled) {
        qm_settle_goal goal = {.quads = qm_quads_options_default(), .distance = options->goal.hausdorff};
        goal.quads.thread_count = options->goal.thread_count;
        status = qm_settle_reconstruction(ctx, source, &goal, r, &mesh, &settled);
    } else if (status == QM_OK) {
        status = qm_reconstruction_mesh(ctx, r, &mesh);
    }
    if (status != QM_OK) {
        cli_report_status(options->surface, status, ctx, options->as_json);
        return EXIT_BAD_INPUT;
    }
    if (is_settled) print_settled(&p, &settled);
    bool is_done = cli_write_mesh(ctx, options->output, &mesh, options->has_uv, options->as_json) &&
                   write_picture(options, &mesh);
    if (is_done) print_result(&p, r, mesh.face_count, stop, is_settled ? &settled : NULL);
    qm_mesh_reset(ctx, &mesh);
    bool is_reached =
        stop != QM_REFINE_CANCELED &&
        (!(options->goal.hausdorff > 0.0) || stop == QM_REFINE_HAUSDORFF ||
         (is_settled && qm_settle_two_sided(&settled.distance).upper <= options->goal.hausdorff));
    return !is_done ? EXIT_BAD_INPUT : is_reached ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static int reconstruct(qm_context *ctx, reconstruct_options *options, const qm_loaded_mesh *surface)
{
    qm_ref_surface source;
    qm_layout layout;
    qm_status status = qm_ref_surface_init(ctx, surface->bvh, &source);
    if (status != QM_OK) {
        cli_report_status(options->surface, status, ctx, options->as_json);
        return EXIT_BAD_INPUT;
    }
    if (!load_layout(ctx, options, &source, &layout)) return EXIT_BAD_INPUT;
    options->goal.hausdorff = options->hausdorff * source.diagonal;
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.pull_curves = !options->keeps_curves;
    how.noise_share = options->noise;
    how.thread_count = options->goal.thread_count;
    qm_reconstruction *r;
    status = qm_reconstruction_create(ctx, &source, &layout, &how, &r);
    qm_layout_reset(ctx, &layout);
    if (status != QM_OK) {
        cli_report_status(options->layout, status, ctx, options->as_json);
        return EXIT_BAD_INPUT;
    }
    int result = refine_and_write(ctx, options, &source, r);
    qm_reconstruction_destroy(ctx, r);
    return result;
}

static bool read_noise(const char *text, void *target)
{
    double *noise = target;
    char *end;
    if (strcmp(text, "auto") == 0) return *noise = QM_NOISE_AUTOMATIC, true;
    *noise = strtod(text, &end);
    if (end != text && *end == '\0' && *noise >= 0.0 && *noise <= QM_NOISE_MAX) return true;
    fprintf(stderr, "quadmesh: --noise takes auto or a number from 0 to %g, not '%s'\n", QM_NOISE_MAX, text);
    return false;
}

static int run(int argc, char **argv)
{
    reconstruct_options o = {.goal = {.measures = true}, .noise = QM_NOISE_AUTOMATIC};
    bool skips_measuring = false;
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .is_required = true,
         .target = &o.output,
         .help = "the mesh, in the format of its name, else PLY; - is standard output, and the lines about\n"
                 "the steps then go to standard error"},
        {.name = "quads",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e15,
         .target = &o.goal.max_quads,
         .help = "max quads; 10000 if there is no other goal"},
        {.name = "distance",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.hausdorff,
         .help = "until the distance to the surface is at most X, as a fraction of the surface's diagonal"},
        {.name = "hausdorff",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.hausdorff,
         .help = "the former name of --distance"},
        {.name = "edge",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.goal.edge,
         .help = "until no mean edge is longer than X, in the unit of the surface"},
        {.name = "steps",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e15,
         .target = &o.goal.steps,
         .help = "max steps"},
        {.name = "no-measure",
         .type = CLI_FLAG,
         .target = &skips_measuring,
         .help = "do not measure the distance after each step"},
        {.name = "keep-curves",
         .type = CLI_FLAG,
         .target = &o.keeps_curves,
         .help = "keep vertices of curves where they were drawn, on the surface or not"},
        {.name = "noise",
         .value = "X",
         .type = CLI_CUSTOM,
         .read = read_noise,
         .target = &o.noise,
         .help =
             "how far points, or vertices of a mesh, are off the surface: their standard deviation, as a\n"
             "fraction of the diagonal, to 0.1; the mesh is then fitted to them, as smooth as they allow. "
             "0:\n"
             "they are exact. auto (default): found from the points"},
        {.name = "settle",
         .type = CLI_FLAG,
         .target = &o.settles,
         .help =
             "move all vertices at the end, those of curves too, for better quads nearer to the surface;\n"
             "sides along its creases and boundaries stay there, vertices of sharp curves on these, those\n"
             "of fixed ones and corners where they are (default on a mesh without noise)"},
        {.name = "no-settle",
         .type = CLI_FLAG,
         .target = &o.keeps_vertices,
         .help = "leave vertices where the steps put them, those of curves on these"},
        {.name = "picture",
         .value = "FILE.png",
         .type = CLI_TEXT,
         .target = &o.picture,
         .help = "a picture of the mesh"},
        CLI_OPTION_UV(&o.has_uv),
        CLI_OPTION_THREADS(&o.goal.thread_count),
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "steps and, last, the result as JSON, one object a line"}};
    const char *paths[2];
    int status;
    if (!cli_read_options(&cmd_reconstruct, options, sizeof options / sizeof *options, argc, argv, paths,
                          &status))
        return status;
    o.surface = paths[0];
    o.layout = paths[1];
    if (o.settles && (o.keeps_curves || o.keeps_vertices)) {
        fprintf(stderr, "quadmesh: --settle moves what %s keeps: give one of them\n",
                o.keeps_curves ? "--keep-curves" : "--no-settle");
        return EXIT_USAGE;
    }
    o.goal.measures = !skips_measuring;
    o.goal.thread_count = cli_count_threads(o.goal.thread_count);
    if (o.has_uv && !cli_check_uv(o.output)) return EXIT_USAGE;
    if (!cli_check_writable(o.output, o.as_json)) return EXIT_BAD_INPUT;
    if (o.picture && !cli_check_writable(o.picture, o.as_json)) return EXIT_BAD_INPUT;
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_preparation preparation = {.parts = QM_BVH_TARGET, .thread_count = o.goal.thread_count};
    qm_loaded_mesh surface;
    if (!cli_load_mesh(&ctx, o.surface, o.as_json, &preparation, &surface)) return EXIT_BAD_INPUT;
    status = reconstruct(&ctx, &o, &surface);
    qm_loaded_mesh_reset(&ctx, &surface);
    return status;
}

const cli_command cmd_reconstruct = {
    .name = "reconstruct",
    .arguments = "SURFACE LAYOUT -o OUT [options]",
    .summary = "a quad mesh from a layout of curves",
    .takes = "a surface and a layout",
    .path_count = 2,
    .description = "Makes a semi-regular quad mesh of a point set or a mesh, from a layout of boundary "
                   "curves (JSON:\nnodes, curves and patches; patches are found if the file has none).\n",
    .exit_status =
        "Exit status: 0 done, 2 bad input or wrong usage, 3 the distance was not reached, or interrupted.",
    .run = run};
