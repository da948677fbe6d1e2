/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * repair_maker COUNT: repair packets for a sender in Python. Reads RTP packets, each preceded by its size (2 bytes, big
 * endian), from standard input; writes COUNT repair packets over all of them in the same form.
 */
#include <stdio.h>
#include <stdlib.h>

#include "../../package/ddxvideo/common/bits.h"
#include "../../package/ddxvideo/stream/core/gf256.c"
#include "../../package/ddxvideo/stream/core/repair.c"
#include "../../package/ddxvideo/stream/core/rtp.c"

int main(int argc, char **argv) {
    static struct repair_window window;
    uint8_t head[2], data[REPAIR_MAX];
    struct rtp_packet packet;

    while (fread(head, 1, 2, stdin) == 2) {
        size_t size = get16(head);
        if (size > sizeof data || fread(data, 1, size, stdin) != size || !rtp_parse(data, size, &packet))
            return 1;
        if (!window.count)
            repair_window_init(&window, packet.ssrc, packet.ssrc + 1, packet.sequence);
        if (repair_window_add(&window, packet.sequence, packet.frame.count, data, size))
            return 1;
    }
    for (int count = argc > 1 ? atoi(argv[1]) : 0; count; count--) {
        size_t size = repair_make(&window, 0, data);
        put16(head, (uint16_t)size);
        fwrite(head, 1, 2, stdout);
        fwrite(data, 1, size, stdout);
    }
    return 0;
}
