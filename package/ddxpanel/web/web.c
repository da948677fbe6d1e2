/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "web.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include "answer.h"
#include "clock.h"
#include "watch.h"

#define VISITS 32         /* requests at a time; further ones wait in the listener's queue */
#define PICTURES 16       /* of these, requests for pictures, so that orders always find a place */
#define PATIENCE 10000    /* ms for a whole request, and for taking a piece of the answer */
#define OUTAGE 70000      /* ms for taking a piece of a file; lighttpd gives the visitor 60 s */
#define SIGN_OF_LIFE 3000 /* ms */
#define END_TEXT 64       /* bytes of the line that follows the output of an order */

struct visit {
    int fd;        /* -1: free */
    int64_t until; /* then it is given up, unless it waits for output of its order */
    char *request; /* of SCGI_MAX bytes; NULL: it is complete */
    size_t got;    /* bytes of it */
    size_t sent;   /* bytes of the answer */
    bool mid_line; /* the output so far does not end with a line feed */
    struct answer answer;
    bool begun;              /* of a file, the size is known: */
    uint64_t left;           /* bytes of it that are still to come */
    int64_t since;           /* it waits for a picture, answer.is_picture */
    struct picture *picture; /* that follows the answer; NULL: none */
};

static void end(struct visit *visit) {
    free(visit->request);
    close(visit->fd);
    if (visit->answer.order >= 0)
        close(visit->answer.order);
    picture_drop(visit->picture);
    *visit = (struct visit){.fd = -1, .answer = {.order = -1}};
}

static void refuse(struct visit *visit, unsigned status, const char *reason) {
    answer_refuse(&visit->answer, status, reason);
}

/* False: the visit is over. */
static bool more_of_request(struct visit *visit, struct visitors *visitors, int *error) {
    struct scgi request;
    ssize_t got = read(visit->fd, visit->request + visit->got, SCGI_MAX - visit->got);

    if (got <= 0)
        return got < 0 && (errno == EAGAIN || errno == EINTR);
    visit->got += (size_t)got;
    int complete = scgi_parse(visit->request, visit->got, &request);
    if (!complete && visit->got < SCGI_MAX)
        return true;
    if (complete == 1)
        *error = answer_request(visitors, &request, &visit->answer);
    else
        refuse(visit, complete == -EMSGSIZE ? 413 : 400, "not a request");
    explicit_bzero(visit->request, visit->got); /* it may hold a passphrase */
    free(visit->request);
    visit->request = NULL;
    visit->until = clock_ms() + PATIENCE;
    return true;
}

static int64_t patience(const struct visit *visit) {
    return visit->answer.is_download ? OUTAGE : PATIENCE;
}

static bool more_of_answer(struct visit *visit) {
    struct picture *picture = visit->picture;
    size_t head = visit->answer.size, size = head + (picture ? picture->said.size : 0), done = visit->sent;
    struct iovec parts[2] = {{.iov_base = visit->answer.text + done, .iov_len = done < head ? head - done : 0}};
    const struct msghdr message = {.msg_iov = parts, .msg_iovlen = 2};

    if (picture) {
        size_t from = done > head ? done - head : 0;
        parts[1] = (struct iovec){.iov_base = picture->bytes + from, .iov_len = picture->said.size - from};
    }
    ssize_t sent = sendmsg(visit->fd, &message, MSG_NOSIGNAL);
    if (sent < 0)
        return errno == EAGAIN || errno == EINTR;
    visit->sent += (size_t)sent;
    visit->until = clock_ms() + patience(visit);
    if (visit->sent < size)
        return true;
    visit->sent = visit->answer.size = 0;
    return visit->answer.order >= 0;
}

static void stop_order(struct answer *answer) {
    close(answer->order);
    answer->order = -1;
}

/* The first output of an order that reads a file: headers, and what followed its size. */
static void begin_file(struct visit *visit, const char *bytes, size_t count) {
    struct answer *answer = &visit->answer;
    uint64_t size;
    size_t line = download_hear(&size, bytes, count);

    if (!line || !answer_download(answer, size)) {
        stop_order(answer);
        if (!line)
            refuse(visit, 404, "it cannot be read: it is not finished, or not there any more");
        return;
    }
    visit->begun = true;
    visit->left = answer->download.last + 1 - answer->download.first;
    count -= line;
    if (count > visit->left)
        count = (size_t)visit->left;
    memcpy(answer->text + answer->size, bytes + line, count);
    answer->size += count;
    visit->left -= count;
}

/*
 * `count`: bytes of output; 0: the order has ended. False: that was all. If it was not, closing the connection lets the
 * visitor's browser know, since it has the length.
 */
static bool more_of_file(struct visit *visit, const char *bytes, size_t count) {
    struct answer *answer = &visit->answer;

    if (!visit->begun) {
        begin_file(visit, bytes, count);
        return true;
    }
    if (!count || !visit->left)
        return false;
    answer->size = count < visit->left ? count : (size_t)visit->left;
    memcpy(answer->text, bytes, answer->size);
    visit->left -= answer->size;
    return true;
}

/* The last line of an answer is the panel's own: how the order ended. */
static void end_of_output(struct visit *visit, const struct message_end *how) {
    static const char *const ends[] = {"exited", "killed", "too long", "too much", "not wanted"};
    const char *word = how->end < sizeof ends / sizeof ends[0] ? ends[how->end] : "not started";

    visit->answer.size = (size_t)snprintf(visit->answer.text, END_TEXT, "%s{\"end\":\"%s\",\"status\":%d}\n",
                                          visit->mid_line ? "\n" : "", word, how->status);
    stop_order(&visit->answer);
}

/* Only called when all former output was sent. False: the visit is over. */
static bool more_of_output(struct visit *visit) {
    struct message_end how = {.end = MESSAGE_NOT_STARTED, .status = -1};
    struct answer *answer = &visit->answer;
    char packet[1 + MESSAGE_PIECE];
    ssize_t got = recv(answer->order, packet, sizeof packet, MSG_DONTWAIT);
    bool is_output = got > 1 && *packet == 'o';

    if (got < 0 && (errno == EAGAIN || errno == EINTR))
        return true;
    visit->until = clock_ms() + patience(visit);
    if (answer->is_download)
        return more_of_file(visit, packet + 1, is_output ? (size_t)got - 1 : 0);
    if (is_output) {
        answer->size = (size_t)got - 1;
        memcpy(answer->text, packet + 1, answer->size);
        visit->mid_line = answer->text[answer->size - 1] != '\n';
    } else {
        if (got == (ssize_t)sizeof how)
            memcpy(&how, packet, sizeof how);
        end_of_output(visit, &how);
    }
    return true;
}

static void begin(struct visit *visits, int listener) {
    int fd = accept4(listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

    for (struct visit *visit = visits; fd >= 0 && visit < visits + VISITS; visit++) {
        if (visit->fd >= 0)
            continue;
        visit->request = malloc(SCGI_MAX);
        if (!visit->request)
            break;
        visit->fd = fd;
        visit->until = clock_ms() + PATIENCE;
        return;
    }
    if (fd >= 0)
        close(fd);
}

/* Whether it waits for output of its order, however long that takes: the order has a limit of its own. */
static bool follows(const struct visit *visit) {
    return !visit->request && !visit->answer.size && visit->answer.order >= 0;
}

static bool waits_for_picture(const struct visit *visit) {
    return visit->fd >= 0 && !visit->request && visit->answer.is_picture;
}

static int serve_visit(struct visit *visit, struct visitors *visitors, short connection, short output) {
    int error = 0;
    bool goes_on = true;

    if (waits_for_picture(visit)) {
        if (connection) /* the visitor has gone */
            goes_on = false;
    } else if (follows(visit)) {
        if (connection) /* nothing more is expected from it: the visitor has gone */
            goes_on = false;
        else if (output)
            goes_on = more_of_output(visit);
    } else if (connection) {
        goes_on = visit->request ? more_of_request(visit, visitors, &error) : more_of_answer(visit);
    }
    if (!goes_on || (!follows(visit) && !waits_for_picture(visit) && clock_ms() >= visit->until))
        end(visit);
    return error;
}

/* ---- Pictures ---- */

static bool is_same(const struct picture_form *a, const struct picture_form *b) {
    return a->quality == b->quality && a->divisor == b->divisor;
}

/* A request for a picture has just been read: have its item watched. */
static void begin_to_watch(struct visit *visits, struct visit *visit, struct watch *watches) {
    const char *reason = "others are watching";
    unsigned count = 0;

    for (const struct visit *one = visits; one < visits + VISITS; one++)
        count += waits_for_picture(one) || (one->fd >= 0 && one->picture);
    visit->since = clock_ms();
    if (count > PICTURES)
        refuse(visit, 429, reason);
    else if (!watch_open(watches, visit->answer.wanted.item, visit->since, &reason))
        refuse(visit, 409, reason);
}

/* Whether this answer of an item's process is one for the visit. */
static bool is_for(const struct visit *visit, const struct picture_wanted *asked, const struct picture_said *said) {
    const struct picture_wanted *wanted = &visit->answer.wanted;

    if (!waits_for_picture(visit) || strcmp(wanted->item, asked->item) != 0)
        return false;
    switch (said->kind) {
    case PICTURE_NEW: return is_same(&wanted->form, &asked->form) && wanted->after != said->sequence;
    case PICTURE_NOTHING: return wanted->after == asked->after;
    default: return true; /* the process is stopped */
    }
}

/* All that wait for it get an answer of an item's process. */
static void pass_on(struct visit *visits, const struct watch *watch, const struct picture_said *said,
                    struct picture *picture) {
    for (struct visit *visit = visits; visit < visits + VISITS; visit++) {
        if (!is_for(visit, &watch->wanted, said))
            continue;
        visit->until = clock_ms() + PATIENCE;
        if (said->kind == PICTURE_REFUSED || said->kind == PICTURE_TOO_LARGE) {
            refuse(visit, said->kind == PICTURE_REFUSED ? 404 : 413, said->reason);
        } else {
            answer_picture(&visit->answer, said, clock_ms() - visit->since);
            visit->picture = picture ? picture_hold(picture) : NULL;
        }
    }
}

/* The visit that has been waiting for a picture of the item the longest. */
static const struct visit *first_in_line(const struct visit *visits, const char *item) {
    const struct visit *first = NULL;

    for (const struct visit *visit = visits; visit < visits + VISITS; visit++)
        if (waits_for_picture(visit) && !strcmp(visit->answer.wanted.item, item) &&
            (!first || visit->since < first->since))
            first = visit;
    return first;
}

static void serve_watch(struct visit *visits, struct watch *watch, short readable) {
    struct picture_said said = {.kind = PICTURE_NOTHING};
    struct picture *picture = NULL;
    bool ends = false;

    if (readable && watch_hear(watch, &said, &picture)) {
        pass_on(visits, watch, &said, picture);
        picture_drop(picture);
        ends = said.kind == PICTURE_REFUSED || said.kind == PICTURE_TOO_LARGE;
    }
    const struct visit *first = first_in_line(visits, watch->wanted.item);
    if (!ends && watch->asked && clock_ms() >= watch->since + WATCH_HANGS)
        ends = true;
    else if (!ends && !watch->asked && first)
        ends = !watch_ask(watch, &first->answer.wanted, clock_ms());
    if (ends && said.kind == PICTURE_NOTHING)
        pass_on(visits, watch, &(struct picture_said){.kind = PICTURE_REFUSED, .reason = "ddxvideosnap hangs"}, NULL);
    if (ends || (!first && !watch->asked && clock_ms() >= watch->used + WATCH_IDLE))
        watch_close(watch);
}

/* When the watch has to be looked at, even if nothing comes from it. */
static int64_t until_look(const struct watch *watch) {
    return watch->asked ? watch->since + WATCH_HANGS : watch->used + WATCH_IDLE;
}

/* ---- All of them ---- */

static int sign_of_life(int root) {
    struct message_request message = {.kind = MESSAGE_ALIVE, .size = 1, .address = "-"};

    return send(root, &message, offsetof(struct message_request, text) + 1, MSG_NOSIGNAL) < 0 ? -errno : 0;
}

#define WAITS (1 + 2 * VISITS + WATCHES)

/* List the descriptors to wait for: of the listener, of each visitor and the output of each order, of each item's
 * process. Return the time at which the process must go on at the latest. */
static int64_t prepare(struct pollfd wait[WAITS], const struct visit *visits, const struct watch *watches, int listener,
                       int64_t until) {
    wait[0] = (struct pollfd){.fd = -1, .events = POLLIN};
    for (int i = 0; i < VISITS; i++) {
        const struct visit *visit = &visits[i];
        struct pollfd *connection = &wait[1 + 2 * i], *output = connection + 1;

        if (visit->fd < 0)
            wait[0].fd = listener;
        else if (!follows(visit) && !waits_for_picture(visit) && visit->until < until)
            until = visit->until;
        *connection = (struct pollfd){.fd = visit->fd};
        *output = (struct pollfd){.fd = -1};
        if (follows(visit))
            *output = (struct pollfd){.fd = visit->answer.order, .events = POLLIN};
        else if (!waits_for_picture(visit))
            connection->events = visit->request ? POLLIN : POLLOUT;
    }
    for (int i = 0; i < WATCHES; i++) {
        const struct watch *watch = &watches[i];

        wait[1 + 2 * VISITS + i] = (struct pollfd){.fd = watch->process ? watch->from : -1, .events = POLLIN};
        if (watch->process && until_look(watch) < until)
            until = until_look(watch);
    }
    return until;
}

int web_serve(int listener, int root) {
    static struct visit visits[VISITS];
    static struct visitors visitors;
    static struct watch watches[WATCHES];
    struct pollfd wait[WAITS];
    int64_t life = 0;
    int error = 0;

    signal(SIGPIPE, SIG_IGN);
    visitors.root = root;
    for (int i = 0; i < VISITS; i++)
        visits[i] = (struct visit){.fd = -1, .answer = {.order = -1}};
    while (!error) {
        if (clock_ms() >= life) {
            life = clock_ms() + SIGN_OF_LIFE;
            if ((error = sign_of_life(root)))
                break;
        }
        int64_t left = prepare(wait, visits, watches, listener, life) - clock_ms();
        if (poll(wait, WAITS, left > 0 ? (int)left : 0) < 0 && errno != EINTR)
            return -errno;
        for (int i = 0; i < VISITS && !error; i++) {
            bool reads = visits[i].fd >= 0 && visits[i].request;

            if (visits[i].fd >= 0)
                error = serve_visit(&visits[i], &visitors, wait[1 + 2 * i].revents, wait[2 + 2 * i].revents);
            if (reads && waits_for_picture(&visits[i]))
                begin_to_watch(visits, &visits[i], watches);
        }
        for (int i = 0; i < WATCHES; i++)
            if (watches[i].process)
                serve_watch(visits, &watches[i], wait[1 + 2 * VISITS + i].revents);
        if (wait[0].revents)
            begin(visits, listener);
    }
    return error;
}
