/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "kernel.h"

#include <stddef.h>

#if defined __x86_64__ || defined __i386__
const struct kernel *const *kernel_available(void) {
    static const struct kernel *found[5];
    int n = 0;

    found[n++] = &kernel_scalar;
    __builtin_cpu_init();
    if (__builtin_cpu_supports("mmx"))
        found[n++] = &kernel_mmx;
    if (__builtin_cpu_supports("sse2"))
        found[n++] = &kernel_sse2;
    if (__builtin_cpu_supports("avx2"))
        found[n++] = &kernel_avx2;
    return found;
}
#else
const struct kernel *const *kernel_available(void) {
    static const struct kernel *const found[] = {&kernel_scalar, NULL};

    return found;
}
#endif
