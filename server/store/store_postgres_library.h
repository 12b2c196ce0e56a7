/**
 * store_postgres_library.h: the functions of libpq that the driver uses. The library is loaded when a shared store is
 * opened, so that a daemon with an embedded one runs without it.
 */
#ifndef QM_STORE_POSTGRES_LIBRARY_H
#define QM_STORE_POSTGRES_LIBRARY_H

#include <postgresql/libpq-fe.h>
#include <stdbool.h>

#include "qm/context.h"

#define QM_PQ_MAP(XX)                                                                                        \
    XX(connectdbParams)                                                                                      \
    XX(status)                                                                                               \
    XX(errorMessage)                                                                                         \
    XX(finish)                                                                                               \
    XX(serverVersion)                                                                                        \
    XX(parameterStatus)                                                                                      \
    XX(transactionStatus)                                                                                    \
    XX(setnonblocking)                                                                                       \
    XX(setNoticeReceiver)                                                                                    \
    XX(socket)                                                                                               \
    XX(sendQuery)                                                                                            \
    XX(sendPrepare)                                                                                          \
    XX(sendQueryParams)                                                                                      \
    XX(sendQueryPrepared)                                                                                    \
    XX(flush)                                                                                                \
    XX(notifies)                                                                                             \
    XX(freemem)                                                                                              \
    XX(consumeInput)                                                                                         \
    XX(isBusy)                                                                                               \
    XX(getResult)                                                                                            \
    XX(resultStatus)                                                                                         \
    XX(resultErrorField)                                                                                     \
    XX(clear)                                                                                                \
    XX(ntuples)                                                                                              \
    XX(getvalue)                                                                                             \
    XX(getlength)                                                                                            \
    XX(getisnull)

/** Each function without the PQ of its name. */
typedef struct qm_pq_functions {
#define XX(name) __typeof__(PQ##name) *name;
    QM_PQ_MAP(XX)
#undef XX
} qm_pq_functions;

extern qm_pq_functions qm_pq;

/** Loads the library, which stays loaded. False with a message. */
bool qm_postgres_load_library(char message[QM_MESSAGE_SIZE]);

#endif
