/**
 * database.h: databases of a PostgreSQL server for tests.
 */
#ifndef QM_DATABASE_H
#define QM_DATABASE_H

#include <stdint.h>

/** The address of the server, of the form postgres://USER@HOST:PORT/DATABASE, whose user may do everything: that of
 * QM_TEST_POSTGRES; NULL: there is none. */
const char *qm_database_server(void);

/** Host and port of an address of that form. */
void qm_database_host(const char *address, char host[64], int *port);

/** The address with another host and port; to be freed. */
char *qm_database_move(const char *address, const char *host, int port);

/** A new empty database; its address is the caller's, for qm_database_drop. */
char *qm_database_make(void);

/** Removes the database with its connections, and frees the address. */
void qm_database_drop(char *address);

/** Makes the tables of a store those of version 1, with what they hold. */
void qm_database_age(const char *address);

/** Runs statements; returns the first value of the last one as a number, or 0. A fault ends the test program. */
int64_t qm_database_ask(const char *address, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
