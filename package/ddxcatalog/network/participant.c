/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <ctype.h>
#include <dds/ddsi/ddsi_tran.h>
#include <dds/ddsrt/time.h>
#include <errno.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"
#include "name.h"
#include "description.h"

/* ---- Types made at run time, since items may have any type ---- */

static const dds_dynamic_type_kind_t kinds[] = {
    [DESCRIPTION_INT8] = DDS_DYNAMIC_INT8,      [DESCRIPTION_UINT8] = DDS_DYNAMIC_UINT8,
    [DESCRIPTION_INT16] = DDS_DYNAMIC_INT16,    [DESCRIPTION_UINT16] = DDS_DYNAMIC_UINT16,
    [DESCRIPTION_INT32] = DDS_DYNAMIC_INT32,    [DESCRIPTION_UINT32] = DDS_DYNAMIC_UINT32,
    [DESCRIPTION_INT64] = DDS_DYNAMIC_INT64,    [DESCRIPTION_UINT64] = DDS_DYNAMIC_UINT64,
    [DESCRIPTION_FLOAT] = DDS_DYNAMIC_FLOAT32,  [DESCRIPTION_DOUBLE] = DDS_DYNAMIC_FLOAT64,
    [DESCRIPTION_STRING] = DDS_DYNAMIC_STRING8,
};

static dds_dynamic_type_t make(struct network *network, const struct description *description,
                               const struct description_message *message);

/* A type that is part of another one is owned by that one. */
static dds_dynamic_type_spec_t spec_of(struct network *network, const struct description *description,
                                       const struct description_field *field) {
    dds_dynamic_type_spec_t spec;

    if (field->kind == DESCRIPTION_NESTED)
        spec = DDS_DYNAMIC_TYPE_SPEC(make(network, description, description_find(description, field->type)));
    else if (field->kind == DESCRIPTION_STRING)
        spec = DDS_DYNAMIC_TYPE_SPEC(dds_dynamic_type_create(
            network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_STRING8}));
    else
        spec = DDS_DYNAMIC_TYPE_SPEC_PRIM(kinds[field->kind]);
    if (field->sequence)
        return DDS_DYNAMIC_TYPE_SPEC(dds_dynamic_type_create(
            network->participant,
            (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_SEQUENCE, .name = "sequence", .element_type = spec}));
    if (!field->count)
        return spec;
    return DDS_DYNAMIC_TYPE_SPEC(
        dds_dynamic_type_create(network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_ARRAY,
                                                                                      .name = "array",
                                                                                      .element_type = spec,
                                                                                      .num_bounds = 1,
                                                                                      .bounds = &field->count}));
}

static dds_dynamic_type_t make(struct network *network, const struct description *description,
                               const struct description_message *message) {
    char name[NAME_TYPE];

    name_type(message->type, name);
    dds_dynamic_type_t type = dds_dynamic_type_create(
        network->participant, (dds_dynamic_type_descriptor_t){.kind = DDS_DYNAMIC_STRUCTURE, .name = name});
    dds_dynamic_type_set_extensibility(&type, DDS_DYNAMIC_TYPE_EXT_FINAL);
    for (unsigned i = 0; i < message->count; i++)
        dds_dynamic_type_add_member(&type, DDS_DYNAMIC_MEMBER_(spec_of(network, description, &message->fields[i]),
                                                               message->fields[i].name, DDS_DYNAMIC_MEMBER_ID_AUTO,
                                                               DDS_DYNAMIC_MEMBER_INDEX_END));
    return type;
}

dds_entity_t network_topic(struct network *network, const char *name, const struct description *description,
                           unsigned keys) {
    dds_dynamic_type_t type = make(network, description, description->messages);
    dds_topic_descriptor_t *descriptor = NULL;
    dds_typeinfo_t *info = NULL;
    dds_entity_t topic;

    for (unsigned i = 0; i < keys; i++)
        dds_dynamic_member_set_key(&type, i, true);
    dds_return_t result = type.ret ? type.ret : dds_dynamic_type_register(&type, &info);
    if (!result)
        result = dds_create_topic_descriptor(DDS_FIND_SCOPE_LOCAL_DOMAIN, network->participant, info, 0, &descriptor);
    topic = result ? result : dds_create_topic(network->participant, descriptor, name, NULL, NULL);
    if (descriptor)
        dds_delete_topic_descriptor(descriptor);
    if (info)
        dds_free_typeinfo(info);
    dds_dynamic_type_unref(&type);
    return topic < 0 ? network_error(topic) : topic;
}

/* ---- Addresses. DDS reads them once, at its start. They may change: a lease ends, a robot joins a network ---- */

static bool is_reachable(const struct ifaddrs *one, const char *interface) {
    if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET || !(one->ifa_flags & IFF_UP))
        return false;
    return interface ? !strcmp(one->ifa_name, interface) : !(one->ifa_flags & IFF_LOOPBACK);
}

/* The addresses at which other machines can reach this one, of one interface or (NULL) of all. Returns their number. */
static unsigned addresses_of(const char *interface, uint32_t address[NETWORK_ADDRESSES]) {
    struct ifaddrs *all;
    unsigned count = 0;

    if (getifaddrs(&all))
        return 0;
    for (const struct ifaddrs *one = all; one && count < NETWORK_ADDRESSES; one = one->ifa_next)
        if (is_reachable(one, interface))
            address[count++] = ((const struct sockaddr_in *)(const void *)one->ifa_addr)->sin_addr.s_addr;
    freeifaddrs(all);
    return count;
}

static bool has_address(const uint32_t *address, unsigned count, uint32_t wanted) {
    for (unsigned i = 0; i < count; i++)
        if (address[i] == wanted)
            return true;
    return false;
}

bool network_moved(const struct network *network) {
    uint32_t address[NETWORK_ADDRESSES];
    unsigned count = addresses_of(*network->interface ? network->interface : NULL, address);

    for (unsigned i = 0; i < network->addresses; i++)
        if (!has_address(address, count, network->address[i]))
            return true;
    return false;
}

/* ---- The participant ---- */

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
    network->addresses = addresses_of(options->interface, network->address);
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
