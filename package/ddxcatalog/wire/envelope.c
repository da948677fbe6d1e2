/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "envelope.h"

#include <ddx_time.h>
#include <endian.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FIXED 12 /* stamp, length of the name */

static const char before[] = "std_msgs/Header header\nuint64 sequence\nint64 monotonic_ns\n";
static const char contained[] = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
                                "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

static size_t aligned(size_t size) {
    return (size + 7) & ~(size_t)7;
}

size_t envelope_size(const char *machine) {
    return FORM_HEADER + aligned(FIXED + strlen(machine) + 1) + 2 * sizeof(uint64_t);
}

static void put(unsigned char **at, uint64_t number, size_t bytes) {
    uint64_t little = htole64(number);

    memcpy(*at, &little, bytes);
    *at += bytes;
}

static uint64_t get(const unsigned char *at, size_t bytes) {
    uint64_t little = 0;

    memcpy(&little, at, bytes);
    return le64toh(little);
}

unsigned char *envelope_write(const struct envelope *envelope, unsigned char *message) {
    static const unsigned char header[FORM_HEADER] = {0, 1, 0, 0}; /* CDR, little endian */
    size_t length = strlen(envelope->machine) + 1;
    unsigned char *at = message + FORM_HEADER;

    memcpy(message, header, sizeof header);
    put(&at, (uint64_t)(envelope->wall / SECOND), 4);
    put(&at, (uint64_t)(envelope->wall % SECOND), 4);
    put(&at, length, 4);
    memset(at, 0, aligned(FIXED + length) - FIXED);
    memcpy(at, envelope->machine, length);
    at = message + FORM_HEADER + aligned(FIXED + length);
    put(&at, envelope->sequence, 8);
    put(&at, (uint64_t)envelope->monotonic, 8);
    return at;
}

const unsigned char *envelope_read(const struct form *form, const unsigned char *message, size_t size,
                                   struct envelope *envelope) {
    size_t fields = form->message_size - FORM_HEADER;

    if (size < FORM_HEADER + FIXED || message[0] || message[1] != 1)
        return NULL;
    const unsigned char *at = message + FORM_HEADER;
    size_t length = (size_t)get(at + 8, 4);
    if (length > size)
        return NULL;
    size_t begin = aligned(FIXED + length) + 2 * sizeof(uint64_t);
    size_t needed = FORM_HEADER + begin + fields;
    if (size < needed || size > ((needed + 3) & ~(size_t)3)) /* DDS pads messages to four bytes */
        return NULL;
    envelope->wall = (int64_t)(int32_t)get(at, 4) * SECOND + (int64_t)get(at + 4, 4);
    envelope->sequence = get(at + begin - 16, 8);
    envelope->monotonic = (int64_t)get(at + begin - 8, 8);
    return at + begin;
}

int envelope_describe(const struct form *form, struct description **description) {
    char *text;

    if (asprintf(&text, "%s%s%s", before, form->schema, contained) < 0)
        return -ENOMEM;
    int error = description_parse(form->schema_name, text, description);
    free(text);
    return error;
}
