/* SPDX-License-Identifier: GPL-2.0-or-later */
/* decode -list: lists the streams that are announced in the network (SAP). */
#ifndef DDXVIDEO_LIST_H
#define DDXVIDEO_LIST_H

/*
 * Listen for LIST_SECONDS, or until a stop is requested, and print a line for each stream. `interface`: NULL: by the
 * routing table. Returns the exit status: failed if the announcements' port or groups are not available.
 */
#define LIST_SECONDS 6 /* our senders announce each 5 s */
int list_run(const char *interface);

#endif
