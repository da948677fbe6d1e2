/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sdp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <libavutil/base64.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "bits.h"
#include "payload.h"

/* ---- Write a description ---- */

#define PARAMETERS_MAX 200 /* bytes of a parameter set or a header that goes into the file */

struct text {
    char *data;
    size_t length;
};

__attribute__((format(printf, 2, 3))) static void add(struct text *text, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    int length = vsnprintf(text->data + text->length, SDP_MAX - text->length, format, arguments);
    va_end(arguments);
    text->length += (size_t)length;
    if (text->length >= SDP_MAX)
        text->length = SDP_MAX - 1;
}

static void add_base64(struct text *text, const struct h264_nal *nal) {
    char digits[AV_BASE64_SIZE(PARAMETERS_MAX)];

    add(text, "%s", av_base64_encode(digits, sizeof digits, nal->data, (int)nal->size));
}

/* RFC 6184, 8.1 */
static bool add_h264(struct text *text, const struct sdp *sdp) {
    struct h264_nal nal, sps = {0}, pps = {0};

    for (const uint8_t *at = sdp->frame; h264_next_nal(&at, sdp->frame + sdp->size, &nal);) {
        if ((nal.data[0] & 31) == H264_SPS)
            sps = nal;
        else if ((nal.data[0] & 31) == H264_PPS)
            pps = nal;
    }
    if (sps.size < 4 || sps.size > PARAMETERS_MAX || !pps.size || pps.size > PARAMETERS_MAX)
        return false;
    add(text, "a=rtpmap:%d H264/%d\r\n", sdp->type, RTP_CLOCK);
    add(text, "a=fmtp:%d packetization-mode=1;profile-level-id=%02X%02X%02X;sprop-parameter-sets=", sdp->type,
        sps.data[1], sps.data[2], sps.data[3]);
    add_base64(text, &sps);
    add(text, ",");
    add_base64(text, &pps);
    add(text, "\r\n");
    return true;
}

/* RFC 6416, 7.1: everything before the first picture. */
static bool add_mpeg4(struct text *text, const struct sdp *sdp) {
    size_t size = mpeg4_headers(sdp->frame, sdp->size);

    if (!size || size > PARAMETERS_MAX)
        return false;
    add(text, "a=rtpmap:%d MP4V-ES/%d\r\na=fmtp:%d profile-level-id=1;config=", sdp->type, RTP_CLOCK, sdp->type);
    for (size_t i = 0; i < size; i++)
        add(text, "%02X", sdp->frame[i]);
    add(text, "\r\n");
    return true;
}

static bool add_codec(struct text *text, const struct sdp *sdp) {
    if (sdp->type != RTP_TS)
        return sdp->type == RTP_H264 ? add_h264(text, sdp) : add_mpeg4(text, sdp);
    add(text, "a=rtpmap:%d MP2T/%d\r\n", sdp->type, RTP_CLOCK);
    return true;
}

size_t sdp_write(const struct sdp *sdp, char *data) {
    struct text text = {data, 0};
    bool ipv6 = network_is_ipv6(&sdp->address);
    char host[NETWORK_TEXT_MAX];

    add(&text, "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=%.100s\r\nc=IN %s %s", sdp->name, ipv6 ? "IP6" : "IP4",
        network_host(&sdp->address, host));
    if (network_is_group(&sdp->address) && !ipv6) /* RFC 4566, 5.7: a TTL for IPv4 only */
        add(&text, "/%d", sdp->ttl);
    add(&text, "\r\nt=0 0\r\nm=video %u RTP/%s %d\r\n", network_port(&sdp->address), sdp->crypto ? "SAVP" : "AVP",
        sdp->type);
    if (!add_codec(&text, sdp))
        return 0;
    if (sdp->rate > 0)
        add(&text, "a=framerate:%.3f\r\n", sdp->rate);
    if (sdp->type != RTP_TS)
        add(&text,
            "a=extmap:1 " RTP_CAPTURE_URI "\r\na=extmap:2 " RTP_FRAME_URI "\r\na=extmap:3 " RTP_SOURCE_URI "\r\n");
    if (sdp->crypto)
        add(&text, "%s", sdp->crypto);
    add(&text, "a=recvonly\r\n");
    return text.length;
}

/* A new file. If the description has a key, only its user can read the file, from its creation on. */
static FILE *create(const char *path, bool secret) {
    if (unlink(path) && errno != ENOENT)
        return NULL;
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, secret ? 0600 : 0666);
    FILE *file = fd < 0 ? NULL : fdopen(fd, "w");

    if (fd >= 0 && !file)
        close(fd);
    return file;
}

int sdp_save(const struct sdp *sdp, const char *path) {
    char text[SDP_MAX], fresh[PATH_MAX];
    size_t length = sdp_write(sdp, text);

    if (!length)
        return -EBADMSG;
    if (snprintf(fresh, sizeof fresh, "%s.new", path) >= (int)sizeof fresh)
        return -ENAMETOOLONG;
    FILE *file = create(fresh, sdp->crypto);
    if (!file)
        return -errno;
    bool written = fwrite(text, 1, length, file) == length;
    written = !fclose(file) && written;
    int error = written && !rename(fresh, path) ? 0 : -errno;
    if (error)
        unlink(fresh);
    return error;
}

/* ---- Read a description ---- */

#define LINE_ROOM 256 /* bytes of a line that are read */

/* Progress of the reading. */
struct reader {
    struct sdp_stream *stream;
    bool has_address, in_video, done; /* done: after the video stream's last line */
    int type;
    uint16_t port;
};

static void copy_printable(char *to, size_t room, const char *from) {
    size_t length = 0;

    for (; *from && length < room - 1; from++)
        to[length++] = *from >= ' ' && *from < 127 ? *from : '?';
    to[length] = 0;
}

/* "IN IP4 239.255.20.5/1" or "IN IP6 ff15::5" */
static bool take_connection(struct reader *reader, const char *value) {
    struct network_address *address = &reader->stream->address;
    char kind, host[48];

    return sscanf(value, "IN IP%c %47[^/ ]", &kind, host) == 2 && network_parse(host, 1, address) &&
           network_is_ipv6(address) == (kind == '6') && !*address->zone; /* another machine's interface */
}

/* The payload types that need no a=rtpmap, RFC 3551. */
static const char *static_codec(int type) {
    return type == 26 ? "JPEG" : type == 32 ? "MPV" : type == 33 ? "MPEG-TS" : "?";
}

/* "video 8000 RTP/AVP 96", or with a number of ports after the first one, "8000/2". */
static bool take_media(struct reader *reader, const char *value) {
    unsigned port;
    int type;

    if (sscanf(value, "video %5u %*15s %3d", &port, &type) != 2 &&
        sscanf(value, "video %5u/%*5u %*15s %3d", &port, &type) != 2)
        return false;
    if (!port || port > UINT16_MAX || type < 0 || type > 127)
        return false;
    reader->port = (uint16_t)port;
    reader->type = type;
    snprintf(reader->stream->codec, sizeof reader->stream->codec, "%s", static_codec(type));
    return true;
}

/* "rtpmap:96 H264/90000" */
static void take_attribute(struct reader *reader, const char *value) {
    char codec[sizeof reader->stream->codec];
    int type;

    if (sscanf(value, "rtpmap:%3d %15[^/ ]", &type, codec) == 2 && type == reader->type)
        copy_printable(reader->stream->codec, sizeof reader->stream->codec, codec);
}

/* A line "<kind>=<value>". */
static void take_line(struct reader *reader, char kind, const char *value) {
    if (kind == 'm') {
        reader->done = reader->in_video;
        reader->in_video = !reader->done && take_media(reader, value);
    } else if (kind == 's' && !reader->in_video) {
        copy_printable(reader->stream->name, sizeof reader->stream->name, value);
    } else if (kind == 'c' && (reader->in_video || !reader->port)) { /* not of another medium */
        reader->has_address = take_connection(reader, value);
    } else if (kind == 'a' && reader->in_video) {
        take_attribute(reader, value);
    }
}

/* Takes the next line without its end, cut to the buffer's size. Returns the rest of the text. */
static size_t next_line(const uint8_t *text, size_t size, char *line) {
    const uint8_t *end = memchr(text, '\n', size);
    size_t length = end ? (size_t)(end - text) : size, all = end ? length + 1 : length;

    if (length && text[length - 1] == '\r')
        length--;
    if (length >= LINE_ROOM)
        length = LINE_ROOM - 1;
    memcpy(line, text, length);
    line[length] = 0;
    return all;
}

bool sdp_read(const uint8_t *text, size_t size, struct sdp_stream *stream) {
    struct reader reader = {.stream = stream};

    *stream = (struct sdp_stream){0};
    while (size && !reader.done) {
        char line[LINE_ROOM];
        size_t taken = next_line(text, size, line);

        text += taken;
        size -= taken;
        if (*line && line[1] == '=')
            take_line(&reader, *line, line + 2);
    }
    if (!reader.port || !reader.has_address)
        return false;
    network_set_port(&stream->address, reader.port);
    return true;
}

/* ---- Announcements ---- */

#define VERSION_MASK 0xe0
#define VERSION 0x20
#define IPV6_ORIGIN 0x10
#define DELETION 0x04
#define ENCRYPTED 0x02
#define COMPRESSED 0x01
#define HEAD 4 /* bytes before the origin: flags, length of the authentication in words, hash */

static const char type[] = "application/sdp"; /* with its terminating zero in a message */

/* IPv4 groups by scope: RFC 2974, 3; RFC 2365 for the ranges. */
#define LINK 0xe0000000         /* 224.0.0.0/24 */
#define LOCAL 0xefff0000        /* 239.255.0.0/16 */
#define ORGANIZATION 0xefc00000 /* 239.192.0.0/14 */
#define SAP_LINK 0xe00000ff
#define SAP_LOCAL 0xefffffff
#define SAP_ORGANIZATION 0xefc3ffff
#define SAP_GLOBAL 0xe0027ffe /* 224.2.127.254 */

static const uint8_t *origin_bytes(const struct network_address *origin) {
    return network_is_ipv6(origin) ? origin->v6.sin6_addr.s6_addr : (const uint8_t *)&origin->v4.sin_addr;
}

size_t sap_write(const struct sap *sap, uint8_t *to) {
    size_t origin = network_is_ipv6(&sap->origin) ? 16 : 4;

    if (sap->size > SAP_MAX - HEAD - origin - sizeof type)
        return 0;
    uint8_t *at = to;
    *at++ = (uint8_t)(VERSION | (origin == 16 ? IPV6_ORIGIN : 0) | (sap->deletion ? DELETION : 0));
    *at++ = 0; /* no authentication */
    at = put16(at, sap->hash);
    memcpy(at, origin_bytes(&sap->origin), origin);
    memcpy(at + origin, type, sizeof type);
    at += origin + sizeof type;
    memcpy(at, sap->text, sap->size);
    return (size_t)(at - to) + sap->size;
}

static void take_origin(struct sap *sap, const uint8_t *data, size_t size) {
    sap->origin = (struct network_address){0};
    if (size == 16) {
        sap->origin.v6.sin6_family = AF_INET6;
        memcpy(&sap->origin.v6.sin6_addr, data, 16);
    } else {
        sap->origin.v4.sin_family = AF_INET;
        memcpy(&sap->origin.v4.sin_addr, data, 4);
    }
}

/* The type may be missing: then the text is SDP, and begins with its version. */
static bool skip_type(struct sap *sap) {
    static const char sdp[] = "v=0", origin_line[] = "o=";

    if (sap->size >= sizeof type && !memcmp(sap->text, type, sizeof type)) {
        sap->text += sizeof type;
        sap->size -= sizeof type;
        return true;
    }
    return (sap->size >= 3 && !memcmp(sap->text, sdp, 3)) ||
           (sap->deletion && (!sap->size || (sap->size >= 2 && !memcmp(sap->text, origin_line, 2))));
}

bool sap_parse(const uint8_t *data, size_t size, struct sap *sap) {
    if (size < HEAD || (data[0] & VERSION_MASK) != VERSION || data[0] & (ENCRYPTED | COMPRESSED))
        return false;
    size_t origin = data[0] & IPV6_ORIGIN ? 16 : 4, head = HEAD + origin + 4u * data[1];
    if (head > size)
        return false;
    sap->deletion = data[0] & DELETION;
    sap->hash = get16(data + 2);
    take_origin(sap, data + HEAD, origin);
    sap->text = data + head;
    sap->size = size - head;
    return !network_is_any(&sap->origin) && skip_type(sap) && (sap->deletion || sap->size) &&
           !memchr(sap->text, 0, sap->size);
}

uint16_t sap_hash(const uint8_t *text, size_t size) {
    uint32_t hash = 2166136261; /* FNV-1a */

    for (size_t i = 0; i < size; i++)
        hash = (hash ^ text[i]) * 16777619;
    hash = (hash >> 16 ^ hash) & UINT16_MAX;
    return hash ? (uint16_t)hash : 1;
}

void sap_group(const struct network_address *stream, struct network_address *group) {
    *group = (struct network_address){0};
    if (network_is_ipv6(stream)) { /* ff0X::2:7ffe, X the scope */
        struct in6_addr *to = &group->v6.sin6_addr;

        *group = *stream;
        *to = (struct in6_addr){.s6_addr = {0xff, stream->v6.sin6_addr.s6_addr[1] & 15, [13] = 2, 0x7f, 0xfe}};
    } else {
        uint32_t from = ntohl(stream->v4.sin_addr.s_addr);
        uint32_t to = (from & 0xffffff00) == LINK           ? SAP_LINK
                      : (from & 0xffff0000) == LOCAL        ? SAP_LOCAL
                      : (from & 0xfffc0000) == ORGANIZATION ? SAP_ORGANIZATION
                                                            : SAP_GLOBAL;

        group->v4.sin_family = AF_INET;
        group->v4.sin_addr.s_addr = htonl(to);
    }
    network_set_port(group, SAP_PORT);
}
