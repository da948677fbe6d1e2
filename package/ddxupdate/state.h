/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The machine's notes about its updates: /data/update, lines NAME=VALUE. The file is replaced as a whole, so a
 * power cut leaves the old or the new one. Lines of other versions of this program stay.
 *
 *   proven   the slot that has come up last as the chosen one
 *   tried    the slot of the last `start` or `back`
 *   version  what that slot contains
 *   result   of its trial: begun, kept, returned
 *   reason   why it was taken back
 *   seen     yes: a technician knows that
 *   runs, flows, links, addresses, ssh, watchdog
 *            the machine before the restart: sight.h
 */
#ifndef DDXUPDATE_STATE_H
#define DDXUPDATE_STATE_H

#include <stdbool.h>
#include <stddef.h>

struct state_line {
    const char *name, *value;
};

/* The value of a line; empty if there is none. */
void state_get(const char *path, const char *name, char *value, size_t size);

/* Whether a line has this value. */
bool state_is(const char *path, const char *name, const char *value);

/* Set these lines, and keep the others. 0, or -errno after a line. */
int state_set(const char *path, const struct state_line *lines, size_t count);

/* The slot that has come up last as the chosen one; 0: it is not known. */
char state_proven(const char *path);

/* Remember that slot. A failure, such as a full /data, is only reported: it must not prevent a boot or an update. */
void state_prove(const char *path, char slot);

#endif
