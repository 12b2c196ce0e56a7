/**
 * options.c: parses arguments by a table of options, and prints that table as the usage text.
 */
#include "options.h"

#include <float.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"

enum { FIRST_OPTION = 256 }; /* getopt_long returns this for the first option of the table */

/* ---- usage ---- */

/** The left column: "-o, --output OUT". */
static void format_name(const cli_option *option, char *out, size_t size)
{
    char letter[8] = "";
    if (option->letter) snprintf(letter, sizeof letter, "-%c, ", option->letter);
    snprintf(out, size, "%s--%s%s%s", letter, option->name, option->value ? " " : "",
             option->value ? option->value : "");
}

static void print_option(FILE *file, const cli_option *option, size_t width)
{
    char name[48];
    format_name(option, name, sizeof name);
    fprintf(file, "  %-*s  ", (int)width, name);
    for (const char *c = option->help; *c; c++) {
        fputc(*c, file);
        if (*c == '\n') fprintf(file, "  %-*s  ", (int)width, "");
    }
    fputc('\n', file);
}

static void print_usage(FILE *file, const cli_command *command, const cli_option *options, size_t count)
{
    static const cli_option help = {.name = "help", .letter = 'h', .help = "this text"};
    char name[48];
    format_name(&help, name, sizeof name);
    size_t width = strlen(name);
    for (size_t i = 0; i < count; i++) {
        format_name(&options[i], name, sizeof name);
        if (strlen(name) > width) width = strlen(name);
    }
    fprintf(file, "usage: quadmesh %s %s\n\n%s\n", command->name, command->arguments, command->description);
    for (size_t i = 0; i < count; i++)
        print_option(file, &options[i], width);
    print_option(file, &help, width);
    fprintf(file, "\n%s\n", command->exit_status);
}

/* ---- values ---- */

bool cli_read_unit(const char *text, void *target)
{
    qm_notes *notes = target;
    if (qm_notes_set_unit(&notes[0], text) && qm_notes_set_unit(&notes[1], text)) return true;
    fprintf(stderr, "quadmesh: --unit takes " QM_NOTES_UNITS ", got \"%s\"\n", text);
    return false;
}

bool cli_read_uncertainty(const char *text, void *target)
{
    qm_notes *notes = target;
    char first[32];
    const char *comma = strchr(text, ',');
    snprintf(first, sizeof first, "%.*s", comma ? (int)(comma - text) : (int)strlen(text), text);
    if (qm_notes_set_uncertainty(&notes[0], first) &&
        qm_notes_set_uncertainty(&notes[1], comma ? comma + 1 : first))
        return true;
    fprintf(stderr, "quadmesh: --uncertainty takes one or two numbers of 0 or more, got \"%s\"\n", text);
    return false;
}

static bool read_value(const cli_option *option, const char *text)
{
    char *end;
    const double number = option->type >= CLI_POSITIVE && option->type <= CLI_SIZE ? strtod(text, &end) : NAN;
    switch (option->type) {
    case CLI_FLAG:
        return *(bool *)option->target = true;
    case CLI_TEXT:
        *(const char **)option->target = text;
        return true;
    case CLI_POSITIVE:
    case CLI_NUMBER: {
        const bool is_positive = option->type == CLI_POSITIVE;
        if (end != text && !*end && isfinite(number) && (is_positive ? number > 0.0 : number >= 0.0)) {
            *(double *)option->target = number;
            return true;
        }
        fprintf(stderr, "quadmesh: --%s takes a number%s, got \"%s\"\n", option->name,
                is_positive ? " above 0" : " of 0 or more", text);
        return false;
    }
    case CLI_INT:
    case CLI_SIZE:
        QM_ASSERT(option->min <= option->max);
        if (end == text || *end || !(number >= option->min && number <= option->max) ||
            number != floor(number)) {
            fprintf(stderr, "quadmesh: --%s takes an integer from %.0f to %.0f, got \"%s\"\n", option->name,
                    option->min, option->max, text);
            return false;
        }
        if (option->type == CLI_INT)
            *(int *)option->target = (int)number;
        else
            *(size_t *)option->target = (size_t)number;
        return true;
    case CLI_CHOICE: {
        const char *const *choices = option->choices;
        for (int i = 0; choices[i]; i++) {
            if (strcmp(text, choices[i]) != 0) continue;
            memcpy(option->target, &i, sizeof i); /* enums have the size of int */
            return true;
        }
        fprintf(stderr, "quadmesh: --%s takes %s", option->name, choices[0]);
        for (int i = 1; choices[i]; i++)
            fprintf(stderr, "%s%s", choices[i + 1] ? ", " : " or ", choices[i]);
        fprintf(stderr, ", got \"%s\"\n", text);
        return false;
    }
    case CLI_CUSTOM:
        return option->read(text, option->target);
    }
    return false;
}

/* ---- arguments ---- */

/** What a wrong word is answered with: not the whole usage text, in which the message would be lost. */
static void print_hint(const cli_command *command)
{
    fprintf(stderr, "usage: quadmesh %s %s\n`quadmesh %s --help` prints the options.\n", command->name,
            command->arguments, command->name);
}

/** Lists the options that begin like this one, or says that none does. */
static void complain_of_name(const cli_command *command, const struct option *list, const char *word)
{
    size_t length = strcspn(word, "="), found = 0;
    for (const struct option *at = list; at->name; at++) {
        if (strncmp(word, "--", 2) != 0 || strncmp(at->name, word + 2, length - 2) != 0) continue;
        if (found++ == 0) fprintf(stderr, "quadmesh: %.*s is the beginning of", (int)length, word);
        fprintf(stderr, " --%s", at->name);
    }
    if (found == 0) fprintf(stderr, "quadmesh: %s has no option %.*s", command->name, (int)length, word);
    fputc('\n', stderr);
}

/** Says what is wrong with the word that getopt_long has stopped at. */
static void complain(const cli_command *command, const struct option *list, bool is_missing, char **argv)
{
    const char *word = argv[optind - 1];
    if (optopt >= FIRST_OPTION)
        fprintf(stderr, "quadmesh: --%s takes %s\n", list[optopt - FIRST_OPTION].name,
                is_missing ? "a value" : "no value");
    else if (optopt && is_missing)
        fprintf(stderr, "quadmesh: -%c takes a value\n", optopt);
    else if (optopt)
        fprintf(stderr, "quadmesh: %s has no option -%c\n", command->name, optopt);
    else
        complain_of_name(command, list, word);
}

/** Fills the tables of getopt_long. */
static void list_options(const cli_option *options, size_t count, struct option *list, char *letters)
{
    *letters++ = ':';
    for (size_t i = 0; i < count; i++) {
        list[i] = (struct option){options[i].name, options[i].value ? required_argument : no_argument, NULL,
                                  FIRST_OPTION + (int)i};
        if (!options[i].letter) continue;
        *letters++ = options[i].letter;
        if (options[i].value) *letters++ = ':';
    }
    *letters++ = 'h';
    *letters = '\0';
    list[count] = (struct option){"help", no_argument, NULL, 'h'};
}

/** Reads all options; false with the exit status. */
static bool read_all(const cli_command *command, const cli_option *options, size_t count, int argc,
                     char **argv, int *status)
{
    struct option list[CLI_MAX_OPTIONS + 2] = {{0}};
    char letters[2 * CLI_MAX_OPTIONS + 3];
    bool is_given[CLI_MAX_OPTIONS] = {false};
    list_options(options, count, list, letters);
    *status = EXIT_USAGE;
    opterr = 0;
    for (int option; (option = getopt_long(argc, argv, letters, list, NULL)) != -1;) {
        if (option == 'h') {
            *status = EXIT_OK;
            print_usage(stdout, command, options, count);
            return false;
        }
        size_t index = option >= FIRST_OPTION ? (size_t)(option - FIRST_OPTION) : 0;
        while (option < FIRST_OPTION && index < count && options[index].letter != option)
            index++;
        bool is_known = index < count,
             is_repeated = is_known && is_given[index] && !options[index].may_repeat;
        if (!is_known)
            complain(command, list, option == ':', argv);
        else if (is_repeated)
            fprintf(stderr, "quadmesh: --%s is given more than once\n", options[index].name);
        if (!is_known || is_repeated || !read_value(&options[index], optarg)) return false;
        is_given[index] = options[index].type != CLI_FLAG;
    }
    return true;
}

/** Whether there are as many paths as the command takes, and all that it needs; false after a message. */
static bool check_complete(const cli_command *command, const cli_option *options, size_t count, int given,
                           char *const *paths)
{
    int least = command->path_count - command->optional_paths;
    int most = command->most_paths > 0 ? command->most_paths : command->path_count;
    if (given < least || given > most) {
        fprintf(stderr, "quadmesh: %s takes %s, got %d file%s\n", command->name, command->takes, given,
                given == 1 ? "" : "s");
        return false;
    }
    int from_stdin = 0;
    for (int i = 0; i < given; i++)
        from_stdin += strcmp(paths[i], "-") == 0;
    if (from_stdin > 1) {
        fputs("quadmesh: standard input (-) is one file: give names for the others\n", stderr);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        if (!options[i].is_required || *(const char **)options[i].target) continue;
        fprintf(stderr, "quadmesh: %s needs --%s %s\n", command->name, options[i].name, options[i].value);
        return false;
    }
    return true;
}

bool cli_read_options(const cli_command *command, const cli_option *options, size_t count, int argc,
                      char **argv, const char **paths, int *status)
{
    QM_ASSERT(count <= CLI_MAX_OPTIONS);
    bool is_read = read_all(command, options, count, argc, argv, status);
    int given = argc - optind;
    if (!is_read || !check_complete(command, options, count, given, argv + optind)) {
        if (*status == EXIT_USAGE) print_hint(command);
        return false;
    }
    for (int i = 0; i < given || i < command->path_count; i++)
        paths[i] = i < given ? argv[optind + i] : NULL;
    return true;
}

bool cli_read_list(const char *option, const char *text, double above, double max, size_t room, double *out,
                   size_t *count)
{
    for (const char *at = text;; at++) {
        char *end;
        double number = strtod(at, &end);
        bool is_valid = end != at && number > above && number >= 0.0 && number <= max && *count < room &&
                        (*end == ',' || !*end);
        if (!is_valid) break;
        out[(*count)++] = number;
        if (!*end) return true;
        at = end;
    }
    fprintf(stderr, "quadmesh: --%s takes up to %zu numbers %s", option, room,
            above < 0.0 ? "of 0 or more" : "above 0");
    if (isfinite(max) && max < DBL_MAX) fprintf(stderr, " and up to %.9g", max);
    fprintf(stderr, ", separated by commas, got \"%s\"\n", text);
    return false;
}

bool cli_read_percentiles(const char *text, void *target)
{
    qm_job_request *request = target;
    request->percentile_count = 0;
    return cli_read_list("percentiles", text, 0.0, 100.0, QM_JOB_MAX_PERCENTILES, request->percentiles,
                         &request->percentile_count);
}

/** Reads an end of a band up to a character: a number, or nothing for none. */
static bool read_end(const char **text, double none, char stop, double *out)
{
    char *end = NULL;
    *out = none;
    if (**text != stop && **text != '\0') {
        *out = strtod(*text, &end);
        if (end == *text || !isfinite(*out)) return false;
        *text = end;
    }
    return true;
}

bool cli_read_bands(const char *text, void *target)
{
    qm_job_request *request = target;
    request->band_count = 0;
    for (const char *at = text; request->band_count < QM_JOB_MAX_BANDS; at++) {
        qm_interval *band = &request->bands[request->band_count];
        if (!read_end(&at, -INFINITY, ':', &band->lower) || *at++ != ':') break;
        if (!read_end(&at, INFINITY, ',', &band->upper) || !(band->lower <= band->upper)) break;
        request->band_count++;
        if (!*at) return true;
        if (*at != ',') break;
    }
    fprintf(stderr,
            "quadmesh: --bands takes up to %d ranges FROM:TO, ascending, separated by commas, as in "
            "-0.1:0.2,0.2:; got "
            "\"%s\"\n",
            QM_JOB_MAX_BANDS, text);
    return false;
}

void cli_settle_sign(qm_job_request *request)
{
    if (request->band_count > 0 && request->sign == QM_SIGN_NONE) request->sign = QM_SIGN_OUTSIDE;
}

int cli_count_threads(int given)
{
    return given > 0 ? given : qm_host_thread_count();
}
