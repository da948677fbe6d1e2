/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The answer to -version. */
#ifndef DDX_VERSION_H
#define DDX_VERSION_H

/* Print to stdout "NAME NUMBER", and on the appliance a second line "image: " with number, commit, board and base of
 * the image. Only the first is built in, so that a new commit does not rebuild every program. */
void version_print(const char *name);

#endif
