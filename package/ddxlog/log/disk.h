/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that writes the files. */
#ifndef DDXLOG_DISK_H
#define DDXLOG_DISK_H

#include "logger_state.h"

/* Start the thread. 0, or -errno after a line. */
int disk_start(struct logger *logger);
/* 0, or -errno: writing has failed, and all later values are lost. */
int disk_error(const struct disk *disk);
/* Write the queued values and finish the file. 0, or -errno after a line. */
int disk_stop(struct disk *disk);

#endif
