/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "codec.h"

#include "h264.h"

#define VOL 0x20 /* the upper half of an MPEG-4 start code's last byte */

bool codec_can_begin(enum rtp_type type, const uint8_t *data, size_t size) {
    struct h264_nal nal;

    for (const uint8_t *at = data; h264_next_nal(&at, data + size, &nal);) /* MPEG-4's start codes look the same */
        if (type == RTP_H264 ? (nal.data[0] & 31) == H264_SPS : (nal.data[0] & 0xf0) == VOL)
            return true;
    return false;
}
