/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The worker: waits for messages of its clients, and handles them one after the other. */
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../lib/fault.h"
#include "budget.h"
#include "checkpoint.h"
#include "claim.h"
#include "files.h"
#include "holder.h"
#include "log.h"
#include "readers.h"
#include "resume.h"
#include "send.h"
#include "session.h"
#include "worker.h"

/* ns of listening after a restart */
#define GRACE 250000000   /* in which only living holders are served */
#define NOISE 1000000000  /* after which new clients are served although holders still send a lot */
#define SETTLE 2000000000 /* after which holders that did not report count as dead */
#define TICK 20000000     /* between checks of the clock during this time */
#define BEAT 500000000    /* between reports of liveness, at most */

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
    int length = snprintf(text, sizeof text,
                          "{\"instance\":\"store\",\"items\":%u,\"clients\":%u,\"bytes\":%llu,\"reserved\":%llu,"
                          "\"budget\":%llu,\"restarts\":%u}\n",
                          items, clients, (unsigned long long)budget_used(store),
                          (unsigned long long)budget_reserved(store), (unsigned long long)store->settings->budget,
                          holder_restarts());
    log_text(1, text, (size_t)length);
}

/* Remove readers that died while no store ran from the writers' lists. */
static void settle(struct store *store) {
    if (store->settled || !store->settings->restarted || store->listened < SETTLE)
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
    store->listened += passed < TICK ? passed : TICK;
    if (store->listened >= (calm ? GRACE : NOISE))
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
        return (struct timespec){0, grace && store->listened >= GRACE ? 0 : TICK};
    return (struct timespec){0, waits ? DDX_QUEUE_PAUSE * 1000000 : BEAT};
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

int worker_run(const struct settings *settings) {
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
