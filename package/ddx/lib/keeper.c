/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "fault.h"
#include "handle.h"

#define SOON_MS DDX_QUEUE_PAUSE_MS /* until the keeper tries an item again that its owner is using */

static struct {
    pthread_mutex_t lock;
    DDX_STORE_ITEM *items;
    unsigned count;
    bool running;
} keeper = {.lock = PTHREAD_MUTEX_INITIALIZER};

static void lock_keeper(void) {
    pthread_mutex_lock(&keeper.lock);
}
static void unlock_keeper(void) {
    pthread_mutex_unlock(&keeper.lock);
}

/* Serve one item. Returns the time in ms after which to do so again, -1 if only poll() need report it. */
static int look_after(DDX_STORE_ITEM *item) {
    int again = -1;

    /* Never wait here: the owner may hold the lock while it waits for the store's answer. */
    item->listen = (struct pollfd){.fd = -1};
    if (!ddx_lock_try(&item->lock))
        return SOON_MS; /* a busy owner receives its messages itself; polling for them would keep this thread awake */
    if (item->socket >= 0) {
        ddx_queue_go_on(&item->queue, item->socket, NULL, NULL); /* a dead peer may have left messages */
        ddx_item_service(item);
    }
    if (item->socket < 0) {
        int64_t now = ddx_time_now();

        if (now >= item->retry && ddx_item_reconnect(item))
            item->retry = now + DDX_RETRY_NS;
        again = item->socket < 0 ? DDX_RETRY_NS / 1000000 : -1;
    }
    if (item->writer.leaving_count)
        ddx_writer_forget(&item->writer, false);
    if (item->writer.leaving_count && again < 0)
        again = DDX_RETRY_NS / 1000000;
    if (ddx_reader_wake(item) || item->queue.crowded)
        again = SOON_MS;
    item->listen = (struct pollfd){.fd = item->socket, .events = (short)(POLLIN | ddx_queue_events(&item->queue))};
    ddx_lock_give(&item->lock);
    return again;
}

/* The sockets to listen on, after the eventfd. The caller frees. NULL: no memory, try again later. */
static struct pollfd *listen_list(unsigned *count) {
    struct pollfd *list = calloc(keeper.count + 1, sizeof *list);

    *count = 0;
    if (!list)
        return NULL;
    list[(*count)++] = (struct pollfd){.fd = ddx_connection_waker, .events = POLLIN};
    for (DDX_STORE_ITEM *item = keeper.items; item; item = item->next)
        list[(*count)++] = item->listen;
    return list;
}

static void *run(void *unused) {
    (void)unused;
    for (;;) {
        int wait = -1;
        unsigned count;

        pthread_mutex_lock(&keeper.lock);
        if (!keeper.items) {
            close(ddx_connection_waker);
            ddx_connection_waker = -1;
            keeper.running = false;
            pthread_mutex_unlock(&keeper.lock);
            return NULL;
        }
        for (DDX_STORE_ITEM *item = keeper.items; item; item = item->next) {
            int again = look_after(item);

            if (again >= 0 && (wait < 0 || again < wait))
                wait = again;
        }
        struct pollfd *list = listen_list(&count);
        pthread_mutex_unlock(&keeper.lock);
        poll(list, count, list ? wait : SOON_MS);
        DDX_PASS(KEEPER_HEARD);
        uint64_t ignored;
        if (list && list[0].revents & POLLIN && read(list[0].fd, &ignored, sizeof ignored) < 0) {
            /* after an exit and restart of the keeper the descriptor may be another file's */
        }
        free(list);
    }
}

/*
 * A child inherits sockets and locks, by which store and writers would take its dead parent to be alive: the child
 * closes them. It must not use the handles anyway.
 */
static void in_child(void) {
    for (DDX_STORE_ITEM *item = keeper.items; item; item = item->next) {
        int *const fds[] = {&item->socket, &item->reader.hold_fd, &item->writer.hold_fd};

        for (unsigned i = 0; i < sizeof fds / sizeof *fds; i++) {
            if (*fds[i] >= 0)
                close(*fds[i]);
            *fds[i] = -1;
        }
    }
    if (ddx_connection_waker >= 0)
        close(ddx_connection_waker);
    ddx_connection_waker = -1;
    keeper.items = NULL;
    keeper.count = 0;
    keeper.running = false;
    pthread_mutex_init(&keeper.lock, NULL);
}

static void prepare_fork(void) {
    if (pthread_atfork(lock_keeper, unlock_keeper, in_child)) {
        /* no memory: then only exec closes them in a child */
    }
}

static int start(void) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    sigset_t all, before;
    pthread_t thread;

    pthread_once(&once, prepare_fork);

    ddx_connection_waker = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (ddx_connection_waker < 0)
        return -errno;
    /* The keeper's thread must not take the program's signals. */
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int result = pthread_create(&thread, NULL, run, NULL);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (result) {
        close(ddx_connection_waker);
        ddx_connection_waker = -1; /* or a later wake goes to another file's descriptor */
        return -result;
    }
    pthread_setname_np(thread, "ddx-keeper");
    pthread_detach(thread);
    keeper.running = true;
    return 0;
}

int ddx_keeper_add(DDX_STORE_ITEM *item) {
    int result = 0;

    lock_keeper();
    item->next = keeper.items;
    keeper.items = item;
    keeper.count++;
    if (!keeper.running)
        result = start();
    else
        ddx_connection_wake_keeper();
    if (result) {
        keeper.items = item->next;
        keeper.count--;
    } else {
        item->next_of_id = item->id->items;
        item->id->items = item;
    }
    unlock_keeper();
    return result;
}

static bool unlink_item(DDX_STORE_ITEM **link, DDX_STORE_ITEM *item, size_t next) {
    while (*link && *link != item)
        link = (DDX_STORE_ITEM **)(void *)((char *)*link + next);
    if (!*link)
        return false; /* its parent's, in a child */
    *link = *(DDX_STORE_ITEM **)(void *)((char *)item + next);
    return true;
}

void ddx_keeper_remove(DDX_STORE_ITEM *item) {
    lock_keeper();
    keeper.count -= unlink_item(&keeper.items, item, offsetof(DDX_STORE_ITEM, next));
    unlink_item(&item->id->items, item, offsetof(DDX_STORE_ITEM, next_of_id));
    ddx_connection_wake_keeper();
    unlock_keeper();
}
