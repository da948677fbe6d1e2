/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A log as tables: one CSV file for each item. */
#ifndef DDXLOG_EXPORT_H
#define DDXLOG_EXPORT_H

/*
 * Write <item>.csv into the folder, which is made if it does not exist; existing files are not overwritten. Returns the
 * program's exit status, after a line if it is not 0.
 */
int export_run(const char *path, const char *folder);

#endif
