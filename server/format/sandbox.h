/**
 * sandbox.h: drops the rights of a process before it reads untrusted bytes. Linux only.
 */
#ifndef QM_SANDBOX_H
#define QM_SANDBOX_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_sandbox_limits {
    size_t memory; /* bytes of address space */
    int cpu_s;     /* seconds of processor time, after which the process is killed */
} qm_sandbox_limits;

/**
 * From now on the calling process, which has one thread, can use its memory and its open files only: it cannot open
 * files, start processes or use sockets. Landlock and a filter of system calls enforce this if the kernel has them; the
 * limits hold everywhere. A forbidden call kills the process.
 *
 * False if a limit, or a filter that the kernel has, cannot be set. Builds with sanitizers, which make system calls and
 * reserve addresses of their own, get the limit of processor time only.
 */
bool qm_sandbox_enter(const qm_sandbox_limits *limits);

#endif
