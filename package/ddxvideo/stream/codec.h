/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encoded frames of either codec. */
#ifndef DDXVIDEO_CODEC_H
#define DDXVIDEO_CODEC_H

#include "rtp.h"

/* Whether a frame has what a decoder needs to begin: parameter sets (H.264), or a VOL header (MPEG-4). */
bool codec_can_begin(enum rtp_type type, const uint8_t *data, size_t size);

#endif
