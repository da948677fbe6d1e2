/* SPDX-License-Identifier: GPL-2.0-or-later */
/* How a trial ends: in the boot loader's block, and in what the machine remembers. */
#ifndef DDXUPDATE_DECIDE_H
#define DDXUPDATE_DECIDE_H

#include "command.h"

/* Keep the version on trial. 0, or the exit status after a line. */
int keep(const struct request *request);

/* Choose the slot that does not run, and remember why. 0, or the exit status after a line. */
int take_back(const struct request *request, const char *reason);

#endif
