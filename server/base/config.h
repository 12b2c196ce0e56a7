/**
 * config.h: the daemon's settings. One table (config.c) gives each its flag, environment variable, bounds, default
 * and help text.
 */
#ifndef QM_CONFIG_H
#define QM_CONFIG_H

#include <stdbool.h>
#include <stddef.h>

/** What the process is asked to do: serve, or one thing with the data folder of a daemon that is stopped, or with a shared
 * store. */
typedef enum qm_config_task {
    QM_CONFIG_SERVE,
    QM_CONFIG_CHECK,
    QM_CONFIG_REPAIR,
    QM_CONFIG_ADOPT,
    QM_CONFIG_EMPTY,
    QM_CONFIG_BACKUP,
    QM_CONFIG_RESTORE,
    QM_CONFIG_STATUS,
    QM_CONFIG_IMPORT,
    QM_CONFIG_EXPORT,
    QM_CONFIG_MIGRATE
} qm_config_task;

#define QM_CONFIG_NODE_NAME 63 /* bytes of the name of a node */

typedef struct qm_config {
    qm_config_task task;
    const char *task_file;    /* of a backup, or to restore; a folder to import or to export to */
    const char *config;       /* file of settings; "" for none */
    const char *listen;       /* address; other than loopback only with tokens */
    const char *token_file;   /* "" for none: every client may do everything */
    const char *cors_origins; /* origins whose pages may use the daemon, separated by commas; "" for none */
    const char *hosts;        /* host names that Host may contain besides addresses and localhost */
    const char *health_listen;
    double health_port; /* of a separate listener for health and metrics; 0: none */
    const char *data_dir;
    const char *store;      /* address of a database that nodes share; "" for one in data_dir */
    const char *store_file; /* file that has the address; "" for none */
    const char *node_name;  /* of this process among the nodes; "" for the name of the host */
    const char *blobs;      /* where those of a shared store are: "database", a folder, or s3://... */
    const char *blobs_keys; /* file with the keys of a bucket; "" for the environment */
    double store_unsafe;    /* 1: a database that does not wait for its disk is taken, too */
    double cache_bytes;     /* of blobs of a shared store in data_dir */
    const char *port_file;  /* file that receives the port once the daemon listens; "" for none */
    const char *dashboard;  /* folder of the page that is served at / */
    const char *log_format, *log_level;
    double port; /* 0: any free one */
    double max_job_seconds;
    double workers;         /* jobs that run at once */
    double job_threads;     /* threads of one job */
    double prepare_threads; /* threads that prepare one mesh; 0: one for each processor */
    double decodes;         /* meshes that are decoded at the same time */
    double max_body;        /* bytes of an upload */
    double max_data_bytes;  /* of all that is stored; 0: no limit */
    double max_faces;
    double memory_budget; /* bytes of meshes and jobs; 0: half of the memory */
    double queue;         /* max waiting jobs */
    double kept_jobs;     /* finished jobs that are kept */
    double kept_hours;    /* of a job; 0: any time */
    double connections;
    double client_connections; /* of one address; 0: any number */
    double streams;
    double heartbeat;       /* seconds between heartbeats of a silent stream */
    double idle_timeout;    /* seconds */
    double min_upload_rate; /* bytes a second; 0: any */
    double grace;           /* seconds that running jobs get at SIGTERM */
} qm_config;

typedef enum qm_config_outcome { QM_CONFIG_RUN, QM_CONFIG_EXIT_OK, QM_CONFIG_EXIT_USAGE } qm_config_outcome;

/**
 * Fills *config from defaults, the file of settings, QUADMESHD_* variables and flags; each overrides the ones before
 * it. Tasks are flags alone. --help, --version and --print-config print and ask to exit.
 *
 * A line of the file is "name = value", as --print-config writes it; # starts a comment.
 *
 * Strings point into argv, the environment or storage that lives as long as the process. Called once.
 */
qm_config_outcome qm_config_read(qm_config *config, int argc, char **argv);

#endif
