/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Writes the video item and its frame counter. */
#ifndef DDXVIDEO_PUBLISH_H
#define DDXVIDEO_PUBLISH_H

#include "grabber_state.h"

/* Convert a wanted frame into the store, and count it. `time`: of its capture. */
void publish(struct grabber *grabber, const struct camera_frame *frame, uint64_t position, int64_t time);

/* Close the items. */
void publish_end(struct grabber *grabber);

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_DRIVER, LOST_ERROR, LOST_AWAY, LOST_STORE };

#endif
