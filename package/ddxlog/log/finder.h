/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that asks the store which items there are. */
#ifndef DDXLOG_FINDER_H
#define DDXLOG_FINDER_H

/* The thread; `logger` is a struct logger. It exits soon after `stopping`. */
void *finder_run(void *logger);

#endif
