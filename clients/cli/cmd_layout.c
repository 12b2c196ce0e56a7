/**
 * cmd_layout.c: a layout of few patches from a mesh of quads, or from a surface by quads of its own; or curves along a surface's
 * creases and boundaries.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "ops/faced_surface.h"
#include "ops/json_layout.h"
#include "options.h"
#include "qm/quad_layout.h"

typedef struct layout_options {
    const char *path, *surface,
        *output; /* path: of the quads, or with is_auto or has_features of the surface */
    qm_layout_features_options features;
    qm_quad_layout_options make;
    qm_quads_options quads;
    qm_symmetry_wish symmetry;
    double crease_angle; /* NAN: not given */
    bool is_auto, has_features, as_json;
} layout_options;

/** The layout as JSON, of the members that reconstruct reads. */
static bool write_layout(const layout_options *options, const qm_layout *layout)
{
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_layout(&text, layout);
    qm_text_add_string(&text, "}\n");
    char *bytes = qm_text_take(&text);
    bool is_written = bytes && cli_write_file(options->output, bytes, strlen(bytes));
    free(bytes);
    if (!is_written) cli_report_unwritable(options->output, options->as_json);
    return is_written;
}

static void print_facts(const layout_options *options, const qm_quad_layout_facts *facts,
                        const qm_layout_issues *issues)
{
    FILE *out = strcmp(options->output, "-") == 0 ? stderr : stdout;
    qm_text text = {0};
    if (options->as_json) {
        qm_text_add_string(&text, "{");
        qm_json_add_count(&text, "quads", facts->quads);
        qm_json_add_count(&text, "required_nodes", facts->required);
        qm_json_add_count(&text, "regions", facts->regions);
        qm_json_add_count(&text, "patches", facts->patches);
        qm_json_add_comma(&text);
        qm_json_add_layout_issues(&text, issues);
        qm_text_add_string(&text, "}");
    } else {
        qm_text_printf(&text, "%s: %zu patches of %zu quads, %zu required nodes", options->output,
                       facts->patches, facts->quads, facts->required);
        for (size_t i = 0; i < issues->count; i++) {
            char words[QM_ISSUE_TEXT];
            const qm_layout_issue *issue = &issues->items[i];
            qm_layout_issue_text(issue, words);
            if (issue->fault == QM_LAYOUT_CROSSING)
                qm_text_printf(&text, "\ncurves %u and %u cross at %.9g %.9g %.9g", issue->curve[0],
                               issue->curve[1], issue->position[0], issue->position[1], issue->position[2]);
            else
                qm_text_printf(&text, "\n%s", words);
        }
    }
    char *line = qm_text_take(&text);
    fprintf(out, "%s\n", line ? line : "{}");
    free(line);
}

static void print_curves(const layout_options *options, const qm_layout *layout,
                         const qm_layout_issues *issues)
{
    FILE *out = strcmp(options->output, "-") == 0 ? stderr : stdout;
    qm_text text = {0};
    if (options->as_json) {
        qm_text_add_string(&text, "{");
        qm_json_add_count(&text, "curves", layout->curve_count);
        qm_json_add_count(&text, "corners", layout->corner_count);
        qm_json_add_count(&text, "patches", layout->patch_count);
        qm_json_add_comma(&text);
        qm_json_add_layout_issues(&text, issues);
        qm_text_add_string(&text, "}");
    } else {
        qm_text_printf(&text, "%s: %zu curves along features, %zu corners, %zu patches", options->output,
                       layout->curve_count, layout->corner_count, layout->patch_count);
        for (size_t i = 0; i < issues->count; i++) {
            char words[QM_ISSUE_TEXT];
            qm_layout_issue_text(&issues->items[i], words);
            qm_text_printf(&text, "\n%s", words);
        }
    }
    char *line = qm_text_take(&text);
    fprintf(out, "%s\n", line ? line : "{}");
    free(line);
}

/** A layout of the features of a surface, with the patches that they bound. */
static int make_of_features(qm_context *ctx, const layout_options *options, const qm_bvh *bvh)
{
    qm_ref_surface source;
    qm_layout layout = {0};
    qm_layout_issues issues = {0};
    size_t added;
    qm_status status = qm_ref_surface_init(ctx, bvh, &source);
    if (status == QM_OK) status = qm_layout_add_features(ctx, &layout, &source, &options->features, &added);
    if (status == QM_OK) status = qm_layout_find_patches(ctx, &source, &layout, &issues);
    bool is_written = false;
    if (status == QM_OK)
        is_written = write_layout(options, &layout);
    else
        cli_report_status(options->path, status, ctx, options->as_json);
    if (is_written) print_curves(options, &layout, &issues);
    qm_layout_reset(ctx, &layout);
    qm_layout_issues_reset(ctx, &issues);
    return is_written ? EXIT_OK : EXIT_BAD_INPUT;
}

/** Makes the layout, of a surface by quads that are made of it, or of its points; or of quads. */
static qm_status make_layout(qm_context *ctx, layout_options *options, const qm_mesh *quads,
                             const qm_ref_surface *source, qm_layout *layout, qm_layout_issues *issues,
                             qm_quad_layout_facts *facts)
{
    if (!options->is_auto)
        return qm_quad_layout_make(ctx, quads, source, &options->make, layout, issues, facts);
    qm_faced_surface faced;
    qm_status status = qm_faced_surface_make(ctx, source, options->quads.thread_count, &faced);
    if (status == QM_OK)
        status = qm_symmetric_layout_make(ctx, &faced.surface, &options->symmetry, &options->quads,
                                          &options->make, layout, issues, facts);
    qm_faced_surface_reset(ctx, &faced);
    return status;
}

/** bvh is of the surface, and quads is not used with is_auto. */
static int make(qm_context *ctx, layout_options *options, const qm_mesh *quads, const qm_bvh *bvh)
{
    qm_ref_surface source;
    qm_layout layout;
    qm_layout_issues issues;
    qm_quad_layout_facts facts;
    qm_status status = qm_ref_surface_init(ctx, bvh, &source);
    if (status == QM_OK) status = make_layout(ctx, options, quads, &source, &layout, &issues, &facts);
    if (status != QM_OK) {
        cli_report_status(options->path, status, ctx, options->as_json);
        return EXIT_BAD_INPUT;
    }
    bool is_written = write_layout(options, &layout);
    if (is_written) print_facts(options, &facts, &issues);
    qm_layout_reset(ctx, &layout);
    qm_layout_issues_reset(ctx, &issues);
    return is_written ? EXIT_OK : EXIT_BAD_INPUT;
}

/** What was not given, of the quads or of the surface. */
static void set_defaults(layout_options *o)
{
    const qm_quads_options usual = qm_quads_options_default();
    bool has_angle = !isnan(o->crease_angle);
    if (o->quads.quads == 0) o->quads.quads = usual.quads;
    o->quads.crease_angle = has_angle ? o->crease_angle : usual.crease_angle;
    o->quads.thread_count = cli_count_threads(o->quads.thread_count);
    if (has_angle) o->make.crease_angle = o->features.angle = o->crease_angle;
}

/** Reads "found", or six numbers between commas. */
static bool read_symmetry(const char *text, void *target)
{
    qm_symmetry_wish *wish = target;
    if (strcmp(text, "found") == 0) return *wish = (qm_symmetry_wish){.finds = true}, true;
    wish->is_given = qm_json_read_plane_text(text, wish->point, wish->normal);
    if (!wish->is_given)
        fprintf(stderr,
                "quadmesh: --symmetry takes found, or a point and a normal as six numbers between commas, "
                "not '%s'\n",
                text);
    return wish->is_given;
}

static int run(int argc, char **argv)
{
    layout_options o = {.make = qm_quad_layout_options_default(),
                        .quads = qm_quads_options_default(),
                        .features = qm_layout_features_options_default(),
                        .crease_angle = NAN};
    o.quads.quads = 0;        /* not given */
    o.quads.thread_count = 0; /* one for each processor */
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .is_required = true,
         .target = &o.output,
         .help = "the layout as JSON, for reconstruct; - is standard output, and the counts then go to "
                 "standard error"},
        {.name = "surface",
         .value = "SURFACE",
         .type = CLI_TEXT,
         .target = &o.surface,
         .help = "the mesh or point set that the curves lie on; the quads themselves if not given"},
        {.name = "auto",
         .type = CLI_FLAG,
         .target = &o.is_auto,
         .help = "the file is any surface of triangles and quads, or a point set: make quads of it first"},
        {.name = "features",
         .type = CLI_FLAG,
         .target = &o.has_features,
         .help = "the file is any surface of triangles and quads: its creases and boundaries alone become "
                 "curves"},
        {.name = "shortest",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.features.shortest,
         .help = "with --features: leave out those that are shorter (default 3 % of the diagonal)"},
        {.name = "quads",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e7,
         .target = &o.quads.quads,
         .help = "with --auto: about so many quads (default 5000); fewer give fewer patches, more keep thin "
                 "parts"},
        {.name = "patches",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e9,
         .target = &o.make.patches,
         .help = "divide the layout into nearly N patches, where fewer would do"},
        {.name = "symmetry",
         .value = "PLANE",
         .type = CLI_CUSTOM,
         .read = read_symmetry,
         .target = &o.symmetry,
         .help = "with --auto: lay out one half and mirror it, at the plane that is found, or "
                 "PX,PY,PZ,NX,NY,NZ:\n"
                 "a point and a normal, which points to the half that is laid out"},
        {.name = "crease-angle",
         .value = "DEG",
         .type = CLI_NUMBER,
         .target = &o.crease_angle,
         .help =
             "edges whose faces differ by more are creases, and become curves; 0: none (default; with --auto "
             "and --features 40)"},
        CLI_OPTION_THREADS(&o.quads.thread_count),
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "counts and issues as JSON, or the problem document"}};
    int status;
    if (!cli_read_options(&cmd_layout, options, sizeof options / sizeof *options, argc, argv, &o.path,
                          &status))
        return status;
    if (!cli_check_one_document(&o.output, 1, o.as_json)) return EXIT_USAGE;
    if (o.is_auto ? o.surface != NULL : o.quads.quads > 0) {
        fputs(o.is_auto ? "quadmesh: with --auto the first file is the surface: leave out --surface\n"
                        : "quadmesh: --quads goes with --auto\n",
              stderr);
        return EXIT_USAGE;
    }
    if (!o.is_auto && (o.symmetry.finds || o.symmetry.is_given)) {
        fputs("quadmesh: --symmetry goes with --auto\n", stderr);
        return EXIT_USAGE;
    }
    if (o.has_features && (o.is_auto || o.surface || o.make.patches > 0)) {
        fputs("quadmesh: --features goes without --auto, --surface and --patches\n", stderr);
        return EXIT_USAGE;
    }
    if (!o.has_features && o.features.shortest != 0.0) {
        fputs("quadmesh: --shortest goes with --features\n", stderr);
        return EXIT_USAGE;
    }
    if (!cli_check_writable(o.output, o.as_json)) return EXIT_BAD_INPUT;
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_preparation as_target = {.parts = QM_BVH_TARGET, .thread_count = 1},
                         as_quads = {
                             .has_no_tree = o.surface != NULL, .parts = QM_BVH_TARGET, .thread_count = 1};
    set_defaults(&o);
    qm_loaded_mesh quads, surface = {0};
    if (!cli_load_mesh(&ctx, o.path, o.as_json, &as_quads, &quads)) return EXIT_BAD_INPUT;
    bool is_loaded = !o.surface || cli_load_mesh(&ctx, o.surface, o.as_json, &as_target, &surface);
    if (o.has_features)
        status = make_of_features(&ctx, &o, quads.bvh);
    else
        status =
            is_loaded ? make(&ctx, &o, &quads.mesh, o.surface ? surface.bvh : quads.bvh) : EXIT_BAD_INPUT;
    if (is_loaded) qm_loaded_mesh_reset(&ctx, &surface);
    qm_loaded_mesh_reset(&ctx, &quads);
    return status;
}

const cli_command cmd_layout = {
    .name = "layout",
    .arguments = "QUADS -o OUT [options], or SURFACE --auto|--features -o OUT [options]",
    .summary = "a layout of few patches from a mesh of quads, or from any surface",
    .takes = "one mesh",
    .path_count = 1,
    .description =
        "Makes a layout for reconstruct: patches of four sides, with "
        "nodes at the irregular vertices of the quads\n"
        "and curves along their boundaries and creases. With --auto the quads are made first. With\n"
        "--features only curves along creases and boundaries are made, to go on from.\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage.",
    .run = run};
