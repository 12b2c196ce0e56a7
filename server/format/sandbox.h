/**
 * sandbox.h: a process gives up what it does not need, before it reads bytes of a stranger. Linux only.
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
 * From here on the calling process, which has one thread, computes on the memory and the files that it has
 * open: it opens no file, starts nothing and talks to nobody. Landlock and a filter of system calls see to
 * that where the kernel has them; the limits hold everywhere. A call that is not allowed kills the process.
 *
 * False when a limit or a filter that the kernel has cannot be set. Builds with sanitizers, which make system
 * calls and reserve addresses of their own, get the limit of processor time alone.
 */
bool qm_sandbox_enter(const qm_sandbox_limits *limits);

#endif
