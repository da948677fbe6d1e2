/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The logger. Four threads:
 *   the main one   reads values, puts them into the queue; waits for the clock only
 *   finder         asks the store what items there are, opens those that are wanted
 *   disk           takes values out of the queue, writes files
 *   mender         at the start, for a while: files that a power cut left without an end
 */
#ifndef DDXLOG_LOGGER_H
#define DDXLOG_LOGGER_H

#include "logger_state.h"

/* Log until told to stop; returns the program's exit status. */
int logger_run(struct logger *logger);

#endif
