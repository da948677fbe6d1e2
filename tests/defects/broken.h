/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The first header of each source that is compiled with the defects of this folder. DDX_BROKEN switches one on. */
#ifndef BROKEN_H
#define BROKEN_H

#include <stdlib.h>
#include <string.h>

static inline int ddx_broken(const char *name) {
    const char *wanted = getenv("DDX_BROKEN");

    return wanted && !strcmp(wanted, name);
}

#endif
