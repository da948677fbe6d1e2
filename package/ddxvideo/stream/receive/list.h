/* SPDX-License-Identifier: GPL-2.0-or-later */
/* decode -list: the streams that are announced in the network (SAP). */
#ifndef DDXVIDEO_LIST_H
#define DDXVIDEO_LIST_H

/*
 * Listens for LIST_SECONDS, or until told to stop, and prints a line for each stream. `interface`: NULL as the routing
 * table says. Returns the exit status: failed if the announcements' port or groups are not available.
 */
#define LIST_SECONDS 6 /* our senders announce each 5 s */
int list_run(const char *interface);

#endif
