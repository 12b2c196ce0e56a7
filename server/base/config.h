/**
 * config.h: the settings, from one table: flag, environment variable, line of a file, unit, bounds, default,
 * help.
 */
#ifndef QM_CONFIG_H
#define QM_CONFIG_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_config {
    const char *config;       /* file of settings; "" for none */
    const char *listen;       /* address; other than loopback only with tokens */
    const char *token_file;   /* "" for none: everybody who reaches the daemon may do everything */
    const char *cors_origins; /* whose pages may use the daemon, with commas; "" for none */
    const char *hosts;        /* names that requests may give as Host besides addresses and localhost */
    const char *health_listen;
    double health_port; /* of a listener of its own for health and metrics; 0: none */
    const char *data_dir;
    const char *port_file; /* the port is written there once the daemon listens; "" for none */
    const char *dashboard; /* folder of the page that is served at / */
    const char *log_format, *log_level;
    double port;            /* 0: any free one */
    double workers;         /* jobs that run at once */
    double job_threads;     /* threads of one job */
    double prepare_threads; /* threads that prepare one mesh; 0: one for each processor */
    double max_body;        /* bytes of an upload */
    double max_faces;
    double memory_budget; /* bytes of meshes and jobs; 0: half of what there is */
    double queue;         /* jobs that wait */
    double kept_jobs;     /* that have ended */
    double kept_hours;    /* of a job; 0: any time */
    double connections;
    double client_connections; /* of one address; 0: any number */
    double streams;
    double heartbeat;       /* seconds between the signs of life of a silent stream */
    double idle_timeout;    /* seconds */
    double min_upload_rate; /* bytes a second; 0: any */
    double grace;           /* seconds that running jobs get at SIGTERM */
} qm_config;

typedef enum qm_config_outcome { QM_CONFIG_RUN, QM_CONFIG_EXIT_OK, QM_CONFIG_EXIT_USAGE } qm_config_outcome;

/**
 * Fills *config from defaults, then the file of settings, then QUADMESHD_* variables, then flags; of a
 * setting that several have, the last counts. --help, --version and --print-config print and ask to exit.
 *
 * A line of the file is "name = value", as --print-config writes them; # starts a comment.
 *
 * Strings point into argv, the environment or storage that lives as long as the process. Called once.
 */
qm_config_outcome qm_config_read(qm_config *config, int argc, char **argv);

#endif
