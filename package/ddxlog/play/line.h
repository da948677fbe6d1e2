/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Lines on standard input. */
#ifndef DDXLOG_LINE_H
#define DDXLOG_LINE_H

#include "replay_state.h"

/* Wait for the next line on standard input. False: end of input, or a request to stop. */
bool replay_wait_line(struct replay *replay);

#endif
