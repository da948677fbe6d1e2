/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsrt/time.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"

#define SMALL 8192 /* messages of up to this size are kept for readers that have lost them */
#define KEPT 8
#define ANY DDS_LENGTH_UNLIMITED
#define UNREAD 128        /* small messages that a reader queues while this program gets no processor time */
#define TURN (2 * UNREAD) /* messages that are read at a time: another machine may send faster than they are read */

struct network_writer {
    const struct network *network;
    dds_entity_t topic, writer;
    const struct ddsi_sertype *type;
};

struct network_reader {
    dds_entity_t topic, reader, condition;
};

static dds_qos_t *qos_of(const struct description *description, size_t size, int depth) {
    return network_qos(description, size <= SMALL ? depth : 1);
}

int network_writer_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        bool latched, const struct network_event *event, struct network_writer **result) {
    struct network_writer *writer = calloc(1, sizeof *writer);
    dds_qos_t *qos = qos_of(description, size, KEPT);
    int error = writer && qos ? 0 : -ENOMEM;

    if (qos && latched) {
        dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
        dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, 1, ANY, ANY, ANY);
    }

    if (!error) {
        writer->network = network;
        writer->topic = network_topic(network, topic, description, 0);
        writer->writer =
            writer->topic < 0 ? writer->topic : dds_create_writer(network->participant, writer->topic, qos, NULL);
        error = writer->writer < 0 ? -EINVAL : network_error(dds_get_entity_sertype(writer->writer, &writer->type));
    }
    if (!error)
        error = network_attach(network, writer->writer, DDS_PUBLICATION_MATCHED_STATUS, event);
    dds_delete_qos(qos);
    if (error)
        network_writer_close(writer);
    else
        *result = writer;
    return error;
}

void network_writer_close(struct network_writer *writer) {
    if (writer && writer->writer > 0)
        network_delete_writer(writer->network, writer->writer);
    if (writer && writer->topic > 0)
        dds_delete(writer->topic);
    free(writer);
}

unsigned network_writer_readers(struct network_writer *writer, unsigned *came) {
    dds_publication_matched_status_t status = {0};

    dds_get_publication_matched_status(writer->writer, &status);
    *came = status.total_count_change > 0 ? (unsigned)status.total_count_change : 0;
    return status.current_count;
}

int network_write(struct network_writer *writer, unsigned char *message, size_t size, int64_t wall) {
    struct bucket *bucket = writer->network->bucket;
    size_t padding = -size & 3;

    if (bucket && !bucket_take(bucket, size, ddsrt_time_monotonic().v))
        return -EAGAIN;
    memset(message + size, 0, padding);
    message[3] = (unsigned char)padding;
    const ddsrt_iovec_t part = {.iov_base = message, .iov_len = size + padding};
    struct ddsi_serdata *data = ddsi_serdata_from_ser_iov(writer->type, SDK_DATA, 1, &part, size + padding);
    if (!data) {
        if (bucket)
            bucket_correct(bucket, size, 0);
        return -EINVAL;
    }
    data->timestamp.v = wall;
    data->statusinfo = 0;
    network_sends = true;
    network_sent = 0;
    dds_return_t result = dds_forwardcdr(writer->writer, data);
    network_sends = false;
    if (bucket)
        bucket_correct(bucket, size, network_sent);
    return network_error(result);
}

int network_reader_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        const struct network_event *event, struct network_reader **result) {
    struct network_reader *reader = calloc(1, sizeof *reader);
    dds_qos_t *qos = qos_of(description, size, UNREAD);
    int error = reader && qos ? 0 : -ENOMEM;

    if (qos) /* an item exported on the topic must not be a source of an item accepted from it */
        dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
    if (!error) {
        reader->topic = network_topic(network, topic, description, 0);
        reader->reader =
            reader->topic < 0 ? reader->topic : dds_create_reader(network->participant, reader->topic, qos, NULL);
        error =
            reader->reader < 0 ? -EINVAL : network_attach_reader(network, reader->reader, event, &reader->condition);
    }
    dds_delete_qos(qos);
    if (error)
        network_reader_close(reader);
    else
        *result = reader;
    return error;
}

void network_reader_close(struct network_reader *reader) {
    if (reader && reader->reader > 0)
        dds_delete(reader->reader);
    if (reader && reader->topic > 0)
        dds_delete(reader->topic);
    free(reader);
}

static void take_one(struct ddsi_serdata *data, uint64_t writer, network_take *take, void *argument) {
    uint32_t size = ddsi_serdata_size(data);
    ddsrt_iovec_t part;
    struct ddsi_serdata *held = ddsi_serdata_to_ser_ref(data, 0, size, &part);

    take(argument, writer, part.iov_base, size);
    ddsi_serdata_to_ser_unref(held, &part);
}

void network_read(struct network_reader *reader, network_take *take, void *argument) {
    struct ddsi_serdata *data = NULL;
    dds_sample_info_t info;

    for (unsigned i = 0; i < TURN && dds_takecdr(reader->reader, &data, 1, &info, DDS_ANY_STATE) == 1; i++) {
        if (info.valid_data)
            take_one(data, info.publication_handle, take, argument);
        ddsi_serdata_unref(data);
        data = NULL;
    }
}
