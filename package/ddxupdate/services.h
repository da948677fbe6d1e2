/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The services, as a trial sees them. */
#ifndef DDXUPDATE_SERVICES_H
#define DDXUPDATE_SERVICES_H

#include "place.h"

enum { SERVICES_MAX = 48 };

struct service {
    char name[WORD_MAX];
    bool enabled;       /* in its settings, when the list was written */
    bool runs;          /* or has done its work, if that is what it is for */
    bool misconfigured; /* it refused its settings */
    bool stopped;       /* by a person, since then */
    bool full;          /* a recorder or logger whose disk has no room: as in the version before */
    unsigned restarts;  /* unwanted ones since the boot */
};

struct services {
    struct service list[SERVICES_MAX];
    unsigned count;
};

/* Read the list in /run/update.services, the lines of `control states`. */
void services_read(const struct place *place, struct services *services);

/* Bring it up to date with the folders of runsvdir. */
void services_look(const struct place *place, struct services *services);

#endif
