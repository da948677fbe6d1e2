/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "clock.h"

#include <stdlib.h>
#include <string.h>

#include "directory.h"

#define PERIOD_NS INT64_C(1000000000)
#define FIRST_PERIOD_NS INT64_C(100000000) /* between the first few */
#define FEW_SAMPLES 4
#define REQUESTS_MOST 20 /* requests at short intervals to a machine that does not answer */
#define LATEST_NS (INT64_C(1) << 61)
#define BOUND_MOST_NS INT64_C(100000000) /* error bound above which the time of arrival is more exact */

struct clock {
    struct catalog *catalog;
    struct network_event event;
    struct network_clock *network;
    int64_t sent;
};

static void take_stamps(void *argument, const struct network_stamps *stamps) {
    struct catalog *catalog = argument;
    struct machine *machine = machines_find(directory_machines(catalog->directory), stamps->machine);
    int64_t now = ddx_time_now();

    if (!machine)
        return;
    machine->stamp_sent = stamps->sent;
    machine->stamp_received = now;
    for (unsigned i = 0; i < NETWORK_MACHINES && i < stamps->count; i++)
        if (stamps->peer[i] == catalog->identity.id)
            offset_add(&machine->offset, stamps->peer_sent[i], stamps->received[i], stamps->sent, now);
}

static void come(void *argument) {
    struct clock *clock = argument;

    network_clock_read(clock->network, take_stamps, clock->catalog);
}

struct clock *clock_open(struct catalog *catalog) {
    struct clock *clock = calloc(1, sizeof *clock);

    if (!clock)
        return NULL;
    clock->catalog = catalog;
    clock->event = (struct network_event){come, clock};
    if (!network_clock_open(catalog->network, &clock->event, &clock->network))
        return clock;
    free(clock);
    return NULL;
}

void clock_close(struct clock *clock) {
    if (clock)
        network_clock_close(clock->network);
    free(clock);
}

/* Fill in the time stamps to send. True if a clock has few measurements yet. */
static bool fill(struct machines *machines, struct network_stamps *stamps) {
    bool hardly = false;

    for (unsigned i = 0; i < machines->count; i++) {
        struct machine *machine = &machines->list[i];

        hardly |= !machine->away && machine->offset.count < FEW_SAMPLES && machine->asked++ < REQUESTS_MOST;
        if (machine->away || !machine->stamp_received)
            continue;
        stamps->peer[stamps->count] = machine->id;
        stamps->peer_sent[stamps->count] = machine->stamp_sent;
        stamps->received[stamps->count++] = machine->stamp_received;
    }
    return hardly;
}

void clock_tick(struct clock *clock) {
    struct machines *machines = directory_machines(clock->catalog->directory);
    struct network_stamps stamps;
    int64_t now = ddx_time_now();

    if (!machines->count || now - clock->sent < FIRST_PERIOD_NS)
        return;
    memset(&stamps, 0, sizeof stamps);
    if (!fill(machines, &stamps) && now - clock->sent < PERIOD_NS)
        return;
    stamps.machine = clock->catalog->identity.id;
    clock->sent = stamps.sent = ddx_time_now();
    network_clock_write(clock->network, &stamps);
}

int64_t clock_local(const struct catalog *catalog, uint64_t machine, int64_t time) {
    const struct machine *from = machines_find(directory_machines(catalog->directory), machine);
    int64_t now = ddx_time_now(), apart, bound;

    if (!from || !offset_get(&from->offset, now, &apart, &bound) || bound > BOUND_MOST_NS || time < 0 ||
        time > LATEST_NS)
        return 0;
    int64_t local = time - apart;
    return local > now ? now : local > 0 ? local : 0;
}
