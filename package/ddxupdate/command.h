/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The commands of ddxupdate. Each returns the exit status: 0 done, 1 failed, 2 refused, and nothing was written. */
#ifndef DDXUPDATE_COMMAND_H
#define DDXUPDATE_COMMAND_H

#include "place.h"

struct request {
    struct place place;
    const char *boot; /* device of the boot partition */
};

/* At the end of a boot: the slot has come up. */
int command_block(const struct request *request);

#endif
