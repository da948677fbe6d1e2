/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * matcher_client WIDTH HEIGHT DISPARITIES: the matcher alone, for another processor. Reads left and right picture from
 * standard input; for each variant that the processor supports, writes the disparities to stdout, its name to stderr.
 */
#include <stdio.h>
#include <stdlib.h>

#include "kernel.h"
#include "matcher.h"

int main(int argc, char **argv) {
    struct matcher_settings settings = {.uniqueness = 5, .agreement = 1, .speckle = 50};

    if (argc != 4)
        return 2;
    settings.width = atoi(argv[1]);
    settings.height = atoi(argv[2]);
    settings.disparities = atoi(argv[3]);
    size_t pixels = (size_t)settings.width * (size_t)settings.height;
    uint8_t *pair = malloc(2 * pixels);
    uint16_t *disparity = malloc(pixels * sizeof *disparity);
    if (!pair || !disparity || fread(pair, 1, 2 * pixels, stdin) != 2 * pixels)
        return 1;
    for (const struct kernel *const *kernel = kernel_available(); *kernel; kernel++) {
        settings.variant = (*kernel)->name;
        struct matcher *matcher = matcher_new(&settings);
        if (!matcher)
            return 1;
        matcher_run(matcher, pair, settings.width, pair + pixels, settings.width, disparity);
        matcher_free(matcher);
        fprintf(stderr, "%s\n", settings.variant);
        if (fwrite(disparity, sizeof *disparity, pixels, stdout) != pixels)
            return 1;
    }
    free(pair);
    free(disparity);
    return 0;
}
