/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The numbers of a trial: lines NAME=VALUE of /etc/ddx/trial. */
#ifndef DDXUPDATE_RULES_H
#define DDXUPDATE_RULES_H

#include "place.h"

struct rules {
    double good;       /* seconds in a row in which all must be well */
    double deadline;   /* seconds until the version is taken back */
    double step;       /* seconds between two looks */
    unsigned watchdog; /* seconds that the early watchdog gives a boot */
    unsigned ssh;      /* port */
};

/* A line that is missing or no number has its default. */
void rules_read(struct rules *rules, const struct place *place);

#endif
