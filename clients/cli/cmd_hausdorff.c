/**
 * cmd_hausdorff.c: `quadmesh hausdorff A B`: the distance between two files, in this process or by a daemon.
 */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli.h"
#include "json_out.h"
#include "parallel.h"
#include "progress.h"
#include "remote.h"

#define MAX_THREADS 256

static const char help[] =
    "usage: quadmesh hausdorff [OPTION]... A B\n\n"
    "Measures the Hausdorff distance between the surfaces of two mesh files as proven bounds.\n\n"
    "  --direction D     two_sided (default), a_to_b or b_to_a\n"
    "  --quads R         a quad is two triangles (triangles, default) or a bilinear patch (bilinear)\n"
    "  --tolerance X     how far the bounds may lie apart [1e-6], as a share of the diagonal of A's box\n"
    "  --absolute        the tolerance is a length instead\n"
    "  --threshold X     stop once it is certain whether the distance is above the length X\n"
    "  --deadline-ms N   stop after so much search, with the bounds found by then\n"
    "  --threads N       threads of the search [as many as there are processors]\n"
    "  --server URL      let the daemon at URL measure\n"
    "  --json            the result object of the service, or its problem document\n"
    "  --help            this text\n\n"
    "Progress goes to stderr. Ctrl-C once ends the search with the bounds found so far, twice ends the "
    "program.\n\n"
    "Exit status: 0 converged, or the side of the threshold is certain; 1 a file or the daemon is at fault;\n"
    "2 usage; 3 the bounds hold, but lie farther apart than the tolerance.\n";

typedef struct command_line {
    qm_job_request request;
    const char *paths[2];
    const char *server; /* NULL: in this process */
    bool as_json;
} command_line;

/* ---- reading the command line ---- */

enum { DIRECTION = 256, QUADS, TOLERANCE, ABSOLUTE, THRESHOLD, DEADLINE, THREADS, SERVER, JSON, HELP };

static const struct option options[] = {{"direction", required_argument, NULL, DIRECTION},
                                        {"quads", required_argument, NULL, QUADS},
                                        {"tolerance", required_argument, NULL, TOLERANCE},
                                        {"absolute", no_argument, NULL, ABSOLUTE},
                                        {"threshold", required_argument, NULL, THRESHOLD},
                                        {"deadline-ms", required_argument, NULL, DEADLINE},
                                        {"threads", required_argument, NULL, THREADS},
                                        {"server", required_argument, NULL, SERVER},
                                        {"json", no_argument, NULL, JSON},
                                        {"help", no_argument, NULL, HELP},
                                        {NULL, 0, NULL, 0}};

/** A finite number; false when the text is anything else. */
static bool read_number(const char *text, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return end != text && !*end && isfinite(*out);
}

static bool read_direction(const char *text, qm_direction *out)
{
    if (strcmp(text, "two_sided") == 0) return *out = QM_TWO_SIDED, true;
    if (strcmp(text, "a_to_b") == 0) return *out = QM_A_TO_B, true;
    if (strcmp(text, "b_to_a") == 0) return *out = QM_B_TO_A, true;
    return false;
}

static bool read_quads(const char *text, qm_quad_reading *out)
{
    if (strcmp(text, "triangles") == 0) return *out = QM_QUADS_TRIANGLES, true;
    if (strcmp(text, "bilinear") == 0) return *out = QM_QUADS_BILINEAR, true;
    return false;
}

/** One option; NULL when it is fine, else what it should have been. */
static const char *read_option(int option, const char *value, command_line *out)
{
    double threads;
    switch (option) {
    case DIRECTION:
        return read_direction(value, &out->request.direction) ? NULL : "two_sided, a_to_b or b_to_a";
    case QUADS:
        return read_quads(value, &out->request.quads) ? NULL : "triangles or bilinear";
    case TOLERANCE:
        return read_number(value, &out->request.tolerance) && out->request.tolerance > 0.0
                   ? NULL
                   : "a number above 0";
    case THRESHOLD:
        return read_number(value, &out->request.threshold) && out->request.threshold >= 0.0
                   ? NULL
                   : "a number of 0 or more";
    case DEADLINE:
        return read_number(value, &out->request.deadline_ms) && out->request.deadline_ms > 0.0
                   ? NULL
                   : "a number above 0";
    case THREADS:
        if (!read_number(value, &threads) ||
            !(threads >= 1 && threads <= MAX_THREADS && threads == floor(threads)))
            return "a whole number from 1 to 256";
        out->request.threads = (int)threads;
        return NULL;
    case ABSOLUTE:
        out->request.tolerance_is_absolute = true;
        return NULL;
    case SERVER:
        out->server = value;
        return NULL;
    default:
        out->as_json = true;
        return NULL;
    }
}

/** QM_EXIT_OK when there is something to do; *is_help when the text was asked for. */
static qm_exit read_command_line(int argc, char **argv, command_line *out, bool *is_help)
{
    *out = (command_line){.request = qm_job_request_default()};
    for (int option, place; (option = getopt_long(argc, argv, "", options, &place)) != -1;) {
        if (option == '?') return fprintf(stderr, "`%s --help` tells more\n", argv[0]), QM_EXIT_USAGE;
        if (option == HELP) return *is_help = true, QM_EXIT_OK;
        const char *expected = read_option(option, optarg, out);
        if (!expected) continue;
        fprintf(stderr, "%s: --%s takes %s, got \"%s\"\n", argv[0], options[place].name, expected, optarg);
        return QM_EXIT_USAGE;
    }
    if (optind + 2 != argc) {
        fprintf(stderr, "%s: two files are needed, A and B\n`%s --help` tells more\n", argv[0], argv[0]);
        return QM_EXIT_USAGE;
    }
    out->paths[0] = argv[optind];
    out->paths[1] = argv[optind + 1];
    return QM_EXIT_OK;
}

/* ---- measuring ---- */

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    qm_progress_view_show(user, progress);
}

static qm_progress_view make_view(const qm_job_request *request, double diagonal)
{
    bool is_absolute = request->tolerance_is_absolute || diagonal == 0.0;
    return qm_progress_view_make(is_absolute ? request->tolerance : request->tolerance * diagonal, diagonal);
}

static bool measure_loaded(qm_context *ctx, const command_line *line, const qm_loaded_mesh *a,
                           const qm_loaded_mesh *b, qm_job_result *out, qm_problem *problem)
{
    qm_job_request request = line->request;
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    if (request.threads == 0)
        request.threads = processors < 1 ? 1 : processors > MAX_THREADS ? MAX_THREADS : (int)processors;
    qm_progress_view view = make_view(&request, a->diagonal);
    qm_status status = qm_job_run_hausdorff(ctx, &request, a, b, on_progress, &view, out);
    qm_progress_view_end(&view);
    if (status != QM_OK) *problem = qm_problem_from_status(status, ctx->message);
    return status == QM_OK;
}

static bool measure_here(const command_line *line, qm_job_result *out, qm_problem *problem)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_parallel_run;
    qm_loaded_mesh meshes[2];
    int loaded = 0;
    while (loaded < 2 && qm_cli_load(&ctx, line->paths[loaded], &meshes[loaded], problem))
        loaded++;
    /* An interrupt while files are read ends the program as usual: there are no bounds yet to tell. */
    if (loaded == 2) ctx.cancel = qm_cli_catch_interrupt();
    bool is_done = loaded == 2 && measure_loaded(&ctx, line, &meshes[0], &meshes[1], out, problem);
    while (loaded > 0)
        qm_loaded_mesh_reset(&ctx, &meshes[--loaded]);
    return is_done;
}

/** Uploads both files and lets the daemon measure; the ids of the meshes become part of the request. */
static bool measure_there(command_line *line, qm_job_result *out, qm_problem *problem)
{
    qm_remote *remote = qm_remote_create(line->server);
    if (!remote) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "the address of the server is too long");
        return false;
    }
    double diagonal_a = 0.0, diagonal_b;
    bool is_done = qm_remote_upload(remote, line->paths[0], line->request.a, &diagonal_a, problem) &&
                   qm_remote_upload(remote, line->paths[1], line->request.b, &diagonal_b, problem);
    if (is_done) {
        qm_progress_view view = make_view(&line->request, diagonal_a);
        out->diagonal = diagonal_a;
        is_done =
            qm_remote_run(remote, &line->request, qm_cli_catch_interrupt(), on_progress, &view, out, problem);
        qm_progress_view_end(&view);
    }
    qm_remote_destroy(remote);
    return is_done;
}

/* ---- telling the result ---- */

static void add_interval(qm_text *out, const char *label, double lower, double upper)
{
    char low[QM_JSON_NUMBER_SIZE], high[QM_JSON_NUMBER_SIZE];
    bool is_known = isfinite(upper);
    qm_text_printf(out, "%-12s %s <= h%s%s", label, qm_json_number(lower, low), is_known ? " <= " : "",
                   is_known ? qm_json_number(upper, high) : "");
}

static void add_surface_point(qm_text *out, const char *mesh, uint32_t face, const qm_surface_point *point)
{
    qm_text_printf(out, "%s face %u (%.9g, %.9g, %.9g)", mesh, face, point->position[0], point->position[1],
                   point->position[2]);
}

static void write_words(qm_text *out, const qm_job_result *result)
{
    static const char *const ends[] = {"converged", "the side of the threshold is certain",
                                       "stopped by the deadline", "stopped by an interrupt",
                                       "stopped where double precision ends"};
    const qm_hausdorff_result *h = &result->hausdorff;
    const char *from = h->from_side == 0 ? "A" : "B", *to = h->from_side == 0 ? "B" : "A";
    add_interval(out, "distance", h->lower, h->upper);
    if (result->diagonal > 0.0)
        qm_text_printf(out, "\n%-12s %.3e of the diagonal of A, %.9g; the gap is %.1e of it", "",
                       h->lower / result->diagonal, result->diagonal,
                       (h->upper - h->lower) / result->diagonal);
    if (h->has_witness) {
        qm_text_printf(out, "\n%-12s ", "witness");
        add_surface_point(out, from, result->from_face, &h->from);
        qm_text_add_string(out, " to ");
        add_surface_point(out, to, result->to_face, &h->to);
    }
    qm_text_printf(out, "\n%-12s %.1f ms after %.1f ms for A and %.1f ms for B", "time", h->elapsed_ms,
                   result->prepare_a_ms, result->prepare_b_ms);
    qm_text_printf(out, "\n%-12s %llu pieces, %llu projections, queue of %zu at most", "work",
                   (unsigned long long)h->iterations, (unsigned long long)h->projections, h->max_queue);
    if (h->verdict != 0)
        qm_text_printf(out, "\n%-12s %s the threshold", "verdict", h->verdict > 0 ? "above" : "not above");
    qm_text_printf(out, "\n%-12s %s", "end", ends[h->stop]);
}

qm_exit qm_cli_hausdorff(int argc, char **argv)
{
    command_line line;
    bool is_help = false;
    qm_exit usage = read_command_line(argc, argv, &line, &is_help);
    if (is_help) return fputs(help, stdout), QM_EXIT_OK;
    if (usage != QM_EXIT_OK) return usage;
    qm_job_result result = {0};
    qm_problem problem;
    bool is_done =
        line.server ? measure_there(&line, &result, &problem) : measure_here(&line, &result, &problem);
    if (!is_done) return qm_cli_fail(&problem, line.as_json);
    qm_text out = {0};
    if (line.as_json)
        qm_json_write_result(&out, &line.request, &result);
    else
        write_words(&out, &result);
    if (!qm_cli_print(&out)) return QM_EXIT_INPUT;
    bool is_settled =
        result.hausdorff.stop == QM_STOP_CONVERGED || result.hausdorff.stop == QM_STOP_THRESHOLD;
    return is_settled ? QM_EXIT_OK : QM_EXIT_NOT_CONVERGED;
}
