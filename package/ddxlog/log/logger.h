/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The logger. Four threads:
 *   main     reads values, puts them into the queue; waits only for the clock
 *   finder   lists the store's items, opens those to be logged
 *   disk     takes values out of the queue, writes files
 *   mender   after the start: repairs files that a power cut has truncated
 */
#ifndef DDXLOG_LOGGER_H
#define DDXLOG_LOGGER_H

#include "disk.h"

/* Log until a request to stop; returns the program's exit status. */
int logger_run(struct logger *logger);

#endif
