/**
 * large_pages.h: memory whose large blocks lie on large pages, and go back to the system at once.
 */
#ifndef QM_LARGE_PAGES_H
#define QM_LARGE_PAGES_H

#include "qm/base.h"

/**
 * Blocks below a megabyte are those of malloc. Larger ones are mapped, on pages of 2 MiB where the system has
 * them: a page is set up once, not 512 times, and its address looked up in one place instead of 512, which is
 * what much of building a tree was waiting for. The last page of a block is a large one when it is filled by
 * half at least, so that no block takes more than a megabyte too much. A virtual machine that gives free
 * memory back to its host waits for 2 MiB at a time when it is used again after a pause. For any thread.
 */
extern const qm_allocator qm_large_pages;

/**
 * For a process that answers one question: from now on malloc's heap lies on large pages, its blocks of up to
 * 32 MiB are those of this allocator too, and what is freed of it stays with the process. Blocks that come
 * one after the other then share pages that are set up already. Before other threads and the first block.
 */
void qm_large_pages_for_heap(void);

#endif
