/**
 * main.c: `quadmesh`, the questions of the daemon from a shell.
 */
#include <stdio.h>
#include <string.h>

#include "cli.h"

typedef struct command {
    const char *name, *full_name; /* the second begins the messages of getopt */
    qm_exit (*run)(int argc, char **argv);
    const char *summary;
} command;

static const command commands[] = {
    {"hausdorff", "quadmesh hausdorff", qm_cli_hausdorff,
     "the distance between two surfaces, as proven bounds"},
    {"info", "quadmesh info", qm_cli_info, "what a mesh file holds"},
};
enum { COMMAND_COUNT = sizeof commands / sizeof commands[0] };

static void print_help(FILE *out)
{
    fputs("quadmesh: answers geometric questions about meshes, with proof.\n\n"
          "usage: quadmesh COMMAND [OPTION]... FILE...\n\n",
          out);
    for (size_t i = 0; i < COMMAND_COUNT; i++)
        fprintf(out, "  %-12s %s\n", commands[i].name, commands[i].summary);
    fputs("\n`quadmesh COMMAND --help` tells more; `quadmesh --version` tells the version.\n", out);
}

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "";
    if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) return print_help(stdout), QM_EXIT_OK;
    if (strcmp(name, "--version") == 0) return puts("quadmesh " QM_VERSION), QM_EXIT_OK;
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        if (strcmp(name, commands[i].name) != 0) continue;
        argv[1] = (char *)(uintptr_t)commands[i].full_name;
        return commands[i].run(argc - 1, argv + 1);
    }
    if (name[0]) fprintf(stderr, "quadmesh: there is no command \"%s\"\n", name);
    print_help(stderr);
    return QM_EXIT_USAGE;
}
