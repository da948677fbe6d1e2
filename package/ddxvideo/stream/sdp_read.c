/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sdp_read.h"

#include <stdio.h>
#include <string.h>

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
