/**
 * cmd_compare.c: two meshes compared both ways: a table of proven intervals.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/json.h"
#include "options.h"

enum {
    DIGITS = 6,
    NAME_WIDTH = 12,
    CELL_WIDTH = 32,
    CELL_SIZE = 2 * CLI_BOUND_SIZE + 8,
    PRINTED_REGIONS = 10,
    BAND_NAME_SIZE = 2 * CLI_BOUND_SIZE + 8
};

/** Signed limits: how far A may be inside of B, and outside; NAN for none. */
typedef struct signed_limits {
    double in, out;
} signed_limits;

/* ---- the table ---- */

/** How a bound is printed. */
typedef char *format_fn(double bound, bool is_upper, char out[CLI_BOUND_SIZE]);

static char *format_length(double bound, bool is_upper, char out[CLI_BOUND_SIZE])
{
    return cli_format_digits(bound, is_upper, DIGITS, out);
}

/** Both ends with few digits, rounded outward; one number where they are equal. */
static void format_interval(const qm_json *result, const char *path, format_fn *format, char out[CELL_SIZE])
{
    char at[96], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    snprintf(at, sizeof at, "%s.lower", path);
    double lower = qm_json_get_number(result, at);
    snprintf(at, sizeof at, "%s.upper", path);
    double upper = qm_json_get_number(result, at);
    format(lower, false, low);
    format(isnan(upper) ? INFINITY : upper, true, high); /* null: it does not fit into a double */
    bool is_one = strcmp(low, high) == 0;
    snprintf(out, CELL_SIZE, "%s%s%s", low, is_one ? "" : " to ", is_one ? "" : high);
}

/** A row of one figure in both directions, or in that of A alone. */
static void print_sides(const qm_json *result, const char *name, const char *path, bool has_both,
                        format_fn *format)
{
    char cell[2][CELL_SIZE] = {"", ""}, at[80];
    for (int side = 0; side < 1 + has_both; side++) {
        snprintf(at, sizeof at, "%s.%s", side == 0 ? "a_to_b" : "b_to_a", path);
        format_interval(result, at, format, cell[side]);
    }
    printf("  %-*s%-*s%s%s\n", NAME_WIDTH, name, has_both ? CELL_WIDTH : 0, cell[0], has_both ? "  " : "",
           cell[1]);
}

static void print_row(const qm_json *result, const char *name, const char *path, format_fn *format)
{
    print_sides(result, name, path, true, format);
}

static void print_both(const qm_json *result, const char *name, const char *path, const char *note)
{
    char cell[CELL_SIZE];
    format_interval(result, path, format_length, cell);
    printf("  %-*s%-*s%s%s\n", NAME_WIDTH, name, note ? CELL_WIDTH : 0, cell, note ? "  " : "",
           note ? note : "");
}

/** What a side is, where it is not measured by its area. */
static void print_measures(const qm_json *result)
{
    for (int side = 0; side < 2; side++) {
        const char *over = qm_json_get_string(result, side == 0 ? "a_to_b.over" : "b_to_a.over");
        if (over && strcmp(over, "area") != 0)
            printf("  %c is measured over its %s\n", side == 0 ? 'A' : 'B', over);
    }
}

static void print_limits(const cli_job *job, const qm_json *result)
{
    char name[CLI_BOUND_SIZE], path[64], cell[CELL_SIZE];
    if (job->request.limit_count == 0) return;
    printf("\n  %-*s%-*s  %s\n", NAME_WIDTH, "within", CELL_WIDTH, "% of A", "% of B");
    for (size_t i = 0; i < job->request.limit_count; i++) {
        snprintf(name, sizeof name, "%.6g", job->request.limits[i]);
        snprintf(path, sizeof path, "shares.%zu", i);
        print_row(result, name, path, cli_format_percent);
    }
    printf("\n  %-*s%s\n", NAME_WIDTH, "within", "F-score");
    for (size_t i = 0; i < job->request.limit_count; i++) {
        snprintf(name, sizeof name, "%.6g", job->request.limits[i]);
        snprintf(path, sizeof path, "symmetric.f_score.%zu.f", i);
        format_interval(result, path, format_length, cell);
        printf("  %-*s%s\n", NAME_WIDTH, name, cell);
    }
}

/** The worst places of one direction. */
static void print_places(const qm_json *result, int side)
{
    const char *const direction[2] = {"a_to_b", "b_to_a"};
    char path[96], cell[CELL_SIZE];
    for (size_t i = 0;; i++) {
        snprintf(path, sizeof path, "%s.worst.%zu", direction[side], i);
        if (!qm_json_has(result, path)) break;
        if (i == 0)
            printf("\n  %-*s%-*s  %s\n", NAME_WIDTH, side == 0 ? "worst of A" : "worst of B", CELL_WIDTH,
                   "distance", "face, point");
        format_interval(result, path, format_length, cell);
        printf("  %-*zu%-*s", NAME_WIDTH, i + 1, CELL_WIDTH, cell);
        snprintf(path, sizeof path, "%s.worst.%zu.from.face", direction[side], i);
        printf("  %.0f,", qm_json_get_number(result, path));
        for (int k = 0; k < 3; k++) {
            snprintf(path, sizeof path, "%s.worst.%zu.from.point.%d", direction[side], i, k);
            printf(" %.4g", qm_json_get_number(result, path));
        }
        puts("");
    }
}

/** "below -0.1", "-0.1 to 0.2", "above 0.2" or "all". */
static void name_band(const qm_interval *band, char out[BAND_NAME_SIZE])
{
    if (isfinite(band->lower) && isfinite(band->upper))
        snprintf(out, BAND_NAME_SIZE, "%.6g to %.6g", band->lower, band->upper);
    else if (isfinite(band->upper))
        snprintf(out, BAND_NAME_SIZE, "below %.6g", band->upper);
    else if (isfinite(band->lower))
        snprintf(out, BAND_NAME_SIZE, "above %.6g", band->lower);
    else
        snprintf(out, BAND_NAME_SIZE, "all");
}

/** The share of each surface in each band. A name that is as wide as its column has a line of its own. */
static void print_bands(const cli_job *job, const qm_json *result, bool has_both)
{
    for (size_t i = 0; i < job->request.band_count; i++) {
        char path[64], name[BAND_NAME_SIZE];
        snprintf(path, sizeof path, "signed.bands.%zu", i);
        name_band(&job->request.bands[i], name);
        if (i == 0)
            printf("\n  %-*s%-*s%s\n", NAME_WIDTH, "in the band", has_both ? CELL_WIDTH + 2 : 0, "% of A",
                   has_both ? "% of B" : "");
        if (strlen(name) >= NAME_WIDTH) {
            printf("  %s\n", name);
            name[0] = '\0';
        }
        print_sides(result, name, path, has_both, cli_format_percent);
    }
}

/** The sides of each surface: the greatest distances and the shares in the bands; and why B has none. */
static void print_signed(const cli_job *job, const qm_json *result)
{
    const char *sign = qm_json_get_string(result, "a_to_b.signed.sign");
    if (!sign) return;
    bool has_both = qm_json_has(result, "b_to_a.signed.sign");
    const char *reason = qm_json_get_string(result, "b_to_a.unsigned");
    bool is_normal = strcmp(sign, "normal") == 0;
    printf("\n  positive %s%s\n", is_normal ? "where normals point to" : sign,
           is_normal ? ", which is not proven" : "");
    if (!has_both) printf("  B has no sign against A, which is %s\n", reason ? reason : "not known");
    static const char *const rows[][2] = {
        {"mean", "signed.mean"}, {"outside", "signed.outside.max"}, {"inside", "signed.inside.max"}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        print_sides(result, rows[i][0], rows[i][1], has_both, format_length);
    print_bands(job, result, has_both);
}

/** The parts of a surface that may be beyond the limit. */
static void print_regions(const cli_job *job, const qm_json *result, int side)
{
    const char *const direction[2] = {"a_to_b", "b_to_a"};
    char path[96], cell[2][CELL_SIZE];
    snprintf(path, sizeof path, "%s.region_count", direction[side]);
    if (!qm_json_has(result, path)) return;
    double count = qm_json_get_number(result, path);
    printf("\n  %.0f part%s of %c %s or may be beyond %.6g\n", count, count == 1.0 ? "" : "s", "AB"[side],
           count == 1.0 ? "is" : "are", job->request.threshold);
    for (int i = 0; i < PRINTED_REGIONS && i < (int)count; i++) {
        snprintf(path, sizeof path, "%s.regions.%d.max", direction[side], i);
        format_interval(result, path, format_length, cell[0]);
        snprintf(path, sizeof path, "%s.regions.%d.area", direction[side], i);
        format_interval(result, path, format_length, cell[1]);
        snprintf(path, sizeof path, "%s.regions.%d.surely", direction[side], i);
        printf("  %-*s%-*s  area %s\n", NAME_WIDTH, qm_json_is_true(result, path) ? "surely" : "maybe",
               CELL_WIDTH, cell[0], cell[1]);
    }
}

static void print_text(const cli_job *job, const qm_json *result)
{
    char name[CLI_BOUND_SIZE], path[64];
    printf("A  %s\nB  %s\nquads as %s\n", job->path[0], job->path[1], qm_json_get_string(result, "quads"));
    cli_print_notes(result, "symmetric.hausdorff.");
    print_measures(result);
    printf("\n  %-*s%-*s  %s\n", NAME_WIDTH, "", CELL_WIDTH, "A to B", "B to A");
    print_row(result, "hausdorff", "hausdorff", format_length);
    print_row(result, "mean", "mean", format_length);
    print_row(result, "rms", "rms", format_length);
    print_row(result, "std", "std", format_length);
    for (size_t i = 0; i < job->request.percentile_count; i++) {
        snprintf(name, sizeof name, "%.6g %%", job->request.percentiles[i]);
        snprintf(path, sizeof path, "percentiles.%zu", i);
        print_row(result, name, path, format_length);
    }
    printf("\n  %-*s%s\n", NAME_WIDTH, "", "both");
    print_both(result, "hausdorff", "symmetric.hausdorff", NULL);
    print_both(result, "hd95", "symmetric.hd95", NULL);
    print_both(result, "mean", "symmetric.mean", NULL);
    print_both(result, "rms", "symmetric.rms", NULL);
    print_both(result, "chamfer l1", "symmetric.chamfer.l1", "sum of both means");
    print_both(result, "chamfer l2", "symmetric.chamfer.l2", "sum of both mean squares");
    print_limits(job, result);
    print_signed(job, result);
    print_regions(job, result, 0);
    print_regions(job, result, 1);
    print_places(result, 0);
    print_places(result, 1);
    printf("\n  %.1f ms after %.1f + %.1f ms to prepare, %.0f pieces\n",
           qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
           qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "pieces"));
    if (!qm_json_is_true(result, "accurate"))
        puts("  stopped before the accuracy was reached; the intervals hold");
}

/* ---- the command ---- */

/** Whether A is within the signed limits of B; EXIT_OK without limits. */
static int judge(const signed_limits *limits, const qm_json *result)
{
    const double limit[2] = {limits->in, limits->out};
    static const char *const most[2][2] = {
        {"a_to_b.signed.inside.max.lower", "a_to_b.signed.inside.max.upper"},
        {"a_to_b.signed.outside.max.lower", "a_to_b.signed.outside.max.upper"}};
    int status = EXIT_OK;
    for (int i = 0; i < 2; i++) {
        if (isnan(limit[i])) continue;
        if (qm_json_get_number(result, most[i][0]) > limit[i]) return EXIT_NO;
        if (!(qm_json_get_number(result, most[i][1]) <= limit[i])) status = EXIT_NOT_CONVERGED;
    }
    return status;
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const signed_limits *limits = user;
    qm_json *result = qm_json_parse(output->json);
    if (job->as_json)
        puts(output->json);
    else
        print_text(job, result);
    bool is_accurate = qm_json_is_true(result, "accurate"),
         has_limits = !isnan(limits->in) || !isnan(limits->out);
    int status = has_limits ? judge(limits, result) : is_accurate ? EXIT_OK : EXIT_NOT_CONVERGED;
    qm_json_free(result);
    return status;
}

/** Regions are those beyond the least limit of all; false when there is none. */
static bool settle_regions(const signed_limits *limits, qm_job_request *request)
{
    if (!request->regions) return true;
    double least =
        fmin(isnan(limits->in) ? INFINITY : limits->in, isnan(limits->out) ? INFINITY : limits->out);
    for (size_t i = 0; i < request->limit_count; i++)
        least = fmin(least, request->limits[i]);
    request->threshold = least;
    return isfinite(least);
}

static bool read_limits(const char *text, void *target)
{
    qm_job_request *request = target;
    return cli_read_list("limit", text, -1.0, DBL_MAX, QM_JOB_MAX_LIMITS, request->limits,
                         &request->limit_count);
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_COMPARISON);
    qm_job_request *request = &job.request;
    signed_limits limits = {NAN, NAN};
    const double percentiles[] = {50.0, 95.0, 99.0};
    memcpy(request->percentiles, percentiles, sizeof percentiles);
    request->percentile_count = sizeof percentiles / sizeof *percentiles;
    const cli_option options[] = {
        {.name = "limit",
         .value = "X",
         .type = CLI_CUSTOM,
         .read = read_limits,
         .may_repeat = true,
         .target = request,
         .help = "shares and F-score within this distance, in the unit of the meshes;\n"
                 "may be given several times, or as numbers separated by commas"},
        {.name = "limit-in",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &limits.in,
         .help = "how far A may be inside of B, which is proven closed: the shares of A within and\n"
                 "beyond, and the exit status"},
        {.name = "limit-out",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &limits.out,
         .help = "and how far outside"},
        CLI_OPTIONS_SIGN(request),
        {.name = "regions",
         .type = CLI_FLAG,
         .target = &request->regions,
         .help = "the connected parts that are, or may be, beyond the least limit given"},
        {.name = "worst",
         .value = "K",
         .type = CLI_SIZE,
         .min = 1,
         .max = QM_JOB_MAX_PLACES,
         .target = &request->worst_count,
         .help = "the K worst places in each direction"},
        {.name = "radius",
         .value = "R",
         .type = CLI_NUMBER,
         .target = &request->worst_radius,
         .help = "how far apart they are, in the unit of the meshes (default a twentieth of\n"
                 "the diagonal of A's box)"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_AVERAGES(request),
        CLI_OPTION_GAP(&request->tolerance,
                       "width of the intervals of the maxima, as a fraction of the diagonal "
                       "of A's box\n(default 1e-6)"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        CLI_OPTION_PERCENTILES(request, "50,95,99"),
        CLI_OPTIONS_NOTES(request->notes),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_TRANSFORM(&job.transform, "A"),
        CLI_OPTION_ALIGN(&job.aligns),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_compare, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    if (job.aligns && job.transform) {
        fputs("quadmesh: --align and --transform both move A: give one of them\n", stderr);
        return EXIT_USAGE;
    }
    cli_settle_sign(request);
    if (!cli_add_limit_bands(limits.in, limits.out, request)) return EXIT_USAGE;
    if (!settle_regions(&limits, request)) {
        fputs("quadmesh: --regions takes --limit, --limit-in or --limit-out\n", stderr);
        return EXIT_USAGE;
    }
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, &limits);
}

const cli_command cmd_compare = {
    .name = "compare",
    .arguments = "A B [options]",
    .summary = "two meshes both ways: all figures in one table",
    .takes = "two files",
    .path_count = 2,
    .description = "All of it in one table: both ways and together the Hausdorff distance, mean, rms, "
                   "percentiles and\nChamfer distance, within limits shares and F-scores, by --sign the "
                   "sides; all proven intervals.\nFor a yes or no in a pipeline: check. For a page to hand "
                   "on: report. For one figure alone, which is\nfaster: hausdorff, deviation, distance.\n",
    .exit_status = "Exit status: 0 accurate, 2 bad input, a B that is not closed, or wrong usage, 3 the "
                   "pieces ran out before,\n"
                   "or interrupted; with --limit-in or --limit-out 0 within, 1 beyond, 3 not certain.",
    .run = run};
