/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: packets into a catalog's network: Cyclone DDS, which receives them, and the folder `network` of the
 * catalog, which has readers and writers of records, stamps and values. Each "RTPS" in an input, which all packets
 * begin with, begins another packet, so that one input announces a participant and its writers, and then sends their
 * values. What this end sends goes nowhere. One participant takes all inputs; after each, the others are forgotten. A
 * read beyond the end of a packet of less than ROOM bytes is not always noticed.
 */
#include <dds/dds.h>
#include <dds/ddsi/ddsi_domaingv.h>
#include <dds/ddsi/ddsi_entity_index.h>
#include <dds/ddsrt/sync.h>
#include <stdlib.h>
#include <string.h>

#include "dds__entity.h"
#include "ddsi__entity_index.h"
#include "ddsi__gc.h"
#include "ddsi__proxy_participant.h"
#include "ddsi__radmin.h"
#include "ddsi__receive.h"
#include "ddsi__thread.h"
#include "ddsi__tran.h"
#include "internal.h"

#define PACKET_MAX 65535
#define PACKETS 32
#define ROOM 256 /* notes on a submessage must fit into the packet's buffer, which is never smaller */
#define DOMAIN 231
#define VALUES 2

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* The types of two items, with all that an item's type may have. */
static const char *const schemas[VALUES] = {
    "int32 number\nfloat64[3] x\nuint8 last\n",
    "string frame\nddx/FUZZPart[2] part\nuint8[] data\nddx/FUZZPart[] parts\nstring[] names\nuint8 last\n"
    "================================================================================\n"
    "MSG: ddx/FUZZPart\nfloat64 x\nint16[3] a\nstring name\n"};

static struct ddsi_domaingv *gv;
static struct ddsi_thread_state *thread;
static struct network *network;
static struct network_records *records;
static struct network_clock *stamps;
static struct network_reader *reader[VALUES];
static struct network_writer *writer;
static ddsi_guid_prefix_t prefix;
static struct ddsi_network_packet_info from;
static ddsrt_mutex_t lock;
static ddsrt_cond_t changed;
static bool done;
static uint64_t taken, sum;

static void say_nothing(void *argument, const dds_log_data_t *message) {
    (void)argument;
    (void)message;
}

static dds_return_t send_nowhere(struct ddsi_tran_conn *connection, const ddsi_locator_t *to,
                                 const ddsi_tran_write_msgfrags_t *parts, uint32_t flags, size_t *written) {
    size_t size = 0;

    (void)connection;
    (void)to;
    (void)flags;
    for (size_t i = 0; i < parts->niov; i++)
        size += parts->iov[i].iov_len;
    if (written)
        *written = size;
    return DDS_RETCODE_OK;
}

/* ---- What is read: each byte is looked at, so that sanitizers see what is not there ---- */

static void look_at(const void *data, size_t size) {
    const unsigned char *bytes = data;

    taken++;
    for (size_t i = 0; i < size; i++)
        sum += bytes[i];
}

static void look_at_text(const char *text) {
    if (text)
        look_at(text, strlen(text) + 1);
}

static void take_value(void *argument, uint64_t writer, const unsigned char *message, size_t size) {
    (void)argument;
    (void)writer;
    look_at(message, size);
}

static void take_stamps(void *argument, const struct network_stamps *one) {
    (void)argument;
    look_at(one, sizeof *one);
}

static void take_record(void *argument, const struct network_record *record, enum network_change change) {
    (void)argument;
    look_at_text(record->item);
    if (change != NETWORK_THERE)
        return;
    look_at_text(record->name);
    look_at_text(record->host);
    look_at_text(record->boot);
    look_at_text(record->type);
    look_at_text(record->declaration);
    look_at_text(record->extents);
    look_at_text(record->topic);
}

/* Takes what has come: a reader reads for a short time, and is called again then. */
static void read_all(void) {
    struct network_refused refused;
    uint64_t before;

    do {
        before = taken;
        network_records_read(records, take_record, NULL);
        network_clock_read(stamps, take_stamps, NULL);
        for (unsigned i = 0; i < VALUES; i++)
            network_read(reader[i], take_value, NULL);
    } while (taken != before);
    network_records_refused(records, &refused);
}

/* ---- The begin ---- */

static void ignore(void *argument) {
    (void)argument;
}

static const struct network_event event = {ignore, NULL};

static void open_network(void) {
    const struct network_options options = {.domain = DOMAIN, .interface = "lo", .unicast = true};
    dds_entity *entity;

    if (network_open(&options, &network) || dds_entity_pin(network->participant, &entity))
        abort();
    gv = &entity->m_domain->gv;
    prefix = entity->m_guid.prefix;
    dds_entity_unpin(entity);
    for (int i = 0; i < gv->n_interfaces; i++)
        gv->xmit_conns[i]->m_write_fn = send_nowhere;
    from.src = gv->interfaces[0].loc;
    from.src.port = 7400;
}

/* Readers of all that a catalog reads, and a writer that has sent a value. */
static void open_all(void) {
    struct network_record record = {.machine = 1,
                                    .item = "item",
                                    .name = "robot",
                                    .host = "robot",
                                    .boot = "boot",
                                    .type = "T",
                                    .declaration = "int a;",
                                    .extents = "",
                                    .topic = "rt/robot/item"};
    unsigned char message[44] = {0, 1};
    struct description *description;
    int error = network_records_open(network, &event, &records);

    error = error ? error : network_clock_open(network, &event, &stamps);
    for (unsigned i = 0; i < VALUES && !error; i++) {
        char topic[] = "rt/robot/0";

        topic[sizeof topic - 2] += i;
        error = description_parse("ddx/msg/FUZZ", schemas[i], &description);
        error = error ? error : network_reader_open(network, topic, description, 64, &event, &reader[i]);
        if (!i && !error)
            error = network_writer_open(network, "rt/robot/item", description, 64, true, &event, &writer);
        description_free(description);
    }
    error = error ? error : network_records_write(records, &record);
    if (error || network_write(writer, message, 37, 1))
        abort();
}

static void begin(void) {
    dds_set_log_sink(say_nothing, NULL);
    dds_set_trace_sink(say_nothing, NULL);
    ddsrt_mutex_init(&lock);
    ddsrt_cond_init(&changed);
    open_network();
    open_all();
    thread = ddsi_lookup_thread_state();
    thread->state = DDSI_THREAD_STATE_ALIVE; /* as a receiving thread */
    ddsrt_atomic_stvoidp(&thread->gv, gv);
}

/* ---- An input ---- */

static void note_done(void *argument) {
    (void)argument;
    ddsrt_mutex_lock(&lock);
    done = true;
    ddsrt_cond_signal(&changed);
    ddsrt_mutex_unlock(&lock);
}

static void wait_until_done(void) {
    ddsrt_mutex_lock(&lock);
    while (!done)
        ddsrt_cond_wait(&changed, &lock);
    done = false;
    ddsrt_mutex_unlock(&lock);
}

/* Waits until the thread of this queue has handled what is in it. */
static void wait_for(struct ddsi_dqueue *queue) {
    ddsi_dqueue_enqueue_callback(queue, note_done, NULL);
    wait_until_done();
}

static void note_freed(struct ddsi_gcreq *request) {
    ddsi_gcreq_free(request);
    note_done(NULL);
}

/* The last request is counted as finished before all of its memory is free, so one more follows. */
static void wait_for_memory(void) {
    ddsi_gcreq_queue_drain(gv->gcreq_queue);
    ddsi_gcreq_enqueue(ddsi_gcreq_new(gv->gcreq_queue, note_freed));
    wait_until_done();
}

static bool is_any_participant(void) {
    struct ddsi_entity_enum_proxy_participant all;

    ddsi_thread_state_awake(thread, gv);
    ddsi_entidx_enum_proxy_participant_init(&all, gv->entity_index);
    bool any = ddsi_entidx_enum_proxy_participant_next(&all);
    ddsi_entidx_enum_proxy_participant_fini(&all);
    ddsi_thread_state_asleep(thread);
    return any;
}

static void forget_participants(void) {
    struct ddsi_entity_enum_proxy_participant all;
    struct ddsi_proxy_participant *one;
    bool any = false;

    ddsi_thread_state_awake(thread, gv);
    ddsi_entidx_enum_proxy_participant_init(&all, gv->entity_index);
    while ((one = ddsi_entidx_enum_proxy_participant_next(&all))) {
        ddsi_delete_proxy_participant_by_guid(gv, &one->e.guid, ddsrt_time_wallclock(), true);
        any = true;
    }
    ddsi_entidx_enum_proxy_participant_fini(&all);
    ddsi_thread_state_asleep(thread);
    if (any)
        wait_for_memory();
    read_all(); /* that writers are gone */
}

/* Drops fragments of announcements, whose memory is freed with the input. */
static void forget_fragments(void) {
    ddsrt_mutex_lock(&gv->spdp_lock);
    ddsi_defrag_free(gv->spdp_defrag);
    gv->spdp_defrag = ddsi_defrag_new(&gv->logconfig, DDSI_DEFRAG_DROP_OLDEST, gv->config.defrag_unreliable_maxsamples);
    ddsrt_mutex_unlock(&gv->spdp_lock);
}

/* Receives a packet from memory of its size, which is part of the result. */
static struct ddsi_rbufpool *receive(const uint8_t *data, size_t size) {
    uint32_t room = size > ROOM ? (uint32_t)(size + 7) & ~7u : ROOM;
    struct ddsi_rbufpool *pool = ddsi_rbufpool_new(&gv->logconfig, room, room);

    ddsi_rbufpool_setowner(pool, ddsrt_thread_self());
    struct ddsi_rmsg *message = ddsi_rmsg_new(pool);
    memcpy(DDSI_RMSG_PAYLOAD(message), data, size);
    ddsi_rmsg_setsize(message, (uint32_t)size);
    ddsi_handle_rtps_message(thread, gv, gv->disc_conn_uc, &prefix, pool, message, size, &from);
    ddsi_rmsg_commit(message);
    wait_for(gv->builtins_dqueue);
    if (is_any_participant()) { /* most inputs bring none, and each wait costs time */
        wait_for(gv->user_dqueue);
        read_all();
    }
    return pool;
}

/* Bytes of the first packet. */
static size_t packet_size(const uint8_t *data, size_t size) {
    const uint8_t *next = size > 4 ? memmem(data + 1, size - 1, "RTPS", 4) : NULL;

    return next ? (size_t)(next - data) : size;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct ddsi_rbufpool *pool[PACKETS];
    unsigned count = 0;

    if (!thread)
        begin();
    while (size && count < PACKETS) {
        size_t part = packet_size(data, size);

        if (part <= PACKET_MAX)
            pool[count++] = receive(data, part);
        data += part;
        size -= part;
    }
    forget_participants();
    forget_fragments();
    while (count)
        ddsi_rbufpool_free(pool[--count]);
    return 0;
}
