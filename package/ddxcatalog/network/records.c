/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <dds/ddsi/ddsi_proxy_participant.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"

#define TOPIC "ddx/catalog"
#define KEYS 2
#define BLOCKING DDS_MSECS(100)
#define INSTANCES ((NETWORK_MACHINES + 1) * (NETWORK_ITEMS + 1)) /* records that the reader knows */
#define UNREAD 256 /* records that wait to be read, of 33 KiB at most; then the receiving thread waits */
#define NAME 64    /* bytes of a name, with the 0 byte */
#define TOPIC_NAME 256

/* As struct network_record. */
static const char text[] = "uint64 machine\nstring item\nstring name\nint64 since\nstring host\nstring boot\n"
                           "string type\nstring declaration\nstring extents\nstring topic\n";

struct network_records {
    struct network *network;
    dds_entity_t read_topic, topic, reader, writer;
    struct network_share share;
    pthread_mutex_t lock; /* for `refused`, which threads of DDS write */
    struct network_refused refused;
    uint32_t proxies; /* the value of DDS's own counter at the last look */
};

static void refuse(struct network_records *records, uint64_t machine, const char *item) {
    pthread_mutex_lock(&records->lock);
    records->refused.count++;
    records->refused.machine = machine;
    snprintf(records->refused.item, sizeof records->refused.item, "%s", item ? item : "");
    pthread_mutex_unlock(&records->lock);
}

static bool is_short(const char *value, size_t size) {
    return !value || strnlen(value, size) < size;
}

/* Called by a thread of DDS for each record, before it is kept. A longer key would stay for as long as its writer. */
static bool accepts(const void *sample, void *argument) {
    const struct network_record *record = sample;

    if (is_short(record->item, NAME) && is_short(record->name, NAME) && is_short(record->host, NAME) &&
        is_short(record->boot, NAME) && is_short(record->type, NAME) && is_short(record->topic, TOPIC_NAME) &&
        is_short(record->declaration, NETWORK_TEXT) && is_short(record->extents, NETWORK_TEXT))
        return true;
    refuse(argument, record->machine, record->item);
    return false;
}

/* Called by a thread of DDS: a record was dropped, or must wait. */
static void rejected(dds_entity_t reader, const dds_sample_rejected_status_t status, void *argument) {
    (void)reader;
    if (status.last_reason == DDS_REJECTED_BY_INSTANCES_LIMIT)
        refuse(argument, 0, NULL);
}

static dds_entity_t open_reader(struct network_records *records, const dds_qos_t *qos) {
    const struct dds_topic_filter filter = {DDS_TOPIC_FILTER_SAMPLE_ARG, {.sample_arg = accepts}, records};
    dds_qos_t *bounded = dds_create_qos();
    dds_listener_t *listener = dds_create_listener(records);
    dds_return_t result = dds_copy_qos(bounded, qos);

    dds_qset_resource_limits(bounded, UNREAD, INSTANCES, 1);
    dds_lset_sample_rejected(listener, rejected);
    if (!result)
        result = dds_set_topic_filter_extended(records->read_topic, &filter);
    if (!result)
        result = dds_create_reader(records->network->participant, records->read_topic, bounded, listener);
    dds_delete_listener(listener);
    dds_delete_qos(bounded);
    return result;
}

static int open_both(struct network *network, struct network_records *records, const struct description *description) {
    dds_qos_t *qos = network_qos(description, 1);

    if (!qos)
        return -ENOMEM;
    records->network = network;
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, BLOCKING);
    dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
    /* A machine that is away has not withdrawn its items. */
    dds_qset_writer_data_lifecycle(qos, false);
    /* The reader has a topic of its own: the filter belongs to the topic. */
    records->read_topic = network_topic(network, TOPIC, description, KEYS);
    records->topic = network_topic(network, TOPIC, description, KEYS);
    if (records->topic > 0 && records->read_topic > 0) {
        records->reader = open_reader(records, qos);
        records->writer = dds_create_writer(network->participant, records->topic, qos, NULL);
    }
    dds_delete_qos(qos);
    return records->reader > 0 && records->writer > 0 ? 0 : -EINVAL;
}

int network_records_open(struct network *network, const struct network_event *event, struct network_records **result) {
    struct network_records *records = calloc(1, sizeof *records);
    struct description *description = NULL;

    if (records) {
        pthread_mutex_init(&records->lock, NULL);
        records->proxies = ddsrt_atomic_ld32(&ddsi_refused_proxies);
    }
    int error = records ? description_parse("ddx/msg/Catalog", text, &description) : -ENOMEM;

    if (!error)
        error = open_both(network, records, description);
    if (!error)
        error = network_share_open(network, records->reader, event, &records->share);
    description_free(description);
    if (error)
        network_records_close(records);
    else
        *result = records;
    return error;
}

void network_records_close(struct network_records *records) {
    if (!records)
        return;
    if (records->network)
        network_share_close(records->network, &records->share);
    if (records->reader > 0)
        dds_delete(records->reader);
    if (records->writer > 0)
        network_delete_writer(records->network, records->writer);
    if (records->topic > 0)
        dds_delete(records->topic);
    if (records->read_topic > 0)
        dds_delete(records->read_topic);
    pthread_mutex_destroy(&records->lock);
    free(records);
}

int network_records_write(struct network_records *records, const struct network_record *record) {
    return network_error(dds_write(records->writer, record));
}

int network_records_withdraw(struct network_records *records, const struct network_record *record) {
    dds_return_t result = dds_dispose(records->writer, record);

    if (!result) /* else readers would keep the key for as long as this writer lives */
        dds_unregister_instance(records->writer, record);
    return network_error(result);
}

void network_records_read(struct network_records *records, network_take_record *take, void *argument) {
    int64_t begin = network_share_begin(&records->share);

    do {
        void *data = NULL;
        dds_sample_info_t info;
        dds_return_t count = dds_take(records->reader, &data, &info, 1, 1);

        if (count < 1)
            break;
        take(argument, data,
             info.valid_data                                     ? NETWORK_THERE
             : info.instance_state == DDS_IST_NOT_ALIVE_DISPOSED ? NETWORK_GONE
                                                                 : NETWORK_AWAY);
        dds_return_loan(records->reader, &data, count);
    } while (network_share_left(&records->share, begin));
    network_share_use(records->network, &records->share, begin);
}

void network_records_refused(struct network_records *records, struct network_refused *refused) {
    uint32_t proxies = ddsrt_atomic_ld32(&ddsi_refused_proxies);

    pthread_mutex_lock(&records->lock);
    *refused = records->refused;
    records->refused = (struct network_refused){.count = 0};
    pthread_mutex_unlock(&records->lock);
    refused->count += proxies - records->proxies;
    records->proxies = proxies;
}
