/*
 * bench_engine: runs this engine for the benchmark. Every command prints one JSON object on one line; file
 * reading is never part of a time.
 */
#include "engine.h"

#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char usage[] =
    "usage: bench_engine hausdorff A B [--quads triangles|bilinear] [--tolerance X] [--threads N]\n"
    "                                  [--shift X] [--noise X] [--accelerator A]  distance from A to B\n"
    "       bench_engine deviation SURFACE --count FACES [--noise X] [--quads triangles|bilinear] [--seconds "
    "X]\n"
    "                                  [--accuracy X] [--threads N] [--seed N]\n"
    "                                                               of a surface with noise, near it and "
    "apart:\n"
    "                                                               box, sphere, torus, saddle, wave\n"
    "       bench_engine project MESH POINTS [--threads N] [--accelerator A]\n"
    "                                                               nearest points of a file of points\n"
    "       bench_engine refit MESH [--threads N]                   trees that follow moving vertices\n"
    "       bench_engine reconstruct SURFACE LAYOUT --count QUADS [--threads N]\n"
    "       bench_engine matrix sizes|versions|any all|nearest|within --count N [--tolerance X]\n"
    "                                                               all pairs of a set by formula\n"
    "       bench_engine collide A B [--turn X]                     pairs of faces that meet\n"
    "       bench_engine self MESH                                  the same of one mesh\n"
    "       bench_engine moved MESH                                 the same after a part of it has moved\n"
    "       bench_engine draw MESH PREFIX --count N --seed N        PREFIX.near, PREFIX.mid, PREFIX.far\n"
    "       bench_engine patches MESH                               regular patches\n"
    "       bench_engine agree MESH --count N --seed N              accelerators against one another\n"
    "       bench_engine align A B MOTIONS [--threads N]            arrays of A, moved by each motion, onto "
    "those of B\n"
    "       bench_engine export MESH PREFIX [--shift X] [--noise X] [--turn X] [--part X]\n"
    "                                                               PREFIX.vertices, PREFIX.triangles\n"
    "       bench_engine vary MESH OUT.off [--shift X] [--noise X] [--turn X] [--coarsen X] [--refine]\n"
    "                                                               another mesh of the same model\n"
    "       bench_engine kernel                                     the instruction set in use\n"
    "\n"
    "  A mesh may be torus:COLUMNSxROWSxCORNERS (3 or 4), which is made in memory.\n"
    "  --tolerance X  a share of the diagonal of A (default 1e-8)\n"
    "  --shift X      moves the last mesh along (1, 1, 1) by this share of its diagonal\n"
    "  --noise X      moves its coordinates at random by up to this share of its diagonal\n"
    "  --turn X       turns it about its middle, in radians\n"
    "  --part X       keeps the faces that begin in this share of its width\n"
    "  --coarsen X    one vertex for each cell of a grid, X mean edges wide\n"
    "  --refine       cuts every face in four\n"
    "  --accuracy X   of the deviation's mean (default 0.001)\n"
    "  --seconds X    of each deviation at most (default 60)\n";

typedef struct settings {
    bench_hausdorff_question hausdorff;
    size_t count;
    uint64_t seed;
    double accuracy, seconds;
} settings;

enum {
    QUADS = 256,
    TOLERANCE,
    THREADS,
    SHIFT,
    NOISE,
    TURN,
    PART,
    COARSEN,
    REFINE,
    COUNT,
    SEED,
    ACCELERATOR,
    ACCURACY,
    SECONDS
};

static bool read_accelerator(const char *name, qm_accelerator *out)
{
    static const char *const names[] = {"auto", "boxes", "tetra", "grid"}; /* as in qm_accelerator */
    for (int i = 0; i < QM_ACCELERATOR_COUNT; i++) {
        if (strcmp(name, names[i]) != 0) continue;
        *out = (qm_accelerator)i;
        return true;
    }
    return false;
}

static bool read_option(settings *out, int option)
{
    bench_hausdorff_question *question = &out->hausdorff;
    switch (option) {
    case QUADS:
        question->quads = strcmp(optarg, "bilinear") == 0 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        return question->quads == QM_QUADS_BILINEAR || strcmp(optarg, "triangles") == 0;
    case TOLERANCE:
        return (question->tolerance = atof(optarg)) > 0.0;
    case THREADS:
        return (question->threads = atoi(optarg)) > 0;
    case SHIFT:
        return isfinite(question->change_b.shift = atof(optarg));
    case NOISE:
        return (question->change_b.noise = atof(optarg)) >= 0.0;
    case ACCELERATOR:
        return read_accelerator(optarg, &question->accelerator);
    case TURN:
        return isfinite(question->change_b.turn = atof(optarg));
    case PART:
        question->change_b.part = atof(optarg);
        return question->change_b.part > 0.0 && question->change_b.part <= 1.0;
    case COARSEN:
        return (question->change_b.coarsen = atof(optarg)) > 0.0;
    case REFINE:
        return question->change_b.refine = true;
    case COUNT:
        return (out->count = strtoul(optarg, NULL, 10)) > 0;
    case SEED:
        out->seed = strtoull(optarg, NULL, 10);
        return true;
    case ACCURACY:
        return (out->accuracy = atof(optarg)) > 0.0;
    case SECONDS:
        return (out->seconds = atof(optarg)) >= 1.0;
    default:
        return false;
    }
}

static bench_deviation_question deviation_question(const settings *given, const char *surface)
{
    const bench_hausdorff_question *shared = &given->hausdorff;
    return (bench_deviation_question){.surface = surface,
                                      .count = given->count,
                                      .noise = shared->change_b.noise,
                                      .quads = shared->quads,
                                      .accuracy = given->accuracy,
                                      .threads = shared->threads,
                                      .seed = given->seed,
                                      .seconds = given->seconds};
}

static bool run(const char *command, char **operands, int operand_count, settings *given)
{
    const char *first = operand_count > 0 ? operands[0] : NULL,
               *second = operand_count > 1 ? operands[1] : NULL;
    bench_hausdorff_question *question = &given->hausdorff;
    if (strcmp(command, "kernel") == 0 && operand_count == 0) {
        printf("{\"kernel\": \"%s\", \"version\": \"%s\"}\n", qm_kernel_name(), QM_VERSION);
        return true;
    }
    if (strcmp(command, "refit") == 0 && operand_count == 1) {
        bench_refit(first, question->threads);
        return true;
    }
    if (strcmp(command, "patches") == 0 && operand_count == 1) {
        bench_patches(first);
        return true;
    }
    if (strcmp(command, "agree") == 0 && operand_count == 1) {
        bench_agree(first, given->count, given->seed);
        return true;
    }
    if (strcmp(command, "moved") == 0 && operand_count == 1) {
        bench_moved(first);
        return true;
    }
    if (strcmp(command, "self") == 0 && operand_count == 1) {
        bench_collide(first, NULL, NULL);
        return true;
    }
    if (strcmp(command, "deviation") == 0 && operand_count == 1) {
        bench_deviation_question of_surface = deviation_question(given, first);
        bench_deviation(&of_surface);
        return true;
    }
    if (strcmp(command, "align") == 0 && operand_count == 3) {
        bench_align(first, second, operands[2], question->threads);
        return true;
    }
    if (operand_count != 2) return false;
    if (strcmp(command, "hausdorff") == 0) {
        question->path_a = first;
        question->path_b = second;
        bench_hausdorff(question);
    } else if (strcmp(command, "matrix") == 0) {
        bench_matrix(first, second, given->count, question->tolerance);
    } else if (strcmp(command, "project") == 0) {
        bench_project(first, second, question->accelerator, question->threads);
    } else if (strcmp(command, "reconstruct") == 0) {
        bench_reconstruct(first, second, given->count, question->threads);
    } else if (strcmp(command, "collide") == 0) {
        bench_collide(first, second, &question->change_b);
    } else if (strcmp(command, "draw") == 0) {
        bench_draw(first, given->count, given->seed, second);
    } else if (strcmp(command, "export") == 0) {
        bench_export(first, &question->change_b, second);
    } else if (strcmp(command, "vary") == 0) {
        bench_vary(first, &question->change_b, second);
    } else {
        return false;
    }
    return true;
}

int main(int argc, char **argv)
{
    static const struct option options[] = {{"quads", required_argument, NULL, QUADS},
                                            {"tolerance", required_argument, NULL, TOLERANCE},
                                            {"threads", required_argument, NULL, THREADS},
                                            {"shift", required_argument, NULL, SHIFT},
                                            {"noise", required_argument, NULL, NOISE},
                                            {"turn", required_argument, NULL, TURN},
                                            {"part", required_argument, NULL, PART},
                                            {"coarsen", required_argument, NULL, COARSEN},
                                            {"refine", no_argument, NULL, REFINE},
                                            {"count", required_argument, NULL, COUNT},
                                            {"seed", required_argument, NULL, SEED},
                                            {"accelerator", required_argument, NULL, ACCELERATOR},
                                            {"accuracy", required_argument, NULL, ACCURACY},
                                            {"seconds", required_argument, NULL, SECONDS},
                                            {0}};
    settings given = {.hausdorff = {.tolerance = 1e-8, .threads = 1},
                      .count = 1000000,
                      .seed = 1,
                      .accuracy = 1e-3,
                      .seconds = 60.0};
    bool is_good = argc > 1;
    for (int option; is_good && (option = getopt_long(argc - 1, argv + 1, "", options, NULL)) != -1;)
        is_good = read_option(&given, option);
    if (is_good && run(argv[1], argv + 1 + optind, argc - 1 - optind, &given)) return EXIT_SUCCESS;
    fputs(usage, stderr);
    return 2;
}
