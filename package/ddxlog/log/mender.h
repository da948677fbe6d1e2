/* SPDX-License-Identifier: GPL-2.0-or-later */
/* At the start: repair of files that a power cut has truncated. */
#ifndef DDXLOG_MENDER_H
#define DDXLOG_MENDER_H

/* The thread; `argument` is a struct logger. */
void *mender_run(void *argument);

#endif
