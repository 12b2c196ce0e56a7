/**
 * options.h: the commands and their options. One table for each command serves the parser and the usage text.
 */
#ifndef QM_CLI_OPTIONS_H
#define QM_CLI_OPTIONS_H

#include "cli.h"

typedef struct cli_command {
    const char *name;
    const char *arguments;          /* after the name in the usage line */
    const char *summary;            /* for `quadmesh --help` */
    const char *takes;              /* "two files" */
    int path_count, optional_paths; /* of path_count; those that are not given are NULL */
    int most_paths;                 /* of a command that takes more than path_count; 0: it does not */
    const char
        *description; /* of the usage text: what it is for, and which command is for what is near to it */
    const char *exit_status; /* its last line */
    int (*run)(int argc, char **argv);
} cli_command;

extern const cli_command cmd_hausdorff, cmd_deviation, cmd_project, cmd_distance, cmd_collide,
    cmd_self_collide, cmd_align, cmd_info, cmd_quality, cmd_patches, cmd_reconstruct, cmd_compare, cmd_check,
    cmd_matrix, cmd_layout, cmd_remesh, cmd_report, cmd_heatmap;

typedef enum cli_option_type {
    CLI_FLAG,     /* bool: set */
    CLI_TEXT,     /* const char * */
    CLI_POSITIVE, /* double above 0 */
    CLI_NUMBER,   /* double of 0 or more */
    CLI_INT,      /* int from min to max */
    CLI_SIZE,     /* size_t from min to max */
    CLI_CHOICE,   /* an enum, by its name in choices */
    CLI_CUSTOM    /* read by a function */
} cli_option_type;

typedef struct cli_option {
    const char *name;
    char letter;       /* -o, or 0 */
    const char *value; /* of the usage text; NULL for a flag */
    cli_option_type type;
    void *target;     /* where the value goes */
    const char *help; /* lines of the usage text */
    double min, max;
    const char *const *choices;
    bool (*read)(const char *text, void *target); /* false after a message */
    bool is_required;                             /* a text */
    bool may_repeat;                              /* it may be given several times */
} cli_option;

/** Options that several commands have. */
#define CLI_OPTION_QUADS(address)                                                                            \
    {                                                                                                        \
        .name = "quads", .value = "R", .type = CLI_CHOICE, .choices = qm_quads_names, .target = (address),   \
        .help = "how quads are read: triangles (default) or bilinear"                                        \
    }
#define CLI_OPTION_ACCELERATOR(address)                                                                      \
    {                                                                                                        \
        .name = "accelerator", .value = "A", .type = CLI_CHOICE, .choices = qm_accelerator_names,            \
        .target = (address), .help = "of nearest points: auto (default), boxes, tetra or grid"               \
    }
/* Of two options: the second is the name of the version before. */
#define CLI_OPTION_GAP(address, text)                                                                        \
    {.name = "gap", .value = "X", .type = CLI_POSITIVE, .target = (address), .help = (text)},                \
    {                                                                                                        \
        .name = "tolerance", .value = "X", .type = CLI_POSITIVE, .target = (address),                        \
        .help = "the former name of --gap"                                                                   \
    }
#define CLI_OPTION_ABSOLUTE(address)                                                                         \
    {                                                                                                        \
        .name = "absolute", .type = CLI_FLAG, .target = (address),                                           \
        .help = "the gap is in the unit of the meshes"                                                       \
    }
#define CLI_OPTION_THREADS(address)                                                                          \
    {                                                                                                        \
        .name = "threads", .letter = 't', .value = "N", .type = CLI_INT, .min = 1,                           \
        .max = QM_JOB_MAX_THREADS, .target = (address), .help = "threads (default: one for each processor)"  \
    }
/** Of two meshes: what is known of both besides their files, as qm_notes[2]. */
#define CLI_OPTION_UNIT(notes)                                                                               \
    {                                                                                                        \
        .name = "unit", .value = "U", .type = CLI_CUSTOM, .read = cli_read_unit, .target = (notes),          \
        .help = "unit of both files, whatever they say: um, mm, cm, m, in or ft"                             \
    }
#define CLI_OPTIONS_NOTES(notes)                                                                             \
    CLI_OPTION_UNIT(notes),                                                                                  \
    {                                                                                                        \
        .name = "uncertainty", .value = "X[,Y]", .type = CLI_CUSTOM, .read = cli_read_uncertainty,           \
        .target = (notes),                                                                                   \
        .help = "the true surfaces are within X of both files, or within X of A and Y of B:\n"               \
                "also bounds that hold for these"                                                            \
    }
bool cli_read_unit(const char *text, void *notes);
bool cli_read_uncertainty(const char *text, void *notes);

#define CLI_OPTION_JSON(address)                                                                             \
    {                                                                                                        \
        .name = "json", .letter = 'j', .type = CLI_FLAG, .target = (address),                                \
        .help = "the result object of the API on standard output"                                            \
    }
#define CLI_OPTION_UV(address)                                                                               \
    {                                                                                                        \
        .name = "uv", .type = CLI_FLAG, .target = (address),                                                 \
        .help =                                                                                              \
            "with texture coordinates, in OBJ, PLY (s, t) and glTF: each patch is a rectangle of square\n"   \
            "cells, apart from the others"                                                                   \
    }
#define CLI_OPTION_PROGRESS(address)                                                                         \
    {                                                                                                        \
        .name = "progress", .type = CLI_FLAG, .target = (address),                                           \
        .help = "lines of progress on standard error even if it is not a terminal"                           \
    }
#define CLI_OPTION_TRANSFORM(address, mesh)                                                                  \
    {                                                                                                        \
        .name = "transform", .value = "FILE", .type = CLI_TEXT, .target = (address),                         \
        .help = "moves " mesh " by the transform in this file, as align --json writes it"                    \
    }
#define CLI_OPTION_ALIGN(address)                                                                            \
    {                                                                                                        \
        .name = "align", .type = CLI_FLAG, .target = (address),                                              \
        .help = "moves A onto B before, as align does without options"                                       \
    }
#define CLI_OPTION_SERVER(address)                                                                           \
    {                                                                                                        \
        .name = "server", .value = "URL", .type = CLI_TEXT, .target = (address),                             \
        .help = "run on a daemon instead of in this process; it chooses the threads unless --threads does"   \
    }

/** Of two options: how closely averages over a surface are known. */
#define CLI_OPTION_AVERAGES(request)                                                                         \
    {.name = "accuracy",                                                                                     \
     .value = "X",                                                                                           \
     .type = CLI_POSITIVE,                                                                                   \
     .target = &(request)->accuracy,                                                                         \
     .help =                                                                                                 \
         "width of the intervals of mean and rms at which to stop, as a fraction of them (default 0.01)"},   \
    {                                                                                                        \
        .name = "pieces", .value = "N", .type = CLI_SIZE, .max = QM_JOB_MAX_PIECES,                          \
        .target = &(request)->pieces, .help = "max pieces that faces are cut into (default 1048576)"         \
    }
#define CLI_OPTION_PERCENTILES(request, list)                                                                \
    {                                                                                                        \
        .name = "percentiles", .value = "L", .type = CLI_CUSTOM, .read = cli_read_percentiles,               \
        .target = (request), .help = "numbers separated by commas (default " list ")"                        \
    }

/** Of two options: which distances are positive, and shares in bands of them. cli_settle_sign goes after the parser. */
#define CLI_OPTIONS_SIGN(request)                                                                            \
    {.name = "sign",                                                                                         \
     .value = "S",                                                                                           \
     .type = CLI_CHOICE,                                                                                     \
     .choices = qm_sign_names,                                                                               \
     .target = &(request)->sign,                                                                             \
     .help = "outside, inside: distances of that side of B, which is proven closed, are positive;\n"         \
             "normal: those where B's normals point to, not proven; none (default)"},                        \
    {                                                                                                        \
        .name = "bands", .value = "L", .type = CLI_CUSTOM, .read = cli_read_bands, .target = (request),      \
        .help = "the share in each of these ranges of signed distances FROM:TO, as in -0.1:0.2,0.2:,\n"      \
                "where an end that is left out is none; --sign is outside if it is not given"                \
    }
bool cli_read_bands(const char *text, void *request);

/** Bands are of signed distances: outside is positive unless something else was given. */
void cli_settle_sign(qm_job_request *request);

#define CLI_MAX_OPTIONS 28

/**
 * Reads the arguments of a command: options into their targets, and its paths; a command with most_paths has room for argc, of
 * which those after the paths stay as they are. Returns true; or false with the exit status after --help or wrong usage.
 */
bool cli_read_options(const cli_command *command, const cli_option *options, size_t count, int argc,
                      char **argv, const char **paths, int *status);

/**
 * Reads numbers separated by commas and adds them to those that there are, as many as room at most; each lies in (above,
 * max], or in [0, max] where above is negative. False after a message that names the option.
 */
bool cli_read_list(const char *option, const char *text, double above, double max, size_t room, double *out,
                   size_t *count);

/** The percentiles of a request, in place of the default ones. */
bool cli_read_percentiles(const char *text, void *request);

/** The number of threads that was given, or else one for each processor. */
int cli_count_threads(int given);

#endif
