/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "internal.h"

#include <ctype.h>
#include <dds/ddsi/ddsi_tran.h>
#include <dds/ddsrt/time.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "typehash.h"

#define LEASE "3s"  /* a machine that is silent for this time is away */
#define EVENTS 1024 /* at a time: of each reader and writer, so that none is left out for long */
#define PERIOD DDS_MSECS(20)
#define SHARE DDS_MSECS(5)  /* of each period */
#define CALL DDS_USECS(100) /* the cost of an event, apart from reading */
/*
 * Bytes of a sample: a value of 16 MiB, the largest that is sent, and what comes before it. A forged one, of which only
 * a piece has come, takes memory until its participant is gone.
 */
#define SAMPLE "16809984B"
#define LINGER DDS_SECS(1)
/* The first free pair of ports, so that they are known in advance. The last pair of domain 232 is below port 65536. */
#define PAIRS "50"
#define FRAGMENT 1480 /* bytes of a datagram in a packet; headers of IP and Ethernet come before them */
#define HEADERS 34
#define PROBES (50 * 500u) /* bytes by which a peer is asked at the start, on each of the pairs */
#define UDP 8
#define PORTS "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>" PAIRS "</MaxAutoParticipantIndex>"

int network_error(dds_return_t result) {
    switch (result) {
    case DDS_RETCODE_OUT_OF_RESOURCES: return -ENOMEM;
    case DDS_RETCODE_TIMEOUT: return -EAGAIN;
    default: return result < 0 ? -EINVAL : 0;
    }
}

/* Names of interfaces and addresses, which go into XML. */
static bool is_plain(const char *name) {
    for (const char *c = name; *c; c++)
        if (!isalnum((unsigned char)*c) && !strchr(".:-_%", *c))
            return false;
    return *name;
}

static char *settings(const struct network_options *options) {
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    fputs("<General><Interfaces><NetworkInterface ", to);
    if (options->interface)
        fprintf(to, "name=\"%s\"", options->interface);
    else
        fputs("autodetermine=\"true\"", to);
    fprintf(to, "/></Interfaces><AllowMulticast>%s</AllowMulticast></General>", options->unicast ? "false" : "default");
    fputs("<Discovery><LeaseDuration>" LEASE "</LeaseDuration>" PORTS "<Peers>", to);
    for (const char *const *peer = options->peers; *peer; peer++)
        fprintf(to, "<Peer address=\"%s\"/>", *peer);
    /* DDS would wait for each writer that is deleted, one after the other: network_delete_writer() does. */
    fputs("</Peers></Discovery><Internal><WriterLingerDuration>0s</WriterLingerDuration>"
          "<MaxSampleSize>" SAMPLE "</MaxSampleSize></Internal>",
          to);
    fputs("<Tracing><Verbosity>none</Verbosity></Tracing>", to);
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

__thread bool network_sends;
__thread size_t network_sent;
static struct bucket *bucket; /* of the one network of this program */

/* Called by threads of DDS, and by those that write. */
static bool may_send(size_t bytes) {
    size_t datagram = bytes + UDP, sent = datagram + HEADERS * ((datagram + FRAGMENT - 1) / FRAGMENT);

    if (!network_sends)
        return bucket_take_other(bucket, sent, ddsrt_time_monotonic().v);
    network_sent += sent;
    return true;
}

static int join(struct network *network, const struct network_options *options) {
    char *text = settings(options);

    if (!text)
        return -ENOMEM;
    network->bucket = bucket = options->bucket;
    ddsi_may_send = bucket ? may_send : NULL;
    network->domain = dds_create_domain(options->domain, text);
    free(text);
    network->participant = network->domain < 0 ? network->domain : dds_create_participant(options->domain, NULL, NULL);
    if (network->participant < 0)
        return -EADDRNOTAVAIL;
    network->waitset = dds_create_waitset(network->participant);
    return network_error(network->waitset);
}

int network_open(const struct network_options *options, struct network **result) {
    if (options->interface && !is_plain(options->interface))
        return -EINVAL;
    for (const char *const *peer = options->peers; *peer; peer++)
        if (!is_plain(*peer))
            return -EINVAL;
        else if (options->bucket) /* the peers that are named last would never be asked */
            bucket_grant(options->bucket, PROBES);
    struct network *network = calloc(1, sizeof *network);
    if (!network)
        return -ENOMEM;
    snprintf(network->interface, sizeof network->interface, "%s", options->interface ? options->interface : "");
    network->addresses = network_addresses(options->interface, network->address);
    /* If the configured interface is missing, DDS would take the loopback interface, and keep it. */
    int error = network->addresses || options->interface ? join(network, options) : -EADDRNOTAVAIL;
    if (error)
        network_close(network);
    else
        *result = network;
    return error;
}

void network_close(struct network *network) {
    if (network && network->domain > 0)
        dds_delete(network->domain);
    free(network);
}

void network_linger(struct network *network) {
    network->linger = ddsrt_time_monotonic().v + LINGER;
}

void network_delete_writer(const struct network *network, dds_entity_t writer) {
    int64_t left = network->linger - ddsrt_time_monotonic().v;

    dds_wait_for_acks(writer, left > 0 ? left : 0);
    dds_delete(writer);
}

int network_attach(struct network *network, dds_entity_t entity, uint32_t status, const struct network_event *event) {
    dds_return_t result = dds_set_status_mask(entity, status);

    return network_error(result ? result : dds_waitset_attach(network->waitset, entity, (dds_attach_t)event));
}

int network_attach_reader(struct network *network, dds_entity_t reader, const struct network_event *event,
                          dds_entity_t *condition) {
    *condition = dds_create_readcondition(reader, DDS_ANY_STATE);
    return network_error(*condition < 0 ? *condition
                                        : dds_waitset_attach(network->waitset, *condition, (dds_attach_t)event));
}

int network_share_open(struct network *network, dds_entity_t reader, const struct network_event *event,
                       struct network_share *share) {
    int error = network_attach_reader(network, reader, event, &share->condition);

    if (error) {
        share->condition = 0;
        return error;
    }
    share->event = event;
    share->next = network->shares;
    network->shares = share;
    return 0;
}

void network_share_close(struct network *network, struct network_share *share) {
    struct network_share **at = &network->shares;

    while (*at && *at != share)
        at = &(*at)->next;
    if (*at)
        *at = share->next;
}

int64_t network_share_begin(struct network_share *share) {
    int64_t now = ddsrt_time_monotonic().v;

    if (now - share->begin >= PERIOD) {
        share->begin = now;
        share->used = 0;
    }
    return now;
}

bool network_share_left(const struct network_share *share, int64_t begin) {
    return share->used + ddsrt_time_monotonic().v - begin < SHARE;
}

void network_share_use(struct network *network, struct network_share *share, int64_t begin) {
    share->used += ddsrt_time_monotonic().v - begin + CALL;
    if (share->used >= SHARE && !dds_waitset_detach(network->waitset, share->condition))
        share->resting = true;
}

/* Let readers go on whose next period has come. */
static void resume(struct network *network) {
    int64_t now = ddsrt_time_monotonic().v;

    for (struct network_share *share = network->shares; share; share = share->next)
        if (share->resting && now - share->begin >= PERIOD)
            share->resting = dds_waitset_attach(network->waitset, share->condition, (dds_attach_t)share->event) != 0;
}

void network_wait(struct network *network, double seconds) {
    dds_attach_t ready[EVENTS];

    resume(network);
    dds_return_t count = dds_waitset_wait(network->waitset, ready, EVENTS, (dds_duration_t)(seconds * 1e9));

    for (dds_return_t i = 0; i < count && i < EVENTS; i++) {
        const struct network_event *event = (const struct network_event *)ready[i];

        event->ready(event->argument);
    }
}

dds_qos_t *network_qos(const struct description *description, int depth) {
    const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
    char hash[TYPEHASH_MAX], data[TYPEHASH_MAX + 16];
    dds_qos_t *qos = typehash(description, hash) ? NULL : dds_create_qos();

    if (!qos)
        return NULL;
    int length = snprintf(data, sizeof data, "typehash=%s;", hash);
    dds_qset_userdata(qos, data, (size_t)length);
    dds_qset_data_representation(qos, 1, &representation);
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, 0);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth);
    return qos;
}
