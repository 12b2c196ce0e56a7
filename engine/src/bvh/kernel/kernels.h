/**
 * kernels.h: declares the kernels of the instruction set QM_ISA, each as QM_KERNEL(name). Without an include
 * guard: kernel.c includes it once for each set.
 */
#include "bvh/kernel.h"

#define KERNEL_ENTRY(type, name, parameters) type QM_KERNEL(name) parameters;
#include "bvh/kernel_table.inc"
#undef KERNEL_ENTRY
