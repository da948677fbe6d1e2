/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "web.h"

#include <errno.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "answer.h"
#include "clock.h"

#define VISITS 32         /* requests at a time; further ones wait in the listener's queue */
#define PATIENCE 10000    /* ms for a whole request, and for taking a piece of the answer */
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
};

static void end(struct visit *visit) {
    free(visit->request);
    close(visit->fd);
    if (visit->answer.order >= 0)
        close(visit->answer.order);
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

static bool more_of_answer(struct visit *visit) {
    ssize_t sent = send(visit->fd, visit->answer.text + visit->sent, visit->answer.size - visit->sent, MSG_NOSIGNAL);

    if (sent < 0)
        return errno == EAGAIN || errno == EINTR;
    visit->sent += (size_t)sent;
    visit->until = clock_ms() + PATIENCE;
    if (visit->sent < visit->answer.size)
        return true;
    visit->sent = visit->answer.size = 0;
    return visit->answer.order >= 0;
}

/* Only called when all former output was sent. The last line is the panel's own: how the order ended. */
static void more_of_output(struct visit *visit) {
    static const char *const ends[] = {"exited", "killed", "too long", "too much", "not wanted"};
    struct message_end how = {.end = MESSAGE_NOT_STARTED, .status = -1};
    struct answer *answer = &visit->answer;
    char packet[1 + MESSAGE_PIECE];
    ssize_t got = recv(answer->order, packet, sizeof packet, MSG_DONTWAIT);

    if (got < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (got > 1 && *packet == 'o') {
        answer->size = (size_t)got - 1;
        memcpy(answer->text, packet + 1, answer->size);
        visit->mid_line = answer->text[answer->size - 1] != '\n';
    } else {
        if (got == (ssize_t)sizeof how)
            memcpy(&how, packet, sizeof how);
        const char *word = how.end < sizeof ends / sizeof ends[0] ? ends[how.end] : "not started";
        answer->size = (size_t)snprintf(answer->text, END_TEXT, "%s{\"end\":\"%s\",\"status\":%d}\n",
                                        visit->mid_line ? "\n" : "", word, how.status);
        close(answer->order);
        answer->order = -1;
    }
    visit->until = clock_ms() + PATIENCE;
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

static int serve_visit(struct visit *visit, struct visitors *visitors, short connection, short output) {
    int error = 0;
    bool goes_on = true;

    if (follows(visit)) {
        if (connection) /* nothing more is expected from it: the visitor has gone */
            goes_on = false;
        else if (output)
            more_of_output(visit);
    } else if (connection) {
        goes_on = visit->request ? more_of_request(visit, visitors, &error) : more_of_answer(visit);
    }
    if (!goes_on || (!follows(visit) && clock_ms() >= visit->until))
        end(visit);
    return error;
}

static int sign_of_life(int root) {
    struct message_request message = {.kind = MESSAGE_ALIVE, .size = 1, .address = "-"};

    return send(root, &message, offsetof(struct message_request, text) + 1, MSG_NOSIGNAL) < 0 ? -errno : 0;
}

int web_serve(int listener, int root) {
    static struct visit visits[VISITS];
    static struct visitors visitors;
    int64_t life = 0;
    int error = 0;

    visitors.root = root;
    for (int i = 0; i < VISITS; i++)
        visits[i] = (struct visit){.fd = -1, .answer = {.order = -1}};
    while (!error) {
        struct pollfd wait[1 + 2 * VISITS] = {{.fd = -1, .events = POLLIN}};

        if (clock_ms() >= life) {
            life = clock_ms() + SIGN_OF_LIFE;
            if ((error = sign_of_life(root)))
                break;
        }
        int64_t until = life;
        for (int i = 0; i < VISITS; i++) {
            const struct visit *visit = &visits[i];
            struct pollfd *connection = &wait[1 + 2 * i], *output = connection + 1;

            if (visit->fd < 0)
                wait[0].fd = listener;
            else if (!follows(visit) && visit->until < until)
                until = visit->until;
            *connection = (struct pollfd){.fd = visit->fd};
            *output = (struct pollfd){.fd = -1};
            if (follows(visit))
                *output = (struct pollfd){.fd = visit->answer.order, .events = POLLIN};
            else
                connection->events = visit->request ? POLLIN : POLLOUT;
        }
        int64_t left = until - clock_ms();
        if (poll(wait, 1 + 2 * VISITS, left > 0 ? (int)left : 0) < 0 && errno != EINTR)
            return -errno;
        for (int i = 0; i < VISITS && !error; i++)
            if (visits[i].fd >= 0)
                error = serve_visit(&visits[i], &visitors, wait[1 + 2 * i].revents, wait[2 + 2 * i].revents);
        if (wait[0].revents)
            begin(visits, listener);
    }
    return error;
}
