/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "guard.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>

#include "bits.h"
#include "rtp.h"

#define CSRC 12 /* position of the first CSRC of an RTP packet */

/* ---- Sources ---- */

static struct guard_source *find_source(struct guard *guard, uint32_t ssrc) {
    for (struct guard_source *source = guard->source; source < guard->source + GUARD_SOURCES; source++)
        if (source->used && source->ssrc == ssrc)
            return source;
    return NULL;
}

/* The source with this SSRC; if it is new, it takes the place of the one that was used least recently. */
static struct guard_source *source_of(struct guard *guard, uint32_t ssrc) {
    struct guard_source *source = find_source(guard, ssrc);

    if (!source) {
        source = guard->source;
        for (struct guard_source *other = source + 1; other < guard->source + GUARD_SOURCES; other++)
            source = other->used < source->used ? other : source;
        *source = (struct guard_source){.ssrc = ssrc};
    }
    source->used = ++guard->used;
    return source;
}

void guard_show(struct guard *guard, uint32_t ssrc) {
    guard->shows = true;
    guard->shown = ssrc;
}

static bool is_shown(const struct guard *guard, uint32_t ssrc) {
    return guard->shows && guard->shown == ssrc;
}

/* A refused packet of a stream on display is forged, and has no effect on that stream. */
static void refuse_packet(struct guard *guard, const struct rtp_packet *packet) {
    if (is_shown(guard, packet->ssrc))
        return;
    struct guard_source *source = source_of(guard, packet->ssrc);

    source->refused++;
    source->encrypted = packet->frame.encrypted;
}

/* ---- With a key ---- */

static bool decrypt(struct guard *guard, uint8_t *data, size_t *size) {
    int error = secure_unprotect(guard->secure, data, size);

    guard->count[GUARD_REPEATED] += error == -EALREADY;
    guard->count[GUARD_REFUSED] += error && error != -EALREADY;
    return !error;
}

static bool decrypt_media(struct guard *guard, uint8_t *data, size_t *size) {
    uint64_t refused = guard->count[GUARD_REFUSED];
    bool good = decrypt(guard, data, size);
    struct rtp_packet packet;

    if (*size > SECURE_PACKET_MAX || !rtp_parse(data, *size, &packet))
        return good;
    if (good)
        source_of(guard, packet.ssrc)->good = true;
    else if (guard->count[GUARD_REFUSED] > refused)
        refuse_packet(guard, &packet);
    return good;
}

/* ---- Without a key ---- */

/* Whether a media packet can be read. Invalid packets pass, since struct stream_rx counts them. */
static bool pass_media(struct guard *guard, const uint8_t *data, size_t size) {
    struct rtp_packet packet;

    if (size > SECURE_PACKET_MAX || !rtp_parse(data, size, &packet) || !packet.frame.encrypted)
        return true;
    guard->count[GUARD_REFUSED]++;
    refuse_packet(guard, &packet);
    return false;
}

/* The same of a repair packet, by the media stream that its first CSRC names. */
static bool pass_repair(struct guard *guard, const uint8_t *data, size_t size) {
    if (size < CSRC + 4 || !(data[0] & 15) || is_shown(guard, get32(data + CSRC)))
        return true;
    const struct guard_source *source = find_source(guard, get32(data + CSRC));
    if (!source || !source->encrypted)
        return true;
    guard->count[GUARD_REFUSED]++;
    return false;
}

/* ---- Both ---- */

bool guard_media(struct guard *guard, uint8_t *data, size_t *size) {
    return guard->secure ? decrypt_media(guard, data, size) : pass_media(guard, data, *size);
}

bool guard_repair(struct guard *guard, uint8_t *data, size_t *size) {
    return guard->secure ? decrypt(guard, data, size) : pass_repair(guard, data, *size);
}

static void write_line(const struct guard *guard, const struct guard_source *source, char *text) {
    const char *what = source->encrypted ? "encrypted with another key than that of" : "not encrypted, unlike";

    int length = snprintf(text, GUARD_TEXT_MAX, "nothing is shown of SSRC %08" PRIx32 ": it is ", source->ssrc);

    text += length;
    if (guard->secure)
        snprintf(text, GUARD_TEXT_MAX - (size_t)length, "%s -key %.200s", what, guard->path);
    else
        snprintf(text, GUARD_TEXT_MAX - (size_t)length, "encrypted; give its key: -key FILE");
}

bool guard_says(struct guard *guard, int64_t now, char *text) {
    if (guard->has_said && now - guard->said < GUARD_QUIET_NS)
        return false;
    for (struct guard_source *source = guard->source; source < guard->source + GUARD_SOURCES; source++) {
        if (source->refused < GUARD_DOUBT || source->good || source->said)
            continue;
        write_line(guard, source, text);
        source->said = guard->has_said = true;
        guard->said = now;
        return true;
    }
    return false;
}
