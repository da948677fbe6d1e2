/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Decisions about versions: which one is chosen, what is refused before anything is written, and how a trial ends. */
#ifndef DDXUPDATE_DECIDE_H
#define DDXUPDATE_DECIDE_H

#include "block.h"
#include "command.h"
#include "place.h"
#include "release.h"

/* Read the boot loader's block; a lost one counts as empty. 0, or the exit status after a line. */
int choose_read(const struct request *request, struct block *block);

/* Replace the block. 0, or the exit status after a line. */
int choose_write(const struct request *request, const struct block *block);

/*
 * The machine may be updated: it was started by our loader, which counts, and no other update is at work. Holds the
 * lock until the process exits. This check and the next two return the exit status: 0, or 2 after a line.
 */
int check_machine(const struct place *place);

/* No version is in its first start. */
int check_no_trial(const struct place *place, const struct block *block);

/* A version for this machine. `older`: it may have a lower serial than the running one. */
int check_version(const struct place *place, const struct release *running, const struct release *other, bool older);

/* The numbers of a trial: lines NAME=VALUE of /etc/ddx/trial. */
struct rules {
    double good;       /* seconds in a row in which all must be well */
    double deadline;   /* seconds until the version is taken back */
    double silence;    /* seconds in a row without an answer of the store until the version is taken back */
    double step;       /* seconds between two looks */
    unsigned watchdog; /* seconds that the early watchdog gives a boot */
    unsigned ssh;      /* port */
};

/* A line that is missing or no number has its default. */
void rules_read(struct rules *rules, const struct place *place);

/* Keep the version on trial, in the block and in what the machine remembers. 0, or the exit status after a line. */
int keep(const struct request *request);

/* Choose the slot that does not run, and remember why. 0, or the exit status after a line. */
int take_back(const struct request *request, const char *reason);

#endif
