/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The commands of ddxupdate. Each returns the exit status: 0 done, 1 failed, 2 refused, and nothing was written. */
#ifndef DDXUPDATE_COMMAND_H
#define DDXUPDATE_COMMAND_H

#include "place.h"

struct request {
    struct place place;
    const char *boot;     /* device of the boot partition */
    const char *slots[2]; /* of slots A and B */
    bool older;           /* -older: also a version with a lower serial */
    bool json;
};

/* At the end of a boot: the slot has come up. */
int command_block(const struct request *request);

/* Write the update on standard input into the slot that does not run. */
int command_write(const struct request *request);

/* Choose the slot that does not run for the next start. */
int command_start(const struct request *request);

/* The same for an older version; in the first start of a new one, choose the former version again. */
int command_back(const struct request *request);

/* Print what is in both slots. */
int command_status(const struct request *request);

#endif
