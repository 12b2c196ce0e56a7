/**
 * cmd_collide.c: three commands about where surfaces meet or how far they are apart: collide, self-collide,
 * distance. They share their options but for a few.
 */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json_read.h"
#include "remote.h"

#define COMMON_USAGE                                                                                         \
    "  --quads R        how quads are read: triangles (default) or bilinear\n"                               \
    "  --absolute       the tolerance is in the unit of the meshes\n"                                        \
    "  --threads N      threads (default: one for each processor; with --server what the daemon gives)\n"    \
    "  --json           the result object of the API on standard output\n"                                   \
    "  --server URL     ask a daemon instead of this process\n"                                              \
    "\n"
#define PAIRS_USAGE(whose)                                                                                   \
    "  --csv FILE       all pairs as rows face_a,face_b (-o FILE is the same)\n"                             \
    "  --mode M         all pairs (default), the first one, or any\n"                                        \
    "  --limit N        pairs that are told with the place where they meet (default 1000; in words 10)\n"    \
    "  --tolerance X    of bilinear quads, a share of the diagonal of " whose " box (default 1e-6):\n"       \
    "                   pairs nearer than this may be told too\n" COMMON_USAGE                               \
    "Exit status: 0 clear, 1 bad input, 2 wrong usage, 3 interrupted, 4 colliding.\n"

static const char collide_usage[] = "usage: quadmesh collide A B [options]\n"
                                    "\n"
                                    "Which faces of A and B meet, touching included.\n"
                                    "\n" PAIRS_USAGE("A's");
static const char self_usage[] = "usage: quadmesh self-collide MESH [options]\n"
                                 "\n"
                                 "Which faces of a mesh meet besides the corners and edges that they share.\n"
                                 "\n" PAIRS_USAGE("its");
static const char distance_usage[] =
    "usage: quadmesh distance A B [options]\n"
    "\n"
    "Bounds of the least distance between two surfaces.\n"
    "\n"
    "  --tolerance X    width of the interval at which to stop, a share of the diagonal of A's box (default "
    "1e-6)\n" COMMON_USAGE
    "Exit status: 0 done, 1 bad input, 2 wrong usage, 3 interrupted, or the tolerance was not reached.\n";

#define WORDS_LIMIT 10 /* pairs that are told in words */
#define MAX_LISTED 1e5

/** Everything that was asked for. */
typedef struct question {
    const char *usage;
    const char *path[2]; /* the second is NULL for one mesh */
    const char *csv, *server;
    qm_job_request request;
    bool as_json;
} question;

/* ---- what is shown ---- */

static void print_place(const qm_json *result, size_t pair)
{
    char path[64];
    snprintf(path, sizeof path, "pairs.%zu.contact", pair);
    printf("%s at", qm_json_get_string(result, path));
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "pairs.%zu.points.%d", pair, i);
        if (!qm_json_has(result, path)) break;
        if (i == 1) fputs(" to", stdout);
        for (int k = 0; k < 3; k++) {
            snprintf(path, sizeof path, "pairs.%zu.points.%d.%d", pair, i, k);
            printf(" %.9g", qm_json_get_number(result, path));
        }
    }
}

static void print_pairs(const qm_json *result)
{
    double count = qm_json_get_number(result, "count");
    printf("%.0f pair%s of faces meet%s, quads as %s\n", count, count == 1.0 ? "" : "s",
           count == 1.0 ? "s" : "", qm_json_get_string(result, "quads"));
    char path[64];
    for (size_t i = 0; i < WORDS_LIMIT; i++) {
        snprintf(path, sizeof path, "pairs.%zu.faces.0", i);
        double a = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "pairs.%zu.faces.1", i);
        if (isnan(a)) break;
        printf("  %.0f and %.0f: ", a, qm_json_get_number(result, path));
        print_place(result, i);
        puts("");
    }
    printf("  search   %.1f ms, %.0f exact tests\n", qm_json_get_number(result, "elapsed_ms"),
           qm_json_get_number(result, "tests"));
}

static void print_distance(const qm_json *result)
{
    double lower = qm_json_get_number(result, "lower"), upper = qm_json_get_number(result, "upper");
    printf("Least distance, quads as %s\n", qm_json_get_string(result, "quads"));
    printf("  lower    %.17g\n  upper    %.17g\n", lower, upper);
    printf("  between  face %.0f of a and face %.0f of b\n", qm_json_get_number(result, "witness.from.face"),
           qm_json_get_number(result, "witness.to.face"));
    if (qm_json_is_true(result, "collides")) puts("  the surfaces meet");
    printf("  search   %.1f ms, %.0f pairs of faces\n", qm_json_get_number(result, "elapsed_ms"),
           qm_json_get_number(result, "face_pairs"));
    if (!qm_json_is_true(result, "converged"))
        puts("  stopped  before the tolerance was reached; the bounds hold");
}

/** Prints a result object; returns the exit status that goes with it. */
static int show(const question *asked, const char *json)
{
    qm_json *result = qm_json_parse(json);
    bool is_distance = asked->request.kind == QM_JOB_DISTANCE;
    int status = is_distance ? (qm_json_is_true(result, "converged") ? EXIT_OK : EXIT_NOT_CONVERGED)
                             : (qm_json_is_true(result, "collides") ? EXIT_COLLIDING : EXIT_OK);
    if (asked->as_json)
        puts(json);
    else if (is_distance)
        print_distance(result);
    else
        print_pairs(result);
    qm_json_free(result);
    return status;
}

static int fail_to_write(const char *path)
{
    fprintf(stderr, "quadmesh: %s cannot be written\n", path);
    return EXIT_BAD_INPUT;
}

/* ---- in this process ---- */

static bool write_csv(const question *asked, const qm_collision *found)
{
    FILE *file = fopen(asked->csv, "wb");
    if (!file) return false;
    fprintf(file, "%s\n", qm_job_array_of(asked->request.kind)->header);
    for (size_t i = 0; i < found->pair_count; i++)
        fprintf(file, "%u,%u\n", found->pairs[i].a, found->pairs[i].b);
    bool good = !ferror(file);
    return fclose(file) == 0 && good;
}

static int tell(const question *asked, const qm_job_result *result)
{
    qm_text text = {0};
    qm_json_write_result(&text, &asked->request, result);
    char *json = qm_text_take(&text);
    if (!json) return EXIT_BAD_INPUT;
    int status =
        asked->csv && !write_csv(asked, &result->pairs.found) ? fail_to_write(asked->csv) : show(asked, json);
    free(json);
    return status;
}

static int answer_loaded(const question *asked, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    qm_job_result result;
    qm_status status = qm_job_answer(&ctx, &asked->request, a, b, NULL, NULL, &result);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx.message);
        cli_complain(asked->path[0], &problem, asked->as_json);
        return EXIT_BAD_INPUT;
    }
    int exit_status = tell(asked, &result);
    qm_job_result_reset(&ctx, &result);
    return exit_status;
}

static int answer_here(const question *asked)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    qm_preparation preparation = cli_prepare(false, asked->request.quads, asked->request.threads);
    preparation.has_no_tree = asked->request.kind == QM_JOB_COLLISION;
    qm_loaded_mesh mesh[2] = {0};
    bool is_pair = asked->path[1] != NULL;
    bool good = is_pair ? cli_load_pair(&ctx, asked->path, asked->as_json,
                                        (const qm_preparation[2]){preparation, preparation}, mesh)
                        : cli_load_mesh(&ctx, asked->path[0], asked->as_json, &preparation, &mesh[0]);
    if (!good) return EXIT_BAD_INPUT;
    int status = answer_loaded(asked, &mesh[0], is_pair ? &mesh[1] : NULL);
    cli_unload_pair(&ctx, mesh);
    return status;
}

/* ---- by a daemon ---- */

static bool fetch_csv(const question *asked, cli_talk *talk)
{
    char path[300];
    FILE *file = fopen(asked->csv, "wb");
    if (!file) return fail_to_write(asked->csv), false;
    snprintf(path, sizeof path, "%s/result", cli_talk_job_path(talk));
    bool good = cli_talk_fetch(talk, path, NULL, 0, "text/csv", asked->server, file);
    bool written = !ferror(file);
    written &= fclose(file) == 0;
    if (good && !written) fail_to_write(asked->csv);
    if (!good || !written) remove(asked->csv); /* half an answer is not to be taken for one */
    return good && written;
}

static int answer_there(const question *asked)
{
    cli_talk *talk = cli_talk_open(asked->server, asked->as_json);
    qm_job_request request = asked->request;
    char *const ids[2] = {request.a, request.b};
    bool good = talk != NULL;
    for (int i = 0; i < 2 && good && asked->path[i]; i++)
        good = cli_talk_upload(talk, asked->path[i], ids[i], NULL);
    char *result = good ? cli_talk_run_job(talk, &request, cli_bar_make(0.0, false)) : NULL;
    int status = EXIT_BAD_INPUT;
    if (result && (!asked->csv || fetch_csv(asked, talk))) status = show(asked, result);
    free(result);
    cli_talk_close(talk);
    return status;
}

/* ---- the commands ---- */

static bool read_mode(const char *text, qm_collide_mode *out)
{
    int place;
    bool known = cli_read_choice("mode", text, qm_collide_mode_names, &place);
    if (known) *out = (qm_collide_mode)place;
    return known;
}

static bool read_limit(const char *text, size_t *out)
{
    double number;
    if (!cli_read_number("limit", text, 0.0, &number)) return false;
    *out = (size_t)fmin(number, MAX_LISTED);
    if (number <= MAX_LISTED && number == floor(number)) return true;
    fprintf(stderr, "quadmesh: --limit takes a whole number up to %.0f, got \"%s\"\n", MAX_LISTED, text);
    return false;
}

enum { QUADS = 256, TOLERANCE, ABSOLUTE, MODE, LIMIT, THREADS, JSON, SERVER, HELP };

static bool read_option(question *asked, int option)
{
    qm_job_request *request = &asked->request;
    switch (option) {
    case 'o':
        return asked->csv = optarg, true;
    case QUADS:
        return cli_read_quads(optarg, &request->quads);
    case TOLERANCE:
        return cli_read_number("tolerance", optarg, 1e-300, &request->tolerance);
    case ABSOLUTE:
        return request->tolerance_is_absolute = true;
    case MODE:
        return read_mode(optarg, &request->mode);
    case LIMIT:
        return read_limit(optarg, &request->list_limit);
    case THREADS:
        return cli_read_threads(optarg, &request->threads);
    case JSON:
        return asked->as_json = true;
    case SERVER:
        return asked->server = optarg, true;
    default:
        return false;
    }
}

static int run(question *asked, int file_count, int argc, char **argv)
{
    /* The last three are not for distance. */
    static const struct option all[] = {{"quads", required_argument, NULL, QUADS},
                                        {"tolerance", required_argument, NULL, TOLERANCE},
                                        {"absolute", no_argument, NULL, ABSOLUTE},
                                        {"threads", required_argument, NULL, THREADS},
                                        {"json", no_argument, NULL, JSON},
                                        {"server", required_argument, NULL, SERVER},
                                        {"help", no_argument, NULL, HELP},
                                        {"csv", required_argument, NULL, 'o'},
                                        {"mode", required_argument, NULL, MODE},
                                        {"limit", required_argument, NULL, LIMIT},
                                        {0}};
    bool is_distance = asked->request.kind == QM_JOB_DISTANCE;
    struct option options[sizeof all / sizeof *all];
    memcpy(options, all, sizeof all);
    if (is_distance) options[7] = (struct option){0};
    for (int option; (option = getopt_long(argc, argv, is_distance ? "" : "o:", options, NULL)) != -1;) {
        if (option == HELP) return fputs(asked->usage, stdout), EXIT_OK;
        if (!read_option(asked, option)) return fputs(asked->usage, stderr), EXIT_USAGE;
    }
    if (argc - optind != file_count) {
        fprintf(stderr, "quadmesh: %s takes %s, got %d\n\n", argv[0],
                file_count == 1 ? "one file" : "two files", argc - optind);
        return fputs(asked->usage, stderr), EXIT_USAGE;
    }
    for (int i = 0; i < file_count; i++)
        asked->path[i] = argv[optind + i];
    if (!asked->server) asked->request.threads = cli_count_threads(asked->request.threads);
    int status = asked->server ? answer_there(asked) : answer_here(asked);
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}

static question make_question(qm_job_kind kind, const char *usage)
{
    question asked = {.usage = usage, .request = qm_job_request_default()};
    asked.request.kind = kind;
    return asked;
}

int cmd_collide(int argc, char **argv)
{
    question asked = make_question(QM_JOB_COLLISION, collide_usage);
    return run(&asked, 2, argc, argv);
}

int cmd_self_collide(int argc, char **argv)
{
    question asked = make_question(QM_JOB_SELF_COLLISION, self_usage);
    return run(&asked, 1, argc, argv);
}

int cmd_distance(int argc, char **argv)
{
    question asked = make_question(QM_JOB_DISTANCE, distance_usage);
    return run(&asked, 2, argc, argv);
}
