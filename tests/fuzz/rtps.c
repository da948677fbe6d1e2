/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: a packet into the receive path of Cyclone DDS, which the catalog listens with: headers, submessages,
 * fragments, and parameter lists of announcements. There is no transport, so nothing is sent and no participant is
 * created: the discovery of writers and values of writers, which need a participant, are not reached. One domain takes
 * all inputs. A read beyond the end of a packet of less than ROOM bytes is not always noticed.
 */
#include <dds/dds.h>
#include <dds/ddsi/ddsi_domaingv.h>
#include <dds/ddsi/ddsi_entity_index.h>
#include <dds/ddsi/ddsi_iid.h>
#include <dds/ddsi/ddsi_init.h>
#include <dds/ddsrt/sync.h>
#include <stdlib.h>
#include <string.h>

#include "ddsi__entity_index.h"
#include "ddsi__proxy_participant.h"
#include "ddsi__radmin.h"
#include "ddsi__receive.h"
#include "ddsi__thread.h"
#include "ddsi__tran.h"
#include "ddsi__vnet.h"

#define PACKET_MAX 65535
#define ROOM 256 /* notes on a submessage must fit into the packet's buffer, which is never smaller */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static struct ddsi_domaingv gv;
static struct ddsi_thread_state *thread;
static struct ddsi_tran_conn *connection;
static ddsrt_mutex_t lock;
static ddsrt_cond_t changed;
static bool done;

static void say_nothing(void *argument, const dds_log_data_t *message) {
    (void)argument;
    (void)message;
}

/* Registers this thread as a receiving thread. */
static void begin_thread(void) {
    ddsi_iid_init();
    ddsi_thread_states_init();
    thread = ddsi_lookup_thread_state();
    thread->state = DDSI_THREAD_STATE_ALIVE;
    ddsrt_atomic_stvoidp(&thread->gv, &gv);
}

static void begin(void) {
    begin_thread();
    ddsrt_mutex_init(&lock);
    ddsrt_cond_init(&changed);
    dds_set_log_sink(say_nothing, NULL);
    dds_set_trace_sink(say_nothing, NULL);
    ddsi_config_init_default(&gv.config);
    gv.config.transport_selector = DDSI_TRANS_NONE;
    if (ddsi_config_prep(&gv, NULL) || ddsi_init(&gv, NULL) < 0 || ddsi_vnet_init(&gv, "fake", 123) < 0)
        abort();
    const struct ddsi_tran_qos qos = {.m_purpose = DDSI_TRAN_QOS_XMIT_UC, .m_interface = &gv.interfaces[0]};
    if (ddsi_factory_create_conn(&connection, ddsi_factory_find(&gv, "fake"), 0, &qos) || ddsi_start(&gv) < 0)
        abort();
}

static void note_done(void *argument) {
    (void)argument;
    ddsrt_mutex_lock(&lock);
    done = true;
    ddsrt_cond_signal(&changed);
    ddsrt_mutex_unlock(&lock);
}

/* Waits until the thread for announcements has handled those of the packet. */
static void wait_for_announcements(void) {
    done = false;
    ddsi_dqueue_enqueue_callback(gv.builtins_dqueue, note_done, NULL);
    ddsrt_mutex_lock(&lock);
    while (!done)
        ddsrt_cond_wait(&changed, &lock);
    ddsrt_mutex_unlock(&lock);
}

static void forget_participants(void) {
    struct ddsi_entity_enum_proxy_participant all;
    struct ddsi_proxy_participant *one;

    ddsi_thread_state_awake(thread, &gv);
    ddsi_entidx_enum_proxy_participant_init(&all, gv.entity_index);
    while ((one = ddsi_entidx_enum_proxy_participant_next(&all)))
        ddsi_delete_proxy_participant_by_guid(&gv, &one->e.guid, ddsrt_time_wallclock(), true);
    ddsi_entidx_enum_proxy_participant_fini(&all);
    ddsi_thread_state_asleep(thread);
}

/* Drops fragments of packets, whose memory is freed with the input. */
static void forget_fragments(void) {
    ddsi_defrag_free(gv.spdp_defrag);
    gv.spdp_defrag = ddsi_defrag_new(&gv.logconfig, DDSI_DEFRAG_DROP_OLDEST, gv.config.defrag_unreliable_maxsamples);
}

/* Receives the packet from memory of its size. */
static void receive(const uint8_t *data, size_t size) {
    uint32_t room = size > ROOM ? (uint32_t)(size + 7) & ~7u : ROOM;
    struct ddsi_rbufpool *pool = ddsi_rbufpool_new(&gv.logconfig, room, room);
    ddsi_guid_prefix_t prefix = {0};
    struct ddsi_network_packet_info info = {0};

    ddsi_rbufpool_setowner(pool, ddsrt_thread_self());
    struct ddsi_rmsg *message = ddsi_rmsg_new(pool);
    memcpy(DDSI_RMSG_PAYLOAD(message), data, size);
    ddsi_rmsg_setsize(message, (uint32_t)size);
    ddsi_handle_rtps_message(thread, &gv, connection, &prefix, pool, message, size, &info);
    ddsi_rmsg_commit(message);
    wait_for_announcements();
    forget_participants();
    forget_fragments();
    ddsi_rbufpool_free(pool);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!thread)
        begin();
    if (size <= PACKET_MAX)
        receive(data, size);
    return 0;
}
