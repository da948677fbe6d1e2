/* SPDX-License-Identifier: GPL-2.0-or-later */
/* TERM and INT: stop. USR1: print the counters. */
#ifndef DDX_SIGNALS_H
#define DDX_SIGNALS_H

#include <ddx_stats.h>
#include <stdbool.h>

/* TERM or INT came: finish within five seconds. If the program still runs then, a timer exits it, with exit 0. */
bool program_stopping(void);

/* The request to stop came more than three seconds ago: do not wait for other programs any more. From any thread. */
bool program_has_no_patience(void);

/* Set the destination of the counters (default: standard output), if standard output has another use. */
void program_report_to(FILE *file);

/* Print the counters' JSON line. */
void program_report(DDX_STATS_BOOK *book);

/* USR1 came. */
bool program_report_wanted(void);

/* For program_start(). */
void signals_catch(void);

#endif
