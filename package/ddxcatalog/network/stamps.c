/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdlib.h>

#include "internal.h"

#define TOPIC "ddx/clock"
#define UNREAD (2 * NETWORK_MACHINES)

/* As struct network_stamps: numbers of 64 bits, so that there is no padding. */
static const char text[] = "uint64 machine\nint64 sent\nuint64 count\nuint64[32] peer\nint64[32] peer_sent\n"
                           "int64[32] received\n";
_Static_assert(NETWORK_MACHINES == 32, "as in the text");

struct network_clock {
    struct network *network;
    dds_entity_t topic, reader, writer;
    struct network_share share;
};

/* Late stamps are useless: lost ones are not sent again. */
static int open_both(struct network *network, struct network_clock *clock, const struct description *description) {
    dds_qos_t *qos = network_qos(description, UNREAD);

    if (!qos)
        return -ENOMEM;
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
    clock->network = network;
    clock->topic = network_topic(network, TOPIC, description, 0);
    if (clock->topic > 0) {
        clock->reader = dds_create_reader(network->participant, clock->topic, qos, NULL);
        clock->writer = dds_create_writer(network->participant, clock->topic, qos, NULL);
    }
    dds_delete_qos(qos);
    return clock->reader > 0 && clock->writer > 0 ? 0 : -EINVAL;
}

int network_clock_open(struct network *network, const struct network_event *event, struct network_clock **result) {
    struct network_clock *clock = calloc(1, sizeof *clock);
    struct description *description = NULL;
    int error = clock ? description_parse("ddx/msg/Clock", text, &description) : -ENOMEM;

    if (!error)
        error = open_both(network, clock, description);
    if (!error)
        error = network_share_open(network, clock->reader, event, &clock->share);
    description_free(description);
    if (error)
        network_clock_close(clock);
    else
        *result = clock;
    return error;
}

void network_clock_close(struct network_clock *clock) {
    if (!clock)
        return;
    if (clock->network)
        network_share_close(clock->network, &clock->share);
    const dds_entity_t all[] = {clock->reader, clock->writer, clock->topic};
    for (unsigned i = 0; i < sizeof all / sizeof *all; i++)
        if (all[i] > 0)
            dds_delete(all[i]);
    free(clock);
}

int network_clock_write(struct network_clock *clock, const struct network_stamps *stamps) {
    return network_error(dds_write(clock->writer, stamps));
}

void network_clock_read(struct network_clock *clock, network_take_stamps *take, void *argument) {
    int64_t begin = network_share_begin(&clock->share);
    void *data = NULL;
    dds_sample_info_t info;

    while (dds_take(clock->reader, &data, &info, 1, 1) == 1) {
        if (info.valid_data)
            take(argument, data);
        dds_return_loan(clock->reader, &data, 1);
        data = NULL;
        if (!network_share_left(&clock->share, begin))
            break;
    }
    network_share_use(clock->network, &clock->share, begin);
}
