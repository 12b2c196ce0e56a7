/**
 * config.c: the table of settings, and its readers: file, environment, flags.
 */
#include "config.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "qm/base.h"

#define BLANK " \t\r"
#define MAX_FILE_SIZE 65536

typedef struct setting {
    const char *name; /* --name VALUE, QUADMESHD_NAME */
    size_t offset;    /* of the member; a string when text is not NULL, else a number */
    const char *text;
    double number, min, max;
    const char *help;
} setting;

#define TEXT(member, name, value, help)                                                                      \
    {                                                                                                        \
        name, offsetof(qm_config, member), value, 0, 0, 0, help                                              \
    }
#define NUMBER(member, name, value, min, max, help)                                                          \
    {                                                                                                        \
        name, offsetof(qm_config, member), NULL, value, min, max, help                                       \
    }

static const setting settings[] = {
    TEXT(config, "config", "", "file of settings, a line each: name = value"),
    TEXT(listen, "listen", "127.0.0.1", "address to listen on; other than loopback only with --token-file"),
    NUMBER(port, "port", 7878, 0, 65535, "port to listen on; 0 takes any free one"),
    TEXT(port_file, "port-file", "", "file to write the port to once listening"),
    TEXT(data_dir, "data-dir", "quadmeshd-data", "folder for meshes, jobs and results"),
    TEXT(store, "store", "",
         "postgres:// address of a database that several daemons share; empty for one in the data folder"),
    TEXT(store_file, "store-file", "", "file with that address, which may then have a password"),
    TEXT(node_name, "node-name", "", "name of this daemon among them; empty for the name of the host"),
    TEXT(blobs, "blobs", "database",
         "where a shared store has the bytes of meshes: database, a folder that all daemons see, or"
         " s3://BUCKET/PREFIX?endpoint=URL&region=NAME"),
    TEXT(blobs_keys, "blobs-keys", "",
         "file with aws_access_key_id and aws_secret_access_key for it; empty takes them from the "
         "environment"),
    NUMBER(store_unsafe, "store-unsafe", 0, 0, 1,
           "1 takes a database, too, that may lose what it acknowledged"),
    NUMBER(cache_bytes, "cache-bytes", 21474836480.0, 1048576, 1e15,
           "bytes of files of a shared store that are kept in the data folder"),
    TEXT(dashboard, "dashboard", "", "folder of the page served at /; found beside the program when empty"),
    TEXT(token_file, "token-file", "",
         "file of tokens, a line each: read TOKEN or write TOKEN; SIGHUP reads it again"),
    TEXT(cors_origins, "cors-origins", "", "origins whose pages may use the daemon, with commas; * for all"),
    TEXT(hosts, "hosts", "", "names that Host may have without tokens, besides addresses and localhost"),
    TEXT(health_listen, "health-listen", "127.0.0.1", "address of the listener for health and metrics"),
    NUMBER(health_port, "health-port", 0, 0, 65535, "its port; 0 for none of its own"),
    NUMBER(workers, "workers", 2, 1, 256, "jobs that run at the same time"),
    NUMBER(job_threads, "job-threads", 1, 1, 256, "threads of one job that does not ask for a number"),
    NUMBER(prepare_threads, "prepare-threads", 0, 0, 256,
           "threads that prepare one mesh; 0 for one a processor"),
    NUMBER(decodes, "decodes", 2, 1, 256, "meshes that are decoded at the same time"),
    NUMBER(max_body, "max-body", 1073741824.0, 1024, 1e12, "bytes of an upload at most"),
    NUMBER(max_data_bytes, "max-data-bytes", 0, 0, 1e15,
           "bytes of all that is stored at most; more gets 507; 0 for no limit"),
    NUMBER(max_faces, "max-faces", 5e7, 1, 2.6e8, "faces (and vertices) of a mesh at most"),
    NUMBER(memory_budget, "memory-budget", 0, 0, 1e15,
           "bytes for meshes and jobs; 0 takes half of the memory"),
    NUMBER(max_job_seconds, "max-job-seconds", 0, 0, 1e9, "seconds that a job may run; 0 for any time"),
    NUMBER(queue, "queue", 1000, 1, 1e6, "jobs that wait at most; more get 429"),
    NUMBER(kept_jobs, "kept-jobs", 100000, 0, 1e9, "jobs that have ended and are kept, the newest ones"),
    NUMBER(kept_hours, "kept-hours", 0, 0, 1e6, "hours that a job is kept; 0 for no limit"),
    NUMBER(connections, "connections", 1000, 8, 100000, "connections at most"),
    NUMBER(client_connections, "client-connections", 0, 0, 100000,
           "connections of one address at most; 0 for four fifths of --connections"),
    NUMBER(streams, "streams", 500, 1, 100000, "event streams at most; more get 503"),
    NUMBER(heartbeat, "heartbeat", 10, 1, 600, "seconds of silence after which a stream sends a heartbeat"),
    NUMBER(idle_timeout, "idle-timeout", 60, 1, 3600,
           "seconds before a connection that is silent or has no request is closed"),
    NUMBER(min_upload_rate, "min-upload-rate", 1000, 0, 1e9,
           "bytes a second that a body must have after ten seconds"),
    NUMBER(grace, "grace", 5, 0, 3600, "seconds that running jobs get to end at SIGTERM"),
    TEXT(log_format, "log-format", "text", "text or json"),
    TEXT(log_level, "log-level", "info", "least urgent records that are shown: error, warn or info"),
};
enum { SETTING_COUNT = sizeof settings / sizeof settings[0] };

/** Flags that name a task. */
typedef struct task_flag {
    const char *name;
    qm_config_task task;
    const char *value; /* what the flag names; NULL: nothing */
    bool needs_store;  /* the address of a shared store */
    const char *help;
} task_flag;

static const task_flag tasks[] = {
    {"backup", QM_CONFIG_BACKUP, "FILE", false,
     "writes all of the data folder to a new file, also of a daemon that runs; exit status 1: faults"},
    {"restore", QM_CONFIG_RESTORE, "FILE", false,
     "makes the data folder, which is missing or empty, of such a file"},
    {"check", QM_CONFIG_CHECK, NULL, false,
     "compares everything stored, or in the database of --store, with its hashes; exit status 1: faults"},
    {"repair", QM_CONFIG_REPAIR, NULL, false,
     "the same, and repairs what can be; status 0 when no fault is left"},
    {"adopt", QM_CONFIG_ADOPT, NULL, false,
     "makes meshes of the files in the data folder that the database does not know"},
    {"empty", QM_CONFIG_EMPTY, NULL, false,
     "moves the files of a data folder without a database away, to lost/"},
    {"status", QM_CONFIG_STATUS, NULL, true,
     "prints what the database of --store is, a fact a line; status 0: it is safe, and a daemon lives"},
    {"import", QM_CONFIG_IMPORT, "FOLDER", true,
     "copies a data folder to the database of --store, without what is there; exit status 1: faults"},
    {"export", QM_CONFIG_EXPORT, "FOLDER", true,
     "makes a new data folder of the database of --store, as it is now; exit status 1: faults"},
    {"migrate", QM_CONFIG_MIGRATE, NULL, true,
     "brings the tables of --store up to date, while daemons of the version before run"},
};
enum { TASK_COUNT = sizeof tasks / sizeof tasks[0] };

static const char *show_value(const char *text, double number, char out[32])
{
    if (text) return text;
    snprintf(out, 32, "%.15g", number);
    return out;
}

static void print_help(void)
{
    char value[32];
    puts("quadmeshd: answers geometric questions about meshes over HTTP, with proof.\n\n"
         "usage: quadmeshd [--SETTING VALUE]...\n");
    for (size_t i = 0; i < SETTING_COUNT; i++)
        printf("  --%-18s %s [%s]\n", settings[i].name, settings[i].help,
               show_value(settings[i].text, settings[i].number, value));
    puts("\nInstead of serving; --backup and what has --store also beside daemons that run:\n");
    for (size_t i = 0; i < TASK_COUNT; i++) {
        snprintf(value, sizeof value, "%s %s", tasks[i].name, tasks[i].value ? tasks[i].value : "");
        printf("  --%-18s %s\n", value, tasks[i].help);
    }
    puts(
        "\n  --print-config       the settings as they are, as a file for --config\n"
        "  --print-routes       what the daemon answers: method, path, types, ?parameters\n"
        "  --help               this text\n"
        "  --version            the version\n\n"
        "Every setting can also be given as QUADMESHD_NAME in the environment, and in the file of --config.\n"
        "Flags win over the environment, and that over the file.");
}

static void print_config(const qm_config *config)
{
    for (size_t i = 0; i < SETTING_COUNT; i++) {
        const setting *s = &settings[i];
        const char *member = (const char *)config + s->offset;
        const char *text = s->text ? *(const char *const *)(const void *)member : NULL;
        char value[32];
        if (strcmp(s->name, "config") == 0) continue;
        printf("# %s\n%s = %s\n", s->help, s->name,
               show_value(text, text ? 0.0 : *(const double *)(const void *)member, value));
    }
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
    if (end == value || *end || !(number >= s->min && number <= s->max) || number != floor(number)) {
        fprintf(stderr, "quadmeshd: %s must be an integer from %.15g to %.15g, got \"%s\"\n", origin, s->min,
                s->max, value);
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

/** Finds a setting by a name of `length` characters. */
static const setting *find(const char *name, size_t length)
{
    for (size_t i = 0; i < SETTING_COUNT; i++)
        if (strlen(settings[i].name) == length && strncmp(name, settings[i].name, length) == 0)
            return &settings[i];
    return NULL;
}

/* ---- the file ---- */

/** Removes blanks at both ends, in place. */
static char *trim(char *text)
{
    text += strspn(text, BLANK);
    size_t length = strlen(text);
    while (length > 0 && strchr(BLANK, text[length - 1]))
        length--;
    text[length] = '\0';
    return text;
}

static bool set_from_line(qm_config *config, char *line, const char *path, int number)
{
    char origin[128];
    snprintf(origin, sizeof origin, "%.100s line %d", path, number);
    line = trim(line);
    if (!*line || *line == '#') return true;
    char *equals = strchr(line, '=');
    if (equals) *equals = '\0';
    const char *name = trim(line);
    const setting *s = equals ? find(name, strlen(name)) : NULL;
    if (s && strcmp(s->name, "config") != 0) return set(config, s, trim(equals + 1), origin);
    fprintf(stderr, "quadmeshd: %s: there is no setting \"%s\"; see --help\n", origin, name);
    return false;
}

/** Reads the whole file into static memory, which settings then point into. */
static char *read_file(const char *path)
{
    static char text[MAX_FILE_SIZE];
    FILE *file = fopen(path, "re");
    size_t size = file ? fread(text, 1, sizeof text - 1, file) : 0;
    bool is_complete = file && !ferror(file) && size + 1 < sizeof text;
    if (!file || !is_complete)
        fprintf(stderr, "quadmeshd: cannot read %s: %s\n", path, file ? "it is too long" : strerror(errno));
    if (file) fclose(file);
    text[size] = '\0';
    return is_complete ? text : NULL;
}

static bool set_from_file(qm_config *config, const char *path)
{
    char *text = read_file(path);
    if (!text) return false;
    int number = 0;
    for (char *line; (line = strsep(&text, "\n"));)
        if (!set_from_line(config, line, path, ++number)) return false;
    return true;
}

/* ---- all together ---- */

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

/** True for an address with a password: user:password@host. */
static bool has_password(const char *address)
{
    const char *start = strstr(address, "://");
    const char *at = start ? strchr(start + 3, '@') : NULL;
    const char *colon = at ? memchr(start + 3, ':', (size_t)(at - start - 3)) : NULL;
    return colon || strstr(address, "password=");
}

/** The first line of the file with the address of the store, in static memory; NULL with a message. */
static const char *read_address(const char *path)
{
    static char line[4096];
    FILE *file = fopen(path, "re");
    bool is_read = file && fgets(line, sizeof line, file);
    if (!is_read)
        fprintf(stderr, "quadmeshd: cannot read %s: %s\n", path, file ? "it is empty" : strerror(errno));
    if (file) fclose(file);
    line[strcspn(line, "\r\n")] = '\0';
    return is_read ? line : NULL;
}

/** Takes the address of the store from its file, and checks its kind. */
static bool find_store(qm_config *config)
{
    if (config->store_file[0] && config->store[0]) {
        fprintf(stderr, "quadmeshd: --store and --store-file exclude each other\n");
        return false;
    }
    if (config->store_file[0]) config->store = read_address(config->store_file);
    if (!config->store) return false;
    if (!config->store[0] || strncmp(config->store, "postgres://", 11) == 0 ||
        strncmp(config->store, "postgresql://", 13) == 0)
        return true;
    fprintf(stderr, "quadmeshd: the address of a store begins with postgres://\n");
    return false;
}

/** Lists show a name as a word among others. */
static bool check_node_name(const char *name)
{
    size_t length = 0;
    while (name[length] > ' ' && name[length] < 127 && name[length] != '=')
        length++;
    if (!name[length] && length <= QM_CONFIG_NODE_NAME) return true;
    fprintf(
        stderr,
        "quadmeshd: --node-name takes at most %d letters, digits and signs of ASCII, without blanks and =\n",
        QM_CONFIG_NODE_NAME);
    return false;
}

static bool check(const qm_config *config)
{
    for (size_t i = 0; i < TASK_COUNT; i++) {
        if (tasks[i].task != config->task || !tasks[i].needs_store || config->store[0]) continue;
        fprintf(stderr, "quadmeshd: --%s needs the address of a database in --store\n", tasks[i].name);
        return false;
    }
    if (!config->store[0] && strcmp(config->blobs, "database") != 0) {
        fprintf(stderr, "quadmeshd: --blobs is for a store that daemons share: it needs --store\n");
        return false;
    }
    if (!check_node_name(config->node_name)) return false;
    if (!is_loopback(config->listen) && !config->token_file[0]) {
        fprintf(
            stderr,
            "quadmeshd: --listen takes a loopback address (127.0.0.1 or ::1) unless --token-file says who may"
            " reach the daemon from elsewhere\n");
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

/** Reads --name value or --name=value; *index advances to the last argument used. */
static bool set_from_flag(qm_config *config, int argc, char **argv, int *index)
{
    const char *flag = argv[*index];
    const setting *s = strncmp(flag, "--", 2) == 0 ? find(flag + 2, strcspn(flag + 2, "=")) : NULL;
    if (!s) {
        fprintf(stderr, "quadmeshd: unknown setting %s; see --help\n", flag);
        return false;
    }
    char name[64];
    snprintf(name, sizeof name, "--%s", s->name);
    const char *value = flag[strlen(name)] == '=' ? flag + strlen(name) + 1 : NULL;
    if (!value && *index + 1 == argc) {
        fprintf(stderr, "quadmeshd: %s needs a value\n", flag);
        return false;
    }
    if (!value) value = argv[++*index];
    if (strcmp(s->name, "store") == 0 && has_password(value)) {
        fprintf(
            stderr,
            "quadmeshd: everybody on the machine can read a password in --store: put the address into a file "
            "for --store-file, or into QUADMESHD_STORE\n");
        return false;
    }
    return set(config, s, value, name);
}

/** True for a flag that names a task, or lacks its file (*lacks_file); *index advances to the last argument used. */
static bool set_task(qm_config *config, int argc, char **argv, int *index, bool *lacks_file)
{
    const char *flag = argv[*index];
    for (size_t i = 0; i < TASK_COUNT; i++) {
        size_t length = strlen(tasks[i].name);
        if (strncmp(flag, "--", 2) != 0 || strncmp(flag + 2, tasks[i].name, length) != 0) continue;
        const char *end = flag + 2 + length;
        if (*end && (*end != '=' || !tasks[i].value)) continue;
        if (tasks[i].value) config->task_file = *end ? end + 1 : *index + 1 < argc ? argv[++*index] : "";
        *lacks_file = tasks[i].value && !config->task_file[0];
        if (*lacks_file) fprintf(stderr, "quadmeshd: %s needs a %s\n", flag, tasks[i].value);
        /* --check --repair is --repair, in any order. */
        if (config->task != QM_CONFIG_REPAIR || tasks[i].task != QM_CONFIG_CHECK)
            config->task = tasks[i].task;
        return true;
    }
    return false;
}

/** The file is named by a flag, else by the environment; both override its settings nevertheless. */
static bool set_from_named_file(qm_config *config, int argc, char **argv)
{
    static const char flag[] = "--config";
    const char *path = getenv("QUADMESHD_CONFIG");
    for (int i = 1; i < argc; i++) {
        if (strncmp(argv[i], flag, strlen(flag)) != 0) continue;
        const char *end = argv[i] + strlen(flag);
        if (*end == '=') path = end + 1;
        if (!*end && i + 1 < argc) path = argv[i + 1];
    }
    return !path || !*path || set_from_file(config, path);
}

qm_config_outcome qm_config_read(qm_config *config, int argc, char **argv)
{
    bool is_printing = false, lacks_file = false;
    set_defaults(config);
    config->task = QM_CONFIG_SERVE;
    if (!set_from_named_file(config, argc, argv)) return QM_CONFIG_EXIT_USAGE;
    for (size_t i = 0; i < SETTING_COUNT; i++)
        if (!set_from_environment(config, &settings[i])) return QM_CONFIG_EXIT_USAGE;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0) return print_help(), QM_CONFIG_EXIT_OK;
        if (strcmp(argv[i], "--version") == 0) return puts("quadmeshd " QM_VERSION), QM_CONFIG_EXIT_OK;
        if (strcmp(argv[i], "--print-config") == 0)
            is_printing = true;
        else if (!set_task(config, argc, argv, &i, &lacks_file) && !set_from_flag(config, argc, argv, &i))
            return QM_CONFIG_EXIT_USAGE;
        if (lacks_file) return QM_CONFIG_EXIT_USAGE;
    }
    if (!find_store(config) || !check(config)) return QM_CONFIG_EXIT_USAGE;
    if (!is_printing) return QM_CONFIG_RUN;
    print_config(config);
    return QM_CONFIG_EXIT_OK;
}
