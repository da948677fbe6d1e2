/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The commands of ddxupdate. Each returns the exit status: 0 done, 1 failed, 2 refused, and nothing was written. */
#ifndef DDXUPDATE_COMMAND_H
#define DDXUPDATE_COMMAND_H

#include "place.h"

struct request {
    struct place place;
    const char *boot;     /* device of the boot partition */
    const char *slots[2]; /* of slots A and B */
    const char *reason;   /* -reason: why the version is taken back; or "" */
    bool older;           /* -older: also a version with a lower serial */
    bool json;
};

/* At the end of a boot: the slot has come up. 3: it is on trial, so nothing was written. */
int command_block(const struct request *request);

/* Write the update on standard input into the slot that does not run. */
int command_write(const struct request *request);

/* Choose the slot that does not run for the next start. */
int command_start(const struct request *request);

/* The same for an older version; in a trial, take the version back. */
int command_back(const struct request *request);

/* Watch the version on trial, until it is kept. 0: kept, or a person has decided; else the reason is printed. */
int command_trial(const struct request *request);

/* Keep the version on trial now. */
int command_keep(const struct request *request);

/* Choose the former version again, for this reason. 0: the machine is to be restarted; 1: it must not be, since that
 * would not lead to another version. */
int command_return(const struct request *request);

/* At the begin of a boot: if the version on trial was given up, note this. 1: it was not. */
int command_ended(const struct request *request);

/* The technician knows that a version was taken back. */
int command_seen(const struct request *request);

/* Start the watchdog, which is the device `boot`, with the time of a trial's boot. */
int command_watchdog(const struct request *request);

/* Print what is in both slots. */
int command_status(const struct request *request);

#endif
