/* SPDX-License-Identifier: GPL-2.0-or-later */
/* store: naming service and memory budget for items in shared memory. */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "../lib/wire.h"
#include "../program/startup.h"
#include "budget.h"
#include "checkpoint.h"
#include "terms.h"
#include "files.h"
#include "holder.h"
#include "log.h"
#include "session.h"
#include "send.h"
#include "state.h"

/* ---- Socket ---- */

#define LOCK_TRIES 100
#define BACKLOG 1024 /* waiting connections; a further one is refused as if no store ran */
#define LOCK_STEP_NS 10000000

/* One store per port: the lock is held as long as this process lives, however it ends. */
static int lock_port(const char *path) {
    char name[sizeof(((struct sockaddr_un *)0)->sun_path) + 8];

    snprintf(name, sizeof name, "%s.lock", path);
    int fd = open(name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0)
        return -errno;
    /* After a store was killed, its worker may live a moment longer. */
    for (int i = 0; flock(fd, LOCK_EX | LOCK_NB); i++) {
        if (i == LOCK_TRIES) {
            close(fd);
            return -EADDRINUSE;
        }
        nanosleep(&(struct timespec){0, LOCK_STEP_NS}, NULL);
    }
    return 0;
}

static int make_folder(const char *path) {
    char folder[sizeof(((struct sockaddr_un *)0)->sun_path)];
    uid_t owner;

    snprintf(folder, sizeof folder, "%s", path);
    *strrchr(folder, '/') = 0;
    if (mkdir(folder, 0755) && errno != EEXIST)
        return -errno;
    /* Programs trust no store in a folder that another user made or can change. */
    int result = ddx_folder_owner(path, &owner);
    if (result)
        return result;
    if (!strncmp(folder, "/tmp/", 5) && owner != getuid())
        return -EPERM;
    return access(folder, W_OK) ? -errno : 0;
}

/*
 * Open a listening socket for this port; its path goes into `path`. *restarted: a store ran here before, so there may
 * be living holders of items. -EADDRINUSE: a store runs here now.
 */
static int listen_on(int port, char *path, size_t bytes, bool *restarted) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int result = -ENOENT;

    for (unsigned i = 0; ddx_socket_path(i, port, path, bytes); i++)
        if (!(result = make_folder(path)))
            break;
    if (!result)
        result = lock_port(path);
    if (result)
        return result;
    *restarted = !access(path, F_OK);
    unlink(path);
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return -errno;
    /* Group and owner only; on the appliance the socket inherits the folder's group, ddx. */
    mode_t before = umask(0117);
    result = bind(fd, (struct sockaddr *)&address, sizeof address) || listen(fd, BACKLOG) ? -errno : 0;
    umask(before);
    if (result) {
        close(fd);
        return result;
    }
    return fd;
}

/* ---- Worker ---- */

/* The worker: waits for messages of its clients, and handles them one after the other. */

/* ns of listening after a restart */
#define GRACE_NS 250000000   /* in which only living holders are served */
#define NOISE_NS 1000000000  /* after which new clients are served although holders still send a lot */
#define SETTLE_NS 2000000000 /* after which holders that did not report count as dead */
#define TICK_NS 20000000     /* between checks of the clock during this time */
#define BEAT_NS 500000000    /* between reports of liveness, at most */

static volatile sig_atomic_t stop, report;

static void on_signal(int number) {
    if (number == SIGUSR1)
        report = 1;
    else
        stop = 1;
}

static void print_json(struct store *store) {
    unsigned items = 0, clients = 0;
    char text[256];

    for (const struct item *item = store->items; item; item = item->next)
        items++;
    for (const struct client *client = store->clients; client; client = client->next)
        clients++;
    int length =
        snprintf(text, sizeof text,
                 "{\"instance\":\"ddxstore\",\"items\":%u,\"clients\":%u,\"bytes\":%llu,\"reserved\":%llu,"
                 "\"budget\":%llu,\"restarts\":%u}\n",
                 items, clients, (unsigned long long)budget_used(store), (unsigned long long)budget_reserved(store),
                 (unsigned long long)store->settings->budget, holder_restarts());
    log_text(1, text, (size_t)length);
}

/* Remove readers that died while no store ran from the writers' lists. */
static void settle(struct store *store) {
    if (store->settled || !store->settings->restarted || store->listened < SETTLE_NS)
        return;
    store->settled = true;
    DDX_PASS(STORE_SETTLED);
    for (struct item *item = store->items; item; item = item->next) {
        struct ddx_message message = {.operation = DDX_READER_GONE, .flags = DDX_FLAG_CREATE};

        if (item->writer)
            client_send(item->writer, &message, NULL, NULL, 0);
    }
}

/*
 * The sockets to poll: first the listener, then the clients in the order of their list. *waits: some clients need
 * work whose time poll() does not report.
 */
static struct pollfd *poll_list(struct store *store, nfds_t *count, bool *waits) {
    static struct pollfd *list;
    static nfds_t room;
    nfds_t needed = 1;

    for (struct client *c = store->clients; c; c = c->next)
        needed++;
    if (needed > room) {
        struct pollfd *more = realloc(list, 2 * needed * sizeof *list);

        if (!more)
            return NULL;
        list = more;
        room = 2 * needed;
    }
    bool grace = store->settings->restarted && !store->open;
    *waits = readers_wait(store);
    list[0] = (struct pollfd){.fd = clients_must_wait() ? -1 : store->settings->listener, .events = POLLIN};
    *count = 1;
    for (struct client *c = store->clients; c; c = c->next) {
        short out = c->listing && !c->queue.count ? POLLOUT : ddx_queue_events(&c->queue);

        *waits |= c->queue.crowded;
        list[(*count)++] = (struct pollfd){.fd = c->socket, .events = (short)((grace && c->early ? 0 : POLLIN) | out)};
    }
    return list;
}

/*
 * After a restart: count the time spent listening. A store that was stopped, or got no processor time, has not read the
 * holders' reports; if it admitted new clients by the clock, it would give them items that others hold.
 */
static void count_time(struct store *store, bool calm) {
    static int64_t last;
    int64_t now = ddx_time_now(), passed = last ? now - last : 0;

    last = now;
    store->listened += passed < TICK_NS ? passed : TICK_NS;
    if (store->listened >= (calm ? GRACE_NS : NOISE_NS))
        store->open = true;
}

/*
 * How long to sleep: until the next check of the clock, of crowded queues, of waiting clients, or the next report of
 * liveness.
 */
static struct timespec patience(const struct store *store, bool young, bool waits, bool busy) {
    bool grace = young && !store->open;

    if (busy)
        return (struct timespec){0, 0};
    if (young)
        return (struct timespec){0, grace && store->listened >= GRACE_NS ? 0 : TICK_NS};
    return (struct timespec){0, waits ? DDX_QUEUE_PAUSE_MS * 1000000 : BEAT_NS};
}

static void hear(struct store *store, const struct pollfd *list) {
    clients_hear(store, list + 1);
    if (list[0].revents)
        client_accept(store);
}

static void turn(struct store *store, const sigset_t *waiting) {
    bool young = store->settings->restarted && !store->settled;
    nfds_t count;
    bool waits = false, busy = writers_go_on(store);
    struct pollfd *list = poll_list(store, &count, &waits);
    struct timespec timeout = patience(store, young, waits, busy);
    int ready = list ? ppoll(list, count, &timeout, waiting) : -1;

    holder_beat();
    waits |= busy;
    if (ready < 0 || (!ready && !young && !waits))
        return;
    if (young)
        count_time(store, ready == 0);
    if (ready)
        hear(store, list);
    clients_sweep(store);
    settle(store);
    files_commit();
    clients_tell(store, NULL);
}

/* Run until a request to stop; returns the exit status. */
static int worker_run(const struct settings *settings) {
    struct sigaction action = {.sa_handler = on_signal};
    static const int signals[] = {SIGTERM, SIGINT, SIGUSR1};
    sigset_t blocked, waiting;

    sigemptyset(&blocked);
    for (unsigned i = 0; i < sizeof signals / sizeof *signals; i++) {
        sigaction(signals[i], &action, NULL);
        sigaddset(&blocked, signals[i]);
    }
    /* Delivered only while ppoll() waits. */
    sigprocmask(SIG_BLOCK, &blocked, &waiting);
    sigemptyset(&waiting);
    store_memory();
    struct store *store = checkpoint_restore() ? store_take_over() : store_begin(settings);
    if (!store) {
        log_line("no memory");
        return 1;
    }
    DDX_PASS(STORE_LISTENS);
    while (!stop) {
        turn(store, &waiting);
        if (report)
            print_json(store);
        report = 0;
    }
    /* The socket's name remains, so that the next store knows that there may be living holders of items. */
    print_json(store);
    return 0;
}

/* ---- Program ---- */

static struct settings settings = {.port = DDX_STORE_PORT, .budget = (uint64_t)8 << 20};

static const char usage[] = "usage: ddxstore [-m SIZE] [-port N]\n"
                            "\n"
                            "Keeps the names of items in shared memory, and their memory.\n"
                            "\n"
                            "  -m SIZE    memory for all items together, for example 8M (the default), 512K, 1G\n"
                            "  -port N    number of this store, if several run on one machine; default 2005\n"
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

/* 0 if the text is not a port. */
static int parse_port(const char *text) {
    char *end;
    unsigned long port = strtoul(text, &end, 10);

    return *text >= '0' && *text <= '9' && !*end && port <= 65535 ? (int)port : 0;
}

/* 0: continue; else the exit status plus one. */
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
            if (!parse_size(optarg, &settings.budget)) {
                log_line("-m %s: not a size; give a number with K, M or G, for example -m 8M", optarg);
                return 3;
            }
            break;
        case 'p':
            settings.port = parse_port(optarg);
            if (!settings.port) {
                log_line("-port %s: not a port; give a number from 1 to 65535", optarg);
                return 3;
            }
            break;
        case 'h': fputs(usage, stdout); return 1;
        case 'v': version_print("ddxstore"); return 1;
        case ':': log_line("%s: needs a value; see ddxstore -help", argv[optind - 1]); return 3;
        default: log_line("%s: unknown option; see ddxstore -help", argv[optind - 1]); return 3;
        }
    }
    if (optind < argc) {
        log_line("%s: unexpected; see ddxstore -help", argv[optind]);
        return 3;
    }
    return 0;
}

/* One descriptor is needed for each frame, reader and handle: the usual limit of 1024 is soon reached. */
static void allow_descriptors(void) {
    struct rlimit limit;

    if (!getrlimit(RLIMIT_NOFILE, &limit)) {
        limit.rlim_cur = limit.rlim_max;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
}

static int work(void) {
    return worker_run(&settings);
}

int main(int argc, char **argv) {
    descriptors_open();
    char path[sizeof(((struct sockaddr_un *)0)->sun_path)];
    int done = parse_options(argc, argv);

    if (done)
        return done - 1;
    allow_descriptors();
    settings.listener = listen_on(settings.port, path, sizeof path, &settings.restarted);
    if (settings.listener == -EADDRINUSE) {
        log_line("a store runs at port %d already; stop it, or give another -port", settings.port);
        return 1;
    }
    if (settings.listener < 0) {
        log_line("%s: %s", path, strerror(-settings.listener));
        return 1;
    }
    signal(SIGPIPE, SIG_IGN);
    if (checkpoint_begin()) {
        log_line("no memory");
        return 1;
    }
    files_begin();
    log_line("%llu bytes at %s", (unsigned long long)settings.budget, path);
    return holder_run(work);
}
