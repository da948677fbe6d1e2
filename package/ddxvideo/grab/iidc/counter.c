/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "counter.h"

#include <arpa/inet.h>
#include <string.h>

#define POINT_GREY 0xb09d
#define FRAME_INFO 0x12f8
#define PRESENT UINT32_C(0x80000000)
#define FRAME_COUNTER UINT32_C(0x40)

bool counter_switch(dc1394camera_t *device, bool wanted) {
    uint32_t value = 0;

    if (device->vendor_id != POINT_GREY || dc1394_get_control_register(device, FRAME_INFO, &value) ||
        !(value & PRESENT))
        return false;
    uint32_t told = PRESENT | (wanted ? FRAME_COUNTER : 0);
    return !dc1394_set_control_register(device, FRAME_INFO, told) &&
           !dc1394_get_control_register(device, FRAME_INFO, &value) && value & FRAME_COUNTER;
}

uint32_t counter_take(dc1394video_frame_t *frame) {
    uint32_t number;

    memcpy(&number, frame->image, sizeof number);
    if (frame->size[1] > 2)
        memcpy(frame->image, frame->image + 2 * (size_t)frame->stride, sizeof number);
    return ntohl(number);
}
