/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "secure.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "bits.h"

/* ---- The rollover counter ---- */

#define FIXED 12 /* bytes of the header that every packet has */
#define EXTENSION 0x10
#define ONE_BYTE 0xBEDE /* RFC 8285: elements with headers of one byte */
#define WORD 4
#define ELEMENT (ROLLOVER_ID << 4 | (WORD - 2)) /* id, and bytes after this one less one */

/* The position of the extension's header, even if it is missing; 0 if this is not an RTP packet. */
static size_t extension_of(const uint8_t *packet, size_t size) {
    if (size < FIXED || packet[0] >> 6 != 2)
        return 0;
    size_t at = FIXED + 4u * (packet[0] & 15);

    return at <= size ? at : 0;
}

/* The words of the extension at this place; 0 if it is of another form, empty, or longer than the packet. */
static size_t words_of(const uint8_t *packet, size_t size, size_t at) {
    if (size - at < WORD || get16(packet + at) != ONE_BYTE)
        return 0;
    size_t words = get16(packet + at + 2);

    return words <= (size - at) / WORD - 1 ? words : 0;
}

size_t rollover_put(uint8_t *packet, size_t size, uint32_t counter) {
    size_t at = extension_of(packet, size), words = 0, growth = WORD;

    if (!at)
        return size;
    if (packet[0] & EXTENSION) {
        words = words_of(packet, size, at);
        if (!words || words == UINT16_MAX)
            return size;
        memmove(packet + at + 2 * WORD, packet + at + WORD, size - at - WORD);
    } else {
        growth = 2 * WORD;
        memmove(packet + at + growth, packet + at, size - at);
        packet[0] |= EXTENSION;
    }
    put16(put16(packet + at, ONE_BYTE), (uint16_t)(words + 1));
    put32(packet + at + WORD, (uint32_t)ELEMENT << 24 | (counter & 0xffffff));
    return size + growth;
}

bool rollover_get(const uint8_t *packet, size_t size, uint32_t *counter) {
    size_t at = extension_of(packet, size);

    if (!at || !(packet[0] & EXTENSION) || !words_of(packet, size, at) || packet[at + WORD] != ELEMENT)
        return false;
    *counter = get32(packet + at + WORD) & 0xffffff;
    return true;
}

size_t rollover_take(uint8_t *packet, size_t size) {
    uint32_t counter;

    if (!rollover_get(packet, size, &counter))
        return size;
    size_t at = extension_of(packet, size), words = words_of(packet, size, at) - 1;
    size_t to = words ? at + WORD : at, from = at + 2 * WORD;
    memmove(packet + to, packet + from, size - from);
    if (words)
        put16(packet + at + 2, (uint16_t)words);
    else
        packet[0] &= (uint8_t)~EXTENSION;
    return size - (from - to);
}

/* ---- Encryption ---- */

#ifdef WITH_SRTP
#include <assert.h>
#include <srtp2/srtp.h>
#include <stdlib.h>

#define RTP_HEADER 12 /* bytes of each packet, at least */
#define RTCP_HEADER 8
#define RTP_SSRC 8 /* where it is */
#define RTCP_SSRC 4

static_assert(SECURE_ROOM >= ROLLOVER_GROWTH + SRTP_MAX_TRAILER_LEN, "libsrtp2 wants more room");

typedef srtp_err_status_t transform(srtp_t session, void *packet, int *size);

struct peer {
    uint32_t ssrc;
    srtp_t session; /* NULL: free */
    uint64_t index; /* the highest authenticated extended sequence number */
    uint64_t used;  /* when, by the count of `struct side` */
};

/* One direction of RTP or of RTCP. */
struct side {
    struct peer peers[SECURE_PEERS];
    uint64_t used;
    struct secure_count count;
};

struct secure {
    uint8_t key[KEY_FILE_BYTES];
    struct side out, in, reports_out, reports_in;
};

/* A received packet. */
struct incoming {
    uint8_t *data;
    size_t size;
    uint32_t ssrc;
    uint16_t sequence;
    bool has_counter; /* the packet has the counter: */
    uint32_t counter;
    transform *unprotect;
};

static struct peer *find_peer(struct side *side, uint32_t ssrc) {
    for (struct peer *peer = side->peers; peer < side->peers + SECURE_PEERS; peer++)
        if (peer->session && peer->ssrc == ssrc)
            return peer;
    return NULL;
}

/* A free peer, otherwise the least recently used one. */
static struct peer *oldest(struct side *side) {
    struct peer *oldest = side->peers;

    for (struct peer *peer = side->peers; peer < side->peers + SECURE_PEERS; peer++) {
        if (!peer->session)
            return peer;
        if (peer->used < oldest->used)
            oldest = peer;
    }
    return oldest;
}

static srtp_t session_of(struct secure *secure, uint32_t ssrc, uint32_t counter) {
    srtp_policy_t policy = {.ssrc = {ssrc_specific, ssrc}, .key = secure->key, .window_size = SECURE_WINDOW};
    srtp_t session;

    srtp_crypto_policy_set_rtp_default(&policy.rtp); /* AES_CM_128_HMAC_SHA1_80 */
    srtp_crypto_policy_set_rtcp_default(&policy.rtcp);
    if (srtp_create(&session, &policy))
        return NULL;
    if (counter && srtp_set_stream_roc(session, ssrc, counter)) {
        srtp_dealloc(session);
        return NULL;
    }
    return session;
}

/* The extended sequence number nearest to `index` (RFC 3711, 3.3.1). */
static uint64_t estimate(uint64_t index, uint16_t sequence) {
    int64_t guess = (int64_t)index + (int16_t)(sequence - (uint16_t)index);

    return (uint64_t)(guess < 0 ? guess + 65536 : guess);
}

static void used(struct side *side, struct peer *peer, uint64_t index) {
    peer->used = ++side->used;
    if (index > peer->index)
        peer->index = index;
}

static int error_of(srtp_err_status_t status, int other) {
    bool repeated = status == srtp_err_status_replay_fail || status == srtp_err_status_replay_old;

    return repeated ? -EALREADY : other;
}

/* Called once in a process: libsrtp2 refuses a second call. */
static bool has_started(void) {
    static bool done;

    done = done || !srtp_init();
    return done;
}

struct secure *secure_open(const char *path, char *error) {
    struct secure *secure = calloc(1, sizeof *secure);

    if (!secure || !has_started()) {
        snprintf(error, KEY_FILE_ERROR_MAX, "%.200s: cannot start encryption: out of memory, or libsrtp2 failed", path);
    } else if (key_file_read(path, secure->key, error)) {
        return secure;
    }
    free(secure);
    return NULL;
}

static void forget(struct side *side) {
    for (struct peer *peer = side->peers; peer < side->peers + SECURE_PEERS; peer++)
        if (peer->session)
            srtp_dealloc(peer->session);
}

void secure_close(struct secure *secure) {
    if (!secure)
        return;
    forget(&secure->out);
    forget(&secure->in);
    forget(&secure->reports_out);
    forget(&secure->reports_in);
    explicit_bzero(secure, sizeof *secure);
    free(secure);
}

/* The peer of our own SSRC. None is dropped: a repeated SSRC would be encrypted with the same key stream. */
static int sending(struct secure *secure, struct side *side, uint32_t ssrc, struct peer **peer) {
    if ((*peer = find_peer(side, ssrc)))
        return 0;
    *peer = oldest(side);
    if ((*peer)->session)
        return -ENOSPC;
    srtp_t session = session_of(secure, ssrc, 0);
    if (!session)
        return -ENOMEM;
    **peer = (struct peer){.ssrc = ssrc, .session = session};
    return 0;
}

int secure_protect(struct secure *secure, uint8_t *packet, size_t *size) {
    struct peer *peer;

    if (*size < RTP_HEADER || *size > SECURE_PACKET_MAX)
        return -EINVAL;
    int error = sending(secure, &secure->out, get32(packet + RTP_SSRC), &peer);
    if (error)
        return error;
    uint16_t sequence = get16(packet + 2);
    uint64_t index = estimate(peer->index, sequence);
    if (sequence % ROLLOVER_EVERY == 0)
        *size = rollover_put(packet, *size, (uint32_t)(index >> 16));
    int length = (int)*size;
    srtp_err_status_t status = srtp_protect(peer->session, packet, &length);
    if (status)
        return error_of(status, -EINVAL);
    used(&secure->out, peer, index);
    *size = (size_t)length;
    return 0;
}

int secure_protect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    struct peer *peer;

    if (*size < RTCP_HEADER || *size > SECURE_PACKET_MAX)
        return -EINVAL;
    int error = sending(secure, &secure->reports_out, get32(packet + RTCP_SSRC), &peer), length = (int)*size;
    if (error)
        return error;
    srtp_err_status_t status = srtp_protect_rtcp(peer->session, packet, &length);
    if (status)
        return error_of(status, -EINVAL);
    *size = (size_t)length;
    return 0;
}

static srtp_err_status_t apply(struct incoming *packet, srtp_t session) {
    int length = (int)packet->size;
    srtp_err_status_t status = packet->unprotect(session, packet->data, &length);

    if (!status)
        packet->size = (size_t)length;
    return status;
}

/* Whether a refused packet of a known source may be genuine, by its counter. */
static bool leads_forward(const struct incoming *packet, const struct peer *peer) {
    uint64_t index = (uint64_t)packet->counter << 16 | packet->sequence;

    return packet->has_counter && index > peer->index && index != estimate(peer->index, packet->sequence);
}

/* Tries the packet with a new state. If it is genuine, keeps the state, instead of `peer` if there is one. */
static srtp_err_status_t introduce(struct secure *secure, struct side *side, struct incoming *packet,
                                   struct peer *peer) {
    srtp_t session = session_of(secure, packet->ssrc, packet->counter);
    srtp_err_status_t status = session ? apply(packet, session) : srtp_err_status_alloc_fail;

    if (status) {
        if (session)
            srtp_dealloc(session);
        return status;
    }
    if (!peer)
        peer = oldest(side);
    if (peer->session)
        srtp_dealloc(peer->session);
    *peer = (struct peer){.ssrc = packet->ssrc, .session = session};
    used(side, peer, (uint64_t)packet->counter << 16 | packet->sequence);
    return status;
}

static srtp_err_status_t receive(struct secure *secure, struct side *side, struct incoming *packet) {
    struct peer *peer = find_peer(side, packet->ssrc);

    if (!peer)
        return introduce(secure, side, packet, NULL);
    srtp_err_status_t status = apply(packet, peer->session);
    if (!status)
        used(side, peer, estimate(peer->index, packet->sequence));
    else if (leads_forward(packet, peer))
        status = introduce(secure, side, packet, peer);
    return status;
}

static int counted(struct secure_count *count, srtp_err_status_t status) {
    int error = status ? error_of(status, -EBADMSG) : 0;

    if (!error)
        count->good++;
    else if (error == -EALREADY)
        count->repeated++;
    else
        count->refused++;
    return error;
}

int secure_unprotect(struct secure *secure, uint8_t *packet, size_t *size) {
    struct side *side = &secure->in;
    struct incoming incoming = {.data = packet, .size = *size, .unprotect = srtp_unprotect};

    if (*size < RTP_HEADER || *size > SECURE_PACKET_MAX)
        return counted(&side->count, srtp_err_status_parse_err);
    incoming.ssrc = get32(packet + RTP_SSRC);
    incoming.sequence = get16(packet + 2);
    incoming.has_counter = rollover_get(packet, *size, &incoming.counter);
    int error = counted(&side->count, receive(secure, side, &incoming));
    if (!error)
        *size = rollover_take(packet, incoming.size);
    return error;
}

int secure_unprotect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    struct side *side = &secure->reports_in;
    struct incoming incoming = {.data = packet, .size = *size, .unprotect = srtp_unprotect_rtcp};

    if (*size < RTCP_HEADER || *size > SECURE_PACKET_MAX)
        return counted(&side->count, srtp_err_status_parse_err);
    incoming.ssrc = get32(packet + RTCP_SSRC);
    int error = counted(&side->count, receive(secure, side, &incoming));
    if (!error)
        *size = incoming.size;
    return error;
}

const struct secure_count *secure_received(const struct secure *secure) {
    return &secure->in.count;
}

const struct secure_count *secure_received_reports(const struct secure *secure) {
    return &secure->reports_in.count;
}

size_t secure_sdp(const struct secure *secure, char *text) {
    char key[KEY_FILE_TEXT + 1];

    key_file_text(secure->key, key);
    int length =
        snprintf(text, SECURE_SDP_MAX,
                 "a=crypto:1 AES_CM_128_HMAC_SHA1_80 inline:%s\r\na=extmap:%d " ROLLOVER_URI "\r\n", key, ROLLOVER_ID);
    explicit_bzero(key, sizeof key);
    return (size_t)length;
}

#else

/* No key can be read, so the other functions are never called with one. */
struct secure *secure_open(const char *path, char *error) {
    snprintf(error, KEY_FILE_ERROR_MAX, "%.200s: this build has no encryption, because libsrtp2 was missing", path);
    return NULL;
}

void secure_close(struct secure *secure) {
    (void)secure;
}

int secure_protect(struct secure *secure, uint8_t *packet, size_t *size) {
    (void)secure, (void)packet, (void)size;
    return -EINVAL;
}

int secure_protect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    return secure_protect(secure, packet, size);
}

int secure_unprotect(struct secure *secure, uint8_t *packet, size_t *size) {
    (void)secure, (void)packet, (void)size;
    return -EBADMSG;
}

int secure_unprotect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    return secure_unprotect(secure, packet, size);
}

const struct secure_count *secure_received(const struct secure *secure) {
    static const struct secure_count none;

    (void)secure;
    return &none;
}

const struct secure_count *secure_received_reports(const struct secure *secure) {
    return secure_received(secure);
}

size_t secure_sdp(const struct secure *secure, char *text) {
    (void)secure;
    *text = 0;
    return 0;
}

#endif
