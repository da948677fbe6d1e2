/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Replay of a log into the store. */
#ifndef DDXLOG_REPLAY_H
#define DDXLOG_REPLAY_H

#include "items.h"

/* Replay; returns the program's exit status. */
int replay_run(struct replay *replay);

#endif
