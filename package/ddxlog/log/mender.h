/* SPDX-License-Identifier: GPL-2.0-or-later */
/* At the start: files that a power cut left without an end get one. */
#ifndef DDXLOG_MENDER_H
#define DDXLOG_MENDER_H

/* The thread; `argument` is a struct logger. */
void *mender_run(void *argument);

#endif
