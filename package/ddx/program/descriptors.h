/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Standard input, output and error: every program checks them first. */
#ifndef DDX_DESCRIPTORS_H
#define DDX_DESCRIPTORS_H

#include <fcntl.h>
#include <unistd.h>

/*
 * Open /dev/null for each of the three that is closed: otherwise a socket or a frame's memory file would get that
 * number, and the program's messages would be written into it.
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
