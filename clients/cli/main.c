/**
 * main.c: the program quadmesh: finds the command and runs it.
 */
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "options.h"

atomic_bool cli_interrupted;

static const cli_command *const commands[] = {
    &cmd_compare, &cmd_check,        &cmd_hausdorff,   &cmd_deviation, &cmd_project, &cmd_distance,
    &cmd_collide, &cmd_self_collide, &cmd_align,       &cmd_matrix,    &cmd_info,    &cmd_quality,
    &cmd_patches, &cmd_layout,       &cmd_reconstruct, &cmd_report,    &cmd_heatmap};
enum { COMMAND_COUNT = sizeof commands / sizeof commands[0] };

static void print_help(FILE *file)
{
    fputs("quadmesh: answers geometric questions about meshes, with proof.\n\n", file);
    for (int i = 0; i < COMMAND_COUNT; i++) {
        char line[80];
        snprintf(line, sizeof line, "%s %s", commands[i]->name, commands[i]->arguments);
        fprintf(file, "%s quadmesh %-47s %s\n", i == 0 ? "usage:" : "      ", line, commands[i]->summary);
    }
    fputs(
        "       quadmesh --help | --version\n\n"
        "`quadmesh COMMAND --help` prints the options of a command.\n"
        "Files, by extension or content:" QM_FORMAT_NAMES ".\n"
        "Exit status: 0 done, within the limit, or clear; 1 beyond the limit, or colliding; 2 bad input or\n"
        "wrong usage; 3 stopped before the answer was certain.\n",
        file);
}

static void on_interrupt(int number)
{
    (void)number;
    atomic_store(&cli_interrupted, true);
}

int main(int argc, char **argv)
{
    qm_host_use_large_heap();
    /* The second interrupt ends the program at once. */
    struct sigaction action = {.sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND};
    sigaction(SIGINT, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    const char *name = argc > 1 ? argv[1] : "";
    const cli_command *command = NULL;
    for (int i = 0; i < COMMAND_COUNT && !command; i++)
        if (strcmp(name, commands[i]->name) == 0) command = commands[i];
    int status = EXIT_OK;
    if (command) {
        status = command->run(argc - 1, argv + 1);
    } else if (strcmp(name, "--version") == 0) {
        puts("quadmesh " QM_VERSION);
    } else if (strcmp(name, "--help") == 0) {
        print_help(stdout);
    } else {
        if (name[0]) fprintf(stderr, "quadmesh: unknown command \"%s\"\n\n", name);
        print_help(stderr);
        status = EXIT_USAGE;
    }
    if (fflush(stdout) == 0 && !ferror(stdout)) return status;
    perror("quadmesh: the output could not be written");
    return EXIT_BAD_INPUT;
}
