/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "announce.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

void announce_describe(struct announce *announce, unsigned which, uint32_t session, const char *sdp) {
    struct announce_stream *stream = &announce->stream[which];
    const char *body = strstr(sdp, "\r\ns=");

    if (!body || !strcmp(body + 2, stream->body))
        return;
    snprintf(stream->body, sizeof stream->body, "%s", body + 2);
    stream->session = session;
    stream->version++;
    announce->due = 0;
}

/* Target and source address of announcements. */
struct way {
    struct post *post;
    struct network_address group, own;
};

/* False if there is no group, or no route to it now. */
static bool find_way(struct post *post, struct way *way) {
    const struct outlet *outlet = post->outlet;

    if (!outlet->group)
        return false;
    way->post = post;
    sap_group(&outlet->receiver[0], &way->group);
    return outlet_origin(outlet, &way->group, &way->own);
}

static bool send_message(const struct way *way, const struct sap *sap) {
    uint8_t data[SAP_MAX];
    size_t size = sap_write(sap, data);

    return size && post_other(way->post, size + network_overhead(&way->group)) &&
           outlet_send_to(way->post->outlet, &way->group, data, size);
}

/* RFC 2974, 5: a deletion has the name of the announcement and its o= line. */
static void take_back(struct announce_stream *stream, const struct way *way) {
    const struct sap sap = {.deletion = true,
                            .hash = stream->hash,
                            .origin = stream->origin,
                            .text = (const uint8_t *)stream->line,
                            .size = strlen(stream->line)};

    if (stream->announced)
        send_message(way, &sap);
    stream->announced = false;
}

/* A description from one address of this machine. */
struct message {
    char line[sizeof((struct announce_stream *)0)->line]; /* o= */
    char text[SDP_MAX + 256];
};

/* The hash of the text identifies this version. */
static struct sap compose(struct message *message, const struct announce_stream *stream,
                          const struct network_address *own) {
    char host[NETWORK_TEXT_MAX];

    snprintf(message->line, sizeof message->line, "o=- %" PRIu32 " %" PRIu32 " IN %s %s\r\n", stream->session,
             stream->version, network_is_ipv6(own) ? "IP6" : "IP4", network_host(own, host));
    int length = snprintf(message->text, sizeof message->text, "v=0\r\n%s%s", message->line, stream->body);
    const uint8_t *text = (const uint8_t *)message->text;
    return (struct sap){.hash = sap_hash(text, (size_t)length), .origin = *own, .text = text, .size = (size_t)length};
}

static bool announce_one(struct announce_stream *stream, const struct way *way) {
    struct message message;
    struct sap sap = compose(&message, stream, &way->own);

    if (sap.hash != stream->hash) /* another picture size, or another address of this machine */
        take_back(stream, way);
    stream->hash = sap.hash;
    stream->origin = sap.origin;
    memcpy(stream->line, message.line, sizeof stream->line);
    bool sent = send_message(way, &sap);
    stream->announced |= sent;
    return sent;
}

void announce_tick(struct announce *announce, struct post *post, int64_t now) {
    struct way way;
    bool all = true;

    if (announce->off || now < announce->due)
        return;
    announce->due = now + ANNOUNCE_INTERVAL_NS;
    if (!find_way(post, &way))
        return;
    for (unsigned i = 0; i < ANNOUNCE_STREAMS; i++) {
        if (*announce->stream[i].body)
            all &= announce_one(&announce->stream[i], &way);
    }
    if (!all)
        announce->due = now + ANNOUNCE_RETRY_NS;
}

void announce_end(struct announce *announce, struct post *post) {
    struct way way;

    if (!announce->off && find_way(post, &way)) {
        for (unsigned i = 0; i < ANNOUNCE_STREAMS; i++)
            take_back(&announce->stream[i], &way);
    }
}
