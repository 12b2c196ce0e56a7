/**
 * kernel.c: the table of the kernels of each instruction set, and the choice among them at run time.
 */
#include "kernel.h"

#define QM_ISA portable
#include "bvh/kernel/kernels.h"
#define KERNEL_ENTRY(type, name, parameters) QM_KERNEL(name),
static const qm_kernel kernel_portable = {
    "portable",
#include "kernel_table.inc"
};
#undef KERNEL_ENTRY
#undef QM_ISA

#define QM_ISA avx2
#include "bvh/kernel/kernels.h"
#define KERNEL_ENTRY(type, name, parameters) QM_KERNEL(name),
static const qm_kernel kernel_avx2 = {
    "avx2",
#include "kernel_table.inc"
};
#undef KERNEL_ENTRY
#undef QM_ISA

#define QM_ISA avx512
#include "bvh/kernel/kernels.h"
#define KERNEL_ENTRY(type, name, parameters) QM_KERNEL(name),
static const qm_kernel kernel_avx512 = {
    "avx512",
#include "kernel_table.inc"
};
#undef KERNEL_ENTRY
#undef QM_ISA

static const qm_kernel *const with_avx512[] = {&kernel_avx512, &kernel_avx2, &kernel_portable, NULL};
static const qm_kernel *const with_avx2[] = {&kernel_avx2, &kernel_portable, NULL};
static const qm_kernel *const with_none[] = {&kernel_portable, NULL};

const qm_kernel *const *qm_kernel_list(void)
{
    bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2");
    bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return has_avx512 ? with_avx512 : has_avx2 ? with_avx2 : with_none;
}

const qm_kernel *qm_kernel_get(void)
{
    return qm_kernel_list()[0];
}

const char *qm_kernel_name(void)
{
    return qm_kernel_get()->name;
}
