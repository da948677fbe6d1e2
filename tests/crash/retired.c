/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Readers are stopped, each in another epoch, and keep its memory. Existing memory never exceeds the store's number,
 * nor that number -m; an impossible request is refused until one of the readers has continued or died.
 */
#include <dirent.h>
#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "puppet.h"
#include "tests.h"

#define SLEEPERS 8
#define FILES 1024

static struct ddx_store_info all(void) {
    static DDX_STORE_ID *own;
    struct ddx_store_info info;
    struct ddx_item_info *items;
    unsigned count;

    if ((!own && !(own = ddx_store_open(NULL, 0, 10))) || ddx_store_list(own, &info, &items, &count))
        fail("the store does not answer");
    free(items);
    return info;
}

/* The bytes of the item's files that these programs have open, each file once, by the kernel's account. */
static uint64_t existing(struct puppet *const *puppet, unsigned count) {
    static ino_t seen[FILES];
    unsigned files = 0;
    uint64_t bytes = 0;

    for (unsigned i = 0; i < count; i++) {
        char folder[32], link[320], target[128];
        struct dirent *entry;

        snprintf(folder, sizeof folder, "/proc/%d/fd", (int)puppet[i]->pid);
        DIR *list = opendir(folder);
        while (list && (entry = readdir(list))) {
            struct stat status;
            unsigned known = 0;

            snprintf(link, sizeof link, "%s/%s", folder, entry->d_name);
            ssize_t length = readlink(link, target, sizeof target - 1);
            if (length < 0 || stat(link, &status))
                continue;
            target[length] = 0;
            if (strncmp(target, "/memfd:", 7) != 0)
                continue;
            while (known < files && seen[known] != status.st_ino)
                known++;
            if (known < files || files == FILES)
                continue;
            seen[files++] = status.st_ino;
            bytes += (uint64_t)status.st_blocks * 512;
        }
        if (list)
            closedir(list);
    }
    return bytes;
}

static void judge(struct puppet *const *puppet, unsigned count) {
    uint64_t real = existing(puppet, count);
    struct ddx_store_info info = all();

    if (real > info.bytes)
        fail("%llu bytes of memory files exist, the store says %llu", (unsigned long long)real,
             (unsigned long long)info.bytes);
    if (info.bytes > info.reserved || info.reserved > info.budget)
        fail("%llu bytes used, %llu reserved of %llu", (unsigned long long)info.bytes,
             (unsigned long long)info.reserved, (unsigned long long)info.budget);
}

static void each_in_its_own(void) {
    struct puppet *sleeper[SLEEPERS];
    unsigned count = 0;
    int64_t refused = 0;

    store_budget = "400K";
    store_begin(NULL);
    while (count < SLEEPERS && !refused) {
        struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
        int64_t result;

        AWAIT((result = puppet_ask(writer, ORDER_WRITE, 1)) != -EEXIST, "no program takes the dead writer's place");
        sleeper[count++] = reader;
        if (result < 0 || (result = puppet_ask(reader, ORDER_HOLD, 0)) < 0)
            refused = result;
        judge(sleeper, count);
        if (!refused)
            puppet_stop(reader);
        puppet_kill(writer);
    }
    if (refused != -ENOSPC && refused != -EBUSY)
        fail("%u stopped readers, and the end is %lld", count, (long long)refused);
    /* A reader that continues, or dies, has left its epoch before the next request. */
    struct puppet *writer = puppet_begin(NULL);
    for (unsigned i = 0; i + 1 < count; i++)
        if (i & 1)
            puppet_kill(sleeper[i]);
        else {
            puppet_go_on(sleeper[i]);
            ASK(sleeper[i], RELEASE, 0, 0);
        }
    int64_t number;
    AWAIT((number = puppet_ask(writer, ORDER_WRITE, 1)) > 0, "there is no memory, though no program is stopped");
    ASK(sleeper[0], HOLD, 1, number);
    AWAIT(read_info(&(struct ddx_item_info){0}), "the store does not answer");
    puppets_end();
}

/* A reader that sleeps through many changes of writer keeps its epoch and one more, from its unread messages. */
static void slept_through(void) {
    struct ddx_item_info item;
    int64_t number;

    store_budget = "64M";
    store_begin(NULL);
    struct puppet *sleeper = puppet_begin(NULL), *writer = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(sleeper, HOLD, 0, 1);
    puppet_stop(sleeper);
    for (unsigned i = 0; i < 2 * SLEEPERS; i++) {
        if (i == 1)
            nap(0.15); /* from now on it counts as stopped */
        puppet_kill(writer);
        writer = puppet_begin(NULL);
        AWAIT((number = puppet_ask(writer, ORDER_WRITE, 1)) > 0, "no program takes the dead writer's place");
    }
    if (!read_info(&item))
        fail("the store does not answer");
    uint64_t ended = all().bytes - item.bytes;
    if (!ended || ended > 2 * item.bytes)
        fail("a stopped reader keeps what it has not read: %llu bytes, the item has %llu", (unsigned long long)ended,
             (unsigned long long)item.bytes);
    puppet_go_on(sleeper);
    ASK(sleeper, LOOK, 0, 1);
    AWAIT(puppet_ask(sleeper, ORDER_HOLD, 1) == number, "the sleeper does not follow");
    AWAIT(all().bytes == item.bytes, "epochs without a holder are kept");
    puppets_end();
}

int test_retired(void) {
    each_in_its_own();
    slept_through();
    return 0;
}
