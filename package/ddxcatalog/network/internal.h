/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXCATALOG_NETWORK_INTERNAL_H
#define DDXCATALOG_NETWORK_INTERNAL_H

#include <dds/dds.h>
#include <net/if.h>

#include "network.h"

#define NETWORK_ADDRESSES 16

/* The event of a reader that gets a quarter of this program's time at most, however much is forged. */
struct network_share {
    struct network_share *next;
    const struct network_event *event;
    dds_entity_t condition; /* 0: not open */
    int64_t begin, used;    /* of the current period; ns */
    bool resting;           /* until the next period */
};

struct network {
    dds_entity_t domain, participant, waitset;
    struct bucket *bucket;               /* or NULL */
    uint32_t address[NETWORK_ADDRESSES]; /* of this machine when it was opened; IPv4, as DDS uses here */
    unsigned addresses;
    char interface[IF_NAMESIZE]; /* the configured interface, or "" */
    int64_t linger;              /* time until which closing writers wait; ns, monotonic */
    struct network_share *shares;
};

/* While true, the bytes of packets that this thread sends are those of a value: they are added to network_sent. */
extern __thread bool network_sends;
extern __thread size_t network_sent;

/* -errno for the return value of a DDS function; positive values are not errors. */
int network_error(dds_return_t result);

/* A topic of this type; keys: the first `keys` fields. The topic, or -errno. */
dds_entity_t network_topic(struct network *network, const char *name, const struct description *description,
                           unsigned keys);

/* Let the event be called when a status of the mask changes. 0 or -errno. */
int network_attach(struct network *network, dds_entity_t entity, uint32_t status, const struct network_event *event);

/* Let the event be called while the reader has samples. 0 or -errno. *condition is deleted with the reader. */
int network_attach_reader(struct network *network, dds_entity_t reader, const struct network_event *event,
                          dds_entity_t *condition);

/* The same, for a share of the time. The caller closes the share before its reader is deleted. */
int network_share_open(struct network *network, dds_entity_t reader, const struct network_event *event,
                       struct network_share *share);
void network_share_close(struct network *network, struct network_share *share);

/* To be called when reading begins; returns the time. */
int64_t network_share_begin(struct network_share *share);

/* Whether the reader may go on: asked after each sample, with the time when reading began. */
bool network_share_left(const struct network_share *share, int64_t begin);

/* To be called when reading ends, with the time when it began. */
void network_share_use(struct network *network, struct network_share *share, int64_t begin);

/* Delete a writer once its readers have confirmed all messages, or the time of network_linger() is over. */
void network_delete_writer(const struct network *network, dds_entity_t writer);

/* QoS of all topics; to dds_delete_qos(). NULL: no memory. */
dds_qos_t *network_qos(const struct description *description, int depth);

#endif
