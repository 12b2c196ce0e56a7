/*
 * A library to preload into the daemon: one chosen allocation fails, whichever code makes it.
 *
 * The environment names in FAILING_MALLOC a file of two 64-bit numbers. While the first is greater than 0
 * every allocation of the process counts it down, and the one that brings it to 0 fails; the second counts
 * those that have failed. Other programs get their memory as ever.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

typedef struct control {
    _Atomic int64_t left, failed;
} control;

static control *shared;
static void *(*next_malloc)(size_t), *(*next_calloc)(size_t, size_t), *(*next_realloc)(void *, size_t);
static int (*next_posix_memalign)(void **, size_t, size_t);
static void *(*next_aligned_alloc)(size_t, size_t);
static void (*next_free)(void *);
static int is_ready;

/** Allocations before the functions are known, each block after its size; never used again. */
static _Alignas(16) char early[1 << 20];
static size_t early_size;

static void *take_early(size_t size)
{
    size_t whole = (size + 31) & ~(size_t)15;
    if (sizeof early - early_size < whole) abort();
    char *taken = early + early_size;
    early_size += whole;
    memcpy(taken, &size, sizeof size);
    return taken + 16;
}

static int is_early(const void *block)
{
    return (const char *)block >= early && (const char *)block < early + sizeof early;
}

static void *find(const char *name)
{
    void *found = dlsym(RTLD_NEXT, name);
    if (!found) abort();
    return found;
}

/* The sanitizers' own start asks for memory before anything can be looked up. */
__attribute__((constructor)) static void begin(void)
{
    *(void **)&next_malloc = find("malloc");
    *(void **)&next_calloc = find("calloc");
    *(void **)&next_realloc = find("realloc");
    *(void **)&next_posix_memalign = find("posix_memalign");
    *(void **)&next_aligned_alloc = find("aligned_alloc");
    *(void **)&next_free = find("free");
    is_ready = 1;
    const char *path = getenv("FAILING_MALLOC");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *mapped = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (mapped != MAP_FAILED) shared = mapped;
}

/** AddressSanitizer's own calls of the C library cannot go on without memory; those of the program it answers
 * itself. */
static int is_for_sanitizer(const void *caller)
{
    Dl_info info;
    return dlsym(RTLD_DEFAULT, "__asan_init") && dladdr(caller, &info) && strstr(info.dli_fname, "/libc.so");
}

static int fails(const void *caller)
{
    if (!shared || atomic_load(&shared->left) <= 0) return 0;
    if (atomic_fetch_sub(&shared->left, 1) != 1) return 0;
    if (is_for_sanitizer(caller)) {
        atomic_fetch_add(&shared->left, 1);
        return 0;
    }
    atomic_fetch_add(&shared->failed, 1);
    errno = ENOMEM;
    return 1;
}

void *malloc(size_t size)
{
    if (!is_ready) return take_early(size);
    return fails(__builtin_return_address(0)) ? NULL : next_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    if (!is_ready) return take_early(count * size);
    return fails(__builtin_return_address(0)) ? NULL : next_calloc(count, size);
}

static void *grow_early(void *block, size_t size)
{
    size_t before;
    memcpy(&before, (char *)block - 16, sizeof before);
    void *grown = malloc(size);
    if (grown) memcpy(grown, block, before < size ? before : size);
    return grown;
}

void *realloc(void *block, size_t size)
{
    if (is_early(block)) return grow_early(block, size);
    if (!is_ready) return take_early(size);
    return fails(__builtin_return_address(0)) ? NULL : next_realloc(block, size);
}

int posix_memalign(void **out, size_t alignment, size_t size)
{
    if (!is_ready) return ENOMEM;
    return fails(__builtin_return_address(0)) ? ENOMEM : next_posix_memalign(out, alignment, size);
}

void *aligned_alloc(size_t alignment, size_t size)
{
    if (!is_ready) return NULL;
    return fails(__builtin_return_address(0)) ? NULL : next_aligned_alloc(alignment, size);
}

void free(void *block)
{
    if (block && !is_early(block) && is_ready) next_free(block);
}
