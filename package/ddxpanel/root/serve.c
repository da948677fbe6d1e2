/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "serve.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include "clock.h"
#include "login.h"
#include "message.h"
#include "run.h"
#include "secret.h"

/* One write, since several processes share the log. Words of visitors may be anything, so only what is visible. */
__attribute__((format(printf, 1, 2))) static void say(const char *format, ...) {
    char line[MESSAGE_TEXT + 256];
    va_list arguments;

    va_start(arguments, format);
    int length = vsnprintf(line, sizeof line - 1, format, arguments);
    va_end(arguments);
    if (length < 0)
        return;
    if (length > (int)sizeof line - 2)
        length = (int)sizeof line - 2;
    for (int i = 0; i < length; i++)
        if (line[i] < ' ' || line[i] > '~')
            line[i] = '?';
    line[length++] = '\n';
    if (write(STDERR_FILENO, line, (size_t)length) < 0)
        return; /* there is no other place to report to */
}

static struct message_answer refusal(unsigned status, const char *reason) {
    struct message_answer answer = {.status = status};

    snprintf(answer.reason, sizeof answer.reason, "%s", reason);
    return answer;
}

/* ---- Login ---- */

static struct message_answer log_in(const struct serve *serve, const struct message_request *request,
                                    struct guesses *guesses) {
    struct in6_addr address;

    if (!guess_address(request->address, &address) || strlen(request->text) + 1 != request->size)
        return refusal(400, "not a login");
    int64_t wait = guess_wait(guesses, &address, clock_ms());
    if (wait)
        return (struct message_answer){.status = 429, .wait = (uint32_t)wait};
    bool knows = serve->passphrase && secret_is(serve->passphrase, request->text);
    if (knows || (serve->link && link_take(serve->link, clock_ms() / 1000, request->text))) {
        guess_was_right(guesses, &address);
        say("%s: logged in%s", request->address, knows ? "" : " by a link");
        return (struct message_answer){.status = 200};
    }
    guess_was_wrong(guesses, &address, clock_ms());
    say("%s: wrong passphrase", request->address);
    return (struct message_answer){.status = 401, .wait = (uint32_t)guess_wait(guesses, &address, clock_ms())};
}

/* ---- Orders ---- */

struct receiver {
    int socket;
    bool needed; /* without it, the program has no use */
};

/* False: the web process wants no more, or does not read. */
static bool pass_on(void *to, const char *bytes, size_t size) {
    char packet[1 + MESSAGE_PIECE] = "o";
    struct receiver *receiver = to;

    for (size_t done = 0, part; done < size; done += part) {
        part = size - done < MESSAGE_PIECE ? size - done : MESSAGE_PIECE;
        memcpy(packet + 1, bytes + done, part);
        if (receiver->socket < 0 || send(receiver->socket, packet, 1 + part, MSG_NOSIGNAL) >= 0)
            continue;
        if (receiver->needed)
            return false;
        receiver->socket = -1; /* it does not wait again for a receiver that does not read */
    }
    return true;
}

static const char *ending(const struct message_end *end) {
    switch (end->end) {
    case RUN_EXITED: return "exit status";
    case RUN_KILLED: return "killed by signal";
    case RUN_TOO_LONG: return "took too long, killed by signal";
    case RUN_TOO_MUCH: return "said too much, killed by signal";
    case RUN_NOT_WANTED: return "was not wanted any more, killed by signal";
    default: return "not started, error";
    }
}

/* In a process of its own. */
_Noreturn static void execute(const struct message_request *request, const struct order *order,
                              const char *const *command, const char *const *words, int output) {
    struct timeval patience = {.tv_sec = order->seconds};
    struct run run = {.end = RUN_EXITED};
    char text[MESSAGE_TEXT + 1] = "";

    setsockopt(output, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    struct receiver receiver = {.socket = output, .needed = order->kind != ORDER_CHANGES};
    const struct run_for limits = {.seconds = order->seconds,
                                   .output = order->output,
                                   .receiver = receiver.needed ? output : -1,
                                   .take = pass_on,
                                   .to = &receiver,
                                   .apart = order->kind == ORDER_BYTES};
    int error = run_program(command, &limits, &run);
    const struct message_end end = {.mark = 'e',
                                    .end = error ? MESSAGE_NOT_STARTED : (uint8_t)run.end,
                                    .status = (int16_t)(error ? -error : run.status)};
    for (size_t i = 0, length = 0; words[i]; length = strlen(text), i++)
        snprintf(text + length, sizeof text - length, " %s", words[i]);
    say("%s, session %u:%s: %s %d", request->address, request->session, text, ending(&end), end.status);
    _exit(send(output, &end, sizeof end, MSG_NOSIGNAL) < 0);
}

struct running {
    pid_t process; /* 0: free */
    enum order_kind kind;
};

/* A free place for one more; NULL: as many as may run at a time do. Only these children are reaped here. */
static struct running *place(struct running running[SERVE_ORDERS], enum order_kind kind) {
    struct running *free = NULL;
    unsigned others = 0;

    for (struct running *one = running; one < running + SERVE_ORDERS; one++) {
        if (one->process && waitpid(one->process, NULL, WNOHANG) != 0)
            one->process = 0;
        if (!one->process)
            free = one;
        others += one->process && one->kind == ORDER_BYTES;
    }
    return kind == ORDER_BYTES && others >= SERVE_BYTES ? NULL : free;
}

/* Starts an order; *fd is then the socket for its output, to be passed on and closed. */
static struct message_answer start(const struct serve *serve, const struct message_request *request,
                                   struct running running[SERVE_ORDERS], int *fd) {
    const char *words[MESSAGE_WORDS + 1], *command[ORDER_WORDS], *reason = "not words";
    const struct order *order = message_words(request, words) ? serve->find(words, command, &reason) : NULL;
    int ends[2];

    if (!order) {
        say("%s, session %u: refused: %s", request->address, request->session, reason);
        return refusal(400, reason);
    }
    struct running *free = place(running, order->kind);
    if (!free)
        return refusal(409, order->kind == ORDER_BYTES ? "two files are being fetched already"
                                                       : "other orders are being executed");
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends))
        return refusal(409, strerror(errno));
    pid_t child = fork();
    if (!child) {
        close(serve->web);
        close(ends[0]);
        execute(request, order, command, words, ends[1]);
    }
    close(ends[1]);
    if (child < 0) {
        close(ends[0]);
        return refusal(409, strerror(errno));
    }
    *free = (struct running){child, order->kind};
    *fd = ends[0];
    return (struct message_answer){.status = 200};
}

/* Waits for a request. 0, or -errno; -EAGAIN: something else was to be done. */
static int wait_for(const struct serve *serve, int64_t heard) {
    enum { WEB, ALSO, PART, ALL = PART + SERVE_PARTS };
    struct pollfd wait[ALL] = {[WEB] = {.fd = serve->web, .events = POLLIN},
                               [ALSO] = {.fd = serve->look ? serve->also : -1, .events = POLLIN}};
    int64_t left = serve->silence ? heard + (int64_t)serve->silence * 1000 - clock_ms() : -1;

    for (int i = 0; i < SERVE_PARTS; i++)
        wait[PART + i] = (struct pollfd){.fd = serve->part[i] ? serve->part[i] : -1, .events = POLLIN};
    int found = poll(wait, ALL, !serve->silence ? -1 : left > 0 ? (int)left : 0);
    if (found < 0)
        return -errno;
    for (int i = 0; i < SERVE_PARTS; i++)
        if (wait[PART + i].revents)
            return -ECHILD;
    if (wait[ALSO].revents)
        serve->look(serve->argument);
    return wait[WEB].revents ? 0 : found ? -EAGAIN : -ETIMEDOUT;
}

int serve(const struct serve *serve) {
    static struct guesses guesses;
    struct running running[SERVE_ORDERS] = {{0, ORDER_SHOWS}};
    int64_t heard = clock_ms();

    for (;;) {
        int waited = wait_for(serve, heard);
        if (waited == -EINTR || waited == -EAGAIN)
            continue;
        if (waited)
            return waited;
        struct message_request request = {.size = 0};
        int fd = -1;
        ssize_t got = recv(serve->web, &request, sizeof request, 0);

        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return got ? -errno : 0;
        bool good = message_is_good(&request, (size_t)got);
        if (good)
            heard = clock_ms();
        if (good && request.kind == MESSAGE_ALIVE)
            continue;
        struct message_answer answer = !good                           ? refusal(400, "not a request")
                                       : request.kind == MESSAGE_LOGIN ? log_in(serve, &request, &guesses)
                                                                       : start(serve, &request, running, &fd);
        explicit_bzero(&request, sizeof request);
        int error = message_answer(serve->web, &answer, fd);
        if (fd >= 0)
            close(fd);
        if (error)
            return error;
    }
}
