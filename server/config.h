/**
 * config.h: the settings, from one table: flag, environment variable, unit, bounds, default, help.
 */
#ifndef QM_CONFIG_H
#define QM_CONFIG_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_config {
    const char *listen; /* address; only loopback for now */
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
    double queue; /* jobs that wait */
    double connections;
    double streams;
    double idle_timeout; /* seconds */
    double grace;        /* seconds that running jobs get at SIGTERM */
} qm_config;

typedef enum qm_config_outcome { QM_CONFIG_RUN, QM_CONFIG_EXIT_OK, QM_CONFIG_EXIT_USAGE } qm_config_outcome;

/**
 * Fills *config from defaults, then QUADMESHD_* variables, then flags. --help and --version print and ask to
 * exit. Strings point into argv, the environment or static storage.
 */
qm_config_outcome qm_config_read(qm_config *config, int argc, char **argv);

#endif
