/* SPDX-License-Identifier: GPL-2.0-or-later */
/* LCM, UDP multicast on this machine. It has no zero copy: a handler sees the frame in its process's own memory. */
#include <lcm/lcm.h>
#include <stdio.h>
#include <stdlib.h>

#include "peer.h"

static lcm_t *lcm;
static char channel[64];
static size_t bytes;
static void (*hand_over)(const void *data);

static void handle(const lcm_recv_buf_t *received, const char *from, void *unused) {
    (void)from;
    (void)unused;
    if (received->data_size == bytes)
        hand_over(received->data);
}

int peer_open(const struct peer_setup *setup, bool writer) {
    /* The kernel gives as much of the buffer as net.core.rmem_max allows. */
    lcm = lcm_create("udpm://239.255.76.67:7667?ttl=0&recv_buf_size=8388608");
    if (!lcm || setup->mode != PEER_COPY)
        return fprintf(stderr, "lcm: cannot be used\n"), 1;
    bytes = setup->bytes;
    snprintf(channel, sizeof channel, "%s", setup->name);
    if (!writer)
        lcm_subscription_set_queue_capacity(lcm_subscribe(lcm, channel, handle, NULL), 2);
    return 0;
}

void *peer_loan(void) {
    return NULL;
}

int peer_publish(void) {
    return 1;
}

int peer_write(const void *data) {
    return lcm_publish(lcm, channel, data, (unsigned)bytes) ? 1 : 0;
}

int peer_receive(void (*deliver)(const void *data)) {
    hand_over = deliver;
    return lcm_handle_timeout(lcm, 100) < 0;
}

void peer_close(void) {
    lcm_destroy(lcm);
}
