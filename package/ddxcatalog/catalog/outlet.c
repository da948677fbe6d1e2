/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "outlet.h"

#include <envelope.h>
#include <errno.h>
#include <stdlib.h>

struct outlet {
    struct catalog *catalog;
    struct sender_source source;
    uint64_t sent; /* number of messages sent, and of the newest one */
    struct network_event event;
    struct sender *sender;
    unsigned readers;
};

/* Readers have come or left. */
static void follow_readers(void *argument) {
    struct outlet *outlet = argument;
    unsigned came, readers = network_writer_readers(outlet->source.writer, &came);

    outlet->readers = readers;
    if (outlet->sender && (!readers || sender_ended(outlet->sender))) {
        sender_stop(outlet->sender);
        outlet->sender = NULL;
    }
    if (outlet->sender && came)
        sender_repeat(outlet->sender);
    if (readers && !outlet->sender)
        outlet->sender = sender_start(outlet->catalog, &outlet->source, &outlet->sent);
}

static int open_writer(struct outlet *outlet, const char *topic) {
    const struct sender_source *source = &outlet->source;
    struct description *own = NULL;
    int error = source->standard ? 0 : envelope_describe(source->form, &own);

    if (error)
        return error;
    outlet->event = (struct network_event){follow_readers, outlet};
    error = network_writer_open(outlet->catalog->network, topic, own ? own : source->standard->description,
                                sender_message_size(outlet->catalog, source), source->rule->latched, &outlet->event,
                                &outlet->source.writer);
    description_free(own);
    return error;
}

int outlet_open(struct catalog *catalog, const char *topic, const struct sender_source *source,
                struct outlet **result) {
    struct outlet *outlet = calloc(1, sizeof *outlet);

    if (!outlet) {
        standard_close(source->standard);
        return -ENOMEM;
    }
    outlet->catalog = catalog;
    outlet->source = *source;
    outlet->source.writer = NULL;
    int error = open_writer(outlet, topic);
    if (error)
        outlet_close(outlet);
    else
        *result = outlet;
    return error;
}

void outlet_close(struct outlet *outlet) {
    if (!outlet)
        return;
    sender_stop(outlet->sender);
    network_writer_close(outlet->source.writer);
    standard_close(outlet->source.standard);
    free(outlet);
}

unsigned outlet_readers(const struct outlet *outlet) {
    return outlet ? outlet->readers : 0;
}

void outlet_look(struct outlet *outlet) {
    if (outlet && (outlet->sender ? sender_ended(outlet->sender) : outlet->readers > 0))
        follow_readers(outlet);
}
