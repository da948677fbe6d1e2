/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Whether a version on trial does what the version before did. */
#ifndef DDXUPDATE_JUDGE_H
#define DDXUPDATE_JUDGE_H

#include "sight.h"

enum { REASON_MAX = 200 };

enum verdict {
    GOOD,
    BAD,   /* it may become good */
    WRONG, /* it will not: a service refuses its settings */
};

/*
 * Judge the machine by two looks, one after the other. For all but GOOD, `reason` says why. Without a former state,
 * each enabled service must run, and frames must continue once they flow.
 */
enum verdict judge(const struct former *former, const struct sight *before, const struct sight *now,
                   char reason[REASON_MAX]);

#endif
