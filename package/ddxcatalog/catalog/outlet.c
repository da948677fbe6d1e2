/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "outlet.h"

#include <envelope.h>
#include <errno.h>
#include <pthread.h>
#include <standard.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "state.h"

/* ---- A thread that sends the values of one item ---- */

#define KEEP 64 /* values that the store keeps for the sender */
#define KEEP_BYTES 262144u
#define STACK 131072 /* bytes */
#define TURN 0.05    /* s between two checks for a new reader */

struct sender {
    struct catalog *catalog;
    struct sender_source source;
    DDX_STORE_ITEM *item;
    uint32_t layout;
    unsigned keep;
    unsigned char *message;
    size_t room, size; /* maximum size of a message; size of this one */
    int64_t wall;      /* time of the message; 0: none yet */
    int64_t due;       /* earliest time of the next message, if the rule has a rate */
    uint64_t *sent;    /* counts only sent messages, so that a gap in the numbers means a loss in the network */
    pthread_t thread;
    int64_t time;      /* of the value in the message */
    bool begun, waits; /* a value was taken; the message is not sent yet */
    atomic_bool stopping, repeat, ended;
};

static int64_t wall_offset(void) {
    struct timespec wall;

    clock_gettime(CLOCK_REALTIME, &wall);
    return wall.tv_sec * INT64_C(1000000000) + wall.tv_nsec - ddx_time_now();
}

/* Maximum size of a message in bytes. */
static size_t sender_message_size(const struct catalog *catalog, const struct sender_source *source) {
    const char *machine = catalog->identity.name;

    return source->standard ? standard_size(source->standard, source->form, machine)
                            : envelope_size(machine) + source->form->message_size - FORM_HEADER;
}

/* Pack a value as a message of the item's own type. */
static void pack_own(struct sender *sender, const struct envelope *envelope, const void *value) {
    unsigned char *at = envelope_write(envelope, sender->message);
    unsigned char kept[FORM_HEADER]; /* the bytes that form_pack() overwrites with its header */

    memcpy(kept, at - FORM_HEADER, sizeof kept);
    form_pack(sender->source.form, value, at - FORM_HEADER);
    memcpy(at - FORM_HEADER, kept, sizeof kept);
    sender->size = sender->room;
}

static int pack(struct sender *sender, const struct ddx_frame *frame) {
    const struct sender_source *source = &sender->source;
    const struct envelope envelope = {.machine = sender->catalog->identity.name,
                                      .sequence = *sender->sent + 1,
                                      .wall = frame->time + wall_offset(),
                                      .monotonic = frame->time};

    if (ddx_store_layout(sender->item) != sender->layout)
        return -EPROTOTYPE;
    if (source->standard)
        sender->size = standard_write(source->standard, source->form, &envelope, frame->data, sender->message);
    else
        pack_own(sender, &envelope, frame->data);
    sender->wall = envelope.wall;
    return sender->size ? 0 : -EBADMSG;
}

/* Count a taken value, and the missed ones: with a rate as skipped, else as lost. */
static void count_in(struct sender *sender, uint64_t missed) {
    DDX_STATS_BOOK *book = sender->catalog->book;
    bool skips = sender->source.rule->period;

    ddx_stats_in(book, skips ? 1 : 1 + missed, 0);
    if (skips && missed)
        ddx_stats_skipped(book, missed);
    else if (missed)
        ddx_stats_lost(book, LOST_STORE, missed);
}

/* Drop the waiting message: there is a newer value, or there are no readers. */
static void give_up(struct sender *sender) {
    if (sender->waits)
        ddx_stats_lost(sender->catalog->book, LOST_BANDWIDTH, 1);
    sender->waits = false;
}

/* Send the message if the bandwidth allows it now: a waiting message, or the last one again for a new reader. */
static void transmit(struct sender *sender) {
    int64_t now = ddx_time_now();

    if (network_write(sender->source.writer, sender->message, sender->size, sender->wall))
        return;
    if (sender->waits) {
        ++*sender->sent;
        ddx_stats_out(sender->catalog->book, 1, now - sender->time);
    }
    sender->waits = sender->repeat = false;
}

static unsigned reason_of(int error) {
    return error == -EMSGSIZE ? LOST_SIZE : error == -EBADMSG ? LOST_TYPE : LOST_STORE;
}

static int take_value(struct sender *sender, const struct ddx_frame *frame) {
    int error = sender->room > MESSAGE_MAX ? -EMSGSIZE : pack(sender, frame);

    count_in(sender, frame->missed);
    give_up(sender);
    sender->time = frame->time;
    sender->waits = !error;
    if (!error)
        transmit(sender);
    else
        ddx_stats_lost(sender->catalog->book, reason_of(error), 1);
    return error == -EPROTOTYPE ? error : 0;
}

/* Whether the rule allows a value to be sent now; waits briefly if not. */
static bool is_due(struct sender *sender) {
    int64_t now = ddx_time_now(), left = sender->due - now, most = (int64_t)(TURN * 1e9);

    if (left > 0) {
        nanosleep(&(struct timespec){.tv_nsec = left < most ? left : most}, NULL);
        return false;
    }
    sender->due = sender->due + sender->source.rule->period > now ? sender->due + sender->source.rule->period
                                                                  : now + sender->source.rule->period;
    return true;
}

/* Take a value and send it. 0, or -errno if the item cannot be read any more. */
static int turn(struct sender *sender) {
    int tail = !sender->begun ? DDX_CURRENT : sender->source.rule->period ? DDX_NEXT : DDX_IN_ORDER;
    int64_t due = sender->due;
    struct ddx_frame frame;

    if (sender->source.rule->period && !is_due(sender))
        return 0;
    int error = ddx_store_acquire(sender->item, &frame, TURN, tail);
    if (error == -EBUSY && !sender->begun && sender->keep > 1) { /* other readers have the frames */
        sender->keep /= 2;
        return ddx_store_keep(sender->item, sender->keep);
    }
    if (error) {
        sender->due = due;
        return error == -ETIMEDOUT ? 0 : error;
    }
    sender->begun = true;
    error = take_value(sender, &frame);
    ddx_store_release(sender->item);
    return error;
}

static void *run(void *argument) {
    struct sender *sender = argument;
    int error = 0;

    program_thread_signals();
    while (!error && !sender->stopping) {
        if (sender->waits || (sender->repeat && sender->wall))
            transmit(sender);
        error = turn(sender);
    }
    give_up(sender);
    sender->ended = true;
    return NULL;
}

static unsigned keep_of(const struct form *form) {
    uint64_t keep = KEEP_BYTES / (form->item_size ? form->item_size : 1);

    return keep > KEEP ? KEEP : keep < 2 ? 2 : (unsigned)keep;
}

/* There may be some hundred senders, and a stack of the usual 8 MiB counts for the service's memory limit. */
static int start(struct sender *sender) {
    pthread_attr_t attributes;

    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, STACK);
    int error = pthread_create(&sender->thread, &attributes, run, sender);
    pthread_attr_destroy(&attributes);
    return error;
}

/* Whether the item still has the source's form: a reader may come before the next look at the items. */
static bool has_same_form(const struct sender *sender) {
    struct form *form;

    if (form_of_item(sender->item, &form))
        return false;
    bool same = form_same(form, sender->source.form);
    form_free(form);
    return same;
}

/*
 * Start a sender, which begins with the newest value. *sent, the number of messages sent so far, is the caller's and
 * must outlive the sender. NULL and errno.
 */
static struct sender *sender_start(struct catalog *catalog, const struct sender_source *source, uint64_t *sent) {
    struct sender *sender = calloc(1, sizeof *sender);

    if (!sender)
        return NULL;
    sender->catalog = catalog;
    sender->source = *source;
    sender->sent = sent;
    sender->room = sender_message_size(catalog, source);
    sender->message = malloc(sender->room > MESSAGE_MAX ? 1 : sender->room + 4); /* DDS pads to four bytes */
    sender->item = sender->message ? ddx_store_lookup_item(catalog->id, source->item, NULL, 0) : NULL;
    int error = sender->item ? 0 : errno;
    if (!error) {
        sender->layout = ddx_store_layout(sender->item);
        error = has_same_form(sender) ? 0 : EPROTOTYPE;
    }
    if (!error) {
        sender->keep = source->rule->period ? 1 : keep_of(source->form);
        ddx_store_keep(sender->item, sender->keep);
        error = start(sender);
    }
    if (!error)
        return sender;
    ddx_store_done_item(sender->item);
    free(sender->message);
    free(sender);
    errno = error;
    return NULL;
}

/* Send the newest value again, for a new reader. */
static void sender_repeat(struct sender *sender) {
    sender->repeat = true;
}

/* Whether the thread has exited by itself: the item has another form, or cannot be read. */
static bool sender_ended(const struct sender *sender) {
    return sender->ended;
}

/* NULL is allowed. */
static void sender_stop(struct sender *sender) {
    if (!sender)
        return;
    sender->stopping = true;
    pthread_join(sender->thread, NULL);
    ddx_store_done_item(sender->item);
    free(sender->message);
    free(sender);
}

/* ---- The topic ---- */

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
    if (outlet)
        follow_readers(outlet);
}
