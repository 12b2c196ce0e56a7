#include "large_pages.h"

#include <limits.h>
#include <malloc.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define SMALL_PAGE ((size_t)4 << 10)
#define LARGE_PAGE ((size_t)2 << 20)
#define HEAP_ROOM ((size_t)256 << 20)   /* of large pages, of which only those that are used are taken */
#define HEAP_LEAST ((size_t)32 << 20)   /* from here on malloc maps a block of its own, whatever it is told */
#define FIRST_BLOCK ((size_t)144 << 10) /* more than is free in a heap that has just begun */

static size_t least_mapped = LARGE_PAGE / 2; /* bytes of a block that is mapped */

/* The sanitizer sees only what malloc gives. */
#ifdef __SANITIZE_ADDRESS__
#define IS_MAPPING false
#else
#define IS_MAPPING true
#endif

static bool is_mapped(size_t size)
{
    return IS_MAPPING && size >= least_mapped;
}

static size_t round_up(size_t size, size_t page)
{
    return (size + page - 1) & ~(page - 1);
}

static size_t mapped_size(size_t size)
{
    return round_up(size, size % LARGE_PAGE >= LARGE_PAGE / 2 ? LARGE_PAGE : SMALL_PAGE);
}

/** Maps a little too much, and gives back what lies before the first large page and behind the block. */
static void *map(size_t size)
{
    size_t length = mapped_size(size);
    char *area = mmap(NULL, length + LARGE_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (area == MAP_FAILED) return NULL;
    size_t before = round_up((uintptr_t)area, LARGE_PAGE) - (uintptr_t)area;
    if (before > 0) munmap(area, before);
    if (before < LARGE_PAGE) munmap(area + before + length, LARGE_PAGE - before);
    madvise(area + before, length, MADV_HUGEPAGE);
    return area + before;
}

static void release(void *block, size_t size)
{
    if (is_mapped(size))
        munmap(block, mapped_size(size));
    else
        free(block);
}

/** To a mapped block, or from one. */
static void *copy(void *block, size_t old_size, size_t new_size)
{
    void *copied = is_mapped(new_size) ? map(new_size) : malloc(new_size);
    if (!copied || !block) return copied;
    memcpy(copied, block, old_size < new_size ? old_size : new_size);
    release(block, old_size);
    return copied;
}

/** From mapped to mapped: pages change their place, not their content. */
static void *remap(void *block, size_t old_size, size_t new_size)
{
    size_t old_length = mapped_size(old_size), new_length = mapped_size(new_size);
    if (new_length <= old_length) {
        if (new_length < old_length) munmap((char *)block + new_length, old_length - new_length);
        return block;
    }
    void *larger = map(new_size);
    if (!larger) return NULL;
    if (mremap(block, old_length, old_length, MREMAP_MAYMOVE | MREMAP_FIXED, larger) != MAP_FAILED)
        return larger;
    munmap(larger, new_length);
    return NULL;
}

static void *resize(void *user, void *block, size_t old_size, size_t new_size)
{
    (void)user;
    if (new_size == 0) {
        if (block) release(block, old_size);
        return NULL;
    }
    if (new_size > SIZE_MAX / 2) return NULL; /* sizes could not be rounded up */
    if (!is_mapped(old_size) && !is_mapped(new_size)) return realloc(block, new_size);
    if (is_mapped(old_size) && is_mapped(new_size)) return remap(block, old_size, new_size);
    return copy(block, old_size, new_size);
}

/** The heap is made to grow from a little below a large page, so that what malloc writes at its start leaves
 * that page untouched: a page that is in use before the advice stays many small ones. */
void qm_large_pages_for_heap(void)
{
    if (!IS_MAPPING) return;
    const uintptr_t end = (uintptr_t)sbrk(0), page = round_up(end + FIRST_BLOCK, LARGE_PAGE);
    if (sbrk((intptr_t)(page - FIRST_BLOCK - end)) == (void *)-1) return;
    /* One arena, for those of threads lie elsewhere; and what is free stays with the process, for others. */
    mallopt(M_ARENA_MAX, 1);
    mallopt(M_TRIM_THRESHOLD, INT_MAX);
    mallopt(M_MMAP_THRESHOLD, (int)HEAP_LEAST);
    mallopt(M_TOP_PAD, (int)HEAP_ROOM);
    void *volatile block = malloc(FIRST_BLOCK - SMALL_PAGE);
    free(block);
    mallopt(M_TOP_PAD, (int)LARGE_PAGE);
    const uintptr_t top = (uintptr_t)sbrk(0);
    if (top > page) madvise((void *)page, top - page, MADV_HUGEPAGE);
    least_mapped = HEAP_LEAST;
}

const qm_allocator qm_large_pages = {.resize = resize, .user = NULL};
