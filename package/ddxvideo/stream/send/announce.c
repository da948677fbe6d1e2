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

/* Where the announcements go, and from where; false if there is no group, or no way to it now. */
static bool find_way(const struct outlet *outlet, struct network_address *group, struct network_address *own) {
    if (!outlet->group)
        return false;
    sap_group(&outlet->receiver[0], group);
    return outlet_origin(outlet, group, own);
}

static size_t send_message(struct outlet *outlet, const struct network_address *group, const struct sap *sap) {
    uint8_t data[SAP_MAX];
    size_t size = sap_write(sap, data);

    return size && outlet_send_to(outlet, group, data, size) ? size + network_overhead(group) : 0;
}

/* RFC 2974, 5: a deletion has the name of the announcement and its o= line. */
static size_t take_back(struct announce_stream *stream, struct outlet *outlet, const struct network_address *group) {
    const struct sap sap = {.deletion = true,
                            .hash = stream->hash,
                            .origin = stream->origin,
                            .text = (const uint8_t *)stream->line,
                            .size = strlen(stream->line)};

    if (!stream->announced)
        return 0;
    stream->announced = false;
    return send_message(outlet, group, &sap);
}

/* A description from one address of this machine. */
struct message {
    char line[sizeof((struct announce_stream *)0)->line]; /* o= */
    char text[SDP_MAX + 256];
};

/* The hash of the text is what names this version. */
static struct sap compose(struct message *message, const struct announce_stream *stream,
                          const struct network_address *own) {
    char host[NETWORK_TEXT_MAX];

    snprintf(message->line, sizeof message->line, "o=- %" PRIu32 " %" PRIu32 " IN %s %s\r\n", stream->session,
             stream->version, network_is_ipv6(own) ? "IP6" : "IP4", network_host(own, host));
    int length = snprintf(message->text, sizeof message->text, "v=0\r\n%s%s", message->line, stream->body);
    const uint8_t *text = (const uint8_t *)message->text;
    return (struct sap){
        .hash = sap_hash(text, (size_t)length), .origin = *own, .text = text, .size = (size_t)length};
}

static size_t announce_one(struct announce_stream *stream, struct outlet *outlet, const struct network_address *group,
                           const struct network_address *own) {
    struct message message;
    struct sap sap = compose(&message, stream, own);
    size_t bytes = 0;

    if (sap.hash != stream->hash) /* another picture size, or another address of this machine */
        bytes += take_back(stream, outlet, group);
    stream->hash = sap.hash;
    stream->origin = sap.origin;
    memcpy(stream->line, message.line, sizeof stream->line);
    size_t sent = send_message(outlet, group, &sap);
    stream->announced |= sent > 0;
    return bytes + sent;
}

size_t announce_tick(struct announce *announce, struct outlet *outlet, int64_t now) {
    struct network_address group, own;
    size_t bytes = 0;

    if (announce->off || now < announce->due)
        return 0;
    announce->due = now + ANNOUNCE_INTERVAL;
    if (!find_way(outlet, &group, &own))
        return 0;
    for (unsigned i = 0; i < ANNOUNCE_STREAMS; i++) {
        if (*announce->stream[i].body)
            bytes += announce_one(&announce->stream[i], outlet, &group, &own);
    }
    return bytes;
}

void announce_end(struct announce *announce, struct outlet *outlet) {
    struct network_address group, own;

    if (!announce->off && find_way(outlet, &group, &own)) {
        for (unsigned i = 0; i < ANNOUNCE_STREAMS; i++)
            take_back(&announce->stream[i], outlet, &group);
    }
}
