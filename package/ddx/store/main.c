/* SPDX-License-Identifier: GPL-2.0-or-later */
/* store: naming service and memory budget for items in shared memory. */
#include <errno.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "../program/descriptors.h"
#include "listen.h"
#include "server.h"

/* ns of listening after a restart */
#define GRACE 250000000   /* in which only living holders are heard */
#define NOISE 1000000000  /* after which newcomers are heard although the holders still have a lot to say */
#define SETTLE 2000000000 /* after which those who did not report count as dead */
#define TICK 20000000     /* between looks at the clock while that goes on */

#define NOTES 100 /* lines a second at most */

struct store store = {.port = DDX_STORE_PORT, .budget = (uint64_t)8 << 20, .next_reader = 1};

static volatile sig_atomic_t stop, report;

static void on_signal(int number) {
    if (number == SIGUSR1)
        report = 1;
    else
        stop = 1;
}

/*
 * The log's reader may be stopped, or its disk full: nothing that is said here is worth waiting for. A pipe that poll()
 * calls writable has room for PIPE_BUF bytes.
 */
static bool say(int fd, const char *text, size_t length) {
    struct pollfd room = {.fd = fd, .events = POLLOUT};

    if (poll(&room, 1, 0) != 1 || !(room.revents & POLLOUT))
        return false;
    return write(fd, text, length) == (ssize_t)length;
}

void note(const char *format, ...) {
    static int64_t second;
    static unsigned lines, left_out;
    char text[512] = "store: ";
    va_list arguments;

    /* A program that does nonsense as fast as it can must not fill the log. */
    if (ddx_time_now() / 1000000000 != second)
        lines = 0;
    second = ddx_time_now() / 1000000000;
    if (left_out && lines < NOTES) {
        int length = snprintf(text + 7, sizeof text - 7, "%u lines were left out\n", left_out) + 7;

        left_out = say(2, text, (size_t)length) ? 0 : left_out;
    }
    va_start(arguments, format);
    int length = vsnprintf(text + 7, sizeof text - 8, format, arguments) + 7;
    va_end(arguments);
    if (length > (int)sizeof text - 2)
        length = (int)sizeof text - 2;
    text[length++] = '\n';
    if (lines++ >= NOTES || !say(2, text, (size_t)length))
        left_out++;
}

static const char usage[] = "usage: store [-m SIZE] [-port N]\n"
                            "\n"
                            "Keeps the names of items in shared memory, and their memory.\n"
                            "\n"
                            "  -m SIZE    memory for all items together, for example 8M (the default), 512K, 1G\n"
                            "  -port N    several stores on one machine are told apart by this number; default 2005\n"
                            "  -help      this text; -version\n"
                            "\n"
                            "The store runs until it gets TERM or INT; USR1 prints one line of JSON.\n";

static bool parse_size(const char *text, uint64_t *bytes) {
    char *end;

    errno = 0;
    unsigned long long value = strtoull(text, &end, 10);
    unsigned shift = 0;
    switch (*end) {
    case 'k':
    case 'K': shift = 10; break;
    case 'm':
    case 'M': shift = 20; break;
    case 'g':
    case 'G': shift = 30; break;
    default: break;
    }
    if (shift)
        end++;
    if (errno || end == text || *end || *text == '-' || !value || value > (UINT64_MAX >> 1) >> shift)
        return false;
    *bytes = (uint64_t)value << shift;
    return true;
}

/* 0 if it is none. */
static int parse_port(const char *text) {
    char *end;
    unsigned long port = strtoul(text, &end, 10);

    return *text >= '0' && *text <= '9' && !*end && port <= 65535 ? (int)port : 0;
}

/* 0: go on; else the exit status plus one. */
static int parse_options(int argc, char **argv) {
    static const struct option options[] = {{"m", required_argument, NULL, 'm'},
                                            {"port", required_argument, NULL, 'p'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"version", no_argument, NULL, 'v'},
                                            {NULL, 0, NULL, 0}};
    int option;

    opterr = 0;
    while ((option = getopt_long_only(argc, argv, ":", options, NULL)) != -1) {
        switch (option) {
        case 'm':
            if (!parse_size(optarg, &store.budget)) {
                note("-m %s: not a size; give a number with K, M or G, for example -m 8M", optarg);
                return 3;
            }
            break;
        case 'p':
            store.port = parse_port(optarg);
            if (!store.port) {
                note("-port %s: not a port; give a number from 1 to 65535", optarg);
                return 3;
            }
            break;
        case 'h': fputs(usage, stdout); return 1;
        case 'v': puts("store " DDX_VERSION); return 1;
        case ':': note("%s: needs a value; see store -help", argv[optind - 1]); return 3;
        default: note("%s: unknown option; see store -help", argv[optind - 1]); return 3;
        }
    }
    if (optind < argc) {
        note("%s: unexpected; see store -help", argv[optind]);
        return 3;
    }
    return 0;
}

static void print_json(void) {
    unsigned items = 0, clients = 0;
    char text[256];

    for (const struct item *item = store.items; item; item = item->next)
        items++;
    for (const struct client *client = store.clients; client; client = client->next)
        clients++;
    int length = snprintf(text, sizeof text,
                          "{\"instance\":\"store\",\"items\":%u,\"clients\":%u,\"bytes\":%llu,\"reserved\":%llu,"
                          "\"budget\":%llu}\n",
                          items, clients, (unsigned long long)budget_used(), (unsigned long long)budget_reserved(),
                          (unsigned long long)store.budget);
    say(1, text, (size_t)length);
}

/* Readers that died while no store ran still stand in the writers' lists. */
static void settle(void) {
    if (store.settled || !store.restarted || store.listened < SETTLE)
        return;
    store.settled = true;
    DDX_PASS(STORE_SETTLED);
    for (struct item *item = store.items; item; item = item->next) {
        struct ddx_message message = {.operation = DDX_READER_GONE, .flags = DDX_FLAG_CREATE};

        if (item->writer)
            client_send(item->writer, &message, NULL, NULL, 0);
    }
}

/* The sockets to listen on: first the listener, then the clients in the order of their list. */
static struct pollfd *poll_list(nfds_t *count, bool *crowded) {
    static struct pollfd *list;
    static nfds_t room;
    nfds_t needed = 1;

    for (struct client *c = store.clients; c; c = c->next)
        needed++;
    if (needed > room) {
        struct pollfd *more = realloc(list, 2 * needed * sizeof *list);

        if (!more)
            return NULL;
        list = more;
        room = 2 * needed;
    }
    bool grace = store.restarted && !store.open;
    *crowded = false;
    list[0] = (struct pollfd){.fd = store.listener, .events = POLLIN};
    *count = 1;
    for (struct client *c = store.clients; c; c = c->next) {
        short out = c->listing && !c->queue.count ? POLLOUT : ddx_queue_events(&c->queue);

        *crowded |= c->queue.crowded;
        list[(*count)++] = (struct pollfd){.fd = c->socket, .events = (short)((grace && c->early ? 0 : POLLIN) | out)};
    }
    return list;
}

/*
 * After a restart: count the time that we listened. A store that was stopped meanwhile, or does not get to run, has not
 * heard those who reported; were it to let newcomers in by the clock, it would give them items that others hold.
 */
static void count_time(bool calm) {
    static int64_t last;
    int64_t now = ddx_time_now(), passed = last ? now - last : 0;

    last = now;
    store.listened += passed < TICK ? passed : TICK;
    if (store.listened >= (calm ? GRACE : NOISE))
        store.open = true;
}

static void turn(const sigset_t *waiting) {
    bool young = store.restarted && !store.settled, grace = young && !store.open;
    struct timespec tick = {0, grace && store.listened >= GRACE ? 0 : TICK}, pause = {0, DDX_QUEUE_PAUSE * 1000000};
    nfds_t count;
    bool crowded;
    struct pollfd *list = poll_list(&count, &crowded);
    int ready = list ? ppoll(list, count, young ? &tick : crowded ? &pause : NULL, waiting) : -1;

    if (ready < 0)
        return;
    if (young)
        count_time(ready == 0);
    nfds_t i = 1;
    for (struct client *c = store.clients; c && i < count; c = c->next, i++) {
        if ((list[i].revents & POLLOUT || c->queue.crowded) && !c->gone)
            client_go_on(c);
        if (list[i].revents & POLLOUT && c->listing && !c->gone)
            list_continue(c);
        if (c->early && list[i].revents & (POLLHUP | POLLERR))
            c->gone = true; /* what it asked for it wants no more */
        else if (list[i].revents & ~POLLOUT)
            client_receive(c);
    }
    if (list[0].revents) {
        int fd = accept4(store.listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

        if (fd >= 0)
            client_add(fd);
    }
    clients_sweep();
}

/* One descriptor for each frame, reader and handle: the shell's usual limit of 1024 is soon reached. */
static void allow_descriptors(void) {
    struct rlimit limit;

    if (!getrlimit(RLIMIT_NOFILE, &limit)) {
        limit.rlim_cur = limit.rlim_max;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
}

int main(int argc, char **argv) {
    descriptors_open();
    char path[sizeof(((struct sockaddr_un *)0)->sun_path)];
    int done = parse_options(argc, argv);

    if (done)
        return done - 1;
    allow_descriptors();
    store.listener = listen_on(store.port, path, sizeof path, &store.restarted);
    if (store.listener == -EADDRINUSE) {
        note("a store runs at port %d already; stop it, or give another -port", store.port);
        return 1;
    }
    if (store.listener < 0) {
        note("%s: %s", path, strerror(-store.listener));
        return 1;
    }
    struct sigaction action = {.sa_handler = on_signal};
    sigset_t blocked, waiting;
    sigemptyset(&blocked);
    static const int signals[] = {SIGTERM, SIGINT, SIGUSR1};
    for (unsigned i = 0; i < 3; i++) {
        sigaction(signals[i], &action, NULL);
        sigaddset(&blocked, signals[i]);
    }
    signal(SIGPIPE, SIG_IGN);
    sigprocmask(SIG_BLOCK, &blocked, &waiting); /* delivered while ppoll() waits, and only then */
    DDX_PASS(STORE_LISTENS);
    note("%llu bytes at %s", (unsigned long long)store.budget, path);
    while (!stop) {
        turn(&waiting);
        settle();
        if (report)
            print_json();
        report = 0;
    }
    /* The socket's name stays: it tells the next store that there may be living holders of items. */
    print_json();
    return 0;
}
