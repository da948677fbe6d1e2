/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that writes the files. */
#ifndef DDXLOG_DISK_H
#define DDXLOG_DISK_H

#include "logger_state.h"

/* Begins the thread. 0 or -errno after a line. */
int disk_start(struct logger *logger);
/* 0, or -errno: it failed, and all that comes is lost. */
int disk_error(const struct disk *disk);
/* Write what is in the queue, end the file. 0 or -errno, after a line. */
int disk_stop(struct disk *disk);

#endif
