/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Exit status of all programs: done, failed, bad usage or bad input. */
#ifndef DDX_EXIT_STATUS_H
#define DDX_EXIT_STATUS_H

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

#endif
