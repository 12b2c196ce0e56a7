#include "host.h"

#include "large_pages.h"
#include "parallel.h"

qm_context qm_host_context(void)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_parallel_run;
    ctx.allocator = qm_large_pages;
    return ctx;
}
