/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdlib.h>

#include "internal.h"

#define TOPIC "ddx/catalog"
#define KEYS 2
#define BLOCKING DDS_MSECS(100)

/* As struct network_record. */
static const char text[] = "uint64 machine\nstring item\nstring name\nint64 since\nstring host\nstring boot\n"
                           "string type\nstring declaration\nstring extents\nstring topic\n";

struct network_records {
    const struct network *network;
    dds_entity_t topic, reader, writer;
};

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
    records->topic = network_topic(network, TOPIC, description, KEYS);
    if (records->topic > 0) {
        records->reader = dds_create_reader(network->participant, records->topic, qos, NULL);
        records->writer = dds_create_writer(network->participant, records->topic, qos, NULL);
    }
    dds_delete_qos(qos);
    return records->reader > 0 && records->writer > 0 ? 0 : -EINVAL;
}

int network_records_open(struct network *network, const struct network_event *event, struct network_records **result) {
    struct network_records *records = calloc(1, sizeof *records);
    struct description *description = NULL;
    int error = records ? description_parse("ddx/msg/Catalog", text, &description) : -ENOMEM;

    if (!error)
        error = open_both(network, records, description);
    if (!error)
        error = network_attach(network, records->reader, DDS_DATA_AVAILABLE_STATUS, event);
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
    if (records->reader > 0)
        dds_delete(records->reader);
    if (records->writer > 0)
        network_delete_writer(records->network, records->writer);
    if (records->topic > 0)
        dds_delete(records->topic);
    free(records);
}

int network_records_write(struct network_records *records, const struct network_record *record) {
    return network_error(dds_write(records->writer, record));
}

int network_records_withdraw(struct network_records *records, const struct network_record *record) {
    return network_error(dds_dispose(records->writer, record));
}

void network_records_read(struct network_records *records, network_take_record *take, void *argument) {
    uint32_t status;

    dds_take_status(records->reader, &status, DDS_DATA_AVAILABLE_STATUS);
    for (;;) {
        void *data = NULL;
        dds_sample_info_t info;
        dds_return_t count = dds_take(records->reader, &data, &info, 1, 1);

        if (count < 1)
            return;
        take(argument, data, info.valid_data ? NETWORK_THERE
             : info.instance_state == DDS_IST_NOT_ALIVE_DISPOSED ? NETWORK_GONE : NETWORK_AWAY);
        dds_return_loan(records->reader, &data, count);
    }
}
