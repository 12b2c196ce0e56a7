/**
 * database.c: databases for tests, which libpq makes and removes.
 */
#include "database.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "store/store_postgres_library.h"

const char *qm_database_server(void)
{
    const char *address = getenv("QM_TEST_POSTGRES");
    return address && address[0] ? address : NULL;
}

static void stop(const char *address, const char *message)
{
    fprintf(stderr, "%s: %s\n", address, message);
    abort();
}

/** The part of an address after USER@. */
static const char *find_host(const char *address)
{
    const char *at = strchr(address, '@');
    if (!at || !strchr(at, ':') || !strchr(at, '/')) stop(address, "not postgres://USER@HOST:PORT/DATABASE");
    return at + 1;
}

void qm_database_host(const char *address, char host[64], int *port)
{
    const char *start = find_host(address), *colon = strchr(start, ':');
    snprintf(host, 64, "%.*s", (int)(colon - start), start);
    *port = atoi(colon + 1);
}

char *qm_database_move(const char *address, const char *host, int port)
{
    const char *start = find_host(address);
    size_t size = strlen(address) + strlen(host) + 16;
    char *out = malloc(size);
    if (!out) abort();
    snprintf(out, size, "%.*s%s:%d%s", (int)(start - address), address, host, port, strchr(start, '/'));
    return out;
}

int64_t qm_database_ask(const char *address, const char *format, ...)
{
    char message[QM_MESSAGE_SIZE], sql[4096];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(sql, sizeof sql, format, arguments);
    va_end(arguments);
    if (!qm_postgres_load_library(message)) stop(address, message);
    const char *const names[] = {"dbname", NULL}, *const values[] = {address, NULL};
    PGconn *link = qm_pq.connectdbParams(names, values, 1);
    if (qm_pq.status(link) != CONNECTION_OK || !qm_pq.sendQuery(link, sql))
        stop(sql, qm_pq.errorMessage(link));
    int64_t value = 0;
    for (PGresult *result; (result = qm_pq.getResult(link)); qm_pq.clear(result)) {
        ExecStatusType kind = qm_pq.resultStatus(result);
        if (kind != PGRES_TUPLES_OK && kind != PGRES_COMMAND_OK) stop(sql, qm_pq.errorMessage(link));
        if (qm_pq.ntuples(result) > 0) value = strtoll(qm_pq.getvalue(result, 0, 0), NULL, 10);
    }
    qm_pq.finish(link);
    return value;
}

char *qm_database_make(void)
{
    static int count;
    char name[64];
    const char *server = qm_database_server();
    if (!server) stop("QM_TEST_POSTGRES", "not set");
    snprintf(name, sizeof name, "qm_test_%ld_%d", (long)getpid(), count++);
    qm_database_ask(server, "CREATE DATABASE %s ENCODING 'UTF8' TEMPLATE template0", name);
    int length = (int)(strchr(find_host(server), '/') + 1 - server);
    char *address = malloc(strlen(server) + sizeof name);
    if (!address) abort();
    snprintf(address, strlen(server) + sizeof name, "%.*s%s", length, server, name);
    return address;
}

void qm_database_drop(char *address)
{
    qm_database_ask(qm_database_server(), "DROP DATABASE %s WITH (FORCE)", strrchr(address, '/') + 1);
    free(address);
}

void qm_database_age(const char *address)
{
    qm_database_ask(
        address,
        "DROP TABLE quadmeshd.job_parts, quadmeshd.job_bounds, quadmeshd.blob_place, quadmeshd.blob_objects;"
        " ALTER TABLE quadmeshd.meshes DROP COLUMN unit, DROP COLUMN uncertainty, DROP COLUMN labels;"
        " ALTER TABLE quadmeshd.jobs DROP COLUMN labels;"
        " UPDATE quadmeshd.about SET version = 1");
}
