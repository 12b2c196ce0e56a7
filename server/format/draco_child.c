/**
 * draco_child.c: the process that decodes Draco files, and its parent.
 */
#include "draco_child.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/host.h"
#include "base/log.h"
#include "sandbox.h"

#define INPUT 3 /* descriptors of the child */
#define OUTPUT 4
#define EXIT_NO_MEMORY 3 /* of the child, when the arrays do not fit */
#define CPU_LIMIT_S 120
#define TIME_LIMIT_MS (3 * 1000 * CPU_LIMIT_S)
#define MEMORY_BASE ((size_t)512 << 20) /* of the program, and for any file */
#define MEMORY_PER_BYTE 20000           /* of the file; the most regular meshes compress that well */
#define MAX_QUANTIZATION_BITS 30

/** At the start of the shared memory; the arrays follow. */
typedef struct child_result {
    qm_draco_outcome outcome;
    uint64_t consumed;
    qm_draco_facts facts;
} child_result;

extern char **environ;
static const char *program = "/proc/self/exe";

void qm_draco_child_set_program(const char *path)
{
    program = path;
}

/** The offsets of the arrays and the total size; false for impossible counts. */
static bool lay_out(const qm_draco_facts *facts, size_t *triangles_at, size_t *added_at, size_t *size)
{
    if (facts->vertex_count > UINT32_MAX || facts->triangle_count > UINT32_MAX) return false;
    *triangles_at = sizeof(child_result) + 3 * sizeof(double) * facts->vertex_count;
    *added_at = *triangles_at + 3 * sizeof(uint32_t) * facts->triangle_count;
    *size = *added_at + (facts->has_added_edges ? 3 * facts->triangle_count : 0);
    return true;
}

/* ---- the child ---- */

typedef struct child {
    child_result *shared;
    size_t size;
} child;

/** Resizes the shared memory for the arrays, and returns them. */
static bool prepare_shared(void *user, const qm_draco_facts *facts, qm_draco_arrays *arrays)
{
    child *c = user;
    size_t triangles_at, added_at;
    munmap(c->shared, c->size);
    c->shared = NULL;
    if (!lay_out(facts, &triangles_at, &added_at, &c->size) || ftruncate(OUTPUT, (off_t)c->size) != 0)
        return false;
    void *mapped = mmap(NULL, c->size, PROT_READ | PROT_WRITE, MAP_SHARED, OUTPUT, 0);
    if (mapped == MAP_FAILED) return false;
    c->shared = mapped;
    c->shared->facts = *facts;
    arrays->positions = (double *)(void *)((char *)mapped + sizeof(child_result));
    arrays->triangles = (uint32_t *)(void *)((char *)mapped + triangles_at);
    arrays->added = facts->has_added_edges ? (uint8_t *)mapped + added_at : NULL;
    return true;
}

int qm_draco_child_main(void)
{
    struct stat input;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    syscall(SYS_close_range, OUTPUT + 1, ~0u, 0);
    if (fstat(INPUT, &input) != 0) return 1;
    size_t size = (size_t)input.st_size;
    /* Small files, which may be many, get little memory. */
    const size_t max_memory = qm_host_default_budget(), fair = MEMORY_PER_BYTE * size;
    qm_sandbox_limits limits = {MEMORY_BASE + (fair < max_memory ? fair : max_memory), CPU_LIMIT_S};
    const uint8_t *bytes = mmap(NULL, size, PROT_READ, MAP_SHARED, INPUT, 0);
    child c = {NULL, sizeof(child_result)};
    if (bytes == MAP_FAILED || ftruncate(OUTPUT, (off_t)c.size) != 0) return 1;
    c.shared = mmap(NULL, c.size, PROT_READ | PROT_WRITE, MAP_SHARED, OUTPUT, 0);
    if (c.shared == MAP_FAILED || !qm_sandbox_enter(&limits)) return 1;
    size_t consumed;
    qm_draco_outcome outcome = qm_draco_decode(bytes, size, prepare_shared, &c, &consumed);
    if (!c.shared) _exit(EXIT_NO_MEMORY);
    c.shared->consumed = consumed;
    c.shared->outcome = outcome;
    /* _exit runs no exit handlers of the library. */
    _exit(0);
}

/* ---- the parent ---- */

/** Shared memory with these bytes, or -1. Its descriptor is above those of the child. */
static int make_memory(const char *name, const uint8_t *bytes, size_t size)
{
    int low = memfd_create(name, MFD_CLOEXEC), file = low < 0 ? -1 : fcntl(low, F_DUPFD_CLOEXEC, OUTPUT + 1);
    if (low >= 0) close(low);
    while (file >= 0 && size > 0) {
        ssize_t written = write(file, bytes, size);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) {
            close(file);
            return -1;
        }
        bytes += written;
        size -= (size_t)written;
    }
    return file;
}

/** Starts the child; -1 after a log record. */
static pid_t start(int input, int output)
{
    char name[] = "quadmeshd", flag[] = QM_DRACO_CHILD_FLAG;
    char *const arguments[] = {name, flag, NULL};
    posix_spawn_file_actions_t actions;
    pid_t pid = -1;
    int error = posix_spawn_file_actions_init(&actions);
    if (error == 0) {
        posix_spawn_file_actions_adddup2(&actions, input, INPUT);
        posix_spawn_file_actions_adddup2(&actions, output, OUTPUT);
        error = posix_spawn(&pid, program, &actions, NULL, arguments, environ);
        posix_spawn_file_actions_destroy(&actions);
    }
    if (error != 0) qm_log(QM_LOG_ERROR, "the Draco decoder cannot be started: %s", strerror(error));
    return error == 0 ? pid : -1;
}

/** Waits for the child until its time limit; QM_DRACO_DONE when it has left an answer. */
static qm_draco_outcome wait_for(pid_t pid)
{
    int file = (int)syscall(SYS_pidfd_open, pid, 0), status = 0;
    struct pollfd end = {.fd = file, .events = POLLIN};
    int ended = file < 0 ? 1 : poll(&end, 1, TIME_LIMIT_MS);
    if (ended == 0) kill(pid, SIGKILL);
    if (file >= 0) close(file);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (WIFSIGNALED(status))
        qm_log(QM_LOG_WARN, "the Draco decoder was killed by signal %d", WTERMSIG(status));
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return QM_DRACO_DONE;
    bool is_over = ended == 0 || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) ||
                   (WIFEXITED(status) && WEXITSTATUS(status) == EXIT_NO_MEMORY);
    return is_over ? QM_DRACO_TOO_LARGE : QM_DRACO_MALFORMED;
}

/** Validates and copies the results of the child. */
static qm_draco_outcome take_arrays(const child_result *shared, size_t shared_size, qm_draco_prepare *prepare,
                                    void *user)
{
    const qm_draco_facts facts = shared->facts;
    size_t triangles_at, added_at, size;
    if (facts.quantization_bits < 0 || facts.quantization_bits > MAX_QUANTIZATION_BITS ||
        !isfinite(facts.range) || !isfinite(facts.magnitude) ||
        !lay_out(&facts, &triangles_at, &added_at, &size) || size != shared_size)
        return QM_DRACO_MALFORMED;
    qm_draco_arrays arrays = {0};
    if (!prepare(user, &facts, &arrays)) return QM_DRACO_STOPPED;
    const char *bytes = (const char *)shared;
    if (facts.vertex_count > 0)
        memcpy(arrays.positions, bytes + sizeof *shared, triangles_at - sizeof *shared);
    if (facts.triangle_count == 0) return QM_DRACO_DONE;
    memcpy(arrays.triangles, bytes + triangles_at, added_at - triangles_at);
    for (size_t i = 0; i < 3 * facts.triangle_count; i++)
        if (arrays.triangles[i] >= facts.vertex_count) return QM_DRACO_MALFORMED;
    if (facts.has_added_edges) memcpy(arrays.added, bytes + added_at, size - added_at);
    return QM_DRACO_DONE;
}

/** Called after the child has ended, so that the shared memory no longer changes. */
static qm_draco_outcome take_answer(int output, qm_draco_prepare *prepare, void *user, size_t *consumed)
{
    struct stat file;
    if (fstat(output, &file) != 0 || (size_t)file.st_size < sizeof(child_result)) return QM_DRACO_MALFORMED;
    size_t size = (size_t)file.st_size;
    const child_result *shared = mmap(NULL, size, PROT_READ, MAP_SHARED, output, 0);
    if (shared == MAP_FAILED) return QM_DRACO_NO_MEMORY;
    *consumed = (size_t)shared->consumed;
    qm_draco_outcome outcome = QM_DRACO_MALFORMED;
    if (shared->outcome == QM_DRACO_DONE) outcome = take_arrays(shared, size, prepare, user);
    if (shared->outcome == QM_DRACO_UNSUPPORTED) outcome = QM_DRACO_UNSUPPORTED;
    if (shared->outcome == QM_DRACO_NO_MEMORY) outcome = QM_DRACO_TOO_LARGE; /* of the child's own limit */
    munmap((void *)(uintptr_t)shared, size);
    return outcome;
}

qm_draco_outcome qm_draco_child_decode(const uint8_t *bytes, size_t size, qm_draco_prepare *prepare,
                                       void *user, size_t *consumed)
{
    qm_draco_outcome outcome = QM_DRACO_NO_MEMORY;
    int input = make_memory("draco-file", bytes, size), output = make_memory("draco-arrays", NULL, 0);
    *consumed = 0;
    pid_t pid = input >= 0 && output >= 0 ? start(input, output) : -1;
    if (pid > 0) outcome = wait_for(pid);
    if (outcome == QM_DRACO_DONE) outcome = take_answer(output, prepare, user, consumed);
    if (*consumed > size) outcome = QM_DRACO_MALFORMED;
    if (input >= 0) close(input);
    if (output >= 0) close(output);
    return outcome;
}
