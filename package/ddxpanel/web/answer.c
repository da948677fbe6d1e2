/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "answer.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "clock.h"
#include "guard.h"
#include "scgi.h"

#define COOKIE "__Host-panel"
#define TEXT "text/plain; charset=utf-8"
#define JSON "application/json; charset=utf-8"
#define COOKIE_RULES "; Path=/; Secure; HttpOnly; SameSite=Strict"

static const struct {
    unsigned status;
    const char *text;
} reasons[] = {{200, "OK"},
               {204, "No Content"},
               {206, "Partial Content"},
               {301, "Moved Permanently"},
               {400, "Bad Request"},
               {401, "Unauthorized"},
               {403, "Forbidden"},
               {404, "Not Found"},
               {405, "Not Allowed"},
               {413, "Content Too Large"},
               {416, "Range Not Satisfiable"},
               {429, "Too Many Requests"}};

static const char *reason(unsigned status) {
    for (size_t i = 0; i < sizeof reasons / sizeof reasons[0]; i++)
        if (reasons[i].status == status)
            return reasons[i].text;
    return "Conflict";
}

/* The texts are short; what does not fit is cut off. */
__attribute__((format(printf, 2, 3))) static void add(struct answer *answer, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    int length = vsnprintf(answer->text + answer->size, sizeof answer->text - answer->size, format, arguments);
    va_end(arguments);
    size_t room = sizeof answer->text - answer->size;
    if (length > 0)
        answer->size += (size_t)length < room ? (size_t)length : room - 1;
}

static void begin(struct answer *answer, unsigned status, const char *type) {
    answer->size = 0;
    answer->order = -1;
    answer->is_picture = answer->is_download = false;
    add(answer, "Status: %u %s\r\nContent-Type: %s\r\nCache-Control: no-store\r\n", status, reason(status), type);
}

void answer_refuse(struct answer *answer, unsigned status, const char *text) {
    begin(answer, status, TEXT);
    add(answer, "\r\n%s\n", text);
}

static unsigned session_of(const struct visitors *visitors, const struct scgi *request) {
    const char *cookies = scgi_value(request, "HTTP_COOKIE");
    size_t size = 0;
    const char *value = cookies ? scgi_cookie(cookies, COOKIE, &size) : NULL;

    return value ? session_find(&visitors->sessions, clock_ms() / 1000, value, size) : 0;
}

/* Fill in the address; false: it has none. */
static bool from(struct message_request *message, const struct scgi *request) {
    const char *address = scgi_value(request, "REMOTE_ADDR");

    if (!address || strlen(address) >= sizeof message->address)
        return false;
    strcpy(message->address, address);
    return true;
}

static int ask(const struct visitors *visitors, const struct message_request *message, struct message_answer *got,
               int *fd) {
    size_t size = offsetof(struct message_request, text) + message->size;

    if (send(visitors->root, message, size, MSG_NOSIGNAL) < 0)
        return -errno;
    return message_receive(visitors->root, got, fd);
}

static int log_in(struct visitors *visitors, const struct scgi *request, struct answer *answer) {
    struct message_request message = {.kind = MESSAGE_LOGIN, .size = (uint32_t)request->body_size + 1};
    struct message_answer got;
    char secret[SECRET_TEXT + 1];
    int none;

    if (!request->body_size || request->body_size >= sizeof message.text ||
        memchr(request->body, 0, request->body_size) || !from(&message, request)) {
        answer_refuse(answer, 400, "not a passphrase");
        return 0;
    }
    memcpy(message.text, request->body, request->body_size);
    int error = ask(visitors, &message, &got, &none);
    explicit_bzero(&message, sizeof message);
    if (error)
        return error;
    begin(answer, got.status, JSON);
    if (got.status == 200) {
        if (session_begin(&visitors->sessions, clock_ms() / 1000, secret) < 0)
            return -EIO;
        add(answer, "Set-Cookie: " COOKIE "=%s; Max-Age=%d" COOKIE_RULES "\r\n", secret, SESSION_SECONDS);
        explicit_bzero(secret, sizeof secret);
    }
    add(answer, "\r\n{\"wait\":%u}\n", got.wait);
    return 0;
}

/* `text`: the words of an order, one a line. */
static int order(struct visitors *visitors, const struct scgi *request, unsigned session, const char *text, size_t size,
                 struct answer *answer) {
    struct message_request message = {.kind = MESSAGE_ORDER, .session = session};
    struct message_answer got;
    struct words words;
    int output;

    if (words_split(&words, text, size) || !from(&message, request)) {
        answer_refuse(answer, 400, "not words of an order");
        return 0;
    }
    message.size = (uint32_t)words.size;
    memcpy(message.text, words.text, words.size);
    int error = ask(visitors, &message, &got, &output);
    if (error)
        return error;
    if (got.status != 200) {
        got.reason[sizeof got.reason - 1] = 0;
        answer_refuse(answer, got.status, got.reason);
        return 0;
    }
    begin(answer, 200, TEXT);
    add(answer, "\r\n");
    answer->order = output;
    return 0;
}

/* The order's output begins with the size of the file, which belongs into the headers: they follow with it. */
static int download(struct visitors *visitors, const struct scgi *request, unsigned session, const char *text,
                    struct answer *answer) {
    const char *range = scgi_value(request, "HTTP_RANGE"), *if_range = scgi_value(request, "HTTP_IF_RANGE");
    char words[DOWNLOAD_NAME + 64];
    struct download wanted;

    if (!download_parse(&wanted, text, range, if_range)) {
        answer_refuse(answer, 400, "not a file");
        return 0;
    }
    int size = snprintf(words, sizeof words, "recordings\nread\n%s\n%" PRIu64, wanted.name, wanted.first);
    int error = order(visitors, request, session, words, (size_t)size, answer);
    if (!error && answer->order >= 0) {
        answer->size = 0;
        answer->is_download = true;
        answer->download = wanted;
    }
    return error;
}

bool answer_download(struct answer *answer, uint64_t size) {
    struct download *wanted = &answer->download;
    int order = answer->order;
    bool good = download_limit(wanted, size);
    unsigned status = !good ? 416 : wanted->is_part ? 206 : 200;

    if (!good) {
        begin(answer, status, TEXT);
        add(answer, "Content-Range: bytes */%" PRIu64 "\r\n\r\nthe file ends before\n", size);
    } else {
        begin(answer, status, strstr(wanted->name, ".mp4") ? "video/mp4" : "application/octet-stream");
        /* Otherwise lighttpd keeps the connection after a file that is cut off, and the browser waits for the rest. */
        add(answer, "Connection: close\r\n");
        add(answer, "Content-Length: %" PRIu64 "\r\nAccept-Ranges: bytes\r\nETag: \"%s\"\r\n",
            wanted->last + 1 - wanted->first, wanted->name);
        add(answer, "Content-Disposition: attachment; filename=\"%s\"\r\n", wanted->name);
        if (wanted->is_part)
            add(answer, "Content-Range: bytes %" PRIu64 "-%" PRIu64 "/%" PRIu64 "\r\n", wanted->first, wanted->last,
                size);
        add(answer, "\r\n");
    }
    answer->order = order;
    answer->is_download = true;
    return good;
}

static void log_out(struct visitors *visitors, unsigned session, struct answer *answer) {
    session_end(&visitors->sessions, session);
    begin(answer, 200, JSON);
    add(answer, "Set-Cookie: " COOKIE "=; Max-Age=0" COOKIE_RULES "\r\n\r\n{}\n");
}

/* Plain HTTP leads to TLS, and does nothing else. */
static void lead_to_tls(const struct scgi *request, struct answer *answer) {
    const char *host = scgi_value(request, "HTTP_HOST");
    int length = (int)(*host == '[' ? strcspn(host, "]") + 1 : strcspn(host, ":"));

    begin(answer, 301, TEXT);
    add(answer, "Location: https://%.*s/\r\n\r\n", length, host);
}

void answer_picture(struct answer *answer, const struct picture_said *said, int64_t waited) {
    if (said->kind == PICTURE_NOTHING) {
        answer->size = 0;
        answer->is_picture = answer->is_download = false;
        add(answer, "Status: 204 %s\r\nCache-Control: no-store\r\n", reason(204));
    } else {
        begin(answer, 200, "image/jpeg");
        add(answer, "Content-Length: %zu\r\nX-Sequence: %" PRIu64 "\r\nX-Frame: %" PRId64 "\r\n", said->size,
            said->sequence, said->frame);
        add(answer, "X-Age: %" PRId64 "\r\nX-Lost: %" PRId64 "\r\n", said->age / 1000, said->lost);
    }
    add(answer, "X-Waited: %" PRId64 "\r\n\r\n", waited);
}

/* Only noted here. The part that serves visitors waits for the item's process. */
static void picture(const char *text, struct answer *answer) {
    if (!picture_parse(&answer->wanted, text)) {
        answer_refuse(answer, 400, "not a picture");
        return;
    }
    answer->size = 0;
    answer->is_picture = true;
}

enum path { PATH_LOGIN, PATH_LOGOUT, PATH_ORDER, PATH_SESSION, PATH_PICTURE, PATH_RECORDING, PATHS };

/* The path of an address; for a picture or a recording, *rest is what follows. PATHS: there is no such one. */
static enum path find_path(const char *wanted, const char **rest) {
    static const char *const paths[PATHS] = {"/panel/login",   "/panel/logout",   "/panel/order",
                                             "/panel/session", "/panel/picture/", "/panel/recording/"};
    enum path path = 0;

    while (path < PATHS) {
        size_t length = strlen(paths[path]);

        *rest = wanted + length;
        if (!strncmp(wanted, paths[path], length) && (path >= PATH_PICTURE || !**rest))
            break;
        path++;
    }
    return path;
}

int answer_request(struct visitors *visitors, const struct scgi *request, struct answer *answer) {
    const char *wanted = scgi_value(request, "REQUEST_URI"), *rest = "";
    char hostname[256] = "";
    enum path path = wanted ? find_path(wanted, &rest) : PATHS;

    gethostname(hostname, sizeof hostname - 1);
    const char *port = scgi_value(request, "SERVER_PORT"), *host = scgi_value(request, "HTTP_HOST");
    if (port && !strcmp(port, "80") && host && guard_host(host, hostname)) {
        lead_to_tls(request, answer);
        return 0;
    }
    unsigned refused = guard_request(request, hostname, path < PATH_SESSION || path == PATHS);
    if (refused || path == PATHS) {
        answer_refuse(answer, refused ? refused : 404, refused == 403 ? "not from this page" : "there is no such page");
        return 0;
    }
    if (path == PATH_LOGIN)
        return log_in(visitors, request, answer);
    unsigned session = session_of(visitors, request);
    if (!session) {
        answer_refuse(answer, 401, "log in first");
        return 0;
    }
    if (path == PATH_ORDER)
        return order(visitors, request, session, request->body, request->body_size, answer);
    if (path == PATH_RECORDING)
        return download(visitors, request, session, rest, answer);
    if (path == PATH_LOGOUT) {
        log_out(visitors, session, answer);
        return 0;
    }
    if (path == PATH_PICTURE) {
        picture(rest, answer);
        return 0;
    }
    begin(answer, 200, TEXT);
    const char *address = scgi_value(request, "REMOTE_ADDR");
    add(answer, "\r\n%s\n%s\n", hostname, address ? address : "");
    return 0;
}
