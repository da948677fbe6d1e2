/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Error messages. */
#include <stdio.h>

#include "ddxctl.h"

int complain(const char *item, int error) {
    if (item)
        fprintf(stderr, "ddxctl: %s: %s\n", item, ddx_error_text(error));
    else
        fprintf(stderr, "ddxctl: %s\n", ddx_error_text(error));
    return 1;
}
