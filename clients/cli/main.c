#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "base/large_pages.h"
#include "cli.h"

atomic_bool cli_interrupted;

static const char help[] =
    "quadmesh: answers geometric questions about meshes, with proof.\n"
    "\n"
    "usage: quadmesh hausdorff A B [options]   bounds of the Hausdorff distance between two meshes\n"
    "       quadmesh deviation A B [options]   mean, rms, percentiles of the distance from one mesh to "
    "another\n"
    "       quadmesh project MESH POINTS -o OUT [options]   the nearest point of a mesh for each of many\n"
    "       quadmesh distance A B [options]    bounds of the least distance between two meshes\n"
    "       quadmesh collide A B [options]     which faces of two meshes meet\n"
    "       quadmesh self-collide MESH [options]   which faces of a mesh meet that should not\n"
    "       quadmesh info FILE [--json]        what a mesh file holds\n"
    "       quadmesh patches FILE [-o OUT]     the regular patches of a mesh of quads\n"
    "       quadmesh reconstruct SURFACE LAYOUT -o OUT [options]   a quad mesh from a layout of curves\n"
    "       quadmesh --help | --version        `quadmesh COMMAND --help` tells the options\n"
    "\n"
    "Files: OBJ, PLY, STL, OFF, glTF binary, Draco, XYZ points.\n"
    "Exit status: 0 done, 1 bad input, 2 wrong usage, 3 stopped before the tolerance was reached,\n"
    "4 colliding (collide and self-collide).\n";

static void on_interrupt(int number)
{
    (void)number;
    atomic_store(&cli_interrupted, true);
}

static int run_command(int argc, char **argv)
{
    const char *command = argc > 1 ? argv[1] : "";
    if (strcmp(command, "hausdorff") == 0) return cmd_hausdorff(argc - 1, argv + 1);
    if (strcmp(command, "deviation") == 0) return cmd_deviation(argc - 1, argv + 1);
    if (strcmp(command, "project") == 0) return cmd_project(argc - 1, argv + 1);
    if (strcmp(command, "distance") == 0) return cmd_distance(argc - 1, argv + 1);
    if (strcmp(command, "collide") == 0) return cmd_collide(argc - 1, argv + 1);
    if (strcmp(command, "self-collide") == 0) return cmd_self_collide(argc - 1, argv + 1);
    if (strcmp(command, "info") == 0) return cmd_info(argc - 1, argv + 1);
    if (strcmp(command, "patches") == 0) return cmd_patches(argc - 1, argv + 1);
    if (strcmp(command, "reconstruct") == 0) return cmd_reconstruct(argc - 1, argv + 1);
    if (strcmp(command, "--version") == 0) return puts("quadmesh " QM_VERSION), EXIT_OK;
    if (strcmp(command, "--help") == 0) return fputs(help, stdout), EXIT_OK;
    if (command[0]) fprintf(stderr, "quadmesh: unknown command \"%s\"\n\n", command);
    fputs(help, stderr);
    return EXIT_USAGE;
}

int main(int argc, char **argv)
{
    qm_large_pages_for_heap();
    /* The second interrupt ends the program at once. */
    struct sigaction action = {.sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND};
    sigaction(SIGINT, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    int status = run_command(argc, argv);
    if (fflush(stdout) == 0 && !ferror(stdout)) return status;
    perror("quadmesh: the answer could not be written");
    return EXIT_BAD_INPUT;
}
