/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a trial looks at: the machine as it is now, and as it was before the restart. */
#ifndef DDXUPDATE_SIGHT_H
#define DDXUPDATE_SIGHT_H

#include "frames.h"
#include "network.h"
#include "services.h"

enum { WORDS_MAX = 2048 };

struct sight {
    struct services services;
    struct frames frames;
    struct network network;
    bool ssh;      /* port 22 answers */
    bool watchdog; /* it would reset the machine */
    bool checking; /* the recordings' disk is being checked, so recorders wait */
};

/* Look at all but `services.list`, which is only brought up to date, and `ssh`. */
void sight_look(const struct place *place, struct sight *sight);

/* What was before, as noted in /data/update. */
struct former {
    bool known;
    char runs[WORDS_MAX], flows[WORDS_MAX], links[WORDS_MAX], addresses[WORDS_MAX]; /* names with blanks in between */
    bool ssh, watchdog;
};

/* From two looks at the machine, one after the other. */
void former_make(struct former *former, const struct sight *before, const struct sight *now);

/* That of the last `start`, if it was for this slot and version. */
void former_read(struct former *former, const struct place *place, const char *version);

/* Whether the list has the name. */
bool former_has(const char *words, const char *name);

#endif
