/**
 * main.c: the program quadmesh: finds the command and runs it.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "options.h"
#include "qm/bvh.h"

atomic_bool cli_interrupted;

/** In the order of the help text; a title comes before the first command of its group. */
static const struct {
    const char *title;
    const cli_command *command;
} commands[] = {{"Two meshes, all of it", &cmd_compare},
                {NULL, &cmd_check},
                {NULL, &cmd_report},
                {"Two meshes, one figure", &cmd_hausdorff},
                {NULL, &cmd_deviation},
                {NULL, &cmd_heatmap},
                {NULL, &cmd_distance},
                {NULL, &cmd_collide},
                {"Others", &cmd_align},
                {NULL, &cmd_matrix},
                {NULL, &cmd_project},
                {"One mesh", &cmd_info},
                {NULL, &cmd_quality},
                {NULL, &cmd_self_collide},
                {NULL, &cmd_patches},
                {NULL, &cmd_layout},
                {NULL, &cmd_reconstruct},
                {NULL, &cmd_remesh}};
enum { COMMAND_COUNT = sizeof commands / sizeof commands[0] };

static void print_help(FILE *file)
{
    fputs("quadmesh: answers geometric questions about meshes, with proof.\n\n"
          "usage: quadmesh COMMAND FILES [options]\n",
          file);
    for (int i = 0; i < COMMAND_COUNT; i++) {
        const cli_command *command = commands[i].command;
        if (commands[i].title) fprintf(file, "\n%s\n", commands[i].title);
        fprintf(file, "  %-13s %s\n", command->name, command->summary);
    }
    fputs(
        "\n`quadmesh COMMAND --help` (-h) prints what a command is for and its options, `quadmesh "
        "--version`\n"
        "(with --json: as JSON) what this program is.\n"
        "Files, by extension or content, also compressed with gzip; - is standard input:\n " QM_FORMAT_NAMES
        ".\n"
        "Exit status: 0 done, within the limit, or clear; 1 beyond the limit, or colliding; 2 bad input or\n"
        "wrong usage; 3 stopped before the answer was certain.\n",
        file);
}

static const cli_command *find_command(const char *name)
{
    for (int i = 0; i < COMMAND_COUNT; i++)
        if (strcmp(name, commands[i].command->name) == 0) return commands[i].command;
    return NULL;
}

static int complain(const char *name)
{
    if (name[0]) fprintf(stderr, "quadmesh: there is no command \"%s\"\n", name);
    fputs("usage: quadmesh COMMAND FILES [options]\n`quadmesh --help` lists the commands.\n", stderr);
    return EXIT_USAGE;
}

/* ---- the program itself ---- */

static void print_version_object(void)
{
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_string(&text, "name", "quadmesh");
    qm_json_add_string(&text, "version", QM_VERSION);
    qm_json_add_string(&text, "kernel", qm_kernel_name());
    qm_json_open(&text, "formats", "[");
#define XX(number, suffix, name, media, magic) qm_json_add_comma(&text), qm_json_add_quoted(&text, #name);
    QM_FORMAT_MAP(XX)
#undef XX
    qm_text_add_string(&text, "]}");
    char *document = qm_text_take(&text);
    puts(document ? document : "{}");
    free(document);
}

/** --version, or --version --json. */
static int show_version(int argc, char **argv)
{
    const char *option = argc > 2 ? argv[2] : "";
    bool as_json = strcmp(option, "--json") == 0 || strcmp(option, "-j") == 0;
    if (argc > 3 || (argc == 3 && !as_json)) {
        fprintf(stderr, "quadmesh: --version takes --json alone, got \"%s\"\n", argv[argc - 1]);
        return EXIT_USAGE;
    }
    if (as_json)
        print_version_object();
    else
        puts("quadmesh " QM_VERSION);
    return EXIT_OK;
}

/** help, or help COMMAND. */
static int show_help(int argc, char **argv)
{
    const cli_command *command = argc > 2 ? find_command(argv[2]) : NULL;
    if (argc > 2 && !command) return complain(argv[2]);
    char option[] = "--help", *words[] = {argc > 2 ? argv[2] : NULL, option, NULL};
    if (command) return command->run(2, words);
    print_help(stdout);
    return EXIT_OK;
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
    const cli_command *command = find_command(name);
    int status;
    if (command)
        status = command->run(argc - 1, argv + 1);
    else if (strcmp(name, "--version") == 0)
        status = show_version(argc, argv);
    else if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0 || strcmp(name, "help") == 0)
        status = show_help(argc, argv);
    else
        status = complain(name);
    if (fflush(stdout) == 0 && !ferror(stdout)) return status;
    perror("quadmesh: the output could not be written");
    return EXIT_BAD_INPUT;
}
