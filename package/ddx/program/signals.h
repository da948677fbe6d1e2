/* SPDX-License-Identifier: GPL-2.0-or-later */
/* TERM and INT: stop. USR1: print the counters. */
#ifndef DDX_SIGNALS_H
#define DDX_SIGNALS_H

#include <ddx_stats.h>
#include <stdbool.h>

/* TERM or INT came: finish, within five seconds. A program still running then is ended, with exit 0. */
bool program_stopping(void);

/* That was more than three seconds ago: no more waiting for another program. From any thread. */
bool program_has_no_patience(void);

/* Where the counters go: standard output, unless it is wanted for something else. */
void program_report_to(FILE *file);

/* Print the counters' JSON line. */
void program_report(DDX_STATS_BOOK *book);

/* USR1 came. */
bool program_report_wanted(void);

/* For program_start(). */
void signals_catch(void);

#endif
