#include "config.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "qm/base.h"

typedef struct setting {
    const char *name; /* --name VALUE, QUADMESHD_NAME */
    size_t offset;    /* of the member; a string when text is not NULL, else a number */
    const char *text;
    double number, least, greatest;
    const char *help;
} setting;

#define TEXT(member, name, value, help)                                                                      \
    {                                                                                                        \
        name, offsetof(qm_config, member), value, 0, 0, 0, help                                              \
    }
#define NUMBER(member, name, value, least, greatest, help)                                                   \
    {                                                                                                        \
        name, offsetof(qm_config, member), NULL, value, least, greatest, help                                \
    }

static const setting settings[] = {
    TEXT(listen, "listen", "127.0.0.1", "address to listen on; loopback only"),
    NUMBER(port, "port", 7878, 0, 65535, "port to listen on; 0 takes any free one"),
    TEXT(port_file, "port-file", "", "file to write the port to once listening"),
    TEXT(data_dir, "data-dir", "quadmeshd-data", "folder for meshes, jobs and results"),
    TEXT(dashboard, "dashboard", "", "folder of the page served at /; found beside the program when empty"),
    NUMBER(workers, "workers", 2, 1, 256, "jobs that run at the same time"),
    NUMBER(job_threads, "job-threads", 1, 1, 256, "threads of one job that does not ask for a number"),
    NUMBER(prepare_threads, "prepare-threads", 0, 0, 256,
           "threads that prepare one mesh; 0 for one a processor"),
    NUMBER(max_body, "max-body", 1073741824.0, 1024, 1e12, "bytes of an upload at most"),
    NUMBER(max_faces, "max-faces", 5e7, 1, 2.6e8, "faces (and vertices) of a mesh at most"),
    NUMBER(queue, "queue", 1000, 1, 1e6, "jobs that wait at most; more get 429"),
    NUMBER(connections, "connections", 1000, 8, 100000, "connections at most"),
    NUMBER(streams, "streams", 500, 1, 100000, "event streams at most; more get 503"),
    NUMBER(idle_timeout, "idle-timeout", 60, 1, 3600, "seconds before a silent connection is closed"),
    NUMBER(grace, "grace", 5, 0, 3600, "seconds that running jobs get to end at SIGTERM"),
    TEXT(log_format, "log-format", "text", "text or json"),
    TEXT(log_level, "log-level", "info", "least urgent records that are shown: error, warn or info"),
};
enum { SETTING_COUNT = sizeof settings / sizeof settings[0] };

static void print_help(void)
{
    puts("quadmeshd: answers geometric questions about meshes over HTTP, with proof.\n\n"
         "usage: quadmeshd [--SETTING VALUE]...\n");
    for (size_t i = 0; i < SETTING_COUNT; i++) {
        char value[32];
        snprintf(value, sizeof value, "%.15g", settings[i].number);
        printf("  --%-14s %s [%s]\n", settings[i].name, settings[i].help,
               settings[i].text ? settings[i].text : value);
    }
    puts("  --help           this text\n  --version        the version\n\n"
         "Every setting can also be given as QUADMESHD_NAME in the environment; flags win.");
}

static bool set(qm_config *config, const setting *s, const char *value, const char *origin)
{
    char *member = (char *)config + s->offset;
    if (s->text) {
        *(const char **)(void *)member = value;
        return true;
    }
    char *end;
    double number = strtod(value, &end);
    if (end == value || *end || !(number >= s->least && number <= s->greatest) || number != floor(number)) {
        fprintf(stderr, "quadmeshd: %s must be a whole number from %.15g to %.15g, got \"%s\"\n", origin,
                s->least, s->greatest, value);
        return false;
    }
    *(double *)(void *)member = number;
    return true;
}

static bool set_from_environment(qm_config *config, const setting *s)
{
    char name[64] = "QUADMESHD_";
    size_t length = strlen(name);
    for (const char *c = s->name; *c; c++)
        name[length++] = *c == '-' ? '_' : (char)toupper((unsigned char)*c);
    name[length] = '\0';
    const char *value = getenv(name);
    return !value || set(config, s, value, name);
}

/** The setting that a flag names, in full or up to its "=". */
static const setting *find(const char *flag)
{
    if (strncmp(flag, "--", 2) != 0) return NULL;
    size_t length = strcspn(flag + 2, "=");
    for (size_t i = 0; i < SETTING_COUNT; i++)
        if (strlen(settings[i].name) == length && strncmp(flag + 2, settings[i].name, length) == 0)
            return &settings[i];
    return NULL;
}

static bool is_loopback(const char *address)
{
    return strncmp(address, "127.", 4) == 0 || strcmp(address, "::1") == 0;
}

static bool check_choice(const char *name, const char *value, const char *const *choices)
{
    for (size_t i = 0; choices[i]; i++)
        if (strcmp(value, choices[i]) == 0) return true;
    fprintf(stderr, "quadmeshd: --%s cannot be \"%s\"; see --help\n", name, value);
    return false;
}

static bool check(const qm_config *config)
{
    if (!is_loopback(config->listen)) {
        fprintf(stderr,
                "quadmeshd: --listen takes a loopback address (127.0.0.1 or ::1): there is no authentication"
                " yet, so nobody else may reach the daemon\n");
        return false;
    }
    static const char *const formats[] = {"text", "json", NULL};
    static const char *const levels[] = {"error", "warn", "info", NULL};
    return check_choice("log-format", config->log_format, formats) &&
           check_choice("log-level", config->log_level, levels);
}

static void set_defaults(qm_config *config)
{
    for (size_t i = 0; i < SETTING_COUNT; i++) {
        char *member = (char *)config + settings[i].offset;
        if (settings[i].text)
            *(const char **)(void *)member = settings[i].text;
        else
            *(double *)(void *)member = settings[i].number;
    }
}

/** Takes --name value or --name=value; *place moves on to the last argument taken. */
static bool set_from_flag(qm_config *config, int argc, char **argv, int *place)
{
    const char *flag = argv[*place];
    const setting *s = find(flag);
    if (!s) {
        fprintf(stderr, "quadmeshd: unknown setting %s; see --help\n", flag);
        return false;
    }
    char name[64];
    snprintf(name, sizeof name, "--%s", s->name);
    if (flag[strlen(name)] == '=') return set(config, s, flag + strlen(name) + 1, name);
    if (*place + 1 == argc) {
        fprintf(stderr, "quadmeshd: %s needs a value\n", flag);
        return false;
    }
    return set(config, s, argv[++*place], name);
}

qm_config_outcome qm_config_read(qm_config *config, int argc, char **argv)
{
    set_defaults(config);
    for (size_t i = 0; i < SETTING_COUNT; i++)
        if (!set_from_environment(config, &settings[i])) return QM_CONFIG_EXIT_USAGE;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0) return print_help(), QM_CONFIG_EXIT_OK;
        if (strcmp(argv[i], "--version") == 0) return puts("quadmeshd " QM_VERSION), QM_CONFIG_EXIT_OK;
        if (!set_from_flag(config, argc, argv, &i)) return QM_CONFIG_EXIT_USAGE;
    }
    return check(config) ? QM_CONFIG_RUN : QM_CONFIG_EXIT_USAGE;
}
