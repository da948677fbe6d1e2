/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: a request to the panel. The input is what lighttpd sends (SCGI); its body are the words of an order,
 * which the root process looks up. It is also what a web process that was taken over sends to the root process.
 */
#include "scgi.h"

#include <assert.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "download.h"
#include "guard.h"
#include "message.h"
#include "order.h"
#include "picture.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static struct sessions sessions;

/* Exactly the bytes so far, so that the sanitizer sees each one that is read beyond them. */
static int parse_part(const char *bytes, size_t size) {
    struct scgi request;
    char *part = malloc(size + !size);
    assert(part);
    memcpy(part, bytes, size);
    int result = scgi_parse(part, size, &request);
    free(part);
    return result;
}

/* Only a request of the own page gets through. */
static void check_guard(const struct scgi *request) {
    const char *host = scgi_value(request, "HTTP_HOST"), *origin = scgi_value(request, "HTTP_ORIGIN");
    bool read = !guard_request(request, "robot1", false);
    if (!guard_request(request, "robot1", true))
        assert(!read && host && origin && strlen(origin) == strlen("https://") + strlen(host));
    if (host && guard_host(host, "robot1")) /* nothing that a browser would take for another machine */
        assert(!strpbrk(host, "/@\\?# ") && !strstr(host, "evil"));
}

static void check_cookie(const char *cookies) {
    size_t size = 0;
    const char *value = cookies ? scgi_cookie(cookies, "__Host-panel", &size) : NULL;
    if (!value)
        return;
    assert(value > cookies && value + size <= cookies + strlen(cookies) && !memchr(value, ';', size));
    assert(!session_find(&sessions, 1, value, size)); /* 128 random bits are not guessed */
}

static void check_order(const struct scgi *request) {
    const char *command[ORDER_WORDS], *reason;
    struct words words;
    if (words_split(&words, request->body, request->body_size))
        return;
    assert(words.count && words.count <= WORDS_MAX && !words.word[words.count]);
    const struct order *order = order_find(words.word, command, &reason);
    assert(!order == !!reason);
    if (!order)
        return;
    unsigned count = 0;
    while (command[count])
        count++;
    assert(count && count < ORDER_WORDS && *command[0] == '/');
    for (unsigned i = 0; i < words.count; i++) /* a visitor's word is never an option, a path or more than one word */
        assert(*words.word[i] != '-' && !strpbrk(words.word[i], "/ ;$`'\"\\*?"));
}

static void check_picture(const char *address) {
    static const char path[] = "/panel/picture/";
    struct picture_wanted wanted;
    struct picture_said said;
    if (!address)
        return;
    if (picture_hear(&said, address))
        assert(said.kind != PICTURE_NEW || (said.sequence && said.size && said.size <= PICTURE_MAX));
    if (strncmp(address, path, strlen(path)) || !picture_parse(&wanted, address + strlen(path)))
        return;
    assert(*wanted.item && strlen(wanted.item) <= PICTURE_ITEM && !strpbrk(wanted.item, " /\n"));
    assert(wanted.form.quality >= PICTURE_BEST && wanted.form.quality <= PICTURE_SMALLEST);
    assert(wanted.form.divisor == 1 || wanted.form.divisor == 2);
}

static void check_file(const struct scgi *request, const char *address) {
    static const char path[] = "/panel/recording/";
    struct download wanted;
    uint64_t size;
    if (!address || strncmp(address, path, strlen(path)) ||
        !download_parse(&wanted, address + strlen(path), scgi_value(request, "HTTP_RANGE"),
                        scgi_value(request, "HTTP_IF_RANGE")))
        return;
    assert(*wanted.name && strlen(wanted.name) <= DOWNLOAD_NAME && !strpbrk(wanted.name, " /\r\n"));
    assert(wanted.first <= wanted.last);
    if (download_hear(&size, request->body, request->body_size) && download_limit(&wanted, size))
        assert(!size || (wanted.first <= wanted.last && wanted.last < size));
}

static void check_message(const uint8_t *data, size_t size) {
    struct message_request *request = calloc(1, size < sizeof *request ? sizeof *request : size);
    const char *words[MESSAGE_WORDS + 1], *command[ORDER_WORDS], *reason;
    assert(request);
    memcpy(request, data, size);
    if (message_is_good(request, size)) {
        assert(strlen(request->address) < sizeof request->address && strlen(request->text) < request->size);
        if (message_words(request, words))
            order_find(words, command, &reason);
    }
    free(request);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static char text[SECRET_TEXT + 1];
    const char *bytes = (const char *)data;
    struct scgi request;
    if (!*text)
        assert(session_begin(&sessions, 0, text) > 0);
    check_message(data, size);
    int result = scgi_parse(bytes, size, &request);
    if (size && result != 1)
        assert(parse_part(bytes, size - 1) == result || !parse_part(bytes, size - 1));
    if (result != 1)
        return 0;
    assert(request.body + request.body_size <= bytes + size && request.body_size <= SCGI_BODY_MAX);
    assert(!parse_part(bytes, (size_t)(request.body - bytes) + request.body_size - 1));
    assert(parse_part(bytes, (size_t)(request.body - bytes) + request.body_size) == 1);
    assert(scgi_value(&request, "SCGI") && scgi_value(&request, "CONTENT_LENGTH"));
    check_guard(&request);
    check_cookie(scgi_value(&request, "HTTP_COOKIE"));
    check_order(&request);
    check_picture(scgi_value(&request, "REQUEST_URI"));
    check_file(&request, scgi_value(&request, "REQUEST_URI"));
    return 0;
}
