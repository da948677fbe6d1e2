/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The description of the stream (SDP): in a file, and announced (SAP). */
#ifndef DDXVIDEO_DESCRIBE_H
#define DDXVIDEO_DESCRIBE_H

#include "sender_state.h"

/* Write and announce the description. `encoded`: a frame with parameter sets. Failures are reported, no more. */
void describe(struct sender *sender, const struct encoded *encoded);

/* Remove the file that an earlier sender of this instance may have left. */
void describe_nothing(const struct sender *sender);

/*
 * The stream has stopped: a folder keeps no description of it, since a reader would take it for that of the next
 * stream, until that sender is connected and removes it. A file that the user named remains.
 */
void describe_end(const struct sender *sender);

#endif
