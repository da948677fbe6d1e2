/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "list.h"

#include <ddx_stats.h>
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "listen.h"
#include "program.h"
#include "sap.h"
#include "sdp_read.h"

#define NS INT64_C(1000000000)
#define LOOK_UP 100 /* ms; a signal may come just before a wait */
#define ENTRIES 100 /* further announcements are not listed */
#define DATAGRAM 4096
#define BATCH 1024 /* datagrams between two checks of the time */

/* RFC 2974, 3: the groups of all scopes. */
static const char *const groups[] = {"239.255.255.255", "239.195.255.255", "224.2.127.254", "224.0.0.255",
                                     "ff02::2:7ffe",    "ff05::2:7ffe",    "ff08::2:7ffe",  "ff0e::2:7ffe"};

struct entry {
    uint16_t hash;
    struct network_address origin;
    struct sdp_stream stream;
    int64_t heard;
};

struct list {
    struct entry entry[ENTRIES];
    unsigned count;
};

static bool is_same(const struct entry *entry, const struct sap *sap) {
    return entry->hash == sap->hash && !memcmp(&entry->origin, &sap->origin, sizeof sap->origin);
}

static void take(struct list *list, const struct sap *sap, int64_t now) {
    struct sdp_stream stream;
    unsigned i = 0;

    while (i < list->count && !is_same(&list->entry[i], sap))
        i++;
    if (sap->deletion) {
        if (i < list->count)
            list->entry[i] = list->entry[--list->count];
    } else if (i < ENTRIES && sdp_read(sap->text, sap->size, &stream)) {
        list->entry[i] = (struct entry){sap->hash, sap->origin, stream, now};
        list->count += i == list->count;
    }
}

static void read_all(struct list *list, int fd) {
    uint8_t data[DATAGRAM];
    struct sap sap;
    ssize_t size;

    for (int i = 0; i < BATCH && (size = recv(fd, data, sizeof data, MSG_TRUNC)) >= 0; i++) {
        if (size <= DATAGRAM && sap_parse(data, (size_t)size, &sap))
            take(list, &sap, ddx_time_now());
    }
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct entry *)a)->stream.name, ((const struct entry *)b)->stream.name);
}

static void print(struct list *list) {
    int64_t now = ddx_time_now();

    qsort(list->entry, list->count, sizeof *list->entry, by_name);
    for (unsigned i = 0; i < list->count; i++) {
        const struct sdp_stream *stream = &list->entry[i].stream;
        char host[NETWORK_TEXT_MAX];

        printf("%-24s %5u  %-8s %3.1f s  %s\n", network_host(&stream->address, host), network_port(&stream->address),
               stream->codec, (double)(now - list->entry[i].heard) / NS, stream->name);
    }
    if (!list->count)
        say("no stream is announced here; a sender to single receivers, or with -sap no, announces none");
}

/* Printed at once: users see that the program works, and scripts that no announcement is missed from now on. */
static void print_head(void) {
    printf("%-24s %5s  %-8s %5s  %s\n", "address", "port", "codec", "age", "name");
    fflush(stdout);
}

/* Joins the groups. Returns the number of successes; *error has the last failure. */
static unsigned join_all(int fd, const char *interface, int *error) {
    unsigned joined = 0;

    for (unsigned i = 0; i < sizeof groups / sizeof *groups; i++) {
        struct network_address group;
        int failed = network_parse(groups[i], SAP_PORT, &group) ? listen_join(fd, &group, interface) : -EINVAL;

        joined += !failed;
        *error = failed ? failed : *error;
    }
    return joined;
}

int list_run(const char *interface) {
    static struct list list;
    struct pollfd wanted = {.fd = listen_open(SAP_PORT), .events = POLLIN};
    int error = wanted.fd < 0 ? wanted.fd : 0;

    if (error || !join_all(wanted.fd, interface, &error)) {
        say("announcements at port %d: %s%s", SAP_PORT, strerror(-error), network_advice(error, interface));
        if (wanted.fd >= 0)
            close(wanted.fd);
        return EXIT_FAILED;
    }
    print_head();
    for (int64_t end = ddx_time_now() + LIST_SECONDS * NS; ddx_time_now() < end && !program_stopping();) {
        poll(&wanted, 1, LOOK_UP);
        read_all(&list, wanted.fd);
    }
    read_all(&list, wanted.fd); /* datagrams from before the signal */
    close(wanted.fd);
    print(&list);
    return EXIT_OK;
}
