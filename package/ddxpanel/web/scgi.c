/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "scgi.h"

#include <errno.h>
#include <string.h>

/* A number without sign or leading zeros, of at most eight digits. The end of its digits; NULL: not a number. */
static const char *number(const char *text, const char *end, size_t *value) {
    const char *at = text;

    for (*value = 0; at < end && *at >= '0' && *at <= '9'; at++) {
        if (at - text == 8 || (at > text && *text == '0'))
            return NULL;
        *value = *value * 10 + (size_t)(*at - '0');
    }
    return at > text ? at : NULL;
}

/* Whether all headers are names and values without control characters, no name twice, and the two of SCGI are there. */
static bool is_good(const struct scgi *request) {
    const char *end = request->head + request->head_size;
    bool name = true;

    if (!request->head_size || end[-1])
        return false;
    for (const char *at = request->head; at < end; at += strlen(at) + 1, name = !name) {
        if (name && (!*at || scgi_value(request, at) != at + strlen(at) + 1))
            return false;
        for (const char *byte = at; *byte; byte++)
            if ((unsigned char)*byte < ' ' || *byte == 0x7f)
                return false;
    }
    const char *version = name ? scgi_value(request, "SCGI") : NULL;
    return version && !strcmp(version, "1") && !strcmp(request->head, "CONTENT_LENGTH");
}

int scgi_parse(const char *bytes, size_t size, struct scgi *request) {
    const char *end = bytes + size;
    const char *colon = size ? number(bytes, end, &request->head_size) : NULL;

    *request = (struct scgi){.head_size = colon ? request->head_size : 0};
    if (!size)
        return 0;
    if (!colon || request->head_size > SCGI_HEAD_MAX || (colon < end && *colon != ':'))
        return -EBADMSG;
    if (colon == end || (size_t)(end - colon) < request->head_size + 2)
        return 0;
    request->head = colon + 1;
    request->body = request->head + request->head_size + 1;
    if (request->body[-1] != ',' || !is_good(request))
        return -EBADMSG;
    const char *length = scgi_value(request, "CONTENT_LENGTH");
    const char *digits = number(length, length + strlen(length), &request->body_size);
    if (!digits || *digits)
        return -EBADMSG;
    if (request->body_size > SCGI_BODY_MAX)
        return -EMSGSIZE;
    return (size_t)(end - request->body) >= request->body_size;
}

const char *scgi_value(const struct scgi *request, const char *name) {
    const char *end = request->head + request->head_size;

    for (const char *at = request->head; at < end;) {
        const char *value = at + strlen(at) + 1;

        if (value >= end)
            return NULL; /* a name without a value */
        if (!strcmp(at, name))
            return value;
        at = value + strlen(value) + 1;
    }
    return NULL;
}

const char *scgi_cookie(const char *cookies, const char *name, size_t *size) {
    const char *found = NULL;
    size_t length = strlen(name);

    for (const char *at = cookies; *at;) {
        size_t part = strcspn(at, ";");

        if (part > length && !strncmp(at, name, length) && at[length] == '=') {
            if (found)
                return NULL;
            found = at + length + 1;
            *size = part - length - 1;
        }
        at += part;
        at += strspn(at, "; ");
    }
    return found;
}

int words_split(struct words *words, const char *text, size_t size) {
    *words = (struct words){.count = 0};
    for (const char *end = text + size, *next; text < end; text = next) {
        const char *feed = memchr(text, '\n', (size_t)(end - text));
        size_t length = (size_t)((feed ? feed : end) - text);

        next = feed ? feed + 1 : end;
        if (!length)
            return -EINVAL;
        for (size_t i = 0; i < length; i++)
            if (text[i] < ' ' || text[i] > '~')
                return -EINVAL;
        if (words->count == WORDS_MAX || length >= WORDS_SIZE - words->size)
            return -E2BIG;
        words->word[words->count++] = memcpy(words->text + words->size, text, length);
        words->size += length + 1;
    }
    return words->count ? 0 : -EINVAL;
}

/* The value of a hexadecimal digit; -1: it is none. */
static int digit(char c) {
    static const char digits[] = "0123456789abcdef0123456789ABCDEF";
    const char *at = c ? strchr(digits, c) : NULL;

    return at ? (int)(at - digits) % 16 : -1;
}

bool name_parse(char *name, size_t room, const char *text, size_t size) {
    size_t length = 0;

    for (const char *at = text; at < text + size; at++) {
        int c = (unsigned char)*at;

        if (c == '%') {
            int high = at + 2 < text + size ? digit(at[1]) : -1, low = high < 0 ? -1 : digit(at[2]);
            if (low < 0)
                return false;
            c = 16 * high + low;
            at += 2;
        }
        if (c <= ' ' || c > '~' || c == '/' || length + 1 >= room)
            return false;
        name[length++] = (char)c;
    }
    name[length] = 0;
    return length > 0;
}
