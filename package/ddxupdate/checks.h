/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What is refused before anything is written. Each check returns the exit status: 0, or 2 after a line. */
#ifndef DDXUPDATE_CHECKS_H
#define DDXUPDATE_CHECKS_H

#include "block.h"
#include "command.h"
#include "release.h"

/* The machine may be updated: it was started by our loader, which counts, and no other update is at work. Holds the
 * lock until the process exits. */
int check_machine(const struct place *place);

/* No version is in its first start. */
int check_no_trial(const struct place *place, const struct block *block);

/* A version for this machine. `older`: it may have a lower serial than the running one. */
int check_version(const struct place *place, const struct release *running, const struct release *other, bool older);

#endif
