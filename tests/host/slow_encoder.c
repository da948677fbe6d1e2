/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Preloaded: an encoder whose first use takes long: the first avcodec_open2() waits while $SLOW_ENCODER exists. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>

int avcodec_open2(void *context, const void *codec, void *options) {
    static int (*next)(void *context, const void *codec, void *options);
    const char *file = getenv("SLOW_ENCODER");

    while (!next && file && !access(file, F_OK))
        usleep(1000);
    *(void **)&next = dlsym(RTLD_NEXT, "avcodec_open2");
    return next(context, codec, options);
}
