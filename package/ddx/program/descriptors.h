/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Standard input, output and error: the first thing that every program sees to. */
#ifndef DDX_DESCRIPTORS_H
#define DDX_DESCRIPTORS_H

#include <fcntl.h>
#include <unistd.h>

/*
 * Where one of the three is closed, /dev/null is opened: else a socket or a frame's memory file would get its number,
 * and what the program says would be written into that.
 */
static inline void descriptors_open(void) {
    int fd;

    do
        fd = open("/dev/null", O_RDWR);
    while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0)
        close(fd);
}

#endif
