/* SPDX-License-Identifier: GPL-2.0-or-later */
/* For all programs, also those without program.h: the first step, the answer to -version, exit statuses. */
#ifndef DDX_STARTUP_H
#define DDX_STARTUP_H

/* Exit status: done, failed, bad usage or bad input. */
enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

/*
 * To be called first. Open /dev/null for each of standard input, output and error that is closed: otherwise a socket or
 * a frame's memory file would get that number, and the program's messages would be written into it.
 */
void descriptors_open(void);

/*
 * Print to stdout "NAME NUMBER", and on the appliance a second line "image: " with number, commit, board and base of
 * the image. Only the first is built in, so that a new commit does not rebuild every program.
 */
void version_print(const char *name);

#endif
